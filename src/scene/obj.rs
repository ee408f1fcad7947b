// Tangled from chapters/scene.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the text of a Wavefront OBJ to a mesh.

use std::borrow::Cow;
use std::iter::from_fn;
use std::str::SplitWhitespace;

use glam::DVec3;
use memchr::{memchr, memchr2};
use rayon::prelude::*;

use super::encoding;
use super::mesh::Mesh;
use super::polygons::{self, Oddity};

/// Reads the mesh that the bytes `source` of a Wavefront OBJ describe,
/// which may be compressed.
/// Convex faces become fans of triangles around their first corner.
///
/// # Errors
/// Text that is empty, binary, malformed or without any face, faces with
/// fewer than three corners or with corners that do not exist or are not
/// finite, more vertices than 32 bits can count or triangles than 30,
/// compressed files that are damaged.
pub fn read_obj(source: &[u8]) -> Result<Mesh, String> {
    let read = read_file(source);
    read.map(|(mesh, _)| mesh).map_err(|error| error.within("OBJ"))
}

/// The same as `read_obj`, with warnings, made like errors: of faces that
/// are no polygons, and of what is in the file but not in the mesh.
pub fn read_file(source: &[u8]) -> Result<(Mesh, Vec<ObjError>), ObjError> {
    read_pieces(source, PIECE)
}

/// The size of a piece of the text.
const PIECE: usize = 1 << 20;

/// Looks at the beginning of an OBJ that may have no end.
///
/// # Errors
/// A zero byte, a faulty line, or no vertex.
pub fn begins_obj(start: &[u8]) -> Result<(), ObjError> {
    if encoding::format(start).is_some() {
        return Ok(());
    }
    let start = plain(start)?;
    let last = cut(start, PIECE).pop().unwrap_or_default();
    let piece = &start[..start.len() - last.len()];
    let mesh = read_piece(piece, 0, [0, i64::MAX as usize])?;
    let size = start.len().div_ceil(1 << 20);
    let none = || format!("no vertex in the first {size} MiB");
    let first = mesh.vertices.first().map(drop);
    first.ok_or_else(|| ObjError::whole(none()))
}

/// The same as `read_file`, whatever the number of bytes `size` after which
/// the text is cut.
pub fn read_pieces(
    source: &[u8],
    size: usize,
) -> Result<(Mesh, Vec<ObjError>), ObjError> {
    let mut warnings = vec![];
    let warn = &mut |what: &str| warnings.push(ObjError::whole(what));
    let text = encoding::text(source, warn).map_err(ObjError::whole)?;
    if text.is_empty() {
        let what = "the file is empty; an OBJ was expected";
        return Err(ObjError::whole(what));
    }
    let source = plain(&text)?;
    let pieces = cut(source, size);
    // Count what comes before each piece
    let counts: Vec<_> = pieces.par_iter().map(|p| count(p)).collect();
    let (mut vertices, mut lines, mut unused, mut first) = (0, 0, 0, None);
    let mut before = Vec::with_capacity(counts.len());
    for (more, part) in counts {
        before.push((vertices, lines));
        first = first.or(part.first.map(|(at, word)| (lines + at, word)));
        unused += part.unused;
        vertices += more;
        lines += part.line;
    }
    countable(vertices, "vertices", u32::MAX)?;
    warnings.extend(first.map(|(line, word)| {
        let what = "statements that are not rendered";
        ObjError::new(line, format!("{word}, the first of {unused} {what}"))
    }));
    // Read each piece into a mesh
    let read = |(piece, &(first, line)): (&&[u8], &(usize, usize))| {
        read_piece(piece, line, [first, vertices])
    };
    let parts: Vec<_> = pieces.par_iter().zip(&before).map(read).collect();
    let parts = parts.into_iter().collect::<Result<Vec<_>, _>>()?;
    // Put the meshes one behind the other
    let (mut joined, mut first) = (vec![], 0);
    for part in &parts {
        joined.extend(part.joined.iter().map(|&i| first + i));
        first = first.wrapping_add(part.triangles.len() as u32);
    }
    let parts = parts.into_iter().map(|m| (m.vertices, m.triangles));
    let (vertices, triangles): (Vec<_>, Vec<_>) = parts.unzip();
    let (vertices, triangles) =
        rayon::join(|| append(vertices), || append(triangles));
    countable(triangles.len(), "triangles", MOST)?;
    if triangles.is_empty() {
        return Err(ObjError::whole("no face, hence nothing to render"));
    }
    let mut mesh = Mesh { vertices, triangles, joined };
    warnings.extend(set_aside(source, &mut mesh)?);
    // Fill the faces, and warn of odd ones
    let Mesh { vertices, triangles, joined } = &mut mesh;
    let odd = polygons::fill(vertices, triangles, joined);
    countable(triangles.len(), "triangles", MOST)?;
    if let Some(&(face, _)) = odd.first() {
        let crossed = odd.iter().filter(|odd| odd.1 == Oddity::Crossed);
        let (n, crossed) = (odd.len(), crossed.count());
        let what = format!(
            "the first of {n} odd faces ({} bent, {crossed} crossed); \
             other programs may fill them differently",
            n - crossed
        );
        let (line, _) = find(source, b"f", face as usize);
        warnings.push(ObjError::new(line, what));
    }
    Ok((mesh, warnings))
}

/// The text without zeros, marks and blanks behind it, if there is text.
fn plain(source: &[u8]) -> Result<&[u8], ObjError> {
    let pads = |c: &u8| matches!(*c, 0 | END) || c.is_ascii_whitespace();
    let end = source.iter().rposition(|c| !pads(c));
    let source = &source[..end.map_or(source.len(), |last| last + 1)];
    let Some(at) = memchr(0, source) else { return Ok(source) };
    let line = 1 + count(&source[..at]).1.line;
    let what = "a zero byte: this is a binary file, not an OBJ";
    Err(ObjError::new(line, what))
}

/// Ctrl-Z, the end of a text under CP/M and DOS.
const END: u8 = 0x1a;

/// Replaces vertices that are not finite; returns a warning of them.
///
/// # Errors
/// One of them is a corner of a face.
fn set_aside(
    source: &[u8],
    mesh: &mut Mesh,
) -> Result<Option<ObjError>, ObjError> {
    let Mesh { vertices, triangles, joined } = mesh;
    let wrong = vertices.par_iter().positions(|p| !p.is_finite());
    let wrong: Vec<_> = wrong.collect();
    let Some(&first) = wrong.first() else { return Ok(None) };
    let bad = |i: &u32| !vertices[*i as usize].is_finite();
    if let Some(t) = triangles.iter().position(|t| t.iter().any(bad)) {
        let face = t - joined.partition_point(|&i| i as usize <= t);
        let corner = triangles[t].into_iter().find(bad).unwrap_or_default();
        let (line, text) = find(source, b"v", corner as usize);
        let what = format!("a corner is not finite: line {line} is {text}");
        return Err(ObjError::new(find(source, b"f", face).0, what));
    }
    wrong.iter().for_each(|&i| vertices[i] = DVec3::ZERO);
    let (line, _) = find(source, b"v", first);
    let what = "vertices that are not finite, and in no face";
    let what = format!("the first of {} {what}", wrong.len());
    Ok(Some(ObjError::new(line, what)))
}

/// The line and the text of the statement `name` with a number from 0.
fn find(source: &[u8], name: &[u8], number: usize) -> (usize, String) {
    let mut statements = Statements::of(source);
    let mut all = statements.by_ref().filter(|s| s.starts_with(name));
    let text = all.nth(number).unwrap_or_default();
    (statements.line, String::from_utf8_lossy(&text).into_owned())
}

/// The elements of all `parts`, in order, in just enough memory.
fn append<T>(parts: Vec<Vec<T>>) -> Vec<T> {
    let mut whole = Vec::with_capacity(parts.iter().map(Vec::len).sum());
    parts.into_iter().for_each(|mut part| whole.append(&mut part));
    whole
}

/// Refuses more elements than can be named.
fn countable(n: usize, what: &str, most: u32) -> Result<(), ObjError> {
    let what = format!("{n} {what}, of which only {most} can be numbered");
    let is_few = n as u64 <= u64::from(most);
    is_few.then_some(()).ok_or_else(|| ObjError::whole(what))
}

/// Triangles at most: a leaf has 30 bits for the number of a face.
const MOST: u32 = 1 << 30;

#[cfg(test)]
#[path = "../../tests/units/obj.rs"]
mod tests;

/// The statements of a text that give vertices and faces, one by one.
struct Statements<'a> {
    /// What was not yet looked at.
    rest: &'a [u8],
    /// Number of lines looked at; that of the statement's last line.
    line: usize,
    /// Statements without use; the line and the name of the first.
    unused: usize,
    first: Option<(usize, String)>,
}

impl<'a> Statements<'a> {
    fn of(rest: &'a [u8]) -> Self {
        Self { rest, line: 0, unused: 0, first: None }
    }

    /// The next line, without its end and the blanks and marks around it.
    fn line(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        let end = memchr2(b'\n', b'\r', self.rest);
        let end = end.unwrap_or(self.rest.len());
        let (mut line, rest) = self.rest.split_at(end);
        let ([b'\r', b'\n', rest @ ..] | [_, rest @ ..] | rest) = rest;
        (self.rest, self.line) = (rest, self.line + 1);
        while let [0xef, 0xbb, 0xbf, text @ ..] | [END, text @ ..] = line {
            line = text;
        }
        Some(line.trim_ascii())
    }

    /// The line `first` and what continues it.
    fn join(&mut self, first: &'a [u8]) -> Vec<u8> {
        let (mut whole, mut line) = (first.to_vec(), first);
        while line.ends_with(b"\\") && !line.contains(&b'#') {
            while let Some(b'\\' | b' ' | b'\t') = whole.last() {
                whole.pop();
            }
            if !goes_on(self.rest) {
                break;
            }
            whole.push(b' ');
            let mut lines = from_fn(|| self.line());
            line = lines.find(|line| !line.is_empty()).unwrap_or_default();
            whole.extend_from_slice(line);
        }
        whole
    }
}

/// Whether a text begins as a line does that continues another.
fn goes_on(text: &[u8]) -> bool {
    let start = text.trim_ascii_start().first();
    matches!(start, Some(b'0'..=b'9' | b'-' | b'+' | b'.' | b'\\'))
}

impl<'a> Iterator for Statements<'a> {
    type Item = Cow<'a, [u8]>;

    fn next(&mut self) -> Option<Cow<'a, [u8]>> {
        loop {
            let line = self.line()?;
            let whole = match line {
                [.., b'\\'] => Cow::Owned(self.join(line)),
                _ => Cow::Borrowed(line),
            };
            let name = whole.split(u8::is_ascii_whitespace).next();
            match name.unwrap_or_default() {
                b"v" | b"f" => return Some(whole),
                // Pass a statement by
                b"" | b"vt" | b"vn" | [b'#', ..] => {}
                other
                    if SILENT.split(' ').any(|s| s.as_bytes() == other) => {
                }
                other => {
                    let name = &other[..other.len().min(40)];
                    let name = String::from_utf8_lossy(name).into_owned();
                    self.first.get_or_insert((self.line, name));
                    self.unused += 1;
                }
            }
        }
    }
}

/// Statements that say how faces look or are called, or belong to a shape
/// of which another statement is told.
const SILENT: &str = "g o s usemtl mtllib vp mg lod shadow_obj trace_obj \
    bevel c_interp d_interp maplib usemap ctech stech deg bmat step parm \
    trim hole scrv sp end con";

/// The text in pieces, each of whole statements and, but for the last,
/// longer than `size` bytes.
fn cut(mut source: &[u8], size: usize) -> Vec<&[u8]> {
    let mut pieces = Vec::new();
    while !source.is_empty() {
        let mut rest = &source[size.min(source.len())..];
        loop {
            let end = memchr2(b'\n', b'\r', rest).unwrap_or(rest.len());
            rest = rest[end..].trim_ascii_start();
            if !goes_on(rest) {
                break;
            }
        }
        let (piece, after) = source.split_at(source.len() - rest.len());
        pieces.push(piece);
        source = after;
    }
    pieces
}

/// The number of vertices in a piece, and its statements at their end.
fn count(piece: &[u8]) -> (usize, Statements<'_>) {
    let mut all = Statements::of(piece);
    let vertices = all.by_ref().filter(|s| s.starts_with(b"v")).count();
    // A line that the next piece has as well is counted there.
    let is_within = |&last| !matches!(last, b'\n' | b'\r');
    all.line -= usize::from(piece.last().is_some_and(is_within));
    (vertices, all)
}

/// The mesh of a piece that follows so many `lines` and vertices, the first
/// of two numbers; the second is that of all vertices.
fn read_piece(
    piece: &[u8],
    lines: usize,
    [first, total]: [usize; 2],
) -> Result<Mesh, ObjError> {
    let mut mesh = Mesh::default();
    let mut statements = Statements::of(piece);
    while let Some(text) = statements.next() {
        let vertices = [first + mesh.vertices.len(), total];
        read_statement(&text, vertices, &mut mesh)
            .map_err(|what| ObjError::new(lines + statements.line, what))?;
    }
    Ok(mesh)
}

fn read_statement(
    text: &[u8],
    vertices: [usize; 2],
    mesh: &mut Mesh,
) -> Result<(), String> {
    let end = memchr(b'#', text).unwrap_or(text.len());
    let text =
        str::from_utf8(&text[..end]).map_err(|_| "not UTF-8 text")?;
    let mut words = text.split_whitespace();
    match words.next() {
        Some("v") => read_vertex(words).map(|p| mesh.vertices.push(p)),
        _ => read_face(words, vertices, mesh),
    }
}

fn read_vertex(mut words: SplitWhitespace) -> Result<DVec3, String> {
    let mut position = [0.; 3];
    for (axis, value) in ["x", "y", "z"].iter().zip(&mut position) {
        let none = || format!("a vertex without {axis}");
        let word = words.next().ok_or_else(none)?;
        let wrong = |_| format!("{axis} = {word} is no number");
        *value = word.parse().map_err(wrong)?;
    }
    match words.find(|word| word.parse::<f64>().is_err()) {
        Some(word) => Err(format!("{word} is no number")),
        None => Ok(position.into()),
    }
}

/// Appends the fan of the face whose corners are `words`.
fn read_face(
    words: SplitWhitespace,
    vertices: [usize; 2],
    mesh: &mut Mesh,
) -> Result<(), String> {
    let (mut n, mut fan) = (0, [0; 3]);
    for word in words {
        let corner = read_corner(word, vertices)?;
        fan = [if n == 0 { corner } else { fan[0] }, fan[2], corner];
        n += 1;
        if n > 3 {
            mesh.joined.push(mesh.triangles.len() as u32);
        }
        if n >= 3 {
            mesh.triangles.push(fan);
        }
    }
    match n {
        0..3 => Err(format!("a face of {n} corners; it needs three")),
        _ => Ok(()),
    }
}

/// The vertex that a corner names, counted from 0.
fn read_corner(
    word: &str,
    [so_far, total]: [usize; 2],
) -> Result<u32, String> {
    let (digits, others) = word.split_once('/').unwrap_or((word, ""));
    // Judge what follows the first slash
    let is_number = |n: &str| n.is_empty() || n.parse::<i64>().is_ok();
    if !others.is_empty() && !others.splitn(2, '/').all(is_number) {
        return Err(format!("corner {word} is not of the form 1/2/3"));
    }
    match digits.parse::<i64>() {
        Err(_) => Err(format!("corner {word} is no vertex number")),
        Ok(0) => Err("vertices are counted from 1, not from 0".to_owned()),
        Ok(n) if n > total as i64 => {
            Err(format!("corner {n}, but only {total} vertices"))
        }
        Ok(n @ 1..) => Ok((n - 1) as u32),
        Ok(n) if n < -(so_far as i64) => {
            Err(format!("corner {n}, but only {so_far} vertices so far"))
        }
        Ok(n) => Ok((so_far as i64 + n) as u32),
    }
}

/// Why a text is not the OBJ of a mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjError {
    /// The line at fault, from 1; none if the whole file is.
    pub line: Option<usize>,
    /// What is wrong with it.
    pub what: String,
}

impl ObjError {
    fn new(line: usize, what: impl AsRef<str>) -> Self {
        let shown = |c: char| match c {
            '"' | '\'' | '\\' => c.to_string(),
            _ => c.escape_debug().to_string(),
        };
        let what = what.as_ref().chars().map(shown).collect();
        Self { line: Some(line), what }
    }

    fn whole(what: impl Into<String>) -> Self {
        Self { line: None, what: what.into() }
    }

    /// The error as one line, after the name of the file.
    pub fn within(&self, name: &str) -> String {
        match self.line {
            Some(line) => format!("{name}:{line}: {}", self.what),
            None => format!("{name}: {}", self.what),
        }
    }
}
