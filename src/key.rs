// Tangled from chapters/state.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The values that decide the samples of a run.
//!
//! ```
//! use litpt::key::Part;
//!
//! let part = Part { samples: (100, 200), of: 300, band: (1, 1) };
//! assert_eq!(part.count(), 100);
//! assert_eq!(part.rounded(64).samples, (128, 256));
//! ```

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::camera::View;
use crate::film::{Film, Window, tile_height};
use crate::materials::Named;
use crate::render::choose::Sampling;
use crate::scene::encoding::quoted;
use crate::sensor::Side;
use crate::sky::Sky;
use crate::tally::Tally;

/// The values that decide the samples of a run. A run goes on from a
/// checkpoint of the same key; states are merged if their keys differ only
/// in the part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunKey {
    /// The version of the program.
    pub version: String,
    /// The integrator with its constants and the version of its samples.
    pub integrator: String,
    /// SHA-256 of the bytes of the scene, in hexadecimal digits.
    pub scene_sha256: String,
    /// The subject.
    #[serde(flatten)]
    pub subject: Subject,
    /// How samples are made.
    #[serde(flatten)]
    pub sampling: Sampling,
    /// The part of the run that is rendered, unless it is all of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<Part>,
    /// Whether halves are kept so that the picture can be filtered, which
    /// decides no sample.
    #[serde(default)]
    pub filtered: bool,
}

/// A scene with its light, and the sensor of the run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Subject {
    /// What senses the light.
    #[serde(flatten)]
    pub sensed: Sensed,
    /// Albedo of every surface without one of its own.
    pub albedo: f64,
    /// Albedos by name.
    #[serde(flatten)]
    pub named: Named,
    /// The sky.
    pub sky: Sky,
    /// Albedo of the ground, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ground: Option<f64>,
    /// What the light is sorted by, if it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tally: Option<Tally>,
}

/// What senses the light of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Sensed {
    /// A camera.
    Camera(Framing),
    /// Receivers.
    Receivers {
        /// Their source.
        receivers: ReceiverSource,
        /// How many of them may have a value.
        count: u32,
    },
}

/// What a camera shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Framing {
    /// Width and height of the whole image.
    pub resolution: (u32, u32),
    /// The window that is rendered, unless it is the whole image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop: Option<Window>,
    /// The position and direction of the camera.
    #[serde(flatten)]
    pub view: View,
}

/// The source of receivers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ReceiverSource {
    /// The points of a file with this SHA-256.
    Points(String),
    /// The faces of the scene, on these sides.
    Faces(Side),
    /// The vertices of the scene.
    Vertices,
}

impl Sensed {
    /// Whether receivers are listed, and there is no image.
    pub fn is_list(&self) -> bool {
        matches!(self, Self::Receivers { .. })
    }

    /// The camera, if there is one.
    pub fn camera(&self) -> Option<&Framing> {
        if let Self::Camera(framing) = self { Some(framing) } else { None }
    }

    /// Width and height of the whole film: receivers stand in one column.
    pub fn resolution(&self) -> (u32, u32) {
        match self {
            Self::Camera(framing) => framing.resolution,
            Self::Receivers { count, .. } => (1, *count),
        }
    }

    /// The window of the run.
    pub fn window(&self) -> Window {
        let crop = self.camera().and_then(|framing| framing.crop);
        whole_window(self.resolution(), crop)
    }

    /// An empty film of a part of the window.
    pub fn film(&self, window: Window) -> Film {
        Film::cropped(self.resolution(), window, self.is_list())
    }
}

/// A part of a run, or shard: some of its samples, in one band of its
/// window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Part {
    /// Its first sample, and the one after its last.
    pub samples: (u64, u64),
    /// The number of samples of the whole run.
    pub of: u64,
    /// The number of its band, from 1, and how many bands there are.
    pub band: (u32, u32),
}

impl Part {
    /// The part in whole replicates of so many samples.
    pub fn rounded(self, replicate: u64) -> Self {
        let up = |n: u64| n.div_ceil(replicate).saturating_mul(replicate);
        let (from, to) = self.samples;
        let (samples, of) = ((up(from), up(to)), up(self.of));
        Self { samples, of, ..self }
    }

    /// The whole run, as a part of itself.
    pub fn whole(self) -> Self {
        Self { samples: (0, self.of), band: (1, 1), ..self }
    }

    /// The number of its samples.
    pub fn count(&self) -> u64 {
        self.samples.1 - self.samples.0
    }
}

impl RunKey {
    /// The first entry in which two keys differ, and its values.
    pub fn disagreement(
        &self,
        other: &Self,
    ) -> Option<(String, [String; 2])> {
        let other = Self { filtered: self.filtered, ..other.clone() };
        let keys = [entries(self), entries(&other)].map(Value::Object);
        first_difference(String::new(), keys.each_ref().map(Some))
    }

    /// The window of the run, and the band of it that is rendered.
    pub fn windows(&self) -> [Window; 2] {
        let sensed = &self.subject.sensed;
        let window = sensed.window();
        let band = self.part.map_or((1, 1), |part| part.band);
        [window, window.band(band, tile_height(sensed.is_list()))]
    }

    /// Whether the run has no sample and is only trained; its state has no sums.
    pub fn only_learns(&self) -> bool {
        self.part.is_some_and(|part| part.count() == 0)
    }

    /// An empty film for the part that is rendered.
    pub fn film(&self) -> Film {
        let first = self.part.map_or(0, |part| part.samples.0);
        self.film_of(self.windows()[1], first)
    }

    /// An empty film of a part of the window, for samples that follow so many
    /// others.
    pub fn film_of(&self, window: Window, first: u64) -> Film {
        let mut film = self.sampling.film(self.subject.sensed.film(window));
        (film.run_window, film.sample_offset) = (self.windows()[0], first);
        if let Some(tally) = &self.subject.tally {
            film = film.with_rows(tally.is_of_surfaces());
        }
        if self.filtered { film.with_halves(None) } else { film }
    }
}

/// The first part in which two values differ, by its path, and both values.
fn first_difference(
    path: String,
    both: [Option<&Value>; 2],
) -> Option<(String, [String; 2])> {
    let text = |value: &Value| value.to_string();
    let texts = both.map(|value| value.map_or("nothing".into(), text));
    let is_cut = texts.iter().any(|text| text.len() > 77);
    if is_cut && let [Some(a), Some(b)] = both.map(|value| parts(value?)) {
        let dot = if path.is_empty() { "" } else { "." };
        return a.keys().chain(b.keys()).find_map(|name| {
            let path = format!("{path}{dot}{name}");
            first_difference(path, [a.get(name), b.get(name)])
        });
    }
    let show = || (path, texts.map(|text| quoted(&text)));
    (both[0] != both[1]).then(show)
}

/// The parts of an object or a list.
fn parts(value: &Value) -> Option<Map<String, Value>> {
    match value {
        Value::Object(parts) => Some(parts.clone()),
        Value::Array(list) => {
            let parts = list.iter().cloned().enumerate();
            Some(parts.map(|(i, part)| (i.to_string(), part)).collect())
        }
        _ => None,
    }
}

/// The names and values of a type that is written as an object.
pub fn entries(value: &impl Serialize) -> Map<String, Value> {
    match serde_json::to_value(value) {
        Ok(Value::Object(entries)) => entries,
        _ => Map::new(),
    }
}

/// The window that is rendered: the whole image if there is no crop.
pub(crate) fn whole_window(
    size: (u32, u32),
    crop: Option<Window>,
) -> Window {
    crop.unwrap_or(Window { corner: (0, 0), size })
}
