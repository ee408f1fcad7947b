// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! What the user reads on standard error.

use std::fmt;
use std::io::Write;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use anstyle::{AnsiColor, Effects, Style};
use indicatif::{HumanDuration, ProgressBar, ProgressState, ProgressStyle};

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

/// How much of a run is done, as the bar shows it.
#[derive(Clone, Debug, Default)]
pub struct Progress {
    limit: Option<f64>,
    /// Paths that there will be, if that can be foreseen.
    pub expected: Option<u64>,
    /// What is counted, as in `paths`.
    pub unit: &'static str,
    /// Whether the run has been asked to stop.
    pub stopping: bool,
    percent: u64,
    seconds: f64,
}

impl Progress {
    /// Nothing is done; the program may have a limit of its time, in
    /// seconds.
    pub fn within(limit: Option<f64>) -> Self {
        Self { limit, ..Self::default() }
    }

    /// Takes in the number of paths that there are by now, and the seconds
    /// that have passed since the program began.
    pub fn update(&mut self, paths: u64, seconds: f64) {
        if self.stopping {
            return;
        }
        let of_paths = |expected: u64| {
            let expected = u128::from(expected.max(1));
            (u128::from(paths) * 100 / expected) as u64
        };
        let of_paths = self.expected.map_or(0, of_paths);
        let of_time = |limit: f64| (100. * seconds / limit) as u64;
        let of_time = self.limit.map_or(0, of_time);
        self.percent = of_paths.max(of_time).min(100);
        self.seconds = seconds;
    }

    /// The percentage, with a bar of so many places before it.
    pub fn bar(&self, places: usize) -> String {
        let done = self.percent as usize * places / 100;
        let mut bar = "=".repeat(done);
        if done < places {
            bar.push('>');
        }
        format!("[{bar:places$}] {}%", self.percent)
    }

    /// The time that has passed, with its limit or, if paths are expected,
    /// the time that remains.
    pub fn time(&self, remains: Duration) -> String {
        let passed = Duration::from_secs_f64(self.seconds);
        let passed = HumanDuration(passed);
        match (self.limit, self.expected) {
            _ if self.stopping => "stopping".to_owned(),
            (Some(limit), _) => {
                let seconds = self.seconds.min(limit).floor();
                format!("{seconds} s of {limit} s")
            }
            (None, Some(_)) => {
                let remains = HumanDuration(remains);
                format!("{passed:#} passed, {remains:#} to go")
            }
            (None, None) => format!("{passed:#} passed"),
        }
    }
}

/// A bar on the terminal, or nothing.
#[derive(Clone)]
pub struct Bar {
    bar: ProgressBar,
    progress: Arc<Mutex<Progress>>,
}

impl Bar {
    /// The bar of a program that began at `start` and may have a limit of
    /// its time, in seconds.
    pub fn new(visible: bool, start: Instant, limit: Option<f64>) -> Self {
        let bar = match visible {
            true => ProgressBar::no_length(),
            false => ProgressBar::hidden(),
        };
        let progress = Arc::new(Mutex::new(Progress::within(limit)));
        bar.set_style(style(&progress, start));
        bar.enable_steady_tick(Duration::from_millis(250));
        Self { bar, progress }
    }

    /// Advances by a number of paths; any thread may call it.
    pub fn advance(&self, paths: u64) {
        self.bar.inc(paths);
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
        let mut progress = locked(&self.progress);
        let is_new = progress.unit != unit;
        (progress.expected, progress.unit) = (all, unit);
        drop(progress);
        if let Some(all) = all {
            self.bar.set_length(all);
        }
        if is_new {
            self.bar.set_position(done);
            self.bar.reset_eta();
        }
        self.bar.set_message(known);
    }

    /// Says that the run has been asked to stop.
    pub fn stop(&self) {
        locked(&self.progress).stopping = true;
    }

    /// Takes the bar away while something else is printed.
    pub fn suspend(&self, print: impl FnOnce()) {
        self.bar.suspend(print);
    }

    /// Removes the bar.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// What is shown, for this thread alone.
fn locked(progress: &Mutex<Progress>) -> MutexGuard<'_, Progress> {
    progress.lock().unwrap_or_else(PoisonError::into_inner)
}

fn style(progress: &Arc<Mutex<Progress>>, start: Instant) -> ProgressStyle {
    let style = ProgressStyle::with_template("{done} {msg}{time}, {rate}");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    let [shown, told, unit] = [0; 3].map(|_| progress.clone());
    // Draw the bar, the time and the rate
    let done = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        let mut progress = locked(&shown);
        progress.update(state.pos(), start.elapsed().as_secs_f64());
        let _ = write!(out, "{}", progress.bar(14));
    };
    let time = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        let _ = write!(out, "{}", locked(&told).time(state.eta()));
    };
    let rate = move |state: &ProgressState, out: &mut dyn fmt::Write| {
        let (rate, unit) = (metric(state.per_sec()), locked(&unit).unit);
        let _ = write!(out, "{rate}{unit}/s");
    };
    style
        .with_key("done", done)
        .with_key("time", time)
        .with_key("rate", rate)
}

/// A number to two decimals with a metric prefix, as in `1.25 M`.
pub fn metric(x: f64) -> String {
    let scales = [(1e9, "G"), (1e6, "M"), (1e3, "k")];
    match scales.iter().find(|(scale, _)| x >= 0.9995 * scale) {
        Some((scale, prefix)) => format!("{:.2} {prefix}", x / scale),
        None => format!("{x:.0} "),
    }
}

/// A line on the terminal, or nothing, until it is dropped.
pub struct Step(ProgressBar);

impl Step {
    /// Says `what` is done; `total` is how much of it there is.
    pub fn new(visible: bool, what: String, total: Option<u64>) -> Self {
        let bar = match visible {
            true => ProgressBar::new(total.unwrap_or_default()),
            false => ProgressBar::hidden(),
        };
        let template = match total {
            Some(_) => "{msg}: {percent}%, {elapsed}",
            None => "{msg}: {elapsed}",
        };
        let style = ProgressStyle::with_template(template);
        bar.set_style(
            style.unwrap_or_else(|_| ProgressStyle::default_bar()),
        );
        bar.set_message(what);
        bar.enable_steady_tick(Duration::from_millis(250));
        Self(bar)
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
