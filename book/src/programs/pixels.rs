// How the errors of the courtyard's pixels fall with the size of a net, and
// prints a CSV: "make measure" records it for the chapter "Quasi-Monte Carlo".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::film::Film;
use litpt::render::{Job, Renderer};
use litpt::sampler::sobol::SobolSampler;
use litpt_book::closed_forms::Setting;
use litpt_book::courtyard;

use super::Done;

/// So small that a second reflection brings nothing.
const TINY: f64 = 1. / 1048576.;

const SIDES: (u32, u32) = (64, 48);

/// Replicates of each pixel.
const REPLICATES: u64 = 8;

pub fn run(_: &[String]) -> Done {
    println!("points,plain,one,several");
    let of = |rho| {
        let sky = (rho, DVec3::Y);
        Setting::new(&courtyard::mesh(), sky, &courtyard::view(), 4. / 3.)
    };
    let settings = [of(TINY)?, of(0.8)?];
    let single = [1, 2].map(|k| variance(&settings[k - 1], 1));
    for log in 0..=9 {
        let n = 1u64 << log;
        print!("{n},{:.4e}", (n as f64).sqrt().recip());
        for (setting, single) in settings.iter().zip(single) {
            print!(",{:.4e}", (variance(setting, n) / single).sqrt());
        }
        println!();
    }
    Ok(())
}

/// The variance of the mean of `n` samples, averaged over the pixels.
fn variance(setting: &Setting, n: u64) -> f64 {
    let sampler = SobolSampler::new(1, n);
    let Job { scene, intersector, camera, integrator, known, .. } =
        setting.job(0);
    let mut film = Film::new(SIDES.0, SIDES.1).with_replicates(n);
    let mut job =
        Job { scene, intersector, camera, integrator, known, sampler };
    // Of single samples more, since the others are divided by their variance.
    let replicates = if n == 1 { 64 * REPLICATES } else { REPLICATES };
    job.pass(&mut film, n * replicates, &|_| true);
    let pixels = f64::from(SIDES.0 * SIDES.1);
    film.rows().map(|pixel| pixel.variance()).sum::<f64>() / pixels
}
