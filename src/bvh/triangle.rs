// Tangled from chapters/bvh.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Does a ray meet a triangle?
//!
//! The answers depend on the ray and the triangle alone, and are the
//! same on every processor.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::array;

use glam::DVec3;

use crate::numerics::difference_of_products;
use crate::scene::{Ray, Triangle};

/// A change of coordinates that makes a ray the z axis (Woop, Benthin
/// and Wald 2013, section 3).
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

/// Lengths that are small compared with those they are computed from.
#[derive(Clone, Copy, Debug)]
pub struct Margins {
    /// The size of the triangles for a ray.
    pub size: f64,
    /// The order of distances along a ray that are closer is in doubt.
    pub near: f64,
    /// An edge function of this or more, with the wrong sign, does not
    /// belong to a triangle that the ray passes closely.
    pub narrow: f64,
}

/// The size of triangles up to `span` away from a point.
#[inline(always)]
pub fn size(span: f64, point: DVec3) -> f64 {
    (1. + PLACE) * span + PLACE * point.abs().max_element()
}

/// The size of a triangle for rays from or to a point.
#[inline(always)]
pub fn seen(corners: &Triangle, point: DVec3) -> f64 {
    let [a, b, c] = corners.map(|corner| (corner - point).abs());
    size(a.max(b).max(c).max_element(), point)
}

/// The part of a point's coordinates that enters a size.
const PLACE: f64 = 0.125;

/// The order of distances along a ray that are closer is in doubt: 2^-35.
#[inline(always)]
pub fn near(size: f64) -> f64 {
    size * (1. / (1u64 << 35) as f64)
}

/// How far off its surface a hit is put, and at least how far from other
/// triangles, by our computation: 2^-47.
#[inline(always)]
pub fn clear(size: f64) -> f64 {
    size * (1. / (1u64 << 47) as f64)
}

/// How large an edge function with the wrong sign may be of a triangle
/// with such a side, sheared, within 2^-45 of the size of the ray.
#[inline(always)]
pub fn narrow(size: f64, side: f64) -> f64 {
    let part = size * (1. / (1u64 << 43) as f64);
    part * (side + 0.25 * part)
}

impl Margins {
    /// The margins of triangles of a size in a box with sides up to `side`.
    #[inline(always)]
    pub fn new(size: f64, side: f64) -> Self {
        let narrow = 2. * narrow(size, 2. * side);
        Self { size, near: near(size), narrow }
    }
}

/// A box that holds some triangles of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// Its middle, from where planes are counted.
    pub zero: DVec3,
    /// Half of its longest side.
    pub reach: f64,
    /// The margins of rays that start within.
    pub within: Margins,
}

impl Region {
    /// The region between two opposite corners.
    pub fn between(low: DVec3, high: DVec3) -> Self {
        let reach = 0.5 * (high - low).max_element();
        let zero = 0.5 * (low + high);
        let size = size(2. * reach, zero.abs() + reach);
        let within = Margins::new(size, 2. * reach);
        Self { zero, reach, within }
    }

    /// The ray from where it enters a cube slightly larger than the region;
    /// none if it misses the cube.
    pub fn enter(&self, ray: &Ray) -> Option<Ray> {
        let reach = self.reach + 1.;
        if self.beyond(ray.origin) <= 1. {
            return Some(*ray);
        }
        let (mut start, mut end) = (0f64, f64::INFINITY);
        for axis in 0..3 {
            let slope = ray.direction[axis];
            let place = self.zero[axis] - ray.origin[axis];
            let sides = [-reach, reach].map(|r| (place + r) / slope);
            if slope != 0. {
                start = start.max(sides[0].min(sides[1]));
                end = end.min(sides[0].max(sides[1]));
            } else if place.abs() > reach {
                return None;
            }
        }
        let origin = ray.origin + ray.direction * start;
        (start <= end).then_some(Ray { origin, ..*ray })
    }

    /// How far a point is outside, at most; negative inside.
    #[inline(always)]
    pub fn beyond(&self, point: DVec3) -> f64 {
        (point - self.zero).abs().max_element() - self.reach
    }

    /// The margins of rays from a point to triangles of the region.
    #[inline(always)]
    pub fn margins(&self, point: DVec3) -> Margins {
        let (beyond, side) = (self.beyond(point), 2. * self.reach);
        if beyond <= 0. {
            return self.within;
        }
        Margins::new(size(beyond + side, point), side)
    }

    /// The same in a nested frame, given the size of the outermost margins.
    #[inline(always)]
    pub fn nested_margins(&self, point: DVec3, root: f64) -> Margins {
        let size = COARSER * self.margins(point).size;
        Margins::new(size.min(root), 2. * self.reach)
    }
}

/// How many times as large margins are in nested frames, at most: 2^20.
const COARSER: f64 = (1 << 20) as f64;

/// The most triangles of a leaf.
pub const LANES: usize = 4;

/// No triangle.
pub const NONE: u32 = u32::MAX;

/// Words of the unit in which leaves are counted.
pub const UNIT: usize = 4;

/// Words of a triangle: nine coordinates and the face.
const WORDS: usize = 19;

/// Marks the number of a child as that of a leaf.
pub const LEAF: u32 = 1 << 31;

/// Leaves from this number on are nested frames.
pub const FRAMES: u32 = (1 << 29) - (1 << 20);

/// The units that leaves of `count` triangles take.
pub fn units(count: usize) -> u32 {
    (WORDS * count).max(17 * count + 2 * LANES).div_ceil(UNIT) as u32
}

/// The child that is a leaf of `count` triangles at unit `first`.
pub fn leaf(first: u32, count: usize) -> u32 {
    LEAF | (count as u32 - 1) << 29 | first
}

/// The first unit and the count of a child that is a leaf.
#[inline(always)]
pub fn slots(child: u32) -> (u32, usize) {
    (child & ((1 << 29) - 1), (child >> 29 & 3) as usize + 1)
}

/// The slot of the triangle in a lane of the leaf at unit `first`.
#[inline(always)]
pub fn slot(first: u32, lane: u32) -> u32 {
    first << 2 | lane
}

/// All leaves of a hierarchy, one after the other.
pub struct Leaves {
    /// Each as in `Leaf`, at a multiple of `UNIT`.
    pub words: Vec<u32>,
}

impl Leaves {
    /// The leaf of `count` triangles at unit `first`.
    ///
    /// # Safety
    /// A leaf of these triangles has been put there.
    #[inline(always)]
    pub unsafe fn leaf(&self, first: u32, count: usize) -> Leaf<'_> {
        // SAFETY: the caller promises that the leaf is within the array.
        let words =
            unsafe { self.words.get_unchecked(UNIT * first as usize..) };
        Leaf { words, count, lanes: (1 << count) - 1 }
    }

    /// The leaf of a triangle, and its lane.
    #[inline(always)]
    pub fn find(&self, slot: u32) -> (Leaf<'_>, u32) {
        let words = &self.words[UNIT * (slot >> 2) as usize..];
        let count = (words[0] >> 30) as usize + 1;
        (Leaf { words, count, lanes: 0 }, slot & 3)
    }

    /// The corners of the triangle in a slot.
    #[inline(always)]
    pub fn triangle(&self, slot: u32) -> Triangle {
        let (leaf, lane) = self.find(slot);
        leaf.triangle(lane)
    }

    /// The face of the triangle in a slot.
    pub fn face(&self, slot: u32) -> u32 {
        let (leaf, lane) = self.find(slot);
        leaf.words[lane as usize] & !(3 << 30)
    }
}

/// Writes the leaf of these triangles, each with its face, below 2^30.
pub fn write(words: &mut [u32], triangles: &[(u32, Triangle)]) {
    let count = triangles.len();
    for (lane, &(face, triangle)) in triangles.iter().enumerate() {
        let corners = triangle.map(|p| p.to_array());
        for (i, x) in corners.as_flattened().iter().enumerate() {
            let place = count + 2 * (i * count + lane);
            words[place] = x.to_bits() as u32;
            words[place + 1] = (x.to_bits() >> 32) as u32;
        }
        words[lane] = face;
    }
    words[0] |= (count as u32 - 1) << 30;
}

/// The frame of a cluster that is so small compared with its region that
/// padding would swallow it: inside, boxes count from the cluster's middle.
/// Or the way back to the outer frame.
#[derive(Clone, Copy, Debug)]
pub struct NestedFrame {
    /// The region around its triangles, or the outer one.
    pub region: Region,
    /// The child with which the search goes on there; none if it goes back.
    pub node: Option<u32>,
}

/// Up to four triangles.
#[derive(Clone, Copy)]
pub struct Leaf<'a> {
    /// A face for each lane, the first with the count in two more bits;
    /// then coordinate `axis` of corner `c` of a lane, in double precision,
    /// at `2 * ((3 * c + axis) * count + lane)`.
    pub words: &'a [u32],
    /// How many triangles.
    pub count: usize,
    /// Those to be tested; bit i stands for lane i.
    pub lanes: u32,
}

/// A corner of the first of `count` lanes, that begins in this run.
#[inline(always)]
fn corner(runs: &[u32], count: usize, run: usize) -> DVec3 {
    let [x, y, z] = [run, run + 1, run + 2].map(|run| 2 * run * count);
    let number = |place: usize| {
        f64::from_bits(
            u64::from(runs[place + 1]) << 32 | u64::from(runs[place]),
        )
    };
    DVec3::new(number(x), number(y), number(z))
}

impl Leaf<'_> {
    /// Coordinate `axis` of the corners `c` of `N` lanes from `lane` on.
    #[inline(always)]
    fn coordinate<const N: usize>(
        &self,
        (c, axis, lane): (usize, usize, usize),
    ) -> [f64; N] {
        let place = 2 * ((3 * c + axis) * self.count + lane) + self.count;
        let run = &self.words[place..place + 2 * N];
        array::from_fn(|i| {
            let [low, high] = [run[2 * i], run[2 * i + 1]].map(u64::from);
            f64::from_bits(high << 32 | low)
        })
    }

    /// The corners of the triangle in a lane.
    #[inline(always)]
    pub fn triangle(&self, lane: u32) -> Triangle {
        let count = self.count;
        let runs = &self.words[count + 2 * lane as usize..];
        let runs = &runs[..16 * count + 2];
        [
            corner(runs, count, 0),
            corner(runs, count, 3),
            corner(runs, count, 6),
        ]
    }

    /// The lanes that a ray meets, as a mask, with the distances; lanes that
    /// it passes closely from bit `LANES` on, with the least distance of a
    /// corner. The distance of any other lane is not specified.
    #[inline(always)]
    pub fn intersect(
        &self,
        shear: &Shear,
        margins: &Margins,
    ) -> (u32, [f64; LANES]) {
        let mut distances = [0.; LANES];
        let mut met = 0;
        for (lane, distance) in distances.iter_mut().enumerate() {
            if self.lanes >> lane & 1 != 0 {
                // Record the result for this triangle
                match self.test(lane, shear, margins.size) {
                    TriangleTest::Through(at) if at > -margins.near => {
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

    /// Tests the triangle in a lane.
    #[inline(always)]
    pub fn test(
        &self,
        lane: usize,
        shear: &Shear,
        size: f64,
    ) -> TriangleTest {
        let sheared = self.sheared::<1>(lane, shear);
        let [u, v, w] = edges(&sheared).map(|[edge]| edge);
        let [x, y, z] = sheared.map(|corners| corners.map(|[p]| p));
        let within = |margin: f64| {
            (u >= -margin && v >= -margin && w >= -margin)
                || (u <= margin && v <= margin && w <= margin)
        };
        if within(0.) {
            // Find the distance along the ray
            let height = (u * z[0] + v * z[1] + w * z[2]) / (u + v + w);
            TriangleTest::Through(height * shear.stretch)
        } else if within(narrow(size, extent(x).max(extent(y)))) {
            TriangleTest::Beside(z.map(|z| z * shear.stretch))
        } else {
            TriangleTest::Apart
        }
    }

    /// The corners after the shear, of `N` lanes from `lane` on.
    #[inline(always)]
    pub fn sheared<const N: usize>(
        &self,
        lane: usize,
        shear: &Shear,
    ) -> Sheared<N> {
        let moved = |c: usize, i: usize| {
            let lanes = self.coordinate::<N>((c, shear.axes[i], lane));
            lanes.map(|p| p - shear.origin[i])
        };
        let z = [moved(0, 2), moved(1, 2), moved(2, 2)];
        let flat = |c: usize, i: usize| {
            let p = moved(c, i);
            array::from_fn(|k| p[k] - shear.slope[i] * z[c][k])
        };
        let x = [flat(0, 0), flat(1, 0), flat(2, 0)];
        let y = [flat(0, 1), flat(1, 1), flat(2, 1)];
        [x, y, z]
    }
}

/// The length of the least interval that holds three numbers.
#[inline(always)]
fn extent([a, b, c]: [f64; 3]) -> f64 {
    a.max(b).max(c) - a.min(b).min(c)
}

/// The result of testing a ray with a triangle.
pub enum TriangleTest {
    /// The line of the ray goes through the triangle, at this distance:
    /// negative behind the origin, and not a number if it is seen edge on.
    Through(f64),
    /// The ray passes so closely that a small displacement could make it go
    /// through; the distances of the corners along the ray.
    Beside([f64; 3]),
    /// Neither.
    Apart,
}

/// The x, y and z of three corners, in each of `N` lanes.
type Sheared<const N: usize> = [[[f64; N]; 3]; 3];

/// The edge functions u, v and w.
#[inline(always)]
pub fn edges<const N: usize>([x, y, _]: &Sheared<N>) -> [[f64; N]; 3] {
    let edge = |i: usize, j: usize| {
        array::from_fn(|k| {
            difference_of_products(x[i][k], y[j][k], y[i][k], x[j][k])
        })
    };
    [edge(2, 1), edge(0, 2), edge(1, 0)]
}
