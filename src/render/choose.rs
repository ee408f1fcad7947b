// Tangled from chapters/choice.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Chooses how samples are made: the method, and how many are placed
//! together. How many are made in all, limits decide in `render_loop`.

use std::sync::{Arc, OnceLock};
use std::time::Instant;
use std::{array, fmt};

use bytemuck::{Pod, Zeroable, cast};
use rand::RngExt;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Job, Renderer};
use crate::analysis::background::TileContent;
use crate::analysis::{LitView, SceneAnalysis};
use crate::bvh::{Bvh, Dispatch, Intersector};
use crate::error::{Error, Result};
use crate::film::{Film, Measure, Window};
use crate::integrator::gather::training::PILOT_SAMPLES;
use crate::integrator::gather::{Correction, Gather, Learnt};
use crate::integrator::{Integrator, PathEvent, PathTracer};
use crate::integrator::{Together, identity};
use crate::numerics::power_of_two;
use crate::sampler::sobol::SobolSampler;
use crate::sampler::{IndependentSampler, Sampler, generator, within};
use crate::sensor::Sensor;

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
        out.write_str(&format!("{self:?}").to_lowercase())
    }
}

/// The method that is asked for; none if a pilot is to choose one.
pub type Wanted = Option<Method>;

/// Reads the name of a method, or `auto`.
///
/// # Errors
/// There is no method of this name.
pub fn parse_method(name: &str) -> Result<Wanted> {
    let mut all = Method::ALL.into_iter();
    match all.find(|method| method.to_string() == name) {
        None if name != "auto" => {
            let syntax = "expected auto, reference, sobol or gather";
            Err(Error::value("method", name, syntax))
        }
        method => Ok(method),
    }
}

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
    /// Of paths in nets, [`PathTracer::control`] in per cent.
    #[serde(rename = "sky_control")]
    pub control: u64,
    /// Of a gather, the error for which its samples are distributed.
    #[serde(default, skip_serializing_if = "Measure::is_usual")]
    pub measure: Measure,
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
    /// Those of an image of this width and height.
    pub fn of_image((width, height): (u32, u32)) -> Self {
        Self { area: u64::from(width) * u64::from(height), is_list: false }
    }
}

impl Sampling {
    /// For `samples` of each pixel of a film, if that is known, in at least 16
    /// replicates; of a net 4 in an image, whose pixels borrow from their
    /// neighbours.
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
        let (replicate, training) = match method {
            Method::Reference => (1, 0),
            Method::Sobol => (together(least, most), 0),
            Method::Gather => (together(16, gathered), trained),
        };
        let (control, measure) = (0, Measure::default());
        Self { method, seed, replicate, training, control, measure }
    }

    /// The same film, which has no sample, for these samples.
    pub fn film(&self, film: Film) -> Film {
        let film = film.with_replicates(self.replicate);
        match self.method {
            Method::Gather => film.with_shared_tiles(),
            _ => film,
        }
    }

    /// Names the code that decides the samples: those of different names are
    /// not to be mixed.
    pub fn identity(&self) -> String {
        match self.method {
            Method::Gather => format!("gather {GATHER_VERSION}"),
            _ => identity(),
        }
    }
}

/// Rays of a gather with its part of the correction, about.
const GATHER_RAYS: u64 = 5;

/// Rays of a training that are best for as many rays of samples, about.
const BEST_TRAINING: f64 = power_of_two(21);

/// Changes whenever the code that decides what a gather is does.
const GATHER_VERSION: u32 = 6;

/// A scene that is ready to be rendered.
pub struct Setup<'a> {
    /// Finds hits in the scene.
    pub intersector: &'a Bvh,
    /// The view of the scene, and its light.
    pub view: &'a LitView<'a>,
    /// What was found.
    pub analysis: &'a SceneAnalysis,
}

impl<'a> Setup<'a> {
    /// The renderer of a method, which knows what was learnt, or learns it
    /// together with other processes.
    pub fn renderer(
        &self,
        sampling: &Sampling,
        learnt: Arc<OnceLock<Learnt>>,
        together: &'a dyn Together,
    ) -> Box<dyn Renderer + 'a> {
        let &Self { intersector, view, analysis } = self;
        let &Sampling { seed, replicate, training, .. } = sampling;
        let mut paths = PathTracer::new(view.surfaces, view.sky);
        match sampling.method {
            Method::Reference => {
                self.job(paths, IndependentSampler::new(seed))
            }
            Method::Sobol => {
                paths.control = sampling.control as f64 / 100.;
                self.job(paths, SobolSampler::new(seed, replicate))
            }
            Method::Gather => Box::new(Gather {
                measure: sampling.measure,
                view: *view,
                intersector,
                known: &analysis.known,
                seed,
                training,
                correction: Some(Correction::default()),
                learnt,
                together,
            }),
        }
    }

    /// The pixels of a window of this view.
    fn pixels(&self, window: Window) -> Pixels {
        let is_list = matches!(self.view.sensor, Sensor::Receivers(_));
        Pixels { area: window.area() as u64, is_list }
    }

    /// The renderer of paths.
    fn job(
        &self,
        integrator: PathTracer<'a>,
        sampler: impl Sampler + 'a,
    ) -> Box<dyn Renderer + 'a> {
        Box::new(Job {
            sensor: self.view.sensor,
            intersector: self.intersector,
            integrator,
            known: &self.analysis.known,
            sampler,
        })
    }

    /// Chooses how the samples of a request are made, or as many as have the
    /// error that was asked for, by the method that is wanted or by any; none
    /// if these are too few for a pilot. A method that could not give each
    /// pixel a sample in the time that is left is not chosen, even if it is
    /// wanted.
    pub fn choose(&self, request: &Request) -> Option<Choice> {
        let (area, samples) = (request.area(), request.bound());
        let paths = samples.unwrap_or(MANY).saturating_mul(area);
        let pixels = (paths / 200).min(4096);
        if pixels < 64 {
            return None;
        }
        let trial = Trial { setup: self, window: request.window, pixels };
        let began = Instant::now();
        let pilot = self.intersector.dispatch(trial);
        let pace = began.elapsed().as_secs_f64() / (4 * pixels) as f64;
        // Foresee the costs of all methods
        let &Request { seed, error, .. } = request;
        let albedo = self.view.surfaces.typical;
        let pixels = self.pixels(request.window);
        let forecast = Forecast { pilot, albedo, pixels };
        let percent = (100. * pilot.control()).round() as u64;
        let allowed = error.map(|error| forecast.allowed(error));
        let methods = Method::ALL.map(|method| {
            let enough =
                allowed.map(|square| forecast.needed(method, square));
            let samples = samples.into_iter().chain(enough).min();
            let mut sampling = Sampling::new(method, seed, samples, pixels);
            match (method, error) {
                (Method::Gather, Some((_, measure))) => {
                    sampling.measure = measure
                }
                (Method::Sobol, _) => sampling.control = percent,
                _ => (),
            }
            let expected = samples.unwrap_or(MANY) as f64;
            let [variance, rays] = forecast.foresee(&sampling, expected);
            (sampling, variance.max(2. * allowed.unwrap_or(0.)) * rays)
        });
        // Choose among the methods that there is time for
        let is_quick = |sampling: &Sampling| {
            let paths = forecast.first_paths(sampling);
            sampling.method == Method::Reference
                || request.left.is_none_or(|left| 2. * paths * pace <= left)
        };
        let is_black = self.view.surfaces.most == 0.;
        let learns = !is_black || request.method == Some(Method::Gather);
        let is_fit = |s: &Sampling| {
            is_quick(s) && (learns || s.method != Method::Gather)
        };
        let quick = methods.iter().filter(|(s, _)| is_fit(s));
        let best = |wanted: Wanted| {
            let fits = |s: &Sampling| wanted.is_none_or(|m| m == s.method);
            let those = quick.clone().filter(|(s, _)| fits(s));
            those.min_by(|s, t| s.1.total_cmp(&t.1))
        };
        let &(sampling, _) = best(request.method).or_else(|| best(None))?;
        // Foresee the gains of all methods
        let reference = methods[0].1;
        let gain = |cost: f64| match reference > 0. {
            true => reference / cost.max(1e-3 * reference),
            false => 1.,
        };
        let gains = methods.map(|(s, cost)| (s.method, gain(cost)));
        Some(Choice { pilot, sampling, gains })
    }

    /// How the samples are made: as in a checkpoint, if there is one. And what
    /// a pilot has found, if it has chosen.
    pub fn decide(
        &self,
        request: &Request,
        saved: Option<Sampling>,
    ) -> (Sampling, Option<Choice>) {
        let known =
            self.analysis.known.is_all().then_some(Method::Reference);
        let begun = saved.map(|saved| saved.method);
        let wanted = request.method.or(begun).or(known);
        // Say whether a pilot is needed
        let asks = match wanted {
            None => true,
            Some(Method::Reference) => false,
            Some(Method::Sobol) => begun.is_none(),
            Some(Method::Gather) => {
                begun.is_none() && request.left.is_some()
                    || request.error.is_some()
            }
        };
        let request = Request { method: wanted, ..*request };
        if let Some(choice) = asks.then(|| self.choose(&request)).flatten()
        {
            return (choice.sampling, Some(choice));
        }
        let pixels = self.pixels(request.window);
        let is_list = pixels.is_list;
        let usual = if is_list { Method::Sobol } else { Method::Reference };
        let method = wanted.unwrap_or(usual);
        let (seed, samples) = (request.seed, request.bound());
        let new = Sampling::new(method, seed, samples, pixels);
        let kept = |saved| Sampling { method, seed, ..saved };
        (saved.map_or(new, kept), None)
    }
}

/// What a few paths tell of those of an image: means over its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Pilot {
    /// The square of the radiance of a pixel.
    pub square: f64,
    /// The variance of a path that comes from its point in the pixel and
    /// its first direction.
    pub first: f64,
    /// The variance that comes from all later decisions.
    pub later: f64,
    /// The variance of the control variate of a path.
    pub sky_variance: f64,
    /// The covariance of the control variate with the contribution.
    pub covariance: f64,
    /// The rays of a path; none if it meets no surface.
    pub rays: f64,
    /// Those of them up to the second surface.
    pub first_rays: f64,
    /// The share of paths that go on from a second surface.
    pub indirect: f64,
}

/// A pilot that waits for its intersector.
struct Trial<'a> {
    setup: &'a Setup<'a>,
    /// The part of the image that is rendered.
    window: Window,
    /// Pixels that are drawn.
    pixels: u64,
}

impl Dispatch for Trial<'_> {
    type Output = Pilot;

    fn with<K: Intersector>(self, intersector: &K) -> Pilot {
        let pixels = (0..self.pixels).into_par_iter();
        let pixels = pixels.map(|n| self.pixel(intersector, n));
        let pixels: Vec<[f64; 8]> = pixels.map(cast).collect();
        let mean = |term: usize| {
            let sum: f64 = pixels.iter().map(|pixel| pixel[term]).sum();
            sum / pixels.len() as f64
        };
        let mean: Pilot = cast(array::from_fn::<f64, 8, _>(mean));
        Pilot { first: mean.first.max(0.), ..mean }
    }
}

/// Numbers the generators of the pilot.
const PILOT: u64 = u64::MAX - 1;

impl Trial<'_> {
    /// The terms that one pixel adds to the means.
    fn pixel<K: Intersector>(&self, intersector: &K, n: u64) -> Pilot {
        let mut random = generator(0, PILOT, n);
        let Window { corner: (left, top), size } = self.window;
        let x = left + random.random_range(0..size.0);
        let y = top + random.random_range(0..size.1);
        let known = &self.setup.analysis.known;
        if known.content((x, y)) != TileContent::Scene {
            return Pilot::default();
        }
        let twins = |n| self.twins(intersector, (x, y), n);
        let [[a, b], [c, d]] = [2 * n, 2 * n + 1].map(twins);
        let all = [a, b, c, d];
        if all.iter().all(|path| path.rays == 0) {
            return Pilot::default();
        }
        // Compare the four paths of a pixel
        let apart = |p: &[Path], q: &[Path]| {
            let pairs =
                p.iter().flat_map(|p| q.iter().map(move |q| (p, q)));
            let squares = pairs.map(|(p, q)| (p.value - q.value).powi(2));
            squares.sum::<f64>() / (2 * p.len() * q.len()) as f64
        };
        let mean =
            |part: fn(&Path) -> f64| all.iter().map(part).sum::<f64>() / 4.;
        let later = (apart(&[a], &[b]) + apart(&[c], &[d])) / 2.;
        let (one, other) = (a.value + b.value, c.value + d.value);
        let variate = a.variate - c.variate;
        Pilot {
            square: one * other / 4.,
            first: apart(&[a, b], &[c, d]) - later,
            later,
            sky_variance: 0.5 * variate * variate,
            covariance: 0.25 * (one - c.value - d.value) * variate,
            rays: mean(|path| path.rays as f64),
            first_rays: mean(|path| path.rays.min(2) as f64),
            indirect: mean(|path| f64::from(path.rays > 2)),
        }
    }

    /// Two paths that share their point in a pixel and their first
    /// direction.
    fn twins<K: Intersector>(
        &self,
        intersector: &K,
        (x, y): (u32, u32),
        n: u64,
    ) -> [Path; 2] {
        let &LitView { sensor, sky, surfaces, resolution } =
            self.setup.view;
        let integrator = PathTracer::new(surfaces, sky);
        let number = |k| IndependentSampler::new(PILOT).start(n, k);
        let mut sampler = number(0);
        let [u, v] = sampler.get_pixel_2d();
        let at = (within(x, resolution.0, u), within(y, resolution.1, v));
        let (direction, _, hit) = sensor.start(intersector, at.0, at.1);
        // Reflect at the first surface
        let mut path = integrator.begin(direction);
        let event = integrator.advance(&mut path, hit, &mut sampler);
        let variate = match (hit, event) {
            (Some(hit), PathEvent::Scatter(ray, _)) => {
                integrator.control_variate(&hit, ray.direction)
            }
            _ => 0.,
        };
        // Go on twice from the first surface
        [1, 2].map(|k| {
            let (mut path, mut event, mut sampler) =
                (path, event, number(k));
            let mut rays = u64::from(hit.is_some());
            loop {
                let (ray, from) = match event {
                    PathEvent::Terminate(value) => {
                        return Path { value, rays, variate };
                    }
                    PathEvent::Scatter(ray, from) => (ray, from),
                };
                rays += 1;
                let hit = intersector.first_hit(&ray, Some(from));
                event = integrator.advance(&mut path, hit, &mut sampler);
            }
        })
    }
}

/// A path that has ended.
#[derive(Clone, Copy)]
struct Path {
    value: f64,
    rays: u64,
    /// The control variate of its first reflection.
    variate: f64,
}

impl Pilot {
    /// How much of the sky a control variate best subtracts, in [0, 1].
    pub fn control(&self) -> f64 {
        let Self { covariance, sky_variance, .. } = self;
        let best = (-covariance / sky_variance).clamp(0., 1.);
        if *sky_variance > 0. { best } else { 0. }
    }

    /// What it leaves of the variance of the first direction.
    fn controlled(&self) -> f64 {
        let control = self.control();
        let change = 2. * control * self.covariance
            + control * control * self.sky_variance;
        (self.first + change).max(0.)
    }
}

/// What a pilot foresees of the images of a window.
struct Forecast {
    pilot: Pilot,
    /// A typical albedo of the surfaces.
    albedo: f64,
    pixels: Pixels,
}

impl Forecast {
    /// The number of pixels.
    fn area(&self) -> f64 {
        self.pixels.area as f64
    }

    /// The variance of a sample and its rays, these in units of the rays of
    /// paths, for `samples` of each pixel. The constants are fits to measured
    /// images.
    fn foresee(&self, sampling: &Sampling, samples: f64) -> [f64; 2] {
        let Pilot { square, first, later, rays, .. } = self.pilot;
        match sampling.method {
            Method::Reference => [first + later, rays],
            Method::Sobol => {
                let net = libm::pow(sampling.replicate as f64, -0.4);
                [self.pilot.controlled() * net + later, 1.05 * rays]
            }
            Method::Gather => {
                // Foresee the variance and the rays of a gather
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

    /// The rays of a sample with its part of the corrections.
    fn gathering(&self, sampling: &Sampling) -> f64 {
        let further = 4.7 * self.albedo * self.pilot.indirect;
        let more = 0.5 / sampling.replicate as f64;
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

    /// The samples of each pixel of a window after which the image has an error,
    /// up to a fifth too many, and two at least: one has no error yet.
    fn needed(&self, method: Method, square: f64) -> u64 {
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
    /// worst pixel is taken for three times that of all.
    fn allowed(&self, (error, of): (f64, Measure)) -> f64 {
        let whole = if of.relative { self.pilot.square } else { 1. };
        let part = if of.largest { 1. / 9. } else { 1. };
        error * error * whole * part
    }

    /// The work before each pixel has a sample, in paths.
    fn first_paths(&self, sampling: &Sampling) -> f64 {
        let first = self.area() * sampling.replicate as f64;
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

/// What a gather leaves of the variance of receivers, which have no pixel
/// that only chance samples, beside that of pixels.
const RECEIVED: f64 = 1. / 12.;

/// The pixels of the images to which the constants of a gather are fitted.
const FITTED_AREA: f64 = 320. * 240.;

/// What a pilot has found, and what follows.
pub struct Choice {
    /// What a few paths tell.
    pub pilot: Pilot,
    /// How samples are to be made.
    pub sampling: Sampling,
    /// Of each method, the time of the reference over its own, for the same
    /// error.
    pub gains: [(Method, f64); 3],
}

impl fmt::Display for Choice {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let Pilot { first, later, first_rays, .. } = self.pilot;
        let rays = 2. * self.pilot.rays / first_rays.max(1e-9);
        let share = 100. * later / (first + later).max(f64::MIN_POSITIVE);
        write!(
            out,
            "{}: a path has {rays:.1} rays, and {share:.0} % of its variance \
             comes after its first direction; foreseen gains",
            self.sampling.method
        )?;
        for (method, gain) in &self.gains {
            write!(out, ", {method} {gain:.1}")?;
        }
        Ok(())
    }
}

/// What is asked of a run.
pub struct Request {
    /// The method that is wanted; none if a pilot is to choose.
    pub method: Option<Method>,
    /// Chooses all random numbers.
    pub seed: u64,
    /// The part of the image that is rendered.
    pub window: Window,
    /// Samples of each pixel.
    pub samples: Option<u64>,
    /// The error of the image, and which one.
    pub error: Option<(f64, Measure)>,
    /// Seconds of the run.
    pub time: Option<f64>,
    /// Seconds that are left of them.
    pub left: Option<f64>,
}

impl Request {
    /// The number of pixels.
    fn area(&self) -> u64 {
        self.window.area() as u64
    }

    /// Samples of each pixel at most. A limit of time counts as those that one
    /// thread with a quarter of `RATE` gathers: the same on each machine.
    fn bound(&self) -> Option<u64> {
        let rate = 0.25 * RATE / GATHER_RAYS as f64;
        let timed =
            |time: f64| (time * rate / self.area() as f64).ceil() as u64;
        let timed = self.time.map(timed);
        self.samples.into_iter().chain(timed).min()
    }
}

/// Samples of a run without a limit.
const MANY: u64 = 1 << 20;

/// A guess of how many rays are traced for so many paths, in so many
/// seconds, from within the box around a scene or from outside.
pub fn expected_rays(
    (is_outside, albedo): (bool, f64),
    paths: Option<f64>,
    time: Option<f64>,
) -> f64 {
    let inside = (1. / (1. - albedo)).min(10.);
    let each = if is_outside { 1. + albedo } else { inside };
    let time = time.or(paths.is_none().then_some(60.));
    let rate = RATE * rayon::current_num_threads() as f64;
    let timed = time.map_or(f64::INFINITY, |time| time * rate);
    paths.map_or(timed, |paths| timed.min(paths * each))
}

/// Rays per second that a thread is guessed to trace.
const RATE: f64 = 4e6;
