// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Learns a cache from paths, and the samples of pixels from a pilot.

// Name what training imports
use rand::RngExt;
use rayon::prelude::*;

use super::cache::{DARKNESS, Grid, RadianceCache, Record, SKY};
use super::{Allocation, End, Plan, Tracer};
use crate::bvh::Intersector;
use crate::film::Film;
use crate::sampler::generator;

// Train a cache
/// Pieces of a round, each of which a thread traces by itself.
const PIECES: u64 = 64;

/// Reflections of a training path.
const REFLECTIONS: usize = 5;

/// The parts of the records after which the cache is solved anew.
const ROUNDS: [f64; 3] = [0.15, 0.4, 1.];

impl<K: Intersector> Tracer<'_, K> {
    /// The records of paths of about so many rays.
    fn explore(
        &mut self,
        rays: u64,
        seed: u64,
        piece: u64,
    ) -> (Vec<Record>, Vec<glam::DVec3>) {
        let mut random = generator(seed, u64::MAX, piece);
        let (mut records, mut points) = (vec![], vec![]);
        let grid = *self.cache.grid();
        while self.rays < rays {
            self.rays += 1;
            let mut end = self.look(random.random(), random.random());
            for _ in 0..REFLECTIONS {
                let End::Hit(y) = end else { break };
                points.push(y.point);
                let from = grid.name(y.point, y.normal);
                let cell = *self.cache.at(from);
                let u = [random.random::<u32>(), random.random()];
                let shot = self.shoot(&y, self.cache.guide(&cell), u);
                let to = match &shot.end {
                    End::Sky(radiance) if *radiance > 0. => SKY,
                    End::Sky(_) => DARKNESS,
                    End::Hit(z) => {
                        let u = [random.random(), random.random()];
                        grid.near(z.point, z.normal, u)
                    }
                };
                records.push(Record {
                    from,
                    to,
                    weight: shot.weight as f32,
                    bin: shot.bin as u16,
                });
                end = shot.end;
            }
        }
        (records, points)
    }
}

/// Learns a cache from about so many rays; returns it and the rays.
pub fn train<K: Intersector>(
    like: &Tracer<K>,
    rays: u64,
    seed: u64,
) -> (RadianceCache, u64) {
    // A first look chooses the grid.
    let empty = RadianceCache::empty(Grid::around(&[]));
    let mut scout = like.with(&empty);
    let (_, points) = scout.explore(rays.min(10_000), seed, u64::MAX);
    let mut cache = RadianceCache::empty(Grid::around(&points));
    let (mut records, mut traced) = (vec![], scout.rays);
    let mut before = 0.;
    for (round, part) in ROUNDS.into_iter().enumerate() {
        let share = ((part - before) * rays as f64) as u64 / PIECES;
        before = part;
        let first = round as u64 * PIECES;
        let pieces = (first..first + PIECES).into_par_iter().map(|piece| {
            let mut tracer = like.with(&cache);
            let (records, _) = tracer.explore(share, seed, piece);
            (records, tracer.rays)
        });
        let pieces: Vec<_> = pieces.collect();
        for (more, rays) in pieces {
            records.extend(more);
            traced += rays;
        }
        cache = RadianceCache::learn(
            *cache.grid(),
            &mut records,
            like.albedo as f32,
        );
    }
    (cache, traced)
}

// Allocate the samples
/// Samples of each pixel in the pilot.
const PILOT: u64 = 8;

/// Samples for each pixel, `mean` on average, in proportion to the standard
/// deviation that a pilot finds on the empty `film`; and its rays.
pub fn allocate<K: Intersector>(
    like: &Tracer<K>,
    plan: &Plan,
    mut film: Film,
    mean: u64,
) -> (Allocation, u64) {
    let rays = film.tiles().into_par_iter().map(|(tile, pixels)| {
        let mut tracer = like.with(like.cache);
        for scramble in 0..PILOT {
            let values = tracer.tile(plan, tile, scramble);
            pixels.iter_mut().zip(values).for_each(|(p, v)| p.add(v));
        }
        tracer.rays
    });
    let rays = rays.sum();
    let variances: Vec<f64> = film.rows().map(|p| p.variance()).collect();
    let means: Vec<f64> = film.means().collect();
    let mean_radiance = average(&means);
    let floor = if mean_radiance > 0. { 0.1 * mean_radiance } else { 1. };
    let scale: Vec<f64> = means.iter().map(|m| m.max(floor)).collect();
    let deviations = deviations(&film, &variances, &scale);
    let middle = average(&deviations).max(f64::MIN_POSITIVE);
    let count = |d: &f64| {
        let share = (d / middle).clamp(0.1, 8.);
        (share * mean as f64).round().max(1.) as u32
    };
    let counts = deviations.iter().map(count).collect();
    (Allocation { counts, scale }, rays)
}

fn average(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

/// The standard deviations of the pixels.
fn deviations(film: &Film, variances: &[f64], scale: &[f64]) -> Vec<f64> {
    let (width, height) = (film.width() as usize, film.height() as usize);
    let squares: Vec<f64> = scale.iter().map(|s| s * s).collect();
    let common = 0.5 * average(variances) / average(&squares);
    let near =
        |at: usize, end: usize| at.saturating_sub(1)..(at + 2).min(end);
    let deviation = |i: usize| {
        let (mut sum, mut count) = (0., 0.);
        for y in near(i / width, height) {
            for x in near(i % width, width) {
                sum += variances[y * width + x];
                count += 1.;
            }
        }
        (0.5 * variances[i] + 0.5 * sum / count + common * squares[i])
            .sqrt()
    };
    (0..variances.len()).map(deviation).collect()
}
