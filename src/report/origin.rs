// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! By what, when and where a run was begun.

use std::env;
use std::fs;
use std::time::SystemTime;

use humantime::format_rfc3339_seconds;

use super::result::Report;

impl Report {
    /// The report of this process of a program, of which nothing else is
    /// known yet.
    pub fn begin(program: &str) -> Self {
        let words = env::args_os();
        let words = words.map(|word| quoted(&word.to_string_lossy()));
        Self {
            program: format!("{program} {}", env!("CARGO_PKG_VERSION")),
            command: words.collect::<Vec<_>>().join(" "),
            date: format_rfc3339_seconds(SystemTime::now()).to_string(),
            processor: processor(),
            ..Self::default()
        }
    }
}

/// A word as a shell has to be given it.
fn quoted(word: &str) -> String {
    let harmless =
        |c: char| c.is_ascii_alphanumeric() || "-_./,:=+@".contains(c);
    match !word.is_empty() && word.chars().all(harmless) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', r"'\''")),
    }
}

fn processor() -> String {
    let file = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = file.lines().find_map(|line| {
        let (key, name) = line.split_once(':')?;
        (key.trim() == "model name").then(|| name.trim().to_owned())
    });
    name.unwrap_or_else(|| env::consts::ARCH.to_owned())
}
