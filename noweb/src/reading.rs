// Tangled from noweb/chapters/reading.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The files of a project, and the conflicts that must not be in them.

use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use noweb_core::conflict::{self, unresolved};

use crate::commonmark::{find_prose, is_markdown};
use crate::diagnostic::{Faults, Source, checked};
use crate::markup::{Token, mark_up};
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

/// The faults for the conflicts of git in a text, unless they are quoted
/// or are also in the text that was made in its place.
pub fn conflicts(path: &Path, text: &[u8], made: &[u8]) -> Faults {
    let mut found = conflict::conflicts(text, made);
    let mut all: Vec<_> = lines(text).collect();
    for marks in &found {
        all[marks[0]] = b"<<<<>>=";
        all[marks[0] + 1] = b"@";
    }
    let name = path.as_os_str().as_bytes().to_vec();
    let source = Source::new(name, all.join(&b'\n'));
    let (mut lexemes, _) = mark_up(&source, 0, 0);
    lexemes.retain(|(token, ..)| *token == Token::Defn);
    found.retain(|marks| {
        let here = marks[0] as u32 + 1;
        lexemes.iter().any(|(.., place)| place.line == here)
    });
    unresolved(path, &found)
}
