// Tangled from chapters/glass.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Rays that ask whether the sun is seen, and go on behind panes.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::DVec3;

use super::{PathEvent, PathState};
use crate::analysis::LitView;
use crate::bvh::{Hit, Intersector};
use crate::materials::Surfaces;
use crate::scene::Ray;

/// A ray to the sun, which a path sends before it goes on.
#[derive(Clone, Copy, Debug)]
pub struct Shadow {
    /// Its direction.
    direction: DVec3,
    /// What the sun contributes if nothing is in the way.
    light: f64,
    /// Where the path goes on, and the triangle that it leaves.
    next: (Ray, u32),
}

impl PathState {
    /// Sends a shadow ray to a point of the sun, which gives this irradiance,
    /// and then goes on with a ray that leaves a triangle.
    #[inline]
    pub fn look_for_sun(
        &mut self,
        (direction, irradiance): (DVec3, f64),
        ray: Ray,
        from: u32,
    ) -> PathEvent {
        let light = self.throughput * irradiance;
        if light == 0. {
            return PathEvent::Scatter(ray, from);
        }
        self.shadow = Some(Shadow { direction, light, next: (ray, from) });
        PathEvent::Scatter(Ray { direction, ..ray }, from)
    }
}

impl Shadow {
    /// Ends a shadow ray of a path, which has met this, or lets it go on
    /// through a pane.
    #[inline]
    pub fn end(
        self,
        path: &mut PathState,
        surfaces: &Surfaces,
        hit: Option<Hit>,
    ) -> PathEvent {
        let Self { direction, light, next: (ray, from) } = self;
        if let Some(hit) = hit
            && let Some(part) = surfaces.pane(&hit, direction)
        {
            path.shadow = Some(Self { light: light * part, ..self });
            let ray = Ray { origin: hit.point, direction };
            return PathEvent::Scatter(ray, hit.primitive);
        }
        if hit.is_none() {
            path.sunlight += light;
            path.direct += if path.bounces == 1 { light } else { 0. };
        }
        path.shadow = None;
        PathEvent::Scatter(ray, from)
    }
}

impl LitView<'_> {
    /// An estimate of the irradiance at a hit, on the side of its normal, from
    /// the sun, in the unit of the sky's: from the point of the disc that two
    /// numbers uniform over [0, 1) choose. And the rays traced.
    pub fn sunlight(
        &self,
        intersector: &impl Intersector,
        x: &Hit,
        u: [f64; 2],
    ) -> (f64, u64) {
        let Some(beam) = self.sky.beam else { return (0., 0) };
        let (direction, irradiance) = beam.sample(x.normal, u);
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
