// Tangled from chapters/scene.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Triangles near the origin.
//!
//! A `Mesh` has the coordinates of its file, in double precision.
//! A `Scene` has the same triangles after its `Frame` has brought them near
//! the origin, without rounding.
//!
//! ```
//! use glam::DVec3;
//! use litpt::scene::{Mesh, Scene};
//!
//! let vertices = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
//! let triangles = vec![[0, 1, 2], [1, 2, 0], [0, 0, 1]];
//! let mesh = Mesh { vertices, triangles, ..Mesh::default() };
//! let scene = Scene::new(&mesh);
//! assert_eq!(scene.triangles.corners.len(), 1);
//! assert_eq!(scene.left_out, [vec![2], vec![1]]);
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

pub mod encoding;
pub mod mesh;
pub mod mtl;
pub mod obj;
pub mod place;
pub mod polygons;
pub mod text;

use std::hash::{DefaultHasher, Hash, Hasher};

use glam::{BVec3, DVec3};
use rayon::prelude::*;

pub use self::mesh::{Mark, MarkKind, Mesh};
pub(crate) use self::obj::begins_obj;
pub use self::obj::{read_file, read_obj, read_pieces};
pub use self::place::{EXTENT, Entrance, Frame, Ray};
use crate::numerics::cross;

/// The corners of a triangle, in the coordinates of the scene.
pub type Triangle = [DVec3; 3];

/// Triangles that share their corners, in the coordinates of the scene.
#[derive(Clone, Debug, Default)]
pub struct Triangles {
    /// The corners.
    pub vertices: Vec<DVec3>,
    /// Three indices into `vertices` for each triangle.
    pub corners: Vec<[u32; 3]>,
    /// The face of each triangle in the mesh.
    pub faces: Vec<u32>,
}

impl Triangles {
    /// The corners of a triangle.
    #[inline(always)]
    pub fn get(&self, i: usize) -> Triangle {
        self.corners[i].map(|corner| self.vertices[corner as usize])
    }

    /// The corners of each triangle.
    pub fn to_vec(&self) -> Vec<Triangle> {
        (0..self.corners.len()).map(|i| self.get(i)).collect()
    }

    /// Removes triangles; returns their faces.
    fn leave_out(&mut self, out: &[bool]) -> Vec<u32> {
        let (mut first, mut second) = (out.iter(), out.iter());
        self.corners.retain(|_| first.next() == Some(&false));
        let gone = |_: &mut u32| second.next() == Some(&true);
        self.faces.extract_if(.., gone).collect()
    }
}

fn has_area([a, b, c]: Triangle) -> bool {
    let (u, v) = (b - a, c - a);
    u.cross(v) != DVec3::ZERO || cross(u, v) != DVec3::ZERO
}

/// Triangles near the origin, with the map that brought them there.
pub struct Scene {
    /// The map.
    pub frame: Frame,
    /// The triangles that have an area, in the order of the mesh, without
    /// copies.
    pub triangles: Triangles,
    /// The faces, from 0, of triangles without an area, and of triangles
    /// that have the same corners as another one.
    pub left_out: [Vec<u32>; 2],
}

impl Scene {
    /// The scene of a mesh; a mesh without triangles is an empty scene.
    pub fn new(mesh: &Mesh) -> Self {
        Self::of(mesh.clone())
    }

    /// A scene without triangles in a frame.
    pub fn empty(frame: Frame) -> Self {
        let (triangles, left_out) = Default::default();
        Self { frame, triangles, left_out }
    }

    /// Like `new`, but takes the mesh over.
    pub fn of(mesh: Mesh) -> Self {
        Self::keeping(mesh, |_| 0.)
    }

    /// Like `of`, where faces let these parts of the light through; of
    /// triangles with the same corners, the first of the least part is kept.
    pub fn keeping(mesh: Mesh, through: impl Fn(u32) -> f64) -> Self {
        let (extremes, faces) = (mesh.corners(), mesh.faces());
        let Mesh { vertices, triangles: corners, .. } = mesh;
        let mut triangles = Triangles { vertices, corners, faces };
        // Choose the frame that rounds no corner
        let moved = Frame::new(extremes, BVec3::TRUE);
        let corners = triangles.corners.par_iter().flatten_iter();
        let corners = corners.map(|&i| triangles.vertices[i as usize]);
        let rounds = corners.map(|corner| moved.rounds(corner));
        let either =
            |a: BVec3, b: BVec3| Some(a | b).filter(|both| !both.all());
        let rounds = rounds
            .try_fold(|| BVec3::FALSE, either)
            .try_reduce(|| BVec3::FALSE, either)
            .unwrap_or(BVec3::TRUE);
        let frame = Frame::new(extremes, !rounds);
        // Place the vertices
        let place = |p: &mut DVec3| {
            let placed = frame.apply(*p, 0) + DVec3::ZERO;
            let tiny = placed.abs().cmplt(DVec3::splat(TINY));
            *p = DVec3::select(tiny, DVec3::ZERO, placed);
        };
        triangles.vertices.par_iter_mut().for_each(place);
        let indices = (0..triangles.corners.len()).into_par_iter();
        let flat = indices.map(|i| !has_area(triangles.get(i)));
        let flat: Vec<bool> = flat.collect();
        let flat = triangles.leave_out(&flat);
        // Turn the fans of panes and sheets
        let mut rest = &mut triangles.corners[..];
        for faces in triangles.faces.chunk_by(|a, b| a == b) {
            let fan = rest.split_off_mut(..faces.len()).unwrap_or_default();
            if through(faces[0]) > 0.
                && let Some(turned) = turned(fan, &triangles.vertices)
            {
                fan.copy_from_slice(&turned);
            }
        }
        let copies = copies(&triangles, through);
        let left_out = [flat, triangles.leave_out(&copies)];
        Self { frame, triangles, left_out }
    }
}

/// Coordinates that are smaller count as zero: 2^-100.
const TINY: f64 = f64::from_bits((1023 - 100) << 52);

/// The fan of a polygon around its least corner, if that fills it.
fn turned(fan: &[[u32; 3]], vertices: &[DVec3]) -> Option<Vec<[u32; 3]>> {
    let place = |i: u32| vertices[i as usize];
    let goes_on = |a: &[u32; 3], b: &[u32; 3]| a[0] == b[0] && a[2] == b[1];
    if !fan.is_sorted_by(goes_on) {
        return None;
    }
    let mut corners = vec![fan[0][0], fan[0][1]];
    corners.extend(fan.iter().map(|triangle| triangle[2]));
    let at = |i: usize| place(corners[i]).to_array();
    let order = |a: &usize, b: &usize| at(*a).partial_cmp(&at(*b)).unwrap();
    let least = (0..corners.len()).min_by(order)?;
    corners.rotate_left(least);
    // Make the fan around the first corner
    let sides = corners[1..].windows(2);
    let turned = sides.map(|side| [corners[0], side[0], side[1]]);
    let turned: Vec<_> = turned.collect();
    let normal = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(place);
        (b - a).cross(c - a)
    };
    let up = normal(&fan[0]);
    let fills = turned.iter().all(|it| normal(it).dot(up) > 0.);
    fills.then_some(turned)
}

/// Which triangles have the same corners as another one that is kept: the
/// first of those that let the least light through.
fn copies(
    triangles: &Triangles,
    through: impl Fn(u32) -> f64,
) -> Vec<bool> {
    let bits = |p: DVec3| p.to_array().map(f64::to_bits);
    let hashes = triangles.vertices.par_iter().map(|&p| scattered(bits(p)));
    let hashes: Vec<u64> = hashes.collect();
    let key = |three: &[u32; 3]| {
        let [a, b, c] = three.map(|i| hashes[i as usize]);
        a.wrapping_add(b).wrapping_add(c)
    };
    let keys: Vec<u64> = triangles.corners.par_iter().map(key).collect();
    // Sort the keys that may occur twice
    let words = keys.len().div_ceil(8).next_power_of_two();
    let place =
        |key: u64| ((key as usize / 64) & (words - 1), 1u64 << (key % 64));
    let [mut once, mut twice] = [(); 2].map(|()| vec![0; words]);
    for &key in &keys {
        let (word, bit) = place(key);
        twice[word] |= once[word] & bit;
        once[word] |= bit;
    }
    let is_shared = |&(key, _): &(u64, u32)| {
        let (word, bit) = place(key);
        twice[word] & bit != 0
    };
    let kept = keys.iter().copied().zip(0..).filter(is_shared);
    let mut kept: Vec<(u64, u32)> = kept.collect();
    kept.par_sort_unstable();
    let corners = |i: u32| {
        let mut corners = triangles.get(i as usize).map(bits);
        corners.sort_unstable();
        corners
    };
    let is_equal = |a: &(u64, u32), b: &(u64, u32)| {
        a.0 == b.0 && corners(a.1) == corners(b.1)
    };
    let mut is_copy = vec![false; triangles.corners.len()];
    // Mark all copies but one
    let through = |i: u32| through(triangles.faces[i as usize]);
    for equal in kept.chunk_by(is_equal).filter(|equal| equal.len() > 1) {
        let numbers = equal.iter().map(|&(_, i)| i);
        let least = |&i: &u32, &j: &u32| through(i).total_cmp(&through(j));
        let kept = numbers.clone().min_by(least);
        let others = numbers.filter(|&i| Some(i) != kept);
        others.for_each(|i| is_copy[i as usize] = true);
    }
    is_copy
}

/// A hash, which depends on the value only.
pub fn scattered(value: impl Hash) -> u64 {
    let mut hasher = DefaultHasher::new();
    value.hash(&mut hasher);
    hasher.finish()
}
