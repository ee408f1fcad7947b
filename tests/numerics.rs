// Exact and portable arithmetic (chapter "Numbers").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

#[test]
fn circle_agrees_with_the_standard_library() {
    let mut random = Pcg64::seed_from_u64(1);
    for _ in 0..1_000_000 {
        let u: f64 = random.random();
        let (x, y) = sincos_turns(u);
        // The error of TAU * u alone moves the library's angle by 4.5e-16
        // of a radian; the documented error of circle is 4e-16.
        assert!((x - (TAU * u).cos()).abs() < 1e-15, "{u}");
        assert!((y - (TAU * u).sin()).abs() < 1e-15, "{u}");
    }
}

#[test]
fn circle_gives_the_same_bits_on_every_machine() {
    // FNV-1a over the bits of a thousand points, recorded once.
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for i in 0..1000 {
        let (x, y) = sincos_turns(f64::from(i) / 1000.);
        for bits in [x.to_bits(), y.to_bits()] {
            hash = (hash ^ bits).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
    assert_eq!(hash, RECORDED, "{hash:#x}");
}

const RECORDED: u64 = 0x5d01_64c2_f31c_3b10;

#[test]
fn powers_of_two_are_exact_over_the_normal_range() {
    for e in -1022..=1023 {
        let power = power_of_two(e);
        assert_eq!(exponent(power), e);
        if e < 1023 {
            assert_eq!(exponent(-1.75 * power), e);
        }
        assert_eq!(power, 2f64.powi(e));
    }
    assert_eq!(exponent(0.), -1075);
    assert_eq!(exponent(-5e-324), -1074);
    assert_eq!(exponent(f64::MIN_POSITIVE / 2.), -1023);
    assert_eq!(exponent(f64::MIN_POSITIVE * 0.75), -1023);
    assert_eq!(power_of_two(5000), power_of_two(1023));
    assert_eq!(power_of_two(-1074), f64::MIN_POSITIVE);
    let smallest = f64::from_bits(1);
    assert_eq!(shift(DVec3::X, -1074).x, smallest);
    assert_eq!(shift(DVec3::X * smallest, 1074).x, 1.);
}

#[test]
fn normalised_vectors_have_their_direction_and_a_component_near_one() {
    for size in [1e-300, 1e-5, 1., -3., 1e300] {
        let u = DVec3::new(0.3, -1., 0.7) * size;
        let v = normalise(u);
        assert!((1. ..2.).contains(&v.abs().max_element()), "{size}: {v}");
        // The factor is a power of two, which rounds nothing.
        let factor = v.y / u.y;
        assert!(factor > 0. && factor * u == v, "{size}: {v}");
    }
    assert_eq!(normalise(DVec3::ZERO), DVec3::ZERO);
}
