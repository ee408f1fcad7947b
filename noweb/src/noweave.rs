// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command `noweave`: chooses the stages of weaving and runs them.
//!
//! A stage is a shell command. Our own stages are run inside this
//! process, the others by the shell. If any stage fails, nothing is
//! written.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::os::unix::ffi::{OsStrExt, OsStringExt};

use crate::filter::{StagePath, run_shell};
use crate::stream::Outcome;
use crate::{
    Streams, finduses, markup, noidx, rust_index, split_scope, totex,
};

// Describe the pipeline of a document
/// What is to be run for a document.
struct Weaving {
    markup: Stage,
    filters: Vec<Stage>,
    backend: Stage,
    /// The `@header` and `@trailer` lines, unless the author has them.
    wrapper: Option<(String, String)>,
    /// Whether the source comes from the standard input.
    reads_input: bool,
    verbose: bool,
}

/// A shell command and arguments that the shell shall not look into.
#[derive(Clone)]
struct Stage {
    command: OsString,
    args: Vec<OsString>,
}

impl Stage {
    fn new(command: impl Into<OsString>) -> Stage {
        Stage { command: command.into(), args: Vec::new() }
    }
}

/// What the command line asks for.
#[derive(Default)]
struct CommandLine {
    markup: Option<OsString>,
    tabs: Vec<OsString>,
    files: Vec<OsString>,
    filters: Vec<Filter>,
    backend: Option<OsString>,
    wrapper: Wrapper,
    /// The options for noweb's style file.
    options: Vec<String>,
    delay: bool,
    /// The index finds the items of a Rust program by itself.
    autodefs: bool,
    tex_names: bool,
    verbose: bool,
}

/// A stage between markup and back end.
enum Filter {
    Command(OsString),
    References,
    Index(Option<OsString>),
}

#[derive(Default)]
enum Wrapper {
    #[default]
    Unspecified,
    None,
    Latex,
    Tex,
}

/// The stages between markup and back end.
fn filter_stages(
    filters: Vec<Filter>,
    noidx: &str,
    autodefs: bool,
) -> Vec<Stage> {
    let stages = filters.into_iter().map(|filter| match filter {
        Filter::Command(command) => vec![Stage::new(command)],
        Filter::References => vec![Stage::new(noidx)],
        Filter::Index(None) if autodefs => {
            vec![Stage::new("rustindex"), Stage::new(noidx)]
        }
        Filter::Index(words) => {
            let args = words.into_iter().collect();
            let finduses = Stage { command: "finduses".into(), args };
            vec![finduses, Stage::new(noidx)]
        }
    });
    stages.flatten().collect()
}

// Read the command line of noweave

impl CommandLine {
    fn read(args: &[OsString]) -> Result<CommandLine, String> {
        let mut request = CommandLine::default();
        let mut args = VecDeque::from(args.to_vec());
        while let Some(arg) = args.pop_front() {
            if arg == "-" || !arg.as_encoded_bytes().starts_with(b"-") {
                request.files.push(arg);
                continue;
            }
            // Take an option and its argument
            let option = arg.to_string_lossy().into_owned();
            let mut next = || {
                args.pop_front()
                    .ok_or_else(|| format!("{option} needs an argument"))
            };
            match &option[..] {
                // Take an option that chooses stages
                "-markup" => request.markup = Some(next()?),
                "-backend" => request.backend = Some(next()?),
                "-filter" => request.filters.push(Filter::Command(next()?)),
                "-x" => request.filters.push(Filter::References),
                "-index" => request.filters.push(Filter::Index(None)),
                "-indexfrom" => {
                    request.filters.push(Filter::Index(Some(next()?)));
                }
                "-autodefs" => match &next()?.to_string_lossy()[..] {
                    "rust" => request.autodefs = true,
                    other => {
                        return Err(format!(
                            "-autodefs {other}: we know rust alone"
                        ));
                    }
                },
                // Take an option about the document
                "-n" => request.wrapper = Wrapper::None,
                "-latex" if matches!(request.wrapper, Wrapper::None) => {}
                "-latex" => request.wrapper = Wrapper::Latex,
                "-tex" => request.wrapper = Wrapper::Tex,
                "-delay" => {
                    request.delay = true;
                    request.wrapper = Wrapper::None;
                }
                "-option" => {
                    let option = next()?.to_string_lossy().into_owned();
                    request.options.push(option);
                }
                "-texnames" => request.tex_names = true,
                "-v" => request.verbose = true,
                // Refuse what is not built yet
                "-html" | "-latex+html" | "-troff" | "-ascii" => {
                    return Err(format!(
                        "{option}: only LaTeX can be written; HTML is planned for a \
                        later version (another back end can be run with -backend)"
                    ));
                }
                "-showautodefs" => {
                    return Err(format!("{option}: we know rust alone"));
                }
                tab if tab.starts_with("-t") => request.tabs.push(arg),
                _ => return Err(refusal(&option)),
            }
        }
        request.check()?;
        Ok(request)
    }

    // Refuse options that contradict each other
    fn check(&self) -> Result<(), String> {
        let is_plain = |f: &Filter| matches!(f, Filter::References);
        if self.index() && self.filters.iter().any(is_plain) {
            let what = "you may not use -x with -index or -indexfrom";
            return Err(format!("{what} (drop the -x)"));
        }
        let is_index = |f: &Filter| matches!(f, Filter::Index(None));
        if self.autodefs && !self.filters.iter().any(is_index) {
            return Err("-autodefs serves an index (add -index)".into());
        }
        Ok(())
    }

    fn index(&self) -> bool {
        self.filters.iter().any(|f| matches!(f, Filter::Index(_)))
    }

    // Turn what was asked into a plan
    fn plan(self) -> Weaving {
        let reads_input =
            self.files.is_empty() || self.files.iter().any(|f| f == "-");
        let wrapper = self.wrapper();
        let options = self.backend_options();
        let noidx = if self.delay { "noidx -delay" } else { "noidx" };
        let args = [self.tabs, self.files].concat();
        let markup = self.markup.unwrap_or("markup".into());
        let backend = self.backend.unwrap_or("totex".into());
        Weaving {
            markup: Stage { command: markup, args },
            filters: filter_stages(self.filters, noidx, self.autodefs),
            backend: Stage { command: backend, args: options },
            wrapper,
            reads_input,
            verbose: self.verbose,
        }
    }

    fn backend_options(&self) -> Vec<OsString> {
        let is_xref = |o: &&String| *o == "shortxref" || *o == "longxref";
        let xref = self.options.iter().rfind(is_xref);
        let options = [
            (!self.index()).then(|| "-noindex".to_string()),
            self.delay.then(|| "-delay".to_string()),
            xref.map(|option| format!("-{option}")),
            self.tex_names.then(|| "-texnames".to_string()),
        ];
        options.into_iter().flatten().map(OsString::from).collect()
    }

    /// The lines before and after the stream, in the author's stead.
    fn wrapper(&self) -> Option<(String, String)> {
        match self.wrapper {
            Wrapper::None => None,
            Wrapper::Unspecified | Wrapper::Latex => Some((
                format!("@header latex {}", self.options.join(",")),
                "@trailer latex".into(),
            )),
            Wrapper::Tex => Some((
                format!("@header tex {}", self.shown_files()),
                "@trailer tex".into(),
            )),
        }
    }

    fn shown_files(&self) -> String {
        let names = self.files.iter().map(|file| file.to_string_lossy());
        names.collect::<Vec<_>>().join(" ")
    }
}

fn refusal(option: &str) -> String {
    format!(
        "Unrecognized option '{option}'\n\
        usage: noweave [-latex | -tex | -n | -delay] [-x | -index | \
        -indexfrom FILE]\n\
        \x20   [-filter COMMAND]... [-markup COMMAND] [-backend COMMAND] \
        [-texnames]\n\
        \x20   [-option OPTION]... [-t | -tN] [-v] [FILE]..."
    )
}

// Run the stages one after another
impl Weaving {
    /// The document, or the status if a stage fails.
    fn document(&self, streams: &mut Streams) -> Result<Vec<u8>, u8> {
        // Read the source from standard input
        let mut source = Vec::new();
        if self.reads_input {
            let read = streams.input.read_to_end(&mut source);
            read.map_err(|e| tell(streams, &format!("cannot read: {e}")))?;
        }
        let mut shell = Shell::default();
        let mut stream = shell.run(&self.markup, &source, streams)?;
        for filter in &self.filters {
            stream = shell.run(filter, &stream, streams)?;
        }
        shell.run(&self.backend, &self.wrap(stream), streams)
    }

    // Wrap a stream as a document
    fn wrap(&self, stream: Vec<u8>) -> Vec<u8> {
        match &self.wrapper {
            None => stream,
            Some((header, trailer)) => [
                format!("{header}\n").into_bytes(),
                stream,
                format!("{trailer}\n").into_bytes(),
            ]
            .concat(),
        }
    }

    // Show the pipeline
    fn show(&self) -> Vec<u8> {
        let markup = self.markup.shown();
        let mut text = match &self.wrapper {
            None => format!("{markup} |\n"),
            Some((header, trailer)) => {
                format!("(echo {header}\n {markup}\n echo {trailer}\n) |\n")
            }
        };
        for filter in &self.filters {
            text += &format!("{} |\n", filter.shown());
        }
        text += &format!("{}\n", self.backend.shown());
        text.into_bytes()
    }
}

/// Says what has gone wrong; gives the status for it.
fn tell(streams: &mut Streams, what: &str) -> u8 {
    let _ = writeln!(streams.errors, "noweave: {what}");
    1
}

/// Runs stages; prepares for the shell when the first one needs it.
#[derive(Default)]
struct Shell {
    path: Option<StagePath>,
}

impl Shell {
    /// What a stage writes when it reads `input`.
    fn run(
        &mut self,
        stage: &Stage,
        input: &[u8],
        streams: &mut Streams,
    ) -> Result<Vec<u8>, u8> {
        match stage.own() {
            Some((run, args)) => run_inside(run, &args, input, streams),
            None => self.run_outside(stage, input, streams),
        }
    }

    // Run a stage in the shell
    fn run_outside(
        &mut self,
        stage: &Stage,
        input: &[u8],
        streams: &mut Streams,
    ) -> Result<Vec<u8>, u8> {
        // Prepare the search path once
        if self.path.is_none() {
            let path = StagePath::new();
            let path = path.map_err(|e| tell(streams, &e.to_string()))?;
            self.path = Some(path);
        }
        let Some(path) = &self.path else { return Err(1) };
        let command = stage.shell_command();
        let output = run_shell(&command, input, path, streams);
        output.map_err(|failure| {
            streams.conclude(Ok(()), &failure.faults);
            1
        })
    }
}

fn run_inside(
    run: Run,
    args: &[OsString],
    mut input: &[u8],
    streams: &mut Streams,
) -> Result<Vec<u8>, u8> {
    let mut output = Vec::new();
    let status = run(
        args,
        &mut Streams {
            input: &mut input,
            output: &mut output,
            errors: &mut *streams.errors,
        },
    );
    if status == 0 { Ok(output) } else { Err(1) }
}

type Run = fn(&[OsString], &mut Streams) -> u8;

const OWN_STAGES: [(&str, Run); 6] = [
    ("markup", markup::run),
    ("finduses", finduses::run),
    ("rustindex", rust_index::run),
    ("noidx", noidx::run),
    ("totex", totex::run),
    ("split_scope", split_scope::run),
];

impl Stage {
    /// The function and arguments of a stage of ours.
    fn own(&self) -> Option<(Run, Vec<OsString>)> {
        let command = self.command.to_str()?;
        let mut words = command.split_whitespace().peekable();
        words.next_if_eq(&"noweb");
        let name = words.next().filter(|_| command.bytes().all(is_safe))?;
        let (_, run) = OWN_STAGES.iter().find(|(own, _)| *own == name)?;
        let words = words.map(OsString::from);
        Some((*run, words.chain(self.args.iter().cloned()).collect()))
    }

    // Write a stage as the shell reads it
    fn shell_command(&self) -> OsString {
        let mut command = self.command.clone();
        for arg in &self.args {
            let mut quoted = b" '".to_vec();
            for byte in arg.as_bytes() {
                match byte {
                    b'\'' => quoted.extend(b"'\\''"),
                    _ => quoted.push(*byte),
                }
            }
            quoted.push(b'\'');
            command.push(OsString::from_vec(quoted));
        }
        command
    }

    fn shown(&self) -> String {
        let command = self.command.to_string_lossy();
        let args = self.args.iter().map(|arg| arg.to_string_lossy());
        let words = std::iter::once(command).chain(args);
        words.collect::<Vec<_>>().join(" ")
    }
}

/// Whether a byte means nothing to the shell but itself.
fn is_safe(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || b" -_./".contains(&byte)
}

// Run noweave as a command
/// `noweave [OPTION]... [FILE]...`: weaves a document.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    match CommandLine::read(args) {
        Ok(request) => request.plan().run(streams),
        Err(what) => {
            Outcome::complaint("noweave", 1, &what).deliver(streams)
        }
    }
}

impl Weaving {
    fn run(&self, streams: &mut Streams) -> u8 {
        if self.verbose {
            let _ = streams.errors.write_all(&self.show());
        }
        match self.document(streams) {
            Ok(text) => Outcome::done(text).deliver(streams),
            Err(status) => status,
        }
    }
}
