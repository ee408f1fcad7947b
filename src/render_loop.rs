// Tangled from chapters/render_loop.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The render loop: passes over the film until a limit is
//! reached, and the curve of error against time.
//!
//! ```
//! use litpt::{film::Film, render_loop::{Convergence, Limits}};
//!
//! let mut convergence = Convergence::default();
//! convergence.record(&Film::new(4, 3), &Limits::default());
//! assert_eq!(convergence.last().spp, 0);
//! ```

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::film::{ErrorNorm, Film, Summary};
use crate::host::Interrupt;
use crate::render::choose::{MIN_PATHS, samples_to_error};
use crate::render::{RankStats, Renderer};
use serde::{Deserialize, Serialize};

/// Finds the error of the picture that a film holds, if it is known.
pub type Judge = fn(&Film) -> Option<f64>;

/// The limits of a run, and its reference.
#[derive(Clone, Copy, Default)]
pub struct Limits<'a> {
    /// At most so many samples of each pixel.
    pub samples: Option<u64>,
    /// At least so many of each pixel, unless a signal arrives.
    pub least: u64,
    /// The time at which the program should end.
    pub deadline: Option<Instant>,
    /// The seconds that it needs after the last sample to write its files:
    /// if no pixel has a sample, and if all have.
    pub reserve: [f64; 2],
    /// The clock; the system's, if none.
    pub clock: Option<&'a (dyn Fn() -> Instant + Sync)>,
    /// The error to reach.
    pub error: Option<f64>,
    /// The norm of this error.
    pub norm: ErrorNorm,
    /// The error of the picture to reach, and the function that finds it.
    pub picture: Option<(f64, Judge)>,
    /// Stops the run after a signal.
    pub interrupt: Option<&'a Interrupt>,
    /// The radiance of each pixel, row by row from the top left.
    pub reference: Option<&'a [f64]>,
}

impl Limits<'_> {
    fn now(&self) -> Instant {
        self.clock.map_or_else(Instant::now, |clock| clock())
    }

    fn signal(&self) -> Option<i32> {
        self.interrupt?.signal()
    }

    /// When rendering has to end if this fraction of pixels has a sample.
    fn end(&self, share: f64) -> Option<Instant> {
        let [none, full] = self.reserve;
        let reserve = none + share.min(1.) * (full - none);
        let reserve = Duration::from_secs_f64(reserve.max(0.));
        self.deadline.map(|end| end.checked_sub(reserve).unwrap_or(end))
    }
}

/// Why a run has stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stop {
    /// All the samples are there.
    Samples,
    /// The time is over.
    Time,
    /// The error is small enough.
    Error,
    /// A signal of this number has arrived.
    Signal(#[serde(skip)] i32),
}

/// A step of a run: one point of the curve of error against time.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize,
)]
pub struct CurvePoint {
    /// Samples per pixel so far.
    pub spp: u64,
    /// Seconds of rendering so far, without load and build.
    pub seconds: f64,
    /// Rays traced so far.
    pub rays: u64,
    /// Estimated root mean square error over the pixels, if known.
    pub rmse: Option<f64>,
    /// The error that is compared with a target, if it is another and known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_error: Option<f64>,
    /// Mean radiance of the image.
    pub mean: f64,
    /// Its standard error, if known.
    pub mean_stderr: Option<f64>,
    /// Root mean square difference from the reference, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rmse_reference: Option<f64>,
    /// Seconds of all processors so far, if there are several ranks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub processor_seconds: Option<f64>,
}

impl CurvePoint {
    /// The error by this norm, if it is known.
    pub fn judged(&self, norm: ErrorNorm) -> Option<f64> {
        if norm.is_rms() { self.rmse } else { self.target_error }
    }
}

/// The record of a run so far, by which its loop decides how many samples
/// to make.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Convergence {
    /// Samples that each pixel has at least.
    pub spp: u64,
    /// Seconds of rendering, with the work between passes.
    #[serde(rename = "render_seconds")]
    pub seconds: f64,
    /// Rays traced.
    pub rays: u64,
    /// Pixels whose samples were all alike, at the last step: their error
    /// is hidden.
    pub constant_pixels: u64,
    /// The curve of error against time.
    pub curve: Vec<CurvePoint>,
    /// Why the run has ended; none while it goes on.
    pub stopped: Option<Stop>,
    /// Seconds of all processors, if there are several ranks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub processor_seconds: Option<f64>,
    /// The work of each rank since the run was begun or resumed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ranks: Vec<RankStats>,
    /// Seconds for one sample of each pixel, at the last pass.
    #[serde(skip)]
    pace: Option<f64>,
    /// The error of the picture when it was judged last, if it is known.
    #[serde(skip)]
    pub picture: Option<f64>,
}

/// Samples of a pixel in a pass at most, of images that cost nothing.
const MOST: u64 = 1 << 16;

/// The time that the first sample has in any case.
const FIRST: Duration = Duration::from_millis(100);

/// The seconds of a run after which its picture is judged.
const JUDGED: f64 = 0.5;

/// The longest time of a pass of more than one sample, in seconds, unless
/// it costs too much.
const SLICE: f64 = 0.25;

/// The root mean square difference of an image from the truth.
fn true_error(film: &Film, truth: &[f64]) -> f64 {
    let differences = film.means().zip(truth).map(|(a, b)| a - b);
    let squares: f64 = differences.map(|d| d * d).sum();
    (squares / film.area() as f64).sqrt()
}

impl Convergence {
    /// Continues a run until a limit is reached: the render loop, which
    /// [`Run::render`](crate::run::Run::render), the command `pt` and `ptview`
    /// call. It is here, and not in `Run`, since the record of the run decides
    /// how long a pass lasts and when the next step is due.
    ///
    /// Calls `advance`, from any thread, with the number of paths that are
    /// done, or of rays during the training, and `after` when a pass has
    /// ended.
    pub fn run(
        &mut self,
        renderer: &mut dyn Renderer,
        film: &mut Film,
        limits: &Limits,
        advance: &(dyn Fn(u64) + Sync),
        after: &mut impl FnMut(&Self, &Film),
    ) -> Stop {
        (self.stopped, self.ranks) = (None, vec![]);
        let (start, before) = (limits.now(), self.seconds);
        let spent = self.processor_seconds.unwrap_or(0.);
        let mut next_judged = JUDGED;
        // Watch for signals and for the end of the time
        let (area, first) = (film.area(), start + FIRST);
        let goes_on = |paths: u64| {
            let end = limits.end(paths as f64 / area as f64);
            let over = |end: Instant| limits.now() >= end.max(first);
            let is_open = paths < limits.least.saturating_mul(area);
            limits.signal().is_none() && (is_open || !end.is_some_and(over))
        };
        let taken = AtomicU64::new(self.spp.saturating_mul(area));
        let watch = |paths| {
            advance(paths);
            goes_on(taken.fetch_add(paths, Ordering::Relaxed) + paths)
        };
        // Train before the first pass
        let rays = renderer.learn(film, &|rays| {
            advance(rays);
            goes_on(0)
        });
        self.rays += rays;
        if rays > 0 {
            self.seconds = before + (limits.now() - start).as_secs_f64();
            after(self, film);
        }
        loop {
            // Return when a limit is reached
            if let Some(stop) = self.stop(limits, first, area) {
                self.record(film, limits);
                self.stopped = Some(stop);
                return stop;
            }
            // Render one pass and measure its time
            let slice = renderer.least_seconds().max(SLICE);
            let (end, due) = self.next(limits, area, slice);
            let began = limits.now();
            self.rays += renderer.pass(film, end, &watch);
            let now = limits.now();
            let more = film.samples() - self.spp;
            let pace = (now - began).as_secs_f64() / more.max(1) as f64;
            self.pace = Some(pace);
            self.spp += more;
            self.seconds = before + (now - start).as_secs_f64();
            self.ranks = renderer.shares().to_vec();
            if !self.ranks.is_empty() {
                let seconds =
                    self.ranks.iter().map(|share| share.processor_seconds);
                self.processor_seconds = Some(spent + seconds.sum::<f64>());
            }
            if self.spp >= due {
                self.record(film, limits);
            }
            if self.seconds >= next_judged {
                next_judged = self.judge(film, limits);
            }
            after(self, film);
        }
    }

    /// The end of the next pass, of at most so many seconds, and the next
    /// step.
    fn next(&self, limits: &Limits, area: u64, slice: f64) -> (u64, u64) {
        // Find when the next step is due
        let needed = self.needed(limits, area).map(|n| n.max(self.spp + 1));
        let ends = limits.samples.into_iter().chain(needed);
        let due =
            ends.fold(next_step(self.last().spp.max(self.spp)), u64::min);
        // Find the time for a pass
        let left =
            |end: Instant| end.saturating_duration_since(limits.now());
        let left = limits.end(1.).map(|end| left(end).as_secs_f64());
        let seconds = left.map_or(slice, |left| slice.min(left));
        let pace = self.pace.map_or(1, |pace| (seconds / pace) as u64);
        let pace = pace.min(MOST);
        (due.min(self.spp.saturating_add(pace.max(1))), due)
    }

    /// The last step; before the first, one without any value.
    pub fn last(&self) -> CurvePoint {
        self.curve.last().copied().unwrap_or_default()
    }

    /// The samples after which the run is expected to stop, if its time
    /// is not over before; none if that cannot be predicted.
    pub fn expected(&self, limits: &Limits, area: u64) -> Option<u64> {
        let last = self.last().judged(limits.norm);
        let needed = last.and_then(|_| self.needed(limits, area));
        let ends = [limits.samples, needed].into_iter().flatten();
        ends.min().map(|spp| spp.max(self.spp))
    }

    /// The samples after which the target error is expected to be reached, if
    /// there is one.
    fn needed(&self, limits: &Limits, area: u64) -> Option<u64> {
        let last = self.last().judged(limits.norm);
        let spp = last.map_or(self.spp, |_| self.last().spp);
        Some(samples_to_error(limits.error?, (spp, last), area))
    }

    /// Finds the error of the picture, if it is a limit and there is time, and
    /// returns the seconds of the run at which to do so again.
    fn judge(&mut self, film: &Film, limits: &Limits) -> f64 {
        let Some((goal, error)) = limits.picture else { return f64::MAX };
        let began = limits.now();
        let most = Duration::from_secs_f64(limits.reserve[1].max(0.));
        if limits.end(1.).is_some_and(|end| began + most > end) {
            return f64::MAX;
        }
        self.picture = error(film);
        let took = (limits.now() - began).as_secs_f64();
        let excess = self.picture.map_or(2., |error| error / goal);
        self.seconds * (excess * excess).clamp(1.2, 2.) + 2. * took
    }

    /// Why the run should stop now, if it should; the first sample has time
    /// until `first`.
    fn stop(
        &self,
        limits: &Limits,
        first: Instant,
        area: u64,
    ) -> Option<Stop> {
        let has_all = limits.samples.is_some_and(|n| self.spp >= n);
        if has_all && self.spp > 0 {
            return Some(Stop::Samples);
        }
        if let Some(signal) = limits.signal() {
            return Some(Stop::Signal(signal));
        }
        if has_all {
            return Some(Stop::Samples);
        }
        if self.reaches(limits, area) {
            return Some(Stop::Error);
        }
        // Stop if the time is over or too short
        let pace = self.pace.filter(|&pace| pace < SLICE).unwrap_or(0.);
        let now = limits.now() + Duration::from_secs_f64(pace);
        let is_over = |end| match self.spp {
            0 => limits.least == 0 && now >= first.max(end),
            spp => spp >= limits.least && now >= end,
        };
        limits.end(1.).is_some_and(is_over).then_some(Stop::Time)
    }

    /// Whether the error is known to be small enough, even if there is light
    /// that no path has met yet (the rule of three).
    fn reaches(&self, limits: &Limits, area: u64) -> bool {
        let step = self.last();
        let paths = self.spp as f64 * area as f64;
        let unseen = 3. / (paths * self.spp as f64);
        let is_recent = step.spp == self.spp && paths >= MIN_PATHS;
        let errors = limits.error.zip(step.judged(limits.norm));
        let picture = limits.picture.zip(self.picture);
        picture.is_some_and(|((target, _), error)| error <= target)
            || is_recent
                && errors.is_some_and(|(target, rmse)| {
                    rmse * rmse + unseen <= target * target
                })
    }

    /// Records a point, if there has been a pass since the last one.
    pub fn record(&mut self, film: &Film, limits: &Limits) {
        let &mut Self { spp, seconds, rays, processor_seconds, .. } = self;
        let last = self.last();
        if (spp, seconds) == (last.spp, last.seconds) {
            return;
        }
        let Summary { mean, mean_stderr, rmse, constant } = film.summary();
        self.constant_pixels = constant;
        let finite = |x: f64| x.is_finite().then_some(x);
        let &Limits { norm, reference, .. } = limits;
        let judged = (!norm.is_rms()).then(|| film.error(norm));
        let truth = reference.filter(|_| spp > 0);
        self.curve.push(CurvePoint {
            spp,
            seconds,
            rays,
            rmse: finite(rmse),
            target_error: judged.and_then(finite),
            mean,
            mean_stderr: finite(mean_stderr),
            rmse_reference: truth.map(|truth| true_error(film, truth)),
            processor_seconds,
        });
    }
}

/// The first number of samples after `spp` at which a step is
/// recorded.
fn next_step(spp: u64) -> u64 {
    let mut scale = 1u128;
    loop {
        let steps = [10, 16, 25, 40, 63].map(|n| (n * scale + 5) / 10);
        if let Some(step) = steps.into_iter().find(|&n| n > spp.into()) {
            return step.min(u64::MAX.into()) as u64;
        }
        scale *= 10;
    }
}
