// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Does a ray meet a triangle?
//!
//! The answers depend on the ray and the triangle alone, and are the
//! same on every processor.

// Name what the triangles import
use std::io;

use glam::DVec3;
use robust::{Coord3D, orient3d};

use super::Hit;
use super::pages::Pages;
use crate::scene::{Ray, Triangle};

// Make a ray the z axis
/// A change of coordinates that makes a ray the z axis (Woop, Benthin
/// and Wald 2013, section 3).
#[derive(Clone, Copy, Debug)]
pub struct Shear {
    /// Which coordinates become x, y and z; each below 3.
    pub axes: [usize; 3],
    /// The origin of the ray, permuted.
    pub origin: [f64; 3],
    /// The quotients dx/dz and dy/dz.
    pub slope: [f64; 2],
    /// 1/dz: distance along the ray per unit of z.
    pub stretch: f64,
}

impl Shear {
    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let size = ray.direction.abs();
        let y = usize::from(size.y > size.x);
        let z = if size.z > size.x.max(size.y) { 2 } else { y };
        let axes = ROTATIONS[z];
        let direction: &[f64; 3] = ray.direction.as_ref();
        let origin: &[f64; 3] = ray.origin.as_ref();
        let [x, y, z] = axes.map(|axis| direction[axis]);
        let origin = axes.map(|axis| flush(origin[axis], SMALLEST));
        let stretch = 1. / z;
        let slope = [x, y].map(|d| flush(d * stretch, FLATTEST));
        Self { axes, origin, slope, stretch }
    }
}

const ROTATIONS: [[usize; 3]; 3] = [[1, 2, 0], [2, 0, 1], [0, 1, 2]];

/// The number 2^-100.
const SMALLEST: f64 = f64::from_bits((1023 - 100) << 52);

/// The number 2^-200.
const FLATTEST: f64 = f64::from_bits((1023 - 200) << 52);

/// `x`, or zero if it is smaller than `least`.
#[inline(always)]
fn flush(x: f64, least: f64) -> f64 {
    if x.abs() < least { 0. } else { x }
}

// Evaluate an edge function with its sign
/// `a * b - c * d`, to a relative error of 2^-42, with the sign of the
/// exact number, as long as no product underflows.
#[inline(always)]
fn edge(a: f64, b: f64, c: f64, d: f64) -> f64 {
    let (p, q) = (a * b, c * d);
    let rough = p - q;
    match rough.abs() > CLOSE * p.abs() {
        true => rough,
        false => refined(a, b, c, d, rough),
    }
}

/// How small a difference of products may be relative to them: 2^-10.
pub const CLOSE: f64 = 1. / 1024.;

#[cold]
fn refined(a: f64, b: f64, c: f64, d: f64, rough: f64) -> f64 {
    let lost = a.mul_add(b, -(a * b)) - c.mul_add(d, -(c * d));
    match rough + lost {
        0. => rough,
        sum => sum,
    }
}

// Keep four triangles side by side
/// Triangles in a leaf at most.
pub const LANES: usize = 4;

/// No triangle.
pub const NONE: u32 = u32::MAX;

/// Most triangles that labels and leaves can tell apart: 2^28.
pub const MOST: usize = 1 << 28;

/// All leaves of a hierarchy.
pub struct Leaves {
    /// Nine numbers for each triangle, and `LANES` more.
    corners: Pages<f32>,
    /// For each slot the number in the scene, from bit 28 the lane, and
    /// from bit 30 the number of triangles in the leaf less one.
    labels: Pages<u32>,
}

impl Leaves {
    /// Room for `count` triangles.
    pub fn with_room(count: usize) -> io::Result<Self> {
        let corners = Pages::zeroed(9 * count + LANES)?;
        Ok(Self { corners, labels: Pages::zeroed(count)? })
    }

    /// The leaf of `count` triangles from slot `first`.
    ///
    /// # Safety
    /// A leaf of these triangles has been put there.
    #[inline(always)]
    pub unsafe fn leaf(&self, first: u32, count: usize) -> Leaf<'_> {
        // SAFETY: the leaf is within the array, says the caller.
        let corners =
            unsafe { self.corners.get_unchecked(9 * first as usize..) };
        Leaf { corners, count, lanes: (1 << count) - 1 }
    }

    /// All leaves, to be filled from the front.
    pub fn room(&mut self) -> Room<'_> {
        Room { corners: &mut self.corners, labels: &mut self.labels }
    }

    // Find a triangle by its slot
    /// The number of a triangle in the scene.
    pub fn number(&self, slot: u32) -> u32 {
        self.labels[slot as usize] & (MOST as u32 - 1)
    }

    /// The corners of a triangle.
    pub fn triangle(&self, slot: u32) -> [DVec3; 3] {
        let label = self.labels[slot as usize];
        let (lane, count) = (label >> 28 & 3, (label >> 30) as usize + 1);
        // SAFETY: the labels are those of leaves, each in its place.
        unsafe { self.leaf(slot - lane, count) }.triangle(lane)
    }
}

/// Slots that are still empty.
pub struct Room<'a> {
    corners: &'a mut [f32],
    labels: &'a mut [u32],
}

impl<'a> Room<'a> {
    /// Cuts off the first `count` slots.
    pub fn take(&mut self, count: usize) -> Room<'a> {
        let corners = split_off(&mut self.corners, 9 * count);
        Room { corners, labels: split_off(&mut self.labels, count) }
    }

    /// Makes the first slots a leaf of these triangles, each with its
    /// number in the scene.
    pub fn fill(&mut self, triangles: &[(u32, Triangle)]) {
        let count = triangles.len();
        let size = (count as u32 - 1) << 30;
        let Room { corners, labels } = self.take(count);
        for (lane, &(number, triangle)) in triangles.iter().enumerate() {
            for i in 0..9 {
                corners[i * count + lane] = triangle[i / 3][i % 3];
            }
            labels[lane] = number | (lane as u32) << 28 | size;
        }
    }
}

fn split_off<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (first, rest) = std::mem::take(slice).split_at_mut(count);
    *slice = rest;
    first
}

/// Up to four triangles.
#[derive(Clone, Copy)]
pub struct Leaf<'a> {
    /// Coordinate `axis` of corner `c` of a lane, at
    /// `(3 * c + axis) * count + lane`; longer by `LANES` than need be.
    pub corners: &'a [f32],
    /// How many triangles.
    pub count: usize,
    /// Those to be tested; bit i stands for lane i.
    pub lanes: u32,
}

impl Leaf<'_> {
    #[inline(always)]
    fn coordinate(&self, i: usize, lane: usize) -> f64 {
        f64::from(self.corners[i * self.count + lane])
    }

    /// The corners of the triangle in a lane.
    #[inline(always)]
    fn triangle(&self, lane: u32) -> [DVec3; 3] {
        let at = |i: usize| self.coordinate(i, lane as usize);
        let corner = |c: usize| DVec3::new(at(c), at(c + 1), at(c + 2));
        [corner(0), corner(3), corner(6)]
    }

    // Test the four triangles
    /// The lanes that a ray meets, as a mask, with the distances. What the
    /// distance of a lane that is not met says is not specified.
    #[inline(always)]
    pub fn meet(&self, shear: &Shear) -> (u32, [f64; LANES]) {
        let mut distances = [0.; LANES];
        let mut met = 0;
        for (lane, distance) in distances.iter_mut().enumerate() {
            if self.lanes >> lane & 1 != 0 {
                *distance = self.distance(lane, shear);
                met |= u32::from(*distance > 0.) << lane;
            }
        }
        (met, distances)
    }

    /// The distance to one triangle, or minus infinity.
    #[inline(always)]
    fn distance(&self, lane: usize, shear: &Shear) -> f64 {
        let [x, y, z] = self.sheared(lane, shear);
        let u = edge(x[2], y[1], y[2], x[1]);
        let v = edge(x[0], y[2], y[0], x[2]);
        let w = edge(x[1], y[0], y[1], x[0]);
        let inside = (u >= 0. && v >= 0. && w >= 0.)
            || (u <= 0. && v <= 0. && w <= 0.);
        if !inside {
            return f64::NEG_INFINITY;
        }
        // Find the distance along the ray
        let height = (u * z[0] + v * z[1] + w * z[2]) / (u + v + w);
        height * shear.stretch
    }

    /// The x, y and z of the three corners after the shear.
    #[inline(always)]
    pub fn sheared(&self, lane: usize, shear: &Shear) -> [[f64; 3]; 3] {
        let moved = |c: usize, i: usize| {
            self.coordinate(3 * c + shear.axes[i], lane) - shear.origin[i]
        };
        let z = [moved(0, 2), moved(1, 2), moved(2, 2)];
        let flat = |c: usize, i: usize| moved(c, i) - shear.slope[i] * z[c];
        let x = [flat(0, 0), flat(1, 0), flat(2, 0)];
        let y = [flat(0, 1), flat(1, 1), flat(2, 1)];
        [x, y, z]
    }
}

// Keep the nearest triangle so far
/// The nearest triangle so far.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    leaves: &'a Leaves,
    /// The slot that the ray left, or `NONE`.
    from: u32,
    /// How far the nearest triangle is, or infinity.
    pub distance: f64,
    /// Where it is kept, or `NONE`.
    pub slot: u32,
    /// The slots of its leaf, the first and how many.
    leaf: (u32, usize),
}

impl<'a> Search<'a> {
    /// A search that has met nothing, for a ray that left slot `from`.
    #[inline(always)]
    pub fn new(leaves: &'a Leaves, from: Option<u32>) -> Self {
        let (from, distance) = (from.unwrap_or(NONE), f64::INFINITY);
        Self { leaves, from, distance, slot: NONE, leaf: (0, 0) }
    }

    // Take a triangle that is nearer
    /// The leaf of `count` triangles from slot `first`, without the one
    /// that the ray left.
    ///
    /// # Safety
    /// A leaf of these triangles has been put there.
    #[inline(always)]
    pub unsafe fn leaf(&self, first: u32, count: usize) -> Leaf<'a> {
        // SAFETY: it is there, says the caller.
        let mut leaf = unsafe { self.leaves.leaf(first, count) };
        let lane = self.from.wrapping_sub(first);
        leaf.lanes &= !(u32::from(lane < LANES as u32) << (lane & 3));
        leaf
    }

    /// Considers the triangle in a lane of the leaf of `count` triangles
    /// from slot `first`, which is met at `distance`.
    #[inline(always)]
    pub fn offer(
        &mut self,
        (first, count): (u32, usize),
        lane: u32,
        distance: f64,
    ) {
        let (Self { leaves, from, .. }, slot) = (*self, first + lane);
        if distance < NEAR && from != NONE && leaves.coplanar(from, slot) {
            return;
        }
        let equal = distance == self.distance;
        if distance < self.distance
            || equal && leaves.is_before(slot, self.slot)
        {
            (self.distance, self.slot) = (distance, slot);
            self.leaf = (first, count);
        }
    }

    // Make the search's result a hit
    /// The hit of `ray` on the nearest triangle, if there is one.
    #[inline(always)]
    pub fn hit(&self, ray: &Ray) -> Option<Hit> {
        if self.slot == NONE {
            return None;
        }
        let point = ray.origin + ray.direction * self.distance;
        let (first, count) = self.leaf;
        // SAFETY: the slot is one of a leaf that was offered.
        let leaf = unsafe { self.leaves.leaf(first, count) };
        let [a, b, c] = leaf.triangle(self.slot - first);
        let normal = (b - a).cross(c - a).normalize();
        let away = normal.dot(ray.direction) > 0.;
        let normal = if away { -normal } else { normal };
        Some(Hit { point, normal, primitive: self.slot })
    }
}

impl Leaves {
    // Break a tie by number
    /// Whether the triangle in `slot` comes before that in `other`, if any.
    #[cold]
    fn is_before(&self, slot: u32, other: u32) -> bool {
        other == NONE || self.number(slot) < self.number(other)
    }

    // Recognise triangles in one plane
    /// Whether the triangle in `slot` lies in the plane of that in `from`.
    #[cold]
    fn coplanar(&self, from: u32, slot: u32) -> bool {
        let point = |corner: DVec3| {
            let [x, y, z] = corner.to_array();
            Coord3D { x, y, z }
        };
        let [a, b, c] = self.triangle(from);
        let [a, b, c] = [point(a), point(b), point(c)];
        let above = |d| orient3d(a, b, c, point(d));
        self.triangle(slot).into_iter().all(|d| above(d) == 0.)
    }
}

/// Beyond this distance no triangle is met in the plane that the ray
/// left: 2^-9.
const NEAR: f64 = 1. / 512.;
