// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Answers to the book's exercises on scenes, geometry and sampling, one
//! test for each.

use crate::prelude::*;

use crate::polygons;

use litpt_book::solids::cube;

/// Demands that a mean of `n` samples of this variance is near
/// what is expected.
#[track_caller]
fn near(mean: f64, expected: f64, variance: f64, n: u32) {
    let z = (mean - expected) / (variance / f64::from(n)).sqrt();
    assert!(z.abs() < 5., "{mean}, not {expected}: z = {z}");
}

#[test]
fn nearly_parallel_vectors_have_a_cross_product() {
    let epsilon = power_of_two(-30);
    let u = DVec3::new(1. + epsilon, 1., 0.);
    let v = DVec3::new(1., 1. - epsilon, 0.);
    assert_eq!(u.cross(v).z, 0.);
    assert_eq!(cross(u, v).z, -power_of_two(-60));
    let rounded = DVec3::new(0.1, 0.2, 0.3);
    assert_eq!(cross(rounded, 2. * rounded), DVec3::ZERO);
    let angle = cross(u, v).length() / (u.length() * v.length());
    assert!((angle - 4e-19).abs() < 0.4e-19);
    let view = View { position: DVec3::ZERO, target: u, up: v, fov: 9. };
    assert!(Camera::new(&view, 1.).is_ok());
}

#[test]
fn a_hall_of_300_metres_is_scaled_by_32() {
    let far = DVec3::new(300., 40., 12.);
    let vertices = vec![DVec3::ZERO, far, far * DVec3::X];
    let triangles = vec![[0, 1, 2]];
    let hall = Mesh { vertices, triangles, ..Mesh::default() };
    let corner = Scene::new(&hall).triangles.get(0)[1];
    assert_eq!(corner, DVec3::new(4800., 640., 192.));
    assert_eq!((corner.x.next_up() - corner.x) / 32., power_of_two(-45));
}

/// A face with these corners in a plane, and whether it is odd.
pub fn face(corners: &[[f64; 2]]) -> (Mesh, bool) {
    let text = polygons::face(&polygons::flat(corners));
    let (mesh, warning) = read_file(text.as_bytes()).unwrap();
    (mesh, !warning.is_empty())
}

#[test]
fn eighty_three_of_216_random_fans_are_right() {
    let n = 100_000;
    let mut random = generator(10, 0, 0);
    let (mut kept, mut cut, mut crossed) = (0, 0, 0);
    for _ in 0..n {
        let corners = [0; 4].map(|_| [random.random(), random.random()]);
        let (mesh, is_odd) = face(&corners);
        let is_fan = mesh.triangles == [[0, 1, 2], [0, 2, 3]];
        match (is_odd, is_fan) {
            (true, _) => crossed += 1,
            (_, true) => kept += 1,
            _ => cut += 1,
        }
    }
    for (count, of_216) in [(kept, 83.), (cut, 33.), (crossed, 100.)] {
        let p: f64 = of_216 / 216.;
        near(f64::from(count) / f64::from(n), p, p * (1. - p), n);
    }
}

/// A camera at the origin that looks along y.
fn camera(fov: f64, aspect: f64) -> Camera {
    let (position, target, up) = (DVec3::ZERO, DVec3::Y, DVec3::Z);
    Camera::new(&View { position, target, up, fov }, aspect).unwrap()
}

#[test]
fn the_top_left_corner_is_to_the_left_and_up() {
    let camera = camera(90., 4. / 3.);
    let corner = DVec3::new(-4., 3., 3.) / 34f64.sqrt();
    assert!(camera.direction(0., 0.).abs_diff_eq(corner, 1e-15));
    let edge = DVec3::new(0., 1., 1.) / 2f64.sqrt();
    assert!(camera.direction(0.5, 0.).abs_diff_eq(edge, 1e-15));
}

#[test]
fn the_longest_component_of_up_is_the_zenith() {
    let [x, y, z] = DVec3::AXES;
    let zenith = |a, b, c| {
        let sky = Sky::new(DVec3::new(a, b, c));
        let mut axes = [x, y, z, -x, -y, -z].into_iter();
        axes.find(|&axis| sky.irradiance_ratio(axis) == 1.).unwrap()
    };
    assert_eq!(zenith(-3., 2., 1.), -DVec3::X);
    assert_eq!(zenith(1., 1., 0.5), DVec3::Y);
    assert_eq!(zenith(0., -1., -1.), -DVec3::Z);
    assert_eq!(zenith(0.99, 0., 1.), DVec3::Z);
    assert_eq!(zenith(1., 0., 0.99), DVec3::X);
}

/// An intersector for triangles in the coordinates of the scene.
pub fn intersector(triangles: &[Triangle]) -> Bvh {
    let faces = (0..triangles.len() as u32).collect();
    let triangles = solids::apart(triangles, faces);
    Bvh::of(triangles, Quality::FAST, Isa::Portable, &|_| ()).unwrap()
}

#[test]
fn the_box_entered_first_may_not_have_the_nearest_hit() {
    // Triangles that are lines from `a` to `b` where z = 0.
    let across = |[a, b]: [(f64, f64); 2]| {
        let [left, right] = [-9., 9.].map(|z| DVec3::new(a.0, a.1, z));
        [left, right, DVec3::new(b.0, b.1, 0.)]
    };
    let slanting = across([(0., 11.), (6., 10.)]);
    let upright = across([(2., 0.), (2., 20.)]);
    let intersector = intersector(&[slanting, upright]);
    let met = |height: f64| {
        let origin = DVec3::new(-1., height, 0.);
        let direction = DVec3::new(1., 0.01, 0.).normalize();
        let hit = intersector.first_hit(&Ray { origin, direction }, None);
        let hit = hit.unwrap();
        (intersector.face(hit.primitive), hit.point)
    };
    let (face, point) = met(10.4);
    assert_eq!(face, 1);
    assert!(point.abs_diff_eq(DVec3::new(2., 10.43, 0.), 1e-9));
    assert_eq!([10.636, 10.637].map(|height| met(height).0), [1, 0]);
}

#[test]
fn a_hit_is_less_than_an_atom_before_the_wall() {
    let mut hall = cube(1);
    hall.vertices.iter_mut().for_each(|p| *p *= 50.);
    let scene = Scene::new(&hall);
    // ErrorNorm the height of a hit in metres
    let middle = scene.frame.entrance(DVec3::ZERO).place().unwrap();
    let direction = DVec3::new(1., 0.01, 0.02).normalize();
    let ray = Ray { origin: middle, direction };
    let bvh = intersector(&scene.triangles.to_vec());
    let hit = bvh.first_hit(&ray, None).unwrap();
    let wall = scene.frame.entrance(DVec3::splat(50.)).place().unwrap();
    let metres = (wall.x - hit.point.x) / 128.;
    assert!((metres / 4.0e-13 - 1.).abs() < 0.01, "{metres:e}");
}

#[test]
fn a_poster_on_a_wall_is_not_met_from_the_wall() {
    let corner = |x, y| DVec3::new(x, y, 0.);
    let shape = [corner(-1., -1.), corner(2., -1.), corner(-1., 2.)];
    let corners = |size: f64| shape.map(|p| p * size);
    let (wall, poster) = (corners(2000.), corners(300.));
    let ray = Ray { origin: 500. * DVec3::Z, direction: -DVec3::Z };
    for triangles in [[wall, poster], [poster, wall]] {
        let intersector = intersector(&triangles);
        let hit = intersector.first_hit(&ray, None).unwrap();
        assert_eq!(intersector.face(hit.primitive), 0);
        // Send rays from the wall to the sky
        let mut random = generator(7, 0, 0);
        for i in 0..10_000 {
            let turn = random.random();
            let r = [random.random(), 1. - 2f64.powi(-53)][i % 2];
            let direction = cosine_direction(hit.normal, r, turn);
            let ray = Ray { origin: hit.point, direction };
            assert!(!intersector.is_occluded(&ray, Some(hit.primitive)));
        }
    }
}

#[test]
fn the_first_bits_of_a_net_are_those_of_two_coordinates_later() {
    // Ours agree in the first bits of the first and third coordinate.
    let net = ScrambledNet::new(4);
    for i in 0..4 {
        let ([x, y], [z, w]) =
            (net.unscrambled(i, 0), net.unscrambled(i, 1));
        assert_eq!([x >> 31, y >> 31], [z >> 31, w >> 31]);
    }
}
