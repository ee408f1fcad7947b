//! The chapter on tests names every part and script of the book, and each
//! is called by something.
//!
//! Copyright (C) 2026 litpt contributors
//! SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

fn read(path: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    fs::read_to_string(root.join(path)).unwrap()
}

/// The names of the files in a folder of the book, without `.rs`.
fn files(folder: &str) -> BTreeSet<String> {
    let book = Path::new(env!("CARGO_MANIFEST_DIR"));
    let entries = fs::read_dir(book.join(folder)).unwrap();
    let names = entries.map(|e| e.unwrap().file_name().into_string());
    names.map(|n| n.unwrap().trim_end_matches(".rs").to_owned()).collect()
}

/// What stands in the table, with the command that is said to call it.
fn table() -> Vec<(String, String)> {
    let chapter = read("chapters/verification.nw");
    let from = chapter.find("\\label{tab:programs}").unwrap();
    let table = chapter[from..].split("\\end{table}").next().unwrap();
    let argument = |row: &str, command: &str| {
        let rest = row.rsplit_once(command)?.1;
        Some(rest.split_once('}')?.0.replace("\\_", "_"))
    };
    let rows = table.lines().filter(|row| row.contains("\\file{"));
    rows.map(|row| {
        let name = argument(row, "\\file{").unwrap();
        (name, argument(row, "\\ident{").unwrap())
    })
    .collect()
}

#[test]
fn the_table_names_what_is_there_and_nothing_else() {
    let named: BTreeSet<_> = table().into_iter().map(|row| row.0).collect();
    let mut there = files("src/programs");
    there.extend(files("scripts"));
    there.insert("courtyard".to_owned());
    assert_eq!(named, there);
}

#[test]
fn everything_in_the_table_is_called() {
    let makefiles = read("Makefile") + &read("book/book.mk");
    for (name, command) in table() {
        let word = |c: char| c.is_alphanumeric() || "-._".contains(c);
        let mut words = makefiles.split(|c| !word(c));
        assert!(
            words.any(|w| w.trim_end_matches(".stamp") == name),
            "{name}"
        );
        let verb = command.strip_prefix("make ").unwrap();
        let rule = makefiles.lines().any(|line| {
            line.strip_prefix(verb)
                .is_some_and(|rest| rest.starts_with(':'))
        });
        assert!(rule, "no rule for {command}, which is to call {name}");
    }
}
