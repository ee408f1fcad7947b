// The functions of the walk in vector instructions against the portable ones,
// and the padding of boxes (chapter "Traversal").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::super::Isa;
use super::super::kernels::{Vectors, fused};
use super::super::triangle::{Leaves, UNIT, units, write};
use super::*;

const CASES: usize = 200_000;

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

/// The region of all coordinates, of reach 2^13, or one half as large.
fn region(part: f64) -> Region {
    let corner = DVec3::splat(8192. * part);
    Region::between(-corner, corner)
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
    node
}

// Test the padding of boxes
/// Holds the planes by which rays enter and leave to the bound of their
/// displacement. Rays start `far` outside at most.
fn displace(far: f64) {
    let mut random = Random::seed_from_u64(8);
    let region = region(1.);
    for _ in 0..5 * CASES {
        let Ray { origin, direction } = random_ray(&mut random);
        let origin = origin * (1. + far / 8192. * random.random::<f64>());
        let slabs = Slabs::new(&Ray { origin, direction }, &region);
        let b = coordinate(&mut random);
        if direction.x.abs() < LEAST.into() {
            continue;
        }
        let beyond = region.beyond(origin).max(0.);
        let bound = (10. * 8192. + 6.01 * beyond) / f64::from(1 << 24);
        let outwards = beyond * PLANE_ERROR * direction.x.signum();
        let sides =
            [(slabs.entry[0], -outwards), (slabs.exit[0], outwards)];
        for (start, moved) in sides {
            for t in
                [distance, fused].map(|t| t(b, slabs.inverse[0], start))
            {
                let plane = origin.x + f64::from(t) * direction.x;
                let error = (plane - (f64::from(b) + moved)).abs();
                assert!(error < bound, "{error} {origin} {direction} {b}");
            }
        }
    }
}

#[test]
fn rounding_displaces_a_plane_by_less_than_the_bound_from_afar_too() {
    [0., 1., 8192., 1e6, 1e12].into_iter().for_each(displace);
}

#[test]
fn a_padded_box_around_a_point_of_the_ray_is_entered() {
    let mut random = Random::seed_from_u64(1);
    let (region, padding) = (region(1.), 8192. / (1 << 20) as f32);
    let mut entered = 0;
    while entered < CASES {
        let mut ray = random_ray(&mut random);
        let mut distance = 16384. * random.random::<f64>();
        if random.random() {
            // Start far outside of the region.
            distance *= [1., 8., 1e3, 1e6][random.random_range(0..4)];
            ray.origin -= distance * ray.direction;
        }
        let point = ray.origin + distance * ray.direction;
        if point.abs().max_element() > 8192. {
            continue;
        }
        // Enclose the point in a padded box
        let mut node = Node::<8>::EMPTY;
        for axis in 0..3 {
            let moved =
                point[axis] + [-1., 1.][random.random_range(0..2)] / 1024.;
            let size = 8. * random.random::<f32>();
            // Single precision numbers between which `moved` lies.
            let (low, high) = match moved as f32 {
                near if f64::from(near) <= moved => (near, near.next_up()),
                near => (near.next_down(), near),
            };
            let [low, high] = match random.random_range(0..3) {
                0 => [low - size, high],
                1 => [low, high + size],
                _ => [low, high],
            };
            node.planes[axis][0] = low - padding;
            node.planes[axis + 3][0] = high + padding;
        }
        let reach = distance as f32;
        let slabs = Slabs::new(&ray, &region);
        for plane in [super::distance, fused] {
            let [t_near, t_far] = interval(&node, &slabs, reach, plane);
            assert!(t_near[0] <= t_far[0], "{ray:?} {distance}");
        }
        entered += 1;
    }
}

// Test a look at one node
fn reach(random: &mut Random) -> f32 {
    match random.random_range(0..3) {
        0 => f32::INFINITY,
        1 => coordinate(random).abs(),
        _ => 4096. * random.random::<f32>(),
    }
}

fn random_stack<'a, const N: usize>(
    waiting: &'a mut Waiting,
    random: &mut Random,
) -> Stack<'a> {
    let full = random.random_range(0..64) == 0;
    let length = if full { STACK - N } else { random.random_range(0..16) };
    let mut stack = Stack::new(waiting);
    for i in 0..length as u32 {
        // SAFETY: there is room for as many.
        unsafe { stack.push(i, i as f32) };
    }
    stack
}

/// The children that wait, with their distances.
fn waiting(mut stack: Stack) -> Vec<(u32, u32)> {
    let mut waiting = vec![];
    while let Some(child) = stack.pop(f32::INFINITY) {
        // SAFETY: it waited a moment ago.
        let distance =
            unsafe { stack.waiting.distances[stack.length].assume_init() };
        waiting.push((child, distance.to_bits()));
    }
    waiting
}

/// Compares with the portable form which child of a node is entered next,
/// and which wait.
fn compare_nodes<K: Kernel<N>, const N: usize>() {
    let mut random = Random::seed_from_u64(2);
    let mut entered = 0;
    for _ in 0..CASES {
        let mut node = random_node::<N>(&mut random);
        let ray = random_ray(&mut random);
        for lane in (0..N).filter(|lane| lane % 2 == 0) {
            // Around a point of the ray, which enters few boxes by chance.
            let size = f64::from(reach(&mut random)).min(4096.);
            let distance = 8192. * random.random::<f64>();
            let point = ray.origin + distance * ray.direction;
            for axis in 0..3 {
                node.planes[axis][lane] = (point[axis] - size) as f32;
                node.planes[axis + 3][lane] = (point[axis] + size) as f32;
            }
        }
        let slabs = Slabs::new(&ray, &region(0.5));
        let reach = reach(&mut random);
        let (mut one, mut other) = (Waiting::new(), Waiting::new());
        let mut stack = random_stack::<N>(&mut one, &mut random.clone());
        let mut found = random_stack::<N>(&mut other, &mut random);
        let keys = keys(&interval(&node, &slabs, reach, fused));
        let least = keys.into_iter().min().unwrap_or(u32::MAX);
        let before = stack.length;
        // SAFETY: there is room for N more, and the processor was asked.
        let next = unsafe {
            Portable::push(&node.children, keys, least, &mut stack);
            K::enter(&node, &slabs, reach, &mut found)
        };
        // A beam pushes all that have a key
        if random.random() {
            // SAFETY: as above, for what has been pushed is taken off.
            unsafe {
                (stack.length, found.length) = (before, before);
                Portable::push(&node.children, keys, u32::MAX, &mut stack);
                K::push(&node.children, keys, u32::MAX, &mut found);
            }
        }
        let nearest = least as usize % N;
        let expected = (least < u32::MAX).then(|| node.children[nearest]);
        assert_eq!(next, expected, "{node:?}");
        // Those pushed come off first, near to far
        let count = stack.length - before;
        let (mut found, mut stack) = (waiting(found), waiting(stack));
        let distances = stack.iter().map(|(_, bits)| *bits);
        assert!(distances.take(count).is_sorted());
        if count > 4 {
            for some in [&mut found, &mut stack] {
                let key = |&(child, bits): &(u32, u32)| (bits, child);
                some[..count].sort_unstable_by_key(key);
            }
        }
        assert_eq!(found, stack);
        entered += count;
    }
    assert!(entered > CASES, "{entered}");
}

#[test]
fn boxes_are_entered_and_children_pushed_as_one_by_one() {
    if Isa::Avx2.is_available() {
        compare_nodes::<Vectors, 8>();
    }
    if Isa::Avx512.is_available() {
        compare_nodes::<Vectors, 16>();
    }
}

// Test the four lanes of a leaf
fn random_leaf(random: &mut Random) -> (Leaves, usize) {
    let count = random.random_range(1..LANES + 1);
    let mut corner =
        || DVec3::from([0; 3].map(|_| coordinate(random).into()));
    let mut triangle = |i| (i, [corner(), corner(), corner()]);
    let triangles: Vec<_> = (0..count as u32).map(&mut triangle).collect();
    let room = UNIT * units(count) as usize;
    let mut words = vec![0; room];
    write(&mut words, &triangles);
    (Leaves { words }, count)
}

/// A ray for a leaf, often one that its first triangle's edge meets.
fn ray_at(leaf: Leaf, random: &mut Random) -> Ray {
    let ray = random_ray(random);
    let [a, b, c] = leaf.triangle(0);
    let aim = match random.random_range(0..6) {
        0 => a,
        1 => (a + b) / 2.,
        2 => a + (b - a) * random.random::<f64>(),
        3 | 4 => (a + b + c) / 3.,
        _ => return ray,
    };
    match (aim - ray.origin).try_normalize() {
        Some(direction) => Ray { direction, ..ray },
        None => ray,
    }
}

fn compare_leaves<K: LeafKernel>() {
    let mut random = Random::seed_from_u64(6);
    let mut met = 0;
    for _ in 0..CASES {
        let (leaves, count) = random_leaf(&mut random);
        // SAFETY: it has been put there.
        let leaf = unsafe { leaves.leaf(0, count) };
        let ray = ray_at(leaf, &mut random);
        let limit = f64::from(reach(&mut random));
        let shear = Shear::new(&ray);
        let margins = region(1.).margins(ray.origin);
        let within = |(mask, distances): (u32, [f64; LANES])| {
            // The lanes met within the limit, and all those passed closely.
            let lanes = (0..2 * LANES).filter(|i| mask >> i & 1 != 0);
            let lanes = lanes.map(|i| (i, distances[i % LANES]));
            let lanes = lanes.filter(|&(i, at)| i >= LANES || at <= limit);
            lanes.map(|(i, at)| (i, at.to_bits())).collect::<Vec<_>>()
        };
        let expected = within(leaf.intersect(&shear, &margins));
        // SAFETY: the processor has been asked.
        let found =
            unsafe { K::intersect(leaf, &shear, (limit, &margins)) };
        let Some(found) = found.map(within) else { continue };
        assert_eq!(found, expected, "{:?} {ray:?}", leaf.words);
        met += found.len();
    }
    assert!(met > CASES / 10, "{met}");
}

#[test]
fn four_triangles_are_met_as_one_by_one() {
    compare_leaves::<Portable>();
    if Isa::Avx2.is_available() {
        compare_leaves::<Vectors>();
    }
}
