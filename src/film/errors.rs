// Tangled from chapters/film.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The errors that a film states: those of its pixels, and of the image.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::sums::Film;
use super::tile::Window;

/// What is known about an image as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// The mean radiance over the pixels.
    pub mean: f64,
    /// Its standard error; infinite while unknown.
    pub mean_stderr: f64,
    /// The root of the mean square standard error of the pixels;
    /// infinite while unknown.
    pub rmse: f64,
    /// The number of pixels whose samples are all equal.
    pub constant: u64,
}

impl Film {
    /// Summarises the image, with the errors that [`Film::errors`] gives
    /// for [`NEIGHBOUR_WEIGHT`].
    pub fn summary(&self) -> Summary {
        let few = self.samples() < 2 * self.net_size;
        // Sum numbers of all pixels over rows
        let rows = self.bands().flat_map_iter(|band| {
            let means =
                self.values(band, 0., |_, at| self.pixels[at].mean());
            let errors = match few {
                true => vec![DVec2::INFINITY; band.area()],
                false => self.errors_and_variances(NEIGHBOUR_WEIGHT, band),
            };
            let pixels = means.into_iter().zip(errors).map(|(mean, e)| {
                DVec3::new(mean, e.x * e.x, f64::from(e.y == 0.))
            });
            let pixels: Vec<DVec3> = pixels.collect();
            let rows = pixels.chunks(self.window.size.0 as usize);
            rows.map(|row| row.iter().sum()).collect::<Vec<DVec3>>()
        });
        let sums: DVec3 = rows.collect::<Vec<_>>().iter().sum();
        let [radiance, squares, constant] = sums.to_array();
        // Compute the summary from the sums
        let Self { tiles, tile_means: means, .. } = self;
        let tiles = tiles.iter().zip(means).map(|(tile, mean)| {
            (tile.area() as f64 * mean.standard_error()).powi(2)
        });
        let square = if means.is_empty() { squares } else { tiles.sum() };
        let n = self.area() as f64;
        let sampled = self.area() - self.unsampled();
        Summary {
            mean: radiance / sampled.max(1) as f64,
            mean_stderr: f64::sqrt(square) / n,
            rmse: (squares / n).sqrt(),
            constant: constant as u64,
        }
    }
}

/// How far a pixel looks for neighbours, in pixels.
const REACH: u32 = 2;

/// How many samples the variance of the neighbours is worth.
pub const NEIGHBOUR_WEIGHT: f64 = 4.;

impl Film {
    /// The standard errors of the pixels of a window, row by row; infinite
    /// where unknown. The variance that a pixel has seen is combined with
    /// that of its neighbours, which counts as `worth` values
    /// ([`NEIGHBOUR_WEIGHT`]; 0 leaves the neighbours out).
    pub fn errors(&self, worth: f64, window: Window) -> Vec<f64> {
        let pixels = self.errors_and_variances(worth, window).into_iter();
        pixels.map(|pixel| pixel.x).collect()
    }

    /// The same, each with the variance that the pixel itself has seen.
    fn errors_and_variances(
        &self,
        worth: f64,
        window: Window,
    ) -> Vec<DVec2> {
        // Compute the variances of the window and its frame
        let frame = window.grown(REACH, self.window);
        let variances =
            self.values(frame, f64::INFINITY, |_, at| self.variance(at));
        let count = |_, at: usize| self.pixels[at].count() as f64;
        let counts = self.values(window, 0., count);
        let (width, columns) =
            (frame.size.0 as usize, window.size.0 as usize);
        let rows: Vec<&[f64]> = variances.chunks(width).collect();
        let left = (window.corner.0 - frame.corner.0) as usize;
        let top = (window.corner.1 - frame.corner.1) as usize;
        let near = |i: usize, end: usize| {
            i.saturating_sub(REACH as usize)
                ..(i + REACH as usize + 1).min(end)
        };
        let mut errors = Vec::with_capacity(window.area());
        for (y, counts) in (top..).zip(counts.chunks(columns)) {
            // Sum the variances of each column
            let mut sums = vec![DVec2::ZERO; width];
            for row in &rows[near(y, rows.len())] {
                for (sum, &variance) in sums.iter_mut().zip(*row) {
                    let counts = variance.is_finite();
                    let term = DVec2::new(variance, 1.);
                    *sum += if counts { term } else { DVec2::ZERO };
                }
            }
            for (x, n) in (left..).zip(counts) {
                // Compute the error of a pixel
                let seen = rows[y][x];
                let square: DVec2 = sums[near(x, width)].iter().sum();
                let [sum, count] =
                    (square - DVec2::new(seen, 1.)).to_array();
                let alone = count == 0. || self.is_list;
                let variance = if alone || !seen.is_finite() {
                    seen
                } else {
                    ((n - 1.) * seen + worth * (sum / count))
                        / (n - 1. + worth)
                };
                errors.push(DVec2::new((variance / n).sqrt(), seen));
            }
        }
        errors
    }

    /// An error of the image; infinite if it is unknown.
    pub fn error(&self, norm: ErrorNorm) -> f64 {
        let sums = self.bands().map(|band| {
            let errors = self.errors(NEIGHBOUR_WEIGHT, band).into_iter();
            let squares =
                errors.zip(self.means_of(band)).map(|(error, mean)| {
                    let whole = if norm.relative { mean } else { 1. };
                    let is_exact = error == 0. || whole == 0.;
                    let part = if is_exact { 0. } else { error / whole };
                    if part.is_nan() { f64::INFINITY } else { part * part }
                });
            squares.fold([0., 0.], |[sum, most]: [f64; 2], square| {
                [sum + square, most.max(square)]
            })
        });
        let sums: Vec<[f64; 2]> = sums.collect();
        let most = sums.iter().map(|sums| sums[1]).fold(0., f64::max);
        let mean = sums.iter().map(|sums| sums[0]).sum::<f64>();
        let mean = mean / self.area() as f64;
        if norm.largest { most.sqrt() } else { mean.sqrt() }
    }

    /// The standard error with which each pixel of a window counts in a sum
    /// over whole tiles, row by row: that of the mean of its tile
    /// times the root of the number of its pixels; infinite where unknown.
    /// None if the pixels are independent.
    pub fn tile_errors(&self, window: Window) -> Option<Vec<f64>> {
        let Self { tiles, tile_means, .. } = self;
        let error = |place: usize, _| {
            let root = (tiles[place].area() as f64).sqrt();
            root * tile_means[place].standard_error()
        };
        let shared = !tile_means.is_empty();
        shared.then(|| self.values(window, f64::INFINITY, error))
    }
}

/// Which error a target limits.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize,
)]
pub struct ErrorNorm {
    /// Relative to the mean of each pixel.
    pub relative: bool,
    /// The error of the worst pixel, not the root mean square of all.
    pub largest: bool,
}

impl ErrorNorm {
    /// Whether it is the root mean square of all, and not relative.
    pub fn is_rms(&self) -> bool {
        *self == Self::default()
    }
}
