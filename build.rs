// Tangles the chapters into src/ before cargo compiles it.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//
// The chapters are those that the master litpt.nw includes. The sources of
// the tool are left alone: `make boot` tangles them (an error in the tool's
// chapters would otherwise leave a build that cannot repair itself).

use std::path::{Path, PathBuf};

use noweb_core::diagnostic::Diagnostic;
use noweb_core::project::{Project, included};

const MASTER: &str = "litpt.nw";

fn main() {
    match tangle() {
        Ok(watched) => {
            for path in watched {
                println!("cargo::rerun-if-changed={}", path.display());
            }
        }
        // Cargo shows nothing else of a build that says what is wrong.
        Err(message) => {
            let lines = message.lines();
            lines.for_each(|line| println!("cargo::error={line}"));
            if message.contains("noweb untangle") {
                println!("cargo::error=Here, `make untangle' does that.");
            }
        }
    }
}

/// Tangles the chapters; returns the files on which that depends.
fn tangle() -> Result<Vec<PathBuf>, String> {
    let chapters = included(Path::new("."), Path::new(MASTER))
        .map_err(|error| format!("{MASTER}: {error}"))?;
    let mut watched = chapters.clone();
    let project = Project {
        record: PathBuf::from("src/.tangled"),
        chapters,
        words: format!(" {MASTER}"),
        ..Project::default()
    };
    let all = |diagnostics: Vec<Diagnostic>| {
        let lines = diagnostics.iter().map(|d| d.to_string());
        lines.collect::<Vec<_>>().join("\n")
    };
    let plan = project.tangle().map_err(all)?;
    watched.extend(plan.program.files.into_iter().map(|(path, _)| path));
    Ok(watched)
}
