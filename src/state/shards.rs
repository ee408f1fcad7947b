// Tangled from chapters/shards.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Shards, which are parts of one run, and how their states are merged.

use std::fmt;
use std::io::{BufRead, Seek};
use std::path::Path;

use crate::error::{Error, Result};
use crate::film::{Film, Window};
use crate::image::extension;
use crate::integrator::gather::Learnt;
use crate::key::Part;
use crate::render_loop::{Convergence, Limits, Stop};
use crate::state::checkpoint::{Checkpoint, RunRecord};

/// Whether the state of a run is written to a file of this name.
pub fn is_state_name(path: &Path) -> bool {
    extension(path).as_deref() == Some("litpt")
}

/// Adds to a fault in the name of an output that a state can be written, too.
pub fn or_state(fault: Error) -> Error {
    Error::from(format!("{fault}, or .litpt for the state of the run"))
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

impl Held {
    /// The samples that two parts have in common.
    fn common(&self, other: &Self) -> Option<Self> {
        let ((a, b), (c, d)) = (self.rows, other.rows);
        let rows = (a.max(c), b.min(d));
        let ((a, b), (c, d)) = (self.samples, other.samples);
        let samples = (a.max(c), b.min(d));
        let some = rows.0 < rows.1 && samples.0 < samples.1;
        some.then_some(Self { rows, samples })
    }
}

/// The sum of the states of parts.
pub struct Merged {
    /// The record of the whole run; its curve has one point.
    pub record: RunRecord,
    /// The sums of the whole window.
    pub film: Film,
    /// The samples that no state holds, in words.
    pub missing: Option<String>,
}

/// Adds the states of parts of one run, which have different names.
///
/// # Errors
/// One cannot be read; two of them are not of one run, have not learnt the
/// same, or hold the same samples.
pub fn merge<R: BufRead + Seek>(
    states: impl IntoIterator<Item = Result<Checkpoint<R>>>,
) -> Result<Merged> {
    let mut sum: Option<Merged> = None;
    let mut held: Vec<(String, [Held; 2])> = vec![];
    let mut total = Convergence::default();
    for state in states {
        let mut state = state?;
        let name = state.name.clone();
        let first = held.first().map_or(&name, |(first, _)| first);
        let mut film = state.record.run_key.film();
        let part = state.record.run_key.part;
        state.record.run_key.part = part.map(Part::whole);
        let RunRecord { run_key, report, learnt, .. } =
            state.record.clone();
        let merged = sum.get_or_insert_with(|| {
            let (film, record) = (run_key.film(), state.record.clone());
            Merged { film, record, missing: None }
        });
        // Refuse a state of another run
        let differs = merged.record.run_key.disagreement(&run_key);
        if let Some((what, [a, b])) = differs {
            return Err(format!(
                "{first} and {name} are not of one run: {what} is {a} and {b}"
            )
            .into());
        }
        let both = (merged.record.learnt.get(), learnt.get());
        let differ = |ours: &Learnt, own: &Learnt| {
            ours.cache != own.cache || ours.allocation != own.allocation
        };
        if matches!(both, (Some(ours), Some(own)) if differ(ours, own)) {
            return Err(format!(
                "{first} and {name} have not learnt the same"
            )
            .into());
        }
        if both.0.is_none() {
            merged.record.learnt = learnt;
        }
        // Refuse samples that another state holds
        let spp = report.convergence.spp;
        let samples = part.map_or((0, spp), |part| part.samples);
        let rows = (film.window.corner.1, film.window.end().1);
        let whole = Held { rows, samples };
        for (other, [theirs, _]) in &held {
            if let Some(both) = theirs.common(&whole) {
                return Err(
                    format!("{other} and {name} both hold {both}").into()
                );
            }
        }
        // Add the sums and the costs of a state
        let filled = state.fill(&mut film);
        filled.map_err(|fault| fault.of_file(&name))?;
        merged.film.merge(&film);
        total.rays += report.convergence.rays;
        total.seconds += report.convergence.seconds;
        if !held.is_empty() {
            merged.record.report.add(&report);
        }
        let (from, to) = samples;
        let samples = (from, to.min(from + film.samples()));
        held.push((name, [whole, Held { samples, ..whole }]));
    }
    // Complete the merged run
    let mut merged = sum.ok_or("there is nothing to merge")?;
    let Merged { record, film, .. } = &mut merged;
    total.spp = film.samples();
    total.record(film, &Limits::default());
    let held: Vec<_> = held.iter().map(|(_, [_, there])| *there).collect();
    let of = record.run_key.part.take().map_or(total.spp, |part| part.of);
    let missing = missing(film.window, of, &held);
    // Describe the whole run
    total.stopped = missing.is_none().then_some(Stop::Samples);
    let settings = &mut record.report.settings;
    (settings.part, settings.spp) = (None, Some(of));
    settings.missing.clone_from(&missing);
    record.report.convergence = total;
    record.report.sign("ptimg");
    record.run_key.filtered = !film.halves.is_empty();
    record.plan.part = None;
    record.plan.outputs.files.clear();
    merged.missing = missing;
    Ok(merged)
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
                // Add a gap or lengthen the one above
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
