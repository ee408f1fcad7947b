// Tangled from chapters/traversal.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The traversal through a wide hierarchy, and its portable form.
//!
//! Boxes are compared with the ray in single precision. They are padded
//! so that rounding cannot hide a triangle: each triangle that the exact
//! test finds up to the end of the ray is tested, whatever the tree.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::array;
use std::mem::MaybeUninit;

use glam::DVec3;

use super::search::Search;
use super::triangle::{
    FRAMES, LANES, LEAF, NONE, edges, near, slot, slots,
};
use super::triangle::{Leaf, Margins, Region, Shear, TriangleTest};
use super::wide::{Node, STACK, Wide};
use crate::scene::Ray;

/// A ray in single precision, prepared for the planes of boxes.
#[derive(Default)]
pub struct Slabs {
    /// 1/d of each axis, neither zero nor infinite.
    pub inverse: [f32; 3],
    /// o/d of each axis, for the planes of entry; more for a distant ray.
    pub entry: [f32; 3],
    /// The same for the planes of exit; less for a distant ray.
    pub exit: [f32; 3],
    /// The rows of a node's planes, 0 to 5, by which the ray enters.
    pub enter: [usize; 3],
    /// The rows by which it leaves.
    pub leave: [usize; 3],
}

impl Slabs {
    /// For the boxes of a region.
    #[inline(always)]
    pub fn new(ray: &Ray, region: &Region) -> Self {
        let direction = ray.direction.as_vec3().to_array();
        let origin = (ray.origin - region.zero).as_vec3().to_array();
        let inverse = direction.map(|d| 1. / clamp_direction(d));
        let start: [f32; 3] = array::from_fn(|i| origin[i] * inverse[i]);
        let up = direction.map(|d| usize::from(d >= 0.));
        let enter = array::from_fn(|i| i + 3 * (1 - up[i]));
        let leave = array::from_fn(|i| i + 3 * up[i]);
        let (mut entry, mut exit) = (start, start);
        let beyond = region.beyond(ray.origin);
        if beyond > 0. {
            let margin = (beyond * PLANE_ERROR) as f32;
            let aside = inverse.map(|r| margin * r.abs());
            entry = array::from_fn(|i| start[i] + aside[i]);
            exit = array::from_fn(|i| start[i] - aside[i]);
        }
        Self { inverse, entry, exit, enter, leave }
    }
}

/// How far the planes of boxes may be displaced, as a part of the distance
/// from their region: 2^-20.
pub const PLANE_ERROR: f64 = 1. / (1 << 20) as f64;

const LEAST: f32 = f32::from_bits((127 - 60) << 23);

/// The component `d` of a direction, made at least `LEAST` in size; a zero
/// of either sign counts as positive.
#[inline(always)]
fn clamp_direction(d: f32) -> f32 {
    d.abs().max(LEAST).copysign(d + 0.)
}

/// Rays with an origin or a direction that has a component of 2^64 or more
/// meet nothing. With a direction of at least `LEAST` nothing overflows.
const MAX_COORDINATE: f64 = (1u128 << 64) as f64;

/// Whether a ray may meet something.
#[inline(always)]
pub fn is_within_bounds(ray: &Ray) -> bool {
    let bounds = DVec3::splat(MAX_COORDINATE);
    let within = |v: DVec3| v.abs().cmplt(bounds);
    (within(ray.origin) & within(ray.direction)).all()
}

/// Room for children that wait.
pub struct Waiting {
    children: [MaybeUninit<u32>; STACK],
    /// Where the ray enters their boxes, or a little before.
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

    /// Pushes a child.
    ///
    /// # Safety
    /// Less than `STACK` children wait.
    #[inline(always)]
    pub unsafe fn push(&mut self, child: u32, distance: f32) {
        // SAFETY: there is room, says the caller; what `top` points to is
        // written before it counts.
        unsafe {
            let (children, distances) = self.top::<1>();
            children.write(child);
            distances.write(distance);
            self.grow(1);
        }
    }

    /// Where the next `N` children and their distances go.
    ///
    /// # Safety
    /// No more than `STACK - N` children wait.
    #[inline(always)]
    pub unsafe fn top<const N: usize>(&mut self) -> (*mut u32, *mut f32) {
        debug_assert!(self.length + N <= STACK);
        // SAFETY: the elements are there, says the caller.
        unsafe {
            (
                self.waiting.children.as_mut_ptr().add(self.length).cast(),
                self.waiting.distances.as_mut_ptr().add(self.length).cast(),
            )
        }
    }

    /// Adds `count` children to those that wait.
    ///
    /// # Safety
    /// They have been written at `top`.
    #[inline(always)]
    pub unsafe fn grow(&mut self, count: usize) {
        self.length += count;
    }

    /// Requests the memory of the child that is popped next.
    #[inline(always)]
    #[cfg_attr(not(target_arch = "x86_64"), allow(unused))]
    pub fn fetch<const N: usize>(&self, wide: &Wide<N>) {
        #[cfg(target_arch = "x86_64")]
        if self.length > 0 {
            use super::triangle::UNIT;
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            use std::hint;
            let i = self.length - 1;
            // SAFETY: the element was below `length`, so it was written.
            let child = unsafe {
                self.waiting.children.get_unchecked(i).assume_init()
            };
            let node = wide.nodes.as_ptr().wrapping_add(child as usize);
            let words = wide.leaves.words.as_ptr();
            let leaf = words.wrapping_add(UNIT * slots(child).0 as usize);
            let address: *const i8 = hint::select_unpredictable(
                child & LEAF == 0,
                node.cast(),
                leaf.cast(),
            );
            for line in 0..8 {
                let address = address.wrapping_add(64 * line);
                // SAFETY: a request reads nothing, whatever the address.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(address) };
            }
        }
    }

    /// Pops children up to the first that begins within `t_max`.
    #[inline(always)]
    pub fn pop(&mut self, t_max: f32) -> Option<u32> {
        while self.length > 0 {
            self.length -= 1;
            let i = self.length;
            let Waiting { children, distances } = &self.waiting;
            // SAFETY: the element was below `length`, so it was written.
            unsafe {
                if distances.get_unchecked(i).assume_init() <= t_max {
                    return Some(children.get_unchecked(i).assume_init());
                }
            }
        }
        None
    }
}

/// The instructions for nodes of `N` children, and for leaves.
pub trait Kernel<const N: usize>: LeafKernel {
    /// Pushes the children of a node whose boxes the ray of `slabs` enters
    /// before `t_max`, but returns the nearest; none if there are none.
    ///
    /// # Safety
    /// The processor has the instructions, and no more than `STACK - N`
    /// children wait.
    unsafe fn enter(
        node: &Node<N>,
        slabs: &Slabs,
        t_max: f32,
        stack: &mut Stack,
    ) -> Option<u32>;

    /// Pushes the children that have a key, but for the least: up to four
    /// from far to near, and more in any order.
    ///
    /// # Safety
    /// As for `enter`.
    unsafe fn push(
        children: &[u32; N],
        keys: [u32; N],
        least: u32,
        stack: &mut Stack,
    );
}

/// The instructions for the triangles of a leaf.
pub trait LeafKernel: Sync {
    /// The triangles that a ray meets up to the distance `limit`. Those that
    /// it meets beyond may or may not be in the mask.
    ///
    /// # Safety
    /// The processor has the instructions, and the leaf is one of `Leaves`.
    unsafe fn intersect(
        leaf: Leaf,
        shear: &Shear,
        limit: (f64, &Margins),
    ) -> LeafHits;
}

/// The lanes of a leaf that are met, as a mask, and the distances; none if
/// the ray passes one of the triangles closely.
pub type LeafHits = Option<(u32, [f64; LANES])>;

/// Prepares the search of a ray for the nearest triangle: a search that has
/// met nothing, the shear, and the margins. The ray left the first slot; the
/// second is offered ahead.
#[inline(always)]
pub fn prepare<'a, const N: usize>(
    wide: &'a Wide<N>,
    ray: &Ray,
    slots: (Option<u32>, u32),
) -> (Search<'a>, Shear, Margins) {
    let margins = wide.region.margins(ray.origin);
    let search = Search::new(&wide.leaves, slots, margins.size);
    (search, Shear::new(ray), margins)
}

/// The nearest of the triangles that a ray meets, other than the first of
/// the slots `ends`. With `ANY`, the search ends as soon as another triangle
/// than the second is the nearest. A `FAST` search gives none if it meets a
/// doubt, or if `NESTED` is wrong about whether the hierarchy has nested
/// frames: the caller then uses the next slower one.
///
/// # Safety
/// The processor has the instructions of `K`.
#[inline(always)]
pub unsafe fn walk<
    'a,
    K: Kernel<N>,
    const N: usize,
    const ANY: bool,
    const FAST: bool,
    const NESTED: bool,
>(
    wide: &'a Wide<N>,
    ray: &Ray,
    ends: (Option<u32>, u32),
) -> Option<Search<'a>> {
    if FAST && NESTED == wide.frames.is_empty() {
        return None;
    }
    let (mut search, shear, mut margins) = prepare(wide, ray, ends);
    // End at once out of bounds or at the target
    if !is_within_bounds(ray)
        || ANY && is_missed(&mut search, ends, &shear, &margins)?
    {
        return Some(search);
    }
    let mut region = wide.region;
    let mut waiting = Waiting::new();
    let mut stack = Stack::new(&mut waiting);
    let mut child = 0;
    'walk: loop {
        let slabs = Slabs::new(ray, &region);
        let mut t_max = search.limit(&margins) as f32;
        // Go from nodes to leaves
        let frame = loop {
            while child & LEAF == 0 {
                // Choose among the children entered
                // SAFETY: children without the bit LEAF are numbers of nodes, and no
                // hierarchy is so deep that less than `N` are left on the stack (`fits`).
                let nearest = unsafe {
                    let node = wide.nodes.get_unchecked(child as usize);
                    K::enter(node, &slabs, t_max, &mut stack)
                };
                let next = nearest
                    .inspect(|_| stack.fetch(wide))
                    .or_else(|| stack.pop(t_max));
                let Some(next) = next else { break 'walk };
                child = next;
            }
            // Offer the leaf's triangles and go on
            let place = slots(child);
            if NESTED && place.0 >= FRAMES {
                let frame = &wide.frames[(place.0 - FRAMES) as usize];
                if frame.node.is_none() || search.enters(&frame.region, ray)
                {
                    break frame;
                }
            } else {
                let ways = (&shear, &margins);
                // SAFETY: as above; children with the bit LEAF below `FRAMES`
                // are leaves that are there.
                let met = unsafe {
                    intersect_leaf::<K, N, FAST>(
                        &mut search,
                        ray,
                        ways,
                        place,
                    )?
                };
                if met != 0 {
                    if ANY && search.slot != ends.1 {
                        break 'walk;
                    }
                    t_max = search.limit(&margins) as f32;
                }
            }
            let Some(next) = stack.pop(t_max) else { break 'walk };
            child = next;
        };
        // Change the frame
        region = frame.region;
        margins = region.nested_margins(ray.origin, search.root);
        margins.near = margins.near.max(near(search.size));
        if frame.node.is_some() {
            search.pass(&region, &margins);
            // SAFETY: no hierarchy is so deep that one is not left.
            unsafe { stack.push(child + 1, 0.) };
        }
        let waits = || stack.pop(search.limit(&margins) as f32);
        let Some(next) = frame.node.or_else(waits) else { break };
        child = next;
    }
    Some(search)
}

/// Adds the triangles of a leaf that the ray meets to the search, and
/// returns their mask. The leaf has `count` triangles at unit `first`. With
/// `FAST`, none if anything is doubtful.
///
/// # Safety
/// The leaf is there, and the processor has the instructions of `K`.
#[inline(always)]
pub unsafe fn intersect_leaf<
    K: Kernel<N>,
    const N: usize,
    const FAST: bool,
>(
    search: &mut Search,
    ray: &Ray,
    (shear, margins): (&Shear, &Margins),
    (first, count): (u32, usize),
) -> Option<u32> {
    let limit = search.limit(margins);
    // SAFETY: the caller promises that it is there.
    let leaf = unsafe { search.leaf(first, count) };
    // SAFETY: it is one of `Leaves`; the caller promises the rest.
    let met = unsafe { K::intersect(leaf, shear, (limit, margins)) };
    let (mask, distances) = match met {
        None if FAST => return None,
        _ => met.unwrap_or_else(|| leaf.intersect(shear, margins)),
    };
    let mut left = mask;
    while left != 0 {
        let lane = left.trailing_zeros();
        let distance = distances[lane as usize % LANES];
        if FAST {
            search.take(slot(first, lane), distance, margins)?;
        } else {
            search.offer((first, leaf), lane, distance, (ray, margins));
        }
        left &= left - 1;
    }
    Some(mask)
}

/// Offers a target, if there is one, ahead of the walk, and returns whether
/// the ray misses it; a triangle that it leaves is missed. None if that is
/// doubtful.
#[inline(always)]
fn is_missed(
    search: &mut Search,
    (from, target): (Option<u32>, u32),
    shear: &Shear,
    margins: &Margins,
) -> Option<bool> {
    if target == NONE || from == Some(target) {
        return Some(target != NONE);
    }
    let (leaf, lane) = search.leaves.find(target);
    match leaf.test(lane as usize, shear, margins.size) {
        TriangleTest::Through(at) if at > -margins.near => {
            search.take(target, at, margins)?;
            Some(false)
        }
        _ => Some(true),
    }
}

/// Where a ray enters and leaves the boxes of a node, between its start
/// and `t_max`. The function `distance` computes the distance of a plane from
/// 1/d and o/d. A box is entered if it is not left before.
#[inline(always)]
pub fn interval<const N: usize>(
    node: &Node<N>,
    slabs: &Slabs,
    t_max: f32,
    distance: impl Fn(f32, f32, f32) -> f32,
) -> [[f32; N]; 2] {
    let (mut t_near, mut t_far) = ([0f32; N], [t_max; N]);
    for axis in 0..3 {
        let inverse = slabs.inverse[axis];
        let (late, early) = (slabs.entry[axis], slabs.exit[axis]);
        let enter = &node.planes[slabs.enter[axis]];
        let leave = &node.planes[slabs.leave[axis]];
        for i in 0..N {
            let a = distance(enter[i], inverse, late);
            let b = distance(leave[i], inverse, early);
            t_near[i] = if a > t_near[i] { a } else { t_near[i] };
            t_far[i] = if b < t_far[i] { b } else { t_far[i] };
        }
    }
    [t_near, t_far]
}

/// A number for each box, which grows with the distance where it is entered
/// and has its lane in the last bits; `u32::MAX` if it is not entered.
#[inline(always)]
pub fn keys<const N: usize>([t_near, t_far]: &[[f32; N]; 2]) -> [u32; N] {
    array::from_fn(|i| {
        let key = t_near[i].to_bits() & !(N as u32 - 1) | i as u32;
        if t_near[i] <= t_far[i] { key } else { u32::MAX }
    })
}

/// The distance of the plane `b`, with two roundings.
#[inline(always)]
pub fn distance(b: f32, inverse: f32, start: f32) -> f32 {
    b * inverse - start
}

/// The kernel for every processor.
pub struct Portable;

impl<const N: usize> Kernel<N> for Portable {
    #[inline(always)]
    unsafe fn enter(
        node: &Node<N>,
        slabs: &Slabs,
        t_max: f32,
        stack: &mut Stack,
    ) -> Option<u32> {
        let keys = keys(&interval(node, slabs, t_max, distance));
        let least = keys.into_iter().fold(u32::MAX, u32::min);
        if least == u32::MAX {
            return None;
        }
        // SAFETY: there is room for `N`, says the caller.
        unsafe { Self::push(&node.children, keys, least, stack) };
        Some(node.children[least as usize & (N - 1)])
    }

    #[inline(always)]
    unsafe fn push(
        children: &[u32; N],
        keys: [u32; N],
        least: u32,
        stack: &mut Stack,
    ) {
        let others = |key: &u32| ![least, u32::MAX].contains(key);
        let mut waiting = [0; N];
        let mut count = 0;
        for key in keys.into_iter().filter(others) {
            waiting[count] = key;
            count += 1;
        }
        waiting[..count].sort_unstable_by(|a, b| b.cmp(a));
        for key in &waiting[..count] {
            let lane = key & (N as u32 - 1);
            let distance = f32::from_bits(key - lane);
            // SAFETY: no more than `N` children are pushed.
            unsafe { stack.push(children[lane as usize], distance) };
        }
    }
}

impl LeafKernel for Portable {
    #[inline(always)]
    unsafe fn intersect(
        leaf: Leaf,
        shear: &Shear,
        (limit, margins): (f64, &Margins),
    ) -> LeafHits {
        let sheared = leaf.sheared::<LANES>(0, shear);
        let ([u, v, w], [_, _, [a, b, c]]) = (edges(&sheared), sheared);
        let less = |a: f64, b: f64| if a < b { a } else { b };
        let depths: [f64; LANES] = array::from_fn(|i| {
            let least = less(less(u[i], v[i]), w[i]);
            let most = less(less(-u[i], -v[i]), -w[i]);
            -less(-least, -most)
        });
        let inside = |least| leaf.lanes & mask(|i| depths[i] >= least);
        let near = inside(-margins.narrow);
        if near == 0 {
            return Some((0, [0.; LANES]));
        }
        let distances = array::from_fn(|i| {
            let height = u[i] * a[i] + v[i] * b[i] + w[i] * c[i];
            height / (u[i] + v[i] + w[i]) * shear.stretch
        });
        let met = |i| distances[i] > -margins.near && distances[i] <= limit;
        (near == inside(0.)).then_some((near & mask(met), distances))
    }
}

/// The lanes for which `is` is true.
#[inline(always)]
fn mask(is: impl Fn(usize) -> bool) -> u32 {
    (0..LANES).map(|i| u32::from(is(i)) << i).sum()
}

#[cfg(all(test, target_arch = "x86_64"))]
#[path = "../../tests/units/traversal.rs"]
mod tests;
