// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Writes the figures of a traversal through the courtyard to a directory.

use std::error::Error;
use std::fs;
use std::path::PathBuf;

use litpt::bvh::anatomy::Anatomy;
use litpt::courtyard::{solids, view, write_obj};
use litpt::scene::{Scene, read_obj};

fn main() -> Result<(), Box<dyn Error>> {
    let directory = std::env::args_os().nth(1);
    let directory = PathBuf::from(directory.ok_or("usage: anatomy DIR")?);
    let mut obj = Vec::new();
    write_obj(&solids(), &mut obj)?;
    let scene = Scene::new(&read_obj(&obj)?);
    // Take the ray in the middle
    let ahead = view().target - view().position;
    let ray = scene.enter(view().position, ahead.normalize());
    let ray = ray.ok_or("the view passes the courtyard by")?;
    let anatomy = Anatomy::new(&scene, ray)?;
    let write = |name, tex| fs::write(directory.join(name), tex);
    write("anatomy-node.tex", anatomy.draw_node())?;
    write("anatomy-leaf.tex", anatomy.draw_leaf())?;
    write("anatomy-walk.tex", anatomy.tabulate())?;
    Ok(())
}
