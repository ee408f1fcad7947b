// Tangled from chapters/sky.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The only light: a half space of directions, uniform or overcast, or all
//! directions.
//!
//! ```
//! use glam::DVec3;
//! use litpt::sky::{Cover, Sky};
//!
//! let sky = Sky::with(DVec3::Z, Cover::Overcast);
//! assert!((sky.radiance(DVec3::Z) - 9. / 7.).abs() < 1e-12);
//! assert_eq!(sky.radiance(-DVec3::Z), 0.);
//! assert_eq!(Sky::new(DVec3::Z).irradiance_ratio(DVec3::X), 0.5);
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::f64::consts::PI;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::numerics::normalise;

/// How the radiance of the sky is distributed; a horizontal surface in the
/// open gets the same from each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Cover {
    /// The same in all directions above the horizon.
    Uniform,
    /// Proportional to 1 + 2 sin γ at the altitude γ (Moon and Spencer
    /// 1942; ISO 15469, type 16).
    Overcast,
    /// The same in all directions, also below the horizon.
    Sphere,
}

/// The sky: light from all directions above the horizon, or from all.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sky {
    /// Unit vector that points to the zenith.
    pub zenith: DVec3,
    /// How its radiance is distributed.
    pub cover: Cover,
    /// The radiance that a camera sees where it looks past all surfaces,
    /// in all directions; if there is none, it sees the sky.
    #[serde(
        rename = "behind",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub background: Option<f64>,
}

impl Sky {
    /// The uniform sky whose zenith is the coordinate axis nearest to `up`.
    pub fn new(up: DVec3) -> Self {
        let size = |axis: &DVec3| axis.dot(up).abs();
        let axes = DVec3::AXES.into_iter();
        let last = axes.max_by(|a, b| size(a).total_cmp(&size(b)));
        let axis = last.unwrap_or(DVec3::Z);
        Self::with(axis * axis.dot(up).signum(), Cover::Uniform)
    }

    /// The sky around a zenith, whose vector is not zero.
    pub fn with(zenith: DVec3, cover: Cover) -> Self {
        let zenith = normalise(zenith).normalize();
        Self { zenith, cover, background: None }
    }

    /// The radiance that arrives from `direction`, if nothing is in the way.
    #[inline(always)]
    pub fn radiance(&self, direction: DVec3) -> f64 {
        let height = self.zenith.dot(direction);
        match self.cover {
            Cover::Sphere => 1.,
            _ if height <= 0. => 0.,
            Cover::Uniform => 1.,
            Cover::Overcast => 3. / 7. * (1. + 2. * height),
        }
    }

    /// The radiance that a camera sees in `direction` if no surface is there.
    #[inline(always)]
    pub fn seen(&self, direction: DVec3) -> f64 {
        self.background.unwrap_or_else(|| self.radiance(direction))
    }

    /// The irradiance of a surface with this unit normal if nothing is in the
    /// way, relative to that of a horizontal one: in [0, 1].
    pub fn irradiance_ratio(&self, normal: DVec3) -> f64 {
        let cosine = self.zenith.dot(normal).clamp(-1., 1.);
        let uniform = 0.5 + 0.5 * cosine;
        match self.cover {
            Cover::Sphere => 1.,
            Cover::Uniform => uniform,
            Cover::Overcast => {
                let (sine, angle) =
                    ((1. - cosine * cosine).sqrt(), libm::acos(cosine));
                let bright = sine + (PI - angle) * cosine;
                (3. / 7. * (uniform + 4. / (3. * PI) * bright))
                    .clamp(0., 1.)
            }
        }
    }
}
