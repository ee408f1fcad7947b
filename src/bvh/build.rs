// Tangled from chapters/wide.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From binary trees to one with many children a node.

use std::{io, mem};

use glam::DVec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use rayon::prelude::*;

use super::binary::{Corners, Group, Quality};
use super::binary::{balance, binary, leaves, region};
use super::triangle::Region;
use super::triangle::{FRAMES, LANES, LEAF, UNIT, leaf, slots, units};
use super::triangle::{Leaves, NestedFrame, write};
use super::wide::{Node, STACK, Wide};
use crate::memory::reserved;
use crate::numerics::bounds;
use crate::scene::Triangles;

/// The least costs of a subtree, as a wide tree or several.
struct Forest<const N: usize> {
    /// C(i, k) at k - 1.
    costs: [f32; N],
    /// The most trees that it can be: min(n, N).
    most: usize,
    /// How many triangles it has; more than `LANES` in a nested frame.
    count: usize,
}

impl<const N: usize> Forest<N> {
    /// The forest of a node of the given area from those of its children,
    /// and how it is cut.
    fn join(left: &Self, right: &Self, area: f32) -> (Self, Choices) {
        let most = (left.most + right.most).min(N);
        let mut costs = [f32::INFINITY; N];
        let mut choices = [0; N];
        for a in 1..=left.most.min(N - 1) {
            let best = costs[a..].iter_mut().zip(&mut choices[a..]);
            for ((cost, choice), right) in
                best.zip(&right.costs[..right.most])
            {
                let sum = left.costs[a - 1] + right;
                *choice = if sum < *cost { a as u32 } else { *choice };
                *cost = cost.min(sum);
            }
        }
        costs[0] = area + costs[most - 1];
        let count = left.count + right.count;
        if count <= LANES {
            costs[0] = area;
            choices[0] = 1;
        }
        for k in 2..=N {
            if costs[k - 2] < costs[k - 1] {
                costs[k - 1] = costs[k - 2];
                choices[k - 1] = 0;
            }
        }
        let choices = choices.into_iter().rev();
        let choices =
            choices.fold(0, |packed, a| packed << 4 | Choices::from(a));
        (Self { costs, most, count }, choices)
    }
}

/// The choices for one node of the binary tree. The choice for k is in the
/// four bits from bit 4(k - 1) on.
type Choices = u64;

/// The choices for this node, among all.
fn chosen(node: &Bvh2Node, choices: &[Choices]) -> Choices {
    let place = node.first_index as usize / 2;
    if node.is_leaf() { 1 } else { choices[place] }
}

/// How each node of a binary tree is best cut, for wide nodes of up to
/// `N` children.
fn cut<const N: usize>(tree: &[Bvh2Node]) -> Vec<Choices> {
    let mut choices = vec![0; tree.len() / 2];
    let mut forests: Vec<Forest<N>> = vec![];
    let root = (!tree.is_empty()).then_some((0, false));
    let mut todo = Vec::from_iter(root);
    while let Some((i, is_second_visit)) = todo.pop() {
        let node = &tree[i];
        let (first, area) =
            (node.first_index as usize, node.aabb().half_area());
        if node.is_leaf() {
            let count = if nested(node).is_some() { LANES } else { 1 };
            forests.push(Forest { costs: [area; N], most: 1, count });
        } else if !is_second_visit {
            todo.extend([(i, true), (first + 1, false), (first, false)]);
        } else if let (Some(right), Some(left)) =
            (forests.pop(), forests.pop())
        {
            let (forest, choice) = Forest::join(&left, &right, area);
            forests.push(forest);
            choices[first / 2] = choice;
        }
    }
    choices
}

/// Adds the roots of the least forest of at most `k` trees that
/// represents the subtree of node `i`.
fn add_forest(
    tree: &[Bvh2Node],
    choices: &[Choices],
    (i, k): (u32, u32),
    roots: &mut Vec<u32>,
) {
    let node = &tree[i as usize];
    let up_to_k = chosen(node, choices) & (!0 >> (64 - 4 * k));
    let last = up_to_k.checked_ilog2().unwrap_or(0) / 4;
    if last == 0 {
        return roots.push(i);
    }
    let (left, trees) = (node.first_index, (up_to_k >> (4 * last)) as u32);
    add_forest(tree, choices, (left, trees), roots);
    add_forest(tree, choices, (left + 1, last + 1 - trees), roots);
}

/// Subtrees of triangles that are smaller than this part of a region are
/// built anew,
const SMALL: f32 = 1. / 262144.;

/// if they are smaller than this part themselves,
const COMPACT: f32 = 1. / 256.;

/// and have more triangles than this.
const FEW: usize = 4;

/// Leaves of the binary tree from this number on are nested frames.
const CUT: u32 = 1 << 30;

/// The number of a nested frame, from 0, if the node is one.
fn nested(node: &Bvh2Node) -> Option<u32> {
    node.is_leaf().then(|| node.first_index.checked_sub(CUT))?
}

/// Ways in and out of nested frames that there can be.
const WAYS: usize = (1 << 29) - FRAMES as usize;

impl<const N: usize> Wide<N> {
    /// No nodes, with room for the nodes of so many triangles.
    fn empty(count: usize, region: Region) -> io::Result<Self> {
        let nodes = reserved(2 * count / N)?;
        let words = reserved(UNIT * units(1) as usize * count)?;
        let (leaves, frames) = (Leaves { words }, vec![]);
        Ok(Self { nodes, leaves, frames, region })
    }

    /// The nodes and leaves of a group, cut from its binary tree, and how
    /// many levels of nodes there are.
    fn fill(group: &Group, tree: &[Bvh2Node]) -> io::Result<(Self, usize)> {
        let mut wide = Self::empty(group.corners.len(), group.region)?;
        let choices = cut::<N>(tree);
        let (mut queue, mut levels) = (vec![(0, 1)], 1);
        while let Some(&(root, level)) = queue.get(wide.nodes.len()) {
            levels = level;
            let mut children = vec![];
            if !tree.is_empty() {
                add_forest(tree, &choices, (root, N as u32), &mut children);
            }
            let mut node = Node::EMPTY;
            for (lane, i) in children.into_iter().enumerate() {
                let child = if chosen(&tree[i as usize], &choices) & 15 == 1
                {
                    wide.add_leaf(group, tree, i)
                } else {
                    queue.push((i, level + 1));
                    queue.len() as u32 - 1
                };
                node.set(lane, tree[i as usize].aabb(), child);
            }
            wide.nodes.push(node);
        }
        Ok((wide, levels))
    }

    /// Writes the triangles below a node of the binary tree into a leaf,
    /// unless it is a nested frame. Returns the number of the child.
    fn add_leaf(
        &mut self,
        group: &Group,
        tree: &[Bvh2Node],
        i: u32,
    ) -> u32 {
        if let Some(number) = nested(&tree[i as usize]) {
            return leaf(FRAMES + 2 * number, 1);
        }
        let triangles = leaves(tree, i).map(|leaf| {
            let face = group.corners[leaf.first_index as usize].1;
            (face, group.triangle(leaf.first_index))
        });
        let mut triangles: Vec<_> = triangles.collect();
        triangles.sort_unstable_by_key(|(face, corners)| {
            (*face, corners.map(|p| p.to_array().map(f64::to_bits)))
        });
        let words = &mut self.leaves.words;
        let start = words.len();
        words.resize(start + UNIT * units(triangles.len()) as usize, 0);
        write(&mut words[start..], &triangles);
        leaf((start / UNIT) as u32, triangles.len())
    }

    /// The tree of a group, under so many levels of nodes, with room for so
    /// many ways in and out of nested frames.
    fn of(
        group: &Group,
        quality: Quality,
        mut above: usize,
        ways: usize,
    ) -> io::Result<Self> {
        let mut tree = binary(group, quality);
        // Cut off subtrees that are small beside the region
        let side = 2. * group.region.reach as f32;
        let extent = |node: &Bvh2Node| node.aabb().diagonal().max_element();
        let mut beyond = vec![];
        let mut todo = Vec::from_iter((!tree.is_empty()).then_some(0));
        while let Some(i) = todo.pop() {
            let node = tree[i as usize];
            if node.is_leaf() || beyond.len() == ways / 2 {
                continue;
            }
            let small = |leaf: Bvh2Node| extent(&leaf) < SMALL * side;
            if extent(&node) >= COMPACT * side
                || !leaves(&tree, i).all(small)
            {
                todo.extend([node.first_index + 1, node.first_index]);
                continue;
            }
            let below =
                leaves(&tree, i).map(|leaf| leaf.first_index as usize);
            let below: Vec<_> = below.map(|i| group.corners[i]).collect();
            if below.len() > FEW {
                let number = CUT + beyond.len() as u32;
                tree[i as usize] = Bvh2Node::new(*node.aabb(), 1, number);
                beyond.push(below);
            }
        }
        let (mut wide, mut levels) = Self::fill(group, &tree)?;
        let fits = |levels| N * (above + levels) + N <= STACK;
        let trees = if beyond.is_empty() { 1 } else { 2 };
        if !fits(trees * levels) {
            (wide, levels) = Self::fill(group, &balance(&tree))?;
        }
        if !fits(levels) {
            return Err(io::Error::other("clusters are nested too deeply"));
        }
        above += levels;
        drop(tree);
        let back = NestedFrame { region: group.region, node: None };
        wide.frames.resize(2 * beyond.len(), back);
        for (number, corners) in beyond.iter().enumerate() {
            let region = region(group.vertices, corners);
            let inner = Group { corners, region, ..*group };
            let left = ways - wide.frames.len();
            let inner = Self::of(&inner, quality, above, left)?;
            let node = Some(wide.append(inner)?);
            wide.frames[2 * number] = NestedFrame { region, node };
        }
        Ok(wide)
    }

    /// Adds the nodes, leaves and nested frames of another tree, and returns the
    /// number of its root.
    fn append(&mut self, mut other: Self) -> io::Result<u32> {
        if self.nodes.is_empty() {
            *self = other;
            return Ok(0);
        }
        let (node, frame) =
            (self.nodes.len() as u32, self.frames.len() as u32);
        let words = [&self.leaves, &other.leaves].map(|l| l.words.len());
        let [unit, more] = words.map(|words| words / UNIT);
        if unit + more > FRAMES as usize {
            return Err(io::Error::other("too many triangles"));
        }
        let children = other.nodes.iter_mut().flat_map(|n| &mut n.children);
        for child in children.filter(|child| **child != 0) {
            *child += match slots(*child).0 {
                _ if *child & LEAF == 0 => node,
                first if first < FRAMES => unit as u32,
                _ => frame,
            };
        }
        let roots =
            other.frames.iter_mut().filter_map(|frame| frame.node.as_mut());
        roots.for_each(|root| *root += node);
        self.nodes.append(&mut other.nodes);
        self.leaves.words.append(&mut other.leaves.words);
        self.frames.append(&mut other.frames);
        Ok(node)
    }

    /// Builds the tree of triangles, on all threads, and reports to `placed`
    /// how many are in it so far.
    ///
    /// # Errors
    /// The system has not enough memory, or there are too many triangles.
    pub fn new(
        triangles: Triangles,
        quality: Quality,
        placed: &dyn Fn(usize),
    ) -> io::Result<Self> {
        let mut above = usize::from(triangles.corners.len() > LARGE);
        while triangles.corners.len() > PART * N.pow(above as u32) {
            above += 1;
        }
        Self::under(triangles, quality, above, placed)
    }

    /// The same in parts under so many levels of nodes, or whole if the parts
    /// would overlap.
    fn under(
        triangles: Triangles,
        quality: Quality,
        mut above: usize,
        placed: &dyn Fn(usize),
    ) -> io::Result<Self> {
        let Triangles { vertices, corners, faces } = triangles;
        let mut corners: Vec<_> = corners.into_iter().zip(faces).collect();
        let (count, region) = (corners.len(), region(&vertices, &corners));
        let mut wide = Self::empty(count, region)?;
        let parts = N.pow(above as u32);
        // Sort the triangles into groups of neighbours
        let place = |(three, _): &Corners| vertices[three[0] as usize];
        let mut groups = vec![&mut corners[..]];
        while groups.len() < parts {
            let halves = groups.into_par_iter().flat_map_iter(|corners| {
                let (low, high) = bounds(corners.iter().map(place));
                let axis = (high - low).max_position();
                let half = corners.len() / 2;
                corners.select_nth_unstable_by(half, |i, j| {
                    let [p, q] = [i, j].map(|corners| place(corners)[axis]);
                    p.total_cmp(&q).then(i.cmp(j))
                });
                let (left, right) = corners.split_at_mut(half);
                [left, right]
            });
            groups = halves.collect();
        }
        if (LARGE + 1..=PART).contains(&count)
            && !are_apart(&vertices, &groups)
        {
            (above, groups) = (0, vec![&mut corners[..]]);
        }
        let parts = N.pow(above as u32);
        let tops = (parts - 1) / (N - 1);
        wide.nodes.resize(tops, Node::EMPTY);
        let mut roots: Vec<_> = (1..tops as u32).collect();
        // Build as many parts at a time as there are threads
        let groups = groups.into_par_iter().map(|corners| corners.to_vec());
        let mut groups: Vec<_> = groups.collect();
        drop(corners);
        let mut count = 0;
        for some in groups.chunks_mut(rayon::current_num_threads()) {
            let built = some.par_iter_mut().map(|corners| {
                let corners = &mem::take(corners)[..];
                let group = Group { vertices: &vertices, corners, region };
                let part = Self::of(&group, quality, above, WAYS / parts)?;
                Ok((part, corners.len()))
            });
            let built: io::Result<Vec<_>> = built.collect();
            for (part, triangles) in built? {
                roots.push(wide.append(part)?);
                count += triangles;
                placed(count);
            }
        }
        // Create the nodes above the parts
        for number in (0..tops).rev() {
            let mut node = Node::EMPTY;
            let children = &roots[number * N..][..N];
            for (lane, &child) in children.iter().enumerate() {
                let below = &wide.nodes[child as usize];
                let boxes = (0..N).map(|lane| below.bounds(lane));
                let bounds = boxes.fold(Aabb::empty(), |outer, inner| {
                    outer.union(&inner)
                });
                node.set(lane, &bounds, child);
            }
            wide.nodes[number] = node;
        }
        Ok(wide)
    }
}
/// Scenes with more triangles are built in parts,
const LARGE: usize = 1 << 17;

/// unless a ray that meets the scene is expected to meet more of them.
const MOST_MET: f64 = 3.;

/// The most triangles of a part.
const PART: usize = 1 << 20;

/// Whether the parts overlap so little that the scene is built in parts.
fn are_apart(vertices: &[DVec3], parts: &[&mut [Corners]]) -> bool {
    let boxes = parts.par_iter().map(|corners| {
        let points = corners.iter().flat_map(|(three, _)| three);
        bounds(points.map(|&k| vertices[k as usize]))
    });
    let boxes: Vec<_> = boxes.collect();
    let whole = bounds(boxes.iter().flat_map(|&(low, high)| [low, high]));
    let area = |(low, high): (DVec3, DVec3)| {
        let size = high - low;
        size.dot(DVec3::new(size.y, size.z, size.x))
    };
    let sum: f64 = boxes.into_iter().map(area).sum();
    sum <= MOST_MET * area(whole)
}

#[cfg(test)]
#[path = "../../tests/units/wide.rs"]
mod tests;
