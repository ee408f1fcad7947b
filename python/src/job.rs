// Tangled from chapters/python.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A run on threads of its own, which Python waits for, looks at and cancels.

use std::panic;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread;
use std::time::{Duration, Instant};

use litpt::cli::run::warn_of_receivers;
use litpt::error::Result;
use litpt::film::Film;
use litpt::host::{Event, Host, Interrupt};
use litpt::inputs::Inputs;
use litpt::plan::Plan;
use litpt::render_loop::{Convergence, Limits, Stop};
use litpt::run::Run;
use litpt::state::checkpoint::RunRecord;
use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::rendering::{Blocks, Rendering};
use crate::{Cancelled, SceneData, on_threads};

/// A run that has begun.
#[pyclass(frozen, module = "litpt._core")]
pub struct Job(Arc<Shared>);

/// What the run and Python share.
#[derive(Default)]
struct Shared {
    interrupt: Interrupt,
    news: Mutex<News>,
    changed: Condvar,
    /// Whether a partial result is wanted.
    is_wanted: AtomicBool,
}

/// What the run has told so far.
#[derive(Default)]
struct News {
    /// What it does, and how much of that is done.
    doing: (f64, String),
    warnings: Vec<String>,
    partial: Option<Rendering>,
    end: Option<PyResult<Rendering>>,
}

impl Shared {
    fn news(&self) -> MutexGuard<'_, News> {
        self.news.lock().unwrap_or_else(|it| it.into_inner())
    }

    /// Listens to a run, and ends it if it is cancelled before it renders.
    fn hear(&self, event: Event) {
        match event {
            Event::Warning(text) => return self.news().warnings.push(text),
            Event::Stage(name, _) => self.news().doing = (0., name),
            Event::Note(_) | Event::Steps(_) => (),
        }
        if self.interrupt.signal().is_some() {
            panic::resume_unwind(Box::new(Cancelled));
        }
    }

    /// Renders a plan.
    fn render(
        &self,
        scene: &SceneData,
        plan: &Plan,
        inputs: Inputs,
    ) -> Result<Rendering> {
        let listen = |event| self.hear(event);
        let host = Host { listen: &listen, ..Host::default() };
        let world = Arc::new(scene.world(plan, inputs, host)?);
        let run = Run::new(&world, plan, host)?;
        let (mut film, mut convergence) = run.film(None)?;
        let first = run.first_picture(&self.interrupt)?.map(Arc::new);
        let interrupt = Some(&self.interrupt);
        let limits = Limits { interrupt, ..run.limits() };
        let report = run.report();
        let Run { key: run_key, learnt, mut renderer, .. } = run;
        let (plan, rows) = (plan.clone(), world.rows());
        let record = RunRecord { run_key, plan, report, rows, learnt };
        let whole = |film, convergence: &Convergence, blocks: &Blocks| {
            let mut record = record.clone();
            record.report.convergence.clone_from(convergence);
            let (world, first) = (world.clone(), first.clone());
            Rendering { world, record, film, first, blocks: blocks.clone() }
        };
        // Render with an eye on Python
        // Render, and tell of it
        let mut blocks = Blocks::default();
        let mut after = |convergence: &Convergence, film: &Film| {
            blocks.add(film, convergence);
            self.news().doing = progress(convergence, film, &limits);
            if self.is_wanted.swap(false, Relaxed) {
                let partial = whole(film.clone(), convergence, &blocks);
                self.news().partial = Some(partial);
                self.changed.notify_all();
            }
        };
        let advance = |_| ();
        convergence.run(
            &mut *renderer,
            &mut film,
            &limits,
            &advance,
            &mut after,
        );
        drop(renderer);
        let rendering = whole(film, &convergence, &blocks);
        if rendering.has_samples() {
            warn_of_receivers(&world, &rendering.film, host);
        }
        Ok(rendering)
    }
}

/// The part of a run that is done, and its error so far.
fn progress(
    convergence: &Convergence,
    film: &Film,
    limits: &Limits,
) -> (f64, String) {
    let Convergence { spp, seconds, .. } = *convergence;
    let samples = convergence.expected(limits, film.area());
    let samples = samples.map(|all| spp as f64 / all as f64);
    let left = limits
        .deadline
        .map(|end| end.saturating_duration_since(Instant::now()));
    let time = left.map(|left| seconds / (seconds + left.as_secs_f64()));
    let done = samples.into_iter().chain(time).fold(0., f64::max);
    let error = convergence.last().judged(limits.norm);
    let error =
        error.map_or(String::new(), |error| format!(", error {error:.2e}"));
    (done, format!("{spp} samples{error}"))
}

impl Job {
    /// Begins a run.
    pub fn start(
        scene: Arc<SceneData>,
        plan: Plan,
        inputs: Inputs,
    ) -> PyResult<Self> {
        let shared = Arc::new(Shared::default());
        let job = Self(shared.clone());
        let work = move || {
            let render = || shared.render(&scene, &plan, inputs);
            let end = on_threads(plan.threads, render);
            shared.news().end = Some(end);
            shared.changed.notify_all();
        };
        thread::Builder::new().name("litpt".into()).spawn(work)?;
        Ok(job)
    }
}

#[pymethods]
impl Job {
    /// Waits for the end or a partial result, so many seconds at most; returns
    /// whether the run has ended.
    fn wait(&self, py: Python, seconds: f64) -> bool {
        let limit = Duration::from_secs_f64(seconds);
        let is_quiet =
            |news: &mut News| news.end.is_none() && news.partial.is_none();
        py.detach(|| {
            let Shared { changed, .. } = &*self.0;
            let news = self.0.news();
            let wait = changed.wait_timeout_while(news, limit, is_quiet);
            wait.unwrap_or_else(|it| it.into_inner()).0.end.is_some()
        })
    }

    /// The part that is done, and what is being done.
    fn progress(&self) -> (f64, String) {
        self.0.news().doing.clone()
    }

    /// The partial result that was asked for, once; asks for one.
    fn partial(&self, asks: bool) -> Option<Rendering> {
        let partial = self.0.news().partial.take();
        let asks = asks && partial.is_none();
        self.0.is_wanted.fetch_or(asks, Relaxed);
        partial
    }

    /// Ends the run soon.
    fn cancel(&self) {
        self.0.interrupt.cancel();
    }

    /// The warnings so far, each once.
    fn warnings(&self) -> Vec<String> {
        std::mem::take(&mut self.0.news().warnings)
    }

    /// The result of a run that has ended, once.
    fn result(&self) -> PyResult<Rendering> {
        let end = self.0.news().end.take();
        let rendering = end
            .unwrap_or_else(|| Err(PyRuntimeError::new_err("no result")))?;
        match rendering.stop() {
            _ if rendering.has_samples() => Ok(rendering),
            Some(Stop::Signal(_)) => Err(PyKeyboardInterrupt::new_err(())),
            _ => Err(PyValueError::new_err(
                "--time ran out before each value had a sample",
            )),
        }
    }
}
