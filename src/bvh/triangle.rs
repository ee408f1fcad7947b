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
use std::array;

use glam::{DVec3, Vec3};

use super::huge_pages::Pages;
use crate::numerics::{cross, exponent, power_of_two};
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

/// What is small beside the lengths from which it is computed.
#[derive(Clone, Copy, Debug)]
pub struct Margins {
    /// From a ray's origin to the corners of a triangle, along an axis;
    /// and a part of the coordinates of the origin.
    pub size: f64,
}

/// A box that holds some triangles of a scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct Region {
    /// Its middle, from where planes are counted.
    pub zero: DVec3,
    /// Half of its longest side.
    pub reach: f64,
}

impl Region {
    /// The region between two opposite corners.
    pub fn between(low: DVec3, high: DVec3) -> Self {
        let reach = 0.5 * (high - low).max_element();
        Self { zero: 0.5 * (low + high), reach }
    }

    /// A region that holds both.
    pub fn union(self, other: Self) -> Self {
        let (a, b) = (self.zero - self.reach, other.zero - other.reach);
        let (c, d) = (self.zero + self.reach, other.zero + other.reach);
        Self::between(a.min(b), c.max(d))
    }

    /// What is small for rays from a point to triangles of the region.
    #[inline(always)]
    pub fn margins(&self, point: DVec3) -> Margins {
        let span = (point - self.zero).abs().max_element() + self.reach;
        Margins::new(span, point)
    }
}

/// A point's coordinates are rounded to 2^-53 of themselves, of which
/// margins are larger than of distances: an eighth counts.
pub const PLACE: f64 = 0.125;

impl Margins {
    /// Distances along a ray that are closer are not told apart: 2^-35.
    #[inline(always)]
    pub fn near(self) -> f64 {
        self.size * (1. / (1u64 << 35) as f64)
    }

    /// An edge function of less than this, with the wrong sign, may belong
    /// to a triangle within 2^-45 of a point of the ray: 2^-43, of the
    /// square.
    #[inline(always)]
    pub fn narrow(self) -> f64 {
        self.size * self.size * (1. / (1u64 << 43) as f64)
    }

    /// Those of triangles up to `span` away from a point.
    #[inline(always)]
    pub fn new(span: f64, point: DVec3) -> Self {
        let place = point.abs().max_element();
        Self { size: (1. + PLACE) * span + PLACE * place }
    }

    /// How far off its surface a hit is put, and at least how far from
    /// other triangles, by our computation: 2^-47.
    #[inline(always)]
    pub fn clear(self) -> f64 {
        self.size * (1. / (1u64 << 47) as f64)
    }
}

// Keep four triangles side by side
/// Triangles in a leaf at most.
pub const LANES: usize = 4;

/// No triangle.
pub const NONE: u32 = u32::MAX;

/// Words of the unit in which leaves are counted.
pub const UNIT: usize = 4;

/// Most units that a child can name: 2^29.
pub const MOST: usize = 1 << 29;

/// Words before the corners of a leaf: three coordinates of an origin and
/// a tag.
pub const HEAD: usize = 4;

/// What the last eight bits of a tag say: the kind of a leaf, or the
/// exponent of its unit of length, plus `BIAS`.
pub const EXACT: u32 = 0;
pub const GATE: u32 = 255;
pub const BACK: u32 = 254;
const BIAS: i32 = 180;

/// Units of a gate, after which the way back follows.
pub const GATE_UNITS: u32 = 4;

/// Marks the number of a child as that of a leaf.
pub const LEAF: u32 = 1 << 31;

/// The child that is a leaf of `count` triangles at unit `first`.
pub fn leaf(first: u32, count: u32) -> u32 {
    LEAF | (count - 1) << 29 | first
}

/// The first unit and the count of a child that is a leaf.
#[inline(always)]
pub fn slots(child: u32) -> (u32, usize) {
    (child & ((1 << 29) - 1), (child >> 29 & 3) as usize + 1)
}

/// All leaves of a hierarchy, one after the other.
pub struct Leaves(pub Pages<u32>);

impl Leaves {
    // Find a leaf without a check
    /// The leaf of `count` triangles at unit `first`.
    ///
    /// # Safety
    /// A leaf of these triangles has been put there.
    #[inline(always)]
    pub unsafe fn leaf(&self, first: u32, count: usize) -> Leaf<'_> {
        // SAFETY: the leaf is within the array, says the caller.
        let words =
            unsafe { self.0.get_unchecked(UNIT * first as usize..) };
        Leaf { words, count, lanes: (1 << count) - 1 }
    }

    // Find a triangle by its slot
    /// The leaf and the lane of a triangle.
    fn find(&self, slot: u32) -> (Leaf<'_>, u32) {
        let first = slot >> 2;
        let words = &self.0[UNIT * first as usize..];
        let count = (words[3] >> 8 & 3) as usize + 1;
        (Leaf { words, count, lanes: (1 << count) - 1 }, slot & 3)
    }

    /// The corners of the triangle in a slot.
    pub fn triangle(&self, slot: u32) -> Triangle {
        let (leaf, lane) = self.find(slot);
        leaf.triangle(lane)
    }

    /// The face of the triangle in a slot.
    pub fn face(&self, slot: u32) -> u32 {
        let (leaf, lane) = self.find(slot);
        leaf.face(lane)
    }
}

/// The slot of the triangle in a lane of the leaf at unit `first`.
#[inline(always)]
pub fn slot(first: u32, lane: u32) -> u32 {
    first << 2 | lane
}

/// How a leaf is written.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    origin: [f32; 3],
    tag: u32,
}

impl Shape {
    /// The shape of a leaf of these triangles.
    pub fn of(triangles: &[Triangle]) -> Self {
        let corners = triangles.as_flattened();
        let low = corners.iter().fold(corners[0], |a, b| a.min(*b));
        let high = corners.iter().fold(corners[0], |a, b| a.max(*b));
        let middle = (0.5 * low + 0.5 * high).as_vec3();
        let reach = |origin: Vec3| {
            let origin = origin.as_dvec3();
            (high - origin).max(origin - low).max_element()
        };
        let count = (triangles.len() - 1) as u32;
        let (origin, kind) = Self::compact(corners, middle, reach(middle))
            .unwrap_or((middle, EXACT));
        Self { origin: origin.to_array(), tag: count << 8 | kind }
    }

    /// An origin near `middle` from which all points, up to `reach` away
    /// from there, can be reached by 31 bits, and the kind of the leaf.
    fn compact(
        corners: &[DVec3],
        middle: Vec3,
        reach: f64,
    ) -> Option<(Vec3, u32)> {
        let digits = exponent(reach) + 1 - 30;
        let kind = u32::try_from(digits + BIAS).ok()?;
        if kind == EXACT || kind >= BACK {
            return None;
        }
        let unit = power_of_two(-digits);
        let whole = (middle.as_dvec3() * unit).round() / unit;
        let origin = whole.as_vec3();
        let fits = |p: &DVec3| {
            let steps = (*p - whole) * unit;
            steps.round() == steps && whole + steps / unit == *p
        };
        let fits = origin.as_dvec3() == whole && corners.iter().all(fits);
        fits.then_some((origin, kind))
    }

    /// How many units it takes.
    pub fn units(self) -> u32 {
        let count = (self.tag >> 8 & 3) as usize + 1;
        let words = match self.tag & 255 {
            // Four numbers are read of the last run.
            EXACT => (19 * count).max(16 * count + 2 * LANES),
            _ => 10 * count,
        };
        (HEAD + words).div_ceil(UNIT) as u32
    }

    /// Writes these triangles, each with its face.
    pub fn write(self, words: &mut [u32], triangles: &[(u32, Triangle)]) {
        let count = triangles.len();
        words[..3].copy_from_slice(&self.origin.map(f32::to_bits));
        words[3] = self.tag;
        let origin = self.origin.map(f64::from);
        let exact = self.tag & 255 == EXACT;
        let leaf = Leaf { words, count, lanes: 0 };
        let unit = leaf.unit();
        for (lane, &(face, triangle)) in triangles.iter().enumerate() {
            for i in 0..9 {
                let x = triangle[i / 3][i % 3];
                let place = i * count + lane;
                if exact {
                    write_double(&mut words[HEAD + 2 * place..], x);
                } else {
                    let steps = (x - origin[i % 3]) / unit;
                    words[HEAD + place] = steps as i32 as u32;
                }
            }
            let runs = if exact { 18 } else { 9 };
            words[HEAD + runs * count + lane] = face;
        }
    }
}

fn write_double(words: &mut [u32], x: f64) {
    let bits = x.to_bits();
    [words[0], words[1]] = [bits as u32, (bits >> 32) as u32];
}

#[inline(always)]
fn double(words: &[u32]) -> f64 {
    f64::from_bits(u64::from(words[1]) << 32 | u64::from(words[0]))
}

/// Writes a gate to the node `inner` and its zero, and the way back.
pub fn write_gate(
    words: &mut [u32],
    (inner, node): (Region, u32),
    outer: Region,
) {
    let (gate, back) = words.split_at_mut(UNIT * GATE_UNITS as usize);
    for (words, region, kind) in [(gate, inner, GATE), (back, outer, BACK)]
    {
        words[HEAD - 1] = kind;
        let Region { zero, reach } = region;
        let numbers = [zero.x, zero.y, zero.z, reach];
        for (i, x) in numbers.into_iter().enumerate() {
            write_double(&mut words[HEAD + 2 * i..], x);
        }
        words[HEAD + 8] = node;
    }
}

/// Up to four triangles.
#[derive(Clone, Copy)]
pub struct Leaf<'a> {
    /// An origin, a tag, coordinate `axis` of corner `c` of a lane at
    /// `(3 * c + axis) * count + lane`, and a face for each lane.
    pub words: &'a [u32],
    /// How many triangles.
    pub count: usize,
    /// Those to be tested; bit i stands for lane i.
    pub lanes: u32,
}

impl Leaf<'_> {
    /// The kind of the leaf.
    #[inline(always)]
    pub fn kind(&self) -> u32 {
        // SAFETY: each leaf has a head.
        unsafe { self.words.get_unchecked(3) & 255 }
    }

    /// The unit of length.
    #[inline(always)]
    pub fn unit(&self) -> f64 {
        let exponent = self.kind() as u64;
        f64::from_bits((exponent + (1023 - BIAS as u64)) << 52)
    }

    /// Where the coordinates are counted from, along an axis.
    #[inline(always)]
    pub fn origin(&self, axis: usize) -> f64 {
        debug_assert!(axis < 3);
        // SAFETY: each leaf has a head, and axes are below 3.
        f64::from(f32::from_bits(unsafe {
            *self.words.get_unchecked(axis)
        }))
    }

    #[inline(always)]
    fn coordinate(&self, c: usize, axis: usize, lane: usize) -> f64 {
        let place = (3 * c + axis) * self.count + lane;
        if self.kind() == EXACT {
            return double(&self.words[HEAD + 2 * place..]);
        }
        let steps = f64::from(self.words[HEAD + place] as i32);
        steps * self.unit() + self.origin(axis)
    }

    /// The corners of the triangle in a lane.
    #[inline(always)]
    pub fn triangle(&self, lane: u32) -> Triangle {
        let count = self.count;
        if self.kind() == EXACT {
            let runs = &self.words[HEAD + 2 * lane as usize..];
            let runs = &runs[..16 * count + 2];
            return array::from_fn(|c| {
                DVec3::from_array(array::from_fn(|axis| {
                    double(&runs[2 * (3 * c + axis) * count..])
                }))
            });
        }
        let runs = &self.words[HEAD + lane as usize..];
        let runs = &runs[..8 * count + 1];
        let unit = self.unit();
        let zero = array::from_fn(|axis| self.origin(axis));
        let zero = DVec3::from_array(zero);
        array::from_fn(|c| {
            let steps = array::from_fn(|axis| {
                f64::from(runs[(3 * c + axis) * count] as i32)
            });
            DVec3::from_array(steps) * unit + zero
        })
    }

    /// The face of the triangle in a lane.
    pub fn face(&self, lane: u32) -> u32 {
        let runs = if self.kind() == EXACT { 18 } else { 9 };
        self.words[HEAD + runs * self.count + lane as usize]
    }

    /// The region beyond a gate.
    #[cold]
    pub fn region(&self) -> Region {
        let at = |i: usize| double(&self.words[HEAD + 2 * i..]);
        Region { zero: DVec3::new(at(0), at(1), at(2)), reach: at(3) }
    }

    /// The node to which the gate at unit `first` leads, and the child that
    /// leads back; none if it leads back itself.
    #[cold]
    pub fn gate(&self, first: u32) -> Option<(u32, u32)> {
        let back = LEAF | (first + GATE_UNITS);
        (self.kind() == GATE).then_some((self.words[HEAD + 8], back))
    }

    // Test the four triangles
    /// The lanes that a ray meets, as a mask, with the distances; lanes that
    /// it passes close by from bit `LANES` on, with where that begins. What
    /// the distance of another lane says is not specified.
    #[inline(always)]
    pub fn meet(
        &self,
        shear: &Shear,
        margins: Margins,
    ) -> (u32, [f64; LANES]) {
        let mut distances = [0.; LANES];
        let mut met = 0;
        for (lane, distance) in distances.iter_mut().enumerate() {
            if self.lanes >> lane & 1 != 0 {
                // Add what the ray does to this triangle
                match self.test(lane, shear, margins) {
                    TriangleTest::Through(at) if at > -margins.near() => {
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
    pub fn test(
        &self,
        lane: usize,
        shear: &Shear,
        margins: Margins,
    ) -> TriangleTest {
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
        } else if within(margins.narrow()) {
            TriangleTest::Beside(z.map(|z| z * shear.stretch))
        } else {
            TriangleTest::Apart
        }
    }

    /// The x, y and z of the three corners after the shear.
    #[inline(always)]
    pub fn sheared(&self, lane: usize, shear: &Shear) -> [[f64; 3]; 3] {
        let moved = |c: usize, i: usize| {
            self.coordinate(c, shear.axes[i], lane) - shear.origin[i]
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
    /// What is small in the region that is searched.
    pub margins: Margins,
    /// Where it is kept, or `NONE`.
    pub slot: u32,
    /// The number of triangles in its leaf.
    count: usize,
    /// The least distance at which something else is close to the ray.
    pub near_tie: f64,
}

impl<'a> Search<'a> {
    /// A search that has met nothing, for a ray that left slot `from`.
    #[inline(always)]
    pub fn new(leaves: &'a Leaves, from: Option<u32>) -> Self {
        let from = from.unwrap_or(NONE);
        let distance = f64::INFINITY;
        Self {
            leaves,
            from,
            distance,
            margins: Margins { size: 0. },
            slot: NONE,
            count: 0,
            near_tie: distance,
        }
    }

    // Take a triangle that is nearer
    /// The leaf of `count` triangles at unit `first`, without the one
    /// that the ray left.
    ///
    /// # Safety
    /// A leaf of these triangles has been put there.
    #[inline(always)]
    pub unsafe fn leaf(&self, first: u32, count: usize) -> Leaf<'a> {
        // SAFETY: it is there, says the caller.
        let mut leaf = unsafe { self.leaves.leaf(first, count) };
        let lane = self.from.wrapping_sub(first << 2);
        leaf.lanes &= !(u32::from(lane < LANES as u32) << (lane & 3));
        leaf
    }

    /// Up to where others may be as near as the nearest so far.
    #[inline(always)]
    pub fn limit(&self) -> f64 {
        self.distance + self.margins.near()
    }

    /// Considers the triangle in a lane of the leaf at unit `first`, which
    /// is met at `distance`; a lane of `LANES` or more is that of a
    /// triangle which is only passed closely.
    #[inline(always)]
    pub fn offer(
        &mut self,
        (first, leaf): (u32, Leaf),
        lane: u32,
        mut distance: f64,
        ray: &Ray,
    ) {
        // Doubt the order of triangles that are close
        let near = self.margins.near();
        let beside = lane >= LANES as u32;
        if beside
            || (distance - self.distance).abs() <= near
            || distance <= near
        {
            self.near_tie = self.near_tie.min(distance - near);
            let behind = || is_behind(leaf, lane, ray);
            if beside || distance <= near && behind() {
                return;
            }
            distance = distance.max(f64::MIN_POSITIVE);
        }
        // Keep the triangle if it comes first
        let slot = slot(first, lane);
        let equal = distance == self.distance;
        if distance < self.distance || equal && self.is_before(slot) {
            (self.distance, self.slot) = (distance, slot);
            self.count = leaf.count;
        }
    }

    /// The corners of the nearest triangle, if there is one.
    #[inline(always)]
    pub fn triangle(&self) -> Triangle {
        // SAFETY: `offer` was given a leaf that is there.
        let leaf = unsafe { self.leaves.leaf(self.slot >> 2, self.count) };
        leaf.triangle(self.slot & 3)
    }

    // Decide where the distances do not
    /// Whether the triangle in `slot` comes before the nearest, if any.
    #[cold]
    fn is_before(&self, slot: u32) -> bool {
        let key = |slot| {
            let corners = self.leaves.triangle(slot);
            let corners = corners.map(|p| p.to_array().map(f64::to_bits));
            (self.leaves.face(slot), corners)
        };
        self.slot == NONE || key(slot) < key(self.slot)
    }
}

/// Whether the ray starts beyond the plane of the triangle in a lane.
#[cold]
fn is_behind(leaf: Leaf, lane: u32, ray: &Ray) -> bool {
    let [a, b, c] = leaf.triangle(lane);
    let normal = cross(b - a, c - a);
    normal.dot(ray.direction) * normal.dot(ray.origin - a) >= 0.
}
