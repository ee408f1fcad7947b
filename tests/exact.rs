// Scenes whose answer can be written down (chapter "Tests").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use crate::extremes::sized;

fn inside() -> View {
    look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 20.)
}

#[test]
fn every_closed_form_is_met() {
    let chance = &mut Chance::default();
    let (mut judged, mut certain) = (0, 0);
    for (form, seed) in closed_forms().iter().zip((1000..).step_by(10)) {
        for outcome in form.outcomes(10_000, seed).unwrap() {
            let (pixel, exact) = (&outcome.pixel, outcome.exact);
            let place = format!("{}, rho = {}", form.name, outcome.rho);
            if outcome.is_certain() {
                let found = (pixel.mean(), pixel.variance());
                assert_eq!(found, (exact, 0.), "{place}");
                certain += 1;
            } else {
                chance.normal(outcome.z(), &place);
                judged += 1;
            }
        }
    }
    assert_eq!((judged, certain), (79, 59));
}

// The integrand has a kink at theta, hence the two parts.
#[test]
fn the_radiance_of_a_trough_solves_its_integral_equation() {
    for a in [0.3, 1.5, 2.5, 3.1] {
        for rho in [0.2, 0.9, 0.999, 1.] {
            for theta in [0., 0.3 * a, -0.8 * a, a] {
                let arriving = |other: f64| {
                    let intersector =
                        ((theta - other) / 2.).sin().abs() / 4.;
                    intersector * trough_radiance(rho, a, other)
                };
                let walls = integral(arriving, -a, theta)
                    + integral(arriving, theta, a);
                let sky = (a / 2.).cos() * (theta / 2.).cos();
                let error =
                    rho * (sky + walls) - trough_radiance(rho, a, theta);
                assert!(error.abs() < 1e-12, "{a} {rho} {theta}: {error}");
            }
        }
    }
}

/// The integral of `f` from `a` to `b`, by Simpson's rule.
fn integral(f: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
    const HALVES: u32 = 2000;
    let step = (b - a) / f64::from(HALVES);
    let weight = |i| match i {
        0 | HALVES => 1.,
        i if i % 2 == 1 => 4.,
        _ => 2.,
    };
    let terms =
        (0..=HALVES).map(|i| weight(i) * f(a + step * f64::from(i)));
    terms.sum::<f64>() * step / 3.
}

// The view factor of a rectangle from below one of its corners, which books
// on heat transfer give.
#[test]
fn the_share_of_a_rectangle_is_that_of_the_books() {
    let (height, x, y) = (3., 2., 5.);
    let corner = |x, y| DVec3::new(x, y, height);
    let rectangle =
        [corner(0., 0.), corner(x, 0.), corner(x, y), corner(0., y)];
    let (a, b): (f64, f64) = (x / height, y / height);
    let part = |a: f64, b: f64| {
        let c = (1. + a * a).sqrt();
        a / c * (b / c).atan()
    };
    let expected = (part(a, b) + part(b, a)) / std::f64::consts::TAU;
    let share = polygon_share(DVec3::ZERO, DVec3::Z, &rectangle);
    assert!((share - expected).abs() < 1e-15, "{share} {expected}");
}

/// Below a plane it is dark, and paths in a closed white cavity end: the first
/// of its rings is a point, like the last.
#[test]
fn certain_radiances_have_no_variance() {
    let below = look(-DVec3::Z, DVec3::ZERO, 20.);
    for (mesh, rho, view, samples, exact) in [
        (plane(), 1., below, 1000, 0.),
        (cavity(0., 16), 1., inside(), 20, 0.),
    ] {
        let pixel = pixel(&mesh, rho, &view, samples).unwrap();
        assert_eq!((pixel.mean(), pixel.variance()), (exact, 0.));
    }
}

#[test]
fn without_a_scene_the_sky_is_one_above_and_zero_below() {
    // Without area there is none.
    let triangles = vec![[0, 0, 1], [2, 2, 2]];
    let flat = Mesh { triangles, ..plane() };
    let ups = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    for (up, mesh) in ups.zip([Mesh::default(), flat].iter().cycle()) {
        let target = if up.x == 0. { DVec3::X } else { DVec3::Y };
        let view = View { position: DVec3::ZERO, target, up, fov: 70. };
        let film = sized(mesh, &view, 0.5, (40, 30), 3, 0);
        for (i, mean) in film.means().enumerate() {
            assert_eq!(mean, if i < 600 { 1. } else { 0. }, "{up} {i}");
        }
    }
}
