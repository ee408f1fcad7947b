// Random numbers and directions (chapter "Sampling").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::HashSet;

use glam::DVec3;
use litpt::sampling::{cosine_direction, frame, generator};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Unit normals of all kinds, the poles and their neighbourhood included.
fn normals() -> Vec<DVec3> {
    let mut random = Pcg64::seed_from_u64(7);
    let mut normals: Vec<DVec3> = (0..1000)
        .map(|_| {
            let mut one = || 2. * random.random::<f64>() - 1.;
            DVec3::new(one(), one(), one()).normalize()
        })
        .collect();
    for tilt in [0., 1e-300, 1e-17, 1e-9, 1e-3] {
        for z in [1., -1.] {
            normals.push(DVec3::new(tilt, -tilt, z).normalize());
        }
    }
    normals.extend([DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y]);
    normals.push(DVec3::new(0.6, 0.8, 0.));
    normals.push(DVec3::new(0.6, 0.8, -0.));
    normals
}

#[test]
fn frames_are_orthonormal_near_the_poles_as_well() {
    for n in normals() {
        let (t, b) = frame(n);
        for (product, expected) in [
            (t.dot(t), 1.),
            (b.dot(b), 1.),
            (t.dot(b), 0.),
            (t.dot(n), 0.),
            (b.dot(n), 0.),
            (t.cross(b).dot(n), 1.),
        ] {
            // A dozen roundings of numbers of size one, 1.1e-16 each.
            assert!((product - expected).abs() < 2e-15, "{n}: {product}");
        }
    }
}

/// The quantile of the χ² distribution with `k` degrees of freedom that a
/// standard normal exceeds with the probability of `z` (Wilson and Hilferty).
fn chi_square_quantile(k: f64, z: f64) -> f64 {
    k * (1. - 2. / (9. * k) + z * (2. / (9. * k)).sqrt()).powi(3)
}

#[test]
fn directions_have_the_density_of_the_cosine() {
    // 20 x 10 cells of equal probability; 10^6 directions, 5000 in each.
    let (columns, rows, n) = (20, 10, 1_000_000);
    let all = normals();
    for normal in [DVec3::Z, -DVec3::Z, all[0], all[1]] {
        let (t, b) = frame(normal);
        let mut random = Pcg64::seed_from_u64(3);
        let mut cells = vec![0u32; columns * rows];
        for _ in 0..n {
            let (r, turn) = (random.random(), random.random());
            let d = cosine_direction(normal, r, turn);
            assert!((d.length() - 1.).abs() < 2e-15 && d.dot(normal) > 0.);
            // P(sin² < s) = s, and the azimuth is uniform: found from the
            // direction itself, not from the numbers that made it.
            let sine2 = d.dot(t).powi(2) + d.dot(b).powi(2);
            let azimuth = d.dot(b).atan2(d.dot(t));
            let turn = azimuth.rem_euclid(std::f64::consts::TAU)
                / std::f64::consts::TAU;
            let column =
                ((turn * columns as f64) as usize).min(columns - 1);
            let row = ((sine2 * rows as f64) as usize).min(rows - 1);
            cells[row * columns + column] += 1;
        }
        let expected = f64::from(n) / (columns * rows) as f64;
        let chi2: f64 = cells
            .iter()
            .map(|&c| (f64::from(c) - expected).powi(2) / expected)
            .sum();
        // Four tests, each with a false alarm of 0.25 % (Šidák: 1 %).
        let k = (columns * rows - 1) as f64;
        assert!(chi2 < chi_square_quantile(k, 2.81), "{normal}: {chi2}");
    }
}

#[test]
fn paths_draw_from_generators_of_their_own() {
    let mut first = HashSet::new();
    for seed in 0..4 {
        for pixel in 0..100 {
            for n in 0..100 {
                first.insert(generator(seed, pixel, n).next_u64());
            }
        }
    }
    // 40000 numbers of 64 bits collide with a probability of 4e-11.
    assert_eq!(first.len(), 40_000);
}

#[test]
fn first_numbers_of_neighbouring_paths_are_uniform_and_uncorrelated() {
    // The pairs of first numbers of realisations 0, 1, 2... of one pixel,
    // and of pixels 0, 1, 2... in one realisation.
    let n = 1u64 << 20;
    let numbers: [&dyn Fn(u64) -> f64; 2] =
        [&|i| generator(0, 5, i).random::<f64>(), &|i| {
            generator(0, i, 5).random::<f64>()
        }];
    for number in numbers {
        let mut cells = [0u32; 256];
        let mut last = 0.;
        for i in 0..n {
            let u = number(i);
            let cell = (last * 16.) as usize * 16 + (u * 16.) as usize;
            if i > 0 {
                cells[cell] += 1;
            }
            last = u;
        }
        let expected = (n - 1) as f64 / 256.;
        let chi2: f64 = cells
            .iter()
            .map(|&c| (f64::from(c) - expected).powi(2) / expected)
            .sum();
        // Two tests, each with a false alarm of 0.5 % (Šidák: 1 %).
        assert!(chi2 < chi_square_quantile(255., 2.58), "{chi2}");
    }
}
