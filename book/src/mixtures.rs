// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Scenes in which a small object stands in large surroundings.
//!
//! z points up, lengths are in metres. Only arithmetic, square roots and
//! libm are used, so that a scene is the same on every machine.

use glam::DVec3;
use litpt::camera::View;
use litpt::scene::Mesh;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::solids::{add, cube, icosphere};

/// A scene, seen from near its small object.
pub struct Mixture {
    /// The object and its surroundings.
    pub mesh: Mesh,
    /// A view of the object.
    pub view: View,
}

impl Mixture {
    /// The mixture of a name. The number says how large it is:
    ///
    /// * `ball`: half the side of a square on which a ball of radius 1 lies,
    ///   `aside`: not in the middle but three quarters of the way to a side,
    ///   `rim`: two metres from the side; `sunk`: half of the ball is below
    ///   the square, `cube`: it has 12 triangles, `split`: the square has two
    ///   million;
    /// * `hair`: how often the width of a hair goes into that of a room;
    /// * `grass`: half the side of hilly ground with grass around the camera;
    /// * `utm`: the northing, to which easting and height are in proportion;
    /// * `two`: the distance of two balls, of which the camera is near the
    ///   first, `other`: near the second; `one`: there is only one.
    ///
    /// None if there is no such mixture.
    pub fn named(name: &str, number: f64) -> Option<Self> {
        let x = number * DVec3::X;
        Some(match name {
            "ball" => on_square(&ball(), number, 1, DVec3::ZERO),
            "aside" => on_square(&ball(), number, 1, 0.75 * x),
            "rim" => on_square(&ball(), number, 1, x - 2. * DVec3::X),
            "sunk" => on_square(&ball(), number, 1, -DVec3::Z),
            "cube" => on_square(&block(), number, 1, DVec3::ZERO),
            "split" => on_square(&ball(), number, 1000, DVec3::ZERO),
            "hair" => hair(number),
            "grass" => grass(number),
            "utm" => utm(number),
            "one" => balls(&[DVec3::ZERO], DVec3::ZERO),
            "two" => balls(&[DVec3::ZERO, x], DVec3::ZERO),
            "other" => balls(&[DVec3::ZERO, x], x),
            _ => return None,
        })
    }

    /// The options of `pt` for the view.
    pub fn options(&self) -> String {
        options(&self.view)
    }
}

/// The options of `pt` for a view.
pub fn options(view: &View) -> String {
    let View { position, target, up, fov } = view;
    let [p, t, u] =
        [position, target, up].map(|v| format!("{},{},{}", v.x, v.y, v.z));
    format!("-p {p} -t {t} -u {u} -F {fov}")
}

// ---- parts

/// The view from one point to another one, 40 degrees high.
fn look(position: DVec3, target: DVec3) -> View {
    View { position, target, up: DVec3::Z, fov: 40. }
}

/// The view of a ball that lies at a place.
fn beside(at: DVec3) -> View {
    look(at + DVec3::new(0., -5., 2.), at + DVec3::new(0., 0., 0.8))
}

/// A horizontal square from -`reach` to `reach`, cut into `n` by `n` squares
/// of two triangles each.
fn square(reach: f64, n: u32) -> Mesh {
    let at = |i| reach * (f64::from(2 * i) / f64::from(n) - 1.);
    let row = |i| (0..=n).map(move |j| DVec3::new(at(j), at(i), 0.));
    let cell = |k| {
        let a = k / n * (n + 1) + k % n;
        let [b, c, d] = [a + 1, a + n + 2, a + n + 1];
        [[a, b, c], [a, c, d]]
    };
    let vertices = (0..=n).flat_map(row).collect();
    let triangles = (0..n * n).flat_map(cell).collect();
    Mesh { vertices, triangles, ..Mesh::default() }
}

/// A ball of radius 1 and 20480 triangles that touches height 0.
fn ball() -> Mesh {
    let mut mesh = icosphere(5);
    mesh.vertices.iter_mut().for_each(|v| v.z += 1.);
    mesh
}

/// A cube that stands on height 0 in the place of the ball.
fn block() -> Mesh {
    let mut mesh = cube(1);
    mesh.vertices.iter_mut().for_each(|v| *v = 0.75 * (*v + DVec3::Z));
    mesh
}

// ---- scenes

/// An object at a place on a square.
fn on_square(object: &Mesh, reach: f64, n: u32, at: DVec3) -> Mixture {
    let mut mesh = square(reach, n);
    add(&mut mesh, object, |v| at + v);
    Mixture { mesh, view: beside(DVec3::new(at.x, at.y, 0.)) }
}

/// Balls at some places, seen from near one of them.
fn balls(places: &[DVec3], near: DVec3) -> Mixture {
    let mut mesh = Mesh::default();
    for &place in places {
        add(&mut mesh, &ball(), |v| place + v);
    }
    Mixture { mesh, view: beside(near) }
}

/// A hair of length 1 in a room ten metres wide without a ceiling, from four
/// times its width away.
fn hair(ratio: f64) -> Mixture {
    let mut mesh = Mesh::default();
    let mut room = cube(1);
    let ceiling =
        |t: &[u32; 3]| t.iter().all(|&i| room.vertices[i as usize].z > 0.);
    room.triangles.retain(|t| !ceiling(t));
    add(&mut mesh, &room, |v| 5. * v);
    let width = 10. / ratio;
    let middle = DVec3::new(1.3, -0.7, -0.4);
    let size = DVec3::new(width, width, 1.);
    add(&mut mesh, &cube(1), |v| middle + 0.5 * size * v);
    Mixture { mesh, view: look(middle - 4. * width * DVec3::Y, middle) }
}

/// Ground with hills in the distance, flat where 10000 blades of grass stand
/// less than a metre from the camera.
fn grass(reach: f64) -> Mixture {
    let mut mesh = square(reach, 200);
    for v in &mut mesh.vertices {
        let [x, y] = [v.x / reach, v.y / reach];
        let far = (((x * x + y * y).sqrt() - 0.3) / 0.7).max(0.);
        let waves = libm::sin(9. * x + 2. * y) * libm::sin(7. * y - 3. * x);
        v.z = 0.03 * reach * far * far * (1. + 0.5 * waves);
    }
    let mut random = Pcg64::seed_from_u64(1);
    for _ in 0..10_000 {
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(blade(&mut random));
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    let eye = DVec3::new(0., 0., 0.3);
    Mixture { mesh, view: look(eye, DVec3::new(0., 0.5, 0.)) }
}

/// A blade of grass, a millimetre wide and five centimetres high.
fn blade(random: &mut Pcg64) -> [DVec3; 3] {
    let foot = within_circle(random);
    let across = 5e-4 * within_circle(random).normalize();
    let tip = 0.02 * within_circle(random) + 0.05 * DVec3::Z;
    [foot - across, foot + across, foot + tip]
}

/// A point of the horizontal unit circle.
fn within_circle(random: &mut Pcg64) -> DVec3 {
    loop {
        let mut one = || 2. * random.random::<f64>() - 1.;
        let p = DVec3::new(one(), one(), 0.);
        if p.length_squared() < 1. {
            return p;
        }
    }
}

/// A ball of radius 0.05 with edges of one to two millimetres on a square
/// of ten metres. At the northing 5.6e6 its easting is 4e5 and its height
/// 100. All coordinates are multiples of 2^-20 and less than 2^23, so that
/// doubles hold them wherever the northing is a multiple of 56000.
fn utm(northing: f64) -> Mixture {
    let place = |v: DVec3| {
        let exact = (v * 1048576.).round() / 1048576.;
        let [easting, height] = [northing / 14., northing / 56000.];
        DVec3::new(easting, northing, height) + exact
    };
    let mut mesh = Mesh::default();
    add(&mut mesh, &square(5., 1), place);
    add(&mut mesh, &ball(), |v| place(0.05 * v));
    let eye = place(DVec3::new(0., -0.25, 0.1));
    Mixture { mesh, view: look(eye, place(0.04 * DVec3::Z)) }
}
