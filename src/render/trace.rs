// Tangled from chapters/render.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! One sample, step by step: what it meets, why it ends, and what it adds to
//! its pixel.

use std::fmt;
use std::sync::OnceLock;

use glam::DVec3;

use super::Job;
use super::choose::{Method, Sampling, Setup};
use crate::analysis::background::TileContent;
use crate::bvh::{BEAM, Bvh, GROUND, Hit, Intersector, NONE};
use crate::camera::typed;
use crate::film::Film;
use crate::integrator::gather::{Gather, Learnt, TileSamples, Tracer};
use crate::integrator::{Integrator, PathEvent, PathTracer};
use crate::integrator::{ROULETTE_THRESHOLD, SingleProcess, gather};
use crate::sampler::sobol::scramble_key;
use crate::sampler::{Sampler, within};
use crate::scene::Frame;
use crate::sensor::{Sensor, Starts};

/// A surface on the way of a sample.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    /// The point and the normal, in the coordinates of the scene.
    pub hit: Hit,
    /// The albedo there.
    pub albedo: f64,
    /// The part of the radiance from the next surface, or from the sky, that
    /// reaches the pixel.
    pub throughput: f64,
}

/// Why a sample goes no further.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Ending {
    /// All samples of its tile are known, and none is traced.
    #[default]
    Known,
    /// It sees the sky, or what is below the horizon.
    Sky,
    /// The surface reflects nothing.
    Black,
    /// Roulette has ended a weak path.
    Roulette,
    /// Roulette has ended a path of many bounces.
    ManyBounces,
    /// It takes the radiance of a cell of the cache.
    Cell {
        /// The radiance, in units of that of the uniform sky.
        radiance: f32,
        /// The error that is expected of it.
        error: f32,
    },
}

impl fmt::Display for Ending {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Known => write!(out, "known beforehand"),
            Self::Sky => write!(out, "the sky, or what is below it"),
            Self::Black => write!(out, "a surface that is black"),
            Self::Roulette => write!(out, "roulette, the path is weak"),
            Self::ManyBounces => write!(out, "roulette, it is long"),
            Self::Cell { radiance, error } => {
                write!(out, "a cell of radiance {radiance} \u{b1} {error}")
            }
        }
    }
}

/// What has happened to one sample.
#[derive(Clone, Debug, Default)]
pub struct SampleTrace {
    /// Where its first ray goes; zero for a receiver, which has none.
    pub direction: DVec3,
    /// The surfaces that it meets.
    pub vertices: Vec<Vertex>,
    /// Why there are no more.
    pub ending: Ending,
    /// What it contributes to its pixel; for a gather, before corrections.
    pub value: f64,
    /// The part of it that the control variate adds.
    pub control: f64,
    /// The part of it that the sun adds.
    pub sunlight: f64,
    /// For a gather, the scramble to which it belongs.
    pub scramble: Option<Scramble>,
}

/// The samples of a pixel that a gather adds to the film at once.
#[derive(Clone, Copy, Debug)]
pub struct Scramble {
    /// Its number.
    pub number: u64,
    /// How many samples the pixel has in it.
    pub count: u32,
    /// Their mean with the corrections, which is added to the film.
    pub value: f64,
    /// The part of it that corrections have added.
    pub correction: f64,
}

impl Setup<'_> {
    /// Traces sample `number`, from 0, of the pixel of this column and row,
    /// or of the receiver of this row of a film: the one that a run with this
    /// sampling adds. None for a gather that has learnt nothing.
    pub fn trace_sample(
        &self,
        sampling: &Sampling,
        learnt: &OnceLock<Learnt>,
        pixel: (u32, u32),
        number: u64,
    ) -> Option<SampleTrace> {
        let size = self.view.resolution;
        Some(match sampling.method {
            Method::Reference => {
                self.independent(sampling).trace(size, pixel, number)
            }
            Method::Sobol => {
                self.in_nets(sampling).trace(size, pixel, number)
            }
            Method::Gather => {
                let cell = learnt.get()?;
                let none = Default::default();
                let gather = self.gather(sampling, none, &SingleProcess);
                trace_gather(&gather, cell, pixel, number)
            }
        })
    }
}

impl<K: Intersector, S: Sampler> Job<'_, K, PathTracer<'_>, S> {
    /// Traces a sample of a pixel of an image of this resolution.
    fn trace(
        &self,
        resolution: (u32, u32),
        (x, y): (u32, u32),
        number: u64,
    ) -> SampleTrace {
        let mut trace = SampleTrace::default();
        let content = self.known_pixels.content((x, y));
        if let TileContent::Constant(value) = content {
            return SampleTrace { value, ..trace };
        }
        // Start the sample alone
        let Self { sensor, intersector, integrator, .. } = self;
        let pixel = u64::from(y) * u64::from(resolution.0) + u64::from(x);
        let mut sampler = self.sampler.start(pixel, number);
        let mut places = [None; BEAM];
        places[0] = Some(((x, y), sampler.get_pixel_2d()));
        let sees_sky = content == TileContent::Sky;
        let surfaces = &integrator.surfaces;
        let (scene, size) = (*intersector, resolution);
        let Starts { directions, hits, transmittances, .. } =
            sensor.starts(scene, surfaces, &places, size, sees_sky);
        trace.direction = directions[0];
        let mut path = integrator.begin(directions[0], transmittances[0]);
        let mut hit = hits[0];
        loop {
            // Record one step of a path
            let is_weak = path.throughput < ROULETTE_THRESHOLD;
            let is_shadow = path.shadow.is_some();
            let event = integrator.advance(&mut path, hit, &mut sampler);
            let throughput = path.throughput;
            let vertex = hit.filter(|_| !is_shadow).map(|hit| {
                let albedo = integrator.surfaces.albedo(hit.primitive);
                Vertex { hit, albedo, throughput }
            });
            trace.vertices.extend(vertex);
            match event {
                PathEvent::Scatter(ray, from) => {
                    hit = intersector.first_hit(&ray, Some(from));
                }
                PathEvent::Terminate(value) => {
                    (trace.value, trace.control) = (value, path.variate);
                    trace.sunlight = path.sunlight;
                    trace.ending = match vertex {
                        None => Ending::Sky,
                        Some(vertex) if vertex.albedo == 0. => {
                            Ending::Black
                        }
                        _ if is_weak => Ending::Roulette,
                        _ => Ending::ManyBounces,
                    };
                    return trace;
                }
            }
        }
    }
}

/// Traces a sample of a gather that has learnt this.
fn trace_gather(
    gather: &Gather,
    Learnt { cache, allocation, .. }: &Learnt,
    (x, y): (u32, u32),
    number: u64,
) -> SampleTrace {
    let &Gather { view, intersector, known_pixels, seed, .. } = gather;
    // Find the tile and the scramble of a sample
    let (size, window) = (view.resolution, allocation.window);
    let is_list = matches!(view.sensor, Sensor::Receivers(_));
    let tile = Film::cropped(size, window, is_list).tile(x, y);
    let place = (y - tile.corner.1) * tile.size.0 + x - tile.corner.0;
    let count = allocation.counts[allocation.place(tile, place).2];
    let scramble = number / u64::from(count);
    let number = (number % u64::from(count)) as u32;
    let mut tracer = Tracer::new(gather, intersector, cache, allocation);
    let TileSamples { means, corrections, samples, .. } =
        tracer.tile(tile, scramble);
    let [value, correction] =
        [means, corrections].map(|part| part[place as usize]);
    let whole = Scramble { number: scramble, count, value, correction };
    let mut trace = SampleTrace { value, ..SampleTrace::default() };
    trace.scramble = Some(whole);
    let content = known_pixels.content(tile.corner);
    if matches!(content, TileContent::Constant(_)) {
        return trace;
    }
    // Start the sample as the gather does
    let i = u64::from(y) * u64::from(size.0) + u64::from(x);
    let key = scramble_key(seed, i, scramble);
    let [u, v] = allocation.net.pair(key, number, 0);
    let (u, v) = (within(x, size.0, u), within(y, size.1, v));
    let start = view.sensor.start(intersector, &view.surfaces, (u, v));
    trace.direction = start.direction;
    let mut samples = samples.into_iter();
    let found = samples.find(|s| (s.pixel, s.number) == (place, number));
    let Some(sample) = found else {
        trace.ending = Ending::Sky;
        trace.value = start.transmittance * view.sky.seen(trace.direction);
        return trace;
    };
    // Follow the sample to its end
    let gather::Sample { hit, albedo, weight, u, end, sunlight, .. } =
        sample;
    let throughput = albedo * weight;
    trace.vertices.push(Vertex { hit, albedo, throughput });
    let guide =
        cache.guide(cache.at(cache.grid.name(hit.point, hit.normal)));
    let ray = tracer.trace_gather_ray(&hit, guide, u);
    (trace.ending, trace.value) = match (ray.end, end) {
        (gather::End::Hit(hit), Some((_, cell))) => {
            let albedo = view.surfaces.albedo(hit.primitive);
            trace.vertices.push(Vertex { hit, albedo, throughput });
            let value = throughput * f64::from(cell.value);
            let (radiance, error) = (cell.value, cell.error);
            (Ending::Cell { radiance, error }, value)
        }
        (gather::End::Sky(radiance), _) => {
            (Ending::Sky, throughput * radiance)
        }
        _ => unreachable!("the ray meets what it has met"),
    };
    trace.value += sunlight;
    trace.sunlight = sunlight;
    trace
}

impl SampleTrace {
    /// The steps in words, in the coordinates of the file.
    pub fn text(&self, bvh: &Bvh, frame: &Frame) -> String {
        let mut text = String::new();
        if self.direction != DVec3::ZERO {
            text += &format!("ray        {}\n", typed(self.direction));
        }
        for Vertex { hit, albedo, throughput } in &self.vertices {
            // Print one surface
            let Hit { point, normal, primitive } = *hit;
            let what = match primitive {
                GROUND => "the ground".to_owned(),
                NONE => "the receiver".to_owned(),
                _ => format!("face {}", bvh.face(primitive) + 1),
            };
            let (point, normal) = (typed(frame.back(point)), typed(normal));
            text += &format!(
                "surface    {what} at {point}, normal {normal}, albedo {albedo}, \
                 throughput {throughput}\n"
            );
        }
        // Print the ending and the value
        let Self { ending, value, control, sunlight, .. } = self;
        text += &format!("end        {ending}\n");
        if *control != 0. {
            text += &format!("control    {control}, which the value has\n");
        }
        if *sunlight != 0. {
            text +=
                &format!("sun        {sunlight}, which the value has\n");
        }
        text += &format!("value      {value}\n");
        if let Some(whole) = self.scramble {
            let Scramble { number, count, value, correction } = whole;
            text += &format!(
                "scramble   {number}, the mean of {count} samples {value}, of \
                 which corrections {correction}\n"
            );
        }
        text
    }
}
