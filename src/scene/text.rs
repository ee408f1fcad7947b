// Tangled from chapters/scene.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the text of an OBJ, or of a library of materials, to its statements.

use std::borrow::Cow;
use std::fmt::Display;

use memchr::{memchr, memchr_iter, memchr2_iter, memchr3_iter};

use super::encoding::shortened;
use crate::error::{Diagnostic, Result};

/// The text without zeros, marks and blanks at its end.
///
/// # Errors
/// There is a zero byte in it.
pub fn plain(source: &[u8]) -> Result<&[u8]> {
    let pads = |c: &u8| matches!(*c, 0 | END) || c.is_ascii_whitespace();
    let end = source.iter().rposition(|c| !pads(c));
    let source = &source[..end.map_or(source.len(), |last| last + 1)];
    let Some(zero) = memchr(0, source) else { return Ok(source) };
    let what = "a zero byte: this is a binary file, not text";
    Err(at(source, &source[..zero], what).into())
}

/// Ctrl-Z, the end of a text under CP/M and DOS.
const END: u8 = 0x1a;

/// The lines of a text, without the blanks and marks around them.
pub fn lines(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut start = 0;
    let ends = memchr2_iter(b'\n', b'\r', text).chain([text.len()]);
    ends.map(move |end| {
        let mut line = &text[start..end];
        start = end + 1;
        while let [0xef, 0xbb, 0xbf, rest @ ..] | [END, rest @ ..] = line {
            line = rest;
        }
        line.trim_ascii()
    })
}

/// The first word of a statement.
pub fn name(line: &[u8]) -> &[u8] {
    line.split(u8::is_ascii_whitespace).next().unwrap_or_default()
}

/// A statement without the comment behind it.
pub fn said(line: &[u8]) -> &[u8] {
    let is_blank = |c: &u8| c.is_ascii_whitespace() || *c == BREAK;
    let begins = |&i: &usize| line[..i].last().is_none_or(is_blank);
    let end = memchr_iter(b'#', line).find(begins);
    &line[..end.unwrap_or(line.len())]
}

/// What follows the name of a statement, as letters.
pub fn rest(line: &[u8]) -> String {
    let rest = line[name(line).len()..].trim_ascii();
    let latin_1 = |_| rest.iter().map(|&byte| char::from(byte)).collect();
    str::from_utf8(rest).map_or_else(latin_1, str::to_owned)
}

/// The text with each statement in a line of its own.
pub fn join(source: &[u8]) -> Cow<'_, [u8]> {
    let (mut text, mut end) = (Cow::Borrowed(source), 0);
    while let Some(n) = memchr(b'\\', &source[end..]) {
        let start = end + n;
        let is_gap = |c: &&u8| **c == b'\\' || c.is_ascii_whitespace();
        end = start + source[start..].iter().take_while(is_gap).count();
        let is_end = |c: &u8| matches!(c, b'\n' | b'\r');
        let before = source[..start].rsplit(is_end).flat_map(lines).next();
        let ends =
            end == source.len() || source[start..end].iter().any(is_end);
        if ends && before.is_none_or(|line| said(line) == line) {
            // Fill the gap between the lines of a statement
            let next = source.get(end);
            let goes_on =
                next.is_some_and(|c| b"0123456789-+.".contains(c));
            for i in start..end {
                text.to_mut()[i] = match source[i] {
                    b'\\' => b' ',
                    b'\r' if source[i..].starts_with(b"\r\n") => b' ',
                    b'\r' | b'\n' if goes_on => BREAK,
                    other => other,
                };
            }
        }
    }
    text
}

/// Replaces the end of a line within a statement.
pub const BREAK: u8 = b'\x0b';

/// The number, from 1, of the line of `text` in which its part `line`
/// ends.
pub fn number(text: &[u8], line: &[u8]) -> usize {
    let end = line.as_ptr_range().end.addr() - text.as_ptr().addr();
    let ends = memchr3_iter(b'\n', b'\r', BREAK, &text[..end]);
    1 + ends.filter(|&i| !text[i..].starts_with(b"\r\n")).count()
}

/// A message about a line, which is a part of `text`.
pub fn at(text: &[u8], line: &[u8], what: impl Display) -> Diagnostic {
    let line = Some(number(text, line));
    Diagnostic { line, ..shortened(&what.to_string()).into() }
}
