// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Our weaving stages against the real ones, byte for byte, on noweb's own
//! examples: each alone and several together, with all options.
//!
//! Both read the same input, which the real stages have made. Without
//! noweb there is nothing to compare, unless LITPT_NOWEB_ORACLE demands it.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{Outcome, Scratch, links, oracle, shell};

const EXAMPLES: &str = "/usr/share/doc/noweb/examples";

/// The real stages, ours, and a place to work in.
struct Bench {
    real: PathBuf,
    ours: Scratch,
    work: Scratch,
}

impl Bench {
    fn new() -> Option<Bench> {
        let real = oracle()?;
        Some(Bench { real, ours: links(), work: Scratch::new() })
    }

    /// Runs a real command on `input` for the stage that comes next.
    fn prepare(&self, command: &str, input: &str, output: &str) {
        let command = format!("{command} <{input} >{output}");
        let outcome = shell(&command, self.work.path(), &self.real);
        assert_eq!(outcome.status, 0, "{command}: {}", outcome.stderr());
    }

    /// Runs a command with both families of programs.
    fn compare(&self, command: &str) {
        self.compare_with(command, command);
    }

    fn compare_with(&self, real: &str, ours: &str) {
        let theirs = self.run(real, &self.real);
        let mine = self.run(ours, self.ours.path());
        let (ours_status, their_status) = (mine.status, theirs.status);
        assert_eq!(ours_status, their_status, "{ours}: {}", mine.stderr());
        let difference = first_difference(&mine.stdout, &theirs.stdout);
        assert_eq!(difference, None, "{ours}");
    }

    fn run(&self, command: &str, commands: &Path) -> Outcome {
        shell(command, self.work.path(), commands)
    }
}

/// The first line in which two texts differ, ours and theirs.
fn first_difference(ours: &[u8], theirs: &[u8]) -> Option<String> {
    if ours == theirs {
        return None;
    }
    let mut pairs =
        ours.split(|b| *b == b'\n').zip(theirs.split(|b| *b == b'\n'));
    let shown = pairs.find(|(a, b)| a != b).map(|(a, b)| {
        let (a, b) =
            (String::from_utf8_lossy(a), String::from_utf8_lossy(b));
        format!("{a}\n   not\n{b}")
    });
    Some(shown.unwrap_or_else(|| "one is longer".into()))
}

/// Sets of examples: each alone, and some together.
fn examples() -> Vec<String> {
    let entries = fs::read_dir(EXAMPLES).expect("noweb's examples");
    let paths = entries.map(|e| e.expect("an entry").path());
    let is_web = |p: &PathBuf| p.extension().is_some_and(|e| e == "nw");
    let mut sets: Vec<String> =
        paths.filter(is_web).map(|p| p.display().to_string()).collect();
    sets.sort();
    assert!(sets.len() > 8, "only {} examples", sets.len());
    sets.push(sets.join(" "));
    sets.push(format!("{EXAMPLES}/wc.nw {EXAMPLES}/dag.nw"));
    sets
}

#[test]
fn finduses_agrees_on_all_examples() {
    let Some(bench) = Bench::new() else { return };
    for files in examples() {
        bench.prepare(&format!("markup {files}"), "/dev/null", "marked");
        bench.compare("finduses <marked");
        bench.compare("finduses -noquote <marked");
    }
}

#[test]
fn noidx_agrees_on_all_examples() {
    let Some(bench) = Bench::new() else { return };
    for files in examples() {
        bench.prepare(&format!("markup {files}"), "/dev/null", "marked");
        bench.prepare("finduses", "marked", "used");
        bench.compare("noidx <marked");
        bench.compare("noidx <used");
        // With several files -delay differs on purpose.
        if !files.contains(' ') {
            bench.compare("noidx -delay <used");
        }
    }
}

#[test]
fn totex_agrees_on_all_examples_if_names_are_left_to_tex() {
    let Some(bench) = Bench::new() else { return };
    for files in examples() {
        bench.prepare(&format!("markup {files}"), "/dev/null", "marked");
        bench.prepare("finduses", "marked", "used");
        bench.prepare("noidx -delay", "used", "resolved");
        for options in ["", "-delay", "-noindex", "-no-gen-comment -delay"]
        {
            let stream =
                if options.is_empty() { "used" } else { "resolved" };
            bench.compare_with(
                &format!("totex {options} <{stream}"),
                &format!("totex -texnames {options} <{stream}"),
            );
        }
    }
}

#[test]
fn totex_agrees_without_options_if_no_name_is_special() {
    let Some(bench) = Bench::new() else { return };
    let mut compared = 0;
    for files in examples() {
        bench.prepare(&format!("markup {files}"), "/dev/null", "marked");
        bench.prepare("noidx", "marked", "resolved");
        let stream = bench.work.path().join("resolved");
        let stream = fs::read(stream).expect("the stream");
        if !has_special_names(&stream) {
            bench.compare("totex <resolved");
            compared += 1;
        }
    }
    assert!(compared > 2, "only {compared} examples have plain names");
}

fn has_special_names(stream: &[u8]) -> bool {
    stream.split(|b| *b == b'\n').any(|line| {
        let named =
            [&b"@defn "[..], b"@use ", b"@file ", b"@xref notused "];
        named.iter().any(|start| line.starts_with(start))
            && line.iter().any(|byte| b"_&#%$~^{}\\[".contains(byte))
    })
}

#[test]
fn noweave_agrees_on_all_examples() {
    let Some(bench) = Bench::new() else { return };
    for files in examples() {
        for options in ["", "-x", "-index", "-n -index", "-latex -x"] {
            bench.compare_with(
                &format!("noweave {options} {files}"),
                &format!("noweave {options} -texnames {files}"),
            );
        }
    }
}

#[test]
fn foreign_stages_stand_between_ours() {
    let Some(bench) = Bench::new() else { return };
    let files = format!("{EXAMPLES}/wc.nw {EXAMPLES}/primes.nw");
    let library = bench.real.display();
    let filters =
        format!("-filter {library}/finduses -filter {library}/noidx");
    bench.compare_with(
        &format!("noweave -index {files}"),
        &format!("noweave {filters} -backend 'totex -texnames;:' {files}"),
    );
}
