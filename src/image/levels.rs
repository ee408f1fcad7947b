// Tangled from chapters/image.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From radiance to the grey levels of a screen, and back.

use std::io;

use rayon::prelude::*;

use super::data::Source;

/// The level of a radiance when `white` is the highest level, by the
/// curve of sRGB (IEC 61966-2-1).
pub fn level(radiance: f64, white: u16) -> u16 {
    let encoded = match radiance <= 0.0031308 {
        true => 12.92 * radiance,
        false => 1. + 1.055 * (libm::pow(radiance, 1. / 2.4) - 1.),
    };
    (encoded.clamp(0., 1.) * f64::from(white)).floor() as u16
}

/// The radiance that is encoded as `encoded`, both in [0, 1].
pub fn radiance(encoded: f64) -> f64 {
    match encoded <= 0.04045 {
        true => encoded / 12.92,
        false => libm::pow((encoded + 0.055) / 1.055, 2.4),
    }
}

/// The mean of a pixel: of red, green and blue the luminance (Rec. ITU-R
/// BT.709). Its last number may be its opacity.
pub fn mean(pixel: &[f64]) -> f64 {
    match *pixel {
        [r, g, b, ..] => 0.2126 * r + 0.7152 * g + 0.0722 * b,
        _ => pixel[0],
    }
}

/// The level that is written as these bytes, the most significant first.
pub fn whole(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |sum, &byte| 256 * sum + u32::from(byte))
}

/// What a reader is told of a file that has colours.
pub const COLOURS: &str = "it has colours, of which the luminance is \
     taken (0.2126 R + 0.7152 G + 0.0722 B)";

/// What a reader is told of levels, before their curve.
pub const LEVELS: &str = "it holds grey levels, or colours, of which the \
     luminance is taken; they are read by";

/// Width and height of a square in pixels.
const SIDE: usize = 16;

/// Hands the means of the rows of each row of squares to `work`, of which
/// one in `step` is enough.
fn by_squares(
    image: &dyn Source,
    step: usize,
    mut work: impl FnMut(&[f64]) -> io::Result<()>,
) -> io::Result<()> {
    let window = image.window();
    let rows = Vec::from_iter(0..window.size.1);
    rows.chunks(SIDE).try_for_each(|rows| {
        let rows = rows.par_iter().step_by(step);
        let means = rows.flat_map_iter(|&y| image.means(window.rows(y, 1)));
        work(&means.collect::<Vec<_>>())
    })
}

/// The mean of each square, row by row, or of what is around it; empty if
/// there are no gaps.
fn fill(image: &dyn Source) -> io::Result<Vec<f64>> {
    if image.sampled(image.window()) == Some(true) {
        return Ok(vec![]);
    }
    let width = image.window().size.0 as usize;
    let columns = width.div_ceil(SIDE);
    let mut squares = vec![];
    by_squares(image, 4, |means| {
        // Sum the means of each square
        let sums = (0..columns).into_par_iter().map(|k| {
            let rows = means.chunks(width).map(|row| &row[k * SIDE..]);
            let own = rows.flat_map(|row| row.iter().take(SIDE));
            own.filter(|mean| !mean.is_nan())
                .fold((0., 0.), |(sum, n), mean| (sum + mean, n + 1.))
        });
        squares.par_extend(sums);
        Ok(())
    })?;
    fill_gaps(&mut squares, columns);
    Ok(squares.iter().map(|(sum, count)| sum / count).collect())
}

/// Gives each square without a mean the sums of the larger one around it.
fn fill_gaps(squares: &mut [(f64, f64)], columns: usize) {
    let half = columns.div_ceil(2);
    let around = |i: usize| i / columns / 2 * half + i % columns / 2;
    if squares.len() == 1 {
        return;
    }
    let mut larger = vec![(0., 0.); around(squares.len() - 1) + 1];
    // Add the sums to those of larger squares
    for (i, (sum, count)) in squares.iter().enumerate() {
        let (all, number) = &mut larger[around(i)];
        (*all, *number) = (*all + sum, *number + count);
    }
    fill_gaps(&mut larger, half);
    for (i, square) in squares.iter_mut().enumerate() {
        if square.1 == 0. {
            *square = larger[around(i)];
        }
    }
}

/// Hands the levels of the pixels, encoded by the sRGB curve, to `write`,
/// some rows at a time; `white` is the highest level.
pub fn levels(
    image: &dyn Source,
    white: u16,
    mut write: impl FnMut(&[u16]) -> io::Result<()>,
) -> io::Result<()> {
    let width = image.window().size.0 as usize;
    let (mut all, columns) = (vec![0; SIDE * width], width.div_ceil(SIDE));
    let fill = fill(image)?;
    let fill: Vec<_> = fill.iter().map(|&x| level(x, white)).collect();
    let mut fill = fill.chunks(columns);
    by_squares(image, 1, |means| {
        let fill = fill.next().unwrap_or_default();
        // Turn some rows into levels
        let rows = all.par_chunks_mut(width).zip(means.par_chunks(width));
        rows.for_each(|(levels, means)| {
            let squares = levels.chunks_mut(SIDE).zip(means.chunks(SIDE));
            for (k, (levels, means)) in squares.enumerate() {
                for (own, &mean) in levels.iter_mut().zip(means) {
                    *own = match mean.is_nan() {
                        true => fill[k],
                        false => level(mean, white),
                    };
                }
            }
        });
        write(&all[..means.len()])
    })
}
