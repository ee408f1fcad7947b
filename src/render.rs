// Tangled from chapters/render.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Filling an image with the samples of paths, on all threads.
//!
//! Neither their number nor their order changes a bit: a sample depends on
//! its pixel and its number alone, and the sums of a film are exact.
//!
//! Its bits belong to `SAMPLE_VERSION`.

pub mod choose;
pub mod trace;

use std::array;
use std::ops::Range;

use rayon::prelude::*;

use crate::analysis::background::{KnownPixels, TileContent};
use crate::bvh::{BEAM, Dispatch, Hit, Intersector};
use crate::film::{Contribution, Entry, Samples, add_halves, add_samples};
use crate::film::{Film, FilmTile, HalfBuffers, Tile, Watch};
use crate::film::{Fragments, TileFragments};
use crate::integrator::{Integrator, PathEvent};
pub use crate::integrator::{RankStats, Renderer};
use crate::sampler::{IndependentSampler, Sampler};
use crate::scene::Ray;
use crate::sensor::{Sensor, Starts};
use crate::statistics::Accumulator;

/// What is rendered by paths, and how.
pub struct Job<'a, K, E, S = IndependentSampler> {
    /// What starts the samples.
    pub sensor: &'a Sensor,
    /// Finds hits in the scene.
    pub intersector: &'a K,
    /// What is averaged.
    pub integrator: E,
    /// What is known of the image beforehand.
    pub known_pixels: &'a KnownPixels,
    /// Chooses the random numbers.
    pub sampler: S,
}

/// Pieces of work that each thread should find in an image.
const PIECES_PER_THREAD: usize = 32;

impl<K: Intersector, E: Integrator, S: Sampler> Renderer
    for Job<'_, K, E, S>
{
    fn pass(&mut self, film: &mut Film, end: u64, watch: &Watch) -> u64 {
        let net_size = self.sampler.net_size();
        assert_eq!(film.net_size, net_size, "replicates");
        let first = film.sample_offset / net_size;
        let end = first + end.div_ceil(net_size);
        let pass = Pass { job: self, resolution: film.resolution, watch };
        let tiles = film.tiles();
        let parts =
            PIECES_PER_THREAD * rayon::current_num_threads() / tiles.len();
        let render = |part: FilmTile| {
            let values = first + part.pixels[0].count()..end;
            pass.add(part, values, parts as u64).unwrap_or(0)
        };
        tiles.into_par_iter().with_max_len(1).map(render).sum()
    }
}

/// What the tiles of a pass have in common.
struct Pass<'a, K, E, S> {
    job: &'a Job<'a, K, E, S>,
    /// Width and height of the image.
    resolution: (u32, u32),
    watch: &'a Watch<'a>,
}

/// Values of the pixels of a tile.
#[derive(Default)]
struct TilePart {
    /// Their sums.
    pixels: Vec<Accumulator>,
    /// The rows of a tally, if there is one.
    rows: Vec<Vec<Entry>>,
    /// The halves of the fragments, if these are kept.
    halves: Vec<HalfBuffers>,
    /// The number of rays.
    rays: u64,
}

/// Paths that a thread has under way.
const IN_FLIGHT: usize = 4;

/// A path that has left a surface.
struct PathInFlight<P, S> {
    /// The state that its integrator keeps.
    path: P,
    sampler: S,
    /// Where it goes next.
    ray: Ray,
    /// The triangle that it leaves.
    from: u32,
    /// The pixel in its tile.
    pixel: u32,
    /// The fragment of the tile for which it counts, if for any.
    fragment: Option<u32>,
}

impl<K: Intersector, E: Integrator, S: Sampler> Pass<'_, K, E, S> {
    /// Adds the values of these numbers, means of replicates, to the pixels of
    /// a tile. Returns the number of rays, or none, with the pixels as they
    /// were, if the pass is stopped or there is nothing to do.
    fn add(
        &self,
        FilmTile { tile, pixels, rows, halves, fragments, .. }: FilmTile,
        values: Range<u64>,
        parts: u64,
    ) -> Option<u64> {
        if values.is_empty() || !(self.watch)(0) {
            return None;
        }
        let (count, mut rays) = (values.end - values.start, 0);
        let content = self.job.known_pixels.content(tile.corner);
        if let TileContent::Constant(sample) = content {
            pixels.iter_mut().for_each(|p| p.add_times(sample, count));
            // Add a known value to both halves
            for number in values.start..values.end.min(values.start + 2) {
                let samples = vec![([sample, 0.], 1); halves.len()];
                add_samples(halves, number, &samples);
            }
        } else {
            // Render the values in parts
            let size = count.div_ceil(parts.clamp(1, count));
            let render = |k: u64| {
                let start = values.start + k * size;
                let end = values.end.min(start + size);
                self.fill(tile, start..end, fragments)
            };
            let parts = (0..count.div_ceil(size)).into_par_iter();
            let done: Option<Vec<_>> = parts.map(render).collect();
            for part in done? {
                for (pixel, sum) in pixels.iter_mut().zip(&part.pixels) {
                    pixel.merge(sum);
                }
                for (row, more) in rows.iter_mut().zip(&part.rows) {
                    Entry::add_all(row, more);
                }
                add_halves(halves, &part.halves);
                rays += part.rays;
            }
        }
        let samples = count * self.job.sampler.net_size();
        (self.watch)(samples.saturating_mul(pixels.len() as u64));
        Some(rays)
    }

    /// Renders the values of these numbers of the pixels of a tile; none if it
    /// was stopped.
    fn fill(
        &self,
        tile: Tile,
        values: Range<u64>,
        fragments: Option<&Fragments>,
    ) -> Option<TilePart> {
        let trace = |samples| {
            let intersector = self.job.intersector;
            let trace = Trace { pass: self, tile, samples, fragments };
            intersector.dispatch(trace)
        };
        let net_size = self.job.sampler.net_size();
        let (parts, columns) = self.job.integrator.row_parts();
        if net_size == 1 && fragments.is_none() && parts == 0 {
            return trace(values).map(|Traced { pixels, rays, .. }| {
                TilePart { pixels, rays, ..TilePart::default() }
            });
        }
        // Begin the sums of a tile
        let kept = fragments.map_or(0, |it| it.count(&tile));
        let mut part = TilePart {
            pixels: vec![Accumulator::default(); tile.area()],
            halves: vec![HalfBuffers::default(); kept],
            ..TilePart::default()
        };
        if parts > 0 {
            part.rows.resize(tile.area(), vec![]);
        }
        for value in values {
            let net = trace(value * net_size..(value + 1) * net_size)?;
            for (sum, net) in part.pixels.iter_mut().zip(&net.pixels) {
                sum.add(net.mean());
            }
            add_samples(&mut part.halves, value, &net.sorted);
            part.rays += net.rays;
            // Add the contributions to the rows of a tally
            if parts > 0 {
                let first = (value % parts) as u32 * columns;
                Entry::append(&mut part.rows, net.contributions, first);
            }
        }
        part.rows = part.rows.into_iter().map(Entry::combined).collect();
        Some(part)
    }

    /// Begins the paths of a `batch`, each given by the number of a pixel in
    /// its tile and of a sample, and takes them to their first hits. Paths
    /// that end there are added to their pixels. Returns the number of rays.
    #[inline(always)]
    fn begin(
        &self,
        intersector: &impl Intersector,
        begun: &mut Vec<PathInFlight<E::Path, S>>,
        mut batch: impl Iterator<Item = (u32, u64)>,
        tile: Tile,
        fragments: Option<&TileFragments>,
        ended: &mut impl FnMut((u32, Option<u32>), (f64, f64), Tallied),
    ) -> u64 {
        let Job { sensor, known_pixels, integrator, .. } = self.job;
        // Choose a point of the image for each path
        let (width, _) = self.resolution;
        let mut places = [None; BEAM];
        let mut started: [_; BEAM] = array::from_fn(|i| {
            let (pixel, n) = batch.next()?;
            let x = tile.corner.0 + pixel % tile.size.0;
            let y = tile.corner.1 + pixel / tile.size.0;
            let number = u64::from(y) * u64::from(width) + u64::from(x);
            let mut sampler = self.job.sampler.start(number, n);
            places[i] = Some(((x, y), sampler.get_pixel_2d()));
            Some((pixel, sampler))
        });
        let sees_sky =
            known_pixels.content(tile.corner) == TileContent::Sky;
        let (surfaces, size) = (integrator.surfaces(), self.resolution);
        let Starts { directions, hits, transmittances, rays } =
            sensor.starts(intersector, &surfaces, &places, size, sees_sky);
        for i in 0..BEAM {
            // Advance a path from its first hit
            let Some((pixel, mut sampler)) = started[i].take() else {
                break;
            };
            let fragment =
                fragments.and_then(|it| it.place(pixel, hits[i].as_ref()?));
            let mut path =
                integrator.begin(directions[i], transmittances[i]);
            match integrator.advance(&mut path, hits[i], &mut sampler) {
                PathEvent::Scatter(ray, from) => {
                    let flight = PathInFlight {
                        path,
                        sampler,
                        ray,
                        from,
                        pixel,
                        fragment,
                    };
                    begun.push(flight);
                }
                PathEvent::Terminate(contribution) => {
                    let hit = hits[i].as_ref();
                    let tallied =
                        integrator.tally(&path, hit, contribution);
                    let value = (contribution, 0.);
                    ended((pixel, fragment), value, tallied);
                }
            }
        }
        rays
    }
}

/// Some samples of the pixels of a tile, to be traced.
struct Trace<'a, K, E, S> {
    pass: &'a Pass<'a, K, E, S>,
    tile: Tile,
    samples: Range<u64>,
    fragments: Option<&'a Fragments>,
}

/// The samples of the pixels of a tile.
struct Traced {
    /// The sums of the pixels.
    pixels: Vec<Accumulator>,
    /// The samples of its fragments, if these are kept.
    sorted: Vec<Samples>,
    /// The contributions of the samples in a tally.
    contributions: Vec<Contribution>,
    /// The number of rays.
    rays: u64,
}

/// The column of a path that has ended, and its weight, if it has one.
type Tallied = Option<(u32, f64)>;

impl<K: Intersector, E: Integrator, S: Sampler> Dispatch
    for Trace<'_, K, E, S>
{
    /// None if it was stopped.
    type Output = Option<Traced>;

    fn with<L: Intersector>(self, intersector: &L) -> Self::Output {
        let Self { pass, tile, samples, fragments } = self;
        let mut pixels = vec![Accumulator::default(); tile.area()];
        let fragments = fragments.map(|it| it.in_tile(&tile));
        let fragments = fragments.as_ref();
        let kept = fragments.map_or(0, |it| it.count);
        let mut sorted = vec![Samples::default(); kept];
        let (count, mut contributions) = (pixels.len() as u32, vec![]);
        let mut ended = |(pixel, fragment): (u32, _), value, tallied| {
            let (value, direct) = value;
            pixels[pixel as usize].add(value);
            if let Some((column, weight)) = tallied {
                contributions
                    .push(Contribution::new(pixel, column, weight));
            }
            if let Some::<u32>(fragment) = fragment {
                let (sums, count) = &mut sorted[fragment as usize];
                sums[0] += value - direct;
                *count += 1;
            }
        };
        // List the paths of the tile
        let each = move |pixel| samples.clone().map(move |n| (pixel, n));
        let mut to_begin = (0..count).flat_map(each).peekable();
        let mut begun = Vec::with_capacity(BEAM);
        let mut under_way = Vec::with_capacity(IN_FLIGHT);
        let (mut rays, mut turns) = (0, 0u64);
        let is_black = pass.job.integrator.is_black();
        let is_plain = pass.job.integrator.needs_only_surfaces();
        loop {
            // Start queued paths
            if begun.is_empty() && to_begin.peek().is_some() {
                let batch = to_begin.by_ref().take(BEAM);
                rays += pass.begin(
                    intersector,
                    &mut begun,
                    batch,
                    tile,
                    fragments,
                    &mut ended,
                );
            }
            while under_way.len() < IN_FLIGHT
                && let Some(flight) = begun.pop()
            {
                under_way.push(flight);
            }
            if under_way.is_empty() && to_begin.peek().is_none() {
                return Some(Traced {
                    pixels,
                    sorted,
                    contributions,
                    rays,
                });
            }
            turns += 1;
            if turns.is_multiple_of(256) && !(pass.watch)(0) {
                return None;
            }
            // Advance each path by one ray
            under_way.retain_mut(|flight| {
                rays += 1;
                let PathInFlight { path, sampler, ray, from, .. } = flight;
                let hit = if is_black {
                    let (point, normal) = (ray.origin, ray.direction);
                    let hit = Hit { point, normal, primitive: 0 };
                    intersector.is_occluded(ray, Some(*from)).then_some(hit)
                } else if is_plain {
                    let met = intersector.first_primitive(ray, Some(*from));
                    let (point, normal) = (ray.origin, -ray.direction);
                    met.map(|primitive| Hit { point, normal, primitive })
                } else {
                    intersector.first_hit(ray, Some(*from))
                };
                let integrator = &pass.job.integrator;
                match integrator.advance(path, hit, sampler) {
                    PathEvent::Scatter(next, left) => {
                        (*ray, *from) = (next, left);
                        return true;
                    }
                    PathEvent::Terminate(contribution) => {
                        let hit = hit.as_ref();
                        let tallied =
                            integrator.tally(path, hit, contribution);
                        let place = (flight.pixel, flight.fragment);
                        let value = (contribution, integrator.direct(path));
                        ended(place, value, tallied);
                    }
                }
                begun.pop().map(|next| *flight = next).is_some()
            });
        }
    }
}
