// Tangled from noweb/chapters/markup.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A web: chunks of code with the places of everything in them.
//!
//! The definitions of a name are concatenated in the order of reading.
//! The newline that ends the last of them is not part of the chunk.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::os::unix::ffi::OsStrExt;

use crate::diagnostic::{
    Diagnostic, Faults, Level, Place, Position, Source, text_of,
};
use crate::markup::{Kind, Lexeme, Token, mark_up, parse_token};
use crate::stream::{Mark, lines};

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    Text(Vec<u8>),
    Newline,
    Use(Vec<u8>),
}

#[derive(Clone, Debug, Default)]
pub struct Chunk {
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
    pub fn find(&self, name: &[u8]) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    pub fn position(&self, place: Place) -> Option<Position> {
        let source = self.sources.get(place.file as usize)?;
        Some(source.position(place))
    }

    /// Reads sources; `tab` is the distance of tab stops, or 0.
    pub fn read(sources: Vec<Source>, tab: usize) -> (Self, Faults) {
        let (mut lexemes, mut faults) = (Vec::new(), Vec::new());
        for (source, file) in sources.iter().zip(0..) {
            let (more, complaints) = mark_up(source, file, tab);
            lexemes.extend(more);
            faults.extend(complaints);
        }
        (Self { sources, ..Self::from_lexemes(lexemes) }, faults)
    }

    /// Gathers tokens whose places may mean anything to the caller.
    pub fn from_lexemes(lexemes: Vec<Lexeme>) -> Self {
        let mut web = Self::default();
        let (mut chunk, mut heading) = (None, false);
        for (token, place) in lexemes {
            match (token, chunk) {
                (Token::Defn(name), _) => {
                    chunk = Some(web.define(name, place));
                    heading = true;
                }
                (Token::End(Kind::Code, _), _) => chunk = None,
                (Token::Newline, Some(_)) if heading => heading = false,
                (token, Some(chunk)) => web.add(chunk, token, place),
                _ => (),
            }
        }
        for chunk in &mut web.chunks {
            chunk.pieces.pop_if(|(piece, _)| *piece == Piece::Newline);
        }
        web
    }

    fn define(&mut self, name: Vec<u8>, place: Place) -> usize {
        let fresh = self.chunks.len();
        let index = *self.by_name.entry(name.clone()).or_insert(fresh);
        if index == fresh {
            self.chunks.push(Chunk { name, ..Chunk::default() });
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

    /// Reads a stream that filters may have changed.
    pub fn read_stream(stream: &[u8]) -> (Self, Faults) {
        let mut reader = StreamReader::default();
        let read = lines(stream).try_for_each(|l| reader.read_line(l));
        let whole = (reader.stage == Expected::Outside).then_some(());
        let end = whole.ok_or("the stream ends inside a code chunk");
        if let Err(text) = read.and(end) {
            reader.complain(Level::Impossible, text.into());
        }
        let StreamReader { sources, lexemes, faults, .. } = reader;
        (Self { sources, ..Self::from_lexemes(lexemes) }, faults)
    }

    /// The chunk whose name is nearest to one that none has, if any is near.
    pub fn nearest(&self, name: &[u8]) -> Option<&Chunk> {
        let limit = name.len() / 3;
        let long = |c: &&Chunk| c.name.len().abs_diff(name.len()) <= limit;
        let close = self.chunks.iter().filter(long);
        let near = close.map(|c| (edit_distance(&c.name, name), c));
        let (distance, found) = near.min_by_key(|(d, _)| *d)?;
        (0 < limit && distance <= limit).then_some(found)
    }

    /// Chunks that are lost: never used, or in a cycle that no root reaches.
    ///
    /// What `is_root` takes for one, and the default root, need no use.
    pub fn unused(&self, is_root: impl Fn(&[u8]) -> bool) -> Faults {
        let used = |c: &Chunk| self.uses.contains_key(&c.name);
        let mut marked = vec![false; self.chunks.len()];
        let tops = (0..marked.len()).filter(|n| !used(&self.chunks[*n]));
        tops.for_each(|top| self.mark_below(top, &mut marked));
        let mut faults = Vec::new();
        for (index, chunk) in self.chunks.iter().enumerate() {
            let name = quoted(&chunk.name);
            if !used(chunk) && chunk.name != b"*" && !is_root(&chunk.name) {
                let text = format!("chunk {name} is never used");
                let file = [b"./", &chunk.name[..]].concat();
                let named =
                    format!("if it is a file, call it {}", text_of(&file));
                let is_file = is_root(&file) && chunk.name[0] != b'/';
                let help = if is_file { &named } else { NO_FILE };
                faults.push(self.warn(chunk, text).with_help(help));
            } else if used(chunk) && !marked[index] {
                // Report the chunk if it marks itself
                self.mark_below(index, &mut marked);
                if marked[index] {
                    let text =
                        format!("no root reaches {name}, in a cycle");
                    faults.push(self.warn(chunk, text));
                }
            }
        }
        faults
    }

    fn warn(&self, chunk: &Chunk, text: String) -> Diagnostic {
        let position = self.position(chunk.definitions[0]);
        Diagnostic::new(Level::Warning, position, text)
    }

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
    pub fn dotted(&self) -> Faults {
        let dotted = |c: &&Chunk| c.name.ends_with(b"...");
        let report = |c: &Chunk| {
            let name = quoted(&c.name);
            self.warn(c, format!("{name} isn't completed as in web"))
        };
        self.chunks.iter().filter(dotted).map(report).collect()
    }

    /// One use of a name that is not defined.
    pub fn undefined_use(&self, name: &[u8], place: Place) -> Diagnostic {
        let text = format!("undefined chunk name: {}", quoted(name));
        let position = self.position(place);
        let mut fault = Diagnostic::new(Level::Error, position, text);
        if let Some(near) = self.nearest(name) {
            let name = quoted(&near.name);
            fault = fault.with_help(format!("there is a chunk {name}"));
        }
        fault
    }
}

#[derive(Default)]
struct StreamReader {
    sources: Vec<Source>,
    place: Place,
    stage: Expected,
    lexemes: Vec<Lexeme>,
    faults: Faults,
}

/// What the rules of the stream allow next.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Expected {
    #[default]
    Outside,
    Nameless,
    Named,
    Inside,
}

impl StreamReader {
    fn read_line(&mut self, line: &[u8]) -> Result<(), &'static str> {
        use Expected::{Inside, Named, Nameless, Outside};
        let token = parse_token(line);
        self.stage = match (self.stage, &token) {
            // Follow the rules of the stream
            (Outside, Some(Token::Begin(Kind::Code, _))) => Nameless,
            (Nameless, Some(Token::Defn(_))) => Named,
            (Nameless, Some(Token::Text(_))) => {
                return Err("code chunk had no definition line");
            }
            (Named, Some(Token::Newline)) => Inside,
            (Named, _) => {
                return Err("definition line not followed by newline");
            }
            (Inside, Some(Token::End(Kind::Code, _))) => Outside,
            (stage, _) => stage,
        };
        match token {
            Some(token) => self.take(token),
            None => self.take_other(line),
        }
        Ok(())
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
                let text = std::fs::read(OsStr::from_bytes(name));
                let text = text.unwrap_or_default();
                self.sources.push(Source::new(name.clone(), text));
            }
            _ => (),
        }
        self.lexemes.push((token, place));
    }

    fn take_other(&mut self, line: &[u8]) {
        let mark = Mark::read(line).unwrap_or_default();
        match mark.keyword {
            b"line" => {
                let number = text_of(mark.text()).parse().unwrap_or(1u32);
                self.place.line = number.saturating_sub(1);
            }
            b"index" | b"style" => {}
            _ if self.stage != Expected::Inside => {}
            _ => {
                let text =
                    format!("botched code chunk `{}'", text_of(line));
                self.complain(Level::Error, text);
            }
        }
    }

    fn complain(&mut self, level: Level, text: String) {
        let source = self.sources.get(self.place.file as usize);
        let position = source.map(|s| s.position(self.place));
        self.faults.push(Diagnostic::new(level, position, text));
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

const NO_FILE: &str = "a file is named like src/main.rs, without spaces \
    and inside the project";

pub fn quoted(name: &[u8]) -> String {
    format!("<<{}>>", text_of(name))
}
