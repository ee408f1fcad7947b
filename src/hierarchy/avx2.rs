// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The innermost functions of the walk in AVX2 instructions.
//!
//! Each does the arithmetic of its namesake in the parent module, lane
//! by lane and in the same order, and returns the same bits.

use std::arch::x86_64::*;

use glam::Vec3A;
use obvhs::cwbvh::node::CwBvhNode;

use super::{Corners, Cwbvh, Hit, Reach, Shear, list};
use crate::scene::Ray;

// Ask the processor for AVX2
/// Whether this processor has the instructions of this module.
pub fn has_avx2() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

/// `Kernel::first_hit` on processors for which `has_avx2` holds.
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
pub fn first_hit(
    kernel: &Cwbvh,
    ray: &Ray,
    from: Option<u32>,
) -> Option<Hit> {
    let children =
        |node: &_, reach: &_, octant| children_met(node, reach, octant);
    let meet = |shear: &_, corners: &_| distance(shear, corners);
    kernel.walk(ray, from, children, meet)
}

// Clip eight boxes in one register
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
fn children_met(node: &CwBvhNode, reach: &Reach, octant: u32) -> u32 {
    let slope = node.compute_extent() * reach.inv_direction;
    let start = (Vec3A::from(node.p) - reach.origin) * reach.inv_direction;
    let axes = [
        (&node.child_min_x, &node.child_max_x, slope.x, start.x),
        (&node.child_min_y, &node.child_max_y, slope.y, start.y),
        (&node.child_min_z, &node.child_max_z, slope.z, start.z),
    ];
    let mut near = _mm256_setzero_ps();
    let mut far = _mm256_set1_ps(reach.tmax);
    for (low, high, slope, start) in axes {
        let (first, last) =
            if slope < 0. { (high, low) } else { (low, high) };
        near = _mm256_max_ps(plane(first, slope, start), near);
        far = _mm256_min_ps(plane(last, slope, start), far);
    }
    let met = _mm256_cmp_ps::<_CMP_LE_OQ>(near, far);
    list(node, octant, _mm256_movemask_ps(met) as u32)
}

/// Where a ray meets the planes of eight boxes.
#[target_feature(enable = "avx2")]
#[inline]
fn plane(bytes: &[u8; 8], slope: f32, start: f32) -> __m256 {
    let bytes = _mm_cvtsi64_si128(i64::from_le_bytes(*bytes));
    let q = _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes));
    let sloped = _mm256_mul_ps(q, _mm256_set1_ps(slope));
    _mm256_add_ps(sloped, _mm256_set1_ps(start))
}

// Shear three corners in one register
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
fn distance(shear: &Shear, corners: &Corners) -> f64 {
    let [x, y, z] = shear.axes.map(|axis| &corners.0[axis]);
    let z = _mm256_sub_pd(lanes(z), _mm256_set1_pd(shear.origin[2]));
    let sheared = |numbers, origin, slope| {
        let moved = _mm256_sub_pd(lanes(numbers), _mm256_set1_pd(origin));
        _mm256_sub_pd(moved, _mm256_mul_pd(_mm256_set1_pd(slope), z))
    };
    let x = sheared(x, shear.origin[0], shear.slope[0]);
    let y = sheared(y, shear.origin[1], shear.slope[1]);
    // Lanes (c, a, b) and (b, c, a) of both; the fourth lane is unused.
    let one = _mm256_mul_pd(
        _mm256_permute4x64_pd::<0b11_01_00_10>(x),
        _mm256_permute4x64_pd::<0b11_00_10_01>(y),
    );
    let other = _mm256_mul_pd(
        _mm256_permute4x64_pd::<0b11_01_00_10>(y),
        _mm256_permute4x64_pd::<0b11_00_10_01>(x),
    );
    let edges = _mm256_sub_pd(one, other);
    // Reject outside triangles by their signs
    let zero = _mm256_setzero_pd();
    let negative = _mm256_cmp_pd::<_CMP_LT_OQ>(edges, zero);
    let positive = _mm256_cmp_pd::<_CMP_GT_OQ>(edges, zero);
    let negative = _mm256_movemask_pd(negative) & 7;
    let positive = _mm256_movemask_pd(positive) & 7;
    if negative != 0 && positive != 0 {
        return f64::INFINITY;
    }
    shear.along(unpack(edges), unpack(z))
}

/// Four single-precision numbers as doubles.
#[target_feature(enable = "avx2")]
#[inline]
fn lanes(&[a, b, c, d]: &[f32; 4]) -> __m256d {
    _mm256_cvtps_pd(_mm_setr_ps(a, b, c, d))
}

/// The first three lanes.
#[target_feature(enable = "avx2")]
#[inline]
fn unpack(lanes: __m256d) -> [f64; 3] {
    let low = _mm256_castpd256_pd128(lanes);
    let high = _mm256_extractf128_pd::<1>(lanes);
    let second = _mm_cvtsd_f64(_mm_unpackhi_pd(low, low));
    [_mm_cvtsd_f64(low), second, _mm_cvtsd_f64(high)]
}
