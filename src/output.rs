// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Places for files: checked before the work, and filled such that
//! nothing is lost.

// Name what the output imports
use std::fmt;
use std::fs::OpenOptions;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::image::{Format, Image};

// Choose a place for a file
/// Where a file goes: checked, and not yet touched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputTarget(Kind);

#[derive(Clone, Debug, PartialEq, Eq)]
enum Kind {
    StandardOutput,
    /// A device or a pipe, written to directly.
    Device(PathBuf),
    /// A file, replaced only if `force` is set.
    File {
        path: PathBuf,
        force: bool,
    },
}

/// A temporary file in the directory of `path`.
fn temporary(path: &Path) -> Result<NamedTempFile, String> {
    // Find the directory of the file
    let directory = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    // Let the user's mask decide the mode
    #[cfg(unix)]
    builder
        .permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.prefix(".pt-").tempfile_in(directory).map_err(|e| {
        let (name, error) = (path.display(), e.to_string());
        let cause = error.split(" at path").next().unwrap_or_default();
        format!("{name}: cannot create a file there: {cause}")
    })
}

/// What goes to a place: a function that writes it.
pub type Content<'a> = dyn FnMut(&mut dyn Write) -> io::Result<()> + 'a;

fn fill<W: Write>(content: &mut Content, out: W) -> io::Result<W> {
    let mut buffer = BufWriter::new(out);
    content(&mut buffer)?;
    buffer.into_inner().map_err(|error| error.into_error())
}

fn exists(path: &Path) -> String {
    format!("{}: the file exists; overwrite it with -f", path.display())
}

fn failure(name: impl fmt::Display, error: io::Error) -> String {
    format!("{name}: cannot write: {error}")
}

/// Gives a complete file its name; on failure the file is removed.
fn name_file(
    file: NamedTempFile,
    path: &Path,
    force: bool,
) -> Result<(), String> {
    // Keep the mode of a file that is replaced
    if let Ok(there) = path.metadata() {
        let _ = file.as_file().set_permissions(there.permissions());
    }
    let named = match force {
        true => file.persist(path),
        false => file.persist_noclobber(path),
    };
    named.map(drop).map_err(|e| match e.error.kind() {
        ErrorKind::AlreadyExists => exists(path),
        _ => failure(path.display(), e.error),
    })
}

impl OutputTarget {
    // Check the place before the work
    /// The standard output.
    pub fn standard_output() -> Self {
        Self(Kind::StandardOutput)
    }

    /// The file `path`, or the device or pipe of that name.
    ///
    /// # Errors
    /// The file exists and `force` is not set, or nothing can be created in
    /// its directory.
    pub fn file(path: &Path, force: bool) -> Result<Self, String> {
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
        match path.metadata() {
            Ok(there) if !there.is_file() => Ok(Self(Kind::Device(path))),
            _ => {
                temporary(&path)?;
                Ok(Self(Kind::File { path, force }))
            }
        }
    }

    // Put the content in its place
    /// Writes what `content` gives.
    ///
    /// # Errors
    /// The content cannot be written whole, or the file has come to exist.
    /// A file that was there before is then as it was.
    pub fn write(&self, content: &mut Content) -> Result<(), String> {
        match &self.0 {
            Kind::StandardOutput => {
                // Write to standard output
                match fill(content, io::stdout().lock()).map(drop) {
                    Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
                    done => done.map_err(|e| failure("standard output", e)),
                }
            }
            Kind::Device(path) => {
                let device = OpenOptions::new().write(true).open(path);
                let done = device.and_then(|device| fill(content, device));
                done.map(drop).map_err(|e| failure(path.display(), e))
            }
            Kind::File { path, force } => {
                // Fill a temporary file and name it
                let file = temporary(path)?;
                fill(content, file.as_file())
                    .and_then(|file| file.sync_all())
                    .map_err(|e| failure(path.display(), e))?;
                name_file(file, path, *force)
            }
        }
    }

    /// Writes one of several states of a file: the first respects `force`,
    /// later ones replace it. A place that is no file is left alone, since
    /// nothing can be replaced there; it waits for [`OutputTarget::write`].
    ///
    /// # Errors
    /// Those of [`OutputTarget::write`].
    pub fn rewrite(&mut self, content: &mut Content) -> Result<(), String> {
        if let Kind::File { .. } = self.0 {
            self.write(content)?;
        }
        if let Kind::File { force, .. } = &mut self.0 {
            *force = true;
        }
        Ok(())
    }
}

// Give an image its own place
/// Where an image goes, and in which format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageTarget {
    place: OutputTarget,
    format: Format,
}

impl ImageTarget {
    /// The standard output.
    pub fn standard_output(format: Format) -> Self {
        Self { place: OutputTarget::standard_output(), format }
    }

    /// The file `path`, in the format of its extension.
    ///
    /// # Errors
    /// The extension is unknown, and those of [`OutputTarget::file`].
    pub fn file(path: &Path, force: bool) -> Result<Self, String> {
        let format = Format::of(path)?;
        Ok(Self { place: OutputTarget::file(path, force)?, format })
    }

    // Tell the format and write the image
    /// The format of the image.
    pub fn format(&self) -> Format {
        self.format
    }

    /// Writes the image.
    ///
    /// # Errors
    /// Those of [`OutputTarget::write`].
    pub fn write(&self, image: &Image) -> Result<(), String> {
        self.place.write(&mut |out| self.format.write(image, out))
    }

    /// Takes the time of [`ImageTarget::write`], and writes nothing.
    pub fn rehearse(&self, image: &Image) {
        let _ = self.format.write(image, &mut io::sink());
    }
}
