// One vertex, in steps of the last place.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::{DVec3, Vec3};
use litpt::bvh::{Bvh, Intersector};
use litpt::scene::{Ray, Scene, Triangle};
use litpt_book::solids::icosphere;

use super::super::Done;
use super::{Out, grey};

/// Pixels along each side.
const SIDE: u32 = 128;

/// Angle between the rays of neighbouring pixels.
const STEP: f64 = 5e-9;

/// The triangles around a vertex of a closed sphere, as rays from inside see
/// them: by the test of Möller and Trumbore in single precision, and by ours.
pub fn draw(out: &mut Out) -> Done {
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
    let faces = bvh.triangles();
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
