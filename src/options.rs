// Tangled from chapters/options.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command line of `pt`: options, defaults and checks.
//!
//! Words go in; options or an error come out. Nothing here reads a file, and
//! nothing is printed.

use std::ffi::OsString;
use std::fmt::Display;
use std::num::{IntErrorKind, ParseIntError};
use std::os::unix::ffi::OsStringExt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::{Duration, Instant};

use clap::builder::{ArgPredicate, StyledStr};
use clap::parser::ValueSource;
use clap::{ArgMatches, Id, Parser, ValueEnum};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::bvh::Isa;
use crate::camera::{View, Viewpoint};
use crate::compare::display::Exposure;
use crate::film::{Measure, SIDE, Window, digits, parse_size};
use crate::image::Format;
use crate::materials::Band;
use crate::output::descriptor;
use crate::render::choose::{Wanted, parse_method};
use crate::scene::encoding::shortened;
use crate::sensor::Side;
use crate::sky::Cover;
use crate::state::key::{Part, whole_window};
use crate::state::shards::is_state_name;

/// Renders a Wavefront OBJ of diffuse surfaces under a sky, or tells how much
/// light arrives at points and on faces.
#[derive(Clone, Debug, Parser, Serialize, Deserialize)]
#[command(name = "pt", version, args_override_self = true,
          after_help = format!("{EXAMPLES}\n\n{STATUS}\n\n{LICENCE}"))]
pub struct Options {
    /// Resolution of the image in pixels, each at most 16384
    #[arg(short = 'd', long, visible_alias = "definition",
          value_name = "WIDTHxHEIGHT",
          default_value = "320x240", value_parser = parse_size)]
    pub resolution: (u32, u32),

    /// Render only this part: the column and row of its first pixel, and its
    /// size, as in 100,50,64x48
    #[arg(long, value_name = "X,Y,WIDTHxHEIGHT",
          conflicts_with = "receivers",
          value_parser = |text: &str| Window::try_from(text.to_owned()))]
    pub crop: Option<Window>,

    /// Samples (paths) per pixel [default: 1] or receiver [default: 1024]; an
    /// upper bound with --time or --error
    #[arg(short = 'n', long = "spp", visible_alias = "realisations",
          value_name = "N",
          value_parser = only(parse_whole, |&n| n > 0, SAMPLES))]
    // A checkpoint knows options by their fields: that of --samples is `range`.
    pub samples: Option<u64>,

    /// Render only the samples A to B - 1 of the N of --spp: a part of a run
    /// for ptimg merge; 0..0 has no sample, and only learns
    #[arg(long = "samples", value_name = "A..B", value_parser = parse_range)]
    pub range: Option<(u64, u64)>,

    /// Render only the K-th of N bands of the image: a part of a run for
    /// ptimg merge
    #[arg(long, value_name = "K/N", value_parser = parse_band)]
    pub tiles: Option<(u32, u32)>,

    /// Take what another part of this run, of the same -n, has learnt from its
    /// state, instead of learning it again; the image does not depend on it
    #[arg(long, value_name = "FILE", conflicts_with = "resume")]
    pub learnt: Option<PathBuf>,

    /// Stop within so many seconds from the start of the program; pixels
    /// without a sample are then filled from around them in .pgm and .png, and
    /// NaN in .pfm and .exr
    #[arg(long, value_name = "SECONDS",
          value_parser = only(parse_real, |&x| x > 0., POSITIVE))]
    pub time: Option<f64>,

    /// Stop when the root mean square error of the pixels, whose unit is the
    /// radiance of the sky, is at most this; with a per cent sign, relative to
    /// the mean of each
    #[arg(long, value_name = "RMSE[%]", value_parser = parse_target)]
    pub error: Option<Target>,

    /// Hold the error of the worst pixel against --error, max, and not the root
    /// mean square of all, rms
    #[arg(
        long,
        value_name = "rms|max",
        default_value = "rms",
        hide_possible_values = true,
        requires = "error"
    )]
    pub error_of: ErrorOf,
    /// Position of the camera [default: outside of the scene, or
    /// 0,0,0 with -t]
    #[arg(short, long, value_name = "X,Y,Z", value_parser = parse_vector,
          conflicts_with = "receivers")]
    pub position: Option<DVec3>,

    /// Point that the camera looks at [default: the scene, or
    /// 0,1,0 with -p]
    #[arg(short, long, value_name = "X,Y,Z", value_parser = parse_vector,
          conflicts_with = "receivers")]
    pub target: Option<DVec3>,

    /// Up axis of the camera; its largest component tells where the sky is,
    /// unless --zenith does
    #[arg(short, long, value_name = "X,Y,Z|x|y|z", default_value = "0,0,1",
          value_parser = parse_direction)]
    pub up: DVec3,

    /// Vertical field of view in degrees, strictly between 0 and 180
    #[arg(short = 'F', long, value_name = "DEGREES", default_value = "70",
          value_parser = only(parse_real, |&x| x > 0. && x < 180., ANGLE))]
    pub fov: f64,

    /// Show all of the scene from a side: front (-y, or z if y is up), back,
    /// left, right, top or iso [default: iso, without -p and -t]
    #[arg(long = "view", value_name = "SIDE", hide_possible_values = true,
          conflicts_with_all = ["position", "target", "receivers"])]
    pub viewpoint: Option<Viewpoint>,

    /// Instead of an image, the irradiance at the points of a file, relative to
    /// that of a horizontal surface in the open: lines x y z nx ny nz
    #[arg(long, value_name = "FILE", group = "receivers")]
    pub points: Option<PathBuf>,

    /// The same of each face: its front, its back, or both
    #[arg(long, value_name = "SIDE", group = "receivers", num_args = 0..=1,
          default_missing_value = "front", require_equals = true,
          hide_possible_values = true)]
    pub faces: Option<Side>,

    /// The same at each vertex, with the normal of the faces around it
    #[arg(long, group = "receivers")]
    pub vertices: bool,

    /// What leaves a face instead of what arrives there
    #[arg(long, requires = "faces")]
    pub radiosity: bool,
    /// Albedo of all surfaces, between 0 and 1, or of a material, group or
    /// object of the file, as in floor=0.2; may be repeated
    #[arg(short = 'r', long = "albedo", visible_alias = "reflectivity",
          value_name = "[NAME=]ALBEDO", default_value = "1",
          value_parser = parse_named_albedo)]
    pub albedos: Vec<(String, f64)>,

    /// Give each face the luminance of the diffuse reflectivity (Kd, linear) of
    /// its material
    #[arg(long, default_value_if("band", ArgPredicate::IsPresent, "true"))]
    pub materials: bool,

    /// Take one of the three numbers of each material, r, g or b, instead of the
    /// luminance; implies --materials
    #[arg(long, value_name = "BAND", hide_possible_values = true)]
    pub band: Option<Band>,

    /// Sky: uniform; overcast, three times as bright at the zenith as at the
    /// horizon; or sphere, uniform and below the horizon too, as for ambient
    /// occlusion; each gives 1 to a horizontal surface in the open
    #[arg(
        long,
        value_name = "SKY",
        default_value = "uniform",
        hide_possible_values = true
    )]
    pub sky: Cover,

    /// Direction to the middle of the sky [default: the axis nearest to -u]
    #[arg(long, value_name = "X,Y,Z|x|y|z", value_parser = parse_direction)]
    pub zenith: Option<DVec3>,

    /// Albedo of an endless ground below the scene
    #[arg(long, value_name = "ALBEDO", value_parser = parse_albedo)]
    pub ground: Option<f64>,

    /// Wavefront OBJ, also .gz or .zst [default: standard input, as is -]
    #[arg(value_name = "FILE", overrides_with = "input")]
    pub scene: Option<PathBuf>,

    /// The scene, as FILE alone
    #[arg(short, long, value_name = "FILE", overrides_with = "scene")]
    pub input: Option<PathBuf>,
    /// Image to write, .pgm, .png, .pfm or .exr; values of receivers, .csv, .ply
    /// or, of vertices, .obj; or the state of the run, .litpt, as --checkpoint
    /// does; may be repeated [default: -, standard output, or on a terminal a
    /// PNG beside the scene]
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,

    /// Format of an image on standard output: pgm, png, pfm or exr
    /// [default: pgm]
    #[arg(long, value_name = "FORMAT", hide_possible_values = true)]
    pub format: Option<Format>,

    /// Write PNG files every second while the image is rendered
    #[arg(long, conflicts_with = "receivers")]
    pub preview: bool,

    /// Stops by which .png and pages are brighter, or auto: what is not sky fills
    /// the scale [default: 0; auto for pages and for a picture that is not
    /// named]
    #[arg(long, value_name = "STOPS|auto", value_parser = Exposure::parse,
          conflicts_with = "receivers")]
    pub exposure: Option<Exposure>,

    /// Show a grey of this radiance behind the scene and its ground instead of the
    /// sky, and give .png and .exr an opacity
    #[arg(long, value_name = "RADIANCE", conflicts_with = "receivers",
          value_parser = only(parse_share, |&x| x >= 0., NOT_NEGATIVE))]
    pub background: Option<f64>,

    /// Show the noise of gathers and nets in .png and .html, and write no
    /// filtered channels in .exr
    #[arg(long)]
    pub no_filter: bool,

    /// Overwrite files that exist
    #[arg(short, long)]
    pub force: bool,

    /// Seed of the random numbers
    #[arg(short, long, value_name = "SEED", default_value = "0",
          value_parser = parse_whole)]
    pub seed: u64,

    /// Number of threads; the image does not depend on it [default: all cores]
    #[arg(short = 'j', long, value_name = "N",
          value_parser = only(parse_whole, |n| (1..=4096).contains(n), THREADS))]
    pub threads: Option<u64>,

    /// How samples are made: reference, paths of independent numbers; sobol,
    /// the same paths placed by scrambled nets; gather, into a cache of
    /// radiance that is corrected; or auto, as a pilot finds quickest
    #[arg(long, value_name = "METHOD", default_value = "auto",
          value_parser = parse_method)]
    pub integrator: Wanted,

    /// Instructions to trace rays with, avx512, avx2 or portable; the image
    /// does not depend on them [default: the fastest of this processor]
    #[arg(long, value_name = "ISA", hide_possible_values = true)]
    pub isa: Option<Isa>,

    /// Print nothing but errors
    #[arg(short, long)]
    pub quiet: bool,
    /// Leave nothing out that the scene does not need
    #[arg(long)]
    pub keep_all: bool,

    /// Say what can be left out, and why, and render nothing
    #[arg(long)]
    pub explain: bool,
    /// Report of error against time, .json, .csv or .html; may be repeated
    #[arg(long, value_name = "FILE")]
    pub report: Vec<PathBuf>,

    /// Image of the same view, .exr or .pfm, to compute true errors from
    #[arg(long, value_name = "FILE", conflicts_with = "receivers")]
    pub reference: Option<PathBuf>,

    /// File to save the run to, from which it can be resumed
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,

    /// Time between two checkpoints [default: 60]
    #[arg(long, value_name = "SECONDS",
          value_parser = only(parse_real, |&x| x > 0., POSITIVE))]
    pub every: Option<f64>,

    /// Checkpoint to go on from, with the options of its run; others may be
    /// added that change no sample
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,

    /// Files that the run has written before it was resumed.
    #[arg(skip)]
    pub replaced: Vec<PathBuf>,
    /// The names of the options that were typed.
    #[arg(skip)]
    #[serde(skip)]
    given: Vec<String>,
}

/// What the numbers mean, and how they are asked for.
const EXAMPLES: &str = "\
A pixel is the mean radiance that arrives through it, in units of that of the
uniform sky; the value of a receiver is the irradiance, in units of that of a
horizontal surface in the open. Examples:

  pt scene.obj -r 0.7 -n 64 -o a.png
  pt room.obj --points grid.txt --materials --sky overcast --error 1%
  pt town.obj --faces -r 0 --error 0.002 -o a.csv -o a.ply
  pt scene.obj -r 0.7 --time 60 -o a.exr
  pt scene.obj -r 0.7 -n 256 --samples 0..64 -o 1.litpt";

/// What the exit status of `pt` means.
const STATUS: &str = "\
Exit status: 0 if the image is written, even if --time or --spp ended the run
before --error was reached; 1 if something failed; 2 if the command line is
wrong; 128 + N if signal N ended the run. Once rendering has begun, SIGINT,
SIGTERM, SIGHUP, SIGXCPU, SIGUSR1 and SIGUSR2 leave an image.";

/// What ends the help of each program.
pub const LICENCE: &str = "\
Copyright (C) 2026 litpt contributors.
Licence GPLv3+: GNU GPL version 3 or later. This is free software: you are
free to change and redistribute it. There is NO WARRANTY, to the extent
permitted by law.";

/// Parses a finite real number.
pub fn parse_real(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(real) if real.is_finite() => Ok(real),
        Ok(_) => Err(format!("{text} is not a finite number")),
        Err(_) => Err(format!("'{text}' is not a real number")),
    }
}

/// An error to reach.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Target {
    /// How large it may be.
    pub error: f64,
    /// Whether it is a part of the mean of each pixel.
    pub is_relative: bool,
}

/// Whose error is to be reached.
#[derive(ValueEnum, Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ErrorOf {
    /// The root mean square of all pixels.
    Rms,
    /// That of the worst pixel.
    Max,
}

/// Parses an error to reach.
fn parse_target(text: &str) -> Result<Target, String> {
    if ["rms", "max"].contains(&text) {
        return Err(format!(
            "expected a number; --error-of {text} is what \
                            it limits"
        ));
    }
    let positive = only(parse_real, |&x| x > 0., POSITIVE);
    let part = text.strip_suffix('%');
    let unit = if part.is_some() { 0.01 } else { 1. };
    let error = unit * positive(part.unwrap_or(text))?;
    Ok(Target { error, is_relative: part.is_some() })
}

/// Parses an albedo, which may be a percentage.
fn parse_albedo(text: &str) -> Result<f64, String> {
    only(parse_share, |x| (0. ..=1.).contains(x), ALBEDO)(text)
}

/// Parses a part of a whole: a number, or a percentage.
fn parse_share(text: &str) -> Result<f64, String> {
    match text.strip_suffix('%') {
        Some(percent) => Ok(parse_real(percent.trim_end())? / 100.),
        None => parse_real(text),
    }
}

/// Parses an albedo behind the name that has it, which may be empty.
fn parse_named_albedo(text: &str) -> Result<(String, f64), String> {
    let (name, albedo) = text.rsplit_once('=').unwrap_or(("", text));
    Ok((name.to_owned(), parse_albedo(albedo)?))
}

/// Parses a vector or the name of an axis.
fn parse_direction(text: &str) -> Result<DVec3, String> {
    match text {
        "x" => Ok(DVec3::X),
        "y" => Ok(DVec3::Y),
        "z" => Ok(DVec3::Z),
        _ => match parse_vector(text)? {
            DVec3::ZERO => Err("a direction is not zero".to_owned()),
            vector => Ok(vector),
        },
    }
}

fn parse_vector(text: &str) -> Result<DVec3, String> {
    let parts = text.split(',').map(|part| parse_real(part.trim()));
    match parts.collect::<Result<Vec<_>, _>>()?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err("expected three reals around two commas".to_owned()),
    }
}

/// A parser of the values that are valid, which are `expected` in words.
fn only<T>(
    parse: fn(&str) -> Result<T, String>,
    is_valid: fn(&T) -> bool,
    expected: &'static str,
) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| match parse(text)? {
        value if is_valid(&value) => Ok(value),
        _ => Err(expected.to_owned()),
    }
}

const ANGLE: &str = "expected an angle strictly between 0 and 180";
const ALBEDO: &str = "expected an albedo between 0 and 1";
const NOT_NEGATIVE: &str = "expected a number that is not negative";
const POSITIVE: &str = "expected a number greater than zero";
const SAMPLES: &str = "a pixel needs at least one sample";
const THREADS: &str = "expected an integer between 1 and 4096";

fn parse_whole(text: &str) -> Result<u64, String> {
    digits(text).map_err(|error: ParseIntError| match error.kind() {
        IntErrorKind::PosOverflow => {
            format!("{text} is larger than {}", u64::MAX)
        }
        _ => format!("'{text}' is not a whole number in digits"),
    })
}

/// Two whole numbers around a sign.
fn pair<N: FromStr>(text: &str, sign: &str) -> Option<(N, N)> {
    let (a, b) = text.split_once(sign)?;
    Some((digits(a).ok()?, digits(b).ok()?))
}

fn parse_range(text: &str) -> Result<(u64, u64), &'static str> {
    pair(text, "..").filter(|(from, to)| from <= to).ok_or(
        "expected two numbers with two dots between, the smaller first, \
         as in 16..32; -n is the number of samples",
    )
}

fn parse_band(text: &str) -> Result<(u32, u32), &'static str> {
    pair(text, "/")
        .filter(|&(k, n)| 0 < k && k <= n)
        .ok_or("expected a number from 1 to N, a slash and N, as in 2/8")
}

/// Why there is nothing to run.
#[derive(Debug)]
pub enum Error {
    /// The help or the version was asked for, which is this.
    Help(StyledStr),
    /// What is wrong with the command line, in one line.
    Usage(String),
    /// What has failed, in one line.
    Failure(String),
}

impl From<crate::error::Error> for Error {
    fn from(error: crate::error::Error) -> Self {
        Self::Failure(error.into())
    }
}

impl From<String> for Error {
    fn from(message: String) -> Self {
        Self::Failure(message)
    }
}

fn usage(fault: impl Display, program: &str) -> Error {
    Error::Usage(format!("{fault} (see {program} --help)"))
}

/// Parses the words of a program, and says which options are given.
///
/// # Errors
/// A word is wrong, or asks for help.
pub fn parse_words<P: Parser>(
    words: impl IntoIterator<Item = impl Into<OsString> + Clone>,
) -> Result<(P, ArgMatches), Error> {
    // Allow for numbers below zero
    let command = P::command().mut_args(|arg| {
        let is_file =
            arg.get_value_names().is_none_or(|names| names[0] == "FILE");
        let has_value = arg.get_action().takes_values();
        arg.allow_hyphen_values(has_value && !is_file)
    });
    let name = command.get_name().to_owned();
    let words = words.into_iter().skip(1);
    let given = command.no_binary_name(true).try_get_matches_from(words);
    let parse = |given| Ok((P::from_arg_matches(&given)?, given));
    given.and_then(parse).map_err(|error| match error.use_stderr() {
        true => usage(one_line(&error), &name),
        false => Error::Help(error.render()),
    })
}

/// The one line that says what is wrong with the command line.
fn one_line(error: &clap::Error) -> String {
    let text = error.to_string();
    let mut parts = text.split("\n\n");
    let fault = parts.next().unwrap_or_default();
    let tip = parts.find(|part| part.contains(" a similar "));
    let word = fault.split('\'').nth(1).unwrap_or_default();
    let initial = |word: &str| word.trim_start_matches('-').chars().next();
    let meant = |tip: &&str| tip.split('\'').nth(1).and_then(initial);
    let tip = tip.filter(|tip| meant(tip) == initial(word));
    let is_number =
        word.parse::<f64>().is_ok() && fault.contains("unexpected");
    let tip = tip.or(is_number.then_some("a vector is one word: 1,2,3"));
    let line =
        |part: &str| part.split_whitespace().collect::<Vec<_>>().join(" ");
    let parts = [Some(fault), tip].into_iter().flatten();
    let line = parts.map(line).collect::<Vec<_>>().join("; ");
    shortened(line.strip_prefix("error: ").unwrap_or(&line))
}

/// Options all of which are replaced if one of them is given.
const TOGETHER: [&[&str]; 4] = [
    &["scene", "input"],
    &["samples", "time", "error", "error_of"],
    &["output", "format"],
    &["resume", "checkpoint", "force", "learnt"],
];

/// The name of a file that is read, for people.
pub fn input_name(path: &Path) -> String {
    match is_dash(path) {
        true => "standard input".to_owned(),
        false => path.display().to_string(),
    }
}

/// Whether a file is standard input or output.
pub fn is_dash(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Turns a scene in the browser, and finds the options of pt for a view.
#[derive(Default, Parser)]
#[command(name = "ptview", version, after_help = LICENCE)]
pub struct ViewOptions {
    /// Wavefront OBJ, also .gz or .zst
    #[arg(value_name = "FILE")]
    pub scene: PathBuf,

    /// Options of pt that say what is shown, as -r 0.7 --sky overcast
    #[arg(
        value_name = "OPTIONS",
        trailing_var_arg = true,
        allow_hyphen_values = true
    )]
    pub words: Vec<String>,
}

impl Options {
    /// Parses the words of a command, the first of which is its name.
    ///
    /// # Errors
    /// A word is wrong, or asks for help; or options do not fit together.
    pub fn parse(
        words: impl IntoIterator<Item = impl Into<OsString> + Clone>,
    ) -> Result<Self, Error> {
        // Refuse a side that is a word of its own
        let words: Vec<OsString> =
            words.into_iter().map(Into::into).collect();
        let is_side = |word| ["front", "back", "both"].contains(&word);
        for pair in words.windows(2).filter(|pair| pair[0] == "--faces") {
            let side = pair[1].to_str().filter(|word| is_side(word));
            if let Some(side) =
                side.filter(|side| !Path::new(side).exists())
            {
                return Err(usage(
                    format!("--faces={side} is one word"),
                    "pt",
                ));
            }
        }
        let (mut typed, given) = parse_words::<Self>(words)?;
        // Note which options are given
        let here = Some(ValueSource::CommandLine);
        let is_given = |id: &&Id| given.value_source(id.as_str()) == here;
        typed.given =
            given.ids().filter(is_given).map(Id::to_string).collect();
        // Find the one state of the run
        let named = typed.output.iter().filter(|path| is_state_name(path));
        let mut states = typed.checkpoint.iter().chain(named);
        let state = states.next().cloned();
        if states.next().is_some() {
            let fault =
                "a run has one state, which --checkpoint or one -o names";
            return Err(usage(fault, "pt"));
        }
        typed.checkpoint = state;
        if typed.resume.is_some() { Ok(typed) } else { typed.checked() }
    }

    /// These options after those of a run that was saved.
    ///
    /// # Errors
    /// They do not fit together, or nothing is saved.
    pub fn after(&self, saved: &Value) -> Result<Self, Error> {
        let Self { output, report, mut replaced, .. } =
            Self::restore(saved)?;
        replaced.extend(output.into_iter().chain(report));
        replaced.extend(self.resume.clone());
        let (mut all, typed) = (saved.clone(), self.save(Path::new("")));
        // Replace the options that are given
        for id in self.given.iter().map(String::as_str) {
            let mut groups = TOGETHER.into_iter();
            let group = groups.find(|group| group.contains(&id));
            for &name in group.unwrap_or(&[id]) {
                all[name] = typed[name].clone();
            }
        }
        let mut all = Self { replaced, ..Self::restore(&all)? };
        all.checkpoint = all.checkpoint.or(all.resume.clone());
        all.checked()
    }

    /// The options as a checkpoint has them, from which they are found in
    /// any directory; they were typed in `directory`.
    pub fn save(&self, directory: &Path) -> Value {
        let mut saved = self.clone();
        for name in saved.names() {
            let full = directory.join(&name).into_os_string().into_vec();
            let text: String = full.into_iter().map(char::from).collect();
            *name = text.into();
        }
        serde_json::to_value(saved).unwrap_or_default()
    }

    /// The options that were saved.
    ///
    /// # Errors
    /// The value has not all of them.
    pub fn restore(saved: &Value) -> Result<Self, String> {
        let mut options = Self::deserialize(saved)
            .map_err(|e| format!("these are no options of pt: {e}"))?;
        for name in options.names() {
            let text = name.to_string_lossy();
            let bytes = text.chars().map(|c| c as u8).collect();
            *name = OsString::from_vec(bytes).into();
        }
        Ok(options)
    }

    /// The names of all files of a run.
    fn names(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let Self { scene, input, reference, checkpoint, resume, .. } = self;
        let Self { points, learnt, output, report, replaced, .. } = self;
        let one =
            [scene, input, points, reference, checkpoint, resume, learnt];
        let many = [output, report, replaced].into_iter().flatten();
        let all = one.into_iter().flatten().chain(many);
        all.filter(|name| !is_dash(name))
    }

    /// The options, if they fit together.
    fn checked(self) -> Result<Self, Error> {
        let &Self { range, tiles, samples, resolution, .. } = &self;
        let checkpoint = self.checkpoint.as_deref();
        let part = range.is_some() || tiles.is_some();
        let limited = self.time.is_some() || self.error.is_some();
        let shows =
            self.images().next().is_some() || !self.report.is_empty();
        let is_png =
            |path: &PathBuf| matches!(Format::of(path), Ok(Format::Png));
        let is_open = |path| descriptor(path).is_some();
        // Describe a part that is not within the image
        let (window, (width, height)) = (self.window(), resolution);
        let Window { corner: (x, y), size: (w, h) } = window;
        let fits = |at, n, side| at < side && n <= side - at;
        let is_within = fits(x, w, width) && fits(y, h, height);
        let outside = format!(
            "--crop {}: does not lie within the image of \
             {width}x{height} pixels",
            String::from(window)
        );
        let (k, n) = tiles.unwrap_or((1, 1));
        let rows = if is_within { window.tile_rows(SIDE) } else { 0 };
        let bands = format!(
            "--tiles {k}/{n}: the image has {rows} rows of tiles, and not \
             more bands"
        );
        let fault = if self.every.is_some() && checkpoint.is_none() {
            "--every needs --checkpoint"
        } else if checkpoint.is_some_and(is_dash) {
            "--checkpoint needs a file"
        } else if self.format.is_some() && !self.images().any(is_open) {
            "--format is for standard output"
        } else if self.preview && !self.output.iter().any(is_png) {
            "--preview needs a PNG file, as in -o a.png"
        } else if part && (samples.is_none() || limited) {
            "--samples and --tiles need -n, the samples of the whole run, and \
             neither --time nor --error"
        } else if range.is_some_and(|(_, end)| Some(end) > samples) {
            "--samples ends after the samples of the whole run, which are -n"
        } else if range.is_some_and(|(a, b)| a == b) && shows {
            "--samples A..A only learns, and writes a state: -o a.litpt"
        } else if tiles.is_some() && self.reference.is_some() {
            "--tiles renders a part of the image, and --reference needs all of it"
        } else if self.has_receivers() {
            return Ok(self);
        } else if !is_within {
            &outside
        } else if n > rows {
            &bands
        } else {
            return Ok(self);
        };
        Err(usage(fault, "pt"))
    }

    /// The error to reach, and which error it is.
    pub fn target(&self) -> Option<(f64, Measure)> {
        let Target { error, is_relative } = self.error?;
        let largest = matches!(self.error_of, ErrorOf::Max);
        Some((error, Measure { relative: is_relative, largest }))
    }

    /// The albedo of surfaces without a name that has one.
    pub fn albedo(&self) -> f64 {
        let unnamed = |(name, _): &&(String, f64)| name.is_empty();
        self.albedos.iter().rev().find(unnamed).map_or(1., |&(_, a)| a)
    }

    /// The albedos that have names.
    pub fn named_albedos(&self) -> Vec<(String, f64)> {
        let named = |(name, _): &&(String, f64)| !name.is_empty();
        self.albedos.iter().filter(named).cloned().collect()
    }

    /// Whether there are receivers instead of a camera.
    pub fn has_receivers(&self) -> bool {
        self.points.is_some() || self.faces.is_some() || self.vertices
    }
    /// The images to write, standard output if nothing is named.
    pub fn images(&self) -> impl Iterator<Item = &Path> {
        let named = self.output.iter().map(PathBuf::as_path);
        let unnamed = self.output.is_empty().then_some(Path::new("-"));
        named.filter(|path| !is_state_name(path)).chain(unnamed)
    }

    /// The file of the scene; none if it is standard input.
    pub fn scene_file(&self) -> Option<&Path> {
        let named = self.scene.as_ref().or(self.input.as_ref())?;
        (!is_dash(named)).then_some(named)
    }

    /// The name of the input, for people.
    pub fn input_name(&self) -> String {
        input_name(self.scene_file().unwrap_or(Path::new("-")))
    }

    /// Whether it is said which axis looks up.
    pub fn says_up(&self) -> bool {
        let is_up = |id: &String| ["up", "zenith"].contains(&&id[..]);
        self.given.iter().any(is_up)
    }

    /// Whether the position of the camera or its target is known.
    pub fn has_camera(&self) -> bool {
        self.position.or(self.target).is_some()
    }

    /// The view that the options describe, not yet checked.
    pub fn view(&self) -> View {
        let &Self { position, target, up, fov, .. } = self;
        let position = position.unwrap_or(DVec3::ZERO);
        let target = target.unwrap_or(DVec3::Y);
        View { position, target, up, fov }
    }

    /// The part of the image to render.
    pub fn window(&self) -> Window {
        whole_window(self.resolution, self.crop)
    }

    /// The number of samples, if it is limited.
    pub fn samples(&self) -> Option<u64> {
        let limited = self.time.is_some() || self.error.is_some();
        let usual = if self.has_receivers() { 1024 } else { 1 };
        self.samples.or((!limited).then_some(usual))
    }

    /// The part of a run whose samples are placed together in these numbers;
    /// none if all of it is rendered.
    pub fn part(&self, replicate: u64) -> Option<Part> {
        let (range, tiles, of) = (self.range, self.tiles, self.samples?);
        let is_part = range.is_some() || tiles.is_some();
        let samples = range.unwrap_or((0, of));
        let part = Part { samples, of, band: tiles.unwrap_or((1, 1)) };
        is_part.then(|| part.rounded(replicate))
    }

    /// The number of samples to render here, if it is limited.
    pub fn goal(&self, replicate: u64) -> Option<u64> {
        let part = self.part(replicate).map(|part| part.count());
        part.or(self.samples())
    }

    /// The time at which a program that began at `start` should end.
    pub fn deadline(&self, start: Instant) -> Option<Instant> {
        let time = Duration::try_from_secs_f64(self.time?).ok()?;
        start.checked_add(time)
    }

    /// The set of instructions to trace rays with.
    pub fn isa(&self) -> Isa {
        self.isa.unwrap_or_else(Isa::best)
    }
}
