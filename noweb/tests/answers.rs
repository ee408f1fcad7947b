// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The answers to the exercises of the book on the tool. What an answer
//! claims is an assertion.

use std::ffi::OsString;
use std::fs;
use std::path::Path;
use std::process::Command;

// Use the library of the tool
use noweb::Streams;
use noweb::diagnostic::Source;
use noweb::finduses::{Recogniser, declared, mark_uses};
use noweb::locate::Atlas;
use noweb::markup::{mark_up, write_stream};
use noweb::noidx::cross_reference;
use noweb::project::Project;
use noweb::rust_index::index;
use noweb::stream::{self, crc};
use noweb::tangle::{Layout, Segment, Tangled, tangle};
use noweb::totex::{Memory, Options, to_tex};
use noweb::web::{Chunk, Piece, Web};

// Help to ask short questions
fn read(web: &str) -> Web {
    let source = Source::new(b"a.nw".to_vec(), web.into());
    Web::read(vec![source], 8).0
}

fn tangled(web: &Web, root: &str, names: bool) -> Tangled {
    let layout = Layout { rust: names, ..Layout::default() };
    tangle(web, &[root.as_bytes()], &layout).unwrap()
}

fn stream_of(web: &str) -> String {
    let source = Source::new(b"a.nw".to_vec(), web.into());
    let stream = write_stream(&mark_up(&source, 0, 8).0);
    String::from_utf8(stream).unwrap()
}

fn chapter(name: &str) -> String {
    let book = Path::new(env!("CARGO_MANIFEST_DIR")).join("chapters");
    fs::read_to_string(book.join(name).with_extension("nw")).unwrap()
}

/// A project with one chapter, in an empty directory.
fn project(name: &str, web: &str) -> Project {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&dir);
    fs::create_dir_all(&dir).unwrap();
    fs::write(dir.join("a.nw"), web).unwrap();
    let (record, chapters) = (".tangled".into(), vec!["a.nw".into()]);
    Project { dir, record, chapters }
}

// Answer about writing a web
const LIST: &str = "\
<<src/list.rs>>=
fn paint_all() {
    <<List the colours>>
}
<<List the colours>>=
paint(\"red\");
<<Say nothing>>=
@ Green comes later.
<<List the colours>>=
paint(\"green\");
paint(\"blue\");
";

#[test]
fn a_list_is_joined_and_a_chunk_is_lost() {
    let web = read(LIST);
    let file = tangled(&web, "src/list.rs", true);
    let expected = "fn paint_all() {\n    \
        // List the colours\n    paint(\"red\");\n    \
        paint(\"green\");\n    paint(\"blue\");\n}\n";
    assert_eq!(String::from_utf8(file.text).unwrap(), expected);
    let unused = web.unused(noweb::project::is_file_name);
    assert_eq!(unused.len(), 1);
    assert!(unused[0].text.contains("Say nothing"));
}

#[test]
fn a_pair_that_is_closed_on_its_line_needs_an_escape() {
    let lines = [
        ("a << 2", false),
        ("a << 2 >> b", true),
        ("Vec<Vec<u8>>", false),
        ("Vec<Vec<<T as Iterator>::Item>>", true),
        ("a >> 1 << b", false),
        ("let open = \"<<\"; // >>", true),
        ("Vec<Vec@@<<T as Iterator>::Item>>", false),
    ];
    for (line, needs) in lines {
        let web = read(&format!("<<*>>=\n{line}\n"));
        assert_eq!(!web.uses.is_empty(), needs, "{line}");
    }
}

#[test]
fn only_what_changes_the_text_writes_the_file() {
    // Change the list in four ways
    let renamed = LIST.replace("List the colours", "Name the colours");
    let (head, green) = LIST.split_at(LIST.rfind("<<List").unwrap());
    let red = head.find("<<List the colours>>=").unwrap();
    let (root, red) = head.split_at(red);
    let changes = [
        (LIST.replace("later", "soon"), false),
        (format!("Three colours.\n{LIST}"), false),
        (renamed, true),
        ([root, green, red].concat(), true),
    ];
    for (web, written) in changes {
        let project = project("write", LIST);
        project.tangle().unwrap();
        fs::write(project.dir.join("a.nw"), web).unwrap();
        let plan = project.plan().unwrap();
        assert_eq!(plan.outputs[0].changed, written);
    }
}

// Answer about reading a web
const STREAM: &str = "\
@file a.nw
@begin docs 0
@text The\x20
@quote
@text b[i]
@endquote
@text  of [[.
@nl
@end docs 0
@begin code 1
@defn Do it
@nl
@text x <<\x20
@use n
@text\x20
@nl
@index defn x
@index nl
@end code 1
@begin docs 2
@text End.
@nl
@end docs 2
";

#[test]
fn four_lines_become_a_stream() {
    let web = "The [[b[i]]] of @[[.\n<<Do it>>=\n\
        x @<< <<n>>\n@ %def x\nEnd.\n";
    assert_eq!(stream_of(web), STREAM);
    assert_eq!(STREAM.lines().count(), 23);
}

#[test]
fn one_place_has_three_columns() {
    let use_of_q = "<<*>>=\n\u{e9}\tb + <<Q>>\n";
    let web = read(use_of_q);
    let layout = Layout::default();
    let faults = tangle(&web, &[b"*"], &layout).unwrap_err();
    assert!(faults[0].to_string().starts_with("a.nw:2:7: error"));
    assert_eq!(web.uses[&b"Q"[..]].column, 8);
    // Indent the second line of a chunk Q
    let web = read(&format!("{use_of_q}<<Q>>=\n1\n2\n"));
    let text = tangled(&web, "*", false).text;
    let last = text.split(|b| *b == b'\n').nth(1).unwrap();
    assert_eq!(last, [&[b' '; 12][..], b"2"].concat());
}

#[test]
fn a_swap_of_two_letters_is_seldom_mistaken() {
    let web = read(&chapter("markup"));
    let (mut slips, mut mistaken) = (0, Vec::new());
    for Chunk { name, .. } in &web.chunks {
        for at in 1..name.len() {
            let mut slip = name.clone();
            slip.swap(at - 1, at);
            slips += usize::from(slip != *name);
            if slip != *name
                && web.nearest(&slip).map(|c| &c.name) != Some(name)
            {
                mistaken.push(String::from_utf8(slip).unwrap());
            }
        }
    }
    assert!(slips > 1000);
    assert_eq!(mistaken, ["noweb/src/ewb.rs"]);
}

// Answer about tangling a web
#[test]
fn five_lines_are_tangled_and_traced() {
    let web = read(
        "<<*>>=\nf(<<p>>, <<q>>)\n<<p>>=\n1,\n\n2\n\
        <<q>>=\n3,\n4,\n\n",
    );
    let tangled = tangled(&web, "*", false);
    let expected = "f(1,\n\n  2, 3,\n         4,\n)\n";
    assert_eq!(String::from_utf8_lossy(&tangled.text), expected);
    // Trace four places of the five lines
    let from = |line, column| {
        let place = tangled.origin(line, column).unwrap();
        (place.line, place.column)
    };
    assert_eq!([from(4, 10), from(4, 9)], [(9, 1), (9, 1)]);
    assert_eq!([from(3, 4), from(5, 1)], [(2, 8), (2, 15)]);
}

#[test]
fn without_a_record_what_differs_is_refused() {
    let project = project("record", LIST);
    project.tangle().unwrap();
    let forget = || fs::remove_file(project.dir.join(".tangled")).unwrap();
    forget();
    assert!(!project.tangle().unwrap().outputs[0].changed);
    forget();
    // Change the chapter after the record is lost
    let rose = LIST.replace("red", "rose");
    fs::write(project.dir.join("a.nw"), rose).unwrap();
    let faults = project.tangle().unwrap_err();
    assert!(faults[0].text.contains("edited by hand"));
    fs::remove_file(project.dir.join("src/list.rs")).unwrap();
    assert!(project.tangle().unwrap().outputs[0].changed);
}

#[test]
fn the_map_outgrows_the_text() {
    let mut web = String::from("<<c1>>=\nx\n");
    for n in 2..=16 {
        let m = n - 1;
        web += &format!("<<c{n}>>=\n<<c{m}>><<c{m}>>\n");
        let tangled = tangled(&read(&web), &format!("c{n}"), false);
        assert_eq!(tangled.text.len(), (1 << m) + 1);
        assert_eq!(tangled.map.len(), 1 << m);
    }
    assert_eq!(size_of::<Segment>(), 24);
}

// Answer about positions
#[test]
fn a_line_of_three_portions_has_three_places() {
    let project = project("stretches", LIST);
    project.tangle().unwrap();
    let atlas = Atlas::read(&[project]);
    let file = atlas.find(b"src/list.rs").unwrap().1;
    let line = |n| atlas.origin(file, n, 5).unwrap().line;
    assert_eq!([1, 2, 3, 4, 5, 6].map(line), [2, 3, 6, 10, 11, 4]);
}

#[test]
fn a_file_is_stale_if_its_text_would_be_another() {
    let project = project("stale", LIST);
    project.tangle().unwrap();
    let longer = format!("Three colours.\n{LIST}");
    let rose = LIST.replace("red", "rose");
    for (web, fresh) in [(rose, false), (longer, true)] {
        fs::write(project.dir.join("a.nw"), web).unwrap();
        let atlas = Atlas::read(std::slice::from_ref(&project));
        let file = atlas.find(b"src/list.rs").unwrap().1;
        assert_eq!(file.fresh, fresh);
    }
}

// Answer about carrying edits home

#[test]
fn an_edit_meets_a_change_of_the_chapter() {
    for (from, to, carried) in [
        ("red", "rose", false),
        ("green", "lime", true),
        ("paint_all", "draw", false),
        ("<<List the colours>>=", "@ Hear.\n<<List the colours>>=", true),
    ] {
        let project = project("merge", LIST);
        project.tangle().unwrap();
        let web = LIST.replacen(from, to, 1);
        // Edit the file and the chapter
        let file = project.dir.join("src/list.rs");
        let text = fs::read_to_string(&file).unwrap();
        fs::write(&file, text.replace("green", "lime")).unwrap();
        let chapter = project.dir.join("a.nw");
        fs::write(&chapter, &web).unwrap();
        assert_eq!(project.untangle(false).is_ok(), carried, "{to}");
        let text = fs::read_to_string(&chapter).unwrap();
        let home = web.replace("green", "lime");
        assert_eq!(text, if carried { home } else { web });
    }
}

#[test]
fn a_new_line_has_one_home_or_none() {
    for (above, line, change) in [
        (3, "    paint(\"black\");", Some("a.nw:6: -0 +1 lines")),
        (4, "    paint(\"black\");", None),
        (5, "    paint(\"black\");", Some("a.nw:11: -0 +1 lines")),
        (6, "    paint(\"black\");", None),
        (6, "// done", None),
    ] {
        let project = project("homes", LIST);
        project.tangle().unwrap();
        let file = project.dir.join("src/list.rs");
        let text = fs::read_to_string(&file).unwrap();
        let mut lines: Vec<&str> = text.lines().collect();
        lines.insert(above - 1, line);
        fs::write(&file, lines.join("\n") + "\n").unwrap();
        let changes = project.untangle(true).ok();
        let expected = change.map(|change| vec![change.to_owned()]);
        assert_eq!(changes, expected, "above {above}");
    }
}

// Answer about resolving references
#[test]
fn seven_uses_are_whole() {
    let text = "@begin code 1\n@text a->x::new(x', &x, max, .x)\n";
    let words = ["::", "new", "x", "->", ".x"].map(str::as_bytes);
    let words = Recogniser::new(words.into_iter());
    let marked = mark_uses(text.as_bytes(), &words, true);
    let marked = String::from_utf8(marked).unwrap();
    let uses = marked.lines().filter_map(|l| l.strip_prefix("@index use "));
    let uses: Vec<_> = uses.collect();
    assert_eq!(uses, ["->", "x", "::", "new", "x", "x", ".x"]);
}

#[test]
fn codes_are_linear() {
    let [x, y] = [&b"Step 0417"[..], b"Stop 1992"];
    let sum: Vec<u8> = x.iter().zip(y).map(|(a, b)| a ^ b).collect();
    assert_eq!(crc(x) ^ crc(y), crc(&sum));
    let half = (2f64.powi(33) * 2f64.ln()).sqrt();
    assert!((half - 77_000.).abs() < 500.);
}

#[test]
fn codes_of_neighbouring_numbers_never_collide() {
    let top = |byte: u8| (crc(&[byte]) >> 24) as u8;
    let mut tops: Vec<u8> = (0..=255).map(top).collect();
    tops.sort();
    assert!(tops.into_iter().eq(0..=255));
    // Compare the codes of all steps
    let names = (0..10_000).map(|n| format!("Step {n:04}"));
    let mut codes: Vec<u32> = names.map(|n| crc(n.as_bytes())).collect();
    codes.sort();
    codes.dedup();
    assert_eq!(codes.len(), 10_000);
}

/// The stream without what `noidx` has added.
fn strip(resolved: &[u8]) -> Vec<u8> {
    let mut out: Vec<u8> = Vec::new();
    let mut inside = false;
    for line in stream::lines(resolved) {
        let begins = |mark: &str| line.starts_with(mark.as_bytes());
        inside = begins("@begin ") || inside && !begins("@end ");
        let marks = ["defn ", "localdefn ", "use ", "nl"];
        let index = marks.iter().any(|m| begins(&format!("@index {m}")));
        let astray = line == b"@nl" && !inside;
        if begins("@xref") || begins("@index") && !index || astray {
            continue;
        }
        out.extend([line, b"\n"].concat());
    }
    out
}

fn with_uses(stream: &[u8]) -> Vec<u8> {
    let words = Recogniser::new(declared(stream));
    mark_uses(stream, &words, true)
}

#[test]
fn what_references_add_can_be_taken_away() {
    let stream = with_uses(stream_of(&chapter("markup")).as_bytes());
    let resolved = cross_reference(&stream, false).text;
    assert!(strip(&resolved) == stream);
    let count = |stream| stream::lines(stream).count() as f64;
    let added = 1. - count(&stream) / count(&resolved);
    assert!((0.2..0.4).contains(&added), "{added}");
}

// Answer about writing LaTeX
fn tex_of(stream: &[u8]) -> String {
    let options = Options { index: true, ..Options::default() };
    let lines = stream::trimmed_lines(stream);
    let tex = to_tex(lines, &options, &mut Memory::default());
    String::from_utf8(tex.text).unwrap()
}

#[test]
fn a_name_and_a_line_are_escaped_differently() {
    let text = "Pay $5_{max}, [[a_b[i]]]";
    let web = format!("<<{text}>>=\n{text}\n");
    let tex = tex_of(stream_of(&web).as_bytes());
    let name = "\\moddef{Pay \\$5\\_\\textbraceleft{}max\\textbraceright{}, \
        \\code{}a{\\_}b[i]\\edoc{}}\\endmoddef";
    assert!(tex.contains(name));
    assert!(tex.contains("\nPay $5_\\{max\\}, [[a_b[i]]]\n"));
}

/// The stream without the definitions of one chunk.
fn hide(name: &str, stream: &[u8]) -> Vec<u8> {
    let hidden = format!("@defn {name}").into_bytes();
    let (mut out, mut chunk) = (Vec::new(), Vec::new());
    for line in stream::lines(stream) {
        if line.starts_with(b"@begin ") {
            out.append(&mut chunk);
        }
        chunk.push(line);
        if line.starts_with(b"@end ") {
            let kept = !chunk.contains(&&hidden[..]);
            out.extend(chunk.drain(..).filter(|_| kept));
        }
    }
    out.append(&mut chunk);
    out.join(&b'\n')
}

fn resolve(stream: &[u8]) -> Vec<u8> {
    let uses = with_uses(stream);
    cross_reference(&uses, false).text
}

#[test]
fn a_chunk_is_hidden_before_references_are_resolved() {
    let web = "<<*>>=\nprint(add(1, 2));\n<<Add>>\n<<Add>>=\n\
        fn add(a, b) { a + b }\n@ %def add\n";
    let plain = stream_of(web).into_bytes();
    let before = tex_of(&resolve(&hide("Add", &plain)));
    let behind = tex_of(&hide("Add", &resolve(&plain)));
    let code = stream::base62(crc(b"Add").into());
    let label = format!("NW2fBmxt-{code}-1");
    assert!(!behind.contains(&format!("\\sublabel{{{label}}}")));
    assert_eq!(behind.matches(&label).count(), 4);
    assert_eq!(before.matches(&label).count(), 0);
    assert!(before.contains("nw@notdef"));
}

// Answer about the index of Rust

/// How often a Rust file has links to an item.
fn links_to(item: &str, code: &str) -> usize {
    let stream = stream_of(&format!("<<demo/src/lib.rs>>=\n{code}\n"));
    let (out, faults) = index(stream.as_bytes());
    assert!(faults.is_empty(), "{code}");
    let out = String::from_utf8(out).unwrap();
    let mark = format!("@index use demo::{item}");
    out.lines().filter(|line| **line == mark).count()
}

#[test]
fn a_word_is_a_link_where_nothing_in_the_function_has_taken_it() {
    for (function, links) in [
        ("fn a(count: u8) -> u8 { count }", 0),
        ("fn b() -> u8 { let count = count(); count }", 0),
        (
            "fn c(o: Option<u8>) -> u8 {
            if let Some(count) = o { count } else { count() } }",
            0,
        ),
        ("fn d() -> u8 { let f = |count: u8| count; f(1) }", 0),
        ("fn e() -> u8 { (|| count())() }", 1),
        ("fn f() -> u8 { fn count() -> u8 { 2 } count() }", 0),
        (
            "fn g(count: u8) -> u8 {
            fn h() -> u8 { count() } h() + count }",
            0,
        ),
        (
            r#"fn i() -> String {
            format!("{} {}", count(), "count()") }"#,
            1,
        ),
    ] {
        let code = format!("fn count() -> u8 {{ 1 }}\n{function}");
        assert_eq!(links_to("count", &code), links, "{function}");
    }
}

// Answer about commands and filters
#[test]
fn a_sound_stream_is_believed() {
    // Tangle two lines through a filter
    let dir = project("filter", "<<*>>=\none\ntwo\n@\n").dir;
    let tangle = |filter: &str| {
        let tool = env!("CARGO_BIN_EXE_noweb");
        let args = ["notangle", "-filter", filter, "a.nw"];
        let run = Command::new(tool).args(args).current_dir(&dir).output();
        let run = run.unwrap();
        (run.status.code(), String::from_utf8(run.stdout).unwrap())
    };
    assert_eq!(tangle("sed '$d'"), (Some(0), "one\ntwo\n".into()));
    assert_eq!(tangle("head -n 7"), (Some(4), "".into()));
    assert_eq!(tangle("head -n 7; false"), (Some(1), "".into()));
    assert_eq!(tangle("grep -v two"), (Some(0), "one\n\n".into()));
}

fn own_source(names: bool) -> Vec<String> {
    let web = read(&(chapter("tangle") + "@@\n" + &chapter("licences")));
    let text = tangled(&web, "noweb/src/tangle.rs", names).text;
    let text = String::from_utf8(text).unwrap();
    text.lines().map(str::to_owned).collect()
}

#[test]
fn names_of_chunks_are_comments_and_some_quote_code() {
    let bare = own_source(false);
    let mut rest = bare.iter().peekable();
    let named = own_source(true);
    let is_name = |line: &&String| rest.next_if_eq(line).is_none();
    let names: Vec<&String> = named.iter().filter(is_name).collect();
    assert_eq!(names.len() + bare.len(), named.len());
    assert!(names.iter().all(|l| l.trim_start().starts_with("// ")));
    assert!(names.iter().any(|l| l.contains('`')));
}

/// The command `longest file...`: the chunk with the most lines.
fn run_longest(args: &[OsString], streams: &mut Streams) -> u8 {
    let read = args.iter().map(|file| streams.read(file));
    let sources = match read.collect::<Result<Vec<Source>, _>>() {
        Ok(sources) => sources,
        Err(fault) => return streams.conclude(Ok(()), &[fault]),
    };
    let (web, faults) = Web::read(sources, 8);
    // Find and print the longest chunk
    let newline = |p: &&(Piece, _)| p.0 == Piece::Newline;
    let lines = |c: &Chunk| c.pieces.iter().filter(newline).count() + 1;
    let longest = web.chunks.iter().max_by_key(|chunk| lines(chunk));
    let result = longest.map_or(Ok(()), |chunk| {
        let name = String::from_utf8_lossy(&chunk.name);
        writeln!(streams.output, "{} {name}", lines(chunk))
    });
    streams.conclude(result, &faults)
}

#[test]
fn the_longest_chunk_is_found() {
    let dir = project("longest", LIST).dir;
    let (mut output, mut errors) = (Vec::new(), Vec::new());
    let mut streams = Streams {
        input: &mut &b""[..],
        output: &mut output,
        errors: &mut errors,
    };
    for (file, status) in [("a.nw", 0), ("b.nw", 2)] {
        let args = [dir.join(file).into_os_string()];
        assert_eq!(run_longest(&args, &mut streams), status);
    }
    assert_eq!(output, b"3 List the colours\n");
    assert!(String::from_utf8(errors).unwrap().contains("b.nw"));
}

// Answer about the book itself
#[test]
fn one_line_in_65_is_a_name() {
    let (bare, named) = (own_source(false), own_source(true));
    let names = named.len() - bare.len();
    let share = names as f64 / named.len() as f64;
    assert_eq!(names, 10);
    assert!((0.015..0.016).contains(&share), "{share}");
}

#[test]
fn the_tool_is_explained_from_the_top_down() {
    let web = read(&chapter("tangle"));
    let (mut down, mut all) = (0, 0);
    for Chunk { name, definitions, .. } in &web.chunks {
        if let Some(used) = web.uses.get(name) {
            all += 1;
            down += u32::from(used.line < definitions[0].line);
        }
    }
    assert!(all > 35);
    assert_eq!(down, all);
}
