// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Writes the figures of a traversal through the courtyard to a directory.

use std::fs;
use std::path::Path;

use litpt::bvh::anatomy::Anatomy;
use litpt::scene::Scene;
use litpt_book::courtyard::{mesh, view};

use super::Done;

pub fn run(arguments: &[String]) -> Done {
    let directory = arguments.first().ok_or("usage: anatomy DIRECTORY")?;
    let directory = Path::new(directory);
    let scene = Scene::new(&mesh());
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
