// Tangled from chapters/numerics.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Floating-point operations that are exact, or the same everywhere.
//!
//! ```
//! use litpt::numerics::{difference_of_products, exponent};
//!
//! assert_eq!(exponent(10.), 3);
//! let (a, b) = (1. + f64::EPSILON, 1. - f64::EPSILON);
//! assert_eq!(a * b - 1., 0.);
//! assert!(difference_of_products(a, b, 1., 1.) < 0.);
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::f64::consts::FRAC_PI_2;

use glam::DVec3;

/// The exponent `e` of `x`, with 2^e <= |x| < 2^(e+1); -1075 for zero.
pub fn exponent(x: f64) -> i32 {
    let digits = x.to_bits() & ((1 << 52) - 1);
    match (x.to_bits() >> 52) & 0x7ff {
        0 => -1011 - digits.leading_zeros() as i32,
        biased => biased as i32 - 1023,
    }
}

/// The number 2^`e`, with `e` clamped to the normal range [-1022, 1023].
pub const fn power_of_two(e: i32) -> f64 {
    // A number has its exponent, plus 1023, in the bits after the sign.
    let least = if e > -1022 { e } else { -1022 };
    let e = if least < 1023 { least } else { 1023 };
    f64::from_bits(((e + 1023) as u64) << 52)
}

/// `v` times 2^`e`, exactly unless the result leaves the normal range.
#[inline]
pub fn shift(v: DVec3, e: i32) -> DVec3 {
    let first = e.clamp(-1022, 1023);
    v * power_of_two(first) * power_of_two(e - first)
}

/// `v`, scaled so that its largest component is in [1, 2); exactly, except
/// for components that are 2^1022 times smaller.
pub fn normalise(v: DVec3) -> DVec3 {
    shift(v, -exponent(v.abs().max_element()))
}

/// The extreme corners of the box of points.
pub fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points.fold(none, |(low, high), p| (low.min(p), high.max(p)))
}

/// `a * b - c * d` to 1.5 units in the last place (Jeannerod, Louvet
/// and Muller 2013, theorem 5.1, after Kahan).
#[inline(always)]
pub fn difference_of_products(a: f64, b: f64, c: f64, d: f64) -> f64 {
    let cd = c * d;
    a.mul_add(b, -cd) + (-c).mul_add(d, cd)
}

/// The cross product of `u` and `v`; zero only if they are parallel.
#[inline(always)]
pub fn cross(u: DVec3, v: DVec3) -> DVec3 {
    DVec3::new(
        difference_of_products(u.y, v.z, u.z, v.y),
        difference_of_products(u.z, v.x, u.x, v.z),
        difference_of_products(u.x, v.y, u.y, v.x),
    )
}

/// The point (cos 2πu, sin 2πu), for `u` in [0, 1], with an absolute
/// error below 4e-16.
#[inline(always)]
pub fn sincos_turns(u: f64) -> (f64, f64) {
    let quarters = (4. * u + 0.5) as i32;
    let angle = (4. * u - f64::from(quarters)) * FRAC_PI_2;
    let square = angle * angle;
    let sine = angle * polynomial(&SINE, square);
    let cosine = polynomial(&COSINE, square);
    // Turn the point by whole quarters
    let (x, y) =
        if quarters & 1 == 0 { (cosine, sine) } else { (sine, cosine) };
    let x = if (quarters + 1) & 2 == 0 { x } else { -x };
    let y = if quarters & 2 == 0 { y } else { -y };
    (x, y)
}

const SINE: [f64; 8] = reciprocal_factorials(1);
const COSINE: [f64; 9] = reciprocal_factorials(0);

/// The numbers (-1)^k / (2k + `offset`)!, for k from 0.
const fn reciprocal_factorials<const N: usize>(offset: u64) -> [f64; N] {
    let mut coefficients = [1.; N];
    let mut k = 1;
    while k < N {
        let n = 2 * k as u64 + offset;
        coefficients[k] = -coefficients[k - 1] / (n * (n - 1)) as f64;
        k += 1;
    }
    coefficients
}

#[inline(always)]
fn polynomial<const N: usize>(coefficients: &[f64; N], x: f64) -> f64 {
    coefficients.iter().rev().fold(0., |sum, c| sum * x + c)
}
