// Tangled from chapters/sobol.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Randomised quasi-Monte Carlo: points that fill the cube evenly, and
//! scrambles of them that are independent.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use super::{Sampler, dimension, split_mix, to_unit};

/// The product in the field of four elements: 0, 1, w = 2 and w + 1 = 3,
/// where w * w = w + 1. The sum is the exclusive or.
const fn times(a: u32, b: u32) -> u32 {
    let product = (a * (b & 1)) ^ ((a << 1) * (b >> 1));
    product ^ ((product >> 2) * 7)
}

/// Column `c` of the generator matrix of a dimension, its first digit in
/// the highest bit.
const fn column(dimension: u32, c: u32) -> u32 {
    let (j, mut column) = (c / 2, 0);
    let (mut i, mut power) = (j, 1 << (c % 2));
    loop {
        if i & (j - i) == 0 {
            column |= digits(dimension, power) << (30 - 2 * i);
        }
        if i == 0 {
            return column;
        }
        (i, power) = (i - 1, times(power, dimension));
    }
}

/// The two binary digits that stand for an element: its coefficients of 1
/// and w, of which an odd dimension adds the second to the first.
const fn digits(dimension: u32, element: u32) -> u32 {
    let (one, w) = (element & 1, element >> 1);
    (one ^ (dimension & w)) << 1 | w
}

/// Digits of an index or of a coordinate that are treated together.
const CHUNK: u32 = 6;

/// Chunks of the longest index.
const CHUNKS: usize = 5;

/// Sums of columns, by the number of a chunk of an index and its value:
/// two pairs of coordinates.
static SUMS: [[[[u32; 2]; 2]; 1 << CHUNK]; CHUNKS] = sums();

const fn sums() -> [[[[u32; 2]; 2]; 1 << CHUNK]; CHUNKS] {
    let mut sums = [[[[0; 2]; 2]; 1 << CHUNK]; CHUNKS];
    let mut k = 0;
    while k < (4 * CHUNKS) << CHUNK {
        // Sum the columns of a dimension and a chunk
        let (d, i, chunk) = (k % 4, k / 4 % 64, k / 256);
        if i > 0 {
            let bit = CHUNK * chunk as u32 + i.trailing_zeros();
            let less = sums[chunk][i & (i - 1)][d / 2][d % 2];
            sums[chunk][i][d / 2][d % 2] = less ^ column(d as u32, bit);
        }
        k += 1;
    }
    sums
}

/// Which of three digits to flip: by the seven bits that a tree of three
/// levels has, and by the digits.
#[inline(always)]
fn flip_three(tree: u64, digits: u32) -> u32 {
    let bit = |node: u32| (tree >> node) as u32 & 1;
    bit(0) << 2 | bit(1 + (digits >> 2)) << 1 | bit(3 + (digits >> 1))
}

/// Which of six digits to flip: by the 63 bits that a tree of six levels
/// has.
#[inline(always)]
fn flip(tree: u64, digits: u32) -> u32 {
    let (high, low) = (digits >> 3, digits & 7);
    let lower = flip_three(tree >> (7 + 7 * high), low);
    flip_three(tree, high) << 3 | lower
}

/// The key of a scramble, from its number and that of a pixel.
pub fn scramble_key(seed: u64, pixel: u64, scramble: u64) -> u64 {
    split_mix(seed ^ split_mix(pixel ^ split_mix(scramble)))
}

/// A word of a scramble, by what it is for and a number.
#[inline(always)]
fn word(key: u64, purpose: u32, number: u32) -> u64 {
    split_mix(key ^ (u64::from(purpose) << 32 | u64::from(number)))
}

/// The purposes of words: trees of six levels, of each chunk and
/// dimension; the last digits of each pair; and the numbers of a path.
const TREES: u32 = 0;
const LAST_DIGITS: u32 = TREES + 4 * CHUNKS as u32;
const PATH: u32 = LAST_DIGITS + 2;

/// A set of points in four dimensions, two pairs, that can be scrambled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScrambledNet {
    /// Chunks of the index of a point.
    chunks: u32,
}

impl ScrambledNet {
    /// The first `points` of the sequence.
    ///
    /// # Panics
    ///
    /// Panics if that is not a power of two up to 2^30.
    pub fn new(points: u64) -> Self {
        assert!(points.is_power_of_two() && points <= 1 << 30, "{points}");
        Self { chunks: points.ilog2().div_ceil(CHUNK) }
    }

    /// The first or second pair (0 or 1) of coordinates of point `i`, as
    /// multiples of 2^-32, before any scrambling.
    #[inline(always)]
    pub fn unscrambled(&self, i: u32, pair: usize) -> [u32; 2] {
        let mut sum = [0; 2];
        for chunk in 0..self.chunks {
            let value = i >> (CHUNK * chunk) & ((1 << CHUNK) - 1);
            let [x, y] = SUMS[chunk as usize][value as usize][pair];
            sum = [sum[0] ^ x, sum[1] ^ y];
        }
        sum
    }

    /// That pair in the scramble of a key: two integers uniform below 2^32.
    #[inline(always)]
    pub fn pair(&self, key: u64, i: u32, pair: usize) -> [u32; 2] {
        match self.chunks {
            1 => Self { chunks: 1 }.any_pair(key, i, pair),
            _ => self.any_pair(key, i, pair),
        }
    }

    #[inline(always)]
    fn any_pair(&self, key: u64, i: u32, pair: usize) -> [u32; 2] {
        let [x, y] = self.unscrambled(i, pair);
        let last = word(key, LAST_DIGITS + pair as u32, i);
        let first = 2 * pair as u32;
        [
            self.scramble(key, first, x, last as u32),
            self.scramble(key, first + 1, y, (last >> 32) as u32),
        ]
    }

    /// A coordinate with the digits of all chunks scrambled, and with the
    /// digits after them.
    #[inline(always)]
    fn scramble(&self, key: u64, dimension: u32, x: u32, last: u32) -> u32 {
        let mut flips = 0;
        for chunk in 0..self.chunks {
            let before = (u64::from(x) >> (32 - CHUNK * chunk)) as u32;
            let tree = word(key, TREES + 4 * chunk + dimension, before);
            let digits = x << (CHUNK * chunk) >> (32 - CHUNK);
            flips |= flip(tree, digits) << (32 - CHUNK * (chunk + 1));
        }
        x ^ flips ^ last >> (CHUNK * self.chunks)
    }
}

/// Scrambled nets for the point in the pixel and the first direction,
/// independent numbers for all else.
#[derive(Clone, Debug)]
pub struct SobolSampler {
    seed: u64,
    /// The binary logarithm of the number of points in a scramble.
    log_points: u32,
    net: ScrambledNet,
    key: u64,
    /// The number of the point.
    i: u32,
    /// Where the numbers of this path begin.
    path: u64,
}

impl SobolSampler {
    /// The sampler for a seed, not started, that places so many samples
    /// of a pixel together.
    ///
    /// # Panics
    ///
    /// Panics if `net_size` is not a power of two up to 2^30.
    pub fn new(seed: u64, net_size: u64) -> Self {
        let net = ScrambledNet::new(net_size);
        let log_points = net_size.ilog2();
        Self { seed, log_points, net, key: 0, i: 0, path: 0 }
    }

    /// A word for a dimension, independent of all others.
    #[inline(always)]
    fn independent(&self, dimension: u64) -> u64 {
        let step = dimension.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        split_mix(self.path.wrapping_add(step))
    }
}

impl Sampler for SobolSampler {
    #[inline(always)]
    fn net_size(&self) -> u64 {
        1 << self.log_points
    }

    #[inline(always)]
    fn start(&self, pixel: u64, index: u64) -> Self {
        let key = scramble_key(self.seed, pixel, index >> self.log_points);
        let i = (index & (self.net_size() - 1)) as u32;
        Self { key, i, path: word(key, PATH, i), ..*self }
    }

    #[inline(always)]
    fn get_pixel_2d(&mut self) -> [u32; 2] {
        self.net.pair(self.key, self.i, 0)
    }

    #[inline(always)]
    fn get_1d(&mut self, dimension: u64) -> f64 {
        (self.independent(dimension) >> 11) as f64 / (1u64 << 53) as f64
    }

    #[inline(always)]
    fn get_2d(&mut self, dimension: u64) -> [f64; 2] {
        let [x, y] = if dimension == dimension::direction(0) {
            self.net.pair(self.key, self.i, 1)
        } else {
            let word = self.independent(dimension);
            [word as u32, (word >> 32) as u32]
        };
        [to_unit(x), to_unit(y)]
    }
}
