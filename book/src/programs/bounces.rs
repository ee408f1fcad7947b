// The light of the courtyard by the number of its reflections: the terms of the
// Neumann series and their sums as pictures, and numbers of the text on standard
// output, for the chapter "Light and chance".
//
// usage: bounces FIGURES
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::path::Path;

use glam::DVec3;
use litpt::bvh::Intersector;
use litpt::integrator::{Integrator, PathEvent};
use litpt::render::Job;
use litpt::sampler::{Sampler, within};
use litpt_book::closed_forms::Setting;
use litpt_book::courtyard;
use rayon::prelude::*;

use super::{Done, draw};

pub const RESOLUTION: (u32, u32) = (128, 96);
const SAMPLES: u64 = 64;
const RHO: f64 = 0.8;

/// Terms that are told apart, the last of which has all that follow, and those
/// that have pictures of their own, likewise.
const TERMS: usize = 32;
const SHOWN: usize = 4;

pub fn run(arguments: &[String]) -> Done {
    let figures =
        Path::new(arguments.first().ok_or("usage: bounces FIGURES")?);
    let setting = courtyard()?;
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

/// The courtyard, as the title of the book shows it.
pub fn courtyard() -> Result<Setting, Box<dyn std::error::Error>> {
    let sky = (RHO, DVec3::Y);
    Setting::new(&courtyard::mesh(), sky, &courtyard::view(), 4. / 3.)
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
    let (direction, _, mut hit) = sensor.start(intersector, x, y);
    let mut path = integrator.begin(direction);
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
