// Tangled from chapters/wide.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A tree with many children a node.
//!
//! Boxes are in single precision, counted from the middle of a region,
//! and padded. Node 0 is the root. Every other node and every leaf is
//! the child of exactly one node, or the root of one nested
//! frame.

use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;

use super::triangle::{FRAMES, LEAF, slot, slots};
use super::triangle::{Leaf, Leaves, NestedFrame, Region};

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

    /// Stores a child and its box in a lane.
    pub fn set(&mut self, lane: usize, bounds: &Aabb, child: u32) {
        for axis in 0..3 {
            self.planes[axis][lane] = bounds.min[axis];
            self.planes[axis + 3][lane] = bounds.max[axis];
        }
        self.children[lane] = child;
    }

    /// The box in a lane.
    pub fn bounds(&self, lane: usize) -> Aabb {
        let [a, b, c, d, e, f] = self.planes.map(|row| row[lane]);
        Aabb::new(Vec3A::new(a, b, c), Vec3A::new(d, e, f))
    }
}

const _: () = assert!(size_of::<Node<8>>() == 256);
const _: () = assert!(size_of::<Node<16>>() == 448);

/// A tree with up to `N` children a node and four triangles a leaf.
pub struct Wide<const N: usize> {
    /// Node 0 is the root. The numbers in `children` are valid.
    pub nodes: Vec<Node<N>>,
    /// The triangles.
    pub leaves: Leaves,
    /// The nested frames, each with the way back after it.
    pub frames: Vec<NestedFrame>,
    /// The region of all triangles.
    pub region: Region,
}

/// Children that the stack of a traversal holds.
pub const STACK: usize = 1024;

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
        asked: &mut impl FnMut(&Leaf, (usize, u32), &[DVec3; 3]) -> bool,
    ) -> bool {
        if child & LEAF != 0 {
            // Test each triangle of the leaf
            let (first, count) = slots(child);
            if first >= FRAMES {
                let frame = (first - FRAMES) as usize;
                let NestedFrame { region, node } = self.frames[frame];
                return node.is_some_and(|root| {
                    self.any((root, region), within, enters, asked)
                });
            }
            // SAFETY: a leaf that is no nested frame is there.
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
