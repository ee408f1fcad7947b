// Tangled from chapters/bvh.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The interface of an intersector.

use glam::DVec3;

use super::triangle::NONE;
use crate::scene::Ray;

/// Where a ray meets the scene first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The point, in the coordinates of the scene, from where a path
    /// goes on: slightly off the surface, on the side of the normal.
    pub point: DVec3,
    /// The unit normal on the side from which the ray came.
    pub normal: DVec3,
    /// The triangle, by the intersector's own number, its slot in the leaves;
    /// [`Bvh::face`](crate::bvh::Bvh::face) gives its face.
    pub primitive: u32,
}

/// Finds hits in one scene.
pub trait Intersector: Sync + Sized {
    /// The first hit of `ray` on a triangle other than `from`, which it
    /// leaves.
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit>;

    /// The first hits of rays that leave no triangle, place by place: the same
    /// as with `first_hit`, and perhaps faster. Any of the rays may be missing.
    fn first_hits(&self, rays: &Batch<Ray>) -> Batch<Hit> {
        let hit = |ray| self.first_hit(ray, None);
        rays.each_ref().map(|ray| ray.as_ref().and_then(hit))
    }

    /// Where a ray that meets no triangle meets the ground, if there is one.
    fn below(&self, _: &Ray) -> Option<Hit> {
        None
    }

    /// Whether `ray` meets any triangle other than `from`: the same as
    /// `first_hit(ray, from).is_some()`, and perhaps faster.
    fn is_occluded(&self, ray: &Ray, from: Option<u32>) -> bool {
        !self.is_visible(ray, from, NONE)
    }

    /// Whether `ray` meets the triangle `target` first, or nothing if that is
    /// `NONE`: the same as by `first_hit(ray, from)`, and perhaps faster.
    fn is_visible(
        &self,
        ray: &Ray,
        from: Option<u32>,
        target: u32,
    ) -> bool {
        let hit = self.first_hit(ray, from);
        hit.map_or(NONE, |hit| hit.primitive) == target
    }

    /// The triangle other than `from` that `ray` meets first, or the ground: the
    /// same as that of `first_hit(ray, from)`, and perhaps found faster.
    fn first_primitive(&self, ray: &Ray, from: Option<u32>) -> Option<u32> {
        Some(self.first_hit(ray, from)?.primitive)
    }

    /// Does `work` with the intersector that answers fastest for this one.
    fn dispatch<W: Dispatch>(&self, work: W) -> W::Output {
        work.with(self)
    }
}

/// The number of rays in a batch.
pub const BEAM: usize = 16;

/// A batch of rays or hits, some of which may be missing.
pub type Batch<T> = [Option<T>; BEAM];

/// Work that can be done with any intersector.
pub trait Dispatch {
    /// The result.
    type Output;

    /// Does the work.
    fn with<K: Intersector>(self, intersector: &K) -> Self::Output;
}
