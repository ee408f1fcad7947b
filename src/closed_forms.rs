// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Scenes whose radiance is known exactly, to test against.

use std::error::Error;
use std::f64::consts::PI;

use glam::DVec3;

use crate::scene::Mesh;

// Make a plane without an end
/// A horizontal square of two triangles, at height 0.
pub fn plane() -> Mesh {
    let corner = |x, y| DVec3::new(x, y, 0.);
    let (a, b) = (-1000., 1000.);
    Mesh {
        vertices: vec![
            corner(a, a),
            corner(b, a),
            corner(b, b),
            corner(a, b),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

// Make a sphere with an opening
/// The radiance of the wall of a spherical cavity of reflectivity
/// `rho`, open at the top over the fraction `f` of its area.
pub fn cavity_radiance(rho: f64, f: f64) -> f64 {
    rho * f / (1. - rho * (1. - f))
}

/// A sphere of radius 1 around the origin, open at the top over the
/// fraction `f` of its area, made of `rings` rings of quadrilaterals.
pub fn cavity(f: f64, rings: u32) -> Mesh {
    let meridians = 2 * rings;
    let rim = libm::acos(1. - 2. * f);
    let vertex = |ring: u32, meridian: u32| {
        let polar = rim + (PI - rim) * f64::from(ring) / f64::from(rings);
        let turn = f64::from(meridian) / f64::from(meridians);
        let (x, y) = circle(turn);
        let radius = libm::sin(polar);
        DVec3::new(radius * x, radius * y, libm::cos(polar))
    };
    let grid =
        |n| (0..n).flat_map(move |i| (0..meridians).map(move |j| (i, j)));
    let vertices = grid(rings + 1).map(|(i, j)| vertex(i, j)).collect();
    let number = |i, j| i * meridians + j % meridians;
    let triangles = grid(rings).flat_map(|(i, j)| {
        // Cut one quadrilateral in two
        let (a, b) = (number(i, j), number(i, j + 1));
        let (c, d) = (number(i + 1, j), number(i + 1, j + 1));
        [[a, b, c], [b, d, c]]
    });
    Mesh { vertices, triangles: triangles.collect() }
}

use crate::numerics::circle;

// Render one pixel of a scene
/// A scene with a camera in it, ready to be rendered.
pub struct Setting {
    scene: Scene,
    kernel: Hierarchy,
    camera: Camera,
    estimator: Reference,
}

impl Setting {
    /// A mesh of reflectivity `rho` under the sky of `up`, seen by a
    /// camera whose image has this `aspect`.
    pub fn new(
        mesh: &Mesh,
        (rho, up): (f64, DVec3),
        view: &View,
        aspect: f64,
    ) -> Result<Self, Box<dyn Error>> {
        let camera = Camera::new(view, aspect)?;
        let scene = Scene::new(mesh);
        let kernel = Hierarchy::new(&scene)?;
        let sky = Sky::new(up);
        let estimator = Reference { reflectivity: rho, sky };
        Ok(Self { scene, kernel, camera, estimator })
    }

    /// The job that renders it.
    pub fn job(&self, seed: u64) -> Job<'_, Hierarchy, Reference> {
        let Self { scene, kernel, camera, estimator } = self;
        Job { scene, kernel, camera, estimator, seed }
    }
}

/// The pixel that a camera at `from`, looking at `to`, sees of a mesh
/// under the sky of +z, after `n` realisations.
pub fn pixel(
    mesh: &Mesh,
    rho: f64,
    (from, to): (DVec3, DVec3),
    n: u64,
) -> Result<Accumulator, Box<dyn Error>> {
    let view = View { position: from, target: to, up: DVec3::Y, fov: 20. };
    let setting = Setting::new(mesh, (rho, DVec3::Z), &view, 1.)?;
    let mut image = Image::new(1, 1);
    setting.job(2026).pass(&mut image, 0..n, &|_| ());
    Ok(*image.pixel(0, 0))
}

use crate::camera::{Camera, View};
use crate::estimator::Reference;
use crate::hierarchy::Hierarchy;
use crate::image::Image;
use crate::render::Job;
use crate::scene::Scene;
use crate::sky::Sky;
use crate::statistics::Accumulator;
