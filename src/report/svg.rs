// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The drawing of error against time.

// Name what the curve imports
use maud::{Markup, html};

use super::axis::{Axis, Ruler};
use super::plot::{self, Frame};
use super::words::{duration, short};
use super::{FEWEST, Report, guide, points};

// Gather what the curve shows
type Points = Vec<((f64, f64), bool)>;

/// What the plot shows.
struct Curve<'a> {
    report: &'a Report,
    estimated: Points,
    truth: Points,
    guide: Option<f64>,
}

impl<'a> Curve<'a> {
    fn new(report: &'a Report) -> Self {
        let line = |error| {
            let points = points(&report.steps, |step| step.seconds, error);
            points.collect::<Points>()
        };
        let estimated = line(|step| step.rmse);
        let truth = line(|step| step.rmse_reference);
        let select = |all: bool| -> Vec<_> {
            let chosen = estimated.iter().filter(|p| all || p.1);
            chosen.map(|p| p.0).collect()
        };
        let guide = guide(&select(false)).or(guide(&select(true)));
        Self { report, estimated, truth, guide }
    }
}

impl Curve<'_> {
    /// Why there is no line of estimated errors.
    fn excuse(&self) -> &'static str {
        match self.report.steps.iter().rev().find_map(|s| s.rmse) {
            Some(0.) => "The estimated error is exactly 0 in every pixel.",
            _ => "No error is known yet.",
        }
    }

    /// The axes of time and error, unless there is no point.
    fn axes(&self) -> Option<(Axis, Axis)> {
        let all = || self.estimated.iter().chain(&self.truth);
        let times = Axis::around(all().map(|p| p.0.0))?;
        let errors = Axis::around(all().map(|p| p.0.1))?;
        Some((times, errors))
    }
}

// Draw the curve and its legend
/// The drawing in a file of its own.
pub fn drawing(report: &Report) -> String {
    let declaration = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
    declaration.to_owned() + &curve(report, true).into_string() + "\n"
}

/// The drawing, with its ink and paper if it stands `alone`.
pub fn curve(report: &Report, alone: bool) -> Markup {
    let curve = Curve::new(report);
    let rows = curve.legend();
    let frame = Frame { top: 36. + 18. * rows.len() as f64 };
    let content = html! {
        text x="240" y="20" text-anchor="middle" font-weight="bold" {
            (short(&report.scene.file, 36)) ": error against time"
        }
        // Draw the rows of the legend
        @for (i, (sample, text)) in rows.iter().enumerate() {
            g transform=(format!("translate(80 {})", 40 + 18 * i)) {
                (sample)
                text x="46" y="4" font-size="12" { (text) }
            }
        }
        @match curve.axes() {
            Some(axes) => (curve.draw(frame, axes)),
            None => (curve.draw_empty(frame)),
        }
        // Say what comes before the time
        g font-size="12" text-anchor="middle" {
            text x="240" y=(frame.bottom() + 58.) {
                "The time is that of rendering. Before it come "
                (duration(report.load_seconds))
            }
            text x="240" y=(frame.bottom() + 73.) {
                "of reading the scene and " (duration(report.build_seconds))
                " of building the hierarchy."
            }
        }
    };
    let size = frame.bottom() + 84.;
    plot::drawing((size, "Error against time"), alone, &content)
}

impl Curve<'_> {
    /// Samples of the lines that there are, with their meanings.
    fn legend(&self) -> Vec<(Markup, String)> {
        let ends = |good| [((0., 0.), good), ((36., 0.), good)];
        let mut rows = vec![];
        // Explain a missing line
        if self.estimated.is_empty() && !self.truth.is_empty() {
            rows.push((html! {}, self.excuse().to_owned()));
        }
        if !self.estimated.is_empty() {
            rows.push((estimated(&ends(true)), self.meaning()));
        }
        // Explain the hollow points
        if self.estimated.iter().any(|p| !p.1) {
            let meaning =
                format!("fewer than {FEWEST} realisations, not in the fit");
            rows.push((estimated(&[((18., 0.), false)]), meaning));
        }
        if !self.truth.is_empty() {
            let meaning = "difference from the reference (RMSE)";
            rows.push((truth(&ends(true)), meaning.to_owned()));
        }
        if self.guide.is_some() {
            let meaning = "guide of slope \u{2212}1/2";
            rows.push((dotted((0., 0.), (36., 0.)), meaning.to_owned()));
        }
        rows
    }
}

impl Curve<'_> {
    /// The estimated error in words, with the fitted slope.
    fn meaning(&self) -> String {
        let slope = match self.report.slope_seconds() {
            Some(fit) => format!("slope {fit}"),
            None => "too few points for a slope".to_owned(),
        };
        format!("estimated error (RMSE), {slope}")
    }

    fn draw_empty(&self, frame: Frame) -> Markup {
        let none = Ruler { lines: vec![], ticks: vec![] };
        let (x, y) = frame.middle();
        html! {
            (frame.draw((&none, TIME), (&none, ERROR)))
            text x=(x) y=(y) text-anchor="middle" { (self.excuse()) }
        }
    }
}

const TIME: &str = "rendering time / s";
const ERROR: &str = "RMSE / radiance of the sky";

impl Curve<'_> {
    fn draw(&self, frame: Frame, (times, errors): (Axis, Axis)) -> Markup {
        let place = |t: f64, e: f64| {
            (frame.x(times.place(t)), frame.y(errors.place(e)))
        };
        let places = |points: &Points| -> Points {
            points.iter().map(|&((t, e), ok)| (place(t, e), ok)).collect()
        };
        // Cut the guide at the frame
        let guide = self.guide.map(|g| {
            let time = |error: f64| (g / error) * (g / error);
            let from = time(errors.value(1.)).max(times.value(0.));
            let to = time(errors.value(0.)).min(times.value(1.));
            let end = |t: f64| place(t, g / t.sqrt());
            dotted(end(from), end(to))
        });
        let rulers = (times.ruler(), errors.ruler());
        html! {
            (frame.draw((&rulers.0, TIME), (&rulers.1, ERROR)))
            @if let Some(guide) = guide { (guide) }
            (truth(&places(&self.truth)))
            (estimated(&places(&self.estimated)))
        }
    }
}

// Draw lines and their marks
fn estimated(places: &[((f64, f64), bool)]) -> Markup {
    html! {
        (path(places, None))
        @for &((x, y), reliable) in places {
            @if reliable {
                circle cx=(x) cy=(y) r="3" {}
            } @else {
                circle.paper cx=(x) cy=(y) r="3" fill="white"
                    stroke="currentColor" {}
            }
        }
    }
}

fn truth(places: &[((f64, f64), bool)]) -> Markup {
    html! {
        (path(places, Some("7 4")))
        @for &((x, y), _) in places {
            rect.paper x=(x - 3.) y=(y - 3.) width="6" height="6"
                fill="white" stroke="currentColor" {}
        }
    }
}

/// A line through places, solid or with dashes.
fn path(places: &[((f64, f64), bool)], dashes: Option<&str>) -> Markup {
    let pair = |&((x, y), _): &((f64, f64), bool)| format!("{x},{y}");
    let pairs: Vec<_> = places.iter().map(pair).collect();
    html! {
        @if places.len() > 1 {
            polyline points=(pairs.join(" ")) fill="none"
                stroke="currentColor" stroke-width="1.5"
                stroke-dasharray=[dashes] {}
        }
    }
}

fn dotted(from: (f64, f64), to: (f64, f64)) -> Markup {
    html! {
        line x1=(from.0) y1=(from.1) x2=(to.0) y2=(to.1)
            stroke="currentColor" stroke-width="1.5"
            stroke-dasharray="1.5 4" stroke-linecap="round" {}
    }
}
