// Tangled from chapters/materials.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! What surfaces reflect: one albedo, or one for each face.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use crate::bvh::{Bvh, GROUND};
use crate::scene::encoding::quoted;
use crate::scene::{Mark, MarkKind};

/// What is taken of the three numbers of a material.
#[derive(
    ValueEnum, Clone, Copy, Debug, PartialEq, Serialize, Deserialize,
)]
#[serde(rename_all = "lowercase")]
pub enum Band {
    /// The first.
    R,
    /// The second.
    G,
    /// The third.
    B,
}

/// The albedo of each material of the libraries that a file names, which are
/// in `folder`: its luminance, or one band; and what is odd about them.
///
/// # Errors
/// A library cannot be read, or a material reflects less than nothing or more
/// than all.
pub fn libraries(
    marks: &[Mark],
    folder: &Path,
    band: Option<Band>,
) -> Result<(BTreeMap<String, f64>, Vec<String>), String> {
    let (mut albedos, mut odd) = (BTreeMap::new(), BTreeSet::new());
    let named = marks.iter().filter(|mark| mark.kind == MarkKind::Library);
    for Mark { name, .. } in named {
        let files = match folder.join(name).exists() {
            true => vec![name.as_str()],
            false => name.split_whitespace().collect(),
        };
        for file in files {
            // Read one library
            let path = folder.join(file);
            let shown = path.display();
            let file = File::open(&path).map_err(|e| {
                format!("{shown}: {e}; without --materials, -r is the albedo of all")
            })?;
            let (materials, _) =
                tobj::load_mtl_buf(&mut BufReader::new(file)).map_err(
                    |e| format!("{shown}: cannot read the materials: {e}"),
                )?;
            for material in materials {
                // See what else a material is
                let is_clear = |opacity| opacity < 1.;
                let shines = |text: &String| {
                    text.split(' ')
                        .any(|word| word.parse().is_ok_and(|x: f64| x > 0.))
                };
                let is_transparent =
                    || material.unknown_param.get("Tr").is_some_and(shines);
                let is_odd = [
                    material.dissolve.map_or_else(is_transparent, is_clear),
                    material.diffuse_texture.is_some(),
                    material.unknown_param.get("Ke").is_some_and(shines),
                ];
                let kinds = (0..).zip(is_odd).filter(|(_, is_odd)| *is_odd);
                odd.extend(
                    kinds.map(|(kind, _)| (kind, material.name.clone())),
                );
                let tobj::Material { name, diffuse, .. } = material;
                let Some([r, g, b]) = diffuse else { continue };
                let luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
                let one = |band| [r, g, b][band as usize];
                let albedo = band.map_or(luminance, one);
                if !(0. ..=1.).contains(&albedo) {
                    return Err(format!(
                        "{shown}: material {name} has Kd {r} {g} {b}, which is not \
                         between 0 and 1"
                    ));
                }
                albedos.insert(name, albedo);
            }
        }
    }
    // Count the materials that are not what their library says
    let used: Vec<&str> = names(marks, MarkKind::Material).collect();
    let unknown = used.iter().filter(|name| !albedos.contains_key(**name));
    odd.extend(unknown.map(|name| (3, (*name).to_owned())));
    odd.retain(|(_, name)| used.contains(&&name[..]));
    let tell = |(kind, what): (usize, &str)| {
        let mut all =
            odd.iter().filter(|odd| odd.0 == kind).map(|odd| &odd.1);
        let (count, first) = (all.clone().count(), all.next()?);
        Some(format!("materials that {what}: {count}, the first {first}"))
    };
    let told = (0..).zip(ODD_MATERIALS).filter_map(tell);
    Ok((albedos, told.collect()))
}

/// What is told of materials that are more, or less, than an albedo.
const ODD_MATERIALS: [&str; 4] = [
    "are transparent (d, Tr), and let no light through here",
    "have a texture (map_Kd), and are given their Kd",
    "are luminous (Ke), and give no light",
    "have no Kd, and are given the albedo of -r",
];

/// The names of a kind, each once, in order.
pub fn names(marks: &[Mark], kind: MarkKind) -> impl Iterator<Item = &str> {
    let of_kind = marks.iter().filter(move |mark| mark.kind == kind);
    let mut all: Vec<&str> = of_kind.map(|mark| &mark.name[..]).collect();
    all.sort_unstable();
    all.dedup();
    all.into_iter()
}

/// Which albedos a scene has, by name; what decides them beside its file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// Those of the materials of its libraries.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub materials: BTreeMap<String, f64>,
    /// The band that was taken of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band: Option<Band>,
    /// Those that were given to materials, groups or objects; of several
    /// that fit, the last one counts.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub named_albedos: Vec<(String, f64)>,
}

/// The albedos of the faces of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct FaceAlbedos {
    /// The first face of each stretch of faces, and their albedo.
    stretches: Vec<(u32, f64)>,
}

impl FaceAlbedos {
    /// Those of a file with these marks; `others` is that of faces without
    /// a name that is known.
    ///
    /// # Errors
    /// A name that was given an albedo is not in the file.
    pub fn new(
        marks: &[Mark],
        named: &Named,
        others: f64,
    ) -> Result<Self, String> {
        let mut is_used = vec![false; named.named_albedos.len()];
        let mut current: [&str; 3] = [""; 3];
        let mut stretches = vec![(0, others)];
        for Mark { face, kind, name } in marks {
            let Some(of_kind) = current.get_mut(*kind as usize) else {
                continue;
            };
            *of_kind = name;
            // Find the albedo under the current names
            let [object, groups, material] = current;
            let mut albedo =
                named.materials.get(material).copied().unwrap_or(others);
            for ((name, given), used) in
                named.named_albedos.iter().zip(&mut is_used)
            {
                let mut all = [object, groups, material].into_iter();
                let is_group =
                    || groups.split_whitespace().any(|group| group == name);
                if all.any(|other| other == name) || is_group() {
                    (albedo, *used) = (*given, true);
                }
            }
            stretches.pop_if(|(first, _)| first == face);
            stretches.push((*face, albedo));
        }
        // Refuse a name that is not in the file
        if let Some(unknown) = is_used.iter().position(|used| !used) {
            let (name, albedo) = &named.named_albedos[unknown];
            let kinds =
                [MarkKind::Material, MarkKind::Group, MarkKind::Object];
            let known =
                kinds.into_iter().flat_map(|kind| names(marks, kind));
            let known: Vec<_> = known.take(8).map(quoted).collect();
            let name = quoted(name);
            return Err(format!(
                ": no material, group or object is called {name} (--albedo \
                 {name}={albedo}); there are: {}",
                known.join(", ")
            ));
        }
        Ok(Self { stretches })
    }

    /// That of a face.
    pub fn of(&self, face: u32) -> f64 {
        let after =
            self.stretches.partition_point(|&(first, _)| first <= face);
        self.stretches[after - 1].1
    }
}

/// The albedos of the triangles of a hierarchy, of which there are several.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlbedoTable {
    /// The number of its albedo, for the slot of each triangle.
    numbers: Vec<u16>,
    /// The albedos.
    albedos: Vec<f64>,
    /// Their mean, weighted by the area of their triangles.
    mean: f64,
}

impl AlbedoTable {
    /// The albedos of the triangles of a hierarchy, by their faces.
    ///
    /// # Errors
    /// There are more than 65 536 albedos.
    pub fn new(faces: &FaceAlbedos, bvh: &Bvh) -> Result<Self, String> {
        let (_, first) = faces.stretches[0];
        let is_first = |&(_, albedo): &(u32, f64)| albedo == first;
        if faces.stretches.iter().all(is_first) {
            let (numbers, albedos) = (vec![], vec![first]);
            return Ok(Self { numbers, albedos, mean: first });
        }
        let mut table = Self::default();
        let (mut sum, mut all) = (0., 0.);
        bvh.for_each(|slot, &[a, b, c]| {
            let albedo = faces.of(bvh.face(slot));
            // Number an albedo
            let known = table.albedos.iter().rposition(|&a| a == albedo);
            let number = known.unwrap_or_else(|| {
                table.albedos.push(albedo);
                table.albedos.len() - 1
            });
            let slot = slot as usize;
            table.numbers.resize(table.numbers.len().max(slot + 1), 0);
            table.numbers[slot] = number as u16;
            let area = (b - a).cross(c - a).length();
            (sum, all) = (sum + albedo * area, all + area);
        });
        if table.albedos.len() > 1 + usize::from(u16::MAX) {
            return Err("more than 65536 different albedos".to_owned());
        }
        table.mean = sum / all;
        Ok(table)
    }
}

/// What all surfaces reflect.
#[derive(Clone, Copy, Debug)]
pub struct Surfaces<'a> {
    /// A typical albedo: the mean over the area of all triangles; that of
    /// each, if there is no table.
    pub typical: f64,
    table: Option<&'a AlbedoTable>,
    /// Of the ground.
    ground: f64,
    /// The largest of all albedos.
    pub most: f64,
}

impl<'a> Surfaces<'a> {
    /// One albedo for all surfaces.
    pub fn of(albedo: f64) -> Self {
        Self { typical: albedo, table: None, ground: 0., most: albedo }
    }

    /// An albedo for each triangle, from a table if there are several, and
    /// one for the ground, if there is one.
    pub fn new(table: &'a AlbedoTable, ground: Option<f64>) -> Self {
        let ground = ground.unwrap_or(0.);
        let most = table.albedos.iter().copied().fold(ground, f64::max);
        let many = table.albedos.len() > 1;
        let typical = if many { table.mean } else { table.albedos[0] };
        Self { typical, table: many.then_some(table), ground, most }
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

    /// The albedo there, as a part of the largest.
    #[inline(always)]
    pub fn share(&self, primitive: u32) -> f64 {
        let albedo = self.albedo(primitive);
        if albedo == self.most { 1. } else { albedo / self.most }
    }
}
