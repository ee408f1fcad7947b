// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! How many pixels have a standard error of which size.

use maud::{Markup, html};

use super::axis::{Axis, Ruler};
use super::plot::{self, Frame};
use super::words::{count, figures};

/// The number of bins.
const BINS: usize = 40;

// Hold the errors in bins
/// The standard errors of pixels, in bins of equal logarithmic width.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// The range of the bins; none if no error is known and positive.
    axis: Option<Axis>,
    /// The number of pixels in each bin, from the smallest errors up.
    pub counts: Vec<u64>,
    /// Pixels whose error is 0.
    pub zero: u64,
    /// Pixels whose error is not known.
    pub unknown: u64,
}

impl Histogram {
    // Sort the errors into bins
    /// Sorts the standard errors of pixels into bins.
    pub fn of(errors: &[f64]) -> Self {
        let known = |e: &f64| *e > 0. && e.is_finite();
        let axis = Axis::around(errors.iter().copied().filter(known));
        let mut counts = vec![0; BINS];
        let (mut zero, mut unknown) = (0, 0);
        for error in errors {
            // Count one error where it belongs
            match axis {
                _ if *error == 0. => zero += 1,
                Some(axis) if known(error) => {
                    let bin = (axis.place(*error) * BINS as f64) as usize;
                    counts[bin.min(BINS - 1)] += 1;
                }
                _ => unknown += 1,
            }
        }
        Self { axis, counts, zero, unknown }
    }

    // Draw the bins as bars
    /// The drawing for a page, if there is anything to draw.
    pub fn draw(&self) -> Option<Markup> {
        let axis = self.axis?;
        let frame = Frame { top: 30. };
        // Measure the bars and both axes
        let most = self.counts.iter().copied().max().unwrap_or(0).max(1);
        let height = |n: u64| n as f64 / (1.05 * most as f64);
        let place = |bin: usize| bin as f64 / BINS as f64;
        let (sizes, numbers) = (axis.ruler(), round(most, height));
        let errors = "standard error / radiance of the sky";
        let content = html! {
            text x="240" y="20" text-anchor="middle" font-weight="bold" {
                "Standard errors of the pixels"
            }
            (frame.draw((&sizes, errors), (&numbers, "pixels")))
            // Draw one bar for each bin
            @for (bin, n) in self.counts.iter().enumerate().filter(|b| *b.1 > 0) {
                @let (from, to) = (place(bin), place(bin + 1));
                @let (x, y) = (frame.x(from), frame.y(height(*n)));
                rect x=(x) y=(y) width=(frame.x(to) - x)
                    height=(frame.bottom() - y) fill-opacity="0.6"
                    stroke="currentColor" stroke-width="0.5"
                {
                    title {
                        (figures(axis.value(from))) " to "
                        (figures(axis.value(to))) ": " (count(*n)) " pixels"
                    }
                }
            }
        };
        let size = frame.bottom() + 46.;
        let name = "Histogram of the standard errors of the pixels";
        Some(plot::drawing((size, name), false, &content))
    }
}

// Choose round numbers of pixels
/// Labels of an axis of counts up to `most`, placed by `place`.
fn round(most: u64, place: impl Fn(u64) -> f64) -> Ruler {
    let steps = (0..19).flat_map(|e| [1, 2, 5].map(|d| d * 10u64.pow(e)));
    let step = steps.into_iter().find(|s| most / s < 5).unwrap_or(most);
    let values = (0..=most / step).map(|i| i * step);
    let ticks = values.map(|n| (place(n), count(n))).collect();
    Ruler { lines: vec![], ticks }
}
