// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The plain portable greymap.

use std::io::{self, Write};

use super::data::Image;
use super::srgb::level;

/// Writes the means as 256 levels, encoded by the sRGB curve.
pub fn write(image: &Image, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "P2 {} {}\n255", image.width, image.height)?;
    let mut means = image.means.iter();
    means.try_for_each(|&mean| writeln!(out, "{}", level(mean, 255)))
}
