// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! From a binary hierarchy to one with many children a node.

use bytemuck::{Pod, Zeroable};
use glam::Vec3A;
use obvhs::Boundable;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use super::Isa;
use super::pages::Pages;
use super::triangle::{LANES, Leaves, Room};
use crate::scene::{Scene, Triangle};

#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub struct Node<const N: usize> {
    /// min x, y, z, max x, y, z
    pub planes: [[f32; N]; 6],
    pub children: [u32; N],
    pub order: [u32; N],
}

unsafe impl<const N: usize> Zeroable for Node<N> {}
unsafe impl Pod for Node<8> {}
unsafe impl Pod for Node<16> {}

#[derive(Debug)]
pub enum BuildError {
    NoInstructions(Isa),
    Memory(std::io::Error),
}
impl std::fmt::Display for BuildError {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Self::NoInstructions(isa) => {
                write!(f, "this processor lacks the instructions {isa:?}")
            }
            Self::Memory(e) => {
                write!(f, "no memory for the hierarchy: {e}")
            }
        }
    }
}
impl std::error::Error for BuildError {}

pub const LEAF: u32 = 1 << 31;
/// Bits of the first slot of a leaf
pub const FIRST: u32 = (1 << 29) - 1;

pub struct Wide<const N: usize> {
    pub nodes: Pages<Node<N>>,
    pub leaves: Leaves,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    Fast,
    Medium,
    Thorough,
}

impl Quality {
    pub fn expecting(triangles: usize, rays: f64) -> Self {
        let seconds = |&(_, build, ray): &(Self, f64, f64)| {
            triangles as f64 * build + rays * ray * 65e-9
        };
        let all = [
            (Self::Fast, 0.6e-6, 1.12),
            (Self::Medium, 0.9e-6, 1.07),
            (Self::Thorough, 6e-6, 1.),
        ];
        all.into_iter()
            .min_by(|a, b| seconds(a).total_cmp(&seconds(b)))
            .map_or(Self::Medium, |q| q.0)
    }
}

impl std::fmt::Display for Quality {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Self::Fast => "fast",
            Self::Medium => "medium",
            Self::Thorough => "thorough",
        })
    }
}

const PADDING: f32 = 1. / 128.;

struct Padded<'a>(&'a Triangle);

impl Boundable for Padded<'_> {
    fn aabb(&self) -> Aabb {
        let [a, b, c] = self.0.map(Vec3A::from);
        let padding = Vec3A::splat(PADDING);
        Aabb::new(a.min(b).min(c) - padding, a.max(b).max(c) + padding)
    }
}

fn binary(triangles: &[Triangle], group: &[u32], quality: Quality) -> Bvh2 {
    let padded: Vec<_> =
        group.par_iter().map(|&i| Padded(&triangles[i as usize])).collect();
    let (distance, threshold, ratios): (_, _, &[f32]) = match quality {
        Quality::Fast => (PlocSearchDistance::Low, 2, &[0.02]),
        Quality::Medium => (PlocSearchDistance::Medium, 3, &[0.05, 0.1]),
        Quality::Thorough => (PlocSearchDistance::Medium, 1, &[1., 1.]),
    };
    let numbers = (0..group.len() as u32).collect();
    let mut tree = PlocBuilder::with_capacity(group.len()).build(
        distance,
        &padded,
        numbers,
        SortPrecision::U64,
        threshold,
    );
    drop(padded);
    let mut optimizer = ReinsertionOptimizer::default();
    for &ratio in ratios {
        optimizer.run(&mut tree, ratio, None);
    }
    tree
}

/// How a binary subtree is best cut.
struct Cuts {
    /// Nibble k-1: for k ≥ 2 how many of k go to the left, or 0 for as k-1; k=1: 1 if leaf
    of: Vec<u64>,
    counts: Vec<u32>,
}

type Costs = [f32; 17];

impl Cuts {
    fn get(&self, node: usize, k: usize) -> usize {
        (self.of[node] >> (4 * (k - 1)) & 15) as usize
    }
}

fn cut<const N: usize>(tree: &Bvh2) -> Cuts {
    let n = tree.nodes.len();
    let mut cuts = Cuts { of: vec![0; n], counts: vec![0; n] };
    // post order with an explicit stack
    let mut todo = vec![(0u32, false)];
    let mut costs: Vec<Costs> = vec![];
    while let Some((i, done)) = todo.pop() {
        let node = &tree.nodes[i as usize];
        let e = node.max - node.min;
        let area = e.x * e.y + e.y * e.z + e.z * e.x;
        if node.prim_count > 0 {
            cuts.counts[i as usize] = node.prim_count;
            cuts.of[i as usize] = 1;
            costs.push([area; 17]);
            continue;
        }
        let left = node.first_index;
        if !done {
            todo.push((i, true));
            todo.push((left + 1, false));
            todo.push((left, false));
            continue;
        }
        let r = costs.pop().unwrap();
        let l = costs.pop().unwrap();
        let (nl, nr) =
            (cuts.counts[left as usize], cuts.counts[left as usize + 1]);
        let count = nl + nr;
        cuts.counts[i as usize] = count;
        let (nl, nr) = ((nl as usize).min(N), (nr as usize).min(N));
        let most = (count as usize).min(N);
        let mut c = [f32::INFINITY; 17];
        let mut choices = 0u64;
        for k in 2..=most {
            let mut best = (f32::INFINITY, 0);
            for a in k.saturating_sub(nr).max(1)..=(k - 1).min(nl) {
                let cost = l[a] + r[k - a];
                if cost < best.0 {
                    best = (cost, a);
                }
            }
            c[k] = best.0;
            choices |= (best.1 as u64) << (4 * (k - 1));
        }
        let inner = c[most] + area;
        // most is only the least if costs decrease in k: they do after the prefix minimum below
        let mut k = 2;
        let mut least = c[2];
        while k < most {
            k += 1;
            if least <= c[k] {
                c[k] = least;
                choices &= !(15 << (4 * (k - 1)));
            } else {
                least = c[k];
            }
        }
        let inner = inner.min(least + area);
        c[1] = inner;
        if count as usize <= LANES && area <= inner {
            c[1] = area;
            choices |= 1;
        }
        for k in 2..=most {
            if c[k - 1] <= c[k] {
                c[k] = c[k - 1];
                choices &= !(15 << (4 * (k - 1)));
            }
        }
        for k in most + 1..=N {
            c[k] = c[most];
        }
        cuts.of[i as usize] = choices;
        costs.push(c);
    }
    cuts
}

struct Plan {
    children: Vec<u32>,
    first_node: u32,
    first_leaf: u32,
}

impl<const N: usize> Wide<N>
where
    Node<N>: Pod,
{
    pub fn new(
        scene: &Scene,
        quality: Quality,
    ) -> Result<Self, BuildError> {
        let triangles = scene.triangles();
        let n = triangles.len();
        let mut leaves =
            Leaves::with_room(n).map_err(BuildError::Memory)?;
        let mut room = leaves.room();
        let mut top = Node::EMPTY;
        let mut parts: Vec<Vec<Node<N>>> = vec![];
        let (mut nodes, mut slots) = (1, 0);
        let mut numbers: Vec<u32> = (0..n as u32).collect();
        let groups = if n > LARGE { N } else { 1 };
        for (slot, group) in
            split(triangles, &mut numbers, groups).into_iter().enumerate()
        {
            if group.is_empty() {
                continue;
            }
            let tree = binary(triangles, group, quality);
            let cuts = cut::<N>(&tree);
            let root = &tree.nodes[0];
            if groups > 1 {
                top.set(slot, root, nodes);
            }
            let base = if groups > 1 { nodes } else { 0 };
            let plans = plan::<N>(&tree, &cuts, base, slots);
            nodes += plans.len() as u32;
            slots += group.len() as u32;
            let mut part = vec![Node::EMPTY; plans.len()];
            fill(
                &tree,
                &cuts,
                &plans,
                triangles,
                group,
                &mut part,
                room.take(group.len()),
            );
            parts.push(part);
        }
        if groups > 1 || n == 0 {
            top.sort();
            parts.insert(0, vec![top]);
        }
        let total = parts.iter().map(Vec::len).sum();
        let mut all = Pages::zeroed(total).map_err(BuildError::Memory)?;
        let mut rest = all.as_mut_slice();
        for part in parts {
            let (here, after) = rest.split_at_mut(part.len());
            here.copy_from_slice(&part);
            rest = after;
        }
        Ok(Self { nodes: all, leaves })
    }

    pub fn bytes(&self) -> usize {
        size_of_val(&*self.nodes) + self.leaves.bytes()
    }
}

const LARGE: usize = 1 << 17;

/// Cuts the numbers in `parts` groups (a power of two) of neighbours
fn split<'a>(
    triangles: &[Triangle],
    numbers: &'a mut [u32],
    parts: usize,
) -> Vec<&'a mut [u32]> {
    if parts == 1 {
        return vec![numbers];
    }
    let middle = |i: u32| {
        let [a, b, c] = triangles[i as usize];
        a.min(b).min(c) + a.max(b).max(c)
    };
    let none = (glam::Vec3::INFINITY, glam::Vec3::NEG_INFINITY);
    let (low, high) = numbers.iter().fold(none, |(low, high), &i| {
        (low.min(middle(i)), high.max(middle(i)))
    });
    let axis = (high - low).max_position();
    let half = numbers.len() / 2;
    numbers.select_nth_unstable_by(half, |&i, &j| {
        middle(i)[axis].total_cmp(&middle(j)[axis]).then(i.cmp(&j))
    });
    let (left, right) = numbers.split_at_mut(half);
    let (mut left, right) = rayon::join(
        || split(triangles, left, parts / 2),
        || split(triangles, right, parts / 2),
    );
    left.extend(right);
    left
}

fn is_leaf(cuts: &Cuts, i: u32) -> bool {
    cuts.get(i as usize, 1) == 1
}

fn plan<const N: usize>(
    tree: &Bvh2,
    cuts: &Cuts,
    base: u32,
    slots: u32,
) -> Vec<Plan> {
    let mut plans = vec![];
    let (mut nodes, mut leaves) = (base + 1, slots);
    let mut todo = std::collections::VecDeque::from([0u32]);
    // breadth first: nodes are numbered as they are planned
    while let Some(i) = todo.pop_front() {
        let mut children = vec![];
        if is_leaf(cuts, i) {
            children.push(i);
        } else {
            collect(tree, cuts, i, N, true, &mut children);
        }
        let (first_node, first_leaf) = (nodes, leaves);
        for &c in &children {
            if is_leaf(cuts, c) {
                leaves += cuts.counts[c as usize];
            } else {
                nodes += 1;
                todo.push_back(c);
            }
        }
        plans.push(Plan { children, first_node, first_leaf });
    }
    plans
}

/// The roots of the forest of at most `k` trees that `i` is cut into
fn collect(
    tree: &Bvh2,
    cuts: &Cuts,
    i: u32,
    k: usize,
    root: bool,
    out: &mut Vec<u32>,
) {
    let mut k = k.min(cuts.counts[i as usize] as usize);
    while k > 1 && cuts.get(i as usize, k) == 0 {
        k -= 1;
    }
    if k == 1 && !root {
        out.push(i);
        return;
    }
    if k == 1 {
        unreachable!("root");
    }
    let left = cuts.get(i as usize, k);
    let first = tree.nodes[i as usize].first_index;
    collect(tree, cuts, first, left, false, out);
    collect(tree, cuts, first + 1, k - left, false, out);
}

impl<const N: usize> Node<N> {
    pub const EMPTY: Self = Self {
        planes: [
            [f32::INFINITY; N],
            [f32::INFINITY; N],
            [f32::INFINITY; N],
            [f32::NEG_INFINITY; N],
            [f32::NEG_INFINITY; N],
            [f32::NEG_INFINITY; N],
        ],
        children: [0; N],
        order: [0; N],
    };

    fn set(&mut self, slot: usize, b: &Bvh2Node, child: u32) {
        for axis in 0..3 {
            self.planes[axis][slot] = b.min[axis];
            self.planes[axis + 3][slot] = b.max[axis];
        }
        self.children[slot] = child;
    }

    fn sort(&mut self) {
        for octant in 0..8u32 {
            let sign = [0, 1, 2].map(|axis| octant >> axis & 1 != 0);
            let key = |slot: usize| -> f32 {
                (0..3)
                    .map(|axis| {
                        if sign[axis] {
                            self.planes[axis][slot]
                        } else {
                            -self.planes[axis + 3][slot]
                        }
                    })
                    .sum()
            };
            let keys: [f32; N] = std::array::from_fn(key);
            let mut slots: [u32; N] = std::array::from_fn(|i| i as u32);
            slots.sort_by(|&a, &b| {
                keys[b as usize].total_cmp(&keys[a as usize])
            });
            for (place, slot) in slots.into_iter().enumerate() {
                self.order[place] |= slot << (4 * octant);
            }
        }
    }
}

fn fill<const N: usize>(
    tree: &Bvh2,
    cuts: &Cuts,
    plans: &[Plan],
    triangles: &[Triangle],
    group: &[u32],
    nodes: &mut [Node<N>],
    mut room: Room,
) {
    let rooms: Vec<_> = plans
        .iter()
        .map(|plan| {
            let leaves =
                plan.children.iter().filter(|&&c| is_leaf(cuts, c));
            room.take(
                leaves.map(|&c| cuts.counts[c as usize] as usize).sum(),
            )
        })
        .collect();
    let work = nodes.par_iter_mut().zip(plans).zip(rooms);
    work.for_each(|((node, plan), mut room)| {
        let (mut next_node, mut next) = (plan.first_node, plan.first_leaf);
        for (slot, &child) in plan.children.iter().enumerate() {
            let b = &tree.nodes[child as usize];
            if is_leaf(cuts, child) {
                let count = cuts.counts[child as usize];
                node.set(slot, b, LEAF | (count - 1) << 29 | next);
                let mut ids = vec![];
                gather(tree, child, &mut ids);
                let mut all: Vec<_> = ids
                    .into_iter()
                    .map(|i| {
                        let i = group[i as usize];
                        (i, triangles[i as usize])
                    })
                    .collect();
                all.sort_unstable_by_key(|t| t.0);
                room.fill(&all);
                next += count;
            } else {
                node.set(slot, b, next_node);
                next_node += 1;
            }
        }
        node.sort();
    });
}

fn gather(tree: &Bvh2, i: u32, ids: &mut Vec<u32>) {
    let node = &tree.nodes[i as usize];
    if node.prim_count > 0 {
        for k in 0..node.prim_count {
            ids.push(
                tree.primitive_indices[(node.first_index + k) as usize],
            );
        }
    } else {
        gather(tree, node.first_index, ids);
        gather(tree, node.first_index + 1, ids);
    }
}
