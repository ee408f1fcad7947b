// What each shortcut saves: renders scenes with all of them and without one,
// in turns, and prints a CSV for "make ablation". The argument is the
// number of rounds.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use super::Done;
use litpt::analysis::SHORTCUTS;
use litpt_book::settings::{Setting, all};

const DEFINITION: (u32, u32) = (160, 120);

pub fn run(arguments: &[String]) -> Done {
    let rounds: usize = arguments.first().map_or(Ok(5), |n| n.parse())?;
    println!(
        "scene,shortcut,seconds without,seconds with,gain,\
         million rays without,million rays with"
    );
    for setting in all() {
        eprintln!("ablation: {}", setting.name);
        let work = work(&setting);
        let found = setting.render(&[], DEFINITION, work, 0).left_out;
        let shortcuts: Vec<_> = SHORTCUTS
            .into_iter()
            .filter(|shortcut| found.iter().any(|f| f == shortcut))
            .collect();
        for shortcut in &shortcuts {
            row(&setting, shortcut, &[*shortcut], work, rounds);
        }
        if shortcuts.len() != 1 {
            row(&setting, "all", &SHORTCUTS, work, rounds);
        }
    }
    Ok(())
}

/// Samples of each pixel that take three seconds with nothing left out.
fn work(setting: &Setting) -> u64 {
    let trial = setting.render(&SHORTCUTS, DEFINITION, 4, 0);
    4 * (3. / trial.seconds[1].max(1e-3)).ceil() as u64
}

/// Prints what some shortcuts save in a scene. The images must be the same.
fn row(
    setting: &Setting,
    name: &str,
    shortcuts: &[&str],
    n: u64,
    rounds: usize,
) {
    let mut seconds = [vec![], vec![]];
    let mut rays = [0.; 2];
    for _ in 0..rounds {
        let both = [shortcuts, &[]]
            .map(|kept| setting.render(kept, DEFINITION, n, 0));
        assert!(both[0].film.pixels == both[1].film.pixels);
        for (all, outcome) in seconds.iter_mut().zip(&both) {
            all.push(outcome.seconds.iter().sum());
        }
        rays = both.map(|outcome| outcome.rays as f64 / 1e6);
    }
    let ratios = seconds[0].iter().zip(&seconds[1]).map(|(a, b)| a / b);
    let gain = median(ratios.collect());
    let [before, after] = seconds.map(median);
    println!(
        "{},{name},{before:.3},{after:.3},{gain:.2},{:.2},{:.2}",
        setting.name, rays[0], rays[1],
    );
}

/// The middle of some numbers.
fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(f64::NAN)
}
