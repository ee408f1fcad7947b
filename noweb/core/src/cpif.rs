// Tangled from noweb/chapters/core.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Files that are replaced as a whole, and only if they change.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::time::SystemTime;

/// Writes a file as a whole or not at all, unless it has this text; `time`
/// is its modification time, if not now.
/// A device or a pipe is written to; a symbolic link is followed. An
/// existing file keeps its permissions.
pub fn replace(
    path: &Path,
    text: &[u8],
    time: Option<SystemTime>,
) -> io::Result<()> {
    if fs::read(path).is_ok_and(|old| old == text) {
        return Ok(());
    }
    let target = fs::canonicalize(path).unwrap_or(path.to_owned());
    let old = fs::metadata(&target).ok();
    // Write directly to a device or pipe
    if old.as_ref().is_some_and(|old| !old.is_file()) {
        let mut device = File::options().write(true).open(&target)?;
        return device.write_all(text);
    }
    let temporary = format!(".noweb-{}.tmp", std::process::id());
    let temporary = target.with_file_name(temporary);
    let write = || {
        // Fill the temporary file and rename it
        let mut file = File::create(&temporary)?;
        file.write_all(text)?;
        if let Some(old) = old {
            file.set_permissions(old.permissions())?;
        }
        time.map_or(Ok(()), |time| file.set_modified(time))?;
        fs::rename(&temporary, &target)
    };
    write().inspect_err(|_| {
        // The first error is the one to report.
        let _ = fs::remove_file(&temporary);
    })
}
