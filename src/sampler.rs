// Tangled from chapters/sampler.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Samplers, and the directions that their numbers stand for.
//!
//! ```
//! use litpt::sampler::{IndependentSampler, Sampler};
//!
//! // Sample 7 of pixel 3: each of its numbers is always the same.
//! let numbers = IndependentSampler::new(42);
//! let [mut a, mut b] = [(); 2].map(|()| numbers.start(3, 7));
//! assert_eq!(a.get_pixel_2d(), b.get_pixel_2d());
//! assert!((0. ..1.).contains(&a.get_1d(2)));
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

pub mod sobol;

use glam::DVec3;
use rand::RngExt;
use rand_pcg::Pcg64;

use crate::numerics::sincos_turns;

/// The numbers of one sample of a pixel, requested by their dimension.
/// They depend only on the seed, the pixel, the sample and the dimension.
pub trait Sampler: Clone + Send + Sync {
    /// The number of consecutive samples of a pixel, at least 1, that are
    /// placed together; samples placed apart are independent.
    fn net_size(&self) -> u64;

    /// The sampler of sample `index` of a pixel, given by its number.
    fn start(&self, pixel: u64, index: u64) -> Self;

    /// Two numbers uniform over the integers below 2^32, of dimensions 0
    /// and 1: where the path crosses the pixel.
    fn get_pixel_2d(&mut self) -> [u32; 2];

    /// A number uniform over [0, 1).
    fn get_1d(&mut self, dimension: u64) -> f64;

    /// Two numbers uniform over [0, 1), of this dimension and the next.
    fn get_2d(&mut self, dimension: u64) -> [f64; 2];
}

/// The dimensions of a path; the point in the pixel has 0 and 1.
pub mod dimension {
    /// The dimension of Russian roulette at a bounce, counted from 0.
    #[inline(always)]
    pub fn roulette(bounce: u64) -> u64 {
        2 + 3 * bounce
    }

    /// The first of the two dimensions of the direction after a bounce.
    #[inline(always)]
    pub fn direction(bounce: u64) -> u64 {
        3 + 3 * bounce
    }

    /// The first of the two dimensions of the point of the sun after it.
    #[inline(always)]
    pub fn sun(bounce: u64) -> u64 {
        (1 << 62) + 2 * bounce
    }
}

/// The generator of sample `n` of pixel `i`, for a seed.
pub fn generator(seed: u64, i: u64, n: u64) -> Pcg64 {
    let high = split_mix(seed ^ split_mix(i ^ split_mix(n)));
    let low = split_mix(high ^ n);
    let state = u128::from(high) << 64 | u128::from(low);
    Pcg64::new(state, u128::from(i) << 64 | u128::from(n))
}

/// The output function of SplitMix64 (Steele, Lea and Flood 2014).
pub fn split_mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Independent numbers from a generator for each path.
#[derive(Clone, Debug)]
pub struct IndependentSampler {
    seed: u64,
    random: Pcg64,
}

impl IndependentSampler {
    /// The sampler for a seed, before it is started.
    pub fn new(seed: u64) -> Self {
        Self { seed, random: generator(seed, 0, 0) }
    }
}

impl Sampler for IndependentSampler {
    #[inline(always)]
    fn net_size(&self) -> u64 {
        1
    }

    #[inline(always)]
    fn start(&self, pixel: u64, index: u64) -> Self {
        Self { random: generator(self.seed, pixel, index), ..*self }
    }

    #[inline(always)]
    fn get_pixel_2d(&mut self) -> [u32; 2] {
        [self.random.random(), self.random.random()]
    }

    #[inline(always)]
    fn get_1d(&mut self, _: u64) -> f64 {
        self.random.random()
    }

    #[inline(always)]
    fn get_2d(&mut self, _: u64) -> [f64; 2] {
        [self.random.random(), self.random.random()]
    }
}

/// The middle of the interval of length 2^-32 that an integer stands for:
/// in (0, 1), strictly between the ends.
#[inline(always)]
pub fn to_unit(x: u32) -> f64 {
    (f64::from(x) + 0.5) / (1u64 << 32) as f64
}

/// The coordinate in (i/n, (i+1)/n), strictly between the ends, that a
/// uniform random integer selects in column or row `i` of `n` <= 65536.
#[inline(always)]
pub fn within(i: u32, n: u32, random: u32) -> f64 {
    (f64::from(i) + to_unit(random)) / f64::from(n)
}

/// A direction around the unit vector `normal`, with density cos/π,
/// from two numbers uniform over [0, 1).
#[inline(always)]
pub fn cosine_direction(normal: DVec3, r: f64, turn: f64) -> DVec3 {
    let (cosine, sine) = sincos_turns(turn);
    let (tangent, bitangent) = normal.any_orthonormal_pair();
    let across = tangent * cosine + bitangent * sine;
    across * r.sqrt() + normal * (1. - r).sqrt()
}
