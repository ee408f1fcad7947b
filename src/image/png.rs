// Tangled from chapters/image.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The portable network graphic of 16 bits, grey or of three bands.

use std::io::{self, Cursor, Write};

use png::{BitDepth, ColorType, Compression, Decoder, Encoder, Info};
use png::{SrgbRenderingIntent, Transformations};

use super::data::{Image, Note, Source, room};
use super::levels::{LEVELS, luminance, radiance, whole, write_levels};
use crate::error::Result;
use crate::film::Window;

/// Writes what a screen shows in 65536 levels, encoded by the sRGB curve.
pub fn write(image: &dyn Source, out: &mut dyn Write) -> io::Result<()> {
    let (width, height) = image.window().size;
    let mut encoder = Encoder::new(out, width, height);
    let pixel = image.part(Window { size: (1, 1), ..image.window() }, true);
    let numbers = pixel.shown().len();
    encoder.set_color(match numbers {
        1 => ColorType::Grayscale,
        2 => ColorType::GrayscaleAlpha,
        3 => ColorType::Rgb,
        _ => ColorType::Rgba,
    });
    encoder.set_depth(BitDepth::Sixteen);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    if width * height > 1 << 22 {
        encoder.set_compression(Compression::Fast);
    }
    let mut writer = encoder.write_header()?;
    let mut stream = writer.stream_writer_with_size(1 << 20)?;
    let levels = u16::to_be_bytes;
    write_levels(image, numbers > 1, u16::MAX, levels, &mut stream)?;
    stream.finish()?;
    writer.finish()?;
    Ok(())
}

/// Reads the levels back; `bytes` is the whole file. `note` receives their
/// curve.
///
/// # Errors
/// The file is damaged.
pub fn read(bytes: &[u8], note: Note) -> Result<Image> {
    let mut decoder = Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(Transformations::EXPAND);
    let fault = |error: png::DecodingError| error.to_string();
    let mut reader = decoder.read_info().map_err(fault)?;
    let size = reader.output_buffer_size();
    let size = size.filter(|&size| room(size as u128, bytes.len()));
    let mut levels = vec![0; size.ok_or("header size exceeds the file")?];
    let gamma = gamma(reader.info(), note);
    let frame = reader.next_frame(&mut levels).map_err(fault)?;
    let wide = frame.bit_depth == BitDepth::Sixteen;
    let (size, white) = if wide { (2, 65535.) } else { (1, 255.) };
    let levels = levels.chunks(size).map(|l| f64::from(whole(l)) / white);
    let levels: Vec<f64> = match gamma {
        Some(gamma) => levels.map(|l| libm::pow(l, 1. / gamma)).collect(),
        None => levels.map(radiance).collect(),
    };
    let means = levels.chunks(frame.color_type.samples());
    let means = means.map(luminance).collect();
    Ok(Image::plain(frame.width, frame.height, means))
}

/// The exponent of the levels, 1 if they are proportional to radiance;
/// none if their curve is sRGB's.
fn gamma(info: &Info, note: Note) -> Option<f64> {
    let said = info.coding_independent_code_points;
    let coded = said.filter(|c| c.is_video_full_range_image);
    let coded =
        coded.map(|c| c.transfer_function).filter(|c| [8, 13].contains(c));
    let gamma = info.gama_chunk.map(|g| f64::from(g.into_scaled()) / 1e5);
    let gamma = gamma.filter(|gamma| (0.01..=100.).contains(gamma));
    // Report the chunks that are ignored
    for (kind, is_there, is_taken) in [
        ("cICP", said.is_some(), coded.is_some()),
        ("iCCP", info.icc_profile.is_some(), coded.is_some()),
        ("gAMA", info.gama_chunk.is_some(), gamma.is_some()),
    ] {
        if is_there && !is_taken {
            note(&format!("its chunk {kind} is ignored"));
        }
    }
    let gamma = match (coded, info.srgb) {
        (Some(8), _) => Some(1.),
        (None, None) => gamma,
        _ => None,
    };
    let curve = gamma.map(|gamma| format!("a gamma of {gamma}"));
    let curve = curve.unwrap_or_else(|| "the sRGB curve".to_owned());
    note(&format!("{LEVELS} {curve}"));
    gamma
}
