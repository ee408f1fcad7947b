// Tangled from chapters/traversal.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The traversal of rays that start side by side in similar directions.
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::array;

use glam::DVec3;

use super::intersector::{BEAM, Batch, Hit};
use super::spawn::hit;
use super::traversal::{
    Kernel, PLANE_ERROR, Slabs, Stack, Waiting, prepare,
};
use super::traversal::{
    distance, intersect_leaf, interval, is_within_bounds, keys,
};
use super::triangle::{LEAF, NONE, Region, slots};
use super::wide::{Node, Wide};
use crate::scene::Ray;

/// Rays that are in the same octant, lane by lane, and planes around them.
#[derive(Default)]
struct Beam {
    /// As in `Slabs`.
    inverse: [[f32; BEAM]; 3],
    entry: [[f32; BEAM]; 3],
    exit: [[f32; BEAM]; 3],
    /// The end of each ray, negative for rays that are missing.
    t_max: [f32; BEAM],
    /// The slabs of the first ray; all rays use the same rows.
    slabs: Slabs,
    /// Below and above along two axes.
    sides: [[Side; 2]; 2],
    /// The row of the planes by which rays leave along the third, the sign
    /// of their direction, and the least depth.
    start: (usize, f32, f32),
}

/// A side of a beam: `a + slope * b` is at least `bound`, or at most.
#[derive(Clone, Copy, Default)]
struct Side {
    /// The rows of a node's planes that are `a` and `b`.
    rows: [usize; 2],
    slope: f32,
    bound: f32,
}

impl Beam {
    /// Encloses the rays; none if they are too different, or if there are
    /// no rays.
    #[inline(always)]
    fn enclose(
        &mut self,
        rays: &Batch<Ray>,
        region: &Region,
    ) -> Option<()> {
        let first = rays.iter().flatten().next()?;
        let w = first.direction.abs().max_position();
        let sign = first.direction[w].signum();
        let others = [(w + 1) % 3, (w + 2) % 3];
        // Store the rays in lanes
        (self.t_max, self.slabs) = ([-1.; BEAM], Slabs::new(first, region));
        let mut start = f64::INFINITY;
        for (i, ray) in rays.iter().enumerate() {
            let Some(ray) = ray else { continue };
            let slabs = Slabs::new(ray, region);
            let near =
                region.beyond(ray.origin) <= PLANE_ERROR * region.reach;
            if !(near
                && is_within_bounds(ray)
                && slabs.enter == self.slabs.enter)
            {
                return None;
            }
            for k in 0..3 {
                self.inverse[k][i] = slabs.inverse[k];
                self.entry[k][i] = slabs.entry[k];
                self.exit[k][i] = slabs.exit[k];
            }
            self.t_max[i] = f32::INFINITY;
            start = start.min(sign * (ray.origin - region.zero)[w]);
        }
        // Bound the starts and the slopes
        let mut places = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let mut slopes = places;
        for ray in rays.iter().flatten() {
            let origin = ray.origin - region.zero;
            let slope = ray.direction * (1. / ray.direction[w].abs());
            let place = origin + slope * (start - sign * origin[w]);
            places = [places[0].min(place), places[1].max(place)];
            slopes = [slopes[0].min(slope), slopes[1].max(slope)];
        }
        // Compute planes from the bounds
        for (k, u) in others.into_iter().enumerate() {
            for end in [0, 1] {
                let slope = slopes[end][u];
                if slope.abs() > MOST_SLOPE {
                    return None;
                }
                let Slabs { enter, leave, .. } = self.slabs;
                let begins = (slope >= 0.) == (end == 0);
                self.sides[end][k] = Side {
                    rows: [
                        u + 3 * (1 - end),
                        if begins { enter } else { leave }[w],
                    ],
                    slope: (-slope * sign) as f32,
                    bound: (places[end][u] - slope * start) as f32,
                };
            }
        }
        self.start = (self.slabs.leave[w], sign as f32, start as f32);
        Some(())
    }
}

/// The greatest slope of a ray of a beam.
const MOST_SLOPE: f64 = 1.25;

impl Beam {
    /// The keys of a node's boxes, for those that the beam enters.
    #[inline(always)]
    fn enter<const N: usize>(&self, node: &Node<N>) -> [u32; N] {
        let (row, sign, bound) = self.start;
        let mut room = node.planes[row].map(|b| b * sign - bound);
        for (sides, sign) in self.sides.iter().zip([1., -1.]) {
            for Side { rows, slope, bound } in sides {
                let [a, b] = rows.map(|row| &node.planes[row]);
                for i in 0..N {
                    let side = sign * (a[i] + slope * b[i] - bound);
                    room[i] = if side < room[i] { side } else { room[i] };
                }
            }
        }
        let infinity = f32::INFINITY;
        let [near, _] = interval(node, &self.slabs, infinity, distance);
        keys(&[near, room.map(|r| if r >= 0. { infinity } else { -1. })])
    }

    /// Which rays enter the box in a lane of a node.
    #[inline(always)]
    fn active<const N: usize>(&self, node: &Node<N>, lane: usize) -> u32 {
        let (mut near, mut far) = ([0f32; BEAM], self.t_max);
        for axis in 0..3 {
            let enter = node.planes[self.slabs.enter[axis]][lane];
            let leave = node.planes[self.slabs.leave[axis]][lane];
            for i in 0..BEAM {
                let inverse = self.inverse[axis][i];
                let a = distance(enter, inverse, self.entry[axis][i]);
                let b = distance(leave, inverse, self.exit[axis][i]);
                near[i] = if a > near[i] { a } else { near[i] };
                far[i] = if b < far[i] { b } else { far[i] };
            }
        }
        (0..BEAM).map(|i| u32::from(near[i] <= far[i]) << i).sum()
    }
}

/// The first hits of rays that leave no triangle, each the same as by
/// `first_hit`.
///
/// # Safety
/// The processor has the instructions of `K`.
#[inline(always)]
pub unsafe fn first_hits<K: Kernel<N>, const N: usize>(
    wide: &Wide<N>,
    rays: &Batch<Ray>,
    first_hit: impl Fn(&Ray) -> Option<Hit>,
) -> Batch<Hit> {
    let alone = |ray: &Option<Ray>| ray.as_ref().and_then(&first_hit);
    let mut beam = Beam::default();
    let has_places = wide.nodes.len() <= u32::MAX as usize / N;
    if !wide.frames.is_empty()
        || !has_places
        || beam.enclose(rays, &wide.region).is_none()
    {
        return rays.each_ref().map(alone);
    }
    let mut searches = [const { None }; BEAM];
    let mut doubtful = 0;
    let mut waiting = Waiting::new();
    let mut stack = Stack::new(&mut waiting);
    let mut number = 0;
    'walk: loop {
        let keys = beam.enter(&wide.nodes[number as usize]);
        let places = array::from_fn(|i| number * N as u32 + i as u32);
        // SAFETY: no hierarchy is so deep that less than `N` are left; the
        // processor has the instructions, says the caller.
        unsafe { K::push(&places, keys, u32::MAX, &mut stack) };
        // Go on to the next node with active rays
        number = loop {
            let place = stack.pop(f32::INFINITY);
            let Some(place) = place else { break 'walk };
            let (number, lane) = (place as usize / N, place as usize % N);
            let node = &wide.nodes[number];
            let mut active = beam.active(node, lane);
            let child = node.children[lane];
            if active != 0 && child & LEAF == 0 {
                break child;
            }
            while active != 0 {
                let i = active.trailing_zeros() as usize % BEAM;
                if let Some(ray) = &rays[i] {
                    let (search, shear, margins) = searches[i]
                        .get_or_insert_with(|| {
                            prepare(wide, ray, (None, NONE))
                        });
                    let (ways, leaf) = ((&*shear, &*margins), slots(child));
                    // SAFETY: without nested frames, children with the bit LEAF are
                    // leaves; the processor has the instructions, says the caller.
                    let met = unsafe {
                        intersect_leaf::<K, N, true>(
                            search, ray, ways, leaf,
                        )
                    };
                    doubtful |= u32::from(met.is_none()) << i;
                    beam.t_max[i] =
                        met.map_or(-1., |_| search.limit(margins) as f32);
                }
                active &= active - 1;
            }
        };
    }
    array::from_fn(|i| match (&rays[i], &searches[i]) {
        (ray, _) if doubtful >> i & 1 != 0 => alone(ray),
        (Some(ray), Some((of, ..))) => hit(wide, ray, None, of),
        _ => None,
    })
}

#[cfg(test)]
#[path = "../../tests/units/beam.rs"]
mod tests;
