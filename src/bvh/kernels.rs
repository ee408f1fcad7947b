// Tangled from chapters/traversal.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The vector instructions of x86-64: AVX2, with eight boxes at a time, and
//! AVX-512, with sixteen.
//!
//! Each function does what its portable namesake does.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::arch::x86_64::*;
use std::mem::transmute;

use super::traversal::{
    Kernel, LeafHits, LeafKernel, Slabs, Stack, interval, keys,
};
use super::triangle::{LANES, Leaf, Margins, Shear};
use super::wide::Node;

/// The kernel for AVX2 and AVX-512.
pub struct Vectors;

impl Kernel<8> for Vectors {
    #[inline(always)]
    unsafe fn enter(
        node: &Node<8>,
        slabs: &Slabs,
        t_max: f32,
        stack: &mut Stack,
    ) -> Option<u32> {
        let interval = interval(node, slabs, t_max, fused);
        // SAFETY: the processor has the instructions, and there is room for
        // eight, says the caller; all but one of those entered are left
        // there. What is transmuted are eight numbers.
        unsafe {
            let [t_near, t_far]: [__m256; 2] = transmute(interval);
            let met = _mm256_cmp_ps::<_CMP_LE_OQ>(t_near, t_far);
            if _mm256_movemask_ps(met) == 0 {
                return None;
            }
            let keys = keys(&interval);
            let least = keys.into_iter().fold(u32::MAX, u32::min);
            Self::push(&node.children, keys, least, stack);
            Some(*node.children.get_unchecked(least as usize & 7))
        }
    }

    #[inline(always)]
    unsafe fn push(
        children: &[u32; 8],
        keys: [u32; 8],
        least: u32,
        stack: &mut Stack,
    ) {
        // SAFETY: as above.
        unsafe {
            let keys: __m256i = transmute(keys);
            let are = |key: u32| {
                _mm256_cmpeq_epi32(keys, _mm256_set1_epi32(key as i32))
            };
            let out = _mm256_or_si256(are(least), are(u32::MAX));
            let mask = 255 & !_mm256_movemask_ps(_mm256_castsi256_ps(out));
            let keys = _mm256_andnot_si256(out, keys);
            let pack: __m256i = transmute(PACK[mask as usize]);
            let keys = _mm256_permutevar8x32_epi32(keys, pack);
            let few = sorted(_mm256_castsi256_si128(keys));
            let keys = _mm256_inserti128_si256::<0>(keys, few);
            let children: __m256i = transmute(*children);
            let children = _mm256_permutevar8x32_epi32(children, keys);
            let (top, distances) = stack.top::<8>();
            _mm256_storeu_si256(top.cast(), children);
            let keys = _mm256_andnot_si256(_mm256_set1_epi32(7), keys);
            _mm256_storeu_si256(distances.cast(), keys);
            stack.grow(mask.count_ones() as usize);
        }
    }
}

impl LeafKernel for Vectors {
    #[target_feature(enable = "avx2,fma")]
    #[inline]
    unsafe fn intersect(
        leaf: Leaf,
        shear: &Shear,
        (limit, margins): (f64, &Margins),
    ) -> LeafHits {
        // Read a coordinate of four triangles
        let runs = leaf.words.as_ptr();
        let at = |c: usize, i: usize| {
            // SAFETY: there are nine runs, and four numbers of the last; the axes
            // of a shear are below 3.
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
            let and = |a, b, c| _mm256_and_pd(_mm256_and_pd(a, b), c);
            _mm256_movemask_pd(_mm256_or_pd(
                and(above(u), above(v), above(w)),
                and(below(u), below(v), below(w)),
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
        let height =
            _mm256_add_pd(_mm256_mul_pd(u, az), _mm256_mul_pd(v, bz));
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
}

impl Kernel<16> for Vectors {
    #[inline(always)]
    unsafe fn enter(
        node: &Node<16>,
        slabs: &Slabs,
        t_max: f32,
        stack: &mut Stack,
    ) -> Option<u32> {
        let interval = interval(node, slabs, t_max, fused);
        // SAFETY: as for eight lanes.
        unsafe {
            let [t_near, t_far]: [__m512; 2] = transmute(interval);
            let met = _mm512_cmp_ps_mask::<_CMP_LE_OQ>(t_near, t_far);
            if met == 0 {
                return None;
            }
            let keys = keys(&interval);
            let packed: __m512i = transmute(keys);
            let least = _mm512_reduce_min_epu32(packed);
            if met.count_ones() > 1 {
                Self::push(&node.children, keys, least, stack);
            }
            Some(*node.children.get_unchecked(least as usize & 15))
        }
    }

    #[inline(always)]
    unsafe fn push(
        children: &[u32; 16],
        keys: [u32; 16],
        least: u32,
        stack: &mut Stack,
    ) {
        // SAFETY: as for eight lanes.
        unsafe {
            // Store all but the nearest of sixteen
            let keys: __m512i = transmute(keys);
            let is_not = |key: u32| {
                let key = _mm512_set1_epi32(key as i32);
                _mm512_cmpneq_epi32_mask(keys, key)
            };
            let others = is_not(least) & is_not(u32::MAX);
            let keys = _mm512_maskz_compress_epi32(others, keys);
            let few = sorted(_mm512_castsi512_si128(keys));
            let keys = _mm512_inserti32x4::<0>(keys, few);
            let children: __m512i = transmute(*children);
            let children = _mm512_permutexvar_epi32(keys, children);
            let (top, distances) = stack.top::<16>();
            _mm512_storeu_si512(top.cast(), children);
            let keys = _mm512_andnot_si512(_mm512_set1_epi32(15), keys);
            _mm512_storeu_si512(distances.cast(), keys);
            stack.grow(others.count_ones() as usize);
        }
    }
}

/// The distance of the plane `b`, with one rounding.
#[inline(always)]
pub fn fused(b: f32, inverse: f32, start: f32) -> f32 {
    b.mul_add(inverse, -start)
}

/// For each mask, the permutation that moves its lanes to the front, and
/// another lane behind them.
const PACK: [[u32; 8]; 256] = {
    let mut table = [[0; 8]; 256];
    let mut mask = 0;
    while mask < 256 {
        table[mask] = [mask.trailing_ones() % 8; 8];
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

/// Four numbers, the largest first.
///
/// # Safety
/// The processor has the instructions.
#[inline(always)]
unsafe fn sorted(four: __m128i) -> __m128i {
    // SAFETY: the processor has the instructions, says the caller.
    unsafe {
        let beside = _mm_shuffle_epi32::<0b10_11_00_01>(four);
        let [a, b] =
            [_mm_max_epu32(four, beside), _mm_min_epu32(four, beside)];
        let four = _mm_blend_epi32::<0b1010>(a, b);
        let across = _mm_shuffle_epi32::<0b00_01_10_11>(four);
        let [a, b] =
            [_mm_max_epu32(four, across), _mm_min_epu32(four, across)];
        let four = _mm_blend_epi32::<0b1100>(a, b);
        let beside = _mm_shuffle_epi32::<0b10_11_00_01>(four);
        let [a, b] =
            [_mm_max_epu32(four, beside), _mm_min_epu32(four, beside)];
        _mm_blend_epi32::<0b1010>(a, b)
    }
}
