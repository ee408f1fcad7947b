// Tangled from chapters/materials.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! An endless plane below the scene.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::DVec3;

use super::intersector::Hit;
use crate::scene::Ray;

/// The number of the ground in the place of a triangle's; larger numbers
/// are of no surface.
pub const GROUND: u32 = u32::MAX - 1;

/// A plane perpendicular to the zenith, below all triangles.
pub struct Ground {
    zenith: DVec3,
    /// Its height over the origin of the scene.
    height: f64,
}

/// The largest distance of a hit on the ground: 2^32.
const FARTHEST: f64 = (1u64 << 32) as f64;

/// How far the ground is below the lowest corner: 2^-16.
const BELOW: f64 = 1. / (1u64 << 16) as f64;

impl Ground {
    /// The ground under a scene with its lowest corner at this height, and
    /// with this unit vector to the zenith.
    pub fn under(lowest: f64, zenith: DVec3) -> Self {
        Self { zenith, height: lowest - BELOW }
    }

    /// Where a ray that meets no triangle meets the ground.
    pub fn hit(&self, ray: &Ray) -> Option<Hit> {
        let fall = -self.zenith.dot(ray.direction);
        let above = self.below(ray.origin).max(0.);
        let distance = (above / fall).min(FARTHEST);
        let point = ray.origin + ray.direction * distance;
        let hit = Hit { point, normal: self.zenith, primitive: GROUND };
        (fall > 0.).then_some(hit)
    }

    /// The height of a point above the ground.
    pub fn below(&self, point: DVec3) -> f64 {
        self.zenith.dot(point) - self.height
    }
}
