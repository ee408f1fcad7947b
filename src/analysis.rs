// Tangled from chapters/analysis.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! What a scene, its camera and the options make superfluous.
//!
//! Each shortcut is proved in the book. None changes a sample.

pub mod background;
pub mod interior;

use std::fmt;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bvh::{Bvh, Isa};
use crate::camera::Camera;
use crate::scene::Entrance;
use crate::sky::Sky;
use background::KnownPixels;
use interior::{is_inside, lets_out};

/// What may make work superfluous.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Shortcut {
    /// The camera is inside a closed surface: the image is black.
    Dark,
    /// Nothing is reflected: it only counts whether a ray is blocked.
    Black,
    /// Some tiles see no triangle: their rays need not be traced.
    Background,
}

impl Shortcut {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Dark, Self::Black, Self::Background];

    /// The name that reports have for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dark => "dark",
            Self::Black => "black",
            Self::Background => "background",
        }
    }
}

/// What has been found about one shortcut.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Finding {
    /// Its name.
    pub fact: String,
    /// Whether it holds, so that something is left out.
    #[serde(skip)]
    pub holds: bool,
    /// What was found, for people.
    pub why: String,
}

/// All that has been found about a scene, and what the renderer takes
/// from it.
pub struct SceneAnalysis {
    /// One for each shortcut that was looked for, and for what the scene
    /// has left out already.
    pub findings: Vec<Finding>,
    /// What is known of the image before it is rendered.
    pub known: KnownPixels,
    /// Whether nothing is reflected.
    pub is_black: bool,
}

/// What is asked about a scene.
#[derive(Clone, Copy)]
pub struct Inquiry<'a> {
    /// The camera of the image.
    pub camera: Camera,
    /// Where its rays enter the scene.
    pub entrance: Entrance,
    /// The only light.
    pub sky: Sky,
    /// Albedo of every surface.
    pub albedo: f64,
    /// Width and height of the image.
    pub resolution: (u32, u32),
    /// Shortcuts that are not to be looked for.
    pub kept: &'a [Shortcut],
}

impl SceneAnalysis {
    /// Looks for all shortcuts but those that are kept. The intersector
    /// is that of the scene, which has left out the faces `left_out`.
    pub fn find(
        left_out: &[Vec<u32>; 2],
        intersector: &Bvh,
        inquiry: &Inquiry,
    ) -> Self {
        let findings = of_the_scene(left_out);
        let known = KnownPixels::default();
        let mut all = Self { findings, known, is_black: false };
        for shortcut in Shortcut::ALL {
            // Look for one shortcut if it is wanted
            let found = match shortcut {
                kept if inquiry.kept.contains(&kept) => {
                    Some((false, "kept, and not looked for".to_owned()))
                }
                _ if all.known.is_all() => None,
                Shortcut::Dark => {
                    Some(all.look_for_dark(intersector, inquiry))
                }
                Shortcut::Black => {
                    // See whether anything is reflected
                    all.is_black = inquiry.albedo == 0.;
                    let why = match all.is_black {
                        true => {
                            "nothing is reflected: a ray only asks whether it is blocked"
                        }
                        false => "surfaces reflect",
                    };
                    Some((all.is_black, why.to_owned()))
                }
                Shortcut::Background => {
                    all.look_for_background(intersector, inquiry)
                }
            };
            let fact = shortcut.name().to_owned();
            let finding = |(holds, why)| Finding { fact, holds, why };
            all.findings.extend(found.map(finding));
        }
        all
    }

    /// What was left out of the image or its work, in words.
    pub fn left_out(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|finding| finding.holds)
    }

    fn look_for_dark(
        &mut self,
        intersector: &Bvh,
        &Inquiry { ref entrance, resolution, .. }: &Inquiry,
    ) -> (bool, String) {
        let is_shut = |_: &_| !lets_out(entrance, intersector);
        let place = entrance.place().filter(is_shut);
        let dark = place.map_or(Ok(false), |place| {
            let mut all: Vec<_> = intersector.triangles().collect();
            all.par_sort_by_key(|&(face, _)| face);
            let (faces, triangles): (Vec<_>, Vec<_>) =
                all.into_iter().unzip();
            is_inside(&triangles, place).map_err(|i| faces[i as usize])
        });
        let why = match dark {
            Ok(true) => {
                self.known = KnownPixels::dark(resolution);
                "closed around the camera: no ray can reach the sky, and the \
                 image is exactly 0"
            }
            Ok(false) => "no closed surface around the camera",
            Err(face) => &format!("the camera is on face {}", face + 1),
        };
        (dark == Ok(true), why.to_owned())
    }

    fn look_for_background(
        &mut self,
        intersector: &Bvh,
        inquiry: &Inquiry,
    ) -> Option<(bool, String)> {
        let &Inquiry { ref camera, sky, resolution, .. } = inquiry;
        let tip = inquiry.entrance.place()?;
        let tiles = KnownPixels::background(
            camera,
            sky,
            resolution,
            tip,
            intersector,
        );
        let (count, empty, pixels) = tiles.count(resolution);
        // Say how many tiles are empty
        let why = match empty {
            0 => "triangles may be seen in each tile of the image",
            _ if empty == count => {
                "no triangle can be seen: all of the image is the sky"
            }
            _ => &format!(
                "{empty} of {count} tiles of the image see no triangle: no \
                 ray is traced in {pixels} of {} pixels",
                u64::from(resolution.0) * u64::from(resolution.1)
            ),
        };
        if empty > 0 {
            self.known = tiles;
        }
        Some((empty > 0, why.to_owned()))
    }

    /// The intersector and the integrator that are needed, in words.
    pub fn parts(&self, isa: Isa, method: impl fmt::Display) -> String {
        match self.known.is_all() {
            true => "none: no ray".to_owned(),
            false => format!("{isa}; {method}"),
        }
    }

    /// The limit of samples, given the one that was asked for.
    pub fn samples(&self, asked: Option<u64>) -> Option<u64> {
        asked.or(self.known.is_all().then_some(2))
    }
}

/// What is told of the faces that the scene has left out.
fn of_the_scene([flat, copies]: &[Vec<u32>; 2]) -> Vec<Finding> {
    let words = [
        ("flat", flat, "without area"),
        ("copies", copies, "that have the corners of another"),
    ];
    let finding = |(fact, faces, which): (&str, &Vec<u32>, &str)| {
        let first = faces.first().map(|face| face + 1);
        let first = first.map(|n| format!(", the first in face {n}"));
        let why = format!("{} triangles {which}", faces.len());
        let why = why + &first.unwrap_or_default();
        Finding { fact: fact.to_owned(), holds: !faces.is_empty(), why }
    };
    words.map(finding).into()
}
