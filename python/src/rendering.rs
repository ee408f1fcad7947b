// Tangled from chapters/python.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! What a run has found: values with their errors.

use std::io::Cursor;
use std::sync::Arc;

use litpt::error::Result;
use litpt::film::{Film, NEIGHBOUR_WEIGHT};
use litpt::filter::{Filtered, fragments};
use litpt::output::OutputTarget;
use litpt::plan::{Outputs, is_dash};
use litpt::render_loop::{Convergence, Stop};
use litpt::run_output::RunOutput;
use litpt::state::checkpoint::{Checkpoint, RunRecord, save};
use litpt::state::shards;
use litpt::world::World;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::on_threads;

/// The values of a run.
#[pyclass(frozen, module = "litpt._core")]
pub struct Rendering {
    world: Arc<World>,
    record: RunRecord,
    /// The samples.
    pub film: Film,
    /// A glance, if there was one.
    first: Option<Arc<(Film, Filtered)>>,
    /// The means of blocks of samples.
    pub blocks: Blocks,
}

/// Means of receivers when so many samples were made.
#[derive(Clone, Default)]
pub struct Blocks(Vec<(u64, Vec<f64>)>);

impl Blocks {
    /// Adds the means on a film of receivers at a step of its record, which
    /// samples alone decide.
    pub fn add(&mut self, film: &Film, convergence: &Convergence) {
        let Convergence { spp, .. } = *convergence;
        let before = self.0.last().map_or(0, |(before, _)| *before);
        let is_new = before < spp && convergence.last().spp == spp;
        if film.is_list && is_new {
            self.0.push((spp, film.means().collect()));
        }
    }
}

/// Arrays of one number for each pixel or receiver.
type Numbers<'py> = Bound<'py, PyArray1<f64>>;

impl Rendering {
    /// A result without samples.
    pub fn new(
        world: Arc<World>,
        record: RunRecord,
        first: Option<Arc<(Film, Filtered)>>,
    ) -> Self {
        let film = Film::new(1, 1);
        Self { world, record, film, first, blocks: Blocks::default() }
    }

    /// The result with these samples.
    pub fn with(&self, film: Film, convergence: Convergence) -> Self {
        let Self { world, record, first, blocks, .. } = self;
        let (world, first) = (world.clone(), first.clone());
        let (mut record, blocks) = (record.clone(), blocks.clone());
        record.report.convergence = convergence;
        Self { world, record, film, first, blocks }
    }

    /// Why the run has ended.
    pub fn stop(&self) -> Option<Stop> {
        self.record.report.convergence.stopped
    }

    /// Whether there is anything to show.
    pub fn has_samples(&self) -> bool {
        let is_empty = self.film.unsampled() == self.film.area();
        !is_empty
            || self.first.is_some()
            || self.record.run_key.only_learns()
    }

    /// The sum of parts with these states.
    pub fn restore(world: World, states: Vec<Vec<u8>>) -> Result<Self> {
        let world = Arc::new(world);
        let open = |(n, state): (usize, Vec<u8>)| {
            let mut state = Checkpoint::open(Cursor::new(state))?;
            state.name = format!("part {n}");
            Ok(state)
        };
        let count = states.len();
        let mut states = (1..).zip(states).map(open);
        let (record, mut film) = match count {
            // Read the state of one run, or merge several
            1 => {
                // Read the state of one run
                let mut state = states.next().expect("one state")?;
                let mut film = state.record.run_key.film();
                state.fill(&mut film)?;
                (state.record, film)
            }
            _ => {
                let merged = shards::merge(states)?;
                (merged.record, merged.film)
            }
        };
        if record.run_key.filtered {
            let windows = (film.window, film.run_window);
            let (bvh, view) = (&world.geometry.bvh, world.view());
            film.fragments = Some(fragments(bvh, &view, windows).into());
        }
        let new = Self::new(world, record, None);
        let convergence = new.record.report.convergence.clone();
        Ok(new.with(film, convergence))
    }

    /// Numbers of the film for each requested receiver, in the order of the
    /// request; NaN for one without a value.
    fn spread(&self, numbers: Vec<f64>) -> Vec<f64> {
        let Some((_, receivers)) = self.world.table() else {
            return numbers;
        };
        let mut all = vec![f64::NAN; receivers.asked];
        for (&row, number) in receivers.numbers.iter().zip(numbers) {
            all[row as usize] = number;
        }
        all
    }

    /// Values, standard errors and numbers of samples.
    fn numbers(&self) -> [Vec<f64>; 3] {
        let (film, window) = (&self.film, self.film.window);
        let counts = self.record.allocation();
        if let Some((table, receivers)) = self.world.table() {
            let values = table.values(receivers, film, counts);
            let pick =
                |k: usize| values.iter().map(move |(pair, _)| pair[k]);
            let samples = values.iter().map(|(_, samples)| *samples);
            return [
                pick(0).collect(),
                pick(1).collect(),
                samples.collect(),
            ];
        }
        let errors = film.errors(NEIGHBOUR_WEIGHT, window);
        let counts = film.counts_of(window, counts);
        [film.means_of(window), errors, counts]
    }
}

#[pymethods]
impl Rendering {
    /// Values, standard errors and numbers of samples.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<[Numbers<'py>; 3]> {
        let numbers = py.detach(|| {
            on_threads(self.record.plan.threads, || Ok(self.numbers()))
        })?;
        Ok(numbers.map(|list| PyArray1::from_vec(py, list)))
    }

    /// The filtered image and its errors, if there is one.
    fn filtered<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<[Numbers<'py>; 2]>> {
        let filter = || {
            let own = Filtered::of(&self.film);
            let glance = self.first.as_deref().map(|(_, glance)| glance);
            let rmse =
                own.as_ref().map_or(f64::INFINITY, |own| own.error.rmse);
            let glance = glance.filter(|glance| glance.error.rmse < rmse);
            let best = glance.map(|glance| glance.image.clone());
            Ok(best.or(own.map(|own| own.image)))
        };
        let image =
            py.detach(|| on_threads(self.record.plan.threads, filter))?;
        Ok(image.map(|image| {
            let errors = image.errors.into_iter().flatten().map(f64::from);
            [image.means, errors.collect()]
                .map(|list| PyArray1::from_vec(py, list))
        }))
    }

    /// The state of the run.
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let mut bytes = vec![];
        py.detach(|| save(&self.record, &self.film, &mut bytes))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Writes the files that options name.
    fn save(&self, py: Python, words: Vec<String>) -> PyResult<()> {
        let mut outputs = crate::options(words)?.outputs;
        outputs.files.retain(|(_, path)| !is_dash(path));
        py.detach(|| {
            on_threads(self.record.plan.threads, || self.write(&outputs))
        })
    }

    /// What is known about the run.
    fn facts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let convergence = &self.record.report.convergence;
        let facts = PyDict::new(py);
        let sampling = &self.record.run_key.sampling;
        facts.set_item("method", sampling.method.to_string())?;
        facts.set_item(
            "unit",
            match self.film.is_list {
                true => "irradiance (horizontal in the open = 1)",
                false => "radiance (uniform sky = 1)",
            },
        )?;
        let stopped = match convergence.stopped {
            None => "not yet",
            Some(Stop::Samples) => "samples",
            Some(Stop::Time) => "time",
            Some(Stop::Error) => "error",
            Some(Stop::Signal(_)) => "interrupt",
        };
        facts.set_item("stopped", stopped)?;
        facts.set_item("seconds", convergence.seconds)?;
        facts.set_item("constant", convergence.constant_pixels)?;
        Ok(facts)
    }

    /// The samples of each block, and the means of its receivers.
    fn blocks<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)>
    {
        let (mut sizes, mut means, mut before) =
            (vec![], vec![], (0., vec![]));
        for (spp, now) in &self.blocks.0 {
            let (n, m) = (*spp as f64, before.0);
            let mut last = before.1.into_iter();
            let block = now.iter().map(|mean| {
                (n * mean - m * last.next().unwrap_or(0.)) / (n - m)
            });
            means.extend(self.spread(block.collect()));
            sizes.push(n - m);
            before = (n, now.clone());
        }
        let shape = [sizes.len(), means.len() / sizes.len().max(1)];
        let means = PyArray1::from_vec(py, means).reshape(shape)?;
        Ok((PyArray1::from_vec(py, sizes), means))
    }
}

impl Rendering {
    /// Writes the files of a plan.
    fn write(&self, outputs: &Outputs) -> Result<()> {
        let files = outputs.files.iter();
        let files = files.map(|(product, path)| {
            Ok((*product, OutputTarget::file(path, true)?))
        });
        let files = files.collect::<Result<_>>()?;
        let record = self.record.clone();
        let convergence = record.report.convergence.clone();
        let mut output =
            RunOutput::new(files, outputs, record, Some(&self.world));
        output.first = self.first.as_deref().cloned();
        output.write(&convergence, &self.film, None)
    }
}
