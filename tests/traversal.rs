// All sets of instructions answer with the same bits (chapter "The walk").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use litpt_book::solids::{cube, icosphere};

/// Rays per scene.
const RAYS: usize = 40_000;

/// Triangles anywhere; two of three lie in a plane of constant x, y or z.
fn soup() -> Mesh {
    let mut random = Pcg64::seed_from_u64(3);
    apart((0..3000).map(|i| {
        let (centre, flat) = (in_cube(&mut random), i % 9);
        [0; 3].map(|_| {
            let mut corner = centre + 0.1 * in_cube(&mut random);
            if flat < 6 {
                // Many in the same plane, so that boxes touch.
                corner[flat % 3] = (4. * centre[flat % 3]).round() / 4.;
            }
            corner
        })
    }))
}

/// A soup with small ones in it, which have nested frames.
fn clusters() -> Mesh {
    let mut mesh = soup();
    let at = mesh.vertices[5];
    for scale in [1e-6, 1e-8] {
        solids::add(&mut mesh, &soup(), |v| at + scale * v);
    }
    mesh
}

/// A point of the scene: a vertex, a point of an edge or of a triangle, the
/// middle, or any.
fn place(triangles: &[Triangle], random: &mut Pcg64) -> DVec3 {
    let anywhere = 4096. * in_cube(random);
    if triangles.is_empty() {
        return anywhere;
    }
    let [a, b, c] = triangles[random.random_range(0..triangles.len())];
    let (s, t) = (random.random::<f64>(), random.random::<f64>());
    match random.random_range(0..6) {
        0 => a,
        1 => (a + b) / 2.,
        2 => a + s * (b - a),
        3 => a + s * (b - a) + (1. - s) * t * (c - a),
        4 => DVec3::ZERO,
        _ => anywhere,
    }
}

/// Zeros of both signs, numbers too small for single precision, and others
/// that leave the direction almost parallel to a plane.
const SMALL: [f64; 10] =
    [0., -0., 5e-324, -5e-324, 1e-40, -1e-40, 1e-19, -1e-15, 1e-8, -1e-5];

/// A ray from one place to another, or with small components.
fn ray(triangles: &[Triangle], random: &mut Pcg64) -> Ray {
    let mut origin = place(triangles, random);
    let mut direction = place(triangles, random) - origin;
    if direction == DVec3::ZERO || random.random_range(0..4) == 0 {
        direction = in_cube(random);
    }
    for _ in 0..random.random_range(0..3) {
        let axis = random.random_range(0..3);
        direction[axis] = SMALL[random.random_range(0..SMALL.len())];
    }
    if direction.length() < 1e-3 {
        direction = DVec3::X;
    }
    if random.random_range(0..4) == 0 {
        // In the plane of a box.
        let corner = place(triangles, random).x as f32;
        let padding = [0., 1. / 128., -1. / 128.];
        origin.x = (corner + padding[random.random_range(0..3)]).into();
    }
    Ray { origin, direction: direction.normalize() }
}

fn bits(hit: Option<Hit>) -> Option<[u64; 6]> {
    let hit = hit?;
    let numbers = [hit.point.to_array(), hit.normal.to_array()].concat();
    Some(std::array::from_fn(|i| numbers[i].to_bits()))
}

/// What a ray meets first, and then one that leaves the triangle.
fn two_hits(
    bvh: &Bvh,
    ray: &Ray,
    direction: DVec3,
) -> [Option<[u64; 6]>; 2] {
    let hit = bvh.first_hit(ray, None);
    assert_eq!(bvh.is_occluded(ray, None), hit.is_some(), "{ray:?}");
    assert_is_first(bvh, ray, None, hit);
    let second = hit.and_then(|hit| {
        let onward = Ray { origin: hit.point, direction };
        let from = Some(hit.primitive);
        let second = bvh.first_hit(&onward, from);
        let blocked = bvh.is_occluded(&onward, from);
        assert_eq!(blocked, second.is_some(), "{onward:?}");
        assert_is_first(bvh, &onward, from, second);
        // What it meets is not visible from elsewhere.
        let other = second.map_or(hit.primitive, |hit| hit.primitive);
        let visible = bvh.is_visible(ray, None, other);
        assert_eq!(visible, other == hit.primitive, "{ray:?}");
        second
    });
    [hit, second].map(bits)
}

#[test]
fn all_instructions_answer_rays_with_the_same_bits() {
    let meshes = [
        cube(16),
        icosphere(3),
        soup(),
        clusters(),
        doubled(cube(8)),
        doubled(soup()),
        doubled(clusters()),
        cavity(0.2, 24),
        apart([[DVec3::X, DVec3::Y, DVec3::NEG_Z]].into_iter()),
        Mesh::default(),
    ];
    for (i, mesh) in meshes.iter().enumerate() {
        let scene = Scene::new(mesh);
        let with =
            |isa: Isa| Bvh::with(&scene, Quality::THOROUGH, isa).ok();
        let intersectors: Vec<_> =
            Isa::ALL.into_iter().filter_map(with).collect();
        let (portable, others) = intersectors.split_last().unwrap();
        let all = scene.triangles.to_vec();
        let mut random = Pcg64::seed_from_u64(i as u64);
        let mut hits = 0;
        for _ in 0..RAYS {
            let ray = ray(&all, &mut random);
            let next = in_cube(&mut random).normalize();
            let expected = two_hits(portable, &ray, next);
            hits += usize::from(expected[0].is_some());
            for other in others {
                let found = two_hits(other, &ray, next);
                assert_eq!(found, expected, "{i}: {ray:?}");
            }
        }
        match all.len() {
            0 => assert_eq!(hits, 0),
            _ => assert!(hits > RAYS / 20, "{i}: {hits}"),
        }
    }
}

/// Rays side by side, from nothing to far apart, some of them missing.
fn beam(triangles: &[Triangle], random: &mut Pcg64) -> [Option<Ray>; BEAM] {
    let scales = [0., 1e-15, 1e-9, 1e-5, 1e-2, 1.];
    let Ray { origin, direction } = ray(triangles, random);
    let apart = 4096. * scales[random.random_range(0..5)];
    let spread = scales[random.random_range(0..6)];
    std::array::from_fn(|_| {
        let origin = origin + apart * in_cube(random);
        let direction = direction + spread * in_cube(random);
        let ray = Ray { origin, direction: direction.normalize() };
        (random.random_range(0..8) > 0).then_some(ray)
    })
}

#[test]
fn rays_of_a_beam_are_answered_as_if_alone() {
    let empty = Mesh::default();
    for mesh in
        [cube(16), icosphere(3), soup(), clusters(), cavity(0.2, 24), empty]
    {
        let scene = Scene::new(&mesh);
        let all = scene.triangles.to_vec();
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            let bvh = Bvh::with(&scene, Quality::FAST, isa).unwrap();
            let mut random = Pcg64::seed_from_u64(11);
            let mut hits = 0;
            for _ in 0..10_000 {
                let rays = beam(&all, &mut random);
                let together = bvh.first_hits(&rays);
                for (ray, hit) in rays.into_iter().zip(together) {
                    let alone =
                        ray.and_then(|ray| bvh.first_hit(&ray, None));
                    assert_eq!(bits(hit), bits(alone), "{isa}: {ray:?}");
                    hits += usize::from(hit.is_some());
                }
            }
            match all.len() {
                0 => assert_eq!(hits, 0),
                _ => assert!(hits > 10_000, "{isa}: {hits}"),
            }
        }
    }
}

#[test]
fn a_ray_of_nonsense_meets_nothing() {
    let scene = Scene::new(&cube(3));
    let odd = [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e300, -3e19];
    let o = DVec3::ZERO;
    let origins = odd.map(|x| [o.with_x(x), o.with_y(x), o.with_z(x)]);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        let intersector = Bvh::with(&scene, Quality::FAST, isa).unwrap();
        let hit = |origin, direction| {
            let ray = Ray { origin, direction };
            let hit = intersector.first_hit(&ray, None);
            assert_eq!(intersector.is_occluded(&ray, None), hit.is_some());
            hit.is_some()
        };
        for direction in [DVec3::X, DVec3::NAN, DVec3::ZERO] {
            for &origin in origins.as_flattened() {
                assert!(!hit(origin, direction), "{origin} {direction}");
            }
            assert_eq!(hit(o, direction), direction == DVec3::X);
        }
        // Empty slots must not be entered, though 1/d is zero.
        for direction in [f64::INFINITY, 1e300, 1e39, -1e39, 1e20] {
            assert!(!hit(o, DVec3::splat(direction)));
        }
    }
}

/// Only the triangle that a ray meets first is visible, and no other.
fn assert_is_first(
    intersector: &Bvh,
    ray: &Ray,
    from: Option<u32>,
    hit: Option<Hit>,
) {
    let visible = |target| intersector.is_visible(ray, from, target);
    assert!(!from.is_some_and(visible), "{ray:?}");
    let Some(hit) = hit else { return };
    assert!(visible(hit.primitive), "{ray:?}");
    // Those that the ray meets behind it are not.
    let onward = Ray { origin: hit.point + 1e-9 * ray.direction, ..*ray };
    if let Some(next) = intersector.first_hit(&onward, Some(hit.primitive))
    {
        let expected = next.primitive == hit.primitive;
        assert_eq!(visible(next.primitive), expected, "{ray:?}");
    }
}

/// A mesh with each triangle twice, the second time as another face, and
/// with its corners in another order.
fn doubled(mut mesh: Mesh) -> Mesh {
    let again = mesh.triangles.clone().into_iter();
    mesh.triangles.extend(again.map(|[a, b, c]| [b, c, a]));
    mesh
}
