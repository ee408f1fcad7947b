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
        let text = in_utf8(text) + "\n<<>>=\n";
        let mut read = Self { text, end: 0, code: Vec::new(), open: None };
        read.read(0, defines);
        read
    }

    /// Reads the prose that begins at a place.
    pub fn read(&mut self, from: usize, defines: fn(&[u8]) -> bool) {
        let (mut start, mut end, mut open) = (from, from, None);
        for line in self.text[from..].split_inclusive('\n') {
            if defines(line.as_bytes()) {
                open = open_block(&self.text[start..=end]);
                let Some(block) = open else { break };
                start += block;
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

fn in_utf8(text: &[u8]) -> String {
    let ascii = |b: &u8| if b.is_ascii() { char::from(*b) } else { 'x' };
    let text = String::from_utf8(text.to_vec());
    text.unwrap_or_else(|e| e.as_bytes().iter().map(ascii).collect())
}

/// Where the block begins in which a text breaks off, if it is shown as it
/// is.
fn open_block(text: &str) -> Option<usize> {
    let mut events = Parser::new(text).into_offset_iter();
    let block = events.find(|(event, range)| match event {
        _ if range.end < text.len() => false,
        Event::Start(Tag::HtmlBlock) => is_raw(&text[range.start..]),
        event => matches!(event, Event::Start(Tag::CodeBlock(_))),
    });
    block.map(|(_, range)| range.start)
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
pub fn links(summary: &[u8]) -> Vec<OsString> {
    let (mut links, mut depth, mut is_done) = (Vec::new(), 0, false);
    for event in Parser::new(&in_utf8(summary)) {
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
