// Reading and placing a scene (chapter "The scene"), and cameras.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use crate::random::{Random, any_of};
use crate::render_loop::with_threads;

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn the_pyramid_of_the_book_has_the_sides_that_the_book_says() {
    let text = "v 0 0 0\nv 2 0 0\nf 1 2 -1\nv 2 2 0\nv 0 2 0\n\
                f 2/1 3/2 \\\n  5\nv 1 1 3\nf 3 4 5\nf -2 1 -1\n";
    let sides = [[0, 1, 1], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
    for size in [1, 15, 30, 999] {
        let (mesh, _) = read_pieces(text.as_bytes(), size).unwrap();
        assert_eq!(mesh.triangles, sides);
    }
}

/// A number of 1 to 24 digits, often with a point or an exponent.
fn number(random: &mut Random) -> String {
    let mut word = any_of(&["", "", "-", "+"], random).to_owned();
    let digits = random.random_range(1..25);
    let point = random.random_range(0..2 * digits);
    for i in 0..digits {
        word.push_str(if i == point { "." } else { "" });
        word.push_str(any_of(&["0", "1", "3", "5", "8", "9"], random));
    }
    word + any_of(&["", "", "", "e-7", "E3", "e+12", "e-300"], random)
}

/// A text that other readers accept as well: each face names vertices,
/// texture coordinates and normals that came before it.
fn random_text(random: &mut Random) -> String {
    let mut text = String::new();
    let mut n = [0, 0, 0];
    let ends = ["\n", "\n", "\r\n", " \n", "\t\n"];
    for _ in 0..3 + random.random_range(0..60) {
        match if n[0] < 3 { 0 } else { random.random_range(0..9) } {
            0..3 => {
                n[0] += 1;
                text += &format!("v {} ", number(random));
                text += &[number(random), number(random)].join("\t");
                text += any_of(&["", "", "", " 1", " 1.0"], random);
            }
            3 => {
                n[1] += 1;
                text += "vt 0.5 0.25";
            }
            4 => {
                n[2] += 1;
                text += "vn 0 0 1";
            }
            5 => {
                let noise = ["g a b", "o c", "s 1", "# f 1 2", "", "foo"];
                text += any_of(&noise, random);
            }
            _ => text += &random_face(random, n),
        }
        text += any_of(&ends, random);
    }
    text
}

fn random_face(random: &mut Random, n: [usize; 3]) -> String {
    let mut index = |n: usize| {
        let i = 1 + random.random_range(0..n);
        let back = -((1 + n - i) as i64);
        if random.random_range(0..2) == 0 { i as i64 } else { back }
    };
    let [v, t, m] = n;
    let mut corner = || match (t, m) {
        (0, 0) => format!(" {}", index(v)),
        (_, 0) => format!(" {}/{}", index(v), index(t)),
        (0, _) => format!(" {}//{}", index(v), index(m)),
        _ => format!(" {}/{}/{}", index(v), index(t), index(m)),
    };
    let first = [corner(), corner(), corner()].concat();
    let more = index(5).unsigned_abs() - 1;
    let more: String =
        (0..more).map(|_| index(v).to_string() + " ").collect();
    format!("f{first} {more}")
}

/// What the crate tobj reads: the corners of all triangles, in order.
fn by_tobj(text: &str) -> Result<Vec<[[u64; 3]; 3]>, tobj::LoadError> {
    let options =
        tobj::LoadOptions { triangulate: true, ..Default::default() };
    let none = |_: &std::path::Path| Ok(Default::default());
    let (models, _) =
        tobj::load_obj_buf(&mut text.as_bytes(), &options, none)?;
    let corner = |mesh: &tobj::Mesh, i: u32| {
        [0, 1, 2].map(|k| mesh.positions[3 * i as usize + k].to_bits())
    };
    let of_model = |tobj::Model { mesh, .. }| {
        let triangle = |t: &[u32]| [0, 1, 2].map(|k| corner(&mesh, t[k]));
        mesh.indices.chunks(3).map(triangle).collect::<Vec<_>>()
    };
    Ok(models.into_iter().flat_map(of_model).collect())
}

/// How much more area, as a vector, some triangles have than others, in
/// units of the longest side of the others' box squared.
fn more_area(some: &[[[u64; 3]; 3]], others: &[[[u64; 3]; 3]]) -> DVec3 {
    let place = |p: [u64; 3]| DVec3::from_array(p.map(f64::from_bits));
    let corners = others.as_flattened().iter().map(|&p| place(p));
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) =
        corners.fold(none, |(low, high), p| (low.min(p), high.max(p)));
    let size = (high - low).max_element();
    let area = |&corners: &[[u64; 3]; 3]| {
        let [a, b, c] = corners.map(|p| (place(p) - low) / size);
        (b - a).cross(c - a)
    };
    let sum = |all: &[_]| all.iter().map(area).sum::<DVec3>();
    sum(some) - sum(others)
}

/// The triangles of each face, given the face of each triangle.
fn by_face<T: Copy>(triangles: &[T], faces: &[u32]) -> Vec<Vec<T>> {
    let count = faces.last().map_or(0, |&last| last as usize + 1);
    let mut all = vec![vec![]; count];
    for (triangle, face) in triangles.iter().zip(faces) {
        all[*face as usize].push(*triangle);
    }
    all
}

#[test]
fn random_texts_give_the_triangles_that_the_crate_tobj_reads() {
    let mut random = Random::seed_from_u64(1);
    let (mut total, mut others) = (0, 0);
    let mut apart = 0;
    for _ in 0..3000 {
        let text = random_text(&mut random);
        let theirs = by_tobj(&text).expect(&text);
        if theirs.is_empty() {
            let error = read_obj(text.as_bytes()).unwrap_err().to_string();
            assert!(error.contains("no face"));
            continue;
        }
        let mesh = read_obj(text.as_bytes()).unwrap();
        let place = |i: u32| mesh.vertices[i as usize].to_array();
        let bits = |i: u32| place(i).map(f64::to_bits);
        let ours: Vec<_> =
            mesh.triangles.iter().map(|t| t.map(bits)).collect();
        total += ours.len();
        // Compare the faces one by one
        let fans = text.lines().filter(|line| line.starts_with("f "));
        let fans = fans.map(|line| line.split_whitespace().count() - 3);
        let fans = fans.zip(0..).flat_map(|(n, face)| vec![face; n]);
        let theirs = by_face(&theirs, &fans.collect::<Vec<_>>());
        let ours = by_face(&ours, &mesh.faces());
        assert_eq!(ours.len(), theirs.len(), "{text}");
        for (ours, theirs) in ours.iter().zip(&theirs) {
            if ours == theirs {
                continue;
            }
            // The face is not convex: it covers as much as before, if its
            // outline winds around nothing twice.
            others += 1;
            assert!(theirs.len() > 1, "{text}");
            let corners: BTreeSet<_> =
                theirs.as_flattened().iter().collect();
            if corners.len() == theirs.len() + 2 {
                let more = more_area(ours, theirs).length();
                // With u = 2^-53: coordinates within 1 are wrong by 2 u,
                // their differences by 5 u, products by 11 u, a component
                // of an area by 23 u, and each of n sums by n u more; the
                // length is less than twice the largest component.
                let n = (ours.len() + theirs.len()) as f64;
                let error = n * (23. + n) * f64::EPSILON;
                assert!(more <= error, "{more:e} {text}");
                apart += 1;
            }
        }
    }
    assert!(total > 50_000, "{total}");
    assert!(others > 100 && apart > 50, "{others} {apart}");
}

#[test]
fn a_text_reads_the_same_in_pieces_of_any_size() {
    let mut random = Random::seed_from_u64(2);
    let mut read = (0, 0);
    for round in 0..400 {
        let mut text = random_text(&mut random);
        // Lines continue, with blanks after the backslash or without.
        let goes_on =
            ["1 \\\n", "1 \\ \r\n", "1\\\r\r\n", "1\\\n\\\r \\\n"];
        text = text.replace("1 ", any_of(&goes_on, &mut random));
        let ends = ["\n", "\r", "\n\n  ", "\r\n\u{feff}", " # c:\\\n"];
        text = text.replace("0\n", any_of(&ends, &mut random));
        if round % 2 == 0 {
            let odd = "v 1 x 2\n|f 1 2\n|v 1 nan 2\n|f 1 2 999|\r\r\n|\
                       # c:\\\n|\nl 1 \\\n 2\n|\nfoo \\\n|\u{1a}|\0";
            let odd: Vec<_> = odd.split('|').collect();
            let at = text.len() - random.random_range(0..text.len());
            text.insert_str(at, any_of(&odd, &mut random));
        }
        let pieces = |size| {
            read_pieces(text.as_bytes(), size).map_err(|e| e.to_string())
        };
        let whole = pieces(text.len());
        let read_whole = read_file(text.as_bytes());
        assert_eq!(read_whole.map_err(|e| e.to_string()), whole);
        read.0 += usize::from(whole.is_ok());
        read.1 += whole.iter().flat_map(|(_, warnings)| warnings).count();
        for size in [0, 1, 2, 3, 5, 16, 100] {
            assert_eq!(pieces(size), whole, "{size}: {text}");
        }
    }
    assert!(read.0 > 100 && read.1 > 50, "{read:?}");
}

#[test]
fn a_text_reads_the_same_on_any_number_of_threads() {
    let mut random = Random::seed_from_u64(3);
    let text: String = (0..50).map(|_| random_text(&mut random)).collect();
    let wrong = text.clone() + "f 1 2\nf 1\n";
    let read = |threads| {
        with_threads(threads, || {
            let scene = |(mesh, _)| Scene::new(&mesh).triangles.to_vec();
            let right = read_pieces(text.as_bytes(), 40).map(scene);
            let wrong = read_pieces(wrong.as_bytes(), 40).unwrap_err();
            (right.unwrap(), wrong.to_string())
        })
    };
    let lines = text.lines().count();
    let (scene, error) = read(1);
    assert!(error.starts_with(&format!("line {}: ", lines + 1)));
    for threads in [2, 3, 8] {
        assert_eq!(read(threads), (scene.clone(), error.clone()));
    }
}

#[test]
fn a_long_run_of_blank_lines_takes_no_more_time_than_others() {
    // Were each end of a line to look back over all lines before it,
    // this would take minutes.
    let blank = "\\\n".to_owned() + &"\n".repeat(2_000_000);
    for text in ["# ", "f 1 2 3"] {
        let text = format!("{SQUARE}{text}{blank}f 1 2 3\n");
        let (mesh, _) = read_pieces(text.as_bytes(), 1).unwrap();
        assert_eq!(mesh.triangles.last(), Some(&[0, 1, 2]));
    }
}

#[test]
fn a_stray_vertex_does_not_change_the_scene() {
    let stray = format!("{SQUARE}f 1 2 3\nv 1e9 1e300 -7\n");
    let plain = format!("{SQUARE}f 1 2 3\n");
    let scene =
        |text: &str| Scene::new(&read_obj(text.as_bytes()).unwrap());
    let (stray, plain) = (scene(&stray), scene(&plain));
    assert_eq!(stray.triangles.to_vec(), plain.triangles.to_vec());
    let ray = |scene: &Scene| {
        scene.frame.entrance(DVec3::splat(9.)).enter(-DVec3::ONE)
    };
    assert_eq!(ray(&stray).unwrap().origin, ray(&plain).unwrap().origin);
}

/// Coordinates are whole numbers from 0 to 1024, of which a third of a unit,
/// in one corner of an axis, is rounded if the scene is moved along it.
#[test]
fn a_scene_is_moved_along_the_axes_that_round_no_corner() {
    for rounding in 0..8 {
        let rounds = [0, 1, 2].map(|axis| rounding >> axis & 1 != 0);
        let mut random = Random::seed_from_u64(rounding);
        let mut whole = || random.random_range(0..1025) as f64;
        let mut corner = |_| DVec3::new(whole(), whole(), whole());
        let mut vertices = Vec::from_iter((0..9000).map(&mut corner));
        (vertices[0], vertices[1]) = (DVec3::ZERO, DVec3::splat(1024.));
        for axis in (0..3).filter(|&axis| rounds[axis]) {
            vertices[3000 * axis + 1500][axis] = 1. / 3.;
        }
        let triangle = |i: u32| [0, 1, 2].map(|k| 3 * i + k);
        let triangles = (0..3000).map(triangle).collect();
        let mesh = Mesh { triangles, vertices, ..Mesh::default() };
        let placed = Scene::new(&mesh).triangles.to_vec();
        assert_eq!(placed.len(), 3000);
        let middle = DVec3::from(rounds.map(|r| if r { 0. } else { 512. }));
        let scale = (placed[0][1] - placed[0][0]).x / 1024.;
        assert_eq!(scale.log2().exp2(), scale);
        for (corner, vertex) in
            placed.as_flattened().iter().zip(&mesh.vertices)
        {
            assert_eq!(*corner, (vertex - middle) * scale, "{rounds:?}");
        }
    }
}

#[test]
fn the_triangles_with_area_keep_their_order() {
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    let in_line = "v .25 .25 .25\nv .5 .5 .5\n";
    let [some, all] = [
        "f 1 2 3\nf 1 3 4\nf 2 3 4\n",
        "f 1 2 3\nf 2 2 3\nf 5 1 6\nf 5 5 5\nf 1 3 4\nf 4 1 4\nf 2 3 4\n",
    ]
    .map(|faces| {
        let mesh = read_obj([corners, in_line, faces].concat().as_bytes());
        Scene::new(&mesh.unwrap()).triangles.to_vec()
    });
    assert_eq!((all.len(), all), (3, some));
}

#[test]
fn the_order_of_zeros_does_not_decide_the_sign_of_the_box() {
    let corner = |faces: &str| {
        let text = format!("v 1 0 -0\nv 0 1 0\nv 0 0 0\n{faces}");
        let scene = Scene::new(&read_obj(text.as_bytes()).unwrap());
        let triangles = scene.triangles.to_vec();
        let mut corners = triangles.as_flattened().iter();
        let far = corners.find(|p| p.x > p.y && p.x > 0.);
        far.unwrap().to_array().map(f64::to_bits)
    };
    let expected = corner("f 1 2 3\nf 3 2 1\n");
    for faces in ["f 3 2 1\nf 1 2 3\n", "f 1 2 3\n", "f 2 3 1\n"] {
        assert_eq!(corner(faces), expected, "{faces}");
    }
}

#[test]
fn a_distant_ray_enters_the_scene_or_passes_it_by() {
    let text = "v -1 -1 -1\nv 1 1 1\nv 1 -1 0\nf 1 2 3\n";
    let scene = Scene::new(&read_obj(text.as_bytes()).unwrap());
    let far = DVec3::new(1e9, 0.5, 0.5);
    let ray = scene.frame.entrance(far).enter(-DVec3::X).unwrap();
    // The scene has half extents of 2^12; its box is one unit larger.
    assert_eq!(ray.origin, DVec3::new(4097., 2048., 2048.));
    let aside = DVec3::new(-1., 1., 0.).normalize();
    for direction in [DVec3::X, aside] {
        assert!(scene.frame.entrance(far).enter(direction).is_none());
    }
    let inside = scene.frame.entrance(DVec3::ZERO).enter(DVec3::Y).unwrap();
    assert_eq!(inside.origin, DVec3::ZERO);
    // A ray in the plane of a face of the box, from a corner.
    let beside = DVec3::new(-9., 1. + 1. / 4096., 0.);
    let enters = |p| scene.frame.entrance(p).enter(DVec3::X).is_some();
    assert!(enters(beside) && !enters(beside + DVec3::Y));
}

fn view() -> View {
    let position = DVec3::new(1., 2., 3.);
    let (target, up) = (position + 10. * DVec3::Y, DVec3::Z);
    View { position, target, up, fov: 90. }
}

#[test]
fn impossible_views_are_refused_without_a_tolerance() {
    let refused = |bad: View, why: &str| {
        let error = Camera::new(&bad, 1.).unwrap_err().to_string();
        assert!(error.contains(why), "{error}");
    };
    let target = view().position;
    refused(View { target, ..view() }, "target is its own position");
    for up in [DVec3::Y, DVec3::Y * -1e-300, DVec3::Y * 1e300, DVec3::ZERO]
    {
        refused(View { up, ..view() }, "is zero or parallel to the view");
    }
    for fov in [0., 180., -1., f64::NAN] {
        refused(View { fov, ..view() }, "is not strictly between");
    }
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for axis in 0..3 {
            let mut odd = DVec3::ONE;
            odd[axis] = bad;
            for view in [
                View { position: odd, ..view() },
                View { target: odd, ..view() },
                View { up: odd, ..view() },
            ] {
                refused(view, "is not finite");
            }
        }
    }
    let close = View { up: DVec3::new(1e-12, 1., 0.), ..view() };
    let camera = Camera::new(&close, 1.).unwrap();
    // Up leans towards x, so x is up and the right of the image is -z.
    let right = camera.direction(1., 0.5) - camera.direction(0., 0.5);
    assert!((right.normalize() + DVec3::Z).length() < 1e-9, "{right}");
}

/// Poisson's distribution of mean 16 is outside of the range with a
/// probability of 2e-6.
#[test]
fn keys_of_a_grid_are_equal_by_chance_only() {
    let digit = |i: u32, k: u32| f64::from(i >> (7 * k) & 127);
    let corner = |i| DVec3::new(digit(i, 0), digit(i, 1), digit(i, 2));
    let bits = |i| corner(i).to_array().map(f64::to_bits);
    let key = |i| scattered(bits(i)) >> 29;
    let mut keys: Vec<u64> = (0..1 << 20).map(key).collect();
    keys.sort_unstable();
    let equal = keys.windows(2).filter(|pair| pair[0] == pair[1]);
    assert!((2..=40).contains(&equal.count()));
}
