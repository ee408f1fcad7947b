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
mod levels;
mod pfm;
mod pgm;
mod png;
pub(crate) mod srgb;

use std::io::{self, Read, Write};
use std::path::Path;

pub use data::{Image, Note, Picture, Source};

#[derive(clap::ValueEnum, serde::Serialize, serde::Deserialize)]
/// How an image becomes bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
        image: &dyn Source,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        match self {
            Format::Pgm => pgm::write(image, out),
            Format::Png => png::write(image, out),
            Format::Pfm => pfm::write(image, out),
            Format::Exr => exr::write(image, out),
        }
    }

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

const NEITHER: &str = "it is neither EXR, PFM, PNG nor PGM";

impl Image {
    /// Reads a file of any of the formats; see [`Image::read_noting`].
    ///
    /// # Errors
    /// Those of [`Image::read_noting`].
    pub fn read(path: &Path) -> Result<Self, String> {
        Self::read_noting(path, &mut |_| ())
    }

    /// Reads a file, or standard input if its name is `-`; `note` is told,
    /// in a line, of what is not as [`Image`] has it.
    ///
    /// # Errors
    /// The file cannot be read, and those of [`Image::decode`]; the
    /// message names the file and the fault.
    pub fn read_noting(path: &Path, note: Note) -> Result<Self, String> {
        let mut bytes = Vec::new();
        let (name, read) = match path.to_str() {
            Some("-") => {
                let read = io::stdin().read_to_end(&mut bytes).map(drop);
                ("standard input".to_owned(), read)
            }
            _ => {
                let read = std::fs::read(path).map(|read| bytes = read);
                (path.display().to_string(), read)
            }
        };
        read.map_err(|error| format!("{name}: cannot read: {error}"))?;
        Self::decode(&bytes, &mut |text| note(&format!("{name}: {text}")))
            .map_err(|fault| format!("{name}: {fault}"))
    }

    /// Reads an image from the bytes of its file; `note` is told of what is
    /// not as [`Image`] has it.
    ///
    /// # Errors
    /// The bytes are damaged, or of another kind of file.
    pub fn decode(bytes: &[u8], note: Note) -> Result<Self, String> {
        let image = match bytes.get(..2) {
            Some([0x76, 0x2f]) => exr::read(bytes, note),
            Some(b"Pf" | b"PF") => pfm::read(bytes, note),
            Some(b"P2" | b"P5") => pgm::read(bytes, note),
            Some(b"\x89P") => png::read(bytes, note),
            // Name the sisters of the greymap
            Some(b"P1" | b"P4") => Err(format!("{NEITHER}, but PBM")),
            Some(b"P3" | b"P6") => Err(format!("{NEITHER}, but PPM")),
            Some(b"P7") => Err(format!("{NEITHER}, but PAM")),
            _ => Err(NEITHER.to_owned()),
        };
        image?.sifted(note)
    }

    fn sifted(mut self, note: Note) -> Result<Self, String> {
        let width = self.width as usize;
        let mut lost = Vec::new();
        for (i, mean) in self.means.iter_mut().enumerate() {
            let errors = [&mut self.errors, &mut self.tile_errors];
            let errors = errors.map(|e| e.as_mut().map(|e| &mut e[i]));
            let count =
                self.samples.as_mut().map(|samples| &mut samples[i]);
            // Refuse a negative error or count
            let (x, y) = (i % width, i / width);
            let errors_and_count =
                errors.iter().flatten().map(|e| ("standard error", **e));
            for (what, value) in
                errors_and_count.chain(count.iter().map(|n| ("count", **n)))
            {
                if value < 0. {
                    return Err(format!(
                        "the {what} of the pixel {x},{y} is {value}"
                    ));
                }
            }
            let known = mean.is_finite()
                && errors.iter().flatten().all(|error| !error.is_nan())
                && count.as_ref().is_none_or(|count| count.is_finite());
            if !known {
                *mean = f64::NAN;
                let errors = errors.into_iter().flatten();
                errors.for_each(|error| *error = f64::INFINITY);
                count.into_iter().for_each(|count| *count = 0.);
                lost.push(i);
            }
        }
        // Tell how many pixels are no numbers
        if let Some(first) = lost.first() {
            let (x, y) = (first % width, first / width);
            note(&format!(
                "pixels that are not finite numbers: {}, the first at {x},{y}",
                lost.len()
            ));
        }
        Ok(self)
    }
}
