// Tangled from noweb/chapters/stream.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The commands `notangle` and `nt`: some roots of a web, expanded.

use std::ffi::OsString;
use std::mem::replace;

use crate::diagnostic::{Diagnostic, Faults, Level, Place, text_of};
use crate::filter::{self, read_web};
use crate::markup::{Token, parse_tab};
use crate::project::warn;
use crate::tangle::tangle;
use crate::web::{Chunk, Web, quoted};
use crate::{Streams, status};

/// A line directive, or the meaningless sign behind a percent sign.
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

#[derive(Default)]
struct Request {
    roots: Vec<Vec<u8>>,
    /// The distance of tab stops, if tabs are kept.
    tab: Option<usize>,
    /// The format of line directives, if there are to be any.
    format: Option<Vec<u8>>,
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
                // Ignore an option for another tool
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
                self.format = Some(format.to_vec());
                self.tab = Some(0);
            }
            [b'-', b't', ..] => match parse_tab(option) {
                Ok(tab) => self.tab = Some(tab),
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
    let tab = if request.tab.is_some() { 0 } else { 8 };
    let told = streams.conclude(Ok(()), &request.faults);
    let web = read_web(&request.files, &request.filters, tab, streams);
    web.map_or_else(|e| e, |web| write_roots(&web, request, told, streams))
}

/// The command `nt`: the last stage alone, on a stream.
pub fn run_nt(args: &[OsString], streams: &mut Streams) -> u8 {
    let mut request = Request::default();
    for arg in args {
        request.option(arg.as_encoded_bytes());
    }
    let told = streams.conclude(Ok(()), &request.faults);
    let web = filter::read_stream(streams);
    web.map_or_else(|e| e, |web| write_roots(&web, request, told, streams))
}

/// Writes some roots; `told` is the status of earlier reports.
fn write_roots(
    web: &Web,
    request: Request,
    told: u8,
    streams: &mut Streams,
) -> u8 {
    let Request { mut roots, tab, format, .. } = request;
    if roots.is_empty() {
        roots.push(b"*".to_vec());
    }
    let mut faults = dotted(web);
    let (tab, format) = (tab.unwrap_or(0), format.as_deref());
    let mut layout =
        Layout { web, tab, format, said: None, out: Vec::new() };
    for root in &roots {
        // Expand one root
        let Some(chunk) = web.find(root) else {
            faults.push(missing_root(web, root));
            break;
        };
        match tangle(web, chunk, false) {
            Ok(_) => layout.write(chunk),
            Err(mut more) => {
                more.retain(|fault| !faults.contains(fault));
                faults.extend(more);
            }
        }
    }
    let failed = told.max(status(&faults)) >= Level::Error as u8;
    let text = if failed { &b""[..] } else { &layout.out };
    let result = streams.output.write_all(text);
    streams.conclude(result, &faults).max(told)
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

/// How a text is laid out that keeps its tabs or has line directives.
struct Layout<'a> {
    web: &'a Web,
    tab: usize,
    format: Option<&'a [u8]>,
    /// The file and the line that the reader of the output has counted to.
    said: Option<(u32, u32)>,
    out: Vec<u8>,
}

impl Layout<'_> {
    /// Writes a root that can be expanded.
    fn write(&mut self, root: usize) {
        let web = self.web;
        let pieces = |c: usize| web.chunks[c].pieces.iter().enumerate();
        let mut stack = vec![(pieces(root), 0, 0)];
        while let Some((rest, indent, column)) = stack.last_mut() {
            let Some((index, (token, text, place))) = rest.next() else {
                stack.pop();
                continue;
            };
            let blank = match token {
                Token::Newline => true,
                token => *token != Token::Use && text.is_empty(),
            };
            if self.format.is_none() && *column == 0 && !blank {
                *column = *indent;
                self.out.extend(indentation(*indent, self.tab));
            }
            // Write one piece
            match token {
                Token::Newline => {
                    self.out.push(b'\n');
                    *column = 0;
                    self.said = self.said.map(|(f, line)| (f, line + 1));
                }
                Token::Use => {
                    let here = *column;
                    *column = column_after(text, here + 2, self.tab) + 2;
                    let chunk = web.find(text).map(pieces);
                    stack.extend(chunk.map(|pieces| (pieces, here, here)));
                }
                _ if blank => {}
                _ => {
                    self.direct(*place, index == 0, *column);
                    self.out.extend(text);
                    *column = column_after(text, *column, self.tab);
                }
            }
        }
        self.out.push(b'\n');
    }

    /// Writes a directive if the reader's count is wrong.
    fn direct(&mut self, place: Place, heads_chunk: bool, column: usize) {
        let Some(format) = self.format else { return };
        let here = Some((place.file, place.line));
        if replace(&mut self.said, here) == here {
            return;
        }
        if column > 0 {
            self.out.push(b'\n');
        }
        let source = self.web.sources.get(place.file as usize);
        let name = source.map_or(&b""[..], |s| &s.name);
        let line = format_directive(format, name, place.line);
        self.out.extend(line.unwrap_or_default());
        let width = if heads_chunk { 0 } else { column };
        self.out.extend(indentation(width, self.tab));
    }
}

fn missing_root(web: &Web, root: &[u8]) -> Diagnostic {
    let name = quoted(root);
    let text = format!("The root module {name} was not defined.");
    let fault = Diagnostic::new(Level::Fatal, None, text);
    let Some(near) = web.nearest(root) else { return fault };
    let name = quoted(&near.name);
    let at = web.position(near.definitions[0]);
    let at = at.map_or(String::new(), |at| format!(" at {at}"));
    fault.with_help(format!("there is a chunk {name}{at}"))
}

/// Names that end in dots, which WEB would have completed.
fn dotted(web: &Web) -> Faults {
    let dotted = |c: &&Chunk| c.name.ends_with(b"...");
    let report = |c: &Chunk| {
        let name = quoted(&c.name);
        warn(web, c, format!("{name} isn't completed as in web"))
    };
    web.chunks.iter().filter(dotted).map(report).collect()
}
