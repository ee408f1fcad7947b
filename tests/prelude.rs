// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What many files of tests use.

pub use std::collections::{BTreeMap, BTreeSet};
pub use std::f64::consts::{PI, TAU};
pub use std::io::{Cursor, Write};
pub use std::path::Path;
pub use std::sync::Arc;
pub use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
pub use std::time::{Duration, Instant, SystemTime};
pub use std::{fs, io, thread};

pub use crate::chance::Chance;
pub use crate::common::*;
pub use glam::DVec3;
pub use litpt::analysis::{SceneAnalysis, background::*};
pub use litpt::host::{Host, Interrupt};
pub use litpt::inputs::Inputs;
pub use litpt::plan::*;
pub use litpt::render::{Job, Renderer, choose::*};
pub use litpt::state::checkpoint::{Checkpoint, save};
pub use litpt::world::World;
pub use litpt::{bvh::*, camera::*, film::*, image::*, integrator::*};
pub use litpt::{materials::*, numerics::*, output::*, render_loop::*};
pub use litpt::{report::*, sampler::*, scene::*, sky::*, statistics::*};
pub use litpt_book::{closed_forms::*, escapes::Inside, solids};
pub use rand::{Rng, RngExt, SeedableRng};
pub use rand_pcg::{Pcg64, Pcg64Mcg};
pub use rayon::prelude::*;
pub use serde_json::{Value, json};
