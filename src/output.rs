// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Targets of files: checked before the work, and written such that
//! nothing is lost.

// Name what the output imports
use std::env;
use std::ffi::OsString;
use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::image::{Format, Means};

// Say where a file goes
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
    let mut builder = tempfile::Builder::new();
    // Let the user's mask decide the mode
    #[cfg(unix)]
    builder
        .permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.prefix(".pt-").tempfile_in(directory(path)).map_err(|e| {
        let (name, error) = (path.display(), e.to_string());
        let cause = error.split(" at path").next().unwrap_or_default();
        format!("{name}: cannot create a file there: {cause}")
    })
}

/// The directory in which a file has its name.
fn directory(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Fills a file with the content and brings it to the disk.
fn finish(
    file: NamedTempFile,
    path: &Path,
    content: &mut Content,
) -> Result<NamedTempFile, String> {
    fill(content, file.as_file())
        .and_then(|file| file.sync_all())
        .map_err(|e| failure(path.display(), e))?;
    Ok(file)
}

/// What goes to a target: a function that writes it.
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

/// Gives a complete file its name, or returns it with the reason why
/// not.
fn name_file(
    file: NamedTempFile,
    path: &Path,
    force: bool,
) -> Result<(), (NamedTempFile, String)> {
    // Keep the mode of a file that is replaced
    if let Ok(there) = path.metadata() {
        let _ = file.as_file().set_permissions(there.permissions());
    }
    let named = match force {
        true => file.persist(path),
        false => file.persist_noclobber(path),
    };
    // Bring the new name to the disk
    if named.is_ok() {
        let directory = File::open(directory(path));
        let _ = directory.and_then(|directory| directory.sync_all());
    }
    named.map(drop).map_err(|e| match e.error.kind() {
        ErrorKind::AlreadyExists => (e.file, exists(path)),
        _ => (e.file, failure(path.display(), e.error)),
    })
}

/// Keeps a complete file that could not be named; returns its place.
fn keep(file: NamedTempFile, path: &Path) -> PathBuf {
    let hidden = file.path().to_owned();
    let letters = hidden.to_string_lossy();
    let letters = letters.rsplit("-").next().unwrap_or_default();
    let mut name = OsString::from(format!("kept-{letters}-"));
    name.push(path.file_name().unwrap_or_default());
    let clear = hidden.with_file_name(name);
    match file.persist_noclobber(&clear) {
        Ok(_) => clear,
        Err(e) => e.file.keep().map_or(hidden, |(_, path)| path),
    }
}

impl OutputTarget {
    // Check the target before the work
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
            Ok(there) if there.is_file() && !force => {
                return Err(exists(path));
            }
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

    // Write what the content gives
    /// Writes what `content` gives.
    ///
    /// # Errors
    /// The content cannot be written whole, or the file has come to exist.
    /// A file that was there before is then as it was, and what was
    /// finished is kept where the message says.
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
                // Write a file and keep it in any case
                let (file, fault) = match temporary(path) {
                    Ok(file) => (file, None),
                    Err(fault) => {
                        // Make the file in another directory
                        let name = path.file_name().unwrap_or_default();
                        let file = temporary(&env::temp_dir().join(name));
                        (file.map_err(|_| fault.clone())?, Some(fault))
                    }
                };
                let file = finish(file, path, content)?;
                let named = match fault {
                    None => name_file(file, path, *force),
                    Some(fault) => Err((file, fault)),
                };
                named.map_err(|(file, fault)| {
                    let kept = keep(file, path);
                    let kept = kept.display();
                    format!("{fault}; the new one is kept as {kept}")
                })
            }
        }
    }

    /// Writes one of several states of a file: the first respects `force`,
    /// later ones replace it. A target that is no file is left alone, since
    /// nothing can be replaced there; it waits for [`OutputTarget::write`].
    ///
    /// # Errors
    /// The content cannot be written whole, or the file has come to exist.
    /// A file that was there before is then as it was.
    pub fn rewrite(&mut self, content: &mut Content) -> Result<(), String> {
        if let Kind::File { path, force } = &mut self.0 {
            let file = finish(temporary(path)?, path, content)?;
            name_file(file, path, *force).map_err(|(_, fault)| fault)?;
            *force = true;
        }
        Ok(())
    }
}

// Say where an image goes
/// Where an image goes, and in which format.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageTarget {
    target: OutputTarget,
    format: Format,
}

impl ImageTarget {
    /// The standard output.
    pub fn standard_output(format: Format) -> Self {
        Self { target: OutputTarget::standard_output(), format }
    }

    /// The file `path`, in the format of its extension.
    ///
    /// # Errors
    /// The extension is unknown, and those of [`OutputTarget::file`].
    pub fn file(path: &Path, force: bool) -> Result<Self, String> {
        let format = Format::of(path)?;
        Ok(Self { target: OutputTarget::file(path, force)?, format })
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
    pub fn write(&self, image: &dyn Means) -> Result<(), String> {
        self.target.write(&mut |out| self.format.write(image, out))
    }

    /// Writes the image for the time being; see [`OutputTarget::rewrite`].
    ///
    /// # Errors
    /// Those of [`OutputTarget::rewrite`].
    pub fn rewrite(&mut self, image: &dyn Means) -> Result<(), String> {
        self.target.rewrite(&mut |out| self.format.write(image, out))
    }

    /// Takes the time of [`ImageTarget::write`], and writes nothing.
    pub fn rehearse(&self, image: &dyn Means) {
        let _ = self.format.write(image, &mut io::sink());
    }
}
