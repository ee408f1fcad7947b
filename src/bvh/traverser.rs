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
        let wide = Wide::new(triangles, quality, placed);
        let wide = wide.map_err(|error| {
            let text = format!("no room for the hierarchy: {error}");
            io::Error::new(error.kind(), text)
        })?;
        Ok(Self { wide, kernel: PhantomData })
    }

    /// The answer to what a ray that left the first of the slots meets: the
    /// nearest triangle, or with `ANY` what decides whether that is the second.
    #[inline(always)]
    fn ask<'a, const ANY: bool, R>(
        &'a self,
        ray: &'a Ray,
        slots: (Option<u32>, u32),
        answer: impl Fn(&Search) -> R,
    ) -> R {
        let wide = &self.wide;
        let fast = || {
            // SAFETY: a traverser exists only where its instructions do.
            let found =
                unsafe { walk::<K, N, ANY, true, false>(wide, ray, slots) };
            found.map(|search| answer(&search))
        };
        let again = || {
            // SAFETY: as above.
            let found =
                unsafe { walk::<K, N, ANY, true, true>(wide, ray, slots) };
            answer(&found.unwrap_or_else(|| self.fall_back(ray, slots.0)))
        };
        // SAFETY: as above.
        let found = unsafe { K::enable(fast) };
        // SAFETY: as above.
        found.unwrap_or_else(|| unsafe { K::enable(again) })
    }

    #[cold]
    #[inline(never)]
    fn fall_back<'a>(
        &'a self,
        ray: &'a Ray,
        from: Option<u32>,
    ) -> Search<'a> {
        let (wide, slots) = (&self.wide, (from, NONE));
        // SAFETY: as above.
        let found = unsafe {
            K::enable(|| walk::<K, N, false, false, true>(wide, ray, slots))
        };
        found.expect("only the fast path gives up")
    }
}

impl<K: Kernel<N>, const N: usize> Intersector for Traverser<K, N> {
    #[inline]
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        let hit = |search: &Search| hit(&self.wide, ray, from, search);
        self.ask::<false, _>(ray, (from, NONE), hit)
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
        let slot = |search: &Search| search.slot;
        self.ask::<true, _>(ray, (from, target), slot) == target
    }

    fn first_hits(
        &self,
        rays: &[Option<Ray>; BEAM],
    ) -> [Option<Hit>; BEAM] {
        let alone = |ray: &Ray| self.first_hit(ray, None);
        // SAFETY: as above.
        unsafe { K::enable(|| first_hits::<K, N>(&self.wide, rays, alone)) }
    }
}
