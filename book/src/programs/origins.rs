// Counts the paths that leave closed surfaces, by the way in which the next
// ray's origin is chosen, and prints a CSV: "make measure" records it for the
// chapter "Where the next ray starts". The argument after the first is a
// factor on the number of rays.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::bvh::{Bvh, Dispatch, Hit, Intersector};
use litpt::sampler::cosine_direction;
use litpt::scene::Ray;
use litpt_book::solids::{self, Solid};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::Done;

const PIECES: u64 = 64;
const BOUNCES: u64 = 100;

/// From the hit to the next ray's origin.
type Origin = fn(&Hit) -> DVec3;

/// On the surface, as far as double precision goes.
fn double(hit: &Hit) -> DVec3 {
    hit.point - hit.normal / (1u64 << 34) as f64
}

/// On the surface, as far as single precision goes.
fn single(hit: &Hit) -> DVec3 {
    double(hit).as_vec3().as_dvec3()
}

/// The same, moved off it by more than the rounding.
fn moved(hit: &Hit) -> DVec3 {
    single(hit) + hit.normal / 512.
}

fn ours(hit: &Hit) -> DVec3 {
    hit.point
}

pub fn run(arguments: &[String]) -> Done {
    let scale = arguments.get(1).map_or(Ok(1.), |s| s.parse())?;
    let paths = (2e6 * scale / (PIECES * BOUNCES) as f64) as u64;
    println!("surface,triangles,single,moved,double,ours");
    for solid in solids::all() {
        let intersector = Bvh::new(&solid.scene)?;
        let escapes = |origin: Origin| {
            let piece = |seed| {
                let solid = &solid;
                intersector.dispatch(Walk { solid, seed, paths, origin })
            };
            (0..PIECES).into_par_iter().map(piece).sum::<u64>()
        };
        let [a, b, c, d] =
            [single as Origin, moved, double, ours].map(escapes);
        let triangles = solid.scene.triangles().len();
        println!("{},{triangles},{a},{b},{c},{d}", solid.name);
    }
    Ok(())
}

/// Paths of many bounces in a solid.
struct Walk<'a> {
    solid: &'a Solid,
    seed: u64,
    paths: u64,
    origin: Origin,
}

impl Dispatch for Walk<'_> {
    type Output = u64;

    /// How many find a way out.
    fn with<K: Intersector>(self, intersector: &K) -> u64 {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let cameras = &self.solid.cameras;
        let escapes = (0..self.paths).filter(|n| {
            let origin = cameras[(self.seed + n) as usize % cameras.len()];
            let (r, turn) = (random.random(), random.random());
            let direction = cosine_direction(DVec3::Y, r, turn);
            let mut ray = Ray { origin, direction };
            let mut from = None;
            (0..BOUNCES).any(|_| {
                let Some(hit) = intersector.first_hit(&ray, from) else {
                    return true;
                };
                let (r, turn) = (random.random(), random.random());
                let direction = cosine_direction(hit.normal, r, turn);
                ray = Ray { origin: (self.origin)(&hit), direction };
                from = Some(hit.primitive);
                false
            })
        });
        escapes.count() as u64
    }
}
