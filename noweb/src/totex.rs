// Tangled from noweb/chapters/totex.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The back end `totex`: writes a resolved stream as LaTeX.
//!
//! Invariant: a line of output ends where a line of the source ends, so
//! that line numbers in LaTeX's messages are those of the chapter. Only
//! the list of chunks and the index add lines.

use std::collections::{HashMap, HashSet};
use std::ffi::OsString;

use noweb_core::markup::quoted_length;

use crate::Streams;
use crate::stream::{self, Mark, Outcome};

#[derive(Clone, Default)]
pub struct Options {
    /// Hold macros back until the first chunk of prose has ended.
    pub delay: bool,
    /// Write the identifiers' cross-references.
    pub index: bool,
    /// The end of the first line; may be empty.
    pub comment: Vec<u8>,
    /// Leave TeX in names to TeX.
    pub tex_names: bool,
}

#[derive(Default)]
struct Converter<'a> {
    options: Options,
    memory: Memory<'a>,
    out: Vec<u8>,
    messages: Vec<u8>,
    warned: HashSet<Vec<u8>>,
    broken: bool,
    code: bool,
    quoting: bool,
    blank: bool,
    /// Whether macros are still held back, under -delay.
    delaying: bool,
    file: &'a [u8],
    label: Option<&'a [u8]>,
    reference: Option<&'a [u8]>,
    /// Where the identifier that comes next is defined.
    link: Option<&'a [u8]>,
    /// Whether the next text is a keyword or a comment.
    style: Option<&'a [u8]>,
    chunk: &'a [u8],
    /// The label of the definition, for index entries of its uses.
    place: Option<&'a [u8]>,
    naming: bool,
    previous: Option<&'a [u8]>,
    next: Option<&'a [u8]>,
    continued: Vec<&'a [u8]>,
    users: Vec<&'a [u8]>,
    unused: Option<&'a [u8]>,
    identifiers: Vec<&'a [u8]>,
}

#[derive(Default)]
pub struct Memory<'a> {
    defined: HashSet<&'a [u8]>,
    users: HashMap<&'a [u8], Vec<&'a [u8]>>,
    shown: HashMap<&'a [u8], &'a [u8]>,
}

impl<'a> Converter<'a> {
    fn convert(&mut self, line: &'a [u8]) {
        let Some(mark) = Mark::read(line) else {
            let what = b"Botched line in noweb pipeline: ";
            return self.report(&[what, line]);
        };
        let (family, inner) = (mark.keyword, mark.inner());
        match (family, mark.argument, inner.keyword, inner.argument) {
            (b"text", Some(text), ..) => self.text(text),
            (b"nl", None, ..) => self.end_line(),
            (b"xref", Some(_), ..) => self.reference(inner),
            (b"index", Some(_), ..) => self.index(inner),
            (b"style", style @ Some(_), ..) => self.style = style,
            (b"defn", Some(name), ..) => self.define(name),
            (b"use", Some(name), ..) => self.use_chunk(name),
            // Convert the bounds of a chunk
            // Begin a chunk of code
            (b"begin", _, b"code", Some(number)) => {
                self.code = true;
                self.put(&[b"\\nwbegincode{", number, b"}"]);
                self.continued.clear();
                self.users.clear();
                self.unused = None;
            }
            (b"begin", _, b"docs", Some(n)) if self.holds_back(n) => {}
            (b"begin", _, b"docs", Some(number)) => {
                self.blank = true;
                self.put(&[b"\\nwbegindocs{", number, b"}"]);
            }
            // End a chunk of code
            (b"end", _, b"code", Some(_)) => {
                self.write_footer();
                self.code = false;
                self.put(&[b"\\nwendcode{}"]);
                (self.place, self.previous, self.next) = (None, None, None);
            }
            (b"end", _, b"docs", Some(n)) if self.holds_back(n) => {
                self.delaying = false;
                self.write_file_name();
            }
            (b"end", _, b"docs", Some(_)) => self.put(&[b"\\nwenddocs{}"]),
            // Convert the rarer kinds of mark
            (b"quote", None, ..) => {
                self.quoting = true;
                self.put(&[b"{\\Tt{}"]);
            }
            (b"endquote", None, ..) => {
                self.quoting = false;
                self.put(&[b"\\nwendquote}"]);
            }
            (b"file", Some(name), ..) => self.begin_file(name),
            (b"line", Some(_), ..) => {}
            (b"literal", Some(text), ..) => self.put(&[text]),
            // Convert the ends of a document
            (b"fatal", Some(_), ..) => self.broken = true,
            // Begin and end the document
            (b"header", _, b"latex", Some(options)) => self.put(&[
                b"\\documentclass{article}\\usepackage{noweb}",
                b"\\pagestyle{noweb}\\noweboptions{",
                options,
                b"}\\begin{document}",
            ]),
            (b"trailer", _, b"latex", _) => {
                self.put(&[b"\\end{document}"]);
                self.break_line();
            }
            (b"begin" | b"end" | b"header" | b"trailer", Some(_), ..) => {
                self.warn(&[family, b" "].concat(), inner);
            }
            _ => self.warn(b"", mark),
        }
    }

    fn text(&mut self, text: &[u8]) {
        self.blank &= text.is_empty();
        let link = self.link.take().filter(|_| self.options.index);
        let style = self.style.take();
        let (kind, shown) = match (self.quoting, self.code) {
            (true, _) => (b"q", replace(text, QUOTED)),
            (false, true) => (b"c", replace(text, CODE)),
            (false, false) => return self.put(&[text]),
        };
        // Write the text, perhaps as a link
        match (link, style) {
            (Some(label), _) => {
                let open = [b"\\nwlinkedident", &kind[..], b"{"].concat();
                self.put(&[&open, &shown, b"}{", label, b"}"]);
            }
            // Set a keyword or a comment apart
            (_, Some(style @ (b"keyword" | b"comment"))) => {
                self.put(&[b"\\nw", style, b"{", &shown, b"}"]);
            }
            _ => self.put(&[&shown]),
        }
    }

    fn put(&mut self, parts: &[&[u8]]) {
        parts.iter().for_each(|part| self.out.extend(*part));
    }

    fn end_line(&mut self) {
        if !self.code && std::mem::take(&mut self.blank) {
            self.put(&[b"\\nwdocspar"]);
        }
        if self.quoting {
            self.put(&[b"\\nwnewline"]);
        }
        // Finish the line of the name
        let (previous, next) = (self.previous.take(), self.next.take());
        let naming = std::mem::take(&mut self.naming);
        let neighbours = previous.is_some() || next.is_some();
        if naming || neighbours {
            self.put(&[b"\\nwstartdeflinemarkup"]);
            // Show users and neighbours
            if naming {
                self.list(b"\\nwusesondefline", &self.users.clone());
            }
            if neighbours {
                let left = previous.unwrap_or(b"\\relax");
                let right = next.unwrap_or(b"\\relax");
                self.put(&[b"\\nwprevnextdefs{", left, b"}{", right, b"}"]);
            }
            self.put(&[b"\\nwenddeflinemarkup"]);
        }
        self.break_line();
    }

    fn break_line(&mut self) {
        let comment = std::mem::take(&mut self.options.comment);
        self.put(&[&comment, b"\n"]);
    }

    fn holds_back(&self, number: &[u8]) -> bool {
        self.delaying && number.starts_with(b"0")
    }

    fn begin_file(&mut self, name: &'a [u8]) {
        self.file = name;
        (self.label, self.reference) = (None, None);
        if !self.delaying {
            self.write_file_name();
        }
    }

    fn write_file_name(&mut self) {
        let name = self.shown(self.file);
        self.put(&[b"\\nwfilename{", &name, b"}"]);
    }

    fn write_footer(&mut self) {
        let continued = std::mem::take(&mut self.continued);
        self.list(b"\\nwalsodefined", &continued);
        let users = std::mem::take(&mut self.users);
        self.list(b"\\nwused", &users);
        if let Some(name) = self.unused.take() {
            let name = self.shown(name);
            self.put(&[b"\\nwnotused{", &name, b"}"]);
        }
    }

    fn list(&mut self, macro_name: &[u8], labels: &[&[u8]]) {
        if labels.is_empty() {
            return;
        }
        self.put(&[macro_name, b"{"]);
        for label in labels {
            self.put(&[b"\\\\{", label, b"}"]);
        }
        self.put(&[b"}"]);
    }

    /// A name that noweb would show without any conversion.
    fn shown(&self, name: &[u8]) -> Vec<u8> {
        match self.options.tex_names {
            true => name.to_vec(),
            false => name_text(name, NAME),
        }
    }

    fn typeset(&self, name: &[u8]) -> Vec<u8> {
        name_text(name, if self.options.tex_names { "" } else { NAME })
    }

    /// The name of a chunk, and the tag of the place it refers to.
    fn name_and_tag(&mut self, name: &[u8]) -> Vec<u8> {
        let mut out = self.typeset(name);
        if let Some(label) = self.reference.take() {
            out.push(b'~');
            out.extend(tag(label));
        }
        out
    }

    fn define(&mut self, name: &'a [u8]) {
        self.place = self.label.take();
        if let Some(label) = self.place {
            self.put(&[b"\\sublabel{", label, b"}"]);
            self.put(&[b"\\nwmargintag{", &tag(label), b"}"]);
        }
        let end: &[u8] = match self.memory.defined.insert(name) {
            true => b"}\\endmoddef",
            false => b"}\\plusendmoddef",
        };
        let shown = self.name_and_tag(name);
        self.put(&[b"\\moddef{", &shown, end]);
        // Prepare the footer of the definition
        if let Some(users) = self.memory.users.get(name) {
            self.users = users.clone();
        }
        self.chunk = name;
        self.naming = true;
    }

    fn use_chunk(&mut self, name: &[u8]) {
        self.label = None;
        let shown = self.name_and_tag(name);
        self.put(&[b"\\LA{}", &shown, b"\\RA{}"]);
    }

    fn reference(&mut self, mark: Mark<'a>) {
        match (mark.keyword, mark.argument) {
            // Store a label for later
            (b"label", label @ Some(_)) => self.label = label,
            (b"ref", label @ Some(_)) => self.reference = label,
            (b"prevdef", label @ Some(_)) => self.previous = label,
            (b"nextdef", label @ Some(_)) => self.next = label,
            (b"notused", name @ Some(_)) => self.unused = name,
            (b"defitem", Some(label)) => self.continued.push(label),
            (b"useitem", Some(label)) => self.users.push(label),
            (b"beginuses", None) => self.users.clear(),
            (b"enduses", None) => {
                self.memory.users.insert(self.chunk, self.users.clone());
            }
            (b"begindefs" | b"enddefs", None) => {}
            // Write an entry of the list of chunks
            (b"chunkbegin", Some(_)) => {
                let entry = mark.inner();
                let name = self.typeset(entry.text());
                self.put(&[b"\\nwixlogsorted{c}{{", &name, b"}{"]);
                self.put(&[entry.keyword, b"}{"]);
            }
            (b"chunkuse", Some(at)) => self.put(&[b"\\nwixu{", at, b"}"]),
            (b"chunkdefn", Some(at)) => self.put(&[b"\\nwixd{", at, b"}"]),
            (b"chunkend", None) => {
                self.put(&[b"}}%"]);
                self.break_line();
            }
            (b"beginchunks" | b"endchunks", None) => {}
            _ => self.warn(b"xref ", mark),
        }
    }

    fn index(&mut self, mark: Mark<'a>) {
        match (mark.keyword, mark.argument) {
            (b"nl", None) => {
                self.put(&[if self.code { b"\\eatline" } else { b"%" }]);
                self.break_line();
            }
            _ if !self.options.index => {}
            (b"defn" | b"localdefn", Some(name)) => self.define_word(name),
            (b"use", Some(name)) => self.use_word(name),
            // Convert a mark of the index of Rust
            (b"name", Some(_)) => {
                let name = mark.inner();
                self.memory.shown.insert(name.keyword, name.text());
            }
            (b"anchor", Some(_)) => {}
            (b"link", Some(_)) => self.link = self.reference.take(),
            (b"beginmini", None) => self.put(&[b"\\nwminiindex{"]),
            (b"miniitem", Some(_)) => {
                let item = mark.inner();
                let name = printed(self.shown_of(item.text()));
                self.put(&[b"\\nwmini{", &name, b"}{", item.keyword, b"}"]);
            }
            (b"endmini", None) => self.put(&[b"}"]),
            // Write an entry of the index
            (b"entrybegin", Some(_)) => {
                let name = self.identifier(mark.inner().text());
                self.put(&[b"\\nwixlogsorted{i}{", &name, b"}%"]);
                self.break_line();
            }
            // Write the identifiers of a chunk
            (b"begindefs", None) => {
                self.write_footer();
                self.put(&[b"\\nwidentdefs{"]);
            }
            (b"enddefs", None) => self.put(&[b"}"]),
            (b"defitem", Some(name)) => self.list_word(name),
            (b"beginuses", None) => {
                self.write_footer();
                self.put(&[b"\\nwidentuses{"]);
                self.identifiers.clear();
            }
            // Finish the list of uses
            (b"useitem", Some(name)) => {
                self.list_word(name);
                self.identifiers.push(name);
            }
            (b"enduses", None) => self.end_words(),
            // Skip the places that LaTeX collects itself
            (b"isused" | b"isdefined", Some(_)) => {}
            (b"entryuse" | b"entrydefn", Some(_)) => {}
            (b"beginindex" | b"entryend" | b"endindex", None) => {}
            _ => self.warn(b"index ", mark),
        }
    }

    fn define_word(&mut self, name: &[u8]) {
        if let Some(label) = self.label.take() {
            self.put(&[b"\\nosublabel{", label, b"}"]);
        }
        if let Some(place) = self.reference.take() {
            let name = self.identifier(name);
            self.put(&[b"\\nwindexdefn", &name, b"{", place, b"}"]);
        }
    }

    fn use_word(&mut self, name: &[u8]) {
        self.link = self.reference.take();
        let label = self.label.take();
        if self.code || self.quoting {
            return;
        }
        if let Some(label) = label {
            self.put(&[b"\\protect\\nosublabel{", label, b"}"]);
        }
        if let Some(place) = self.link {
            let name = self.identifier(name);
            self.put(&[b"\\protect\\nwindexuse", &name, b"{", place, b"}"]);
        }
    }

    fn list_word(&mut self, name: &[u8]) {
        let name = self.identifier(name);
        self.put(&[b"\\\\{", &name, b"}"]);
    }

    fn end_words(&mut self) {
        self.put(&[b"}"]);
        let Some(place) = self.place else { return };
        for name in std::mem::take(&mut self.identifiers) {
            let name = self.identifier(name);
            self.put(&[b"\\nwindexuse", &name, b"{", place, b"}"]);
        }
    }

    /// The text shown for a key; a key without a declaration shows itself.
    fn shown_of(&self, key: &'a [u8]) -> &'a [u8] {
        self.memory.shown.get(key).copied().unwrap_or(key)
    }

    fn identifier(&self, name: &'a [u8]) -> Vec<u8> {
        let shown = printed(self.shown_of(name));
        let key = replace(name, KEY);
        [b"{", &shown[..], b"}{", &key[..], b"}"].concat()
    }

    fn warn(&mut self, family: &[u8], mark: Mark) {
        let tag = [family, mark.keyword].concat();
        if self.warned.insert(tag.clone()) {
            let what = b"Warning: unrecognized escape @";
            self.report(&[what, &tag, b" ", mark.text()]);
        }
    }

    fn report(&mut self, parts: &[&[u8]]) {
        self.messages.extend(parts.concat());
        self.messages.push(b'\n');
    }
}

/// Text of a line of code, where only `{`, `}` and `\` are special.
const CODE: &str = r"\\\|{\{|}\}";

/// Text of quoted code or of an identifier, in typewriter type.
const QUOTED: &str = concat!(
    r"\{\nwbackslash}|{{\nwlbrace}|}{\nwrbrace}|^{\char94}|~{\char126}",
    r"| \ |${\$}|&{\&}|#{\#}|_{\_}|%{\%}",
);

/// Text in the name of a chunk, printed as it is written.
const NAME: &str = concat!(
    r"_\_|&\&|#\#|%\%|$\$|{\textbraceleft{}|}\textbraceright{}",
    r"|~\textasciitilde{}|^\textasciicircum{}|\\textbackslash{}",
);

/// Replaces the first byte of an entry by the rest of the entry.
fn replace(text: &[u8], table: &str) -> Vec<u8> {
    let mut out = Vec::with_capacity(text.len());
    for byte in text {
        let mut entries = table.split('|').map(str::as_bytes);
        match entries.find(|entry| entry.first() == Some(byte)) {
            Some(entry) => out.extend(&entry[1..]),
            None => out.push(*byte),
        }
    }
    out
}

/// The name of a chunk, with its quoted code in typewriter type.
fn name_text(mut name: &[u8], outside: &str) -> Vec<u8> {
    let mut out = Vec::new();
    while let Some((before, code, after)) = next_quote(name) {
        out.extend(replace(before, outside));
        out.extend(b"\\code{}");
        out.extend(replace(code, QUOTED));
        out.extend(b"\\edoc{}");
        name = after;
    }
    out.extend(replace(name, outside));
    out
}

/// The text before the first quoted code, that code, and the rest.
fn next_quote(name: &[u8]) -> Option<(&[u8], &[u8], &[u8])> {
    let open = name.windows(2).position(|pair| pair == b"[[")?;
    let code = &name[open + 2..];
    let close = quoted_length(code)?;
    Some((&name[..open], &code[..close], &code[close + 2..]))
}

const KEY: &str =
    r" :sp|#:has|$:do|%:pe|&:am|,:com|::col|\:bs|^:hat|_:un|{:lb|}:rb|~:ti";

/// An identifier for print, with what it belongs to in parentheses.
fn printed(name: &[u8]) -> Vec<u8> {
    let words = name.split(|byte| *byte == b' ').map(|word| {
        let word = replace(word.trim_ascii(), QUOTED);
        [b"\\nwixident{", &word[..], b"}"].concat()
    });
    words.collect::<Vec<_>>().join(&b' ')
}

fn tag(label: &[u8]) -> Vec<u8> {
    [b"{\\nwtagstyle{}\\subpageref{", label, b"}}"].concat()
}

/// Converts the lines of a stream to LaTeX.
pub fn to_tex<'a>(
    lines: impl Iterator<Item = &'a [u8]>,
    options: &Options,
    memory: &mut Memory<'a>,
) -> Outcome {
    let mut converter = Converter {
        options: options.clone(),
        memory: std::mem::take(memory),
        delaying: options.delay,
        ..Converter::default()
    };
    lines.for_each(|line| converter.convert(line));
    converter.break_line();
    *memory = converter.memory;
    // Withhold the text of a broken stream
    let Converter { out, messages, broken, .. } = converter;
    let (text, status) = if broken { (Vec::new(), 1) } else { (out, 0) };
    Outcome { text, messages, status }
}

impl Options {
    pub fn read(args: &[OsString]) -> Options {
        let has = |option: &str| args.iter().any(|arg| arg == option);
        let comment = if has("-no-gen-comment") { b"" } else { COMMENT };
        Options {
            delay: has("-delay"),
            index: !has("-noindex"),
            comment: comment.to_vec(),
            tex_names: has("-texnames"),
        }
    }
}

const COMMENT: &[u8] = b"% ===> this file was generated automatically \
    by noweave --- better not edit it";

/// `totex [-delay] [-noindex] [-no-gen-comment] [-texnames]`, the last
/// stage of the pipeline.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let options = Options::read(args);
    stream::filter(streams, |input| {
        let lines = stream::trimmed_lines(input);
        to_tex(lines, &options, &mut Memory::default())
    })
}
