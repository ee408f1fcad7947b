// Tangled from chapters/sensor.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Tables of the values of receivers.

use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;

use crate::film::{Film, WORTH};
use crate::materials::FaceAlbedos;
use crate::sensor::{Receivers, Side};

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

/// What bears the values, in the coordinates of the file.
pub enum Shape {
    /// Points with normals.
    Points(Vec<[DVec3; 2]>),
    /// The vertices of these triangles.
    Vertices(Vec<DVec3>, Vec<[u32; 3]>),
    /// The faces with these vertices and triangles, of which it has the faces;
    /// and their sides.
    Faces(Vec<DVec3>, Vec<[u32; 3]>, Vec<u32>, Side),
}

/// What a table shows beside the values.
pub struct Table {
    /// What bears the values.
    pub shape: Shape,
    /// The number of receivers with and without a value.
    pub count: usize,
    /// The albedo of each face, if it is radiosity that is asked for.
    pub albedos: Option<FaceAlbedos>,
}

/// Value, standard error and number of samples.
type Values = [f64; 3];

impl Table {
    /// Writes the values of receivers that are on a film.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn write(
        &self,
        format: TableFormat,
        receivers: &Receivers,
        film: &Film,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let values = self.values(receivers, film);
        match format {
            TableFormat::Csv => self.csv(&values, out),
            TableFormat::Ply => self.ply(&values, out),
            TableFormat::Obj => self.obj(&values, out),
        }
    }

    /// The values of all receivers, in the order of the file.
    fn values(&self, receivers: &Receivers, film: &Film) -> Vec<Values> {
        let mut values = vec![[f64::NAN, f64::NAN, 0.]; self.count];
        let window = film.window;
        let errors = film.errors(WORTH, window);
        let numbers = &receivers.numbers[window.corner.1 as usize..];
        let found = film.means_of(window).into_iter().zip(errors);
        let found = found.zip(film.counts_of(window));
        for (&number, ((mean, error), count)) in numbers.iter().zip(found) {
            let (face, _) = self.face(number);
            let part = self.albedos.as_ref().map_or(1., |all| all.of(face));
            values[number as usize] = [part * mean, part * error, count];
        }
        values
    }

    /// The face of a receiver, from 0, and whether it is the back.
    pub fn face(&self, number: u32) -> (u32, bool) {
        match &self.shape {
            Shape::Faces(.., Side::Both) => (number / 2, number % 2 == 1),
            Shape::Faces(.., side) => (number, *side == Side::Back),
            _ => (number, false),
        }
    }

    fn csv(
        &self,
        values: &[Values],
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let quantity = match self.albedos {
            Some(_) => "radiosity",
            None => "irradiance",
        };
        let place = match self.shape {
            Shape::Points(_) => "x,y,z,nx,ny,nz",
            Shape::Vertices(..) => "vertex,x,y,z",
            Shape::Faces(..) => "face,side",
        };
        let unit = "[horizontal irradiance in the open = 1]";
        writeln!(out, "{place},{quantity} {unit},stderr,samples")?;
        // Write a line of CSV for each receiver
        for (number, &[value, error, samples]) in (0..).zip(values) {
            match &self.shape {
                Shape::Points(points) => {
                    let [p, n] = points[number as usize];
                    write!(
                        out,
                        "{},{},{},{},{},{}",
                        p.x, p.y, p.z, n.x, n.y, n.z
                    )?;
                }
                Shape::Vertices(vertices, _) => {
                    let p = vertices[number as usize];
                    write!(out, "{},{},{},{}", number + 1, p.x, p.y, p.z)?;
                }
                Shape::Faces(..) => {
                    let (face, is_back) = self.face(number);
                    let side = if is_back { "back" } else { "front" };
                    write!(out, "{},{side}", face + 1)?;
                }
            }
            let [value, error] = [value, error].map(|x| x as f32);
            writeln!(out, ",{value:?},{error:?},{samples}")?;
        }
        Ok(())
    }

    fn ply(
        &self,
        values: &[Values],
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let count = |all: &[[u32; 3]], times: usize| times * all.len();
        let sides = if matches!(self.shape, Shape::Faces(.., Side::Both)) {
            2
        } else {
            1
        };
        let (points, triangles) = match &self.shape {
            Shape::Points(points) => (points.len(), 0),
            Shape::Vertices(all, triangles) => {
                (all.len(), count(triangles, 1))
            }
            Shape::Faces(all, triangles, ..) => {
                (all.len(), count(triangles, sides))
            }
        };
        // Write the head of a PLY
        let numbers = "property float value\nproperty float stderr\n";
        let place =
            "property double x\nproperty double y\nproperty double z\n";
        let normal =
            "property float nx\nproperty float ny\nproperty float nz\n";
        let of_faces = matches!(self.shape, Shape::Faces(..));
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\ncomment relative to "
        )?;
        writeln!(out, "the horizontal irradiance in the open")?;
        write!(out, "element vertex {points}\n{place}")?;
        if let Shape::Points(_) = self.shape {
            out.write_all(normal.as_bytes())?;
        }
        out.write_all(if of_faces { b"" } else { numbers.as_bytes() })?;
        if triangles > 0 {
            writeln!(out, "element face {triangles}")?;
            writeln!(out, "property list uchar int vertex_indices")?;
            out.write_all(if of_faces { numbers.as_bytes() } else { b"" })?;
        }
        writeln!(out, "end_header")?;
        // Write the elements of a PLY
        let pair = |number: usize| {
            let [value, error, _] = values[number];
            let [value, error] =
                [value, error].map(|x| (x as f32).to_le_bytes());
            [value, error].concat()
        };
        let place = |p: DVec3| p.to_array().map(f64::to_le_bytes).concat();
        let corners = |[a, b, c]: [u32; 3]| {
            [&[3][..], &[a, b, c].map(u32::to_le_bytes).concat()].concat()
        };
        match &self.shape {
            Shape::Points(points) => {
                for (number, &[p, n]) in points.iter().enumerate() {
                    let n = n
                        .as_vec3()
                        .to_array()
                        .map(f32::to_le_bytes)
                        .concat();
                    out.write_all(&[place(p), n, pair(number)].concat())?;
                }
            }
            Shape::Vertices(vertices, triangles) => {
                for (number, &p) in vertices.iter().enumerate() {
                    out.write_all(&[place(p), pair(number)].concat())?;
                }
                for &triangle in triangles {
                    out.write_all(&corners(triangle))?;
                }
            }
            Shape::Faces(vertices, triangles, faces, side) => {
                for &p in vertices {
                    out.write_all(&place(p))?;
                }
                // Write the triangles of a side
                for number in 0..sides {
                    let is_back = *side == Side::Back || number == 1;
                    for (&[a, b, c], &face) in triangles.iter().zip(faces) {
                        let turned =
                            if is_back { [a, c, b] } else { [a, b, c] };
                        let pair = pair(sides * face as usize + number);
                        out.write_all(&[corners(turned), pair].concat())?;
                    }
                }
            }
        }
        Ok(())
    }

    fn obj(
        &self,
        values: &[Values],
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let Shape::Vertices(vertices, triangles) = &self.shape else {
            return Err(io::Error::other(
                "an OBJ shows values of --vertices",
            ));
        };
        for (p, [value, ..]) in vertices.iter().zip(values) {
            let grey = if value.is_nan() { 0. } else { *value as f32 };
            writeln!(
                out,
                "v {} {} {} {grey} {grey} {grey}",
                p.x, p.y, p.z
            )?;
        }
        for corners in triangles {
            let [a, b, c] = corners.map(|corner| corner + 1);
            writeln!(out, "f {a} {b} {c}")?;
        }
        Ok(())
    }
}
