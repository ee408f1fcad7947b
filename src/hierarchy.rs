// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Finding the first triangle along a ray.
//!
//! A kernel answers for a whole scene. It works in the scene's
//! coordinates: boxes and corners are single precision, while rays,
//! hits and the test of a triangle are double precision.

// Name what the hierarchy imports
use std::time::Duration;

use glam::{DVec3, UVec2, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ray::Ray as Reach;
use obvhs::{Boundable, BvhBuildParams, traverse};

use crate::scene::{Ray, Scene, Triangle};

#[cfg(target_arch = "x86_64")]
mod avx2;

// Say what a kernel answers
/// Where a ray meets the scene first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The point, in the coordinates of the scene.
    pub point: DVec3,
    /// The unit normal on the side from which the ray came.
    pub normal: DVec3,
    /// The triangle, by the kernel's own number.
    pub primitive: u32,
}

/// Finds first hits in one scene.
pub trait Kernel: Sync {
    /// The first hit of `ray` on a triangle other than `from`.
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit>;
}

// Build the compressed wide hierarchy
/// The compressed eight-wide hierarchy of Ylitie, Karras and Laine
/// (2017), built and traversed by the crate obvhs.
pub struct Cwbvh {
    nodes: CwBvh,
    /// The triangles in the order of the leaves.
    corners: Vec<Corners>,
    /// Whether to walk with AVX2 instructions.
    avx2: bool,
}

const PADDING: f32 = 1. / 128.;

struct Padded(Triangle);

impl Boundable for Padded {
    fn aabb(&self) -> Aabb {
        let [a, b, c] = self.0.map(Vec3A::from);
        let padding = Vec3A::splat(PADDING);
        Aabb::new(a.min(b).min(c) - padding, a.max(b).max(c) + padding)
    }
}

impl Cwbvh {
    /// Builds the hierarchy of a scene, on all threads.
    pub fn new(scene: &Scene) -> Self {
        Self::with_preset(scene, BvhBuildParams::medium_build())
    }

    /// Builds the hierarchy of a scene with parameters of obvhs.
    pub fn with_preset(scene: &Scene, preset: BvhBuildParams) -> Self {
        let padded = scene.triangles().iter().copied().map(Padded);
        let padded: Vec<_> = padded.collect();
        let mut unused = Duration::ZERO;
        let nodes = build_cwbvh(&padded, preset, &mut unused);
        let in_leaf = |&i: &u32| Corners::new(&padded[i as usize].0);
        let corners = nodes.primitive_indices.iter().map(in_leaf).collect();
        #[cfg(target_arch = "x86_64")]
        let avx2 = avx2::has_avx2();
        #[cfg(not(target_arch = "x86_64"))]
        let avx2 = false;
        Self { nodes, corners, avx2 }
    }
}

// Walk through the hierarchy's nodes
impl Cwbvh {
    #[inline(always)]
    fn walk(
        &self,
        ray: &Ray,
        from: Option<u32>,
        children: impl Fn(&CwBvhNode, &Reach, u32) -> u32,
        meet: impl Fn(&Shear, &Corners) -> f64,
    ) -> Option<Hit> {
        let from = from.unwrap_or(u32::MAX);
        let shear = Shear::new(ray);
        let (o, d) = (ray.origin.as_vec3a(), ray.direction.as_vec3a());
        let mut reach = Reach::new_inf(o, d);
        let mut nearest = (f64::INFINITY, 0);
        let mut state = self.nodes.new_traversal(reach.direction);
        let mut node;
        traverse!(
            self.nodes,
            node,
            state,
            children(node, &reach, state.oct_inv4),
            {
                // Shorten the ray to the triangle
                let primitive = state.primitive_id;
                let corners = &self.corners[primitive as usize];
                if primitive != from {
                    let found = (meet(&shear, corners), primitive);
                    if found < nearest {
                        nearest = found;
                        reach.tmax = (found.0 as f32).next_up();
                    }
                }
            }
        );
        let (distance, primitive) = nearest;
        (distance < f64::INFINITY)
            .then(|| self.hit(ray, distance, primitive))
    }
}

impl Cwbvh {
    #[inline(always)]
    fn hit(&self, ray: &Ray, distance: f64, primitive: u32) -> Hit {
        let point = ray.origin + ray.direction * distance;
        let normal = self.corners[primitive as usize].normal();
        let away = normal.dot(ray.direction) > 0.;
        let normal = if away { -normal } else { normal };
        Hit { point, normal, primitive }
    }
}

/// The children of `node` that the ray enters, in the layout that the
/// walk expects: inner nodes from bit 24, triangles below.
#[inline(always)]
fn children_met(node: &CwBvhNode, reach: &Reach, octant: u32) -> u32 {
    let slope = node.compute_extent() * reach.inv_direction;
    let start = (Vec3A::from(node.p) - reach.origin) * reach.inv_direction;
    let mut span = ([0.; 8], [reach.tmax; 8]);
    clip(&mut span, &node.child_min_x, &node.child_max_x, slope.x, start.x);
    clip(&mut span, &node.child_min_y, &node.child_max_y, slope.y, start.y);
    clip(&mut span, &node.child_min_z, &node.child_max_z, slope.z, start.z);
    let met = (0..8).filter(|&i| span.0[i] <= span.1[i]);
    list(node, octant, met.fold(0, |mask, i| mask | 1 << i))
}

/// Clips the spans of eight rays to the slabs of one axis.
#[inline(always)]
fn clip(
    (near, far): &mut ([f32; 8], [f32; 8]),
    low: &[u8; 8],
    high: &[u8; 8],
    slope: f32,
    start: f32,
) {
    let (first, last) = if slope < 0. { (high, low) } else { (low, high) };
    for i in 0..8 {
        let enter = f32::from(first[i]) * slope + start;
        let leave = f32::from(last[i]) * slope + start;
        near[i] = if enter > near[i] { enter } else { near[i] };
        far[i] = if leave < far[i] { leave } else { far[i] };
    }
}

/// The work list of the children whose bits are set in `met`.
#[inline(always)]
fn list(node: &CwBvhNode, octant: u32, mut met: u32) -> u32 {
    let (patterns, places) = node.get_child_and_index_bits(octant);
    let mut list = 0;
    while met != 0 {
        let byte = 8 * met.trailing_zeros();
        let place = (places >> byte) as u32 & 31;
        list |= ((patterns >> byte) as u32 & 7) << place;
        met &= met - 1;
    }
    list
}

impl Kernel for Cwbvh {
    #[inline]
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        #[cfg(target_arch = "x86_64")]
        if self.avx2 {
            // SAFETY: `avx2` is set only by `has_avx2`, which asked the
            // processor for each of the instructions enabled there.
            return unsafe { avx2::first_hit(self, ray, from) };
        }
        self.walk(ray, from, children_met, Shear::distance)
    }
}

impl Cwbvh {
    /// The same hierarchy, walked without special instructions.
    pub fn portable(self) -> Self {
        Self { avx2: false, ..self }
    }
}

// Test a triangle with shear
/// A change of coordinates that makes a ray the z axis.
struct Shear {
    /// Which coordinates become x, y and z.
    axes: [usize; 3],
    /// The origin of the ray, permuted.
    origin: [f64; 3],
    /// The quotients dx/dz and dy/dz.
    slope: [f64; 2],
    /// 1/dz: distance along the ray per unit of z.
    stretch: f64,
}

impl Shear {
    #[inline(always)]
    fn new(ray: &Ray) -> Self {
        let size = ray.direction.abs();
        let z = if size.x > size.y {
            if size.x > size.z { 0 } else { 2 }
        } else if size.y > size.z {
            1
        } else {
            2
        };
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let [x, y, z] = axes.map(|axis| ray.direction[axis]);
        let origin = axes.map(|axis| ray.origin[axis]);
        let (slope, stretch) = ([x / z, y / z], 1. / z);
        Self { axes, origin, slope, stretch }
    }
}

/// The x, y and z of three corners; the fourth of each is not used.
struct Corners([[f32; 4]; 3]);

impl Corners {
    fn new(&[a, b, c]: &Triangle) -> Self {
        let axis = |i: usize| [a[i], b[i], c[i], c[i]];
        Self([axis(0), axis(1), axis(2)])
    }

    /// The unit normal, on the side where the corners run
    /// anticlockwise.
    #[inline(always)]
    fn normal(&self) -> DVec3 {
        let [x, y, z] = &self.0;
        let corner = |i| Vec3::new(x[i], y[i], z[i]).as_dvec3();
        let (a, b, c) = (corner(0), corner(1), corner(2));
        (b - a).cross(c - a).normalize()
    }
}

impl Shear {
    /// The distance to a triangle along the ray, or infinity.
    #[inline(always)]
    fn distance(&self, corners: &Corners) -> f64 {
        let [x, y, z] = self.axes.map(|axis| &corners.0[axis]);
        let z = each(|i| f64::from(z[i]) - self.origin[2]);
        let x = each(|i| {
            f64::from(x[i]) - self.origin[0] - self.slope[0] * z[i]
        });
        let y = each(|i| {
            f64::from(y[i]) - self.origin[1] - self.slope[1] * z[i]
        });
        let u = x[2] * y[1] - y[2] * x[1];
        let v = x[0] * y[2] - y[0] * x[2];
        let w = x[1] * y[0] - y[1] * x[0];
        let negative = u < 0. || v < 0. || w < 0.;
        let positive = u > 0. || v > 0. || w > 0.;
        if negative && positive {
            return f64::INFINITY;
        }
        self.along([u, v, w], z)
    }

    // Find the distance along the ray
    /// The distance of the point with barycentric weights `[u, v, w]`
    /// between corners of sheared heights `z`, or infinity behind the ray.
    #[inline(always)]
    fn along(&self, [u, v, w]: [f64; 3], z: [f64; 3]) -> f64 {
        let height = (u * z[0] + v * z[1] + w * z[2]) / (u + v + w);
        let distance = height * self.stretch;
        if distance > 0. { distance } else { f64::INFINITY }
    }
}

#[inline(always)]
fn each(f: impl FnMut(usize) -> f64) -> [f64; 3] {
    std::array::from_fn(f)
}
