// Tangled from chapters/report.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The report of a run: its settings, its timings, and the curve of its
//! error against time.
//!
//! Errors are absolute, in units of the sky's radiance; times are
//! seconds of wall clock. An unknown number is none in Rust, null in
//! JSON, an empty field in CSV, and a word for people.
//!
//! ```
//! use std::path::Path;
//! use litpt::{film::Film, report::{Kind, Report}};
//!
//! let kind = Kind::of(Path::new("report.json"))?;
//! let report = Report::default().complete(&Film::new(4, 3));
//! let text = kind.render(&report, &|| unreachable!());
//! assert!(text.contains("\"curve\""));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod html;
mod plot;
mod result;

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::error::{Error, Result};
use crate::image::{Image, extension};
use crate::output::descriptor;
use crate::render_loop::CurvePoint;
pub(crate) use result::as_typed;
pub use result::{MatrixSize, Report, SceneFile, Settings, metric, slope};

/// How a report becomes text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kind {
    /// Everything but the image, for programs.
    Json,
    /// The curve as a table with a header.
    Csv,
    /// One page with everything, for people.
    Html,
}

impl Kind {
    /// The kind of report that a file of this name holds.
    ///
    /// # Errors
    /// The extension belongs to no kind.
    pub fn of(path: &Path) -> Result<Self> {
        let device = || path.metadata().is_ok_and(|there| !there.is_file());
        match extension(path).as_deref() {
            Some("json") => Ok(Kind::Json),
            Some("csv") => Ok(Kind::Csv),
            Some("html") => Ok(Kind::Html),
            _ if descriptor(path).is_some() || device() => Ok(Kind::Json),
            _ => Err(Error::from(
                "unknown kind of report; name it .json, .csv or .html",
            )
            .of_file(path)),
        }
    }

    /// The text of a report; `image` is called if the kind shows it.
    pub fn render(
        self,
        report: &Report,
        image: &dyn Fn() -> Image,
    ) -> String {
        match self {
            Kind::Json => json(report),
            Kind::Csv => csv(&report.convergence.curve),
            Kind::Html => html::page(report, &image()),
        }
    }
}

fn json(report: &Report) -> String {
    let mut object = json!(report);
    let [seconds, spp] = report.slopes();
    object["slope_seconds"] = json!(seconds);
    object["slope_spp"] = json!(spp);
    let last = report.convergence.last();
    object["mean"] = json!(last.mean);
    object["mean_stderr"] = json!(last.mean_stderr);
    object["rmse"] = json!(last.rmse);
    format!("{object:#}\n")
}

/// A header, and a row for each point; an unknown number is empty.
fn csv(curve: &[CurvePoint]) -> String {
    let header = "spp,seconds,rays,rmse,mean,mean_stderr,rmse_reference";
    let row = |point| {
        let row = json!(point);
        let cell = |name| row.get(name).filter(|cell| !cell.is_null());
        let text =
            |name| cell(name).map_or(String::new(), Value::to_string);
        header.split(',').map(text).collect::<Vec<_>>().join(",")
    };
    let mut lines = vec![header.to_owned()];
    lines.extend(curve.iter().map(row));
    lines.join("\n") + "\n"
}
