// Tangled from chapters/choice.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A few paths, from which the costs of methods are predicted.

use std::array;

use bytemuck::{Pod, Zeroable, cast};
use rand::RngExt;
use rayon::prelude::*;

use super::sampling::Setup;
use crate::analysis::LitView;
use crate::analysis::background::TileContent;
use crate::bvh::{Dispatch, Intersector};
use crate::film::Window;
use crate::integrator::{Integrator, PathEvent, PathTracer};
use crate::sampler::{IndependentSampler, Sampler, generator, within};
use crate::sensor::Start;

/// Means over pixels of an image, estimated from a few paths.
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
    /// The rays of a path up to its second surface.
    pub first_rays: f64,
    /// The share of paths that go on from a second surface.
    pub indirect: f64,
}

/// A pilot before it runs.
pub struct Trial<'a> {
    /// The scene.
    pub setup: &'a Setup<'a>,
    /// The part of the image that is rendered.
    pub window: Window,
    /// The number of pixels to draw.
    pub pixels: u64,
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
        let known_pixels = &self.setup.analysis.known_pixels;
        if known_pixels.content((x, y)) != TileContent::Scene {
            return Pilot::default();
        }
        let twins = |n| self.twins(intersector, (x, y), n);
        let [[a, b], [c, d]] = [2 * n, 2 * n + 1].map(twins);
        let paths = [a, b, c, d];
        if paths.iter().all(|path| path.rays == 0) {
            return Pilot::default();
        }
        // Compare the four paths of a pixel
        let apart = |p: &[Path], q: &[Path]| {
            let pairs =
                p.iter().flat_map(|p| q.iter().map(move |q| (p, q)));
            let squares = pairs.map(|(p, q)| (p.value - q.value).powi(2));
            squares.sum::<f64>() / (2 * p.len() * q.len()) as f64
        };
        let mean = |part: fn(&Path) -> f64| {
            paths.iter().map(part).sum::<f64>() / 4.
        };
        let later = (apart(&[a], &[b]) + apart(&[c], &[d])) / 2.;
        let (one, other) = (a.value + b.value, c.value + d.value);
        let variate = a.variate - c.variate;
        Pilot {
            square: one * other / 4.,
            first: apart(&[a, b], &[c, d]) - later,
            later,
            sky_variance: 0.5 * variate * variate,
            covariance: 0.25 * (one - c.value - d.value) * variate,
            rays: mean(|path| (path.rays + path.shadow_rays) as f64),
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
            &self.setup.view;
        let integrator = PathTracer::new(surfaces, sky.clone());
        let number = |k| IndependentSampler::new(PILOT).start(n, k);
        let mut sampler = number(0);
        let [u, v] = sampler.get_pixel_2d();
        let at = (within(x, resolution.0, u), within(y, resolution.1, v));
        let Start { direction, hit, transmittance, .. } =
            sensor.start(intersector, &surfaces, at);
        // Reflect at the first surface
        let mut path = integrator.begin(direction, transmittance);
        let event = integrator.advance(&mut path, hit, &mut sampler);
        let variate = match (hit, event) {
            (Some(hit), PathEvent::Scatter(..)) => {
                integrator.control_variate(&hit, path.direction)
            }
            _ => 0.,
        };
        // Continue two paths from the first hit
        [1, 2].map(|k| {
            let (mut path, mut event, mut sampler) =
                (path, event, number(k));
            let mut rays = u64::from(hit.is_some());
            let mut shadow_rays = 0;
            loop {
                let (ray, from) = match event {
                    PathEvent::Terminate(value) => {
                        return Path { value, rays, shadow_rays, variate };
                    }
                    PathEvent::Scatter(ray, from) => (ray, from),
                };
                match path.shadow {
                    Some(_) => shadow_rays += 1,
                    None => rays += 1,
                }
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
    /// Its rays, without those to the sun.
    rays: u64,
    shadow_rays: u64,
    /// The control variate of its first reflection.
    variate: f64,
}
