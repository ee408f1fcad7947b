// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The traversal in AVX2 instructions, with eight boxes at a time.
//!
//! Each function does what its portable namesake does.

use std::arch::x86_64::*;

use super::beam;
use super::intersector::{BEAM, Hit, Intersector};
use super::spawn::hit;
use super::traversal::{self, Entered, Met, Slabs, Stack, traverse};
use super::triangle::{LANES, Leaf, Margins, NONE, Search, Shear};
use super::wide::{Node, Wide};
use crate::scene::Ray;

/// A hierarchy on a processor that has the instructions.
pub struct Traverser(Wide<8>);

/// Whether this processor has the instructions of this module.
pub fn is_available() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

impl Traverser {
    /// None if the processor lacks the instructions.
    pub fn new(wide: Wide<8>) -> Option<Self> {
        is_available().then_some(Self(wide))
    }

    pub fn wide(&self) -> &Wide<8> {
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

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn first_hit(wide: &Wide<8>, ray: &Ray, from: Option<u32>) -> Option<Hit> {
    match hasten::<false, false>(wide, ray, (from, NONE)) {
        Some(search) => hit(wide, ray, from, &search),
        None => first_hit_through_gates(wide, ray, from),
    }
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
fn first_hit_through_gates(
    wide: &Wide<8>,
    ray: &Ray,
    from: Option<u32>,
) -> Option<Hit> {
    let slots = (from, NONE);
    let found = hasten::<false, true>(wide, ray, slots);
    let found = found.unwrap_or_else(|| search::<false>(wide, ray, slots));
    hit(wide, ray, from, &found)
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn is_occluded(wide: &Wide<8>, ray: &Ray, from: Option<u32>) -> bool {
    let slots = (from, NONE);
    let found = hasten::<true, false>(wide, ray, slots);
    let slot = found.map(|search| search.slot);
    slot.unwrap_or_else(|| first_slot(wide, ray, slots)) != NONE
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn is_visible(
    wide: &Wide<8>,
    ray: &Ray,
    from: Option<u32>,
    target: u32,
) -> bool {
    let slots = (from, target);
    let found = hasten::<true, false>(wide, ray, slots);
    let slot = found.map(|search| search.slot);
    slot.unwrap_or_else(|| first_slot(wide, ray, slots)) == target
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[cold]
#[inline(never)]
fn first_slot(
    wide: &Wide<8>,
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

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[cold]
#[inline(never)]
fn search<'a, const ANY: bool>(
    wide: &'a Wide<8>,
    ray: &Ray,
    slots: (Option<u32>, u32),
) -> Search<'a> {
    // SAFETY: the slabs and the shear are those of a ray, and no hierarchy
    // is so deep that the stack has less room.
    unsafe {
        traverse::<8, ANY, __m256>(
            wide,
            ray,
            slots,
            |node, slabs, t_max| enter(node, slabs, t_max),
            |node, shift, entered, stack| push(node, shift, entered, stack),
            |leaf, shear, (limit, margins)| {
                let met = meet(leaf, shear, (limit, margins));
                met.unwrap_or_else(|| leaf.meet(shear, margins))
            },
        )
    }
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline]
fn hasten<'a, const ANY: bool, const GATED: bool>(
    wide: &'a Wide<8>,
    ray: &Ray,
    slots: (Option<u32>, u32),
) -> Option<Search<'a>> {
    // SAFETY: as above.
    unsafe {
        traversal::hasten::<8, ANY, GATED, __m256>(
            wide,
            ray,
            slots,
            |node, slabs, t_max| enter(node, slabs, t_max),
            |node, shift, entered, stack| push(node, shift, entered, stack),
            |leaf, shear, limit| meet(leaf, shear, limit),
        )
    }
}

#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
fn first_hits(
    wide: &Wide<8>,
    rays: &[Option<Ray>; BEAM],
) -> [Option<Hit>; BEAM] {
    // SAFETY: as above.
    unsafe {
        beam::first_hits(
            wide,
            rays,
            |leaf, shear, limit| meet(leaf, shear, limit),
            |ray| first_hit(wide, ray, None),
        )
    }
}

/// Which boxes of a node the ray enters before its t_max.
///
/// # Safety
/// The rows of `slabs` are below 6.
#[target_feature(enable = "avx2,fma")]
#[inline]
pub unsafe fn enter(
    node: &Node<8>,
    slabs: &Slabs,
    t_max: f32,
) -> Entered<__m256> {
    // Give the distances of eight planes
    let plane = |start: &[f32; 3], axis: usize, row: usize| {
        // SAFETY: the row is below 6, says the caller; it is 8 numbers.
        let row = unsafe { node.planes.get_unchecked(row) };
        let planes = unsafe { _mm256_loadu_ps(row.as_ptr()) };
        let inverse = _mm256_set1_ps(slabs.inverse[axis]);
        let start = _mm256_set1_ps(start[axis]);
        _mm256_fmsub_ps(planes, inverse, start)
    };
    let mut near = _mm256_setzero_ps();
    let mut far = _mm256_set1_ps(t_max);
    for axis in 0..3 {
        let enter = plane(&slabs.entry, axis, slabs.enter[axis]);
        let leave = plane(&slabs.exit, axis, slabs.leave[axis]);
        near = _mm256_max_ps(enter, near);
        far = _mm256_min_ps(leave, far);
    }
    let met = _mm256_cmp_ps::<_CMP_LE_OQ>(near, far);
    Entered { mask: _mm256_movemask_ps(met) as u32, near, far }
}

/// For each mask, the permutation that moves its lanes to the front.
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

/// Pushes the children entered from far to near; returns the nearest.
///
/// # Safety
/// The stack has room for eight children, and one at least was entered.
#[target_feature(enable = "avx2,bmi1,lzcnt,popcnt")]
#[inline]
pub unsafe fn push(
    node: &Node<8>,
    shift: u32,
    entered: &Entered<__m256>,
    stack: &mut Stack,
) -> u32 {
    // Put eight lanes in the octant's order
    let order = load(&node.order);
    let order = _mm256_srl_epi32(order, _mm_cvtsi32_si128(shift as i32));
    let children = load(&node.children);
    let children = _mm256_permutevar8x32_epi32(children, order);
    let near = _mm256_permutevar8x32_ps(entered.near, order);
    let far = _mm256_permutevar8x32_ps(entered.far, order);
    let met = _mm256_cmp_ps::<_CMP_LE_OQ>(near, far);
    let mask = _mm256_movemask_ps(met) as u32;
    // Store all but the nearest child
    let pack = load(&PACK[mask as usize & 255]);
    let near = _mm256_permutevar8x32_ps(near, pack);
    let packed = _mm256_permutevar8x32_epi32(children, pack);
    // SAFETY: there is room for eight, says the caller, and all but one of
    // those in the mask are left there.
    unsafe {
        let (top, distances) = stack.top::<8>();
        _mm256_storeu_si256(top.cast(), packed);
        _mm256_storeu_ps(distances, near);
        stack.grow(mask.count_ones() as usize - 1);
    }
    let last = _mm256_set1_epi32(31 - mask.leading_zeros() as i32);
    let child = _mm256_permutevar8x32_epi32(children, last);
    _mm256_cvtsi256_si32(child) as u32
}

#[target_feature(enable = "avx2")]
#[inline]
fn load(numbers: &[u32; 8]) -> __m256i {
    // SAFETY: eight numbers are read, from any address.
    unsafe { _mm256_loadu_si256(numbers.as_ptr().cast()) }
}

/// The triangles of a leaf that a ray meets up to the distance `limit`,
/// as a mask, and their distances; none if the ray passes one of them
/// closely. Lanes that meet the ray beyond may or may not be in the mask.
///
/// # Safety
/// The leaf is one of `Leaves`, and the axes of the shear are below 3.
#[target_feature(enable = "avx2,fma")]
#[inline]
pub unsafe fn meet(
    leaf: Leaf,
    shear: &Shear,
    (limit, margins): (f64, &Margins),
) -> Met {
    // Read a coordinate of four triangles
    let runs = leaf.words.as_ptr();
    let at = |c: usize, i: usize| {
        // SAFETY: there are nine runs, and four numbers of the last.
        unsafe {
            let first = runs.add((2 * shear.axes[i] + 1) * leaf.count);
            _mm256_loadu_pd(first.add(c * 6 * leaf.count).cast())
        }
    };
    // Shear the corners of four triangles
    let [ox, oy, oz] = shear.origin.map(|x| _mm256_set1_pd(x));
    let [sx, sy] = shear.slope.map(|x| _mm256_set1_pd(x));
    let sheared = |lanes, origin, slope, z| {
        let moved = _mm256_sub_pd(lanes, origin);
        _mm256_sub_pd(moved, _mm256_mul_pd(slope, z))
    };
    let corner = |c| {
        let z = _mm256_sub_pd(at(c, 2), oz);
        (sheared(at(c, 0), ox, sx, z), sheared(at(c, 1), oy, sy, z), z)
    };
    let ((ax, ay, az), (bx, by, bz)) = (corner(0), corner(1));
    let (cx, cy, cz) = corner(2);
    // Compute the four triangles' edge functions
    let edge = |a, b, c, d| {
        let cd = _mm256_mul_pd(c, d);
        let (rest, lost) =
            (_mm256_fmsub_pd(a, b, cd), _mm256_fnmadd_pd(c, d, cd));
        _mm256_add_pd(rest, lost)
    };
    let u = edge(cx, by, cy, bx);
    let v = edge(ax, cy, ay, cx);
    let w = edge(bx, ay, by, ax);
    // Reject the triangles outside by signs
    let inside = |margin: f64| {
        let low = _mm256_set1_pd(-margin);
        let high = _mm256_set1_pd(margin);
        let above = |e| _mm256_cmp_pd::<_CMP_GE_OQ>(e, low);
        let below = |e| _mm256_cmp_pd::<_CMP_LE_OQ>(e, high);
        let all = |a, b, c| _mm256_and_pd(_mm256_and_pd(a, b), c);
        _mm256_movemask_pd(_mm256_or_pd(
            all(above(u), above(v), above(w)),
            all(below(u), below(v), below(w)),
        )) & leaf.lanes as i32
    };
    let near = inside(margins.narrow);
    if near == 0 {
        return Some((0, [0.; LANES]));
    }
    if near != inside(0.) {
        return None;
    }
    // Divide for the distances
    let sum = _mm256_add_pd(_mm256_add_pd(u, v), w);
    let height = _mm256_add_pd(_mm256_mul_pd(u, az), _mm256_mul_pd(v, bz));
    let height = _mm256_add_pd(height, _mm256_mul_pd(w, cz));
    let height = _mm256_div_pd(height, sum);
    let distance = _mm256_mul_pd(height, _mm256_set1_pd(shear.stretch));
    let least = _mm256_set1_pd(-margins.near);
    let ahead = _mm256_cmp_pd::<_CMP_GT_OQ>(distance, least);
    let limit = _mm256_set1_pd(limit);
    let within = _mm256_cmp_pd::<_CMP_LE_OQ>(distance, limit);
    let met = _mm256_movemask_pd(_mm256_and_pd(ahead, within));
    let mut distances = [0.; LANES];
    // SAFETY: four numbers are written.
    unsafe { _mm256_storeu_pd(distances.as_mut_ptr(), distance) };
    Some(((met & near) as u32, distances))
}
