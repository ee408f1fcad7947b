// Tangled from noweb/chapters/tangle.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Files that are replaced as a whole, and only if they change.
//!
//! A reader of the file sees the old text or the new one and nothing in
//! between, and a full disk leaves the old one.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::time::SystemTime;

use crate::Streams;
use crate::diagnostic::{Diagnostic, Faults};

/// Writes a file as a whole or not at all; `time` is that of its last
/// change, if not now.
/// A device or a pipe is written to; a symbolic link is followed. An
/// existing file keeps its permissions.
pub fn replace(
    path: &Path,
    text: &[u8],
    time: Option<SystemTime>,
) -> io::Result<()> {
    let target = fs::canonicalize(path).unwrap_or(path.to_owned());
    let old = fs::metadata(&target).ok();
    // Write directly to a device or pipe
    if old.as_ref().is_some_and(|old| !old.is_file()) {
        let mut device = File::options().write(true).open(&target)?;
        return device.write_all(text);
    }
    let temporary = format!(".noweb-{}.tmp", std::process::id());
    let temporary = target.with_file_name(temporary);
    let permissions = old.map(|old| old.permissions());
    let written = fill(&temporary, text, time, permissions)
        .and_then(|()| fs::rename(&temporary, &target));
    if written.is_err() {
        // The first error is the one to report.
        let _ = fs::remove_file(&temporary);
    }
    written
}

fn fill(
    path: &Path,
    text: &[u8],
    time: Option<SystemTime>,
    permissions: Option<fs::Permissions>,
) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(text)?;
    if let Some(permissions) = permissions {
        file.set_permissions(permissions)?;
    }
    time.map_or(Ok(()), |time| file.set_modified(time))
}

/// Writes a file that does not exist, or whose being the same is wanted.
pub fn copy_if(path: &Path, text: &[u8], wanted: bool) -> io::Result<()> {
    let same = fs::read(path).ok().map(|old| old == text);
    if same == Some(!wanted) {
        return Ok(());
    }
    replace(path, text, None)
}

/// The command `cpif [-eq | -ne] file...`: standard input to each file
/// that does not exist, or that differs (`-eq`: is the same).
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let (wanted, files) = match args {
        [op, files @ ..] if op == "-eq" => (true, files),
        [op, files @ ..] if op == "-ne" => (false, files),
        files => (false, files),
    };
    let first = args.first().map_or(&b""[..], |a| a.as_encoded_bytes());
    let unknown = args.len() == files.len() && first.starts_with(b"-");
    // Explain the usage and stop
    if files.is_empty() || unknown {
        // Nobody is left to tell if standard error is closed.
        let _ = writeln!(streams.errors, "Usage: cpif [ -eq -ne ] file...");
        return 2;
    }
    let text = match streams.read("-".as_ref()) {
        Ok(source) => source.text,
        Err(fault) => return streams.conclude(Ok(()), &[fault]).min(1),
    };
    let faults = files.iter().filter_map(|file| {
        let copied = copy_if(Path::new(file), &text, wanted);
        copied.err().map(|e| Diagnostic::failure("write", file, &e))
    });
    streams.conclude(Ok(()), &faults.collect::<Faults>()).min(1)
}
