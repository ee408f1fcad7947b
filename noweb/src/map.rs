// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! A filter that puts chapters in the place of tangled files.
//!
//! It takes any text, line by line, and the JSON of cargo and rustc. It
//! can run a command and filter both of its outputs.

use std::collections::{BTreeSet, HashSet};
use std::ffi::{OsStr, OsString};
use std::io::{self, IsTerminal, Read};
use std::os::unix::ffi::OsStrExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;

use annotate_snippets::Renderer;

use crate::Streams;
use crate::diagnostic::{Diagnostic, Level};
use crate::locate::{Atlas, complete, parse, stale_file};
use crate::project::Project;
use crate::rustc::{self, Report};

// Translate one line
/// A filter and what it remembers.
pub struct Filter {
    project: Project,
    /// The atlas once it is read; nothing inside if it cannot be.
    atlas: Option<Option<Atlas>>,
    colour: bool,
    /// A bar of progress stands on the line of the terminal.
    bar: bool,
    shown: HashSet<String>,
    reported: BTreeSet<PathBuf>,
}

/// What has become of a line.
#[derive(Debug, PartialEq, Eq)]
pub enum Translated {
    /// Text like the line, perhaps with other positions.
    Text(Vec<u8>),
    /// A diagnostic, which was JSON.
    Diagnostic(String),
    /// Nothing that anyone wants to see.
    Nothing,
}

impl Filter {
    // Make a filter and use it
    /// A filter for the program of a project, with colours or without.
    pub fn new(project: Project, colour: bool) -> Self {
        let (shown, reported) = (HashSet::new(), BTreeSet::new());
        let (atlas, bar) = (None, false);
        Self { project, atlas, colour, bar, shown, reported }
    }

    /// Translates a line, with its newline.
    pub fn translate(&mut self, line: &[u8]) -> Translated {
        let text = match rustc::parse(line) {
            None => return Translated::Text(self.translate_text(line)),
            Some(Report::Progress) => return Translated::Nothing,
            Some(Report::Diagnostic(message)) => self.show(&message),
        };
        match self.shown.insert(text.clone()) {
            true => Translated::Diagnostic(text),
            false => Translated::Nothing,
        }
    }

    // Show a diagnostic or leave it as it is
    fn show(&mut self, message: &rustc::Message) -> String {
        let renderer = match self.colour {
            true => Renderer::styled().hyperlink(false),
            false => Renderer::plain(),
        };
        let atlas = self.atlas();
        let shown = atlas.and_then(|a| rustc::show(message, a, &renderer));
        match (shown, self.colour) {
            (Some(text), _) => text,
            (None, true) => message.coloured().to_owned(),
            (None, false) => message.rendered(),
        }
    }

    fn atlas(&mut self) -> Option<&Atlas> {
        let project = &self.project;
        let atlas =
            self.atlas.get_or_insert_with(|| Atlas::read(project).ok());
        atlas.as_ref()
    }

    /// What has to be said about stale files and was not said yet.
    pub fn warnings(&mut self) -> Vec<Diagnostic> {
        let Some(Some(atlas)) = &self.atlas else { return Vec::new() };
        let reported = &mut self.reported;
        let fresh = |path: &&Path| reported.insert(path.to_path_buf());
        let stale = atlas.stale().filter(fresh);
        let warn = |path| stale_file(path, Level::Warning);
        stale.map(warn).collect()
    }
}

// Replace the positions in a text
impl Filter {
    fn translate_text(&mut self, text: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        let mut copied = 0;
        let mut next = 0;
        while let Some(found) = text[next..].iter().position(|b| *b == b':')
        {
            let colon = next + found;
            next = colon + 1;
            // Read the line and perhaps a column
            let Some((line, end)) = number(text, next) else { continue };
            let column = match text.get(end) {
                Some(b':') => number(text, end + 1),
                _ => None,
            };
            let start = copied + path_start(&text[copied..colon]);
            // Replace the position if its file is tangled
            let end = column.map_or(end, |(_, end)| end);
            let column = column.map(|(column, _)| column);
            let path = Path::new(OsStr::from_bytes(&text[start..colon]));
            if let Some(position) = self.locate(path, line, column) {
                out.extend(&text[copied..start]);
                out.extend(position.bytes());
                (copied, next) = (end, end);
            }
        }
        out.extend(&text[copied..]);
        out
    }

    // Translate a single position
    fn locate(
        &mut self,
        path: &Path,
        line: u32,
        column: Option<u32>,
    ) -> Option<String> {
        if path.extension().is_none() && path.components().count() < 2 {
            return None;
        }
        let atlas = self.atlas()?;
        let file = atlas.find(path).filter(|file| atlas.is_fresh(file))?;
        let place = file.origin(line, column.unwrap_or(1))?;
        let position = atlas.position(place)?;
        Some(match column {
            Some(_) => position.to_string(),
            None => format!("{}:{}", position.file, position.line),
        })
    }
}

/// The number that begins at an offset, and where it ends.
fn number(text: &[u8], from: usize) -> Option<(u32, usize)> {
    let digits = text[from..].iter().take_while(|b| b.is_ascii_digit());
    let end = from + digits.count();
    let digits = std::str::from_utf8(&text[from..end]).ok()?;
    Some((digits.parse().ok()?, end))
}

/// Where the path begins that a text ends with.
fn path_start(text: &[u8]) -> usize {
    let inside = |b: &u8| {
        b.is_ascii_alphanumeric() || b"_-+./~".contains(b) || *b >= 0x80
    };
    let path = text.iter().rev().take_while(|b| inside(b)).count();
    let start = text.len() - path;
    let near = start.saturating_sub(24);
    let colour = text[near..].iter().rposition(|b| *b == 0x1b);
    let after = colour.and_then(|escape| {
        let end = text[near + escape..].iter().position(|b| *b == b'm')?;
        Some(near + escape + end + 1)
    });
    start.max(after.unwrap_or(0))
}

// Split bytes into lines
/// What was read of a line that has not ended yet.
#[derive(Default)]
struct Lines {
    rest: Vec<u8>,
}

impl Lines {
    /// Adds bytes and gives the lines that they end, with their ends.
    fn push(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut lines = Vec::new();
        for part in bytes.split_inclusive(|b| b"\n\r".contains(b)) {
            self.rest.extend(part);
            if self.rest.ends_with(b"\n") || self.rest.ends_with(b"\r") {
                lines.push(std::mem::take(&mut self.rest));
            }
        }
        lines
    }
}

// Run a command and filter its output
/// Translates what a command writes, and gives its status.
///
/// # Errors
///
/// The output cannot be written.
fn follow(
    mut child: Child,
    filter: &mut Filter,
    streams: &mut Streams,
) -> io::Result<u8> {
    let result = forward(&mut child, filter, streams);
    let status = child.wait()?;
    result?;
    // Make one number of the status
    let signal = status.signal().unwrap_or(0);
    let code = status.code().unwrap_or(128 + signal);
    Ok(u8::try_from(code).unwrap_or(1))
}

fn start(command: &[OsString], colour: bool) -> io::Result<Child> {
    let (name, args) =
        command.split_first().ok_or(io::ErrorKind::NotFound)?;
    let mut child = Command::new(name);
    child.args(args).stdout(Stdio::piped()).stderr(Stdio::piped());
    if colour {
        child.env("CARGO_TERM_COLOR", "always");
    }
    // Ask cargo for its bar of progress
    let progress =
        ["CARGO_TERM_PROGRESS_WHEN", "CARGO_TERM_PROGRESS_WIDTH"];
    let decided =
        progress.map(std::env::var_os).iter().any(Option::is_some);
    if io::stderr().is_terminal() && !decided {
        let width = std::env::var_os("COLUMNS").unwrap_or("80".into());
        child.env(progress[0], "always").env(progress[1], width);
    }
    child.spawn()
}

/// Is colour wanted? Cargo's variable decides, else the terminal.
fn wants_colour(terminal: bool) -> bool {
    let set = |name| std::env::var(name).unwrap_or_default();
    match &set("CARGO_TERM_COLOR")[..] {
        "always" => true,
        "never" => false,
        _ => terminal && set("NO_COLOR").is_empty(),
    }
}

fn forward(
    child: &mut Child,
    filter: &mut Filter,
    streams: &mut Streams,
) -> io::Result<()> {
    let (sender, receiver) = mpsc::channel();
    let output = child.stdout.take().ok_or(io::ErrorKind::BrokenPipe)?;
    let errors = child.stderr.take().ok_or(io::ErrorKind::BrokenPipe)?;
    pump(output, 0, sender.clone());
    pump(errors, 1, sender);
    let mut lines = [Lines::default(), Lines::default()];
    for (from, bytes) in receiver {
        for line in lines[from].push(&bytes) {
            write_line(&line, from == 1, filter, streams)?;
        }
    }
    for (rest, from) in lines.into_iter().zip(0..) {
        write_line(&rest.rest, from == 1, filter, streams)?;
    }
    Ok(())
}

type Sender = mpsc::Sender<(usize, Vec<u8>)>;

fn pump(mut pipe: impl Read + Send + 'static, from: usize, to: Sender) {
    std::thread::spawn(move || {
        let mut buffer = [0; 1 << 16];
        while let Ok(count @ 1..) = pipe.read(&mut buffer) {
            if to.send((from, buffer[..count].to_vec())).is_err() {
                break;
            }
        }
    });
}

/// Translates a line and writes it where it belongs.
fn write_line(
    line: &[u8],
    is_error: bool,
    filter: &mut Filter,
    streams: &mut Streams,
) -> io::Result<()> {
    let translated = filter.translate(line);
    for warning in filter.warnings() {
        write!(streams.errors, "{warning}")?;
    }
    match translated {
        Translated::Nothing => Ok(()),
        // Write it to the stream where it belongs
        Translated::Diagnostic(text) => {
            let erase = if filter.bar { "\x1b[K" } else { "" };
            filter.bar = false;
            write!(streams.errors, "{erase}{text}")
        }
        Translated::Text(text) if is_error => {
            filter.bar = text.ends_with(b"\r");
            streams.errors.write_all(&text)
        }
        Translated::Text(text) => {
            streams.output.write_all(&text)?;
            streams.output.flush()
        }
    }
}

// Run the command that is a filter
fn filter_input(
    filter: &mut Filter,
    streams: &mut Streams,
) -> io::Result<()> {
    let mut lines = Lines::default();
    loop {
        let bytes = streams.input.fill_buf()?.to_vec();
        streams.input.consume(bytes.len());
        let mut ended = lines.push(&bytes);
        if bytes.is_empty() {
            ended.push(std::mem::take(&mut lines.rest));
        }
        // Translate the lines that have ended
        for line in ended {
            let text = match filter.translate(&line) {
                Translated::Text(text) => text,
                Translated::Diagnostic(text) => text.into_bytes(),
                Translated::Nothing => continue,
            };
            streams.output.write_all(&text)?;
            streams.output.flush()?;
        }
        for warning in filter.warnings() {
            write!(streams.errors, "{warning}")?;
        }
        if bytes.is_empty() {
            return Ok(());
        }
    }
}

/// The command `noweb map [-C dir] [--master file] [chapter...]
/// [-- command...]`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let dashes = args.iter().position(|arg| arg == "--");
    let (args, command) = args.split_at(dashes.unwrap_or(args.len()));
    // Read the arguments before the dashes
    let parsed = parse(args).and_then(|(mut project, master)| {
        complete(&mut project, master).map(|()| project)
    });
    let project = match parsed {
        Ok(project) => project,
        Err(text) => return refuse(&text, 2, streams),
    };
    match command.split_first() {
        None => {
            // Filter standard input
            let colour = wants_colour(io::stdout().is_terminal());
            let mut filter = Filter::new(project, colour);
            let result = filter_input(&mut filter, streams);
            streams.conclude(result, &[])
        }
        Some((_, [])) => refuse("no command after --", 2, streams),
        Some((_, command)) => {
            // Filter the output of a command
            let colour = wants_colour(io::stderr().is_terminal());
            let mut filter = Filter::new(project, colour);
            let child = match start(command, filter.colour) {
                Ok(child) => child,
                Err(error) => {
                    let text = format!("{}: {error}", command[0].display());
                    return refuse(&text, 127, streams);
                }
            };
            match follow(child, &mut filter, streams) {
                Ok(status) => status,
                Err(error) => streams.conclude(Err(error), &[]),
            }
        }
    }
}

fn refuse(text: &str, status: u8, streams: &mut Streams) -> u8 {
    let fault = Diagnostic::new(Level::Error, None, text);
    streams.conclude(Ok(()), &[fault]);
    status
}
