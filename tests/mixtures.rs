// Scenes in which lengths differ by many powers of ten (chapter "Stiff and
// extreme cases").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use crate::extremes::{sized, square};
use litpt_book::escapes::Outside;

#[test]
fn no_path_goes_through_a_closed_surface_over_a_large_plane() {
    solids::all().par_iter().for_each(|solid| {
        for (ratio, seed) in [(1e3, 3), (1e6, 6), (1e9, 9)] {
            let low = solid.over(ratio, 4.);
            let bvh = &Bvh::new(&low.scene).unwrap();
            let (paths, bounces) = (1000, 20);
            let inside = Inside { solid: &low, bvh, seed, paths, bounces };
            assert_eq!(bvh.dispatch(inside), 0, "{} leave", low.name);
            // Above a narrow gap, paths from outside would hardly end.
            let solid = &solid.over(ratio, 4096.);
            let bvh = Bvh::new(&solid.scene).unwrap();
            let outside = Outside { solid, seed, rays: 20_000 };
            assert_eq!(bvh.dispatch(outside), 0, "{} enter", solid.name);
        }
    });
}

/// A ball of radius one at `x` on a plane from -reach to reach.
fn ball(reach: f64, x: f64) -> Mesh {
    let mut mesh = square(reach);
    let place = |p| p + DVec3::new(x, 0., 1.);
    solids::add(&mut mesh, &solids::icosphere(3), place);
    mesh
}

/// The mean radiance of a picture of the ball, and its error.
fn picture(reach: f64, x: f64) -> [f64; 2] {
    let (from, to) = (DVec3::new(x, -5., 2.), DVec3::new(x, 0., 0.8));
    let view = View { up: DVec3::Z, ..look(from, to, 40.) };
    let film = sized(&ball(reach, x), &view, 0.8, (48, 36), 64, 1);
    let Summary { mean, mean_stderr, .. } = film.summary();
    [mean, mean_stderr]
}

/// The pictures have the same random numbers, so that their differences are
/// rather smaller than those of independent ones.
#[test]
fn a_ball_looks_the_same_on_any_plane() {
    let chance = &mut Chance::default();
    let [expected, error] = picture(1e5, 0.);
    for exponent in 6..=11 {
        let reach = 10f64.powi(exponent);
        for x in [0., 0.75 * reach] {
            if exponent == 11 && x > 0. {
                continue; // The same mean, after ten seconds.
            }
            let [mean, own] = picture(reach, x);
            let z = (mean - expected) / error.hypot(own);
            chance.normal(z, &format!("{reach:e} {x}"));
        }
    }
}

/// A prism that stands on a floor of one triangle and leans over it, to the
/// left, with sides of length `side`. Its lower left edge is the y axis.
fn leaning(side: f64) -> Vec<Triangle> {
    let at = |x: f64, y: f64, z: f64| DVec3::new(x, y, z) * side;
    let end = |y: f64| [at(0., y, 0.), at(1., y, 0.), at(-1., y, 1.)];
    let (near, far) = (end(-1.), end(1.));
    let mut triangles = vec![FLOOR, near, far];
    for (i, j) in [(0, 1), (1, 2), (2, 0)] {
        triangles.push([near[i], near[j], far[i]]);
        triangles.push([near[j], far[j], far[i]]);
    }
    triangles
}

const FLOOR: Triangle = [
    DVec3::new(-3. * 4096., -2048., 0.),
    DVec3::new(4096., -4096., 0.),
    DVec3::new(4096., 4096., 0.),
];

/// The prism lies in a nested frame, whose margins do not reach as far as the
/// point above the floor is lifted, 2^-47 of its size: a ray that hits the
/// floor nearer than that to the edge has to be in doubt all the same.
#[test]
fn a_path_does_not_enter_a_small_object_that_leans_over_a_large_one() {
    let lift = 9. / 8. * 3. * 4096. * 2f64.powi(-47);
    for power in 12..=22 {
        let side = 2f64.powi(-power);
        let all = leaning(side);
        let origin = DVec3::new(-0.5, 0., 0.1) * side;
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            for quality in [Quality::FAST, Quality::THOROUGH] {
                let faces = (0..all.len() as u32).collect();
                let triangles = solids::apart(&all, faces);
                let bvh =
                    Bvh::of(triangles, quality, isa, &|_| ()).unwrap();
                for quarters in 1..32 {
                    let beside =
                        lift * 0.5f64.powf(f64::from(quarters) / 4.);
                    let way = DVec3::new(-beside, 0., 0.) - origin;
                    let direction = way.normalize();
                    let ray = Ray { origin, direction };
                    let hit = bvh.first_hit(&ray, None).unwrap();
                    let place = format!("{power} {isa} {quality} {beside}");
                    assert_eq!(bvh.face(hit.primitive), 0, "{place}");
                    // Under the leaning side, and above the floor.
                    let DVec3 { x, z, .. } = hit.point;
                    assert!(0. < z && z < -x, "{place}: {x} {z}");
                }
            }
        }
    }
}
