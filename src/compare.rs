// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Are two images estimates of the same radiances?
//!
//! Each pixel of an image is a mean with its standard error. Pixels
//! are taken to be independent of each other, unless an image states
//! errors of its tiles, and the two images to come from different random
//! numbers.

pub mod display;

use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;
use std::ops::Range;

use statrs::function::beta::beta_reg;

use crate::film::SIDE;
use crate::image::Image;

/// The difference of two estimates, or the sum of several.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gap {
    /// The sum of the differences.
    pub difference: f64,
    /// The variance of that sum.
    pub variance: f64,
    /// The squares of the variances over their degrees of freedom.
    fourth: f64,
    /// The number of differences in the sum.
    pub pixels: u64,
}

impl Gap {
    /// Adds the gap of other pixels.
    fn add(&mut self, other: &Gap) {
        self.difference += other.difference;
        self.variance += other.variance;
        self.fourth += other.fourth;
        self.pixels += other.pixels;
    }

    /// The difference in standard errors; infinite if it should be zero.
    pub fn z(&self) -> f64 {
        match self.difference {
            0. => 0.,
            difference => difference / self.variance.sqrt(),
        }
    }

    /// The degrees of freedom of [`Gap::z`] (Welch 1947, Satterthwaite
    /// 1946); infinite if the variances are known exactly.
    pub fn freedom(&self) -> f64 {
        match self.fourth {
            0. => f64::INFINITY,
            fourth => self.variance * self.variance / fourth,
        }
    }

    /// The difference in standard errors, if these are not less than is
    /// usual in the block `around`; `claims` says that both images state
    /// their errors, which makes a zero a claim.
    fn z_among(&self, around: &Gap, claims: bool) -> f64 {
        let usual = around.variance / around.pixels as f64;
        let usual = usual * self.pixels as f64;
        let variance = match self.variance {
            0. if claims => 0.,
            own => own.max(usual),
        };
        Gap { variance, ..*self }.z()
    }
}

/// The probability that chance alone makes |z| at least as large, with
/// so many degrees of freedom.
fn tail(z: f64, freedom: f64) -> f64 {
    if z.is_infinite() {
        return 0.;
    }
    if freedom.is_finite() {
        let x = freedom / (freedom + z * z);
        return beta_reg(freedom / 2., 0.5, x);
    }
    libm::erfc(z.abs() / SQRT_2)
}

/// A mean, its squared standard error, and the degrees of freedom of
/// the latter.
type Estimate = (f64, f64, f64);

/// What an image knows of pixel `i`.
fn estimate(image: &Image, i: usize) -> Estimate {
    let error = image.errors.as_ref().map_or(0., |errors| errors[i]);
    let count = image.values(i);
    let freedom = count.map_or(f64::INFINITY, |n| f64::max(n - 1., 1.));
    (image.means[i], error * error, freedom)
}

/// How far two estimates of a pixel differ; none if an error is unknown.
fn gap(estimates: [Estimate; 2]) -> Option<Gap> {
    // Find the difference beyond rounding
    let [(a, ..), (b, ..)] = estimates;
    let rounding = f64::from(f32::EPSILON) * a.abs().max(b.abs());
    let difference = if (a - b).abs() <= rounding { 0. } else { a - b };
    let mut gap = Gap { difference, pixels: 1, ..Gap::default() };
    for (_, variance, freedom) in estimates {
        gap.variance += variance;
        gap.fourth += variance * variance / freedom;
    }
    let known = gap.variance.is_finite() && difference.is_finite();
    known.then_some(gap)
}

/// What an image knows of pixel `i` as a part of its tile of so many pixels.
fn part(image: &Image, i: usize, pixels: u32) -> Estimate {
    let (mean, variance, freedom) = estimate(image, i);
    match &image.tile_errors {
        Some(errors) => {
            let variance = errors[i] * errors[i];
            (mean, variance, freedom / f64::from(pixels))
        }
        None => (mean, variance, freedom),
    }
}

/// The blocks of one size that an image is cut into.
#[derive(Clone, Copy)]
struct Blocks {
    /// Width and height of the image.
    size: (u32, u32),
    /// Width and height of a block.
    side: u32,
    /// Columns and rows that the first block lacks.
    lack: (u32, u32),
}

impl Blocks {
    fn new(a: &Image, b: &Image, side: u32) -> Self {
        let (x, y) = match a.tile_errors.is_some() {
            true => a.corner(),
            false => b.corner(),
        };
        let (size, lack) = ((a.width, a.height), (x % side, y % side));
        Self { size, side, lack }
    }

    /// The number of blocks in a row.
    fn columns(&self) -> usize {
        (self.size.0 + self.lack.0).div_ceil(self.side) as usize
    }

    /// The number of the block that holds pixel `i`, row by row.
    fn of(&self, i: usize) -> usize {
        let width = self.size.0 as usize;
        let along = |at: usize, lack: u32| {
            (at + lack as usize) / self.side as usize
        };
        let (x, y) =
            (along(i % width, self.lack.0), along(i / width, self.lack.1));
        y * self.columns() + x
    }

    /// The columns and the rows of a block of this number.
    fn range(&self, block: usize) -> [Range<u32>; 2] {
        let along = |k: usize, lack: u32, end: u32| {
            let first = k as u64 * u64::from(self.side);
            let at = |x: u64| {
                x.saturating_sub(lack.into()).min(end.into()) as u32
            };
            at(first)..at(first + u64::from(self.side))
        };
        let (x, y) = (block % self.columns(), block / self.columns());
        [
            along(x, self.lack.0, self.size.0),
            along(y, self.lack.1, self.size.1),
        ]
    }

    /// The number of pixels in the block that holds pixel `i`.
    fn area(&self, i: usize) -> u32 {
        let [columns, rows] = self.range(self.of(i));
        columns.len() as u32 * rows.len() as u32
    }
}

/// Probability that two images of the same radiances are called
/// inconsistent.
pub const FALSE_ALARMS: f64 = 0.01;

/// Sides of the blocks that are tested, in pixels; the last is the
/// whole image.
const SIDES: [u32; 3] = [1, SIDE, u32::MAX];

/// Number of tests: of each size of blocks, and of the errors.
const TESTS: usize = SIDES.len() + 1;

/// The probability to allow each of `tests`, so that one of them
/// fails by chance with the probability `all` (Sidak 1967).
fn sidak(all: f64, tests: usize) -> f64 {
    -libm::expm1(libm::log1p(-all) / tests as f64)
}

/// What the tests of blocks of one size found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Width and height of a block, unless the image ends before.
    pub side: u32,
    /// Number of blocks that were tested.
    pub tested: usize,
    /// Number of blocks whose difference is no chance.
    pub failed: usize,
    /// The z of largest magnitude, by an error that is not less than is
    /// usual around, and the first pixel of its block.
    pub largest: (f64, u32, u32),
}

/// Independent values that a pixel needs to be tested by itself. With
/// two equally probable ones, both images agree within themselves but
/// not with each other in one pixel of 2^31.
pub const FEW: f64 = 16.;

/// Whether the pixel `i` of an image has enough samples.
fn enough(image: &Image, i: usize) -> bool {
    image.values(i).is_none_or(|values| values >= FEW)
}

/// The sums of the gaps over blocks, row by row.
fn sums(gaps: &[Option<Gap>], blocks: &Blocks) -> Vec<Gap> {
    let mut sums: Vec<Gap> = Vec::new();
    for (i, gap) in gaps.iter().enumerate() {
        let block = blocks.of(i);
        sums.resize(sums.len().max(block + 1), Gap::default());
        if let Some(gap) = gap {
            sums[block].add(gap);
        }
    }
    sums
}

/// Tests the blocks of one size against those `around` them; `claims`
/// says that both images state their errors.
fn test(
    gaps: &[Option<Gap>],
    (blocks, around): (Blocks, Blocks),
    claims: bool,
) -> Scale {
    let own = sums(gaps, &blocks);
    let others = sums(gaps, &around);
    let tested = own.iter().filter(|block| block.pixels > 0).count();
    let level = sidak(sidak(FALSE_ALARMS, TESTS), tested.max(1));
    let side = blocks.side;
    let mut scale = Scale { side, tested, failed: 0, largest: (0., 0, 0) };
    // Judge each block by the larger of two errors
    for (i, block) in own.iter().enumerate().filter(|(_, b)| b.pixels > 0) {
        let [x, y] = blocks.range(i).map(|pixels| pixels.start);
        let first = y as usize * blocks.size.0 as usize + x as usize;
        let z = block.z_among(&others[around.of(first)], claims);
        let failed = tail(z, block.freedom()) < level;
        scale.failed += usize::from(failed);
        if z.abs() > scale.largest.0.abs() {
            scale.largest = (z, x, y);
        }
    }
    scale
}

/// How large the differences are, compared with the stated errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dispersion {
    /// Root of the ratio of squared differences to variances, where
    /// each block of noisy pixels has the same weight; one if the
    /// errors are right.
    pub ratio: f64,
    /// The excess of the squares in its own standard errors.
    pub z: f64,
    /// Number of noisy pixels in the sums.
    pub pixels: usize,
    /// Whether the excess is no chance.
    pub failed: bool,
}

/// Tests whether the squared differences exceed the variances; those of
/// different `clusters` are independent.
fn dispersion(
    gaps: &[Option<Gap>],
    blocks: &Blocks,
    clusters: &Blocks,
) -> Dispersion {
    let sums = sums(gaps, blocks);
    let mut excesses: Vec<f64> = Vec::new();
    let (mut squared, mut pixels) = (0., 0);
    // Sum over the pixels of noisy blocks
    for (i, gap) in gaps.iter().enumerate() {
        let block = &sums[blocks.of(i)];
        let unit = block.variance / block.pixels as f64;
        let Some(gap) = gap.filter(|_| unit > 0.) else { continue };
        let square = gap.difference * gap.difference / unit;
        let cluster = clusters.of(i);
        excesses.resize(excesses.len().max(cluster + 1), 0.);
        excesses[cluster] += square - gap.variance / unit;
        squared += square;
        pixels += 1;
    }
    let excess: f64 = excesses.iter().sum();
    let squares: f64 = excesses.iter().map(|x| x * x).sum();
    let z = excess / squares.sqrt().max(f64::MIN_POSITIVE);
    let level = sidak(FALSE_ALARMS, TESTS);
    let failed = z > 0. && tail(z, f64::INFINITY) < 2. * level;
    let ratio = f64::sqrt(squared / f64::max(squared - excess, 0.));
    Dispersion { ratio, z, pixels, failed }
}

/// What is known about an image: names and values.
type Attributes = BTreeMap<String, String>;

/// Attributes that decide which radiances an image estimates.
const SUBJECT: [&str; 8] = [
    "scene_sha256",
    "resolution",
    "crop",
    "position",
    "target",
    "up",
    "fov",
    "albedo",
];

/// The attributes of the subject whose values differ, in words.
fn differing(a: &Attributes, b: &Attributes) -> Vec<String> {
    let differ = |name: &&str| a.get(*name) != b.get(*name);
    let show = |name: &str, of: &Attributes| match of.get(name) {
        Some(hash) if name == SUBJECT[0] => hash.chars().take(12).collect(),
        value => value.cloned().unwrap_or_else(|| "none".to_owned()),
    };
    let tell = |name: &str| {
        format!("{name} {} against {}", show(name, a), show(name, b))
    };
    SUBJECT.into_iter().filter(differ).map(tell).collect()
}

/// What differs of the scenes and views of two images, as in `fov 70.0
/// against 60.0`, from their attributes; nothing if one of them does
/// not say.
pub fn disagreements(a: &Attributes, b: &Attributes) -> Vec<String> {
    let silent = |of: &Attributes| {
        SUBJECT.iter().all(|name| !of.contains_key(*name))
    };
    match silent(a) || silent(b) {
        true => Vec::new(),
        false => differing(a, b),
    }
}

/// What distinguishes one image from another.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Whether neither image says its errors, and all pixels have the
    /// same values.
    pub identical: bool,
    /// Root of the mean square difference.
    pub rmse: f64,
    /// Mean square relative difference (Rousselle et al. 2011).
    pub relative_mse: f64,
    /// The sum of the differences of all pixels with a known error.
    pub sum: Gap,
    /// Number of pixels whose error is unknown.
    pub unknown: usize,
    /// Number of pixels of known error with fewer than [`FEW`]
    /// independent values.
    pub few: usize,
    /// The tests of pixels, of blocks, and of the image.
    pub scales: [Scale; 3],
    /// The test of the errors.
    pub dispersion: Dispersion,
    /// The z of each pixel; zero where the error is unknown.
    pub z: Vec<f64>,
}

impl Difference {
    /// Whether nothing but chance distinguishes the images.
    pub fn consistent(&self) -> bool {
        self.scales.iter().all(|scale| scale.failed == 0)
            && !self.dispersion.failed
    }
}

/// Compares two images of independent random numbers.
///
/// # Errors
/// They differ in size, or no pixel has a known error; but images that
/// do not say their errors may be identical.
pub fn compare(a: &Image, b: &Image) -> Result<Difference, String> {
    same_size(a, b)?;
    let [pixel, block, film] = SIDES.map(|side| Blocks::new(a, b, side));
    // Collect the gaps of all pixels
    let own = |i| gap([estimate(a, i), estimate(b, i)]);
    let of_tile = |i| {
        let pixels = block.area(i);
        gap([part(a, i, pixels), part(b, i, pixels)])
    };
    let gaps: Vec<_> = (0..a.means.len()).map(own).collect();
    let parts: Vec<_> = (0..a.means.len()).map(of_tile).collect();
    let mut sum = Gap::default();
    parts.iter().flatten().for_each(|gap| sum.add(gap));
    // Tell whether there is anything to test
    let silent = a.errors.is_none() && b.errors.is_none();
    let same = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
    let identical = silent && a.means.iter().zip(&b.means).all(same);
    if silent && !identical {
        return Err("neither image says its errors".to_owned());
    }
    if sum.pixels == 0 && !identical {
        return Err("the errors of all pixels are unknown".to_owned());
    }
    // Test each scale against the next
    let claims = a.errors.is_some() && b.errors.is_some();
    let enough = |i| enough(a, i) && enough(b, i);
    let single: Vec<_> =
        (0..gaps.len()).map(|i| gaps[i].filter(|_| enough(i))).collect();
    let scales = [
        test(&single, (pixel, block), claims),
        test(&parts, (block, film), claims),
        test(&parts, (film, film), claims),
    ];
    // Test the errors by independent clusters
    let independent = a.tile_errors.is_none() && b.tile_errors.is_none();
    let clusters = if independent { pixel } else { block };
    let dispersion = dispersion(&gaps, &block, &clusters);
    let known = gaps.iter().flatten().count();
    let (rmse, relative_mse) = distances(a, b);
    Ok(Difference {
        identical,
        rmse,
        relative_mse,
        sum,
        unknown: gaps.len() - known,
        few: known - scales[0].tested,
        scales,
        dispersion,
        z: gaps.iter().map(|g| g.map_or(0., |g| g.z())).collect(),
    })
}

/// Keeps the relative error of dark pixels finite.
const EPSILON: f64 = 1e-2;

/// Root mean square difference, and mean square relative difference.
fn distances(a: &Image, b: &Image) -> (f64, f64) {
    let (mut squares, mut relative) = (0., 0.);
    let mut n = 0.;
    let pairs = a.means.iter().zip(&b.means);
    for (a, b) in pairs.filter(|(a, b)| (*a - *b).is_finite()) {
        let square = (a - b) * (a - b);
        squares += square;
        relative += square / (b * b + EPSILON);
        n += 1.;
    }
    (f64::sqrt(squares / n), relative / n)
}

/// # Errors
/// The images differ in size.
fn same_size(a: &Image, b: &Image) -> Result<(), String> {
    match (a.width, a.height) == (b.width, b.height) {
        true => Ok(()),
        false => Err(format!(
            "one has {}x{} pixels, the other {}x{}",
            a.width, a.height, b.width, b.height
        )),
    }
}
