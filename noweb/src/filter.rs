// Tangled from noweb/chapters/command.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Foreign filters: shell commands in the pipeline.
//!
//! Without any, the pipeline stays inside the process and every token has
//! its exact place. With some, the stream goes through their processes.

use std::ffi::{OsStr, OsString};
use std::io::{self, Write};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::process::{Command, Output, Stdio};

use crate::diagnostic::{Faults, Source, checked, failure, shown};
use crate::markup::{mark_files, mark_up, read_stream as read_tokens};
use crate::stream::broken;
use crate::web::Web;
use crate::{Streams, error};

/// The web of some files, `-` being standard input, whose stream goes
/// through some shell commands in turn; or the exit status.
pub fn read_web(
    files: &[OsString],
    filters: &[OsString],
    tab: usize,
    streams: &mut Streams,
) -> Result<Web, u8> {
    if filters.is_empty() {
        let all = streams.sources(files);
        let web = all.and_then(|all| read_sources(all, tab));
        return web.map_err(|faults| streams.fail(&faults));
    }
    let (stream, faults) = mark_files(files, tab, streams);
    let stream = checked(stream, faults);
    let mut stream = stream.map_err(|faults| streams.fail(&faults))?;
    for filter in filters {
        stream = run_shell(filter, &stream, streams)?;
    }
    parse(&stream, streams)
}

/// The web of some sources; `tab` is the distance of tab stops, or 0.
pub fn read_sources(
    sources: Vec<Source>,
    tab: usize,
) -> Result<Web, Faults> {
    let (web, faults) =
        Web::read(sources, |source, file| mark_up(source, file, tab));
    checked(web, faults)
}

pub fn read_stream(streams: &mut Streams) -> Result<Web, u8> {
    let stream = streams.read(OsStr::new("-"));
    let stream = stream.map_err(|faults| streams.fail(&faults))?;
    parse(&stream.text, streams)
}

fn parse(stream: &[u8], streams: &mut Streams) -> Result<Web, u8> {
    if broken(stream).is_some() {
        return Err(1);
    }
    let (web, faults) = read_tokens(stream);
    match streams.conclude(Ok(()), &faults) {
        0 => Ok(web),
        status => Err(status),
    }
}

/// An argument as a word that the shell does not look into.
pub fn quoted(arg: &OsStr) -> OsString {
    let parts: Vec<&[u8]> = arg.as_bytes().split(|b| *b == b'\'').collect();
    let word = parts.join(&b"'\\''"[..]);
    OsString::from_vec([b" '", &word[..], b"'"].concat())
}

/// What a shell command writes when it reads a text, or our exit status.
///
/// Its messages go to the error stream. A failure of the command is a
/// failure of the pipeline, for its output may be cut short.
pub fn run_shell(
    command: &OsStr,
    input: &[u8],
    streams: &mut Streams,
) -> Result<Vec<u8>, u8> {
    let output = converse(command, input)
        .map_err(|e| streams.fail(&failure("run", command, e)))?;
    // A failure of this could not be reported either.
    let _ = streams.errors.write_all(&output.stderr);
    if output.status.success() {
        return Ok(output.stdout);
    }
    let (command, status) = (shown(command), output.status);
    let text = format!("the filter `{command}' failed ({status})");
    Err(streams.fail(&error(text)))
}

fn converse(command: &OsStr, input: &[u8]) -> io::Result<Output> {
    let mut child = Command::new("sh")
        .arg("-c")
        .arg(command)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    let stdin = child.stdin.take();
    std::thread::scope(|scope| {
        // A filter may stop reading early.
        scope.spawn(|| stdin.map(|mut pipe| pipe.write_all(input)));
        child.wait_with_output()
    })
}
