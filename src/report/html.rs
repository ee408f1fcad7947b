// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! A page for people: one file that needs nothing else.

// Name what the page imports
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::Value;

use super::histogram::Histogram;
use super::pixels::{Grid, MIDDLE};
use super::words::{count, duration, figures, short, with_error};
use super::{Report, Step, svg};
use crate::analysis::Finding;
use crate::image::Image;

// Lay out the page
/// The page of a run and its image.
pub fn page(report: &Report, image: &Image) -> String {
    let scene = short(&report.scene.file, LONGEST);
    let markup = html! {
        (DOCTYPE)
        html lang="en-GB" {
            // Write the head of the page
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width";
                title { (scene) ": report of a render" }
                style { (PreEscaped(STYLE)) }
            }
            // Write the body of the page
            body {
                h1 { (scene) }
                (summary(report, image))
                div.figures {
                    (images(image))
                    figure { (svg::curve(report, false)) }
                    (errors(image))
                }
                div.figures { (timings(report)) (settings(report)) }
                @if !report.left_out.is_empty() { (left_out(report)) }
                (steps(&report.steps))
            }
        }
    };
    markup.into_string() + "\n"
}

/// The longest name or value that is shown whole, in characters.
const LONGEST: usize = 1000;

const STYLE: &str = "
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif }
body { max-width: 72rem; margin: 0 auto; padding: 1rem }
h1, p, figcaption, .analysis td { overflow-wrap: anywhere }
h1 { font-size: 1.6rem; line-height: 1.2 }
h2 { font-size: 1.1rem; margin: 1.5rem 0 0.5rem }
p { max-width: 44rem }
.figures { display: grid; gap: 1.5rem 2rem; align-items: start;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 28rem), 1fr)) }
figure, section { margin: 0; min-width: 0 }
figcaption { font-size: 0.9rem }
img { max-width: 100%; min-width: min(100%, 20rem); height: auto;
  display: block }
svg { width: 100%; height: auto; display: block }
.paper { fill: Canvas }
.scale { height: 0.8rem; border: 1px solid; margin-top: 0.5rem;
  background: linear-gradient(to right, #000, #fff) }
.range { display: flex; justify-content: space-between;
  font-size: 0.9rem }
.scroll { overflow-x: auto }
table { border-collapse: collapse; font-variant-numeric: tabular-nums }
th, td { padding: 0.15rem 1rem 0.15rem 0; text-align: left;
  vertical-align: top; border-bottom: 1px solid #8886 }
tbody th { font-weight: normal }
.numbers th, .numbers td, .times td { text-align: right;
  white-space: nowrap }
";

// Tell the run in words
fn summary(report: &Report, image: &Image) -> Markup {
    let spp = report.steps.last().map_or(0, |step| step.spp);
    html! {
        // Say what was rendered and how long
        p {
            (report.program) " rendered this scene of "
            (count(report.scene.triangles)) " triangles in "
            (image.width) "\u{202f}\u{d7}\u{202f}" (image.height)
            " pixels, with " (count(spp)) " samples in each, in "
            (duration(report.render_seconds)) ". Reading the scene had taken "
            (duration(report.load_seconds)) " and building its hierarchy "
            (duration(report.build_seconds)) "."
        }
        // Say how good the image is
        p {
            "The mean radiance of the image is "
            b { (with_error(report.mean, report.mean_stderr)) }
            ", where that of the sky is 1. "
            @match report.rmse.filter(|e| e.is_finite()) {
                Some(e) => {
                    "Its pixels have an estimated root mean square error of "
                    b { (figures(e)) } "."
                }
                None => "The error of its pixels is not known yet.",
            }
            // Admit what the pixels cannot see
            @if report.constant_pixels > 0 {
                " In " (count(report.constant_pixels)) " pixels all samples \
                were alike, so that they cannot see an error of their own."
            }
        }
        // Say how fast the error falls
        @if let Some(seconds) = report.slope_seconds()
            && let Some(spp) = report.slope_spp()
        {
            p {
                "On logarithmic axes the error falls with a slope of "
                (seconds) " against seconds and of " (spp) " against \
                samples; independent samples give \u{2212}0.5."
            }
        }
        p { (ending(report)) }
    }
}

fn ending(report: &Report) -> String {
    let reason = match report.stopped.as_deref() {
        None => {
            return "The run goes on; this is what it knew when the \
                    page was written."
                .to_owned();
        }
        Some("samples") => "the samples asked for were done",
        Some("time") => "the time allowed was over",
        Some("error") => "the error asked for was reached",
        Some("signal") => "a signal asked it to",
        Some(other) => other,
    };
    format!("The run ended because {reason}.")
}

// Show the image and its error
fn images(image: &Image) -> Markup {
    let size = (image.width, image.height);
    let film = Grid::new(size, image.means.iter().copied());
    html! {
        @if let Some(address) = film.and_then(|grid| grid.embed(1.)) {
            figure {
                img src=(address) alt="The rendered image";
                figcaption { "The image. White is the radiance of the \
                    sky, or more." }
            }
        }
        // Show the map and its scale
        @if let Some((address, white)) = map(image) {
            figure {
                img src=(address) alt="A map of the standard error";
                div.scale {}
                div.range {
                    span { "0" }
                    span { (figures(MIDDLE * white)) }
                    span { (figures(white)) }
                }
                figcaption { "The standard error of each pixel. At most one \
                    pixel in a thousand lies above the scale; it is white, \
                    as is a pixel whose error is unknown." }
            }
        }
    }
}

/// The address of a map of the errors, and the error that is white.
fn map(image: &Image) -> Option<(String, f64)> {
    let size = (image.width, image.height);
    let squares = image.errors.as_ref()?.iter().map(|e| e * e);
    let grid = Grid::new(size, squares)?.root();
    let white = grid.white()?;
    Some((grid.embed(white)?, white))
}

fn errors(image: &Image) -> Markup {
    let none = vec![f64::INFINITY; image.means.len()];
    let errors = image.errors.as_ref().unwrap_or(&none);
    let histogram = Histogram::of(errors);
    html! {
        figure {
            @if let Some(drawing) = histogram.draw() { (drawing) }
            // Count the pixels of each kind
            figcaption {
                "Of " (count(errors.len() as u64)) " pixels, "
                (count(histogram.counts.iter().sum()))
                " have a known error above 0, "
                (count(histogram.zero)) " an error of 0, and "
                (count(histogram.unknown)) " an unknown one."
            }
        }
    }
}

// List settings, timings and steps
type Row<'a> = (&'a str, String);

fn table((title, class): (&str, &str), rows: &[Row]) -> Markup {
    html! {
        section {
            h2 { (title) }
            div.scroll { table class=(class) { tbody {
                @for (name, value) in rows {
                    tr { th scope="row" { (name) } td { (value) } }
                }
            } } }
        }
    }
}

fn timings(report: &Report) -> Markup {
    let (load, build) = (report.load_seconds, report.build_seconds);
    let render = report.render_seconds;
    let rate = report.rays as f64 / render / 1e6;
    let rows = [
        ("reading the scene", duration(load)),
        ("building the hierarchy", duration(build)),
        ("rendering", duration(render)),
        ("together", duration(load + build + render)),
        ("rays", count(report.rays)),
        ("million rays per second of rendering", figures(rate)),
    ];
    table(("Timings", "times"), &rows)
}

fn settings(report: &Report) -> Markup {
    let text = |value: &Value| match value {
        Value::String(text) => short(text, LONGEST),
        Value::Null => "none".to_owned(),
        other => short(&other.to_string(), LONGEST),
    };
    let scene = &report.scene;
    let mut rows = vec![
        ("scene", short(&scene.file, LONGEST)),
        ("SHA-256", short(&scene.sha256, LONGEST)),
    ];
    rows.extend(report.settings.iter().map(|(k, v)| (&**k, text(v))));
    table(("Scene and settings", "facts"), &rows)
}

fn left_out(report: &Report) -> Markup {
    let row =
        |finding: &'_ Finding| (finding.fact.clone(), finding.why.clone());
    let rows: Vec<_> = report.left_out.iter().map(row).collect();
    let rows: Vec<_> =
        rows.iter().map(|(fact, why)| (&**fact, why.clone())).collect();
    table(("Left out", "facts"), &rows)
}

fn steps(steps: &[Step]) -> Markup {
    let reference = steps.iter().any(|s| s.rmse_reference.is_some());
    html! {
        h2 { "Steps" }
        div.scroll { table.numbers {
            thead { tr {
                th { "samples" } th { "seconds" } th { "rays" }
                th { "RMSE" }
                @if reference { th { "from reference" } }
                th { "mean radiance" }
            } }
            tbody { @for step in steps {
                // Show one step in a row
                tr {
                    td { (count(step.spp)) }
                    td { (figures(step.seconds)) }
                    td { (count(step.rays)) }
                    td { (known(step.rmse)) }
                    @if reference { td { (known(step.rmse_reference)) } }
                    td { (with_error(step.mean, step.mean_stderr)) }
                }
            } }
        } }
    }
}

fn known(x: Option<f64>) -> String {
    x.map_or("unknown".to_owned(), figures)
}
