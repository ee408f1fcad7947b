// Tangled from chapters/wide.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the triangles of a scene to a tree with many children a node.
//!
//! Boxes are in single precision, counted from the middle of a region,
//! and padded. Node 0 is the root. Every other node and every leaf is
//! the child of exactly one node, or what one gate leads to.

use std::{fmt, io, mem};

use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, DEFAULT_MAX_STACK_DEPTH};
use obvhs::ploc::morton::morton_encode_u64_unorm;
use rayon::prelude::*;

use super::triangle::{
    GATES, Gate, LANES, LEAF, Leaf, Leaves, Region, UNIT, leaf, slot,
    slots, units, write,
};
use crate::memory::{reserved, zeroed};
use crate::scene::{Triangle, Triangles};

/// How much work to put into a hierarchy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Six neighbours looked at, one improvement of 2 % of the nodes.
    Fast,
    /// Fourteen neighbours, two improvements of all nodes.
    Thorough,
}

/// A thorough hierarchy pays from so many rays per triangle on.
const REPAID: f64 = 500.;

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Fast => "fast",
            Self::Thorough => "thorough",
        })
    }
}

impl Quality {
    /// The quality for which building a hierarchy of `triangles`
    /// triangles and following `rays` rays through it takes the
    /// shortest time together.
    pub fn expecting(triangles: usize, rays: f64) -> Self {
        match rays > REPAID * triangles as f64 {
            true => Self::Thorough,
            false => Self::Fast,
        }
    }
}

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

impl<const N: usize> Node<N> {
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

    fn set(&mut self, lane: usize, bounds: &Aabb, child: u32) {
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

const _: () = assert!(size_of::<Node<8>>() == 256);
const _: () = assert!(size_of::<Node<16>>() == 512);

impl<const N: usize> Node<N> {
    /// The lanes whose boxes meet the one between two finite corners.
    fn meets(&self, low: Vec3, high: Vec3) -> [bool; N] {
        let mut meets = [true; N];
        for axis in 0..3 {
            let (low, high) = (low[axis], high[axis]);
            let [first, last] =
                [axis, axis + 3].map(|row| &self.planes[row]);
            for lane in 0..N {
                meets[lane] &= (first[lane] <= high) & (last[lane] >= low);
            }
        }
        meets
    }
}

/// The corners of a triangle, as numbers of vertices, and its face.
type Corners = ([u32; 3], u32);

/// Some triangles of a scene, and the region around them.
struct Group<'a> {
    vertices: &'a [DVec3],
    corners: Vec<Corners>,
    region: Region,
}

/// The extreme corners of the box of points.
fn corners_of(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    points.fold(none, |(low, high), p| (low.min(p), high.max(p)))
}

/// The region of triangles.
fn region(vertices: &[DVec3], corners: &[Corners]) -> Region {
    let points = corners.iter().flat_map(|(three, _)| three);
    let (low, high) = corners_of(points.map(|&k| vertices[k as usize]));
    match low.x > high.x {
        true => Region::NONE,
        false => Region::between(low, high),
    }
}

/// By how much the boxes of a region are enlarged on all sides: 2^-20 of
/// its reach.
const PADDING: f64 = 1. / (1 << 20) as f64;

/// More of it, as a part of the coordinates of its middle: 2^-48.
const PLACE: f64 = 1. / (1u64 << 48) as f64;

/// More of it: 2^-120, since single precision is coarse where it ends.
const FLOOR: f64 = 1. / (1u128 << 120) as f64;

impl Group<'_> {
    fn triangle(&self, i: u32) -> Triangle {
        self.corners[i as usize].0.map(|k| self.vertices[k as usize])
    }

    /// The leaf of a triangle, with its enlarged box.
    fn single(&self, i: u32) -> Bvh2Node {
        // Enclose a triangle in its region
        let Region { zero, reach, .. } = self.region;
        let place = |p: DVec3| Vec3A::from((p - zero).as_vec3());
        let [a, b, c] = self.triangle(i).map(place);
        let far = zero.abs().max_element();
        let padding = PADDING * reach + PLACE * far + FLOOR;
        let padding = Vec3A::splat(padding as f32);
        let low = a.min(b).min(c) - padding;
        let high = a.max(b).max(c) + padding;
        Bvh2Node::new(Aabb::new(low, high), 1, i)
    }
}

/// A binary tree over the triangles, one in each leaf. Node 0 is the
/// root; the second child of a node follows its first.
fn binary(group: &Group, quality: Quality) -> Vec<Bvh2Node> {
    // Turn the quality into numbers
    let (reach, early, parts): (_, _, &[f32]) = match quality {
        Quality::Fast => (6, 2, &[0.02]),
        Quality::Thorough => (14, 1, &[1., 1.]),
    };
    // Begin with a leaf per triangle
    let count = group.corners.len();
    let order = in_morton_order(group);
    let mut nodes = vec![Bvh2Node::default(); 2 * count - count.min(1)];
    let places = nodes[..count].par_iter_mut().zip(order);
    places.for_each(|(place, i)| {
        *place = group.single(i);
    });
    let mut tree = join(nodes, reach, early);
    // Improve the binary tree
    let share = (MOST_BOXES / expected_boxes(&tree.nodes)).min(1.);
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
fn in_morton_order(group: &Group) -> Vec<u32> {
    let leaf = |i: u32| group.single(i);
    let numbers = (0..group.corners.len() as u32).into_par_iter();
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
fn expected_boxes(nodes: &[Bvh2Node]) -> f32 {
    let sum: f32 = nodes.iter().map(area).sum();
    sum / nodes.first().map_or(1., area)
}

/// From so many boxes on that a ray meets, less of a tree is improved.
const MOST_BOXES: f32 = 200.;

/// The least costs of a subtree, as a wide tree or several.
struct Forest<const N: usize> {
    /// C(i, k) at k - 1.
    costs: [f32; N],
    /// How many trees it can be at most: min(n, N).
    most: usize,
    /// How many triangles it has; more than `LANES` beyond a gate.
    count: usize,
}

impl<const N: usize> Forest<N> {
    /// That of a single triangle, or of a gate.
    fn single(area: f32, count: usize) -> Self {
        Self { costs: [area; N], most: 1, count }
    }

    /// The forest of a node of the given area from those of its children,
    /// and how it is cut.
    fn join(left: &Self, right: &Self, area: f32) -> (Self, Choices<N>) {
        let most = (left.most + right.most).min(N);
        let mut costs = [f32::INFINITY; N];
        let mut choices = [0; N];
        // Try forests of two trees and more
        for k in 2..=most {
            let (cost, trees) = Self::split(left, right, k);
            costs[k - 1] = cost;
            choices[k - 1] = trees as u8;
        }
        costs[0] = area + costs[most - 1];
        let count = left.count + right.count;
        if count <= LANES {
            costs[0] = area;
            choices[0] = 1;
        }
        // Let no more trees cost more
        for k in 2..=N {
            if costs[k - 2] <= costs[k - 1] {
                costs[k - 1] = costs[k - 2];
                choices[k - 1] = 0;
            }
        }
        (Self { costs, most, count }, choices)
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

/// The choices for one node of the binary tree, that for k at k - 1.
type Choices<const N: usize> = [u8; N];

/// How each node of a binary tree is best cut, for wide nodes of up to
/// `N` children.
fn cut<const N: usize>(tree: &[Bvh2Node]) -> Vec<Choices<N>> {
    let leaf = std::array::from_fn(|k| u8::from(k == 0));
    let mut choices = vec![leaf; tree.len()];
    let mut forests: Vec<Forest<N>> = vec![];
    let root = (!tree.is_empty()).then_some((0, false));
    let mut todo = Vec::from_iter(root);
    while let Some((i, is_second_visit)) = todo.pop() {
        // Cut one node after its children
        let node = &tree[i];
        let first = node.first_index as usize;
        if node.is_leaf() {
            let count = if gate(node).is_some() { LANES } else { 1 };
            forests.push(Forest::single(area(node), count));
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

/// Which nodes of a binary tree become nodes and leaves of a wide one.
#[derive(Default)]
struct Plan {
    /// The wide nodes in the order of their numbers, and one more that
    /// marks the end.
    nodes: Vec<Planned>,
    /// The binary nodes that become leaves or gates, each with its first
    /// unit, and one more that marks the end.
    leaves: Vec<(u32, u32)>,
    /// How many units the leaves take.
    units: u32,
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
            plan.add_children(tree, &choices, root);
            next += 1;
        }
        plan.nodes.push(plan.before_children(0));
        plan.leaves.push((0, plan.units));
        plan
    }

    /// The node with a `root`, whose children are the next to be added.
    fn before_children(&self, root: u32) -> Planned {
        let first_node = self.nodes.len() as u32;
        Planned { root, first_node, first_leaf: self.leaves.len() as u32 }
    }

    fn add_children<const N: usize>(
        &mut self,
        tree: &[Bvh2Node],
        choices: &[Choices<N>],
        root: u32,
    ) {
        match choices.get(root as usize) {
            None => (),
            Some(choice) if choice[0] == 1 => {
                self.add_leaf(tree, root);
            }
            Some(_) => self.split(tree, choices, root, N),
        }
    }

    /// Adds the forest of at most `k` > 1 trees without the node `i`.
    fn split<const N: usize>(
        &mut self,
        tree: &[Bvh2Node],
        choices: &[Choices<N>],
        i: u32,
        mut k: usize,
    ) {
        let choice = choices[i as usize];
        while k > 2 && choice[k - 1] == 0 {
            k -= 1;
        }
        let trees = usize::from(choice[k - 1].max(1));
        let first = tree[i as usize].first_index;
        self.add(tree, choices, first, trees);
        self.add(tree, choices, first + 1, k - trees);
    }

    /// Adds the forest of at most `k` trees for the node `i`.
    fn add<const N: usize>(
        &mut self,
        tree: &[Bvh2Node],
        choices: &[Choices<N>],
        i: u32,
        k: usize,
    ) {
        let choice = choices[i as usize];
        if choice[1..k].iter().any(|&trees| trees != 0) {
            self.split(tree, choices, i, k);
        } else if choice[0] == 1 {
            self.add_leaf(tree, i);
        } else {
            self.nodes.push(Planned { root: i, ..Planned::default() });
        }
    }

    /// Makes the node `i` a leaf, with units for its triangles, or a gate.
    fn add_leaf(&mut self, tree: &[Bvh2Node], i: u32) {
        self.leaves.push((i, self.units));
        if gate(&tree[i as usize]).is_none() {
            let count = gather(tree, i, &mut [0; LANES], 0);
            self.units += units(count);
        }
    }
}

/// Children that the stack of a traversal holds.
pub const STACK: usize = 1024;

impl Plan {
    /// Whether the stack of a traversal is sure to suffice, with so many
    /// levels above.
    fn fits<const N: usize>(&self, above: usize) -> bool {
        N * (self.levels + above) + N <= STACK
    }
}

/// A tree of least depth over the same leaves in the same order.
fn balance(tree: &[Bvh2Node]) -> Vec<Bvh2Node> {
    let leaves = leaves(tree, 0);
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

/// The leaves below node `i` from left to right.
fn leaves(tree: &[Bvh2Node], i: usize) -> Vec<Bvh2Node> {
    let mut leaves = vec![];
    let mut todo = vec![i];
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

/// Subtrees of triangles that are smaller than this part of a region are
/// built anew,
const SMALL: f32 = 1. / 262144.;

/// if they are smaller than this part themselves,
const COMPACT: f32 = 1. / 256.;

/// and have more triangles than this.
const FEW: usize = 4;

/// Leaves of the binary tree from this number on are gates.
const CUT: u32 = 1 << 30;

/// The number of a gate, from 0, if the node is one.
fn gate(node: &Bvh2Node) -> Option<u32> {
    node.is_leaf().then(|| node.first_index.checked_sub(CUT))?
}

fn extent(node: &Bvh2Node) -> f32 {
    node.aabb().diagonal().max_element()
}

/// The longest side of the boxes of triangles below each node.
fn longest(tree: &[Bvh2Node]) -> Vec<f32> {
    let mut order = Vec::from_iter((!tree.is_empty()).then_some(0));
    let mut next = 0;
    while let Some(&i) = order.get(next) {
        if !tree[i].is_leaf() {
            let first = tree[i].first_index as usize;
            order.extend([first, first + 1]);
        }
        next += 1;
    }
    let mut longest = vec![0f32; tree.len()];
    for &i in order.iter().rev() {
        let first = tree[i].first_index as usize;
        longest[i] = match tree[i].is_leaf() {
            true => extent(&tree[i]),
            false => longest[first].max(longest[first + 1]),
        };
    }
    longest
}

/// Cuts up to `most` subtrees off that are small beside the region;
/// returns their triangles.
fn cut_off(
    group: &Group,
    tree: &mut [Bvh2Node],
    most: usize,
) -> Vec<Vec<Corners>> {
    let side = 2. * group.region.reach as f32;
    let longest = longest(tree);
    let is_large = |i: usize, node: &Bvh2Node| {
        longest[i] >= SMALL * side || extent(node) >= COMPACT * side
    };
    let mut groups = vec![];
    let mut todo = Vec::from_iter((!tree.is_empty()).then_some(0));
    while let Some(i) = todo.pop() {
        let node = tree[i];
        let first = node.first_index as usize;
        if node.is_leaf() || groups.len() == most {
            continue;
        } else if is_large(i, &node) {
            todo.extend([first + 1, first]);
            continue;
        }
        // Put a gate in the place of a subtree
        let below = leaves(tree, i);
        if below.len() > FEW {
            let number = CUT + groups.len() as u32;
            let own = below.iter().map(|leaf| leaf.first_index as usize);
            groups.push(own.map(|i| group.corners[i]).collect());
            tree[i] = Bvh2Node::new(*node.aabb(), 1, number);
        }
    }
    groups
}

/// Ways through gates that there can be.
const WAYS: usize = (1 << 29) - GATES as usize;

/// Scenes with more triangles are built in parts,
const LARGE: usize = 1 << 17;

/// of so many triangles at most.
const PART: usize = 1 << 21;

/// Sorts triangles into `parts` groups of neighbours, a power of two.
fn halve<'a>(
    vertices: &[DVec3],
    corners: &'a mut [Corners],
    parts: usize,
) -> Vec<&'a mut [Corners]> {
    if parts == 1 {
        return vec![corners];
    }
    // Part the triangles at their median
    let twice_middle = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|k| vertices[k as usize]);
        a.min(b).min(c) + a.max(b).max(c)
    };
    let middles = corners.iter().map(|(three, _)| twice_middle(three));
    let (low, high) = corners_of(middles);
    let axis = (high - low).max_position();
    let half = corners.len() / 2;
    corners.select_nth_unstable_by(half, |(i, _), (j, _)| {
        let [p, q] = [i, j].map(|three| twice_middle(three)[axis]);
        p.total_cmp(&q).then(i.cmp(j))
    });
    let (left, right) = corners.split_at_mut(half);
    let (mut groups, others) = rayon::join(
        || halve(vertices, left, parts / 2),
        || halve(vertices, right, parts / 2),
    );
    groups.extend(others);
    groups
}

/// A tree with up to `N` children a node and four triangles a leaf.
pub struct Wide<const N: usize> {
    /// Node 0 is the root. The numbers in `children` are valid.
    pub nodes: Vec<Node<N>>,
    pub leaves: Leaves,
    /// Each with the way back after it.
    pub gates: Vec<Gate>,
    /// That of all triangles.
    pub region: Region,
}

impl<const N: usize> Wide<N> {
    /// Builds the tree of triangles, on all threads, and tells `placed`
    /// how many are in it by now.
    ///
    /// # Errors
    /// The system has not enough memory, or there are too many triangles.
    pub fn new(
        triangles: Triangles,
        quality: Quality,
        placed: &dyn Fn(usize),
    ) -> io::Result<Self> {
        let mut above = usize::from(triangles.len() > LARGE);
        while triangles.len() > PART * N.pow(above as u32) {
            above += 1;
        }
        Self::under(triangles, quality, above, placed)
    }

    /// The same in parts, under so many levels of nodes.
    fn under(
        triangles: Triangles,
        quality: Quality,
        above: usize,
        placed: &dyn Fn(usize),
    ) -> io::Result<Self> {
        let Triangles { vertices, corners, faces } = triangles;
        let mut corners: Vec<_> = corners.into_iter().zip(faces).collect();
        let region = region(&vertices, &corners);
        let room = UNIT * units(1) as usize * corners.len();
        // Divide the triangles into groups
        let parts = N.pow(above as u32);
        let groups = halve(&vertices, &mut corners, parts);
        let groups = groups.into_par_iter().map(|group| group.to_vec());
        let mut groups: Vec<_> = groups.collect();
        drop(corners);
        // Begin with nothing built
        let tops = (parts - 1) / (N - 1);
        let ways = WAYS / parts;
        let mut built = Built {
            quality,
            nodes: vec![],
            next: tops as u32,
            words: zeroed(room)?,
            units: 0,
            gates: vec![],
            ways: 0,
        };
        // Build as many parts at a time as there are threads
        let (mut roots, mut count) = (vec![], 0);
        for some in groups.chunks_mut(rayon::current_num_threads()) {
            let some = some.par_iter_mut().map(|corners| {
                let corners = mem::take(corners);
                let group = Group { vertices: &vertices, corners, region };
                Part::new::<N>(group, quality, above, ways / 2)
            });
            let some: io::Result<Vec<_>> = some.collect();
            for part in some? {
                let root = part.tree.first();
                let bounds =
                    root.map_or(Aabb::empty(), |root| *root.aabb());
                roots.push((bounds, built.next));
                built.ways += ways;
                count += part.group.corners.len();
                built.add(part)?;
                placed(count);
            }
        }
        // Join the roots of the parts
        if parts > 1 {
            built.nodes.insert(0, vec![Node::EMPTY; tops]);
        }
        while roots.len() > 1 {
            let first = (roots.len() / N - 1) / (N - 1);
            let mut above = vec![];
            for (children, number) in roots.chunks(N).zip(first..) {
                // Put a node above its children
                let node = &mut built.nodes[0][number];
                *node = Node::EMPTY;
                let mut bounds = Aabb::empty();
                for (lane, (part, child)) in children.iter().enumerate() {
                    node.set(lane, part, *child);
                    bounds = bounds.union(part);
                }
                node.sort();
                above.push((bounds, number as u32));
            }
            roots = above;
        }
        let Built { nodes, words, gates, .. } = built;
        drop(vertices);
        let leaves = Leaves { words };
        Ok(Self { nodes: joined(nodes)?, leaves, gates, region })
    }
}

/// The elements of all parts in one array; a part is given back when it
/// is copied.
fn joined<T: Copy>(mut parts: Vec<Vec<T>>) -> io::Result<Vec<T>> {
    if parts.len() == 1 {
        return Ok(parts.remove(0));
    }
    let mut all = reserved(parts.iter().map(Vec::len).sum())?;
    for part in parts {
        all.extend_from_slice(&part);
    }
    Ok(all)
}

/// The parts of a hierarchy that have been built.
struct Built<const N: usize> {
    quality: Quality,
    /// The nodes of each.
    nodes: Vec<Vec<Node<N>>>,
    /// The number of the node that comes next.
    next: u32,
    /// The leaves, with room for as many as there may be.
    words: Vec<u32>,
    /// How many units of them are filled.
    units: u32,
    gates: Vec<Gate>,
    /// How many ways through gates there may be up to now.
    ways: usize,
}

impl<const N: usize> Built<N> {
    /// Fills the nodes and leaves of a part, and those of the trees
    /// beyond its gates.
    fn add(&mut self, part: Part) -> io::Result<()> {
        // Fill the nodes and leaves of a part
        let gate = self.gates.len();
        let unit = self.units;
        self.units = unit
            .checked_add(part.plan.units)
            .filter(|&units| units < GATES)
            .ok_or_else(|| io::Error::other("too many triangles"))?;
        let first = (self.next, unit, GATES + gate as u32);
        let nodes = part.nodes::<N>(first)?;
        self.next += nodes.len() as u32;
        self.nodes.push(nodes);
        let range = UNIT * unit as usize..UNIT * self.units as usize;
        part.leaves(&mut self.words[range]);
        // Build what is beyond the gates
        let Part { group, levels, beyond, .. } = part;
        let Group { vertices, region, .. } = group;
        let back = Gate { region, node: None };
        self.gates.resize(gate + 2 * beyond.len(), back);
        for (number, corners) in beyond.into_iter().enumerate() {
            let region = self::region(vertices, &corners);
            let node = Some(self.next);
            self.gates[gate + 2 * number] = Gate { region, node };
            let group = Group { vertices, corners, region };
            let most = (self.ways - self.gates.len()) / 2;
            self.add(Part::new::<N>(group, self.quality, levels, most)?)?;
        }
        Ok(())
    }
}

/// A group with its tree, ready to become nodes and leaves.
struct Part<'a> {
    group: Group<'a>,
    tree: Vec<Bvh2Node>,
    plan: Plan,
    /// The number of nodes on the longest way to its leaves, with those
    /// above.
    levels: usize,
    /// The triangles beyond each gate.
    beyond: Vec<Vec<Corners>>,
}

impl<'a> Part<'a> {
    /// Builds the tree over a group of triangles, with so many levels above
    /// and up to `most` gates.
    fn new<const N: usize>(
        group: Group<'a>,
        quality: Quality,
        above: usize,
        most: usize,
    ) -> io::Result<Self> {
        let mut tree = binary(&group, quality);
        let beyond = cut_off(&group, &mut tree, most);
        // Plan for the size of the stack
        let mut plan = Plan::new::<N>(&tree);
        if !plan.fits::<N>(above) {
            tree = balance(&tree);
            plan = Plan::new::<N>(&tree);
        }
        if !plan.fits::<N>(above) {
            return Err(io::Error::other("clusters are nested too deeply"));
        }
        let levels = above + plan.levels;
        Ok(Self { group, tree, plan, levels, beyond })
    }

    /// The nodes, given the numbers of the first node, unit and gate.
    fn nodes<const N: usize>(
        &self,
        first: (u32, u32, u32),
    ) -> io::Result<Vec<Node<N>>> {
        let pairs = self.plan.nodes.par_windows(2);
        let mut nodes = reserved(pairs.len())?;
        let node =
            |pair: &[Planned]| self.node([&pair[0], &pair[1]], first);
        pairs.map(node).collect_into_vec(&mut nodes);
        Ok(nodes)
    }

    /// The node `this`; `next` follows it.
    fn node<const N: usize>(
        &self,
        [this, next]: [&Planned; 2],
        first: (u32, u32, u32),
    ) -> Node<N> {
        // Count off the children of this node
        let Plan { nodes, leaves, .. } = &self.plan;
        let (node, unit, gate) = first;
        let nodes = (this.first_node..next.first_node)
            .map(|number| (nodes[number as usize].root, node + number));
        let range = this.first_leaf as usize..next.first_leaf as usize;
        let leaves = leaves[range].iter().map(|&(root, own)| {
            let child = match self::gate(&self.tree[root as usize]) {
                Some(own) => leaf(gate + 2 * own, 1),
                None => {
                    let numbers = &mut [0; LANES];
                    leaf(unit + own, gather(&self.tree, root, numbers, 0))
                }
            };
            (root, child)
        });
        let mut node = Node::EMPTY;
        for (lane, (root, child)) in nodes.chain(leaves).enumerate() {
            node.set(lane, self.tree[root as usize].aabb(), child);
        }
        node.sort();
        node
    }

    /// Writes the leaves, without the gates.
    fn leaves(&self, words: &mut [u32]) {
        let mut rest = words;
        let leaves = &self.plan.leaves;
        // Cut off a room for each stretch of leaves
        let starts = (0..leaves.len() - 1).step_by(STRETCH);
        let stretches = starts.map(|start| {
            let end = (start + STRETCH).min(leaves.len() - 1);
            let length = UNIT * (leaves[end].1 - leaves[start].1) as usize;
            let (own, others) = mem::take(&mut rest).split_at_mut(length);
            rest = others;
            (&leaves[start..=end], own)
        });
        let stretches: Vec<_> = stretches.collect();
        stretches.into_par_iter().for_each(|(leaves, words)| {
            for pair in leaves.windows(2) {
                let [(root, first), (_, end)] = [pair[0], pair[1]];
                let [first, end] = [first, end]
                    .map(|unit| UNIT * (unit - leaves[0].1) as usize);
                if first < end {
                    self.write(root, &mut words[first..end]);
                }
            }
        });
    }

    /// Writes the triangles of a leaf, in an order that does not depend on
    /// the tree.
    fn write(&self, root: u32, words: &mut [u32]) {
        let mut numbers = [0; LANES];
        let count = gather(&self.tree, root, &mut numbers, 0);
        let corners = &self.group.corners;
        let mut own = [(0, [DVec3::ZERO; 3]); LANES];
        for (own, &i) in own.iter_mut().zip(&numbers[..count]) {
            *own = (corners[i as usize].1, self.group.triangle(i));
        }
        own[..count].sort_unstable_by_key(|(face, corners)| {
            (*face, corners.map(|p| p.to_array().map(f64::to_bits)))
        });
        write(words, &own[..count]);
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

impl<const N: usize> Wide<N> {
    /// Whether `asked` is true of a triangle, given its leaf, lane and
    /// slot, and its corners. Looks only into boxes that meet the one
    /// between two corners, and of which `enters` is true, given theirs.
    pub fn any(
        &self,
        within: [DVec3; 2],
        enters: &impl Fn(DVec3, DVec3) -> bool,
        asked: &impl Fn(&Leaf, (usize, u32), &[DVec3; 3]) -> bool,
    ) -> bool {
        self.any_below((0, self.region), within, enters, asked)
    }

    fn any_below(
        &self,
        (child, region): (u32, Region),
        within: [DVec3; 2],
        enters: &impl Fn(DVec3, DVec3) -> bool,
        asked: &impl Fn(&Leaf, (usize, u32), &[DVec3; 3]) -> bool,
    ) -> bool {
        if child & LEAF != 0 {
            // Ask about each triangle of the leaf
            let (first, count) = slots(child);
            if first >= GATES {
                // Go on beyond the gate
                let gate = (first - GATES) as usize;
                let Gate { region, node } = self.gates[gate];
                return node.is_some_and(|root| {
                    self.any_below((root, region), within, enters, asked)
                });
            }
            // SAFETY: leaves that are no gates are leaves that are there.
            let leaf = unsafe { self.leaves.leaf(first, count) };
            return (0..count as u32).any(|lane| {
                let place = (lane as usize, slot(first, lane));
                asked(&leaf, place, &leaf.triangle(lane))
            });
        }
        let nodes: &[Node<N>] = &self.nodes;
        let node = &nodes[child as usize];
        let finite = |v: Vec3| v.clamp(Vec3::MIN, Vec3::MAX);
        let [low, high] =
            within.map(|corner| finite((corner - region.zero).as_vec3()));
        let meets = node.meets(low, high);
        (0..N).filter(|&lane| meets[lane]).any(|lane| {
            let (low, high) = node.bounds(lane);
            let below = (node.children[lane], region);
            enters(low + region.zero, high + region.zero)
                && self.any_below(below, within, enters, asked)
        })
    }

    /// All triangles, each with its slot.
    pub fn triangles(&self) -> impl Iterator<Item = (u32, Triangle)> {
        let children = self.nodes.iter().flat_map(|node| node.children);
        let leaves = children.filter(|child| child & LEAF != 0).map(slots);
        let leaves = leaves.filter(|leaf| leaf.0 < GATES);
        leaves.flat_map(|(first, count)| {
            // SAFETY: leaves that are no gates are leaves that are there.
            let leaf = unsafe { self.leaves.leaf(first, count) };
            (0..count as u32)
                .map(move |lane| (slot(first, lane), leaf.triangle(lane)))
        })
    }
}

#[cfg(test)]
#[path = "../../tests/units/wide.rs"]
mod tests;
