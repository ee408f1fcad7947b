// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Rays and triangles in twice the precision of a double. Differences of
//! doubles are exact.

use std::array;

use glam::DVec3;
use litpt::scene::{Ray, Triangle};
use twofloat::TwoFloat;

/// The relative error of one rounding to double precision.
pub const U: f64 = f64::EPSILON / 2.;

const ZERO: TwoFloat = TwoFloat::from_f64(0.);

type Vector<const N: usize> = [TwoFloat; N];

fn difference(a: DVec3, b: DVec3) -> Vector<3> {
    array::from_fn(|i| TwoFloat::new_sub(a[i], b[i]))
}

fn dot<const N: usize>(a: &Vector<N>, b: &Vector<N>) -> TwoFloat {
    (0..N).fold(ZERO, |sum, i| sum + a[i] * b[i])
}

fn length<const N: usize>(a: &Vector<N>) -> TwoFloat {
    dot(a, a).sqrt()
}

fn cross(a: &Vector<3>, b: &Vector<3>) -> Vector<3> {
    array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

/// How far zero is from the segment from `p` to `p + e`.
fn from_segment<const N: usize>(p: &Vector<N>, e: &Vector<N>) -> f64 {
    let along = dot(e, e);
    let at = match along > 0. {
        true => (-dot(p, e)) / along,
        false => ZERO,
    };
    let at = at.max(ZERO).min(TwoFloat::from(1.));
    length(&array::from_fn::<_, N, _>(|i| p[i] + e[i] * at)).hi()
}

fn sides(corners: &Triangle) -> [Vector<3>; 3] {
    array::from_fn(|i| difference(corners[(i + 1) % 3], corners[i]))
}

/// How far a point is from a triangle.
pub fn gap(point: DVec3, corners: &Triangle) -> f64 {
    let ways = corners.map(|corner| difference(corner, point));
    let sides = sides(corners);
    let normal = cross(&sides[0], &sides[1]);
    let area = length(&normal);
    let is_over =
        |i: usize| dot(&normal, &cross(&sides[i], &ways[i])) <= 0.;
    if area > 0. && (0..3).all(is_over) {
        return (dot(&normal, &ways[0]) / area).hi().abs();
    }
    let apart = (0..3).map(|i| from_segment(&ways[i], &sides[i]));
    apart.fold(f64::INFINITY, f64::min)
}

/// How a ray passes a triangle.
pub struct Cut {
    /// Whether it goes through, and not close to the outline.
    pub is_clear: bool,
    /// The distances along the ray of the triangle's points that are close to
    /// it, or more.
    pub low: f64,
    pub high: f64,
    /// The distance of the triangle's plane.
    pub plane: f64,
    /// The sine of the angle between the ray and the plane, less what the
    /// roundings of a computed normal can take from it.
    pub sine: f64,
}

/// How the line of a ray passes a triangle, of which points in the distance
/// `aside` from it are close, in coordinates that are sheared along the ray;
/// nothing if there are none.
pub fn cut(ray: &Ray, corners: &Triangle, aside: f64) -> Option<Cut> {
    let d = ray.direction.to_array();
    let size = d.map(f64::abs);
    let z = if size[2] > size[0].max(size[1]) {
        2
    } else {
        usize::from(size[1] > size[0])
    };
    let (x, y) = ((z + 1) % 3, (z + 2) % 3);
    let slope = [x, y].map(|i| TwoFloat::new_div(d[i], d[z]));
    let flat = |v: &Vector<3>| -> Vector<2> {
        [v[x] - slope[0] * v[z], v[y] - slope[1] * v[z]]
    };
    let ways = corners.map(|corner| difference(corner, ray.origin));
    let sides = sides(corners);
    let [places, edges] =
        [ways, sides].map(|vectors| vectors.map(|v| flat(&v)));
    let area = |a: &Vector<2>, b: &Vector<2>| a[0] * b[1] - a[1] * b[0];
    let sign = |i: usize| area(&places[i], &edges[i]);
    let is_through =
        (0..3).all(|i| sign(i) > 0.) || (0..3).all(|i| sign(i) < 0.);
    let apart = (0..3).map(|i| from_segment(&places[i], &edges[i]));
    let apart = apart.fold(f64::INFINITY, f64::min);
    if !is_through && apart > aside {
        return None;
    }
    // The heights of the corners bound that of the hit.
    let heights = ways.map(|way| way[z].hi());
    let least = heights.into_iter().fold(f64::INFINITY, f64::min);
    let most = heights.into_iter().fold(f64::NEG_INFINITY, f64::max);
    let (mut low, mut high, mut plane) = (least, most, 0.);
    let whole = area(&edges[0], &edges[1]);
    let longest =
        edges.map(|e| length(&e).hi()).into_iter().fold(0., f64::max);
    // The plane's slope turns a displacement aside into one along the ray.
    if whole.hi().abs() > 2f64.powi(-90) * longest * longest {
        let [[a, b], [c, e]] = [edges[0], edges[1]];
        let [rise, other] = [sides[0][z], sides[1][z]];
        let slope = [
            (rise * e - other * b) / whole,
            (other * a - rise * c) / whole,
        ];
        let height = ways[0][z] - dot(&slope, &places[0]);
        let doubt = length(&slope).hi() * (aside * (1. + 1e-9));
        plane = height.hi();
        (low, high) = (low.max(plane - doubt), high.min(plane + doubt));
        (low, high) = (low.min(high), high.max(low));
    }
    let stretch = 1. / d[z];
    let (s, t) = (low * stretch, high * stretch);
    let normal = cross(&sides[0], &sides[1]);
    let direction = d.map(TwoFloat::from);
    let steep = dot(&normal, &direction).hi().abs() / length(&normal).hi();
    // Each component of a side is rounded by U of itself.
    let product = length(&sides[0]).hi() * length(&sides[1]).hi();
    let tilt = 8. * U * (1. + product / length(&normal).hi());
    Some(Cut {
        is_clear: is_through && apart > aside,
        low: s.min(t),
        high: s.max(t),
        plane: plane * stretch,
        sine: (steep - tilt).max(0.),
    })
}
