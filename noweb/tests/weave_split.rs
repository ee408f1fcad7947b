// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The split back end, foreign filters, and what LaTeX makes of names.

use std::fs;
use std::path::Path;
use std::time::{Duration, SystemTime};

use crate::common::{Outcome, Scratch, links, run, shell, skip};

const MASTER: &str = r"\documentclass{article}
\usepackage{noweb}
\begin{document}
\include{one}
\include{two}
% \nowebchunks in a comment, and [[\nowebchunks]] quoted, ask for nothing
\nowebchunks
\nowebindex
\end{document}
";

const ONE: &str = r"Prose that begins
with a sentence.
<<Count the words>>=
let n = count(line);
@ %def n
<<Never used>>=
@
";

const TWO: &str = r"The second chapter continues the first.
<<Count the words>>=
print(n);
@
<<*>>=
<<Count the words>>
<<Print_it & leave>>
@
";

const THREE: &str = r"The third uses it again.
<<Count the words>>=
done();
@
<<Print_it & leave>>=
<<Count the words>>
@
";

fn book() -> Scratch {
    let book = Scratch::new();
    book.write("book.nw", MASTER);
    book.write("chapters/one.nw", ONE);
    book.write("chapters/two.nw", TWO);
    book.write("chapters/three.nw", THREE);
    book
}

fn weave(book: &Scratch) -> Outcome {
    run(
        book.path(),
        &[
            "noweave",
            "-index",
            "-delay",
            "-backend",
            "noweb split_scope -o build/tex",
            "book.nw",
            "chapters/one.nw",
            "chapters/two.nw",
            "chapters/three.nw",
        ],
    )
}

fn piece(book: &Scratch, name: &str) -> String {
    book.read(&format!("build/tex/{name}.tex"))
}

/// The first line of a piece that holds a text.
fn line_with<'a>(piece: &'a str, text: &str) -> &'a str {
    let found = piece.lines().find(|line| line.contains(text));
    found.unwrap_or_else(|| panic!("no {text} in\n{piece}"))
}

#[test]
fn every_piece_keeps_the_references_of_the_whole() {
    let book = book();
    let woven = weave(&book);
    assert_eq!((woven.status, woven.stderr()), (0, String::new()));
    assert!(woven.stdout.is_empty());
    let [one, two, three] =
        ["one", "two", "three"].map(|n| piece(&book, n));
    let head =
        |piece| line_with(piece, r"\moddef{Count the words").to_owned();
    assert!(head(&one).contains(r"\endmoddef"), "{one}");
    assert!(head(&two).contains(r"\plusendmoddef"), "{two}");
    assert!(head(&three).contains(r"\plusendmoddef"), "{three}");
    let also = line_with(&one, r"\nwalsodefined{");
    assert_eq!(also.matches(r"\\{NW").count(), 4, "{also}");
    for piece in [&one, &two, &three] {
        let used = line_with(piece, r"\nwused{");
        let users = &used[used.find(r"\nwused{").unwrap()..];
        let users = &users[..users.find("}}").unwrap()];
        assert_eq!(users.matches(r"\\{NW").count(), 2, "{users}");
    }
    let middle = head(&two);
    assert!(!middle.contains(r"\relax"), "{middle}");
    assert!(two.contains(r"\nwlinkedidentc{n}{NW"), "{two}");
}

#[test]
fn the_lists_stand_before_the_line_that_asks_for_them() {
    let book = book();
    weave(&book);
    let master = piece(&book, "book");
    let lines: Vec<&str> = master.lines().collect();
    let asked = lines.iter().position(|line| *line == r"\nowebchunks");
    let entries = lines.iter().filter(|l| l.starts_with(r"\nwixlogsorted"));
    assert_eq!(entries.count(), 5, "{master}");
    let last = lines[asked.expect("the request") - 1];
    assert!(last.starts_with(r"\nwixlogsorted{i}"), "{master}");
    assert!(lines[0].starts_with(r"\documentclass"), "{master}");
    for name in ["one", "two", "three"] {
        assert!(!piece(&book, name).contains(r"\nwixlogsorted"));
    }
}

#[test]
fn the_lists_stay_in_the_last_piece_if_nobody_asks() {
    let book = book();
    book.write("book.nw", MASTER.replace(r"\noweb", r"% \noweb"));
    weave(&book);
    assert!(!piece(&book, "book").contains(r"\nwixlogsorted"));
    assert!(piece(&book, "three").contains(r"\nwixlogsorted"));
}

#[test]
fn lines_of_a_piece_are_the_lines_of_its_source() {
    let book = book();
    weave(&book);
    for (name, source) in [("one", ONE), ("two", TWO), ("three", THREE)] {
        let piece = piece(&book, name);
        assert_eq!(piece.lines().count(), source.lines().count() + 1);
        let code = ["done();", "print(", "with a sentence."];
        for text in code.iter().filter(|text| source.contains(**text)) {
            let at = |text: &str, all: &str| {
                all.lines().position(|line| line.contains(text))
            };
            assert_eq!(at(text, &piece), at(text, source), "{piece}");
        }
    }
}

#[test]
fn the_comment_does_not_glue_the_first_line_to_the_second() {
    let book = book();
    weave(&book);
    let one = piece(&book, "one");
    let first = one.lines().next().expect("a line");
    assert!(first.starts_with("Prose that begins % "), "{first}");
    assert!(first.contains("chapters/one.nw"), "{first}");
}

/// Makes all pieces an hour old; tells later which are still that old.
fn age(book: &Scratch) {
    let old = SystemTime::now() - Duration::from_secs(3600);
    for entry in fs::read_dir(book.path().join("build/tex")).unwrap() {
        let path = entry.unwrap().path();
        let file = fs::File::options().write(true).open(path).unwrap();
        file.set_modified(old).unwrap();
    }
}

fn rewritten(book: &Scratch) -> Vec<String> {
    let mut names = Vec::new();
    for entry in fs::read_dir(book.path().join("build/tex")).unwrap() {
        let entry = entry.unwrap();
        let time = entry.metadata().unwrap().modified().unwrap();
        if time.elapsed().unwrap() < Duration::from_secs(1800) {
            names.push(entry.file_name().into_string().unwrap());
        }
    }
    names.sort();
    names
}

#[test]
fn only_pieces_that_change_are_written_again() {
    let book = book();
    weave(&book);
    age(&book);
    weave(&book);
    assert_eq!(rewritten(&book), Vec::<String>::new());
    book.write("chapters/two.nw", TWO.replace("second", "other"));
    weave(&book);
    assert_eq!(rewritten(&book), ["two.tex"]);
    age(&book);
    let more = format!("{THREE}<<Count the words>>=\nagain();\n@\n");
    book.write("chapters/three.nw", more);
    weave(&book);
    // The list of chunks, the list at the first definition, and itself.
    assert_eq!(rewritten(&book), ["book.tex", "one.tex", "three.tex"]);
}

#[test]
fn two_sources_with_one_name_are_refused() {
    let book = book();
    book.write("appendix/one.nw", ONE);
    let args =
        ["noweave", "-delay", "-x", "-backend", "split_scope -o out"];
    let files = ["chapters/one.nw", "appendix/one.nw"];
    let woven = run(book.path(), &[&args[..], &files].concat());
    assert_eq!(woven.status, 1);
    let both = ["chapters/one.nw", "appendix/one.nw", "one.tex"];
    assert!(both.iter().all(|name| woven.stderr().contains(name)));
    assert!(!book.path().join("out").exists());
}

#[test]
fn nothing_is_written_if_a_chapter_cannot_be_read() {
    let book = book();
    weave(&book);
    age(&book);
    book.write("chapters/one.nw", "Entirely new, with <<brackets.\n");
    weave(&book).failed("chapters/one.nw:1:20");
    assert_eq!(rewritten(&book), Vec::<String>::new());
}

#[test]
fn a_directory_that_cannot_be_made_is_named() {
    let book = book();
    book.write("build", "a file in the way");
    weave(&book).failed("build/tex");
}

#[test]
fn a_directory_option_without_a_directory_is_wrong_usage() {
    let scratch = Scratch::new();
    let split = run(scratch.path(), &["split_scope", "-delay", "-o"]);
    assert_eq!(split.status, 2);
    assert!(split.stderr().contains("-o needs a directory"));
}

#[test]
fn a_filter_in_awk_changes_what_is_woven() {
    let book = book();
    let filter = r#"/^@use / { print "@text (use)" } { print }"#;
    book.write("mark.awk", filter);
    let args = ["noweave", "-n", "-x", "-filter", "awk -f mark.awk"];
    let woven =
        run(book.path(), &[&args[..], &["chapters/two.nw"]].concat())
            .succeeded();
    let text = woven.stdout();
    assert_eq!(text.matches(r"(use)\LA{}").count(), 2, "{text}");
}

#[test]
fn file_names_with_spaces_and_quotes_are_woven() {
    let book = book();
    book.write("it's a chapter.nw", ONE);
    let inside = run(book.path(), &["noweave", "-n", "it's a chapter.nw"])
        .succeeded();
    assert!(inside.stdout().contains("chapter.nw"));
}

/// A document in which every special character stands in names.
const SPECIAL: &str = r"\documentclass{article}
\usepackage{noweb}
\begin{document}
See [[a_b]] and [[{x} \y $z &w #v %u ^t ~s]].
<<src/ray_kernel.rs>>=
<<Take 100% of #1 & $2>>
<<Write {a^b} ~ \c_d>>
<<Call [[f_1(&x, #y, {z})]] and [[a[i]]]>>
@ %def a_b x#y p&q %u $z ^t ~s \y {x}
<<Take 100% of #1 & $2>>=
a_b x#y p&q %u $z ^t ~s \y {x}
@
<<Write {a^b} ~ \c_d>>=
@
<<Call [[f_1(&x, #y, {z})]] and [[a[i]]]>>=
@
<<Unused_one>>=
@
\nowebchunks
\nowebindex
\end{document}
";

#[test]
fn latex_takes_every_special_character_in_a_name() {
    let style = concat!(env!("CARGO_MANIFEST_DIR"), "/../doc/litpt.sty");
    let has_latex = has("pdflatex", "--version");
    let noweb_sty = "/usr/share/texmf/tex/latex/noweb/noweb.sty";
    let mut styles = Vec::new();
    if has("kpsewhich", "noweb.sty") || Path::new(noweb_sty).exists() {
        styles.push(SPECIAL.to_owned());
    }
    if Path::new(style).exists() {
        let document = SPECIAL.replace("{noweb}", "{litpt}");
        styles.push(document.replace("{article}", "{memoir}"));
    }
    if !has_latex || styles.len() < 2 {
        skip("LaTeX, or the style of noweb or litpt, is not installed");
    }
    for document in styles.iter().filter(|_| has_latex) {
        let book = Scratch::new();
        book.write("a_b.nw", document);
        let doc = Path::new(style).parent().expect("a directory");
        let latex = format!(
            "noweave -index -delay a_b.nw >a.tex && \
             TEXINPUTS={0}: TEXFONTS={0}: pdflatex -interaction=batchmode \
             -halt-on-error a.tex && \
             TEXINPUTS={0}: TEXFONTS={0}: pdflatex -interaction=batchmode \
             -halt-on-error a.tex",
            doc.display(),
        );
        let made = shell(&latex, book.path(), links().path());
        let log = fs::read(book.path().join("a.log")).unwrap_or_default();
        let log = String::from_utf8_lossy(&log).into_owned();
        assert_eq!(made.status, 0, "{}\n{log}", made.stderr());
    }
}

/// Whether a program is there and succeeds with an argument.
fn has(program: &str, argument: &str) -> bool {
    let output = std::process::Command::new(program).arg(argument).output();
    output.is_ok_and(|output| output.status.success())
}
