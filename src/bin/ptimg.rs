// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command `ptimg`: show, compare and merge the images of `pt`.

// Name what the companion imports
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};

use litpt::arguments::{LICENCE, STYLES, parse_command_line, parse_real};
use litpt::compare::display::{self, Curve};
use litpt::compare::merge::{Run, merge};
use litpt::compare::{
    Difference, Dispersion, FEW, Scale, compare, disagreements,
};
use litpt::image::{Format, Image};
use litpt::output::{ImageTarget, OutputTarget};
use litpt::progress;

// Declare the verbs of the companion
/// Shows, compares and merges the images that pt writes (.exr, .pfm).
#[derive(Debug, Parser)]
#[command(name = "ptimg", version, after_help = LICENCE, styles = STYLES)]
#[command(arg_required_else_help = false)]
pub struct Arguments {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    // Declare the verb info
    /// Print the size, the channels, the run and the error of images
    Info {
        /// Images to read
        #[arg(value_name = "FILE", required = true)]
        files: Vec<PathBuf>,
    },
    // Declare the verb tonemap
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
    // Declare the verb diff
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
        // Declare the options of a comparison
        /// Map of the differences in standard errors, as numbers (.exr,
        /// .pfm) or as grey levels (.png, .pgm) from -5 to 5
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,

        /// Overwrite the map if it exists
        #[arg(short, long)]
        force: bool,

        /// Print nothing but errors
        #[arg(short, long)]
        quiet: bool,
    },
    // Declare the verb merge
    /// Merge independent runs of the same scene as if they had been one
    Merge {
        /// Images to read, of different seeds
        #[arg(value_name = "FILE", required = true, num_args = 2..)]
        files: Vec<PathBuf>,

        #[command(flatten)]
        output: Output,
    },
    // Declare the verb stderr
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
struct Output {
    /// Image to write, in the format of its extension
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,

    /// Overwrite the image if it exists
    #[arg(short, long)]
    force: bool,
}

impl Output {
    // Check the target of the output
    /// The target of an image in one of the given formats.
    ///
    /// # Errors
    /// The format is another, or the target cannot be written.
    fn target(&self, formats: &[Format]) -> Result<ImageTarget, String> {
        let format = Format::of(&self.output)?;
        if formats.contains(&format) {
            return ImageTarget::file(&self.output, self.force);
        }
        // Name the formats that make sense
        let name = |f: &Format| format!(".{f:?}").to_ascii_lowercase();
        let names: Vec<_> = formats.iter().map(name).collect();
        let (path, names) = (self.output.display(), names.join(" or "));
        Err(format!("{path}: this image is written as {names}"))
    }
}

// Do what the verb says
fn main() -> ExitCode {
    let arguments: Arguments = match parse_command_line() {
        Ok(arguments) => arguments,
        Err(status) => return status,
    };
    run(&arguments.verb).unwrap_or_else(|message| {
        progress::error(&message);
        match arguments.verb {
            Verb::Diff { .. } => ExitCode::from(2),
            _ => ExitCode::FAILURE,
        }
    })
}

const GREY: [Format; 2] = [Format::Png, Format::Pgm];

fn run(verb: &Verb) -> Result<ExitCode, String> {
    match verb {
        Verb::Info { files } => inform(files)?,
        Verb::Tonemap { input, output, exposure, tonemap } => {
            // Show the radiances on a screen
            let target = output.target(&GREY)?;
            let image = Image::read(input)?;
            let grey = display::tonemap(&image, *exposure, *tonemap);
            target.write(&grey)?;
        }
        Verb::Merge { files, output } => {
            let target = output.target(&[Format::Exr])?;
            target.write(&merge(&read_all(files)?)?)?;
        }
        Verb::Stderr { input, output, relative } => {
            show_errors(input, output, *relative)?;
        }
        Verb::Diff { a, b, output, force, quiet } => {
            // Check the map before the comparison
            let map = output.as_ref();
            let map = map.map(|path| ImageTarget::file(path, *force));
            return diff(a, b, map.transpose()?, *quiet);
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Reads the images, each with the name of its file.
fn read_all(files: &[PathBuf]) -> Result<Vec<Run>, String> {
    let read = |path: &PathBuf| {
        Ok((path.display().to_string(), Image::read(path)?))
    };
    files.iter().map(read).collect()
}

fn show_errors(
    input: &Path,
    output: &Output,
    relative: bool,
) -> Result<(), String> {
    let target = output.target(&GREY)?;
    let image = Image::read(input)?;
    let (grey, white) = display::errors(&image, relative)
        .map_err(|fault| format!("{}: {fault}", input.display()))?;
    target.write(&grey)?;
    // Tell what white stands for
    let what = match relative {
        true => "relative standard error",
        false => "standard error",
    };
    say(&format!("white is a {what} of {white:.4e}"))
}

/// Prints lines on standard output, unless the reader has closed the pipe.
fn say(lines: &str) -> Result<(), String> {
    OutputTarget::standard_output()
        .write(&mut |out| writeln!(out, "{lines}"))
}

// Tell what an image holds
fn inform(files: &[PathBuf]) -> Result<(), String> {
    for (name, image) in read_all(files)? {
        say(&describe(&name, &image))?;
    }
    Ok(())
}

/// The lines that describe an image.
fn describe(name: &str, image: &Image) -> String {
    let Image { width, height, means, errors, samples, .. } = image;
    let mut lines = vec![
        format!("{name}: {width}x{height} pixels"),
        format!("channels: {}", channels(image)),
    ];
    // Describe the means and their errors
    let n = means.len() as f64;
    let mean = means.iter().sum::<f64>() / n;
    let squares = errors.as_ref().map(|errors| {
        let unknown = errors.iter().filter(|e| e.is_infinite()).count();
        (errors.iter().map(|e| e * e).sum::<f64>(), unknown)
    });
    // Tell the mean as well as it is known
    match squares {
        Some((squares, 0)) => {
            let (error, rmse) = (squares.sqrt() / n, (squares / n).sqrt());
            lines.push(format!("mean radiance: {mean:.6} ± {error:.6}"));
            lines.push(format!("rmse: {rmse:.6}"));
        }
        Some((_, unknown)) => {
            lines.push(format!("mean radiance: {mean:.6}, error unknown"));
            lines.push(format!("pixels of unknown error: {unknown}"));
        }
        None => lines.push(format!("mean radiance: {mean:.6}")),
    }
    let (least, most) = range(means);
    lines.push(format!("least and greatest: {least:.6}, {most:.6}"));
    // Describe the samples and the run
    if let Some(samples) = samples {
        let (least, most) = range(samples);
        lines.push(match least == most {
            true => format!("samples per pixel: {least}"),
            false => format!("samples per pixel: {least} to {most}"),
        });
    }
    let attributes = image.attributes.iter();
    lines
        .extend(attributes.map(|(name, value)| format!("{name}: {value}")));
    lines.join("\n  ")
}

fn channels(image: &Image) -> &str {
    match (&image.errors, &image.samples) {
        (Some(_), Some(_)) => "Y, stderr.Y, samples.Y",
        (Some(_), None) => "Y, stderr.Y",
        (None, Some(_)) => "Y, samples.Y",
        (None, None) => "Y",
    }
}

/// The least and the greatest of some values.
fn range(values: &[f64]) -> (f64, f64) {
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (least, most)
}

// Tell what distinguishes two images
fn diff(
    a: &Path,
    b: &Path,
    map: Option<ImageTarget>,
    quiet: bool,
) -> Result<ExitCode, String> {
    let (first, second) = (Image::read(a)?, Image::read(b)?);
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

/// A seed that two images of the same scene share; merged images
/// have several.
fn common_seed<'a>(a: &'a Image, b: &Image) -> Option<&'a str> {
    let of = |name| a.attributes.get(name).zip(b.attributes.get(name));
    if of("scene_sha256").is_some_and(|(a, b)| a != b) {
        return None;
    }
    let (a, b) = of("seed")?;
    a.split(',').find(|seed| b.split(',').any(|other| other == *seed))
}

/// The lines that explain a comparison.
fn explain(difference: &Difference) -> String {
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
            "errors: differences are {ratio:.3} times what they say \
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
             samples"
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
