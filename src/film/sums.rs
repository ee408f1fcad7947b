// Tangled from chapters/film.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The accumulators of the pixels of a window, and which samples they hold.

use std::io::{self, Read, Write};
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::fragments::Fragments;
use super::rows::Entry;
use super::tile::{SIDE, Tile, Window, tile_height};
use super::tile::{along_curve, van_der_corput};
use crate::memory::zeroed;
use crate::numerics::power_of_two;
use crate::statistics::Accumulator;

/// A tile of a film, to be filled.
pub struct FilmTile<'a> {
    /// Where it lies.
    pub tile: Tile,
    /// Its pixels, row by row.
    pub pixels: &'a mut [Accumulator],
    /// The rows of its pixels, or nothing if the film has none.
    pub rows: &'a mut [Vec<Entry>],
    /// Its mean, if the film has one.
    pub mean: Option<&'a mut Accumulator>,
    /// The halves of its fragments, or nothing if the film has none.
    pub halves: &'a mut [HalfBuffers],
    /// The fragments that its pixels show, if halves are to be filled.
    pub fragments: Option<&'a Fragments>,
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
    pub run_window: Window,
    /// The samples of each pixel that come before its own.
    pub sample_offset: u64,
    /// The samples of a replicate, which were placed together and whose mean is
    /// one value of an accumulator; on average over the pixels.
    pub net_size: u64,
    pub(super) tiles: Vec<Tile>,
    /// The place of each tile in `tiles`, by row and column.
    places: Vec<u32>,
    /// The pixels in the order in which they are stored: tile by tile, each
    /// row by row.
    pub pixels: Vec<Accumulator>,
    /// The rows of a tally, in the same order; none without a tally.
    pub rows: Vec<Vec<Entry>>,
    /// Whether the error of a pixel is the largest of the entries of its row.
    pub judges_rows: bool,
    /// The means of each tile, if its pixels share random numbers; else none.
    pub tile_means: Vec<Accumulator>,
    /// The halves of the fragments of each tile; none unless a picture is
    /// to be filtered.
    pub halves: Vec<Vec<HalfBuffers>>,
    /// The fragments that the pixels show, if halves are to be filled.
    pub fragments: Option<Arc<Fragments>>,
}

/// Watches a pass: any thread calls it with the number of paths that a
/// finished tile has taken, or with 0 in between. Returns whether to go
/// on.
pub type Watch<'a> = dyn Fn(u64) -> bool + Sync + 'a;

/// The samples of a fragment in two halves, those of even and those of odd
/// replicates. Each half has the sums of what was gathered and of its
/// corrections, in units of 2^-32, and the numbers of samples of both.
pub type HalfBuffers = [[i64; 4]; 2];

/// What a pilot has gathered for a fragment: for each half the sum, in
/// units of 2^-32, and the number of samples.
pub type Gathered = [[i64; 2]; 2];

/// The samples of a fragment in one replicate: the sums of what was
/// gathered and of its corrections, and the number of samples.
pub type Samples = ([f64; 2], u32);

/// Adds the samples of the replicate of this number to the halves of their
/// fragments.
pub fn add_samples(
    halves: &mut [HalfBuffers],
    number: u64,
    samples: &[Samples],
) {
    for (halves, (parts, count)) in halves.iter_mut().zip(samples) {
        let [gathered, corrected] = parts.map(|part| (part * UNIT) as i64);
        let half = &mut halves[(number % 2) as usize];
        let more = [gathered, corrected, (*count).into(), (*count).into()];
        for (sum, more) in half.iter_mut().zip(more) {
            *sum = sum.wrapping_add(more);
        }
    }
}

/// Adds the values of other halves.
pub(crate) fn add_halves(
    halves: &mut [HalfBuffers],
    others: &[HalfBuffers],
) {
    let others = others.as_flattened().as_flattened();
    let halves = halves.as_flattened_mut().as_flattened_mut();
    for (sum, more) in halves.iter_mut().zip(others) {
        *sum = sum.wrapping_add(*more);
    }
}

/// The number of units of the sums of halves in 1.
pub(crate) const UNIT: f64 = power_of_two(32);

impl Film {
    /// The film of a whole image of at least one pixel, without a sample.
    ///
    /// # Panics
    /// There is too little memory. A run checks this before
    /// ([`Run::film`](crate::run::Run::film)).
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
    ///
    /// # Panics
    /// There is too little memory, as for [`Film::new`].
    pub fn cropped(
        resolution: (u32, u32),
        window: Window,
        is_list: bool,
    ) -> Self {
        let (tiles, places) = Self::layout(window, tile_height(is_list));
        let pixels = zeroed(window.area()).expect("memory for a film");
        // Create a film of these tiles
        Self {
            resolution,
            is_list,
            window,
            run_window: window,
            sample_offset: 0,
            net_size: 1,
            tiles,
            places,
            pixels,
            rows: vec![],
            judges_rows: false,
            tile_means: vec![],
            halves: vec![],
            fragments: None,
        }
    }

    /// The tiles in the order in which they are rendered.
    pub fn tiles(&mut self) -> Vec<FilmTile<'_>> {
        let begun = self.pixels[0].count() > 0;
        let mut rest = &mut self.pixels[..];
        let mut rows = &mut self.rows[..];
        let mut halves = self.halves.iter_mut();
        let mut means = self.tile_means.iter_mut();
        let part = |&tile: &Tile| FilmTile {
            tile,
            pixels: rest.split_off_mut(..tile.area()).unwrap_or_default(),
            rows: rows.split_off_mut(..tile.area()).unwrap_or_default(),
            mean: means.next(),
            halves: halves
                .next()
                .map(Vec::as_mut_slice)
                .unwrap_or_default(),
            fragments: self.fragments.as_deref(),
        };
        let mut parts: Vec<_> = self.tiles.iter().map(part).collect();
        if begun {
            parts.sort_unstable_by_key(|part| part.tile.number);
        }
        parts
    }

    /// The pixel of column `x` and row `y` of the image, in the window.
    pub fn pixel(&self, x: u32, y: u32) -> &Accumulator {
        &self.pixels[self.at(x, y)]
    }

    /// The place in memory of this pixel, and of its row in a tally.
    pub fn at(&self, x: u32, y: u32) -> usize {
        let tile = self.tile(x, y);
        let (column, row) = (x - tile.corner.0, y - tile.corner.1);
        tile.start + (row * tile.size.0 + column) as usize
    }

    /// The tile that holds it.
    pub fn tile(&self, x: u32, y: u32) -> Tile {
        self.tiles[self.place(x, y)]
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
    pub(super) fn bands(
        &self,
    ) -> impl IndexedParallelIterator<Item = Window> {
        let tops = (0..self.window.size.1).into_par_iter();
        tops.step_by(SIDE as usize).map(|top| self.window.rows(top, SIDE))
    }

    /// The tiles of the whole window of its run.
    pub fn all_tiles(&self) -> Vec<Tile> {
        Self::layout(self.run_window, self.tile_height()).0
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

    /// The tiles with their halves.
    pub fn tiles_of_halves(
        &self,
    ) -> impl Iterator<Item = (&Tile, &[HalfBuffers])> {
        self.tiles.iter().zip(self.halves.iter().map(Vec::as_slice))
    }

    /// The ranges in which the pixels of a window are stored, row by row, one
    /// for each tile, with the place of the tile.
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

    /// A value of each pixel of a window, row by row, given its tile and its
    /// place: `none` without a sample.
    pub(super) fn values(
        &self,
        window: Window,
        none: f64,
        of: impl Fn(usize, usize) -> f64,
    ) -> Vec<f64> {
        let mut values = Vec::with_capacity(window.area());
        // Append the values of a strip
        for (place, strip) in self.strips(window) {
            match self.is_sampled(place) {
                true => values.extend(strip.map(|at| of(place, at))),
                false => values.resize(values.len() + strip.len(), none),
            }
        }
        values
    }

    /// The means of a window, row by row; not a number without a sample.
    pub fn means_of(&self, window: Window) -> Vec<f64> {
        self.values(window, f64::NAN, |_, at| self.pixels[at].mean())
    }

    /// The samples of the pixels of a window, row by row, given those of each
    /// pixel of the run in a replicate, if they differ.
    pub fn counts_of(
        &self,
        window: Window,
        net_sizes: Option<&[u32]>,
    ) -> Vec<f64> {
        let count = |_, at: usize| self.pixels[at].count() as f64;
        let counts = self.values(window, 0., count);
        let sizes =
            net_sizes.map(|list| window.crop(list, self.run_window));
        let size = |i: usize| match &sizes {
            Some(sizes) => sizes[i].into(),
            None => self.net_size,
        };
        let counts = counts.into_iter().enumerate();
        counts.map(|(i, count)| count * size(i) as f64).collect()
    }

    /// The number of samples that every pixel has at least.
    pub fn samples(&self) -> u64 {
        let tiles = self.tiles.iter();
        let counts = tiles.map(|tile| self.pixels[tile.start].count());
        counts.min().unwrap_or(0) * self.net_size
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

    /// The same film, whose accumulators take one value for this many
    /// `samples`. It must be empty.
    pub fn with_net_size(self, samples: u64) -> Self {
        Self { net_size: samples, ..self }
    }

    /// The same film with a row of a tally for each pixel, by which its errors
    /// are judged, or not. It must be empty.
    pub fn with_rows(mut self, judges: bool) -> Self {
        self.rows = vec![vec![]; self.pixels.len()];
        self.judges_rows = judges;
        self
    }

    /// The variance of one value of a pixel, or of the entry of its row that
    /// has the largest.
    pub(super) fn variance(&self, at: usize) -> f64 {
        let pixel = &self.pixels[at];
        if !self.judges_rows {
            return pixel.variance();
        }
        let (n, size) = (pixel.count(), self.net_size);
        let error = |entry: &Entry| entry.standard_error(n, size);
        let most = self.rows[at].iter().map(error).fold(0., f64::max);
        n as f64 * most * most
    }

    /// The same film, whose pixels share random numbers within a tile. It must
    /// be empty.
    pub fn with_shared_tiles(mut self) -> Self {
        self.tile_means = vec![Accumulator::default(); self.tiles.len()];
        self
    }

    /// The same film with halves: those of the fragments `shown`, or else
    /// those that it will read. It must be empty.
    pub fn with_halves(mut self, shown: Option<Arc<Fragments>>) -> Self {
        let halves = |tile: &Tile| {
            let count = shown.as_ref().map_or(0, |it| it.count(tile));
            vec![HalfBuffers::default(); count]
        };
        self.halves = self.tiles.iter().map(halves).collect();
        self.fragments = shown;
        self
    }

    /// Whether its halves are empty, and begin with the first sample of a run:
    /// then the samples of a pilot count in them.
    pub fn takes_pilot(&self) -> bool {
        let mut halves = self.halves.iter().flatten();
        self.fragments.is_some()
            && self.sample_offset == 0
            && halves.all(|it| *it == HalfBuffers::default())
    }

    /// The tiles of its run, each with its place here if it has one.
    pub fn run_tiles(&self) -> Vec<(Tile, Option<usize>)> {
        let (start, end) = (self.window.corner, self.window.end());
        let place = |tile: Tile| {
            let (x, y) = tile.corner;
            let is_here = (start.0..end.0).contains(&x)
                && (start.1..end.1).contains(&y);
            (tile, is_here.then(|| self.place(x, y)))
        };
        self.all_tiles().into_iter().map(place).collect()
    }

    /// Adds to its halves what a `pilot` has gathered in each tile of the run,
    /// unless the pilot lacks a tile of this film. Returns whether it has
    /// added them.
    pub fn add_pilot(&mut self, pilot: &[Vec<Gathered>]) -> bool {
        let tiles = self.run_tiles().into_iter().enumerate();
        let here = tiles.filter_map(|(k, (_, place))| Some((k, place?)));
        let here: Vec<_> = here.collect();
        let has = |&(k, place): &(usize, usize)| {
            pilot.get(k).map_or(0, Vec::len) == self.halves[place].len()
        };
        if !here.iter().all(has) {
            return false;
        }
        for (k, place) in here {
            for (halves, found) in
                self.halves[place].iter_mut().zip(&pilot[k])
            {
                for (half, [sum, count]) in halves.iter_mut().zip(found) {
                    (half[0], half[2]) = (half[0] + sum, half[2] + count);
                }
            }
        }
        true
    }

    /// Adds the samples of a film that holds some of its tiles.
    pub fn merge(&mut self, part: &Self) {
        if part.halves.is_empty() {
            self.halves.clear();
        }
        for (number, tile) in part.tiles.iter().enumerate() {
            let place = self.place(tile.corner.0, tile.corner.1);
            let Tile { start, size, .. } = self.tiles[place];
            assert_eq!(size, tile.size, "the tile at {:?}", tile.corner);
            let sums = &mut self.pixels[start..];
            let more = &part.pixels[tile.start..][..tile.area()];
            sums.iter_mut().zip(more).for_each(|(p, q)| p.merge(q));
            if !self.rows.is_empty() {
                let more = &part.rows[tile.start..][..tile.area()];
                let rows = self.rows[start..].iter_mut().zip(more);
                rows.for_each(|(row, more)| Entry::add_all(row, more));
            }
            if let Some(mean) = part.tile_means.get(number) {
                self.tile_means[place].merge(mean);
            }
            if let Some(halves) = self.halves.get_mut(place) {
                let more = &part.halves[number];
                let count = halves.len().max(more.len());
                halves.resize(count, HalfBuffers::default());
                add_halves(halves, more);
            }
        }
    }

    /// Writes the sums.
    pub fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        for sums in self.pixels.iter().chain(&self.tile_means) {
            out.write_all(&sums.to_bytes())?;
        }
        self.rows.iter().try_for_each(|row| Entry::write(row, out))?;
        for halves in &self.halves {
            out.write_all(&(halves.len() as u16).to_le_bytes())?;
            let mut sums = halves.as_flattened().as_flattened().iter();
            sums.try_for_each(|sum| out.write_all(&sum.to_le_bytes()))?;
        }
        Ok(())
    }

    /// Fills an empty film with sums that one of the same run has written.
    pub fn read(&mut self, from: &mut dyn Read) -> io::Result<()> {
        let mut bytes = [0; 64];
        for sums in self.pixels.iter_mut().chain(&mut self.tile_means) {
            from.read_exact(&mut bytes)?;
            *sums = Accumulator::from_bytes(&bytes);
        }
        for row in &mut self.rows {
            *row = Entry::read(from)?;
        }
        for halves in &mut self.halves {
            let mut bytes = [0; 2];
            from.read_exact(&mut bytes)?;
            let count = u16::from_le_bytes(bytes).into();
            halves.resize(count, HalfBuffers::default());
            for sum in halves.as_flattened_mut().as_flattened_mut() {
                let mut bytes = [0; 8];
                from.read_exact(&mut bytes)?;
                *sum = i64::from_le_bytes(bytes);
            }
        }
        Ok(())
    }
}
