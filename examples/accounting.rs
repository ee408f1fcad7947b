// Measures what the accounting of a run costs: renders the courtyard in one
// pass, and as a run with steps, four reports and a checkpoint every second,
// alternately; prints seconds and their ratio as CSV. "make measure" records
// it for the chapter "The journal".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
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

const SIZE: (u32, u32) = (320, 240);
const REALISATIONS: u64 = 32;
const ROUNDS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let mut obj = vec![];
    write_obj(&solids(), &mut obj)?;
    let mesh = read_obj(&obj)?;
    let up = (0.8, DVec3::Y);
    let setting = Setting::new(&mesh, up, &view(), 4. / 3.)?;
    let (mut bare, mut whole) = (vec![], vec![]);
    for _ in 0..ROUNDS {
        bare.push(one_pass(&setting));
        whole.push(run(&setting)?);
    }
    let (bare, whole) = (median(bare), median(whole));
    println!("pass_seconds,run_seconds,cost_percent");
    println!("{bare:.3},{whole:.3},{:.2}", 100. * (whole / bare - 1.));
    Ok(())
}

fn one_pass(setting: &Setting) -> f64 {
    let mut image = Image::new(SIZE.0, SIZE.1);
    let start = Instant::now();
    setting.job(0).pass(&mut image, 0..REALISATIONS, &|_| ());
    start.elapsed().as_secs_f64()
}

fn run(setting: &Setting) -> Result<f64, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let place = |name: &str| Place::file(&folder.path().join(name), true);
    let reports = vec![
        (Kind::Json, place("a.json")?),
        (Kind::Csv, place("a.csv")?),
        (Kind::Svg, place("a.svg")?),
        (Kind::Html, place("a.html")?),
    ];
    let mut journal = Journal::new(
        reports,
        Some(place("a.checkpoint")?),
        Duration::from_secs(1),
        Subject::default(),
        Report::default(),
    );
    let limits = Limits {
        realisations: Some(REALISATIONS),
        deadline: None,
        error: None,
        interrupt: &Interrupt::default(),
        reference: None,
    };
    let mut image = Image::new(SIZE.0, SIZE.1);
    let mut course = Course::default();
    let mut after = |course: &Course, image: &Image| {
        journal.after(course, image).expect("the disk is full");
    };
    let start = Instant::now();
    let job = setting.job(0);
    course.run(&job, &mut image, &limits, &|_| (), &mut after);
    Ok(start.elapsed().as_secs_f64())
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}
