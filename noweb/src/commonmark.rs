// Tangled from noweb/chapters/markdown.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What CommonMark says of a text: where its prose ends, which code it
//! quotes, and what a summary lists.

use std::ffi::OsString;
use std::ops::Range;

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

/// A text in Markdown and the prose that was read last; all places are
/// offsets.
pub struct Markdown {
    text: String,
    /// Where the prose ends: at a definition, or behind the text.
    pub end: usize,
    /// The code that it quotes with single backticks, from the last.
    code: Vec<Range<usize>>,
    /// The line of a block of this prose that nothing ends.
    pub open: Option<u32>,
}

impl Markdown {
    /// Reads the first prose; `defines` knows a definition.
    pub fn new(text: &[u8], defines: fn(&[u8]) -> bool) -> Self {
        let text = in_ascii(text) + "\n<<>>=\n";
        let mut read = Self { text, end: 0, code: Vec::new(), open: None };
        read.read(0, defines);
        read
    }

    /// Reads the prose that begins at a place.
    pub fn read(&mut self, from: usize, defines: fn(&[u8]) -> bool) {
        let (mut start, mut end, mut open) = (from, from, None);
        let mut inside = from;
        for line in self.text[from..].split_inclusive('\n') {
            if inside <= end && defines(line.as_bytes()) {
                open = open_block(&self.text[start..], end - start);
                let Some(block) = &open else { break };
                (inside, start) = (start + block.end, start + block.start);
            }
            end += line.len();
        }
        let line = |_| self.text[..start].matches('\n').count() as u32 + 1;
        self.open = open.map(line);
        self.code = quoted_code(&self.text[..end], from);
        self.end = end;
    }

    /// The next code that begins before a place.
    pub fn code_before(&mut self, end: usize) -> Option<Range<usize>> {
        self.code.pop_if(|code| code.start < end)
    }
}

fn in_ascii(text: &[u8]) -> String {
    let ascii = |b: &u8| if b.is_ascii() { *b } else { b'x' };
    let small = |b: &u8| char::from(ascii(b).to_ascii_lowercase());
    let text: String = text.iter().map(small).collect();
    text.replace("<![cdata[", "<![CDATA[")
}

/// What is known of the block at a place, if it is shown as it is.
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
    let code: Vec<_> = code.collect();
    code.into_iter().rev().collect()
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
