// Tangled from chapters/output.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Targets of files: checked before the work, and written such that
//! nothing is lost.
//!
//! ```
//! use litpt::output::OutputTarget;
//!
//! let place = tempfile::tempdir()?;
//! let path = place.path().join("numbers.txt");
//! let target = OutputTarget::file(&path, false)?;
//! target.write(&mut |out| writeln!(out, "1 2 3"))?;
//! assert_eq!(std::fs::read_to_string(&path)?, "1 2 3\n");
//! assert!(OutputTarget::file(&path, false).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::env;
use std::fs::{File, OpenOptions, Permissions};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::mem::ManuallyDrop;
use std::os::fd::{AsRawFd, FromRawFd, RawFd};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::error::{Error, Result};
use crate::image::Format;

/// The target of a file: checked, and not yet touched.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputTarget(Kind);

#[derive(Clone, Debug, PartialEq, Eq)]
enum Kind {
    /// A descriptor that was open when the program began.
    Open(RawFd),
    /// A device or a pipe, written to directly.
    Device(PathBuf),
    /// A file, replaced only if `force` is set.
    File { path: PathBuf, force: bool },
}

/// The name of an open descriptor, for people.
fn name(number: RawFd) -> String {
    match number {
        1 => "standard output".to_owned(),
        number => format!("/dev/fd/{number}"),
    }
}

/// The number of the open descriptor that a name stands for, 1 for `-`.
pub fn descriptor(path: &Path) -> Option<RawFd> {
    if path.as_os_str() == "-" {
        return Some(1);
    }
    let descriptors = Path::new("/dev/fd").canonicalize().ok()?;
    // Links in a circle have no metadata.
    path.metadata().ok()?;
    let mut path = path.to_owned();
    while directory(&path).canonicalize().ok()? != descriptors {
        path = directory(&path).join(path.read_link().ok()?);
    }
    path.file_name()?.to_str()?.parse().ok()
}

/// A temporary file in the directory of `path`.
fn temporary(path: &Path) -> Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    // Apply the user's mask to the mode
    builder.permissions(Permissions::from_mode(0o666));
    builder.prefix(".pt-").tempfile_in(directory(path)).map_err(|e| {
        let text = e.to_string();
        let cause = text.split(" at path").next().unwrap_or_default();
        let cause = io::Error::new(e.kind(), cause);
        Error::cannot("create a file there", path)(cause)
    })
}

/// The directory that contains a name.
fn directory(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// A descriptor that is waited for.
struct BlockingWriter(ManuallyDrop<File>);

impl Write for BlockingWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let (fd, events) = (self.0.as_raw_fd(), libc::POLLOUT);
        let mut room = libc::pollfd { fd, events, revents: 0 };
        loop {
            match self.0.write(bytes) {
                Err(e) if e.kind() == ErrorKind::WouldBlock => {
                    // SAFETY: the set has one descriptor.
                    unsafe { libc::poll(&mut room, 1, -1) };
                }
                done => return done,
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Fills a file with the content and brings it to the disk.
fn finish(
    file: NamedTempFile,
    path: &Path,
    content: &mut Content,
) -> Result<NamedTempFile> {
    fill(content, file.as_file())
        .and_then(|file| file.sync_all())
        .map_err(Error::cannot("write", path))?;
    Ok(file)
}

/// The content of a target: a function that writes it.
pub type Content<'a> = dyn FnMut(&mut dyn Write) -> io::Result<()> + 'a;

fn fill<W: Write>(content: &mut Content, out: W) -> io::Result<W> {
    let mut buffer = BufWriter::new(out);
    content(&mut buffer)?;
    buffer.into_inner().map_err(|error| error.into_error())
}

fn exists(path: &Path) -> Error {
    let what = "the file exists; overwrite it with -f";
    Error::from(what).of_file(path)
}

/// Gives a complete file its name, or returns it with the reason for the
/// failure.
fn name_file(
    file: NamedTempFile,
    path: &Path,
    force: bool,
) -> Result<(), (NamedTempFile, Error)> {
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
        _ => (e.file, Error::cannot("write", path)(e.error)),
    })
}

/// Keeps a complete file that could not be named; returns its place.
fn keep(file: NamedTempFile, path: &Path) -> PathBuf {
    let hidden = file.path().to_owned();
    let [random, wanted] = [&hidden, path]
        .map(|path| path.file_name().unwrap_or_default().display());
    let name = format!("{random}-{wanted}").replacen(".pt", "kept", 1);
    let clear = hidden.with_file_name(name);
    match file.persist_noclobber(&clear) {
        Ok(_) => clear,
        Err(e) => e.file.keep().map_or(hidden, |(_, path)| path),
    }
}

impl OutputTarget {
    /// The standard output.
    ///
    /// # Errors
    /// It is closed, or open for reading only.
    pub fn standard_output() -> Result<Self> {
        Self::file(Path::new("-"), false)
    }

    /// The file `path`, or the descriptor, the device or the pipe of that
    /// name.
    ///
    /// # Errors
    /// The file exists and `force` is not set, or nothing can be created in
    /// its directory; or those of [`OutputTarget::standard_output`].
    pub fn file(path: &Path, force: bool) -> Result<Self> {
        if let Some(number) = descriptor(path) {
            // SAFETY: the call reads flags, and fails if nothing is open.
            let flags = unsafe { libc::fcntl(number, libc::F_GETFL) };
            return match flags & libc::O_ACCMODE {
                libc::O_WRONLY | libc::O_RDWR => {
                    Ok(Self(Kind::Open(number)))
                }
                _ => Err(Error::from("not open for writing")
                    .of_file(name(number))),
            };
        }
        // Reject names that cannot be written
        match path.metadata() {
            Ok(there) if there.is_dir() => {
                return Err(Error::from("is a directory").of_file(path));
            }
            Ok(there) if there.is_file() && !force => {
                return Err(exists(path));
            }
            Err(_) if path.is_symlink() => {
                return Err(
                    Error::from("dangling symbolic link").of_file(path)
                );
            }
            Err(e) if e.kind() != ErrorKind::NotFound => {
                return Err(Error::cannot("write", path)(e));
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

    /// Writes the content.
    ///
    /// # Errors
    /// The content cannot be written whole, or the file has come to exist.
    /// A file that was there before is then as it was, and a finished file
    /// is kept where the message says.
    pub fn write(&self, content: &mut Content) -> Result<()> {
        match &self.0 {
            Kind::Open(number) => {
                // Write to an open descriptor
                // SAFETY: nobody closes it, and this handle does not either.
                let file = unsafe { File::from_raw_fd(*number) };
                let out = BlockingWriter(ManuallyDrop::new(file));
                match fill(content, out).map(drop) {
                    Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
                    done => {
                        done.map_err(Error::cannot("write", name(*number)))
                    }
                }
            }
            Kind::Device(path) => {
                let device = OpenOptions::new().write(true).open(path);
                let done = device.and_then(|device| fill(content, device));
                done.map(drop).map_err(Error::cannot("write", path))
            }
            Kind::File { path, force } => {
                // Write a file and keep it in any case
                let name = path.file_name().unwrap_or_default();
                let elsewhere = env::temp_dir().join(name);
                let (file, fault) = match temporary(path) {
                    Ok(file) => (file, None),
                    Err(fault) => match temporary(&elsewhere) {
                        Ok(file) => (file, Some(fault)),
                        Err(_) => return Err(fault),
                    },
                };
                let file = finish(file, path, content)?;
                let named = match fault {
                    None => name_file(file, path, *force),
                    Some(fault) => Err((file, fault)),
                };
                named.map_err(|(file, cause)| {
                    let (cause, kept) = (cause.into(), keep(file, path));
                    Error::Kept { cause, kept }
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
    pub fn rewrite(&mut self, content: &mut Content) -> Result<()> {
        if let Kind::File { path, force } = &mut self.0 {
            let file = finish(temporary(path)?, path, content)?;
            name_file(file, path, *force).map_err(|(_, fault)| fault)?;
            *force = true;
        }
        Ok(())
    }
}

/// The format of an image of this name; for a descriptor the `usual`
/// one.
///
/// # Errors
/// The extension is unknown.
pub fn format_of(path: &Path, usual: Format) -> Result<Format> {
    if descriptor(path).is_some() { Ok(usual) } else { Format::of(path) }
}

/// Refuses names that stand for one file, if it is to be written.
///
/// # Errors
/// There are two such names.
pub fn refuse_aliases<'a>(
    read: impl Iterator<Item = &'a Path>,
    written: impl Iterator<Item = &'a Path>,
) -> Result<()> {
    // Resolve the name of a file
    let place = |path: &Path| {
        let new = || {
            let directory = directory(path).canonicalize().ok()?;
            Some(directory.join(path.file_name()?))
        };
        let open = descriptor(path).map(|n| n.to_string().into());
        let place = open.or_else(|| path.canonicalize().ok());
        place.or_else(new).unwrap_or_else(|| path.to_owned())
    };
    let read = read.filter(|path| path.as_os_str() != "-");
    let mut taken: Vec<_> = read.map(place).collect();
    for path in written {
        let place = place(path);
        if taken.contains(&place) {
            return Err(match descriptor(path) {
                Some(1) => "standard output is named twice".into(),
                _ => Error::from("this file is named twice").of_file(path),
            });
        }
        taken.push(place);
    }
    Ok(())
}
