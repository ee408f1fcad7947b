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

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use crate::Streams;
use crate::diagnostic::{Diagnostic, Level, Place, Position, Source};
use crate::project::{Arguments, Expansion, Project};
use crate::tangle::{Segment, Tangled};
use crate::web::{Chunk, Web, quoted};

// Define an atlas of the program
/// The programs of some webs in memory, and the chapters they come from.
#[derive(Default)]
pub struct Atlas {
    dir: PathBuf,
    webs: Vec<Web>,
    files: BTreeMap<PathBuf, TangledFile>,
}

/// A file of a program.
pub struct TangledFile {
    /// The number of its web.
    web: usize,
    source: Source,
    /// Where the text of the source comes from; its own text is empty.
    tangled: Tangled,
    /// The file on the disk is the same.
    pub fresh: bool,
}

// Read the program and find files
impl Atlas {
    /// Adds the program of a project, tangled in memory.
    ///
    /// # Errors
    ///
    /// Those of [`Project::expand`].
    pub fn add(
        &mut self,
        project: &Project,
    ) -> Result<(), Vec<Diagnostic>> {
        let Expansion { web, files, .. } = project.expand()?;
        let dir = project.dir.join(".");
        self.dir = fs::canonicalize(&dir).unwrap_or(dir);
        for (path, tangled) in files {
            // Add a file of the program
            let disk = fs::read(self.dir.join(&path));
            let fresh = disk.is_ok_and(|disk| disk == tangled.text);
            let name = path.as_os_str().as_bytes().to_vec();
            let mut tangled = tangled;
            let text = std::mem::take(&mut tangled.text);
            let source = Source::new(name, text);
            let web = self.webs.len();
            let file = TangledFile { web, source, tangled, fresh };
            self.files.insert(path, file);
        }
        self.webs.push(web);
        Ok(())
    }

    // Find a file and a position
    /// The file of a program that a path means, if that is clear.
    pub fn find(&self, path: &Path) -> Option<&TangledFile> {
        if let Ok(path) = path.strip_prefix(&self.dir) {
            return self.files.get(path);
        }
        let Ok(path) = path.strip_prefix(".") else {
            return self.files.get(path);
        };
        // Look for the only file with this end
        let mut ending =
            self.files.iter().filter(|(p, _)| p.ends_with(path));
        let (_, file) = ending.next()?;
        ending.next().is_none().then_some(file)
    }

    /// The web of a file, and where in it a position comes from; its
    /// column counts characters.
    pub fn origin(
        &self,
        file: &TangledFile,
        line: u32,
        column: u32,
    ) -> Option<(&Web, Place)> {
        let column = file.source.byte_column(line, column);
        let place = file.tangled.origin(line, column)?;
        Some((&self.webs[file.web], place))
    }

    /// Where a byte of a chapter, or with column 0 a line, has gone.
    pub fn destinations(&self, web: &Web, place: Place) -> Vec<Position> {
        let here = |s: &Segment| {
            (s.place.file, s.place.line) == (place.file, place.line)
        };
        let of_web =
            |f: &&TangledFile| std::ptr::eq(&self.webs[f.web], web);
        let mut found = Vec::new();
        for file in self.files.values().filter(of_web) {
            let segments = file.segments().filter(|(s, _)| here(s));
            for (segment, length) in segments {
                // Add the destination in this segment
                let inside = match place.column {
                    0 => Some(0),
                    column => column.checked_sub(segment.place.column),
                };
                let inside = inside.filter(|i| *i < length.max(1));
                if let Some(inside) = inside {
                    let line = segment.line;
                    let column = segment.column + inside;
                    let place = Place { file: 0, line, column };
                    found.push(file.source.position(place));
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

// Go from chapters to the program
/// The name of the chunk that a place of a program stands in.
fn chunk_at(web: &Web, place: Place) -> Option<&[u8]> {
    let above = |d: &&Place| d.file == place.file && d.line < place.line;
    let last = |chunk: &'_ Chunk| {
        chunk.definitions.iter().filter(above).map(|d| d.line).max()
    };
    let chunk = web.chunks.iter().max_by_key(|chunk| last(chunk))?;
    last(chunk).map(|_| &chunk.name[..])
}

impl TangledFile {
    /// The segments of the text with their lengths in bytes.
    fn segments(&self) -> impl Iterator<Item = (&Segment, u32)> {
        let map = &self.tangled.map;
        let next = map.iter().skip(1).map(Some).chain([None]);
        map.iter().zip(next).map(|(segment, next)| {
            let line = self.source.line(segment.line).unwrap_or(b"");
            let next = next.filter(|next| next.line == segment.line);
            let end = next.map_or(line.len() as u32 + 1, |n| n.column);
            (segment, end.saturating_sub(segment.column))
        })
    }
}

// Run the command that translates a position
/// The command `noweb where [-C dir] [--master file]...
/// path:line[:column] [chapter...]`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let fault = |text| vec![Diagnostic::new(Level::Error, None, text)];
    let (projects, question) = match parse_question(args) {
        Ok(parsed) => parsed,
        Err(text) => return streams.misused(text),
    };
    let mut atlas = Atlas::default();
    let read = projects.iter().try_for_each(|p| atlas.add(p));
    let answer =
        read.and_then(|()| answer(&atlas, &question).map_err(fault));
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
) -> Result<(Vec<Project>, Question), String> {
    let mut args = Arguments::parse(args)?;
    let example = "where is what? ask for src/main.rs:12 or a chapter:12:5";
    if args.chapters.is_empty() {
        return Err(example.into());
    }
    let asked = args.chapters.remove(0);
    let question = parse_position(&asked.to_string_lossy());
    Ok((args.projects()?, question.ok_or(example)?))
}

fn parse_position(text: &str) -> Option<Question> {
    let text = text.trim_end_matches(':');
    let text = text.strip_prefix("./").unwrap_or(text);
    let (rest, last) = text.rsplit_once(':')?;
    let last = last.parse().ok()?;
    let inner = rest.rsplit_once(':');
    let inner = inner.and_then(|(p, line)| Some((p, line.parse().ok()?)));
    let (path, line, column) = match inner {
        Some((path, line)) => (path, line, last),
        None => (rest, last, 0),
    };
    Some(Question { path: path.into(), line, column })
}

/// The lines of the answer, and what has to be said with them.
fn answer(
    atlas: &Atlas,
    question: &Question,
) -> Result<(String, Vec<Diagnostic>), String> {
    let Question { path, line, column } = question;
    let shown = path.display();
    if let Some(file) = atlas.find(path) {
        let origin = atlas.origin(file, *line, (*column).max(1));
        let (web, place) =
            origin.ok_or(format!("{shown} has no line {line}"))?;
        let position = web.position(place).into_iter();
        let lines = position.map(|at| describe(at, web, place)).collect();
        let stale = (!file.fresh).then(|| stale_file(path));
        return Ok((lines, stale.into_iter().collect()));
    }
    // Answer a question about a chapter
    // Find the web and the chapter
    let inside = path.strip_prefix(&atlas.dir).unwrap_or(path);
    let inside = inside.strip_prefix(".").unwrap_or(inside);
    let named = |s: &Source| s.name == inside.as_os_str().as_bytes();
    let chapter = |web: &'_ Web| web.sources.iter().position(named);
    let mut webs = atlas.webs.iter();
    let found = webs.find_map(|web| Some((web, chapter(web)?)));
    let Some((web, file)) = found else {
        return Err(format!("{shown} is neither tangled nor a chapter"));
    };
    let bytes = web.sources[file].byte_column(*line, *column);
    let column = if *column == 0 { 0 } else { bytes };
    let place = Place { file: file as u32, line: *line, column };
    let found = atlas.destinations(web, place).into_iter();
    let lines: String = found.map(|at| describe(at, web, place)).collect();
    match lines.is_empty() {
        true => Err(format!("{shown}:{line} goes into no file")),
        false => Ok((lines, Vec::new())),
    }
}

/// A line of an answer: a position, and the chunk of a place.
fn describe(position: Position, web: &Web, place: Place) -> String {
    let name = chunk_at(web, place).map(quoted).unwrap_or_default();
    format!("{position}: {name}\n")
}

/// What to say about positions in a file that is not as tangled.
pub fn stale_file(path: &Path) -> Diagnostic {
    let shown = path.display();
    let text = format!("{shown} is not what its chapters give");
    Diagnostic::new(Level::Warning, None, text)
        .with_help("tangle, or bring an edit home with noweb untangle")
}
