// Tangled from noweb/chapters/totex.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command `noweave`: chooses the stages of weaving and runs them.
//!
//! A stage is a shell command. Our own stages are run inside this
//! process, the others by the shell. If any stage fails, nothing is
//! written.

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use crate::diagnostic::{Faults, bytes_of, shown};
use crate::error;
use crate::filter::{quoted, run_shell};
use crate::markdown::Form;
use crate::stream::Outcome;
use crate::{
    Streams, finduses, markdown, markup, noidx, rust_index, split_scope,
    totex,
};

/// A shell command, and arguments that the shell must not interpret.
struct Stage {
    command: OsString,
    args: Vec<OsString>,
}
#[derive(Default)]
struct Request {
    tabs: Vec<OsString>,
    files: Vec<OsString>,
    /// Shell commands that the stream goes through in turn.
    filters: Vec<OsString>,
    backend: Option<OsString>,
    bare: bool,
    options: Vec<OsString>,
    delay: bool,
    references: bool,
    index: bool,
    /// The index finds the items of a Rust program by itself.
    autodefs: bool,
    markdown: bool,
    tex_names: bool,
    verbose: bool,
}

/// The filters that an index needs.
const INDEX_FILTERS: [&str; 2] = ["finduses", "noidx"];

impl Request {
    fn read(args: &[OsString]) -> Result<Self, String> {
        let mut request = Self::default();
        let mut args = args.iter().cloned();
        while let Some(arg) = args.next() {
            let option = shown(&arg);
            let what = || format!("{option} needs an argument");
            let mut next = || args.next().ok_or_else(what);
            match &option[..] {
                // Parse an option for the filters
                "-backend" => request.backend = Some(next()?),
                "-filter" => request.filters.push(next()?),
                "-x" => {
                    request.references = true;
                    request.filters.push("noidx".into());
                }
                "-index" => {
                    request.index = true;
                    request
                        .filters
                        .extend(INDEX_FILTERS.map(OsString::from));
                }
                "-autodefs" => match &shown(next()?)[..] {
                    "rust" => request.autodefs = true,
                    other => {
                        let what = "we know rust alone";
                        return Err(format!("-autodefs {other}: {what}"));
                    }
                },
                // Parse an option for the document
                "-n" => request.bare = true,
                "-latex" => {}
                "-md" => request.markdown = true,
                "-delay" => (request.delay, request.bare) = (true, true),
                "-option" => request.options.push(next()?),
                "-texnames" => request.tex_names = true,
                "-v" => request.verbose = true,
                tab if tab.starts_with("-t") => request.tabs.push(arg),
                "-" => request.files.push(arg),
                bad if bad.starts_with('-') => {
                    Err(format!("Unrecognized option '{bad}'"))?
                }
                _ => request.files.push(arg),
            }
        }
        // Refuse options that contradict each other
        if request.index && request.references {
            let what = "you may not use -x with -index";
            return Err(format!("{what} (drop the -x)"));
        }
        if request.autodefs && !request.index {
            return Err("-autodefs serves an index (add -index)".into());
        }
        Ok(request)
    }
}
impl Request {
    fn stages(&self) -> Vec<Stage> {
        let args = [&self.tabs[..], &self.files].concat();
        let mut stages = vec![Stage { command: "markup".into(), args }];
        for filter in &self.filters {
            let name = match filter.to_str() {
                Some("finduses") if self.autodefs => "rustindex".into(),
                Some("noidx") if self.delay => "noidx -delay".into(),
                _ => filter.clone(),
            };
            stages.push(Stage { command: name, args: Vec::new() });
        }
        let command = self.backend.clone().unwrap_or("totex".into());
        // Choose the options of the back end
        let is_xref = |o: &&OsString| *o == "shortxref" || *o == "longxref";
        let xref = self.options.iter().rfind(is_xref);
        let options = [
            (!self.index).then(|| "-noindex".to_string()),
            self.delay.then(|| "-delay".to_string()),
            xref.map(|option| format!("-{}", shown(option))),
            self.tex_names.then(|| "-texnames".to_string()),
        ];
        let args =
            options.into_iter().flatten().map(OsString::from).collect();
        stages.push(Stage { command, args });
        stages
    }
}
impl Request {
    /// The document, or the status if a stage fails.
    fn document(&self, streams: &mut Streams) -> Result<Vec<u8>, u8> {
        if self.markdown {
            let pages = self.pages(streams);
            return pages.map_err(|faults| streams.fail(&faults));
        }
        let mut stream = Vec::new();
        if self.reads_input() {
            let read = streams.input.read_to_end(&mut stream);
            read.map_err(|e| tell(streams, &format!("cannot read: {e}")))?;
        }
        let stages = self.stages();
        for (number, stage) in (1..).zip(&stages) {
            if self.verbose {
                let line = bytes_of(&(shown(stage.line()) + "\n"));
                let _ = streams.errors.write_all(&line);
            }
            if number == stages.len() && !self.bare {
                let (head, tail) = (b"@header latex ", b"@trailer latex\n");
                let options = self.options.join(OsStr::new(","));
                let options = options.as_encoded_bytes();
                stream = [head, options, b"\n", &stream, tail].concat();
            }
            stream = stage.run(&stream, streams)?;
        }
        Ok(stream)
    }

    fn reads_input(&self) -> bool {
        self.files.is_empty() || self.files.iter().any(|f| f == "-")
    }
}

fn tell(streams: &mut Streams, what: &str) -> u8 {
    Outcome::complaint("noweave", 1, what).deliver(streams)
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
    /// The output of the stage for `input`.
    fn run(
        &self,
        mut input: &[u8],
        streams: &mut Streams,
    ) -> Result<Vec<u8>, u8> {
        if let Some((run, args)) = self.own() {
            let mut output = Vec::new();
            let (input, errors) = (&mut input, &mut *streams.errors);
            let mut own = Streams { input, output: &mut output, errors };
            let status = run(&args, &mut own);
            return if status == 0 { Ok(output) } else { Err(1) };
        }
        // Run a foreign stage in the shell
        run_shell(&self.line(), input, streams)
    }

    fn line(&self) -> OsString {
        let mut line = self.command.clone();
        self.args.iter().for_each(|arg| line.push(quoted(arg)));
        line
    }

    fn own(&self) -> Option<(Run, Vec<OsString>)> {
        let command = self.command.to_str()?;
        let safe =
            |b: u8| b.is_ascii_alphanumeric() || b" -_./".contains(&b);
        let mut words = command.split_whitespace().peekable();
        words.next_if_eq(&"noweb");
        let name = words.next().filter(|_| command.bytes().all(safe))?;
        let (_, run) = OWN_STAGES.iter().find(|(own, _)| *own == name)?;
        let words = words.map(OsString::from);
        Some((*run, words.chain(self.args.iter().cloned()).collect()))
    }
}

impl Request {
    /// The pages of chapters in Markdown, unless they go to files.
    fn pages(&self, streams: &mut Streams) -> Result<Vec<u8>, Faults> {
        // Refuse options that Markdown lacks
        let mut filters = self.filters.iter().map(shown);
        if let Some(other) =
            filters.find(|f| !INDEX_FILTERS.contains(&&f[..]))
        {
            return Err(error(format!("-md takes no filter ({other})")));
        }
        if self.reads_input() {
            return Err(error("-md needs files, whose names end in .md"));
        }
        let mut sources = streams.sources(&self.files)?;
        for source in &mut sources {
            let name = source.name.rsplit(|byte| *byte == b'/').next();
            source.name = name.unwrap_or_default().to_vec();
        }
        let form = match self.backend {
            None => Form::Document,
            Some(_) => Form::Files,
        };
        let pages = markdown::weave(&sources, form, self.autodefs)?;
        let Some(backend) = self.backend.clone() else {
            return Ok(pages.concat());
        };
        // Write the pages to the directory of split_scope
        let stage = Stage { command: backend, args: Vec::new() };
        let words = stage.own().map_or(Vec::new(), |(_, words)| words);
        let [option, dir] = &words[..] else {
            return Err(error("-md has the backend 'split_scope -o DIR'"));
        };
        if option != "-o" {
            return Err(error(format!("unknown option {}", shown(option))));
        }
        let names = sources.into_iter().map(|source| source.name);
        let pages: Vec<_> = names.zip(pages).collect();
        let place = |path: &Path| path.canonicalize().ok();
        let chapters = self.files.iter().map(|file| place(file.as_ref()));
        let chapters: Vec<_> = chapters.collect();
        for (i, (name, _)) in pages.iter().enumerate() {
            let page = Path::new(dir).join(OsStr::from_bytes(name));
            let is_twice =
                pages[..i].iter().any(|(other, _)| other == name);
            if is_twice || page.exists() && chapters.contains(&place(&page))
            {
                let page = shown(page);
                return Err(error(format!(
                    "{page} would replace another text"
                )));
            }
        }
        split_scope::write_pages(&pages, dir.as_ref()).map_err(error)?;
        Ok(Vec::new())
    }
}
/// `noweave [OPTION]... [FILE]...`: weaves a document.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let request = Request::read(args).map_err(|what| tell(streams, &what));
    match request.and_then(|request| request.document(streams)) {
        Ok(text) => Outcome::done(text).deliver(streams),
        Err(status) => status,
    }
}
