// Tangled from noweb/chapters/command.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command: which of the programs to be, and how to be it.
//!
//! Called through a symbolic link, the program is what the link is called;
//! called as `noweb`, it is the command that its first argument names.

use std::ffi::{OsStr, OsString};
use std::io::{self, BufReader, BufWriter, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::sleep;
use std::time::Duration;

use crate::diagnostic::shown;
use crate::filter::read_web;
use crate::web::Chunk;
use crate::{Streams, map, markup, notangle, project, untangle};
use crate::{finduses, markdown, new, noidx, noweave, rust_index};
use crate::{split_scope, totex};

/// A command: its name, what runs it, what it does, and its arguments.
type Command = (&'static str, Runner, &'static str, &'static str);

type Runner = fn(&[OsString], &mut Streams) -> u8;

const COMMANDS: &[Command] = &[
    ("new", new::run, "begin a literate program", NEW),
    ("tangle", project::run, "write all files of a program", PROJECT),
    ("untangle", untangle::run, "carry edits back to chapters", PROJECT),
    ("map", map::run, "run a command, its positions translated", MAP),
    ("notangle", notangle::run, "extract one chunk, expanded", NOTANGLE),
    ("noroots", run_noroots, "list the chunks that none uses", MARKUP),
    ("markup", markup::run, "turn a web into a stream", MARKUP),
    ("nt", notangle::run_nt, "extract a chunk from a stream", NOTANGLE),
    ("noweave", noweave::run, "weave chapters into a document", NOWEAVE),
    ("finduses", finduses::run, "mark uses of identifiers", "[-noquote]"),
    ("rustindex", rust_index::run, "find items of Rust and uses", ""),
    ("noidx", noidx::run, "resolve cross-references", "[-delay]"),
    ("totex", totex::run, "turn a stream into LaTeX", TOTEX),
    ("split_scope", split_scope::run, "write LaTeX, file by file", SPLIT),
    ("mdbook", markdown::run, "weave as a preprocessor of mdBook", ""),
];

/// Standard output was closed when the program was started, or open for
/// reading alone.
static CLOSED: AtomicBool = AtomicBool::new(false);

/// Called when the program is loaded.
#[used]
#[cfg_attr(target_os = "linux", unsafe(link_section = ".init_array"))]
static BEFORE_MAIN: extern "C" fn() = look_at_output;

unsafe extern "C" {
    fn fcntl(descriptor: i32, command: i32, ...) -> i32;
}

extern "C" fn look_at_output() {
    // SAFETY: F_GETFL, which is 3, reads the flags of a number.
    let flags = unsafe { fcntl(1, 3) };
    // The last two bits are zero if it may only be read.
    CLOSED.store(flags < 0 || flags & 3 == 0, Relaxed);
}

/// An output that waits until there is room; true if it is closed.
struct Patient<S>(S, bool);

fn patiently<T>(mut act: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    loop {
        match act() {
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => {
                sleep(Duration::from_millis(1));
            }
            result => return result,
        }
    }
}

impl<W: Write> Write for Patient<W> {
    fn write(&mut self, text: &[u8]) -> io::Result<usize> {
        match self.1 {
            true => Err(io::Error::other("standard output is closed")),
            false => patiently(|| self.0.write(text)),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        patiently(|| self.0.flush())
    }
}

/// The whole program: finds its name, its streams and its status.
pub fn main() -> ExitCode {
    let mut args = std::env::args_os();
    let called = args.next().unwrap_or_default();
    let args: Vec<OsString> = args.collect();
    let mut input = BufReader::new(io::stdin().lock());
    let output = Patient(io::stdout().lock(), CLOSED.load(Relaxed));
    let mut output = BufWriter::new(output);
    let mut errors = Patient(io::stderr().lock(), false);
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
    let (command, args) = match (find(name), args) {
        (None, [first, rest @ ..]) if find(first).is_some() => {
            (find(first), rest)
        }
        called => called,
    };
    let first = args.first().map(shown);
    match (first.as_deref(), command) {
        (Some("-h" | "--help"), _) => {
            streams.say(&command.map_or_else(help, help_of))
        }
        (Some("-V" | "--version"), _) => streams.say(VERSION),
        (_, Some((_, run, ..))) => run(args, streams),
        // Refuse what is no command
        (Some(first), None) => {
            streams.misused(format!("unknown command {first}"))
        }
        (None, None) => streams.misused("which command?"),
    }
}

fn find(name: &OsStr) -> Option<&'static Command> {
    COMMANDS.iter().find(|(known, ..)| name == *known)
}

const NOWEAVE: &str = "[OPTION...] [FILE...]

  -md             write Markdown of chapters in Markdown
  -n, -delay      write no preamble, or the author's own first line
  -x, -index      cross-reference chunks, or identifiers as well
  -autodefs rust  find what a Rust program defines
  -filter COMMAND    send the stream through a command of the shell
  -backend COMMAND   write the document with this command
  -option NAME    an option of the style file
  -texnames       the names of chunks are LaTeX
  -t, -tN         keep tabs, or expand them at every N columns [-t8]
  -v              say which stages are run";

const TOTEX: &str = "[-delay] [-noindex] [-no-gen-comment] [-texnames]";

const SPLIT: &str = "[-o DIR] [OPTION OF TOTEX...]

  -o DIR          where the files go [.]";

fn help() -> String {
    let mut text = String::from("usage: noweb COMMAND [ARGUMENT...]\n\n");
    for (name, _, purpose, _) in COMMANDS {
        text += &format!("  {name:<12} {purpose}\n");
    }
    text + "\nnoweb COMMAND --help tells what may follow a command.\n\
        A symbolic link named after a command is that command.\n"
}

fn help_of((name, _, purpose, arguments): &Command) -> String {
    let usage = format!("usage: noweb {name} {arguments}");
    format!("{}\n\n{name} - {purpose}\n", usage.trim_end())
}

const VERSION: &str =
    concat!("noweb ", env!("CARGO_PKG_VERSION"), " (litpt)\n");

const NEW: &str = "NAME [--markdown | --latex]";

const PROJECT: &str = "[-C DIR] [--record FILE] [--check] CHAPTER...

  CHAPTER         the chapters, or one that includes them: a master

  -C DIR          the directory that paths are relative to
  --record FILE   the checksums of what was tangled [.tangled, or beside files]
  --check         change nothing, and fail if there is anything to change";

const MAP: &str = "MASTER... -- COMMAND [ARGUMENT...]

  MASTER          a file that includes the chapters of a web";

const MARKUP: &str = "[-t | -tN] [FILE...]

  -t, -tN         keep tabs, or expand them at every N columns [-t8]";

const NOTANGLE: &str = "[OPTION...] [FILE...]

  -Rname          extract the chunk of this name [*]
  -Lformat        mark where lines come from: %F the file, %L the line,
                  %N a newline, %% a percent sign
  -tN             keep tabs, and indent with tabs of N columns
  -filter COMMAND    send the stream through a command of the shell";

/// The command `noroots [-t[N]] [file...]`.
fn run_noroots(args: &[OsString], streams: &mut Streams) -> u8 {
    let (tab, files, faults) = markup::read_arguments(args);
    let told = streams.conclude(Ok(()), &faults);
    let Ok(web) = read_web(&files, &[], tab, streams) else { return 1 };
    let root = |c: &&Chunk| told == 0 && !web.uses.contains_key(&c.name);
    let roots = web.chunks.iter().filter(root);
    let lines = roots.map(|c| [b"<<", &c.name[..], b">>\n"].concat());
    let lines: Vec<_> = lines.collect();
    let result = streams.output.write_all(&lines.concat());
    streams.conclude(result, &[]).max(told).min(1)
}
