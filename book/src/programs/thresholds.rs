// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! From which z on two images of 320 x 240 pixels are called
//! inconsistent, by the scale on which they differ: found by bisection
//! with images that differ in one pixel, in one block, or everywhere.
//! Prints a table of the chapter "Comparing images"; "make
//! measure" records it.

use std::collections::BTreeMap;

use litpt::compare::compare;
use litpt::image::Image;

use super::Done;

const SIZE: (u32, u32) = (320, 240);
const BLOCK: u32 = 16;
/// The standard error of a pixel of either image.
const ERROR: f64 = 0.01;
/// Samples of both images; none if their variance is known.
const COUNTS: [Option<f64>; 3] = [None, Some(64.), Some(16.)];

pub fn run(_: &[String]) -> Done {
    println!("scale,tests,level,known,64,16");
    let (width, height) = SIZE;
    let scales =
        [("pixels", 1), ("blocks", BLOCK), ("image", width.max(height))];
    for (name, side) in scales {
        let tests = width.div_ceil(side) * height.div_ceil(side);
        let mut row = vec![name.to_owned(), tests.to_string()];
        for count in COUNTS {
            let z = threshold(side, count)?;
            if count.is_none() {
                row.push(power_of_ten(libm::erfc(z / f64::sqrt(2.))));
            }
            row.push(format!("{z:.2}"));
        }
        println!("{}", row.join(","));
    }
    Ok(())
}

/// The least z of one block at which two images are inconsistent.
fn threshold(side: u32, count: Option<f64>) -> Result<f64, String> {
    let (mut low, mut high) = (0., 100.);
    while high - low > 1e-4 {
        let z = (low + high) / 2.;
        if consistent(side, z, count)? {
            low = z;
        } else {
            high = z;
        }
    }
    Ok(high)
}

/// Whether images are consistent whose first blocks are z apart.
fn consistent(
    side: u32,
    z: f64,
    count: Option<f64>,
) -> Result<bool, String> {
    let (width, height) = SIZE;
    let inside = |i: u32| i % width < side && i / width < side;
    let pixels = side.min(width) * side.min(height);
    let shift = z * ERROR * f64::sqrt(2. / f64::from(pixels));
    let image = |shift: f64| Image {
        width,
        height,
        means: (0..width * height)
            .map(|i| if inside(i) { 0.5 + shift } else { 0.5 })
            .collect(),
        errors: Some(vec![ERROR; (width * height) as usize]),
        samples: count.map(|n| vec![n; (width * height) as usize]),
        tile_errors: None,
        attributes: BTreeMap::new(),
    };
    Ok(compare(&image(0.), &image(shift))?.consistent())
}

fn power_of_ten(p: f64) -> String {
    let exponent = p.log10().floor();
    let digits = p / 10f64.powf(exponent);
    format!("${digits:.1}\\cdot10^{{{exponent}}}$")
}
