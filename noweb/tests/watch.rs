// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Watching: a save leads to tangled files and to a run of the command.
//!
//! A test waits for what it expects, for a long time if need be, so that a
//! busy machine makes it slow and not wrong.

mod common;

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use common::{Scratch, noweb, run};

const CHAPTER: &str = "Prose.\n<<src/a.rs>>=\nfirst();\n@\n";
const PATIENCE: Duration = Duration::from_secs(60);

/// A watch that runs beside the test, and what it has said.
struct Watch {
    child: Child,
    said: Arc<Mutex<Vec<String>>>,
}

impl Watch {
    fn start(dir: &Path, args: &[&str]) -> Self {
        let mut child = Command::new(noweb())
            .arg("watch")
            .args(args)
            .current_dir(dir)
            .stdin(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("a running watch");
        let errors = child.stderr.take().expect("its standard error");
        let said = Arc::new(Mutex::new(Vec::new()));
        let lines = Arc::clone(&said);
        thread::spawn(move || {
            for line in BufReader::new(errors).lines().map_while(Result::ok)
            {
                lines.lock().expect("the lines").push(line);
            }
        });
        Self { child, said }
    }

    fn said(&self) -> Vec<String> {
        self.said.lock().expect("the lines").clone()
    }

    /// Waits until a line has been said that contains a text.
    fn says(&self, text: &str) {
        let heard = || self.said().iter().any(|line| line.contains(text));
        wait(heard, || format!("{text:?} is not in {:?}", self.said()));
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn wait(done: impl Fn() -> bool, message: impl Fn() -> String) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < PATIENCE, "{}", message());
        thread::sleep(Duration::from_millis(5));
    }
}

fn read(scratch: &Scratch, file: &str) -> String {
    let text = fs::read_to_string(scratch.path().join(file));
    text.unwrap_or_default()
}

/// Waits until a file has this text.
fn holds(scratch: &Scratch, file: &str, text: &str) {
    let now = || read(scratch, file);
    wait(|| now() == text, || format!("{file}: {:?}", now()));
}

fn project() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("chapters/a.nw", CHAPTER);
    scratch
}

/// Saves a chapter at once, by renaming.
fn save(scratch: &Scratch, text: &str) {
    let new = scratch.write("chapters/.a.nw.new", text);
    let path = scratch.path().join("chapters/a.nw");
    fs::rename(new, path).expect("a renamed file");
}

const LOG: &str = "echo ran >>log";

#[test]
fn a_save_is_tangled_and_the_command_runs() {
    let scratch = project();
    let args = ["chapters/a.nw", "--", "sh", "-c", LOG];
    let watch = Watch::start(scratch.path(), &args);
    holds(&scratch, "log", "ran\n");
    assert_eq!(read(&scratch, "src/a.rs"), "first();\n");
    watch.says("ms: tangled src/a.rs");
    save(&scratch, &CHAPTER.replace("first", "second"));
    holds(&scratch, "log", "ran\nran\n");
    assert_eq!(read(&scratch, "src/a.rs"), "second();\n");
    save(&scratch, &CHAPTER.replace("first", "second").replace("P", "p"));
    watch.says("ms: tangled nothing");
    holds(&scratch, "log", "ran\nran\nran\n");
}

#[test]
fn a_directory_that_was_moved_and_made_anew_is_watched() {
    let scratch = project();
    scratch.write("book.nw", "\\include{a}\n");
    let watch = Watch::start(scratch.path(), &["--master", "book.nw"]);
    holds(&scratch, "src/a.rs", "first();\n");
    let dir = scratch.path().join("chapters");
    fs::rename(&dir, scratch.path().join("old")).expect("a moved one");
    watch.says("cannot watch chapters");
    scratch.write("chapters/a.nw", CHAPTER.replace("first", "second"));
    holds(&scratch, "src/a.rs", "second();\n");
    for word in ["third", "fourth", "fifth"] {
        save(&scratch, &CHAPTER.replace("first", word));
        holds(&scratch, "src/a.rs", &format!("{word}();\n"));
    }
}

#[test]
fn an_editor_that_replaces_the_file_is_followed() {
    let scratch = project();
    let watch = Watch::start(scratch.path(), &["chapters/a.nw"]);
    holds(&scratch, "src/a.rs", "first();\n");
    let path = scratch.path().join("chapters/a.nw");
    for name in ["second", "third", "fourth"] {
        // By a temporary file, as many editors do.
        save(&scratch, &CHAPTER.replace("first", name));
        holds(&scratch, "src/a.rs", &format!("{name}();\n"));
    }
    for name in ["fifth", "sixth"] {
        // By a backup, as vim does; the chapter is missing meanwhile.
        let backup = scratch.path().join("chapters/a.nw~");
        fs::rename(&path, &backup).expect("a backup");
        thread::sleep(Duration::from_millis(40));
        scratch.write("chapters/a.nw", CHAPTER.replace("first", name));
        fs::remove_file(backup).expect("the backup");
        holds(&scratch, "src/a.rs", &format!("{name}();\n"));
    }
    assert!(!watch.said().iter().any(|line| line.contains("error")));
}

#[test]
fn errors_are_shown_and_the_watch_goes_on() {
    let scratch = project();
    let args = ["chapters/a.nw", "--", "sh", "-c", LOG];
    let watch = Watch::start(scratch.path(), &args);
    holds(&scratch, "log", "ran\n");
    save(&scratch, &CHAPTER.replace("first();", "<<none>>"));
    watch.says("chapters/a.nw:3:1: error: undefined chunk name: <<none>>");
    scratch.write("src/a.rs", "mine();\n");
    save(&scratch, &CHAPTER.replace("first", "second"));
    watch.says("src/a.rs:1:1: error: this file was edited by hand");
    fs::remove_file(scratch.path().join("chapters/a.nw")).expect("it");
    watch.says("error: cannot read chapters/a.nw");
    assert_eq!(read(&scratch, "log"), "ran\n", "it ran on old files");
    // The reason has gone: the same text is tangled now.
    fs::remove_file(scratch.path().join("src/a.rs")).expect("it");
    save(&scratch, &CHAPTER.replace("first", "second"));
    holds(&scratch, "src/a.rs", "second();\n");
    holds(&scratch, "log", "ran\nran\n");
}

#[test]
fn a_save_while_the_command_runs_makes_it_run_once_more() {
    let scratch = project();
    let slow = "echo start >>log; until test -e go; do sleep 0.02; done; \
                rm go; echo end >>log";
    let args = ["chapters/a.nw", "--", "sh", "-c", slow];
    let _watch = Watch::start(scratch.path(), &args);
    holds(&scratch, "log", "start\n");
    for name in ["second", "third"] {
        save(&scratch, &CHAPTER.replace("first", name));
        holds(&scratch, "src/a.rs", &format!("{name}();\n"));
    }
    assert_eq!(read(&scratch, "log"), "start\n", "it was interrupted");
    scratch.write("go", "");
    holds(&scratch, "log", "start\nend\nstart\n");
    scratch.write("go", "");
    holds(&scratch, "log", "start\nend\nstart\nend\n");
    // It is not run a third time: the next run is that of the next save.
    save(&scratch, CHAPTER);
    holds(&scratch, "src/a.rs", "first();\n");
    scratch.write("go", "");
    let all = "start\nend\n".repeat(3);
    holds(&scratch, "log", &all);
}

#[test]
fn a_chapter_that_the_master_adds_is_watched() {
    let scratch = project();
    let book = "\\include{a}\n";
    scratch.write("book/book.nw", "Nothing.\n");
    scratch.write("book/chapters/a.nw", CHAPTER);
    let args = ["-C", "book", "--master", "book.nw"];
    let _watch = Watch::start(scratch.path(), &args);
    scratch.write("book/book.nw", book);
    holds(&scratch, "book/src/a.rs", "first();\n");
    let text = CHAPTER.replace("first", "second");
    scratch.write("book/chapters/a.nw", text);
    holds(&scratch, "book/src/a.rs", "second();\n");
}

#[test]
fn a_signal_ends_the_watch() {
    use std::os::unix::process::ExitStatusExt;
    let scratch = project();
    let mut watch = Watch::start(scratch.path(), &["chapters/a.nw"]);
    watch.says("tangled src/a.rs");
    let process = watch.child.id().to_string();
    let kill = Command::new("kill").args(["-TERM", &process]).status();
    assert!(kill.expect("kill").success());
    let status = watch.child.wait().expect("an end");
    assert_eq!(status.signal(), Some(15));
}

#[test]
fn a_command_that_is_not_there_is_an_error_each_time() {
    let scratch = project();
    let args = ["chapters/a.nw", "--", "./no-such-command"];
    let watch = Watch::start(scratch.path(), &args);
    watch.says("error: cannot run ./no-such-command");
    save(&scratch, &CHAPTER.replace("first", "second"));
    let count = || {
        let lines = watch.said().into_iter();
        lines.filter(|line| line.contains("cannot run")).count()
    };
    wait(|| count() == 2, || format!("{:?}", watch.said()));
}

#[test]
fn wrong_usage_of_watch_has_status_2() {
    let scratch = project();
    for args in [
        &["watch"][..],
        &["watch", "--check", "chapters/a.nw"],
        &["watch", "--nope", "chapters/a.nw"],
        &["watch", "chapters/a.nw", "--"],
        &["watch", "--master", "none.nw"],
    ] {
        assert_eq!(run(scratch.path(), args).status, 2, "{args:?}");
    }
}

/// Run with `--ignored --nocapture` on a quiet machine.
#[test]
#[ignore = "it measures, on the book itself"]
fn the_time_from_a_save_to_the_tangled_file() {
    let book = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let scratch = Scratch::new();
    let chapters = fs::read_dir(book.join("chapters")).expect("chapters");
    for entry in chapters.map(|entry| entry.expect("an entry")) {
        let name = format!("chapters/{}", entry.file_name().display());
        scratch.write(&name, fs::read(entry.path()).expect("a chapter"));
    }
    let master = fs::read(book.join("litpt.nw")).expect("the master");
    scratch.write("litpt.nw", master);
    let args = ["--record", "src/.tangled", "--master", "litpt.nw"];
    let args = [&args[..], &["--", "touch", "started"]].concat();
    let watch = Watch::start(scratch.path(), &args);
    let started = scratch.path().join("started");
    wait(|| started.exists(), || format!("{:?}", watch.said()));
    let chapter = scratch.read("chapters/sky.nw");
    let (code, slot) = ("zenith: DVec3,", "src/sky.rs");
    assert!(chapter.contains(code));
    let (mut tangled, mut ran) = (Vec::new(), Vec::new());
    for turn in 0..30 {
        thread::sleep(Duration::from_millis(300));
        fs::remove_file(&started).expect("the last run");
        let mark = format!("{code} // {turn}");
        let start = Instant::now();
        scratch.write("chapters/sky.nw", chapter.replace(code, &mark));
        wait(|| read(&scratch, slot).contains(&mark), String::new);
        tangled.push(start.elapsed().as_millis());
        wait(|| started.exists(), String::new);
        ran.push(start.elapsed().as_millis());
    }
    for (what, times) in [("tangled", &mut tangled), ("ran", &mut ran)] {
        times.sort();
        let (median, worst) = (times[15], times[29]);
        println!("{what}: median {median} ms, worst {worst} ms");
    }
}
