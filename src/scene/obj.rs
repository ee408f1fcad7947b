// Tangled from chapters/scene.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the text of a Wavefront OBJ to a mesh.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::DVec3;
use memchr::{memchr, memchr2};
use rayon::prelude::*;

use super::encoding::{self, quoted};
use super::mesh::{Mark, MarkKind, Mesh};
use super::polygons;
use super::text::*;
use crate::error::{Diagnostic, Result};

/// Reads the mesh that the bytes `source` of a Wavefront OBJ describe,
/// which may be compressed.
/// Convex faces become fans of triangles around their first corner.
///
/// # Errors
/// Text that is empty, binary, malformed or without any face; faces with
/// fewer than three corners, or with corners that do not exist or are not
/// finite; more than 2^30 vertices or triangles; damaged compressed files.
pub fn read_obj(source: &[u8]) -> Result<Mesh> {
    read_file(source).map(|(mesh, _)| mesh)
}

/// Like `read_obj`, with warnings of faces that are no polygons, and of
/// statements in the file that the mesh does not contain.
///
/// # Errors
/// Those of `read_obj`.
pub fn read_file(source: &[u8]) -> Result<(Mesh, Vec<Diagnostic>)> {
    read_pieces(source, PIECE).map_err(|fault| {
        let text = encoding::text(source, &mut vec![]);
        let kind = text.ok().and_then(|text| encoding::foreign(&text));
        kind.map_or(fault, |kind| {
            let hint = "convert it, for example with Blender";
            format!("the format is {kind}, not Wavefront OBJ: {hint}")
                .into()
        })
    })
}

/// The size of a piece of the text.
const PIECE: usize = 1 << 20;

/// Whether a file that begins like this may be an OBJ: the beginning has a
/// vertex, or is compressed.
pub(crate) fn begins_obj(start: &[u8]) -> bool {
    let is_packed = encoding::format(start).is_some();
    is_packed || lines(start).any(|line| name(line) == b"v")
}

/// Like `read_file`, with the number of bytes `size` after which the text
/// is cut; the result does not depend on it.
pub fn read_pieces(
    source: &[u8],
    size: usize,
) -> Result<(Mesh, Vec<Diagnostic>)> {
    let mut warnings = vec![];
    let text = encoding::text(source, &mut warnings)?;
    if text.is_empty() {
        return Err("the file is empty; an OBJ was expected".into());
    }
    let text = &join(plain(&text)?);
    let pieces = cut(text, size);
    // Count the vertices before each piece
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
        let name = quoted(&String::from_utf8_lossy(name(first)));
        let what = "statements that are not rendered";
        let what = format!("{name}, the first of {} {what}", unused.len());
        warnings.push(at(text, first, what));
    }
    // Read each piece into a mesh
    let read = |(&piece, first)| {
        let before: usize = first;
        let mut mesh = Mesh::default();
        for line in lines(piece) {
            let vertices = [before + mesh.vertices.len(), total];
            read_statement(line, vertices, &mut mesh)
                .map_err(|what| (line, what))?;
        }
        Ok(mesh)
    };
    let parts: Vec<_> = pieces.par_iter().zip(before).map(read).collect();
    let parts = parts.into_iter().collect::<Result<Vec<_>, _>>();
    let parts = parts.map_err(|(line, what)| at(text, line, what))?;
    // Concatenate the meshes
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
        let what =
            "no face, hence nothing to render; is it a Wavefront OBJ?";
        return Err(what.into());
    }
    warnings.extend(set_aside(text, &mut mesh)?);
    // Fill the faces, and warn of odd ones
    let odd = polygons::fill(&mut mesh);
    if let Some(&face) = odd.first() {
        let what =
            "odd faces, bent or crossed; other programs may fill them";
        let what = format!("the first of {} {what} differently", odd.len());
        warnings.push(at(text, find(text, b"f", face as usize), what));
    }
    Ok((mesh, warnings))
}

/// Replaces vertices that are not finite; returns a warning about them.
///
/// # Errors
/// One of them is a corner of a face.
fn set_aside(
    text: &[u8],
    Mesh { vertices, triangles, joined, .. }: &mut Mesh,
) -> Result<Option<Diagnostic>> {
    let wrong = vertices.par_iter().positions(|p| !p.is_finite());
    let wrong: Vec<_> = wrong.collect();
    let Some(&first) = wrong.first() else { return Ok(None) };
    let corners = triangles.as_flattened();
    let bad = |&i: &u32| !vertices[i as usize].is_finite();
    if let Some(k) = corners.iter().position(bad) {
        let face = k / 3 - joined.partition_point(|&i| i as usize <= k / 3);
        let vertex = find(text, b"v", corners[k] as usize);
        let what = String::from_utf8_lossy(said(vertex));
        let what = quoted(&what.replace(BREAK as char, ""));
        let line = number(text, vertex);
        let what = quoted(&what);
        let what = format!("a corner is not finite: line {line} is {what}");
        return Err(at(text, find(text, b"f", face), what).into());
    }
    wrong.iter().for_each(|&i| vertices[i] = DVec3::ZERO);
    let what = "vertices that are not finite, and in no face";
    let what = format!("the first of {} {what}", wrong.len());
    Ok(Some(at(text, find(text, b"v", first), what)))
}

/// The statement number `number`, from 0, of those with this name.
fn find<'a>(text: &'a [u8], named: &[u8], number: usize) -> &'a [u8] {
    let mut named_so = lines(text).filter(|line| name(line) == named);
    named_so.nth(number).unwrap_or(text)
}

/// Refuses more elements than can be numbered.
fn countable(n: usize) -> Result<()> {
    let what = "vertices or triangles, of which only";
    let what = || format!("{n} {what} {MOST} can be numbered");
    Ok((n <= MOST).then_some(()).ok_or_else(what)?)
}

/// The most that can be numbered: a leaf has 30 bits for a face.
const MOST: usize = 1 << 30;

#[cfg(test)]
#[path = "../../tests/units/obj.rs"]
mod tests;

/// The number of vertices, and the statements that are not rendered.
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

/// Statements about the appearance and names of faces, or that belong to a
/// shape whose own statement leads to a warning.
const SILENT: &str = "g o s usemtl mtllib vp mg lod shadow_obj trace_obj \
    bevel c_interp d_interp maplib usemap ctech stech deg bmat step parm \
    trim hole scrv sp end con";

/// The text in pieces of whole lines, each but the last longer than `size`
/// bytes.
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

fn read_statement(
    text: &[u8],
    vertices: [usize; 2],
    mesh: &mut Mesh,
) -> Result<()> {
    let kind = match name(text) {
        b"v" | b"f" => None,
        b"o" => Some(MarkKind::Object),
        b"g" => Some(MarkKind::Group),
        b"usemtl" => Some(MarkKind::Material),
        b"mtllib" => Some(MarkKind::Library),
        _ => return Ok(()),
    };
    if let Some(kind) = kind {
        // Record the name of the faces
        let name = rest(text);
        let face = (mesh.triangles.len() - mesh.joined.len()) as u32;
        mesh.marks.push(Mark { face, kind, name });
        return Ok(());
    }
    let text = str::from_utf8(said(text)).map_err(|_| "not UTF-8 text")?;
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
) -> Result<()> {
    match words.next() {
        Some("v") => read_vertex(words).map(|p| mesh.vertices.push(p)),
        _ => read_face(words, vertices, mesh),
    }
}

fn read_vertex<'a>(
    mut words: impl Iterator<Item = &'a str>,
) -> Result<DVec3> {
    let mut position = [0.; 3];
    for (axis, value) in ["x", "y", "z"].iter().zip(&mut position) {
        let none = || format!("a vertex without {axis}");
        let word = words.next().ok_or_else(none)?;
        let wrong = |_| format!("{axis} = {} is no number", quoted(word));
        *value = word.parse().map_err(wrong)?;
    }
    match words.find(|word| word.parse::<f64>().is_err()) {
        Some(word) => Err(format!("{} is no number", quoted(word)).into()),
        None => Ok(position.into()),
    }
}

/// Appends the fan of the face with the corners `words`.
fn read_face<'a>(
    words: impl Iterator<Item = &'a str>,
    vertices: [usize; 2],
    mesh: &mut Mesh,
) -> Result<()> {
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
        0..3 => {
            Err(format!("a face of {n} corners; it needs three").into())
        }
        _ => Ok(()),
    }
}

/// The number of the vertex at a corner, from 0.
fn read_corner(word: &str, [so_far, total]: [usize; 2]) -> Result<u32> {
    let slash = word.bytes().position(|c| c == b'/');
    let (digits, others) =
        slash.map_or((word, ""), |n| (&word[..n], &word[n + 1..]));
    // Reject malformed numbers after the first slash
    let is_number = |n: &str| n.is_empty() || n.parse::<i64>().is_ok();
    if !others.is_empty() && !others.splitn(2, '/').all(is_number) {
        let word = quoted(word);
        return Err(
            format!("corner {word} is not of the form 1/2/3").into()
        );
    }
    Err(match digits.parse::<i64>() {
        Err(_) => format!("corner {} is no vertex number", quoted(word)),
        Ok(0) => "vertices are counted from 1, not from 0".to_owned(),
        Ok(n) if n > total as i64 => {
            format!("corner {n}, but only {total} vertices")
        }
        Ok(n @ 1..) => return Ok((n - 1) as u32),
        Ok(n) if n < -(so_far as i64) => {
            format!("corner {n}, but only {so_far} vertices so far")
        }
        Ok(n) => return Ok((so_far as i64 + n) as u32),
    }
    .into())
}
