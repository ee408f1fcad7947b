// Tangled from chapters/glass.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The light of the sun itself, which comes from a disc.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::numerics::sincos_turns;

/// The light of the sun, which comes from a disc.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beam {
    /// The unit vector to its middle.
    pub toward: DVec3,
    /// The irradiance of a surface that faces it, in units of that of a
    /// horizontal one under the sky alone.
    pub irradiance: f64,
}

/// The sine of half the angle under which the sun is seen, 0.533 degrees.
const SUN_RADIUS: f64 = 0.004_651_285_685_060_403;

impl Beam {
    /// A direction to a point of the sun, chosen by two numbers uniform over
    /// [0, 1), and the irradiance that a surface with this unit normal gets if
    /// all of the sun is there: 0 if that point is behind the surface.
    #[inline]
    pub fn sample(
        &self,
        normal: DVec3,
        [u, turn]: [f64; 2],
    ) -> (DVec3, f64) {
        let radius = SUN_RADIUS * u.sqrt();
        let height = (1. - radius * radius).sqrt();
        let (cosine, sine) = sincos_turns(turn);
        let (right, up) = self.toward.any_orthonormal_pair();
        let across = right * cosine + up * sine;
        let direction = across * radius + self.toward * height;
        let cosine = normal.dot(direction).max(0.);
        (direction, self.irradiance * cosine / height)
    }
}
