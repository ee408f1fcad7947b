// Tangled from noweb/chapters/core.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A web: chunks of code with the places of everything in them.

use std::collections::HashMap;

use strsim::generic_levenshtein;

use crate::diagnostic::{
    Complaint, Faults, Place, Position, Source, text_of,
};
use crate::markup::{Lexeme, Token};

#[derive(Clone, Debug, Default)]
pub struct Chunk {
    pub name: Vec<u8>,
    /// Where each definition begins; never empty.
    pub definitions: Vec<Place>,
    /// The pieces of all definitions.
    pub pieces: Vec<Lexeme>,
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

/// The name of a chunk in its brackets, for a message.
pub fn quoted(name: &[u8]) -> String {
    format!("<<{}>>", text_of(name))
}

impl Web {
    /// Reads sources with a lexer; returns the web and its faults.
    pub fn read(
        sources: Vec<Source>,
        lexer: impl Fn(&Source, u32) -> (Vec<Lexeme>, Vec<Complaint>),
    ) -> (Self, Faults) {
        let (mut lexemes, mut faults) = (Vec::new(), Vec::new());
        for (source, file) in sources.iter().zip(0..) {
            let (more, complaints) = lexer(source, file);
            lexemes.extend(more);
            faults.extend(source.locate(complaints));
        }
        (Self { sources, ..Self::from_lexemes(lexemes) }, faults)
    }

    /// Gathers tokens whose places may mean anything to the caller.
    pub fn from_lexemes(lexemes: Vec<Lexeme>) -> Self {
        let mut web = Self::default();
        let (mut chunk, mut heading) = (None, false);
        for (token, text, place) in lexemes {
            match (token, chunk) {
                (Token::Defn, _) => {
                    chunk = Some(web.define(text, place));
                    heading = true;
                }
                (Token::EndCode, _) => chunk = None,
                (Token::Newline, Some(_)) if heading => heading = false,
                // Add a piece to the chunk
                (
                    Token::Text | Token::More | Token::Newline | Token::Use,
                    Some(chunk),
                ) => {
                    if token == Token::Use {
                        web.uses.entry(text.clone()).or_insert(place);
                    }
                    web.chunks[chunk].pieces.push((token, text, place));
                }
                _ => (),
            }
        }
        for chunk in &mut web.chunks {
            chunk.pieces.pop_if(|(piece, ..)| *piece == Token::Newline);
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

    pub fn find(&self, name: &[u8]) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    pub fn position(&self, place: Place) -> Option<Position> {
        let source = self.sources.get(place.file as usize)?;
        Some(source.position(place))
    }

    /// The chunk whose name is nearest to an undefined one, if any is near.
    pub fn nearest(&self, name: &[u8]) -> Option<&Chunk> {
        let limit = name.len() / 3;
        let long = |c: &&Chunk| c.name.len().abs_diff(name.len()) <= limit;
        let close = self.chunks.iter().filter(long);
        let name = name.to_vec();
        let distance = |c: &Chunk| generic_levenshtein(&c.name, &name);
        let near = close.map(|c| (distance(c), c));
        let (distance, found) = near.min_by_key(|(d, _)| *d)?;
        (0 < limit && distance <= limit).then_some(found)
    }
}
