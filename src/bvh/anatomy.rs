// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Draws a node, a leaf and the traversal of one ray, for the book.

// Name what the anatomy imports
use std::{array, io};

use super::traversal::{
    Slabs, Stack, Waiting, distance, enter, look, push,
};
use super::triangle::{LANES, Leaf, Search, Shear};
use super::wide::{LEAF, Node, Quality, Wide, slots};
use crate::scene::{Ray, Scene};

// Record the traversal of a ray
/// A traversal through the hierarchy of a scene, step by step.
pub struct Anatomy {
    wide: Wide<16>,
    ray: Ray,
    steps: Vec<Step>,
}

/// A look at one node or leaf.
struct Step {
    child: u32,
    /// The children entered, or the triangles met.
    mask: u32,
    /// How many children wait afterwards.
    waiting: usize,
    /// The end of the ray afterwards.
    t_max: f64,
}

impl Anatomy {
    /// Walks `ray` through the hierarchy of sixteen children of a scene.
    ///
    /// # Errors
    /// Too little memory.
    pub fn new(scene: &Scene, ray: Ray) -> io::Result<Self> {
        let triangles = scene.triangles().to_vec();
        let wide = Wide::new(triangles, Quality::Medium)?;
        // Walk and note each step
        let (slabs, shear) = (Slabs::new(&ray), Shear::new(&ray));
        let mut search = Search::new(&wide.leaves, None);
        let (mut waiting, mut steps) = (Waiting::new(), vec![]);
        let mut stack = Stack::new(&mut waiting);
        let mut next = Some(0);
        while let Some(child) = next {
            // Look at one child and choose the next
            let t_max = search.distance as f32;
            let (mask, first) = if child & LEAF == 0 {
                let node = &wide.nodes[child as usize];
                let met = enter(node, &slabs, t_max, distance);
                let any = met.mask != 0;
                // SAFETY: no hierarchy is so deep that less than 16 are left.
                let push =
                    || unsafe { push(node, slabs.shift, &met, &mut stack) };
                (met.mask, any.then(push))
            } else {
                let meet = |leaf: Leaf, shear: &_, _| leaf.meet(shear);
                // SAFETY: children with the bit LEAF are leaves that are there.
                let met = unsafe {
                    look(&mut search, child, (&ray, &shear), meet)
                };
                (met & ((1 << LANES) - 1), None)
            };
            next = first.or_else(|| stack.pop(search.distance as f32));
            let (waiting, t_max) = (stack.length(), search.distance);
            steps.push(Step { child, mask, waiting, t_max });
        }
        Ok(Self { wide, ray, steps })
    }

    // Find the node and leaf to draw
    /// The root, and the mask of the children that the ray enters.
    fn root(&self) -> (&Node<16>, u32) {
        (&self.wide.nodes[0], self.steps.first().map_or(0, |s| s.mask))
    }

    /// A full leaf with a triangle that the ray meets, if it met one.
    fn leaf(&self) -> Option<Leaf<'_>> {
        let met = self.steps.iter().filter(|s| s.child & LEAF != 0);
        let mut met = met.filter(|s| s.mask != 0);
        met.find_map(|s| {
            let (first, count) = slots(s.child);
            // SAFETY: children with the bit LEAF are leaves that are there.
            let leaf = unsafe { self.wide.leaves.leaf(first, count) };
            (count == LANES).then_some(leaf)
        })
    }
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

/// The slots of `node` that hold children, near to far, with opposite
/// corners of their boxes seen from above.
fn footprints(node: &Node<16>, shift: u32) -> Vec<(usize, [[f64; 2]; 2])> {
    let near = node.order.iter().rev();
    let slots = near.map(|order| (order >> shift & 15) as usize);
    let slots = slots.filter(|&slot| node.planes[0][slot].is_finite());
    let at = |row: usize, slot: usize| f64::from(node.planes[row][slot]);
    let corner = |low, slot| [at(low, slot), -at(low + 2, slot)];
    slots.map(|slot| (slot, [corner(0, slot), corner(3, slot)])).collect()
}

impl Anatomy {
    /// A node's children from above and the ray, in TikZ.
    pub fn draw_node(&self) -> String {
        let (node, mask) = self.root();
        let boxes = footprints(node, Slabs::new(&self.ray).shift);
        let corners: Vec<_> = boxes.iter().flat_map(|b| b.1).collect();
        let at = scale(&corners);
        let mut tex = String::new();
        // Draw the boxes from above
        for (slot, [a, b]) in &boxes {
            let entered = mask >> slot & 1 != 0;
            let style = if entered { "fill=black!25" } else { "" };
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
        let end = self.steps.last().map_or(0., |s| s.t_max).min(8192.);
        let [from, to] = [0., end].map(|t| {
            let p = self.ray.origin + t * self.ray.direction;
            at([p.x, -p.z])
        });
        tex += &format!("\\draw[very thick,->] {from} -- {to};\n");
        tex += &format!("\\draw[fill=white] {from} circle (2pt);\n");
        image(&tex)
    }
}

// Draw a leaf along the ray
/// The corners of the triangle in `lane`, sheared.
fn sheared(leaf: Leaf, lane: usize, shear: &Shear) -> [[f64; 2]; 3] {
    let [x, y, _] = leaf.sheared(lane, shear);
    array::from_fn(|c| [x[c], y[c]])
}

/// The signs of the edge functions of a sheared triangle.
fn signs([a, b, c]: [[f64; 2]; 3]) -> String {
    let edge = |p: [f64; 2], q: [f64; 2]| p[0] * q[1] - p[1] * q[0];
    let sign = |e: f64| if e < 0. { "{-}" } else { "{+}" };
    [edge(c, b), edge(a, c), edge(b, a)].map(sign).concat()
}

impl Anatomy {
    /// A leaf's four triangles along the ray, in TikZ.
    pub fn draw_leaf(&self) -> String {
        let Some(leaf) = self.leaf() else { return String::new() };
        let shear = Shear::new(&self.ray);
        let lanes: [_; LANES] =
            array::from_fn(|lane| sheared(leaf, lane, &shear));
        let at = scale(&[lanes.concat(), vec![[0.; 2]]].concat());
        let mut tex = String::new();
        for triangle in lanes {
            // Draw a triangle and its signs
            let [a, b, c] = triangle.map(&at);
            let middle = [0, 1].map(|i| {
                triangle.iter().map(|corner| corner[i]).sum::<f64>() / 3.
            });
            let (middle, signs) = (at(middle), signs(triangle));
            tex += &format!("\\draw {a} -- {b} -- {c} -- cycle;\n");
            tex += &format!("\\node[{LABEL}] at {middle} {{${signs}$}};\n");
        }
        tex += &format!("\\fill {} circle (2pt);\n", at([0.; 2]));
        image(&tex)
    }
}

// Tabulate the steps of a traversal
impl Anatomy {
    /// One row of a table for each step, in LaTeX.
    pub fn tabulate(&self) -> String {
        let rows = self.steps.iter().enumerate().map(|(i, step)| {
            // Put the fields of a step into words
            let (what, number) = match step.child & LEAF {
                0 => ("node", step.child),
                _ => ("leaf", slots(step.child).0),
            };
            let (met, waiting) = (step.mask.count_ones(), step.waiting);
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
}
