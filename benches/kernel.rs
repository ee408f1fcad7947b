// Times the parts of a path with criterion: "cargo bench".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use litpt::bvh::{Bvh, Intersector};
use litpt::courtyard::{solids, write_obj};
use litpt::numerics::sincos_turns;
use litpt::sampler::{cosine_direction, frame, generator};
use litpt::scene::{Ray, Scene, read_obj};
use rand::{Rng, RngExt};

/// Inputs that a measurement goes round, so that no branch is learnt.
const INPUTS: usize = 1 << 14;

/// A direction uniform over the sphere.
fn direction(random: &mut impl Rng) -> DVec3 {
    let (x, y) = sincos_turns(random.random());
    let z = 2. * random.random::<f64>() - 1.;
    let r = (1. - z * z).sqrt();
    DVec3::new(r * x, r * y, z)
}

fn inputs<T>(mut input: impl FnMut(&mut rand_pcg::Pcg64) -> T) -> Vec<T> {
    let mut random = generator(0, 0, 0);
    (0..INPUTS).map(|_| input(&mut random)).collect()
}

/// Measures a function on one input after the other.
fn each<I, O>(
    criterion: &mut Criterion,
    name: &str,
    inputs: &[I],
    function: impl Fn(&I) -> O,
) {
    let mut i = 0;
    criterion.bench_function(name, |bencher| {
        bencher.iter(|| {
            i = (i + 1) % INPUTS;
            function(black_box(&inputs[i]))
        });
    });
}

/// First hits of rays from random points over the court.
fn intersector(criterion: &mut Criterion) {
    let mut obj = vec![];
    write_obj(&solids(), &mut obj).expect("memory can be written");
    let mesh = read_obj(&obj).expect("the courtyard is an OBJ");
    let scene = Scene::new(&mesh);
    let intersector = Bvh::new(&scene).expect("memory");
    let rays = inputs(|random| {
        let [x, y, z] = [11., 4., 4.]
            .map(|half| half * (2. * random.random::<f64>() - 1.));
        let position = DVec3::new(x, y + 4.5, z);
        let direction = direction(random);
        let ray = scene.enter(position, direction);
        ray.unwrap_or(Ray { origin: DVec3::ZERO, direction })
    });
    each(criterion, "first_hit", &rays, |ray| {
        intersector.first_hit(ray, None)
    });
}

fn sampler(criterion: &mut Criterion) {
    let numbers = inputs(|random| random.random::<f64>());
    let normals = inputs(direction);
    let all = inputs(|random| {
        (direction(random), random.random::<f64>(), random.random::<f64>())
    });
    let pixels = inputs(|random| random.random::<u64>() >> 44);
    each(criterion, "circle", &numbers, |&u| sincos_turns(u));
    each(criterion, "frame", &normals, |&n| frame(n));
    each(criterion, "cosine_direction", &all, |&(n, r, turn)| {
        cosine_direction(n, r, turn)
    });
    each(criterion, "generator", &pixels, |&i| {
        generator(0, i, 3).random::<f64>()
    });
    let mut random = generator(0, 0, 0);
    criterion.bench_function("random", |bencher| {
        bencher.iter(|| random.random::<f64>());
    });
}

criterion_group!(benches, intersector, sampler);
criterion_main!(benches);
