//! The corridor, the back room and the furnished room: closed solids, no
//! light but through the opening, and in the corridor none after fewer than
//! three reflections.
//!
//! Copyright (C) 2026 litpt contributors
//! SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::HashMap;

use glam::DVec3;
use litpt::analysis::background::KnownPixels;
use litpt::bvh::{Bvh, Hit};
use litpt::camera::{Camera, View};
use litpt::film::Film;
use litpt::integrator::{Integrator, PathEvent, PathState, PathTracer};
use litpt::materials::Surfaces;
use litpt::render::{Job, Renderer};
use litpt::sampler::{IndependentSampler, Sampler};
use litpt::scene::{Mesh, Scene};
use litpt::sensor::Sensor;
use litpt::sky::Sky;
use litpt_book::interiors::Interior;
use litpt_book::solids::winding;
use litpt_book::sweep::Solid;

const NAMES: [&str; 3] = ["corridor", "backroom", "room"];

fn named(name: &str) -> Interior {
    Interior::named(name).unwrap()
}

/// Albedo 1 for so many reflections, then 0.
struct Limited {
    tracer: PathTracer<'static>,
    most: u64,
}

impl Integrator for Limited {
    type Path = (PathState, u64);

    fn begin(&self, direction: DVec3, throughput: f64) -> Self::Path {
        (self.tracer.begin(direction, throughput), 0)
    }

    fn advance(
        &self,
        (path, reflections): &mut Self::Path,
        hit: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        let event = self.tracer.advance(path, hit, sampler);
        *reflections += u64::from(matches!(event, PathEvent::Scatter(..)));
        match *reflections > self.most {
            true => PathEvent::Terminate(0.),
            false => event,
        }
    }
}

/// The mean of an image whose paths have at most so many reflections.
fn mean(mesh: &Mesh, view: &View, most: u64, n: u64) -> f64 {
    let scene = &Scene::new(mesh);
    let intersector = &Bvh::new(scene).unwrap();
    let camera = Camera::new(view, 4. / 3.).unwrap();
    let tracer = PathTracer::new(Surfaces::of(1.), Sky::new(view.up));
    let integrator = Limited { tracer, most };
    let known_pixels = KnownPixels::NOTHING;
    let entrance = scene.frame.entrance(view.position);
    let sensor = &Sensor::Camera(camera, entrance);
    let sampler = IndependentSampler::new(0);
    let mut film = Film::new(16, 12);
    Job { sensor, intersector, integrator, known_pixels, sampler }.pass(
        &mut film,
        n,
        &|_| true,
    );
    film.means().sum::<f64>() / film.area() as f64
}

/// Six times the volume; positive if it is seen from outside.
fn volume(solid: &Solid) -> f64 {
    let corner = |i: u32| DVec3::from_array(solid.vertices[i as usize]);
    let parts = solid.triangles.iter().map(|t| {
        let [a, b, c] = t.map(corner);
        a.dot(b.cross(c))
    });
    parts.sum()
}

#[test]
fn each_solid_is_closed_and_looks_outwards() {
    for name in NAMES {
        for (i, solid) in named(name).solids.iter().enumerate() {
            let mut edges = HashMap::new();
            for &[a, b, c] in &solid.triangles {
                for [a, b] in [[a, b], [b, c], [c, a]] {
                    *edges.entry([a, b]).or_insert(0) += 1;
                }
            }
            for ([a, b], count) in &edges {
                let back = edges.get(&[*b, *a]);
                assert_eq!((1, Some(&1)), (*count, back), "{name} {i}");
            }
            assert!(volume(solid) > 0., "{name} {i}");
        }
    }
}

#[test]
fn two_have_some_ten_thousand_triangles() {
    for name in ["corridor", "backroom"] {
        let count = named(name).mesh().triangles.len();
        assert!((8_000..20_000).contains(&count), "{name}: {count}");
    }
}

#[test]
fn light_comes_through_the_opening_and_nowhere_else() {
    for name in NAMES {
        let interior = named(name);
        let view = interior.view;
        let open = mean(&interior.mesh(), &view, 100, 64);
        assert!(open > 0.01, "{name}: {open}");
        let closed = mean(&interior.closed(), &view, 100, 64);
        assert_eq!(0., closed, "{name}");
    }
}

#[test]
fn light_in_the_corridor_needs_three_reflections() {
    let Interior { view, .. } = named("corridor");
    let mesh = named("corridor").mesh();
    assert_eq!(0., mean(&mesh, &view, 2, 4096));
    assert!(mean(&mesh, &view, 3, 4096) > 0.);
}

#[test]
fn the_camera_of_the_room_is_between_the_solids_and_sees_the_sky() {
    let Interior { view, solids, .. } = named("room");
    for solid in solids {
        let corner = |i: u32| DVec3::from_array(solid.vertices[i as usize]);
        let triangles: Vec<_> =
            solid.triangles.iter().map(|t| t.map(corner)).collect();
        let around = winding(&triangles, view.position);
        assert!(around.abs() < 1e-9, "{}: {around}", solid.name);
    }
    let share = mean(&named("room").mesh(), &view, 0, 64);
    assert!((0.01..0.05).contains(&share), "{share}");
}
