// Tangled from noweb/chapters/markdown.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What CommonMark says of a text: where its prose ends, which code it
//! quotes, and what a summary lists.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::ops::Range;

use noweb_core::markup::{
    begins_docs, defined_name, listed_identifiers, without_mark,
};
use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

use crate::diagnostic::{Complaint, Diagnostic, Level, Place};

/// Whether a file of this name has prose in Markdown.
pub fn is_markdown(name: &[u8]) -> bool {
    name.ends_with(b".md")
}

/// The prose of a text; places are offsets.
#[derive(Default)]
pub struct Prose {
    /// The definitions that end it.
    pub ends: BTreeSet<usize>,
    /// The code that it quotes between two single signs, in order.
    pub quotes: Vec<Range<usize>>,
    /// The blocks that nothing ends.
    pub open: Vec<Complaint>,
}

/// Finds the prose of a text with chunks.
pub fn find_prose(text: &[u8]) -> Prose {
    let mark = text.len() - without_mark(text).len();
    let ascii = in_ascii(text) + "\n<<>>=\n";
    let (mut prose, mut next) = (Prose::default(), Some(mark));
    while let Some(start) = next {
        let (end, open) = end_of_prose(&ascii, start);
        prose.quotes.extend(quoted_code(&ascii[..end], start));
        prose.ends.insert(end);
        if let Some(line) = open {
            let text = "open block never closed";
            let fault = Diagnostic::new(Level::Warning, None, text);
            let place = Place { file: 0, line, column: 1 };
            prose.open.push((place, fault));
        }
        next = end_of_code(text, end);
    }
    prose
}

fn in_ascii(text: &[u8]) -> String {
    let ascii = |b: &u8| if b.is_ascii() { *b } else { b'x' };
    let small = |b: &u8| char::from(ascii(b).to_ascii_lowercase());
    let text: String = text.iter().map(small).collect();
    text.replace("<![cdata[", "<![CDATA[")
}

/// Where the prose from a place on ends, and the line of a block of it that
/// nothing ends.
fn end_of_prose(text: &str, from: usize) -> (usize, Option<u32>) {
    let (mut start, mut end, mut open) = (from, from, None);
    let mut inside = from;
    for line in text[from..].split_inclusive('\n') {
        if inside <= end && defines(line.as_bytes()) {
            open = open_block(&text[start..], end - start);
            let Some(block) = &open else { break };
            (inside, start) = (start + block.end, start + block.start);
        }
        end += line.len();
    }
    let line = |_| text[..start].matches('\n').count() as u32 + 1;
    (end, open.map(line))
}

/// Where the prose begins behind some code, if any does.
fn end_of_code(text: &[u8], from: usize) -> Option<usize> {
    let (mut at, mut listed) = (from, false);
    for line in text.get(from..)?.split_inclusive(|b| *b == b'\n') {
        let body = line.strip_suffix(b"\n").unwrap_or(line);
        let lists = listed_identifiers(body).is_some();
        match body {
            _ if lists || defines(body) => listed = lists,
            _ if begins_docs(body) => return Some(at + body.len().min(2)),
            _ if listed => return Some(at),
            _ => {}
        }
        at += line.len();
    }
    None
}

fn defines(line: &[u8]) -> bool {
    defined_name(line).is_some()
}

/// The parsed part of the block at a place, if it is verbatim.
fn open_block(text: &str, place: usize) -> Option<Range<usize>> {
    let text = &text[..text.len().min(2 * place)];
    let mut events = Parser::new(text).into_offset_iter();
    let block = events.find(|(event, range)| match event {
        _ if !range.contains(&place) => false,
        Event::Start(Tag::HtmlBlock) => is_raw(&text[range.start..]),
        event => matches!(event, Event::Start(Tag::CodeBlock(_))),
    });
    block.map(|(_, range)| range)
}

fn is_raw(html: &str) -> bool {
    let html = html.trim_start().to_ascii_lowercase();
    let tag = html.split(|c: char| c.is_whitespace() || c == '>').next();
    html.starts_with("<!")
        || html.starts_with("<?")
        || ["<pre", "<script", "<style", "<textarea"]
            .contains(&tag.unwrap_or_default())
}

fn quoted_code(text: &str, from: usize) -> Vec<Range<usize>> {
    let all = Parser::new_ext(&text[from..], Options::ENABLE_TABLES);
    let code = all.into_offset_iter().filter_map(|(event, range)| {
        let range = range.start + from..range.end + from;
        let code = &text[range.clone()];
        let simple = !code.starts_with("``") && !code.contains('\n');
        (simple && matches!(event, Event::Code(_))).then_some(range)
    });
    code.collect()
}

/// What a summary lists, as mdBook reads it.
pub fn links(summary: &str) -> Vec<OsString> {
    let (mut links, mut depth, mut is_done) = (Vec::new(), 0, false);
    for event in Parser::new(summary) {
        (depth, is_done) = match event {
            Event::Start(Tag::Item) => (depth + 1, false),
            Event::Start(Tag::Heading { .. }) => (depth + 1, true),
            Event::End(TagEnd::Item | TagEnd::Heading(_)) => {
                (depth - 1, true)
            }
            Event::Start(Tag::Link { dest_url, .. })
                if depth == 0 || !is_done =>
            {
                links.push(dest_url.replace("%20", " ").into());
                (depth, true)
            }
            _ => (depth, is_done),
        }
    }
    links
}
