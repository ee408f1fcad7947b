// Tangled from chapters/spawn.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the nearest triangle to a hit, and the point where a path goes on.
//!
//! The point is on the same side of all triangles as the ray that found
//! it, and farther from each of them than the errors of the next ray.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::DVec3;
use rayon::prelude::*;

use super::intersector::Hit;
use super::search::{Search, is_met};
use super::triangle::{Leaf, NONE, Shear, TriangleTest};
use super::triangle::{clear, near, seen, size};
use super::wide::Wide;
use crate::numerics::cross;
use crate::scene::{Ray, Triangle, Triangles};

/// Another triangle closer to a hit than this makes it doubtful; in
/// units of `clear`.
const CLOSE_BY: f64 = 4.;

/// A ray longer than this part of the size for all triangles has risen
/// by more than 2 `CLOSE_BY` in units of `clear`: 2^-17.
const SHORT: f64 = 1. / (1u64 << 17) as f64;

/// How far a triangle may be from a hit around it, as a part of the
/// size: 2^-33.
const AROUND: f64 = 1. / (1u64 << 33) as f64;

/// Twice the distance that is close by for a size: 2^-44.
fn twice_close_by(size: f64) -> f64 {
    2. * CLOSE_BY * clear(size)
}

/// The same for triangles that may forbid a point before the hit: 2^-38.
const AHEAD: f64 = 1. / (1u64 << 38) as f64;

/// The hit of `ray`, which left the triangle `left`, from its search.
#[inline(always)]
pub fn hit<const N: usize>(
    wide: &Wide<N>,
    ray: &Ray,
    left: Option<u32>,
    search: &Search,
) -> Option<Hit> {
    let (distance, primitive) = (search.distance, search.slot);
    if primitive == NONE {
        return None;
    }
    // Find the point and the normal
    let [a, b, c] = search.leaves.triangle(primitive);
    let normal = cross(b - a, c - a).normalize();
    let away = normal.dot(ray.direction) > 0.;
    let normal = if away { -normal } else { normal };
    // Lift the point off the surface
    let met = ray.origin + ray.direction * distance;
    let height = normal.dot(met - a);
    let size = seen(&[a, b, c], ray.origin);
    let clear = clear(size);
    let mut point = met + normal * (clear - height);
    // Resolve the point if it is doubtful
    let around = Around { point: met, part: AROUND, least: size };
    let short = distance <= search.root * SHORT
        && left.is_some_and(|left| {
            around.has_not_risen(&search.leaves.triangle(left), ray)
        });
    let deep = height.abs() > clear;
    let limit = distance + near(search.root);
    let away = 2. * AROUND * search.root;
    let [low, high] = search.passed;
    let unseen = size > search.least
        && (low - away).cmple(met).all()
        && met.cmple(high + away).all();
    if search.near_tie <= limit || short || deep || unseen {
        let arrival =
            Arrival { wide, ray, distance, around, primitive, left };
        if let Some(safe) = arrival.resolve(deep) {
            point = safe;
        }
    }
    Some(Hit { point, normal, primitive })
}

/// A hit that may be too close to other triangles.
struct Arrival<'a, const N: usize> {
    wide: &'a Wide<N>,
    ray: &'a Ray,
    distance: f64,
    /// The point where the ray meets the triangle that is hit, and how far
    /// others may be from it, at least by the size of that triangle.
    around: Around,
    /// The slot of the triangle that is hit.
    primitive: u32,
    /// The slot of the triangle that the ray left, if it left one.
    left: Option<u32>,
}

impl<const N: usize> Arrival<'_, N> {
    /// A safe point, if the hit is too close to others, or too `deep`.
    #[cold]
    #[inline(never)]
    fn resolve(&self, deep: bool) -> Option<DVec3> {
        let shear = Shear::new(self.ray);
        let close = deep || self.is_low() || self.is_close(&shear);
        close.then(|| self.offset(&shear))
    }

    /// Whether the hit is around the triangle that the ray left, and close to
    /// its plane.
    fn is_low(&self) -> bool {
        self.left.is_some_and(|left| {
            let left = self.wide.leaves.triangle(left);
            self.around.holds(&left, self.ray).is_some()
                && self.around.has_not_risen(&left, self.ray)
        })
    }

    /// Whether a triangle may be close to the hit, other than the triangle
    /// that is hit and the one that the ray left.
    fn is_close(&self, shear: &Shear) -> bool {
        let gap = |at: f64| at - self.distance;
        let asked = |leaf: &Leaf, place, corners: &Triangle, size: f64| {
            let (lane, slot) = place;
            let size = size.max(self.around.least);
            let close_by = CLOSE_BY * clear(size);
            // Reject a triangle whose plane is not close
            let &[a, b, c] = corners;
            let normal = cross(b - a, c - a);
            let height = normal.dot(self.around.point - a).abs();
            if slot == self.primitive
                || Some(slot) == self.left
                || height > 2. * close_by * normal.length()
            {
                return false;
            }
            let near = near(size);
            // Test how closely a triangle is passed
            let passes = || {
                let (direction, met) =
                    (self.ray.direction, self.around.point);
                let flat =
                    corners.map(|p| p - direction * direction.dot(p - met));
                let normal = direction * normal.dot(direction).signum();
                !is_beside(flat, normal, met, FRAC_1_SQRT_2 * close_by)
            };
            match leaf.test(lane, shear, size) {
                // Compare where the ray passes the triangle
                TriangleTest::Through(at) => {
                    at > -near && gap(at).abs() <= near
                }
                TriangleTest::Beside(at) => {
                    at.iter().any(|&at| gap(at) <= near)
                        && at.iter().any(|&at| gap(at) >= -near)
                        && passes()
                }
                TriangleTest::Apart => false,
            }
        };
        self.around.any(self.wide, self.ray, &asked)
    }

    /// A safe point of the ray, not far before the hit.
    fn offset(&self, shear: &Shear) -> DVec3 {
        let Ray { origin, direction } = *self.ray;
        let Around { point, least, .. } = self.around;
        let part = clear(size(self.distance, point));
        let mut back = (2. * part).max(clear(least));
        while back < self.distance {
            let point = origin + direction * (self.distance - back);
            if self.is_safe(shear, point) {
                return point;
            }
            back *= 4.;
        }
        origin
    }

    /// Whether a point of the ray is before all triangles that the ray
    /// meets, and apart from the others.
    fn is_safe(&self, shear: &Shear, point: DVec3) -> bool {
        let asked = |leaf: &Leaf, place, corners: &Triangle, size| {
            let (lane, slot) = place;
            let &[a, b, c] = corners;
            let clear = clear(size);
            let normal = cross(b - a, c - a);
            let side = -normal.dot(self.ray.direction).signum();
            let height = side * normal.dot(point - a);
            let limit = clear * normal.length();
            if height >= limit {
                return false;
            }
            let is_left = Some(slot) == self.left;
            let ahead =
                !is_left && side * normal.dot(self.ray.origin - a) > 0.;
            match leaf.test(lane, shear, size) {
                TriangleTest::Through(at) if ahead && !at.is_nan() => true,
                _ => {
                    height > -limit
                        && !is_beside(*corners, normal, point, clear)
                }
            }
        };
        let around = Around { point, part: AHEAD, least: 0. };
        !around.any(self.wide, self.ray, &asked)
    }
}

/// The surroundings of a point of a ray.
struct Around {
    point: DVec3,
    /// How far away the box of a triangle may be, as a part of its size.
    part: f64,
    /// Or twice the distance that is close by for this size.
    least: f64,
}

impl Around {
    /// Whether `asked` is true of a triangle around the point. It gets the
    /// lane in a leaf, the slot, the corners, and their size.
    fn any<const N: usize>(
        &self,
        wide: &Wide<N>,
        ray: &Ray,
        asked: &impl Fn(&Leaf, (usize, u32), &Triangle, f64) -> bool,
    ) -> bool {
        let far = self.point.abs() + 2. * (self.point - ray.origin).abs();
        let away = self.part * far.max_element();
        let away = away.max(twice_close_by(self.least));
        let within = [self.point - away, self.point + away];
        let enters = |low, high| self.comes_near(low, high, ray);
        let root = (0, wide.region);
        wide.any(root, within, &enters, &mut |leaf, place, triangle| {
            let size = self.holds(triangle, ray);
            size.is_some_and(|size| asked(leaf, place, triangle, size))
        })
    }

    /// The size of a triangle around the point.
    fn holds(&self, corners: &Triangle, ray: &Ray) -> Option<f64> {
        let &[a, b, c] = corners;
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let beyond = (low - self.point).max(self.point - high);
        let size = self.size(corners, ray);
        let away = (self.part * size).max(twice_close_by(self.least));
        (beyond.max_element() <= away).then_some(size)
    }

    /// The size of a triangle for the ray and its point.
    fn size(&self, corners: &Triangle, ray: &Ray) -> f64 {
        seen(corners, ray.origin).max(seen(corners, self.point))
    }

    /// Whether the point is still close to the plane of a triangle that the ray
    /// has left.
    fn has_not_risen(&self, corners: &Triangle, ray: &Ray) -> bool {
        let &[a, b, c] = corners;
        let normal = cross(b - a, c - a);
        let size = self.size(corners, ray).max(self.least);
        let height = normal.dot(self.point - a).abs();
        height <= twice_close_by(size) * normal.length()
    }

    /// Whether the line of the ray passes a box as closely as it has to pass
    /// a triangle that matters.
    fn comes_near(&self, low: DVec3, high: DVec3, ray: &Ray) -> bool {
        let size = self.size(&[low, low, high], ray);
        let aside = twice_close_by(size.max(self.least));
        let half = 0.5 * (high - low) + aside;
        let middle = 0.5 * (low + high) - ray.origin;
        is_met(middle, half, ray.direction)
    }
}

/// Whether a plane separates a triangle from a point, `clear` away from
/// the point: a plane through an edge, perpendicular to the triangle's, or
/// through a corner, perpendicular to the way from there to the point.
fn is_beside(
    [a, b, c]: Triangle,
    normal: DVec3,
    point: DVec3,
    clear: f64,
) -> bool {
    let off_edge = |(p, q, r): (DVec3, DVec3, DVec3)| {
        let outwards = cross(q - p, normal);
        let third = outwards.dot(r - p).max(0.);
        outwards.dot(point - p) - third > clear * outwards.length()
    };
    let off_corner = |(p, q, r): (DVec3, DVec3, DVec3)| {
        let away = point - p;
        let ahead = away.dot(q - p).max(away.dot(r - p));
        ahead <= 0. && away.length() >= clear
    };
    let triples = [(a, b, c), (b, c, a), (c, a, b)];
    triples.into_iter().any(off_edge) || triples.into_iter().any(off_corner)
}

/// The number of triangles so small, compared with the largest or with the
/// extent of the scene, that double precision limits how they are lit.
pub fn too_small(triangles: &Triangles) -> usize {
    let side = |[a, b, c]: Triangle| {
        (a.max(b).max(c) - a.min(b).min(c)).max_element()
    };
    let sides = || {
        let numbers = (0..triangles.corners.len()).into_par_iter();
        numbers.map(|i| side(triangles.get(i)))
    };
    let largest = sides().reduce(|| 0., f64::max);
    let corners = triangles.corners.par_iter().flatten_iter();
    let extent = corners.map(|&i| triangles.vertices[i as usize].abs());
    let extent = extent.reduce(|| DVec3::ZERO, DVec3::max);
    let clear = clear(size(largest, extent));
    sides().filter(|&side| side < FINEST * clear).count()
}

/// The least size of a triangle, in units of the height at which paths go
/// on above the largest: 2^7.
const FINEST: f64 = 128.;

/// A point on a triangle, lifted on the side of this normal by 2^-32 of
/// the triangle's size, where no ray is in doubt about it.
pub fn lifted(corners: &Triangle, point: DVec3, normal: DVec3) -> DVec3 {
    let height = normal.dot(point - corners[0]);
    point + normal * (8. * near(seen(corners, point)) - height)
}

/// Whether a triangle may be this close to a point or closer.
pub fn is_within(corners: &Triangle, point: DVec3, reach: f64) -> bool {
    let &[a, b, c] = corners;
    let normal = cross(b - a, c - a);
    let height = normal.dot(point - a).abs();
    height < reach * normal.length()
        && !is_beside(*corners, normal, point, reach)
}

#[cfg(test)]
#[path = "../../tests/units/spawn.rs"]
mod tests;
