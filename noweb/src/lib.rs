// Tangled from noweb/chapters/stream.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A tool for literate programs that are written as noweb chunks.
//!
//! Its core tangles them. Here are its commands, each of which is also a
//! function: [`markup`] turns a web into a stream and back, [`notangle`]
//! expands roots, [`project`] writes the files of a program. [`locate`] and
//! [`map`] lead from the program back to the chapters, and the others weave.
//! Text is bytes throughout, for the prose may be in any encoding.

pub use noweb_core::{cpif, diagnostic, tangle, web};

pub mod command;
pub mod commonmark;
pub mod filter;
pub mod finduses;
pub mod locate;
pub mod map;
pub mod markdown;
pub mod markup;
pub mod new;
pub mod noidx;
pub mod notangle;
pub mod noweave;
pub mod project;
pub mod reading;
pub mod rust_index;
pub mod rust_names;
pub mod rust_uses;
pub mod split_scope;
pub mod stream;
pub mod totex;
pub mod untangle;

use std::ffi::{OsStr, OsString};
use std::io::{self, BufRead, Write};

use diagnostic::{
    Diagnostic, Faults, Level, Source, bytes_of, checked, shown,
};

/// The three streams of a command.
pub struct Streams<'a> {
    pub input: &'a mut dyn BufRead,
    pub output: &'a mut dyn Write,
    pub errors: &'a mut dyn Write,
}

impl Streams<'_> {
    pub fn read(&mut self, file: &OsStr) -> Result<Source, Faults> {
        let (name, read) = if file == "-" {
            let mut text = Vec::new();
            (&b""[..], self.input.read_to_end(&mut text).map(|_| text))
        } else {
            (file.as_encoded_bytes(), std::fs::read(file))
        };
        let cannot = |e| format!("couldn't open file {}: {e}", shown(file));
        let text = read.map_err(|e| error(cannot(e)))?;
        Ok(Source::new(name.to_vec(), text))
    }

    /// Reads some files, and reports all that cannot be read.
    pub fn sources(
        &mut self,
        all: &[OsString],
    ) -> Result<Vec<Source>, Faults> {
        let read = all.iter().map(|file| self.read(file));
        let (good, bad): (Vec<_>, Vec<_>) = read.partition(Result::is_ok);
        let bad = bad.into_iter().filter_map(Result::err).flatten();
        checked(good.into_iter().flatten().collect(), bad.collect())
    }

    /// Prints the diagnostics and gives the exit status.
    pub fn conclude(
        &mut self,
        result: io::Result<()>,
        faults: &[Diagnostic],
    ) -> u8 {
        for fault in faults {
            // If this fails, no place is left for a report.
            let _ = self.errors.write_all(&bytes_of(&fault.to_string()));
        }
        match result.and_then(|()| self.output.flush()) {
            Err(e) if e.kind() != io::ErrorKind::BrokenPipe => {
                let _ = writeln!(self.errors, "error: cannot write: {e}");
                status(faults).max(1)
            }
            _ => status(faults),
        }
    }

    /// Reports faults, whatever their levels; the status is 1.
    pub fn fail(&mut self, faults: &[Diagnostic]) -> u8 {
        self.conclude(Ok(()), faults);
        1
    }

    /// Reports wrong arguments of a command; the status is 2.
    pub fn misused(&mut self, text: impl Into<String>) -> u8 {
        let fault = Diagnostic::new(Level::Error, None, text)
            .with_help("noweb [COMMAND] --help tells more");
        self.conclude(Ok(()), &[fault]);
        2
    }

    /// Prints a text that was requested, such as a help.
    pub fn say(&mut self, text: &str) -> u8 {
        let result = self.output.write_all(text.as_bytes());
        self.conclude(result, &[])
    }
}

/// One error that has no position.
pub fn error(text: impl Into<String>) -> Faults {
    vec![Diagnostic::new(Level::Error, None, text)]
}

/// The exit status that a list of diagnostics leads to.
pub fn status(diagnostics: &[Diagnostic]) -> u8 {
    diagnostics.iter().map(|d| d.level as u8).max().unwrap_or(0)
}
