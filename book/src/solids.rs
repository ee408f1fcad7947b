// Closed surfaces, with cameras inside them.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::HashMap;

use crate::courtyard::solids;
use glam::{DMat3, DVec3, EulerRot};
use litpt::numerics::cross;
use litpt::scene::{Mesh, Scene, Triangle, Triangles};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A closed surface, rounded as scenes are, with points inside, all in the
/// coordinates of the scene.
pub struct Solid {
    pub name: String,
    pub scene: Scene,
    /// The faces from 0 on that are its own.
    pub faces: u32,
    /// Where a path may begin.
    pub cameras: Vec<DVec3>,
}

impl Solid {
    /// Whether its triangles do not share all corners on their edges. A ray
    /// that is aimed at such a seam may find a crack (section "Meshes that
    /// are not closed").
    pub fn has_cracks(&self) -> bool {
        self.name.contains("seams")
    }

    /// Its own triangles.
    pub fn own(&self) -> Vec<Triangle> {
        let all = &self.scene.triangles;
        let faces = all.faces.iter();
        let all = faces.zip(all.to_vec());
        all.filter(|(face, _)| **face < self.faces).map(|t| t.1).collect()
    }

    /// It, so far above a horizontal square whose half sides are 4096 times
    /// `ratio`, which is about as many times its own size.
    pub fn over(&self, ratio: f64, gap: f64) -> Self {
        let own = &self.scene.triangles;
        let lowest = own.vertices.iter().map(|p| p.z).fold(0., f64::min);
        let corner = |x: f64, y: f64| {
            let [x, y] = [x, y].map(|x| 4096. * ratio * x);
            DVec3::new(x, y, lowest - gap)
        };
        let first = own.vertices.len() as u32;
        let [a, b] = [corner(-1., -1.), corner(1., -1.)];
        let [c, d] = [corner(1., 1.), corner(-1., 1.)];
        let mut vertices = own.vertices.clone();
        vertices.extend([a, b, c, d]);
        let mut triangles = own.corners.clone();
        let plane = [[0, 1, 2], [0, 2, 3]];
        triangles.extend(plane.map(|t| t.map(|i| first + i)));
        let faces = own.corners.len() as u32;
        let scene =
            Scene::new(&Mesh { vertices, triangles, ..Mesh::default() });
        let place = |&p: &DVec3| {
            scene.frame.entrance(p).place().expect("a point inside")
        };
        let cameras = self.cameras.iter().map(place).collect();
        let name = format!("{} over {ratio:e}", self.name);
        Self { name, scene, faces, cameras }
    }
}

/// All of them.
pub fn all() -> Vec<Solid> {
    let o = DVec3::ZERO;
    let mut all = vec![
        solid("cube", cube(1), &[o]),
        solid("gridded cube", cube(20), &[o]),
    ];
    for level in 0..=6 {
        all.push(solid(
            &format!("icosphere {level}"),
            icosphere(level),
            &[o],
        ));
    }
    all.push(solid("torus", torus(64, 24), &[DVec3::X]));
    all.push(solid("spiky star", star(3, 1), &[o]));
    all.push(solid("slab 2 x 2e-6 x 2", slab(), &[o]));
    let [plate, fin] = [DVec3::new(0.5, -0.5, 0.5), DVec3::splat(0.5)];
    all.push(solid("thin fins", fins(), &[plate, fin + DVec3::X * 5e-6]));
    all.push(solid("needles", needles(), &[o]));
    all.push(solid("splinters", splinters(), &[o]));
    all.push(solid("seams without vertices", junctions(), &[o]));
    all.push(solid("walls given thrice", repeated(), &[o]));
    all.push(courtyard());
    all
}

/// The cameras are the points `inside`, points near them in general position
/// and on an axis, and points next to a vertex and an edge.
fn solid(name: &str, mesh: Mesh, inside: &[DVec3]) -> Solid {
    let scene = Scene::new(&mesh);
    let faces = mesh.triangles.len() as u32;
    let triangles: Vec<_> = rounded(&scene);
    let mut cameras = vec![];
    for &o in inside {
        let o = scene
            .frame
            .entrance(o)
            .enter(DVec3::X)
            .expect("a point inside")
            .origin;
        let near = |t: &&[DVec3; 3]| {
            t.iter().map(|p| (p - o).length()).fold(0., f64::max)
        };
        let closest =
            triangles.iter().min_by(|s, t| near(s).total_cmp(&near(t)));
        let [a, b, _] = *closest.expect("a solid has triangles");
        let next_to = |p: DVec3| p + (o - p) * 1e-9;
        let off = DVec3::new(0.137, 0.0719e-6, 0.0371);
        let edge = next_to(0.3 * a + 0.7 * b);
        cameras.extend([o, o + off, o + DVec3::Z, next_to(a), edge]);
    }
    cameras.retain(|&p| winding(&triangles, p).abs() > 0.9);
    assert!(cameras.len() >= 4, "{name}: too few points are inside");
    Solid { name: name.to_owned(), scene, faces, cameras }
}

pub fn rounded(scene: &Scene) -> Vec<[DVec3; 3]> {
    scene.triangles.to_vec()
}

/// How many times the surface goes around a point: the sum of the solid
/// angles of its triangles (Van Oosterom and Strackee 1983), over 4 pi.
pub fn winding(triangles: &[[DVec3; 3]], p: DVec3) -> f64 {
    let angle = |t: &[DVec3; 3]| {
        let [a, b, c] = t.map(|corner| corner - p);
        let [x, y, z] = [a.length(), b.length(), c.length()];
        let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
        // The volume, from differences that are exact.
        let volume = a.dot(cross(t[1] - t[0], t[2] - t[0]));
        2. * volume.atan2(below)
    };
    triangles.iter().map(angle).sum::<f64>() / (4. * std::f64::consts::PI)
}

/// Adds a mesh whose vertices are moved.
pub fn add(mesh: &mut Mesh, part: &Mesh, place: impl Fn(DVec3) -> DVec3) {
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend(part.vertices.iter().map(|&v| place(v)));
    let moved = part.triangles.iter().map(|t| t.map(|i| first + i));
    mesh.triangles.extend(moved);
}

/// A cube with `n` by `n` squares on each face, each cut in two.
pub fn cube(n: u32) -> Mesh {
    let at: Vec<f64> =
        (0..=n).map(|i| 2. * f64::from(i) / f64::from(n) - 1.).collect();
    grid([&at, &at, &at], |_| true)
}

/// The boundary of those cells of a grid for which `filled` holds. Each
/// square of the grid that is on the boundary is cut in two.
fn grid(at: [&[f64]; 3], filled: impl Fn([usize; 3]) -> bool) -> Mesh {
    let mut mesh = Mesh::default();
    let mut numbers = HashMap::new();
    let mut vertex = |p: [usize; 3]| {
        *numbers.entry(p).or_insert_with(|| {
            let [x, y, z] = p;
            mesh.vertices.push(DVec3::new(at[0][x], at[1][y], at[2][z]));
            mesh.vertices.len() as u32 - 1
        })
    };
    let cells = at.map(|at| at.len() - 1);
    let mut triangles = vec![];
    for x in 0..cells[0] {
        for y in 0..cells[1] {
            for z in (0..cells[2]).filter(|&z| filled([x, y, z])) {
                for (axis, up) in
                    (0..3).flat_map(|axis| [(axis, false), (axis, true)])
                {
                    let cell = [x, y, z];
                    let mut next = cell;
                    next[axis] = match up {
                        true => cell[axis] + 1,
                        false => cell[axis].wrapping_sub(1),
                    };
                    if next[axis] < cells[axis] && filled(next) {
                        continue;
                    }
                    let mut corner = |i: usize, j: usize| {
                        let mut p = cell;
                        p[axis] += usize::from(up);
                        p[(axis + 1) % 3] += i;
                        p[(axis + 2) % 3] += j;
                        vertex(p)
                    };
                    let [a, b] = [corner(0, 0), corner(1, 0)];
                    let [c, d] = [corner(0, 1), corner(1, 1)];
                    triangles.extend(match up {
                        true => [[a, b, d], [a, d, c]],
                        false => [[d, b, a], [c, d, a]],
                    });
                }
            }
        }
    }
    mesh.triangles = triangles;
    mesh
}

/// An icosahedron whose triangles are cut in four `level` times.
pub fn icosphere(level: u32) -> Mesh {
    let g = (1. + 5f64.sqrt()) / 2.;
    let signs = [(-1., -1.), (-1., 1.), (1., -1.), (1., 1.)];
    let rectangle = |axis: usize| {
        signs.map(|(s, t)| {
            let mut p = [0.; 3];
            (p[axis], p[(axis + 1) % 3]) = (s, t * g);
            DVec3::from(p).normalize()
        })
    };
    let mut vertices: Vec<DVec3> = (0..3).flat_map(rectangle).collect();
    let close = |a: usize, b: usize, v: &[DVec3]| v[a].dot(v[b]) > 0.4;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let v = &vertices;
                if close(a, b, v) && close(b, c, v) && close(a, c, v) {
                    let outwards = v[a].cross(v[b]).dot(v[c]) > 0.;
                    let [p, q] = if outwards { [b, c] } else { [c, b] };
                    triangles.push([a as u32, p as u32, q as u32]);
                }
            }
        }
    }
    for _ in 0..level {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let sum = vertices[a as usize] + vertices[b as usize];
                vertices.push(sum.normalize());
                vertices.len() as u32 - 1
            })
        };
        let cut = |&[a, b, c]: &[u32; 3]| {
            let [p, q, r] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, p, r], [p, b, q], [r, q, c], [p, q, r]]
        };
        triangles = triangles.iter().flat_map(cut).collect();
    }
    Mesh { vertices, triangles, ..Mesh::default() }
}

/// A torus around the z axis, with radii 1 and 0.3.
fn torus(around: u32, across: u32) -> Mesh {
    let turn = |i: u32, n: u32| {
        (f64::from(i) / f64::from(n) * std::f64::consts::TAU).sin_cos()
    };
    let vertices = (0..around * across).map(|k| {
        let ((s, c), (y, x)) =
            (turn(k / across, around), turn(k % across, across));
        let r = 1. + 0.3 * x;
        DVec3::new(r * c, r * s, 0.3 * y)
    });
    let number = |i, j| i % around * across + j % across;
    let triangles = (0..around * across).flat_map(|k| {
        let (i, j) = (k / across, k % across);
        let [a, b] = [number(i, j), number(i + 1, j)];
        let [c, d] = [number(i, j + 1), number(i + 1, j + 1)];
        [[a, b, d], [a, d, c]]
    });
    Mesh {
        vertices: vertices.collect(),
        triangles: triangles.collect(),
        ..Mesh::default()
    }
}

/// An icosphere whose vertices are moved to random radii in [0.1, 1].
pub fn star(level: u32, seed: u64) -> Mesh {
    let mut mesh = icosphere(level);
    let mut random = Pcg64::seed_from_u64(seed);
    for vertex in &mut mesh.vertices {
        *vertex *= random.random_range(0.1..=1.);
    }
    mesh
}

fn slab() -> Mesh {
    let mut mesh = cube(4);
    for vertex in &mut mesh.vertices {
        vertex.y *= 1e-6;
    }
    mesh
}

/// A plate with 33 fins, each 100 000 times as high as thick.
fn fins() -> Mesh {
    let x: Vec<f64> = (0..=32)
        .flat_map(|i| {
            let x = f64::from(i) / 16. - 1.;
            [x, x + 1e-5]
        })
        .collect();
    let (y, z) = ([-1., 0., 1.], [0., 0.9, 1.]);
    grid([&x, &y, &z], |[i, j, _]| j == 0 || i % 2 == 0)
}

/// A cube with strips a million times as long as wide, turned so that
/// they are along no axis.
fn needles() -> Mesh {
    let strips = (0..=16).map(|i| f64::from(i) * 2e-6);
    let mut at: Vec<f64> =
        strips.clone().map(|x| x - 1.).chain(strips).collect();
    at.push(1.);
    let ends = [-1., 1.];
    let mesh = grid([&at, &ends, &ends], |_| true);
    turned(mesh, DVec3::new(0.3, 0.5, 0.7))
}

/// A cube with strips 300 to 5000 times as long as wide, turned likewise.
fn splinters() -> Mesh {
    let mut at = vec![-1.];
    for aspect in [300., 1000., 5000., 1000., 300.] {
        at.push(at[at.len() - 1] + 2. / aspect);
    }
    at.extend([0.9, 0.999, 1.]);
    let mesh = grid([&at, &[-1., -0.9, 1.], &[-1., 1.]], |_| true);
    turned(mesh, DVec3::new(0.4, -0.3, 0.9))
}

fn turned(mut mesh: Mesh, by: DVec3) -> Mesh {
    let turn = DMat3::from_euler(EulerRot::XYZ, by.x, by.y, by.z);
    for vertex in &mut mesh.vertices {
        *vertex = turn * *vertex;
    }
    mesh
}

/// A cube whose opposite faces are cut into different numbers of squares,
/// so that at edges vertices of one face lie on edges of another.
fn junctions() -> Mesh {
    let mut mesh = Mesh::default();
    for (axis, n) in [(0, 1), (1, 2), (2, 8)] {
        let mut part = cube(n);
        let corner = |i: u32| part.vertices[i as usize][axis];
        part.triangles.retain(|t| {
            let [a, b, c] = t.map(corner);
            a == b && b == c
        });
        add(&mut mesh, &part, |p| p);
    }
    mesh
}

/// A cube with each wall three times: alike, turned over, and cut along
/// the other diagonals.
fn repeated() -> Mesh {
    let mut mesh = cube(2);
    let once = mesh.triangles.clone();
    mesh.triangles.extend(once.iter().map(|&[a, b, c]| [c, b, a]));
    for pair in once.chunks(2) {
        let [p, q, r] = pair[0];
        let fourth = pair[1].iter().find(|i| !pair[0].contains(i));
        let s = *fourth.expect("two triangles of a square");
        mesh.triangles.extend([[p, q, s], [q, r, s]]);
    }
    mesh
}

/// All solids of the courtyard, with a camera inside each that is not
/// hollow in the middle.
fn courtyard() -> Solid {
    let (mut mesh, mut middles) = (Mesh::default(), vec![]);
    for part in solids() {
        let part = part.mesh();
        let corner = |i: u32| part.vertices[i as usize];
        let own: Vec<_> =
            part.triangles.iter().map(|t| t.map(corner)).collect();
        let sum = part.vertices.iter().sum::<DVec3>();
        let middle = sum / part.vertices.len() as f64;
        if winding(&own, middle).abs() > 0.99 {
            middles.push(middle);
        }
        add(&mut mesh, &part, |p| p);
    }
    let scene = Scene::new(&mesh);
    let faces = mesh.triangles.len() as u32;
    let place = |p| {
        scene.frame.entrance(p).enter(DVec3::X).expect("a middle").origin
    };
    let cameras = middles.into_iter().map(place).collect();
    let name = "solids of the courtyard".to_owned();
    Solid { name, scene, faces, cameras }
}

/// Triangles that share no corner, each with its face.
pub fn apart(triangles: &[Triangle], faces: Vec<u32>) -> Triangles {
    let corner = |i: u32| [3 * i, 3 * i + 1, 3 * i + 2];
    let corners = (0..triangles.len() as u32).map(corner).collect();
    let vertices = triangles.as_flattened().to_vec();
    Triangles { vertices, corners, faces }
}
