// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Random variables whose mean is the radiance along a ray.

// Name what the estimator imports
use glam::DVec3;
use rand::{Rng, RngExt};

use crate::bvh::{Hit, Intersector};
use crate::sampler::{cosine_direction, happens};
use crate::scene::Ray;
use crate::sky::Sky;

// Say what an estimator gives
/// What a path does at the end of a ray.
#[derive(Clone, Copy, Debug)]
pub enum Step {
    /// It goes on along another ray, which leaves this triangle.
    On(Ray, u32),
    /// It ends, and this is its sample of the radiance.
    End(f64),
}

/// A random variable whose mean is the radiance along a ray.
pub trait Integrator: Sync {
    /// What a path remembers from one hit to the next.
    type Path;

    /// What it needs to know of the end of a ray.
    type RayQuery: RayQuery;

    /// A path whose first ray has this direction.
    fn begin(&self, direction: DVec3) -> Self::Path;

    /// Takes a path on from the end of its ray: a hit, or the sky.
    fn go_on(
        &self,
        path: &mut Self::Path,
        hit: Option<Self::RayQuery>,
        random: &mut impl Rng,
    ) -> Step;
}

/// A borrowed estimator is one.
impl<E: Integrator> Integrator for &E {
    type Path = E::Path;
    type RayQuery = E::RayQuery;

    #[inline(always)]
    fn begin(&self, direction: DVec3) -> Self::Path {
        (**self).begin(direction)
    }

    #[inline(always)]
    fn go_on(
        &self,
        path: &mut Self::Path,
        hit: Option<Self::RayQuery>,
        random: &mut impl Rng,
    ) -> Step {
        (**self).go_on(path, hit, random)
    }
}

/// What there is to know of the end of a ray that has met something.
pub trait RayQuery: Sized {
    /// Asks an intersector about a ray that leaves the triangle `from`.
    fn ask<K: Intersector>(
        intersector: &K,
        ray: &Ray,
        from: Option<u32>,
    ) -> Option<Self>;
}

impl RayQuery for Hit {
    #[inline(always)]
    fn ask<K: Intersector>(
        intersector: &K,
        ray: &Ray,
        from: Option<u32>,
    ) -> Option<Self> {
        intersector.first_hit(ray, from)
    }
}

// Hold the parameters of the reference
/// The estimator of the chapter's algorithm: a path ends by chance below
/// the throughput `FAINT`, and from `MANY_BOUNCES` bounces on.
#[derive(Clone, Copy, Debug)]
pub struct PathTracer {
    /// Albedo of every surface, in [0, 1].
    pub albedo: f64,
    /// The only light.
    pub sky: Sky,
}

const FAINT: f64 = 0.1;
const MANY_BOUNCES: u64 = 1000;

/// A path of the reference.
#[derive(Clone, Copy, Debug)]
pub struct PathState {
    throughput: f64,
    /// How many there were.
    count: u64,
    /// Where its ray goes.
    direction: DVec3,
}

/// The probability that a path of `n` bounces makes another one,
/// [n/(n+1)]^(3/2). That one of `MANY_BOUNCES` makes n or more is then
/// (`MANY_BOUNCES`/n)^(3/2).
#[cold]
#[inline(never)]
fn onward(n: u64) -> f64 {
    let ratio = n as f64 / (n + 1) as f64;
    ratio * ratio.sqrt()
}

/// The radiance of a scene that reflects nothing: that of the sky.
#[derive(Clone, Copy, Debug)]
pub struct DirectSky {
    /// The only light.
    pub sky: Sky,
}

/// A ray is blocked, it does not matter by what.
pub struct Occluded;

impl RayQuery for Occluded {
    #[inline(always)]
    fn ask<K: Intersector>(
        intersector: &K,
        ray: &Ray,
        from: Option<u32>,
    ) -> Option<Self> {
        intersector.is_occluded(ray, from).then_some(Self)
    }
}

impl Integrator for DirectSky {
    // End a path at its first surface
    type Path = DVec3;
    type RayQuery = Occluded;

    #[inline(always)]
    fn begin(&self, direction: DVec3) -> DVec3 {
        direction
    }

    #[inline(always)]
    fn go_on(
        &self,
        direction: &mut DVec3,
        blocked: Option<Occluded>,
        _: &mut impl Rng,
    ) -> Step {
        Step::End(match blocked {
            Some(Occluded) => 0.,
            None => self.sky.radiance(*direction),
        })
    }
}

impl Integrator for PathTracer {
    // Follow a path from hit to hit
    type Path = PathState;
    type RayQuery = Hit;

    #[inline(always)]
    fn begin(&self, direction: DVec3) -> PathState {
        PathState { throughput: 1., count: 0, direction }
    }

    #[inline(always)]
    fn go_on(
        &self,
        path: &mut PathState,
        hit: Option<Hit>,
        random: &mut impl Rng,
    ) -> Step {
        let Some(hit) = hit else {
            let light = self.sky.radiance(path.direction);
            return Step::End(path.throughput * light);
        };
        // Weaken or end the path
        if path.throughput < FAINT {
            if !happens(self.albedo, random) {
                return Step::End(0.);
            }
        } else {
            path.throughput *= self.albedo;
            if path.count >= MANY_BOUNCES {
                // End a long path or make it heavier
                let probability = onward(path.count);
                if !happens(probability, random) {
                    return Step::End(0.);
                }
                path.throughput /= probability;
            }
        }
        path.count += 1;
        // Leave the surface in a random direction
        let (r, turn) = (random.random(), random.random());
        path.direction = cosine_direction(hit.normal, r, turn);
        let ray = Ray { origin: hit.point, direction: path.direction };
        Step::On(ray, hit.primitive)
    }
}
