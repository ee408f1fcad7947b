// Means and their errors (chapter "Statistics").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use litpt::statistics::Accumulator;

fn accumulate(weights: impl Iterator<Item = f64>) -> Accumulator {
    let mut sum = Accumulator::default();
    weights.for_each(|weight| sum.add(weight));
    sum
}

#[test]
fn small_samples_have_the_variance_of_the_textbook() {
    let sum = accumulate([1., 2., 4., 9.].into_iter());
    assert_eq!((sum.count(), sum.mean()), (4, 4.));
    // (9 + 4 + 0 + 25) / 3, to a dozen roundings of 1.1e-16 each.
    assert!((sum.variance() / (38. / 3.) - 1.).abs() < 2e-15);
    assert!(
        (sum.standard_error() / (38. / 12f64).sqrt() - 1.).abs() < 2e-15
    );
}

#[test]
fn one_weight_leaves_its_error_unknown() {
    assert_eq!(
        accumulate([0.3].into_iter()).standard_error(),
        f64::INFINITY
    );
    assert_eq!(Accumulator::default().standard_error(), f64::INFINITY);
}

#[test]
fn equal_weights_have_no_variance_at_all() {
    for weight in [0.1, 1. / 3., 0.8f64.powi(9), 1.] {
        let sum = accumulate(std::iter::repeat_n(weight, 10_000_000));
        assert_eq!((sum.mean(), sum.variance()), (weight, 0.));
    }
}

#[test]
fn tiny_deviations_are_not_lost() {
    // 1 ± 1e-9 in turn: the variance is 1e-18 n / (n - 1).
    let n = 1_000_000;
    let weights = (0..n).map(|i| 1. + 1e-9 * f64::from(i % 2 * 2 - 1));
    let variance = accumulate(weights).variance();
    assert!((variance / 1e-18 - 1.).abs() < 0.01, "{variance}");
}
