// Tangles the chapters into src/ before cargo compiles it.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//
// The chapters are those that the master litpt.nw includes. The sources of
// the tool are left alone: `make boot` tangles them (an error in the tool's
// chapters would otherwise leave a build that cannot repair itself).

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use noweb::project::{Project, included};

const MASTER: &str = "litpt.nw";

fn main() -> ExitCode {
    match tangle() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            if message.contains("noweb untangle") {
                eprintln!("Here, `make untangle' does that.");
            }
            ExitCode::FAILURE
        }
    }
}

fn tangle() -> Result<(), String> {
    let chapters = included(Path::new("."), Path::new(MASTER))
        .map_err(|error| format!("{MASTER}: {error}"))?;
    for chapter in &chapters {
        println!("cargo::rerun-if-changed={}", chapter.display());
    }
    let project = Project {
        dir: PathBuf::from("."),
        record: PathBuf::from("src/.tangled"),
        chapters,
    };
    let all = |diagnostics: Vec<noweb::diagnostic::Diagnostic>| {
        let lines = diagnostics.iter().map(|d| d.to_string());
        lines.collect::<Vec<_>>().join("\n")
    };
    let plan = project.tangle().map_err(all)?;
    for output in plan.outputs {
        println!("cargo::rerun-if-changed={}", output.path.display());
    }
    Ok(())
}
