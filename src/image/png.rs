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

use png::{BitDepth, ColorType, Compression, Decoder, Encoder};
use png::{SrgbRenderingIntent, Transformations};

use super::data::{Image, Means, room};
use super::levels::levels;
use super::srgb::{luminance, radiance};

/// Writes the means as 65536 levels, encoded by the sRGB curve.
pub fn write(image: &dyn Means, out: &mut dyn Write) -> io::Result<()> {
    let (width, height) = image.size();
    let mut encoder = Encoder::new(out, width, height);
    // Declare grey levels of the sRGB curve
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Sixteen);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    if width * height > LARGE {
        encoder.set_compression(Compression::Fast);
    }
    let mut writer = encoder.write_header()?;
    let mut stream = writer.stream_writer_with_size(1 << 20)?;
    let mut bytes = Vec::new();
    levels(image, u16::MAX, |levels| {
        bytes.resize(levels.len(), [0; 2]);
        let pairs = bytes.iter_mut().zip(levels);
        pairs.for_each(|(pair, level)| *pair = level.to_be_bytes());
        stream.write_all(bytes.as_flattened())
    })?;
    stream.finish()?;
    writer.finish()?;
    Ok(())
}

/// Pixels of an image from which on speed counts more than size.
const LARGE: u32 = 1 << 22;

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
