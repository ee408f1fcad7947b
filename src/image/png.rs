// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The portable network graphic, grey and of 16 bits.

use std::io::{self, Write};

use png::{BitDepth, ColorType, Encoder, SrgbRenderingIntent};

use super::data::Image;
use super::srgb::level;

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
