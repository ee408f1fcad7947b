// Tangled from noweb/chapters/reading.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command `noweb tangle`, and its warnings about a web.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::path::{Component, Path, PathBuf};

use noweb_core::project::plain;
pub use noweb_core::project::{
    Expansion, Plan, Project, Read, Record, differs, expand_sources, hash,
    is_file_name, with_ends,
};

use crate::commonmark::{is_markdown, links};
use crate::diagnostic::{Diagnostic, Faults, Level, shown, text_of};
use crate::filter::quoted as quoted_word;
use crate::markup::Token;
use crate::reading::read;
use crate::stream::lines;
use crate::web::{Chunk, Web, quoted};
use crate::{Streams, error};

/// A project with these chapters, which may be in Markdown.
pub fn of(chapters: Vec<PathBuf>, words: String) -> Project {
    Project { chapters, words, read: Some(read), ..Project::default() }
}

/// A master and, in their order, the chapters that it includes: a file in
/// LaTeX, or the summary of a book in Markdown.
///
/// # Errors
/// A file next to the chapters looks like one and is not included.
pub fn included(dir: &Path, master: &Path) -> io::Result<Vec<PathBuf>> {
    let (beside, chapters) = match master.ends_with("SUMMARY.md") {
        true => ("", in_summary(dir, master)?),
        false => ("chapters", noweb_core::project::included(dir, master)?),
    };
    let kind = master.extension().unwrap_or_default();
    let beside = plain(&master.with_file_name(beside));
    let folder = dir.join(&beside).join(".");
    for entry in fs::read_dir(folder).into_iter().flatten() {
        // Refuse a chapter that is not included
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

fn in_summary(dir: &Path, master: &Path) -> io::Result<Vec<PathBuf>> {
    let text = fs::read(dir.join(master))?;
    let text = std::str::from_utf8(&text).map_err(|e| {
        let line = lines(&text[..=e.valid_up_to()]).count();
        io::Error::other(format!("line {line}: mdBook wants UTF-8"))
    })?;
    let beside = plain(&master.with_file_name(""));
    let mut chapters = vec![plain(master)];
    for path in links(text).iter().map(|l| beside.join(l)) {
        let path = short(&path);
        if is_markdown(path.as_os_str().as_bytes())
            && !chapters.contains(&path)
        {
            chapters.push(path);
        }
    }
    Ok(chapters)
}

fn short(path: &Path) -> PathBuf {
    let join = |path: PathBuf, part| match (part, path.file_name()) {
        (Component::ParentDir, Some(_)) => path.with_file_name(""),
        _ => path.join(part),
    };
    plain(&path.components().fold(PathBuf::new(), join))
}

/// The record that was kept, if nobody names it.
fn find_record(project: &Project) -> PathBuf {
    let own = PathBuf::from(".tangled");
    if project.dir.join(&own).exists() {
        return own;
    }
    let files = project.expand().map_or(Vec::new(), |all| all.files);
    let above = files.iter().flat_map(|(path, _)| path.ancestors());
    let mut records = above.map(|above| above.join(&own));
    let has = |record: &Record| {
        let made = |path| files.iter().any(|(file, _)| file == path);
        !record.is_empty() && record.iter().all(|(path, _)| made(path))
    };
    records.find(|path| has(&project.read_record(path))).unwrap_or(own)
}

/// An argument as a word of a shell, behind a space.
pub fn word(arg: &OsStr) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./".contains(c);
    match shown(arg) {
        bare if bare.chars().all(plain) => format!(" {bare}"),
        _ => shown(quoted_word(arg)),
    }
}

const NO_FILE: &str = "a file is named like src/main.rs, without spaces \
    and inside the project";

/// Chunks that are lost: never used, or in a cycle that no root reaches.
///
/// Files and the default root need no use.
pub fn unused(web: &Web) -> Faults {
    let used = |c: &Chunk| web.uses.contains_key(&c.name);
    let mut marked = vec![false; web.chunks.len()];
    let tops = (0..marked.len()).filter(|n| !used(&web.chunks[*n]));
    tops.for_each(|top| mark_below(web, top, &mut marked));
    let mut faults = Vec::new();
    for (index, chunk) in web.chunks.iter().enumerate() {
        let name = quoted(&chunk.name);
        if !used(chunk) && chunk.name != b"*" && !is_file_name(&chunk.name)
        {
            let text = format!("chunk {name} is never used");
            let file = [b"./", &chunk.name[..]].concat();
            let named =
                format!("if it is a file, call it {}", text_of(&file));
            let is_file = is_file_name(&file) && chunk.name[0] != b'/';
            let help = if is_file { &named } else { NO_FILE };
            faults.push(warn(web, chunk, text).with_help(help));
        } else if used(chunk) && !marked[index] {
            // Report the chunk if it marks itself
            mark_below(web, index, &mut marked);
            if marked[index] {
                let text = format!("no root reaches {name}, in a cycle");
                faults.push(warn(web, chunk, text));
            }
        }
    }
    faults
}

pub fn warn(web: &Web, chunk: &Chunk, text: String) -> Diagnostic {
    let position = web.position(chunk.definitions[0]);
    Diagnostic::new(Level::Warning, position, text)
}

fn mark_below(web: &Web, chunk: usize, marked: &mut [bool]) {
    let mut waiting = vec![chunk];
    while let Some(chunk) = waiting.pop() {
        let pieces = web.chunks[chunk].pieces.iter();
        for (_, name, _) in pieces.filter(|p| p.0 == Token::Use) {
            let Some(used) = web.find(name) else { continue };
            if !std::mem::replace(&mut marked[used], true) {
                waiting.push(used);
            }
        }
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
    let plan = match plan {
        Ok(plan) => plan,
        Err(faults) => return streams.fail(&faults),
    };
    let mut faults = unused(&plan.program.web);
    let stale = plan.stale.iter().chain(&plan.removed);
    for path in stale.filter(|_| check) {
        faults.extend(error(format!("{} is out of date", shown(path))));
    }
    u8::from(streams.conclude(Ok(()), &faults) > Level::Warning as u8)
}

/// The project that the arguments name, and whether only to check.
pub fn parse(args: &[OsString]) -> Result<(Project, bool), String> {
    let all = args.iter().filter(|arg| *arg != "--check");
    let words = all.map(|arg| word(arg)).collect();
    let mut project = of(Vec::new(), words);
    let mut check = false;
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        // Parse an option or a chapter
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
        project.record = find_record(&project);
    }
    Ok((project, check))
}
