// Tangled from chapters/guiding.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Directions drawn where light was seen before: path guiding with a
//! histogram over the square of cosine sampling.
//!
//! Its bits belong to `GATHER_VERSION`.

use std::array;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::numerics::sincos_turns;

/// The direction around the unit vector `normal` that belongs to a point
/// of [0, 1)^2: uniform points give the density cos/π (Shirley and Chiu
/// 1997).
#[inline]
pub fn direction(normal: DVec3, [u, v]: [f64; 2]) -> DVec3 {
    let (a, b) = (2. * u - 1., 2. * v - 1.);
    let (radius, turn) = match a.abs() > b.abs() {
        true => (a, 0.125 * b / a),
        false if b != 0. => (b, 0.25 - 0.125 * a / b),
        false => (0., 0.),
    };
    let (cosine, sine) = sincos_turns(turn.abs());
    let sine = sine.copysign(turn) * radius;
    let (tangent, bitangent) = frame(normal);
    let height = (1. - radius * radius).max(0.).sqrt();
    tangent * (radius * cosine) + bitangent * sine + normal * height
}

/// The axis along which the unit vector `n` is longest.
#[inline]
pub fn main_axis(n: DVec3) -> usize {
    let a = n.abs();
    match a.x > a.y {
        true if a.x > a.z => 0,
        false if a.y > a.z => 1,
        _ => 2,
    }
}

/// Tangent and bitangent of the unit vector `n`, which turn smoothly with
/// it as long as its main axis remains the same.
#[inline]
fn frame(n: DVec3) -> (DVec3, DVec3) {
    let next = (main_axis(n) + 1) % 3;
    let mut tangent = n * -n[next];
    tangent[next] += 1.;
    let tangent = tangent.normalize();
    (tangent, n.cross(tangent))
}

/// The bin of a point of the square.
#[inline]
pub fn bin([u, v]: [f64; 2]) -> usize {
    let side = |u: f64| ((u * SIDE as f64) as usize).min(SIDE - 1);
    side(u) * SIDE + side(v)
}

/// Bins along one side of the square.
pub const SIDE: usize = 16;
/// All bins of the square.
pub const BINS: usize = SIDE * SIDE;

/// A density over the square, constant in each bin: where the rows begin,
/// and the columns of each row, in units of 2^-16.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Guide {
    rows: [u16; SIDE],
    columns: [[u16; SIDE]; SIDE],
}

/// The probability that is spread over all bins alike.
const DEFENCE: f32 = 0.12;

/// Where intervals with lengths proportional to these positive numbers
/// begin, in units of 2^-16.
fn starts(parts: [f32; SIDE]) -> [u16; SIDE] {
    let sum: f32 = parts.iter().sum();
    let mut before = 0.;
    parts.map(|part| {
        let start = before / sum * 65536.;
        before += part;
        start as u16
    })
}

/// The length of interval `i`, in units of 2^-16.
#[inline]
fn length(starts: &[u16; SIDE], i: usize) -> u32 {
    let end = starts.get(i + 1).map_or(65536, |&end| u32::from(end));
    end - u32::from(starts[i])
}

/// The interval in which `u` lies, and where in it: in (0, 1).
#[inline]
fn invert(starts: &[u16; SIDE], u: u32) -> (usize, f64) {
    let high = (u >> 16) as u16;
    let begun = starts[1..].iter().map(|&start| u16::from(start <= high));
    let i = usize::from(begun.sum::<u16>());
    let offset = u - (u32::from(starts[i]) << 16);
    let unit = 1. / (u64::from(length(starts, i)) << 16) as f64;
    (i, (f64::from(offset) + 0.5) * unit)
}

impl Guide {
    /// The density that is proportional to `bins`, none of them negative,
    /// except for a part `DEFENCE` that is uniform; none if all are zero.
    pub fn new(bins: &[f32; BINS]) -> Option<Self> {
        let sum: f32 = bins.iter().sum();
        if !(sum > 0. && sum.is_finite()) {
            return None;
        }
        let uniform = DEFENCE / BINS as f32;
        let part = |b: f32| uniform + (1. - DEFENCE) * (b / sum);
        let row = |i| array::from_fn(|j| part(bins[i * SIDE + j]));
        let columns = array::from_fn(|i| starts(row(i)));
        let rows = starts(array::from_fn(|i| row(i).iter().sum()));
        Some(Self { rows, columns })
    }

    /// The density in a bin: positive, with mean 1 over the square.
    #[inline]
    pub fn density(&self, bin: usize) -> f64 {
        let (i, j) = (bin / SIDE, bin % SIDE);
        let row = f64::from(length(&self.rows, i));
        let column = f64::from(length(&self.columns[i], j));
        row * column * (BINS as f64 / 65536. / 65536.)
    }

    /// Whether all bins have a positive density, as in a new guide.
    pub fn is_sound(&self) -> bool {
        let intervals = self.columns.iter().chain([&self.rows]);
        let rises =
            |starts: &[u16; SIDE]| starts.is_sorted_by(|a, b| a < b);
        intervals.into_iter().all(|starts| starts[0] == 0 && rises(starts))
    }

    /// The point of the square that belongs to a uniform one, whose
    /// coordinates are multiples of 2^-32; and its bin.
    #[inline]
    pub fn warp(&self, [u, v]: [u32; 2]) -> ([f64; 2], usize) {
        let (i, u) = invert(&self.rows, u);
        let (j, v) = invert(&self.columns[i], v);
        let point = [i as f64 + u, j as f64 + v].map(|x| x / SIDE as f64);
        (point, i * SIDE + j)
    }
}
