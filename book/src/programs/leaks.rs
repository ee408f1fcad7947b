// Counts the rays that leave closed surfaces and prints a CSV: "make measure"
// records it for the chapter "Which triangle does a ray meet?".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::HashMap;

use glam::{DVec3, Vec3};
use litpt::bvh::{Bvh, Dispatch, Hit, Intersector};
use litpt::sampler::cosine_direction;
use litpt::scene::{Mesh, Ray, Scene};
use litpt_book::solids::{cube, icosphere};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::Done;

const PIECES: u64 = 64;

pub fn run(arguments: &[String]) -> Done {
    let scale = arguments.get(1).map_or(Ok(1.), |s| s.parse())?;
    let many = |n: f64| (n * scale / PIECES as f64) as u64;
    let (aimed, few, walked) = (many(5e7), many(5e7), many(1e9));
    println!("surface,rays,number,f32,bits26,exact");
    for (name, mesh) in [("icosphere", icosphere(5)), ("cube", cube(20))] {
        let solid = Solid::new(&mesh)?;
        for (rays, at_edges) in [("at vertices", false), ("at edges", true)]
        {
            let n = solid.total(aimed, |random, count| {
                solid.aim(random, count, at_edges)
            });
            let number = aimed * PIECES;
            let label = format!("{name} ({})", mesh.triangles.len());
            println!("{label},{rays},{number},{},{},{}", n[0], n[1], n[2]);
        }
    }
    for (name, mesh) in [("cube", cube(1)), ("icosphere", icosphere(5))] {
        let solid = Solid::new(&mesh)?;
        let n = solid.total(walked, |random, count| {
            [0, 0, solid.intersector.dispatch(Exact(random, count))]
        });
        let (label, number) =
            (format!("{name} ({})", mesh.triangles.len()), walked * PIECES);
        println!("{label},walks,{number},,,{}", n[2]);
    }
    // The rivals go through all triangles, so that they walk less.
    let mesh = cube(1);
    let solid = Solid::new(&mesh)?;
    let n = solid.total(few, |random, count| {
        let rivals = [moller_trumbore as Test, masked];
        let [a, b] = rivals.map(|test| solid.wander(random, count, test));
        [a, b, solid.intersector.dispatch(Exact(random, count))]
    });
    println!("cube (12),walks,{},{},{},{}", few * PIECES, n[0], n[1], n[2]);
    Ok(())
}

/// The distance of a ray to a triangle.
type Test = fn(&Ray, &[Vec3; 3]) -> Option<f64>;

/// The corners in single precision.
pub fn single(corners: [DVec3; 3]) -> [Vec3; 3] {
    corners.map(|corner| corner.as_vec3())
}

/// A closed surface around the origin.
struct Solid {
    scene: Scene,
    intersector: Bvh,
    /// The triangles around each corner.
    around: HashMap<[u64; 3], Vec<usize>>,
}

impl Solid {
    fn new(mesh: &Mesh) -> Result<Self, Box<dyn std::error::Error>> {
        let scene = Scene::new(mesh);
        let intersector = Bvh::new(&scene)?;
        let mut around: HashMap<_, Vec<_>> = HashMap::new();
        for (i, triangle) in scene.triangles().iter().enumerate() {
            for corner in triangle {
                let key = corner.to_array().map(f64::to_bits);
                around.entry(key).or_default().push(i);
            }
        }
        Ok(Self { scene, intersector, around })
    }

    /// Sums of what the pieces count.
    fn total(
        &self,
        count: u64,
        piece: impl Fn(&mut Pcg64Mcg, u64) -> [u64; 3] + Sync,
    ) -> [u64; 3] {
        let pieces = (0..PIECES)
            .into_par_iter()
            .map(|i| piece(&mut Pcg64Mcg::seed_from_u64(i), count));
        pieces
            .reduce(|| [0; 3], |a, b| std::array::from_fn(|k| a[k] + b[k]))
    }

    /// Misses of rays aimed at corners or at points of edges.
    fn aim(
        &self,
        random: &mut Pcg64Mcg,
        n: u64,
        at_edges: bool,
    ) -> [u64; 3] {
        let triangles = self.scene.triangles();
        let mut misses = [0; 3];
        for _ in 0..n {
            let chosen = random.random_range(0..triangles.len());
            let [a, b, _] = triangles[chosen];
            let s = if at_edges { random.random() } else { 0. };
            let mut one = || 1000. * (random.random::<f64>() - 0.5);
            let origin = DVec3::new(one(), one(), one());
            let direction = (a + (b - a) * s - origin).normalize();
            let ray = Ray { origin, direction };
            let near = [0, 1].map(|c| {
                let corner = triangles[chosen][c].to_array();
                &self.around[&corner.map(f64::to_bits)]
            });
            let met = |test: Test| {
                let mut near = near.iter().copied().flatten();
                near.any(|&i| test(&ray, &single(triangles[i])).is_some())
            };
            misses[0] += u64::from(!met(moller_trumbore));
            misses[1] += u64::from(!met(masked));
            misses[2] +=
                u64::from(!self.intersector.is_occluded(&ray, None));
        }
        misses
    }

    /// Escapes of a walk that goes through all triangles with `test`.
    fn wander(&self, random: &mut Pcg64Mcg, n: u64, test: Test) -> u64 {
        let triangles = self.scene.triangles();
        escapes(random, n, |ray, from| {
            let all = triangles.iter().zip(0..);
            let others = all.filter(|(_, i)| Some(*i) != from);
            let met = others
                .filter_map(|(t, i)| Some((test(ray, &single(*t))?, i)))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            met.map(|(distance, primitive)| {
                let [a, b, c] = triangles[primitive as usize];
                let normal = (b - a).cross(c - a).normalize();
                let away = normal.dot(ray.direction) > 0.;
                let normal = if away { -normal } else { normal };
                let point = ray.origin + ray.direction * distance;
                Hit { point, normal, primitive }
            })
        })
    }
}

/// A walk with the intersector of the program.
struct Exact<'a>(&'a mut Pcg64Mcg, u64);

impl Dispatch for Exact<'_> {
    type Output = u64;

    fn with<K: Intersector>(self, intersector: &K) -> u64 {
        escapes(self.0, self.1, |ray, from| {
            intersector.first_hit(ray, from)
        })
    }
}

/// How often a path that bounces `n` times finds no triangle; it then
/// starts anew near the origin.
fn escapes(
    random: &mut Pcg64Mcg,
    n: u64,
    first_hit: impl Fn(&Ray, Option<u32>) -> Option<Hit>,
) -> u64 {
    let start = |random: &mut Pcg64Mcg| {
        let mut one = || 1000. * (random.random::<f64>() - 0.5);
        let origin = DVec3::new(one(), one(), one());
        let normal = DVec3::Z;
        let direction =
            cosine_direction(normal, random.random(), random.random());
        (Ray { origin, direction }, None)
    };
    let (mut ray, mut from) = start(random);
    let mut escapes = 0;
    for _ in 0..n {
        let Some(hit) = first_hit(&ray, from) else {
            escapes += 1;
            (ray, from) = start(random);
            continue;
        };
        let (r, turn) = (random.random(), random.random());
        let direction = cosine_direction(hit.normal, r, turn);
        ray = Ray { origin: hit.point, direction };
        from = Some(hit.primitive);
    }
    escapes
}

/// Möller and Trumbore (1997), in single precision.
pub fn moller_trumbore(ray: &Ray, &[a, b, c]: &[Vec3; 3]) -> Option<f64> {
    let (o, d) = (ray.origin.as_vec3(), ray.direction.as_vec3());
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let inverse = 1. / e1.dot(p);
    let s = o - a;
    let u = s.dot(p) * inverse;
    let q = s.cross(e1);
    let v = d.dot(q) * inverse;
    let t = e2.dot(q) * inverse;
    let inside = u >= 0. && v >= 0. && u + v <= 1.;
    (inside && t > 0.).then_some(f64::from(t))
}

/// Sheared coordinates that are cut to 26 bits.
fn masked(ray: &Ray, triangle: &[Vec3; 3]) -> Option<f64> {
    let d = ray.direction;
    let k = (0..3).max_by(|&i, &j| d[i].abs().total_cmp(&d[j].abs()))?;
    let (i, j) = ((k + 1) % 3, (k + 2) % 3);
    let cut = |x: f64| f64::from_bits(x.to_bits() & !((1 << 27) - 1));
    let sheared = triangle.map(|corner| {
        let p = corner.as_dvec3() - ray.origin;
        let x = cut(p[i] - d[i] / d[k] * p[k]);
        let y = cut(p[j] - d[j] / d[k] * p[k]);
        [x, y, p[k]]
    });
    let [a, b, c] = sheared;
    let u = c[0] * b[1] - c[1] * b[0];
    let v = a[0] * c[1] - a[1] * c[0];
    let w = b[0] * a[1] - b[1] * a[0];
    let inside = u.min(v).min(w) >= 0. || u.max(v).max(w) <= 0.;
    let t = (u * a[2] + v * b[2] + w * c[2]) / (u + v + w) / d[k];
    (inside && t > 0.).then_some(t)
}
