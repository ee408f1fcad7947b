// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Answers to the book's exercises on paths, errors, images and runs, with
//! each number that their text states.

use crate::prelude::*;

use crate::answers_scene;
use crate::compare::row;
use crate::formats::bytes;
use crate::gather::record;
use crate::render_loop::go_on;

use litpt::compare::compare;
use litpt::integrator::gather::training::train;
use litpt::render::*;
use litpt_book::settings;

/// A number is within some distance of what is printed.
#[track_caller]
pub fn near(value: f64, printed: f64, by: f64) {
    assert!((value - printed).abs() <= by, "{value}, not {printed}");
}

/// A cavity of albedo `rho` that is open over the share `f`.
pub fn sphere(f: f64, rho: f64, rings: u32) -> Setting {
    let view = look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 20.);
    Setting::new(&cavity(f, rings), (rho, DVec3::Z), &view, 1.).unwrap()
}

/// The first samples of one pixel.
pub fn weigh(setting: &Setting, seed: u64, samples: u64) -> Accumulator {
    let mut film = Film::new(1, 1);
    setting.job(seed).pass(&mut film, samples, &|_| true);
    *film.pixel(0, 0)
}

#[test]
fn a_density_that_is_too_steep_hides_its_error() {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut counts = [0, 0];
    for _ in 0..1000 {
        let mut sum = Accumulator::default();
        for _ in 0..1000 {
            let c = (1. - rng.random::<f64>()).powf(1. / 7.);
            sum.add(2. / 7. * c.powi(-4));
        }
        let off = sum.mean() - 2. / 3.;
        counts[0] += u32::from(off < 0.);
        counts[1] += u32::from(off.abs() <= 2. * sum.standard_error());
    }
    let [low, covered] = counts.map(f64::from);
    near(low, 610., 50.);
    near(covered, 870., 35.);
}

/// The expectation of the mean of two runs of `n` samples that are 1 with
/// the probability `q`, weighted by the errors that they state.
fn weighted(n: u32, q: f64) -> f64 {
    let mut odds = (1. - q).powf(f64::from(n));
    let outcome = |ones| {
        let mut run = Accumulator::default();
        (0..n).for_each(|k| run.add(f64::from(u8::from(k < ones))));
        let now = odds;
        odds *= f64::from(n - ones) / f64::from(ones + 1) * q / (1. - q);
        (run, now)
    };
    let outcomes: Vec<_> = (0..=n).map(outcome).collect();
    let pairs =
        outcomes.iter().flat_map(|x| outcomes.iter().map(move |y| (x, y)));
    let means = pairs.map(|((a, odds), (b, others))| {
        let [v, w] = match [a, b].map(|run| run.standard_error().powi(2)) {
            [0., 0.] => [1., 1.],
            variances => variances,
        };
        odds * others * (a.mean() * w + b.mean() * v) / (v + w)
    });
    means.sum()
}

#[test]
fn runs_that_are_weighted_by_their_errors_are_too_dark() {
    near(weighted(16, 0.1), 0.0733, 5e-5);
    near(weighted(256, 0.1), 0.1 - 0.8 / 512., 5e-5);
}

#[test]
fn a_path_of_half_reflectivity_brings_one_of_five_weights() {
    let setting = sphere(0.5, 0.5, 16);
    let one = |seed| weigh(&setting, seed, 1).mean();
    let mut weights: Vec<f64> = (0..500).map(one).collect();
    weights.sort_by(f64::total_cmp);
    weights.dedup();
    assert_eq!(weights, [0., 0.0625, 0.125, 0.25, 0.5]);

    let (closed, mut film) = (sphere(0., 0.5, 16), Film::new(1, 1));
    let rays = closed.job(1).pass(&mut film, 20_000, &|_| true);
    near(rays as f64 / 20_000., 6., 0.05);
}

/// The value of a cell, of whose records so many go to itself for each
/// that goes to the sky.
fn settled(to_itself: usize) -> f64 {
    let grid = Grid::around(&[]);
    let (p, normal) = (DVec3::splat(0.5), DVec3::Z);
    let from = grid.name(p, normal);
    let mut records = vec![record(from, SKY, 1.)];
    records.resize(1 + to_itself, record(from, from, 1.));
    let cache =
        RadianceCache::empty(grid).learn(&mut records, 1., &|_| true);
    f64::from(cache.at(from).value)
}

#[test]
fn an_iteration_that_has_settled_may_be_far_from_its_limit() {
    near(settled(1), 0.999, 5e-4);
    near(settled(99), 0.910, 5e-4);
    near(settled(999), 0.259, 5e-4);
}

/// A cache that says the same of all places within a unit of the origin.
fn believer(value: f32) -> RadianceCache {
    let grid = Grid::around(&[DVec3::splat(-1e6), DVec3::splat(1e6)]);
    let mut records = vec![];
    for (x, y, z) in (0..8).map(|i| (i & 1, i >> 1 & 1, i >> 2)) {
        let [x, y, z] = [x, y, z].map(|i| f64::from(2 * i - 1));
        for normal in DVec3::AXES.into_iter().flat_map(|a| [a, -a]) {
            let from = grid.name(DVec3::new(x, y, z), normal);
            records.push(record(from, SKY, value));
        }
    }
    RadianceCache::empty(grid).learn(&mut records, 1., &|_| true)
}

/// The pixels of an image of one tile in so many scrambles, the means of all,
/// and the rays of a sample.
pub fn scrambles(
    mut tracer: Tracer<Bvh>,
    count: u64,
) -> (Vec<Accumulator>, Accumulator, f64) {
    let Allocation { window, ref counts, .. } = *tracer.allocation;
    let samples = f64::from(counts.iter().sum::<u32>()) * count as f64;
    let mut film = Film::new(window.size.0, window.size.1);
    let [FilmTile { tile, .. }] = film.tiles()[..] else {
        panic!("one tile")
    };
    let mut pixels = vec![Accumulator::default(); window.area()];
    let mut mean = Accumulator::default();
    for scramble in 0..count {
        let values = tracer.tile(tile, scramble).means;
        mean.add(values.iter().sum::<f64>() / values.len() as f64);
        pixels.iter_mut().zip(values).for_each(|(p, v)| p.add(v));
    }
    (pixels, mean, tracer.rays as f64 / samples)
}

/// What a gather finds in a small image of a setting: its samples without
/// a correction, or the means of its one tile; and the rays of a sample.
fn gather(
    setting: &Setting,
    cache: &RadianceCache,
    correction: Option<Correction>,
    count: u64,
) -> (Accumulator, f64) {
    let gather = &Gather { seed: 4, correction, ..setting.gather((4, 4)) };
    let allocation = &Allocation::even(Film::new(4, 4).window, 1);
    let tracer = tracer(gather, cache, allocation);
    let (pixels, mut sum, rays) = scrambles(tracer, count);
    if correction.is_none() {
        sum = Accumulator::default();
        pixels.iter().for_each(|pixel| sum.merge(pixel));
    }
    (sum, rays)
}

// Five standard errors, which chance exceeds with 6e-7; and the cavity is
// round to a few parts in ten thousand.
#[test]
fn a_believed_cache_passes_on_two_thirds_of_its_error() {
    let setting = sphere(0.2, 0.8, 128);
    let all = Correction { step: 1., ..Correction::default() };
    for (says, image) in [(1., 0.8), (0., 0.16), (4. / 9., 4. / 9.)] {
        let cache = believer(says);
        let (sum, rays) = gather(&setting, &cache, None, 2000);
        near(sum.mean(), image, 5. * sum.standard_error() + 5e-4);
        near(rays, 2., 0.);
        let (sum, _) = gather(&setting, &cache, Some(all), 1000);
        near(sum.mean(), 4. / 9., 5. * sum.standard_error() + 5e-4);
        assert!(sum.standard_error() < 0.02, "{}", sum.standard_error());
    }
}

#[test]
fn a_true_cache_halves_the_variance_of_a_cavity_and_saves_two_rays_of_three()
 {
    let setting = sphere(0.2, 0.8, 128);
    let (sum, _) = gather(&setting, &believer(4. / 9.), None, 4000);
    near(sum.variance(), 0.0316, 1e-3);
    near(weigh(&setting, 1, 64_000).variance(), 0.0648, 3e-3);
}

/// The variance of the pixels of a room with a window, and the rays of a
/// sample, for some step of the correction.
fn room_of_step(step: Option<f64>) -> (f64, f64) {
    let room = settings::named("room with a window");
    let sky = (room.rho, DVec3::Z);
    let setting = Setting::new(&room.mesh, sky, &room.view, 1.).unwrap();
    let (counts, scale) = (vec![4; 256], vec![0.42; 256]);
    let window = Film::new(16, 16).window;
    let allocation = &Allocation::new(window, counts, scale);
    let default = setting.gather((16, 16));
    let cache = &RadianceCache::empty(Grid::around(&[]));
    let gather = &Gather { seed: 9, training: 1 << 17, ..default };
    let (cache, _) =
        train(&tracer(gather, cache, allocation), &|_| true).unwrap();
    let correction =
        step.map(|step| Correction { step, ..Correction::default() });
    let gather =
        &Gather { seed: 4, correction, ..setting.gather((16, 16)) };
    let tracer = tracer(gather, &cache, allocation);
    let (pixels, _, rays) = scrambles(tracer, 100);
    let sum: f64 = pixels.iter().map(Accumulator::variance).sum();
    (sum / 256., rays)
}

// Two runs foresee the best step; others are worse by more than the parts in
// a hundred by which variances scatter.
#[test]
fn two_runs_foresee_the_best_step_of_a_correction() {
    let (variance, rays) = room_of_step(None);
    let (corrected, more) = room_of_step(Some(10.));
    let slope = (corrected - variance) / 10.;
    let cost = 10. * (more - rays);
    let best = (cost * variance / (rays * slope)).sqrt();
    near(best, 18., 0.1);
    let product = |step| {
        let (variance, rays) = room_of_step(Some(step));
        variance * rays
    };
    let [least, small, large] = [best, 3., 150.].map(product);
    near(rays * variance / least, 0.189, 1e-3);
    near(more * corrected / least, 1.10, 0.01);
    near(small / least, 2.1, 0.05);
    near(large / least, 3.7, 0.05);
    assert!(small > 1.5 * least && large > 1.5 * least);
}

#[test]
fn a_pixel_that_has_seen_nothing_is_believed_with_time() {
    // State the error of a blind pixel
    let stated = |n: u64| {
        let mut film = Film::new(5, 5);
        for (pixel, i) in film.pixels.iter_mut().zip(0..) {
            let ones = if i < 12 { n / 4 } else { 0 };
            pixel.add_times(1., ones);
            pixel.add_times(0., n - ones);
        }
        film.errors(NEIGHBOUR_WEIGHT, film.window)[12]
    };
    near(stated(16), 0.0363, 5e-5);
    near(stated(64), 0.0094, 5e-5);
}

#[test]
fn a_level_stands_for_an_interval_of_radiances() {
    let ends = vec![
        0.12743, 0.12745, 0.13013, 0.13014, //
        0.57757, 0.57759, 0.58407, 0.58409,
    ];
    let (.., levels) = pgm(&bytes(Format::Pgm, &Image::plain(8, 1, ends)));
    assert_eq!(levels, [99, 100, 100, 101, 199, 200, 200, 201]);
}

/// The tiles of a square image that see none of some triangles, from the
/// origin in the direction of the y axis, with a field of view of 90 degrees.
fn background(up: DVec3, triangles: &[Triangle]) -> KnownPixels {
    let (position, fov) = (DVec3::ZERO, 90.);
    let view = View { position, target: DVec3::Y, up, fov };
    let camera = Camera::new(&view, 1.).unwrap();
    let bvh = answers_scene::intersector(triangles);
    let sky = Sky::new(up);
    KnownPixels::background(&camera, &sky, (64, 64), position, &bvh)
}

#[test]
fn a_rolled_horizon_leaves_nine_tiles_constant() {
    let angle = 30f64.to_radians();
    let known = background(DVec3::new(angle.sin(), 0., angle.cos()), &[]);
    let content = |i: &u32| known.content((i % 4 * 16, i / 4 * 16));
    let sky = |i: &u32| content(i) == TileContent::Sky;
    let sky: Vec<_> = (0..16).filter(sky).collect();
    assert_eq!(sky, [3, 5, 6, 7, 8, 9, 12]);
}

#[test]
fn a_triangle_in_four_parts_is_seen_by_one_tile_less() {
    let point = |(r, u)| DVec3::new(r, 4., u);
    let [a, b, c] = [(1., 1.), (2.8, 1.), (1., 2.8)].map(point);
    let [d, e, f] = [(b + c) / 2., (a + c) / 2., (a + b) / 2.];
    let parts = [[a, f, e], [f, b, d], [e, d, c], [d, e, f]];
    let count = |t: &[Triangle]| background(DVec3::Z, t).count();
    assert_eq!(count(&[[a, b, c]]), (12, 16));
    assert_eq!(count(&parts), (13, 16));
}

#[test]
fn the_end_of_a_run_is_foreseen_with_what_it_may_not_have_seen() {
    let limits = Limits { error: Some(0.01), ..Limits::default() };
    let step = r#"{"spp": 16, "seconds": 1.0, "rays": 1, "rmse": 0.04,
        "mean": 0.5, "mean_stderr": 0.001}"#;
    let mut convergence = Convergence::default();
    convergence.spp = 16;
    convergence.curve.push(serde_json::from_str(step).unwrap());
    assert_eq!(convergence.expected(&limits, 76_800), Some(257));
    // What may be unseen asks for eleven more of ten pixels.
    assert_eq!(convergence.expected(&limits, 10), Some(268));
    assert_eq!(convergence.expected(&limits, 1), Some(1000));
    assert_eq!(Convergence::default().expected(&limits, 1), None);
}

#[test]
fn a_plane_is_believed_to_have_no_noise_after_35_samples() {
    let above = look(DVec3::new(0.3, 0.1, 2.), DVec3::ZERO, 20.);
    let setting = Setting::new(&plane(), (0.5, DVec3::Z), &above, 1.);
    let limits = Limits { error: Some(0.001), ..Limits::default() };
    let (mut film, mut convergence) =
        (Film::new(50, 50), Convergence::default());
    let setting = setting.unwrap();
    let stop =
        go_on(&mut setting.job(1), &mut convergence, &mut film, &limits);
    assert_eq!((stop, convergence.spp), (Stop::Error, 35));
    assert_eq!(film.summary().rmse, 0.);
}

#[test]
fn two_pixels_are_compared_by_hand() {
    let (a, b) = (row(&[(0.62, 0.02)], 16.), row(&[(0.56, 0.03)], 64.));
    let gap = compare(&a, &b).unwrap().sum;
    let freedom =
        0.0013f64.powi(2) / (0.02f64.powi(4) / 15. + 0.03f64.powi(4) / 63.);
    near(gap.z(), 0.06 / 0.0013f64.sqrt(), 1e-12);
    near(gap.freedom(), freedom, 1e-9);
    near(gap.z(), 1.66, 0.005);
    near(gap.freedom(), 71.8, 0.05);
}

#[test]
fn a_bias_that_is_everywhere_shows_in_the_mean_alone() {
    let all = |x| Image {
        errors: Some(vec![0.05; 307_200]),
        ..Image::plain(640, 480, vec![x; 307_200])
    };
    let failed = |bias| {
        let difference = compare(&all(0.5 + bias), &all(0.5)).unwrap();
        difference.scales.map(|scale| scale.failed)
    };
    assert_eq!(failed(3.84e-4), [0, 0, 0]);
    assert_eq!(failed(3.87e-4), [0, 0, 1]);
    assert_eq!(failed(0.39)[0], 0);
}

#[test]
fn a_ninth_of_a_sphere_lets_out_half_of_the_light() {
    near(cavity_radiance(0.9, 1. / 9.), 0.5, 1e-15);
    let pixel = weigh(&sphere(1. / 9., 0.9, 128), 1, 20_000);
    near(pixel.mean(), 0.5, 4.5 * pixel.standard_error());
}

#[test]
fn a_wall_above_a_plain_gets_half_of_its_light_from_there() {
    let wall =
        |cover| Sky::with(DVec3::Z, cover).irradiance_ratio(DVec3::X) + 0.1;
    near(wall(Cover::Uniform), 0.6, 1e-12);
    near(wall(Cover::Overcast), 0.496, 5e-4);
}
