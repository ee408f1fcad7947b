// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! A rectangle of accumulators, cut into tiles along Hilbert's curve.
//!
//! Pixels are counted from the top left. Those of one tile lie
//! together in memory, so that threads write to separate pieces.

use rayon::prelude::*;

use crate::statistics::Accumulator;

// Lay the tiles out in memory
/// Width and height of a tile in pixels.
pub const SIDE: u32 = 16;

/// A rectangle of pixels that one thread renders at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Column and row of its first pixel.
    pub corner: (u32, u32),
    /// Its width and height, at most `SIDE` each.
    pub size: (u32, u32),
    /// Number of pixels in the tiles before it.
    start: usize,
}

/// An image in the making: one accumulator per pixel.
#[derive(Clone, Debug)]
pub struct Film {
    width: u32,
    height: u32,
    tiles: Vec<Tile>,
    /// The number of each tile along the curve, by row and column.
    ranks: Vec<u32>,
    pixels: Vec<Accumulator>,
}

impl Film {
    /// An image without any weight, of at least one pixel.
    pub fn new(width: u32, height: u32) -> Self {
        let (columns, rows) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
        // Sort the cells along the curve
        let side = columns.max(rows).next_power_of_two();
        let cells =
            (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
        let mut cells: Vec<_> = cells.collect();
        cells.sort_by_cached_key(|&(x, y)| distance(side, x, y));
        // Lay a tile in each cell
        let mut ranks = vec![0; cells.len()];
        let mut tiles = Vec::with_capacity(cells.len());
        let mut start = 0;
        for (rank, (x, y)) in cells.into_iter().enumerate() {
            // Append the tile of one cell
            ranks[(y * columns + x) as usize] = rank as u32;
            let corner = (x * SIDE, y * SIDE);
            let size =
                (SIDE.min(width - corner.0), SIDE.min(height - corner.1));
            tiles.push(Tile { corner, size, start });
            start += (size.0 * size.1) as usize;
        }
        let pixels = vec![Accumulator::default(); start];
        Self { width, height, tiles, ranks, pixels }
    }
}

// Find a pixel in its tile
impl Film {
    /// The tiles, each with its pixels row by row.
    pub fn tiles(&mut self) -> Vec<(Tile, &mut [Accumulator])> {
        let mut rest = &mut self.pixels[..];
        let mut parts = Vec::with_capacity(self.tiles.len());
        for &tile in &self.tiles {
            let length = (tile.size.0 * tile.size.1) as usize;
            let (pixels, others) = rest.split_at_mut(length);
            parts.push((tile, pixels));
            rest = others;
        }
        parts
    }

    // Look a pixel up
    /// The pixel of column `x` and row `y`.
    pub fn pixel(&self, x: u32, y: u32) -> &Accumulator {
        let columns = self.width.div_ceil(SIDE);
        let rank = self.ranks[(y / SIDE * columns + x / SIDE) as usize];
        let tile = &self.tiles[rank as usize];
        let inside = y % SIDE * tile.size.0 + x % SIDE;
        &self.pixels[tile.start + inside as usize]
    }
}

impl Film {
    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Number of pixels.
    pub fn area(&self) -> u64 {
        self.pixels.len() as u64
    }
}

impl Film {
    /// The pixels, row by row from the top left.
    pub fn rows(&self) -> impl Iterator<Item = &Accumulator> {
        let row = move |y| (0..self.width).map(move |x| self.pixel(x, y));
        (0..self.height).flat_map(row)
    }

    /// The means of the pixels, row by row from the top left.
    pub fn means(&self) -> impl Iterator<Item = f64> {
        self.rows().map(Accumulator::mean)
    }

    /// The samples of the pixels, row by row from the top left.
    pub fn counts(&self) -> impl Iterator<Item = u64> {
        self.rows().map(Accumulator::count)
    }

    // Lend the pixels as they are stored
    /// The pixels in the order in which they are stored.
    pub fn stored(&self) -> &[Accumulator] {
        &self.pixels
    }

    /// The same, to be changed.
    pub fn stored_mut(&mut self) -> &mut [Accumulator] {
        &mut self.pixels
    }
}

// Order the tiles along the curve
/// The number of cells that Hilbert's curve visits before the cell
/// (`x`, `y`) of a grid of `side` by `side`, a power of two.
fn distance(side: u32, mut x: u32, mut y: u32) -> u64 {
    let mut cells = 0;
    let mut s = side / 2;
    while s > 0 {
        let (right, lower) = (x & s > 0, y & s > 0);
        let before = (3 * u64::from(right)) ^ u64::from(lower);
        cells += before * u64::from(s) * u64::from(s);
        // Turn the quarter upright
        (x, y) = (x & (s - 1), y & (s - 1));
        if !lower {
            if right {
                (x, y) = (s - 1 - x, s - 1 - y);
            }
            (x, y) = (y, x);
        }
        s /= 2;
    }
    cells
}

// Summarise the image in a few numbers
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
    /// The number of pixels whose samples are all alike.
    pub constant: u64,
}

impl Film {
    /// Summarises the image.
    pub fn summary(&self) -> Summary {
        let tiles = self.tiles.par_iter().map(|tile| {
            let length = (tile.size.0 * tile.size.1) as usize;
            let pixels = &self.pixels[tile.start..tile.start + length];
            // Sum over the pixels of a tile
            let (mut mean, mut squares, mut constant) = (0., 0., 0);
            for pixel in pixels {
                let variance = pixel.variance();
                mean += pixel.mean();
                squares += variance / pixel.count().max(1) as f64;
                constant += u64::from(variance == 0.);
            }
            (mean, squares, constant)
        });
        let sums: Vec<(f64, f64, u64)> = tiles.collect();
        // Add the sums of all tiles
        let mean: f64 = sums.iter().map(|sum| sum.0).sum();
        let squares: f64 = sums.iter().map(|sum| sum.1).sum();
        let n = self.pixels.len() as f64;
        Summary {
            mean: mean / n,
            mean_stderr: squares.sqrt() / n,
            rmse: (squares / n).sqrt(),
            constant: sums.iter().map(|sum| sum.2).sum(),
        }
    }
}

// Estimate the errors of all pixels
/// How far a pixel looks for neighbours, in pixels.
const REACH: u32 = 2;

/// How many samples the variance of the neighbours is worth.
pub const WORTH: f64 = 4.;

impl Film {
    /// The standard errors of the pixels, row by row from the top left;
    /// infinite where unknown. The variance that a pixel has seen is
    /// combined with that of its neighbours, which counts as `worth`
    /// samples ([`WORTH`]; 0 leaves the neighbours out).
    pub fn errors(&self, worth: f64) -> Vec<f64> {
        // Compute the variances row by row
        let place = |i: usize| {
            let width = self.width as usize;
            ((i % width) as u32, (i / width) as u32)
        };
        let pixels = (0..self.pixels.len()).into_par_iter().map(place);
        let variance = |(x, y)| self.pixel(x, y).variance();
        let variances: Vec<f64> = pixels.clone().map(variance).collect();
        let error = |((x, y), &own): ((u32, u32), &f64)| {
            let n = self.pixel(x, y).count() as f64;
            // Combine the variance with the neighbours'
            let variance = match self.around(&variances, x, y) {
                Some(v) if own.is_finite() => {
                    ((n - 1.) * own + worth * v) / (n - 1. + worth)
                }
                _ => own,
            };
            (variance / n.max(1.)).sqrt()
        };
        pixels.zip(&variances).map(error).collect()
    }

    // Average the variances around a pixel
    /// The mean of the finite variances within `REACH` of a pixel, without
    /// its own; none if there are none.
    fn around(&self, variances: &[f64], x: u32, y: u32) -> Option<f64> {
        let near = |at: u32, end: u32| {
            at.saturating_sub(REACH)..(at + REACH + 1).min(end)
        };
        let (mut sum, mut count) = (0., 0.);
        for row in near(y, self.height) {
            for column in near(x, self.width) {
                // Count the variance of one neighbour
                let index = u64::from(row) * u64::from(self.width);
                let variance = variances[index as usize + column as usize];
                if variance.is_finite() && (column, row) != (x, y) {
                    (sum, count) = (sum + variance, count + 1.);
                }
            }
        }
        (count > 0.).then_some(sum / count)
    }
}
