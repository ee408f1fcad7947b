// Scenes whose answer can be written down (chapter "Tests").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::camera::{Camera, View};
use litpt::closed_forms::{cavity, cavity_radiance, pixel, plane};
use litpt::estimator::Reference;
use litpt::hierarchy::Hierarchy;
use litpt::image::Image;
use litpt::render::Job;
use litpt::scene::{Mesh, Scene};
use litpt::sky::Sky;

const RHOS: [f64; 6] = [0., 0.2, 0.5, 0.9, 0.99, 1.];

#[test]
fn a_plane_reflects_exactly_its_reflectivity_without_variance() {
    let above = (DVec3::new(0.3, 0.1, 2.), DVec3::ZERO);
    for rho in RHOS {
        let pixel = pixel(&plane(), rho, above, 1000).unwrap();
        assert_eq!((pixel.mean(), pixel.variance()), (rho, 0.));
    }
}

#[test]
fn below_the_plane_it_is_dark() {
    let below = (-DVec3::Z, DVec3::ZERO);
    let pixel = pixel(&plane(), 1., below, 1000).unwrap();
    assert_eq!((pixel.mean(), pixel.variance()), (0., 0.));
}

// A false alarm at 4 standard errors has probability 6.3e-5; the seed is
// fixed.
#[test]
fn an_open_sphere_has_the_radiance_of_its_closed_form() {
    let inside = (DVec3::ZERO, DVec3::new(0.3, 0.2, -1.));
    for f in [0.05, 0.2, 0.5] {
        let mesh = cavity(f, 128);
        for rho in [0.2, 0.5, 0.9, 0.99] {
            let pixel = pixel(&mesh, rho, inside, 20_000).unwrap();
            let exact = cavity_radiance(rho, f);
            let z = (pixel.mean() - exact) / pixel.standard_error();
            assert!(z.abs() < 4., "f = {f}, rho = {rho}: z = {z}");
        }
    }
}

// Many realisations where the roulette below the transmissivity 0.1 decides.
#[test]
fn a_narrow_cavity_is_not_biased_by_roulette() {
    let inside = (DVec3::ZERO, DVec3::new(0.3, 0.2, -1.));
    let pixel = pixel(&cavity(0.05, 128), 0.9, inside, 400_000).unwrap();
    let exact = cavity_radiance(0.9, 0.05);
    let z = (pixel.mean() - exact) / pixel.standard_error();
    assert!(z.abs() < 4., "z = {z}");
}

#[test]
fn a_white_cavity_gives_back_all_the_light_that_enters() {
    let inside = (DVec3::ZERO, DVec3::new(0.3, 0.2, -1.));
    let pixel = pixel(&cavity(0.1, 64), 1., inside, 5000).unwrap();
    assert_eq!((pixel.mean(), pixel.variance()), (1., 0.));
}

#[test]
fn a_black_cavity_is_black() {
    let inside = (DVec3::ZERO, DVec3::new(0.3, 0.2, -1.));
    let pixel = pixel(&cavity(0.1, 64), 0., inside, 5000).unwrap();
    assert_eq!((pixel.mean(), pixel.variance()), (0., 0.));
}

#[test]
fn without_a_scene_the_sky_is_one_above_and_zero_below() {
    let scene = Scene::new(&Mesh::default());
    let kernel = Hierarchy::new(&scene).unwrap();
    for up in
        [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y, DVec3::Z, -DVec3::Z]
    {
        let target = if up.x == 0. { DVec3::X } else { DVec3::Y };
        let view = View { position: DVec3::ZERO, target, up, fov: 70. };
        let camera = Camera::new(&view, 4. / 3.).unwrap();
        let estimator = Reference { reflectivity: 0.5, sky: Sky::new(up) };
        let job = Job {
            scene: &scene,
            kernel: &kernel,
            camera: &camera,
            estimator: &estimator,
            seed: 0,
        };
        let mut image = Image::new(40, 30);
        job.pass(&mut image, 0..3, &|_| ());
        for (i, mean) in image.means().enumerate() {
            assert_eq!(mean, if i < 600 { 1. } else { 0. }, "{up} {i}");
        }
    }
}

#[test]
fn a_closed_white_room_ends_and_is_dark() {
    // The opening has no area: the first ring is a point, like the last.
    let inside = (DVec3::ZERO, DVec3::new(0.3, 0.2, -1.));
    let pixel = pixel(&cavity(0., 16), 1., inside, 20).unwrap();
    assert_eq!((pixel.mean(), pixel.variance()), (0., 0.));
}
