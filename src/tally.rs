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
    /// The column of each triangle, or its front, by its slot.
    of_slot: Vec<u32>,
    /// The slope at each triangle, by its slot.
    slopes: Vec<f64>,
    /// The names of columns that are not faces.
    names: Vec<String>,
    patches: Patches,
}

/// The names of the columns beyond all surfaces.
const BEYOND: [&str; 2] = ["sky", "ground"];

impl Columns {
    /// The columns of a tally in a scene, whose faces have these albedos, under
    /// a sky with this zenith; a face has one column or two.
    ///
    /// # Errors
    /// There is no such name in the scene, or its albedo is 0 somewhere.
    pub fn new(
        tally: &Tally,
        (mesh, bvh): (&Mesh, &Bvh),
        albedos: &FaceAlbedos,
        zenith: DVec3,
        has_sides: bool,
    ) -> Result<Self> {
        let factor = match tally {
            &Tally::SkyPatches(factor) => factor,
            _ => 1,
        };
        let mut columns = Self {
            tally: tally.clone(),
            count: 1,
            sides: 1,
            of_slot: vec![],
            slopes: vec![],
            names: vec![],
            patches: Patches::new(factor, zenith),
        };
        // Number the columns
        match tally {
            Tally::ViewFactors(Surface::Faces) => {
                columns.sides = if has_sides { 2 } else { 1 };
                let faces = mesh.faces().last().map_or(0, |last| last + 1);
                columns.count = columns.sides * faces;
                columns.of_slot = by_slot(bvh, |face| columns.sides * face);
            }
            Tally::ViewFactors(surface) => {
                let kind = surface.kind();
                let (found, names) = named(&mesh.marks, kind);
                columns.count = names.len() as u32;
                columns.names = names;
                columns.of_slot = by_slot(bvh, found);
            }
            Tally::SkyPatches(_) => columns.count = columns.patches.count(),
            Tally::Derivative(name) => {
                columns.slopes = slopes(name, mesh, bvh, albedos)?;
            }
        }
        // Add the columns beyond all surfaces
        if tally.is_of_surfaces() {
            columns.count += BEYOND.len() as u32;
        }
        Ok(columns)
    }

    /// The column of what a direction meets first: a surface, or else the sky
    /// or the ground.
    #[inline(always)]
    pub fn seen(
        &self,
        hit: Option<&Hit>,
        is_up: bool,
        is_back: impl Fn(&Hit) -> bool,
    ) -> u32 {
        let [sky, ground] = [self.count - 2, self.count - 1];
        match hit {
            Some(hit) if hit.primitive == GROUND => ground,
            Some(hit) => {
                let front = self.of_slot[hit.primitive as usize];
                front + u32::from(self.sides == 2 && is_back(hit))
            }
            None if is_up => sky,
            None => ground,
        }
    }

    /// The column of a direction of the sky.
    #[inline(always)]
    pub fn patch(&self, direction: DVec3) -> u32 {
        self.patches.number(direction)
    }

    /// One over the albedo of a triangle, if it is the one by whose albedo the
    /// light is differentiated; else 0.
    #[inline(always)]
    pub fn slope(&self, primitive: u32) -> f64 {
        let slope = self.slopes.get(primitive as usize);
        slope.copied().unwrap_or(0.)
    }

    /// The name of a column.
    pub fn name(&self, column: u32) -> String {
        match &self.tally {
            Tally::SkyPatches(_) => return column.to_string(),
            Tally::Derivative(name) => return name.clone(),
            Tally::ViewFactors(_) => (),
        }
        if let Some(k) = (column + 2).checked_sub(self.count) {
            return BEYOND[k as usize].to_owned();
        }
        match self.names.get(column as usize) {
            Some(name) => name.clone(),
            None if self.sides == 1 => (column + 1).to_string(),
            None => {
                let side = ["front", "back"][column as usize % 2];
                format!("{} {side}", column / 2 + 1)
            }
        }
    }
}

impl Surface {
    fn kind(self) -> MarkKind {
        match self {
            Self::Faces | Self::Objects => MarkKind::Object,
            Self::Materials => MarkKind::Material,
            Self::Groups => MarkKind::Group,
        }
    }
}

/// A value of each triangle, by its slot, given that of its face.
fn by_slot<T: Copy + Default>(bvh: &Bvh, of: impl Fn(u32) -> T) -> Vec<T> {
    let mut values = vec![];
    bvh.for_each(|slot, _| {
        let slot = slot as usize;
        values.resize(values.len().max(slot + 1), T::default());
        values[slot] = of(bvh.face(slot as u32));
    });
    values
}

/// The number of the name of each face, and the names of a kind.
fn named(
    marks: &[Mark],
    kind: MarkKind,
) -> (impl Fn(u32) -> u32, Vec<String>) {
    let mut list: Vec<String> =
        names(marks, kind).map(str::to_owned).collect();
    let place = |name: &str| list.binary_search_by(|n| n[..].cmp(name));
    let unnamed = list.len() as u32;
    let of_kind = marks.iter().filter(|mark| mark.kind == kind);
    let mut stretches = vec![(0, unnamed)];
    for Mark { face, name, .. } in of_kind {
        let column = place(name).map_or(unnamed, |k| k as u32);
        stretches.push((*face, column));
    }
    // Tell a surface from what is beyond all
    for name in &mut list {
        if BEYOND.contains(&&name[..]) || *name == "unnamed" {
            name.insert_str(0, "named ");
        }
    }
    list.push("unnamed".to_owned());
    let found = move |face| {
        let after = stretches.partition_point(|&(first, _)| first <= face);
        stretches[after - 1].1
    };
    (found, list)
}

/// The slope at each triangle of a name, by its slot.
fn slopes(
    name: &str,
    mesh: &Mesh,
    bvh: &Bvh,
    albedos: &FaceAlbedos,
) -> Result<Vec<f64>> {
    let named_albedos = vec![(name.to_owned(), 1.)];
    let named = Named { named_albedos, ..Named::default() };
    let meant =
        FaceAlbedos::new(&mesh.marks, &named, 0.).map_err(|_| {
            let option = format!("--derivative {}", quoted(name));
            unknown_name(&mesh.marks, name, &option)
        })?;
    let slope = |face| match meant.of(face) {
        0. => 0.,
        _ => 1. / albedos.of(face),
    };

    let slopes = by_slot(bvh, slope);
    if slopes.iter().any(|slope| slope.is_infinite()) {
        let fault = format!(
            "derivative {name}: its albedo is 0, and no path goes on from it"
        );
        return Err(Error::value("derivative", name, fault));
    }
    Ok(slopes)
}
