// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Logarithmic axes: where a value lies, and which values are named.

use super::words::power;

/// A logarithmic axis, by the decimal logarithms of its ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    low: f64,
    high: f64,
}

impl Axis {
    // Cover all values with an axis
    /// An axis of at least a decade for positive values, if there are any.
    pub fn around(values: impl Iterator<Item = f64>) -> Option<Self> {
        // Find the smallest and the largest value
        let ends = values.fold(None, |ends, x| match ends {
            None => Some((x, x)),
            Some((low, high)) => Some((x.min(low), x.max(high))),
        });
        let (low, high) = ends?;
        let (low, high) = (libm::log10(low), libm::log10(high));
        let span = high - low;
        let margin = f64::max((1. - span) / 2., 0.) + 0.05 * span.max(1.);
        Some(Self { low: low - margin, high: high + margin })
    }

    // Find the place of a value
    /// Where a positive value lies: 0 at the low end, 1 at the high end.
    pub fn place(&self, value: f64) -> f64 {
        (libm::log10(value) - self.low) / (self.high - self.low)
    }

    /// The value at a place, the inverse of [`place`](Self::place).
    pub fn value(&self, place: f64) -> f64 {
        libm::exp10(self.low + place * (self.high - self.low))
    }

    // Choose the labels of an axis
    /// Lines and labels.
    pub fn ruler(&self) -> Ruler {
        // Decide how dense labels may be
        let span = self.high - self.low;
        let exponents = self.low.floor() as i32..=self.high.floor() as i32;
        let stride = (span / 8.).ceil() as i32;
        let plain = self.low > -3.3 && self.high < 4.;
        let (mut lines, mut ticks) = (vec![], vec![]);
        for exponent in exponents {
            for digit in 1..10 {
                // Pass over what the axis does not contain
                let value =
                    f64::from(digit) * libm::exp10(f64::from(exponent));
                let place = self.place(value);
                if !(0. ..=1.).contains(&place) {
                    continue;
                }
                // Label the multiple or draw a line
                let named = match digit {
                    1 => exponent.rem_euclid(stride) == 0,
                    2 | 5 => span <= 2.,
                    _ => false,
                };
                if named {
                    ticks.push((place, label(digit, exponent, plain)));
                } else if digit == 1 || span <= 6. {
                    lines.push(place);
                }
            }
        }
        Ruler { lines, ticks }
    }
}

/// What is written along an axis, at places from 0 to 1.
pub struct Ruler {
    /// Places of thin lines.
    pub lines: Vec<f64>,
    /// Places of thick lines, and what is written there.
    pub ticks: Vec<(f64, String)>,
}

// Write the number of a label
fn label(digit: u32, exponent: i32, plain: bool) -> String {
    let places = exponent.unsigned_abs() as usize;
    match (plain, digit) {
        (true, _) if exponent < 0 => format!("0.{digit:0>places$}"),
        (true, _) => format!("{digit}{:0<places$}", ""),
        (false, 1) => power(exponent),
        (false, _) => format!("{digit}\u{b7}{}", power(exponent)),
    }
}
