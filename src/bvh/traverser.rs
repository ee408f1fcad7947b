// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! What a hierarchy answers by means of certain instructions.

use std::io;
use std::marker::PhantomData;

use super::beam::first_hits;
use super::intersector::{BEAM, Hit, Intersector};
use super::spawn::hit;
use super::traversal::{Kernel, walk};
use super::triangle::{NONE, Search};
use super::wide::{Quality, Wide};
use crate::scene::{Ray, Triangles};

/// A hierarchy on a processor that has the instructions `K`.
pub struct Traverser<K, const N: usize> {
    pub wide: Wide<N>,
    kernel: PhantomData<K>,
}

impl<K: Kernel<N>, const N: usize> Traverser<K, N> {
    /// Builds the hierarchy of triangles, see [`Wide::new`]. The processor
    /// must have the instructions.
    pub fn new(
        triangles: Triangles,
        quality: Quality,
        placed: &dyn Fn(usize),
    ) -> io::Result<Self> {
        assert!(K::is_available());
        let wide = Wide::new(triangles, quality, placed)?;
        Ok(Self { wide, kernel: PhantomData })
    }

    /// Does `work` with the instructions.
    #[inline(always)]
    fn enable<R>(&self, work: impl FnOnce() -> R) -> R {
        // SAFETY: a traverser exists only where its instructions do.
        unsafe { K::enable(work) }
    }

    /// What a ray that left the first of the slots meets on the fast path: the
    /// nearest, or with `ANY` what decides whether that is the second. This is
    /// to be inlined into work that is enabled.
    #[inline(always)]
    fn search<'a, const ANY: bool>(
        &'a self,
        ray: &'a Ray,
        slots: (Option<u32>, u32),
    ) -> Option<Search<'a>> {
        // SAFETY: as above.
        unsafe { walk::<K, N, ANY, true, false>(&self.wide, ray, slots) }
    }

    /// The answer of a search through gates, or where something is doubtful.
    #[inline(always)]
    fn search_again<'a, const ANY: bool, R>(
        &'a self,
        ray: &'a Ray,
        slots: (Option<u32>, u32),
        answer: impl FnOnce(&Search) -> R,
    ) -> R {
        self.enable(|| {
            // SAFETY: as above.
            let found = unsafe {
                walk::<K, N, ANY, true, true>(&self.wide, ray, slots)
            };
            answer(&found.unwrap_or_else(|| self.fall_back(ray, slots.0)))
        })
    }

    #[cold]
    #[inline(never)]
    fn fall_back<'a>(
        &'a self,
        ray: &'a Ray,
        from: Option<u32>,
    ) -> Search<'a> {
        let slots = (from, NONE);
        // SAFETY: as above.
        let found = self.enable(|| unsafe {
            walk::<K, N, false, false, true>(&self.wide, ray, slots)
        });
        found.expect("only the fast path gives up")
    }
}

impl<K: Kernel<N>, const N: usize> Intersector for Traverser<K, N> {
    #[inline]
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        self.enable(move || {
            let (wide, slots) = (&self.wide, (from, NONE));
            match self.search::<false>(ray, slots) {
                Some(search) => hit(wide, ray, from, &search),
                None => {
                    let hit = |s: &Search| hit(wide, ray, from, s);
                    self.search_again::<false, _>(ray, slots, hit)
                }
            }
        })
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
        let slots = (from, target);
        let slot = self.enable(move || {
            let search = self.search::<true>(ray, slots);
            search.map(|search| search.slot)
        });
        let again =
            || self.search_again::<true, _>(ray, slots, |found| found.slot);
        slot.unwrap_or_else(again) == target
    }

    fn first_hits(
        &self,
        rays: &[Option<Ray>; BEAM],
    ) -> [Option<Hit>; BEAM] {
        let alone = |ray: &Ray| self.first_hit(ray, None);
        // SAFETY: as above.
        self.enable(|| unsafe {
            first_hits::<K, N>(&self.wide, rays, alone)
        })
    }
}
