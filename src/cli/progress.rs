// Tangled from chapters/progress.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Messages and a bar for the user, on standard error.

use std::fmt;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anstyle::{AnsiColor, Effects};
pub use indicatif::ProgressBar;
use indicatif::{HumanDuration, ProgressState, ProgressStyle};

use crate::report::metric;

fn print(colour: AnsiColor, mark: &str, message: &str) {
    let style = colour.on_default().effects(Effects::BOLD);
    let mut stderr = anstream::stderr();
    let _ = writeln!(stderr, "{style}{mark}{style:#} {message}");
}

/// Whether nothing but errors is printed.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Sets whether nothing but errors is printed, and no line is drawn.
pub fn set_quiet(is_quiet: bool) {
    QUIET.store(is_quiet, Ordering::Relaxed);
}

/// Whether the program is quiet.
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Informs the user.
pub fn inform(message: &str) {
    if !is_quiet() {
        print(AnsiColor::Green, ">", message);
    }
}

/// Warns the user that something may not be what it seems.
pub fn warn(message: &str) {
    if !is_quiet() {
        print(AnsiColor::Yellow, "warning:", message);
    }
}

/// Prints why the program stops.
pub fn error(message: &str) {
    print(AnsiColor::Red, "error:", message);
}

/// The percentage of a run that is done: of the expected paths, or of the
/// seconds to which it is limited, whichever is larger.
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

/// The elapsed seconds, with their limit or the remaining time, if it is
/// known.
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

/// A line on the terminal until it is dropped, or none in a quiet program.
fn line(style: ProgressStyle) -> ProgressBar {
    let line = match is_quiet() {
        true => ProgressBar::hidden(),
        false => ProgressBar::no_length(),
    };
    line.set_style(style);
    line.enable_steady_tick(Duration::from_millis(250));
    line
}

fn style(template: &str) -> ProgressStyle {
    let style = ProgressStyle::with_template(template);
    style.unwrap_or_else(|_| ProgressStyle::default_bar())
}

/// The bar of a program that began at `start` and may have a limit of its
/// time, in seconds.
pub fn render_bar(start: Instant, limit: Option<f64>) -> ProgressBar {
    type Out<'a> = &'a mut dyn fmt::Write;
    let clock = move || (start.elapsed().as_secs_f64(), limit);
    let done = move |state: &ProgressState, out: Out| {
        let percent = percent((state.pos(), state.len()), clock());
        let _ = out.write_str(&bar(percent, 14));
    };
    let pace = move |state: &ProgressState, out: Out| {
        let remains = state.len().map(|_| state.eta());
        let (time, rate) = (time(clock(), remains), state.per_sec());
        let _ = write!(out, "{time}, {}", metric(rate));
    };
    let style = style("{done} {msg}{pace}{prefix}/s");
    line(style.with_key("done", done).with_key("pace", pace))
}

/// Updates a bar: how much of a `unit` is done, how much there will be, if
/// that can be predicted, and the text.
pub fn update(
    bar: &ProgressBar,
    (done, total): (u64, Option<u64>),
    unit: &'static str,
    text: String,
) {
    match total {
        Some(total) => bar.set_length(total),
        None => bar.unset_length(),
    }
    if bar.prefix() != unit {
        bar.set_prefix(unit);
        bar.set_position(done);
        bar.reset_eta();
    }
    bar.set_message(text);
}

/// Shows that the run is stopping.
pub fn answer(bar: &ProgressBar) {
    bar.set_style(style("stopping"));
    bar.suspend(|| inform("finishing; a second signal aborts"));
}

/// A line on the work before a render; `total` is how much of it there is.
pub fn step(what: String, total: Option<u64>) -> ProgressBar {
    let step = line(style(match total {
        Some(_) => "{msg}: {percent}%, {elapsed}",
        None => "{msg}: {elapsed}",
    }));
    step.set_length(total.unwrap_or_default());
    step.with_message(what)
}
