// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! A finished image in memory, and the formats of its files.
//!
//! Radiance is relative to that of the sky. Rows run from the top down,
//! each from left to right, whatever the order in a file.

mod data;
mod exr;
mod pfm;
mod pgm;
mod png;
pub(crate) mod srgb;

// Name what the image imports
use std::io::{self, Write};
use std::path::Path;

pub use data::Image;

// Choose among the image formats
/// How an image becomes bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Plain portable greymap of 256 levels
    Pgm,
    /// Portable network graphic of 65536 grey levels
    Png,
    /// Portable float map: the mean radiance
    Pfm,
    /// OpenEXR: mean radiance, its standard error, and the run
    Exr,
}

impl Format {
    /// Writes the bytes of an image.
    pub fn write(
        self,
        image: &Image,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        match self {
            Format::Pgm => pgm::write(image, out),
            Format::Png => png::write(image, out),
            Format::Pfm => pfm::write(image, out),
            Format::Exr => exr::write(image, out),
        }
    }

    // Tell the format from the extension
    /// The format of a file of this name.
    ///
    /// # Errors
    /// The extension belongs to no format.
    pub fn of(path: &Path) -> Result<Self, String> {
        match extension(path).as_deref() {
            Some("pgm") | None => Ok(Format::Pgm),
            Some("png") => Ok(Format::Png),
            Some("pfm") => Ok(Format::Pfm),
            Some("exr") => Ok(Format::Exr),
            Some(_) => Err(format!(
                "{}: unknown kind of image; name it .pgm, .png, .pfm or .exr",
                path.display()
            )),
        }
    }
}

/// The extension of a file's name, in small letters.
pub fn extension(path: &Path) -> Option<String> {
    let extension = path.extension()?.to_str()?;
    Some(extension.to_ascii_lowercase())
}

// Read an image back
impl Image {
    /// Reads a file of numbers: EXR or PFM.
    ///
    /// # Errors
    /// The file cannot be read, and those of [`Image::decode`]; the
    /// message names the file and the fault.
    pub fn read(path: &Path) -> Result<Self, String> {
        let name = path.display();
        let bytes = std::fs::read(path)
            .map_err(|error| format!("{name}: cannot read: {error}"))?;
        Self::decode(&bytes).map_err(|fault| format!("{name}: {fault}"))
    }

    // Decode the bytes of any image
    /// Reads an image from the bytes of its file.
    ///
    /// # Errors
    /// The bytes are damaged, or of another kind of file.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let image = match bytes.get(..2) {
            Some([0x76, 0x2f]) => exr::read(bytes),
            Some(b"Pf") => pfm::read(bytes),
            Some(b"PF") => Err("it has colours; use Pf, not PF".to_owned()),
            Some(b"P2" | b"P5" | b"\x89P") => {
                Err("it holds grey levels; use .exr or .pfm".to_owned())
            }
            _ => Err("it is neither EXR nor PFM".to_owned()),
        };
        image.and_then(Self::checked)
    }

    // Refuse numbers that mean nothing
    fn checked(self) -> Result<Self, String> {
        let empty = Vec::new();
        let errors = self.errors.as_ref().unwrap_or(&empty);
        let samples = self.samples.as_ref().unwrap_or(&empty);
        self.refuse("mean", &self.means, |x| x.is_finite())?;
        self.refuse("standard error", errors, |x| x >= 0.)?;
        self.refuse("count", samples, |x| x >= 0. && x.is_finite())?;
        Ok(self)
    }

    /// Names the first of the values that is not as it should be.
    fn refuse(
        &self,
        what: &str,
        values: &[f64],
        valid: impl Fn(f64) -> bool,
    ) -> Result<(), String> {
        let Some(i) = values.iter().position(|&x| !valid(x)) else {
            return Ok(());
        };
        let (x, y) = (i % self.width as usize, i / self.width as usize);
        let value = values[i];
        Err(format!("the {what} of the pixel {x},{y} is {value}"))
    }
}
