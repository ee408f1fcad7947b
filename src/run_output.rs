// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Reports and checkpoints, kept up to date while a run goes on.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::io::{self, Write};
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};

use crate::checkpoint::{Known, save};
use crate::film::Film;
use crate::image::Picture;
use crate::output::{Content, OutputTarget};
use crate::render_loop::{Convergence, Stop};
use crate::report::{Kind, Report, as_typed};
use crate::run_key::entries;

/// The files that a run keeps up to date.
pub struct RunOutput {
    /// The reports and their targets.
    reports: Vec<(Kind, OutputTarget)>,
    /// When the next report may be written.
    next_report: Instant,
    /// The seconds of the run when the last one was written.
    reported: f64,
    /// Where the checkpoint goes.
    checkpoint: Option<OutputTarget>,
    /// Time between two checkpoints.
    every: Duration,
    /// When the next checkpoint is due; never, if beyond the clock.
    next_checkpoint: Option<Instant>,
    known: Known,
}

/// Writes a file for the last time, or for the time being.
fn put(
    target: &mut OutputTarget,
    stop: Option<Stop>,
    content: &mut Content,
) -> Result<(), String> {
    match stop {
        Some(_) => target.write(content),
        None => target.rewrite(content),
    }
}

/// The names and values of a run as the attributes of its image.
pub fn attributes(known: &Map<String, Value>) -> BTreeMap<String, String> {
    let text =
        |(name, value): (&String, _)| (name.clone(), as_typed(value));
    known.iter().map(text).collect()
}

impl RunOutput {
    /// The files of a run that is about to begin.
    pub fn new(
        reports: Vec<(Kind, OutputTarget)>,
        checkpoint: Option<OutputTarget>,
        every: Duration,
        known: Known,
    ) -> Self {
        let next_report = Instant::now();
        let next_checkpoint = next_report.checked_add(every);
        // Begin with nothing written
        Self {
            reports,
            next_report,
            reported: 0.,
            checkpoint,
            every,
            next_checkpoint,
            known,
        }
    }

    /// Writes what is due when a pass has ended.
    ///
    /// # Errors
    /// A file cannot be written, which is worth a warning: it will be tried
    /// again.
    pub fn after(
        &mut self,
        convergence: &Convergence,
        film: &Film,
    ) -> Result<(), String> {
        let now = Instant::now();
        let (mut reported, mut saved) = (Ok(()), Ok(()));
        // Write the reports if they are due
        let last = convergence.steps.last();
        let recorded =
            last.is_some_and(|point| point.spp == convergence.spp);
        let due = recorded || convergence.seconds > 1.1 * self.reported;
        if due && now >= self.next_report && !self.reports.is_empty() {
            reported = self.write_reports(convergence, film, None);
            self.reported = convergence.seconds;
            self.next_report = Instant::now() + 100 * now.elapsed();
        }
        // Write the checkpoint if it is due
        if self.next_checkpoint.is_some_and(|time| now >= time) {
            saved = self.write_checkpoint(convergence, film, None);
            self.next_checkpoint = Instant::now().checked_add(self.every);
        }
        reported.and(saved)
    }

    /// Writes all files when the run has stopped.
    ///
    /// # Errors
    /// A file cannot be written; the others are.
    pub fn close(
        &mut self,
        convergence: &Convergence,
        film: &Film,
        stop: Stop,
    ) -> Result<(), String> {
        let stop = Some(stop);
        let saved = self.write_checkpoint(convergence, film, stop);
        self.write_reports(convergence, film, stop).and(saved)
    }

    /// Takes the time that [`RunOutput::close`] will take, and writes nothing;
    /// returns the image.
    pub fn rehearse<'f>(
        &self,
        convergence: &Convergence,
        film: &'f Film,
    ) -> Picture<'f> {
        let report = self.report(convergence, film, None);
        for (kind, _) in &self.reports {
            let image = || self.picture(convergence, film, None).image();
            black_box(kind.render(&report, &image));
        }
        if self.checkpoint.is_some() {
            let _ = save(&self.known, convergence, film, &mut io::sink());
        }
        self.picture(convergence, film, None)
    }

    fn write_reports(
        &mut self,
        convergence: &Convergence,
        film: &Film,
        stop: Option<Stop>,
    ) -> Result<(), String> {
        let report = self.report(convergence, film, stop);
        let image = || self.picture(convergence, film, stop).image();
        let text = |(kind, _): &(Kind, _)| kind.render(&report, &image);
        let texts: Vec<_> = self.reports.iter().map(text).collect();
        let mut written = Ok(());
        for ((_, target), text) in self.reports.iter_mut().zip(texts) {
            let mut content =
                |out: &mut dyn Write| out.write_all(text.as_bytes());
            written = written.and(put(target, stop, &mut content));
        }
        written
    }

    fn write_checkpoint(
        &mut self,
        convergence: &Convergence,
        film: &Film,
        stop: Option<Stop>,
    ) -> Result<(), String> {
        let Self { checkpoint, known, .. } = self;
        let Some(target) = checkpoint else { return Ok(()) };
        put(target, stop, &mut |out| save(known, convergence, film, out))
    }

    /// The report of the run so far.
    pub fn report(
        &self,
        convergence: &Convergence,
        film: &Film,
        stop: Option<Stop>,
    ) -> Report {
        let mut now = convergence.clone();
        now.record(film, None);
        let mut report = self.known.report.clone();
        report.render_seconds = now.seconds;
        report.rays = now.rays;
        report.stopped = stop.map(|stop| stop.name().to_owned());
        report.spp = now.spp;
        report.constant_pixels = now.constant;
        report.unsampled_pixels = film.unsampled();
        report.ranks = now.ranks.clone();
        // Fill in what the last point knows
        if let Some(last) = now.steps.last() {
            report.mean = last.mean;
            report.mean_stderr = last.mean_stderr;
            report.rmse = last.rmse;
        }
        report.curve = now.steps;
        report
    }

    /// The image on the film, with all that is known about it.
    pub fn picture<'f>(
        &self,
        convergence: &Convergence,
        film: &'f Film,
        stop: Option<Stop>,
    ) -> Picture<'f> {
        let Known { report, run_key, .. } = &self.known;
        let known = json!({
            // List what is known about a run
            "scene": report.scene.file,
            "spp": convergence.spp,
            "rays": convergence.rays,
            "load_seconds": report.load_seconds,
            "build_seconds": report.build_seconds,
            "render_seconds": convergence.seconds,
            "stopped": stop.map_or("not yet", Stop::name),
        });
        let known = known.as_object().into_iter().flatten();
        let settings = report.settings.iter().filter(|(_, v)| !v.is_null());
        let run_key = entries(run_key);
        let all = settings.chain(&run_key).chain(known);
        let all = all.map(|(name, value)| (name.clone(), value.clone()));
        Picture::new(film, attributes(&all.collect()))
    }
}
