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
use std::f64::consts::FRAC_1_SQRT_2;

use bytemuck::Pod;
use glam::DVec3;

use super::intersector::Hit;
use super::triangle::{Leaf, Margins, NONE, Search, Shear, TriangleTest};
use super::wide::{Node, Wide};
use crate::numerics::cross;
use crate::scene::{Ray, Triangle};

// Say how far from a surface is safe
/// Other triangles this close to a hit make it doubtful, times `clear`.
const CLOSE_BY: f64 = 4.;

/// A ray that is longer than this part of the size for all triangles has
/// risen by more than 2 `CLOSE_BY`, times `clear`: 2^-17.
const SHORT: f64 = 1. / (1u64 << 17) as f64;

/// Part of its factors by which an ordinary triple product may be wrong,
/// at most: 2^-47.
const SLOPPY: f64 = 1. / (1u64 << 47) as f64;

/// How far from a point a triangle may be to be around it, as part of
/// the size: 2^-33.
const AROUND: f64 = 1. / (1u64 << 33) as f64;

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
    let own = margins(&[a, b, c], ray.origin);
    let clear = own.clear();
    let mut point = met + normal * (clear - height);
    // Settle the point if it is doubtful
    let short = distance <= search.root * SHORT
        && left.is_some_and(|left| {
            let corners = search.leaves.triangle(left);
            has_not_risen(&corners, ray, met, own.size)
        });
    let deep = height.abs() > clear;
    let limit = distance + Margins::of(search.root).near;
    let unseen = own.size > search.least;
    if search.near_tie <= limit || short || deep || unseen {
        let arrival = Arrival { ray, distance, own, primitive, left };
        if let Some(safe) = arrival.settle(wide, met, deep) {
            point = safe;
        }
    }
    Some(Hit { point, normal, primitive })
}

/// The margins of a triangle for rays from or to a point.
#[inline(always)]
fn margins(corners: &Triangle, point: DVec3) -> Margins {
    let [a, b, c] = corners.map(|corner| (corner - point).abs());
    Margins::new(a.max(b).max(c).max_element(), point)
}

/// Whether a point of a ray is still close to the plane of a triangle that
/// it has left, beside margins of a size at least.
fn has_not_risen(
    corners: &Triangle,
    ray: &Ray,
    met: DVec3,
    least: f64,
) -> bool {
    let &[a, b, c] = corners;
    let normal = cross(b - a, c - a);
    let size = margins(corners, ray.origin).size.max(least);
    let size = size.max(margins(corners, met).size);
    let limit = 2. * CLOSE_BY * Margins::of(size).clear();
    normal.dot(met - a).abs() <= limit * normal.length()
}

// Settle a doubtful hit
/// A hit that may be too close to other triangles.
struct Arrival<'a> {
    ray: &'a Ray,
    distance: f64,
    /// The margins of the triangle that is hit.
    own: Margins,
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
        close.then(|| self.offset(wide, &shear, met))
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
        self.any_around(wide, met, &|leaf, (lane, slot), corners| {
            let &[a, b, c] = corners;
            let size = self.margins(corners, met).size;
            let margins = Margins::of(size.max(self.own.size));
            let close_by = CLOSE_BY * margins.clear();
            // Dismiss a triangle whose plane is clearly away
            let (u, v, w) = (b - a, c - a, met - a);
            let across = u.cross(v);
            let size = |v: DVec3| v.abs().max_element();
            let error = size(u) * size(v) * size(w) * SLOPPY;
            let limit = 2. * close_by * across.abs().element_sum();
            if across.dot(w).abs() > limit + error {
                return false;
            }
            // Dismiss a triangle whose plane is not close
            let normal = cross(b - a, c - a);
            let height = normal.dot(met - a).abs();
            if slot == self.primitive
                || height > 2. * close_by * normal.length()
            {
                return false;
            }
            if Some(slot) == self.left {
                return true;
            }
            let near = margins.near;
            match leaf.test(lane, shear, &margins) {
                // Compare where the ray passes the triangle
                TriangleTest::Through(at) => {
                    at > -near && gap(at).abs() <= near
                }
                TriangleTest::Beside(at) => {
                    at.iter().any(|&at| gap(at) <= near)
                        && at.iter().any(|&at| gap(at) >= -near)
                        && self.passes(corners, normal, met, close_by)
                }
                TriangleTest::Apart => false,
            }
        })
    }

    // Ask how closely a triangle is passed
    /// Whether the ray passes a triangle, with this normal, more closely than
    /// `close_by`, near its point `met`.
    fn passes(
        &self,
        corners: &Triangle,
        normal: DVec3,
        met: DVec3,
        close_by: f64,
    ) -> bool {
        let direction = self.ray.direction;
        let flat = corners.map(|p| p - direction * direction.dot(p - met));
        let normal = direction * normal.dot(direction).signum();
        !is_beside(flat, normal, met, FRAC_1_SQRT_2 * close_by)
    }

    /// The margins of a triangle for this ray and one of its points.
    fn margins(&self, corners: &Triangle, point: DVec3) -> Margins {
        let size = margins(corners, self.ray.origin).size;
        Margins::of(margins(corners, point).size.max(size))
    }

    // Find the way back to a safe point
    /// A safe point of the ray, not far before the hit.
    fn offset<const N: usize>(
        &self,
        wide: &Wide<N>,
        shear: &Shear,
        met: DVec3,
    ) -> DVec3
    where
        Node<N>: Pod,
    {
        let Ray { origin, direction } = *self.ray;
        let least = Margins::new(self.distance, met).clear();
        let mut back = 2. * least;
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
        !self.any_around(wide, point, &|leaf, (lane, _), corners| {
            let &[a, b, c] = corners;
            let margins = self.margins(corners, point);
            let clear = margins.clear();
            let normal = cross(b - a, c - a);
            let side = -normal.dot(self.ray.direction).signum();
            let height = side * normal.dot(point - a);
            let limit = clear * normal.length();
            if height >= limit {
                return false;
            }
            let ahead = side * normal.dot(self.ray.origin - a) > 0.;
            match leaf.test(lane, shear, &margins) {
                TriangleTest::Through(_) if ahead => true,
                _ => {
                    height > -limit
                        && !is_beside(*corners, normal, point, clear)
                }
            }
        })
    }

    // Visit the triangles around a point
    /// Whether `asked` is true of a triangle whose box, grown by `AROUND`,
    /// holds the point: of a lane of a leaf, its slot, and its corners.
    fn any_around<const N: usize>(
        &self,
        wide: &Wide<N>,
        point: DVec3,
        asked: &impl Fn(&Leaf, (usize, u32), &[DVec3; 3]) -> bool,
    ) -> bool
    where
        Node<N>: Pod,
    {
        let far = point.abs() + 2. * (point - self.ray.origin).abs();
        let around = (far.max_element() * AROUND).max(self.around());
        let (least, most) = (point - around, point + around);
        let holds = |low: DVec3, high: DVec3| {
            (low.cmple(most) & least.cmple(high)).all()
        };
        wide.any(&holds, &|leaf, place, triangle| {
            self.is_around(triangle, point) && asked(leaf, place, triangle)
        })
    }

    fn is_around(&self, corners: &Triangle, point: DVec3) -> bool {
        let &[a, b, c] = corners;
        let (least, greatest) = (a.min(b).min(c), a.max(b).max(c));
        let beyond = (least - point).max(point - greatest);
        let size = self.margins(corners, point).size;
        beyond.max_element() <= (AROUND * size).max(self.around())
    }

    /// How far away triangles matter because of the height of the spawn point
    /// above the triangle that is hit: twice what is close by.
    fn around(&self) -> f64 {
        4. * CLOSE_BY * self.own.clear()
    }
}

// Tell a point from a triangle
/// Whether a plane that is perpendicular to that of a triangle or to the
/// way from a corner is between the triangle and a point, and `clear`
/// from the point.
fn is_beside(
    [a, b, c]: Triangle,
    normal: DVec3,
    point: DVec3,
    clear: f64,
) -> bool {
    let off_edge = |(p, q): (DVec3, DVec3)| {
        let outwards = cross(q - p, normal);
        outwards.dot(point - p) >= clear * outwards.length()
    };
    let off_corner = |(p, q, r): (DVec3, DVec3, DVec3)| {
        let away = point - p;
        let ahead = away.dot(q - p).max(away.dot(r - p));
        ahead <= 0. && away.length() >= clear
    };
    [(a, b), (b, c), (c, a)].into_iter().any(off_edge)
        || [(a, b, c), (b, c, a), (c, a, b)].into_iter().any(off_corner)
}
