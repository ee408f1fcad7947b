// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command: which of the programs to be, and how to be it.
//!
//! Called through a symbolic link, the program is what the link is called;
//! called as `noweb`, it is what its first argument says.

use std::ffi::{OsStr, OsString};
use std::io::{self, BufWriter};
use std::path::Path;
use std::process::ExitCode;

use crate::diagnostic::{Diagnostic, Level};
use crate::web::Web;
use crate::{
    Streams, cpif, locate, map, markup, project, tangle, untangle,
};
// Use the modules that weave
use crate::{finduses, noidx, noweave, rust_index, split_scope, totex};

// List the commands
/// A command: its name, what runs it, and what it does.
type Command = (&'static str, Runner, &'static str);

type Runner = fn(&[OsString], &mut Streams) -> u8;

const COMMANDS: &[Command] = &[
    ("tangle", project::run, "write all files of a program"),
    ("untangle", untangle::run, "carry edits back to chapters"),
    ("check", run_check, "report what looks wrong in a web"),
    ("where", locate::run, "translate a position, either way"),
    ("map", map::run, "run a command, its positions translated"),
    ("notangle", tangle::run, "extract one chunk, expanded"),
    ("noroots", run_noroots, "list the chunks that none uses"),
    ("markup", markup::run, "turn a web into a stream"),
    ("unmarkup", markup::run_unmarkup, "turn a stream into a web"),
    ("nt", tangle::run_nt, "extract a chunk from a stream"),
    ("cpif", cpif::run, "copy to files that differ"),
    // List the commands that weave
    ("noweave", noweave::run, "weave chapters into a document"),
    ("finduses", finduses::run, "mark the uses of identifiers"),
    ("rustindex", rust_index::run, "find the items of Rust and their uses"),
    ("noidx", noidx::run, "resolve cross-references"),
    ("totex", totex::run, "turn a stream into LaTeX"),
    ("split_scope", split_scope::run, "turn a stream into LaTeX files"),
];

// Choose the command
/// The whole program: finds its name, its streams and its status.
pub fn main() -> ExitCode {
    let mut args = std::env::args_os();
    let called = args.next().unwrap_or_default();
    let args: Vec<OsString> = args.collect();
    let mut input = io::stdin().lock();
    let mut output = BufWriter::new(io::stdout().lock());
    let mut errors = io::stderr().lock();
    let mut streams = Streams {
        input: &mut input,
        output: &mut output,
        errors: &mut errors,
    };
    let name = Path::new(&called).file_name().unwrap_or_default();
    ExitCode::from(run(name, &args, &mut streams))
}

/// Runs what a name, or else the first argument, stands for.
pub fn run(name: &OsStr, args: &[OsString], streams: &mut Streams) -> u8 {
    if let Some((_, runner, _)) = find(name) {
        return runner(args, streams);
    }
    match args {
        [first, ..] if first == "--help" || first == "-h" => help(streams),
        [first, ..] if first == "--version" => version(streams),
        [first, rest @ ..] => match find(first) {
            Some(command) if rest == ["--help"] => {
                explain(command, streams)
            }
            Some((_, runner, _)) => runner(rest, streams),
            None => refuse(first, streams),
        },
        [] => refuse(OsStr::new(""), streams),
    }
}

fn find(name: &OsStr) -> Option<&'static Command> {
    COMMANDS.iter().find(|(known, ..)| name == *known)
}

// Print the help
fn help(streams: &mut Streams) -> u8 {
    let mut text = String::from("usage: noweb COMMAND [ARGUMENT...]\n\n");
    for (name, _, purpose) in COMMANDS {
        text += &format!("  {name:<12} {purpose}\n");
    }
    text += "\nA symbolic link named after a command is that command.\n";
    let result = streams.output.write_all(text.as_bytes());
    streams.conclude(result, &[])
}

const SYNTAX: &[(&str, &str)] = &[
    ("tangle", "[OPTION]... [--check] CHAPTER..."),
    ("untangle", "[OPTION]... [--check] CHAPTER..."),
    (
        "where",
        "[-C DIR] [--master FILE]... PATH:LINE[:COLUMN] [CHAPTER...]",
    ),
    ("map", "[-C DIR] [--master FILE]... [CHAPTER...] -- COMMAND..."),
];

const OPTIONS: &str = "options: [-C DIR] [--master FILE] [--record FILE]\n";

fn explain(command: &Command, streams: &mut Streams) -> u8 {
    let (name, _, purpose) = command;
    let known = SYNTAX.iter().find(|(known, _)| known == name);
    let syntax = known.map_or("[ARGUMENT]...", |(_, syntax)| syntax);
    let mut text = format!("usage: noweb {name} {syntax}\n{purpose}\n");
    if syntax.contains("[OPTION]") {
        text += OPTIONS;
    }
    let result = streams.output.write_all(text.as_bytes());
    streams.conclude(result, &[])
}

fn version(streams: &mut Streams) -> u8 {
    let version = env!("CARGO_PKG_VERSION");
    let result = writeln!(streams.output, "noweb {version} (litpt)");
    streams.conclude(result, &[])
}

fn refuse(name: &OsStr, streams: &mut Streams) -> u8 {
    let text = match name.is_empty() {
        true => "which command?".into(),
        false => format!("unknown command {}", name.display()),
    };
    let fault = Diagnostic::new(Level::Error, None, text);
    let fault = fault.with_help("noweb --help lists the commands");
    streams.conclude(Ok(()), &[fault]);
    2
}

// Run the command that lists roots
/// The command `noroots [-t[N]] [file...]`.
fn run_noroots(args: &[OsString], streams: &mut Streams) -> u8 {
    let (web, faults) = match read_files(args, streams) {
        Ok(read) => read,
        Err(status) => return status,
    };
    let mut list = String::new().into_bytes();
    for chunk in &web.chunks {
        if !web.uses.contains_key(&chunk.name) {
            list.extend([b"<<", &chunk.name[..], b">>\n"].concat());
        }
    }
    let result = streams.output.write_all(&list);
    streams.conclude(result, &faults)
}

/// Reads files into a web; prints what is wrong and gives the status.
fn read_files(
    args: &[OsString],
    streams: &mut Streams,
) -> Result<(Web, Vec<Diagnostic>), u8> {
    let (tab, files, mut faults) = markup::read_arguments(args);
    let mut sources = Vec::new();
    for file in &files {
        match streams.read(file) {
            Ok(source) => sources.push(source),
            Err(fault) => faults.push(fault),
        }
    }
    let (web, more) = Web::read(sources, tab);
    faults.extend(more);
    match faults.is_empty() {
        true => Ok((web, faults)),
        false => Err(streams.conclude(Ok(()), &faults).min(1)),
    }
}

// Run the command that checks a web
/// The command `noweb check [file...]`.
fn run_check(args: &[OsString], streams: &mut Streams) -> u8 {
    let web = match read_files(args, streams) {
        Ok((web, _)) => web,
        Err(status) => return status,
    };
    let layout = tangle::Layout::default();
    let mut faults = Vec::new();
    for chunk in &web.chunks {
        // Look for failures below a root
        if web.uses.contains_key(&chunk.name) {
            continue;
        }
        let tangled = tangle::tangle(&web, &[&chunk.name], &layout);
        faults.extend(tangled.err().into_iter().flatten());
    }
    faults.extend(web.undefined());
    let mut seen = Vec::new();
    faults.retain(|fault: &Diagnostic| {
        let fresh = !seen.contains(&fault.position);
        seen.push(fault.position.clone());
        fresh
    });
    faults.extend(web.unused(project::is_file_name));
    faults.extend(web.adrift());
    faults.extend(web.forward());
    streams.conclude(Ok(()), &faults).min(1)
}
