// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The path tracer of the first chapter, and the program beside it.

use crate::prelude::*;
use litpt::compare::compare;
use litpt::run::Run;
use program::{HEIGHT, WIDTH};

#[allow(dead_code)]
#[path = "../examples/tiny.rs"]
mod program;

/// An image of an OBJ by both, from a position to a target.
fn both(source: &str, position: [f64; 3], target: [f64; 3]) -> [Image; 2] {
    let camera = program::Camera::new(position, target);
    let pixels =
        program::render(&program::read(source).unwrap(), &camera, 64);
    let (means, errors) = pixels.into_iter().unzip();
    let size = (WIDTH as u32, HEIGHT as u32);
    let plain = Image::plain(size.0, size.1, means);
    let samples = Some(vec![64.; WIDTH * HEIGHT]);
    let theirs = Image { errors: Some(errors), samples, ..plain };
    let stand = Stand::At(position.into(), target.into());
    let camera =
        CameraPlan { resolution: size, stand, ..CameraPlan::default() };
    let mut plan = Plan {
        sensor: SensorPlan::Camera(camera),
        budget: Budget::samples(256),
        method: Some(Method::Reference),
        ..Plan::default()
    };
    plan.surfaces.albedo = 0.5;
    let mesh = read_obj(source.as_bytes()).unwrap();
    let world = World::new(&plan, mesh.into(), Host::default()).unwrap();
    let run = Run::new(&world, &plan, Host::default()).unwrap();
    [theirs, run.render(&Interrupt::default()).unwrap().image()]
}

const PYRAMID: &str = "v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0\n\
    v 0 -2 0\nv 2 1 0\nv -2 1 0\nv 0 0 3\n\
    f 1 2 3 4\nf 5/1 6/2 8/3\nf -3 -2 -1\nf 7//1 5//1 8//1\n";

/// The means agree within their errors; another albedo would be seen.
#[test]
fn tiny_agrees_with_the_reference_in_three_scenes() {
    let room = include_str!("../doc/examples/room.obj");
    let terrace = include_str!("../doc/examples/terrace.obj");
    let images = [
        both(PYRAMID, [5., -6., 4.], [0., 0., 1.]),
        both(room, [5.5, 2., 1.6], [0., 2., 1.2]),
        both(terrace, [5., 0.2, 2.6], [2.2, 2.5, 0.55]),
    ];
    for [theirs, ours] in images {
        let difference = compare(&theirs, &ours).unwrap();
        assert!(difference.consistent(), "{:?}", difference.failed());
        let darker = ours.means.iter().map(|it| 0.99 * it).collect();
        let darker = Image { means: darker, ..ours };
        assert!(!compare(&theirs, &darker).unwrap().consistent());
    }
}

/// What is no scene is refused, and the camera that nobody has placed sees
/// all of one.
#[test]
fn tiny_reads_faces_and_stands_outside() {
    let triangles = program::read(PYRAMID).unwrap();
    assert_eq!(triangles.len(), 5);
    assert_eq!(triangles[3], [[2., 1., 0.], [-2., 1., 0.], [0., 0., 3.]]);
    for fault in ["v 1 2 x", "v 0 0 0\nf 1 2 3", "f 0 0 0", "f -1 -1 -1"] {
        assert!(program::read(fault).is_err(), "{fault}");
    }
    let pixels =
        program::render(&triangles, &program::outside(&triangles), 2);
    let is_sky = |i: usize| [(1., 0.), (0., 0.)].contains(&pixels[i]);
    let (top, left) = (0..WIDTH, (0..HEIGHT).map(|y| y * WIDTH));
    assert!(top.chain(left).all(is_sky));
    assert!(pixels.iter().any(|it| it.0 == 0.5));
}
