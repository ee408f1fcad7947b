// Tangled from chapters/scene.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the text of a Wavefront OBJ to a mesh.

use std::borrow::Cow;

use glam::DVec3;
use memchr::{memchr, memchr2, memchr2_iter, memchr3_iter};
use rayon::prelude::*;

use super::encoding::{self, quoted, shortened};
use super::mesh::{Mark, MarkKind, Mesh};
use super::polygons;

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
    read.map(|(mesh, _)| mesh).map_err(|error| format!("OBJ{error}"))
}

/// The same as `read_obj`, with warnings, made like errors: of faces that
/// are no polygons, and of what is in the file but not in the mesh.
///
/// # Errors
/// Those of `read_obj`, to be put behind the name of the file: `:7: ` and
/// what is wrong in line 7, or `: ` and what is wrong with all of it.
pub fn read_file(source: &[u8]) -> Result<(Mesh, Vec<String>), String> {
    read_pieces(source, PIECE)
}

/// The size of a piece of the text.
const PIECE: usize = 1 << 20;

/// Whether the beginning of a file may be that of an OBJ: it has a vertex,
/// or is packed.
pub fn begins_obj(start: &[u8]) -> bool {
    let is_packed = encoding::format(start).is_some();
    is_packed || lines(start).any(|line| name(line) == b"v")
}

/// The same as `read_file`, whatever the number of bytes `size` after which
/// the text is cut.
pub fn read_pieces(
    source: &[u8],
    size: usize,
) -> Result<(Mesh, Vec<String>), String> {
    let mut warnings = vec![];
    let text = encoding::text(source, &mut warnings)?;
    if text.is_empty() {
        return Err(": the file is empty; an OBJ was expected".to_owned());
    }
    if let Some(kind) = encoding::foreign(&text) {
        return Err(format!(
            ": the format is {kind}, not Wavefront OBJ: convert it, for \
             example with Blender"
        ));
    }
    let text = &join(plain(&text)?);
    let pieces = cut(text, size);
    // Count what comes before each piece
    let counts = pieces.par_iter().map(|piece| count(piece));
    let (counts, unused): (Vec<_>, Vec<_>) = counts.unzip();
    let mut total = 0;
    let sum = |n: usize| {
        total += n;
        total - n
    };
    let before: Vec<usize> = counts.into_iter().map(sum).collect();
    let unused = unused.concat();
    if let Some(&first) = unused.first() {
        let name = name(first);
        let name = String::from_utf8_lossy(&name[..name.len().min(40)]);
        let what = "statements that are not rendered";
        let what = format!("{name}, the first of {} {what}", unused.len());
        warnings.push(at(text, first, &what));
    }
    // Read each piece into a mesh
    let read = |(&piece, first)| read_piece(piece, [first, total]);
    let parts: Vec<_> = pieces.par_iter().zip(before).map(read).collect();
    let parts = parts.into_iter().collect::<Result<Vec<_>, _>>();
    let parts = parts.map_err(|(line, what)| at(text, line, &what))?;
    // Put the meshes one behind the other
    let count = parts.iter().map(|part| part.triangles.len()).sum();
    countable(total.max(count))?;
    let mut mesh = Mesh::default();
    mesh.vertices.reserve_exact(total);
    mesh.triangles.reserve_exact(count);
    for mut part in parts {
        let first = mesh.triangles.len() as u32;
        let faces = first - mesh.joined.len() as u32;
        let later = |mark: Mark| Mark { face: faces + mark.face, ..mark };
        mesh.marks.extend(part.marks.drain(..).map(later));
        mesh.joined.extend(part.joined.iter().map(|&i| first + i));
        mesh.vertices.append(&mut part.vertices);
        mesh.triangles.append(&mut part.triangles);
    }
    if mesh.triangles.is_empty() {
        return Err(
            ": no face, hence nothing to render; is it a Wavefront OBJ?"
                .to_owned(),
        );
    }
    warnings.extend(set_aside(text, &mut mesh)?);
    // Fill the faces, and warn of odd ones
    let odd = polygons::fill(&mut mesh);
    if let Some(&face) = odd.first() {
        let what =
            "odd faces, bent or crossed; other programs may fill them";
        let what = format!("the first of {} {what} differently", odd.len());
        warnings.push(at(text, find(text, b"f", face as usize), &what));
    }
    Ok((mesh, warnings))
}

/// The text without zeros, marks and blanks behind it, if there is text.
fn plain(source: &[u8]) -> Result<&[u8], String> {
    let pads = |c: &u8| matches!(*c, 0 | END) || c.is_ascii_whitespace();
    let end = source.iter().rposition(|c| !pads(c));
    let source = &source[..end.map_or(source.len(), |last| last + 1)];
    let Some(zero) = memchr(0, source) else { return Ok(source) };
    let what = "a zero byte: this is a binary file, not an OBJ";
    Err(at(source, &source[..zero], what))
}

/// Ctrl-Z, the end of a text under CP/M and DOS.
const END: u8 = 0x1a;

/// Replaces vertices that are not finite; returns a warning of them.
///
/// # Errors
/// One of them is a corner of a face.
fn set_aside(
    text: &[u8],
    Mesh { vertices, triangles, joined, .. }: &mut Mesh,
) -> Result<Option<String>, String> {
    let wrong = vertices.par_iter().positions(|p| !p.is_finite());
    let wrong: Vec<_> = wrong.collect();
    let Some(&first) = wrong.first() else { return Ok(None) };
    let corners = triangles.as_flattened();
    let bad = |&i: &u32| !vertices[i as usize].is_finite();
    if let Some(k) = corners.iter().position(bad) {
        let face = k / 3 - joined.partition_point(|&i| i as usize <= k / 3);
        let vertex = find(text, b"v", corners[k] as usize);
        let what =
            String::from_utf8_lossy(vertex).replace(BREAK as char, "");
        let line = number(text, vertex);
        let what = quoted(&what);
        let what = format!("a corner is not finite: line {line} is {what}");
        return Err(at(text, find(text, b"f", face), &what));
    }
    wrong.iter().for_each(|&i| vertices[i] = DVec3::ZERO);
    let what = "vertices that are not finite, and in no face";
    let what = format!("the first of {} {what}", wrong.len());
    Ok(Some(at(text, find(text, b"v", first), &what)))
}

/// The statement of this name with a number from 0.
fn find<'a>(text: &'a [u8], named: &[u8], number: usize) -> &'a [u8] {
    let mut all = lines(text).filter(|line| name(line) == named);
    all.nth(number).unwrap_or(text)
}

/// Refuses more elements than can be named.
fn countable(n: usize) -> Result<(), String> {
    let what = "vertices or triangles, of which only";
    let what = format!(": {n} {what} {MOST} can be numbered");
    (n <= MOST).then_some(()).ok_or(what)
}

/// Of each at most: a leaf has 30 bits for the number of a face.
const MOST: usize = 1 << 30;

#[cfg(test)]
#[path = "../../tests/units/obj.rs"]
mod tests;

/// The lines of a text, without the blanks and marks around them.
fn lines(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut start = 0;
    let ends = memchr2_iter(b'\n', b'\r', text).chain([text.len()]);
    ends.map(move |end| {
        let mut line = &text[start..end];
        start = end + 1;
        while let [0xef, 0xbb, 0xbf, rest @ ..] | [END, rest @ ..] = line {
            line = rest;
        }
        line.trim_ascii()
    })
}

/// The text with each statement in a line of its own.
fn join(source: &[u8]) -> Cow<'_, [u8]> {
    let (mut text, mut end) = (Cow::Borrowed(source), 0);
    while let Some(n) = memchr(b'\\', &source[end..]) {
        let start = end + n;
        let is_gap = |c: &&u8| **c == b'\\' || c.is_ascii_whitespace();
        end = start + source[start..].iter().take_while(is_gap).count();
        let is_end = |c: &u8| matches!(c, b'\n' | b'\r');
        let mut before = source[..start].rsplit(is_end);
        let ends =
            end == source.len() || source[start..end].iter().any(is_end);
        if ends && before.next().is_none_or(|line| !line.contains(&b'#')) {
            // Fill the gap between the lines of a statement
            let next = source.get(end);
            let goes_on =
                next.is_some_and(|c| b"0123456789-+.".contains(c));
            for i in start..end {
                text.to_mut()[i] = match source[i] {
                    b'\\' => b' ',
                    b'\r' if source[i..].starts_with(b"\r\n") => b' ',
                    b'\r' | b'\n' if goes_on => BREAK,
                    other => other,
                };
            }
        }
    }
    text
}

/// Stands for the end of a line within a statement.
const BREAK: u8 = b'\x0b';

/// The number of vertices, and the statements without use.
fn count(piece: &[u8]) -> (usize, Vec<&[u8]>) {
    let (mut vertices, mut unused) = (0, vec![]);
    for line in lines(piece) {
        match name(line) {
            b"v" => vertices += 1,
            b"f" | b"" | b"vt" | b"vn" | [b'#', ..] => {}
            other if SILENT.split(' ').any(|s| s.as_bytes() == other) => {}
            _ => unused.push(line),
        }
    }
    (vertices, unused)
}

/// The first word of a statement.
fn name(line: &[u8]) -> &[u8] {
    line.split(u8::is_ascii_whitespace).next().unwrap_or_default()
}

/// Statements that say how faces look or are called, or belong to a shape
/// of which another statement is told.
const SILENT: &str = "g o s usemtl mtllib vp mg lod shadow_obj trace_obj \
    bevel c_interp d_interp maplib usemap ctech stech deg bmat step parm \
    trim hole scrv sp end con";

/// The text in pieces, each of whole lines and, but for the last, longer
/// than `size` bytes.
fn cut(mut text: &[u8], size: usize) -> Vec<&[u8]> {
    let mut pieces = vec![];
    while !text.is_empty() {
        let least = size.min(text.len());
        let end = memchr2(b'\n', b'\r', &text[least..]);
        let end = end.map_or(text.len(), |n| least + n + 1);
        pieces.extend(text.split_off(..end));
    }
    pieces
}

/// The mesh of a piece that follows so many vertices, the first of two
/// numbers; the second is that of all vertices.
///
/// # Errors
/// The line at fault, and what is wrong with it.
fn read_piece(
    piece: &[u8],
    [first, total]: [usize; 2],
) -> Result<Mesh, (&[u8], String)> {
    let mut mesh = Mesh::default();
    for line in lines(piece) {
        let vertices = [first + mesh.vertices.len(), total];
        read_statement(line, vertices, &mut mesh)
            .map_err(|what| (line, what))?;
    }
    Ok(mesh)
}

fn read_statement(
    text: &[u8],
    vertices: [usize; 2],
    mesh: &mut Mesh,
) -> Result<(), String> {
    let kind = match name(text) {
        b"v" | b"f" => None,
        b"o" => Some(MarkKind::Object),
        b"g" => Some(MarkKind::Group),
        b"usemtl" => Some(MarkKind::Material),
        b"mtllib" => Some(MarkKind::Library),
        _ => return Ok(()),
    };
    if let Some(kind) = kind {
        // Note what the faces are called
        let rest = text[name(text).len()..].trim_ascii();
        let name = String::from_utf8_lossy(rest).into_owned();
        let face = (mesh.triangles.len() - mesh.joined.len()) as u32;
        mesh.marks.push(Mark { face, kind, name });
        return Ok(());
    }
    let end = memchr(b'#', text).unwrap_or(text.len());
    let text =
        str::from_utf8(&text[..end]).map_err(|_| "not UTF-8 text")?;
    if text.is_ascii() && memchr(BREAK, text.as_bytes()).is_none() {
        read_element(text.split_ascii_whitespace(), vertices, mesh)
    } else {
        read_element(text.split_whitespace(), vertices, mesh)
    }
}

fn read_element<'a>(
    mut words: impl Iterator<Item = &'a str>,
    vertices: [usize; 2],
    mesh: &mut Mesh,
) -> Result<(), String> {
    match words.next() {
        Some("v") => read_vertex(words).map(|p| mesh.vertices.push(p)),
        _ => read_face(words, vertices, mesh),
    }
}

fn read_vertex<'a>(
    mut words: impl Iterator<Item = &'a str>,
) -> Result<DVec3, String> {
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
fn read_face<'a>(
    words: impl Iterator<Item = &'a str>,
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
    let slash = word.bytes().position(|c| c == b'/');
    let (digits, others) =
        slash.map_or((word, ""), |n| (&word[..n], &word[n + 1..]));
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

/// The number, from 1, of the last line in which `line`, a part of `text`,
/// stands.
fn number(text: &[u8], line: &[u8]) -> usize {
    let end = line.as_ptr_range().end.addr() - text.as_ptr().addr();
    let ends = memchr3_iter(b'\n', b'\r', BREAK, &text[..end]);
    1 + ends.filter(|&i| !text[i..].starts_with(b"\r\n")).count()
}

/// What is wrong with a line, as it follows the name of the file.
fn at(text: &[u8], line: &[u8], what: &str) -> String {
    format!(":{}: {}", number(text, line), shortened(what))
}
