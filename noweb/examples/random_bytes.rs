// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Random input for every stage, for a number of seconds.
//!
//! usage: cargo run -p noweb --example random_bytes [SECONDS [SEED]]
//!
//! The seeds are the chapters, the test cases and, where they are
//! installed, noweb's own examples. A panic ends the run; the input that
//! led to it is left in `noweb-fuzz-input`.

#[path = "../tests/common/exercise.rs"]
mod exercise;

use std::path::Path;
use std::time::{Duration, Instant};

use exercise::{Random, exercise, mutate};

fn main() {
    let mut args = std::env::args().skip(1);
    let mut number = |default: u64| {
        args.next().and_then(|arg| arg.parse().ok()).unwrap_or(default)
    };
    let duration = Duration::from_secs(number(60));
    let mut random = Random(number(1).max(1));
    let crate_dir = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut seeds = Vec::new();
    gather(&crate_dir.join("tests/cases"), &mut seeds);
    gather(&crate_dir.join("chapters"), &mut seeds);
    gather(&crate_dir.join("../chapters"), &mut seeds);
    gather(Path::new("/usr/share/doc/noweb/examples"), &mut seeds);
    let start = Instant::now();
    let mut count = 0_u64;
    while start.elapsed() < duration {
        let input = mutate(&seeds, &mut random);
        let result = std::panic::catch_unwind(|| exercise(&input));
        if result.is_err() {
            let saved = std::fs::write("noweb-fuzz-input", &input);
            eprintln!("input {count} panics; saved: {saved:?}");
            std::process::exit(1);
        }
        count += 1;
    }
    println!("{count} inputs, no panic");
}

/// The text of every file below a directory.
fn gather(dir: &Path, seeds: &mut Vec<Vec<u8>>) {
    for entry in std::fs::read_dir(dir).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            gather(&path, seeds);
        } else if let Ok(text) = std::fs::read(&path) {
            seeds.push(text);
        }
    }
}
