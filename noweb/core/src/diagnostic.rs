// Tangled from noweb/chapters/core.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Where something stands in the sources, and what is wrong with it.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fmt;
use std::io;

const BYTE: u32 = 0x0010_ff00;

/// Text for a message; a byte that is not UTF-8 is one character.
pub fn text_of(bytes: &[u8]) -> String {
    let mut text = String::new();
    for chunk in bytes.utf8_chunks() {
        let lone = |byte: &u8| char::from_u32(BYTE + u32::from(*byte));
        text += chunk.valid();
        text.extend(chunk.invalid().iter().filter_map(lone));
    }
    text
}

/// The bytes that a message is made of.
pub fn bytes_of(text: &str) -> Vec<u8> {
    let bytes = |c: char| match u32::from(c) {
        code if code < BYTE + 0x80 => c.to_string().into_bytes(),
        code => vec![code as u8],
    };
    text.chars().flat_map(bytes).collect()
}

/// A path or an argument, for a message.
pub fn shown(name: impl AsRef<OsStr>) -> String {
    text_of(name.as_ref().as_encoded_bytes())
}

/// A byte of a source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Place {
    pub file: u32,
    /// Line, from 1.
    pub line: u32,
    /// Column in bytes, from 1.
    pub column: u32,
}

/// A file that was read, or standard input (its name is then empty).
#[derive(Clone, Debug, Default)]
pub struct Source {
    pub name: Vec<u8>,
    pub text: Vec<u8>,
    /// The offsets of its definitions, if they are not found by our rules.
    pub definitions: Option<BTreeSet<usize>>,
    starts: Vec<usize>,
}

impl Source {
    /// Keeps a text together with the offsets of its lines.
    pub fn new(name: Vec<u8>, text: Vec<u8>) -> Self {
        let after = |(i, b): (usize, &u8)| (*b == b'\n').then_some(i + 1);
        let starts = text.iter().enumerate().filter_map(after);
        let starts = std::iter::once(0).chain(starts).collect();
        Self { name, text, definitions: None, starts }
    }

    pub fn start(&self, number: u32) -> Option<usize> {
        let index = (number as usize).checked_sub(1)?;
        self.starts.get(index).copied()
    }

    /// The place of the byte at an offset.
    pub fn place(&self, offset: usize) -> Place {
        let line = self.starts.partition_point(|start| *start <= offset);
        let column = (offset - self.starts[line - 1]) as u32 + 1;
        Place { file: 0, line: line as u32, column }
    }

    /// A line without its newline, counted from 1.
    pub fn line(&self, number: u32) -> Option<&[u8]> {
        let rest = &self.text[self.start(number)?..];
        let end = rest.iter().position(|b| *b == b'\n');
        Some(&rest[..end.unwrap_or(rest.len())])
    }

    pub fn position(&self, place: Place) -> Position {
        let line = self.line(place.line).filter(|l| !l.is_empty());
        let end = place.column.saturating_sub(1) as usize;
        let before = line.map_or(&b""[..], |l| l.get(..end).unwrap_or(l));
        let inside = before.len() - text_of(before).chars().count();
        Position {
            file: text_of(&self.name),
            line: place.line,
            column: place.column - inside as u32,
            excerpt: line.map(text_of),
        }
    }

    /// Gives complaints about this source their positions.
    pub fn locate(&self, complaints: Vec<Complaint>) -> Faults {
        let located = complaints.into_iter().map(|(place, mut fault)| {
            fault.position = Some(self.position(place));
            fault
        });
        located.collect()
    }
}

/// How bad it is; as a number, the exit status that it leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    Warning = 1,
    Error,
    Fatal,
    Impossible,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Position {
    /// Name of the file; empty for standard input.
    pub file: String,
    /// Line, from 1.
    pub line: u32,
    /// Column in characters, from 1.
    pub column: u32,
    /// The line itself, if it is known and not empty.
    pub excerpt: Option<String>,
}

/// One message to the author of a web.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    pub level: Level,
    pub position: Option<Position>,
    /// What it is, on one line.
    pub text: String,
    /// Remedies, and further facts.
    pub help: Vec<String>,
}

impl Diagnostic {
    /// A diagnostic without help.
    pub fn new(
        level: Level,
        position: Option<Position>,
        text: impl Into<String>,
    ) -> Self {
        Self { level, position, text: text.into(), help: Vec::new() }
    }

    /// The same with one more line of help.
    pub fn with_help(mut self, help: impl Into<String>) -> Self {
        self.help.push(help.into());
        self
    }
}

/// A diagnostic without its position, and its place.
pub type Complaint = (Place, Diagnostic);

/// What is wrong, in order.
pub type Faults = Vec<Diagnostic>;

/// The report of a file that could not be read, written or removed.
pub fn failure(act: &str, path: impl AsRef<OsStr>, e: io::Error) -> Faults {
    let text = format!("cannot {act} {}: {e}", shown(path));
    vec![Diagnostic::new(Level::Error, None, text)]
}

/// A value, if nothing is wrong.
pub fn checked<T>(value: T, faults: Faults) -> Result<T, Faults> {
    if faults.is_empty() { Ok(value) } else { Err(faults) }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        if let Some(position) = &self.position {
            write!(f, "{position}: ")?;
        }
        let warning = self.level == Level::Warning;
        let level = if warning { "warning" } else { "error" };
        writeln!(f, "{level}: {}", visible(&self.text))?;
        // Show the line and point into it
        if let Some(position) = &self.position
            && let Some(line) = &position.excerpt
        {
            let blank = |c| if c == '\t' { c } else { ' ' };
            let width = position.column.saturating_sub(1) as usize;
            let pad: String = line.chars().take(width).map(blank).collect();
            writeln!(f, "  {}\n  {pad}^", visible(line.trim_end()))?;
        }
        for help in &self.help {
            writeln!(f, "  help: {}", visible(help))?;
        }
        Ok(())
    }
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let file = if self.file.is_empty() { "-" } else { &self.file };
        write!(f, "{file}:{}:{}", self.line, self.column)
    }
}

fn visible(text: &str) -> String {
    let seen = |c: char| if c.is_control() { '\u{fffd}' } else { c };
    text.chars().map(|c| if c == '\t' { c } else { seen(c) }).collect()
}
