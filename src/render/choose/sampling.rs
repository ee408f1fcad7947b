// Tangled from chapters/choice.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! How samples are made, and what makes them: the methods, the numbers of a
//! method, and its renderer.

use std::fmt;
use std::ops::Not;
use std::sync::{Arc, OnceLock};

use serde::{Deserialize, Serialize};

use crate::analysis::{LitView, SceneAnalysis};
use crate::bvh::Bvh;
use crate::film::{ErrorNorm, Film, Window};
use crate::integrator::gather::rows::RowGather;
use crate::integrator::gather::{Correction, Gather, Learnt};
use crate::integrator::tally::TallyTracer;
use crate::integrator::{Communicator, Integrator, PathTracer, identity};
use crate::numerics::power_of_two;
use crate::render::{Job, Renderer};
use crate::sampler::sobol::SobolSampler;
use crate::sampler::{IndependentSampler, Sampler};
use crate::sensor::Sensor;
use crate::tally::{Columns, REPLICATES};

/// How samples are made.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize,
)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// Paths of independent random numbers.
    #[default]
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
        out.write_str(&format!("{self:?}").to_lowercase())
    }
}

/// What decides the samples of an image, apart from the scene and the view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Sampling {
    /// How samples are made.
    pub method: Method,
    /// Chooses all random numbers.
    pub seed: u64,
    /// Samples of a pixel that are placed together, on average.
    #[serde(rename = "replicate")]
    pub net_size: u64,
    /// About the largest number of rays that train the cache of a gather.
    pub training: u64,
    /// For paths in nets, [`PathTracer::control`] in per cent.
    #[serde(rename = "sky_control")]
    pub control: u64,
    /// For a gather, the error for which its samples are distributed.
    #[serde(rename = "measure")]
    #[serde(default, skip_serializing_if = "ErrorNorm::is_rms")]
    pub norm: ErrorNorm,
    /// Whether the image is a glance: the values of a gather then keep the
    /// error of its cache.
    #[serde(default, skip_serializing_if = "Not::not")]
    pub glance: bool,
}

/// The pixels of a window.
#[derive(Clone, Copy, Debug)]
pub struct Pixels {
    /// How many.
    pub area: u64,
    /// Whether they list receivers, which have no neighbours.
    pub is_list: bool,
}

impl Pixels {
    /// The pixels of an image of this width and height.
    pub fn of_image((width, height): (u32, u32)) -> Self {
        Self { area: u64::from(width) * u64::from(height), is_list: false }
    }
}

impl Sampling {
    /// A sampling for `samples` of each pixel, if that is known. A pixel has
    /// at least 16 replicates; in an image, whose pixels borrow from their
    /// neighbours, four are enough for nets.
    pub fn new(
        method: Method,
        seed: u64,
        samples: Option<u64>,
        Pixels { area, is_list }: Pixels,
    ) -> Self {
        let (least, most, gathered) =
            if is_list { (16, 1 << 12, 16) } else { (4, 1 << 8, 4) };
        let together = |replicates: u64, most: u64| match samples {
            Some(n) => 1 << (n / replicates).clamp(1, most).ilog2(),
            None => 4,
        };
        let rays =
            samples.unwrap_or(u64::MAX).saturating_mul(area * GATHER_RAYS);
        let root = (rays as f64 * BEST_TRAINING).sqrt() as u64;
        let trained = root.min(rays.saturating_mul(2));
        let trained = trained.clamp(1 << 16, 1 << 22);
        let (net_size, training) = match method {
            Method::Reference => (1, 0),
            Method::Sobol => (together(least, most), 0),
            Method::Gather => (together(16, gathered), trained),
        };
        let (control, norm, glance) = (0, ErrorNorm::default(), false);
        Self { method, seed, net_size, training, control, norm, glance }
    }

    /// The sampling of a tally, whose rows have at least 32 replicates, or 16
    /// if they are gathered. An error is expected after an eighth of the
    /// samples that a share of a half would take without nets, and a relative
    /// one after 32 times as many.
    pub fn of_tally(
        method: Method,
        seed: u64,
        samples: Option<u64>,
        error: Option<(f64, ErrorNorm)>,
        pixels: Pixels,
    ) -> Self {
        let needed = error.map(|(error, norm)| {
            let variance = if norm.relative { 1. } else { 0.25 / 8. };
            (variance / error.powi(2)) as u64
        });
        let samples = samples.into_iter().chain(needed).min();
        let most = (1 << 14) as u64;
        let (replicates, part) = match method {
            Method::Gather => (REPLICATES / 2, ROW_TRAINING),
            _ => (REPLICATES, 0.),
        };
        let size = samples.unwrap_or(most) / replicates;
        let net_size = 1 << size.clamp(1, most).ilog2();
        let all = samples.unwrap_or(u64::MAX).saturating_mul(pixels.area);
        let training = ((part * all as f64) as u64).min(1 << 22);
        let sampling = Self::new(method, seed, None, pixels);
        Self { net_size, training, ..sampling }
    }

    /// The same film, which has no sample, for these samples.
    pub fn film(&self, film: Film) -> Film {
        let film = film.with_net_size(self.net_size);
        match self.method {
            Method::Gather => film.with_shared_tiles(),
            _ => film,
        }
    }

    /// The name of the code that decides the samples: samples of different
    /// names must not be mixed.
    pub fn identity(&self) -> String {
        match self.method {
            Method::Gather => format!("gather {GATHER_VERSION}"),
            _ => identity(),
        }
    }
}

/// The rays that train a cache of rows, for each sample.
const ROW_TRAINING: f64 = 0.3;

/// About the rays of a sample of a gather, with its part of the correction.
pub const GATHER_RAYS: u64 = 5;

/// The best number of rays of training is about the root of the rays of
/// all samples times this.
const BEST_TRAINING: f64 = power_of_two(21);

/// Changes whenever the code that decides what a gather is does.
const GATHER_VERSION: u32 = 7;

/// A scene that is ready to be rendered.
pub struct Setup<'a> {
    /// Finds hits in the scene.
    pub intersector: &'a Bvh,
    /// The view of the scene, and its light.
    pub view: LitView<'a>,
    /// The analysis of the scene.
    pub analysis: &'a SceneAnalysis,
    /// The columns of a tally, if there is one.
    pub columns: Option<&'a Columns>,
}

/// A renderer of paths through a hierarchy.
pub type PathJob<'a, S> = Job<'a, Bvh, PathTracer<'a>, S>;

impl<'a> Setup<'a> {
    /// The renderer of a method, which has what was learnt, or learns it
    /// together with other processes.
    pub fn renderer(
        &self,
        sampling: &Sampling,
        learnt: Arc<OnceLock<Learnt>>,
        communicator: &'a dyn Communicator,
    ) -> Box<dyn Renderer + 'a> {
        if let Some(columns) = self.columns {
            return match sampling.method {
                Method::Gather => {
                    let gather =
                        self.gather(sampling, learnt, communicator);
                    Box::new(RowGather(gather))
                }
                _ => Box::new(self.tally(sampling, columns)),
            };
        }
        match sampling.method {
            Method::Reference => Box::new(self.independent(sampling)),
            Method::Sobol => Box::new(self.in_nets(sampling)),
            Method::Gather => {
                Box::new(self.gather(sampling, learnt, communicator))
            }
        }
    }

    /// The gather of a sampling.
    pub fn gather(
        &self,
        sampling: &Sampling,
        learnt: Arc<OnceLock<Learnt>>,
        communicator: &'a dyn Communicator,
    ) -> Gather<'a> {
        Gather {
            norm: sampling.norm,
            view: self.view,
            intersector: self.intersector,
            known_pixels: &self.analysis.known_pixels,
            seed: sampling.seed,
            patches: self.columns.map(|columns| &columns.patches),
            training: sampling.training,
            correction: (!sampling.glance).then(Correction::default),
            learnt,
            communicator,
        }
    }

    /// The pixels of a window of this view.
    pub fn pixels(&self, window: Window) -> Pixels {
        let is_list = matches!(self.view.sensor, Sensor::Receivers(_));
        Pixels { area: window.area() as u64, is_list }
    }

    /// The paths of independent numbers of a sampling.
    pub fn independent(
        &self,
        sampling: &Sampling,
    ) -> PathJob<'a, IndependentSampler> {
        let sampler = IndependentSampler::new(sampling.seed);
        self.job(self.paths(0), sampler)
    }

    /// The paths in nets of a sampling.
    pub fn in_nets(
        &self,
        sampling: &Sampling,
    ) -> PathJob<'a, SobolSampler> {
        let &Sampling { seed, net_size, control, .. } = sampling;
        self.job(self.paths(control), SobolSampler::new(seed, net_size))
    }

    /// The paths in nets of a sampling, sorted into columns.
    fn tally(
        &self,
        &Sampling { seed, net_size, .. }: &Sampling,
        columns: &'a Columns,
    ) -> Job<'a, Bvh, TallyTracer<'a>, SobolSampler> {
        let (paths, bvh) = (self.paths(0), self.intersector);
        let tracer = TallyTracer { paths, columns, bvh };
        self.job(tracer, SobolSampler::new(seed, net_size))
    }

    /// The path tracer, with a control variate in per cent.
    fn paths(&self, control: u64) -> PathTracer<'a> {
        let LitView { surfaces, sky, .. } = self.view;
        let control = control as f64 / 100.;
        PathTracer { control, ..PathTracer::new(surfaces, sky.clone()) }
    }

    /// The renderer of paths.
    fn job<E: Integrator, S: Sampler>(
        &self,
        integrator: E,
        sampler: S,
    ) -> Job<'a, Bvh, E, S> {
        let &Self { intersector, view, analysis, .. } = self;
        let (sensor, known_pixels) = (view.sensor, &analysis.known_pixels);
        Job { sensor, intersector, integrator, known_pixels, sampler }
    }
}
