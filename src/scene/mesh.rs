// Tangled from chapters/scene.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A mesh in the coordinates of its file.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::DVec3;
use rayon::prelude::*;

use crate::error::Result;
use crate::numerics::cross;

/// An indexed triangle mesh in the coordinates of its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions of the vertices, each finite. A vertex that was not, which
    /// no face may use, is zero.
    pub vertices: Vec<DVec3>,
    /// Three indices into `vertices` for each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The triangles, in ascending order, that belong to the same face as
    /// the one before.
    pub joined: Vec<u32>,
    /// The names that the file gives to its faces, in its order.
    pub marks: Vec<Mark>,
}

/// A name for all faces from one on, until the next name of its kind.
#[derive(Clone, Debug, PartialEq)]
pub struct Mark {
    /// The first of these faces, from 0.
    pub face: u32,
    /// What the name is given to.
    pub kind: MarkKind,
    /// The name.
    pub name: String,
}

/// A thing that a file gives a name to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarkKind {
    /// An object.
    Object,
    /// A group, or several around blanks.
    Group,
    /// A material.
    Material,
    /// A file of materials.
    Library,
}

impl Mesh {
    /// Checks that its numbers are finite and its indices in range, as they
    /// are in a mesh that was read.
    ///
    /// # Errors
    /// They are not.
    pub fn check(&self) -> Result<()> {
        let (vertices, triangles) = (&self.vertices, &self.triangles);
        let finite = vertices.par_iter().all(|place| place.is_finite());
        let is_there = |&i: &u32| (i as usize) < vertices.len();
        let is_whole = |three: &[u32; 3]| three.iter().all(is_there);
        let is_later = |&i: &u32| 0 < i && (i as usize) < triangles.len();
        let joined = &self.joined;
        let in_order = joined.is_sorted_by(|a, b| a < b);
        let fault = if !finite {
            "a vertex is not finite"
        } else if !triangles.par_iter().all(is_whole) {
            "a triangle has a vertex that is not there"
        } else if !in_order || !joined.iter().all(is_later) {
            "joined triangles are not there, or not in order"
        } else {
            return Ok(());
        };
        Err(fault.into())
    }

    /// The number of its face, from 0, for each triangle.
    pub fn faces(&self) -> Vec<u32> {
        let mut joined = self.joined.iter().copied().peekable();
        let mut before = 0;
        let face = |i| {
            before += u32::from(joined.next_if_eq(&i).is_some());
            i - before
        };
        (0..self.triangles.len() as u32).map(face).collect()
    }

    /// The extreme corners of the box around all triangles; zeros if there
    /// are none.
    pub fn corners(&self) -> [DVec3; 2] {
        let used = self.triangles.par_iter().flatten_iter();
        let used = used.map(|&i| [self.vertices[i as usize]; 2]);
        let both =
            |[a, b]: [DVec3; 2], [c, d]: [DVec3; 2]| [a.min(c), b.max(d)];
        let corners = used.reduce_with(both).unwrap_or_default();
        corners.map(|corner| corner + DVec3::ZERO)
    }

    /// The axis that points up, if the areas of the faces show it plainly.
    pub fn up(&self) -> Option<DVec3> {
        let [low, high] = self.corners();
        let (mut net, mut area) = (DVec3::ZERO, 0.);
        let mut ends = [DVec3::ZERO; 2];
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|i| self.vertices[i as usize]);
            let normal = cross(b - a, c - a) / 2.;
            (net, area) = (net + normal, area + normal.length());
            // Add the triangle to the ends that it covers
            let across = normal.abs();
            let is_flat =
                across.cmpgt(DVec3::splat(0.999 * normal.length()));
            let at = ((a + b + c) / 3. - low) / (high - low);
            let near = [
                at.cmplt(DVec3::splat(0.02)),
                at.cmpgt(DVec3::splat(0.98)),
            ];
            for (end, near) in ends.iter_mut().zip(near) {
                *end += DVec3::select(is_flat & near, across, DVec3::ZERO);
            }
        }
        let (size, main) = (high - low, net.max_position());
        let beside = (0..3).filter(|&k| k != main);
        let is_walled = beside.clone().all(|k| {
            let end = size.element_product() / size[k];
            ends.iter().all(|covered| covered[k] > 0.5 * end)
        });
        let is_plain = net[main] > 0.05 * area
            && beside.clone().all(|k| net[k].abs() < 0.15 * net[main]);
        (is_plain && !is_walled).then(|| DVec3::AXES[main])
    }
}
