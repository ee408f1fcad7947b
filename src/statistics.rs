// Tangled from chapters/exact_sums.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The mean of many values, and its error.
//!
//! ```
//! use litpt::statistics::Accumulator;
//!
//! let mut sum = Accumulator::default();
//! [1., 2., 3.].map(|value| sum.add(value));
//! assert_eq!((sum.count(), sum.mean()), (3, 2.));
//! assert!((sum.standard_error() - (1. / 3f64).sqrt()).abs() < 1e-12);
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

use bytemuck::{Pod, Zeroable, cast};

/// Count, sum and sum of squares of the values so far. A value is cut
/// to a multiple of 2^-88 and nothing else is rounded: the same values in
/// any order, and divided in any manner among accumulators that are
/// merged, give the same bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Accumulator {
    count: u64,
    /// The sum of the values in units of 2^-88, lowest digit first, as
    /// two's complement.
    sum: [u64; 3],
    /// The sum of their squares in units of 2^-176, likewise.
    squares: [u64; 4],
}

impl Accumulator {
    /// Adds one more value, which lies in (-2^39, 2^39). A value outside, or
    /// NaN, makes the error infinite.
    #[inline]
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        if !(-LARGE < value && value < LARGE) {
            self.squares = [u64::MAX; 4];
            return;
        }
        let units = (value * UNITS) as i128;
        let digits = [units, units >> 64, units >> 127].map(|n| n as u64);
        accumulate(&mut self.sum, 1, &digits);
        // Add the square of a number of two digits
        let n = units.unsigned_abs();
        let [low, high] = [n, n >> 64].map(|n| n as u64);
        if accumulate(&mut self.squares, low, &[low, high, 0, 0])
            | accumulate(&mut self.squares, high, &[0, low, high, 0])
        {
            self.squares = [u64::MAX; 4];
        }
    }

    /// Adds the same value `count` times.
    pub fn add_times(&mut self, value: f64, count: u64) {
        let mut one = Self::default();
        one.add(value);
        self.merge_times(&one, count);
    }

    /// Adds all the values of another accumulator.
    pub fn merge(&mut self, other: &Self) {
        self.merge_times(other, 1);
    }

    fn merge_times(&mut self, other: &Self, times: u64) {
        self.count += times * other.count;
        accumulate(&mut self.sum, times, &other.sum);
        if accumulate(&mut self.squares, times, &other.squares) {
            self.squares = [u64::MAX; 4];
        }
    }

    /// The number of values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The magnitude of the sum, and whether it is negative.
    fn magnitude(&self) -> ([u64; 3], bool) {
        let is_negative = self.sum[2] >> 63 == 1;
        let mut magnitude = [0; 3];
        match is_negative {
            false => magnitude = self.sum,
            true => subtract(&mut magnitude, 1, &self.sum),
        }
        (magnitude, is_negative)
    }

    /// The mean of the values; 0 if there are none.
    pub fn mean(&self) -> f64 {
        let divisor = u128::from(self.count.max(1));
        let (sum, is_negative) = self.magnitude();
        let (mut quotient, mut rest) = (0, 0);
        for digit in sum.into_iter().rev() {
            let dividend = (rest << 64) | u128::from(digit);
            quotient = (quotient << 64) | (dividend / divisor);
            rest = dividend % divisor;
        }
        let mean = quotient as f64 / UNITS;
        if is_negative { -mean } else { mean }
    }

    /// The unbiased estimate of the variance of one value; infinite when
    /// fewer than two values leave it unknown.
    pub fn variance(&self) -> f64 {
        if self.count < 2 || self.squares == [u64::MAX; 4] {
            return f64::INFINITY;
        }
        // The square of the sum is subtracted digit by digit.
        let mut difference = [0; 5];
        let [a, b, c, d] = self.squares;
        accumulate(&mut difference, self.count, &[a, b, c, d, 0]);
        let (sum, _) = self.magnitude();
        for (i, digit) in sum.into_iter().enumerate() {
            let mut shifted = [0; 5];
            shifted[i..i + 3].copy_from_slice(&sum);
            subtract(&mut difference, digit, &shifted);
        }
        let n = self.count as f64;
        to_f64(&difference) / UNITS / UNITS / (n * (n - 1.))
    }

    /// The standard error of the mean; infinite where the variance is.
    pub fn standard_error(&self) -> f64 {
        (self.variance() / self.count.max(1) as f64).sqrt()
    }

    /// The state as 64 bytes: count, sum and squares, in little endian.
    pub fn to_bytes(&self) -> [u8; 64] {
        cast(cast::<_, [u64; 8]>(*self).map(u64::to_le))
    }

    /// The accumulator that [`to_bytes`](Self::to_bytes) stored.
    pub fn from_bytes(bytes: &[u8; 64]) -> Self {
        cast(cast::<_, [u64; 8]>(*bytes).map(u64::from_le))
    }
}

/// The number of units in 1, 2^88, and the bound of values, 2^39.
const UNITS: f64 = (1u128 << 88) as f64;
const LARGE: f64 = (1u64 << 39) as f64;

/// Adds a number, times a factor, to a sum. Returns whether it overflows.
#[inline]
fn accumulate<const N: usize>(
    sum: &mut [u64; N],
    factor: u64,
    number: &[u64; N],
) -> bool {
    let mut carry = 0;
    for (digit, number) in sum.iter_mut().zip(number) {
        let product = u128::from(factor) * u128::from(*number);
        let total = product + u128::from(*digit) + carry;
        (*digit, carry) = (total as u64, total >> 64);
    }
    carry > 0
}

/// Subtracts a number, times a factor, from a sum.
fn subtract<const N: usize>(
    sum: &mut [u64; N],
    factor: u64,
    number: &[u64; N],
) {
    *sum = sum.map(|digit| !digit);
    accumulate(sum, factor, number);
    *sum = sum.map(|digit| !digit);
}

/// The nearest double, or a neighbour of it.
fn to_f64(number: &[u64]) -> f64 {
    let top = number.iter().rposition(|&digit| digit > 0);
    let top = top.unwrap_or(0).max(1);
    let [high, low] = [number[top], number[top - 1]].map(u128::from);
    let pair = (high << 64 | low) as f64;
    (1..top).fold(pair, |x, _| x * (2. * (1u64 << 63) as f64))
}
