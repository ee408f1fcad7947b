// Tangled from chapters/cache.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A cache of the radiance that leaves the surfaces, with guides: learnt
//! from recorded reflections.
//!
//! Its bits belong to `GATHER_VERSION`.

mod rows;

use std::array;
use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::guide::{BINS, Guide, SIDE, main_axis};
use crate::bvh::Hit;
use crate::film::Watch;
use crate::numerics::{exponent, power_of_two};

/// Levels of cells; the cubes of each have half the side of the next.
pub const LEVELS: usize = 5;

/// The bits of a coordinate in the name of a cell.
const BITS: u32 = 19;

/// The cubes that cells are made of.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// The least corner of all cubes.
    low: DVec3,
    /// The side of the smallest cubes, in units of the scene: a power of
    /// two.
    side: f64,
    /// How many of them there are in a unit of the scene.
    per_unit: f64,
}

impl Grid {
    /// The name of the finest cell of a point and its normal.
    #[inline]
    pub fn name(&self, p: DVec3, normal: DVec3) -> u64 {
        let axis = main_axis(normal);
        let class = 2 * axis + usize::from(normal[axis] > 0.);
        let cube = ((p - self.low) * self.per_unit).to_array();
        let most = (1u64 << BITS) - 1;
        let [x, y, z] = cube.map(|c| spread((c as u64).min(most)));
        (class as u64) << (3 * BITS) | x | y << 1 | z << 2
    }

    /// The name of one of the four cells around a point, at random: `u` is
    /// uniform over the square.
    #[inline]
    pub fn name_around(&self, p: DVec3, normal: DVec3, u: [f64; 2]) -> u64 {
        let axis = main_axis(normal);
        let mut q = p;
        for (k, u) in [(axis + 1) % 3, (axis + 2) % 3].into_iter().zip(u) {
            q[k] += (u - 0.5) * self.side;
        }
        self.name(q, normal)
    }

    /// Orders hits by the class of their normals and by their place, in
    /// cubes of a quarter of the finest cells' sides.
    pub fn order(&self, hit: &Hit) -> u64 {
        let (side, per_unit) = (0.25 * self.side, 4. * self.per_unit);
        let reach = side * (1u64 << (BITS - 1)) as f64;
        let low = self.low + 3. * reach;
        Self { low, side, per_unit }.name(hit.point, hit.normal)
    }

    /// The grid whose cubes have sides 2^n times as long.
    pub fn wider(self, n: u32) -> Self {
        let scale = power_of_two(n as i32);
        let reach = self.side * (1u64 << (BITS - 1)) as f64;
        let low = self.low + reach * (1. - scale);
        let (side, per_unit) = (self.side * scale, self.per_unit / scale);
        Self { low, side, per_unit }
    }

    /// The grid for points like these.
    pub fn around(points: &[DVec3]) -> Self {
        let ends = |k: usize| {
            let mut coordinates: Vec<f64> =
                points.iter().map(|p| p[k]).collect();
            coordinates.sort_unstable_by(f64::total_cmp);
            let at = |i: usize| coordinates.get(i).copied().unwrap_or(0.);
            let margin = coordinates.len() / 100;
            [at(margin), at(coordinates.len().saturating_sub(1 + margin))]
        };
        let ends = [0, 1, 2].map(ends);
        let [low, high] = [0, 1].map(|e| DVec3::from(ends.map(|k| k[e])));
        let longest = (high - low).max_element();
        let fine = power_of_two(exponent(longest / 64.));
        let side = if longest > 0. { fine } else { 1. };
        let reach = side * (1u64 << (BITS - 1)) as f64;
        let low = 0.5 * (low + high) - reach;
        Self { low, side, per_unit: 1. / side }
    }
}

/// The 19 bits of `x`, each followed by two zeros.
#[inline]
fn spread(x: u64) -> u64 {
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// The name of the cell so many levels above that holds a cell; the
/// levels have different names.
#[inline]
fn coarser(name: u64, levels: usize) -> u64 {
    let cube = name & ((1 << (3 * BITS)) - 1);
    (name - cube + ((levels as u64) << 60)) | (cube >> (3 * levels))
}

/// A reflected ray arrived below the horizon.
pub const DARKNESS: u64 = 1 << 63;
/// A reflected ray arrived in the sky, where its radiance is 1.
pub const SKY: u64 = DARKNESS | 0x3f80_0000;

/// A reflected ray arrived in the sky, or below it, where this is the
/// radiance.
pub fn in_sky(radiance: f64) -> u64 {
    DARKNESS | u64::from((radiance as f32).to_bits())
}

/// A reflected ray arrived in this patch of the sky; its radiance is 1.
pub fn in_patch(patch: u32) -> u64 {
    SKY | u64::from(patch) << 32
}

/// A reflection: from one cell to another, to the sky, or to what is below
/// the horizon.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Record {
    /// The cell of the surface that reflects.
    pub from: u64,
    /// The cell that the ray reached, or what [`in_sky`] gives.
    pub to: u64,
    /// The weight of the direction: one over its density on the square.
    pub weight: f32,
    /// The bin of the direction, or [`SUN`].
    pub bin: u16,
    /// The albedo where the ray arrived, as a part of the largest, in units
    /// of 1 / [`WHOLE`].
    pub relative_albedo: u16,
}

/// The bin of the light of the sun, to which no ray is guided.
pub const SUN: u16 = u16::MAX;

/// Units of a relative albedo of 1.
pub const WHOLE: u16 = 1 << 15;

impl Record {
    /// The relative albedo as a number.
    fn part(&self) -> f32 {
        f32::from(self.relative_albedo) / f32::from(WHOLE)
    }
}

/// The radiance of the surfaces in a cell, its error, and its guide.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Cell {
    /// Bits of the hash of its name; 0 in a free entry.
    mark: u32,
    /// The radiance that leaves them.
    pub value: f32,
    /// Its expected error.
    pub error: f32,
    /// The number of the guide, or [`NO_GUIDE`].
    guide: u32,
}

impl Cell {
    /// The cell for a surface whose albedo is this part of the largest.
    pub fn scaled(self, relative_albedo: f32) -> Self {
        let (value, error) =
            (relative_albedo * self.value, relative_albedo * self.error);
        Self { value, error, ..self }
    }

    /// The sum of this cell and another, with the guide of this one.
    pub fn plus(self, other: Self) -> Self {
        let value = self.value + other.value;
        Self { value, error: self.error + other.error, ..self }
    }
}

/// Stands for cosine sampling.
const NO_GUIDE: u32 = u32::MAX;

/// A place that training has not seen: wrong by the sky's radiance at most,
/// about.
pub const UNSEEN: Cell =
    Cell { mark: 0, value: 0., error: 1., guide: NO_GUIDE };

/// The cells and guides of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct RadianceCache {
    /// Names the cells.
    pub grid: Grid,
    /// The table; its length is a power of two.
    pub cells: Vec<Cell>,
    /// Where light came from, by the numbers in the cells; without them, all
    /// directions are sampled by the cosine.
    pub guides: Vec<Guide>,
    /// The mean error that a ray meets, over the mean radiance.
    pub relative_error: f32,
    /// The columns of the rows that belong to cells; 0 if none do.
    pub columns: usize,
    /// For each entry of the table the radiance that leaves the surfaces
    /// for a radiance of 1 of each column.
    pub rows: Vec<f32>,
}

impl RadianceCache {
    /// A cache that has learnt nothing.
    pub fn empty(grid: Grid) -> Self {
        let (cells, guides, rows) = (vec![UNSEEN], vec![], vec![]);
        Self { grid, cells, guides, relative_error: 1., columns: 0, rows }
    }

    /// The finest cell there is that holds the finest cell `name`.
    #[inline]
    pub fn at(&self, name: u64) -> &Cell {
        self.place(name).map_or(&UNSEEN, |entry| &self.cells[entry])
    }

    /// The entry of that cell in the table, if there is one.
    #[inline]
    pub fn place(&self, name: u64) -> Option<usize> {
        for level in 0..LEVELS {
            let (entry, _) = self.slot(coarser(name, level));
            if self.cells[entry].mark != 0 {
                return Some(entry);
            }
        }
        None
    }

    /// The entry of a name, or the free one where it belongs; and its mark.
    #[inline]
    fn slot(&self, name: u64) -> (usize, u32) {
        let most = self.cells.len() - 1;
        let hash = (name ^ name >> 32).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mark = (hash >> 32) as u32 | 1;
        let mut slot = (hash ^ hash >> 32) as usize & most;
        while self.cells[slot].mark != 0 && self.cells[slot].mark != mark {
            slot = (slot + 1) & most;
        }
        (slot, mark)
    }

    /// The guide of a cell; none stands for cosine sampling.
    #[inline]
    pub fn guide(&self, cell: &Cell) -> Option<&Guide> {
        self.guides.get(cell.guide as usize)
    }

    /// Whether the table and all its contents can be used.
    pub fn is_sound(&self) -> bool {
        let Self { cells, guides, .. } = self;
        let is_known =
            |guide| guide == NO_GUIDE || guide < guides.len() as u32;
        let is_fit = |cell: &Cell| {
            let size = cell.value.abs() + cell.error;
            size.is_finite() && cell.error > 0. && is_known(cell.guide)
        };
        cells.len().is_power_of_two()
            && cells.iter().any(|cell| cell.mark == 0)
            && cells.iter().all(is_fit)
            && guides.iter().all(Guide::is_sound)
            && self.rows.len() == self.columns * cells.len()
            && self.rows.iter().all(|value| value.is_finite())
    }

    /// A cache that learns from records, which it sorts, and begins with the
    /// values of this one; any number of threads gives the same. If `watch`
    /// stops it, the cache is of no use.
    pub fn learn(
        &self,
        records: &mut [Record],
        albedo: f32,
        watch: &Watch,
    ) -> Self {
        records.par_sort_unstable_by_key(|record| {
            let &Record { from, to, weight, bin, relative_albedo } = record;
            (from, to, bin, relative_albedo, weight.to_bits())
        });
        let cells = Cells::of(records);
        // Build a table that finds the numbers of cells
        let mut cache =
            Self { columns: self.columns, ..Self::empty(self.grid) };
        let size = (2 * cells.names.len() + 1).next_power_of_two();
        cache.cells = vec![UNSEEN; size];
        for (number, &name) in (0..).zip(&cells.names) {
            let (slot, mark) = cache.slot(name);
            cache.cells[slot] = Cell { mark, guide: number, ..UNSEEN };
        }
        let ends = records.par_iter().map(|r| cache.end(r)).collect();
        let start =
            cells.names.iter().map(|&name| self.at(name).value).collect();
        let has_rows = self.columns > 0;
        let equations =
            Equations { cells, records, ends, albedo, has_rows };
        let values = equations.solve(start, watch);
        let errors = equations.errors(&values);
        let (guides, numbers) = equations.guides(&values);
        // Fill the table with values, errors and guides
        for (c, &name) in equations.cells.names.iter().enumerate() {
            let (slot, mark) = cache.slot(name);
            let (value, error, guide) = (values[c], errors[c], numbers[c]);
            cache.cells[slot] = Cell { mark, value, error, guide };
        }
        cache.guides = guides;
        // Find the mean error that a ray meets
        let (mut wrong, mut total) = (0f32, 0f32);
        for (record, &end) in equations.records.iter().zip(&equations.ends)
        {
            let weight = record.weight * record.part();
            total += weight * arriving(&values, end);
            let error = errors.get(end as usize);
            wrong += weight * error.copied().unwrap_or(0.);
        }
        cache.relative_error = if total > 0. { wrong / total } else { 1. };
        cache
    }

    /// Where a record arrives: the number of a cell, or no cell. The table
    /// has to hold these numbers.
    fn end(&self, record: &Record) -> u32 {
        match record.to {
            DARKNESS.. => END_IN_SKY | record.to as u32,
            name => match self.at(name).guide {
                NO_GUIDE => END_IN_SKY,
                number => number,
            },
        }
    }
}

/// The cells of all levels, with the records of each.
#[derive(Default)]
struct Cells {
    /// The number of the first cell of each level, and of all.
    offsets: [usize; LEVELS + 1],
    names: Vec<u64>,
    /// The number of the cell of the next level that holds it.
    parents: Vec<u32>,
    records: Vec<Range<usize>>,
}

impl Cells {
    /// The cells of records that are sorted by `from`.
    fn of(records: &[Record]) -> Self {
        let mut cells = Self::default();
        for (i, record) in records.iter().enumerate() {
            cells.add(record.from, i..i + 1);
        }
        for level in 1..LEVELS {
            cells.offsets[level] = cells.names.len();
            for child in cells.level(level - 1) {
                let name = coarser(cells.names[child], 1);
                cells.add(name, cells.records[child].clone());
                cells.parents.push(cells.names.len() as u32 - 1);
            }
        }
        cells.offsets[LEVELS] = cells.names.len();
        cells
    }

    /// Appends a cell with these records, or adds them to the last one.
    fn add(&mut self, name: u64, records: Range<usize>) {
        match self.records.last_mut() {
            Some(last) if self.names.last() == Some(&name) => {
                last.end = records.end;
            }
            _ => {
                self.names.push(name);
                self.records.push(records);
            }
        }
    }

    /// The numbers of the cells of a level.
    fn level(&self, level: usize) -> Range<usize> {
        self.offsets[level]..self.offsets[level + 1]
    }

    /// The number of records of a cell.
    fn count(&self, cell: usize) -> f32 {
        self.records[cell].len() as f32
    }
}

/// Marks the ends of records that are no cells; the other bits are those of
/// the radiance there.
const END_IN_SKY: u32 = 1 << 31;

/// The radiance that arrives from the end of a record, if the albedo there is
/// the largest.
#[inline]
fn arriving(values: &[f32], end: u32) -> f32 {
    match end {
        END_IN_SKY.. => f32::from_bits(end ^ END_IN_SKY),
        cell => values[cell as usize],
    }
}

/// The equations for the radiance of the cells.
struct Equations<'a> {
    cells: Cells,
    records: &'a [Record],
    /// Where each record arrives.
    ends: Vec<u32>,
    albedo: f32,
    /// Whether the guides are for rows.
    has_rows: bool,
}

impl Equations<'_> {
    /// The radiance that record `i` reflects.
    fn term(&self, values: &[f32], i: usize) -> f32 {
        self.albedo * self.records[i].weight * self.arriving(values, i)
    }

    /// The radiance that arrives from the end of record `i`.
    fn arriving(&self, values: &[f32], i: usize) -> f32 {
        self.records[i].part() * arriving(values, self.ends[i])
    }

    /// The sum of a function of the records over each cell, of all levels.
    fn sums(&self, f: impl Fn(usize) -> f32 + Sync) -> Vec<f32> {
        let cells = &self.cells;
        let finest = cells.level(0).into_par_iter();
        let sum = |c: usize| cells.records[c].clone().map(&f).sum();
        let mut sums: Vec<f32> = finest.map(sum).collect();
        sums.resize(cells.names.len(), 0.);
        for (c, &parent) in cells.parents.iter().enumerate() {
            sums[parent as usize] += sums[c];
        }
        sums
    }

    /// The radiance of each cell, from approximate `values`; less exact if
    /// `watch` stops it.
    fn solve(&self, mut values: Vec<f32>, watch: &Watch) -> Vec<f32> {
        let cells = &self.cells;
        for _ in (0..MOST_REFLECTIONS).take_while(|_| watch(0)) {
            let sums = self.sums(|i| self.term(&values, i));
            let before = values.clone();
            for c in (0..values.len()).rev() {
                let count = cells.count(c);
                values[c] = match cells.parents.get(c) {
                    Some(&parent) => {
                        (sums[c] + PRIOR * values[parent as usize])
                            / (count + PRIOR)
                    }
                    None => sums[c] / count,
                };
            }
            if is_settled(&before, &values) {
                break;
            }
        }
        values
    }

    /// The expected error of the value of each cell: positive. A coarser one
    /// stands for places without a record, and may be wrong by its whole value.
    fn errors(&self, values: &[f32]) -> Vec<f32> {
        let cells = &self.cells;
        let first = self.sums(|i| self.term(values, i));
        let second = self.sums(|i| self.term(values, i).powi(2));
        let total = first[cells.level(LEVELS - 1)].iter().sum::<f32>();
        let mean = total / self.records.len() as f32;
        let least = if mean == 0. { 1. } else { 0.01 * mean.abs() };
        let least = least.max(f32::MIN_POSITIVE);
        let parent = |c: usize| cells.parents.get(c).map(|&p| p as usize);
        let error = |c: usize| {
            // Find the variance of the records around a cell
            let mut wide = c;
            while let Some(p) = parent(wide)
                && cells.count(wide) < 8.
            {
                wide = p;
            }
            let n = cells.count(wide);
            let square = first[wide] * first[wide] / n;
            let variance =
                ((second[wide] - square) / (n - 1.).max(1.)).max(0.);
            // Add up the differences to the coarser cells
            let (mut spread, mut part, mut wide) = (0., 0.5, c);
            while let Some(p) = parent(wide) {
                wide = p;
                let difference = values[wide] - values[c];
                spread += part * difference * difference;
                part *= 0.5;
            }
            let bias = values[c] / 10.;
            let noise = variance / (cells.count(c) + PRIOR);
            (noise + spread + bias * bias).sqrt().max(least)
        };
        let coarser = values[cells.offsets[1]..].iter();
        let coarser = coarser.map(|value| value.abs().max(least));
        cells.level(0).map(error).chain(coarser).collect()
    }

    /// The guides, and the number of the guide of each cell.
    fn guides(&self, values: &[f32]) -> (Vec<Guide>, Vec<u32>) {
        let cells = &self.cells;
        let mut histograms: Vec<[f32; BINS]> = vec![];
        let mut guides: Vec<Guide> = vec![];
        let mut numbers = vec![NO_GUIDE; cells.names.len()];
        for c in (0..cells.names.len()).rev() {
            let parent = cells.parents.get(c).map(|&p| numbers[p as usize]);
            numbers[c] = parent.unwrap_or(NO_GUIDE);
            let enough = if self.has_rows { 0.1 * ENOUGH } else { ENOUGH };
            if cells.count(c) < enough {
                continue;
            }
            // Average the squares in each bin
            let (mut sums, mut counts) = ([0f32; BINS], [0f32; BINS]);
            let guided = |i: &usize| self.records[*i].bin != SUN;
            for i in cells.records[c].clone().filter(guided) {
                let bin = usize::from(self.records[i].bin);
                let square = self.arriving(values, i).powi(2);
                let is_spread = self.has_rows && self.ends[i] < END_IN_SKY;
                sums[bin] +=
                    if is_spread { SPREAD * square } else { square };
                counts[bin] += 1.;
            }
            let mean =
                sums.iter().sum::<f32>() / counts.iter().sum::<f32>();
            let prior = histograms.get(numbers[c] as usize);
            let prior = |b: usize| prior.map_or(mean, |p| p[b]);
            let histogram =
                array::from_fn(|b| (sums[b] + prior(b)) / (counts[b] + 1.));
            if let Some(guide) = Guide::new(&smooth(&histogram)) {
                numbers[c] = guides.len() as u32;
                guides.push(guide);
                histograms.push(histogram);
            }
        }
        (guides, numbers)
    }
}

/// How many records the value of the coarser cell is worth.
const PRIOR: f32 = 12.;

/// Reflections that the solution follows at most.
const MOST_REFLECTIONS: usize = 300;

/// Whether the values have changed by less than a thousandth.
fn is_settled(before: &[f32], now: &[f32]) -> bool {
    let square = |x: f32| f64::from(x) * f64::from(x);
    let change: f64 =
        before.iter().zip(now).map(|(a, b)| square(b - a)).sum();
    let size: f64 = now.iter().map(|b| square(*b)).sum();
    change <= 1e-6 * size
}

/// Records that a cell with a guide of its own has at least.
const ENOUGH: f32 = 1000.;

/// The square of the error that a gather leaves when it meets a surface whose
/// light comes from many columns, over the square of that light.
const SPREAD: f32 = 0.05;

/// The square roots of the bins, each averaged with its neighbours first.
fn smooth(bins: &[f32; BINS]) -> [f32; BINS] {
    let near = |i: usize| i.saturating_sub(1)..(i + 2).min(SIDE);
    array::from_fn(|b| {
        let (row, column) = (b / SIDE, b % SIDE);
        let (mut sum, mut weights) = (0., 0.);
        for (i, j) in
            near(row).flat_map(|i| near(column).map(move |j| (i, j)))
        {
            let weight = match (i == row, j == column) {
                (true, true) => 6.,
                (false, false) => 0.5,
                _ => 1.,
            };
            sum += weight * bins[i * SIDE + j];
            weights += weight;
        }
        f32::sqrt(sum / weights)
    })
}
