// Tangled from chapters/choice.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The costs of methods, predicted from a pilot.

use super::pilot::Pilot;
use super::sampling::{Method, Pixels, Sampling};
use crate::film::ErrorNorm;
use crate::integrator::gather::training::PILOT_SAMPLES;

impl Pilot {
    /// How much of the sky a control variate best subtracts, in [0, 1].
    pub fn control(&self) -> f64 {
        let Self { covariance, sky_variance, .. } = self;
        let best = (-covariance / sky_variance).clamp(0., 1.);
        if *sky_variance > 0. { best } else { 0. }
    }

    /// The variance of the first direction that the control variate leaves.
    fn controlled(&self) -> f64 {
        let control = self.control();
        let change = 2. * control * self.covariance
            + control * control * self.sky_variance;
        (self.first + change).max(0.)
    }
}

/// Predicts what images of a window cost.
pub struct Forecast {
    /// The measured means.
    pub pilot: Pilot,
    /// A typical albedo of the surfaces.
    pub albedo: f64,
    /// The pixels of the window.
    pub pixels: Pixels,
}

impl Forecast {
    /// The number of pixels.
    fn area(&self) -> f64 {
        self.pixels.area as f64
    }

    /// The variance of a sample and its rays, in units of the rays of paths,
    /// for `samples` of each pixel. The constants are fits to measured
    /// images.
    pub fn foresee(&self, sampling: &Sampling, samples: f64) -> [f64; 2] {
        let Pilot { square, first, later, rays, .. } = self.pilot;
        match sampling.method {
            Method::Reference => [first + later, rays],
            Method::Sobol => {
                let net = libm::pow(sampling.net_size as f64, -0.4);
                [self.pilot.controlled() * net + later, 1.05 * rays]
            }
            Method::Gather => {
                // Predict the variance and the rays of a gather
                let part = if self.pixels.is_list { RECEIVED } else { 1. };
                let once =
                    self.learning(sampling) / (self.area() * samples);
                let guided = 0.68 * first * square
                    / (square + first).max(f64::MIN_POSITIVE);
                let short = self.pilot.first_rays / rays.max(1e-9);
                let left =
                    4.5 * self.albedo.powi(4) * short * short * later;
                let learnt = libm::pow(samples.min(4096.), -0.1);
                let few = part * (FITTED_AREA / self.area()).sqrt().max(1.);
                let variance = (guided + left) * learnt * few;
                [variance, 1.4 * (self.gathering(sampling) + once)]
            }
        }
    }

    /// The rays of a sample, with its part of the corrections.
    fn gathering(&self, sampling: &Sampling) -> f64 {
        let further = 4.7 * self.albedo * self.pilot.indirect;
        let more = 0.5 / sampling.net_size as f64;
        (1. + more) * (self.seen() + further)
    }

    /// The rays of the training and of the pilot that allocates samples.
    fn learning(&self, sampling: &Sampling) -> f64 {
        let pilot = self.area() * PILOT_SAMPLES as f64 * self.seen();
        0.5 * sampling.training as f64 + pilot
    }

    /// The rays of a path up to its second surface; a receiver is one.
    fn seen(&self) -> f64 {
        if self.pixels.is_list { 1. } else { self.pilot.first_rays }
    }

    /// The samples of each pixel of a window after which the image has an
    /// error. They are up to a fifth too many, and at least two, for one has
    /// no error.
    pub fn needed(&self, method: Method, square: f64) -> u64 {
        let is_enough = |&n: &u64| {
            let sampling = Sampling::new(method, 0, Some(n), self.pixels);
            let [variance, _] = self.foresee(&sampling, n as f64);
            variance <= n as f64 * square
        };
        let quarters = (4..80).map(|k| 0.25 * f64::from(k));
        let mut steps = quarters.map(|k| libm::exp2(k).ceil() as u64);
        steps.find(is_enough).unwrap_or(MANY)
    }

    /// The mean square error of an image that is good enough. The error of the
    /// worst pixel is assumed to be three times the error of the image.
    pub fn allowed(&self, (error, of): (f64, ErrorNorm)) -> f64 {
        let whole = if of.relative { self.pilot.square } else { 1. };
        let part = if of.largest { 1. / 9. } else { 1. };
        error * error * whole * part
    }

    /// The work before each pixel has a sample, in paths.
    pub fn first_paths(&self, sampling: &Sampling) -> f64 {
        let first = self.area() * sampling.net_size as f64;
        match sampling.method {
            Method::Gather => {
                let rays = self.learning(sampling)
                    + first * self.gathering(sampling);
                rays / self.pilot.rays.max(1e-9)
            }
            _ => first,
        }
    }
}

/// The variance that a gather leaves for receivers, whose points are fixed,
/// over what it leaves for pixels.
const RECEIVED: f64 = 1. / 12.;

/// The pixels of the images to which the constants of a gather are fitted.
const FITTED_AREA: f64 = 320. * 240.;

/// The least number of samples for which a picture's method is chosen.
pub const SHOWN: u64 = 64;

/// Samples of a run without a limit.
pub const MANY: u64 = 1 << 20;
