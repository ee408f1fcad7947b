// Tangled from chapters/interior.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Whether the camera is inside a closed surface.
//!
//! That is decided by exact predicates.

use std::collections::HashSet;

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;
use robust::{Coord, Coord3D, orient2d, orient3d};

use crate::bvh::Intersector;
use crate::numerics::cross;
use crate::scene::{Entrance, Triangle, scattered};

/// Whether some ray from the camera leaves the scene; then no closed
/// surface is around it.
pub fn lets_out(
    entrance: &Entrance,
    intersector: &impl Intersector,
) -> bool {
    let mut random = Pcg64::seed_from_u64(0);
    (0..RAYS).any(|_| {
        let direction = DVec3::from(random.random::<[f64; 3]>()) - 0.5;
        let ray = entrance.enter(direction.normalize());
        ray.is_none_or(|ray| !intersector.is_occluded(&ray, None))
    })
}

/// Rays that are tried.
const RAYS: usize = 4096;

/// Whether a line from a point in the direction of the first axis crosses
/// the edge from `a` to `b`, seen along the third.
fn is_crossed(a: DVec3, b: DVec3, point: DVec3) -> bool {
    if (a.y > point.y) == (b.y > point.y) {
        return false;
    }
    let (low, high) = if a.y < b.y { (a, b) } else { (b, a) };
    orient2d(flat(low), flat(high), flat(point)) >= 0.
}

/// A point as it is seen along the third axis.
fn flat(DVec3 { x, y, .. }: DVec3) -> Coord<f64> {
    Coord { x, y }
}

/// How a triangle lies to a point: positive above it, negative below, zero
/// so close that it cannot be told; none if it is neither above nor below.
fn height(&[a, b, c]: &Triangle, point: DVec3) -> Option<f64> {
    if is_touched([a, b, c], point) {
        return Some(0.);
    }
    let edges = [(a, b), (b, c), (c, a)];
    let crossed = |&(a, b): &(DVec3, DVec3)| is_crossed(a, b, point);
    let is_in = edges.into_iter().filter(crossed).count() % 2 == 1;
    is_in.then(|| {
        let turn = orient2d(flat(a), flat(b), flat(c));
        let coord = |DVec3 { x, y, z }: DVec3| Coord3D { x, y, z };
        let [a, b, c, p] = [a, b, c, point].map(coord);
        orient3d(a, b, c, p) * turn.signum()
    })
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
    let height = |i| Some((height(&triangles[i as usize], point)?, i));
    let heights: Vec<_> = numbers.filter_map(height).collect();
    if let Some(&(_, i)) = heights.iter().find(|height| height.0 == 0.) {
        return Err(i);
    }
    let above = heights.into_iter().filter(|height| height.0 > 0.);
    Ok(above.map(|(_, i)| i).collect())
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
    let all = (0..triangles.len()).into_par_iter();
    let mut edges: Vec<_> = all.flat_map_iter(edge).collect();
    edges.par_sort_unstable();
    edges
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

/// Whether a closed surface of `triangles` is around a point.
///
/// # Errors
/// The number of a triangle that is too close to the point to tell.
pub fn is_inside(
    triangles: &[Triangle],
    point: DVec3,
) -> Result<bool, u32> {
    let above = above(triangles, point)?;
    if above.is_empty() {
        return Ok(false);
    }
    let mut part: Vec<_> = (0..triangles.len() as u32).collect();
    let (part, mut open) = (&mut part[..], vec![]);
    for equal in edges(triangles).chunk_by(|a, b| a.0 == b.0) {
        // Unite the triangles of equal edges
        let first = equal[0].1 / 4;
        // Find the ends of an edge
        let ends = |edge: &(u64, u32)| {
            let [a, b, c] = triangles[edge.1 as usize / 4];
            let (p, q) = [(a, b), (b, c), (c, a)][edge.1 as usize % 4];
            let (p, q) = (p.to_array(), q.to_array());
            if p < q { (p, q) } else { (q, p) }
        };
        let alike = equal.iter().all(|edge| ends(edge) == ends(&equal[0]));
        if !alike || equal.len() % 2 != 0 {
            open.extend(equal.iter().map(|edge| edge.1 / 4));
        }
        for edge in equal.iter().filter(|_| alike) {
            let (a, b) = (find(part, first), find(part, edge.1 / 4));
            part[a.max(b) as usize] = a.min(b);
        }
    }
    let open = open.into_iter().map(|i| find(part, i));
    let open: HashSet<_> = open.collect();
    let names = above.into_iter().map(|i| find(part, i));
    let mut names: Vec<_> = names.filter(|i| !open.contains(i)).collect();
    names.sort_unstable();
    Ok(names.chunk_by(|a, b| a == b).any(|same| same.len() % 2 == 1))
}
