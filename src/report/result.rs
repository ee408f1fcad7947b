// Tangled from chapters/report.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The data of a run, and what follows from it.

use std::time::SystemTime;
use std::{env, fs};

use humantime::format_rfc3339_seconds;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::analysis::Finding;
use crate::film::{ErrorNorm, Film};
use crate::filter::PictureError;
use crate::key::{Part, Subject};
use crate::render::choose::Method;
use crate::render_loop::{Convergence, CurvePoint, Limits, Stop};
use crate::tally::Tally;

/// The file of a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SceneFile {
    /// Its name.
    pub file: String,
    /// Its SHA-256 hash, in hexadecimal.
    pub sha256: String,
    /// The number of its triangles.
    pub triangles: u64,
}

/// How a run was made; an unknown setting is none.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The subject of the image.
    #[serde(flatten)]
    pub subject: Option<Subject>,
    /// How well the hierarchy was built.
    pub hierarchy: Option<String>,
    /// The seed of all random numbers.
    pub seed: u64,
    /// The requested number of samples of each pixel.
    pub spp: Option<u64>,
    /// The limit of time in seconds.
    pub time: Option<f64>,
    /// The requested error.
    pub error: Option<f64>,
    /// The image that true errors are computed from.
    pub reference: Option<String>,
    /// The instructions that have traced rays.
    pub isa: Option<String>,
    /// The number of threads.
    pub threads: Option<usize>,
    /// How samples were made.
    pub integrator: Method,
    /// The reason for the method, if a pilot run has chosen it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub choice: Option<String>,
    /// The part of the run, if it is not all of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<Part>,
    /// The samples that no state holds, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missing: Option<String>,
}

/// Forgets a value that differs from another.
fn keep_common<T: PartialEq>(value: &mut Option<T>, other: &Option<T>) {
    if value != other {
        *value = None;
    }
}

impl Settings {
    /// Whether its errors are those of view factors.
    fn has_view_factors(&self) -> bool {
        let tally = self.subject.as_ref().and_then(|s| s.tally.as_ref());
        tally.is_some_and(Tally::is_of_surfaces)
    }

    /// Whether receivers have values, and there is no image.
    fn has_receivers(&self) -> bool {
        self.subject.as_ref().is_some_and(|s| s.sensed.is_list())
    }

    /// Forgets the settings that differ from those of another part.
    fn keep_common(&mut self, part: &Self) {
        keep_common(&mut self.hierarchy, &part.hierarchy);
        keep_common(&mut self.time, &part.time);
        keep_common(&mut self.error, &part.error);
        keep_common(&mut self.reference, &part.reference);
        keep_common(&mut self.isa, &part.isa);
        keep_common(&mut self.threads, &part.threads);
        keep_common(&mut self.choice, &part.choice);
    }
}

/// The size of a matrix, and how it was closed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MatrixSize {
    /// Its rows.
    pub rows: usize,
    /// Its columns.
    pub columns: u32,
    /// Its entries that are not zero.
    pub entries: usize,
    /// By how many standard errors closing has moved entries, at most and in
    /// the mean, if it is closed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moves: Option<[f64; 2]>,
}

/// The data of a run, at its end or while it goes on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Name and version of the program.
    pub program: String,
    /// The command line, quoted for a shell.
    pub command: String,
    /// When the program began, in UTC, as in 2026-01-31T23:59:59Z.
    pub date: String,
    /// The name of the processor.
    pub processor: String,
    /// The scene that was rendered.
    pub scene: SceneFile,
    /// How it was made.
    pub settings: Settings,
    /// Steps that were left out because the scene does not need them, and why.
    pub left_out: Vec<Finding>,
    /// Seconds to read the scene.
    pub load_seconds: f64,
    /// Seconds to find what the scene does not need, and to build the
    /// hierarchy of the rest.
    pub build_seconds: f64,
    /// The progress of the render, and the curve of error against time.
    #[serde(flatten)]
    pub convergence: Convergence,
    /// Pixels without a sample.
    pub unsampled_pixels: u64,
    /// Pixels whose mean is below zero, which few corrections may cause.
    pub negative_pixels: u64,
    /// The stops by which PNG files are brighter, if that was requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure: Option<f64>,
    /// The stops by which the picture on a page is brighter.
    #[serde(skip)]
    pub page_exposure: f64,
    /// The sky and the ground, in words.
    #[serde(skip)]
    pub light: String,
    /// Whether a PNG is nearly black.
    #[serde(skip)]
    pub is_dark: bool,
    /// The error that is compared with the target.
    #[serde(rename = "measure")]
    #[serde(default, skip_serializing_if = "ErrorNorm::is_rms")]
    pub norm: ErrorNorm,
    /// The entries of a tally, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matrix: Option<MatrixSize>,
    /// How wrong the filtered picture is, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picture: Option<PictureError>,
}

impl Report {
    /// The report of the run as it stands, with its film.
    pub fn complete(&self, film: &Film) -> Self {
        let mut now = self.clone();
        let limits = Limits { norm: self.norm, ..Limits::default() };
        now.convergence.record(film, &limits);
        now.unsampled_pixels = film.unsampled();
        now.negative_pixels = film.darker(0.);
        now
    }

    /// Adds the times to load and to build of a part, and keeps the settings
    /// that both have.
    pub fn add(&mut self, part: &Self) {
        self.load_seconds += part.load_seconds;
        self.build_seconds += part.build_seconds;
        self.settings.keep_common(&part.settings);
    }
}

impl Report {
    /// Fills in the program, the command, the date and the processor.
    pub fn sign(&mut self, program: &str) {
        let words = env::args_os();
        let words = words.map(|word| quoted(&word.to_string_lossy()));
        let file = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let name = file.lines().find(|line| line.starts_with("model name"));
        let name = name.and_then(|line| Some(line.split_once(": ")?.1));
        self.program = format!("{program} {}", env!("CARGO_PKG_VERSION"));
        self.command = words.collect::<Vec<_>>().join(" ");
        self.date = format_rfc3339_seconds(SystemTime::now()).to_string();
        self.processor = name.unwrap_or(env::consts::ARCH).to_owned();
    }
}

/// A word, quoted for a shell where necessary.
fn quoted(word: &str) -> String {
    let harmless =
        |c: char| c.is_ascii_alphanumeric() || "-_./,:=+@".contains(c);
    match !word.is_empty() && word.chars().all(harmless) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

impl Report {
    /// The summary of a run of so many pixels: a table of names and
    /// texts.
    pub fn summary(&self, pixels: u64) -> Vec<(&'static str, String)> {
        let Settings { integrator, hierarchy, isa, .. } = &self.settings;
        // Format the costs of the run
        let &Convergence { seconds, rays, .. } = &self.convergence;
        let speed = metric(rays as f64 / seconds.max(1e-9));
        let render = format!(
            "{seconds:.3} s, {rays} rays, {speed}rays/s ({integrator})"
        );
        let bvh = [hierarchy, isa].into_iter().flatten().cloned();
        let count = self.scene.triangles;
        let s = if count == 1 { "" } else { "s" };
        let scene = format!(
            "{count} triangle{s}, load {:.3} s, build {:.3} s ({})",
            self.load_seconds,
            self.build_seconds,
            bvh.collect::<Vec<_>>().join(", ")
        );
        let mut lines = vec![
            ("run", self.verdict()),
            ("image", self.quality(pixels)),
            ("render", render),
            ("scene", scene),
        ];
        if let Some(PictureError { rmse, bias }) = self.picture {
            let mut text = format!("rmse {rmse:.6}");
            if bias > 0. {
                text += &format!(", of which {bias:.6} by filtering");
            }
            lines.insert(2, ("picture", text));
        }
        if let Some(size) = self.matrix {
            let MatrixSize { rows, columns, entries, moves } = size;
            let size = format!("{rows} x {columns}, {entries} not zero");
            let moved = moves.map_or(String::new(), |[most, mean]| {
                format!(
                    "; closing has moved them by {most:.1} errors at most, \
                     {mean:.2} in the mean"
                )
            });
            lines.insert(2, ("matrix", size + &moved));
        }
        // Add lines on choices and omissions
        if !self.light.is_empty() {
            lines.push(("sky", self.light.clone()));
        }
        if let Some(stops) = self.exposure {
            lines.push(("exposure", format!("{stops:+} stops in .png")));
        } else if self.is_dark {
            let hint = "90 % of the pixels are below 0.1 (--exposure auto)";
            lines.push(("exposure", hint.to_owned()));
        }
        let why = self.settings.choice.clone();
        let why = why.filter(|_| *integrator != Method::Reference);
        lines.extend(why.map(|why| ("method", why)));
        for Finding { name, reason, .. } in &self.left_out {
            lines.push(("left out", format!("{name}: {reason}")));
        }
        let constant = self.convergence.constant_pixels;
        if 0 < constant && constant < pixels {
            let errors = match self.settings.has_receivers() {
                true => "they may not be exact",
                false => "their errors come from their neighbours",
            };
            let pixels = format!(
                "{constant} of {pixels} saw one value only; {errors}"
            );
            lines.push(("pixels", pixels));
        }
        if self.negative_pixels > 0 {
            let pixels = format!(
                "{} of {pixels} are below zero, as corrections of few \
                 samples may be",
                self.negative_pixels
            );
            lines.push(("pixels", pixels));
        }
        lines
    }

    /// How exact the image of so many pixels is.
    fn quality(&self, pixels: u64) -> String {
        let (spp, last) = (self.convergence.spp, self.convergence.last());
        if spp == 0 && self.picture.is_some() {
            return "no sample of all pixels yet; the picture is a glance"
                .into();
        }
        if spp == 0 {
            return format!(
                "{} of {pixels} pixels have no sample: they are filled from \
                 those around them in .png and .pgm, and nan in .pfm and .exr",
                self.unsampled_pixels
            );
        }
        let mean = with_error(last.mean, last.mean_stderr);
        if self.matrix.is_some() && self.settings.has_view_factors() {
            let error = rounded(last.rmse, 6);
            return format!(
                "{spp} spp, rmse {error} (largest of each row)"
            );
        }
        let value = match self.settings.has_receivers() {
            true => "irradiance",
            false => "radiance",
        };
        let mut text = format!("{spp} spp, mean {value} {mean}");
        if last.rmse.is_some() {
            text += &format!(", rmse {}", rounded(last.rmse, 6));
        }
        let truth = last.rmse_reference;
        if truth.is_some() {
            text += &format!(", {} from the reference", rounded(truth, 6));
        }
        text
    }

    /// Why the run stopped, and whether its targets were met.
    pub fn verdict(&self) -> String {
        let Convergence { spp: there, stopped, .. } = self.convergence;
        let rmse = self.convergence.last().judged(self.norm);
        let mut text = match stopped {
            None => return "still running".to_owned(),
            Some(Stop::Signal(_)) => "stopped by a signal".to_owned(),
            Some(limit) => {
                format!("stopped by {}", as_typed(&json!(limit)))
            }
        };
        if let Some(spp) = self.settings.spp {
            text += &format!("; {there} of {spp} spp");
        }
        // Compare the error with its target
        if let Some(target) = self.settings.error {
            let small = rmse.is_some_and(|rmse| rmse <= target);
            let met = small || stopped == Some(Stop::Error);
            let ErrorNorm { relative, largest } = self.norm;
            let largest = if largest { "largest " } else { "" };
            let relative = if relative { "relative " } else { "" };
            let (error, not) =
                (rounded(rmse, 6), if met { "" } else { "not " });
            text += &format!(
                "; {largest}{relative}error {error}, target {target} {not}reached"
            );
        }
        text
    }
}

/// A number to so many decimals, or more if these show less than two
/// digits of it; or the word unknown.
pub fn rounded(x: Option<f64>, decimals: usize) -> String {
    match x.filter(|x| x.is_finite()) {
        Some(x) => format!("{x:.*}", places(x, decimals)),
        None => "unknown".to_owned(),
    }
}

/// A number to two decimals with a metric prefix, as in `1.25 M`.
pub fn metric(x: f64) -> String {
    let scales = [(1e9, "G"), (1e6, "M"), (1e3, "k")];
    match scales.iter().find(|(scale, _)| x >= 0.9995 * scale) {
        Some((scale, prefix)) => format!("{:.2} {prefix}", x / scale),
        None => format!("{x:.0} "),
    }
}

/// The decimals that show two digits of a number, `least` or more.
fn places(x: f64, least: usize) -> usize {
    let first = libm::log10(x.abs()).floor();
    if x == 0. { least } else { least.max((1. - first).max(0.) as usize) }
}

/// A mean with its standard error.
pub(crate) fn with_error(mean: f64, error: Option<f64>) -> String {
    let places = places(error.unwrap_or(mean), 6);
    let mean = rounded(Some(mean), places);
    match error {
        Some(error) => {
            format!("{mean} \u{b1} {}", rounded(Some(error), places))
        }
        None => format!("{mean}, error unknown"),
    }
}

/// A value as text; a vector or a size as it is typed.
pub(crate) fn as_typed(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(parts) => {
            let numbers = parts.iter().all(Value::is_number);
            let sign = if numbers && parts.len() == 2 { "x" } else { "," };
            let parts = parts.iter().map(as_typed);
            parts.collect::<Vec<_>>().join(sign)
        }
        other => other.to_string(),
    }
}

/// The slope of the line through the logarithms of points (x, y), all
/// positive, by least squares; none for fewer than three, or if they are
/// too close to each other in x.
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let logs = points.iter().map(|p| (libm::log(p.0), libm::log(p.1)));
    let x = logs.clone().map(|p| p.0).sum::<f64>() / n;
    let y = logs.clone().map(|p| p.1).sum::<f64>() / n;
    let spread: f64 = logs.clone().map(|p| (p.0 - x) * (p.0 - x)).sum();
    let product: f64 = logs.map(|p| (p.0 - x) * (p.1 - y)).sum();
    (points.len() >= 3 && spread >= 1e-9).then(|| product / spread)
}

/// Points of fewer samples are left out of fits.
const FEWEST: u64 = 8;

/// Whether a number has a place on a logarithmic axis.
pub(crate) fn drawable(x: f64) -> bool {
    x > 0. && x.is_finite()
}

impl Report {
    /// The slopes of the estimated error against seconds and against
    /// samples, in logarithms.
    pub fn slopes(&self) -> [Option<f64>; 2] {
        let has_error = |p: &&CurvePoint| p.rmse.is_some_and(drawable);
        let points = self.convergence.curve.iter();
        let points = points.filter(|p| p.spp >= FEWEST);
        let points =
            points.filter(has_error).filter(|p| drawable(p.seconds));
        let slope_of = |spent: fn(&CurvePoint) -> f64| {
            let point = |p: &CurvePoint| Some((spent(p), p.rmse?));
            slope(&points.clone().filter_map(point).collect::<Vec<_>>())
        };
        [slope_of(|p| p.seconds), slope_of(|p| p.spp as f64)]
    }
}
