// Tangled from chapters/traversal.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The answers of a hierarchy, computed with certain instructions.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::marker::PhantomData;

use super::beam;
use super::binary::Quality;
use super::ground::{GROUND, Ground};
use super::intersector::{Batch, Hit, Intersector};
#[cfg(target_arch = "x86_64")]
use super::kernels::Vectors;
use super::search::Search;
use super::spawn::hit;
use super::traversal::{Portable, walk};
use super::triangle::NONE;
use super::wide::Wide;
use crate::error::{Error, Result};
use crate::scene::{Ray, Triangles};

/// A hierarchy on a processor that has the instructions `K`.
pub struct Traverser<K, const N: usize> {
    /// The hierarchy.
    pub wide: Wide<N>,
    /// The ground below, if there is one.
    pub ground: Option<Ground>,
    kernel: PhantomData<K>,
}

impl<K, const N: usize> Traverser<K, N> {
    /// Builds the hierarchy of triangles, see [`Wide::new`].
    ///
    /// # Safety
    /// The processor has the instructions.
    pub unsafe fn new(
        (triangles, quality, placed): (Triangles, Quality, &dyn Fn(usize)),
    ) -> Result<Self> {
        let wide = Wide::new(triangles, quality, placed);
        let wide = wide.map_err(|error| {
            Error::Memory(format!("no room for the hierarchy: {error}"))
        })?;
        Ok(Self { wide, ground: None, kernel: PhantomData })
    }
}

macro_rules! traverse {
    ($kernel:ident, $n:literal $($features:tt)*) => {
        impl Traverser<$kernel, $n> {
            /// Whether this processor has the instructions.
            pub fn is_available() -> bool {
                true $(&& is_x86_feature_detected!($features))*
            }

            /// The hit on the nearest triangle of a ray that may start far outside.
            #[cold]
            #[inline(never)]
            fn nearest_from_afar(&self, ray: &Ray) -> Option<Hit> {
                let ray = self.wide.region.enter(ray)?;
                // SAFETY: a traverser exists only where its instructions do.
                unsafe { self.nearest(&ray, None) }
            }

            /// The hit of a ray: a triangle, else the ground, if it goes there.
            #[inline(always)]
            fn or_ground(&self, hit: Option<Hit>, ray: &Ray) -> Option<Hit> {
                match (&self.ground, hit) {
                    (Some(ground), None) => ground.hit(ray),
                    _ => hit,
                }
            }

            $(#[target_feature(enable = $features)])*
            #[inline(never)]
            unsafe fn nearest(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
                let (wide, slots) = (&self.wide, (from, NONE));
                // SAFETY: the caller says that the instructions are there.
                let search = unsafe {
                    walk::<$kernel, $n, false, true, false>(wide, ray, slots)
                };
                match &search {
                    Some(search) => hit(wide, ray, from, search),
                    // SAFETY: as above.
                    None => unsafe { self.fallback(ray, slots) },
                }
            }

            $(#[target_feature(enable = $features)])*
            #[cold]
            #[inline(never)]
            unsafe fn fallback(
                &self,
                ray: &Ray,
                slots: (Option<u32>, u32),
            ) -> Option<Hit> {
                // SAFETY: as above.
                let search = unsafe { self.again::<false>(ray, slots) };
                hit(&self.wide, ray, slots.0, &search)
            }

            $(#[target_feature(enable = $features)])*
            #[inline(never)]
            unsafe fn again<const ANY: bool>(
                &self,
                ray: &Ray,
                slots: (Option<u32>, u32),
            ) -> Search<'_> {
                let wide = &self.wide;
                // SAFETY: as above.
                unsafe {
                    let slow = || {
                        let slots = (slots.0, NONE);
                        walk::<$kernel, $n, false, false, true>(wide, ray, slots)
                    };
                    walk::<$kernel, $n, ANY, true, true>(wide, ray, slots)
                        .or_else(slow)
                        .expect("only the fast path gives up")
                }
            }

            $(#[target_feature(enable = $features)])*
            #[inline(never)]
            unsafe fn any_hit(&self, ray: &Ray, slots: (Option<u32>, u32)) -> u32 {
                // SAFETY: as above.
                unsafe {
                    walk::<$kernel, $n, true, true, false>(&self.wide, ray, slots)
                        .map(|search| search.slot)
                        .unwrap_or_else(|| self.again::<true>(ray, slots).slot)
                }
            }

            $(#[target_feature(enable = $features)])*
            #[inline(never)]
            unsafe fn nearest_slot(&self, ray: &Ray, from: Option<u32>) -> u32 {
                let slots = (from, NONE);
                // SAFETY: as above.
                unsafe {
                    walk::<$kernel, $n, false, true, false>(&self.wide, ray, slots)
                        .map(|search| search.slot)
                        .unwrap_or_else(|| self.again::<false>(ray, slots).slot)
                }
            }

            $(#[target_feature(enable = $features)])*
            #[inline(never)]
            unsafe fn beam(
                &self,
                rays: &Batch<Ray>,
            ) -> Batch<Hit> {
                // SAFETY: as above.
                let alone = |ray: &Ray| unsafe { self.nearest(ray, None) };
                // SAFETY: as above.
                unsafe { beam::first_hits::<$kernel, $n>(&self.wide, rays, alone) }
            }
        }

        impl Intersector for Traverser<$kernel, $n> {
            #[inline]
            fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
                let hit = match from {
                    Some(GROUND..) => self.nearest_from_afar(ray),
                    // SAFETY: a traverser exists only where its instructions do.
                    _ => unsafe { self.nearest(ray, from) },
                };
                self.or_ground(hit, ray)
            }

            #[inline]
            fn is_visible(&self, ray: &Ray, from: Option<u32>, target: u32) -> bool {
                let (entered, from) = match from {
                    Some(GROUND..) => (self.wide.region.enter(ray), None),
                    _ => (Some(*ray), from),
                };
                let wanted = if target == GROUND { NONE } else { target };
                let met = entered.map_or(NONE, |ray| {
                    // SAFETY: as above.
                    unsafe { self.any_hit(&ray, (from, wanted)) }
                });
                // Whatever meets no triangle may meet the ground.
                let falls = || self.below(ray).is_some();
                met == wanted && (target < GROUND || falls() == (target == GROUND))
            }

            fn first_primitive(&self, ray: &Ray, from: Option<u32>) -> Option<u32> {
                let (entered, from) = match from {
                    Some(GROUND..) => (self.wide.region.enter(ray), None),
                    _ => (Some(*ray), from),
                };
                let slot = entered.map_or(NONE, |ray| {
                    // SAFETY: as above.
                    unsafe { self.nearest_slot(&ray, from) }
                });
                let ground = || self.below(ray).map(|_| GROUND);
                Some(slot).filter(|&slot| slot != NONE).or_else(ground)
            }

            fn below(&self, ray: &Ray) -> Option<Hit> {
                self.ground.as_ref()?.hit(ray)
            }

            fn first_hits(&self, rays: &Batch<Ray>) -> Batch<Hit> {
                // SAFETY: as above.
                let mut hits = unsafe { self.beam(rays) };
                if self.ground.is_some() {
                    for (hit, ray) in hits.iter_mut().zip(rays) {
                        let ray = ray.as_ref();
                        *hit = ray.and_then(|ray| self.or_ground(*hit, ray));
                    }
                }
                hits
            }
        }
    };
}

traverse!(Portable, 8);
#[cfg(target_arch = "x86_64")]
traverse!(Vectors, 8 "avx2" "fma" "bmi1" "bmi2" "lzcnt" "popcnt");
#[cfg(target_arch = "x86_64")]
traverse!(Vectors, 16 "avx512f" "avx512vl" "avx512dq"
    "avx2" "fma" "bmi1" "bmi2" "lzcnt" "popcnt");
