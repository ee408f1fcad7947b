// Tangled from noweb/chapters/totex.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The back end `split_scope`: one LaTeX file for each source file.
//!
//! The references of the whole stay in every piece. A file is written
//! only if its text has changed, and no file is written at all unless
//! every piece could be converted.

use std::collections::HashMap;
use std::ffi::{OsStr, OsString};
use std::ops::Range;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

use crate::Streams;
use crate::cpif::replace;
use crate::diagnostic::{shown, text_of};
use crate::stream::{self, Outcome};
use crate::totex::{self, Memory, Options};

/// The file that a piece comes from, and its lines.
type Part<'a> = (&'a [u8], &'a [&'a [u8]]);

fn cut<'a>(lines: &'a [&'a [u8]]) -> Vec<Part<'a>> {
    let mut begun = false;
    let pieces = lines.chunk_by(|line, next| {
        begun |= line.starts_with(b"@file ");
        !begun || !next.starts_with(b"@file ")
    });
    let part = |lines: &'a [&'a [u8]]| {
        let source = lines.iter().find_map(|l| l.strip_prefix(b"@file "));
        Some((source?, lines))
    };
    pieces.filter_map(part).collect()
}

fn stem(source: &[u8]) -> &[u8] {
    let base = source.rsplit(|&byte| byte == b'/').next();
    let base = base.unwrap_or(source);
    base.strip_suffix(b".nw").unwrap_or(base)
}

/// Whether a line of prose begins with the macro of one of the lists.
fn asks_for_lists(line: &[u8]) -> bool {
    let Some(text) = line.strip_prefix(b"@text ") else { return false };
    let text = text.trim_ascii_start();
    text.starts_with(b"\\nowebchunks") || text.starts_with(b"\\nowebindex")
}

fn request(lines: &[&[u8]]) -> Option<usize> {
    let mut prose = false;
    (1..lines.len()).find(|at| {
        let (previous, line) = (lines[at - 1], lines[*at]);
        let begins = previous.starts_with(b"@begin ");
        if begins {
            prose = previous.starts_with(b"@begin docs ");
        }
        prose && (begins || previous == b"@nl") && asks_for_lists(line)
    })
}

fn find_lists(lines: &[&[u8]]) -> Option<Range<usize>> {
    let find = |wanted: &[u8]| lines.iter().position(|l| *l == wanted);
    let begin = find(b"@xref beginchunks")?;
    let end = find(b"@index endindex")? + 1;
    let before = lines[..begin].iter().rev();
    let ends = before.take_while(|line| **line == b"@nl").count();
    let start = begin - ends;
    let outside = start == 0 || lines[start - 1].starts_with(b"@end ");
    let start = if outside { start } else { begin };
    (start < end).then_some(start..end)
}

fn settle_lists(lines: &mut Vec<&[u8]>) {
    let Some(lists) = find_lists(lines) else { return };
    let Some(mut place) = request(lines) else { return };
    if place > lists.start {
        place -= lists.len();
    }
    let taken = lines.drain(lists).skip_while(|line| *line == b"@nl");
    let taken: Vec<&[u8]> = taken.collect();
    lines.splice(place..place, taken);
}

/// The name of a file, and its text.
pub type Page = (Vec<u8>, Vec<u8>);

/// Converts a stream into files, and collects the warnings.
pub fn split(
    stream: &[u8],
    options: &Options,
) -> Result<(Vec<Page>, Vec<u8>), String> {
    let mut lines: Vec<_> = stream::trimmed_lines(stream).collect();
    settle_lists(&mut lines);
    let pieces = cut(&lines);
    // Check the names of the pieces
    let mut sources: HashMap<&[u8], &[u8]> = HashMap::new();
    for (source, _) in &pieces {
        let stem = stem(source);
        if stem.is_empty() {
            return Err("a piece has no file name to be called by".into());
        }
        if let Some(other) = sources.insert(stem, source) {
            // Refuse two sources with one name
            let [other, source, stem] = [other, source, stem].map(text_of);
            let text =
                format!("{other} and {source} would both be written to");
            return Err(format!("{text} {stem}.tex"));
        }
    }
    let (mut memory, mut messages) = (Memory::default(), Vec::new());
    let pages = pieces.iter().map(|(source, lines)| {
        // Convert one piece with its memory
        let mut options = options.clone();
        if !options.comment.is_empty() {
            let open = b" % Made by noweave from ";
            options.comment =
                [open, *source, b": edit that file."].concat();
        }
        let lines = lines.iter().copied();
        let converted = totex::to_tex(lines, &options, &mut memory);
        messages.extend(converted.messages);
        let name = [stem(source), b".tex"].concat();
        (name, converted.text)
    });
    Ok((pages.collect(), messages))
}

pub fn write_pages(pages: &[Page], dir: &Path) -> Result<(), String> {
    let cannot = |path: &Path, error: std::io::Error| {
        format!("cannot write {}: {error}", shown(path))
    };
    if pages.is_empty() {
        return Err("the stream names no file".into());
    }
    std::fs::create_dir_all(dir).map_err(|e| cannot(dir, e))?;
    // Write each page that has changed
    for (name, tex) in pages {
        let path = dir.join(OsStr::from_bytes(name));
        replace(&path, tex, None).map_err(|e| cannot(&path, e))?;
    }
    Ok(())
}

/// `split_scope [-o DIR] [OPTION OF TOTEX]...`, a last stage.
pub fn run(args: &[OsString], streams: &mut Streams) -> u8 {
    let dir = match args.iter().position(|arg| arg == "-o") {
        Some(at) => args.get(at + 1).map(PathBuf::from),
        None => Some(PathBuf::from(".")),
    };
    let Some(dir) = dir else {
        let what = "-o needs a directory";
        return Outcome::complaint("split_scope", 2, what).deliver(streams);
    };
    let options = Options::read(args);
    stream::filter(streams, |input| {
        if stream::broken(input).is_some() {
            return Outcome { status: 1, ..Outcome::default() };
        }
        // Write the pieces
        let written =
            split(input, &options).and_then(|(pages, messages)| {
                write_pages(&pages, &dir).map(|()| messages)
            });
        match written {
            Ok(messages) => Outcome { messages, ..Outcome::default() },
            Err(what) => Outcome::complaint("split_scope", 1, &what),
        }
    })
}
