// The kernel against a loop over all triangles (chapter "The hierarchy").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::closed_forms::cavity;
use litpt::hierarchy::{Cwbvh, Hit, Kernel};
use litpt::scene::{Mesh, Ray, Scene};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// The nearest hit by the textbook: the ray's plane equation, and the side
/// of each edge, in double precision.
fn nearest(scene: &Scene, ray: &Ray) -> Option<(f64, DVec3)> {
    let mut nearest: Option<(f64, DVec3)> = None;
    for t in scene.triangles() {
        let [a, b, c] = t.map(|corner| corner.as_dvec3() - ray.origin);
        let normal = (b - a).cross(c - a);
        let distance = normal.dot(a) / normal.dot(ray.direction);
        let p = ray.direction * distance;
        let side = |a: DVec3, b: DVec3| (b - a).cross(p - a).dot(normal);
        let inside =
            side(a, b) >= 0. && side(b, c) >= 0. && side(c, a) >= 0.;
        let closer = nearest.is_none_or(|(best, _)| distance < best);
        if inside && distance > 0. && closer {
            nearest = Some((distance, normal.normalize()));
        }
    }
    nearest
}

fn random_direction(random: &mut Pcg64) -> DVec3 {
    loop {
        let mut one = || 2. * random.random::<f64>() - 1.;
        let d = DVec3::new(one(), one(), one());
        if d.length() < 1. && d.length() > 0.01 {
            return d.normalize();
        }
    }
}

fn soup(n: usize, size: f64) -> Mesh {
    let mut random = Pcg64::seed_from_u64(11);
    let mut mesh = Mesh::default();
    for i in 0..n as u32 {
        let centre = random_direction(&mut random) * 10.;
        for _ in 0..3 {
            mesh.vertices
                .push(centre + random_direction(&mut random) * size);
        }
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    mesh
}

#[test]
fn the_hierarchy_finds_what_a_loop_over_all_triangles_finds() {
    for mesh in [soup(1, 5.), soup(3, 5.), soup(500, 2.), cavity(0.2, 12)] {
        let scene = Scene::new(&mesh);
        let kernel = Cwbvh::new(&scene);
        let mut random = Pcg64::seed_from_u64(5);
        let mut hits = 0;
        for _ in 0..3000 {
            let direction = random_direction(&mut random);
            let origin = random_direction(&mut random) * 3000.;
            let ray = Ray { origin, direction };
            let found = kernel.first_hit(&ray, None);
            let expected = nearest(&scene, &ray);
            let Some(Hit { point, normal, .. }) = found else {
                assert!(expected.is_none(), "{ray:?}: {expected:?}");
                continue;
            };
            let (distance, plane) = expected.expect("a hit that is none");
            hits += 1;
            // A distance errs by 2^13 * 2^-53, the rounding of the scene's
            // size, over the cosine of incidence; 1e-8 allows 1e-4.
            let miss = (point - origin - direction * distance).length();
            assert!(miss < 1e-8 * (1. + distance), "{ray:?}: {miss}");
            assert!(normal.dot(direction) <= 0.);
            assert!((normal.dot(plane).abs() - 1.).abs() < 1e-12);
        }
        assert!(hits > 0);
    }
}

#[test]
fn a_triangle_is_never_met_twice_in_a_row() {
    let scene = Scene::new(&soup(50, 20.));
    let kernel = Cwbvh::new(&scene);
    let mut random = Pcg64::seed_from_u64(6);
    for _ in 0..2000 {
        let direction = random_direction(&mut random);
        let ray = Ray { origin: DVec3::ZERO, direction };
        let Some(first) = kernel.first_hit(&ray, None) else { continue };
        let onward = Ray { origin: first.point, direction };
        let from = Some(first.primitive);
        if let Some(second) = kernel.first_hit(&onward, from) {
            assert_ne!(second.primitive, first.primitive);
        }
    }
}

#[test]
fn both_instruction_sets_answer_with_the_same_bits() {
    let scene = Scene::new(&cavity(0.2, 32));
    let kernel = Cwbvh::new(&scene);
    let portable = Cwbvh::new(&scene).portable();
    let mut random = Pcg64::seed_from_u64(8);
    let mut rays: Vec<Ray> = (0..100_000)
        .map(|_| Ray {
            origin: random_direction(&mut random)
                * 4000.
                * random.random::<f64>(),
            direction: random_direction(&mut random),
        })
        .collect();
    // Along the axes, with zeros of both signs, and through all vertices.
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        for sign in [1., -1.] {
            let direction = axis * sign;
            rays.push(Ray { origin: DVec3::ZERO, direction });
            rays.push(Ray { origin: -0.3 * direction, direction });
        }
    }
    for corner in scene.triangles().iter().flatten() {
        let direction = corner.as_dvec3().normalize();
        rays.push(Ray { origin: DVec3::ZERO, direction });
    }
    for ray in &rays {
        let hit = kernel.first_hit(ray, None);
        assert_eq!(portable.first_hit(ray, None), hit, "{ray:?}");
    }
}

#[test]
fn rays_through_edges_and_vertices_of_a_closed_mesh_are_stopped() {
    let scene = Scene::new(&cavity(0., 24));
    let kernel = Cwbvh::new(&scene);
    let mut random = Pcg64::seed_from_u64(4);
    for t in scene.triangles() {
        let [a, b, _] = t.map(|corner| corner.as_dvec3());
        for s in [0., 0.5, random.random::<f64>()] {
            let aim = a + (b - a) * s;
            let origin = random_direction(&mut random) * 1000.;
            let direction = (aim - origin).normalize();
            let ray = Ray { origin, direction };
            assert!(kernel.first_hit(&ray, None).is_some(), "{ray:?}");
        }
    }
}

#[test]
fn an_empty_scene_has_no_hit() {
    let kernel = Cwbvh::new(&Scene::new(&Mesh::default()));
    let ray = Ray { origin: DVec3::ZERO, direction: DVec3::X };
    assert_eq!(kernel.first_hit(&ray, None), None);
}

#[test]
fn triangles_without_area_are_never_hit() {
    let point = |x: f64| DVec3::new(x, 0., 0.);
    let mesh = Mesh {
        vertices: vec![point(-1.), point(0.), point(1.), DVec3::Y],
        triangles: vec![[0, 1, 2], [3, 3, 3], [0, 0, 3]],
    };
    let scene = Scene::new(&mesh);
    assert!(scene.triangles().is_empty());
    let kernel = Cwbvh::new(&scene);
    let mut random = Pcg64::seed_from_u64(2);
    for _ in 0..1000 {
        let origin = random_direction(&mut random) * 5000.;
        let ray = Ray { origin, direction: -origin.normalize() };
        assert_eq!(kernel.first_hit(&ray, None), None);
    }
}
