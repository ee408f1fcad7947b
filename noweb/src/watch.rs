// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Tangles, and runs a command, whenever a chapter has been saved.
//!
//! Directories are watched, not files: an editor may replace a file by
//! another one of the same name. The command is never interrupted; a save
//! while it runs makes it run once more.

// Import what the watch needs
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

use notify::{RecommendedWatcher, RecursiveMode, Watcher};

use crate::Streams;
use crate::diagnostic::{Diagnostic, Level};
use crate::project::{Project, hash, parse_arguments};

// Say what can happen while we watch
/// What the main thread waits for.
enum Event {
    /// Something happened to files of these names, or to unknown ones.
    Touched(Vec<OsString>),
    /// The command has ended.
    Ended,
}

/// The state between two saves.
struct Watch {
    /// The arguments that name the project; read anew each time.
    args: Vec<OsString>,
    command: Vec<OsString>,
    watcher: RecommendedWatcher,
    // Remember what was seen last
    /// The directories that are watched: device and number of each.
    dirs: BTreeMap<PathBuf, (u64, u64)>,
    /// The hash of the chapters that were tangled last without a fault.
    tangled: Option<u64>,
    // Keep the channel and the command's state
    events: Sender<Event>,
    received: Receiver<Event>,
    running: bool,
    /// The command is to be run again when it has ended.
    again: bool,
}

impl Watch {
    fn new(
        args: &[OsString],
        command: &[OsString],
    ) -> notify::Result<Self> {
        // Send the events of the library
        let (events, received) = channel();
        let watcher = watcher(&events)?;
        // Begin without any memory
        Ok(Self {
            args: args.to_vec(),
            command: command.to_vec(),
            watcher,
            dirs: BTreeMap::new(),
            tangled: None,
            events,
            received,
            running: false,
            again: false,
        })
    }
}

/// What sends the events of the directories that it is told to watch.
fn watcher(events: &Sender<Event>) -> notify::Result<RecommendedWatcher> {
    let sender = events.clone();
    notify::recommended_watcher(move |event| {
        // The receiver lives as long as the process.
        let _ = touched(event).map(|names| sender.send(names));
    })
}

/// The names of files that were written, made, renamed or removed.
fn touched(event: notify::Result<notify::Event>) -> Option<Event> {
    let event = event.ok().filter(|e| !e.kind.is_access())?;
    let names = event.paths.iter().filter_map(|path| path.file_name());
    Some(Event::Touched(names.map(OsString::from).collect()))
}

// Tangle after a save
impl Watch {
    // Go through one round
    /// Tangles if a chapter has changed, and runs the command.
    ///
    /// # Errors
    ///
    /// Everything that stands in the way; the watch can go on.
    fn round(
        &mut self,
        from: Instant,
        streams: &mut Streams,
    ) -> Result<(), Vec<Diagnostic>> {
        let project = self.project().map_err(|fault| vec![fault])?;
        // Leave if no chapter has changed
        let (chapters, _) = project.read_chapters()?;
        let texts: Vec<&[u8]> =
            chapters.iter().map(|c| &c.text[..]).collect();
        let now = hash(&texts.join(&0));
        if self.tangled.replace(now) == Some(now) {
            return Ok(());
        }
        let plan = project.tangle().inspect_err(|_| self.tangled = None)?;
        // Name the files that were written
        let written = plan.outputs.iter().filter(|output| output.changed);
        let names = written.map(|output| output.path.display().to_string());
        let mut names: Vec<String> = names.collect();
        // Print a line about the round
        if names.len() > 4 {
            names = vec![format!("{} files", names.len())];
        }
        if names.is_empty() {
            names.push("nothing".into());
        }
        for warning in &plan.warnings {
            let _ = write!(streams.errors, "{warning}");
        }
        let (time, names) = (from.elapsed().as_millis(), names.join(", "));
        // Nobody is left to tell if standard error is closed.
        let _ =
            writeln!(streams.errors, "noweb: {time} ms: tangled {names}");
        self.start(streams);
        Ok(())
    }

    fn project(&mut self) -> Result<Project, Diagnostic> {
        let wrong = |text| Diagnostic::new(Level::Error, None, text);
        let (project, _) = parse_arguments(&self.args).map_err(wrong)?;
        for chapter in &project.chapters {
            let path = project.dir.join(chapter);
            let parent =
                path.parent().filter(|p| !p.as_os_str().is_empty());
            let dir = parent.unwrap_or(Path::new("."));
            // Watch the chapter's directory as well
            self.watch(dir).map_err(|e| {
                wrong(format!("cannot watch {}: {e}", dir.display()))
            })?;
        }
        Ok(project)
    }

    fn watch(&mut self, dir: &Path) -> notify::Result<()> {
        let moved =
            |(dir, number): (&PathBuf, &_)| number_of(dir) != *number;
        if self.dirs.iter().any(moved) {
            self.watcher = watcher(&self.events)?;
            self.dirs.clear();
        }
        if !self.dirs.contains_key(dir) {
            self.dirs.insert(dir.to_owned(), number_of(dir));
            self.watcher.watch(dir, RecursiveMode::NonRecursive)?;
        }
        Ok(())
    }
}

/// The device of a directory, and its number there; zero for none.
fn number_of(dir: &Path) -> (u64, u64) {
    let there = std::fs::metadata(dir).map(|m| (m.dev(), m.ino()));
    there.unwrap_or_default()
}

// Run the command after tangling
impl Watch {
    /// Starts the command, or notes that it has to be run again.
    fn start(&mut self, streams: &mut Streams) {
        let [program, args @ ..] = &self.command[..] else { return };
        // Leave a command that is running
        if std::mem::replace(&mut self.running, true) {
            self.again = true;
            return;
        }
        self.again = false;
        let mut command = Command::new(program);
        match command.args(args).stdin(Stdio::null()).spawn() {
            Ok(mut child) => {
                // Wait for its end in a thread
                let events = self.events.clone();
                thread::spawn(move || {
                    // How it ended, it has said itself.
                    let _ = child.wait();
                    let _ = events.send(Event::Ended);
                });
            }
            Err(error) => {
                // Report that it cannot be run
                self.running = false;
                let program = program.display();
                let text = format!("cannot run {program}: {error}");
                let fault = Diagnostic::new(Level::Error, None, text);
                let _ = write!(streams.errors, "{fault}");
            }
        }
    }
}

// Wait until a save is complete
const QUIET: Duration = Duration::from_millis(10);
const LONGEST: Duration = Duration::from_millis(50);
const MISSING: Duration = Duration::from_millis(500);

impl Watch {
    /// Waits until no more events come, and until all chapters are there.
    fn settle(&mut self, from: Instant) {
        loop {
            let longest = if self.complete() { LONGEST } else { MISSING };
            // Listen for ten milliseconds
            let quiet = match self.received.recv_timeout(QUIET) {
                Ok(Event::Ended) => {
                    self.running = false;
                    false
                }
                Ok(Event::Touched(_)) => false,
                Err(_) => longest == LONGEST,
            };
            if quiet || from.elapsed() > longest {
                return;
            }
        }
    }

    /// Are the master and all its chapters there, and not empty?
    fn complete(&self) -> bool {
        parse_arguments(&self.args).is_ok_and(|(project, _)| {
            let filled = |c: &PathBuf| {
                let file = std::fs::metadata(project.dir.join(c));
                file.is_ok_and(|file| file.len() > 0)
            };
            project.chapters.iter().all(filled)
        })
    }
}

// Run the command that watches
/// The command `noweb watch [-C dir] [--record file] [--master file]
/// [--only prefix]... [--except prefix]... [chapter...] [-- command...]`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let end = args.iter().position(|arg| arg == "--");
    let (args, command) = args.split_at(end.unwrap_or(args.len()));
    // Refuse arguments that make no sense
    let wrong = match parse_arguments(args) {
        Ok((_, true)) => Some("unknown option --check".into()),
        Ok(_) if command.len() == 1 => Some("no command after --".into()),
        Ok(_) => None,
        Err(text) => Some(text),
    };
    if let Some(text) = wrong {
        return streams.misused(text);
    }
    match Watch::new(args, command.get(1..).unwrap_or(&[])) {
        Ok(watch) => watch.run(streams),
        Err(error) => {
            let text = format!("cannot watch files: {error}");
            let fault = Diagnostic::new(Level::Error, None, text);
            streams.conclude(Ok(()), &[fault])
        }
    }
}

impl Watch {
    fn run(mut self, streams: &mut Streams) -> u8 {
        self.report(Instant::now(), streams);
        loop {
            let event = self.received.recv();
            let from = Instant::now();
            // React to one event
            match event {
                Ok(Event::Touched(names)) if self.concerns(&names) => {
                    self.settle(from);
                    self.report(from, streams);
                }
                Ok(Event::Ended) => self.running = false,
                Ok(Event::Touched(_)) => (),
                Err(_) => return 1,
            }
            if self.again && !self.running {
                self.start(streams);
            }
        }
    }

    fn report(&mut self, from: Instant, streams: &mut Streams) {
        for fault in self.round(from, streams).err().into_iter().flatten() {
            let _ = write!(streams.errors, "{fault}");
        }
    }

    /// Is one of these files a chapter, or a directory with chapters?
    fn concerns(&self, names: &[OsString]) -> bool {
        let named = |path: &PathBuf| {
            path.file_name().is_some_and(|p| names.iter().any(|n| n == p))
        };
        let Ok((project, _)) = parse_arguments(&self.args) else {
            return true;
        };
        names.is_empty()
            || project.chapters.iter().any(named)
            || self.dirs.keys().any(named)
    }
}
