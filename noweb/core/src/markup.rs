// Tangled from noweb/chapters/core.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The lexer: from the lines of a web to tokens with places.

use std::collections::BTreeSet;
use std::mem::replace;

use crate::diagnostic::{Complaint, Diagnostic, Level, Place, Source};

/// What a token is; most have a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Token {
    File,
    /// A chunk begins; the text is its number in the file.
    BeginDocs,
    BeginCode,
    EndDocs,
    EndCode,
    Text,
    /// More of the same text, after an escape that the lexer took out.
    More,
    Newline,
    /// The name that a code chunk defines.
    Defn,
    Use,
    Quote,
    EndQuote,
    /// An identifier that the chunk defines.
    Ident,
    /// The end of a line of such identifiers.
    EndIdents,
}

/// A token, its text, and where it begins.
pub type Lexeme = (Token, Vec<u8>, Place);

fn is_space(byte: &u8) -> bool {
    byte.is_ascii_whitespace() || *byte == 0x0b
}

/// Whether a line ends a chunk of code.
pub fn begins_docs(line: &[u8]) -> bool {
    line.first() == Some(&b'@') && line.get(1).is_none_or(is_space)
}

/// The name that a line defines a chunk of.
pub fn defined_name(line: &[u8]) -> Option<&[u8]> {
    let name = line.strip_prefix(b"<<")?;
    let end = find_unescaped_close(name)?;
    let tail = name[end + 2..].strip_prefix(b"=")?;
    tail.iter().all(is_space).then_some(&name[..end])
}

fn find_unescaped_close(name: &[u8]) -> Option<usize> {
    let mut at = 0;
    while at < name.len() {
        match &name[at..] {
            [b'@', b'>', b'>', ..] => at += 3,
            [b'>', b'>', ..] => return Some(at),
            _ => at += 1,
        }
    }
    None
}

/// The identifiers that a line lists as defined by the chunk before it.
pub fn listed_identifiers(line: &[u8]) -> Option<Vec<&[u8]>> {
    let list = line.strip_prefix(b"@ %def ")?;
    Some(list.split(is_space).filter(|i| !i.is_empty()).collect())
}

/// The length of the name that a use has, judged from the text after
/// its opening; or else the length of what is only text.
fn use_end(text: &[u8], quoting: bool) -> Result<usize, usize> {
    let mut at = 0;
    while at < text.len() {
        match &text[at..] {
            [b'[', b'[', code @ ..] => match quoted_length(code) {
                Some(length) => at += length + 4,
                None => break,
            },
            [b']', b']', ..] if quoting => return Err(at),
            [b'>', b'>', ..] => return Ok(at),
            _ => at += 1,
        }
    }
    Err(text.len())
}

/// The length of quoted code, judged from the text after its opening.
pub fn quoted_length(code: &[u8]) -> Option<usize> {
    let end = code.windows(2).position(|pair| pair == b"]]")?;
    Some(end + count(&code[end..], b']') - 2)
}

fn count(text: &[u8], byte: u8) -> usize {
    text.iter().take_while(|b| **b == byte).count()
}

/// The tokens of a source, and what is wrong with it.
pub fn mark_up(
    source: &Source,
    file: u32,
) -> (Vec<Lexeme>, Vec<Complaint>) {
    let text = without_mark(&source.text);
    let mut lexer = Lexer {
        place: Place { file, line: 0, column: 1 },
        start: source.text.len() - text.len(),
        definitions: source.definitions.as_ref(),
        ..Lexer::default()
    };
    lexer.emit(Token::File, &source.name, 0);
    lexer.bound([Token::BeginDocs, Token::BeginCode]);
    let mut ended = true;
    for line in text.split_inclusive(|b| *b == b'\n') {
        lexer.line = line.strip_suffix(b"\n").unwrap_or(line);
        ended = lexer.line.len() < line.len();
        lexer.mark_line(ended);
        lexer.start += line.len();
    }
    // Finish the last chunk
    lexer.close_quote();
    if !ended {
        lexer.emit(Token::Newline, b"", lexer.line.len());
    }
    lexer.bound([Token::EndDocs, Token::EndCode]);
    (lexer.lexemes, lexer.faults)
}

/// A text behind its byte order mark.
pub fn without_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

#[derive(Default)]
struct Lexer<'a> {
    place: Place,
    /// Whether we are in a chunk of code, and its number.
    code: bool,
    chunk: usize,
    /// The line before has listed identifiers.
    listed: bool,
    definitions: Option<&'a BTreeSet<usize>>,
    /// Where the quoted code began, if we are inside it.
    quote: Option<Place>,
    /// The line that is scanned, where it starts, and how far.
    line: &'a [u8],
    start: usize,
    at: usize,
    text_at: usize,
    /// The next text continues one that was emitted already.
    glued: bool,
    lexemes: Vec<Lexeme>,
    faults: Vec<Complaint>,
}

/// The lines of a text, without their newlines.
pub fn lines(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split_inclusive(|&byte| byte == b'\n')
        .map(|line| line.strip_suffix(b"\n").unwrap_or(line))
}

impl<'a> Lexer<'a> {
    fn mark_line(&mut self, ended: bool) {
        let line = self.line;
        self.place.line += 1;
        self.at = 0;
        let foreign = self.is_foreign();
        let defines = |all: &BTreeSet<usize>| all.contains(&self.start);
        let defines = !foreign || self.definitions.is_some_and(defines);
        if let Some(name) = defined_name(line).filter(|_| defines) {
            self.begin(true);
            self.emit(Token::Defn, name, 2);
            self.emit(Token::Newline, b"", line.len());
        } else if let Some(names) = listed_identifiers(line)
            && !foreign
        {
            for name in names {
                self.emit(Token::Ident, name, 0);
            }
            self.emit(Token::EndIdents, b"", line.len());
            self.listed = self.code;
        } else {
            // Begin prose if the line says so
            let marked = !foreign && begins_docs(line);
            if marked {
                self.at = line.len().min(2);
            }
            if marked || self.listed {
                self.begin(false);
            }
            self.scan(ended);
        }
    }

    /// Whether we are in prose that does not follow our rules.
    fn is_foreign(&self) -> bool {
        !self.code && self.definitions.is_some()
    }

    fn begin(&mut self, code: bool) {
        self.close_quote();
        self.bound([Token::EndDocs, Token::EndCode]);
        (self.code, self.listed) = (code, false);
        self.chunk += 1;
        self.bound([Token::BeginDocs, Token::BeginCode]);
    }

    /// Emits one of two tokens, the first for prose and the second for code.
    fn bound(&mut self, tokens: [Token; 2]) {
        let number = self.chunk.to_string();
        self.emit(tokens[usize::from(self.code)], number.as_bytes(), 0);
    }

    fn close_quote(&mut self) {
        if let Some(place) = self.quote.take() {
            let text = "open quote `[[' never closed";
            let fault = Diagnostic::new(Level::Warning, None, text);
            self.faults.push((place, fault));
        }
    }

    fn scan(&mut self, ended: bool) {
        self.text_at = self.at;
        if self.is_foreign() {
            self.at = self.line.len();
        } else if self.line[self.at..].starts_with(b"@@") {
            self.escape(2);
        }
        while self.at < self.line.len() {
            if self.code || self.quote.is_some() {
                self.scan_code();
            } else {
                self.scan_docs();
            }
        }
        self.end_text(ended);
        if ended {
            self.emit(Token::Newline, b"", self.at);
        }
    }

    fn scan_docs(&mut self) {
        match &self.line[self.at..] {
            [b'@', a, b, ..] if a == b && b"[]<>".contains(a) => {
                self.escape(3);
            }
            [b'[', b'[', ..] => {
                self.quote = Some(self.place_at(self.at));
                self.pass(Token::Quote, b"", 2);
            }
            [b'<', b'<', ..] => {
                // Suggest a fix for the brackets
                let line = self.line;
                let start = line.iter().take_while(|b| is_space(b)).count();
                let indented = start == self.at
                    && defined_name(&line[start..]).is_some();
                let help = if indented {
                    "a definition begins in the first column"
                } else {
                    "write @<< for the brackets themselves, or quote code in [[ ]]"
                };
                let text = "unescaped << in documentation chunk";
                let fault = Diagnostic::new(Level::Error, None, text)
                    .with_help(help);
                self.faults.push((self.place_at(self.at), fault));
                self.at += 2;
            }
            _ => self.at += 1,
        }
    }

    fn scan_code(&mut self) {
        let quoting = self.quote.is_some();
        match &self.line[self.at..] {
            [b'@', a, b, ..] if a == b && b"<>".contains(a) => {
                self.escape(3);
            }
            rest @ [b']', b']', ..] if quoting => {
                self.at += count(rest, b']') - 2;
                self.pass(Token::EndQuote, b"", 2);
                self.quote = None;
            }
            [b'<', b'<', rest @ ..] => {
                self.end_text(false);
                match use_end(rest, quoting) {
                    Ok(end) => self.pass(Token::Use, &rest[..end], end + 4),
                    Err(length) => self.at += length + 2,
                }
            }
            _ => self.at += 1,
        }
    }

    fn place_at(&self, at: usize) -> Place {
        Place { column: at as u32 + 1, ..self.place }
    }

    fn emit(&mut self, token: Token, text: &[u8], at: usize) {
        self.lexemes.push((token, text.to_vec(), self.place_at(at)));
    }

    /// Passes an escape of so many bytes, of which the first is dropped.
    fn escape(&mut self, length: usize) {
        self.flush();
        self.text_at = self.at + 1;
        self.at += length;
    }

    fn flush(&mut self) {
        if self.text_at < self.at {
            let text = &self.line[self.text_at..self.at];
            let glued = replace(&mut self.glued, true);
            let token = if glued { Token::More } else { Token::Text };
            self.emit(token, text, self.text_at);
        }
        self.text_at = self.at;
    }

    fn end_text(&mut self, even_empty: bool) {
        self.flush();
        if even_empty && !self.glued {
            self.emit(Token::Text, b"", self.at);
        }
        self.glued = false;
    }

    fn pass(&mut self, token: Token, text: &[u8], length: usize) {
        self.end_text(false);
        self.emit(token, text, self.at);
        self.at += length;
        self.text_at = self.at;
    }
}
