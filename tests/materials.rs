// Libraries of materials (chapter "What surfaces reflect").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use crate::encodings::{gzip, utf_16, zstd};
use crate::random::{Random, any_of};

use litpt::scene::mtl::{Library, read_mtl};

/// The albedos of the materials T\u{f6}r and T\u{fc}r of a scene that begins with
/// this line in Latin-1, and all that is told, without the folder.
fn found(place: &Scratch, line: &str) -> (Vec<f64>, String) {
    let names = b"\nusemtl T\xf6r \nusemtl T\xfcr\n";
    let face = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let mesh = read_obj(&[line.as_bytes(), names, face].concat()).unwrap();
    let folder = place.path("");
    let (albedos, told) =
        match libraries(&mesh.marks, ("s.obj", &folder), (None, false)) {
            Ok((all, told)) => {
                let told = told.iter().map(|warning| warning.to_string());
                let told: Vec<_> = told.collect();
                (all.albedos.into_values().collect(), told.join("\n"))
            }
            Err(error) => (vec![], error.to_string()),
        };
    (albedos, told.replace(&*folder.to_string_lossy(), ""))
}

fn read(text: impl AsRef<[u8]>) -> (Vec<f64>, String) {
    let place = Scratch::with("m.mtl", text);
    found(&place, "mtllib m.mtl")
}

const TWO: &str = "newmtl T\u{f6}r\t\nKd\t2.5e-1 .25\\\n+.25 # gr\u{fc}n\n\n\
                   NewMtl  T\u{fc}r\n  kd .5\nillum 0.0\nKe\nNs 1,5\n";

#[test]
fn a_library_is_a_text_like_an_obj() {
    let right = (vec![0.25, 0.5], String::new());
    let latin_1: Vec<u8> = TWO.chars().map(|c| c as u8).collect();
    assert_eq!(read([&latin_1[..], b"\n\0\0"].concat()), right);
    for end in ["\n", "\r", "\r\n", "\r\r\n"] {
        let text = TWO.replace("\nn", "\n\u{feff}\x1an").replace('\n', end);
        let text = format!("\u{feff}{text}\x1a");
        assert_eq!(read(utf_16(&text, u16::to_be_bytes)), right);
        assert_eq!(read(gzip(text.as_bytes())), right);
        assert_eq!(read(zstd(text.as_bytes())), right);
        assert_eq!(read(text), right);
    }
    assert!(read("newmtl\r\r\n\0K").1.starts_with("m.mtl:3: a zero byte"));
}

/// Statements behind the two materials, and what is told of them.
const TOLD: &str = "\
Kd|Kd nan|Kd 1 1 1.5|Kd -1|Kd .5 .5|Kd .5#|Kd ,5 ,5 ,5|Kd 1.#IND > expected
Ke 0 0 .1|KE 1|Ke spectral a.rfl|Ke 1,0|map_Ke a > luminous (Ke)
d .5|d -halo .9|d 0,9|Tr .1|tr 1 # 0|map_d a > transparent (d, Tr)
map_Kd a.png|map_kd -s 1 1 1 a|map_Kd #1.png|decal a > textured (map_Kd)
Ks 0 0 1|Ks .5|illum 2|illum 9.0|map_Ks a|refl a > glossy (Ks, illum)
Kd xyz 1 1 1|KD XYZ .2 .3 .4|Kd spectral a.rfl > coloured (Kd xyz, Kd spectral)
Kd .7|Kd .5 .5 .6 > given another Kd
Ke 0 0|map_Ke|map_Kd|d 1|d -halo 1|d 1.0 # .5|Tr 0|illum 1|Kd .5|Kd .5 .5 .5 1 > ";

#[test]
fn what_is_no_albedo_is_refused_or_told_with_its_line() {
    for (lines, words) in TOLD.lines().filter_map(|l| l.split_once(" > ")) {
        for line in lines.split('|') {
            let text = format!("Kd x\n{TWO}{line}\n{line}\nnewmtl\nKd y");
            let (_, told) = read(text);
            let place = "m.mtl:11: material T\u{fc}r";
            let whole = format!(
                "{place} is {words}, not rendered: the first of 2 statements"
            );
            let is_right = match words {
                "" => told.is_empty(),
                "expected" => {
                    told.starts_with(&format!("{place}: {words}"))
                }
                _ => told == whole,
            };
            assert!(is_right, "{line}: {told}");
        }
    }
    let told = read(TWO.to_owned() + "Kd " + &"1 ".repeat(999)).1;
    assert!(told.ends_with(" 1...'") && told.len() < 180, "{told}");
}

/// Files that a scene names, its albedos, and what the last message says.
const FILES: [(&str, &[f64], &str); 10] = [
    ("a.mtl b.mtl", &[0.25, 0.5], "b.mtl:2: material T\u{f6}r is given an"),
    ("b.mtl\nmtllib my a.mtl", &[0.5, 0.5], "my a.mtl:2: material T"),
    ("my a.mtl your b", &[0.75, 1.], ""),
    ("\"my a.mtl\" \"your b\"", &[0.75, 1.], ""),
    ("d.mtl\\..\\b.mtl", &[0.5, 0.5], ""),
    (
        "a.mtl",
        &[0.25],
        "s.obj: no library has a Kd r g b of material T\u{fc}r, ",
    ),
    ("a.mtl none.mtl", &[], "none.mtl: No such file"),
    ("d.mtl", &[], "d.mtl: not a file"),
    ("/dev/zero", &[], "/dev/zero: not a file"),
    ("\u{1b}", &[], "\\u{1b}: No such file"),
];

#[test]
fn the_first_library_that_has_a_material_counts() {
    let place = Scratch::new();
    std::fs::create_dir(place.path("d.mtl")).unwrap();
    let packed = gzip("newmtl T\u{f6}r\nKd .25".as_bytes());
    place.put("a.mtl", [&packed[..], b"noise"].concat());
    place.put("b.mtl", "newmtl T\u{f6}r\nKd .5\nnewmtl T\u{fc}r\nKd .5");
    place.put("my a.mtl", "newmtl T\u{f6}r\nKd .75");
    place.put("your b", "newmtl T\u{fc}r\nKd 1");
    for (names, albedos, words) in FILES {
        let (found, told) = found(&place, &format!("mtllib {names}"));
        assert_eq!(found, albedos, "{names}: {told}");
        let last = told.lines().last().unwrap_or_default();
        assert!(last.starts_with(words), "{told}");
    }
    for names in ["\nmtllib a.mtl", " a.mtl"] {
        let line = "mtllib a.mtl".to_owned() + &names.repeat(3000);
        let (_, told) = found(&place, &line);
        assert_eq!(told.matches("left out").count(), 1);
    }
}

/// A library of a material that tobj reads as the format has it.
fn random_library(random: &mut Random) -> String {
    let lines = [
        "# Kd 2|Kd .1 .2 .3|Kd 1 0 0.25|Kd\t5e-1 1.0 .5 ",
        "Ks 0 0 0|Ks 0 0.5 0|illum 0|illum 1|illum 2",
        "Ke 0 0 0|Ke 0 0 1e-3|bump b.png|Pr 1",
        "d 1|d 0.5 |Ka 1 1 1|Ns 5|Tf 1 1 1|map_Ns c.png",
        "map_Kd a b.png|Ni 1.5",
    ];
    let mut line = |lines: &str| {
        let lines: Vec<&str> = lines.split('|').collect();
        any_of(&lines, random).to_owned() + any_of(&["\n", "\r\n"], random)
    };
    "newmtl a b \n".to_owned() + &lines.map(&mut line).concat()
}

#[test]
fn random_libraries_are_what_the_crate_tobj_reads() {
    let mut random = Random::seed_from_u64(7);
    for _ in 0..3000 {
        let text = random_library(&mut random);
        let (theirs, _) = tobj::load_mtl_buf(&mut text.as_bytes()).unwrap();
        let mut ours = Library::default();
        read_mtl(text.as_bytes(), "", &["a b"].into(), &mut ours).unwrap();
        let m = &theirs[0];
        let shines = |x: Option<[f64; 3]>| x.is_some_and(|x| x != [0.; 3]);
        let is_glossy =
            shines(m.specular) || m.illumination_model == Some(2);
        let mut told = vec![
            (is_glossy, "glossy (Ks, illum)"),
            (shines(m.emissive), "luminous (Ke)"),
            (m.diffuse_texture.is_some(), "textured (map_Kd)"),
            (m.dissolve.is_some_and(|d| d < 1.), "transparent (d, Tr)"),
        ];
        told.retain(|(is_told, _)| *is_told);
        assert!(ours.ignored.keys().eq(told.iter().map(|(_, kind)| kind)));
        assert_eq!(ours.diffuse.get(&m.name), m.diffuse.as_ref(), "{text}");
    }
}
