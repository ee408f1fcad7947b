// Tangled from chapters/glass.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The light of the sun at a hit.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use crate::analysis::LitView;
use crate::bvh::{Hit, Intersector};
use crate::scene::Ray;

impl LitView<'_> {
    /// An estimate of the irradiance at a hit, on the side of its normal, from
    /// the sun and the bright patches, in the unit of the sky's: from the
    /// point that two numbers uniform over [0, 1) choose. The second number
    /// counts the rays traced.
    #[inline(never)]
    pub fn sunlight(
        &self,
        intersector: &impl Intersector,
        x: &Hit,
        u: [f64; 2],
    ) -> (f64, u64) {
        let (direction, irradiance) = self.sky.sample_sun(x.normal, u);
        if irradiance == 0. {
            return (0., 0);
        }
        let ray = Ray { origin: x.point, direction };
        let hit = intersector.first_hit(&ray, Some(x.primitive));
        let (hit, transmittance, more) =
            self.surfaces.behind_panes(intersector, direction, hit);
        let light = irradiance * transmittance;
        (if hit.is_some() { 0. } else { light }, 1 + more)
    }
}
