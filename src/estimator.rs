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

use crate::hierarchy::Hit;
use crate::sampling::{cosine_direction, happens};
use crate::scene::Ray;
use crate::sky::Sky;

// Say what an estimator gives
/// What a path does at the end of a ray.
#[derive(Clone, Copy, Debug)]
pub enum Step {
    /// It goes on along another ray.
    On(Ray),
    /// It ends, and this is its realisation of the radiance.
    End(f64),
}

/// A random variable whose mean is the radiance along a ray.
pub trait Estimator: Sync {
    /// What a path remembers from one hit to the next.
    type Path;

    /// A path whose first ray has this direction.
    fn begin(&self, direction: DVec3) -> Self::Path;

    /// Takes a path on from the end of its ray: a hit, or the sky.
    fn go_on(
        &self,
        path: &mut Self::Path,
        hit: Option<Hit>,
        random: &mut impl Rng,
    ) -> Step;
}

// Hold the parameters of the reference
/// The estimator of the book's chapter, with analogue reflection below
/// the transmissivity `FAINT`.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    /// Reflectivity of every surface, in [0, 1].
    pub reflectivity: f64,
    /// The only light.
    pub sky: Sky,
}

const FAINT: f64 = 0.1;
const MANY_BOUNCES: u64 = 1000;

/// A path of the reference.
#[derive(Clone, Copy, Debug)]
pub struct Bounces {
    transmissivity: f64,
    /// How many there were.
    count: u64,
    /// Where its ray goes.
    direction: DVec3,
}

/// The probability that a path of `n` bounces makes another one,
/// [n/(n+1)]^(3/2): that it makes n in all is (`MANY_BOUNCES`/n)^(3/2).
#[cold]
#[inline(never)]
fn onward(n: u64) -> f64 {
    let ratio = n as f64 / (n + 1) as f64;
    ratio * ratio.sqrt()
}

impl Estimator for Reference {
    // Follow a path from hit to hit
    type Path = Bounces;

    #[inline(always)]
    fn begin(&self, direction: DVec3) -> Bounces {
        Bounces { transmissivity: 1., count: 0, direction }
    }

    #[inline(always)]
    fn go_on(
        &self,
        path: &mut Bounces,
        hit: Option<Hit>,
        random: &mut impl Rng,
    ) -> Step {
        let Some(hit) = hit else {
            let light = self.sky.radiance(path.direction);
            return Step::End(path.transmissivity * light);
        };
        // Weaken or end the path
        if path.transmissivity < FAINT {
            if !happens(self.reflectivity, random) {
                return Step::End(0.);
            }
        } else {
            path.transmissivity *= self.reflectivity;
            if path.count >= MANY_BOUNCES {
                // End a long path or make it heavier
                let probability = onward(path.count);
                if !happens(probability, random) {
                    return Step::End(0.);
                }
                path.transmissivity /= probability;
            }
        }
        path.count += 1;
        // Leave the surface in a random direction
        let (r, turn) = (random.random(), random.random());
        path.direction = cosine_direction(hit.normal, r, turn);
        Step::On(Ray { origin: hit.point, direction: path.direction })
    }
}
