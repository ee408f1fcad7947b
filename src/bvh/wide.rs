// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the triangles of a scene to a tree with many children a node.
//!
//! Boxes are in the coordinates of the scene, in single precision, and
//! larger by `PADDING` than what they hold. Node 0 is the root. Every
//! other node and every leaf is the child of exactly one node.

// Name what the wide hierarchy imports
use std::{fmt, io};

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, DEFAULT_MAX_STACK_DEPTH};
use obvhs::ploc::morton::morton_encode_u64_unorm;
use rayon::prelude::*;

use super::huge_pages::Pages;
use super::triangle::{LANES, Leaf, Leaves, MOST, Room};
use crate::scene::Triangle;

// Choose how thoroughly to build
/// How much work to put into a hierarchy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Six neighbours looked at, one improvement of 2 % of the nodes.
    Fast,
    /// Fourteen neighbours, improvements of 5 % and 10 % of the nodes.
    Medium,
    /// Fourteen neighbours, two improvements of all nodes.
    Thorough,
}

/// Each quality with the nanoseconds it takes to build per triangle, and
/// then per ray.
const PRICES: [(Quality, f64, f64); 3] = [
    (Quality::Fast, 320., 1.09 * 125.),
    (Quality::Medium, 500., 1.03 * 125.),
    (Quality::Thorough, 3100., 125.),
];

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Fast => "fast",
            Self::Medium => "medium",
            Self::Thorough => "thorough",
        })
    }
}

impl Quality {
    /// The quality for which building a hierarchy of `triangles`
    /// triangles and following `rays` rays through it takes the
    /// shortest time together.
    pub fn expecting(triangles: usize, rays: f64) -> Self {
        // Let the rays repay the builder
        let [mut best, others @ ..] = PRICES;
        for other in others {
            let loss = triangles as f64 * (other.1 - best.1);
            let gain = rays * (best.2 - other.2);
            if gain > loss {
                best = other;
            }
        }
        best.0
    }
}

// Lay out a wide node
/// The boxes of up to `N` children, lane by lane.
#[repr(C, align(64))]
#[derive(Clone, Copy, Debug)]
pub struct Node<const N: usize> {
    /// The least x, y and z, then the greatest x, y and z.
    pub planes: [[f32; N]; 6],
    /// Numbers of nodes, or leaves where `LEAF` is set.
    pub children: [u32; N],
    /// Lanes from the farthest child to the nearest, for a ray in octant
    /// `k` in the four bits from bit 4k.
    pub order: [u32; N],
}

/// Marks the number of a child as that of a leaf.
pub const LEAF: u32 = 1 << 31;

/// The child that is a leaf of `count` triangles from slot `first`.
fn leaf(first: u32, count: u32) -> u32 {
    LEAF | (count - 1) << 29 | first
}

/// The first slot and the count of a child that is a leaf.
#[inline(always)]
pub fn slots(child: u32) -> (u32, usize) {
    (child & ((1 << 29) - 1), (child >> 29 & 3) as usize + 1)
}

impl<const N: usize> Node<N> {
    // Begin without children
    /// No children at all.
    pub const EMPTY: Self = {
        let (above, below) = (f32::INFINITY, f32::NEG_INFINITY);
        let (least, greatest) = ([above; N], [below; N]);
        Self {
            planes: [least, least, least, greatest, greatest, greatest],
            children: [0; N],
            order: [0; N],
        }
    };

    // Put a child into a lane
    fn set(&mut self, lane: usize, bounds: &Bvh2Node, child: u32) {
        for axis in 0..3 {
            self.planes[axis][lane] = bounds.min[axis];
            self.planes[axis + 3][lane] = bounds.max[axis];
        }
        self.children[lane] = child;
    }

    /// The extreme corners of the box in a lane.
    fn bounds(&self, lane: usize) -> (DVec3, DVec3) {
        let corner = |row: usize| {
            let [x, y, z] =
                [0, 1, 2].map(|axis| self.planes[row + axis][lane]);
            DVec3::new(x.into(), y.into(), z.into())
        };
        (corner(0), corner(3))
    }

    // Order the children by octant
    /// Fills `order` from the boxes.
    fn sort(&mut self) {
        for octant in 0..8 {
            // Sort the lanes from far to near
            let far: [f32; N] =
                std::array::from_fn(|lane| self.entry(octant, lane));
            let mut lanes: [u32; N] =
                std::array::from_fn(|lane| lane as u32);
            lanes.sort_by(|&a, &b| {
                far[b as usize].total_cmp(&far[a as usize])
            });
            for (order, lane) in self.order.iter_mut().zip(lanes) {
                *order |= lane << (4 * octant);
            }
        }
    }

    /// How far along the diagonal of an octant its rays enter a box.
    fn entry(&self, octant: u32, lane: usize) -> f32 {
        let along = |axis: usize| match octant >> axis & 1 {
            1 => self.planes[axis][lane],
            _ => -self.planes[axis + 3][lane],
        };
        along(0) + along(1) + along(2)
    }
}

// SAFETY: each is 8 N numbers of four bytes, for which all bits are
// valid, zeros among them; 32 N bytes are a multiple of 64 for these
// two N, so that `repr(C, align(64))` adds no padding.
unsafe impl<const N: usize> Zeroable for Node<N> {}
unsafe impl Pod for Node<8> {}
unsafe impl Pod for Node<16> {}

const _: () = assert!(size_of::<Node<8>>() == 256);
const _: () = assert!(size_of::<Node<16>>() == 512);

// Build the binary tree
/// By how much a triangle's box is enlarged on all sides.
pub const PADDING: f32 = 1. / 128.;

/// The leaf of a triangle, with its enlarged box.
fn single(triangle: &Triangle, number: u32) -> Bvh2Node {
    let [a, b, c] = triangle.map(Vec3A::from);
    let padding = Vec3A::splat(PADDING);
    let low = a.min(b).min(c) - padding;
    let high = a.max(b).max(c) + padding;
    Bvh2Node::new(Aabb::new(low, high), 1, number)
}

/// A binary tree over the triangles, one in each leaf. Node 0 is the
/// root; the second child of a node follows its first.
fn binary(triangles: &[Triangle], quality: Quality) -> Vec<Bvh2Node> {
    // Turn the quality into numbers
    let (reach, early, parts): (_, _, &[f32]) = match quality {
        Quality::Fast => (6, 2, &[0.02]),
        Quality::Medium => (14, 3, &[0.05, 0.1]),
        Quality::Thorough => (14, 1, &[1., 1.]),
    };
    // Begin with a leaf per triangle
    let count = triangles.len();
    let order = in_morton_order(triangles);
    let mut nodes = vec![Bvh2Node::default(); 2 * count - count.min(1)];
    let places = nodes[..count].par_iter_mut().zip(order);
    places.for_each(|(place, i)| {
        *place = single(&triangles[i as usize], i);
    });
    let mut tree = join(nodes, reach, early);
    // Improve the binary tree
    let share = (CROWDED / crowd(&tree.nodes)).min(1.);
    if tree.max_depth <= DEFAULT_MAX_STACK_DEPTH {
        let mut optimizer = ReinsertionOptimizer::default();
        for &part in parts {
            optimizer.run(&mut tree, part * share, None);
        }
    }
    tree.nodes
}

/// The numbers of the triangles, in the order of the middles of their
/// boxes along Morton's curve.
fn in_morton_order(triangles: &[Triangle]) -> Vec<u32> {
    let leaf = |i: u32| single(&triangles[i as usize], i);
    let numbers = (0..triangles.len() as u32).into_par_iter();
    let boxes = numbers.clone().map(|i| *leaf(i).aabb());
    let all = boxes.reduce(Aabb::empty, |a, b| a.union(&b));
    let (low, size) = (all.min.as_dvec3(), all.diagonal().as_dvec3());
    // Sort the triangles by their codes
    let key = |i| {
        let middle = leaf(i).aabb().center().as_dvec3();
        (morton_encode_u64_unorm((middle - low) / size), i)
    };
    let mut keys: Vec<_> = numbers.map(key).collect();
    keys.par_sort_unstable();
    keys.into_par_iter().map(|(_, i)| i).collect()
}

/// Joins clusters, given in order in the first half of `nodes`, into a
/// binary tree, which fills it. A cluster looks for its partner `reach`
/// places far, but in the first `early` rounds only at its neighbours.
fn join(mut nodes: Vec<Bvh2Node>, reach: usize, early: usize) -> Bvh2 {
    let mut count = nodes.len().div_ceil(2);
    let mut partners = vec![0; count];
    let mut depth = 1;
    while count > 1 {
        // Join the clusters that choose each other
        let before = count;
        let reach = if depth <= early { 1 } else { reach };
        choose(&nodes[..count], reach, &mut partners[..count]);
        count = merge(&mut nodes, count, &partners);
        depth += 1;
        // Join neighbours after a slow round
        if (before - count) * SLOW < before {
            let last = count as u32 - 1;
            let neighbours = (0..=last).map(|i| (i ^ 1).min(last));
            partners.splice(..=last as usize, neighbours);
            count = merge(&mut nodes, count, &partners);
            depth += 1;
        }
    }
    // Hand the binary tree over
    Bvh2 {
        nodes,
        max_depth: depth.max(DEFAULT_MAX_STACK_DEPTH),
        children_are_ordered_after_parents: true,
        ..Bvh2::default()
    }
}

/// A round is slow in which fewer than one cluster in so many disappears.
const SLOW: usize = 16;

/// Joins those of the first `count` nodes, the clusters, that are each
/// other's partners. Returns how many clusters are left.
fn merge(nodes: &mut [Bvh2Node], count: usize, partners: &[u32]) -> usize {
    let mut free = 2 * count - 1;
    let mut kept = 0;
    for i in 0..count {
        let j = partners[i] as usize;
        let mut cluster = nodes[i];
        if j != i && partners[j] as usize == i {
            // Join a cluster with its partner
            if j < i {
                continue;
            }
            free -= 2;
            let partner = nodes[j];
            nodes[free] = cluster;
            nodes[free + 1] = partner;
            let bounds = cluster.aabb().union(partner.aabb());
            cluster = Bvh2Node::new(bounds, 0, free as u32);
        }
        nodes[kept] = cluster;
        kept += 1;
    }
    kept
}

/// For each cluster that one, up to `reach` places away, with which its
/// union has the least area.
fn choose(clusters: &[Bvh2Node], reach: usize, partners: &mut [u32]) {
    let stretch = clusters.len().div_ceil(64).max(1024);
    let stretches = partners.par_chunks_mut(stretch).enumerate();
    stretches.for_each(|(k, partners)| {
        let start = k * stretch;
        let end = start + partners.len();
        let mut best = vec![f32::INFINITY; partners.len()];
        // Compare each cluster with those after it
        for i in start.saturating_sub(reach)..end {
            let last = (i + reach).min(clusters.len() - 1);
            for j in i + 1..=last {
                // Offer two clusters to each other
                let union = clusters[i].aabb().union(clusters[j].aabb());
                let area = union.half_area();
                for (own, other) in [(i, j), (j, i)] {
                    let place = own.wrapping_sub(start);
                    if place < best.len() && area < best[place] {
                        best[place] = area;
                        partners[place] = other as u32;
                    }
                }
            }
        }
    });
}

/// How many boxes of a tree a ray that meets the root is expected to
/// meet: the sum of the surface area heuristic.
fn crowd(nodes: &[Bvh2Node]) -> f32 {
    let sum: f32 = nodes.iter().map(area).sum();
    sum / nodes.first().map_or(1., area)
}

/// From so many boxes on that a ray meets, less of a tree is improved.
const CROWDED: f32 = 200.;

// Cut the tree at least cost
/// The least costs of a subtree, as a wide tree or several.
struct Forest<const N: usize> {
    /// C(i, k) at k - 1.
    costs: [f32; N],
    /// How many trees it can be at most: min(n, N).
    most: usize,
}

impl<const N: usize> Forest<N> {
    /// That of a single triangle.
    fn single(area: f32) -> Self {
        Self { costs: [area; N], most: 1 }
    }

    // Join the forests of two children
    /// The forest of a node of the given area from those of its children,
    /// and how it is cut.
    fn join(left: &Self, right: &Self, area: f32) -> (Self, Choices) {
        let most = (left.most + right.most).min(N);
        let mut costs = [f32::INFINITY; N];
        let mut choices = Choices(0);
        // Try forests of two trees and more
        for k in 2..=most {
            let (cost, trees) = Self::split(left, right, k);
            costs[k - 1] = cost;
            choices.set(k, trees);
        }
        costs[0] = area + costs[most - 1];
        if most <= LANES {
            costs[0] = area;
            choices.set(1, 1);
        }
        // Let no more trees cost more
        for k in 2..=N {
            if costs[k - 2] <= costs[k - 1] {
                costs[k - 1] = costs[k - 2];
                choices.set(k, 0);
            }
        }
        (Self { costs, most }, choices)
    }

    /// D(i, k), and the number of trees on the left that attains it.
    fn split(left: &Self, right: &Self, k: usize) -> (f32, usize) {
        let mut best = (f32::INFINITY, 1);
        for a in k.saturating_sub(right.most).max(1)..=left.most.min(k - 1)
        {
            let cost = left.costs[a - 1] + right.costs[k - a - 1];
            if cost < best.0 {
                best = (cost, a);
            }
        }
        best
    }
}

/// The choices for one node of the binary tree, four bits for each k.
#[derive(Clone, Copy)]
struct Choices(u64);

impl Choices {
    const LEAF: Self = Self(1);

    fn set(&mut self, k: usize, trees: usize) {
        let shift = 4 * (k - 1);
        self.0 = self.0 & !(15 << shift) | (trees as u64) << shift;
    }

    fn get(self, k: usize) -> usize {
        (self.0 >> (4 * (k - 1)) & 15) as usize
    }

    fn is_leaf(self) -> bool {
        self.get(1) == 1
    }
}

/// How each node of a binary tree is best cut, for wide nodes of up to
/// `N` children.
fn cut<const N: usize>(tree: &[Bvh2Node]) -> Vec<Choices> {
    let mut choices = vec![Choices::LEAF; tree.len()];
    let mut forests: Vec<Forest<N>> = vec![];
    let root = (!tree.is_empty()).then_some((0, false));
    let mut todo = Vec::from_iter(root);
    while let Some((i, is_second_visit)) = todo.pop() {
        // Cut one node after its children
        let node = &tree[i];
        let first = node.first_index as usize;
        if node.is_leaf() {
            forests.push(Forest::single(area(node)));
        } else if !is_second_visit {
            todo.extend([(i, true), (first + 1, false), (first, false)]);
        } else if let (Some(right), Some(left)) =
            (forests.pop(), forests.pop())
        {
            let (forest, choice) = Forest::join(&left, &right, area(node));
            forests.push(forest);
            choices[i] = choice;
        }
    }
    choices
}

/// Half the surface area of a node's box.
fn area(node: &Bvh2Node) -> f32 {
    let e = node.max - node.min;
    e.x * e.y + e.y * e.z + e.z * e.x
}

// Number the nodes and leaves
/// Which nodes of a binary tree become nodes and leaves of a wide one.
#[derive(Default)]
struct Plan {
    /// The wide nodes in the order of their numbers, and one more that
    /// marks the end.
    nodes: Vec<Planned>,
    /// The binary nodes that become leaves, each with its first slot, and
    /// one more that marks the end.
    leaves: Vec<(u32, u32)>,
    /// How many slots the leaves have.
    slots: u32,
    /// The number of nodes on the longest way from the root.
    levels: usize,
}

/// A wide node before it has its children.
#[derive(Clone, Copy, Default)]
struct Planned {
    /// The binary node that it stands for.
    root: u32,
    /// Numbers of the first node and the first leaf below it.
    first_node: u32,
    first_leaf: u32,
}

impl Plan {
    fn new<const N: usize>(tree: &[Bvh2Node]) -> Self {
        let mut plan = Self::default();
        plan.nodes.push(Planned::default());
        let choices = cut::<N>(tree);
        // Go through the nodes level by level
        let mut next = 0;
        let mut level_end = 0;
        while next < plan.nodes.len() {
            if next == level_end {
                plan.levels += 1;
                level_end = plan.nodes.len();
            }
            let root = plan.nodes[next].root;
            plan.nodes[next] = plan.before_children(root);
            plan.add_children::<N>(tree, &choices, root);
            next += 1;
        }
        plan.nodes.push(plan.before_children(0));
        plan.leaves.push((0, plan.slots));
        plan
    }

    // Add the children of a node
    /// The node with a `root`, whose children are the next to be added.
    fn before_children(&self, root: u32) -> Planned {
        let first_node = self.nodes.len() as u32;
        Planned { root, first_node, first_leaf: self.leaves.len() as u32 }
    }

    fn add_children<const N: usize>(
        &mut self,
        tree: &[Bvh2Node],
        choices: &[Choices],
        root: u32,
    ) {
        match choices.get(root as usize) {
            None => (),
            Some(choice) if choice.is_leaf() => self.add_leaf(tree, root),
            Some(_) => self.split(tree, choices, root, N),
        }
    }

    /// Adds the forest of at most `k` > 1 trees without the node `i`.
    fn split(
        &mut self,
        tree: &[Bvh2Node],
        choices: &[Choices],
        i: u32,
        mut k: usize,
    ) {
        let choice = choices[i as usize];
        while k > 2 && choice.get(k) == 0 {
            k -= 1;
        }
        let trees = choice.get(k).max(1);
        let first = tree[i as usize].first_index;
        self.add(tree, choices, first, trees);
        self.add(tree, choices, first + 1, k - trees);
    }

    /// Adds the forest of at most `k` trees for the node `i`.
    fn add(
        &mut self,
        tree: &[Bvh2Node],
        choices: &[Choices],
        i: u32,
        k: usize,
    ) {
        let choice = choices[i as usize];
        if (2..=k).any(|k| choice.get(k) != 0) {
            self.split(tree, choices, i, k);
        } else if choice.is_leaf() {
            self.add_leaf(tree, i);
        } else {
            self.nodes.push(Planned { root: i, ..Planned::default() });
        }
    }

    /// Makes the node `i` a leaf, with slots for its triangles.
    fn add_leaf(&mut self, tree: &[Bvh2Node], i: u32) {
        self.leaves.push((i, self.slots));
        self.slots += gather(tree, i, &mut [0; LANES], 0) as u32;
    }
}

/// Children that the stack of a traversal holds.
pub const STACK: usize = 1024;

impl Plan {
    /// Whether the stack of a traversal is sure to suffice, with one more
    /// level above.
    fn fits<const N: usize>(&self) -> bool {
        (N - 1) * (self.levels + 1) + N <= STACK
    }
}

// Balance a tree that is too deep
/// A tree of least depth over the same leaves in the same order.
fn balance(tree: &[Bvh2Node]) -> Vec<Bvh2Node> {
    let leaves = leaves(tree);
    let mut balanced = vec![Bvh2Node::default()];
    let mut todo = vec![(0, leaves.as_slice())];
    while let Some((i, leaves)) = todo.pop() {
        // Halve the leaves below one node
        if let [leaf] = leaves {
            balanced[i] = *leaf;
            continue;
        }
        let first = balanced.len();
        balanced[i].make_inner(first as u32);
        balanced.extend([Bvh2Node::default(); 2]);
        let (left, right) = leaves.split_at(leaves.len() / 2);
        todo.extend([(first, left), (first + 1, right)]);
    }
    enclose(&mut balanced);
    balanced
}

/// Computes the boxes of inner nodes, whose children come after them.
fn enclose(tree: &mut [Bvh2Node]) {
    for i in (0..tree.len()).rev() {
        if !tree[i].is_leaf() {
            let first = tree[i].first_index as usize;
            let bounds = tree[first].aabb().union(tree[first + 1].aabb());
            tree[i].set_aabb(bounds);
        }
    }
}

/// The leaves of a tree from left to right.
fn leaves(tree: &[Bvh2Node]) -> Vec<Bvh2Node> {
    let mut leaves = vec![];
    let mut todo = vec![0];
    while let Some(i) = todo.pop() {
        let node = tree[i];
        let first = node.first_index as usize;
        match node.is_leaf() {
            true => leaves.push(node),
            false => todo.extend([first + 1, first]),
        }
    }
    leaves
}

// Fill the nodes and leaves
/// Scenes with more triangles are built in parts.
const LARGE: usize = 1 << 17;

/// Sorts the numbers of triangles into `parts` groups of neighbours, a
/// power of two.
fn halve<'a>(
    triangles: &[Triangle],
    numbers: &'a mut [u32],
    parts: usize,
) -> Vec<&'a mut [u32]> {
    if parts == 1 {
        return vec![numbers];
    }
    // Part the triangles at their median
    let axis = widest(triangles, numbers);
    let middle = |i: u32| twice_middle(&triangles[i as usize])[axis];
    let half = numbers.len() / 2;
    numbers.select_nth_unstable_by(half, |&i, &j| {
        middle(i).total_cmp(&middle(j)).then(i.cmp(&j))
    });
    let (left, right) = numbers.split_at_mut(half);
    let mut groups = halve(triangles, left, parts / 2);
    groups.extend(halve(triangles, right, parts / 2));
    groups
}

/// Twice the middle of a triangle's box.
fn twice_middle([a, b, c]: &Triangle) -> Vec3 {
    a.min(*b).min(*c) + a.max(*b).max(*c)
}

/// The axis in which the middles of triangles are spread most.
fn widest(triangles: &[Triangle], numbers: &[u32]) -> usize {
    let middles = numbers.iter().map(|&i| triangles[i as usize]);
    let none = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (low, high) = middles.fold(none, |(low, high), triangle| {
        let middle = twice_middle(&triangle);
        (low.min(middle), high.max(middle))
    });
    (high - low).max_position()
}

/// A tree with up to `N` children a node and four triangles a leaf.
pub struct Wide<const N: usize> {
    /// Node 0 is the root. The numbers in `children` are valid.
    pub nodes: Pages<Node<N>>,
    pub leaves: Leaves,
}

impl<const N: usize> Wide<N>
where
    Node<N>: Pod,
{
    // Build the wide hierarchy
    /// Builds the tree of triangles, on all threads.
    ///
    /// # Errors
    /// The system has not enough memory, or there are more than `MOST`
    /// triangles.
    pub fn new(
        triangles: Vec<Triangle>,
        quality: Quality,
    ) -> io::Result<Self> {
        let count = triangles.len();
        // Divide the triangles into groups
        if count > MOST {
            return Err(io::Error::other("too many triangles"));
        }
        let mut numbers: Vec<u32> = (0..count as u32).collect();
        let parts = if count > LARGE { N } else { 1 };
        let groups = halve(&triangles, &mut numbers, parts);
        let gathered = gathered(&triangles, &groups)?;
        drop(triangles);
        let mut leaves = Leaves::with_room(count)?;
        // Build the parts one after the other
        let mut room = leaves.room();
        let mut top = Node::EMPTY;
        let (mut first_node, mut first_slot) = (u32::from(parts > 1), 0);
        let mut nodes = vec![];
        for (lane, (group, own)) in groups.iter().zip(gathered).enumerate()
        {
            // Build one part in its place
            let part = Part::new::<N>(group, &own, quality);
            if let (true, Some(root)) = (parts > 1, part.tree.first()) {
                top.set(lane, root, first_node);
            }
            part.fill(room.take(group.len()), &own);
            drop(own);
            nodes.push(part.nodes(first_node, first_slot)?);
            first_node += nodes[lane].len() as u32;
            first_slot += group.len() as u32;
        }
        if parts > 1 {
            top.sort();
            nodes.insert(0, Pages::zeroed(1)?);
            nodes[0][0] = top;
        }
        Ok(Self { nodes: joined(nodes)?, leaves })
    }
}

/// The triangles of each group, in its order.
fn gathered(
    triangles: &[Triangle],
    groups: &[&mut [u32]],
) -> io::Result<Vec<Pages<Triangle>>> {
    let gather = |group: &&mut [u32]| {
        let mut own: Pages<Triangle> = Pages::zeroed(group.len())?;
        let places = own.par_iter_mut().zip(group.par_iter());
        places.for_each(|(place, &i)| *place = triangles[i as usize]);
        Ok(own)
    };
    groups.iter().map(gather).collect()
}

/// The nodes of all parts in one array; a part is given back when it
/// is copied.
fn joined<const N: usize>(
    mut parts: Vec<Pages<Node<N>>>,
) -> io::Result<Pages<Node<N>>>
where
    Node<N>: Pod,
{
    if parts.len() == 1 {
        return Ok(parts.remove(0));
    }
    let mut all = Pages::zeroed(parts.iter().map(|p| p.len()).sum())?;
    // Copy the nodes part by part
    let mut end = 0;
    for part in parts {
        let start = end;
        end += part.len();
        all[start..end].copy_from_slice(&part);
    }
    Ok(all)
}

/// A part of a scene, ready to become nodes and leaves.
struct Part<'a> {
    /// The number of each triangle in the scene.
    group: &'a [u32],
    tree: Vec<Bvh2Node>,
    plan: Plan,
}

impl<'a> Part<'a> {
    fn new<const N: usize>(
        group: &'a [u32],
        triangles: &[Triangle],
        quality: Quality,
    ) -> Self {
        let mut tree = binary(triangles, quality);
        // Plan for the size of the stack
        let mut plan = Plan::new::<N>(&tree);
        if !plan.fits::<N>() {
            tree = balance(&tree);
            plan = Plan::new::<N>(&tree);
            assert!(plan.fits::<N>(), "a balanced tree is too deep");
        }
        Self { group, tree, plan }
    }

    // Fill the nodes of a part
    /// The nodes, of which the first has the number `node`; the leaves
    /// begin with slot `slot`.
    fn nodes<const N: usize>(
        &self,
        node: u32,
        slot: u32,
    ) -> io::Result<Pages<Node<N>>>
    where
        Node<N>: Pod,
    {
        let pairs = self.plan.nodes.par_windows(2);
        let mut nodes: Pages<Node<N>> = Pages::zeroed(pairs.len())?;
        nodes.par_iter_mut().zip(pairs).for_each(|(place, pair)| {
            *place = self.node(&pair[0], &pair[1], node, slot);
        });
        Ok(nodes)
    }

    /// The node `this`; `next` follows it.
    fn node<const N: usize>(
        &self,
        this: &Planned,
        next: &Planned,
        first_node: u32,
        first_slot: u32,
    ) -> Node<N> {
        // Count off the children of this node
        let Plan { nodes, leaves, .. } = &self.plan;
        let nodes = (this.first_node..next.first_node).map(|number| {
            (nodes[number as usize].root, first_node + number)
        });
        let range = this.first_leaf as usize..=next.first_leaf as usize;
        let leaves = leaves[range].windows(2).map(|pair| {
            let [(root, first), (_, end)] = [pair[0], pair[1]];
            (root, leaf(first_slot + first, end - first))
        });
        let mut node = Node::EMPTY;
        for (lane, (root, child)) in nodes.chain(leaves).enumerate() {
            node.set(lane, &self.tree[root as usize], child);
        }
        node.sort();
        node
    }

    // Fill the leaves of a part
    /// Puts the triangles of the group into their slots.
    fn fill(&self, mut room: Room, triangles: &[Triangle]) {
        let leaves = &self.plan.leaves;
        // Cut off a room for each stretch of leaves
        let starts = (0..leaves.len() - 1).step_by(STRETCH);
        let stretches = starts.map(|start| {
            let end = (start + STRETCH).min(leaves.len() - 1);
            let length = leaves[end].1 - leaves[start].1;
            (&leaves[start..=end], room.take(length as usize))
        });
        let stretches: Vec<_> = stretches.collect();
        stretches.into_par_iter().for_each(|(leaves, mut room)| {
            for pair in leaves.windows(2) {
                let [(root, first), (_, end)] = [pair[0], pair[1]];
                let mut room = room.take((end - first) as usize);
                // Fill the room of a leaf
                let mut numbers = [0; LANES];
                let count = gather(&self.tree, root, &mut numbers, 0);
                let mut own = numbers.map(|i| {
                    (self.group[i as usize], triangles[i as usize])
                });
                own[..count].sort_unstable_by_key(|&(number, _)| number);
                room.fill(&own[..count]);
            }
        });
    }
}

/// How many leaves are filled by one thread without asking for more.
const STRETCH: usize = 256;

/// Writes the triangles below node `i` from `count` on; returns where
/// they end.
fn gather(
    tree: &[Bvh2Node],
    i: u32,
    numbers: &mut [u32; LANES],
    count: usize,
) -> usize {
    let node = &tree[i as usize];
    if node.is_leaf() {
        numbers[count] = node.first_index;
        return count + 1;
    }
    let count = gather(tree, node.first_index, numbers, count);
    gather(tree, node.first_index + 1, numbers, count)
}

// Ask other questions than rays do
impl<const N: usize> Wide<N>
where
    Node<N>: Pod,
{
    /// Whether `asked` is true of a triangle, given its leaf, lane and
    /// slot, and its corners. Only boxes that `enters` lets pass, given
    /// their two extreme corners, are looked into.
    pub fn any(
        &self,
        enters: &impl Fn(DVec3, DVec3) -> bool,
        asked: &impl Fn(&Leaf, (usize, u32), &[DVec3; 3]) -> bool,
    ) -> bool {
        self.any_below(0, enters, asked)
    }

    // Descend into the boxes that matter
    fn any_below(
        &self,
        child: u32,
        enters: &impl Fn(DVec3, DVec3) -> bool,
        asked: &impl Fn(&Leaf, (usize, u32), &[DVec3; 3]) -> bool,
    ) -> bool {
        if child & LEAF != 0 {
            // Ask about each triangle of the leaf
            let (first, count) = slots(child);
            // SAFETY: children with the bit LEAF are leaves that are there.
            let leaf = unsafe { self.leaves.leaf(first, count) };
            return (0..count).zip(first..).any(|(lane, slot)| {
                asked(&leaf, (lane, slot), &leaf.triangle(lane as u32))
            });
        }
        let nodes: &[Node<N>] = &self.nodes;
        let node = &nodes[child as usize];
        (0..N).any(|lane| {
            let (low, high) = node.bounds(lane);
            low.x <= high.x
                && enters(low, high)
                && self.any_below(node.children[lane], enters, asked)
        })
    }

    // List all triangles leaf by leaf
    /// All triangles, each with its slot.
    pub fn triangles(&self) -> impl Iterator<Item = (u32, Triangle)> {
        let children = self.nodes.iter().flat_map(|node| node.children);
        let leaves = children.filter(|child| child & LEAF != 0).map(slots);
        leaves.flat_map(|(first, count)| {
            // SAFETY: children with the bit LEAF are leaves that are there.
            let leaf = unsafe { self.leaves.leaf(first, count) };
            let corners = move |lane| {
                leaf.triangle(lane).map(|corner| corner.as_vec3())
            };
            (first..).zip((0..count as u32).map(corners))
        })
    }
}

// Test the wide hierarchy's invariants
#[cfg(test)]
#[path = "../../tests/units/wide.rs"]
mod tests;
