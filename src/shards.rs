// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Parts of one run, and how their states are merged.

use std::fmt;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value;

use crate::checkpoint::{Checkpoint, Known};
use crate::film::{Film, Window};
use crate::image::{Image, extension};
use crate::render_loop::{Convergence, Stop};
use crate::report::Report;
use crate::run_key::{Part, RunKey, SAMPLES, TILES};
use crate::run_output::RunOutput;

/// Whether a file of this name is to hold the state of a run.
pub fn is_state_name(path: &Path) -> bool {
    extension(path).as_deref() == Some("litpt")
}

/// Whether a file holds the state of a run, or should.
pub fn is_state(path: &Path) -> bool {
    let mut start = [0; START.len()];
    let mut read = |mut file: File| file.read_exact(&mut start);
    let is_read = path.is_file()
        && File::open(path).is_ok_and(|file| read(file).is_ok());
    is_state_name(path) || (is_read && start == *START)
}

/// The beginning of a state of any version.
const START: &[u8; 16] = b"litpt checkpoint";

/// The state of a part of a run.
struct State {
    /// The name of its file.
    name: String,
    checkpoint: Checkpoint,
    /// The run key without what distinguishes the parts.
    run_key: RunKey,
    /// The samples that its run was asked for, if it is a part.
    spp: Option<u64>,
    /// What it holds when it is whole.
    held: Held,
    /// The number of samples of the whole run.
    of: u64,
    /// The window of the part.
    band: Window,
}

/// Samples of rows of an image; each pair is a beginning and an end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Held {
    rows: (u32, u32),
    samples: (u64, u64),
}

/// As a user reads it.
impl fmt::Display for Held {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let Self { rows: (top, bottom), samples: (from, to) } = self;
        write!(out, "samples {from}..{to} of rows {top}..{bottom}")
    }
}

impl State {
    fn open(path: &Path) -> Result<Self, String> {
        let name = path.display().to_string();
        let checkpoint = Checkpoint::of_file(path)?;
        let mut run_key = checkpoint.known().run_key.clone();
        let spp = checkpoint.convergence().spp;
        let (samples, of, band) = ((0, spp), spp, (1, 1));
        let part = run_key.part.take();
        let spp = part.map(|part| part.of);
        let part = part.unwrap_or(Part { samples, of, band });
        let band = run_key.subject.window().band(part.band);
        let rows = (band.corner.1, band.end().1);
        let (held, of) = (Held { rows, samples: part.samples }, part.of);
        Ok(Self { name, checkpoint, run_key, spp, held, of, band })
    }
}

impl Held {
    /// What two parts have in common.
    fn common(&self, other: &Self) -> Option<Self> {
        let ((a, b), (c, d)) = (self.rows, other.rows);
        let rows = (a.max(c), b.min(d));
        let ((a, b), (c, d)) = (self.samples, other.samples);
        let samples = (a.max(c), b.min(d));
        let some = rows.0 < rows.1 && samples.0 < samples.1;
        some.then_some(Self { rows, samples })
    }
}

/// What the states of parts add up to.
pub struct Merged {
    /// The sums of the whole window.
    pub film: Film,
    /// What the parts have cost; its curve has one point.
    pub convergence: Convergence,
    known: Known,
    /// The samples that no state holds, in words.
    pub missing: Option<String>,
}

/// Adds the states of parts of one run.
///
/// # Errors
/// A file is no state, or is damaged; two of them are not of one run, or
/// hold the same samples.
pub fn merge(files: &[PathBuf]) -> Result<Merged, String> {
    let mut sum: Option<Sum> = None;
    for path in files {
        let state = State::open(path)?;
        sum.get_or_insert_with(|| Sum::begin(&state)).add(state)?;
    }
    Ok(sum.ok_or("there is nothing to merge")?.finish())
}

/// A sum of states so far.
struct Sum {
    /// The name of the first file.
    first: String,
    known: Known,
    film: Film,
    convergence: Convergence,
    spp: Option<u64>,
    of: u64,
    /// What each file should hold.
    parts: Vec<(String, Held)>,
    /// What there is.
    held: Vec<Held>,
}

impl Sum {
    fn begin(state: &State) -> Self {
        let mut known = state.checkpoint.known().clone();
        known.run_key = state.run_key.clone();
        known.report.load_seconds = 0.;
        known.report.build_seconds = 0.;
        Self {
            first: state.name.clone(),
            known,
            film: state.run_key.film(state.run_key.subject.window()),
            convergence: Convergence::default(),
            spp: state.spp,
            of: state.of,
            parts: vec![],
            held: vec![],
        }
    }

    fn add(&mut self, state: State) -> Result<(), String> {
        let State { name, checkpoint, run_key, spp, held, band, .. } =
            state;
        let Self { first, known, .. } = self;
        let asked =
            |n: Option<u64>| n.map_or("nothing".into(), |n| n.to_string());
        let differs = (spp != self.spp).then(|| [self.spp, spp].map(asked));
        let differs = differs.map(|both| ("spp".to_owned(), both));
        let key = known.run_key.disagreement(&run_key);
        if let Some((what, [a, b])) = key.or(differs) {
            return Err(format!(
                "{first} and {name} are not of one run: {what} is {a} and {b}"
            ));
        }
        for (other, theirs) in &self.parts {
            if let Some(both) = theirs.common(&held) {
                return Err(format!("{other} and {name} both hold {both}"));
            }
        }
        self.parts.push((name.clone(), held));
        // Take the sums and the costs of a state
        let key = checkpoint.known().run_key.clone();
        self.known.report.join(&checkpoint.known().report);
        let mut part = run_key.film(band);
        let done = checkpoint
            .resume(&key, &mut part)
            .map_err(|fault| format!("{name}: {fault}"))?;
        self.film.merge(&part);
        self.convergence.rays += done.rays;
        self.convergence.seconds += done.seconds;
        let (from, to) = held.samples;
        let samples = (from, to.min(from + part.samples()));
        self.held.push(Held { samples, ..held });
        Ok(())
    }

    fn finish(self) -> Merged {
        let Self { mut known, film, mut convergence, .. } = self;
        convergence.spp = film.samples();
        convergence.record(&film, None);
        let missing = missing(film.window(), self.of, &self.held);
        let settings = &mut known.report.settings;
        settings.retain(|name, _| name != SAMPLES && name != TILES);
        settings.insert("spp".into(), self.of.into());
        if let Some(missing) = &missing {
            settings.insert("missing".into(), missing.as_str().into());
        }
        let Report { scene, settings, left_out, .. } = known.report;
        let Report { load_seconds, build_seconds, .. } = known.report;
        known.report = Report {
            scene,
            settings,
            left_out,
            load_seconds,
            build_seconds,
            ..Report::begin("ptimg")
        };
        Merged { film, convergence, known, missing }
    }
}

impl Report {
    /// Takes the settings and the costs of another part into account.
    fn join(&mut self, other: &Self) {
        self.load_seconds += other.load_seconds;
        self.build_seconds += other.build_seconds;
        for (name, value) in &mut self.settings {
            if other.settings.get(name) != Some(value) {
                *value = Value::Null;
            }
        }
    }
}

impl Merged {
    /// The image of the run, and its report.
    pub fn image_and_report(self) -> (Image, Report) {
        let Self { film, convergence, known, missing } = self;
        let stop = missing.is_none().then_some(Stop::Samples);
        let output = RunOutput::new(vec![], None, Duration::MAX, known);
        let image = output.picture(&convergence, &film, stop).image();
        (image, output.report(&convergence, &film, stop))
    }
}

/// The samples of a run that are not held, in words; none if all are.
fn missing(window: Window, of: u64, held: &[Held]) -> Option<String> {
    let mut gaps: Vec<Held> = vec![];
    let ends = [window.corner.1, window.end().1];
    let edges = held.iter().flat_map(|part| [part.rows.0, part.rows.1]);
    let mut edges: Vec<u32> = edges.chain(ends).collect();
    edges.sort();
    edges.dedup();
    for strip in edges.windows(2) {
        let rows = (strip[0], strip[1]);
        // Find the gaps of a strip
        let here =
            |part: &&Held| part.rows.0 <= rows.0 && rows.1 <= part.rows.1;
        let parts = held.iter().filter(here);
        let mut ranges: Vec<_> = parts.map(|part| part.samples).collect();
        ranges.sort();
        let mut end = 0;
        for (from, to) in ranges.into_iter().chain([(of, of)]) {
            if from > end {
                // Note a gap or lengthen the one above
                let samples = (end, from);
                let above = |gap: &&mut Held| {
                    gap.samples == samples && gap.rows.1 == rows.0
                };
                match gaps.iter_mut().find(above) {
                    Some(gap) => gap.rows.1 = rows.1,
                    None => gaps.push(Held { rows, samples }),
                }
            }
            end = end.max(to);
        }
    }
    let gaps: Vec<_> = gaps.iter().map(Held::to_string).collect();
    (!gaps.is_empty()).then(|| gaps.join("; "))
}
