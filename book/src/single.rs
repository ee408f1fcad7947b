// The rival, which works as the system to be re-created: vertices, rays and
// hits in single precision, where they are, and a test of triangles that
// leaves gaps.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::time::Duration;

use glam::{DVec3, Vec3, Vec3A};
use litpt::sampler::cosine_direction;
use litpt::statistics::Accumulator;
use obvhs::BvhBuildParams;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

/// A scene in single precision.
pub struct SinglePrecision {
    triangles: Vec<Triangle>,
    tree: Bvh2,
}

impl SinglePrecision {
    pub fn new(corners: &[[Vec3; 3]]) -> Self {
        let triangle = |t: &[Vec3; 3]| {
            let [v0, v1, v2] = t.map(Vec3A::from);
            Triangle { v0, v1, v2 }
        };
        let triangles: Vec<_> = corners.iter().map(triangle).collect();
        let tree = build_bvh2_from_tris(
            &triangles,
            BvhBuildParams::medium_build(),
            &mut Duration::default(),
        );
        Self { triangles, tree }
    }

    /// The distance of the first triangle other than `from`, and which.
    fn first_hit(
        &self,
        origin: Vec3,
        direction: Vec3,
        from: Option<u32>,
    ) -> Option<(f32, u32)> {
        let ray = Ray::new_inf(origin.into(), direction.into());
        let mut hit = RayHit::none();
        let number = |i: usize| self.tree.primitive_indices[i];
        let test = |ray: &Ray, i: usize| match Some(number(i)) == from {
            true => f32::INFINITY,
            false => self.triangles[number(i) as usize].intersect(ray),
        };
        let met = self.tree.ray_traverse(ray, &mut hit, test);
        met.then(|| (hit.t, number(hit.primitive_id as usize)))
    }

    /// Where a path goes on after a hit: the point, and a direction.
    fn bounce(
        &self,
        (origin, direction): (Vec3, Vec3),
        (distance, number): (f32, u32),
        random: &mut Pcg64Mcg,
    ) -> (Vec3, Vec3) {
        let normal = self.triangles[number as usize].compute_normal();
        let normal = Vec3::from(normal).as_dvec3().normalize();
        let away = normal.dot(direction.as_dvec3()) > 0.;
        let normal = if away { -normal } else { normal };
        let (r, turn) = (random.random(), random.random());
        let next = cosine_direction(normal, r, turn).as_vec3();
        (origin + direction * distance, next)
    }

    /// Whether a path of so many bounces finds a way out.
    pub fn escapes(
        &self,
        position: DVec3,
        direction: DVec3,
        bounces: u64,
        random: &mut Pcg64Mcg,
    ) -> bool {
        let mut ray = (position.as_vec3(), direction.as_vec3());
        let mut from = None;
        (0..bounces).any(|_| {
            let Some(hit) = self.first_hit(ray.0, ray.1, from) else {
                return true;
            };
            ray = self.bounce(ray, hit, random);
            from = Some(hit.1);
            false
        })
    }

    /// What a camera sees in the direction of its target, after `n` paths
    /// with that system's two rules.
    pub fn mean(
        &self,
        rho: f64,
        up: DVec3,
        (position, target): (DVec3, DVec3),
        n: u64,
    ) -> Accumulator {
        let ahead = (target.as_vec3() - position.as_vec3()).normalize();
        let one = |seed: u64| {
            let mut random = Pcg64Mcg::seed_from_u64(seed);
            let ray = (position.as_vec3(), ahead);
            let mut pixel = Accumulator::default();
            pixel.add(self.weight(rho, up.as_vec3(), ray, &mut random));
            pixel
        };
        (0..n).into_par_iter().map(one).reduce(
            Accumulator::default,
            |mut a, b| {
                a.merge(&b);
                a
            },
        )
    }

    /// The weight of one path.
    fn weight(
        &self,
        rho: f64,
        up: Vec3,
        mut ray: (Vec3, Vec3),
        random: &mut Pcg64Mcg,
    ) -> f64 {
        let (mut weight, mut from) = (1., None);
        for bounces in 0.. {
            let Some(hit) = self.first_hit(ray.0, ray.1, from) else {
                return if ray.1.dot(up) > 0. { weight } else { 0. };
            };
            if weight < 0.1 {
                if random.random::<f64>() >= rho {
                    break;
                }
            } else {
                weight *= rho;
                if bounces > 1000 {
                    if random.random() {
                        break;
                    }
                    weight *= 2.;
                }
            }
            ray = self.bounce(ray, hit, random);
            from = Some(hit.1);
        }
        0.
    }
}
