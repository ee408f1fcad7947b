// Tangled from chapters/report.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The drawing of error against time. Lengths are those of the drawing;
//! y points down.

use maud::{Markup, html};

use super::result::drawable;
use crate::render_loop::CurvePoint;

/// A logarithmic axis, by the exponents of its ends and its length.
struct Axis(f64, f64, f64);

impl Axis {
    /// The axis that covers positive values by whole decades.
    fn over(values: impl Iterator<Item = f64> + Clone, size: f64) -> Self {
        let logs = values.map(libm::log10);
        let low = logs.clone().fold(f64::INFINITY, f64::min).floor();
        let high = logs.fold(f64::NEG_INFINITY, f64::max).ceil();
        Self(low, high.max(low + 1.), size)
    }

    /// How far from the beginning of the axis a value lies.
    fn place(&self, x: f64) -> f64 {
        let Self(low, high, length) = self;
        let place = (libm::log10(x) - low) / (high - low) * length;
        (place * 10.).round() / 10.
    }

    /// The powers of ten on the axis, by their exponents and places.
    fn decades(&self) -> impl Iterator<Item = (i32, f64)> {
        let exponents = self.0 as i32..=self.1 as i32;
        exponents.map(|n| (n, self.place(libm::exp10(n.into()))))
    }
}

const WIDTH: f64 = 400.;
const HEIGHT: f64 = 260.;

/// The estimated error against time with a guide of slope -1/2, and the
/// true error if it is known; none if there is no point to draw.
pub fn plot(curve: &[CurvePoint]) -> Option<Markup> {
    let points = |error: fn(&CurvePoint) -> Option<f64>| {
        let point = |p: &CurvePoint| Some((p.seconds, error(p)?));
        let points = curve.iter().filter_map(point);
        Vec::from_iter(points.filter(|p| drawable(p.0) && drawable(p.1)))
    };
    let estimated = points(|point| point.rmse);
    let truth = points(|point| point.rmse_reference);
    let last = *estimated.last().or(truth.last())?;
    let drawn = estimated.iter().chain(&truth);
    let x = Axis::over(drawn.clone().map(|p| p.0), WIDTH);
    let y = Axis::over(drawn.map(|p| p.1), HEIGHT);
    // Turn points into the ends of lines
    let place = |&(t, e): &(f64, f64)| (x.place(t), HEIGHT - y.place(e));
    let line = |points: &[(f64, f64)]| {
        let ends = points.iter().map(place);
        let ends = ends.map(|(x, y)| format!("{x:.1},{y:.1}"));
        ends.collect::<Vec<_>>().join(" ")
    };
    let guide = [x.0, x.1].map(|exponent| {
        let time = libm::exp10(exponent);
        (time, last.1 * (last.0 / time).sqrt())
    });
    Some(html! {
        svg viewBox="-70 -10 490 310" role="img" fill="none"
            aria-label="Error against time" stroke="currentColor" {
            rect width=(WIDTH) height=(HEIGHT) {}
            @for (n, x) in x.decades() {
                line x1=(x) x2=(x) y2=(HEIGHT) stroke-opacity="0.3" {}
                (label(x, HEIGHT + 18., "middle", n))
            }
            @for (n, y) in y.decades().map(|(n, y)| (n, HEIGHT - y)) {
                line y1=(y) y2=(y) x2=(WIDTH) stroke-opacity="0.3" {}
                (label(-6., y + 5., "end", n))
            }
            g fill="currentColor" stroke="none" text-anchor="middle"
                font-size="13" {
                text x=(WIDTH / 2.) y=(HEIGHT + 36.) { "rendering time / s" }
                text x=(-HEIGHT / 2.) y="-44" transform="rotate(-90)" {
                    "rmse / radiance of the sky"
                }
            }
            svg width=(WIDTH) height=(HEIGHT) {
                polyline points=(line(&guide)) stroke-width="4"
                    stroke-opacity="0.3" {}
                polyline points=(line(&truth)) stroke-width="1.5"
                    stroke-dasharray="6 4" {}
                polyline points=(line(&estimated)) stroke-width="1.5" {}
                @for (x, y) in estimated.iter().map(place) {
                    circle cx=(x) cy=(y) r="3" fill="currentColor" {}
                }
            }
        }
    })
}

/// A power of ten, written at a place.
fn label(x: f64, y: f64, anchor: &str, exponent: i32) -> Markup {
    html! {
        text x=(x) y=(y) text-anchor=(anchor) fill="currentColor"
            stroke="none" font-size="13" {
            "10" tspan dy="-5" font-size="10" { (exponent) }
        }
    }
}
