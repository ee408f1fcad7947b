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

use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::analysis::background::{KnownPixels, TileContent};
use crate::analysis::{Inquiry, SceneAnalysis};
use crate::bvh::{Bvh, Dispatch, Intersector};
use crate::camera::Camera;
use crate::film::{Film, Tile};
use crate::integrator::{
    DirectSky, Integrator, PathTracer, RayQuery, Step,
};
use crate::sampler::{generator, within};
use crate::scene::{Ray, Scene};
use crate::statistics::Accumulator;

// Name what a render needs
/// What to render, and how.
pub struct Job<'a, K, E> {
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
    pub seed: u64,
}

/// Pieces of work that each thread should find in an image.
const PIECES: usize = 32;

// Let the intersector choose its walk
/// A pass that waits for its intersector.
struct Pass<'a, 'b, K, E> {
    job: &'b Job<'a, K, E>,
    film: &'b mut Film,
    samples: Range<u64>,
    progress: &'b (dyn Fn(u64) + Sync),
}

impl<K, E: Integrator> Dispatch for Pass<'_, '_, K, E> {
    type Output = u64;

    fn with<L: Intersector>(self, intersector: &L) -> u64 {
        let Job { scene, camera, integrator, known, seed, .. } = self.job;
        let (scene, camera, known, seed) = (*scene, *camera, *known, *seed);
        let job =
            Job { scene, intersector, camera, integrator, known, seed };
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

impl<K: Intersector, E: Integrator> Renderer for Job<'_, K, E> {
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

/// The renderer of a scene with this intersector, for what its analysis
/// has found to be needed.
pub fn renderer<'a>(
    scene: &'a Scene,
    intersector: &'a Bvh,
    inquiry: &Inquiry<'a>,
    analysis: &'a SceneAnalysis,
    seed: u64,
) -> Box<dyn Renderer + 'a> {
    let &Inquiry { camera, sky, albedo, .. } = inquiry;
    let known = &analysis.known;
    if analysis.is_black {
        let integrator = DirectSky { sky };
        return Box::new(Job {
            scene,
            intersector,
            camera,
            integrator,
            known,
            seed,
        });
    }
    let integrator = PathTracer { albedo, sky };
    Box::new(Job { scene, intersector, camera, integrator, known, seed })
}

// Keep a path that is under way
/// Paths that a thread has under way.
const IN_FLIGHT: usize = 4;

/// Paths that are begun at a time.
const BATCH: usize = 16;

/// A path between two rays.
struct PathInFlight<P> {
    /// What its estimator remembers.
    path: P,
    random: Pcg64,
    /// Where it goes next; none if it is known to meet nothing.
    ray: Option<Ray>,
    /// The triangle that it leaves.
    from: Option<u32>,
    /// The pixel in its tile.
    pixel: u32,
}

impl<K: Intersector, E: Integrator> Job<'_, K, E> {
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
            let content = self.known.content(tile.corner);
            let rays = match ((parts as u64).min(count), content) {
                (_, TileContent::Constant(sample)) => {
                    pixels
                        .iter_mut()
                        .for_each(|p| p.add_times(sample, count));
                    0
                }
                (0 | 1, _) => self.tile(tile, pixels, resolution, &samples),
                (parts, _) => {
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
        begun: &mut Vec<PathInFlight<E::Path>>,
        batch: impl Iterator<Item = (u32, u64)>,
        tile: Tile,
        resolution: (u32, u32),
    ) {
        let (width, height) = resolution;
        let sees_sky = self.known.content(tile.corner) == TileContent::Sky;
        for (pixel, n) in batch {
            // Find the column and the row
            let x = tile.corner.0 + pixel % tile.size.0;
            let y = tile.corner.1 + pixel / tile.size.0;
            // Begin sample `n` at column `x` and row `y`
            let number = u64::from(y) * u64::from(width) + u64::from(x);
            let mut random = generator(self.seed, number, n);
            let direction = self.camera.direction(
                within(x, width, random.random()),
                within(y, height, random.random()),
            );
            let enter =
                || self.scene.enter(self.camera.position, direction);
            let ray = if sees_sky { None } else { enter() };
            let path = self.integrator.begin(direction);
            begun.push(PathInFlight {
                path,
                random,
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
        in_flight_path: &mut PathInFlight<E::Path>,
    ) -> Option<f64> {
        let PathInFlight { path, random, ray, from, .. } = in_flight_path;
        // Find what the ray meets
        let trace = |ray| E::RayQuery::ask(self.intersector, ray, *from);
        let answer = ray.as_ref().and_then(trace);
        match self.integrator.go_on(path, answer, random) {
            // Go on along the next ray
            Step::On(next, left) => {
                *ray = Some(next);
                *from = Some(left);
                None
            }
            Step::End(weight) => Some(weight),
        }
    }
}
