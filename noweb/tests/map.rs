// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Positions of the program, translated into positions of the chapters.

use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::ffi::OsStrExt;
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use crate::common::{Outcome, Scratch, noweb};
use noweb::locate::Atlas;
use noweb::map::Filter;
use noweb::project::{self, Project};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// Mistakes of all kinds; the line numbers are those in the tests.
const CHAPTER: &str = "\
Prose about Gr\u{fc}\u{df}e.
<<src/main.rs>>=
mod other;

fn main() {
    // Gr\u{fc}\u{df}e
    <<Say something wrong>>
}

<<Add one>>
@

Prose in which src/main.rs:3:1 is mentioned.

<<Say something wrong>>=
/* \u{e4}\u{e4} */ let x: u32 = \"hello\";
if other::is_nine(x) {
  <<Do more>>
}
@

<<Add one>>=
fn add_one(x: u32) -> u32 {
    x @<< 1 >> 1
}
@

<<Do more>>=
add_one(7, 8);
@

<<src/other.rs>>=
<<Add one>>
pub fn is_nine(x: u32) -> bool {
    <<Answer the question>>
}
@

<<Answer the question>>=
add_one(x) == 9
@
";

/// The chapter in a directory, tangled.
fn project() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("chapters/a.nw", CHAPTER);
    run(&scratch, &["tangle", "chapters/a.nw"]).succeeded();
    scratch
}

/// Our command in a plain environment, where nobody forces colours.
fn command(scratch: &Scratch, args: &[&str]) -> Command {
    let mut command = Command::new(noweb());
    command.args(args).current_dir(scratch.path());
    let colours = ["CARGO_TERM_COLOR", "NO_COLOR"];
    let places = ["RUST_BACKTRACE", "CARGO_PROFILE_DEV_DEBUG"];
    for name in colours.into_iter().chain(places) {
        command.env_remove(name);
    }
    command
}

fn run(scratch: &Scratch, args: &[&str]) -> Outcome {
    let output = command(scratch, args).output().expect("a command");
    let status = output.status.code().unwrap_or(-1);
    Outcome { stdout: output.stdout, stderr: output.stderr, status }
}

/// What `noweb map` makes of a text, with the chapter as the web.
fn mapped(scratch: &Scratch, text: &str) -> String {
    let outcome =
        run(scratch, &["map", "chapters/a.nw", "--", "echo", text])
            .succeeded();
    outcome.stdout()
}

fn filter(scratch: &Scratch) -> Filter {
    let project = Project {
        dir: scratch.path().to_owned(),
        ..project::of(vec!["chapters/a.nw".into()], " chapters/a.nw".into())
    };
    Filter::new(vec![project])
}

fn translated(scratch: &Scratch, text: &str) -> String {
    let text = filter(scratch).translate(text.as_bytes(), 0);
    String::from_utf8(text).expect("UTF-8")
}

/// The program says where its lines are, so that no number is typed here.
fn line_of(scratch: &Scratch, file: &str, part: &str) -> u32 {
    let text = scratch.read(file);
    let found = text.lines().position(|line| line.contains(part));
    found.expect("the part") as u32 + 1
}

// ---- one position

#[test]
fn a_position_of_the_program_is_found_in_its_chapter() {
    let scratch = project();
    let line = line_of(&scratch, "src/main.rs", "let x");
    let place = format!("src/main.rs:{line}:18");
    assert_eq!(mapped(&scratch, &place), "chapters/a.nw:16:14\n");
    let place = format!("./src/main.rs:{line}");
    assert_eq!(mapped(&scratch, &place), "chapters/a.nw:16\n");
}

#[test]
fn columns_are_characters_on_both_sides() {
    let scratch = project();
    let line = line_of(&scratch, "src/main.rs", "let x");
    let text = scratch.read("src/main.rs");
    let text = text.lines().nth(line as usize - 1).expect("the line");
    let column = text.chars().position(|c| c == '"').expect("it") + 1;
    let there = format!("src/main.rs:{line}:{column}");
    assert_eq!(mapped(&scratch, &there), "chapters/a.nw:16:23\n");
}

#[test]
fn a_chunk_in_two_files_is_found_from_both() {
    let scratch = project();
    for file in ["src/main.rs", "src/other.rs"] {
        let line = line_of(&scratch, file, "x << 1 >> 1");
        let place = format!("{file}:{line}:1");
        assert_eq!(mapped(&scratch, &place), "chapters/a.nw:24:1\n");
    }
}

#[test]
fn other_files_and_other_lines_are_left_alone() {
    let scratch = project();
    for place in ["src/main.rs:99:1\n", "README:1\n", "src/main.rs\n"] {
        assert_eq!(mapped(&scratch, place.trim_end()), place);
    }
}

#[test]
fn a_master_names_its_chapters() {
    let scratch = project();
    let master = "%\\include{no}\n\\include{a}\nand \\include{b}\n";
    scratch.write("book.nw", master);
    let echo = ["--", "echo", "src/main.rs:1:1"];
    let args = [&["map", "book.nw"][..], &echo].concat();
    assert_eq!(run(&scratch, &args).stdout(), "chapters/a.nw:3:1\n");
    fs::remove_file(scratch.path().join("book.nw")).expect("a book");
    for args in [args, [&["map"][..], &echo].concat()] {
        let outcome = run(&scratch, &args);
        assert_eq!((outcome.status, outcome.stdout()), (2, String::new()));
    }
}

// A chunk is some lines, a line some words and perhaps a use.
type Chunk = Vec<(String, Option<usize>, String)>;

/// Three files and five chunks, each using only later ones.
fn webs() -> impl Strategy<Value = Vec<Chunk>> {
    let chunk = |number: usize| {
        let word = "( {0,3}[a-z\u{e4}\u{3b2};]{1,4}|)( @<< x >>|)";
        let later = (number.max(2) + 1)..9;
        let used =
            prop::option::of(later).prop_map(|n| n.filter(|n| *n < 8));
        let line = (word, used, "[a-z\u{e4}]{0,3}");
        prop::collection::vec(line, 0..5)
    };
    (0..8).map(chunk).collect::<Vec<_>>()
}

const NAMES: [&str; 8] = [
    "src/a.rs",
    "src/deep/b.rs",
    "c.vim",
    "Do [[d]]",
    "Do e",
    "Do f",
    "Do g",
    "Do h",
];

fn source(web: &[Chunk]) -> String {
    let mut text = String::new();
    for (chunk, name) in web.iter().zip(NAMES) {
        text += &format!("Prose.\n<<{name}>>=\n");
        for (before, used, after) in chunk {
            let used = used.map(|n| format!("<<{}>>", NAMES[n]));
            text +=
                &format!("{before}{}{after}\n", used.unwrap_or_default());
        }
        text += "@\n";
    }
    text
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(20_261_122),
        ..ProptestConfig::with_cases(100)
    })]

    #[test]
    fn every_byte_is_found_in_its_chapter(web in webs()) {
        let scratch = Scratch::new();
        let chapter = source(&web);
        scratch.write("a.nw", &chapter);
        let project = Project {
            dir: scratch.path().to_owned(),
            ..project::of(vec!["a.nw".into()], String::new())
        };
        let atlas = Atlas::read(std::slice::from_ref(&project));
        for (path, tangled) in project.expand().expect("files").files {
            let (_, file) = atlas.find(path.as_os_str().as_bytes()).expect("the file");
            let text = String::from_utf8(tangled.text).expect("UTF-8");
            for (line, number) in text.lines().zip(1..) {
                let blank = line.len() - line.trim_start().len();
                let named = line.contains("Do ");
                for (c, column) in line.chars().zip(1..).skip(blank) {
                    let at = file.origin(number, column);
                    let at = at.expect("a position");
                    let there = chapter.lines().nth(at.line as usize - 1);
                    let there = there.expect("a line");
                    let mut rest = there.chars().skip(at.column as usize - 1);
                    let used = there.contains("<<Do ");
                    prop_assert!(
                        if named { used } else { rest.next() == Some(c) },
                        "{c} at {number}:{column} of {path:?} is not at \
                         {at:?}"
                    );
                }
            }
        }
    }
}

// ---- text

#[test]
fn positions_in_text_are_translated_and_nothing_else_is() {
    let scratch = project();
    let line = line_of(&scratch, "src/main.rs", "let x");
    let dir = scratch.path().canonicalize().expect("a path");
    let dir = dir.display();
    let there = format!("src/main.rs:{line}");
    let here = "chapters/a.nw:16";
    for (given, wanted) in [
        (
            format!("thread 'main' panicked at {there}:5:\n"),
            format!("thread 'main' panicked at {here}:1:\n"),
        ),
        (format!("  --> {there}:21\n"), format!("     --> {here}:17\n")),
        (format!("    at ./{there}:5\r\n"), format!("    at {here}:1\r\n")),
        (
            format!("(src/main.rs), \"{there}:5\", {there}."),
            format!("(src/main.rs), \"{here}:1\", {here}."),
        ),
        (
            format!("\x1b[1;31m{there}:5\x1b[0m\n"),
            format!("\x1b[1;31m{here}:1\x1b[0m\n"),
        ),
        (
            format!("Diff in {dir}/{there}: 12:30:40\n"),
            format!("Diff in {here}: 12:30:40\n"),
        ),
    ] {
        assert_eq!(translated(&scratch, &given), wanted);
    }
    for same in [
        "src/main.rs: no line; main.rs:7:1 src/main.rss:5\n",
        "x/src/main.rs:7:1 /src/main.rs:7:1 src/main.rs:99:1\n",
        "src/main.rs:99999999999 src/main.rs::5 12:30:40 :::\n",
        "\x1b[1;31m \x1b[ : \x1b",
        "",
    ] {
        assert_eq!(translated(&scratch, same), same);
    }
}

#[test]
fn a_path_with_a_dot_is_found_by_its_end_if_there_is_only_one() {
    let scratch = Scratch::new();
    let web = "<<src/lib.rs>>=\na\n<<tool/src/lib.rs>>=\nb\n\
               <<tool/src/only.rs>>=\nc\n";
    scratch.write("chapters/a.nw", web);
    run(&scratch, &["tangle", "chapters/a.nw"]);
    let text = "at ./src/only.rs:1:1 at ./src/lib.rs:1:1 at src/lib.rs:1:1";
    let wanted =
        "at chapters/a.nw:6:1 at ./src/lib.rs:1:1 at chapters/a.nw:2:1";
    assert_eq!(translated(&scratch, text), wanted);
}

#[test]
fn a_path_with_blanks_colons_and_any_bytes_is_found() {
    let scratch = Scratch::new();
    let master = b"\\title{Caf\xe9}\r\n\\include{a b\xe9}\r\n".to_vec();
    scratch.write("my dir: (x)/book.nw", master);
    let dir = scratch.path().join("my dir: (x)");
    let chapter = OsStr::from_bytes(b"chapters/a b\xe9.nw");
    fs::create_dir(dir.join("chapters")).expect("a directory");
    let web =
        b"\xe9\n<<src/a:1 \xe9>>=\n<<src/a:1[\xe9].c>>=\n\xe9 \xb0 x\n";
    fs::write(dir.join(chapter), web).expect("a chapter");
    let there = [
        dir.canonicalize().expect("a path").as_os_str().as_bytes(),
        b"/src/a:1[\xe9].c:1",
    ]
    .concat();
    let text =
        [b"(src/a:1[\xe9].c:1:5): ", &there[..], b":1 \xe9\n"].concat();
    let mut noweb = Command::new(noweb());
    noweb.current_dir(&dir);
    let mut tangle = Command::new(noweb.get_program());
    tangle.args(["tangle", "book.nw"]).arg(chapter).current_dir(&dir);
    assert!(tangle.status().expect("a command").success());
    noweb.args(["map", "book.nw", "--", "printf", "%s"]);
    let output = noweb.arg(OsStr::from_bytes(&text)).output();
    let output = output.expect("a command");
    let wanted =
        b"(chapters/a b\xe9.nw:4:5): chapters/a b\xe9.nw:4:1 \xe9\n";
    assert_eq!(
        output.stdout.escape_ascii().to_string(),
        wanted.escape_ascii().to_string()
    );
    assert_eq!(output.stderr, b"");
}

#[test]
fn a_full_disk_is_not_the_fault_of_the_command() {
    let scratch = project();
    let full = std::fs::File::options().write(true).open("/dev/full");
    let mut command =
        command(&scratch, &["map", "chapters/a.nw", "--", "echo", "x"]);
    command.stdout(full.expect("no /dev/full")).stderr(Stdio::piped());
    let output = command.output().expect("noweb does not run");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(errors.starts_with("error: cannot write: "), "{errors}");
}

#[test]
fn a_long_line_with_many_numbers_takes_no_longer_than_short_ones() {
    let scratch = project();
    let mut filter = filter(&scratch);
    let line = "word:1,".repeat(300_000) + "\n";
    let started = Instant::now();
    let translated = filter.translate(line.as_bytes(), 0);
    let took = started.elapsed();
    assert_eq!(translated, line.into_bytes());
    assert!(took < Duration::from_secs(10), "it took {took:?}");
}

#[test]
fn bytes_that_are_no_text_pass_through() {
    let scratch = project();
    let given = b"\xff\xfe src/main.rs:1:1 \xff\n".to_vec();
    let wanted = b"\xff\xfe chapters/a.nw:3:1 \xff\n".to_vec();
    assert_eq!(filter(&scratch).translate(&given, 0), wanted);
}

#[test]
fn positions_in_a_stale_file_stay_and_it_is_said_once() {
    let scratch = project();
    let text = scratch.read("src/main.rs");
    scratch.write("src/main.rs", format!("// edited\n{text}"));
    let mut filter = filter(&scratch);
    let line = b"src/main.rs:1:1 src/other.rs:1:1";
    let wanted = b"src/main.rs:1:1 chapters/a.nw:23:1".to_vec();
    assert_eq!(filter.translate(line, 0), wanted);
    filter.translate(line, 1);
    let text = "src/main.rs is not what its chapters give";
    assert_eq!(filter.warnings.len(), 1);
    assert_eq!(filter.warnings[0].text, text);
    let help = &filter.warnings[0].help[0];
    assert!(help.ends_with("untangle chapters/a.nw"), "{help}");
}

#[test]
fn chapters_that_do_not_tangle_translate_nothing() {
    let scratch = project();
    scratch.write("chapters/a.nw", "<<src/main.rs>>=\n<<No such chunk>>\n");
    let text = "src/main.rs:1:1\n";
    assert_eq!(translated(&scratch, text), text);
}

// ---- diagnostics

/// What rustc has to say about the program, through us or directly.
fn compile(scratch: &Scratch, through_us: bool, colour: &str) -> String {
    let rustc = std::env::var_os("RUSTC").unwrap_or("rustc".into());
    let mut command = match through_us {
        true => {
            let mut map = command(scratch, &["map", "chapters/a.nw", "--"]);
            map.arg(rustc);
            map
        }
        false => Command::new(rustc),
    };
    let output = command
        .args(["--edition=2024", "--emit=metadata", "--out-dir=."])
        .args(["--color", colour, "src/main.rs"])
        .current_dir(scratch.path())
        .output()
        .expect("a compiler");
    assert_eq!(output.status.code(), Some(1), "there are errors");
    String::from_utf8(output.stderr).expect("UTF-8")
}

#[test]
fn the_compilers_errors_point_into_the_chapter() {
    let text = compile(&project(), true, "never");
    let error = "\
error[E0308]: mismatched types
    --> chapters/a.nw:16:23
     |
  16 |     /* \u{e4}\u{e4} */ let x: u32 = \"hello\";
     |                     ---   ^^^^^^^ expected `u32`, found `&str`
     |                     |
     |                     expected due to this

";
    assert!(text.contains(error), "{text}");
    let error = "\
error[E0061]: this function takes 1 argument but 2 arguments were supplied
     --> chapters/a.nw:29:1
";
    assert!(text.contains(error), "{text}");
    let note = "\
note: function defined here
     --> chapters/a.nw:23:4
      |
   23 | fn add_one(x: u32) -> u32 {
      |    ^^^^^^^
help: remove the extra argument
      |
   29 -       add_one(7, 8);
   29 +       add_one(7);
      |
";
    assert!(text.contains(note), "{text}");
    assert!(!text.contains("src/"), "{text}");
}

#[test]
fn only_positions_and_margins_of_a_message_change() {
    let scratch = project();
    // What is left when blanks, numbers and names of files are gone.
    let bare = |text: &str| {
        let text = text.replace("src/main.rs", "FILE");
        let text = text.replace("chapters/a.nw", "FILE");
        text.replace(|c: char| c == ' ' || c.is_ascii_digit(), "")
    };
    for colour in ["never", "always"] {
        let theirs = compile(&scratch, false, colour);
        let ours = compile(&scratch, true, colour);
        assert_eq!(bare(&ours), bare(&theirs));
        assert_eq!(ours.contains('\x1b'), colour == "always");
    }
}

#[test]
fn colours_change_nothing_else() {
    let scratch = project();
    let plain = compile(&scratch, true, "never");
    let coloured = compile(&scratch, true, "always");
    let mut parts = coloured.split('\x1b');
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        text += part.split_once('m').expect("a colour").1;
    }
    assert_eq!(text, plain);
}

#[test]
fn a_message_about_another_file_is_left_alone() {
    let scratch = project();
    let mut filter = filter(&scratch);
    for line in [
        "  --> tests/t.rs:3:1\n",
        "   |\n",
        "3  | fn t() {}\n",
        "\n",
        "12 | src/\n",
    ] {
        assert_eq!(filter.translate(line.as_bytes(), 1), line.as_bytes());
    }
    // And so is the other stream, while a message comes through one.
    let arrow = filter.translate(b" --> src/main.rs:1:1\n", 1);
    assert_eq!(arrow, b"    --> chapters/a.nw:3:1\n");
    assert_eq!(filter.translate(b"1 | mod\n", 0), b"1 | mod\n");
    assert_eq!(filter.translate(b"1 | mod\n", 1), b"   3 | mod\n");
}

#[test]
fn two_webs_are_two_programs() {
    let scratch = project();
    let tool = "<<tool/src/t.rs>>=\n<<Add one>>\n<<Add one>>=\n1\n";
    scratch.write("tool/chapters/t.nw", tool);
    scratch.write("book.nw", "\\include{a}\n");
    scratch.write("tool/book.nw", "\\include{t}\n");
    let tangle = ["tangle", "--record", "r", "tool/chapters/t.nw"];
    assert_eq!(run(&scratch, &tangle).status, 0);
    let line = "src/main.rs:1:1 tool/src/t.rs:1:1 ./src/t.rs:1";
    let masters = ["book.nw", "tool/book.nw"];
    let args = [&["map"], &masters[..], &["--", "echo", line]].concat();
    let wanted = "chapters/a.nw:3:1 tool/chapters/t.nw:4:1 \
                  tool/chapters/t.nw:4\n";
    assert_eq!(run(&scratch, &args).stdout(), wanted);
}

// ---- commands

#[test]
fn the_status_of_a_command_is_ours_and_so_are_its_streams() {
    let scratch = project();
    let shell = |script| {
        run(&scratch, &["map", "chapters/a.nw", "--", "sh", "-c", script])
    };
    let outcome =
        shell("echo src/main.rs:1; echo src/other.rs:1 >&2; exit 7");
    assert_eq!(outcome.status, 7);
    assert_eq!(outcome.stdout(), "chapters/a.nw:3\n");
    assert_eq!(outcome.stderr(), "chapters/a.nw:23\n");
    assert_eq!(shell("kill -9 $$").status, 137);
    assert_eq!(shell("printf src/main.rs:1").stdout(), "chapters/a.nw:3");
    let missing = run(&scratch, &["map", "chapters/a.nw", "--", "./no"]);
    assert_eq!(missing.status, 127);
    assert_eq!(run(&scratch, &["map", "chapters/a.nw", "--"]).status, 2);
}

#[test]
fn a_line_is_passed_on_before_the_next_one_comes() {
    let scratch = project();
    let mut child =
        command(&scratch, &["map", "chapters/a.nw", "--", "cat"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("a command");
    let mut input = child.stdin.take().expect("a pipe");
    let mut output = BufReader::new(child.stdout.take().expect("a pipe"));
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let mut line = String::new();
        output.read_line(&mut line).expect("a line");
        sender.send(line).expect("a listener");
    });
    write!(input, "src/main.rs:1\nmore, ").expect("an open pipe");
    let line = receiver.recv_timeout(Duration::from_secs(20));
    assert_eq!(line.expect("a line in good time"), "chapters/a.nw:3\n");
    drop(input);
    assert!(child.wait().expect("an end").success());
}

/// A crate with a test that fails, as cargo and a chapter make it.
#[test]
fn a_failing_test_and_its_backtrace_name_the_chapter() {
    let scratch = Scratch::new();
    scratch.write("chapters/a.nw", PANICKING);
    run(&scratch, &["tangle", "chapters/a.nw"]);
    let cargo = std::env::var_os("CARGO").unwrap_or("cargo".into());
    let cargo = cargo.to_string_lossy().into_owned();
    let args = ["map", "chapters/a.nw", "--", &cargo, "test", "--offline"];
    let outcome = command(&scratch, &args)
        .env("RUST_BACKTRACE", "1")
        .env("CARGO_TARGET_DIR", scratch.path().join("target"))
        .output()
        .expect("a command");
    let stdout = String::from_utf8_lossy(&outcome.stdout).into_owned();
    let stderr = String::from_utf8_lossy(&outcome.stderr).into_owned();
    assert_eq!(outcome.status.code(), Some(101), "{stdout}{stderr}");
    for part in [
        "panicked at chapters/a.nw:22:1:\n",
        "at chapters/a.nw:22:1\n",
        "panicked at chapters/a.nw:14:1:\n",
        "at chapters/a.nw:14:1\n",
        "at chapters/a.nw:26:5\n",
    ] {
        assert!(stdout.contains(part), "{part:?} is not in {stdout}");
    }
    let warning = "\
warning: unused variable: `unused`
    --> chapters/a.nw:21:5
     |
  21 |     let unused = 3;
     |         ^^^^^^ help: if this is intentional, prefix it with an \
                   underscore: `_unused`
";
    assert_eq!(stderr.matches(warning).count(), 1, "{stderr}");
    assert!(!stdout.contains("src/lib.rs:"), "{stdout}");
}

const PANICKING: &str = "\
<<Cargo.toml>>=
[package]
name = \"planted\"
edition = \"2024\"
[workspace]
@
<<src/lib.rs>>=
pub fn half(x: u32) -> u32 {
    <<Insist on even numbers>>
    x / 2
}
<<Test the halves>>
<<Insist on even numbers>>=
assert!(x % 2 == 0, \"{x} is odd\");
<<Test the halves>>=
#[test]
fn halves_are_whole() {
    <<Compare a half with a third>>
}
<<Compare a half with a third>>=
let unused = 3;
assert_eq!(half(6), 2);
<<Test the halves>>=
#[test]
fn odd_numbers_are_refused() {
    half(3);
}
@
";
