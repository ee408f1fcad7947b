// Tangled from chapters/image.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From radiance to the grey levels of a screen, and back.

use std::borrow::Cow;
use std::io::{self, Write};

use glam::DVec2;
use rayon::prelude::*;

use super::data::{BANDS, Image, OPACITY, Source, write_rows};
use crate::film::SIDE;

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

/// The value of a pixel: the luminance of red, green and blue (Rec. ITU-R
/// BT.709), or its first number. The last may be an opacity.
pub fn luminance(pixel: &[f64]) -> f64 {
    match *pixel {
        [r, g, b, ..] => 0.2126 * r + 0.7152 * g + 0.0722 * b,
        _ => pixel[0],
    }
}

/// The number in these bytes, the most significant first.
pub fn whole(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |sum, &byte| 256 * sum + u32::from(byte))
}

/// The note on a file with colours.
pub const COLOURS: &str = "it has colours, of which the luminance is \
     taken (0.2126 R + 0.7152 G + 0.0722 B)";

/// The note on levels, without the name of their curve.
pub const LEVELS: &str = "it holds grey levels, or colours, of which the \
     luminance is taken; they are read by";

impl Image {
    /// The numbers of each pixel that are shown, as radiances: one, or three
    /// bands; and an opacity, if there is one.
    pub fn shown(&self) -> Vec<Cow<'_, [f64]>> {
        let bands = BANDS.iter().filter_map(|name| self.channel(name));
        let mut shown: Vec<Cow<'_, [f64]>> = bands.map(Cow::from).collect();
        if shown.is_empty() {
            shown.push((&self.means).into());
        }
        let opacity = self.channel(OPACITY).into_iter();
        let opacity = opacity.map(|list| list.iter().map(|&a| radiance(a)));
        shown.extend(opacity.map(|list| Cow::Owned(list.collect())));
        shown
    }
}

/// The mean of each square, row by row, or of its surroundings.
fn fill(image: &dyn Source) -> Vec<f64> {
    let window = image.window();
    let (width, height) = window.size;
    let columns = width.div_ceil(SIDE) as usize;
    let tops = (0..height).into_par_iter().step_by(SIDE as usize);
    let squares = tops.flat_map_iter(|top| {
        let mut squares = vec![DVec2::ZERO; columns];
        let rows = (top..height.min(top + SIDE)).step_by(4);
        let means = rows.flat_map(|y| {
            let row = image.part(window.rows(y, 1), false);
            row.means.into_iter().enumerate()
        });
        for (x, mean) in means.filter(|(_, mean)| !mean.is_nan()) {
            squares[x / SIDE as usize] += DVec2::new(mean, 1.);
        }
        squares
    });
    let mut squares: Vec<_> = squares.collect();
    fill_gaps(&mut squares, columns);
    squares.iter().map(|square| square.x / square.y).collect()
}

/// Gives each square without a mean the sums of the larger one around it.
fn fill_gaps(squares: &mut [DVec2], columns: usize) {
    let half = columns.div_ceil(2);
    let around = |i: usize| i / columns / 2 * half + i % columns / 2;
    if squares.len() == 1 {
        return;
    }
    let mut larger = vec![DVec2::ZERO; around(squares.len() - 1) + 1];
    for (i, &square) in squares.iter().enumerate() {
        larger[around(i)] += square;
    }
    fill_gaps(&mut larger, half);
    for (i, square) in squares.iter_mut().enumerate() {
        if square.y == 0. {
            *square = larger[around(i)];
        }
    }
}

/// Writes the levels of the pixels: of the means, or of `all` that a screen
/// shows. They are encoded by the sRGB curve, with `white` as the highest,
/// and then by `encode`.
pub fn write_levels<B: IntoIterator<Item = u8>>(
    image: &dyn Source,
    all: bool,
    white: u16,
    encode: impl Fn(u16) -> B + Sync,
    out: &mut dyn Write,
) -> io::Result<()> {
    let (width, height) = image.window().size;
    let fill = fill(image);
    let row = |y, part: Image| -> Vec<u8> {
        let first = y / SIDE * width.div_ceil(SIDE);
        let or_filled = |x: u32, value: f64| match value.is_nan() {
            true => fill[(first + x / SIDE) as usize],
            false => value,
        };
        let shown = part.shown();
        let (mut bytes, mut last) = (vec![], (0., 0));
        for x in 0..width {
            for list in &shown {
                let value = or_filled(x, list[x as usize]);
                if value != last.0 {
                    last = (value, level(value, white));
                }
                bytes.extend(encode(last.1));
            }
        }
        bytes
    };
    write_rows(image, &Vec::from_iter(0..height), all, row, out)
}
