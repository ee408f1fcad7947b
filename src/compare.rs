// Tangled from chapters/compare.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Are two images estimates of the same radiances?
//!
//! Each pixel of an image is a mean with its standard error. Pixels
//! are taken to be independent of each other, unless an image states
//! errors of its tiles. The two images are taken to come from different
//! random numbers.
//!
//! ```
//! use litpt::{compare::compare, image::Image};
//!
//! let image = |mean: f64| Image {
//!     errors: Some(vec![0.01; 16]),
//!     ..Image::plain(4, 4, vec![mean; 16])
//! };
//! assert!(compare(&image(0.5), &image(0.5))?.consistent());
//! assert!(!compare(&image(0.5), &image(0.6))?.consistent());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod display;

use std::collections::BTreeMap;
use std::f64::consts::SQRT_2;
use std::fmt;

use statrs::function::beta::beta_reg;

use crate::error::Result;
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

    /// The difference in standard errors, by an error no smaller than the
    /// usual one in the block `around`. With `claims` both images state
    /// their errors, and an error of zero is believed.
    fn z_among(&self, around: &Gap, claims: bool) -> f64 {
        let usual = around.variance / around.pixels as f64;
        let usual = usual * self.pixels as f64;
        let variance = match self.variance {
            0. if claims => 0.,
            variance => variance.max(usual),
        };
        Gap { variance, ..*self }.z()
    }
}

/// The probability that chance alone makes |z| at least as large, with
/// so many degrees of freedom.
fn tail(z: f64, freedom: f64) -> f64 {
    if freedom.is_finite() {
        let x = freedom / (freedom + z * z);
        return beta_reg(freedom / 2., 0.5, x);
    }
    libm::erfc(z.abs() / SQRT_2)
}

/// How far the estimates of pixel `i` differ, by itself or as a part of a
/// `tile` of so many pixels; none if an error is unknown.
fn gap(images: [&Image; 2], i: usize, tile: Option<u32>) -> Option<Gap> {
    let [a, b] = images.map(|image| image.means[i]);
    let rounding = f64::from(f32::EPSILON) * a.abs().max(b.abs());
    let difference = if (a - b).abs() <= rounding { 0. } else { a - b };
    let mut gap = Gap { difference, pixels: 1, ..Gap::default() };
    for image in images {
        // Add the variance of one estimate
        let freedom =
            image.values(i).map_or(f64::INFINITY, |n| f64::max(n - 1., 1.));
        let (errors, pixels) = match (&image.tile_errors, tile) {
            (Some(errors), Some(pixels)) => (Some(errors), pixels.into()),
            _ => (image.errors.as_ref(), 1.),
        };
        let variance = errors.map_or(0., |errors| errors[i] * errors[i]);
        gap.variance += variance;
        gap.fourth += variance * variance / (freedom / pixels);
    }
    let is_known = gap.variance.is_finite() && difference.is_finite();
    is_known.then_some(gap)
}

/// The blocks of one size that an image is cut into, row by row.
struct Blocks {
    /// Width of the image.
    width: usize,
    /// The number of the block of each pixel.
    of: Vec<u32>,
    /// The first pixel of each block, and how many it has.
    blocks: Vec<(usize, u32)>,
}

impl Blocks {
    /// Cuts an image whose first pixel has this place in a larger one.
    fn new(image: &Image, (left, top): (u32, u32), side: u32) -> Self {
        let pixels = image.means.len();
        let (width, size) = (image.width as usize, side as usize);
        let [left, top] = [left, top].map(|n| (n % side) as usize);
        let columns = (width + left).div_ceil(size);
        // Number the blocks
        let (mut of, mut blocks) = (Vec::with_capacity(pixels), vec![]);
        for i in 0..pixels {
            let (x, y) = (i % width + left, i / width + top);
            let block = y / size * columns + x / size;
            if block == blocks.len() {
                blocks.push((i, 0));
            }
            blocks[block].1 += 1;
            of.push(block as u32);
        }
        Self { width, of, blocks }
    }

    /// The sums of the gaps over the blocks.
    fn sums(&self, gaps: &[Option<Gap>]) -> Vec<Gap> {
        let mut sums = vec![Gap::default(); self.blocks.len()];
        for (gap, &block) in gaps.iter().zip(&self.of) {
            gap.iter().for_each(|gap| sums[block as usize].add(gap));
        }
        sums
    }
}

/// Probability of calling two images of the same radiances inconsistent.
pub const FALSE_ALARMS: f64 = 0.01;

/// Sides of the blocks that are tested, in pixels; the last is the
/// whole image.
const SIDES: [u32; 3] = [1, SIDE, u32::MAX];

/// Number of tests: of each size of blocks, and of the errors.
const TESTS: usize = SIDES.len() + 1;

/// The probability to allow each of `tests`, so that one of them
/// fails by chance with the probability `total` (Sidak 1967).
fn sidak(total: f64, tests: usize) -> f64 {
    -libm::expm1(libm::log1p(-total) / tests as f64)
}

/// The results of the tests of blocks of one size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// Number of blocks that were tested.
    pub tested: usize,
    /// Number of blocks whose difference is beyond chance.
    pub failed: usize,
    /// The z of largest magnitude, by an error no smaller than the usual
    /// one around it, and the first pixel of its block.
    pub largest: (f64, u32, u32),
}

/// Independent values that a pixel needs to be tested by itself. With
/// two equally probable ones, both images agree within themselves but
/// not with each other in one pixel of 2^31.
pub const FEW: f64 = 16.;

/// Tests the blocks of one size against those `around` them; with
/// `claims` both images state their errors.
fn test(
    gaps: &[Option<Gap>],
    [blocks, around]: [&Blocks; 2],
    claims: bool,
) -> Scale {
    let (sums, around_sums) = (blocks.sums(gaps), around.sums(gaps));
    let tested = sums.iter().filter(|block| block.pixels > 0).count();
    let level = sidak(sidak(FALSE_ALARMS, TESTS), tested.max(1));
    let mut scale = Scale { tested, failed: 0, largest: (0., 0, 0) };
    for (block, &(first, _)) in sums.iter().zip(&blocks.blocks) {
        if block.pixels > 0 {
            // Judge a block by the larger of two errors
            let others = &around_sums[around.of[first] as usize];
            let z = block.z_among(others, claims);
            let failed = tail(z, block.freedom()) < level;
            scale.failed += usize::from(failed);
            if z.abs() > scale.largest.0.abs() {
                let (x, y) = (first % blocks.width, first / blocks.width);
                scale.largest = (z, x as u32, y as u32);
            }
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
    /// Whether the excess is beyond chance.
    pub failed: bool,
}

/// Tests whether the squared differences exceed the variances;
/// different `clusters` are independent.
fn dispersion(
    gaps: &[Option<Gap>],
    blocks: &Blocks,
    clusters: &Blocks,
) -> Dispersion {
    let sums = blocks.sums(gaps);
    let mut excesses = vec![0.; clusters.blocks.len()];
    let (mut squared, mut pixels) = (0., 0);
    for (i, gap) in gaps.iter().enumerate() {
        // Count the square of a noisy pixel
        let block = &sums[blocks.of[i] as usize];
        let unit = block.variance / block.pixels as f64;
        let Some(gap) = gap.filter(|_| unit > 0.) else { continue };
        let square = gap.difference * gap.difference / unit;
        excesses[clusters.of[i] as usize] += square - gap.variance / unit;
        squared += square;
        pixels += 1;
    }
    // Judge the sum of the excesses
    let excess: f64 = excesses.iter().sum();
    let squares: f64 = excesses.iter().map(|x| x * x).sum();
    let z = excess / squares.sqrt().max(f64::MIN_POSITIVE);
    let level = sidak(FALSE_ALARMS, TESTS);
    let failed = z > 0. && tail(z, f64::INFINITY) < 2. * level;
    let ratio = f64::sqrt(squared / f64::max(squared - excess, 0.));
    Dispersion { ratio, z, pixels, failed }
}

/// Attributes that decide which radiances an image estimates: the hash of
/// the scene, and the entries of a `Subject`.
const SUBJECT: &str = "scene_sha256 resolution crop position target up fov \
    albedo materials named_albedos panes transmitting sky ground";

/// Lists how the scenes and views of two images differ, as in `fov 70.0
/// against 60.0`, from their attributes; nothing if one has none.
pub fn disagreements(
    a: &BTreeMap<String, String>,
    b: &BTreeMap<String, String>,
) -> Vec<String> {
    let names = || SUBJECT.split(' ');
    if [a, b].iter().any(|of| !names().any(|name| of.contains_key(name))) {
        return vec![];
    }
    let differ = |name: &&str| a.get(*name) != b.get(*name);
    // Describe how an attribute differs
    let tell = |name: &str| {
        let [a, b] = [a, b].map(|of| match of.get(name) {
            Some(hash) if name == "scene_sha256" => {
                hash.get(..12).unwrap_or(hash)
            }
            value => value.map_or("none", String::as_str),
        });
        format!("{name} {a} against {b}")
    };
    names().filter(differ).map(tell).collect()
}

/// The difference of two images.
#[derive(Clone, Debug, PartialEq)]
pub struct Difference {
    /// Whether neither image has error estimates, and all pixels have the
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
    /// The names of the tests that failed.
    pub fn failed(&self) -> Vec<&'static str> {
        let scales = NAMES.into_iter().zip(&self.scales);
        let scales = scales.filter(|(_, scale)| scale.failed > 0);
        let errors = self.dispersion.failed.then_some("errors");
        scales.map(|(name, _)| name).chain(errors).collect()
    }

    /// Whether nothing but chance distinguishes the images.
    pub fn consistent(&self) -> bool {
        self.failed().is_empty()
    }
}

/// Compares two images of independent random numbers.
///
/// # Errors
/// They differ in size, or no pixel has a known error and they are not
/// two identical images without errors.
pub fn compare(a: &Image, b: &Image) -> Result<Difference> {
    // Refuse two sizes
    if (a.width, a.height) != (b.width, b.height) {
        return Err(format!(
            "one has {}x{} pixels, the other {}x{}",
            a.width, a.height, b.width, b.height
        )
        .into());
    }
    // Collect the gaps of all pixels
    let corner = if a.tile_errors.is_some() { a } else { b }.corner();
    let [pixel, block, film] =
        SIDES.map(|side| Blocks::new(a, corner, side));
    let area = |i: usize| block.blocks[block.of[i] as usize].1;
    let pixels = 0..a.means.len();
    let part = |i| gap([a, b], i, Some(area(i)));
    let parts: Vec<_> = pixels.clone().map(part).collect();
    let gaps: Vec<_> = pixels.map(|i| gap([a, b], i, None)).collect();
    let sum = film.sums(&parts)[0];
    // Require something to test
    let silent = a.errors.is_none() && b.errors.is_none();
    let same = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
    let identical = silent && a.means.iter().zip(&b.means).all(same);
    if silent && !identical {
        return Err("neither image has error estimates".into());
    }
    if sum.pixels == 0 && !identical {
        return Err("the errors of all pixels are unknown".into());
    }
    // Test each scale against the next
    let claims = a.errors.is_some() && b.errors.is_some();
    let enough =
        |i, image: &&Image| image.values(i).is_none_or(|n| n >= FEW);
    let single = |(i, gap): (usize, &Option<Gap>)| {
        gap.filter(|_| [a, b].iter().all(|image| enough(i, image)))
    };
    let single: Vec<_> = gaps.iter().enumerate().map(single).collect();
    let scales = [
        test(&single, [&pixel, &block], claims),
        test(&parts, [&block, &film], claims),
        test(&parts, [&film, &film], claims),
    ];
    let independent = a.tile_errors.is_none() && b.tile_errors.is_none();
    let clusters = if independent { &pixel } else { &block };
    let with_error = gaps.iter().flatten().count();
    let (rmse, relative_mse) = distances(a, b);
    Ok(Difference {
        // Assemble the difference
        identical,
        rmse,
        relative_mse,
        sum,
        unknown: gaps.len() - with_error,
        few: with_error - scales[0].tested,
        scales,
        dispersion: dispersion(&gaps, &block, clusters),
        z: gaps.iter().map(|g| g.map_or(0., |g| g.z())).collect(),
    })
}

/// Root mean square difference, and mean square relative difference.
fn distances(a: &Image, b: &Image) -> (f64, f64) {
    let (mut squares, mut relative, mut n) = (0., 0., 0.);
    let pairs = a.means.iter().zip(&b.means);
    // Add the squares of a difference
    for (a, b) in pairs.filter(|(a, b)| (*a - *b).is_finite()) {
        let square = (a - b) * (a - b);
        squares += square;
        relative += square / (b * b + 1e-2);
        n += 1.;
    }
    (f64::sqrt(squares / n), relative / n)
}

impl fmt::Display for Difference {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        if self.identical {
            return write!(
                out,
                "identical: all pixels have the same values"
            );
        }
        let &Self { rmse, relative_mse, sum, unknown, few, .. } = self;
        let (n, z) = (sum.pixels as f64, sum.z());
        let (mean, error) = (sum.difference / n, sum.variance.sqrt() / n);
        writeln!(
            out,
            "root mean square difference: {rmse:.6}\n\
             relative mean square difference: {relative_mse:.6}\n\
             mean difference: {mean:.6} ± {error:.6} (z = {z:.2})"
        )?;
        for (name, scale) in NAMES.into_iter().zip(&self.scales) {
            writeln!(out, "{name}: {scale}")?;
        }
        // Write whether the errors are plausible
        let Dispersion { ratio, z, failed, pixels } = self.dispersion;
        if pixels > 0 {
            let verdict = if failed { "beyond" } else { "no more than" };
            writeln!(
                out,
                "errors: differences {ratio:.3} times as large (z = {z:.2}), \
                 {verdict} chance"
            )?;
        }
        // Write which pixels were left out
        if unknown > 0 {
            writeln!(out, "not tested: {unknown} pixels of unknown error")?;
        }
        if few > 0 {
            writeln!(
                out,
                "not tested one by one: {few} pixels of fewer than {FEW} \
                 independent samples"
            )?;
        }
        // Write the verdict
        match &self.failed().join(", ")[..] {
            "" => write!(
                out,
                "consistent: chance alone may explain the difference"
            ),
            failed => write!(
                out,
                "inconsistent: chance alone does not explain the difference \
                 (failed: {failed})"
            ),
        }
    }
}

impl fmt::Display for Scale {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let &Self { tested, failed, largest: (z, x, y) } = self;
        let z = z.abs();
        match (tested, failed) {
            (0, _) => write!(out, "not tested"),
            (1, 0) => write!(out, "|z| {z:.2}, not beyond chance"),
            (1, _) => write!(out, "|z| {z:.2}, beyond chance"),
            _ => write!(
                out,
                "{tested} tested, largest |z| {z:.2} at {x},{y}, \
                 {failed} beyond chance"
            ),
        }
    }
}

/// The names of the tests of [`SIDES`].
const NAMES: [&str; 3] = ["pixels", "blocks of 16x16", "image"];
const _: () = assert!(SIDE == 16);
