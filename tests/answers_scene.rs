// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Answers to the book's exercises on scenes, geometry and sampling, one
//! test for each.

mod common;

// Name what the answers up to sampling import
use std::f64::consts::FRAC_PI_2;
use std::io::Write;

use common::{ROOM, Scratch};
use flate2::{Compression, Crc, write::GzEncoder};
use glam::{DVec3, Vec3};
use litpt::bvh::{Bvh, Hit, Intersector, Isa, Quality};
use litpt::camera::{Camera, View};
use litpt::film::Film;
use litpt::numerics::{cross, power_of_two};
use litpt::render::Renderer;
use litpt::sampler::sobol::{ScrambledNet, scramble_key, to_unit};
use litpt::sampler::{cosine_direction, generator, happens, within};
use litpt::scene::{
    Mesh, Ray, Scene, Triangle, Triangles, read_file, read_obj,
};
use litpt::sky::Sky;
use litpt::statistics::Accumulator;
use litpt_book::closed_forms::{Setting, look, pixel};
use rand::RngExt;
use rand_pcg::Pcg64;
use serde_json::Value;
use statrs::distribution::{ContinuousCDF, StudentsT};

// Judge a mean by its standard error
/// Demands that a mean of `n` samples of this variance is near
/// what is expected.
#[track_caller]
fn near(mean: f64, expected: f64, variance: f64, n: u32) {
    let z = (mean - expected) / (variance / f64::from(n)).sqrt();
    assert!(z.abs() < 5., "{mean}, not {expected}: z = {z}");
}

// Answer the exercises of the introduction
/// What a path weighs between walls of albedo `rho` that see the
/// sky with probability `s`.
fn weight(rho: f64, s: f64, random: &mut Pcg64) -> f64 {
    let mut weight = rho;
    while !happens(s, random.random()) {
        weight *= rho;
    }
    weight
}

#[test]
fn most_light_of_a_gallery_was_reflected_more_than_once() {
    let (rho, s, n) = (0.8, 0.1, 100_000);
    let series = |rho: f64| rho * s / (1. - rho * (1. - s));
    let radiance = series(rho);
    let once = rho * s / radiance;
    assert!((radiance - 2. / 7.).abs() < 1e-15);
    assert!((once - 0.28).abs() < 1e-15);
    // Follow paths through the gallery
    let variance = series(rho * rho) - radiance * radiance;
    assert!((variance - 0.0693).abs() < 5e-5);
    let mut random = generator(1, 0, 0);
    let sum: f64 = (0..n).map(|_| weight(rho, s, &mut random)).sum();
    near(sum / f64::from(n), radiance, variance, n);
}

#[test]
fn a_status_tells_a_wrong_call_from_a_failure() {
    let place = Scratch::new();
    let run = |arguments: &str| {
        let line = format!("-d 4x3 {arguments}");
        place.run(&line.split(' ').collect::<Vec<_>>())
    };
    run("-i room.obj -o a.pgm").succeeded();
    let film = place.get("a.pgm");
    run("-i room.obj -o a.pgm").failed(1, &["a.pgm", "-f"]);
    run("-i room.obj -o b.pgm -n 0").failed(2, &["--spp"]);
    // Give the other three commands
    let blind = "-t 0,0,0 -i nowhere.obj -o b.pgm";
    run(blind).failed(1, &["own position 0,0,0"]);
    run("-i nowhere.obj -o b.pgm").failed(1, &["nowhere.obj: cannot"]);
    run("-i room.obj -o b.pgm --explain").succeeded();
    place.holds_only(&["a.pgm"]);
    assert_eq!(place.get("a.pgm"), film);
}

/// The default view of the program.
const AHEAD: View = View {
    position: DVec3::ZERO,
    target: DVec3::Y,
    up: DVec3::Z,
    fov: 70.,
};

/// The pixels of the room after these passes.
fn rendered(passes: &[u64]) -> Vec<Accumulator> {
    let room = read_obj(ROOM.as_bytes()).unwrap();
    let light = (0.7, DVec3::Z);
    let setting = Setting::new(&room, light, &AHEAD, 1.).unwrap();
    let mut film = Film::new(20, 20);
    for &end in passes {
        setting.job(0).pass(&mut film, end, &|_| true);
    }
    film.stored().to_vec()
}

#[test]
fn the_length_of_passes_does_not_matter() {
    let bits = |passes: &[u64]| -> Vec<[u8; 64]> {
        rendered(passes).iter().map(Accumulator::to_bytes).collect()
    };
    let at_once = bits(&[3]);
    assert!(bits(&[1, 2, 3]) == at_once);
    assert!(bits(&[1, 1, 3, 2]) == at_once);
    assert!(bits(&[1, 2]) != at_once);
}

// Answer the exercises on the arguments
/// A square wall that fills the view of the program.
const WALL: &str = "v -1e6 5 -1e6\nv 1e6 5 -1e6\nv 1e6 5 1e6\n\
                    v -1e6 5 1e6\nf 1 2 3 4\n";

/// The error that a run reports of its image of the wall.
fn error_of(n: u32) -> f64 {
    let place = Scratch::new();
    place.put("wall.obj", WALL);
    let n = n.to_string();
    let scene = ["-iwall.obj", "-r0.5", "-d64x48", "-n", &n];
    let method = ["--keep-all", "--integrator=reference"];
    let files = ["-oa.pgm", "--report", "a.json"];
    place.run(&[&scene[..], &method, &files].concat()).succeeded();
    let report: Value =
        serde_json::from_slice(&place.get("a.json")).unwrap();
    report["rmse"].as_f64().unwrap()
}

#[test]
fn sixteen_times_the_realisations_quarter_the_error() {
    for (n, expected) in [(16, 1. / 16.), (256, 1. / 64.)] {
        let ratio = error_of(n) / expected;
        assert!((ratio - 1.).abs() < 0.005, "{n}: {ratio}");
    }
}

#[test]
fn a_value_that_is_almost_right_is_refused() {
    let place = Scratch::new();
    let status = |option| {
        let run = place.run(&["-iroom.obj", "--explain", option]);
        run.status.unwrap()
    };
    // Offer values that are almost right
    for right in ["-d16384x1", "-t-1,.5,1e1", "-F179.999"] {
        assert_eq!(status(right), 0, "{right}");
    }
    for wrong in ["-d+8x6", "-d8e1x60", "-p1,2,3,", "-F180"] {
        assert_eq!(status(wrong), 2, "{wrong}");
    }
    assert_eq!(status("-r1.0000000000000002"), 2);
    assert_eq!(status("-r1.0000000000000001"), 0);
}

#[test]
fn one_of_five_options_changes_an_image() {
    let place = Scratch::new();
    place.put("wall.obj", WALL);
    let film = |option: &str| {
        let scene = ["-iwall.obj", "-d64x48", "-n2", "-q"];
        let run = place.run(&[&scene[..], &[option]].concat());
        run.succeeded();
        run.stdout
    };
    // Compare images with and without an option
    let plain = film("-F70");
    assert!(film("-s1") != plain && film("--keep-all") == plain);
    let others = ["-j1", "--isa=portable", "--report=a.json", "--keep-all"];
    for option in ["-s1"].into_iter().chain(others) {
        let room = ["-d16x12", "-n2", "-r0.7"];
        let same = place.render(&[&room[..], &[option]].concat())
            == place.render(&room);
        assert_eq!(same, option != "-s1", "{option}");
    }
}

#[test]
fn nearly_parallel_vectors_have_a_cross_product() {
    let epsilon = power_of_two(-30);
    let u = DVec3::new(1. + epsilon, 1., 0.);
    let v = DVec3::new(1., 1. - epsilon, 0.);
    assert_eq!(u.cross(v).z, 0.);
    assert_eq!(cross(u, v).z, -power_of_two(-60));
    let angle = cross(u, v).length() / (u.length() * v.length());
    assert!((angle - 4e-19).abs() < 0.4e-19);
    let view = View { position: DVec3::ZERO, target: u, up: v, fov: 9. };
    assert!(Camera::new(&view, 1.).is_ok());
}

/// The sine of `x` from the first terms of its series.
fn sine(terms: i32, x: f64) -> f64 {
    let square = x * x;
    let next = |sum: f64, k: i32| {
        1. - sum * square / f64::from(2 * k * (2 * k + 1))
    };
    x * (1..terms).rev().fold(1., next)
}

/// `x` to the power `k`, over k!.
fn left_out(k: i32, x: f64) -> f64 {
    (1..=k).map(|j| x / f64::from(j)).product()
}

#[test]
fn half_turns_need_eleven_terms() {
    let enough = |power| left_out(power, FRAC_PI_2) < 1.1e-16;
    assert_eq!((1..30).find(|n| enough(2 * n + 1)), Some(11));
    assert_eq!((1..30).find(|n| enough(2 * n)), Some(11));
    let error = 1. - sine(8, FRAC_PI_2);
    assert!((error / 6.02e-12 - 1.).abs() < 0.01, "{error:e}");
    assert!((1. - sine(11, FRAC_PI_2)).abs() < 2.3e-16);
}

// Answer the exercises on files
const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

fn gzip(text: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(vec![], Compression::best());
    encoder.write_all(text).unwrap();
    encoder.finish().unwrap()
}

/// The checksum of gzip.
fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// The four bytes after which a text has a checksum.
fn ending(text: &[u8], wanted: u32) -> [u8; 4] {
    let with = |end: u32| checksum(&[text, &end.to_le_bytes()].concat());
    // What each bit of the end changes; then elimination, bit by bit.
    let zero = with(0);
    let columns = (0..32).map(|i| (1u32 << i, with(1 << i) ^ zero));
    let mut columns: Vec<_> = columns.collect();
    let (mut end, mut rest) = (0, wanted ^ zero);
    for bit in 0..32 {
        let found = columns.iter().position(|c| c.1 >> bit & 1 == 1);
        let (chosen, change) = columns.swap_remove(found.unwrap());
        for column in &mut columns {
            if column.1 >> bit & 1 == 1 {
                *column = (column.0 ^ chosen, column.1 ^ change);
            }
        }
        if rest >> bit & 1 == 1 {
            (end, rest) = (end ^ chosen, rest ^ change);
        }
    }
    end.to_le_bytes()
}

#[test]
fn a_checksum_finds_accidents_but_not_intent() {
    let right = checksum(TRIANGLE.as_bytes());
    for at in 0..TRIANGLE.len() {
        for change in 1..=255 {
            let mut text = TRIANGLE.as_bytes().to_vec();
            text[at] ^= change;
            assert_ne!(checksum(&text), right);
        }
    }
    let first = TRIANGLE.to_owned() + "#........\n";
    let wanted = checksum(first.as_bytes());
    let other = |letter: char| {
        let text = TRIANGLE.replace("v 1", "v 2")
            + "#...."
            + letter.encode_utf8(&mut [0; 4]);
        let end = ending(text.as_bytes(), wanted);
        [text.as_bytes(), &end].concat()
    };
    let is_line = |text: &Vec<u8>| !text[text.len() - 4..].contains(&b'\n');
    let second = ('a'..='z').map(other).find(is_line).unwrap();
    let tail = |text: &[u8]| gzip(text).last_chunk::<8>().copied();
    assert_eq!(tail(first.as_bytes()), tail(&second));
    let scene = |text: &[u8]| read_obj(&gzip(text)).unwrap();
    assert_ne!(scene(first.as_bytes()), scene(&second));
}

// Answer the exercises on the scene
#[test]
fn a_hall_of_300_metres_is_scaled_by_32() {
    let far = DVec3::new(300., 40., 12.);
    let vertices = vec![DVec3::ZERO, far, far * DVec3::X];
    let hall =
        Mesh { vertices, triangles: vec![[0, 1, 2]], joined: vec![] };
    let scene = Scene::new(&hall);
    let corner = scene.triangles.get(0)[1];
    assert_eq!(corner, DVec3::new(4800., 640., 192.));
    let metres = (corner.x.next_up() - corner.x) / 32.;
    assert_eq!(metres, power_of_two(-45));
}

/// The text of the room, each coordinate divided, and moved along x.
fn moved(divisor: f64, by: f64) -> String {
    let move_line = |line: &str| match line.strip_prefix("v ") {
        None => format!("{line}\n"),
        Some(numbers) => {
            let mut p = numbers
                .split(' ')
                .map(|n| n.parse::<f64>().unwrap() / divisor);
            let mut next = || p.next().unwrap();
            let (x, y, z) = (next() + by, next(), next());
            format!("v {x:.1} {y:.1} {z:.1}\n")
        }
    };
    ROOM.lines().map(move_line).collect()
}

#[test]
fn ten_million_metres_away_the_room_is_the_same() {
    let place = Scratch::new();
    place.put("far.obj", moved(1., 1e7));
    let there = ["-ifar.obj", "-p1e7,0,0", "-t1e7,1,0", "-d32x24"];
    let run = place.run(&there);
    run.succeeded();
    assert_eq!(run.stdout, place.render(&["-d32x24"]));
}

/// The coordinates of all corners in the scene.
fn placed(text: &str) -> Vec<[f64; 3]> {
    let scene = Scene::new(&read_obj(text.as_bytes()).unwrap());
    let triangles = scene.triangles.to_vec();
    let corners = triangles.as_flattened().iter();
    corners.map(|corner| (*corner - triangles[0][0]).to_array()).collect()
}

#[test]
fn tenths_of_metres_move_by_nanometres_far_away() {
    let near = placed(&moved(10., 0.));
    // A metre of the room is 2^13 in the scene.
    let most = |by| {
        let far = placed(&moved(10., by));
        let pairs = near.as_flattened().iter().zip(far.as_flattened());
        let moves = pairs.map(|(a, b)| (a - b).abs() / 8192.);
        moves.fold(0., f64::max)
    };
    let [million, billion] = [most(1e7), most(1e9)];
    assert!(million > 1e-10 && million <= 2. * power_of_two(-30));
    assert!(billion > 1e-8 && billion <= 2. * power_of_two(-24));
    let mesh = read_obj(moved(10., 1e7).as_bytes()).unwrap();
    let single = |p: &DVec3| p.as_vec3().x == 1e7;
    assert!(mesh.vertices.iter().all(single));
}

// Answer the exercises on polygons
/// A face with these corners in a plane, and whether it is odd.
fn face(corners: &[[f64; 2]]) -> (Mesh, bool) {
    let vertex = |[x, y]: &[f64; 2]| format!("v {x:?} {y:?} 0\n");
    let vertices: String = corners.iter().map(vertex).collect();
    let numbers = (1..=corners.len()).map(|i| format!(" {i}"));
    let text = vertices + "f" + &numbers.collect::<String>() + "\n";
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

#[test]
fn a_pentagram_is_drawn_with_two_of_its_gaps() {
    let at = |degrees: f64, r: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [r * cos, r * sin]
    };
    let corners: Vec<_> =
        (0..5).map(|i| at(f64::from(144 * i), 1.)).collect();
    let (crossed, is_odd) = face(&corners);
    assert!(is_odd && crossed.triangles.len() == 3);
    let areas = |mesh: &Mesh| -> Vec<f64> {
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| mesh.vertices[i as usize]);
            0.5 * (b - a).cross(c - a).z
        };
        mesh.triangles.iter().map(area).collect()
    };
    let four_digits = |x: f64| (1e4 * x).round();
    let digits = areas(&crossed).into_iter().map(four_digits);
    assert_eq!(digits.collect::<Vec<_>>(), [10633., -6572., 10633.]);
    let sum: f64 = areas(&crossed).iter().sum();
    assert_eq!(four_digits(sum), 14695.);
    // Draw the fan
    let scene = Scene::new(&crossed);
    let bvh = Bvh::new(&scene).unwrap();
    let n = 100_000;
    let mut random = generator(11, 0, 0);
    let drawn = (0..n).filter(|_| {
        let mut number = || 2. * random.random::<f64>() - 1.;
        let origin = DVec3::new(number(), number(), 1.);
        let ray = scene.frame.entrance(origin).enter(-DVec3::Z);
        ray.is_some_and(|ray| bvh.is_occluded(&ray, None))
    });
    let share: f64 = 1.6246 / 4.;
    let drawn = drawn.count() as f64 / f64::from(n);
    near(drawn, share, share * (1. - share), n);
    // Write the crossings as corners
    let inner = (5f64.sqrt() - 1.).powi(2) / 4.;
    let ten = (0..10).map(|i| {
        at(f64::from(36 * i), if i % 2 == 0 { 1. } else { inner })
    });
    let (star, is_odd) = face(&ten.collect::<Vec<_>>());
    assert!(!is_odd && areas(&star).iter().all(|&area| area > 0.));
    assert_eq!(four_digits(areas(&star).iter().sum()), 11226.);
}

// Answer the exercises on the camera
/// A camera at the origin that looks along y.
fn camera(fov: f64, aspect: f64) -> Camera {
    Camera::new(&View { fov, ..AHEAD }, aspect).unwrap()
}

#[test]
fn the_top_left_corner_is_to_the_left_and_up() {
    let camera = camera(90., 4. / 3.);
    let corner = DVec3::new(-4., 3., 3.) / 34f64.sqrt();
    assert!(camera.direction(0., 0.).abs_diff_eq(corner, 1e-15));
    let edge = DVec3::new(0., 1., 1.) / 2f64.sqrt();
    assert!(camera.direction(0.5, 0.).abs_diff_eq(edge, 1e-15));
}

/// The solid angle per area of the image around a point.
fn density(camera: &Camera, x: f64, y: f64) -> f64 {
    const SIDE: f64 = 1e-6;
    let here = camera.direction(x, y);
    let along_row = camera.direction(x + SIDE, y) - here;
    let along_column = camera.direction(x, y + SIDE) - here;
    along_row.cross(along_column).length() / (SIDE * SIDE)
}

#[test]
fn a_pixel_in_the_corner_subtends_less() {
    let ratio = |fov| {
        let camera = camera(fov, 4. / 3.);
        density(&camera, 0., 0.) / density(&camera, 0.5, 0.5)
    };
    assert!((ratio(70.) - 0.2755).abs() < 1e-4);
    let tangent = (0.9f64.powf(-2. / 3.) - 1.).sqrt() * 0.6;
    let most = 2. * tangent.atan().to_degrees();
    assert!((most - 18.4).abs() < 0.05);
    assert!((ratio(most) - 0.9).abs() < 1e-4);
}

// Answer the exercises on the sky
#[test]
fn the_longest_component_of_up_is_the_zenith() {
    let zenith = |x, y, z| Sky::new(DVec3::new(x, y, z)).zenith();
    assert_eq!(zenith(-3., 2., 1.), -DVec3::X);
    assert_eq!(zenith(1., 1., 0.5), DVec3::Y);
    assert_eq!(zenith(0., -1., -1.), -DVec3::Z);
    assert_eq!(zenith(0.99, 0., 1.), DVec3::Z);
    assert_eq!(zenith(1., 0., 0.99), DVec3::X);
}

#[test]
fn a_steep_roof_sees_three_quarters_of_the_sky() {
    let normal = DVec3::new(0.75f64.sqrt(), 0., 0.5);
    assert!((Sky::new(DVec3::Z).share(normal) - 0.75).abs() < 1e-15);
    // Build a roof of two triangles
    let along = 1000. * DVec3::new(-0.5, 0., 0.75f64.sqrt());
    let across = 1000. * DVec3::Y;
    let (a, b) = (along - across, along + across);
    let vertices = vec![a, -b, -a, b];
    let roof = Mesh {
        vertices,
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        joined: vec![],
    };
    let n = 100_000;
    let view = look(normal, DVec3::ZERO, 20.);
    let pixel = pixel(&roof, 0.8, &view, n.into()).unwrap();
    near(pixel.mean(), 0.6, 0.12, n);
    assert!((pixel.variance() - 0.12).abs() < 0.002);
}

#[test]
fn an_overcast_sky_gives_seven_ninths() {
    let n = 100_000;
    let mut random = generator(2, 0, 0);
    let light = |_| {
        let (r, turn) = (random.random(), random.random());
        let direction = cosine_direction(DVec3::Z, r, turn);
        (1. + 2. * direction.z) / 3.
    };
    let sum: f64 = (0..n).map(light).sum();
    let variance = 4. / 9. * (1. / 2. - 4. / 9.);
    near(sum / f64::from(n), 7. / 9., variance, n);
}

// Answer the exercises on meeting triangles
/// An intersector for triangles in the coordinates of the scene.
fn intersector(triangles: &[Triangle]) -> Bvh {
    let faces = (0..triangles.len() as u32).collect();
    let triangles = Triangles::apart(triangles, faces);
    Bvh::of(triangles, Quality::Medium, Isa::Portable, &|_| ()).unwrap()
}

#[test]
fn a_ray_meets_a_triangle_where_the_weights_say() {
    let corners = [[-0.5, -1., 1.], [4., -1., 2.], [3., 3., 4.]];
    let direction = DVec3::new(1., 0., 2.).normalize();
    let ray = Ray { origin: DVec3::X, direction };
    let intersector = intersector(&[corners.map(DVec3::from)]);
    let hit = intersector.first_hit(&ray, None).unwrap();
    let point = DVec3::new(33. / 16., 0., 17. / 8.);
    assert!(hit.point.abs_diff_eq(point, 2. * power_of_two(-34)));
    let distance = hit.point.distance(ray.origin);
    assert!((distance - 2.3758).abs() < 5e-5);
}

#[test]
fn rounded_products_lose_signs_but_never_exchange_them() {
    let mut random = generator(3, 0, 0);
    let mut integer = || i128::from(random.random::<u64>() >> 11);
    let mut lost = 0;
    for _ in 0..100_000 {
        let (a, b) = (integer(), integer());
        let (c, d) = (a + 1, b - 1);
        // Compare the sign with the exact one
        let exact = (a * b - c * d).signum();
        let rough = a as f64 * b as f64 - c as f64 * d as f64;
        match rough {
            0. => lost += 1,
            _ => assert_eq!(rough.signum(), exact as f64),
        }
    }
    assert!((27_900..29_300).contains(&lost), "{lost}");
}

/// Möller and Trumbore's test in single precision.
fn is_met_in_single(ray: &Ray, corners: &Triangle) -> bool {
    let [a, b, c] = corners.map(|corner| corner.as_vec3());
    let (origin, direction) =
        (ray.origin.as_vec3(), ray.direction.as_vec3());
    let (e1, e2, s) = (b - a, c - a, origin - a);
    let p = direction.cross(e2);
    let q = s.cross(e1);
    let scale = 1. / e1.dot(p);
    let (u, v) = (s.dot(p) * scale, direction.dot(q) * scale);
    u >= 0. && v >= 0. && u + v <= 1. && e2.dot(q) * scale > 0.
}

/// The twelve triangles of a cube.
fn cube() -> Vec<Triangle> {
    let face = |k: usize| {
        let corner = |x: f64, y: f64| {
            let mut p = [x, y, [1., -1.][k / 3]];
            p.rotate_right(k % 3);
            3000. * DVec3::from(p)
        };
        let [a, b] = [corner(-1., -1.), corner(1., -1.)];
        let [c, d] = [corner(1., 1.), corner(-1., 1.)];
        [[a, b, c], [a, c, d]]
    };
    (0..6).flat_map(face).collect()
}

#[test]
fn rays_aimed_at_edges_escape_in_single_precision_only() {
    let cube = cube();
    let intersector = intersector(&cube);
    let mut random = generator(4, 0, 0);
    let mut escapes = 0;
    for i in 0..100_000 {
        // Aim from inside at a point of an edge
        let mut inside = || 5000. * random.random::<f64>() - 2500.;
        let origin = DVec3::new(inside(), inside(), inside());
        let corners = cube[i % 12];
        let (p, q) = (corners[i / 12 % 3], corners[(i / 12 + 1) % 3]);
        let aim = p + random.random::<f64>() * (q - p);
        let ray = Ray { origin, direction: (aim - origin).normalize() };
        let met = cube.iter().any(|t| is_met_in_single(&ray, t));
        escapes += u32::from(!met);
        assert!(intersector.is_occluded(&ray, None));
    }
    assert!((2900..3450).contains(&escapes), "{escapes}");
}

// Answer the exercises on the wide hierarchy
/// Half the surface of a box of `k` cubes in a row.
fn half_area(k: u32) -> f64 {
    f64::from(2 * k + 1)
}

#[test]
fn a_chain_costs_more_than_a_balanced_tree() {
    let leaves = 8. * half_area(1);
    let cost = |inner: &[u32]| {
        let sum: f64 = inner.iter().map(|&k| half_area(k)).sum();
        (leaves + sum) / half_area(8)
    };
    let near = |a: f64, b: f64| (a - b).abs() < 0.005;
    assert!(near(cost(&[8, 4, 4, 2, 2, 2, 2]), 4.65));
    assert!(near(cost(&[8, 7, 6, 5, 4, 3, 2]), 5.94));
    assert!(near(cost(&[8]), 2.41));
    assert_eq!(2. * half_area(4), 18.);
}

/// The least inner area of a forest of at most `most` wide trees with
/// up to four children, for a balanced tree over `k` cubes.
fn least(k: u32, most: u32) -> f64 {
    if k == 1 {
        return 0.;
    }
    let split = |most: u32| {
        let sides = |a| least(k / 2, a) + least(k / 2, most - a);
        (1..most).map(sides).fold(f64::INFINITY, f64::min)
    };
    let alone = half_area(k) + split(4);
    split(most).min(alone)
}

#[test]
fn the_greedy_cut_is_not_the_best() {
    let sum = |inner: &[u32]| -> f64 {
        inner.iter().map(|&k| half_area(k)).sum()
    };
    assert_eq!(sum(&[8, 2, 2, 2, 2]), 37.);
    assert_eq!(sum(&[8, 4, 4]), 35.);
    assert_eq!(sum(&[8, 2, 4]), 31.);
    assert_eq!(least(8, 1), 31.);
}

// Answer the exercises on the walk
/// Where a ray enters and leaves a box, by the equation of a plane.
fn slabs(o: Vec3, d: Vec3, low: Vec3, high: Vec3) -> (f32, f32) {
    let r = 1. / d;
    let (a, b) = (low * r - o * r, high * r - o * r);
    (a.min(b).max_element().max(0.), a.max(b).min_element())
}

#[test]
fn a_ray_in_the_plane_of_a_box_enters_it() {
    let o = Vec3::new(-1., 0.5, 0.);
    let d = Vec3::new(0.8, 0.6, power_of_two(-60) as f32);
    let high = Vec3::new(4., 2., 1.);
    let near = |(a, b): (f32, f32)| {
        (a - 1.25).abs() < 1e-6 && (b - 2.5).abs() < 1e-6
    };
    assert!(near(slabs(o, d, Vec3::new(0., 0., -1.), high)));
    assert!(near(slabs(o, d, Vec3::ZERO, high)));
    let r = 1. / 0f32;
    assert!((0. * r - 0. * r).is_nan());
}

/// The worst displacement of planes in a scene of this size, in units
/// of the bound.
fn displacement(size: f64) -> f64 {
    let mut random = generator(5, 0, 0);
    let mut worst = 0f64;
    for _ in 0..1_000_000 {
        let mut number = || 2. * random.random::<f64>() - 1.;
        let (b, o, d) = (size * number(), size * number(), number());
        let (b, r) = (b as f32, 1. / d as f32);
        let t = b * r - o as f32 * r;
        let plane = o + f64::from(t) * d;
        worst = worst.max((plane - f64::from(b)).abs());
    }
    worst / (size * 5. * power_of_two(-23))
}

#[test]
fn the_padding_is_a_millionth_of_any_scene() {
    for exponent in [13, 20] {
        let worst = displacement(power_of_two(exponent));
        assert!(worst > 0.5 && worst < 1., "{worst}");
    }
}

/// Six walls across the x axis, from `x` on, between two heights.
fn walls(x: f64, low: f64, high: f64) -> impl Iterator<Item = Triangle> {
    (0..6).map(move |i| {
        let x = x + 0.1 * f64::from(i);
        let top = DVec3::new(x, high, 0.);
        let [left, right] = [-9., 9.].map(|z| DVec3::new(x, low, z));
        [left, right, top]
    })
}

#[test]
fn the_order_of_an_octant_may_be_wrong_and_the_hit_is_right() {
    let sum = |x: f64, y: f64| x + y;
    assert!(sum(0., 10.) > sum(5., 0.));
    let walls = walls(0., 10., 11.).chain(walls(5., 0., 20.));
    let intersector = intersector(&walls.collect::<Vec<_>>());
    let origin = DVec3::new(-1., 10.4, 0.);
    let direction = DVec3::new(1., 0.01, 0.).normalize();
    let hit = intersector.first_hit(&Ray { origin, direction }, None);
    let point = hit.unwrap().point;
    assert!(point.abs_diff_eq(DVec3::new(0., 10.41, 0.), 1e-9));
}

// Answer the exercises on the next origin
#[test]
fn a_hit_is_less_than_an_atom_before_the_wall() {
    let vertices: Vec<_> =
        cube().as_flattened().iter().map(|p| *p / 60.).collect();
    let triangles =
        (0..12).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let hall = Mesh { vertices, triangles, joined: vec![] };
    let scene = Scene::new(&hall);
    // Measure the height of a hit in metres
    let middle = scene.frame.entrance(DVec3::ZERO).place().unwrap();
    let direction = DVec3::new(1., 0.01, 0.02).normalize();
    let ray = Ray { origin: middle, direction };
    let bvh = intersector(&scene.triangles.to_vec());
    let hit = bvh.first_hit(&ray, None).unwrap();
    let wall = scene.frame.entrance(DVec3::splat(50.)).place().unwrap();
    let metres = (wall.x - hit.point.x) / 128.;
    assert!((metres / 4.0e-13 - 1.).abs() < 0.01, "{metres:e}");
    // Compute what the answer says of other lengths
    let near = |size: f64, digits: i32| size * power_of_two(-digits);
    assert!((near(118.75, 35) / 3.5e-9 - 1.).abs() < 0.02);
    assert!((near(118.75 + 1.25e6, 47) / 8.9e-9 - 1.).abs() < 0.01);
}

/// A closed prism whose cross section is a triangle 2^12 long and 2^-8
/// high.
fn wedge() -> Vec<Triangle> {
    let section = [(0., 0.), (4096., 0.), (4096., 1. / 256.)];
    let at = |z: f64| section.map(|(x, y)| DVec3::new(x, y, z));
    let (near, far) = (at(-4096.), at(4096.));
    let mut sides = vec![near, far];
    for i in 0..3 {
        let j = (i + 1) % 3;
        sides.push([near[i], near[j], far[i]]);
        sides.push([near[j], far[j], far[i]]);
    }
    sides
}

/// How many of 500 paths leave the wedge, if rays start at `origin`.
fn escapes(origin: impl Fn(&Hit) -> DVec3) -> usize {
    let intersector = intersector(&wedge());
    let mut random = generator(6, 0, 0);
    let escapes = (0..500).filter(|_| {
        let x = 4096. * random.random::<f64>();
        let start = DVec3::new(x, x / 2. * power_of_two(-20), 0.);
        let (mut at, mut normal, mut from) = (start, DVec3::X, None);
        (0..100).any(|_| {
            // Go on to the next wall of the wedge
            let (r, turn) = (random.random(), random.random());
            let direction = cosine_direction(normal, r, turn);
            let ray = Ray { origin: at, direction };
            let Some(hit) = intersector.first_hit(&ray, from) else {
                return true;
            };
            (at, normal) = (origin(&hit), hit.normal);
            from = Some(hit.primitive);
            false
        })
    });
    escapes.count()
}

#[test]
fn only_a_fixed_distance_leads_out_of_a_wedge() {
    let moved =
        |hit: &Hit| hit.point.as_vec3().as_dvec3() + hit.normal / 512.;
    let (fixed, ours) = (escapes(moved), escapes(|hit| hit.point));
    assert!((195..=305).contains(&fixed), "{fixed}");
    assert_eq!(ours, 0);
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
            let r = if i % 2 == 0 {
                random.random()
            } else {
                1. - 2f64.powi(-53)
            };
            let direction = cosine_direction(hit.normal, r, turn);
            let ray = Ray { origin: hit.point, direction };
            assert!(!intersector.is_occluded(&ray, Some(hit.primitive)));
        }
    }
}

// Answer the exercises on sampling
#[test]
fn one_direction_in_a_hundred_is_flatter_than_six_degrees() {
    let n = 100_000;
    let mut random = generator(8, 0, 0);
    let cosine = |_| {
        let (r, turn) = (random.random(), random.random());
        cosine_direction(DVec3::Z, r, turn).z
    };
    let cosines: Vec<f64> = (0..n).map(cosine).collect();
    // Judge the shares of flat directions
    let share = |least: f64| {
        let flat = cosines.iter().filter(|&&cosine| cosine < least);
        flat.count() as f64 / f64::from(n)
    };
    near(share(0.5f64.sqrt()), 0.5, 0.25, n);
    near(share(0.1), 0.01, 0.01 * 0.99, n);
    let mean = cosines.iter().sum::<f64>() / f64::from(n);
    near(mean, 2. / 3., 1. / 18., n);
    assert!((libm::asin(0.1).to_degrees() - 5.74).abs() < 0.005);
}

#[test]
fn a_sum_with_the_column_may_be_rounded_to_the_next() {
    let step = power_of_two(-53);
    for (x, wrong) in [(0, 0), (1, 1), (2, 2), (1000, 512), (16383, 8192)] {
        let x = f64::from(x);
        let rounded = (1..=20_000).filter(|&j| {
            let u = 1. - f64::from(j) * step;
            x + u == x + 1.
        });
        assert_eq!(rounded.count(), wrong);
    }
    // Add up the columns that go wrong
    let row = (0..14).map(|k| 4f64.powi(k)).sum::<f64>() * step;
    assert!((row - 9.93e-9).abs() < 0.005e-9);
    assert!((2. * row * 16384. * 1000. - 0.33).abs() < 0.005);
    let last = within(16383, 16384, u32::MAX);
    assert!(last < 1. && within(5, 16384, u32::MAX) < 6. / 16384.);
}

#[test]
fn uniform_directions_cost_a_variance_of_a_third() {
    let (n, mut pixel) = (100_000, Accumulator::default());
    let mut random = generator(9, 0, 0);
    for _ in 0..n {
        let cosine: f64 = random.random();
        pixel.add(2. * cosine);
    }
    near(pixel.mean(), 1., 1. / 3., n);
    assert!((pixel.variance() - 1. / 3.).abs() < 0.0047);
    let ten = (4f64 / 3.).powi(10) - 1.;
    assert!((ten - 16.8).abs() < 0.05);
}

// Answer the exercises on nets
#[test]
fn no_four_coordinates_are_nets_of_four_points_in_all_pairs() {
    let sign = |vector: u32, k: u32| 1 - 2 * (vector >> k & 1) as i32;
    let product =
        |v, w| (0..4).map(|k| sign(v, k) * sign(w, k)).sum::<i32>();
    let all: Vec<u32> = (0..16).filter(|&v| product(v, 0) == 0).collect();
    let fits = |v: &[u32]| {
        (0..v.len()).all(|i| (0..i).all(|j| product(v[i], v[j]) == 0))
    };
    let (mut threes, mut fours) = (0, 0);
    for (&a, &b, &c) in triples(&all) {
        threes += u32::from(fits(&[a, b, c]));
        fours += all.iter().filter(|&&d| fits(&[a, b, c, d])).count();
    }
    assert!(threes > 0 && fours == 0);
    // Ours agree in the first bits of the first and third coordinate.
    let net = ScrambledNet::new(4);
    for i in 0..4 {
        let ([x, y], [z, w]) =
            (net.unscrambled(i, 0), net.unscrambled(i, 1));
        assert_eq!([x >> 31, y >> 31], [z >> 31, w >> 31]);
    }
}

/// All triples of elements of a list.
fn triples(all: &[u32]) -> impl Iterator<Item = (&u32, &u32, &u32)> {
    let pairs = all.iter().flat_map(|a| all.iter().map(move |b| (a, b)));
    pairs.flat_map(|(a, b)| all.iter().map(move |c| (a, b, c)))
}

#[test]
fn one_shift_for_all_points_is_worse_than_a_scramble() {
    let (n, scrambles) = (16, 100_000);
    let net = ScrambledNet::new(u64::from(n));
    let (mut scrambled, mut shifted) = (0., 0.);
    let mut random = generator(10, 0, 0);
    for k in 0..scrambles {
        let (key, shift): (_, u32) =
            (scramble_key(10, 0, k.into()), random.random());
        let mean = |x: &dyn Fn(u32) -> u32| {
            (0..n).map(|i| to_unit(x(i))).sum::<f64>() / f64::from(n) - 0.5
        };
        let own = mean(&|i| net.pair(key, i, 1)[1]);
        let common = mean(&|i| net.unscrambled(i, 1)[1] ^ shift);
        scrambled += own * own / f64::from(scrambles);
        shifted += common * common / f64::from(scrambles);
    }
    // The squares of nearly normal and of uniform numbers.
    let (own, common): (f64, f64) = (1. / 12. / 4096., 1. / 12. / 256.);
    assert!((own - 2.0e-5).abs() < 5e-7 && (common - 3.3e-4).abs() < 5e-6);
    near(scrambled, own, 2. * own * own, scrambles);
    near(shifted, common, 0.8 * common * common, scrambles);
}

#[test]
fn sixteen_replicates_of_sixteen_give_the_narrowest_interval() {
    let half_width = |replicates: f64| {
        let law = StudentsT::new(0., 1., replicates - 1.).unwrap();
        law.inverse_cdf(0.975) * replicates.powf(0.25)
    };
    let printed = [
        (2., 15.1, 0.05),
        (4., 4.50, 0.005),
        (8., 3.98, 0.005),
        (16., 4.26, 0.005),
        (64., 5.65, 0.005),
    ];
    for (replicates, width, by) in printed {
        assert!((half_width(replicates) - width).abs() < by);
    }
}
