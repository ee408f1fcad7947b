// Tangled from noweb/chapters/positions.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A command whose output names chapters in the place of tangled files.
//!
//! Positions are replaced wherever they stand in a line, and the numbers
//! in the margin of the compiler's messages.

use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::io::{self, BufRead, BufReader, IsTerminal, Read, Write};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;

use crate::Streams;
use crate::diagnostic::{
    Diagnostic, Faults, Level, Position, bytes_of, shown, text_of,
};
use crate::locate::{Atlas, margin, path_start};
use crate::project::{self, Project, included, word};

#[derive(Default)]
pub struct Filter {
    projects: Vec<Project>,
    atlas: Option<Atlas>,
    /// For each stream the path of the file whose lines are shown.
    shown: [Option<Vec<u8>>; 2],
    /// The stale files that were reported.
    stale: BTreeSet<Vec<u8>>,
    pub warnings: Faults,
}

impl Filter {
    pub fn new(projects: Vec<Project>) -> Self {
        Self { projects, ..Self::default() }
    }

    /// Translates a line of one of two streams.
    pub fn translate(&mut self, line: &[u8], stream: usize) -> Vec<u8> {
        let (text, path) = self.replace(line);
        let at = margin(line);
        let rest = &line[at..];
        if rest.starts_with(b"-->") || rest.starts_with(b":::") {
            self.shown[stream] = path;
        } else if rest.trim_ascii().is_empty() {
            self.shown[stream] = None;
        }
        match self.shown[stream].clone() {
            Some(path) => self.renumber(&path, &text, at),
            None => text,
        }
    }

    /// Replaces the positions in a text; gives the path of the last.
    fn replace(&mut self, text: &[u8]) -> (Vec<u8>, Option<Vec<u8>>) {
        let (mut out, mut last) = (Vec::new(), None);
        let (mut copied, mut next) = (0, 0);
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
            // Replace the position if its file is tangled
            let before = &text[copied..colon];
            let (asked, end) = column.unwrap_or((1, end));
            if let Some((start, at)) = self.locate(before, line, asked) {
                out.extend(&before[..start]);
                out.extend(bytes_of(&format!("{}:{}", at.file, at.line)));
                if column.is_some() {
                    out.extend(format!(":{}", at.column).bytes());
                }
                last = Some(before[start..].to_vec());
                (copied, next) = (end, end);
            }
        }
        out.extend(&text[copied..]);
        (out, last)
    }

    /// Where the path begins that a text ends with, and what it stands for.
    fn locate(
        &mut self,
        text: &[u8],
        line: u32,
        column: u32,
    ) -> Option<(usize, Position)> {
        if text[path_start(text)..].iter().all(u8::is_ascii_digit) {
            return None;
        }
        let projects = &self.projects;
        let atlas = self.atlas.get_or_insert_with(|| Atlas::read(projects));
        let (start, file) = atlas.find(text)?;
        if !file.fresh {
            let path = &text[start..];
            if self.stale.insert(path.to_vec()) {
                // Warn of the stale file
                let (path, words) =
                    (text_of(path), &projects[file.project].words);
                let text = format!("{path} is not what its chapters give");
                let help = "tangle, or bring an edit home: noweb untangle";
                let warning = Diagnostic::new(Level::Warning, None, text);
                self.warnings
                    .push(warning.with_help(format!("{help}{words}")));
            }
            return None;
        }
        Some((start, file.origin(line, column)?))
    }

    /// Widens the margin of a message, and numbers its line anew.
    fn renumber(&mut self, path: &[u8], text: &[u8], at: usize) -> Vec<u8> {
        let (before, rest) = text.split_at(at);
        let bar = |end: &usize| {
            let rest = &text[*end..];
            let sign = rest.get(margin(rest));
            sign.is_some_and(|sign| b"|+-~".contains(sign))
        };
        let number = number(text, at).filter(|(_, end)| bar(end));
        if let Some((line, end)) = number {
            let here = self.locate(path, line, 1);
            let here = here.map_or(line, |(_, at)| at.line);
            let number = format!("{here:>0$}", end - at + WIDER);
            return [before, number.as_bytes(), &text[end..]].concat();
        }
        match before.contains(&b' ') {
            true => [&[b' '; WIDER], before, rest].concat(),
            false => text.to_vec(),
        }
    }
}

const WIDER: usize = 3;

/// The number that begins at an offset, and where it ends.
fn number(text: &[u8], from: usize) -> Option<(u32, usize)> {
    let digits = text[from..].iter().take_while(|b| b.is_ascii_digit());
    let end = from + digits.count();
    let digits = std::str::from_utf8(&text[from..end]).ok()?;
    Some((digits.parse().ok()?, end))
}

/// Translates the output of a command, and returns its status.
fn follow(
    mut child: Child,
    filter: &mut Filter,
    streams: &mut Streams,
) -> io::Result<u8> {
    let (sender, receiver) = mpsc::channel();
    pump(child.stdout.take(), 0, sender.clone());
    pump(child.stderr.take(), 1, sender);
    let result = receiver.into_iter().try_for_each(|(from, line)| {
        let text = filter.translate(&line, from);
        // Write the line to its stream
        for warning in filter.warnings.drain(..) {
            streams.errors.write_all(&bytes_of(&warning.to_string()))?;
        }
        let stream: &mut dyn Write =
            if from == 0 { streams.output } else { streams.errors };
        stream.write_all(&text)?;
        stream.flush()
    });
    let status = child.wait()?;
    result?;
    // Reduce the status to one number
    let signal = status.signal().unwrap_or(0);
    let code = status.code().unwrap_or(128 + signal);
    Ok(u8::try_from(code).unwrap_or(1))
}

fn start(name: &OsStr, args: &[OsString]) -> io::Result<Child> {
    let mut child = Command::new(name);
    child.args(args).stdout(Stdio::piped()).stderr(Stdio::piped());
    let open = |name| std::env::var_os(name).is_none_or(|v| v.is_empty());
    let is_open = ["CARGO_TERM_COLOR", "NO_COLOR"].into_iter().all(open);
    if is_open && io::stderr().is_terminal() {
        child.env("CARGO_TERM_COLOR", "always");
    }
    child.spawn()
}

type Sender = mpsc::Sender<(usize, Vec<u8>)>;

fn pump(pipe: Option<impl Read + Send + 'static>, from: usize, to: Sender) {
    std::thread::spawn(move || {
        let Some(pipe) = pipe else { return };
        let (mut pipe, mut line) = (BufReader::new(pipe), Vec::new());
        while let Ok(1..) = pipe.read_until(b'\n', &mut line) {
            if to.send((from, std::mem::take(&mut line))).is_err() {
                break;
            }
        }
    });
}

/// The command `noweb map master... -- command...`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let dashes = args.iter().position(|arg| arg == "--");
    let (masters, command) = args.split_at(dashes.unwrap_or(0));
    let ([_, ..], [_, name, rest @ ..]) = (masters, command) else {
        let text = "which webs and which command? MASTER... -- COMMAND...";
        return streams.misused(text);
    };
    let mut projects = Vec::new();
    for master in masters {
        // Read the chapters of a master
        match included(Path::new(""), Path::new(master)) {
            Ok(chapters) => {
                projects.push(project::of(chapters, word(master)))
            }
            Err(e) => {
                let text = format!("cannot read {}: {e}", shown(master));
                return streams.misused(text);
            }
        }
    }
    // Start the command and follow it
    let child = match start(name, rest) {
        Ok(child) => child,
        Err(error) => {
            streams.misused(format!("{}: {error}", shown(name)));
            return 127;
        }
    };
    let status = follow(child, &mut Filter::new(projects), streams);
    status.unwrap_or_else(|error| streams.conclude(Err(error), &[]))
}
