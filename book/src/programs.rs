// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The parts of the book's program.

// Name the parts as modules
mod ablation;
mod bounces;
mod calibration;
mod chance;
mod closed_forms;
mod geometry;
mod learnt;
mod manuals;
mod nets;
mod parts;
mod scenes;
mod stability;
mod tiny;
mod traversal;

use std::error::Error;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use litpt::image::{Format, Image};
use litpt_book::courtyard::solids;
use litpt_book::sweep::write_obj;

/// What a part returns.
pub type Done = Result<(), Box<dyn Error>>;

// List the parts with their functions
/// A part: its name, and the function that gets the words after it.
type Part = (&'static str, fn(&[String]) -> Done);

/// All parts.
pub const ALL: [Part; 15] = [
    ("ablation", ablation::run),
    ("bounces", bounces::run),
    ("calibration", calibration::run),
    ("chance", chance::run),
    ("closed_forms", closed_forms::run),
    ("courtyard", courtyard),
    ("geometry", geometry::run),
    ("learnt", learnt::run),
    ("manuals", manuals::run),
    ("nets", nets::run),
    ("parts", parts::run),
    ("scenes", scenes::run),
    ("stability", stability::run),
    ("tiny", tiny::run),
    ("traversal", traversal::run),
];

/// Writes the courtyard as an OBJ.
fn courtyard(_: &[String]) -> Done {
    let mut out = BufWriter::new(io::stdout().lock());
    write_obj(&solids(), &mut out)?;
    Ok(out.flush()?)
}

/// Writes a grey picture of values in [0, 1], so wide.
pub fn draw(path: &Path, width: u32, means: Vec<f64>) -> Done {
    let height = means.len() as u32 / width;
    let image = Image::plain(width, height, means);
    Ok(Format::Png.write(&image, &mut File::create(path)?)?)
}
