// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! What the tests of the commands share: cases, scratch directories and
//! the two families of programs, ours and the oracle's.

#![allow(dead_code)] // Each test program uses its own part of this.

use std::fs;
use std::io::Write;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A directory of the test's own, removed when the test is over.
pub struct Scratch(PathBuf);

impl Scratch {
    pub fn new() -> Self {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("noweb-test-{}-{count}", std::process::id());
        let path = std::env::temp_dir().join(name);
        fs::create_dir_all(&path).expect("a scratch directory");
        Self(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Writes a file, making its directory if need be.
    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        let parent = path.parent().expect("a parent");
        fs::create_dir_all(parent).expect("a directory");
        fs::write(&path, text).expect("a file");
        path
    }

    pub fn read(&self, name: &str) -> String {
        let text = fs::read(self.0.join(name)).expect("a readable file");
        String::from_utf8(text).expect("a text in UTF-8")
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// What a command said and how it ended.
#[derive(Debug, PartialEq, Eq)]
pub struct Outcome {
    pub stdout: Vec<u8>,
    pub stderr: Vec<u8>,
    pub status: i32,
}

impl Outcome {
    pub fn stdout(&self) -> String {
        String::from_utf8_lossy(&self.stdout).into_owned()
    }

    pub fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.stderr).into_owned()
    }

    /// Ended with 0.
    #[track_caller]
    pub fn succeeded(self) -> Self {
        assert_eq!(self.status, 0, "{}", self.stderr());
        self
    }

    /// Ended with 1, and said this.
    #[track_caller]
    pub fn failed(&self, said: &str) {
        assert_eq!(self.status, 1, "{}", self.stdout());
        assert!(self.stderr().contains(said), "{}", self.stderr());
    }
}

/// Our program.
pub fn noweb() -> PathBuf {
    env!("CARGO_BIN_EXE_noweb").into()
}

/// The names of all our commands, from the help.
pub fn names() -> Vec<String> {
    let help = Command::new(noweb()).arg("--help").output();
    let help = help.expect("a running command").stdout;
    let help = String::from_utf8(help).expect("a help text");
    let lines = help.lines().filter(|l| l.starts_with("  "));
    lines
        .filter_map(|l| l.split_whitespace().next())
        .map(Into::into)
        .collect()
}

/// A directory with a symbolic link for each of our commands.
pub fn links() -> Scratch {
    let scratch = Scratch::new();
    for name in names().iter().map(String::as_str).chain(["noweb"]) {
        symlink(noweb(), scratch.path().join(name)).expect("a link");
    }
    scratch
}

/// Where the real noweb is, if it is installed.
///
/// # Panics
///
/// If it is not, and LITPT_NOWEB_ORACLE demands it.
pub fn oracle() -> Option<PathBuf> {
    let library = PathBuf::from("/usr/lib/noweb");
    let found = library.join("markup").exists()
        && Path::new("/usr/bin/notangle").exists();
    let demanded = std::env::var_os("LITPT_NOWEB_ORACLE")
        .is_some_and(|value| !value.is_empty() && value != "0");
    assert!(found || !demanded, "noweb 2.12 is not installed");
    if !found {
        skip("noweb 2.12 is not installed");
    }
    found.then_some(library)
}

/// Says why this test, or a part of it, could not be made here: past the
/// capture of its output, so that .ci/run sees whether such tests become more.
pub fn skip(why: &str) {
    let thread = std::thread::current();
    let line =
        format!("skipped: {}: {why}\n", thread.name().unwrap_or("?"));
    std::io::stderr().write_all(line.as_bytes()).expect("an output");
}

/// Runs a line of shell with a directory of commands before all others.
pub fn shell(command: &str, dir: &Path, commands: &Path) -> Outcome {
    let path = format!("{}:/usr/bin:/bin", commands.display());
    let output = Command::new("sh")
        .args(["-c", command])
        .current_dir(dir)
        .env("PATH", path)
        .env("LC_ALL", "C")
        .output()
        .expect("a running shell");
    let status = output.status.code().unwrap_or(-1);
    Outcome { stdout: output.stdout, stderr: output.stderr, status }
}

/// Runs our command `noweb` with arguments in a directory.
pub fn run(dir: &Path, args: &[&str]) -> Outcome {
    let output = Command::new(noweb())
        .args(args)
        .current_dir(dir)
        .output()
        .expect("a running command");
    let status = output.status.code().unwrap_or(-1);
    Outcome { stdout: output.stdout, stderr: output.stderr, status }
}

/// The first line in which two texts differ, for a message.
pub fn difference(ours: &str, theirs: &str) -> String {
    let mut theirs = theirs.split('\n');
    for (line, number) in ours.split('\n').zip(1..) {
        let their = theirs.next();
        if their != Some(line) {
            return format!("line {number} is {line:?}, not {their:?}");
        }
    }
    format!("after the end, {:?} is missing", theirs.next())
}

/// A directory under tests/cases.
pub struct Case {
    pub name: String,
    pub command: String,
    dir: PathBuf,
}

impl Case {
    /// All cases, sorted by name.
    pub fn all() -> Vec<Self> {
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/cases");
        let entries = fs::read_dir(root).expect("the cases");
        let mut dirs: Vec<PathBuf> =
            entries.map(|e| e.expect("an entry").path()).collect();
        dirs.sort();
        dirs.into_iter().map(Self::new).collect()
    }

    fn new(dir: PathBuf) -> Self {
        let name = dir.file_name().expect("a name").to_string_lossy();
        let command = fs::read_to_string(dir.join("command"));
        let command = command.expect("a command").trim_end().to_owned();
        Self { name: name.into_owned(), command, dir }
    }

    /// A file of the case, such as `stdout` or `ours.stderr`.
    pub fn file(&self, name: &str) -> Option<Vec<u8>> {
        fs::read(self.dir.join(name)).ok()
    }

    /// The inputs alone, in a directory where they may be changed.
    pub fn copy(&self) -> Scratch {
        let scratch = Scratch::new();
        for entry in fs::read_dir(&self.dir).expect("the case") {
            let path = entry.expect("an entry").path();
            let name = path.file_name().expect("a name").to_string_lossy();
            let result = ["stdout", "stderr", "status", "why"];
            if !result.contains(&&*name) && !name.starts_with("ours.") {
                scratch.write(&name, fs::read(&path).expect("an input"));
            }
        }
        scratch
    }
}
