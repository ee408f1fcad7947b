// Tangled from chapters/materials.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The reflection of surfaces: one albedo, or one for each face.
//!
//! ```
//! use litpt::materials::{FaceAlbedos, Named, names};
//! use litpt::scene::{MarkKind, read_obj};
//!
//! let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n";
//! let marks = read_obj(text.as_bytes())?.marks;
//! assert!(names(&marks, MarkKind::Material).eq(["red"]));
//! let named_albedos = vec![("red".to_owned(), 0.3)];
//! let named = Named { named_albedos, ..Named::default() };
//! assert_eq!(FaceAlbedos::new(&marks, &named, 0.8)?.of(0), 0.3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

pub mod glass;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs;
use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::bvh::{Bvh, GROUND, Hit, Intersector};
use crate::error::{Diagnostic, Error, Result};
use crate::scene::encoding::quoted;
use crate::scene::mtl::{Library, read_mtl};
use crate::scene::{Mark, MarkKind, Ray};
use glass::{Bsdf, CLEAREST, Pane};

/// The files in a folder that a statement refers to.
fn files(line: &str, folder: &Path) -> Vec<String> {
    let is_file = |name: &str| folder.join(name).is_file();
    if is_file(line) {
        return vec![line.to_owned()];
    }
    let line = line.replace('\\', "/").replace('"', "");
    let (mut files, mut name) = (vec![], String::new());
    for word in line.split_inclusive(char::is_whitespace) {
        name += word;
        let file = name.trim();
        if is_file(file) || file.to_ascii_lowercase().ends_with(".mtl") {
            files.push(file.to_owned());
            name.clear();
        }
    }
    files.extend(Some(name).filter(|name| !name.is_empty()));
    files
}

/// The number of the three of a material that is used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Band {
    /// The first.
    R,
    /// The second.
    G,
    /// The third.
    B,
}

/// What the libraries of a scene define of its materials.
#[derive(Default, Serialize, Deserialize)]
pub struct Defined {
    /// The albedo of each.
    pub albedos: BTreeMap<String, f64>,
    /// The transmittance of those that are glass.
    pub panes: BTreeMap<String, f64>,
}

/// What the libraries, in `folder`, define of each material that a scene uses:
/// its luminance, or one band; with `glass` also which are panes; and
/// warnings.
///
/// # Errors
/// A library cannot be read, or a `Kd` is not made of numbers from 0 to 1.
pub fn libraries(
    marks: &[Mark],
    (scene, folder): (&str, &Path),
    (band, glass): (Option<Band>, bool),
) -> Result<(Defined, Vec<Diagnostic>)> {
    let used: BTreeSet<_> = names(marks, MarkKind::Material).collect();
    let named = marks.iter().filter(|m| m.kind == MarkKind::Library);
    let files = named.flat_map(|mark| files(&mark.name, folder));
    let panes = glass.then(BTreeMap::new);
    let mut library = Library { panes, ..Library::default() };
    let mut seen = BTreeSet::new();
    for name in files.filter(|name| seen.insert(name.clone())) {
        // Read one library
        let shown = folder.join(quoted(&name)).display().to_string();
        let path = folder.join(name);
        let instead = "without materials, -r is the albedo of all";
        let bytes = match path.exists() && !path.is_file() {
            true => Err("not a file".to_owned()),
            false => fs::read(path).map_err(|e| format!("{e}; {instead}")),
        };
        bytes
            .map_err(Error::from)
            .and_then(|bytes| read_mtl(&bytes, &shown, &used, &mut library))
            .map_err(|error| error.of_file(&shown))?;
    }
    // Warn of properties that are missing or not rendered
    let mut warnings = library.warnings;
    for (mut first, n) in library.ignored.into_values() {
        first.text += &format!(": the first of {n} statements");
        warnings.push(first);
    }
    let is_unknown = |name: &&&str| !library.diffuse.contains_key(**name);
    if let Some(name) = used.iter().find(is_unknown) {
        let (name, n) = (quoted(name), used.len() - library.diffuse.len());
        let what = format!(
            "no library has a Kd r g b of material {name}, which is given \
             the albedo of -r or --albedo: the first of {n} materials"
        );
        warnings.push(Diagnostic::from(what).of_file(scene));
    }
    // Reduce each material to one number
    let number = |[r, g, b]: [f64; 3]| match band {
        None => 0.2126 * r + 0.7152 * g + 0.0722 * b,
        Some(band) => [r, g, b][band as usize],
    };
    let diffuse = library.diffuse.into_iter();
    let albedos = diffuse.map(|(name, kd)| (name, number(kd))).collect();
    // Limit panes to the clearest glass
    let panes = library.panes.into_iter().flatten();
    let panes = panes.filter_map(|(name, clear)| {
        let part = clear.part()? * clear.filter.map_or(1., number);
        (part > 0.).then_some((name, part.min(CLEAREST)))
    });
    let panes: BTreeMap<_, _> = panes.collect();
    if glass && panes.is_empty() {
        let what = "no material lets light through (d, Tr; times Tf), hence none is \
             glass";
        warnings.push(Diagnostic::from(what).of_file(scene));
    }
    let defined = Defined { albedos, panes };
    Ok((defined, warnings))
}

/// The distinct names of a kind, in order, without empty ones.
pub fn names(marks: &[Mark], kind: MarkKind) -> impl Iterator<Item = &str> {
    let of_kind = marks.iter().filter(move |mark| mark.kind == kind);
    let distinct: BTreeSet<&str> =
        of_kind.map(|mark| &mark.name[..]).collect();
    distinct.into_iter().filter(|name| !name.is_empty())
}

/// The albedos of a scene by name, which decide besides its file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// The albedos of the materials of its libraries.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub materials: BTreeMap<String, f64>,
    /// The band that was used for them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band: Option<Band>,
    /// The albedos given to materials, groups or objects; if several fit a
    /// face, the last one counts.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub named_albedos: Vec<(String, f64)>,
    /// The transmittances of the materials of its libraries that are glass.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub panes: BTreeMap<String, f64>,
    /// What materials, groups or objects let through, which counts before
    /// their albedos.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub transmitting: Vec<(String, Bsdf)>,
}

impl Named {
    /// The bsdf of each name that was given one, the last one before all.
    pub(crate) fn given(&self) -> impl Iterator<Item = (&str, Bsdf)> {
        let albedos = self.named_albedos.iter();
        let opaque = albedos.map(|(n, a)| (&n[..], Bsdf::Diffuse(*a)));
        let transmitting = self.transmitting.iter();
        opaque.chain(transmitting.map(|(name, bsdf)| (&name[..], *bsdf)))
    }
}

/// How the faces of a file scatter light.
#[derive(Clone, Debug, PartialEq)]
pub struct FaceAlbedos {
    /// The first face of each stretch of faces, and their bsdf.
    stretches: Vec<(u32, Bsdf)>,
}

impl FaceAlbedos {
    /// The albedos of a file with these marks, and `others` for faces
    /// without a name that has one.
    ///
    /// # Errors
    /// A name that was given an albedo is not in the file.
    pub fn new(marks: &[Mark], named: &Named, others: f64) -> Result<Self> {
        let mut is_used = vec![false; named.given().count()];
        let mut current: [&str; 3] = [""; 3];
        let mut stretches = vec![(0, Bsdf::Diffuse(others))];
        for Mark { face, kind, name } in marks {
            let Some(of_kind) = current.get_mut(*kind as usize) else {
                continue;
            };
            *of_kind = name;
            // Find how a face under the current names scatters
            let [object, groups, material] = current;
            let albedo = named.materials.get(material).unwrap_or(&others);
            let mut bsdf = match named.panes.get(material) {
                Some(transmittance) => Bsdf::Glass(*transmittance),
                None => Bsdf::Diffuse(*albedo),
            };
            for ((name, given), used) in named.given().zip(&mut is_used) {
                let mut names = [object, groups, material].into_iter();
                let is_group =
                    || groups.split_whitespace().any(|group| group == name);
                if names.any(|other| other == name) || is_group() {
                    (bsdf, *used) = (given, true);
                }
            }
            stretches.pop_if(|(first, _)| first == face);
            stretches.push((*face, bsdf));
        }
        // Reject a name that is not in the file
        let mut unknown = named.given().zip(is_used);
        if let Some(((name, bsdf), _)) = unknown.find(|(_, used)| !used) {
            let (option, value) = bsdf.typed(name);
            let option = format!("--{option} {value}");
            return Err(unknown_name(marks, name, &option).into());
        }
        Ok(Self { stretches })
    }

    /// These albedos of the faces, one by one.
    pub fn each(albedos: &[f64]) -> Self {
        let bsdfs = albedos.iter().copied().map(Bsdf::Diffuse);
        Self { stretches: (0..).zip(bsdfs).collect() }
    }

    /// The albedo of a face.
    pub fn of(&self, face: u32) -> f64 {
        self.bsdf(face).albedo()
    }

    /// How a face scatters light.
    pub fn bsdf(&self, face: u32) -> Bsdf {
        let after =
            self.stretches.partition_point(|&(first, _)| first <= face);
        self.stretches[after - 1].1
    }
}

/// Reports that nothing has a name, which an option has given.
pub fn unknown_name(marks: &[Mark], name: &str, option: &str) -> String {
    let kinds = [MarkKind::Material, MarkKind::Group, MarkKind::Object];
    let there = kinds.into_iter().flat_map(|kind| names(marks, kind));
    let there: Vec<_> = there.take(8).map(quoted).collect();
    let there = match there.is_empty() {
        true => "there is none".to_owned(),
        false => format!("there are: {}", there.join(", ")),
    };
    let name = quoted(name);
    format!(
        "no material, group or object is called {name} ({option}); {there}"
    )
}

/// The albedos of the triangles of a hierarchy, if there are several.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlbedoTable {
    /// The number of the albedo of each triangle, by its slot.
    numbers: Vec<u16>,
    /// The albedos.
    albedos: Vec<f64>,
    /// The bsdfs that have them.
    bsdfs: Vec<Bsdf>,
    /// The mean albedo, weighted by the area of the triangles.
    mean: f64,
}

impl AlbedoTable {
    /// The albedos of the triangles of a hierarchy, by their faces.
    ///
    /// # Errors
    /// There are more than 65 536 albedos.
    pub fn new(faces: &FaceAlbedos, bvh: &Bvh) -> Result<Self> {
        let (_, first) = faces.stretches[0];
        let is_first = |&(_, bsdf): &(u32, Bsdf)| bsdf == first;
        if faces.stretches.iter().all(is_first)
            && let Bsdf::Diffuse(mean) = first
        {
            let albedos = vec![mean];
            return Ok(Self { albedos, mean, ..Self::default() });
        }
        let (mut table, mut numbered) = (Self::default(), HashMap::new());
        let (mut sum, mut area_sum) = (0., 0.);
        bvh.for_each(|slot, &[a, b, c]| {
            let bsdf = faces.bsdf(bvh.face(slot));
            let albedo = bsdf.albedo();
            // Number a way to scatter
            let next = table.albedos.len();
            let number = *numbered.entry(bsdf.key()).or_insert(next);
            if number == next {
                table.albedos.push(albedo);
                table.bsdfs.push(bsdf);
            }
            let slot = slot as usize;
            table.numbers.resize(table.numbers.len().max(slot + 1), 0);
            table.numbers[slot] = number as u16;
            let area = (b - a).cross(c - a).length();
            (sum, area_sum) = (sum + albedo * area, area_sum + area);
        });
        if table.albedos.len() > 1 + usize::from(u16::MAX) {
            return Err("more than 65536 different albedos".into());
        }
        table.mean = sum / area_sum;
        Ok(table)
    }
}

/// The albedos of all surfaces.
#[derive(Clone, Copy, Debug)]
pub struct Surfaces<'a> {
    /// A typical albedo: the mean over the area of all triangles. Without a
    /// table, the albedo of each.
    pub typical: f64,
    table: Option<&'a AlbedoTable>,
    /// The albedo of the ground.
    ground: f64,
    /// The largest of all albedos.
    pub most: f64,
    /// Whether some let light through.
    pub transmits: bool,
}

impl<'a> Surfaces<'a> {
    /// One albedo for all surfaces.
    pub fn of(albedo: f64) -> Self {
        let (typical, most) = (albedo, albedo);
        let (table, ground, transmits) = (None, 0., false);
        Self { typical, table, ground, most, transmits }
    }

    /// An albedo for each triangle, from a table if there are several, and
    /// one for the ground, if there is one.
    pub fn new(table: &'a AlbedoTable, ground: Option<f64>) -> Self {
        let ground = ground.unwrap_or(0.);
        let most = table.albedos.iter().copied().fold(ground, f64::max);
        let is_opaque = |bsdf: &Bsdf| matches!(bsdf, Bsdf::Diffuse(_));
        let transmits = !table.bsdfs.iter().all(is_opaque);
        let many = table.bsdfs.len() > 1 || transmits;
        let typical = if many { table.mean } else { table.albedos[0] };
        let table = many.then_some(table);
        Self { typical, table, ground, most, transmits }
    }

    /// The albedo at a hit on this triangle, on the ground, or at a receiver,
    /// which is 1.
    #[inline(always)]
    pub fn albedo(&self, primitive: u32) -> f64 {
        match self.table {
            _ if primitive > GROUND => 1.,
            _ if primitive == GROUND => self.ground,
            Some(AlbedoTable { numbers, albedos, .. }) => {
                albedos[usize::from(numbers[primitive as usize])]
            }
            None => self.typical,
        }
    }

    /// How the surface there scatters light.
    fn bsdf(&self, primitive: u32) -> Bsdf {
        match self.table {
            Some(table) if primitive < GROUND => {
                let number = table.numbers[primitive as usize];
                table.bsdfs[usize::from(number)]
            }
            _ => Bsdf::Diffuse(self.albedo(primitive)),
        }
    }

    /// The albedo there, as a part of the largest.
    #[inline(always)]
    pub fn relative_albedo(&self, primitive: u32) -> f64 {
        let albedo = self.albedo(primitive);
        if albedo == self.most { 1. } else { albedo / self.most }
    }
}

impl Surfaces<'_> {
    /// The transmittance of the pane that a ray in this direction meets; none
    /// if the surface is no pane.
    #[inline(always)]
    pub fn pane(&self, hit: &Hit, direction: DVec3) -> Option<f64> {
        if self.transmits { self.glass(hit, direction) } else { None }
    }

    /// The same where some surfaces let light through.
    #[cold]
    #[inline(never)]
    fn glass(&self, hit: &Hit, direction: DVec3) -> Option<f64> {
        let Bsdf::Glass(part) = self.bsdf(hit.primitive) else {
            return None;
        };
        let cosine = hit.normal.dot(direction).abs();
        Some(Pane::new(part).transmittance(cosine.min(1.)))
    }

    /// The ray that goes on behind a pane, where the last pane was met.
    #[cold]
    #[inline(never)]
    pub fn behind(
        &self,
        pane: &Hit,
        direction: DVec3,
        last: &mut DVec3,
    ) -> Ray {
        let near = nearness(pane.point);
        let is_crowded = pane.point.distance(*last) <= near;
        *last = pane.point;
        let cosine = pane.normal.dot(direction).abs();
        let step =
            if is_crowded { 4. * near / cosine.max(1e-6) } else { 0. };
        Ray { origin: pane.point + step * direction, direction }
    }

    /// What a ray meets behind all panes, given its first hit; the part of
    /// the light from there that they transmit; and the rays traced.
    #[inline(always)]
    pub fn behind_panes(
        &self,
        intersector: &impl Intersector,
        direction: DVec3,
        hit: Option<Hit>,
    ) -> (Option<Hit>, f64, u64) {
        match self.transmits {
            true => self.look_through(intersector, direction, hit),
            false => (hit, 1., 0),
        }
    }

    /// The same where some surfaces let light through.
    #[cold]
    #[inline(never)]
    fn look_through(
        &self,
        intersector: &impl Intersector,
        direction: DVec3,
        mut hit: Option<Hit>,
    ) -> (Option<Hit>, f64, u64) {
        let (mut transmittance, mut rays) = (1., 0);
        let mut last = DVec3::INFINITY;
        while let Some(met) = hit
            && let Some(part) = self.pane(&met, direction)
        {
            let ray = self.behind(&met, direction, &mut last);
            hit = intersector.first_hit(&ray, Some(met.primitive));
            transmittance *= part;
            rays += 1;
        }
        (hit, transmittance, rays)
    }

    /// The hit, with its normal on the side from which the scattered light
    /// comes: from behind for the part that a sheet transmits.
    /// The number `u` chooses, and is uniform over [0, 1) before and after.
    #[inline(always)]
    pub fn lit_side(&self, hit: &Hit, u: &mut f64) -> Hit {
        if self.transmits { self.side(hit, u) } else { *hit }
    }

    /// Its normal alone, and the number.
    #[inline(always)]
    pub fn lit_normal(&self, hit: &Hit, mut u: f64) -> (DVec3, f64) {
        if self.transmits {
            let side = self.side(hit, &mut u);
            return (side.normal, u);
        }
        (hit.normal, u)
    }

    /// The same where some surfaces let light through.
    #[cold]
    #[inline(never)]
    fn side(&self, hit: &Hit, u: &mut f64) -> Hit {
        let share = match self.sheet(hit.primitive) {
            Some([back, on]) => back / (back + on),
            None => return *hit,
        };
        if *u < share {
            *u /= share;
            return *hit;
        }
        *u = ((*u - share) / (1. - share)).min(BELOW_ONE);
        Hit { normal: -hit.normal, ..*hit }
    }

    /// The parts that a sheet reflects and transmits; none if the surface lets
    /// nothing through.
    #[inline(always)]
    pub fn sheet(&self, primitive: u32) -> Option<[f64; 2]> {
        if !self.transmits {
            return None;
        }
        match self.bsdf(primitive) {
            Bsdf::Transmitter([back, on]) if on > 0. => Some([back, on]),
            _ => None,
        }
    }

    /// Whether some surface is a sheet.
    pub fn has_sheets(&self) -> bool {
        let bsdfs = self.table.map_or(&[][..], |table| &table.bsdfs);
        bsdfs.iter().any(|bsdf| match bsdf {
            Bsdf::Transmitter([_, on]) => *on > 0.,
            _ => false,
        })
    }
}

/// How close surfaces are that count as one, here: 2^-30 of the coordinates.
pub fn nearness(point: DVec3) -> f64 {
    (1. + point.abs().max_element()) / (1u64 << 30) as f64
}

/// The largest number below 1.
const BELOW_ONE: f64 = 1. - 0.5 * f64::EPSILON;
