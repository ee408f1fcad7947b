// A beam enters each box that one of its rays has to enter (chapter
// "Traversal").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::*;

const BEAMS: usize = 50_000;
const REACH: f64 = 8192.;
/// 2^-20 of the reach.
const PADDING: f32 = 1. / 128.;

fn vector(random: &mut Pcg64) -> DVec3 {
    DVec3::from([0; 3].map(|_| 2. * random.random::<f64>() - 1.))
}

/// Rays that start side by side, some of them missing.
fn rays(random: &mut Pcg64) -> [Option<Ray>; BEAM] {
    let scales = [0., 1e-7, 1e-4, 1e-2, 0.2];
    let origin = REACH * vector(random);
    let direction = vector(random);
    let apart = REACH * scales[random.random_range(0..5)];
    let spread = scales[random.random_range(0..5)];
    array::from_fn(|_| {
        let origin = origin + apart * vector(random);
        let bound = DVec3::splat(REACH);
        let origin = origin.clamp(-bound, bound);
        let direction = direction + spread * vector(random);
        let ray = Ray { origin, direction: direction.normalize() };
        (random.random_range(0..8) > 0).then_some(ray)
    })
}

#[test]
fn a_padded_box_around_a_point_of_a_ray_is_entered_by_its_beam() {
    let mut random = Pcg64::seed_from_u64(1);
    let corner = DVec3::splat(REACH);
    let region = Region::between(-corner, corner);
    let (mut beams, mut points, mut missed) = (0, 0, 0);
    while beams < BEAMS {
        let rays = rays(&mut random);
        let mut beam = Beam::default();
        if beam.enclose(&rays, &region).is_none() {
            continue;
        }
        beams += 1;
        // A box around a point of each ray, and another one anywhere.
        for (i, ray) in rays.iter().enumerate() {
            let Some(ray) = ray else { continue };
            let distance = 2. * REACH * random.random::<f64>();
            let point = ray.origin + distance * ray.direction;
            if point.abs().max_element() > REACH {
                continue;
            }
            points += 1;
            let mut node = Node::<16>::EMPTY;
            let mut enclose = |lane: usize, point: DVec3| {
                for axis in 0..3 {
                    let place = point[axis] as f32;
                    node.planes[axis][lane] = place - PADDING;
                    node.planes[axis + 3][lane] = place + PADDING;
                }
            };
            enclose(i, point);
            enclose((i + 1) % 16, REACH * vector(&mut random));
            let keys = beam.enter(&node).into_iter().enumerate();
            let entered = keys.filter(|&(_, key)| key != u32::MAX);
            let entered: u32 = entered.map(|(lane, _)| 1 << lane).sum();
            assert!(entered >> i & 1 != 0, "{point} {ray:?}");
            assert!(entered & !(1 << i | 1 << ((i + 1) % 16)) == 0);
            missed += usize::from(entered == 1 << i);
            assert!(beam.active(&node, i) >> i & 1 != 0, "{point} {ray:?}");
        }
    }
    assert!(points > 3 * BEAMS, "{points} points of {beams} beams");
    assert!(missed > points / 2, "{missed} of {points} boxes aside");
}
