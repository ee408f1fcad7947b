// Tangled from chapters/program.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The processes that render one image.

use std::sync::Arc;
use std::time::Instant;

use rayon::ThreadPoolBuilder;

use super::progress;
use super::watchdog;
use crate::error::Result;
use crate::film::Fragments;
use crate::host::Host;
use crate::inputs::{Inputs, in_first_rank};
use crate::integrator::{Communicator, SingleProcess};
use crate::key::RunKey;
use crate::plan::Plan;
use crate::render::Renderer;
use crate::run::Run;
use crate::world::World;

/// The processes that render one image, as each of them sees them.
pub trait Ranks: Communicator {
    /// A renderer of all of them, given that of the first.
    fn lead<'a>(
        &self,
        own: Box<dyn Renderer + 'a>,
        _: &'a RunKey,
        _: Option<Arc<Fragments>>,
    ) -> Box<dyn Renderer + 'a> {
        own
    }

    /// Renders for the first until there is nothing more to do.
    fn serve(
        &self,
        _: Box<dyn Renderer + '_>,
        _: &RunKey,
        _: Option<Arc<Fragments>>,
    ) {
    }
}

impl Ranks for SingleProcess {}

/// Starts as many threads as a plan says.
///
/// # Errors
/// The system refuses them.
pub fn start_threads(plan: &Plan) -> Result<()> {
    let threads = plan.threads.unwrap_or(0) as usize;
    let pool = ThreadPoolBuilder::new().num_threads(threads);
    pool.build_global()
        .map_err(|e| format!("cannot start threads: {e}").into())
}

/// Renders for the leading process until it has nothing more to do.
///
/// # Errors
/// The scene cannot be rendered here, or the first process has ended.
pub fn follow(ranks: &dyn Ranks) -> Result<()> {
    let _ = watchdog::listen();
    progress::set_quiet(true);
    let host = Host { listen: &|_| (), ranks, start: Instant::now() };
    let plan: Plan = in_first_rank(host, || Err("leads".into()))?;
    let plan = plan.restored();
    start_threads(&plan)?;
    let inputs = Inputs::read(&plan, host)?;
    let world = World::new(&plan, inputs, host)?;
    let run = Run::new(&world, &plan, host)?;
    let shown = run.fragments();
    let Run { renderer, key, .. } = run;
    ranks.serve(renderer, &key, shown);
    Ok(())
}
