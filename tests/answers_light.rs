// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Answers to the book's exercises on paths, errors, images and runs, with
//! each number that their text states.

mod common;

// Name what the answers import
use std::collections::HashSet;
use std::f64::consts::{PI, TAU};
use std::io::Cursor;
use std::ops::Range;

use glam::DVec3;
use litpt::analysis::background::{
    BackgroundTiles, KnownPixels, TileContent,
};
use litpt::analysis::interior::*;
use litpt::gather::cache::{Grid, RadianceCache, Record, SKY};
use litpt::gather::guide::{self, BINS, Guide, bin, direction};
use litpt::gather::training::train;
use litpt::gather::{Allocation, Correction, Plan, Tracer};
use litpt::output::OutputTarget;
use litpt::report::Fit;
use litpt::sampler::sobol::{ScrambledNet, to_unit};
use litpt::{bvh::*, film::*, image::*, render::*};
use litpt::{camera::*, render_loop::*, state::checkpoint::*};
use litpt::{compare::compare, integrator::*};
use litpt::{sampler::*, scene::*, sky::*, statistics::*};
use litpt_book::closed_forms::*;
use litpt_book::settings;
use rand::{Rng, RngExt};

// Share a few tools among answers
/// A number is within some distance of what is printed.
#[track_caller]
fn near(value: f64, printed: f64, by: f64) {
    assert!((value - printed).abs() <= by, "{value}, not {printed}");
}

/// A cavity of albedo `rho` that is open over the share `f`.
fn sphere(f: f64, rho: f64, rings: u32) -> Setting {
    let view = look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 20.);
    Setting::new(&cavity(f, rings), (rho, DVec3::Z), &view, 1.).unwrap()
}

/// The first samples of one pixel.
fn weigh<E: Integrator, S: Sampler>(
    job: &mut Job<Bvh, E, S>,
    samples: u64,
) -> Accumulator {
    let mut film = Film::new(1, 1);
    job.pass(&mut film, samples, &|_| true);
    *film.pixel(0, 0)
}

/// The samples from some number on.
#[derive(Clone)]
struct Later(IndependentSampler, u64);

impl Later {
    fn job(
        setting: &Setting,
        first: u64,
    ) -> Job<'_, Bvh, &PathTracer, Self> {
        let Job { scene, intersector, camera, integrator, known, sampler } =
            setting.job(1);
        let sampler = Self(sampler, first);
        Job { scene, intersector, camera, integrator, known, sampler }
    }
}

impl Sampler for Later {
    fn replicate(&self) -> u64 {
        1
    }

    fn start(&self, pixel: u64, index: u64) -> Self {
        Self(self.0.start(pixel, index + self.1), self.1)
    }

    fn get_pixel_2d(&mut self) -> [u32; 2] {
        self.0.get_pixel_2d()
    }

    fn get_1d(&mut self, dimension: u64) -> f64 {
        self.0.get_1d(dimension)
    }

    fn get_2d(&mut self, dimension: u64) -> [f64; 2] {
        self.0.get_2d(dimension)
    }
}

/// An image with the same error and count, if any, in each pixel.
fn image(
    width: u32,
    means: Vec<f64>,
    error: Option<f64>,
    count: Option<f64>,
) -> Image {
    let all = |x: f64| vec![x; means.len()];
    let height = means.len() as u32 / width;
    let (errors, samples) = (error.map(all), count.map(all));
    Image { errors, samples, ..Image::plain(width, height, means) }
}

/// The status of a comparison, and what it complains of.
fn judge(
    place: &common::Scratch,
    a: &str,
    b: &str,
) -> (Option<i32>, String) {
    let mut command = place.command(env!("CARGO_BIN_EXE_ptimg"));
    let child = command.args(["diff", a, b]).spawn().unwrap();
    let run = common::finish(child);
    (run.status, run.stderr)
}

/// A run that ends when its error is small enough.
fn until(error: f64, interrupt: &Interrupt) -> Limits<'_> {
    Limits { error: Some(error), ..Limits::none(interrupt) }
}

// Answer the exercises on the estimator
#[test]
fn a_path_of_half_reflectivity_brings_one_of_five_weights() {
    let setting = sphere(0.5, 0.5, 16);
    let one = |n| weigh(&mut Later::job(&setting, n), 1).mean();
    let mut weights: Vec<f64> = (0..500).map(one).collect();
    weights.sort_by(f64::total_cmp);
    weights.dedup();
    assert_eq!(weights, [0., 0.0625, 0.125, 0.25, 0.5]);

    let (closed, mut film) = (sphere(0., 0.5, 16), Film::new(1, 1));
    let rays = closed.job(1).pass(&mut film, 20_000, &|_| true);
    near(rays as f64 / 20_000., 6., 0.05);
}

/// The weight of a path that leaves with probability `f` at each bounce,
/// and goes on with the chance `survival` from the twentieth bounce on.
fn stiff(f: f64, survival: fn(f64) -> f64, random: &mut impl Rng) -> f64 {
    let (mut weight, mut n) = (1., 1);
    while !happens(f, random.random()) {
        if n >= 20 {
            let chance = survival(f64::from(n));
            if !happens(chance, random.random()) {
                return 0.;
            }
            weight /= chance;
        }
        n += 1;
    }
    weight
}

#[test]
fn a_constant_chance_loses_the_light_of_long_paths_and_says_nothing() {
    // Average the weights of stiff paths
    let run = |survival| {
        let mut random = generator(2, 0, 0);
        let mut sum = Accumulator::default();
        (0..100_000)
            .for_each(|_| sum.add(stiff(0.002, survival, &mut random)));
        (sum.mean(), sum.standard_error())
    };
    let (halved, claim) = run(|_| 0.5);
    near(1. - 0.998f64.powi(37), 0.07, 0.005);
    assert!(halved < 0.2 && (1. - halved) / claim > 30., "{claim}");
    let (mean, error) = run(|n| (n / (n + 1.)).powf(1.5));
    near(error, 0.04, 0.01);
    near(mean, 1., 4. * error);
}

/// Adds the sky's light at each hit, of which a share `f` is sky.
struct Gather {
    rho: f64,
    f: f64,
}

impl Integrator for Gather {
    type Path = (f64, f64, u64);
    type RayQuery = Hit;

    fn begin(&self, _: DVec3) -> (f64, f64, u64) {
        (1., 0., 0)
    }

    // Gather light from hit to hit
    fn go_on(
        &self,
        (weight, light, bounces): &mut (f64, f64, u64),
        hit: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        let Some(hit) = hit else { return PathEvent::Terminate(*light) };
        *weight *= self.rho;
        *light += *weight * self.f;
        let [r, turn] = sampler.get_2d(dimension::direction(*bounces));
        *bounces += 1;
        let direction = cosine_direction(hit.normal, r, turn);
        PathEvent::Scatter(
            Ray { origin: hit.point, direction },
            hit.primitive,
        )
    }
}

#[test]
fn gathering_at_every_hit_pays_where_few_hits_matter() {
    for (rho, mean, found, gathered) in
        [(0.5, 1. / 3., 0.0317, 0.0079), (0.9, 9. / 11., 0.0113, 0.228)]
    {
        let setting = sphere(0.5, rho, 128);
        // Weigh with the other estimator
        let Job { scene, intersector, camera, known, sampler, .. } =
            setting.job(1);
        let integrator = Gather { rho, f: 0.5 };
        let mut job =
            Job { scene, intersector, camera, integrator, known, sampler };
        let own = weigh(&mut job, 20_000);
        let reference = weigh(&mut setting.job(1), 20_000);
        near(reference.variance() / found, 1., 0.1);
        near(own.variance() / gathered, 1., 0.1);
        near(own.mean(), mean, 4.5 * own.standard_error());
    }
}

// Answer the exercises on gathering
#[test]
fn a_bin_at_the_edge_is_four_times_as_large_as_one_in_the_middle() {
    // Cut a bin in the middle into small squares
    let side = |i: u32| (f64::from(i) + 0.5) / 512.;
    let (mut middle, first) = (0., 8 * guide::SIDE + 8);
    for (i, j) in (256..288).flat_map(|i| (256..288).map(move |j| (i, j))) {
        let at = [side(i), side(j)];
        assert_eq!(bin(at), first);
        middle += PI / direction(DVec3::Z, at).z / 512. / 512.;
    }
    near(middle, 0.0123, 1e-4);
    // Count uniform directions at the edge
    let (mut edge, mut highest) = ((HashSet::new(), 0), 0f64);
    let mut random = generator(6, 0, 0);
    for _ in 0..100_000 {
        let (z, turn) =
            (random.random::<f64>(), TAU * random.random::<f64>());
        let r = (1. - z * z).sqrt();
        let towards = DVec3::new(r * turn.cos(), r * turn.sin(), z);
        let b = bin(on_square(towards));
        let place = [b / guide::SIDE, b % guide::SIDE];
        if place.iter().any(|&i| i == 0 || i == guide::SIDE - 1) {
            edge.0.insert(b);
            edge.1 += 1;
            highest = highest.max(z);
        }
    }
    assert_eq!(edge.0.len(), 60);
    near(TAU * f64::from(edge.1) / 1e5 / 60., 0.0507, 8e-4);
    near(highest.asin().to_degrees(), 29., 0.1);
}

/// The variance of the weight of a ray of a guide, or of cosine sampling,
/// when these bins have the radiance 1 and the others 0.
fn window_variance(guide: Option<&Guide>, bins: Range<usize>) -> f64 {
    let (mut sum, mut random) =
        (Accumulator::default(), generator(3, 0, 0));
    for _ in 0..1_000_000 {
        let u = [random.random(), random.random()];
        let (b, weight) = match guide {
            Some(guide) => {
                let (_, b) = guide.warp(u);
                (b, 1. / guide.density(b))
            }
            None => (bin(u.map(to_unit)), 1.),
        };
        sum.add(if bins.contains(&b) { weight } else { 0. });
    }
    sum.variance()
}

#[test]
fn a_guide_to_a_closed_window_is_eight_times_as_noisy_as_none() {
    let mut bins = [0.; BINS];
    bins[100..104].fill(1.);
    let guide = Guide::new(&bins).unwrap();
    near(window_variance(None, 100..104), 0.0154, 3e-4);
    near(window_variance(Some(&guide), 100..104), 3.27e-5, 1e-6);
    near(window_variance(Some(&guide), 200..204), 0.130, 5e-3);
    let density = 0.88 * 64. + 0.12;
    near(1. / 64. / density - 1. / 4096., 3.27e-5, 1e-7);
}

#[test]
fn roots_of_mean_squares_are_the_best_density_of_two_bins() {
    let squares = [0.25, 1.];
    let second = |density: [f64; 2]| {
        let sum = density[0] + density[1];
        let part = |i: usize| squares[i] * sum / density[i] / 4.;
        part(0) + part(1) - 0.25
    };
    near(second([1., 1.]), 0.375, 1e-12);
    near(second([0.5, 1.]), 0.3125, 1e-12);
    let others = (1..100).map(|i| second([f64::from(i) / 100., 1.]));
    near(others.fold(1., f64::min), 0.3125, 1e-12);
}

/// The value of a cell, of whose records so many go to itself for each
/// that goes to the sky.
fn settled(to_itself: usize) -> f64 {
    let grid = Grid::around(&[]);
    let (p, normal) = (DVec3::splat(0.5), DVec3::Z);
    let from = grid.name(p, normal);
    let sky = Record { from, to: SKY, weight: 1., bin: 0 };
    let mut records = vec![sky];
    records.resize(1 + to_itself, Record { to: from, ..sky });
    let cache =
        RadianceCache::empty(grid).learn(&mut records, 1., &|_| true);
    f64::from(cache.at(from).value)
}

#[test]
fn an_iteration_that_has_settled_may_be_far_from_its_limit() {
    near(settled(1), 0.999, 5e-4);
    near(settled(99), 0.910, 5e-4);
    near(settled(999), 0.259, 5e-4);
    near(1. - 0.99f64.powi(240), 0.910, 5e-4);
    near(1. - 0.999f64.powi(300), 0.259, 5e-4);
}

/// A cache that says the same of all places within a unit of the origin.
fn believer(value: f32) -> RadianceCache {
    let far = [DVec3::splat(-1e6), DVec3::splat(1e6)];
    let grid = Grid::around(&far);
    let mut records = vec![];
    for (x, y, z) in (0..8).map(|i| (i & 1, i >> 1 & 1, i >> 2)) {
        let [x, y, z] = [x, y, z].map(|i| f64::from(2 * i - 1));
        for normal in DVec3::AXES.into_iter().flat_map(|a| [a, -a]) {
            let from = grid.name(DVec3::new(x, y, z), normal);
            records.push(Record { from, to: SKY, weight: value, bin: 0 });
        }
    }
    RadianceCache::empty(grid).learn(&mut records, 1., &|_| true)
}

/// What a gather finds in a small image of a setting: its samples without
/// a correction, or the means of its one tile; and the rays of a sample.
fn gather(
    setting: &Setting,
    albedo: f64,
    cache: &RadianceCache,
    correction: Option<Correction>,
    scrambles: u64,
) -> (Accumulator, f64) {
    let Job { scene, intersector, camera, known, .. } = setting.job(1);
    let sky = Sky::new(DVec3::Z);
    let mut tracer =
        Tracer { scene, intersector, camera, sky, albedo, cache, rays: 0 };
    let mut film = Film::new(4, 4);
    let tile = film.tiles()[0].0;
    let plan = Plan {
        resolution: film.resolution(),
        window: film.window(),
        known,
        allocation: &Allocation::even(film.area()),
        net: ScrambledNet::new(1),
        seed: 4,
        correction,
    };
    let mut sum = Accumulator::default();
    for scramble in 0..scrambles {
        let pixels = tracer.tile(&plan, tile, scramble);
        match correction {
            Some(_) => sum.add(pixels.iter().sum::<f64>() / 16.),
            None => pixels.into_iter().for_each(|value| sum.add(value)),
        }
    }
    (sum, tracer.rays as f64 / (16 * scrambles) as f64)
}

// Five standard errors, which chance exceeds with 6e-7; and the cavity is
// round to a few parts in ten thousand.
#[test]
fn a_believed_cache_passes_on_two_thirds_of_its_error() {
    let setting = sphere(0.2, 0.8, 128);
    let all = Correction { step: 1., ..Correction::default() };
    for (says, image) in [(1., 0.8), (0., 0.16), (4. / 9., 4. / 9.)] {
        let cache = believer(says);
        let (sum, rays) = gather(&setting, 0.8, &cache, None, 2000);
        near(sum.mean(), image, 5. * sum.standard_error() + 5e-4);
        near(rays, 2., 0.);
        let (sum, _) = gather(&setting, 0.8, &cache, Some(all), 1000);
        near(sum.mean(), 4. / 9., 5. * sum.standard_error() + 5e-4);
        assert!(sum.standard_error() < 0.02, "{}", sum.standard_error());
    }
}

#[test]
fn a_true_cache_halves_the_variance_of_a_cavity_and_saves_two_rays_of_three()
 {
    let setting = sphere(0.2, 0.8, 128);
    let (sum, _) = gather(&setting, 0.8, &believer(4. / 9.), None, 4000);
    near(sum.variance(), 0.0316, 1e-3);
    let paths = weigh(&mut setting.job(1), 64_000);
    near(paths.variance(), 0.0648, 3e-3);
}

#[test]
fn a_close_connection_is_noisy_with_its_own_density_alone() {
    // The plane in rings around the foot of the point at height h
    let h = 0.01f64;
    let form = |h: f64, s: f64| h * h / PI / (h * h + s * s).powi(2);
    let (mut alone, mut mean, mut both) = (0., 0., 0.);
    for k in -60_000..60_000 {
        let [s, t] = [k, k + 1].map(|k| libm::exp(f64::from(k) * 2e-4));
        let (ring, middle) = (PI * (t * t - s * s), (s * t).sqrt());
        let (one, other) = (form(h, middle), form(1., middle));
        mean += ring * one;
        alone += ring * one * one / other;
        both += ring * one * one / (one + other);
    }
    near(mean, 1., 1e-3);
    near(alone, 3334., 1.);
    near(both, 0.984, 1e-3);
}

#[test]
fn own_rays_make_a_histogram_darker() {
    // All four outcomes of two coins
    let mut mean = 0.;
    for coins in 0..4 {
        let rays = [coins & 1, coins >> 1];
        let density = |bin: i32| {
            let count = rays.iter().filter(|ray| **ray == bin).count();
            2. * (count as f64 + 1.) / 4.
        };
        mean +=
            rays.iter().map(|&ray| 0.5 / density(ray)).sum::<f64>() / 4.;
    }
    near(mean, 5. / 6., 1e-12);
}

#[test]
fn a_pilot_of_eight_costs_nine_per_cent() {
    for (m, cost) in [(4, 1.273), (8, 1.086)] {
        // The roots of estimated variances, and one over them
        let mut random = generator(5, m, 0);
        let (mut roots, mut inverse) = (0., 0.);
        for _ in 0..100_000 {
            let mut pilot = Accumulator::default();
            for _ in 0..m {
                let six = |_| random.random::<f64>();
                let normal = (0..12).map(six).sum::<f64>() - 6.;
                pilot.add(normal);
            }
            let root = pilot.variance().sqrt();
            roots += root;
            inverse += 1. / root;
        }
        near(roots * inverse / 1e10, cost, 0.01);
        let half = (m - 1) as f64 / 2.;
        let gamma = libm::tgamma(half + 0.5) * libm::tgamma(half - 0.5);
        near(gamma / libm::tgamma(half).powi(2), cost, 6e-4);
    }
}

/// The variance of the pixels of a room with a window, and the rays of a
/// sample, for some step of the correction.
fn room_of_step(step: Option<f64>) -> (f64, f64) {
    let room = settings::named("room with a window");
    let sky = (room.rho, DVec3::Z);
    let setting = Setting::new(&room.mesh, sky, &room.view, 1.).unwrap();
    let Job { scene, intersector, camera, known, .. } = setting.job(1);
    let (sky, albedo) = (Sky::new(DVec3::Z), room.rho);
    let cache = &RadianceCache::empty(Grid::around(&[]));
    let like =
        Tracer { scene, intersector, camera, sky, albedo, cache, rays: 0 };
    let (cache, _) = train(&like, 1 << 17, 9, &|_| true);
    let mut tracer = like.with(&cache);
    let mut film = Film::new(16, 16);
    let tile = film.tiles()[0].0;
    let allocation =
        &Allocation { counts: vec![4; 256], scale: vec![0.42; 256] };
    let plan = Plan {
        resolution: film.resolution(),
        window: film.window(),
        known,
        allocation,
        net: ScrambledNet::new(4),
        seed: 4,
        correction: step
            .map(|step| Correction { step, ..Correction::default() }),
    };
    let mut pixels = vec![Accumulator::default(); 256];
    for scramble in 0..100 {
        let values = tracer.tile(&plan, tile, scramble);
        pixels.iter_mut().zip(values).for_each(|(p, v)| p.add(v));
    }
    let sum: f64 = pixels.iter().map(Accumulator::variance).sum();
    (sum / 256., tracer.rays as f64 / 1024. / 100.)
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
    near(best, 14.7, 0.1);
    let product = |step| {
        let (variance, rays) = room_of_step(Some(step));
        variance * rays
    };
    let [least, small, large] = [best, 3., 150.].map(product);
    near(rays * variance / least, 0.183, 1e-3);
    near(more * corrected / least, 1.05, 0.01);
    near(small / least, 1.8, 0.05);
    near(large / least, 1.8, 0.05);
    assert!(small > 1.5 * least && large > 1.5 * least);
}

// Answer the exercises on statistics
#[test]
fn ten_weights_know_their_mean_to_a_quarter_of_it() {
    let mut pixel = Accumulator::default();
    [0.8, 0.64, 0., 0.8, 0., 0.512, 0.8, 0., 0.64, 0.8]
        .iter()
        .for_each(|&weight| pixel.add(weight));
    near(pixel.mean(), 0.4992, 1e-15);
    near(pixel.variance(), 0.1277, 5e-5);
    near(pixel.standard_error(), 0.113, 5e-4);
    assert_eq!((pixel.variance() / 1e-4).ceil(), 1278.);
}

#[test]
fn doubles_lose_a_variance_that_integers_keep() {
    // Compute a variance with doubles
    let weights = [1. - 1e-9, 1., 1. + 1e-9];
    let sum: f64 = weights.iter().sum();
    let squares: f64 = weights.iter().map(|w| w * w).sum();
    assert_eq!((3. * squares - sum * sum) / 6., 0.);
    let mut exact = Accumulator::default();
    weights.iter().for_each(|&weight| exact.add(weight));
    near(exact.variance() / 1e-18, 1., 1e-6);
}

#[test]
fn weights_up_to_256_can_be_added_until_the_count_is_full() {
    let full = |weight| {
        let mut pixel = Accumulator::default();
        pixel.add_times(weight, u64::MAX);
        (pixel.mean(), pixel.variance())
    };
    assert_eq!(full(256.), (256., 0.));
    assert_eq!(full(257.).1, f64::INFINITY);
}

#[test]
fn a_pixel_that_has_seen_nothing_is_believed_with_time() {
    // State the error of a blind pixel
    let stated = |n: u64| {
        let mut film = Film::new(5, 5);
        for (pixel, i) in film.stored_mut().iter_mut().zip(0..) {
            let ones = if i < 12 { n / 4 } else { 0 };
            pixel.add_times(1., ones);
            pixel.add_times(0., n - ones);
        }
        film.errors(WORTH)[12]
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
    let mut bytes = vec![];
    let image = image(8, ends, None, None);
    Format::Pgm.write(&image, &mut bytes).unwrap();
    let (_, _, levels) = common::pgm(&bytes);
    assert_eq!(levels, [99, 100, 100, 101, 199, 200, 200, 201]);
}

#[cfg(unix)]
#[test]
fn a_symbolic_link_leads_to_the_new_file_and_a_hard_link_to_the_old() {
    let place = common::Scratch::new();
    let file = place.path("monday");
    place.put("monday", "old");
    std::fs::hard_link(&file, place.path("copy")).unwrap();
    let link = place.path("latest");
    std::os::unix::fs::symlink(&file, &link).unwrap();
    // Write to the link and read all names
    let output = OutputTarget::file(&link, true).unwrap();
    output.write(&mut |out| out.write_all(b"new")).unwrap();
    assert!(link.is_symlink());
    let [latest, monday, copy] =
        ["latest", "monday", "copy"].map(|name| place.get(name));
    assert_eq!([latest, monday, copy], [b"new", b"new", b"old"]);
}

#[test]
fn the_same_realisations_twice_claim_less_error_than_there_is() {
    let setting = sphere(0.5, 0.5, 16);
    let render = |n| weigh(&mut setting.job(1), n);
    let join = |mut a: Accumulator, b| {
        a.merge(&b);
        a
    };
    let second = weigh(&mut Later::job(&setting, 4), 4);
    let first = render(4);
    assert_eq!(join(first, second), render(8));
    // Join a run with itself
    let twice = join(first, first);
    assert_eq!(twice.mean(), first.mean());
    let gain = twice.standard_error() / first.standard_error();
    near(gain, 0.65, 0.005);
    near(gain, f64::sqrt(3. / 7.), 1e-12);
}

// Answer the exercises on superfluous work
/// A cube.
const CUBE: &str = "\
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\n\
v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n\
f 1 2 3 4\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

#[test]
fn a_shortcut_is_tried_by_not_taking_it() {
    let place = common::Scratch::new();
    place.put("cube.obj", CUBE);
    let render = |name: &str, more: &[&str]| {
        let output = format!("-o{name}");
        let all = ["-icube.obj", "-p0,-6,2", "-t0,0,0", "-n64"];
        place
            .run(&[&all[..], &["-r.8", &output], more].concat())
            .succeeded();
        place.get(name)
    };
    let whole = render("whole.pfm", &["--keep-all"]);
    assert_eq!(render("less.pfm", &[]), whole);
}

// Answer the exercises on closed surfaces
#[test]
fn below_a_common_corner_one_triangle_of_four_is_above() {
    let [a, b, c, d] = [(-1., -1.), (1., -1.), (1., 1.), (-1., 1.)]
        .map(|(x, y)| DVec3::new(x, y, 1.));
    let [lower, right, upper, left] =
        [(a, b), (b, c), (c, d), (d, a)].map(|(p, q)| [p, q, DVec3::Z]);
    let ceiling = [lower, right, upper, left];
    assert_eq!(above(&ceiling, DVec3::ZERO), Ok(vec![3]));
}

/// A cube of n x n squares on each side, from -1 to 1.
fn cube(n: u32) -> Vec<Triangle> {
    let place = |p: [u32; 3]| {
        let at = |i| 2. * f64::from(i) / f64::from(n) - 1.;
        DVec3::from_array(p.map(at))
    };
    let square = |axis: usize, side: u32, i: u32| {
        // Cut a square of a face in two
        let corner = |a, b| {
            let mut p = [side; 3];
            p[(axis + 1) % 3] = i / n + a;
            p[(axis + 2) % 3] = i % n + b;
            place(p)
        };
        let [p, q, r, s] =
            [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(a, b)| corner(a, b));
        [[p, q, r], [p, r, s]]
    };
    let faces = (0..3).flat_map(|axis| [(axis, 0), (axis, n)]);
    let squares = faces.flat_map(|f| (0..n * n).map(move |i| (f, i)));
    squares.flat_map(|((axis, side), i)| square(axis, side, i)).collect()
}

#[test]
fn a_lid_of_finer_squares_leaves_a_cube_open() {
    let is_inside = |triangles: &[Triangle]| {
        is_inside(triangles, DVec3::new(0.3, 0.1, 0.2)).unwrap()
    };
    let is_lid = |t: &Triangle| t.iter().all(|corner| corner.z == 1.);
    let mut mixed = cube(1);
    mixed.retain(|t| !is_lid(t));
    mixed.extend(cube(2).iter().filter(|t| is_lid(t)));
    assert!(is_inside(&cube(1)) && is_inside(&cube(2)));
    assert!(!is_inside(&mixed));
    // Count the edges of a single triangle
    let mut single = HashSet::new();
    for &[a, b, c] in &mixed {
        for sum in [a + b, b + c, c + a].map(|sum| sum.as_ivec3()) {
            if !single.remove(&sum) {
                single.insert(sum);
            }
        }
    }
    assert_eq!(single.len(), 12);
}

// Answer the exercises on tiles
/// The tiles of a square image that see none of some triangles, from the
/// origin in the direction of the y axis, with a field of view of 90 degrees.
fn background(up: DVec3, triangles: &[Triangle]) -> BackgroundTiles {
    let (position, fov) = (DVec3::ZERO, 90.);
    let view = View { position, target: DVec3::Y, up, fov };
    let camera = Camera::new(&view, 1.).unwrap();
    let faces = (0..triangles.len() as u32).collect();
    let triangles = Triangles::apart(triangles, faces);
    let bvh =
        Bvh::of(triangles, Quality::Fast, Isa::best(), &|_| ()).unwrap();
    BackgroundTiles::new(&camera, Sky::new(up), (64, 64), position, &bvh)
}

#[test]
fn a_rolled_horizon_leaves_nine_tiles_constant() {
    let angle = 30f64.to_radians();
    let up = DVec3::new(angle.sin(), 0., angle.cos());
    let known = KnownPixels::Background(background(up, &[]));
    let content = |i: &u32| known.content((i % 4 * 16, i / 4 * 16));
    let sky = |i: &u32| content(i) == TileContent::Sky;
    let sky: Vec<_> = (0..16).filter(sky).collect();
    assert_eq!(sky, [3, 5, 6, 7, 8, 9, 12]);
}

#[test]
fn a_triangle_in_four_parts_is_seen_by_one_tile_less() {
    let point = |(r, u)| DVec3::new(r, 4., u);
    let corners = [(1., 1.), (2.8, 1.), (1., 2.8)];
    let [a, b, c] = corners.map(point);
    let [d, e, f] = [(b + c) / 2., (a + c) / 2., (a + b) / 2.];
    let parts = [[a, f, e], [f, b, d], [e, d, c], [d, e, f]];
    let size = (64, 64);
    let count = |t: &[Triangle]| background(DVec3::Z, t).count(size);
    assert_eq!(count(&[[a, b, c]]), (16, 12, 12 * 256));
    assert_eq!(count(&parts), (16, 13, 13 * 256));
}

// Answer the exercises on running and reporting
#[test]
fn an_error_a_quarter_as_large_takes_sixteen_times_as_long() {
    let time = |(t, e): (f64, f64), goal: f64| t * (e / goal).powi(2);
    let (first, second) = ((90., 0.02), (30., 0.03));
    near(time(first, 0.005), 1440., 1e-9);
    near(time(first, 0.001), 36_000., 1e-9);
    near(0.03 / f64::sqrt(3.), 0.0173, 5e-5);
    near(time(second, 0.005) / time(first, 0.005), 0.75, 1e-12);
    let curve = [0.02, 0.005, 0.001].map(|e| (time(first, e), e));
    let fit = Fit::of(&curve).unwrap();
    near(fit.slope, -0.5, 1e-12);
    near(fit.stderr, 0., 1e-12);
}

#[test]
fn the_error_of_the_reference_flattens_the_curve() {
    let error = |n: f64| (1. / n + 0.0025).sqrt();
    near(error(400.) / 0.05, 2f64.sqrt(), 1e-12);
    // Fit a slope to the true error
    let slope = |steps: &[f64]| {
        let points = steps.iter().map(|&n| (n, error(n)));
        Fit::of(&points.collect::<Vec<_>>()).unwrap().slope
    };
    near(slope(&[390., 400., 410.]), -0.25, 1e-3);
    let decade = [100., 160., 250., 400., 630.];
    let steps = [&decade[..], &decade.map(|n| 10. * n), &[10_000.]];
    near(slope(&steps.concat()), -0.163, 5e-4);
}

#[test]
fn the_end_of_a_run_is_foreseen_with_what_it_may_not_have_seen() {
    let interrupt = Interrupt::default();
    let limits = until(0.01, &interrupt);
    let step = r#"{"spp": 16, "seconds": 1.0, "rays": 1, "rmse": 0.04,
        "mean": 0.5, "mean_stderr": 0.001}"#;
    let mut convergence = Convergence::default();
    convergence.spp = 16;
    convergence.steps.push(serde_json::from_str(step).unwrap());
    assert_eq!(convergence.expected(&limits, 76_800), Some(257));
    let (v, unseen) = (0.0256f64, 12e-4f64);
    assert_eq!(((v + (v * v + unseen).sqrt()) / 2e-4).ceil(), 344.);
    assert_eq!(convergence.expected(&limits, 1), Some(1000));
    assert_eq!(Convergence::default().expected(&limits, 1), None);
}

#[test]
fn a_plane_is_believed_to_have_no_noise_after_35_samples() {
    let above = look(DVec3::new(0.3, 0.1, 2.), DVec3::ZERO, 20.);
    let setting = Setting::new(&plane(), (0.5, DVec3::Z), &above, 1.);
    let (interrupt, setting) = (Interrupt::default(), setting.unwrap());
    let limits = until(0.001, &interrupt);
    let (mut film, mut convergence) =
        (Film::new(50, 50), Convergence::default());
    let mut job = setting.job(1);
    let stop = convergence.run(
        &mut job,
        &mut film,
        &limits,
        &|_| (),
        &mut |_, _| (),
    );
    assert_eq!((stop, convergence.spp), (Stop::Error, 35));
    assert_eq!(film.summary().rmse, 0.);
}

#[test]
fn an_edited_checkpoint_is_damaged_and_not_of_another_run() {
    let (convergence, mut film) = (Convergence::default(), Film::new(3, 2));
    let mut file = vec![];
    let [known, meant] = [0, 3].map(settings::known);
    save(&known, &convergence, &film, &mut file).unwrap();
    let line = file[19..].iter().position(|&b| b == b'\n').unwrap() + 1;
    assert_eq!(file.len(), 19 + line + 64 * 6 + 32);
    let mut ask = |file: &[u8]| {
        let saved = Checkpoint::open(Cursor::new(file));
        let resumed =
            saved.and_then(|s| s.resume(&meant.run_key, &mut film));
        resumed.unwrap_err()
    };
    assert!(ask(&file).ends_with("its seed is 0, not 3"));
    // Change the seed by hand and ask again
    let digit = file.windows(7).position(|w| w == b"\"seed\":");
    file[digit.unwrap() + 7] = b'3';
    assert_eq!(ask(&file), "is damaged: its checksum is wrong");
}

#[test]
fn the_two_errors_differ_by_the_root_of_the_number_of_pixels() {
    near(0.0325 / f64::sqrt(480. * 360.), 0.000078, 5e-7);
    near((0.000078f64 / 1e-6).powi(2), 6084., 1e-6);
    let mut film = Film::new(7, 3);
    for (pixel, i) in film.stored_mut().iter_mut().zip(1..) {
        pixel.add_times(1., i);
        pixel.add_times(0., 100);
    }
    let Summary { rmse, mean_stderr, .. } = film.summary();
    near(rmse / mean_stderr, f64::sqrt(21.), 1e-12);
}

// Answer the exercises on comparing images
#[test]
fn two_pixels_are_compared_by_hand() {
    let a = image(1, vec![0.62], Some(0.02), Some(16.));
    let b = image(1, vec![0.56], Some(0.03), Some(64.));
    let gap = compare(&a, &b).unwrap().sum;
    near(gap.z(), 1.66, 0.005);
    near(gap.freedom(), 71.8, 0.05);
}

#[test]
fn one_pixel_of_a_million_is_noticed_from_5_96_errors_on() {
    let flat = vec![0.; 1_000_000];
    let exact = image(1000, flat.clone(), None, None);
    // Test one pixel among a million
    let is_noticed = |z| {
        let mut means = flat.clone();
        means[123_456] = z;
        let noisy = image(1000, means, Some(1.), None);
        let scales = compare(&noisy, &exact).unwrap().scales;
        scales.map(|scale| scale.failed)
    };
    let tail = |z: f64| libm::erfc(z / f64::sqrt(2.));
    near(tail(5.5) / tail(5.96), 15., 0.5);
    assert_eq!(is_noticed(5.96), [0, 0, 0]);
    assert_eq!(is_noticed(5.97), [1, 0, 0]);
}

#[test]
fn a_bias_that_is_everywhere_shows_in_the_mean_alone() {
    let all = |x| image(640, vec![x; 307_200], Some(0.05), None);
    let failed = |bias| {
        let difference = compare(&all(0.5 + bias), &all(0.5)).unwrap();
        difference.scales.map(|scale| scale.failed)
    };
    assert_eq!(failed(3.84e-4), [0, 0, 0]);
    assert_eq!(failed(3.87e-4), [0, 0, 1]);
    assert_eq!(failed(0.39)[0], 0);
}

#[test]
fn a_script_lets_pass_what_has_the_status_zero_and_no_warning() {
    let place = common::Scratch::new();
    let render = |name: &str, rho: &str, seed: &str| {
        let output = format!("-o{name}");
        let all = ["-iroom.obj", "-d32x24", "-n64", "-q", rho, seed];
        place.run(&[&all[..], &[&output]].concat()).succeeded();
    };
    render("old.exr", "-r.5", "-s1");
    render("new.exr", "-r.5", "-s2");
    render("wrong.exr", "-r.6", "-s3");
    render("again.exr", "-r.5", "-s1");
    // Judge the new images by the old one
    let verdict = |file| judge(&place, "old.exr", file);
    assert_eq!(verdict("new.exr"), (Some(0), String::new()));
    assert_eq!(verdict("wrong.exr"), (Some(1), String::new()));
    assert_eq!(verdict("absent.exr").0, Some(2));
    let (status, warning) = verdict("again.exr");
    assert_eq!(status, Some(0));
    assert!(warning.contains("share random numbers"), "{warning}");
}

// Answer the exercises on tests and extremes
#[test]
fn a_ninth_of_a_sphere_lets_out_half_of_the_light() {
    near(cavity_radiance(0.9, 1. / 9.), 0.5, 1e-15);
    let pixel = weigh(&mut sphere(1. / 9., 0.9, 128).job(1), 20_000);
    near(pixel.mean(), 0.5, 4.5 * pixel.standard_error());
}

#[test]
fn a_window_of_four_square_metres_is_an_eighth_of_the_light() {
    let corners = [(1., 1.), (-1., 1.), (-1., -1.), (1., -1.)];
    let window = corners.map(|(x, y)| DVec3::new(x, y, 3.));
    let share = polygon_share(DVec3::ZERO, DVec3::Z, &window);
    near(share, 0.1233, 5e-5);
    near(4. / (9. * std::f64::consts::PI), 0.141, 5e-4);
    // Tell whether a direction leaves the room
    let mut random = generator(1, 0, 0);
    let mut leaves = |_: &u32| {
        let (r, turn) = (random.random(), random.random());
        let p = cosine_direction(DVec3::Z, r, turn);
        (3. * p / p.z).truncate().abs().max_element() < 1.
    };
    let count = (0..100_000).filter(&mut leaves).count();
    near(count as f64 / 1e5, share, 0.005);
}

#[test]
fn uniform_directions_are_noticed_by_slopes_only() {
    let sky = Sky::new(DVec3::Z);
    let share = |cosine: f64| {
        // Count the uniform directions that see the sky
        let sine = (1. - cosine * cosine).sqrt();
        let normal = DVec3::new(sine, 0., cosine);
        let mut random = generator(1, 0, 0);
        let mut up = |_: &u32| {
            let (height, turn) = (random.random::<f64>(), random.random());
            let r = 1. - height * height;
            sky.radiance(cosine_direction(normal, r, turn)) == 1.
        };
        (0..100_000).filter(&mut up).count() as f64 / 1e5
    };
    for (cosine, uniform) in
        [(1., 1.), (0.6, 0.705), (0., 0.5), (-0.6, 0.295), (-1., 0.)]
    {
        near(share(cosine), uniform, 0.008);
        let differs = (sky.share(DVec3::Z * cosine) - uniform).abs() > 0.09;
        assert_eq!(differs, cosine.abs() == 0.6);
    }
}

/// A horizontal square of `n` by `n` pairs of triangles.
fn grid(n: u32) -> Mesh {
    let point =
        |i| DVec3::new(f64::from(i % (n + 1)), f64::from(i / (n + 1)), 0.);
    let pair = |i| {
        let (a, c) =
            (i / n * (n + 1) + i % n, (i / n + 1) * (n + 1) + i % n);
        [[a, a + 1, c], [a + 1, c + 1, c]]
    };
    let vertices = (0..(n + 1) * (n + 1)).map(point).collect();
    Mesh {
        vertices,
        triangles: (0..n * n).flat_map(pair).collect(),
        joined: vec![],
    }
}

#[test]
fn far_away_single_precision_has_two_of_nine_places() {
    let mut places: Vec<f32> =
        (0..9).map(|i| (1e7 + f64::from(i) / 8.) as f32).collect();
    places.dedup();
    assert_eq!(places, [1e7, 1e7 + 1.]);
    let mut mesh = grid(8);
    mesh.vertices.iter_mut().for_each(|v| *v *= 0.125);
    let here = Scene::new(&mesh);
    mesh.vertices.iter_mut().for_each(|v| *v += 1e7);
    assert_eq!(Scene::new(&mesh).triangles(), here.triangles());
}

// Answer the exercises on honest errors
#[test]
fn sixteen_rare_weights_cover_the_truth_in_five_cases_of_nine() {
    let (mut chance, mut covered) = (0.95f64.powi(16), 0.);
    near(chance, 0.440, 5e-4);
    for k in 0..16 {
        // Count the pixel if it covers the truth
        let mut pixel = Accumulator::default();
        pixel.add_times(1., k);
        pixel.add_times(0., 16 - k);
        let z = (pixel.mean() - 0.05) / pixel.standard_error();
        if z.abs() <= 1.96 {
            covered += chance;
            assert!((1..=4).contains(&k));
        }
        chance *= (16 - k) as f64 / (k + 1) as f64 * 0.05 / 0.95;
    }
    near(covered, 0.559, 5e-4);
    near(f64::sqrt(4. * 0.0475 / (16. * 19.)), 0.025, 1e-12);
}

#[test]
fn the_natural_rule_loses_its_light_in_two_samples() {
    let (mut mean, mut at_once) = (Accumulator::default(), 0);
    for seed in 0..20_000 {
        // Toss coins until the rule is satisfied
        let (mut pixel, mut random) =
            (Accumulator::default(), generator(7, seed, 0));
        while pixel.count() < 2 || pixel.standard_error() > 0.02 {
            let weight = happens(0.05, random.random());
            pixel.add(f64::from(u8::from(weight)));
        }
        mean.add(pixel.mean());
        at_once += u32::from(pixel.count() == 2);
    }
    near(f64::from(at_once) / 2e4, 0.905, 0.01);
    near(mean.mean(), 0.0073, 0.002);
}

/// The point of the square that [`direction`] takes to `towards`, around the
/// z axis: the other way through the map.
fn on_square(towards: DVec3) -> [f64; 2] {
    // The tangent at the z axis is the x axis, the bitangent the y axis.
    let DVec3 { x, y, .. } = towards;
    let radius = x.hypot(y).min(1.);
    let (a, b) = if x.abs() > y.abs() {
        let a = radius.copysign(x);
        (a, a * (y / x).atan() * 4. / PI)
    } else {
        let b = radius.copysign(y);
        (b * (x / y).atan() * 4. / PI, b)
    };
    [a, b].map(|c| 0.5 * c + 0.5)
}

// Answer the exercises on the time to an error
#[test]
fn a_tenth_of_the_time_shows_a_start_twice() {
    let b = 3.;
    let (peer, ours) = (|t| b / t, |t| b / 5. / (t - 1.));
    near(peer(1.25), ours(1.25), 1e-12);
    for (t, sooner, tenth) in [(20., 4., 2.5), (200., 4.88, 4.75)] {
        let same = 1. + t / 5.;
        near(ours(same), peer(t), 1e-12);
        near(t / same, sooner, 5e-3);
        near(t / same, 5. / (1. + 5. / t), 1e-12);
        let ratio = peer(t) * t / (ours(t / 10.) * t / 10.);
        near(ratio, tenth, 1e-12);
        near(ratio, 5. * (1. - 10. / t), 1e-12);
    }
}

#[test]
fn a_median_of_five_images_has_not_seen_what_is_rare() {
    let none = (1f64 - 1e-6).powi(96 * 72 * 16);
    near(none, 0.895, 5e-4);
    let mut pixel = Accumulator::default();
    pixel.add_times(0., 15);
    pixel.add(1000.);
    let square = pixel.standard_error().powi(2);
    near(square, (1000f64 / 16.).powi(2), 1e-9);
    near((square / (96. * 72.)).sqrt(), 0.75, 5e-3);
    let some = 1. - none;
    let median = none.powi(3) * 10. * some * some
        + none.powi(4) * 5. * some
        + none.powi(5);
    near(median, 0.990, 5e-4);
    near(none.powi(5), 0.575, 5e-4);
}
