// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Chooses a method from what a few paths tell.

use std::fmt;
use std::time::Instant;

use rand::RngExt;
use rayon::prelude::*;

use super::method::{Method, Sampling};
use crate::analysis::background::TileContent;
use crate::analysis::{Inquiry, SceneAnalysis};
use crate::bvh::{Bvh, Dispatch, Intersector};
use crate::film::Window;
use crate::gather::training;
use crate::integrator::{Integrator, PathEvent, PathTracer};
use crate::sampler::{IndependentSampler, Sampler, generator, within};

/// What a few paths tell of those of an image: means over its pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pilot {
    /// The square of the radiance of a pixel.
    pub square: f64,
    /// The variance of a path that comes from its point in the pixel and
    /// its first direction.
    pub first: f64,
    /// The variance that comes from all later decisions.
    pub later: f64,
    /// The variance of the control variate of a path,
    pub spread: f64,
    /// and its covariance with the contribution.
    pub covariance: f64,
    /// The rays of a path; none if it meets no surface.
    pub rays: f64,
    /// Those of them up to the second surface.
    pub first_rays: f64,
    /// The share of paths that go on from a second surface.
    pub indirect: f64,
}

/// A pilot that waits for its intersector.
struct Trial<'a, 'b> {
    inquiry: &'b Inquiry<'a>,
    analysis: &'b SceneAnalysis,
    /// The part of the image that is rendered.
    window: Window,
    /// Pixels that are drawn.
    pixels: u64,
}

impl Dispatch for Trial<'_, '_> {
    type Output = Pilot;

    fn with<K: Intersector>(self, intersector: &K) -> Pilot {
        let pixels = (0..self.pixels).into_par_iter();
        let pixels: Vec<_> =
            pixels.map(|n| self.pixel(intersector, n)).collect();
        let mean = |part: fn(&Pilot) -> f64| {
            pixels.iter().map(part).sum::<f64>() / pixels.len() as f64
        };
        Pilot {
            square: mean(|p| p.square),
            first: mean(|p| p.first).max(0.),
            later: mean(|p| p.later),
            spread: mean(|p| p.spread),
            covariance: mean(|p| p.covariance),
            rays: mean(|p| p.rays),
            first_rays: mean(|p| p.first_rays),
            indirect: mean(|p| p.indirect),
        }
    }
}

impl Trial<'_, '_> {
    /// The terms that one pixel adds to the means.
    fn pixel<K: Intersector>(&self, intersector: &K, n: u64) -> Pilot {
        let mut random = generator(0, PILOT, n);
        let Window { corner: (left, top), size } = self.window;
        let x = left + random.random_range(0..size.0);
        let y = top + random.random_range(0..size.1);
        if self.analysis.known.content((x, y)) != TileContent::Scene {
            return Pilot::default();
        }
        let twins = |n| self.twins(intersector, (x, y), n);
        let [[a, b], [c, d]] = [2 * n, 2 * n + 1].map(twins);
        let apart = |p: &[Path], q: &[Path]| {
            let pairs =
                p.iter().flat_map(|p| q.iter().map(move |q| (p, q)));
            let squares = pairs.map(|(p, q)| (p.value - q.value).powi(2));
            squares.sum::<f64>() / (2 * p.len() * q.len()) as f64
        };
        // Take the means of a pixel
        let later = (apart(&[a], &[b]) + apart(&[c], &[d])) / 2.;
        let all = [a, b, c, d];
        if all.iter().all(|path| path.rays == 0) {
            return Pilot::default();
        }
        let apart_control = a.control - c.control;
        let mean =
            |part: fn(&Path) -> f64| all.iter().map(part).sum::<f64>() / 4.;
        Pilot {
            square: (a.value + b.value) * (c.value + d.value) / 4.,
            first: apart(&[a, b], &[c, d]) - later,
            later,
            spread: 0.5 * apart_control * apart_control,
            covariance: 0.25
                * (a.value + b.value - c.value - d.value)
                * apart_control,
            rays: mean(|path| path.rays as f64),
            first_rays: mean(|path| path.rays.min(2) as f64),
            indirect: mean(|path| f64::from(path.rays > 2)),
        }
    }
}

/// Numbers the generators of the pilot.
const PILOT: u64 = u64::MAX - 1;

/// A path that has ended.
#[derive(Clone, Copy)]
struct Path {
    value: f64,
    rays: u64,
    /// The control variate of its first reflection.
    control: f64,
}

impl Trial<'_, '_> {
    /// Two paths that share their point in a pixel and their first
    /// direction.
    fn twins<K: Intersector>(
        &self,
        intersector: &K,
        (x, y): (u32, u32),
        n: u64,
    ) -> [Path; 2] {
        let &Inquiry { entrance, camera, sky, albedo, resolution, .. } =
            self.inquiry;
        let integrator = PathTracer { albedo, sky };
        let number = |k| IndependentSampler::new(PILOT).start(n, k);
        let mut sampler = number(0);
        let [u, v] = sampler.get_pixel_2d();
        let u = within(x, resolution.0, u);
        let direction = camera.direction(u, within(y, resolution.1, v));
        // Trace the ray of the camera
        let mut path = integrator.begin(direction);
        let ray = entrance.enter(direction);
        let hit = ray.and_then(|ray| intersector.first_hit(&ray, None));
        let rays = u64::from(hit.is_some());
        let event = integrator.go_on(&mut path, hit, &mut sampler);
        let control = match (hit, event) {
            (Some(hit), PathEvent::Scatter(ray, _)) => {
                integrator.control(hit.normal, ray.direction)
            }
            _ => 0.,
        };
        // Go on twice from the first surface
        [1, 2].map(|k| {
            let (mut path, mut event) = (path, event);
            let (mut rays, mut sampler) = (rays, number(k));
            loop {
                match event {
                    PathEvent::Terminate(value) => {
                        return Path { value, rays, control };
                    }
                    PathEvent::Scatter(ray, from) => {
                        rays += 1;
                        let hit = intersector.first_hit(&ray, Some(from));
                        event =
                            integrator.go_on(&mut path, hit, &mut sampler);
                    }
                }
            }
        })
    }
}

impl Pilot {
    /// How much of the sky a control variate best subtracts, in [0, 1].
    pub fn control(&self) -> f64 {
        match self.spread > 0. {
            true => (-self.covariance / self.spread).clamp(0., 1.),
            false => 0.,
        }
    }

    /// What it leaves of the variance of the first direction.
    fn controlled(&self) -> f64 {
        let control = self.control();
        let change = 2. * control * self.covariance
            + control * control * self.spread;
        (self.first + change).max(0.)
    }
}

impl Pilot {
    /// The variance of a sample times its rays, in units of the rays of
    /// paths, for `samples` of each pixel.
    fn cost(&self, albedo: f64, sampling: &Sampling, samples: f64) -> f64 {
        let &Self { square, first, later, .. } = self;
        match sampling.method {
            Method::Reference => (first + later) * self.rays,
            Method::Sobol => {
                let net = libm::pow(sampling.replicate as f64, -0.4);
                let first = self.controlled();
                (first * net + later) * 1.05 * self.rays
            }
            Method::Gather => {
                // Foresee the cost of a gather
                let bright = albedo * albedo;
                let each = self.first_rays + 3. * bright * self.indirect;
                let once = 8. * self.first_rays / samples;
                let guided = 1.6 * first * square
                    / (square + 0.7 * first).max(f64::MIN_POSITIVE);
                let short = self.first_rays / self.rays.max(1e-9);
                let left = 16. * bright * short * short * later;
                let learnt = libm::pow(samples.min(4096.), -0.28);
                (guided + left) * learnt * 1.7 * (each + once)
            }
        }
    }
}

impl Pilot {
    /// The work before each of `area` pixels has a sample, in paths.
    fn first_paths(
        &self,
        albedo: f64,
        sampling: &Sampling,
        area: u64,
    ) -> f64 {
        let &Sampling { replicate, training, .. } = sampling;
        let (area, replicate) = (area as f64, replicate as f64);
        let each = self.first_rays + 3. * albedo * albedo * self.indirect;
        match sampling.method {
            Method::Gather => {
                let pilot = training::PILOT as f64 * self.first_rays;
                let rays = area * (pilot + replicate * each);
                (training as f64 + rays) / self.rays.max(1e-9)
            }
            _ => area * replicate,
        }
    }
}

/// What a pilot has found, and what follows.
#[derive(Clone, Debug)]
pub struct Choice {
    /// What a few paths tell.
    pub pilot: Pilot,
    /// How samples are to be made.
    pub sampling: Sampling,
    /// Of each method, the time of the reference over its own, for the same
    /// error.
    pub gains: Vec<(Method, f64)>,
}

impl Choice {
    /// The foreseen gain of what was chosen.
    pub fn gain(&self) -> f64 {
        let chosen =
            self.gains.iter().find(|g| g.0 == self.sampling.method);
        chosen.map_or(1., |g| g.1)
    }
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

/// Chooses how `samples` of each pixel are made, or as many as have the
/// error that was asked for, by the method that is wanted or by any; none
/// if these are too few for a pilot. A method that could not give each
/// pixel a sample in the `seconds` that are left is not chosen, even if it
/// is wanted.
pub fn choose(
    intersector: &Bvh,
    (inquiry, analysis): (&Inquiry, &SceneAnalysis),
    (window, seed): (Window, u64),
    (samples, error, seconds): (Option<u64>, Option<f64>, Option<f64>),
    wanted: Option<Method>,
) -> Option<Choice> {
    let area = u64::from(window.size.0) * u64::from(window.size.1);
    let paths = samples.unwrap_or(MANY).saturating_mul(area);
    let pixels = (paths / 200).min(4096);
    let trial = Trial { inquiry, analysis, window, pixels };
    let began = Instant::now();
    let pilot = (pixels >= 64).then(|| intersector.dispatch(trial))?;
    let pace = began.elapsed().as_secs_f64() / (4 * pixels) as f64;
    // Foresee the gains of all methods
    let enough = |error: f64| {
        ((pilot.first + pilot.later) / (error * error)).ceil() as u64
    };
    let bounds = samples.into_iter().chain(error.map(enough));
    let samples = bounds.min().map(|n| n.max(1));
    let methods = Method::ALL.map(|method| {
        let mut sampling = Sampling::new(method, seed, samples, area);
        if method == Method::Sobol {
            sampling.control = (100. * pilot.control()).round() as u64;
        }
        let expected = samples.unwrap_or(MANY) as f64;
        (sampling, pilot.cost(inquiry.albedo, &sampling, expected))
    });
    let reference = methods[0].1;
    let gain = |cost: f64| match reference > 0. {
        true => reference / cost.max(1e-3 * reference),
        false => 1.,
    };
    let gains = methods.map(|(s, cost)| (s.method, gain(cost))).to_vec();
    // Choose among the methods that there is time for
    let slow = |sampling: &Sampling| {
        let paths = pilot.first_paths(inquiry.albedo, sampling, area);
        sampling.method != Method::Reference
            && seconds.is_some_and(|seconds| 2. * paths * pace > seconds)
    };
    let methods = methods.iter().filter(|(sampling, _)| !slow(sampling));
    let is_wanted = |m| wanted.is_none_or(|wanted| m == wanted);
    let best = |all: &mut dyn Iterator<Item = &(Sampling, f64)>| {
        all.min_by(|s, t| s.1.total_cmp(&t.1)).copied()
    };
    let mut those = methods.clone().filter(|(s, _)| is_wanted(s.method));
    let (sampling, _) =
        best(&mut those).or_else(|| best(&mut methods.clone()))?;
    Some(Choice { pilot, sampling, gains })
}

/// Samples of a run without a limit.
const MANY: u64 = 1 << 20;
