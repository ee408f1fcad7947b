// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Foreign parsers and filters: shell commands in the pipeline.
//!
//! Without any, the pipeline stays inside the process and every token has
//! its exact place. With some, the stream goes through their processes.

use std::ffi::{OsStr, OsString};
use std::io::{self, Write};
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

use crate::Streams;
use crate::diagnostic::{Diagnostic, Level, status};
use crate::markup::mark_files;
use crate::stream::fatal;
use crate::web::Web;

// Define a pipeline and its failure
#[derive(Clone, Debug, Default)]
pub struct Pipeline {
    pub markup: Option<OsString>,
    /// Shell commands that the stream goes through in turn.
    pub filters: Vec<OsString>,
}

#[derive(Clone, Debug)]
pub struct Failure {
    pub faults: Vec<Diagnostic>,
    /// The exit status that noweb would give.
    pub status: u8,
}

impl From<Vec<Diagnostic>> for Failure {
    fn from(faults: Vec<Diagnostic>) -> Self {
        Self { faults, status: 1 }
    }
}

// Run the stages before the last
impl Pipeline {
    /// The web of some files, `-` being standard input.
    pub fn read_web(
        &self,
        files: &[OsString],
        tab: usize,
        streams: &mut Streams,
    ) -> Result<Web, Failure> {
        // Stay inside the process if possible
        if self.markup.is_none() && self.filters.is_empty() {
            let sources = read_sources(files, streams)?;
            let (web, faults) = Web::read(sources, tab);
            return if faults.is_empty() {
                Ok(web)
            } else {
                Err(faults.into())
            };
        }
        let stream = self.stream(files, tab, streams)?;
        parse(&stream)
    }
}

fn read_sources(
    files: &[OsString],
    streams: &mut Streams,
) -> Result<Vec<crate::diagnostic::Source>, Failure> {
    let read: Vec<_> = files.iter().map(|f| streams.read(f)).collect();
    if read.iter().all(Result::is_ok) {
        return Ok(read.into_iter().flatten().collect());
    }
    let faults = read.into_iter().filter_map(Result::err);
    Err(faults.collect::<Vec<_>>().into())
}

pub fn read_stream(streams: &mut Streams) -> Result<Web, Failure> {
    let source = streams.read(OsStr::new("-"));
    parse(&source.map_err(|fault| vec![fault])?.text)
}

fn parse(stream: &[u8]) -> Result<Web, Failure> {
    if fatal(stream).is_some() {
        return Err(Vec::new().into());
    }
    let (web, faults) = Web::read_stream(stream);
    let status = status(&faults);
    if status == 0 { Ok(web) } else { Err(Failure { faults, status }) }
}

impl Pipeline {
    pub fn stream(
        &self,
        files: &[OsString],
        tab: usize,
        streams: &mut Streams,
    ) -> Result<Vec<u8>, Failure> {
        let path = StagePath::new().map_err(|e| cannot("prepare", &e))?;
        let mut stream = match &self.markup {
            // Run a foreign parser on the files
            Some(markup) => {
                let command = with_arguments(markup, files, tab);
                let mut input = Vec::new();
                if files.iter().any(|file| file == "-") {
                    let read = streams.input.read_to_end(&mut input);
                    read.map_err(|e| cannot("read standard input", &e))?;
                }
                run_shell(&command, &input, &path, streams)?
            }
            // Mark up the files in this process
            None => match mark_files(files, tab, streams) {
                (stream, faults) if faults.is_empty() => stream,
                (_, faults) => return Err(faults.into()),
            },
        };
        for filter in &self.filters {
            stream = run_shell(filter, &stream, &path, streams)?;
        }
        Ok(stream)
    }
}

fn cannot(action: &str, error: &io::Error) -> Failure {
    let text = format!("cannot {action}: {error}");
    vec![Diagnostic::new(Level::Error, None, text)].into()
}

fn with_arguments(
    markup: &OsStr,
    files: &[OsString],
    tab: usize,
) -> OsString {
    let mut command = markup.to_owned();
    if tab == 0 {
        command.push(" -t");
    }
    for file in files {
        let text = file.to_string_lossy().replace('\'', "'\\''");
        command.push(format!(" '{text}'"));
    }
    command
}

// Run a shell command on a text
/// What a shell command writes when it reads a text.
///
/// Its complaints go to the error stream. A failure of the command is a
/// failure of the pipeline, for its output may be cut short.
pub fn run_shell(
    command: &OsStr,
    input: &[u8],
    path: &StagePath,
    streams: &mut Streams,
) -> Result<Vec<u8>, Failure> {
    let action = format!("run {}", command.display());
    let output = converse(command, input, path);
    let output = output.map_err(|e| cannot(&action, &e))?;
    // There is nobody left to tell if this fails.
    let _ = streams.errors.write_all(&output.stderr);
    if output.status.success() {
        return Ok(output.stdout);
    }
    let (command, status) = (command.display(), output.status);
    let text = format!("the filter `{command}' failed ({status})");
    Err(vec![Diagnostic::new(Level::Error, None, text)].into())
}

fn converse(
    command: &OsStr,
    input: &[u8],
    path: &StagePath,
) -> io::Result<Output> {
    let mut child = Command::new("sh")
        .arg("-c")
        .arg(command)
        .env("PATH", &path.search)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    let stdin = child.stdin.take();
    std::thread::scope(|scope| {
        // A filter that stops reading early is none of our business.
        scope.spawn(|| stdin.map(|mut pipe| pipe.write_all(input)));
        child.wait_with_output()
    })
}

// Let shell commands find our stages
/// A directory in which our stages have their names, for as long as it
/// lives, and a search path that ends in it.
#[derive(Debug)]
pub struct StagePath {
    dir: PathBuf,
    search: OsString,
}

/// The stages of a pipeline.
const STAGES: &str =
    "cpif finduses markup noidx noroots nt rustindex totex unmarkup";

impl StagePath {
    pub fn new() -> io::Result<Self> {
        let program = std::env::current_exe()?;
        // Make a directory of a new name
        let time = SystemTime::now().duration_since(UNIX_EPOCH);
        let time = time.map_or(0, |time| time.as_nanos());
        let name = format!("noweb-{}-{time}", std::process::id());
        let dir = std::env::temp_dir().join(name);
        std::fs::create_dir(&dir)?;
        let mut search = std::env::var_os("PATH").unwrap_or_default();
        search.push(":");
        search.push(&dir);
        let path = Self { dir, search };
        for stage in STAGES.split(' ') {
            std::os::unix::fs::symlink(&program, path.dir.join(stage))?;
        }
        Ok(path)
    }
}

impl Drop for StagePath {
    fn drop(&mut self) {
        // What stays behind is a few links in a temporary directory.
        let _ = std::fs::remove_dir_all(&self.dir);
    }
}
