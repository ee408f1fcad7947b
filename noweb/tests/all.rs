// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! All tests of the tool in one program, which is linked once.

mod common;
mod differential;
#[path = "common/exercise.rs"]
mod exercise;
mod golden;
mod map;
mod markdown;
mod project;
mod properties;
mod regressions;
mod rust_index;
mod untangle;
mod weave_differential;
mod weave_split;
mod weave_streams;

/// A file that is no module here would not be run.
#[test]
fn each_file_of_tests_is_run() {
    let all = include_str!("all.rs");
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/tests");
    for entry in std::fs::read_dir(root).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let Some(name) = name.strip_suffix(".rs") else { continue };
        let known = all.contains(&format!("\nmod {name};\n"));
        assert!(known || ["all"].contains(&name), "{name}");
    }
}
