// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Prints the table of the book on errors, a CSV for "make calibration".

use std::error::Error;
use std::sync::Arc;

use glam::DVec3;
use litpt::analysis::SceneAnalysis;
use litpt::analysis::background::KnownPixels;
use litpt::camera::View;
use litpt::film::{Film, NEIGHBOUR_WEIGHT, Summary, Window};
use litpt::integrator::SingleProcess;
use litpt::render::Job;
use litpt::render::choose::{
    Budget, Method, Pixels, Request, Sampling, Setup,
};
use litpt::scene::Mesh;
use litpt_book::closed_forms::{Setting, cavity, cavity_radiance};

use super::Done;
use super::bounces::stage;

pub fn run(_: &[String]) -> Done {
    println!("scene,method,n,deviation,one,two,three,mean,by_pixels");
    let mut all = ROWS.map(|_| <[Vec<f64>; 2]>::default());
    for case in cases()?.iter().chain([&room()?]) {
        for (row, all) in ROWS.iter().zip(&mut all) {
            let (z, means) = deviations(case, row);
            print(case.name, row, &covered(&z), &means);
            for (all, means) in all.iter_mut().zip(means) {
                all.extend(means);
            }
        }
    }
    for (row, means) in ROWS.iter().zip(&all).filter(|(row, _)| row.1 == 16)
    {
        print("all", row, ",,,", means);
    }
    Ok(())
}

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

impl Case {
    /// Each pixel has the same radiance, which is known.
    fn known(name: &'static str, setting: Setting, radiance: f64) -> Self {
        let mean = (radiance, 0.);
        let truth = vec![mean; (WIDTH * HEIGHT) as usize];
        Self { name, setting, truth, mean }
    }

    /// An image stands for the truth.
    fn measured(name: &'static str, setting: Setting, film: &Film) -> Self {
        let truth = film
            .means()
            .zip(film.errors(NEIGHBOUR_WEIGHT, film.window))
            .collect();
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
        let setting =
            Setting::new(&cavity(f, 128), (rho, DVec3::Z), &view, 4. / 3.)?;
        cases.push(Case::known(name, setting, cavity_radiance(rho, f)));
    }
    // Add a floor that meets a wall
    let view = look([2., 0., 1.], [0., 0., 0.], DVec3::Z, 70.);
    let setting = Setting::new(&corner(), (0.8, DVec3::Z), &view, 4. / 3.)?;
    cases.push(Case::known("floor and wall", setting, 2. / 3.));
    // Add the courtyard with a reference
    let setting = stage("courtyard", 0.8)?;
    let film = image(&setting, Method::Reference, 99, 4096);
    cases.push(Case::measured("courtyard", setting, &film));
    Ok(cases)
}

fn look(from: [f64; 3], to: [f64; 3], up: DVec3, fov: f64) -> View {
    View { position: from.into(), target: to.into(), up, fov }
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
        ..Mesh::default()
    }
}

/// An image of `n` samples.
fn image(setting: &Setting, method: Method, seed: u64, n: u64) -> Film {
    let resolution = (WIDTH, HEIGHT);
    // Know nothing of the image beforehand
    let Job { intersector, .. } = setting.job(seed);
    let view = setting.view(resolution);
    let known_pixels = KnownPixels::default();
    let analysis = SceneAnalysis { findings: vec![], known_pixels };
    let window = Window { corner: (0, 0), size: resolution };
    // Sample as a run of this method does
    let analysis = &analysis;
    let setup = Setup { intersector, view, analysis, columns: None };
    let request = Request {
        method: Some(method),
        seed,
        window,
        budget: Budget::samples(n),
        left: None,
        shows: false,
    };
    let choice = setup.choose(&request);
    let sampling =
        Sampling::new(method, seed, Some(n), Pixels::of_image(window.size));
    let sampling = choice.map_or(sampling, |choice| choice.sampling);
    let mut renderer =
        setup.renderer(&sampling, Arc::default(), &SingleProcess);
    let mut film = sampling.film(Film::cropped(resolution, window, false));
    renderer.pass(&mut film, n, &|_| true);
    film
}

fn room() -> Result<Case, Box<dyn Error>> {
    let setting = stage("backroom", 0.8)?;
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

/// By how many standard errors pixels miss the truth, and the means of
/// images of 16 samples; those also with the error that they had if the pixels
/// of a gather were independent.
fn deviations(
    Case { setting, truth, mean, .. }: &Case,
    &(method, n, seeds): &(Method, u64, u64),
) -> (Vec<f64>, [Vec<f64>; 2]) {
    let images = (1..=seeds).map(|seed| image(setting, method, seed, n));
    let images: Vec<_> = images.collect();
    let z = images.iter().flat_map(|i| of_pixels(i, truth)).collect();
    let summaries = images.iter().map(Film::summary);
    let summaries: Vec<_> = summaries.filter(|_| n == 16).collect();
    let gathers = if method == Method::Gather { &*summaries } else { &[] };
    let apart = |s: &Summary| s.rmse / f64::from(WIDTH * HEIGHT).sqrt();
    let stated = of_means(&summaries, *mean, |s| s.mean_stderr);
    (z, [stated, of_means(gathers, *mean, apart)])
}

/// For the pixels that miss the truth at all.
fn of_pixels(film: &Film, truth: &[(f64, f64)]) -> Vec<f64> {
    let errors = film.errors(NEIGHBOUR_WEIGHT, film.window);
    let pixels = film.means().zip(errors).zip(truth);
    let deviations = pixels.map(|((mean, error), (exact, unsure))| {
        (mean - exact) / (error * error + unsure * unsure).sqrt()
    });
    deviations.filter(|z| !z.is_nan() && *z != 0.).collect()
}

fn of_means(
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
    format!("{:.3},{one:.1},{two:.1},{three:.2}", deviation(z))
}

/// Prints a row of the table. Of no means, there is no deviation.
fn print(
    name: &str,
    (method, n, _): &(Method, u64, u64),
    covered: &str,
    means: &[Vec<f64>; 2],
) {
    let known = |z: &Vec<f64>| match z[..] {
        [] => String::new(),
        _ => format!("{:.2}", deviation(z)),
    };
    let [stated, apart] = means.each_ref().map(known);
    println!("{name},{method},{n},{covered},{stated},{apart}");
}
