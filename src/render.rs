// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Filling an image with realisations, on all threads.

use std::ops::Range;

use rand::RngExt;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::estimator::{Estimator, Realisation};
use crate::hierarchy::{Kernel, Work};
use crate::image::{Image, Tile};
use crate::sampling::generator;
use crate::scene::Scene;
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
    pub estimator: &'a E,
    /// Chooses the random numbers.
    pub seed: u64,
}

/// Pieces of work that each thread should find in an image.
const PIECES: usize = 32;

// Let the kernel choose its walk
/// A pass that waits for its kernel.
struct Pass<'a, 'b, K, E, P> {
    job: &'b Job<'a, K, E>,
    image: &'b mut Image,
    realisations: Range<u64>,
    progress: &'b P,
}

impl<K, E: Estimator, P: Fn(u64) + Sync> Work for Pass<'_, '_, K, E, P> {
    type Output = u64;

    fn with<L: Kernel>(self, kernel: &L) -> u64 {
        let &Job { scene, camera, estimator, seed, .. } = self.job;
        let job = Job { scene, kernel, camera, estimator, seed };
        job.sweep(self.image, self.realisations, self.progress)
    }
}

impl<K: Kernel, E: Estimator> Job<'_, K, E> {
    // Add realisations to an image
    /// Adds the `realisations` to each pixel of `image`, and returns the
    /// number of rays traced. Calls `progress`, from any thread, with the
    /// number of paths of each tile that is finished.
    pub fn pass(
        &self,
        image: &mut Image,
        realisations: Range<u64>,
        progress: &(impl Fn(u64) + Sync),
    ) -> u64 {
        let pass = Pass { job: self, image, realisations, progress };
        self.kernel.specialise(pass)
    }

    /// The same, with the kernel as it is.
    fn sweep(
        &self,
        image: &mut Image,
        realisations: Range<u64>,
        progress: &(impl Fn(u64) + Sync),
    ) -> u64 {
        let definition = (image.width(), image.height());
        let tiles = image.tiles();
        let parts = PIECES * rayon::current_num_threads() / tiles.len();
        let render = |(tile, pixels): (Tile, &mut [Accumulator])| {
            let count = realisations.end - realisations.start;
            let rays = match (parts as u64).min(count) {
                0 | 1 => self.tile(tile, pixels, definition, &realisations),
                parts => {
                    // Render the realisations in parts
                    let cut = |k: u64| {
                        let whole = u128::from(count) * u128::from(k);
                        realisations.start
                            + (whole / u128::from(parts)) as u64
                    };
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
        let mut rays = 0;
        for (i, pixel) in (0..).zip(pixels) {
            let x = tile.corner.0 + i % tile.size.0;
            let y = tile.corner.1 + i / tile.size.0;
            for n in realisations.clone() {
                let realisation = self.realise((x, y), definition, n);
                pixel.add(realisation.weight);
                rays += realisation.rays;
            }
        }
        rays
    }

    // Realise one path of a pixel
    /// Realisation `n` of the radiance of one pixel.
    fn realise(
        &self,
        (x, y): (u32, u32),
        (width, height): (u32, u32),
        n: u64,
    ) -> Realisation {
        let number = u64::from(y) * u64::from(width) + u64::from(x);
        let mut random = generator(self.seed, number, n);
        let (right, down): (f64, f64) = (random.random(), random.random());
        let direction = self.camera.direction(
            (f64::from(x) + right) / f64::from(width),
            (f64::from(y) + down) / f64::from(height),
        );
        let ray = self.scene.enter(self.camera.position, direction);
        self.estimator.realise(self.kernel, ray, direction, &mut random)
    }
}
