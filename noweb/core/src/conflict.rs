// Tangled from noweb/chapters/reading.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Conflicts that git has left in a text.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use crate::diagnostic::{
    Diagnostic, Faults, Level, Position, Source, checked, shown,
};
use crate::markup::lines;

/// The lines, from 0, of git's marks for each conflict in a text that is
/// not in the text made in its place.
pub fn conflicts(text: &[u8], made: &[u8]) -> Vec<Vec<usize>> {
    let made: BTreeSet<_> = lines(made).collect();
    let signs = lines(text).map(conflict_sign).zip(0..);
    let marks = signs.filter_map(|(sign, line)| Some((sign?, line)));
    let marks: Vec<(u8, usize)> = marks.collect();
    let groups = marks.chunk_by(|_, (sign, _)| *sign != b'<');
    let groups = groups.filter_map(|marks| {
        // Parse the marks of one conflict
        let end = marks.iter().position(|(sign, _)| *sign == b'>')?;
        let whole = matches!(marks[..end], [(b'<', _), .., (b'=', _)]);
        let first = lines(text).nth(marks[0].1)?;
        let marks = marks[..=end].iter().map(|(_, line)| *line);
        (whole && !made.contains(first)).then(|| marks.collect())
    });
    groups.collect()
}

fn conflict_sign(line: &[u8]) -> Option<u8> {
    let sign = *line.first().filter(|sign| b"<|=>".contains(sign))?;
    let rest = line.strip_prefix(&[sign; 7])?;
    rest.first().is_none_or(u8::is_ascii_whitespace).then_some(sign)
}

/// Reads a chapter or a tangled file.
///
/// # Errors
/// There is a conflict of git in it, but not in what was made in its place.
pub fn read(
    name: Vec<u8>,
    text: Vec<u8>,
    made: &[u8],
) -> Result<Source, Faults> {
    let found = conflicts(&text, made);
    let path = Path::new(OsStr::from_bytes(&name));
    let faults = unresolved(path, &found);
    checked(Source::new(name, text), faults)
}

/// The faults for some conflicts in a file.
pub fn unresolved(path: &Path, conflicts: &[Vec<usize>]) -> Faults {
    let text = "a conflict of git is not resolved here";
    let fault = |line: &usize| {
        edit_fault(path, *line, text)
            .with_help("keep what holds, and remove the line")
    };
    conflicts.iter().flatten().map(fault).collect()
}

/// A fault of a line of a file, counted from 0.
pub fn edit_fault(path: &Path, line: usize, text: &str) -> Diagnostic {
    let (file, line) = (shown(path), line as u32 + 1);
    let position = Position { file, line, column: 1, excerpt: None };
    Diagnostic::new(Level::Error, Some(position), text)
}
