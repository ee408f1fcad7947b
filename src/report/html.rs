// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! A page for people: one file that needs nothing else.

use base64::prelude::{BASE64_STANDARD, Engine};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::Value;

use super::plot::plot;
use super::result::{Fit, Report, as_typed, known, with_error};
use crate::compare::display::{self, shrink};
use crate::image::{Format, Image};
use crate::render::Share;
use crate::render_loop::CurvePoint;

/// The page of a run and its image.
pub fn page(report: &Report, image: &Image) -> String {
    let scene = printable(&report.scene.file);
    let pixels = u64::from(image.width) * u64::from(image.height);
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
            body {
                h1 { (scene) }
                p { "Run " (report.verdict()) "." }
                div { (pictures(report, image)) }
                // Tabulate the summary
                table {
                    @for (name, text) in report.summary(pixels).into_iter().skip(1) {
                        tr { th { (name) } td { (printable(&text)) } }
                    }
                    @if let Some(slopes) = slopes(report) {
                        tr { th { "slope" } td { (slopes) } }
                    }
                }
                // Tabulate what was set
                table {
                    @for (name, text) in [
                        ("command", &report.command),
                        ("date", &report.date),
                        ("program", &report.program),
                        ("processor", &report.processor),
                        ("SHA-256", &report.scene.sha256),
                    ] {
                        tr { th { (name) } td { (printable(text)) } }
                    }
                    @for (name, value) in &report.settings {
                        tr { th { (printable(name)) } td { (value_of(name, value)) } }
                    }
                }
                (points(&report.curve))
                @if !report.ranks.is_empty() { (shares(&report.ranks)) }
            }
        }
    };
    markup.into_string() + "\n"
}

const STYLE: &str = "
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif }
body { max-width: 80rem; margin: 0 auto; padding: 0 1rem }
h1 { font-size: 1.5rem; margin: 1rem 0 0 }
h1, p, th + td { overflow-wrap: anywhere }
th, td + td { white-space: nowrap }
p { margin: 0.3rem 0 }
div { display: grid; gap: 1.5rem; align-items: start;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 20rem), 1fr)) }
figure { margin: 0.5rem 0 }
figcaption { font-size: 0.9rem }
img, svg { display: block; width: 100%; height: auto }
img { box-sizing: border-box; border: 1px solid #888;
  image-rendering: pixelated }
table { display: block; overflow-x: auto; border-collapse: collapse;
  margin: 1.5rem 0; font-variant-numeric: tabular-nums }
th, td { padding: 0.15rem 1rem 0.15rem 0; text-align: left;
  vertical-align: top; border-bottom: 1px solid #8886 }
th:first-child { min-width: 5.75rem }
";

/// A text with what no page may contain replaced.
fn printable(text: &str) -> String {
    let never = ['\u{fffe}', '\u{ffff}'];
    let allowed = |c: char| !c.is_control() && !never.contains(&c);
    let shown = |c: char| if allowed(c) { c } else { '\u{fffd}' };
    text.chars().map(shown).collect()
}

fn slopes(report: &Report) -> Option<String> {
    let slope = |spent| {
        let Fit { slope, stderr } = report.slope(spent)?;
        let error = (stderr * 1e3).ceil().max(1.) / 1e3;
        Some(format!("{slope:.3} \u{b1} {error:.3}"))
    };
    let seconds = slope(|point| point.seconds)?;
    let spp = slope(|point| point.spp as f64)?;
    Some(format!(
        "{seconds} against seconds, {spp} against samples, on \
         logarithmic axes; independent samples give -0.5"
    ))
}

fn pictures(report: &Report, image: &Image) -> Markup {
    // Name the size and the range of the image
    let size = format!("{}x{} pixels", image.width, image.height);
    let least = image.means.iter().copied().fold(f64::INFINITY, f64::min);
    let most = image.means.iter().copied().fold(0., f64::max);
    let range = [least, most].map(|radiance| known(Some(radiance), 4));
    let range = range.join(" to ");
    let image = shrink(image, LARGEST);
    let map = display::errors(&image, false).ok();
    // Say which error is white
    let mut errors = image.errors.iter().flatten();
    let exact = errors.all(|&error| error == 0.);
    let map = map.map(|(map, white)| match exact {
        true => (map, "It is zero in all of them.".to_owned()),
        false => {
            let white = known(Some(white), 6);
            (map, format!("White is {white} or more, or unknown."))
        }
    });
    html! {
        // Show the plot and its legend
        @if let Some(plot) = plot(&report.curve) {
            figure {
                (plot)
                figcaption { "The error against time: estimated (solid), against \
                    the reference if there is one (dashed), against the seconds of all \
                    processors if there are several ranks (dotted), and a slope of \
                    -1/2 through the last point (wide)." }
            }
        }
        figure {
            (picture(&image, "The rendered image"))
            figcaption { "The image, " (size) ", radiance from " (range)
                ". White is the radiance of the sky, 1." }
        }
        @if let Some((map, white)) = map {
            figure {
                (picture(&map, "A map of the standard error"))
                figcaption { "The standard error of each pixel. " (white) }
            }
        }
    }
}

/// The largest width and height of an image on the page, in pixels.
const LARGEST: u32 = 800;

/// An image as a part of the page, with what it shows in words.
fn picture(image: &Image, shows: &str) -> Markup {
    let mut bytes = vec![];
    let written = Format::Png.write(image, &mut bytes);
    written.expect("memory takes all bytes");
    let text = BASE64_STANDARD.encode(bytes);
    let address = format!("data:image/png;base64,{text}");
    // Keep a tall image on the screen
    let ratio = f64::from(image.width) / f64::from(image.height);
    let width = format!("width: min(100%, {:.3}vh)", 70. * ratio);
    html! { img src=(address) alt=(shows) style=(width); }
}

/// A setting as it is typed, with its unit.
fn value_of(name: &str, value: &Value) -> String {
    let unit = match name {
        "fov" => "\u{b0}",
        "time" => " s",
        _ => "",
    };
    match value {
        Value::Null => "none".to_owned(),
        value => printable(&as_typed(value)) + unit,
    }
}

fn points(curve: &[CurvePoint]) -> Markup {
    let compared = |point: &CurvePoint| point.rmse_reference.is_some();
    let compared = curve.iter().any(compared);
    let several = |point: &CurvePoint| point.processor_seconds.is_some();
    let several = curve.iter().any(several);
    html! {
        table {
            tr {
                th { "spp" } th { "seconds" }
                @if several { th { "seconds of processors" } }
                th { "rays" } th { "rmse" }
                @if compared { th { "rmse against reference" } }
                th { "mean radiance" }
            }
            @for point in curve {
                tr {
                    // Show one point
                    td { (point.spp) }
                    td { (known(Some(point.seconds), 3)) }
                    @if several { td { (known(point.processor_seconds, 2)) } }
                    td { (point.rays) }
                    td { (known(point.rmse, 6)) }
                    @if compared { td { (known(point.rmse_reference, 6)) } }
                    td { (with_error(point.mean, point.mean_stderr)) }
                }
            }
        }
    }
}

fn shares(ranks: &[Share]) -> Markup {
    html! {
        table {
            tr {
                th { "rank" } th { "paths" } th { "seconds rendering" }
                th { "waiting" } th { "of processors" }
            }
            @for (rank, share) in ranks.iter().enumerate() {
                tr {
                    td { (rank) }
                    td { (share.paths) }
                    td { (known(Some(share.render_seconds), 3)) }
                    td { (known(Some(share.wait_seconds), 3)) }
                    td { (known(Some(share.processor_seconds), 2)) }
                }
            }
        }
    }
}
