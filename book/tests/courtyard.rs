//! The courtyard and the room keep their promises: closed solids that look
//! outwards and share no plane of contact, and the same bytes everywhere.

use std::collections::{HashMap, HashSet};

use litpt_book::courtyard;
use litpt_book::room::room;
use litpt_book::sweep::{Point, Solid, write_obj};

/// FNV-1a of both OBJs; a change of a scene changes its number.
const CHECKSUMS: [u64; 2] = [0x8ebc_cd72_dfc0_0d8f, 0x0776_55b2_3945_c7da];

/// Least volume of a solid and least area of a triangle, in metres.
const LEAST: [[f64; 2]; 2] = [[1e-5, 1e-6], [1e-6, 1e-8]];

fn scenes() -> [Vec<Solid>; 2] {
    [courtyard::solids(), room().solids]
}

fn obj(scene: &[Solid]) -> String {
    let mut text = Vec::new();
    write_obj(scene, &mut text).unwrap();
    String::from_utf8(text).unwrap()
}

/// The scenes as readers of the OBJs have them.
fn read() -> [Vec<Solid>; 2] {
    scenes().map(|scene| parse(&obj(&scene)))
}

/// Their solids, each with what is least in its scene.
fn solids_and_least() -> impl Iterator<Item = (Solid, [f64; 2])> {
    let pairs = read().into_iter().zip(LEAST);
    pairs.flat_map(|(scene, least)| {
        scene.into_iter().map(move |s| (s, least))
    })
}

/// The scene as a reader of the OBJ sees it: rounded, indices from zero.
fn parse(text: &str) -> Vec<Solid> {
    let mut parsed: Vec<Solid> = vec![];
    let mut first = 1;
    for line in text.lines() {
        let (key, rest) = line.split_once(' ').unwrap();
        let words: Vec<&str> = rest.split(' ').collect();
        if key == "o" {
            first += parsed.last().map_or(0, |s| s.vertices.len() as u32);
            let name = rest.to_string();
            parsed.push(Solid {
                name,
                vertices: vec![],
                triangles: vec![],
            });
            continue;
        }
        let last = parsed.len().wrapping_sub(1);
        match (key, &words[..]) {
            ("#", _) => {}
            ("v", [x, y, z]) => parsed[last]
                .vertices
                .push([x, y, z].map(|w| w.parse().unwrap())),
            ("f", [a, b, c]) => parsed[last]
                .triangles
                .push([a, b, c].map(|w| w.parse::<u32>().unwrap() - first)),
            _ => panic!("unexpected line: {line}"),
        }
    }
    parsed
}

fn sub(a: Point, b: Point) -> Point {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Corners of every triangle of a solid.
fn corners(solid: &Solid) -> impl Iterator<Item = [Point; 3]> {
    solid.triangles.iter().map(|t| t.map(|i| solid.vertices[i as usize]))
}

/// Twice the area times the normal.
fn normal([a, b, c]: [Point; 3]) -> Point {
    cross(sub(b, a), sub(c, a))
}

/// Directed edges that do not occur once, with their reverse once.
fn unmatched_edges(solid: &Solid) -> usize {
    let mut edges: HashMap<(u32, u32), usize> = HashMap::new();
    for &[a, b, c] in &solid.triangles {
        for edge in [(a, b), (b, c), (c, a)] {
            *edges.entry(edge).or_default() += 1;
        }
    }
    let once = |edge: (u32, u32)| edges.get(&edge) == Some(&1);
    edges.keys().filter(|&&(a, b)| !once((a, b)) || !once((b, a))).count()
}

#[test]
fn every_solid_is_closed_and_consistently_oriented() {
    for solid in read().into_iter().flatten() {
        assert_eq!(unmatched_edges(&solid), 0, "{}", solid.name);
    }
}

#[test]
fn a_missing_or_reversed_triangle_is_noticed() {
    let mut solid = courtyard::solids().swap_remove(0);
    let last = solid.triangles.pop().unwrap();
    assert_eq!(unmatched_edges(&solid), 3);
    solid.triangles.push([last[1], last[0], last[2]]);
    assert_ne!(unmatched_edges(&solid), 0);
}

#[test]
fn every_solid_has_a_positive_volume() {
    for (solid, [least, _]) in solids_and_least() {
        // The first vertex as origin keeps the sum free of cancellation.
        let origin = solid.vertices[0];
        let volume: f64 = corners(&solid)
            .map(|t| t.map(|p| sub(p, origin)))
            .map(|[a, b, c]| dot(a, cross(b, c)) / 6.0)
            .sum();
        assert!(volume > least, "{}: {volume} m3", solid.name);
    }
}

#[test]
fn no_triangle_is_degenerate_after_rounding() {
    for (solid, [_, least]) in solids_and_least() {
        for t in corners(&solid) {
            let n = normal(t);
            let area = dot(n, n).sqrt() / 2.0;
            assert!(area > least, "{}: {t:?} has {area} m2", solid.name);
        }
    }
}

#[test]
fn vertices_of_a_solid_stay_different_after_rounding() {
    for solid in read().into_iter().flatten() {
        let places = solid.vertices.iter().map(|p| p.map(f64::to_bits));
        let different: HashSet<_> = places.collect();
        assert_eq!(different.len(), solid.vertices.len(), "{}", solid.name);
    }
}

/// A triangle's plane, rounded and without its sense, to group by.
fn plane(t: [Point; 3]) -> [i64; 4] {
    let n = normal(t);
    let length = dot(n, n).sqrt();
    let lead = n.iter().find(|c| c.abs() > 1e-3 * length).unwrap();
    let n = n.map(|c| c / length * lead.signum());
    let round = |x: f64| (x * 2e3).round() as i64;
    [round(n[0]), round(n[1]), round(n[2]), round(dot(n, t[0]))]
}

/// Whether two triangles of one plane overlap by more than a millimetre.
fn overlap(s: [Point; 3], t: [Point; 3]) -> bool {
    let n = normal(s);
    let apart = |u: [Point; 3]| {
        (0..3).any(|i| {
            let axis = cross(n, sub(u[(i + 1) % 3], u[i]));
            let length = dot(axis, axis).sqrt();
            let low = |v: [Point; 3]| {
                v.map(|p| dot(axis, p) / length)
                    .into_iter()
                    .fold(f64::INFINITY, f64::min)
            };
            let high = |v: [Point; 3]| -low(v.map(|p| p.map(|c| -c)));
            high(s) < low(t) + 1e-3 || high(t) < low(s) + 1e-3
        })
    };
    !apart(s) && !apart(t)
}

/// The kinds of solids that overlap in a common plane, with the plane.
fn overlaps(scene: &[Solid]) -> HashSet<(String, String, [i64; 4])> {
    let mut planes: HashMap<[i64; 4], Vec<(usize, [Point; 3])>> =
        HashMap::new();
    for (i, solid) in scene.iter().enumerate() {
        for t in corners(solid) {
            planes.entry(plane(t)).or_default().push((i, t));
        }
    }
    let mut found = HashSet::new();
    for group in planes.values() {
        for (k, &(i, s)) in group.iter().enumerate() {
            for &(j, t) in &group[k + 1..] {
                if i != j && overlap(s, t) {
                    let kind = |i: usize| {
                        scene[i].name.split('.').next().unwrap().to_string()
                    };
                    found.insert((kind(i), kind(j), plane(t)));
                }
            }
        }
    }
    found
}

#[test]
fn no_two_solids_overlap_in_a_common_plane() {
    for scene in read() {
        let found = overlaps(&scene);
        assert!(found.is_empty(), "{found:?}");
    }
}

#[test]
fn overlapping_triangles_of_one_plane_are_noticed() {
    let t = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let by = |x: f64| t.map(|p| [p[0] + x, p[1], p[2]]);
    assert!(overlap(t, by(0.5)));
    assert!(!overlap(t, by(1.5)));
}

#[test]
fn the_scenes_have_some_ten_thousands_of_triangles() {
    for (scene, least) in scenes().iter().zip([60_000, 50_000]) {
        let count: usize = scene.iter().map(|s| s.triangles.len()).sum();
        assert!((least..100_000).contains(&count), "{count}");
    }
}

#[test]
fn two_runs_write_the_recorded_bytes() {
    for ((a, b), sum) in scenes().iter().zip(&scenes()).zip(CHECKSUMS) {
        let text = obj(a);
        assert!(text == obj(b));
        let fnv = text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        assert_eq!(fnv, sum, "the scene is now {fnv:#018x}");
    }
}

#[test]
fn the_obj_reads_back_as_the_same_scene() {
    for (written, read) in scenes().iter().zip(read()) {
        assert_eq!(written.len(), read.len());
        for (a, b) in written.iter().zip(&read) {
            assert_eq!((&a.name, &a.triangles), (&b.name, &b.triangles));
            assert_eq!(a.vertices.len(), b.vertices.len());
            for (p, q) in a.vertices.iter().zip(&b.vertices) {
                let near =
                    (0..3).all(|k| (p[k] - q[k]).abs() <= 0.500_001e-5);
                assert!(near, "{}: {p:?} {q:?}", a.name);
            }
        }
    }
}

#[test]
fn solids_have_different_names() {
    for scene in scenes() {
        let names: HashSet<_> = scene.iter().map(|s| &s.name).collect();
        assert_eq!(names.len(), scene.len());
    }
}
