// Tangled from chapters/options.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command line of `pt`: options, defaults and checks.
//!
//! Words go in; options or an error come out. Nothing here reads a file, and
//! nothing is printed.

use std::ffi::OsString;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::builder::TypedValueParser;
use clap::builder::{ArgPredicate, PossibleValuesParser, StyledStr};
use clap::{ArgAction, Args, Parser};
use glam::DVec3;

use crate::bvh::Isa;
use crate::camera::Viewpoint;
use crate::cli::values::*;
use crate::compare::display::Exposure;
use crate::film::{Window, parse_size};
use crate::image::Format;
use crate::materials::Band;
use crate::materials::glass::Bsdf;
use crate::scene::encoding::shortened;
use crate::sensor::Side;
use crate::sky::{Cover, Sun};
use crate::tally::Surface;

/// Renders a Wavefront OBJ of diffuse surfaces under a sky, or computes how
/// much light arrives at points and on faces.
#[derive(Clone, Debug, Parser)]
#[command(name = "pt", version, args_override_self = true,
          after_help = format!("{EXAMPLES}\n\n{STATUS}\n\n{LICENCE}"))]
pub struct Options {
    #[command(flatten)]
    pub scene: SceneOptions,
    #[command(flatten)]
    pub sensor: SensorOptions,
    #[command(flatten)]
    pub limits: LimitOptions,
    #[command(flatten)]
    pub outputs: OutputOptions,
    #[command(flatten)]
    pub parts: PartOptions,
    #[command(flatten)]
    pub execution: ExecutionOptions,
}

// What is rendered: a scene, its surfaces and its light.
#[derive(Args, Clone, Debug)]
#[group(skip)]
#[command(next_help_heading = "Scene and light")]
pub struct SceneOptions {
    /// Wavefront OBJ, also .gz or .zst [default: standard input, or -]
    #[arg(value_name = "FILE", overrides_with = "input",
          help_heading = None)]
    pub scene: Option<PathBuf>,

    /// Wavefront OBJ, like the argument FILE
    #[arg(short, long, value_name = "FILE", overrides_with = "scene")]
    pub input: Option<PathBuf>,

    /// Albedo of all surfaces, between 0 and 1, or of a material, group or
    /// object of the file, as in floor=0.2; may be repeated [default: 1]; if only
    /// pictures are written, the materials of the file, or 0.7
    #[arg(short = 'r', long = "albedo", visible_alias = "reflectivity",
          value_name = "[NAME=]ALBEDO", value_parser = parse_named_albedo)]
    pub albedos: Vec<(String, f64)>,

    /// Give each face the luminance of the diffuse reflectivity (Kd, linear) of
    /// its material
    #[arg(long, default_value_if("band", ArgPredicate::IsPresent, "true"))]
    pub materials: bool,

    /// Take one of the three numbers of each material, r, g or b, instead of the
    /// luminance; implies --materials
    #[arg(long, value_name = "BAND", hide_possible_values = true)]
    pub band: Option<Band>,

    /// Make a material, group or object clear glass, of this transmittance for
    /// light that falls on it straight, as in window=0.88: light goes on behind
    /// it, weakened as its angle tells, and what the glass reflects is left out;
    /// with materials in place of NAME=TAU, all materials whose d or Tr says that
    /// they are transparent, coloured by Tf; may be repeated
    #[arg(long, value_name = "NAME=TAU|materials", value_parser = parse_glass)]
    pub glass: Vec<(String, Option<f64>)>,

    /// Make a material, group or object a thin sheet that reflects the part RHO
    /// of the light and transmits the part TAU, both diffusely; may be repeated
    #[arg(long, value_name = "NAME=RHO,TAU", value_parser = parse_transmitter)]
    pub transmit: Vec<(String, Bsdf)>,

    /// Sky: uniform; overcast, three times as bright at the zenith as at the
    /// horizon; cie:1 to cie:16, the types of ISO 15469; perez:E,D, of a clearness
    /// E and a brightness D; sphere, uniform and below the horizon too, as for
    /// ambient occlusion; or a column, from 1, of a sky matrix of gendaymtx, as in
    /// FILE.smx:12, without its ground; each gives 1 to a horizontal surface in
    /// the open [default: uniform]
    #[arg(long, value_name = "SKY", value_parser = Cover::from_str)]
    pub sky: Option<Cover>,

    /// Direction to the sun: a vector, or azimuth and altitude in degrees, the
    /// azimuth from +y towards +x where z is up; most types of --sky are brighter
    /// around it
    #[arg(long, value_name = "X,Y,Z|AZIMUTH,ALTITUDE", value_parser = parse_sun)]
    pub sun: Option<Sun>,

    /// Irradiance that the sun itself adds on a surface that faces it, if the
    /// sky alone gives 1 to a horizontal one in the open; needs --sun; no camera
    /// sees the disc of the sun, 0.533 degrees wide
    #[arg(long, value_name = "E", value_parser = parse_real)]
    pub direct: Option<f64>,

    /// Direction to the middle of the sky [default: the axis nearest to -u]
    #[arg(long, value_name = "X,Y,Z|x|y|z", value_parser = parse_direction)]
    pub zenith: Option<DVec3>,

    /// Albedo of an endless ground below the scene; 0 hides it [default: none];
    /// 0.3 if only pictures are written
    #[arg(long, value_name = "ALBEDO", value_parser = parse_albedo)]
    pub ground: Option<f64>,

    /// Albedo of an endless ground that is seen only where nothing else is, below
    /// the horizon, and that lies in the open, so that nothing shades it
    #[arg(long, value_name = "ALBEDO", value_parser = parse_albedo,
          conflicts_with = "ground")]
    pub ground_glow: Option<f64>,
}

// What senses the light: a camera with its image, or receivers.
#[derive(Args, Clone, Debug)]
#[group(skip)]
#[command(next_help_heading = "Camera and image, or receivers instead")]
pub struct SensorOptions {
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
    /// unless --zenith does [default: 0,0,1]; if only pictures are written, the
    /// axis that looks right
    #[arg(short, long, value_name = "X,Y,Z|x|y|z",
          value_parser = parse_direction)]
    pub up: Option<DVec3>,

    /// Vertical field of view in degrees, strictly between 0 and 180
    /// [default: 70]; 35 from outside, if only pictures are written
    #[arg(short = 'F', long, value_name = "DEGREES",
          value_parser = only(parse_real, |&x| x > 0. && x < 180., ANGLE))]
    pub fov: Option<f64>,

    /// Show all of the scene from a side: front (-y, or z if y is up), back,
    /// left, right, top or iso; then, in degrees, turned counter-clockwise as seen
    /// from above, and raised, as in front,20,10 [default: iso, without -p and -t]
    #[arg(long = "view", value_name = "SIDE[,TURN[,RAISE]]",
          value_parser = parse_viewpoint,
          conflicts_with_all = ["position", "target", "receivers"])]
    pub viewpoint: Option<(Viewpoint, [f64; 2])>,

    /// Resolution of the image in pixels, each at most 16384
    /// [default: 320x240]
    #[arg(short = 'd', long, visible_alias = "definition",
          value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    pub resolution: Option<(u32, u32)>,

    /// Render only a window of the image: the column and row of its first
    /// pixel, and its size, as in 100,50,64x48
    #[arg(long, value_name = "X,Y,WIDTHxHEIGHT",
          conflicts_with = "receivers",
          value_parser = |text: &str| Window::try_from(text.to_owned()))]
    pub crop: Option<Window>,

    /// Show a grey of this radiance behind the scene and its ground instead of the
    /// sky, and give .png and .exr an opacity; no horizon is seen if --ground is
    /// the same
    #[arg(long, value_name = "RADIANCE", conflicts_with = "receivers",
          value_parser = only(parse_share, |&x| 0. <= x && x <= 1e9, GREY))]
    pub background: Option<f64>,

    /// Compute the irradiance at the points of a file, lines x y z nx ny nz, in
    /// units of that of a horizontal surface in the open
    #[arg(long, value_name = "FILE", group = "receivers")]
    pub points: Option<PathBuf>,

    /// Compute the irradiance of each face: front, back or both sides
    /// [default: front]
    #[arg(long, value_name = "SIDE", group = "receivers", num_args = 0..=1,
          default_missing_value = "front", require_equals = true,
          hide_possible_values = true)]
    pub faces: Option<Side>,

    /// Compute the irradiance at each vertex, with the normal of the faces
    /// around it
    #[arg(long, group = "receivers")]
    pub vertices: bool,

    /// Compute view factors from each face or point instead of its irradiance:
    /// the shares of the cosine-weighted directions that first meet each face,
    /// or the faces of each material, object or group; then sky and ground
    #[arg(long, value_name = "COLUMNS", requires = "receivers",
          hide_possible_values = true,
          conflicts_with_all = ["sky_patches", "derivative"])]
    pub view_factors: Option<Surface>,

    /// Write the nearest view factors that are reciprocal and sum to 1; for
    /// --faces --view-factors faces
    #[arg(long)]
    pub closed: bool,

    /// Compute daylight coefficients: the irradiance for a radiance of 1 of the
    /// ground and of each patch of Reinhart's sky, 144 N N + 1 for N = 1, 2 or 4
    #[arg(
        long,
        value_name = "N",
        requires = "receivers",
        conflicts_with = "derivative"
    )]
    pub sky_patches: Option<u32>,

    /// Write .mtx in binary numbers of single precision
    #[arg(long, requires = "sky_patches")]
    pub binary: bool,

    /// Compute also the derivative of each value by the albedo of a material,
    /// group or object, as columns d_value and d_stderr of .csv
    #[arg(long, value_name = "NAME", requires = "receivers")]
    pub derivative: Option<String>,

    /// Report the radiosity of faces instead of their irradiance
    #[arg(long, requires = "faces",
          conflicts_with_all = ["points", "vertices"])]
    pub radiosity: bool,
}

// How samples are made, and when the run ends.
#[derive(Args, Clone, Debug)]
#[group(skip)]
#[command(next_help_heading = "Samples and when to stop")]
pub struct LimitOptions {
    /// Samples (paths) per pixel [default: 1] or receiver [default: 1024]; an
    /// upper bound with --time or --error; if only pictures are written, the
    /// default is an error of 1 % of the mean, or 10 s
    #[arg(short = 'n', long = "spp", visible_alias = "realisations",
          value_name = "N",
          value_parser = only(parse_whole, |&n| n > 0, SAMPLES))]
    pub samples: Option<u64>,

    /// Stop after SECONDS, startup included; unsampled pixels are interpolated
    /// in .pgm and .png, and NaN in .pfm and .exr
    #[arg(long, value_name = "SECONDS",
          value_parser = only(parse_real, |&x| x > 0., POSITIVE))]
    pub time: Option<f64>,

    /// Stop when the error of the pixels is at most this, in units of the
    /// radiance of the sky; append % for a relative error
    #[arg(long, value_name = "ERROR[%]", value_parser = parse_target)]
    pub error: Option<(f64, bool)>,

    /// Which error --error limits: rms over pixels, or max
    #[arg(
        long = "error-norm",
        alias = "error-of",
        value_name = "rms|max",
        default_value = "rms",
        hide_possible_values = true,
        requires = "error",
        action = ArgAction::Set,
        value_parser = PossibleValuesParser::new(["rms", "max"])
            .map(|norm| norm == "max")
    )]
    pub largest: bool,

    /// Sampling method: reference, paths with independent random numbers; sobol,
    /// the same paths with scrambled Sobol points; gather, rays into a corrected
    /// cache of radiance; auto picks the fastest from a short pilot
    #[arg(long, value_name = "METHOD", default_value = "auto",
          hide_possible_values = true, value_parser = parse_method)]
    pub integrator: RequestedMethod,

    /// Seed of the random numbers [default: 0]
    #[arg(short, long, value_name = "SEED", value_parser = parse_whole)]
    pub seed: Option<u64>,
}

// What is written.
#[derive(Args, Clone, Debug)]
#[group(skip)]
#[command(next_help_heading = "Output")]
pub struct OutputOptions {
    /// File to write: an image, .pgm, .png, .pfm or .exr; values of receivers,
    /// .csv, .ply or, of vertices, .obj; view factors, .csv, .vf (View3D), .svf
    /// (uDALES) or .json (EnergyPlus); coefficients, .csv or .mtx (Radiance); or
    /// the state of the run, .litpt, as --checkpoint does; may be repeated
    /// [default: -, standard output, or on a terminal a PNG beside the scene]
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,

    /// Format of an image on standard output: pgm, png, pfm or exr
    /// [default: pgm]
    #[arg(long, value_name = "FORMAT", hide_possible_values = true)]
    pub format: Option<Format>,

    /// Overwrite files that exist
    #[arg(short, long)]
    pub force: bool,

    /// Write PNG files every second while the image is rendered
    #[arg(long, conflicts_with = "receivers")]
    pub preview: bool,

    /// Brighten .png and .html by this many stops, or auto, by which all but the
    /// sky fills the scale [default: 0; auto for .html, for a picture that is not
    /// named, and with --direct if only pictures are written]
    #[arg(long, value_name = "STOPS|auto", value_parser = Exposure::parse,
          conflicts_with = "receivers")]
    pub exposure: Option<Exposure>,

    /// Do not filter the noise of .png and .html, and write no filtered channels
    /// in .exr
    #[arg(long)]
    pub no_filter: bool,

    /// Report of error against time, .json, .csv or .html; may be repeated
    #[arg(long, value_name = "FILE")]
    pub report: Vec<PathBuf>,

    /// Reference image for true errors, .exr or .pfm, of the same view
    #[arg(long, value_name = "FILE", conflicts_with = "receivers")]
    pub reference: Option<PathBuf>,
}

// How a run is saved, resumed and divided.
#[derive(Args, Clone, Debug)]
#[group(skip)]
#[command(next_help_heading = "Checkpoints and parts of a run")]
pub struct PartOptions {
    /// File to save the run to, from which it can be resumed
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,

    /// Time between two checkpoints [default: 60]
    #[arg(long, alias = "every", value_name = "SECONDS",
          value_parser = only(parse_real, |&x| x > 0., POSITIVE))]
    pub checkpoint_interval: Option<f64>,

    /// Resume the run that was saved in a checkpoint; only limits, what is
    /// written and how it is executed may be changed
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,

    /// Render only the samples A to B - 1 of the N of --spp: a part of a run
    /// for ptimg merge; 0..0 has no sample, and only trains the cache
    #[arg(long = "samples", value_name = "A..B", value_parser = parse_range)]
    pub range: Option<(u64, u64)>,

    /// Render only the K-th of N bands of the image: a part of a run for
    /// ptimg merge
    #[arg(long, value_name = "K/N", value_parser = parse_band)]
    pub tiles: Option<(u32, u32)>,

    /// Take the cache of radiance from the state of another part of this run, of
    /// the same -n, instead of training it again; no sample depends on it
    #[arg(
        long,
        alias = "learnt",
        value_name = "FILE",
        conflicts_with = "resume"
    )]
    pub cache: Option<PathBuf>,
}

// How the program runs.
#[derive(Args, Clone, Debug)]
#[group(skip)]
#[command(next_help_heading = "Execution and debugging")]
pub struct ExecutionOptions {
    /// Number of threads; no sample depends on it [default: all cores]
    #[arg(short = 'j', long, value_name = "N",
          value_parser = only(parse_whole, |n| (1..=4096).contains(n), THREADS))]
    pub threads: Option<u64>,

    /// Instructions to trace rays with, avx512, avx2 or portable; no sample
    /// depends on them [default: the fastest of this processor]
    #[arg(long, value_name = "ISA", hide_possible_values = true)]
    pub isa: Option<Isa>,

    /// Disable shortcuts: do all work, also where it cannot change the image
    #[arg(long, alias = "keep-all")]
    pub no_shortcuts: bool,

    /// Print the chosen method and shortcuts, then exit
    #[arg(long, alias = "explain")]
    pub dry_run: bool,

    /// Trace only sample N, from 0 to one less than --spp, of the pixel in column
    /// X and row Y, or of receiver Y with X = 0, and print its path; no file is
    /// written
    #[arg(long, value_name = "X,Y,N", value_parser = parse_sample,
          conflicts_with = "dry_run")]
    pub sample: Option<(u32, u32, u64)>,

    /// Print nothing but errors
    #[arg(short, long)]
    pub quiet: bool,
}

/// What the numbers mean, and how to get them.
const EXAMPLES: &str = "\
A pixel is the mean radiance that arrives through it, in units of that of the
uniform sky; the value of a receiver is the irradiance, in units of that of a
horizontal surface in the open. Where only pictures are written, .png and
.html, what is not said is chosen for the eye. Examples:

  pt scene.obj -o a.png
  pt scene.obj -r 0.7 --view front,20,10 --ground 0.5 -n 64 -o a.png
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

/// The last paragraph of each program's help.
pub const LICENCE: &str = "\
Copyright (C) 2026 litpt contributors.
Licence GPLv3+: GNU GPL version 3 or later. This is free software: you are
free to change and redistribute it. There is NO WARRANTY, to the extent
permitted by law.";

/// Why there is nothing to run.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The help or the version was asked for, which is this.
    #[error("{0}")]
    Help(StyledStr),
    /// What is wrong with the command line, in one line.
    #[error("{0}")]
    Usage(String),
    /// What has failed.
    #[error("{}", by_option(.0))]
    Failure(#[from] crate::error::Error),
}

/// The error of a wrong command line.
pub fn usage(fault: impl Display, program: &str) -> Error {
    Error::Usage(format!("{fault} (see {program} --help)"))
}

/// A fault in words, with the option in place of the name of a value.
pub fn by_option(error: &crate::error::Error) -> String {
    match error {
        crate::error::Error::Value { name, fault, .. }
            if let Some(rest) = fault.strip_prefix(name) =>
        {
            let option = match *name {
                "part" => "samples",
                "band" => "tiles",
                same => same,
            };
            format!("--{option}{rest}")
        }
        crate::error::Error::Value { name, fault, .. } => {
            format!("{fault} (--{name})")
        }
        other => other.to_string(),
    }
}

/// Parses the words of a program.
///
/// # Errors
/// A word is wrong, or asks for help.
pub fn parse_words<P: Parser>(
    words: impl IntoIterator<Item = impl Into<OsString> + Clone>,
) -> Result<P, Error> {
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
    let parse = |given| P::from_arg_matches(&given);
    given.and_then(parse).map_err(|error| match error.use_stderr() {
        true => usage(one_line(&error), &name),
        false => Error::Help(error.render()),
    })
}

/// One line that describes the fault of the command line.
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

impl Options {
    /// Parses the words of a command, the first of which is its name.
    ///
    /// # Errors
    /// A word is wrong, or asks for help; or options do not fit together.
    pub fn parse(
        words: impl IntoIterator<Item = impl Into<OsString> + Clone>,
    ) -> Result<Self, Error> {
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
        parse_words(words)
    }
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
