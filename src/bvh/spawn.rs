// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the nearest triangle to a hit, from whose point a path goes on.
//!
//! The point is on the same side of all triangles as the ray that found
//! it, and not nearer to any of them than the errors of the next ray.

// Name what the origin imports
use bytemuck::Pod;
use glam::DVec3;

use super::intersector::Hit;
use super::triangle::{Leaf, NEAR, NONE, Search, Shear, TriangleTest};
use super::wide::{Node, Wide};
use crate::numerics::cross;
use crate::scene::Ray;

// Say how far from a surface is safe
/// How far off its surface a hit is put, and at least how far from other
/// triangles, by our computation: 2^-34.
const CLEAR: f64 = 1. / (1u64 << 34) as f64;

/// Other triangles this close to a hit make it doubtful: 2^-32.
const CLOSE_BY: f64 = 1. / (1u64 << 32) as f64;

/// A ray that is longer than this has risen by more than 2^-31: 2^-4.
const SHORT: f64 = 1. / 16.;

/// Part of its factors by which an ordinary triple product may be wrong,
/// at most: 2^-47.
const SLOPPY: f64 = 1. / (1u64 << 47) as f64;

// Make the search's result a hit
/// The hit of `ray`, which left the triangle `left`, on the nearest one.
#[inline(always)]
pub fn hit<const N: usize>(
    wide: &Wide<N>,
    ray: &Ray,
    left: Option<u32>,
    search: &Search,
) -> Option<Hit>
where
    Node<N>: Pod,
{
    let (distance, primitive) = (search.distance, search.slot);
    if primitive == NONE {
        return None;
    }
    // Find the point and the normal
    let [a, b, c] = search.triangle();
    let normal = cross(b - a, c - a).normalize();
    let away = normal.dot(ray.direction) > 0.;
    let normal = if away { -normal } else { normal };
    // Put the point off the surface
    let met = ray.origin + ray.direction * distance;
    let height = normal.dot(met - a);
    let mut point = met + normal * (CLEAR - height);
    // Settle the point if it is doubtful
    let short = left.is_some() && distance <= SHORT;
    let deep = height.abs() > 0.5 * CLOSE_BY;
    if search.near_tie <= distance + NEAR || short || deep {
        let arrival = Arrival { ray, distance, primitive, left };
        if let Some(safe) = arrival.settle(wide, met, deep) {
            point = safe;
        }
    }
    Some(Hit { point, normal, primitive })
}

// Settle a doubtful hit
/// A hit that may be too close to other triangles.
struct Arrival<'a> {
    ray: &'a Ray,
    distance: f64,
    /// The slot of the triangle that is hit.
    primitive: u32,
    /// That of the triangle which the ray left, if it left one.
    left: Option<u32>,
}

impl Arrival<'_> {
    /// A safe point, if the hit at `met` is too close to others, or too
    /// `deep`.
    #[cold]
    #[inline(never)]
    fn settle<const N: usize>(
        &self,
        wide: &Wide<N>,
        met: DVec3,
        deep: bool,
    ) -> Option<DVec3>
    where
        Node<N>: Pod,
    {
        let shear = Shear::new(self.ray);
        let close = deep || self.is_close(wide, &shear, met);
        close.then(|| self.offset(wide, &shear))
    }

    // Ask whether others are close to the hit
    /// Whether a triangle other than that of the hit may be close to it.
    fn is_close<const N: usize>(
        &self,
        wide: &Wide<N>,
        shear: &Shear,
        met: DVec3,
    ) -> bool
    where
        Node<N>: Pod,
    {
        let gap = |at: f64| at - self.distance;
        any_around(wide, met, &|leaf, (lane, slot), &[a, b, c]| {
            // Dismiss a triangle whose plane is clearly away
            let (u, v, w) = (b - a, c - a, met - a);
            let across = u.cross(v);
            let size = |v: DVec3| v.abs().max_element();
            let error = size(u) * size(v) * size(w) * SLOPPY;
            let limit = 2. * CLOSE_BY * across.abs().element_sum();
            if across.dot(w).abs() > limit + error {
                return false;
            }
            let normal = cross(b - a, c - a);
            let height = normal.dot(met - a).abs();
            if slot == self.primitive
                || height > 2. * CLOSE_BY * normal.length()
            {
                return false;
            }
            if Some(slot) == self.left {
                return self.distance <= SHORT;
            }
            match leaf.test(lane, shear) {
                // Compare where the ray passes the triangle
                TriangleTest::Through(at) => {
                    at > -NEAR && gap(at).abs() <= NEAR
                }
                TriangleTest::Beside(at) => {
                    at.iter().any(|&at| gap(at) <= NEAR)
                        && at.iter().any(|&at| gap(at) >= -NEAR)
                }
                TriangleTest::Apart => false,
            }
        })
    }

    // Find the way back to a safe point
    /// A safe point of the ray, not far before the hit.
    fn offset<const N: usize>(&self, wide: &Wide<N>, shear: &Shear) -> DVec3
    where
        Node<N>: Pod,
    {
        let Ray { origin, direction } = *self.ray;
        let mut back = 2. * CLEAR;
        while back < self.distance {
            let point = origin + direction * (self.distance - back);
            if self.is_safe(wide, shear, point) {
                return point;
            }
            back *= 4.;
        }
        origin
    }

    // Ask whether a point is safe
    /// Whether a point of the ray is before all triangles that the ray
    /// meets, and apart from the others.
    fn is_safe<const N: usize>(
        &self,
        wide: &Wide<N>,
        shear: &Shear,
        point: DVec3,
    ) -> bool
    where
        Node<N>: Pod,
    {
        !any_around(wide, point, &|leaf, (lane, _), &[a, b, c]| {
            let normal = cross(b - a, c - a);
            let side = -normal.dot(self.ray.direction).signum();
            let height = side * normal.dot(point - a);
            let limit = CLEAR * normal.length();
            if height >= limit {
                return false;
            }
            let ahead = side * normal.dot(self.ray.origin - a) > 0.;
            match leaf.test(lane, shear) {
                TriangleTest::Through(_) if ahead => true,
                _ => {
                    height > -limit && !is_beside([a, b, c], normal, point)
                }
            }
        })
    }
}

// Visit the triangles around a point
/// Whether `asked` is true of a triangle whose box, grown by `AROUND`,
/// holds the point: of a lane of a leaf, its slot, and its corners.
fn any_around<const N: usize>(
    wide: &Wide<N>,
    point: DVec3,
    asked: &impl Fn(&Leaf, (usize, u32), &[DVec3; 3]) -> bool,
) -> bool
where
    Node<N>: Pod,
{
    let holds = |low: DVec3, high: DVec3| {
        (low.cmple(point) & point.cmple(high)).all()
    };
    wide.any(&holds, &|leaf, place, triangle| {
        is_around(triangle, point) && asked(leaf, place, triangle)
    })
}

/// How far from a point a triangle may be to be around it: 2^-20.
const AROUND: f64 = 1. / (1 << 20) as f64;

fn is_around(&[a, b, c]: &[DVec3; 3], point: DVec3) -> bool {
    let (least, greatest) = (a.min(b).min(c), a.max(b).max(c));
    let beyond = (least - point).max(point - greatest);
    beyond.max_element() <= AROUND
}

// Tell a point from a triangle
/// Whether a plane that is perpendicular to that of a triangle or to the
/// way from a corner is between the triangle and a point, and `CLEAR`
/// from the point.
fn is_beside([a, b, c]: [DVec3; 3], normal: DVec3, point: DVec3) -> bool {
    let off_edge = |(p, q): (DVec3, DVec3)| {
        let outwards = cross(q - p, normal);
        outwards.dot(point - p) >= CLEAR * outwards.length()
    };
    let off_corner = |(p, q, r): (DVec3, DVec3, DVec3)| {
        let away = point - p;
        let ahead = away.dot(q - p).max(away.dot(r - p));
        ahead <= 0. && away.length() >= CLEAR
    };
    [(a, b), (b, c), (c, a)].into_iter().any(off_edge)
        || [(a, b, c), (b, c, a), (c, a, b)].into_iter().any(off_corner)
}
