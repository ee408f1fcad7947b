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

use crate::filter::Pipeline;
use crate::web::Chunk;
use crate::{Streams, cpif, map, markup, project, tangle, untangle};
// Use the modules that weave
use crate::{finduses, noidx, noweave, rust_index, split_scope, totex};

// List the commands
/// A command: its name, what runs it, and what it does.
type Command = (&'static str, Runner, &'static str);

type Runner = fn(&[OsString], &mut Streams) -> u8;

const COMMANDS: &[Command] = &[
    ("tangle", project::run, "write all files of a program"),
    ("untangle", untangle::run, "carry edits back to chapters"),
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
            Some((_, runner, _)) => runner(rest, streams),
            None => {
                let text = format!("unknown command {}", first.display());
                streams.misused(text)
            }
        },
        [] => streams.misused("which command?".into()),
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
    text += SYNTAX;
    let result = streams.output.write_all(text.as_bytes());
    streams.conclude(result, &[])
}

const SYNTAX: &str = "
tangle, untangle [-C DIR] [--record FILE] [--check] CHAPTER...
map MASTER... -- COMMAND [ARGUMENT...]
The others are those of noweb 2.12.
A symbolic link named after a command is that command.
";

fn version(streams: &mut Streams) -> u8 {
    let version = env!("CARGO_PKG_VERSION");
    let result = writeln!(streams.output, "noweb {version} (litpt)");
    streams.conclude(result, &[])
}

// Run the command that lists roots
/// The command `noroots [-t[N]] [file...]`.
fn run_noroots(args: &[OsString], streams: &mut Streams) -> u8 {
    let (tab, files, mut faults) = markup::read_arguments(args);
    let mut list = Vec::new();
    match Pipeline::default().read_web(&files, tab, streams) {
        Ok(web) if faults.is_empty() => {
            let root = |c: &&Chunk| !web.uses.contains_key(&c.name);
            for chunk in web.chunks.iter().filter(root) {
                list.extend([b"<<", &chunk.name[..], b">>\n"].concat());
            }
        }
        Ok(_) => (),
        Err(failure) => faults.extend(failure.faults),
    }
    let result = streams.output.write_all(&list);
    streams.conclude(result, &faults).min(1)
}
