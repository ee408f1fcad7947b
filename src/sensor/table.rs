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
use crate::scene::Scene;
use crate::sensor::{Receivers, Refusal, Side};

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
    /// Points, with these normals.
    Points(Vec<DVec3>),
    /// The vertices of triangles.
    Vertices,
    /// The faces of triangles, given that of each; and their sides.
    Faces(Vec<u32>, Side),
}

impl Shape {
    /// What it is called.
    pub fn name(&self) -> &str {
        match self {
            Self::Points(_) => "points",
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
    /// The albedo of each face, if it is radiosity that is asked for.
    pub albedos: Option<FaceAlbedos>,
}

/// A value, its standard error and number of samples.
type Value = [f64; 3];

impl Table {
    /// The receivers, in its order.
    pub fn receivers(&self, scene: &Scene) -> Receivers {
        let Self { vertices, triangles, .. } = self;
        match &self.shape {
            Shape::Points(normals) => {
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

    /// Which of the receivers have no value, and why, if there are any.
    pub fn refusals(&self, receivers: &Receivers) -> Option<String> {
        let Receivers { numbers, refused, .. } = receivers;
        let kinds = [
            (Refusal::Normal, "have no normal"),
            (Refusal::Close, "are in an edge, or too close to a surface"),
            (Refusal::Far, "are too far away"),
            (Refusal::Area, "have no area"),
        ];
        let told = kinds.into_iter().filter_map(|(kind, words)| {
            let mut of_kind =
                refused.iter().filter(|&&(_, why)| why == kind);
            let (first, is_back) = self.face(of_kind.next()?.0);
            let (first, count) = (first + 1, 1 + of_kind.count());
            let back = if is_back { "the back of " } else { "" };
            Some(format!("{count} {words}, the first {back}{first}"))
        });
        let told = told.collect::<Vec<_>>().join("; ");
        let (none, name) = (refused.len(), self.shape.name());
        let all = numbers.len() + none;
        let line = format!("{none} of {all} {name} have no value: {told}");
        (none > 0).then_some(line)
    }

    /// Writes the values of receivers that are on a film, with the samples of
    /// each in a replicate, if they differ.
    ///
    /// # Errors
    /// They cannot be written.
    pub fn write(
        &self,
        format: TableFormat,
        receivers: &Receivers,
        film: &Film,
        allocation: Option<&[u32]>,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let values = self.values(receivers, film, allocation);
        match format {
            TableFormat::Csv => self.csv(&values, out),
            TableFormat::Ply => self.ply(&values, out),
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
        let quantity = match self.albedos {
            Some(_) => "radiosity",
            None => "irradiance",
        };
        let place = match self.shape {
            Shape::Points(_) => "x,y,z,nx,ny,nz",
            Shape::Vertices => "vertex,x,y,z",
            Shape::Faces(..) => "face,side",
        };
        let unit = "[horizontal irradiance in the open = 1]";
        writeln!(out, "{place},{quantity} {unit},stderr,samples")?;
        // Write a line of CSV for each receiver
        for (i, &[value, error, samples]) in values.iter().enumerate() {
            let vertex = || typed(self.vertices[i]);
            let place = match &self.shape {
                Shape::Points(normals) => {
                    vertex() + "," + &typed(normals[i])
                }
                Shape::Vertices => format!("{},{}", i + 1, vertex()),
                Shape::Faces(..) => {
                    let (face, is_back) = self.face(i as u32);
                    let side = if is_back { "back" } else { "front" };
                    format!("{},{side}", face + 1)
                }
            };
            let [value, error] = [value, error].map(|x| x as f32);
            writeln!(out, "{place},{value:?},{error:?},{samples}")?;
        }
        Ok(())
    }

    fn ply(&self, values: &[Value], out: &mut dyn Write) -> io::Result<()> {
        let Self { shape, vertices, triangles, .. } = self;
        let sides = match shape {
            Shape::Faces(_, Side::Both) => 2,
            _ => 1,
        };
        // Write the head of a PLY
        let numbers = "property float value\nproperty float stderr\n";
        let normal =
            "property float nx\nproperty float ny\nproperty float nz\n";
        let [of_vertices, of_faces] = match shape {
            Shape::Points(_) => [&[normal, numbers].concat(), ""],
            Shape::Vertices => [numbers, ""],
            Shape::Faces(..) => ["", numbers],
        };
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\n\
             comment relative to the horizontal irradiance in the open\n\
             element vertex {}\n\
             property double x\nproperty double y\nproperty double z\n\
             {of_vertices}",
            vertices.len()
        )?;
        if !triangles.is_empty() {
            writeln!(out, "element face {}", sides * triangles.len())?;
            writeln!(out, "property list uchar int vertex_indices")?;
            write!(out, "{of_faces}")?;
        }
        writeln!(out, "end_header")?;
        let floats = |all: &[f64]| -> Vec<u8> {
            all.iter().flat_map(|&x| (x as f32).to_le_bytes()).collect()
        };
        let pair = |number: usize| floats(&values[number][..2]);
        // Write the elements of a PLY
        for (number, place) in vertices.iter().enumerate() {
            out.write_all(
                &place.to_array().map(f64::to_le_bytes).concat(),
            )?;
            if let Shape::Points(normals) = shape {
                out.write_all(&floats(&normals[number].to_array()))?;
            }
            if !matches!(shape, Shape::Faces(..)) {
                out.write_all(&pair(number))?;
            }
        }
        for side in 0..sides {
            // Write the triangles of a side
            let (_, is_back) = self.face(side as u32);
            for (i, &[a, b, c]) in triangles.iter().enumerate() {
                let corners = if is_back { [a, c, b] } else { [a, b, c] };
                out.write_all(&[3])?;
                out.write_all(&corners.map(u32::to_le_bytes).concat())?;
                if let Shape::Faces(faces, _) = shape {
                    out.write_all(&pair(sides * faces[i] as usize + side))?;
                }
            }
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
