// Means and their errors (chapter "Statistics").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

fn accumulate(weights: impl IntoIterator<Item = f64>) -> Accumulator {
    let mut sum = Accumulator::default();
    weights.into_iter().for_each(|weight| sum.add(weight));
    sum
}

#[test]
fn small_samples_have_the_variance_of_the_textbook() {
    let sum = accumulate([1., 2., 4., 9.]);
    assert_eq!((sum.count(), sum.mean()), (4, 4.));
    // (9 + 4 + 0 + 25) / 3, to a dozen roundings of 1.1e-16 each.
    assert!((sum.variance() / (38. / 3.) - 1.).abs() < 2e-15);
    let error = (38. / 12f64).sqrt();
    assert!((sum.standard_error() / error - 1.).abs() < 2e-15);
    // One weight leaves its error unknown.
    let one = accumulate([0.3]);
    for sum in [one, Accumulator::default()] {
        assert_eq!(sum.standard_error(), f64::INFINITY);
    }
}

/// `n` times the same weight: 30 merges make 10^9 of one.
fn repeated(weight: f64, n: u64) -> Accumulator {
    let mut sum = Accumulator::default();
    sum.add_times(weight, n);
    sum
}

#[test]
fn adding_a_weight_many_times_is_adding_it_one_by_one() {
    for weight in [0., 0.1, 1. / 3., 1., 7e8, 3e-21, -1.] {
        for n in [0, 1, 2, 3, 4, 7, 1000, 1_234_567] {
            let one_by_one = accumulate(std::iter::repeat_n(weight, n));
            let sum = repeated(weight, n as u64);
            assert_eq!(sum.to_bytes(), one_by_one.to_bytes());
            // The same after other weights.
            let mut sum = accumulate([0.7, 0.2]);
            sum.add_times(weight, n as u64);
            let mut all = vec![0.7, 0.2];
            all.resize(2 + n, weight);
            assert_eq!(sum, accumulate(all));
        }
    }
}

#[test]
fn a_thousand_million_equal_weights_have_no_variance_at_all() {
    for weight in [0.1, 1. / 3., 0.8f64.powi(9), 1., 1e-20, 12345.6789] {
        let sum = repeated(weight, 1_000_000_000);
        assert_eq!((sum.count(), sum.variance()), (1_000_000_000, 0.));
        assert!((sum.mean() / weight - 1.).abs() < 1e-6);
    }
    let mut sum = repeated(0.1, 1_000_000_000);
    assert_eq!(sum.mean(), 0.1);
    sum.add(0.1f64.next_up());
    assert!(sum.variance() > 0., "one weight of 10^9 differs in one bit");
}

#[test]
fn a_thousand_million_nearly_equal_weights_keep_their_variance() {
    let mut sum = repeated(1. - 1e-9, 500_000_000);
    sum.merge(&repeated(1. + 1e-9, 500_000_000));
    assert!((sum.variance() / 1e-18 - 1.).abs() < 1e-6);
    assert_eq!(sum.mean(), 1.);
}

/// Weights of all magnitudes from 1e-30 to 1e9, some of them equal, and some
/// below zero.
fn wild(n: usize, random: &mut impl Rng) -> Vec<f64> {
    let weight = |_| match random.random_range(0..10) {
        0 => 0.,
        1 => 1.,
        2..5 => -10f64.powf(random.random_range(-30. ..9.)),
        _ => 10f64.powf(random.random_range(-30. ..9.)),
    };
    (0..n).map(weight).collect()
}

#[test]
fn merging_in_any_grouping_and_order_gives_the_same_bits() {
    let mut random = Pcg64::new(7, 1);
    for _ in 0..100 {
        let mut weights = wild(500, &mut random);
        let whole = accumulate(weights.iter().copied());
        for i in (1..weights.len()).rev() {
            weights.swap(i, random.random_range(0..=i));
        }
        let mut parts = vec![Accumulator::default(); 20];
        for &weight in &weights {
            let part = random.random_range(0..parts.len());
            parts[part].add(weight);
        }
        while parts.len() > 1 {
            let one = random.random_range(0..parts.len());
            let one = parts.swap_remove(one);
            let other = random.random_range(0..parts.len());
            parts[other].merge(&one);
        }
        assert_eq!(parts[0], whole);
        let bits = [parts[0], whole].map(|sum| sum.variance().to_bits());
        assert_eq!(bits[0], bits[1]);
    }
}

#[test]
fn an_accumulator_survives_as_bytes() {
    let mut random = Pcg64::new(8, 1);
    for n in [0, 1, 2, 300] {
        let sum = accumulate(wild(n, &mut random));
        let bytes = sum.to_bytes();
        assert_eq!(bytes[..8], (n as u64).to_le_bytes());
        assert_eq!(Accumulator::from_bytes(&bytes), sum);
    }
    let counting: [u8; 64] = std::array::from_fn(|i| i as u8 + 1);
    assert_eq!(Accumulator::from_bytes(&counting).to_bytes(), counting);
}

#[test]
fn mean_and_variance_agree_with_exact_arithmetic() {
    let mut random = Pcg64::new(9, 1);
    // Whole multiples of 2^exponent, whose sums fit in 128 bits.
    let powers = [-88, -75, -60, -40, -1].into_iter();
    for (exponent, least) in powers.flat_map(|e| [(e, 0), (e, -3)]) {
        for n in [2, 3, 10, 1000] {
            let limit = 1i128 << random.random_range(2..38);
            let number = |_| random.random_range(least * limit..limit);
            let whole: Vec<i128> = (0..n).map(number).collect();
            let unit = 2f64.powi(exponent);
            let sum = accumulate(whole.iter().map(|&k| k as f64 * unit));
            let total: i128 = whole.iter().sum();
            let squares: i128 = whole.iter().map(|k| k * k).sum();
            let (count, n) = (i128::from(n), f64::from(n));
            let mean = total as f64 / n * unit;
            // The mean is a whole number of 2^-88, rounded to a double.
            let rounding = 2f64.powi(-88) + mean.abs() * f64::EPSILON;
            assert!((sum.mean() - mean).abs() <= rounding);
            let exact = (count * squares - total * total) as f64;
            let variance = exact / (n * (n - 1.)) * unit * unit;
            // At most two doubles away.
            let found = sum.variance().to_bits();
            assert!(found.abs_diff(variance.to_bits()) <= 2);
        }
    }
}

#[test]
fn a_weight_that_is_wrong_makes_the_error_infinite_for_ever() {
    let large = (1u64 << 39) as f64;
    let wrong = [f64::NAN, large, f64::MAX, f64::INFINITY];
    for wrong in wrong.into_iter().flat_map(|wrong| [wrong, -wrong]) {
        let mut sum = accumulate([1., 2., wrong]);
        assert_eq!(sum.variance(), f64::INFINITY, "{wrong}");
        [0., 1., 3e5, wrong].into_iter().for_each(|w| sum.add(w));
        assert_eq!(sum.standard_error(), f64::INFINITY, "{wrong}");
        let sound = accumulate([1., 2.]);
        for (mut one, other) in [(sum, sound), (sound, sum), (sum, sum)] {
            one.merge(&other);
            assert_eq!(one.variance(), f64::INFINITY, "{wrong}");
        }
        assert!(sum.mean().is_finite());
        assert_eq!(Accumulator::from_bytes(&sum.to_bytes()), sum);
    }
    let sum = accumulate([large.next_down(); 2]);
    assert_eq!((sum.mean(), sum.variance()), (large.next_down(), 0.));
    assert_eq!(accumulate([-0., 0.]).variance(), 0.);
}

#[test]
fn sums_that_outgrow_their_digits_make_the_error_infinite() {
    // 16 squares of 2^38 are 2^80, one more than the digits hold.
    let large = (1u64 << 38) as f64;
    let most = repeated(large, 15);
    assert_eq!((most.mean(), most.variance()), (large, 0.));
    let mut more = most;
    more.add(large);
    assert_eq!(more.variance(), f64::INFINITY);
    let mut merged = repeated(large, 8);
    merged.merge(&repeated(large, 8));
    assert_eq!(merged.variance(), f64::INFINITY);
    assert_eq!(repeated(large, 1_000_000).variance(), f64::INFINITY);
}

#[test]
fn a_borrow_passes_through_digits_that_are_equal() {
    // The count 2, the sum 2^64 + 1 and the squares 5 * 2^128 + 2^63, in
    // units: 2 * squares - sum^2 is 9 * 2^128 less what a double drops.
    let words = [2, 1, 1, 0, 1 << 63, 0, 5, 0].map(u64::to_le_bytes);
    let bytes: [u8; 64] = words.concat().try_into().unwrap();
    let variance = Accumulator::from_bytes(&bytes).variance();
    assert_eq!(variance, 9. / 2. * 2f64.powi(128 - 176));
}
