// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Answers of `doc/teacher`, as far as the program has a part in them.

use crate::answers_light::{near, sphere, weigh};
use crate::answers_scene::{face, intersector};
use crate::gather::record;
use crate::prelude::*;

use litpt_book::solids::cube;

/// Demands that a mean is within five of its errors of what is printed.
#[track_caller]
fn agrees(sum: &Accumulator, printed: f64) {
    near(sum.mean(), printed, 5. * sum.standard_error() + 5e-4);
}

/// The sums of some values.
fn sum(values: impl IntoIterator<Item = f64>) -> Accumulator {
    let mut sum = Accumulator::default();
    values.into_iter().for_each(|value| sum.add(value));
    sum
}

/// A function of directions with the density of the cosine.
fn lobe(normal: DVec3, f: impl Fn(DVec3) -> f64) -> Accumulator {
    let mut random = generator(20, 0, 0);
    let points = (0..100_000).map(|_| [random.random(), random.random()]);
    sum(points.map(|[r, turn]| f(cosine_direction(normal, r, turn))))
}

fn overcast() -> Sky {
    Sky::with(DVec3::Z, Cover::Overcast)
}

// light-disc, light-fault, sensor-well
#[test]
fn a_surface_gets_its_part_of_a_disc_and_of_half_a_sky() {
    let within = |degrees: f64, light: fn(DVec3) -> f64| {
        let least = degrees.to_radians().cos();
        lobe(DVec3::Z, |w| if w.z > least { light(w) } else { 0. })
    };
    agrees(&within(30., |_| 1.), 0.25);
    agrees(&within(45., |_| 1.), 0.5);
    agrees(&within(45., |w| overcast().radiance(w)), 0.5837);
    let wall = lobe(DVec3::X, |w| Sky::new(DVec3::Z).radiance(w));
    agrees(&wall, 0.5);
    near(wall.variance(), 0.25, 1e-4);
}

// light-lamp: a black triangle takes what a shining one brings.
#[test]
fn a_triangle_above_a_floor_gives_a_tenth_of_its_light() {
    let corners = [(0., 0.), (1., 0.), (0., 1.)];
    let bvh = intersector(&[corners.map(|(x, y)| DVec3::new(x, y, 1.))]);
    let light = |direction| {
        let ray = Ray { origin: DVec3::ZERO, direction };
        f64::from(u8::from(bvh.is_occluded(&ray, None)))
    };
    agrees(&lobe(DVec3::Z, light), 1. / 6. / 3f64.sqrt());
}

// sky-slope, sky-samples, materials-wall
#[test]
fn a_slope_has_its_part_of_the_sky() {
    let skies = [Sky::new(DVec3::Z), overcast()];
    for (degrees, even, grey, on_ground) in [
        (45f64, 0.8536, 0.7975, 0.8975),
        (90., 0.5, 0.3962, 0.65),
        (135., 0.1464, 0.0904, 0.4025),
        (180., 0., 0., 0.3),
    ] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let normal = DVec3::new(sin, 0., cos);
        let [s, cloudy] =
            skies.each_ref().map(|it| it.irradiance_ratio(normal));
        near(s, even, 5e-5);
        near(cloudy, grey, 5e-5);
        near(s + 0.3 * (1. - s), on_ground, 5e-5);
    }
    let wall = lobe(DVec3::X, |w| overcast().radiance(w));
    agrees(&wall, 0.3962);
    near(wall.variance() / wall.mean().powi(2), 1.1635, 0.03);
}

// camera-width, camera-solid-angle, camera-cube
#[test]
fn a_camera_sees_a_wall_a_pixel_and_a_cube() {
    let (position, target, up) = (DVec3::ZERO, DVec3::Y, DVec3::Z);
    let view = |fov| View { position, target, up, fov };
    let camera = |fov| Camera::new(&view(fov), 4. / 3.).unwrap();
    let edge = camera(53.13).direction(1., 0.5);
    near(3. * edge.x / edge.y, 2., 1e-4);
    let angle = |x: f64, y: f64| {
        let [a, b, c] = [(0., 0.), (1e-4, 0.), (0., 1e-4)]
            .map(|(dx, dy)| camera(90.).direction(x + dx, y + dy));
        (b - a).cross(c - a).length()
    };
    near(angle(0., 0.) / angle(0.5, 0.5), 0.136, 5e-4);
    let (from, cube) = ((Viewpoint::Front, [0.; 2]), cube(1));
    let view = view(90.).outside(from, DVec3::Z, cube.vertices.iter(), 1.);
    assert_eq!(view.unwrap().position, DVec3::new(0., -2.1151, 0.));
}

// integrator-thresholds
#[test]
fn a_path_of_a_closed_room_of_nine_tenths_has_32_rays() {
    let (closed, mut film) = (sphere(0., 0.9, 16), Film::new(1, 1));
    let rays = closed.job(1).pass(&mut film, 20_000, &|_| true);
    near(rays as f64 / 20_000., 32., 5. * (90f64 / 20_000.).sqrt());
    let open = sphere(0.1, 0.9, 16);
    let least = (0..500).map(|seed| weigh(&open, seed, 1).mean());
    let least = least.filter(|&x| x > 0.).fold(1., f64::min);
    near(least, 0.0985, 5e-5);
}

// integrator-fence
#[test]
fn a_control_variate_leaves_nothing_of_an_open_wall() {
    let view = look(2. * DVec3::Z, DVec3::ZERO, 20.);
    let setting = Setting::new(&plane(), (0.5, DVec3::X), &view, 1.);
    let setting = setting.unwrap();
    let variance = |control| {
        let (mut job, mut film) = (setting.job(1), Film::new(1, 1));
        job.integrator.control = control;
        job.pass(&mut film, 10_000, &|_| true);
        agrees(film.pixel(0, 0), 0.25);
        film.pixel(0, 0).variance()
    };
    near(variance(0.), 0.0625, 1e-4);
    near(variance(1.), 0., 1e-12);
}

// materials-bands, verification-power
#[test]
fn three_bands_are_brighter_than_their_mean() {
    let cavity = |f, rho, printed| {
        let pixel = weigh(&sphere(f, rho, 128), 2, 10_000);
        agrees(&pixel, printed);
        pixel
    };
    let bands = [(0.8, 0.2857), (0.6, 0.1304), (0.2, 0.0244)];
    let bands = bands.map(|(rho, l)| cavity(0.1, rho, l).mean());
    let luminance = DVec3::new(0.2126, 0.7152, 0.0722);
    near(luminance.dot(bands.into()), 0.1558, 9e-3);
    cavity(0.1, 0.61364, 0.1371);
    near(cavity(0.05, 0.9, 0.310).variance(), 0.0798, 5e-3);
}

// statistics-merge, statistics-cancel
#[test]
fn two_machines_are_added_by_their_sums() {
    let mut both = sum([1., 2., 3.]);
    both.merge(&sum([0., 1.]));
    near(both.mean(), 1.4, 1e-15);
    near(both.variance(), 1.3, 1e-15);
    near(both.standard_error(), 0.51, 5e-3);
    let large = sum([0., 1., 2.].map(|x| 1e8 + x));
    assert_eq!(large.variance(), 1.);
}

// sobol-by-hand, sobol-double
#[test]
fn a_net_of_four_and_a_net_of_two() {
    let net = ScrambledNet::new(4);
    let pair = |i| net.unscrambled(i, 0).map(|x| x >> 30);
    assert_eq!([0, 1, 2, 3].map(pair), [[0, 0], [2, 2], [1, 3], [3, 1]]);
    let sampler = SobolSampler::new(5, 2);
    for pixel in 0..100 {
        let start = |index| sampler.start(pixel, index).get_pixel_2d();
        let cell = |index| start(index).iter().fold(0, |a, b| a ^ b) >> 31;
        assert_eq!(cell(0), cell(1));
    }
}

// cache-walls
#[test]
fn two_walls_that_see_each_other_settle_at_two_thirds() {
    let grid = Grid::around(&[]);
    let [a, b] = [DVec3::Z, -DVec3::Z]
        .map(|normal| grid.name(DVec3::splat(0.5), normal));
    let mut records = [(a, SKY), (a, b), (b, SKY), (b, a)]
        .map(|(from, to)| record(from, to, 1.));
    let cache =
        RadianceCache::empty(grid).learn(&mut records, 0.8, &|_| true);
    near(f64::from(cache.at(a).value), 2. / 3., 2e-3);
}

// polygons-signs
#[test]
fn the_fan_of_an_l_depends_on_its_first_corner() {
    let outline = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]];
    let fan = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]];
    for (first, is_fan) in [(0, true), (1, false), (3, false)] {
        let mut outline = outline.map(|corner| corner.map(f64::from));
        outline.rotate_left(first);
        let (mesh, is_odd) = face(&outline);
        assert_eq!((mesh.triangles == fan, is_odd), (is_fan, false));
    }
}
