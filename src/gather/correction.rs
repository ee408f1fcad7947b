// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The correction of a cache's error, shared among neighbouring samples.

use std::f64::consts::PI;

use glam::DVec3;
use rand::RngExt;
use rand_pcg::Pcg64;

use super::cache::{Cell, UNSEEN};
use super::{Correction, End, Plan, Sample, Tracer};
use crate::bvh::{Hit, Intersector};
use crate::integrator::{MANY_BOUNCES, onward};
use crate::sampler::sobol::ScrambledNet;
use crate::scene::Ray;

impl<K: Intersector> Tracer<'_, K> {
    /// Adds the corrections of the samples of a tile to the sums of its
    /// pixels.
    pub fn correct(
        &mut self,
        plan: &Plan,
        samples: &[Sample],
        random: &mut Pcg64,
        sums: &mut [f64],
    ) {
        let Some(correction) = &plan.correction else { return };
        // Put the samples in groups of neighbours
        let mut order: Vec<_> = (0..samples.len()).collect();
        let grid = self.cache.grid();
        order.sort_by_cached_key(|&i| grid.place(&samples[i].hit));
        let groups = samples.len().div_ceil(correction.group).max(1);
        let length = samples.len().div_ceil(groups).max(1);
        let mut seen = vec![];
        for group in order.chunks(length) {
            let mut next = random.random::<f64>() * correction.step;
            let mut reached = 0.;
            for &k in group {
                // Count the draws of a sample
                let Sample { weight, scale, ref end, .. } = samples[k];
                let Some((y, cell)) = end else { continue };
                let expected = f64::from(cell.error);
                reached += self.albedo * weight * expected / scale;
                let draws = draws(&mut next, reached, correction.step);
                // Correct what a sample has met
                if draws > 0. {
                    let known = f64::from(cell.value);
                    let error = self
                        .radiance(correction, y, cell, &plan.net, random)
                        - known;
                    let share = draws * correction.step * error / expected;
                    self.share(samples, group, k, share, &mut seen, sums);
                }
            }
        }
    }
}

/// How many points from `next` on, `step` apart, lie below `reached`;
/// moves `next` behind them.
fn draws(next: &mut f64, reached: f64, step: f64) -> f64 {
    let draws = ((reached - *next) / step).ceil().max(0.);
    *next += draws * step;
    draws
}

impl<K: Intersector> Tracer<'_, K> {
    /// Shares the error of what sample `k` has met among all samples of
    /// its group that see the place.
    fn share(
        &mut self,
        samples: &[Sample],
        group: &[usize],
        k: usize,
        share: f64,
        seen: &mut Vec<f64>,
        sums: &mut [f64],
    ) {
        let Some((y, _)) = &samples[k].end else { return };
        seen.clear();
        let mut density = 0.;
        for &i in group {
            // Add the density with which a sample finds the place
            let x = &samples[i];
            let (form, direction) = form(&x.hit, y);
            let visible =
                form > 0. && (i == k || self.sees(&x.hit, y, direction));
            seen.push(if visible { form } else { 0. });
            if visible {
                density += form / x.scale;
            }
        }
        // Give each sample its share
        if density > 0. {
            for (&i, form) in group.iter().zip(seen) {
                sums[samples[i].pixel as usize] += share * *form / density;
            }
        }
    }
}

impl<K: Intersector> Tracer<'_, K> {
    /// Whether the ray from `x` in this direction meets the triangle of `y`.
    fn sees(&mut self, x: &Hit, y: &Hit, direction: DVec3) -> bool {
        if x.primitive == y.primitive {
            return false;
        }
        self.rays += 1;
        let ray = Ray { origin: x.point, direction };
        let from = Some(x.primitive);
        self.intersector.is_visible(&ray, from, y.primitive)
    }
}

/// The density with which cosine sampling at `x` finds `y`, per unit of
/// area around `y`; zero if one faces away. And the direction.
fn form(x: &Hit, y: &Hit) -> (f64, DVec3) {
    let to = y.point - x.point;
    let square = to.length_squared();
    let (near, far) = (x.normal.dot(to), -y.normal.dot(to));
    if !(near > 0. && far > 0.) {
        return (0., to);
    }
    (near * far / (PI * square * square), to / square.sqrt())
}

/// The end of a ray of a gather, which may be corrected.
struct Candidate {
    hit: Hit,
    cell: Cell,
    /// With which its radiance counts in the gather.
    weight: f64,
    importance: f64,
}

impl Candidate {
    fn new(hit: Hit, weight: f64) -> Self {
        Self { hit, cell: UNSEEN, weight, importance: 0. }
    }
}

impl<K: Intersector> Tracer<'_, K> {
    /// The mean of what comes from rays that leave `x`, as far as the cache
    /// knows it. Fills in which of their ends to correct: `paths` of them,
    /// each with the weight of its correction.
    fn gather(
        &mut self,
        (x, cell): (&Hit, &Cell),
        (rays, paths): (u32, u32),
        net: &ScrambledNet,
        random: &mut Pcg64,
        ends: &mut Vec<Candidate>,
    ) -> f64 {
        let (mut sum, mut total) = (0., 0.);
        let key = random.random();
        ends.clear();
        for n in 0..rays {
            let u = net.pair(key, n, 0);
            let shot = self.shoot(x, self.cache.guide(cell), u);
            let weight = shot.weight / f64::from(rays);
            match shot.end {
                End::Sky(radiance) => sum += weight * radiance,
                End::Hit(hit) => ends.push(Candidate::new(hit, weight)),
            }
        }
        // Look up what each ray has met
        for end in &mut *ends {
            let u = [random.random(), random.random()];
            end.cell = self.near(&end.hit, u);
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
}

impl<K: Intersector> Tracer<'_, K> {
    /// An unbiased estimate of the radiance at `x`.
    fn radiance(
        &mut self,
        correction: &Correction,
        x: &Hit,
        cell: &Cell,
        net: &ScrambledNet,
        random: &mut Pcg64,
    ) -> f64 {
        let (mut ends, mut others) = (vec![], vec![]);
        let &Correction { gathers, paths, branches, .. } = correction;
        let rays = (gathers, paths);
        let mut sum = self.gather((x, cell), rays, net, random, &mut ends);
        for Candidate { hit, cell, weight, .. } in ends {
            let error = (hit, cell);
            sum += weight
                * self.error(branches, error, net, random, &mut others);
        }
        self.albedo * sum
    }
}

impl<K: Intersector> Tracer<'_, K> {
    /// An unbiased estimate of the error of a cell's value at `y`.
    fn error(
        &mut self,
        branches: u32,
        (mut y, mut cell): (Hit, Cell),
        net: &ScrambledNet,
        random: &mut Pcg64,
        ends: &mut Vec<Candidate>,
    ) -> f64 {
        let (mut throughput, mut error) = (1., 0.);
        for bounce in 0.. {
            error -= throughput * f64::from(cell.value);
            let rays = (branches, 1);
            let sum = self.gather((&y, &cell), rays, net, random, ends);
            error += throughput * self.albedo * sum;
            let Some(end) = ends.pop() else { break };
            throughput *= self.albedo * end.weight;
            // Let a faint path survive by chance
            let survival = survival(throughput, bounce);
            if random.random::<f64>() >= survival {
                break;
            }
            throughput /= survival;
            (y, cell) = (end.hit, end.cell);
        }
        error
    }
}

/// The probability that a path of this throughput goes on.
fn survival(throughput: f64, bounce: u64) -> f64 {
    let faint = (throughput / FAINT).min(1.);
    let long = if bounce < MANY_BOUNCES { 1. } else { onward(bounce) };
    faint * long
}

/// The throughput below which roulette ends paths.
const FAINT: f64 = 0.2;
