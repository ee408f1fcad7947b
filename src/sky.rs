// Tangled from chapters/sky.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The only light: a half space of directions with radiance 1.
//!
//! That each half is uniform is relied on by the control variate of
//! `integrator`, by tiles of one constant in `analysis::background`, and by
//! the records of `integrator::gather::cache`.

use glam::DVec3;

/// The sky: radiance 1 from all directions above the horizon.
#[derive(Clone, Copy, Debug)]
pub struct Sky {
    /// Unit vector of the coordinate axis that points to the zenith.
    zenith: DVec3,
}

impl Sky {
    /// The sky whose zenith is the coordinate axis nearest to `up`.
    pub fn new(up: DVec3) -> Self {
        let size = |axis: &DVec3| axis.dot(up).abs();
        let axes = DVec3::AXES.into_iter();
        let last = axes.max_by(|a, b| size(a).total_cmp(&size(b)));
        let axis = last.unwrap_or(DVec3::Z);
        Self { zenith: axis * axis.dot(up).signum() }
    }

    /// The radiance that arrives from `direction`, if nothing is in the way.
    pub fn radiance(&self, direction: DVec3) -> f64 {
        if self.zenith.dot(direction) > 0. { 1. } else { 0. }
    }

    /// The share of sky in the hemisphere around the unit vector `normal`,
    /// weighted by the cosine: in [0, 1].
    pub fn share(&self, normal: DVec3) -> f64 {
        (0.5 + 0.5 * self.zenith.dot(normal)).clamp(0., 1.)
    }
}
