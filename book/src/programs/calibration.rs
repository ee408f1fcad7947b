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
use litpt::analysis::{Inquiry, SceneAnalysis};
use litpt::bvh::{Bvh, Hit};
use litpt::camera::{Camera, View};
use litpt::film::{Film, Summary, WORTH, Window};
use litpt::integrator::{Integrator, PathEvent, PathTracer};
use litpt::render::choose::{Method, Request, Sampling, Setup};
use litpt::render::{Job, Renderer};
use litpt::render_loop::{Convergence, Interrupt, Limits};
use litpt::sampler::{IndependentSampler, Sampler, dimension, generator};
use litpt::scene::{Mesh, Scene};
use litpt::statistics::Accumulator;
use litpt_book::closed_forms::{Setting, cavity, cavity_radiance};
use litpt_book::courtyard;
use litpt_book::interiors::Interior;
use rand::RngExt;
use rayon::prelude::*;

use super::Done;

// Write one file for each table
pub fn run(arguments: &[String]) -> Done {
    let directory = arguments.first();
    let directory = directory.ok_or("usage: calibration DIRECTORY")?;
    let cases = cases()?;
    let [coverage, means] = coverage(cases.iter().chain([&room()?]))?;
    let tables = [
        ("coverage.tex", coverage),
        ("means.tex", means),
        ("unseen.tex", unseen(&cases)?),
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

/// A scene, with the radiance of each pixel and of the image, and their
/// standard errors.
struct Case {
    name: &'static str,
    setting: Setting,
    truth: Vec<(f64, f64)>,
    mean: (f64, f64),
}

// Make a case of what is known
impl Case {
    /// Each pixel has the same radiance, which is known.
    fn known(name: &'static str, setting: Setting, radiance: f64) -> Self {
        let mean = (radiance, 0.);
        let truth = vec![mean; (WIDTH * HEIGHT) as usize];
        Self { name, setting, truth, mean }
    }

    /// An image stands for the truth.
    fn measured(name: &'static str, setting: Setting, film: &Film) -> Self {
        let truth = film.means().zip(film.errors(WORTH)).collect();
        let summary = film.summary();
        let mean = (summary.mean, summary.mean_stderr);
        Self { name, setting, truth, mean }
    }
}

fn cases() -> Result<Vec<Case>, Box<dyn Error>> {
    let mut cases = vec![];
    // Add two cavities of known radiance
    for (name, f, rho) in
        [("wide cavity", 0.5, 0.9), ("narrow cavity", 0.05, 0.5)]
    {
        let view = look([0., 0., 0.], [0.3, 0.2, -1.], DVec3::Y, 20.);
        let setting = set(&cavity(f, 128), rho, DVec3::Z, &view)?;
        cases.push(Case::known(name, setting, cavity_radiance(rho, f)));
    }
    // Add a floor that meets a wall
    let view = look([2., 0., 1.], [0., 0., 0.], DVec3::Z, 70.);
    let setting = set(&corner(), 0.8, DVec3::Z, &view)?;
    cases.push(Case::known("floor and wall", setting, 2. / 3.));
    // Add the courtyard with a reference
    let setting =
        set(&courtyard::mesh(), 0.8, DVec3::Y, &courtyard::view())?;
    let film = image(&setting, Method::Reference, 99, 4096);
    cases.push(Case::measured("courtyard", setting, &film));
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

// Render a case by a method
/// An image of `n` samples.
fn image(setting: &Setting, method: Method, seed: u64, n: u64) -> Film {
    let resolution = (WIDTH, HEIGHT);
    let area = u64::from(WIDTH * HEIGHT);
    // Know nothing of the image beforehand
    let Job { scene, intersector, camera, integrator, .. } =
        setting.job(seed);
    let PathTracer { albedo, sky, .. } = integrator;
    let inquiry = Inquiry { camera, sky, albedo, resolution, kept: &[] };
    let known = KnownPixels::Nothing;
    let analysis =
        SceneAnalysis { findings: vec![], known, is_black: false };
    let window = Window { corner: (0, 0), size: resolution };
    // Sample as a run of this method does
    let (inquiry, analysis) = (&inquiry, &analysis);
    let setup = Setup { scene, intersector, inquiry, analysis };
    let request = Request {
        method: Some(method),
        seed,
        window,
        samples: Some(n),
        error: None,
        time: None,
        left: None,
    };
    let choice = setup.choose(&request);
    let sampling = Sampling::new(method, seed, Some(n), area);
    let sampling = choice.map_or(sampling, |choice| choice.sampling);
    let mut renderer = setup.renderer(&sampling);
    let mut film = sampling.film(resolution, window);
    renderer.pass(&mut film, n, &|_| true);
    film
}

// Tabulate how often the truth is covered
fn room() -> Result<Case, Box<dyn Error>> {
    let room = Interior::named("backroom").ok_or("no such room")?;
    let setting = set(&room.mesh(), 0.8, DVec3::Y, &room.view)?;
    let film = image(&setting, Method::Gather, 99, 2048);
    Ok(Case::measured("back room", setting, &film))
}

/// The method, the samples and the number of images of each row.
const ROWS: [(Method, u64, u64); 6] = [
    (Method::Reference, 16, 24),
    (Method::Reference, 256, 4),
    (Method::Sobol, 16, 24),
    (Method::Sobol, 256, 4),
    (Method::Gather, 16, 24),
    (Method::Gather, 256, 4),
];

fn coverage<'a>(
    cases: impl Iterator<Item = &'a Case>,
) -> Result<[String; 2], fmt::Error> {
    let (mut rows, mut means) = (String::new(), Means::default());
    for case in cases {
        write!(means.rows, "{}", case.name)?;
        for (method, n, seeds) in ROWS {
            // Print a row for some images
            let Case { name, setting, truth, mean } = case;
            let seeds = 1..=seeds;
            let images = seeds.map(|seed| image(setting, method, seed, n));
            let images: Vec<_> = images.collect();
            let z = images.iter().flat_map(|i| deviations(i, truth, WORTH));
            let z: Vec<f64> = z.collect();
            // Print a row of coverage
            let way = match (n, method) {
                (16, Method::Reference) => format!("{name} & {method}"),
                (16, _) => format!(" & {method}"),
                _ => " & ".to_owned(),
            };
            writeln!(rows, r"{way} & {n} & {} \\", covered(&z))?;
            if n == 16 {
                // Print the columns of the means
                let summaries = images.iter().map(Film::summary);
                let summaries: Vec<_> = summaries.collect();
                let stated = |s: &Summary| s.mean_stderr;
                means.add(mean_deviations(&summaries, *mean, stated))?;
                if method == Method::Gather {
                    let pixels = f64::from(WIDTH * HEIGHT);
                    let apart = |s: &Summary| s.rmse / pixels.sqrt();
                    means.add(mean_deviations(&summaries, *mean, apart))?;
                }
            }
        }
        writeln!(means.rows, r" \\")?;
    }
    // Print a row for all scenes
    write!(means.rows, r"\midrule all")?;
    for z in std::mem::take(&mut means.columns) {
        means.add(z)?;
    }
    writeln!(means.rows, r" \\")?;
    Ok([rows, means.rows])
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

/// The deviation of z, and the percentages within 1, 1.96 and 3.
fn covered(z: &[f64]) -> String {
    let share = |bound: f64| {
        let within = z.iter().filter(|z| z.abs() <= bound).count();
        100. * within as f64 / z.len() as f64
    };
    let (one, two, three) = (share(1.), share(1.96), share(3.));
    format!("{:.3} & {one:.1} & {two:.1} & {three:.2}", deviation(z))
}

/// By how many standard errors the means of images miss the truth.
fn mean_deviations(
    summaries: &[Summary],
    (truth, unsure): (f64, f64),
    error: impl Fn(&Summary) -> f64,
) -> Vec<f64> {
    let deviation = |summary: &Summary| {
        let (miss, error) = (summary.mean - truth, error(summary));
        miss / (error * error + unsure * unsure).sqrt()
    };
    summaries.iter().map(deviation).collect()
}

/// Deviations of the means of images, and the z of the columns so far.
#[derive(Default)]
struct Means {
    rows: String,
    columns: [Vec<f64>; 4],
    column: usize,
}

impl Means {
    /// Prints the next column.
    fn add(&mut self, z: Vec<f64>) -> fmt::Result {
        self.columns[self.column].extend(&z);
        self.column = (self.column + 1) % self.columns.len();
        let (deviation, k) = (deviation(&z), z.len() as f64);
        let unsure = deviation / (2. * k).sqrt();
        write!(self.rows, r" & ${deviation:.2}\pm{unsure:.2}$")
    }
}

// Tabulate what a pixel has not seen
fn unseen(cases: &[Case]) -> Result<String, fmt::Error> {
    let mut rows = String::new();
    for Case { name, setting, truth, .. } in cases {
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

// Tabulate what the limit of error does
/// Contributes 1 with probability `P`, else 0.
struct Coin;

const P: f64 = 0.05;

impl Integrator for Coin {
    type Path = ();
    type RayQuery = Hit;

    fn begin(&self, _: DVec3) {}

    // Throw the coin and end
    fn advance(
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
        integrator: Coin,
        known: &KnownPixels::Nothing,
        sampler: IndependentSampler::new(seed),
    };
    // Stop at the error alone
    let interrupt = Interrupt::default();
    let limits = Limits { error: Some(error), ..Limits::none(&interrupt) };
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
