// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! From which directions nothing can be seen but the sky or the void.
//!
//! The view from a side of a triangle is free within a cone around its
//! normal, which is given by the cosine of its opening.

// Name what the outlook imports
use std::array;

use glam::DVec3;
use rand::RngExt;
use rayon::prelude::*;
use robust::{Coord3D, orient3d};

use super::boxes::{Bounds, Boxes, Search};
use crate::bvh::{Hit, Intersector};
use crate::camera::Camera;
use crate::integrator::Foresight;
use crate::numerics::cross;
use crate::sampler::{cosine_direction, generator};
use crate::scene::{Ray, Scene, Triangle};

// Hold the free cone of a side
/// The opening of a cone around the normal of a side within which no ray
/// meets anything, by its cosine in parts of `PARTS`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Cone(u8);

const PARTS: f64 = 250.;

impl Cone {
    /// The whole hemisphere.
    const OPEN: Self = Self(0);
    /// The same, but the side does not count as open.
    const ALL: Self = Self(1);
    /// Nothing.
    const NONE: Self = Self(255);

    // Round a cosine up to a byte
    /// The cone of a cosine; of none, if nothing is in front.
    fn new(cosine: Option<f64>) -> Self {
        let parts = cosine.map(|c| (c * PARTS).ceil() + 3.);
        parts.map_or(Self::OPEN, |parts| Self(parts as u8))
    }

    /// Whether a ray of this cosine is within.
    fn holds(self, cosine: f64) -> bool {
        cosine * PARTS + 2. > f64::from(self.0)
    }
}

// Hold the cones of a whole scene
/// The free cones of all triangles of a scene, two for each.
pub struct Outlook {
    cones: Vec<[Cone; 2]>,
}

impl Outlook {
    /// The outlook of triangles with `boxes` around them, in the order of
    /// the intersector, which is that of the `numbers`. Of cones whose cosine
    /// is not less than `narrow`, none is kept; with 0 only open sides.
    pub fn new(
        boxes: &Boxes,
        triangles: &[Triangle],
        numbers: &[u32],
        narrow: f64,
    ) -> Self {
        let both = |&number| cones(boxes, triangles, narrow, number);
        Self { cones: numbers.par_iter().map(both).collect() }
    }

    // Forget a part of what was found
    /// Lets no side be open; rays from there are still free.
    pub fn keep_open(&mut self) {
        let sides = self.cones.iter_mut().flatten();
        sides.filter(|side| **side == Cone::OPEN).for_each(|side| {
            *side = Cone::ALL;
        });
    }
}

/// A side of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    /// That of the cross product of its edges.
    Front,
    /// The other.
    Back,
}

/// Which of the two cones belongs to the side with this normal.
#[inline(always)]
fn place(normal: DVec3) -> usize {
    usize::from(normal.z.is_sign_negative())
}

/// The cones of both sides of a triangle.
fn cones(
    boxes: &Boxes,
    triangles: &[Triangle],
    narrow: f64,
    number: u32,
) -> [Cone; 2] {
    let front = Facet::new(&triangles[number as usize], Side::Front);
    let mut sides = [Side::Front, Side::Back];
    if place(front.normal) == 1 {
        sides.reverse();
    }
    sides.map(|side| cone(boxes, triangles, narrow, (number, side)))
}

// Estimate what the cones would save
/// An estimate of the share of all rays that would not be traced, from a
/// few paths of the image: because they leave open sides, or are free.
pub fn shares<K: Intersector>(
    (boxes, triangles): (&Boxes, &[Triangle]),
    scene: &Scene,
    (intersector, numbers): (&K, &[u32]),
    camera: &Camera,
) -> [f64; 2] {
    // Follow a path until a ray is free
    let follow = |n| {
        let mut random = generator(0, u64::MAX, n);
        let direction = camera.direction(random.random(), random.random());
        let mut next = scene.enter(camera.position, direction);
        let (mut counts, mut from) = ([0; 3], None);
        while let Some(ray) = next.take_if(|_| counts[2] < LONG) {
            counts[2] += 1;
            if let Some(hit) = intersector.first_hit(&ray, from) {
                // Leave the surface, unless the way is free
                let number = numbers[hit.primitive as usize];
                let cones = cones(boxes, triangles, NARROW, number);
                let cone = cones[place(hit.normal)];
                let (r, turn) = (random.random(), random.random());
                let direction = cosine_direction(hit.normal, r, turn);
                if cone.holds(hit.normal.dot(direction)) {
                    counts[usize::from(cone != Cone::OPEN)] += 1;
                } else {
                    next = Some(Ray { origin: hit.point, direction });
                    from = Some(hit.primitive);
                }
            }
        }
        counts
    };
    let pilots = (0..PILOTS).into_par_iter().map(follow);
    let add = |a: [u32; 3], b: [u32; 3]| array::from_fn(|i| a[i] + b[i]);
    let [open, free, traced] = pilots.reduce(|| [0; 3], add);
    let all = f64::from((open + free + traced).max(1));
    [open, free].map(|saved| f64::from(saved) / all)
}

/// Paths that try the cones out.
const PILOTS: u64 = 64;

/// Rays of such a path, at most.
const LONG: u32 = 10;

/// A cone of a greater cosine would hold a tenth of the rays.
pub const NARROW: f64 = 0.95;

// Look around from a side of a triangle
/// Looks around from one side of a triangle.
struct Lookout<'a> {
    triangles: &'a [Triangle],
    own: Facet,
    /// The number of the triangle.
    number: u32,
    /// The greatest cosine so far; none if nothing was in front.
    cosine: Option<f64>,
    /// The cosine from which on a cone is not worth having.
    narrow: f64,
    /// Leaves that may still be looked at.
    patience: u32,
}

impl Search for Lookout<'_> {
    fn promise(&self, bounds: &Bounds) -> Option<f64> {
        let cosine = self.own.cosine_of_box(bounds)?;
        (Some(cosine) > self.cosine).then_some(cosine)
    }

    // Raise the cosine to that of a leaf
    fn look(&mut self, numbers: &[u32]) -> bool {
        let impatience = if self.cosine.is_none() { 1 } else { HASTE };
        self.patience = self.patience.saturating_sub(impatience);
        for &number in numbers.iter().filter(|&&i| i != self.number) {
            let seen = &self.triangles[number as usize];
            let cosine = self.own.cosine_of_triangle(seen);
            if cosine > self.cosine {
                self.cosine = cosine;
            }
        }
        self.patience > 0 && self.cosine < Some(self.narrow)
    }
}

/// Leaves that are looked at from each side of a triangle, as long as
/// nothing is in front.
const PATIENCE: u32 = 256;

/// How many such leaves one counts for when something is.
const HASTE: u32 = 10;

/// The cone of a side of a triangle: that of its normal, or the other.
fn cone(
    boxes: &Boxes,
    triangles: &[Triangle],
    narrow: f64,
    (number, side): (u32, Side),
) -> Cone {
    let own = Facet::new(&triangles[number as usize], side);
    // Ask first whether the side is open
    let mut opening = Opening { triangles, own: &own, is_open: true };
    boxes.search(&mut opening);
    if opening.is_open {
        return Cone::OPEN;
    }
    if narrow == 0. || own.is_slim() {
        return Cone::NONE;
    }
    let (cosine, patience) = (None, PATIENCE);
    let mut lookout =
        Lookout { triangles, own, number, cosine, narrow, patience };
    let unseen = boxes.search(&mut lookout);
    let cosine =
        if unseen > lookout.cosine { unseen } else { lookout.cosine };
    match cosine < Some(narrow) {
        true => Cone::new(cosine),
        false => Cone::NONE,
    }
}

/// Asks whether anything is in front of a side.
struct Opening<'a> {
    triangles: &'a [Triangle],
    own: &'a Facet,
    is_open: bool,
}

impl Search for Opening<'_> {
    fn promise(&self, bounds: &Bounds) -> Option<f64> {
        let height = self.own.height_of_box(bounds);
        (height > 0.).then_some(height)
    }

    fn look(&mut self, numbers: &[u32]) -> bool {
        let corners =
            numbers.iter().flat_map(|&i| self.triangles[i as usize]);
        let mut points = corners.map(|corner| corner.as_dvec3());
        self.is_open = points.all(|point| self.own.height(point) == 0.);
        self.is_open
    }
}

// Hold a triangle as a place to look from
/// One side of a triangle, as a place to look from.
struct Facet {
    corners: [DVec3; 3],
    /// Of length one.
    normal: DVec3,
    /// In the plane, of length one: out over the three edges, the first
    /// of which begins at the first corner; then out at the corners.
    outwards: [DVec3; 6],
}

impl Facet {
    fn new(triangle: &Triangle, side: Side) -> Self {
        let mut corners = triangle.map(|corner| corner.as_dvec3());
        if side == Side::Back {
            corners.swap(1, 2);
        }
        let [a, b, c] = corners;
        let normal = cross(b - a, c - a).normalize();
        // Find the ways out of the triangle
        let out = [(a, b), (b, c), (c, a)];
        let out = out.map(|(p, q)| (q - p).cross(normal).normalize());
        let at_corners = [(2, 0), (0, 1), (1, 2)];
        let at_corners = at_corners.map(|(i, j)| out[i] + out[j]);
        let [p, q, r] = at_corners.map(|m| m.normalize_or_zero());
        let outwards = [out[0], out[1], out[2], p, q, r];
        Self { corners, normal, outwards }
    }

    // Measure the height of a point
    /// The height of a point above the plane, or zero if it is in the
    /// plane or behind, of which the sign is exact.
    fn height(&self, point: DVec3) -> f64 {
        let height = self.normal.dot(point - self.corners[0]);
        if height.abs() > TINY {
            return height.max(0.);
        }
        let [a, b, c] = self.corners.map(coord);
        let below = orient3d(a, b, c, coord(point));
        if below < 0. { height.max(f64::MIN_POSITIVE) } else { 0. }
    }

    // Bound the cosine of a box
    /// The height of the highest point of a box, or zero.
    fn height_of_box(&self, bounds: &Bounds) -> f64 {
        let (low, high) = bounds.doubles();
        let up = self.normal.cmpgt(DVec3::ZERO);
        self.height(DVec3::select(up, high, low))
    }

    /// A bound of the cosine of the points of a box; none if no point is in
    /// front.
    fn cosine_of_box(&self, bounds: &Bounds) -> Option<f64> {
        let height = self.height_of_box(bounds);
        if height == 0. {
            return None;
        }
        let (low, high) = bounds.doubles();
        let gap = |(&m, e): (&DVec3, &DVec3)| {
            let near = DVec3::select(m.cmpgt(DVec3::ZERO), low, high);
            m.dot(near - *e)
        };
        let corners = self.corners.iter().cycle();
        let gaps = self.outwards.iter().zip(corners).map(gap);
        let gap = gaps.fold(0., f64::max);
        Some(height / (height * height + gap * gap).sqrt())
    }

    // Bound the cosine of a triangle
    /// A bound of the cosine of the points of a triangle; none if no point
    /// is in front.
    fn cosine_of_triangle(&self, seen: &Triangle) -> Option<f64> {
        let points = seen.map(|corner| corner.as_dvec3());
        let heights = points.map(|point| self.height(point));
        if heights == [0.; 3] {
            return None;
        }
        let corners = self.corners.iter().cycle();
        let ways = self.outwards.iter().zip(corners);
        let slope = |(way, (&m, e)): (usize, (&DVec3, &DVec3))| {
            // Bound the slope along one way
            let across = points.map(|point| m.dot(point - *e));
            let mut slope = 0f64;
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                // Rise to a corner that is in front
                if heights[i] > 0. {
                    let rise = heights[i] / across[i];
                    slope = slope.max(if rise > 0. {
                        rise
                    } else {
                        f64::INFINITY
                    });
                }
                // Look where an edge crosses the plane
                if (heights[i] > 0.) != (heights[j] > 0.) {
                    let own = |&k: &usize| {
                        heights[k] == 0.
                            && self.corners.contains(&points[k])
                    };
                    let is_beyond = match [i, j].into_iter().find(own) {
                        Some(corner) => {
                            self.begins_way(way, points[corner])
                        }
                        None => {
                            // Find where the edge crosses the plane
                            let depth = |k: usize| {
                                self.normal.dot(points[k] - self.corners[0])
                            };
                            let t = (depth(i) / (depth(i) - depth(j)))
                                .clamp(0., 1.);
                            across[i] + t * (across[j] - across[i]) >= TINY
                        }
                    };
                    if !is_beyond {
                        slope = f64::INFINITY;
                    }
                }
            }
            slope
        };
        // Turn the least slope into a cosine
        let slope =
            ways.enumerate().map(slope).fold(f64::INFINITY, f64::min);
        Some(if slope < f64::INFINITY {
            slope / (slope * slope + 1.).sqrt()
        } else {
            1.
        })
    }

    /// Whether a corner is one of those where the triangle ends on a way.
    fn begins_way(&self, way: usize, corner: DVec3) -> bool {
        let ends = match way {
            0..3 => [way, (way + 1) % 3],
            _ => [way - 3; 2],
        };
        ends.iter().any(|&end| self.corners[end] == corner)
    }
}

/// A point, as the crate for exact predicates takes it.
pub fn coord(DVec3 { x, y, z }: DVec3) -> Coord3D<f64> {
    Coord3D { x, y, z }
}

/// Heights over the plane of a triangle, and where edges cross it, are
/// known better than this: 2^-20.
const TINY: f64 = 1. / (1 << 20) as f64;

/// Triangles of less height over their longest side have no cone.
const SLIM: f64 = 1. / 4096.;

impl Facet {
    /// Whether a path that met this triangle may well be beside it.
    fn is_slim(&self) -> bool {
        let [a, b, c] = self.corners;
        let sides = [b - a, c - b, a - c].map(DVec3::length);
        let longest = sides.into_iter().fold(0., f64::max);
        cross(b - a, c - a).length() < SLIM * longest
    }
}

// Use the cones in the estimator
impl Outlook {
    #[inline(always)]
    fn cone(&self, hit: &Hit) -> Cone {
        self.cones[hit.primitive as usize][place(hit.normal)]
    }
}

impl Foresight for Outlook {
    #[inline(always)]
    fn is_open(&self, hit: &Hit) -> bool {
        self.cone(hit) == Cone::OPEN
    }

    #[inline(always)]
    fn is_free(&self, hit: &Hit, direction: DVec3) -> bool {
        self.cone(hit).holds(hit.normal.dot(direction)) && hit.is_clear
    }
}
