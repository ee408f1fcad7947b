// Paths that hardly end: albedos near 1 in cavities that are nearly
// closed (chapter "The estimator").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

/// A path that hits walls only; `leaves` tells before each ray but the first
/// whether it meets the sky instead. Its weight, and its number of rays.
fn path(
    rho: f64,
    n: u64,
    mut leaves: impl FnMut(u64) -> bool,
) -> (f64, u64) {
    let integrator = PathTracer::new(Surfaces::of(rho), Sky::new(DVec3::Z));
    let wall = Hit { point: DVec3::ZERO, normal: DVec3::Z, primitive: 0 };
    let mut sampler = IndependentSampler::new(1).start(0, n);
    let mut path = integrator.begin(DVec3::Z, 1.);
    let mut rays = 1;
    loop {
        let hit = (rays == 1 || !leaves(rays - 1)).then_some(wall);
        match integrator.advance(&mut path, hit, &mut sampler) {
            PathEvent::Scatter(..) => rays += 1,
            PathEvent::Terminate(weight) => return (weight, rays),
        }
    }
}

/// What the book derives for a cavity: moments 1 to 4 of the weight, and 1 to
/// 2 of the number of rays.
fn moments(rho: f64, f: f64) -> ([f64; 4], [f64; 2]) {
    let (mut throughput, mut alive) = (1f64, 1f64);
    let (mut weight, mut rays) = ([0.; 4], [1.; 2]);
    let mut bounces = 0f64;
    while alive > 1e-20 {
        if throughput < 0.1 {
            alive *= rho;
        } else {
            throughput *= rho;
            if bounces >= 1000. {
                let chance = (bounces / (bounces + 1.)).powf(1.5);
                alive *= chance;
                throughput /= chance;
            }
        }
        bounces += 1.;
        for (k, moment) in weight.iter_mut().enumerate() {
            *moment += alive * f * throughput.powi(k as i32 + 1);
        }
        // The ray of number bounces + 1: E[L^2] = sum of (2l - 1) P(L >= l).
        rays[0] += alive;
        rays[1] += alive * (2. * bounces + 1.);
        alive *= 1. - f;
    }
    (weight, rays)
}

// 30 cavities and three comparisons of each. The standard errors are the true
// ones, from the moments.
#[test]
fn means_variances_and_rays_of_stiff_cavities_are_as_derived() {
    let rhos = [0.9, 0.99, 0.999, 1. - 1e-4, 1. - 1e-6, 1.];
    let fs = [0.5, 0.1, 0.01, 1e-3, 1e-4];
    let cells = rhos.map(|rho| fs.map(|f| (rho, f)));
    let compare = |&(rho, f): &(f64, f64)| {
        let (weight, rays) = moments(rho, f);
        let exact = cavity_radiance(rho, f);
        assert!((weight[0] / exact - 1.).abs() < 1e-9, "{rho} {f}");
        let n = (1e7 / rays[0]).clamp(1e4, 1e5) as u64;
        let (mut sums, mut lengths) = (Accumulator::default(), 0);
        for i in 0..n {
            let mut doors = generator(2, 0, i);
            let (weight, length) =
                path(rho, i, |_| doors.random::<f64>() < f);
            sums.add(weight);
            lengths += length;
        }
        let [m1, m2, m3, m4] = weight;
        // The fourth moment about the mean.
        let fourth = m4 - m1 * (4. * m3 - m1 * (6. * m2 - 3. * m1 * m1));
        let variance = m2 - m1 * m1;
        let of_variance = fourth - variance * variance;
        let of_length = rays[1] - rays[0] * rays[0];
        let rows = [
            ("mean", sums.mean(), m1, variance),
            ("variance", sums.variance(), variance, of_variance),
            ("rays", lengths as f64 / n as f64, rays[0], of_length),
        ];
        rows.map(|(what, found, expected, spread)| {
            // Where no weight varies, the moments differ by rounding only.
            let error = (spread.max(0.) / n as f64).sqrt() + 1e-12;
            let what = format!("{what}, rho = {rho}, f = {f}");
            ((found - expected) / error, what)
        })
    };
    let all: Vec<_> =
        cells.as_flattened().par_iter().map(compare).collect();
    let mut chance = Chance::default();
    all.iter().flatten().for_each(|(z, what)| chance.normal(*z, what));
}

#[test]
fn a_path_of_n_bounces_has_grown_by_the_inverse_of_its_chance() {
    let chance = &mut Chance::default();
    for floors in [1000, 1001, 1500, 4000] {
        let weight = (floors as f64 / 1000.).powf(1.5);
        let mut weights = Accumulator::default();
        for n in 0..3000 {
            let (found, _) = path(1., n, |bounces| bounces == floors);
            assert!(found == 0. || (found / weight - 1.).abs() < 1e-12);
            weights.add(found);
        }
        // The variance of weight times a chance of 1/weight.
        let error = ((weight - 1.) / 3000.).sqrt() + 1e-12;
        let z = (weights.mean() - 1.) / error;
        chance.normal(z, &format!("{floors} bounces"));
    }
}

// P(more than n bounces) = (1000/n)^(3/2), a mean of 3000. The variance is
// infinite: the mean itself converges slowly, and gets a wide berth.
#[test]
fn paths_in_a_closed_white_cavity_end_as_fast_as_derived() {
    let chance = &mut Chance::default();
    let n = 4000;
    let paths = (0..n).into_par_iter().map(|i| path(1., i, |_| false));
    let (weights, lengths): (Vec<_>, Vec<_>) = paths.unzip();
    assert!(weights.iter().all(|&weight| weight == 0.));
    assert!(lengths.iter().all(|&rays| rays > 1000));
    for quadruples in 1..4 {
        let (bound, p) = (1000 << (2 * quadruples), 8f64.powi(-quadruples));
        let longer = lengths.iter().filter(|&&rays| rays > bound).count();
        let z = (longer as f64 - n as f64 * p)
            / (n as f64 * p * (1. - p)).sqrt();
        chance.normal(z, &format!("beyond {bound}"));
    }
    let mean = lengths.iter().sum::<u64>() as f64 / n as f64;
    assert!((2500. ..4000.).contains(&mean), "{mean}");
}

// The polygon that replaces the rim and the polyhedron that replaces the wall
// change f by less than 3e-4 of itself, and L by less than that: a fiftieth of
// the standard errors.
#[test]
fn stiff_cavities_made_of_triangles_agree_with_the_closed_form() {
    let chance = &mut Chance::default();
    let inside = look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 20.);
    for (rho, f, n) in
        [(0.999, 0.01, 20_000), (1. - 1e-6, 1e-3, 3000), (1., 1e-4, 2000)]
    {
        let pixel = pixel(&cavity(f, 128), rho, &inside, n).unwrap();
        let (weight, _) = moments(rho, f);
        let variance = weight[1] - weight[0] * weight[0];
        let error = (variance / n as f64).sqrt();
        let z = (pixel.mean() - cavity_radiance(rho, f)) / error;
        chance.normal(z, &format!("rho = {rho}, f = {f}"));
    }
}
