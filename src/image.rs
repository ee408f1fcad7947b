// Tangled from chapters/image.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A finished image in memory, and the formats of its files.
//!
//! Radiance is relative to that of the sky. Rows run from the top down,
//! each from left to right, whatever the order in a file.
//!
//! ```
//! use litpt::image::{Format, Image};
//!
//! let image = Image::plain(2, 1, vec![0.25, 1.]);
//! let mut file = vec![];
//! Format::Pfm.write(&image, &mut file)?;
//! assert_eq!(Image::decode(&file, &mut |_| ())?.means, [0.25, 1.]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod data;
mod exr;
pub(crate) mod levels;
mod png;
mod pnm;

use std::io::{self, Read, Write};
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::scene::encoding::shortened;

pub use data::{BANDS, FILTERED, Image, Note, OPACITY, Picture, Source};
pub use levels::luminance;

/// How an image becomes bytes.
#[derive(Serialize, Deserialize, Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
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
            Format::Pgm => pnm::write_levels(image, out),
            Format::Png => png::write(image, out),
            Format::Pfm => pnm::write_numbers(image, out),
            Format::Exr => exr::write(image, out),
        }
    }

    /// The format of a file of this name; PGM if it has no extension.
    ///
    /// # Errors
    /// The extension belongs to no format.
    pub fn of(path: &Path) -> Result<Self> {
        match extension(path).as_deref() {
            None | Some("pgm") => Ok(Self::Pgm),
            Some("png") => Ok(Self::Png),
            Some("pfm") => Ok(Self::Pfm),
            Some("exr") => Ok(Self::Exr),
            Some(_) => Err(Error::from(
                "unknown kind of image; name it .pgm, .png, .pfm or .exr",
            )
            .of_file(path)),
        }
    }
}

/// The extension of a file's name, in small letters.
pub fn extension(path: &Path) -> Option<String> {
    let extension = path.extension()?.to_str()?;
    Some(extension.to_ascii_lowercase())
}

impl Image {
    /// Reads a file of any of the formats; see [`Image::read_noting`].
    ///
    /// # Errors
    /// Those of [`Image::read_noting`].
    pub fn read(path: &Path) -> Result<Self> {
        Self::read_noting(path, &mut |_| ())
    }

    /// Reads a file, or standard input if its name is `-`; `note` receives a
    /// line about each difference between the file and the [`Image`].
    ///
    /// # Errors
    /// The file cannot be read, and those of [`Image::decode`]; the
    /// message names the file and the fault.
    pub fn read_noting(path: &Path, note: Note) -> Result<Self> {
        let (name, bytes) = if path.as_os_str() == "-" {
            let mut bytes = vec![];
            let read = io::stdin().read_to_end(&mut bytes);
            ("standard input".to_owned(), read.map(|_| bytes))
        } else {
            (path.display().to_string(), std::fs::read(path))
        };
        let bytes: Vec<u8> = bytes.map_err(Error::cannot("read", &name))?;
        let note = &mut |text: &str| note(&format!("{name}: {text}"));
        Self::decode(&bytes, note).map_err(|fault| {
            Error::from(shortened(&fault.to_string())).of_file(&name)
        })
    }

    /// Reads an image from the bytes of its file; `note` receives a line about
    /// each difference between the file and the [`Image`].
    ///
    /// # Errors
    /// The bytes are damaged, or of another kind of file.
    pub fn decode(bytes: &[u8], note: Note) -> Result<Self> {
        let image = match bytes.get(..2) {
            Some([0x76, 0x2f]) => exr::read(bytes, note),
            Some(b"Pf" | b"PF" | b"P2" | b"P5") => pnm::read(bytes, note),
            Some(b"\x89P") => png::read(bytes, note),
            _ => Err("it is neither EXR, PFM, PNG nor PGM".into()),
        };
        image?.validated(note)
    }

    fn validated(mut self, note: Note) -> Result<Self> {
        let (width, pixels) = (self.width as usize, self.means.len());
        let place = |i: usize| format!("{},{}", i % width, i / width);
        // List the numbers and their unknown values
        let mut lists = vec![(&mut self.means, f64::NAN)];
        let errors = [&mut self.errors, &mut self.tile_errors];
        let errors = errors.into_iter().flatten();
        lists.extend(errors.map(|list| (list, f64::INFINITY)));
        lists.extend(self.samples.iter_mut().map(|list| (list, 0.)));
        let mut lost = vec![];
        for i in 0..pixels {
            // Replace a pixel that is not finite
            let mut others = lists[1..].iter().map(|(list, _)| list[i]);
            if let Some(value) = others.find(|&value| value < 0.) {
                let pixel = place(i);
                return Err(format!(
                    "the standard error or count of the pixel {pixel} is {value}"
                )
                .into());
            }
            let is_known = |(list, unknown): &(&mut Vec<f64>, f64)| {
                list[i].is_finite() || list[i] == *unknown
            };
            if !lists.iter().all(is_known) {
                lost.push(i);
                lists
                    .iter_mut()
                    .for_each(|(list, unknown)| list[i] = *unknown);
            }
        }
        if let Some(&first) = lost.first() {
            note(&format!(
                "pixels that are not finite numbers: {}, the first at {}",
                lost.len(),
                place(first)
            ));
        }
        Ok(self)
    }
}
