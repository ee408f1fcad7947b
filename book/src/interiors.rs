// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Rooms that hardly any light finds its way into.
//!
//! y points up, lengths are in metres. Every solid is closed, and where
//! solids meet they interpenetrate by a centimetre or more, so that light
//! gets in through the one opening of each scene alone. Only arithmetic and
//! square roots are used: a scene is the same on every machine.

use glam::DVec3;
use litpt::camera::View;
use litpt::scene::Mesh;

use crate::mixtures::options;
use crate::room::room;
use crate::solids::add;
use crate::sweep::{
    Flat, Point, Solid, block, fan, lathe, semicircle, sweep,
};

/// The solids of a scene, and a view from deep inside.
pub struct Interior {
    pub solids: Vec<Solid>,
    /// What the camera sees; y is up for the sky as well.
    pub view: View,
    /// A block that closes the only opening: with it no light gets in.
    pub lid: Solid,
}

impl Interior {
    /// The interior of a name: `corridor`, `backroom` or `room`.
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "corridor" => Some(corridor()),
            "backroom" => Some(backroom()),
            "room" => Some(room()),
            _ => None,
        }
    }

    /// All its triangles.
    pub fn mesh(&self) -> Mesh {
        joined(&self.solids)
    }

    /// All its triangles, and those of the lid.
    pub fn closed(mut self) -> Mesh {
        self.solids.push(self.lid);
        joined(&self.solids)
    }

    /// The options of `pt` for the view, with the albedo that is meant.
    pub fn options(&self) -> String {
        options(&self.view) + " -r 0.8"
    }
}

/// The solids in one mesh.
fn joined(solids: &[Solid]) -> Mesh {
    let mut mesh = Mesh::default();
    for solid in solids {
        add(&mut mesh, &solid.mesh(), |p| p);
    }
    mesh
}

pub(crate) fn view(from: Point, to: Point) -> View {
    let [position, target] = [from, to].map(DVec3::from_array);
    View { position, target, up: DVec3::Y, fov: 70. }
}

/// The number `i` of a sequence that fills [low, high] evenly (the golden
/// ratio's multiples, to six digits).
fn varied(i: usize, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * (i * 618_034 % 1_000_000) as f64 * 1e-6
}

/// A solid that is turned about the y axis, from x towards z, by the angle
/// whose cosine and sine are proportional to these, and then moved.
pub(crate) fn placed(solid: Solid, [c, s]: Flat, at: Point) -> Solid {
    let length = (c * c + s * s).sqrt();
    let (c, s) = (c / length, s / length);
    solid.moved(|[x, y, z]| {
        [c * x - s * z + at[0], y + at[1], s * x + c * z + at[2]]
    })
}

// ---- things

/// A closed body of revolution with a wavy outline.
fn urn(height: f64, radius: f64) -> Solid {
    const OUTLINE: [Flat; 14] = [
        [0.55, 0.],
        [0.6, 0.03],
        [0.5, 0.07],
        [0.45, 0.12],
        [0.62, 0.22],
        [0.82, 0.34],
        [0.96, 0.46],
        [1., 0.56],
        [0.94, 0.66],
        [0.78, 0.76],
        [0.56, 0.85],
        [0.48, 0.91],
        [0.52, 0.97],
        [0.6, 1.],
    ];
    lathe(&OUTLINE.map(|[r, y]| [r * radius, y * height]), 32)
}

/// A column that stands 2 cm deep in the floor.
fn pillar(radius: f64, height: f64) -> Solid {
    let r = radius;
    let profile = [
        [1.5 * r, -0.02],
        [1.5 * r, 0.12],
        [1.3 * r, 0.16],
        [1.05 * r, 0.2],
        [r, 0.26],
        [r, 0.5 * height],
        [0.88 * r, height - 0.24],
        [1.05 * r, height - 0.2],
        [1.2 * r, height - 0.14],
        [1.5 * r, height - 0.1],
        [1.5 * r, height],
    ];
    lathe(&profile, 16)
}

/// Adds a table of this half length and width, and a stool at each corner.
fn table(solids: &mut Vec<Solid>, [x, z]: Flat, [a, b]: Flat) {
    let put = |s: Solid, p, q| placed(s, [1., 0.], [x + p, 0., z + q]);
    solids.push(put(block([-a, a], [0.72, 0.75], [-b, b]), 0., 0.));
    for (i, (p, q)) in
        [(-1., -1.), (1., -1.), (1., 1.), (-1., 1.)].into_iter().enumerate()
    {
        let leg = put(pillar(0.04, 0.73), p * (a - 0.1), q * (b - 0.1));
        let seat = block([-0.2, 0.2], [0.42, 0.46], [-0.2, 0.2]);
        let foot = block([-0.15, 0.15], [-0.01, 0.43], [-0.15, 0.15]);
        let turn = [1., varied(i, [-0.8, 0.8])];
        let beside = [x + p * 0.6 * a, 0., z + q * (b + 0.3)];
        solids.extend([
            leg,
            placed(seat, turn, beside),
            placed(foot, turn, beside),
        ]);
    }
    solids.push(
        put(urn(0.3, 0.1), 0.1, 0.02).moved(|[x, y, z]| [x, y + 0.74, z]),
    );
}

/// Adds a case of five shelves with books, along x from `corner`.
fn shelves(solids: &mut Vec<Solid>, corner: Flat, width: f64) {
    let mut put = |b: Solid| {
        solids.push(placed(b, [1., 0.], [corner[0], 0., corner[1]]));
    };
    put(block([0., 0.02], [-0.02, 2.], [0.01, 0.3]));
    put(block([width - 0.02, width], [-0.02, 2.], [0.01, 0.3]));
    for row in 0..5 {
        let y = 0.1 + 0.4 * f64::from(row);
        put(block([0.01, width - 0.01], [y, y + 0.02], [0.015, 0.295]));
        let (mut x, mut i) = (0.03, 17 * row as usize);
        while x < width - 0.12 {
            i += 1;
            let thick = varied(i, [0.015, 0.05]);
            let high = varied(i * i, [0.2, 0.33]);
            let deep = varied(3 * i, [0.14, 0.24]);
            put(block(
                [x, x + thick],
                [y + 0.01, y + high],
                [0.02, 0.02 + deep],
            ));
            x += thick + varied(5 * i, [0.001, 0.02]);
        }
    }
}

// ---- the corridor

/// Half the width of the corridor, and how thick its walls are.
const HALF: f64 = 1.7;
const WALL: f64 = 0.3;

/// Where the vault springs.
const SPRING: f64 = 2.1;

/// The axis, from the opening to the end: x and z.
const AXIS: [Flat; 5] =
    [[0., 0.], [5., 0.], [5., 7.], [10., 7.], [10., 12.]];

/// The section of a passage with a round vault, clockwise.
fn section(half: f64, floor: f64) -> Vec<Flat> {
    let vault = semicircle(16).into_iter();
    let vault = vault.map(|[x, y]| [half * x, SPRING + half * y]);
    vault.chain([[half, floor], [-half, floor]]).collect()
}

/// The unit vector of the leg that begins at point `i` of the axis.
fn tangent(i: usize) -> Flat {
    let ([a, b], [c, d]) = (AXIS[i], AXIS[i + 1]);
    let length = ((c - a) * (c - a) + (d - b) * (d - b)).sqrt();
    [(c - a) / length, (d - b) / length]
}

/// The section at point `i` of the axis, in the plane that halves the bend.
fn ring(section: &[Flat], i: usize, beyond: f64) -> Vec<Point> {
    let last = AXIS.len() - 2;
    let [p, q] = [i.saturating_sub(1), i.min(last)].map(tangent);
    let cosine = p[0] * q[0] + p[1] * q[1];
    let [x, z] = [p[0] + q[0], p[1] + q[1]].map(|c| c / (1. + cosine));
    let end = if i > last { beyond } else { 0. };
    let at = [AXIS[i][0] + end * x, AXIS[i][1] + end * z];
    let place = |&[a, y]: &Flat| [at[0] + a * z, y, at[1] - a * x];
    section.iter().map(place).collect()
}

/// The masonry: one closed solid, from its end along the outside to the
/// opening and back along the inside.
fn masonry() -> Solid {
    let outside = section(HALF + WALL, -WALL);
    let inside = section(HALF, 0.);
    let there =
        (0..AXIS.len()).rev().map(|i| ring(&outside, i, HALF + WALL));
    let back = (0..AXIS.len()).map(|i| ring(&inside, i, HALF));
    let rings: Vec<_> = there.chain(back).collect();
    sweep(&rings, &fan(inside.len()))
}

/// A rib below the vault, in the plane z = 0.
fn rib() -> Solid {
    let ring = |[x, y]: Flat| {
        let at = |r: f64, z| [r * x, SPRING + r * y, z];
        vec![at(1.56, -0.1), at(1.75, -0.1), at(1.75, 0.1), at(1.56, 0.1)]
    };
    let rings: Vec<_> = semicircle(16).into_iter().map(ring).collect();
    sweep(&rings, &fan(4))
}

/// Adds what stands in one leg: ribs on pillars, and crates and urns
/// between them.
fn furnish(solids: &mut Vec<Solid>, leg: usize) {
    let (t, [x, z]) = (tangent(leg), AXIS[leg]);
    let ends = [0, 1].map(|i| AXIS[leg + i]);
    let length = (ends[1][0] - ends[0][0]) + (ends[1][1] - ends[0][1]);
    let turn = [t[1], -t[0]];
    let at = |across: f64, along: f64| {
        [
            x + along * t[0] + across * t[1],
            0.,
            z + along * t[1] - across * t[0],
        ]
    };
    let (count, margin) = (3, HALF + 0.2);
    for k in 0..count {
        let step = (length - 2. * margin) / f64::from(count - 1);
        let along = margin + step * f64::from(k);
        solids.push(placed(rib(), turn, at(0., along)));
        for side in [-1., 1.] {
            let foot = at(1.5 * side, along);
            solids.push(placed(pillar(0.12, SPRING + 0.02), turn, foot));
            if k + 1 == count {
                continue;
            }
            let i = 8 * leg + 2 * k as usize + usize::from(side > 0.);
            let beside = at(1.2 * side, along + 0.5 * step);
            let turn = [1., varied(i, [-1., 1.])];
            let size = varied(3 * i, [0.12, 0.25]);
            solids.push(match i % 3 {
                0 => placed(urn(3. * size, 0.8 * size), [1., 0.], beside)
                    .moved(|[x, y, z]| [x, y - 0.02, z]),
                _ => {
                    let wide = [-size, size];
                    let crate_ = block(wide, [-0.02, 1.7 * size], wide);
                    placed(crate_, turn, beside)
                }
            });
        }
    }
}

/// A vaulted passage with three bends, open at one end: what the camera
/// sees is lit by paths of at least three reflections.
fn corridor() -> Interior {
    let mut solids = vec![masonry()];
    for leg in 0..AXIS.len() - 1 {
        furnish(&mut solids, leg);
    }
    Interior {
        solids,
        view: view([9.1, 1.6, 13.4], [10., 1.4, 7.]),
        lid: block([-0.2, 0.01], [-0.5, 4.], [-2., 2.]),
    }
}

// ---- the back room

/// The inside of both rooms, from the wall with the window to the last one,
/// with the height and the depth.
const LONG: f64 = 9.5;
const HIGH: f64 = 2.7;
const DEEP: f64 = 4.4;

/// Adds a wall across x with a hole, of which y and z are given. What is
/// above and below the hole is 2 cm thinner than what is beside it.
fn pierced(solids: &mut Vec<Solid>, x: Flat, y: Flat, z: Flat) {
    let (floor, ceiling) = (-0.1, HIGH + 0.1);
    let thin = [x[0] + 0.01, x[1] - 0.01];
    let wide = [z[0] - 0.01, z[1] + 0.01];
    solids.push(block(x, [floor, ceiling], [-0.1, z[0]]));
    solids.push(block(x, [floor, ceiling], [z[1], DEEP + 0.1]));
    solids.push(block(thin, [y[1], ceiling - 0.01], wide));
    if y[0] > 0. {
        solids.push(block(thin, [floor + 0.01, y[0]], wide));
    }
}

/// A room that is lit only through the door of another one, which has a
/// window; the camera sees the door but not the window.
fn backroom() -> Interior {
    let mut solids = vec![
        block([-0.4, LONG + 0.4], [-0.3, 0.], [-0.4, DEEP + 0.4]),
        block([-0.41, LONG + 0.41], [HIGH, 3.], [-0.41, DEEP + 0.41]),
        block([-0.28, LONG + 0.28], [-0.11, HIGH + 0.11], [-0.3, 0.]),
        block(
            [-0.27, LONG + 0.27],
            [-0.12, HIGH + 0.12],
            [DEEP, DEEP + 0.3],
        ),
        block(
            [LONG, LONG + 0.3],
            [-0.13, HIGH + 0.13],
            [-0.15, DEEP + 0.15],
        ),
    ];
    pierced(&mut solids, [-0.3, 0.], [0.8, 2.3], [1., 3.2]);
    pierced(&mut solids, [5., 5.15], [0., 2.05], [2.6, 3.5]);
    let door = block([0., 0.88], [0.01, 2.03], [0., 0.04]);
    solids.push(placed(door, [4., -1.], [5.18, 0., 2.58]));
    // The outer room
    table(&mut solids, [2.3, 1.9], [0.8, 0.45]);
    shelves(&mut solids, [0.6, 0.], 2.4);
    // The inner room
    table(&mut solids, [7.4, 2.5], [0.7, 0.45]);
    shelves(&mut solids, [5.6, 0.], 1.8);
    let turned = |solids: &mut Vec<Solid>| {
        let mut case = Vec::new();
        shelves(&mut case, [0., 0.], 2.);
        let shift = |s| placed(s, [-1., 0.], [9., 0., DEEP]);
        solids.extend(case.into_iter().map(shift));
    };
    turned(&mut solids);
    for i in 0..4 {
        let x = 5.8 + 0.5 * i as f64;
        let size = varied(i, [0.4, 0.7]);
        solids.push(placed(
            urn(size, 0.4 * size),
            [1., 0.],
            [x, -0.01, DEEP - 0.4],
        ));
    }
    Interior {
        solids,
        view: view([9.2, 1.7, 0.35], [6., 1., 3.]),
        lid: block([-0.4, -0.15], [-0.2, 2.9], [-0.2, DEEP + 0.2]),
    }
}
