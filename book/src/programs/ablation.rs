// What each fact saves: renders scenes with all facts and without one of
// them, in turns, and prints a CSV for "make ablation". The argument is the
// number of rounds.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::BTreeMap;
use std::error::Error;

use litpt::analysis::Shortcut;
use litpt::compare::compare;
use litpt::film::Film;
use litpt::image::Image;
use litpt_book::settings::{Outcome, Setting, all, named};
use rayon::ThreadPoolBuilder;

use super::{Done, median};

const DEFINITION: (u32, u32) = (160, 120);

pub fn run(arguments: &[String]) -> Done {
    let rounds: usize = arguments.first().map_or(Ok(5), |n| n.parse())?;
    println!(
        "scene,fact,seconds without,seconds with,gain,million rays without,\
         million rays with,film,gain in time for the same error"
    );
    for setting in all() {
        eprintln!("ablation: {}", setting.name);
        let work = work(&setting);
        let found = render(&setting, &[], work, 0).analysis;
        let holds = |fact: &Shortcut| found.contains(&fact.name());
        let analysis: Vec<_> =
            Shortcut::ALL.into_iter().filter(|fact| holds(fact)).collect();
        for fact in &analysis {
            row(&setting, &fact.name(), &[*fact], work, rounds)?;
        }
        if analysis.len() != 1 {
            row(&setting, "all", &Shortcut::ALL, work, rounds)?;
        }
    }
    samples(rounds)
}

/// Samples of each pixel, and all their rays.
type Load = (u64, f64);

/// What takes three seconds with nothing left out.
fn work(setting: &Setting) -> Load {
    let trial = setting.render(&Shortcut::ALL, DEFINITION, 4, 0);
    let times = (3. / trial.seconds[1].max(1e-3)).ceil();
    let paths = f64::from(4 * DEFINITION.0 * DEFINITION.1);
    (4 * times as u64, paths.max(trial.rays as f64) * times)
}

fn render(
    setting: &Setting,
    kept: &[Shortcut],
    work: Load,
    seed: u64,
) -> Outcome {
    setting.render_with(kept, DEFINITION, work, seed, |_| ())
}

/// Prints what some facts save in a scene.
fn row(
    setting: &Setting,
    name: &str,
    analysis: &[Shortcut],
    work: Load,
    rounds: usize,
) -> Result<(), Box<dyn Error>> {
    let mut seconds = [vec![], vec![]];
    let mut last = None;
    for _ in 0..rounds {
        let without = render(setting, analysis, work, 0);
        let with = render(setting, &[], work, 0);
        for (all, outcome) in seconds.iter_mut().zip([&without, &with]) {
            all.push(outcome.seconds.iter().sum());
        }
        last = Some((without, with));
    }
    let Some((without, with)) = last else { return Ok(()) };
    let ratios = seconds[0].iter().zip(&seconds[1]).map(|(a, b)| a / b);
    let gain = median(ratios.collect());
    let [before, after] = seconds.map(median);
    let (film, precision) = judge(setting, &without, &with, work)?;
    let rays = [&without, &with].map(|o| o.rays as f64 / 1e6);
    let all = match gain * precision {
        all if all.is_finite() => format!("{all:.2}"),
        _ => r"$\infty$".to_owned(),
    };
    println!(
        "{},{name},{before:.3},{after:.3},{gain:.2},{:.2},{:.2},{film},{all}",
        setting.name, rays[0], rays[1],
    );
    Ok(())
}

/// Whether two images are the same, or how far they are apart, with other
/// random numbers; and the ratio of their mean square errors.
fn judge(
    setting: &Setting,
    without: &Outcome,
    with: &Outcome,
    work: Load,
) -> Result<(String, f64), Box<dyn Error>> {
    if without.film.stored() == with.film.stored() {
        return Ok(("same".to_owned(), 1.));
    }
    let rmse = |film: &Film| film.summary().rmse;
    let ratio = rmse(&without.film) / rmse(&with.film);
    let other = render(setting, &[], work, 1).film;
    let image = |film| Image::new(film, BTreeMap::new());
    let difference = compare(&image(&without.film), &image(&other))?;
    Ok((format!("$z={:+.1}$", difference.sum.z()), ratio * ratio))
}

/// Prints what it saves to divide the samples of one pixel among
/// threads.
fn samples(rounds: usize) -> Result<(), Box<dyn Error>> {
    let setting = named("courtyard");
    let one = ThreadPoolBuilder::new().num_threads(1).build()?;
    let (n, mut rays) = (100_000, 0);
    let mut seconds = [vec![], vec![]];
    for _ in 0..rounds {
        let render = || setting.render(&[], (1, 1), n, 0);
        let (alone, divided) = (one.install(render), render());
        rays = divided.rays;
        for (all, outcome) in seconds.iter_mut().zip([alone, divided]) {
            all.push(outcome.seconds[1]);
        }
    }
    let [before, after] = seconds.map(median);
    let (gain, rays) = (before / after, rays as f64 / 1e6);
    println!(
        "courtyard; one pixel,threads,{before:.3},\
         {after:.3},{gain:.2},{rays:.2},{rays:.2},same,{gain:.2}"
    );
    Ok(())
}
