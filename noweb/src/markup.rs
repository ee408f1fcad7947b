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

pub use noweb_core::markup::{Lexeme, Token};
use noweb_core::markup::{lines, mark_up as mark_up_plain, without_mark};

use crate::commonmark::{find_prose, is_markdown};
use crate::diagnostic::{
    Complaint, Diagnostic, Faults, Level, Place, Position, Source, text_of,
};
use crate::stream::{Mark, put};
use crate::web::Web;
use crate::{Streams, error};

/// The tokens of a source, and its faults; `tab` is the distance of tab
/// stops, or 0.
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
    let places = lexemes.iter_mut().map(|(_, _, place)| place);
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
    for (token, text, place) in lexemes {
        let mark = if place.line == 1 { mark } else { 0 };
        let start = source.start(place.line).unwrap_or(0) + mark;
        let mut at = start + place.column as usize - 1;
        let is_text = token == Token::Text;
        let end = if is_text { at + text.len() } else { at };
        let mut cut = |token, from, to| {
            let place =
                Place { column: (from - start) as u32 + 1, ..place };
            out.push((token, source.text[from..to].to_vec(), place));
        };
        while let Some(code) = quotes.next_if(|code| code.start < end) {
            // Emit the text before, and the code
            if at < code.start {
                cut(Token::Text, at, code.start);
            }
            let (from, to) = (code.start + 1, code.end - 1);
            cut(Token::Quote, code.start, code.start);
            cut(Token::Text, from, to);
            cut(Token::EndQuote, to, to);
            at = code.end;
        }
        match is_text {
            true if at == source.text.len() => {}
            true => cut(token, at, end),
            false => out.push((token, text, place)),
        }
    }
    (out, prose.open)
}

/// The beginning of a token's line.
const WORDS: [(Token, &[u8]); 13] = [
    (Token::File, b"@file "),
    (Token::BeginDocs, b"@begin docs "),
    (Token::BeginCode, b"@begin code "),
    (Token::EndDocs, b"@end docs "),
    (Token::EndCode, b"@end code "),
    (Token::Text, b"@text "),
    (Token::Newline, b"@nl"),
    (Token::Defn, b"@defn "),
    (Token::Use, b"@use "),
    (Token::Quote, b"@quote"),
    (Token::EndQuote, b"@endquote"),
    (Token::Ident, b"@index defn "),
    (Token::EndIdents, b"@index nl"),
];

/// The tokens in the documented form of noweb.
pub fn write_stream(lexemes: &[Lexeme]) -> Vec<u8> {
    let mut out = Vec::new();
    for (token, text, _) in lexemes {
        match WORDS.iter().find(|(known, _)| known == token) {
            Some((_, word)) => out.extend(*word),
            None => drop(out.pop()),
        }
        out.extend(text);
        out.push(b'\n');
    }
    out
}

/// The token of a line of the stream, if its keyword is one of ours.
pub fn parse_token(line: &[u8]) -> Option<(Token, &[u8])> {
    WORDS.iter().find_map(|(token, word)| {
        let rest = line.strip_prefix(word.trim_ascii_end())?;
        let ends = rest.first().is_none_or(|b| *b == b' ');
        ends.then(|| (*token, rest.get(1..).unwrap_or_default()))
    })
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
    let (mut tab, mut faults) = (8, Vec::new());
    let is_option = |arg: &&OsString| {
        arg.as_encoded_bytes().starts_with(b"-") && *arg != "-"
    };
    let options = args.iter().take_while(is_option).count();
    let (options, files) = args.split_at(options);
    // Read the options for tabs
    for arg in options {
        match parse_tab(arg.as_encoded_bytes()) {
            Ok(stops) => tab = stops,
            Err(text) => faults.extend(error(text)),
        }
    }
    let files = if files.is_empty() { &["-".into()] } else { files };
    (tab, files.to_vec(), faults)
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
            (Outside, Some((Token::BeginCode, _))) => Nameless,
            (Nameless, Some((Token::Defn, _))) => Named,
            (Nameless, Some((Token::Text, _))) => {
                return Err("code chunk had no definition line");
            }
            (Named, Some((Token::Newline, _))) => Inside,
            (Named, _) => {
                return Err("definition line not followed by newline");
            }
            (Inside, Some((Token::EndCode, _))) => Outside,
            (stage, _) => stage,
        };
        match token {
            Some((token, text)) => self.take(token, text),
            None => self.take_other(line),
        }
        Ok(())
    }

    fn take(&mut self, token: Token, text: &[u8]) {
        self.lexemes.push((token, text.to_vec(), self.place));
        let Place { line, column, file } = &mut self.place;
        match token {
            Token::Text => *column += text.len() as u32,
            Token::Use => *column += text.len() as u32 + 4,
            Token::Quote | Token::EndQuote => *column += 2,
            // Move on to the next line or file
            Token::Newline | Token::EndIdents => {
                (*line, *column) = (*line + 1, 1);
            }
            Token::File => {
                (*file, *line, *column) = (self.sources.len() as u32, 1, 1);
                let source = std::fs::read(OsStr::from_bytes(text));
                let source = source.unwrap_or_default();
                self.sources.push(Source::new(text.to_vec(), source));
            }
            _ => (),
        }
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
