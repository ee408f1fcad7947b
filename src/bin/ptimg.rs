// Tangled from chapters/ptimg.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command `ptimg`: show and compare images, and add states.

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::{env, fs};

use clap::{Args, Parser, Subcommand};
use glam::DVec3;
use serde_json::{Value, json};

use litpt::cli::files::keep_the_place;
use litpt::cli::options::{LICENCE, parse_words};
use litpt::cli::progress;
use litpt::cli::run::fail;
use litpt::cli::values::{only, parse_range, parse_real, parse_share};
use litpt::compare::display::{
    self, AUTO_EXPOSURE, Curve, Exposure, auto_stops, seeming_surfaces,
};
use litpt::compare::{compare, disagreements};
use litpt::error::{Error, Result};
use litpt::image::{Format, Image, OPACITY};
use litpt::matrix::daylight::Daylight as Coefficients;
use litpt::matrix::daylight::{Demand, Interval, SkyMatrix, Year};
use litpt::output::{OutputTarget, descriptor, format_of, refuse_aliases};
use litpt::plan::{Outputs, Product, is_dash};
use litpt::report::Kind;
use litpt::run_output::RunOutput;
use litpt::state::checkpoint::{Checkpoint, RunRecord};
use litpt::state::shards::{self, is_state_name};
use litpt::tally::{Tally, patches::Patches};
use signal_hook::consts::SIGXFSZ;
use signal_hook::flag;

/// Called when the program is loaded.
#[used]
#[cfg_attr(target_os = "linux", unsafe(link_section = ".init_array"))]
static BEFORE_MAIN: extern "C" fn() = keep_the_place;

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
    /// Multiply daylight coefficients with the sky of a year: daylight autonomy
    /// and useful daylight of each sensor, and the spatial daylight autonomy,
    /// with intervals that cover the truth in about 95 of 100 runs or more
    Daylight(Daylight),
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
struct Daylight {
    /// State of pt --sky-patches, of -o a.litpt or --checkpoint
    #[arg(value_name = "STATE")]
    state: PathBuf,

    /// Sky matrix of gendaymtx -O0, of text or binary numbers
    #[arg(value_name = "SKY")]
    sky: PathBuf,

    /// Table of the sensors to write, .csv
    #[arg(short, long, value_name = "OUT", default_value = "-")]
    output: PathBuf,

    /// Table to write of the illuminance in lux of each sensor at each hour
    /// that counts, .csv
    #[arg(long, value_name = "FILE")]
    illuminance: Option<PathBuf>,

    /// Hours of each day that count, the first and the one after the last, if
    /// the steps of SKY are hours; or
    /// a file with 0 or 1 for each time step
    #[arg(long, value_name = "A..B|FILE", default_value = "8..18")]
    hours: String,

    /// Illuminance in lux that suffices
    #[arg(long, value_name = "LUX", default_value = "300",
          value_parser = only(parse_real, |x| *x >= 0., "expected 0 or more"))]
    enough: f64,

    /// Part of the hours in which it must suffice for the spatial daylight
    /// autonomy
    #[arg(long, value_name = "PART", default_value = "0.5",
          value_parser = only(parse_share, |x| (0. ..=1.).contains(x), PART))]
    part: f64,

    /// Illuminances in lux between which daylight is useful
    #[arg(long, value_name = "LUX..LUX", default_value = "100..3000",
          value_parser = parse_interval)]
    useful: (f64, f64),

    /// Overwrite files that exist
    #[arg(short, long)]
    force: bool,
}

const PART: &str = "expected a part from 0 to 1, or a percentage";

/// Two numbers with two dots between, the smaller first.
fn parse_interval(text: &str) -> Result<(f64, f64), String> {
    let ends =
        text.split_once("..").ok_or("expected two numbers around ..")?;
    let (least, most) = (parse_real(ends.0)?, parse_real(ends.1)?);
    let fault = "expected the smaller number first";
    (least <= most).then_some((least, most)).ok_or(fault.to_owned())
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
    /// The target of an image, which on standard output has the requested
    /// format, or the usual one.
    fn target(&self, path: &Path, usual: Format) -> Result<Target> {
        if descriptor(path).is_none() && self.format.is_some() {
            let fault = "--format is for standard output; the name of a file \
                         tells its format";
            return Err(Error::from(fault).of_file(path));
        }
        let format = format_of(path, self.format.unwrap_or(usual))?;
        Ok((format, OutputTarget::file(path, self.force)?))
    }

    /// The targets of all outputs, each in one of these formats; the first
    /// format is usual.
    fn targets(&self, formats: &[Format]) -> Result<Vec<Target>> {
        let target = |path: &PathBuf| {
            let target = self.target(path, formats[0])?;
            if formats.contains(&target.0) {
                return Ok(target);
            }
            let (a, b) = (formats[0], formats[1]);
            let fault =
                format!("this image is written as .{a:?} or .{b:?}");
            Err(Error::from(fault.to_lowercase()).of_file(path))
        };
        self.output.iter().map(target).collect()
    }

    /// Whether something goes to standard output.
    fn is_standard(&self) -> bool {
        self.output.iter().any(|path| descriptor(path) == Some(1))
    }
}

/// The target of an image, and its format.
type Target = (Format, OutputTarget);

/// The formats of levels, which show an image.
const GREY: [Format; 2] = [Format::Pgm, Format::Png];

/// The formats that have colours.
const COLOUR: [Format; 2] = [Format::Png, Format::Exr];

/// The formats of levels, then the formats of numbers.
const ALL: [Format; 4] =
    [Format::Pgm, Format::Png, Format::Pfm, Format::Exr];

fn main() -> ExitCode {
    // A file beyond the limit of size is an error, not the end.
    let _ = flag::register(SIGXFSZ, Arc::default());
    let arguments: Arguments = match parse_words(env::args_os()) {
        Ok(arguments) => arguments,
        Err(error) => return fail(error).into(),
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
        Verb::Tonemap { input, to, exposure, tonemap, no_filter } => {
            // Make an image for the screen
            let targets = to.targets(&GREY)?;
            let mut image = read(input)?;
            image.more.retain(|(name, _)| !no_filter || *name == OPACITY);
            let image = display::picture(image);
            let stops = stops(*exposure, &image);
            let image = display::tonemap(&image, stops, *tonemap);
            targets.iter().try_for_each(|target| write(target, &image))?;
        }
        Verb::Rgb { bands, to, exposure } => join(bands, to, *exposure)?,
        Verb::Diff { a, b, to, quiet } => return diff([a, b], to, *quiet),
        Verb::Merge { files, to, report, partial } => {
            merge(files, to, report, *partial)?;
        }
        Verb::Daylight(asked) => daylight(asked)?,
        Verb::Stderr { input, to, relative } => {
            // Show the standard errors
            let targets = to.targets(&GREY)?;
            let (grey, white) = display::errors(&read(input)?, *relative)
                .map_err(|fault| fault.of_file(input))?;
            targets.iter().try_for_each(|target| write(target, &grey))?;
            let what = if *relative { "relative " } else { "" };
            let line =
                format!("white is a {what}standard error of {white:.4e}");
            match to.is_standard() {
                true => progress::inform(&line),
                false => say(&line)?,
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn write((format, target): &Target, image: &Image) -> Result<()> {
    target.write(&mut |out| format.write(image, out))
}

/// The stops for an image: those that its run has found, or those that suit
/// its pixels.
fn stops(exposure: Exposure, image: &Image) -> f64 {
    let found = image.attributes.get(AUTO_EXPOSURE);
    let found = found.and_then(|text| text.parse().ok());
    let error =
        |i: usize| image.errors.as_ref().map_or(1., |errors| errors[i]);
    let pixels = image.means.iter().enumerate();
    let pixels = pixels.map(|(i, &mean)| (mean, error(i)));
    let suit = || auto_stops(seeming_surfaces(pixels));
    let stops = exposure.stops(|| found.unwrap_or_else(suit));
    if exposure == Exposure::Auto {
        progress::inform(&format!("exposure {stops:+} stops"));
    }
    stops
}

/// Joins three bands to a colour image.
fn join(bands: &[PathBuf], to: &Output, exposure: Exposure) -> Result<()> {
    let targets = to.targets(&COLOUR)?;
    // Read the bands
    let mut printed = BTreeSet::new();
    let read = |path: &PathBuf| {
        Image::read_noting(path, &mut |fault| {
            let name = path.display().to_string();
            if printed.insert(fault.replace(&name, "")) {
                progress::warn(fault);
            }
        })
    };
    let images: Vec<_> = bands.iter().map(read).collect::<Result<_>>()?;
    for ((path, image), name) in
        bands.iter().zip(&images).zip("rgb".chars())
    {
        // Compare a band with the first
        let first = &images[0];
        if (image.width, image.height) != (first.width, first.height) {
            return Err(Error::from("it has another size").of_file(path));
        }
        let band = image.attributes.get("band");
        if let Some(band) = band.filter(|band| **band != name.to_string()) {
            let fault = format!("it is of --band {band}, not {name}");
            return Err(Error::from(fault).of_file(path));
        }
        let (first, other) = (&first.attributes, &image.attributes);
        let mut slips = disagreements(first, other);
        slips.retain(|slip| !slip.starts_with("materials "));
        if first.get("seed") != other.get("seed") {
            slips.push("it has another seed".to_owned());
        }
        for slip in slips {
            progress::warn(&format!("{}: {slip}", path.display()));
        }
    }
    let colours = display::join(&images);
    let errors = images[0].errors.clone();
    let stops = stops(exposure, &Image { errors, ..colours.clone() });
    let images = images.into_iter().map(display::picture);
    let images = images.map(|i| display::tonemap(&i, stops, Curve::Clamp));
    let shown = display::join(&Vec::from_iter(images));
    targets.iter().try_for_each(|target| match target.0 {
        Format::Png => write(target, &shown),
        _ => write(target, &colours),
    })
}

/// Merges the states of a run.
fn merge(
    files: &[PathBuf],
    to: &Output,
    reports: &[PathBuf],
    partial: bool,
) -> Result<()> {
    let written = to.output.iter().chain(reports).map(PathBuf::as_path);
    refuse_aliases(files.iter().map(PathBuf::as_path), written)?;
    // Find the targets of a merge
    let output = |path: &PathBuf| {
        if is_state_name(path) {
            return Ok((
                Product::State,
                OutputTarget::file(path, to.force)?,
            ));
        }
        format_of(path, Format::Exr).map_err(shards::or_state)?;
        let (format, target) = to.target(path, Format::Exr)?;
        Ok((Product::Image(format), target))
    };
    let report = |path: &PathBuf| {
        let product = Product::Report(Kind::of(path)?);
        Ok((product, OutputTarget::file(path, to.force)?))
    };
    let targets = to.output.iter().map(output);
    let targets = targets.chain(reports.iter().map(report));
    let targets = targets.collect::<Result<Vec<_>>>()?;
    let has = |is: fn(&Product) -> bool| {
        targets.iter().any(|(product, _)| is(product))
    };
    let states = files.iter().map(|path| Checkpoint::of_file(path));
    let merged = shards::merge(states)?;
    // Refuse an image of receivers
    let is_list = merged.record.run_key.subject.sensed.is_list();
    if is_list && has(|product| *product != Product::State) {
        return Err(
            "receivers have no image: merge to a state, -o a.litpt, \
                    and use pt --resume a.litpt -o a.csv"
                .into(),
        );
    }
    // Report the parts that are missing
    if let Some(missing) = &merged.missing {
        let missing = format!("parts are missing: {missing}");
        if !partial {
            return Err(format!("{missing} (see --partial)").into());
        } else if has(|product| *product == Product::State) {
            return Err(
                format!("{missing}: no state can be written").into()
            );
        }
        progress::warn(&missing);
    }
    // Warn of a picture that lacks the scene
    let run_key = &merged.record.run_key;
    let lack = match run_key.filtered {
        true => Some("is not filtered"),
        false => run_key.subject.sky.background.map(|_| "has no opacity"),
    };
    if let Some(lack) = lack.filter(|_| has(|product| product.is_picture()))
    {
        progress::warn(&format!(
            "the picture {lack}, for lack of the scene: merge to a state, \
             -o a.litpt, and use pt --resume a.litpt"
        ));
    }
    let convergence = merged.record.report.convergence.clone();
    let outputs = Outputs::default();
    let mut output = RunOutput::new(targets, &outputs, merged.record, None);
    output.write(&convergence, &merged.film, None)
}

/// Multiplies daylight coefficients with a sky.
fn daylight(asked: &Daylight) -> Result<()> {
    let Daylight { state, sky, output, illuminance, .. } = asked;
    let written = illuminance.iter().chain([output]);
    let read = [state.as_path(), sky].into_iter();
    refuse_aliases(read, written.map(PathBuf::as_path))?;
    let target = |path: &PathBuf| OutputTarget::file(path, asked.force);
    let table = target(output)?;
    let hourly = illuminance.as_ref().map(target).transpose()?;
    // Read the coefficients and the sky
    let mut checkpoint = Checkpoint::of_file(state)?;
    let RunRecord { run_key, rows, .. } = checkpoint.record.clone();
    let Some(Tally::SkyPatches(factor)) = run_key.subject.tally else {
        let fault = "holds no daylight coefficients, of pt --sky-patches";
        return Err(Error::from(fault).of_file(state));
    };
    let mut film = run_key.film();
    checkpoint.fill(&mut film)?;
    let file = if is_dash(sky) { Path::new("/dev/stdin") } else { sky };
    let bytes = fs::read(file).map_err(Error::cannot("read", sky))?;
    let year = SkyMatrix::read(&bytes).map_err(|e| e.of_file(sky))?;
    let steps = steps(&asked.hours, year.steps)?;
    let columns = Patches::new(factor, DVec3::Z).count();
    let coefficients = Coefficients { film: &film, rows: &rows, columns };
    let &Daylight { enough, part, useful, .. } = asked;
    let demand = Demand { enough, useful: useful.into(), hours: part };
    let found = Year::new(&coefficients, &year, &steps, demand)
        .map_err(|error| error.of_file(state))?;
    // Write the tables
    table.write(&mut |out| {
        writeln!(out, "row,da,da_low,da_high,udi,udi_low,udi_high")?;
        for (n, sensor) in (1..).zip(&found.sensors) {
            let Some(both) = sensor else { continue };
            let [da, udi] = both.map(|Interval { value, ends: [a, b] }| {
                format!("{value},{a},{b}")
            });
            writeln!(out, "{n},{da},{udi}")?;
        }
        Ok(())
    })?;
    let mut hours = |out: &mut dyn Write| {
        writeln!(out, "row,step,lux,stderr")?;
        for (n, sensor) in (1..).zip(0..rows.len()) {
            let light = coefficients.illuminance(sensor, &year, &steps);
            let Some(light) = light else { continue };
            let values = light.lux.iter().zip(light.standard_errors());
            for (step, (lux, error)) in steps.iter().zip(values) {
                writeln!(out, "{n},{step},{lux:.4},{error:.4}")?;
            }
        }
        Ok(())
    };
    hourly.map_or(Ok(()), |target| target.write(&mut hours))?;
    let Interval { value, ends: [a, b] } = found.spatial;
    let [value, a, b, part] = [value, a, b, part].map(|part| 100. * part);
    let part = words(&json!(part));
    progress::inform(&format!(
        "sDA {value:.1} % of the sensors, from {a:.1} to {b:.1} %, have \
         {enough} lux in {part} % of {} hours",
        steps.len()
    ));
    Ok(())
}

/// The time steps that count, of so many.
fn steps(hours: &str, count: usize) -> Result<Vec<usize>> {
    let fault =
        |fault: String| Error::from(format!("--hours {hours}: {fault}"));
    let counts: Vec<bool> = match parse_range(hours) {
        Ok((_, 25..)) => {
            return Err(fault("a day has 24 hours".to_owned()));
        }
        Ok(_) if !count.is_multiple_of(24) || count > 8784 => {
            return Err(fault(format!(
                "the sky has {count} steps, and not the hours of whole days \
                 of a year: a file of 0 and 1 tells which of them count"
            )));
        }
        Ok((from, to)) => {
            let hours = (0..24).cycle().take(count);
            hours.map(|hour| (from..to).contains(&hour)).collect()
        }
        Err(_) => {
            // Read which steps count
            let text = fs::read_to_string(hours).map_err(|error| {
                let wanted = "neither hours A..B, A below B, nor a file";
                fault(format!("{wanted} ({error})"))
            })?;
            let words = text.split(|c: char| c.is_whitespace() || c == ',');
            let words = words.filter(|word| !word.is_empty());
            let counts = words.map(|word| match word {
                "0" | "0.0" => Ok(false),
                "1" | "1.0" => Ok(true),
                _ => Err(fault(format!("'{word}' is neither 0 nor 1"))),
            });
            counts.collect::<Result<_>>()?
        }
    };
    if counts.len() != count {
        return Err(fault(format!(
            "{} steps, and the sky has {count}",
            counts.len()
        )));
    }
    let steps: Vec<_> = (0..count).filter(|&step| counts[step]).collect();
    match steps.is_empty() {
        true => Err(fault("no step counts".to_owned())),
        false => Ok(steps),
    }
}

/// Reads an image and warns of its faults.
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
                // Print the facts in lines
                let run = image.attributes.iter();
                let run = run.map(|(name, text)| (&name[..], json!(text)));
                let facts = facts.into_iter().chain(run);
                let facts =
                    facts.filter(|(_, v)| !v.is_null() && !v.is_object());
                let lines =
                    facts.map(|(name, v)| format!("{name}: {}", words(&v)));
                lines.collect::<Vec<_>>().join("\n")
            }
        })?;
    }
    Ok(())
}

/// The facts about an image, each with its name. The sums are over the
/// pixels whose means are finite numbers.
fn facts(path: &Path, image: &Image) -> [(&'static str, Value); 13] {
    // Sum the squares of the errors
    let is_finite = |&i: &usize| image.means[i].is_finite();
    let pixels = (0..image.means.len()).filter(is_finite);
    let sum = |list: &Vec<f64>| {
        pixels.clone().map(|i| list[i] * list[i]).sum::<f64>()
    };
    let errors = image.errors.as_ref();
    let unknown = errors.map_or(0, |e| {
        pixels.clone().filter(|&i| e[i].is_infinite()).count()
    });
    let of_pixels = errors.map(sum);
    let of_mean = image.tile_errors.as_ref().map(sum).or(of_pixels);
    let means: Vec<f64> = pixels.clone().map(|i| image.means[i]).collect();
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
        Value::Array(values) => {
            values.iter().map(words).collect::<Vec<_>>().join(", ")
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

fn diff(files: [&Path; 2], to: &Output, quiet: bool) -> Result<ExitCode> {
    if quiet {
        progress::set_quiet(true);
    } else if to.is_standard() {
        return Err("a map on standard output needs -q".into());
    }
    let maps = to.targets(&ALL)?;
    let (first, second) = (read(files[0])?, read(files[1])?);
    let difference = compare(&first, &second).map_err(|fault| {
        let [a, b] = files.map(Path::display);
        fault.of_file(format!("{a} and {b}"))
    })?;
    for map in &maps {
        let is_grey = GREY.contains(&map.0);
        write(map, &display::z_map(&first, &difference, is_grey))?;
    }
    if !quiet {
        let mut lines = vec![];
        // Report the assumptions of the comparison
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
        lines.push(difference.to_string());
        say(&lines.join("\n"))?;
    }
    Ok(ExitCode::from(u8::from(!difference.consistent())))
}
