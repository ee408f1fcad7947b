// Tangled from noweb/chapters/untangle.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Edits of tangled files, carried back to the chapters.
//!
//! An edit is carried if it lies in the text of one chunk. Otherwise, or if
//! tangling the new chapters would not give the edited files, nothing is
//! written. Lines of lists count from 0, as indices, and lines of files
//! from 1.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::hash::Hash;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use noweb_core::conflict::edit_fault;
use noweb_core::markup::{begins_docs, mark_up};
use similar::{Algorithm, DiffTag, capture_diff_slices};

use crate::cpif::replace;
use crate::diagnostic::{
    Diagnostic, Faults, Place, Source, bytes_of, checked, failure, shown,
    text_of,
};
use crate::project::{
    Expansion, Project, differs, expand_sources, hash, parse, with_ends,
};
use crate::reading::conflicts;
use crate::tangle::{Segment, Tangled, tangle};
use crate::web::Web;
use crate::{Streams, error};

/// What stands in an old list, and what stands there in the new one.
type Hunk = (Range<usize>, Range<usize>);

/// The hunks in which two lists differ, in order.
fn hunks<T: Hash + Eq + Ord>(old: &[T], new: &[T]) -> Vec<Hunk> {
    let steps = capture_diff_slices(Algorithm::Myers, old, new);
    let changed = steps.iter().filter(|s| s.tag() != DiffTag::Equal);
    changed.map(|step| (step.old_range(), step.new_range())).collect()
}

fn lines_of(text: &[u8]) -> Vec<&[u8]> {
    let text = text.strip_suffix(b"\n").unwrap_or(text);
    let lines = text.split(|b| *b == b'\n');
    lines.map(|line| line.strip_suffix(b"\r").unwrap_or(line)).collect()
}

/// The words of a line: identifiers and numbers, and single other bytes.
fn words(line: &[u8]) -> Vec<&[u8]> {
    let letter =
        |b: &u8| b.is_ascii_alphanumeric() || *b == b'_' || !b.is_ascii();
    line.chunk_by(|a, b| letter(a) && letter(b)).collect()
}

/// Have two lines at least half of their words in common?
fn similar(a: &[u8], b: &[u8]) -> bool {
    let (a, b) = (words(a.trim_ascii()), words(b.trim_ascii()));
    let changed = hunks(&a, &b).into_iter();
    let changed: usize = changed.map(|(a, b)| a.len() + b.len()).sum();
    2 * changed <= a.len() + b.len()
}

/// The texts of the edited files on the disk.
type Edited = BTreeMap<PathBuf, Vec<u8>>;

fn edited(project: &Project, now: &Expansion) -> Result<Edited, Faults> {
    let record = project.read_record(&project.record);
    let (mut edited, mut faults) = (Edited::new(), Vec::new());
    for (path, tangled) in &now.files {
        let text = fs::read(project.dir.join(path)).unwrap_or_default();
        let is_ours = record.contains(&(path.clone(), hash(&text)));
        if is_ours || !differs(&text, &tangled.text) {
            continue;
        }
        let text = with_ends(&text, tangled.text.ends_with(b"\r\n"));
        faults.extend(conflicts(path, &text, &tangled.text));
        if !record.contains(&(path.clone(), hash(&tangled.text))) {
            faults.push(changed_twice(path, &tangled.text, &text));
        }
        edited.insert(path.clone(), text);
    }
    checked(edited, faults)
}

fn changed_twice(path: &Path, now: &[u8], disk: &[u8]) -> Diagnostic {
    let differ = hunks(&lines_of(now), &lines_of(disk));
    let line = differ.first().map_or(0, |(_, new)| new.start);
    let text = "this file was edited, and so was a chapter of it";
    edit_fault(path, line, text)
        .with_help("undo one of the two, and make it again afterwards")
}

/// A line of a chapter, and what tangling indents it by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Spot {
    file: u32,
    line: u32,
    indent: usize,
}

impl Spot {
    fn new(segment: &Segment) -> Self {
        let Place { file, line, .. } = segment.place;
        Self { file, line, indent: segment.indent as usize }
    }

    fn below(self, lines: usize) -> Self {
        Self { line: self.line + lines as u32, ..self }
    }
}

/// A change of a chapter: bytes that become others.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Splice {
    file: u32,
    range: Range<usize>,
    text: Vec<u8>,
}

/// One edited file, and what the chapters give for it.
struct Carrier<'a> {
    sources: &'a [Source],
    tangled: &'a Tangled,
    path: &'a Path,
    old: Vec<&'a [u8]>,
    new: Vec<&'a [u8]>,
}

impl<'a> Carrier<'a> {
    fn segments(&self, line: usize) -> &'a [Segment] {
        self.tangled.segments(line as u32 + 1)
    }

    fn source(&self, place: Place) -> &'a [u8] {
        let line = self.sources[place.file as usize].line(place.line);
        let line = line.map(|l| l.strip_suffix(b"\r").unwrap_or(l));
        line.and_then(|l| l.get(place.column as usize - 1..)).unwrap_or(b"")
    }

    /// The line of a chapter that begins where this line begins.
    fn head(&self, line: usize) -> Option<Spot> {
        let first = self.segments(line).first()?;
        let begin = Place { column: 1, ..first.place };
        let escaped = matches!(self.source(begin), b"" | [b'@', ..]);
        let column = first.place.column;
        (column == 1 || column == 2 && escaped).then(|| Spot::new(first))
    }

    /// The line of a chapter that ends where this line ends.
    fn tail(&self, line: usize) -> Option<Spot> {
        let last = self.segments(line).last()?;
        let end = &self.old[line][last.column as usize - 1..];
        (self.source(last.place) == end).then(|| Spot::new(last))
    }

    /// The line of a chapter that this line is the whole text of.
    fn whole(&self, line: usize) -> Option<Spot> {
        let (head, tail) = (self.head(line)?, self.tail(line)?);
        let text = self.sources[head.file as usize].line(head.line)?;
        let whole = head == tail && web_of(text).uses.is_empty();
        whole.then_some(head)
    }

    /// The first line of a block of lines that a chapter has together.
    fn block(&self, lines: Range<usize>) -> Option<Spot> {
        let first = self.whole(lines.start)?;
        let next = |(n, line)| self.whole(line) == Some(first.below(n));
        lines.enumerate().all(next).then_some(first)
    }

    /// Puts new lines in the place of some lines of a chapter.
    fn replace(
        &self,
        spot: Spot,
        count: usize,
        new: &Range<usize>,
    ) -> Option<Splice> {
        let source = &self.sources[spot.file as usize];
        let start = source.start(spot.line)?;
        let end = source.start(spot.below(count).line);
        let mut text = Vec::new();
        let returns = source.line(1).is_some_and(|l| l.ends_with(b"\r"));
        for line in &self.new[new.clone()] {
            let (blank, bare) = line.split_at(spot.indent.min(line.len()));
            if !blank.trim_ascii().is_empty() {
                return None;
            }
            text.extend(quote(bare));
            text.extend(if returns { &b"\r\n"[..] } else { b"\n" });
        }
        let range = start..end.unwrap_or(source.text.len());
        Some(Splice { file: spot.file, range, text })
    }

    /// The splices of one hunk, if there is one way to make them.
    fn carry(
        &self,
        hunk: &Hunk,
        room: Range<usize>,
    ) -> Result<Vec<Splice>, &'static str> {
        let (old, new) = hunk;
        if !old.is_empty() && !new.is_empty() {
            let block = self.block(old.clone());
            let whole = block.and_then(|s| self.replace(s, old.len(), new));
            let whole = whole.map(|splice| vec![splice]);
            return whole.or_else(|| self.pairs(hunk)).ok_or(OUTSIDE);
        }
        let mut ways = Vec::new();
        for hunk in self.slides(hunk, room) {
            // Collect the ways at this position
            let (old, new) = hunk;
            let lines = &self.old[old.clone()];
            let spots = match old.is_empty() {
                true => self.homes(old.start),
                false => self.block(old.clone()).into_iter().collect(),
            };
            let alike = lines.windows(2).all(|pair| pair[0] == pair[1]);
            if spots.is_empty() && lines.len() > 1 && alike {
                return Err(AMBIGUOUS);
            }
            for spot in spots {
                let way = self.replace(spot, old.len(), &new);
                ways.push(way.ok_or(OUTSIDE)?);
            }
        }
        ways.dedup_by(|a, b| a == b || self.result(a) == self.result(b));
        match ways.len() {
            0 => Err(OUTSIDE),
            1 => Ok(ways),
            _ => Err(AMBIGUOUS),
        }
    }

    /// The places at which lines above this one may be inserted.
    fn homes(&self, line: usize) -> Vec<Spot> {
        let above = line.checked_sub(1).and_then(|l| self.tail(l));
        let above = above.map(|spot| spot.below(1));
        let below = self.head(line);
        let mut homes: Vec<Spot> = above.into_iter().chain(below).collect();
        homes.dedup();
        homes
    }

    /// All positions of an insertion or a removal, from the highest.
    fn slides(&self, hunk: &Hunk, room: Range<usize>) -> Vec<Hunk> {
        let (old, new) = hunk;
        let inserted = old.is_empty();
        let (text, range) =
            if inserted { (&self.new, new) } else { (&self.old, old) };
        let up = (1..=old.start - room.start)
            .take_while(|k| text[range.start - k] == text[range.end - k])
            .count();
        let down = (0..room.end - old.end)
            .take_while(|k| text[range.start + k] == text[range.end + k])
            .count();
        let moved = |r: &Range<usize>, k| r.start - up + k..r.end - up + k;
        (0..=up + down).map(|k| (moved(old, k), moved(new, k))).collect()
    }

    fn result(&self, splice: &Splice) -> (u32, Vec<u8>) {
        let mut text = self.sources[splice.file as usize].text.clone();
        text.splice(splice.range.clone(), splice.text.iter().copied());
        (splice.file, text)
    }

    /// The splices of lines that became as many similar lines.
    fn pairs(&self, (old, new): &Hunk) -> Option<Vec<Splice>> {
        let mut splices = Vec::new();
        for (line, now) in old.clone().zip(new.clone()) {
            if !similar(self.old[line], self.new[now]) {
                return None;
            }
            let spot = self.whole(line)?;
            splices.push(self.replace(spot, 1, &(now..now + 1))?);
        }
        (old.len() == new.len()).then_some(splices)
    }

    /// The report of a hunk that is not carried.
    fn refuse(&self, (old, new): &Hunk, text: &str) -> Diagnostic {
        let below = old.end.max((old.start + 1).min(self.old.len()));
        let above = old.start.saturating_sub(usize::from(old.is_empty()));
        let places = (above..below).filter_map(|line| {
            let place = self.segments(line).last()?.place;
            let source = &self.sources[place.file as usize];
            Some(format!("{}:{}", text_of(&source.name), place.line))
        });
        let mut places: Vec<String> = places.take(4).collect();
        places.dedup();
        edit_fault(self.path, new.start, text)
            .with_help(format!("it concerns {}", places.join(", ")))
            .with_help("undo it here, and make it in the chapter")
    }
}

const OUTSIDE: &str = "this edit is not in the text of one chunk";
const AMBIGUOUS: &str = "this edit may belong to either of two places";

/// A web that consists of one line of code.
fn web_of(line: &[u8]) -> Web {
    let chapter = [b"<<*>>=\n", line, b"\n"].concat();
    Web::read(vec![Source::new(Vec::new(), chapter)], mark_up).0
}

/// A line of a chunk that is tangled to this text.
fn quote(text: &[u8]) -> Vec<u8> {
    let tangled = tangle(&web_of(text), 0, false);
    let same = tangled.is_ok_and(|t| t.text == [text, b"\n"].concat());
    if same { text.to_vec() } else { escape(text) }
}

fn escape(text: &[u8]) -> Vec<u8> {
    let (mut out, mut rest) = (Vec::new(), text);
    while !rest.is_empty() {
        let pair = rest.starts_with(b"<<")
            || rest.starts_with(b">>") && out.last() == Some(&b'@');
        out.extend(pair.then_some(b'@'));
        let (done, more) = rest.split_at(1 + usize::from(pair));
        out.extend(done);
        rest = more;
    }
    if out.starts_with(b"@@") || begins_docs(&out) {
        out.insert(0, b'@');
    }
    out
}

fn carry_all(
    now: &Expansion,
    edited: &Edited,
) -> Result<Vec<Splice>, Faults> {
    let (mut splices, mut faults) = (Vec::new(), Vec::new());
    for (path, tangled) in &now.files {
        let Some(text) = edited.get(path) else { continue };
        let (old, new) = (lines_of(&tangled.text), lines_of(text));
        let hunks = hunks(&old, &new);
        let sources = &now.web.sources;
        let carrier = Carrier { sources, tangled, path, old, new };
        // Carry the hunks of this file
        let mut above = 0;
        for (index, hunk) in hunks.iter().enumerate() {
            let below = hunks.get(index + 1).map(|(old, _)| old.start);
            let room = above..below.unwrap_or(carrier.old.len());
            match carrier.carry(hunk, room) {
                Ok(more) => splices.extend(more),
                Err(text) => faults.push(carrier.refuse(hunk, text)),
            }
            above = hunk.0.end;
        }
    }
    checked(splices, faults)
}

/// Carries all edits of files back to the chapters; lists the changes.
///
/// With `check` nothing is written.
pub fn untangle(
    project: &Project,
    check: bool,
) -> Result<Vec<String>, Faults> {
    let old = project.expand()?;
    let record = project.read_record(&project.record);
    project.removals(&old.files, &record)?;
    // Check that the files exist
    let here = |(path, _): &(PathBuf, _)| project.dir.join(path).exists();
    if !old.files.is_empty() && !old.files.iter().any(here) {
        let first = shown(&old.files[0].0);
        let text = "no file of the program is here, as";
        return Err(error(format!("{text} {first}")));
    }
    let edited = edited(project, &old)?;
    let mut splices = carry_all(&old, &edited)?;
    // Apply the splices to the chapters
    splices.sort_by_key(|s| (s.file, s.range.start, s.range.end));
    splices.dedup();
    let sources = old.web.sources.iter();
    let mut texts: Vec<_> =
        sources.clone().map(|s| s.text.clone()).collect();
    let mut done = (u32::MAX, 0);
    for Splice { file, range, text } in splices.into_iter().rev() {
        if file != done.0 || range.end <= done.1 {
            done = (file, range.start);
            texts[file as usize].splice(range, text);
        }
    }
    let read = |(source, text): (&Source, Vec<u8>)| {
        project.reader()(source.name.clone(), text, b"")
    };
    let sources = sources.zip(texts).map(read).collect::<Result<_, _>>()?;
    let new = expand_sources(sources)?;
    // Prove that the chapters give the files
    let mut faults = Vec::new();
    for (path, before) in &old.files {
        let edit = edited.get(path);
        let wanted = edit.unwrap_or(&before.text);
        let after = new.files.iter().find(|(p, _)| p == path);
        let after = after.map_or(&b""[..], |(_, after)| &after.text);
        let differ = hunks(&lines_of(wanted), &lines_of(after));
        if let Some((line, _)) = differ.first() {
            // Report the first line that differs
            let text = match edit {
                Some(_) => "no change of one chunk gives this line",
                None => "an edit elsewhere would change this line, too",
            };
            let help = "undo the edit, and make it in the chapter";
            faults.push(edit_fault(path, line.start, text).with_help(help));
        }
    }
    checked((), faults)?;
    // Write the chapters and tangle them
    let [before, after] = [&old, &new].map(|e| &e.web.sources);
    if !check && !edited.is_empty() {
        // Write the chapters that have changed
        let texts =
            before.iter().zip(after).map(|(a, b)| (&a.text, &b.text));
        let mut changed: Vec<_> =
            project.chapters.iter().zip(texts).collect();
        changed.retain(|(_, (old, new))| old != new);
        // Refuse to write read-only chapters
        for (name, _) in &changed {
            let state = fs::metadata(project.dir.join(name));
            if state.is_ok_and(|state| state.permissions().readonly()) {
                let error = io::ErrorKind::PermissionDenied.into();
                return Err(failure("write", name, error));
            }
        }
        for (name, (_, text)) in changed {
            replace(&project.dir.join(name), text, None)
                .map_err(|e| failure("write", name, e))?;
        }
        project.tangle()?;
    }
    Ok(changes(before, after))
}

fn changes(old: &[Source], new: &[Source]) -> Vec<String> {
    let mut changes = Vec::new();
    for (old, new) in old.iter().zip(new) {
        let name = text_of(&old.name);
        for (a, b) in hunks(&lines_of(&old.text), &lines_of(&new.text)) {
            let (line, gone, come) = (b.start + 1, a.len(), b.len());
            changes.push(format!("{name}:{line}: -{gone} +{come} lines"));
        }
    }
    changes
}

/// The command `noweb untangle [-C dir] [--record file] [--check]
/// chapter...`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let (project, check) = match parse(args) {
        Ok(parsed) => parsed,
        Err(text) => return streams.misused(text),
    };
    let changes = match untangle(&project, check) {
        Ok(changes) => changes,
        Err(faults) => return streams.fail(&faults),
    };
    let lines = changes.iter().map(|line| format!("{line}\n"));
    let text = bytes_of(&lines.collect::<String>());
    let result = streams.output.write_all(&text);
    let failed = check && !changes.is_empty();
    streams.conclude(result, &[]).max(u8::from(failed))
}
