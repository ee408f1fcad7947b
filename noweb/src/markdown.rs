// Tangled from noweb/chapters/markdown.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The back end for Markdown, and a preprocessor of mdBook.
//!
//! Chapters in Markdown become chapters in Markdown whose chunks are
//! fenced code, with references as links.

use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::mem::take;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use serde_json::Value;

use crate::commonmark::is_markdown;
use crate::diagnostic::{Faults, Source, bytes_of, checked, text_of};
use crate::finduses::{Recogniser, declared, mark_uses};
use crate::markup::{Lexeme, Token, mark_up, write_stream};
use crate::noidx::cross_reference;
use crate::reading::conflicts;
use crate::rust_index::index;
use crate::stream::{Mark, lines};
use crate::{Streams, error};

/// The form of the pages.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub enum Form {
    #[default]
    Document,
    Files,
    /// Files that mdBook reads.
    Book,
}

/// The pages of some chapters; `rust` indexes the items of a Rust
/// program.
///
/// # Errors
/// A chapter is not a web, or its prose is not in Markdown.
pub fn weave(
    chapters: &[Source],
    form: Form,
    rust: bool,
) -> Result<Vec<Vec<u8>>, Faults> {
    let (mut stream, mut faults) = (Vec::new(), Vec::new());
    let mut is_plain = Vec::new();
    for (chapter, file) in chapters.iter().zip(0..) {
        // Mark up one chapter
        if !is_markdown(&chapter.name) {
            let name = text_of(&chapter.name);
            faults.extend(error(format!(
                "{name}: no Markdown, by its name (.md)"
            )));
        }
        let path = Path::new(OsStr::from_bytes(&chapter.name));
        faults.extend(conflicts(path, &chapter.text, b""));
        let (lexemes, _) = mark_up(chapter, file, 0);
        let is_woven = |(token, text, _): &Lexeme| match token {
            Token::Text => LISTS.contains(&&text[..]),
            token => *token == Token::Defn,
        };
        is_plain.push(!lexemes.iter().any(is_woven));
        stream.extend(write_stream(&lexemes));
    }
    checked((), faults)?;
    let words = Recogniser::new(declared(&stream));
    let stream = match rust {
        true => index(&stream).0,
        false => mark_uses(&stream, &words, true),
    };
    let stream = cross_reference(&stream, false).text;
    let plan = Plan::of(&stream, form);
    let mut converter = Converter::default();
    let marks = lines(&stream).filter_map(Mark::read);
    marks.for_each(|mark| converter.convert(mark, &plan));
    // Insert the lists
    for page in &mut converter.pages {
        let end = page.iter().rposition(|byte| *byte != b'\n');
        page.truncate(end.map_or(0, |end| end + 2));
    }
    for (list, asks) in converter.lists.iter().zip(LISTS) {
        for page in &mut converter.pages {
            let mut windows = page.windows(asks.len());
            if let Some(at) = windows.position(|window| window == asks) {
                page.splice(at..at + asks.len(), list.iter().copied());
            }
        }
    }
    let woven = converter.pages.into_iter().zip(chapters);
    let woven = woven.zip(is_plain).map(|((page, chapter), is_plain)| {
        if is_plain { chapter.text.clone() } else { page }
    });
    Ok(woven.collect())
}

/// The lines that are replaced by the lists of chunks and identifiers.
const LISTS: [&[u8]; 2] =
    [b"<!-- noweb chunks -->", b"<!-- noweb index -->"];

/// The numbers and the users of all chunks of a stream.
#[derive(Default)]
struct Plan<'a> {
    form: Form,
    /// The names of the pages.
    pages: Vec<&'a [u8]>,
    /// For each label the page of its chunk, and the place of it there.
    places: HashMap<&'a [u8], (usize, usize)>,
    /// For each chunk the first that uses it.
    users: HashMap<&'a [u8], &'a [u8]>,
    /// The pages of the lists.
    lists: [usize; 2],
}

impl<'a> Plan<'a> {
    fn of(stream: &'a [u8], form: Form) -> Self {
        let mut plan = Self { form, ..Self::default() };
        let (mut count, mut label, mut chunk) = (0, &b""[..], &b""[..]);
        for mark in lines(stream).filter_map(Mark::read) {
            // Record one line of the stream
            let inner = mark.inner();
            let page = plan.pages.len().saturating_sub(1);
            match (mark.keyword, inner.keyword) {
                (b"file", _) => {
                    plan.pages.push(mark.text());
                    count = 0;
                }
                (b"text", _) => {
                    let list = LISTS.iter().position(|l| *l == mark.text());
                    list.iter().for_each(|list| plan.lists[*list] = page);
                }
                (b"xref", b"label") => label = inner.text(),
                (b"defn", _) => {
                    count += 1;
                    chunk = mark.text();
                    plan.places.insert(label, (page, count));
                }
                (b"use", _) => {
                    plan.users.entry(mark.text()).or_insert(chunk);
                }
                _ => {}
            }
        }
        plan
    }

    /// The extension of the root that a chunk belongs to, as most programs
    /// that colour code know it.
    fn language(&self, mut chunk: &'a [u8]) -> &'a [u8] {
        for _ in 0..self.users.len() {
            chunk = self.users.get(chunk).unwrap_or(&chunk);
        }
        let path = Path::new(OsStr::from_bytes(chunk));
        match path.extension().unwrap_or_default().as_bytes() {
            b"rs" => b"rust",
            b"py" => b"python",
            b"h" => b"c",
            name => name,
        }
    }

    /// The number of the chunk of a label, as words that follow others.
    fn number(&self, label: &[u8]) -> String {
        let place = self.places.get(label);
        let number = |(page, count)| format!(" {}.{count}", page + 1);
        place.copied().map(number).unwrap_or_default()
    }

    /// Some words and the number of a chunk, as a link from a page.
    fn link(&self, page: usize, label: &[u8], words: &str) -> String {
        let text = words.to_owned() + &self.number(label);
        self.link_to(page, label, text.trim_ascii_start())
    }

    /// Some words as a link from a page to a chunk.
    fn link_to(&self, page: usize, label: &[u8], text: &str) -> String {
        let Some(&(other, count)) = self.places.get(label) else {
            return text.to_owned();
        };
        let path = match self.form == Form::Document || other == page {
            true => String::new(),
            false => relative(self.pages[page], self.pages[other]),
        };
        format!("[{text}]({path}#chunk-{}-{count})", other + 1)
    }

    /// Links to some chunks.
    fn links(&self, page: usize, labels: &[&[u8]]) -> String {
        let links = labels.iter().map(|label| self.link(page, label, ""));
        links.collect::<Vec<_>>().join(", ")
    }
}

/// The path of one file as seen from another.
fn relative(from: &[u8], to: &[u8]) -> String {
    let paths = [from, to].map(text_of);
    let [from, to] =
        paths.each_ref().map(|p| p.split('/').collect::<Vec<_>>());
    let pairs = from.iter().zip(&to);
    let same = pairs.take_while(|(a, b)| a == b).count();
    let same = same.min(from.len() - 1).min(to.len() - 1);
    "../".repeat(from.len() - 1 - same) + &to[same..].join("/")
}

#[derive(Default)]
struct Converter<'a> {
    pages: Vec<Vec<u8>>,
    /// The code of a chunk, if we are in one, and its name and label.
    code: Option<Vec<u8>>,
    chunk: &'a [u8],
    place: &'a [u8],
    is_after_code: bool,
    /// The label of what comes next.
    label: &'a [u8],
    /// Whether the line of the name has not ended yet.
    naming: bool,
    /// Code that is quoted in prose, and where it is defined.
    quote: Option<(Vec<u8>, &'a [u8])>,
    /// Where the name or the identifier that comes next is defined.
    reference: &'a [u8],
    /// For each chunk that was defined the labels of its uses.
    users: HashMap<&'a [u8], Vec<&'a [u8]>>,
    continued: Vec<&'a [u8]>,
    /// What a chunk includes, defines and uses, as links.
    links: [Vec<String>; 3],
    /// An entry of a list: its name, where it is defined, and used.
    entry: (&'a [u8], [Vec<&'a [u8]>; 2]),
    /// What is shown of identifiers whose keys are longer.
    shown: HashMap<&'a [u8], &'a [u8]>,
    lists: [Vec<u8>; 2],
}

impl<'a> Converter<'a> {
    fn convert(&mut self, mark: Mark<'a>, plan: &Plan<'a>) {
        let (inner, text) = (mark.inner(), mark.inner().text());
        match (mark.keyword, inner.keyword) {
            (b"file", _) => {
                self.pages.push(Vec::new());
                self.is_after_code = false;
            }
            (b"text", _) => {
                self.leave_code(mark.text().is_empty());
                self.put(mark.text());
            }
            (b"nl", _) if take(&mut self.naming) => {}
            (b"nl", _) => self.put(b"\n"),
            (b"begin", b"code") => self.code = Some(Vec::new()),
            (b"defn", _) => {
                (self.chunk, self.place) = (mark.text(), self.label);
                self.naming = true;
            }
            (b"use", _) => self.include(mark.text(), plan),
            (b"end", b"code") => self.end_code(plan),
            (b"quote", _) => {
                self.leave_code(false);
                self.quote = Some((Vec::new(), b""));
            }
            (b"endquote", _) => self.end_quote(plan),
            // Collect references between chunks
            (b"xref", b"label") => self.label = text,
            (b"xref", b"ref") => self.reference = text,
            (b"xref", b"defitem") => self.continued.push(text),
            (b"xref", b"useitem") => {
                self.users.entry(self.chunk).or_default().push(text);
            }
            (b"xref", b"chunkbegin") | (b"index", b"entrybegin") => {
                self.entry.0 = inner.inner().text();
            }
            (b"xref", b"chunkdefn") | (b"index", b"entrydefn") => {
                self.entry.1[0].push(text);
            }
            (b"xref", b"chunkend") => self.end_entry(0, plan),
            (b"index", b"entryend") => self.end_entry(1, plan),
            // Collect entries of the index
            (b"xref", b"chunkuse")
            | (b"index", b"isused" | b"isdefined" | b"entryuse") => {
                self.entry.1[1].push(text);
            }
            (b"index", b"name") => {
                let name = inner.inner();
                self.shown.insert(name.keyword, name.text());
            }
            (b"index", b"use" | b"link") => {
                let quote = self.quote.as_mut().filter(|q| q.1.is_empty());
                quote.into_iter().for_each(|q| q.1 = self.reference);
            }
            // Collect the identifiers of a chunk
            (b"index", b"defitem") => {
                let mut users = take(&mut self.entry.1[1]);
                users.retain(|label| *label != self.place);
                let mut words = self.identifier(text);
                if !users.is_empty() {
                    let users = plan.links(self.page(), &users);
                    words += &format!(" (used in {users})");
                }
                self.links[1].push(words);
            }
            (b"index", b"useitem") => {
                let labels = take(&mut self.entry.1[1]);
                let label = labels.first().copied().unwrap_or_default();
                let words = self.identifier(text);
                self.links[2].push(plan.link(self.page(), label, &words));
            }
            _ => {}
        }
    }

    /// Puts an empty line behind a chunk, unless the prose has one.
    fn leave_code(&mut self, has_one: bool) {
        if take(&mut self.is_after_code) && !has_one {
            self.put(b"\n");
        }
    }

    fn put(&mut self, text: &[u8]) {
        let quote = self.quote.as_mut().map(|(text, _)| text);
        let inside = quote.or(self.code.as_mut());
        if let Some(out) = inside.or(self.pages.last_mut()) {
            out.extend(text);
        }
    }

    fn identifier(&self, key: &[u8]) -> String {
        let shown = self.shown.get(key).copied().unwrap_or(key);
        format!("`{}`", text_of(shown))
    }

    fn page(&self) -> usize {
        self.pages.len() - 1
    }

    fn include(&mut self, name: &[u8], plan: &Plan<'a>) {
        let number = plan.number(self.reference);
        self.put(&bytes_of(&format!("⟨{}{number}⟩", text_of(name))));
        let words = format!("⟨{}⟩", escaped(name));
        let link = plan.link(self.page(), self.reference, &words);
        if !self.links[0].contains(&link) {
            self.links[0].push(link);
        }
    }

    fn end_code(&mut self, plan: &Plan<'a>) {
        let mut code = self.code.take().unwrap_or_default();
        let page = self.page();
        let users = self.users.get(self.chunk).cloned().unwrap_or_default();
        let [includes, defines, uses] = take(&mut self.links);
        // Find a fence that is long enough
        let runs = code.split(|byte| *byte != b'`').map(<[u8]>::len);
        let fence = "`".repeat(runs.max().unwrap_or(0).max(2) + 1);
        let number = plan.number(self.place);
        let anchor = number.trim_ascii_start().replace('.', "-");
        let name = escaped(self.chunk);
        let language = text_of(plan.language(self.chunk));
        if plan.form == Form::Book && language == "rust" {
            code = bytes_of(&shown_by_mdbook(&text_of(&code)));
        }
        let gap =
            if self.pages[page].ends_with(b"\n\n") { "" } else { "\n" };
        self.put(&bytes_of(&format!(
            "{gap}<a id=\"chunk-{anchor}\"></a>\n**⟨{name}⟩** ≡{number}\n\n\
             {fence}{language}\n"
        )));
        self.put(&code);
        let parts = [
            ("used in ", plan.links(page, &users)),
            ("continued in ", plan.links(page, &take(&mut self.continued))),
            ("includes ", includes.join(", ")),
            ("defines ", defines.join(", ")),
            ("uses ", uses.join(", ")),
        ];
        let parts = parts.into_iter().filter(|(_, what)| !what.is_empty());
        let parts = parts.map(|(how, what)| how.to_owned() + &what);
        let parts = parts.collect::<Vec<_>>().join(" · ");
        let end = if parts.is_empty() { "" } else { "\n" };
        self.put(&bytes_of(&format!("{fence}\n{end}{parts}{end}")));
        self.is_after_code = true;
    }

    fn end_quote(&mut self, plan: &Plan<'a>) {
        let Some((code, label)) = self.quote.take() else { return };
        let out = &self.pages[self.page()];
        let line = out.rsplit(|byte| *byte == b'\n').next();
        let is_heading = line.is_some_and(|line| line.starts_with(b"#"));
        let code = format!("`{}`", text_of(&code));
        let is_free = !is_heading && !out.ends_with(b"[");
        let label = if is_free { label } else { b"" };
        let shown = plan.link_to(self.page(), label, &code);
        self.put(&bytes_of(&shown));
    }

    /// Ends an entry of the list of chunks, or of identifiers.
    fn end_entry(&mut self, list: usize, plan: &Plan<'a>) {
        let (name, [defined, used]) = take(&mut self.entry);
        let name = match list {
            0 => format!("⟨{}⟩", escaped(name)),
            _ => self.identifier(name),
        };
        let page = plan.lists[list];
        let mut line = format!("- {name} {}", plan.links(page, &defined));
        if !used.is_empty() {
            line += &format!("; used in {}", plan.links(page, &used));
        }
        self.lists[list].extend(bytes_of(&(line + "\n")));
    }
}

/// Code in Rust with all lines visible in mdBook.
fn shown_by_mdbook(code: &str) -> String {
    let shown = |line: &str| {
        let sign = line.trim_start().strip_prefix('#');
        match sign.is_some_and(|rest| !rest.starts_with(['[', '!'])) {
            true => line.replacen('#', "##", 1),
            false => line.to_owned(),
        }
    };
    code.split_inclusive('\n').map(shown).collect()
}

/// The name of a chunk, in which Markdown sees code alone.
fn escaped(name: &[u8]) -> String {
    let name = text_of(name).replace("[[", "`").replace("]]", "`");
    let mut is_code = false;
    let escape = |sign: char| {
        is_code ^= sign == '`';
        let special = !is_code && r"\*_{}[]<>#|~$&".contains(sign);
        special.then_some('\\').into_iter().chain([sign])
    };
    name.chars().flat_map(escape).collect()
}

/// `noweb mdbook`, a preprocessor of mdBook; it supports all that shows
/// Markdown.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    if args.first().is_some_and(|arg| arg == "supports") {
        return 0;
    }
    match preprocess(streams) {
        Ok(book) => streams.say(&book.to_string()),
        Err(faults) => streams.fail(&faults),
    }
}

fn preprocess(streams: &mut Streams) -> Result<Value, Faults> {
    let given = serde_json::from_reader(&mut *streams.input);
    let [context, mut book]: [Value; 2] = given
        .map_err(|e| error(format!("expected the JSON of mdBook: {e}")))?;
    let rust = context["config"]["preprocessor"]["noweb"]["rust"] == true;
    let mut contents = Vec::new();
    collect(&mut book, &mut contents);
    let source = |(path, content): &(String, &mut Value)| {
        let text = content.as_str().unwrap_or_default();
        Source::new(path.clone().into_bytes(), text.as_bytes().to_vec())
    };
    let chapters: Vec<_> = contents.iter().map(source).collect();
    let woven = weave(&chapters, Form::Book, rust)?;
    for ((_, content), page) in contents.into_iter().zip(woven) {
        *content = text_of(&page).into();
    }
    Ok(book)
}

/// The texts of all chapters, with the paths of their files, in order.
fn collect<'v>(
    value: &'v mut Value,
    found: &mut Vec<(String, &'v mut Value)>,
) {
    match value {
        Value::Array(all) => {
            all.iter_mut().for_each(|value| collect(value, found))
        }
        Value::Object(all) => {
            let path = all.get("path").and_then(Value::as_str);
            let path = path.map(str::to_owned);
            for (key, value) in all {
                match path.clone().filter(|_| key == "content") {
                    Some(path) => found.push((path, value)),
                    None => collect(value, found),
                }
            }
        }
        _ => {}
    }
}
