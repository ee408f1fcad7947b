// Tangled from chapters/correction.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The correction of a cache's error, shared among the samples of a group.
//!
//! The samples of a tile are sorted by place, and each of n groups takes
//! every n-th: all groups are spread over the tile alike.
//!
//! Its bits belong to `GATHER_VERSION`.

use std::f64::consts::PI;

use glam::DVec3;
use rand::RngExt;
use rand_pcg::Pcg64;

use super::cache::{Cell, UNSEEN};
use super::{Correction, End, Sample, Tracer};
use crate::bvh::{Hit, Intersector};
use crate::integrator::{MANY_BOUNCES, survival};
use crate::scene::Ray;

impl<K: Intersector> Tracer<'_, K> {
    /// Adds the corrections of the samples of a tile to the sums of its
    /// pixels.
    pub fn correct(
        &mut self,
        samples: &[Sample],
        random: &mut Pcg64,
        sums: &mut [f64],
        parts: &mut [[f64; 2]],
    ) {
        let Some(correction) = self.gather.correction else { return };
        // Divide the samples into groups
        let mut order: Vec<_> = (0..samples.len()).collect();
        let grid = &self.cache.grid;
        order.sort_by_cached_key(|&i| grid.order(&samples[i].hit));
        let count = samples.len().div_ceil(correction.group);
        let every =
            |g| order.iter().skip(g).step_by(count).copied().collect();
        let groups: Vec<Vec<usize>> = (0..count).map(every).collect();
        let tracer = self;
        let mut corrector =
            Corrector { tracer, correction, samples, random, sums, parts };
        groups.iter().for_each(|group| corrector.correct(group));
    }

    /// The part of the light from `y` that arrives at `x` from this direction:
    /// 0 if another triangle is in the way, unless that is a pane.
    fn visibility(&mut self, x: &Hit, y: &Hit, direction: DVec3) -> f64 {
        if x.primitive == y.primitive {
            return 0.;
        }
        let from = Some(x.primitive);
        if self.gather.view.surfaces.transmits {
            let (hit, transmittance) = self.first_hit(x, direction);
            let met = hit.map(|hit| hit.primitive);
            let seen = met == Some(y.primitive);
            return if seen { transmittance } else { 0. };
        }
        self.rays += 1;
        let ray = Ray { origin: x.point, direction };
        let seen = self.intersector.is_visible(&ray, from, y.primitive);
        f64::from(seen)
    }

    /// The density with which cosine sampling at `x` finds `y`, per unit of
    /// area around `y`, times what panes transmit; zero if one faces away, or if
    /// `x` does not see `y`, which is not tested if it `is_seen`.
    pub fn form_factor(&mut self, x: &Hit, y: &Hit, is_seen: bool) -> f64 {
        let to = y.point - x.point;
        let square = to.length_squared();
        let (here, there) = (x.normal.dot(to), -y.normal.dot(to));
        let factor = here * there / (PI * square * square);
        let faces = here > 0. && factor > 0.;
        let clear = !self.gather.view.surfaces.transmits;
        match (faces, is_seen && clear) {
            (false, _) => 0.,
            (_, true) => factor,
            _ => factor * self.visibility(x, y, to / square.sqrt()),
        }
    }
}

/// Corrects the samples of a tile.
struct Corrector<'c, 't, K> {
    tracer: &'c mut Tracer<'t, K>,
    correction: Correction,
    samples: &'c [Sample],
    random: &'c mut Pcg64,
    /// The sums of the pixels of the tile.
    sums: &'c mut [f64],
    /// The gathered and the corrected part of each sample.
    parts: &'c mut [[f64; 2]],
}

impl<K: Intersector> Corrector<'_, '_, K> {
    /// Adds the corrections of a group, given the numbers of its samples.
    fn correct(&mut self, group: &[usize]) {
        let step = self.correction.step / CANDIDATES;
        let mut next = self.random.random::<f64>() * step;
        let mut reached = 0.;
        for &k in group {
            let Sample { albedo, weight, scale, ref end, .. } =
                self.samples[k];
            let Some((y, cell)) = end else { continue };
            let expected = f64::from(cell.error);
            reached += albedo * weight * expected / scale;
            let drawn = draws(&mut next, reached, step);
            if drawn == 0. {
                continue;
            }
            let probability = self.keep_probability(group, y);
            let draws = drawn * probability + self.random.random::<f64>();
            if draws >= 1. {
                let error = self.radiance(y, cell) - f64::from(cell.value);
                let each = draws.floor() / probability * step;
                self.distribute(group, k, each * error / expected);
            }
        }
    }

    /// The probability of keeping a draw at `y`: small if many of the group see
    /// it. The caller rounds the number of draws at random.
    fn keep_probability(&mut self, group: &[usize], y: &Hit) -> f64 {
        let mut seen = 0.5;
        for _ in 0..VISIBILITY_TESTS {
            let i = group[self.random.random_range(0..group.len())];
            let x = &self.samples[i].hit;
            if self.tracer.form_factor(x, y, false) > 0. {
                seen += 1.;
            }
        }
        let part = seen / (f64::from(VISIBILITY_TESTS) + 0.5);
        let fill = group.len() as f64 / self.correction.group as f64;
        (1. / (CANDIDATES * f64::sqrt(part * fill))).min(1.)
    }

    /// Shares the error of the place that sample `k` has met among all
    /// samples of its group that see it. The shares, each divided by the
    /// radiance of its pixel, add up to `total`.
    fn distribute(&mut self, group: &[usize], k: usize, total: f64) {
        let samples = self.samples;
        let Some((y, _)) = &samples[k].end else { return };
        // Find the form factors of those that see the place
        let albedos = group.iter().map(|&i| samples[i].albedo);
        let most = albedos.fold(0., f64::max);
        let factor = |&i: &usize| {
            let Sample { hit, albedo, .. } = &samples[i];
            self.tracer.form_factor(hit, y, i == k) * (albedo / most)
        };
        let factors: Vec<f64> = group.iter().map(factor).collect();
        let seen = || group.iter().zip(&factors);
        let density: f64 = seen().map(|(&i, f)| f / samples[i].scale).sum();
        if density > 0. {
            for (&i, factor) in seen() {
                let more = total * *factor / density;
                self.sums[samples[i].pixel as usize] += more;
                self.parts[i][1] += more;
            }
        }
    }

    /// An unbiased estimate of the radiance at `x`.
    fn radiance(&mut self, x: &Hit, cell: &Cell) -> f64 {
        let (mut ends, mut others) = (vec![], vec![]);
        let Correction { gathers, paths, .. } = self.correction;
        let mut sum = self.tracer.sunlight_of(x, self.random);
        sum += self.gather_at(x, cell, [gathers, paths], &mut ends);
        for Candidate { hit, cell, weight, .. } in ends {
            sum += weight * self.error_at(hit, cell, &mut others);
        }
        self.tracer.gather.view.surfaces.albedo(x.primitive) * sum
    }

    /// The mean radiance that rays from `x` find, according to the cache.
    /// Fills `ends` with those to correct: `paths` of them, each with the
    /// weight of its correction.
    fn gather_at(
        &mut self,
        x: &Hit,
        cell: &Cell,
        [rays, paths]: [u32; 2],
        ends: &mut Vec<Candidate>,
    ) -> f64 {
        let Self { tracer, random, .. } = self;
        let (mut sum, mut total) = (0., 0.);
        let (net, key) = (tracer.allocation.net, random.random());
        ends.clear();
        // Trace the rays that gather
        for n in 0..rays {
            let mut u = net.pair(key, n, 0);
            let side = tracer.lit_side(x, &mut u);
            let cell = if side.normal == x.normal {
                *cell
            } else {
                tracer.cell_at(&side)
            };
            let ray = tracer.trace_gather_ray(
                &side,
                tracer.cache.guide(&cell),
                u,
            );
            let weight = ray.weight / f64::from(rays);
            let (cell, importance) = (UNSEEN, 0.);
            match ray.end {
                End::Sky(radiance) => sum += weight * radiance,
                End::Hit(hit) => {
                    ends.push(Candidate { hit, cell, weight, importance });
                }
            }
        }
        // Look up what each ray has met
        for end in &mut *ends {
            let u = [random.random(), random.random()];
            end.cell = tracer.cell_around(&end.hit, u);
            let Cell { value, error, .. } = end.cell;
            sum += end.weight * f64::from(value);
            let size = f64::from(value.abs() + error);
            end.importance = end.weight * size.max(1e-12);
            total += end.importance;
        }
        // Choose the ends to correct
        let step = total / f64::from(paths);
        let mut next = random.random::<f64>() * step;
        let mut reached = 0.;
        ends.retain_mut(|end| {
            reached += end.importance;
            let draws = draws(&mut next, reached, step);
            end.weight *= draws * step / end.importance;
            draws > 0.
        });
        sum
    }

    /// An unbiased estimate of the error of a cell's value at `y`.
    fn error_at(
        &mut self,
        mut y: Hit,
        mut cell: Cell,
        ends: &mut Vec<Candidate>,
    ) -> f64 {
        let counts = [self.correction.branches, 1];
        let (mut throughput, mut error) = (1., 0.);
        for bounce in 0.. {
            error -= throughput * f64::from(cell.value);
            let mut sum = self.tracer.sunlight_of(&y, self.random);
            sum += self.gather_at(&y, &cell, counts, ends);
            let albedo =
                self.tracer.gather.view.surfaces.albedo(y.primitive);
            error += throughput * albedo * sum;
            let Some(end) = ends.pop() else { break };
            throughput *= albedo * end.weight;
            // Play Russian roulette
            let long =
                if bounce < MANY_BOUNCES { 1. } else { survival(bounce) };
            let probability =
                (throughput / ROULETTE_THRESHOLD).min(1.) * long;
            if self.random.random::<f64>() >= probability {
                break;
            }
            throughput /= probability;
            (y, cell) = (end.hit, end.cell);
        }
        error
    }
}

/// How many points from `next` on, `step` apart, lie below `reached`;
/// moves `next` behind them.
fn draws(next: &mut f64, reached: f64, step: f64) -> f64 {
    let draws = ((reached - *next) / step).ceil().max(0.);
    *next += draws * step;
    draws
}

/// Places that are drawn for each one corrected, if the whole group sees
/// them.
const CANDIDATES: f64 = 4.;

/// Samples of a group that are tested for seeing a place.
const VISIBILITY_TESTS: u32 = 8;

/// The end of a ray of a gather, which may be corrected.
struct Candidate {
    hit: Hit,
    cell: Cell,
    /// The weight of its radiance in the gather; once it is chosen, of its
    /// correction.
    weight: f64,
    /// It is chosen with a probability proportional to this: the weight
    /// times the value and the error of the cell.
    importance: f64,
}

/// The throughput below which roulette ends paths of corrections.
const ROULETTE_THRESHOLD: f64 = 0.2;
