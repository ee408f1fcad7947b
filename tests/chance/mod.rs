// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Comparisons with a distribution.

use std::panic::Location;

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal, StudentsT};

/// The comparisons of a test with distributions, which count themselves and
/// are judged when it ends: together they give a false alarm with one percent
/// of all seeds (Šidák).
#[derive(Default)]
pub struct Chance {
    count: i32,
    /// The least probability, and of what.
    least: Option<(f64, String, &'static Location<'static>)>,
}

impl Chance {
    /// Adds a comparison: where all is right, so much is off or more with the
    /// probability `p`.
    #[track_caller]
    pub fn add(&mut self, p: f64, what: &str) {
        self.count += 1;
        let p = if p.is_nan() { 0. } else { p };
        if self.least.as_ref().is_none_or(|least| p < least.0) {
            self.least = Some((p, what.to_owned(), Location::caller()));
        }
    }

    /// Cells of these probabilities were hit so often (χ²).
    #[track_caller]
    pub fn distributed(
        &mut self,
        cells: &[u32],
        part: impl Fn(usize) -> f64,
        what: &str,
    ) {
        let n = f64::from(cells.iter().sum::<u32>());
        let square = |(i, &c): (usize, &u32)| {
            let expected = n * part(i);
            assert!(expected >= 5., "{what}: too few in {i}");
            (f64::from(c) - expected).powi(2) / expected
        };
        let chi2: f64 = cells.iter().enumerate().map(square).sum();
        let law = ChiSquared::new(cells.len() as f64 - 1.).unwrap();
        self.add(law.sf(chi2), what);
    }

    /// Cells of equal probability were hit so often.
    #[track_caller]
    pub fn uniform(&mut self, cells: &[u32], what: &str) {
        self.distributed(cells, |_| 1. / cells.len() as f64, what);
    }

    /// A number is drawn from the normal distribution.
    #[track_caller]
    pub fn normal(&mut self, z: f64, what: &str) {
        self.add(2. * Normal::standard().sf(z.abs()), what);
    }

    /// A value with its error, the mean of so many replicates in single
    /// precision, has `exact` for its expectation.
    #[track_caller]
    pub fn judge(
        &mut self,
        [value, error]: [f64; 2],
        exact: f64,
        replicates: f64,
    ) {
        let law = StudentsT::new(0., 1., replicates - 1.).unwrap();
        let error = error.max(exact.abs() * f64::from(f32::EPSILON));
        let p = 2. * law.sf((value - exact).abs() / error.max(1e-9));
        self.add(p, &format!("{value} ± {error}, not {exact}"));
    }
}

impl Drop for Chance {
    fn drop(&mut self) {
        if std::thread::panicking() {
            return;
        }
        let (p, what, place) = self.least.take().expect("no comparison");
        let least = 1. - 0.99f64.powf(1. / f64::from(self.count));
        let count = self.count;
        assert!(p > least, "{place}: {what}: p = {p:e}, {count} judged");
    }
}
