// Measures the builder's presets on a scene and prints a CSV: "make measure"
// records it for the chapter "The hierarchy".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::time::Instant;

use litpt::camera::Camera;
use litpt::estimator::Reference;
use litpt::hierarchy::Cwbvh;
use litpt::image::Image;
use litpt::render::Job;
use litpt::scene::{Scene, read_obj};
use litpt::sky::Sky;
use obvhs::BvhBuildParams;

const ROUNDS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: presets FILE.obj")?;
    let scene = Scene::new(&read_obj(&std::fs::read(path)?)?);
    let presets = [
        ("fastest", BvhBuildParams::fastest_build()),
        ("very fast", BvhBuildParams::very_fast_build()),
        ("fast", BvhBuildParams::fast_build()),
        ("medium", BvhBuildParams::medium_build()),
        ("slow", BvhBuildParams::slow_build()),
        ("very slow", BvhBuildParams::very_slow_build()),
    ];
    // Alternately, so that a busy moment of the machine falls on all alike.
    let mut measured = vec![(vec![], vec![]); presets.len()];
    for _ in 0..ROUNDS {
        for ((_, preset), (build, speed)) in
            presets.iter().zip(&mut measured)
        {
            let start = Instant::now();
            let kernel = Cwbvh::with_preset(&scene, *preset);
            build.push(start.elapsed().as_secs_f64());
            speed.push(rays_per_second(&scene, &kernel)?);
        }
    }
    println!("preset,build_seconds,million_rays_per_second");
    for ((name, _), (build, speed)) in presets.iter().zip(measured) {
        println!("{name},{:.3},{:.2}", median(build), median(speed) * 1e-6);
    }
    Ok(())
}

/// The view of the courtyard that the book shows.
fn rays_per_second(
    scene: &Scene,
    kernel: &Cwbvh,
) -> Result<f64, Box<dyn Error>> {
    let view = litpt::courtyard::view();
    let camera = Camera::new(&view, 4. / 3.)?;
    let estimator = Reference { reflectivity: 0.8, sky: Sky::new(view.up) };
    let job = Job {
        scene,
        kernel,
        camera: &camera,
        estimator: &estimator,
        seed: 0,
    };
    let mut image = Image::new(240, 180);
    let start = Instant::now();
    let rays = job.pass(&mut image, 0..8, &|_| ());
    Ok(rays as f64 / start.elapsed().as_secs_f64())
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}
