// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! No stage of weaving panics, whatever stream it is given.

use crate::{common, exercise};

use std::ffi::OsString;

use common::{Case, Scratch};
use exercise::Random;
use noweb::Streams;

/// Streams of the cases: what was recorded, and what was given.
fn streams() -> Vec<Vec<u8>> {
    let cases =
        Case::all().into_iter().filter(|c| c.name.contains("weave"));
    let files =
        cases.flat_map(|case| [case.file("stdout"), case.file("stream")]);
    let is_stream = |text: &Vec<u8>| text.starts_with(b"@");
    let streams: Vec<_> = files.flatten().filter(is_stream).collect();
    assert!(streams.len() > 20, "only {} streams", streams.len());
    streams
}

/// A stream with lines lost, doubled, cut, swapped and mixed.
fn damage(streams: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let [one, other] =
        [0; 2].map(|_| &streams[random.below(streams.len())]);
    let split = |text: &[u8]| -> Vec<Vec<u8>> {
        text.split(|b| *b == b'\n').map(<[u8]>::to_vec).collect()
    };
    let (mut lines, others) = (split(one), split(other));
    for _ in 0..=random.below(12) {
        let at = random.below(lines.len());
        match random.below(6) {
            0 => drop(lines.remove(at)),
            1 => {
                lines.insert(at, others[random.below(others.len())].clone())
            }
            2 => {
                let length = random.below(lines[at].len() + 1);
                lines[at].truncate(length);
            }
            3 => {
                let to = random.below(lines.len());
                lines.swap(at, to);
            }
            4 => lines[at].push(b"\r\xff [\\{"[random.below(6)]),
            _ => lines.truncate(at + 1),
        }
        if lines.is_empty() {
            break;
        }
    }
    lines.join(&b'\n')
}

fn feed(command: &str, args: &[&str], stream: &[u8]) -> Vec<u8> {
    let (mut output, mut errors) = (Vec::new(), Vec::new());
    let mut streams = Streams {
        input: &mut &stream[..],
        output: &mut output,
        errors: &mut errors,
    };
    let args: Vec<OsString> = args.iter().map(OsString::from).collect();
    noweb::command::run(command.as_ref(), &args, &mut streams);
    output
}

#[test]
fn no_stage_panics_on_damaged_streams() {
    let streams = streams();
    let scratch = Scratch::new();
    let dir = scratch.path().join("tex").display().to_string();
    let mut random = Random(0x2545_f491_4f6c_dd1d);
    for round in 0..3000 {
        let stream = damage(&streams, &mut random);
        let used = feed("finduses", &[], &stream);
        let resolved = feed("noidx", &["-delay"], &used);
        feed("noidx", &[], &stream);
        feed("totex", &["-delay"], &resolved);
        feed("totex", &["-texnames"], &stream);
        if round % 10 == 0 {
            feed("split_scope", &["-o", &dir, "-delay"], &resolved);
        }
    }
}

#[test]
fn text_survives_finduses() {
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let letters = b"ab.:_ -$";
    for _ in 0..2000 {
        let mut word = |limit| -> Vec<u8> {
            let length = 1 + random.below(limit);
            (0..length).map(|_| letters[random.below(8)]).collect()
        };
        let words: Vec<Vec<u8>> = (0..4).map(|_| word(3)).collect();
        let text = word(30);
        let mut stream = b"@begin code 0\n".to_vec();
        for word in &words {
            stream.extend([b"@index defn ", &word[..], b"\n"].concat());
        }
        stream.extend([b"@text ", &text[..], b"\n@end code 0\n"].concat());
        let marked = feed("finduses", &[], &stream);
        let lines = marked.split(|b| *b == b'\n');
        let texts = lines.filter_map(|line| line.strip_prefix(b"@text "));
        assert_eq!(texts.collect::<Vec<_>>().concat(), text);
    }
}
