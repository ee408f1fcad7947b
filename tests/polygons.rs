// Faces that are not convex (chapter "Polygons").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

/// The OBJ of one face with these corners.
pub fn face(corners: &[DVec3]) -> String {
    let vertex = |p: &DVec3| format!("v {:?} {:?} {:?}\n", p.x, p.y, p.z);
    let vertices: String = corners.iter().map(vertex).collect();
    let numbers = (1..=corners.len()).map(|i| format!(" {i}"));
    vertices + "f" + &numbers.collect::<String>() + "\n"
}

/// Points of a plane, as numbers with blanks between them.
fn points(text: &str) -> Vec<[f64; 2]> {
    let numbers = text.split(' ').map(|x| x.parse().unwrap());
    numbers.collect::<Vec<f64>>().as_chunks().0.to_vec()
}

fn read(corners: &[DVec3]) -> Mesh {
    read_obj(face(corners).as_bytes()).unwrap()
}

/// The sum of the areas of all triangles.
fn area(mesh: &Mesh) -> f64 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.vertices[i as usize]);
        0.5 * (b - a).cross(c - a).length()
    };
    mesh.triangles.iter().map(of).sum()
}

fn fan(n: u32) -> Vec<[u32; 3]> {
    (2..n).map(|i| [0, i - 1, i]).collect()
}

pub fn flat(points: &[[f64; 2]]) -> Vec<DVec3> {
    points.iter().map(|p| DVec3::new(p[0], p[1], 0.)).collect()
}

/// Whether the directed sides of the triangles, of which opposite ones
/// cancel, are those of the outline.
fn is_closed(mesh: &Mesh) -> bool {
    let mut sides = BTreeMap::new();
    let place = |i: u32| {
        mesh.vertices[i as usize].to_array().map(|x| (x + 0.).to_bits())
    };
    let mut add = |a: u32, b: u32, n: i32| {
        let (p, q) = (place(a), place(b));
        let (side, n) = if p < q { ((p, q), n) } else { ((q, p), -n) };
        *sides.entry(side).or_insert(0) += n;
    };
    for &[a, b, c] in &mesh.triangles {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            add(a, b, 1);
        }
    }
    let n = mesh.vertices.len() as u32;
    (0..n).for_each(|i| add(i, (i + 1) % n, -1));
    sides.iter().all(|((p, q), n)| p == q || *n == 0)
}

const L: [[f64; 2]; 6] =
    [[0., 0.], [2., 0.], [2., 1.], [1., 1.], [1., 2.], [0., 2.]];

/// A ring with `n` corners outside and inside, joined by a bridge.
fn ring(n: usize, inner: f64) -> Vec<DVec3> {
    let at = |i: usize, r: f64| {
        let (sin, cos) = (i as f64 * TAU / n as f64).sin_cos();
        DVec3::new(-1.146, r * cos + 2.4, r * sin + 2.35)
    };
    let outside = (0..=n).map(|i| at(i, 1.));
    let inside = (0..=n).rev().map(|i| at(i, inner));
    outside.chain(inside).collect()
}

#[test]
fn a_face_in_the_shape_of_an_l_is_filled_from_each_corner() {
    let turn = |p: DVec3, k: i32| match k {
        0 => p,
        1 => DVec3::new(p.y, p.z, p.x),
        2 => DVec3::new(p.z, p.x, p.y) + DVec3::new(1e6, -1e7, 0.25),
        3 => p * 1e200,
        4 => p * 1e-200,
        _ => DVec3::new(p.x, p.y, 0.5 * p.x + 0.25 * p.y),
    };
    for first in 0..6 {
        for k in 0..6 {
            let mut corners = flat(&L);
            corners.rotate_left(first);
            let corners: Vec<_> =
                corners.into_iter().map(|p| turn(p, k)).collect();
            for backwards in [false, true] {
                let mut corners = corners.clone();
                if backwards {
                    corners.reverse();
                }
                let mesh = read(&corners);
                let mut unit = mesh.clone();
                let scale = [1., 1., 1., 1e-200, 1e200, 1.][k as usize];
                unit.vertices.iter_mut().for_each(|p| *p *= scale);
                let slant = DVec3::new(0.5, 0.25, 1.).length();
                let expected = if k == 5 { 3. * slant } else { 3. };
                let found = area(&unit);
                assert!((found - expected).abs() < 1e-9, "{k}: {found}");
                assert_eq!(mesh.triangles.len(), 4);
                assert_eq!(mesh.joined, [1, 2, 3]);
                assert!(is_closed(&mesh));
            }
        }
    }
}

#[test]
fn a_convex_face_keeps_the_fan_around_its_first_corner() {
    for n in 3..60_u32 {
        for turn in 0..n.min(7) {
            let at = |i| f64::from(i + turn) * TAU / f64::from(n);
            let corner = |i| DVec3::new(at(i).cos(), 1e3, at(i).sin());
            let corners: Vec<_> = (0..n).map(corner).collect();
            assert_eq!(read(&corners).triangles, fan(n));
        }
    }
    // A slanted triangle with more corners on its sides, which rounding
    // has moved off them.
    let ends = [[0.1, 0.3], [2.7, 0.9], [0.7, 1.9]]
        .map(|[x, y]| DVec3::new(x, y, 0.3 * x - 0.7 * y + 1e3));
    let mut kept = [0; 2];
    for parts in [2, 3, 7, 10] {
        for shift in 0..parts {
            let side = |k: usize| {
                let part = move |i| f64::from(i) / f64::from(parts);
                let (a, b) = (ends[k], ends[(k + 1) % 3]);
                (0..parts).map(move |i| a.lerp(b, part(i)))
            };
            let mut corners: Vec<_> = (0..3).flat_map(side).collect();
            corners.rotate_left(shift as usize);
            let mesh = read(&corners);
            let of_fan = Mesh { triangles: fan(3 * parts), ..mesh.clone() };
            let all_have_area = with_area(&of_fan) == of_fan;
            if all_have_area {
                assert_eq!(mesh, of_fan, "{parts} {shift}");
            }
            kept[usize::from(all_have_area)] += 1;
            // The sides of triangles that the scene leaves out are no
            // sides there.
            assert!(is_closed(&with_area(&mesh)), "{parts} {shift}");
            assert!((area(&mesh) - area(&of_fan)).abs() < 1e-12);
        }
    }
    assert!(kept[0] > 0 && kept[1] > 0, "{kept:?}");
}

/// A mesh as a scene has it, without the triangles that have no area.
fn with_area(mesh: &Mesh) -> Mesh {
    let mut mesh = mesh.clone();
    let Mesh { vertices, triangles, .. } = &mut mesh;
    triangles.retain(|t| {
        let [a, b, c] = t.map(|i| vertices[i as usize]);
        cross(b - a, c - a) != DVec3::ZERO
    });
    mesh
}

/// Faces in a slanted plane, with the ends of a seam between triangles on
/// which a corner lies: of a square and two more beyond one of its sides, and
/// of faces that touch themselves there.
const SEAMS: [(&str, [[f64; 2]; 2]); 3] = [
    (
        "0 0 1 0 2 0 2 2 0 2,0 0 0 -2 1 -2 1 0,1 0 1 -2 2 -2 2 0",
        [[0., 0.], [2., 0.]],
    ),
    (
        "2 0 2 2 0 2 0 0 1 0,0 0 0 -2 1 -2 1 0,1 0 1 -2 2 -2 2 0",
        [[0., 0.], [2., 0.]],
    ),
    ("2 1 1 0 0 1 2 1 1 1 1 3", [[1., 1.], [2., 1.]]),
];

#[test]
fn no_ray_passes_where_a_corner_lies_on_a_side() {
    let mut random = Pcg64::seed_from_u64(1);
    for (faces, [p, q]) in SEAMS {
        // Integers, so that the corner is on the side exactly.
        let (right, up) = (DVec3::new(61., 19., 37.), [7., -53., 11.]);
        let place = |x: f64, y: f64| right * x + DVec3::from(up) * y;
        let mut text = String::new();
        for face in faces.split(',') {
            let corners = points(face);
            let vertex = |&[x, y]: &[f64; 2]| {
                let p = place(x, y);
                format!("v {} {} {}\n", p.x, p.y, p.z)
            };
            text.extend(corners.iter().map(vertex));
            let back = (1..=corners.len()).rev().map(|i| format!(" -{i}"));
            text += &format!("f{}\n", back.collect::<String>());
        }
        let (mesh, warnings) = read_file(text.as_bytes()).unwrap();
        assert_eq!(warnings, [], "{faces}");
        let scene = Scene::new(&mesh);
        let bvh = Bvh::new(&scene).unwrap();
        let [p, q] = [p, q].map(|[x, y]| {
            scene.frame.entrance(place(x, y)).place().unwrap()
        });
        let passed = (0..100_000).filter(|_| {
            let mut number = || 2. * random.random::<f64>() - 1.;
            let aim = p.lerp(q, 0.5 + 0.499 * number());
            let aside = DVec3::new(number(), number(), number());
            let origin = aim + aside * 4096.;
            let direction = (aim - origin).normalize();
            !bvh.is_occluded(&Ray { origin, direction }, None)
        });
        assert_eq!(passed.count(), 0, "{faces}");
    }
}

// Seen along the normal, the second corner lies on the side between the last
// two; in space it does not.
#[test]
fn a_corner_beside_a_side_in_space_does_not_divide_it() {
    let corners = [
        DVec3::new(988085598.8, 9151., -9e10),
        DVec3::new(0., -9.98e16, 8.8355e22),
        DVec3::new(8.116e23, 0., 9.15e16),
        DVec3::new(0., -1.09e12, 9.80e23),
        DVec3::new(0., -1.998e22, 9.3e8),
    ];
    assert_eq!(read(&corners).triangles, fan(5));
}

#[test]
fn faces_that_touch_themselves_are_filled() {
    // A hole that touches the outside at the corner (4, 2) in a side,
    // corners that are given twice, and a side that goes forth and back.
    for (outline, expected) in [
        ("4 0 4 4 0 4 0 0 4 0 4 2 1 1 1 3 4 2", 13.),
        ("2 1 2 1 0 0 0 0 4 0 4 0 2 3 2 3", 4.),
        ("2 0 2 1 1 1 1 2 0 2 0 0 1 0.5 0 0", 3.),
        ("2 1 0 0 4 0 2 3", 4.),
    ] {
        let text = face(&flat(&points(outline)));
        let (mesh, warnings) = read_file(text.as_bytes()).unwrap();
        assert_eq!(warnings, [], "{outline}");
        assert_eq!(area(&mesh), expected, "{outline}");
    }
}

/// The warning about a text, if there is one.
fn warning(text: &str) -> Option<String> {
    let (_, warnings) = read_file(text.as_bytes()).unwrap();
    assert!(warnings.len() < 2, "{warnings:?}");
    let first = warnings.into_iter().next()?;
    Some(first.of_file("x").to_string())
}

#[test]
fn odd_faces_are_counted_with_the_line_of_the_first() {
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 1 1 0.6\n\
                  v 1 1 0.24\nv 2 0 0\nv 0.5 0.25 0\n";
    let plain = "f 1 2 3 4\nf 1 2 6 4\nf 1 1 2 2\nf 1 2 7 2\nf 1 2 8 4\n";
    assert_eq!(warning(&format!("{square}{plain}")), None);
    let odd = "f 1 3 2 4\n# f\nf 1 2 5 \\\n 4\nf 1 2 5 4\n";
    let words = "x:14: the first of 3 odd faces, bent or crossed; \
                 other programs may fill them differently";
    let found = warning(&format!("{square}{plain}{odd}{plain}"));
    assert_eq!(found.unwrap(), words);
    let pentagram = "v 0 3 0\nv 2 -3 0\nv -3 1 0\nv 3 1 0\nv -2 -3 0\n\
                     f 1 2 3 4 5\n";
    assert_eq!(read_obj(pentagram.as_bytes()).unwrap().triangles, fan(5));
    let found = warning(pentagram).unwrap();
    assert!(found.starts_with("x:6: the first of 1 odd faces, "));
}

#[test]
fn a_face_of_a_hundred_thousand_corners_takes_no_time_in_its_square() {
    let n = 100_000;
    let star = |i: usize| {
        let r = 1. + (i * 7919 % 1000) as f64 / 1000.;
        let (sin, cos) = (i as f64 * TAU / n as f64).sin_cos();
        DVec3::new(r * cos, 3., r * sin)
    };
    let star: Vec<_> = (0..n).map(star).collect();
    let comb = |i: usize| {
        let top =
            if i.is_multiple_of(2) { 0. } else { 1e3 + (i % 97) as f64 };
        DVec3::new((n - i) as f64, top, 0.)
    };
    let ends = flat(&[[-1., -1.], [n as f64, -1.]]);
    let comb: Vec<_> = ends.into_iter().chain((2..n).map(comb)).collect();
    let l = flat(&L);
    let on_side = |i: usize| {
        let (side, part) = (i * 6 / n, (i * 6 % n) as f64 / n as f64);
        l[(side + 1) % 6].lerp(l[(side + 2) % 6], part)
    };
    let l: Vec<_> = (0..n).map(on_side).collect();
    let ring = ring(n / 2, 0.9);
    for corners in [star, comb, l, ring] {
        let text = face(&corners);
        let start = Instant::now();
        let (mesh, warnings) = read_file(text.as_bytes()).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        assert_eq!(warnings, []);
        assert_eq!(mesh.triangles.len(), corners.len() - 2);
        assert!(is_closed(&mesh));
        // Optimised and alone on the machine it takes a tenth of that; in
        // the square of the corners it would take longer.
        assert!(seconds < 4., "{seconds}");
    }
}
