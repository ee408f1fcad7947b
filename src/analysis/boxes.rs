// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! A binary tree of boxes over triangles, to ask for more than rays.
//!
//! Boxes are exact, and the tree is the same on every processor.

use std::collections::BinaryHeap;

use glam::{DVec3, Vec3};

use crate::bvh::in_morton_order;
use crate::scene::Triangle;

// Hold a box with exact planes
/// A box, given by two opposite corners; empty if `low > high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub low: Vec3,
    pub high: Vec3,
}

impl Bounds {
    pub const EMPTY: Self =
        Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    // Enclose a triangle or two boxes
    /// The box of a triangle.
    pub fn of(&[a, b, c]: &Triangle) -> Self {
        Self { low: a.min(b).min(c), high: a.max(b).max(c) }
    }

    /// The least box that holds two others.
    pub fn union(self, other: Self) -> Self {
        let low = self.low.min(other.low);
        Self { low, high: self.high.max(other.high) }
    }

    /// Whether two boxes have a point in common.
    pub fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    /// Its corners, in double precision.
    pub fn doubles(&self) -> (DVec3, DVec3) {
        (self.low.as_dvec3(), self.high.as_dvec3())
    }
}

// Build a balanced tree of boxes
/// Boxes around triangles, in a tree.
pub struct Boxes {
    /// The numbers of the triangles, in Morton order.
    order: Vec<u32>,
    nodes: Vec<Bounds>,
}

/// Triangles in a leaf.
const GROUP: usize = 4;

impl Boxes {
    pub fn new(triangles: &[Triangle]) -> Self {
        let order = in_morton_order(triangles);
        let leaves = order.len().div_ceil(GROUP);
        let mut nodes = vec![Bounds::EMPTY; (2 * leaves).saturating_sub(1)];
        fill(triangles, &order, &mut nodes);
        Self { order, nodes }
    }

    // Search a tree of boxes
    /// Goes through the tree until the search is over; what the boxes that
    /// were not opened then promise at most.
    pub fn search(&self, search: &mut impl Search) -> Option<f64> {
        let mut waiting = BinaryHeap::with_capacity(64);
        waiting.extend(self.wait(search, 0, 0, self.order.len()));
        while let Some((_, node, start, end)) = waiting.pop() {
            if search.promise(&self.nodes[node]).is_none() {
                continue;
            }
            let count = end - start;
            if count > GROUP {
                // Let both children of a node wait
                let cut = start + middle(count);
                let right = node + 1 + size(cut - start);
                waiting.extend(self.wait(search, node + 1, start, cut));
                waiting.extend(self.wait(search, right, cut, end));
            } else if !search.look(&self.order[start..end]) {
                let next: Option<Waiting> = waiting.pop();
                return next.map(|next| f64::from_bits(next.0));
            }
        }
        None
    }

    /// A node as it waits, if it promises something.
    fn wait(
        &self,
        search: &impl Search,
        node: usize,
        start: usize,
        end: usize,
    ) -> Option<Waiting> {
        let promise = search.promise(self.nodes.get(node)?)?;
        Some((promise.to_bits(), node, start, end))
    }
}

/// Fills the nodes over the triangles `order`; the box of the first.
fn fill(
    triangles: &[Triangle],
    order: &[u32],
    nodes: &mut [Bounds],
) -> Bounds {
    let Some((root, below)) = nodes.split_first_mut() else {
        return Bounds::EMPTY;
    };
    *root = if below.is_empty() {
        let boxes =
            order.iter().map(|&i| Bounds::of(&triangles[i as usize]));
        boxes.fold(Bounds::EMPTY, Bounds::union)
    } else {
        // Fill both children at once
        let (first, second) = order.split_at(middle(order.len()));
        let (left, right) = below.split_at_mut(size(first.len()));
        let (left, right) = rayon::join(
            || fill(triangles, first, left),
            || fill(triangles, second, right),
        );
        left.union(right)
    };
    *root
}

/// How many of `count` triangles belong to the first child: whole leaves.
fn middle(count: usize) -> usize {
    count.div_ceil(GROUP).div_ceil(2) * GROUP
}

/// The number of nodes over `count` triangles.
fn size(count: usize) -> usize {
    2 * count.div_ceil(GROUP) - 1
}

// Search the tree from the most promising box
/// A search among triangles.
pub trait Search {
    /// What may be found in a box, zero or more; none if it need not be
    /// opened.
    fn promise(&self, bounds: &Bounds) -> Option<f64>;

    /// Looks at the triangles of a leaf; false if the search is over.
    fn look(&mut self, numbers: &[u32]) -> bool;
}

/// A node that waits: the bits of its promise, its number, and where its
/// triangles begin and end.
type Waiting = (u64, usize, usize, usize);
