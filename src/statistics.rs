// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The mean of many weights, and its error.

/// Count, mean and squared deviations of the weights so far (Welford
/// 1962).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Accumulator {
    count: u64,
    mean: f64,
    /// The sum of squared deviations from the mean.
    deviations: f64,
}

impl Accumulator {
    // Take one more weight into account
    /// Takes one more weight into account.
    #[inline]
    pub fn add(&mut self, weight: f64) {
        self.count += 1;
        let deviation = weight - self.mean;
        self.mean += deviation / self.count as f64;
        self.deviations += deviation * (weight - self.mean);
    }

    // Report the mean and its error
    /// The number of weights.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The mean of the weights; 0 if there are none.
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// The unbiased estimate of the variance of one weight; infinite when
    /// fewer than two weights leave it unknown.
    pub fn variance(&self) -> f64 {
        match self.count {
            0 | 1 => f64::INFINITY,
            n => self.deviations / (n - 1) as f64,
        }
    }

    /// The standard error of the mean.
    pub fn standard_error(&self) -> f64 {
        (self.variance() / self.count.max(1) as f64).sqrt()
    }
}
