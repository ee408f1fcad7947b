// Tangled from chapters/bvh.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The nearest of the triangles that a ray meets.
//!
//! It depends on the ray and the triangles alone: where distances do not
//! decide, faces and corners do.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::{DVec3, Vec3Swizzles};

use super::triangle::{LANES, Leaf, Leaves, Margins, NONE, Region};
use super::triangle::{near, seen, slot};
use crate::numerics::cross;
use crate::scene::Ray;

/// The nearest triangle so far.
pub struct Search<'a> {
    /// The leaves of the hierarchy.
    pub leaves: &'a Leaves,
    /// The slot that the ray left, or `NONE`,
    left: u32,
    /// and one that was offered ahead, or `NONE`: leaves are tested without
    /// both.
    offered: u32,
    /// How far the nearest triangle is, or infinity.
    pub distance: f64,
    /// The size of the margins where it was found.
    pub size: f64,
    /// The size of the margins of the region of all triangles.
    pub root: f64,
    /// The size of the least margins of nested frames that the ray entered,
    pub least: f64,
    /// and the box around the regions there.
    pub passed: [DVec3; 2],
    /// The slot of the nearest triangle, or `NONE`.
    pub slot: u32,
    /// The least distance at which something else is close to the ray.
    pub near_tie: f64,
}

impl<'a> Search<'a> {
    /// A search that has met nothing, for a ray that left the first slot;
    /// the second is offered ahead. The size is that of the outermost
    /// margins.
    #[inline(always)]
    pub fn new(
        leaves: &'a Leaves,
        (from, offered): (Option<u32>, u32),
        root: f64,
    ) -> Self {
        let distance = f64::INFINITY;
        Self {
            leaves,
            left: from.unwrap_or(NONE),
            offered,
            distance,
            size: 0.,
            root,
            least: root,
            passed: [DVec3::INFINITY, DVec3::NEG_INFINITY],
            slot: NONE,
            near_tie: distance,
        }
    }

    /// The leaf of `count` triangles at unit `first`, without the one
    /// that the ray left, and the one that was offered ahead.
    ///
    /// # Safety
    /// A leaf of these triangles has been put there.
    #[inline(always)]
    pub unsafe fn leaf(&self, first: u32, count: usize) -> Leaf<'a> {
        // SAFETY: the caller promises that it is there.
        let mut leaf = unsafe { self.leaves.leaf(first, count) };
        for without in [self.left, self.offered] {
            let lane = without.wrapping_sub(slot(first, 0));
            leaf.lanes &= !(u32::from(lane < LANES as u32) << (lane & 3));
        }
        leaf
    }

    /// The distance up to which others may be as near as the nearest so far.
    #[inline(always)]
    pub fn limit(&self, margins: &Margins) -> f64 {
        self.distance + margins.near
    }

    /// Considers the triangle in a slot, which is met at `distance`; none if
    /// it is doubtful whether that is behind the ray, or which comes first.
    #[inline(always)]
    pub fn take(
        &mut self,
        slot: u32,
        distance: f64,
        margins: &Margins,
    ) -> Option<()> {
        let near = margins.near;
        if distance <= near || distance == self.distance {
            return None;
        }
        if (distance - self.distance).abs() <= near {
            self.near_tie = self.near_tie.min(distance - near);
        }
        if distance < self.distance {
            (self.distance, self.slot) = (distance, slot);
            self.size = margins.size;
        }
        Some(())
    }

    /// Considers the triangle in a lane of the leaf at unit `first`, which
    /// is met at `distance`; a lane of `LANES` or more belongs to a
    /// triangle that is only passed closely.
    #[inline(always)]
    pub fn offer(
        &mut self,
        (first, leaf): (u32, Leaf),
        lane: u32,
        distance: f64,
        (ray, margins): (&Ray, &Margins),
    ) {
        let (slot, beside) = (slot(first, lane), lane >= LANES as u32);
        if !beside && self.take(slot, distance, margins).is_some() {
            return;
        }
        // Doubt the order of triangles that are close
        let near = margins.near;
        self.near_tie = self.near_tie.min(distance - near);
        let behind = || is_behind(leaf, lane, ray, distance);
        if beside || distance <= near && behind() {
            return;
        }
        let distance = distance.max(f64::MIN_POSITIVE);
        let equal = distance == self.distance;
        if distance < self.distance
            || equal && is_before(self.leaves, slot, self.slot)
        {
            (self.distance, self.slot) = (distance, slot);
            self.size = margins.size;
        }
    }

    /// Whether the ray may come near triangles of a region, before the
    /// nearest so far.
    #[inline(always)]
    pub fn enters(&self, region: &Region, ray: &Ray) -> bool {
        let middle = region.zero - ray.origin;
        let half = region.reach + CLEARANCE * self.root;
        let (along, near) = (middle.dot(ray.direction), near(self.root));
        is_met(middle, DVec3::splat(half), ray.direction)
            && along - DIAGONAL * half <= self.distance + near
            && along + DIAGONAL * half >= -near
    }

    /// Records that the ray enters a nested frame.
    #[inline(always)]
    pub fn pass(&mut self, region: &Region, margins: &Margins) {
        let [low, high] = self.passed;
        let (zero, reach) = (region.zero, region.reach);
        self.passed = [low.min(zero - reach), high.max(zero + reach)];
        self.least = self.least.min(margins.size);
    }
}

/// Whether the triangle in `slot` comes before another, if there is one.
#[cold]
#[inline(never)]
fn is_before(leaves: &Leaves, slot: u32, other: u32) -> bool {
    let key = |slot| {
        let corners = leaves.triangle(slot);
        let corners = corners.map(|p| p.to_array().map(f64::to_bits));
        (leaves.face(slot), corners)
    };
    other == NONE || key(slot) < key(other)
}

/// Whether a ray that meets the triangle in a lane at this distance starts
/// beyond it.
#[cold]
fn is_behind(leaf: Leaf, lane: u32, ray: &Ray, distance: f64) -> bool {
    let corners = leaf.triangle(lane);
    if distance.abs() >= near(seen(&corners, ray.origin)) {
        return distance < 0.;
    }
    let [a, b, c] = corners;
    let normal = cross(b - a, c - a);
    normal.dot(ray.direction) * normal.dot(ray.origin - a) >= 0.
}

/// A ray this far from a region, times the size, passes no triangle of
/// it closely: 2^-44.
const CLEARANCE: f64 = 1. / (1u64 << 44) as f64;

/// More than half the diagonal of a cube whose side is 2.
const DIAGONAL: f64 = 1.75;

/// Whether a line through zero meets a box with this middle and these
/// half sides.
#[inline(always)]
pub fn is_met(middle: DVec3, half: DVec3, direction: DVec3) -> bool {
    let off = middle.cross(direction).abs();
    let [h, d] = [half, direction.abs()];
    off.cmple(h.yzx() * d.zxy() + h.zxy() * d.yzx()).all()
}
