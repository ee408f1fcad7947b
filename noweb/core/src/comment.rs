// Tangled from noweb/chapters/core.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Where in a program in Rust a comment may stand.

/// What surrounds a place of a program in Rust.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Inside {
    #[default]
    Items,
    /// Behind the word `fn`, before the body.
    Header,
    Body,
    Macro,
}

/// How far a program in Rust was read, and what is there.
#[derive(Default)]
pub struct Reader {
    at: usize,
    place: Inside,
    /// The places of the brackets that are open.
    open: Vec<Inside>,
    /// The first byte of the token before.
    last: u8,
}

impl Reader {
    /// Whether a text ends inside the body of a function; it begins with
    /// the text that was read before.
    pub fn is_in_body(&mut self, text: &[u8]) -> bool {
        while let Some(length) = token_length(&text[self.at..]) {
            self.take(&text[self.at..][..length]);
            self.at += length;
        }
        self.at == text.len() && self.place == Inside::Body
    }

    fn take(&mut self, token: &[u8]) {
        use Inside::{Body, Header, Items, Macro};
        self.place = match (token, self.place) {
            // Enter a bracket
            (b"{" | b"(" | b"[", place) => {
                let body = token == b"{" && place == Header;
                self.open.push(if body { Items } else { place });
                match place {
                    _ if self.last == b'!' => Macro,
                    Header if body => Body,
                    Header => Items,
                    _ => place,
                }
            }
            (b"}" | b")" | b"]", _) => self.open.pop().unwrap_or_default(),
            (b"fn", Items) => Header,
            (b";", Header) => Items,
            (_, place) => place,
        };
        if !token[0].is_ascii_whitespace() {
            self.last = token[0];
        }
    }
}

/// The length of the word, literal, comment or other byte that a text in
/// Rust begins with; none if its end is missing.
fn token_length(text: &[u8]) -> Option<usize> {
    text.first()?;
    let word =
        |b: &&u8| b.is_ascii_alphanumeric() || **b == b'_' || **b > 0x7f;
    let (word, rest) = text.split_at(text.iter().take_while(word).count());
    let behind = |from: usize, end: &[u8]| {
        let mut found = text.get(from..)?.windows(end.len());
        Some(from + found.position(|w| w == end)? + end.len())
    };
    let signs = rest.iter().take_while(|b| **b == b'#').count();
    match (word, rest) {
        (b"r" | b"br" | b"cr", _) if rest.get(signs) == Some(&b'"') => {
            let end = [b"\"", &rest[..signs]].concat();
            behind(word.len() + signs + 1, &end)
        }
        (b"", [b'"', ..] | [b'\'', b'\\', ..]) => closed(text),
        // Measure a character, a comment or a word
        (b"", [b'\'', rest @ ..]) => {
            let more =
                rest.iter().skip(1).take_while(|b| **b & 0xc0 == 0x80);
            let end = 1 + more.count();
            Some(if rest.get(end) == Some(&b'\'') { end + 2 } else { 1 })
        }
        (b"", [b'/', b'/', ..]) => behind(0, b"\n"),
        (b"", [b'/', b'*', ..]) => {
            let (mut depth, mut at) = (1, 2);
            while depth > 0 {
                match text.get(at..at + 2)? {
                    b"/*" => (depth, at) = (depth + 1, at + 2),
                    b"*/" => (depth, at) = (depth - 1, at + 2),
                    _ => at += 1,
                }
            }
            Some(at)
        }
        _ => Some(word.len().max(1)),
    }
}

/// The length of a literal in which there may be escapes.
fn closed(text: &[u8]) -> Option<usize> {
    let mut at = 1;
    while *text.get(at)? != text[0] {
        at += if text[at] == b'\\' { 2 } else { 1 };
    }
    Some(at + 1)
}
