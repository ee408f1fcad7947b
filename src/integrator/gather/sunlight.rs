// Tangled from chapters/glass.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Gathers in sunlight, behind panes and behind sheets.
//!
//! Its bits belong to `GATHER_VERSION`.

use glam::DVec3;
use rand::RngExt;
use rand_pcg::Pcg64;

use super::Tracer;
use super::cache::Cell;
use crate::bvh::{Hit, Intersector};
use crate::numerics::power_of_two;
use crate::sampler::to_unit;
use crate::scene::Ray;

impl<K: Intersector> Tracer<'_, K> {
    /// What the ray from `x` in this direction meets behind all panes, and the
    /// part of the light from there that they transmit.
    #[inline(always)]
    pub fn first_hit(
        &mut self,
        x: &Hit,
        direction: DVec3,
    ) -> (Option<Hit>, f64) {
        let surfaces = &self.gather.view.surfaces;
        let ray = Ray { origin: x.point, direction };
        let hit = self.intersector.first_hit(&ray, Some(x.primitive));
        let (hit, part, more) =
            surfaces.behind_panes(self.intersector, direction, hit);
        self.rays += 1 + more;
        (hit, part)
    }

    /// The side of `x` on which the light falls that a sample follows; `u`
    /// chooses it, and stays uniform.
    #[inline(always)]
    pub fn lit_side(&self, x: &Hit, u: &mut [u32; 2]) -> Hit {
        let surfaces = &self.gather.view.surfaces;
        if !surfaces.transmits {
            return *x;
        }
        let mut first = to_unit(u[0]);
        let side = surfaces.lit_side(x, &mut first);
        u[0] = (first * power_of_two(32)) as u32;
        side
    }

    /// The cells around a hit on both sides of a sheet, as one that has what the
    /// sheet reflects and transmits of their light.
    pub fn sheet_around(
        &self,
        hit: &Hit,
        u: [f64; 2],
        parts: [f64; 2],
    ) -> Cell {
        let grid = &self.cache.grid;
        let most = self.gather.view.surfaces.most;
        let [front, back] = [0, 1].map(|k| {
            let normal = if k == 0 { hit.normal } else { -hit.normal };
            let name = grid.name_around(hit.point, normal, u);
            self.cache.at(name).scaled((parts[k] / most) as f32)
        });
        front.plus(back)
    }

    /// An estimate of the irradiance at `x`, on the side of its normal, from
    /// the sun, in the unit of the sky's.
    pub fn sunlight(&mut self, x: &Hit, random: &mut Pcg64) -> f64 {
        let u = [random.random(), random.random()];
        let view = &self.gather.view;
        let (light, rays) = view.sunlight(self.intersector, x, u);
        self.rays += rays;
        light
    }

    /// The same on the side of `x` that a random number chooses.
    pub fn sunlight_of(&mut self, x: &Hit, random: &mut Pcg64) -> f64 {
        if !self.gather.view.sky.has_sun() {
            return 0.;
        }
        let side = self.lit_side(x, &mut [random.random(), 0]);
        self.sunlight(&side, random)
    }
}
