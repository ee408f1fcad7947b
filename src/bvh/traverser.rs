// Tangled from chapters/traversal.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! What a hierarchy answers by means of certain instructions.

use std::io;
use std::marker::PhantomData;

use super::beam;
use super::intersector::{BEAM, Hit, Intersector};
#[cfg(target_arch = "x86_64")]
use super::kernels::{Avx2, Avx512};
use super::spawn::hit;
use super::traversal::{Kernel, Portable, walk};
use super::triangle::{NONE, Search};
use super::wide::{Quality, Wide};
use crate::scene::{Ray, Triangles};

/// Whole walks with the instructions of a kernel.
pub trait Walks<const N: usize>: Kernel<N> {
    /// The first hit of a ray that has left a triangle.
    ///
    /// # Safety
    /// The processor has the instructions.
    unsafe fn first_hit(
        wide: &Wide<N>,
        ray: &Ray,
        from: Option<u32>,
    ) -> Option<Hit>;

    /// The slot of the nearest triangle, or `NONE`, if that is the second of
    /// the slots; else that of any that is in the way.
    ///
    /// # Safety
    /// The processor has the instructions.
    unsafe fn visible(
        wide: &Wide<N>,
        ray: &Ray,
        slots: (Option<u32>, u32),
    ) -> u32;

    /// The first hits of a beam, see `beam::first_hits`.
    ///
    /// # Safety
    /// The processor has the instructions.
    unsafe fn first_hits(
        wide: &Wide<N>,
        rays: &[Option<Ray>; BEAM],
    ) -> [Option<Hit>; BEAM];

    /// What the fast path without gates leaves: the nearest triangle, or with
    /// `ANY` any, see `walk`.
    ///
    /// # Safety
    /// The processor has the instructions.
    unsafe fn again<'a, const ANY: bool>(
        wide: &'a Wide<N>,
        ray: &'a Ray,
        slots: (Option<u32>, u32),
    ) -> Search<'a>;
}

macro_rules! walks {
    ($kernel:ident, $n:tt, {$($of:tt)*} $($features:literal)?) => {
        impl<$($of)*> Walks<$n> for $kernel {
            $(#[target_feature(enable = $features)])?
            #[inline(never)]
            unsafe fn first_hit(
                wide: &Wide<$n>,
                ray: &Ray,
                from: Option<u32>,
            ) -> Option<Hit> {
                let slots = (from, NONE);
                // SAFETY: the caller says that the instructions are there.
                unsafe {
                    match walk::<Self, $n, false, true, false>(
                        wide, ray, slots,
                    ) {
                        Some(search) => hit(wide, ray, from, &search),
                        None => {
                            let search =
                                Self::again::<false>(wide, ray, slots);
                            hit(wide, ray, from, &search)
                        }
                    }
                }
            }

            $(#[target_feature(enable = $features)])?
            #[inline(never)]
            unsafe fn visible(
                wide: &Wide<$n>,
                ray: &Ray,
                slots: (Option<u32>, u32),
            ) -> u32 {
                // SAFETY: as above.
                unsafe {
                    match walk::<Self, $n, true, true, false>(wide, ray, slots) {
                        Some(search) => search.slot,
                        None => Self::again::<true>(wide, ray, slots).slot,
                    }
                }
            }

            $(#[target_feature(enable = $features)])?
            #[inline(never)]
            unsafe fn first_hits(
                wide: &Wide<$n>,
                rays: &[Option<Ray>; BEAM],
            ) -> [Option<Hit>; BEAM] {
                // SAFETY: as above.
                let alone = |ray: &Ray| unsafe { Self::first_hit(wide, ray, None) };
                // SAFETY: as above.
                unsafe { beam::first_hits::<Self, $n>(wide, rays, alone) }
            }

            $(#[target_feature(enable = $features)])?
            #[inline(never)]
            unsafe fn again<'a, const ANY: bool>(
                wide: &'a Wide<$n>,
                ray: &'a Ray,
                slots: (Option<u32>, u32),
            ) -> Search<'a> {
                // SAFETY: as above.
                unsafe {
                    if let Some(search) =
                        walk::<Self, $n, ANY, true, true>(wide, ray, slots)
                    {
                        return search;
                    }
                    let slots = (slots.0, NONE);
                    walk::<Self, $n, false, false, true>(wide, ray, slots)
                        .expect("only the fast path gives up")
                }
            }
        }
    };
}

walks!(Portable, N, { const N: usize });
#[cfg(target_arch = "x86_64")]
walks!(Avx2, 8, {} "avx2,fma,bmi1,bmi2,lzcnt,popcnt");
#[cfg(target_arch = "x86_64")]
walks!(Avx512, 16, {}
    "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt");

/// A hierarchy on a processor that has the instructions `K`.
pub struct Traverser<K, const N: usize> {
    pub wide: Wide<N>,
    kernel: PhantomData<K>,
}

impl<K: Walks<N>, const N: usize> Traverser<K, N> {
    /// Builds the hierarchy of triangles, see [`Wide::new`]. The processor
    /// must have the instructions.
    pub fn new(
        triangles: Triangles,
        quality: Quality,
        placed: &dyn Fn(usize),
    ) -> io::Result<Self> {
        assert!(K::is_available());
        let wide = Wide::new(triangles, quality, placed);
        let wide = wide.map_err(|error| {
            let text = format!("no room for the hierarchy: {error}");
            io::Error::new(error.kind(), text)
        })?;
        Ok(Self { wide, kernel: PhantomData })
    }
}

impl<K: Walks<N>, const N: usize> Intersector for Traverser<K, N> {
    #[inline]
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        // SAFETY: a traverser exists only where its instructions do.
        unsafe { K::first_hit(&self.wide, ray, from) }
    }

    #[inline]
    fn is_occluded(&self, ray: &Ray, from: Option<u32>) -> bool {
        !self.is_visible(ray, from, NONE)
    }

    #[inline]
    fn is_visible(
        &self,
        ray: &Ray,
        from: Option<u32>,
        target: u32,
    ) -> bool {
        // SAFETY: as above.
        unsafe { K::visible(&self.wide, ray, (from, target)) == target }
    }

    fn first_hits(
        &self,
        rays: &[Option<Ray>; BEAM],
    ) -> [Option<Hit>; BEAM] {
        // SAFETY: as above.
        unsafe { K::first_hits(&self.wide, rays) }
    }
}
