// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What many files of tests use.

pub use std::collections::{BTreeMap, BTreeSet};
pub use std::f64::consts::{PI, TAU};
pub use std::ffi::OsStr;
pub use std::io::{Cursor, Write};
pub use std::os::unix::ffi::OsStrExt;
pub use std::path::{Path, PathBuf};
pub use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
pub use std::sync::{Arc, LazyLock, OnceLock};
pub use std::time::{Duration, Instant, SystemTime};
pub use std::{fs, io, thread};

pub use crate::bvh::apart;
pub use crate::chance::Chance;
pub use crate::common::*;
pub use glam::DVec3;
pub use litpt::analysis::{
    LitView, SHORTCUTS, SceneAnalysis, background::*,
};
pub use litpt::host::{Host, Interrupt};
pub use litpt::inputs::Inputs;
pub use litpt::integrator::gather::{cache::*, *};
pub use litpt::plan::*;
pub use litpt::render::{Job, Renderer, choose::*};
pub use litpt::sampler::sobol::*;
pub use litpt::sensor::{Sensor, Side, read_points};
pub use litpt::state::checkpoint::{Checkpoint, RunRecord, save};
pub use litpt::world::World;
pub use litpt::{bvh::*, camera::*, film::*, image::*, integrator::*};
pub use litpt::{materials::*, numerics::*, output::*, render_loop::*};
pub use litpt::{report::*, sampler::*, scene::*, sky::*, statistics::*};
pub use litpt_book::{closed_forms::*, escapes::Inside, solids};
pub use rand::{Rng, RngExt, SeedableRng};
pub use rand_pcg::{Pcg64, Pcg64Mcg};
pub use rayon::prelude::*;
pub use serde_json::{Value, json};

/// The values of a world as a plan has them, with their errors.
pub fn values_of(world: &World, plan: &Plan) -> Vec<[f64; 2]> {
    let run = litpt::run::Run::new(world, plan, Host::default()).unwrap();
    run.render(&Interrupt::default()).unwrap().values()
}

/// A point of the cube from -1 to 1.
pub fn in_cube(random: &mut impl Rng) -> DVec3 {
    2. * DVec3::from(random.random::<[f64; 3]>()) - 1.
}
