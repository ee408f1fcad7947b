// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The stage `finduses`: marks every use of a defined identifier.
//!
//! Identifiers come from the stream's own `@index defn` lines, or from
//! files with one identifier on each line. The text keeps its bytes: a
//! use is announced by a line before it, and the text is cut around it.

use std::collections::{HashMap, VecDeque};
use std::ffi::OsString;

use crate::Streams;
use crate::stream::{self, Mark, Outcome};

// Recognise many words in one pass
/// An automaton that finds all occurrences of a set of words.
pub struct Recogniser {
    nodes: Vec<Node>,
}

/// A prefix of one or more of the words; node 0 is the empty prefix.
#[derive(Default)]
struct Node {
    moves: HashMap<u8, usize>,
    fallback: usize,
    /// The lengths of the words that end here, in order of report.
    words: Vec<usize>,
}

impl Recogniser {
    /// Builds the automaton for the given words.
    pub fn new<'a>(words: impl Iterator<Item = &'a [u8]>) -> Recogniser {
        let mut automaton = Recogniser { nodes: vec![Node::default()] };
        words.for_each(|word| automaton.add(word));
        automaton.link();
        automaton
    }

    // Add a word to the tree
    fn add(&mut self, word: &[u8]) {
        let end = word.iter().fold(0, |node, &byte| self.child(node, byte));
        if end != 0 && self.nodes[end].words.is_empty() {
            self.nodes[end].words.push(word.len());
        }
    }

    // Grow the tree by a byte
    fn child(&mut self, node: usize, byte: u8) -> usize {
        let new = self.nodes.len();
        let child = *self.nodes[node].moves.entry(byte).or_insert(new);
        if child == new {
            self.nodes.push(Node::default());
        }
        child
    }

    // Link each node to its fallback
    fn link(&mut self) {
        let mut waiting = VecDeque::from([0]);
        while let Some(node) = waiting.pop_front() {
            for (byte, child) in self.nodes[node].moves.clone() {
                let fallback = match node {
                    0 => 0,
                    _ => self.step(self.nodes[node].fallback, byte),
                };
                // Inherit the words of the fallback
                let mut words = self.nodes[fallback].words.clone();
                words.reverse();
                words.append(&mut self.nodes[child].words);
                self.nodes[child].words = words;
                self.nodes[child].fallback = fallback;
                waiting.push_back(child);
            }
        }
    }

    // Move on by one byte
    fn step(&self, mut node: usize, byte: u8) -> usize {
        loop {
            match self.nodes[node].moves.get(&byte) {
                Some(&next) => return next,
                None if node == 0 => return 0,
                None => node = self.nodes[node].fallback,
            }
        }
    }
}

// Decide whether a match is whole
#[derive(PartialEq, Eq)]
enum Class {
    Name,
    Operator,
    Separator,
}

fn class(byte: u8) -> Class {
    match byte {
        b'_' | b'\'' | b'@' | b'#' => Class::Name,
        _ if byte.is_ascii_alphanumeric() => Class::Name,
        _ if b"!%^&*-+:=|~<>./?`".contains(&byte) => Class::Operator,
        _ => Class::Separator,
    }
}

/// Whether two neighbouring bytes belong to one token.
fn joined(left: u8, right: u8) -> bool {
    class(left) == class(right) && class(left) != Class::Separator
}

/// Whether `line[start..end]` is a token, or several, but no part of one.
fn whole(line: &[u8], start: usize, end: usize) -> bool {
    let before = start > 0 && joined(line[start - 1], line[start]);
    let after = end < line.len() && joined(line[end - 1], line[end]);
    !before && !after
}

// Mark the uses in a stream
const TEXT: &[u8] = b"@text ";

impl Recogniser {
    /// Writes a `@text` line, cut at the uses of the words.
    pub fn mark_line(&self, line: &[u8], out: &mut Vec<u8>) {
        let (mut node, mut done) = (0, TEXT.len());
        for end in 1..=line.len() {
            node = self.step(node, line[end - 1]);
            for start in self.nodes[node].words.iter().map(|n| end - n) {
                if whole(line, start, end) {
                    // Announce the use before its text
                    done = copy(line, done, start, out);
                    put(out, &[b"@index use ", &line[start..end]]);
                    done = copy(line, done, end, out);
                }
            }
        }
        copy(line, done, line.len(), out);
    }
}

/// Writes `line[done..end]` as text, and says how far we are then.
fn copy(line: &[u8], done: usize, end: usize, out: &mut Vec<u8>) -> usize {
    if done >= end {
        return done;
    }
    put(out, &[TEXT, &line[done..end]]);
    end
}

fn put(out: &mut Vec<u8>, parts: &[&[u8]]) {
    out.extend(parts.concat());
    out.push(b'\n');
}

/// Announces with `@index use` every use of a word in the code.
pub fn mark_uses(
    stream: &[u8],
    words: &Recogniser,
    quotes: bool,
) -> Vec<u8> {
    let mut out = Vec::new();
    let mut code = false;
    for line in stream::lines(stream) {
        // Note where code begins and ends
        let quote = quotes && line == b"@quote";
        if quote || line.starts_with(b"@begin code") {
            code = true;
        } else if line.starts_with(b"@end code") || line == b"@endquote" {
            code = false;
        }
        // Mark a text or copy the line
        match Mark::read(line) {
            Some(Mark { keyword: b"text", .. }) if code => {
                words.mark_line(line, &mut out);
            }
            _ => put(&mut out, &[line]),
        }
    }
    out
}

// Run finduses as a command
/// The identifiers that a stream declares.
pub fn declared(stream: &[u8]) -> Vec<&[u8]> {
    stream::lines(stream)
        .filter_map(Mark::read)
        .filter(|mark| mark.keyword == b"index")
        .map(|mark| mark.inner())
        .filter(|m| matches!(m.keyword, b"defn" | b"localdefn"))
        .map(|m| m.text())
        .collect()
}

/// `finduses [-noquote] [FILE]...`, a filter over the stream.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    match arguments(args) {
        Ok((quotes, files)) => stream::filter(streams, |input| {
            find_uses(input, &files, quotes)
        }),
        Err(what) => {
            Outcome::failure("finduses", 2, &what).deliver(streams)
        }
    }
}

/// Whether quoted code counts, and the contents of the files of words.
fn arguments(args: &[OsString]) -> Result<(bool, Vec<Vec<u8>>), String> {
    let dashed = |a: &OsString| a.as_encoded_bytes().starts_with(b"-");
    let is_option = |a: &&OsString| dashed(a) && a.len() > 1;
    let count = args.iter().take_while(is_option).count();
    let (options, files) = args.split_at(count);
    if let Some(option) = options.iter().find(|o| *o != "-noquote") {
        return Err(format!("unknown option {}", option.display()));
    }
    let contents = files.iter().map(read_words).collect::<Result<_, _>>();
    Ok((options.is_empty(), contents?))
}

fn read_words(file: &OsString) -> Result<Vec<u8>, String> {
    std::fs::read(file)
        .map_err(|e| format!("couldn't open file {}: {e}", file.display()))
}

fn find_uses(stream: &[u8], files: &[Vec<u8>], quotes: bool) -> Outcome {
    if let Some(fatal) = stream::fatal(stream) {
        let text = [fatal, b"\n"].concat();
        return Outcome { text, status: 1, ..Outcome::default() };
    }
    let words = match files {
        [] => declared(stream),
        _ => files.iter().flat_map(|file| stream::lines(file)).collect(),
    };
    let words = Recogniser::new(words.into_iter());
    Outcome::done(mark_uses(stream, &words, quotes))
}
