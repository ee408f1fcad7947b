// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The portable network graphic, grey and of 16 bits.

use std::io::{self, Cursor, Write};

use png::{BitDepth, ColorType, Decoder, Encoder};
use png::{SrgbRenderingIntent, Transformations};

use super::data::{Image, room};
use super::srgb::{level, luminance, radiance};

/// Writes the means as 65536 levels, encoded by the sRGB curve.
pub fn write(image: &Image, out: &mut dyn Write) -> io::Result<()> {
    let mut encoder = Encoder::new(out, image.width, image.height);
    // Declare grey levels of the sRGB curve
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Sixteen);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    let bytes = |&mean| level(mean, u16::MAX).to_be_bytes();
    let bytes: Vec<u8> = image.means.iter().flat_map(bytes).collect();
    let mut writer = encoder.write_header().map_err(io::Error::from)?;
    writer.write_image_data(&bytes).map_err(io::Error::from)
}

/// Reads the levels back; `bytes` is the whole file.
///
/// # Errors
/// The file is damaged.
pub fn read(bytes: &[u8]) -> Result<Image, String> {
    let mut decoder = Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(Transformations::EXPAND);
    let fault = |error: png::DecodingError| error.to_string();
    let mut reader = decoder.read_info().map_err(fault)?;
    let size = reader.output_buffer_size();
    let size = size.filter(|&size| room(size as u128, bytes.len()));
    let mut levels = vec![0; size.ok_or("its size is a lie")?];
    let frame = reader.next_frame(&mut levels).map_err(fault)?;
    let wide = frame.bit_depth == BitDepth::Sixteen;
    let levels = radiances(&levels, wide);
    let means = levels.chunks(frame.color_type.samples());
    let means = means.map(mean).collect();
    Ok(Image::plain(frame.width, frame.height, means))
}

// Undo the curve for the levels of a PNG file
/// The radiances of levels of one or of two bytes.
fn radiances(levels: &[u8], wide: bool) -> Vec<f64> {
    let narrow = |&level: &u8| radiance(f64::from(level) / 255.);
    let pair = |&level: &[u8; 2]| {
        radiance(f64::from(u16::from_be_bytes(level)) / 65535.)
    };
    match wide {
        true => levels.as_chunks().0.iter().map(pair).collect(),
        false => levels.iter().map(narrow).collect(),
    }
}

/// The mean of a grey or coloured pixel, whose last number may be its
/// opacity.
fn mean(pixel: &[f64]) -> f64 {
    match *pixel {
        [r, g, b, ..] => luminance([r, g, b]),
        _ => pixel[0],
    }
}
