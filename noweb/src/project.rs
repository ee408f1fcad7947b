// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! All files of a program from the chapters that define them.
//!
//! Every chunk whose name is the path of a file is tangled to that file.
//! A record of what was tangled tells a file that someone edited by hand
//! from one that is merely out of date. First everything is planned, and
//! only a plan without faults is carried out.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{OsStr, OsString};
use std::fs;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;

use crate::Streams;
use crate::cpif::{Attributes, replace};
use crate::diagnostic::{Diagnostic, Level, Position, Source};
use crate::tangle::{Layout, Tangled, tangle};
use crate::web::Web;

// Say what is tangled where
/// Some chapters and what to tangle from them.
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
///
/// # Errors
///
/// A master that cannot be read.
pub fn included(dir: &Path, master: &Path) -> io::Result<Vec<PathBuf>> {
    let text = fs::read_to_string(dir.join(master))?;
    let beside = master.with_file_name("chapters");
    let chapter = |line: &str| {
        let name = line.strip_prefix(r"\include{")?.split_once('}')?.0;
        Some(beside.join(format!("{name}.nw")))
    };
    let chapters = text.lines().filter_map(chapter);
    Ok(std::iter::once(master.to_owned()).chain(chapters).collect())
}

/// A file of the program.
#[derive(Clone, Debug)]
pub struct Output {
    /// Its path, relative to the directory of the project.
    pub path: PathBuf,
    /// Its text and where that comes from.
    pub tangled: Tangled,
    /// It is missing or differs on the disk.
    pub changed: bool,
    /// The time of the newest chapter that it takes something from.
    pub time: Option<SystemTime>,
}

/// What tangling a project does.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    /// All files of the program.
    pub outputs: Vec<Output>,
    /// Files that no chunk defines any more.
    pub removed: Vec<PathBuf>,
    /// What looks wrong in the web.
    pub warnings: Vec<Diagnostic>,
    /// What was tangled last; after tangling, what was tangled now.
    pub record: Record,
}

/// All files of a program, in memory.
#[derive(Clone, Debug)]
pub struct Expansion {
    /// The chunks that the files are made of.
    pub web: Web,
    /// The path of each file, its text and its map.
    pub files: Vec<(PathBuf, Tangled)>,
    /// What is wrong in the chapters.
    pub faults: Vec<Diagnostic>,
}

// Recognise the chunks that are files
/// Is the name of a chunk the path of a file?
///
/// It has a slash or a dot, no space, and leads nowhere outside.
pub fn is_file_name(name: &[u8]) -> bool {
    let inside = |c: Component| matches!(c, Component::Normal(_));
    let path = Path::new(OsStr::from_bytes(name));
    name.iter().any(|b| b"/.".contains(b))
        && !name.iter().any(u8::is_ascii_whitespace)
        && !name.ends_with(b"/")
        && path.components().all(inside)
}

/// The distance of tab stops in a file of this name, or 0 for no tabs.
pub fn tab_stops(path: &Path) -> usize {
    let tabbed = path.file_name().is_some_and(|name| name == "Makefile")
        || path.extension().is_some_and(|e| e == "mk");
    if tabbed { 8 } else { 0 }
}

/// What begins a comment in a file of this name.
pub(crate) fn comment_leader(path: &Path) -> Option<&'static str> {
    match path.extension().and_then(OsStr::to_str) {
        Some("rs") => Some("// "),
        None | Some("sh" | "toml" | "mk" | "py" | "awk") => Some("# "),
        Some("vim") => Some("\" "),
        Some(_) => None,
    }
}

// Keep a record of what was tangled
/// For every tangled file the hash of its text.
pub type Record = BTreeMap<PathBuf, u64>;

/// The 64-bit hash of Fowler, Noll and Vo, in its variant 1a.
pub fn hash(text: &[u8]) -> u64 {
    text.iter().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3)
    })
}

fn parse_record(text: &[u8]) -> Record {
    let entry = |line: &[u8]| {
        let (hash, path) = line.split_at_checked(16)?;
        let hash = std::str::from_utf8(hash).ok()?;
        let hash = u64::from_str_radix(hash, 16).ok()?;
        let path = OsStr::from_bytes(path.strip_prefix(b" ")?);
        Some((PathBuf::from(path), hash))
    };
    text.split(|b| *b == b'\n').filter_map(entry).collect()
}

fn format_record(record: &Record) -> Vec<u8> {
    let mut text = Vec::new();
    for (path, hash) in record {
        text.extend(format!("{hash:016x} ").bytes());
        text.extend(path.as_os_str().as_bytes());
        text.push(b'\n');
    }
    text
}

// Plan what to write
impl Project {
    // Plan one step after the other
    /// What there is to write, without writing it.
    ///
    /// # Errors
    ///
    /// Chapters that cannot be read, everything that is wrong in them,
    /// and files that someone edited by hand.
    pub fn plan(&self) -> Result<Plan, Vec<Diagnostic>> {
        self.plan_files(true)
    }

    /// What there is to write; unguarded, over edits made by hand as well.
    ///
    /// # Errors
    ///
    /// Those of [`Project::plan`]; unguarded, except for edits.
    pub fn plan_files(
        &self,
        guarded: bool,
    ) -> Result<Plan, Vec<Diagnostic>> {
        let (sources, times) = self.read_chapters()?;
        let Expansion { web, files, mut faults } =
            self.expand_sources(sources);
        let record = self.read_record();
        let mut plan = Plan { record, ..Plan::default() };
        for (path, tangled) in files {
            let output = self.compare(&path, tangled, &times);
            if guarded {
                faults.extend(self.refuse(&output, &web, &plan.record));
            }
            plan.outputs.push(output);
        }
        self.plan_removals(&mut plan, &mut faults);
        plan.warnings = web.unused(is_file_name);
        plan.warnings.extend(web.adrift());
        if faults.is_empty() { Ok(plan) } else { Err(faults) }
    }

    /// The files that some sources define, without looking at the disk.
    pub fn expand_sources(&self, sources: Vec<Source>) -> Expansion {
        let (web, mut faults) = Web::read(sources, 0);
        let mut files = Vec::new();
        for chunk in &web.chunks {
            // Expand the file of this chunk
            let name = &chunk.name[..];
            if web.uses.contains_key(name) || !is_file_name(name) {
                continue;
            }
            let path = Path::new(OsStr::from_bytes(name));
            let (tab, comment) = (tab_stops(path), comment_leader(path));
            let layout = Layout { tab, comment, directive: None };
            match tangle(&web, &[name], &layout) {
                Ok(tangled) => files.push((path.to_owned(), tangled)),
                Err(more) => faults.extend(more),
            }
        }
        Expansion { web, files, faults }
    }

    /// The files that the chapters define, without a look at the files.
    ///
    /// # Errors
    ///
    /// Chapters that cannot be read, and everything that is wrong in them.
    pub fn expand(&self) -> Result<Expansion, Vec<Diagnostic>> {
        let expansion = self.expand_sources(self.read_chapters()?.0);
        match expansion.faults.is_empty() {
            true => Ok(expansion),
            false => Err(expansion.faults),
        }
    }

    /// What was tangled last.
    pub fn read_record(&self) -> Record {
        let text = fs::read(self.dir.join(&self.record));
        parse_record(&text.unwrap_or_default())
    }

    /// The chapters and the times of their last changes.
    ///
    /// # Errors
    ///
    /// Every chapter that cannot be read.
    pub fn read_chapters(
        &self,
    ) -> Result<(Vec<Source>, Vec<SystemTime>), Vec<Diagnostic>> {
        let mut sources = Vec::new();
        let mut times = Vec::new();
        let mut faults = Vec::new();
        for chapter in &self.chapters {
            // Read a chapter and its time
            let path = self.dir.join(chapter);
            let time = fs::metadata(&path).and_then(|m| m.modified());
            match fs::read(&path).and_then(|text| Ok((text, time?))) {
                Ok((text, time)) => {
                    let name = chapter.as_os_str().as_bytes().to_vec();
                    sources.push(Source::new(name, text));
                    times.push(time);
                }
                Err(error) => faults.push(failure("read", chapter, &error)),
            }
        }
        if faults.is_empty() { Ok((sources, times)) } else { Err(faults) }
    }

    fn compare(
        &self,
        path: &Path,
        tangled: Tangled,
        times: &[SystemTime],
    ) -> Output {
        let places = tangled.map.iter().map(|segment| segment.place);
        let files: BTreeSet<u32> = places.map(|place| place.file).collect();
        let times = files.iter().filter_map(|f| times.get(*f as usize));
        let time = times.max().copied();
        let old = fs::read(self.dir.join(path)).ok();
        let changed = old.is_none_or(|old| old != tangled.text);
        Output { path: path.to_owned(), tangled, changed, time }
    }

    fn plan_removals(&self, plan: &mut Plan, faults: &mut Vec<Diagnostic>) {
        let kept = plan.outputs.iter().map(|output| &output.path);
        let kept: BTreeSet<&PathBuf> = kept.collect();
        let gone = |path: &&PathBuf| !kept.contains(path);
        for path in plan.record.keys().filter(gone) {
            let text = fs::read(self.dir.join(path)).ok();
            match text.map(|text| hash(&text)) {
                Some(now) if now != plan.record[path] => {
                    faults.push(orphan(path));
                }
                _ => plan.removed.push(path.clone()),
            }
        }
    }
}

/// What to say of a file that could not be read, written or removed.
pub fn failure(action: &str, path: &Path, error: &io::Error) -> Diagnostic {
    let text = format!("cannot {action} {}: {error}", path.display());
    Diagnostic::new(Level::Error, None, text)
}

fn orphan(path: &Path) -> Diagnostic {
    let shown = path.display();
    let text = format!("no chunk defines {shown}, an edited file");
    let help = format!("move the edit to a chapter, or delete {shown}");
    Diagnostic::new(Level::Error, None, text).with_help(help)
}

// Refuse to lose an edit
impl Project {
    fn refuse(
        &self,
        output: &Output,
        web: &Web,
        record: &Record,
    ) -> Option<Diagnostic> {
        let disk = fs::read(self.dir.join(&output.path)).ok()?;
        let recorded = record.get(&output.path) == Some(&hash(&disk));
        let known = recorded || disk.is_empty();
        if known || !output.changed {
            return None;
        }
        let (line, column) = first_difference(&disk, &output.tangled.text);
        let path = output.path.as_os_str().as_bytes();
        let file = Source::new(path.to_vec(), disk);
        // Say where the edited line comes from
        let shown = output.path.display();
        let place = file_place(line, column);
        let text = "this file was edited by hand since it was tangled";
        let position = Some(file.position(place));
        let mut fault = Diagnostic::new(Level::Error, position, text);
        let map = &output.tangled.map;
        let origin = output.tangled.origin(line, 1);
        let origin = origin.or(map.last().map(|segment| segment.place));
        if let Some(at) = origin.and_then(|place| web.position(place)) {
            let Position { file, line, .. } = at;
            let help = format!("the line comes from {file}:{line}");
            fault = fault.with_help(help);
        }
        let fault =
            fault.with_help("`noweb untangle' carries the edit there");
        Some(fault.with_help(format!("delete {shown} to drop the edit")))
    }
}

fn file_place(line: u32, column: u32) -> crate::diagnostic::Place {
    crate::diagnostic::Place { file: 0, line, column }
}

/// The first line and column, from 1, at which two texts differ.
fn first_difference(a: &[u8], b: &[u8]) -> (u32, u32) {
    let pairs = a.iter().zip(b);
    let same = pairs.take_while(|(x, y)| x == y).count();
    let before = &a[..same];
    let line = before.iter().filter(|b| **b == b'\n').count() + 1;
    let column = before.iter().rev().take_while(|b| **b != b'\n').count();
    (line as u32, column as u32 + 1)
}

// Carry out the plan
impl Project {
    // Write files, record and all
    /// Tangles what is out of date and returns what was planned.
    ///
    /// # Errors
    ///
    /// Those of [`Project::plan`], after which nothing is written, and
    /// files that cannot be written.
    pub fn tangle(&self) -> Result<Plan, Vec<Diagnostic>> {
        self.carry_out(self.plan()?)
    }

    /// The same, over edits made by hand, which the chapters now have.
    ///
    /// # Errors
    ///
    /// Those of [`Project::tangle`], except for edits.
    pub fn overwrite(&self) -> Result<Plan, Vec<Diagnostic>> {
        self.carry_out(self.plan_files(false)?)
    }

    fn carry_out(&self, mut plan: Plan) -> Result<Plan, Vec<Diagnostic>> {
        let result = self.write(&mut plan);
        let recorded = self.write_record(&plan.record);
        result.and(recorded).map_err(|fault| vec![fault])?;
        Ok(plan)
    }

    fn write(&self, plan: &mut Plan) -> Result<(), Diagnostic> {
        for output in &plan.outputs {
            self.write_output(output)?;
            let hash = hash(&output.tangled.text);
            plan.record.insert(output.path.clone(), hash);
        }
        for path in &plan.removed {
            // Remove a file that no chunk defines
            match fs::remove_file(self.dir.join(path)) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => {
                    return Err(failure("remove", path, &e));
                }
                _ => plan.record.remove(path),
            };
        }
        Ok(())
    }

    fn write_output(&self, output: &Output) -> Result<(), Diagnostic> {
        if !output.changed {
            return Ok(());
        }
        let path = self.dir.join(&output.path);
        let text = &output.tangled.text;
        let executable = text.starts_with(b"#!");
        let attributes = Attributes { time: output.time, executable };
        let parent = path.parent().unwrap_or(&self.dir);
        fs::create_dir_all(parent)
            .and_then(|()| replace(&path, text, attributes))
            .map_err(|error| failure("write", &output.path, &error))
    }

    fn write_record(&self, record: &Record) -> Result<(), Diagnostic> {
        let path = self.dir.join(&self.record);
        let text = format_record(record);
        crate::cpif::update(&path, &text)
            .map(|_| ())
            .map_err(|error| failure("write", &self.record, &error))
    }
}

// Run the command that tangles a project
/// The command `noweb tangle [-C dir] [--record file] [--check]
/// chapter...`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let (project, check) = match one_project(args) {
        Ok(parsed) => parsed,
        Err(text) => return streams.misused(text),
    };
    let plan = if check { project.plan() } else { project.tangle() };
    let (faults, failed) = match plan {
        Ok(plan) if check => report_stale(plan),
        Ok(plan) => (plan.warnings, false),
        Err(faults) => (faults, true),
    };
    streams.conclude(Ok(()), &faults);
    u8::from(failed)
}

/// The files that tangling would write or remove.
fn report_stale(plan: Plan) -> (Vec<Diagnostic>, bool) {
    let changed = plan.outputs.iter().filter(|output| output.changed);
    let changed = changed.map(|output| &output.path);
    let stale: Vec<&PathBuf> = changed.chain(&plan.removed).collect();
    let mut faults = plan.warnings;
    for path in &stale {
        let text = format!("{} is out of date", path.display());
        faults.push(Diagnostic::new(Level::Error, None, text));
    }
    (faults, !stale.is_empty())
}

/// What the arguments of a command say about projects.
#[derive(Default)]
pub struct Arguments {
    dir: PathBuf,
    record: PathBuf,
    masters: Vec<PathBuf>,
    /// The names that are no options.
    pub chapters: Vec<PathBuf>,
    /// Nothing is to be written.
    pub check: bool,
}

impl Arguments {
    /// Reads `[-C dir] [--record file] [--master file]... [--check]
    /// [chapter...]`.
    ///
    /// # Errors
    ///
    /// A text that says what is wrong with the arguments.
    pub fn parse(args: &[OsString]) -> Result<Self, String> {
        let record = PathBuf::from(".tangled");
        let mut parsed = Self { record, ..Self::default() };
        let mut args = args.iter();
        while let Some(arg) = args.next() {
            let mut value = || {
                let missing = || format!("{} needs a value", arg.display());
                args.next().map(PathBuf::from).ok_or_else(missing)
            };
            // Take an option or a chapter
            match arg.as_encoded_bytes() {
                b"-C" => parsed.dir = value()?,
                b"--record" => parsed.record = value()?,
                b"--master" => parsed.masters.push(value()?),
                b"--check" => parsed.check = true,
                [b'-', ..] => {
                    let arg = arg.display();
                    return Err(format!("unknown option {arg}"));
                }
                _ => parsed.chapters.push(arg.into()),
            }
        }
        Ok(parsed)
    }

    // Make projects of the arguments
    /// The project of the chapters, and one for each master.
    ///
    /// # Errors
    ///
    /// A master that cannot be read, or none at all.
    pub fn projects(mut self) -> Result<Vec<Project>, String> {
        let mut lists = vec![self.chapters];
        lists.retain(|list| !list.is_empty());
        if lists.is_empty() && self.masters.is_empty() {
            self.masters = masters_in(&self.dir);
        }
        for master in &self.masters {
            let list = included(&self.dir, master);
            let failed = |e| failure("read", master, &e).text;
            lists.push(list.map_err(failed)?);
        }
        if lists.is_empty() {
            let text = "which chapters? name them, or --master FILE";
            return Err(text.into());
        }
        let project = |chapters| Project {
            dir: self.dir.clone(),
            record: self.record.clone(),
            chapters,
        };
        Ok(lists.into_iter().map(project).collect())
    }
}

/// The webs in a directory.
fn masters_in(dir: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(dir.join(".")).into_iter().flatten();
    let names = entries.filter_map(|e| Some(e.ok()?.file_name().into()));
    let is_web = |name: &PathBuf| name.extension() == Some("nw".as_ref());
    let mut webs: Vec<PathBuf> = names.filter(is_web).collect();
    webs.sort();
    webs
}

/// The one project that the arguments name, and whether only to check.
///
/// # Errors
///
/// A text that says what is wrong with the arguments.
pub fn one_project(args: &[OsString]) -> Result<(Project, bool), String> {
    let args = Arguments::parse(args)?;
    let check = args.check;
    if args.chapters.len() + args.masters.len() == 0 {
        return Err("no chapters to tangle".into());
    }
    let mut projects = args.projects()?;
    let project = projects.pop().filter(|_| projects.is_empty());
    Ok((project.ok_or("one web at a time")?, check))
}
