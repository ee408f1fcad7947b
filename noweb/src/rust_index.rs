// Tangled from noweb/chapters/rust_index.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The stage `rustindex`: finds a Rust program's definitions and uses.
//!
//! It replaces `finduses`. The program is tangled out of the stream, and
//! its items are traced back to the lines of the stream: a place in this
//! module is the number of a line and a byte of its text.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::ffi::{OsStr, OsString};
use std::ops::Range;
use std::os::unix::ffi::OsStrExt;

use crate::Streams;
use crate::diagnostic::{
    Diagnostic, Faults, Level, Place, Source, bytes_of, shown, text_of,
};
use crate::finduses::{Recogniser, declared};
use crate::markup::{parse_token, position_after};
use crate::rust_names::{File, Kind, Names, Token, is_keyword, tokens};
use crate::rust_uses::uses;
use crate::stream::{self, Mark, Outcome};
use crate::tangle::{Segment, tangle};
use crate::web::Web;

/// The text of a file, and the lines of the stream that it is made of.
struct Text {
    source: String,
    /// The bytes that come from each line.
    parts: Vec<(Range<usize>, usize)>,
}

impl Text {
    /// The text of a root; none if it cannot be tangled.
    fn new(web: &Web, name: &[u8], lines: &[&[u8]]) -> Option<Self> {
        let tangled = tangle(web, web.find(name)?, false).ok()?;
        let text = Source::new(Vec::new(), tangled.text);
        let part = |segment: &Segment| {
            let line = segment.place.line as usize;
            let length = lines[line].strip_prefix(b"@text ")?.len();
            let start = text.start(segment.line)?;
            let start = start + segment.column as usize - 1;
            Some((start..start + length, line))
        };
        let parts = tangled.map.iter().filter_map(part).collect();
        Some(Self { source: String::from_utf8(text.text).ok()?, parts })
    }

    /// The lines of the stream that a range of bytes comes from, and which
    /// bytes of their texts.
    fn places(&self, range: &Range<usize>) -> Vec<(usize, Range<usize>)> {
        let first =
            self.parts.partition_point(|(r, _)| r.end <= range.start);
        let parts = self.parts[first..].iter();
        let parts = parts.take_while(|(part, _)| part.start < range.end);
        let cut = |(part, line): &(Range<usize>, usize)| {
            let start = range.start.max(part.start) - part.start;
            (*line, start..range.end.min(part.end) - part.start)
        };
        parts.map(cut).collect()
    }
}

/// The web of a stream; the line of a place is that of the stream.
fn web(lines: &[&[u8]]) -> Web {
    let lexemes = lines.iter().zip(0..).filter_map(|(text, line)| {
        let (token, text) = parse_token(text)?;
        Some((token, text.to_vec(), Place { file: 0, line, column: 1 }))
    });
    Web::from_lexemes(lexemes.collect())
}
/// The kind of each word and each comment of a file; `items` holds the
/// words that are items, by the numbers of their tokens.
fn words<'n>(
    source: &str,
    tokens: &[Token],
    items: &HashMap<usize, Note<'n>>,
) -> Vec<(Range<usize>, Note<'n>)> {
    let (mut notes, mut done) = (Vec::new(), 0);
    for (number, token) in tokens.iter().enumerate() {
        notes.push((done..token.range.start, Note::Comment));
        done = token.range.end;
        let text = token.text;
        // Classify the token
        let note = match items.get(&number) {
            _ if text.starts_with("//") => Note::Comment,
            _ if text.starts_with("/*") => Note::Comment,
            _ if token.word && is_keyword(text) => Note::Keyword,
            Some(note) => *note,
            None if token.word => Note::Free,
            None => continue,
        };
        notes.push((token.range.clone(), note));
    }
    notes.push((done..source.len(), Note::Comment));
    notes
}
/// The kind of a part of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Note<'n> {
    Keyword,
    Comment,
    Define(&'n str),
    Use(&'n str),
    /// A word that is no item of ours, or not in all files it goes to.
    Free,
}

#[derive(Default)]
struct Notes<'s, 'n> {
    lines: &'s [&'s [u8]],
    /// By line and first byte: the end and the note.
    notes: BTreeMap<(usize, usize), (usize, Note<'n>)>,
    /// The lines of the stream that are known to be Rust.
    rust: HashSet<usize>,
}

impl<'n> Notes<'_, 'n> {
    /// Notes what a range of a file is. A word must lie on one line.
    fn add(&mut self, text: &Text, range: &Range<usize>, note: Note<'n>) {
        let places = text.places(range);
        if note != Note::Comment && places.len() != 1 {
            return;
        }
        for (line, range) in places {
            // Leave out white space at the ends
            let bytes = &self.lines[line][b"@text ".len()..][range.clone()];
            let start = range.end - bytes.trim_ascii_start().len();
            let end = range.start + bytes.trim_ascii_end().len();
            if start < end {
                let old =
                    self.notes.entry((line, start)).or_insert((end, note));
                if *old != (end, note) {
                    *old = (end, Note::Free);
                }
            }
        }
    }
}
fn sources(web: &Web, lines: &[&[u8]]) -> Vec<(String, Text)> {
    let names = web.chunks.iter().map(|chunk| &chunk.name[..]);
    let roots = names.filter(|name| {
        name.ends_with(b".rs") && !web.uses.contains_key(*name)
    });
    let file = |name| Some((text_of(name), Text::new(web, name, lines)?));
    roots.filter_map(file).collect()
}

impl<'n> Notes<'_, 'n> {
    fn add_program(&mut self, names: &'n Names, texts: &[&Text]) {
        let mut found = vec![HashMap::new(); texts.len()];
        for ((file, token), (path, _)) in uses(names) {
            found[file].insert(token, Note::Use(path));
        }
        for ((file, token), path, _) in &names.sites {
            let is_file = names.modules.values().any(|file| file == path);
            let note =
                if is_file { Note::Use(path) } else { Note::Define(path) };
            found[*file].insert(*token, note);
        }
        // Note each word on its line
        let files = texts.iter().zip(names.files).zip(found);
        for ((text, file), found) in files {
            self.rust.extend(text.parts.iter().map(|(_, line)| line));
            let source = &text.source;
            for (range, note) in words(source, &file.tokens, &found) {
                self.add(text, &range, note);
            }
        }
    }
}

/// The name of the library whose root is this file, if it is one: the
/// name in its manifest, or else the name of its directory.
fn library(path: &str) -> Option<String> {
    let dir = path.strip_suffix("src/lib.rs")?;
    let manifest = bytes_of(&format!("{dir}Cargo.toml"));
    let manifest = std::fs::read(OsStr::from_bytes(&manifest));
    let manifest = text_of(&manifest.unwrap_or_default());
    let package = manifest.lines().skip_while(|l| *l != "[package]");
    let mut names = package.filter_map(|l| l.strip_prefix("name = "));
    let name = names.next().map(|name| name.trim().trim_matches('"'));
    let name = name.or(dir.trim_end_matches('/').rsplit('/').next())?;
    Some(name.replace('-', "_"))
}
#[derive(Default)]
struct Index<'n> {
    /// Those that are listed. Modules and variants are linked only: they
    /// would fill the lists with what the reader sees anyhow.
    listed: HashSet<&'n str>,
    items: BTreeMap<&'n str, Vec<&'n str>>,
    /// The words that are no items in some place.
    free: HashSet<&'n [u8]>,
}

impl<'n> Index<'n> {
    fn new(names: &'n Names, notes: &'n Notes<'_, 'n>) -> Self {
        let mut index = Self::default();
        for ((line, start), (end, note)) in &notes.notes {
            let text = &notes.lines[*line][b"@text ".len()..];
            match note {
                Note::Define(path) => index.add(path),
                Note::Free => drop(index.free.insert(&text[*start..*end])),
                _ => {}
            }
        }
        names.modules.values().for_each(|path| index.add(path));
        let unlisted = [Kind::Module, Kind::Variant];
        let sites = names.sites.iter();
        let listed = sites.filter(|(_, _, kind)| !unlisted.contains(kind));
        index.listed = listed.map(|(_, path, _)| &path[..]).collect();
        index
    }

    fn add(&mut self, path: &'n str) {
        self.items.entry(last(path)).or_default().push(path);
    }

    /// The marks with the text that is shown for each key: the name, and
    /// its type or module where two items have the same name.
    fn declarations(&self) -> String {
        let mut lines = BTreeSet::new();
        for (name, paths) in &self.items {
            let listed = |path: &&&str| self.listed.contains(**path);
            let paths: Vec<_> = paths.iter().filter(listed).collect();
            for path in &paths {
                let (owner, _) = path.rsplit_once("::").unwrap_or_default();
                let owner = owner.rsplit(['/', ':']).next();
                let of = match paths.iter().all(|other| other == path) {
                    true => String::new(),
                    false => format!(" ({})", owner.unwrap_or_default()),
                };
                lines.insert(format!("@index name {path} {name}{of}\n"));
            }
        }
        lines.into_iter().collect()
    }

    fn has(&self, name: &[u8]) -> bool {
        std::str::from_utf8(name).is_ok_and(|n| self.items.contains_key(n))
    }

    /// The item that quoted code means, if that is certain: no other item
    /// has a path that ends so, and no word in it means anything else.
    fn quoted(&self, code: &[u8]) -> Option<&'n str> {
        let code = std::str::from_utf8(code).ok()?;
        let code = code.trim_end_matches("()");
        let mut path = code.split("::");
        if path.any(|name| self.free.contains(name.as_bytes())) {
            return None;
        }
        let end = format!("::{code}");
        let items = self.items.get(last(code))?.iter();
        let mut items = items.filter(|path| path.ends_with(&end));
        let first = items.next();
        first.filter(|_| items.next().is_none()).copied()
    }
}

fn last(path: &str) -> &str {
    path.rsplit("::").next().unwrap_or(path)
}
/// The outgoing stream, and the state in the incoming one.
struct Writer<'w> {
    notes: &'w Notes<'w, 'w>,
    index: &'w Index<'w>,
    /// The modules that are files, by their paths.
    files: HashMap<Vec<u8>, &'w str>,
    /// The words that only `%def` lists.
    words: Recogniser,
    out: Vec<u8>,
    code: bool,
    quote: bool,
    /// The module of the file whose root chunk begins.
    root: Option<&'w str>,
}

impl<'w> Writer<'w> {
    fn put(&mut self, parts: &[&[u8]]) {
        stream::put(&mut self.out, parts);
    }

    fn write_line(&mut self, number: usize, line: &[u8]) {
        let Some(mark) = Mark::read(line) else {
            return self.put(&[line]);
        };
        let (text, inner) = (mark.text(), mark.inner());
        let is_item =
            inner.keyword == b"defn" && self.index.has(inner.text());
        match mark.keyword {
            b"begin" => self.code = inner.keyword == b"code",
            b"quote" => self.quote = true,
            b"endquote" => self.quote = false,
            b"file" if number > 0 => self.put(&[b"@index mini"]),
            b"defn" => self.root = self.files.get(text).copied(),
            b"text" if self.code => return self.write_code(number, text),
            b"text" if self.quote => return self.write_quoted(line, text),
            b"index" if is_item => return,
            _ => {}
        }
        self.put(&[line]);
        if mark.keyword == b"nl"
            && let Some(id) = self.root.take()
        {
            self.announce(Note::Define(id));
        }
    }

    fn write_code(&mut self, number: usize, text: &[u8]) {
        let notes = self.notes;
        let here = notes.notes.range((number, 0)..(number + 1, 0));
        let mut done = 0;
        for ((_, start), (end, note)) in here {
            if *note != Note::Free && *start >= done {
                if done < *start {
                    self.write_plain(number, &text[done..*start]);
                }
                self.announce(*note);
                self.put(&[b"@text ", &text[*start..*end]]);
                done = *end;
            }
        }
        if done == 0 || done < text.len() {
            self.write_plain(number, &text[done..]);
        }
    }

    /// Writes text without notes; looks for words in code that is no Rust.
    fn write_plain(&mut self, number: usize, text: &[u8]) {
        let line = [b"@text ", text].concat();
        if self.notes.rust.contains(&number) || text.is_empty() {
            self.put(&[&line]);
        } else {
            self.words.mark_line(&line, &mut self.out);
        }
    }

    fn write_quoted(&mut self, line: &[u8], text: &[u8]) {
        if let Some(id) = self.index.quoted(text) {
            self.announce(Note::Use(id));
            self.put(&[line]);
        } else {
            self.words.mark_line(line, &mut self.out);
        }
    }

    fn announce(&mut self, note: Note<'w>) {
        let (path, marks) = match note {
            Note::Keyword => return self.put(&[b"@style keyword"]),
            Note::Comment => return self.put(&[b"@style comment"]),
            Note::Free => return,
            Note::Define(path) => (path, ["anchor", "defn"]),
            Note::Use(path) => (path, ["link", "use"]),
        };
        let mark = marks[usize::from(self.index.listed.contains(path))];
        let items = self.index.items.get(last(path));
        if items.is_some_and(|paths| paths.contains(&path)) {
            self.put(&[&bytes_of(&format!("@index {mark} {path}"))]);
        }
    }
}
/// Marks the definitions and uses of a Rust program in a stream.
pub fn index(stream: &[u8]) -> (Vec<u8>, Faults) {
    let lines: Vec<&[u8]> = stream::lines(stream).collect();
    let mut notes = Notes { lines: &lines, ..Notes::default() };
    let (mut texts, mut files) = (Vec::new(), Vec::new());
    let mut faults = Faults::new();
    let sources = sources(&web(&lines), &lines);
    // Cut the sources into tokens
    for (path, text) in &sources {
        match tokens(&text.source) {
            Ok(tokens) => {
                files.push(File { path: path.clone(), tokens });
                texts.push(text);
            }
            Err(error) => {
                // Report a source that is no Rust
                let at = error.span().byte_range().start;
                let places = text.places(&(at..at + 1));
                let line = places.first().map_or(0, |(line, _)| *line);
                let position = position_after(&lines[..line]);
                let what = format!("{path} is no Rust: {error}");
                let help =
                    "its identifiers are those of the %def lines alone";
                let fault = Diagnostic::new(Level::Warning, position, what);
                faults.push(fault.with_help(help));
            }
        }
    }
    let names = Names::new(&files, library);
    notes.add_program(&names, &texts);
    let index = Index::new(&names, &notes);
    // Make a writer for the stream
    let modules = names.modules.iter();
    let modules =
        modules.map(|(n, module)| (bytes_of(&files[*n].path), &module[..]));
    let listed = declared(stream).filter(|word| !index.has(word));
    let mut writer = Writer {
        notes: &notes,
        index: &index,
        files: modules.collect(),
        words: Recogniser::new(listed),
        out: bytes_of(&index.declarations()),
        code: false,
        quote: false,
        root: None,
    };
    for (number, line) in lines.iter().enumerate() {
        writer.write_line(number, line);
    }
    writer.put(&[b"@index mini"]);
    (writer.out, faults)
}

/// The stage `rustindex`, a filter over the stream.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    if let Some(arg) = args.first() {
        let what = format!("unknown argument {}", shown(arg));
        return Outcome::failure("rustindex", 2, &what).deliver(streams);
    }
    stream::filter(streams, |input| {
        // Pass on that the stream is broken
        if let Some(broken) = stream::broken(input) {
            return broken;
        }
        let (text, faults) = index(input);
        let messages = faults.iter().map(Diagnostic::to_string);
        let messages = bytes_of(&messages.collect::<String>());
        Outcome { text, messages, status: 0 }
    })
}
