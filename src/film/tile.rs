// Tangled from chapters/film.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Tiles and windows: rectangles of pixels of an image, and the order of the
//! tiles along Hilbert's curve.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Width and height of a tile of an image in pixels.
pub const SIDE: u32 = 16;

/// The height of a tile. A list is a single column, and its tiles have as
/// many pixels as those of an image.
pub fn tile_height(is_list: bool) -> u32 {
    if is_list { SIDE * SIDE } else { SIDE }
}

/// A rectangle of pixels that one thread renders at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// Column and row of its first pixel in the image.
    pub corner: (u32, u32),
    /// Its width, at most `SIDE`, and height, at most `tile_height`.
    pub size: (u32, u32),
    /// Number of pixels in the tiles before it.
    pub(super) start: usize,
    /// Its number along Hilbert's curve.
    pub(super) number: u32,
}

impl Tile {
    /// Number of its pixels.
    pub fn area(&self) -> usize {
        (self.size.0 * self.size.1) as usize
    }
}

/// A rectangle of pixels of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Window {
    /// Column and row of its first pixel in the image.
    pub corner: (u32, u32),
    /// Its width and height in pixels, at least 1.
    pub size: (u32, u32),
}

/// A window as it is typed: `X,Y,WxH`.
impl From<Window> for String {
    fn from(window: Window) -> Self {
        let Window { corner: (x, y), size: (width, height) } = window;
        format!("{x},{y},{width}x{height}")
    }
}

impl TryFrom<String> for Window {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        let syntax = "expected a pixel and a size, as in 100,50,64x48";
        let fault = || Error::value("window", &text, syntax);
        let parts: Vec<&str> = text.split(',').collect();
        let [x, y, size] = parts[..] else { return Err(fault()) };
        let corner = digits(x).ok().zip(digits(y).ok());
        let corner = corner.ok_or_else(fault)?;
        Ok(Self { corner, size: parse_size(size)? })
    }
}

/// Reads a width and a height, as in 800x600.
///
/// # Errors
/// The text has another form, or a side is out of range.
pub fn parse_size(text: &str) -> Result<(u32, u32)> {
    let side =
        |text| digits(text).ok().filter(|n| (1..=MAX_SIDE).contains(n));
    let size = text.split_once('x');
    let size = size.and_then(|(w, h)| side(w).zip(side(h)));
    let syntax = || {
        format!(
            "expected two positive integers around one x, as in 800x600, \
             at most {MAX_SIDE} pixels a side"
        )
    };
    size.ok_or_else(|| Error::value("size", text, syntax()))
}

/// The greatest width or height of an image in pixels.
pub const MAX_SIDE: u32 = 16384;

/// Parses an integer that consists of digits alone.
pub fn digits<N: FromStr>(text: &str) -> Result<N, N::Err> {
    // The library would accept a plus as well.
    text.replace('+', "x").parse()
}

impl Window {
    /// The column and row after its last ones.
    pub fn end(&self) -> (u32, u32) {
        (self.corner.0 + self.size.0, self.corner.1 + self.size.1)
    }

    /// The first cell of the grid that it touches, and how many columns
    /// and rows of cells.
    pub(super) fn cells(&self, side: u32) -> ((u32, u32), (u32, u32)) {
        let (left, top) = (self.corner.0 / SIDE, self.corner.1 / side);
        let (right, bottom) = self.end();
        let columns = right.div_ceil(SIDE) - left;
        ((left, top), (columns, bottom.div_ceil(side) - top))
    }

    /// This window and the pixels at most `reach` columns and rows away,
    /// as far as they lie `within` another window.
    pub(crate) fn grown(&self, reach: u32, within: Self) -> Self {
        let ((x, y), (left, top)) = (self.corner, within.corner);
        let [ends, limits] = [self.end(), within.end()];
        let start = |at: u32, first| at.saturating_sub(reach).max(first);
        let (x, y) = (start(x, left), start(y, top));
        let length =
            |start, end: u32, last| (end + reach).min(last) - start;
        let size =
            (length(x, ends.0, limits.0), length(y, ends.1, limits.1));
        Self { corner: (x, y), size }
    }

    /// The number of pixels.
    pub fn area(&self) -> usize {
        self.size.0 as usize * self.size.1 as usize
    }

    /// At most `most` of its rows, from row `first` on.
    pub fn rows(&self, first: u32, most: u32) -> Self {
        let ((left, top), (width, height)) = (self.corner, self.size);
        let size = (width, most.min(height - first));
        Self { corner: (left, top + first), size }
    }

    /// The values of its pixels, from a `list` of those of a window around
    /// it; both row by row.
    pub fn crop<T: Copy>(&self, list: &[T], whole: Self) -> Vec<T> {
        let left = (self.corner.0 - whole.corner.0) as usize;
        let top = (self.corner.1 - whole.corner.1) as usize;
        let across = left..left + self.size.0 as usize;
        let rows = list.chunks(whole.size.0 as usize).skip(top);
        let rows = rows.take(self.size.1 as usize);
        rows.flat_map(|row| &row[across.clone()]).copied().collect()
    }

    /// The number of rows of tiles of this height that it touches.
    pub fn tile_rows(&self, height: u32) -> u32 {
        self.cells(height).1.1
    }

    /// The `k`-th of `n` bands, where tiles have this height; `k` is from 1 to
    /// `n`, which is at most `tile_rows`.
    pub fn band(&self, (k, n): (u32, u32), height: u32) -> Self {
        let ((_, top), (_, rows)) = self.cells(height);
        let edge = |k| {
            let row = top + (u64::from(rows) * k / u64::from(n)) as u32;
            (row * height).clamp(self.corner.1, self.end().1)
        };
        let (from, to) = (edge(u64::from(k) - 1), edge(u64::from(k)));
        self.rows(from - self.corner.1, to - from)
    }
}

/// The number of cells that Hilbert's curve visits before the cell
/// (`x`, `y`) of a grid of `side` by `side`, a power of two.
pub(super) fn along_curve(side: u32, mut x: u32, mut y: u32) -> u64 {
    let mut cells = 0;
    let mut s = side / 2;
    while s > 0 {
        let (right, lower) = (x & s > 0, y & s > 0);
        let before = (3 * u64::from(right)) ^ u64::from(lower);
        cells += before * u64::from(s) * u64::from(s);
        (x, y) = match (right, lower) {
            (_, true) => (x, y),
            (false, _) => (y, x),
            (true, _) => (!y, !x),
        };
        s /= 2;
    }
    cells
}

/// The numbers below `n`, in an order of which every beginning is spread
/// evenly (van der Corput 1935).
pub(super) fn van_der_corput(n: usize) -> impl Iterator<Item = usize> {
    let indices = 0..n.next_power_of_two();
    let bits = indices.end.trailing_zeros();
    let reversed = move |i: usize| i.reverse_bits().rotate_left(bits);
    indices.map(reversed).filter(move |&i| i < n)
}
