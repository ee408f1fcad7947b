// Tangled from noweb/chapters/command.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Foreign parsers and filters: shell commands in the pipeline.
//!
//! Without any, the pipeline stays inside the process and every token has
//! its exact place. With some, the stream goes through their processes.

use std::ffi::{OsStr, OsString};
use std::io::{self, Write};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

use crate::Streams;
use crate::diagnostic::{
    Diagnostic, Faults, Level, checked, shown, status,
};
use crate::markup::mark_files;
use crate::stream::fatal;
use crate::web::Web;

#[derive(Clone, Debug, Default)]
pub struct Pipeline {
    pub markup: Option<OsString>,
    /// Shell commands that the stream goes through in turn.
    pub filters: Vec<OsString>,
}

#[derive(Clone, Debug)]
pub struct Failure {
    pub faults: Faults,
    /// The exit status that noweb would give.
    pub status: u8,
}

impl From<Faults> for Failure {
    fn from(faults: Faults) -> Self {
        Self { faults, status: 1 }
    }
}

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
            let (sources, faults) = streams.sources(files);
            let (web, faults) = Web::read(checked(sources, faults)?, tab);
            return Ok(checked(web, faults)?);
        }
        let path = StagePath::new().map_err(|e| cannot("prepare", &e))?;
        let mut stream = match &self.markup {
            // Run a foreign parser on the files
            Some(markup) => {
                let mut command = markup.clone();
                command.push(if tab == 0 { " -t" } else { "" });
                files.iter().for_each(|file| command.push(quoted(file)));
                let mut input = Vec::new();
                if files.iter().any(|file| file == "-") {
                    let read = streams.input.read_to_end(&mut input);
                    read.map_err(|e| cannot("read standard input", &e))?;
                }
                run_shell(&command, &input, &path, streams)?
            }
            // Mark up the files in this process
            None => {
                let (stream, faults) = mark_files(files, tab, streams);
                checked(stream, faults)?
            }
        };
        for filter in &self.filters {
            stream = run_shell(filter, &stream, &path, streams)?;
        }
        parse(&stream)
    }
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

fn cannot(action: &str, error: &io::Error) -> Failure {
    let text = format!("cannot {action}: {error}");
    vec![Diagnostic::new(Level::Error, None, text)].into()
}

/// An argument as a word that the shell does not look into.
pub fn quoted(arg: &OsStr) -> OsString {
    let parts: Vec<&[u8]> = arg.as_bytes().split(|b| *b == b'\'').collect();
    let word = parts.join(&b"'\\''"[..]);
    OsString::from_vec([b" '", &word[..], b"'"].concat())
}

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
    let action = format!("run {}", shown(command));
    let output = converse(command, input, path);
    let output = output.map_err(|e| cannot(&action, &e))?;
    // There is nobody left to tell if this fails.
    let _ = streams.errors.write_all(&output.stderr);
    if output.status.success() {
        return Ok(output.stdout);
    }
    let (command, status) = (shown(command), output.status);
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

/// A directory in which our stages have their names, for as long as it
/// lives, and a search path that ends in it.
#[derive(Debug)]
pub struct StagePath {
    dir: PathBuf,
    search: OsString,
}

/// The stages of a pipeline.
const STAGES: &str = "cpif finduses markup noidx noroots nt rustindex \
    split_scope totex unmarkup";

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
