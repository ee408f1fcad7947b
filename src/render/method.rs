// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Methods of sampling an image, and the renderer of each.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::gather::Gather;
use super::{Job, Renderer};
use crate::analysis::background::KnownPixels;
use crate::analysis::{Inquiry, SceneAnalysis};
use crate::bvh::Bvh;
use crate::camera::Camera;
use crate::film::{Film, Window};
use crate::gather::Correction;
use crate::integrator::{
    ControlledPathTracer, DirectSky, Integrator, PathTracer, identity,
};
use crate::sampler::sobol::SobolSampler;
use crate::sampler::{IndependentSampler, Sampler};
use crate::scene::Entrance;

/// How samples are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Paths of independent random numbers.
    Reference,
    /// Such paths, placed by scrambled nets, with the sky as a control
    /// variate.
    Sobol,
    /// A final gather into a cache of radiance, corrected.
    Gather,
}

impl Method {
    /// All of them; the first is the reference.
    pub const ALL: [Self; 3] = [Self::Reference, Self::Sobol, Self::Gather];
}

impl fmt::Display for Method {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        out.write_str(match self {
            Self::Reference => "reference",
            Self::Sobol => "sobol",
            Self::Gather => "gather",
        })
    }
}

impl FromStr for Method {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let named = Self::ALL.into_iter().find(|m| m.to_string() == name);
        named.ok_or_else(|| {
            let [first, second, third] = Self::ALL;
            format!("expected auto, {first}, {second} or {third}")
        })
    }
}

/// The method that is asked for; none if a pilot is to choose one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wanted(pub Option<Method>);

impl fmt::Display for Wanted {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self.0 {
            None => out.write_str(AUTO),
            Some(method) => method.fmt(out),
        }
    }
}

impl FromStr for Wanted {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            AUTO => Ok(Self(None)),
            _ => name.parse().map(|method| Self(Some(method))),
        }
    }
}

/// The name for no method.
const AUTO: &str = "auto";

/// What decides the samples of an image, beside the scene and the view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sampling {
    /// How samples are made.
    pub method: Method,
    /// Chooses all random numbers.
    pub seed: u64,
    /// Samples of a pixel that are placed together, on average.
    pub replicate: u64,
    /// At most about as many rays train the cache of a gather.
    pub training: u64,
    /// How much of the sky paths in nets subtract, in per cent.
    #[serde(rename = "sky_control")]
    pub control: u64,
}

impl Sampling {
    /// The reference.
    pub fn reference(seed: u64) -> Self {
        let method = Method::Reference;
        Self { method, seed, replicate: 1, training: 0, control: 0 }
    }

    /// For `samples` of each of `area` pixels, if that is known.
    pub fn new(
        method: Method,
        seed: u64,
        samples: Option<u64>,
        area: u64,
    ) -> Self {
        // Count the samples that are placed together
        let together = |replicates: u64, most: u64| match samples {
            Some(n) => 1 << (n / replicates).clamp(1, most).ilog2(),
            None => 4,
        };
        let replicate = match method {
            Method::Reference => 1,
            Method::Sobol => together(4, MOST),
            Method::Gather => together(16, MOST_GATHERED),
        };
        let paths = samples.map(|n| n.saturating_mul(area));
        let expected = paths.map_or(u64::MAX, |n| n.saturating_mul(RAYS));
        let training = match method {
            Method::Gather => (expected / 2).clamp(LEAST, LARGEST),
            _ => 0,
        };
        Self { method, seed, replicate, training, control: 0 }
    }

    /// A film for these samples, without one.
    pub fn film(&self, resolution: (u32, u32), window: Window) -> Film {
        let film = Film::cropped(resolution, window);
        let film = film.with_replicates(self.replicate);
        match self.method {
            Method::Gather => film.with_shared_tiles(),
            _ => film,
        }
    }

    /// Names what decides the samples: those of different names are not to
    /// be mixed.
    pub fn identity(&self) -> String {
        let Self { method, replicate, training, .. } = self;
        match method {
            Method::Reference => identity(),
            Method::Sobol => {
                format!("{}, controlled nets of {replicate}", identity())
            }
            Method::Gather => format!(
                "gather {GATHER_VERSION}, nets of {replicate}, training with \
                 {training} rays"
            ),
        }
    }
}

/// Changes whenever the code that decides what a gather is does.
const GATHER_VERSION: u32 = 4;

/// Samples of a scramble at most: of paths, and of gathers, of which a
/// tile keeps all.
const MOST: u64 = 1 << 8;
const MOST_GATHERED: u64 = 4;

/// Rays of a gather with its part of the correction, about.
const RAYS: u64 = 5;

/// Rays of a training, at least and at most.
const LEAST: u64 = 1 << 16;
const LARGEST: u64 = 1 << 22;

/// The renderer of a scene with this intersector, for what its analysis
/// has found to be needed.
pub fn renderer<'a>(
    intersector: &'a Bvh,
    inquiry: &Inquiry<'a>,
    analysis: &'a SceneAnalysis,
    sampling: &Sampling,
) -> Box<dyn Renderer + 'a> {
    let &Inquiry { entrance, camera, sky, albedo, .. } = inquiry;
    let &Sampling { seed, replicate, training, .. } = sampling;
    let known = &analysis.known;
    let independent = IndependentSampler::new(seed);
    let nets = SobolSampler::new(seed, replicate);
    let paths = PathTracer { albedo, sky };
    let direct = DirectSky { sky };
    let scene = (entrance, intersector, camera, known);
    match sampling.method {
        Method::Reference if analysis.is_black => {
            job(scene, direct, independent)
        }
        Method::Sobol if analysis.is_black => job(scene, direct, nets),
        Method::Reference => job(scene, paths, independent),
        Method::Sobol => {
            let control = sampling.control as f64 / 100.;
            job(scene, ControlledPathTracer { paths, control }, nets)
        }
        Method::Gather => {
            let (entrance, intersector, camera, known) = scene;
            let (correction, learnt) = (Some(Correction::default()), None);
            // Box the renderer that gathers
            Box::new(Gather {
                entrance,
                intersector,
                camera,
                sky,
                albedo,
                known,
                seed,
                training,
                correction,
                learnt,
            })
        }
    }
}

/// The renderer of paths.
fn job<'a>(
    scene: (Entrance, &'a Bvh, &'a Camera, &'a KnownPixels),
    integrator: impl Integrator + 'a,
    sampler: impl Sampler + 'a,
) -> Box<dyn Renderer + 'a> {
    let (entrance, intersector, camera, known) = scene;
    Box::new(Job {
        entrance,
        intersector,
        camera,
        integrator,
        known,
        sampler,
    })
}
