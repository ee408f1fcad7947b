// Tangled from noweb/chapters/core.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! All files of a program from the chapters that define them.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;

use crate::conflict::read;
use crate::cpif::replace;
use crate::diagnostic::{
    Diagnostic, Faults, Level, Position, Source, bytes_of, checked,
    failure, shown, text_of,
};
use crate::markup::{Token, begins_docs, lines, mark_up};
use crate::tangle::{Tangled, tangle};
use crate::web::Web;

/// How a file is read, from its name and its text; an error is what must
/// not be in it, unless the third text has it as well.
pub type Read = fn(Vec<u8>, Vec<u8>, &[u8]) -> Result<Source, Faults>;

#[derive(Clone, Debug, Default)]
pub struct Project {
    /// The directory that all other paths are relative to.
    pub dir: PathBuf,
    /// The record of what was tangled.
    pub record: PathBuf,
    /// The chapters, in the order of the book.
    pub chapters: Vec<PathBuf>,
    /// What follows the name of a command on this project, in a shell.
    pub words: String,
    /// How files are read, if they may have prose in Markdown.
    pub read: Option<Read>,
}

/// A master and, in their order, the chapters that it includes.
///
/// # Errors
/// The master cannot be read.
pub fn included(dir: &Path, master: &Path) -> io::Result<Vec<PathBuf>> {
    let text = with_ends(&fs::read(dir.join(master))?, false);
    let folder = plain(&master.with_file_name("chapters"));
    let mut chapters = vec![plain(master)];
    let mut is_code = false;
    for line in lines(&text) {
        let begins = line.starts_with(b"<<") && line.ends_with(b">>=");
        is_code = begins || is_code && !begins_docs(line);
        // Add a chapter that the prose includes
        let name = line.strip_prefix(br"\include{").filter(|_| !is_code);
        if let Some(name) = name
            && let Some(end) = name.iter().position(|b| *b == b'}')
        {
            let name = [&name[..end], b".nw"].concat();
            let path = folder.join(OsStr::from_bytes(&name));
            if !chapters.contains(&path) {
                chapters.push(path);
            }
        }
    }
    Ok(chapters)
}

/// A path without the names of the directory we are in.
pub fn plain(path: &Path) -> PathBuf {
    path.strip_prefix(".").unwrap_or(path).components().collect()
}

/// Is a name the path of a file: a slash or dot, no space, not outside?
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

/// A line of the record.
fn entry(line: &[u8]) -> Option<(PathBuf, u64)> {
    let (hash, path) = line.split_at_checked(16)?;
    let path = OsStr::from_bytes(path.strip_prefix(b" ")?);
    let hash = u64::from_str_radix(&text_of(hash), 16).ok()?;
    Some((path.into(), hash))
}

#[derive(Clone, Debug)]
pub struct Expansion {
    pub web: Web,
    pub files: Vec<(PathBuf, Tangled)>,
}

/// The files that some sources define, without looking at the disk.
pub fn expand_sources(sources: Vec<Source>) -> Result<Expansion, Faults> {
    let (mut web, mut faults) = Web::read(sources, mark_up);
    for chunk in &mut web.chunks {
        // Drop the returns at the ends of lines
        let mut ends = true;
        for (token, text, _) in chunk.pieces.iter_mut().rev() {
            if ends && *token != Token::Use {
                text.pop_if(|last| *last == b'\r');
            }
            ends = *token == Token::Newline;
        }
    }
    let mut files = Vec::new();
    for (root, chunk) in web.chunks.iter().enumerate() {
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
        match tangle(&web, root, name.ends_with(b".rs")) {
            Ok(mut tangled) => {
                // Restore the returns
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

/// What tangling a project does.
#[derive(Clone, Debug)]
pub struct Plan {
    pub program: Expansion,
    /// The files that are missing or differ, ends of lines aside.
    pub stale: Vec<PathBuf>,
    pub removed: Vec<PathBuf>,
    /// What was tangled last; after tangling, what was tangled now.
    pub record: Record,
}

/// Is a file another text, ends of lines aside? None without a byte is.
pub fn differs(disk: &[u8], text: &[u8]) -> bool {
    let bare = |text: &[u8]| {
        let text = text.strip_suffix(b"\n").unwrap_or(text);
        with_ends(text, false)
    };
    !disk.is_empty() && bare(disk) != bare(text)
}

fn orphan(path: &Path) -> Diagnostic {
    let path = shown(path);
    let text = format!("no chunk defines {path}, an edited file");
    let help = format!("move the edit to a chapter, or delete {path}");
    Diagnostic::new(Level::Error, None, text).with_help(help)
}

impl Project {
    /// The files that the chapters define, without a look at the files.
    pub fn expand(&self) -> Result<Expansion, Faults> {
        let (mut sources, mut faults) = (Vec::new(), Vec::new());
        for chapter in &self.chapters {
            let name = chapter.as_os_str().as_bytes().to_vec();
            let text = fs::read(self.dir.join(chapter));
            let text = text.map_err(|e| failure("read", chapter, e));
            match text.and_then(|text| self.reader()(name, text, b"")) {
                Ok(source) => sources.push(source),
                Err(more) => faults.extend(more),
            }
        }
        checked(sources, faults).and_then(expand_sources)
    }

    pub fn reader(&self) -> Read {
        self.read.unwrap_or(read)
    }

    pub fn read_record(&self, path: &Path) -> Record {
        let text = fs::read(self.dir.join(path)).unwrap_or_default();
        lines(&with_ends(&text, false)).filter_map(entry).collect()
    }

    /// What there is to write, without writing it.
    pub fn plan(&self) -> Result<Plan, Faults> {
        let program = self.expand()?;
        let record = self.read_record(&self.record);
        let removed = self.removals(&program.files, &record)?;
        let (mut stale, mut faults) = (Vec::new(), Vec::new());
        for (path, tangled) in &program.files {
            let disk = fs::read(self.dir.join(path)).unwrap_or_default();
            let differs = differs(&disk, &tangled.text);
            if differs || disk.is_empty() {
                stale.push(path.clone());
            }
            if !differs || record.contains(&(path.clone(), hash(&disk))) {
                continue;
            }
            // Refuse to replace an edited file
            let name = path.as_os_str().as_bytes().to_vec();
            let file = self.reader()(name, disk, &tangled.text);
            let edit =
                |file| vec![self.refuse(&file, tangled, &program.web)];
            faults.extend(file.map_or_else(|marks| marks, edit));
        }
        checked(Plan { program, stale, removed, record }, faults)
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

    fn refuse(
        &self,
        file: &Source,
        tangled: &Tangled,
        web: &Web,
    ) -> Diagnostic {
        let disk = with_ends(&file.text, false);
        let now = with_ends(&tangled.text, false);
        let same =
            disk.iter().zip(&now).take_while(|(a, b)| a == b).count();
        let disk = Source::new(file.name.clone(), disk);
        let position = disk.position(disk.place(same));
        let line = position.line;
        let text = "this file was edited by hand since it was tangled";
        let mut fault = Diagnostic::new(Level::Error, Some(position), text);
        // Report the origin of the edited line
        let last = tangled.map.last().map(|segment| segment.place);
        let origin = tangled.origin(line, 1).or(last);
        let origin = origin.and_then(|place| web.position(place));
        if let Some(Position { file, line, .. }) = origin {
            let help = format!("the line comes from {file}:{line}");
            fault = fault.with_help(help);
        }
        let (words, file) = (&self.words, text_of(&file.name));
        fault
            .with_help(format!("to carry it there: noweb untangle{words}"))
            .with_help(format!("delete {file} to drop the edit"))
    }

    /// Tangles what is out of date and returns what was planned.
    pub fn tangle(&self) -> Result<Plan, Faults> {
        let mut plan = self.plan()?;
        let result = self.write(&mut plan);
        let line =
            |(path, hash): &_| format!("{hash:016x} {}\n", shown(path));
        let text: String = plan.record.iter().map(line).collect();
        let file = self.dir.join(&self.record);
        let recorded = replace(&file, &bytes_of(&text), None)
            .map_err(|e| failure("write", &self.record, e));
        result.and(recorded).map(|()| plan)
    }

    fn write(&self, plan: &mut Plan) -> Result<(), Faults> {
        for (path, tangled) in &plan.program.files {
            // Write one file
            let file = self.dir.join(path);
            let parent = file.parent().unwrap_or(&self.dir);
            fs::create_dir_all(parent)
                .and_then(|()| {
                    replace(&file, &tangled.text, self.newest(tangled))
                })
                .map_err(|e| failure("write", path, e))?;
            plan.record.retain(|(other, _)| other != path);
            plan.record.insert((path.clone(), hash(&tangled.text)));
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
