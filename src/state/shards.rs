// Tangled from chapters/shards.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Parts of one run, and how their states are merged.

use std::fmt;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::film::{Film, Window};
use crate::image::extension;
use crate::render_loop::Convergence;
use crate::state::checkpoint::{Checkpoint, Known};
use crate::state::key::RunKey;

/// Whether a file of this name is to hold the state of a run.
pub fn is_state_name(path: &Path) -> bool {
    extension(path).as_deref() == Some("litpt")
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
    /// What decides the samples of the whole run.
    pub run_key: RunKey,
    /// The number of samples of the whole run, if a part tells it.
    pub spp: Option<u64>,
    /// The sums of the whole window.
    pub film: Film,
    /// What the parts have cost; its curve has one point.
    pub convergence: Convergence,
    /// What the reports of the parts say.
    pub reports: Vec<Value>,
    /// The samples that no state holds, in words.
    pub missing: Option<String>,
}

/// Adds the states of parts of one run.
///
/// # Errors
/// A file is no state, or is damaged; two of them are not of one run, or
/// hold the same samples.
pub fn merge(files: &[PathBuf]) -> Result<Merged, String> {
    let mut sum: Option<Merged> = None;
    let mut held: Vec<(&Path, [Held; 2])> = vec![];
    for path in files {
        let mut state = Checkpoint::of_file(path)?;
        let Known { mut run_key, report, .. } = state.known.clone();
        let mut film = run_key.film();
        let part = run_key.part.take();
        let merged = sum.get_or_insert_with(|| Merged {
            film: run_key.film(),
            run_key: run_key.clone(),
            spp: part.map(|part| part.of),
            convergence: Convergence::default(),
            reports: vec![],
            missing: None,
        });
        // Refuse a state of another run
        let key = merged.run_key.disagreement(&run_key);
        let asked = [merged.spp, part.map(|part| part.of)];
        let differs = (asked[0] != asked[1]).then(|| {
            let words = asked
                .map(|n| n.map_or("nothing".to_owned(), |n| n.to_string()));
            ("spp".to_owned(), words)
        });
        if let Some((what, [a, b])) = key.or(differs) {
            let (first, name) = (files[0].display(), path.display());
            return Err(format!(
                "{first} and {name} are not of one run: {what} is {a} and {b}"
            ));
        }
        // Refuse samples that another state holds
        let spp = state.convergence.spp;
        let samples = part.map_or((0, spp), |part| part.samples);
        let rows = (film.window.corner.1, film.window.end().1);
        let whole = Held { rows, samples };
        for (other, [theirs, _]) in &held {
            if let Some(both) = theirs.common(&whole) {
                let (other, name) = (other.display(), path.display());
                return Err(format!("{other} and {name} both hold {both}"));
            }
        }
        // Take the sums and the costs of a state
        state
            .fill(&mut film)
            .map_err(|fault| format!("{}: {fault}", path.display()))?;
        merged.film.merge(&film);
        merged.convergence.rays += state.convergence.rays;
        merged.convergence.seconds += state.convergence.seconds;
        merged.reports.push(report);
        let (from, to) = samples;
        let samples = (from, to.min(from + film.samples()));
        held.push((path, [whole, Held { samples, ..whole }]));
    }
    // Say what the sum has and what it lacks
    let mut merged = sum.ok_or("there is nothing to merge")?;
    merged.convergence.spp = merged.film.samples();
    merged.convergence.record(&merged.film, None);
    let held: Vec<_> = held.iter().map(|(_, [_, there])| *there).collect();
    let of = merged.spp.unwrap_or(merged.convergence.spp);
    merged.missing = missing(merged.film.window, of, &held);
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
