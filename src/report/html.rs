// Tangled from chapters/report.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A page for people: one file that needs nothing else.

use base64::prelude::{BASE64_STANDARD, Engine};
use maud::{DOCTYPE, Markup, PreEscaped, html};
use serde_json::Value;

use super::plot::plot;
use super::result::{Report, as_typed, rounded, with_error};
use crate::compare::display::{Curve, errors, shrink, tonemap};
use crate::image::{Format, Image};
use crate::key::entries;
use crate::render_loop::CurvePoint;

/// The page of a run and its image.
pub fn page(report: &Report, image: &Image) -> String {
    let scene = printable(&report.scene.file);
    let pixels = u64::from(image.width) * u64::from(image.height);
    let mut summary = report.summary(pixels);
    if let [Some(seconds), Some(spp)] = report.slopes() {
        let text = format!(
            "{seconds:.3} against seconds, {spp:.3} against samples, on \
             logarithmic axes; independent samples give -0.5"
        );
        summary.push(("slope", text));
    }
    // List what was set
    let origin = [
        ("command", &report.command),
        ("date", &report.date),
        ("program", &report.program),
        ("processor", &report.processor),
        ("SHA-256", &report.scene.sha256),
    ];
    let origin = origin.map(|(name, text)| (name, text.clone()));
    let settings = entries(&report.settings);
    let settings = settings
        .iter()
        .map(|(name, value)| (&name[..], value_of(name, value)));
    let markup = html! {
        (DOCTYPE)
        html lang="en-GB" {
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
                (table(summary.into_iter().skip(1)))
                (table(origin.into_iter().chain(settings)))
                (points(&report.convergence.curve))
            }
        }
    };
    markup.into_string() + "\n"
}

/// A table of names and texts.
fn table<'a>(rows: impl Iterator<Item = (&'a str, String)>) -> Markup {
    html! {
        table {
            @for (name, text) in rows {
                tr { th { (printable(name)) } td { (printable(&text)) } }
            }
        }
    }
}

/// A text in which characters that no page may contain are replaced.
fn printable(text: &str) -> String {
    let never = |c: char| c.is_control() || "\u{fffe}\u{ffff}".contains(c);
    text.replace(never, "\u{fffd}")
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

fn pictures(report: &Report, image: &Image) -> Markup {
    // Format the size and the range of the image
    let size = format!("{}x{} pixels", image.width, image.height);
    let least = image.means.iter().copied().fold(f64::INFINITY, f64::min);
    let most = image.means.iter().copied().fold(0., f64::max);
    let range = [least, most].map(|radiance| rounded(Some(radiance), 4));
    let range = range.join(" to ");
    let image = shrink(image, LARGEST);
    let white = libm::exp2(-report.page_exposure);
    let shown = tonemap(&image, report.page_exposure, Curve::Clamp);
    let map = errors(&image, false).ok();
    let exact = image.errors.iter().flatten().all(|&error| error == 0.);
    html! {
        @if let Some(plot) = plot(&report.convergence.curve) {
            figure {
                (plot)
                figcaption { "The error against time: estimated (solid), \
                    against the reference if there is one (dashed), and a \
                    slope of -1/2 through the last point (wide)." }
            }
        }
        figure {
            (picture(&shown, "The rendered image"))
            figcaption { "The image, " (size) ", radiance from " (range)
                ". White is " (rounded(Some(white), 3)) "; the sky has 1." }
        }
        @if let Some((map, white)) = map {
            figure {
                (picture(&map, "A map of the standard error"))
                figcaption { "The standard error of each pixel. "
                    @if exact { "It is zero in all of them." }
                    @else { "White is " (rounded(Some(white), 6))
                        " or more, or unknown." }
                }
            }
        }
    }
}

/// The largest width and height of an image on the page, in pixels.
const LARGEST: u32 = 800;

/// An image as a part of the page, with a description of it in words.
fn picture(image: &Image, shows: &str) -> Markup {
    let mut bytes = vec![];
    let written = Format::Png.write(image, &mut bytes);
    written.expect("memory takes all bytes");
    let text = BASE64_STANDARD.encode(bytes);
    let address = format!("data:image/png;base64,{text}");
    let ratio = f64::from(image.width) / f64::from(image.height);
    let width = format!("width: min(100%, {:.3}vh)", 70. * ratio);
    html! { img src=(address) alt=(shows) style=(width); }
}

/// A setting as it is typed, with its unit.
fn value_of(name: &str, value: &Value) -> String {
    match (name, value) {
        (_, Value::Null) => "none".to_owned(),
        ("fov", value) => as_typed(value) + "\u{b0}",
        ("time", value) => as_typed(value) + " s",
        (_, value) => as_typed(value),
    }
}

fn points(curve: &[CurvePoint]) -> Markup {
    let compared = curve.iter().any(|point| point.rmse_reference.is_some());
    html! {
        table {
            tr {
                th { "spp" } th { "seconds" } th { "rays" } th { "rmse" }
                @if compared { th { "rmse against reference" } }
                th { "mean radiance" }
            }
            @for point in curve {
                tr {
                    td { (point.spp) }
                    td { (rounded(Some(point.seconds), 3)) }
                    td { (point.rays) }
                    td { (rounded(point.rmse, 6)) }
                    @if compared { td { (rounded(point.rmse_reference, 6)) } }
                    td { (with_error(point.mean, point.mean_stderr)) }
                }
            }
        }
    }
}
