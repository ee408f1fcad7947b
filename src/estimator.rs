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

use crate::hierarchy::Kernel;
use crate::sampling::cosine_direction;
use crate::scene::Ray;
use crate::sky::Sky;

// Say what an estimator gives
/// One realisation: a weight, and what it cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Realisation {
    /// A realisation of the radiance.
    pub weight: f64,
    /// How many rays were traced for it.
    pub rays: u64,
}

/// A random variable whose mean is the radiance along a ray.
pub trait Estimator: Sync {
    /// The realisation that `random` stands for. The ray is none when
    /// it meets no box of the scene; `direction` is known in any case.
    fn realise<K: Kernel>(
        &self,
        kernel: &K,
        ray: Option<Ray>,
        direction: DVec3,
        random: &mut impl Rng,
    ) -> Realisation;
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
const MANY_BOUNCES: u32 = 1000;

impl Estimator for Reference {
    // Follow one path to its end
    fn realise<K: Kernel>(
        &self,
        kernel: &K,
        ray: Option<Ray>,
        mut direction: DVec3,
        random: &mut impl Rng,
    ) -> Realisation {
        let (mut transmissivity, mut bounces, mut rays) = (1., 0, 0);
        let (mut next, mut from) = (ray, None);
        while let Some(ray) = next {
            rays += 1;
            let Some(hit) = kernel.first_hit(&ray, from) else { break };
            // Weaken or end the path
            if transmissivity < FAINT {
                if random.random::<f64>() >= self.reflectivity {
                    return Realisation { weight: 0., rays };
                }
            } else {
                transmissivity *= self.reflectivity;
                if bounces > MANY_BOUNCES {
                    if random.random::<f64>() < 0.5 {
                        return Realisation { weight: 0., rays };
                    }
                    transmissivity *= 2.;
                }
            }
            bounces += 1;
            // Leave the surface in a random direction
            let (r, turn) = (random.random(), random.random());
            direction = cosine_direction(hit.normal, r, turn);
            next = Some(Ray { origin: hit.point, direction });
            from = Some(hit.primitive);
        }
        let weight = transmissivity * self.sky.radiance(direction);
        Realisation { weight, rays }
    }
}
