// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Our commands against the real noweb, where it is installed.
//!
//! With LITPT_NOWEB_ORACLE=1 in the environment its absence is a failure;
//! otherwise these tests pass without looking when it is absent.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{
    Case, Outcome, Scratch, difference, links, oracle, run, shell,
};

const EXAMPLES: &str = "/usr/share/doc/noweb/examples";

/// The examples that come with noweb, or else demand them.
fn examples() -> Vec<PathBuf> {
    let entries = fs::read_dir(EXAMPLES).into_iter().flatten().flatten();
    let paths = entries.map(|entry| entry.path());
    let mut examples: Vec<PathBuf> = paths
        .filter(|p| p.extension().is_some_and(|e| e == "nw"))
        .collect();
    examples.sort();
    assert!(examples.len() >= 8, "noweb's examples are not in {EXAMPLES}");
    examples
}

/// Both families on one line of shell: what differs, if anything.
///
/// When noweb fails, our output is empty where its is partial.
fn compare(
    command: &str,
    dir: &Path,
    ours: &Path,
    theirs: &Path,
) -> Option<String> {
    let ours = shell(command, dir, ours);
    let theirs = shell(command, dir, theirs);
    let failed = theirs.status >= 2;
    let same = ours.status == theirs.status
        && (ours.stdout == theirs.stdout
            || failed && ours.stdout.is_empty());
    let why = difference(&ours.stdout(), &theirs.stdout());
    let statuses = (ours.status, theirs.status);
    (!same).then(|| format!("{command}: {statuses:?}: {why}"))
}

#[test]
fn the_recordings_are_what_noweb_does_today() {
    let Some(theirs) = oracle() else { return };
    for case in Case::all() {
        let copy = case.copy();
        let outcome = shell(&case.command, copy.path(), &theirs);
        let recorded = Outcome {
            stdout: case.file("stdout").unwrap_or_default(),
            stderr: outcome.stderr.clone(),
            status: outcome.status,
        };
        assert_eq!(outcome, recorded, "case {}", case.name);
        let status = format!("{}\n", outcome.status).into_bytes();
        assert_eq!(Some(status), case.file("status"), "case {}", case.name);
    }
}

#[test]
fn every_root_of_every_example_tangles_alike() {
    let Some(theirs) = oracle() else { return };
    let links = links();
    let mut wrong = Vec::new();
    let mut count = 0;
    for example in examples() {
        let file = example.to_str().expect("a plain path");
        for root in roots(file) {
            let root = format!("'-R{}'", root.replace('\'', "'\\''"));
            for layout in ["", "-t8", "-t4", "-L", "-L'%F:%+1L%N'"] {
                let command = format!("notangle {root} {layout} {file}");
                let dir = Path::new("/");
                wrong.extend(compare(&command, dir, links.path(), &theirs));
                count += 1;
            }
        }
    }
    assert!(count > 100, "only {count} comparisons");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The roots of a file, as our command lists them.
fn roots(file: &str) -> Vec<String> {
    let list = run(Path::new("/"), &["noroots", file]).stdout();
    let name = |line: &str| {
        let name = line.strip_prefix("<<")?.strip_suffix(">>")?;
        Some(name.to_owned())
    };
    list.lines().filter_map(name).collect()
}

#[test]
fn every_example_has_the_same_stream_and_the_same_roots() {
    let Some(theirs) = oracle() else { return };
    let links = links();
    let mut wrong = Vec::new();
    let mut files: Vec<String> =
        examples().iter().map(|p| p.display().to_string()).collect();
    files.push(files.join(" "));
    for file in &files {
        for command in ["markup", "markup -t", "markup -t4"] {
            let command = format!("{command} {file}");
            let dir = Path::new("/");
            wrong.extend(compare(&command, dir, links.path(), &theirs));
        }
        let command = format!("noroots {file} | LC_ALL=C sort");
        wrong.extend(compare(
            &command,
            Path::new("/"),
            links.path(),
            &theirs,
        ));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn damaged_examples_are_read_alike() {
    let Some(theirs) = oracle() else { return };
    let links = links();
    let scratch = Scratch::new();
    let seeds: Vec<Vec<u8>> = examples()
        .iter()
        .map(|path| fs::read(path).expect("a readable example"))
        .collect();
    let mut random = exercise::Random(7);
    let mut wrong = Vec::new();
    for number in 0..60 {
        let mut input = exercise::mutate(&seeds, &mut random);
        // C ends a line at a zero byte; ours goes on to its end.
        input.retain(|byte| *byte != 0);
        let file = format!("{number}.nw");
        scratch.write(&file, &input);
        for command in ["markup", "notangle -Rx", "noroots"] {
            let sorted = if command == "noroots" { " | sort" } else { "" };
            let command = format!("{command} {file}{sorted}");
            let dir = scratch.path();
            if sorted.is_empty() || !fails(&file, dir, links.path()) {
                wrong.extend(compare(&command, dir, links.path(), &theirs));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Is the file in error? Then noroots lists nothing, unlike noweb's.
fn fails(file: &str, dir: &Path, ours: &Path) -> bool {
    shell(&format!("markup {file}"), dir, ours).status != 0
}

use crate::exercise;
