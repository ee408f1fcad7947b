// Tangled from chapters/film.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The sums of an image in the making, or of a part of it: a rectangle of
//! accumulators, cut into tiles along Hilbert's curve.
//!
//! Pixels are counted from the top left of the whole image. Those of one
//! tile lie together in memory, so that threads write to separate pieces.
//! The pixels of a tile hold the same samples, from the first on.

use std::io::{self, Read, Write};
use std::ops::Range;
use std::str::FromStr;

use glam::{DVec2, DVec3, Vec2};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::memory::zeroed;
use crate::numerics::power_of_two;
use crate::statistics::Accumulator;

/// Width and height of a tile of an image in pixels.
pub const SIDE: u32 = 16;

/// The height of a tile: one of a list, in a single column, has as many
/// pixels.
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
    start: usize,
    /// Its number along Hilbert's curve.
    number: u32,
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
/// The text is another, or a side is out of range.
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

/// The most pixels that an image is wide or high.
const MAX_SIDE: u32 = 16384;

/// An integer of digits alone.
pub fn digits<N: FromStr>(text: &str) -> Result<N, N::Err> {
    // The library would take a plus as well.
    text.replace('+', "x").parse()
}

/// A tile of a film, to be filled.
pub struct FilmTile<'a> {
    /// Where it lies.
    pub tile: Tile,
    /// Its pixels, row by row.
    pub pixels: &'a mut [Accumulator],
    /// Its mean, if the film has one.
    pub mean: Option<&'a mut Accumulator>,
    /// The halves of its pixels, or nothing if the film has none.
    pub halves: &'a mut [Halves],
}

/// An image in the making, or a part of it: one accumulator per pixel.
#[derive(Clone, Debug)]
pub struct Film {
    /// Width and height of the whole image.
    pub resolution: (u32, u32),
    /// Whether it lists receivers, which have no neighbours, in one column.
    pub is_list: bool,
    /// The pixels that it holds.
    pub window: Window,
    /// The window of its run.
    pub whole: Window,
    /// The samples of each pixel that come before its own.
    pub first: u64,
    /// The samples of a replicate, which were placed together and whose mean is
    /// one value of an accumulator; on average over the pixels.
    pub replicate: u64,
    tiles: Vec<Tile>,
    /// The place of each tile in `tiles`, by row and column.
    places: Vec<u32>,
    /// The pixels in the order in which they are stored: tile by tile, each
    /// row by row.
    pub pixels: Vec<Accumulator>,
    /// The means of each tile, if its pixels share random numbers; else none.
    pub tile_means: Vec<Accumulator>,
    /// The halves of the pixels, in the same order; none unless a picture is
    /// to be filtered.
    pub halves: Vec<Halves>,
}

/// Watches the work on a film: called, from any thread, with what is done,
/// as the paths that a finished tile has taken, and with 0 in between.
/// Answers whether to go on.
pub type Watch<'a> = dyn Fn(u64) -> bool + Sync + 'a;

/// The values of a pixel in two halves, those of even and of odd numbers: of
/// each the sums of what was gathered and of its corrections, in units of
/// 2^-32, and the number of values.
pub type Halves = [[i64; 3]; 2];

/// Adds the value of this number: what was gathered, and its correction.
pub fn add_value(halves: &mut Halves, number: u64, parts: [f64; 2]) {
    let [gathered, corrected] = parts.map(|part| (part * UNIT) as i64);
    let half = &mut halves[(number % 2) as usize];
    for (sum, more) in half.iter_mut().zip([gathered, corrected, 1]) {
        *sum = sum.wrapping_add(more);
    }
}

/// Takes all values of other halves into account.
pub fn add_halves(halves: &mut [Halves], others: &[Halves]) {
    let others = others.as_flattened().as_flattened();
    let halves = halves.as_flattened_mut().as_flattened_mut();
    for (sum, more) in halves.iter_mut().zip(others) {
        *sum = sum.wrapping_add(*more);
    }
}

/// Units of the sums of halves in 1.
const UNIT: f64 = power_of_two(32);

impl Window {
    /// The column and row after its last ones.
    pub fn end(&self) -> (u32, u32) {
        (self.corner.0 + self.size.0, self.corner.1 + self.size.1)
    }

    /// The first cell of the grid that it touches, and how many columns
    /// and rows of cells.
    fn cells(&self, side: u32) -> ((u32, u32), (u32, u32)) {
        let (left, top) = (self.corner.0 / SIDE, self.corner.1 / side);
        let (right, bottom) = self.end();
        let columns = right.div_ceil(SIDE) - left;
        ((left, top), (columns, bottom.div_ceil(side) - top))
    }

    /// This and the pixels that are at most so many columns and rows away,
    /// as far as they lie `within` another window.
    fn grown(&self, reach: u32, within: Self) -> Self {
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

    /// At most so many of its rows, from row `first` on.
    pub fn rows(&self, first: u32, most: u32) -> Self {
        let ((left, top), (width, height)) = (self.corner, self.size);
        let size = (width, most.min(height - first));
        Self { corner: (left, top + first), size }
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

impl Film {
    /// The film of a whole image of at least one pixel, without a sample.
    pub fn new(width: u32, height: u32) -> Self {
        let window = Window { corner: (0, 0), size: (width, height) };
        Self::cropped((width, height), window, false)
    }

    /// The tiles of a window, and the place of each by row and column.
    fn layout(window: Window, height: u32) -> (Vec<Tile>, Vec<u32>) {
        let ((left, top), (columns, rows)) = window.cells(height);
        let side = columns.max(rows).next_power_of_two();
        let row = |y| (0..columns).map(move |x| (x, y));
        let mut cells = Vec::from_iter((0..rows).flat_map(row));
        cells.par_sort_by_cached_key(|&(x, y)| along_curve(side, x, y));
        let mut places = vec![0; cells.len()];
        let mut tiles = Vec::with_capacity(cells.len());
        let mut start = 0;
        for (place, number) in van_der_corput(cells.len()).enumerate() {
            let (x, y) = cells[number];
            // Append the tile of one cell
            places[(y * columns + x) as usize] = place as u32;
            let corner = ((left + x) * SIDE, (top + y) * height);
            let cell = Window { corner, size: (SIDE, height) };
            let Window { corner, size } = cell.grown(0, window);
            tiles.push(Tile { corner, size, start, number: number as u32 });
            start += (size.0 * size.1) as usize;
        }
        (tiles, places)
    }

    /// The film of a window that lies within an image of this `resolution`,
    /// or within a list.
    pub fn cropped(
        resolution: (u32, u32),
        window: Window,
        is_list: bool,
    ) -> Self {
        let (tiles, places) = Self::layout(window, tile_height(is_list));
        let pixels = zeroed(window.area()).expect("memory for a film");
        // Make a film of these tiles
        Self {
            resolution,
            is_list,
            window,
            whole: window,
            first: 0,
            replicate: 1,
            tiles,
            places,
            pixels,
            tile_means: vec![],
            halves: vec![],
        }
    }

    /// The tiles in the order in which they are rendered.
    pub fn tiles(&mut self) -> Vec<FilmTile<'_>> {
        let begun = self.pixels[0].count() > 0;
        let mut rest = &mut self.pixels[..];
        let mut halves = &mut self.halves[..];
        let mut means = self.tile_means.iter_mut();
        let part = |&tile: &Tile| FilmTile {
            tile,
            pixels: rest.split_off_mut(..tile.area()).unwrap_or_default(),
            mean: means.next(),
            halves: halves.split_off_mut(..tile.area()).unwrap_or_default(),
        };
        let mut parts: Vec<_> = self.tiles.iter().map(part).collect();
        if begun {
            parts.sort_unstable_by_key(|part| part.tile.number);
        }
        parts
    }

    /// The pixel of column `x` and row `y` of the image, in the window.
    pub fn pixel(&self, x: u32, y: u32) -> &Accumulator {
        let tile = &self.tiles[self.place(x, y)];
        let (column, row) = (x - tile.corner.0, y - tile.corner.1);
        &self.pixels[tile.start + (row * tile.size.0 + column) as usize]
    }

    /// The place in memory of the tile that holds a pixel.
    fn place(&self, x: u32, y: u32) -> usize {
        let side = self.tile_height();
        let ((left, top), (columns, _)) = self.window.cells(side);
        let cell = (y / side - top) * columns + x / SIDE - left;
        self.places[cell as usize] as usize
    }

    /// Number of pixels.
    pub fn area(&self) -> u64 {
        self.pixels.len() as u64
    }

    /// Bands of at most `SIDE` rows of its window.
    fn bands(&self) -> impl IndexedParallelIterator<Item = Window> {
        let tops = (0..self.window.size.1).into_par_iter();
        tops.step_by(SIDE as usize).map(|top| self.window.rows(top, SIDE))
    }

    /// The tiles of the whole window of its run.
    pub fn all_tiles(&self) -> Vec<Tile> {
        Self::layout(self.whole, self.tile_height()).0
    }

    /// The height of its tiles.
    pub fn tile_height(&self) -> u32 {
        tile_height(self.is_list)
    }

    /// The pixels, row by row from the top left.
    pub fn rows(&self) -> impl Iterator<Item = &Accumulator> {
        let strips = self.strips(self.window);
        strips.flat_map(|(_, strip)| &self.pixels[strip])
    }

    /// A term of the halves of each pixel, row by row: sums of what was gathered
    /// (0) or of corrections (1), or numbers of values (2).
    pub fn halves_of(&self, term: usize) -> impl Iterator<Item = Vec2> {
        let unit = if term < 2 { UNIT } else { 1. };
        let strips = self.strips(self.window);
        let halves = strips.flat_map(|(_, strip)| self.halves.get(strip));
        halves.flatten().map(move |halves| {
            Vec2::from(halves.map(|half| (half[term] as f64 / unit) as f32))
        })
    }

    /// Where the pixels of a window are stored, row by row, those of each tile
    /// together, with the place of the tile.
    fn strips(
        &self,
        window: Window,
    ) -> impl Iterator<Item = (usize, Range<usize>)> {
        let ((left, _), (columns, _)) = window.cells(SIDE);
        let strip = move |column, y| {
            let place = self.place(column * SIDE, y);
            let Tile { corner, size, start, .. } = self.tiles[place];
            let x = corner.0.max(window.corner.0);
            let length = (corner.0 + size.0).min(window.end().0) - x;
            let at =
                start + ((y - corner.1) * size.0 + x - corner.0) as usize;
            (place, at..at + length as usize)
        };
        let columns =
            move |y| (left..left + columns).map(move |x| strip(x, y));
        (window.corner.1..window.end().1).flat_map(columns)
    }

    /// The means of the pixels, row by row from the top left.
    pub fn means(&self) -> impl Iterator<Item = f64> {
        self.rows().map(Accumulator::mean)
    }

    /// Whether the tile of this place has a sample.
    fn is_sampled(&self, place: usize) -> bool {
        self.pixels[self.tiles[place].start].count() > 0
    }

    /// A value of each pixel of a window, row by row: `none` without a sample.
    fn values(
        &self,
        window: Window,
        none: f64,
        of: impl Fn(usize, &Accumulator) -> f64,
    ) -> Vec<f64> {
        let mut values = Vec::with_capacity(window.area());
        // Append the values of a strip
        for (place, strip) in self.strips(window) {
            let strip = &self.pixels[strip];
            match self.is_sampled(place) {
                true => values.extend(strip.iter().map(|p| of(place, p))),
                false => values.resize(values.len() + strip.len(), none),
            }
        }
        values
    }

    /// The means of a window, row by row; not a number without a sample.
    pub fn means_of(&self, window: Window) -> Vec<f64> {
        self.values(window, f64::NAN, |_, pixel| pixel.mean())
    }

    /// The samples of the pixels of a window, row by row, given those of each
    /// pixel of the run in a replicate, if they differ.
    pub fn counts_of(
        &self,
        window: Window,
        own: Option<&[u32]>,
    ) -> Vec<f64> {
        let counts = self.values(window, 0., |_, p| p.count() as f64);
        let (whole, (left, top)) = (self.whole, window.corner);
        let at = |i: u32| {
            let (x, y) =
                (left + i % window.size.0, top + i / window.size.0);
            (y - whole.corner.1) * whole.size.0 + x - whole.corner.0
        };
        let each = |i| {
            own.map_or(self.replicate, |own| own[at(i) as usize].into())
                as f64
        };
        (0..).zip(counts).map(|(i, count)| count * each(i)).collect()
    }

    /// The samples that every pixel has at least.
    pub fn samples(&self) -> u64 {
        let tiles = self.tiles.iter();
        let counts = tiles.map(|tile| self.pixels[tile.start].count());
        counts.min().unwrap_or(0) * self.replicate
    }

    /// The number of pixels without a sample.
    pub fn unsampled(&self) -> u64 {
        let tiles = self.tiles.iter().enumerate();
        let empty = tiles.filter(|(place, _)| !self.is_sampled(*place));
        empty.map(|(_, tile)| tile.area() as u64).sum()
    }

    /// The number of pixels with a sample whose mean is below a radiance.
    pub fn darker(&self, radiance: f64) -> u64 {
        let is_dark =
            |p: &&Accumulator| p.count() > 0 && p.mean() < radiance;
        self.pixels.par_iter().filter(is_dark).count() as u64
    }

    /// The same film, whose accumulators take one value for so many samples.
    /// It must be empty.
    pub fn with_replicates(self, samples: u64) -> Self {
        Self { replicate: samples, ..self }
    }

    /// The same film, whose pixels share random numbers within a tile. It must
    /// be empty.
    pub fn with_shared_tiles(mut self) -> Self {
        self.tile_means = vec![Accumulator::default(); self.tiles.len()];
        self
    }

    /// The same film, which keeps halves. It must be empty.
    pub fn with_halves(mut self) -> Self {
        self.halves = vec![Halves::default(); self.pixels.len()];
        self
    }

    /// Takes the samples of a film of some of its tiles into account.
    pub fn merge(&mut self, part: &Self) {
        if part.halves.is_empty() {
            self.halves.clear();
        }
        for (number, tile) in part.tiles.iter().enumerate() {
            let place = self.place(tile.corner.0, tile.corner.1);
            let Tile { start, size, .. } = self.tiles[place];
            assert_eq!(size, tile.size, "the tile at {:?}", tile.corner);
            let own = &mut self.pixels[start..];
            let more = &part.pixels[tile.start..][..tile.area()];
            own.iter_mut().zip(more).for_each(|(p, q)| p.merge(q));
            if let Some(mean) = part.tile_means.get(number) {
                self.tile_means[place].merge(mean);
            }
            if !self.halves.is_empty() {
                let own = &mut self.halves[start..];
                let more = &part.halves[tile.start..][..tile.area()];
                add_halves(own, more);
            }
        }
    }

    /// Writes the sums.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        for sums in self.pixels.iter().chain(&self.tile_means) {
            out.write_all(&sums.to_bytes())?;
        }
        let mut halves = self.halves.as_flattened().as_flattened().iter();
        halves.try_for_each(|sum| out.write_all(&sum.to_le_bytes()))
    }

    /// Fills an empty film with sums that one of the same run has written.
    pub fn read(&mut self, from: &mut dyn Read) -> io::Result<()> {
        let mut bytes = [0; 64];
        for sums in self.pixels.iter_mut().chain(&mut self.tile_means) {
            from.read_exact(&mut bytes)?;
            *sums = Accumulator::from_bytes(&bytes);
        }
        let mut bytes = [0; 8];
        for sum in self.halves.as_flattened_mut().as_flattened_mut() {
            from.read_exact(&mut bytes)?;
            *sum = i64::from_le_bytes(bytes);
        }
        Ok(())
    }

    /// Summarises the image, with the errors that [`Film::errors`] gives
    /// for [`WORTH`].
    pub fn summary(&self) -> Summary {
        let few = self.samples() < 2 * self.replicate;
        // Sum numbers of all pixels over rows
        let rows = self.bands().flat_map_iter(|band| {
            let means = self.values(band, 0., |_, p| p.mean()).into_iter();
            let errors = match few {
                true => vec![DVec2::INFINITY; band.area()],
                false => self.errors_and_variances(WORTH, band),
            };
            let pixels = means.zip(errors).map(|(mean, e)| {
                DVec3::new(mean, e.x * e.x, f64::from(e.y == 0.))
            });
            let pixels: Vec<DVec3> = pixels.collect();
            let rows = pixels.chunks(self.window.size.0 as usize);
            rows.map(|row| row.iter().sum()).collect::<Vec<DVec3>>()
        });
        let sums: DVec3 = rows.collect::<Vec<_>>().iter().sum();
        let [radiance, squares, constant] = sums.to_array();
        // Conclude from the sums
        let Self { tiles, tile_means: means, .. } = self;
        let tiles = tiles.iter().zip(means).map(|(tile, mean)| {
            (tile.area() as f64 * mean.standard_error()).powi(2)
        });
        let all = if means.is_empty() { squares } else { tiles.sum() };
        let n = self.area() as f64;
        let sampled = self.area() - self.unsampled();
        Summary {
            mean: radiance / sampled.max(1) as f64,
            mean_stderr: f64::sqrt(all) / n,
            rmse: (squares / n).sqrt(),
            constant: constant as u64,
        }
    }
}

/// The number of cells that Hilbert's curve visits before the cell
/// (`x`, `y`) of a grid of `side` by `side`, a power of two.
fn along_curve(side: u32, mut x: u32, mut y: u32) -> u64 {
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

/// The numbers below `n`, such that those before any place are spread
/// evenly (van der Corput 1935).
fn van_der_corput(n: usize) -> impl Iterator<Item = usize> {
    let all = 0..n.next_power_of_two();
    let bits = all.end.trailing_zeros();
    let reversed = move |i: usize| i.reverse_bits().rotate_left(bits);
    all.map(reversed).filter(move |&i| i < n)
}

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

/// How far a pixel looks for neighbours, in pixels.
const REACH: u32 = 2;

/// How many samples the variance of the neighbours is worth.
pub const WORTH: f64 = 4.;

impl Film {
    /// The standard errors of the pixels of a window, row by row; infinite
    /// where unknown. The variance that a pixel has seen is combined with that
    /// of its neighbours, which counts as `worth` values ([`WORTH`]; 0 leaves
    /// the neighbours out).
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
        let all = window.grown(REACH, self.window);
        let variances =
            self.values(all, f64::INFINITY, |_, p| p.variance());
        let counts = self.values(window, 0., |_, p| p.count() as f64);
        let (width, columns) =
            (all.size.0 as usize, window.size.0 as usize);
        let rows: Vec<&[f64]> = variances.chunks(width).collect();
        let left = (window.corner.0 - all.corner.0) as usize;
        let top = (window.corner.1 - all.corner.1) as usize;
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
                    let known = DVec2::new(variance, 1.);
                    *sum += if counts { known } else { DVec2::ZERO };
                }
            }
            for (x, n) in (left..).zip(counts) {
                // Compute the error of a pixel
                let own = rows[y][x];
                let square: DVec2 = sums[near(x, width)].iter().sum();
                let [sum, count] =
                    (square - DVec2::new(own, 1.)).to_array();
                let alone = count == 0. || self.is_list;
                let variance = if alone || !own.is_finite() {
                    own
                } else {
                    ((n - 1.) * own + worth * (sum / count))
                        / (n - 1. + worth)
                };
                errors.push(DVec2::new((variance / n).sqrt(), own));
            }
        }
        errors
    }

    /// An error of the image; infinite if it is unknown.
    pub fn error(&self, measure: Measure) -> f64 {
        let sums = self.bands().map(|band| {
            let errors = self.errors(WORTH, band).into_iter();
            let squares =
                errors.zip(self.means_of(band)).map(|(error, mean)| {
                    let whole = if measure.relative { mean } else { 1. };
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
        if measure.largest { most.sqrt() } else { mean.sqrt() }
    }

    /// The standard error with which each pixel of a window counts in a sum
    /// over whole tiles, row by row: that of the mean of its tile
    /// times the root of the number of its pixels; infinite where unknown.
    /// None if the pixels are independent.
    pub fn tile_errors(&self, window: Window) -> Option<Vec<f64>> {
        let Self { tiles, tile_means, .. } = self;
        let error = |place: usize, _: &Accumulator| {
            let root = (tiles[place].area() as f64).sqrt();
            root * tile_means[place].standard_error()
        };
        let shared = !tile_means.is_empty();
        shared.then(|| self.values(window, f64::INFINITY, error))
    }
}

/// Which error is held against a target.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize,
)]
pub struct Measure {
    /// As a part of the mean of each pixel.
    pub relative: bool,
    /// That of the worst pixel, not the root mean square of all.
    pub largest: bool,
}

impl Measure {
    /// Whether it is the root mean square of all.
    pub fn is_usual(&self) -> bool {
        *self == Self::default()
    }
}
