// Licensed under the GPL, version 3 or later
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

// Name what the arguments import
use std::fs;
use std::io::{self, Read};
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use clap::builder::Styles;
use clap::builder::styling::{AnsiColor, Effects, Style};
use glam::DVec3;
use rayon::ThreadPoolBuilder;

use crate::camera::View;
use crate::output::Destination;
use crate::progress;
use crate::scene::{Mesh, read_obj};

// Declare the options with their defaults
/// Renders a Wavefront OBJ of one diffuse material under a uniform sky.
#[derive(Debug, Parser)]
#[command(name = "pt", version, after_help = LICENCE, styles = STYLES)]
pub struct Arguments {
    // Declare the options of the image
    /// Definition of the image in pixels, each at most 16384
    #[arg(short, long, value_name = "WIDTHxHEIGHT",
          default_value = "320x240", value_parser = parse_definition,
          allow_hyphen_values = true)]
    pub definition: (u32, u32),

    /// Realisations (paths) per pixel, at least 1
    #[arg(short = 'n', long, value_name = "N",
          default_value = "1", value_parser = parse_realisations,
          allow_hyphen_values = true)]
    pub realisations: u64,
    // Declare the options of the camera
    /// Position of the camera
    #[arg(short, long, value_name = "X,Y,Z", default_value = "0,0,0",
          value_parser = parse_vector, allow_hyphen_values = true)]
    pub position: DVec3,

    /// Point that the camera looks at
    #[arg(short, long, value_name = "X,Y,Z", default_value = "0,1,0",
          value_parser = parse_vector, allow_hyphen_values = true)]
    pub target: DVec3,

    /// Up axis of the camera; its largest component tells where the sky is
    #[arg(short, long, value_name = "X,Y,Z", default_value = "0,0,1",
          value_parser = parse_vector, allow_hyphen_values = true)]
    pub up: DVec3,

    /// Vertical field of view in degrees, strictly between 0 and 180
    #[arg(short = 'F', long, value_name = "DEGREES", default_value = "70",
          value_parser = parse_fov, allow_hyphen_values = true)]
    pub fov: f64,
    // Declare the options of the scene
    /// Reflectivity of every surface, between 0 and 1
    #[arg(short, long, value_name = "REFLECTIVITY", default_value = "1",
          value_parser = parse_reflectivity, allow_hyphen_values = true)]
    pub reflectivity: f64,

    /// Wavefront OBJ to render [default: standard input]
    #[arg(short, long, value_name = "FILE")]
    pub input: Option<PathBuf>,
    // Declare the options of the run
    /// Image to write, .pgm or .png; may be repeated [default: standard output]
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,

    /// Overwrite the output files if they exist
    #[arg(short, long)]
    pub force: bool,

    /// Seed of the random numbers
    #[arg(
        short,
        long,
        value_name = "SEED",
        default_value = "0",
        allow_hyphen_values = true
    )]
    pub seed: u64,

    /// Number of threads; the image does not depend on it [default: all cores]
    #[arg(short = 'j', long, value_name = "N",
          value_parser = parse_threads, allow_hyphen_values = true)]
    pub threads: Option<usize>,

    /// Print nothing but errors
    #[arg(short, long)]
    pub quiet: bool,
}

const LICENCE: &str = "\
Copyright (C) 2026 litpt contributors.
Licence GPLv3+: GNU GPL version 3 or later. This is free software: you are
free to change and redistribute it. There is NO WARRANTY, to the extent
permitted by law.";

const STYLES: Styles = Styles::styled()
    .error(AnsiColor::Red.on_default().effects(Effects::BOLD))
    .header(Style::new().effects(Effects::BOLD))
    .usage(Style::new().effects(Effects::BOLD))
    .literal(Style::new().effects(Effects::BOLD));

// Parse the values with exact syntax
fn parse_definition(text: &str) -> Result<(u32, u32), String> {
    let syntax = "expected two integers around one x, as in 800x600";
    let (width, height) = text.split_once('x').ok_or(syntax)?;
    let side = |digits: &str| match digits.parse() {
        _ if !digits.bytes().all(|b| b.is_ascii_digit()) => {
            Err(syntax.to_owned())
        }
        Ok(0) => Err("an image has at least one pixel".to_owned()),
        Ok(n @ 1..=MAX_SIDE) => Ok(n),
        Ok(_) => Err(format!("at most {MAX_SIDE} pixels a side")),
        Err(_) => Err(syntax.to_owned()),
    };
    Ok((side(width)?, side(height)?))
}

const MAX_SIDE: u32 = 16384;

fn parse_real(text: &str) -> Result<f64, String> {
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

fn parse_reflectivity(text: &str) -> Result<f64, String> {
    match parse_real(text)? {
        rho if (0. ..=1.).contains(&rho) => Ok(rho),
        _ => Err("expected a reflectivity between 0 and 1".to_owned()),
    }
}

fn parse_realisations(text: &str) -> Result<u64, String> {
    match text.parse() {
        Ok(0) => Err("a pixel needs at least one realisation".to_owned()),
        Ok(n) => Ok(n),
        Err(_) => Err("expected a positive integer".to_owned()),
    }
}

fn parse_threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ 1..=4096) => Ok(n),
        _ => Err("expected an integer between 1 and 4096".to_owned()),
    }
}

/// The one line that says what is wrong with the command line.
fn explain(error: &clap::Error) -> String {
    let text = error.to_string();
    let line = text.lines().next().unwrap_or_default();
    let line = line.strip_prefix("error: ").unwrap_or(line);
    format!("{line} (see pt --help)")
}

impl Arguments {
    // Read the command line or explain it
    /// Parses the arguments of the process. When there is nothing to
    /// render, because help was asked for or a value is wrong, prints what
    /// the user should know and returns the exit status.
    pub fn from_command_line() -> Result<Self, ExitCode> {
        Self::try_parse().map_err(|error| {
            if error.use_stderr() {
                progress::error(&explain(&error));
                return ExitCode::from(2);
            }
            // A reader that closes the pipe has seen enough.
            let _ = error.print();
            ExitCode::SUCCESS
        })
    }

    // Hand the values to other rooms
    /// The view that the options describe, not yet checked.
    pub fn view(&self) -> View {
        let &Arguments { position, target, up, fov, .. } = self;
        View { position, target, up, fov }
    }

    /// The places that the image goes to, checked but untouched.
    pub fn destinations(&self) -> Result<Vec<Destination>, String> {
        if self.output.is_empty() {
            return Ok(vec![Destination::standard_output()]);
        }
        for (i, path) in self.output.iter().enumerate() {
            if self.output[..i].contains(path) {
                return Err(format!(
                    "{}: given twice with -o",
                    path.display()
                ));
            }
        }
        let check = |path: &PathBuf| Destination::file(path, self.force);
        self.output.iter().map(check).collect()
    }

    /// Reads the mesh from the input file or from standard input.
    pub fn read_mesh(&self) -> Result<Mesh, String> {
        let (name, bytes) = match &self.input {
            Some(path) => (path.display().to_string(), fs::read(path)),
            None => {
                let mut bytes = Vec::new();
                let read = io::stdin().read_to_end(&mut bytes);
                ("standard input".to_owned(), read.map(|_| bytes))
            }
        };
        let bytes =
            bytes.map_err(|e| format!("{name}: cannot read: {e}"))?;
        read_obj(&bytes).map_err(|error| error.within(&name))
    }

    /// Starts the pool of worker threads.
    pub fn start_threads(&self) -> Result<(), String> {
        let pool = ThreadPoolBuilder::new();
        let pool = pool.num_threads(self.threads.unwrap_or(0));
        pool.build_global()
            .map_err(|e| format!("cannot start threads: {e}"))
    }
}
