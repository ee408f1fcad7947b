// What each part of a gather is worth: renders a scene with all of them and
// without one. Takes the options of pt for a scene and its view, and prints
// a CSV.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::fs;

use litpt::cli::options::Options;
use litpt::film::{Film, FilmTile};
use litpt::integrator::gather::Gather;
use litpt::integrator::gather::cache::{Grid, RadianceCache, Record};
use litpt::integrator::gather::training::{Found, allocate, pilot, train};
use litpt::integrator::gather::{Allocation, Correction, Sample};
use litpt::render::choose::{Method, Pixels, Sampling};
use litpt::render::{Job, Renderer};
use litpt::sampler::sobol::{ScrambledNet, SobolSampler};
use litpt::sampler::split_mix;
use litpt::scene::read_obj;
use litpt::statistics::Accumulator;
use litpt_book::closed_forms::{Setting, tracer};
use rayon::prelude::*;

use super::Done;

/// What can be left out; the first is nothing, the last is everything.
const PARTS: [&str; 12] = [
    "nothing",
    "guides",
    "cache",
    "allocation",
    "sharing",
    "nets",
    "second ray",
    "second gather",
    "many paths",
    "training",
    "correction",
    "everything",
];

/// Samples of a pixel, if no number is given.
const SAMPLES: u64 = 64;

/// Independent runs of each, all with different random numbers.
const RUNS: u64 = 3;

/// Pixels of a tile.
const TILE: usize = 256;

/// What makes the samples of a run.
#[derive(Clone)]
struct Estimator<'a> {
    cache: &'a RadianceCache,
    allocation: Allocation,
    correction: Option<Correction>,
    /// The rays by which all this was learnt.
    learning: u64,
}

impl Learnt {
    /// The whole estimator.
    fn whole(&self) -> Estimator<'_> {
        let Self { cache, allocation, training, pilot, .. } = self;
        Estimator {
            cache,
            allocation: allocation.clone(),
            correction: Some(Correction::default()),
            learning: training + pilot,
        }
    }

    /// The estimator without one of its parts.
    fn without(&self, part: &str) -> Estimator<'_> {
        let whole = self.whole();
        let changed = |correction| Estimator {
            correction: Some(correction),
            ..whole.clone()
        };
        let default = Correction::default();
        match part {
            "guides" => Estimator { cache: &self.unguided, ..whole },
            "nets" => {
                let net = ScrambledNet::new(1);
                let allocation = Allocation { net, ..whole.allocation };
                Estimator { allocation, ..whole }
            }
            "cache" => Estimator {
                cache: &self.empty,
                learning: self.pilot,
                ..whole
            },
            "allocation" => Estimator {
                allocation: self.even.clone(),
                learning: self.training,
                ..whole
            },
            "training" => Estimator {
                cache: &self.hasty,
                learning: self.haste + self.pilot,
                ..whole
            },
            "sharing" => changed(Correction { group: 1, ..default }),
            "second ray" => changed(Correction { branches: 1, ..default }),
            "many paths" => changed(Correction { paths: 1, ..default }),
            "second gather" => {
                changed(Correction { gathers: 1, paths: 1, ..default })
            }
            "correction" => Estimator { correction: None, ..whole },
            _ => whole,
        }
    }

    /// The bytes that a part takes for images of this area, at most; none if
    /// they are but few.
    fn bytes(&self, part: &str, replicate: u64) -> Option<usize> {
        let RadianceCache { cells, guides, .. } = &self.cache;
        let Allocation { counts, scale, .. } = &self.allocation;
        match part {
            "guides" => Some(size_of_val(&guides[..])),
            "cache" => {
                let records = self.training as usize * size_of::<Record>();
                Some(size_of_val(&cells[..]) + records)
            }
            "allocation" => {
                Some(size_of_val(&counts[..]) + size_of_val(&scale[..]))
            }
            "sharing" => {
                let tile = TILE * replicate as usize;
                Some(tile * size_of::<Sample>())
            }
            _ => None,
        }
    }
}

/// A scene, its view, and how its samples are made.
struct Stage {
    setting: Setting,
    resolution: (u32, u32),
    samples: u64,
}

/// What runs have learnt, and by how many rays.
struct Learnt {
    cache: RadianceCache,
    training: u64,
    unguided: RadianceCache,
    /// After a tenth of the training.
    hasty: RadianceCache,
    haste: u64,
    empty: RadianceCache,
    allocation: Allocation,
    even: Allocation,
    pilot: u64,
}

impl Stage {
    /// How a method samples, with a seed.
    fn sampling(&self, method: Method, seed: u64) -> Sampling {
        Sampling::new(
            method,
            seed,
            Some(self.samples),
            Pixels::of_image(self.resolution),
        )
    }

    /// An empty film for that.
    fn film(&self, sampling: &Sampling) -> Film {
        let size = self.resolution;
        sampling.film(Film::new(size.0, size.1))
    }

    /// A renderer that has learnt nothing.
    fn renderer(&self, seed: u64) -> Gather<'_> {
        Gather { seed, ..self.setting.gather(self.resolution) }
    }
}

impl Stage {
    /// Learns twice, as a run with this seed does, and with a tenth of the
    /// rays.
    fn learn(&self, seed: u64) -> Learnt {
        let sampling = self.sampling(Method::Gather, seed);
        let (seed, film) = (split_mix(seed), self.film(&sampling));
        let nothing = &RadianceCache::empty(Grid::around(&[]));
        let one = &Allocation::even(film.window, 1);
        let trained = |training| {
            let gather = &Gather { training, ..self.renderer(seed) };
            train(&tracer(gather, nothing, one), &|_| true).unwrap()
        };
        let rays = sampling.training;
        let (cache, training) = trained(rays);
        let (hasty, haste) = trained(rays / 10);
        let gather = &Gather { correction: None, ..self.renderer(seed) };
        let prototype = tracer(gather, &cache, one);
        let found = pilot(&prototype, &film, false, &|_| true).unwrap();
        let Found { pixels, rays: pilot, .. } = found;
        let allocation =
            allocate(&prototype, &film, &pixels, &|_| true).unwrap();
        let counts = vec![film.net_size as u32; film.area() as usize];
        let even = Allocation { counts, ..allocation.clone() };
        let unguided = RadianceCache { guides: vec![], ..cache.clone() };
        let empty = RadianceCache::empty(cache.grid);
        Learnt {
            cache,
            training,
            unguided,
            hasty,
            haste,
            empty,
            allocation,
            even,
            pilot,
        }
    }
}

/// A run: its image and its rays per sample, with what it had to learn.
struct Run {
    film: Film,
    rays: f64,
}

impl Stage {
    /// Renders scrambles with what was learnt, and without a part.
    fn gather(
        &self,
        without: &Estimator,
        seed: u64,
        scrambles: u64,
    ) -> Run {
        let mut film = self.film(&self.sampling(Method::Gather, seed));
        let &Estimator { cache, ref allocation, correction, .. } = without;
        let gather = &Gather { correction, ..self.renderer(seed) };
        let render = |part: FilmTile| {
            let FilmTile { tile, pixels, mut mean, .. } = part;
            let mut tracer = tracer(gather, cache, allocation);
            for scramble in 0..scrambles {
                let values = tracer.tile(tile, scramble).means;
                if let Some(mean) = &mut mean {
                    let sum: f64 = values.iter().sum();
                    mean.add(sum / values.len() as f64);
                }
                let both = pixels.iter_mut().zip(values);
                both.for_each(|(pixel, value)| pixel.add(value));
            }
            tracer.rays
        };
        let tiles = film.tiles().into_par_iter().with_max_len(1);
        let traced: u64 = tiles.map(render).sum();
        let per_pixel = (scrambles * film.net_size) as f64;
        let each = traced as f64 / per_pixel;
        let learning = without.learning as f64 / self.samples as f64;
        let rays = (each + learning) / film.area() as f64;
        Run { film, rays }
    }

    /// Renders by paths in nets.
    fn trace(&self, seed: u64) -> Run {
        let sampling = self.sampling(Method::Sobol, seed);
        let mut film = self.film(&sampling);
        let Job { sensor, intersector, integrator, known_pixels, .. } =
            self.setting.job(0);
        let sampler = SobolSampler::new(seed, sampling.net_size);
        let mut job =
            Job { sensor, intersector, integrator, known_pixels, sampler };
        let traced = job.pass(&mut film, self.samples, &|_| true);
        let samples = self.samples * film.area();
        Run { film, rays: traced as f64 / samples as f64 }
    }
}

/// What some runs have in common.
struct Outcome {
    rays: f64,
    /// The variance of a sample, from the differences of the runs.
    variance: f64,
    /// The same as the runs claim it.
    claimed: f64,
    mean: f64,
    /// The square of the standard error of the mean.
    square: f64,
}

impl Outcome {
    fn of(runs: &[Run]) -> Self {
        let n = runs.len() as f64;
        let mean =
            |f: &dyn Fn(&Run) -> f64| runs.iter().map(f).sum::<f64>() / n;
        let samples = |run: &Run| run.film.samples() as f64;
        Self {
            rays: mean(&|run| run.rays),
            variance: samples(&runs[0]) * scatter(runs),
            claimed: mean(&|run| {
                samples(run) * run.film.summary().rmse.powi(2)
            }),
            mean: mean(&|run| run.film.summary().mean),
            square: mean(&|run| run.film.summary().mean_stderr.powi(2)) / n,
        }
    }
}

/// The variance of a pixel among runs, on average over the pixels.
fn scatter(runs: &[Run]) -> f64 {
    let images: Vec<Vec<f64>> =
        runs.iter().map(|run| run.film.means().collect()).collect();
    let area = images[0].len();
    let variance = |i: usize| {
        let mut pixel = Accumulator::default();
        images.iter().for_each(|image| pixel.add(image[i]));
        pixel.variance()
    };
    (0..area).map(variance).sum::<f64>() / area as f64
}

/// The mean of all outcomes but one, each with its precision as its weight,
/// and the square of its error. What is not corrected does not count.
fn without_it(all: &[Outcome], one: usize) -> (f64, f64) {
    let (mut sum, mut weights) = (0., 0.);
    for (part, outcome) in all.iter().enumerate() {
        if part != one && PARTS[part] != "correction" {
            sum += outcome.mean / outcome.square;
            weights += 1. / outcome.square;
        }
    }
    (sum / weights, 1. / weights)
}

impl Stage {
    /// A run without a part, with what run `i` has learnt.
    fn without(&self, learnt: &Learnt, part: usize, i: u64) -> Run {
        let seed = (part as u64 + 1) * RUNS + i;
        let sampling = self.sampling(Method::Gather, seed);
        let scrambles = self.samples.div_ceil(sampling.net_size);
        match PARTS[part] {
            "everything" => self.trace(seed),
            "cache" => {
                let few = (scrambles / 8).max(2);
                self.gather(&learnt.without("cache"), seed, few)
            }
            name => self.gather(&learnt.without(name), seed, scrambles),
        }
    }
}

pub fn run(arguments: &[String]) -> Done {
    let name = std::iter::once("parts");
    let words = name.chain(arguments.iter().map(String::as_str));
    let plan = Options::parse(words).and_then(|it| it.plan(None, false));
    let plan = plan.map_err(|error| format!("{error:?}"))?;
    let input = &plan.scene;
    let camera = plan.camera().ok_or("name a camera")?;
    let (mesh, view) = (
        read_obj(&fs::read(input)?)?,
        camera.view(plan.up.unwrap_or(glam::DVec3::Z)),
    );
    let (width, height) = camera.resolution;
    let aspect = f64::from(width) / f64::from(height);
    let stage = Stage {
        setting: Setting::new(
            &mesh,
            (plan.surfaces.albedo, view.up),
            &view,
            aspect,
        )?,
        resolution: camera.resolution,
        samples: plan.budget.samples.unwrap_or(SAMPLES),
    };
    let replicate = stage.sampling(Method::Gather, 0).net_size;
    let mut runs = PARTS.map(|_| vec![]);
    let mut bytes = PARTS.map(|_| None);
    for i in 0..RUNS {
        let learnt = stage.learn(i);
        for (part, runs) in runs.iter_mut().enumerate() {
            runs.push(stage.without(&learnt, part, i));
            bytes[part] = learnt.bytes(PARTS[part], replicate);
        }
    }
    let all = runs.map(|runs| Outcome::of(&runs));
    println!("scene,part,bytes,rays,claimed,error,cost,z");
    let name = input.file_stem().unwrap_or_default().to_string_lossy();
    for (part, (bytes, outcome)) in bytes.iter().zip(&all).enumerate() {
        let cost = |o: &Outcome| o.variance * o.rays;
        let error =
            |variance: f64| (variance / stage.samples as f64).sqrt();
        let (mean, square) = without_it(&all, part);
        let z = (outcome.mean - mean) / (outcome.square + square).sqrt();
        let bytes = bytes.map_or_else(String::new, |n| n.to_string());
        println!(
            "{name},{},{bytes},{:.2},{:.3e},{:.3e},{:.3},{z:.2}",
            PARTS[part],
            outcome.rays,
            error(outcome.claimed),
            error(outcome.variance),
            cost(outcome) / cost(&all[0]),
        );
    }
    Ok(())
}
