// The invariants of the wide hierarchy, which are private to its module
// (chapter "A wide hierarchy").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::cell::Cell;

use super::*;
use crate::bvh::triangle::Leaf;
use crate::scene::{Mesh, Scene, Triangle};
use glam::{DVec3, Vec3A};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

// Make scenes to test with
fn point(random: &mut Pcg64) -> DVec3 {
    DVec3::from_array([0; 3].map(|_| random.random::<f64>()))
}

/// `n` triangles of random sizes.
fn soup(n: usize) -> Scene {
    let mut random = Pcg64::seed_from_u64(n as u64);
    let triangles = (0..n).map(|_| {
        let (p, size) = (point(&mut random), random.random::<f64>());
        [0; 3].map(|_| p + point(&mut random) * size.powi(8))
    });
    scene(triangles.collect())
}

/// Triangles around each other, each smaller by 3 %.
fn nested(n: i32) -> Scene {
    let corners = [DVec3::X, DVec3::Y, DVec3::NEG_ONE];
    let scaled = |i| corners.map(|corner| corner * 0.97f64.powi(i));
    scene((0..n).map(scaled).collect())
}

fn scene(triangles: Vec<[DVec3; 3]>) -> Scene {
    let numbers = (0..triangles.len() as u32).map(|i| 3 * i);
    let vertices = triangles.into_iter().flatten().collect();
    let triangles = numbers.map(|i| [i, i + 1, i + 2]).collect();
    Scene::new(&Mesh { triangles, vertices, ..Mesh::default() })
}

/// Clusters of ever smaller triangles, one in the other.
fn clusters() -> Scene {
    let mut random = Pcg64::seed_from_u64(11);
    let triangle = |i: i32| {
        let size = 1e-6f64.powi(i / 50);
        let p = point(&mut random) * size;
        [0; 3].map(|_| p + point(&mut random) * size)
    };
    scene((0..200).map(triangle).collect())
}

fn scenes() -> impl Iterator<Item = Scene> {
    // The last is large enough to be divided.
    let sizes = [0, 1, 4, 5, 16, 17, 65, 3000, LARGE + 1];
    sizes.into_iter().map(soup).chain([nested(2000), clusters()])
}

fn wide<const N: usize>(scene: &Scene) -> Wide<N> {
    Wide::new(scene.triangles.clone(), Quality::FAST, &|_| ())
        .expect("memory for a test")
}

// Test that each triangle has a lane
fn check_lanes<const N: usize>(scene: &Scene, wide: &Wide<N>) {
    let triangles = scene.triangles.to_vec();
    let mut seen = vec![0; triangles.len()];
    let mut all = vec![];
    let mut note = |_: &Leaf, (_, slot), corners: &Triangle| {
        all.push((slot, *corners));
        false
    };
    let everywhere = [DVec3::MIN, DVec3::MAX];
    wide.any((0, wide.region), everywhere, &|_, _| true, &mut note);
    for (slot, corners) in all {
        let face = wide.leaves.face(slot);
        let number = scene.triangles.faces.binary_search(&face);
        let number = number.expect("a face of the scene");
        seen[number] += 1;
        assert_eq!(corners, triangles[number]);
        assert_eq!(wide.leaves.triangle(slot), corners);
    }
    assert!(seen.iter().all(|&times| times == 1));
}

/// The lanes with a child.
fn occupied<const N: usize>(
    node: &Node<N>,
) -> impl Iterator<Item = (usize, u32)> {
    let lanes = node.children.into_iter().enumerate();
    lanes.filter(|&(lane, _)| node.planes[0][lane].is_finite())
}

// Test that each child has a parent
fn check_children<const N: usize>(wide: &Wide<N>) {
    let mut nodes = vec![0; wide.nodes.len()];
    nodes[0] = 1;
    let mut ways = vec![0; wide.frames.len()];
    for (i, way) in wide.frames.iter().enumerate() {
        assert_eq!(way.node.is_some(), i % 2 == 0);
        way.node.into_iter().for_each(|root| nodes[root as usize] += 1);
    }
    for node in &wide.nodes {
        assert!(node.children.iter().all(|&child| {
            child & LEAF != 0 || (child as usize) < nodes.len()
        }));
        for (_, child) in occupied(node) {
            let (first, count) = slots(child);
            if child & LEAF == 0 {
                nodes[child as usize] += 1;
            } else if first >= FRAMES {
                ways[(first - FRAMES) as usize] += 1;
            } else {
                let end = UNIT * (first + units(count)) as usize;
                assert!(end <= wide.leaves.words.len());
            }
        }
    }
    assert!(nodes.iter().all(|&parents| parents == 1));
    assert!(ways.chunks(2).all(|pair| pair == [1, 0]));
}

// Test that boxes hold their content
fn holds(outer: &Aabb, inner: &Aabb) -> bool {
    outer.min.cmple(inner.min).all() && outer.max.cmpge(inner.max).all()
}

/// The box of a triangle, counted from the middle of a region, with its
/// padding.
fn padded(triangle: &Triangle, region: Region) -> Aabb {
    let (vertices, corners) = (&triangle[..], &[([0, 1, 2], 0)][..]);
    *Group { vertices, corners, region }.single(0).aabb()
}

/// The triangles below a child, after a check that `outer` holds them
/// all.
fn check_box<const N: usize>(
    wide: &Wide<N>,
    child: u32,
    region: Region,
    outer: Option<&Aabb>,
) -> Vec<Triangle> {
    let inside = |inner: &Aabb| outer.is_none_or(|o| holds(o, inner));
    if child & LEAF == 0 {
        let node = &wide.nodes[child as usize];
        let below = occupied(node).flat_map(|(lane, child)| {
            let own = node.bounds(lane);
            assert!(inside(&own));
            check_box(wide, child, region, Some(&own))
        });
        return below.collect();
    }
    let (first, count) = slots(child);
    let triangles: Vec<_> = if first >= FRAMES {
        let way = wide.frames[(first - FRAMES) as usize];
        let root = way.node.expect("a way in");
        check_box(wide, root, way.region, None)
    } else {
        // SAFETY: the child is a leaf.
        let leaf = unsafe { wide.leaves.leaf(first, count) };
        (0..count as u32).map(|lane| leaf.triangle(lane)).collect()
    };
    assert!(triangles.iter().all(|t| inside(&padded(t, region))));
    triangles
}

fn check_boxes<const N: usize>(scene: &Scene, wide: &Wide<N>) {
    for node in &wide.nodes {
        for i in (0..N).filter(|&i| node.planes[0][i].is_infinite()) {
            assert_eq!(node.bounds(i).max, Vec3A::NEG_INFINITY);
        }
    }
    let all = check_box(wide, 0, wide.region, None);
    assert_eq!(all.len(), scene.triangles.corners.len());
}

fn check_levels<const N: usize>() {
    let scene = soup(3000);
    for above in 0..3 {
        let triangles = scene.triangles.clone();
        let wide = Wide::under(triangles, Quality::FAST, above, &|_| ());
        check::<N>(&scene, &wide.expect("memory for a test"));
    }
}

#[test]
fn parts_are_joined_under_no_level_of_nodes_one_and_two() {
    check_levels::<8>();
    check_levels::<16>();
}

// Squares of a plain do not overlap; with a triangle as large as the scene
// in each, a ray meets most of them.
#[test]
fn a_scene_is_divided_unless_its_parts_overlap() {
    let grid =
        |i: u32| DVec3::new(f64::from(i % 364), f64::from(i / 364), 0.);
    let tile = |i| [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| grid(i) + p);
    let plain: Vec<Triangle> = (0..364 * 364).map(tile).collect();
    assert!(plain.len() > LARGE);
    let mut room = plain.clone();
    for triangle in room.iter_mut().step_by(37) {
        triangle[1] += DVec3::splat(364.);
    }
    let parts = |triangles| {
        let parts = Cell::new(0);
        let placed = |_| parts.set(parts.get() + 1);
        let triangles = scene(triangles).triangles;
        Wide::<16>::new(triangles, Quality::FAST, &placed).unwrap();
        parts.get()
    };
    assert_eq!(parts(plain), 16);
    assert_eq!(parts(room), 1);
}

#[test]
fn the_padding_is_not_lost_in_rounding() {
    let far = DVec3::splat(1e6);
    let o = DVec3::ZERO;
    for (zero, reach) in [(o, 8192.), (far, 1.), (far, 1e-9), (o, 0.)] {
        let region = Region::between(zero - reach, zero + reach);
        let corner = region.zero + region.reach;
        let bounds = padded(&[corner; 3], region);
        let place = region.zero.abs().max_element();
        let margin = 14. * 2f64.powi(-24) * region.reach
            + 2f64.powi(-48) * place
            - 2f64.powi(-40) * region.reach
            - 2f64.powi(-68) * place;
        let low = corner - region.zero - bounds.min.as_dvec3();
        let high = bounds.max.as_dvec3() + region.zero - corner;
        let rounded = 2f64.powi(-52) * place;
        assert!(low.min_element() >= margin && low.min_element() > 0.);
        assert!(high.min_element() >= margin - rounded);
    }
}

#[test]
fn clusters_within_clusters_are_regions_of_their_own() {
    let wide = wide::<8>(&clusters());
    let reach = |way: &NestedFrame| way.region.reach;
    let inner: Vec<_> = wide.frames.iter().step_by(2).map(reach).collect();
    let part = 2f64.powi(-16) * wide.region.reach;
    assert!(inner.iter().all(|&reach| reach < part));
    let least = inner.into_iter().fold(f64::INFINITY, f64::min);
    assert!(least < 2f64.powi(-48) * wide.region.reach, "{least}");
}

fn check<const N: usize>(scene: &Scene, wide: &Wide<N>) {
    check_lanes(scene, wide);
    check_children(wide);
    check_boxes(scene, wide);
}

#[test]
fn a_hierarchy_holds_each_triangle_once_in_padded_boxes_in_order() {
    for scene in scenes() {
        check::<8>(&scene, &wide(&scene));
        check::<16>(&scene, &wide(&scene));
    }
}

// Test the cut against all cuts
/// Computes the boxes of inner nodes, whose children come after them.
fn enclose(tree: &mut [Bvh2Node]) {
    for i in (0..tree.len()).rev() {
        if !tree[i].is_leaf() {
            let first = tree[i].first_index as usize;
            let bounds = tree[first].aabb().union(tree[first + 1].aabb());
            tree[i].set_aabb(bounds);
        }
    }
}

/// A random binary tree.
fn random_tree(leaves: usize, random: &mut Pcg64) -> Vec<Bvh2Node> {
    let mut tree = vec![Bvh2Node::default()];
    let mut todo = vec![(0, leaves)];
    while let Some((i, leaves)) = todo.pop() {
        if leaves == 1 {
            let [corner, size] = [0; 2].map(|_| point(random).as_vec3a());
            let bounds = Aabb::new(corner, corner + size * size);
            tree[i] = Bvh2Node::new(bounds, 1, 0);
            continue;
        }
        let (first, left) = (tree.len(), random.random_range(1..leaves));
        tree[i].make_inner(first as u32);
        tree.extend([Bvh2Node::default(); 2]);
        todo.extend([(first, left), (first + 1, leaves - left)]);
    }
    enclose(&mut tree);
    tree
}

/// The sets of nodes that represent the subtree of node `i`.
fn representations(tree: &[Bvh2Node], i: usize) -> Vec<Vec<usize>> {
    let mut all = vec![vec![i]];
    if !tree[i].is_leaf() {
        let first = tree[i].first_index as usize;
        let right = representations(tree, first + 1);
        for left in representations(tree, first) {
            all.extend(right.iter().map(|r| [&left[..], r].concat()));
        }
    }
    all
}

/// The least cost of what is below a wide root, by trying all.
fn least<const N: usize>(tree: &[Bvh2Node]) -> f32 {
    let mut costs = vec![0.; tree.len()];
    let mut least = 0.;
    for i in (0..tree.len()).rev() {
        let all = representations(tree, i);
        let triangles = all.iter().map(Vec::len).max().unwrap_or(0);
        let below = all
            .iter()
            .filter(|roots| (2..=N).contains(&roots.len()))
            .map(|roots| roots.iter().map(|&root| costs[root]).sum())
            .fold(f32::INFINITY, f32::min);
        let own = tree[i].aabb().half_area();
        (costs[i], least) = match triangles <= LANES {
            true => (own, below.min(own)),
            false => (own + below, below),
        };
    }
    least
}

fn check_cut<const N: usize>(leaves: usize, random: &mut Pcg64) {
    let tree = random_tree(leaves, random);
    let (vertices, corners) = (&[DVec3::ZERO][..], &[([0; 3], 0)][..]);
    let region = region(vertices, corners);
    let group = Group { vertices, corners, region };
    let (wide, _) = Wide::<N>::fill(&group, &tree).unwrap();
    let boxes = wide.nodes.iter().flat_map(|node| {
        occupied(node).map(|(lane, _)| node.bounds(lane).half_area())
    });
    let (cost, least) = (boxes.sum::<f32>(), least::<N>(&tree));
    assert!((cost - least).abs() < 1e-5 * least, "{cost} {least}");
}

#[test]
fn no_cut_costs_less_than_ours() {
    let mut random = Pcg64::seed_from_u64(7);
    for leaves in (1..=20).cycle().take(400) {
        check_cut::<8>(leaves, &mut random);
        check_cut::<16>(leaves, &mut random);
    }
}

// Test that deep trees are balanced
fn levels<const N: usize>(wide: &Wide<N>) -> usize {
    let mut levels = vec![1; wide.nodes.len()];
    for (i, node) in wide.nodes.iter().enumerate() {
        for (_, child) in occupied(node) {
            let (first, _) = slots(child);
            let below = if child & LEAF == 0 {
                child
            } else if first >= FRAMES {
                let way = wide.frames[(first - FRAMES) as usize];
                way.node.expect("a way in")
            } else {
                continue;
            };
            levels[below as usize] = levels[i] + 1;
        }
    }
    levels.into_iter().max().unwrap_or(0)
}

fn check_depth<const N: usize>() {
    let scene = nested(2000);
    let Triangles { vertices, corners, .. } = &scene.triangles;
    let corners: Vec<_> = corners.iter().map(|&c| (c, 0)).collect();
    let region = region(vertices, &corners);
    let group = Group { vertices, corners: &corners, region };
    let deep = chain(&group);
    let fits = |tree: &[Bvh2Node]| {
        let (_, levels) = Wide::<N>::fill(&group, tree).unwrap();
        N * levels + N <= STACK
    };
    assert!(!fits(&deep));
    assert!(fits(&balance(&deep)));
    assert!(N * levels(&wide::<N>(&scene)) + N <= STACK);
}

/// A tree with one triangle on one side of each node, and all that come
/// after it on the other.
fn chain(group: &Group) -> Vec<Bvh2Node> {
    let mut tree = vec![Bvh2Node::default()];
    let last = group.corners.len() - 1;
    for i in 0..last {
        tree[2 * i].make_inner(2 * i as u32 + 1);
        tree.extend([group.single(i as u32), Bvh2Node::default()]);
    }
    tree[2 * last] = group.single(last as u32);
    enclose(&mut tree);
    tree
}

#[test]
fn the_stack_suffices_for_nested_triangles() {
    check_depth::<8>();
    check_depth::<16>();
}
