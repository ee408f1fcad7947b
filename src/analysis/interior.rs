// Tangled from chapters/interior.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Whether the camera is inside a closed surface.
//!
//! The decision depends on signs that rounding cannot change.

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use crate::bvh::{Bvh, Intersector};
use crate::numerics::cross;
use crate::scene::{Entrance, Triangle, scattered};

/// Whether some ray from the camera leaves the scene; then no closed
/// surface is around it.
pub(crate) fn lets_out(entrance: &Entrance, bvh: &Bvh) -> bool {
    let mut random = Pcg64::seed_from_u64(0);
    (0..RAYS).any(|_| {
        let direction = DVec3::from(random.random::<[f64; 3]>()) - 0.5;
        let ray = entrance.enter(direction.normalize());
        ray.is_none_or(|ray| !bvh.is_occluded(&ray, None))
    })
}

/// The number of rays to try.
const RAYS: usize = 4096;

/// Whether a half line from a point crosses a triangle: positive if so,
/// negative if its extension does, zero if that is uncertain.
fn crossing(&[a, b, c]: &Triangle, point: DVec3) -> Option<f64> {
    if is_touched([a, b, c], point) {
        return Some(0.);
    }
    let [a, b, c] = [a, b, c].map(|corner| corner - point);
    let volume = |p: DVec3, q: DVec3, r: DVec3| {
        let volume = cross(p, q).dot(r);
        let size = p.length() * q.length() * r.length();
        if volume.abs() > CLEAR * size { volume.signum() } else { 0. }
    };
    let sides = [(a, b), (b, c), (c, a)];
    let [x, y, z] = sides.map(|(p, q)| volume(p, q, AHEAD));
    let passes = x.min(y).min(z) < 0. && x.max(y).max(z) > 0.;
    (!passes).then(|| x * y * z * volume(a, b, c))
}

/// The direction of the half line.
const AHEAD: DVec3 = DVec3::new(0.141_592_7, 0.653_589_8, 0.793_238_5);

/// A volume above this part of the product of three lengths has a certain
/// sign: 2^-40.
const CLEAR: f64 = 1. / (1u64 << 40) as f64;

/// Whether a point is on a triangle, or hardly away from it.
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

/// The triangle that represents the part of `i`.
fn find(part: &mut [u32], mut i: u32) -> u32 {
    while part[i as usize] != i {
        part[i as usize] = part[part[i as usize] as usize];
        i = part[i as usize];
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
    let numbers = (0..triangles.len() as u32).into_par_iter();
    let crossing = |i| Some((crossing(&triangles[i as usize], point)?, i));
    let crossed: Vec<_> = numbers.filter_map(crossing).collect();
    if let Some(&(_, i)) = crossed.iter().find(|(sign, _)| *sign == 0.) {
        return Err(i);
    }
    let ahead = crossed.into_iter().filter(|(sign, _)| *sign > 0.);
    let mut part: Vec<_> = (0..triangles.len() as u32).collect();
    let (part, mut open) = (&mut part[..], vec![]);
    // Sort the edges by their ends
    let ends = |&edge: &u32| {
        let corners = triangles[edge as usize / 3];
        let corners = corners.map(|p| p.to_array().map(f64::to_bits));
        let k = edge as usize % 3;
        let (p, q) = (corners[k], corners[(k + 1) % 3]);
        if p < q { [p, q] } else { [q, p] }
    };
    let mut edges: Vec<_> = (0..3 * triangles.len() as u32).collect();
    edges.par_sort_by_cached_key(|edge| scattered(ends(edge)));
    for equal in edges.chunk_by(|a, b| ends(a) == ends(b)) {
        // Unite the triangles of equal edges
        let first = equal[0] / 3;
        open.extend((equal.len() % 2 == 1).then_some(first));
        for edge in equal {
            let (a, b) = (find(part, first), find(part, edge / 3));
            part[a.max(b) as usize] = a.min(b);
        }
    }
    let mut is_odd = vec![false; part.len()];
    ahead.for_each(|(_, i)| is_odd[find(part, i) as usize] ^= true);
    open.iter().for_each(|&i| is_odd[find(part, i) as usize] = false);
    Ok(is_odd.contains(&true))
}
