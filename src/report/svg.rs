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
use super::{FEWEST, Point, Report, guide, points, reliable};

// Gather what the curve shows
/// What the plot shows.
struct Curve<'a> {
    report: &'a Report,
    estimated: Vec<Point>,
    truth: Vec<Point>,
    guide: Option<f64>,
}

impl<'a> Curve<'a> {
    fn new(report: &'a Report) -> Self {
        let line =
            |error| points(&report.steps, |step| step.seconds, error);
        let estimated = line(|step| step.rmse);
        let truth = line(|step| step.rmse_reference);
        let all: Vec<_> = estimated.iter().map(|p| p.0).collect();
        let guide = guide(&reliable(&estimated)).or(guide(&all));
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
}

impl Curve<'_> {
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
        // Write the title and the legend
        text x="240" y="20" text-anchor="middle" font-weight="bold" {
            (short(&report.scene.file, 36)) ": error against time"
        }
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
        let ends = [((0., 0.), true), ((36., 0.), true)];
        let mut rows = vec![];
        // Explain a missing line
        if self.estimated.is_empty() && !self.truth.is_empty() {
            rows.push((html! {}, self.excuse().to_owned()));
        }
        // Explain the estimated errors
        if !self.estimated.is_empty() {
            rows.push((estimated(&ends), self.meaning()));
        }
        if self.estimated.iter().any(|p| !p.1) {
            let meaning =
                format!("fewer than {FEWEST} samples, not in the fit");
            rows.push((estimated(&[((18., 0.), false)]), meaning));
        }
        // Explain the true errors
        if !self.truth.is_empty() {
            let meaning = "difference from the reference (RMSE)";
            rows.push((truth(&ends), meaning.to_owned()));
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
}

const TIME: &str = "rendering time / s";
const ERROR: &str = "RMSE / radiance of the sky";

impl Curve<'_> {
    fn draw(&self, frame: Frame, (times, errors): (Axis, Axis)) -> Markup {
        // Turn points into places of the frame
        let place = |(t, e): (f64, f64)| {
            (frame.x(times.place(t)), frame.y(errors.place(e)))
        };
        let places = |points: &[Point]| -> Vec<Point> {
            points.iter().map(|p| (place(p.0), p.1)).collect()
        };
        // Cut the guide at the frame
        let guide = self.guide.map(|g| {
            let time = |error: f64| (g / error) * (g / error);
            let from = time(errors.value(1.)).max(times.value(0.));
            let to = time(errors.value(0.)).min(times.value(1.));
            let end = |t: f64| place((t, g / t.sqrt()));
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

impl Curve<'_> {
    fn draw_empty(&self, frame: Frame) -> Markup {
        let none = Ruler { lines: vec![], ticks: vec![] };
        html! {
            (frame.draw((&none, TIME), (&none, ERROR)))
            text x=(frame.x(0.5)) y=(frame.y(0.5)) text-anchor="middle" {
                (self.excuse())
            }
        }
    }
}

// Draw lines and their marks
fn estimated(places: &[Point]) -> Markup {
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

fn truth(places: &[Point]) -> Markup {
    html! {
        (path(places, Some("7 4")))
        @for &((x, y), _) in places {
            rect.paper x=(x - 3.) y=(y - 3.) width="6" height="6"
                fill="white" stroke="currentColor" {}
        }
    }
}

/// A line through places, solid or with dashes.
fn path(places: &[Point], dashes: Option<&str>) -> Markup {
    let pairs = places.iter().map(|((x, y), _)| format!("{x},{y}"));
    let pairs = pairs.collect::<Vec<_>>().join(" ");
    html! {
        @if places.len() > 1 {
            polyline points=(pairs) fill="none" stroke="currentColor"
                stroke-width="1.5" stroke-dasharray=[dashes] {}
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
