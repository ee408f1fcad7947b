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

// Name what the scene imports
use std::fmt;
use std::io::{self, BufRead, Read};
use std::ops::Range;
use std::path::Path;

use glam::{DVec3, Vec3};
use tobj::{LoadOptions, Model};

use crate::numerics::{exponent, power_of_two};

// Represent a mesh as it was read
/// An indexed triangle mesh in the coordinates of its file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions of the vertices, each finite.
    pub vertices: Vec<DVec3>,
    /// Three indices into `vertices` for each triangle.
    pub triangles: Vec<[u32; 3]>,
}

// Read the text of an OBJ
/// Reads the mesh that the text `source` of a Wavefront OBJ describes.
/// Polygons become fans of triangles around their first corner.
///
/// # Errors
/// Text that is empty, binary, malformed or without any face, vertices
/// that are not finite, faces with fewer than three corners or with
/// corners that do not exist.
pub fn read_obj(source: &[u8]) -> Result<Mesh, ObjError> {
    // Refuse empty and binary files
    let source = source.strip_prefix(b"\xef\xbb\xbf").unwrap_or(source);
    if source.is_empty() {
        return Err(ObjError::whole(
            "the file is empty; an OBJ was expected",
        ));
    }
    if let Some(at) = source.iter().position(|&byte| byte == 0) {
        let line = 1 + source[..at].iter().filter(|&&b| b == b'\n').count();
        let what = "a zero byte: this is a binary file, not an OBJ";
        return Err(ObjError::new(line, what.to_owned()));
    }
    let mut statements = Statements::new(source);
    let options = LoadOptions { triangulate: true, ..Default::default() };
    let no_material = |_: &Path| Ok(Default::default());
    match tobj::load_obj_buf(&mut statements, &options, no_material) {
        Ok((models, _)) => check(source, models),
        Err(error) => Err(fault(source).unwrap_or_else(|| {
            ObjError::new(statements.line, error.to_string())
        })),
    }
}

/// The mesh of what tobj read, or the fault that tobj did not see.
fn check(source: &[u8], models: Vec<Model>) -> Result<Mesh, ObjError> {
    let mut mesh = Mesh::default();
    for model in models {
        // Append the model to the mesh
        let first = mesh.vertices.len() as u32;
        let Model { mesh: part, .. } = model;
        mesh.vertices
            .extend(part.positions.chunks_exact(3).map(DVec3::from_slice));
        mesh.triangles.extend(
            part.indices
                .chunks_exact(3)
                .map(|t| [0, 1, 2].map(|i| first + t[i])),
        );
    }
    let finite = mesh.vertices.iter().all(|v| v.is_finite());
    let repeats = |&[a, b, c]: &[u32; 3]| a == b || b == c;
    if !finite || mesh.triangles.iter().any(repeats) {
        fault(source).map_or(Ok(()), Err)?;
    }
    if mesh.triangles.is_empty() {
        return Err(ObjError::whole("no face, hence nothing to render"));
    }
    Ok(mesh)
}

// Keep only vertices and faces
/// A reader over the vertex and face statements of an OBJ.
struct Statements<'a> {
    source: &'a [u8],
    /// Bytes of the current statement that are still to be read.
    kept: Range<usize>,
    /// Offset of the first line that was not looked at.
    next: usize,
    /// Number of lines looked at; that of the current statement.
    line: usize,
    /// Whether the last line ended in a backslash, and was kept.
    continues: Option<bool>,
}

impl<'a> Statements<'a> {
    fn new(source: &'a [u8]) -> Self {
        Self { source, kept: 0..0, next: 0, line: 0, continues: None }
    }

    /// Looks at one more line; sets `kept` if it matters.
    fn advance(&mut self) {
        let start = self.next;
        let rest = &self.source[start..];
        let newline = rest.iter().position(|&byte| byte == b'\n');
        let length = newline.map_or(rest.len(), |at| at + 1);
        self.next += length;
        self.line += 1;
        let text = rest[..length].trim_ascii_end();
        let keep = self.continues.unwrap_or_else(|| matters(text));
        let continues = text.last() == Some(&b'\\');
        self.continues = continues.then_some(keep);
        let length = if continues { text.len() - 1 } else { length };
        self.kept = start..start + if keep { length } else { 0 };
    }
}

/// Whether a line begins with the statement `v` or `f`.
fn matters(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    matches!(line, [b'v' | b'f'] | [b'v' | b'f', b' ' | b'\t', ..])
}

impl BufRead for Statements<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        while self.kept.is_empty() && self.next < self.source.len() {
            self.advance();
        }
        Ok(&self.source[self.kept.clone()])
    }

    fn consume(&mut self, amount: usize) {
        self.kept.start += amount;
    }
}

impl Read for Statements<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let length = self.fill_buf()?.read(out)?;
        self.consume(length);
        Ok(length)
    }
}

// Find the line at fault
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

/// The first statement of `source` that makes no sense, if any.
fn fault(source: &[u8]) -> Option<ObjError> {
    let is_vertex = |text: &[u8]| text.trim_ascii_start()[0] == b'v';
    let all = each_statement(source);
    let total = all.iter().filter(|(_, text)| is_vertex(text)).count();
    let mut so_far = 0;
    all.into_iter().find_map(|(line, text)| {
        let judged = match std::str::from_utf8(&text) {
            Err(_) => Err("not UTF-8 text".to_owned()),
            Ok(text) if is_vertex(text.as_bytes()) => judge_vertex(text),
            Ok(text) => judge_face(text, so_far, total),
        };
        so_far += usize::from(is_vertex(&text));
        judged.err().map(|what| ObjError::new(line, what))
    })
}

/// The statements that matter, each with the number of its last line.
fn each_statement(source: &[u8]) -> Vec<(usize, Vec<u8>)> {
    let mut statements = Statements::new(source);
    let mut all = Vec::new();
    let mut text = Vec::new();
    while let Ok(1..) = statements.read_until(b'\n', &mut text) {
        all.push((statements.line, std::mem::take(&mut text)));
    }
    all
}

fn judge_vertex(text: &str) -> Result<(), String> {
    let mut words = text.split_whitespace().skip(1);
    for axis in ["x", "y", "z"] {
        let word =
            words.next().ok_or(format!("a vertex without {axis}"))?;
        match word.parse::<f64>() {
            Ok(value) if value.is_finite() => (),
            Ok(_) => return Err(format!("{axis} = {word} is not finite")),
            Err(_) => return Err(format!("{axis} = {word} is no number")),
        }
    }
    match words.find(|word| word.parse::<f64>().is_err()) {
        Some(word) => Err(format!("{word} is no number")),
        None => Ok(()),
    }
}

fn judge_face(
    text: &str,
    so_far: usize,
    total: usize,
) -> Result<(), String> {
    let corners = text.split_whitespace().skip(1);
    for word in corners.clone() {
        judge_corner(word, so_far, total)?;
    }
    match corners.count() {
        n @ 0..3 => Err(format!("a face of {n} corners; it needs three")),
        _ => Ok(()),
    }
}

fn judge_corner(
    word: &str,
    so_far: usize,
    total: usize,
) -> Result<(), String> {
    let mut numbers = word.splitn(3, '/');
    let digits = numbers.next().unwrap_or_default();
    let is_number = |n: &str| n.is_empty() || n.parse::<i64>().is_ok();
    if !numbers.all(is_number) {
        return Err(format!("corner {word} is not of the form 1/2/3"));
    }
    match digits.parse::<i64>() {
        Err(_) => Err(format!("corner {word} is no vertex number")),
        Ok(0) => Err("vertices are counted from 1, not from 0".to_owned()),
        Ok(n) if n < 0 && n.unsigned_abs() > so_far as u64 => {
            Err(format!("corner {n}, but only {so_far} vertices so far"))
        }
        Ok(n) if n > total as i64 => {
            Err(format!("corner {n}, but only {total} vertices"))
        }
        Ok(_) => Ok(()),
    }
}

// Bring the scene to the origin
/// The map from the coordinates of the file to those of the scene.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    centre: DVec3,
    /// A power of two.
    scale: f64,
}

impl Frame {
    /// Where the point `p` of the file lies in the scene.
    pub fn apply(&self, p: DVec3) -> DVec3 {
        (p - self.centre) * self.scale
    }
}

/// The frame of a box given by two opposite corners.
fn frame(low: DVec3, high: DVec3) -> Frame {
    let centre = 0.5 * low + 0.5 * high;
    let half = (0.5 * high - 0.5 * low).max_element();
    let scale = match half {
        0. => 1.,
        half => power_of_two(EXTENT - exponent(half)),
    };
    Frame { centre, scale }
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
}

fn has_area(triangle: &Triangle) -> bool {
    let [a, b, c] = triangle.map(|corner| corner.as_dvec3());
    (b - a).cross(c - a) != DVec3::ZERO
}

impl Scene {
    /// The scene of a mesh; a mesh without triangles is an empty scene.
    pub fn new(mesh: &Mesh) -> Self {
        let vertices = &mesh.vertices;
        let first = vertices.first().copied().unwrap_or_default();
        let low = vertices.iter().fold(first, |a, &v| a.min(v));
        let high = vertices.iter().fold(first, |a, &v| a.max(v));
        let frame = frame(low, high);
        let corner = |&i: &u32| frame.apply(vertices[i as usize]).as_vec3();
        let place = |t: &[u32; 3]| t.each_ref().map(corner);
        let triangles = mesh.triangles.iter().map(place);
        let triangles = triangles.filter(has_area).collect();
        let half = frame.apply(high) + DVec3::ONE;
        Self { frame, half, triangles }
    }

    /// The triangles that have an area, in the order of the mesh.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    // Move a distant ray to the scene
    /// The ray that starts at the point `position` of the file, from where
    /// it enters the scene; none if it passes the scene by.
    pub fn enter(&self, position: DVec3, direction: DVec3) -> Option<Ray> {
        let origin = self.frame.apply(position);
        if origin.abs().cmple(self.half).all() {
            return Some(Ray { origin, direction });
        }
        let near = -direction.signum() * self.half;
        let enters = ((near - origin) / direction).to_array();
        let leaves = ((-near - origin) / direction).to_array();
        let start = enters.into_iter().fold(0., f64::max);
        let end = leaves.into_iter().fold(f64::INFINITY, f64::min);
        let margin = 1. + f64::EPSILON * 8.;
        let point =
            (origin + direction * start).clamp(-self.half, self.half);
        (start <= end * margin).then_some(Ray { origin: point, direction })
    }
}

/// A half line, in the coordinates of the scene.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it starts.
    pub origin: DVec3,
    /// Where it goes; of length one.
    pub direction: DVec3,
}
