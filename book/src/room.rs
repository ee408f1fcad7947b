// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A furnished room that is lit through one window.
//!
//! Lengths are in metres, y points up, the floor is at y = 0, and the room
//! spans [0, 6] along x and [0, 4.5] along z. A thing is built about the
//! origin with its front towards +z, and then turned and moved to its place.
//! Every solid is closed, and no two have faces that overlap in one plane.
//! The chapter "A courtyard to render" tells what is built.

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::interiors::{Interior, placed, view};
use crate::sweep::{
    Flat, Point, Solid, block, fan, lathe, moulding, rectangle, semicircle,
    sweep,
};

// ---- ways to make solids

fn moved(solid: Solid, at: Point) -> Solid {
    placed(solid, [1., 0.], at)
}

/// A solid with z upwards instead of y.
fn upright(solid: Solid) -> Solid {
    solid.moved(|[x, y, z]| [x, -z, y])
}

/// A solid turned about the z axis, from x towards y.
fn tilted(solid: Solid, turn: Flat) -> Solid {
    let turned = placed(upright(solid), turn, [0.; 3]);
    turned.moved(|[x, y, z]| [x, z, -y])
}

/// A block whose edges take away a share of its sides, all of them of a
/// pillow: a lathe's rings made rectangles with round corners. Each row has
/// a middle, half sides, and the share.
fn cushions(rows: &[[f64; 7]]) -> Vec<Solid> {
    let one = |&[x, y, z, a, b, c, edge]: &[f64; 7]| {
        let arc = semicircle(8).into_iter();
        let profile = arc.map(|[p, q]| [1. - edge + edge * q, b * p]);
        let round = 0.3 * a.min(c);
        lathe(&profile.collect::<Vec<_>>(), 32).moved(|[p, q, r]| {
            let scale = (p * p + r * r).sqrt();
            let flat = |p: f64| if p < 0. { -scale } else { scale };
            let out = |p, half| round * p + (half - round) * flat(p);
            [x + out(p, a), y + q, z + out(r, c)]
        })
    };
    rows.iter().map(one).collect()
}

/// A body of revolution: the outline has pairs of radius and height, in
/// these units.
fn turned(outline: &[f64], [r, h]: Flat, sides: usize) -> Solid {
    let pairs = outline.as_chunks::<2>().0.iter();
    let scaled: Vec<_> = pairs.map(|[x, y]| [r * x, h * y]).collect();
    lathe(&scaled, sides)
}

/// Straight rods: each row has two ends and a radius, the outline pairs of
/// share of the radius and of the way.
fn rods(rows: &[[f64; 7]], outline: &[f64]) -> Vec<Solid> {
    let one = |&[a, b, c, x, y, z, r]: &[f64; 7]| {
        let (from, to) = (DVec3::new(a, b, c), DVec3::new(x, y, z));
        let other = DVec3::new(0.36, 0.48, 0.8);
        let across = (to - from).cross(other).normalize();
        let third = across.cross(to - from).normalize();
        turned(outline, [r, 1.], 8).moved(|[x, t, z]| {
            (from.lerp(to, t) + x * across + z * third).into()
        })
    };
    rows.iter().map(one).collect()
}

/// Four rods straight up from the corners of a rectangle.
fn legs([a, c]: Flat, height: f64, r: f64) -> Vec<Solid> {
    let at = |[x, z]: Flat| [x, -0.01, z, x, height, z, r];
    rods(&[[a, c], [-a, c], [-a, -c], [a, -c]].map(at), &LEG)
}

/// A sheet through rows of points, and through the same points moved.
fn sheet(rows: &[Vec<DVec3>], thickness: DVec3) -> Solid {
    let ring = |row: &Vec<DVec3>| {
        let back = row.iter().rev().map(|&p| p + thickness);
        let ring = row.iter().copied().chain(back);
        ring.map(Point::from).collect()
    };
    let rings: Vec<_> = rows.iter().map(ring).collect();
    let last = 2 * rows[0].len() - 1;
    let halves =
        |i| [[i, i + 1, last - i], [i + 1, last - i - 1, last - i]];
    sweep(&rings, &(0..last / 2).flat_map(halves).collect::<Vec<_>>())
}

// ---- outlines

// Rods
const LEG: [f64; 24] = [
    0.6, 0., 0.75, 0.08, 0.6, 0.1, 0.85, 0.13, 0.6, 0.16, 1., 0.48, 0.75,
    0.7, 0.6, 0.73, 0.95, 0.76, 0.7, 0.79, 1., 0.83, 1., 1.,
];
const RUNG: [f64; 10] = [0.6, 0., 0.9, 0.3, 1., 0.5, 0.9, 0.7, 0.6, 1.];
const ROD: [f64; 4] = [1., 0., 1., 1.];

// Vessels, up along the outside and down along the inside
const BOWL: [f64; 12] =
    [0.4, 0., 0.7, 0.16, 1., 0.6, 0.95, 0.6, 0.85, 0.38, 0.2, 0.12];
const PLATE: [f64; 12] =
    [0.55, 0., 0.62, 0.05, 1., 0.16, 0.99, 0.19, 0.66, 0.1, 0.3, 0.07];
const VASE: [f64; 20] = [
    0.5, 0., 0.85, 0.6, 1., 1.1, 0.9, 1.6, 0.55, 2.1, 0.42, 2.5, 0.6, 2.9,
    0.54, 2.9, 0.34, 2.5, 0.4, 2.1,
];
const POT: [f64; 10] = [0.7, 0., 1., 1.3, 1., 1.6, 0.95, 1.6, 0.9, 1.44];

/// A shade, down along the inside and up along the outside.
const SHADE: [f64; 12] =
    [0.22, 0.78, 0.8, 0.3, 0.97, 0., 1., 0., 0.84, 0.32, 0.2, 0.84];

// ---- furniture

/// The rods of one side of a chair, and those that go across.
const CHAIR: [[[f64; 7]; 4]; 2] = [
    [
        [0.19, 0.17, 0.18, 0.19, 0.17, -0.18, 0.012],
        [0.17, 0.44, -0.17, 0.19, 0.98, -0.28, 0.019],
        [0.05, 0.45, -0.17, 0.06, 0.93, -0.268, 0.009],
        [0.11, 0.45, -0.17, 0.13, 0.93, -0.268, 0.009],
    ],
    [
        [-0.19, 0.24, 0.19, 0.19, 0.24, 0.19, 0.013],
        [-0.19, 0.13, -0.19, 0.19, 0.13, -0.19, 0.012],
        [0., 0.45, -0.17, 0., 0.93, -0.268, 0.009],
        [-0.21, 0.93, -0.268, 0.21, 0.93, -0.268, 0.028],
    ],
];

fn chair() -> Vec<Solid> {
    let [side, across] = CHAIR;
    let other = side.map(|[a, b, c, x, y, z, r]| [-a, b, c, -x, y, z, r]);
    let mut parts = rods(&[side, other, across].concat(), &RUNG);
    parts.extend(legs([0.19, 0.19], 0.445, 0.022));
    parts.extend(cushions(&[[0., 0.452, 0., 0.22, 0.02, 0.21, 0.06]]));
    parts
}

/// A table that is 0.75 high, with these half sides.
fn table([a, c]: Flat) -> Vec<Solid> {
    let mut parts = legs([a - 0.1, c - 0.1], 0.728, 0.04);
    let apron = rectangle([-0.01, 0.01], [0.63, 0.73]);
    parts.push(moulding([a - 0.1, c - 0.1], &apron));
    parts.extend(cushions(&[[0., 0.735, 0., a, 0.015, c, 0.02]]));
    parts
}

/// The parts of a sofa; and pillows, with half a side, tilt and turn.
const SOFA: [[f64; 7]; 6] = [
    [0., 0.24, 0., 0.9, 0.11, 0.41, 0.05],
    [-0.95, 0.35, 0.01, 0.1, 0.25, 0.44, 0.12],
    [0.95, 0.35, 0.01, 0.1, 0.25, 0.44, 0.12],
    [0., 0.52, -0.36, 0.92, 0.33, 0.1, 0.1],
    [-0.43, 0.41, 0.06, 0.43, 0.085, 0.38, 0.15],
    [0.43, 0.412, 0.062, 0.43, 0.085, 0.38, 0.15],
];
const PILLOWS: [[f64; 6]; 3] = [
    [-0.45, 0.68, -0.17, 0.24, 3.5, 0.1],
    [0.4, 0.69, -0.18, 0.25, 3.2, -0.1],
    [0.66, 0.65, 0., 0.2, 2.5, -0.6],
];

fn sofa() -> Vec<Solid> {
    let mut parts = legs([0.85, 0.33], 0.2, 0.03);
    parts.extend(cushions(&SOFA));
    for [x, y, z, a, tilt, turn] in PILLOWS {
        let pillow = cushions(&[[0., 0., 0., a, 0.4 * a, a, 1.]]);
        let leaning = pillow.into_iter().map(|p| tilted(p, [1., tilt]));
        parts.extend(leaning.map(|p| placed(p, [turn, 1.], [x, y, z])));
    }
    parts
}

/// A book with its back towards +z, of this thickness, height and depth.
fn book([t, h, d]: Point) -> Solid {
    let ring = |y| {
        let arc = semicircle(4).into_iter();
        let back = arc.map(|[a, b]| [0.5 * t * (1. + a), y, 0.15 * t * b]);
        back.chain([[t, y, -d], [0., y, -d]]).collect()
    };
    sweep(&[ring(0.), ring(h)], &fan(7))
}

// ---- the room

struct Room {
    solids: Vec<Solid>,
    random: Pcg64,
}

impl Room {
    fn any(&mut self, [low, high]: [f64; 2]) -> f64 {
        self.random.random_range(low..high)
    }

    /// Puts the parts of a thing in their place, as `placed` does.
    fn put(&mut self, name: &str, turn: Flat, at: Point, new: Vec<Solid>) {
        for part in new {
            let mut solid = placed(part, turn, at);
            solid.name = format!("{name}.{}", self.solids.len() + 1);
            self.solids.push(solid);
        }
    }

    /// Floor, ceiling and walls.
    fn shell(&mut self) {
        let walls = [
            block([-1.6, 6.4], [-0.3, -0.02], [-0.5, 4.9]),
            block([-1.61, 6.41], [2.8, 3.1], [-0.51, 4.91]),
            block([-0.3, 0.], [-0.11, 2.91], [-0.28, 0.55]),
            block([-0.3, 0.], [-0.11, 2.91], [1.25, 4.78]),
            block([-0.29, -0.015], [2., 2.92], [0.54, 1.26]),
            block([-1.5, -0.02], [-0.1, 0.115], [0.1, 1.7]),
            block([-1.49, -0.1], [-0.12, 2.93], [0.15, 0.35]),
            block([-1.48, -0.11], [-0.14, 2.94], [1.45, 1.65]),
            block([-1.4, -1.2], [-0.15, 2.95], [0.12, 1.68]),
            block([6., 6.3], [-0.12, 2.92], [-0.27, 4.77]),
            block([-0.29, 6.29], [-0.13, 2.93], [4.5, 4.8]),
            block([-0.26, 1.7], [-0.14, 2.94], [-0.4, 0.]),
            block([3.1, 6.26], [-0.14, 2.94], [-0.4, 0.]),
            block([1.68, 3.12], [-0.15, 1.], [-0.39, -0.06]),
            block([1.67, 3.13], [2.3, 2.95], [-0.38, -0.02]),
            block([-4., 9.], [-0.25, -0.16], [-8., -0.3]),
        ];
        self.put("wall", [1., 0.], [0.; 3], walls.into());
        let skirting = rectangle([-0.018, 0.01], [-0.012, 0.1]);
        let cornice =
            [[0.01, 2.69], [0.01, 2.81], [-0.1, 2.81], [-0.02, 2.71]];
        let around = [skirting, cornice].map(|p| moulding([3., 2.25], &p));
        self.put("moulding", [1., 0.], [3., 0., 2.25], around.into());
        for i in 0..120 {
            let z = 0.15 * f64::from(i / 4);
            let row = 0.5 * f64::from(i / 4 % 4);
            let from = 2. * f64::from(i % 4) - row - 0.2;
            let x = [from.max(0.001), (from + 1.998).min(5.999)];
            let plank = block(x, [-0.05, 0.], [z + 0.001, z + 0.149]);
            self.put("plank", [1., 0.], [0.; 3], vec![plank]);
        }
    }

    /// The window with its blind, its curtains and the radiator.
    fn window(&mut self) {
        let bar = rectangle([-0.05, 0.01], [-0.22, -0.16]);
        let sash = [[-0.04, -0.205], [0., -0.205], [0., -0.165]];
        let mut parts = vec![
            upright(moulding([0.7, 0.65], &bar)),
            block([-0.03, 0.03], [-0.64, 0.64], [-0.215, -0.15]),
            block([-0.68, 0.68], [0.16, 0.185], [-0.2, -0.17]),
            block([-0.78, 0.78], [-0.67, -0.635], [-0.24, 0.09]),
            block([-0.69, 0.69], [0.33, 0.345], [-0.125, -0.095]),
            block([-0.685, 0.685], [0.63, 0.655], [-0.14, -0.08]),
        ];
        for x in [-0.345, 0.345] {
            let pane = upright(moulding([0.33, 0.62], &sash));
            parts.push(moved(pane, [x, 0., 0.]));
            let cord = [1.5 * x, 0.66, -0.11, 1.5 * x, 0.34, -0.11, 0.0015];
            parts.extend(rods(&[cord], &ROD));
        }
        for i in 0..9 {
            let y = 0.62 - 0.032 * f64::from(i);
            let slat = block([-0.69, 0.69], [0., 0.0015], [-0.015, 0.015]);
            let tilt = |[x, y, z]: Point| [x, y - 0.6 * z, z];
            parts.push(moved(slat.moved(tilt), [0., y, -0.11]));
        }
        self.put("window", [1., 0.], [2.4, 1.65, 0.], parts);
        for from in [1.16, 3.15] {
            let curtain = vec![self.curtain()];
            self.put("curtain", [1., 0.], [from, 0.03, 0.16], curtain);
        }
        let straight = [
            [1.1, 2.42, 0.16, 3.8, 2.42, 0.16, 0.012],
            [1.78, 0.2, 0.03, 2.68, 0.2, 0.03, 0.014],
            [1.78, 0.64, 0.03, 2.68, 0.64, 0.03, 0.014],
            [2.67, 0.2, 0.03, 2.67, -0.01, 0.03, 0.01],
        ];
        let fin = |i| {
            [1.8 + 0.05 * f64::from(i), 0.42, 0.03, 0.021, 0.27, 0.045, 0.3]
        };
        let fins: Vec<_> = (0..18).map(fin).collect();
        self.put("radiator", [1., 0.], [0.; 3], cushions(&fins));
        self.put("rod", [1., 0.], [0.; 3], rods(&straight, &ROD));
    }

    /// A curtain of seven folds, 0.5 wide and 2.4 high.
    fn curtain(&mut self) -> Solid {
        const WAVE: [f64; 8] = [0., 0.7, 1., 0.7, 0., -0.7, -1., -0.7];
        let folds = [0; 7].map(|_| self.any([0.02, 0.05]));
        let row = |j: i32| {
            let down = f64::from(j) / 12.;
            let at = |i: usize| {
                let wave = WAVE[i % 8] * folds[i / 8] * (0.5 + 0.5 * down);
                let x = 0.5 * i as f64 / 55. + 0.3 * wave * down;
                DVec3::new(x, 2.41 * (1. - down), wave)
            };
            (0..56).map(at).collect()
        };
        sheet(&(0..=12).map(row).collect::<Vec<_>>(), 0.006 * DVec3::Z)
    }

    /// Two bays of shelves, 2 wide and 2.1 high, full of books.
    fn shelves(&mut self) -> Vec<Solid> {
        let mut parts = vec![
            block([0.005, 1.995], [2.06, 2.1], [-0.002, 0.312]),
            block([0.015, 1.985], [0.03, 2.08], [0.004, 0.016]),
        ];
        for x in [0., 0.9875, 1.975] {
            parts.push(block([x, x + 0.025], [-0.015, 2.07], [0., 0.3]));
        }
        for i in 0..10 {
            let x = 0.9875 * f64::from(i % 2);
            let y = 0.08 + 0.2 * f64::from(i - i % 2) + 0.001 * x;
            let (wide, deep) = ([x + 0.01, x + 0.997], [0.012, 0.292]);
            parts.push(block(wide, [y, y + 0.022], deep));
            self.fill(&mut parts, [x + 0.027, x + 0.97], y + 0.021);
        }
        parts
    }

    /// Fills a shelf with books that stand, lean, or lie.
    fn fill(&mut self, parts: &mut Vec<Solid>, [mut x, end]: Flat, y: f64) {
        while x < end - 0.05 {
            let bounds = [[0.012, 0.045], [0.19, 0.31], [0.13, 0.22]];
            let [t, h, d] = bounds.map(|b| self.any(b));
            let (kind, z) = (self.any([0., 1.]), self.any([0.24, 0.275]));
            let gap = self.any([0.02, 0.08]);
            let (turn, before, after) = match kind {
                0.0..0.06 if x < end - h => ([0., 1.], h, 0.),
                0.9..1.0 if x < end - gap - t => ([1., gap / h], gap, t),
                _ => ([1., 0.], 0., t),
            };
            let book = tilted(book([t, h, d]), turn);
            parts.push(moved(book, [x + before, y, z]));
            x += before + after + self.any([0.001, 0.003]);
        }
    }

    /// A plant in a pot, about as high as `size`.
    fn plant(&mut self, stems: i32, size: f64) -> Vec<Solid> {
        let mut parts = vec![turned(&POT, [0.17 * size; 2], 32)];
        for _ in 0..stems {
            let bounds = [[-0.4, 0.4], [0.5, 1.], [-0.4, 0.4]];
            let [x, y, z] = bounds.map(|b| size * self.any(b));
            let foot = 0.2 * size;
            let stem = [0., foot, 0., x, y, z, 0.006 * size];
            parts.extend(rods(&[stem], &ROD));
            for i in 6..30 {
                let tip = DVec3::new(x, y, z);
                let at = (foot * DVec3::Y).lerp(tip, f64::from(i) / 29.);
                parts.push(self.leaf(at, size.sqrt()));
            }
        }
        parts
    }

    /// A leaf at a place, in any direction, with its tip bent down.
    fn leaf(&mut self, at: DVec3, size: f64) -> Solid {
        let bounds = [[-1., 1.], [-0.2, 0.8], [-1., 1.]];
        let along = DVec3::from(bounds.map(|b| self.any(b))).normalize();
        let across = DVec3::Y.cross(along).normalize();
        let up = along.cross(across);
        let long = size * self.any([0.1, 0.17]);
        let row = |j: i32| {
            let t = f64::from(j) / 6.;
            let wide = 0.02 + 1.4 * t * (1. - t) * (1.2 - t);
            let point = |side: f64| {
                let lift = 0.25 * wide * side.abs() - 0.4 * t * t;
                at + long * (side * wide * across + lift * up + t * along)
            };
            [-1., 0., 1.].map(point).to_vec()
        };
        sheet(&(0..=6).map(row).collect::<Vec<_>>(), 0.0015 * up)
    }
}

/// The room with all that stands in it.
pub fn room() -> Interior {
    let random = Pcg64::seed_from_u64(1);
    let mut room = Room { solids: vec![], random };
    room.shell();
    room.window();
    let books = room.shelves();
    room.put("shelf", [0., -1.], [-0.002, 0., 3.45], books);
    let [large, small] =
        [(9, 1.6), (2, 0.45)].map(|(n, h)| room.plant(n, h));
    room.put("plant", [1., 0.], [0.45, -0.003, 3.95], large);
    room.put("plant", [1., 0.], [1.95, 1.013, 0.02], small);
    room.put("sofa", [-1., 0.], [1.95, 0., 4.03], sofa());
    room.put("table", [1., 0.03], [2.9, 0., 2.], table([0.8, 0.45]));
    for (turn, x, z) in [
        ([1., 0.1], 2.55, 1.4),
        ([-1., 0.2], 2.5, 2.62),
        ([-1., -0.1], 3.25, 2.58),
        ([0.3, 1.], 4.1, 2.15),
    ] {
        room.put("chair", turn, [x, 0., z], chair());
    }
    for x in [1.1, 1.8, 2.5] {
        let profile =
            [[0., -0.01], [0.05, -0.01], [0.05, 0.03], [0., 0.01]];
        let parts = vec![upright(moulding([0.2, 0.3], &profile))];
        room.put("picture", [-1., 0.], [x, 1.6, 4.5], parts);
    }
    let cable = rods(&[[2.9, 1.9, 2., 2.9, 2.81, 2., 0.004]], &ROD);
    room.put("cable", [1., 0.], [0.; 3], cable);
    for (outline, r, at) in [
        (&SHADE[..], 0.22, [2.9, 1.75, 2.]),
        (&VASE, 0.09, [2.75, 0.749, 2.15]),
        (&BOWL, 0.15, [3.1, 0.749, 1.95]),
        (&PLATE, 0.12, [2.45, 0.749, 1.85]),
        (&PLATE, 0.12, [2.45, 0.749, 2.25]),
        (&PLATE, 0.12, [3.45, 0.749, 2.2]),
    ] {
        room.put("vessel", [1., 0.], at, vec![turned(outline, [r; 2], 32)]);
    }
    let fruits = [(3.06, 1.91), (3.15, 1.92), (3.07, 2.), (3.15, 2.01)]
        .map(|(x, z)| [x, 0.815, z, 0.04, 0.038, 0.04, 1.]);
    room.put("fruit", [1., 0.], [0.; 3], cushions(&fruits));
    Interior {
        solids: room.solids,
        view: view([5.45, 1.2, 3.75], [0.6, 0.95, 1.5]),
        lid: block([1.5, 3.3], [0.8, 2.5], [-0.6, -0.3]),
    }
}
