// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Closed solids made by sweeping a section along a path.
//!
//! Only operations that IEEE 754 rounds correctly are used (+, -, *, / and
//! square root), so that a solid is the same to the last bit everywhere.

use std::io::{self, Write};

use litpt::scene::Mesh;

/// A point or vector: x, y (up), z, in metres.
pub type Point = [f64; 3];

/// A point of a flat drawing: abscissa and height, in metres.
pub type Flat = [f64; 2];

/// A closed, outward-oriented surface of triangles.
#[derive(Default)]
pub struct Solid {
    /// What it is and its number in the scene, as in `column.17`.
    pub name: String,
    /// Vertices, all different.
    pub vertices: Vec<Point>,
    /// Indices into `vertices`, anticlockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Solid {
    fn vertex(&mut self, p: Point) -> u32 {
        let known = self.vertices.iter().position(|&v| v == p);
        known.unwrap_or_else(|| {
            self.vertices.push(p);
            self.vertices.len() - 1
        }) as u32
    }

    /// Adds a convex face, anticlockwise seen from outside.
    pub fn face(&mut self, corners: &[Point]) {
        let found = corners.iter().map(|&p| self.vertex(p));
        let ring: Vec<_> = found.collect();
        for i in 2..ring.len() {
            let [a, b, c] = [ring[0], ring[i - 1], ring[i]];
            if a != b && b != c && c != a {
                self.triangles.push([a, b, c]);
            }
        }
    }

    /// Its triangles.
    pub fn mesh(&self) -> Mesh {
        let vertices = self.vertices.iter().map(|&p| p.into()).collect();
        let triangles = self.triangles.clone();
        Mesh { vertices, triangles, ..Mesh::default() }
    }

    /// The solid after a rotation or translation.
    pub fn moved(mut self, motion: impl Fn(Point) -> Point) -> Self {
        for p in &mut self.vertices {
            *p = motion(*p);
        }
        self
    }
}

/// A point after some quarter turns about the y axis.
pub fn turned([x, y, z]: Point, quarters: usize) -> Point {
    match quarters % 4 {
        0 => [x, y, z],
        1 => [z, y, -x],
        2 => [-x, y, -z],
        _ => [-z, y, x],
    }
}

/// The middle of the arc between two unit vectors.
fn bisect(a: Flat, b: Flat) -> Flat {
    let [x, y] = [a[0] + b[0], a[1] + b[1]];
    let length = (x * x + y * y).sqrt();
    [x / length, y / length]
}

/// Points of the upper unit semicircle, from left to right.
pub fn semicircle(steps: usize) -> Vec<Flat> {
    let mut arc = vec![[-1.0, 0.0], [0.0, 1.0], [1.0, 0.0]];
    while arc.len() <= steps {
        let mut finer = vec![arc[0]];
        for pair in arc.windows(2) {
            finer.extend([bisect(pair[0], pair[1]), pair[1]]);
        }
        arc = finer;
    }
    arc
}

/// Rings of points joined to a tube, with a triangulation of their section
/// on both ends, or none if the path closes.
pub fn sweep(rings: &[Vec<Point>], cap: &[[usize; 3]]) -> Solid {
    let mut solid = Solid::default();
    for pair in rings.windows(2) {
        let (near, far) = (&pair[0], &pair[1]);
        for i in 0..near.len() {
            let j = (i + 1) % near.len();
            solid.face(&[near[i], near[j], far[j], far[i]]);
        }
    }
    let (first, last) = (&rings[0], &rings[rings.len() - 1]);
    for &[a, b, c] in cap {
        solid.face(&[first[c], first[b], first[a]]);
        solid.face(&[last[a], last[b], last[c]]);
    }
    solid
}

/// A convex polygon cut into triangles.
pub fn fan(corners: usize) -> Vec<[usize; 3]> {
    (2..corners).map(|i| [0, i - 1, i]).collect()
}

/// A rectangle between bounds, the smaller of each pair first.
pub fn rectangle(x: [f64; 2], y: [f64; 2]) -> [Flat; 4] {
    [[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]]
}

/// A box between bounds, the smaller of each pair first.
pub fn block(x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> Solid {
    let ring = |z| rectangle(x, y).map(|[x, y]| [x, y, z]).to_vec();
    sweep(&z.map(ring), &fan(4))
}

/// A surface of revolution with pairs of radius and height.
pub fn lathe(profile: &[Flat], sides: usize) -> Solid {
    let half = semicircle(sides / 2);
    let under = half.iter().map(|&[x, y]| [-x, -y]);
    let upper = half.iter().map(|&[x, y]| [x, y]);
    let mut circle: Vec<Flat> = upper.chain(under).collect();
    circle.dedup();
    circle.pop();
    let ring = |&[r, y]: &Flat| {
        circle.iter().map(|&[a, b]| [r * a, y, r * b]).collect()
    };
    let rings: Vec<_> = profile.iter().map(ring).collect();
    sweep(&rings, &fan(circle.len()))
}

/// A moulding around a rectangle with these half sides along x and z; the
/// profile has pairs of distance outwards and height.
pub fn moulding(half: [f64; 2], profile: &[Flat]) -> Solid {
    let corner = |[x, z]: [f64; 2]| -> Vec<Point> {
        let at = |&[o, y]: &Flat| [x * (half[0] + o), y, z * (half[1] + o)];
        profile.iter().map(at).collect()
    };
    let corners = [[1., 1.], [-1., 1.], [-1., -1.], [1., -1.], [1., 1.]];
    sweep(&corners.map(corner), &[])
}

/// Writes solids as a Wavefront OBJ, one object each, five decimals.
///
/// # Errors
/// Those of the writer. Nothing is flushed.
pub fn write_obj(solids: &[Solid], to: &mut impl Write) -> io::Result<()> {
    writeln!(to, "# litpt courtyard: metres, y up")?;
    let mut first = 1;
    for solid in solids {
        writeln!(to, "o {}", solid.name)?;
        for [x, y, z] in &solid.vertices {
            let [x, y, z] = [x + 0.0, y + 0.0, z + 0.0];
            writeln!(to, "v {x:.5} {y:.5} {z:.5}")?;
        }
        for t in &solid.triangles {
            let [a, b, c] = t.map(|i| i + first);
            writeln!(to, "f {a} {b} {c}")?;
        }
        first += solid.vertices.len() as u32;
    }
    Ok(())
}
