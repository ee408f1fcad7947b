// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command `pt`: parse the arguments, render, report.

// Name what the program imports
use std::process::ExitCode;

use litpt::arguments::Arguments;
use litpt::camera::Camera;
use litpt::estimator::Reference;
use litpt::hierarchy::Cwbvh;
use litpt::image::Image;
use litpt::progress::{self, Bar, Timings};
use litpt::render::Job;
use litpt::scene::Scene;
use litpt::sky::Sky;

fn main() -> ExitCode {
    let arguments = match Arguments::from_command_line() {
        Ok(arguments) => arguments,
        Err(status) => return status,
    };
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            progress::error(&message);
            ExitCode::FAILURE
        }
    }
}

// Run the whole program once
fn run(arguments: &Arguments) -> Result<(), String> {
    // Prepare the camera, the sky and the outputs
    let (width, height) = arguments.definition;
    let aspect = f64::from(width) / f64::from(height);
    let view = arguments.view();
    let camera = Camera::new(&view, aspect).map_err(|e| e.to_string())?;
    let sky = Sky::new(view.up);
    let outputs = arguments.destinations()?;
    // Load the scene and build its hierarchy
    arguments.start_threads()?;
    let mut timings = Timings::start();
    let mesh = arguments.read_mesh()?;
    let scene = Scene::new(&mesh);
    let flat = mesh.triangles.len() - scene.triangles().len();
    drop(mesh);
    timings.loaded();
    if flat > 0 && !arguments.quiet {
        progress::warn(&format!("left out {flat} triangles without area"));
    }
    let kernel = Cwbvh::new(&scene);
    timings.built();
    // Render all the realisations of the image
    let reflectivity = arguments.reflectivity;
    let estimator = Reference { reflectivity, sky };
    let job = Job {
        scene: &scene,
        kernel: &kernel,
        camera: &camera,
        estimator: &estimator,
        seed: arguments.seed,
    };
    let mut image = Image::new(width, height);
    let realisations = arguments.realisations;
    let bar = Bar::new(!arguments.quiet, image.area(), realisations);
    let rays = job.pass(&mut image, 0..realisations, &|n| bar.advance(n));
    bar.finish();
    timings.rendered();
    // Write the image and the summary
    let written: Vec<_> = outputs.iter().map(|o| o.write(&image)).collect();
    written.into_iter().collect::<Result<(), String>>()?;
    if !arguments.quiet {
        let triangles = scene.triangles().len();
        timings.summarise(triangles, rays, &image);
    }
    Ok(())
}
