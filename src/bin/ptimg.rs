// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command `ptimg`: show and compare images, and add states.

use std::collections::BTreeMap;
use std::env;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use clap::{Args, Parser, Subcommand};
use serde::Serialize;

use litpt::compare::display::{self, Curve};
use litpt::compare::{
    Difference, Dispersion, FEW, Scale, compare, disagreements,
};
use litpt::image::{Format, Image};
use litpt::options::{LICENCE, STYLES, is_dash, parse_real, parse_words};
use litpt::output::{ImageTarget, OutputTarget, descriptor, tell_apart};
use litpt::progress;
use litpt::report::Kind;
use litpt::run_output::conclude;
use litpt::session::fail;
use litpt::state::shards;
use signal_hook::consts::SIGXFSZ;
use signal_hook::flag;

/// Shows and compares images, and merges states of parts of a run. Images
/// are .exr and .pfm, as pt writes them, and of other programs .png and
/// .pgm too; - is standard input or output.
#[derive(Debug, Parser)]
#[command(name = "ptimg", version, after_help = LICENCE, styles = STYLES)]
#[command(arg_required_else_help = false)]
pub struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Print the size, the channels, the run and the error of images
    Info {
        /// Images to read
        #[arg(value_name = "FILE", required = true)]
        files: Vec<PathBuf>,

        /// Print one line of JSON for each image
        #[arg(long)]
        json: bool,
    },
    /// Make an image for the screen
    Tonemap {
        /// Image to read
        #[arg(value_name = "IN")]
        input: PathBuf,

        #[command(flatten)]
        output: Output,

        /// Stops by which the image is made brighter
        #[arg(short, long, value_name = "STOPS", default_value = "0",
              allow_hyphen_values = true, value_parser = parse_real)]
        exposure: f64,

        /// What becomes of radiances brighter than white
        #[arg(short, long, value_name = "CURVE", default_value = "clamp")]
        tonemap: Curve,
    },
    /// Test whether chance alone explains the difference of two images:
    /// the status is 0 if so, 1 if not (wrong once in 100 pairs), and 2 if
    /// they cannot be compared
    Diff {
        /// Image to test
        #[arg(value_name = "A")]
        a: PathBuf,

        /// Image to test against; taken as exact if it says no errors
        #[arg(value_name = "B")]
        b: PathBuf,
        /// Map of the differences in standard errors, as numbers (.exr,
        /// .pfm) or as grey levels (.png, .pgm) from -5 to 5; - with -q
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,

        /// Format of a map on standard output: pgm, png, pfm or exr
        #[arg(
            long,
            value_name = "FORMAT",
            hide_possible_values = true,
            requires = "output"
        )]
        format: Option<Format>,

        /// Overwrite the map if it exists
        #[arg(short, long)]
        force: bool,

        /// Print nothing but errors
        #[arg(short, long)]
        quiet: bool,
    },
    /// Merge states of parts of one run to the image of the whole
    Merge(Merge),
    /// Show the standard error of each pixel as grey
    Stderr {
        /// Image to read
        #[arg(value_name = "IN")]
        input: PathBuf,

        #[command(flatten)]
        output: Output,

        /// Show the errors relative to the means
        #[arg(short, long)]
        relative: bool,
    },
}

#[derive(Debug, Args)]
struct Merge {
    /// States of parts of a run, of pt -o a.litpt or --checkpoint
    #[arg(value_name = "FILE", required = true, num_args = 2..)]
    files: Vec<PathBuf>,

    /// Image to write, .exr, .pfm, .png or .pgm; may be repeated; - is
    /// standard output
    #[arg(short, long, value_name = "OUT", required = true)]
    output: Vec<PathBuf>,

    /// Format on standard output [default: exr]
    #[arg(long, value_name = "FORMAT", hide_possible_values = true)]
    format: Option<Format>,

    /// Report of the run whose parts are merged, .json, .csv or .html; may
    /// be repeated
    #[arg(long, value_name = "FILE")]
    report: Vec<PathBuf>,

    /// Merge what there is, even if parts of the run are missing
    #[arg(long)]
    partial: bool,

    /// Overwrite files that exist
    #[arg(short, long)]
    force: bool,
}

#[derive(Debug, Args)]
struct Output {
    /// Image to write, .pgm or .png; - is standard output
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,

    /// Format on standard output, pgm or png [default: pgm]
    #[arg(long, value_name = "FORMAT", hide_possible_values = true)]
    format: Option<Format>,

    /// Overwrite the image if it exists
    #[arg(short, long)]
    force: bool,
}

impl Output {
    /// The target of an image of grey levels.
    ///
    /// # Errors
    /// The format is another, or the target cannot be written.
    fn target(&self) -> Result<ImageTarget, String> {
        let target =
            target(&self.output, self.format, self.force, GREY[0])?;
        match GREY.contains(&target.format()) {
            true => Ok(target),
            false => Err(format!(
                "{}: this image is written as .pgm or .png",
                self.output.display()
            )),
        }
    }
}

/// The target of an image, which on standard output has the format that
/// was asked for, or the usual one.
fn target(
    path: &Path,
    format: Option<Format>,
    force: bool,
    usual: Format,
) -> Result<ImageTarget, String> {
    match (descriptor(path), format) {
        (None, Some(_)) => Err(format!(
            "{}: --format is for standard output; the name of a file \
             tells its format",
            path.display()
        )),
        _ => ImageTarget::file(path, format.unwrap_or(usual), force),
    }
}

fn main() -> ExitCode {
    // A file beyond the limit of size is an error, not the end.
    let _ = flag::register(SIGXFSZ, Arc::default());
    let arguments: Arguments = match parse_words(env::args_os()) {
        Ok((arguments, _)) => arguments,
        Err(error) => return fail(error),
    };
    run(&arguments.verb).unwrap_or_else(|message| {
        progress::error(&message);
        match arguments.verb {
            Verb::Diff { .. } => ExitCode::from(2),
            _ => ExitCode::FAILURE,
        }
    })
}

const GREY: [Format; 2] = [Format::Pgm, Format::Png];

fn run(verb: &Verb) -> Result<ExitCode, String> {
    match verb {
        Verb::Info { files, json } => inform(files, *json)?,
        Verb::Tonemap { input, output, exposure, tonemap } => {
            // Show the radiances on a screen
            let target = output.target()?;
            let image = read(input)?;
            let grey = display::tonemap(&image, *exposure, *tonemap);
            target.write(&grey)?;
        }
        Verb::Merge(merge) => merge.run()?,
        Verb::Stderr { input, output, relative } => {
            show_errors(input, output, *relative)?;
        }
        Verb::Diff { a, b, output, format, force, quiet } => {
            // Check the map before the comparison
            if output.as_deref().and_then(descriptor) == Some(1) && !quiet {
                return Err("a map on standard output needs -q".to_owned());
            }
            let map = output.as_ref();
            let map =
                map.map(|path| target(path, *format, *force, Format::Pgm));
            return diff(a, b, map.transpose()?, *quiet);
        }
    }
    Ok(ExitCode::SUCCESS)
}

impl Merge {
    fn run(&self) -> Result<(), String> {
        // Refuse to overwrite what is merged
        let files = self.files.iter().map(PathBuf::as_path);
        let written = self.output.iter().chain(&self.report);
        tell_apart(files, written.map(PathBuf::as_path))?;
        // Refuse what is no state
        let is_other = |file: &&PathBuf| {
            (is_dash(file) || file.exists()) && !shards::is_state(file)
        };
        if let Some(file) = self.files.iter().find(is_other) {
            return Err(format!(
                "{}: merge adds the states of a run, files that `pt -o a.litpt` \
                 or --checkpoint writes, not images",
                file.display()
            ));
        }
        // Check the targets of image and report
        let (format, force) = (self.format, self.force);
        let image =
            |path: &PathBuf| target(path, format, force, Format::Exr);
        let images = self.output.iter().map(image);
        let images = images.collect::<Result<Vec<_>, String>>()?;
        let report = |path: &PathBuf| {
            Ok((Kind::of(path)?, OutputTarget::file(path, force)?))
        };
        let reports = self.report.iter().map(report);
        let reports = reports.collect::<Result<Vec<_>, String>>()?;
        let merged = shards::merge(&self.files)?;
        // Name the parts that are missing
        if let Some(missing) = &merged.missing {
            let missing = format!("parts are missing: {missing}");
            match self.partial {
                true => progress::warn(&missing),
                false => return Err(format!("{missing} (see --partial)")),
            }
        }
        // Write what was merged
        let (image, report) = conclude(merged);
        for target in images {
            target.write(&image)?;
        }
        for (kind, target) in reports {
            let text = kind.render(&report, &|| image.clone());
            target.write(&mut |out| out.write_all(text.as_bytes()))?;
        }
        Ok(())
    }
}

/// Reads an image and warns of what is not as it should be.
fn read(path: &Path) -> Result<Image, String> {
    Image::read_noting(path, &mut progress::warn)
}

/// # Errors
/// Standard input is named twice.
fn read_once<'a>(
    files: impl Iterator<Item = &'a Path>,
) -> Result<(), String> {
    match files.filter(|path| is_dash(path)).count() {
        0 | 1 => Ok(()),
        _ => Err("standard input can be read once only".to_owned()),
    }
}

fn show_errors(
    input: &Path,
    output: &Output,
    relative: bool,
) -> Result<(), String> {
    let target = output.target()?;
    let image = read(input)?;
    let (grey, white) = display::errors(&image, relative)
        .map_err(|fault| format!("{}: {fault}", input.display()))?;
    target.write(&grey)?;
    // Tell what white stands for
    let what = match relative {
        true => "relative standard error",
        false => "standard error",
    };
    let line = format!("white is a {what} of {white:.4e}");
    match descriptor(&output.output) {
        Some(1) => progress::inform(&line),
        _ => say(&line)?,
    }
    Ok(())
}

/// Prints lines on standard output, unless the reader has closed the pipe.
fn say(lines: &str) -> Result<(), String> {
    OutputTarget::standard_output()?
        .write(&mut |out| writeln!(out, "{lines}"))
}

fn inform(files: &[PathBuf], json: bool) -> Result<(), String> {
    read_once(files.iter().map(PathBuf::as_path))?;
    for path in files {
        let summary = Summary::of(path.display().to_string(), read(path)?);
        say(&match json {
            true => serde_json::to_string(&summary)
                .map_err(|error| error.to_string())?,
            false => summary.describe(),
        })?;
    }
    Ok(())
}

/// What there is to know of an image.
#[derive(Serialize)]
struct Summary {
    file: String,
    width: u32,
    height: u32,
    channels: Vec<&'static str>,
    /// Mean radiance of all pixels that are finite numbers.
    mean: Option<f64>,
    /// Its standard error, and the root of the mean square of those of the
    /// pixels.
    mean_stderr: Option<f64>,
    rmse: Option<f64>,
    /// Number of pixels, of those with a mean, whose error is unknown.
    unknown_errors: usize,
    /// Number of pixels without a mean.
    not_finite: usize,
    least: Option<f64>,
    greatest: Option<f64>,
    samples: Option<(f64, f64)>,
    attributes: BTreeMap<String, String>,
}

impl Summary {
    fn of(file: String, image: Image) -> Self {
        let known = |i: &usize| image.means[*i].is_finite();
        let pixels: Vec<usize> =
            (0..image.means.len()).filter(known).collect();
        let means: Vec<f64> =
            pixels.iter().map(|&i| image.means[i]).collect();
        let errors = image.errors.as_ref();
        let errors: Option<Vec<f64>> = errors
            .map(|errors| pixels.iter().map(|&i| errors[i]).collect());
        let shared = image.tile_errors.as_ref();
        // Sum the means and their errors
        let n = means.len() as f64;
        let mean = means.iter().sum::<f64>() / n;
        let unknown = errors.iter().flatten().filter(|e| e.is_infinite());
        let unknown_errors = unknown.count();
        let squares = errors.filter(|_| unknown_errors == 0 && n > 0.);
        let squares = squares.map(|e| e.iter().map(|e| e * e).sum::<f64>());
        let shared = shared.map(|errors| {
            pixels.iter().map(|&i| errors[i] * errors[i]).sum::<f64>()
        });
        let of_mean = squares.map(|squares| shared.unwrap_or(squares));
        let of_mean = of_mean.filter(|squares| squares.is_finite());
        let (least, greatest) = range(&means).unzip();
        Self {
            file,
            width: image.width,
            height: image.height,
            // Fill in the summary of an image
            channels: channels(&image),
            mean: (n > 0.).then_some(mean),
            mean_stderr: of_mean.map(|squares| squares.sqrt() / n),
            rmse: squares.map(|squares| (squares / n).sqrt()),
            unknown_errors,
            not_finite: image.means.len() - means.len(),
            least,
            greatest,
            samples: image.samples.as_deref().and_then(range),
            attributes: image.attributes,
        }
    }

    /// The lines that describe an image.
    fn describe(&self) -> String {
        let Self { file, width, height, .. } = self;
        let mut lines = vec![
            format!("{file}: {width}x{height} pixels"),
            format!("channels: {}", self.channels.join(", ")),
        ];
        // Tell the mean as well as it is known
        if let Some(mean) = self.mean {
            lines.push(match self.mean_stderr {
                Some(error) => {
                    format!("mean radiance: {mean:.6} ± {error:.6}")
                }
                None if self.unknown_errors > 0 => {
                    format!("mean radiance: {mean:.6}, error unknown")
                }
                None => format!("mean radiance: {mean:.6}"),
            });
        }
        lines.extend(self.rmse.map(|rmse| format!("rmse: {rmse:.6}")));
        // Tell the pixels that are not known
        for (what, count) in [
            ("of unknown error", self.unknown_errors),
            ("that are not finite numbers", self.not_finite),
        ] {
            if count > 0 {
                lines.push(format!("pixels {what}: {count}"));
            }
        }
        if let Some((least, most)) = self.least.zip(self.greatest) {
            lines
                .push(format!("least and greatest: {least:.6}, {most:.6}"));
        }
        // Describe the samples and the run
        if let Some((least, most)) = self.samples {
            lines.push(match least == most {
                true => format!("samples per pixel: {least}"),
                false => format!("samples per pixel: {least} to {most}"),
            });
        }
        let attributes = self.attributes.iter();
        lines.extend(
            attributes.map(|(name, value)| format!("{name}: {value}")),
        );
        lines.join("\n  ")
    }
}

/// The least and the greatest of some values, if there is one.
fn range(values: &[f64]) -> Option<(f64, f64)> {
    let least = values.iter().copied().reduce(f64::min)?;
    Some((least, values.iter().copied().reduce(f64::max)?))
}

fn channels(image: &Image) -> Vec<&'static str> {
    let errors = image.errors.as_ref().map(|_| "stderr.Y");
    let samples = image.samples.as_ref().map(|_| "samples.Y");
    let shared = image.tile_errors.as_ref().map(|_| "tile_stderr.Y");
    [Some("Y"), errors, samples, shared].into_iter().flatten().collect()
}

fn diff(
    a: &Path,
    b: &Path,
    map: Option<ImageTarget>,
    quiet: bool,
) -> Result<ExitCode, String> {
    read_once([a, b].into_iter())?;
    let note = &mut |line: &str| {
        if !quiet {
            progress::warn(line);
        }
    };
    let first = Image::read_noting(a, note)?;
    let second = Image::read_noting(b, note)?;
    let difference = compare(&first, &second).map_err(|fault| {
        format!("{} and {}: {fault}", a.display(), b.display())
    })?;
    if let Some(map) = map {
        let grey = GREY.contains(&map.format());
        map.write(&display::z_map(&first, &difference, grey))?;
    }
    if !quiet {
        // Say what the comparison takes for granted
        let differing =
            disagreements(&first.attributes, &second.attributes);
        if !differing.is_empty() {
            let differing = differing.join(", ");
            say(&format!("they show different things: {differing}"))?;
        }
        for (path, image) in [(a, &first), (b, &second)] {
            if image.errors.is_none() {
                let name = path.display();
                say(&format!("{name}: no errors; it is taken as exact"))?;
            }
        }
        if let Some(seed) = common_seed(&first, &second) {
            progress::warn(&format!(
                "both images come from seed {seed}: they share random \
                 numbers, and may agree better than independent ones would"
            ));
        }
        say(&explain(&difference))?;
    }
    // Answer by the status
    Ok(match difference.consistent() {
        true => ExitCode::SUCCESS,
        false => ExitCode::from(1),
    })
}

/// The seed that two images of the same scene share.
fn common_seed<'a>(a: &'a Image, b: &Image) -> Option<&'a String> {
    let of = |name| a.attributes.get(name).zip(b.attributes.get(name));
    if of("scene_sha256").is_some_and(|(a, b)| a != b) {
        return None;
    }
    let (a, b) = of("seed")?;
    (a == b).then_some(a)
}

/// The lines that explain a comparison.
fn explain(difference: &Difference) -> String {
    if difference.identical {
        return "identical: all pixels have the same values".to_owned();
    }
    // Tell the distances and the mean difference
    let &Difference { rmse, relative_mse, sum, .. } = difference;
    let n = sum.pixels as f64;
    let (mean, error) = (sum.difference / n, sum.variance.sqrt() / n);
    let z = sum.z();
    let mut lines = vec![
        format!("root mean square difference: {rmse:.6}"),
        format!("relative mean square difference: {relative_mse:.6}"),
        format!("mean difference: {mean:.6} ± {error:.6} (z = {z:.2})"),
    ];
    lines.extend(difference.scales.iter().map(explain_scale));
    // Tell whether the errors are plausible
    let Dispersion { ratio, z, failed, pixels } = difference.dispersion;
    if pixels > 0 {
        let verdict = if failed { "beyond" } else { "no more than" };
        lines.push(format!(
            "errors: differences {ratio:.3} times as large \
             (z = {z:.2}), {verdict} chance"
        ));
    }
    // Name the pixels that were left out
    let Difference { unknown, few, .. } = difference;
    if *unknown > 0 {
        lines
            .push(format!("not tested: {unknown} pixels of unknown error"));
    }
    if *few > 0 {
        lines.push(format!(
            "not tested one by one: {few} pixels of fewer than {FEW} \
             independent samples"
        ));
    }
    // Conclude with the verdict in words
    let failed: Vec<_> = failed_tests(difference).collect();
    lines.push(match difference.consistent() {
        true => {
            "consistent: chance alone may explain the difference".into()
        }
        false => format!(
            "inconsistent: chance alone does not explain the difference \
             (failed: {})",
            failed.join(", ")
        ),
    });
    lines.join("\n")
}

fn explain_scale(scale: &Scale) -> String {
    let &Scale { side, tested, failed, largest: (z, x, y) } = scale;
    let (name, z) = (name(side), z.abs());
    match (tested, failed) {
        (0, _) => format!("{name}: not tested"),
        (1, 0) => format!("{name}: |z| {z:.2}, not beyond chance"),
        (1, _) => format!("{name}: |z| {z:.2}, beyond chance"),
        _ => format!(
            "{name}: {tested} tested, largest |z| {z:.2} at {x},{y}, \
             {failed} beyond chance"
        ),
    }
}

/// The names of the tests that failed.
fn failed_tests(difference: &Difference) -> impl Iterator<Item = String> {
    let scales = difference.scales.iter().filter(|s| s.failed > 0);
    let errors = difference.dispersion.failed.then(|| "errors".to_owned());
    scales.map(|scale| name(scale.side)).chain(errors)
}

/// The name of the test of blocks of this size.
fn name(side: u32) -> String {
    match side {
        1 => "pixels".to_owned(),
        u32::MAX => "image".to_owned(),
        side => format!("blocks of {side}x{side}"),
    }
}
