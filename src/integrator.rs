// Tangled from chapters/integrator.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Random variables whose mean is the radiance along a ray; and what a
//! renderer is, which adds their values to a film.
//!
//! Its bits belong to `SAMPLE_VERSION`.

pub mod gather;
pub mod sunlight;
pub mod tally;

use std::borrow::Cow;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::bvh::Hit;
use crate::error::Result;
use crate::film::{Film, Watch};
use crate::materials::Surfaces;
use crate::sampler::{Sampler, cosine_direction, dimension};
use crate::scene::Ray;
use crate::sky::Sky;

/// What a path does at the end of a ray.
#[derive(Clone, Copy, Debug)]
pub enum PathEvent {
    /// It goes on along another ray, which leaves this triangle.
    Scatter(Ray, u32),
    /// It ends, and this is its contribution to the pixel.
    Terminate(f64),
}

/// A random variable whose mean is the radiance along a ray.
pub trait Integrator: Sync {
    /// The state of a path between two hits.
    type Path;

    /// Begins a path whose first ray has this direction, and from whose end
    /// this part of the light reaches the image.
    fn begin(&self, direction: DVec3, throughput: f64) -> Self::Path;

    /// The surfaces; first rays look through their panes.
    fn surfaces(&self) -> Surfaces<'_> {
        Surfaces::of(1.)
    }

    /// Whether nothing reflects, so that it does not matter where a path
    /// that has left a first surface meets another.
    fn is_black(&self) -> bool {
        false
    }

    /// Whether it does not matter where a path that has left a first surface
    /// meets another, but only which one.
    fn needs_only_surfaces(&self) -> bool {
        false
    }

    /// Continues a path from the end of its ray: a hit, or the sky.
    fn advance(
        &self,
        path: &mut Self::Path,
        hit: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent;

    /// The part of a contribution that the first surface reflects of the sun.
    fn direct(&self, _path: &Self::Path) -> f64 {
        0.
    }

    /// The parts of the rows of a tally, among which replicates are divided
    /// in turn, and the columns of each; no part without a tally.
    fn row_parts(&self) -> (u64, u32) {
        (0, 0)
    }

    /// The column of a tally to which a path that has ended belongs, and its
    /// weight there, if it has one. It has ended at this hit, or in the sky,
    /// with this contribution.
    #[inline(always)]
    fn tally(
        &self,
        _path: &Self::Path,
        _hit: Option<&Hit>,
        _contribution: f64,
    ) -> Option<(u32, f64)> {
        None
    }
}

/// Something that adds samples to a film: by paths
/// ([`Job`](crate::render::Job)), or by gathering ([`gather::Gather`]).
pub trait Renderer {
    /// Continues each tile of `film` from its own samples to `end` samples
    /// of each pixel, or to the next whole number of replicates, unless
    /// `watch` stops it; returns the number of rays traced. A renderer
    /// that learns has one film, and makes all its samples.
    fn pass(&mut self, film: &mut Film, end: u64, watch: &Watch) -> u64;

    /// Learns what it needs before the first pass over `film`, unless
    /// `watch`, to which it reports the rays traced so far, stops it;
    /// returns the number of all these rays.
    fn learn(&mut self, _film: &mut Film, _watch: &Watch) -> u64 {
        0
    }

    /// Roughly how many rays it will learn from, for a film of this many
    /// pixels.
    fn training_rays(&self, _area: u64) -> u64 {
        0
    }

    /// What each rank has done so far; empty if there is one process.
    fn shares(&self) -> &[RankStats] {
        &[]
    }

    /// The fewest seconds that a pass should take, given what it costs.
    fn least_seconds(&self) -> f64 {
        0.
    }
}

/// What one rank of a run has done.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RankStats {
    /// Paths, that is samples of single pixels.
    pub paths: u64,
    /// Seconds in which it rendered.
    pub render_seconds: f64,
    /// Seconds of its passes in which it did not render.
    pub wait_seconds: f64,
    /// Seconds of computing, summed over all its threads.
    pub processor_seconds: f64,
    /// Bytes of the sums that it has sent to rank 0.
    pub sent_bytes: u64,
    /// Seconds in which rank 0 has received such sums and added them.
    pub collect_seconds: f64,
}

/// The processes that learn together, each doing a part of the work.
pub trait Communicator: Sync {
    /// The rank of this process, and the number of processes.
    fn rank_and_size(&self) -> (usize, usize) {
        (0, 1)
    }

    /// Sends bytes to the other processes; returns the bytes of all, in
    /// the order of their ranks. All processes must call it alike. It
    /// polls `watch` while it waits, but waits on whatever that returns.
    fn all_gather<'a>(
        &self,
        bytes: &'a [u8],
        _watch: &Watch,
    ) -> Cow<'a, [u8]> {
        bytes.into()
    }

    /// Returns the bytes of the first process to all. All must call it
    /// alike.
    ///
    /// # Errors
    /// The first process has ended.
    fn broadcast(&self, own: Vec<u8>) -> Result<Vec<u8>> {
        Ok(own)
    }
}

/// One process.
pub struct SingleProcess;

impl Communicator for SingleProcess {}

/// Follows one path, weakened by the albedo at each bounce until its
/// throughput is below `ROULETTE_THRESHOLD`; then the albedo is the
/// probability that it goes on. From `MANY_BOUNCES` bounces on it may also
/// end.
#[derive(Clone, Debug)]
pub struct PathTracer<'a> {
    /// What the surfaces reflect.
    pub surfaces: Surfaces<'a>,
    /// The only light.
    pub sky: Sky,
    /// How much of the sky above the first reflection is subtracted as a
    /// control variate (Owen 2013, section 8.9), in [0, 1].
    pub control: f64,
}

/// The throughput below which roulette decides. It is the same in the path
/// tracer on Embree with which ours is compared, so that paths are as long.
pub const ROULETTE_THRESHOLD: f64 = 0.1;

/// Bounces after which a path may end by chance, rare in ordinary scenes.
pub const MANY_BOUNCES: u64 = 1000;

impl<'a> PathTracer<'a> {
    /// A path tracer without a control variate.
    pub fn new(surfaces: Surfaces<'a>, sky: Sky) -> Self {
        Self { surfaces, sky, control: 0. }
    }

    /// What a surface reflects of the sky if nothing is in the way, minus
    /// what it reflects from this direction: the mean is zero.
    #[inline(always)]
    pub fn control_variate(&self, hit: &Hit, direction: DVec3) -> f64 {
        let Self { surfaces, sky, .. } = self;
        let albedo = surfaces.albedo(hit.primitive);
        albedo
            * (sky.irradiance_ratio(hit.normal)
                - sky.even_radiance(direction))
    }
}

/// A path of the path tracer.
#[derive(Clone, Copy, Debug, Default)]
pub struct PathState {
    /// The part of the radiance along the ray that reaches the image.
    pub throughput: f64,
    /// The number of bounces so far.
    pub bounces: u64,
    /// The direction in which it has left the last surface.
    pub direction: DVec3,
    /// What the control variate adds to its contribution.
    pub variate: f64,
    /// What the sun has added to its contribution.
    pub sunlight: f64,
    /// The part of that which the first surface has reflected.
    pub direct: f64,
    /// Where it has met its last pane.
    pub pane: DVec3,
    /// The shadow ray that is under way, if one is.
    pub shadow: Option<Shadow>,
}

impl PathState {
    /// The ray behind the pane that the path has met, if it is one.
    #[cold]
    #[inline(never)]
    fn pass_pane(&mut self, surfaces: &Surfaces, hit: &Hit) -> Option<Ray> {
        self.throughput *= surfaces.pane(hit, self.direction)?;
        Some(surfaces.behind(hit, self.direction, &mut self.pane))
    }

    /// The path ends, with this light from its last ray.
    fn end(&self, light: f64) -> PathEvent {
        PathEvent::Terminate(light + self.variate + self.sunlight)
    }
}

/// The probability that a path of `n` bounces makes another one,
/// [n/(n+1)]^(3/2). A path of `MANY_BOUNCES` then makes n or more with
/// probability (`MANY_BOUNCES`/n)^(3/2).
#[cold]
#[inline(never)]
pub(crate) fn survival(n: u64) -> f64 {
    let ratio = n as f64 / (n + 1) as f64;
    ratio * ratio.sqrt()
}

impl Integrator for PathTracer<'_> {
    type Path = PathState;

    fn is_black(&self) -> bool {
        self.surfaces.most == 0. && !self.surfaces.transmits
    }

    #[inline(always)]
    fn begin(&self, direction: DVec3, throughput: f64) -> PathState {
        PathState { throughput, direction, ..PathState::default() }
    }

    fn surfaces(&self) -> Surfaces<'_> {
        self.surfaces
    }

    #[inline(always)]
    fn direct(&self, path: &PathState) -> f64 {
        if self.sky.beam.is_some() { path.direct } else { 0. }
    }

    #[inline(always)]
    fn advance(
        &self,
        path: &mut PathState,
        hit: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        if let Some(shadow) = path.shadow {
            let (ray, from) = shadow.end(path, &self.surfaces, hit);
            return PathEvent::Scatter(ray, from);
        }
        let Some(hit) = hit else {
            let radiance = match path.bounces {
                0 => self.sky.seen(path.direction),
                _ => self.sky.dim_radiance(path.direction),
            };
            return path.end(path.throughput * radiance);
        };
        // Go on through a pane
        if self.surfaces.transmits
            && let Some(ray) = path.pass_pane(&self.surfaces, &hit)
        {
            return PathEvent::Scatter(ray, hit.primitive);
        }
        let albedo = self.surfaces.albedo(hit.primitive);
        // End a path where nothing is reflected
        if albedo == 0. {
            return path.end(0.);
        }
        // Weaken the path or play roulette
        if path.throughput < ROULETTE_THRESHOLD {
            let u = sampler.get_1d(dimension::roulette(path.bounces));
            if u >= albedo {
                return path.end(0.);
            }
        } else {
            path.throughput *= albedo;
            if path.bounces >= MANY_BOUNCES {
                // End a long path or strengthen it
                let probability = survival(path.bounces);
                let u = sampler.get_1d(dimension::roulette(path.bounces));
                if u >= probability {
                    return path.end(0.);
                }
                path.throughput /= probability;
            }
        }
        // Leave the surface in a random direction
        let bounce = path.bounces;
        let [r, turn] = sampler.get_2d(dimension::direction(bounce));
        let (normal, r) = self.surfaces.lit_normal(&hit, r);
        path.direction = cosine_direction(normal, r, turn);
        if path.bounces == 0 && self.control > 0. {
            let side = Hit { normal, ..hit };
            let variate = self.control_variate(&side, path.direction);
            path.variate = self.control * variate;
        }
        path.bounces += 1;
        let mut direction = path.direction;
        // Look for the sun first
        if self.sky.has_sun() {
            let u = sampler.get_2d(dimension::sun(bounce));
            let sun = self.sky.sample_sun(normal, u);
            direction = path.look_for_sun(sun, &hit);
        }
        PathEvent::Scatter(
            Ray { origin: hit.point, direction },
            hit.primitive,
        )
    }
}

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
    /// Sends a shadow ray from a hit to a point of the sun, which gives this
    /// irradiance, or goes on; returns the direction.
    #[cold]
    #[inline(never)]
    pub fn look_for_sun(
        &mut self,
        (direction, irradiance): (DVec3, f64),
        &Hit { point: origin, primitive: from, .. }: &Hit,
    ) -> DVec3 {
        let ray = Ray { origin, direction: self.direction };
        let light = self.throughput * irradiance;
        if light == 0. {
            return self.direction;
        }
        self.shadow = Some(Shadow { direction, light, next: (ray, from) });
        direction
    }
}

impl Shadow {
    /// Handles what a shadow ray of a path has met, or lets the ray go on
    /// through a pane; returns the next ray, and the triangle that it leaves.
    #[cold]
    #[inline(never)]
    pub fn end(
        self,
        path: &mut PathState,
        surfaces: &Surfaces,
        hit: Option<Hit>,
    ) -> (Ray, u32) {
        let Self { direction, light, next: (ray, from) } = self;
        if let Some(hit) = hit
            && let Some(part) = surfaces.pane(&hit, direction)
        {
            path.shadow = Some(Self { light: light * part, ..self });
            let ray = surfaces.behind(&hit, direction, &mut path.pane);
            return (ray, hit.primitive);
        }
        if hit.is_none() {
            path.sunlight += light;
            path.direct += if path.bounces == 1 { light } else { 0. };
        }
        path.shadow = None;
        (ray, from)
    }
}

/// Must change whenever the code that decides what a sample is changes.
const SAMPLE_VERSION: u32 = 5;

/// The names of the integrators, their constants and the version of their
/// samples: samples of different identities must not be mixed.
pub fn identity() -> String {
    format!(
        "samples {SAMPLE_VERSION}, path tracer with \
         roulette below {ROULETTE_THRESHOLD} and from {MANY_BOUNCES} bounces"
    )
}
