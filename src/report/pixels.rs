// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Images as part of a page.

use base64::prelude::{BASE64_STANDARD, Engine};
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError};
use rayon::prelude::*;

use crate::image::srgb::level;

// Shrink what is too large to show
/// The largest width and height of an embedded image.
const LARGEST: usize = 1280;

/// A rectangle of values, row by row.
pub struct Grid {
    width: usize,
    height: usize,
    values: Vec<f64>,
}

impl Grid {
    /// The values of an image, averaged over squares if it is large;
    /// none if they are too few or too many for its size.
    pub fn new(
        (width, height): (u32, u32),
        values: impl ExactSizeIterator<Item = f64>,
    ) -> Option<Self> {
        let (width, height) = (width as usize, height as usize);
        if width == 0 || width.checked_mul(height)? != values.len() {
            return None;
        }
        let side = width.max(height).div_ceil(LARGEST);
        let (columns, rows) = (width.div_ceil(side), height.div_ceil(side));
        // Sum the values in squares
        let mut sums = vec![0.; columns * rows];
        for (i, value) in values.enumerate() {
            let (x, y) = (i % width, i / width);
            sums[y / side * columns + x / side] += value;
        }
        // Divide each sum by its pixels
        for (i, sum) in sums.iter_mut().enumerate() {
            let (x, y) = (i % columns * side, i / columns * side);
            let area = side.min(width - x) * side.min(height - y);
            *sum /= area as f64;
        }
        Some(Self { width: columns, height: rows, values: sums })
    }
}

// Embed grey levels in a page
impl Grid {
    /// The address of an image of the values, `white` or more of which
    /// is white.
    pub fn embed(&self, white: f64) -> Option<String> {
        let levels = self.values.par_iter();
        let levels = levels.map(|x| level(x / white, 255) as u8);
        let bytes = self.encode(&levels.collect::<Vec<_>>()).ok()?;
        let text = BASE64_STANDARD.encode(bytes);
        Some(format!("data:image/png;base64,{text}"))
    }
}

impl Grid {
    fn encode(&self, levels: &[u8]) -> Result<Vec<u8>, EncodingError> {
        let mut bytes = vec![];
        let (width, height) = (self.width as u32, self.height as u32);
        let mut encoder = Encoder::new(&mut bytes, width, height);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_compression(Compression::Fast);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(levels)?;
        writer.finish()?;
        Ok(bytes)
    }
}

// Scale the map of the error
impl Grid {
    /// The root of each value.
    pub fn root(mut self) -> Self {
        self.values.iter_mut().for_each(|x| *x = x.sqrt());
        self
    }
}

impl Grid {
    /// The value that a thousandth of the finite positive ones exceed.
    pub fn white(&self) -> Option<f64> {
        let known = self.values.iter().copied();
        let known = known.filter(|x| *x > 0. && x.is_finite());
        let mut known: Vec<f64> = known.collect();
        let rank = known.len().checked_sub(1 + known.len() / 1000)?;
        let (_, white, _) =
            known.select_nth_unstable_by(rank, f64::total_cmp);
        Some(*white)
    }
}

/// The share of white that the grey in the middle of a scale means.
pub const MIDDLE: f64 = 0.214;
