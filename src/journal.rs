// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Reports and checkpoints, kept up to date while a run goes on.

// Name what the journal imports
use std::hint::black_box;
use std::io;
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::checkpoint::{self, Subject};
use crate::course::{Course, Stop};
use crate::image::Image;
use crate::output::{Content, Place};
use crate::picture::Picture;
use crate::report::{Kind, Report};

// Hold what the files need
/// The files that a run keeps up to date.
pub struct Journal {
    // Hold the state of the reports
    /// The reports and their places.
    reports: Vec<(Kind, Place)>,
    /// When the next report may be written.
    next_report: Instant,
    /// The seconds of the run when the last one was written.
    reported: f64,
    // Hold the state of the checkpoint
    /// The place of the checkpoint.
    checkpoint: Option<Place>,
    /// Time between two checkpoints.
    every: Duration,
    /// When the next checkpoint is due; never, if beyond the clock.
    next_checkpoint: Option<Instant>,
    /// What decides the weights.
    subject: Subject,
    /// What a report says that does not change while the run goes on.
    facts: Report,
}

/// Writes a file for the last time, or for the time being.
fn put(
    place: &mut Place,
    stop: Option<Stop>,
    content: &mut Content,
) -> Result<(), String> {
    match stop {
        Some(_) => place.write(content),
        None => place.rewrite(content),
    }
}

// Show a value as text
/// A value as text; a vector or a size as it is typed.
fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(parts) => {
            let numbers = parts.iter().all(Value::is_number);
            let size = numbers && parts.len() == 2;
            let sign = if size { "x" } else { "," };
            let parts: Vec<String> = parts.iter().map(text).collect();
            parts.join(sign)
        }
        other => other.to_string(),
    }
}

impl Journal {
    // Open a journal for a run
    /// A journal with its files, of a run that is about to begin.
    pub fn new(
        reports: Vec<(Kind, Place)>,
        checkpoint: Option<Place>,
        every: Duration,
        subject: Subject,
        facts: Report,
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
            subject,
            facts,
        }
    }

    // Write what is due after a pass
    /// Writes what is due when a pass has ended.
    ///
    /// # Errors
    /// A file cannot be written, which is worth a warning: it will be tried
    /// again.
    pub fn after(
        &mut self,
        course: &Course,
        image: &Image,
    ) -> Result<(), String> {
        let now = Instant::now();
        let (mut reported, mut saved) = (Ok(()), Ok(()));
        // Write the reports if they are due
        let last = course.steps.last();
        let recorded = last.is_some_and(|step| step.spp == course.spp);
        let due = recorded || course.seconds > 1.1 * self.reported;
        if due && now >= self.next_report && !self.reports.is_empty() {
            reported = self.write_reports(course, image, None);
            self.reported = course.seconds;
            self.next_report = Instant::now() + 100 * now.elapsed();
        }
        // Write the checkpoint if it is due
        if self.next_checkpoint.is_some_and(|time| now >= time) {
            saved = self.write_checkpoint(course, image, None);
            self.next_checkpoint = Instant::now().checked_add(self.every);
        }
        reported.and(saved)
    }

    // Write all files a last time
    /// Writes all files when the run has stopped.
    ///
    /// # Errors
    /// A file cannot be written; the others are.
    pub fn close(
        &mut self,
        course: &Course,
        image: &Image,
        stop: Stop,
    ) -> Result<(), String> {
        let stop = Some(stop);
        let saved = self.write_checkpoint(course, image, stop);
        self.write_reports(course, image, stop).and(saved)
    }

    /// Takes the time that [`Journal::close`] will take, and writes nothing;
    /// returns the picture.
    pub fn rehearse(&self, course: &Course, image: &Image) -> Picture {
        if !self.reports.is_empty() {
            // Render each report for nobody
            let report = self.report(course, image, None);
            let picture = self.illustration(course, image);
            for (kind, _) in &self.reports {
                black_box(kind.render(&report, &picture));
            }
        }
        if self.checkpoint.is_some() {
            let (subject, mut out) = (&self.subject, io::sink());
            let _ = checkpoint::save(subject, course, image, &mut out);
        }
        self.picture(course, image, None)
    }

    // Write the reports
    fn write_reports(
        &mut self,
        course: &Course,
        image: &Image,
        stop: Option<Stop>,
    ) -> Result<(), String> {
        if self.reports.is_empty() {
            return Ok(());
        }
        let report = self.report(course, image, stop);
        let picture = self.illustration(course, image);
        let mut written = Ok(());
        // Write each report in its place
        for (kind, place) in &mut self.reports {
            let text = kind.render(&report, &picture);
            let done =
                put(place, stop, &mut |out| out.write_all(text.as_bytes()));
            written = written.and(done);
        }
        written
    }

    /// The picture that the reports need.
    fn illustration(&self, course: &Course, image: &Image) -> Picture {
        let page = self.reports.iter().any(|(kind, _)| *kind == Kind::Html);
        match page {
            true => self.picture(course, image, None),
            false => self.picture(course, &Image::new(1, 1), None),
        }
    }

    // Write the checkpoint
    fn write_checkpoint(
        &mut self,
        course: &Course,
        image: &Image,
        stop: Option<Stop>,
    ) -> Result<(), String> {
        let Some(place) = &mut self.checkpoint else { return Ok(()) };
        let subject = &self.subject;
        put(place, stop, &mut |out| {
            checkpoint::save(subject, course, image, out)
        })
    }

    // Fill in the report
    /// The report of the run so far.
    pub fn report(
        &self,
        course: &Course,
        image: &Image,
        stop: Option<Stop>,
    ) -> Report {
        let mut now = course.clone();
        now.record(image, None);
        let mut report = self.facts.clone();
        report.render_seconds = now.seconds;
        report.rays = now.rays;
        report.stopped = stop.map(|stop| stop.name().to_owned());
        report.constant_pixels = now.constant;
        // Fill in what the last step knows
        if let Some(last) = now.steps.last() {
            report.mean = last.mean;
            report.mean_stderr = last.mean_stderr;
            report.rmse = last.rmse;
        }
        report.steps = now.steps;
        report
    }

    // Fill in the picture
    /// The image as a picture, with all that is known about it.
    pub fn picture(
        &self,
        course: &Course,
        image: &Image,
        stop: Option<Stop>,
    ) -> Picture {
        let facts = &self.facts;
        let known = json!({
            // List what is known about a run
            "scene": facts.scene.file,
            "realisations": course.spp,
            "rays": course.rays,
            "load_seconds": facts.load_seconds,
            "build_seconds": facts.build_seconds,
            "render_seconds": course.seconds,
            "stopped": stop.map_or("not yet", Stop::name),
        });
        // Chain all attributes, the latest last
        let known = known.as_object().into_iter().flatten();
        let settings = facts.settings.iter().filter(|(_, v)| !v.is_null());
        let all = settings.chain(&self.subject).chain(known);
        let attributes =
            all.map(|(name, value)| (name.clone(), text(value)));
        Picture::new(image, attributes.collect())
    }
}
