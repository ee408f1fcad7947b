// Measures three ways to accumulate weights, for the chapter "Statistics":
// prints name, nanoseconds for a weight, bytes, and the variance found for
// weights of 1 ± 1e-9 divided by the true one, as CSV.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::hint::black_box;
use std::time::Instant;

use litpt::statistics::Accumulator;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::Done;

trait Sums: Default {
    fn add(&mut self, weight: f64);
    fn variance(&self) -> f64;
}

/// Count, sum and sum of squares, as doubles.
#[derive(Default)]
struct Plain(u64, f64, f64);

impl Sums for Plain {
    #[inline]
    fn add(&mut self, weight: f64) {
        self.0 += 1;
        self.1 += weight;
        self.2 += weight * weight;
    }

    fn variance(&self) -> f64 {
        let n = self.0 as f64;
        (self.2 - self.1 * self.1 / n) / (n - 1.)
    }
}

/// Count, mean and sum of squared deviations (Welford 1962).
#[derive(Default)]
struct Welford(u64, f64, f64);

impl Sums for Welford {
    #[inline]
    fn add(&mut self, weight: f64) {
        self.0 += 1;
        let deviation = weight - self.1;
        self.1 += deviation / self.0 as f64;
        self.2 += deviation * (weight - self.1);
    }

    fn variance(&self) -> f64 {
        self.2 / (self.0 - 1) as f64
    }
}

impl Sums for Accumulator {
    #[inline]
    fn add(&mut self, weight: f64) {
        Accumulator::add(self, weight);
    }

    fn variance(&self) -> f64 {
        Accumulator::variance(self)
    }
}

fn nanoseconds<S: Sums>(weights: &[f64]) -> f64 {
    let start = Instant::now();
    let mut sums = S::default();
    for _ in 0..10_000_000 / weights.len() {
        weights.iter().for_each(|&weight| sums.add(weight));
    }
    black_box(sums.variance());
    start.elapsed().as_secs_f64() * 1e9 / 1e7
}

fn row<S: Sums>(name: &str, merging: &str, nanoseconds: &mut [f64]) {
    nanoseconds.sort_by(f64::total_cmp);
    let median = nanoseconds[nanoseconds.len() / 2];
    let mut sums = S::default();
    for i in 0..1_000_000 {
        sums.add(1. + 1e-9 * f64::from(i % 2 * 2 - 1));
    }
    let ratio = sums.variance() / 1e-18 / (1. + 1e-6);
    let bytes = size_of::<S>();
    println!("{name},{median:.1},{bytes},{ratio:.6},{merging}");
}

pub fn run(_: &[String]) -> Done {
    let mut random = Pcg64::seed_from_u64(1);
    let weights: Vec<f64> = (0..10_000).map(|_| random.random()).collect();
    let mut times = [const { vec![] }; 3];
    for _ in 0..7 {
        times[0].push(nanoseconds::<Plain>(&weights));
        times[1].push(nanoseconds::<Welford>(&weights));
        times[2].push(nanoseconds::<Accumulator>(&weights));
    }
    println!("accumulator,nanoseconds,bytes,variance,merging");
    row::<Plain>("plain sums", "rounds", &mut times[0]);
    row::<Welford>("Welford's", "rounds", &mut times[1]);
    row::<Accumulator>("integers", "exact", &mut times[2]);
    Ok(())
}
