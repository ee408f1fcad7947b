// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The portable float map: one 32-bit number per pixel, bottom row
//! first.

use std::io::{self, Write};

use rayon::prelude::*;

use super::data::{Image, Note, Source};
use super::pgm::{raster, word};
use super::srgb::{COLOURS, mean};

/// Writes the means, as numbers of least significant byte first.
pub fn write(image: &dyn Source, out: &mut dyn Write) -> io::Result<()> {
    let (width, height) = image.size();
    write!(out, "Pf\n{width} {height}\n-1.0\n")?;
    for rows in Vec::from_iter((0..height).rev()).chunks(16) {
        let rows = rows.par_iter().map(|&y| {
            let mut means = vec![0.; width as usize];
            image.row(y, &mut means);
            let bytes = means.iter().map(|&x| (x as f32).to_le_bytes());
            bytes.collect::<Vec<_>>()
        });
        let rows: Vec<_> = rows.collect();
        rows.iter()
            .try_for_each(|row| out.write_all(row.as_flattened()))?;
    }
    Ok(())
}

/// Reads a map of one number per pixel, or of three or four, whose
/// luminance is taken; `bytes` is the whole file. `note` is told of
/// colours, and of bytes after the numbers.
///
/// # Errors
/// The header is not that of such a map, or there are fewer numbers than
/// it says.
pub fn read(mut bytes: &[u8], note: Note) -> Result<Image, String> {
    let mut text = || std::str::from_utf8(word(&mut bytes)?).ok();
    let mut next = || text().ok_or("its header is damaged");
    let (kind, width, height, scale) = (next()?, next()?, next()?, next()?);
    // Take the size and the unit from the header
    let kinds = ["Pf", "", "PF", "PF4"];
    let at = kinds.iter().position(|other| *other == kind);
    let channels = 1 + at.ok_or(format!("its kind is {kind}, not PF"))?;
    let side = |text: &str| text.parse().ok().filter(|&n: &u32| n > 0);
    let size = side(width).zip(side(height));
    let (width, height) =
        size.ok_or(format!("its size is {width} by {height}"))?;
    let unit = scale.parse().ok().filter(|s: &f32| s.is_normal());
    let unit = unit.ok_or(format!("its scale is {scale}"))?;
    // Turn the rows of the map upside down
    let promised = u128::from(width) * u128::from(height);
    let promised = 4 * channels as u128 * promised;
    let words = raster(bytes, promised, note)?.as_chunks().0;
    let number = |&word: &[u8; 4]| match unit < 0. {
        true => f32::from_le_bytes(word),
        false => f32::from_be_bytes(word),
    };
    let number = |word| f64::from(number(word)) * f64::from(unit.abs());
    let numbers: Vec<f64> = words.iter().map(number).collect();
    let means: Vec<f64> = numbers.chunks(channels).map(mean).collect();
    let means = means.rchunks(width as usize).flatten().copied().collect();
    if channels > 1 {
        note(COLOURS);
    }
    Ok(Image::plain(width, height, means))
}
