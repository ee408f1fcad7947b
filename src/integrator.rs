// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Random variables whose mean is the radiance along a ray.

use glam::DVec3;

use crate::bvh::{BEAM, Hit, Intersector};
use crate::sampler::{Sampler, cosine_direction, dimension, happens};
use crate::scene::Ray;
use crate::sky::Sky;

/// What a path does at the end of a ray.
#[derive(Clone, Copy, Debug)]
pub enum PathEvent {
    /// It goes on along another ray, which leaves this triangle.
    Scatter(Ray, u32),
    /// It ends, and this is its contribution to the pixel.
    Terminate(f64),
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
        sampler: &mut impl Sampler,
    ) -> PathEvent;
}

/// What there is to know of the end of a ray that has met something.
pub trait RayQuery: Sized {
    /// Asks an intersector about a ray that leaves the triangle `from`.
    fn ask<K: Intersector>(
        intersector: &K,
        ray: &Ray,
        from: Option<u32>,
    ) -> Option<Self>;

    /// Asks about rays that leave no triangle; any of them may be missing.
    fn ask_all<K: Intersector>(
        intersector: &K,
        rays: &[Option<Ray>; BEAM],
    ) -> [Option<Self>; BEAM] {
        let ask = |ray| Self::ask(intersector, ray, None);
        rays.each_ref().map(|ray| ray.as_ref().and_then(ask))
    }
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

    #[inline(always)]
    fn ask_all<K: Intersector>(
        intersector: &K,
        rays: &[Option<Ray>; BEAM],
    ) -> [Option<Self>; BEAM] {
        intersector.first_hits(rays)
    }
}

/// A borrowed integrator is one.
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
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        (**self).go_on(path, hit, sampler)
    }
}

/// The integrator of the chapter's algorithm: a path meets roulette below
/// the throughput `FAINT`, and from `MANY_BOUNCES` bounces on.
#[derive(Clone, Copy, Debug)]
pub struct PathTracer {
    /// Albedo of every surface, in [0, 1].
    pub albedo: f64,
    /// The only light.
    pub sky: Sky,
}

const FAINT: f64 = 0.1;
pub const MANY_BOUNCES: u64 = 1000;

/// A path of the path tracer.
#[derive(Clone, Copy, Debug)]
pub struct PathState {
    throughput: f64,
    /// How many bounces there were.
    count: u64,
    /// Where its ray goes.
    direction: DVec3,
}

/// The probability that a path of `n` bounces makes another one,
/// [n/(n+1)]^(3/2). That one of `MANY_BOUNCES` makes n or more is then
/// (`MANY_BOUNCES`/n)^(3/2).
#[cold]
#[inline(never)]
pub fn onward(n: u64) -> f64 {
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
        _: &mut impl Sampler,
    ) -> PathEvent {
        PathEvent::Terminate(match blocked {
            Some(Occluded) => 0.,
            None => self.sky.radiance(*direction),
        })
    }
}

/// The path tracer with the sky above its first reflection as a control
/// variate (Owen 2013, section 8.9).
#[derive(Clone, Copy, Debug)]
pub struct ControlledPathTracer {
    /// Whose paths they are.
    pub paths: PathTracer,
    /// How much of the sky is subtracted, in [0, 1].
    pub control: f64,
}

/// A path, and what the control variate adds to its contribution.
pub struct ControlledPath {
    path: PathState,
    control: f64,
}

impl PathTracer {
    /// What a surface reflects of the sky if nothing is in the way, less
    /// what it reflects from this direction: the mean is zero.
    #[inline(always)]
    pub fn control(&self, normal: DVec3, direction: DVec3) -> f64 {
        let Self { albedo, sky } = self;
        albedo * (sky.share(normal) - sky.radiance(direction))
    }
}

impl Integrator for ControlledPathTracer {
    type Path = ControlledPath;
    type RayQuery = Hit;

    #[inline(always)]
    fn begin(&self, direction: DVec3) -> ControlledPath {
        ControlledPath { path: self.paths.begin(direction), control: 0. }
    }

    #[inline(always)]
    fn go_on(
        &self,
        controlled: &mut ControlledPath,
        hit: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        let ControlledPath { path, control } = controlled;
        let first = hit.filter(|_| path.count == 0);
        let event = self.paths.go_on(path, hit, sampler);
        if let Some(hit) = first {
            let around = self.paths.control(hit.normal, path.direction);
            *control = self.control * around;
        }
        match event {
            PathEvent::Terminate(x) => PathEvent::Terminate(x + *control),
            PathEvent::Scatter(..) => event,
        }
    }
}

/// Changes whenever the code that decides what a sample is does.
const SAMPLE_VERSION: u32 = 4;

/// Names the integrators, their constants and the version of their
/// samples: samples of different names are not to be mixed.
pub fn identity() -> String {
    format!(
        "samples {SAMPLE_VERSION}, path tracer with \
         roulette below {FAINT} and from {MANY_BOUNCES} bounces"
    )
}

impl Integrator for PathTracer {
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
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        let Some(hit) = hit else {
            let light = self.sky.radiance(path.direction);
            return PathEvent::Terminate(path.throughput * light);
        };
        // Weaken the path or play roulette
        if path.throughput < FAINT {
            let u = sampler.get_1d(dimension::roulette(path.count));
            if !happens(self.albedo, u) {
                return PathEvent::Terminate(0.);
            }
        } else {
            path.throughput *= self.albedo;
            if path.count >= MANY_BOUNCES {
                // End a long path or strengthen it
                let probability = onward(path.count);
                let u = sampler.get_1d(dimension::roulette(path.count));
                if !happens(probability, u) {
                    return PathEvent::Terminate(0.);
                }
                path.throughput /= probability;
            }
        }
        // Leave the surface in a random direction
        let [r, turn] = sampler.get_2d(dimension::direction(path.count));
        path.count += 1;
        path.direction = cosine_direction(hit.normal, r, turn);
        let ray = Ray { origin: hit.point, direction: path.direction };
        PathEvent::Scatter(ray, hit.primitive)
    }
}
