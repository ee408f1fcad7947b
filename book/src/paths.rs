// The rays of real paths, for the examples that trace them again.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use litpt::bvh::Intersector;
use litpt::camera::Camera;
use litpt::integrator::{Integrator, PathEvent, PathTracer};
use litpt::sampler::{IndependentSampler, Sampler};
use litpt::scene::{Entrance, Ray};

/// At least `count` rays of paths through random points of the image, path by
/// path, each with the triangle from which it starts.
pub fn record<K: Intersector>(
    entrance: &Entrance,
    intersector: &K,
    camera: &Camera,
    integrator: &PathTracer<'_>,
    seed: u64,
    count: usize,
) -> Result<Vec<(Ray, Option<u32>)>, &'static str> {
    let mut rays = Vec::with_capacity(count);
    for n in 0.. {
        let mut sampler = IndependentSampler::new(seed).start(0, n);
        let [x, y] = sampler.get_2d(0);
        let direction = camera.direction(x, y);
        let mut path = integrator.begin(direction, 1.);
        let mut next = entrance.enter(direction);
        let mut from = None;
        while let Some(ray) = next {
            rays.push((ray, from));
            let hit = intersector.first_hit(&ray, from);
            from = hit.map(|hit| hit.primitive);
            next = match integrator.advance(&mut path, hit, &mut sampler) {
                PathEvent::Scatter(ray, _) => Some(ray),
                PathEvent::Terminate(_) => None,
            };
        }
        if rays.len() >= count {
            break;
        }
        if n > 1_000_000 && rays.is_empty() {
            return Err("no ray meets the scene");
        }
    }
    Ok(rays)
}
