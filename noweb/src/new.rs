// Tangled from noweb/chapters/new.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command `noweb new`: the start of a literate program.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use crate::Streams;
use crate::diagnostic::{Faults, failure};
use crate::project::{self, Project, included};
use crate::rust_names::is_keyword;

const COMMON: &[(&str, &str)] = &[
    ("Cargo.toml", include_str!("../new/Cargo.toml.in")),
    ("build.rs", include_str!("../new/build.rs.in")),
    (".gitignore", "/target\n/build\n"),
    (".editorconfig", include_str!("../new/editorconfig")),
    (".vscode/settings.json", include_str!("../new/settings.json")),
];

const MARKDOWN: &[(&str, &str)] = &[
    ("Makefile", include_str!("../new/markdown.mk")),
    ("book.toml", include_str!("../new/book.toml")),
    ("chapters/SUMMARY.md", include_str!("../new/SUMMARY.md")),
    ("chapters/greeting.md", include_str!("../new/greeting.md")),
    ("chapters/command.md", include_str!("../new/command.md")),
    ("chapters/figures/day.svg", include_str!("../new/day.svg")),
];

const LATEX: &[(&str, &str)] = &[
    ("Makefile", include_str!("../new/latex.mk")),
    ("book.nw", include_str!("../new/book.nw.in")),
    ("chapters/greeting.nw", include_str!("../new/greeting.nw.in")),
    ("chapters/command.nw", include_str!("../new/command.nw.in")),
];

/// `noweb new NAME [--latex | --markdown]`.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let words = args.iter().map(|arg| arg.to_str().unwrap_or_default());
    let (options, names): (Vec<_>, Vec<_>) =
        words.partition(|word| word.starts_with('-'));
    let (master, own) = match options[..] {
        [] | ["--markdown"] => ("chapters/SUMMARY.md", MARKDOWN),
        ["--latex"] => ("book.nw", LATEX),
        _ => return streams.misused("new takes --latex or --markdown"),
    };
    let is_sign = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    let is_name = |name: &str| {
        name.starts_with(|c: char| c.is_ascii_alphabetic())
            && name.chars().all(is_sign)
    };
    let name = match names[..] {
        [name] if is_name(name) && !is_reserved(name) => name,
        _ => {
            let what = "new needs a name of letters, digits, - and _ that \
                        neither Cargo nor Windows reserves";
            return streams.misused(what);
        }
    };
    match write(Path::new(name), name, master, own) {
        Ok(()) => streams.say(&format!("cd {name} && cargo run\n")),
        Err(faults) => streams.fail(&faults),
    }
}

fn write(
    dir: &Path,
    name: &str,
    master: &str,
    own: &[(&str, &str)],
) -> Result<(), Faults> {
    let fault = |e| failure("write", dir, e);
    fs::create_dir(dir).map_err(fault)?;
    for (path, text) in COMMON.iter().chain(own) {
        let mut text = text.replace("MASTER", master).replace("NAME", name);
        if *path == "Makefile" {
            text = text.replace("\n    ", "\n\t");
        }
        let path = dir.join(path);
        let parent = path.parent().unwrap_or(dir);
        let made = fs::create_dir_all(parent);
        made.and_then(|()| fs::write(path, text)).map_err(fault)?;
    }
    let chapters = included(dir, master.as_ref()).map_err(fault)?;
    let record = "src/.tangled".into();
    let project = project::of(chapters, String::new());
    Project { dir: dir.to_owned(), record, ..project }.tangle()?;
    Ok(())
}

/// Besides keywords, what Cargo's own command `new` refuses or warns of.
const RESERVED: &str = "build deps examples incremental test alloc core \
    proc-macro proc_macro std";

fn is_reserved(name: &str) -> bool {
    let lower = name.to_ascii_lowercase();
    let number = lower.strip_prefix("com").or(lower.strip_prefix("lpt"));
    is_keyword(name)
        || RESERVED.split(' ').any(|word| word == name)
        || ["con", "prn", "aux", "nul"].contains(&&lower[..])
        || number.is_some_and(|n| matches!(n.as_bytes(), [b'1'..=b'9']))
}
