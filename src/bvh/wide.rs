// Tangled from chapters/wide.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the triangles of a scene to a tree with many children a node.
//!
//! Boxes are in single precision, counted from the middle of a region,
//! and padded. Node 0 is the root. Every other node and every leaf is
//! the child of exactly one node, or the root of one nested
//! frame.

use std::{fmt, io, iter, mem};

use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, DEFAULT_MAX_STACK_DEPTH};
use obvhs::ploc::morton::morton_encode_u64_unorm;
use rayon::prelude::*;

use super::triangle::{
    FRAMES, LANES, LEAF, UNIT, leaf, slot, slots, units,
};
use super::triangle::{Leaf, Leaves, NestedFrame, Region, write};
use crate::memory::reserved;
use crate::numerics::bounds;
use crate::scene::{Triangle, Triangles};

/// How much work to put into a hierarchy: the part of the nodes that is
/// improved, from `FAST` to `THOROUGH`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality(f32);

/// From so many rays per triangle on, all nodes are improved.
const REPAID: f64 = 1000.;

impl Quality {
    /// For a few rays.
    pub const FAST: Self = Self(0.02);
    /// For more rays per triangle than `REPAID`.
    pub const THOROUGH: Self = Self(1.);

    /// The quality for which building a hierarchy of `triangles`
    /// triangles and following `rays` rays through it takes the
    /// shortest time together.
    pub fn expecting(triangles: usize, rays: f64) -> Self {
        let part = rays / (REPAID * triangles.max(1) as f64);
        Self((part as f32).clamp(Self::FAST.0, Self::THOROUGH.0))
    }
}

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "quality {:.2}", self.0)
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
}

impl<const N: usize> Node<N> {
    /// No children at all.
    pub const EMPTY: Self = {
        let (above, below) = (f32::INFINITY, f32::NEG_INFINITY);
        let (least, greatest) = ([above; N], [below; N]);
        Self {
            planes: [least, least, least, greatest, greatest, greatest],
            children: [0; N],
        }
    };

    fn set(&mut self, lane: usize, bounds: &Aabb, child: u32) {
        for axis in 0..3 {
            self.planes[axis][lane] = bounds.min[axis];
            self.planes[axis + 3][lane] = bounds.max[axis];
        }
        self.children[lane] = child;
    }

    /// The box in a lane.
    fn bounds(&self, lane: usize) -> Aabb {
        let [a, b, c, d, e, f] = self.planes.map(|row| row[lane]);
        Aabb::new(Vec3A::new(a, b, c), Vec3A::new(d, e, f))
    }
}

const _: () = assert!(size_of::<Node<8>>() == 256);
const _: () = assert!(size_of::<Node<16>>() == 448);

/// The corners of a triangle, as numbers of vertices, and its face.
type Corners = ([u32; 3], u32);

/// Some triangles of a scene, and the region around them.
struct Group<'a> {
    vertices: &'a [DVec3],
    corners: &'a [Corners],
    region: Region,
}

/// The region of triangles.
fn region(vertices: &[DVec3], corners: &[Corners]) -> Region {
    let points = corners.iter().flat_map(|(three, _)| three);
    let (low, high) = bounds(points.map(|&k| vertices[k as usize]));
    match low.x > high.x {
        true => Region::between(DVec3::ZERO, DVec3::ZERO),
        false => Region::between(low, high),
    }
}

/// By how much the boxes of a region are enlarged on all sides: 2^-20 of
/// its reach.
const PADDING: f64 = 1. / (1 << 20) as f64;

/// More of it, as a part of the coordinates of its middle: 2^-48.
const FAR_PADDING: f64 = 1. / (1u64 << 48) as f64;

/// More of it: 2^-120, since single precision is coarse where it ends.
const LEAST_PADDING: f64 = 1. / (1u128 << 120) as f64;

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
        let padding = PADDING * reach + FAR_PADDING * far + LEAST_PADDING;
        let padding = Vec3A::splat(padding as f32);
        let low = a.min(b).min(c) - padding;
        let high = a.max(b).max(c) + padding;
        Bvh2Node::new(Aabb::new(low, high), 1, i)
    }
}

/// A binary tree over the triangles, one in each leaf. Node 0 is the
/// root; the second child of a node follows its first.
fn binary(group: &Group, quality: Quality) -> Vec<Bvh2Node> {
    // Create a leaf per triangle
    let count = group.corners.len();
    let order = in_morton_order(group);
    let mut nodes = vec![Bvh2Node::default(); 2 * count - count.min(1)];
    let places = nodes[..count].par_iter_mut().zip(order);
    places.for_each(|(place, i)| {
        *place = group.single(i);
    });
    let mut tree = join(nodes, 6, 2);
    // Improve the binary tree
    let part = (MOST_BOXES / expected_boxes(&tree.nodes)).min(1.);
    if tree.max_depth <= DEFAULT_MAX_STACK_DEPTH {
        let mut optimizer = ReinsertionOptimizer::default();
        optimizer.run(&mut tree, quality.0 * part, None);
    }
    tree.nodes
}

/// The numbers of the triangles, in the order of the middles of their
/// boxes along Morton's curve.
fn in_morton_order(group: &Group) -> Vec<u32> {
    let leaf = |i: u32| group.single(i);
    let numbers = (0..group.corners.len() as u32).into_par_iter();
    let boxes = numbers.clone().map(|i| *leaf(i).aabb());
    let extent = boxes.reduce(Aabb::empty, |a, b| a.union(&b));
    let (low, size) = (extent.min.as_dvec3(), extent.diagonal().as_dvec3());
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
    // Return the binary tree
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
/// union has the least area; itself if there is none.
fn choose(clusters: &[Bvh2Node], reach: usize, partners: &mut [u32]) {
    let stretch = clusters.len().div_ceil(64).max(1024);
    let stretches = partners.par_chunks_mut(stretch).enumerate();
    stretches.for_each(|(k, partners)| {
        let start = k * stretch;
        let end = start + partners.len();
        let numbers = start as u32..end as u32;
        partners.iter_mut().zip(numbers).for_each(|(place, i)| *place = i);
        let mut best = vec![f32::INFINITY; partners.len()];
        // Compare each cluster with those after it
        for i in start.saturating_sub(reach)..end {
            let last = (i + reach).min(clusters.len() - 1);
            for j in i + 1..=last {
                // Offer two clusters to each other
                let union = clusters[i].aabb().union(clusters[j].aabb());
                let area = union.half_area();
                for (cluster, other) in [(i, j), (j, i)] {
                    let place = cluster.wrapping_sub(start);
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
    let area = |node: &Bvh2Node| node.aabb().half_area();
    let sum: f32 = nodes.iter().map(area).sum();
    sum / nodes.first().map_or(1., area)
}

/// From so many boxes on that a ray meets, less of a tree is improved.
const MOST_BOXES: f32 = 200.;

/// A tree of least depth over the same leaves in the same order.
fn balance(tree: &[Bvh2Node]) -> Vec<Bvh2Node> {
    let mut nodes: Vec<_> = leaves(tree, 0).collect();
    nodes.resize(2 * nodes.len() - 1, Bvh2Node::default());
    join(nodes, 0, 0).nodes
}

/// The least costs of a subtree, as a wide tree or several.
struct Forest<const N: usize> {
    /// C(i, k) at k - 1.
    costs: [f32; N],
    /// How many trees it can be at most: min(n, N).
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
        // Try forests of two trees and more
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
        // Limit the cost of more trees
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

/// The choices for one node of the binary tree, that for k in the four
/// bits from bit 4(k - 1) on.
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
        // Cut one node after its children
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

/// Cuts up to `most` subtrees off that are small beside the region;
/// returns their triangles.
fn cut_off(
    group: &Group,
    tree: &mut [Bvh2Node],
    most: usize,
) -> Vec<Vec<Corners>> {
    let side = 2. * group.region.reach as f32;
    let extent = |node: &Bvh2Node| node.aabb().diagonal().max_element();
    let mut groups = vec![];
    let mut todo = Vec::from_iter((!tree.is_empty()).then_some(0));
    while let Some(i) = todo.pop() {
        let node = tree[i as usize];
        if node.is_leaf() || groups.len() == most {
            continue;
        }
        // Replace a small subtree by a nested frame
        let small = |leaf: Bvh2Node| extent(&leaf) < SMALL * side;
        if extent(&node) >= COMPACT * side || !leaves(tree, i).all(small) {
            todo.extend([node.first_index + 1, node.first_index]);
            continue;
        }
        let below = leaves(tree, i).map(|leaf| leaf.first_index as usize);
        let below: Vec<_> = below.map(|i| group.corners[i]).collect();
        if below.len() > FEW {
            let number = CUT + groups.len() as u32;
            tree[i as usize] = Bvh2Node::new(*node.aabb(), 1, number);
            groups.push(below);
        }
    }
    groups
}

/// Ways in and out of nested frames that there can be.
const WAYS: usize = (1 << 29) - FRAMES as usize;

/// A tree with up to `N` children a node and four triangles a leaf.
pub struct Wide<const N: usize> {
    /// Node 0 is the root. The numbers in `children` are valid.
    pub nodes: Vec<Node<N>>,
    /// The triangles.
    pub leaves: Leaves,
    /// Each with the way back after it.
    pub frames: Vec<NestedFrame>,
    /// That of all triangles.
    pub region: Region,
}

impl<const N: usize> Wide<N> {
    /// No nodes, with room for those of so many triangles.
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
            // Write the node above the forest below a root
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
        let beyond = cut_off(group, &mut tree, ways / 2);
        let (mut wide, mut levels) = Self::fill(group, &tree)?;
        // Balance the tree if it does not fit the stack
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
        // Build the nested frames
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

    /// Adds the nodes, leaves and nested frames of another tree; the number of
    /// its root.
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
        // Shift the numbers of another tree
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
        // Divide the scene, unless its parts overlap
        let parts = N.pow(above as u32);
        let mut groups = halve(&vertices, &mut corners, parts);
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
            // Build some parts
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

/// The leaves below node `i` from left to right.
fn leaves(tree: &[Bvh2Node], i: u32) -> impl Iterator<Item = Bvh2Node> {
    let mut todo = vec![i];
    iter::from_fn(move || {
        let mut node = tree[todo.pop()? as usize];
        while !node.is_leaf() {
            todo.push(node.first_index + 1);
            node = tree[node.first_index as usize];
        }
        Some(node)
    })
}

/// Children that the stack of a traversal holds.
pub const STACK: usize = 1024;
/// Scenes with more triangles are built in parts,
const LARGE: usize = 1 << 17;

/// unless a ray that meets the scene is expected to meet more of them.
const MOST_MET: f64 = 3.;

/// Parts have so many triangles at most.
const PART: usize = 1 << 20;

/// Whether the parts of a scene overlap so little that it is built in them.
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

/// Sorts triangles into `parts` groups of neighbours, a power of two.
fn halve<'a>(
    vertices: &[DVec3],
    corners: &'a mut [Corners],
    parts: usize,
) -> Vec<&'a mut [Corners]> {
    let place = |(three, _): &Corners| vertices[three[0] as usize];
    let mut groups = vec![corners];
    while groups.len() < parts {
        let halves = groups.into_par_iter().flat_map_iter(|corners| {
            // Part the triangles at their median
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
    groups
}

impl<const N: usize> Wide<N> {
    /// Whether `asked` is true of a triangle below a child, given its leaf,
    /// lane and slot, and its corners. Looks only into boxes that meet the
    /// one between two corners, and of which `enters` is true, given theirs.
    /// Below the child 0, in the region of the whole, are all triangles.
    pub fn any(
        &self,
        (child, region): (u32, Region),
        within: [DVec3; 2],
        enters: &impl Fn(DVec3, DVec3) -> bool,
        asked: &impl Fn(&Leaf, (usize, u32), &[DVec3; 3]) -> bool,
    ) -> bool {
        if child & LEAF != 0 {
            // Test each triangle of the leaf
            let (first, count) = slots(child);
            if first >= FRAMES {
                // Search the nested frame
                let frame = (first - FRAMES) as usize;
                let NestedFrame { region, node } = self.frames[frame];
                return node.is_some_and(|root| {
                    self.any((root, region), within, enters, asked)
                });
            }
            // SAFETY: leaves that are no nested frames are leaves that are there.
            let leaf = unsafe { self.leaves.leaf(first, count) };
            return (0..count as u32).any(|lane| {
                let place = (lane as usize, slot(first, lane));
                asked(&leaf, place, &leaf.triangle(lane))
            });
        }
        let node = &self.nodes[child as usize];
        let finite = |v: Vec3| v.clamp(Vec3::MIN, Vec3::MAX);
        let [low, high] =
            within.map(|corner| finite((corner - region.zero).as_vec3()));
        let within_box = Aabb::new(low.into(), high.into());
        (0..N).any(|lane| {
            let bounds = node.bounds(lane);
            let Aabb { min, max } = bounds;
            let below = (node.children[lane], region);
            let [low, high] =
                [min, max].map(|v| v.as_dvec3() + region.zero);
            bounds.intersect_aabb(&within_box)
                && enters(low, high)
                && self.any(below, within, enters, asked)
        })
    }
}

#[cfg(test)]
#[path = "../../tests/units/wide.rs"]
mod tests;
