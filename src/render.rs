// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Filling an image with samples, on all threads.

pub mod choice;
pub mod gather;
pub mod method;

use std::array;
use std::ops::Range;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::analysis::background::{KnownPixels, TileContent};
use crate::bvh::{BEAM, Dispatch, Intersector};
use crate::camera::Camera;
use crate::film::{Film, Tile, Watch};
use crate::integrator::{Integrator, PathEvent, RayQuery};
use crate::sampler::{IndependentSampler, Sampler, within};
use crate::scene::{Entrance, Ray};
use crate::statistics::Accumulator;

/// What to render, and how.
pub struct Job<'a, K, E, S = IndependentSampler> {
    /// Where rays of the camera enter the scene.
    pub entrance: Entrance,
    /// Finds hits in the scene.
    pub intersector: &'a K,
    /// Where the rays start.
    pub camera: &'a Camera,
    /// What is averaged.
    pub integrator: E,
    /// What is known of the image beforehand.
    pub known: &'a KnownPixels,
    /// Chooses the random numbers.
    pub sampler: S,
}

/// Pieces of work that each thread should find in an image.
const PIECES: usize = 32;

/// A pass that waits for its intersector.
struct Pass<'a, 'b, K, E, S> {
    job: &'b Job<'a, K, E, S>,
    film: &'b mut Film,
    end: u64,
    watch: &'b Watch<'b>,
}

impl<K, E: Integrator, S: Sampler> Dispatch for Pass<'_, '_, K, E, S> {
    type Output = u64;

    fn with<L: Intersector>(self, intersector: &L) -> u64 {
        let &Job { entrance, camera, ref integrator, known, .. } = self.job;
        let sampler = self.job.sampler.clone();
        let job = Job {
            entrance,
            intersector,
            camera,
            integrator,
            known,
            sampler,
        };
        job.sweep(self.film, self.end, self.watch)
    }
}

/// Something that adds samples to a film.
pub trait Renderer {
    /// Takes each tile of `film` on from its own samples to `end` samples
    /// of each pixel, or to the next whole number of replicates, unless
    /// `watch` stops it; returns the number of rays traced. A renderer
    /// that learns has one film, and makes all its samples.
    fn pass(&mut self, film: &mut Film, end: u64, watch: &Watch) -> u64;

    /// Learns what it needs to know before the first pass over `film`,
    /// unless `watch`, which is told how many rays were traced, stops it;
    /// returns the number of all these rays.
    fn learn(&mut self, _film: &Film, _watch: &Watch) -> u64 {
        0
    }

    /// About how many rays it will learn from, for a film of so many
    /// pixels.
    fn training_rays(&self, _area: u64) -> u64 {
        0
    }

    /// What each rank has done so far; nothing if there is one process.
    fn shares(&self) -> &[Share] {
        &[]
    }

    /// Seconds that a pass should take at least, for what it costs.
    fn least_seconds(&self) -> f64 {
        0.
    }
}

/// What one rank of a run has done.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Paths, that is samples of single pixels.
    pub paths: u64,
    /// Seconds in which it rendered.
    pub render_seconds: f64,
    /// Seconds of the passes in which it did not.
    pub wait_seconds: f64,
    /// Seconds that all its threads have computed.
    pub processor_seconds: f64,
    /// Bytes of the sums that it has sent to rank 0.
    pub sent_bytes: u64,
    /// Seconds in which rank 0 has received such sums and added them.
    pub collect_seconds: f64,
}

impl<K: Intersector, E: Integrator, S: Sampler> Renderer
    for Job<'_, K, E, S>
{
    fn pass(&mut self, film: &mut Film, end: u64, watch: &Watch) -> u64 {
        assert_eq!(
            film.replicate(),
            self.sampler.replicate(),
            "replicates"
        );
        let pass = Pass { job: self, film, end, watch };
        self.intersector.dispatch(pass)
    }
}

/// Paths that a thread has under way.
const IN_FLIGHT: usize = 4;

/// A path that has left a surface.
struct PathInFlight<P, S> {
    /// What its integrator remembers.
    path: P,
    sampler: S,
    /// Where it goes next.
    ray: Ray,
    /// The triangle that it leaves.
    from: u32,
    /// The pixel in its tile.
    pixel: u32,
}

impl<K: Intersector, E: Integrator, S: Sampler> Job<'_, K, E, S> {
    /// Takes all tiles to so many samples, with the intersector as it is;
    /// returns the number of rays.
    fn sweep(&self, film: &mut Film, end: u64, watch: &Watch) -> u64 {
        let resolution = film.resolution();
        let first = film.first() / self.sampler.replicate();
        let tiles = film.tiles();
        let parts = PIECES * rayon::current_num_threads() / tiles.len();
        let render = |(tile, pixels): (Tile, &mut [Accumulator])| {
            // Choose how a tile is filled
            let end = first + end.div_ceil(self.sampler.replicate());
            let values = first + pixels[0].count()..end;
            if values.is_empty() || !watch(0) {
                return 0;
            }
            let count = values.end - values.start;
            let paths = (count * self.sampler.replicate())
                .saturating_mul(pixels.len() as u64);
            let content = self.known.content(tile.corner);
            let rays = match ((parts as u64).min(count), content) {
                (_, TileContent::Constant(sample)) => {
                    pixels
                        .iter_mut()
                        .for_each(|p| p.add_times(sample, count));
                    Some(0)
                }
                (0 | 1, _) => {
                    self.fill(tile, pixels, resolution, &values, watch)
                }
                (parts, _) => {
                    // Render the values in parts
                    // Cut the values into parts
                    let cut = |k: u64| {
                        let whole = u128::from(count) * u128::from(k);
                        values.start + (whole / u128::from(parts)) as u64
                    };
                    // Render one part by itself
                    let render = |k| {
                        let mut own =
                            vec![Accumulator::default(); pixels.len()];
                        let range = cut(k)..cut(k + 1);
                        let rays = self.fill(
                            tile, &mut own, resolution, &range, watch,
                        );
                        rays.map(|rays| (own, rays))
                    };
                    let done: Option<Vec<_>> =
                        (0..parts).into_par_iter().map(render).collect();
                    done.map(|done| {
                        // Merge the parts into the pixels
                        for (own, _) in &done {
                            let both = pixels.iter_mut().zip(own);
                            both.for_each(|(pixel, own)| pixel.merge(own));
                        }
                        done.iter().map(|(_, rays)| rays).sum()
                    })
                }
            };
            if rays.is_some() {
                watch(paths);
            }
            rays.unwrap_or(0)
        };
        tiles.into_par_iter().with_max_len(1).map(render).sum()
    }

    /// Adds values to the pixels of a tile, given their numbers, and returns
    /// the number of rays; none, with the pixels as they were, if the pass is
    /// stopped.
    fn fill(
        &self,
        tile: Tile,
        pixels: &mut [Accumulator],
        resolution: (u32, u32),
        values: &Range<u64>,
        watch: &Watch,
    ) -> Option<u64> {
        let before = pixels.to_vec();
        let trace = |pixels: &mut [Accumulator], samples| {
            self.trace(tile, pixels, resolution, samples, watch)
        };
        // Add the samples or the means of replicates
        let replicate = |value| {
            let mut own = vec![Accumulator::default(); pixels.len()];
            let first = value * self.sampler.replicate();
            let rays =
                trace(&mut own, first..first + self.sampler.replicate());
            let means = own.iter().map(Accumulator::mean);
            pixels.iter_mut().zip(means).for_each(|(p, mean)| p.add(mean));
            rays
        };
        let rays = match self.sampler.replicate() {
            1 => trace(pixels, values.clone()),
            _ => values.clone().map(replicate).sum(),
        };
        if rays.is_none() {
            pixels.copy_from_slice(&before);
        }
        rays
    }

    /// Adds samples to the pixels of a tile; returns the number of rays, or
    /// none if it was stopped.
    fn trace(
        &self,
        tile: Tile,
        pixels: &mut [Accumulator],
        resolution: (u32, u32),
        samples: Range<u64>,
        watch: &Watch,
    ) -> Option<u64> {
        // List the paths of the tile
        let each = move |pixel| samples.clone().map(move |n| (pixel, n));
        let mut to_begin =
            (0..pixels.len() as u32).flat_map(each).peekable();
        let mut begun = Vec::with_capacity(BEAM);
        let mut under_way = Vec::with_capacity(IN_FLIGHT);
        let (mut rays, mut turns) = (0, 0u64);
        loop {
            // Put begun paths under way
            if begun.is_empty() && to_begin.peek().is_some() {
                let batch = to_begin.by_ref().take(BEAM);
                rays +=
                    self.begin(&mut begun, batch, tile, pixels, resolution);
            }
            while under_way.len() < IN_FLIGHT
                && let Some(flight) = begun.pop()
            {
                under_way.push(flight);
            }
            if under_way.is_empty() && to_begin.peek().is_none() {
                return Some(rays);
            }
            // Stop in the midst of a tile
            turns += 1;
            if turns.is_multiple_of(256) && !watch(0) {
                return None;
            }
            // Take each path one ray further
            under_way.retain_mut(|flight| {
                rays += 1;
                let PathInFlight { path, sampler, ray, from, .. } = flight;
                let answer =
                    E::RayQuery::ask(self.intersector, ray, Some(*from));
                match self.integrator.go_on(path, answer, sampler) {
                    PathEvent::Scatter(next, left) => {
                        (*ray, *from) = (next, left);
                        return true;
                    }
                    PathEvent::Terminate(contribution) => {
                        pixels[flight.pixel as usize].add(contribution);
                    }
                }
                // Give its place to the next path
                let next = begun.pop();
                let is_taken = next.is_some();
                if let Some(next) = next {
                    *flight = next;
                }
                is_taken
            });
        }
    }

    /// Begins the paths of a batch, each the number of a pixel in its tile and
    /// of a sample, and takes them up to their first hits; those that are over
    /// are added to their pixels. Returns the number of rays.
    #[inline(always)]
    fn begin(
        &self,
        begun: &mut Vec<PathInFlight<E::Path, S>>,
        mut batch: impl Iterator<Item = (u32, u64)>,
        tile: Tile,
        pixels: &mut [Accumulator],
        resolution: (u32, u32),
    ) -> u64 {
        // Choose a point of the image for each path
        let (width, height) = resolution;
        let (mut across, mut down) = ([0.; BEAM], [0.; BEAM]);
        let mut started: [_; BEAM] = array::from_fn(|i| {
            let (pixel, n) = batch.next()?;
            // Find the column and the row
            let x = tile.corner.0 + pixel % tile.size.0;
            let y = tile.corner.1 + pixel / tile.size.0;
            // Start sample `n` at column `x` and row `y`
            let number = u64::from(y) * u64::from(width) + u64::from(x);
            let mut sampler = self.sampler.start(number, n);
            let [u, v] = sampler.get_pixel_2d();
            across[i] = within(x, width, u);
            down[i] = within(y, height, v);
            Some((pixel, sampler))
        });
        // Send the first rays of the batch
        let directions = self.camera.directions(&across, &down);
        let sees_sky = self.known.content(tile.corner) == TileContent::Sky;
        let rays = array::from_fn(|i| match started[i] {
            Some(_) if !sees_sky => self.entrance.enter(directions[i]),
            _ => None,
        });
        let mut answers = E::RayQuery::ask_all(self.intersector, &rays);
        for i in 0..BEAM {
            // Take a path on from the end of its first ray
            let Some((pixel, mut sampler)) = started[i].take() else {
                break;
            };
            let mut path = self.integrator.begin(directions[i]);
            let answer = answers[i].take();
            match self.integrator.go_on(&mut path, answer, &mut sampler) {
                PathEvent::Scatter(ray, from) => {
                    let flight =
                        PathInFlight { path, sampler, ray, from, pixel };
                    begun.push(flight);
                }
                PathEvent::Terminate(contribution) => {
                    pixels[pixel as usize].add(contribution);
                }
            }
        }
        rays.iter().flatten().count() as u64
    }
}
