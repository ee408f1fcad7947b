// The brightness of a gallery: cargo run --release --example gallery
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

fn main() {
    let (mut random, mut sum, mut squares) = (1, 0., 0.);
    for _ in 0..50_000 {
        let mut brightness: f64 = 0.8;
        while !reaches_sky(&mut random) {
            brightness *= 0.8;
        }
        sum += brightness;
        squares += brightness * brightness;
    }
    let mean = sum / 5e4;
    let error = ((squares / 5e4 - mean * mean) / 5e4).sqrt();
    println!("{mean:.3} ± {error:.3}, and 2/7 is {:.3}", 2. / 7.);
}

fn reaches_sky(random: &mut u64) -> bool {
    *random =
        random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
    *random >> 32 < 429_496_730
}
