// What chance does to a mean, for the chapters "Light and chance" and
// "Statistics": directions of the cosine lobe, and the means of a pixel with
// their errors. The tables go to a directory, numbers of the text to
// standard output.
//
// usage: chance TABLES
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use glam::DVec3;
use litpt::sampler::{cosine_direction, generator};
use litpt::statistics::Accumulator;
use litpt_book::closed_forms::Setting;
use rand::RngExt;
use rayon::prelude::*;

use super::Done;
use super::bounces::{RESOLUTION, RHO, follow, stage};

/// Directions that are drawn.
const DIRECTIONS: usize = 300;

/// Paths of a pixel, and the sizes of the groups that they are divided into.
const PATHS: u64 = 1 << 19;
const SIZES: [usize; 6] = [4, 8, 16, 64, 256, 1024];

/// The sizes of which means are counted, and the bins for them.
const COUNTED: [usize; 2] = [16, 256];
const BINS: usize = 60;

pub fn run(arguments: &[String]) -> Done {
    let tables =
        Path::new(arguments.first().ok_or("usage: chance TABLES")?);
    fs::write(tables.join("lobe.csv"), lobe()?)?;
    let pixel =
        |name| stage(name, RHO).map(|s| Pixel::new(name, &s, [0.36, 0.86]));
    let (yard, room) = (pixel("courtyard")?, pixel("backroom")?);
    fs::write(tables.join("spread.csv"), yard.histogram()?)?;
    fs::write(tables.join("covered.csv"), covered(&[yard, room])?)?;
    Ok(())
}

/// Directions of the cosine lobe around z.
fn lobe() -> Result<String, std::fmt::Error> {
    let mut random = generator(0, 0, 2);
    let mut out = String::from("x,y,z\n");
    for _ in 0..DIRECTIONS {
        let (r, turn) = (random.random(), random.random());
        let DVec3 { x, y, z } = cosine_direction(DVec3::Z, r, turn);
        writeln!(out, "{x:.4},{y:.4},{z:.4}")?;
    }
    Ok(out)
}

/// Many contributions of a pixel, with their mean and deviation.
struct Pixel {
    contributions: Vec<f64>,
    mean: f64,
    deviation: f64,
}

impl Pixel {
    /// That of a scene, at a point of its image; prints what it is like.
    fn new(name: &str, setting: &Setting, [x, y]: [f64; 2]) -> Self {
        let (width, height) = RESOLUTION;
        let [x, y] = [x * f64::from(width), y * f64::from(height)];
        let pixel = y as u32 * width + x as u32;
        let follow = |n| follow(setting, pixel, n).1;
        let contributions: Vec<_> =
            (0..PATHS).into_par_iter().map(follow).collect();
        let mut all = Accumulator::default();
        contributions.iter().for_each(|&x| all.add(x));
        let (mean, deviation) = (all.mean(), all.variance().sqrt());
        let cube = |x: &f64| ((x - mean) / deviation).powi(3);
        let skewness = contributions.iter().map(cube).sum::<f64>();
        let skewness = skewness / PATHS as f64;
        let found = contributions.iter().filter(|&&x| x > 0.).count();
        let found = found as f64 / PATHS as f64;
        for (entry, value) in [
            ("mean", mean),
            ("deviation", deviation),
            ("skewness", skewness),
            ("found", found),
        ] {
            println!(
                "\\nwmeasured{{chance}}{{{name}}}{{{entry}}}{{{value:.4}}}%"
            );
        }
        Self { contributions, mean, deviation }
    }

    /// The means of `n` contributions each, with their errors.
    fn means(&self, n: usize) -> impl Iterator<Item = (f64, f64)> {
        self.contributions.chunks_exact(n).map(|group| {
            let mut sums = Accumulator::default();
            group.iter().for_each(|&x| sums.add(x));
            (sums.mean(), sums.standard_error())
        })
    }

    /// The shares of means in bins, beside the normal density.
    fn histogram(&self) -> Result<String, std::fmt::Error> {
        let width = 8. * self.deviation / 4. / BINS as f64;
        let start = self.mean - 0.5 * width * BINS as f64;
        let mut counts = [[0.; BINS]; 2];
        for (counts, n) in counts.iter_mut().zip(COUNTED) {
            for (mean, _) in self.means(n) {
                let bin = ((mean - start) / width).floor();
                // A cast would put what is below the first bin into it.
                let bin = if bin < 0. { BINS } else { bin as usize };
                if let Some(count) = counts.get_mut(bin) {
                    *count += n as f64 / PATHS as f64 / width;
                }
            }
        }
        let mut out =
            String::from("edge,mean,few,many,normal few,normal many\n");
        let [few, many] = counts;
        for (i, (few, many)) in few.iter().zip(many).enumerate() {
            let x = start + width * (i as f64 + 0.5);
            write!(out, "{:.4},{x:.4}", x - 0.5 * width)?;
            write!(out, ",{few:.4},{many:.4}")?;
            for n in COUNTED {
                let error = self.deviation / (n as f64).sqrt();
                let z = (x - self.mean) / error;
                let normal =
                    (-0.5 * z * z).exp() / (2. * PI).sqrt() / error;
                write!(out, ",{normal:.4}")?;
            }
            writeln!(out)?;
        }
        Ok(out)
    }

    /// The share of means that are within so many of their errors.
    fn share(&self, n: usize, errors: f64) -> f64 {
        let (mut within, mut all) = (0., 0.);
        for (mean, error) in self.means(n) {
            all += 1.;
            if (mean - self.mean).abs() <= errors * error {
                within += 1.;
            }
        }
        within / all
    }
}

/// How often the mean of all is covered, for each size of a group.
fn covered(pixels: &[Pixel; 2]) -> Result<String, Box<dyn Error>> {
    let mut out = String::from("n,yard one,yard two,room one,room two\n");
    for n in SIZES {
        write!(out, "{n}")?;
        for (pixel, name) in pixels.iter().zip(["courtyard", "backroom"]) {
            for (errors, word) in [(1., "one"), (2., "two")] {
                let share = pixel.share(n, errors);
                write!(out, ",{share:.4}")?;
                println!(
                    "\\nwmeasured{{chance}}{{{name} {n}}}{{{word}}}\
                     {{{share:.4}}}%"
                );
            }
        }
        writeln!(out)?;
    }
    Ok(out)
}
