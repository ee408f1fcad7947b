// Tangled from chapters/polygons.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Faces with more than three corners: where a fan of triangles does not
//! fill a face, other triangles between its corners replace it.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::{DVec2, DVec3};
use rayon::prelude::*;
use spade::ConstrainedDelaunayTriangulation as Cdt;
use spade::{MIN_ALLOWED_VALUE, Point2, Triangulation};

use super::mesh::Mesh;
use crate::numerics::{cross, exponent, shift};

/// Replaces the fans that do not fill their faces; returns the numbers,
/// from 0, of odd faces: bent, with corners far from a common plane, or
/// crossed, with an outline that crosses itself.
pub fn fill(mesh: &mut Mesh) -> Vec<u32> {
    let Mesh { vertices, triangles, joined, .. } = mesh;
    let look = |group: &[u32]| {
        let first = group[0] - 1;
        let fan = &triangles[first as usize..=first as usize + group.len()];
        let judge = || (first, fan.len(), judge(fan, vertices));
        (!is_plain(fan, vertices)).then(judge)
    };
    let groups = joined.par_chunk_by(|a, b| a + 1 == *b);
    let judged: Vec<_> = groups.filter_map(look).collect();
    let (mut odd, mut new) = (vec![], vec![]);
    for (first, count, (cut, is_odd)) in judged {
        let face = || first - joined.partition_point(|&i| i < first) as u32;
        odd.extend(is_odd.then(face));
        new.extend(cut.map(|cut| (first as usize, count, cut)));
    }
    if !new.is_empty() {
        // Replace fans by other triangles
        let mut is_joined = vec![false; triangles.len()];
        joined.iter().for_each(|&i| is_joined[i as usize] = true);
        let (mut replaced, mut flags, mut from) = (vec![], vec![], 0);
        new.push((triangles.len(), 0, vec![]));
        for (first, count, cut) in new {
            replaced.extend(&triangles[from..first]);
            flags.extend(&is_joined[from..first]);
            flags.extend((0..cut.len()).map(|i| i > 0));
            replaced.extend(cut);
            from = first + count;
        }
        let numbers = (0..).zip(flags).filter(|(_, joined)| *joined);
        (*triangles, *joined) =
            (replaced, numbers.map(|(i, _)| i).collect());
    }
    odd
}

/// Whether this is the fan of a quadrilateral that is nearly flat and
/// has its first diagonal inside.
fn is_plain(fan: &[[u32; 3]], vertices: &[DVec3]) -> bool {
    let [[a, b, c], [.., d]] = fan else { return false };
    let [a, b, c, d] = [a, b, c, d].map(|&i| vertices[i as usize]);
    let (u, v) = ((b - a).cross(c - a), (c - a).cross(d - a));
    let product = u.dot(v);
    let both = u.length_squared() * v.length_squared();
    product > 0. && product * product > 0.99 * both
}

/// Triangles that fill the face, unless its fan does; and whether the face
/// is odd.
fn judge(
    fan: &[[u32; 3]],
    vertices: &[DVec3],
) -> (Option<Vec<[u32; 3]>>, bool) {
    // Scale the corners of the face
    let corners = [fan[0][0], fan[0][1]].into_iter();
    let corners: Vec<_> = corners.chain(fan.iter().map(|t| t[2])).collect();
    let place = |&i: &u32| vertices[i as usize];
    let far = corners.iter().map(|i| place(i).abs().max_element());
    let scale = -exponent(far.fold(0., f64::max));
    let scaled = corners.iter().map(|i| shift(place(i), scale));
    let points: Vec<_> = scaled.collect();
    let sides: Vec<_> = points.iter().map(|&p| p - points[0]).collect();
    let areas = sides.windows(2).map(|q| q[0].cross(q[1]));
    let normal: DVec3 = areas.clone().sum();
    let area: f64 = areas.map(|area| area.length()).sum();
    if normal.length() <= 1e-12 * area {
        return (None, area > 1e-15 * sides.len() as f64);
    }
    // Project the face along its normal
    let axis = normal.abs().max_position();
    let (x, y) = ((axis + 1) % 3, (axis + 2) % 3);
    let (x, y) = if normal[axis] < 0. { (y, x) } else { (x, y) };
    let outline = points.iter().map(|p| DVec2::new(p[x], p[y]));
    let outline: Vec<_> = outline.collect();
    let is_bent = is_bent(&sides, normal);
    let is_filled = fills(&outline);
    if is_filled && !has_seam(&sides) {
        return (None, is_bent);
    }
    let cut = triangulate(&outline, &points);
    let is_odd = is_bent || cut.is_none() && !is_filled;
    let named = |cut: Vec<[usize; 3]>| {
        cut.iter().map(|t| t.map(|i| corners[i])).collect()
    };
    (cut.map(named), is_odd)
}

/// Whether the corners, seen from the first, are far from a plane.
fn is_bent(sides: &[DVec3], normal: DVec3) -> bool {
    let along = |axis: DVec3| {
        let heights = sides.iter().map(move |q| q.dot(axis));
        let low = heights.clone().fold(0., f64::min);
        heights.fold(0., f64::max) - low
    };
    let size = DVec3::AXES.map(along).into_iter().fold(0., f64::max);
    along(normal.normalize_or_zero()) > size / 8.
}

/// Whether the fan around the first corner fills the outline.
fn fills(outline: &[DVec2]) -> bool {
    let sides = outline.iter().map(|&p| p - outline[0]);
    let low = sides.clone().fold(DVec2::ZERO, DVec2::min);
    let size = sides.clone().fold(DVec2::ZERO, DVec2::max) - low;
    let far = outline.iter().fold(DVec2::ZERO, |far, p| far.max(p.abs()));
    let slack = f64::EPSILON * 4. * (size.x * far.y + size.y * far.x);
    let is_left = |a: DVec2, b: DVec2| a.perp_dot(b) >= -slack;
    let ahead = sides.clone().find(|&q| q != DVec2::ZERO);
    let ahead = ahead.unwrap_or_default();
    let mut pairs = sides.clone().zip(sides.skip(1));
    pairs.all(|(a, b)| is_left(a, b) && is_left(ahead, b))
}

/// Whether a triangle of the fan has different corners but no area, or the
/// outline comes back to its first corner; `sides` are the corners seen
/// from there.
fn has_seam(sides: &[DVec3]) -> bool {
    let zero = DVec3::ZERO;
    let is_flat = |q: &[DVec3]| {
        let differ = q[0] != zero && q[1] != zero && q[0] != q[1];
        differ && cross(q[0], q[1]) == zero
    };
    let inner = &sides[2..sides.len() - 1];
    sides.windows(2).any(is_flat) || inner.contains(&zero)
}

/// Triangles between the corners of an outline, which cover where it
/// winds; none if the outline crosses itself.
fn triangulate(
    outline: &[DVec2],
    points: &[DVec3],
) -> Option<Vec<[usize; 3]>> {
    let mut cdt = Cdt::<Point2<f64>>::new();
    // Add the corners in an order without runs
    let bits = usize::BITS - outline.len().leading_zeros();
    let backwards = |k: usize| k.reverse_bits() >> (usize::BITS - bits);
    let order = (0..1 << bits).map(backwards);
    let mut vertices = vec![None; outline.len()];
    let mut numbers: Vec<usize> = vec![];
    for i in order.filter(|&i| i < outline.len()) {
        // Add a corner to the triangulation
        let is_small = |x: f64| x.abs() < MIN_ALLOWED_VALUE;
        let place = outline[i].to_array();
        let [x, y] = place.map(|x| if is_small(x) { 0. } else { x });
        let place = Point2::new(x, y);
        let vertex = match vertices[i & i.saturating_sub(1)] {
            Some(near) => cdt.insert_with_hint(place, near).ok()?,
            None => cdt.insert(place).ok()?,
        };
        if vertex.index() == numbers.len() {
            numbers.push(i);
        } else if points[numbers[vertex.index()]] != points[i] {
            return None;
        }
        vertices[i] = Some(vertex);
    }
    // Add the outline to the sides of triangles
    let vertices: Vec<_> = vertices.into_iter().flatten().collect();
    let mut steps = vec![0; cdt.num_directed_edges()];
    let ends = vertices.iter().zip(vertices.iter().cycle().skip(1));
    for (&a, &b) in ends.filter(|(a, b)| a != b) {
        let sides = cdt.try_add_constraint(a, b);
        let corner = |v: usize| points[numbers[v]];
        let on = |side: &_| cdt.directed_edge(*side).to().index();
        let mut on = sides.iter().map(on).map(corner);
        let (a, b) = (corner(a.index()), corner(b.index()));
        let beside = |p: DVec3| (b - a).cross(p - a).length();
        let slack = ROUNDED * (b - a).length();
        if sides.is_empty() || !on.all(|p| beside(p) <= slack) {
            return None;
        }
        for side in sides {
            steps[side.index()] += 1;
            steps[side.rev().index()] -= 1;
        }
    }
    // Select the triangles where the outline winds
    let mut seen = vec![false; cdt.num_all_faces()];
    let hull = cdt.convex_hull().map(|side| (side.fix().rev(), 0));
    let mut waiting: Vec<_> = hull.collect();
    let mut triangles = vec![];
    while let Some((side, right)) = waiting.pop() {
        let face = cdt.directed_edge(side).face().as_inner();
        let Some(face) = face.filter(|f| !seen[f.fix().index()]) else {
            continue;
        };
        seen[face.fix().index()] = true;
        let winding = right + steps[side.index()];
        let [a, b, c] = face.vertices().map(|v| numbers[v.fix().index()]);
        if winding != 0 {
            triangles.push(if winding > 0 { [a, b, c] } else { [a, c, b] });
        }
        let sides = face.adjacent_edges();
        waiting.extend(sides.map(|side| (side.fix().rev(), winding)));
    }
    (!triangles.is_empty()).then_some(triangles)
}

/// How far off a side rounding puts a corner: less than 2^-47.
const ROUNDED: f64 = 1. / (1u64 << 47) as f64;
