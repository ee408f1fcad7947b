// Tangled from noweb/chapters/reading.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The files of a project, and what must not be in them.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use crate::commonmark::{find_prose, is_markdown};
use crate::diagnostic::{
    Diagnostic, Faults, Level, Position, Source, checked, shown,
};
use crate::markup::{Lexeme, Token, mark_up};
use crate::stream::lines;

/// Reads a chapter or a tangled file.
///
/// # Errors
/// There is a conflict of git in it, but not in what was made in its place,
/// or a block of Markdown is never closed.
pub fn read(
    name: Vec<u8>,
    text: Vec<u8>,
    made: &[u8],
) -> Result<Source, Faults> {
    let path = Path::new(OsStr::from_bytes(&name));
    let mut faults = conflicts(path, &text, made);
    let mut source = Source::new(name, text);
    if is_markdown(&source.name) {
        let prose = find_prose(&source.text);
        faults.extend(source.locate(prose.open));
        source.definitions = Some(prose.ends);
    }
    checked(source, faults)
}

/// The lines by which git marks conflicts that a text does not mean, nor
/// one that was made in its place.
pub fn conflicts(path: &Path, text: &[u8], made: &[u8]) -> Faults {
    let made: BTreeSet<_> = lines(made).collect();
    let mut all: Vec<_> = lines(text).collect();
    // Gather the marks of conflicts
    let mark = |(line, text): (usize, &&[u8])| {
        let sign = *text.first().filter(|sign| b"<|=>".contains(sign))?;
        let rest = text.strip_prefix(&[sign; 7])?;
        let ends = rest.first().is_none_or(u8::is_ascii_whitespace);
        ends.then_some((line, sign))
    };
    let marks: Vec<_> = all.iter().enumerate().filter_map(mark).collect();
    let groups = marks.chunk_by(|_, (_, sign)| *sign != b'<');
    let groups = groups.filter_map(|marks| {
        let end = marks.iter().position(|(_, sign)| *sign == b'>')?;
        let is_whole = matches!(marks[..end], [(_, b'<'), .., (_, b'=')]);
        let is_new = is_whole && !made.contains(all[marks[0].0]);
        is_new.then_some(&marks[..=end])
    });
    let mut found: Vec<_> = groups.collect();
    if found.is_empty() {
        return Vec::new();
    }
    // See which conflicts are no samples
    for marks in &found {
        all[marks[0].0] = b"<<<<>>=";
        all[marks[0].0 + 1] = b"@";
    }
    let name = path.as_os_str().as_bytes().to_vec();
    let source = Source::new(name, all.join(&b'\n'));
    let (lexemes, _) = mark_up(&source, 0, 0);
    let is_real = |marks: &&[(usize, u8)]| {
        let begins = |(token, place): &Lexeme| {
            let here = place.line as usize == marks[0].0 + 1;
            here && matches!(token, Token::Defn(_))
        };
        lexemes.iter().any(begins)
    };
    found.retain(is_real);
    let text = "a conflict of git is not resolved here";
    let fault = |(line, _): &_| {
        edit_fault(path, *line, text)
            .with_help("keep what holds, and remove the line")
    };
    found.into_iter().flatten().map(fault).collect()
}

/// A fault of a line of a file, counted from 0.
pub fn edit_fault(path: &Path, line: usize, text: &str) -> Diagnostic {
    let (file, line) = (shown(path), line as u32 + 1);
    let position = Position { file, line, column: 1, excerpt: None };
    Diagnostic::new(Level::Error, Some(position), text)
}
