// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! What a tally sorts light by: surfaces, patches of the sky, or reflections.
//!
//! Its bits belong to `SAMPLE_VERSION`.

pub mod patches;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::bvh::{Bvh, GROUND, Hit};
use crate::error::{Error, Result};
use crate::materials::{FaceAlbedos, Named, names, unknown_name};
use crate::scene::encoding::quoted;
use crate::scene::{Mark, MarkKind, Mesh};
use patches::Patches;

/// What the light of a receiver is sorted by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tally {
    /// The surface that a direction meets first.
    ViewFactors(Surface),
    /// The patch of Reinhart's sky, of this multiplication factor, in which a
    /// path ends.
    SkyPatches(u32),
    /// How often a path is reflected at the surfaces of this name.
    Derivative(String),
}

/// The surfaces that share a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Surface {
    /// One face.
    Faces,
    /// The faces of a material.
    Materials,
    /// The faces of an object.
    Objects,
    /// The faces of a group.
    Groups,
}

/// The parts of the rows of daylight coefficients, which are independent.
pub const REPLICATES: u64 = 32;

impl Tally {
    /// Whether it asks only what a direction meets first.
    #[inline(always)]
    pub fn is_of_surfaces(&self) -> bool {
        matches!(self, Self::ViewFactors(_))
    }

    /// The name of the value that has chosen it, and this value.
    pub fn named(&self) -> (&'static str, String) {
        match self {
            Self::ViewFactors(surface) => {
                ("view-factors", format!("{surface:?}").to_lowercase())
            }
            Self::SkyPatches(factor) => ("sky-patches", factor.to_string()),
            Self::Derivative(name) => ("derivative", name.clone()),
        }
    }

    /// Whether its rows can be gathered from a cache.
    pub fn can_gather(&self) -> bool {
        matches!(self, Self::SkyPatches(1 | 2))
    }

    /// The parts of a row, among which replicates are divided in turn.
    pub fn parts(&self) -> u64 {
        match self {
            Self::SkyPatches(_) => REPLICATES,
            _ => 1,
        }
    }
}

/// The columns of a tally.
pub struct Columns {
    /// What they are.
    pub tally: Tally,
    /// How many.
    pub count: u32,
    /// The number of columns of a face: two, if its back has its own.
    sides: u32,
    /// The column of each face, or its front.
    of_face: Vec<u32>,
    /// The slope at each face.
    slopes: Vec<f64>,
    /// The names of columns that share surfaces, and of those beyond.
    names: Vec<String>,
    /// The patches of the sky, if they are the columns.
    pub patches: Patches,
}

/// The names of the columns of faces without a name, and beyond all surfaces.
const OTHERS: [&str; 3] = ["unnamed", "sky", "ground"];

impl Columns {
    /// The columns of a tally in a scene, whose faces have these albedos, under
    /// a sky with this zenith; a face has one column or two.
    ///
    /// # Errors
    /// There is no such name in the scene, or its albedo is 0 somewhere.
    pub fn new(
        tally: &Tally,
        mesh: &Mesh,
        albedos: &FaceAlbedos,
        zenith: DVec3,
        has_sides: bool,
    ) -> Result<Self> {
        let mut sides = 1;
        let (mut of_face, mut slopes, mut names) = (vec![], vec![], vec![]);
        let mut patches = Patches::new(1, zenith);
        // Number the columns
        let faces = mesh.faces().last().map_or(0, |last| last + 1);
        let count = match tally {
            Tally::ViewFactors(Surface::Faces) => {
                sides += u32::from(has_sides);
                of_face = (0..faces).map(|face| sides * face).collect();
                sides * faces + 2
            }
            Tally::ViewFactors(surface) => {
                (of_face, names) =
                    named(&mesh.marks, *surface, faces as usize);
                names.len() as u32
            }
            Tally::SkyPatches(factor) => {
                patches = Patches::new(*factor, zenith);
                patches.count()
            }
            Tally::Derivative(name) => {
                slopes = self::slopes(name, &mesh.marks, albedos, faces)?;
                1
            }
        };
        let tally = tally.clone();
        Ok(Self { tally, count, sides, of_face, slopes, names, patches })
    }

    /// The column of what a direction meets first: a surface, or else the sky
    /// or the ground.
    #[inline(always)]
    pub fn seen(&self, bvh: &Bvh, hit: Option<&Hit>, is_up: bool) -> u32 {
        match hit {
            Some(hit) if hit.primitive != GROUND => {
                let front = self.of_face[bvh.face(hit.primitive) as usize];
                front + u32::from(self.sides == 2 && bvh.is_on_back(hit))
            }
            None if is_up => self.count - 2,
            _ => self.count - 1,
        }
    }

    /// One over the albedo at a hit on this triangle, if it is the one by which
    /// the light is differentiated; else 0.
    #[inline(always)]
    pub fn slope(&self, bvh: &Bvh, primitive: u32) -> f64 {
        if self.slopes.is_empty() || primitive >= GROUND {
            return 0.;
        }
        self.slopes[bvh.face(primitive) as usize]
    }

    /// The name of a column.
    pub fn name(&self, column: u32) -> String {
        match &self.tally {
            Tally::SkyPatches(_) => column.to_string(),
            Tally::Derivative(name) => name.clone(),
            Tally::ViewFactors(Surface::Faces) => {
                match (column + 3).checked_sub(self.count) {
                    Some(k @ 1..) => OTHERS[k as usize].to_owned(),
                    _ => face_name(column, self.sides),
                }
            }
            Tally::ViewFactors(_) => self.names[column as usize].clone(),
        }
    }
}

/// The name of a face with one side or two, among all sides.
pub(crate) fn face_name(number: u32, sides: u32) -> String {
    match (sides, number % 2) {
        (1, _) => (number + 1).to_string(),
        (_, 0) => format!("{} front", number / 2 + 1),
        _ => format!("{} back", number / 2 + 1),
    }
}

/// The column of each of some faces, and the names of the columns.
fn named(
    marks: &[Mark],
    surface: Surface,
    faces: usize,
) -> (Vec<u32>, Vec<String>) {
    let kind = match surface {
        Surface::Faces | Surface::Objects => MarkKind::Object,
        Surface::Materials => MarkKind::Material,
        Surface::Groups => MarkKind::Group,
    };
    let found: Vec<_> = names(marks, kind).collect();
    let (unnamed, mut of_face) = (found.len(), vec![]);
    let mut column = unnamed as u32;
    for Mark { face, name, .. } in marks.iter().filter(|m| m.kind == kind) {
        of_face.resize(*face as usize, column);
        let place = found.binary_search(&&name[..]);
        column = place.unwrap_or(unnamed) as u32;
    }
    of_face.resize(faces, column);
    // Distinguish a surface from what is beyond all
    let distinct = found.iter().map(|name| match OTHERS.contains(name) {
        true => format!("named {name}"),
        false => (*name).to_owned(),
    });
    (of_face, distinct.chain(OTHERS.map(str::to_owned)).collect())
}

/// The slope at each of some faces, by the albedo of those of a name.
fn slopes(
    name: &str,
    marks: &[Mark],
    albedos: &FaceAlbedos,
    faces: u32,
) -> Result<Vec<f64>> {
    let named_albedos = vec![(name.to_owned(), 1.)];
    let named = Named { named_albedos, ..Named::default() };
    let meant = FaceAlbedos::new(marks, &named, 0.);
    let meant =
        meant.ok().filter(|_| !name.is_empty()).ok_or_else(|| {
            let option = format!("--derivative {}", quoted(name));
            unknown_name(marks, name, &option)
        })?;
    let slope = |face| match meant.of(face) {
        0. => 0.,
        _ => 1. / albedos.of(face),
    };
    let slopes: Vec<f64> = (0..faces).map(slope).collect();
    if slopes.contains(&f64::INFINITY) {
        let fault = format!(
            "derivative {name}: its albedo is 0, and no path goes on from it"
        );
        return Err(Error::value("derivative", name, fault));
    }
    Ok(slopes)
}
