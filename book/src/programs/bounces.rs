// The light of the courtyard by the number of its reflections: the terms of the
// Neumann series and their sums as pictures, and numbers of the text on standard
// output, for the chapter "Light and chance"; and rules of roulette, for the
// chapter "The integrator".
//
// usage: bounces FIGURES
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::path::Path;

use glam::{DVec3, DVec4};
use litpt::bvh::Intersector;
use litpt::integrator::{Integrator, PathEvent};
use litpt::render::Job;
use litpt::sampler::{Sampler, within};
use litpt_book::closed_forms::Setting;
use litpt_book::courtyard;
use litpt_book::interiors::Interior;
use rayon::prelude::*;

use super::{Done, draw};

pub const RESOLUTION: (u32, u32) = (128, 96);
const SAMPLES: u64 = 64;
pub const RHO: f64 = 0.8;

/// Terms that are told apart, the last of which has all that follow, and those
/// that have pictures of their own, likewise.
const TERMS: usize = 32;
const SHOWN: usize = 4;

pub fn run(arguments: &[String]) -> Done {
    let figures =
        Path::new(arguments.first().ok_or("usage: bounces FIGURES")?);
    let setting = stage("courtyard", RHO)?;
    let pixels: Vec<_> = (0..RESOLUTION.0 * RESOLUTION.1)
        .into_par_iter()
        .map(|pixel| terms_of(&setting, pixel))
        .collect();
    let mean = |k: usize| {
        pixels.iter().map(|terms| terms[k]).sum::<f64>()
            / pixels.len() as f64
    };
    let means: Vec<f64> = (0..TERMS).map(mean).collect();
    let all: f64 = means[1..].iter().sum();
    let mut left = all;
    for (k, mean) in means.iter().enumerate().skip(1) {
        left -= mean;
        let entry = format!("\\nwmeasured{{bounces}}{{{k}}}");
        println!("{entry}{{share}}{{{:.4}}}%", mean / all);
        println!("{entry}{{left}}{{{:.4}}}%", left / all);
    }
    let enough = (1..TERMS)
        .find(|&m| means[m + 1..].iter().sum::<f64>() < 0.01 * all);
    let enough = enough.ok_or("the series goes on")?;
    println!("\\nwmeasured{{bounces}}{{hundredth}}{{terms}}{{{enough}}}%");
    for name in ["courtyard", "corridor", "backroom"] {
        compare_rules(name)?;
    }
    for k in 1..=SHOWN {
        let last = if k == SHOWN { TERMS } else { k + 1 };
        let sum = |from: usize| {
            let of = |terms: &Vec<f64>| terms[from..last].iter().sum();
            pixels.iter().map(of).collect()
        };
        picture(figures, &format!("term-{k}"), sum(k))?;
        picture(figures, &format!("sum-{k}"), sum(0))?;
    }
    Ok(())
}

/// An interior, or the courtyard as the title of the book shows it; with
/// this albedo.
pub fn stage(name: &str, rho: f64) -> Result<Setting, Box<dyn Error>> {
    let (mesh, view) = match Interior::named(name) {
        Some(interior) => (interior.mesh(), interior.view),
        None => (courtyard::mesh(), courtyard::view()),
    };
    Setting::new(&mesh, (rho, DVec3::Y), &view, 4. / 3.)
}

/// Prints the efficiency of rules of roulette, which begins below some
/// throughput, in units of that of the reference; and the share of paths that
/// bring light. The paths are those of a scene of albedo 1, where none is
/// ended, four for each pixel.
fn compare_rules(name: &str) -> Done {
    let white = stage(name, 1.)?;
    let area = RESOLUTION.0 * RESOLUTION.1;
    let pairs = (0..2 * area).into_par_iter().map(|i| {
        let n = u64::from(2 * (i / area));
        [n, n + 1].map(|n| follow(&white, i % area, n))
    });
    let pairs: Vec<_> = pairs.collect();
    let rule = |least| {
        let terms = pairs.iter().map(|pair| {
            let [p, q] = pair.map(|path| moments(path, least));
            0.5 * (p + q) - p.w * q.w * DVec4::X
        });
        let sum: DVec4 = terms.sum();
        (sum.x * sum.y, sum.z / pairs.len() as f64)
    };
    for least in [0., 0.01, 0.1, 0.2, 0.5] {
        let (gain, lit) = (rule(0.1).0 / rule(least).0, rule(least).1);
        let entry = format!("\\nwmeasured{{bounces}}{{{name} {least}}}");
        println!("{entry}{{efficiency}}{{{gain:.2}}}%");
        println!("{entry}{{lit}}{{{:.1}}}%", 100. * lit);
    }
    Ok(())
}

/// The mean square of what a path brings, its mean number of rays, its
/// chance to bring something, and what it brings on average, over all games of
/// roulette that begins below this throughput.
fn moments((bounces, light): (usize, f64), least: f64) -> DVec4 {
    let (mut throughput, mut chance, mut rays) = (1., 1., 1.);
    for _ in 0..bounces {
        let faint = throughput < least;
        *if faint { &mut chance } else { &mut throughput } *= RHO;
        rays += chance;
    }
    let lit = chance * f64::from(light > 0.);
    DVec4::new(lit * throughput * throughput, rays, lit, lit * throughput)
}

/// What paths of each number of bounces bring to a pixel, on average.
fn terms_of(setting: &Setting, pixel: u32) -> Vec<f64> {
    let mut terms = vec![0.; TERMS];
    for n in 0..SAMPLES {
        let (bounces, light) = follow(setting, pixel, n);
        let term = &mut terms[bounces.min(TERMS - 1)];
        *term += light / SAMPLES as f64;
    }
    terms
}

/// The bounces of sample `n` of a pixel, and its contribution.
pub fn follow(setting: &Setting, pixel: u32, n: u64) -> (usize, f64) {
    let Job { sensor, intersector, integrator, sampler, .. } =
        setting.job(1);
    let (width, height) = RESOLUTION;
    let mut sampler = sampler.start(u64::from(pixel), n);
    let [x, y] = sampler.get_pixel_2d();
    let x = within(pixel % width, width, x);
    let y = within(pixel / width, height, y);
    let surfaces = &integrator.surfaces;
    let start = sensor.start(intersector, surfaces, (x, y));
    let (direction, mut hit) = (start.direction, start.hit);
    let mut path = integrator.begin(direction, 1.);
    let mut bounces = 0;
    loop {
        match integrator.advance(&mut path, hit, &mut sampler) {
            PathEvent::Scatter(ray, from) => {
                hit = intersector.first_hit(&ray, Some(from));
            }
            PathEvent::Terminate(light) => return (bounces, light),
        }
        bounces += 1;
    }
}

/// Writes a picture of values in [0, 1].
fn picture(figures: &Path, name: &str, means: Vec<f64>) -> Done {
    draw(&figures.join(format!("bounces-{name}.png")), RESOLUTION.0, means)
}
