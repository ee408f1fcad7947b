// Measures the builder's qualities and the sets of instructions on a scene and
// prints a CSV: "make measure" records it for the chapter "A wide hierarchy".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::time::Instant;

use litpt::analysis::background::KnownPixels;
use litpt::bvh::{Bvh, Isa, Quality};
use litpt::camera::Camera;
use litpt::film::Film;
use litpt::integrator::PathTracer;
use litpt::render::{Job, Renderer};
use litpt::sampler::IndependentSampler;
use litpt::scene::{Scene, read_obj};
use litpt::sky::Sky;

use super::{Done, median};

const ROUNDS: usize = 5;

pub fn run(arguments: &[String]) -> Done {
    let path = arguments.first().ok_or("usage: qualities FILE.obj")?;
    let scene = Scene::new(&read_obj(&std::fs::read(path)?)?);
    let qualities = [Quality::Fast, Quality::Medium, Quality::Thorough];
    let mut ways: Vec<_> = qualities.map(|q| (q, Isa::best())).into();
    let others = Isa::ALL.into_iter().filter(|isa| isa.is_available());
    let others = others.filter(|isa| *isa != Isa::best());
    ways.extend(others.map(|isa| (Quality::Thorough, isa)));
    // Alternately, so that a busy moment of the machine falls on all alike.
    let mut measured = vec![(vec![], vec![]); ways.len()];
    for _ in 0..ROUNDS {
        for (&(quality, isa), (build, speed)) in
            ways.iter().zip(&mut measured)
        {
            let start = Instant::now();
            let intersector = Bvh::with(&scene, quality, isa)?;
            build.push(start.elapsed().as_secs_f64());
            speed.push(rays_per_second(&scene, &intersector)?);
        }
    }
    println!("quality,instructions,build_seconds,million_rays_per_second");
    for ((quality, isa), (build, speed)) in ways.iter().zip(measured) {
        let (build, speed) = (median(build), median(speed) * 1e-6);
        println!("{quality},{isa},{build:.3},{speed:.2}");
    }
    Ok(())
}

/// The view of the courtyard that the book shows.
fn rays_per_second(
    scene: &Scene,
    intersector: &Bvh,
) -> Result<f64, Box<dyn Error>> {
    let view = litpt_book::courtyard::view();
    let camera = Camera::new(&view, 4. / 3.)?;
    let integrator =
        PathTracer { albedo: 0.8, sky: Sky::new(view.up), foresight: () };
    let mut job = Job {
        scene,
        intersector,
        camera: &camera,
        integrator: &integrator,
        known: &KnownPixels::Nothing,
        sampler: IndependentSampler::new(0),
    };
    let mut film = Film::new(240, 180);
    let start = Instant::now();
    let rays = job.pass(&mut film, 8, &|_| true);
    Ok(rays as f64 / start.elapsed().as_secs_f64())
}
