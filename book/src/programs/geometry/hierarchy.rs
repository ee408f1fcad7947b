// Boxes of a hierarchy.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;

use glam::DVec3;
use litpt::bvh::{Bvh, Isa, Quality};
use litpt::scene::Triangle;
use litpt_book::courtyard;

use super::super::Done;
use super::{Out, Stage, grey, shade};

pub fn draw(out: &mut Out) -> Done {
    let size = (240, 180);
    let mut court =
        Stage::new(&courtyard::mesh(), &courtyard::view(), size)?;
    // The same tree on each machine.
    court.bvh = Bvh::with(&court.scene, Quality::Thorough, Isa::Portable)?;
    boxes(&court, out)
}

/// Two corners of a box, as bits.
type Key = [u64; 6];

fn key(low: DVec3, high: DVec3) -> Key {
    let [a, b, c] = low.to_array().map(f64::to_bits);
    let [d, e, f] = high.to_array().map(f64::to_bits);
    [a, b, c, d, e, f]
}

/// The boxes of the next level, given those of the levels above.
fn below(bvh: &Bvh, above: &HashSet<Key>) -> Vec<(DVec3, DVec3)> {
    let found = RefCell::new(vec![]);
    let enters = |low, high| {
        let known = above.contains(&key(low, high));
        if !known {
            found.borrow_mut().push((low, high));
        }
        known
    };
    bvh.any_triangle(enters, |_| false);
    found.into_inner()
}

/// The boxes of the first level over the image, and the surfaces by their
/// boxes of the second and third.
fn boxes(court: &Stage, out: &mut Out) -> Done {
    let lit = court.pixels(|_, hit| {
        hit.map_or(1., |hit| grey(0.7 + 0.3 * shade(hit.normal)))
    });
    out.picture("court", court.size.0, lit)?;
    let mut known = HashSet::new();
    for level in 1..=3 {
        let boxes = below(&court.bvh, &known);
        out.number("boxes", &level.to_string(), boxes.len() as f64)?;
        match level {
            1 => out.table("geometry-boxes.tex", &frames(court, &boxes))?,
            _ => patches(court, &boxes, level, out)?,
        }
        known.extend(boxes.iter().map(|&(low, high)| key(low, high)));
    }
    Ok(())
}

/// Colours each surface by the box of one level that it is in.
fn patches(
    court: &Stage,
    boxes: &[(DVec3, DVec3)],
    level: u32,
    out: &Out,
) -> Done {
    let numbers = boxes.iter().map(|&(low, high)| key(low, high));
    let numbers: HashMap<_, _> = numbers.zip(0u32..).collect();
    let (now, owner) = (Cell::new(0), RefCell::new(HashMap::new()));
    let bits = |t: &Triangle| t.map(|p| p.to_array().map(f64::to_bits));
    let enters = |low, high| {
        if let Some(&number) = numbers.get(&key(low, high)) {
            now.set(number);
        }
        true
    };
    let asked = |t: &Triangle| {
        owner.borrow_mut().insert(bits(t), now.get());
        false
    };
    court.bvh.any_triangle(enters, asked);
    let owner = owner.into_inner();
    let owners = court.bvh.triangles().map(|(face, t)| {
        (face, owner.get(&bits(&t)).copied().unwrap_or(0))
    });
    let owners: HashMap<u32, u32> = owners.collect();
    let painted = court.pixels(|_, hit| {
        let Some(hit) = hit else { return 1. };
        let owner = owners[&court.bvh.face(hit.primitive)];
        let tone =
            f64::from(owner.wrapping_mul(0x9e37_79b9) >> 16) / 65536.;
        grey((0.15 + 0.8 * tone) * (0.75 + 0.25 * shade(hit.normal)))
    });
    out.picture(&format!("boxes-{level}"), court.size.0, painted)
}

/// The edges of boxes in the image, which reaches from (0, 0) to (1, 1), as
/// commands of TikZ.
fn frames(court: &Stage, boxes: &[(DVec3, DVec3)]) -> String {
    let camera = &court.camera;
    let ahead = camera.direction(0.5, 0.5);
    let aside = |x, y| {
        let d = camera.direction(x, y);
        d / d.dot(ahead) - ahead
    };
    let (right, down) = (aside(1., 0.5), aside(0.5, 1.));
    let eye = court
        .scene
        .frame
        .entrance(camera.position)
        .place()
        .unwrap_or_default();
    let near = 1.;
    let mut tex = String::new();
    let mut line = |a: DVec3, b: DVec3| {
        let (mut a, mut b) = (a - eye, b - eye);
        if a.dot(ahead) > b.dot(ahead) {
            (a, b) = (b, a);
        }
        let [za, zb] = [a, b].map(|p| p.dot(ahead));
        if zb <= near {
            return;
        }
        if za < near {
            a += (b - a) * ((near - za) / (zb - za));
        }
        let [a, b] = [a, b].map(|p| {
            let flat = p / p.dot(ahead);
            let x = flat.dot(right) / right.length_squared();
            let y = flat.dot(down) / down.length_squared();
            [0.5 + 0.5 * x, 0.5 - 0.5 * y].map(|c| c.clamp(-20., 20.))
        });
        let [[x, y], [z, w]] = [a, b];
        writeln!(tex, "\\draw ({x:.4},{y:.4}) -- ({z:.4},{w:.4});").ok();
    };
    for &(low, high) in boxes {
        for axis in 0..3 {
            for corner in 0..4 {
                let mut a = low;
                let others = [(axis + 1) % 3, (axis + 2) % 3];
                for (bit, other) in others.into_iter().enumerate() {
                    if corner >> bit & 1 == 1 {
                        a[other] = high[other];
                    }
                }
                let mut b = a;
                b[axis] = high[axis];
                line(a, b);
            }
        }
    }
    tex
}
