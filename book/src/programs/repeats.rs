// Traces the rays of real paths several times each, one after the other, and
// prints a CSV: the time that each trace takes from one row to the next. The
// more often, the better a processor foresees the branches.
// "make measure" records it for the chapter "The walk".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::hint::black_box;
use std::time::Instant;

use litpt::bvh::{Bvh, Dispatch, Intersector, Isa, Quality};
use litpt::camera::Camera;
use litpt::integrator::PathTracer;
use litpt::scene::{Ray, Scene, read_obj};
use litpt::sky::Sky;
use litpt_book::paths;

use super::Done;

const RAYS: usize = 20_000;
const ROUNDS: usize = 5;
const REPEATS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];

/// Rays, each with the triangle from which it starts.
pub type Rays = Vec<(Ray, Option<u32>)>;

/// All rays are to be traced, each some times.
struct Repeat<'a>(&'a Rays, usize);

impl Dispatch for Repeat<'_> {
    /// Seconds.
    type Output = f64;

    fn with<K: Intersector>(self, intersector: &K) -> f64 {
        let start = Instant::now();
        for (ray, from) in self.0 {
            for _ in 0..self.1 {
                black_box(intersector.first_hit(black_box(ray), *from));
            }
        }
        start.elapsed().as_secs_f64()
    }
}

/// The least seconds of some rounds, in which each ray is traced so often.
pub fn seconds(intersector: &Bvh, rays: &Rays, repeats: usize) -> f64 {
    (0..ROUNDS)
        .map(|_| intersector.dispatch(Repeat(rays, repeats)))
        .fold(f64::INFINITY, f64::min)
}

pub fn run(arguments: &[String]) -> Done {
    let path = arguments.first().ok_or("usage: repeats FILE.obj")?;
    let scene = Scene::new(&read_obj(&std::fs::read(path)?)?);
    let intersector = Bvh::with(&scene, Quality::Thorough, Isa::best())?;
    let view = litpt_book::courtyard::view();
    let camera = Camera::new(&view, 4. / 3.)?;
    let integrator = PathTracer { albedo: 0.8, sky: Sky::new(view.up) };
    let rays =
        paths::record(&scene, &intersector, &camera, &integrator, 0, RAYS)?;
    println!("repeats,nanoseconds_per_trace");
    let mut before = (0, 0.);
    for repeats in REPEATS {
        let seconds = seconds(&intersector, &rays, repeats);
        // What the traces since the last row have added, each.
        let more = rays.len() * (repeats - before.0);
        let nanoseconds = 1e9 * (seconds - before.1) / more as f64;
        println!("{repeats},{nanoseconds:.1}");
        before = (repeats, seconds);
    }
    Ok(())
}
