// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Filling an image with samples, on all threads.

// Name what the render imports
use std::iter;
use std::ops::Range;

use rayon::prelude::*;

use crate::analysis::background::KnownPixels;
use crate::bvh::{Dispatch, Intersector};
use crate::camera::Camera;
use crate::film::{Film, Tile};
use crate::integrator::{Integrator, PathEvent, RayQuery};
use crate::sampler::{IndependentSampler, Sampler, within};
use crate::scene::{Ray, Scene};
use crate::statistics::Accumulator;

// Name what a render needs
/// What to render, and how.
pub struct Job<'a, K, E, S = IndependentSampler> {
    /// The triangles.
    pub scene: &'a Scene,
    /// Finds hits in `scene`.
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

// Let the intersector choose its walk
/// A pass that waits for its intersector.
struct Pass<'a, 'b, K, E, S> {
    job: &'b Job<'a, K, E, S>,
    film: &'b mut Film,
    samples: Range<u64>,
    progress: &'b (dyn Fn(u64) + Sync),
}

impl<K, E: Integrator, S: Sampler> Dispatch for Pass<'_, '_, K, E, S> {
    type Output = u64;

    fn with<L: Intersector>(self, intersector: &L) -> u64 {
        let &Job { scene, camera, ref integrator, known, .. } = self.job;
        let sampler = self.job.sampler.clone();
        let job =
            Job { scene, intersector, camera, integrator, known, sampler };
        job.sweep(self.film, self.samples, self.progress)
    }
}

/// Something that adds samples to an image.
pub trait Renderer: Sync {
    /// Adds the `samples` to each pixel of `film`, and returns the
    /// number of rays traced. Calls `progress`, from any thread, with the
    /// number of paths of each tile that is finished.
    fn pass(
        &self,
        film: &mut Film,
        samples: Range<u64>,
        progress: &(dyn Fn(u64) + Sync),
    ) -> u64;
}

impl<K: Intersector, E: Integrator, S: Sampler> Renderer
    for Job<'_, K, E, S>
{
    fn pass(
        &self,
        film: &mut Film,
        samples: Range<u64>,
        progress: &(dyn Fn(u64) + Sync),
    ) -> u64 {
        let pass = Pass { job: self, film, samples, progress };
        self.intersector.dispatch(pass)
    }
}

// Keep a path that is under way
/// Paths that a thread has under way.
const IN_FLIGHT: usize = 4;

/// Paths that are begun at a time.
const BATCH: usize = 16;

/// A path between two rays.
struct PathInFlight<P, S> {
    /// What its estimator remembers.
    path: P,
    sampler: S,
    /// Where it goes next; none if it has missed the box of the scene.
    ray: Option<Ray>,
    /// The triangle that it leaves.
    from: Option<u32>,
    /// The pixel in its tile.
    pixel: u32,
}

impl<K: Intersector, E: Integrator, S: Sampler> Job<'_, K, E, S> {
    // Add samples to an image
    /// All tiles, with the intersector as it is.
    fn sweep(
        &self,
        film: &mut Film,
        samples: Range<u64>,
        progress: &(dyn Fn(u64) + Sync),
    ) -> u64 {
        let resolution = (film.width(), film.height());
        let tiles = film.tiles();
        let parts = PIECES * rayon::current_num_threads() / tiles.len();
        let render = |(tile, pixels): (Tile, &mut [Accumulator])| {
            // Choose how a tile is filled
            let count = samples.end - samples.start;
            let rays = match (parts as u64).min(count) {
                _ if self.known.holds(&tile) => {
                    // Fill a tile that is known
                    for (pixel, i) in pixels.iter_mut().zip(0..) {
                        let x = tile.corner.0 + i % tile.size.0;
                        let y = tile.corner.1 + i / tile.size.0;
                        pixel.add_times(self.known.radiance(x, y), count);
                    }
                    0
                }
                0 | 1 => self.tile(tile, pixels, resolution, &samples),
                parts => {
                    // Render the samples in parts
                    // Cut the samples into parts
                    let cut = |k: u64| {
                        let whole = u128::from(count) * u128::from(k);
                        samples.start + (whole / u128::from(parts)) as u64
                    };
                    // Render one part by itself
                    let render = |k| {
                        let mut own =
                            vec![Accumulator::default(); pixels.len()];
                        let range = cut(k)..cut(k + 1);
                        let rays =
                            self.tile(tile, &mut own, resolution, &range);
                        (own, rays)
                    };
                    let done: Vec<_> =
                        (0..parts).into_par_iter().map(render).collect();
                    // Merge the parts into the pixels
                    for (pixel, i) in pixels.iter_mut().zip(0..) {
                        done.iter()
                            .for_each(|(own, _)| pixel.merge(&own[i]));
                    }
                    done.iter().map(|(_, rays)| rays).sum()
                }
            };
            progress(count.saturating_mul(pixels.len() as u64));
            rays
        };
        tiles.into_par_iter().with_max_len(1).map(render).sum()
    }

    // Render the pixels of a tile
    fn tile(
        &self,
        tile: Tile,
        pixels: &mut [Accumulator],
        resolution: (u32, u32),
        samples: &Range<u64>,
    ) -> u64 {
        // Begin the paths in batches
        let each = |pixel| samples.clone().map(move |n| (pixel, n));
        let mut to_begin = (0..pixels.len() as u32).flat_map(each);
        let mut begun = Vec::with_capacity(BATCH);
        let mut next = || {
            if begun.is_empty() {
                let batch = to_begin.by_ref().take(BATCH);
                self.begin(&mut begun, batch, tile, resolution);
            }
            begun.pop()
        };
        let mut rays = 0;
        // Put the first paths under way
        let under_way = iter::from_fn(&mut next).take(IN_FLIGHT);
        let mut under_way: Vec<_> = under_way.collect();
        while !under_way.is_empty() {
            // Take each path one ray further
            under_way.retain_mut(|in_flight_path| {
                rays += u64::from(in_flight_path.ray.is_some());
                let Some(weight) = self.go_on(in_flight_path) else {
                    return true;
                };
                pixels[in_flight_path.pixel as usize].add(weight);
                match next() {
                    Some(next) => *in_flight_path = next,
                    None => return false,
                }
                true
            });
        }
        rays
    }

    // Begin a batch of paths
    /// Begins the paths of a batch: each the number of a pixel in its tile,
    /// and of a sample.
    #[inline(never)]
    fn begin(
        &self,
        begun: &mut Vec<PathInFlight<E::Path, S>>,
        batch: impl Iterator<Item = (u32, u64)>,
        tile: Tile,
        resolution: (u32, u32),
    ) {
        let (width, height) = resolution;
        for (pixel, n) in batch {
            // Find the column and the row
            let x = tile.corner.0 + pixel % tile.size.0;
            let y = tile.corner.1 + pixel / tile.size.0;
            // Begin sample `n` at column `x` and row `y`
            let number = u64::from(y) * u64::from(width) + u64::from(x);
            let mut sampler = self.sampler.start(number, n);
            let [u, v] = sampler.get_pixel_2d();
            let direction = self
                .camera
                .direction(within(x, width, u), within(y, height, v));
            let ray = self.scene.enter(self.camera.position, direction);
            let path = self.integrator.begin(direction);
            begun.push(PathInFlight {
                path,
                sampler,
                ray,
                from: None,
                pixel,
            });
        }
    }

    // Trace one ray of a path
    /// Traces the ray of a path and takes the path on from there; its weight
    /// if it ends.
    #[inline(always)]
    fn go_on(
        &self,
        in_flight_path: &mut PathInFlight<E::Path, S>,
    ) -> Option<f64> {
        let PathInFlight { path, sampler, ray, from, .. } = in_flight_path;
        // Find what the ray meets
        let trace = |ray| E::RayQuery::ask(self.intersector, ray, *from);
        let answer = ray.as_ref().and_then(trace);
        match self.integrator.go_on(path, answer, sampler) {
            // Go on along the next ray
            PathEvent::Scatter(next, left) => {
                *ray = Some(next);
                *from = Some(left);
                None
            }
            PathEvent::Terminate(weight) => Some(weight),
        }
    }
}
