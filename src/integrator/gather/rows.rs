// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Daylight coefficients by gathering from a cache whose cells have rows.
//!
//! Its bits belong to `GATHER_VERSION`.

use rand::RngExt;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::cache::{Grid, RadianceCache};
use super::training::train;
use super::{Allocation, End, Gather, Learnt, Tracer, tile_number};
use crate::bvh::{Dispatch, Hit, Intersector};
use crate::film::{Entry, Film, FilmTile, Tile, Watch};
use crate::integrator::{MANY_BOUNCES, ROULETTE_THRESHOLD};
use crate::integrator::{Renderer, survival};
use crate::sampler::generator;
use crate::sampler::sobol::{ScrambledNet, scramble_key};
use crate::sensor::Sensor;
use crate::tally::REPLICATES;

/// Renders the rows of a tally by gathering.
pub struct RowGather<'a>(pub Gather<'a>);

impl Renderer for RowGather<'_> {
    fn learn(&mut self, film: &mut Film, watch: &Watch) -> u64 {
        let Self(gather) = self;
        if gather.learnt.get().is_some() {
            return 0;
        }
        let learn = Learn { gather, film, watch };
        let found = gather.intersector.dispatch(learn);
        gather.communicator.all_gather(&[], watch);
        let Some((learnt, rays)) = found else { return 0 };
        let _ = gather.learnt.set(learnt);
        rays
    }

    fn training_rays(&self, _area: u64) -> u64 {
        let Gather { learnt, training, .. } = &self.0;
        if learnt.get().is_some() { 0 } else { *training }
    }

    fn pass(&mut self, film: &mut Film, end: u64, watch: &Watch) -> u64 {
        let rays = self.learn(film, &|_| watch(0));
        let Self(gather) = self;
        let Some(learnt) = gather.learnt.get() else { return rays };
        let pass = Pass { gather, learnt, film, end, watch };
        rays + gather.intersector.dispatch(pass)
    }
}

/// Learning that waits for its intersector.
struct Learn<'a> {
    gather: &'a Gather<'a>,
    film: &'a Film,
    watch: &'a Watch<'a>,
}

impl Dispatch for Learn<'_> {
    type Output = Option<(Learnt, u64)>;

    fn with<K: Intersector>(self, intersector: &K) -> Self::Output {
        let Self { gather, film, watch } = self;
        let allocation = Allocation::even(film.run_window, film.net_size);
        let cache = &RadianceCache::empty(Grid::around(&[]));
        let tracer = Tracer::new(gather, intersector, cache, &allocation);
        let (cache, rays) = train(&tracer, watch)?;
        let (cache, twin, pilot) = (cache.into(), None, vec![]);
        let learnt = Learnt { cache, allocation, twin, pilot };
        watch(0).then_some((learnt, rays))
    }
}

/// A pass that waits for its intersector.
struct Pass<'a> {
    gather: &'a Gather<'a>,
    learnt: &'a Learnt,
    film: &'a mut Film,
    end: u64,
    watch: &'a Watch<'a>,
}

impl Dispatch for Pass<'_> {
    type Output = u64;

    fn with<K: Intersector>(self, intersector: &K) -> u64 {
        let Self { gather, learnt, film, end, watch } = self;
        let Learnt { cache, allocation, .. } = learnt;
        let prototype = Tracer::new(gather, intersector, cache, allocation);
        let size = film.net_size;
        let first = film.sample_offset / size;
        let end = first + end.div_ceil(size);
        // Render the rows of a tile
        let render = |part: FilmTile| {
            let FilmTile { tile, pixels, rows, mut mean, .. } = part;
            let begin = first + pixels[0].count();
            let values: Vec<u64> = (begin..end).collect();
            let mut rays = 0;
            for values in values.chunks(REPLICATES as usize) {
                let found = values.par_iter().map(|&value| {
                    let tracer = Tracer { ..prototype };
                    RowTracer::new(tracer, tile, value).replicate(watch)
                });
                let found: Option<Vec<_>> = found.collect();
                let Some(found) = found else { break };
                // Add the rows of some replicates
                for (&value, (means, traced)) in values.iter().zip(found) {
                    let column =
                        (value % REPLICATES) * cache.columns as u64;
                    let pixels = pixels.iter_mut().zip(&mut *rows);
                    let mut sum = 0.;
                    for ((pixel, row), means) in
                        pixels.zip(means.chunks(cache.columns))
                    {
                        let light = means[1..].iter().sum();
                        pixel.add(light);
                        row.extend(Entry::dense(
                            column as u32,
                            size,
                            means,
                        ));
                        sum += light;
                    }
                    let light = sum / tile.area() as f64;
                    mean.iter_mut().for_each(|mean| mean.add(light));
                    rays += traced;
                }
                rows.iter_mut().for_each(|row| Entry::add_all(row, &[]));
                watch(size * (values.len() * pixels.len()) as u64);
            }
            rays
        };
        let tiles = film.tiles().into_par_iter();
        tiles.with_max_len(1).map(render).sum()
    }
}

/// Rays that gather at a place whose error is estimated, and at each further
/// one of its path.
const GATHERS: [u32; 2] = [32, 16];

/// The rays of corrections for each ray of a gather, roughly.
const CORRECTION: f64 = 0.5;

/// Renders a replicate of a tile.
struct RowTracer<'t, K> {
    tracer: Tracer<'t, K>,
    tile: Tile,
    /// The number of the replicate.
    number: u64,
    random: Pcg64,
    /// The weights of the rows that are to be added, by the entries of their
    /// cells, and the entries of those that are not zero.
    weights: Vec<f64>,
    touched: Vec<usize>,
}

/// The entries of cells around a hit on both sides of its surface, if there
/// are such, and what they count: parts of the largest albedo.
type Sides = [(Option<usize>, f64); 2];

/// A surface where a ray has ended.
struct Met {
    hit: Hit,
    /// The cells around it.
    sides: Sides,
    /// The weight of what it reflects.
    weight: f64,
    /// About how much may be wrong about that.
    importance: f64,
}

impl<'t, K: Intersector> RowTracer<'t, K> {
    fn new(tracer: Tracer<'t, K>, tile: Tile, number: u64) -> Self {
        let seed = tracer.gather.seed;
        let random = generator(seed, tile_number(tile.corner), number);
        let weights = vec![0.; tracer.cache.cells.len()];
        Self { tracer, tile, number, random, weights, touched: vec![] }
    }

    /// The rows of the pixels of the tile, and the rays traced; none if `watch`
    /// stops it.
    fn replicate(mut self, watch: &Watch) -> Option<(Vec<f64>, u64)> {
        let Allocation { counts, net, .. } = self.tracer.allocation;
        let &Gather { view, seed, .. } = self.tracer.gather;
        let Sensor::Receivers(receivers) = view.sensor else { return None };
        let columns = self.tracer.cache.columns;
        let mut rows = vec![0.; self.tile.area() * columns];
        let (mut places, mut met, mut count) = (vec![], vec![], 1);
        for (pixel, row) in (0..).zip(rows.chunks_mut(columns)) {
            watch(0).then_some(())?;
            let (_, y, i) = self.tracer.allocation.place(self.tile, pixel);
            let key = scramble_key(seed, u64::from(y), self.number);
            let first = net.pair(key, 0, 0);
            places.push(receivers.hit(y as usize, first));
            count = counts[i];
            for n in 0..count {
                let [place, u] = [0, 1].map(|k| net.pair(key, n, k));
                let x = receivers.hit(y as usize, place);
                self.gather(&x, 1. / f64::from(count), u, row, &mut met);
            }
            met.clear();
            self.add_cells(row);
        }
        self.correct(&places, count, &mut rows, watch)?;
        Some((rows, self.tracer.rays))
    }

    /// Sends a ray from `x`, and adds what it meets, with a weight, to a row, or
    /// to the cells that will be added to it.
    fn gather(
        &mut self,
        x: &Hit,
        weight: f64,
        mut u: [u32; 2],
        row: &mut [f64],
        met: &mut Vec<Met>,
    ) {
        let Self { tracer, random, .. } = self;
        let side = tracer.lit_side(x, &mut u);
        let cell = tracer.cell_at(&side);
        let guide = tracer.cache.guide(&cell);
        let ray = tracer.trace_gather_ray(&side, guide, u);
        let weight = weight * ray.weight;
        match (ray.end, tracer.gather.patches) {
            (End::Sky(_), Some(patches)) => {
                let patch = patches.number(ray.direction);
                row[patch as usize] += weight;
            }
            (End::Sky(_), None) => (),
            (End::Hit(hit), _) => {
                let u = [random.random(), random.random()];
                let sides = self.sides(&hit, u);
                let importance = self.add(sides, weight);
                met.push(Met { hit, sides, weight, importance });
            }
        }
    }

    /// One of the four cells around a hit, at random; around a sheet that
    /// transmits, one on each side.
    fn sides(&self, hit: &Hit, u: [f64; 2]) -> Sides {
        let RadianceCache { grid, .. } = self.tracer.cache;
        let surfaces = &self.tracer.gather.view.surfaces;
        let entry = |normal| {
            let name = grid.name_around(hit.point, normal, u);
            self.tracer.cache.place(name)
        };
        match surfaces.sheet(hit.primitive) {
            None => {
                let part = surfaces.relative_albedo(hit.primitive);
                [(entry(hit.normal), part), (None, 0.)]
            }
            Some(parts) => {
                let [back, on] = parts.map(|part| part / surfaces.most);
                [(entry(hit.normal), back), (entry(-hit.normal), on)]
            }
        }
    }

    /// Has the rows of cells added with a weight. Returns about how much may be
    /// wrong about them.
    fn add(&mut self, sides: Sides, weight: f64) -> f64 {
        let mut importance = 0.;
        for (entry, part) in sides {
            let weight = weight * part;
            let Some(entry) = entry else {
                importance += weight.abs();
                continue;
            };
            if self.weights[entry] == 0. {
                self.touched.push(entry);
            }
            self.weights[entry] += weight;
            let cell = &self.tracer.cache.cells[entry];
            importance += weight.abs() * f64::from(cell.value + cell.error);
        }
        importance
    }

    /// Adds the rows of cells to a row.
    fn add_cells(&mut self, row: &mut [f64]) {
        for entry in self.touched.drain(..) {
            let weight = self.weights[entry];
            self.weights[entry] = 0.;
            let values = self.tracer.cache.row(entry);
            for (sum, value) in row.iter_mut().zip(values) {
                *sum += weight * f64::from(*value);
            }
        }
    }

    /// Corrects the rows of sensors, given a place of each, after so many samples
    /// of each; none if `watch` stops it.
    fn correct(
        &mut self,
        places: &[Hit],
        samples: u32,
        rows: &mut [f64],
        watch: &Watch,
    ) -> Option<()> {
        let (group, columns) =
            (places.len() as f64, self.tracer.cache.columns);
        let rays = CORRECTION * group * f64::from(samples);
        let points = (rays / (64. + 0.5 * group)).ceil();
        let net = ScrambledNet::new((points as u64).next_power_of_two());
        let (key, mut error) = (self.random.random(), vec![0.; columns]);
        for n in 0..points as u32 {
            watch(0).then_some(())?;
            // Find a place that a sensor sees
            let along = f64::from(n) + self.random.random::<f64>();
            let k = (along / points * group) as usize;
            let (k, u) = (k.min(places.len() - 1), net.pair(key, n, 0));
            let ray = self.tracer.trace_gather_ray(&places[k], None, u);
            let End::Hit(y) = ray.end else { continue };
            error.fill(0.);
            self.error_at(y, &mut error);
            // Share the error among the sensors
            let factor = |(i, x): (usize, &Hit)| {
                self.tracer.form_factor(x, &y, i == k)
            };
            let factors = places.iter().enumerate().map(factor);
            let factors: Vec<f64> = factors.collect();
            let density = factors.iter().sum::<f64>() * points / group;
            for (row, factor) in rows.chunks_mut(columns).zip(factors) {
                if factor > 0. {
                    let weight = ray.weight * factor / density;
                    for (sum, error) in row.iter_mut().zip(&error) {
                        *sum += weight * error;
                    }
                }
            }
        }
        Some(())
    }

    /// Adds an unbiased estimate of the error at `y` to a row.
    fn error_at(&mut self, y: Hit, row: &mut [f64]) {
        let u = [self.random.random(), self.random.random()];
        let (mut hit, mut sides, mut throughput) =
            (y, self.sides(&y, u), 1.);
        let (net, mut met) = (self.tracer.allocation.net, vec![]);
        for bounce in 0.. {
            self.add(sides, -throughput);
            // Gather the row that the place reflects
            let surfaces = &self.tracer.gather.view.surfaces;
            throughput *= surfaces.albedo(hit.primitive);
            let rays = GATHERS[usize::from(bounce > 0)];
            let weight = throughput / f64::from(rays);
            let key = self.random.random();
            met.clear();
            for n in 0..rays {
                self.gather(
                    &hit,
                    weight,
                    net.pair(key, n, 0),
                    row,
                    &mut met,
                );
            }
            // Choose the end from which a path goes on
            let total: f64 = met.iter().map(|end| end.importance).sum();
            let mut rest = self.random.random::<f64>() * total;
            let chosen = met.iter().find(|end| {
                rest -= end.importance;
                rest < 0.
            });
            let Some(end) = chosen else { break };
            throughput = end.weight * total / end.importance;
            (hit, sides) = (end.hit, end.sides);
            // Play Russian roulette
            let long =
                if bounce < MANY_BOUNCES { 1. } else { survival(bounce) };
            let probability =
                (throughput / ROULETTE_THRESHOLD).min(1.) * long;
            if self.random.random::<f64>() >= probability {
                break;
            }
            throughput /= probability;
        }
        self.add_cells(row);
    }
}
