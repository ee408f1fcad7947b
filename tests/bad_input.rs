// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What `pt` does with an OBJ that is odd, and with one that is wrong.

use crate::prelude::*;

use crate::options::usage;
use litpt::cli::options::Options;

/// A triangle that fills a part of the image.
const TRIANGLE: &str = "v -9 -9 0\nv 9 -8 0\nv -1 7 0\n";

/// The OBJ `bytes` is refused in one line with these words.
#[track_caller]
fn refused(bytes: impl AsRef<[u8]>, words: &[&str]) {
    let error = read_file(bytes.as_ref()).unwrap_err();
    let error = error.of_file("scene.obj").to_string();
    assert!(error.starts_with("scene.obj:") && error.lines().count() == 1);
    says(&error, words);
}

/// What an OBJ says: the triangles of its scene, how many the file has, and
/// the warnings.
#[track_caller]
fn read(bytes: &[u8]) -> (Vec<litpt::scene::Triangle>, usize, Vec<String>) {
    let (mesh, warnings) = read_file(bytes).unwrap();
    let warnings = warnings.into_iter().map(|w| w.of_file("odd.obj"));
    let warnings = warnings.map(|w| w.to_string()).collect();
    let count = mesh.triangles.len();
    (Scene::of(mesh).triangles.to_vec(), count, warnings)
}

/// The OBJ `odd` gives the scene that the OBJ `plain` gives.
#[track_caller]
fn same(odd: impl AsRef<[u8]>, plain: &str) {
    assert_eq!(read(odd.as_ref()), read(plain.as_bytes()));
}

/// The OBJ gives the triangle, and one warning of these words.
#[track_caller]
fn warned(bytes: impl AsRef<[u8]>, words: &str) {
    let (triangles, count, warnings) = read(bytes.as_ref());
    let (plain, one, _) = read(with("").as_bytes());
    assert_eq!((triangles, count), (plain, one));
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].contains(words), "{warnings:?}");
}

/// The triangle's face after some more lines.
fn with(lines: &str) -> String {
    format!("{TRIANGLE}{lines}f 1 2 3\n")
}

// ------------------------------------------------------------- The program

#[test]
fn a_fault_touches_no_output() {
    let place = Scratch::with("scene.obj", "v 0 0 0\nf 1 1 2\n");
    place.put("old.pgm", "old");
    for output in ["-onew.pgm", "-foold.pgm"] {
        let run = place.line(&format!("-iscene.obj {output}"));
        run.failed(1, &["scene.obj:2:", "2"]);
    }
    assert_eq!(place.get("old.pgm"), b"old");
    place.holds_only(&["old.pgm", "scene.obj"]);
    let run = place.feed(b"v 0 0 0\nf 1 1 2\n", "-oimage.pgm");
    run.failed(1, &["standard input:2:", "2"]);
    for (file, word) in [("none.obj", "No such"), ("/", "directory")] {
        let run = place.line(&format!("-i {file} -oimage.pgm"));
        run.failed(1, &[&format!("{file}: cannot read"), word]);
    }
    place.holds_only(&["old.pgm", "scene.obj"]);
    let words = ["standard input: empty; name a scene"];
    place.feed(b"", "").failed(1, &words);
}

#[test]
fn what_has_no_end_and_is_no_obj_is_refused() {
    let place = Scratch::new();
    let zeros = place.line("-i/dev/zero");
    let fault = "cannot read: no vertex in the first 64 MiB";
    zeros.failed(1, &["/dev/zero: ", fault]);
    place.shell("yes | \"$PT\"").failed(1, &["standard input: ", fault]);
}

#[test]
fn too_little_memory_is_told_in_one_line() {
    let picture = "-n1 --integrator=gather -oa.png";
    for (options, needed) in [("", "17.18"), (picture, "51.54")] {
        let run = format!("room.obj -j1 -q -d16384x16384 {options}");
        let run = Scratch::new().within("-v 4000000", &run);
        let fault =
            format!("too little memory: {needed} GB more are needed");
        run.failed(1, &[&fault]);
    }
}

// ---------------------------------------------------------------- Faults

#[test]
fn a_scene_without_faces_has_nothing_to_render() {
    let shapes = format!("{TRIANGLE}l 1 2 3\np 1\n");
    let text = "Not an OBJ, but text.\n";
    for text in ["# one\n# two\n", "\n\n\n", text, TRIANGLE, &shapes] {
        refused(text, &["no face"]);
    }
}

#[test]
fn a_fault_is_told_with_its_line_and_its_words() {
    for (line, words) in [
        ("v 1 2 3e", "3e"),
        ("v 1 -", "y = -"),
        ("v 1 2", "without z"),
        ("v", "without x"),
        ("v\r", "without x"),
        ("f 1 2", "2 corners"),
        ("f 1 2 ", "2 corners"),
        ("f 1", "1 corner"),
        ("f 1 2 -", "corner -"),
        ("f ", "0 corners"),
        ("f\r", "0 corners"),
        ("f 1 2 4", "corner 4, but only 3 vertices"),
        ("f 1 2 -4", "corner -4, but only 3 vertices so far"),
        ("f 1 2 0", "from 1, not from 0"),
        ("f 1 2 4294967297", "4294967297"),
        ("f 1 2 99999999999999999999", "99999999999999999999"),
        ("f 1 2 -99999999999999999999", "-99999999999999999999"),
        ("v 1 2 3 word", "word"),
        ("v 1 2 3 .1 .2 red", "red"),
        ("\0", "binary"),
        // No message steers a terminal.
        ("f 1 2 3\x1b[7m", "corner 3\\u{1b}[7m is"),
        ("v 1 2 \u{feff}3", "z = \\u{feff}3 is"),
        // The first line at fault is reported.
        ("f 1 2 7\nv 1 2 x", "7"),
        ("v 1 2 x\nf 1 2 7", "x"),
    ] {
        refused(with(&format!("{line}\n")), &[":4: ", words]);
        if !line.contains('\0') {
            refused(with("") + line, &[":5: ", words]);
        }
    }
    let corners = "b 2.0 1e0 /1 0x1 --1 3/x 3//y 3/1.5 3/1/1/1";
    for corner in corners.split(' ') {
        let words = format!("corner {corner}");
        refused(with(&format!("f 1 2 {corner}\n")), &[":4: ", &words]);
    }
    for y in "zero 0x10 1,5 1.0f 1..2 --1".split(' ') {
        let words = format!("y = {y}");
        refused(with(&format!("v 1 {y} 2\n")), &[":4: ", &words]);
    }
    refused(format!("f -1 -2 -3\n{TRIANGLE}"), &[":1:", "-1", "0"]);
    let later = with("f 1 2 4\n") + "v 1 2 3\nf 1 2 9\n";
    refused(later, &[":7:", "9", "4 vertices"]);
    refused(b"v 0 0 0\nv 1 0 \xe9\nf 1 2 2\n", &[":2:", "UTF-8"]);
    let face = [with("").as_bytes(), b"f 1 2 \xe9\n"].concat();
    refused(face, &[":5:", "UTF-8"]);
}

#[test]
fn a_scene_cut_at_any_byte_is_read_or_refused_with_one_line() {
    let scene = "# c\r\nv 0 0 0\nv 1.5e1 0 -2\nvt 0.5\nv 0 \\\n1 0\n\
                 f 1/1/1 2//2 3\nl 1 2\nf -1 -2 -3\n";
    for cut in 0..=scene.len() {
        let scene = &scene.as_bytes()[..cut];
        if read_file(scene).is_err() {
            refused(scene, &[]);
        }
    }
}

#[test]
fn a_binary_file_fails_where_its_first_zero_byte_is() {
    let mut state = 1_u32;
    let noise: Vec<u8> = (0..9999)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1);
            (state >> 24) as u8
        })
        .collect();
    let zero = noise.iter().position(|&byte| byte == 0).unwrap();
    let line = 1 + noise[..zero].iter().filter(|&&b| b == b'\n').count();
    refused(&noise, &[&format!(":{line}:"), "binary"]);
    refused(b"P5\n2 2\n255\n\0\x01\x02\x03", &[":4:", "binary"]);
    refused([0; 99], &[":1:", "binary"]);
    let text: Vec<u8> = noise.into_iter().filter(|&b| b > 127).collect();
    refused(text, &["no face"]);
}

#[test]
fn a_corner_that_is_not_finite_is_quoted_with_both_lines() {
    for odd in ["NaN", "nan", "inf", "-inf", "infinity", "1e999"] {
        let lines = format!("v 0 0 0\nv 1 0 {odd}\nv 0 1 0\nf 1 2 3\n");
        refused(lines, &[":4:", &format!("line 2 is v 1 0 {odd}")]);
        let faces = "f 3 4 5\nf 3 4 5 -4\n";
        let lines = format!("v 0 0 0\nv {odd} 0 0\n{TRIANGLE}{faces}");
        refused(lines, &[":7:", &format!("line 2 is v {odd} 0 0")]);
    }
    // It does not matter if no face uses it.
    let words = "odd.obj:4: the first of 1 vertices that are not finite";
    warned(with("v 1 2 nan\n"), words);
    let words = "odd.obj:5: the first of 3 vertices that are not finite";
    warned(with("") + "v -inf 2 3\nv 1 1e400 0\nv 0 0 inf", words);
}

// ------------------------------------------------------------------- Lines

#[test]
fn lines_may_end_in_any_way_in_one_file() {
    let plain = with("# a comment\n");
    same(plain.trim_end(), &plain);
    for ends in [
        ["\r\n", "\r\n"],
        ["\r", "\r"],
        ["\r", "\n"],
        ["\r\n", "\r"],
        ["\r\r\n", "\n\r"],
    ] {
        let lines = plain.lines().zip(ends.iter().cycle());
        let odd: String =
            lines.map(|(line, end)| line.to_owned() + end).collect();
        same(odd, &plain);
    }
    refused("#\r#\r\n#\n\r#\n\r\nv 1 2\n", &[":7:", "without z"]);
    refused("v 1 2 3\r#\nv 1 2\rf 1 1 1", &[":3:", "without z"]);
}

#[test]
fn marks_and_what_fills_up_a_text_are_no_part_of_it() {
    same(format!("\u{feff}{}", with("")), &with(""));
    let marked = with("").replace('\n', "\n\u{feff}");
    same(format!("\u{feff}\u{feff}{marked}"), &with(""));
    let end = with("").trim_end().to_owned();
    for fill in ["\x1a", "\r\n\x1a\r\n", "\n\0", "\0\0\0", "\x1a\x1a\0\0"] {
        same(end.clone() + fill, &with(""));
    }
    same(TRIANGLE.to_owned() + "\x1af 1 2 3\n\x1a", &with(""));
}

#[test]
fn a_backslash_continues_a_line() {
    let odd = "v -9 \\\n-9 0\nv 9 -8 \\\n \\\n0\nv -1 7 0\nf 1 \\\n2 3\n";
    for end in ["\n", "\r\n", "\r", "\r\r\n"] {
        same(odd.replace('\n', end), &with(""));
    }
    same(odd.replace(" \\\n", "\\\n"), &with(""));
    same(odd.trim_end().to_owned() + " \\ ", &with(""));
    same("v -9 -9\\\n0\nv 9 -8 0\nv -1 7 0\nf 1 2\\\\\n3", &with(""));
    let joined = "v\\\n -9 -9 0\nv 9 -8 0\n\\\nv\x0c-1 7 0\nf\\\n 1 2 3\n";
    same(joined, &with(""));
    // No two numbers become one, though there is a vertex of that number.
    let many = TRIANGLE.to_owned() + &"v 1 1 1\n".repeat(30);
    let glued = format!("{many}f 1//1\\\n2//2\\\r\n3\\\r3\n");
    same(glued, &format!("{many}f 1 2 3 3\n"));
    refused(odd.replace("2 3", "2 \\\n 9"), &["9", "3 vertices"]);
}

#[test]
fn a_backslash_behind_a_name_joins_nothing() {
    for name in ["# c:", "g a", "o a\\", "usemtl a", "mtllib a.mtl ", "s 1"]
    {
        for end in ["\n", " \t\n", "\r\n", "\r", "\n\n"] {
            let line = format!("{name}\\{end}");
            same(format!("{line}{TRIANGLE}{line}f 1 2 3\n"), &with(""));
        }
    }
    let vertices = TRIANGLE.replace('\n', " # c:\\\n");
    same(format!("{vertices}f 1 2 3"), &with(""));
    same(TRIANGLE.replace('\n', " \\\n") + "f 1 2 3", &with(""));
    same(format!("{TRIANGLE}vt 0 0 \\\n0\nvn 0\\\nf 1 2 3"), &with(""));
    let words = "odd.obj:5: 3, the first of 1 ";
    warned(format!("{TRIANGLE}# f 1 2 \\\n3\nf 1 2 3\n"), words);
}

#[test]
fn a_comment_begins_where_a_word_begins() {
    let all = TRIANGLE.replace('\n', " #1#2\n");
    same(format!("#\n{all}f 1 2 3\t# 4 #\n\u{feff}#\\\n"), &with(""));
    for word in ["1.#QNAN", "-1.#IND", "1#"] {
        refused(TRIANGLE.replace("-9 0", &format!("-9 {word}")), &[word]);
    }
    refused(format!("{TRIANGLE}f 1 2 3#4"), &[":4: ", "3#4"]);
    for comment in [" # x", " # f 1 2 3", " #1", " #", "\t# é 4 5"] {
        same(with("").replace('\n', &format!("{comment}\n")), &with(""));
    }
    let latin = [TRIANGLE.as_bytes(), b"f 1 2 3 # caf\xe9\n"].concat();
    same(latin, &with(""));
    for (line, words) in [
        ("f 1 2 # 3\n", "a face of 2 corners; it needs three"),
        ("f 1 2 9 # 3\n", "corner 9, but only 3 vertices"),
        ("v 1 2 # 3\n", "a vertex without z"),
    ] {
        refused(with(line), &[&format!(":4: {words}")]);
    }
}

/// A file of another kind is named.
#[test]
fn a_format_that_is_no_obj_is_told() {
    let mut binary = vec![b'x'; 84 + 2 * 50];
    binary[80..84].copy_from_slice(&2u32.to_le_bytes());
    let collada = "\u{feff}\r\n <?XML version=\"1.0\"?>\n<COLLADA/>\n";
    for (bytes, words) in [
        (&b"ply\nformat ascii 1.0\n"[..], "PLY, not Wavefront OBJ"),
        (b"solid cube\n facet normal 0 0 1\n", "STL"),
        (&binary, "STL"),
        (b"{ \"asset\": {} }", "glTF"),
        (b"<?xml version=\"1.0\"?>\n<COLLADA/>\n", "COLLADA"),
        (collada.as_bytes(), "COLLADA or other XML"),
    ] {
        refused(bytes, &[&format!(": the format is {words}")]);
    }
    refused("Dear all,\nplease find attached\n", &["a Wavefront OBJ?"]);
    let solid = format!("solid #VRML by foo\n{SQUARE}");
    assert!(read_file(solid.as_bytes()).is_ok());
}

#[test]
fn at_most_80_characters_are_quoted() {
    let long = "\u{1b}\u{fc}".repeat(40) + &"9".repeat(400);
    for line in ["v 1 1 ", "v 1 1 1 ", "f 1 2 ", "f 1 2 3/", "q"] {
        let told = read_file(with(&format!("{line}{long}\n")).as_bytes());
        let told =
            told.map_or_else(|e| e.to_string(), |(_, w)| w[0].to_string());
        assert!(told.contains("..."), "{told}");
        assert!(told.chars().count() < 140, "{told}");
    }
    // So it is with vertices, names, points and words.
    let blanks = "a b ".repeat(999);
    let text =
        format!("g {blanks}\n{SQUARE}v 1e999 0 0 #{long}\nf 1 2 5\n");
    let (whole, _) = text.split_once("v 1e999").unwrap();
    let marks = read_obj(whole.as_bytes()).unwrap().marks;
    let named_albedos = vec![(long.clone(), 0.5)];
    let named = Named { named_albedos, ..Named::default() };
    let words = ["pt", "--spp", &long].map(String::from);
    for told in [
        read_file(text.as_bytes()).unwrap_err().to_string(),
        FaceAlbedos::new(&marks, &named, 0.5).unwrap_err().to_string(),
        read_points(blanks.as_bytes(), &mut vec![])
            .unwrap_err()
            .to_string(),
        usage(Options::parse(words)),
    ] {
        assert!(told.chars().count() < 400, "{told}");
        assert!(!told.contains('\u{1b}'), "{told}");
    }
}

#[test]
fn statements_that_are_not_rendered_are_counted() {
    let shapes = "g a\nl 1 2 \\\n3\np 1\ncurv 0 1 1 2\nsurf 0 1 1 2 3\n";
    let words = "odd.obj:6: l, the first of 4 statements that are";
    warned(with(shapes), words);
    for line in ["vertex 1 2 3", "F 1 2 3", "3", "call a.obj", "\u{e9}"] {
        let word = line.split(' ').next().unwrap();
        let words = format!("odd.obj:4: {word}, the first of 2 statements");
        warned(with(&format!("{line}\n{line}\n")), &words);
    }
    let noise = [with("").as_bytes(), b"\xff\x80\x07 1\n"].concat();
    warned(noise, "odd.obj:5: ");
    warned(with("\x07\u{202e} 1\n"), "odd.obj:4: \\u{7}\\u{202e}, the");
}

#[test]
fn what_has_no_shape_is_ignored() {
    let lines = b"# caf\xe9\no \xe9t\xe9\ng \xff\nusemtl \x80\n";
    same([lines, with("").as_bytes()].concat(), &with(""));
    for odd in [
        "end\no\ng\ng a b\ns off\nvp 1\nparm u 0 \\\n 1\n# f 7 8 9\n",
        "vt 0.5\nvt\nvt x\nvn 0 0\nvn nan 0 0\n",
        "mtllib none.mtl\nusemtl none\nmtllib\nusemtl\n",
    ] {
        same(with(odd), &with(""));
    }
    for corners in
        ["1/9/9 2//7 3", "1/0/0 2/-9 3//-9", "1/1 2/2 3/3", "1/ 2// 3"]
    {
        same(format!("{TRIANGLE}f {corners}\n"), &with(""));
    }
    // Colours and weights of vertices.
    same("v -9 -9 0 1\nv 9 -8 0 1\nv -1 7 0 1\nf 1 2 3\n", &with(""));
    let odd = "v -9 -9 0 .1 .2 .3\nv 9 -8 0 1 1 1\nv -1 7 0 0 0 0\n";
    same(format!("{odd}f 1 2 3\n"), &with(""));
    same("v -9 -9 0\nv 9 -8 0 1 0 .5\nv -1 7 0 2\nf 1 2 3\n", &with(""));
}

#[test]
fn blanks_and_the_order_of_statements_are_free() {
    same("\tv -9\t-9  0\n  v 9 -8 0\t\nv -1 7 0\nf\t1 2\t3 \n", &with(""));
    same(format!("{TRIANGLE}f -3 -2 -1\nv 5 5 5\n"), &with(""));
    same(format!("f 1 2 3\n{TRIANGLE}"), &with(""));
    let vertices = "v -9 -9 0\nv 9 -8 0\nv 8 1 0\nv 3 7 0\nv -2 4 0\n";
    let fan = format!("{vertices}f 1 2 3\nf 1 3 4\nf 1 4 5\n");
    same(format!("{vertices}f 1 2 3 4 5\n"), &fan);
    // A triangle without area is harmless.
    same(with("f 1 1 2\n"), &with("f 2 2 2\n"));
    same(format!("{SQUARE}f 1 1 2\n"), &format!("{SQUARE}f 3 3 3\n"));
}
