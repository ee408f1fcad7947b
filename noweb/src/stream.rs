// Tangled from noweb/chapters/weave.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The annotated stream: lines of `@keyword argument` between stages.
//!
//! Stages are functions over the bytes of a whole stream. Text is bytes,
//! never `str`: chapters may be in any encoding. Only labels, which we make
//! ourselves, are strings.

use std::collections::HashMap;

pub use noweb_core::markup::lines;

use crate::Streams;
use crate::diagnostic::bytes_of;

/// The lines of `stream`, without newlines and carriage returns.
pub fn trimmed_lines(stream: &[u8]) -> impl Iterator<Item = &[u8]> {
    lines(stream).map(|line| {
        let end = line.iter().rposition(|&byte| byte != b'\r');
        &line[..end.map_or(0, |end| end + 1)]
    })
}

/// Writes a line that is made of parts.
pub fn put(out: &mut Vec<u8>, parts: &[&[u8]]) {
    out.extend(parts.concat());
    out.push(b'\n');
}

/// The outcome for a stream that an earlier stage has declared broken.
pub fn broken(stream: &[u8]) -> Option<Outcome> {
    let fatal = lines(stream).find(|line| line.starts_with(b"@fatal "))?;
    let text = [fatal, b"\n"].concat();
    Some(Outcome { text, status: 1, ..Outcome::default() })
}

/// A line of the stream that begins with `@`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mark<'a> {
    pub keyword: &'a [u8],
    /// What follows the space after the keyword; none without a space.
    pub argument: Option<&'a [u8]>,
}

impl<'a> Mark<'a> {
    pub fn read(line: &'a [u8]) -> Option<Mark<'a>> {
        line.strip_prefix(b"@").map(Mark::split)
    }

    fn split(words: &'a [u8]) -> Mark<'a> {
        let mut parts = words.splitn(2, |&byte| byte == b' ');
        let keyword = parts.next().unwrap_or_default();
        Mark { keyword, argument: parts.next() }
    }

    /// The mark that the argument of `@xref`, `@index`, `@begin`... holds.
    pub fn inner(&self) -> Mark<'a> {
        Mark::split(self.text())
    }

    pub fn text(&self) -> &'a [u8] {
        self.argument.unwrap_or_default()
    }
}

/// Writes a number in base 62: the digits, then A to Z, then a to z.
pub fn base62(number: u64) -> String {
    const DIGITS: &[u8; 62] = b"0123456789\
        ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz";
    let last = char::from(DIGITS[(number % 62) as usize]);
    match number / 62 {
        0 => last.to_string(),
        rest => base62(rest) + &last.to_string(),
    }
}

/// The 32-bit cyclic redundancy code that noweb gives to a name.
pub fn crc(name: &[u8]) -> u32 {
    let add = |sum, byte| (sum >> 8) ^ remainder(sum as u8 ^ byte);
    name.iter().copied().fold(0, add)
}

fn remainder(byte: u8) -> u32 {
    (0..8)
        .filter(|bit| byte & (1 << bit) != 0)
        .fold(0, |sum, bit| sum ^ (0xf500_0000 >> bit))
}

/// For each code the names that have it, in the order of their coming.
#[derive(Default)]
pub struct Codes(HashMap<u32, Vec<Vec<u8>>>);

impl Codes {
    /// The code of a name, in base 62.
    pub fn of(&mut self, name: &[u8]) -> String {
        let sum = crc(name);
        let names = self.0.entry(sum).or_default();
        if !names.iter().any(|known| known == name) {
            names.push(name.to_vec());
        }
        let code = base62(sum.into());
        match names.iter().position(|known| known == name) {
            Some(n @ 1..) => format!("{code}.{}", base62(n as u64 + 1)),
            _ => code,
        }
    }
}

/// The outcome of a stage that has read its whole input.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    pub text: Vec<u8>,
    pub messages: Vec<u8>,
    /// The exit status: 0 done, 1 failed, 2 wrong usage.
    pub status: u8,
}

impl Outcome {
    pub fn done(text: Vec<u8>) -> Outcome {
        Outcome { text, ..Outcome::default() }
    }

    /// The failure of a last stage, reported to the person.
    pub fn complaint(stage: &str, status: u8, message: &str) -> Outcome {
        let messages = bytes_of(&format!("{stage}: {message}\n"));
        Outcome { text: Vec::new(), messages, status }
    }

    pub fn failure(stage: &str, status: u8, message: &str) -> Outcome {
        let text = bytes_of(&format!("@fatal {stage} {message}\n"));
        Outcome { text, ..Outcome::complaint(stage, status, message) }
    }

    pub fn deliver(&self, streams: &mut Streams) -> u8 {
        let _ = streams.errors.write_all(&self.messages);
        let written = streams.output.write_all(&self.text);
        self.status.max(streams.conclude(written, &[]))
    }
}

/// Reads all the input, runs the stage on it and delivers the outcome.
pub fn filter(
    streams: &mut Streams,
    stage: impl FnOnce(&[u8]) -> Outcome,
) -> u8 {
    let mut input = Vec::new();
    if let Err(error) = streams.input.read_to_end(&mut input) {
        let _ = writeln!(streams.errors, "cannot read the stream: {error}");
        return 1;
    }
    stage(&input).deliver(streams)
}
