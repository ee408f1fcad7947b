// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! What the user reads on standard error.

// Name what the progress imports
use std::fmt;
use std::io::Write;
use std::time::{Duration, Instant};

use anstyle::{AnsiColor, Effects, Style};
use indicatif::{ProgressBar, ProgressState, ProgressStyle};

use crate::image::Image;

// Print messages with their marks
const GREEN: Style = AnsiColor::Green.on_default().effects(Effects::BOLD);
const RED: Style = AnsiColor::Red.on_default().effects(Effects::BOLD);
const YELLOW: Style = AnsiColor::Yellow.on_default().effects(Effects::BOLD);

fn print(style: Style, mark: &str, message: &str) {
    let mut stderr = anstream::stderr();
    let _ = writeln!(stderr, "{style}{mark}{style:#} {message}");
}

/// Tells the user something that is good to know.
pub fn inform(message: &str) {
    print(GREEN, ">", message);
}

/// Tells the user that something may not be what it seems.
pub fn warn(message: &str) {
    print(YELLOW, "warning:", message);
}

/// Tells the user why the program stops.
pub fn error(message: &str) {
    print(RED, "error:", message);
}

// Show a bar while rendering
/// A bar on the terminal, or nothing.
pub struct Bar(ProgressBar);

impl Bar {
    /// A bar for an image of `pixels`, each of so many `realisations`.
    pub fn new(visible: bool, pixels: u64, realisations: u64) -> Self {
        let paths = pixels.saturating_mul(realisations);
        let bar = match visible {
            true => ProgressBar::new(paths),
            false => ProgressBar::hidden(),
        };
        bar.set_style(style());
        bar.enable_steady_tick(Duration::from_millis(250));
        Self(bar)
    }

    /// Advances by a number of paths; any thread may call it.
    pub fn advance(&self, paths: u64) {
        self.0.inc(paths);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.0.finish_and_clear();
    }
}

fn style() -> ProgressStyle {
    let template =
        "[{bar:30}] {floor} {elapsed} passed, {eta} to go, {rate}";
    let style = ProgressStyle::with_template(template);
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    let floor = |state: &ProgressState, out: &mut dyn fmt::Write| {
        let paths = u128::from(state.len().unwrap_or(0).max(1));
        let _ = write!(out, "{}%", u128::from(state.pos()) * 100 / paths);
    };
    let rate = |state: &ProgressState, out: &mut dyn fmt::Write| {
        let _ = write!(out, "{}paths/s", metric(state.per_sec()));
    };
    let style = style.with_key("floor", floor).with_key("rate", rate);
    style.progress_chars("=> ")
}

/// A number to two decimals with a metric prefix, as in `1.25 M`.
fn metric(x: f64) -> String {
    let scales = [(1e9, "G"), (1e6, "M"), (1e3, "k")];
    match scales.iter().find(|(scale, _)| x >= *scale) {
        Some((scale, prefix)) => format!("{:.2} {prefix}", x / scale),
        None => format!("{x:.0} "),
    }
}

// Measure the time of each room
/// Seconds spent in each room of the program, one after the other.
pub struct Timings {
    last: Instant,
    load: f64,
    build: f64,
    render: f64,
}

impl Timings {
    /// Starts the clock.
    pub fn start() -> Self {
        Self { last: Instant::now(), load: 0., build: 0., render: 0. }
    }

    fn lap(&mut self) -> f64 {
        let last = std::mem::replace(&mut self.last, Instant::now());
        (self.last - last).as_secs_f64()
    }

    // Stop the clock at each door
    /// The scene has been loaded.
    pub fn loaded(&mut self) {
        self.load = self.lap();
    }

    /// The hierarchy has been built.
    pub fn built(&mut self) {
        self.build = self.lap();
    }

    /// The image has been rendered.
    pub fn rendered(&mut self) {
        self.render = self.lap();
    }

    // Summarise the run in two lines
    /// Prints the summary of a run.
    pub fn summarise(&self, triangles: usize, rays: u64, image: &Image) {
        let &Self { load, build, render, .. } = self;
        inform(&format!(
            "{triangles} triangles, load {load:.3} s, build {build:.3} s, \
             render {render:.3} s"
        ));
        let speed = metric(rays as f64 / render.max(1e-9));
        let mean = match image.mean() {
            (mean, error) if error.is_finite() => {
                format!("{mean:.6} ± {error:.6}")
            }
            (mean, _) => format!("{mean:.6}, error unknown (-n 1)"),
        };
        inform(&format!(
            "{rays} rays, {speed}rays/s, mean radiance {mean}"
        ));
    }
}
