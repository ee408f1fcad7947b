// Tangled from chapters/filter.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Blocks of an image that choose how they are filtered.

use std::array;

use glam::{DVec2, Vec2};
use rayon::prelude::*;

/// What a pixel shows: one surface, several, or some and the sky.
pub const CLASSES: usize = 3;

/// The best filters so far for each class of pixels in each block.
pub struct Best<'a> {
    grid: &'a Grid,
    /// What each pixel shows, if any surface.
    classes: &'a [Option<usize>],
    errors: Vec<[f64; CLASSES]>,
    /// The pixels, by the filters of the four blocks around them.
    shown: Vec<[Vec2; 4]>,
}

impl<'a> Best<'a> {
    /// No filter so far.
    pub fn new(grid: &'a Grid, classes: &'a [Option<usize>]) -> Self {
        let errors = vec![[f64::INFINITY; CLASSES]; grid.count()];
        let shown = vec![[Vec2::ZERO; 4]; classes.len()];
        Self { grid, classes, errors, shown }
    }

    /// Adopts what a filter shows where its error, given for each block, is
    /// less. The error of the whole image decides where a block has none.
    pub fn offer(&mut self, way: &[Vec2], own: &[[DVec2; CLASSES]]) {
        let Self { grid, classes, errors, shown } = self;
        // Find the blocks in which it is better
        let all: [f64; CLASSES] = array::from_fn(|class| {
            own.iter().map(|it| it[class].element_sum()).sum()
        });
        let better = errors.iter_mut().zip(own).map(|(least, own)| {
            array::from_fn(|class| {
                let error = own[class].element_sum() + 1e-6 * all[class];
                let is_better = error < least[class];
                least[class] = least[class].min(error);
                is_better
            })
        });
        let better: Vec<[bool; CLASSES]> = better.collect();
        let pixels = shown.par_iter_mut().zip(way).enumerate();
        pixels.for_each(|(p, (shown, way))| {
            let takes = |block: usize| {
                classes[p].is_none_or(|class| better[block][class])
            };
            for (shown, (block, _)) in shown.iter_mut().zip(grid.near(p)) {
                if takes(block) {
                    *shown = *way;
                }
            }
        });
    }
}

impl Best<'_> {
    /// Blends the choices of the blocks.
    pub fn blend(&self) -> Vec<Vec2> {
        let pixel = |(p, shown): (usize, &[Vec2; 4])| {
            let parts = self.grid.near(p).into_iter().zip(shown);
            parts.map(|((_, part), &it)| part * it).sum()
        };
        self.shown.par_iter().enumerate().map(pixel).collect()
    }
}

/// Blocks of about 80 by 80 pixels that choose their filter.
pub struct Grid {
    /// The width of the image in pixels.
    pub width: usize,
    /// The number of blocks along each side.
    pub blocks: [usize; 2],
    /// The place of each column and each row.
    sides: [Vec<Side>; 2],
}

/// The place of a column or a row of pixels: its block, and the two blocks
/// whose middles are around it, with the part of each.
#[derive(Clone, Copy)]
struct Side {
    block: usize,
    near: [(usize, f32); 2],
}

impl Grid {
    pub fn new(width: usize, height: usize) -> Self {
        let blocks = [width, height].map(|n| (n / 80).max(1));
        let side = |n: usize, blocks: usize| {
            let place = |i: usize| {
                let at = (i as f32 + 0.5) * (blocks as f32 / n as f32);
                let (block, middle) = (at as usize, at + 0.5);
                let (after, part) = (middle as usize, middle.fract());
                let near = [
                    (after.max(1) - 1, 1. - part),
                    (after.min(blocks - 1), part),
                ];
                Side { block, near }
            };
            (0..n).map(place).collect()
        };
        let sides = [side(width, blocks[0]), side(height, blocks[1])];
        Self { width, blocks, sides }
    }
}

impl Grid {
    pub fn count(&self) -> usize {
        self.blocks[0] * self.blocks[1]
    }

    /// The places of the column and the row of a pixel.
    fn place(&self, p: usize) -> [Side; 2] {
        let [columns, rows] = &self.sides;
        [columns[p % self.width], rows[p / self.width]]
    }

    /// The block of a pixel.
    pub fn block(&self, p: usize) -> usize {
        let [column, row] = self.place(p);
        row.block * self.blocks[0] + column.block
    }

    /// The four blocks whose middles are around a pixel, and their parts.
    fn near(&self, p: usize) -> [(usize, f32); 4] {
        let [column, row] = self.place(p);
        array::from_fn(|k| {
            let ((column, across), (row, down)) =
                (column.near[k % 2], row.near[k / 2]);
            (row * self.blocks[0] + column, across * down)
        })
    }
}
