// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Comparisons with a distribution.

use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

/// So many comparisons of a file, which together give a false alarm with one
/// percent of all seeds (Šidák).
pub struct Chance(pub usize);

impl Chance {
    /// The probability below which one of them fails.
    pub fn significance(&self) -> f64 {
        1. - 0.99f64.powf(1. / self.0 as f64)
    }

    /// Demands that cells of these probabilities could be hit so often (χ²).
    #[track_caller]
    pub fn distributed(
        &self,
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
        let p = law.sf(chi2);
        let fails = p <= self.significance();
        assert!(!fails, "{what}: chi2 = {chi2}, p = {p:e}");
    }

    /// Demands that cells of equal probability were hit equally often.
    #[track_caller]
    pub fn uniform(&self, cells: &[u32], what: &str) {
        self.distributed(cells, |_| 1. / cells.len() as f64, what);
    }

    /// Demands that a number could be drawn from the normal distribution.
    #[allow(dead_code)]
    #[track_caller]
    pub fn normal(&self, z: f64, what: &str) {
        let p = 2. * Normal::standard().sf(z.abs());
        assert!(p > self.significance(), "{what}: z = {z}");
    }
}
