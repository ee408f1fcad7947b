// Measures what the accounting of a run costs, on the courtyard: percent of
// the time of a run that go into adding weights, into the steps, and into
// reports of all three kinds, and the milliseconds of one checkpoint. The
// parts are timed within one run, as its total varies by more than they are.
// "make measure" records them for the chapter "The journal".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::hint::black_box;
use std::time::{Duration, Instant};

use glam::DVec3;
use litpt::film::Film;
use litpt::output::OutputTarget;
use litpt::render_loop::{Convergence, Interrupt, Limits};
use litpt::report::Kind;
use litpt::run_output::RunOutput;
use litpt::statistics::Accumulator;
use litpt_book::closed_forms::Setting;
use litpt_book::courtyard::{mesh, view};
use litpt_book::settings;

use super::{Done, median};

const SIZE: (u32, u32) = (320, 240);
const SAMPLES: u64 = 32;
const ROUNDS: usize = 5;

pub fn run(_: &[String]) -> Done {
    let up = (0.8, DVec3::Y);
    let setting = Setting::new(&mesh(), up, &view(), 4. / 3.)?;
    let mut rounds = vec![];
    for _ in 0..ROUNDS {
        rounds.push(measure(&setting)?);
    }
    let part = |i: usize| median(rounds.iter().map(|r| r[i]).collect());
    let [weights, steps, reports, checkpoint] = [0, 1, 2, 3].map(part);
    println!("weights_percent,steps_percent,reports_percent,checkpoint_ms");
    println!("{weights:.2},{steps:.2},{reports:.2},{checkpoint:.0}");
    Ok(())
}

/// The parts of one run.
fn measure(setting: &Setting) -> Result<[f64; 4], Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let place =
        |name: &str| OutputTarget::file(&folder.path().join(name), true);
    let reports = vec![
        (Kind::Json, place("a.json")?),
        (Kind::Csv, place("a.csv")?),
        (Kind::Html, place("a.html")?),
    ];
    let (never, known) = (Duration::MAX, settings::known(0));
    let mut run_output = RunOutput::new(reports, None, never, known);
    let interrupt = Interrupt::default();
    let limits =
        Limits { samples: Some(SAMPLES), ..Limits::none(&interrupt) };
    let mut film = Film::new(SIZE.0, SIZE.1);
    let mut convergence = Convergence::default();
    let mut reports = 0.;
    let mut after = |convergence: &Convergence, film: &Film| {
        let write = || run_output.after(convergence, film);
        reports += seconds(write).expect("reports can be written");
    };
    let mut job = setting.job(0);
    convergence.run(&mut job, &mut film, &limits, &|_| (), &mut after);

    let steps = convergence.steps.len() as f64 * timed(|| film.summary());
    let paths = (film.area() * SAMPLES) as f64;
    let weights = paths * weight() / rayon::current_num_threads() as f64;
    let checkpoint = Some(place("a.checkpoint")?);
    let now = Duration::ZERO;
    let mut run_output =
        RunOutput::new(vec![], checkpoint, now, settings::known(0));
    let save = || run_output.after(&convergence, &film);
    let checkpoint = seconds(save).expect("a checkpoint can be written");
    let percent = 100. / convergence.seconds;
    Ok([
        weights * percent,
        steps * percent,
        reports * percent,
        checkpoint * 1e3,
    ])
}

fn timed<T>(work: impl FnOnce() -> T) -> f64 {
    let start = Instant::now();
    black_box(work());
    start.elapsed().as_secs_f64()
}

fn seconds<E>(work: impl FnOnce() -> Result<(), E>) -> Result<f64, E> {
    let start = Instant::now();
    work()?;
    Ok(start.elapsed().as_secs_f64())
}

/// Seconds to add one weight.
fn weight() -> f64 {
    const WEIGHTS: u32 = 10_000_000;
    let add = || {
        let mut sums = Accumulator::default();
        (0..WEIGHTS).for_each(|i| sums.add(f64::from(i % 7) * 0.1));
        sums
    };
    timed(add) / f64::from(WEIGHTS)
}
