// Tangled from chapters/ptimg.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command `ptimg`: show and compare images, and add states.

use std::collections::BTreeSet;
use std::env;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::slice::from_ref;
use std::sync::Arc;

use clap::{Args, Parser, Subcommand};
use serde_json::{Value, json};

use litpt::cli::options::{LICENCE, parse_words};
use litpt::cli::progress;
use litpt::cli::run::fail;
use litpt::compare::display::{
    self, AUTO_EXPOSURE, Curve, Exposure, auto_stops, seeming_surfaces,
};
use litpt::compare::{
    Difference, Dispersion, FEW, Scale, compare, disagreements,
};
use litpt::error::{Error, Result};
use litpt::film::SIDE;
use litpt::image::{BANDS, Format, Image, OPACITY, luminance};
use litpt::output::{OutputTarget, descriptor, format_of, refuse_aliases};
use litpt::plan::{Outputs, Product};
use litpt::report::Kind;
use litpt::run_output::RunOutput;
use litpt::state::shards::{self, is_state_name};
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
    Tonemap {
        /// Image to read
        #[arg(value_name = "IN")]
        input: PathBuf,

        #[command(flatten)]
        to: Output,

        /// Stops by which the image is made brighter, or auto: what is not sky
        /// fills the scale
        #[arg(short, long, value_name = "STOPS|auto", default_value = "0",
              allow_hyphen_values = true, value_parser = Exposure::parse)]
        exposure: Exposure,

        /// What becomes of radiances brighter than white
        #[arg(short, long, value_name = "CURVE", default_value = "clamp")]
        tonemap: Curve,

        /// Show the noise of a picture that was filtered
        #[arg(long)]
        no_filter: bool,
    },
    /// Join three images with the same seed, of --band r, g and b, to a colour
    /// image, .png or .exr
    Rgb {
        /// Red, green and blue
        #[arg(value_names = ["R", "G", "B"], num_args = 3, required = true)]
        bands: Vec<PathBuf>,

        #[command(flatten)]
        to: Output,

        /// Stops by which a .png is made brighter, or auto
        #[arg(short, long, value_name = "STOPS|auto", default_value = "0",
              allow_hyphen_values = true, value_parser = Exposure::parse)]
        exposure: Exposure,
    },
    /// Test whether chance alone explains the difference of two images:
    /// the status is 0 if so, 1 if not (wrong once in 100 pairs), and 2 if
    /// they cannot be compared
    #[command(mut_arg("output", |output| output.required(false).help(
        "Map of the differences in standard errors, as numbers (.exr, .pfm) \
         or as grey levels (.png, .pgm) from -5 to 5; - with -q"
    )))]
    Diff {
        /// Image to test
        #[arg(value_name = "A")]
        a: PathBuf,

        /// Image to test against; treated as exact if it has no error estimates
        #[arg(value_name = "B")]
        b: PathBuf,

        #[command(flatten)]
        to: Output,

        /// Print nothing but errors
        #[arg(short, long)]
        quiet: bool,
    },
    /// Merge states of parts of one run to the image of the whole, or to its
    /// state, .litpt, of which pt --resume makes the filtered picture
    Merge {
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
    },
    /// Show the standard error of each pixel as grey, in .png or .pgm
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

#[derive(Clone, Debug, Args)]
struct Output {
    /// Image to write; may be repeated; - is standard output
    #[arg(short, long, value_name = "OUT", required = true)]
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
    /// that was asked for, or the usual one; `grey` allows levels only.
    fn targets(&self, usual: Format, grey: bool) -> Result<Vec<Target>> {
        let target = |path: &PathBuf| {
            // Check one target
            let name = path.display();
            if descriptor(path).is_none() && self.format.is_some() {
                return Err(Error::from(
                    "--format is for standard output; the name of a file \
                     tells its format",
                )
                .of_file(name));
            }
            let format = format_of(path, self.format.unwrap_or(usual))?;
            let target = (format, OutputTarget::file(path, self.force)?);
            match grey && !is_grey(&target) {
                true => {
                    let fault = "this image is written as .pgm or .png";
                    Err(Error::from(fault).of_file(name))
                }
                false => Ok(target),
            }
        };
        self.output.iter().map(target).collect()
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
    // Report a fault by message and status
    run(&arguments.verb).unwrap_or_else(|error| {
        progress::error(&error.to_string());
        match arguments.verb {
            Verb::Diff { .. } => ExitCode::from(2),
            _ => ExitCode::FAILURE,
        }
    })
}

fn run(verb: &Verb) -> Result<ExitCode> {
    match verb {
        Verb::Info { files, json } => inform(files, *json)?,
        // Make an image for the screen
        Verb::Tonemap { input, to, exposure, tonemap, no_filter } => {
            let targets = to.targets(Format::Pgm, true)?;
            let image = looked_at(input, *no_filter)?;
            let stops = stops(*exposure, &image);
            let grey = display::tonemap(&image, stops, *tonemap);
            write(&targets, &Image { more: image.more, ..grey })?;
        }
        // Make a colour image of three
        Verb::Rgb { bands, to, exposure } => {
            let targets = to.targets(Format::Png, false)?;
            let has_colours =
                |t: &Target| [Format::Png, Format::Exr].contains(&t.0);
            if !targets.iter().all(has_colours) {
                return Err("colours are written as .png or .exr".into());
            }
            // Read the bands
            let mut told = BTreeSet::new();
            let read = |path: &PathBuf| {
                Image::read_noting(path, &mut |fault| {
                    let name = path.display().to_string();
                    if told.insert(fault.replace(&name, "")) {
                        progress::warn(fault);
                    }
                })
            };
            let images: Vec<_> =
                bands.iter().map(read).collect::<Result<_, _>>()?;
            for (i, (path, image)) in bands.iter().zip(&images).enumerate()
            {
                // Compare a band with the first
                let size = |image: &Image| (image.width, image.height);
                if size(image) != size(&images[0]) {
                    let fault = Error::from("it has another size");
                    return Err(fault.of_file(path.display()));
                }
                let [first, own] =
                    [&images[0], image].map(|image| &image.attributes);
                let wanted = ["r", "g", "b"][i];
                if let Some(band) =
                    own.get("band").filter(|band| *band != wanted)
                {
                    let path = path.display();
                    let fault =
                        format!("it is of --band {band}, not {wanted}");
                    return Err(Error::from(fault).of_file(path));
                }
                let mut others = disagreements(first, own);
                others.retain(|what| !what.starts_with("materials "));
                if first.get("seed") != own.get("seed") {
                    others.push("it has another seed".to_owned());
                }
                for what in others {
                    progress::warn(&format!("{}: {what}", path.display()));
                }
            }
            let colours = colours(&images);
            let errors = images[0].errors.clone();
            let stops =
                stops(*exposure, &Image { errors, ..colours.clone() });
            let images = images.into_iter().map(display::picture);
            let images: Vec<_> = images.collect();
            let expose = |band: &Image| Image {
                more: band.more.clone(),
                ..display::tonemap(band, stops, Curve::Clamp)
            };
            let shown =
                self::colours(&Vec::from_iter(images.iter().map(expose)));
            for target in &targets {
                let is_shown = target.0 == Format::Png;
                write(
                    from_ref(target),
                    if is_shown { &shown } else { &colours },
                )?;
            }
        }
        Verb::Merge { files, to, report, partial } => {
            // Merge the states of a run
            let written =
                to.output.iter().chain(report).map(PathBuf::as_path);
            refuse_aliases(files.iter().map(PathBuf::as_path), written)?;
            let outputs = to.output.iter().cloned();
            let (states, output): (Vec<_>, _) =
                outputs.partition(|path| is_state_name(path));
            let to = &Output { output, ..to.clone() };
            let images = to.targets(Format::Exr, false)?;
            // Find the targets of the reports
            let of_report = |path: &PathBuf| {
                let target = OutputTarget::file(path, to.force)?;
                Ok((Product::Report(Kind::of(path)?), target))
            };
            let images = images
                .into_iter()
                .map(|(f, to)| Ok((Product::Image(f), to)));
            let of_state = |path: &PathBuf| {
                Ok((Product::State, OutputTarget::file(path, to.force)?))
            };
            let targets = images.chain(report.iter().map(of_report));
            let targets = targets.chain(states.iter().map(of_state));
            let targets = targets.collect::<Result<Vec<_>>>()?;
            let merged = shards::merge(files)?;
            if merged.known.run_key.subject.sensed.is_list()
                && targets
                    .iter()
                    .any(|(product, _)| *product != Product::State)
            {
                return Err("receivers have no image: merge to a state, -o a.litpt, \
                            and use pt --resume a.litpt -o a.csv"
                    .into());
            }
            // Name the parts that are missing
            if let Some(missing) = &merged.missing {
                let missing = format!("parts are missing: {missing}");
                match partial {
                    true if states.is_empty() => progress::warn(&missing),
                    true => {
                        let fault =
                            format!("{missing}: no state can be written");
                        return Err(fault.into());
                    }
                    false => {
                        return Err(
                            format!("{missing} (see --partial)").into()
                        );
                    }
                }
            }
            // Write what was merged
            let mut products = targets.iter().map(|(product, _)| product);
            let run_key = &merged.known.run_key;
            let lack = match run_key.filtered {
                true => Some("is not filtered"),
                false => {
                    run_key.subject.sky.background.map(|_| "has no opacity")
                }
            };
            if let Some(lack) =
                lack.filter(|_| products.any(|p| p.is_picture()))
            {
                progress::warn(&format!(
                    "the picture {lack}, for lack of the scene: merge to a state, \
                     -o a.litpt, and use pt --resume a.litpt"
                ));
            }
            let convergence = merged.known.report.convergence.clone();
            let mut output = RunOutput::new(
                targets,
                &Outputs::default(),
                merged.known,
                None,
            );
            output.write(&convergence, &merged.film, None)?;
        }
        Verb::Stderr { input, to, relative } => {
            // Show the standard errors
            let targets = to.targets(Format::Pgm, true)?;
            let image = read(input)?;
            let (grey, white) = display::errors(&image, *relative)
                .map_err(|fault| fault.of_file(input.display()))?;
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
            // Answer with the status of a test
            if *quiet {
                progress::set_quiet(true);
            } else if to.is_standard() {
                return Err("a map on standard output needs -q".into());
            }
            return diff([a, b], &to.targets(Format::Pgm, false)?);
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Where an image goes, and in which format.
type Target = (Format, OutputTarget);

fn is_grey((format, _): &Target) -> bool {
    [Format::Pgm, Format::Png].contains(format)
}

fn write(targets: &[Target], image: &Image) -> Result<()> {
    targets.iter().try_for_each(|(format, target)| {
        target.write(&mut |out| format.write(image, out))
    })
}

/// What is to be seen of an image, perhaps without its filter.
fn looked_at(path: &Path, no_filter: bool) -> Result<Image> {
    let mut image = read(path)?;
    image.more.retain(|(name, _)| !no_filter || *name == OPACITY);
    Ok(display::picture(image))
}

/// The stops for an image: those that its run has found, or what its pixels
/// tell.
fn stops(exposure: Exposure, image: &Image) -> f64 {
    let found = image.attributes.get(AUTO_EXPOSURE);
    let found = found.and_then(|text| text.parse().ok());
    let error = |i: usize| image.errors.as_ref().map_or(1., |all| all[i]);
    let pixels = image.means.iter().enumerate();
    let pixels = pixels.map(|(i, &mean)| (mean, error(i)));
    let tell = || auto_stops(seeming_surfaces(pixels));
    let stops = exposure.stops(|| found.unwrap_or_else(tell));
    if exposure == Exposure::Auto {
        progress::inform(&format!("exposure {stops:+} stops"));
    }
    stops
}

/// One image of three bands, whose means are the luminance.
fn colours(bands: &[Image]) -> Image {
    let mut more = vec![];
    for (i, image) in bands.iter().enumerate() {
        more.push((BANDS[i], image.means.clone()));
        let errors = image.errors.iter().cloned();
        more.extend(errors.map(|all| (BAND_ERRORS[i], all)));
    }
    let Image { width, height, means, .. } = &bands[0];
    let pixel =
        |i: usize| luminance(&[0, 1, 2].map(|k: usize| bands[k].means[i]));
    let means = (0..means.len()).map(pixel).collect();
    let opacity = bands[0].channel(OPACITY).cloned();
    more.extend(opacity.map(|all| (OPACITY, all)));
    let mut attributes = bands[0].attributes.clone();
    attributes.retain(|name, value| {
        let has = |image: &Image| image.attributes.get(name) == Some(value);
        bands.iter().all(has)
    });
    Image { more, attributes, ..Image::plain(*width, *height, means) }
}

const BAND_ERRORS: [&str; 3] = ["stderr.R", "stderr.G", "stderr.B"];

/// Reads an image and warns of what is not as it should be.
fn read(path: &Path) -> Result<Image> {
    Image::read_noting(path, &mut progress::warn)
}

/// Prints lines on standard output, unless the reader has closed the pipe.
fn say(lines: &str) -> Result<()> {
    OutputTarget::standard_output()?
        .write(&mut |out| writeln!(out, "{lines}"))
}

fn inform(files: &[PathBuf], json: bool) -> Result<()> {
    for path in files {
        let image = read(path)?;
        let facts = facts(path, &image);
        say(&match json {
            true => Value::from_iter(facts).to_string(),
            false => {
                // Put the facts into lines
                let own = image.attributes.iter();
                let own = own.map(|(name, text)| (&name[..], json!(text)));
                let known = facts.into_iter().chain(own);
                let known =
                    known.filter(|(_, v)| !v.is_null() && !v.is_object());
                let lines =
                    known.map(|(name, v)| format!("{name}: {}", words(&v)));
                lines.collect::<Vec<_>>().join("\n")
            }
        })?;
    }
    Ok(())
}

/// What there is to know of an image, each by its name. The sums are those
/// of pixels whose means are finite numbers.
fn facts(path: &Path, image: &Image) -> [(&'static str, Value); 13] {
    // Sum the squares of the errors
    let known = |list: &Vec<f64>| -> Vec<f64> {
        let pairs = list.iter().zip(&image.means);
        let known = pairs.filter(|(_, mean)| mean.is_finite());
        known.map(|(&value, _)| value).collect()
    };
    let squares = |list: Vec<f64>| list.iter().map(|e| e * e).sum::<f64>();
    let errors = image.errors.as_ref().map(known);
    let unknown =
        errors.iter().flatten().filter(|e| e.is_infinite()).count();
    let of_pixels = errors.map(squares);
    let of_tiles = image.tile_errors.as_ref().map(known).map(squares);
    let of_mean = of_tiles.or(of_pixels);
    let means = known(&image.means);
    let n = means.len() as f64;
    let (least, greatest) = range(&means).unzip();
    let names = image.channels().map(|(name, ..)| name);
    let samples = image.samples.as_deref().and_then(range);
    [
        ("file", json!(path.display().to_string())),
        ("width", json!(image.width)),
        ("height", json!(image.height)),
        ("channels", json!(names.collect::<Vec<_>>())),
        ("mean", json!(means.iter().sum::<f64>() / n)),
        ("mean_stderr", json!(of_mean.map(|sum| sum.sqrt() / n))),
        ("rmse", json!(of_pixels.map(|sum| f64::sqrt(sum / n)))),
        ("unknown_errors", json!(unknown)),
        ("not_finite", json!(image.means.len() - means.len())),
        ("least", json!(least)),
        ("greatest", json!(greatest)),
        ("samples", json!(samples)),
        ("attributes", json!(image.attributes)),
    ]
}

/// A value as people read it.
fn words(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(all) => {
            all.iter().map(words).collect::<Vec<_>>().join(", ")
        }
        number => {
            let number = number.as_f64().unwrap_or(f64::NAN);
            ((1e6 * number).round() / 1e6).to_string()
        }
    }
}

/// The least and the greatest of some values, if there is one.
fn range(values: &[f64]) -> Option<(f64, f64)> {
    let least = values.iter().copied().reduce(f64::min)?;
    Some((least, values.iter().copied().reduce(f64::max)?))
}

fn diff(files: [&PathBuf; 2], maps: &[Target]) -> Result<ExitCode> {
    let (first, second) = (read(files[0])?, read(files[1])?);
    let difference = compare(&first, &second).map_err(|fault| {
        let [a, b] = files.map(|path| path.display());
        fault.of_file(format!("{a} and {b}"))
    })?;
    for map in maps {
        let image = display::z_map(&first, &difference, is_grey(map));
        write(from_ref(map), &image)?;
    }
    if !progress::is_quiet() {
        let mut lines = vec![];
        // Say what the comparison takes for granted
        let differing =
            disagreements(&first.attributes, &second.attributes);
        if !differing.is_empty() {
            let differing = differing.join(", ");
            lines.push(format!("they show different things: {differing}"));
        }
        for (path, image) in files.iter().zip([&first, &second]) {
            if image.errors.is_none() {
                let name = path.display();
                lines.push(format!(
                    "{name}: no error estimates; treated as exact"
                ));
            }
        }
        let both = |name| {
            first.attributes.get(name).zip(second.attributes.get(name))
        };
        if let Some((seed, other)) = both("seed")
            && seed == other
            && both("scene_sha256").is_none_or(|(a, b)| a == b)
        {
            progress::warn(&format!(
                "both images come from seed {seed}: they share random \
                 numbers, and may agree better than independent ones would"
            ));
        }
        lines.push(explain(&difference));
        say(&lines.join("\n"))?;
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
    let blocks = format!("blocks of {SIDE}x{SIDE}");
    let names = ["pixels", &blocks, "image"];
    for (name, scale) in names.into_iter().zip(&difference.scales) {
        // Describe a scale
        let &Scale { tested, failed: n, largest: (z, x, y) } = scale;
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
    failed.extend(beyond.then_some("errors"));
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
    lines.push(match &failed.join(", ")[..] {
        "" => "consistent: chance alone may explain the difference".into(),
        failed => format!(
            "inconsistent: chance alone does not explain the difference \
             (failed: {failed})"
        ),
    });
    lines.join("\n")
}
