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
use std::io::{self, ErrorKind, Write};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use litpt::analysis::{Finding, Inquiry, SceneAnalysis};
use litpt::arguments::Arguments;
use litpt::bvh::{Bvh, Quality};
use litpt::camera::Camera;
use litpt::film::Film;
use litpt::progress::{self, Bar};
use litpt::render::renderer;
use litpt::render_loop::{Convergence, Interrupt, Limits, Stop};
use litpt::report::{Report, SceneFacts};
use litpt::run_output::RunOutput;
use litpt::scene::Scene;
use litpt::sky::Sky;

fn main() -> ExitCode {
    let arguments = match Arguments::from_command_line() {
        Ok(arguments) => arguments,
        Err(status) => return status,
    };
    match run(&arguments) {
        // Turn the outcome into a status
        Ok(Stop::Signal(signal)) => ExitCode::from(128 + signal as u8),
        Ok(_) => ExitCode::SUCCESS,
        Err(message) => {
            progress::error(&message);
            ExitCode::FAILURE
        }
    }
}

// Run the whole program once
fn run(arguments: &Arguments) -> Result<Stop, String> {
    let start = Instant::now();
    // Prepare the camera, the sky and the files
    let (width, height) = arguments.resolution;
    let aspect = f64::from(width) / f64::from(height);
    let view = arguments.view();
    let camera = Camera::new(&view, aspect).map_err(|e| e.to_string())?;
    let sky = Sky::new(view.up);
    let outputs = arguments.destinations()?;
    let reports = arguments.reports()?;
    let checkpoint = arguments.checkpoint()?;
    let resumed = arguments.resumed()?;
    let reference = arguments.read_reference()?;
    let seeds = reference.as_ref().and_then(|r| r.attributes.get("seed"));
    let ours = arguments.seed.to_string();
    let shared = |seeds: &String| seeds.split(',').any(|seed| seed == ours);
    if !arguments.quiet && seeds.is_some_and(shared) {
        progress::warn(
            "the reference has the seed of this run: its true errors are \
             larger than they will seem (choose another seed with -s)",
        );
    }
    // Load the scene and leave out what it does not need
    arguments.start_threads()?;
    let loading = Instant::now();
    let (mesh, sha256) = arguments.read_mesh(arguments.keeps_records())?;
    let mut scene = Scene::new(&mesh);
    let triangles = mesh.triangles.len();
    drop(mesh);
    let load_seconds = loading.elapsed().as_secs_f64();
    // Build the hierarchy of what is left
    let building = Instant::now();
    let threads = rayon::current_num_threads();
    let (needed, isa) = (scene.triangles().len(), arguments.isa());
    let quality =
        Quality::expecting(needed, arguments.expected_rays(threads));
    let intersector = Bvh::of(scene.take_triangles(), quality, isa)
        .map_err(|e| e.to_string())?;
    let inquiry = Inquiry {
        camera: &camera,
        sky,
        albedo: arguments.albedo,
        resolution: arguments.resolution,
        kept: arguments.kept(),
    };
    let analysis = SceneAnalysis::find(&scene, &intersector, &inquiry);
    if arguments.explain {
        return explain(&analysis, arguments);
    }
    let renderer =
        renderer(&scene, &intersector, &inquiry, &analysis, arguments.seed);
    let build_seconds = building.elapsed().as_secs_f64();
    // Take up a run or begin one
    let run_key = arguments.run_key(&sha256);
    let mut film = Film::new(width, height);
    let mut convergence = Convergence::default();
    if let Some((name, saved)) = resumed {
        convergence = saved
            .resume(&run_key, &mut film)
            .map_err(|fault| format!("{name}: {fault}"))?;
        // Warn if there is nothing left to do
        let enough =
            arguments.samples().is_some_and(|n| convergence.spp >= n);
        if enough && !arguments.quiet {
            let spp = convergence.spp;
            progress::warn(&format!(
                "{name}: holds {spp} samples already (ask for more with -n)"
            ));
        }
    }
    let file = arguments.input_name();
    let scene_facts =
        SceneFacts { file, sha256, triangles: triangles as u64 };
    let mut settings = arguments.settings(&run_key);
    settings.insert("hierarchy".into(), quality.to_string().into());
    let known = Report {
        scene: scene_facts,
        settings,
        left_out: analysis.left_out().cloned().collect(),
        load_seconds,
        build_seconds,
        program: concat!("pt ", env!("CARGO_PKG_VERSION")).to_owned(),
        ..Report::default()
    };
    let every = Duration::try_from_secs_f64(arguments.every)
        .unwrap_or(Duration::MAX);
    let mut run_output =
        RunOutput::new(reports, checkpoint, every, run_key, known);
    // Render until a limit is reached
    let interrupt = Interrupt::listen()
        .map_err(|e| format!("cannot listen for signals: {e}"))?;
    let mut limits = Limits {
        samples: analysis.samples(arguments.samples()),
        deadline: arguments.deadline(start),
        error: arguments.error,
        interrupt: &interrupt,
        reference: reference.as_ref().map(|image| &image.means[..]),
    };
    // Show the bar and call the journal
    let area = film.area();
    let paths = |spp: u64| spp.saturating_mul(area);
    let bar = Bar::new(!arguments.quiet, paths(convergence.spp));
    let advance = |paths| bar.advance(paths);
    let go_on = |convergence: &mut Convergence,
                 film: &mut Film,
                 limits: &Limits,
                 run_output: &mut RunOutput| {
        bar.expect(
            paths(convergence.expected(limits, area)),
            convergence.to_string(),
        );
        let mut after = |convergence: &Convergence, film: &Film| {
            // Tell the bar and the journal
            let expected = convergence.expected(limits, area);
            bar.expect(paths(expected), convergence.to_string());
            let written = run_output.after(convergence, film);
            if let (Err(message), false) = (written, arguments.quiet) {
                bar.suspend(|| progress::warn(&message));
            }
        };
        convergence.run(&*renderer, film, limits, &advance, &mut after)
    };
    if let Some(deadline) = limits.deadline {
        let samples = limits.samples;
        let one_more = convergence.spp + 1;
        limits.samples =
            Some(samples.map_or(one_more, |n| n.min(one_more)));
        go_on(&mut convergence, &mut film, &limits, &mut run_output);
        limits.samples = samples;
        if interrupt.signal().is_none() {
            // Keep the time for writing in reserve
            let began = Instant::now();
            let image = run_output.rehearse(&convergence, &film);
            outputs.iter().for_each(|output| output.rehearse(&image));
            let end = deadline.checked_sub(began.elapsed());
            limits.deadline = end.or(limits.deadline);
        }
        // Warn if the time is over already
        if Instant::now() > deadline && !arguments.quiet {
            progress::warn(
                "one sample of each pixel took longer than --time allows",
            );
        }
    }
    let stop = go_on(&mut convergence, &mut film, &limits, &mut run_output);
    bar.finish();
    // Write the image and the summary
    let image = run_output.image(&convergence, &film, Some(stop));
    let written = outputs.iter().map(|output| output.write(&image));
    let mut written: Vec<_> = written.collect();
    written.push(run_output.close(&convergence, &film, stop));
    let failures: Vec<_> =
        written.into_iter().filter_map(Result::err).collect();
    if !failures.is_empty() {
        return Err(failures.join("; "));
    }
    if !arguments.quiet {
        let report = run_output.report(&convergence, &film, Some(stop));
        progress::summarise(&report, area);
    }
    Ok(stop)
}

/// Tells what can be left out, and what the rest is made of.
fn explain(
    analysis: &SceneAnalysis,
    arguments: &Arguments,
) -> Result<Stop, String> {
    let mut words = String::new();
    for Finding { fact, holds, why } in &analysis.findings {
        let sign = if *holds { "left out" } else { "-" };
        words += &format!("{fact:13}{sign:10}{why}\n");
    }
    let parts = analysis.parts(arguments.isa());
    words += &format!("{:13}{parts}\n", "intersector");
    let mut out = io::stdout().lock();
    match out.write_all(words.as_bytes()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => {
            Err(format!("cannot write: {e}"))
        }
        _ => Ok(Stop::Realisations),
    }
}
