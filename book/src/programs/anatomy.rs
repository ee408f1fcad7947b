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

use glam::Vec3;
use litpt::bvh::Quality;
use litpt::bvh::anatomy::{Anatomy, Step};
use litpt::scene::{Ray, Scene};
use litpt_book::courtyard::{mesh, view};

use super::Done;

pub fn run(arguments: &[String]) -> Done {
    let directory = arguments.first().ok_or("usage: anatomy DIRECTORY")?;
    let directory = Path::new(directory);
    let scene = Scene::new(&mesh());
    // Take the ray in the middle
    let ahead = view().target - view().position;
    let ray =
        scene.frame.entrance(view().position).enter(ahead.normalize());
    let ray = ray.ok_or("the view passes the courtyard by")?;
    let anatomy = Anatomy::new(&scene, Quality::Medium)?;
    let (steps, _) = anatomy.walk(&ray, None);
    let leaf = anatomy.leaf(&ray, &steps);
    let leaf = leaf.ok_or("the ray meets no full leaf")?;
    let end = steps.last().map_or(0., |s| s.t_max);
    let write = |name, tex| fs::write(directory.join(name), tex);
    write("anatomy-node.tex", draw_node(&anatomy, &ray, end))?;
    write("anatomy-leaf.tex", draw_leaf(&leaf))?;
    write("anatomy-walk.tex", tabulate(&steps))?;
    Ok(())
}

// Draw a node from above
/// Writes points as places of an image of 11 cm by 8 cm that shows
/// `all`.
fn scale(all: &[[f64; 2]]) -> impl Fn([f64; 2]) -> String + use<> {
    let least =
        |i: usize| all.iter().map(|p| p[i]).fold(f64::MAX, f64::min);
    let most = |i: usize| all.iter().map(|p| p[i]).fold(f64::MIN, f64::max);
    let (left, low) = (least(0), least(1));
    let scale = (11. / (most(0) - left)).min(8. / (most(1) - low));
    move |[x, y]| {
        let (x, y) = ((x - left) * scale, (y - low) * scale);
        format!("({x:.3},{y:.3})")
    }
}

/// Labels cover the lines below them.
const LABEL: &str = "fill=white,inner sep=1pt";

/// An image made of TikZ's `commands`.
fn image(commands: &str) -> String {
    format!("\\begin{{tikzpicture}}\n{commands}\\end{{tikzpicture}}\n")
}

/// The root's children from above and the ray, in TikZ.
fn draw_node(anatomy: &Anatomy, ray: &Ray, end: f64) -> String {
    let above = |p: Vec3| [f64::from(p.x), f64::from(-p.z)];
    let boxes: Vec<(bool, [[f64; 2]; 2])> = anatomy
        .root(ray)
        .into_iter()
        .map(|(entered, corners)| (entered, corners.map(above)))
        .collect();
    let corners: Vec<_> = boxes.iter().flat_map(|b| b.1).collect();
    let at = scale(&corners);
    let mut tex = String::new();
    // Draw the boxes from above
    for (entered, [a, b]) in &boxes {
        let style = if *entered { "fill=black!25" } else { "" };
        let (a, b) = (at(*a), at(*b));
        tex += &format!("\\draw[{style}] {a} rectangle {b};\n");
    }
    // Draw the numbers and the ray
    for (place, (_, [a, b])) in boxes.iter().enumerate() {
        let across = (place + 1) as f64 / (boxes.len() + 1) as f64;
        let x = a[0] + across * (b[0] - a[0]);
        let middle = at([x, (a[1] + b[1]) / 2.]);
        let number = format!("\\footnotesize {}", place + 1);
        tex += &format!("\\node[{LABEL}] at {middle} {{{number}}};\n");
    }
    let [from, to] = [0., end.min(8192.)].map(|t| {
        let p = ray.origin + t * ray.direction;
        at([p.x, -p.z])
    });
    tex += &format!("\\draw[very thick,->] {from} -- {to};\n");
    tex += &format!("\\draw[fill=white] {from} circle (2pt);\n");
    image(&tex)
}

// Draw a leaf along the ray
/// The signs of the edge functions of a sheared triangle.
fn signs([a, b, c]: [[f64; 2]; 3]) -> String {
    let edge = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let sign = |e: f64| if e < 0. { "{-}" } else { "{+}" };
    [edge(c, b), edge(a, c), edge(b, a)].map(sign).concat()
}

/// A leaf's triangles along the ray, in TikZ.
fn draw_leaf(leaf: &[[[f64; 2]; 3]]) -> String {
    let at = scale(&[leaf.concat(), vec![[0.; 2]]].concat());
    let mut tex = String::new();
    for triangle in leaf {
        // Draw a triangle and its signs
        let [a, b, c] = triangle.map(&at);
        let middle = [0, 1].map(|i| {
            triangle.iter().map(|corner| corner[i]).sum::<f64>() / 3.
        });
        let (middle, signs) = (at(middle), signs(*triangle));
        tex += &format!("\\draw {a} -- {b} -- {c} -- cycle;\n");
        tex += &format!("\\node[{LABEL}] at {middle} {{${signs}$}};\n");
    }
    tex += &format!("\\fill {} circle (2pt);\n", at([0.; 2]));
    image(&tex)
}

// Tabulate the steps of a traversal
/// One row of a table for each step, in LaTeX.
fn tabulate(steps: &[Step]) -> String {
    let rows = steps.iter().enumerate().map(|(i, step)| {
        let (leaf, number) = step.leaf();
        let what = if leaf { "leaf" } else { "node" };
        let (met, waiting) = (step.mask.count_ones(), step.waiting);
        // Write the end of the ray
        let t_max = match step.t_max {
            f64::INFINITY => "$\\infty$".to_owned(),
            t_max => format!("{t_max:.3}"),
        };
        let i = i + 1;
        format!(
            "{i} & {what} {number} & {met} & {waiting} & {t_max} \\\\\n"
        )
    });
    rows.collect()
}
