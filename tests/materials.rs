// Libraries of materials (chapter "What surfaces reflect").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::common::Scratch;
use crate::encodings::{gzip, utf_16, zstd};
use crate::scene::Random;

use std::collections::BTreeSet;

use litpt::materials::libraries;
use litpt::scene::{mtl, read_obj};

/// What is found in a scene: the albedos of its materials, and what is told.
fn found(place: &Scratch, obj: &[u8]) -> (Vec<f64>, String) {
    let face = b"\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let mesh = read_obj(&[obj, face].concat()).unwrap();
    match libraries(&mesh.marks, ("s.obj", &place.path("")), None) {
        Ok((all, told)) => (all.into_values().collect(), told.join("; ")),
        Err(error) => (vec![], error),
    }
}

fn read(text: impl AsRef<[u8]>) -> (Vec<f64>, String) {
    let place = Scratch::new();
    place.put("m.mtl", text);
    found(&place, b"mtllib m.mtl\nusemtl T\xf6r\nusemtl T\xfcr")
}

#[test]
fn a_library_is_a_text_like_an_obj() {
    let lines = "newmtl T\u{f6}r\t\nKd\t2.5e-1 .25\\\n+.25 # gr\u{fc}n\n\n\
                 newmtl  T\u{fc}r\n  kd .5\nillum 0.0\nKe\nmap_Kd\nNs 1,5";
    let right = (vec![0.25, 0.5], String::new());
    let latin_1: Vec<u8> = lines.chars().map(|c| c as u8).collect();
    assert_eq!(read([&latin_1[..], b"\n\0\0"].concat()), right);
    let lines = lines.replace("\nn", "\n\u{feff}\x1an");
    for end in ["\n", "\r", "\r\n", "\r\r\n"] {
        let text = format!("\u{feff}{}\x1a", lines.replace('\n', end));
        assert_eq!(read(utf_16(&text, u16::to_be_bytes)), right);
        for text in [gzip(text.as_bytes()), zstd(text.as_bytes())] {
            assert_eq!(read(&text), right);
        }
        assert_eq!(read(text), right);
    }
    let (_, fault) = read("newmtl a\r\r\n\0Kd 1");
    assert!(fault.contains("m.mtl:3: a zero byte"), "{fault}");
}

#[test]
fn what_is_no_albedo_is_refused_or_told_with_its_line() {
    let two = "newmtl T\u{f6}r\nKd .25\nnewmtl T\u{fc}r\nKd .5 .5 .5\n";
    let long = format!("Kd {}", "1 ".repeat(999));
    for (lines, words) in [
        (
            "Kd|Kd nan|Kd 1 1 1.5|Kd -1|Kd .5 .5|Kd .5#|Kd ,5 ,5 ,5|Kd 1.#IND",
            "material T\u{fc}r: expected Kd and one number from 0 to 1, or three",
        ),
        (&long, "1 1 1..."),
        (
            "Ke 0 0 .1|KE 1|Ke spectral a.rfl|Ke 1,0|map_Ke a",
            "luminous (Ke)",
        ),
        ("d .5|d -halo .9|d 0,9|Tr .1|tr 1 # 0|map_d a", "(d, Tr)"),
        (
            "map_Kd a.png|map_kd -s 1 1 1 a|map_Kd #1.png|decal a",
            "(map_Kd)",
        ),
        ("Ks 0 0 1|Ks .5|illum 2|illum 9.0|map_Ks a|refl a", "(Ks, illum)"),
        ("Kd xyz 1 1 1|Kd spectral a.rfl", "Kd xyz or Kd spectral"),
        ("Kd .7|newmtl T\u{fc}r\nKd .7|newmtl T\u{fc}r", "again"),
        (
            "Ke 0 0|map_Ke|d 1|d -halo 1|d 1.0 # .5|Tr 0|illum 1|newmtl b\nKd x",
            "",
        ),
    ] {
        for line in lines.split('|') {
            let (_, told) = read(format!("{two}{line}\n{line}\n"));
            assert!(told.contains(words), "{line}: {told}");
            let place =
                if words.is_empty() { "" } else { "m.mtl:5: material" };
            assert!(told.contains(place), "{line}: {told}");
            assert_eq!(told.is_empty(), words.is_empty(), "{told}");
        }
    }
    let (_, told) = read("newmtl T\u{f6}r\nd 1\nnewmtl T\u{fc}r");
    let words = "m.mtl:1: materials that have no Kd r g b, and are given \
                 the albedo of -r or --albedo: 2, the first T\u{f6}r";
    assert!(told.contains(words), "{told}");
}

#[test]
fn the_first_library_that_has_a_material_counts() {
    let place = Scratch::new();
    std::fs::create_dir(place.path("d.mtl")).unwrap();
    let packed = [&gzip(b"newmtl a\nKd .25")[..], b"noise"].concat();
    place.put("a.mtl", packed);
    place.put("b.mtl", "newmtl a\nKd .5\nnewmtl b\nKd .5");
    place.put("my a.mtl", "newmtl a\nKd .75");
    place.put("your b", "newmtl b\nKd 1");
    let many = "a.mtl\nmtllib ".repeat(3000);
    for (names, albedos, words) in [
        ("a.mtl b.mtl", &[0.25, 0.5][..], "left out; /b.mtl:1: materials"),
        ("b.mtl\nmtllib my a.mtl", &[0.5, 0.5], "/my a.mtl:1: materials"),
        ("my a.mtl your b", &[0.75, 1.], ""),
        ("\"my a.mtl\" \"your b\"", &[0.75, 1.], ""),
        ("d.mtl\\..\\b.mtl", &[0.5, 0.5], ""),
        (
            &many,
            &[0.25],
            "left out; s.obj: materials that are in no library",
        ),
        ("a.mtl none.mtl", &[], "/none.mtl: No such file"),
        ("d.mtl", &[], "/d.mtl: not a file; without --materials"),
        ("\u{1b}/dev/zero", &[], "/\\u{1b}/dev/zero: No such file"),
    ] {
        let obj = format!("mtllib {names}\nusemtl a \nusemtl b");
        let (found, told) = found(&place, obj.as_bytes());
        assert_eq!(found, albedos, "{names}: {told}");
        let told = told.replace(&*place.path("").to_string_lossy(), "/");
        assert!(told.contains(words), "{told}");
    }
}

/// A library that tobj reads as the format has it.
fn random_library(random: &mut Random) -> String {
    let mut text = String::new();
    for k in 0..1 + random.below(9) {
        text += &format!("newmtl a {k}\n");
        for lines in [
            "# Kd 2|Kd .1 .2 .3|Kd 1 0 0.25|Kd\t5e-1 1.0 .5 ",
            "Ks 0 0 0|Ks 0 0.5 0|illum 0|illum 1|illum 2",
            "Ke 0 0 0|Ke 0 0 1e-3|bump b.png|Pr 1",
            "d 1|d 0.5 |Ka 1 1 1|Ns 5|Tf 1 1 1|map_Ns c.png",
            "map_Kd a b.png|Ni 1.5",
        ] {
            let lines: Vec<&str> = lines.split('|').collect();
            text += random.one_of(&lines);
            text += random.one_of(&["\n", "\r\n", "\n\n"]);
        }
    }
    text
}

#[test]
fn random_libraries_are_what_the_crate_tobj_reads() {
    let mut random = Random(7);
    let names: Vec<String> = (0..9).map(|k| format!("a {k}")).collect();
    let used: BTreeSet<&str> = names.iter().map(|name| &name[..]).collect();
    for _ in 0..1000 {
        let text = random_library(&mut random);
        let (theirs, _) = tobj::load_mtl_buf(&mut text.as_bytes()).unwrap();
        let ours = mtl::read(text.as_bytes(), &used, &mut vec![]).unwrap();
        assert_eq!(ours.len(), theirs.len());
        for (ours, m) in ours.into_iter().zip(theirs) {
            let shines =
                |ks: Option<[f64; 3]>| ks.is_some_and(|ks| ks != [0.; 3]);
            let told = [
                (m.dissolve.is_some_and(|d| d < 1.), "(d, Tr)"),
                (m.diffuse.is_none(), "no Kd"),
                (shines(m.emissive), "(Ke)"),
                (
                    shines(m.specular) || m.illumination_model == Some(2),
                    "(Ks",
                ),
                (m.diffuse_texture.is_some(), "(map_Kd)"),
            ];
            let told = told.iter().filter(|(is_told, _)| *is_told);
            assert_eq!(ours.asides.len(), told.clone().count(), "{text}");
            for (_, kind) in told {
                assert!(ours.asides.keys().any(|k| k.contains(kind)));
            }
            assert_eq!((ours.name, ours.diffuse), (m.name, m.diffuse));
        }
    }
}
