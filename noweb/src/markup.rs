// Tangled from noweb/chapters/stream.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The stream: the tokens of a web as lines of text, and back.
//!
//! It is noweb's documented form: one token on a line, a keyword that
//! begins with `@` and its value. It loses nothing that tangling or weaving
//! needs, but the places of the tokens.

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::OsStrExt;

pub use noweb_core::markup::{Kind, Lexeme, Token};
use noweb_core::markup::{lines, mark_up as mark_up_plain, without_mark};

use crate::commonmark::{find_prose, is_markdown};
use crate::diagnostic::{
    Complaint, Diagnostic, Faults, Level, Place, Position, Source, text_of,
};
use crate::stream::{Mark, put};
use crate::web::Web;
use crate::{Streams, error};

/// The tokens of a source, and what is wrong with it; `tab` is the distance
/// of tab stops, or 0.
pub fn mark_up(source: &Source, file: u32, tab: usize) -> Marked {
    match is_markdown(&source.name) {
        true => mark_up_markdown(source, file),
        false if tab > 0 => mark_up_expanded(source, file, tab),
        false => mark_up_plain(source, file),
    }
}

type Marked = (Vec<Lexeme>, Vec<Complaint>);

/// Marks up a source whose tabs are expanded; the places stay.
fn mark_up_expanded(source: &Source, file: u32, tab: usize) -> Marked {
    let text = without_mark(&source.text);
    let mark = &source.text[..source.text.len() - text.len()];
    let lines = text.split(|b| *b == b'\n');
    let (lines, columns): (Vec<_>, Vec<_>) =
        lines.map(|line| expand_tabs(line, tab)).unzip();
    let text = [mark, &lines.join(&b'\n')].concat();
    let expanded = Source::new(source.name.clone(), text);
    let (mut lexemes, mut complaints) = mark_up_plain(&expanded, file);
    let places = lexemes.iter_mut().map(|(_, place)| place);
    let wrong = complaints.iter_mut().map(|(place, _)| place);
    for place in places.chain(wrong).filter(|place| place.line > 0) {
        let columns: &Vec<u32> = &columns[place.line as usize - 1];
        let column = columns.get(place.column as usize - 1);
        place.column = column.copied().unwrap_or(place.column);
    }
    (lexemes, complaints)
}

/// A line without tabs, and for each of its bytes the column in the source;
/// none if they are the same.
fn expand_tabs(line: &[u8], tab: usize) -> (Vec<u8>, Vec<u32>) {
    let (mut bytes, mut columns) = (Vec::new(), Vec::new());
    for (byte, column) in line.iter().zip(1..) {
        let stop = (bytes.len() / tab + 1) * tab;
        match byte {
            b'\t' => bytes.resize(stop, b' '),
            _ => bytes.push(*byte),
        }
        columns.resize(bytes.len(), column);
    }
    columns.push(line.len() as u32 + 1);
    (bytes, columns)
}

fn mark_up_markdown(source: &Source, file: u32) -> Marked {
    let prose = find_prose(&source.text);
    let mut source = source.clone();
    source.definitions = Some(prose.ends);
    let (lexemes, _) = mark_up_plain(&source, file);
    let mut quotes = prose.quotes.into_iter().peekable();
    let mark = source.text.len() - without_mark(&source.text).len();
    let mut out = Vec::new();
    for (token, place) in lexemes {
        let mark = if place.line == 1 { mark } else { 0 };
        let start = source.start(place.line).unwrap_or(0) + mark;
        let mut at = start + place.column as usize - 1;
        let end = match &token {
            Token::Text(text) => at + text.len(),
            _ => at,
        };
        let place_of =
            |at| Place { column: (at - start) as u32 + 1, ..place };
        let text = |from, to| Token::Text(source.text[from..to].to_vec());
        while let Some(code) = quotes.next_if(|code| code.start < end) {
            // Emit the text before, and the code
            if at < code.start {
                out.push((text(at, code.start), place_of(at)));
            }
            let (from, to) = (code.start + 1, code.end - 1);
            out.push((Token::Quote, place_of(code.start)));
            out.push((text(from, to), place_of(from)));
            out.push((Token::EndQuote, place_of(to)));
            at = code.end;
        }
        match token {
            Token::Text(_) if at == source.text.len() => {}
            Token::Text(_) => out.push((text(at, end), place_of(at))),
            token => out.push((token, place)),
        }
    }
    (out, prose.open)
}

/// The tokens in the documented form of noweb.
pub fn write_stream(lexemes: &[Lexeme]) -> Vec<u8> {
    let (mut out, mut number) = (Vec::new(), 0);
    let mut tokens = lexemes.iter().map(|(token, _)| token).peekable();
    while let Some(token) = tokens.next() {
        write_token(token, number, &mut out);
        number += usize::from(matches!(token, Token::End(_)));
        if !matches!(tokens.peek(), Some(Token::More(_))) {
            out.push(b'\n');
        }
    }
    out
}

fn write_token(token: &Token, number: usize, out: &mut Vec<u8>) {
    let numbered = |kind: &Kind| {
        let kind = if *kind == Kind::Docs { "docs" } else { "code" };
        format!("{kind} {number}").into_bytes()
    };
    let (keyword, value): (_, &[u8]) = match token {
        Token::Begin(kind) => ("@begin ", &numbered(kind)),
        Token::End(kind) => ("@end ", &numbered(kind)),
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
        b"begin" => Token::Begin(kind(inner)?),
        b"end" => Token::End(kind(inner)?),
        // Recognise a line of the index
        b"index" => match inner.keyword {
            b"defn" => Token::Ident(inner.text().to_vec()),
            b"nl" => Token::EndIdents,
            _ => return None,
        },
        _ => return None,
    })
}

fn kind(mark: Mark) -> Option<Kind> {
    match mark.keyword {
        b"docs" => Some(Kind::Docs),
        b"code" => Some(Kind::Code),
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
                faults.extend(source.locate(more));
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

/// Reads a stream that filters may have changed.
pub fn read_stream(stream: &[u8]) -> (Web, Faults) {
    let mut reader = StreamReader::default();
    let read = lines(stream).try_for_each(|l| reader.read_line(l));
    let whole = (reader.stage == Expected::Outside).then_some(());
    let end = whole.ok_or("the stream ends inside a code chunk");
    if let Err(text) = read.and(end) {
        reader.complain(Level::Impossible, text.into());
    }
    let StreamReader { sources, lexemes, faults, .. } = reader;
    let mut web = Web::from_lexemes(lexemes);
    web.sources = sources;
    (web, faults)
}

/// The position in its file that some lines of a stream lead to.
pub fn position_after(stream: &[&[u8]]) -> Option<Position> {
    let mut reader = StreamReader::default();
    let read = stream.iter().try_for_each(|line| reader.read_line(line));
    read.ok().and_then(|()| reader.position())
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
            (Outside, Some(Token::Begin(Kind::Code))) => Nameless,
            (Nameless, Some(Token::Defn(_))) => Named,
            (Nameless, Some(Token::Text(_))) => {
                return Err("code chunk had no definition line");
            }
            (Named, Some(Token::Newline)) => Inside,
            (Named, _) => {
                return Err("definition line not followed by newline");
            }
            (Inside, Some(Token::End(Kind::Code))) => Outside,
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
        self.faults.push(Diagnostic::new(level, self.position(), text));
    }

    fn position(&self) -> Option<Position> {
        let source = self.sources.get(self.place.file as usize);
        source.map(|s| s.position(self.place))
    }
}
