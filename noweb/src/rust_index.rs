// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The stage `rustindex`: what a Rust program defines and uses.
//!
//! It stands in the place of `finduses`. The program is tangled out of the
//! stream, and what is found in it goes back to the lines of the stream:
//! places in this module are the number of a line and a byte of its text.

// Import what the index needs
use std::collections::{BTreeMap, HashMap, HashSet};
use std::ffi::OsString;
use std::ops::Range;

use proc_macro2::{Span, TokenStream, TokenTree};

use crate::Streams;
use crate::diagnostic::{Diagnostic, Level, Place, Position};
use crate::finduses::Recogniser;
use crate::markup::parse_token;
use crate::project::{comment_leader, is_file_name};
use crate::rust_names::{File, Found, Id, Kind, Names, Space};
use crate::rust_uses::{unfold, uses};
use crate::stream::{self, Mark, Outcome};
use crate::tangle::{Layout, Tangled, tangle};
use crate::web::Web;

// Keep a tangled file with its way back
/// A file of the program.
struct Text {
    path: String,
    tangled: Tangled,
    /// The first byte of each line, and of each segment of the map.
    lines: Vec<usize>,
    segments: Vec<usize>,
}

impl Text {
    fn new(path: String, tangled: Tangled) -> Self {
        let ends = tangled.text.iter().enumerate();
        let ends = ends.filter(|(_, byte)| **byte == b'\n');
        let lines = ends.map(|(at, _)| at + 1);
        let lines: Vec<usize> = std::iter::once(0).chain(lines).collect();
        let start = |s: &crate::tangle::Segment| {
            lines[s.line as usize - 1] + s.column as usize - 1
        };
        let segments = tangled.map.iter().map(start).collect();
        Self { path, tangled, lines, segments }
    }
    /// The pieces of the stream that a range of bytes comes from.
    fn pieces(&self, range: &Range<usize>) -> Vec<Piece> {
        let first = self.segments.partition_point(|s| *s <= range.start);
        let mut pieces = Vec::new();
        for at in first.saturating_sub(1)..self.segments.len() {
            let (start, segment) =
                (self.segments[at], self.tangled.map[at]);
            if start >= range.end {
                break;
            }
            // Cut the range to the segment and its line
            let line_end =
                self.lines.get(segment.line as usize).map(|end| end - 1);
            let next = self.segments.get(at + 1).copied();
            let ends = [Some(range.end), line_end, next];
            let end = ends.into_iter().flatten().min().unwrap_or(start);
            let from = start.max(range.start);
            if from < end {
                let inside =
                    |at| segment.place.column as usize - 1 + at - start;
                let Place { line, .. } = segment.place;
                pieces.push((line as usize, inside(from)..inside(end)));
            }
        }
        pieces
    }
}

/// A line of the stream, and the bytes of its text.
type Piece = (usize, Range<usize>);
// Tell keywords and comments apart
/// The words that are reserved everywhere in Rust 2024.
const KEYWORDS: &str = "as async await break const continue crate dyn else \
    enum extern false fn for if impl in let loop match mod move mut pub ref \
    return self Self static struct super trait true type unsafe use where \
    while";

/// The bytes of the leaves of a tree of tokens, with their words.
fn leaves(tokens: TokenStream, out: &mut Vec<(Range<usize>, String)>) {
    for token in tokens {
        match token {
            TokenTree::Group(group) => {
                out.push((group.span_open().byte_range(), String::new()));
                leaves(group.stream(), out);
                out.push((group.span_close().byte_range(), String::new()));
            }
            TokenTree::Ident(ident) => {
                out.push((ident.span().byte_range(), ident.to_string()));
            }
            other => out.push((other.span().byte_range(), String::new())),
        }
    }
}
/// The keywords, the comments, and the other words of a file.
#[derive(Default)]
struct Words {
    keywords: Vec<Range<usize>>,
    comments: Vec<Range<usize>>,
    others: Vec<(Range<usize>, String)>,
}

impl Words {
    fn new(text: &str, tokens: TokenStream) -> Self {
        let mut list = Vec::new();
        leaves(tokens, &mut list);
        let mut words = Self::default();
        let mut done = 0;
        for (range, word) in list {
            // Take what lies before the token for a comment
            if range.end <= done {
                continue;
            }
            words.comments.push(done..range.start);
            done = range.end;
            // Sort the token by what stands there
            let rest = &text[range.start..];
            if rest.starts_with("//") || rest.starts_with("/*") {
                words.comments.push(range);
            } else if KEYWORDS.split(' ').any(|k| k == word) {
                words.keywords.push(range);
            } else if !word.is_empty() {
                words.others.push((range, word));
            }
        }
        words.comments.push(done..text.len());
        words
    }
}
// Keep what was found in the stream
/// What a piece of the stream is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Note {
    Keyword,
    Comment,
    Define(Id),
    Use(Id),
    /// Not the same in all files that the chunk goes to.
    Disputed,
}

/// The stream, and what was found in it.
#[derive(Default)]
struct Notes<'s> {
    lines: Vec<&'s [u8]>,
    /// The file that each line of the stream comes from, and its line.
    places: Vec<(usize, u32)>,
    chapters: Vec<&'s [u8]>,
    /// By line and first byte: the end, and what it is.
    notes: BTreeMap<(usize, usize), (usize, Note)>,
    /// The lines of the stream that are known to be Rust.
    rust: HashSet<usize>,
    /// The modules that are files, by their paths.
    roots: HashMap<String, Id>,
    faults: Vec<Diagnostic>,
}
impl<'s> Notes<'s> {
    fn new(stream: &'s [u8]) -> Self {
        let lines: Vec<_> = stream::lines(stream).collect();
        let mut notes = Self { lines, ..Self::default() };
        let mut line = 1;
        for text in &notes.lines {
            if let Some(file) = text.strip_prefix(b"@file ") {
                notes.chapters.push(file);
                line = 1;
            }
            let chapter = notes.chapters.len().saturating_sub(1);
            notes.places.push((chapter, line));
            line += u32::from(matches!(*text, b"@nl" | b"@index nl"));
        }
        notes
    }

    /// Notes what a piece is; white space at its ends is left out.
    fn add(&mut self, (line, range): Piece, note: Note) {
        let text = &self.lines[line][b"@text ".len()..][range.clone()];
        let start = range.end - text.trim_ascii_start().len();
        let end = range.start + text.trim_ascii_end().len();
        if start >= end {
            return;
        }
        let old = self.notes.entry((line, start)).or_insert((end, note));
        if *old != (end, note) {
            *old = (end, Note::Disputed);
        }
    }
    fn add_all(&mut self, text: &Text, range: &Range<usize>, note: Note) {
        for piece in text.pieces(range) {
            self.add(piece, note);
        }
    }

    /// Notes an identifier, which must lie in one piece.
    fn add_word(&mut self, text: &Text, range: &Range<usize>, note: Note) {
        if let [piece] = &text.pieces(range)[..]
            && piece.1.len() == range.len()
        {
            self.add(piece.clone(), note);
        }
    }

    /// Warns that a file does not parse.
    fn complain(&mut self, text: &Text, span: Span, what: &str) {
        let at = span.byte_range().start;
        let piece = text.pieces(&(at..at + 1)).into_iter().next();
        let position = piece.map(|piece| self.position(piece));
        let what = format!("{} is no Rust: {what}", text.path);
        let help = "its identifiers are those of the %def lines alone";
        let fault = Diagnostic::new(Level::Warning, position, what);
        self.faults.push(fault.with_help(help));
    }
    /// The place in its chapter, for people.
    fn position(&self, (line, range): Piece) -> Position {
        let (chapter, number) = self.places[line];
        let before = self.lines[..line].iter().rev();
        let before = before.take_while(|l| **l != b"@nl");
        // Count the columns of the marks before
        let column: usize = before
            .filter_map(|line| match Mark::read(line)? {
                Mark { keyword: b"text", argument } => {
                    Some(argument?.len())
                }
                Mark { keyword: b"use", argument } => {
                    Some(argument?.len() + 4)
                }
                _ => None,
            })
            .sum();
        let file = self.chapters.get(chapter).copied().unwrap_or_default();
        Position {
            file: String::from_utf8_lossy(file).into_owned(),
            line: number,
            column: (column + range.start + 1) as u32,
            excerpt: None,
        }
    }
}
// Read the program out of the stream
/// The program that the stream describes, as far as it parses.
#[derive(Default)]
struct Program {
    texts: Vec<Text>,
    files: Vec<File>,
    words: Vec<Words>,
}

impl Program {
    fn read(notes: &mut Notes) -> Self {
        let mut program = Self::default();
        let place = |line| Place { file: 0, line, column: 1 };
        let tokens = notes.lines.iter().zip(0..);
        let lexemes = tokens
            .filter_map(|(text, n)| Some((parse_token(text)?, place(n))));
        let web = Web::from_lexemes(lexemes.collect());
        for chunk in &web.chunks {
            let name = &chunk.name[..];
            if web.uses.contains_key(name) || !is_file_name(name) {
                continue;
            }
            let tangled = tangle(&web, &[name], &Layout::default());
            let path = String::from_utf8_lossy(name).into_owned();
            // A chunk that cannot be expanded is for the tangler to refuse.
            if let Ok(tangled) = tangled {
                program.take(Text::new(path, tangled), notes);
            }
        }
        program
    }
    fn take(&mut self, text: Text, notes: &mut Notes) {
        if !text.path.ends_with(".rs") {
            return note_comment_lines(&text, notes);
        }
        // Make tokens of the file's text
        // Bytes would not be counted as in the tangled text.
        let source = String::from_utf8(text.tangled.text.clone());
        let Ok(source) = source else { return };
        let tokens = match source.parse::<TokenStream>() {
            Ok(tokens) => tokens,
            Err(e) => {
                return notes.complain(&text, e.span(), &e.to_string());
            }
        };
        let words = Words::new(&source, tokens.clone());
        note_words(&words, &text, notes);
        match syn::parse2::<syn::File>(tokens) {
            Ok(mut syntax) => {
                // Keep the file and its lines
                unfold(&mut syntax);
                let map = text.tangled.map.iter();
                notes
                    .rust
                    .extend(map.map(|segment| segment.place.line as usize));
                self.files.push(File { path: text.path.clone(), syntax });
                self.words.push(words);
                self.texts.push(text);
            }
            Err(e) => notes.complain(&text, e.span(), &e.to_string()),
        }
    }
}
fn note_words(words: &Words, text: &Text, notes: &mut Notes) {
    for range in &words.keywords {
        notes.add_word(text, range, Note::Keyword);
    }
    for range in &words.comments {
        notes.add_all(text, range, Note::Comment);
    }
}

/// Notes the lines that are comments in a script.
fn note_comment_lines(text: &Text, notes: &mut Notes) {
    let path = std::path::Path::new(&text.path);
    let Some(leader) = comment_leader(path) else { return };
    let leader = leader.trim_end().as_bytes();
    for (start, end) in text.lines.iter().zip(&text.lines[1..]) {
        let line = &text.tangled.text[*start..*end];
        if line.trim_ascii_start().starts_with(leader) {
            notes.add_all(text, &(*start..*end), Note::Comment);
        }
    }
}
// Note what the program defines and uses
impl Program {
    fn note<'a>(&'a self, notes: &mut Notes) -> Names<'a> {
        let mut names = Names::new(&self.files, library);
        for (file, module) in self.files.iter().zip(&names.modules) {
            notes.roots.insert(file.path.clone(), *module);
        }
        // Note where the items are declared
        for (id, item) in names.items.iter().enumerate() {
            if let Some((file, range)) = &item.site {
                let elsewhere = names.modules.contains(&id);
                let note = [Note::Define(id), Note::Use(id)];
                let text = &self.texts[*file];
                notes.add_word(text, range, note[usize::from(elsewhere)]);
            }
        }
        let defined: HashSet<Id> = notes.defined().collect();
        // Note the uses of what is defined
        for (number, file) in self.files.iter().enumerate() {
            for (range, id) in uses(&mut names, number, &file.syntax) {
                if defined.contains(&id) {
                    let text = &self.texts[number];
                    notes.add_word(text, &range, Note::Use(id));
                }
            }
        }
        names
    }
}

impl Notes<'_> {
    fn on_line(&self, line: usize) -> impl Iterator<Item = &(usize, Note)> {
        let here = self.notes.range((line, 0)..(line + 1, 0));
        here.map(|(_, note)| note)
    }

    fn chapters_of_items(&self) -> HashMap<Id, usize> {
        let notes = self.notes.iter();
        let homes = notes.filter_map(|((line, _), (_, note))| match note {
            Note::Define(id) => Some((*id, self.places[*line].0)),
            _ => None,
        });
        homes.collect()
    }

    /// The words of `%def` lists that are no items.
    fn words<'w>(
        &'w self,
        listed: &'w HashMap<usize, Option<Id>>,
    ) -> impl Iterator<Item = &'w [u8]> {
        let lines = self.lines.iter().enumerate();
        let lines = lines.filter(|(line, _)| !listed.contains_key(line));
        lines.filter_map(|(_, line)| line.strip_prefix(b"@index defn "))
    }

    /// The items whose definitions stand in the stream.
    fn defined(&self) -> impl Iterator<Item = Id> {
        let items =
            self.notes.values().filter_map(|(_, note)| match note {
                Note::Define(id) => Some(*id),
                _ => None,
            });
        items.chain(self.roots.values().copied())
    }
}
/// What others call the library whose root is this file, if it is one:
/// what its manifest says, or else what its directory is called.
fn library(path: &str) -> Option<String> {
    let dir = path.strip_suffix("src/lib.rs")?;
    let manifest = std::fs::read_to_string(format!("{dir}Cargo.toml"));
    let manifest = manifest.unwrap_or_default();
    let package = manifest.lines().skip_while(|l| *l != "[package]");
    let mut names = package.filter_map(|l| l.strip_prefix("name = "));
    let name = names.next().map(|name| name.trim().trim_matches('"'));
    let name = name.or(dir.trim_end_matches('/').rsplit('/').next())?;
    Some(name.replace('-', "_"))
}
// Find the names that are not only ours
/// What quoted code is resolved with.
struct Quotes<'n, 'a> {
    names: &'n Names<'a>,
    defined: HashSet<Id>,
    /// The modules of each chapter, and the words of its code that are no
    /// items.
    modules: HashMap<usize, HashSet<Id>>,
    free: HashMap<usize, HashSet<&'n str>>,
    /// The chapter that defines an item.
    chapters: HashMap<Id, usize>,
    /// The items of each name.
    items: HashMap<&'n str, Vec<Id>>,
}

impl<'n, 'a> Quotes<'n, 'a> {
    fn new(
        names: &'n Names<'a>,
        program: &'n Program,
        notes: &Notes,
    ) -> Self {
        let defined = notes.defined().collect();
        let (modules, free) = (HashMap::new(), HashMap::new());
        let chapters = notes.chapters_of_items();
        let items = HashMap::new();
        let mut quotes =
            Self { names, defined, modules, free, chapters, items };
        for id in &quotes.defined {
            let name = &names.items[*id].name[..];
            quotes.items.entry(name).or_default().push(*id);
        }
        for (number, text) in program.texts.iter().enumerate() {
            // Note the modules and free words of a file
            for segment in &text.tangled.map {
                let (chapter, _) =
                    notes.places[segment.place.line as usize];
                let modules = quotes.modules.entry(chapter).or_default();
                modules.insert(names.modules[number]);
            }
            for (range, word) in &program.words[number].others {
                for (line, piece) in text.pieces(range) {
                    let note = notes.notes.get(&(line, piece.start));
                    let ours = matches!(
                        note,
                        Some((_, Note::Define(_) | Note::Use(_)))
                    );
                    if !ours {
                        let (chapter, _) = notes.places[line];
                        let free = quotes.free.entry(chapter).or_default();
                        free.insert(word);
                    }
                }
            }
        }
        quotes
    }
}
// Resolve quoted code
impl Quotes<'_, '_> {
    /// The item that quoted code means in a chapter, if that is certain.
    fn resolve(&self, chapter: usize, code: &[u8]) -> Option<Id> {
        // Split the code into names
        let code = std::str::from_utf8(code).ok()?;
        let code = code.trim_end_matches("()").trim_end_matches('!');
        let path: Vec<String> = code.split("::").map(Into::into).collect();
        if !path.iter().all(|name| is_name(name)) {
            return None;
        }
        let mut found = self.in_chapter(chapter, &path);
        if found.is_empty() && path.len() == 1 {
            found = self.members(chapter, code);
        }
        // Take the only item that it can be
        let free = |words: &HashSet<&str>| words.contains(code);
        match found[..] {
            [one] => {
                let doubt = self.free.get(&chapter).is_some_and(free);
                (!doubt).then_some(one)
            }
            [] => {
                let doubt = self.free.values().any(free);
                self.anywhere(&path).filter(|_| !doubt)
            }
            _ => None,
        }
    }
    /// What the path means in the modules of the chapter.
    fn in_chapter(&self, chapter: usize, path: &[String]) -> Vec<Id> {
        let mut found = Vec::new();
        for module in self.modules.get(&chapter).into_iter().flatten() {
            for space in [Space::Types, Space::Values, Space::Macros] {
                let meaning = self.names.path(*module, path, space);
                if let Found::Item(id) = meaning
                    && self.defined.contains(&id)
                    && !found.contains(&id)
                {
                    found.push(id);
                }
            }
        }
        found
    }

    /// The members of this name that the chapter defines.
    fn members(&self, chapter: usize, name: &str) -> Vec<Id> {
        let is_here = |id: &Id| {
            let item = &self.names.items[*id];
            let home = self.chapters.get(id) == Some(&chapter);
            home && item.kind == Kind::Member
        };
        let named = self.items.get(name).into_iter().flatten().copied();
        named.filter(is_here).collect()
    }

    /// The only item whose path ends so, a member not without its type.
    fn anywhere(&self, path: &[String]) -> Option<Id> {
        let name = path.last()?;
        let ends_so = |id: &&Id| {
            let mut at = Some(**id);
            let member = self.names.items[**id].kind == Kind::Member;
            (path.len() > 1 || !member)
                && path.iter().rev().all(|name| {
                    let item = at.map(|id| &self.names.items[id]);
                    at = item.and_then(|item| item.parent);
                    item.is_some_and(|item| item.name == *name)
                })
        };
        let items = self.items.get(&name[..])?.iter();
        let mut items = items.filter(ends_so);
        let first = items.next();
        first.filter(|_| items.next().is_none()).copied()
    }
}

fn is_name(name: &str) -> bool {
    let letter = |c: char| c == '_' || c.is_ascii_alphanumeric();
    name.chars().all(letter)
        && name.starts_with(|c: char| !c.is_ascii_digit())
        && !KEYWORDS.split(' ').any(|k| k == name)
}
// Give each item its key and its name
/// The path of an item from the root of its crate: the key of the index.
fn key(names: &Names, id: Id) -> String {
    let item = &names.items[id];
    match item.parent {
        Some(parent) => format!("{}::{}", key(names, parent), item.name),
        None => item.name.clone(),
    }
}

/// Whether an item is listed. Modules and variants are linked only: they
/// would fill the lists with what the reader sees anyhow.
fn is_listed(names: &Names, id: Id) -> bool {
    !matches!(names.items[id].kind, Kind::Module | Kind::Variant)
}
/// The last names in the path of what an item belongs to.
fn owner(names: &Names, id: Id, count: usize) -> String {
    let path = key(names, names.items[id].parent.unwrap_or(id));
    let path = path.rsplit('/').next().unwrap_or(&path);
    let mut steps: Vec<&str> = path.rsplit("::").take(count).collect();
    steps.reverse();
    steps.join("::")
}

/// The marks that tell for each key what is shown: the name, and what it
/// belongs to where two items have the same name.
fn declarations(names: &Names, quotes: &Quotes, words: &[&[u8]]) -> String {
    let mut lines = Vec::new();
    for (name, ids) in &quotes.items {
        let mut ids = ids.clone();
        ids.retain(|id| is_listed(names, *id));
        for id in &ids {
            // Tell the item from others of its name
            let different = |o: &&Id| key(names, **o) != key(names, *id);
            let others: Vec<&Id> = ids.iter().filter(different).collect();
            let apart = |count: &usize| {
                let of = owner(names, *id, *count);
                others.iter().all(|o| owner(names, **o, *count) != of)
            };
            let count = (1..4).find(apart).unwrap_or(4);
            let word = words.contains(&name.as_bytes());
            let of = match others.is_empty() && !word {
                true => String::new(),
                false => format!(" ({})", owner(names, *id, count)),
            };
            let key = key(names, *id);
            lines.push(format!("@index name {key} {name}{of}\n"));
        }
    }
    lines.sort();
    lines.dedup();
    lines.concat()
}
// Reconcile the lists with what was found
/// By line of the stream: what becomes of a name in a `%def` list.
///
/// A name that the chunk was found to define is dropped. Another item of
/// the chapter's modules is defined here as well; the rest stays a word.
fn reconcile(notes: &Notes, quotes: &Quotes) -> HashMap<usize, Option<Id>> {
    let mut listed = HashMap::new();
    let (mut here, mut rust) = (HashSet::new(), false);
    for (number, line) in notes.lines.iter().enumerate() {
        if line.starts_with(b"@begin ") {
            (here, rust) = (HashSet::new(), false);
        }
        rust |= notes.rust.contains(&number);
        for (_, note) in notes.on_line(number) {
            if let Note::Define(id) = note {
                here.insert(quotes.names.items[*id].name.as_bytes());
            }
        }
        let Some(name) = line.strip_prefix(b"@index defn ") else {
            continue;
        };
        // Drop the name or give it to an item
        if here.contains(name) {
            listed.insert(number, None);
        } else if rust {
            let path = [String::from_utf8_lossy(name).into_owned()];
            let (chapter, _) = notes.places[number];
            if let [one] = quotes.in_chapter(chapter, &path)[..] {
                listed.insert(number, Some(one));
            }
        }
    }
    listed
}
// Write the stream with its marks
/// The stream that goes out, and where we are in the one that came in.
struct Writer<'w, 'n, 'a> {
    notes: &'w Notes<'w>,
    quotes: &'w Quotes<'n, 'a>,
    /// The words that only `%def` lists.
    words: Recogniser,
    /// By line, the keys that stand in the place of words in `%def`.
    listed: HashMap<usize, Option<Id>>,
    out: Vec<u8>,
    code: bool,
    quote: bool,
    /// The module of the file whose root chunk begins.
    root: Option<Id>,
}

impl Writer<'_, '_, '_> {
    fn put(&mut self, parts: &[&[u8]]) {
        self.out.extend(parts.concat());
        self.out.push(b'\n');
    }

    fn write(&mut self) {
        for (number, line) in self.notes.lines.iter().enumerate() {
            self.write_line(number, line);
        }
        self.put(&[b"@index mini"]);
    }
    fn write_line(&mut self, number: usize, line: &[u8]) {
        let Some(mark) = Mark::read(line) else {
            return self.put(&[line]);
        };
        match mark.keyword {
            b"begin" => self.code = mark.inner().keyword == b"code",
            b"quote" => self.quote = true,
            b"endquote" => self.quote = false,
            b"file" if self.notes.places[number].0 > 0 => {
                self.put(&[b"@index mini"]);
            }
            b"defn" => self.root = self.module(mark.text()),
            b"nl" if self.root.is_some() => {
                self.put(&[line]);
                let module = self.root.take();
                return module.into_iter().for_each(|id| {
                    self.announce(Note::Define(id));
                });
            }
            b"text" if self.code => {
                return self.write_code(number, mark.text());
            }
            b"text" if self.quote => {
                return self.write_quoted(number, mark.text());
            }
            b"index" if mark.inner().keyword == b"defn" => {
                return self.write_listed(number, line);
            }
            _ => {}
        }
        self.put(&[line]);
    }
    /// Writes a text of code, cut at what was found in it.
    fn write_code(&mut self, number: usize, text: &[u8]) {
        let notes = self.notes;
        let here = notes.notes.range((number, 0)..(number + 1, 0));
        let mut done = 0;
        for ((_, start), (end, note)) in here {
            if *note == Note::Disputed || *start < done {
                continue;
            }
            if done < *start {
                self.write_plain(number, &text[done..*start]);
            }
            self.announce(*note);
            self.put(&[b"@text ", &text[*start..*end]]);
            done = *end;
        }
        if done == 0 || done < text.len() {
            self.write_plain(number, &text[done..]);
        }
    }

    /// Writes what nothing was found in; words are sought in other code.
    fn write_plain(&mut self, number: usize, text: &[u8]) {
        let line = [b"@text ", text].concat();
        if self.notes.rust.contains(&number) || text.is_empty() {
            self.put(&[&line]);
        } else {
            self.words.mark_line(&line, &mut self.out);
        }
    }
    fn announce(&mut self, note: Note) {
        let names = self.quotes.names;
        let (mark, id) = match note {
            Note::Keyword => return self.put(&[b"@style keyword"]),
            Note::Comment => return self.put(&[b"@style comment"]),
            Note::Disputed => return,
            Note::Define(id) if is_listed(names, id) => ("defn", id),
            Note::Define(id) => ("anchor", id),
            Note::Use(id) if is_listed(names, id) => ("use", id),
            Note::Use(id) => ("link", id),
        };
        let line = format!("@index {mark} {}", key(names, id));
        self.put(&[line.as_bytes()]);
    }

    /// The module that a chunk is the file of.
    fn module(&self, chunk: &[u8]) -> Option<Id> {
        let path = std::str::from_utf8(chunk).ok()?;
        self.notes.roots.get(path).copied()
    }

    fn write_quoted(&mut self, number: usize, text: &[u8]) {
        let (chapter, _) = self.notes.places[number];
        if let Some(id) = self.quotes.resolve(chapter, text) {
            self.announce(Note::Use(id));
            self.put(&[b"@text ", text]);
        } else {
            let line = [b"@text ", text].concat();
            self.words.mark_line(&line, &mut self.out);
        }
    }

    fn write_listed(&mut self, number: usize, line: &[u8]) {
        match self.listed.get(&number) {
            None => self.put(&[line]),
            Some(None) => {}
            Some(Some(id)) => self.announce(Note::Define(*id)),
        }
    }
}
// Run rustindex as a command
/// Marks in a stream what a Rust program defines and uses.
pub fn index(stream: &[u8]) -> (Vec<u8>, Vec<Diagnostic>) {
    let mut notes = Notes::new(stream);
    let program = Program::read(&mut notes);
    let names = program.note(&mut notes);
    let quotes = Quotes::new(&names, &program, &notes);
    let listed = reconcile(&notes, &quotes);
    let words: Vec<&[u8]> = notes.words(&listed).collect();
    let out = declarations(&names, &quotes, &words).into_bytes();
    let mut writer = Writer {
        notes: &notes,
        quotes: &quotes,
        words: Recogniser::new(words.into_iter()),
        listed,
        out,
        code: false,
        quote: false,
        root: None,
    };
    writer.write();
    (writer.out, notes.faults)
}
/// The stage `rustindex`, a filter over the stream.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    if let Some(arg) = args.first() {
        let what = format!("unknown argument {}", arg.display());
        return Outcome::failure("rustindex", 2, &what).deliver(streams);
    }
    stream::filter(streams, |input| {
        if let Some(fatal) = stream::fatal(input) {
            let text = [fatal, b"\n"].concat();
            return Outcome { text, status: 1, ..Outcome::default() };
        }
        let (text, faults) = index(input);
        let messages = faults.iter().map(Diagnostic::to_string);
        let messages = messages.collect::<String>().into_bytes();
        Outcome { text, messages, status: 0 }
    })
}
