// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the text of a Wavefront OBJ to triangles near the origin.
//!
//! A `Mesh` is in the coordinates of the file, in double precision.
//! A `Scene` is the same triangles after `Frame` has brought them near
//! the origin, without rounding.

pub mod encoding;
pub mod polygons;

use std::borrow::Cow;
use std::fmt;
use std::iter::{Skip, from_fn};
use std::str::SplitAsciiWhitespace;

use glam::{BVec3, DVec3};
use memchr::{memchr, memchr2};
use rayon::prelude::*;

use self::polygons::Oddity;
use crate::numerics::{cross, exponent, power_of_two, shift};

/// An indexed triangle mesh in the coordinates of its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions of the vertices, each finite; zero in place of one that
    /// was not, which no face has.
    pub vertices: Vec<DVec3>,
    /// Three indices into `vertices` for each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// The triangles, in ascending order, that belong to the same face as
    /// the one before.
    pub joined: Vec<u32>,
}

impl Mesh {
    /// The number of its face, from 0, for each triangle.
    pub fn faces(&self) -> Vec<u32> {
        let mut joined = self.joined.iter().copied().peekable();
        let mut before = 0;
        let face = |i| {
            before += u32::from(joined.next_if_eq(&i).is_some());
            i - before
        };
        (0..self.triangles.len() as u32).map(face).collect()
    }

    /// The extreme corners of the box around all triangles.
    pub fn corners(&self) -> [DVec3; 2] {
        let used = self.triangles.iter().flatten();
        let used = used.map(|&i| self.vertices[i as usize]);
        let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        used.fold(none, |[low, high], p| [low.min(p), high.max(p)])
    }
}

/// Reads the mesh that the bytes `source` of a Wavefront OBJ describe,
/// which may be compressed.
/// Convex faces become fans of triangles around their first corner.
///
/// # Errors
/// Text that is empty, binary, malformed or without any face, faces with
/// fewer than three corners or with corners that do not exist or are not
/// finite, more vertices than 32 bits can count or triangles than 30,
/// compressed files that are damaged.
pub fn read_obj(source: &[u8]) -> Result<Mesh, ObjError> {
    Ok(read_file(source)?.0)
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
    let start = without_padding(start);
    refuse_zero(start)?;
    let last = cut(start, PIECE).pop().map_or(0, <[u8]>::len);
    let piece = &start[..start.len() - last];
    let mesh = read_piece(piece, 0, i64::MAX as usize)
        .map_err(|(line, what)| ObjError::new(line, what))?;
    let size = start.len().div_ceil(1 << 20);
    let what = format!("no vertex in the first {size} MiB");
    let first = mesh.vertices.first();
    first.map(drop).ok_or_else(|| ObjError::whole(&what))
}

fn refuse_zero(source: &[u8]) -> Result<(), ObjError> {
    let Some(at) = memchr(0, source) else { return Ok(()) };
    let line = 1 + count(&source[..at]).1.line;
    let what = "a zero byte: this is a binary file, not an OBJ";
    Err(ObjError::new(line, what.to_owned()))
}

/// The same as `read_file`, whatever the number of bytes `size` after which
/// the text is cut.
pub fn read_pieces(
    source: &[u8],
    size: usize,
) -> Result<(Mesh, Vec<ObjError>), ObjError> {
    let mut warnings = vec![];
    let warn = &mut |what: &str| warnings.push(ObjError::whole(what));
    let text = encoding::text(source, warn);
    let text = text.map_err(|what| ObjError::whole(&what))?;
    // Refuse an empty file
    if text.is_empty() {
        let what = "the file is empty; an OBJ was expected";
        return Err(ObjError::whole(what));
    }
    let source = without_padding(&text);
    refuse_zero(source)?;
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
        read_piece(piece, first, vertices)
            .map_err(|(at, what)| ObjError::new(line + at, what))
    };
    let parts: Vec<_> = pieces.par_iter().zip(&before).map(read).collect();
    let parts = parts.into_iter().collect::<Result<Vec<_>, _>>()?;
    // Put the meshes one behind the other
    // Number the joined triangles anew
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
        let is_crossed =
            |(_, oddity): &&(u32, _)| *oddity == Oddity::Crossed;
        let crossed = odd.iter().filter(is_crossed).count();
        let (n, bent) = (odd.len(), odd.len() - crossed);
        let what = format!(
            "the first of {n} odd faces ({bent} bent, {crossed} crossed); \
             other programs may fill them differently"
        );
        let (line, _) = find(source, b"f", face as usize);
        warnings.push(ObjError::new(line, what));
    }
    Ok((mesh, warnings))
}

/// The text without zeros, marks and blanks behind it, if there is text.
fn without_padding(source: &[u8]) -> &[u8] {
    let pads = |c: &u8| matches!(*c, 0 | END) || c.is_ascii_whitespace();
    let end = source.iter().rposition(|c| !pads(c));
    &source[..end.map_or(source.len(), |last| last + 1)]
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
    // Refuse a face with a corner that is not finite
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
    is_few.then_some(()).ok_or_else(|| ObjError::whole(&what))
}

/// Triangles at most: a leaf has 30 bits for the number of a face.
const MOST: u32 = 1 << 30;

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

    /// Counts a statement without use, unless it is known to have no shape.
    fn pass_by(&mut self, statement: &[u8]) {
        let name = statement.split(u8::is_ascii_whitespace).next();
        let name = name.unwrap_or_default();
        if !SILENT.split(|c| *c == b' ').any(|word| word == name) {
            let name = String::from_utf8_lossy(&name[..name.len().min(40)]);
            let first = || (self.line, name.into_owned());
            self.first.get_or_insert_with(first);
            self.unused += 1;
        }
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
            let is_blank = u8::is_ascii_whitespace;
            match &*whole {
                [b'v' | b'f'] => return Some(whole),
                [b'v' | b'f', c, ..] if is_blank(c) => return Some(whole),
                [b'v', b't' | b'n', c, ..]
                | [b'g' | b'o' | b's', c, ..]
                    if is_blank(c) => {}
                [] | [b'#', ..] => {}
                _ => self.pass_by(&whole),
            }
        }
    }
}

/// Statements that say nothing about what faces cover.
const SILENT: &[u8] = b"usemtl vt vn g o s mtllib vp mg lod shadow_obj \
    trace_obj bevel c_interp d_interp maplib usemap ctech stech deg bmat \
    step parm trim hole scrv sp end con";

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

fn is_vertex(statement: &[u8]) -> bool {
    statement.first() == Some(&b'v')
}

/// The number of vertices in a piece, and its statements at their end.
fn count(piece: &[u8]) -> (usize, Statements<'_>) {
    let mut all = Statements::of(piece);
    let vertices = all.by_ref().filter(|text| is_vertex(text)).count();
    // Do not count a line that the next piece has
    let is_within = |&last| !matches!(last, b'\n' | b'\r');
    all.line -= usize::from(piece.last().is_some_and(is_within));
    (vertices, all)
}

/// The mesh of a piece that follows `first` of `total` vertices, or
/// the line of the piece that is at fault and what is wrong with it.
fn read_piece(
    piece: &[u8],
    first: usize,
    total: usize,
) -> Result<Mesh, (usize, String)> {
    let mut mesh = Mesh::default();
    let mut statements = Statements::of(piece);
    while let Some(text) = statements.next() {
        let vertices = [first + mesh.vertices.len(), total];
        // Read the statement, once more before its comment
        let begun = [mesh.triangles.len(), mesh.joined.len()];
        if read_statement(&text, vertices, &mut mesh).is_err() {
            mesh.triangles.truncate(begun[0]);
            mesh.joined.truncate(begun[1]);
            before_comment(&text)
                .and_then(|text| read_statement(&text, vertices, &mut mesh))
                .map_err(|what| (statements.line, what))?;
        }
    }
    Ok(mesh)
}

/// A statement without its comment, and with one blank between words.
#[cold]
fn before_comment(text: &[u8]) -> Result<Vec<u8>, String> {
    let end = memchr(b'#', text).unwrap_or(text.len());
    let words = letters(&text[..end])?.split_whitespace();
    Ok(words.collect::<Vec<_>>().join(" ").into_bytes())
}

fn letters(text: &[u8]) -> Result<&str, String> {
    std::str::from_utf8(text).map_err(|_| "not UTF-8 text".to_owned())
}

fn read_statement(
    text: &[u8],
    vertices: [usize; 2],
    mesh: &mut Mesh,
) -> Result<(), String> {
    let words = letters(text)?.split_ascii_whitespace().skip(1);
    match is_vertex(text) {
        true => read_vertex(words).map(|p| mesh.vertices.push(p)),
        false => read_face(words, vertices, mesh),
    }
}

type Words<'a> = Skip<SplitAsciiWhitespace<'a>>;

fn read_vertex(mut words: Words) -> Result<DVec3, String> {
    let mut position = [0.; 3];
    for (axis, value) in ["x", "y", "z"].iter().zip(&mut position) {
        // Read the coordinate along the axis
        let Some(word) = words.next() else {
            return Err(format!("a vertex without {axis}"));
        };
        let number = word.parse::<f64>();
        *value =
            number.map_err(|_| format!("{axis} = {word} is no number"))?;
    }
    match words.find(|word| word.parse::<f64>().is_err()) {
        Some(word) => Err(format!("{word} is no number")),
        None => Ok(position.into()),
    }
}

/// Appends the fan of the face whose corners are `words`.
fn read_face(
    words: Words,
    vertices: [usize; 2],
    mesh: &mut Mesh,
) -> Result<(), String> {
    let (mut n, mut fan) = (0, [0; 3]);
    for word in words {
        // Move the fan on to the next corner
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
        // Refuse a corner that does not exist
        Ok(n) if n < 0 && n.unsigned_abs() > so_far as u64 => {
            Err(format!("corner {n}, but only {so_far} vertices so far"))
        }
        Ok(n) if n > total as i64 => {
            Err(format!("corner {n}, but only {total} vertices"))
        }
        Ok(n) if n < 0 => Ok((so_far as i64 + n) as u32),
        Ok(n) => Ok((n - 1) as u32),
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
    fn new(line: usize, what: String) -> Self {
        let shown = |c: char| match c {
            '"' | '\'' | '\\' => c.to_string(),
            _ => c.escape_debug().to_string(),
        };
        Self { line: Some(line), what: what.chars().map(shown).collect() }
    }

    fn whole(what: &str) -> Self {
        Self { line: None, what: what.to_owned() }
    }

    /// The error as one line, after the name of the file.
    pub fn within(&self, name: &str) -> String {
        match self.line {
            Some(line) => format!("{name}:{line}: {}", self.what),
            None => format!("{name}: {}", self.what),
        }
    }
}

impl fmt::Display for ObjError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.within("OBJ"))
    }
}

impl std::error::Error for ObjError {}

/// The map from the coordinates of the file to those of the scene.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// The least corner of the scene's box, times `part`; zero along an
    /// axis that is only scaled.
    low: DVec3,
    /// One half, or one.
    part: f64,
    /// The scale is 2^`exponent` times `part`.
    exponent: i32,
    /// Half of the scene's box, in the scene; zero along an axis
    /// that is only scaled.
    half: DVec3,
}

impl Frame {
    /// Where the point `p` of the file lies in the scene.
    pub fn apply(&self, p: DVec3) -> DVec3 {
        self.within(p, 0)
    }

    /// The same, times 2^`-k`.
    fn within(&self, p: DVec3, k: i32) -> DVec3 {
        let p = p * self.part;
        let offset = p - self.low;
        let lost = lost(p, self.low, offset);
        let whole = shift(offset, self.exponent - k) - shift(self.half, -k);
        whole + shift(lost, self.exponent - k)
    }

    /// Along which axes the map rounds the place of `p`.
    fn rounds(&self, p: DVec3) -> BVec3 {
        let p = p * self.part;
        let offset = p - self.low;
        let scaled = shift(offset, self.exponent);
        let place = scaled - self.half;
        lost(p, self.low, offset).cmpne(DVec3::ZERO)
            | lost(scaled, self.half, place).cmpne(DVec3::ZERO)
    }

    /// Where the point `p` of the file lies in the scene, in units of
    /// 2^`k`; and `k`, which is 0 up to a distance of 2^`FAR`.
    fn place_afar(&self, p: DVec3) -> (DVec3, i32) {
        let offset = p * self.part - self.low;
        let distance = exponent(offset.abs().max_element()) + self.exponent;
        let k = (distance - FAR).max(0);
        (self.within(p, k), k)
    }
}

/// What the difference of `a` and `b` has lost when it was rounded.
fn lost(a: DVec3, b: DVec3, difference: DVec3) -> DVec3 {
    let back = difference - a;
    (a - (difference - back)) - (b + back)
}

/// The frame of a box given by two opposite corners, which may be moved
/// along the axes `moved`.
fn frame(low: DVec3, high: DVec3, moved: BVec3) -> Frame {
    let longest = (0.5 * high - 0.5 * low).max_element();
    let farthest = low.abs().max(high.abs()).max_element();
    let is_small =
        longest < power_of_two(-900) && farthest < power_of_two(-800);
    let part = if is_small { 1. } else { 0.5 };
    let (low, high) = (low * part, high * part);
    // Scale the frame by its largest coordinate
    let reach = 2. * low.abs().max(high.abs());
    let size = DVec3::select(moved, high - low, reach);
    let exponent = match size.max_element() {
        0. => 0,
        longest => EXTENT + 1 - exponent(longest),
    };
    let half = 0.5 * shift(size, exponent);
    let only = |v: DVec3| DVec3::select(moved, v, DVec3::ZERO);
    Frame { low: only(low), part, exponent, half: only(half) }
}

/// Binary exponent of the largest coordinate of a scene.
pub const EXTENT: i32 = 12;

/// The corners of a triangle, in the coordinates of the scene.
pub type Triangle = [DVec3; 3];

/// Triangles that share their corners, in the coordinates of the scene.
#[derive(Clone, Debug, Default)]
pub struct Triangles {
    /// The corners.
    pub vertices: Vec<DVec3>,
    /// Three indices into `vertices` for each triangle.
    pub corners: Vec<[u32; 3]>,
    /// The face of each triangle in the mesh.
    pub faces: Vec<u32>,
}

impl Triangles {
    /// How many.
    pub fn len(&self) -> usize {
        self.corners.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.corners.is_empty()
    }

    /// The corners of a triangle.
    #[inline(always)]
    pub fn get(&self, i: usize) -> Triangle {
        self.corners[i].map(|corner| self.vertices[corner as usize])
    }

    /// The corners of each.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Triangle> {
        (0..self.len()).map(|i| self.get(i))
    }

    /// Those that share no corner, each with its face.
    pub fn apart(triangles: &[Triangle], faces: Vec<u32>) -> Self {
        let corner = |i: u32| [3 * i, 3 * i + 1, 3 * i + 2];
        let corners = (0..triangles.len() as u32).map(corner).collect();
        Self { vertices: triangles.as_flattened().to_vec(), corners, faces }
    }

    /// Takes those triangles out of which `is_out` is true, given their
    /// number; returns their faces.
    fn leave_out(&mut self, is_out: impl Fn(usize) -> bool) -> Vec<u32> {
        let all = 0..self.len();
        let out: Vec<_> = all.map(is_out).collect();
        let gone = self.faces.iter().zip(&out).filter(|(_, out)| **out);
        let gone = gone.map(|(face, _)| *face).collect();
        let (mut first, mut second) = (out.iter(), out.iter());
        self.corners.retain(|_| first.next() == Some(&false));
        self.faces.retain(|_| second.next() == Some(&false));
        gone
    }
}

fn has_area(&[a, b, c]: &Triangle) -> bool {
    let (u, v) = (b - a, c - a);
    u.cross(v) != DVec3::ZERO || cross(u, v) != DVec3::ZERO
}

/// Triangles near the origin, with the map that brought them there.
#[derive(Clone, Debug)]
pub struct Scene {
    frame: Frame,
    /// Opposite corners of a box, slightly larger than the scene.
    bounds: [DVec3; 2],
    triangles: Triangles,
    /// The faces of triangles that were left out for having no area.
    flat: Vec<u32>,
    /// Those of triangles that were left out as copies.
    copies: Vec<u32>,
}

impl Scene {
    /// The scene of a mesh; a mesh without triangles is an empty scene.
    pub fn new(mesh: &Mesh) -> Self {
        Self::of(mesh.clone())
    }

    /// The same, which uses the mesh up.
    pub fn of(mesh: Mesh) -> Self {
        let faces = mesh.faces();
        let Mesh { vertices, triangles: corners, .. } = mesh;
        let mut triangles = Triangles { vertices, corners, faces };
        // Find the box of the triangles
        let all = &triangles;
        let bounds = (0..all.len()).into_par_iter().map(|i| {
            let [a, b, c] = all.get(i);
            (a.min(b).min(c), a.max(b).max(c))
        });
        let (low, high) = bounds
            .reduce_with(|a, b| (a.0.min(b.0), a.1.max(b.1)))
            .unwrap_or_default();
        let (low, high) = (low + DVec3::ZERO, high + DVec3::ZERO);
        // Choose the frame
        let moved = frame(low, high, BVec3::TRUE);
        let corners = all.corners.par_iter().flatten_iter();
        let rounds =
            corners.map(|&i| moved.rounds(all.vertices[i as usize]));
        let rounds = rounds.reduce(|| BVec3::FALSE, |a, b| a | b);
        let frame = frame(low, high, !rounds);
        // Place the vertices
        let place = |p: &mut DVec3| {
            let placed = frame.apply(*p) + DVec3::ZERO;
            let tiny = placed.abs().cmplt(DVec3::splat(TINY));
            *p = DVec3::select(tiny, DVec3::ZERO, placed);
        };
        triangles.vertices.par_iter_mut().for_each(place);
        // Leave out the triangles without area
        let mut flat = vec![];
        let all = &triangles;
        let numbers = (0..all.len()).into_par_iter();
        if !numbers.clone().all(|i| has_area(&all.get(i))) {
            let old = triangles.clone();
            flat = triangles.leave_out(|i| !has_area(&old.get(i)));
        }
        // Leave out the copies
        let found = copies(&triangles);
        let is_copy = |i: usize| found.binary_search(&i).is_ok();
        let copies = match found.is_empty() {
            true => vec![],
            false => triangles.leave_out(is_copy),
        };
        let margin = DVec3::ONE;
        let bounds =
            [frame.apply(low) - margin, frame.apply(high) + margin];
        Self { frame, bounds, triangles, flat, copies }
    }

    /// The triangles that have an area, in the order of the mesh, without
    /// copies.
    pub fn triangles(&self) -> Vec<Triangle> {
        self.triangles.iter().collect()
    }

    /// The same, as they share their corners.
    pub fn indexed(&self) -> &Triangles {
        &self.triangles
    }

    /// Hands the triangles over, for a hierarchy to use up; the scene has
    /// none afterwards.
    pub fn take_triangles(&mut self) -> Triangles {
        std::mem::take(&mut self.triangles)
    }

    /// The faces, from 0, of the triangles that were left out because they
    /// have no area, and because others have the same corners.
    pub fn left_out(&self) -> (&[u32], &[u32]) {
        (&self.flat, &self.copies)
    }

    /// Where a point of the file lies in the scene; none if it is more
    /// than 2^`NEARBY` away.
    pub fn place(&self, point: DVec3) -> Option<DVec3> {
        let placed = self.frame.apply(point);
        let nearby = placed.abs().max_element() <= NEARBY;
        nearby.then_some(placed)
    }

    /// Where rays that start at a point of the file enter the scene.
    pub fn entrance(&self, position: DVec3) -> Entrance {
        let (origin, k) = self.frame.place_afar(position);
        let afar = self.bounds.map(|corner| shift(corner, -k));
        let is_inside = is_between(origin, afar);
        Entrance { origin, k, afar, bounds: self.bounds, is_inside }
    }

    /// The ray that starts at the point `position` of the file, from where
    /// it enters the scene; none if it passes the scene by.
    pub fn enter(&self, position: DVec3, direction: DVec3) -> Option<Ray> {
        self.entrance(position).enter(direction)
    }
}

/// Coordinates that are smaller count as zero: 2^-100.
const TINY: f64 = f64::from_bits((1023 - 100) << 52);

/// The numbers, in ascending order, of triangles that have the same
/// corners as an earlier one.
fn copies(triangles: &Triangles) -> Vec<usize> {
    if triangles.len() > NUMBERS as usize {
        return vec![];
    }
    // Sort the keys of the triangles
    let key =
        |i: usize| mixed(&triangles.get(i)) & !(NUMBERS - 1) | i as u64;
    let keys = (0..triangles.len()).into_par_iter().map(key);
    let mut keys: Vec<u64> = keys.collect();
    keys.par_sort_unstable();
    let groups = keys.chunk_by(|a, b| a / NUMBERS == b / NUMBERS);
    let mut copies: Vec<usize> = vec![];
    for group in groups.filter(|group| group.len() > 1) {
        // Find the copies in a group
        let mut others: Vec<[[u64; 3]; 3]> = vec![];
        for key in group {
            let i = (key % NUMBERS) as usize;
            let corners = sorted(&triangles.get(i));
            match others.contains(&corners) {
                true => copies.push(i),
                false => others.push(corners),
            }
        }
    }
    copies.sort_unstable();
    copies
}

/// One more than the greatest number of a triangle in a key.
const NUMBERS: u64 = 1 << 29;

/// A number that depends on the corners of a triangle, in any order.
fn mixed(triangle: &Triangle) -> u64 {
    let sum = triangle.iter().map(scattered).fold(0, u64::wrapping_add);
    sum.wrapping_mul(0x94d0_49bb_1331_11eb)
}

/// A number that depends on all bits of a corner.
pub fn scattered(corner: &DVec3) -> u64 {
    let [x, y, z] = corner.to_array().map(f64::to_bits);
    let first = (x ^ y.rotate_left(32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let second =
        (y ^ z.rotate_left(32)).wrapping_mul(0xd1b5_4a32_d192_ed03);
    let both = first ^ first >> 32 ^ second;
    let mixed = both.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed ^ mixed >> 31
}

/// The corners of a triangle, as bits, in order.
fn sorted(triangle: &Triangle) -> [[u64; 3]; 3] {
    let mut corners = triangle.map(|p| p.to_array().map(f64::to_bits));
    corners.sort_unstable();
    corners
}

/// A half line, in the coordinates of the scene.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes; of length one.
    pub direction: DVec3,
}

/// Up to here a point has a place among the triangles: 2^32 units.
const NEARBY: f64 = (1u64 << 32) as f64;

/// Binary exponent of the distance at which units become larger.
const FAR: i32 = 1000;

/// What rays that start at one point of the file have in common.
pub struct Entrance {
    /// The point, in units of 2^`k`.
    origin: DVec3,
    k: i32,
    /// The box around the scene in these units, and in those of the scene.
    afar: [DVec3; 2],
    bounds: [DVec3; 2],
    /// Whether the point lies in the box.
    pub is_inside: bool,
}

impl Entrance {
    /// The ray in this direction, from where it enters the scene; none if
    /// it passes the scene by.
    pub fn enter(&self, direction: DVec3) -> Option<Ray> {
        let &Entrance { origin, afar: [low, high], .. } = self;
        if self.is_inside {
            return Some(Ray { origin, direction });
        }
        // Find where a ray is in the box of the scene
        let up = direction.signum().cmpgt(DVec3::ZERO);
        let near = DVec3::select(up, low, high);
        let far = DVec3::select(up, high, low);
        let enters = ((near - origin) / direction).to_array();
        let leaves = ((far - origin) / direction).to_array();
        let start = enters.into_iter().fold(0., f64::max);
        let end = leaves.into_iter().fold(f64::INFINITY, f64::min);
        if start > end * (1. + f64::EPSILON * 8.) {
            return None;
        }
        let point = shift(origin + direction * start, self.k);
        let [low, high] = self.bounds;
        Some(Ray { origin: point.clamp(low, high), direction })
    }
}

/// Whether a point lies in the box between two corners.
fn is_between(point: DVec3, [low, high]: [DVec3; 2]) -> bool {
    (point.cmpge(low) & point.cmple(high)).all()
}

#[cfg(test)]
mod tests {
    use super::{MOST, countable};

    #[test]
    fn more_than_can_be_numbered_is_refused() {
        let most = MOST as usize;
        let countable = |n, what| countable(n, what, MOST);
        assert_eq!(countable(most, "vertices"), Ok(()));
        let error = countable(most + 1, "vertices").unwrap_err();
        let words = "x: 1073741825 vertices, of which only 1073741824 \
                     can be numbered";
        assert_eq!(error.within("x"), words);
    }
}
