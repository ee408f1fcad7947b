// Tangled from chapters/sensor.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Tables of the values of receivers.

use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::camera::typed;
use crate::error::{Diagnostic, Error, Result};
use crate::film::{Film, NEIGHBOUR_WEIGHT};
use crate::materials::FaceAlbedos;
use crate::numerics::{cross, normalise};
use crate::scene::{Mesh, Scene};
use crate::sensor::{Oddity, Point, Receivers};

/// Formats of tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum TableFormat {
    /// Comma-separated values.
    Csv,
    /// Points or a mesh with a value each.
    Ply,
    /// A mesh with grey vertices.
    Obj,
}

impl TableFormat {
    /// The format of a file, CSV of standard output; `has_vertices` if the
    /// receivers are vertices.
    ///
    /// # Errors
    /// The extension is another, or not for these receivers.
    pub fn of(path: &Path, has_vertices: bool) -> Result<Self> {
        let ending = path.extension().and_then(|e| e.to_str());
        match ending.map(str::to_ascii_lowercase).as_deref() {
            Some("csv") => Ok(Self::Csv),
            Some("ply") => Ok(Self::Ply),
            Some("obj") if has_vertices => Ok(Self::Obj),
            None if path.as_os_str() == "-" => Ok(Self::Csv),
            _ => Err(Error::from(
                "receivers have no image: expected .csv or .ply, or .obj, \
                 which shows values of --vertices",
            )
            .of_file(path)),
        }
    }
}

/// The kind of receivers.
pub enum Shape {
    /// Points.
    Points(Vec<Point>),
    /// The vertices of triangles.
    Vertices,
    /// The faces of triangles, given the face of each.
    Faces(Vec<u32>),
}

impl Shape {
    /// The name of the kind.
    pub fn name(&self) -> &str {
        match self {
            Self::Points(..) => "points",
            Self::Vertices => "vertices",
            Self::Faces(..) => "faces",
        }
    }
}

/// Everything that a table shows apart from the values.
pub struct Table {
    /// The kind of receivers.
    pub shape: Shape,
    /// For each side that receives, whether it is a back.
    pub backs: &'static [bool],
    /// The scene, in the coordinates of the file, unless there are points.
    pub mesh: Arc<Mesh>,
    /// The name of the file of the receivers.
    pub file: String,
    /// The albedo of each face, if radiosity is asked for.
    pub albedos: Option<FaceAlbedos>,
    /// The level of a value on a screen.
    pub grey: fn(f64) -> u8,
}

/// A value and its standard error, and the number of samples.
pub type Value = ([f32; 2], f64);

/// A text as a cell of CSV.
pub(crate) fn cell(text: &str) -> String {
    let quoted = format!("\"{}\"", text.replace('"', "\"\""));
    if text.contains([',', '"']) { quoted } else { text.to_owned() }
}

impl Table {
    /// The receivers, in the order of the table.
    pub fn receivers(&self, scene: &Scene) -> Receivers {
        match &self.shape {
            Shape::Points(list) => Receivers::points(list, &scene.frame),
            Shape::Vertices => Receivers::vertices(&scene.triangles),
            Shape::Faces(faces) => {
                let place = |i: u32| scene.triangles.vertices[i as usize];
                let triangles = self.mesh.triangles.iter();
                let triangles = triangles.map(|corners| corners.map(place));
                Receivers::faces(triangles, faces, self.backs)
            }
        }
    }

    /// The face of a receiver, from 0, and whether it is the back.
    fn face(&self, number: usize) -> (u32, bool) {
        let sides = self.backs.len();
        ((number / sides) as u32, self.backs[number % sides])
    }

    /// A warning for each kind of receivers that have no value, or a doubtful
    /// one: how many, and why.
    pub fn odd(
        &self,
        receivers: &Receivers,
        is_told: impl Fn(Oddity, u32) -> bool,
    ) -> Vec<Diagnostic> {
        let (asked, name) = (receivers.asked, self.shape.name());
        let odd = receivers.odd.iter().filter(|(why, n)| is_told(*why, *n));
        let odd: Vec<_> = odd.copied().collect();
        let kinds = odd.chunk_by(|a, b| a.0 == b.0).map(|kind| {
            let ((has_value, why), first) = kind[0];
            let value = if has_value { "a doubtful" } else { "no" };
            let (n, first) = (kind.len(), self.place(first as usize));
            let text = format!(
                "{value} value for {n} of {asked} {name}: {why}, the first {first}"
            );
            Diagnostic::from(text).of_file(&self.file)
        });
        kinds.collect()
    }

    /// The place of a receiver in its file.
    fn place(&self, number: usize) -> String {
        match (&self.shape, self.face(number)) {
            (Shape::Points(set), _) => format!("in line {}", set[number].2),
            (_, (face, true)) => format!("the back of {}", face + 1),
            (_, (face, false)) => (face + 1).to_string(),
        }
    }

    /// Writes the values of receivers, and their derivatives if there are any;
    /// only CSV holds these.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn write(
        &self,
        format: TableFormat,
        values: &[Value],
        slopes: Option<&[[f64; 2]]>,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        match format {
            TableFormat::Csv => self.csv(values, slopes, out),
            TableFormat::Ply => self.ply(values, out),
            TableFormat::Obj => self.obj(values, out),
        }
    }

    /// The value on a film of each receiver of the file, its standard error,
    /// and the number of its samples; NaN where there is none. `allocation`
    /// has the samples of each in a replicate, if they differ.
    pub fn values(
        &self,
        receivers: &Receivers,
        film: &Film,
        allocation: Option<&[u32]>,
    ) -> Vec<Value> {
        let mut values = vec![([f32::NAN; 2], 0.); receivers.asked];
        let window = film.window;
        let numbers = &receivers.numbers[window.corner.1 as usize..];
        let means = film.means_of(window).into_iter();
        let found = means.zip(film.errors(NEIGHBOUR_WEIGHT, window));
        let found = found.zip(film.counts_of(window, allocation));
        for (&number, ((mean, error), count)) in numbers.iter().zip(found) {
            let (face, _) = self.face(number as usize);
            let part = self.albedos.as_ref().map_or(1., |a| a.of(face));
            let found = [mean, error].map(|x| (part * x) as f32);
            values[number as usize] = (found, count);
        }
        values
    }

    fn csv(
        &self,
        values: &[Value],
        slopes: Option<&[[f64; 2]]>,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let (place, more) = match self.shape {
            Shape::Points(..) => ("x,y,z,nx,ny,nz", ""),
            Shape::Vertices => ("vertex,x,y,z", ""),
            Shape::Faces(..) => {
                ("face,side", "object,group,area,x,y,z,nx,ny,nz,")
            }
        };
        let by = if slopes.is_some() { "d_value,d_stderr," } else { "" };
        writeln!(out, "{place},value,stderr,samples,{by}{more}unit")?;
        let unit = match self.albedos {
            Some(_) => "radiosity (horizontal irradiance in the open = 1)",
            None => "irradiance (horizontal in the open = 1)",
        };
        let mut marks = self.mesh.marks.iter().peekable();
        let mut names = [""; 4];
        // Write a line of CSV for each receiver
        for (i, ([value, error], samples)) in values.iter().enumerate() {
            let mut more = String::new();
            let place = match &self.shape {
                Shape::Points(points) => {
                    [points[i].0, points[i].1].map(typed).join(",")
                }
                Shape::Vertices => {
                    format!("{},{}", i + 1, typed(self.mesh.vertices[i]))
                }
                Shape::Faces(faces) => {
                    let (face, is_back) = self.face(i);
                    // Describe a face
                    while let Some(mark) = marks.next_if(|m| m.face <= face)
                    {
                        names[mark.kind as usize] = &mark.name;
                    }
                    let [object, group, ..] = names.map(cell);
                    let numbers = self.measured(face, faces, is_back);
                    more = format!("{object},{group},{numbers}");
                    let side = if is_back { "back" } else { "front" };
                    format!("{},{side}", face + 1)
                }
            };
            let by = slopes.map_or(String::new(), |slopes| {
                let [slope, error] = slopes[i].map(|x| x as f32);
                format!("{slope:?},{error:?},")
            });
            let value = format!("{value:?},{error:?},{samples}");
            writeln!(out, "{place},{value},{by}{more}{unit}")?;
        }
        Ok(())
    }

    /// The area of each face; none of points.
    pub fn areas(&self) -> Vec<f64> {
        let Shape::Faces(faces) = &self.shape else { return vec![] };
        let mut areas =
            vec![0.; faces.last().map_or(0, |&f| f as usize + 1)];
        for (face, corners) in faces.iter().zip(&self.mesh.triangles) {
            let [a, b, c] = corners.map(|i| self.mesh.vertices[i as usize]);
            areas[*face as usize] += 0.5 * cross(b - a, c - a).length();
        }
        areas
    }

    /// The area, centre and normal of a face, as columns with commas.
    fn measured(&self, face: u32, faces: &[u32], is_back: bool) -> String {
        let start = faces.partition_point(|&other| other < face);
        let end = faces.partition_point(|&other| other <= face);
        let (mut across, mut twice) = (DVec3::ZERO, 0.);
        let mut moment = DVec3::ZERO;
        for corners in &self.mesh.triangles[start..end] {
            let [a, b, c] = corners.map(|i| self.mesh.vertices[i as usize]);
            let normal = cross(b - a, c - a);
            across += if is_back { -normal } else { normal };
            twice += normal.length();
            moment += (a + b + c) * normal.length();
        }
        let places = [moment / (3. * twice), across.normalize()].map(typed);
        format!("{},{},", 0.5 * twice, places.join(","))
    }

    fn ply(&self, values: &[Value], out: &mut dyn Write) -> io::Result<()> {
        let Mesh { vertices, triangles, .. } = &*self.mesh;
        let count = self.backs.len() * triangles.len();
        let is_soup = matches!(self.shape, Shape::Faces(_));
        let corners = if is_soup { 3 * count } else { values.len() };
        // Write the head of a PLY
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\n\
             comment relative to the horizontal irradiance in the open\n\
             element vertex {corners}\n"
        )?;
        let has_normal = !matches!(self.shape, Shape::Vertices);
        let normal = if has_normal { "nx ny nz" } else { "" };
        for (kind, names) in [
            ("double", "x y z"),
            ("float", normal),
            ("float", "value stderr quality"),
            ("uchar", "red green blue"),
        ] {
            for name in names.split_whitespace() {
                writeln!(out, "property {kind} {name}")?;
            }
        }
        if count > 0 {
            writeln!(out, "element face {count}")?;
            writeln!(out, "property list uchar int vertex_indices")?;
        }
        writeln!(out, "end_header")?;
        // Find a corner, its normal and its receiver
        let corner = |i: usize| match &self.shape {
            Shape::Points(points) => (points[i].0, Some(points[i].1), i),
            Shape::Vertices => (vertices[i], None, i),
            Shape::Faces(faces) => {
                let count = triangles.len();
                let (side, k) = (i / 3 / count, i / 3 % count);
                let mut corners =
                    triangles[k].map(|i| vertices[i as usize]);
                if self.backs[side] {
                    corners.swap(1, 2);
                }
                let [a, b, c] = corners;
                let normal = cross(normalise(b - a), normalise(c - a));
                let number = self.backs.len() * faces[k] as usize + side;
                (corners[i % 3], Some(normal.normalize_or_zero()), number)
            }
        };
        // Write the corners of a PLY
        for (place, normal, number) in (0..corners).map(corner) {
            let ([value, error], _) = values[number];
            let grey = [(self.grey)(value.into()); 3];
            let colour = if value.is_nan() { [255, 0, 255] } else { grey };
            let place = place.to_array().map(f64::to_le_bytes);
            out.write_all(&place.concat())?;
            let normal = normal.iter().flat_map(|n| n.as_vec3().to_array());
            for x in normal.chain([value, error, value]) {
                out.write_all(&x.to_le_bytes())?;
            }
            out.write_all(&colour)?;
        }
        // Write the triangles of a PLY
        for i in 0..count as u32 {
            let single = [0, 1, 2].map(|k| 3 * i + k);
            let corners =
                if is_soup { single } else { triangles[i as usize] };
            out.write_all(&[3])?;
            out.write_all(&corners.map(u32::to_le_bytes).concat())?;
        }
        Ok(())
    }

    fn obj(&self, values: &[Value], out: &mut dyn Write) -> io::Result<()> {
        for (p, ([value, _], _)) in self.mesh.vertices.iter().zip(values) {
            let ([x, y, z], grey) = (p.to_array(), value.max(0.));
            writeln!(out, "v {x} {y} {z} {grey} {grey} {grey}")?;
        }
        for corners in &self.mesh.triangles {
            let [a, b, c] = corners.map(|corner| corner + 1);
            writeln!(out, "f {a} {b} {c}")?;
        }
        Ok(())
    }
}
