// The choice of a hierarchy's quality, and trees of unusual shape (chapter
// "A wide hierarchy").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::bvh::{Bvh, Intersector, Isa, Quality};
use litpt::scene::{Mesh, Ray, Scene};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

#[test]
fn few_rays_want_a_fast_build_and_many_a_thorough_one() {
    for triangles in [1, 1000, 10_000_000] {
        let expecting = |rays| Quality::expecting(triangles, rays);
        assert_eq!(expecting(0.), Quality::Fast);
        assert_eq!(expecting(499. * triangles as f64), Quality::Fast);
        assert_eq!(expecting(501. * triangles as f64), Quality::Thorough);
        assert_eq!(expecting(f64::INFINITY), Quality::Thorough);
    }
}

/// Triangles around each other, each smaller by 3 %.
fn nested(n: u32) -> Scene {
    let corners = [DVec3::X, DVec3::Y, DVec3::NEG_ONE];
    let scale = |i: u32| 0.97f64.powi(i as i32);
    Scene::new(&Mesh {
        vertices: (0..n)
            .flat_map(|i| corners.map(|corner| corner * scale(i)))
            .collect(),
        triangles: (0..n).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect(),
        joined: vec![],
    })
}

/// The distance to the nearest triangle, by the plane equation and the
/// side of each edge.
fn nearest(scene: &Scene, ray: &Ray) -> f64 {
    let mut nearest = f64::INFINITY;
    for t in scene.triangles.to_vec() {
        let [a, b, c] = t.map(|corner| corner - ray.origin);
        let normal = (b - a).cross(c - a);
        let distance = normal.dot(a) / normal.dot(ray.direction);
        let p = ray.direction * distance;
        let side = |a: DVec3, b: DVec3| (b - a).cross(p - a).dot(normal);
        let inside =
            side(a, b) >= 0. && side(b, c) >= 0. && side(c, a) >= 0.;
        if inside && distance > 0. {
            nearest = nearest.min(distance);
        }
    }
    nearest
}

#[test]
fn nested_triangles_are_all_found_and_in_order() {
    let scene = nested(2000);
    let mut random = Pcg64::seed_from_u64(3);
    let mut point = || {
        let mut one = || 2. * random.random::<f64>() - 1.;
        DVec3::new(one(), one(), one())
    };
    let rays: Vec<Ray> = (0..2000)
        .map(|i| {
            // Half of the rays aim at the centre, where all are.
            let origin = point() * 4096.;
            let aim = point() * if i % 2 == 0 { 1. } else { 4096. };
            Ray { origin, direction: (aim - origin).normalize() }
        })
        .collect();
    let expected: Vec<f64> =
        rays.iter().map(|ray| nearest(&scene, ray)).collect();
    assert!(expected.iter().filter(|x| x.is_finite()).count() > 200);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        let intersector = Bvh::with(&scene, Quality::Fast, isa)
            .expect("available instructions");
        for (ray, &expected) in rays.iter().zip(&expected) {
            let hit = intersector.first_hit(ray, None);
            let found = hit.map(|hit| (hit.point - ray.origin).length());
            match found {
                Some(found) => assert!((found - expected).abs() < 1e-6),
                None => assert_eq!(expected, f64::INFINITY),
            }
        }
    }
}
