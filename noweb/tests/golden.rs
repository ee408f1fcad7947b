// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Our commands against what noweb 2.12 was recorded to do.
//!
//! `tests/record.sh` makes the recordings. Where ours differs on purpose,
//! a case holds what ours does, and why.

use crate::common::{Case, Outcome, difference, links, shell};

#[test]
fn every_case_gives_what_was_recorded() {
    let links = links();
    let mut wrong = Vec::new();
    let cases = Case::all();
    assert!(cases.len() > 80, "only {} cases are there", cases.len());
    for case in cases {
        let copy = case.copy();
        let outcome = shell(&case.command, copy.path(), links.path());
        wrong.extend(compare(&case, &outcome));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_deliberate_difference_says_why() {
    for case in Case::all() {
        let ours = ["ours.stdout", "ours.status", "ours.stderr"];
        let differs = ours.iter().any(|name| case.file(name).is_some());
        let why = case.file("why").is_some_and(|why| why.len() > 20);
        assert_eq!(differs, why, "case {}", case.name);
    }
}

fn compare(case: &Case, outcome: &Outcome) -> Vec<String> {
    let expected = |name: &str| {
        let ours = case.file(&format!("ours.{name}"));
        ours.or_else(|| case.file(name)).unwrap_or_default()
    };
    let mut wrong = Vec::new();
    let mut differ = |what: &str, ours: &str, theirs: &[u8]| {
        let theirs = String::from_utf8_lossy(theirs);
        let (name, difference) = (&case.name, difference(ours, &theirs));
        wrong.push(format!("{name}: {what}: {difference}"));
    };
    if outcome.stdout != expected("stdout") {
        differ("stdout", &outcome.stdout(), &expected("stdout"));
    }
    let status = format!("{}\n", outcome.status);
    if status.as_bytes() != expected("status") {
        differ("status", &status, &expected("status"));
    }
    // The words of a message are ours; that there is one is noweb's.
    let stderr = expected("stderr");
    let agree = match case.file("ours.stderr") {
        Some(ours) => outcome.stderr == ours,
        None => outcome.stderr.is_empty() == stderr.is_empty(),
    };
    if !agree {
        differ("stderr", &outcome.stderr(), &stderr);
    }
    wrong
}
