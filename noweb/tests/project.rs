// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Tangling all files of a program, and refusing to lose anyone's work.

use std::ffi::OsStr;
use std::fs;
use std::io::Read;
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::UnixStream;
use std::process::Command;
use std::time::{Duration, SystemTime};

use crate::common::{Outcome, Scratch, noweb, run, shell};

const CHAPTER: &str = "\
Prose.
<<src/main.rs>>=
<<Licensed under the GPL, version 3 or later>>

fn main() {
    <<Say [[hello]] to all>>
    let x = <<the number>>;
}
@

<<Say [[hello]] to all>>=
println!(\"hello\");
<<Count>>
@
<<Count>>=
count();
<<the number>>=
42
<<Licensed under the GPL, version 3 or later>>=
// Copyright (C) 2026 litpt contributors
// Free software.
@
<<scripts/run>>=
#!/bin/sh
echo \"$0\"
<<a.mk>>=
all:
\ttrue
@
";

const MAIN: &str = "\
// Copyright (C) 2026 litpt contributors
// Free software.

fn main() {
    // Say `hello` to all
    println!(\"hello\");
    // Count
    count();
    let x = 42;
}
";

/// A project whose one chapter is an hour old.
fn project() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("chapters/a.nw", CHAPTER);
    age(&scratch, "chapters/a.nw", 3600);
    scratch
}

/// Makes a file some seconds older than now.
fn age(scratch: &Scratch, name: &str, seconds: u64) -> SystemTime {
    let time = SystemTime::now() - Duration::from_secs(seconds);
    let path = scratch.path().join(name);
    let file = fs::File::options().append(true).open(path);
    let file = file.expect("the file");
    file.set_modified(time).expect("a modification time");
    time
}

fn modified(scratch: &Scratch, name: &str) -> SystemTime {
    let path = scratch.path().join(name);
    fs::metadata(path).expect("the file").modified().expect("a time")
}

fn tangle(scratch: &Scratch, more: &[&str]) -> Outcome {
    let args = [&["tangle"], more, &["chapters/a.nw"]].concat();
    run(scratch.path(), &args)
}

/// The names of all files below a directory, sorted.
fn listing(scratch: &Scratch) -> Vec<String> {
    let found = shell(
        "find . -type f ! -name a.nw ! -path '*.base/*' | LC_ALL=C sort",
        scratch.path(),
        scratch.path(),
    );
    found.stdout().lines().map(String::from).collect()
}

#[test]
fn every_file_is_written_with_names_and_licence() {
    let scratch = project();
    let outcome = tangle(&scratch, &[]);
    assert_eq!((outcome.status, outcome.stderr()), (0, String::new()));
    assert_eq!(scratch.read("src/main.rs"), MAIN);
    assert_eq!(scratch.read("scripts/run"), "#!/bin/sh\necho \"$0\"\n");
    assert_eq!(scratch.read("a.mk"), "all:\n\ttrue\n");
    let files = ["./.tangled", "./a.mk", "./scripts/run", "./src/main.rs"];
    assert_eq!(listing(&scratch), files);
}

#[test]
fn a_written_file_has_the_time_of_its_chapter() {
    let scratch = project();
    scratch.write("chapters/b.nw", "<<Count>>=\nagain();\n");
    let newer = age(&scratch, "chapters/b.nw", 60);
    scratch.write("chapters/c.nw", "This one contributes nothing.\n");
    tangle(&scratch, &["chapters/b.nw", "chapters/c.nw"]).succeeded();
    assert_eq!(modified(&scratch, "src/main.rs"), newer);
    assert_eq!(
        modified(&scratch, "scripts/run"),
        modified(&scratch, "chapters/a.nw")
    );
}

#[test]
fn a_second_run_writes_nothing() {
    let scratch = project();
    tangle(&scratch, &[]);
    let files = listing(&scratch);
    let old: Vec<_> =
        files.iter().map(|f| age(&scratch, f, 7200)).collect();
    assert_eq!(tangle(&scratch, &[]).status, 0);
    let new: Vec<_> = files.iter().map(|f| modified(&scratch, f)).collect();
    assert_eq!(old, new);
}

#[test]
fn only_what_a_change_touches_is_written() {
    let scratch = project();
    tangle(&scratch, &[]);
    let script = age(&scratch, "scripts/run", 7200);
    let changed = CHAPTER.replace("count();", "count_all();");
    scratch.write("chapters/a.nw", changed);
    assert_eq!(tangle(&scratch, &[]).status, 0);
    assert!(scratch.read("src/main.rs").contains("count_all();"));
    assert_eq!(modified(&scratch, "scripts/run"), script);
}

#[test]
fn an_edit_by_hand_is_refused_with_its_chapter_line() {
    let scratch = project();
    tangle(&scratch, &[]);
    let edited = MAIN.replace("count();", "count_by_hand();");
    scratch.write("src/main.rs", &edited);
    scratch.write("chapters/a.nw", CHAPTER.replace("echo", "printf"));
    let outcome = tangle(&scratch, &[]);
    assert_eq!(outcome.status, 1);
    assert_eq!(
        outcome.stderr(),
        "src/main.rs:8:10: error: this file was edited by hand since it \
         was tangled\n      count_by_hand();\n           ^\n  \
         help: the line comes from chapters/a.nw:16\n  help: to \
         carry it there: noweb untangle chapters/a.nw\n  help: delete src/main.rs to \
         drop the edit\n"
    );
    assert_eq!(scratch.read("src/main.rs"), edited);
    let script = scratch.read("scripts/run");
    assert!(script.contains("echo"), "nothing at all is written");
}

#[test]
fn a_chapter_that_begins_like_an_option_is_hinted_at_as_a_file() {
    let scratch = Scratch::new();
    scratch.write("-a.nw", "<<a.txt>>=\na\n");
    scratch.write("a.txt", "b\n");
    let told = run(scratch.path(), &["tangle", "./-a.nw"]).stderr();
    assert!(told.contains("noweb untangle ./-a.nw\n"), "{told}");
}

#[test]
fn an_edit_that_was_moved_to_the_chapter_is_accepted() {
    let scratch = project();
    tangle(&scratch, &[]);
    scratch.write("src/main.rs", MAIN.replace("count", "tally"));
    scratch.write("chapters/a.nw", CHAPTER.replace("count", "tally"));
    assert_eq!(tangle(&scratch, &[]).status, 0);
    scratch.write("chapters/a.nw", CHAPTER);
    assert_eq!(tangle(&scratch, &[]).status, 0, "the record knows it");
    assert_eq!(scratch.read("src/main.rs"), MAIN);
}

#[test]
fn a_deleted_file_is_tangled_anew() {
    let scratch = project();
    tangle(&scratch, &[]);
    fs::remove_file(scratch.path().join("src/main.rs")).expect("removal");
    assert_eq!(tangle(&scratch, &[]).status, 0);
    assert_eq!(scratch.read("src/main.rs"), MAIN);
}

#[test]
fn a_file_that_nobody_tangled_is_not_overwritten() {
    let scratch = project();
    scratch.write("src/main.rs", "fn main() {}\n");
    tangle(&scratch, &[]).failed("edited by hand");
    assert_eq!(scratch.read("src/main.rs"), "fn main() {}\n");
    assert_eq!(listing(&scratch), ["./src/main.rs"]);
}

#[test]
fn a_file_without_a_chunk_is_removed_unless_it_was_edited() {
    let scratch = project();
    tangle(&scratch, &[]);
    let renamed = CHAPTER.replace("scripts/run", "scripts/walk");
    scratch.write("chapters/a.nw", &renamed);
    scratch.write("scripts/run", "#!/bin/sh\nmine\n");
    let said = "no chunk defines scripts/run, an edited file";
    tangle(&scratch, &[]).failed(said);
    scratch.write("scripts/run", "#!/bin/sh\necho \"$0\"\n");
    assert_eq!(tangle(&scratch, &[]).status, 0);
    let files = ["./.tangled", "./a.mk", "./scripts/walk", "./src/main.rs"];
    assert_eq!(listing(&scratch), files);
}

#[test]
fn check_names_what_is_stale_and_writes_nothing() {
    let scratch = project();
    let outcome = tangle(&scratch, &["--check"]);
    assert_eq!(outcome.status, 1);
    assert_eq!(
        outcome.stderr(),
        "error: src/main.rs is out of date\nerror: scripts/run is out of \
         date\nerror: a.mk is out of date\n"
    );
    assert_eq!(listing(&scratch), [""; 0]);
    tangle(&scratch, &[]);
    assert_eq!(tangle(&scratch, &["--check"]).status, 0);
}

#[test]
fn the_record_is_sorted_and_holds_hashes() {
    let scratch = project();
    tangle(&scratch, &[]);
    // FNV-1a of the texts, from an implementation of its own.
    let hash = |text: &str| {
        let mut hash = 14_695_981_039_346_656_037_u64;
        for byte in text.bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(1_099_511_628_211);
        }
        format!("{hash:016x}")
    };
    let files = ["a.mk", "scripts/run", "src/main.rs"];
    let lines = files.map(|f| format!("{} {f}\n", hash(&scratch.read(f))));
    assert_eq!(scratch.read(".tangled"), lines.concat());
}

#[test]
fn an_undefined_chunk_stops_everything() {
    let scratch = project();
    let broken = CHAPTER.replace("<<Count>>\n@", "<<Cuont>>\n@");
    scratch.write("chapters/a.nw", broken);
    let outcome = tangle(&scratch, &[]);
    assert_eq!(outcome.status, 1);
    let said = "chapters/a.nw:13:1: error: undefined chunk name: <<Cuont>>";
    assert!(outcome.stderr().starts_with(said), "{}", outcome.stderr());
    assert_eq!(listing(&scratch), [""; 0]);
}

#[test]
fn a_chunk_that_nobody_uses_is_reported() {
    let scratch = project();
    scratch.write("chapters/a.nw", CHAPTER.to_owned() + "<<Idle>>=\nx\n");
    let outcome = tangle(&scratch, &[]);
    assert_eq!(outcome.status, 0);
    let said =
        "chapters/a.nw:30:3: warning: chunk <<Idle>> is never used\n";
    assert!(outcome.stderr().starts_with(said), "{}", outcome.stderr());
}

#[test]
fn a_cycle_that_no_root_reaches_is_reported_once() {
    let scratch = project();
    let cycle = "<<Down>>=\n<<One>>\n<<One>>=\n<<Two>>\n<<Down>>\n\
        <<Two>>=\n<<One>>\n";
    scratch.write("chapters/a.nw", CHAPTER.to_owned() + cycle);
    let said = "chapters/a.nw:30:3: warning: no root reaches <<Down>>, \
        in a cycle\n  <<Down>>=\n    ^\n";
    let outcome = tangle(&scratch, &[]);
    assert_eq!((outcome.status, outcome.stderr()), (0, said.into()));
}

#[test]
fn what_hangs_below_a_lost_cycle_is_no_cycle() {
    let scratch = project();
    let cycle = "<<Leaf>>=\n1\n<<Self>>=\n<<Leaf>>\n<<Self>>\n";
    scratch.write("chapters/a.nw", CHAPTER.to_owned() + cycle);
    let outcome = tangle(&scratch, &[]);
    let said = "chapters/a.nw:32:3: warning: no root reaches <<Self>>";
    assert!(outcome.stderr().starts_with(said), "{}", outcome.stderr());
    assert!(!outcome.stderr().contains("Leaf"), "{}", outcome.stderr());
}

#[test]
fn a_directory_that_cannot_be_written_is_named() {
    let scratch = project();
    scratch.write("src", "a file where a directory should be\n");
    let said = "error: cannot write src/main.rs: ";
    tangle(&scratch, &[]).failed(said);
}

#[test]
fn a_chapter_that_cannot_be_read_is_named() {
    let scratch = project();
    let said = "error: cannot read chapters/none.nw: ";
    tangle(&scratch, &["chapters/none.nw"]).failed(said);
    assert_eq!(listing(&scratch), [""; 0]);
}

#[test]
fn a_full_disk_leaves_the_old_file_and_no_debris() {
    let scratch = project();
    tangle(&scratch, &[]);
    let grown = CHAPTER.replace("count();", &"count();\n".repeat(4000));
    scratch.write("chapters/a.nw", grown);
    // A limit on the size of files is a disk that is full for one file.
    let command = format!(
        "ulimit -f 16; trap '' XFSZ; '{}' tangle chapters/a.nw",
        noweb().display()
    );
    let before = listing(&scratch);
    let said = "error: cannot write src/main.rs: File too large";
    shell(&command, scratch.path(), scratch.path()).failed(said);
    assert_eq!(scratch.read("src/main.rs"), MAIN);
    assert_eq!(listing(&scratch), before);
}

#[test]
fn wrong_usage_has_status_2() {
    let scratch = project();
    for args in [&["tangle"][..], &["tangle", "--nope"], &["tangle", "-C"]]
    {
        assert_eq!(run(scratch.path(), args).status, 2, "{args:?}");
    }
    for args in [&[][..], &["nonsense"]] {
        assert_eq!(run(scratch.path(), args).status, 2, "{args:?}");
    }
    let outcome = run(scratch.path(), &["tangle", "--nope"]);
    assert!(
        outcome.stderr().contains("noweb [COMMAND] --help"),
        "{outcome:?}"
    );
}

#[test]
fn each_command_has_a_help_and_a_version() {
    let scratch = Scratch::new();
    let version = run(scratch.path(), &["--version"]).stdout();
    assert!(version.starts_with("noweb 0."), "{version}");
    let list = run(scratch.path(), &["--help"]).stdout();
    assert_eq!(run(scratch.path(), &["-h"]).stdout(), list);
    for command in crate::common::names() {
        let command = &command[..];
        assert!(list.contains(&format!("\n  {command} ")), "{command}");
        let help = run(scratch.path(), &[command, "--help"]);
        assert_eq!((help.status, help.stderr()), (0, String::new()));
        let usage = format!("usage: noweb {command}");
        assert!(help.stdout().starts_with(&usage), "{}", help.stdout());
        let again = run(scratch.path(), &[command, "-h"]).stdout();
        assert_eq!(again, help.stdout());
        for option in ["-V", "--version"] {
            let told = run(scratch.path(), &[command, option]);
            assert_eq!((told.status, told.stdout()), (0, version.clone()));
        }
    }
}

#[test]
fn the_command_that_is_mapped_keeps_its_options() {
    let scratch = Scratch::new();
    scratch.write("a.nw", "Prose.\n");
    let words = ["map", "a.nw", "--", "echo", "--help", "-V"];
    assert_eq!(run(scratch.path(), &words).stdout(), "--help -V\n");
}

#[test]
fn other_ends_of_lines_are_no_edit() {
    let dos = |text: &str| text.replace('\n', "\r\n");
    let plain = CHAPTER.replace("count();", "count(2);\n\nend();");
    for (chapter, file) in [(false, true), (true, false), (true, true)] {
        let scratch = project();
        let given = |text: &str, is_dos| {
            if is_dos { dos(text) } else { text.to_owned() }
        };
        scratch.write("chapters/a.nw", given(CHAPTER, chapter));
        assert_eq!(tangle(&scratch, &[]).status, 0);
        assert_eq!(scratch.read("a.mk"), given("all:\n\ttrue\n", chapter));
        for name in ["src/main.rs", ".tangled"] {
            let text = scratch.read(name).replace("\r\n", "\n");
            scratch.write(name, given(&text, file));
        }
        let untangle = ["untangle", "chapters/a.nw"];
        let none = run(scratch.path(), &untangle);
        assert_eq!((none.status, none.stdout()), (0, String::new()));
        assert_eq!(tangle(&scratch, &["--check"]).stderr(), "");
        let map =
            ["map", "chapters/a.nw", "--", "echo", "src/main.rs:8:5:"];
        let told = run(scratch.path(), &map).stdout();
        assert_eq!(told, "chapters/a.nw:16:1:\n");
        // An edit is one, and comes home with the ends of the chapter.
        let edit = MAIN.replace("count();", "count(2);\n\n    end();");
        scratch.write("src/main.rs", given(&edit, file));
        let told = tangle(&scratch, &[]).stderr();
        assert!(told.starts_with("src/main.rs:8:11: error"), "{told}");
        assert_eq!(run(scratch.path(), &untangle).status, 0);
        assert_eq!(scratch.read("chapters/a.nw"), given(&plain, chapter));
        // Empty lines go as they have come.
        scratch.write("src/main.rs", given(MAIN, file));
        assert_eq!(run(scratch.path(), &untangle).stderr(), "");
        assert_eq!(scratch.read("chapters/a.nw"), given(CHAPTER, chapter));
        // A file that was tangled is replaced, whatever its ends.
        scratch.write("chapters/a.nw", given(CHAPTER, !chapter));
        assert_eq!(tangle(&scratch, &[]).stderr(), "");
        assert_eq!(scratch.read("src/main.rs"), given(MAIN, !chapter));
    }
}

#[test]
fn marks_of_a_conflict_are_refused_with_their_lines() {
    let scratch = project();
    tangle(&scratch, &[]);
    let text = MAIN.replacen("fn", "<<<<<<< HEAD\nfn", 1)
        + "||||||| 1234567\n=======\r\n>>>>>>> other\n";
    let marks = |path: &str, lines: &[u32]| {
        let text = "error: a conflict of git is not resolved here\n  \
                    help: keep what holds, and remove the line\n";
        let line = |line| format!("{path}:{line}:1: {text}");
        lines.iter().map(line).collect::<String>()
    };
    scratch.write("src/main.rs", &text);
    let told = marks("src/main.rs", &[4, 12, 13, 14]);
    assert_eq!(tangle(&scratch, &[]).stderr(), told);
    let untangle = ["untangle", "chapters/a.nw"];
    assert_eq!(run(scratch.path(), &untangle).stderr(), told);
    assert_eq!(scratch.read("src/main.rs"), text);
    scratch.write("src/main.rs", MAIN);
    let conflict = "<<<<<<< a\n=======\r\n>>>>>>>\n";
    scratch.write("chapters/a.nw", format!("{CHAPTER}{conflict}"));
    let told = tangle(&scratch, &[]).stderr();
    assert_eq!(told, marks("chapters/a.nw", &[30, 31, 32]));
    let quoted = format!("~~~\n{conflict}~~~\n<!--\n{conflict}-->\n");
    scratch.write("SUMMARY.md", format!("{conflict}\n[](a.md)\n"));
    scratch.write("a.md", format!("{quoted}<<a>>=\n```\n{conflict}"));
    let ours = marks("a.md", &[13, 14, 15]);
    let both = marks("SUMMARY.md", &[1, 2, 3]) + &ours;
    let told = run(scratch.path(), &["tangle", "SUMMARY.md"]).stderr();
    assert_eq!(told, both);
    let woven = run(scratch.path(), &["noweave", "-md", "a.md"]);
    assert_eq!((woven.status, woven.stderr()), (1, ours));
    // What is no conflict, nor a file that its chapters give the marks.
    let none = "|||||||\n>>>>>>> x\n=======\n<<<<<<< a\n>>>>>>>\n";
    let file = format!("<<a.txt>>=\n@{conflict}@\n");
    scratch.write("a.md", format!("{quoted}{none}\n{file}"));
    let outcome = run(scratch.path(), &["tangle", "a.md"]);
    assert_eq!((outcome.status, outcome.stderr()), (0, "".into()));
    scratch.write("a.txt", scratch.read("a.txt") + "b\n");
    let outcome = run(scratch.path(), &["tangle", "a.md"]);
    let said = "this file was edited by hand";
    assert!(outcome.stderr().contains(said), "{}", outcome.stderr());
}

#[test]
fn a_build_script_refuses_the_marks_of_a_conflict() {
    let scratch = project();
    let chapters = vec!["chapters/a.nw".into()];
    let project = noweb_core::project::Project {
        dir: scratch.path().to_owned(),
        record: ".tangled".into(),
        chapters,
        ..noweb_core::project::Project::default()
    };
    project.tangle().expect("a program");
    let conflict = "<<<<<<< a\nours\n=======\ntheirs\n>>>>>>> b\n";
    for text in
        [format!("{CHAPTER}{conflict}"), conflict.to_owned() + CHAPTER]
    {
        scratch.write("chapters/a.nw", &text);
        let faults = project.tangle().expect_err("a conflict");
        let lines: Vec<u32> = faults
            .iter()
            .map(|fault| fault.position.as_ref().expect("a line").line)
            .collect();
        let first = text[..text.find("<<<<<<<").unwrap()].lines().count();
        let first = first as u32 + 1;
        assert_eq!(lines, [first, first + 2, first + 4]);
        assert_eq!(scratch.read("src/main.rs"), MAIN);
    }
    // A line of equal signs is none, nor is what a program has anyhow.
    let heading = format!("A heading\n=======\n{CHAPTER}");
    scratch.write("chapters/a.nw", heading);
    project.tangle().expect("a program");
}

#[test]
fn a_record_with_a_conflict_knows_both_sides_and_heals() {
    for is_ours_first in [true, false] {
        let scratch = project();
        tangle(&scratch, &[]);
        let ours = scratch.read(".tangled");
        let theirs = ours.replace(|c: char| c.is_ascii_digit(), "a");
        let (one, two) =
            if is_ours_first { (&ours, &theirs) } else { (&theirs, &ours) };
        let both = format!("<<<<<<< a\n{one}=======\n{two}>>>>>>> b\n");
        scratch.write(".tangled", both);
        scratch.write("chapters/a.nw", CHAPTER.replace("42", "43"));
        assert_eq!(tangle(&scratch, &[]).stderr(), "");
        let healed = scratch.read(".tangled");
        assert_eq!(healed.lines().count(), ours.lines().count());
    }
}

#[test]
fn a_root_in_no_directory_is_a_file_and_told_how_to_be_one() {
    let scratch = Scratch::new();
    scratch.write(
        "a.nw",
        "<<./Makefile>>=\na:\n\tb\n<<../a>>=\n<</etc/a>>=\n<<GNUmakefile>>=\n",
    );
    let outcome = run(scratch.path(), &["tangle", "a.nw"]);
    assert_eq!(outcome.status, 0);
    let told = |name: &str, line, help: &str| {
        format!(
            "a.nw:{line}:3: warning: chunk <<{name}>> is never used\n  \
             <<{name}>>=\n    ^\n  help: {help}\n"
        )
    };
    let inside = "a file is named like src/main.rs, without spaces and \
                  inside the project";
    let inside = told("../a", 4, inside) + &told("/etc/a", 5, inside);
    let own =
        told("GNUmakefile", 6, "if it is a file, call it ./GNUmakefile");
    assert_eq!(outcome.stderr(), inside + &own);
    assert_eq!(scratch.read("Makefile"), "a:\n\tb\n");
    let map = ["map", "a.nw", "--", "echo", "Makefile:2: ***"];
    assert_eq!(run(scratch.path(), &map).stdout(), "a.nw:3: ***\n");
    for names in ["./a/b a/b", "a//b a/b", "a/./b ./a/b"] {
        let (one, two) = names.split_once(' ').expect("two names");
        scratch.write("a.nw", format!("<<{one}>>=\n1\n<<{two}>>=\n2\n"));
        let told = run(scratch.path(), &["tangle", "a.nw"]).stderr();
        let said = "a.nw:3:3: error: another chunk is this file";
        assert!(told.starts_with(said), "{told}");
    }
}

#[test]
fn the_record_is_found_where_the_files_are() {
    let scratch = project();
    tangle(&scratch, &["--record", "src/.tangled"]);
    // A record of other files is left alone.
    scratch.write("scripts/.tangled", "0000000000000000 scripts/other\n");
    scratch.write("scripts/other", "");
    scratch
        .write("chapters/a.nw", CHAPTER.replace("count();", "count(2);"));
    assert_eq!(tangle(&scratch, &[]).stderr(), "");
    assert!(scratch.read("src/main.rs").contains("count(2);"));
    assert_eq!(scratch.read("scripts/other"), "");
    assert!(!scratch.path().join(".tangled").exists());
    // So is one that has other files besides ours.
    let more = "0000000000000000 scripts/other\n";
    scratch.write("src/.tangled", scratch.read("src/.tangled") + more);
    assert_eq!(tangle(&scratch, &[]).stderr(), "");
    assert_eq!(scratch.read("scripts/other"), "");
}

#[test]
fn an_output_that_is_closed_from_the_start_is_an_error() {
    let scratch = project();
    for command in ["notangle -Ra.mk", "noroots", "noweave", "markup"] {
        for closed in [">&-", "1</dev/null"] {
            let noweb = noweb().display().to_string();
            let line =
                format!("'{noweb}' {command} chapters/a.nw {closed}");
            let outcome = shell(&line, scratch.path(), scratch.path());
            assert_eq!(outcome.status, 1, "{line}");
            let said = "error: cannot write: standard output is closed\n";
            assert_eq!(outcome.stderr(), said, "{line}");
        }
    }
    for fine in
        ["tangle chapters/a.nw >&-", "noroots chapters/a.nw >/dev/null"]
    {
        let line = format!("'{}' {fine}", noweb().display());
        let outcome = shell(&line, scratch.path(), scratch.path());
        assert_eq!((outcome.status, outcome.stderr()), (0, "".into()));
    }
}

#[test]
fn the_mark_of_the_byte_order_is_skipped() {
    let scratch = Scratch::new();
    scratch.write("a.nw", "\u{feff}<<a.txt>>=\none\n");
    run(scratch.path(), &["tangle", "a.nw"]).succeeded();
    assert_eq!(scratch.read("a.txt"), "one\n");
    scratch.write("a.txt", "two\n");
    run(scratch.path(), &["untangle", "a.nw"]).succeeded();
    assert_eq!(scratch.read("a.nw"), "\u{feff}<<a.txt>>=\ntwo\n");
}

#[test]
fn a_chapter_that_the_master_does_not_include_is_named() {
    let scratch = project();
    scratch.write("book.nw", "\\include{a}\n");
    let map = ["map", "book.nw", "--", "true"];
    assert_eq!(run(scratch.path(), &map).status, 0);
    scratch.write("chapters/.b.nw", "");
    assert_eq!(run(scratch.path(), &map).status, 0);
    scratch.write("chapters/b.nw", "");
    let outcome = run(scratch.path(), &map);
    assert_eq!(outcome.status, 2);
    let said = "book.nw does not include chapters/b.nw";
    assert!(outcome.stderr().contains(said), "{}", outcome.stderr());
}

#[test]
fn names_are_comments_only_in_the_bodies_of_functions() {
    let scratch = Scratch::new();
    for (before, after, named) in [
        ("fn f() {", "}", true),
        ("fn f() -> [fn() -> u8; 2]\nwhere\n  u8: X<'a>,\n{", "}", true),
        ("impl S {\n  fn f(\n    x: u8,\n  ) {\n    m!(x);", "}\n}", true),
        ("fn f() {\n  a::<'b>('\"', b'\\'', '\u{e9}', '}');", "}", true),
        (
            "fn f() {\n  r#\"\"}\"#; // }\"\n  /* /* */ \" */ call(",
            ")\n}",
            true,
        ),
        ("fn f() {}", "", false),
        ("struct S {", "}", false),
        ("impl S {\n  const A: u8 = 1;\n  fn f() {}", "}", false),
        ("trait T {\n  fn f();\n  type U = [", "];\n}", false),
        ("fn f() {\n  a = \"\\\"", "\";\n}", false),
        ("fn f() {\n  a = br##\"\\\"#", "\"##;\n}", false),
        ("fn f() {\n  a = '{'; /* /* */", "*/\n}", false),
        ("fn f() {\n  m! {\n    {", "}\n  }\n}", false),
    ] {
        let body = format!("{before}\n    <<Do it>>\n{after}\n");
        let web = format!("<<a.rs>>=\n{body}<<Do it>>=\nx\n\ny\n");
        scratch.write("a.nw", web);
        run(scratch.path(), &["tangle", "a.nw"]).succeeded();
        let name = if named { "// Do it\n    x" } else { "x" };
        let done = body.replace("<<Do it>>", &format!("{name}\n\n    y"));
        assert_eq!(scratch.read("a.rs"), done);
    }
    scratch.write(
        "a.nw",
        b"<<a.rs>>=\nfn f() {\n  <<\xe9>>\n}\n<<\xe9>>=\nx\n",
    );
    assert_eq!(run(scratch.path(), &["tangle", "a.nw"]).status, 0);
    assert_eq!(scratch.read("a.rs"), "fn f() {\n  x\n}\n");
}

#[test]
fn no_other_text_gets_names_and_tabs_are_copied() {
    let scratch = Scratch::new();
    let names = "run a.sh a.py a.toml a.vim a.awk Makefile GNUmakefile \
                 a.mak a.mk a.go a.tex";
    for name in names.split_whitespace() {
        let body = "all:\n\t<<Do it>>\n  \t x = <<Do it>>;\n<<Do it>>\n";
        let web = format!("<<b/{name}>>=\n{body}<<Do it>>=\na\n\n\tb\n");
        scratch.write("a.nw", web);
        let outcome = run(scratch.path(), &["tangle", "a.nw"]);
        assert_eq!(outcome.status, 0, "{name}: {}", outcome.stderr());
        let done = "all:\n\ta\n\n\t\tb\n  \t x = a\n\n  \t     \tb;\n\
                    a\n\n\tb\n";
        assert_eq!(scratch.read(&format!("b/{name}")), done, "{name}");
    }
}

/// A text in Latin-1.
fn latin(text: &str) -> Vec<u8> {
    text.chars().map(|c| c as u8).collect()
}

#[test]
fn bytes_of_any_encoding_and_long_names_pass_through() {
    let scratch = Scratch::new();
    let long = "l".repeat(251) + ".txt";
    let web = "<<dé/a[1].txt>>=\né <<é b>>\né\n<<é b>>=\ncé\n<<é>>=\n";
    scratch.write("in", latin(&format!("{web}<<{long}>>=\n1\n")));
    // Runs a line in Latin-1, in which N is our program.
    let says = |line: &str, parts: &[&str]| {
        let line = line.replace('N', &noweb().display().to_string());
        let mut sh = Command::new("sh");
        sh.arg("-c").arg(OsStr::from_bytes(&latin(&line)));
        let said = sh.current_dir(scratch.path()).output().expect("sh");
        let said = [said.stdout, said.stderr].concat();
        let said = said.escape_ascii().to_string();
        for part in parts {
            let part = latin(part).escape_ascii().to_string();
            assert!(said.contains(&part), "{part} is not in {said}");
        }
    };
    let warned =
        "é a.nw:6:3: warning: chunk <<é>> is never used\n  <<é>>=\n";
    says(
        "cp in 'é a.nw'; N tangle 'é a.nw'; cat d*/*",
        &[warned, "é cé\n"],
    );
    assert_eq!(scratch.read(&long), "1\n");
    says("ls -A", &[".tangled\nd"]);
    says(
        "echo x | tee -a d*/*; N tangle 'é a.nw'; N untangle 'é a.nw' é",
        &["dé/a[1].txt:3:1: error: this", " é a.nw:3\n", "cannot read é: "],
    );
    says("N untangle 'é a.nw'", &["é a.nw:4: -0 +1 lines\n"]);
    says(
        "N noweave -v -index -autodefs rust -option éo -filter cat 'é a.nw'",
        &["rkup 'é a.nw'\n", "\\noweboptions{éo}", "\\moddef{dé/a"],
    );
    says(
        "N finduses é; N notangle -Ré 'é b'",
        &["option é\n", "file é b:"],
    );
}

#[test]
fn an_output_that_does_not_wait_gets_all_bytes() {
    let scratch = project();
    let text = "a line of some length\n".repeat(40_000);
    scratch.write("big.nw", "<<*>>=\n".to_owned() + &text);
    let (mut ours, theirs) = UnixStream::pair().expect("two ends");
    theirs.set_nonblocking(true).expect("an end that does not wait");
    let mut command = Command::new(noweb());
    let command = command.args(["notangle", "big.nw"]);
    let command = command.current_dir(scratch.path());
    let mut child =
        command.stdout(OwnedFd::from(theirs)).spawn().expect("a command");
    // Its last end here must be closed, or we would wait for ever.
    *command = Command::new("true");
    std::thread::sleep(Duration::from_millis(300));
    let mut read = String::new();
    ours.read_to_string(&mut read).expect("the text");
    assert!(read == text, "{} bytes of {}", read.len(), text.len());
    assert!(child.wait().expect("an end").success());
}

#[test]
fn a_closed_pipe_is_not_an_error() {
    let scratch = project();
    let many = "<<*>>=\n".to_owned() + &"line\n".repeat(200_000);
    scratch.write("big.nw", many);
    let command = format!(
        "{{ '{}' notangle big.nw; echo $? >status; }} | head -1",
        noweb().display()
    );
    let outcome = shell(&command, scratch.path(), scratch.path());
    assert_eq!(outcome.stderr(), "");
    assert_eq!(scratch.read("status"), "0\n");
}

#[test]
fn an_output_that_cannot_be_written_is_an_error() {
    let scratch = project();
    let command = format!(
        "'{}' notangle -Rsrc/main.rs chapters/a.nw >/dev/full",
        noweb().display()
    );
    let outcome = shell(&command, scratch.path(), scratch.path());
    assert_eq!(outcome.status, 1);
    assert!(outcome.stderr().starts_with("error: cannot write: No space"));
}

#[test]
fn a_hundred_thousand_lines_take_no_quadratic_time() {
    let scratch = Scratch::new();
    let mut web = String::from("<<*>>=\n");
    for number in 0..20_000 {
        web += &format!("  <<chunk {number}>>\n");
    }
    for number in 0..20_000 {
        web += &format!("@ prose\n<<chunk {number}>>=\na << b\nc\td\n");
    }
    scratch.write("big.nw", web);
    let start = std::time::Instant::now();
    let outcome = run(scratch.path(), &["notangle", "big.nw"]);
    assert_eq!(outcome.status, 0);
    assert_eq!(outcome.stdout().lines().count(), 40_000);
    assert!(start.elapsed() < Duration::from_secs(20));
}
