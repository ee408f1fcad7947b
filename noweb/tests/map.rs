// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Positions of the program, translated into positions of the chapters.

mod common;

use std::io::{BufRead, BufReader, Write};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use common::{Outcome, Scratch, noweb};
use noweb::diagnostic::Place;
use noweb::locate::Atlas;
use noweb::map::{Filter, Translated};
use noweb::project::Project;
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
    let outcome = run(&scratch, &["tangle", "chapters/a.nw"]);
    assert_eq!(outcome.status, 0, "{}", outcome.stderr());
    scratch
}

/// Our command in a plain environment, where nobody forces colours.
fn command(scratch: &Scratch, args: &[&str]) -> Command {
    let mut command = Command::new(noweb());
    command.args(args).current_dir(scratch.path());
    for name in ["CARGO_TERM_COLOR", "NO_COLOR", "RUST_BACKTRACE"] {
        command.env_remove(name);
    }
    command
}

fn run(scratch: &Scratch, args: &[&str]) -> Outcome {
    let output = command(scratch, args).output().expect("a command");
    let status = output.status.code().unwrap_or(-1);
    Outcome { stdout: output.stdout, stderr: output.stderr, status }
}

fn located(scratch: &Scratch, args: &[&str]) -> String {
    let outcome = run(scratch, &[&["where"], args].concat());
    assert_eq!(outcome.status, 0, "{}", outcome.stderr());
    outcome.stdout()
}

fn filter(scratch: &Scratch) -> Filter {
    let project = Project {
        dir: scratch.path().to_owned(),
        chapters: vec!["chapters/a.nw".into()],
        ..Project::default()
    };
    Filter::new(project, false)
}

fn translated(scratch: &Scratch, text: &str) -> String {
    match filter(scratch).translate(text.as_bytes()) {
        Translated::Text(text) => String::from_utf8(text).expect("UTF-8"),
        other => panic!("{other:?} is no text"),
    }
}

/// The program says where its lines are, so that no number is typed here.
fn line_of(scratch: &Scratch, file: &str, part: &str) -> u32 {
    let text = scratch.read(file);
    let found = text.lines().position(|line| line.contains(part));
    found.expect("the part") as u32 + 1
}

// ---- noweb where

#[test]
fn a_position_of_the_program_is_found_in_its_chapter() {
    let scratch = project();
    let line = line_of(&scratch, "src/main.rs", "let x");
    let place = format!("src/main.rs:{line}:18");
    assert_eq!(
        located(&scratch, &[&place, "chapters/a.nw"]),
        "chapters/a.nw:16:14: <<Say something wrong>>\n"
    );
    let place = format!("./src/main.rs:{line}");
    assert_eq!(
        located(&scratch, &[&place, "chapters/a.nw"]),
        "chapters/a.nw:16:1: <<Say something wrong>>\n"
    );
}

#[test]
fn columns_are_characters_on_both_sides() {
    let scratch = project();
    let line = line_of(&scratch, "src/main.rs", "let x");
    let text = scratch.read("src/main.rs");
    let text = text.lines().nth(line as usize - 1).expect("the line");
    let column = text.chars().position(|c| c == '"').expect("it") + 1;
    let there = format!("src/main.rs:{line}:{column}");
    let here = "chapters/a.nw:16:23";
    let name = "<<Say something wrong>>";
    assert_eq!(
        located(&scratch, &[&there, "chapters/a.nw"]),
        format!("{here}: {name}\n")
    );
    assert_eq!(
        located(&scratch, &[here, "chapters/a.nw"]),
        format!("{there}: {name}\n")
    );
}

#[test]
fn a_chunk_in_two_files_is_found_in_both() {
    let scratch = project();
    let line = |file| line_of(&scratch, file, "x << 1 >> 1");
    let (main, other) = (line("src/main.rs"), line("src/other.rs"));
    assert_eq!(
        located(&scratch, &["chapters/a.nw:24", "chapters/a.nw"]),
        format!(
            "src/main.rs:{main}:1: <<Add one>>\n\
             src/other.rs:{other}:1: <<Add one>>\n"
        )
    );
}

#[test]
fn the_whole_path_of_a_chapter_will_do() {
    let scratch = project();
    let dir = scratch.path().canonicalize().expect("a directory");
    let answer = located(&scratch, &["chapters/a.nw:24", "chapters/a.nw"]);
    for path in [dir.join("chapters/a.nw"), "./chapters/a.nw".into()] {
        let question = format!("{}:24", path.display());
        assert_eq!(
            located(&scratch, &[&question, "chapters/a.nw"]),
            answer
        );
    }
}

#[test]
fn prose_goes_nowhere_and_other_files_are_refused() {
    let scratch = project();
    let refused = |place: &str| {
        let outcome = run(&scratch, &["where", place, "chapters/a.nw"]);
        assert_eq!((outcome.status, outcome.stdout()), (1, String::new()));
        outcome.stderr()
    };
    let prose = "error: chapters/a.nw:12 goes into no file\n";
    assert_eq!(refused("chapters/a.nw:12"), prose);
    let beyond = "error: src/main.rs has no line 99\n";
    assert_eq!(refused("src/main.rs:99:1"), beyond);
    let unknown = "error: README is neither tangled nor a chapter\n";
    assert_eq!(refused("README:1"), unknown);
    let outcome = run(&scratch, &["where", "src/main.rs"]);
    assert_eq!(outcome.status, 2);
}

#[test]
fn without_chapters_the_master_names_them() {
    let scratch = project();
    let master = "%\\include{no}\n\\include{a}\nand \\include{b}\n";
    scratch.write("book.nw", master);
    let args = ["where", "src/main.rs:1"];
    let found = "chapters/a.nw:3:1: <<src/main.rs>>\n";
    assert_eq!(run(&scratch, &args).stdout(), found);
    scratch.write("other.nw", "");
    let outcome = run(&scratch, &args);
    assert_eq!(outcome.status, 2);
    assert!(outcome.stderr().contains("--master"), "{outcome:?}");
    let args = ["where", "--master", "book.nw", "src/main.rs:1"];
    assert_eq!(run(&scratch, &args).stdout(), found);
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
    fn every_byte_finds_the_way_there_and_back(web in webs()) {
        let scratch = Scratch::new();
        scratch.write("a.nw", source(&web));
        let project = Project {
            dir: scratch.path().to_owned(),
            chapters: vec!["a.nw".into()],
            ..Project::default()
        };
        let atlas = Atlas::read(&project).expect("an atlas");
        for (path, tangled) in project.expand().expect("files").files {
            let file = atlas.find(&path).expect("the file");
            let text = String::from_utf8(tangled.text).expect("UTF-8");
            for (line, number) in text.lines().zip(1..) {
                let blank = line.len() - line.trim_start().len();
                for (c, column) in line.chars().zip(1..).skip(blank) {
                    let place = file.origin(number, column).expect("it");
                    let back = atlas.destinations(place);
                    let here = |p: &noweb::diagnostic::Position| {
                        p.file == path.display().to_string()
                            && (p.line, p.column) == (number, column)
                    };
                    prop_assert!(
                        back.iter().any(here),
                        "{c} at {number}:{column} of {path:?} is not in \
                         {back:?}"
                    );
                    let whole = Place { column: 0, ..place };
                    let back = atlas.destinations(whole);
                    prop_assert!(back.iter().any(|p| p.line == number));
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
        (format!("  --> {there}:21\n"), format!("  --> {here}:17\n")),
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
    let translated = filter.translate(line.as_bytes());
    let took = started.elapsed();
    assert_eq!(translated, Translated::Text(line.into_bytes()));
    assert!(took < Duration::from_secs(10), "it took {took:?}");
}

#[test]
fn bytes_that_are_no_text_pass_through() {
    let scratch = project();
    let given = b"\xff\xfe src/main.rs:1:1 \xff\n".to_vec();
    let wanted = b"\xff\xfe chapters/a.nw:3:1 \xff\n".to_vec();
    let translated = filter(&scratch).translate(&given);
    assert_eq!(translated, Translated::Text(wanted));
}

#[test]
fn positions_in_a_stale_file_stay_and_it_is_said_once() {
    let scratch = project();
    let text = scratch.read("src/main.rs");
    scratch.write("src/main.rs", format!("// edited\n{text}"));
    let mut filter = filter(&scratch);
    assert!(filter.warnings().is_empty());
    let line = b"src/main.rs:1:1 src/other.rs:1:1";
    let wanted = b"src/main.rs:1:1 chapters/a.nw:33:1".to_vec();
    assert_eq!(filter.translate(line), Translated::Text(wanted));
    let warnings = filter.warnings();
    let text = "src/main.rs is not what its chapters give";
    assert_eq!(warnings.len(), 1);
    assert_eq!(warnings[0].text, text);
    filter.translate(line);
    assert!(filter.warnings().is_empty());
}

#[test]
fn chapters_that_do_not_tangle_translate_nothing() {
    let scratch = project();
    scratch.write("chapters/a.nw", "<<src/main.rs>>=\n<<No such chunk>>\n");
    let text = "src/main.rs:1:1\n";
    assert_eq!(translated(&scratch, text), text);
}

// ---- diagnostics

/// What rustc has to say about the program, as JSON and for people.
fn compile(scratch: &Scratch, format: &str) -> Vec<u8> {
    let rustc = std::env::var_os("RUSTC").unwrap_or("rustc".into());
    let output = Command::new(rustc)
        .args(["--edition=2024", "--emit=metadata", "--out-dir=."])
        .args([&format!("--error-format={format}"), "src/main.rs"])
        .current_dir(scratch.path())
        .output();
    output.expect("a compiler").stderr
}

fn mapped(scratch: &Scratch, input: &[u8]) -> Outcome {
    let mut child = command(scratch, &["map", "chapters/a.nw"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("a command");
    let mut pipe = child.stdin.take().expect("a pipe");
    pipe.write_all(input).expect("an open pipe");
    drop(pipe);
    let output = child.wait_with_output().expect("an end");
    let status = output.status.code().unwrap_or(-1);
    Outcome { stdout: output.stdout, stderr: output.stderr, status }
}

#[test]
fn the_compilers_errors_are_shown_in_the_chapter() {
    let scratch = project();
    let outcome = mapped(&scratch, &compile(&scratch, "json"));
    assert_eq!((outcome.status, outcome.stderr()), (0, String::new()));
    let text = outcome.stdout();
    let error = "\
error[E0308]: mismatched types
  --> chapters/a.nw:16:23
   |
16 | /* \u{e4}\u{e4} */ let x: u32 = \"hello\";
   |                 ---   ^^^^^^^ expected `u32`, found `&str`
   |                 |
   |                 expected due to this

";
    assert!(text.contains(error), "{text}");
    let error = "\
error[E0061]: this function takes 1 argument but 2 arguments were supplied
  --> chapters/a.nw:29:1
   |
29 | add_one(7, 8);
   | ^^^^^^^    - unexpected argument #2 of type `{integer}`
   |
note: function defined here
  --> chapters/a.nw:23:4
   |
23 | fn add_one(x: u32) -> u32 {
   |    ^^^^^^^
help: remove the extra argument
   |
29 - add_one(7, 8);
29 + add_one(7);
   |

";
    assert!(text.contains(error), "{text}");
    assert!(!text.contains("src/"), "{text}");
}

#[test]
fn our_drawing_differs_from_the_compilers_in_positions_alone() {
    let scratch = project();
    // What is left when numbers, names of files and indentation are gone.
    let bare = |text: &[u8]| -> Vec<String> {
        let text = String::from_utf8_lossy(text).into_owned();
        let text = text.replace("src/main.rs", "FILE");
        let text = text.replace("chapters/a.nw", "FILE");
        let gutter = |c: char| c.is_ascii_digit() || " |-+".contains(c);
        let lines = text.lines().map(|line| {
            let line = line.trim_start_matches(gutter);
            match line.split_once("FILE:") {
                Some((before, _)) => before.to_owned() + "FILE",
                None => line.to_owned(),
            }
        });
        lines.collect()
    };
    let theirs = compile(&scratch, "human");
    let ours = mapped(&scratch, &compile(&scratch, "json"));
    assert_eq!(bare(&ours.stdout), bare(&theirs));
}

/// A span of JSON: file, lines, columns, whether it is the main one, its
/// label and replacement.
fn span(
    at: (&str, [u32; 4]),
    main: bool,
    label: &str,
    new: &str,
) -> String {
    let (file, [line, column, to_line, to_column]) = at;
    let label = match label {
        "" => "null".to_owned(),
        text => format!("{text:?}"),
    };
    let new = match new {
        "" => "null".to_owned(),
        text => format!("{text:?}"),
    };
    format!(
        r#"{{"file_name":{file:?},"line_start":{line},"line_end":{to_line},
        "column_start":{column},"column_end":{to_column},"text":[],
        "is_primary":{main},"label":{label},"expansion":null,
        "suggested_replacement":{new}}}"#
    )
}

fn json(text: &str, spans: &[String], more: &[String]) -> String {
    let spans = spans.join(",");
    let more = more.join(",");
    let message = format!(
        r#"{{"message":{text:?},"code":{{"code":"clippy::some_lint"}},
        "level":"warning","spans":[{spans}],"children":[{more}],
        "rendered":"warning: {text}\n  |\nhelp: do\n  = help: twice\n"}}"#
    );
    let line =
        format!(r#"{{"reason":"compiler-message","message":{message}}}"#);
    line.replace('\n', "") + "\n"
}

fn child(text: &str, spans: &[String]) -> String {
    let spans = spans.join(",");
    format!(
        r#"{{"message":{text:?},"code":null,"level":"help",
        "spans":[{spans}],"children":[],"rendered":null}}"#
    )
}

fn drawn(scratch: &Scratch, line: &str) -> String {
    match filter(scratch).translate(line.as_bytes()) {
        Translated::Diagnostic(text) => text,
        other => panic!("{other:?} is no diagnostic"),
    }
}

#[test]
fn a_span_across_chunks_is_shown_in_stretches() {
    let scratch = project();
    let from = line_of(&scratch, "src/main.rs", "is_nine(x)");
    let to = line_of(&scratch, "src/main.rs", "add_one(7");
    let at = ("src/main.rs", [from, 5, to, 12]);
    let line = json("too long", &[span(at, true, "all this", "")], &[]);
    let wanted = "\
warning: too long
  --> chapters/a.nw:17:1
   |
17 | / if other::is_nine(x) {
18 | |   <<Do more>>
   | |____________^
...
29 |   add_one(7, 8);
   |   ^^^^^ all this

";
    // The name of the chunk is a comment of the program, and ends its part.
    let drawn = drawn(&scratch, &line);
    assert_eq!(drawn, wanted);
}

#[test]
fn a_proposal_loses_the_indentation_of_the_program() {
    let scratch = project();
    let line = line_of(&scratch, "src/main.rs", "is_nine(x)");
    let at = ("src/main.rs", [line, 5, line, 7]);
    let new = span(at, true, "", "while a\n        << b >> c");
    let child = child("do", &[new]);
    let text = json("wrong", &[span(at, true, "", "")], &[child]);
    let drawn = drawn(&scratch, &text);
    let wanted = "\
help: do
   |
17 + while a
18 ~     @<< b >> c other::is_nine(x) {
   |
";
    assert!(drawn.contains(wanted), "{drawn}");
}

#[test]
fn a_proposal_for_tools_alone_is_hidden() {
    let scratch = project();
    let line = line_of(&scratch, "src/main.rs", "let x");
    let at = ("src/main.rs", [line, 5, line, 7]);
    let hidden = child("secret", &[span(at, true, "", "new")]);
    let remark = child("twice", &[span(at, true, "", "new")]);
    let main = [span(at, true, "", "")];
    let drawn = drawn(&scratch, &json("wrong", &main, &[hidden, remark]));
    assert!(!drawn.contains("secret"), "{drawn}");
    assert!(drawn.contains("\n   = help: twice\n"), "{drawn}");
}

#[test]
fn a_diagnostic_about_other_files_is_the_compilers_own() {
    let scratch = project();
    scratch.write("tests/t.rs", "fn t() {}\n");
    let at = ("tests/t.rs", [1, 4, 1, 5]);
    let line = json("other", &[span(at, true, "", "")], &[]);
    let theirs = "warning: other\n  |\nhelp: do\n  = help: twice\n";
    assert_eq!(drawn(&scratch, &line), theirs);
    // As one of several places it is shown as it is.
    let line_number = line_of(&scratch, "src/main.rs", "let x");
    let main = ("src/main.rs", [line_number, 5, line_number, 7]);
    let spans = [span(main, true, "", ""), span(at, false, "there", "")];
    let drawn = drawn(&scratch, &json("both", &spans, &[]));
    assert!(
        drawn.contains("\n 1 | fn t() {}\n   |    - there\n"),
        "{drawn}"
    );
}

#[test]
fn cargos_lines_for_programs_vanish_and_repetitions_too() {
    let scratch = project();
    let line = line_of(&scratch, "src/main.rs", "let x");
    let at = ("src/main.rs", [line, 5, line, 7]);
    let line = json("once", &[span(at, true, "", "")], &[]);
    let mut filter = filter(&scratch);
    let first = filter.translate(line.as_bytes());
    assert!(matches!(first, Translated::Diagnostic(_)), "{first:?}");
    assert_eq!(filter.translate(line.as_bytes()), Translated::Nothing);
    for line in [
        r#"{"reason":"build-finished","success":true}"#,
        r#"{"reason":"compiler-artifact","features":[]}"#,
        r#"{"reason":"compiler-message","message":{"message":
           "aborting due to 2 previous errors","code":null,"level":"error",
           "spans":[],"children":[],"rendered":"error: aborting"}}"#,
    ] {
        assert_eq!(filter.translate(line.as_bytes()), Translated::Nothing);
    }
    let theirs = br#"{"reason":"mine","at":"src/main.rs:1:1"}"#;
    let wanted = br#"{"reason":"mine","at":"chapters/a.nw:3:1"}"#.to_vec();
    assert_eq!(filter.translate(theirs), Translated::Text(wanted));
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
    assert_eq!(outcome.stderr(), "chapters/a.nw:33\n");
    assert_eq!(shell("kill -9 $$").status, 137);
    assert_eq!(shell("printf src/main.rs:1").stdout(), "chapters/a.nw:3");
    let missing = run(&scratch, &["map", "chapters/a.nw", "--", "./no"]);
    assert_eq!(missing.status, 127);
    let missing = run(&scratch, &["map", "chapters/a.nw", "--"]);
    assert_eq!(missing.status, 2);
}

#[test]
fn a_line_is_passed_on_before_the_next_one_comes() {
    let scratch = project();
    let mut child = command(&scratch, &["map", "chapters/a.nw"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("a command");
    let mut input = child.stdin.take().expect("a pipe");
    let mut output = BufReader::new(child.stdout.take().expect("a pipe"));
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        for end in [b'\n', b'\r'] {
            let mut line = Vec::new();
            output.read_until(end, &mut line).expect("a line");
            let line = String::from_utf8_lossy(&line).into_owned();
            sender.send(line).expect("a listener");
        }
    });
    for end in ["\n", "\r"] {
        write!(input, "src/main.rs:1{end}more, ").expect("an open pipe");
        let line = receiver.recv_timeout(Duration::from_secs(20));
        let line = line.expect("a line in good time");
        let wanted = format!("chapters/a.nw:3{end}");
        assert!(line.ends_with(&wanted), "{line:?}");
    }
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
        .arg("--message-format=json")
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
21 | let unused = 3;
   |     ^^^^^^ help: if this is intentional, prefix it with an \
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
