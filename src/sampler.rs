// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Random numbers, and the directions that they stand for.

// Name what the sampling imports
use glam::DVec3;
use rand::{Rng, RngExt};
use rand_pcg::Pcg64;

use crate::numerics::sincos_turns;

// Give each path its own generator
/// The generator of sample `n` of pixel `i`, for a seed.
pub fn generator(seed: u64, i: u64, n: u64) -> Pcg64 {
    let high = split_mix(seed ^ split_mix(i ^ split_mix(n)));
    let low = split_mix(high ^ n);
    let state = u128::from(high) << 64 | u128::from(low);
    Pcg64::new(state, u128::from(i) << 64 | u128::from(n))
}

/// The output function of SplitMix64 (Steele, Lea and Flood 2014).
fn split_mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

// Decide something by chance
/// Whether an event of this probability happens.
#[inline(always)]
pub fn happens(probability: f64, random: &mut impl Rng) -> bool {
    random.random::<f64>() < probability
}

// Choose a point of a pixel
/// The coordinate in (i/n, (i+1)/n), strictly between the ends, that a
/// uniform random number chooses in column or row `i` of `n` <= 65536.
#[inline(always)]
pub fn within(i: u32, n: u32, random: u32) -> f64 {
    const STRIPE: f64 = 1. / (1u64 << 32) as f64;
    let offset = (f64::from(random) + 0.5) * STRIPE;
    (f64::from(i) + offset) / f64::from(n)
}

// Choose a direction around a normal
/// A direction around the unit vector `normal`, with density cos/π,
/// from two numbers uniform over [0, 1).
#[inline(always)]
pub fn cosine_direction(normal: DVec3, r: f64, turn: f64) -> DVec3 {
    let (cosine, sine) = sincos_turns(turn);
    let (tangent, bitangent) = frame(normal);
    let across = tangent * cosine + bitangent * sine;
    across * r.sqrt() + normal * (1. - r).sqrt()
}

// Build a frame around a normal
/// Two unit vectors that form an orthonormal frame with the unit
/// vector `n` (Duff et al. 2017, listing 3).
#[inline(always)]
pub fn frame(n: DVec3) -> (DVec3, DVec3) {
    let s = 1f64.copysign(n.z);
    let a = -1. / (s + n.z);
    let b = n.x * n.y * a;
    let tangent = DVec3::new(1. + s * n.x * n.x * a, s * b, -s * n.x);
    let bitangent = DVec3::new(b, s + n.y * n.y * a, -n.y);
    (tangent, bitangent)
}
