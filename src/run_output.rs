// Tangled from chapters/run_output.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The files of a run, kept up to date while it goes on.

use std::collections::BTreeMap;
use std::io::Write;
use std::time::{Duration, Instant};

use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::film::Film;
use crate::image::{Format, Image, Picture};
use crate::output::{Content, ImageTarget, OutputTarget};
use crate::render_loop::{Convergence, Stop};
use crate::report::{Kind, Report, as_typed};
use crate::state::checkpoint::{Known, save};
use crate::state::key::{RunKey, entries};
use crate::state::shards::Merged;

/// Where the files of a run go.
pub struct Targets {
    /// Images; a PNG may show previews.
    pub images: Vec<ImageTarget>,
    /// Reports of each kind.
    pub reports: Vec<(Kind, OutputTarget)>,
    /// The state of the run.
    pub checkpoint: Option<OutputTarget>,
}

/// A run as it stands.
#[derive(Clone, Copy)]
pub struct Snapshot<'a> {
    /// What has been done.
    pub convergence: &'a Convergence,
    /// The sums.
    pub film: &'a Film,
    /// Why the run has ended; none while it goes on.
    pub stop: Option<Stop>,
}

/// The files of a run, and what is known of it beforehand.
pub struct RunOutput {
    targets: Targets,
    /// When the next report may be written.
    next_report: Instant,
    /// The seconds of the run when the last one was written.
    reported: f64,
    /// Time between two checkpoints.
    every: Duration,
    /// When the next checkpoint is due; never, if beyond the clock.
    next_checkpoint: Option<Instant>,
    /// When the next preview is due, if there is one.
    next_preview: Option<Instant>,
    known: Known,
    /// The report of the run before its first sample.
    pub report: Report,
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

const SECOND: Duration = Duration::from_secs(1);

/// The names and values of a run as the attributes of its image.
pub fn attributes(known: &Map<String, Value>) -> BTreeMap<String, String> {
    let text =
        |(name, value): (&String, _)| (name.clone(), as_typed(value));
    known.iter().map(text).collect()
}

impl RunOutput {
    /// The files of a run that is about to begin, with a checkpoint each so
    /// many seconds, and previews if they are wanted.
    pub fn new(
        targets: Targets,
        (every, preview): (f64, bool),
        (run_key, options): (RunKey, Value),
        report: Report,
    ) -> Self {
        let now = Instant::now();
        let every =
            Duration::try_from_secs_f64(every).unwrap_or(Duration::MAX);
        let value = serde_json::to_value(&report).unwrap_or_default();
        Self {
            targets,
            next_report: now,
            reported: 0.,
            every,
            next_checkpoint: now.checked_add(every),
            next_preview: preview.then_some(now),
            known: Known { run_key, options, report: value },
            report,
        }
    }

    /// Writes what is due when a pass has ended.
    ///
    /// # Errors
    /// A file cannot be written, which is worth a warning: it will be tried
    /// again.
    pub fn after(&mut self, snapshot: Snapshot) -> Result<(), String> {
        let Snapshot { convergence, film, .. } = snapshot;
        let now = Instant::now();
        let mut written = Ok(());
        // Write the reports if they are due
        let last = convergence.steps.last();
        let recorded =
            last.is_some_and(|point| point.spp == convergence.spp);
        let due = recorded || convergence.seconds > 1.1 * self.reported;
        if due && now >= self.next_report {
            written = self.write_reports(snapshot);
            self.reported = convergence.seconds;
            self.next_report = Instant::now() + 100 * now.elapsed();
        }
        // Write the checkpoint if it is due
        if self.next_checkpoint.is_some_and(|time| now >= time) {
            let saved = self.write_checkpoint(snapshot);
            written = written.and(saved);
            self.next_checkpoint = Instant::now().checked_add(self.every);
        }
        // Show the image so far
        let began = Instant::now();
        if self.next_preview.is_some_and(|time| began >= time) {
            let image = Picture { film, attributes: BTreeMap::new() };
            let images = self.targets.images.iter_mut();
            for png in images.filter(|image| image.format == Format::Png) {
                let content = &mut |out: &mut dyn Write| {
                    Format::Png.write(&image, out)
                };
                written = written.and(png.target.rewrite(content));
            }
            let pause = (10 * began.elapsed()).max(SECOND);
            self.next_preview = Some(Instant::now() + pause);
        }
        written
    }

    /// Writes all files when the run has stopped.
    ///
    /// # Errors
    /// Files cannot be written; the others are.
    pub fn close(&mut self, snapshot: Snapshot) -> Result<(), String> {
        let Self { targets, known, report, .. } = &*self;
        let image = picture(report, &known.run_key, snapshot);
        let images = targets.images.iter().map(|to| to.write(&image));
        let mut failures: Vec<_> = images.filter_map(Result::err).collect();
        let state = self.write_checkpoint(snapshot);
        let rest = [state, self.write_reports(snapshot)];
        failures.extend(rest.into_iter().filter_map(Result::err));
        match failures.is_empty() {
            true => Ok(()),
            false => Err(failures.join("; ")),
        }
    }

    /// A guess of the seconds that [`RunOutput::close`] takes for so many
    /// pixels, if none of them has a sample and if all have.
    pub fn seconds(&self, pixels: u64) -> [f64; 2] {
        let Targets { images, reports, checkpoint } = &self.targets;
        // Nanoseconds for a pixel, measured with a half more.
        let images = images.iter().map(|image| match image.format {
            Format::Pgm => 120.,
            Format::Png => 200.,
            Format::Pfm => 50.,
            Format::Exr => 420.,
        });
        let pages = reports.iter().filter(|(kind, _)| *kind == Kind::Html);
        let pages = pages.map(|_| 350.);
        let saved = if checkpoint.is_some() { 70. } else { 0. };
        let summary = 130.;
        let files = images.chain(pages).sum::<f64>();
        let (none, all) = (saved + 0.15 * files, saved + summary + files);
        [none, all].map(|nanoseconds| 1e-9 * nanoseconds * pixels as f64)
    }

    fn write_reports(&mut self, snapshot: Snapshot) -> Result<(), String> {
        let Self { targets, known, report, .. } = self;
        if targets.reports.is_empty() {
            return Ok(());
        }
        let now = report.complete(snapshot);
        let image = || picture(report, &known.run_key, snapshot).image();
        let mut written = Ok(());
        for (kind, target) in &mut targets.reports {
            let text = kind.render(&now, &image);
            let content = &mut |out: &mut dyn Write| write!(out, "{text}");
            written = written.and(put(target, snapshot.stop, content));
        }
        written
    }

    fn write_checkpoint(
        &mut self,
        snapshot: Snapshot,
    ) -> Result<(), String> {
        let Snapshot { convergence, film, stop } = snapshot;
        let Self { targets, known, .. } = self;
        let Some(target) = &mut targets.checkpoint else { return Ok(()) };
        put(target, stop, &mut |out| save(known, convergence, film, out))
    }
}

impl Report {
    /// The report of the run so far, given that from before its first
    /// sample.
    pub fn complete(&self, snapshot: Snapshot) -> Self {
        let Snapshot { convergence, film, stop } = snapshot;
        let mut now = convergence.clone();
        now.record(film, None);
        let last = now.steps.last();
        Self {
            render_seconds: now.seconds,
            rays: now.rays,
            stopped: stop.map(|stop| stop.name().to_owned()),
            spp: now.spp,
            constant_pixels: now.constant,
            unsampled_pixels: film.unsampled(),
            mean: last.map_or(0., |last| last.mean),
            mean_stderr: last.and_then(|last| last.mean_stderr),
            rmse: last.and_then(|last| last.rmse),
            ranks: now.ranks,
            curve: now.steps,
            ..self.clone()
        }
    }
}

/// The image on the film, with all that is known about it.
fn picture<'f>(
    report: &Report,
    run_key: &RunKey,
    Snapshot { convergence, film, stop }: Snapshot<'f>,
) -> Picture<'f> {
    let known = json!({
        "scene": report.scene.file,
        "spp": convergence.spp,
        "rays": convergence.rays,
        "load_seconds": report.load_seconds,
        "build_seconds": report.build_seconds,
        "render_seconds": convergence.seconds,
        "stopped": stop.map_or("not yet", Stop::name),
    });
    let mut all = report.settings.clone();
    all.retain(|_, value| !value.is_null());
    all.extend(entries(run_key));
    all.extend(entries(&known));
    Picture { film, attributes: attributes(&all) }
}

/// The image and the report of a merged run.
pub fn conclude(merged: Merged) -> (Image, Report) {
    let Merged { run_key, film, convergence, reports, missing, spp } =
        merged;
    let parts = reports.iter().map(Report::deserialize);
    let mut parts = parts.map(Result::unwrap_or_default);
    let Report { program, command, date, processor, .. } =
        Report::begin("ptimg");
    let first = parts.next().unwrap_or_default();
    let mut whole = Report { program, command, date, processor, ..first };
    for part in parts {
        whole.load_seconds += part.load_seconds;
        whole.build_seconds += part.build_seconds;
        for (name, value) in &mut whole.settings {
            if part.settings.get(name) != Some(value) {
                *value = Value::Null;
            }
        }
    }
    // Describe the whole run
    let settings = &mut whole.settings;
    settings.remove("part");
    settings.insert("spp".into(), spp.unwrap_or(convergence.spp).into());
    settings.extend(missing.clone().map(|m| ("missing".into(), m.into())));
    let stop = missing.is_none().then_some(Stop::Samples);
    let (convergence, film) = (&convergence, &film);
    let snapshot = Snapshot { convergence, film, stop };
    let image = picture(&whole, &run_key, snapshot).image();
    (image, whole.complete(snapshot))
}
