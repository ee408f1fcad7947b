// Tangled from chapters/training.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Learns a cache from paths, and the samples of pixels from a pilot.
//!
//! Its bits belong to `GATHER_VERSION`.

use std::mem::take;

use bytemuck::{Pod, bytes_of, cast_slice, pod_read_unaligned};
use glam::DVec3;
use rand::RngExt;
use rayon::prelude::*;

use super::cache::{Grid, RadianceCache, Record, SUN, WHOLE};
use super::cache::{in_patch, in_sky};
use super::{Allocation, End, Gather, GatherRay, TileSamples, Tracer};
use crate::bvh::{Hit, Intersector};
use crate::film::add_samples;
use crate::film::{ErrorNorm, Film, Gathered, HalfBuffers, Tile, Watch};
use crate::sampler::generator;
use crate::statistics::Accumulator;
use crate::tally::patches::Patches;

/// Reflections of a training path.
const REFLECTIONS: usize = 7;

/// Paths that are followed side by side.
const BATCH: u64 = 64;

/// Numbers the generators of training; those of tiles are smaller.
const TRAINING: u64 = u64::MAX;

impl<K: Intersector> Tracer<'_, K> {
    /// The records of a piece of the training, from paths of about so many
    /// rays; `visit` gets each point that reflects. Fewer if `watch`, which
    /// gets the rays, stops it.
    fn explore(
        &mut self,
        rays: u64,
        piece: u64,
        mut visit: impl FnMut(DVec3),
        watch: &Watch,
    ) -> Vec<Record> {
        let mut random = generator(self.gather.seed, TRAINING, piece);
        let mut records = Vec::with_capacity(rays as usize);
        let (grid, surfaces) = (self.cache.grid, self.gather.view.surfaces);
        let has_sun = self.gather.view.sky.has_sun();
        let share = if has_sun { 2. } else { 1. };
        let (mut paths, mut reported) = (0, 0);
        while paths + self.rays < rays && watch(self.rays - reported) {
            reported = self.rays;
            // Start some paths
            let begun = (0..BATCH).filter_map(|_| {
                self.trace_primary(random.random(), random.random())
            });
            let mut hits: Vec<_> = begun.collect();
            paths += BATCH;
            for _ in 0..REFLECTIONS {
                // Choose the sides of sheets
                if surfaces.transmits {
                    for y in &mut hits {
                        *y = surfaces.lit_side(y, &mut random.random());
                    }
                }
                // Look up the cells of all hits
                let look_up = |y: &Hit| {
                    let from = grid.name(y.point, y.normal);
                    (from, *self.cache.at(from))
                };
                let cells: Vec<_> = hits.iter().map(look_up).collect();
                for (y, (from, cell)) in take(&mut hits).iter().zip(cells) {
                    visit(y.point);
                    // Record the light of the sun
                    if has_sun {
                        let light = self.sunlight(y, &mut random);
                        records.push(Record {
                            from,
                            to: in_sky(light),
                            weight: 2.,
                            bin: SUN,
                            relative_albedo: WHOLE,
                        });
                    }
                    // Record a reflection on the way
                    let u = [random.random(), random.random()];
                    let GatherRay { direction, weight, bin, end } = self
                        .trace_gather_ray(y, self.cache.guide(&cell), u);
                    let (to, relative_albedo) = match end {
                        End::Sky(radiance) => {
                            let patch = |it: &Patches| it.number(direction);
                            let to = match self.gather.patches.map(patch) {
                                Some(patch) => in_patch(patch),
                                None => in_sky(radiance),
                            };
                            (to, 1.)
                        }
                        End::Hit(hit) => {
                            hits.push(hit);
                            let u = [random.random(), random.random()];
                            let to = self.name_around(&hit, u);
                            (to, surfaces.relative_albedo(hit.primitive))
                        }
                    };
                    let (weight, bin) =
                        ((share * weight) as f32, bin as u16);
                    let relative_albedo =
                        (relative_albedo * f64::from(WHOLE)).round() as u16;
                    records.push(Record {
                        from,
                        to,
                        weight,
                        bin,
                        relative_albedo,
                    });
                }
            }
        }
        records
    }
}

/// Appends what all processes find in so many pieces to `found`, and
/// returns their rays; none if `watch`, which gets the rays of the others,
/// stops one.
fn find_together<T: Pod + Send>(
    prototype: &Gather,
    pieces: usize,
    find: impl Fn(usize) -> (Vec<T>, u64) + Sync,
    found: &mut Vec<T>,
    watch: &Watch,
) -> Option<u64> {
    let (place, of) = prototype.communicator.rank_and_size();
    let range = pieces * place / of..pieces * (place + 1) / of;
    let (found_here, rays): (Vec<_>, Vec<_>) =
        range.into_par_iter().map(&find).unzip();
    let found_here: Vec<T> = found_here.into_iter().flatten().collect();
    let rays = rays.iter().sum::<u64>();
    // Exchange the rays and the findings
    let counts = if watch(0) { bytes_of(&rays) } else { &[] };
    let counts = prototype.communicator.all_gather(counts, watch);
    let counts = counts.chunks_exact(size_of::<u64>());
    if counts.len() < of {
        return None;
    }
    let total = counts.map(pod_read_unaligned::<u64>).sum::<u64>();
    watch(total - rays);
    let bytes =
        prototype.communicator.all_gather(cast_slice(&found_here), watch);
    let each = bytes.chunks_exact(size_of::<T>());
    found.extend(each.map(pod_read_unaligned::<T>));
    Some(total)
}

/// Pieces of a round, each of which a thread traces by itself.
const PIECES: u64 = 64;

/// The part of the rays that each round traces, in per cent.
const ROUNDS: [u64; 3] = [15, 25, 60];

/// By how much the last round must be expected to reduce the error.
const LEAST_FALL: f32 = 0.036;

/// Learns a cache with tracers like this one; returns it and the rays, or
/// none if `watch`, which gets the rays, stops it.
pub fn train<K: Intersector>(
    prototype: &Tracer<K>,
    watch: &Watch,
) -> Option<(RadianceCache, u64)> {
    let &Gather { view, patches, training: rays, .. } = prototype.gather;
    // Choose the grid after a first look
    let mut scout = Tracer { rays: 0, ..*prototype };
    let mut points = vec![];
    let visit = |point| points.push(point);
    scout.explore(rays.min(10_000), u64::MAX, visit, watch);
    let grid = Grid::around(&points);
    let columns = patches.map_or(0, Patches::count) as usize;
    let grid = if columns > 0 { grid.wider(2) } else { grid };
    let mut cache = RadianceCache { columns, ..RadianceCache::empty(grid) };
    let (mut records, mut traced) = (vec![], scout.rays);
    for (round, percent) in (0..).zip(ROUNDS) {
        // Trace the pieces of a round
        let rays_each = rays * percent / 100 / PIECES;
        let explore = |piece| {
            let piece = round * PIECES + piece as u64;
            let mut tracer =
                Tracer { cache: &cache, rays: 0, ..*prototype };
            let records = tracer.explore(rays_each, piece, |_| (), watch);
            (records, tracer.rays)
        };
        let (found, pieces) = (&mut records, PIECES as usize);
        traced +=
            find_together(prototype.gather, pieces, explore, found, watch)?;
        let before = cache.relative_error;
        cache = cache.learn(&mut records, view.surfaces.most as f32, watch);
        let now = cache.relative_error;
        let is_enough = now * (1. - now / before) < LEAST_FALL;
        if columns == 0 && round == 1 && is_enough {
            break;
        }
    }
    if columns > 0 {
        cache.learn_rows(&records, view.surfaces.most as f32);
        if view.surfaces.has_sheets() {
            cache.scale_rows();
        }
    }
    Some((cache, traced))
}

/// Samples of each pixel in the pilot of an allocation; the pilot that
/// chooses a method is another.
pub const PILOT_SAMPLES: u64 = 8;

/// The findings of a pilot.
pub struct Found {
    /// Mean and variance of the pixels, tile by tile.
    pub pixels: Vec<[f64; 2]>,
    /// The light gathered for the fragments of each tile, if these are known.
    pub gathered: Vec<Vec<Gathered>>,
    /// Its rays.
    pub rays: u64,
}

/// Renders the pilot of the tiles of a run, or of those of a film alone;
/// none if `watch`, which gets the rays, stops it.
pub fn pilot<K: Intersector>(
    prototype: &Tracer<K>,
    film: &Film,
    only_here: bool,
    watch: &Watch,
) -> Option<Found> {
    let shown = film.fragments.as_deref();
    let tiles = film.run_tiles();
    let count = |&(_, place): &(Tile, Option<usize>)| {
        place.map_or(0, |place| film.halves[place].len())
    };
    let counts: Vec<usize> = match shown {
        Some(_) => tiles.iter().map(count).collect(),
        None => vec![0; tiles.len()],
    };
    // Render the scrambles of the pilot
    let render = |k: usize| {
        let (tile, place) = tiles[k];
        let fragments = shown.filter(|_| counts[k] > 0);
        let mut tracer = Tracer { rays: 0, fragments, ..*prototype };
        let mut pixels = vec![Accumulator::default(); tile.area()];
        let mut halves = vec![HalfBuffers::default(); counts[k]];
        let is_wanted = place.is_some() || !only_here;
        let most = if is_wanted { PILOT_SAMPLES } else { 0 };
        let (mut scrambles, mut reported) = (0..most, 0);
        while let Some(scramble) = scrambles.next()
            && watch(tracer.rays - reported)
        {
            reported = tracer.rays;
            let TileSamples { means, sorted, .. } =
                tracer.tile(tile, scramble);
            pixels.iter_mut().zip(means).for_each(|(p, v)| p.add(v));
            add_samples(&mut halves, scramble, &sorted);
        }
        let found = pixels.iter().flat_map(|p| [p.mean(), p.variance()]);
        let gathered = halves.as_flattened().iter();
        let gathered = gathered.flat_map(|half| [half[0], half[2]]);
        let words = found.map(f64::to_bits);
        let words = words.chain(gathered.map(i64::cast_unsigned));
        (words.collect::<Vec<u64>>(), tracer.rays)
    };
    let mut words = vec![];
    let rays = find_together(
        prototype.gather,
        tiles.len(),
        render,
        &mut words,
        watch,
    )?;
    // Decode the findings of each tile
    let mut words = words.into_iter();
    let mut word = || words.next().unwrap_or_default();
    let (mut pixels, mut gathered) = (vec![], vec![]);
    for ((tile, _), count) in tiles.iter().zip(counts) {
        let pixel = |_| [word(), word()].map(f64::from_bits);
        pixels.extend((0..tile.area()).map(pixel));
        let mut half = || [word(), word()].map(u64::cast_signed);
        let fragment = |_| [half(), half()];
        let fragments: Vec<_> = (0..count).map(fragment).collect();
        gathered.extend(shown.map(|_| fragments));
    }
    Some(Found { pixels, gathered, rays })
}

/// Samples for each pixel of the window of a film's run, one replicate on
/// average, proportional to the standard deviation that a pilot has found.
/// None if `watch` stops it.
pub fn allocate<K>(
    prototype: &Tracer<K>,
    film: &Film,
    found: &[[f64; 2]],
    watch: &Watch,
) -> Option<Allocation> {
    let (window, mean) = (film.run_window, film.net_size);
    // Sort the findings by rows
    let mut found = found.iter();
    let mut means = vec![0.; window.area()];
    let mut variances = means.clone();
    for tile in film.all_tiles() {
        for (pixel, &[mean, variance]) in
            (0..tile.area() as u32).zip(&mut found)
        {
            let (_, _, number) = prototype.allocation.place(tile, pixel);
            (means[number], variances[number]) = (mean, variance);
        }
    }
    let middle = average(&means);
    let least = if middle > 0. { 0.1 * middle } else { 1. };
    let scale: Vec<f64> = means.iter().map(|m| m.max(least)).collect();
    // Compute the need of each pixel
    let ErrorNorm { relative, largest } = prototype.gather.norm;
    let squares: Vec<f64> = scale.iter().map(|s| s * s).collect();
    let common = 0.5 * average(&variances) / average(&squares);
    let (width, height) = (window.size.0 as usize, window.size.1 as usize);
    let need = |i: usize| {
        // Add up the variances around a pixel
        let near = |at: usize, end| at.saturating_sub(1)..(at + 2).min(end);
        let (mut sum, mut count) = (0., 0.);
        for y in near(i / width, height) {
            for x in near(i % width, width) {
                sum += variances[y * width + x];
                count += 1.;
            }
        }
        let variance = 0.5 * variances[i] + 0.5 * (sum / count);
        let deviation = (variance + common * squares[i]).sqrt();
        let part = if relative { deviation / scale[i] } else { deviation };
        if largest { part * part } else { part }
    };
    let rows = (0..height).into_par_iter().filter(|_| watch(0));
    let pixels = rows.map(|y| y * width..(y + 1) * width);
    let needs = pixels.flat_map_iter(|row| row.map(need));
    let needs: Vec<f64> = needs.collect();
    let middle = average(&needs).max(f64::MIN_POSITIVE);
    let count = |need: &f64| {
        let part = (need / middle).clamp(0.1, 8.);
        (part * mean as f64).round().max(1.) as u32
    };
    let counts = needs.iter().map(count).collect();
    watch(0).then(|| Allocation::new(window, counts, scale))
}

fn average(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}
