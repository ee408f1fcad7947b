// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! What a run reports: its settings, its timings, and the curve of its
//! error against time.
//!
//! Errors are absolute, in units of the sky's radiance; times are
//! seconds of wall clock. A number that is not known is none in Rust,
//! null in JSON, an empty field in CSV, and a word for people.

mod axis;
mod csv;
pub mod histogram;
mod html;
mod pixels;
mod plot;
mod svg;
mod words;

// Name what the report imports
use std::fmt;
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::analysis::Finding;
use crate::image::Image;

// Describe a run and its steps
/// One point of the curve of error against time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Samples per pixel so far.
    pub spp: u64,
    /// Seconds of rendering so far, without load and build.
    pub seconds: f64,
    /// Rays traced so far.
    pub rays: u64,
    // Hold what a step knows of the image
    /// Estimated root mean square error over the pixels, if known.
    pub rmse: Option<f64>,
    /// Mean radiance of the image.
    pub mean: f64,
    /// Its standard error, if known.
    pub mean_stderr: Option<f64>,
    /// Root mean square difference from the reference, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rmse_reference: Option<f64>,
}

/// The scene as a report names it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneFacts {
    /// The name of its file.
    pub file: String,
    /// The SHA-256 hash of the file, in hexadecimal.
    pub sha256: String,
    /// The number of its triangles.
    pub triangles: u64,
}

/// What is known of a run, at its end or while it goes on.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    // Hold what was rendered and how
    /// Name and version of the program.
    pub program: String,
    /// What was rendered.
    pub scene: SceneFacts,
    /// Each option and its value.
    pub settings: Map<String, Value>,
    /// What was left out because the scene does not need it, and why.
    pub left_out: Vec<Finding>,
    // Hold what the run has cost
    /// Seconds to read the scene.
    pub load_seconds: f64,
    /// Seconds to find what the scene does not need, and to build the
    /// hierarchy of the rest.
    pub build_seconds: f64,
    /// Seconds of rendering.
    pub render_seconds: f64,
    /// Rays traced.
    pub rays: u64,
    // Hold how good the image is
    /// Mean radiance of the image.
    pub mean: f64,
    /// Its standard error, if known.
    pub mean_stderr: Option<f64>,
    /// Estimated root mean square error over the pixels, if known.
    pub rmse: Option<f64>,
    /// Pixels whose weights were all alike: their error is not seen.
    pub constant_pixels: u64,
    /// Why the run ended: `samples`, `time`, `error` or `signal`;
    /// none while it goes on.
    pub stopped: Option<String>,
    /// The curve of error against time.
    pub steps: Vec<Step>,
}

// Fit a line to the curve
/// A straight line through the logarithms of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// The exponent of the power law.
    pub slope: f64,
    /// The standard error of the slope, from the scatter of the points.
    pub stderr: f64,
}

impl Fit {
    /// The least-squares fit to points (x, y), all positive; none for
    /// fewer than three, or if they are too close to each other in x.
    pub fn of(points: &[(f64, f64)]) -> Option<Self> {
        // Sum a term of the deviations
        let (x, y) = centre(points)?;
        let deviation =
            |p: &(f64, f64)| (libm::log(p.0) - x, libm::log(p.1) - y);
        let sum = |term: &dyn Fn(f64, f64) -> f64| -> f64 {
            points.iter().map(deviation).map(|(x, y)| term(x, y)).sum()
        };
        let spread = sum(&|x, _| x * x);
        if points.len() < 3 || spread < 1e-9 {
            return None;
        }
        // Divide by the spread of the points
        let slope = sum(&|x, y| x * y) / spread;
        let split_mix = sum(&|x, y| (y - slope * x) * (y - slope * x));
        let freedom = points.len() as f64 - 2.;
        let stderr = (split_mix / freedom / spread).sqrt();
        Some(Self { slope, stderr })
    }
}

impl fmt::Display for Fit {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let sign = if self.slope < 0. { "\u{2212}" } else { "" };
        let error = (self.stderr * 1e3).ceil().max(1.) / 1e3;
        write!(out, "{sign}{:.3} \u{b1} {error:.3}", self.slope.abs())
    }
}

/// The means of the logarithms of points, if there are any.
fn centre(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let n = points.len() as f64;
    let x: f64 = points.iter().map(|p| libm::log(p.0)).sum();
    let y: f64 = points.iter().map(|p| libm::log(p.1)).sum();
    (!points.is_empty()).then_some((x / n, y / n))
}

/// The constant g of the curve g / sqrt(x) that fits points best.
fn guide(points: &[(f64, f64)]) -> Option<f64> {
    centre(points).map(|(x, y)| libm::exp(y + x / 2.))
}

/// Steps of fewer samples are left out of fits.
const FEWEST: u64 = 8;

/// Whether a number has a place on a logarithmic axis.
fn drawable(x: f64) -> bool {
    x > 0. && x.is_finite()
}

/// A place of a plot, and whether fits may rely on it.
type Point = ((f64, f64), bool);

/// The steps that have a place on the plot of `error` against `x`.
fn points(
    steps: &[Step],
    x: fn(&Step) -> f64,
    error: fn(&Step) -> Option<f64>,
) -> Vec<Point> {
    let point = |step: &Step| {
        let (x, error) = (x(step), error(step)?);
        (drawable(x) && drawable(error))
            .then_some(((x, error), step.spp >= FEWEST))
    };
    steps.iter().filter_map(point).collect()
}

/// The points that fits may rely on.
fn reliable(points: &[Point]) -> Vec<(f64, f64)> {
    points.iter().filter(|p| p.1).map(|p| p.0).collect()
}

impl Report {
    /// The slope of the estimated error against seconds, in logarithms.
    pub fn slope_seconds(&self) -> Option<Fit> {
        self.slope(|step| step.seconds)
    }

    /// The slope of the estimated error against samples.
    pub fn slope_spp(&self) -> Option<Fit> {
        self.slope(|step| step.spp as f64)
    }

    fn slope(&self, x: fn(&Step) -> f64) -> Option<Fit> {
        Fit::of(&reliable(&points(&self.steps, x, |step| step.rmse)))
    }
}

// Choose the kind of a report
/// How a report becomes text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Everything but the image, for programs.
    Json,
    /// The steps as a table with a header.
    Csv,
    /// The error against time as a drawing.
    Svg,
    /// One page with everything, for people.
    Html,
}

impl Kind {
    // Tell the kind from the extension
    /// The kind of report that a file of this name holds.
    ///
    /// # Errors
    /// The extension belongs to no kind.
    pub fn of(path: &Path) -> Result<Self, String> {
        let extension = path.extension().and_then(|e| e.to_str());
        match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("json") => Ok(Kind::Json),
            Some("csv") => Ok(Kind::Csv),
            Some("svg") => Ok(Kind::Svg),
            Some("html") => Ok(Kind::Html),
            _ => Err(format!(
                "{}: unknown kind of report; name it .json, .csv, .svg \
                 or .html",
                path.display()
            )),
        }
    }

    /// The text of a report; only the page needs the image.
    pub fn render(self, report: &Report, image: &Image) -> String {
        match self {
            Kind::Json => json(report),
            Kind::Csv => csv::table(&report.steps),
            Kind::Svg => svg::drawing(report),
            Kind::Html => html::page(report, image),
        }
    }
}

/// A report and what follows from it.
#[derive(Serialize)]
struct Complete<'a> {
    #[serde(flatten)]
    report: &'a Report,
    slope_seconds: Option<f64>,
    slope_spp: Option<f64>,
}

fn json(report: &Report) -> String {
    let complete = Complete {
        report,
        slope_seconds: report.slope_seconds().map(|fit| fit.slope),
        slope_spp: report.slope_spp().map(|fit| fit.slope),
    };
    let text = serde_json::to_string_pretty(&complete);
    text.expect("the keys of a report are strings") + "\n"
}
