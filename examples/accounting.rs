// Measures what the accounting of a run costs, on the courtyard: percent of
// the time of a run that go into adding weights, into the steps, and into
// reports of all four kinds, and the milliseconds of one checkpoint. The
// parts are timed within one run, as its total varies by more than they are.
// "make measure" records them for the chapter "The journal".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::hint::black_box;
use std::time::{Duration, Instant};

use glam::DVec3;
use litpt::checkpoint::Subject;
use litpt::closed_forms::Setting;
use litpt::course::{Course, Interrupt, Limits};
use litpt::courtyard::{solids, view, write_obj};
use litpt::image::Image;
use litpt::journal::Journal;
use litpt::output::Place;
use litpt::report::{Kind, Report};
use litpt::scene::read_obj;
use litpt::statistics::Accumulator;

const SIZE: (u32, u32) = (320, 240);
const REALISATIONS: u64 = 32;
const ROUNDS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let mut obj = vec![];
    write_obj(&solids(), &mut obj)?;
    let mesh = read_obj(&obj)?;
    let up = (0.8, DVec3::Y);
    let setting = Setting::new(&mesh, up, &view(), 4. / 3.)?;
    let mut rounds = vec![];
    for _ in 0..ROUNDS {
        rounds.push(run(&setting)?);
    }
    let part = |i: usize| median(rounds.iter().map(|r| r[i]).collect());
    let [weights, steps, reports, checkpoint] = [0, 1, 2, 3].map(part);
    println!("weights_percent,steps_percent,reports_percent,checkpoint_ms");
    println!("{weights:.2},{steps:.2},{reports:.2},{checkpoint:.0}");
    Ok(())
}

/// The parts of one run.
fn run(setting: &Setting) -> Result<[f64; 4], Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let place = |name: &str| Place::file(&folder.path().join(name), true);
    let reports = vec![
        (Kind::Json, place("a.json")?),
        (Kind::Csv, place("a.csv")?),
        (Kind::Svg, place("a.svg")?),
        (Kind::Html, place("a.html")?),
    ];
    let never = Duration::MAX;
    let facts = Report::default;
    let mut journal =
        Journal::new(reports, None, never, Subject::default(), facts());
    let limits = Limits {
        realisations: Some(REALISATIONS),
        deadline: None,
        error: None,
        interrupt: &Interrupt::default(),
        reference: None,
    };
    let mut image = Image::new(SIZE.0, SIZE.1);
    let mut course = Course::default();
    let mut reports = 0.;
    let mut after = |course: &Course, image: &Image| {
        let write = || journal.after(course, image);
        reports += seconds(write).expect("reports can be written");
    };
    let job = setting.job(0);
    course.run(&job, &mut image, &limits, &|_| (), &mut after);

    let steps = course.steps.len() as f64 * timed(|| image.summary());
    let paths = (image.area() * REALISATIONS) as f64;
    let weights = paths * weight() / rayon::current_num_threads() as f64;
    let checkpoint = Some(place("a.checkpoint")?);
    let subject = Subject::default();
    let mut journal =
        Journal::new(vec![], checkpoint, Duration::ZERO, subject, facts());
    let save = || journal.after(&course, &image);
    let checkpoint = seconds(save).expect("a checkpoint can be written");
    let percent = 100. / course.seconds;
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

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}
