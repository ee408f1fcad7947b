// Licensed under the GPL, version 3 or later
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

use super::data::{Image, Means};
use super::srgb::luminance;

// Write a portable float map
/// Writes the means, as numbers of least significant byte first.
pub fn write(image: &dyn Means, out: &mut dyn Write) -> io::Result<()> {
    let (width, height) = image.size();
    write!(out, "Pf\n{width} {height}\n-1.0\n")?;
    let mut means = vec![0.; width as usize];
    for y in (0..height).rev() {
        image.row(y, &mut means);
        let bytes = means.iter().map(|&mean| (mean as f32).to_le_bytes());
        out.write_all(bytes.collect::<Vec<_>>().as_flattened())?;
    }
    Ok(())
}

// Read a portable float map
/// Reads a map of one number per pixel, or of three, whose luminance is
/// taken; `bytes` is the whole file.
///
/// # Errors
/// The header is not that of such a map, or there are fewer or more
/// numbers than it says.
pub fn read(bytes: &[u8]) -> Result<Image, String> {
    let (header, data) = split(bytes).ok_or("its header is damaged")?;
    // Take the size and the unit from the header
    let [width, height, scale] = header;
    let side = |text: &str| text.parse().ok().filter(|&n: &u32| n > 0);
    let size = side(width).zip(side(height));
    let (width, height) =
        size.ok_or(format!("its size is {width} by {height}"))?;
    let unit = scale.parse().ok().filter(|s: &f32| s.is_normal());
    let unit = unit.ok_or(format!("its scale is {scale}"))?;
    // Compare the promised bytes with those present
    let colours = if bytes.starts_with(b"PF") { 3 } else { 1 };
    let promised = 4 * colours * u128::from(width) * u128::from(height);
    if data.len() as u128 != promised {
        return Err(format!(
            "it holds {} bytes of pixels, and its header says {promised}",
            data.len()
        ));
    }
    // Turn the rows of the map upside down
    let (words, _) = data.as_chunks::<4>();
    let number = |&word: &[u8; 4]| match unit < 0. {
        true => f32::from_le_bytes(word),
        false => f32::from_be_bytes(word),
    };
    let number = |word| f64::from(number(word)) * f64::from(unit.abs());
    let numbers: Vec<f64> = words.iter().map(number).collect();
    let means: Vec<f64> = match numbers.as_chunks() {
        (pixels, []) if colours == 3 => {
            pixels.iter().copied().map(luminance).collect()
        }
        _ => numbers,
    };
    let means = means.rchunks(width as usize).flatten().copied().collect();
    Ok(Image::plain(width, height, means))
}

/// The three words of the header after the first, and the numbers.
fn split(bytes: &[u8]) -> Option<([&str; 3], &[u8])> {
    let mut rest = bytes.get(2..)?;
    let mut word = || {
        rest = rest.trim_ascii_start();
        let end = rest.iter().position(u8::is_ascii_whitespace)?;
        let (word, after) = rest.split_at(end);
        rest = after;
        std::str::from_utf8(word).ok()
    };
    let header = [word()?, word()?, word()?];
    Some((header, &rest[1..]))
}
