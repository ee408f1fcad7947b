// Tangled from chapters/python.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Meshes from arrays.

use glam::DVec3;
use litpt::error::Result;
use litpt::inputs::Inputs;
use litpt::materials::{FaceAlbedos, Named};
use litpt::plan::Plan;
use litpt::scene::{Mesh, polygons};
use numpy::{PyArray1, PyArrayMethods};
use numpy::{PyReadonlyArray1, PyReadonlyArray2};
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;

/// Vertices; the corners of all faces; the number of corners of each face, if
/// it is not 3; and, if the faces are triangles of faces, those that belong to
/// the face before.
pub type Arrays<'py> = (
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, i64>,
    Option<PyReadonlyArray1<'py, i64>>,
    Option<PyReadonlyArray1<'py, u32>>,
);

/// The rows of an array of three columns.
pub fn vectors(rows: &PyReadonlyArray2<f64>) -> Vec<DVec3> {
    let rows = rows.as_array();
    let vector = |row: numpy::ndarray::ArrayView1<f64>| {
        DVec3::new(row[0], row[1], row[2])
    };
    rows.rows().into_iter().map(vector).collect()
}

/// The mesh of some arrays, and whether its faces are filled by triangles.
///
/// # Errors
/// A face has a vertex that is not there.
pub fn of(
    (vertices, corners, sizes, joined): Arrays,
) -> PyResult<(Mesh, bool)> {
    let vertices = vectors(&vertices);
    let mut mesh = Mesh { vertices, ..Mesh::default() };
    let corners = corners.as_array();
    let sizes = sizes.map(|sizes| sizes.as_array().to_vec());
    let count = sizes.as_ref().map_or(corners.len() / 3, Vec::len);
    let mut at = 0;
    for face in 0..count {
        let size = sizes.as_ref().map_or(3, |sizes| sizes[face] as usize);
        let mut fan = [0; 3];
        for n in 0..size {
            // Append the fan of a face
            let corner = corners[at + n];
            if corner < 0 || corner >= mesh.vertices.len() as i64 {
                let there = mesh.vertices.len();
                return Err(PyIndexError::new_err(format!(
                    "faces[{face}] has vertex {corner}: there are {there}, from 0"
                )));
            }
            // Append a triangle of the fan
            let corner = corner as u32;
            fan = [if n == 0 { corner } else { fan[0] }, fan[2], corner];
            if n > 2 {
                mesh.joined.push(mesh.triangles.len() as u32);
            }
            if n >= 2 {
                mesh.triangles.push(fan);
            }
        }
        at += size;
    }
    let joined = joined.map(|joined| joined.as_array().to_vec());
    let is_filled = joined.is_some();
    mesh.joined = joined.unwrap_or(mesh.joined);
    Ok((mesh, is_filled))
}

/// The mesh whose faces are filled, if they are not.
pub fn filled((mut mesh, is_filled): (Mesh, bool)) -> Mesh {
    if !is_filled {
        polygons::fill(&mut mesh);
    }
    mesh
}

/// Refuses an albedo of a name or a face that is not there.
pub fn check(plan: &Plan, inputs: &Inputs) -> Result<()> {
    let (mesh, albedos) = (&inputs.mesh, &inputs.albedos);
    mesh.check()?;
    let (count, faces) =
        (albedos.len(), mesh.triangles.len() - mesh.joined.len());
    let is_wrong = |albedo: &f64| !(0. ..=1.).contains(albedo);
    if count > 0 && count != faces {
        let fault = format!("albedo: {count} of them for {faces} faces");
        return Err(fault.into());
    }
    if let Some(at) = albedos.iter().position(is_wrong) {
        let (wrong, wanted) = (albedos[at], "expected 0 to 1");
        return Err(format!("albedo[{at}] = {wrong}: {wanted}").into());
    }
    let named_albedos = plan.surfaces.named.clone();
    let named = Named { named_albedos, ..Named::default() };
    FaceAlbedos::new(&mesh.marks, &named, 1.).map(drop)
}

/// The arrays of a mesh, as [`of`] takes them.
pub fn parts<'py>(
    py: Python<'py>,
    mesh: &Mesh,
) -> PyResult<Bound<'py, PyAny>> {
    let Mesh { vertices, triangles, joined, .. } = mesh;
    let places = vertices.iter().flat_map(|place| place.to_array());
    let places =
        PyArray1::from_iter(py, places).reshape([vertices.len(), 3])?;
    let corners = triangles.as_flattened().iter().map(|&i| i64::from(i));
    let corners = PyArray1::from_iter(py, corners);
    let joined = PyArray1::from_slice(py, joined);
    (places, corners, py.None(), joined).into_bound_py_any(py)
}
