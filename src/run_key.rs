// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! All that decides the samples of a run.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::camera::View;
use crate::film::{Film, Window};
use crate::render::choose::Sampling;

/// All that decides the samples of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunKey {
    /// The version of the program.
    pub version: String,
    /// The integrator with its constants and the version of its samples.
    pub integrator: String,
    /// SHA-256 of the bytes of the scene, in hexadecimal digits.
    pub scene_sha256: String,
    /// What is shown.
    #[serde(flatten)]
    pub subject: Subject,
    /// How samples are made.
    #[serde(flatten)]
    pub sampling: Sampling,
    /// The part of the run that is rendered, unless it is all of it.
    #[serde(flatten)]
    pub part: Option<Part>,
}

/// What an image shows of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Subject {
    /// Width and height of the whole image.
    pub resolution: (u32, u32),
    /// The window that is rendered, unless it is the whole image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop: Option<Window>,
    /// Where the camera stands and looks.
    #[serde(flatten)]
    pub view: View,
    /// Albedo of every surface.
    pub albedo: f64,
}

impl RunKey {
    /// The first entry in which two keys differ, and its values.
    pub fn disagreement(
        &self,
        other: &Self,
    ) -> Option<(String, [String; 2])> {
        let (a, b) = (entries(self), entries(other));
        let mut names = a.keys().chain(b.keys());
        let name = names.find(|&name| a.get(name) != b.get(name))?;
        let show = |key: &Map<String, Value>| {
            key.get(name).map_or("nothing".to_owned(), Value::to_string)
        };
        Some((name.clone(), [show(&a), show(&b)]))
    }

    /// An empty film of a window of the image.
    pub fn film(&self, window: Window) -> Film {
        self.sampling.film(self.subject.resolution, window)
    }
}

impl Subject {
    /// The window that is rendered.
    pub fn window(&self) -> Window {
        let whole = Window { corner: (0, 0), size: self.resolution };
        self.crop.unwrap_or(whole)
    }
}

/// The names and values of what is written as an object.
pub fn entries(value: &impl Serialize) -> Map<String, Value> {
    match serde_json::to_value(value) {
        Ok(Value::Object(entries)) => entries,
        _ => Map::new(),
    }
}

/// A part of a run: some of its samples, in one band of its window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "Texts", try_from = "Texts")]
pub struct Part {
    /// Its first sample, and the one after its last.
    pub samples: (u64, u64),
    /// The number of samples of the whole run.
    pub of: u64,
    /// The number of its band, from 1, and how many bands there are.
    pub band: (u32, u32),
}

impl Part {
    /// The same in whole replicates of so many samples.
    pub fn rounded(self, replicate: u64) -> Self {
        let up = |n: u64| n.div_ceil(replicate).saturating_mul(replicate);
        let (from, to) = self.samples;
        let (samples, of) = ((up(from), up(to)), up(self.of));
        Self { samples, of, ..self }
    }

    /// The number of its samples.
    pub fn count(&self) -> u64 {
        self.samples.1 - self.samples.0
    }
}

/// A part as it is written.
#[derive(Serialize, Deserialize)]
struct Texts {
    samples: String,
    tiles: String,
}

/// The names of the texts, which are those of the options.
pub const SAMPLES: &str = "samples";
pub const TILES: &str = "tiles";

impl From<Part> for Texts {
    fn from(part: Part) -> Self {
        let Part { samples: (from, to), of, band: (k, n) } = part;
        let samples = format!("{from}..{to} of {of}");
        Self { samples, tiles: format!("{k}/{n}") }
    }
}

impl TryFrom<Texts> for Part {
    type Error = &'static str;

    fn try_from(texts: Texts) -> Result<Self, Self::Error> {
        let (samples, band) =
            (numbers(&texts.samples), numbers(&texts.tiles));
        match (&samples[..], &band[..]) {
            (&[from, to, of], &[k, n]) => {
                let band = (k as u32, n as u32);
                Ok(Self { samples: (from, to), of, band })
            }
            _ => Err("it is no part of a run"),
        }
    }
}

/// The numbers in a text, whatever is between them.
fn numbers(text: &str) -> Vec<u64> {
    let digits = text.split(|c: char| !c.is_ascii_digit());
    digits.filter_map(|digits| digits.parse().ok()).collect()
}
