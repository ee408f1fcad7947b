// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Records what one traversal sees, for the figures of the book.

use std::{array, io};

use glam::Vec3;

use super::intersector::Hit;
use super::spawn::hit;
use super::traversal::{
    Kernel, Portable, RaySearch, Slabs, Stack, Waiting, distance, enter,
};
use super::triangle::{
    GATES, LANES, LEAF, NONE, Shear, UNIT, slots, units,
};
use super::wide::{Node, Quality, Wide};
use crate::scene::{Ray, Scene};

/// A hierarchy whose traversals are recorded, with sixteen children.
pub struct Anatomy(Wide<16>);

/// A look at one node or leaf.
pub struct Step {
    child: u32,
    /// A bit for each child entered, or each triangle met.
    pub mask: u32,
    /// How many children wait afterwards.
    pub waiting: usize,
    /// The end of the ray afterwards.
    pub t_max: f64,
}

impl Step {
    /// Whether it is a leaf, and its number: of the node, or of the
    /// leaf's first slot.
    pub fn leaf(&self) -> (bool, u32) {
        match self.child & LEAF {
            0 => (false, self.child),
            _ => (true, slots(self.child).0),
        }
    }

    /// How many bytes it reads.
    pub fn bytes(&self) -> usize {
        match self.child & LEAF {
            0 => size_of::<Node<16>>(),
            _ => 4 * UNIT * units(slots(self.child).1) as usize,
        }
    }
}

impl Anatomy {
    /// Builds the hierarchy of a scene.
    ///
    /// # Errors
    /// Too little memory.
    pub fn new(scene: &Scene, quality: Quality) -> io::Result<Self> {
        Wide::new(scene.triangles.clone(), quality, &|_| ()).map(Self)
    }

    /// What a ray that left a triangle looks at, in this order; and its
    /// hit.
    pub fn walk(
        &self,
        ray: &Ray,
        from: Option<u32>,
    ) -> (Vec<Step>, Option<Hit>) {
        let Self(wide) = self;
        // Walk and note each step
        let mut slabs = Slabs::new(ray, &wide.region);
        let mut search = RaySearch::new(wide, ray, (from, NONE));
        let (mut waiting, mut steps) = (Waiting::new(), vec![]);
        let mut stack = Stack::new(&mut waiting);
        let mut next = Some(0);
        while let Some(child) = next {
            let (first, count) = slots(child);
            if child & LEAF != 0 && first >= GATES {
                // Go through a gate without a step
                let way = wide.gates[(first - GATES) as usize];
                slabs = Slabs::new(ray, &way.region);
                search.go_to(&way.region);
                if way.node.is_some() {
                    // SAFETY: no hierarchy is so deep that one is not left.
                    unsafe { stack.push(child + 1, 0.) };
                }
                next = way.node.or_else(|| stack.pop(search.t_max()));
                continue;
            }
            // Look at one child and choose the next
            let (mask, nearest) = if child & LEAF == 0 {
                let node = &wide.nodes[child as usize];
                let met = enter(node, &slabs, search.t_max(), distance);
                let any = met.mask != 0;
                // SAFETY: no hierarchy is so deep that less than 16 are left.
                let push = || unsafe {
                    Portable::push(node, slabs.shift, &met, &mut stack)
                };
                (met.mask, any.then(push))
            } else {
                // SAFETY: children with the bit LEAF are leaves that are there.
                let met = unsafe {
                    search.look::<Portable, 16, false>((first, count))
                };
                (met.unwrap_or(0) & ((1 << LANES) - 1), None)
            };
            next = nearest.or_else(|| stack.pop(search.t_max()));
            let (waiting, t_max) = (stack.length(), search.search.distance);
            steps.push(Step { child, mask, waiting, t_max });
        }
        (steps, hit(wide, ray, from, &search.search))
    }

    /// The boxes of the root's children, near to far, and whether a ray
    /// enters them.
    pub fn root(&self, ray: &Ray) -> Vec<(bool, [Vec3; 2])> {
        let (node, region) = (&self.0.nodes[0], &self.0.region);
        let slabs = Slabs::new(ray, region);
        let mask = enter(node, &slabs, f32::INFINITY, distance).mask;
        let shift = slabs.shift;
        let near = node.order.iter().rev();
        let slots = near.map(|order| (order >> shift & 15) as usize);
        let slots = slots.filter(|&slot| node.planes[0][slot].is_finite());
        let corner = |first: usize, slot: usize| {
            let plane = |k: usize| node.planes[first + k][slot];
            Vec3::from_array(array::from_fn(plane)) + region.zero.as_vec3()
        };
        let child = |slot| [corner(0, slot), corner(3, slot)];
        slots.map(|slot| (mask >> slot & 1 != 0, child(slot))).collect()
    }

    /// The triangles of a full leaf of which a ray meets one, if its steps
    /// have such a leaf: $x$ and $y$ of their corners, sheared.
    pub fn leaf(
        &self,
        ray: &Ray,
        steps: &[Step],
    ) -> Option<[[[f64; 2]; 3]; LANES]> {
        let met = steps.iter().filter(|s| s.mask != 0);
        let mut leaves =
            met.filter(|s| s.child & LEAF != 0).map(|s| slots(s.child));
        let (first, count) = leaves.find(|leaf| leaf.1 == LANES)?;
        // SAFETY: children with the bit LEAF are leaves that are there.
        let leaf = unsafe { self.0.leaves.leaf(first, count) };
        let shear = Shear::new(ray);
        Some(array::from_fn(|lane| {
            let [x, y, _] = leaf.sheared(lane, &shear);
            array::from_fn(|c| [x[c], y[c]])
        }))
    }
}
