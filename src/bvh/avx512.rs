// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The traversal in AVX-512 instructions, with sixteen boxes at a time.
//!
//! Each function does what its portable namesake does.

use std::arch::x86_64::*;

use super::avx2;
use super::beam;
use super::intersector::{BEAM, Hit, Intersector};
use super::spawn::hit;
use super::traversal::{self, Entered, Slabs, Stack, traverse};
use super::triangle::{NONE, Search};
use super::wide::{Node, Wide};
use crate::scene::Ray;

/// A hierarchy on a processor that has the instructions.
pub struct Traverser(Wide<16>);

/// Whether this processor has the instructions of this module.
pub fn is_available() -> bool {
    avx2::is_available()
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512dq")
}

impl Traverser {
    /// None if the processor lacks the instructions.
    pub fn new(wide: Wide<16>) -> Option<Self> {
        is_available().then_some(Self(wide))
    }

    pub fn wide(&self) -> &Wide<16> {
        &self.0
    }
}

impl Intersector for Traverser {
    #[inline]
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        // SAFETY: a traverser exists only where `is_available` holds.
        unsafe { first_hit(&self.0, ray, from) }
    }

    #[inline]
    fn is_occluded(&self, ray: &Ray, from: Option<u32>) -> bool {
        // SAFETY: as above.
        unsafe { is_occluded(&self.0, ray, from) }
    }

    #[inline]
    fn is_visible(
        &self,
        ray: &Ray,
        from: Option<u32>,
        target: u32,
    ) -> bool {
        // SAFETY: as above.
        unsafe { is_visible(&self.0, ray, from, target) }
    }

    fn first_hits(
        &self,
        rays: &[Option<Ray>; BEAM],
    ) -> [Option<Hit>; BEAM] {
        // SAFETY: as above.
        unsafe { first_hits(&self.0, rays) }
    }
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
fn first_hit(wide: &Wide<16>, ray: &Ray, from: Option<u32>) -> Option<Hit> {
    match hasten::<false, false>(wide, ray, (from, NONE)) {
        Some(search) => hit(wide, ray, from, &search),
        None => first_hit_through_gates(wide, ray, from),
    }
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
#[inline(never)]
fn first_hit_through_gates(
    wide: &Wide<16>,
    ray: &Ray,
    from: Option<u32>,
) -> Option<Hit> {
    let slots = (from, NONE);
    let found = hasten::<false, true>(wide, ray, slots);
    let found = found.unwrap_or_else(|| search::<false>(wide, ray, slots));
    hit(wide, ray, from, &found)
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
fn is_occluded(wide: &Wide<16>, ray: &Ray, from: Option<u32>) -> bool {
    let slots = (from, NONE);
    let found = hasten::<true, false>(wide, ray, slots);
    let slot = found.map(|search| search.slot);
    slot.unwrap_or_else(|| first_slot(wide, ray, slots)) != NONE
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
fn is_visible(
    wide: &Wide<16>,
    ray: &Ray,
    from: Option<u32>,
    target: u32,
) -> bool {
    let slots = (from, target);
    let found = hasten::<true, false>(wide, ray, slots);
    let slot = found.map(|search| search.slot);
    slot.unwrap_or_else(|| first_slot(wide, ray, slots)) == target
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
#[cold]
#[inline(never)]
fn first_slot(
    wide: &Wide<16>,
    ray: &Ray,
    (from, target): (Option<u32>, u32),
) -> u32 {
    let found = hasten::<true, true>(wide, ray, (from, target));
    let found = found.unwrap_or_else(|| match target {
        NONE => search::<true>(wide, ray, (from, NONE)),
        _ => search::<false>(wide, ray, (from, NONE)),
    });
    found.slot
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
#[cold]
#[inline(never)]
fn search<'a, const ANY: bool>(
    wide: &'a Wide<16>,
    ray: &Ray,
    slots: (Option<u32>, u32),
) -> Search<'a> {
    // SAFETY: the slabs and the shear are those of a ray, and no hierarchy
    // is so deep that the stack has less room.
    unsafe {
        traverse::<16, ANY, __m512>(
            wide,
            ray,
            slots,
            |node, slabs, t_max| enter(node, slabs, t_max),
            |node, shift, entered, stack| push(node, shift, entered, stack),
            |leaf, shear, (limit, margins)| {
                let met = avx2::meet(leaf, shear, (limit, margins));
                met.unwrap_or_else(|| leaf.meet(shear, margins))
            },
        )
    }
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
#[inline]
fn hasten<'a, const ANY: bool, const GATED: bool>(
    wide: &'a Wide<16>,
    ray: &Ray,
    slots: (Option<u32>, u32),
) -> Option<Search<'a>> {
    // SAFETY: as above.
    unsafe {
        traversal::hasten::<16, ANY, GATED, __m512>(
            wide,
            ray,
            slots,
            |node, slabs, t_max| enter(node, slabs, t_max),
            |node, shift, entered, stack| push(node, shift, entered, stack),
            |leaf, shear, limit| avx2::meet(leaf, shear, limit),
        )
    }
}

#[target_feature(
    enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
)]
fn first_hits(
    wide: &Wide<16>,
    rays: &[Option<Ray>; BEAM],
) -> [Option<Hit>; BEAM] {
    // SAFETY: as above.
    unsafe {
        beam::first_hits(
            wide,
            rays,
            |leaf, shear, limit| avx2::meet(leaf, shear, limit),
            |ray| first_hit(wide, ray, None),
        )
    }
}

/// Which boxes of a node the ray enters before its t_max.
///
/// # Safety
/// The rows of `slabs` are below 6.
#[target_feature(enable = "avx512f")]
#[inline]
pub unsafe fn enter(
    node: &Node<16>,
    slabs: &Slabs,
    t_max: f32,
) -> Entered<__m512> {
    // Give the distances of sixteen planes
    let plane = |start: &[f32; 3], axis: usize, row: usize| {
        // SAFETY: the row is below 6, says the caller; it is 16 numbers.
        let row = unsafe { node.planes.get_unchecked(row) };
        let planes = unsafe { _mm512_loadu_ps(row.as_ptr()) };
        let inverse = _mm512_set1_ps(slabs.inverse[axis]);
        let start = _mm512_set1_ps(start[axis]);
        _mm512_fmsub_ps(planes, inverse, start)
    };
    let enter = |axis: usize| plane(&slabs.entry, axis, slabs.enter[axis]);
    let leave = |axis: usize| plane(&slabs.exit, axis, slabs.leave[axis]);
    // Take the last entry and first exit
    let near = _mm512_max_ps(
        _mm512_max_ps(enter(0), enter(1)),
        _mm512_max_ps(enter(2), _mm512_setzero_ps()),
    );
    let far = _mm512_min_ps(
        _mm512_min_ps(leave(0), leave(1)),
        _mm512_min_ps(leave(2), _mm512_set1_ps(t_max)),
    );
    let mask = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far);
    Entered { mask: mask.into(), near, far }
}

/// Pushes the children entered from far to near; returns the nearest.
///
/// # Safety
/// The stack has room for sixteen children, and one at least was entered.
#[target_feature(enable = "avx512f,lzcnt,popcnt")]
#[inline]
pub unsafe fn push(
    node: &Node<16>,
    shift: u32,
    entered: &Entered<__m512>,
    stack: &mut Stack,
) -> u32 {
    // Put sixteen lanes in the octant's order
    let order = load(&node.order);
    let order = _mm512_srl_epi32(order, _mm_cvtsi32_si128(shift as i32));
    let children = _mm512_permutexvar_epi32(order, load(&node.children));
    let near = _mm512_permutexvar_ps(order, entered.near);
    let far = _mm512_permutexvar_ps(order, entered.far);
    let met = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(near, far);
    let mask = u32::from(met);
    // Store all but the nearest of sixteen
    // SAFETY: there is room for sixteen, says the caller, and all but one of
    // those in the mask are left there.
    unsafe {
        let (top, distances) = stack.top::<16>();
        let packed = _mm512_maskz_compress_epi32(met, children);
        _mm512_storeu_si512(top.cast(), packed);
        let near = _mm512_maskz_compress_ps(met, near);
        _mm512_storeu_ps(distances, near);
        stack.grow(mask.count_ones() as usize - 1);
    }
    let last = _mm512_set1_epi32(31 - mask.leading_zeros() as i32);
    let child = _mm512_permutexvar_epi32(last, children);
    _mm512_cvtsi512_si32(child) as u32
}

#[target_feature(enable = "avx512f")]
#[inline]
fn load(numbers: &[u32; 16]) -> __m512i {
    // SAFETY: sixteen numbers are read, from any address.
    unsafe { _mm512_loadu_si512(numbers.as_ptr().cast()) }
}
