// Tangled from chapters/sensor.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Tables of the values of receivers.

use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;

use crate::camera::typed;
use crate::film::{Film, WORTH};
use crate::materials::FaceAlbedos;
use crate::numerics::{cross, normalise};
use crate::scene::{Mark, Scene};
use crate::sensor::{Oddity, Receivers, Side};

/// Formats of tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TableFormat {
    /// Comma-separated values.
    Csv,
    /// Points or a mesh with a value each.
    Ply,
    /// A mesh with grey vertices.
    Obj,
}

impl TableFormat {
    /// The format of a file, CSV of standard output.
    ///
    /// # Errors
    /// The extension is another.
    pub fn of(path: &Path) -> Result<Self, String> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("csv") => Ok(Self::Csv),
            Some("ply") => Ok(Self::Ply),
            Some("obj") => Ok(Self::Obj),
            None if path.as_os_str() == "-" => Ok(Self::Csv),
            _ => Err(format!(
                "{}: receivers have no image: expected .csv, .ply or .obj",
                path.display()
            )),
        }
    }
}

/// What bears the values.
pub enum Shape {
    /// Points, with these normals, and their lines in the file.
    Points(Vec<DVec3>, Vec<u32>),
    /// The vertices of triangles.
    Vertices,
    /// The faces of triangles, given that of each; and their sides.
    Faces(Vec<u32>, Side),
}

impl Shape {
    /// What it is called.
    pub fn name(&self) -> &str {
        match self {
            Self::Points(..) => "points",
            Self::Vertices => "vertices",
            Self::Faces(..) => "faces",
        }
    }
}

/// What a table shows beside the values.
pub struct Table {
    /// What bears the values.
    pub shape: Shape,
    /// The points, or the vertices, in the coordinates of the file.
    pub vertices: Vec<DVec3>,
    /// The triangles, if there are not points.
    pub triangles: Vec<[u32; 3]>,
    /// What the file calls its faces.
    pub marks: Vec<Mark>,
    /// The albedo of each face, if it is radiosity that is asked for.
    pub albedos: Option<FaceAlbedos>,
}

/// A value, its standard error and number of samples.
type Value = [f64; 3];

/// A text as CSV has it.
fn cell(text: &str) -> String {
    match text.contains([',', '"']) {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    }
}

impl Table {
    /// The receivers, in its order.
    pub fn receivers(&self, scene: &Scene) -> Receivers {
        let Self { vertices, triangles, .. } = self;
        match &self.shape {
            Shape::Points(normals, _) => {
                Receivers::points(vertices, normals, &scene.frame)
            }
            Shape::Vertices => Receivers::vertices(&scene.triangles),
            Shape::Faces(faces, side) => {
                let vertices = &scene.triangles.vertices;
                Receivers::faces(vertices, triangles, faces, *side)
            }
        }
    }

    /// The face of a receiver, from 0, and whether it is the back.
    fn face(&self, number: u32) -> (u32, bool) {
        match self.shape {
            Shape::Faces(_, Side::Both) => (number / 2, number % 2 == 1),
            Shape::Faces(_, side) => (number, side == Side::Back),
            _ => (number, false),
        }
    }

    /// Which of the receivers have no value, or one that may not be meant, and
    /// why: a line for both, if there are any.
    pub fn odd(&self, receivers: &Receivers) -> Vec<String> {
        let Receivers { numbers, refused, doubted, .. } = receivers;
        let all = numbers.len() + refused.len();
        let line = |(odd, what): (&Vec<(Oddity, u32)>, &str)| {
            let (count, name) = (odd.len(), self.shape.name());
            let kinds = odd.chunk_by(|a, b| a.0 == b.0).map(|kind| {
                let (why, first) = kind[0];
                let first = self.place(first);
                format!("{} {why}, the first {first}", kind.len())
            });
            let kinds = kinds.collect::<Vec<_>>().join("; ");
            format!("{count} of {all} {name} {what}: {kinds}")
        };
        let lists =
            [(refused, "have no value"), (doubted, "may not be meant")];
        let lists = lists.into_iter().filter(|(odd, _)| !odd.is_empty());
        lists.map(line).collect()
    }

    /// Where a receiver is in its file.
    fn place(&self, number: u32) -> String {
        match (&self.shape, self.face(number)) {
            (Shape::Points(_, lines), _) => {
                format!("in line {}", lines[number as usize])
            }
            (_, (face, true)) => format!("the back of {}", face + 1),
            (_, (face, false)) => (face + 1).to_string(),
        }
    }

    /// Writes the values of receivers that are on a film, with the samples of
    /// each in a replicate, if they differ; `grey` is the level of a value on a
    /// screen.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn write(
        &self,
        format: TableFormat,
        receivers: &Receivers,
        film: &Film,
        allocation: Option<&[u32]>,
        grey: fn(f64) -> u8,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let values = self.values(receivers, film, allocation);
        match format {
            TableFormat::Csv => self.csv(&values, out),
            TableFormat::Ply => self.ply(&values, grey, out),
            TableFormat::Obj => self.obj(&values, out),
        }
    }

    /// The values of all receivers, in the order of the file.
    fn values(
        &self,
        receivers: &Receivers,
        film: &Film,
        allocation: Option<&[u32]>,
    ) -> Vec<Value> {
        let Receivers { numbers, refused, .. } = receivers;
        let none = [f64::NAN, f64::NAN, 0.];
        let mut values = vec![none; numbers.len() + refused.len()];
        let window = film.window;
        let errors = film.errors(WORTH, window);
        let numbers = &numbers[window.corner.1 as usize..];
        let found = film.means_of(window).into_iter().zip(errors);
        let found = found.zip(film.counts_of(window, allocation));
        for (&number, ((mean, error), count)) in numbers.iter().zip(found) {
            let (face, _) = self.face(number);
            let part = self.albedos.as_ref().map_or(1., |all| all.of(face));
            values[number as usize] = [part * mean, part * error, count];
        }
        values
    }

    fn csv(&self, values: &[Value], out: &mut dyn Write) -> io::Result<()> {
        let (place, more) = match self.shape {
            Shape::Points(..) => ("x,y,z,nx,ny,nz", ""),
            Shape::Vertices => ("vertex,x,y,z", ""),
            Shape::Faces(..) => {
                ("face,side", "object,group,area,x,y,z,nx,ny,nz,")
            }
        };
        writeln!(out, "{place},value,stderr,samples,{more}unit")?;
        let unit = match self.albedos {
            Some(_) => "radiosity (horizontal irradiance in the open = 1)",
            None => "irradiance (horizontal in the open = 1)",
        };
        let mut marks = self.marks.iter().peekable();
        let mut names = [""; 2];
        // Write a line of CSV for each receiver
        for (i, &[value, error, samples]) in values.iter().enumerate() {
            let vertex = || typed(self.vertices[i]);
            let mut more = String::new();
            let place = match &self.shape {
                Shape::Points(normals, _) => {
                    vertex() + "," + &typed(normals[i])
                }
                Shape::Vertices => format!("{},{}", i + 1, vertex()),
                Shape::Faces(faces, _) => {
                    let (face, is_back) = self.face(i as u32);
                    // Describe a face
                    while let Some(mark) = marks.next_if(|m| m.face <= face)
                    {
                        let kind = mark.kind as usize;
                        if let Some(name) = names.get_mut(kind) {
                            *name = &mark.name;
                        }
                    }
                    let [object, group] = names.map(cell);
                    let numbers = self.measured(face, faces, is_back);
                    more = format!("{object},{group},{numbers}");
                    let side = if is_back { "back" } else { "front" };
                    format!("{},{side}", face + 1)
                }
            };
            let [value, error] = [value, error].map(|x| x as f32);
            let value = format!("{value:?},{error:?},{samples}");
            writeln!(out, "{place},{value},{more}{unit}")?;
        }
        Ok(())
    }

    /// The area, centre and normal of a face, as columns before commas.
    fn measured(&self, face: u32, faces: &[u32], is_back: bool) -> String {
        let start = faces.partition_point(|&other| other < face);
        let end = faces.partition_point(|&other| other <= face);
        let (mut across, mut twice) = (DVec3::ZERO, 0.);
        let mut moment = DVec3::ZERO;
        for corners in &self.triangles[start..end] {
            let [a, b, c] = corners.map(|i| self.vertices[i as usize]);
            let normal = cross(b - a, c - a);
            across += if is_back { -normal } else { normal };
            twice += normal.length();
            moment += (a + b + c) * normal.length();
        }
        let places = [moment / (3. * twice), across.normalize()].map(typed);
        format!("{},{},", 0.5 * twice, places.join(","))
    }

    fn ply(
        &self,
        values: &[Value],
        grey: fn(f64) -> u8,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let Self { shape, vertices, triangles, .. } = self;
        let both = matches!(shape, Shape::Faces(_, Side::Both));
        let count = if both { 2 } else { 1 } * triangles.len();
        let corners = match shape {
            Shape::Faces(..) => 3 * count,
            _ => vertices.len(),
        };
        // Write the head of a PLY
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\n\
             comment relative to the horizontal irradiance in the open\n\
             element vertex {corners}\n"
        )?;
        let has_normal = !matches!(shape, Shape::Vertices);
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
        let corner = |i: usize| match shape {
            Shape::Points(normals, _) => (vertices[i], Some(normals[i]), i),
            Shape::Vertices => (vertices[i], None, i),
            Shape::Faces(faces, _) => {
                let all = triangles.len();
                let (side, k) = (i / 3 / all, i / 3 % all);
                let (_, is_back) = self.face(side as u32);
                let [a, b, c] = triangles[k].map(|i| vertices[i as usize]);
                let [a, b, c] = if is_back { [a, c, b] } else { [a, b, c] };
                let normal = cross(normalise(b - a), normalise(c - a));
                let number = count / all * faces[k] as usize + side;
                ([a, b, c][i % 3], Some(normal.normalize_or_zero()), number)
            }
        };
        // Write the corners of a PLY
        for (place, normal, number) in (0..corners).map(corner) {
            let [value, error, _] = values[number];
            let colour = match value.is_nan() {
                true => [255, 0, 255],
                false => [grey(value); 3],
            };
            let place = place.to_array().map(f64::to_le_bytes);
            out.write_all(&place.concat())?;
            let normal = normal.iter().flat_map(|n| n.to_array());
            for x in normal.chain([value, error, value]) {
                out.write_all(&(x as f32).to_le_bytes())?;
            }
            out.write_all(&colour)?;
        }
        // Write the triangles of a PLY
        for i in 0..count as u32 {
            let corners = match shape {
                Shape::Faces(..) => [0, 1, 2].map(|k| 3 * i + k),
                _ => triangles[i as usize],
            };
            out.write_all(&[3])?;
            out.write_all(&corners.map(u32::to_le_bytes).concat())?;
        }
        Ok(())
    }

    fn obj(&self, values: &[Value], out: &mut dyn Write) -> io::Result<()> {
        if !matches!(self.shape, Shape::Vertices) {
            let fault =
                "an OBJ shows values of --vertices; name it .csv or .ply";
            return Err(io::Error::other(fault));
        }
        for (&p, [value, ..]) in self.vertices.iter().zip(values) {
            let grey = value.max(0.) as f32;
            let [x, y, z] = p.to_array();
            writeln!(out, "v {x} {y} {z} {grey} {grey} {grey}")?;
        }
        for corners in &self.triangles {
            let [a, b, c] = corners.map(|corner| corner + 1);
            writeln!(out, "f {a} {b} {c}")?;
        }
        Ok(())
    }
}
