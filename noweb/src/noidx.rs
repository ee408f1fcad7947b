// Tangled from noweb/chapters/weave.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The stage `noidx`: resolves the cross-references of a stream.
//!
//! The first pass gives labels to definitions and uses and collects them;
//! the second writes the stream with the references resolved. Both see
//! all the files given, so that references cross from file to file.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::ffi::OsString;
use std::mem::{replace, take};

use crate::Streams;
use crate::diagnostic::shown;
use crate::stream::{self, Codes, Mark, Outcome, base62, put};

/// Labels of chunks, and whether they define it.
#[derive(Default)]
struct Item(Vec<(String, bool)>);

impl Item {
    fn mention(&mut self, label: &str, defined: bool) {
        let mention = (label.to_string(), defined);
        if self.0.last() != Some(&mention) {
            self.0.push(mention);
        }
    }

    fn labels(&self, defined: bool) -> Vec<&str> {
        let wanted = self.0.iter().filter(|(_, d)| *d == defined);
        wanted.map(|(label, _)| &label[..]).collect()
    }

    /// The label of the first definition.
    fn anchor(&self) -> Option<&str> {
        self.labels(true).first().copied()
    }

    /// The mentions, perhaps without the uses in chunks that define it.
    fn mentions(&self, pure: bool) -> Vec<(String, bool)> {
        let places = if pure { self.labels(true) } else { Vec::new() };
        let mut all = self.0.clone();
        all.retain(|(at, defined)| *defined || !places.contains(&&at[..]));
        all.dedup();
        all
    }
}

#[derive(Default)]
struct Findings<'a> {
    chunks: HashMap<&'a [u8], Item>,
    identifiers: HashMap<&'a [u8], Item>,
    shown: HashMap<&'a [u8], &'a [u8]>,
    targets: HashMap<&'a [u8], String>,
}

#[derive(Default)]
struct Collector<'a> {
    web: Findings<'a>,
    lines: Vec<Cow<'a, [u8]>>,
    codes: Codes,
    file: String,
    /// How often each file has defined each chunk.
    defined: HashMap<String, u64>,
    prose_labels: u64,
    code: bool,
    label: String,
    /// Where references to the current chunk lead.
    anchor: Option<String>,
    uses: u64,
}

impl<'a> Collector<'a> {
    fn read(&mut self, line: &'a [u8]) {
        let Some(mark) = Mark::read(line) else { return };
        let (name, inner) = (mark.text(), mark.inner());
        match (mark.keyword, inner.keyword) {
            // Note the effect of a mark
            (b"file", _) => self.file = self.codes.of(name),
            (b"begin", kind) => self.code = kind == b"code",
            (b"end", _) => self.anchor = None,
            (b"defn", _) => self.define(name),
            (b"use", _) if self.code => self.use_chunk(name),
            // Note a mention of an identifier
            (b"index", b"defn" | b"localdefn") => {
                self.define_identifier(inner.text());
            }
            (b"index", b"use") => {
                let item =
                    self.web.identifiers.entry(inner.text()).or_default();
                if let Some(anchor) = &self.anchor {
                    item.mention(anchor, false);
                }
            }
            // Note a mark of the index of Rust
            (b"index", b"name") => {
                let name = inner.inner();
                self.web.shown.insert(name.keyword, name.text());
            }
            (b"index", b"anchor") => {
                if let Some(anchor) = &self.anchor {
                    let targets = &mut self.web.targets;
                    targets.entry(inner.text()).or_insert(anchor.clone());
                }
            }
            _ => {}
        }
        self.lines.push(line.into());
    }

    fn define(&mut self, name: &'a [u8]) {
        let place = format!("{}-{}", self.file, self.codes.of(name));
        let times = self.defined.entry(place.clone()).or_default();
        *times += 1;
        self.label = format!("NW{place}-{}", base62(*times));
        self.uses = 0;
        self.insert(format!("@xref label {}", self.label));
        let anchor = self.anchor.get_or_insert_with(|| self.label.clone());
        self.web.chunks.entry(name).or_default().mention(anchor, true);
    }

    fn insert(&mut self, line: String) {
        self.lines.push(line.into_bytes().into());
    }

    fn use_chunk(&mut self, name: &'a [u8]) {
        let item = self.web.chunks.entry(name).or_default();
        let Some(anchor) = &self.anchor else { return };
        item.mention(anchor, false);
        self.uses += 1;
        let label = format!("@xref label {}-u{}", self.label, self.uses);
        self.insert(label);
    }

    fn define_identifier(&mut self, name: &'a [u8]) {
        let label = match &self.anchor {
            Some(anchor) => anchor.clone(),
            None => {
                self.prose_labels += 1;
                let number = base62(self.prose_labels);
                let label = format!("NWD{}-{number}", self.file);
                self.insert(format!("@xref label {label}"));
                label
            }
        };
        self.insert(format!("@xref ref {label}"));
        let item = self.web.identifiers.entry(name).or_default();
        item.mention(&label, true);
    }
}

struct Resolver<'a> {
    web: &'a Findings<'a>,
    out: Vec<u8>,
    written: HashMap<&'a [u8], usize>,
    /// The identifiers that the chunk defines and uses so far.
    names: [HashSet<&'a [u8]>; 2],
    /// Whether the lists of the end were written.
    closed: bool,
    /// The identifiers that the chapter defines and uses so far.
    chapter: [HashSet<&'a [u8]>; 2],
}

impl<'a> Resolver<'a> {
    fn resolve(&mut self, line: &'a [u8]) {
        let Some(mark) = Mark::read(line) else { return };
        let (web, name, inner) = (self.web, mark.text(), mark.inner());
        match (mark.keyword, inner.keyword) {
            (b"defn", _) => return self.define(name, line),
            (b"end", kind) => self.end(kind),
            (b"use", _) => self.refer(anchor(web.chunks.get(name))),
            (b"trailer", _) => self.list_all_names(),
            // Resolve the marks of the index
            (b"index", b"defn" | b"localdefn") => {
                self.names[0].insert(inner.text());
            }
            (b"index", b"use") => {
                self.names[1].insert(inner.text());
                let item = web.identifiers.get(inner.text());
                if let Some(label) = item.and_then(Item::anchor) {
                    self.refer(label.as_bytes());
                }
            }
            // Resolve a mark of the index of Rust
            (b"index", b"link") => {
                if let Some(label) = web.targets.get(inner.text()) {
                    self.refer(label.as_bytes());
                }
            }
            (b"index", b"mini") => return self.list_chapter(),
            _ => {}
        }
        self.copy(line);
    }

    fn copy(&mut self, line: &[u8]) {
        self.put(&[line]);
    }

    fn put(&mut self, parts: &[&[u8]]) {
        put(&mut self.out, parts);
    }

    fn refer(&mut self, label: &[u8]) {
        self.put(&[b"@xref ref ", label]);
    }

    fn define(&mut self, name: &'a [u8], line: &[u8]) {
        let Some(item) = self.web.chunks.get(name) else { return };
        self.refer(anchor(Some(item)));
        self.copy(line);
        let (labels, uses) = (item.labels(true), item.labels(false));
        let earlier = self.written.entry(name).or_default();
        let here = *earlier;
        *earlier += 1;
        // Point to the neighbouring definitions
        let previous = here.checked_sub(1).and_then(|n| labels.get(n));
        if let Some(label) = previous {
            self.put(&[b"@xref prevdef ", label.as_bytes()]);
        }
        if let Some(label) = labels.get(here + 1) {
            self.put(&[b"@xref nextdef ", label.as_bytes()]);
        }
        // Show where the chunk is continued and used
        if here == 0 {
            self.list("defs", "defitem", labels.get(1..).unwrap_or(&[]));
            self.list("uses", "useitem", &uses);
            if uses.is_empty() {
                self.put(&[b"@xref notused ", name]);
            }
        }
    }

    fn list(&mut self, kind: &str, item: &str, labels: &[&str]) {
        if labels.is_empty() {
            return;
        }
        self.put(&[b"@xref begin", kind.as_bytes()]);
        for label in labels {
            let parts = ["@xref ", item, " ", label].map(str::as_bytes);
            self.put(&parts);
        }
        self.put(&[b"@xref end", kind.as_bytes()]);
    }

    fn end(&mut self, kind: &[u8]) {
        let [defined, used] = take(&mut self.names);
        if kind == b"code" {
            let used = &used - &defined;
            // Add the names for the end of the chapter
            self.chapter[0].extend(&defined);
            self.chapter[1].extend(&used);
            self.list_names("def", defined, "isused");
            self.list_names("use", used, "isdefined");
        }
    }

    fn list_names(
        &mut self,
        kind: &str,
        names: HashSet<&'a [u8]>,
        place: &str,
    ) {
        if names.is_empty() {
            return;
        }
        self.put(&[b"@index begin", kind.as_bytes(), b"s"]);
        for name in self.web.sorted(names) {
            let item = self.web.identifiers.get(name);
            let labels = item.map(|item| item.labels(kind == "use"));
            for label in labels.unwrap_or_default() {
                self.copy(format!("@index {place} {label}").as_bytes());
            }
            self.put(&[b"@index ", kind.as_bytes(), b"item ", name]);
        }
        self.put(&[b"@index end", kind.as_bytes(), b"s"]);
    }

    fn list_chapter(&mut self) {
        let [defined, used] = take(&mut self.chapter);
        let mut listed = Vec::new();
        for name in self.web.sorted(&used - &defined) {
            let item = self.web.identifiers.get(name);
            let label = item.and_then(Item::anchor);
            listed.extend(label.map(|label| (name, label)));
        }
        if listed.is_empty() {
            return;
        }
        self.copy(b"@index beginmini");
        for (name, label) in listed {
            self.put(&[b"@index miniitem ", label.as_bytes(), b" ", name]);
        }
        self.copy(b"@index endmini");
    }

    fn list_all_names(&mut self) {
        if !replace(&mut self.closed, true) {
            self.put(&[b"@nl\n@nl"]);
            let web = self.web;
            self.list_items("@xref", ["chunks", "chunk"], &web.chunks);
            self.list_items("@index", ["index", "entry"], &web.identifiers);
        }
    }

    fn list_items(
        &mut self,
        family: &str,
        [list, entry]: [&str; 2],
        items: &'a HashMap<&'a [u8], Item>,
    ) {
        self.copy(format!("{family} begin{list}").as_bytes());
        for name in self.web.sorted(items.keys().copied().collect()) {
            // List one item with its mentions
            let (item, entry) = (&items[name], format!("{family} {entry}"));
            let label = anchor(Some(item));
            self.put(&[entry.as_bytes(), b"begin ", label, b" ", name]);
            for (label, defined) in item.mentions(list == "index") {
                let kind = if defined { "defn" } else { "use" };
                self.copy(format!("{entry}{kind} {label}").as_bytes());
            }
            self.put(&[entry.as_bytes(), b"end"]);
        }
        self.copy(format!("{family} end{list}").as_bytes());
    }
}

fn anchor(item: Option<&Item>) -> &[u8] {
    item.and_then(Item::anchor).unwrap_or("nw@notdef").as_bytes()
}

impl<'a> Findings<'a> {
    fn sorted(&self, names: HashSet<&'a [u8]>) -> Vec<&'a [u8]> {
        let mut names: Vec<_> = names.into_iter().collect();
        names.sort_by_cached_key(|name| {
            let shown = self.shown.get(name).unwrap_or(name);
            let key = if shown == name { b"" } else { *name };
            [&shown.to_ascii_lowercase(), &b"\n"[..], shown, key].concat()
        });
        names
    }
}

/// Resolves the cross-references of a stream.
pub fn cross_reference(stream: &[u8], delay: bool) -> Outcome {
    let file = "standard input?".to_string();
    let mut collector = Collector { file, ..Collector::default() };
    let lines = stream::trimmed_lines(stream);
    lines.for_each(|line| collector.read(line));
    let Collector { web, lines, .. } = collector;
    let mut resolver = Resolver {
        web: &web,
        out: Vec::new(),
        written: HashMap::new(),
        names: <[_; 2]>::default(),
        closed: false,
        // Begin with no names of a chapter
        chapter: <[_; 2]>::default(),
    };
    // Write until the stream is broken
    let last = lines.iter().rposition(|line| line.starts_with(b"@begin "));
    for (number, line) in lines.iter().enumerate() {
        if delay && Some(number) == last {
            resolver.list_all_names();
        }
        resolver.resolve(line);
        if line.starts_with(b"@fatal") {
            let text = resolver.out;
            return Outcome { text, status: 1, ..Outcome::default() };
        }
    }
    resolver.list_all_names();
    Outcome::done(resolver.out)
}

/// `noidx [-delay]`, a filter over the stream.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    if let Some(arg) = args.iter().find(|arg| *arg != "-delay") {
        let what = format!("unknown argument \"{}\"", shown(arg));
        return Outcome::failure("noidx", 1, &what).deliver(streams);
    }
    let delay = !args.is_empty();
    stream::filter(streams, |input| cross_reference(input, delay))
}
