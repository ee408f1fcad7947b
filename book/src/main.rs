// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Makes the figures and tables of the book: `litpt-book PART [WORD...]`.

mod programs;

use std::process::ExitCode;

use programs::ALL;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let first = words.first().map_or("", String::as_str);
    let Some((_, run)) = ALL.iter().find(|(name, _)| *name == first) else {
        // List the parts of the book's program
        let names: Vec<_> = ALL.iter().map(|(name, _)| *name).collect();
        eprintln!("usage: litpt-book PART [WORD...]");
        eprintln!("where PART is one of {}", names.join(", "));
        return ExitCode::from(2);
    };
    match run(&words[1..]) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{first}: {error}");
            ExitCode::FAILURE
        }
    }
}
