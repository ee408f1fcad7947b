// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The walk in AVX-512 instructions.

use std::arch::x86_64::*;

use super::avx2;
use super::triangle::{NONE, Search};
use super::walk::{Entered, Slabs, Stack, walk};
use super::wide::{Node, Wide};
use super::{Hit, Kernel};
use crate::scene::Ray;

pub struct Walker(Wide<16>);

pub fn is_available() -> bool {
    avx2::is_available()
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512dq")
}

impl Walker {
    pub fn new(wide: Wide<16>) -> Option<Self> {
        is_available().then_some(Self(wide))
    }
    pub fn wide(&self) -> &Wide<16> {
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

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
fn first_hit(wide: &Wide<16>, ray: &Ray, from: Option<u32>) -> Option<Hit> {
    search::<false>(wide, ray, from).hit(ray)
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
fn is_blocked(wide: &Wide<16>, ray: &Ray, from: Option<u32>) -> bool {
    search::<true>(wide, ray, from).slot != NONE
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
#[inline]
fn search<'a, const ANY: bool>(
    wide: &'a Wide<16>,
    ray: &Ray,
    from: Option<u32>,
) -> Search<'a> {
    walk::<16, ANY, __m512>(
        wide,
        ray,
        from,
        |node, slabs, reach| enter(node, slabs, reach),
        |&near, mask| two(near, mask),
        |node, shift, entered, stack| push(node, shift, entered, stack),
        |leaf, shear, limit| avx2::meet(leaf, shear, limit),
    )
}

#[target_feature(enable = "avx512f")]
#[inline]
fn enter(node: &Node<16>, slabs: &Slabs, reach: f32) -> Entered<__m512> {
    let plane = |axis: usize, k: usize| {
        // SAFETY: k < 6, sixteen floats
        let planes = unsafe { node.planes.get_unchecked(k) };
        let planes = unsafe { _mm512_loadu_ps(planes.as_ptr()) };
        let inverse = _mm512_set1_ps(slabs.inverse[axis]);
        _mm512_fmsub_ps(planes, inverse, _mm512_set1_ps(slabs.start[axis]))
    };
    let enter = |axis| plane(axis, slabs.enter[axis]);
    let leave = |axis| plane(axis, slabs.leave[axis]);
    let near = _mm512_max_ps(
        _mm512_max_ps(enter(0), enter(1)),
        _mm512_max_ps(enter(2), _mm512_setzero_ps()),
    );
    let far = _mm512_min_ps(
        _mm512_min_ps(leave(0), leave(1)),
        _mm512_min_ps(leave(2), _mm512_set1_ps(reach)),
    );
    let mask = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far);
    Entered { mask: mask.into(), near, far }
}

#[target_feature(enable = "avx512f")]
#[inline]
fn two(near: __m512, mask: u32) -> (f32, f32) {
    let both = _mm512_maskz_compress_ps(mask as __mmask16, near);
    let low = _mm512_castps512_ps128(both);
    (_mm_cvtss_f32(low), _mm_cvtss_f32(_mm_movehdup_ps(low)))
}

#[target_feature(enable = "avx512f,lzcnt,popcnt")]
#[inline]
fn push(
    node: &Node<16>,
    shift: u32,
    entered: &Entered<__m512>,
    stack: &mut Stack,
) -> u32 {
    // SAFETY:
    unsafe {
        let order = _mm512_loadu_si512(node.order.as_ptr().cast());
        let order =
            _mm512_srl_epi32(order, _mm_cvtsi32_si128(shift as i32));
        let children = _mm512_loadu_si512(node.children.as_ptr().cast());
        let near = _mm512_permutexvar_ps(order, entered.near);
        let far = _mm512_permutexvar_ps(order, entered.far);
        let children = _mm512_permutexvar_epi32(order, children);
        let mask = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far);
        let near = _mm512_maskz_compress_ps(mask, near);
        let packed = _mm512_maskz_compress_epi32(mask, children);
        let n = stack.length;
        _mm512_storeu_ps(stack.distances.as_mut_ptr().add(n).cast(), near);
        _mm512_storeu_si512(
            stack.children.as_mut_ptr().add(n).cast(),
            packed,
        );
        let mask = u32::from(mask);
        stack.length = n + mask.count_ones() as usize - 1;
        let last = _mm512_set1_epi32(31 - mask.leading_zeros() as i32);
        let child = _mm512_permutexvar_epi32(last, children);
        _mm_cvtsi128_si32(_mm512_castsi512_si128(child)) as u32
    }
}
