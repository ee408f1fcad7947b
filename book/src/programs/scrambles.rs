// Compares ways to scramble a net: the variance of means over the scrambles,
// beside that of a scrambling that has a random bit for each node, and the
// time of a point. "make measure" records it for the chapter "Quasi-Monte
// Carlo".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::hint::black_box;
use std::time::Instant;

use litpt::sampler::sobol::{ScrambledNet, scramble_key, to_unit};
use litpt::sampler::{IndependentSampler, Sampler, dimension};

use super::nets::{errors_of, four, integrands};
use super::{Done, median};

/// Points of a net: not all that a word of 64 bits serves.
const SIZES: [u32; 2] = [16, 256];
const SCRAMBLES: u64 = 40_000;

/// All four coordinates of point `i` of a scramble of a net.
type Way = fn(&ScrambledNet, u64, u32) -> [u32; 4];

pub fn run(_: &[String]) -> Done {
    let ways: [(&str, Way); 4] = [
        ("a bit for each node", nodes),
        ("words of 63 nodes", words),
        ("hash; Laine and Karras", burley),
        ("hash; Vegdahl", vegdahl),
    ];
    let all = integrands();
    print!("way,nanoseconds");
    for n in SIZES {
        all.iter().for_each(|f| print!(",{} {n}", f.name));
    }
    println!();
    let variances = ways.map(|(_, way)| variances(way));
    for ((name, way), found) in ways.into_iter().zip(&variances) {
        print!("{name},{:.1}", nanoseconds(way));
        let pairs = found.iter().zip(&variances[0]);
        pairs.for_each(|(one, node)| print!(",{:.3}", one / node));
        println!();
    }
    print!("independent numbers,{:.1}", independent());
    println!("{}", ",--".repeat(all.len() * SIZES.len()));
    Ok(())
}

/// The variance of the mean of each integrand over each size of net.
fn variances(way: Way) -> Vec<f64> {
    let all = integrands();
    let mut found = Vec::new();
    for n in SIZES {
        let net = ScrambledNet::new(u64::from(n));
        let mut squares = [0.; 4];
        for scramble in 0..SCRAMBLES {
            let key = scramble_key(2, 0, scramble);
            let errors =
                errors_of(&all, n, |i| way(&net, key, i).map(to_unit));
            let terms = squares.iter_mut().zip(errors);
            terms.for_each(|(sum, e)| *sum += e * e / SCRAMBLES as f64);
        }
        found.extend(squares);
    }
    found
}

/// As the sampler does it.
#[inline(always)]
fn words(net: &ScrambledNet, key: u64, i: u32) -> [u32; 4] {
    let ([x, y], [z, w]) = (net.pair(key, i, 0), net.pair(key, i, 1));
    [x, y, z, w]
}

#[inline(always)]
fn unscrambled(net: &ScrambledNet, i: u32) -> [u32; 4] {
    let ([x, y], [z, w]) = (net.unscrambled(i, 0), net.unscrambled(i, 1));
    [x, y, z, w]
}

/// Each digit is flipped by a hash of all digits before it.
fn nodes(net: &ScrambledNet, key: u64, i: u32) -> [u32; 4] {
    let mut dimension = 0;
    unscrambled(net, i).map(|x| {
        dimension += 1;
        let flip = |level: u32| {
            let node = 1 << level | u64::from(x) >> (32 - level);
            (scramble_key(key, dimension, node) >> 63) as u32
        };
        (0..32).fold(x, |y, level| y ^ flip(level) << (31 - level))
    })
}

/// Four seeds from a key.
#[inline(always)]
fn seeds(key: u64) -> [u32; 4] {
    let words = [1, 2].map(|k| scramble_key(key, k, 0));
    let [a, b] = words.map(|word| [word as u32, (word >> 32) as u32]);
    [a[0], a[1], b[0], b[1]]
}

/// Burley 2020, listing 3.
#[inline(always)]
fn burley(net: &ScrambledNet, key: u64, i: u32) -> [u32; 4] {
    let (x, seeds) = (unscrambled(net, i), seeds(key));
    [0, 1, 2, 3].map(|d| {
        let mut y = x[d].reverse_bits().wrapping_add(seeds[d]);
        for factor in [0x6c50_b47c, 0xb82f_1e52, 0xc7af_e638, 0x8d22_f6e6] {
            y ^= y.wrapping_mul(factor);
        }
        y.reverse_bits()
    })
}

/// Other constants for the same idea, found by Vegdahl.
#[inline(always)]
fn vegdahl(net: &ScrambledNet, key: u64, i: u32) -> [u32; 4] {
    let (x, seeds) = (unscrambled(net, i), seeds(key));
    [0, 1, 2, 3].map(|d| {
        let mut y = x[d].reverse_bits();
        y ^= y.wrapping_mul(0x3d20_adea);
        y = y.wrapping_add(seeds[d]).wrapping_mul(seeds[d] >> 16 | 1);
        y ^= y.wrapping_mul(0x0552_6c56);
        y ^= y.wrapping_mul(0x53a2_2864);
        y.reverse_bits()
    })
}

const CALLS: u64 = 1 << 20;

/// The median time of a call.
fn time(mut call: impl FnMut(u64) -> u64) -> f64 {
    let once = |_| {
        let start = Instant::now();
        let sum = (0..CALLS).fold(0, |sum, n| sum ^ call(black_box(n)));
        black_box(sum);
        start.elapsed().as_secs_f64() * 1e9 / CALLS as f64
    };
    median((0..9).map(once).collect())
}

/// The time of a point of a net of 64, with its key.
fn nanoseconds(way: Way) -> f64 {
    let net = ScrambledNet::new(black_box(64));
    let bits = |x: [f64; 4]| x.iter().fold(0, |sum, x| sum ^ x.to_bits());
    time(|n| {
        let key = scramble_key(3, n >> 8, n >> 6);
        let [x, y, z, w] = way(&net, key, (n & 63) as u32);
        bits(four([x, y], [z, w]))
    })
}

/// The time of four independent numbers of a path, with its generator.
fn independent() -> f64 {
    let sampler = IndependentSampler::new(black_box(3));
    time(|n| {
        let mut sampler = sampler.start(n >> 8, n & 255);
        let [x, y] = sampler.get_pixel_2d();
        let [r, turn] = sampler.get_2d(dimension::direction(0));
        u64::from(x ^ y) ^ r.to_bits() ^ turn.to_bits()
    })
}
