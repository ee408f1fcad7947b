// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Prints the table of closed forms of the book, as LaTeX rows.

use glam::DVec3;
use litpt::closed_forms::{cavity, cavity_radiance, pixel, plane};

const REALISATIONS: u64 = 20_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for rho in [0., 0.2, 0.5, 0.9, 0.99, 1.] {
        // Print the row of the plane
        let above = (DVec3::Z, DVec3::ZERO);
        let pixel_of_plane = pixel(&plane(), rho, above, REALISATIONS)?;
        let (mean, error) =
            (pixel_of_plane.mean(), pixel_of_plane.standard_error());
        println!(r"plane & {rho} & {rho:.6} & {mean:.6} & {error:.6} & \\");
        for f in [0.05, 0.5] {
            // Print the row of the cavity
            let exact = cavity_radiance(rho, f);
            let inside = (DVec3::ZERO, DVec3::new(0.3, 0.2, -1.));
            let wall = pixel(&cavity(f, 128), rho, inside, REALISATIONS)?;
            let (mean, error) = (wall.mean(), wall.standard_error());
            let z = match error {
                0. => String::new(),
                error => format!("${:+.2}$", (mean - exact) / error),
            };
            println!(
                r"cavity, $f={f}$ & {rho} & {exact:.6} & {mean:.6} & {error:.6} & {z} \\"
            );
        }
    }
    Ok(())
}
