// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Comparing images: what is called chance, and what is
//! not (chapter "Comparing images").

use crate::prelude::*;

use crate::formats::unnamed;
use crate::random::Random;
use crate::render_loop::image_of;

use std::f64::consts::FRAC_PI_2;

use litpt::compare::display::{
    Curve, WHITE, cut_out, errors, tonemap, z_map,
};
use litpt::compare::{Difference, Dispersion, FALSE_ALARMS, FEW, compare};

/// An image of one row whose pixels have these means and errors from
/// `n` samples.
pub fn row(pixels: &[(f64, f64)], n: f64) -> Image {
    let means = pixels.iter().map(|p| p.0).collect();
    Image {
        errors: Some(pixels.iter().map(|p| p.1).collect()),
        samples: Some(vec![n; pixels.len()]),
        ..Image::plain(pixels.len() as u32, 1, means)
    }
}

/// An image without errors.
fn reference(means: &[f64]) -> Image {
    Image::plain(means.len() as u32, 1, means.to_vec())
}

/// Renders an image of the given weights.
pub fn render(
    size: (u32, u32),
    n: u32,
    mut weight: impl FnMut(u32, u32) -> f64,
) -> Image {
    let mut weights = |x, y| (0..n).map(|_| weight(x, y)).collect();
    with_own_errors(&image_of(size, &mut weights))
}

/// The image of a film, whose pixels do not borrow from their neighbours.
fn with_own_errors(film: &Film) -> Image {
    let errors = Some(film.errors(0., film.window));
    Image { errors, ..unnamed(film).image() }
}

/// The weight of a path: a power of 0.8, or nothing.
fn path(random: &mut Random) -> f64 {
    let mut weight = 0.8;
    loop {
        match random.random::<f64>() {
            x if x < 0.2 => return weight,
            x if x < 0.3 || weight < 0.05 => return 0.,
            _ => weight *= 0.8,
        }
    }
}

/// A normal variable of variance 1 (Box and Muller 1958).
fn normal(random: &mut Random) -> f64 {
    let radius = f64::sqrt(-2. * (1. - random.random::<f64>()).ln());
    radius * (std::f64::consts::TAU * random.random::<f64>()).cos()
}

fn failures(difference: &Difference) -> [usize; 3] {
    difference.scales.map(|scale| scale.failed)
}

/// The share of each test is 1 - 0.99^(1/4); the quantiles of it are
/// computed with 15 digits by another program.
#[test]
fn the_thresholds_are_those_of_student_and_of_the_normal_distribution() {
    let image = |z, error| row(&[(z, error)], 16.);
    let many = |z| Image { samples: None, ..image(z, 1.) };
    let (half, none) = (f64::sqrt(0.5), reference(&[0.]));
    for [least, more, other] in [
        [image(3.2984, half), image(3.2985, half), image(0., half)],
        [image(3.6220, 1.), image(3.6221, 1.), none.clone()],
        [many(3.0222), many(3.0223), none.clone()],
    ] {
        assert!(compare(&least, &other).unwrap().consistent());
        assert!(!compare(&more, &other).unwrap().consistent());
    }
    // With one degree of freedom, p = 1 - 2 atan(z) / pi.
    let few = |z| {
        let a = row(&[(z, 1.)], 2.);
        failures(&compare(&a, &none).unwrap())
    };
    let level = -f64::exp_m1(0.99f64.ln() / 4.);
    let z = (FRAC_PI_2 * level).tan().recip();
    assert_eq!(few(z * 0.9999), [0; 3]);
    assert_eq!(few(z * 1.0001), [0, 1, 1]);
}

/// A weight that is 1 with the probability `p`, and else 0.
pub fn coin(p: f64) -> impl Fn(&mut Random) -> f64 {
    move |random| f64::from(u8::from(random.random_bool(p)))
}

/// Draws a weight.
type Weight<'a> = &'a dyn Fn(&mut Random) -> f64;

/// With the probability 0.01 of an alarm, 1000 pairs give more than 23
/// alarms once in ten thousand times. The last second image is exact.
#[test]
fn false_alarms_are_as_rare_as_promised() {
    assert_eq!(FALSE_ALARMS, 0.01);
    let (rare, tenth) = (coin(0.02), coin(0.1));
    let weights: [(u32, u32, Weight); 5] = [
        (16, 16, &normal),
        (16, 64, &path),
        (2, 2, &path),
        (16, 64, &rare),
        (16, 0, &tenth),
    ];
    for (case, (n, m, weight)) in weights.into_iter().enumerate() {
        let mut random = Random::seed_from_u64(2026);
        let mut alarm = || {
            let size = (24, 24);
            let a = render(size, n, |_, _| weight(&mut random));
            let b = match m {
                0 => Image::plain(24, 24, vec![0.1; 576]),
                m => render(size, m, |_, _| weight(&mut random)),
            };
            !compare(&a, &b).unwrap().consistent()
        };
        let alarms = (0..1000).filter(|_| alarm()).count();
        assert!(alarms <= 23, "{alarms} false alarms in case {case}");
        // A test that never fails tests nothing.
        assert!(case > 0 || alarms > 0);
    }
}

/// A bias of one percent, opposite faults of two halves, and a wrong pixel.
#[test]
fn a_fault_is_found_on_its_scale_alone() {
    let mut random = Random::seed_from_u64(5);
    let mut weight = |_, _| coin(0.5)(&mut random);
    let [a, b] = [(); 2].map(|()| render((128, 96), 64, &mut weight));
    assert!(compare(&a, &b).unwrap().consistent());
    let changed = |change: &dyn Fn(usize, f64) -> f64| {
        let means = b.means.iter().enumerate();
        let means = means.map(|(i, &mean)| change(i, mean)).collect();
        compare(&a, &Image { means, ..b.clone() }).unwrap()
    };
    let biased = changed(&|_, mean| 1.01 * mean);
    assert_eq!(failures(&biased), [0, 0, 1]);
    assert!(!biased.consistent());
    let side = |i: usize| if i % 128 < 64 { 0.02 } else { -0.02 };
    let halves = changed(&|i, mean| mean + side(i));
    let [pixels, blocks, film] = failures(&halves);
    assert!(pixels == 0 && blocks > 5 && film == 0, "{blocks}");
    let at = 7 * 128 + 31;
    let wrong = |i| f64::from(u8::from(i == at));
    let single = changed(&|i, mean| mean + wrong(i));
    assert_eq!(failures(&single), [1, 0, 0]);
    let (z, x, y) = single.scales[0].largest;
    assert!((x, y) == (31, 7) && z < -9., "{z} at {x},{y}");
    assert!(single.z[at] < -9.);
}

/// Two images of which the second states `factor` of its errors.
fn understated(factor: f64, mut weight: impl FnMut() -> f64) -> Difference {
    let a = render((160, 120), 16, |_, _| weight());
    let mut b = render((160, 120), 16, |_, _| weight());
    b.errors.iter_mut().flatten().for_each(|error| *error *= factor);
    compare(&a, &b).unwrap()
}

#[test]
fn errors_that_are_too_small_are_found_by_their_test_alone() {
    for (factor, expected) in
        [(0.8, f64::sqrt(2. / 1.64)), (1., 1.), (3., f64::sqrt(0.2))]
    {
        let mut random = Random::seed_from_u64(8);
        let difference = understated(factor, || normal(&mut random));
        assert_eq!(failures(&difference), [0, 0, 0]);
        let Dispersion { ratio, z, failed, pixels } = difference.dispersion;
        assert!((ratio - expected).abs() < 0.03, "{ratio}");
        let small = factor < 1.;
        assert_eq!((failed, z > 10., pixels), (small, small, 19_200));
        assert_eq!(difference.consistent(), !small);
    }
}

/// The squares of z are a third more than those of normal weights
/// here; the test must not take this for wrong errors.
#[test]
fn seldom_weights_have_no_larger_dispersion() {
    let mut random = Random::seed_from_u64(8);
    let mut rare = || coin(0.02)(&mut random);
    let found = understated(1., &mut rare).dispersion;
    assert!((found.ratio - 1.).abs() < 0.03 && !found.failed, "{found:?}");
    assert!(understated(0.8, &mut rare).dispersion.failed);
}

#[test]
fn exact_pixels_must_be_equal() {
    let exact = row(&[(1., 0.), (0.5, 0.1)], 64.);
    assert!(compare(&exact, &exact).unwrap().consistent());
    let other = row(&[(0.9, 0.), (0.5, 0.1)], 64.);
    assert_eq!(failures(&compare(&exact, &other).unwrap()), [1, 0, 0]);
    let rounded = row(&[(1. + 1e-7, 0.), (0.5, 0.1)], 64.);
    assert!(compare(&exact, &rounded).unwrap().consistent());
}

#[test]
fn pixels_of_unknown_error_or_few_samples_are_counted() {
    let mut a = row(&[(0.5, f64::INFINITY), (0.5, 0.1), (0.5, 0.1)], 64.);
    a.samples.as_mut().unwrap()[1] = FEW - 1.;
    let mut b = row(&[(0.1, 0.1), (0.5, 0.1), (0.5, 0.1)], 64.);
    let difference = compare(&a, &b).unwrap();
    assert_eq!((difference.unknown, difference.few), (1, 1));
    assert_eq!(difference.scales.map(|s| s.tested), [1, 1, 1]);
    assert_eq!(difference.z[0], 0.);
    assert!(difference.consistent());
    b.errors = Some(vec![f64::INFINITY; 3]);
    assert!(compare(&a, &b).unwrap_err().to_string().contains("unknown"));
}

#[test]
fn what_cannot_be_compared_is_refused_and_what_is_identical_is_not() {
    let (a, b) = (row(&[(0., 1.)], 9.), row(&[(0., 1.); 2], 9.));
    assert!(compare(&a, &b).unwrap_err().to_string().contains("1x1"));
    for means in [[0., 1.], [0.5, f64::NAN], [f64::NAN; 2]] {
        let image = reference(&means);
        let difference = compare(&image, &image).unwrap();
        assert!(difference.identical && difference.consistent());
        assert_eq!(difference.z, [0., 0.]);
        let other = reference(&[means[0], 1e-300]);
        let fault = compare(&image, &other).unwrap_err().to_string();
        assert!(fault.contains("neither image has error estimates"));
    }
}

#[test]
fn the_distances_are_those_of_their_definitions() {
    let (a, b) = (row(&[(0.3, 1.), (0., 1.)], 9.), reference(&[0.1, 0.2]));
    let difference = compare(&a, &b).unwrap();
    assert!((difference.rmse - 0.2).abs() < 1e-12);
    let relative = (0.04 / 0.02 + 0.04 / 0.05) / 2.;
    assert!((difference.relative_mse - relative).abs() < 1e-12);
}

#[test]
fn what_is_cut_out_is_its_surface_alone_and_gaps_remain() {
    let opacity = vec![0.5, 0.5, 0., 1.];
    let image = Image {
        more: vec![(OPACITY, opacity)],
        ..Image::plain(4, 1, vec![f64::NAN, 0.5, 0.25, 0.75])
    };
    let means = cut_out(image, 0.25).means;
    assert!(means[0].is_nan());
    assert_eq!(means[1..], [0.75, 0.25, 0.75]);
}

#[test]
fn exposure_counts_in_stops_and_reinhard_s_curve_reaches_white() {
    for (means, stops, curve, expected) in [
        (&[0.25, -1.][..], 1., Curve::Clamp, &[0.5, 0.][..]),
        (&[0.25, -1.], -1., Curve::Clamp, &[0.125, 0.]),
        (&[0.25, 1., 0.], 2., Curve::Reinhard, &[17. / 32., 1., 0.]),
        (&[0.], 2., Curve::Reinhard, &[0.]),
    ] {
        let mapped = tonemap(&reference(means), stops, curve).means;
        assert_eq!(mapped, expected);
    }
    // A gap stays one, which the file of levels fills.
    let other = Image::plain(2, 1, vec![f64::NAN, 0.25]);
    let gap = Image { samples: Some(vec![0., 1.]), ..other.clone() };
    for curve in [Curve::Clamp, Curve::Reinhard] {
        assert!(tonemap(&gap, 1., curve).means[0].is_nan());
        assert_eq!(tonemap(&other, 1., curve).means[0], 0.);
    }
}

#[test]
fn errors_are_shown_against_all_but_the_largest() {
    let mut pixels = vec![(0.5, 0.1); 2000];
    let odd = [(0.5, 9.), (0.5, f64::INFINITY), (0., 0.)];
    pixels[..3].copy_from_slice(&odd);
    let image = row(&pixels, 9.);
    let (grey, white) = errors(&image, false).unwrap();
    assert_eq!(white, 0.1);
    assert_eq!(grey.means[..4], [1., 1., 0., 1.]);
    let (_, white) = errors(&image, true).unwrap();
    assert_eq!(white, 0.2);
    assert!(errors(&reference(&[0.]), false).is_err());
    assert!(errors(&row(&[(0., f64::INFINITY)], 1.), false).is_err());
}

#[test]
fn the_map_of_z_is_mid_grey_where_nothing_differs() {
    let a = row(&[(0., 0.), (1., 0.1), (2., 0.)], 64.);
    let b = row(&[(0., 0.), (1. + 0.1 * WHITE, 0.), (1., 0.)], 64.);
    let difference = compare(&a, &b).unwrap();
    let grey = z_map(&a, &difference, true).means;
    assert!((grey[0] - 0.21404).abs() < 1e-5, "{}", grey[0]);
    assert!(grey[1].abs() < 1e-9 && grey[2] == 1., "{grey:?}");
    let numbers = z_map(&a, &difference, false).means;
    assert!((numbers[1] + WHITE).abs() < 1e-9);
    assert_eq!((numbers[0], numbers[2]), (0., f64::from(f32::MAX)));
}

/// Two images of 40x20 pixels, or a part of one, of which the first has
/// tiles of these errors; and their comparison.
fn tiled(error: f64, replicate: &str, crop: Option<&str>) -> Difference {
    let b = render((40, 20), 2, |_, _| 0.5);
    let mut a = Image {
        samples: Some(vec![256.; 800]),
        errors: Some(vec![0.1; 800]),
        tile_errors: Some(vec![error; 800]),
        ..b.clone()
    };
    a.attributes.insert("replicate".into(), replicate.into());
    a.attributes.extend(crop.map(|crop| ("crop".into(), crop.into())));
    let b = Image { errors: None, samples: None, ..b };
    compare(&a, &b).unwrap()
}

/// The variance is the sum of the squares; tiles of m pixels have
/// m^2 u^4 / 15 of the fourth order. The tiles of the image are 16, 16 and 8
/// wide, 16 and 4 high; those of the part 2, 16, 16, 6 and 11, 9.
#[test]
fn a_tile_has_one_variance_of_as_many_values_as_replicates() {
    let tiles = |columns: &[f64], rows: &[f64]| -> f64 {
        let squares = |s: &[f64]| s.iter().map(|n| n * n).sum::<f64>();
        squares(columns) * squares(rows)
    };
    let whole = tiles(&[16., 16., 8.], &[16., 4.]);
    let part = tiles(&[2., 16., 16., 6.], &[11., 9.]);
    for (crop, blocks, tiles) in
        [(None, 6, whole), (Some("30,5,40x20"), 8, part)]
    {
        let Difference { sum, scales, .. } = tiled(0.3, "16", crop);
        assert!((sum.variance / (800. * 0.09) - 1.).abs() < 1e-12);
        let freedom = 15. * 800. * 800. / tiles;
        assert!((sum.freedom() / freedom - 1.).abs() < 1e-12, "{freedom}");
        assert_eq!(scales.map(|s| s.tested), [800, blocks, 1]);
    }
}

#[test]
fn a_pixel_is_tested_by_itself_if_it_has_enough_replicates() {
    let tested = |replicate| {
        let difference = tiled(0.3, replicate, None);
        (difference.scales[0].tested, difference.few)
    };
    assert_eq!(tested("16"), (800, 0));
    assert_eq!(tested("32"), (0, 800));
    for unknown in ["", "0", "-1", "x"] {
        assert_eq!(tested(unknown), (800, 0), "{unknown}");
    }
}

/// An image whose pixels are normal, of `n` values, and share half of their
/// variance in each tile.
fn shared(
    (width, height): (u32, u32),
    n: u32,
    random: &mut Random,
) -> Image {
    let mut film = Film::new(width, height).with_shared_tiles();
    for FilmTile { pixels, mut mean, .. } in film.tiles() {
        for _ in 0..n {
            let (common, mut sum) = (normal(random), 0.);
            for pixel in &mut *pixels {
                let value = common + normal(random);
                pixel.add(value);
                sum += value;
            }
            mean.as_mut().unwrap().add(sum / pixels.len() as f64);
        }
    }
    with_own_errors(&film)
}

/// With the probability 0.01 of an alarm, 300 pairs give more than 11 alarms
/// once in ten thousand times.
#[test]
fn false_alarms_are_rare_for_pixels_that_share_random_numbers() {
    let mut random = Random::seed_from_u64(10);
    let (mut alarms, mut believed, mut small) = (0, 0, 0);
    for _ in 0..300 {
        let pair = [(); 2].map(|()| shared((56, 40), 8, &mut random));
        let inconsistent = |[a, b]: &[Image; 2]| {
            u32::from(!compare(a, b).unwrap().consistent())
        };
        alarms += inconsistent(&pair);
        let smaller = |mut image: Image| {
            let errors = image.tile_errors.iter_mut().flatten();
            errors.for_each(|error| *error *= 0.2);
            image
        };
        small += inconsistent(&pair.clone().map(smaller));
        let bare = pair.map(|image| Image { tile_errors: None, ..image });
        believed += inconsistent(&bare);
    }
    assert!(alarms <= 11, "{alarms} false alarms of 300 pairs");
    assert!(believed > 250, "{believed} of 300 pairs without tiles");
    assert!(small > 250, "{small} of 300 pairs with errors too small");
}

/// In each tile the squares are four times the variances: X is alike in the
/// four tiles, and t its largest value, 2; 49 tiles have 7.
#[test]
fn the_dispersion_of_shared_pixels_is_judged_by_tiles() {
    for (side, z) in [(32, 2.), (112, 7.)] {
        let sign = |i: u32| {
            if (i + i / side).is_multiple_of(2) { 0.2 } else { -0.2 }
        };
        let area = (side * side) as usize;
        let means = (0..side * side).map(sign).collect();
        let a = Image {
            errors: Some(vec![0.1; area]),
            tile_errors: Some(vec![0.1; area]),
            samples: Some(vec![1e9; area]),
            ..Image::plain(side, side, means)
        };
        let b = Image::plain(side, side, vec![0.; area]);
        let Dispersion { ratio, z: t, failed, .. } =
            compare(&a, &b).unwrap().dispersion;
        assert!((ratio - 2.).abs() < 1e-12 && (t - z).abs() < 1e-9, "{t}");
        assert_eq!(failed, z > 2.81);
        let bare = Image { tile_errors: None, ..a };
        assert!(compare(&bare, &b).unwrap().dispersion.failed);
    }
}
