// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Whether the camera is inside a closed surface.
//!
//! That is decided by exact predicates.

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use robust::{Coord, Coord3D, orient2d, orient3d};

use crate::bvh::{Hit, Intersector};
use crate::camera::Camera;
use crate::numerics::cross;
use crate::sampler::cosine_direction;
use crate::scene::{Ray, Scene, Triangle, scattered};

/// Whether some path from the camera leaves the scene; then no closed
/// surface is around it.
pub fn lets_out(
    scene: &Scene,
    intersector: &impl Intersector,
    camera: &Camera,
) -> bool {
    (0..PATHS).any(|n| {
        let mut random = Pcg64::seed_from_u64(n);
        let direction = camera.direction(random.random(), random.random());
        let first = scene.enter(camera.position, direction);
        leaves(first, intersector, &mut random)
    })
}

/// Paths that are tried, and rays of each.
const PATHS: u64 = 256;
const RAYS: usize = 16;

/// Whether a path with this first ray leaves the scene.
fn leaves(
    first: Option<Ray>,
    intersector: &impl Intersector,
    random: &mut Pcg64,
) -> bool {
    let (mut ray, mut from) = (first, None);
    for _ in 0..RAYS {
        let hit = ray.and_then(|ray| intersector.first_hit(&ray, from));
        let Some(Hit { point, normal, primitive }) = hit else {
            return true;
        };
        let (r, turn) = (random.random(), random.random());
        let direction = cosine_direction(normal, r, turn);
        ray = Some(Ray { origin: point, direction });
        from = Some(primitive);
    }
    false
}

/// Whether a line from a point in the direction of the first axis crosses
/// the edge from `a` to `b`, seen along the third.
fn is_crossed(a: DVec3, b: DVec3, point: DVec3) -> bool {
    if (a.y > point.y) == (b.y > point.y) {
        return false;
    }
    let (low, high) = if a.y < b.y { (a, b) } else { (b, a) };
    let flat = |DVec3 { x, y, .. }: DVec3| Coord { x, y };
    orient2d(flat(low), flat(high), flat(point)) >= 0.
}

/// How a triangle lies to a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// Neither above nor below it.
    Beside,
    Above,
    Below,
    /// So close that it cannot be told.
    Touching,
}

impl Place {
    fn of(triangle: &Triangle, point: DVec3) -> Self {
        let [a, b, c] = *triangle;
        if is_touched([a, b, c], point) {
            return Self::Touching;
        }
        let edges = [(a, b), (b, c), (c, a)];
        let crossed = edges.map(|(a, b)| is_crossed(a, b, point));
        if crossed.into_iter().fold(false, |odd, one| odd ^ one) {
            // Compare the height of the triangle
            let flat = |DVec3 { x, y, .. }: DVec3| Coord { x, y };
            let turn = orient2d(flat(a), flat(b), flat(c));
            let coord = |DVec3 { x, y, z }: DVec3| Coord3D { x, y, z };
            let [a, b, c] = [a, b, c].map(coord);
            // Positive for a point below a triangle that turns to the left.
            let below = orient3d(a, b, c, coord(point)) * turn.signum();
            return match below {
                _ if below > 0. => Self::Above,
                _ if below < 0. => Self::Below,
                _ => Self::Touching,
            };
        }
        Self::Beside
    }
}

/// Whether a point is hardly away from a triangle, or on it.
fn is_touched([a, b, c]: [DVec3; 3], point: DVec3) -> bool {
    let (low, high) = (a.min(b).min(c), a.max(b).max(c));
    let beyond = (low - point).max(point - high).max_element();
    if beyond > SLACK {
        return false;
    }
    let normal = cross(b - a, c - a);
    normal.dot(point - a).abs() <= SLACK * normal.length()
}

/// Closer than this counts as touching: 2^-20.
const SLACK: f64 = 1. / (1 << 20) as f64;

/// The numbers of the triangles above a point; or else that of one so
/// close that it cannot be told on which side of it the point is.
pub fn above(
    triangles: &[Triangle],
    point: DVec3,
) -> Result<Vec<u32>, u32> {
    let numbers = (0..triangles.len() as u32).into_par_iter();
    let place = |i| (Place::of(&triangles[i as usize], point), i);
    let hits = numbers.map(place);
    let hits: Vec<_> = hits.filter(|hit| hit.0 != Place::Beside).collect();
    if let Some(hit) = hits.iter().find(|hit| hit.0 == Place::Touching) {
        return Err(hit.1);
    }
    let above = hits.into_iter().filter(|hit| hit.0 == Place::Above);
    Ok(above.map(|hit| hit.1).collect())
}

/// The triangles of a scene in parts that hang together by edges.
pub struct Parts {
    /// The part of each triangle, named by the number of one of its
    /// triangles.
    part: Vec<u32>,
    /// Whether the part of that name is closed.
    closed: Vec<bool>,
}

impl Parts {
    pub fn new(triangles: &[Triangle]) -> Self {
        let mut edges = edges(triangles);
        edges.par_sort_unstable();
        let mut part: Vec<_> = (0..triangles.len() as u32).collect();
        let mut closed = vec![true; triangles.len()];
        let mut open = vec![];
        for equal in edges.chunk_by(|a, b| a.0 == b.0) {
            // Unite the triangles of equal edges
            // Find the ends of an edge
            let ends = |edge: &(u64, u32)| {
                let [a, b, c] = triangles[edge.1 as usize / 4];
                let (p, q) = [(a, b), (b, c), (c, a)][edge.1 as usize % 4];
                let (p, q) = (p.to_array(), q.to_array());
                if p < q { (p, q) } else { (q, p) }
            };
            let first = equal[0].1 / 4;
            let alike =
                equal.iter().all(|edge| ends(edge) == ends(&equal[0]));
            if !alike || equal.len() % 2 != 0 {
                open.extend(equal.iter().map(|edge| edge.1 / 4));
            }
            if alike {
                equal
                    .iter()
                    .for_each(|edge| unite(&mut part, first, edge.1 / 4));
            }
        }
        // Name each part by one triangle
        for i in 0..part.len() as u32 {
            let name = find(&mut part, i);
            part[i as usize] = name;
        }
        for i in open {
            closed[part[i as usize] as usize] = false;
        }
        Self { part, closed }
    }

    /// Whether a closed part has an odd number of the triangles `above` a
    /// point, which is therefore inside.
    pub fn enclose(&self, above: &[u32]) -> bool {
        let name = |&i: &u32| self.part[i as usize];
        let mut names: Vec<_> = above.iter().map(name).collect();
        names.sort_unstable();
        let mut parts = names.chunk_by(|a, b| a == b);
        parts.any(|same| {
            same.len() % 2 == 1 && self.closed[same[0] as usize]
        })
    }
}

/// The edges of all triangles: a number, the triangle, and which of its
/// three edges.
fn edges(triangles: &[Triangle]) -> Vec<(u64, u32)> {
    let edge = |i: usize| {
        let number = move |k: u32| 4 * i as u32 + k;
        let [a, b, c] = triangles[i].each_ref().map(scattered);
        [(a, b), (b, c), (c, a)]
            .map(|(a, b)| a.wrapping_add(b))
            .into_iter()
            .zip((0..3).map(number))
    };
    (0..triangles.len()).into_par_iter().flat_map_iter(edge).collect()
}

/// The triangle that stands for the part of `i`.
fn find(part: &mut [u32], mut i: u32) -> u32 {
    while part[i as usize] != i {
        let next = part[part[i as usize] as usize];
        part[i as usize] = next;
        i = next;
    }
    i
}

/// Makes the parts of two triangles one.
fn unite(part: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(part, a), find(part, b));
    part[a.max(b) as usize] = a.min(b);
}

/// Whether a closed surface of `triangles` is around a point.
///
/// # Errors
/// The number of a triangle that is too close to the point to tell.
pub fn is_inside(
    triangles: &[Triangle],
    point: DVec3,
) -> Result<bool, u32> {
    let above = above(triangles, point)?;
    Ok(!above.is_empty() && Parts::new(triangles).enclose(&above))
}
