// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
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
use crate::scene::Scene;
use crate::sky::Sky;
use background::{BackgroundTiles, KnownPixels};
use interior::{is_inside, lets_out};

/// What may make work superfluous.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Shortcut {
    /// The camera is inside a closed surface: the image is black.
    Dark,
    /// Some tiles see no triangle: their rays need not be traced.
    Background,
    /// Nothing is reflected: it only counts whether a ray is blocked.
    Black,
}

impl Shortcut {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Dark, Self::Background, Self::Black];

    /// The name that reports have for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dark => "dark",
            Self::Background => "background",
            Self::Black => "black",
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
pub struct Inquiry<'a> {
    /// The camera of the image.
    pub camera: &'a Camera,
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
    /// is that of the scene.
    pub fn find(
        scene: &Scene,
        intersector: &Bvh,
        inquiry: &Inquiry,
    ) -> Self {
        let (findings, known) = (vec![], KnownPixels::Nothing);
        let mut analysis = Self { findings, known, is_black: false };
        let wanted = |shortcut| !inquiry.kept.contains(&shortcut);
        analysis.tell_of_the_scene(scene);
        // Look for the shortcuts that are wanted
        for kept in inquiry.kept {
            let why = "kept, and not looked for".to_owned();
            analysis.tell(kept.name(), false, why);
        }
        if wanted(Shortcut::Dark) {
            analysis.look_for_dark(scene, intersector, inquiry.camera);
        }
        if !analysis.known.is_all() {
            if wanted(Shortcut::Black) {
                analysis.look_for_black(inquiry.albedo);
            }
            if wanted(Shortcut::Background) {
                analysis.look_for_background(scene, intersector, inquiry);
            }
        }
        analysis
    }

    /// What was left out of the image or its work, in words.
    pub fn left_out(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|finding| finding.holds)
    }

    fn tell(&mut self, name: &str, holds: bool, why: String) {
        let fact = name.to_owned();
        self.findings.push(Finding { fact, holds, why });
    }

    fn tell_of_the_scene(&mut self, scene: &Scene) {
        let (flat, copies) = scene.left_out();
        let words = [
            ("flat", flat, "without area"),
            ("copies", copies, "that have the corners of another"),
        ];
        for (name, faces, which) in words {
            let mut why = format!("{} triangles {which}", faces.len());
            if let Some(face) = faces.first() {
                why += &format!(", the first in face {}", face + 1);
            }
            self.tell(name, !faces.is_empty(), why);
        }
    }

    fn look_for_dark(
        &mut self,
        scene: &Scene,
        intersector: &Bvh,
        camera: &Camera,
    ) {
        let dark = match scene.place(camera.position) {
            Some(_) if lets_out(scene, intersector, camera) => Ok(false),
            Some(place) => {
                // Ask the triangles whether they enclose the camera
                let mut all: Vec<_> = intersector.triangles().collect();
                all.par_sort_by_key(|&(face, _)| face);
                let (faces, triangles): (Vec<_>, Vec<_>) =
                    all.into_iter().unzip();
                is_inside(&triangles, place).map_err(|i| faces[i as usize])
            }
            None => Ok(false),
        };
        // Say whether a closed surface is around it
        if dark == Ok(true) {
            self.known = KnownPixels::Dark;
        }
        let why = match dark {
            Ok(true) => {
                "closed around the camera: no ray can reach the sky, \
                         and the image is exactly 0"
                    .to_owned()
            }
            Ok(false) => "no closed surface around the camera".to_owned(),
            Err(face) => format!("the camera is on face {}", face + 1),
        };
        self.tell(Shortcut::Dark.name(), dark == Ok(true), why);
    }

    fn look_for_background(
        &mut self,
        scene: &Scene,
        intersector: &Bvh,
        inquiry: &Inquiry,
    ) {
        let &Inquiry { camera, sky, resolution, .. } = inquiry;
        let Some(tip) = scene.place(camera.position) else { return };
        let tiles =
            BackgroundTiles::new(camera, sky, resolution, tip, intersector);
        let (count, empty, pixels) = tiles.count(resolution);
        // Say how many tiles are empty
        let why = match empty {
            0 => {
                "triangles may be seen in each tile of the image".to_owned()
            }
            _ if empty == count => {
                "no triangle can be seen: all of the image is the sky"
                    .to_owned()
            }
            _ => format!(
                "{empty} of {count} tiles of the image see no triangle: no \
                 ray is traced in {pixels} of {} pixels",
                u64::from(resolution.0) * u64::from(resolution.1)
            ),
        };
        self.tell(Shortcut::Background.name(), empty > 0, why);
        if empty > 0 {
            self.known = KnownPixels::Background(tiles);
        }
    }

    fn look_for_black(&mut self, albedo: f64) {
        self.is_black = albedo == 0.;
        let why = match self.is_black {
            true => {
                "nothing is reflected: a ray only asks whether it is \
                 blocked"
            }
            false => "surfaces reflect",
        };
        let name = Shortcut::Black.name();
        self.tell(name, self.is_black, why.to_owned());
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
