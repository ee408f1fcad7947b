// Licensed under the GPL, version 3 or later
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
//! are taken to be independent of each other, and the two images to
//! come from different random numbers.

pub mod display;
pub mod merge;

// Name what the comparison imports
use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;

use statrs::function::beta::beta_reg;

use crate::image::Image;

// Measure how far two estimates differ
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

    // Judge a difference by its variance
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
fn estimate(image: &Image, i: usize) -> (f64, f64, f64) {
    let error = image.errors.as_ref().map_or(0., |errors| errors[i]);
    let count = image.samples.as_ref().map(|samples| samples[i]);
    let freedom = count.map_or(f64::INFINITY, |count| count - 1.);
    (image.means[i], error * error, freedom)
}

/// How far pixel `i` of two images differs; none if an error is
/// unknown.
fn gap(a: &Image, b: &Image, i: usize) -> Option<Gap> {
    let estimates = [estimate(a, i), estimate(b, i)];
    // Find the difference beyond rounding
    let [(a, ..), (b, ..)] = estimates;
    let rounding = f64::from(f32::EPSILON) * a.abs().max(b.abs());
    let difference = if (a - b).abs() <= rounding { 0. } else { a - b };
    let mut gap = Gap { difference, pixels: 1, ..Gap::default() };
    for (_, variance, freedom) in estimates {
        gap.variance += variance;
        gap.fourth += variance * variance / freedom.max(1.);
    }
    let known = gap.variance.is_finite() && difference.is_finite();
    known.then_some(gap)
}

// Share the false alarms among tests
/// Probability that two images of the same radiances are called
/// inconsistent.
pub const FALSE_ALARMS: f64 = 0.01;

/// Sides of the blocks that are tested, in pixels; the last is the
/// whole image.
const SIDES: [u32; 3] = [1, 16, u32::MAX];

/// Number of tests: of each size of blocks, and of the errors.
const TESTS: usize = SIDES.len() + 1;

/// The probability to allow each of `tests`, so that one of them
/// fails by chance with the probability `all` (Sidak 1967).
fn sidak(all: f64, tests: usize) -> f64 {
    -libm::expm1(libm::log1p(-all) / tests as f64)
}

// Test the blocks of one size
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

/// Samples that a pixel needs to be tested by itself. With two
/// equally probable samples, both images agree within themselves but
/// not with each other in one pixel of 2^31.
pub const FEW: f64 = 16.;

/// Whether the pixel `i` of an image has enough samples.
fn enough(image: &Image, i: usize) -> bool {
    image.samples.as_ref().is_none_or(|samples| samples[i] >= FEW)
}

/// The number of the block that holds pixel `i`, row by row.
fn block_of(i: u32, width: u32, side: u32) -> usize {
    let (x, y) = (i % width / side, i / width / side);
    y as usize * width.div_ceil(side) as usize + x as usize
}

/// The sums of the gaps over blocks of one size, row by row.
fn blocks(gaps: &[Option<Gap>], width: u32, side: u32) -> Vec<Gap> {
    let mut blocks: Vec<Gap> = Vec::new();
    for (i, gap) in (0..).zip(gaps) {
        let block = block_of(i, width, side);
        blocks.resize(blocks.len().max(block + 1), Gap::default());
        if let Some(gap) = gap {
            blocks[block].add(gap);
        }
    }
    blocks
}

/// Tests the blocks of one size against those `around` them; `claims`
/// says that both images state their errors.
fn test(
    gaps: &[Option<Gap>],
    width: u32,
    (side, around): (u32, u32),
    claims: bool,
) -> Scale {
    let own = blocks(gaps, width, side);
    let others = blocks(gaps, width, around);
    let tested = own.iter().filter(|block| block.pixels > 0).count();
    let level = sidak(sidak(FALSE_ALARMS, TESTS), tested.max(1));
    let mut scale = Scale { side, tested, failed: 0, largest: (0., 0, 0) };
    // Judge each block by the larger of two errors
    let columns = width.div_ceil(side);
    for (i, block) in (0..).zip(&own).filter(|(_, own)| own.pixels > 0) {
        let (x, y) = (i % columns * side, i / columns * side);
        let other = y / around * width.div_ceil(around) + x / around;
        let z = block.z_among(&others[other as usize], claims);
        let failed = tail(z, block.freedom()) < level;
        scale.failed += usize::from(failed);
        if z.abs() > scale.largest.0.abs() {
            scale.largest = (z, x, y);
        }
    }
    scale
}

// Test the errors themselves
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

/// Tests whether the squared differences exceed the variances.
fn dispersion(gaps: &[Option<Gap>], width: u32) -> Dispersion {
    let [_, side, _] = SIDES;
    let blocks = blocks(gaps, width, side);
    let (mut squared, mut excess, mut square_excess) = (0., 0., 0.);
    let mut pixels = 0;
    // Sum over the pixels of noisy blocks
    for (i, gap) in (0..).zip(gaps) {
        let block = &blocks[block_of(i, width, side)];
        let unit = block.variance / block.pixels as f64;
        let Some(gap) = gap.filter(|_| unit > 0.) else { continue };
        let square = gap.difference * gap.difference / unit;
        let x = square - gap.variance / unit;
        squared += square;
        excess += x;
        square_excess += x * x;
        pixels += 1;
    }
    let z = excess / f64::sqrt(square_excess).max(f64::MIN_POSITIVE);
    let level = sidak(FALSE_ALARMS, TESTS);
    let failed = z > 0. && tail(z, f64::INFINITY) < 2. * level;
    let ratio = f64::sqrt(squared / f64::max(squared - excess, 0.));
    Dispersion { ratio, z, pixels, failed }
}

// Tell whether two images show the same
/// What is known about an image: names and values.
type Attributes = BTreeMap<String, String>;

/// Attributes that decide which radiances an image estimates.
pub const SUBJECT: [&str; 8] = [
    "scene_sha256",
    "resolution",
    "crop",
    "position",
    "target",
    "up",
    "fov",
    "albedo",
];

/// The attributes of these names whose values differ, in words.
fn differing<'a>(
    names: impl Iterator<Item = &'a &'static str>,
    a: &Attributes,
    b: &Attributes,
) -> Vec<String> {
    let differ = |name: &&&str| a.get(**name) != b.get(**name);
    let show = |name: &str, of: &Attributes| match of.get(name) {
        Some(hash) if name == SUBJECT[0] => hash.chars().take(12).collect(),
        value => value.cloned().unwrap_or_else(|| "none".to_owned()),
    };
    let tell = |name| {
        format!("{name} {} against {}", show(name, a), show(name, b))
    };
    names.filter(differ).map(|&name| tell(name)).collect()
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
        false => differing(SUBJECT.iter(), a, b),
    }
}

// State what distinguishes two images
/// What distinguishes one image from another.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Root of the mean square difference.
    pub rmse: f64,
    /// Mean square relative difference (Rousselle et al. 2011).
    pub relative_mse: f64,
    /// The sum of the differences of all pixels with a known error.
    pub sum: Gap,
    // Keep what the tests have found
    /// Number of pixels whose error is unknown.
    pub unknown: usize,
    /// Number of pixels of known error with fewer than [`FEW`]
    /// samples.
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

// Compare two images as a whole
/// Compares two images of independent random numbers.
///
/// # Errors
/// They differ in size, or no pixel has a known error.
pub fn compare(a: &Image, b: &Image) -> Result<Difference, String> {
    same_size(a, b)?;
    // Collect the gaps of all pixels
    let gaps: Vec<_> = (0..a.means.len()).map(|i| gap(a, b, i)).collect();
    let mut sum = Gap::default();
    gaps.iter().flatten().for_each(|gap| sum.add(gap));
    if a.errors.is_none() && b.errors.is_none() {
        return Err("neither image says its errors".to_owned());
    }
    if sum.pixels == 0 {
        return Err("the errors of all pixels are unknown".to_owned());
    }
    // Test each scale against the next
    let claims = a.errors.is_some() && b.errors.is_some();
    let test = |gaps: &[_], sides| test(gaps, a.width, sides, claims);
    let enough = |i| enough(a, i) && enough(b, i);
    let single: Vec<_> =
        (0..gaps.len()).map(|i| gaps[i].filter(|_| enough(i))).collect();
    let [pixel, block, film] = SIDES;
    let scales = [
        test(&single, (pixel, block)),
        test(&gaps, (block, film)),
        test(&gaps, (film, film)),
    ];
    let known = sum.pixels as usize;
    let (rmse, relative_mse) = distances(a, b);
    Ok(Difference {
        rmse,
        relative_mse,
        sum,
        unknown: gaps.len() - known,
        few: known - scales[0].tested,
        scales,
        dispersion: dispersion(&gaps, a.width),
        z: gaps.iter().map(|g| g.map_or(0., |g| g.z())).collect(),
    })
}

// Measure distances of two images
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
