// Tangled from chapters/ptimg.nw; edit there.
// Copyright (C) 2026 litpt contributors
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
use litpt::options::{LICENCE, is_dash, parse_real, parse_words};
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
#[command(name = "ptimg", version, after_help = LICENCE)]
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
    /// Make an image for the screen, .png or .pgm
    #[command(mut_arg("output", |output| output.required(true)))]
    Tonemap {
        /// Image to read
        #[arg(value_name = "IN")]
        input: PathBuf,

        #[command(flatten)]
        to: Output,

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
    #[command(mut_arg("output", |output| output.help(
        "Map of the differences in standard errors, as numbers (.exr, .pfm) \
         or as grey levels (.png, .pgm) from -5 to 5; - with -q"
    )))]
    Diff {
        /// Image to test
        #[arg(value_name = "A")]
        a: PathBuf,

        /// Image to test against; taken as exact if it says no errors
        #[arg(value_name = "B")]
        b: PathBuf,

        #[command(flatten)]
        to: Output,

        /// Print nothing but errors
        #[arg(short, long)]
        quiet: bool,
    },
    /// Merge states of parts of one run to the image of the whole
    #[command(mut_arg("output", |output| output.required(true)))]
    Merge(Merge),
    /// Show the standard error of each pixel as grey, in .png or .pgm
    #[command(mut_arg("output", |output| output.required(true)))]
    Stderr {
        /// Image to read
        #[arg(value_name = "IN")]
        input: PathBuf,

        #[command(flatten)]
        to: Output,

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

    #[command(flatten)]
    to: Output,

    /// Report of the run whose parts are merged, .json, .csv or .html; may
    /// be repeated
    #[arg(long, value_name = "FILE")]
    report: Vec<PathBuf>,

    /// Merge what there is, even if parts of the run are missing
    #[arg(long)]
    partial: bool,
}

#[derive(Debug, Args)]
struct Output {
    /// Image to write; may be repeated; - is standard output
    #[arg(short, long, value_name = "OUT")]
    output: Vec<PathBuf>,

    /// Format on standard output [default: exr of a merge, else pgm]
    #[arg(long, value_name = "FORMAT", hide_possible_values = true)]
    format: Option<Format>,

    /// Overwrite files that exist
    #[arg(short, long)]
    force: bool,
}

impl Output {
    /// The targets of an image, which on standard output has the format
    /// that was asked for, or the usual one.
    fn targets(&self, usual: Format) -> Result<Vec<ImageTarget>, String> {
        let target = |path: &PathBuf| match (descriptor(path), self.format)
        {
            (None, Some(_)) => Err(format!(
                "{}: --format is for standard output; the name of a file \
                 tells its format",
                path.display()
            )),
            (_, format) => {
                ImageTarget::file(path, format.unwrap_or(usual), self.force)
            }
        };
        self.output.iter().map(target).collect()
    }

    /// The targets of an image of grey levels.
    fn grey_targets(&self) -> Result<Vec<ImageTarget>, String> {
        let targets = self.targets(Format::Pgm)?;
        let numbers = targets.iter().position(|target| !is_grey(target));
        match numbers {
            None => Ok(targets),
            Some(at) => Err(format!(
                "{}: this image is written as .pgm or .png",
                self.output[at].display()
            )),
        }
    }

    /// Whether something goes to standard output.
    fn is_standard(&self) -> bool {
        self.output.iter().any(|path| descriptor(path) == Some(1))
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

fn run(verb: &Verb) -> Result<ExitCode, String> {
    match verb {
        Verb::Info { files, json } => inform(files, *json)?,
        Verb::Tonemap { input, to, exposure, tonemap } => {
            let targets = to.grey_targets()?;
            let image = read(input)?;
            let grey = display::tonemap(&image, *exposure, *tonemap);
            write(&targets, &grey)?;
        }
        Verb::Merge(merge) => merge.run()?,
        Verb::Stderr { input, to, relative } => {
            // Show the standard errors
            let targets = to.grey_targets()?;
            let image = read(input)?;
            let (grey, white) = display::errors(&image, *relative)
                .map_err(|fault| format!("{}: {fault}", input.display()))?;
            write(&targets, &grey)?;
            let what = if *relative { "relative " } else { "" };
            let line =
                format!("white is a {what}standard error of {white:.4e}");
            match to.is_standard() {
                true => progress::inform(&line),
                false => say(&line)?,
            }
        }
        Verb::Diff { a, b, to, quiet } => {
            if to.is_standard() && !quiet {
                return Err("a map on standard output needs -q".to_owned());
            }
            return diff([a, b], &to.targets(Format::Pgm)?, *quiet);
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn is_grey(target: &ImageTarget) -> bool {
    [Format::Pgm, Format::Png].contains(&target.format())
}

fn write(targets: &[ImageTarget], image: &Image) -> Result<(), String> {
    targets.iter().try_for_each(|target| target.write(image))
}

impl Merge {
    fn run(&self) -> Result<(), String> {
        let files = self.files.iter().map(PathBuf::as_path);
        let written = self.to.output.iter().chain(&self.report);
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
        let images = self.to.targets(Format::Exr)?;
        let report = |path: &PathBuf| {
            Ok((Kind::of(path)?, OutputTarget::file(path, self.to.force)?))
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
        write(&images, &image)?;
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
    files: impl Iterator<Item = &'a PathBuf>,
) -> Result<(), String> {
    match files.filter(|path| is_dash(path)).count() {
        0 | 1 => Ok(()),
        _ => Err("standard input can be read once only".to_owned()),
    }
}

/// Prints lines on standard output, unless the reader has closed the pipe.
fn say(lines: &str) -> Result<(), String> {
    OutputTarget::standard_output()?
        .write(&mut |out| writeln!(out, "{lines}"))
}

fn inform(files: &[PathBuf], json: bool) -> Result<(), String> {
    read_once(files.iter())?;
    for path in files {
        let info = Info::of(path.display().to_string(), read(path)?);
        say(&match json {
            true => serde_json::to_string(&info)
                .map_err(|error| error.to_string())?,
            false => info.describe(),
        })?;
    }
    Ok(())
}

/// What there is to know of an image.
#[derive(Serialize)]
struct Info {
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

impl Info {
    fn of(file: String, image: Image) -> Self {
        let Image { width, height, means, errors, tile_errors, .. } =
            &image;
        let known = |i: &usize| means[*i].is_finite();
        let pixels: Vec<_> = (0..means.len()).filter(known).collect();
        let all = |list: &[f64]| pixels.iter().map(|&i| list[i]).collect();
        let means: Vec<f64> = all(means);
        let n = means.len() as f64;
        // Sum the squares of the errors
        let squares = |list: &Option<Vec<f64>>| -> Option<f64> {
            let squares: Vec<f64> = all(list.as_ref()?);
            Some(squares.iter().map(|error| error * error).sum())
        };
        let errors_known: Option<Vec<f64>> = errors.as_deref().map(all);
        let unknown =
            errors_known.iter().flatten().filter(|e| e.is_infinite());
        let unknown_errors = unknown.count();
        let shared = squares(tile_errors);
        let squares =
            squares(errors).filter(|_| unknown_errors == 0 && n > 0.);
        let of_mean = squares.map(|squares| shared.unwrap_or(squares));
        let of_mean = of_mean.filter(|squares| squares.is_finite());
        let (least, greatest) = range(&means).unzip();
        Self {
            file,
            width: *width,
            height: *height,
            channels: channels(&image),
            mean: (n > 0.).then(|| means.iter().sum::<f64>() / n),
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
        let &Self { width, height, mean, rmse, .. } = self;
        let count = |n: usize| (n > 0).then(|| n.to_string());
        // Tell the mean and the samples
        let mean = mean.map(|mean| match self.mean_stderr {
            Some(error) => format!("{mean:.6} ± {error:.6}"),
            None if self.unknown_errors > 0 => {
                format!("{mean:.6}, error unknown")
            }
            None => format!("{mean:.6}"),
        });
        let samples =
            self.samples.map(|(least, most)| match least == most {
                true => least.to_string(),
                false => format!("{least} to {most}"),
            });
        let extremes = self.least.zip(self.greatest);
        let lines = [
            ("channels", Some(self.channels.join(", "))),
            ("mean radiance", mean),
            ("rmse", rmse.map(|rmse| format!("{rmse:.6}"))),
            ("pixels of unknown error", count(self.unknown_errors)),
            ("pixels that are not finite numbers", count(self.not_finite)),
            (
                "least and greatest",
                extremes.map(|(a, b)| format!("{a:.6}, {b:.6}")),
            ),
            ("samples per pixel", samples),
        ];
        let lines = lines
            .into_iter()
            .filter_map(|(name, text)| Some((name, text?)));
        let own = self.attributes.iter();
        let own = own.map(|(name, text)| (&name[..], text.clone()));
        let first = format!("{}: {width}x{height} pixels", self.file);
        lines.chain(own).fold(first, |text, (name, value)| {
            text + &format!("\n  {name}: {value}")
        })
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
    files: [&PathBuf; 2],
    maps: &[ImageTarget],
    quiet: bool,
) -> Result<ExitCode, String> {
    read_once(files.into_iter())?;
    let note = &mut |line: &str| {
        if !quiet {
            progress::warn(line);
        }
    };
    let [first, second] = files.map(|path| Image::read_noting(path, note));
    let (first, second) = (first?, second?);
    let difference = compare(&first, &second).map_err(|fault| {
        let [a, b] = files.map(|path| path.display());
        format!("{a} and {b}: {fault}")
    })?;
    for map in maps {
        map.write(&display::z_map(&first, &difference, is_grey(map)))?;
    }
    if !quiet {
        // Say what the comparison takes for granted
        let differing =
            disagreements(&first.attributes, &second.attributes);
        if !differing.is_empty() {
            let differing = differing.join(", ");
            say(&format!("they show different things: {differing}"))?;
        }
        for (path, image) in files.iter().zip([&first, &second]) {
            if image.errors.is_none() {
                let name = path.display();
                say(&format!("{name}: no errors; it is taken as exact"))?;
            }
        }
        let of = |name| {
            let [a, b] =
                [&first, &second].map(|image| image.attributes.get(name));
            a.zip(b)
        };
        let same_scene = of("scene_sha256").is_none_or(|(a, b)| a == b);
        if let Some((seed, _)) =
            of("seed").filter(|(a, b)| a == b && same_scene)
        {
            progress::warn(&format!(
                "both images come from seed {seed}: they share random \
                 numbers, and may agree better than independent ones would"
            ));
        }
        say(&explain(&difference))?;
    }
    Ok(ExitCode::from(u8::from(!difference.consistent())))
}

/// The lines that explain a comparison.
fn explain(difference: &Difference) -> String {
    if difference.identical {
        return "identical: all pixels have the same values".to_owned();
    }
    let &Difference { rmse, relative_mse, sum, .. } = difference;
    let (n, z) = (sum.pixels as f64, sum.z());
    let (mean, error) = (sum.difference / n, sum.variance.sqrt() / n);
    let mut lines = vec![
        format!("root mean square difference: {rmse:.6}"),
        format!("relative mean square difference: {relative_mse:.6}"),
        format!("mean difference: {mean:.6} ± {error:.6} (z = {z:.2})"),
    ];
    let mut failed = vec![];
    // Tell what the tests have found
    for &Scale { side, tested, failed: n, largest: (z, x, y) } in
        &difference.scales
    {
        let name = match side {
            1 => "pixels".to_owned(),
            u32::MAX => "image".to_owned(),
            side => format!("blocks of {side}x{side}"),
        };
        let z = z.abs();
        lines.push(match (tested, n) {
            (0, _) => format!("{name}: not tested"),
            (1, 0) => format!("{name}: |z| {z:.2}, not beyond chance"),
            (1, _) => format!("{name}: |z| {z:.2}, beyond chance"),
            _ => format!(
                "{name}: {tested} tested, largest |z| {z:.2} at {x},{y}, \
                 {n} beyond chance"
            ),
        });
        failed.extend((n > 0).then_some(name));
    }
    // Tell whether the errors are plausible
    let Dispersion { ratio, z, failed: beyond, pixels } =
        difference.dispersion;
    if pixels > 0 {
        let verdict = if beyond { "beyond" } else { "no more than" };
        lines.push(format!(
            "errors: differences {ratio:.3} times as large \
             (z = {z:.2}), {verdict} chance"
        ));
    }
    failed.extend(beyond.then(|| "errors".to_owned()));
    // Name the pixels that were left out
    let &Difference { unknown, few, .. } = difference;
    if unknown > 0 {
        lines
            .push(format!("not tested: {unknown} pixels of unknown error"));
    }
    if few > 0 {
        lines.push(format!(
            "not tested one by one: {few} pixels of fewer than {FEW} \
             independent samples"
        ));
    }
    // Conclude with the verdict in words
    lines.push(match failed.is_empty() {
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
