// Renders an OBJ from above and writes a greymap:
// cargo run --release --example render -- FILE.obj > image.pgm
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::BTreeMap;
use std::error::Error;

use glam::DVec3;
use litpt::analysis::background::KnownPixels;
use litpt::bvh::Bvh;
use litpt::camera::{Camera, View};
use litpt::film::Film;
use litpt::image::{Format, Picture};
use litpt::integrator::PathTracer;
use litpt::materials::Surfaces;
use litpt::render::{Job, Renderer};
use litpt::sampler::IndependentSampler;
use litpt::scene::{Scene, read_obj};
use litpt::sensor::Sensor;
use litpt::sky::Sky;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: render FILE.obj")?;
    let scene = &Scene::new(&read_obj(&std::fs::read(path)?)?);
    let intersector = &Bvh::new(scene)?;
    let position = DVec3::new(6., 4., 3.);
    let view =
        View { position, target: DVec3::ZERO, up: DVec3::Z, fov: 60. };
    let camera = Camera::new(&view, 4. / 3.)?;
    let sensor = &Sensor::Camera(camera, scene.frame.entrance(position));
    let sky = Sky::new(view.up);
    let integrator = PathTracer::new(Surfaces::of(0.8), sky);
    let known_pixels = KnownPixels::NOTHING;
    let sampler = IndependentSampler::new(0);
    let mut job =
        Job { sensor, intersector, integrator, known_pixels, sampler };
    let mut film = Film::new(320, 240);
    job.pass(&mut film, 64, &|_| true);
    let (film, allocation) = (&film, None);
    let (more, attributes) = (vec![], BTreeMap::new());
    let picture = Picture { film, allocation, more, attributes };
    Ok(Format::Pgm.write(&picture, &mut std::io::stdout().lock())?)
}
