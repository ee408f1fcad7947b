// Tangled from chapters/choice.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Chooses the method of a request and the limits of a run, which the
//! render loop applies.

use std::fmt;
use std::time::{Duration, Instant};

use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::cost::{Forecast, MANY, SHOWN};
use super::pilot::{Pilot, Trial};
use super::sampling::{GATHER_RAYS, Method, Sampling, Setup};
use crate::analysis::{LitView, SceneAnalysis};
use crate::bvh::Intersector as _;
use crate::film::{ErrorNorm, Window};
use crate::integrator::gather::guide::direction;
use crate::sampler::generator;
use crate::scene::Ray;
use crate::sensor::Sensor;
use crate::tally::{Columns, REPLICATES};

impl Setup<'_> {
    /// Chooses how the samples of a request are made, by the method that is
    /// wanted or by any; none if the samples are too few for a pilot. A limit
    /// of error counts as the samples that reach it. A method that could not
    /// give each pixel a sample in the time that remains is not chosen, even
    /// if it is wanted.
    pub fn choose(&self, request: &Request) -> Option<Choice> {
        let (area, samples) = (request.area(), request.bound());
        let least = if request.shows { SHOWN } else { 1 };
        let paths = samples.unwrap_or(MANY).max(least).saturating_mul(area);
        let pixels = (paths / 200).min(4096);
        if pixels < 64 {
            return None;
        }
        let trial = Trial { setup: self, window: request.window, pixels };
        let began = Instant::now();
        let pilot = self.intersector.dispatch(trial);
        let pace = began.elapsed().as_secs_f64() / (4 * pixels) as f64;
        // Predict the costs of all methods
        let &Request { seed, budget: Budget { error, .. }, .. } = request;
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
                (Method::Gather, Some((_, norm))) => sampling.norm = norm,
                (Method::Sobol, _) => sampling.control = percent,
                _ => (),
            }
            let expected = samples.unwrap_or(MANY).max(least) as f64;
            let [variance, rays] = forecast.foresee(&sampling, expected);
            (sampling, variance.max(2. * allowed.unwrap_or(0.)) * rays)
        });
        // Choose among the methods that there is time for
        let is_quick = |sampling: &Sampling| {
            let paths = forecast.first_paths(sampling);
            sampling.method == Method::Reference
                || request.shows
                || request.left.is_none_or(|left| 2. * paths * pace <= left)
        };
        let is_black = self.view.surfaces.most == 0.;
        let learns = !is_black || request.method == Some(Method::Gather);
        let is_fit = |s: &Sampling| {
            is_quick(s) && (learns || s.method != Method::Gather)
        };
        let quick = methods.iter().filter(|(s, _)| is_fit(s));
        let best = |wanted: Option<Method>| {
            let fits = |s: &Sampling| wanted.is_none_or(|m| m == s.method);
            let those = quick.clone().filter(|(s, _)| fits(s));
            those.min_by(|s, t| s.1.total_cmp(&t.1))
        };
        let &(mut sampling, _) =
            best(request.method).or_else(|| best(None))?;
        if request.shows {
            // Shorten the work of a picture
            let area = request.area();
            let few = Sampling { net_size: 8, ..sampling };
            let seconds = 3. * forecast.first_paths(&few) * pace;
            let is_short = request.left.is_some_and(|left| left < seconds)
                || request.budget.samples.is_some_and(|n| n < 4);
            if is_short {
                let rate = forecast.pilot.rays / (3. * pace);
                let rays = request.left.map_or(2e6, |left| left * rate);
                sampling = sampling.glance(rays, area);
            } else {
                let most = ((1 << 22) / area).max(4).ilog2();
                let bits = match (sampling.method, request.budget.samples) {
                    (Method::Sobol, Some(n)) => {
                        n.trailing_zeros().min((n / 2).ilog2())
                    }
                    (Method::Sobol, None) => 2,
                    _ => 0,
                };
                let least = 1 << bits.min(2);
                sampling.net_size =
                    sampling.net_size.clamp(least, 1 << most);
            }
        }
        // Compute the gains of all methods
        let reference = methods[0].1;
        let gain = |cost: f64| match reference > 0. {
            true => reference / cost.max(1e-3 * reference),
            false => 1.,
        };
        let gains = methods.map(|(s, cost)| (s.method, gain(cost)));
        Some(Choice { pilot, sampling, gains })
    }

    /// How the samples are made: as in a checkpoint, if there is one. The
    /// second value is the choice, if a pilot has made it.
    pub fn decide(
        &self,
        request: &Request,
        saved: Option<Sampling>,
    ) -> (Sampling, Option<Choice>) {
        if let Some(columns) = self.columns {
            return (self.decide_rows(request, saved, columns), None);
        }
        let is_known = self.analysis.known_pixels.is_all();
        let only = is_known.then_some(Method::Reference);
        let begun = saved.map(|saved| saved.method);
        let wanted = request.method.or(begun).or(only);
        // Decide whether a pilot is needed
        let asks = match wanted {
            None => true,
            Some(Method::Reference) => false,
            Some(Method::Sobol) => begun.is_none(),
            Some(Method::Gather) => {
                begun.is_none() && (request.left.is_some() || request.shows)
                    || request.budget.error.is_some()
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

    /// How the samples of a tally are made: as in a checkpoint, if there is one,
    /// but by the method that is wanted. Rows are gathered where that gains.
    fn decide_rows(
        &self,
        request: &Request,
        saved: Option<Sampling>,
        columns: &Columns,
    ) -> Sampling {
        let &Request { seed, budget, method: wanted, .. } = request;
        if let Some(saved) = saved {
            let method = wanted.unwrap_or(saved.method);
            return Sampling { method, ..saved };
        }
        let (samples, error) = (request.bound(), budget.error);
        let pixels = self.pixels(request.window);
        let new = |method| {
            Sampling::of_tally(method, seed, samples, error, pixels)
        };
        let nets = new(Method::Sobol);
        let paths =
            (nets.net_size * REPLICATES).saturating_mul(pixels.area);
        let entries = pixels.area.saturating_mul(columns.count.into());
        let gains = paths >= MANY_PATHS
            && entries <= MOST_ENTRIES
            && columns.tally.can_gather()
            && self.view.surfaces.most > 0.
            && self.openness() < OPEN;
        match wanted {
            Some(Method::Gather) => new(Method::Gather),
            None if gains => new(Method::Gather),
            _ => nets,
        }
    }

    /// The part of the cosine-weighted directions in which receivers see no
    /// surface, roughly.
    fn openness(&self) -> f64 {
        let LitView { sensor, surfaces, .. } = &self.view;
        let Sensor::Receivers(receivers) = sensor else { return 1. };
        let count = receivers.numbers.len();
        let mut random = generator(0, 0, 0);
        let mut is_open = || {
            let at = random.random_range(0..count);
            let x = receivers.hit(at, random.random());
            let direction = direction(x.normal, random.random());
            let ray = Ray { origin: x.point, direction };
            let hit = self.intersector.first_hit(&ray, Some(x.primitive));
            let bvh = self.intersector;
            surfaces.behind_panes(bvh, direction, hit).0.is_none()
        };
        let rays = if count > 0 { RAYS } else { 0 };
        let open = (0..rays).filter(|_| is_open()).count();
        open as f64 / f64::from(RAYS)
    }
}

/// The paths from which on rows are gathered: fewer take less time than a
/// training.
const MANY_PATHS: u64 = 1 << 16;

/// The entries of a matrix that is gathered, at most: each has 32 bytes in
/// each replicate.
const MOST_ENTRIES: u64 = 1 << 21;

/// Rays that find how much of the sky receivers see.
const RAYS: u32 = 1024;

/// The part of their view from which on paths are as good.
const OPEN: f64 = 0.25;

/// The chosen sampling, and the reasons.
pub struct Choice {
    /// The measured means.
    pub pilot: Pilot,
    /// How samples are to be made.
    pub sampling: Sampling,
    /// For each method, the time of the reference over its own, for the same
    /// error.
    pub gains: [(Method, f64); 3],
}

impl fmt::Display for Choice {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let Pilot { first, later, first_rays, .. } = self.pilot;
        let rays = 2. * self.pilot.rays / first_rays.max(1e-9);
        let share = 100. * later / (first + later).max(f64::MIN_POSITIVE);
        let Sampling { method, glance, .. } = self.sampling;
        let kind = match (glance, method) {
            (false, _) => "",
            (true, Method::Gather) => ", a glance without corrections",
            (true, _) => ", a glance",
        };
        write!(
            out,
            "{method}{kind}: a path has {rays:.1} rays, and {share:.0} % of \
             its variance comes after its first direction; predicted gains"
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
    /// When the run ends.
    pub budget: Budget,
    /// Seconds that remain.
    pub left: Option<f64>,
    /// Whether only a picture is asked for.
    pub shows: bool,
}

impl Request {
    /// The number of pixels.
    fn area(&self) -> u64 {
        self.window.area() as u64
    }

    /// The largest number of samples of a pixel. A limit of time counts as the
    /// samples of one thread with a quarter of `RATE`: the same everywhere.
    fn bound(&self) -> Option<u64> {
        let rate = 0.25 * RATE / GATHER_RAYS as f64;
        let timed =
            |time: f64| (time * rate / self.area() as f64).ceil() as u64;
        let timed = self.budget.time.map(timed);
        self.budget.samples.into_iter().chain(timed).min()
    }
}

/// When a run ends: at the first limit that it reaches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Budget {
    /// Samples of each pixel or receiver, at least 1.
    pub samples: Option<u64>,
    /// Seconds from the start of the program.
    pub time: Option<f64>,
    /// The error to reach, and the kind of error.
    pub error: Option<(f64, ErrorNorm)>,
}

impl Budget {
    /// So many samples of each pixel or receiver.
    pub fn samples(n: u64) -> Self {
        Self { samples: Some(n), time: None, error: None }
    }

    /// Samples until the root mean square over pixels or receivers of the
    /// standard error is this part of each one's mean.
    pub fn relative_error(error: f64) -> Self {
        let norm = ErrorNorm { relative: true, largest: false };
        Self { samples: None, time: None, error: Some((error, norm)) }
    }

    /// Samples until the standard error of each pixel or receiver is at most
    /// this part of its mean.
    pub fn each_within(error: f64) -> Self {
        let norm = ErrorNorm { relative: true, largest: true };
        Self { error: Some((error, norm)), ..Self::relative_error(error) }
    }

    /// The time at which a program that began at `start` should end.
    pub fn deadline(&self, start: Instant) -> Option<Instant> {
        let time = Duration::try_from_secs_f64(self.time?).ok()?;
        start.checked_add(time)
    }
}

/// The samples of each pixel or receiver if nothing limits a run.
pub fn default_samples(is_list: bool) -> u64 {
    if is_list { 1024 } else { 1 }
}

/// The samples of each pixel of an image that is known beforehand, if it is.
pub fn samples_if_known(analysis: &SceneAnalysis) -> Option<u64> {
    analysis.known_pixels.is_all().then_some(2)
}

impl Sampling {
    /// The same, for an image that is shown soon.
    pub fn for_display(self) -> Self {
        let most = if self.method == Method::Gather { 1 } else { 4 };
        let net_size = self.net_size.min(most);
        let training = self.training.min(1 << 20);
        Self { net_size, training, ..self }
    }

    /// The same, for a glance at so many pixels with about so many rays.
    pub fn glance(self, rays: f64, area: u64) -> Self {
        let half = (0.15 * rays / area as f64) as u64;
        let (method, net_size) = match self.method {
            Method::Gather => (Method::Gather, half.clamp(2, 3)),
            _ => (Method::Sobol, 1 << half.clamp(2, 4).ilog2()),
        };
        let training = (0.2 * rays).clamp(150e3, 1e6) as u64;
        Self { method, net_size, training, glance: true, ..self }
    }
}

/// Assumed rays per second of a thread.
const RATE: f64 = 4e6;

/// An estimate of the rays that so many pixels or receivers need, with
/// surfaces of this albedo.
pub(crate) fn expected_rays(
    &Budget { samples, time, error }: &Budget,
    albedo: f64,
    area: usize,
    sensor: &Sensor,
) -> f64 {
    let enough = |(error, norm): (f64, ErrorNorm)| {
        let deviation = match sensor {
            _ if norm.relative => 1.,
            Sensor::Camera(_, entrance) if entrance.is_inside => 0.006,
            _ => 0.25,
        };
        (deviation / error).powi(2).max(1.)
    };
    let limits = [samples.map(|n| n as f64), error.map(enough)];
    let samples = limits.into_iter().flatten().reduce(f64::min);
    let each = match sensor {
        Sensor::Camera(_, entrance) if !entrance.is_inside => 1. + albedo,
        _ => (1. / (1. - albedo)).min(10.),
    };
    let rays = samples.map(|n| n * area as f64 * each);
    let time = time.or(rays.is_none().then_some(60.));
    let rate = RATE * rayon::current_num_threads() as f64;
    let timed = time.map_or(f64::INFINITY, |time| time * rate);
    rays.map_or(timed, |rays| timed.min(rays))
}

/// The number of paths before which no error is believed.
pub const MIN_PATHS: f64 = 1000.;

/// The predicted samples of each of so many pixels at which an error is
/// reached, given the error after some samples, if it is known.
pub(crate) fn samples_to_error(
    target: f64,
    (spp, error): (u64, Option<f64>),
    area: u64,
) -> u64 {
    let least = (MIN_PATHS / area as f64).ceil().max(2.);
    let Some(error) = error else {
        let is_open = spp < least as u64;
        return if is_open { least as u64 } else { u64::MAX };
    };
    // A square that vanishes would make the quotient 0 / 0.
    let e = (target * target).max(f64::MIN_POSITIVE);
    let v = spp as f64 * error * error;
    let root = (v * v + 12. * e / area as f64).sqrt();
    ((v + root) / (2. * e)).ceil().max(least) as u64
}
