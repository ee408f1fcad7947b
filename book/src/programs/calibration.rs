// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Prints the tables of the book on errors, as LaTeX rows.

// Name what the calibration imports
use std::error::Error;
use std::fmt::{self, Write};
use std::path::Path;

use glam::DVec3;
use litpt::analysis::background::KnownPixels;
use litpt::bvh::{Bvh, Hit};
use litpt::camera::{Camera, View};
use litpt::film::{Film, WORTH};
use litpt::integrator::{Integrator, PathEvent};
use litpt::render::{Job, Renderer};
use litpt::render_loop::{Convergence, CurvePoint, Interrupt, Limits};
use litpt::report::Fit;
use litpt::sampler::{IndependentSampler, Sampler, dimension, generator};
use litpt::scene::{Mesh, Scene};
use litpt::statistics::Accumulator;
use litpt_book::closed_forms::{Setting, cavity, cavity_radiance};
use litpt_book::courtyard;
use rand::RngExt;
use rayon::prelude::*;

use super::Done;

// Write one file for each table
pub fn run(arguments: &[String]) -> Done {
    let directory = arguments.first();
    let directory = directory.ok_or("usage: calibration DIRECTORY")?;
    let cases = cases()?;
    let tables = [
        ("coverage.tex", coverage(&cases)?),
        ("unseen.tex", unseen(&cases)?),
        ("slopes.tex", slopes(&cases)?),
        ("stopping.tex", stopping()?),
    ];
    for (name, rows) in tables {
        std::fs::write(Path::new(directory).join(name), rows)?;
    }
    Ok(())
}

// Choose four scenes to try
const WIDTH: u32 = 32;
const HEIGHT: u32 = 24;

/// A scene, with the radiance of each pixel and its standard error.
struct Case {
    name: &'static str,
    setting: Setting,
    truth: Vec<(f64, f64)>,
}

fn cases() -> Result<Vec<Case>, Box<dyn Error>> {
    let mut cases = vec![];
    // Add two cavities of known radiance
    for (name, f, rho) in
        [("wide cavity", 0.5, 0.9), ("narrow cavity", 0.05, 0.5)]
    {
        let view = look([0., 0., 0.], [0.3, 0.2, -1.], DVec3::Y, 20.);
        let setting = set(&cavity(f, 128), rho, DVec3::Z, &view)?;
        let truth = exactly(cavity_radiance(rho, f));
        cases.push(Case { name, setting, truth });
    }
    // Add a floor that meets a wall
    let view = look([2., 0., 1.], [0., 0., 0.], DVec3::Z, 70.);
    let setting = set(&corner(), 0.8, DVec3::Z, &view)?;
    let truth = exactly(2. / 3.);
    cases.push(Case { name: "floor and wall", setting, truth });
    // Add the courtyard with a reference
    let setting =
        set(&courtyard::mesh(), 0.8, DVec3::Y, &courtyard::view())?;
    let mut film = Film::new(WIDTH, HEIGHT);
    setting.job(99).pass(&mut film, 4096, &|_| true);
    let truth = film.means().zip(film.errors(0.)).collect();
    cases.push(Case { name: "courtyard", setting, truth });
    Ok(cases)
}

fn look(from: [f64; 3], to: [f64; 3], up: DVec3, fov: f64) -> View {
    View { position: from.into(), target: to.into(), up, fov }
}

fn set(
    mesh: &Mesh,
    rho: f64,
    up: DVec3,
    view: &View,
) -> Result<Setting, Box<dyn Error>> {
    let aspect = f64::from(WIDTH) / f64::from(HEIGHT);
    Setting::new(mesh, (rho, up), view, aspect)
}

/// A floor at z = 0 and a wall at x = 0.
fn corner() -> Mesh {
    let far = 1e6;
    let corner = |x, y, z| DVec3::new(x * far, y * far, z * far);
    Mesh {
        vertices: vec![
            corner(0., -1., 0.),
            corner(0., 1., 0.),
            corner(1., 1., 0.),
            corner(1., -1., 0.),
            corner(0., 1., 1.),
            corner(0., -1., 1.),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3], [0, 1, 4], [0, 4, 5]],
        joined: vec![],
    }
}

/// The same truth for each pixel.
fn exactly(radiance: f64) -> Vec<(f64, f64)> {
    vec![(radiance, 0.); (WIDTH * HEIGHT) as usize]
}

// Tabulate how often the truth is covered
fn coverage(cases: &[Case]) -> Result<String, fmt::Error> {
    let mut rows = String::new();
    for Case { name, setting, truth } in cases {
        let mut images = [(); 4].map(|_| Film::new(WIDTH, HEIGHT));
        for n in [16, 64, 256, 1024] {
            let mut z = vec![];
            for (seed, film) in (1..).zip(&mut images) {
                setting.job(seed).pass(film, n, &|_| true);
                z.extend(deviations(film, truth, WORTH));
            }
            // Print a row of coverage
            let share = |bound: f64| {
                let within = z.iter().filter(|z| z.abs() <= bound).count();
                100. * within as f64 / z.len() as f64
            };
            writeln!(
                rows,
                r"{name} & {n} & {:.3} & {:.1} & {:.1} & {:.2} \\",
                deviation(&z),
                share(1.),
                share(1.96),
                share(3.)
            )?;
        }
    }
    Ok(rows)
}

/// By how many standard errors the pixels miss the truth, of those that
/// miss it at all.
fn deviations(film: &Film, truth: &[(f64, f64)], worth: f64) -> Vec<f64> {
    let errors = film.errors(worth);
    let pixels = film.means().zip(errors).zip(truth);
    let deviations = pixels.map(|((mean, error), (exact, unsure))| {
        (mean - exact) / (error * error + unsure * unsure).sqrt()
    });
    deviations.filter(|z| !z.is_nan() && *z != 0.).collect()
}

/// The root of the mean square.
fn deviation(z: &[f64]) -> f64 {
    let squares: f64 = z.iter().map(|z| z * z).sum();
    (squares / z.len() as f64).sqrt()
}

// Tabulate what a pixel has not seen
fn unseen(cases: &[Case]) -> Result<String, fmt::Error> {
    let mut rows = String::new();
    for Case { name, setting, truth } in cases {
        let mut images = [(); 4].map(|_| Film::new(WIDTH, HEIGHT));
        for n in [4, 16, 64] {
            for (seed, film) in (1..).zip(&mut images) {
                setting.job(seed).pass(film, n, &|_| true);
            }
            // Print a row on the unseen
            write!(rows, "{name} & {n}")?;
            for worth in [0., 1., 2., 4., 8.] {
                let z =
                    images.iter().flat_map(|i| deviations(i, truth, worth));
                let (z, blind): (Vec<f64>, Vec<f64>) =
                    z.partition(|z| z.is_finite());
                // Print the share of blind pixels
                if worth == 0. {
                    let pixels = z.len() + blind.len();
                    let share = 100. * blind.len() as f64 / pixels as f64;
                    write!(rows, " & {share:.1}")?;
                }
                write!(rows, " & {:.2}", deviation(&z))?;
            }
            writeln!(rows, r" \\")?;
        }
    }
    Ok(rows)
}

// Tabulate how the error falls
fn slopes(cases: &[Case]) -> Result<String, fmt::Error> {
    let mut rows = String::new();
    for Case { name, setting, truth } in cases {
        let truth: Vec<f64> = truth.iter().map(|t| t.0).collect();
        // Stop after a thousand samples
        let limits = Limits {
            samples: Some(1000),
            deadline: None,
            error: None,
            interrupt: &Interrupt::default(),
            reference: Some(&truth),
        };
        let mut film = Film::new(WIDTH, HEIGHT);
        let mut convergence = Convergence::default();
        let mut job = setting.job(1);
        convergence.run(
            &mut job,
            &mut film,
            &limits,
            &|_| (),
            &mut |_, _| (),
        );
        // Print a row of slopes
        let slope = |error: fn(&CurvePoint) -> Option<f64>| {
            let steps =
                convergence.steps.iter().filter(|step| step.spp >= 8);
            let points =
                steps.filter_map(|s| Some((s.spp as f64, error(s)?)));
            match Fit::of(&points.collect::<Vec<_>>()) {
                Some(Fit { slope, stderr }) => {
                    format!(r"${slope:.3}\pm{stderr:.3}$")
                }
                None => "---".to_owned(),
            }
        };
        let (estimated, real) =
            (slope(|s| s.rmse), slope(|s| s.rmse_reference));
        writeln!(rows, r"{name} & {estimated} & {real} \\")?;
    }
    Ok(rows)
}

// Tabulate what the limit of error does
/// Contributes 1 with probability `P`, else 0.
struct Coin;

const P: f64 = 0.05;

impl Integrator for Coin {
    type Path = ();
    type RayQuery = Hit;
    type Sums = u64;

    fn count(&self, _: &(), rays: u64, _: f64, sums: &mut u64) {
        *sums += rays;
    }

    fn begin(&self, _: DVec3) {}

    // Throw the coin and end
    fn go_on(
        &self,
        _: &mut (),
        _: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        let u = sampler.get_1d(dimension::roulette(0));
        PathEvent::Terminate(f64::from(u < P))
    }
}

fn stopping() -> Result<String, fmt::Error> {
    let mut rows = String::new();
    // Stop by the natural rule
    let naive = |seed| {
        let (mut pixel, mut n) = (Accumulator::default(), 0);
        while n < 2 || pixel.standard_error() > 0.02 {
            let mut random = generator(seed, 0, n);
            pixel.add(f64::from(random.random::<f64>() < P));
            n += 1;
        }
        (pixel.mean(), n)
    };
    row(&mut rows, "natural, $P=1$", 0.02, 1, naive)?;
    let settings = [(0.02, 1), (0.005, 1), (0.02, 8)];
    for (error, side) in settings {
        let name = format!("ours, $P={}$", side * side);
        let run = |seed| stopped(seed, error, side);
        row(&mut rows, &name, error, side, run)?;
    }
    Ok(rows)
}

/// The mean of a run of coins that is stopped by its error, and its
/// number of samples.
fn stopped(seed: u64, error: f64, side: u32) -> (f64, u64) {
    let nothing =
        Mesh { vertices: vec![], triangles: vec![], joined: vec![] };
    let scene = Scene::new(&nothing);
    let Ok(intersector) = Bvh::new(&scene) else { return (0., 0) };
    let view = look([0.; 3], [0., 1., 0.], DVec3::Z, 70.);
    let Ok(camera) = Camera::new(&view, 1.) else { return (0., 0) };
    // Make a job of throwing coins
    let mut job = Job {
        scene: &scene,
        intersector: &intersector,
        camera: &camera,
        integrator: &Coin,
        known: &KnownPixels::Nothing,
        sampler: IndependentSampler::new(seed),
    };
    // Stop at the error alone
    let limits = Limits {
        samples: None,
        deadline: None,
        error: Some(error),
        interrupt: &Interrupt::default(),
        reference: None,
    };
    let mut film = Film::new(side, side);
    let mut convergence = Convergence::default();
    convergence.run(&mut job, &mut film, &limits, &|_| (), &mut |_, _| ());
    (film.summary().mean, convergence.spp)
}

fn row(
    rows: &mut String,
    name: &str,
    error: f64,
    side: u32,
    run: impl Fn(u64) -> (f64, u64) + Send + Sync,
) -> fmt::Result {
    const RUNS: u64 = 20_000;
    let runs: Vec<_> = (0..RUNS).into_par_iter().map(run).collect();
    let mut means = Accumulator::default();
    runs.iter().for_each(|&(mean, _)| means.add(mean));
    let n = runs.iter().map(|&(_, n)| n).sum::<u64>() as f64 / RUNS as f64;
    // Print the bias of the runs
    let bias = means.mean() - P;
    let stated = (P * (1. - P) / n).sqrt() / f64::from(side);
    writeln!(
        rows,
        r"{name} & {error} & {n:.0} & ${bias:+.5}\pm{:.5}$ & ${:+.3}$ \\",
        means.standard_error(),
        bias / stated
    )
}
