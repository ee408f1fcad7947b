// Tangled from chapters/scene.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The places of the file's points and rays among the triangles.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::{BVec3, DVec3};

use crate::numerics::{exponent, power_of_two, shift};

/// The map from the coordinates of the file to those of the scene.
#[derive(Clone)]
pub struct Frame {
    /// The least corner of the scene's box, times `part`; zero along an
    /// axis that is only scaled.
    low: DVec3,
    /// One half, or one.
    part: f64,
    /// The scale is 2^`exponent` times `part`.
    exponent: i32,
    /// Half of the scene's box, in the scene; zero along an axis
    /// that is only scaled.
    half: DVec3,
    /// Opposite corners of a box, slightly larger than the scene.
    bounds: [DVec3; 2],
}

/// Binary exponent of the largest coordinate of a scene.
pub const EXTENT: i32 = 12;

impl Frame {
    /// The frame of a box given by two opposite corners, which may be moved
    /// along the axes `moved`.
    pub fn new([low, high]: [DVec3; 2], moved: BVec3) -> Self {
        let longest = (0.5 * high - 0.5 * low).max_element();
        let reach = low.abs().max(high.abs());
        let is_small = longest < power_of_two(-900)
            && reach.max_element() < power_of_two(-800);
        let part = if is_small { 1. } else { 0.5 };
        let extent = high * part - low * part;
        let size = DVec3::select(moved, extent, 2. * (reach * part));
        let exponent = match size.max_element() {
            0. => 0,
            longest => EXTENT + 1 - exponent(longest),
        };
        let only = |v: DVec3| DVec3::select(moved, v, DVec3::ZERO);
        let half = only(0.5 * shift(size, exponent));
        let (corners, bounds) = ([low, high], [DVec3::ZERO; 2]);
        let low = only(low * part);
        let frame = Self { low, part, exponent, half, bounds };
        let [low, high] = corners.map(|corner| frame.apply(corner, 0));
        Self { bounds: [low - DVec3::ONE, high + DVec3::ONE], ..frame }
    }

    /// Where the point `p` of the file lies in the scene, in units of 2^`k`.
    pub fn apply(&self, p: DVec3, k: i32) -> DVec3 {
        let p = p * self.part;
        let offset = p - self.low;
        let lost = lost(p, self.low, offset);
        let whole = shift(offset, self.exponent - k) - shift(self.half, -k);
        whole + shift(lost, self.exponent - k)
    }

    /// About where the point `q` of the scene lies in the file.
    pub fn back(&self, q: DVec3) -> DVec3 {
        (shift(q + self.half, -self.exponent) + self.low) / self.part
    }

    /// Whether the point `q` of the scene is outside of its box by more than ten
    /// times the box's longest side.
    pub fn is_far(&self, q: DVec3) -> bool {
        let [low, high] = self.bounds;
        let beyond = (low - q).max(q - high).max_element();
        beyond > 10. * (high - low).max_element()
    }

    /// Along which axes the map rounds the place of `p`.
    pub fn rounds(&self, p: DVec3) -> BVec3 {
        let p = p * self.part;
        let offset = p - self.low;
        let scaled = shift(offset, self.exponent);
        let place = scaled - self.half;
        lost(p, self.low, offset).cmpne(DVec3::ZERO)
            | lost(scaled, self.half, place).cmpne(DVec3::ZERO)
    }

    /// Where rays that start at a point of the file enter the scene.
    pub fn entrance(&self, position: DVec3) -> Entrance {
        let offset = position * self.part - self.low;
        let distance = exponent(offset.abs().max_element()) + self.exponent;
        let k = (distance - FAR).max(0);
        let origin = self.apply(position, k);
        let afar = self.bounds.map(|corner| shift(corner, -k));
        let [low, high] = afar;
        let is_inside = (origin.cmpge(low) & origin.cmple(high)).all();
        Entrance { origin, k, afar, bounds: self.bounds, is_inside }
    }
}

/// The error of the rounded difference of `a` and `b`.
fn lost(a: DVec3, b: DVec3, difference: DVec3) -> DVec3 {
    let back = difference - a;
    (a - (difference - back)) - (b + back)
}

/// A half line, in the coordinates of the scene.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes; of length one.
    pub direction: DVec3,
}

/// The common part of all rays that start at one point of the file.
#[derive(Clone, Copy, Debug)]
pub struct Entrance {
    /// The point, in units of 2^`k`.
    origin: DVec3,
    k: i32,
    /// The box around the scene in these units, and in those of the scene.
    afar: [DVec3; 2],
    bounds: [DVec3; 2],
    /// Whether the point lies in the box.
    pub is_inside: bool,
}

/// Binary exponent of the distance at which units become larger.
const FAR: i32 = 1000;

/// A point farther away has no place among the triangles: 2^32 units.
const NEARBY: f64 = (1u64 << 32) as f64;

impl Entrance {
    /// The ray in this direction, from where it enters the scene; none if
    /// it passes the scene by.
    pub fn enter(&self, direction: DVec3) -> Option<Ray> {
        let &Entrance { origin, afar: [low, high], .. } = self;
        if self.is_inside {
            return Some(Ray { origin, direction });
        }
        let up = direction.signum().cmpgt(DVec3::ZERO);
        let near = DVec3::select(up, low, high);
        let far = DVec3::select(up, high, low);
        let enters = ((near - origin) / direction).to_array();
        let leaves = ((far - origin) / direction).to_array();
        let start = enters.into_iter().fold(0., f64::max);
        let end = leaves.into_iter().fold(f64::INFINITY, f64::min);
        if start > end * (1. + f64::EPSILON * 8.) {
            return None;
        }
        let point = shift(origin + direction * start, self.k);
        let [low, high] = self.bounds;
        Some(Ray { origin: point.clamp(low, high), direction })
    }

    /// The point of the scene's box that is nearest to it.
    pub fn nearest(&self) -> DVec3 {
        let [low, high] = self.bounds;
        shift(self.origin, self.k).clamp(low, high)
    }

    /// Where the point lies among the triangles; none if it is more than
    /// 2^32 units away.
    pub fn place(&self) -> Option<DVec3> {
        let is_near = self.origin.abs().max_element() <= NEARBY;
        (self.k == 0 && is_near).then_some(self.origin)
    }
}
