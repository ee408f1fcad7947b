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
use std::time::Duration;

use anstyle::{AnsiColor, Effects, Style};
use indicatif::{ProgressBar, ProgressState, ProgressStyle};

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
#[derive(Clone)]
pub struct Bar(ProgressBar);

impl Bar {
    // Begin a bar where a run stands
    /// A bar that stands at a number of paths.
    pub fn new(visible: bool, paths: u64) -> Self {
        let bar = match visible {
            true => ProgressBar::new(paths),
            false => ProgressBar::hidden(),
        };
        bar.set_style(style());
        bar.set_position(paths);
        bar.reset_eta();
        bar.enable_steady_tick(Duration::from_millis(250));
        Self(bar)
    }

    // Move the bar and take it away
    /// Advances by a number of paths; any thread may call it.
    pub fn advance(&self, paths: u64) {
        self.0.inc(paths);
    }

    /// Says how many paths there will be, and what is known by now.
    pub fn expect(&self, paths: u64, known: String) {
        self.0.set_length(paths);
        self.0.set_message(known);
    }

    /// Takes the bar away while something else is printed.
    pub fn suspend(&self, print: impl FnOnce()) {
        self.0.suspend(print);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.0.finish_and_clear();
    }
}

fn style() -> ProgressStyle {
    let template =
        "[{bar:14}] {floor} {msg}{elapsed} passed, {eta} to go, {rate}";
    let style = ProgressStyle::with_template(template);
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    // Compute the percentage and the rate
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
pub fn metric(x: f64) -> String {
    let scales = [(1e9, "G"), (1e6, "M"), (1e3, "k")];
    match scales.iter().find(|(scale, _)| x >= 0.9995 * scale) {
        Some((scale, prefix)) => format!("{:.2} {prefix}", x / scale),
        None => format!("{x:.0} "),
    }
}
