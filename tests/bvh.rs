// The intersector against a loop over all triangles (chapter "The hierarchy").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use litpt_book::escapes::uniform;

/// The nearest hit by the textbook: the ray's plane equation, and the side
/// of each edge, in double precision.
fn nearest(scene: &Scene, ray: &Ray) -> Option<(f64, DVec3)> {
    let mut nearest: Option<(f64, DVec3)> = None;
    for t in scene.triangles.to_vec() {
        let [a, b, c] = t.map(|corner| corner - ray.origin);
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

/// A mesh of triangles that share no corners.
pub fn apart(triangles: impl Iterator<Item = Triangle>) -> Mesh {
    let vertices: Vec<_> = triangles.flatten().collect();
    let numbers = (0..vertices.len() as u32 / 3).map(|i| 3 * i);
    let triangles = numbers.map(|i| [i, i + 1, i + 2]).collect();
    Mesh { vertices, triangles, ..Mesh::default() }
}

fn soup(n: usize, size: f64) -> Mesh {
    let mut random = Pcg64Mcg::seed_from_u64(11);
    apart((0..n).map(|_| {
        let centre = uniform(&mut random) * 10.;
        [0; 3].map(|_| centre + uniform(&mut random) * size)
    }))
}

/// Triangles around each other, each smaller by 3 %.
fn nested(n: i32) -> Mesh {
    let corners = [DVec3::X, DVec3::Y, DVec3::NEG_ONE];
    apart((0..n).map(|i| corners.map(|corner| corner * 0.97f64.powi(i))))
}

#[test]
fn the_hierarchy_finds_what_a_loop_over_all_triangles_finds() {
    // A distance errs by 2^13 * 2^-53, the rounding of the scene's size, over
    // the cosine of incidence; 1e-8 allows 1e-4.
    for (mesh, qualities, error, least) in [
        (soup(1, 5.), &BOTH[..], 1e-8, 0),
        (soup(3, 5.), &BOTH, 1e-8, 0),
        (soup(500, 2.), &BOTH, 1e-8, 0),
        (cavity(0.2, 12), &BOTH, 1e-8, 0),
        (nested(2000), &BOTH, 1e-10, 300),
    ] {
        let scene = Scene::new(&mesh);
        let forms = forms(&scene, qualities);
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let mut hits = 0;
        for i in 0..3000 {
            // Half of the rays aim at the centre, where nested ones all are.
            let origin = uniform(&mut random) * 4000.;
            let reach = if i % 2 == 0 { 1. } else { 4096. };
            let aim = uniform(&mut random) * reach;
            let direction = (aim - origin).normalize();
            let ray = Ray { origin, direction };
            let expected = nearest(&scene, &ray);
            hits += u32::from(expected.is_some());
            for found in forms.iter().map(|bvh| bvh.first_hit(&ray, None)) {
                let Some(Hit { point, normal, .. }) = found else {
                    assert!(expected.is_none(), "{ray:?}: {expected:?}");
                    continue;
                };
                let (distance, plane) = expected.expect("no hit");
                let miss = (point - origin - direction * distance).length();
                assert!(miss < error * (1. + distance), "{ray:?}: {miss}");
                assert!(normal.dot(direction) <= 0.);
                assert!((normal.dot(plane).abs() - 1.).abs() < 1e-12);
            }
        }
        assert!(hits > least);
    }
}

/// The same hierarchy in all forms that this processor can walk.
fn forms(scene: &Scene, qualities: &[Quality]) -> Vec<Bvh> {
    let isas = Isa::ALL.into_iter().filter(|isa| isa.is_available());
    let with = |isa, quality| Bvh::with(scene, quality, isa).unwrap();
    isas.flat_map(|isa| qualities.iter().map(move |&q| with(isa, q)))
        .collect()
}

const BOTH: [Quality; 2] = [Quality::FAST, Quality::THOROUGH];

#[test]
fn of_two_triangles_at_one_distance_the_first_in_the_file_is_met() {
    // A roof: they share a horizontal edge over the y axis.
    let ridge = [DVec3::Z - DVec3::Y, DVec3::Z + DVec3::Y];
    let vertices = [ridge, [-DVec3::X, DVec3::X]].concat();
    let triangles = vec![[0, 1, 2], [1, 0, 3]];
    let mut mesh = Mesh { vertices, triangles, ..Mesh::default() };
    for slope in [-1., 1.] {
        let scene = Scene::new(&mesh);
        for intersector in forms(&scene, &BOTH) {
            for y in [-1000., 0., 0.3, 2000.] {
                let origin = DVec3::new(0., y, 3000.);
                let ray = Ray { origin, direction: -DVec3::Z };
                let hit = intersector.first_hit(&ray, None).unwrap();
                assert_eq!(hit.normal.x.signum(), slope, "{y}");
            }
        }
        // The right one first.
        mesh.triangles.reverse();
    }
}

#[test]
fn a_path_that_leaves_a_triangle_does_not_meet_others_in_its_plane() {
    // A closed box whose walls are pasted over with posters that lie in
    // the plane of the wall and have other corners than it.
    let mut walls = vec![];
    for (axis, side) in (0..3).flat_map(|i| [(i, -1.), (i, 1.)]) {
        for (size, turn) in [(1., 0.), (0.5, 0.3), (0.5, 0.3), (0.7, 0.9)] {
            let [a, b, c, d] = [0., 1., 2., 3.].map(|k| {
                let angle = (turn + k) * std::f64::consts::FRAC_PI_2;
                let (s, c) = angle.sin_cos();
                // The walls' corners are exact; of posters nothing matters
                // but that they are in the plane.
                let whole = |v: f64| if turn == 0. { v.round() } else { v };
                let mut p = DVec3::splat(side);
                p[(axis + 1) % 3] = whole(size * (c - s));
                p[(axis + 2) % 3] = whole(size * (c + s));
                p
            });
            walls.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mesh = apart(walls.into_iter());
    let scene = Scene::new(&mesh);
    for intersector in forms(&scene, &BOTH) {
        let mut random = Pcg64Mcg::seed_from_u64(3);
        let mut ray = Ray { origin: DVec3::ZERO, direction: DVec3::X };
        let mut from = None;
        for _ in 0..30_000 {
            let hit = intersector.first_hit(&ray, from).expect("an escape");
            let place = hit.point.abs();
            assert!((place.max_element() - 4096.).abs() < 1e-8, "{place}");
            // Inwards: a path that turns round between two triangles of
            // a wall would find itself outside.
            assert!(hit.normal.dot(hit.point) < 0., "{hit:?}");
            let (r, turn) = (random.random(), random.random());
            let direction = cosine_direction(hit.normal, r, turn);
            ray = Ray { origin: hit.point, direction };
            from = Some(hit.primitive);
        }
    }
}

/// Polygons are split, triangles without area and copies left out, and the
/// rest is reordered: a hit still knows its face.
#[test]
fn a_hit_knows_its_face_in_the_file() {
    let mut text = String::new();
    for i in 0..300 {
        let (x, y) = (2 * (i % 20), 2 * (i / 20));
        for (dx, dy) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
            text += &format!("v {} {} {}\n", x + dx, y + dy, i % 7);
        }
        // Every third square is preceded by a line, every fourth by a copy.
        let [a, b, c, d] = [1, 2, 3, 4].map(|k| 4 * i + k);
        if i % 3 == 0 {
            text += &format!("f {a} {a} {b}\n");
        }
        if i % 4 == 0 {
            text += &format!("f {a} {b} {c}\n");
        }
        text += &format!("f {a} {b} {c} {d}\n");
    }
    let mesh = litpt::scene::read_obj(text.as_bytes()).unwrap();
    let scene = Scene::new(&mesh);
    let [flat, copies] = &scene.left_out;
    assert_eq!((flat.len(), copies.len()), (100, 75));
    assert_eq!((flat[0], copies[0]), (0, 2));
    for bvh in forms(&scene, &BOTH) {
        let mut face = 0;
        for i in 0..300 {
            let (x, y) = (2 * (i % 20), 2 * (i / 20));
            let corner = DVec3::new(x.into(), y.into(), 50.);
            let ask = |dx, dy| {
                let at = corner + DVec3::new(dx, dy, 0.);
                let ray = scene.frame.entrance(at).enter(-DVec3::Z);
                let hit = bvh.first_hit(&ray.unwrap(), None).unwrap();
                bvh.face(hit.primitive)
            };
            // The first half belongs to the copy that came first, if any.
            face += u32::from(i % 3 == 0);
            assert_eq!(ask(0.7, 0.3), face);
            face += u32::from(i % 4 == 0);
            assert_eq!(ask(0.3, 0.7), face);
            face += 1;
        }
        let all = bvh.triangles();
        let mut all: Vec<_> = all.iter().map(|one| one.0).collect();
        all.sort_unstable();
        assert_eq!(all, scene.triangles.faces);
    }
}

/// The tests of vector instructions pass where the processor lacks them: so
/// what the program finds must be what the system says, and is told.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn vector_instructions_are_found_where_the_system_names_them() {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap();
    let flags =
        info.lines().find(|line| line.starts_with("flags")).unwrap();
    let has = |names: &str| {
        let mut names = names.split_whitespace();
        names.all(|name| flags.split_whitespace().any(|flag| flag == name))
    };
    let avx2 = has("avx2 fma bmi1 bmi2 abm popcnt");
    let avx512 = avx2 && has("avx512f avx512vl avx512dq");
    assert_eq!(Isa::Avx2.is_available(), avx2);
    assert_eq!(Isa::Avx512.is_available(), avx512);
    for isa in Isa::ALL.into_iter().filter(|isa| !isa.is_available()) {
        skip(&format!("no test has looked at {isa}"));
    }
}

#[test]
fn triangles_are_too_small_below_the_limit_and_not_at_it() {
    let size = |x: f64| [DVec3::ZERO, DVec3::X * x, DVec3::Y * x];
    let of = |triangles: &[_]| {
        let faces = (0..triangles.len() as u32).collect();
        too_small(&solids::apart(triangles, faces))
    };
    // The largest is 16, and so is the largest coordinate.
    let limit = 2f64.powi(-40) * (1.125 * 16. + 0.125 * 16.);
    let [less, more] = [limit * (1. - f64::EPSILON), limit];
    assert_eq!(of(&[size(16.), size(less), size(more)]), 1);
    // Far away from the origin even triangles of one size are.
    let moved = |x: f64| size(1.).map(|p| p + DVec3::X * x);
    assert_eq!(of(&[moved(2f64.powi(42))]), 0);
    assert_eq!(of(&[moved(2f64.powi(44))]), 1);
    // A vertex that no triangle uses is none of the scene.
    let mut stray = solids::apart(&[size(1.)], vec![0]);
    stray.vertices.push(DVec3::splat(2f64.powi(44)));
    assert_eq!(too_small(&stray), 0);
}

#[test]
fn few_rays_want_a_fast_build_and_many_a_thorough_one() {
    assert_eq!(Quality::expecting(0, 0.), Quality::FAST);
    for triangles in [1, 1000, 10_000_000] {
        let expecting = |rays| Quality::expecting(triangles, rays);
        let each = |rays: f64| expecting(rays * triangles as f64);
        assert_eq!(expecting(0.), Quality::FAST);
        assert_eq!(each(19.), Quality::FAST);
        assert_eq!(each(240.).to_string(), "quality 0.24");
        assert_ne!(each(999.), Quality::THOROUGH);
        assert_eq!(each(1001.), Quality::THOROUGH);
        assert_eq!(expecting(f64::INFINITY), Quality::THOROUGH);
    }
}
