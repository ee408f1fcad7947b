// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! Every stage on any bytes: for the tests that nothing panics.

use std::ffi::OsString;

use noweb::Streams;
use noweb::diagnostic::Source;
use noweb::filter::read_sources;
use noweb::markup::{mark_up, read_stream, write_stream};
use noweb::tangle::tangle;
use noweb::web::Web;

/// Feeds bytes to every stage, as a web and as a stream.
pub fn exercise(input: &[u8]) {
    for (name, tab) in [("input", 0), ("input", 8), ("input.md", 0)] {
        let source = Source::new(name.into(), input.to_vec());
        let (lexemes, faults) = mark_up(&source, 0, tab);
        let stream = write_stream(&lexemes);
        let faults = source.locate(faults);
        faults.iter().for_each(|fault| drop(fault.to_string()));
        read_sources(vec![source], tab).iter().for_each(expand_all);
        expand_all(&read_stream(&stream).0);
    }
    expand_all(&read_stream(input).0);
    run_all(input);
}

/// Expands every chunk that is not too much repeated, in every layout.
fn expand_all(web: &Web) {
    if web.chunks.iter().map(|chunk| chunk.pieces.len()).sum::<usize>()
        > 4000
    {
        return;
    }
    for chunk in 0..web.chunks.len().min(20) {
        for rust in [false, true] {
            match tangle(web, chunk, rust) {
                Ok(tangled) => drop(tangled.origin(1, 1)),
                Err(faults) => drop(faults[0].to_string()),
            }
        }
    }
    let unused = noweb::project::unused(web);
    unused.into_iter().for_each(|w| drop(w.to_string()));
}

/// Gives bytes as standard input to the commands that are pure filters.
fn run_all(input: &[u8]) {
    let tanglers = ["notangle -L", "notangle -t4", "notangle", "nt -L"];
    let filters = ["markup -t", "markup", "nt", "noroots"];
    let weavers = ["finduses", "rustindex", "noidx", "totex"];
    for command in tanglers.iter().chain(&filters).chain(&weavers) {
        let words: Vec<OsString> =
            command.split(' ').map(OsString::from).collect();
        let (mut output, mut errors) = (Vec::new(), Vec::new());
        let mut streams = Streams {
            input: &mut &input[..],
            output: &mut output,
            errors: &mut errors,
        };
        noweb::command::run(&words[0], &words[1..], &mut streams);
    }
}

/// A small random number generator (xorshift), for reproducible runs.
pub struct Random(pub u64);

impl Random {
    pub fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit.max(1) as u64) as usize
    }
}

/// A piece of some input, changed in a few places.
pub fn mutate(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let tokens: [&[u8]; 20] = [
        b"```\n",
        b"- ",
        b"\n<!--",
        b"`x`",
        b"<<",
        b">>",
        b">>=",
        b"[[",
        b"]]",
        b"@",
        b"@ ",
        b"@ %def x\n",
        b"\n",
        b"\t",
        b"\r\n",
        b"\xff",
        b"\0",
        b"@nl\n",
        b"@use x\n",
        b"<<x>>=\n",
    ];
    let seed = &seeds[random.below(seeds.len())];
    let from = random.below(seed.len());
    let length = random.below((seed.len() - from).min(3000) + 1);
    let mut input = seed[from..from + length].to_vec();
    for _ in 0..random.below(12) {
        let at = random.below(input.len() + 1);
        let removed = random.below(8).min(input.len() - at);
        let added = tokens[random.below(tokens.len())];
        let added = if random.below(4) == 0 { b"" } else { added };
        input.splice(at..at + removed, added.iter().copied());
    }
    input
}
