// Scrambled nets (chapter "Quasi-Monte Carlo").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use crate::sampler::assert_unrelated;

/// All four coordinates of a point.
fn point(net: &ScrambledNet, key: u64, i: u32) -> [u32; 4] {
    let ([x, y], [z, w]) = (net.pair(key, i, 0), net.pair(key, i, 1));
    [x, y, z, w]
}

/// The first `n` digits of a coordinate.
fn digits(x: u32, n: u32) -> usize {
    (u64::from(x) >> (32 - n)) as usize
}

/// Keys that differ in each respect.
fn keys() -> impl Iterator<Item = u64> {
    let names = [(0, 0, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0), (7, 99, 3)];
    names.into_iter().map(|(s, p, n)| scramble_key(s, p, n))
}

// ----------------------------------------------------------------- The nets

/// Demands that points from `first` on fill the cells of each shape evenly.
fn assert_net(net: &ScrambledNet, key: u64, first: u32, log: u32) {
    for (pair, a) in (0..2).flat_map(|p| (0..=log).map(move |a| (p, a))) {
        let mut hit = vec![false; 1 << log];
        for i in first..first + (1 << log) {
            let [x, y] = net.pair(key, i, pair);
            let cell = digits(x, a) << (log - a) | digits(y, log - a);
            assert!(!hit[cell], "pair {pair} from {first}, {a} of {log}");
            hit[cell] = true;
        }
    }
}

// The later parts of a longer sequence are nets as well, and so is a
// sequence in the order of which more digits are scrambled than needed.
#[test]
fn each_pair_is_a_net_at_all_powers_of_two() {
    for log in 0..=12 {
        let net = ScrambledNet::new(1 << log);
        keys().for_each(|key| assert_net(&net, key, 0, log));
    }
    let net = ScrambledNet::new(1 << 13);
    for (log, part) in (0..=8).flat_map(|l| [1, 2, 17, 31].map(|p| (l, p)))
    {
        assert_net(&net, 5, part << log, log);
    }
}

#[test]
fn all_four_coordinates_are_a_net_in_base_four() {
    for log in 0..=6 {
        let net = ScrambledNet::new(1 << (2 * log));
        let key = scramble_key(3, 1, 4);
        let all: Vec<_> =
            (0..1 << (2 * log)).map(|i| point(&net, key, i)).collect();
        let cuts = (0..=log).flat_map(|a| {
            (0..=log - a).flat_map(move |b| {
                (0..=log - a - b).map(move |c| [a, b, c, log - a - b - c])
            })
        });
        for cut in cuts {
            let mut hit = vec![false; all.len()];
            for p in &all {
                let cell = (0..4).fold(0, |cell, d| {
                    cell << (2 * cut[d]) | digits(p[d], 2 * cut[d])
                });
                assert!(!hit[cell], "{cut:?}");
                hit[cell] = true;
            }
        }
    }
}

#[test]
fn the_sizes_of_sets_are_powers_of_two() {
    for points in [0, 3, 48, 1 << 31] {
        let result = std::panic::catch_unwind(|| ScrambledNet::new(points));
        assert!(result.is_err(), "{points}");
    }
    for log in [0, 1, 6, 7, 30] {
        assert_eq!(SobolSampler::new(1, 1 << log).net_size(), 1 << log);
    }
}

// -------------------------------------------------------------- The scrambles

/// Scrambles for each test of a distribution.
const SCRAMBLES: u64 = 1 << 16;

#[test]
fn each_point_is_uniform_over_its_first_and_last_digits() {
    let chance = &mut Chance::default();
    // Points of no, one, and two trees of digits.
    for (points, i) in [(1, 0), (64, 0), (64, 37), (4096, 2901)] {
        let net = ScrambledNet::new(points);
        let mut cells = [0; 3].map(|_| vec![0; 4 << 10]);
        for n in 0..SCRAMBLES {
            let point = point(&net, scramble_key(2, 9, n), i);
            for (d, x) in point.into_iter().enumerate() {
                for (cells, shift) in cells.iter_mut().zip([22, 14, 0]) {
                    cells[d << 10 | (x >> shift & 1023) as usize] += 1;
                }
            }
        }
        for (cells, what) in cells.iter().zip(["first", "middle", "last"]) {
            chance.uniform(cells, &format!("{what} of {i} of {points}"));
        }
    }
}

// Two coordinates of a point, over the scrambles: 32 by 32 cells of the first
// digits, and of the last.
#[test]
fn the_coordinates_of_a_point_are_independent_of_each_other() {
    let chance = &mut Chance::default();
    let net = ScrambledNet::new(64);
    let mut first = vec![vec![0; 1024]; 6];
    let mut last = vec![vec![0; 1024]; 6];
    for n in 0..SCRAMBLES {
        let p = point(&net, scramble_key(0, 4, n), 21);
        let pairs = (0..4).flat_map(|d| (0..d).map(move |e| (p[d], p[e])));
        for (k, (x, y)) in pairs.enumerate() {
            first[k][digits(x, 5) << 5 | digits(y, 5)] += 1;
            last[k][(x as usize & 31) << 5 | y as usize & 31] += 1;
        }
    }
    for cells in first.into_iter().chain(last) {
        chance.uniform(&cells, "two coordinates");
    }
}

/// The first numbers of a sample, of 16 values each.
fn numbers(sampler: &SobolSampler, pixel: u64, index: u64) -> [usize; 7] {
    let mut sampler = sampler.start(pixel, index);
    let sixteenth = |u: f64| (u * 16.) as usize;
    let [x, y] = sampler.get_pixel_2d().map(|x| digits(x, 4));
    let [r, turn] = sampler.get_2d(dimension::direction(0)).map(sixteenth);
    let roulette = sixteenth(sampler.get_1d(dimension::roulette(1)));
    let [s, t] = sampler.get_2d(dimension::direction(1)).map(sixteenth);
    [x, y, r, turn, roulette, s, t]
}

#[test]
fn samples_of_different_scrambles_are_independent_in_each_dimension() {
    assert_unrelated(&mut Chance::default(), |(seed, pixel, n)| {
        numbers(&SobolSampler::new(seed, 16), pixel, 16 * n + n % 16)
    });
}

#[test]
fn later_dimensions_are_independent_within_a_scramble() {
    let chance = &mut Chance::default();
    let sampler = SobolSampler::new(2, 16);
    let mut counts = [[0; 256]; 3];
    for i in 0..SCRAMBLES {
        let [one, other] = [0, 1].map(|k| numbers(&sampler, 7, 2 * i + k));
        for (d, counts) in counts.iter_mut().enumerate() {
            counts[one[4 + d] * 16 + other[4 + d]] += 1;
        }
    }
    for counts in counts {
        chance.uniform(&counts, "a later dimension");
    }
}

#[test]
fn the_order_of_samples_and_dimensions_changes_no_number() {
    let fresh = SobolSampler::new(4, 16);
    let all: Vec<_> = (0..48).map(|n| numbers(&fresh, 3, n)).collect();
    let mut used = fresh.start(8, 9);
    used.get_2d(dimension::direction(7));
    for n in (0..48).rev() {
        assert_eq!(numbers(&used, 3, n), all[n as usize]);
        let mut late = used.start(3, n);
        let [r, turn] = late.get_2d(dimension::direction(0));
        let [x, y] = late.get_pixel_2d();
        let [a, b, c, d, ..] = all[n as usize];
        assert_eq!([digits(x, 4), digits(y, 4)], [a, b]);
        assert_eq!([r, turn].map(|u| (u * 16.) as usize), [c, d]);
        used = late;
    }
}

#[test]
fn samples_are_the_points_of_their_scrambles() {
    let net = ScrambledNet::new(16);
    for index in [0, 1, 15, 16, 100] {
        let key = scramble_key(6, 5, index / 16);
        let i = (index % 16) as u32;
        let mut sampler = SobolSampler::new(6, 16).start(5, index);
        assert_eq!(sampler.get_pixel_2d(), net.pair(key, i, 0));
        let direction = sampler.get_2d(dimension::direction(0));
        assert_eq!(direction, net.pair(key, i, 1).map(to_unit));
    }
}

#[test]
fn coordinates_lie_strictly_between_zero_and_one() {
    assert_eq!(to_unit(0), 0.5f64.powi(33));
    assert_eq!(to_unit(u32::MAX), 1. - 0.5f64.powi(33));
    assert_eq!((to_unit(77) + to_unit(u32::MAX - 77)) / 2., 0.5);
}

// ------------------------------------------------------- Means and their errors

// Of n points one is uniform in each of n strata, independently of the others:
// the mean of a coordinate has the variance 1/(12n³), and its fourth central
// moment is 3 - 1.2/n times the square of that.
#[test]
fn the_coordinates_of_a_net_are_independent_within_their_strata() {
    let chance = &mut Chance::default();
    const N: u64 = 16384;
    for n in [1u32, 16, 256] {
        let net = ScrambledNet::new(u64::from(n));
        let variance = f64::from(n).powi(3).recip() / 12.;
        let mut squares = [0.; 4];
        for k in 0..N {
            let key = scramble_key(4, 2, k);
            let mut sums = [0.; 4];
            for i in 0..n {
                let coordinates = point(&net, key, i).map(to_unit);
                sums.iter_mut().zip(coordinates).for_each(|(s, x)| *s += x);
            }
            for (square, sum) in squares.iter_mut().zip(sums) {
                let deviation = sum / f64::from(n) - 0.5;
                *square += deviation * deviation / variance / N as f64;
            }
        }
        let spread = ((2. - 1.2 / f64::from(n)) / N as f64).sqrt();
        for (d, square) in squares.into_iter().enumerate() {
            let what = format!("coordinate {d} of {n} points");
            chance.normal((square - 1.) / spread, &what);
        }
    }
}

/// The mean of an image with its standard error from the replicates, and the
/// mean variance of a replicate times its samples: of paths with this part of
/// the control variate.
fn render<S: Sampler>(
    form: &ClosedForm,
    control: f64,
    sampler: S,
) -> [f64; 3] {
    let ClosedForm { mesh, view, .. } = form;
    let setting = Setting::new(mesh, (RHO, DVec3::Z), view, 1.5).unwrap();
    let Job { sensor, intersector, integrator, known_pixels, .. } =
        setting.job(0);
    let replicate = sampler.net_size();
    let mut film = Film::new(24, 16).with_net_size(replicate);
    let integrator = PathTracer { control, ..integrator };
    let mut job =
        Job { sensor, intersector, integrator, known_pixels, sampler };
    job.pass(&mut film, 1024, &|_| true);
    let pixels = film.rows().count() as f64;
    let mean = film.means().sum::<f64>() / pixels;
    let errors = film.rows().map(|pixel| pixel.standard_error().powi(2));
    let error = errors.sum::<f64>().sqrt() / pixels;
    let variance = film.rows().map(|p| p.variance()).sum::<f64>() / pixels;
    [mean, error, variance * replicate as f64]
}

const RHO: f64 = 0.8;

/// A slope of cosine 0.6 that sees 0.8 of the sky, and a floor by a wall; and
/// their radiances.
fn slope_and_corner() -> [(ClosedForm, f64); 2] {
    let names = [r"facet, $\cos\theta=0.6$", "floor by a wall"];
    let form = |name| {
        let mut forms = closed_forms().into_iter();
        forms.find(|form| form.name == name).unwrap()
    };
    let [slope, corner] = names.map(form);
    [(slope, RHO * 0.8), (corner, cavity_radiance(RHO, 0.5))]
}

#[test]
fn the_path_tracer_finds_known_radiances_with_smaller_errors() {
    let chance = &mut Chance::default();
    // How much smaller the variance of 64 samples is at least.
    for ((mesh, exact), gain) in slope_and_corner().iter().zip([4., 2.]) {
        let [_, _, plain] = render(mesh, 0., IndependentSampler::new(1));
        let [mean, error, variance] =
            render(mesh, 0., SobolSampler::new(1, 64));
        chance.normal((mean - exact) / error, "mean of an image");
        assert!(gain * variance < plain, "{variance} of {plain}");
    }
}

/// The contribution of a path that a control variate corrects is the answer
/// where nothing hides the sky. In a corner, whatever part of it is
/// subtracted, the mean is right.
#[test]
fn the_sky_is_a_control_variate_whose_mean_is_known() {
    let chance = &mut Chance::default();
    let [(slope, bright), (corner, exact)] = slope_and_corner();
    let image =
        |mesh, control| render(mesh, control, IndependentSampler::new(2));
    let [mean, _, variance] = image(&slope, 1.);
    assert!((mean - bright).abs() < 1e-12, "{mean}");
    assert!(variance < 1e-20, "{variance}");
    for control in [0.5, 1.] {
        let [mean, error, _] = image(&corner, control);
        chance.normal((mean - exact) / error, "control");
    }
}
