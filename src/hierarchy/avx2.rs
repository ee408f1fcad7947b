// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The walk in AVX2 instructions.

use std::arch::x86_64::*;

use super::triangle::{LANES, Leaf, NONE, Search, Shear};
use super::walk::{Entered, Slabs, Stack, walk};
use super::wide::{Node, Wide};
use super::{Hit, Kernel};
use crate::scene::Ray;

pub struct Walker(Wide<8>);

pub fn is_available() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

impl Walker {
    pub fn new(wide: Wide<8>) -> Option<Self> {
        is_available().then_some(Self(wide))
    }
    pub fn wide(&self) -> &Wide<8> {
        &self.0
    }
}

impl Kernel for Walker {
    #[inline]
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        // SAFETY: `Walker::new` has asked the processor.
        unsafe { first_hit(&self.0, ray, from) }
    }

    fn is_blocked(&self, ray: &Ray, from: Option<u32>) -> bool {
        // SAFETY: as above.
        unsafe { is_blocked(&self.0, ray, from) }
    }
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn first_hit(wide: &Wide<8>, ray: &Ray, from: Option<u32>) -> Option<Hit> {
    search::<false>(wide, ray, from).hit(ray)
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn is_blocked(wide: &Wide<8>, ray: &Ray, from: Option<u32>) -> bool {
    search::<true>(wide, ray, from).slot != NONE
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
fn search<'a, const ANY: bool>(
    wide: &'a Wide<8>,
    ray: &Ray,
    from: Option<u32>,
) -> Search<'a> {
    walk::<8, ANY, __m256>(
        wide,
        ray,
        from,
        |node, slabs, reach| enter(node, slabs, reach),
        |&near, mask| two(near, mask),
        |node, shift, entered, stack| push(node, shift, entered, stack),
        |leaf, shear, limit| meet(leaf, shear, limit),
    )
}

#[target_feature(enable = "avx2,fma")]
#[inline]
fn enter(node: &Node<8>, slabs: &Slabs, reach: f32) -> Entered<__m256> {
    let mut near = _mm256_setzero_ps();
    let mut far = _mm256_set1_ps(reach);
    for axis in 0..3 {
        let inverse = _mm256_set1_ps(slabs.inverse[axis]);
        let start = _mm256_set1_ps(slabs.start[axis]);
        let plane = |k: usize| {
            // SAFETY: eight floats
            let planes =
                unsafe { _mm256_loadu_ps(node.planes[k].as_ptr()) };
            _mm256_fmsub_ps(planes, inverse, start)
        };
        near = _mm256_max_ps(plane(slabs.enter[axis]), near);
        far = _mm256_min_ps(plane(slabs.leave[axis]), far);
    }
    let met = _mm256_cmp_ps::<_CMP_LE_OQ>(near, far);
    Entered { mask: _mm256_movemask_ps(met) as u32, near, far }
}

#[target_feature(enable = "avx2,bmi1")]
#[inline]
fn two(near: __m256, mask: u32) -> (f32, f32) {
    let a = _mm256_set1_epi32(mask.trailing_zeros() as i32);
    let b = _mm256_set1_epi32(31 - mask.leading_zeros() as i32);
    let at = |i| _mm256_cvtss_f32(_mm256_permutevar8x32_ps(near, i));
    (at(a), at(b))
}

/// Permutations that move chosen lanes to the front
const PACK: [[u32; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut place) = (0, 0);
        while lane < 8 {
            if mask >> lane & 1 != 0 {
                table[mask][place] = lane;
                place += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

#[target_feature(enable = "avx2,bmi1,lzcnt")]
#[inline]
fn push(
    node: &Node<8>,
    shift: u32,
    entered: &Entered<__m256>,
    stack: &mut Stack,
) -> u32 {
    // SAFETY:
    unsafe {
        let order = _mm256_loadu_si256(node.order.as_ptr().cast());
        let order =
            _mm256_srl_epi32(order, _mm_cvtsi32_si128(shift as i32));
        let children = _mm256_loadu_si256(node.children.as_ptr().cast());
        let near = _mm256_permutevar8x32_ps(entered.near, order);
        let far = _mm256_permutevar8x32_ps(entered.far, order);
        let children = _mm256_permutevar8x32_epi32(children, order);
        let met = _mm256_cmp_ps::<_CMP_LE_OQ>(near, far);
        let mask = _mm256_movemask_ps(met) as u32;
        let pack = _mm256_loadu_si256(PACK[mask as usize].as_ptr().cast());
        let near = _mm256_permutevar8x32_ps(near, pack);
        let packed = _mm256_permutevar8x32_epi32(children, pack);
        let n = stack.length;
        _mm256_storeu_ps(stack.distances.as_mut_ptr().add(n).cast(), near);
        _mm256_storeu_si256(
            stack.children.as_mut_ptr().add(n).cast(),
            packed,
        );
        stack.length = n + mask.count_ones() as usize - 1;
        let last = _mm256_set1_epi32(31 - mask.leading_zeros() as i32);
        let child = _mm256_permutevar8x32_epi32(children, last);
        _mm256_cvtsi256_si32(child) as u32
    }
}

#[target_feature(enable = "avx2")]
#[inline]
pub fn meet(leaf: Leaf, shear: &Shear, limit: f64) -> (u32, [f64; LANES]) {
    let [i, j, k] = shear.axes;
    let [ox, oy, oz] = shear.origin.map(|x| _mm256_set1_pd(x));
    let [sx, sy] = shear.slope.map(|x| _mm256_set1_pd(x));
    let at = |c: usize, axis: usize| {
        let start = leaf.corners.as_ptr();
        // SAFETY: axes are below 3, and four floats follow the last run
        let lanes =
            unsafe { _mm_loadu_ps(start.add((3 * c + axis) * leaf.count)) };
        _mm256_cvtps_pd(lanes)
    };
    let height = |c| _mm256_sub_pd(at(c, k), oz);
    let sheared = |lanes, origin, slope, z| {
        let moved = _mm256_sub_pd(lanes, origin);
        _mm256_sub_pd(moved, _mm256_mul_pd(slope, z))
    };
    let (az, bz, cz) = (height(0), height(1), height(2));
    let (ax, ay) =
        (sheared(at(0, i), ox, sx, az), sheared(at(0, j), oy, sy, az));
    let (bx, by) =
        (sheared(at(1, i), ox, sx, bz), sheared(at(1, j), oy, sy, bz));
    let (cx, cy) =
        (sheared(at(2, i), ox, sx, cz), sheared(at(2, j), oy, sy, cz));
    let edge = |a, b, c, d| {
        _mm256_sub_pd(_mm256_mul_pd(a, b), _mm256_mul_pd(c, d))
    };
    let u = edge(cx, by, cy, bx);
    let v = edge(ax, cy, ay, cx);
    let w = edge(bx, ay, by, ax);
    let zero = _mm256_setzero_pd();
    let least = _mm256_min_pd(_mm256_min_pd(u, v), w);
    let most = _mm256_max_pd(_mm256_max_pd(u, v), w);
    let inside = _mm256_or_pd(
        _mm256_cmp_pd::<_CMP_GE_OQ>(least, zero),
        _mm256_cmp_pd::<_CMP_LE_OQ>(most, zero),
    );
    let lanes = (1 << leaf.count) - 1;
    if _mm256_movemask_pd(inside) & lanes == 0 {
        return (0, [0.; LANES]);
    }
    let touching = |e| _mm256_cmp_pd::<_CMP_EQ_OQ>(e, zero);
    let edges =
        _mm256_or_pd(_mm256_or_pd(touching(u), touching(v)), touching(w));
    if _mm256_movemask_pd(_mm256_and_pd(edges, inside)) & lanes != 0 {
        return carefully(leaf, shear);
    }
    let sum = _mm256_add_pd(_mm256_add_pd(u, v), w);
    let weighed = _mm256_add_pd(_mm256_mul_pd(u, az), _mm256_mul_pd(v, bz));
    let weighed = _mm256_add_pd(weighed, _mm256_mul_pd(w, cz));
    let height = _mm256_div_pd(weighed, sum);
    let distance = _mm256_mul_pd(height, _mm256_set1_pd(shear.stretch));
    let met = _mm256_and_pd(
        _mm256_and_pd(inside, _mm256_cmp_pd::<_CMP_GT_OQ>(distance, zero)),
        _mm256_cmp_pd::<_CMP_LE_OQ>(distance, _mm256_set1_pd(limit)),
    );
    let mut distances = [0.; LANES];
    // SAFETY
    unsafe { _mm256_storeu_pd(distances.as_mut_ptr(), distance) };
    ((_mm256_movemask_pd(met) & lanes) as u32, distances)
}

#[cold]
#[inline(never)]
pub fn carefully(leaf: Leaf, shear: &Shear) -> (u32, [f64; LANES]) {
    leaf.meet(shear)
}
