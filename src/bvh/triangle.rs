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

use super::huge_pages::Pages;
use crate::numerics::cross;
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
        // Find the axis that becomes z
        let size = ray.direction.abs();
        let y = usize::from(size.y > size.x);
        let z = if size.z > size.x.max(size.y) { 2 } else { y };
        let axes = ROTATIONS[z];
        let direction: &[f64; 3] = ray.direction.as_ref();
        let origin: &[f64; 3] = ray.origin.as_ref();
        // Divide by the component along z
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

/// An edge function of less than this, with the wrong sign, may belong
/// to a triangle within 2^-32 of a point of the ray: 2^-15.
pub const NARROW: f64 = 1. / 32768.;

// Keep four triangles side by side
/// Triangles in a leaf at most.
pub const LANES: usize = 4;

/// No triangle.
pub const NONE: u32 = u32::MAX;

/// Most triangles whose slots a leaf can name: 2^29.
pub const MOST: usize = 1 << 29;

/// All leaves of a hierarchy.
pub struct Leaves {
    /// Nine numbers for each triangle, and `LANES` more.
    corners: Pages<f32>,
    /// For each slot the number in the scene.
    numbers: Pages<u32>,
}

impl Leaves {
    /// Room for `count` triangles.
    pub fn with_room(count: usize) -> io::Result<Self> {
        let corners = Pages::zeroed(9 * count + LANES)?;
        Ok(Self { corners, numbers: Pages::zeroed(count)? })
    }

    // Find a leaf without a check
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
        Room { corners: &mut self.corners, numbers: &mut self.numbers }
    }

    // Find the number of a triangle
    /// The number of a triangle in the scene.
    pub fn number(&self, slot: u32) -> u32 {
        self.numbers[slot as usize]
    }
}

/// Slots that are still empty.
pub struct Room<'a> {
    corners: &'a mut [f32],
    numbers: &'a mut [u32],
}

impl<'a> Room<'a> {
    /// Cuts off the first `count` slots.
    pub fn take(&mut self, count: usize) -> Room<'a> {
        let corners = split_off(&mut self.corners, 9 * count);
        Room { corners, numbers: split_off(&mut self.numbers, count) }
    }

    // Fill a leaf run by run
    /// Makes the first slots a leaf of these triangles, each with its
    /// number in the scene.
    pub fn fill(&mut self, triangles: &[(u32, Triangle)]) {
        let count = triangles.len();
        let Room { corners, numbers } = self.take(count);
        for (lane, &(number, triangle)) in triangles.iter().enumerate() {
            for i in 0..9 {
                corners[i * count + lane] = triangle[i / 3][i % 3];
            }
            numbers[lane] = number;
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
    pub fn triangle(&self, lane: u32) -> [DVec3; 3] {
        let at = |i: usize| self.coordinate(i, lane as usize);
        let corner = |c: usize| DVec3::new(at(c), at(c + 1), at(c + 2));
        [corner(0), corner(3), corner(6)]
    }

    // Test the four triangles
    /// The lanes that a ray meets, as a mask, with the distances; lanes that
    /// it passes close by from bit `LANES` on, with where that begins. What
    /// the distance of another lane says is not specified.
    #[inline(always)]
    pub fn meet(&self, shear: &Shear) -> (u32, [f64; LANES]) {
        let mut distances = [0.; LANES];
        let mut met = 0;
        for (lane, distance) in distances.iter_mut().enumerate() {
            if self.lanes >> lane & 1 != 0 {
                // Add what the ray does to this triangle
                match self.test(lane, shear) {
                    TriangleTest::Through(at) if at > -NEAR => {
                        *distance = at;
                        met |= 1 << lane;
                    }
                    TriangleTest::Beside(at) => {
                        *distance = at[0].min(at[1]).min(at[2]);
                        met |= 1 << (lane + LANES);
                    }
                    _ => (),
                }
            }
        }
        (met, distances)
    }

    /// What a ray does to the triangle in a lane.
    #[inline(always)]
    pub fn test(&self, lane: usize, shear: &Shear) -> TriangleTest {
        let [x, y, z] = self.sheared(lane, shear);
        let u = edge(x[2], y[1], y[2], x[1]);
        let v = edge(x[0], y[2], y[0], x[2]);
        let w = edge(x[1], y[0], y[1], x[0]);
        let within = |margin: f64| {
            (u >= -margin && v >= -margin && w >= -margin)
                || (u <= margin && v <= margin && w <= margin)
        };
        // Tell what the ray does by the signs
        if within(0.) {
            // Find the distance along the ray
            let height = (u * z[0] + v * z[1] + w * z[2]) / (u + v + w);
            TriangleTest::Through(height * shear.stretch)
        } else if within(NARROW) {
            TriangleTest::Beside(z.map(|z| z * shear.stretch))
        } else {
            TriangleTest::Apart
        }
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

/// What a ray does to a triangle.
#[derive(Clone, Copy, Debug)]
pub enum TriangleTest {
    /// Its line goes through it, at this distance, which is negative
    /// behind the origin, and not a number if it is seen edge on.
    Through(f64),
    /// It passes by so closely that a small displacement could make it
    /// go through; the distances of the corners along the ray.
    Beside([f64; 3]),
    /// Neither.
    Apart,
}

// Keep the nearest triangle so far
/// The nearest triangle so far.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    pub leaves: &'a Leaves,
    /// The slot that the ray left, or `NONE`.
    from: u32,
    /// How far the nearest triangle is, or infinity.
    pub distance: f64,
    /// Where it is kept, or `NONE`.
    pub slot: u32,
    /// The slots of its leaf, the first and how many.
    leaf: (u32, usize),
    /// The least distance at which something else is close to the ray.
    pub near_tie: f64,
}

impl<'a> Search<'a> {
    /// A search that has met nothing, for a ray that left slot `from`.
    #[inline(always)]
    pub fn new(leaves: &'a Leaves, from: Option<u32>) -> Self {
        let (from, near_tie) = (from.unwrap_or(NONE), f64::INFINITY);
        let (distance, slot, leaf) = (f64::INFINITY, NONE, (0, 0));
        Self { leaves, from, distance, slot, leaf, near_tie }
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
    /// from slot `first`, which is met at `distance`; a lane of `LANES` or
    /// more is that of a triangle which is only passed closely.
    ///
    /// # Safety
    /// A leaf of these triangles has been put there, and has this lane.
    #[inline(always)]
    pub unsafe fn offer(
        &mut self,
        (first, count): (u32, usize),
        lane: u32,
        mut distance: f64,
        ray: &Ray,
    ) {
        // Doubt the order of triangles that are close
        let gap = (distance - self.distance).abs();
        let beside = lane >= LANES as u32;
        if beside || gap <= NEAR || distance <= NEAR {
            self.near_tie = self.near_tie.min(distance);
            let leaves = self.leaves;
            let behind = || leaves.is_behind((first, count), lane, ray);
            if beside || distance <= NEAR && behind() {
                return;
            }
            distance = distance.max(f64::MIN_POSITIVE);
        }
        // Keep the triangle if it comes first
        let (Self { leaves, .. }, slot) = (*self, first + lane);
        let equal = distance == self.distance;
        if distance < self.distance
            || equal && leaves.is_before(slot, self.slot)
        {
            (self.distance, self.slot) = (distance, slot);
            self.leaf = (first, count);
        }
    }

    /// The corners of the nearest triangle, if there is one.
    #[inline(always)]
    pub fn triangle(&self) -> [DVec3; 3] {
        let (first, count) = self.leaf;
        // SAFETY: `offer` was promised that this leaf is there.
        let leaf = unsafe { self.leaves.leaf(first, count) };
        leaf.triangle(self.slot - first)
    }
}

impl Leaves {
    // Decide where the distances do not
    /// Whether the triangle in `slot` comes before that in `other`, if any.
    #[cold]
    fn is_before(&self, slot: u32, other: u32) -> bool {
        other == NONE || self.number(slot) < self.number(other)
    }

    /// Whether the ray starts beyond the plane of the triangle in a lane of
    /// the leaf of `count` triangles from slot `first`.
    #[cold]
    fn is_behind(
        &self,
        (first, count): (u32, usize),
        lane: u32,
        ray: &Ray,
    ) -> bool {
        // SAFETY: the leaf was tested a moment ago.
        let leaf = unsafe { self.leaf(first, count) };
        let [a, b, c] = leaf.triangle(lane);
        let normal = cross(b - a, c - a);
        normal.dot(ray.direction) * normal.dot(ray.origin - a) >= 0.
    }
}

/// Distances along a ray that are closer are not told apart: 2^-22.
pub const NEAR: f64 = 1. / (1 << 22) as f64;
