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
#[derive(Default)]
pub struct Targets {
    pub images: Vec<ImageTarget>,
    pub reports: Vec<(Kind, OutputTarget)>,
    pub checkpoint: Option<OutputTarget>,
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
    report: Report,
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
    pub fn after(
        &mut self,
        convergence: &Convergence,
        film: &Film,
    ) -> Result<(), String> {
        let now = Instant::now();
        let mut written = Ok(());
        // Write the reports if they are due
        let last = convergence.steps.last();
        let recorded =
            last.is_some_and(|point| point.spp == convergence.spp);
        let due = recorded || convergence.seconds > 1.1 * self.reported;
        if due && now >= self.next_report {
            written = self.write_reports(convergence, film, None);
            self.reported = convergence.seconds;
            self.next_report = Instant::now() + 100 * now.elapsed();
        }
        // Write the checkpoint if it is due
        if self.next_checkpoint.is_some_and(|time| now >= time) {
            let saved = self.write_checkpoint(convergence, film, None);
            written = written.and(saved);
            self.next_checkpoint = Instant::now().checked_add(self.every);
        }
        // Show the image so far
        let began = Instant::now();
        if self.next_preview.is_some_and(|time| began >= time) {
            let image = Picture::new(film, BTreeMap::new());
            let images = self.targets.images.iter_mut();
            for target in images.filter(|t| t.format() == Format::Png) {
                written = written.and(target.rewrite(&image));
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
    pub fn close(
        &mut self,
        convergence: &Convergence,
        film: &Film,
        stop: Stop,
    ) -> Result<(), String> {
        let stop = Some(stop);
        let image = self.picture(convergence, film, stop);
        let targets = self.targets.images.iter();
        let mut written: Vec<_> =
            targets.map(|target| target.write(&image)).collect();
        written.push(self.write_checkpoint(convergence, film, stop));
        written.push(self.write_reports(convergence, film, stop));
        let failures = written.into_iter().filter_map(Result::err);
        let failures: Vec<_> = failures.collect();
        match failures.is_empty() {
            true => Ok(()),
            false => Err(failures.join("; ")),
        }
    }

    /// A guess of the seconds that [`RunOutput::close`] takes for so many
    /// pixels, if none of them has a sample and if all have.
    pub fn seconds(&self, pixels: u64) -> [f64; 2] {
        let Targets { images, reports, checkpoint } = &self.targets;
        let images = images.iter().map(|image| match image.format() {
            Format::Pgm => PGM,
            Format::Png => PNG,
            Format::Pfm => PFM,
            Format::Exr => EXR,
        });
        let pages = reports.iter().filter(|(kind, _)| *kind == Kind::Html);
        let pages = pages.map(|_| PAGE);
        let saved = if checkpoint.is_some() { STATE } else { 0. };
        let all = saved + SUMMARY + images.chain(pages).sum::<f64>();
        [saved, all].map(|nanoseconds| 1e-9 * nanoseconds * pixels as f64)
    }

    fn write_reports(
        &mut self,
        convergence: &Convergence,
        film: &Film,
        stop: Option<Stop>,
    ) -> Result<(), String> {
        if self.targets.reports.is_empty() {
            return Ok(());
        }
        let report = self.report(convergence, film, stop);
        let image = || self.picture(convergence, film, stop).image();
        let text = |(kind, _): &(Kind, _)| kind.render(&report, &image);
        let texts: Vec<_> = self.targets.reports.iter().map(text).collect();
        let mut written = Ok(());
        for ((_, target), text) in
            self.targets.reports.iter_mut().zip(texts)
        {
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
        let Self { targets, known, .. } = self;
        let Some(target) = &mut targets.checkpoint else { return Ok(()) };
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
        let last = now.steps.last();
        Report {
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
            ..self.report.clone()
        }
    }

    /// The image on the film, with all that is known about it.
    pub fn picture<'f>(
        &self,
        convergence: &Convergence,
        film: &'f Film,
        stop: Option<Stop>,
    ) -> Picture<'f> {
        let Report { scene, settings, .. } = &self.report;
        let known = json!({
            "scene": scene.file,
            "spp": convergence.spp,
            "rays": convergence.rays,
            "load_seconds": self.report.load_seconds,
            "build_seconds": self.report.build_seconds,
            "render_seconds": convergence.seconds,
            "stopped": stop.map_or("not yet", Stop::name),
        });
        let mut all = settings.clone();
        all.retain(|_, value| !value.is_null());
        all.extend(entries(&self.known.run_key));
        all.extend(entries(&known));
        Picture::new(film, attributes(&all))
    }
}

/// Nanoseconds for a pixel: of the summary, of a checkpoint, of images, and
/// of a page with one.
const SUMMARY: f64 = 130.;
const STATE: f64 = 70.;
const PGM: f64 = 120.;
const PNG: f64 = 200.;
const PFM: f64 = 50.;
const EXR: f64 = 420.;
const PAGE: f64 = 350.;

/// The image and the report of a merged run.
pub fn conclude(merged: Merged) -> (Image, Report) {
    let Merged { run_key, film, convergence, reports, missing, .. } =
        merged;
    let parts = reports.iter().map(Report::deserialize);
    let mut parts = parts.map(Result::unwrap_or_default);
    let first = parts.next().unwrap_or_default();
    let Report { scene, left_out, mut settings, .. } = first;
    let Report { mut load_seconds, mut build_seconds, .. } = first;
    for part in parts {
        load_seconds += part.load_seconds;
        build_seconds += part.build_seconds;
        for (name, value) in &mut settings {
            if part.settings.get(name) != Some(value) {
                *value = Value::Null;
            }
        }
    }
    // Describe the whole run
    settings.remove("part");
    let asked = merged.spp.unwrap_or(convergence.spp);
    settings.insert("spp".into(), asked.into());
    settings.extend(missing.clone().map(|m| ("missing".into(), m.into())));
    let report = Report {
        scene,
        settings,
        left_out,
        load_seconds,
        build_seconds,
        ..Report::begin("ptimg")
    };
    let stop = missing.is_none().then_some(Stop::Samples);
    let known = (run_key, Value::Null);
    let output =
        RunOutput::new(Targets::default(), (0., false), known, report);
    let image = output.picture(&convergence, &film, stop).image();
    (image, output.report(&convergence, &film, stop))
}
