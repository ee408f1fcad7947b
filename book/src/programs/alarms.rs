// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! How often two images of the same radiances are called inconsistent,
//! for kinds of weights and numbers of samples: prints the rows of
//! the table in the chapter "Comparing images"; "make measure"
//! records them.

use std::collections::BTreeMap;

use litpt::compare::compare;
use litpt::image::Image;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::Done;

type Random = Pcg64Mcg;

const SIZE: (u32, u32) = (64, 48);
const PAIRS: u32 = 500;

/// Samples of the first and the second image; 0 stands for the
/// exact value.
const COUNTS: [(u32, u32); 5] =
    [(2, 2), (16, 16), (16, 64), (64, 64), (64, 0)];

/// A kind of weights: its name, its expectation, and how it is drawn.
type Kind = (&'static str, f64, fn(&mut Random) -> f64);

pub fn run(_: &[String]) -> Done {
    println!("weights,2;2,16;16,16;64,64;64,64;exact,ratio");
    let path = mean_of_path();
    let kinds: [Kind; 6] = [
        ("normal", 0., normal),
        ("fair coin", 0.5, |r| coin(r, 0.5)),
        ("1 once in 50", 0.02, |r| coin(r, 0.02)),
        ("of a path", path, weight_of_path),
        ("log-normal 1.5", f64::exp(1.125), |r| f64::exp(1.5 * normal(r))),
        ("log-normal 3", f64::exp(4.5), |r| f64::exp(3. * normal(r))),
    ];
    for kind in kinds {
        let mut random = Random::seed_from_u64(2026);
        let results =
            COUNTS.map(|counts| alarms(kind, counts, &mut random));
        let alarms = results.map(|r| format!("{:.1}", 100. * r.0));
        println!("{},{},{:.3}", kind.0, alarms.join(","), results[2].1);
    }
    Ok(())
}

/// The share of pairs that are called inconsistent, and the root of the
/// mean square ratio of the differences to the errors.
fn alarms(
    (_, mean, draw): Kind,
    (n, m): (u32, u32),
    random: &mut Random,
) -> (f64, f64) {
    let (mut alarms, mut squares) = (0, 0.);
    for _ in 0..PAIRS {
        let a = render(n, || draw(random));
        let b = match m {
            0 => exact(&a, mean),
            m => render(m, || draw(random)),
        };
        let difference = compare(&a, &b).expect("comparable images");
        alarms += u32::from(!difference.consistent());
        let ratio = difference.dispersion.ratio;
        squares += ratio * ratio / f64::from(PAIRS);
    }
    (f64::from(alarms) / f64::from(PAIRS), squares.sqrt())
}

/// An image of `n` weights per pixel, rounded as in a file.
fn render(n: u32, mut draw: impl FnMut() -> f64) -> Image {
    let mut pixel = |_| {
        let (mut mean, mut deviations) = (0., 0.);
        for k in 1..=n {
            let weight = draw();
            let deviation = weight - mean;
            mean += deviation / f64::from(k);
            deviations += deviation * (weight - mean);
        }
        let variance = deviations / f64::from(n) / f64::from(n - 1);
        (f64::from(mean as f32), f64::from(variance.sqrt() as f32))
    };
    let pixels = SIZE.0 * SIZE.1;
    let (means, errors): (Vec<_>, Vec<_>) =
        (0..pixels).map(&mut pixel).unzip();
    Image {
        width: SIZE.0,
        height: SIZE.1,
        samples: Some(vec![f64::from(n); means.len()]),
        means,
        errors: Some(errors),
        tile_errors: None,
        attributes: BTreeMap::new(),
    }
}

fn exact(like: &Image, mean: f64) -> Image {
    let means = vec![mean; like.means.len()];
    Image { means, errors: None, samples: None, ..like.clone() }
}

fn normal(random: &mut Random) -> f64 {
    let radius = f64::sqrt(-2. * (1. - random.random::<f64>()).ln());
    radius * (std::f64::consts::TAU * random.random::<f64>()).cos()
}

fn coin(random: &mut Random, p: f64) -> f64 {
    f64::from(u8::from(random.random_bool(p)))
}

/// The share of paths that end in the sky, and in the dark, at each
/// bounce, and the albedo of the surfaces.
const SKY: f64 = 0.2;
const DARK: f64 = 0.1;
const RHO: f64 = 0.8;

/// The weight of a path that is stopped by chance when it is weak, as in
/// the chapter on the estimator.
fn weight_of_path(random: &mut Random) -> f64 {
    let mut weight = RHO;
    loop {
        match random.random::<f64>() {
            x if x < SKY => return weight,
            x if x < SKY + DARK => return 0.,
            _ if weight >= 0.1 => weight *= RHO,
            _ if random.random::<f64>() >= RHO => return 0.,
            _ => (),
        }
    }
}

/// Its expectation: the stopping by chance does not change it.
fn mean_of_path() -> f64 {
    RHO * SKY / (1. - RHO * (1. - SKY - DARK))
}
