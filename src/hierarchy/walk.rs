// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The walk through a wide hierarchy, and its portable form.
//!
//! Boxes are compared with the ray in single precision. They are padded
//! so that rounding cannot hide a triangle: each triangle that the exact
//! test finds up to the end of the ray is tested, whatever the tree.

// Name what the walk imports
use std::array;
use std::mem::MaybeUninit;

use bytemuck::Pod;

use super::triangle::{LANES, Leaf, NONE, Search, Shear};
use super::wide::{LEAF, Node, Wide, slots};
use super::{Hit, Kernel};
use crate::scene::Ray;

// Prepare a ray for boxes
/// A ray in single precision, prepared for the planes of boxes.
pub struct Slabs {
    /// 1/d of each axis, neither zero nor infinite.
    pub inverse: [f32; 3],
    /// o/d of each axis.
    pub start: [f32; 3],
    /// The rows of a node's planes, 0 to 5, by which the ray enters.
    pub enter: [usize; 3],
    /// The rows by which it leaves.
    pub leave: [usize; 3],
    /// Four times the octant, whose bit k says that d of axis k is not
    /// negative.
    pub shift: u32,
}

impl Slabs {
    #[inline(always)]
    pub fn new(ray: &Ray) -> Self {
        let direction = ray.direction.as_vec3().to_array();
        let origin = ray.origin.as_vec3().to_array();
        let inverse = direction.map(|d| 1. / steep(d));
        let start = array::from_fn(|i| origin[i] * inverse[i]);
        let up = direction.map(|d| usize::from(d >= 0.));
        let enter = array::from_fn(|i| i + 3 * (1 - up[i]));
        let leave = array::from_fn(|i| i + 3 * up[i]);
        let shift = 4 * (up[0] | up[1] << 1 | up[2] << 2) as u32;
        Self { inverse, start, enter, leave, shift }
    }
}

const LEAST: f32 = f32::from_bits((127 - 60) << 23);

/// The component `d` of a direction, of size `LEAST` at least.
#[inline(always)]
fn steep(d: f32) -> f32 {
    match d {
        _ if d.abs() >= LEAST => d,
        _ if d < 0. => -LEAST,
        _ => LEAST,
    }
}

// Keep the children to come
/// Children that a stack holds.
pub const STACK: usize = 1024;

/// Room for children that wait.
pub struct Waiting {
    children: [MaybeUninit<u32>; STACK],
    /// Where the ray enters their boxes.
    distances: [MaybeUninit<f32>; STACK],
}

impl Waiting {
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            children: [const { MaybeUninit::uninit() }; STACK],
            distances: [const { MaybeUninit::uninit() }; STACK],
        }
    }
}

/// Children that wait, the next one last.
pub struct Stack<'a> {
    waiting: &'a mut Waiting,
    /// How many wait. The elements below have been written.
    length: usize,
}

impl<'a> Stack<'a> {
    #[inline(always)]
    pub fn new(waiting: &'a mut Waiting) -> Self {
        Self { waiting, length: 0 }
    }

    /// How many children wait.
    pub fn length(&self) -> usize {
        self.length
    }

    #[inline(always)]
    pub fn push(&mut self, child: u32, distance: f32) {
        let (children, distances) = self.top::<1>();
        // SAFETY: both point to an element, which is then written.
        unsafe {
            children.write(child);
            distances.write(distance);
            self.grow(1);
        }
    }

    // Store vectors on the stack
    /// Where the next `N` children and their distances go.
    #[inline(always)]
    pub fn top<const N: usize>(&mut self) -> (*mut u32, *mut f32) {
        debug_assert!(self.length + N <= STACK);
        // SAFETY: no hierarchy is so deep that a walk through it has less
        // than N elements left.
        unsafe {
            (
                self.waiting.children.as_mut_ptr().add(self.length).cast(),
                self.waiting.distances.as_mut_ptr().add(self.length).cast(),
            )
        }
    }

    /// Lets `count` more children wait.
    ///
    /// # Safety
    /// They have been written at `top`.
    #[inline(always)]
    pub unsafe fn grow(&mut self, count: usize) {
        self.length += count;
    }

    // Take the next child within reach
    /// Takes off children up to the first that begins within `reach`.
    #[inline(always)]
    pub fn pop(&mut self, reach: f32) -> Option<u32> {
        while self.length > 0 {
            self.length -= 1;
            let i = self.length;
            let Waiting { children, distances } = &self.waiting;
            // SAFETY: the element was below `length`, so it was written.
            unsafe {
                if distances.get_unchecked(i).assume_init() <= reach {
                    return Some(children.get_unchecked(i).assume_init());
                }
            }
        }
        None
    }
}

// Walk from the root
/// The children of a node whose boxes a ray enters.
pub struct Entered<V> {
    /// Bit i stands for the child in slot i.
    pub mask: u32,
    /// Where the ray enters each box, not before its own start.
    pub near: V,
    /// Where it leaves each box, not beyond its reach. A box is entered
    /// if `near <= far`.
    pub far: V,
}

/// Searches the triangles that `ray` meets, other than `from`, for the
/// nearest one, or with `ANY` for one.
#[inline(always)]
pub fn walk<'a, const N: usize, const ANY: bool, V>(
    wide: &'a Wide<N>,
    ray: &Ray,
    from: Option<u32>,
    enter: impl Fn(&Node<N>, &Slabs, f32) -> Entered<V>,
    two: impl Fn(&V, u32) -> (f32, f32),
    push: impl Fn(&Node<N>, u32, &Entered<V>, &mut Stack) -> u32,
    meet: impl Fn(Leaf<'a>, &Shear, f64) -> (u32, [f64; LANES]),
) -> Search<'a>
where
    Node<N>: Pod,
{
    let nodes: &[Node<N>] = &wide.nodes;
    let (slabs, shear) = (Slabs::new(ray), Shear::new(ray));
    let mut search = Search::new(&wide.leaves, from);
    let mut waiting = Waiting::new();
    let mut stack = Stack::new(&mut waiting);
    let mut reach = f32::INFINITY;
    let mut child = 0;
    loop {
        while child & LEAF == 0 {
            // Choose among the children entered
            // SAFETY: children without the bit LEAF are numbers of nodes.
            let node = unsafe { nodes.get_unchecked(child as usize) };
            let entered = enter(node, &slabs, reach);
            let mask = entered.mask;
            child = match mask.count_ones() {
                0 => match stack.pop(reach) {
                    Some(waiting) => waiting,
                    None => return search,
                },
                1 => node.children[first(mask) & (N - 1)],
                2 => {
                    nearer(node, mask, two(&entered.near, mask), &mut stack)
                }
                _ => push(node, slabs.shift, &entered, &mut stack),
            };
        }
        // Offer the leaf's triangles and go on
        if look(&mut search, child, &shear, &meet) != 0 {
            if ANY && search.slot != NONE {
                return search;
            }
            reach = search.distance as f32;
        }
        match stack.pop(reach) {
            Some(waiting) => child = waiting,
            None => return search,
        }
    }
}

#[inline(always)]
fn first(mask: u32) -> usize {
    mask.trailing_zeros() as usize
}

#[inline(always)]
fn last(mask: u32) -> usize {
    31 - mask.leading_zeros() as usize
}

/// The nearer of the two children in `mask`, whose distances are `a` and
/// `b`; the other waits.
#[inline(always)]
pub fn nearer<const N: usize>(
    node: &Node<N>,
    mask: u32,
    (a, b): (f32, f32),
    stack: &mut Stack,
) -> u32 {
    let one = node.children[first(mask) & (N - 1)];
    let other = node.children[last(mask) & (N - 1)];
    let (near, far, wait) =
        if a <= b { (one, other, b) } else { (other, one, a) };
    stack.push(far, wait);
    near
}

/// Offers the triangles of a leaf that the ray meets; their mask.
#[inline(always)]
pub fn look<'a>(
    search: &mut Search<'a>,
    child: u32,
    shear: &Shear,
    meet: impl Fn(Leaf<'a>, &Shear, f64) -> (u32, [f64; LANES]),
) -> u32 {
    let (first, count) = slots(child);
    // SAFETY: children with the bit LEAF are leaves that are there.
    let leaf = unsafe { search.leaf(first, count) };
    let (met, distances) = meet(leaf, shear, search.distance);
    let mut left = met;
    while left != 0 {
        let lane = left.trailing_zeros();
        let distance = distances[lane as usize % LANES];
        search.offer((first, count), lane, distance);
        left &= left - 1;
    }
    met
}

// Look at one node portably
/// Which boxes of `node` a ray enters before `reach`, where `distance`
/// is that of a plane, given 1/d and o/d.
#[inline(always)]
pub fn enter<const N: usize>(
    node: &Node<N>,
    slabs: &Slabs,
    reach: f32,
    distance: impl Fn(f32, f32, f32) -> f32,
) -> Entered<[f32; N]> {
    let (mut near, mut far) = ([0f32; N], [reach; N]);
    for axis in 0..3 {
        let (inverse, start) = (slabs.inverse[axis], slabs.start[axis]);
        let enter = &node.planes[slabs.enter[axis]];
        let leave = &node.planes[slabs.leave[axis]];
        for i in 0..N {
            let a = distance(enter[i], inverse, start);
            let b = distance(leave[i], inverse, start);
            near[i] = if a > near[i] { a } else { near[i] };
            far[i] = if b < far[i] { b } else { far[i] };
        }
    }
    let bit = |i: usize| u32::from(near[i] <= far[i]) << i;
    Entered { mask: (0..N).map(bit).sum(), near, far }
}

/// The distances of the first and the last child in `mask`.
#[inline(always)]
pub fn two<const N: usize>(near: &[f32; N], mask: u32) -> (f32, f32) {
    (near[first(mask) & (N - 1)], near[last(mask) & (N - 1)])
}

/// Pushes the children entered from far to near; returns the nearest.
pub fn push<const N: usize>(
    node: &Node<N>,
    shift: u32,
    entered: &Entered<[f32; N]>,
    stack: &mut Stack,
) -> u32 {
    let slots = node.order.iter();
    let slots = slots.map(|order| (order >> shift) as usize & (N - 1));
    let mut met = slots.filter(|slot| entered.mask >> slot & 1 != 0);
    let mut next = met.next().unwrap_or(0);
    for slot in met {
        stack.push(node.children[next], entered.near[next]);
        next = slot;
    }
    node.children[next]
}

// Answer with the portable form
/// A hierarchy that is walked with what every processor has.
pub struct Walker(pub Wide<8>);

impl Walker {
    /// The hierarchy that is walked.
    pub fn wide(&self) -> &Wide<8> {
        &self.0
    }

    fn search<const ANY: bool>(
        &self,
        ray: &Ray,
        from: Option<u32>,
    ) -> Search<'_> {
        walk::<8, ANY, [f32; 8]>(
            &self.0,
            ray,
            from,
            |node, slabs, reach| enter(node, slabs, reach, distance),
            two,
            push,
            |leaf, shear, _| leaf.meet(shear),
        )
    }
}

/// The distance of the plane `b`, with two roundings.
#[inline(always)]
pub fn distance(b: f32, inverse: f32, start: f32) -> f32 {
    b * inverse - start
}

impl Kernel for Walker {
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        self.search::<false>(ray, from).hit(ray)
    }

    fn is_blocked(&self, ray: &Ray, from: Option<u32>) -> bool {
        self.search::<true>(ray, from).slot != NONE
    }
}

// Compare the instructions with the portable form
#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use std::arch::x86_64::{__m256, __m512};
    use std::mem::transmute;

    use glam::{DVec3, Vec3};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    use super::super::triangle::Leaves;
    use super::super::wide::PADDING;
    use super::super::{avx2, avx512};
    use super::*;

    const CASES: usize = 1_000_000;

    // Make rays and nodes by chance
    type Random = Pcg64;

    fn coordinate(random: &mut Random) -> f32 {
        match random.random_range(0..4) {
            0 => random.random_range(-2..3) as f32 * 4096.,
            1 => random.random_range(-8..8) as f32 / 128.,
            _ => 8192. * (2. * random.random::<f32>() - 1.),
        }
    }

    fn component(random: &mut Random) -> f64 {
        const SMALL: [f64; 8] =
            [0., -0., 5e-324, -1e-40, 1e-40, -1e-19, 1e-12, -1e-5];
        match random.random_range(0..3) {
            0 => SMALL[random.random_range(0..SMALL.len())],
            _ => 2. * random.random::<f64>() - 1.,
        }
    }

    fn random_ray(random: &mut Random) -> Ray {
        let origin = DVec3::from([0; 3].map(|_| coordinate(random).into()));
        let mut direction = DVec3::from([0; 3].map(|_| component(random)));
        direction[random.random_range(0..3)] = 1.;
        Ray { origin, direction: direction.normalize() }
    }

    fn random_node<const N: usize>(random: &mut Random) -> Node<N> {
        let mut node = Node::EMPTY;
        for slot in 0..N {
            node.children[slot] = random.random();
            if random.random_range(0..4) > 0 {
                for axis in 0..3 {
                    let (a, b) = (coordinate(random), coordinate(random));
                    let b = if random.random() { a } else { b };
                    node.planes[axis][slot] = a.min(b);
                    node.planes[axis + 3][slot] = a.max(b);
                }
            }
        }
        for octant in 0..8 {
            let mut slots: [u32; N] = array::from_fn(|i| i as u32);
            for i in (1..N).rev() {
                slots.swap(i, random.random_range(0..i + 1));
            }
            for (order, slot) in node.order.iter_mut().zip(slots) {
                *order |= slot << (4 * octant);
            }
        }
        node
    }

    // Test the padding of boxes
    #[test]
    fn rounding_displaces_a_plane_by_less_than_the_bound() {
        let mut random = Random::seed_from_u64(8);
        let mut worst = 0f64;
        for _ in 0..10 * CASES {
            let Ray { origin, direction } = random_ray(&mut random);
            let origin = origin + f64::from(random.random::<f32>());
            let slabs = Slabs::new(&Ray { origin, direction });
            let b = coordinate(&mut random);
            if direction.x.abs() >= LEAST.into() {
                let (inverse, start) = (slabs.inverse[0], slabs.start[0]);
                for t in [distance, fused].map(|t| t(b, inverse, start)) {
                    let plane = origin.x + f64::from(t) * direction.x;
                    worst = worst.max((plane - f64::from(b)).abs());
                }
            }
        }
        eprintln!("displaced by {} / 1024", 1024. * worst);
        assert!(worst < 5. / 1024.);
    }
    #[test]
    fn a_padded_box_around_a_point_of_the_ray_is_entered() {
        let mut random = Random::seed_from_u64(1);
        let mut entered = 0;
        while entered < CASES {
            let ray = random_ray(&mut random);
            let distance = 16384. * random.random::<f64>();
            let point = ray.origin + distance * ray.direction;
            if point.abs().max_element() > 8192. {
                continue;
            }
            // Enclose the point in a padded box
            let mut node = Node::<8>::EMPTY;
            for axis in 0..3 {
                let moved = point[axis]
                    + [-1., 1.][random.random_range(0..2)] / 1024.;
                let size = 8. * random.random::<f32>();
                // Single precision numbers between which `moved` lies.
                let (low, high) = match moved as f32 {
                    near if f64::from(near) <= moved => {
                        (near, near.next_up())
                    }
                    near => (near.next_down(), near),
                };
                let [low, high] = match random.random_range(0..3) {
                    0 => [low - size, high],
                    1 => [low, high + size],
                    _ => [low, high],
                };
                node.planes[axis][0] = low - PADDING;
                node.planes[axis + 3][0] = high + PADDING;
            }
            let reach = distance as f32;
            let slabs = Slabs::new(&ray);
            let twice = enter(&node, &slabs, reach, super::distance);
            let once = enter(&node, &slabs, reach, fused);
            assert_eq!(
                (once.mask, twice.mask),
                (1, 1),
                "{ray:?} {distance}"
            );
            entered += 1;
        }
    }

    fn fused(b: f32, inverse: f32, start: f32) -> f32 {
        b.mul_add(inverse, -start)
    }

    // Test a look at one node
    /// Compares with the portable form what `look` finds in a node: the
    /// boxes entered, and the first and the last of two.
    fn compare_looks<const N: usize>(
        look: impl Fn(&Node<N>, &Slabs, f32) -> (Entered<[f32; N]>, (f32, f32)),
    ) {
        let mut random = Random::seed_from_u64(2);
        for _ in 0..CASES {
            let node = random_node::<N>(&mut random);
            let slabs = Slabs::new(&random_ray(&mut random));
            let reach = reach(&mut random);
            let expected = enter(&node, &slabs, reach, fused);
            let (found, pair) = look(&node, &slabs, reach);
            assert_eq!(found.mask, expected.mask, "{node:?}");
            assert_eq!(found.near, expected.near);
            assert_eq!(found.far, expected.far);
            if found.mask.count_ones() == 2 {
                assert_eq!(pair, two(&expected.near, found.mask));
            }
        }
    }

    fn reach(random: &mut Random) -> f32 {
        match random.random_range(0..3) {
            0 => f32::INFINITY,
            1 => coordinate(random).abs(),
            _ => 4096. * random.random::<f32>(),
        }
    }

    #[test]
    fn eight_boxes_are_entered_as_one_by_one() {
        if !avx2::is_available() {
            return eprintln!("note: skipped, no AVX2");
        }
        // SAFETY: the processor has been asked; a register is eight numbers.
        compare_looks::<8>(|node, slabs, reach| unsafe {
            let Entered { mask, near, far } =
                avx2::enter(node, slabs, reach);
            let pair = avx2::two(near, mask.max(1));
            let (near, far) = (
                transmute::<__m256, [f32; 8]>(near),
                transmute::<__m256, [f32; 8]>(far),
            );
            (Entered { mask, near, far }, pair)
        });
    }

    #[test]
    fn sixteen_boxes_are_entered_as_one_by_one() {
        if !avx512::is_available() {
            return eprintln!("note: skipped, no AVX-512");
        }
        // SAFETY: as above, with sixteen.
        compare_looks::<16>(|node, slabs, reach| unsafe {
            let Entered { mask, near, far } =
                avx512::enter(node, slabs, reach);
            let pair = avx512::two(near, mask);
            let (near, far) = (
                transmute::<__m512, [f32; 16]>(near),
                transmute::<__m512, [f32; 16]>(far),
            );
            (Entered { mask, near, far }, pair)
        });
    }

    // Test the order of the children
    fn random_entered<const N: usize>(
        random: &mut Random,
    ) -> Entered<[f32; N]> {
        loop {
            let mut mask = 0;
            let near: [f32; N] = array::from_fn(|_| random.random());
            let far = array::from_fn(|i| {
                let entered = random.random::<bool>();
                mask |= u32::from(entered) << i;
                if entered { near[i] } else { near[i] - 1. }
            });
            if mask.count_ones() > 2 {
                return Entered { mask, near, far };
            }
        }
    }

    fn random_stack<'a, const N: usize>(
        waiting: &'a mut Waiting,
        random: &mut Random,
    ) -> Stack<'a> {
        let full = random.random_range(0..64) == 0;
        let length =
            if full { STACK - N } else { random.random_range(0..16) };
        let mut stack = Stack::new(waiting);
        for i in 0..length as u32 {
            stack.push(i, i as f32);
        }
        stack
    }

    /// The children that wait, with their distances.
    fn waiting(mut stack: Stack) -> Vec<(u32, u32)> {
        let mut waiting = vec![];
        while let Some(child) = stack.pop(f32::INFINITY) {
            // SAFETY: it waited a moment ago.
            let distance = unsafe {
                stack.waiting.distances[stack.length].assume_init()
            };
            waiting.push((child, distance.to_bits()));
        }
        waiting
    }

    /// Compares with the portable form what `pushes` leaves on the stack
    /// and returns.
    fn compare_pushes<const N: usize>(
        pushes: impl Fn(&Node<N>, u32, Entered<[f32; N]>, &mut Stack) -> u32,
    ) {
        let mut random = Random::seed_from_u64(4);
        for _ in 0..CASES {
            let node = random_node::<N>(&mut random);
            let shift = 4 * random.random_range(0..8);
            let entered = random_entered(&mut random);
            let (mut one, mut other) = (Waiting::new(), Waiting::new());
            let mut stack =
                random_stack::<N>(&mut one, &mut random.clone());
            let mut found = random_stack::<N>(&mut other, &mut random);
            let expected = push(&node, shift, &entered, &mut stack);
            let next = pushes(&node, shift, entered, &mut found);
            assert_eq!(next, expected, "{shift} {node:?}");
            assert_eq!(waiting(found), waiting(stack));
        }
    }

    #[test]
    fn eight_children_are_pushed_as_one_by_one() {
        if !avx2::is_available() {
            return eprintln!("note: skipped, no AVX2");
        }
        // SAFETY: the processor has been asked; a register is eight numbers.
        compare_pushes::<8>(|node, shift, entered, stack| unsafe {
            let Entered { mask, near, far } = entered;
            let (near, far) = (
                transmute::<[f32; 8], __m256>(near),
                transmute::<[f32; 8], __m256>(far),
            );
            let entered = Entered { mask, near, far };
            avx2::push(node, shift, &entered, stack)
        });
    }

    #[test]
    fn sixteen_children_are_pushed_as_one_by_one() {
        if !avx512::is_available() {
            return eprintln!("note: skipped, no AVX-512");
        }
        // SAFETY: as above, with sixteen.
        compare_pushes::<16>(|node, shift, entered, stack| unsafe {
            let Entered { mask, near, far } = entered;
            let (near, far) = (
                transmute::<[f32; 16], __m512>(near),
                transmute::<[f32; 16], __m512>(far),
            );
            let entered = Entered { mask, near, far };
            avx512::push(node, shift, &entered, stack)
        });
    }

    // Test the four lanes of a leaf
    fn random_leaf(random: &mut Random) -> (Leaves, usize) {
        let count = random.random_range(1..LANES + 1);
        let mut corner = || Vec3::from([0; 3].map(|_| coordinate(random)));
        let mut triangle = |i| (i, [corner(), corner(), corner()]);
        let triangles: Vec<_> =
            (0..count as u32).map(&mut triangle).collect();
        let mut leaves = Leaves::with_room(count).expect("memory");
        leaves.room().fill(&triangles);
        (leaves, count)
    }

    /// A ray for a leaf, often one that its first triangle's edge meets.
    fn ray_at(leaves: &Leaves, random: &mut Random) -> Ray {
        let ray = random_ray(random);
        let [a, b, _] = leaves.triangle(0);
        let aim = match random.random_range(0..4) {
            0 => a,
            1 => (a + b) / 2.,
            2 => a + (b - a) * random.random::<f64>(),
            _ => return ray,
        };
        match (aim - ray.origin).try_normalize() {
            Some(direction) => Ray { direction, ..ray },
            None => ray,
        }
    }

    #[test]
    fn four_triangles_are_met_as_one_by_one() {
        if !avx2::is_available() {
            return eprintln!("note: skipped, no AVX2");
        }
        let mut random = Random::seed_from_u64(6);
        let mut met = 0;
        for _ in 0..CASES {
            let (leaves, count) = random_leaf(&mut random);
            // SAFETY: it has been put there.
            let leaf = unsafe { leaves.leaf(0, count) };
            let ray = ray_at(&leaves, &mut random);
            let limit = f64::from(reach(&mut random));
            let shear = Shear::new(&ray);
            let within = |(mask, distances): (u32, [f64; LANES])| {
                let lanes = (0..LANES).filter(|i| mask >> i & 1 != 0);
                let lanes = lanes.filter(|&i| distances[i] <= limit);
                lanes
                    .map(|i| (i, distances[i].to_bits()))
                    .collect::<Vec<_>>()
            };
            // SAFETY: the processor has been asked.
            let found =
                within(unsafe { avx2::meet::<4>(leaf, &shear, limit) });
            let expected = within(leaf.meet(&shear));
            assert_eq!(found, expected, "{:?} {ray:?}", leaf.corners);
            met += found.len();
        }
        assert!(met > CASES / 10, "{met}");
    }
}
