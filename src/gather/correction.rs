// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The correction of a cache's error, shared among neighbouring samples.

// Name what the correction imports
use std::f64::consts::PI;

use rand::RngExt;
use rand_pcg::Pcg64;

use super::cache::spread;
use super::guide::{bin_of, main_axis};
use super::{Correction, End, Plan, Sample, Tracer};
use crate::bvh::{Hit, Intersector};
use crate::film::Tile;
use crate::integrator::onward;
use crate::sampler::sobol::{ScrambledNet, to_unit};
use crate::scene::Ray;

// Share corrections in groups
impl<K: Intersector> Tracer<'_, K> {
    /// Adds the corrections of the samples of a tile to the sums of its
    /// pixels.
    pub fn correct(
        &mut self,
        plan: &Plan,
        correction: &Correction,
        tile: Tile,
        samples: &[Sample],
        random: &mut Pcg64,
        sums: &mut [f64],
    ) {
        let mut order: Vec<_> = (0..samples.len()).collect();
        order.sort_by_cached_key(|&i| self.place(&samples[i].hit));
        let groups = samples.len().div_ceil(correction.group).max(1);
        let length = samples.len().div_ceil(groups).max(1);
        let mut seen = vec![];
        for group in order.chunks(length) {
            let mut next = random.random::<f64>() * correction.step;
            let mut reached = 0.;
            for &k in group {
                let Sample { weight, ref end, pixel, .. } = samples[k];
                let Some((y, cell)) = end else { continue };
                let weight = self.albedo * weight;
                let error = f64::from(cell.error);
                let (_, _, number) = plan.place(tile, pixel);
                let importance =
                    weight * error / plan.allocation.scale[number];
                reached += importance;
                let draws = ((reached - next) / correction.step).ceil();
                let draws = draws.max(0.);
                next += draws * correction.step;
                if draws == 0. {
                    continue;
                }
                let known = self.cache.interpolate(y.point, y.normal);
                let error =
                    self.radiance(correction, y, &plan.net, random) - known;
                let share = error * draws * correction.step / importance;
                self.share(samples, group, k, share, &mut seen, sums);
            }
        }
    }
}

impl<K: Intersector> Tracer<'_, K> {
    /// Gives the error found by sample `k` to all samples of its group
    /// that see the place.
    fn share(
        &mut self,
        samples: &[Sample],
        group: &[usize],
        k: usize,
        error: f64,
        seen: &mut Vec<f64>,
        sums: &mut [f64],
    ) {
        let Some((y, _)) = &samples[k].end else { return };
        seen.clear();
        let mut density = 0.;
        for &i in group {
            let x = &samples[i];
            let (form, direction) = form(&x.hit, y);
            let visible =
                form > 0. && (i == k || self.sees(&x.hit, y, direction));
            seen.push(if visible { form } else { 0. });
            if visible {
                density += form
                    * match self.cache.guide(&x.cell) {
                        _ if i == k => 1. / x.weight,
                        Some(guide) => {
                            guide.density(bin_of(x.hit.normal, direction))
                        }
                        None => 1.,
                    };
            }
        }
        if density > 0. {
            for (&i, form) in group.iter().zip(seen) {
                sums[samples[i].pixel as usize] +=
                    self.albedo * *form * error / density;
            }
        }
    }

    /// Whether the ray from `x` in this direction meets the triangle of `y`.
    fn sees(&mut self, x: &Hit, y: &Hit, direction: glam::DVec3) -> bool {
        if x.primitive == y.primitive {
            return false;
        }
        self.rays += 1;
        let ray = Ray { origin: x.point, direction };
        let met = self.intersector.first_hit(&ray, Some(x.primitive));
        met.is_some_and(|met| met.primitive == y.primitive)
    }

    /// Sorts hits by place and normal.
    fn place(&self, hit: &Hit) -> (u64, usize, u64) {
        let cube =
            ((hit.point + 4100.) / 32.).max(glam::DVec3::ZERO).to_array();
        let [x, y, z] = cube.map(|c| spread((c as u64).min((1 << 19) - 1)));
        let morton = x | y << 1 | z << 2;
        let axis = main_axis(hit.normal);
        let class = 2 * axis + usize::from(hit.normal[axis] > 0.);
        (morton >> 9, class, morton & 511)
    }
}

/// The density with which cosine sampling at `x` finds `y`, per unit of
/// area around `y`; zero if one faces away. And the direction.
fn form(x: &Hit, y: &Hit) -> (f64, glam::DVec3) {
    let to = y.point - x.point;
    let square = to.length_squared();
    let (near, far) = (x.normal.dot(to), -y.normal.dot(to));
    if !(near > 0. && far > 0.) {
        return (0., to);
    }
    (near * far / (PI * square * square), to / square.sqrt())
}

// Estimate the error of the cache at a point
impl<K: Intersector> Tracer<'_, K> {
    /// An unbiased estimate of the radiance at `x`: a gather, some rays of
    /// which are corrected.
    fn radiance(
        &mut self,
        correction: &Correction,
        x: &Hit,
        net: &ScrambledNet,
        random: &mut Pcg64,
    ) -> f64 {
        let cell = *self.cache.at(x.point, x.normal);
        let key = random.random();
        let (mut sum, mut total) = (0., 0.);
        let mut ends = vec![];
        for n in 0..correction.gathers {
            let u = net.pair(key, n, 0).map(to_unit);
            let shot = self.shoot(x, self.cache.guide(&cell), u);
            let weight = shot.weight / f64::from(correction.gathers);
            match shot.end {
                End::Sky(radiance) => sum += weight * radiance,
                End::Hit(z) => {
                    let u = [random.random(), random.random()];
                    let near = self.cache.near(z.point, z.normal, u);
                    sum += weight * f64::from(near.value);
                    let size = f64::from(near.value.abs() + near.error);
                    let importance = weight * size.max(1e-12);
                    total += importance;
                    ends.push((z, weight, importance));
                }
            }
        }
        let step = total / f64::from(correction.paths);
        let (mut next, mut reached) = (random.random::<f64>() * step, 0.);
        for (z, weight, importance) in ends {
            reached += importance;
            while next < reached {
                next += step;
                let error = self.error(correction.branches, z, net, random);
                sum += weight * step / importance * error;
            }
        }
        self.albedo * sum
    }

    /// An unbiased estimate of the error of the cache at `y`, from a path.
    fn error(
        &mut self,
        branches: u32,
        mut y: Hit,
        net: &ScrambledNet,
        random: &mut Pcg64,
    ) -> f64 {
        let (mut throughput, mut error) = (1., 0.);
        for bounce in 0.. {
            error -= throughput * self.cache.interpolate(y.point, y.normal);
            let cell = *self.cache.at(y.point, y.normal);
            let key = random.random();
            let (mut sum, mut total, mut chosen) = (0., 0., None);
            for n in 0..branches {
                let u = net.pair(key, n, 0).map(to_unit);
                let shot = self.shoot(&y, self.cache.guide(&cell), u);
                let weight = shot.weight / f64::from(branches);
                match shot.end {
                    End::Sky(radiance) => sum += weight * radiance,
                    End::Hit(z) => {
                        let u = [random.random(), random.random()];
                        let near = self.cache.near(z.point, z.normal, u);
                        sum += weight * f64::from(near.value);
                        let size =
                            f64::from(near.error + 0.1 * near.value.abs());
                        let importance = weight * size.max(1e-12);
                        total += importance;
                        if random.random::<f64>() * total < importance {
                            chosen = Some((z, weight / importance));
                        }
                    }
                }
            }
            error += throughput * self.albedo * sum;
            let Some((z, weight)) = chosen else { break };
            throughput *= self.albedo * weight * total;
            if throughput < 0.2 {
                if random.random::<f64>() * 0.2 >= throughput {
                    break;
                }
                throughput = 0.2;
            }
            if bounce >= 1000 {
                let q = onward(bounce);
                if random.random::<f64>() >= q {
                    break;
                }
                throughput /= q;
            }
            y = z;
        }
        error
    }
}
