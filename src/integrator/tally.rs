// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Paths whose ends are sorted into the columns of a tally.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::DVec3;

use super::{Integrator, PathEvent, PathState, PathTracer};
use crate::bvh::{Bvh, Hit};
use crate::materials::Surfaces;
use crate::sampler::Sampler;
use crate::tally::{Columns, Tally};

/// A path tracer that also names the column of each path.
pub struct TallyTracer<'a> {
    /// Follows the paths.
    pub paths: PathTracer<'a>,
    /// The columns.
    pub columns: &'a Columns,
    /// The scene whose surfaces may be columns.
    pub bvh: &'a Bvh,
}

impl Integrator for TallyTracer<'_> {
    /// A path, and the derivative of the logarithm of its contribution by the
    /// albedo of a surface.
    type Path = (PathState, f64);

    #[inline(always)]
    fn begin(&self, direction: DVec3, throughput: f64) -> Self::Path {
        (self.paths.begin(direction, throughput), 0.)
    }

    fn surfaces(&self) -> Surfaces<'_> {
        self.paths.surfaces
    }

    #[inline(always)]
    fn advance(
        &self,
        (path, slope): &mut Self::Path,
        hit: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        let is_first_ray = path.bounces == 1;
        if is_first_ray && self.columns.tally.is_of_surfaces() {
            // End at the first surface
            return PathEvent::Terminate(match hit {
                Some(_) => 0.,
                None => self.paths.sky.radiance(path.direction),
            });
        }
        let event = self.paths.advance(path, hit, sampler);
        if let (PathEvent::Scatter(..), Some(hit)) = (event, hit) {
            *slope += self.columns.slope(self.bvh, hit.primitive);
        }
        event
    }

    fn needs_only_surfaces(&self) -> bool {
        self.columns.tally.is_of_surfaces()
    }

    fn row_parts(&self) -> (u64, u32) {
        (self.columns.tally.parts(), self.columns.count)
    }

    #[inline(always)]
    fn tally(
        &self,
        (path, slope): &Self::Path,
        hit: Option<&Hit>,
        contribution: f64,
    ) -> Option<(u32, f64)> {
        let columns = self.columns;
        match columns.tally {
            Tally::ViewFactors(_) => {
                let up = self.paths.sky.zenith.dot(path.direction);
                Some((columns.seen(self.bvh, hit, up > 0.), 1.))
            }
            Tally::SkyPatches(_) if hit.is_some() => None,
            Tally::SkyPatches(_) => {
                let patch = columns.patches.number(path.direction);
                Some((patch, path.throughput))
            }
            Tally::Derivative(_) => Some((0, contribution * slope)),
        }
    }
}
