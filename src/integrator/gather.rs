// Tangled from chapters/gather.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Final gather into a cache of radiance, and its unbiased correction.
//!
//! [`training`] learns, once, a [`cache`] of the radiance that leaves the
//! surfaces, with a [`guide`] of directions for each place, and then how many
//! samples each pixel deserves. [`render`] has [`Tracer::tile`] render each
//! tile once for each replicate, here a scramble: a sample sends one ray from
//! its first hit, and takes the radiance of its end from the cache.
//! [`correction`] estimates how wrong the cache is at some of these ends, and
//! shares that among the samples of a group that see them. A pixel errs by
//! chance alone: by where its samples and their rays go, and by corrections.
//!
//! Its bits belong to `GATHER_VERSION`.

pub mod cache;
pub mod correction;
pub mod guide;
pub mod render;
pub mod rows;
pub mod sunlight;
pub mod training;

use std::array;
use std::sync::{Arc, OnceLock};

use glam::DVec3;
use rand::RngExt;

use crate::analysis::LitView;
use crate::analysis::background::{KnownPixels, TileContent};
use crate::bvh::{BEAM, Bvh, Hit, Intersector};
use crate::film::{ErrorNorm, Samples, Tile, Window};
use crate::film::{Fragments, Gathered, TileFragments};
use crate::integrator::Communicator;

use crate::sampler::sobol::{ScrambledNet, scramble_key};
use crate::sampler::{generator, to_unit};

use crate::sensor::Starts;
use crate::tally::patches::Patches;
use cache::{Cell, RadianceCache, UNSEEN};
use guide::{Guide, bin, direction};

/// Renders by gathering, with what a training has learnt.
pub struct Gather<'a> {
    /// The view of the scene, and its light.
    pub view: LitView<'a>,
    /// Finds hits in the scene.
    pub intersector: &'a Bvh,
    /// The pixels whose radiance is known beforehand.
    pub known_pixels: &'a KnownPixels,
    /// Chooses all random numbers.
    pub seed: u64,
    /// The error for which the samples are distributed.
    pub norm: ErrorNorm,
    /// The patches of the sky, if the cache learns a row for each cell.
    pub patches: Option<&'a Patches>,
    /// At most about as many rays train the cache.
    pub training: u64,
    /// How much is corrected; none leaves the error of the cache.
    pub correction: Option<Correction>,
    /// The result of [`Renderer::learn`](crate::integrator::Renderer::learn),
    /// here or in another run like this one.
    pub learnt: Arc<OnceLock<Learnt>>,
    /// The processes that learn the same.
    pub communicator: &'a dyn Communicator,
}

/// A cache, and how the samples are distributed.
#[derive(Debug, PartialEq)]
pub struct Learnt {
    /// The radiance and the guides of the scene.
    pub cache: Arc<RadianceCache>,
    /// The samples of each pixel.
    pub allocation: Allocation,
    /// Another cache, for odd replicates, if there is one: it makes the
    /// halves of a picture independent.
    pub twin: Option<Arc<RadianceCache>>,
    /// The light that a pilot has gathered for the fragments of each tile, in
    /// the order of the run's tiles: sum and number of both halves. Empty for
    /// a tile whose fragments were not known.
    pub pilot: Vec<Vec<Gathered>>,
}

/// Gathers on one thread: a tile, or a piece of the training.
pub struct Tracer<'a, K> {
    /// The scene and its view, and how much is corrected.
    pub gather: &'a Gather<'a>,
    /// Finds hits in the scene.
    pub intersector: &'a K,
    /// Chooses directions, and approximates the radiance.
    pub cache: &'a RadianceCache,
    /// How the samples are distributed.
    pub allocation: &'a Allocation,
    /// The surfaces that the pixels show, if samples are sorted by them.
    pub fragments: Option<&'a Fragments>,
    /// The rays traced so far.
    pub rays: u64,
}

/// The samples of a tile in a scramble.
#[derive(Default)]
pub struct TileSamples {
    /// The mean of each pixel.
    pub means: Vec<f64>,
    /// The part of it that corrections have added.
    pub corrections: Vec<f64>,
    /// The samples of each fragment, if they are sorted.
    pub sorted: Vec<Samples>,
    /// Those that gather.
    pub samples: Vec<Sample>,
}

impl<'a, K> Tracer<'a, K> {
    /// A tracer that has traced nothing, and sorts no samples.
    pub fn new(
        gather: &'a Gather<'a>,
        intersector: &'a K,
        cache: &'a RadianceCache,
        allocation: &'a Allocation,
    ) -> Self {
        let fragments = None;
        Self { gather, intersector, cache, allocation, fragments, rays: 0 }
    }
}

/// The end of a ray.
#[derive(Clone, Copy, Debug)]
pub enum End {
    /// The sky, of this radiance, or what is below the horizon.
    Sky(f64),
    /// A surface.
    Hit(Hit),
}

/// A ray from a surface.
pub struct GatherRay {
    /// Its direction.
    pub direction: DVec3,
    /// One over the density of its direction on the square, times what
    /// panes transmit.
    pub weight: f64,
    /// The bin of its direction.
    pub bin: usize,
    /// Its end.
    pub end: End,
}

/// How the samples are distributed over a window, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Allocation {
    /// The part of the image that is rendered.
    pub window: Window,
    /// The samples of each pixel in a scramble: at least one, and a
    /// replicate on average.
    pub counts: Vec<u32>,
    /// About the radiance of each pixel; positive.
    pub scale: Vec<f64>,
    /// The points of a scramble, enough for the pixel with most samples.
    pub net: ScrambledNet,
}

impl Allocation {
    /// An allocation of these samples and radiances to the pixels of a window.
    pub fn new(window: Window, counts: Vec<u32>, scale: Vec<f64>) -> Self {
        let most = counts.iter().max().copied().unwrap_or(1);
        let points = u64::from(most).max(64).next_power_of_two();
        let net = ScrambledNet::new(points);
        Self { window, counts, scale, net }
    }

    /// The same number of samples for each pixel.
    pub fn even(window: Window, samples: u64) -> Self {
        let area = window.area();
        Self::new(window, vec![samples as u32; area], vec![1.; area])
    }

    /// Column and row of a pixel of a tile in the image, and its number in
    /// the window.
    pub fn place(&self, tile: Tile, pixel: u32) -> (u32, u32, usize) {
        let x = tile.corner.0 + pixel % tile.size.0;
        let y = tile.corner.1 + pixel / tile.size.0;
        let (left, top) = self.window.corner;
        let row = (y - top) as usize * self.window.size.0 as usize;
        (x, y, row + (x - left) as usize)
    }
}

/// How much is corrected, and with how many rays.
#[derive(Clone, Copy, Debug)]
pub struct Correction {
    /// Samples of a tile that share corrections, at most.
    pub group: usize,
    /// The importance for which one correction is drawn: the error that its
    /// cell expects, as a part of the radiance of the pixel.
    pub step: f64,
    /// Rays of the gather at a point whose error is estimated.
    pub gathers: u32,
    /// Paths that go on from their ends, to estimate the errors there.
    pub paths: u32,
    /// Rays of the gather at each point of such a path.
    pub branches: u32,
}

impl Default for Correction {
    fn default() -> Self {
        Self { group: 128, step: 20., gathers: 16, paths: 16, branches: 2 }
    }
}

/// A sample that gathers: where it looks, and what its ray has found.
pub struct Sample {
    /// The first hit of the path.
    pub hit: Hit,
    /// The albedo there, times what panes before it transmit.
    pub albedo: f64,
    /// The pixel in its tile.
    pub pixel: u32,
    /// The fragment of the tile for which it counts, if for any.
    pub fragment: Option<u32>,
    /// Its number among the samples of the pixel in a scramble.
    pub number: u32,
    /// About the radiance of the pixel; positive.
    pub scale: f64,
    /// The weight of the direction of the gather.
    pub weight: f64,
    /// The hit of the gather, if there is one, and a cell around it.
    pub end: Option<(Hit, Cell)>,
    /// The light of the sun that it reflects.
    pub sunlight: f64,
    /// The point of the square from which the gather is drawn.
    pub u: [u32; 2],
}

/// Numbers the generators of tiles; those of pixels are below 2^28.
fn tile_number((x, y): (u32, u32)) -> u64 {
    (1 << 32) + (u64::from(y) << 16) + u64::from(x)
}

impl<K: Intersector> Tracer<'_, K> {
    /// Traces the ray that leaves `x` in the direction that the guide gives to
    /// a uniform point of the square, in units of 2^-32.
    #[inline]
    pub fn trace_gather_ray(
        &mut self,
        x: &Hit,
        guide: Option<&Guide>,
        u: [u32; 2],
    ) -> GatherRay {
        // Choose a point of the square and its weight
        let (point, bin, weight) = match guide {
            Some(guide) => {
                let (point, bin) = guide.warp(u);
                (point, bin, 1. / guide.density(bin))
            }
            None => {
                let point = u.map(to_unit);
                (point, bin(point), 1.)
            }
        };
        let direction = direction(x.normal, point);
        let (hit, transmittance) = self.first_hit(x, direction);
        let weight = weight * transmittance;
        let sky = || End::Sky(self.gather.view.sky.dim_radiance(direction));
        let end = hit.map_or_else(sky, End::Hit);
        GatherRay { direction, weight, bin, end }
    }

    /// The cell of a hit, for a surface of the largest albedo.
    #[inline]
    pub fn cell_at(&self, hit: &Hit) -> Cell {
        *self.cache.at(self.cache.grid.name(hit.point, hit.normal))
    }

    /// One of the four cells around a hit, at random, with value and error of a
    /// surface that has the albedo of the hit: `u` is uniform over the square.
    #[inline]
    pub fn cell_around(&self, hit: &Hit, u: [f64; 2]) -> Cell {
        let surfaces = &self.gather.view.surfaces;
        if let Some(parts) = surfaces.sheet(hit.primitive) {
            return self.sheet_around(hit, u, parts);
        }
        let grid = &self.cache.grid;
        let cell =
            *self.cache.at(grid.name_around(hit.point, hit.normal, u));
        cell.scaled(surfaces.relative_albedo(hit.primitive) as f32)
    }

    /// The name of that cell.
    #[inline]
    pub fn name_around(&self, hit: &Hit, [mut u, v]: [f64; 2]) -> u64 {
        let side = self.gather.view.surfaces.lit_side(hit, &mut u);
        let grid = &self.cache.grid;
        grid.name_around(hit.point, side.normal, [u, v])
    }

    /// The first hit of a sample at (`x`, `y`) of the image, if it has one.
    #[inline]
    pub fn trace_primary(&mut self, x: f64, y: f64) -> Option<Hit> {
        let LitView { sensor, surfaces, .. } = &self.gather.view;
        let start = sensor.start(self.intersector, surfaces, (x, y));
        self.rays += start.rays;
        start.hit
    }

    /// The samples of a tile that gather; the others show the sky.
    fn begin(
        &mut self,
        tile: Tile,
        scramble: u64,
        sums: &mut [f64],
        fragments: Option<&TileFragments>,
    ) -> Vec<Sample> {
        let &Gather { view, known_pixels, seed, .. } = self.gather;
        let mut looks = vec![];
        // Draw all samples of a tile
        for pixel in 0..tile.size.0 * tile.size.1 {
            let Allocation { counts, scale, net, .. } = self.allocation;
            let (x, y, number) = self.allocation.place(tile, pixel);
            let i =
                u64::from(y) * u64::from(view.resolution.0) + u64::from(x);
            let key = scramble_key(seed, i, scramble);
            for n in 0..counts[number] {
                let [place, u] = [0, 1].map(|k| net.pair(key, n, k));
                looks.push((((x, y), place), (pixel, n), scale[number], u));
            }
        }
        let is_sky = known_pixels.content(tile.corner) == TileContent::Sky;
        let mut samples = vec![];
        // Send the first rays in beams
        for batch in looks.chunks(BEAM) {
            let places = array::from_fn(|i| Some(batch.get(i)?.0));
            let (intersector, size) = (self.intersector, view.resolution);
            let (sensor, surfaces) = (view.sensor, &view.surfaces);
            let Starts { directions, hits, transmittances, rays } =
                sensor.starts(intersector, surfaces, &places, size, is_sky);
            self.rays += rays;
            for (i, &look) in batch.iter().enumerate() {
                let (direction, hit) = (directions[i], hits[i]);
                // Start a sample or show the sky
                let (_, (pixel, number), scale, mut u) = look;
                let Some(hit) = hit else {
                    let radiance = view.sky.seen(direction);
                    sums[pixel as usize] += transmittances[i] * radiance;
                    continue;
                };
                let albedo =
                    transmittances[i] * surfaces.albedo(hit.primitive);
                let (weight, end, sunlight) = (1., None, 0.);
                let fragment =
                    fragments.and_then(|it| it.place(pixel, &hit));
                let hit = self.lit_side(&hit, &mut u);
                samples.push(Sample {
                    hit,
                    albedo,
                    pixel,
                    fragment,
                    number,
                    scale,
                    weight,
                    end,
                    sunlight,
                    u,
                });
            }
        }
        samples
    }

    /// The samples of a tile in a scramble.
    pub fn tile(&mut self, tile: Tile, scramble: u64) -> TileSamples {
        let area = tile.size.0 * tile.size.1;
        let &Gather { known_pixels, seed, .. } = self.gather;
        if let TileContent::Constant(value) =
            known_pixels.content(tile.corner)
        {
            let area = area as usize;
            let sort =
                |it: &Fragments| vec![([value, 0.], 1); it.count(&tile)];
            let sorted = self.fragments.map_or(vec![], sort);
            let (means, corrections) = (vec![value; area], vec![0.; area]);
            return TileSamples {
                means,
                corrections,
                sorted,
                samples: vec![],
            };
        }
        let stream = tile_number(tile.corner);
        let mut random = generator(seed, stream, scramble);
        let mut sums = vec![0.; area as usize];
        let fragments = self.fragments.map(|it| it.in_tile(&tile));
        let fragments = fragments.as_ref();
        let mut samples = self.begin(tile, scramble, &mut sums, fragments);
        // Trace the gather rays of all samples
        let cache = self.cache;
        let cell = |sample: &Sample| self.cell_at(&sample.hit);
        let cells: Vec<Cell> = samples.iter().map(cell).collect();
        let mut parts = vec![[0.; 2]; samples.len()];
        for ((sample, cell), [gathered, _]) in
            samples.iter_mut().zip(&cells).zip(&mut parts)
        {
            let ray = self.trace_gather_ray(
                &sample.hit,
                cache.guide(cell),
                sample.u,
            );
            sample.weight = ray.weight;
            match ray.end {
                End::Sky(radiance) => {
                    let radiance = sample.albedo * ray.weight * radiance;
                    sums[sample.pixel as usize] += radiance;
                    *gathered = radiance;
                }
                End::Hit(hit) => sample.end = Some((hit, UNSEEN)),
            }
        }
        // Add the light of the sun
        let sky = self.gather.view.sky;
        if sky.has_sun() {
            let smoothed = if sky.beam.is_none() { 1. } else { 0. };
            for (sample, [gathered, _]) in
                samples.iter_mut().zip(&mut parts)
            {
                let light = self.sunlight(&sample.hit, &mut random);
                sample.sunlight = sample.albedo * light;
                sums[sample.pixel as usize] += sample.sunlight;
                *gathered += smoothed * sample.sunlight;
            }
        }
        // Look up the cells that the rays have met
        for (Sample { albedo, pixel, weight, end, .. }, [gathered, _]) in
            samples.iter_mut().zip(&mut parts)
        {
            if let Some((hit, cell)) = end {
                let u = [random.random(), random.random()];
                *cell = self.cell_around(hit, u);
                let radiance = *albedo * *weight * f64::from(cell.value);
                sums[*pixel as usize] += radiance;
                *gathered += radiance;
            }
        }
        let mut corrections = sums.clone();
        self.correct(&samples, &mut random, &mut sums, &mut parts);
        for (pixel, sum) in (0..).zip(&mut sums) {
            let (_, _, number) = self.allocation.place(tile, pixel);
            let count = f64::from(self.allocation.counts[number]);
            let correction = &mut corrections[pixel as usize];
            *correction = (*sum - *correction) / count;
            *sum /= count;
        }
        // Sort the samples by the fragments that they show
        let count = fragments.map_or(0, |it| it.count);
        let mut sorted = vec![Samples::default(); count];
        for (sample, parts) in samples.iter().zip(parts) {
            let Some(fragment) = sample.fragment else { continue };
            let (sums, count) = &mut sorted[fragment as usize];
            *sums = [0, 1].map(|part| sums[part] + parts[part]);
            *count += 1;
        }
        TileSamples { means: sums, corrections, sorted, samples }
    }
}
