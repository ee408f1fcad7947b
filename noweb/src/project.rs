// Tangled from noweb/chapters/tangle.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! All files of a program from the chapters that define them.
//!
//! Every chunk whose name is the path of a file is tangled to that file.
//! A record of what was tangled tells a file that someone edited by hand
//! from one that is merely out of date. First everything is planned, and
//! only a plan without faults is carried out.

use std::cell::LazyCell;
use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::io;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;

use crate::Streams;
use crate::commonmark::links;
use crate::cpif::{copy_if, replace};
use crate::diagnostic::{
    Diagnostic, Faults, Level, Place, Position, Source, bytes_of, checked,
    error, failure, shown, text_of,
};
use crate::filter::quoted;
use crate::markup::{Token, begins_docs, mark_up};
use crate::stream::{lines, trimmed_lines};
use crate::tangle::{Layout, Tangled, tangle};
use crate::web::{Piece, Web};

#[derive(Clone, Debug, Default)]
pub struct Project {
    /// The directory that all other paths are relative to.
    pub dir: PathBuf,
    /// The record of what was tangled.
    pub record: PathBuf,
    /// The chapters, in the order of the book.
    pub chapters: Vec<PathBuf>,
}

/// A master and, in their order, the chapters that it includes.
pub fn included(dir: &Path, master: &Path) -> io::Result<Vec<PathBuf>> {
    let text = fs::read(dir.join(master))?;
    let kind = master.extension().unwrap_or_default();
    let (beside, names) = match master.ends_with("SUMMARY.md") {
        true => ("", links(in_mdbook(&text)?)),
        false => ("chapters", includes(&text)),
    };
    let beside = plain(&master.with_file_name(beside));
    let mut chapters = vec![plain(master)];
    for path in names.iter().map(|name| short(&beside.join(name))) {
        // Add a chapter to those before
        if path.extension() == Some(kind) && !chapters.contains(&path) {
            chapters.push(path);
        }
    }
    // Refuse chapters that are not included
    let folder = dir.join(&beside).join(".");
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let name = entry?.file_name();
        let path = beside.join(&name);
        let hidden = name.as_bytes().starts_with(b".");
        let is_chapter = path.extension() == Some(kind);
        if is_chapter && !hidden && !chapters.contains(&path) {
            let (path, master) = (shown(path), shown(master));
            let text = format!("{master} does not include {path}");
            return Err(io::Error::other(text));
        }
    }
    Ok(chapters)
}

fn plain(path: &Path) -> PathBuf {
    path.strip_prefix(".").unwrap_or(path).components().collect()
}

fn short(path: &Path) -> PathBuf {
    let join = |path: PathBuf, part| match (part, path.file_name()) {
        (Component::ParentDir, Some(_)) => path.with_file_name(""),
        _ => path.join(part),
    };
    plain(&path.components().fold(PathBuf::new(), join))
}

fn in_mdbook(text: &[u8]) -> io::Result<&str> {
    std::str::from_utf8(text).map_err(|e| {
        let line = lines(&text[..=e.valid_up_to()]).count();
        io::Error::other(format!("line {line}: mdBook wants UTF-8"))
    })
}

/// The names of the files that the prose of a master includes.
fn includes(text: &[u8]) -> Vec<OsString> {
    let mut is_code = false;
    let prose = trimmed_lines(text).filter(|line| {
        let begins = line.starts_with(b"<<") && line.ends_with(b">>=");
        is_code = begins || is_code && !begins_docs(line);
        !is_code
    });
    let name = |line: &[u8]| {
        let name = line.strip_prefix(br"\include{")?;
        let end = name.iter().position(|b| *b == b'}')?;
        Some(OsString::from_vec([&name[..end], b".nw"].concat()))
    };
    prose.filter_map(name).collect()
}

#[derive(Clone, Debug)]
pub struct Output {
    /// Its path, relative to the directory of the project.
    pub path: PathBuf,
    pub tangled: Tangled,
    /// It is missing or differs on the disk, ends of lines aside.
    pub changed: bool,
}

/// What tangling a project does.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    pub outputs: Vec<Output>,
    pub removed: Vec<PathBuf>,
    pub warnings: Faults,
    /// What was tangled last; after tangling, what was tangled now.
    pub record: Record,
}

#[derive(Clone, Debug)]
pub struct Expansion {
    pub web: Web,
    pub files: Vec<(PathBuf, Tangled)>,
}

/// Is the name of a chunk the path of a file?
/// It has a slash or a dot, no space, and leads nowhere outside.
pub fn is_file_name(name: &[u8]) -> bool {
    let inside = |c: Component| matches!(c, Component::Normal(_));
    let path = plain(Path::new(OsStr::from_bytes(name)));
    name.iter().any(|b| b"/.".contains(b))
        && !name.iter().any(u8::is_ascii_whitespace)
        && !name.ends_with(b"/")
        && path != Path::new("")
        && path.components().all(inside)
}

/// The tangled files, with the hashes of their texts.
pub type Record = BTreeSet<(PathBuf, u64)>;

/// A text whose lines have or have not a return at their ends.
pub fn with_ends(text: &[u8], returns: bool) -> Vec<u8> {
    let lines = text.split(|b| *b == b'\n');
    let lines = lines.map(|line| line.strip_suffix(b"\r").unwrap_or(line));
    let end: &[u8] = if returns { b"\r\n" } else { b"\n" };
    lines.collect::<Vec<_>>().join(end)
}

/// The 64-bit hash of Fowler, Noll and Vo, in its variant 1a, whatever the
/// ends of lines.
pub fn hash(text: &[u8]) -> u64 {
    let text = with_ends(text, false);
    text.iter().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3)
    })
}

fn parse_record(text: &[u8]) -> Record {
    let entry = |line: &[u8]| {
        let (hash, path) = line.split_at_checked(16)?;
        let path = OsStr::from_bytes(path.strip_prefix(b" ")?);
        let hash = u64::from_str_radix(&text_of(hash), 16).ok()?;
        Some((PathBuf::from(path), hash))
    };
    trimmed_lines(text).filter_map(entry).collect()
}

fn format_record(record: &Record) -> Vec<u8> {
    let entry = |(path, hash): &_| format!("{hash:016x} {}\n", shown(path));
    bytes_of(&record.iter().map(entry).collect::<String>())
}

impl Project {
    /// What there is to write, without writing it.
    pub fn plan(&self) -> Result<Plan, Faults> {
        let Expansion { web, files } = self.expand()?;
        let record = self.read_record(&self.record);
        let removed = self.removals(&files, &record)?;
        let (mut outputs, mut faults) = (Vec::new(), Vec::new());
        let args = LazyCell::new(|| self.words());
        for (path, tangled) in files {
            // Compare a file with its text
            let disk = fs::read(self.dir.join(&path)).unwrap_or_default();
            let differs = differs(&disk, &tangled.text);
            if differs && !record.contains(&(path.clone(), hash(&disk))) {
                let mut marks = conflicts(&path, &disk, &tangled.text);
                if marks.is_empty() {
                    marks.push(refuse(&path, &disk, &tangled, &web, &args));
                }
                faults.extend(marks);
            }
            let changed = differs || disk.is_empty();
            outputs.push(Output { path, tangled, changed });
        }
        let warnings = web.unused(is_file_name);
        checked(Plan { outputs, removed, warnings, record }, faults)
    }

    /// The files that the chapters define, without a look at the files.
    pub fn expand(&self) -> Result<Expansion, Faults> {
        let (mut sources, mut faults) = (Vec::new(), Vec::new());
        for chapter in &self.chapters {
            let name = chapter.as_os_str().as_bytes().to_vec();
            match fs::read(self.dir.join(chapter)) {
                Ok(text) => {
                    faults.extend(conflicts(chapter, &text, b""));
                    sources.push(Source::new(name, text));
                }
                Err(e) => faults.extend(failure("read", chapter, e)),
            }
        }
        checked(sources, faults).and_then(expand_sources)
    }

    pub fn read_record(&self, path: &Path) -> Record {
        let text = fs::read(self.dir.join(path));
        parse_record(&text.unwrap_or_default())
    }

    /// The record that was kept, if nobody names it.
    fn find_record(&self) -> PathBuf {
        let own = PathBuf::from(".tangled");
        if self.dir.join(&own).exists() {
            return own;
        }
        let files = self.expand().map_or(Vec::new(), |all| all.files);
        let above = files.iter().flat_map(|(path, _)| path.ancestors());
        let mut records = above.map(|above| above.join(&own));
        let has = |record: &Record| {
            let made = |path| files.iter().any(|(file, _)| file == path);
            !record.is_empty() && record.iter().all(|(path, _)| made(path))
        };
        records.find(|path| has(&self.read_record(path))).unwrap_or(own)
    }

    /// What follows the name of a command on this project, for a shell.
    pub fn words(&self) -> String {
        let all = &self.chapters;
        let of = included(&self.dir, &all[0]);
        let count =
            if of.is_ok_and(|of| of == *all) { 1 } else { all.len() };
        let mut words = Vec::new();
        let none = Path::new("");
        if self.dir != none {
            words.extend(["-C".into(), self.dir.clone()]);
        }
        if self.record != none && self.record != self.find_record() {
            words.extend(["--record".into(), self.record.clone()]);
        }
        words.extend(all[..count].iter().map(|path| {
            let dash = path.as_os_str().as_bytes().starts_with(b"-");
            Path::new(if dash { "." } else { "" }).join(path)
        }));
        let plain =
            |c: char| c.is_ascii_alphanumeric() || "-_./".contains(c);
        let word = |word: &PathBuf| match shown(word) {
            bare if bare.chars().all(plain) => format!(" {bare}"),
            _ => shown(quoted(word.as_os_str())),
        };
        words.iter().map(word).collect()
    }

    /// The recorded files that no chunk defines any more.
    pub fn removals(
        &self,
        files: &[(PathBuf, Tangled)],
        record: &Record,
    ) -> Result<Vec<PathBuf>, Faults> {
        let gone = |path: &&PathBuf| files.iter().all(|(p, _)| p != *path);
        let gone = record.iter().map(|(path, _)| path).filter(gone);
        let (edited, rest): (Vec<_>, _) = gone.cloned().partition(|path| {
            let disk = fs::read(self.dir.join(path)).unwrap_or_default();
            let last = (path.clone(), hash(&disk));
            differs(&disk, b"") && !record.contains(&last)
        });
        checked(rest, edited.iter().map(|path| orphan(path)).collect())
    }
}

/// The files that some sources define, without looking at the disk.
pub fn expand_sources(sources: Vec<Source>) -> Result<Expansion, Faults> {
    let (mut web, mut faults) = Web::read(sources, 0);
    for chunk in &mut web.chunks {
        // Drop the returns at the ends of lines
        let mut ends = true;
        for (piece, _) in chunk.pieces.iter_mut().rev() {
            if ends && let Piece::Text(text) = piece {
                text.pop_if(|last| *last == b'\r');
            }
            ends = *piece == Piece::Newline;
        }
    }
    let mut files = Vec::new();
    for chunk in &web.chunks {
        // Expand the file of this chunk
        let name = &chunk.name[..];
        if web.uses.contains_key(name) || !is_file_name(name) {
            continue;
        }
        let path = plain(Path::new(OsStr::from_bytes(name)));
        if files.iter().any(|(other, _)| *other == path) {
            let position = web.position(chunk.definitions[0]);
            let text = "another chunk is this file";
            faults.push(Diagnostic::new(Level::Error, position, text));
        }
        let rust = name.ends_with(b".rs");
        let layout = Layout { rust, ..Layout::default() };
        match tangle(&web, &[name], &layout) {
            Ok(mut tangled) => {
                // Put the returns back
                let head = chunk.definitions[0];
                let source = &web.sources[head.file as usize];
                let line = source.line(head.line).unwrap_or_default();
                if line.ends_with(b"\r") {
                    tangled.text = with_ends(&tangled.text, true);
                }
                files.push((path, tangled));
            }
            Err(more) => faults.extend(more),
        }
    }
    checked(Expansion { web, files }, faults)
}

/// The lines by which git marks conflicts that a text does not mean, nor
/// one that was made in its place.
pub fn conflicts(path: &Path, text: &[u8], made: &[u8]) -> Faults {
    let made: BTreeSet<_> = lines(made).collect();
    let mut all: Vec<_> = lines(text).collect();
    // Gather the marks of conflicts
    let mark = |(line, text): (usize, &&[u8])| {
        let sign = *text.first().filter(|sign| b"<|=>".contains(sign))?;
        let rest = text.strip_prefix(&[sign; 7])?;
        let ends = rest.first().is_none_or(u8::is_ascii_whitespace);
        ends.then_some((line, sign))
    };
    let marks: Vec<_> = all.iter().enumerate().filter_map(mark).collect();
    let groups = marks.chunk_by(|_, (_, sign)| *sign != b'<');
    let groups = groups.filter_map(|marks| {
        let end = marks.iter().position(|(_, sign)| *sign == b'>')?;
        let is_whole = matches!(marks[..end], [(_, b'<'), .., (_, b'=')]);
        let is_new = is_whole && !made.contains(all[marks[0].0]);
        is_new.then_some(&marks[..=end])
    });
    let mut found: Vec<_> = groups.collect();
    if found.is_empty() {
        return Vec::new();
    }
    // See which conflicts are no samples
    for marks in &found {
        all[marks[0].0] = b"<<<<>>=";
        all[marks[0].0 + 1] = b"@";
    }
    let name = path.as_os_str().as_bytes().to_vec();
    let source = Source::new(name, all.join(&b'\n'));
    let (lexemes, _) = mark_up(&source, 0, 0);
    let chunk = Token::Defn(b"<<".to_vec());
    let chunks = lexemes.iter().filter(|(token, _)| *token == chunk);
    let real: BTreeSet<_> =
        chunks.map(|(_, place)| place.line as usize - 1).collect();
    let fault = |(line, _): &_| {
        edit_fault(path, *line, "a conflict of git is not resolved here")
            .with_help("keep what holds, and remove the line")
    };
    found.retain(|marks| real.contains(&marks[0].0));
    found.into_iter().flatten().map(fault).collect()
}

/// A fault of a line of a file, counted from 0.
pub fn edit_fault(path: &Path, line: usize, text: &str) -> Diagnostic {
    let (file, line) = (shown(path), line as u32 + 1);
    let position = Position { file, line, column: 1, excerpt: None };
    Diagnostic::new(Level::Error, Some(position), text)
}

fn orphan(path: &Path) -> Diagnostic {
    let path = shown(path);
    let text = format!("no chunk defines {path}, an edited file");
    let help = format!("move the edit to a chapter, or delete {path}");
    Diagnostic::new(Level::Error, None, text).with_help(help)
}

/// Is a file another text, ends of lines aside? None without a byte is.
pub fn differs(disk: &[u8], text: &[u8]) -> bool {
    let bare = |text: &[u8]| {
        let text = text.strip_suffix(b"\n").unwrap_or(text);
        with_ends(text, false)
    };
    !disk.is_empty() && bare(disk) != bare(text)
}

fn refuse(
    path: &Path,
    disk: &[u8],
    tangled: &Tangled,
    web: &Web,
    words: &str,
) -> Diagnostic {
    let disk = with_ends(disk, false);
    let now = with_ends(&tangled.text, false);
    let (line, column) = first_difference(&disk, &now);
    let file = Source::new(shown(path).into(), disk);
    let position = file.position(Place { file: 0, line, column });
    let text = "this file was edited by hand since it was tangled";
    let mut fault = Diagnostic::new(Level::Error, Some(position), text);
    // Say where the edited line comes from
    let last = tangled.map.last().map(|segment| segment.place);
    let origin = tangled.origin(line, 1).or(last);
    let origin = origin.and_then(|place| web.position(place));
    if let Some(Position { file, line, .. }) = origin {
        let help = format!("the line comes from {file}:{line}");
        fault = fault.with_help(help);
    }
    fault
        .with_help(format!("to carry it there: noweb untangle{words}"))
        .with_help(format!("delete {} to drop the edit", shown(path)))
}

fn first_difference(a: &[u8], b: &[u8]) -> (u32, u32) {
    let pairs = a.iter().zip(b);
    let same = pairs.take_while(|(x, y)| x == y).count();
    let before = &a[..same];
    let line = before.iter().filter(|b| **b == b'\n').count() + 1;
    let column = before.iter().rev().take_while(|b| **b != b'\n').count();
    (line as u32, column as u32 + 1)
}

impl Project {
    /// Tangles what is out of date and returns what was planned.
    pub fn tangle(&self) -> Result<Plan, Faults> {
        let mut plan = self.plan()?;
        let result = self.write(&mut plan);
        let text = format_record(&plan.record);
        let recorded = copy_if(&self.dir.join(&self.record), &text)
            .map_err(|e| failure("write", &self.record, e));
        result.and(recorded).map(|()| plan)
    }

    fn write(&self, plan: &mut Plan) -> Result<(), Faults> {
        for output in &plan.outputs {
            self.write_output(output)?;
            let hash = hash(&output.tangled.text);
            plan.record.retain(|(path, _)| *path != output.path);
            plan.record.insert((output.path.clone(), hash));
        }
        for path in &plan.removed {
            // Remove a file that no chunk defines
            match fs::remove_file(self.dir.join(path)) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => {
                    return Err(failure("remove", path, e));
                }
                _ => plan.record.retain(|(other, _)| other != path),
            };
        }
        Ok(())
    }

    fn write_output(&self, output: &Output) -> Result<(), Faults> {
        let path = self.dir.join(&output.path);
        let text = &output.tangled.text;
        if fs::read(&path).is_ok_and(|old| old == *text) {
            return Ok(());
        }
        let time = self.newest(&output.tangled);
        let parent = path.parent().unwrap_or(&self.dir);
        fs::create_dir_all(parent)
            .and_then(|()| replace(&path, text, time))
            .map_err(|e| failure("write", &output.path, e))
    }

    /// The time of the newest chapter that a text takes something from.
    fn newest(&self, tangled: &Tangled) -> Option<SystemTime> {
        let places = tangled.map.iter().map(|segment| segment.place);
        let files: BTreeSet<u32> = places.map(|place| place.file).collect();
        let times = files.iter().filter_map(|file| {
            let chapter = self.chapters.get(*file as usize)?;
            fs::metadata(self.dir.join(chapter)).ok()?.modified().ok()
        });
        times.max()
    }
}

/// The command `noweb tangle [-C dir] [--record file] [--check]
/// chapter...`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let (project, check) = match parse(args) {
        Ok(parsed) => parsed,
        Err(text) => return streams.misused(text),
    };
    let plan = if check { project.plan() } else { project.tangle() };
    let faults = match plan {
        Ok(plan) if check => report_stale(plan),
        Ok(plan) => plan.warnings,
        Err(faults) => return streams.fail(&faults),
    };
    u8::from(streams.conclude(Ok(()), &faults) > Level::Warning as u8)
}

fn report_stale(plan: Plan) -> Faults {
    let changed = plan.outputs.iter().filter(|output| output.changed);
    let stale = changed.map(|output| &output.path).chain(&plan.removed);
    let fault = |path| error(format!("{} is out of date", shown(path)));
    [plan.warnings, stale.flat_map(fault).collect()].concat()
}

/// The project that the arguments name, and whether only to check.
pub fn parse(args: &[OsString]) -> Result<(Project, bool), String> {
    let mut project = Project::default();
    let mut check = false;
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        // Take an option or a chapter
        let mut value = || {
            let missing = || format!("{} needs a value", shown(arg));
            args.next().map(PathBuf::from).ok_or_else(missing)
        };
        match arg.as_encoded_bytes() {
            b"-C" => project.dir = value()?,
            b"--record" => project.record = value()?,
            b"--check" => check = true,
            [b'-', ..] => Err(format!("unknown option {}", shown(arg)))?,
            _ => project.chapters.push(arg.into()),
        }
    }
    if let [master] = &project.chapters[..] {
        let chapters = included(&project.dir, master);
        project.chapters = chapters.map_err(|e| {
            format!("cannot read {} and its chapters: {e}", shown(master))
        })?;
    }
    if project.chapters.is_empty() {
        return Err("no chapters to tangle".into());
    }
    if project.record.as_os_str().is_empty() {
        project.record = project.find_record();
    }
    Ok((project, check))
}
