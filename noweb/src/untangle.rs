// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Edits of tangled files, carried back to the chapters.
//!
//! An edit is carried if it can be read in one way only. Otherwise, or if
//! tangling the new chapters would not give the edited files again,
//! nothing is written. Lines of lists count from 0, as indices, and lines
//! of files from 1.

// Import what carrying edits needs
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::ffi::OsString;
use std::fs;
use std::hash::Hash;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use similar::{Algorithm, DiffTag, capture_diff_slices, diff_ratio};

use crate::Streams;
use crate::cpif::{Attributes, replace, update};
use crate::diagnostic::{Diagnostic, Level, Place, Position, Source};
use crate::markup::{Kind, Token, mark_up, unmark};
use crate::project::{
    Expansion, Plan, Project, failure, hash, parse_arguments, tab_stops,
};
use crate::tangle::{Segment, Tangled};
use crate::web::Web;

// Keep and find what was tangled last
impl Project {
    // Find a base that was kept
    fn bases(&self) -> PathBuf {
        let mut name = self.record.clone().into_os_string();
        name.push(".base");
        self.dir.join(name)
    }

    /// The text of a file that was tangled last, if it is to be had.
    fn base(&self, path: &Path, wanted: u64) -> Option<Vec<u8>> {
        let kept = fs::read(self.bases().join(base_name(&wanted))).ok();
        let committed = ["", "HEAD"].into_iter();
        let committed = committed.filter_map(|v| self.committed(v, path));
        kept.into_iter().chain(committed).find(|t| hash(t) == wanted)
    }

    fn committed(&self, version: &str, path: &Path) -> Option<Vec<u8>> {
        let mut object = OsString::from(format!("{version}:./"));
        object.push(path);
        let mut git = Command::new("git");
        git.args(["cat-file", "blob"]).arg(object);
        git.current_dir(self.dir.join("."));
        git.stdin(Stdio::null()).stderr(Stdio::null());
        let shown = git.output().ok()?;
        shown.status.success().then_some(shown.stdout)
    }

    /// Keeps the tangled texts that the record speaks of, and no others.
    ///
    /// # Errors
    ///
    /// The directory cannot be written.
    pub fn keep(&self, plan: &Plan) -> Result<(), Diagnostic> {
        let dir = self.bases();
        let failed = |error| failure("write", &dir, &error);
        let entries = fs::read_dir(&dir).into_iter().flatten().flatten();
        let kept: BTreeSet<_> = entries.map(|e| e.file_name()).collect();
        // Make the directory and hide it from git
        fs::create_dir_all(&dir).map_err(failed)?;
        if !kept.contains(&OsString::from(".gitignore")) {
            let ignore = dir.join(".gitignore");
            update(&ignore, b"*\n").map_err(failed)?;
        }
        // Add the new texts and remove the old ones
        let wanted: BTreeSet<_> =
            plan.record.values().map(base_name).collect();
        for output in &plan.outputs {
            let name = plan.record.get(&output.path).map(base_name);
            let Some(name) = name.filter(|name| !kept.contains(name))
            else {
                continue;
            };
            let text = &output.tangled.text;
            update(&dir.join(name), text).map_err(failed)?;
        }
        for name in kept.difference(&wanted).filter(|n| *n != ".gitignore")
        {
            let _ = fs::remove_file(dir.join(name));
        }
        Ok(())
    }
}

fn base_name(hash: &u64) -> OsString {
    format!("{hash:016x}").into()
}

// Find where two lists differ
/// What stands in an old list, and what stands there in the new one.
type Hunk = (Range<usize>, Range<usize>);

/// The hunks in which two lists differ, in order.
fn hunks<T: Hash + Eq + Ord>(old: &[T], new: &[T]) -> Vec<Hunk> {
    let steps = capture_diff_slices(Algorithm::Myers, old, new);
    let changed = steps.iter().filter(|s| s.tag() != DiffTag::Equal);
    changed.map(|step| (step.old_range(), step.new_range())).collect()
}

/// The lines of a text, without their newlines.
fn lines_of(text: &[u8]) -> Vec<&[u8]> {
    let text = text.strip_suffix(b"\n").unwrap_or(text);
    text.split(|b| *b == b'\n').collect()
}

/// Joins insertions and removals of as many lines that can touch.
fn join(all: Vec<Hunk>, old: &[&[u8]], new: &[&[u8]]) -> Vec<Hunk> {
    let mut joined: Vec<Hunk> = Vec::new();
    for (c, d) in all {
        let Some((a, b)) = joined.pop() else {
            joined.push((c, d));
            continue;
        };
        let gap = c.start - a.end;
        // See which of two hunks can slide to the other
        let paired = a.is_empty() && d.is_empty() && b.len() == c.len()
            || b.is_empty() && c.is_empty() && a.len() == d.len();
        let up = |text: &[&[u8]], r: &Range<usize>| {
            text[r.start - gap..r.start] == text[r.end - gap..r.end]
        };
        let down = |text: &[&[u8]], r: &Range<usize>| {
            text[r.start..r.start + gap] == text[r.end..r.end + gap]
        };
        let rises = paired
            && (d.is_empty() && up(old, &c) || c.is_empty() && up(new, &d));
        let sinks = paired
            && (b.is_empty() && down(old, &a)
                || a.is_empty() && down(new, &b));
        joined.extend(if rises {
            vec![(a.start..c.end - gap, b.start..d.end - gap)]
        } else if sinks {
            vec![(a.start + gap..c.end, b.start + gap..d.end)]
        } else {
            vec![(a, b), (c, d)]
        });
    }
    joined
}

/// The words of a line: identifiers and numbers, and single other bytes.
fn words(line: &[u8]) -> Vec<&[u8]> {
    let letter =
        |b: &u8| b.is_ascii_alphanumeric() || *b == b'_' || !b.is_ascii();
    line.chunk_by(|a, b| letter(a) && letter(b)).collect()
}

/// How similar two lines are, from 0 to 1, apart from indentation.
fn similarity(a: &[u8], b: &[u8]) -> f32 {
    let (a, b) = (words(a.trim_ascii()), words(b.trim_ascii()));
    let steps = capture_diff_slices(Algorithm::Myers, &a, &b);
    diff_ratio(&steps, a.len(), b.len())
}

// Merge the edits with the chapters' changes
/// What tangling a file must give when the edits are home.
#[derive(Clone, Debug)]
struct Target {
    path: PathBuf,
    /// The lines.
    lines: Vec<Vec<u8>>,
    /// For each line the line of the file on the disk, from 1.
    at: Vec<u32>,
}

/// Merges two sets of changes; gives the lines, each with the index of a
/// line of `mine`, or the index of a line of `mine` where they conflict.
fn merge<'a>(
    base: &[&[u8]],
    mine: &[&'a [u8]],
    theirs: &[&'a [u8]],
) -> Result<Vec<(&'a [u8], usize)>, usize> {
    // Put the hunks of both in order
    let edits = hunks(base, mine).into_iter().map(|h| (h, mine, true));
    let others = hunks(base, theirs).into_iter();
    let others = others.map(|h| (h, theirs, false));
    let mut all: Vec<_> = edits.chain(others).collect();
    all.sort_by_key(|((old, _), _, edit)| (old.start, old.end, !edit));
    let mut merged = Vec::new();
    let (mut done, mut here) = (0, 0);
    let mut last: Option<(Hunk, &[&[u8]], bool)> = None;
    for ((old, new), text, edit) in all {
        // Merge one hunk into what is there
        // Stop where two hunks contradict each other
        if let Some(((before, now), other, kind)) = &last
            && *kind != edit
            && old.start <= before.end
        {
            if *before != old || other[now.clone()] != text[new.clone()] {
                return Err(if edit { new.start } else { now.start });
            }
            continue;
        }
        let same = here..here + (old.start - done);
        merged.extend(same.clone().map(|at| (mine[at], at)));
        here = same.end;
        merged.extend(
            new.clone().map(|i| (text[i], if edit { i } else { here })),
        );
        here = if edit { new.end } else { here + old.len() };
        done = old.end;
        last = Some(((old, new), text, edit));
    }
    let rest = mine[here..].iter().zip(here..);
    merged.extend(rest.map(|(line, at)| (*line, at)));
    Ok(merged)
}

impl Project {
    // Find the targets of all edited files
    fn targets(
        &self,
        now: &Expansion,
    ) -> Result<Vec<Target>, Vec<Diagnostic>> {
        let record = self.read_record();
        let (mut targets, mut faults) = (Vec::new(), Vec::new());
        for (path, tangled) in &now.files {
            // Pass over what nobody has edited
            let Ok(disk) = fs::read(self.dir.join(path)) else { continue };
            let recorded = record.get(path).copied();
            if disk.is_empty()
                || disk == tangled.text
                || recorded == Some(hash(&disk))
            {
                continue;
            }
            match self.target(path, tangled, &disk, recorded) {
                Ok(target) => targets.push(target),
                Err(fault) => faults.push(*fault),
            }
        }
        if faults.is_empty() { Ok(targets) } else { Err(faults) }
    }

    fn target(
        &self,
        path: &Path,
        tangled: &Tangled,
        disk: &[u8],
        recorded: Option<u64>,
    ) -> Result<Target, Box<Diagnostic>> {
        let kept;
        let theirs = lines_of(&tangled.text);
        // Find the text that was tangled last
        let base = if recorded == Some(hash(&tangled.text)) {
            theirs.clone()
        } else {
            let found = recorded.and_then(|h| self.base(path, h));
            kept = found.ok_or_else(|| Box::new(baseless(path)))?;
            lines_of(&kept)
        };
        let mine = lines_of(disk);
        let merged = merge(&base, &mine, &theirs);
        let merged = merged.map_err(|at| changed_twice(path, disk, at))?;
        let owned =
            merged.iter().map(|(l, at)| (l.to_vec(), *at as u32 + 1));
        let (lines, at) = owned.unzip();
        Ok(Target { path: path.to_owned(), lines, at })
    }
}

fn baseless(path: &Path) -> Diagnostic {
    let shown = path.display();
    let text = format!("{shown} was edited, and so was a chapter of it");
    let fault = Diagnostic::new(Level::Error, None, text);
    let help = "what was tangled last is neither kept nor in git";
    let fault = fault.with_help(help);
    fault.with_help(format!(
        "make the edits of {shown} in the chapter, and delete it"
    ))
}

fn changed_twice(path: &Path, disk: &[u8], at: usize) -> Diagnostic {
    let name = path.to_string_lossy().into_owned().into_bytes();
    let file = Source::new(name, disk.to_vec());
    let line = at as u32 + 1;
    let position = file.position(Place { file: 0, line, column: 1 });
    let text = "edited here, and differently in the chapter";
    let fault = Diagnostic::new(Level::Error, Some(position), text);
    fault.with_help("make both the same, and untangle again")
}

// Look at a tangled file line by line
/// A line of a chapter, and what tangling indents it by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Spot {
    file: u32,
    line: u32,
    indent: usize,
}

/// A tangled file as the chapters give it.
struct View<'a> {
    sources: &'a [Source],
    tangled: &'a Tangled,
    lines: Vec<&'a [u8]>,
    /// The distance of its tab stops, or 0.
    tab: usize,
}

impl<'a> View<'a> {
    // Find where a line begins and ends
    /// The distance of tab stops for reading chapters: tabs are expanded
    /// unless the file has tabs itself.
    fn read_tab(&self) -> usize {
        if self.tab > 0 { 0 } else { 8 }
    }

    fn segments(&self, line: usize) -> &'a [Segment] {
        let map = &self.tangled.map;
        let from = map.partition_point(|s| (s.line as usize) < line + 1);
        let to = map.partition_point(|s| s.line as usize <= line + 1);
        &map[from..to]
    }

    /// The line of a chapter that a segment comes from.
    fn source_line(&self, segment: &Segment) -> &'a [u8] {
        let source = self.sources.get(segment.place.file as usize);
        source.and_then(|s| s.line(segment.place.line)).unwrap_or(b"")
    }

    /// What follows in the chapter from the start of a segment.
    fn source_of(&self, segment: &Segment) -> &'a [u8] {
        let before = segment.place.column as usize - 1;
        self.source_line(segment).get(before..).unwrap_or(b"")
    }

    fn spot(&self, segment: &Segment) -> Spot {
        let Place { file, line, .. } = segment.place;
        Spot { file, line, indent: segment.indent as usize }
    }

    /// The line of a chapter that begins where this line begins.
    fn head(&self, line: usize) -> Option<Spot> {
        let first = self.segments(line).first()?;
        let escape = self.source_line(first).starts_with(b"@");
        let column = first.place.column;
        let begins = column == 1 || column == 2 && escape;
        begins.then(|| self.spot(first))
    }

    /// The line of a chapter that ends where this line ends.
    fn tail(&self, line: usize) -> Option<Spot> {
        let last = self.segments(line).last()?;
        let text = self.lines[line].get(last.column as usize - 1..)?;
        let ends = self.source_of(last) == text;
        if ends { Some(self.spot(last)) } else { self.whole(line) }
    }

    /// The line of a chapter that this line is the whole text of.
    fn whole(&self, line: usize) -> Option<Spot> {
        let head = self.head(line)?;
        let text = self.outdent(self.lines[line], head.indent)?;
        let first = self.segments(line).first()?;
        let rendered = render(self.source_line(first), self.read_tab())?;
        (rendered == text).then_some(head)
    }

    /// A line without the indentation that tangling adds, if it has that.
    fn outdent<'t>(
        &self,
        line: &'t [u8],
        indent: usize,
    ) -> Option<&'t [u8]> {
        let (mut rest, mut column) = (line, 0);
        // Take off blanks up to the indentation
        while column < indent && !line.is_empty() {
            column = match rest {
                [b' ', ..] => column + 1,
                [b'\t', ..] if self.tab > 0 => (column / 8 + 1) * 8,
                _ => return None,
            };
            rest = &rest[1..];
        }
        (column <= indent).then_some(rest)
    }

    /// Is this the comment with the name of a chunk?
    fn is_name(&self, line: usize) -> bool {
        let Some(last) = self.segments(line).last() else { return false };
        let text = &self.lines[line][last.column as usize - 1..];
        let source = self.source_of(last);
        source.starts_with(b"<<") && !text.starts_with(b"<<")
    }

    /// The first line of a block, if that is what these lines are.
    fn block(&self, lines: Range<usize>) -> Option<Spot> {
        let first = self.whole(lines.start)?;
        let follows = |(line, number): (usize, u32)| {
            self.whole(line) == Some(Spot { line: number, ..first })
        };
        lines.clone().zip(first.line..).all(follows).then_some(first)
    }
}

// Translate a line into the language of chunks
/// What a line of a chunk is tangled to, if there is no use in it.
fn render(line: &[u8], tab: usize) -> Option<Vec<u8>> {
    let mut text = Vec::new();
    for token in lex(line, tab) {
        match token {
            Token::Text(more) | Token::More(more) => text.extend(more),
            Token::Newline | Token::End(Kind::Code, _) => (),
            _ => return None,
        }
    }
    Some(text)
}

/// The tokens of a line of a chunk.
fn lex(line: &[u8], tab: usize) -> Vec<Token> {
    let text = [b"<<*>>=\n", line, b"\n"].concat();
    let source = Source::new(Vec::new(), text);
    let (lexemes, _) = mark_up(&source, 0, tab);
    let inside = lexemes.into_iter().filter(|(_, place)| place.line > 1);
    inside.map(|(token, _)| token).collect()
}

/// The line of a chunk that is tangled to this text, if there is one.
fn quote(text: &[u8], tab: usize) -> Option<Vec<u8>> {
    let right = |line: &Vec<u8>| {
        render(line, tab).is_some_and(|rendered| rendered == text)
    };
    [text.to_vec(), escape(text)].into_iter().find(right)
}

/// A line of a chunk with its escapes.
fn escape(text: &[u8]) -> Vec<u8> {
    let name = Token::Defn(b"*".to_vec());
    let text_token = Token::Text(text.to_vec());
    let begin = Token::Begin(Kind::Code, 1);
    let tokens = [begin, name, Token::Newline, text_token];
    unmark(&tokens).split_off(b"<<*>>=\n".len())
}

/// The uses in a line of a chunk, and how many bytes of text it has.
fn shape(line: &[u8], tab: usize) -> (Vec<Token>, usize) {
    let mut tokens = lex(line, tab);
    let mut size = 0;
    tokens.retain(|token| match token {
        Token::Text(text) | Token::More(text) => {
            size += text.len();
            false
        }
        _ => true,
    });
    (tokens, size)
}

// Carry the edits of one file
/// A change of a chapter.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Splice {
    file: u32,
    /// The bytes that are replaced.
    range: Range<usize>,
    text: Vec<u8>,
    /// The line of the chapter that it changes or adds to.
    line: u32,
    /// The edited file that asks for it, and its line.
    cause: (PathBuf, u32),
    /// How many times the file has had that line of the chapter before.
    turn: usize,
}

/// The edits of one file on their way home.
struct Carrier<'a> {
    view: View<'a>,
    target: &'a Target,
    splices: Vec<Splice>,
    choices: Vec<Choice>,
    faults: Vec<Diagnostic>,
}

impl<'a> Carrier<'a> {
    // Carry one hunk after the other
    fn new(
        now: &'a Expansion,
        tangled: &'a Tangled,
        target: &'a Target,
    ) -> Self {
        let sources = &now.web.sources;
        let lines = lines_of(&tangled.text);
        let tab = tab_stops(&target.path);
        let view = View { sources, tangled, lines, tab };
        let (splices, choices) = (Vec::new(), Vec::new());
        Self { view, target, splices, choices, faults: Vec::new() }
    }

    /// The hunks that are to be carried.
    fn hunks(&self) -> Vec<Hunk> {
        let lines = self.target.lines.iter();
        let new: Vec<&[u8]> = lines.map(|line| &line[..]).collect();
        let all = hunks(&self.view.lines, &new);
        join(all, &self.view.lines, &new)
    }

    fn carry(&mut self) {
        let hunks = self.hunks();
        let mut above = 0;
        for (index, hunk) in hunks.iter().enumerate() {
            let below = hunks.get(index + 1).map(|(old, _)| old.start);
            let below = below.unwrap_or(self.view.lines.len());
            self.carry_hunk(hunk, above..below);
            above = hunk.0.end;
        }
    }

    fn carry_hunk(&mut self, hunk: &Hunk, room: Range<usize>) {
        let (old, new) = hunk;
        if old.is_empty() {
            let slides = self.slides(hunk, &room);
            self.insert(&slides);
        } else if new.is_empty() {
            self.cut(hunk, &room);
        } else if let Some(splices) = self.part(hunk) {
            self.splices.extend(splices);
        } else {
            self.carry_pairs(hunk, &room);
        }
    }

    /// All positions of an insertion or a removal, from the highest.
    fn slides(&self, hunk: &Hunk, room: &Range<usize>) -> Vec<Hunk> {
        let lines = &self.view.lines;
        let line = |hunk: &Hunk, from_start: usize| match hunk.1.len() {
            0 => lines[hunk.0.start + from_start],
            _ => &self.target.lines[hunk.1.start + from_start],
        };
        // Turn what has moved by one line
        let moved = |r: &Range<usize>, by: isize| {
            r.start.wrapping_add_signed(by)..r.end.wrapping_add_signed(by)
        };
        let shift = |h: &Hunk, by| (moved(&h.0, by), moved(&h.1, by));
        let last = hunk.0.len().max(hunk.1.len()) - 1;
        let mut at = hunk.clone();
        // Slide up as far as possible
        while room.start < at.0.start
            && line(&at, last) == lines[at.0.start - 1]
        {
            at = shift(&at, -1);
        }
        // Slide down and keep each position
        let mut slides = vec![at.clone()];
        while at.0.end < room.end && line(&at, 0) == lines[at.0.end] {
            at = shift(&at, 1);
            slides.push(at.clone());
        }
        slides
    }

    /// The change of the first use that was only moved sideways.
    fn moved_use(&self) -> Option<Splice> {
        for (old, new) in self.hunks() {
            for line in old.filter(|line| self.view.is_name(*line)) {
                let name = self.view.lines[line].trim_ascii();
                let same =
                    |n: &usize| self.target.lines[*n].trim_ascii() == name;
                let mut found = new.clone().filter(same);
                if let (Some(now), None) = (found.next(), found.next()) {
                    return self.move_use(line, now);
                }
            }
        }
        None
    }

    fn move_use(&self, line: usize, new: usize) -> Option<Splice> {
        let spot = self.view.head(line)?;
        let now =
            self.view.outdent(&self.target.lines[new], spot.indent)?;
        let blank = &now[..now.len() - now.trim_ascii_start().len()];
        let source = self.source(spot).line(spot.line)?;
        let width = source.len() - source.trim_ascii_start().len();
        let start = self.source(spot).start(spot.line)?;
        let range = start..start + width;
        let changed = source[..width] != *blank;
        let cause = (line, &(new..new + 1));
        let splice = self.splice(spot, range, blank.to_vec(), cause);
        changed.then_some(splice)
    }

    // Carry a hunk by the kind of its lines
    /// The splices of a hunk that can be carried as a whole.
    fn part(&self, (old, new): &Hunk) -> Option<Vec<Splice>> {
        // Remove lines one by one
        if new.is_empty() {
            return old
                .clone()
                .map(|line| self.remove(line, new))
                .collect();
        }
        // Change a line that is not whole
        if old.len() == 1
            && new.len() == 1
            && self.view.whole(old.start).is_none()
        {
            return self.change_within(old.start, new.start);
        }
        let first = self.view.block(old.clone())?;
        let lines: Option<Vec<_>> = new
            .clone()
            .map(|line| self.written(line, first.indent))
            .collect();
        // Find the bytes of the block
        let source = self.source(first);
        let start = source.start(first.line)?;
        let last = first.line + old.len() as u32 - 1;
        let end = source.start(last)? + source.line(last)?.len();
        let text = lines?.join(&b'\n');
        Some(vec![self.splice(first, start..end, text, (old.start, new))])
    }

    /// How a line of the target is written in a chunk, if it can be.
    fn written(&self, line: usize, indent: usize) -> Option<Vec<u8>> {
        let text = self.view.outdent(&self.target.lines[line], indent)?;
        quote(text, self.view.read_tab())
    }

    fn remove(&self, line: usize, new: &Range<usize>) -> Option<Splice> {
        let spot = self.view.whole(line)?;
        let source = self.source(spot);
        let start = source.start(spot.line)?;
        let end = source.start(spot.line + 1).unwrap_or(source.text.len());
        Some(self.splice(spot, start..end, Vec::new(), (line, new)))
    }

    fn source(&self, spot: Spot) -> &'a Source {
        &self.view.sources[spot.file as usize]
    }

    fn splice(
        &self,
        spot: Spot,
        range: Range<usize>,
        text: Vec<u8>,
        (old, new): (usize, &Range<usize>),
    ) -> Splice {
        let cause = (self.target.path.clone(), self.disk_line(new.start));
        let Spot { file, line, .. } = spot;
        // Count the earlier turns of the line
        let from =
            |s: &&Segment| (s.place.file, s.place.line) == (file, line);
        let place =
            self.view.segments(old).iter().find(from).map(|s| s.place);
        let before = self.view.tangled.map.iter();
        let before = before.take_while(|s| s.line as usize <= old);
        let turn = before.filter(|s| Some(s.place) == place).count();
        Splice { file, range, text, line, cause, turn }
    }

    /// The line on the disk of a line of the target, or of its end.
    fn disk_line(&self, line: usize) -> u32 {
        let at = self.target.at.get(line).or(self.target.at.last());
        at.copied().unwrap_or(1)
    }

    fn carry_part(&mut self, hunk: &Hunk) {
        match self.part(hunk) {
            Some(splices) => self.splices.extend(splices),
            None => self.refuse(hunk),
        }
    }

    /// The old lines that became new ones, from the top.
    fn pairs(&self, (old, new): &Hunk) -> Vec<(usize, usize)> {
        let (rows, columns) = (old.len(), new.len());
        let mut sums = vec![vec![0.0_f32; columns + 1]; rows + 1];
        let mut paired = vec![vec![false; columns]; rows];
        for row in (0..rows).rev() {
            for column in (0..columns).rev() {
                // Decide whether two lines are a pair
                let a = self.view.lines[old.start + row];
                let b = &self.target.lines[new.start + column];
                let similar = similarity(a, b);
                let apart =
                    sums[row + 1][column].max(sums[row][column + 1]);
                let together = similar + sums[row + 1][column + 1];
                paired[row][column] = similar >= 0.5 && together >= apart;
                sums[row][column] =
                    if paired[row][column] { together } else { apart };
            }
        }
        // Read the pairs off the table
        let (mut pairs, mut row, mut column) = (Vec::new(), 0, 0);
        while row < rows && column < columns {
            if paired[row][column] {
                pairs.push((old.start + row, new.start + column));
                (row, column) = (row + 1, column + 1);
            } else if sums[row + 1][column] >= sums[row][column + 1] {
                row += 1;
            } else {
                column += 1;
            }
        }
        pairs
    }

    fn carry_pairs(&mut self, hunk: &Hunk, room: &Range<usize>) {
        let pairs = self.pairs(hunk);
        if pairs.is_empty() {
            return self.refuse(hunk);
        }
        let (mut line, mut new) = (hunk.0.start, hunk.1.start);
        let (mut above, end) = (room.start, (hunk.0.end, hunk.1.end));
        for (i, j) in pairs.into_iter().chain([end]) {
            let below = if (i, j) == end { room.end } else { i };
            // Carry what lies before the pair
            let gap = (line..i, new..j);
            match (gap.0.is_empty(), gap.1.is_empty()) {
                (true, true) => (),
                (true, false) => {
                    self.insert(&self.slides(&gap, &(above..below)))
                }
                (false, true) => self.cut(&gap, &(above..below)),
                _ => self.carry_part(&gap),
            }
            (line, new, above) = (i + 1, j + 1, i + 1);
            if (i, j) != end {
                self.carry_part(&(i..line, j..new));
            }
        }
    }

    // Carry an insertion
    /// The places in chapters at which lines above this line may be inserted.
    fn homes(&self, line: usize) -> Vec<Spot> {
        let above = line.checked_sub(1).and_then(|l| self.view.tail(l));
        let above = above.map(|spot| Spot { line: spot.line + 1, ..spot });
        let inside = line < self.view.lines.len();
        let below = inside.then(|| self.view.head(line)).flatten();
        let mut homes: Vec<Spot> = above.into_iter().chain(below).collect();
        homes.dedup();
        homes
    }

    fn insert(&mut self, slides: &[Hunk]) {
        // Take a position with one home
        for (old, new) in slides {
            if let [home] = self.homes(old.start)[..]
                && let Some(splice) = self.insertion(home, old.start, new)
            {
                return self.splices.push(splice);
            }
        }
        let (old, new) = &slides[0];
        let homes = self.homes(old.start).into_iter();
        let mut fits =
            homes.filter_map(|home| self.insertion(home, old.start, new));
        match (fits.next(), fits.next()) {
            (Some(splice), None) => self.splices.push(splice),
            _ => self.refuse(&slides[0]),
        }
    }

    /// New lines above a line of a chapter, if its chunk can have them.
    fn insertion(
        &self,
        home: Spot,
        line: usize,
        new: &Range<usize>,
    ) -> Option<Splice> {
        let start = self.source(home).start(home.line)?;
        // Write the new lines for their chunk
        let mut text = Vec::new();
        for line in new.clone() {
            text.extend(self.written(line, home.indent)?);
            text.push(b'\n');
        }
        // Attach them to the line above
        let above = line.checked_sub(1).filter(|above| {
            self.view.tail(*above)
                == Some(Spot { line: home.line - 1, ..home })
        });
        let (old, home) = match above {
            Some(above) => (above, Spot { line: home.line - 1, ..home }),
            None => (line, home),
        };
        Some(self.splice(home, start..start, text, (old, new)))
    }

    // Carry a removal
    /// The ways to remove lines of which the chapters differ afterwards.
    fn readings(&self, slides: &[Hunk]) -> Vec<Reading> {
        let mut readings: Vec<Reading> = Vec::new();
        let mut above = None;
        for hunk in slides {
            let block = self.view.block(hunk.0.clone());
            let next = |spot: Spot| Spot { line: spot.line + 1, ..spot };
            let slid = block.is_some() && block == above.map(next);
            above = block;
            if !slid && let Some(splices) = self.part(hunk) {
                // Add a reading unless it is there already
                let Ok(chapters) = apply(self.view.sources, &splices)
                else {
                    continue;
                };
                let same = |r: &Reading| {
                    changes(&r.chapters, &chapters).is_empty()
                };
                if !readings.iter().any(same) {
                    let pieces = self.pieces(hunk.0.clone());
                    readings.push(Reading { splices, chapters, pieces });
                }
            }
        }
        readings
    }

    fn cut(&mut self, hunk: &Hunk, room: &Range<usize>) {
        let mut slides = self.slides(hunk, room);
        let gone = &self.view.lines[hunk.0.clone()];
        if gone.iter().all(|line| line.is_empty()) {
            let block = |s: &Hunk| self.view.block(s.0.clone()).is_some();
            let first = slides.iter().position(block).unwrap_or(0);
            slides = vec![slides.swap_remove(first)];
        }
        let mut readings = self.readings(&slides);
        // Treat equal lines alike
        if gone.len() > 1 && gone.iter().all(|line| *line == gone[0]) {
            readings.iter_mut().for_each(|reading| reading.pieces = 1);
        }
        match readings.len() {
            0 => self.refuse(hunk),
            1 => self.splices.append(&mut readings[0].splices),
            _ => {
                let fault = self.equals(&slides[0], &readings);
                self.choices.push(Choice { readings, fault });
            }
        }
    }

    /// Of how many pieces of chapters these lines consist.
    fn pieces(&self, lines: Range<usize>) -> usize {
        let spots: Vec<_> =
            lines.map(|line| self.view.whole(line)).collect();
        let next = |spot: Spot| Spot { line: spot.line + 1, ..spot };
        let breaks = spots.windows(2).filter(|w| w[0].map(next) != w[1]);
        1 + breaks.count()
    }

    // Carry a change within a line
    fn change_within(
        &self,
        line: usize,
        new: usize,
    ) -> Option<Vec<Splice>> {
        let (old, now) = (self.view.lines[line], &self.target.lines[new]);
        // Look at the blanks at the beginning
        let added = self.view.segments(line).first()?.column as usize - 1;
        let begins = |t: &[u8]| t.len() - t.trim_ascii_start().len();
        let (blank, lead) = (begins(old), begins(now));
        if now.get(..added)? != &old[..added] || lead < added {
            return None;
        }
        let mut changes = Vec::new();
        if old[..blank] != now[..lead] {
            changes.push((added..blank, &now[added..lead]));
        }
        // Compare the words of two lines
        let (before, after) = (words(&old[blank..]), words(&now[lead..]));
        let bytes =
            |words: &[&[u8]], start: usize, range: &Range<usize>| {
                let length =
                    |w: &[&[u8]]| w.iter().map(|w| w.len()).sum::<usize>();
                let from = start + length(&words[..range.start]);
                from..from + length(&words[range.clone()])
            };
        for (a, b) in hunks(&before, &after) {
            let range = bytes(&before, blank, &a);
            changes.push((range, &now[bytes(&after, lead, &b)]));
        }
        let splice = |(range, text): (Range<usize>, &[u8])| {
            self.change_segment(line, range, text, new)
        };
        changes.into_iter().map(splice).collect()
    }

    fn change_segment(
        &self,
        line: usize,
        range: Range<usize>,
        text: &[u8],
        new: usize,
    ) -> Option<Splice> {
        let segments = self.view.segments(line);
        let length = self.view.lines[line].len();
        // Find the segments that hold the range
        let ends = segments[1..].iter().map(|s| s.column as usize - 1);
        let ends = ends.chain([length]);
        let mut homes =
            segments.iter().zip(ends).filter(|(segment, end)| {
                let start = segment.column as usize - 1;
                let bytes = &self.view.lines[line][start..*end];
                let literal =
                    self.view.source_of(segment).starts_with(bytes);
                literal && start <= range.start && range.end <= *end
            });
        let (segment, end) = homes.next()?;
        if homes.next().is_some() {
            return None;
        }
        // Refuse to insert beside a use that left nothing
        let rest = self.view.source_of(segment);
        let begins = segment.column as usize - 1 == range.start;
        let hidden_before = begins
            && segments[0] == *segment
            && self.view.head(line).is_none();
        let hidden_after = range.start == end
            && end == length
            && rest.len() > end + 1 - segment.column as usize;
        if range.is_empty() && (hidden_before || hidden_after) {
            return None;
        }
        // Splice the line that the segment comes from
        let source = self.view.source_line(segment);
        let from = segment.place.column as usize - 1 + range.start
            - (segment.column as usize - 1);
        let to = from + range.len();
        let tab = self.view.read_tab();
        let (uses, size) = shape(source, tab);
        // Try the text with and without escape
        let wanted = (uses, size + text.len() - range.len());
        let right = |text: &Vec<u8>| {
            let line = [&source[..from], text, &source[to..]].concat();
            shape(&line, tab) == wanted
        };
        let text = [text.to_vec(), escape(text)].into_iter().find(right)?;
        let spot = self.view.spot(segment);
        let start = self.source(spot).start(spot.line)?;
        let range = start + from..start + to;
        Some(self.splice(spot, range, text, (line, &(new..new + 1))))
    }

    // Refuse what can be read in two ways
    fn refuse(&mut self, (old, new): &Hunk) {
        let lines = old.start.saturating_sub(1)..old.end + 1;
        let named = old.clone().any(|line| self.view.is_name(line));
        // Say why it has no place
        let one = match old.is_empty() {
            true => self.homes(old.start).len() == 1,
            false => self.view.block(old.clone()).is_some(),
        };
        let text = match (named, one, old.is_empty()) {
            (true, ..) => "a chunk's name, which is a comment only here",
            (_, true, _) => "a line that its chunk cannot have",
            (_, _, true) => "lines were inserted where two chunks meet",
            _ => "an edit crosses the border of a chunk",
        };
        let mut fault = self.fault(new.start, text);
        if one && !named {
            let help = "it is indented less than the chunk, or holds a tab";
            fault = fault.with_help(help);
        }
        let lines = if old.is_empty() { lines } else { old.clone() };
        let mut places = Vec::new();
        // Collect the places of the lines
        for line in lines {
            let Some(last) = self.view.segments(line).last() else {
                continue;
            };
            let source = &self.view.sources[last.place.file as usize];
            let name = String::from_utf8_lossy(&source.name);
            places.push(format!("{name}:{}", last.place.line));
        }
        self.faults.push(concerning(fault, places));
    }

    fn equals(&self, (_, new): &Hunk, readings: &[Reading]) -> Diagnostic {
        let text = "which of the equal lines of two chunks was removed?";
        let places = readings.iter().filter_map(|reading| {
            let splice = reading.splices.first()?;
            let source = &self.view.sources[splice.file as usize];
            let name = String::from_utf8_lossy(&source.name);
            Some(format!("{name}:{}", splice.line))
        });
        concerning(self.fault(new.start, text), places.collect())
    }

    fn fault(&self, line: usize, text: &str) -> Diagnostic {
        edit_fault(&self.target.path, self.disk_line(line), text)
    }
}

/// One of several ways to understand that lines are missing.
struct Reading {
    splices: Vec<Splice>,
    /// The chapters without the lines.
    chapters: Vec<Source>,
    /// How many pieces of chapters they are.
    pieces: usize,
}

/// The ways to understand a removal, and what is said if more than one
/// of them gives the edited files.
struct Choice {
    readings: Vec<Reading>,
    fault: Diagnostic,
}

// Change the chapters in memory
/// A fault with the lines of chapters that come into question.
fn concerning(fault: Diagnostic, mut places: Vec<String>) -> Diagnostic {
    places.dedup();
    let few = places.len().min(4);
    let help = format!("it concerns {}", places[..few].join(", "));
    let fault = fault.with_help(help);
    let help = "make this edit in the chapter, too, and untangle again";
    fault.with_help(help)
}

/// What is wrong with a line of an edited file.
fn edit_fault(path: &Path, line: u32, text: &str) -> Diagnostic {
    let file = path.display().to_string();
    let position = Position { file, line, column: 1, excerpt: None };
    Diagnostic::new(Level::Error, Some(position), text)
}

/// Definitions of chunks of which two uses were edited differently.
fn disagreements(web: &Web, splices: &[Splice]) -> Vec<Diagnostic> {
    // Gather what each use asks for
    let places = web.chunks.iter().flat_map(|c| &c.definitions);
    let starts: BTreeSet<_> = places.map(|p| (p.file, p.line)).collect();
    let mut asked: BTreeMap<_, BTreeMap<_, Vec<&Splice>>> = BTreeMap::new();
    for splice in splices {
        let below = starts.range(..=(splice.file, splice.line));
        let uses = asked.entry(below.last()).or_default();
        let user = (&splice.cause.0, splice.turn);
        uses.entry(user).or_default().push(splice);
    }
    let same = |a: &[&Splice], b: &[&Splice]| {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.agrees(b))
    };
    // Compare the uses of each definition
    let mut faults = Vec::new();
    for uses in asked.values() {
        let mut uses = uses.values();
        let Some(first) = uses.next() else { continue };
        let other = uses.find(|other| !same(first, other));
        faults.extend(other.map(|other| contradiction(first[0], other[0])));
    }
    faults
}

/// The chapters with all splices made.
///
/// # Errors
///
/// Splices that contradict each other.
fn apply(
    sources: &[Source],
    splices: &[Splice],
) -> Result<Vec<Source>, Vec<Diagnostic>> {
    let mut ordered: Vec<&Splice> = splices.iter().collect();
    ordered.sort_by_key(|s| (s.file, s.range.start, s.range.end));
    ordered.dedup_by(|b, a| a.agrees(b));
    // Refuse splices that overlap
    let overlap = |pair: &&[&Splice]| {
        let (a, b) = (&pair[0], &pair[1]);
        a.file == b.file
            && (b.range.start < a.range.end || a.range == b.range)
    };
    let pairs = ordered.windows(2).filter(overlap);
    let faults: Vec<Diagnostic> =
        pairs.map(|pair| contradiction(pair[0], pair[1])).collect();
    if !faults.is_empty() {
        return Err(faults);
    }
    // Make the splices from the end
    let mut texts: Vec<Vec<u8>> =
        sources.iter().map(|s| s.text.clone()).collect();
    for splice in ordered.iter().rev() {
        let text = splice.text.iter().copied();
        texts[splice.file as usize].splice(splice.range.clone(), text);
    }
    let named = sources.iter().zip(texts);
    Ok(named.map(|(s, text)| Source::new(s.name.clone(), text)).collect())
}

fn contradiction(a: &Splice, b: &Splice) -> Diagnostic {
    let text = "two edits of one chunk contradict each other";
    let fault = edit_fault(&a.cause.0, a.cause.1, text);
    let (path, line) = (b.cause.0.display(), b.cause.1);
    let fault = fault.with_help(format!("the other is {path}:{line}"));
    fault.with_help("make both the same, and untangle again")
}

impl Splice {
    /// Do they change the same in the same way?
    fn agrees(&self, other: &Self) -> bool {
        let change = |s: &Self| (s.file, s.range.clone(), s.text.clone());
        change(self) == change(other)
    }
}

// Untangle a project
impl Project {
    // Write the chapters when all is proved
    /// Carries all edits of files back to the chapters; tells what changed.
    ///
    /// With `check` nothing is written.
    ///
    /// # Errors
    ///
    /// Whatever [`Project::plan`] finds, except for edits; edits that cannot
    /// be carried, after which nothing is written; chapters and files that
    /// cannot be written.
    pub fn untangle(
        &self,
        check: bool,
    ) -> Result<Vec<String>, Vec<Diagnostic>> {
        self.plan_files(false)?;
        let old = self.expand_sources(self.read_chapters()?.0);
        let targets = self.targets(&old)?;
        let new = self.carry_all(&old, &targets)?;
        if !check && !targets.is_empty() {
            // Write the chapters and tangle them
            self.write_chapters(&old, &new).map_err(|fault| vec![fault])?;
            self.overwrite()?;
        }
        Ok(changes(&old.web.sources, &new.web.sources))
    }

    fn write_chapters(
        &self,
        old: &Expansion,
        new: &Expansion,
    ) -> Result<(), Diagnostic> {
        let texts = old.web.sources.iter().zip(&new.web.sources);
        let texts = texts.map(|(old, new)| (&old.text, &new.text));
        let mut changed: Vec<_> = self.chapters.iter().zip(texts).collect();
        changed.retain(|(_, (old, new))| old != new);
        // Refuse to write read-only chapters
        for (name, _) in &changed {
            let state = fs::metadata(self.dir.join(name));
            if state.is_ok_and(|state| state.permissions().readonly()) {
                let error = io::ErrorKind::PermissionDenied.into();
                return Err(failure("write", name, &error));
            }
        }
        for (name, (_, text)) in changed {
            replace(&self.dir.join(name), text, Attributes::default())
                .map_err(|error| failure("write", name, &error))?;
        }
        Ok(())
    }
}

// Carry the edits of all files

/// How many combinations of readings are tried.
const COMBINATIONS: usize = 64;

/// The combinations of one reading of each choice, or only of those with
/// the fewest pieces.
fn combinations(choices: &[Choice], fewest: bool) -> Vec<Vec<&Reading>> {
    let mut all = vec![Vec::new()];
    for choice in choices {
        let readings = choice.readings.iter();
        let least = readings.clone().map(|r| r.pieces).min();
        let some = readings.filter(|r| !fewest || Some(r.pieces) == least);
        let longer = |way: &Vec<_>| {
            let longer = some.clone().map(|r| [&way[..], &[r]].concat());
            longer.collect::<Vec<_>>()
        };
        all = all.iter().flat_map(longer).collect();
        if all.len() > COMBINATIONS {
            return Vec::new();
        }
    }
    all
}

/// What a combination of readings leads to.
struct Found<'a> {
    /// Whether it changes nothing else, and in how few pieces.
    rank: (bool, Reverse<usize>),
    way: Vec<&'a Reading>,
    new: Expansion,
}

impl Project {
    /// What the chapters give with all splices made, if that is right.
    fn attempt(
        &self,
        old: &Expansion,
        now: &Expansion,
        splices: &[Splice],
        targets: &[Target],
    ) -> Result<Expansion, Vec<Diagnostic>> {
        let faults = disagreements(&now.web, splices);
        if !faults.is_empty() {
            return Err(faults);
        }
        let sources = apply(&now.web.sources, splices)?;
        let new = self.expand_sources(sources);
        prove(old, &new, targets)?;
        Ok(new)
    }
}
impl Project {
    /// What the chapters give when all edits are carried.
    fn carry_all(
        &self,
        old: &Expansion,
        targets: &[Target],
    ) -> Result<Expansion, Vec<Diagnostic>> {
        // Move uses until all have their places
        let mut now = old.clone();
        let (mut seen, mut done) = (HashSet::new(), Vec::<Splice>::new());
        loop {
            let carriers = carriers(&now, targets);
            let moved: Vec<Splice> =
                carriers.iter().filter_map(Carrier::moved_use).collect();
            if moved.is_empty() {
                break;
            }
            let sources = &now.web.sources;
            let texts = sources.iter().map(|s| s.text.clone());
            if !seen.insert(texts.collect::<Vec<_>>()) {
                return Err(vec![to_and_fro(&done)]);
            }
            let next = apply(sources, &moved)?;
            done.extend(moved);
            now = self.expand_sources(next);
        }
        // Carry the hunks of all files
        let (mut splices, mut choices) = (Vec::new(), Vec::new());
        let mut faults = Vec::new();
        for mut carrier in carriers(&now, targets) {
            carrier.carry();
            splices.extend(carrier.splices);
            choices.extend(carrier.choices);
            faults.extend(carrier.faults);
        }
        if !faults.is_empty() {
            faults.extend(disagreements(&now.web, &splices));
        }
        if !faults.is_empty() {
            return Err(faults);
        }
        // Choose the readings that give the files
        let mut found: Vec<Found> = Vec::new();
        let mut failed = None;
        for fewest in [true, false] {
            let tried = !fewest && choices.is_empty();
            if tried || found.iter().any(|found| found.rank.0) {
                break;
            }
            for way in combinations(&choices, fewest) {
                // Try one reading of each removal
                let more = way.iter().flat_map(|reading| &reading.splices);
                let all: Vec<Splice> =
                    splices.iter().chain(more).cloned().collect();
                match self.attempt(old, &now, &all, targets) {
                    Ok(new) => {
                        let pieces =
                            way.iter().map(|reading| reading.pieces).sum();
                        let rank =
                            (is_exact(old, &new, targets), Reverse(pieces));
                        found.push(Found { rank, way, new });
                    }
                    Err(faults) => failed = failed.or(Some(faults)),
                }
            }
        }
        // Take the best result if it is the only one
        let best = found.iter().map(|found| found.rank).max();
        found.retain(|found| Some(found.rank) == best);
        found.dedup_by(|b, a| {
            changes(&a.new.web.sources, &b.new.web.sources).is_empty()
        });
        if found.len() == 1 {
            return Ok(found.remove(0).new);
        }
        // Refuse the choices that are still open
        if let (true, Some(faults)) = (found.is_empty(), failed) {
            return Err(faults);
        }
        let same = |at: usize| {
            let mut ways = found.windows(2);
            ways.all(|w| std::ptr::eq(w[0].way[at], w[1].way[at]))
        };
        let open: Vec<usize> = (0..choices.len())
            .filter(|at| found.is_empty() || !same(*at))
            .collect();
        let faults = open.into_iter().map(|at| choices[at].fault.clone());
        Err(faults.collect())
    }
}

/// Two moves of one use that contradict each other.
fn to_and_fro(moves: &[Splice]) -> Diagnostic {
    let against = |a: &Splice, b: &Splice| {
        (a.file, a.line) == (b.file, b.line) && a.text != b.text
    };
    let pairs = moves.iter().zip(1..).find_map(|(a, next)| {
        let other = moves[next..].iter().find(|b| against(a, b))?;
        Some((a, other))
    });
    let (a, b) = pairs.unwrap_or((&moves[0], &moves[0]));
    contradiction(a, b)
}

fn carriers<'a>(
    now: &'a Expansion,
    targets: &'a [Target],
) -> Vec<Carrier<'a>> {
    let carrier = |target: &'a Target| {
        let mut files = now.files.iter();
        let (_, tangled) = files.find(|(path, _)| *path == target.path)?;
        Some(Carrier::new(now, tangled, target))
    };
    targets.iter().filter_map(carrier).collect()
}

// Prove that the chapters give the edited files
fn prove(
    old: &Expansion,
    new: &Expansion,
    targets: &[Target],
) -> Result<(), Vec<Diagnostic>> {
    let mut faults = new.faults.clone();
    let fresh = Touched::new(new, old);
    let stale = Touched::new(old, new);
    for (path, before) in &old.files {
        let target = targets.iter().find(|t| t.path == *path);
        let after = new.files.iter().find(|(p, _)| p == path);
        let after = after.map(|(_, tangled)| tangled);
        let proof = Proof { before, after, fresh: &fresh, stale: &stale };
        let wrong = proof.first_wrong(target);
        // Say which edit the chapters do not give
        if let Some(line) = wrong {
            let text = "no change of a chapter gives this edit";
            let at = target.and_then(|t| t.at.get(line).copied());
            let fault =
                edit_fault(path, at.unwrap_or(line as u32 + 1), text);
            let help =
                "make this edit in the chapter, too, and untangle again";
            faults.push(fault.with_help(help));
        }
    }
    if faults.is_empty() { Ok(()) } else { Err(faults) }
}

/// The lines of chapters that another version of them does not have, and
/// that are tangled more than once.
struct Touched(BTreeSet<(u32, u32)>);

impl Touched {
    fn new(these: &Expansion, others: &Expansion) -> Self {
        let pairs = these.web.sources.iter().zip(&others.web.sources);
        let mut touched = BTreeSet::new();
        // Find the lines that only these have
        for ((this, other), file) in pairs.zip(0..) {
            if this.text == other.text {
                continue;
            }
            let (a, b) = (lines_of(&this.text), lines_of(&other.text));
            let lines = hunks(&a, &b).into_iter().flat_map(|(old, _)| old);
            touched.extend(lines.map(|line| (file, line as u32 + 1)));
        }
        // Keep those that are tangled twice
        let (mut seen, mut shared) = (HashSet::new(), BTreeSet::new());
        let maps = these.files.iter().map(|(_, tangled)| &tangled.map);
        for place in maps.flatten().map(|segment| segment.place) {
            let line = (place.file, place.line);
            if touched.contains(&line) && !seen.insert(place) {
                shared.insert(line);
            }
        }
        Self(shared)
    }

    /// Does a line of a tangled file come from such lines?
    fn gives(&self, tangled: &Tangled, line: usize) -> bool {
        let line = line as u32 + 1;
        let from = tangled.map.partition_point(|s| s.line < line);
        let here = tangled.map[from..].iter();
        let mut here = here.take_while(|s| s.line == line);
        here.any(|s| self.0.contains(&(s.place.file, s.place.line)))
    }
}

struct Proof<'a> {
    before: &'a Tangled,
    after: Option<&'a Tangled>,
    fresh: &'a Touched,
    stale: &'a Touched,
}

/// The lines that a file should have.
fn wanted<'a>(
    before: &'a Tangled,
    target: Option<&'a Target>,
) -> Vec<&'a [u8]> {
    match target {
        Some(target) => target.lines.iter().map(|l| &l[..]).collect(),
        None => lines_of(&before.text),
    }
}

/// Is every file what it should be, to the byte?
fn is_exact(old: &Expansion, new: &Expansion, targets: &[Target]) -> bool {
    old.files.iter().all(|(path, before)| {
        let target = targets.iter().find(|t| t.path == *path);
        let after = new.files.iter().find(|(p, _)| p == path);
        after.is_some_and(|(_, tangled)| {
            lines_of(&tangled.text) == wanted(before, target)
        })
    })
}

impl Proof<'_> {
    /// The first line of the target that the new text does not give.
    fn first_wrong(&self, target: Option<&Target>) -> Option<usize> {
        let old = lines_of(&self.before.text);
        let target = wanted(self.before, target);
        let Some(after) = self.after else { return Some(0) };
        let new = lines_of(&after.text);
        if new == target {
            return None;
        }
        // Let shared chunks differ where nobody edited them
        let mut origin = vec![None; target.len()];
        let mut line = 0;
        for (a, b) in hunks(&old, &target)
            .into_iter()
            .chain([(old.len()..old.len(), target.len()..target.len())])
        {
            let same = line..b.start;
            let shift = a.start - same.len();
            for (at, old) in same.zip(shift..) {
                origin[at] = Some(old);
            }
            line = b.end;
        }
        let unedited = |at: usize| {
            origin[at].is_some_and(|l| self.stale.gives(self.before, l))
        };
        let shared = |(a, b): &Hunk| {
            a.clone().all(unedited)
                && b.clone().all(|line| self.fresh.gives(after, line))
        };
        let mut differences = hunks(&target, &new).into_iter();
        let wrong = differences.find(|hunk| !shared(hunk))?;
        Some(wrong.0.start)
    }
}

/// What changed in the chapters, one line for each place.
fn changes(old: &[Source], new: &[Source]) -> Vec<String> {
    let mut changes = Vec::new();
    for (old, new) in old.iter().zip(new) {
        let (a, b) = (lines_of(&old.text), lines_of(&new.text));
        let name = String::from_utf8_lossy(&old.name);
        for (a, b) in hunks(&a, &b) {
            let line = b.start + 1;
            let (gone, come) = (a.len(), b.len());
            changes.push(format!("{name}:{line}: -{gone} +{come} lines"));
        }
    }
    changes
}

// Run the command that untangles
/// The command `noweb untangle [-C dir] [--record file] [--check]
/// [--only prefix]... [--except prefix]... chapter...`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let (project, check) = match parse_arguments(args) {
        Ok(parsed) => parsed,
        Err(text) => return streams.misused(text),
    };
    let (changes, faults) = match project.untangle(check) {
        Ok(changes) => (changes, Vec::new()),
        Err(faults) => (Vec::new(), faults),
    };
    let lines = changes.iter().map(|line| format!("{line}\n"));
    let text: String = lines.collect();
    let result = streams.output.write_all(text.as_bytes());
    let failed = !faults.is_empty() || check && !changes.is_empty();
    streams.conclude(result, &faults).max(u8::from(failed)).min(1)
}
