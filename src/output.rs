// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Encoding an image and putting it in its place.

// Name what the output imports
use std::fmt;
use std::fs::OpenOptions;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use png::{BitDepth, ColorType, Encoder, SrgbRenderingIntent};
use tempfile::NamedTempFile;

use crate::image::Image;

// Encode radiance as the eye expects
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
fn level(radiance: f64, white: u16) -> u16 {
    (srgb(radiance) * f64::from(white)).floor() as u16
}

// Write an image in its format
/// How an image becomes bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    /// Plain portable greymap of 256 levels.
    Pgm,
    /// Portable network graphic of 65536 levels.
    Png,
}

impl Format {
    fn write(self, image: &Image, out: &mut dyn Write) -> io::Result<()> {
        match self {
            Format::Pgm => write_pgm(image, out),
            Format::Png => write_png(image, out),
        }
    }
}

fn write_pgm(image: &Image, out: &mut dyn Write) -> io::Result<()> {
    let (width, height) = (image.width(), image.height());
    writeln!(out, "P2 {width} {height}\n255")?;
    image.means().try_for_each(|mean| writeln!(out, "{}", level(mean, 255)))
}

fn write_png(image: &Image, out: &mut dyn Write) -> io::Result<()> {
    let mut encoder = Encoder::new(out, image.width(), image.height());
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Sixteen);
    encoder.set_source_srgb(SrgbRenderingIntent::RelativeColorimetric);
    let means = image.means();
    let bytes: Vec<u8> = means
        .flat_map(|mean| level(mean, u16::MAX).to_be_bytes())
        .collect();
    let mut writer = encoder.write_header().map_err(io::Error::from)?;
    writer.write_image_data(&bytes).map_err(io::Error::from)
}

impl Format {
    fn of(path: &Path) -> Result<Self, String> {
        let extension = path.extension().and_then(|e| e.to_str());
        match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("pgm") | None => Ok(Format::Pgm),
            Some("png") => Ok(Format::Png),
            Some(_) => Err(format!(
                "{}: unknown kind of image; name it .pgm or .png",
                path.display()
            )),
        }
    }
}

// Choose a place for the image
/// Where an image goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Destination {
    place: Place,
    format: Format,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Place {
    StandardOutput,
    /// A device or a pipe, written to directly.
    Device(PathBuf),
    /// A file, replaced only if `force` is set.
    File {
        path: PathBuf,
        force: bool,
    },
}

fn exists(path: &Path) -> String {
    format!("{}: the file exists; overwrite it with -f", path.display())
}

/// A temporary file in the directory of `path`.
fn temporary(path: &Path) -> Result<NamedTempFile, String> {
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder
        .permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.prefix(".pt-").tempfile_in(directory).map_err(|e| {
        let (name, error) = (path.display(), e.to_string());
        let cause = error.split(" at path").next().unwrap_or_default();
        format!("{name}: cannot create a file there: {cause}")
    })
}

fn failure(name: impl fmt::Display, error: io::Error) -> String {
    format!("{name}: cannot write the image: {error}")
}

/// Gives a complete file its name; on failure the file is removed.
fn name_file(
    file: NamedTempFile,
    path: &Path,
    force: bool,
) -> Result<(), String> {
    if let Ok(there) = path.metadata() {
        // A file that is replaced keeps its mode.
        let _ = file.as_file().set_permissions(there.permissions());
    }
    let named = match force {
        true => file.persist(path),
        false => file.persist_noclobber(path),
    };
    match named {
        Ok(_) => Ok(()),
        Err(e) if e.error.kind() == ErrorKind::AlreadyExists => {
            Err(exists(path))
        }
        Err(e) => Err(failure(path.display(), e.error)),
    }
}

impl Destination {
    // Check the place before the work
    /// Plain PGM on the standard output.
    pub fn standard_output() -> Self {
        Self { place: Place::StandardOutput, format: Format::Pgm }
    }

    /// The file `path`, in the format of its extension.
    ///
    /// # Errors
    /// The extension is unknown, the file exists and `force` is not set,
    /// or nothing can be created in its directory.
    pub fn file(path: &Path, force: bool) -> Result<Self, String> {
        let format = Format::of(path)?;
        // Refuse names that cannot be written
        let name = path.display();
        match path.metadata() {
            Ok(there) if there.is_dir() => {
                return Err(format!("{name}: is a directory"));
            }
            Ok(_) if !force => return Err(exists(path)),
            Err(_) if path.is_symlink() => {
                return Err(format!("{name}: is a link to nothing"));
            }
            _ => (),
        }
        let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let place = match path.metadata() {
            Ok(there) if !there.is_file() => Place::Device(path),
            _ => {
                temporary(&path)?;
                Place::File { path, force }
            }
        };
        Ok(Self { place, format })
    }

    // Put the image in its place
    /// Writes the image.
    ///
    /// # Errors
    /// The image cannot be written whole, or the file has come to exist.
    /// A file that was there before is then as it was.
    pub fn write(&self, image: &Image) -> Result<(), String> {
        match &self.place {
            Place::StandardOutput => {
                match self.encode(image, io::stdout().lock()) {
                    Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
                    done => done
                        .map(drop)
                        .map_err(|e| failure("standard output", e)),
                }
            }
            Place::Device(path) => {
                let device = OpenOptions::new().write(true).open(path);
                let done =
                    device.and_then(|device| self.encode(image, device));
                done.map(drop).map_err(|e| failure(path.display(), e))
            }
            Place::File { path, force } => {
                let file = temporary(path)?;
                self.encode(image, file.as_file())
                    .and_then(|file| file.sync_all())
                    .map_err(|e| failure(path.display(), e))?;
                name_file(file, path, *force)
            }
        }
    }

    fn encode<W: Write>(&self, image: &Image, out: W) -> io::Result<W> {
        let mut buffer = BufWriter::new(out);
        self.format.write(image, &mut buffer)?;
        buffer.into_inner().map_err(|error| error.into_error())
    }
}
