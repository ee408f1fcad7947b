// Random numbers and directions (chapter "Sampling").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use glam::Vec3Swizzles;

/// Samples for each test of a distribution.
const SAMPLES: u32 = 1_000_000;

/// Dimensions of a sample that are looked at: those of the first thirteen
/// bounces.
const DIMENSIONS: usize = 41;

/// The cell of `x`, from [0, 1), in a row of `n`.
fn cell(x: f64, n: usize) -> usize {
    assert!((0. ..1.).contains(&x), "{x}");
    (x * n as f64) as usize
}

/// Unit normals of all kinds: at random, some of them with two axes that are
/// equally long but for a rounding, and along and between the axes, or
/// nearly so.
pub fn normals() -> Vec<DVec3> {
    let mut random = Pcg64::seed_from_u64(7);
    let mut all = vec![];
    for i in 0..300 {
        let mut one = || random.random::<f64>() - 0.5;
        let n = DVec3::new(one(), one(), one());
        let tied = DVec3::new(n.y.abs().next_down(), n.y, n.z);
        all.extend([n, if i % 2 == 0 { tied } else { tied.zxy() }]);
        all.push(DVec3::new(n.z, n.y, -n.z));
    }
    let signs = [-1., -0.75, -1e-9, -1e-300, -0., 0., 1e-17, 1e-3, 1.];
    for (x, y) in signs.iter().flat_map(|x| signs.map(|y| (*x, y))) {
        all.extend(signs.map(|z| DVec3::new(x, y, z)));
    }
    all.retain(|n| n.length() > 2e-3);
    all.into_iter().map(DVec3::normalize).collect()
}

#[test]
fn points_are_uniform_over_their_pixel() {
    let chance = &mut Chance::default();
    for (i, n) in [(0, 1), (3, 7), (16383, 16384)] {
        let mut random = generator(1, u64::from(i), 0);
        let mut cells = vec![0; 1000];
        for _ in 0..SAMPLES {
            let x = within(i, n, random.random());
            cells[cell(x * f64::from(n) - f64::from(i), 1000)] += 1;
        }
        chance.uniform(&cells, &format!("pixel {i} of {n}"));
    }
}

#[test]
fn no_point_of_a_pixel_lies_on_its_edges() {
    let sides = (1..=16384).chain([65535, 65536]);
    for n in sides.filter(|n| n % 61 == 1 || n % 4096 < 3 || *n > 16384) {
        for i in (0..n).filter(|i| n < 200 || i % 97 == 0 || *i == n - 1) {
            let edge = |i| f64::from(i) / f64::from(n);
            let (first, last) = (within(i, n, 0), within(i, n, u32::MAX));
            assert!(edge(i) < first && last < edge(i + 1), "{i} of {n}");
        }
    }
}

/// The angle of a point of the plane, in turns, from [0, 1).
fn turns(x: f64, y: f64) -> f64 {
    let turn = (y.atan2(x) / TAU).rem_euclid(1.);
    if turn < 1. { turn } else { 0. }
}

/// Demands that so many directions around a normal have the density of the
/// cosine: 20 x 10 cells are equally probable, in the azimuth and in the
/// square of the sine, as the direction itself has them.
pub fn assert_cosine(
    chance: &mut Chance,
    normal: DVec3,
    count: u32,
    mut draw: impl FnMut() -> DVec3,
) {
    let (columns, rows) = (20, 10);
    let (t, b) = normal.any_orthonormal_pair();
    let mut cells = vec![0u32; columns * rows];
    for d in (0..count).map(|_| draw()) {
        assert!((d.length() - 1.).abs() < 1e-14 && d.dot(normal) > -1e-15);
        let sine2 = d.dot(t).powi(2) + d.dot(b).powi(2);
        let column = cell(turns(d.dot(t), d.dot(b)), columns);
        let row = ((sine2 * rows as f64) as usize).min(rows - 1);
        cells[row * columns + column] += 1;
    }
    chance.uniform(&cells, &format!("directions around {normal}"));
}

#[test]
fn directions_have_the_density_of_the_cosine() {
    let chance = &mut Chance::default();
    let all = normals();
    let tilted = |tilt, z| DVec3::new(tilt, -tilt, z).normalize();
    for normal in [
        DVec3::Z,
        -DVec3::Z,
        tilted(1e-17, -1.),
        tilted(1e-9, -1.),
        tilted(1e-3, -1.),
        tilted(1e-9, 1.),
        DVec3::new(0.6, 0.8, 0.),
        DVec3::new(0.6, 0.8, -0.),
        all[0],
        all[1],
    ] {
        let mut random = Pcg64::seed_from_u64(3);
        assert_cosine(chance, normal, SAMPLES, || {
            cosine_direction(normal, random.random(), random.random())
        });
    }
}

#[test]
fn no_direction_lies_in_its_surface_or_below() {
    let last = 1. - 0.5f64.powi(53);
    for normal in normals() {
        for turn in (0..64).map(|i| f64::from(i) / 64.).chain([last]) {
            for (r, sine2) in [(0., 0.), (0.5, 0.5), (last, 1.)] {
                let d = cosine_direction(normal, r, turn);
                let cosine = (1. - r).sqrt();
                // A cosine of 1.05e-8 at least, and a few roundings.
                assert!(d.dot(normal) > 1e-8, "{normal} {r} {turn}");
                assert!((d.dot(normal) - cosine).abs() < 2e-15);
                let across = d.cross(normal).length_squared();
                assert!((across - sine2).abs() < 2e-15);
            }
        }
    }
}

// ------------------------------------------------------------ The dimensions

/// The cells of the first dimensions of a sample, of 16 each.
fn cells((seed, pixel, index): Name) -> [usize; DIMENSIONS] {
    let mut sampler = IndependentSampler::new(seed).start(pixel, index);
    let mut cells = [0; DIMENSIONS];
    let [x, y] = sampler.get_pixel_2d();
    (cells[0], cells[1]) = ((x >> 28) as usize, (y >> 28) as usize);
    for bounce in 0..(DIMENSIONS as u64 - 2) / 3 {
        let roulette = dimension::roulette(bounce);
        let direction = dimension::direction(bounce);
        let u = sampler.get_1d(roulette);
        let [v, w] = sampler.get_2d(direction);
        let numbers = [(roulette, u), (direction, v), (direction + 1, w)];
        for (dimension, number) in numbers {
            cells[dimension as usize] = cell(number, 16);
        }
    }
    cells
}

/// Samples whose cells are looked at together.
const PATHS: u64 = 1 << 16;

/// Names a sample by a number.
type Naming = fn(u64) -> Name;

#[test]
fn each_dimension_is_uniform_alone_and_with_each_other() {
    let chance = &mut Chance::default();
    let names: [(&str, Naming); 2] =
        [("a pixel", |i| (3, 77, i)), ("an image", |i| (3, i, 2))];
    for (what, name) in names {
        let paths: Vec<_> = (0..PATHS).map(|i| cells(name(i))).collect();
        for d in 0..DIMENSIONS {
            let mut alone = [0; 16];
            paths.iter().for_each(|path| alone[path[d]] += 1);
            chance.uniform(&alone, &format!("{what}: dimension {d}"));
            for e in 0..d {
                let mut both = [0; 256];
                for path in &paths {
                    both[path[d] * 16 + path[e]] += 1;
                }
                let what = format!("{what}: dimensions {d} and {e}");
                chance.uniform(&both, &what);
            }
        }
    }
}

/// Seed, pixel and number of a sample.
pub type Name = (u64, u64, u64);

/// A pair of samples, by its number.
pub type Pair = fn(u64) -> [Name; 2];

/// Pairs of samples, by the number of the pair, that are close to each other in
/// one respect. No sample is in two pairs of a kind.
pub const RELATED: [(&str, Pair); 8] = [
    ("next sample", |i| [(0, 5, 2 * i), (0, 5, 2 * i + 1)]),
    ("next pixel", |i| [(0, 2 * i, 5), (0, 2 * i + 1, 5)]),
    ("next row", |i| {
        let (x, y) = (i % 800, i / 800 * 2);
        [(0, y * 800 + x, 5), (0, (y + 1) * 800 + x, 5)]
    }),
    ("next seed", |i| [(0, i % 256, i / 256), (1, i % 256, i / 256)]),
    ("next large seed", |i| {
        let seed = u64::MAX - 1;
        [(seed, i % 256, i / 256), (seed + 1, i % 256, i / 256)]
    }),
    ("seed of another upper half", |i| {
        [(7, i % 256, i / 256), (7 + (1 << 32), i % 256, i / 256)]
    }),
    ("next of many seeds", |i| [(2 * i, 9, 0), (2 * i + 1, 9, 0)]),
    ("pixel and sample exchanged", |i| {
        let (a, b) = (i % 256, 256 + i / 256);
        [(0, a, b), (0, b, a)]
    }),
];

/// Demands that related samples, whose cells are given, are independent: in
/// each dimension, and in each and the next.
pub fn assert_unrelated<const N: usize>(
    chance: &mut Chance,
    cells: impl Fn(Name) -> [usize; N],
) {
    for (what, pair) in RELATED {
        let mut counts = vec![[0; 256]; 2 * N];
        for i in 0..PATHS {
            let [one, other] = pair(i).map(&cells);
            for d in 0..N {
                counts[d][one[d] * 16 + other[d]] += 1;
                counts[N + d][one[d] * 16 + other[(d + 1) % N]] += 1;
            }
        }
        for (d, counts) in counts.iter().enumerate() {
            chance.uniform(counts, &format!("{what}, dimension {d}"));
        }
    }
}

#[test]
fn related_samples_are_independent_in_each_dimension() {
    assert_unrelated(&mut Chance::default(), cells);
}

#[test]
fn a_sampler_gives_the_same_numbers_whoever_starts_it() {
    let fresh = IndependentSampler::new(4).start(3, 2);
    let used = IndependentSampler::new(4).start(8, 9).start(3, 2);
    for mut sampler in [fresh, used] {
        let mut random = generator(4, 3, 2);
        let point: [u32; 2] = random.random();
        assert_eq!(sampler.get_pixel_2d(), point);
        // Roulette is not asked at the first bounce.
        let numbers: [f64; 2] = random.random();
        assert_eq!(sampler.get_2d(dimension::direction(0)), numbers);
        let number: f64 = random.random();
        assert_eq!(sampler.get_1d(dimension::roulette(1)), number);
    }
}
