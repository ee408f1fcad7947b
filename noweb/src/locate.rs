// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Positions of the program and of the chapters, in both directions.
//!
//! The program is tangled in memory. Columns are bytes, from 1, unless
//! they are said to be characters.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::ops::Range;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use crate::Streams;
use crate::diagnostic::{Diagnostic, Level, Place, Position, Source};
use crate::project::{Expansion, Project, included};
use crate::tangle::{Segment, Tangled};
use crate::web::{Web, quoted};

// Define an atlas of the program
/// A program in memory, and the chapters that it comes from.
pub struct Atlas {
    dir: PathBuf,
    web: Web,
    files: BTreeMap<PathBuf, TangledFile>,
}

/// A file of the program.
pub struct TangledFile {
    source: Source,
    /// Where the text of the source comes from; its own text is empty.
    tangled: Tangled,
    /// The file on the disk is the same.
    fresh: OnceCell<bool>,
}

// Read the program and find files
impl Atlas {
    /// Tangles a project in memory.
    ///
    /// # Errors
    ///
    /// Those of [`Project::expand`].
    pub fn read(project: &Project) -> Result<Self, Vec<Diagnostic>> {
        let Expansion { web, files, .. } = project.expand()?;
        let dir = fs::canonicalize(&project.dir);
        let dir = dir.unwrap_or_else(|_| project.dir.clone());
        let files = files.into_iter().map(|(path, mut tangled)| {
            let name = path.as_os_str().as_bytes().to_vec();
            let text = std::mem::take(&mut tangled.text);
            let source = Source::new(name, text);
            let fresh = OnceCell::new();
            (path, TangledFile { source, tangled, fresh })
        });
        Ok(Self { dir, web, files: files.collect() })
    }

    // Find a file and its state
    /// The file of the program that a path means, if that is clear.
    pub fn find(&self, path: &Path) -> Option<&TangledFile> {
        if let Ok(path) = path.strip_prefix(&self.dir) {
            return self.files.get(path);
        }
        let Ok(path) = path.strip_prefix(".") else {
            return self.files.get(path);
        };
        // Look for the only file with this end
        let ending = self.files.iter().filter(|(p, _)| p.ends_with(path));
        let ending: Vec<&TangledFile> = ending.map(|(_, f)| f).collect();
        match ending[..] {
            [file] => Some(file),
            _ => None,
        }
    }

    /// Is the file on the disk what the chapters give?
    pub fn is_fresh(&self, file: &TangledFile) -> bool {
        *file.fresh.get_or_init(|| {
            let path = OsStr::from_bytes(&file.source.name);
            let disk = fs::read(self.dir.join(path));
            disk.is_ok_and(|disk| disk == file.source.text)
        })
    }

    /// The files that were found not to be.
    pub fn stale(&self) -> impl Iterator<Item = &Path> {
        let stale = |f: &TangledFile| f.fresh.get() == Some(&false);
        let files = self.files.iter().filter(move |(_, file)| stale(file));
        files.map(|(path, _)| path.as_path())
    }

    /// The position of a place in a chapter, for people.
    pub fn position(&self, place: Place) -> Option<Position> {
        self.web.position(place)
    }

    /// A chapter, by the number that places carry.
    pub fn chapter(&self, file: u32) -> Option<&Source> {
        self.web.sources.get(file as usize)
    }

    /// A file of the project that is not tangled, if it can be read.
    pub fn other(&self, path: &str) -> Option<Source> {
        let text = fs::read(self.dir.join(path)).ok()?;
        Some(Source::new(path.into(), text))
    }
}

// Go from the program to chapters
impl TangledFile {
    /// Where a position comes from; its column counts characters.
    pub fn origin(&self, line: u32, column: u32) -> Option<Place> {
        let column = self.source.byte_column(line, column);
        self.tangled.origin(line, column)
    }

    // Find the stretches of a span
    /// The segments of the text with their lengths in bytes.
    fn segments(&self) -> impl Iterator<Item = (Segment, u32)> {
        let map = &self.tangled.map;
        let next = map.iter().skip(1).map(Some).chain([None]);
        map.iter().zip(next).map(|(segment, next)| {
            let line = self.source.line(segment.line).unwrap_or(b"");
            let end = match next.filter(|next| next.line == segment.line) {
                Some(next) => next.column,
                None => line.len() as u32 + 1,
            };
            (*segment, end.saturating_sub(segment.column))
        })
    }

    /// What a span covers: the places, and how many bytes from each.
    fn covered(&self, span: Range<(u32, u32)>) -> Vec<(Place, u32)> {
        let cut = |(segment, length): (Segment, u32)| {
            let Segment { line, column, place, .. } = segment;
            let (_, from) = (line, column).max(span.start);
            let (_, to) = (line, column + length).min(span.end);
            let column = place.column + from - column;
            let length = to.checked_sub(from).filter(|l| *l > 0)?;
            Some((Place { column, ..place }, length))
        };
        let lines = span.start.0..=span.end.0;
        let within = |s: &Segment| lines.contains(&s.line);
        let segments = self.segments().filter(|(s, _)| within(s));
        segments.filter_map(cut).collect()
    }

    /// By how much tangling has indented a line.
    pub fn added_indentation(&self, line: u32) -> usize {
        let map = &self.tangled.map;
        let first = map.partition_point(|segment| segment.line < line);
        let first = map.get(first).filter(|segment| segment.line == line);
        first.map_or(0, |segment| {
            segment.column.saturating_sub(segment.place.column) as usize
        })
    }
}

impl Atlas {
    /// The name of the chunk that a place of the program stands in.
    pub fn chunk_at(&self, place: Place) -> Option<&[u8]> {
        let above =
            |d: &&Place| d.file == place.file && d.line < place.line;
        let last = |name, defined: &[Place]| {
            let lines = defined.iter().filter(above).map(|d| d.line);
            Some((lines.max()?, name))
        };
        let chunks = self.web.chunks.iter();
        let last = chunks.filter_map(|c| last(&c.name, &c.definitions));
        last.max().map(|(_, name): (u32, &Vec<u8>)| &name[..])
    }

    // Find a span in the chapters
    /// The stretches of chapters that a span of the program covers.
    ///
    /// Its lines and columns are those of rustc, in characters, the end
    /// not included. A stretch is a chapter and a range of its bytes.
    pub fn stretches(
        &self,
        file: &TangledFile,
        [from, to]: [(u32, u32); 2],
    ) -> Vec<(u32, Range<usize>)> {
        let byte = |(line, c)| (line, file.source.byte_column(line, c));
        let mut found: Vec<(u32, Range<usize>)> = Vec::new();
        for (place, length) in file.covered(byte(from)..byte(to)) {
            let Some(chapter) = self.chapter(place.file) else { continue };
            // Add a piece to the last stretch or begin one
            let end = Place { column: place.column + length, ..place };
            let range = chapter.offset(place)..chapter.offset(end);
            let skipped = |b: &u8| b.is_ascii_whitespace() || *b == b'@';
            let text = &chapter.text;
            if text[range.clone()].iter().all(u8::is_ascii_whitespace) {
                continue;
            }
            match found.last_mut() {
                Some((file, last))
                    if *file == place.file
                        && last.end <= range.start
                        && text[last.end..range.start]
                            .iter()
                            .all(skipped) =>
                {
                    last.end = range.end;
                }
                _ => found.push((place.file, range)),
            }
        }
        if found.is_empty() {
            // Find the place of an empty span
            let place = file.origin(from.0, from.1);
            let chapter =
                place.and_then(|p| Some((p, self.chapter(p.file)?)));
            if let Some((place, chapter)) = chapter {
                let at = chapter.offset(place);
                found.push((place.file, at..at));
            }
        }
        found
    }
}

// Go from chapters to the program
impl Atlas {
    /// Where a byte of a chapter, or with column 0 a line, has gone.
    pub fn destinations(&self, place: Place) -> Vec<Position> {
        let here = |s: &Segment| {
            (s.place.file, s.place.line) == (place.file, place.line)
        };
        let mut found = Vec::new();
        for file in self.files.values() {
            let segments = file.segments().filter(|(s, _)| here(s));
            for (segment, length) in segments {
                // Add the destination in this segment
                let first = segment.place.column;
                let inside = match place.column {
                    0 => Some(0),
                    column => column.checked_sub(first),
                };
                if let Some(inside) = inside.filter(|i| *i < length.max(1))
                {
                    let column = segment.column + inside;
                    let Segment { line, .. } = segment;
                    found.push(file.source.position(Place {
                        file: 0,
                        line,
                        column,
                    }));
                }
            }
        }
        // Keep one destination for each line
        if place.column == 0 {
            found.dedup_by(|b: &mut Position, a| {
                (&a.file, a.line) == (&b.file, b.line)
            });
        }
        found
    }
}

// Read the arguments about a project
/// Reads `[-C dir] [--master file] [name...]`; the names are the chapters.
pub fn parse(args: &[OsString]) -> Result<(Project, PathBuf), String> {
    let dir = PathBuf::from(".");
    let mut project = Project { dir, ..Project::default() };
    let mut master = PathBuf::new();
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        let mut value = || {
            let missing = || format!("{} needs a value", arg.display());
            args.next().ok_or_else(missing)
        };
        // Take an option or a name
        match arg.as_encoded_bytes() {
            b"-C" => project.dir = value()?.into(),
            b"--master" => master = value()?.into(),
            [b'-', ..] => {
                return Err(format!("unknown option {}", arg.display()));
            }
            _ => project.chapters.push(arg.into()),
        }
    }
    Ok((project, master))
}

/// Takes the chapters from the master if none is named.
pub fn complete(
    project: &mut Project,
    master: PathBuf,
) -> Result<(), String> {
    if !project.chapters.is_empty() {
        return Ok(());
    }
    let unnamed = master.as_os_str().is_empty();
    let master = if unnamed { only_web(&project.dir)? } else { master };
    let chapters = included(&project.dir, &master);
    let failed = |error| format!("{}: {error}", master.display());
    project.chapters = chapters.map_err(failed)?;
    Ok(())
}

/// The only web in a directory.
fn only_web(dir: &Path) -> Result<PathBuf, String> {
    let entries = fs::read_dir(dir).map_err(|error| error.to_string())?;
    let names = entries.filter_map(|e| Some(e.ok()?.file_name()));
    let names = names.map(PathBuf::from);
    let is_web = |name: &PathBuf| name.extension() == Some("nw".as_ref());
    let mut webs = names.filter(is_web);
    match (webs.next(), webs.next()) {
        (Some(web), None) => Ok(web),
        _ => Err("which chapters? name them, or --master file".into()),
    }
}

// Run the command that translates a position
/// The command `noweb where [-C dir] [--master file]
/// path:line[:column] [chapter...]`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let fault = |text| vec![Diagnostic::new(Level::Error, None, text)];
    let answer = match parse_question(args) {
        Ok((project, question)) => Atlas::read(&project)
            .and_then(|atlas| answer(&atlas, &question).map_err(fault)),
        Err(text) => return streams.misused(text),
    };
    // Print the answer or say why there is none
    match answer {
        Ok((lines, warnings)) => {
            let result = streams.output.write_all(lines.as_bytes());
            streams.conclude(result, &warnings).min(1)
        }
        Err(faults) => streams.conclude(Ok(()), &faults).min(1),
    }
}

/// A position that somebody asks about, in characters; column 0 if none.
struct Question {
    path: PathBuf,
    line: u32,
    column: u32,
}

fn parse_question(
    args: &[OsString],
) -> Result<(Project, Question), String> {
    let (mut project, master) = parse(args)?;
    let example = "where is what? ask for src/main.rs:12 or a chapter:12:5";
    if project.chapters.is_empty() {
        return Err(example.into());
    }
    let asked = project.chapters.remove(0);
    complete(&mut project, master)?;
    let asked = asked.to_string_lossy();
    let question = parse_position(&asked).ok_or(example)?;
    Ok((project, question))
}

fn parse_position(text: &str) -> Option<Question> {
    let text = text.trim_end_matches(':');
    let text = text.strip_prefix("./").unwrap_or(text);
    let (rest, last) = text.rsplit_once(':')?;
    let last = last.parse().ok()?;
    let whole = Question { path: rest.into(), line: last, column: 0 };
    let Some((path, line)) = rest.rsplit_once(':') else {
        return Some(whole);
    };
    let Ok(line) = line.parse() else { return Some(whole) };
    Some(Question { path: path.into(), line, column: last })
}

/// The lines of the answer, and what has to be said with them.
fn answer(
    atlas: &Atlas,
    question: &Question,
) -> Result<(String, Vec<Diagnostic>), String> {
    let Question { path, line, column } = question;
    let shown = path.display();
    if let Some(file) = atlas.find(path) {
        let place = file.origin(*line, (*column).max(1));
        let place = place.ok_or(format!("{shown} has no line {line}"))?;
        let position = atlas.position(place).into_iter();
        let lines = position.map(|at| atlas.describe(at, place)).collect();
        let fresh = atlas.is_fresh(file);
        let stale = (!fresh).then(|| stale_file(path, Level::Warning));
        return Ok((lines, stale.into_iter().collect()));
    }
    // Answer a question about a chapter
    let inside = path.strip_prefix(&atlas.dir).unwrap_or(path);
    let inside = inside.strip_prefix(".").unwrap_or(inside);
    let named =
        |s: &Source| Path::new(OsStr::from_bytes(&s.name)) == inside;
    let mut chapters = atlas.web.sources.iter().zip(0..);
    let Some((chapter, file)) = chapters.find(|(s, _)| named(s)) else {
        return Err(format!("{shown} is neither tangled nor a chapter"));
    };
    let bytes = chapter.byte_column(*line, *column);
    let column = if *column == 0 { 0 } else { bytes };
    let place = Place { file, line: *line, column };
    let found = atlas.destinations(place).into_iter();
    let lines: String = found.map(|at| atlas.describe(at, place)).collect();
    match lines.is_empty() {
        true => Err(format!("{shown}:{line} goes into no file")),
        false => Ok((lines, Vec::new())),
    }
}

impl Atlas {
    /// A line of an answer: a position, and the chunk of a place.
    fn describe(&self, position: Position, place: Place) -> String {
        let name = self.chunk_at(place).map(quoted).unwrap_or_default();
        format!("{position}: {name}\n")
    }
}

/// What to say about positions in a file that is not as tangled.
pub fn stale_file(path: &Path, level: Level) -> Diagnostic {
    let shown = path.display();
    let text = format!("{shown} is not what its chapters give");
    Diagnostic::new(level, None, text)
        .with_help("tangle, or bring an edit home with noweb untangle")
}
