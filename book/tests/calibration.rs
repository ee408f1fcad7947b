// Whether standard errors are as large as they claim (chapter "Are the
// errors honest?").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::camera::View;
use litpt::film::{Film, NEIGHBOUR_WEIGHT};
use litpt::render::Renderer;
use litpt_book::closed_forms::{Setting, cavity, cavity_radiance};
use litpt_book::courtyard::{mesh, view};

const SIZE: (u32, u32) = (32, 24);

fn render(setting: &Setting, seed: u64, n: u64) -> Film {
    let mut film = Film::new(SIZE.0, SIZE.1);
    setting.job(seed).pass(&mut film, n, &|_| true);
    film
}

/// The root mean square of the z of four images of `n` samples,
/// where the truth of each pixel is known with a standard error.
///
/// Of 3072 values its standard deviation is 0.013, so that the bounds of
/// 0.95 and 1.05 are 3.9 of them away: a false alarm has a probability of
/// 1e-4, and the seeds are fixed.
fn deviation(setting: &Setting, n: u64, truth: &[(f64, f64)]) -> f64 {
    let mut z = vec![];
    for seed in 1..=4 {
        let film = render(setting, seed, n);
        let errors = film.errors(NEIGHBOUR_WEIGHT, film.window);
        for ((mean, error), (exact, unsure)) in
            film.means().zip(errors).zip(truth)
        {
            if mean != *exact {
                z.push((mean - exact) / error.hypot(*unsure));
            }
        }
    }
    assert!(z.len() > 2500);
    (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt()
}

#[track_caller]
fn calibrated(deviation: f64) {
    assert!((0.95..=1.05).contains(&deviation), "{deviation}");
}

#[test]
fn errors_are_honest_where_the_truth_is_known() {
    for (f, rho, n) in [(0.5, 0.9, 256), (0.5, 0.2, 256), (0.05, 0.5, 1024)]
    {
        let to = DVec3::new(0.3, 0.2, -1.);
        let view = View {
            position: DVec3::ZERO,
            target: to,
            up: DVec3::Y,
            fov: 20.,
        };
        let sky = (rho, DVec3::Z);
        let setting = Setting::new(&cavity(f, 128), sky, &view, 4. / 3.);
        let truth = vec![(cavity_radiance(rho, f), 0.); 768];
        calibrated(deviation(&setting.unwrap(), n, &truth));
    }
}

#[test]
fn errors_are_honest_in_the_courtyard() {
    let sky = (0.8, DVec3::Y);
    let setting = Setting::new(&mesh(), sky, &view(), 4. / 3.).unwrap();
    let best = render(&setting, 99, 2048);
    let truth: Vec<_> =
        best.means().zip(best.errors(0., best.window)).collect();
    calibrated(deviation(&setting, 256, &truth));
}
