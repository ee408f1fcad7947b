// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Writes the scene of [`litpt_book::courtyard`] on standard output.
//!
//! Exit status: 0 done (also when the reader of a pipe left early), 1 the
//! scene could not be written, 2 wrong usage.

use std::env;
use std::io::{self, BufWriter, ErrorKind, Write};
use std::process::ExitCode;

use litpt_book::courtyard::{solids, write_obj};

// State the usage of the command
const HELP: &str = "\
usage: courtyard [-h | --help] > FILE.obj
Write an arcaded courtyard as a Wavefront OBJ (metres, y up).

To render it:
  pt -p 12.2,2.4,1.3 -t -12.6,6,-1.2 -u 0,1,0 -F 70 -d 800x600 \\
    -r 0.8 -n 64 -i FILE.obj -o FILE.pgm
";

// Choose between scene and help
fn main() -> ExitCode {
    let words: Vec<_> = env::args_os().skip(1).collect();
    if let Some(word) = words.first() {
        if words.len() == 1 && (word == "-h" || word == "--help") {
            return finish(|out| out.write_all(HELP.as_bytes()));
        }
        let word = words[words.len() - 1].to_string_lossy();
        report(&format!("unexpected argument '{word}'; see --help"));
        return ExitCode::from(2);
    }
    finish(|out| write_obj(&solids(), out))
}

// Write everything or say why not
fn finish(
    write: impl FnOnce(&mut BufWriter<io::StdoutLock>) -> io::Result<()>,
) -> ExitCode {
    let mut out = BufWriter::new(io::stdout().lock());
    match write(&mut out).and_then(|()| out.flush()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) if e.kind() == ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(e) => {
            report(&format!("cannot write to standard output: {e}"));
            ExitCode::FAILURE
        }
    }
}

// Report one line on standard error
fn report(message: &str) {
    let _ = writeln!(io::stderr(), "courtyard: error: {message}");
}
