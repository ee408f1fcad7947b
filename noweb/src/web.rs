// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! A web: chunks of code with the places of everything in them.
//!
//! The definitions of a name are concatenated in the order of reading.
//! The newline that ends the last of them is not part of the chunk.

use std::collections::HashMap;

use crate::diagnostic::{Diagnostic, Level, Place, Position, Source};
use crate::markup::{
    Kind, Lexeme, Token, mark_up, parse_token, split_word,
};
use crate::stream::lines;

// Define the chunks of a web
/// One piece of a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    /// Text without a newline.
    Text(Vec<u8>),
    /// The end of a line.
    Newline,
    /// The name of a chunk that goes here.
    Use(Vec<u8>),
}

/// All that is defined under one name.
#[derive(Clone, Debug)]
pub struct Chunk {
    /// The name, byte for byte.
    pub name: Vec<u8>,
    /// Where each definition begins; never empty.
    pub definitions: Vec<Place>,
    /// The pieces of all definitions, with their places.
    pub pieces: Vec<(Piece, Place)>,
}

/// The chunks of some sources.
#[derive(Clone, Debug, Default)]
pub struct Web {
    /// The sources, in the order of reading.
    pub sources: Vec<Source>,
    /// The chunks, in the order of their first definitions.
    pub chunks: Vec<Chunk>,
    /// For every name that code uses, where it does so first.
    pub uses: HashMap<Vec<u8>, Place>,
    by_name: HashMap<Vec<u8>, usize>,
}

impl Web {
    /// The index of the chunk with this name.
    pub fn find(&self, name: &[u8]) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    /// The position of a place, for people.
    pub fn position(&self, place: Place) -> Option<Position> {
        let source = self.sources.get(place.file as usize)?;
        Some(source.position(place))
    }
}

// Gather the chunks from tokens
impl Web {
    // Turn tokens into chunks
    /// Reads sources; `tab` is the distance of tab stops, or 0.
    pub fn read(
        sources: Vec<Source>,
        tab: usize,
    ) -> (Self, Vec<Diagnostic>) {
        let mut web = Self::default();
        let mut faults = Vec::new();
        for (source, file) in sources.iter().zip(0..) {
            let (lexemes, more) = mark_up(source, file, tab);
            faults.extend(more);
            web.gather(lexemes);
        }
        web.drop_final_newlines();
        web.sources = sources;
        (web, faults)
    }

    fn gather(&mut self, lexemes: Vec<Lexeme>) {
        let mut chunk = None;
        let mut heading = false;
        for (token, place) in lexemes {
            match (token, chunk) {
                (Token::Defn(name), _) => {
                    chunk = Some(self.define(name, place));
                    heading = true;
                }
                (Token::End(Kind::Code, _), _) => chunk = None,
                (Token::Newline, Some(_)) if heading => heading = false,
                (token, Some(chunk)) => self.add(chunk, token, place),
                _ => (),
            }
        }
    }

    fn define(&mut self, name: Vec<u8>, place: Place) -> usize {
        let fresh = self.chunks.len();
        let index = *self.by_name.entry(name.clone()).or_insert(fresh);
        if index == fresh {
            let (definitions, pieces) = (Vec::new(), Vec::new());
            self.chunks.push(Chunk { name, definitions, pieces });
        }
        self.chunks[index].definitions.push(place);
        index
    }

    fn add(&mut self, chunk: usize, token: Token, place: Place) {
        let piece = match token {
            Token::Text(text) | Token::More(text) => Piece::Text(text),
            Token::Newline => Piece::Newline,
            Token::Use(name) => {
                self.uses.entry(name.clone()).or_insert(place);
                Piece::Use(name)
            }
            _ => return,
        };
        self.chunks[chunk].pieces.push((piece, place));
    }

    fn drop_final_newlines(&mut self) {
        for chunk in &mut self.chunks {
            let last = chunk.pieces.last();
            if last.is_some_and(|(piece, _)| *piece == Piece::Newline) {
                chunk.pieces.pop();
            }
        }
    }
}

// Gather the tokens from a stream
impl Web {
    /// Reads a stream that filters may have changed.
    pub fn read_stream(stream: &[u8]) -> (Self, Vec<Diagnostic>) {
        let mut reader = StreamReader::default();
        for line in lines(stream) {
            reader.read_line(line);
        }
        reader.finish();
        let mut web = Self::from_lexemes(reader.lexemes);
        web.sources = reader.sources;
        (web, reader.faults)
    }

    /// Gathers tokens whose places may mean anything to the caller.
    pub fn from_lexemes(lexemes: Vec<Lexeme>) -> Self {
        let mut web = Self::default();
        web.gather(lexemes);
        web.drop_final_newlines();
        web
    }
}

#[derive(Default)]
struct StreamReader {
    sources: Vec<Source>,
    place: Place,
    stage: Expected,
    lexemes: Vec<Lexeme>,
    faults: Vec<Diagnostic>,
}

/// What the rules of the stream allow next.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Expected {
    #[default]
    Outside,
    /// A code chunk began: its name must come.
    Nameless,
    /// The name came: the end of its line must come.
    Named,
    /// The text of a code chunk.
    Inside,
}

impl StreamReader {
    // Read the lines of the stream
    fn read_line(&mut self, line: &[u8]) {
        if self.broken() {
            return;
        }
        use Expected::{Inside, Named, Nameless, Outside};
        let token = parse_token(line);
        self.stage = match (self.stage, &token) {
            // Follow the rules of the stream
            (Outside, Some(Token::Begin(Kind::Code, _))) => Nameless,
            (Nameless, Some(Token::Defn(_))) => Named,
            (Nameless, Some(Token::Text(_))) => {
                return self.give_up("code chunk had no definition line");
            }
            (Named, Some(Token::Newline)) => Inside,
            (Named, _) => {
                let text = "definition line not followed by newline";
                return self.give_up(text);
            }
            (Inside, Some(Token::End(Kind::Code, _))) => Outside,
            (stage, _) => stage,
        };
        match token {
            Some(token) => self.take(token),
            None => self.take_other(line),
        }
    }

    fn broken(&self) -> bool {
        let last = self.faults.last();
        last.is_some_and(|f| f.level == Level::Impossible)
    }

    fn take(&mut self, token: Token) {
        let place = self.place;
        self.place.column += match &token {
            Token::Text(text) => text.len() as u32,
            Token::Use(name) => name.len() as u32 + 4,
            Token::Quote | Token::EndQuote => 2,
            _ => 0,
        };
        // Move on to the next line or file
        match &token {
            Token::Newline | Token::EndIdents => {
                self.place.line += 1;
                self.place.column = 1;
            }
            Token::File(name) => {
                let file = self.sources.len() as u32;
                self.place = Place { file, line: 1, column: 1 };
                self.sources.push(open_again(name));
            }
            _ => (),
        }
        self.lexemes.push((token, place));
    }

    fn take_other(&mut self, line: &[u8]) {
        let (keyword, value) = split_word(line);
        if keyword == b"@line" {
            let number = std::str::from_utf8(value).unwrap_or("");
            let number = number.parse().unwrap_or(1u32);
            self.place.line = number.saturating_sub(1);
        } else if self.stage == Expected::Inside && !is_extra(keyword) {
            let line = String::from_utf8_lossy(line);
            let text = format!("botched code chunk `{line}'");
            self.complain(Level::Error, text);
        }
    }

    fn give_up(&mut self, text: &str) {
        self.complain(Level::Impossible, text.into());
    }

    fn complain(&mut self, level: Level, text: String) {
        let source = self.sources.get(self.place.file as usize);
        let position = source.map(|s| s.position(self.place));
        self.faults.push(Diagnostic::new(level, position, text));
    }

    fn finish(&mut self) {
        if self.stage != Expected::Outside && !self.broken() {
            self.give_up("the stream ends inside a code chunk");
        }
    }
}

fn is_extra(keyword: &[u8]) -> bool {
    matches!(keyword, b"@index" | b"@style")
}

/// The source that a stream names, for its diagnostics.
fn open_again(name: &[u8]) -> Source {
    let path = String::from_utf8_lossy(name).into_owned();
    let text = std::fs::read(path).unwrap_or_default();
    Source::new(name.to_vec(), text)
}

// Find the nearest defined name
impl Web {
    /// The defined name nearest to one that is not, if any is near.
    ///
    /// Near is at most a third of the letters changed, added or lost.
    pub fn nearest(&self, name: &[u8]) -> Option<&[u8]> {
        let limit = name.len() / 3;
        let names = self.chunks.iter().map(|c| &c.name[..]);
        let close = names.filter(|n| n.len().abs_diff(name.len()) <= limit);
        let near = close.map(|n| (edit_distance(n, name), n));
        let (distance, found) = near.min_by_key(|(d, _)| *d)?;
        (0 < limit && distance <= limit).then_some(found)
    }
}

fn edit_distance(a: &[u8], b: &[u8]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = i;
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let changed = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = changed.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

// Report what looks wrong in a web
impl Web {
    // Look for chunks that are astray
    /// Chunks that are defined and never used, except roots.
    ///
    /// What `is_root` takes for one, and the default root, need no use.
    pub fn unused(
        &self,
        is_root: impl Fn(&[u8]) -> bool,
    ) -> Vec<Diagnostic> {
        let idle = |c: &&Chunk| {
            let known = c.name == b"*" || is_root(&c.name);
            !known && !self.uses.contains_key(&c.name)
        };
        let chunks = self.chunks.iter().filter(idle);
        let report = |c: &Chunk| {
            let text = format!("chunk {} is never used", quoted(&c.name));
            let position = self.position(c.definitions[0]);
            Diagnostic::new(Level::Warning, position, text)
        };
        chunks.map(report).collect()
    }

    /// Chunks in cycles that no root reaches, one for each cycle.
    pub fn adrift(&self) -> Vec<Diagnostic> {
        let mut marked = vec![false; self.chunks.len()];
        let is_root = |c: &Chunk| !self.uses.contains_key(&c.name);
        for (index, chunk) in self.chunks.iter().enumerate() {
            if is_root(chunk) {
                self.mark_below(index, &mut marked);
            }
        }
        let mut faults = Vec::new();
        for (index, chunk) in self.chunks.iter().enumerate() {
            if is_root(chunk) || marked[index] {
                continue;
            }
            self.mark_below(index, &mut marked);
            // Report the chunk if it has marked itself
            if marked[index] {
                let name = quoted(&chunk.name);
                let text = format!("no root reaches {name}, in a cycle");
                let at = self.position(chunk.definitions[0]);
                faults.push(Diagnostic::new(Level::Warning, at, text));
            }
        }
        faults
    }

    /// Marks what a chunk uses, directly or through others.
    fn mark_below(&self, chunk: usize, marked: &mut [bool]) {
        let mut waiting = vec![chunk];
        while let Some(chunk) = waiting.pop() {
            for (piece, _) in &self.chunks[chunk].pieces {
                let Piece::Use(name) = piece else { continue };
                let Some(used) = self.find(name) else { continue };
                if !std::mem::replace(&mut marked[used], true) {
                    waiting.push(used);
                }
            }
        }
    }

    /// Names that end in dots, which WEB would have completed.
    pub fn dotted(&self) -> Vec<Diagnostic> {
        let dotted = |c: &&Chunk| c.name.ends_with(b"...");
        let report = |c: &Chunk| {
            let name = quoted(&c.name);
            let text = format!("{name} isn't completed as in web");
            let position = self.position(c.definitions[0]);
            Diagnostic::new(Level::Warning, position, text)
        };
        self.chunks.iter().filter(dotted).map(report).collect()
    }

    /// Chunks that a file uses although only later files define them.
    pub fn forward(&self) -> Vec<Diagnostic> {
        let report = |c: &Chunk| {
            let used = *self.uses.get(&c.name)?;
            let defined = *c.definitions.first()?;
            let at = self.position(defined)?;
            let name = quoted(&c.name);
            let text = format!("{name} is defined only later, at {at}");
            let position = self.position(used);
            let note = Diagnostic::new(Level::Note, position, text);
            (used.file < defined.file).then_some(note)
        };
        self.chunks.iter().filter_map(report).collect()
    }

    /// Names that some chunk uses and none defines.
    pub fn undefined(&self) -> Vec<Diagnostic> {
        let missing = |name: &&Vec<u8>| self.find(name).is_none();
        let mut uses: Vec<(&Vec<u8>, Place)> =
            self.uses.iter().map(|(n, p)| (n, *p)).collect();
        uses.retain(|(name, _)| missing(name));
        uses.sort_by_key(|(_, p)| (p.file, p.line, p.column));
        let uses = uses.into_iter();
        uses.map(|(name, place)| self.undefined_use(name, place)).collect()
    }

    /// One use of a name that is not defined.
    pub fn undefined_use(&self, name: &[u8], place: Place) -> Diagnostic {
        let text = format!("undefined chunk name: {}", quoted(name));
        let position = self.position(place);
        let fault = Diagnostic::new(Level::Error, position, text);
        match self.nearest(name) {
            Some(near) => {
                let help = format!("there is a chunk {}", quoted(near));
                fault.with_help(help)
            }
            None => fault,
        }
    }
}

/// A name in its brackets, for a message.
pub fn quoted(name: &[u8]) -> String {
    format!("<<{}>>", String::from_utf8_lossy(name))
}
