// One edge and one vertex, in steps of the last place.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::{DVec3, Vec3};
use litpt::analysis::interior::above;
use litpt::bvh::{Bvh, Intersector};
use litpt::scene::{Ray, Scene, Triangle};
use litpt_book::solids::icosphere;

use super::super::Done;
use super::{Out, grey};

/// Pixels along each side.
const SIDE: u32 = 128;

pub fn draw(out: &mut Out) -> Done {
    edge(out)?;
    vertex(out)
}

/// Which of two triangles at an edge claims points near it, in steps of the
/// last place; each triangle computes from its own first corner.
fn edge(out: &mut Out) -> Done {
    let [q, r] = [[-7.3f32, -8.1], [17.9, 19.7]].map(|p| p.map(f64::from));
    let [low, high] = [[r[0], q[1]], [q[0], r[1]]];
    let middle = q[1] + (0.75 - q[0]) * (r[1] - q[1]) / (r[0] - q[0]);
    let point = |i: u32, step: f64| {
        let (x, y) = (i % SIDE, SIDE - 1 - i / SIDE);
        let place = |k| (f64::from(k) - 0.5 * f64::from(SIDE)) * step;
        let below = (middle / step).floor() * step;
        [0.75 + place(x), below + place(y)]
    };
    let all = 0..SIDE * SIDE;
    let (single, double) = (1. / (1u64 << 24) as f64, f64::EPSILON / 2.);
    let singles = all.clone().map(|i| {
        let flat = |[x, y]: [f64; 2]| [x as f32, y as f32];
        let [p, q, r] = [point(i, single), q, r].map(flat);
        claimed([left_single(q, r, p), left_single(r, q, p)])
    });
    out.picture("edge-single", SIDE, singles.collect())?;
    let doubles = all.clone().map(|i| {
        let p = point(i, double);
        claimed([left_double(q, r, p), left_double(r, q, p)])
    });
    out.picture("edge-double", SIDE, doubles.collect())?;
    let lift = |[x, y]: [f64; 2]| DVec3::new(x, y, 1.);
    let pair = [[q, r, high], [r, q, low]].map(|t| t.map(lift));
    let exact = all.map(|i| {
        let [x, y] = point(i, double);
        let found = above(&pair, DVec3::new(x, y, 0.));
        let found = found.unwrap_or_default();
        claimed([0, 1].map(|k| found.contains(&k)))
    });
    out.picture("edge-exact", SIDE, exact.collect())
}

/// Whether a point is not on the right of a line, by rounded arithmetic.
fn left_single(a: [f32; 2], b: [f32; 2], p: [f32; 2]) -> bool {
    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) >= 0.
}

fn left_double(a: [f64; 2], b: [f64; 2], p: [f64; 2]) -> bool {
    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) >= 0.
}

/// Two greys for the two triangles, black for both, white for neither.
fn claimed(by: [bool; 2]) -> f64 {
    grey(match by {
        [true, false] => 0.8,
        [false, true] => 0.55,
        [true, true] => 0.,
        [false, false] => 1.,
    })
}

/// Angle between the rays of neighbouring pixels.
const STEP: f64 = 5e-9;

/// The triangles around a vertex of a closed sphere, as rays from inside see
/// them: by the test of Möller and Trumbore in single precision, and by ours.
fn vertex(out: &mut Out) -> Done {
    let scene = Scene::new(&icosphere(4));
    let bvh = Bvh::new(&scene)?;
    let triangles = scene.triangles.to_vec();
    let corner = triangles[700][0];
    let has = |t: &Triangle| t.contains(&corner);
    let around: Vec<u32> = (0..triangles.len() as u32)
        .filter(|&i| has(&triangles[i as usize]))
        .collect();
    let level = |place: usize| grey(0.3 + 0.1 * place as f64);
    // Straight below the vertex, so that directions have all their digits.
    let down = if corner.z > 0. { -1. } else { 1. };
    let origin = (corner + 1000. * down * DVec3::Z).as_vec3().as_dvec3();
    let ray = |i: u32| {
        let [x, y] = [i % SIDE, i / SIDE]
            .map(|k| (f64::from(k) - f64::from(SIDE) / 2.) * STEP);
        Ray { origin, direction: DVec3::new(x, y, -down) }
    };
    let mut lost = 0;
    let singles = (0..SIDE * SIDE).map(|i| {
        let test = |&k: &u32| {
            let corners = triangles[k as usize].map(|p| p.as_vec3());
            is_met(&ray(i), corners)
        };
        let place = around.iter().position(test);
        lost += usize::from(place.is_none());
        place.map_or(1., level)
    });
    let singles = singles.collect();
    out.picture("vertex-single", SIDE, singles)?;
    let faces: Vec<_> = bvh.triangles().collect();
    let face = |k: &u32| {
        let corners = &triangles[*k as usize];
        faces.iter().find(|(_, t)| t == corners).map(|f| f.0)
    };
    let around: Vec<_> = around.iter().map(face).collect();
    let mut missed = 0;
    let ours = (0..SIDE * SIDE).map(|i| {
        let hit = bvh.first_hit(&ray(i), None);
        missed += usize::from(hit.is_none());
        let face = hit.map(|hit| bvh.face(hit.primitive));
        let place = around.iter().position(|f| *f == face);
        place.map_or(if hit.is_none() { 1. } else { 0. }, level)
    });
    let ours = ours.collect();
    out.picture("vertex-ours", SIDE, ours)?;
    let all = f64::from(SIDE * SIDE);
    out.number("vertex", "single", 100. * lost as f64 / all)?;
    out.number("vertex", "ours", 100. * missed as f64 / all)
}

/// Möller and Trumbore (1997), in single precision.
fn is_met(ray: &Ray, [a, b, c]: [Vec3; 3]) -> bool {
    let (o, d) = (ray.origin.as_vec3(), ray.direction.as_vec3());
    let (e1, e2) = (b - a, c - a);
    let p = d.cross(e2);
    let inverse = 1. / e1.dot(p);
    let s = o - a;
    let u = s.dot(p) * inverse;
    let q = s.cross(e1);
    let v = d.dot(q) * inverse;
    u >= 0. && v >= 0. && u + v <= 1. && e2.dot(q) * inverse > 0.
}
