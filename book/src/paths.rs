// The rays of real paths, for the examples that trace them again.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use litpt::bvh::Intersector;
use litpt::camera::Camera;
use litpt::integrator::{Integrator, PathTracer, Step};
use litpt::sampler::generator;
use litpt::scene::{Ray, Scene};
use rand::RngExt;

/// At least `count` rays of paths through random points of the image, path by
/// path, each with the triangle from which it starts.
pub fn record<K: Intersector>(
    scene: &Scene,
    intersector: &K,
    camera: &Camera,
    integrator: &PathTracer,
    seed: u64,
    count: usize,
) -> Result<Vec<(Ray, Option<u32>)>, &'static str> {
    let mut rays = Vec::with_capacity(count);
    for n in 0.. {
        let mut random = generator(seed, 0, n);
        let direction = camera.direction(random.random(), random.random());
        let mut path = integrator.begin(direction);
        let mut next = scene.enter(camera.position, direction);
        let mut from = None;
        while let Some(ray) = next {
            rays.push((ray, from));
            let hit = intersector.first_hit(&ray, from);
            from = hit.map(|hit| hit.primitive);
            next = match integrator.go_on(&mut path, hit, &mut random) {
                Step::On(ray, _) => Some(ray),
                Step::End(_) => None,
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
