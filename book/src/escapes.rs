// Paths that must not go through the wall of a closed surface.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::bvh::{Bvh, Dispatch, Intersector};
use litpt::sampler::cosine_direction;
use litpt::scene::{Ray, Triangle};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::solids::{Solid, winding};

/// After so many rays, whether a path from outside has got inside is asked of
/// the winding number. Few paths are that long: the deepest trench, between
/// two fins, is 14 times as deep as wide, so that a path whose steps are as
/// long as it is wide leaves it after some 14^2 rays. But the courtyard has a
/// passage 5 mm high and 8 mm wide, in which one path of 10^7 stays longer.
const LONG: u64 = 10_000;

/// A path at its last point.
pub struct Path {
    ray: Ray,
    /// The triangle that it leaves.
    from: Option<u32>,
}

impl Path {
    /// One that starts there.
    pub fn new(origin: DVec3, direction: DVec3) -> Self {
        Self { ray: Ray { origin, direction }, from: None }
    }

    /// Follows one ray; false if it meets nothing.
    fn goes_on<K: Intersector>(
        &mut self,
        intersector: &K,
        random: &mut Pcg64Mcg,
    ) -> bool {
        let Some(hit) = intersector.first_hit(&self.ray, self.from) else {
            return false;
        };
        let (r, turn) = (random.random(), random.random());
        let direction = cosine_direction(hit.normal, r, turn);
        self.ray = Ray { origin: hit.point, direction };
        self.from = Some(hit.primitive);
        true
    }

    /// Follows one ray; whether it meets something within these triangles.
    pub fn is_within<K: Intersector>(
        &mut self,
        triangles: &[Triangle],
        intersector: &K,
        random: &mut Pcg64Mcg,
    ) -> bool {
        let start = self.ray.origin;
        let meets = self.goes_on(intersector, random);
        let middle = start.midpoint(self.ray.origin);
        meets && winding(triangles, middle).abs() > 0.5
    }
}

/// Paths from the cameras of a solid; gives how many of them get out.
pub struct Inside<'a> {
    pub solid: &'a Solid,
    /// The hierarchy of the solid's scene.
    pub bvh: &'a Bvh,
    pub seed: u64,
    pub paths: u64,
    /// Rays of each path.
    pub bounces: u64,
}

impl Dispatch for Inside<'_> {
    type Output = u64;

    fn with<K: Intersector>(self, intersector: &K) -> u64 {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let cameras = &self.solid.cameras;
        let is_own = |path: &Path| {
            path.from.is_some_and(|i| self.bvh.face(i) < self.solid.faces)
        };
        let escapes = (0..self.paths).filter(|n| {
            let at = (self.seed + n) as usize % cameras.len();
            let mut path = Path::new(cameras[at], uniform(&mut random));
            (0..self.bounces).any(|_| {
                !path.goes_on(intersector, &mut random) || !is_own(&path)
            })
        });
        escapes.count() as u64
    }
}

/// Paths from far outside of a solid to its corners, edges and triangles, but
/// not to cracks, with so many rays together, or a few more; gives how many of
/// the paths get inside.
pub struct Outside<'a> {
    pub solid: &'a Solid,
    pub seed: u64,
    pub rays: u64,
}

impl Dispatch for Outside<'_> {
    type Output = u64;

    fn with<K: Intersector>(self, intersector: &K) -> u64 {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let own = self.solid.own();
        let corners = own.as_flattened().iter();
        let reach = corners.map(|p| p.abs().max_element());
        let reach = reach.fold(0., f64::max);
        let (mut rays, mut inside) = (0, 0);
        while rays < self.rays {
            let aim = match self.solid.has_cracks() {
                true => inner(&own, &mut random),
                false => point(&own, &mut random),
            };
            let d = uniform(&mut random);
            // From above, where nothing else is.
            let away = DVec3::new(d.x, d.y, d.z.abs());
            let mut path = Path::new(aim + away * 4. * reach, -away);
            let length = (1..=LONG)
                .find(|_| !path.goes_on(intersector, &mut random));
            rays += length.unwrap_or(LONG);
            let is_long = length.is_none();
            let random = &mut random;
            let within =
                is_long && path.is_within(&own, intersector, random);
            inside += u64::from(within);
        }
        inside
    }
}

/// A corner of a triangle, a point of an edge, or one within.
pub fn point(of: &[Triangle], random: &mut Pcg64Mcg) -> DVec3 {
    let [a, b, _] = of[random.random_range(0..of.len())];
    match random.random_range(0..3) {
        0 => a,
        1 => a + (b - a) * random.random::<f64>(),
        _ => inner(of, random),
    }
}

/// A point within a triangle.
fn inner(of: &[Triangle], random: &mut Pcg64Mcg) -> DVec3 {
    let [a, b, c] = of[random.random_range(0..of.len())];
    let (s, t): (f64, f64) = (random.random(), random.random());
    a + ((b - a) + (c - b) * t) * s
}

/// A direction.
pub fn uniform(random: &mut Pcg64Mcg) -> DVec3 {
    loop {
        let mut one = || 2. * random.random::<f64>() - 1.;
        let d = DVec3::new(one(), one(), one());
        if (0.01..1.).contains(&d.length_squared()) {
            return d.normalize();
        }
    }
}
