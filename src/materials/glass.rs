// Tangled from chapters/glass.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Surfaces that let light through: panes, and diffuse transmitters.
//!
//! ```
//! use litpt::materials::glass::{CLEAREST, Pane};
//!
//! let pane = Pane::new(0.88);
//! assert!((pane.transmittance(1.) - 0.88).abs() < 1e-12);
//! assert!(pane.transmittance(0.2) < 0.6);
//! assert!((Pane::new(CLEAREST).transmittance(1.) - CLEAREST).abs() < 1e-12);
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

use serde::{Deserialize, Serialize};

use crate::scene::encoding::quoted;

/// How a face scatters light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Bsdf {
    /// It reflects this part, diffusely, and lets nothing through.
    Diffuse(f64),
    /// A pane of this transmittance for light that falls on it straight.
    Glass(f64),
    /// It reflects the first part and transmits the second, both diffusely.
    Transmitter([f64; 2]),
}

impl Bsdf {
    /// The part of the light that it scatters diffusely, to either side.
    pub fn albedo(self) -> f64 {
        match self {
            Self::Diffuse(albedo) => albedo,
            Self::Glass(_) => 0.,
            Self::Transmitter([reflected, transmitted]) => {
                reflected + transmitted
            }
        }
    }

    /// The transmittance, for a pane that light meets straight on.
    pub fn transmittance(self) -> f64 {
        match self {
            Self::Diffuse(_) => 0.,
            Self::Glass(part) | Self::Transmitter([_, part]) => part,
        }
    }

    /// The option that gives it to a name, and the value of the option.
    pub fn typed(self, name: &str) -> (&'static str, String) {
        let name = quoted(name);
        match self {
            Self::Diffuse(albedo) => {
                ("albedo", format!("{name}={albedo:?}"))
            }
            Self::Glass(part) => ("glass", format!("{name}={part:?}")),
            Self::Transmitter([back, on]) => {
                ("transmit", format!("{name}={back:?},{on:?}"))
            }
        }
    }

    /// Bits that differ from those of all other bsdfs.
    pub fn key(self) -> [u64; 3] {
        match self {
            Self::Diffuse(albedo) => [0, albedo.to_bits(), 0],
            Self::Glass(part) => [1, part.to_bits(), 0],
            Self::Transmitter([back, on]) => {
                [2, back.to_bits(), on.to_bits()]
            }
        }
    }
}

/// The index of refraction of window glass (Radiance's too).
const INDEX: f64 = 1.52;

/// The part that one side reflects of light that falls on it straight.
const STRAIGHT: f64 =
    (INDEX - 1.) * (INDEX - 1.) / ((INDEX + 1.) * (INDEX + 1.));

/// The transmittance of a pane that absorbs nothing.
pub const CLEAREST: f64 = (1. - STRAIGHT) / (1. + STRAIGHT);

/// A pane of clear glass with plane sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pane {
    /// The part of light that crosses it straight which is not absorbed on
    /// the way.
    crossing: f64,
}

impl Pane {
    /// The pane that transmits this part, from 0 to [`CLEAREST`], of light
    /// that falls on it straight.
    pub fn new(transmittance: f64) -> Self {
        let through = (1. - STRAIGHT) * (1. - STRAIGHT);
        let back = 2. * transmittance * STRAIGHT;
        let root = (through * through + back * back).sqrt();
        Self { crossing: 2. * transmittance / (through + root) }
    }

    /// The parts that it transmits and reflects of light that meets it at this
    /// cosine from its normal.
    pub fn shares(self, cosine: f64) -> [f64; 2] {
        let sine = (1. - cosine * cosine).max(0.).sqrt() / INDEX;
        let inner = (1. - sine * sine).sqrt();
        let crossing = libm::pow(self.crossing, 1. / inner);
        let across = (cosine - INDEX * inner) / (cosine + INDEX * inner);
        let along = (INDEX * cosine - inner) / (INDEX * cosine + inner);
        let mut shares = [0.; 2];
        // Sum the reflections inside for both polarisations
        for side in [across * across, along * along] {
            let (round, enter) = (side * crossing, 1. - side);
            let again = (1. - round * round).max(f64::MIN_POSITIVE);
            let through = enter * enter * crossing / again;
            shares[0] += 0.5 * through;
            shares[1] += 0.5 * side * (1. + crossing * through);
        }
        shares
    }

    /// The same parts of diffuse light, by the midpoint rule in the square of
    /// the cosine.
    pub fn diffuse_shares(self) -> [f64; 2] {
        const STEPS: u32 = 1000;
        let mut sums = [0.; 2];
        for i in 0..STEPS {
            let square = (f64::from(i) + 0.5) / f64::from(STEPS);
            let shares = self.shares(square.sqrt());
            sums = [0, 1].map(|k| sums[k] + shares[k] / f64::from(STEPS));
        }
        sums
    }

    /// The part that it transmits.
    pub fn transmittance(self, cosine: f64) -> f64 {
        self.shares(cosine)[0]
    }
}
