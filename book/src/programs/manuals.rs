// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The manual pages and completions of `pt`, `ptimg` and `ptview`, from the
//! declarations of their options: `manuals DIRECTORY` writes them where
//! `make install` wants them below a prefix.

use std::fs;
use std::path::Path;

use clap::{Command, CommandFactory};
use clap_complete::{Shell, generate};
use litpt::cli::options::{Options, ViewOptions};

use super::Done;

// The options of ptimg are declared in its binary.
#[allow(dead_code)]
#[path = "../../../src/bin/ptimg.rs"]
mod ptimg;

/// The folder of each shell's completions, before and after the name.
const SHELLS: [(Shell, &str, &str); 3] = [
    (Shell::Bash, "bash-completion/completions/", ""),
    (Shell::Zsh, "zsh/site-functions/_", ""),
    (Shell::Fish, "fish/vendor_completions.d/", ".fish"),
];

pub fn run(arguments: &[String]) -> Done {
    let directory = arguments.first().ok_or("usage: manuals DIRECTORY")?;
    let share = Path::new(directory);
    let commands = [
        Options::command(),
        ptimg::Arguments::command(),
        ViewOptions::command(),
    ];
    for command in commands {
        for (shell, before, after) in SHELLS {
            let name = command.get_name();
            let path = share.join(format!("{before}{name}{after}"));
            let mut text = vec![];
            generate(shell, &mut command.clone(), name, &mut text);
            fs::create_dir_all(path.parent().ok_or("no folder")?)?;
            fs::write(path, text)?;
        }
        pages(command, &share.join("man/man1"))?;
    }
    Ok(())
}

/// A page for a command, and one for each verb but that of the help.
fn pages(command: Command, folder: &Path) -> Done {
    fs::create_dir_all(folder)?;
    let command = command.disable_help_subcommand(true);
    Ok(clap_mangen::generate_to(command, folder)?)
}
