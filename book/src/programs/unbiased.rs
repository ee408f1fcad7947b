// Do two methods have the same means? Renders small images of some twenty
// scenes by both, with different random numbers, and compares the pixels and
// the means of the images; prints a CSV for "make unbiased", and fails if some
// difference is no chance.
//
// usage: unbiased [FIRST SECOND [SAMPLES]]
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::f64::consts::SQRT_2;

use glam::DVec3;
use litpt::analysis::background::KnownPixels;
use litpt::analysis::{Inquiry, SceneAnalysis, Shortcut};
use litpt::camera::View;
use litpt::film::{Film, Window};
use litpt::integrator::PathTracer;
use litpt::numerics::power_of_two;
use litpt::render::Job;
use litpt::render::choose::{Method, Request, Sampling, Setup, Wanted};
use litpt::scene::Mesh;
use litpt_book::closed_forms::{self, cavity, closed_forms, look, plane};
use litpt_book::interiors::Interior;
use litpt_book::mixtures::Mixture;
use litpt_book::settings::{self, Setting};

use super::Done;

const RESOLUTION: (u32, u32) = (16, 12);
const SAMPLES: u64 = 1024;

/// Samples that are placed together, at most.
const TOGETHER: u64 = 4;

/// The probability that a table of two unbiased integrators has a failure.
const FALSE_ALARMS: f64 = 1e-3;

/// Parts of a value by which equal ones may differ through rounding.
const ROUNDING: f64 = 1e-12;

/// The image of a method, with nothing left out. Few samples are placed
/// together, so that the error is known from many values. Of the sky as much
/// is subtracted as a pilot finds best: where a path has no variance, a part
/// of it would leave a rare event that 1024 samples need not see.
fn render(method: Method, setting: &Setting, n: u64, seed: u64) -> Film {
    let area = u64::from(RESOLUTION.0 * RESOLUTION.1);
    let sampling = Sampling::new(method, seed, Some(n), area);
    let replicate = sampling.replicate.min(TOGETHER);
    let control = control(setting, method, n);
    let sampling = Sampling { replicate, control, ..sampling };
    let all = &Shortcut::ALL;
    setting.render_with(all, RESOLUTION, n, &sampling, |_| ()).film
}

/// How much of the sky a run by this method subtracts, in per cent.
fn control(setting: &Setting, method: Method, n: u64) -> u64 {
    let aspect = f64::from(RESOLUTION.0) / f64::from(RESOLUTION.1);
    let sky = (setting.rho, setting.view.up);
    let set = closed_forms::Setting::new(
        &setting.mesh,
        sky,
        &setting.view,
        aspect,
    );
    let Ok(set) = set else { return 0 };
    let Job { scene, intersector, camera, integrator, .. } = set.job(0);
    let PathTracer { albedo, sky, .. } = integrator;
    let (resolution, kept) = (RESOLUTION, &[][..]);
    let inquiry = &Inquiry { camera, sky, albedo, resolution, kept };
    let known = KnownPixels::Nothing;
    let analysis =
        &SceneAnalysis { findings: vec![], known, is_black: false };
    let window = Window { corner: (0, 0), size: RESOLUTION };
    let setup = Setup { scene, intersector, inquiry, analysis };
    let choice = setup.choose(&Request {
        method: Some(method),
        seed: 0,
        window,
        samples: Some(n),
        error: None,
        time: None,
        left: None,
    });
    choice.map_or(0, |choice| choice.sampling.control)
}

pub fn run(arguments: &[String]) -> Done {
    let word = |i: usize| arguments.get(i).map(String::as_str);
    let method = |i| {
        let wanted = word(i).map_or(Ok(Wanted(None)), str::parse::<Wanted>);
        wanted.map(|wanted| wanted.0.unwrap_or(Method::Reference))
    };
    let (first, second) = (method(0)?, method(1)?);
    let n = word(2).map_or(Ok(SAMPLES), str::parse)?;
    let scenes = scenes()?;
    let pixels = RESOLUTION.0 * RESOLUTION.1;
    let tests = scenes.len() as f64 * f64::from(pixels + 1);
    let level = -libm::expm1(libm::log1p(-FALSE_ALARMS) / tests);
    let passes = |z: f64| libm::erfc(z.abs() / SQRT_2) >= level;
    println!("scene,albedo,first,second,z,largest,pixels off,verdict");
    let mut failed = 0;
    for (i, setting) in (0..).zip(&scenes) {
        let a = render(first, setting, n, 2 * i);
        let b = render(second, setting, n, 2 * i + 1);
        let (means, zs) = compare(&a, &b);
        let largest =
            zs.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs()));
        let off = zs.iter().filter(|z| !passes(**z)).count();
        let z = z_score(means[0], means[1]);
        let good = passes(z) && off == 0;
        failed += u32::from(!good);
        println!(
            "{},{},{:.6},{:.6},{z:.2},{:.2},{off},{}",
            setting.name,
            setting.rho,
            means[0].0,
            means[1].0,
            largest.unwrap_or(0.),
            if good { "pass" } else { "fail" }
        );
    }
    match failed {
        0 => Ok(()),
        _ => Err(format!("{failed} scenes differ").into()),
    }
}

/// A mean, and its squared standard error.
type Estimate = (f64, f64);

/// The difference in standard errors; infinite if it has none.
fn z_score((a, var_a): Estimate, (b, var_b): Estimate) -> f64 {
    match a - b {
        d if d.abs() <= ROUNDING * a.max(b) => 0.,
        d => d / (var_a + var_b).sqrt(),
    }
}

/// The means of two images, and the z of each pixel.
fn compare(a: &Film, b: &Film) -> ([Estimate; 2], Vec<f64>) {
    let estimates = |film: &Film| -> Vec<Estimate> {
        let pixels = film.rows();
        pixels.map(|p| (p.mean(), p.standard_error().powi(2))).collect()
    };
    let films = [a, b].map(estimates);
    let means = [a, b].map(|film| {
        let summary = film.summary();
        (summary.mean, summary.mean_stderr.powi(2))
    });
    let pairs = films[0].iter().zip(&films[1]);
    (means, pairs.map(|(&a, &b)| z_score(a, b)).collect())
}

// ---- the scenes

/// What has a closed form, what is large or small, and what is like a
/// picture.
fn scenes() -> Result<Vec<Setting>, String> {
    let above = look(DVec3::new(0.3, 0.1, 2.), DVec3::ZERO, 60.);
    let mut all = vec![set("plane", plane(), above, 0.5)];
    for (name, title, rho) in [
        ("slope of a solid", r"facet, $\cos\theta=0.6$", 0.9),
        ("V", r"V, $\alpha=74^\circ$", 0.9),
        ("room under a skylight", "room", 0.9),
        ("white room under a skylight", "room", 1.),
    ] {
        let mut forms = closed_forms().into_iter();
        let form = forms.find(|form| form.name == title).ok_or(title)?;
        all.push(set(name, form.mesh, form.view, rho));
    }
    for (name, opening, exponent, rho) in [
        ("cavity", 0.05, 0, 0.9),
        ("white cavity with a hole", 0.01, 0, 1.),
        ("cavity of size 2^40", 0.2, 40, 0.5),
        ("cavity of size 2^-40", 0.2, -40, 0.5),
    ] {
        let scale = power_of_two(exponent);
        let mut mesh = cavity(opening, 32);
        mesh.vertices.iter_mut().for_each(|v| *v *= scale);
        all.push(set(name, mesh, below(), rho));
    }
    for name in ["corridor", "backroom"] {
        let interior = Interior::named(name).ok_or(name)?;
        let (mesh, view) = (interior.mesh(), interior.view);
        all.push(Setting { name, mesh, view, rho: 0.8 });
    }
    let ball = Mixture::named("ball", 1e6).ok_or("ball")?;
    all.push(set("ball on a large square", ball.mesh, ball.view, 0.8));
    all.extend(settings::all().into_iter().filter(|s| s.name != "chest"));
    Ok(all)
}

/// A view from the origin downwards and aside.
fn below() -> View {
    look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 60.)
}

/// A scene in which z is up.
fn set(name: &'static str, mesh: Mesh, view: View, rho: f64) -> Setting {
    let view = View { up: DVec3::Z, ..view };
    Setting { name, mesh, view, rho }
}
