// Tangled from chapters/analysis.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The work that a scene, its camera and the options make superfluous.
//!
//! The book proves each shortcut. None changes a sample.

pub mod background;
pub mod interior;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bvh::Bvh;
use crate::materials::Surfaces;
use crate::sensor::Sensor;
use crate::sky::Sky;
use background::KnownPixels;
use interior::{is_inside, lets_out};

/// The names of the shortcuts, in the order of their searches.
pub const SHORTCUTS: [&str; 2] = ["dark", "background"];

/// The result of the search for one shortcut.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Its name.
    #[serde(rename = "fact")]
    pub name: String,
    /// Whether it applies, so that something is left out.
    #[serde(skip)]
    pub applies: bool,
    /// The finding, for people.
    #[serde(rename = "why")]
    pub reason: String,
}

/// All findings about a scene, and the part of them that the renderer
/// needs.
#[derive(Default)]
pub struct SceneAnalysis {
    /// One for each shortcut that was searched, and for the triangles that
    /// the scene has left out.
    pub findings: Vec<Finding>,
    /// The contents of the tiles, as far as they are known.
    pub known_pixels: KnownPixels,
}

/// The view of a scene, with the light and the surfaces. Searches examine
/// it, and the renderers are made from it.
#[derive(Clone, Copy)]
pub struct LitView<'a> {
    /// The camera or the receivers.
    pub sensor: &'a Sensor,
    /// The only light.
    pub sky: &'a Sky,
    /// The albedos of the surfaces.
    pub surfaces: Surfaces<'a>,
    /// Width and height of the image.
    pub resolution: (u32, u32),
}

impl SceneAnalysis {
    /// Searches for all shortcuts except those that are not wanted, `kept`.
    /// The intersector is that of the scene, which has left out the faces
    /// `left_out`.
    pub fn find(
        left_out: &[Vec<u32>; 2],
        intersector: &Bvh,
        view: &LitView,
        kept: &[&str],
    ) -> Self {
        let mut findings = of_the_scene(left_out);
        let mut known_pixels = KnownPixels::default();
        for name in SHORTCUTS {
            // Search for one shortcut unless it is kept
            let (found, reason) = match name {
                _ if kept.contains(&name) => {
                    (None, "kept, and not looked for".to_owned())
                }
                _ if known_pixels.is_all() => break,
                "dark" => dark(intersector, view),
                _ => background(intersector, view),
            };
            let (applies, name) = (found.is_some(), name.to_owned());
            findings.push(Finding { name, applies, reason });
            known_pixels = found.unwrap_or(known_pixels);
        }
        Self { findings, known_pixels }
    }

    /// The work or the part of the image that was left out, in words.
    pub fn left_out(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|finding| finding.applies)
    }
}

/// The contents of the tiles if a shortcut applies; and words for it.
type Found = (Option<KnownPixels>, String);

const NO_CAMERA: &str = "there is no camera";

/// The findings about the faces that the scene has left out.
fn of_the_scene([flat, copies]: &[Vec<u32>; 2]) -> Vec<Finding> {
    let words = [
        ("flat", flat, "without area"),
        ("copies", copies, "with the corners of another"),
    ];
    let finding = |(name, faces, which): (&str, &Vec<u32>, &str)| {
        let first = faces.first().map(|face| face + 1);
        let first = first.map(|n| format!(", the first in face {n}"));
        let s = if faces.len() == 1 { "" } else { "s" };
        let reason = format!("{} triangle{s} {which}", faces.len());
        let reason = reason + &first.unwrap_or_default();
        Finding {
            name: name.to_owned(),
            applies: !faces.is_empty(),
            reason,
        }
    };
    words.map(finding).into()
}

/// Whether there is a closed surface around the camera.
fn dark(intersector: &Bvh, view: &LitView) -> Found {
    let Sensor::Camera(_, entrance) = view.sensor else {
        return (None, NO_CAMERA.to_owned());
    };
    if view.surfaces.transmits {
        return (None, "surfaces let light through".to_owned());
    }
    let is_shut = |_: &_| !lets_out(entrance, intersector);
    let place = entrance.place().filter(is_shut);
    let dark = place.map_or(Ok(false), |place| {
        let mut triangles = intersector.triangles();
        triangles.par_sort_by_key(|&(face, _)| face);
        let (faces, triangles): (Vec<_>, Vec<_>) =
            triangles.into_iter().unzip();
        is_inside(&triangles, place).map_err(|i| faces[i as usize])
    });
    let reason = match dark {
        Ok(true) => {
            "closed around the camera: no ray can reach the sky, and the \
             image is exactly 0"
        }
        Ok(false) => "no closed surface around the camera",
        Err(face) => &format!("too close to tell: face {}", face + 1),
    };
    let black = || KnownPixels::dark(view.resolution);
    ((dark == Ok(true)).then(black), reason.to_owned())
}

/// The tiles that see no triangle.
fn background(intersector: &Bvh, view: &LitView) -> Found {
    let &LitView { sensor, sky, resolution, .. } = view;
    let Sensor::Camera(camera, entrance) = sensor else {
        return (None, NO_CAMERA.to_owned());
    };
    let Some(tip) = entrance.place() else {
        return (None, "the camera is too far away".to_owned());
    };
    let tiles =
        KnownPixels::background(camera, sky, resolution, tip, intersector);
    let (empty, count) = tiles.count();
    let reason = match empty {
        0 => "triangles may be seen in each tile of the image",
        _ if empty == count => {
            "no triangle can be seen: all of the image is the sky"
        }
        _ => &format!(
            "{empty} of {count} tiles of the image see no triangle: their \
             rays are not traced"
        ),
    };
    ((empty > 0).then_some(tiles), reason.to_owned())
}
