// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Filling an image with realisations, on all threads.

// Name what the render imports
use std::iter;
use std::ops::Range;

use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::estimator::{Answer, Estimator, Step};
use crate::facts::bare::Known;
use crate::hierarchy::{Kernel, Work};
use crate::image::{Image, Tile};
use crate::sampling::{generator, within};
use crate::scene::{Ray, Scene};
use crate::statistics::Accumulator;

// Name what a render needs
/// What to render, and how.
pub struct Job<'a, K, E> {
    /// The triangles.
    pub scene: &'a Scene,
    /// Finds hits in `scene`.
    pub kernel: &'a K,
    /// Where the rays start.
    pub camera: &'a Camera,
    /// What is averaged.
    pub estimator: E,
    /// What is known of the image beforehand.
    pub known: &'a Known,
    /// Chooses the random numbers.
    pub seed: u64,
}

/// Pieces of work that each thread should find in an image.
const PIECES: usize = 32;

// Let the kernel choose its walk
/// A pass that waits for its kernel.
struct Pass<'a, 'b, K, E> {
    job: &'b Job<'a, K, E>,
    image: &'b mut Image,
    realisations: Range<u64>,
    progress: &'b (dyn Fn(u64) + Sync),
}

impl<K, E: Estimator> Work for Pass<'_, '_, K, E> {
    type Output = u64;

    fn with<L: Kernel>(self, kernel: &L) -> u64 {
        let Job { scene, camera, estimator, known, seed, .. } = self.job;
        let (scene, camera, known, seed) = (*scene, *camera, *known, *seed);
        let job = Job { scene, kernel, camera, estimator, known, seed };
        job.sweep(self.image, self.realisations, self.progress)
    }
}

/// Something that adds realisations to an image.
pub trait Renderer: Sync {
    /// Adds the `realisations` to each pixel of `image`, and returns the
    /// number of rays traced. Calls `progress`, from any thread, with the
    /// number of paths of each tile that is finished.
    fn pass(
        &self,
        image: &mut Image,
        realisations: Range<u64>,
        progress: &(dyn Fn(u64) + Sync),
    ) -> u64;
}

impl<K: Kernel, E: Estimator> Renderer for Job<'_, K, E> {
    fn pass(
        &self,
        image: &mut Image,
        realisations: Range<u64>,
        progress: &(dyn Fn(u64) + Sync),
    ) -> u64 {
        let pass = Pass { job: self, image, realisations, progress };
        self.kernel.specialise(pass)
    }
}

// Keep a path that is under way
/// Paths that a thread has under way.
const ABREAST: usize = 4;

/// Paths that are begun at a time.
const BATCH: usize = 16;

/// A path between two rays.
struct Traveller<P> {
    /// What its estimator remembers.
    path: P,
    random: Pcg64,
    /// Where it goes next; none if it has missed the box of the scene.
    ray: Option<Ray>,
    /// The triangle that it leaves.
    from: Option<u32>,
    /// The pixel in its tile.
    pixel: u32,
}

impl<K: Kernel, E: Estimator> Job<'_, K, E> {
    // Add realisations to an image
    /// All tiles, with the kernel as it is.
    fn sweep(
        &self,
        image: &mut Image,
        realisations: Range<u64>,
        progress: &(dyn Fn(u64) + Sync),
    ) -> u64 {
        let definition = (image.width(), image.height());
        let tiles = image.tiles();
        let parts = PIECES * rayon::current_num_threads() / tiles.len();
        let render = |(tile, pixels): (Tile, &mut [Accumulator])| {
            // Choose how a tile is filled
            let count = realisations.end - realisations.start;
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
                0 | 1 => self.tile(tile, pixels, definition, &realisations),
                parts => {
                    // Render the realisations in parts
                    // Cut the realisations into parts
                    let cut = |k: u64| {
                        let whole = u128::from(count) * u128::from(k);
                        realisations.start
                            + (whole / u128::from(parts)) as u64
                    };
                    // Render one part by itself
                    let render = |k| {
                        let mut own =
                            vec![Accumulator::default(); pixels.len()];
                        let range = cut(k)..cut(k + 1);
                        let rays =
                            self.tile(tile, &mut own, definition, &range);
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
        definition: (u32, u32),
        realisations: &Range<u64>,
    ) -> u64 {
        // Begin the paths in batches
        let each = |pixel| realisations.clone().map(move |n| (pixel, n));
        let mut to_begin = (0..pixels.len() as u32).flat_map(each);
        let mut begun = Vec::with_capacity(BATCH);
        let mut next = || {
            if begun.is_empty() {
                let batch = to_begin.by_ref().take(BATCH);
                self.begin(&mut begun, batch, tile, definition);
            }
            begun.pop()
        };
        let mut rays = 0;
        // Put the first paths under way
        let under_way = iter::from_fn(&mut next).take(ABREAST);
        let mut under_way: Vec<_> = under_way.collect();
        while !under_way.is_empty() {
            // Take each path one ray further
            under_way.retain_mut(|traveller| {
                rays += u64::from(traveller.ray.is_some());
                let Some(weight) = self.go_on(traveller) else {
                    return true;
                };
                pixels[traveller.pixel as usize].add(weight);
                match next() {
                    Some(next) => *traveller = next,
                    None => return false,
                }
                true
            });
        }
        rays
    }

    // Begin a batch of paths
    /// Begins the paths of a batch: each the number of a pixel in its tile,
    /// and of a realisation.
    #[inline(never)]
    fn begin(
        &self,
        begun: &mut Vec<Traveller<E::Path>>,
        batch: impl Iterator<Item = (u32, u64)>,
        tile: Tile,
        definition: (u32, u32),
    ) {
        let (width, height) = definition;
        for (pixel, n) in batch {
            // Find the column and the row
            let x = tile.corner.0 + pixel % tile.size.0;
            let y = tile.corner.1 + pixel / tile.size.0;
            // Begin realisation `n` at column `x` and row `y`
            let number = u64::from(y) * u64::from(width) + u64::from(x);
            let mut random = generator(self.seed, number, n);
            let direction = self.camera.direction(
                within(x, width, random.random()),
                within(y, height, random.random()),
            );
            let ray = self.scene.enter(self.camera.position, direction);
            let path = self.estimator.begin(direction);
            begun.push(Traveller { path, random, ray, from: None, pixel });
        }
    }

    // Trace one ray of a path
    /// Traces the ray of a path and takes the path on from there; its weight
    /// if it ends.
    #[inline(always)]
    fn go_on(&self, traveller: &mut Traveller<E::Path>) -> Option<f64> {
        let Traveller { path, random, ray, from, .. } = traveller;
        // Find what the ray meets
        let trace = |ray| E::Answer::ask(self.kernel, ray, *from);
        let answer = ray.as_ref().and_then(trace);
        match self.estimator.go_on(path, answer, random) {
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
