// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The answers to the exercises of the book on the courtyard.

use std::f64::consts::PI;

use litpt_book::courtyard::solids;
use litpt_book::sweep::Solid;

// Choose solids by their kind
fn of_kind(kind: &str) -> Vec<Solid> {
    let mut solids = solids();
    solids.retain(|s| s.name.split('.').next() == Some(kind));
    solids
}

#[test]
fn nine_solids_go_around_the_court() {
    let (mut balls, mut tori) = (0, 0);
    for solid in solids() {
        let faces = solid.triangles.len() as i64;
        match solid.vertices.len() as i64 - faces / 2 {
            2 => balls += 1,
            0 => tori += 1,
            other => panic!("{}: {other}", solid.name),
        }
    }
    assert_eq!((balls, tori), (1060 - 9, 9));
}

/// The volume of a closed solid, cubic metres.
fn volume(solid: &Solid) -> f64 {
    let corners = |t: &[u32; 3]| t.map(|i| solid.vertices[i as usize]);
    let sixth = |[a, b, c]: [[f64; 3]; 3]| {
        let x = b[1] * c[2] - b[2] * c[1];
        let y = b[2] * c[0] - b[0] * c[2];
        let z = b[0] * c[1] - b[1] * c[0];
        (a[0] * x + a[1] * y + a[2] * z) / 6.
    };
    solid.triangles.iter().map(|t| sixth(corners(t))).sum()
}

#[test]
fn the_error_of_a_vault_is_of_second_order() {
    let (r, h) = (1.69_f64, 1.88);
    let exact = 4. * r * r * h - (2. * PI - 8. / 3.) * r.powi(3);
    let vaults = of_kind("vault");
    let error = |steps: usize| {
        let fine = if steps == 32 { &vaults[0] } else { &vaults[8] };
        volume(fine) - exact
    };
    assert!((exact - 4.02).abs() < 0.005);
    assert!((error(32) - 0.018).abs() < 0.0005);
    assert!((error(16) - 0.071).abs() < 0.0005);
    let order = (error(16) / error(32)).log2();
    assert!((order - 2.).abs() < 0.05, "{order}");
}
