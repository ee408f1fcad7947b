// Paths inside closed surfaces stay there (chapter "Where the next ray
// starts").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use litpt_book::solids::{Solid, rounded};
use robust::{Coord3D, orient3d};

#[test]
fn no_path_leaves_a_closed_surface() {
    for solid in &solids::all() {
        let bvh = &Bvh::new(&solid.scene).unwrap();
        let (seed, paths, bounces) = (5, 5000, 20);
        let inside = Inside { solid, bvh, seed, paths, bounces };
        assert_eq!(bvh.dispatch(inside), 0, "{}", solid.name);
    }
}

/// The distance of a point to a triangle, by the closest of its features.
fn distance(&[a, b, c]: &[DVec3; 3], p: DVec3) -> f64 {
    let segment = |a: DVec3, b: DVec3| {
        let t = (p - a).dot(b - a) / (b - a).length_squared();
        (p - a - (b - a) * t.clamp(0., 1.)).length()
    };
    // The ordinary product loses the direction of a needle.
    let n = cross(b - a, c - a);
    let within = |(q, r)| cross(r - q, p - q).dot(n) >= 0.;
    match [(a, b), (b, c), (c, a)].into_iter().all(within) {
        true => (p - a).dot(n.normalize()).abs(),
        false => segment(a, b).min(segment(b, c)).min(segment(c, a)),
    }
}

/// How many times the surface goes around a point: the walls that a segment
/// to a distant point crosses outwards less those it crosses inwards, by
/// exact predicates.
fn times_around(triangles: &[[DVec3; 3]], p: DVec3) -> i32 {
    let coordinates = |v: DVec3| Coord3D { x: v.x, y: v.y, z: v.z };
    let side = |[a, b, c, d]: [DVec3; 4]| {
        let [a, b, c, d] = [a, b, c, d].map(coordinates);
        orient3d(a, b, c, d).signum()
    };
    let q = DVec3::new(31234.5, 28761.3, -33333.7);
    let crossed = |&[a, b, c]: &[DVec3; 3]| {
        let from = side([a, b, c, p]);
        let [u, v, w] =
            [[p, q, a, b], [p, q, b, c], [p, q, c, a]].map(side);
        let crosses = from * side([a, b, c, q]) < 0. && u == v && v == w;
        if crosses { from as i32 } else { 0 }
    };
    triangles.iter().map(crossed).sum()
}

/// 2^-47 of the size of a triangle as seen from a point, which is at least
/// `span` (chapter "The next origin").
fn clear(t: &[DVec3; 3], span: f64, p: DVec3) -> f64 {
    let far = t.map(|corner| (corner - p).abs().max_element());
    let far = far.into_iter().fold(span, f64::max);
    (1.125 * far + 0.125 * p.abs().max_element()) * 2f64.powi(-47)
}

/// Whether a hit is farther from all triangles than it is put off that
/// which it has met, because another one is close.
fn is_settled(triangles: &[[DVec3; 3]], ray: &Ray, hit: &Hit) -> bool {
    let distances = triangles.iter().map(|t| (distance(t, hit.point), t));
    let (height, &[a, b, c]) =
        distances.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    let longest = (b - a).abs().max((c - a).abs()).max_element();
    let span = hit.point.distance(ray.origin) + 2. * longest;
    height > 1.3 * clear(&[a, b, c], span, ray.origin)
}

// Rays of random directions hardly ever come near to a second triangle; so
// those of this test aim there, and bounce in the corner.
#[test]
fn hits_are_inside_and_clear_of_all_triangles() {
    let all = solids::all().into_iter();
    let small = |solid: &Solid| solid.scene.triangles.corners.len() < 1500;
    for Solid { name, scene, cameras, .. } in all.filter(small) {
        let intersector = Bvh::new(&scene).unwrap();
        let triangles = rounded(&scene);
        let mut random = Pcg64::seed_from_u64(9);
        let mut settled = 0;
        for _ in 0..2000 {
            let chosen = random.random_range(0..triangles.len());
            let [a, b, c] = triangles[chosen];
            let mut near = || match random.random_range(0..3) {
                0 => 0.,
                1 => 1e-12 * random.random::<f64>(),
                _ => random.random(),
            };
            let aim = a + (b - a) * near() + (c - a) * near() * 1e-14;
            let origin = cameras[0];
            let direction = (aim - origin).normalize();
            let mut ray = Ray { origin, direction };
            let mut from = None;
            for _ in 0..3 {
                let hit = intersector.first_hit(&ray, from);
                let hit = hit.unwrap_or_else(|| panic!("{name}: {ray:?}"));
                let around = times_around(&triangles, hit.point);
                assert_ne!(around, 0, "{name}: {ray:?} {hit:?}");
                let closest = triangles.iter().map(|t| {
                    distance(t, hit.point) / clear(t, 0., hit.point)
                });
                let closest = closest.fold(f64::MAX, f64::min);
                assert!(closest >= 0.35, "{name}: {closest:e} {ray:?}");
                settled += u32::from(is_settled(&triangles, &ray, &hit));
                let (r, turn) = (random.random(), random.random());
                let direction = cosine_direction(hit.normal, r, turn);
                // Not far, so that the corner is met again.
                ray = Ray { origin: hit.point, direction };
                from = Some(hit.primitive);
            }
        }
        assert!(settled > 0, "{name}: no hit was in doubt");
    }
}

// A wall through a floor, and a ray that comes down into the corner between
// them, down to 2^-59 from the wall, on one side or the other.
#[test]
fn a_ray_beside_a_wall_stays_on_its_side() {
    let at = DVec3::new;
    let floor = [at(-1., -1., 0.), at(1., -1., 0.), at(0., 1., 0.)];
    // The wall goes through the floor.
    let wall = [at(0., -0.5, -0.5), at(0., 0.5, -0.5), at(0., 0., 1.)];
    let scene = Scene::new(&apart([floor, wall].into_iter()));
    let wall = scene.triangles.get(1)[0].x;
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        let intersector = Bvh::with(&scene, Quality::FAST, isa).unwrap();
        for exponent in 25..60 {
            for side in [-1., 1.] {
                let x = wall + side * 2f64.powi(-exponent);
                let origin = at(x + side * 800., 0., 1000.);
                let floor = scene.triangles.get(0)[0].z;
                let direction = (at(x, 0., floor) - origin).normalize();
                let ray = Ray { origin, direction };
                let hit = intersector.first_hit(&ray, None).unwrap();
                let beside = (hit.point.x - wall) * side;
                assert!(beside > 2f64.powi(-35), "{exponent} {beside:e}");
                assert!(hit.point.z > floor, "{exponent}");
            }
        }
    }
}

// Next to a long edge of a thin triangle the distance has an error of more
// than the height above it at which rays start, 2^-34 and more here.
#[test]
fn a_thin_triangle_just_ahead_is_met() {
    let mut random = Pcg64::seed_from_u64(8);
    let mut vector = || in_cube(&mut random);
    for i in 0..3000 {
        let (u, v) = (vector().normalize(), vector().normalize());
        let across = u.cross(v).normalize() / [300., 1000., 5000.][i % 3];
        let scene = Scene::new(&apart([[-u, u, u + across]].into_iter()));
        let intersector = Bvh::new(&scene).unwrap();
        let [a, b, c] = rounded(&scene)[0];
        let normal = (b - a).cross(c - a).normalize();
        let [s, t] = [0.5, 1e-6].map(|x| x * (1. + vector().x.abs()) / 2.);
        let aim = a + (b - a) * s + (c - a) * t;
        let down = vector().normalize();
        let down = down * -down.dot(normal).signum();
        let height = 2f64.powi(-34) * (1. + 3. * vector().x.abs());
        let origin = aim + down * (height / down.dot(normal));
        let ray = Ray { origin, direction: down };
        let hit = intersector.first_hit(&ray, None);
        assert!(hit.is_some(), "{i}: {ray:?}");
        // Nor is it met from beyond.
        let above = aim - down * (height / down.dot(normal));
        let ray = Ray { origin: above, direction: down };
        assert_eq!(intersector.first_hit(&ray, None), None, "{i}");
    }
}
