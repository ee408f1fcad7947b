// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The walk through a wide hierarchy, and its portable form.

use std::mem::MaybeUninit;

use super::triangle::{LANES, Leaf, NONE, Search, Shear};
use super::wide::{LEAF, Node, Wide, slots};
use super::{Hit, Kernel};
use crate::scene::Ray;

/// A ray in single precision, prepared for planes.
pub struct Slabs {
    /// 1/d
    pub inverse: [f32; 3],
    /// o/d
    pub start: [f32; 3],
    /// Planes which the ray enters by
    pub enter: [usize; 3],
    pub leave: [usize; 3],
    /// 4 * octant
    pub shift: u32,
}

impl Slabs {
    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let d = ray.direction.as_vec3().to_array();
        let o = ray.origin.as_vec3().to_array();
        let inverse = d.map(|d| 1. / flat(d));
        let start = std::array::from_fn(|i| o[i] * inverse[i]);
        let up = d.map(|d| usize::from(d >= 0.));
        let enter = std::array::from_fn(|i| i + 3 * (1 - up[i]));
        let leave = std::array::from_fn(|i| i + 3 * up[i]);
        let shift = 4 * (up[0] | up[1] << 1 | up[2] << 2) as u32;
        Self { inverse, start, enter, leave, shift }
    }
}

const FLAT: f32 = f32::from_bits((127 - 60) << 23);

#[inline(always)]
fn flat(d: f32) -> f32 {
    if d.abs() < FLAT { if d < 0. { -FLAT } else { FLAT } } else { d }
}

pub const STACK: usize = 1024;

pub struct Stack {
    pub children: [MaybeUninit<u32>; STACK],
    pub distances: [MaybeUninit<f32>; STACK],
    pub length: usize,
}

impl Stack {
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            children: [const { MaybeUninit::uninit() }; STACK],
            distances: [const { MaybeUninit::uninit() }; STACK],
            length: 0,
        }
    }

    #[inline(always)]
    pub fn push(&mut self, child: u32, distance: f32) {
        unsafe {
            self.children.get_unchecked_mut(self.length).write(child);
            self.distances.get_unchecked_mut(self.length).write(distance);
        }
        self.length += 1;
    }

    /// The last child that begins within reach
    #[inline(always)]
    pub fn pop(&mut self, reach: f32) -> Option<u32> {
        while self.length > 0 {
            self.length -= 1;
            // SAFETY: elements below `length` have been written.
            unsafe {
                let i = self.length;
                if self.distances.get_unchecked(i).assume_init() <= reach {
                    return Some(
                        self.children.get_unchecked(i).assume_init(),
                    );
                }
            }
        }
        None
    }
}

pub struct Entered<V> {
    pub mask: u32,
    pub near: V,
    pub far: V,
}

#[inline(always)]
pub fn walk<'a, const N: usize, const ANY: bool, V: Copy>(
    wide: &'a Wide<N>,
    ray: &Ray,
    from: Option<u32>,
    enter: impl Fn(&Node<N>, &Slabs, f32) -> Entered<V>,
    two: impl Fn(&V, u32) -> (f32, f32),
    push: impl Fn(&Node<N>, u32, &Entered<V>, &mut Stack) -> u32,
    meet: impl Fn(Leaf<'a>, &Shear, f64) -> (u32, [f64; LANES]),
) -> Search<'a>
where
    Node<N>: bytemuck::Pod,
{
    let nodes: &[Node<N>] = &wide.nodes;
    let leaves = &wide.leaves;
    let slabs = Slabs::new(ray);
    let shear = Shear::new(ray);
    let mut search = Search::new(leaves, from);
    let mut reach = f32::INFINITY;
    let mut stack = Stack::new();
    let mut child = 0;
    loop {
        while child & LEAF == 0 {
            // SAFETY:
            let node = unsafe { nodes.get_unchecked(child as usize) };
            let entered = enter(node, &slabs, reach);
            let mask = entered.mask;
            child = match mask.count_ones() {
                0 => match stack.pop(reach) {
                    Some(child) => child,
                    None => return search,
                },
                1 => unsafe {
                    *node
                        .children
                        .get_unchecked(mask.trailing_zeros() as usize)
                },
                2 => {
                    let first = mask.trailing_zeros() as usize;
                    let last = (31 - mask.leading_zeros()) as usize;
                    let (a, b) = two(&entered.near, mask);
                    let (c, d) = unsafe {
                        (
                            *node.children.get_unchecked(first),
                            *node.children.get_unchecked(last),
                        )
                    };
                    let (near, far, distance) =
                        if a <= b { (c, d, b) } else { (d, c, a) };
                    stack.push(far, distance);
                    near
                }
                _ => push(node, slabs.shift, &entered, &mut stack),
            };
        }
        let (first, count) = slots(child);
        let leaf = leaves.leaf(first as usize, count);
        let (mut met, distances) = meet(leaf, &shear, search.distance);
        if met != 0 {
            while met != 0 {
                let lane = met.trailing_zeros();
                let distance = distances[lane as usize & 3];
                search.offer(leaf, first, lane, distance);
                met &= met - 1;
            }
            if search.slot != NONE {
                if ANY {
                    return search;
                }
                // Rounded up; the distance is positive and finite.
                let bits = (search.distance as f32).to_bits();
                reach = f32::from_bits(bits + 1);
            }
        }
        match stack.pop(reach) {
            Some(next) => child = next,
            None => return search,
        }
    }
}

pub struct Walker(pub Wide<8>);

impl Walker {
    pub fn wide(&self) -> &Wide<8> {
        &self.0
    }
}

impl Walker {
    fn search<const ANY: bool>(
        &self,
        ray: &Ray,
        from: Option<u32>,
    ) -> Search<'_> {
        walk::<8, ANY, [f32; 8]>(
            &self.0,
            ray,
            from,
            enter,
            |near, mask| {
                let a = near[mask.trailing_zeros() as usize & 7];
                let b = near[(31 - mask.leading_zeros()) as usize & 7];
                (a, b)
            },
            push,
            |leaf, shear, _| leaf.meet(shear),
        )
    }
}

#[inline(always)]
fn enter(node: &Node<8>, slabs: &Slabs, reach: f32) -> Entered<[f32; 8]> {
    let mut near = [0f32; 8];
    let mut far = [reach; 8];
    for axis in 0..3 {
        let (inverse, start) = (slabs.inverse[axis], slabs.start[axis]);
        let first = &node.planes[slabs.enter[axis]];
        let last = &node.planes[slabs.leave[axis]];
        for i in 0..8 {
            let a = first[i] * inverse - start;
            let b = last[i] * inverse - start;
            near[i] = if a > near[i] { a } else { near[i] };
            far[i] = if b < far[i] { b } else { far[i] };
        }
    }
    let mut mask = 0;
    for i in 0..8 {
        mask |= u32::from(near[i] <= far[i]) << i;
    }
    Entered { mask, near, far }
}

fn push(
    node: &Node<8>,
    shift: u32,
    entered: &Entered<[f32; 8]>,
    stack: &mut Stack,
) -> u32 {
    for order in node.order {
        let slot = (order >> shift & 7) as usize;
        if entered.mask >> slot & 1 != 0 {
            stack.push(node.children[slot], entered.near[slot]);
        }
    }
    stack.length -= 1;
    unsafe { stack.children[stack.length].assume_init() }
}

impl Kernel for Walker {
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        self.search::<false>(ray, from).hit(ray)
    }

    fn is_blocked(&self, ray: &Ray, from: Option<u32>) -> bool {
        self.search::<true>(ray, from).slot != NONE
    }
}
