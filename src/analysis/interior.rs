// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Closed surfaces, and what they separate from the camera.
//!
//! Whether a point is inside is decided by exact predicates.

// Name what the enclosures import
use std::cmp::Reverse;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use robust::{Coord, orient2d, orient3d};

use super::boxes::{Bounds, Boxes, Search};
use super::outlook::coord;
use crate::numerics::cross;
use crate::scene::{Triangle, scattered};

// Tell triangles above a point exactly
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
enum OutputTarget {
    /// Neither above nor below it.
    Beside,
    Above,
    Below,
    /// So close that it cannot be told.
    Touching,
}

impl OutputTarget {
    fn of(triangle: &Triangle, point: DVec3) -> Self {
        let [a, b, c] = triangle.map(|corner| corner.as_dvec3());
        if is_touched([a, b, c], point) {
            return Self::Touching;
        }
        let edges = [(a, b), (b, c), (c, a)];
        let crossed = edges.map(|(a, b)| is_crossed(a, b, point));
        if crossed.into_iter().fold(false, |odd, one| odd ^ one) {
            // Compare the height of the triangle
            let flat = |DVec3 { x, y, .. }: DVec3| Coord { x, y };
            let turn = orient2d(flat(a), flat(b), flat(c));
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

// Ask whether the camera may be enclosed
/// The triangles above a point; none if one is so close that nobody can
/// tell on which side of it the point is.
pub fn above(triangles: &[Triangle], point: DVec3) -> Option<Vec<u32>> {
    let numbers = (0..triangles.len() as u32).into_par_iter();
    let place = |i| (OutputTarget::of(&triangles[i as usize], point), i);
    let hits = numbers.map(place);
    let hits: Vec<_> =
        hits.filter(|hit| hit.0 != OutputTarget::Beside).collect();
    let touched = hits.iter().any(|hit| hit.0 == OutputTarget::Touching);
    let above = hits.iter().filter(|hit| hit.0 == OutputTarget::Above);
    (!touched).then(|| above.map(|hit| hit.1).collect())
}

// Divide a scene into parts
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

    // Ask whether a part encloses a point
    /// The closed parts that have an odd number of the triangles `above` a
    /// point, which is therefore inside.
    pub fn around(&self, above: &[u32]) -> Vec<u32> {
        let name = |&i: &u32| self.part[i as usize];
        let mut names: Vec<_> = above.iter().map(name).collect();
        names.sort_unstable();
        let odd = names.chunk_by(|a, b| a == b);
        let odd =
            odd.filter(|same| same.len() % 2 == 1).map(|same| same[0]);
        odd.filter(|&name| self.closed[name as usize]).collect()
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

// Find the parts inside of others
/// For each triangle whether it is inside of a closed part.
pub fn hidden(triangles: &[Triangle], parts: &Parts) -> Vec<bool> {
    // Gather the triangles of each part
    let mut order: Vec<_> = (0..triangles.len() as u32).collect();
    order.par_sort_by_key(|&i| parts.part[i as usize]);
    let same = |a: &u32, b: &u32| {
        parts.part[*a as usize] == parts.part[*b as usize]
    };
    let members: Vec<_> = order.chunk_by(same).map(Vec::from).collect();
    let bounds: Vec<_> =
        members.par_iter().map(|m| bounds(triangles, m)).collect();
    let mut hidden = vec![false; triangles.len()];
    // Choose the closed parts that may hide others
    let is_closed = |shell: &usize| {
        parts.closed[parts.part[members[*shell][0] as usize] as usize]
    };
    let mut shells: Vec<_> = (0..members.len()).filter(is_closed).collect();
    shells.sort_by_key(|&shell| Reverse(members[shell].len()));
    shells.truncate(SHELLS);
    let mut work = 0;
    for shell in shells {
        // Hide the parts inside of one closed part
        let is_hidden = |part: usize| hidden[members[part][0] as usize];
        // Select the parts within its box
        let within = |&part: &usize| {
            let (inner, outer) = (bounds[part], bounds[shell]);
            outer.low.cmplt(inner.low).all()
                && inner.high.cmplt(outer.high).all()
        };
        let inner = (0..members.len()).filter(within);
        let inner: Vec<_> =
            inner.filter(|&part| !is_hidden(part)).collect();
        if inner.is_empty() || is_hidden(shell) {
            continue;
        }
        let asked: usize =
            inner.iter().map(|&part| members[part].len()).sum();
        if work + asked + members[shell].len() > triangles.len() {
            continue;
        }
        work += asked + members[shell].len();
        let walls: Vec<_> =
            members[shell].iter().map(|&i| triangles[i as usize]).collect();
        let shell = Shell { boxes: Boxes::new(&walls), walls };
        for part in inner {
            let contents =
                members[part].iter().map(|&i| &triangles[i as usize]);
            if shell.encloses(contents) {
                members[part]
                    .iter()
                    .for_each(|&i| hidden[i as usize] = true);
            }
        }
    }
    hidden
}

/// The box of some triangles.
fn bounds(triangles: &[Triangle], numbers: &[u32]) -> Bounds {
    let boxes = numbers.iter().map(|&i| Bounds::of(&triangles[i as usize]));
    boxes.fold(Bounds::EMPTY, Bounds::union)
}

/// Closed parts that are asked whether they hide others.
const SHELLS: usize = 64;

/// A closed part, ready for questions.
struct Shell {
    walls: Vec<Triangle>,
    boxes: Boxes,
}

impl Shell {
    // Ask whether a part is inside and apart
    /// Whether triangles that hang together are inside, and away from
    /// the walls.
    fn encloses<'a>(
        &self,
        mut triangles: impl Iterator<Item = &'a Triangle> + Clone,
    ) -> bool {
        let Some(first) = triangles.clone().next() else { return false };
        let point = first[0].as_dvec3();
        let mut column =
            Column { walls: &self.walls, point, is_inside: false };
        self.boxes.search(&mut column);
        column.is_inside
            && triangles.all(|triangle| self.is_clear(triangle))
    }

    // Ask whether a triangle is apart from the walls
    /// Whether a triangle's box is apart from those of the walls.
    fn is_clear(&self, triangle: &Triangle) -> bool {
        let margin = Vec3::splat(MARGIN);
        let Bounds { low, high } = Bounds::of(triangle);
        let own = Bounds { low: low - margin, high: high + margin };
        let mut contact = Contact { walls: &self.walls, own, found: false };
        self.boxes.search(&mut contact);
        !contact.found
    }
}

/// How far what is inside must be from a wall: 2^-10.
const MARGIN: f32 = 1. / 1024.;

/// The walls above a point.
struct Column<'a> {
    walls: &'a [Triangle],
    point: DVec3,
    /// Whether their number is odd.
    is_inside: bool,
}

impl Search for Column<'_> {
    fn promise(&self, bounds: &Bounds) -> Option<f64> {
        let (low, high) = bounds.doubles();
        let beside = self.point.cmplt(low) | self.point.cmpgt(high);
        let above = self.point.z <= high.z;
        (above && !beside.x && !beside.y).then_some(0.)
    }

    fn look(&mut self, numbers: &[u32]) -> bool {
        for &i in numbers {
            let place =
                OutputTarget::of(&self.walls[i as usize], self.point);
            self.is_inside ^= place == OutputTarget::Above;
        }
        true
    }
}

/// The walls close to a box.
struct Contact<'a> {
    walls: &'a [Triangle],
    own: Bounds,
    found: bool,
}

impl Search for Contact<'_> {
    fn promise(&self, bounds: &Bounds) -> Option<f64> {
        self.own.meets(bounds).then_some(0.)
    }

    fn look(&mut self, numbers: &[u32]) -> bool {
        let meets =
            |&i: &u32| self.own.meets(&Bounds::of(&self.walls[i as usize]));
        self.found = numbers.iter().any(meets);
        !self.found
    }
}
