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
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::on_threads;

/// The values of a run.
#[pyclass(frozen, module = "litpt._core")]
pub struct Rendering {
    /// The scene and its sensor.
    pub world: Arc<World>,
    /// The record of the run.
    pub record: RunRecord,
    /// The samples.
    pub film: Film,
    /// A glance, if there was one.
    pub first: Option<Arc<(Film, Filtered)>>,
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
pub type Numbers<'py> = Bound<'py, PyArray1<f64>>;

impl Rendering {
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
        if record.run_key.scene_sha256 != world.report.scene.sha256 {
            return Err("the scene is no longer that of the result".into());
        }
        if record.run_key.filtered {
            let windows = (film.window, film.run_window);
            let (bvh, view) = (&world.geometry.bvh, world.view());
            film.fragments = Some(fragments(bvh, &view, windows).into());
        }
        let (world, first, blocks) =
            (world.into(), None, Blocks::default());
        Ok(Self { world, record, film, first, blocks })
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
        let errors = film.errors(NEIGHBOUR_WEIGHT, window);
        let counts = film.counts_of(window, self.record.allocation());
        [film.means_of(window), errors, counts]
            .map(|list| self.spread(list))
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
            let errors = image.errors.into_iter().flatten();
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

    /// The method, why the run has ended, its seconds, and how many saw one
    /// value only.
    fn facts(&self) -> (String, &str, f64, u64) {
        let convergence = &self.record.report.convergence;
        let method = self.record.run_key.sampling.method.to_string();
        let stopped = match self.stop() {
            None => "not yet",
            Some(Stop::Samples) => "samples",
            Some(Stop::Time) => "time",
            Some(Stop::Error) => "error",
            Some(Stop::Signal(_)) => "interrupt",
        };
        let constant = convergence.constant_pixels;
        (method, stopped, convergence.seconds, constant)
    }

    /// Numbers of samples, and the means of receivers after so many.
    fn blocks<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Numbers<'py>, Bound<'py, PyArray2<f64>>)> {
        let blocks = self.blocks.0.iter();
        let counts = blocks.clone().map(|(spp, _)| *spp as f64);
        let rows = blocks.map(|(_, means)| self.spread(means.clone()));
        let rows: Vec<_> = rows.collect();
        let means = PyArray2::from_vec2(py, &rows)?;
        Ok((PyArray1::from_iter(py, counts), means))
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
