// Tangled from chapters/wide.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the triangles of a scene to a binary tree.

use std::{fmt, iter};

use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, DEFAULT_MAX_STACK_DEPTH};
use obvhs::ploc::morton::morton_encode_u64_unorm;
use rayon::prelude::*;

use super::triangle::Region;
use crate::numerics::bounds;
use crate::scene::Triangle;

/// How much work to put into a hierarchy: the part of the nodes that is
/// improved, from `FAST` to `THOROUGH`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality(f32);

/// With so many rays per triangle or more, all nodes are improved.
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

/// The corners of a triangle, as numbers of vertices, and its face.
pub type Corners = ([u32; 3], u32);

/// Some triangles of a scene, and the region around them.
pub struct Group<'a> {
    /// The vertices of the scene.
    pub vertices: &'a [DVec3],
    /// The triangles.
    pub corners: &'a [Corners],
    /// A region that holds them.
    pub region: Region,
}

/// The region of triangles.
pub fn region(vertices: &[DVec3], corners: &[Corners]) -> Region {
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

/// More padding, as a part of the coordinates of its middle: 2^-48.
const FAR_PADDING: f64 = 1. / (1u64 << 48) as f64;

/// More padding: 2^-120, since single precision is coarse where it ends.
const LEAST_PADDING: f64 = 1. / (1u128 << 120) as f64;

impl Group<'_> {
    /// The corners of a triangle.
    pub fn triangle(&self, i: u32) -> Triangle {
        self.corners[i as usize].0.map(|k| self.vertices[k as usize])
    }

    /// The leaf of a triangle, with its enlarged box.
    pub fn single(&self, i: u32) -> Bvh2Node {
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
pub fn binary(group: &Group, quality: Quality) -> Vec<Bvh2Node> {
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
        let before = count;
        let reach = if depth <= early { 1 } else { reach };
        choose(&nodes[..count], reach, &mut partners[..count]);
        count = merge(&mut nodes, count, &partners);
        depth += 1;
        if (before - count) * SLOW < before {
            let last = count as u32 - 1;
            let neighbours = (0..=last).map(|i| (i ^ 1).min(last));
            partners.splice(..=last as usize, neighbours);
            count = merge(&mut nodes, count, &partners);
            depth += 1;
        }
    }
    Bvh2 {
        nodes,
        max_depth: depth.max(DEFAULT_MAX_STACK_DEPTH),
        children_are_ordered_after_parents: true,
        ..Bvh2::default()
    }
}

/// A round is slow if fewer than one cluster in so many disappears.
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

/// For each cluster the one, up to `reach` places away, with which its
/// union has the least area; the cluster itself if there is none.
fn choose(clusters: &[Bvh2Node], reach: usize, partners: &mut [u32]) {
    let stretch = clusters.len().div_ceil(64).max(1024);
    let stretches = partners.par_chunks_mut(stretch).enumerate();
    stretches.for_each(|(k, partners)| {
        let start = k * stretch;
        let end = start + partners.len();
        let numbers = start as u32..end as u32;
        partners.iter_mut().zip(numbers).for_each(|(place, i)| *place = i);
        let mut best = vec![f32::INFINITY; partners.len()];
        for i in start.saturating_sub(reach)..end {
            let last = (i + reach).min(clusters.len() - 1);
            for j in i + 1..=last {
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

/// The expected number of boxes that a ray meets if it meets the root: the
/// sum of the surface area heuristic.
fn expected_boxes(nodes: &[Bvh2Node]) -> f32 {
    let area = |node: &Bvh2Node| node.aabb().half_area();
    let sum: f32 = nodes.iter().map(area).sum();
    sum / nodes.first().map_or(1., area)
}

/// If a ray meets more boxes than this, less of a tree is improved.
const MOST_BOXES: f32 = 200.;

/// The leaves below node `i` from left to right.
pub fn leaves(tree: &[Bvh2Node], i: u32) -> impl Iterator<Item = Bvh2Node> {
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

/// A tree of least depth over the same leaves in the same order.
pub fn balance(tree: &[Bvh2Node]) -> Vec<Bvh2Node> {
    let mut nodes: Vec<_> = leaves(tree, 0).collect();
    nodes.resize(2 * nodes.len() - 1, Bvh2Node::default());
    join(nodes, 0, 0).nodes
}
