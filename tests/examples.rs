// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The examples of the library that a new user reads first.

use crate::prelude::*;

#[allow(dead_code)]
#[path = "../examples/mesh.rs"]
mod mesh;

#[allow(dead_code)]
#[path = "../examples/picture.rs"]
mod picture;

#[allow(dead_code)]
#[path = "../examples/places.rs"]
mod places;

const ROOM: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/doc/examples/room.obj");

#[test]
fn three_points_are_known_to_one_per_cent() {
    let values = places::irradiances(ROOM).unwrap();
    assert!(values.iter().all(|[value, error]| *error <= 0.01 * value));
    // It is darker, the farther a point is from the window.
    assert!(values.is_sorted_by(|a, b| a[0] > 2. * b[0]), "{values:?}");
    let fault = places::irradiances("none.obj").unwrap_err().to_string();
    assert!(fault.starts_with("none.obj: cannot read: "), "{fault}");
}

#[test]
fn a_roof_of_a_mesh_in_memory_shades_the_floor() {
    let values = mesh::irradiances().unwrap();
    // Nothing is above the roof, and it covers more of the second triangle.
    assert_eq!(values[2..], [[1., 0.]; 2]);
    let [[open, a], [shaded, b]] = [values[0], values[1]];
    assert!(open - shaded > 2. * a.hypot(b) && open < 1., "{values:?}");
}

#[test]
fn a_picture_has_the_error_of_each_pixel() {
    let image = picture::picture(ROOM).unwrap();
    assert_eq!((image.width, image.height), (320, 240));
    let errors = image.errors.unwrap();
    let is_known = |i: usize| image.means[i] >= 0. && errors[i] >= 0.;
    assert!((0..320 * 240).all(is_known));
    assert!(image.samples.unwrap().iter().all(|&n| n > 0.));
}

#[test]
fn what_cannot_be_rendered_is_refused_and_does_not_panic() {
    let mesh = || Mesh {
        vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    let refuse = |plan: &Plan, mesh: Mesh, expected: &str| {
        let world = World::new(plan, mesh.into(), Host::default());
        let fault = world.err().map(|fault| fault.to_string());
        assert_eq!(fault.as_deref(), Some(expected));
    };
    let usual = Plan::default();
    let odd = Mesh { triangles: vec![[0, 1, 3]], ..mesh() };
    refuse(&usual, odd, "a triangle has a vertex that is not there");
    let odd = Mesh { vertices: vec![DVec3::NAN; 3], ..mesh() };
    refuse(&usual, odd, "a vertex is not finite");
    let odd = Mesh { joined: vec![0], ..mesh() };
    let fault = "joined triangles are not there, or not in order";
    refuse(&usual, odd, fault);
    let odd = Plan { budget: Budget::samples(0), ..Plan::default() };
    refuse(&odd, mesh(), "samples 0: expected at least 1");
    let mut odd = Plan::default();
    odd.surfaces.albedo = f64::NAN;
    refuse(&odd, mesh(), "albedo NaN: expected a number from 0 to 1");
    let camera = CameraPlan { resolution: (0, 9), ..CameraPlan::default() };
    let sensor = SensorPlan::Camera(camera);
    let odd = Plan { sensor, ..Plan::default() };
    refuse(&odd, mesh(), "resolution 0x9: expected sides from 1 to 16384");
}
