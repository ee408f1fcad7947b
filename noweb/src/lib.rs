// Tangled from noweb/chapters/markup.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A tool for literate programs that are written as noweb chunks.
//!
//! Every stage is a function over values, and also a filter over text:
//! lines, then tokens ([`markup`]), then a web of chunks ([`web`]), then
//! either tangled text with its position map ([`tangle`]) or an annotated
//! stream that is woven. [`project`] writes the files of a program.
//! [`locate`] and [`map`] lead from the program back to the chapters.
//! Text is bytes throughout, for the prose may be in any encoding.

pub mod command;
pub mod commonmark;
pub mod cpif;
pub mod diagnostic;
pub mod filter;
pub mod locate;
pub mod map;
pub mod markup;
pub mod project;
pub mod tangle;
pub mod untangle;
pub mod web;

pub mod finduses;
pub mod markdown;
pub mod new;
pub mod noidx;
pub mod noweave;
pub mod rust_index;
pub mod rust_names;
pub mod rust_uses;
pub mod split_scope;
pub mod stream;
pub mod totex;

use std::ffi::{OsStr, OsString};
use std::io::{self, BufRead, Write};

use diagnostic::{
    Diagnostic, Faults, Level, Source, bytes_of, checked, error, shown,
    status,
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

    /// Reads some files, and tells of all that cannot be read.
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
            // There is nobody left to tell if this fails.
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

    /// Tells of faults, whatever their levels; the status is 1.
    pub fn fail(&mut self, faults: &[Diagnostic]) -> u8 {
        self.conclude(Ok(()), faults);
        1
    }

    /// Says what is wrong with the arguments of a command; the status is 2.
    pub fn misused(&mut self, text: impl Into<String>) -> u8 {
        let fault = Diagnostic::new(Level::Error, None, text)
            .with_help("noweb [COMMAND] --help tells more");
        self.conclude(Ok(()), &[fault]);
        2
    }

    /// Says what was asked for, such as a help.
    pub fn say(&mut self, text: &str) -> u8 {
        let result = self.output.write_all(text.as_bytes());
        self.conclude(result, &[])
    }
}
