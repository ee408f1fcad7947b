// Tangled from noweb/chapters/core.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Expansion of root chunks into program text, with its position map.

use std::collections::HashSet;
use std::mem::replace;

use crate::comment::Reader;
use crate::diagnostic::{Diagnostic, Faults, Level, Place, checked};
use crate::markup::{Lexeme, Token};
use crate::web::{Web, quoted};

/// A stretch of tangled text that comes from one place.
/// It lasts to the next segment, and never beyond the end of its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Line of the tangled text, from 1.
    pub line: u32,
    /// Column in bytes, from 1, after the indentation.
    pub column: u32,
    pub place: Place,
    /// What tangling indents the lines of this chunk by, here.
    pub indent: u32,
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Tangled {
    pub text: Vec<u8>,
    /// Its segments in the order of the text; every line has one.
    pub map: Vec<Segment>,
}

impl Tangled {
    pub fn segments(&self, line: u32) -> &[Segment] {
        let from = self.map.partition_point(|s| s.line < line);
        let to = self.map.partition_point(|s| s.line <= line);
        &self.map[from..to]
    }

    /// Where a line and a column (in bytes, from 1) come from.
    pub fn origin(&self, line: u32, column: u32) -> Option<Place> {
        let here = self.segments(line);
        let before = here.iter().take_while(|s| s.column <= column);
        let segment = before.last().or(here.first())?;
        let inside = column.saturating_sub(segment.column);
        let column = segment.place.column + inside;
        Some(Place { column, ..segment.place })
    }
}

/// The text of a root, given by its number; in Rust the names of chunks
/// become comments.
///
/// # Errors
/// A use below the root has no definition, or leads back to itself.
pub fn tangle(
    web: &Web,
    root: usize,
    rust: bool,
) -> Result<Tangled, Faults> {
    let mut expander = Expander {
        web,
        rust,
        tangled: Tangled::default(),
        line: 1,
        line_start: 0,
        top: Frame::default(),
        stack: Vec::new(),
        active: vec![false; web.chunks.len()],
        blank: Vec::new(),
        reader: Reader::default(),
        faults: Vec::new(),
        reported: HashSet::new(),
    };
    expander.enter(root, 0, None);
    while expander.step() {}
    expander.break_line();
    checked(expander.tangled, expander.faults)
}

/// A chunk that is being expanded.
#[derive(Default)]
struct Frame<'a> {
    chunk: usize,
    /// The pieces that are still to come.
    rest: &'a [Lexeme],
    /// What its lines are indented by.
    indent: usize,
    /// The width of what is on the line already.
    column: usize,
    /// The use that we came by.
    used: Option<Place>,
}

struct Expander<'a> {
    web: &'a Web,
    rust: bool,
    tangled: Tangled,
    line: u32,
    line_start: usize,
    /// The chunk that is expanded, and those in which it is used.
    top: Frame<'a>,
    stack: Vec<Frame<'a>>,
    active: Vec<bool>,
    /// White space as wide as what the line of the source has before.
    blank: Vec<u8>,
    reader: Reader,
    faults: Faults,
    reported: HashSet<Place>,
}

impl<'a> Expander<'a> {
    /// Expands one piece; false at the end of the root.
    fn step(&mut self) -> bool {
        let [(piece, text, place), after @ ..] = self.top.rest else {
            // Leave the chunk
            self.active[self.top.chunk] = false;
            self.blank.truncate(self.top.indent);
            self.top = self.stack.pop().unwrap_or_default();
            return !self.stack.is_empty();
        };
        self.top.rest = after;
        match piece {
            Token::Newline => {
                // End a line
                let last = self.tangled.map.last();
                if last.is_none_or(|s| s.line != self.line) {
                    self.mark(*place);
                }
                self.break_line();
                self.top.column = 0;
            }
            Token::Use => self.use_chunk(text, *place),
            _ => self.text(text, *place),
        }
        true
    }

    fn enter(&mut self, chunk: usize, column: usize, used: Option<Place>) {
        self.active[chunk] = true;
        self.blank.resize(column, b' ');
        let (indent, rest) = (column, &self.web.chunks[chunk].pieces[..]);
        let frame = Frame { chunk, rest, indent, column, used };
        self.stack.push(replace(&mut self.top, frame));
    }

    fn text(&mut self, text: &[u8], place: Place) {
        if text.is_empty() {
            return;
        }
        self.indent();
        self.mark(place);
        self.tangled.text.extend(text);
        let blank = |b: &u8| if *b == b'\t' { b'\t' } else { b' ' };
        self.blank.resize(self.top.column, b' ');
        self.blank.extend(text.iter().map(blank));
        self.top.column += text.len();
    }

    fn indent(&mut self) {
        if self.top.column == 0 {
            self.top.column = self.top.indent;
            self.tangled.text.extend(&self.blank[..self.top.indent]);
        }
    }

    fn break_line(&mut self) {
        self.tangled.text.push(b'\n');
        self.line += 1;
        self.line_start = self.tangled.text.len();
    }

    fn mark(&mut self, place: Place) {
        let column = self.tangled.text.len() - self.line_start + 1;
        let (column, indent) = (column as u32, self.top.indent as u32);
        let segment = Segment { line: self.line, column, place, indent };
        self.tangled.map.push(segment);
    }

    /// Whether the use that was read last has its own line.
    fn is_alone(&self) -> bool {
        let is_text = |token| matches!(token, Token::Text | Token::More);
        let mut rest =
            self.top.rest.iter().skip_while(|(token, text, _)| {
                is_text(*token) && text.trim_ascii().is_empty()
            });
        let line = &self.tangled.text[self.line_start..];
        let ends =
            rest.next().is_none_or(|(token, ..)| *token == Token::Newline);
        ends && line.trim_ascii().is_empty()
    }

    fn write_name(&mut self, name: &[u8], place: Place) {
        let text = &self.tangled.text;
        let blank = text[self.line_start..].to_vec();
        let named = self.rust && std::str::from_utf8(name).is_ok();
        if named && !blank.is_empty() && self.reader.is_in_body(text) {
            self.mark(place);
            let comment = [b"// ", &spoken_name(name)[..]].concat();
            self.tangled.text.extend(comment);
            self.break_line();
            self.tangled.text.extend(blank);
        } else {
            let map = &mut self.tangled.map;
            map.truncate(map.partition_point(|s| s.line < self.line));
        }
    }

    fn use_chunk(&mut self, name: &[u8], place: Place) {
        let alone = self.is_alone();
        self.indent();
        let column = self.top.column;
        self.top.column += name.len() + 4;
        match self.web.find(name) {
            Some(chunk) if !self.active[chunk] => {
                if alone {
                    self.write_name(name, place);
                }
                self.enter(chunk, column, Some(place));
            }
            _ if !self.reported.insert(place) => (),
            None => self.report_undefined(name, place, alone),
            Some(chunk) => self.report_cycle(chunk, place),
        }
    }

    fn report_undefined(&mut self, name: &[u8], place: Place, alone: bool) {
        let text = format!("undefined chunk name: {}", quoted(name));
        let position = self.web.position(place);
        let mut fault = Diagnostic::new(Level::Error, position, text);
        if let Some(near) = self.web.nearest(name) {
            let name = quoted(&near.name);
            fault = fault.with_help(format!("there is a chunk {name}"));
        } else if !alone && looks_like_code(name) {
            fault = fault.with_help("for the operator itself, write @<<");
        }
        self.faults.push(fault);
    }

    fn report_cycle(&mut self, chunk: usize, place: Place) {
        let web = self.web;
        let frames = self.stack.iter().skip(1).chain([&self.top]);
        let cycle: Vec<_> =
            frames.skip_while(|f| f.chunk != chunk).collect();
        let name = |chunk: usize| quoted(&web.chunks[chunk].name);
        let names = cycle.iter().map(|frame| name(frame.chunk));
        let names: Vec<String> = names.chain([name(chunk)]).collect();
        let text = format!("Cyclic code chunks: {}", names.join(" -> "));
        let position = web.position(place);
        let mut fault = Diagnostic::new(Level::Error, position, text);
        // List the uses that make the cycle
        let inner = cycle.iter().skip(1).map(|frame| frame.used);
        let uses = inner.chain([Some(place)]);
        for (pair, used) in names.windows(2).zip(uses) {
            if let Some(position) = used.and_then(|p| web.position(p)) {
                let (outer, inner) = (&pair[0], &pair[1]);
                let help = format!("{outer} uses {inner} at {position}");
                fault = fault.with_help(help);
            }
        }
        self.faults.push(fault);
    }
}

fn looks_like_code(name: &[u8]) -> bool {
    let odd = |b: &u8| b"<>:;=&|(){},".contains(b);
    name.trim_ascii().len() < name.len()
        || !name.contains(&b' ')
        || name.iter().any(odd)
}

fn spoken_name(name: &[u8]) -> Vec<u8> {
    let name = String::from_utf8_lossy(name).replace("[[", "`");
    name.replace("]]]", "]`").replace("]]", "`").into_bytes()
}
