// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Edits of tangled files come home to the chapters, or are refused.

use std::fs;

use crate::common::{Outcome, Scratch, run, shell};
use noweb::project::{self, Project};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::RngSeed;

const CHAPTER: &str = "\
Prose of the file.
<<src/main.rs>>=
<<Carry the licence>>

fn main() {
    <<Say hello>>
    let x = <<the number>> + 1;
    end();
}
@ Prose of hello.
<<Say hello>>=
hello();
if a @<< b >> c {
    <<Count>>
}
@ Prose between.
<<Say hello>>=
more();
last();
@
<<Count>>=
count();

count_again();
<<the number>>=
42
@
<<Carry the licence>>=
// One
// Two
@
<<src/other.rs>>=
<<Carry the licence>>
other();
@
<<src/Makefile>>=
all:
\ttrue
\t<<Echo the name>>
@
<<Echo the name>>=
echo a
echo b
@ Prose at the end.
";

const MAIN: &str = "\
// One
// Two

fn main() {
    // Say hello
    hello();
    if a << b >> c {
        // Count
        count();

        count_again();
    }
    more();
    last();
    let x = 42 + 1;
    end();
}
";

/// A project of one chapter that was just tangled.
fn project(chapter: &str) -> Scratch {
    let scratch = Scratch::new();
    scratch.write("a.nw", chapter);
    run(scratch.path(), &["tangle", "a.nw"]).succeeded();
    scratch
}

fn untangle(scratch: &Scratch) -> Outcome {
    run(scratch.path(), &["untangle", "a.nw"])
}

/// Replaces the one occurrence of a text in a file.
fn edit(scratch: &Scratch, file: &str, old: &str, new: &str) {
    let text = scratch.read(file);
    assert_eq!(text.matches(old).count(), 1, "{old:?} in {text}");
    scratch.write(file, text.replace(old, new));
}

/// All files with their texts.
fn snapshot(scratch: &Scratch) -> String {
    let command = "find . -type f -exec sha256sum {} + | LC_ALL=C sort";
    shell(command, scratch.path(), scratch.path()).stdout()
}

/// Edits come home: in the chapter `old` becomes `new`, nothing else
/// changes there, and tangling gives the edited files.
fn comes_home(edits: &[(&str, &str, &str)], old: &str, new: &str) {
    let scratch = project(CHAPTER);
    for (file, old, new) in edits {
        edit(&scratch, file, old, new);
    }
    let files: Vec<_> =
        edits.iter().map(|(file, ..)| scratch.read(file)).collect();
    untangle(&scratch).succeeded();
    assert_eq!(CHAPTER.matches(old).count(), 1, "{old:?}");
    assert_eq!(scratch.read("a.nw"), CHAPTER.replace(old, new));
    for ((file, ..), text) in edits.iter().zip(files) {
        assert_eq!(scratch.read(file), text);
    }
    let check = run(scratch.path(), &["tangle", "--check", "a.nw"]);
    assert_eq!((check.status, check.stderr()), (0, String::new()));
}

/// Edits are refused with a message, and nothing is written.
fn is_refused(edits: &[(&str, &str, &str)], said: &str) {
    let scratch = project(CHAPTER);
    for (file, old, new) in edits {
        edit(&scratch, file, old, new);
    }
    refuses(&scratch, said);
}

fn refuses(scratch: &Scratch, said: &str) {
    let before = snapshot(scratch);
    untangle(scratch).failed(said);
    assert_eq!(snapshot(scratch), before, "something was written");
}

/// What is said of an edit that does not lie within one chunk.
const OUTSIDE: &str = "this edit is not in the text of one chunk";

/// What is said of an edit that two places may have.
const EITHER: &str = "this edit may belong to either of two places";

const MAIN_RS: &str = "src/main.rs";

#[test]
fn an_edit_of_lines_of_two_characters_comes_home() {
    let chapter = CHAPTER.replace('\n', "\r\n");
    let scratch = project(&chapter);
    let added = "    least();\r\n    last();";
    edit(&scratch, "src/main.rs", "    last();", added);
    untangle(&scratch).succeeded();
    let edited = chapter.replace("last();", "least();\r\nlast();");
    assert_eq!(scratch.read("a.nw"), edited);
}

#[test]
fn a_changed_line_comes_home() {
    let edit = (MAIN_RS, "    more();", "    much_more();");
    comes_home(&[edit], "\nmore();", "\nmuch_more();");
}

#[test]
fn what_changed_is_told_by_chapter_and_line() {
    let scratch = project(CHAPTER);
    edit(&scratch, MAIN_RS, "hello();", "hello();\n    again();");
    edit(&scratch, MAIN_RS, "end();", "the_end();");
    let before = snapshot(&scratch);
    let check = run(scratch.path(), &["untangle", "--check", "a.nw"]);
    let told = "a.nw:8: -1 +1 lines\na.nw:13: -0 +1 lines\n";
    assert_eq!((check.status, check.stdout()), (1, told.to_owned()));
    assert_eq!(snapshot(&scratch), before, "--check wrote something");
    let outcome = untangle(&scratch);
    assert_eq!((outcome.status, outcome.stdout()), (0, told.to_owned()));
    let again = untangle(&scratch);
    assert_eq!((again.status, again.stdout()), (0, String::new()));
}

#[test]
fn a_read_only_chapter_is_not_replaced_nor_are_those_before_it() {
    let scratch = Scratch::new();
    scratch.write("a.nw", CHAPTER);
    scratch.write("b.nw", "<<src/b.rs>>=\nb();\n");
    run(scratch.path(), &["tangle", "a.nw", "b.nw"]).succeeded();
    edit(&scratch, MAIN_RS, "more();", "much_more();");
    edit(&scratch, "src/b.rs", "b();", "bb();");
    shell("chmod a-w b.nw", scratch.path(), scratch.path());
    let before = snapshot(&scratch);
    let outcome = run(scratch.path(), &["untangle", "a.nw", "b.nw"]);
    let said = "error: cannot write b.nw: permission denied\n";
    assert_eq!((outcome.status, &*outcome.stderr()), (1, said));
    assert_eq!(snapshot(&scratch), before, "something was written");
}

#[test]
fn an_insertion_between_lines_of_one_chunk_comes_home() {
    let edit = (MAIN_RS, "    last();", "\n    x();\n    last();");
    comes_home(&[edit], "\nlast();", "\n\nx();\nlast();");
    let edit = (MAIN_RS, "        count();\n", "        count();\n\n");
    comes_home(&[edit], "count();\n\n", "count();\n\n\n");
}

#[test]
fn an_insertion_before_a_use_comes_home() {
    let edit = (MAIN_RS, "    // Say", "    x();\n    // Say");
    comes_home(&[edit], "    <<Say", "    x();\n    <<Say");
}

#[test]
fn an_insertion_below_a_name_goes_to_the_top_of_the_chunk() {
    let edit = (MAIN_RS, "// Count", "// Count\n        first();");
    comes_home(&[edit], ">>=\ncount();", ">>=\nfirst();\ncount();");
}

#[test]
fn lines_at_the_end_of_a_file_go_to_its_last_chunk() {
    let edit = (MAIN_RS, "\n}\n", "\n}\n\nfn more() {}\n");
    comes_home(&[edit], "end();\n}\n", "end();\n}\n\nfn more() {}\n");
}

#[test]
fn lines_at_the_beginning_of_a_file_go_to_its_root() {
    let edit = ("src/Makefile", "all:", "CC = cc\nall:");
    comes_home(&[edit], "Makefile>>=\n", "Makefile>>=\nCC = cc\n");
    // Unless the root begins with a use, here of a chunk of two files.
    let edit = (MAIN_RS, "// One", "#![no_std]\n// One");
    is_refused(&[edit], "an edit elsewhere would change this line");
}

#[test]
fn a_removal_over_the_border_of_a_chunk_is_refused() {
    let edit = (MAIN_RS, "    last();\n    let x = 42 + 1;\n", "");
    is_refused(&[edit], OUTSIDE);
    let edit = (MAIN_RS, "        count_again();\n    }\n", "");
    is_refused(&[edit], OUTSIDE);
}

#[test]
fn two_of_three_equal_lines_are_not_removed_from_one_chunk() {
    let chapter = "<<a.rs>>=\n{\n<<Inner>>\n}\nend\n@ Prose.\n\
                   <<Inner>>=\n{\n}\n}\n";
    let scratch = project(chapter);
    edit(&scratch, "a.rs", "}\n}\n}\n", "}\n");
    refuses(&scratch, EITHER);
}

#[test]
fn a_line_of_a_chunk_is_changed_at_both_of_its_uses() {
    let chapter = "<<a.rs>>=\n  <<Inner>>\nmiddle\n<<Inner>>\n\
                   @ Prose.\n<<Inner>>=\none\ntwo\n";
    let scratch = project(chapter);
    scratch.write("a.rs", scratch.read("a.rs").replace("two\n", "done\n"));
    untangle(&scratch).succeeded();
    assert_eq!(scratch.read("a.nw"), chapter.replace("two", "done"));
    // At one of the two uses it is refused.
    let scratch = project(chapter);
    edit(&scratch, "a.rs", "\n  two\n", "\n  done\n");
    refuses(&scratch, "no change of one chunk gives this line");
}

/// A file of so many functions, each of which has a definition of its own.
fn functions(count: usize) -> (String, Vec<String>) {
    let function = |k| {
        let blank = if k > 0 { "\n" } else { "" };
        format!("{blank}fn f{k}() {{\n    b{k}();\n}}\n")
    };
    let functions: Vec<String> = (0..count).map(function).collect();
    let define = |f: &String| format!("<<a.rs>>=\n{f}@ Prose.\n");
    let chapter = functions.iter().map(define).collect();
    (chapter, functions)
}

#[test]
fn whole_functions_are_removed_from_many_places() {
    let (chapter, functions) = functions(30);
    let scratch = project(&chapter);
    let kept = functions.iter().step_by(2).cloned();
    scratch.write("a.rs", kept.collect::<String>());
    untangle(&scratch).succeeded();
    let gone = functions.iter().skip(1).step_by(2);
    let wanted = gone.fold(chapter, |chapter, f| chapter.replace(f, ""));
    assert_eq!(scratch.read("a.nw"), wanted);
    // Two of them at once have two definitions.
    let (chapter, functions) = self::functions(4);
    let scratch = project(&chapter);
    scratch.write("a.rs", functions[0].clone() + &functions[3]);
    refuses(&scratch, OUTSIDE);
}

#[test]
fn a_function_is_not_removed_below_a_line_that_was_changed() {
    let (chapter, functions) = functions(3);
    let scratch = project(&chapter);
    scratch.write("a.rs", functions[0].replace("b0", "c0") + &functions[2]);
    refuses(&scratch, OUTSIDE);
}

#[test]
fn one_of_two_equal_lines_that_was_changed_is_one_change() {
    let chapter = "<<a.rs>>=\n{\n<<Inner>>\n}\nend\n@ Prose.\n\
                   <<Inner>>=\n{\n}\n";
    let scratch = project(chapter);
    edit(&scratch, "a.rs", "}\n}\n", "}\n};\n");
    assert_eq!(untangle(&scratch).status, 0);
    let changed = chapter.replacen("}\nend", "};\nend", 1);
    assert_eq!(scratch.read("a.nw"), changed);
}

#[test]
fn one_of_two_equal_lines_of_two_chunks_is_not_removed() {
    let chapter = "<<a.rs>>=\n{\n<<Inner>>\n}\nend\n@ Prose.\n\
                   <<Inner>>=\n{\n}\n";
    let scratch = project(chapter);
    edit(&scratch, "a.rs", "}\n}\n", "}\n");
    refuses(&scratch, EITHER);
}

#[test]
fn escapes_are_put_back() {
    let edit = (MAIN_RS, "a << b >> c", "a << bb >> c");
    comes_home(&[edit], "a @<< b >> c", "a @<< bb >> c");
    let edit = (MAIN_RS, "    more();", "    @ <<x>> [[y]] @<< @@");
    comes_home(&[edit], "\nmore();", "\n@@ @<<x>> [[y]] @@<< @@");
    let edit = (MAIN_RS, "    more();", "    a << b");
    comes_home(&[edit], "\nmore();", "\na << b");
}

#[test]
fn an_edit_beside_a_use_is_refused() {
    let edit = (MAIN_RS, "let x = 42 + 1", "let y: u8 = 42 + 2");
    is_refused(&[edit], OUTSIDE);
    let edit = (MAIN_RS, "x = 42 + 1", "x = 43 + 1");
    is_refused(&[edit], OUTSIDE);
    is_refused(&[(MAIN_RS, "    let x", "      let x")], OUTSIDE);
}

#[test]
fn lines_that_pair_off_come_home_to_two_chunks() {
    let chapter = "<<a.rs>>=\n<<Inner>>\nb = f(2);\n@ Prose.\n\
                   <<Inner>>=\na = f(1);\n";
    let scratch = project(chapter);
    scratch.write("a.rs", scratch.read("a.rs").replace("f(", "g("));
    assert_eq!(untangle(&scratch).status, 0);
    assert_eq!(scratch.read("a.nw"), chapter.replace("f(", "g("));
    // Lines that have little in common are no pairs.
    let scratch = project(chapter);
    scratch.write("a.rs", "// Inner\nunlike!(p, q)\nend\n");
    refuses(&scratch, OUTSIDE);
}

#[test]
fn a_moved_use_is_refused() {
    let tangled = MAIN
        .replace("        // Count\n", "    // Count\n")
        .replace("        count", "    count");
    let scratch = project(CHAPTER);
    scratch.write(MAIN_RS, &tangled);
    refuses(&scratch, OUTSIDE);
}

#[test]
fn a_chunk_of_two_files_is_changed_in_both() {
    let one = (MAIN_RS, "// Two", "// Three");
    let other = ("src/other.rs", "// Two", "// Three");
    comes_home(&[one, other], "// Two", "// Three");
    let said = "src/other.rs:2:1: error: an edit elsewhere would change \
                this line, too";
    is_refused(&[one], said);
}

#[test]
fn a_chunk_of_two_files_is_not_changed_in_two_ways() {
    let one = (MAIN_RS, "// Two", "// Three");
    let other = ("src/other.rs", "// Two", "// Four");
    let said = ":2:1: error: no change of one chunk gives this line";
    is_refused(&[one, other], said);
    let one = (MAIN_RS, "// Two", "// x\n// Two");
    is_refused(&[one, ("src/other.rs", "// Two", "// y\n// Two")], said);
}

#[test]
fn a_function_is_renamed_in_several_files() {
    let chapter = "<<src/a.rs>>=\nfn old() {}\n<<Use it>>\n@ Prose.\n\
                   <<Use it>>=\nold();\n@ Prose.\n<<src/b.rs>>=\n\
                   x = 1 + old();\n<<Use it>>\n";
    let scratch = project(chapter);
    for file in ["src/a.rs", "src/b.rs"] {
        let text = scratch.read(file).replace("old()", "new_name()");
        scratch.write(file, text);
    }
    untangle(&scratch).succeeded();
    let renamed = chapter.replace("old()", "new_name()");
    assert_eq!(scratch.read("a.nw"), renamed);
}

#[test]
fn tabs_of_a_makefile_come_home() {
    let edit = ("src/Makefile", "\techo a\n", "\techo a\tc\n\techo d\n");
    comes_home(&[edit], "\necho a\n", "\necho a\tc\necho d\n");
}

#[test]
fn an_insertion_where_two_chunks_meet_is_refused() {
    let edit = (MAIN_RS, "    let x", "    x();\n    let x");
    let said = "src/main.rs:15:1: error: this edit may belong to either \
                of two places\n  help: it concerns a.nw:19, a.nw:7\n";
    is_refused(&[edit], said);
    // And where two definitions of one chunk meet.
    let edit = (MAIN_RS, "    more();", "    x();\n    more();");
    is_refused(&[edit], "it concerns a.nw:15, a.nw:18\n");
    // Although the indentation would decide.
    let edit = (MAIN_RS, "count_again();", "count_again();\n    x();");
    is_refused(&[edit], OUTSIDE);
}

#[test]
fn a_replacement_that_spans_two_chunks_is_refused() {
    let old = "    last();\n    let x = 42 + 1;\n";
    let edit = (MAIN_RS, old, "    unlike!(a, b);\n    p;\n    q;\n");
    is_refused(
        &[edit],
        "src/main.rs:14:1: error: this edit is not in the text of one \
         chunk\n  help: it concerns a.nw:19, a.nw:7\n",
    );
}

#[test]
fn an_edit_of_a_chunks_name_is_refused() {
    let said = "src/main.rs:8:1: error: this edit is not in the text of \
                one chunk\n  help: it concerns a.nw:14\n";
    let edit = (MAIN_RS, "// Count", "// Count all");
    is_refused(&[edit], said);
    let edit = (MAIN_RS, "        // Count\n", "");
    is_refused(&[edit], OUTSIDE);
}

#[test]
fn a_line_that_is_indented_too_little_is_refused() {
    is_refused(&[(MAIN_RS, "    more();", "  more();")], OUTSIDE);
}

#[test]
fn a_tab_comes_home_to_any_file() {
    let edit = (MAIN_RS, "    more();", "    more();\t// x");
    comes_home(&[edit], "\nmore();", "\nmore();\t// x");
}

#[test]
fn an_emptied_chunk_is_refused() {
    // Its use would leave a blank line.
    let edit =
        (MAIN_RS, "        count();\n\n        count_again();\n", "");
    let said = "src/main.rs:9:1: error: no change of one chunk gives";
    is_refused(&[edit], said);
}

#[test]
fn an_error_in_a_chapter_comes_first() {
    let scratch = project(CHAPTER);
    edit(&scratch, MAIN_RS, "more();", "much_more();");
    edit(&scratch, "a.nw", "    <<Count>>", "    <<Cuont>>");
    refuses(&scratch, "a.nw:14:5: error: undefined chunk name: <<Cuont>>");
}

#[test]
fn a_changed_chapter_does_not_merge_with_an_edit() {
    let scratch = project(CHAPTER);
    edit(&scratch, MAIN_RS, "more();", "much_more();");
    edit(&scratch, "a.nw", "    end();", "    stop();\n    end();");
    let said = "src/main.rs:13:1: error: this file was edited, and so was \
                a chapter of it";
    refuses(&scratch, said);
    // Prose changes no file, and one change undone leaves the other.
    edit(&scratch, "a.nw", "    stop();\n    end();", "    end();");
    edit(&scratch, "a.nw", "Prose between.", "Prose of more.");
    untangle(&scratch).succeeded();
    assert!(scratch.read("a.nw").contains("\nmuch_more();\n"));
}

#[test]
fn an_edit_that_is_in_the_chapter_already_is_no_edit() {
    let scratch = project(CHAPTER);
    edit(&scratch, MAIN_RS, "last();\n", "last();\n    ambiguous();\n");
    refuses(&scratch, EITHER);
    edit(&scratch, "a.nw", "last();\n", "last();\nambiguous();\n");
    untangle(&scratch).succeeded();
    assert_eq!(scratch.read("a.nw").matches("ambiguous").count(), 1);
}

#[test]
fn an_edited_file_without_a_chunk_is_refused() {
    let scratch = project(CHAPTER);
    edit(&scratch, "src/other.rs", "other();", "mine();");
    edit(&scratch, "a.nw", "<<src/other.rs>>=", "<<src/another.rs>>=");
    refuses(&scratch, "no chunk defines src/other.rs, an edited file");
}

#[test]
fn a_file_without_its_last_newline_is_as_if_it_had_it() {
    let scratch = project(CHAPTER);
    let text = scratch.read("src/other.rs").replace("other();\n", "o();");
    scratch.write("src/other.rs", text);
    assert_eq!(untangle(&scratch).status, 0);
    assert!(scratch.read("src/other.rs").ends_with("o();\n"));
    assert!(scratch.read("a.nw").contains("\no();\n@\n"));
}

#[test]
fn a_deleted_file_is_no_edit() {
    let scratch = project(CHAPTER);
    fs::remove_file(scratch.path().join("src/other.rs")).expect("removal");
    let outcome = untangle(&scratch);
    assert_eq!((outcome.status, outcome.stdout()), (0, String::new()));
    assert_eq!(scratch.read("a.nw"), CHAPTER);
}

#[test]
fn files_that_are_elsewhere_are_missed() {
    let scratch = project(CHAPTER);
    fs::create_dir(scratch.path().join("b")).expect("a directory");
    let outcome = run(&scratch.path().join("b"), &["untangle", "../a.nw"]);
    let said = "error: no file of the program is here, as src/main.rs\n";
    assert_eq!((outcome.status, outcome.stderr()), (1, said.into()));
}

#[test]
fn a_file_without_a_byte_is_no_edit_and_is_tangled_anew() {
    let scratch = project(CHAPTER);
    let other = scratch.read("src/other.rs");
    scratch.write("src/other.rs", "");
    assert_eq!(untangle(&scratch).status, 0);
    let outcome = run(scratch.path(), &["tangle", "a.nw"]);
    assert_eq!((outcome.stderr(), outcome.status), (String::new(), 0));
    assert_eq!(scratch.read("src/other.rs"), other);
    scratch.write("src/other.rs", "");
    let main =
        scratch.read("src/main.rs").replace("hello();", "good_day();");
    scratch.write("src/main.rs", &main);
    let outcome = untangle(&scratch);
    assert_eq!((outcome.stderr(), outcome.status), (String::new(), 0));
    assert!(scratch.read("a.nw").contains("\nother();\n"));
    assert!(scratch.read("a.nw").contains("\ngood_day();\n"));
    assert_eq!(scratch.read("src/other.rs"), other);
}

#[test]
fn wrong_usage_of_untangle_has_status_2() {
    let scratch = project(CHAPTER);
    for args in [&["untangle"][..], &["untangle", "--nope", "a.nw"]] {
        assert_eq!(run(scratch.path(), args).status, 2, "{args:?}");
    }
}

// A web for random edits: chunks of definitions of lines. A line is text,
// as it is to be tangled, or the source of a line with a use.
#[derive(Clone, Debug, PartialEq)]
enum Line {
    Text(String),
    /// A use with its line to itself.
    Alone(String),
    /// A use in the middle of a line, with text on both sides.
    Inline(String),
}

type Model = Vec<Vec<Vec<Line>>>;

const COUNT: usize = 5;

/// What surrounds the number of a line in its text.
const FORMS: [(&str, &str); 14] = [
    ("", ";"),
    ("", " << 1;"),
    ("", " << 1 >> 2;"),
    ("<<", ">>"),
    ("<<", ">>="),
    ("@ ", ""),
    ("@@ ", "@<<"),
    ("@", " >>"),
    ("@<<", ">> @>>"),
    ("@ %def ", ""),
    ("  ", "// [[<<"),
    ("    ", "// ]] \u{e9}"),
    ("      ", ""),
    ("\t", "\t;"),
];

/// The text of a line; tabs only if they are kept.
fn text(form: Index, number: usize, tabs: bool) -> String {
    let forms = if tabs { FORMS.len() } else { FORMS.len() - 1 };
    let (before, after) = FORMS[form.index(forms)];
    format!("{before}w{number}{after}")
}

/// For each chunk the forms of its lines, for each but the first where
/// and how it is used.
type Seeds =
    (Vec<Vec<Vec<Option<Index>>>>, Vec<(Index, Index, Index, u8)>, bool);

fn seeds() -> impl Strategy<Value = Seeds> {
    let line = prop::option::weighted(0.85, any::<Index>());
    let definition = prop::collection::vec(line, 1..6);
    let definitions = prop::collection::vec(definition, 1..4);
    let used =
        (any::<Index>(), any::<Index>(), any::<Index>(), any::<u8>());
    (
        prop::collection::vec(definitions, COUNT),
        prop::collection::vec(used, COUNT + 1),
        any::<bool>(),
    )
}

fn model((chunks, uses, tabs): &Seeds) -> Model {
    let mut number = 0;
    let mut line = |form: &Option<Index>| {
        number += 1;
        let text = form.map(|form| text(form, number, *tabs));
        Line::Text(text.unwrap_or_default())
    };
    let mut model: Model = chunks
        .iter()
        .map(|chunk| {
            let lines = |d: &Vec<_>| d.iter().map(&mut line).collect();
            chunk.iter().map(lines).collect()
        })
        .collect();
    // A blank line at the end of a chunk is one with what follows it.
    let blank = Line::Text(String::new());
    for chunk in &mut model {
        let last = chunk.last_mut().and_then(|lines| lines.last_mut());
        if let Some(line) = last.filter(|line| **line == blank) {
            *line = Line::Text("end".into());
        }
        // And one at its beginning is indented.
        if let Some(line) = chunk[0].first_mut().filter(|l| **l == blank) {
            *line = Line::Text("begin".into());
        }
    }
    // The last chunk is used twice.
    for (k, (user, at, line, how)) in uses.iter().enumerate() {
        let chunk = (k + 1).min(COUNT - 1);
        if k + 1 > COUNT - 1 && how % 2 == 0 {
            continue;
        }
        let user = user.index(chunk);
        let inline = matches!(&model[user][0][0], Line::Text(t)
            if t.starts_with('v'));
        let user = if inline { 0 } else { user };
        if k + 1 < COUNT && how % 4 == 0 && k + 2 < COUNT {
            model[chunk] = vec![vec![Line::Text(format!("v{k}"))]];
            let used = format!("a{k} = <<{}>> + b{k};", name(chunk));
            put(&mut model[user], at, line, Line::Inline(used));
        } else {
            let blank = match tabs {
                true => ["", "\t"][*how as usize / 128],
                false => ["", "  ", "    ", "       "][*how as usize / 64],
            };
            let used = format!("{blank}<<{}>>", name(chunk));
            put(&mut model[user], at, line, Line::Alone(used));
        }
    }
    model
}

/// Puts a use into a chunk.
fn put(chunk: &mut [Vec<Line>], at: &Index, line: &Index, used: Line) {
    let definition = &mut chunk[at.index(chunk.len())];
    definition.insert(line.index(definition.len() + 1), used);
}

fn name(chunk: usize) -> String {
    format!("Chunk {chunk}")
}

/// The first chunk is in the body of a function, where names are comments.
fn chapter(model: &Model, tabs: bool) -> String {
    let blank = if tabs { "\t" } else { "  " };
    let used = format!("fn f() {{\n{blank}<<{}>>\n}}\n", name(0));
    let mut text = String::from("Prose [[code <<x>>]].\n");
    text += &format!("<<{MAIN_RS}>>=\n{used}@ Prose.\n");
    for turn in 0..3 {
        for (number, definitions) in model.iter().enumerate() {
            let Some(lines) = definitions.get(turn) else { continue };
            text += &format!("<<{}>>=\n", name(number));
            for line in lines {
                text += &source(line);
                text.push('\n');
            }
            text += "@ More prose. @@\n";
        }
    }
    text
}

fn source(line: &Line) -> String {
    match line {
        Line::Alone(source) | Line::Inline(source) => source.clone(),
        Line::Text(text) => {
            let text = text.replace("<<", "@<<");
            if text.starts_with('@') && !text.starts_with("@<<")
                || text.starts_with("@@<<")
            {
                format!("@{text}")
            } else {
                text
            }
        }
    }
}

/// The lines of a chapter that are not code.
fn prose(chapter: &str) -> Vec<&str> {
    let mut code = false;
    let outside = chapter.lines().filter(|line| {
        let defines = line.starts_with("<<") && line.ends_with(">>=");
        code = (code || defines) && !line.starts_with("@ ");
        defines || !code
    });
    outside.collect()
}

type Edit = (Index, Index, Index, u8, Index);

/// Makes one edit inside a chunk; tells whether it could be made.
fn make(model: &mut Model, edit: &Edit, number: usize, tabs: bool) -> bool {
    let (chunk, definition, line, kind, form) = edit;
    let chunk = &mut model[chunk.index(COUNT)];
    let single = chunk.len() == 1 && chunk[0].len() == 1;
    let count = chunk.len();
    let lines = &mut chunk[definition.index(count)];
    let line = line.index(lines.len());
    let several = lines.len() > 1;
    let fresh = text(*form, number, tabs);
    match (kind % 4, &mut lines[line]) {
        (0, _) => {
            let above = line.checked_sub(1).map(|l| &lines[l]);
            if !matches!(above, Some(Line::Text(_) | Line::Inline(_))) {
                return false;
            }
            lines.insert(line, Line::Text(fresh));
        }
        (1, Line::Text(text)) if several && !text.is_empty() => {
            lines.remove(line);
        }
        (2, Line::Text(text)) if !single && !text.is_empty() => {
            *text = fresh;
        }
        (3, Line::Text(text)) if !single && !text.is_empty() => {
            text.push_str(" << changed >>");
        }
        _ => return false,
    }
    true
}

/// A chapter without escapes and blank lines, which may slide.
fn plain(chapter: &str) -> Vec<String> {
    let lines = chapter.lines().filter(|line| !line.trim().is_empty());
    let plain = lines.map(|line| {
        let line = if line.starts_with("@@") { &line[1..] } else { line };
        line.replace("@<<", "<<").replace("@>>", ">>")
    });
    plain.collect()
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        max_global_rejects: 100_000,
        rng_seed: RngSeed::Fixed(20_261_122),
        ..ProptestConfig::with_cases(400)
    })]

    #[test]
    fn an_edit_inside_a_chunk_comes_home(
        seeds in seeds(),
        edit in any::<Edit>(),
    ) {
        let (before, after) = edited(&seeds, &[edit]);
        prop_assume!(before != after);
        let (result, chapter) = round_trip(&before, &after);
        prop_assert_eq!(result, Ok(()), "{}", before);
        prop_assert_eq!(plain(&chapter), plain(&after), "{}", before);
    }

    #[test]
    fn edits_come_home_together_or_nothing_is_written(
        seeds in seeds(),
        edits in prop::collection::vec(any::<Edit>(), 2..6),
    ) {
        let (before, after) = edited(&seeds, &edits);
        let (result, chapter) = round_trip(&before, &after);
        match result {
            Ok(()) => prop_assert_eq!(prose(&chapter), prose(&before)),
            Err(_) => prop_assert_eq!(chapter, before),
        }
    }
}

fn edited(seeds: &Seeds, edits: &[Edit]) -> (String, String) {
    let mut model = model(seeds);
    let before = chapter(&model, seeds.2);
    for (edit, number) in edits.iter().zip(1000..) {
        make(&mut model, edit, number, seeds.2);
    }
    (before, chapter(&model, seeds.2))
}

/// Tangles a chapter, makes the file what another chapter would give, and
/// untangles: what came of it, and the chapter then.
fn round_trip(before: &str, after: &str) -> (Result<(), String>, String) {
    let scratch = Scratch::new();
    let file = scratch.path().join(MAIN_RS);
    let project = Project {
        dir: scratch.path().to_owned(),
        record: ".tangled".into(),
        ..project::of(vec!["a.nw".into()], String::new())
    };
    scratch.write("a.nw", after);
    project.tangle().expect("the edited chapter");
    let wanted = fs::read(&file).expect("the edited file");
    scratch.write("a.nw", before);
    project.tangle().expect("the chapter");
    let record = scratch.read(".tangled");
    fs::write(&file, &wanted).expect("an edited file");
    let result = noweb::untangle::untangle(&project, false);
    let left = fs::read(&file).expect("the file");
    let [left, wanted] = [left, wanted].map(String::from_utf8);
    assert_eq!(left, wanted, "{before}");
    if result.is_err() {
        assert_eq!(scratch.read(".tangled"), record);
    }
    let message = |faults: Vec<_>| {
        let lines = faults.iter().map(ToString::to_string);
        lines.collect::<String>()
    };
    (result.map(drop).map_err(message), scratch.read("a.nw"))
}
