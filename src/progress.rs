// Tangled from chapters/progress.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What the user reads on standard error.

use std::fmt;
use std::io::Write;
use std::time::{Duration, Instant};

use anstyle::{AnsiColor, Effects};
use indicatif::{HumanDuration, ProgressBar, ProgressState, ProgressStyle};

fn print(colour: AnsiColor, mark: &str, message: &str) {
    let style = colour.on_default().effects(Effects::BOLD);
    let mut stderr = anstream::stderr();
    let _ = writeln!(stderr, "{style}{mark}{style:#} {message}");
}

/// Tells the user something that is good to know.
pub fn inform(message: &str) {
    print(AnsiColor::Green, ">", message);
}

/// Tells the user that something may not be what it seems.
pub fn warn(message: &str) {
    print(AnsiColor::Yellow, "warning:", message);
}

/// Tells the user why the program stops.
pub fn error(message: &str) {
    print(AnsiColor::Red, "error:", message);
}

/// How much of a run is done, in per cent: the share of the paths that are
/// expected, or that of the seconds to which it is limited, whichever is
/// larger.
pub fn percent(
    (paths, expected): (u64, Option<u64>),
    (seconds, limit): (f64, Option<f64>),
) -> usize {
    let of_paths =
        expected.map_or(0., |n| 100. * paths as f64 / n.max(1) as f64);
    let of_time = limit.map_or(0., |limit| 100. * seconds / limit);
    of_paths.max(of_time).min(100.) as usize
}

/// A bar of so many places.
pub fn bar(percent: usize, places: usize) -> String {
    let done = percent * places / 100;
    let arrow = if done < places { ">" } else { "" };
    let bar = "=".repeat(done) + arrow;
    format!("[{bar:places$}] {percent}%")
}

/// The seconds that have passed, with their limit or the time that remains,
/// if that is known.
pub fn time(
    (seconds, limit): (f64, Option<f64>),
    remains: Option<Duration>,
) -> String {
    let passed = HumanDuration(Duration::from_secs_f64(seconds));
    match (limit, remains.map(HumanDuration)) {
        (Some(limit), _) => {
            format!("{} s of {limit} s", seconds.min(limit).floor())
        }
        (None, Some(more)) => format!("{passed:#} passed, {more:#} to go"),
        (None, None) => format!("{passed:#} passed"),
    }
}

/// A line on the terminal, or nothing.
fn line(visible: bool, style: ProgressStyle) -> ProgressBar {
    let line = match visible {
        true => ProgressBar::no_length(),
        false => ProgressBar::hidden(),
    };
    line.set_style(style);
    line.enable_steady_tick(Duration::from_millis(250));
    line
}

fn style(template: &str) -> ProgressStyle {
    let style = ProgressStyle::with_template(template);
    style.unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// A bar on the terminal, or nothing.
#[derive(Clone)]
pub struct Bar(ProgressBar);

impl Bar {
    /// The bar of a program that began at `start` and may have a limit of
    /// its time, in seconds.
    pub fn new(visible: bool, start: Instant, limit: Option<f64>) -> Self {
        type Out<'a> = &'a mut dyn fmt::Write;
        let clock = move || (start.elapsed().as_secs_f64(), limit);
        let done = move |state: &ProgressState, out: Out| {
            let percent = percent((state.pos(), state.len()), clock());
            let _ = out.write_str(&bar(percent, 14));
        };
        let time = move |state: &ProgressState, out: Out| {
            let remains = state.len().map(|_| state.eta());
            let _ = out.write_str(&time(clock(), remains));
        };
        let rate = |state: &ProgressState, out: Out| {
            let _ = out.write_str(&metric(state.per_sec()));
        };
        let style = style("{done} {msg}{time}, {rate}{prefix}/s")
            .with_key("done", done)
            .with_key("time", time)
            .with_key("rate", rate);
        Self(line(visible, style))
    }

    /// Advances by a number of paths; any thread may call it.
    pub fn advance(&self, paths: u64) {
        self.0.inc(paths);
    }

    /// Says how many paths there are and will be, if that can be foreseen, or
    /// how much of another `unit`, and what is known by now.
    pub fn expect(
        &self,
        done: u64,
        all: Option<u64>,
        unit: &'static str,
        known: String,
    ) {
        match all {
            Some(all) => self.0.set_length(all),
            None => self.0.unset_length(),
        }
        if self.0.prefix() != unit {
            self.0.set_prefix(unit);
            self.0.set_position(done);
            self.0.reset_eta();
        }
        self.0.set_message(known);
    }

    /// Says that the run has been asked to stop.
    pub fn stop(&self, quiet: bool) {
        self.0.set_style(style("stopping"));
        if !quiet {
            let line = "finishing; a second signal aborts";
            self.suspend(|| inform(line));
        }
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

/// A number to two decimals with a metric prefix, as in `1.25 M`.
pub fn metric(x: f64) -> String {
    let scales = [(1e9, "G"), (1e6, "M"), (1e3, "k")];
    match scales.iter().find(|(scale, _)| x >= 0.9995 * scale) {
        Some((scale, prefix)) => format!("{:.2} {prefix}", x / scale),
        None => format!("{x:.0} "),
    }
}

/// What is done before a render, on a line of the terminal until it is
/// dropped.
pub struct Step(ProgressBar);

impl Step {
    /// Says `what` is done; `total` is how much of it there is.
    pub fn new(visible: bool, what: String, total: Option<u64>) -> Self {
        let step = match total {
            Some(_) => line(visible, style("{msg}: {percent}%, {elapsed}")),
            None => line(visible, style("{msg}: {elapsed}")),
        };
        step.set_length(total.unwrap_or_default());
        step.set_message(what);
        Self(step)
    }

    /// Says how much is done by now.
    pub fn reach(&self, done: u64) {
        self.0.set_position(done);
    }
}

impl Drop for Step {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
