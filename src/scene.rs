// Licensed under the GPL, version 3 or later
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
//! the origin, in single precision.

pub mod encoding;
pub mod polygons;

// Name what the scene imports
use std::borrow::Cow;
use std::fmt;
use std::iter::Skip;
use std::str::SplitWhitespace;

use glam::{DVec3, Vec3};
use memchr::{memchr, memchr_iter};
use rayon::prelude::*;

use self::polygons::Oddity;
use crate::numerics::{cross, exponent, power_of_two, shift};

// Represent a mesh as it was read
/// An indexed triangle mesh in the coordinates of its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions of the vertices, each finite.
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
}

// Read the text of an OBJ
/// Reads the mesh that the bytes `source` of a Wavefront OBJ describe,
/// which may be compressed.
/// Convex faces become fans of triangles around their first corner.
///
/// # Errors
/// Text that is empty, binary, malformed or without any face, vertices
/// that are not finite, faces with fewer than three corners or with
/// corners that do not exist, more vertices or triangles than 32 bits
/// can count, compressed files that are damaged.
pub fn read_obj(source: &[u8]) -> Result<Mesh, ObjError> {
    read_pieces(source, PIECE)
}

/// The same mesh, or error, as that of `read_obj`, whatever the number
/// of bytes `size` after which the text is cut.
pub fn read_pieces(source: &[u8], size: usize) -> Result<Mesh, ObjError> {
    Ok(read(source, size)?.0)
}

/// The same as `read_obj`, with a warning, made like an error, if there
/// are faces that are no polygons.
pub fn read_file(
    source: &[u8],
) -> Result<(Mesh, Option<ObjError>), ObjError> {
    read(source, PIECE)
}

/// The size of a piece of the text.
const PIECE: usize = 1 << 20;

fn read(
    source: &[u8],
    size: usize,
) -> Result<(Mesh, Option<ObjError>), ObjError> {
    let text = encoding::text(source);
    let text = text.map_err(|what| ObjError::whole(&what))?;
    let source = &text[..];
    // Refuse empty and binary files
    let source = source.strip_prefix(b"\xef\xbb\xbf").unwrap_or(source);
    if source.is_empty() {
        return Err(ObjError::whole(
            "the file is empty; an OBJ was expected",
        ));
    }
    if let Some(at) = memchr(0, source) {
        let line = 1 + memchr_iter(b'\n', &source[..at]).count();
        let what = "a zero byte: this is a binary file, not an OBJ";
        return Err(ObjError::new(line, what.to_owned()));
    }
    let pieces = cut(source, size);
    // Count what comes before each piece
    let counts: Vec<_> = pieces.par_iter().map(|p| count(p)).collect();
    let (mut vertices, mut lines) = (0, 0);
    let mut before = Vec::with_capacity(counts.len());
    for (more_vertices, more_lines) in counts {
        before.push((vertices, lines));
        vertices += more_vertices;
        lines += more_lines;
    }
    countable(vertices, "vertices")?;
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
    let (vertices, mut triangles) =
        rayon::join(|| append(vertices), || append(triangles));
    countable(triangles.len(), "triangles")?;
    if triangles.is_empty() {
        return Err(ObjError::whole("no face, hence nothing to render"));
    }
    // Fill the faces, and warn of odd ones
    let odd = polygons::fill(&vertices, &mut triangles, &mut joined);
    countable(triangles.len(), "triangles")?;
    let warning = odd.first().map(|&(face, _)| {
        let is_crossed =
            |(_, oddity): &&(u32, _)| *oddity == Oddity::Crossed;
        let crossed = odd.iter().filter(is_crossed).count();
        let what = format!(
            "the first of {} odd faces ({} bent, {crossed} crossed); \
             other programs may fill them differently",
            odd.len(),
            odd.len() - crossed
        );
        ObjError::new(line_of_face(source, face), what)
    });
    Ok((Mesh { vertices, triangles, joined }, warning))
}

/// The line of the statement that gives a face, counted from 0.
fn line_of_face(source: &[u8], face: u32) -> usize {
    let mut statements = Statements { rest: source, line: 0 };
    let faces = statements.by_ref().filter(|text| !is_vertex(text));
    faces.take(face as usize + 1).for_each(drop);
    statements.line
}

/// The elements of all `parts`, in order, in just enough memory.
fn append<T>(parts: Vec<Vec<T>>) -> Vec<T> {
    let mut whole = Vec::with_capacity(parts.iter().map(Vec::len).sum());
    for mut part in parts {
        whole.append(&mut part);
    }
    whole
}

/// Refuses more elements than an index of 32 bits can name.
fn countable(n: usize, what: &str) -> Result<(), ObjError> {
    match u32::try_from(n) {
        Ok(_) => Ok(()),
        Err(_) => Err(ObjError::whole(&format!(
            "{n} {what}, of which only {} can be numbered",
            u32::MAX
        ))),
    }
}

// Cut the text after whole statements
/// The text in pieces, each of whole statements and, but for the last,
/// longer than `size` bytes.
fn cut(mut source: &[u8], size: usize) -> Vec<&[u8]> {
    let mut pieces = Vec::new();
    while !source.is_empty() {
        let start = size.min(source.len());
        let end = memchr_iter(b'\n', &source[start..])
            .map(|newline| start + newline)
            .find(|&newline| !continues(&source[..newline]))
            .map_or(source.len(), |newline| newline + 1);
        let (piece, rest) = source.split_at(end);
        pieces.push(piece);
        source = rest;
    }
    pieces
}

/// Whether the last line of `text` ends in a backslash.
fn continues(text: &[u8]) -> bool {
    let blank = |byte: &u8| matches!(byte, b' ' | b'\t' | b'\r' | b'\x0c');
    text.iter().rev().find(|byte| !blank(byte)) == Some(&b'\\')
}

/// The statements that give vertices and faces, one by one.
struct Statements<'a> {
    /// What was not yet looked at.
    rest: &'a [u8],
    /// Number of lines looked at; that of the statement's last line.
    line: usize,
}

impl<'a> Statements<'a> {
    /// The next line, without its end and the blanks before it.
    fn line(&mut self) -> Option<&'a [u8]> {
        if self.rest.is_empty() {
            return None;
        }
        let newline = memchr(b'\n', self.rest);
        let end = newline.map_or(self.rest.len(), |at| at + 1);
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        self.line += 1;
        Some(line.trim_ascii_end())
    }

    // Join a line with its continuations
    /// The line `first` and what continues it.
    fn join(&mut self, first: &[u8]) -> Vec<u8> {
        let mut whole = Vec::new();
        let mut line = first;
        while let Some(text) = line.strip_suffix(b"\\") {
            whole.extend_from_slice(text);
            line = self.line().unwrap_or_default();
        }
        whole.extend_from_slice(line);
        whole
    }
}

impl<'a> Iterator for Statements<'a> {
    type Item = Cow<'a, [u8]>;

    fn next(&mut self) -> Option<Cow<'a, [u8]>> {
        loop {
            let line = self.line()?;
            // Make the line a whole statement
            let whole = match line {
                [.., b'\\'] => Cow::Owned(self.join(line)),
                _ => Cow::Borrowed(line),
            };
            if matters(&whole) {
                return Some(whole);
            }
        }
    }
}

/// Whether this is a statement `v` or `f`.
fn matters(statement: &[u8]) -> bool {
    match statement.trim_ascii_start() {
        [b'v' | b'f', blank, ..] => blank.is_ascii_whitespace(),
        [b'v' | b'f'] => true,
        _ => false,
    }
}

// Read one piece of the text
fn is_vertex(statement: &[u8]) -> bool {
    statement.trim_ascii_start().first() == Some(&b'v')
}

/// The numbers of vertices and of lines in a piece.
fn count(piece: &[u8]) -> (usize, usize) {
    let mut statements = Statements { rest: piece, line: 0 };
    let all = statements.by_ref();
    (all.filter(|text| is_vertex(text)).count(), statements.line)
}

/// The mesh of a piece that follows `first` of `total` vertices, or
/// the line of the piece that is at fault and what is wrong with it.
fn read_piece(
    piece: &[u8],
    first: usize,
    total: usize,
) -> Result<Mesh, (usize, String)> {
    let mut mesh = Mesh::default();
    let mut statements = Statements { rest: piece, line: 0 };
    while let Some(text) = statements.next() {
        let vertices = [first + mesh.vertices.len(), total];
        // Read the statement, once more before its comment
        let begun = mesh.triangles.len();
        if let Err(what) = read_statement(&text, vertices, &mut mesh) {
            mesh.triangles.truncate(begun);
            mesh.joined.retain(|&i| (i as usize) < begun);
            read_before_comment(&text, vertices, &mut mesh)
                .unwrap_or(Err(what))
                .map_err(|what| (statements.line, what))?;
        }
    }
    Ok(mesh)
}

/// Reads a statement up to its comment; none if it has no comment.
#[cold]
fn read_before_comment(
    text: &[u8],
    [first, total]: [usize; 2],
    mesh: &mut Mesh,
) -> Option<Result<(), String>> {
    let text = &text[..memchr(b'#', text)?];
    let append = |part: Mesh| {
        let begun = mesh.triangles.len() as u32;
        mesh.joined.extend(part.joined.iter().map(|i| begun + i));
        mesh.triangles.extend(part.triangles);
        mesh.vertices.extend(part.vertices);
    };
    let read = read_piece(text, first, total);
    Some(read.map(append).map_err(|(_, what)| what))
}

fn read_statement(
    text: &[u8],
    vertices: [usize; 2],
    mesh: &mut Mesh,
) -> Result<(), String> {
    let is_vertex = is_vertex(text);
    let Ok(text) = std::str::from_utf8(text) else {
        return Err("not UTF-8 text".to_owned());
    };
    let words = text.split_whitespace().skip(1);
    if is_vertex {
        mesh.vertices.push(read_vertex(words)?);
        return Ok(());
    }
    read_face(words, vertices, mesh)
}

// Read the numbers of a statement
type Words<'a> = Skip<SplitWhitespace<'a>>;

fn read_vertex(mut words: Words) -> Result<DVec3, String> {
    let mut position = [0.; 3];
    for (axis, value) in ["x", "y", "z"].iter().zip(&mut position) {
        // Read the coordinate along the axis
        let Some(word) = words.next() else {
            return Err(format!("a vertex without {axis}"));
        };
        *value = match word.parse::<f64>() {
            Ok(value) if value.is_finite() => value,
            Ok(_) => return Err(format!("{axis} = {word} is not finite")),
            Err(_) => return Err(format!("{axis} = {word} is no number")),
        };
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

// Say what is wrong, and where
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
        Self { line: Some(line), what }
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

// Bring the scene to the origin
/// The map from the coordinates of the file to those of the scene.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// The least corner of the scene's box, times `part`.
    low: DVec3,
    /// One half, or one.
    part: f64,
    /// The scale is 2^`exponent` times `part`.
    exponent: i32,
    /// Half extents of the scene's box, in the scene.
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
        // Find what the subtraction rounded away
        let back = offset - p;
        let lost = (p - (offset - back)) - (self.low + back);
        let whole = shift(offset, self.exponent - k) - shift(self.half, -k);
        whole + shift(lost, self.exponent - k)
    }

    // Place a point however far away
    /// Where the point `p` of the file lies in the scene, in units of
    /// 2^`k`; and `k`, which is 0 up to a distance of 2^`FAR`.
    fn place_afar(&self, p: DVec3) -> (DVec3, i32) {
        let offset = p * self.part - self.low;
        let distance = exponent(offset.abs().max_element()) + self.exponent;
        let k = (distance - FAR).max(0);
        (self.within(p, k), k)
    }
}

/// The frame of a box given by two opposite corners.
fn frame(low: DVec3, high: DVec3) -> Frame {
    let longest = (0.5 * high - 0.5 * low).max_element();
    let farthest = low.abs().max(high.abs()).max_element();
    let is_small =
        longest < power_of_two(-900) && farthest < power_of_two(-800);
    let part = if is_small { 1. } else { 0.5 };
    let (low, high) = (low * part, high * part);
    let size = high - low;
    let exponent = match size.max_element() {
        0. => 0,
        longest => EXTENT + 1 - exponent(longest),
    };
    let half = 0.5 * shift(size, exponent);
    Frame { low, part, exponent, half }
}

/// Binary exponent of the largest half extent of a scene.
pub const EXTENT: i32 = 12;

/// The corners of a triangle, in the coordinates of the scene.
pub type Triangle = [Vec3; 3];

/// Triangles near the origin, with the map that brought them there.
#[derive(Clone, Debug)]
pub struct Scene {
    frame: Frame,
    /// Half extents of a box around the origin, slightly larger than
    /// the scene.
    half: DVec3,
    triangles: Vec<Triangle>,
    /// The face of each triangle in the mesh.
    faces: Vec<u32>,
    /// The faces of triangles that were left out for having no area.
    flat: Vec<u32>,
    /// Those of triangles that were left out as copies.
    copies: Vec<u32>,
}

fn has_area(triangle: &Triangle) -> bool {
    let [a, b, c] = triangle.map(|corner| corner.as_dvec3());
    let (u, v) = (b - a, c - a);
    u.cross(v) != DVec3::ZERO || cross(u, v) != DVec3::ZERO
}

impl Scene {
    /// The scene of a mesh; a mesh without triangles is an empty scene.
    pub fn new(mesh: &Mesh) -> Self {
        let corner = |&i: &u32| mesh.vertices[i as usize];
        let corners = |t: &[u32; 3]| t.each_ref().map(corner);
        // Find the box of the triangles
        let bounds = mesh
            .triangles
            .par_iter()
            .map(corners)
            .map(|[a, b, c]| (a.min(b).min(c), a.max(b).max(c)));
        let (low, high) = bounds
            .reduce_with(|a, b| (a.0.min(b.0), a.1.max(b.1)))
            .unwrap_or_default();
        let (low, high) = (low + DVec3::ZERO, high + DVec3::ZERO);
        let frame = frame(low, high);
        let place =
            |corner: DVec3| frame.apply(corner).as_vec3() + Vec3::ZERO;
        let place = |corners: [DVec3; 3]| corners.map(place);
        // Place the triangles that have an area
        let all = mesh.triangles.par_iter().map(corners).map(place);
        let mut triangles: Vec<Triangle> = all.collect();
        let mut faces = mesh.faces();
        let mut flat = vec![];
        if !triangles.par_iter().all(has_area) {
            let is_flat = |_, triangle: &_| !has_area(triangle);
            flat = leave_out(&mut triangles, &mut faces, is_flat);
        }
        let found = copies(&triangles);
        let is_copy = |i: usize, _: &_| found.binary_search(&i).is_ok();
        let copies = match found.is_empty() {
            true => vec![],
            false => leave_out(&mut triangles, &mut faces, is_copy),
        };
        let half = frame.apply(high) + DVec3::ONE;
        Self { frame, half, triangles, faces, flat, copies }
    }

    /// The triangles that have an area, in the order of the mesh.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    // Leave triangles out of the scene
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

    /// The face in the mesh, from 0, of each triangle.
    pub fn faces(&self) -> &[u32] {
        &self.faces
    }

    /// Hands the triangles and their faces over, for a hierarchy to use
    /// up; the scene has none afterwards.
    pub fn take_triangles(&mut self) -> (Vec<Triangle>, Vec<u32>) {
        let triangles = std::mem::take(&mut self.triangles);
        (triangles, std::mem::take(&mut self.faces))
    }

    // Move a distant ray to the scene
    /// The ray that starts at the point `position` of the file, from where
    /// it enters the scene; none if it passes the scene by.
    pub fn enter(&self, position: DVec3, direction: DVec3) -> Option<Ray> {
        let (origin, k) = self.frame.place_afar(position);
        let half = shift(self.half, -k);
        if origin.abs().cmple(half).all() {
            return Some(Ray { origin, direction });
        }
        let near = -direction.signum() * half;
        let enters = ((near - origin) / direction).to_array();
        let leaves = ((-near - origin) / direction).to_array();
        let start = enters.into_iter().fold(0., f64::max);
        let end = leaves.into_iter().fold(f64::INFINITY, f64::min);
        if start > end * (1. + f64::EPSILON * 8.) {
            return None;
        }
        let point = shift(origin + direction * start, k);
        Some(Ray { origin: point.clamp(-self.half, self.half), direction })
    }
}

/// Takes those triangles out of which `is_out` is true, given their
/// number; returns their faces.
fn leave_out(
    triangles: &mut Vec<Triangle>,
    faces: &mut Vec<u32>,
    is_out: impl Fn(usize, &Triangle) -> bool,
) -> Vec<u32> {
    let all = triangles.iter().enumerate();
    let out: Vec<_> = all.map(|(i, t)| is_out(i, t)).collect();
    let gone = faces.iter().zip(&out).filter(|(_, out)| **out);
    let gone = gone.map(|(face, _)| *face).collect();
    let (mut first, mut second) = (out.iter(), out.iter());
    triangles.retain(|_| first.next() == Some(&false));
    faces.retain(|_| second.next() == Some(&false));
    gone
}

/// The numbers, in ascending order, of triangles that have the same
/// corners as an earlier one.
fn copies(triangles: &[Triangle]) -> Vec<usize> {
    if triangles.len() > NUMBERS as usize {
        return vec![];
    }
    // Sort the keys of the triangles
    let key = |(i, triangle): (usize, &Triangle)| {
        mixed(triangle) & !(NUMBERS - 1) | i as u64
    };
    let keys = triangles.par_iter().enumerate().map(key);
    let mut keys: Vec<u64> = keys.collect();
    keys.par_sort_unstable();
    let groups = keys.chunk_by(|a, b| a / NUMBERS == b / NUMBERS);
    let mut copies: Vec<usize> = vec![];
    for group in groups.filter(|group| group.len() > 1) {
        // Find the copies in a group
        let mut others: Vec<[[u32; 3]; 3]> = vec![];
        for key in group {
            let i = (key % NUMBERS) as usize;
            let corners = sorted(&triangles[i]);
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
pub fn scattered(corner: &Vec3) -> u64 {
    let [x, y, z] = corner.to_array().map(|x| u64::from(x.to_bits()));
    let first = (x << 32 | y).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let both = first ^ first >> 32 ^ z.wrapping_mul(0xd1b5_4a32_d192_ed03);
    let mixed = both.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    mixed ^ mixed >> 31
}

/// The corners of a triangle, as bits, in order.
fn sorted(triangle: &Triangle) -> [[u32; 3]; 3] {
    let mut corners = triangle.map(|p| p.to_array().map(f32::to_bits));
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

// Test what no file of sensible size can
#[cfg(test)]
mod tests {
    use super::countable;

    #[test]
    fn more_than_32_bits_can_number_is_refused() {
        let most = u32::MAX as usize;
        assert_eq!(countable(most, "vertices"), Ok(()));
        let error = countable(most + 1, "vertices").unwrap_err();
        let words = "x: 4294967296 vertices, of which only 4294967295 \
                     can be numbered";
        assert_eq!(error.within("x"), words);
    }
}
