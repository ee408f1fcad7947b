// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command line of `pt`: options, defaults and checks.
//!
//! Values that leave this module are valid one by one; whether they
//! are valid together (a camera needs a target that is not its own
//! position) is for the module that combines them to say.

use std::env;
use std::ffi::OsString;
use std::io::{self, IsTerminal};
use std::iter;
use std::num::{IntErrorKind, ParseIntError};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anstream::{AutoStream, ColorChoice};
use clap::builder::styling::{AnsiColor, Effects, Style};
use clap::builder::{StyledStr, Styles};
use clap::error::{ContextKind, ContextValue};
use clap::parser::ValueSource;
use clap::{ArgMatches, CommandFactory, Id, Parser};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use crate::analysis::Shortcut;
use crate::bvh::Isa;
use crate::camera::{View, typed};
use crate::checkpoint::Checkpoint;
use crate::film::{Window, digits, parse_size};
use crate::image::Format;
use crate::output::{ImageTarget, OutputTarget, descriptor};
use crate::progress;
use crate::render::choose::Wanted;
use crate::report::Kind;
use crate::run_key::{Part, Subject, entries};
use crate::shards::is_state_name;

/// Renders a Wavefront OBJ of one diffuse material under a uniform sky.
#[derive(Clone, Debug, Parser, Serialize, Deserialize)]
#[command(name = "pt", version, styles = STYLES,
          after_help = format!("{STATUS}\n\n{LICENCE}"))]
#[command(args_override_self = true)]
pub struct Arguments {
    /// Resolution of the image in pixels, each at most 16384
    #[arg(short = 'd', long, visible_alias = "definition",
          value_name = "WIDTHxHEIGHT",
          default_value = "320x240", value_parser = parse_size,
          allow_hyphen_values = true)]
    pub resolution: (u32, u32),

    /// Render only this part: the column and row of its first pixel, and its
    /// size, as in 100,50,64x48
    #[arg(
        long,
        value_name = "X,Y,WIDTHxHEIGHT",
        allow_hyphen_values = true
    )]
    pub crop: Option<Window>,

    /// Samples (paths) per pixel [default: 1]; an upper bound with
    /// --time or --error
    #[arg(short = 'n', long = "spp",
          visible_alias = "realisations",
          value_name = "N", value_parser = parse_samples,
          allow_hyphen_values = true)]
    pub samples: Option<u64>,

    /// Render only the samples A to B - 1 of the N of --spp: a part of a run
    /// for ptimg merge
    #[arg(long = "samples", value_name = "A..B", value_parser = parse_range,
          allow_hyphen_values = true)]
    pub range: Option<(u64, u64)>,

    /// Render only the K-th of N bands of the image: a part of a run for
    /// ptimg merge
    #[arg(long, value_name = "K/N", value_parser = parse_band,
          allow_hyphen_values = true)]
    pub tiles: Option<(u32, u32)>,

    /// Stop within so many seconds from the start of the program; pixels
    /// without a sample are then filled from around them in .pgm and .png, and
    /// NaN in .pfm and .exr
    #[arg(long, value_name = "SECONDS",
          value_parser = parse_positive, allow_hyphen_values = true)]
    pub time: Option<f64>,

    /// Stop when the root mean square error of the pixels, whose unit is the
    /// radiance of the sky, is at most this
    #[arg(long, value_name = "RMSE",
          value_parser = parse_positive, allow_hyphen_values = true)]
    pub error: Option<f64>,
    /// Position of the camera [default: outside of the scene, or
    /// 0,0,0 with -t]
    #[arg(short, long, value_name = "X,Y,Z",
          value_parser = parse_vector, allow_hyphen_values = true)]
    pub position: Option<DVec3>,

    /// Point that the camera looks at [default: the scene, or
    /// 0,1,0 with -p]
    #[arg(short, long, value_name = "X,Y,Z",
          value_parser = parse_vector, allow_hyphen_values = true)]
    pub target: Option<DVec3>,

    /// Up axis of the camera; its largest component tells where the sky is
    #[arg(short, long, value_name = "X,Y,Z", default_value = "0,0,1",
          value_parser = parse_vector, allow_hyphen_values = true)]
    pub up: DVec3,

    /// Vertical field of view in degrees, strictly between 0 and 180
    #[arg(short = 'F', long, value_name = "DEGREES", default_value = "70",
          value_parser = parse_fov, allow_hyphen_values = true)]
    pub fov: f64,
    /// Albedo of every surface, between 0 and 1
    #[arg(short = 'r', long, visible_alias = "reflectivity",
          value_name = "ALBEDO", default_value = "1",
          value_parser = parse_albedo, allow_hyphen_values = true)]
    pub albedo: f64,

    /// Wavefront OBJ, also .gz or .zst [default: standard input, as is -]
    #[arg(value_name = "FILE", overrides_with = "input")]
    pub scene: Option<PathBuf>,

    /// The scene, as FILE alone
    #[arg(short, long, value_name = "FILE", overrides_with = "scene")]
    pub input: Option<PathBuf>,
    /// Image to write, .pgm, .png, .pfm or .exr, or the state of the run,
    /// .litpt, as --checkpoint does; may be repeated [default: -, standard
    /// output, or on a terminal a PNG beside the scene]
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,

    /// Format of an image on standard output: pgm, png, pfm or exr
    /// [default: pgm]
    #[arg(long, value_name = "FORMAT", hide_possible_values = true)]
    pub format: Option<Format>,

    /// Write PNG files every second while the image is rendered
    #[arg(long)]
    pub preview: bool,

    /// Overwrite files that exist
    #[arg(short, long)]
    pub force: bool,

    /// Seed of the random numbers
    #[arg(
        short,
        long,
        value_name = "SEED",
        default_value = "0",
        value_parser = parse_whole,
        allow_hyphen_values = true
    )]
    pub seed: u64,

    /// Number of threads; the image does not depend on it [default: all cores]
    #[arg(short = 'j', long, value_name = "N",
          value_parser = parse_threads, allow_hyphen_values = true)]
    pub threads: Option<usize>,

    /// How samples are made: reference, paths of independent numbers; sobol,
    /// the same paths placed by scrambled nets; gather, into a cache of
    /// radiance that is corrected; or auto, as a pilot finds quickest
    #[arg(long, value_name = "METHOD", default_value = "auto")]
    pub integrator: Wanted,

    /// Instructions to trace rays with, avx512, avx2 or portable; the image
    /// does not depend on them [default: the fastest of this processor]
    #[arg(long, value_name = "ISA")]
    pub isa: Option<Isa>,

    /// Print nothing but errors
    #[arg(short, long)]
    pub quiet: bool,
    /// Leave nothing out that the scene does not need
    #[arg(long)]
    pub keep_all: bool,

    /// Leave nothing out because of this shortcut: dark, background or
    /// black, as --explain has them; may be repeated
    #[arg(long, value_name = "SHORTCUT")]
    pub keep: Vec<Shortcut>,

    /// Say what can be left out, and why, and render nothing
    #[arg(long)]
    pub explain: bool,
    /// Report of error against time, .json, .csv or .html; may be repeated
    #[arg(long, value_name = "FILE")]
    pub report: Vec<PathBuf>,

    /// Image of the same view, .exr or .pfm, to compute true errors from
    #[arg(long, value_name = "FILE")]
    pub reference: Option<PathBuf>,

    /// File to save the run to, from which it can be resumed
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,

    /// Time between two checkpoints [default: 60]
    #[arg(long, value_name = "SECONDS",
          value_parser = parse_positive, allow_hyphen_values = true)]
    pub every: Option<f64>,

    /// Checkpoint to go on from, with the options of its run; others may be
    /// added that change no sample
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,

    /// Where the names of files hold.
    #[arg(skip)]
    directory: PathBuf,
    /// Images and reports of the run before it was resumed.
    #[arg(skip)]
    replaced: Vec<PathBuf>,
    /// The image that is written because none is named.
    #[arg(skip)]
    #[serde(skip)]
    pub picture: Option<PathBuf>,
}

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

/// How the help looks on a terminal.
pub const STYLES: Styles = Styles::styled()
    .error(AnsiColor::Red.on_default().effects(Effects::BOLD))
    .header(Style::new().effects(Effects::BOLD))
    .usage(Style::new().effects(Effects::BOLD))
    .literal(Style::new().effects(Effects::BOLD));

/// Parses a finite real number.
pub fn parse_real(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(real) if real.is_finite() => Ok(real),
        Ok(_) => Err(format!("{text} is not a finite number")),
        Err(_) => Err(format!("'{text}' is not a real number")),
    }
}

fn parse_vector(text: &str) -> Result<DVec3, String> {
    let parts = text.split(',').map(parse_real);
    match parts.collect::<Result<Vec<_>, _>>()?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err("expected three reals around two commas".to_owned()),
    }
}

fn parse_fov(text: &str) -> Result<f64, String> {
    match parse_real(text)? {
        fov if fov > 0. && fov < 180. => Ok(fov),
        _ => Err("expected an angle strictly between 0 and 180".to_owned()),
    }
}

fn parse_albedo(text: &str) -> Result<f64, String> {
    match parse_real(text)? {
        rho if (0. ..=1.).contains(&rho) => Ok(rho),
        _ => Err("expected an albedo between 0 and 1".to_owned()),
    }
}

fn parse_whole(text: &str) -> Result<u64, String> {
    digits(text).map_err(|error: ParseIntError| match error.kind() {
        IntErrorKind::PosOverflow => {
            format!("{text} is larger than {}", u64::MAX)
        }
        _ => format!("'{text}' is not a whole number in digits"),
    })
}

fn parse_samples(text: &str) -> Result<u64, String> {
    match parse_whole(text)? {
        0 => Err("a pixel needs at least one sample".to_owned()),
        n => Ok(n),
    }
}

fn parse_range(text: &str) -> Result<(u64, u64), String> {
    let (from, to) = text.split_once("..").unwrap_or_default();
    match (parse_whole(from), parse_whole(to)) {
        (Ok(from), Ok(to)) if from < to => Ok((from, to)),
        _ => Err("expected a number, two dots and a larger number, as in \
                  16..32"
            .to_owned()),
    }
}

fn parse_band(text: &str) -> Result<(u32, u32), String> {
    let (k, n) = text.split_once('/').unwrap_or_default();
    match (digits(k), digits(n)) {
        (Ok(k), Ok(n)) if 0 < k && k <= n => Ok((k, n)),
        _ => Err("expected a number from 1 to N, a slash and N, as in 2/8"
            .to_owned()),
    }
}

fn parse_positive(text: &str) -> Result<f64, String> {
    match parse_real(text)? {
        real if real > 0. => Ok(real),
        _ => Err("expected a number greater than zero".to_owned()),
    }
}

fn parse_threads(text: &str) -> Result<usize, String> {
    match parse_whole(text)? {
        n @ 1..=4096 => Ok(n as usize),
        _ => Err("expected an integer between 1 and 4096".to_owned()),
    }
}

/// Options all of which are replaced if one of them is given.
const TOGETHER: [&[&str]; 4] = [
    &["scene", "input"],
    &["samples", "time", "error"],
    &["output", "format"],
    &["resume", "checkpoint", "force", "directory"],
];

/// Parses the arguments of a program, and says which of them are given;
/// see [`Arguments::from_command_line`].
pub fn parse_command_line<P: Parser>() -> Result<(P, ArgMatches), ExitCode>
{
    let command = P::command();
    let name = command.get_name().to_owned();
    let words = env::args_os().skip(1);
    let words = iter::once(name.clone().into()).chain(words);
    let given = command.try_get_matches_from(words);
    let parse = |given| Ok((P::from_arg_matches(&given)?, given));
    given.and_then(parse).map_err(|error| {
        if error.use_stderr() {
            progress::error(&explain(&error, &name));
            return ExitCode::from(2);
        }
        print(&error.render()).map_or_else(fail, |()| ExitCode::SUCCESS)
    })
}

/// Prints a text on standard output, on a terminal in colour.
fn print(text: &StyledStr) -> Result<(), String> {
    let plain = AutoStream::choice(&io::stdout()) == ColorChoice::Never;
    OutputTarget::standard_output()?.write(&mut |out| match plain {
        true => write!(out, "{text}"),
        false => write!(out, "{}", text.ansi()),
    })
}

/// Says why a program ends, and with which status.
pub fn fail(message: String) -> ExitCode {
    progress::error(&message);
    ExitCode::FAILURE
}

/// The one line that says what is wrong with the command line.
fn explain(error: &clap::Error, program: &str) -> String {
    let text = error.to_string();
    let lines = text.lines().take_while(|line| !line.is_empty());
    let line = lines.map(str::trim).collect::<Vec<_>>().join(" ");
    let line = line.strip_prefix("error: ").unwrap_or(&line);
    // Name what was probably meant
    let kinds = [
        ContextKind::SuggestedArg,
        ContextKind::SuggestedValue,
        ContextKind::SuggestedSubcommand,
    ];
    let near = kinds.into_iter().find_map(|kind| error.get(kind));
    let meant = match near {
        Some(ContextValue::String(word)) => {
            format!("; did you mean {word}?")
        }
        Some(ContextValue::Strings(words)) if !words.is_empty() => {
            format!("; did you mean {}?", words.join(" or "))
        }
        _ => String::new(),
    };
    format!("{line}{meant} (see {program} --help)")
}

/// Whether a file to read is standard input.
pub fn is_dash(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// # Errors
/// Two names stand for one file, and it is to be written.
pub fn tell_apart<'a>(
    read: impl Iterator<Item = &'a Path>,
    written: impl Iterator<Item = &'a Path>,
) -> Result<(), String> {
    let place = |path: &Path| {
        // Ask for the directory of a new file
        let new = || {
            let directory = Path::new(".").join(path.parent()?);
            Some(directory.canonicalize().ok()?.join(path.file_name()?))
        };
        let open = descriptor(path).map(|n| n.to_string().into());
        let known = open.or_else(|| path.canonicalize().ok());
        known.or_else(new).unwrap_or_else(|| path.to_owned())
    };
    let read = read.filter(|path| !is_dash(path));
    let mut taken: Vec<_> = read.map(place).collect();
    // Refuse a file that is named twice
    for path in written {
        let name = path.display();
        if taken.contains(&place(path)) {
            return Err(match descriptor(path) {
                Some(1) => "standard output is named twice".to_owned(),
                _ => format!("{name}: this file is named twice"),
            });
        }
        taken.push(place(path));
    }
    Ok(())
}

impl Arguments {
    /// Parses the arguments of the process, and opens the checkpoint that
    /// they go on from. When there is nothing to render, because help was
    /// asked for or something is wrong, prints what the user should know and
    /// returns the exit status.
    pub fn from_command_line()
    -> Result<(Self, Option<Checkpoint>), ExitCode> {
        if env::args_os().len() <= 1 && io::stdin().is_terminal() {
            let _ = print(&Self::command().render_help());
            return Err(ExitCode::from(2));
        }
        let (mut typed, given) = parse_command_line::<Self>()?;
        typed.directory = env::current_dir().unwrap_or_default();
        let begun = typed.after_those_of_a_run(&given);
        let (mut all, resumed) = begun.map_err(fail)?;
        let state = typed.states().next().cloned();
        all.checkpoint = state.or(all.resume.clone());
        // Choose a file for the image
        if all.output.is_empty() && all.format.is_none() && !all.explain {
            all.picture = all.png().filter(|_| io::stdout().is_terminal());
            all.output.extend(all.picture.clone());
        }
        // Refuse options that do not fit together
        let is_open = |path| descriptor(path).is_some();
        let is_png = |path: &PathBuf| Format::of(path) == Ok(Format::Png);
        let fault = if all.every.is_some() && all.checkpoint.is_none() {
            "--every needs --checkpoint"
        } else if all.checkpoint.as_deref().is_some_and(is_dash) {
            "--checkpoint needs a file"
        } else if all.format.is_some() && !all.pictures().any(is_open) {
            "--format is for standard output, the name of a file tells its own"
        } else if typed.states().count() > 1 {
            "a run has one state, which --checkpoint or one -o names"
        } else if typed.preview && !all.output.iter().any(is_png) {
            "--preview needs a PNG file, as in -o a.png"
        } else {
            all.fault_of_part()
        };
        if !fault.is_empty() {
            progress::error(&format!("{fault} (see pt --help)"));
            return Err(ExitCode::from(2));
        }
        Ok((all, resumed))
    }

    /// The options after those of the run to go on with, if there is one.
    fn after_those_of_a_run(
        &self,
        given: &ArgMatches,
    ) -> Result<(Self, Option<Checkpoint>), String> {
        let Some(path) = &self.resume else {
            return Ok((self.clone(), None));
        };
        let checkpoint = Checkpoint::of_file(path)?;
        let mut before = Self::restore(&checkpoint.known().options)?;
        // Find the files of the run from here
        let old = before.directory.clone();
        let moved = old != self.directory;
        for name in before.names().filter(|_| moved) {
            *name = old.join(&name);
        }
        let written = [&before.output[..], &before.report].concat();
        before.replaced.extend(written);
        let (mut all, typed) = (before.save(), self.save());
        // Replace the options that are given
        for id in given.ids().map(Id::as_str) {
            if given.value_source(id) == Some(ValueSource::CommandLine) {
                let mut groups = TOGETHER.into_iter();
                let group = groups.find(|group| group.contains(&id));
                for &name in group.unwrap_or(&[id]) {
                    all[name] = typed[name].clone();
                }
            }
        }
        Ok((Self::restore(&all)?, Some(checkpoint)))
    }

    /// The options as a checkpoint has them.
    pub fn save(&self) -> Value {
        let mut saved = self.clone();
        for name in saved.names() {
            let bytes = name.as_os_str().as_bytes().iter();
            let text: String = bytes.map(|&b| char::from(b)).collect();
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
        let Self { output, report, replaced, directory, .. } = self;
        let one = [scene, input, reference, checkpoint, resume];
        let many = [output, report, replaced].into_iter().flatten();
        let all = one.into_iter().flatten().chain(many).chain([directory]);
        all.filter(|name| !is_dash(name))
    }

    /// The names of the state of the run, of which there should be one.
    fn states(&self) -> impl Iterator<Item = &PathBuf> {
        let named = self.output.iter().filter(|path| is_state_name(path));
        self.checkpoint.iter().chain(named)
    }

    /// The images to write, standard output if nothing is named.
    fn pictures(&self) -> impl Iterator<Item = &Path> {
        let named = self.output.iter().map(PathBuf::as_path);
        let unnamed = self.output.is_empty().then_some(Path::new("-"));
        named.filter(|path| !is_state_name(path)).chain(unnamed)
    }

    /// What is wrong with the options of a part, if anything.
    fn fault_of_part(&self) -> &'static str {
        let &Self { range, tiles, samples, .. } = self;
        let limited = self.time.is_some() || self.error.is_some();
        if range.is_none() && tiles.is_none() {
            ""
        } else if samples.is_none() || limited {
            "--samples and --tiles need -n, the samples of the whole run, and \
             neither --time nor --error"
        } else if range.is_some_and(|(_, end)| Some(end) > samples) {
            "--samples ends after the samples of the whole run, which are -n"
        } else if tiles.is_some() && self.reference.is_some() {
            "--tiles renders a part of the image, and --reference needs all of it"
        } else {
            ""
        }
    }

    /// The view that the options describe, not yet checked.
    pub fn view(&self) -> View {
        let &Arguments { position, target, up, fov, .. } = self;
        let position = position.unwrap_or(DVec3::ZERO);
        let target = target.unwrap_or(DVec3::Y);
        View { position, target, up, fov }
    }

    /// Chooses a camera outside of the box between two corners, if none is
    /// given, and returns the options for it.
    pub fn stand_outside(&mut self, corners: [DVec3; 2]) -> Option<String> {
        if self.has_camera() {
            return None;
        }
        let (width, height) = self.resolution;
        let aspect = f64::from(width) / f64::from(height);
        let view = self.view().outside(corners, aspect)?;
        (self.position, self.target) =
            (Some(view.position), Some(view.target));
        let [p, t] = [view.position, view.target].map(typed);
        Some(format!("-p {p} -t {t}"))
    }

    /// Whether the position of the camera or its target is known.
    pub fn has_camera(&self) -> bool {
        self.position.or(self.target).is_some()
    }

    /// The targets of the image, checked but untouched.
    pub fn images(&self) -> Result<Vec<ImageTarget>, String> {
        self.tell_files_apart()?;
        let format = self.format.unwrap_or(Format::Pgm);
        let check = |path: &Path| {
            ImageTarget::file(path, format, self.may_replace(path))
        };
        self.pictures().map(check).collect()
    }

    /// The PNG beside the scene.
    fn png(&self) -> Option<PathBuf> {
        let mut path = self.scene_file()?.to_owned();
        if path.extension().is_some_and(|e| e == "gz" || e == "zst") {
            path.set_extension("");
        }
        path.set_extension("png");
        Some(path)
    }

    /// The file of the scene; none if it is standard input.
    pub fn scene_file(&self) -> Option<&Path> {
        let named = self.scene.as_ref().or(self.input.as_ref())?;
        (!is_dash(named)).then_some(named)
    }

    fn tell_files_apart(&self) -> Result<(), String> {
        let reference = self.reference.as_deref();
        if self.scene_file().is_none() && reference.is_some_and(is_dash) {
            return Err("standard input can be read once only".to_owned());
        }
        let read = self.scene_file().into_iter().chain(reference);
        let more = self.report.iter().chain(&self.checkpoint);
        let written = self.pictures().chain(more.map(PathBuf::as_path));
        tell_apart(read, written)
    }

    /// The reports to write, each with its target.
    pub fn reports(&self) -> Result<Vec<(Kind, OutputTarget)>, String> {
        let check = |path: &PathBuf| {
            let force = self.may_replace(path);
            Ok((Kind::of(path)?, OutputTarget::file(path, force)?))
        };
        self.report.iter().map(check).collect()
    }

    /// The target of the checkpoint, if there shall be one.
    pub fn checkpoint(&self) -> Result<Option<OutputTarget>, String> {
        let same = self.checkpoint == self.resume;
        let check = |path: &PathBuf| {
            OutputTarget::file(path, same || self.may_replace(path))
        };
        self.checkpoint.as_ref().map(check).transpose()
    }

    /// The number of samples, if it is limited.
    pub fn samples(&self) -> Option<u64> {
        let limited = self.time.is_some() || self.error.is_some();
        self.samples.or((!limited).then_some(1))
    }

    /// The time at which a program that began at `start` should end.
    pub fn deadline(&self, start: Instant) -> Option<Instant> {
        let time = Duration::try_from_secs_f64(self.time?).ok()?;
        start.checked_add(time)
    }

    /// The part of the image to render.
    ///
    /// # Errors
    /// It does not lie within the image.
    pub fn window(&self) -> Result<Window, String> {
        let size = self.resolution;
        let whole = Window { corner: (0, 0), size };
        let window = self.crop.unwrap_or(whole);
        let fits = |at, n, side| at < side && n <= side - at;
        let Window { corner: (x, y), size: (width, height) } = window;
        match fits(x, width, size.0) && fits(y, height, size.1) {
            true => Ok(window),
            false => Err(format!(
                "--crop {window}: does not lie within the image of {}x{} pixels",
                size.0, size.1
            )),
        }
    }

    /// The part of the window to render.
    ///
    /// # Errors
    /// Those of [`Arguments::window`], or there are fewer rows of tiles than
    /// bands.
    pub fn band(&self) -> Result<Window, String> {
        let window = self.window()?;
        let (k, n) = self.tiles.unwrap_or((1, 1));
        match window.tile_rows() {
            rows if n <= rows => Ok(window.band((k, n))),
            rows => Err(format!(
                "--tiles {k}/{n}: the image has {rows} rows of tiles, and not \
                 more bands"
            )),
        }
    }

    /// The part of a run whose samples are placed together in these numbers;
    /// none if all of it is rendered.
    pub fn part(&self, replicate: u64) -> Option<Part> {
        if self.range.is_none() && self.tiles.is_none() {
            return None;
        }
        let of = self.samples?;
        let samples = self.range.unwrap_or((0, of));
        let band = self.tiles.unwrap_or((1, 1));
        Some(Part { samples, of, band }.rounded(replicate))
    }

    /// The number of samples to render here, if it is limited.
    pub fn goal(&self, replicate: u64) -> Option<u64> {
        let part = self.part(replicate).map(|part| part.count());
        part.or(self.samples())
    }

    /// What the image shows.
    pub fn subject(&self) -> Subject {
        let &Self { resolution, crop, albedo, .. } = self;
        Subject { resolution, crop, view: self.view(), albedo }
    }

    /// The options that describe the run, by name, for the report.
    pub fn settings(&self) -> Map<String, Value> {
        let mut settings = entries(&self.subject());
        let reference = self.reference.as_ref();
        settings.extend(entries(&json!({
            "seed": self.seed,
            "spp": self.samples(),
            "time": self.time,
            "error": self.error,
            "reference": reference.map(|path| path.display().to_string()),
            "isa": self.isa().to_string(),
        })));
        settings
    }

    /// The set of instructions to trace rays with.
    pub fn isa(&self) -> Isa {
        self.isa.unwrap_or_else(Isa::best)
    }

    /// The shortcuts that are not to be looked for.
    pub fn kept(&self) -> &[Shortcut] {
        if self.keep_all { &Shortcut::ALL } else { &self.keep }
    }

    /// The name of the input, for people.
    pub fn input_name(&self) -> String {
        match self.scene_file() {
            Some(path) => path.display().to_string(),
            None => "standard input".to_owned(),
        }
    }

    /// Whether a file may be replaced.
    fn may_replace(&self, path: &Path) -> bool {
        let old = self.replaced.iter().flat_map(|old| old.canonicalize());
        let is_own = |new| old.into_iter().any(|old| old == new);
        self.force || path.canonicalize().is_ok_and(is_own)
    }
}
