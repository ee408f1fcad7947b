// Tangled from noweb/chapters/markup.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The lexer: from the text of a web to tokens, and to the stream.
//!
//! The stream is noweb's documented form: one token on a line, a keyword
//! that begins with `@` and its value. It loses nothing that tangling or
//! weaving needs. Tokens have places, which the stream has not.

use std::ffi::OsString;

use crate::Streams;
use crate::commonmark::Markdown;
use crate::diagnostic::{
    Diagnostic, Faults, Level, Place, Source, error, text_of,
};
use crate::stream::{Mark, put};

/// What a chunk holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kind {
    #[default]
    Docs,
    Code,
}

/// One token of the stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Token {
    File(Vec<u8>),
    /// A chunk begins; chunks are numbered from 0 in their file.
    Begin(Kind, usize),
    End(Kind, usize),
    Text(Vec<u8>),
    /// More of the same text, after an escape that the lexer took out.
    More(Vec<u8>),
    Newline,
    /// The name that a code chunk defines.
    Defn(Vec<u8>),
    Use(Vec<u8>),
    Quote,
    EndQuote,
    /// An identifier that the chunk defines.
    Ident(Vec<u8>),
    /// The end of a line of such identifiers.
    EndIdents,
}

/// A token and where it begins.
pub type Lexeme = (Token, Place);

#[derive(Default)]
struct Line {
    bytes: Vec<u8>,
    /// For every byte its column in the source; empty if unchanged.
    columns: Vec<u32>,
}

impl Line {
    fn column(&self, at: usize) -> u32 {
        let moved = || self.columns.get(at).or(self.columns.last());
        moved().copied().unwrap_or(at as u32 + 1)
    }
}

fn expand_tabs(line: &[u8], tab: usize) -> Line {
    if tab == 0 || !line.contains(&b'\t') {
        return Line { bytes: line.to_vec(), columns: Vec::new() };
    }
    let mut bytes = Vec::new();
    let mut columns = Vec::new();
    for (byte, column) in line.iter().zip(1..) {
        let tab_stop = (bytes.len() / tab + 1) * tab;
        match byte {
            b'\t' => bytes.resize(tab_stop, b' '),
            _ => bytes.push(*byte),
        }
        columns.resize(bytes.len(), column);
    }
    columns.push(line.len() as u32 + 1);
    Line { bytes, columns }
}

fn is_space(byte: &u8) -> bool {
    byte.is_ascii_whitespace() || *byte == 0x0b
}

pub fn begins_docs(line: &[u8]) -> bool {
    line.first() == Some(&b'@') && line.get(1).is_none_or(is_space)
}

fn defined_name(line: &[u8]) -> Option<&[u8]> {
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
fn listed_identifiers(line: &[u8]) -> Option<Vec<&[u8]>> {
    let list = line.strip_prefix(b"@ %def ")?;
    Some(list.split(is_space).filter(|i| !i.is_empty()).collect())
}

/// Whether a file of this name has prose in Markdown.
pub fn is_markdown(name: &[u8]) -> bool {
    name.ends_with(b".md")
}

fn defines(line: &[u8]) -> bool {
    defined_name(line).is_some()
}

/// The length of the name that a use has, judged from the text after
/// its opening; or else the length of what is only text.
fn use_end(text: &[u8], quoting: bool) -> Result<usize, usize> {
    let mut at = 0;
    let close = |code: &[u8]| code.windows(2).position(|w| w == b"]]");
    while at < text.len() {
        match &text[at..] {
            [b'[', b'[', code @ ..] => match close(code) {
                Some(end) => at += 2 + end + count(&code[end..], b']'),
                None => break,
            },
            [b']', b']', ..] if quoting => return Err(at),
            [b'>', b'>', ..] => return Ok(at),
            _ => at += 1,
        }
    }
    Err(text.len())
}

fn count(text: &[u8], byte: u8) -> usize {
    text.iter().take_while(|b| **b == byte).count()
}

/// The tokens of a source, and what is wrong with it.
pub fn mark_up(
    source: &Source,
    file: u32,
    tab: usize,
) -> (Vec<Lexeme>, Faults) {
    let place = Place { file, line: 0, column: 1 };
    let text = source.text.strip_prefix(b"\xef\xbb\xbf");
    let text = text.unwrap_or(&source.text);
    let markdown = is_markdown(&source.name);
    let markdown = markdown.then(|| Markdown::new(text, defines));
    let tab = if markdown.is_some() { 0 } else { tab };
    let mut lexer = Lexer { place, tab, markdown, ..Lexer::default() };
    lexer.emit(Token::File(source.name.clone()), 0);
    lexer.emit(Token::Begin(Kind::Docs, 0), 0);
    let mut ended = true;
    for line in text.split_inclusive(|b| *b == b'\n') {
        let body = line.strip_suffix(b"\n").unwrap_or(line);
        ended = body.len() < line.len();
        lexer.mark_line(body, ended);
        lexer.start += line.len();
    }
    lexer.finish(ended);
    // Give the complaints their positions
    let faults = lexer.faults.into_iter().map(|(place, mut fault)| {
        fault.position = Some(source.position(place));
        fault
    });
    (lexer.lexemes, faults.collect())
}

#[derive(Default)]
struct Lexer {
    place: Place,
    tab: usize,
    kind: Kind,
    count: usize,
    listed: bool,
    /// The text, if its prose is in Markdown.
    markdown: Option<Markdown>,
    /// Where the quoted code began, if we are inside it.
    quote: Option<Place>,
    /// The line that is scanned, where it starts, and how far.
    line: Line,
    start: usize,
    at: usize,
    text_at: usize,
    /// It continues a text that was emitted already.
    glued: bool,
    lexemes: Vec<Lexeme>,
    faults: Vec<(Place, Diagnostic)>,
}

impl Lexer {
    fn place_at(&self, at: usize) -> Place {
        Place { column: self.line.column(at), ..self.place }
    }

    fn emit(&mut self, token: Token, at: usize) {
        self.lexemes.push((token, self.place_at(at)));
    }

    fn mark_line(&mut self, body: &[u8], ended: bool) {
        self.place.line += 1;
        self.line = expand_tabs(body, self.tab);
        self.at = 0;
        let line = std::mem::take(&mut self.line.bytes);
        let prose_end = self.prose().map(|prose| prose.end);
        let plain = prose_end.is_some();
        let may_define = prose_end.is_none_or(|end| end == self.start);
        let name = defined_name(&line).filter(|_| may_define);
        let names = listed_identifiers(&line).filter(|_| !plain);
        if let Some(name) = name {
            self.begin(Kind::Code);
            self.emit(Token::Defn(name.to_vec()), 2);
            self.emit(Token::Newline, line.len());
        } else if let Some(names) = names {
            // Emit the identifiers and end the code
            for name in names {
                self.emit(Token::Ident(name.to_vec()), 0);
            }
            self.emit(Token::EndIdents, line.len());
            self.listed = self.kind == Kind::Code;
        } else {
            // Begin prose if the line says so
            let marked = !plain && begins_docs(&line);
            if marked {
                self.at = line.len().min(2);
            }
            if marked || self.listed {
                self.begin(Kind::Docs);
                let from = self.start + self.at;
                if let Some(prose) = self.prose() {
                    prose.read(from, defines);
                }
            }
            self.line.bytes = line;
            self.scan(ended);
        }
    }

    fn begin(&mut self, kind: Kind) {
        self.close_quote();
        self.emit(Token::End(self.kind, self.count), 0);
        self.count += 1;
        self.kind = kind;
        self.listed = false;
        self.emit(Token::Begin(kind, self.count), 0);
    }

    fn finish(&mut self, ended: bool) {
        self.close_quote();
        if !ended {
            self.emit(Token::Newline, self.line.bytes.len());
        }
        self.emit(Token::End(self.kind, self.count), 0);
    }

    fn close_quote(&mut self) {
        let quote = self.quote.take().map(|place| (place, "quote `[['"));
        let block = self.prose().and_then(|prose| prose.open);
        let block =
            block.map(|line| (Place { line, ..self.place }, "block"));
        for (place, what) in quote.into_iter().chain(block) {
            let text = format!("open {what} never closed");
            let fault = Diagnostic::new(Level::Warning, None, text);
            self.faults.push((place, fault));
        }
    }

    /// The prose in Markdown that we are in.
    fn prose(&mut self) -> Option<&mut Markdown> {
        self.markdown.as_mut().filter(|_| self.kind == Kind::Docs)
    }

    fn scan(&mut self, ended: bool) {
        self.text_at = self.at;
        let plain = self.prose().is_some();
        if !plain && self.line.bytes[self.at..].starts_with(b"@@") {
            self.escape(2);
        }
        while self.at < self.line.bytes.len() {
            if plain {
                self.scan_markdown();
            } else if self.kind == Kind::Code || self.quote.is_some() {
                self.scan_code();
            } else {
                self.scan_docs();
            }
        }
        self.end_text(ended);
        if ended {
            self.emit(Token::Newline, self.at);
        }
    }

    /// Passes an escape of so many bytes, of which the first is dropped.
    fn escape(&mut self, length: usize) {
        self.flush();
        self.text_at = self.at + 1;
        self.at += length;
    }

    fn flush(&mut self) {
        if self.text_at < self.at {
            let text = self.line.bytes[self.text_at..self.at].to_vec();
            let glued = std::mem::replace(&mut self.glued, true);
            let token = if glued { Token::More } else { Token::Text };
            self.emit(token(text), self.text_at);
        }
        self.text_at = self.at;
    }

    fn end_text(&mut self, even_empty: bool) {
        self.flush();
        if even_empty && !self.glued {
            self.emit(Token::Text(Vec::new()), self.at);
        }
        self.glued = false;
    }

    fn pass(&mut self, token: Token, length: usize) {
        self.end_text(false);
        self.emit(token, self.at);
        self.at += length;
        self.text_at = self.at;
    }

    fn scan_docs(&mut self) {
        match &self.line.bytes[self.at..] {
            [b'@', a, b, ..] if a == b && b"[]<>".contains(a) => {
                self.escape(3);
            }
            [b'[', b'[', ..] => {
                self.quote = Some(self.place_at(self.at));
                self.pass(Token::Quote, 2);
            }
            [b'<', b'<', ..] => {
                self.complain_of_brackets();
                self.at += 2;
            }
            _ => self.at += 1,
        }
    }

    fn complain_of_brackets(&mut self) {
        // Help with the brackets in prose
        let line = &self.line.bytes;
        let start = line.iter().take_while(|b| is_space(b)).count();
        let indented =
            start == self.at && defined_name(&line[start..]).is_some();
        let help = if indented {
            "a definition begins in the first column"
        } else {
            "write @<< for the brackets themselves, or quote code in [[ ]]"
        };
        let text = "unescaped << in documentation chunk";
        let fault =
            Diagnostic::new(Level::Error, None, text).with_help(help);
        self.faults.push((self.place_at(self.at), fault));
    }

    fn scan_code(&mut self) {
        let quoting = self.quote.is_some();
        match &self.line.bytes[self.at..] {
            [b'@', a, b, ..] if a == b && b"<>".contains(a) => {
                self.escape(3);
            }
            rest @ [b']', b']', ..] if quoting => {
                self.at += count(rest, b']') - 2;
                self.pass(Token::EndQuote, 2);
                self.quote = None;
            }
            [b'<', b'<', rest @ ..] => {
                let end = use_end(rest, quoting);
                self.scan_use(end);
            }
            _ => self.at += 1,
        }
    }

    fn scan_use(&mut self, end: Result<usize, usize>) {
        self.end_text(false);
        match end {
            Ok(length) => {
                let name = &self.line.bytes[self.at + 2..][..length];
                self.pass(Token::Use(name.to_vec()), length + 4);
            }
            Err(length) => self.at += length + 2,
        }
    }

    fn scan_markdown(&mut self) {
        let (start, length) = (self.start, self.line.bytes.len());
        let end = start + length;
        match self.prose().and_then(|prose| prose.code_before(end)) {
            Some(code) => {
                self.at = code.start - start;
                self.pass(Token::Quote, 1);
                self.at = code.end - 1 - start;
                self.pass(Token::EndQuote, 1);
            }
            None => self.at = length,
        }
    }
}

/// The tokens in the documented form of noweb.
pub fn write_stream(lexemes: &[Lexeme]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut tokens = lexemes.iter().map(|(token, _)| token).peekable();
    while let Some(token) = tokens.next() {
        write_token(token, &mut out);
        if !matches!(tokens.peek(), Some(Token::More(_))) {
            out.push(b'\n');
        }
    }
    out
}

fn write_token(token: &Token, out: &mut Vec<u8>) {
    let numbered = |kind: &Kind, n| {
        let kind = if *kind == Kind::Docs { "docs" } else { "code" };
        format!("{kind} {n}").into_bytes()
    };
    let (keyword, value): (_, &[u8]) = match token {
        Token::Begin(kind, n) => ("@begin ", &numbered(kind, n)),
        Token::End(kind, n) => ("@end ", &numbered(kind, n)),
        Token::File(name) => ("@file ", name),
        Token::Text(text) => ("@text ", text),
        Token::More(text) => ("", text),
        Token::Defn(name) => ("@defn ", name),
        Token::Use(name) => ("@use ", name),
        Token::Ident(name) => ("@index defn ", name),
        Token::Newline => ("@nl", b""),
        Token::Quote => ("@quote", b""),
        Token::EndQuote => ("@endquote", b""),
        Token::EndIdents => ("@index nl", b""),
    };
    out.extend(keyword.bytes());
    out.extend(value);
}

/// The token of a line of the stream, if its keyword is one of ours.
pub fn parse_token(line: &[u8]) -> Option<Token> {
    let mark = Mark::read(line)?;
    let (value, inner) = (mark.text(), mark.inner());
    Some(match mark.keyword {
        b"file" => Token::File(value.to_vec()),
        b"text" => Token::Text(value.to_vec()),
        b"defn" => Token::Defn(value.to_vec()),
        b"use" => Token::Use(value.to_vec()),
        b"nl" => Token::Newline,
        b"quote" => Token::Quote,
        b"endquote" => Token::EndQuote,
        b"begin" => numbered(inner, Token::Begin)?,
        b"end" => numbered(inner, Token::End)?,
        // Recognise a line of the index
        b"index" => match inner.keyword {
            b"defn" => Token::Ident(inner.text().to_vec()),
            b"nl" => Token::EndIdents,
            _ => return None,
        },
        _ => return None,
    })
}

fn numbered(mark: Mark, token: fn(Kind, usize) -> Token) -> Option<Token> {
    let number = text_of(mark.text()).parse().unwrap_or(0);
    match mark.keyword {
        b"docs" => Some(token(Kind::Docs, number)),
        b"code" => Some(token(Kind::Code, number)),
        _ => None,
    }
}

/// The command `markup [-t[N]] [file...]`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let (tab, files, mut faults) = read_arguments(args);
    let (mut stream, more) = mark_files(&files, tab, streams);
    faults.extend(more);
    if !faults.is_empty() {
        stream.extend(b"@fatal markup an unspecified error occurred\n");
    }
    let result = streams.output.write_all(&stream);
    streams.conclude(result, &faults)
}

pub fn mark_files(
    files: &[OsString],
    tab: usize,
    streams: &mut Streams,
) -> (Vec<u8>, Faults) {
    let (mut stream, mut faults) = (Vec::new(), Vec::new());
    for file in files {
        // Mark up a file at the end of the stream
        match streams.read(file) {
            Ok(source) => {
                let (lexemes, more) = mark_up(&source, 0, tab);
                faults.extend(more);
                stream.extend(write_stream(&lexemes));
            }
            Err(more) => {
                faults.extend(more);
                let name = file.as_encoded_bytes();
                put(&mut stream, &[b"@fatal couldn't open file ", name]);
            }
        }
    }
    (stream, faults)
}

/// Tab stops, files (standard input if none) and complaints.
pub fn read_arguments(args: &[OsString]) -> (usize, Vec<OsString>, Faults) {
    let mut tab = 8;
    let mut faults = Vec::new();
    let is_option = |arg: &&OsString| {
        arg.as_encoded_bytes().starts_with(b"-") && *arg != "-"
    };
    let options = args.iter().take_while(is_option).count();
    // Read the options for tabs
    for arg in &args[..options] {
        match parse_tab(arg.as_encoded_bytes()) {
            Ok(stops) => tab = stops,
            Err(text) => faults.extend(error(text)),
        }
    }
    let files = args[options..].to_vec();
    let files = if files.is_empty() { vec!["-".into()] } else { files };
    (tab, files, faults)
}

/// The distance of the tab stops that `-t` or `-tN` asks for.
pub fn parse_tab(option: &[u8]) -> Result<usize, String> {
    let shown = text_of(option);
    let Some(number) = shown.strip_prefix("-t") else {
        return Err(format!("unknown option {shown}"));
    };
    let mut digits = number.split(|c: char| !c.is_ascii_digit());
    match digits.next().map(str::parse) {
        _ if number.is_empty() => Ok(0),
        Some(Ok(stops)) => Ok(stops),
        _ => Err(format!("ill-formed option {shown}")),
    }
}
