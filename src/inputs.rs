// Tangled from chapters/plan.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The inputs of a plan, from files or from memory.
//!
//! ```
//! use glam::DVec3;
//! use litpt::{inputs::Inputs, scene::read_obj};
//!
//! let mesh = read_obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")?;
//! let up = [(DVec3::new(0.2, 0.2, 0.1), DVec3::Z)];
//! let inputs = Inputs::from(mesh).with_points(up);
//! assert_eq!(inputs.points.len(), 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::DVec3;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::host::Host;
use crate::materials::{Defined, libraries};
use crate::matrix::daylight::SkyMatrix;
use crate::plan::{Plan, input_name, is_dash};
use crate::scene::{Mesh, begins_obj, read_file};
use crate::sensor::{Point, read_points};
use crate::sky::{Cover, Patchwork};
use crate::tally::patches::Patches;

/// The inputs of a plan.
#[derive(Clone, Default)]
pub struct Inputs {
    /// The mesh of the scene, in its own coordinates.
    pub mesh: Arc<Mesh>,
    /// The SHA-256 of its file in hexadecimal, if a file records it.
    pub sha256: String,
    /// The points of a sensor of points.
    pub points: Vec<Point>,
    /// The SHA-256 of their file.
    pub points_sha256: String,
    /// The patches of the sky, if it is of a matrix.
    pub sky: Option<Arc<Patchwork>>,
    /// The albedo of each face, if they are given one by one.
    pub albedos: Vec<f64>,
    /// The albedos of materials by name.
    pub materials: BTreeMap<String, f64>,
    /// The transmittances of the materials that are glass.
    pub panes: BTreeMap<String, f64>,
    /// Seconds for reading.
    pub seconds: f64,
}

impl From<Mesh> for Inputs {
    fn from(mesh: Mesh) -> Self {
        Self { mesh: mesh.into(), ..Self::default() }
    }
}

impl Inputs {
    /// Reads the files of a plan; the first of several processes sends
    /// them to the others.
    ///
    /// # Errors
    /// A file cannot be read, or has the wrong contents.
    pub fn read(plan: &Plan, host: Host) -> Result<Self> {
        let began = Instant::now();
        // Read the scene, and points if there are any
        let bytes = load(&plan.scene, true, host)?;
        let mut inputs =
            Self { sky: read_sky(plan, host)?, ..Self::default() };
        if let Some(path) = plan.points() {
            let bytes = load(path, false, host)?;
            inputs.points_sha256 = sha256(&bytes);
            let (file, mut odd) = (input_name(path), vec![]);
            let points = read_points(&bytes, &mut odd);
            inputs.points = points.map_err(|error| error.of_file(&file))?;
            host.warn_all(&file, odd);
        }
        inputs.mesh = parse(&plan.scene_name(), &bytes, host)?.into();
        if plan.names_scene() {
            inputs.sha256 = sha256(&bytes);
        }
        drop(bytes);
        if plan.surfaces.materials != Some(false) {
            let found = materials(plan, &inputs.mesh, host)?;
            (inputs.materials, inputs.panes) = (found.albedos, found.panes);
        }
        inputs.seconds = began.elapsed().as_secs_f64();
        Ok(inputs)
    }

    /// Reads the mesh of a scene, and nothing else.
    ///
    /// # Errors
    /// The file cannot be read, or holds no mesh.
    pub fn open(scene: impl Into<PathBuf>) -> Result<Self> {
        let plan = Plan { scene: scene.into(), ..Plan::default() };
        Self::read(&plan, Host::default())
    }

    /// Replaces the points, each a position and a normal, of any length but
    /// zero, in the coordinates of the scene.
    pub fn with_points(
        mut self,
        points: impl IntoIterator<Item = (DVec3, DVec3)>,
    ) -> Self {
        let points = points.into_iter().zip(1..);
        self.points = points.map(|((p, n), line)| (p, n, line)).collect();
        self
    }
}

/// The patches of the sky of a plan, if it is of a matrix.
///
/// # Errors
/// The file cannot be read, or has no such sky.
pub fn read_sky(plan: &Plan, host: Host) -> Result<Option<Arc<Patchwork>>> {
    let Cover::Matrix(file, column) = &plan.sky.cover else {
        return Ok(None);
    };
    let bytes = load(file, false, host)?;
    let sky = patchwork(&bytes, file, *column);
    let sky = sky.map_err(|error| error.of_file(input_name(file)))?;
    Ok(Some(sky.into()))
}

/// The sky of a column of a sky matrix.
///
/// # Errors
/// The bytes are none, there is no such column, or it has no light.
pub fn patchwork(
    bytes: &[u8],
    file: &Path,
    column: Option<u32>,
) -> Result<Patchwork> {
    let typed = Cover::Matrix(file.to_owned(), column);
    let matrix = SkyMatrix::read(bytes)?;
    let (count, steps) = (matrix.patches, matrix.steps);
    let factors = [(146, 1), (578, 2), (2306, 4)];
    let factor = factors.into_iter().find(|(n, _)| *n == count);
    let wanted = "and skies have 146, 578 or 2306";
    let fault = format!("it has {count} rows, {wanted}");
    let (_, factor) = factor.ok_or(fault)?;
    let fault =
        format!("it has {steps} columns: name one, as in {typed}:1");
    let only = (steps == 1).then_some(1);
    let column = column.or(only).ok_or(fault)?;
    let fault = format!("it has {steps} columns, and none {column}");
    let values = matrix.column(column).ok_or(fault)?;
    let hashed = format!("{}.smx", sha256(bytes)).into();
    let covers = [typed, Cover::Matrix(hashed, Some(column))];
    let patches = Patches::new(factor, DVec3::Z);
    let fault =
        format!("its column {column} has no light above the horizon");
    Ok(Patchwork::new(covers, patches, &values).ok_or(fault)?)
}

/// The bytes of a file, which the first process reads.
fn load(path: &Path, is_scene: bool, host: Host) -> Result<Vec<u8>> {
    let leads = host.ranks.rank_and_size().0 == 0;
    let bytes =
        if leads { read_bytes(path, is_scene, host)? } else { vec![] };
    host.ranks.broadcast(bytes)
}

/// The bytes of a file or of standard input.
fn read_bytes(path: &Path, is_scene: bool, host: Host) -> Result<Vec<u8>> {
    let file = input_name(path);
    host.enter(format!("reading {file}"), None);
    let fault = || Error::cannot("read", &file);
    let mut pipe: Box<dyn Read> = match path {
        path if is_dash(path) => Box::new(io::stdin()),
        path if path.is_file() => return fs::read(path).map_err(fault()),
        path => Box::new(File::open(path).map_err(fault())?),
    };
    let mut bytes = Vec::new();
    pipe.by_ref()
        .take(PROBE_BYTES)
        .read_to_end(&mut bytes)
        .map_err(fault())?;
    let is_long = is_scene && bytes.len() as u64 == PROBE_BYTES;
    if is_long && !begins_obj(&bytes) {
        let vertex = "no vertex in the first 64 MiB";
        return Err(fault()(io::Error::other(vertex)));
    }
    pipe.read_to_end(&mut bytes).map_err(fault())?;
    if is_scene && is_dash(path) && bytes.is_empty() {
        let fault = Error::from("empty; name a scene, as in pt scene.obj");
        return Err(fault.of_file(file));
    }
    Ok(bytes)
}

/// An OBJ has a vertex within so many bytes.
const PROBE_BYTES: u64 = 1 << 26;

/// Parses the mesh of a scene, and warns of oddities.
fn parse(file: &str, bytes: &[u8], host: Host) -> Result<Mesh> {
    host.enter(format!("parsing {file}"), None);
    let read = read_file(bytes).map_err(|error| error.of_file(file));
    let (mesh, warnings) = read?;
    host.warn_all(file, warnings);
    Ok(mesh)
}

/// A hash of some bytes, in hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    let hash = Sha256::digest(bytes);
    hash.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What the libraries of a mesh define of its materials.
fn materials(plan: &Plan, mesh: &Mesh, host: Host) -> Result<Defined> {
    in_first_rank(host, || {
        let folder = plan.scene.parent().unwrap_or(Path::new(""));
        let file = (&*plan.scene_name(), folder);
        let is_asked = plan.surfaces.materials == Some(true);
        let wanted = (plan.surfaces.band, plan.surfaces.glass);
        let (defined, warnings) = match libraries(&mesh.marks, file, wanted)
        {
            Err(fault) if !is_asked => {
                host.warn(fault.to_string());
                Default::default()
            }
            found => found?,
        };
        if is_asked || !defined.albedos.is_empty() {
            host.warn_all("", warnings);
        }
        Ok(defined)
    })
}

/// Finds something in the first process, and sends it to all.
///
/// # Errors
/// The first finds none, or has ended, or is of another version.
pub(crate) fn in_first_rank<T: Serialize + DeserializeOwned>(
    host: Host,
    find: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let (rank, size) = host.ranks.rank_and_size();
    if size == 1 {
        return find();
    }
    if rank == 0 {
        let found = find()?;
        let text = serde_json::to_vec(&found).unwrap_or_default();
        host.ranks.broadcast(text)?;
        return Ok(found);
    }
    let text = host.ranks.broadcast(vec![])?;
    serde_json::from_slice(&text)
        .map_err(|_| "rank 0 runs another version".into())
}
