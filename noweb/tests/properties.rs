// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! What holds for every web: an independent model of tangling, and that no
//! input panics.

use crate::exercise;

use std::path::Path;

use exercise::{Random, exercise, mutate};
use noweb::diagnostic::Source;
use noweb::filter::read_sources;
use noweb::tangle::{Tangled, tangle};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

// A web as the generator sees it: for each chunk its definitions, for each
// definition its lines, for each line its pieces.
type Lines = Vec<Vec<Piece>>;

#[derive(Clone, Debug)]
enum Piece {
    Text(String),
    Use(usize),
}

fn name(chunk: usize) -> String {
    format!("{} chunk {chunk}", "x".repeat(chunk))
}

/// Chunks that use only chunks with greater numbers.
fn webs() -> impl Strategy<Value = Vec<Vec<Lines>>> {
    const COUNT: usize = 6;
    let chunk = |number: usize| {
        let text = "[a-z;( +]{0,6}".prop_map(Piece::Text);
        let piece = if number + 1 < COUNT {
            let later = (number + 1..COUNT).prop_map(Piece::Use);
            prop_oneof![3 => text, 2 => later].boxed()
        } else {
            text.boxed()
        };
        let line = prop::collection::vec(piece, 0..4);
        let lines = prop::collection::vec(line, 0..4);
        prop::collection::vec(lines, 1..3)
    };
    (0..COUNT).map(chunk).collect::<Vec<_>>()
}

fn source(web: &[Vec<Lines>]) -> String {
    let mut text = String::from("Prose [[code <<x>>]].\n");
    // First all first definitions, then all second ones.
    for turn in 0..2 {
        for (number, definitions) in web.iter().enumerate() {
            let Some(lines) = definitions.get(turn) else { continue };
            text += &format!("<<{}>>=\n", name(number));
            for line in lines {
                text += &format!("{}\n", source_line(line));
            }
            text += "@ More prose.\n";
        }
    }
    text
}

fn source_line(line: &[Piece]) -> String {
    let piece = |piece: &Piece| match piece {
        Piece::Text(text) => text.clone(),
        Piece::Use(chunk) => format!("<<{}>>", name(*chunk)),
    };
    line.iter().map(piece).collect()
}

/// A line of the model.
#[derive(Clone, Default)]
struct Line {
    text: String,
    state: State,
}

#[derive(Clone, Copy, Default, PartialEq)]
enum State {
    /// Nothing is on it, not even a use: it is never indented.
    #[default]
    Blank,
    /// It is indented wherever its chunk is used.
    Begun,
    /// It was blank when the chunk that began it ended. What a chunk around
    /// that one adds comes too late to be indented.
    Late,
}

/// The model: the lines of a chunk after substitution.
fn model(web: &[Vec<Lines>], chunk: usize) -> Vec<Line> {
    let lines = web[chunk].iter().flatten();
    let out: Vec<Line> =
        lines.flat_map(|line| model_line(web, line)).collect();
    if out.is_empty() { vec![Line::default()] } else { out }
}

fn model_line(web: &[Vec<Lines>], line: &[Piece]) -> Vec<Line> {
    let mut out = vec![Line::default()];
    let mut column = 0;
    for piece in line {
        match piece {
            Piece::Text(text) if text.is_empty() => (),
            Piece::Text(text) => append(&mut out, text),
            Piece::Use(chunk) => {
                let lines = model(web, *chunk);
                append(&mut out, &lines[0].text);
                for mut line in lines.into_iter().skip(1) {
                    if line.state == State::Begun {
                        line.text.insert_str(0, &" ".repeat(column));
                    }
                    out.push(line);
                }
            }
        }
        column += source_line(std::slice::from_ref(piece)).len();
    }
    out
}

fn append(out: &mut [Line], text: &str) {
    let late = out.len() > 1;
    let last = out.last_mut().expect("a line");
    last.text.push_str(text);
    if last.state == State::Blank {
        last.state = if late { State::Late } else { State::Begun };
    }
}

fn tangle_source(text: &str, rust: bool) -> Tangled {
    let source = Source::new(b"a.nw".to_vec(), text.into());
    let web = read_sources(vec![source], 8).expect("a web");
    let root = web.find(name(0).as_bytes()).expect("a root");
    tangle(&web, root, rust).expect("a program")
}

/// Text in which everything that means something is frequent.
fn marked_text() -> impl Strategy<Value = Vec<u8>> {
    let tokens = vec![
        "<<",
        ">>",
        ">>=",
        "[[",
        "]]",
        "[",
        "]",
        "<",
        ">",
        "@",
        "@@",
        "@ ",
        "\n@ ",
        "\n@\n",
        "\n@ %def ",
        "\n<<a>>=\n",
        "<<b>>",
        "\n",
        "\n\n",
        "x",
        " ",
        "y z",
        "=",
        "\t",
        "\r",
        "é",
        "%def",
    ];
    let token = prop::sample::select(tokens);
    prop::collection::vec(token, 0..40)
        .prop_map(|tokens| (tokens.concat() + "\n").into_bytes())
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(20_261_122),
        ..ProptestConfig::with_cases(400)
    })]

    #[test]
    fn tangling_is_recursive_substitution(web in webs()) {
        let lines = model(&web, 0).into_iter().map(|line| line.text);
        let lines: Vec<String> = lines.collect();
        let tangled = tangle_source(&source(&web), false);
        let text = String::from_utf8_lossy(&tangled.text).into_owned();
        prop_assert_eq!(text, lines.join("\n") + "\n");
    }

    #[test]
    fn every_byte_maps_to_itself_in_the_web(web in webs()) {
        let source = source(&web);
        let tangled = tangle_source(&source, false);
        let sources: Vec<&[u8]> =
            source.as_bytes().split(|b| *b == b'\n').collect();
        let text = tangled.text.split(|b| *b == b'\n').zip(1..);
        for (line, number) in text {
            let blank = line.iter().take_while(|b| **b == b' ').count();
            for (byte, column) in line.iter().zip(1..).skip(blank) {
                let place = tangled.origin(number, column).unwrap();
                let origin = sources[place.line as usize - 1];
                prop_assert_eq!(origin[place.column as usize - 1], *byte);
            }
        }
    }

    #[test]
    fn names_are_comments_and_change_nothing_else(web in webs()) {
        let source = source(&web);
        let named = tangle_source(&source, true).text;
        let named = String::from_utf8(named).expect("UTF-8");
        prop_assert!(!named.contains("// "), "outside of functions");
        // The same within the body of a function
        let first = format!("<<{}>>", name(0));
        let source = format!("{source}<<r>>=\nfn f() {{\n  {first}\n}}\n");
        let source = Source::new(vec![], source.into());
        let web = read_sources(vec![source], 0).expect("a web");
        let root = web.find(b"r").expect("a root");
        let plain = tangle(&web, root, false);
        let named = tangle(&web, root, true).expect("a program").text;
        let lines = named.split_inclusive(|b| *b == b'\n');
        let without: Vec<u8> = lines
            .filter(|line| !line.trim_ascii_start().starts_with(b"// "))
            .flatten()
            .copied()
            .collect();
        prop_assert!(named.len() > without.len());
        prop_assert_eq!(without, plain.expect("a program").text);
    }

    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        exercise(&bytes);
    }

    #[test]
    fn no_marked_text_panics(text in marked_text()) {
        exercise(&text);
    }
}

#[test]
fn mutated_chapters_panic_nowhere() {
    let seeds: Vec<Vec<u8>> = chapters().map(|(_, text)| text).collect();
    let mut random = Random(20_260_101);
    for _ in 0..400 {
        exercise(&mutate(&seeds, &mut random));
    }
}

/// The chapters about the tool itself, which this crate is made of.
fn chapters() -> impl Iterator<Item = (String, Vec<u8>)> {
    let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("chapters");
    let read = move |name: &str| {
        let path = dir.join(name);
        Some((path.display().to_string(), std::fs::read(&path).ok()?))
    };
    ["core.nw", "stream.nw", "command.nw"].into_iter().filter_map(read)
}
