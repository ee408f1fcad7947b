// Tangled from chapters/run.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A run of a plan over a world: how its samples are made, its film, and its
//! limits.
//!
//! ```
//! use glam::DVec3;
//! use litpt::host::{Host, Interrupt};
//! use litpt::plan::{Budget, Plan, SensorPlan};
//! use litpt::{inputs::Inputs, run::Run, scene::read_obj, world::World};
//!
//! let obj = "v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\nf 1 2 3 4\n";
//! let inputs = Inputs::from(read_obj(obj.as_bytes())?);
//! let inputs = inputs.with_points([(DVec3::ZERO, DVec3::Z)]);
//! let plan = Plan {
//!     sensor: SensorPlan::Points("points".into()),
//!     budget: Budget::relative_error(0.01),
//!     ..Plan::default()
//! };
//! let host = Host::default();
//! let world = World::new(&plan, inputs, host)?;
//! let run = Run::new(&world, &plan, host)?;
//! let [value, error] = run.render(&Interrupt::default())?.values()[0];
//! assert!((value - 0.4459).abs() < 5. * error);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use crate::error::{Error, Result};
use crate::film::{Film, Fragments, NEIGHBOUR_WEIGHT};
use crate::filter::{FEWEST, Filtered, fragments};
use crate::host::{Host, Interrupt};
use crate::image::{Image, Picture};
use crate::inputs::in_first_rank;
use crate::integrator::gather::Learnt;
use crate::key::RunKey;
use crate::memory::{reserved, zeroed};
use crate::plan::{Budget, Plan, require};
use crate::render::Renderer;
use crate::render::choose::samples_if_known;
use crate::render::choose::{Choice, Method, Request, Sampling};
use crate::render_loop::{Convergence, Limits, Stop};
use crate::report::{Report, Settings, metric};
use crate::state::checkpoint::Checkpoint;
use crate::state::learnt;
use crate::statistics::Accumulator;
use crate::tally::Columns;
use crate::world::{Geometry, World};

/// The states of earlier runs: the state of this run, which continues, and
/// the state of another part of it, whose trained cache is used.
#[derive(Default)]
pub struct History {
    /// The state of this run.
    pub state: Option<Checkpoint>,
    /// The state of another part.
    pub cache: Option<Checkpoint>,
}

/// A run that has not begun.
pub struct Run<'a> {
    /// The values that describe the run.
    pub plan: &'a Plan,
    /// The scene.
    pub world: &'a World,
    /// The receiver of events.
    pub host: Host<'a>,
    /// All that decides its samples.
    pub key: RunKey,
    /// The findings of a pilot, if it has chosen the method.
    pub choice: Option<Choice>,
    /// The trained cache, now or later.
    pub learnt: Arc<OnceLock<Learnt>>,
    /// The renderer that makes the samples.
    pub renderer: Box<dyn Renderer + 'a>,
    /// What the pixels show, once that is known.
    shown: OnceLock<Arc<Fragments>>,
}

impl<'a> Run<'a> {
    /// Chooses how the samples of a plan are made.
    ///
    /// # Errors
    /// Another process has ended, if there are several.
    pub fn new(
        world: &'a World,
        plan: &'a Plan,
        host: Host<'a>,
    ) -> Result<Self> {
        Self::after(&History::default(), world, plan, host)
    }

    /// Chooses it after earlier runs.
    ///
    /// # Errors
    /// Their states belong to another run, or those of [`Run::new`].
    pub fn after(
        history: &History,
        world: &'a World,
        plan: &'a Plan,
        host: Host<'a>,
    ) -> Result<Self> {
        host.enter("choosing a method", None);
        let before = history.state.as_ref().map(|s| &s.record.run_key);
        let mut choice = None;
        let key = in_first_rank(host, || {
            let sampling = before.map(|key| key.sampling);
            let (sampling, found) = method(plan, world, sampling, host);
            choice = found;
            let had_halves = before.is_none_or(|key| key.filtered);
            let filtered = keeps_halves(plan, sampling, had_halves, host);
            Ok(run_key(plan, world, sampling, filtered))
        })?;
        let learnt = learnt_before(plan, &key, history, host)?;
        Ok(Self::with(world, plan, host, key, choice, learnt))
    }

    /// A run with this key and this cache.
    fn with(
        world: &'a World,
        plan: &'a Plan,
        host: Host<'a>,
        key: RunKey,
        choice: Option<Choice>,
        learnt: Arc<OnceLock<Learnt>>,
    ) -> Self {
        let (setup, shared) = (world.setup(), learnt.clone());
        let renderer = setup.renderer(&key.sampling, shared, host.ranks);
        let shown = OnceLock::new();
        Self { plan, world, host, key, choice, learnt, renderer, shown }
    }

    /// A run whose first image comes soon, and is filtered.
    pub fn for_display(
        world: &'a World,
        plan: &'a Plan,
        host: Host<'a>,
    ) -> Self {
        let budget = Budget::samples(64);
        let asked = request(plan, world, host);
        let request = Request { left: None, budget, shows: false, ..asked };
        let (sampling, choice) = world.setup().decide(&request, None);
        let sampling = sampling.for_display();
        let filtered = sampling.method != Method::Reference;
        let key = run_key(plan, world, sampling, filtered);
        Self::with(world, plan, host, key, choice, Arc::default())
    }

    /// A glance, with its film, to be shown until there is a better picture; none
    /// if that is not needed, or if a signal arrives.
    ///
    /// # Errors
    /// There is too little memory.
    pub fn first_picture(
        &self,
        interrupt: &Interrupt,
    ) -> Result<Option<(Film, Filtered)>> {
        let &Self { plan, world, host, .. } = self;
        let Budget { samples, time, .. } = plan.budget;
        let is_soon =
            time.is_none() && samples.is_some_and(|n| (4..16).contains(&n));
        let (_, processes) = host.ranks.rank_and_size();
        let is_part = plan.part.is_some() || processes > 1;
        if is_soon || is_part || self.least() > 0 || !plan.filters() {
            return Ok(None);
        }
        let (asked, budget) =
            (request(plan, world, host), Budget::samples(1));
        let falls_back = self.key.sampling.method == Method::Reference;
        let whole = asked.left.filter(|_| falls_back);
        let left = whole.or(Some(0.));
        let request = Request { left, budget, shows: true, ..asked };
        let (sampling, _) = world.setup().decide(&request, None);
        if !sampling.glance {
            return Ok(None);
        }
        let key = run_key(plan, world, sampling, true);
        let shown = self.shown.clone();
        let mut run =
            Self::with(world, plan, host, key, None, Arc::default());
        run.shown = shown;
        let (mut film, mut convergence) = run.film(None)?;
        // Limit the glance
        let least = run.least();
        let limits = Limits {
            least,
            samples: whole.is_none().then_some(least),
            deadline: plan.budget.deadline(host.start),
            reserve: [0.3 * whole.unwrap_or(0.); 2],
            interrupt: Some(interrupt),
            ..Limits::default()
        };
        let renderer = &mut *run.renderer;
        let (advance, after) = (&|_| (), &mut |_: &_, _: &_| ());
        convergence.run(renderer, &mut film, &limits, advance, after);
        Ok(Filtered::of(&film).map(|filtered| (film, filtered)))
    }

    /// The samples of each pixel to render here, if they are limited.
    pub fn goal(&self) -> Option<u64> {
        let part = self.key.part.map(|part| part.count());
        let samples = self.plan.budget.samples;
        part.or(samples.map(|n| n.max(self.least())))
    }

    /// The samples of each pixel that no limit of time prevents: those of a
    /// picture that comes soon, if all its samples count.
    fn least(&self) -> u64 {
        let Sampling { method, net_size, glance, .. } = self.key.sampling;
        let few = FEWEST.max(2 * net_size);
        let area = self.key.windows()[1].area() as u64;
        let is_soon = method == Method::Sobol
            && few.saturating_mul(area) <= 1 << 22
            && self.plan.budget.samples.is_none_or(|n| n >= few);
        let shows = self.key.filtered && self.key.part.is_none();
        if glance || shows && is_soon { few } else { 0 }
    }

    /// What the pixels show, if a picture is to be filtered.
    pub fn fragments(&self) -> Option<Arc<Fragments>> {
        let (Self { key, world, .. }, view) = (self, self.world.view());
        let [run_window, window] = key.windows();
        let windows = (window, run_window);
        let trace =
            || fragments(&world.geometry.bvh, &view, windows).into();
        key.filtered.then(|| self.shown.get_or_init(trace).clone())
    }

    /// The film and its convergence: empty, or from a state.
    ///
    /// # Errors
    /// There is too little memory, or the state belongs to another run.
    pub fn film(
        &self,
        state: Option<Checkpoint>,
    ) -> Result<(Film, Convergence)> {
        let key = &self.key;
        self.ask_for_memory()?;
        let mut film = key.film();
        if let Some(shown) = self.fragments() {
            film = film.with_halves(Some(shown));
        }
        let goal = self.goal();
        let is_part = self.plan.part.is_some_and(|part| part.count() > 0);
        if is_part && goal == Some(0) {
            let together = film.net_size;
            self.host.warn(format!(
                "the part has no sample: {together} are placed together"
            ));
        }
        // Go on from a state
        let Some(state) = state else {
            return Ok((film, Convergence::default()));
        };
        let name = state.name.clone();
        let convergence = state.resume(key, &mut film)?;
        let spp = convergence.spp;
        if goal.is_some_and(|n| 0 < n && n <= spp) {
            self.host.warn(format!(
                "{name}: holds {spp} samples already (ask for more with -n)"
            ));
        }
        Ok((film, convergence))
    }

    /// Fails if there is no memory for the film.
    fn ask_for_memory(&self) -> Result<()> {
        let [whole, area] = self.key.windows().map(|window| window.area());
        let learns = self.key.sampling.method == Method::Gather
            && self.learnt.get().is_none();
        let parts =
            [(true, area), (self.key.filtered, area), (learns, whole)];
        let parts = parts.into_iter().filter(|&(is_needed, _)| is_needed);
        let sums: usize = parts.map(|(_, area)| area).sum();
        zeroed::<Accumulator>(sums).map(drop).map_err(|_| {
            let bytes = metric(64. * sums as f64);
            Error::Memory(format!(
                "too little memory: {bytes}B more are needed"
            ))
        })?;
        let columns = self.world.columns.as_ref();
        columns.map_or(Ok(()), |it| self.ask_for_rows(it, area))
    }

    /// Fails if there is no memory for the rows of a tally, of which each sample
    /// may fill an entry, or all entries if it gathers.
    fn ask_for_rows(&self, columns: &Columns, rows: usize) -> Result<()> {
        let width = u64::from(columns.count) * columns.tally.parts();
        let is_dense = self.key.sampling.method == Method::Gather;
        let goal = self.goal().filter(|_| !is_dense);
        let filled = goal.map_or(width, |n| n.min(width));
        let entries = filled.saturating_mul(rows as u64) as usize;
        reserved::<[u128; 2]>(entries).map(drop).map_err(|_| {
            let (count, bytes) = (columns.count, metric(32. * entries as f64));
            Error::Memory(format!(
                "a matrix of {rows} x {count} can take {bytes}B, and there is \
                 too little memory (fewer samples or columns)"
            ))
        })
    }

    /// The limits of the plan.
    pub fn limits(&self) -> Limits<'a> {
        let enough = samples_if_known(&self.world.analysis);
        let (error, norm) = self.plan.budget.error.unzip();
        Limits {
            samples: self.goal().or(enough),
            least: self.least(),
            deadline: self.plan.budget.deadline(self.host.start),
            error,
            norm: norm.unwrap_or_default(),
            ..Limits::default()
        }
    }

    /// The path of sample `n` of a pixel, or of a receiver by its number in the
    /// file, from 0, in words; a gather is trained first.
    ///
    /// # Errors
    /// There is no such pixel or receiver, or it has no value; or the run has
    /// no such sample of it.
    pub fn trace_sample(
        &mut self,
        (x, y): (u32, u32),
        n: u64,
    ) -> Result<String> {
        let Geometry { bvh, frame, .. } = &*self.world.geometry;
        let row = match self.world.table() {
            Some((_, receivers)) => {
                receivers.numbers.iter().position(|&it| it == y)
            }
            None => Some(y as usize),
        };
        let row = row.map_or(u32::MAX, |row| row as u32);
        let [_, window] = self.key.windows();
        let ((left, top), (right, bottom)) = (window.corner, window.end());
        let is_there =
            (left..right).contains(&x) && (top..bottom).contains(&row);
        let sample = format!("{x},{y},{n}");
        require(is_there, "sample", &sample, "nothing is rendered there")?;
        // Trace a sample of the run
        let RunKey { sampling, part, .. } = self.key;
        let is_gather = sampling.method == Method::Gather;
        let has_path = !is_gather || self.world.columns.is_none();
        let fault = "a row is gathered, and not along one path";
        require(has_path, "sample", &sample, fault)?;
        if is_gather {
            self.renderer.learn(&mut self.key.film(), &|_| true);
        }
        let setup = self.world.setup();
        let trace =
            setup.trace_sample(&sampling, &self.learnt, (x, row), n);
        let Some(trace) = trace else {
            return Ok("nothing was learnt\n".to_owned());
        };
        let whole = (0, self.plan.budget.samples.unwrap_or(u64::MAX));
        let (from, end) = part.map_or(whole, |part| part.samples);
        let nets =
            from / sampling.net_size..end.div_ceil(sampling.net_size);
        let net = trace.scramble.map(|scramble| scramble.number);
        let has = nets.contains(&net.unwrap_or(n / sampling.net_size));
        require(has, "sample", &sample, "the run has no such sample")?;
        Ok(trace.text(bvh, frame))
    }

    /// The report of the run before its first pass.
    pub fn report(&self) -> Report {
        let Self { plan, world, key, .. } = self;
        let (error, norm) = plan.budget.error.unzip();
        let reference = plan.reference.as_ref();
        let settings = Settings {
            subject: Some(key.subject.clone()),
            seed: key.sampling.seed,
            spp: self.goal(),
            time: plan.budget.time,
            error,
            reference: reference.map(|path| path.display().to_string()),
            isa: Some(plan.isa().to_string()),
            threads: Some(rayon::current_num_threads()),
            integrator: key.sampling.method,
            choice: self.choice.as_ref().map(ToString::to_string),
            part: key.part,
            ..world.report.settings.clone()
        };
        let mut report = Report {
            settings,
            left_out: world.analysis.left_out().cloned().collect(),
            norm: norm.unwrap_or_default(),
            ..world.report.clone()
        };
        report.sign("pt");
        report
    }

    /// Renders until a limit of the plan is reached, or the run is cancelled,
    /// by the render loop, which is [`Convergence::run`].
    ///
    /// # Errors
    /// There is too little memory.
    pub fn render(
        mut self,
        interrupt: &Interrupt,
    ) -> Result<Rendering<'a>> {
        let (mut film, mut convergence) = self.film(None)?;
        let limits = Limits { interrupt: Some(interrupt), ..self.limits() };
        let renderer = &mut *self.renderer;
        let stop = convergence.run(
            renderer,
            &mut film,
            &limits,
            &|_| (),
            &mut |_, _| (),
        );
        let Self { world, learnt, .. } = self;
        Ok(Rendering { world, learnt, film, convergence, stop })
    }
}

/// The result of a run.
pub struct Rendering<'a> {
    world: &'a World,
    learnt: Arc<OnceLock<Learnt>>,
    /// The sums of its samples.
    pub film: Film,
    /// The record of its passes.
    pub convergence: Convergence,
    /// The reason of its end.
    pub stop: Stop,
}

impl Rendering<'_> {
    /// The value of each requested receiver, or of each pixel row by row,
    /// with its standard error; NaN where there is none. The irradiance of
    /// receivers is in units of the irradiance of a horizontal surface in
    /// the open, the radiance of pixels in units of the uniform sky's.
    pub fn values(&self) -> Vec<[f64; 2]> {
        let film = &self.film;
        if let Some((table, receivers)) = self.world.table() {
            let values = table.values(receivers, film, None).into_iter();
            return values.map(|(pair, _)| pair.map(f64::from)).collect();
        }
        let errors = film.errors(NEIGHBOUR_WEIGHT, film.window);
        film.means().zip(errors).map(Into::into).collect()
    }

    /// The pixels of a camera, not filtered, as a format writes them; for
    /// receivers a column, in the order in which they are rendered.
    pub fn image(&self) -> Image {
        let learnt = self.learnt.get();
        let allocation = learnt.map(|it| &it.allocation.counts[..]);
        let (film, more, attributes) =
            (&self.film, vec![], BTreeMap::new());
        Picture { film, allocation, more, attributes }.image()
    }
}

/// The key of a plan, which identifies its samples.
fn run_key(
    plan: &Plan,
    world: &World,
    sampling: Sampling,
    filtered: bool,
) -> RunKey {
    RunKey {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        integrator: sampling.identity(),
        scene_sha256: world.report.scene.sha256.clone(),
        subject: world.subject.clone(),
        sampling,
        part: plan.part.map(|part| part.rounded(sampling.net_size)),
        filtered,
    }
}

/// The request of a run to the policy.
fn request(plan: &Plan, world: &World, host: Host) -> Request {
    let deadline = plan.budget.deadline(host.start);
    let left = deadline.map(|end| {
        end.saturating_duration_since(Instant::now()).as_secs_f64()
    });
    // Leave time for a glance
    let shows = plan.shows_only_pictures() && plan.filters();
    let part = if plan.filters() && !shows { 0.5 } else { 1. };
    Request {
        method: plan.method,
        seed: plan.seed,
        window: world.subject.sensed.window(),
        budget: plan.budget,
        left: left.map(|left| part * left),
        shows,
    }
}

/// How the samples are made: as in a state, if there is one. And the
/// findings of a pilot, if it has chosen.
fn method(
    plan: &Plan,
    world: &World,
    saved: Option<Sampling>,
    host: Host,
) -> (Sampling, Option<Choice>) {
    let request = request(plan, world, host);
    let (sampling, choice) = world.setup().decide(&request, saved);
    // Warn if it is not the requested method
    let (wanted, chosen) = (request.method, sampling.method);
    let wanted = wanted.or(saved.map(|saved| saved.method));
    if let Some(wanted) = wanted.filter(|&wanted| wanted != chosen) {
        host.warn(format!(
            "the time leaves too little for a first sample of each pixel \
             by {wanted}: the method is {chosen}"
        ));
    }
    (sampling, choice)
}

/// Whether a film is to keep halves, so that a picture can be filtered.
fn keeps_halves(
    plan: &Plan,
    sampling: Sampling,
    had_halves: bool,
    host: Host,
) -> bool {
    let is_part = plan.part.is_some() && plan.camera().is_some();
    let shows = plan.filters() || is_part && plan.outputs.filter;
    let is_wanted = sampling.method != Method::Reference && shows;
    if is_wanted && !had_halves {
        host.warn(
            "the run was begun without a picture: none can be filtered",
        );
    }
    is_wanted && had_halves
}

/// The cache that this run, or another part of it, has trained before.
fn learnt_before(
    plan: &Plan,
    key: &RunKey,
    history: &History,
    host: Host,
) -> Result<Arc<OnceLock<Learnt>>> {
    let own = history.state.as_ref();
    let mut found =
        own.map(|s| s.record.learnt.clone()).unwrap_or_default();
    if let (Some(path), Some(cache)) = (&plan.cache, &history.cache) {
        let mut record = cache.record.clone();
        record.run_key.part = key.part;
        let belongs = record.belongs_to(key);
        belongs.map_err(|fault| fault.of_file(path))?;
        found = record.learnt;
        if found.get().is_none() && key.sampling.method == Method::Gather {
            let fault = Error::from("holds nothing learnt");
            return Err(fault.of_file(path));
        }
    }
    // Send it to the other processes
    let (rank, size) = host.ranks.rank_and_size();
    if size == 1 {
        return Ok(found);
    }
    let mut bytes = vec![];
    if rank == 0 {
        learnt::write(&found, &mut bytes)
            .map_err(Error::cannot("write", "what was learnt"))?;
    }
    let bytes = host.ranks.broadcast(bytes)?;
    learnt::read(&mut &bytes[..], key)
        .map_err(Error::cannot("read", "what was learnt"))
}
