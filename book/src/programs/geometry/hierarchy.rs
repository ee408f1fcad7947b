// Boxes of a hierarchy, what rays look into, and what cuts cost.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;

use glam::DVec3;
use litpt::bvh::anatomy::Anatomy;
use litpt::bvh::{Bvh, Isa, Quality};
use litpt::scene::{Scene, Triangle};
use litpt_book::courtyard;

use super::super::{Done, scenes};
use super::{Out, Stage, grey, shade};

pub fn draw(out: &mut Out) -> Done {
    let size = (240, 180);
    let mut court =
        Stage::new(&courtyard::mesh(), &courtyard::view(), size)?;
    // The same tree on each machine.
    court.bvh = Bvh::with(&court.scene, Quality::Medium, Isa::Portable)?;
    boxes(&court, out)?;
    looks(&court, out)?;
    let courtyard = cuts(&court.scene)?;
    out.table("geometry-cuts-courtyard.csv", &courtyard)?;
    let statue = cuts(&Scene::new(&scenes::statue(300_000)))?;
    out.table("geometry-cuts-statue.csv", &statue)
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
    let eye = court.scene.place(camera.position).unwrap_or_default();
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

/// Looks that are white in the picture.
const MOST: f64 = 25.;

/// How many nodes and leaves the first ray of each pixel looks into.
fn looks(court: &Stage, out: &mut Out) -> Done {
    let anatomy = Anatomy::new(&court.scene, Quality::Medium)?;
    let counts = court.pixels(|ray, hit| {
        let steps = ray.map_or(0, |ray| anatomy.walk(&ray, None).0.len());
        (steps as f64, hit.is_some())
    });
    let mean = |all: Vec<f64>| {
        let sum: f64 = all.iter().sum();
        sum / all.len() as f64
    };
    let of = |wanted: bool| {
        let some = counts.iter().filter(|c| c.1 == wanted);
        mean(some.map(|c| c.0).collect())
    };
    let most = counts.iter().map(|c| c.0).fold(0., f64::max);
    out.number("looks", "white", MOST)?;
    out.number("looks", "most", most)?;
    out.number("looks", "hit", of(true))?;
    out.number("looks", "sky", of(false))?;
    let levels = counts.iter().map(|c| grey((c.0 / MOST).min(1.)));
    out.picture("looks", court.size.0, levels.collect())
}

/// Places along the scene at which a cut is tried.
const PLACES: usize = 100;

/// The cost of cutting the triangles of a scene in two, along each axis: the
/// triangles below the boxes that a ray enters, as a share of all; and where
/// each axis has half of the triangles on either side.
fn cuts(scene: &Scene) -> Result<String, std::fmt::Error> {
    let triangles = scene.triangles();
    let costs = [0, 1, 2].map(|axis| costs(&triangles, axis));
    let mut rows = "place,x,y,z,medianx,mediany,medianz".to_owned();
    for i in 1..PLACES {
        let place = i as f64 / PLACES as f64;
        write!(rows, "\n{place}")?;
        for (costs, _) in &costs {
            write!(rows, ",{:.4}", costs[i])?;
        }
        for (costs, median) in &costs {
            match *median == i {
                true => write!(rows, ",{:.4}", costs[i])?,
                false => write!(rows, ",nan")?,
            }
        }
    }
    Ok(rows + "\n")
}

/// Half the area of the box around triangles.
fn area(corners: [DVec3; 2]) -> f64 {
    let e = (corners[1] - corners[0]).max(DVec3::ZERO);
    e.x * e.y + e.y * e.z + e.z * e.x
}

/// The cost of a cut at each place, and the place of the median.
fn costs(triangles: &[Triangle], axis: usize) -> (Vec<f64>, usize) {
    let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    let join =
        |[a, b]: [DVec3; 2], [c, d]: [DVec3; 2]| [a.min(c), b.max(d)];
    let around = |t: &Triangle| {
        let [a, b, c] = *t;
        [a.min(b).min(c), a.max(b).max(c)]
    };
    let all = triangles.iter().map(around).fold(none, join);
    let (low, length) = (all[0][axis], (all[1] - all[0])[axis]);
    let mut bins = vec![(none, 0usize); PLACES];
    for t in triangles {
        let own = around(t);
        let middle = 0.5 * (own[0] + own[1])[axis];
        let bin = ((middle - low) / length * PLACES as f64) as usize;
        let bin = &mut bins[bin.min(PLACES - 1)];
        *bin = (join(bin.0, own), bin.1 + 1);
    }
    let side = |bins: &mut dyn Iterator<Item = &([DVec3; 2], usize)>| {
        let sum = |a: ([DVec3; 2], usize), b: &([DVec3; 2], usize)| {
            (join(a.0, b.0), a.1 + b.1)
        };
        let (corners, count) = bins.fold((none, 0), sum);
        (if count == 0 { 0. } else { area(corners) }, count)
    };
    let whole = area(all) * triangles.len() as f64;
    let cost = |i: usize| {
        let left = side(&mut bins[..i].iter());
        let right = side(&mut bins[i..].iter());
        (left.0 * left.1 as f64 + right.0 * right.1 as f64) / whole
    };
    let half = |i: &usize| {
        bins[..*i].iter().map(|b| b.1).sum::<usize>() * 2 >= triangles.len()
    };
    let median = (1..PLACES).find(half).unwrap_or(1);
    ((0..PLACES).map(cost).collect(), median)
}
