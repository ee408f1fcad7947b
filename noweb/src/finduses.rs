// Tangled from noweb/chapters/weave.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The stage `finduses`: marks every use of a defined identifier.
//!
//! Identifiers come from the stream's own `@index defn` lines, or from
//! files with one identifier on each line. The text keeps its bytes: a
//! use is announced by a line before it, and the text is cut around it.

use std::collections::HashSet;
use std::ffi::OsString;

use crate::Streams;
use crate::diagnostic::shown;
use crate::stream::{self, Mark, Outcome, put};

/// A set of words, and of the prefixes of the words.
#[derive(Default)]
pub struct Recogniser {
    words: HashSet<Vec<u8>>,
    prefixes: HashSet<Vec<u8>>,
    longest: usize,
}

impl Recogniser {
    /// Keeps the given words.
    pub fn new<'a>(words: impl Iterator<Item = &'a [u8]>) -> Recogniser {
        let mut set = Recogniser::default();
        for word in words.filter(|word| !word.is_empty()) {
            for end in 1..=word.len() {
                set.prefixes.insert(word[..end].to_vec());
            }
            set.longest = set.longest.max(word.len());
            set.words.insert(word.to_vec());
        }
        set
    }

    fn ending(&self, text: &[u8]) -> Vec<usize> {
        let mut starts = Vec::new();
        for start in (0..text.len()).rev().take(self.longest) {
            if self.prefixes.contains(&text[start..]) {
                starts.reverse();
                if self.words.contains(&text[start..]) {
                    starts.push(start);
                }
            }
        }
        starts
    }
}

/// The class of a byte; none for one that separates.
fn class(byte: u8) -> Option<u8> {
    match byte {
        b'_' | b'\'' | b'@' | b'#' => Some(b'a'),
        _ if byte.is_ascii_alphanumeric() => Some(b'a'),
        _ if b"!%^&*-+:=|~<>./?`".contains(&byte) => Some(b'!'),
        _ => None,
    }
}

/// Whether two neighbouring bytes belong to one token.
fn joined(left: u8, right: u8) -> bool {
    class(left).is_some() && class(left) == class(right)
}

const TEXT: &[u8] = b"@text ";

impl Recogniser {
    /// Writes a `@text` line, cut at the uses of the words.
    pub fn mark_line(&self, line: &[u8], out: &mut Vec<u8>) {
        let mut done = TEXT.len();
        for end in 1..=line.len() {
            // No word ends within a token
            if end < line.len() && joined(line[end - 1], line[end]) {
                continue;
            }
            for start in self.ending(&line[..end]) {
                if start == 0 || !joined(line[start - 1], line[start]) {
                    // Announce the use before its text
                    done = copy(line, done, start, out);
                    put(out, &[b"@index use ", &line[start..end]]);
                    done = copy(line, done, end, out);
                }
            }
        }
        copy(line, done, line.len(), out);
    }
}

/// Writes `line[done..end]` as text; returns the end of what is written.
fn copy(line: &[u8], done: usize, end: usize, out: &mut Vec<u8>) -> usize {
    if done >= end {
        return done;
    }
    put(out, &[TEXT, &line[done..end]]);
    end
}

/// Announces with `@index use` every use of a word in the code.
pub fn mark_uses(stream: &[u8], set: &Recogniser, quotes: bool) -> Vec<u8> {
    let mut out = Vec::new();
    let mut code = false;
    for line in stream::lines(stream) {
        // Note where code begins and ends
        let quote = quotes && line == b"@quote";
        if quote || line.starts_with(b"@begin code") {
            code = true;
        } else if line.starts_with(b"@end code") || line == b"@endquote" {
            code = false;
        }
        // Mark a text or copy the line
        match Mark::read(line) {
            Some(Mark { keyword: b"text", .. }) if code => {
                set.mark_line(line, &mut out);
            }
            _ => put(&mut out, &[line]),
        }
    }
    out
}

/// The identifiers that a stream declares.
pub fn declared(stream: &[u8]) -> impl Iterator<Item = &[u8]> {
    let marks = stream::lines(stream).filter_map(Mark::read);
    let marks = marks.filter(|m| m.keyword == b"index").map(|m| m.inner());
    marks
        .filter(|m| matches!(m.keyword, b"defn" | b"localdefn"))
        .map(|m| m.text())
}

/// `finduses [-noquote]`, a filter over the stream.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    if let Some(arg) = args.iter().find(|arg| *arg != "-noquote") {
        let what = format!("unknown option {}", shown(arg));
        return Outcome::failure("finduses", 2, &what).deliver(streams);
    }
    let quotes = args.is_empty();
    stream::filter(streams, |input| {
        stream::broken(input).unwrap_or_else(|| {
            let words = Recogniser::new(declared(input));
            Outcome::done(mark_uses(input, &words, quotes))
        })
    })
}
