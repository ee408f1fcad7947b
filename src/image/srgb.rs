// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! From radiance to the grey levels of a screen.

/// The sRGB encoding of a radiance, both in [0, 1] (IEC 61966-2-1).
fn srgb(radiance: f64) -> f64 {
    let encoded = if radiance <= 0.0031308 {
        12.92 * radiance
    } else {
        1. + 1.055 * (libm::pow(radiance, 1. / 2.4) - 1.)
    };
    encoded.clamp(0., 1.)
}

/// The level of a radiance when `white` is the highest level.
pub fn level(radiance: f64, white: u16) -> u16 {
    (srgb(radiance) * f64::from(white)).floor() as u16
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

/// What a reader is told of a file that has colours.
pub const COLOURS: &str = "it has colours, of which the luminance is \
     taken (0.2126 R + 0.7152 G + 0.0722 B)";

/// What a reader is told of levels, before their curve.
pub const LEVELS: &str = "it holds grey levels, or colours, of which the \
     luminance is taken; they are read by";

/// The level that is written as these bytes, the most significant first.
pub fn whole(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |sum, &byte| 256 * sum + u32::from(byte))
}
