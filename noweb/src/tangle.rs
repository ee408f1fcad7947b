// Tangled from noweb/chapters/tangle.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Expansion of root chunks into program text, with its position map.
//!
//! A use is replaced by its chunk, every line of which is indented to the
//! column where the use began. Columns are bytes. The map tells for every
//! piece of the text where in the sources it stands.

use std::collections::HashSet;
use std::ffi::OsString;

use crate::Streams;
use crate::diagnostic::{
    Diagnostic, Faults, Level, Place, checked, status, text_of,
};
use crate::filter::{self, Failure, read_web};
use crate::markup::parse_tab;
use crate::web::{Piece, Web, quoted};

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

#[derive(Clone, Debug, Default)]
pub struct Layout {
    /// Distance of tab stops in the output, 0 for no tabs; if there is
    /// none, the tabs before a use are copied.
    pub tab: Option<usize>,
    /// The format of line directives, if there are to be any.
    pub directive: Option<Vec<u8>>,
    /// The text is Rust, where the names of chunks become comments.
    pub rust: bool,
}

fn column_after(text: &[u8], column: usize, tab: usize) -> usize {
    text.iter().fold(column, |column, byte| match byte {
        b'\t' if tab > 0 => (column / tab + 1) * tab,
        _ => column + 1,
    })
}

fn indentation(width: usize, tab: usize) -> Vec<u8> {
    let tabs = if tab > 1 { width / tab } else { 0 };
    let mut blank = vec![b'\t'; tabs];
    blank.resize(tabs + width - tabs * tab, b' ');
    blank
}

/// The text of some roots, one after the other.
pub fn tangle(
    web: &Web,
    roots: &[impl AsRef<[u8]>],
    layout: &Layout,
) -> Result<Tangled, Faults> {
    let mut expander = Expander {
        web,
        layout,
        // Begin at the first line with nothing on the stack
        tangled: Tangled::default(),
        line: 1,
        line_start: 0,
        stack: Vec::new(),
        active: vec![false; web.chunks.len()],
        said: None,
        blank: Vec::new(),
        reader: Reader::default(),
        faults: Vec::new(),
        reported: HashSet::new(),
    };
    for root in roots.iter().map(AsRef::as_ref) {
        let Some(chunk) = web.find(root) else {
            expander.report_missing_root(root);
            break;
        };
        expander.expand(chunk);
    }
    checked(expander.tangled, expander.faults)
}

struct StackFrame {
    chunk: usize,
    next: usize,
    /// What its lines are indented by.
    indent: usize,
    /// The width of what is on the line already.
    column: usize,
    /// The use that we came by.
    used: Option<Place>,
}

struct Expander<'a> {
    web: &'a Web,
    layout: &'a Layout,
    tangled: Tangled,
    line: u32,
    line_start: usize,
    stack: Vec<StackFrame>,
    active: Vec<bool>,
    /// The file and the line that the reader of the output believes in.
    said: Option<(u32, u32)>,
    /// White space as wide as what the line of the source has before.
    blank: Vec<u8>,
    reader: Reader,
    faults: Faults,
    reported: HashSet<Place>,
}

impl<'a> Expander<'a> {
    fn expand(&mut self, root: usize) {
        self.enter(root, 0, None);
        while let Some(frame) = self.stack.last_mut() {
            // Take the next piece of the chunk
            let web = self.web;
            let chunk = &web.chunks[frame.chunk];
            let index = frame.next;
            frame.next += 1;
            match chunk.pieces.get(index) {
                Some((Piece::Text(text), place)) => {
                    self.text(text, *place, index);
                }
                Some((Piece::Newline, place)) => self.newline(*place),
                Some((Piece::Use(name), place)) => {
                    let alone = self.is_alone(&chunk.pieces[index + 1..]);
                    self.use_chunk(name, *place, alone);
                }
                None => {
                    self.active[frame.chunk] = false;
                    self.blank.truncate(frame.indent);
                    self.stack.pop();
                }
            }
        }
        self.push(b"\n");
    }

    fn enter(&mut self, chunk: usize, column: usize, used: Option<Place>) {
        self.active[chunk] = true;
        self.blank.resize(column, b' ');
        let indent = column;
        let frame = StackFrame { chunk, next: 0, indent, column, used };
        self.stack.push(frame);
    }

    fn push(&mut self, text: &[u8]) {
        self.tangled.text.extend(text);
        let newlines = text.iter().filter(|b| **b == b'\n').count();
        if newlines > 0 {
            self.line += newlines as u32;
            let last = text.iter().rev().take_while(|b| **b != b'\n');
            self.line_start = self.tangled.text.len() - last.count();
        }
    }

    fn mark(&mut self, place: Place) {
        let column = self.tangled.text.len() - self.line_start + 1;
        let indent = self.stack.last().map_or(0, |f| f.indent) as u32;
        let (line, column) = (self.line, column as u32);
        let segment = Segment { line, column, place, indent };
        self.tangled.map.push(segment);
    }

    fn text(&mut self, text: &[u8], place: Place, index: usize) {
        if text.is_empty() {
            return;
        }
        if self.layout.directive.is_some() {
            self.direct(place, index == 0);
        } else {
            self.indent();
        }
        self.mark(place);
        self.push(text);
        let tab = self.layout.tab.unwrap_or(0);
        if let Some(frame) = self.stack.last_mut() {
            let blank = |b: &u8| if *b == b'\t' { b'\t' } else { b' ' };
            self.blank.resize(frame.column, b' ');
            self.blank.extend(text.iter().map(blank));
            frame.column = column_after(text, frame.column, tab);
        }
    }

    fn indent(&mut self) {
        let Some(frame) = self.stack.last_mut() else { return };
        if frame.column == 0 {
            frame.column = frame.indent;
            let blank = match self.layout.tab {
                Some(tab) => indentation(frame.indent, tab),
                None => self.blank[..frame.indent].to_vec(),
            };
            self.push(&blank);
        }
    }

    fn newline(&mut self, place: Place) {
        let last = self.tangled.map.last();
        if last.is_none_or(|s| s.line != self.line) {
            self.mark(place);
        }
        self.push(b"\n");
        if let Some((_, line)) = &mut self.said {
            *line += 1;
        }
        if let Some(frame) = self.stack.last_mut() {
            frame.column = 0;
        }
    }

    fn use_chunk(&mut self, name: &[u8], place: Place, alone: bool) {
        if self.layout.directive.is_none() {
            self.indent();
        }
        let Some(frame) = self.stack.last_mut() else { return };
        let column = frame.column;
        // Advance the column by the width of the use
        let tab = self.layout.tab.unwrap_or(0);
        frame.column = column_after(name, frame.column + 2, tab) + 2;
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
        let mut fault = self.web.undefined_use(name, place);
        if fault.help.is_empty() && !alone && looks_like_code(name) {
            fault.help.push("for the operator itself, write @<<".into());
        }
        self.faults.push(fault);
    }

    fn report_cycle(&mut self, chunk: usize, place: Place) {
        let web = self.web;
        let from = self.stack.iter().position(|f| f.chunk == chunk);
        let cycle = &self.stack[from.unwrap_or(0)..];
        let name = |f: &StackFrame| quoted(&web.chunks[f.chunk].name);
        let mut names: Vec<String> = cycle.iter().map(name).collect();
        names.push(quoted(&web.chunks[chunk].name));
        let text = format!("Cyclic code chunks: {}", names.join(" -> "));
        let position = web.position(place);
        let mut fault = Diagnostic::new(Level::Error, position, text);
        // List the uses that make the cycle
        let inner = cycle.iter().skip(1).map(|frame| frame.used);
        let uses = inner.chain([Some(place)]);
        for (pair, used) in names.windows(2).zip(uses) {
            if let Some(position) = used.and_then(|p| web.position(p)) {
                let [outer, inner] = pair else { continue };
                let help = format!("{outer} uses {inner} at {position}");
                fault = fault.with_help(help);
            }
        }
        self.faults.push(fault);
    }

    fn report_missing_root(&mut self, root: &[u8]) {
        let name = quoted(root);
        let text = format!("The root module {name} was not defined.");
        let mut fault = Diagnostic::new(Level::Fatal, None, text);
        if let Some(near) = self.web.nearest(root) {
            let name = quoted(&near.name);
            let at = self.web.position(near.definitions[0]);
            let at = at.map_or(String::new(), |at| format!(" at {at}"));
            fault = fault.with_help(format!("there is a chunk {name}{at}"));
        }
        self.faults.push(fault);
    }

    fn direct(&mut self, place: Place, heads_chunk: bool) {
        if self.said == Some((place.file, place.line)) {
            return;
        }
        self.said = Some((place.file, place.line));
        let column = self.stack.last().map_or(0, |frame| frame.column);
        if column > 0 {
            self.push(b"\n");
        }
        // Write the directive for this place
        let format = self.layout.directive.as_deref().unwrap_or(b"");
        let source = self.web.sources.get(place.file as usize);
        let name = source.map_or(&b""[..], |source| &source.name);
        let directive = format_directive(format, name, place.line);
        self.push(&directive.unwrap_or_default());
        if !heads_chunk {
            self.push(&indentation(column, self.layout.tab.unwrap_or(0)));
        }
    }

    fn is_alone(&self, after: &[(Piece, Place)]) -> bool {
        let ends = after.iter().find_map(|(piece, _)| match piece {
            Piece::Text(text) if text.trim_ascii().is_empty() => None,
            piece => Some(*piece == Piece::Newline),
        });
        let line = &self.tangled.text[self.line_start..];
        ends.unwrap_or(true) && line.trim_ascii().is_empty()
    }

    fn write_name(&mut self, name: &[u8], place: Place) {
        let text = &self.tangled.text;
        let blank = text[self.line_start..].to_vec();
        let named = self.layout.rust && std::str::from_utf8(name).is_ok();
        if named && !blank.is_empty() && self.reader.is_in_body(text) {
            self.mark(place);
            self.push(&[b"// ", &spoken_name(name)[..], b"\n"].concat());
            self.push(&blank);
        } else {
            let map = &mut self.tangled.map;
            map.truncate(map.partition_point(|s| s.line < self.line));
        }
    }
}

fn looks_like_code(name: &[u8]) -> bool {
    let odd = |b: &u8| b"<>:;=&|(){},".contains(b);
    name.trim_ascii().len() < name.len()
        || !name.contains(&b' ')
        || name.iter().any(odd)
}

/// A line directive, or what follows a percent sign and means nothing.
fn format_directive(
    format: &[u8],
    name: &[u8],
    line: u32,
) -> Result<Vec<u8>, String> {
    let (mut out, mut rest) = (Vec::new(), format);
    while let [first, after @ ..] = rest {
        rest = after;
        if *first != b'%' {
            out.push(*first);
            continue;
        }
        // Write one conversion of the format
        let shifted = |sign: i64, digit: &u8| {
            let shift = i64::from(digit - b'0');
            (i64::from(line) + sign * shift).to_string().into_bytes()
        };
        let (text, length) = match after {
            [b'%', ..] => (b"%".to_vec(), 1),
            [b'N', ..] => (b"\n".to_vec(), 1),
            [b'F', ..] => (name.to_vec(), 1),
            [b'L', ..] => (shifted(1, &b'0'), 1),
            [b'+', n @ b'0'..=b'9', b'L', ..] => (shifted(1, n), 3),
            [b'-', n @ b'0'..=b'9', b'L', ..] => (shifted(-1, n), 3),
            bad => return Err(text_of(bad.get(..1).unwrap_or_default())),
        };
        out.extend(text);
        rest = &after[length..];
    }
    Ok(out)
}

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
struct Reader {
    at: usize,
    place: Inside,
    /// The places of the brackets that are open.
    open: Vec<Inside>,
    /// The first byte of the token before.
    last: u8,
}

impl Reader {
    fn is_in_body(&mut self, text: &[u8]) -> bool {
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

fn spoken_name(name: &[u8]) -> Vec<u8> {
    let name = String::from_utf8_lossy(name).replace("[[", "`");
    name.replace("]]]", "]`").replace("]]", "`").into_bytes()
}

#[derive(Default)]
struct Request {
    roots: Vec<Vec<u8>>,
    layout: Layout,
    /// Shell commands that the stream goes through in turn.
    filters: Vec<OsString>,
    files: Vec<OsString>,
    faults: Faults,
}

impl Request {
    fn parse(args: &[OsString]) -> Self {
        let mut request = Self::default();
        let mut args = args.iter();
        while let Some(arg) = args.next() {
            match arg.as_encoded_bytes() {
                b"-filter" => request.filters.extend(args.next().cloned()),
                b"-t" => (),
                // Ignore what is meant for another tool
                b"-ml" | b"-m3" | b"-awk" | b"-icn" | b"-icon" => (),
                b"-pascal" | b"-c" | b"-c++" | b"-tex" | b"-f77" => (),
                b"-f90" => (),
                [b'-', b'w', b'0'..=b'9', b'0'..=b'9', ..] => (),
                option @ [b'-', _, ..] => request.option(option),
                _ => request.files.push(arg.clone()),
            }
        }
        request
    }

    fn option(&mut self, option: &[u8]) {
        match option {
            [b'-', b'R', root @ ..] => self.roots.push(root.to_vec()),
            [b'-', b'L', format @ ..] => {
                // Switch on what `-L` asks for
                let usual = b"#line %L \"%F\"%N";
                let format = if format.is_empty() { usual } else { format };
                if let Err(bad) = format_directive(format, b"", 0) {
                    let text =
                        format!("Bad format sequence ``%{bad}'' in -L");
                    self.complain(Level::Error, text + &text_of(format));
                }
                self.layout.directive = Some(format.to_vec());
                self.layout.tab = Some(0);
            }
            [b'-', b't', ..] => match parse_tab(option) {
                Ok(tab) => self.layout.tab = Some(tab),
                Err(text) => self.complain(Level::Error, text),
            },
            _ => {
                let option = text_of(option);
                let text = format!("Ignoring unknown option {option}");
                self.complain(Level::Warning, text);
            }
        }
    }

    fn complain(&mut self, level: Level, text: String) {
        self.faults.push(Diagnostic::new(level, None, text));
    }
}

/// The command `notangle [-Rroot...] [-L[format]] [-tN] [-filter command]
/// [file...]`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let mut request = Request::parse(args);
    if request.files.is_empty() {
        request.files.push("-".into());
    }
    let tab = if request.layout.tab.is_some() { 0 } else { 8 };
    let web = read_web(&request.files, &request.filters, tab, streams);
    write_roots(web, request, streams)
}

fn write_roots(
    web: Result<Web, Failure>,
    request: Request,
    streams: &mut Streams,
) -> u8 {
    let Request { mut roots, mut layout, mut faults, .. } = request;
    layout.tab.get_or_insert(0);
    // Give up unless there is a web
    let web = match web {
        Ok(web) => web,
        Err(failure) => {
            faults.extend(failure.faults);
            streams.conclude(Ok(()), &faults);
            return failure.status;
        }
    };
    if roots.is_empty() {
        roots.push(b"*".to_vec());
    }
    faults.extend(web.dotted());
    let tangled = tangle(&web, &roots, &layout);
    let tangled = tangled.unwrap_or_else(|more| {
        faults.extend(more);
        Tangled::default()
    });
    let failed = status(&faults) >= Level::Error as u8;
    let text = if failed { &b""[..] } else { &tangled.text };
    let result = streams.output.write_all(text);
    streams.conclude(result, &faults)
}

/// The command `nt`: the last stage alone, on a stream.
pub fn run_nt(args: &[OsString], streams: &mut Streams) -> u8 {
    let mut request = Request::default();
    for arg in args {
        request.option(arg.as_encoded_bytes());
    }
    let web = filter::read_stream(streams);
    write_roots(web, request, streams)
}
