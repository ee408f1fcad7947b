// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What `pt` does with an OBJ that is odd, and with one that is wrong.

use crate::common;

use std::fs;
use std::os::unix::fs::PermissionsExt;

use common::{ABOVE, Run, SQUARE, Scratch, finish, pgm, skip};

/// A triangle that fills a part of the image.
const TRIANGLE: &str = "v -9 -9 0\nv 9 -8 0\nv -1 7 0\n";

const SMALL: [&str; 3] = ["-d8x6", "-n3", "-r0.5"];

fn render(place: &Scratch, arguments: &[&str]) -> Run {
    place.run(&[&ABOVE[..], &SMALL, arguments].concat())
}

/// The OBJ `bytes` fails with these words, and touches no output.
#[track_caller]
fn refused(bytes: impl AsRef<[u8]>, words: &[&str]) {
    let place = Scratch::new();
    place.put("scene.obj", bytes.as_ref());
    let input = ["-i", "scene.obj"];
    let fresh = [&input[..], &["-o", "new.pgm"]].concat();
    render(&place, &fresh).failed(1, &[&["scene.obj:"], words].concat());
    place.put("old.pgm", "old");
    let forced = [&input[..], &["-f", "-o", "old.pgm"]].concat();
    render(&place, &forced).failed(1, words);
    assert_eq!(place.get("old.pgm"), b"old");
    place.holds_only(&["old.pgm", "scene.obj"]);
}

/// The OBJ `odd` gives the image that the OBJ `plain` gives.
#[track_caller]
fn same(odd: impl AsRef<[u8]>, plain: &str) {
    let place = Scratch::new();
    place.put("odd.obj", odd.as_ref());
    place.put("plain.obj", plain);
    let odd = render(&place, &["-i", "odd.obj"]);
    let plain = render(&place, &["-i", "plain.obj"]);
    odd.succeeded();
    plain.succeeded();
    assert_eq!(pgm(&odd.stdout), pgm(&plain.stdout));
    let triangles =
        |run: &Run| run.stderr.split(',').next().map(str::to_owned);
    assert_eq!(triangles(&odd), triangles(&plain));
}

/// The OBJ gives the image of the triangle, and one warning of these words.
#[track_caller]
fn warned(bytes: impl AsRef<[u8]>, words: &str) {
    let place = Scratch::new();
    place.put("odd.obj", bytes.as_ref());
    place.put("plain.obj", with(""));
    let run = render(&place, &["-i", "odd.obj"]);
    run.succeeded();
    let plain = render(&place, &["-i", "plain.obj"]);
    assert_eq!(pgm(&run.stdout), pgm(&plain.stdout));
    let lines = run.stderr.lines().filter(|line| line.contains("warning"));
    let lines: Vec<_> = lines.collect();
    assert_eq!(lines.len(), 1, "{}", run.stderr);
    assert!(lines[0].contains(words), "{}", run.stderr);
    assert_eq!(render(&place, &["-i", "odd.obj", "-q"]).stderr, "");
}

/// The triangle's face after some more lines.
fn with(lines: &str) -> String {
    format!("{TRIANGLE}{lines}f 1 2 3\n")
}

#[test]
fn a_missing_file_is_named() {
    let place = Scratch::new();
    let run = render(&place, &["-i", "none.obj", "-o", "image.pgm"]);
    run.failed(1, &["none.obj: cannot read"]);
    place.holds_only(&[]);
}

#[test]
fn a_directory_is_no_scene() {
    let place = Scratch::new();
    let run = render(&place, &["-i", "/", "-o", "image.pgm"]);
    run.failed(1, &["/: cannot read", "directory"]);
    place.holds_only(&[]);
}

#[test]
fn a_file_that_may_not_be_read_is_named() {
    let place = Scratch::new();
    let closed = fs::Permissions::from_mode(0o000);
    fs::set_permissions(place.path("room.obj"), closed).unwrap();
    if fs::read(place.path("room.obj")).is_ok() {
        return skip("this user may read everything");
    }
    let run = render(&place, &["-i", "room.obj", "-o", "image.pgm"]);
    run.failed(1, &["room.obj: cannot read"]);
    place.holds_only(&[]);
}

#[test]
fn an_empty_file_is_no_scene() {
    refused("", &["scene.obj: ", "empty"]);
    let place = Scratch::new();
    place.feed(b"", &[]).failed(1, &["standard input: ", "empty"]);
}

#[test]
fn a_scene_without_faces_has_nothing_to_render() {
    refused("# one\n# two\n", &["no face"]);
    refused("\n\n\n", &["no face"]);
    refused("Not an OBJ, but text.\n", &["no face"]);
    refused(TRIANGLE, &["no face"]);
    refused(format!("{TRIANGLE}l 1 2 3\np 1\n"), &["no face"]);
}

#[test]
fn a_file_that_ends_within_a_number_fails_at_that_line() {
    let end = |word| with("") + word;
    refused(end("v 1 2 3e"), &[":5:", "3e"]);
    refused(end("v 1 -"), &[":5:", "y = -"]);
    refused(end("v 1 2"), &[":5:", "without z"]);
    refused(end("v"), &[":5:", "without x"]);
}

#[test]
fn a_file_that_ends_within_a_face_fails_at_that_line() {
    let end = |word| with("") + word;
    refused(end("f 1 2"), &[":5:", "2"]);
    refused(end("f 1 2 "), &[":5:", "2"]);
    refused(end("f 1"), &[":5:", "1"]);
    refused(end("f 1 2 -"), &[":5:", "corner -"]);
    refused(end("f "), &[":5:", "0"]);
    refused(end("f"), &[":5:", "0"]);
}

#[test]
fn a_statement_without_values_fails_wherever_it_stands() {
    refused(with("v\n"), &[":4:", "without x"]);
    refused(with("v\r\n"), &[":4:", "without x"]);
    refused(with("f\n"), &[":4:", "0"]);
    refused(with("f\r\n"), &[":4:", "0"]);
}

#[test]
fn a_scene_cut_at_any_byte_renders_or_fails_with_one_line() {
    let place = Scratch::new();
    let scene = "# c\r\nv 0 0 0\nv 1.5e1 0 -2\nvt 0.5\nv 0 \\\n1 0\n\
                 f 1/1/1 2//2 3\nl 1 2\nf -1 -2 -3\n";
    for cut in 0..=scene.len() {
        let scene = &scene.as_bytes()[..cut];
        let run = place.feed(scene, &["-d1x1"]);
        match run.status {
            Some(0) => assert_eq!(pgm(&run.stdout).2.len(), 1),
            _ => run.failed(1, &["standard input:"]),
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
    let text: Vec<u8> = noise.into_iter().filter(|&b| b > 127).collect();
    refused(text, &["no face"]);
}

#[test]
fn latin_1_letters_in_comments_and_names_are_harmless() {
    let lines = b"# caf\xe9\no \xe9t\xe9\ng \xff\nusemtl \x80\n";
    let odd = [lines, with("").as_bytes()].concat();
    same(odd, &with(""));
}

#[test]
fn latin_1_letters_among_values_fail_at_their_line() {
    refused(b"v 0 0 0\nv 1 0 \xe9\nf 1 2 2\n", &[":2:", "UTF-8"]);
    let face = [with("").as_bytes(), b"f 1 2 \xe9\n"].concat();
    refused(face, &[":5:", "UTF-8"]);
}

#[test]
fn a_corner_beyond_the_vertices_is_shown_with_their_number() {
    refused(format!("{TRIANGLE}f 1 2 4\n"), &[":4:", "4", "3 vertices"]);
    refused(format!("{TRIANGLE}f 1 2 -4\n"), &[":4:", "-4", "3"]);
    refused(format!("f -1 -2 -3\n{TRIANGLE}"), &[":1:", "-1", "0"]);
    refused(format!("{TRIANGLE}f 1 2 0\n"), &[":4:", "0"]);
    let modulo = "4294967297";
    refused(format!("{TRIANGLE}f 1 2 {modulo}\n"), &[":4:", modulo]);
}

#[test]
fn a_corner_beyond_all_integers_is_quoted() {
    for huge in ["99999999999999999999", "-99999999999999999999"] {
        refused(format!("{TRIANGLE}f 1 2 {huge}\n"), &[":4:", huge]);
    }
}

#[test]
fn a_corner_that_is_no_integer_is_quoted() {
    for odd in ["b", "2.0", "1e0", "/1", "0x1", "--1"] {
        refused(format!("{TRIANGLE}f 1 2 {odd}\n"), &[":4:", odd]);
    }
}

#[test]
fn a_reference_after_a_slash_that_is_no_integer_is_quoted() {
    for odd in ["3/x", "3//y", "3/1.5", "3/1/1/1"] {
        refused(format!("{TRIANGLE}f 1 2 {odd}\n"), &[":4:", odd]);
    }
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
}

#[test]
fn a_vertex_that_is_not_finite_does_not_matter_if_no_face_uses_it() {
    let words = "odd.obj:4: the first of 1 vertices that are not finite";
    warned(with("v 1 2 nan\n"), words);
    let words = "odd.obj:5: the first of 3 vertices that are not finite";
    warned(with("") + "v -inf 2 3\nv 1 1e400 0\nv 0 0 inf", words);
}

#[test]
fn a_vertex_of_two_numbers_lacks_one() {
    refused("v 0 0 0\nv 1 0\nv 0 1 0\nf 1 2 3\n", &[":2:", "without z"]);
}

#[test]
fn a_word_in_a_vertex_is_quoted() {
    for odd in ["zero", "0x10", "1,5", "1.0f", "1..2", "--1"] {
        refused(with(&format!("v 1 {odd} 2\n")), &[":4:", odd]);
    }
}

#[test]
fn a_word_after_the_third_number_of_a_vertex_is_quoted() {
    refused(with("v 1 2 3 word\n"), &[":4:", "word"]);
    let lines = "v 0 0 0\nv 1 0 0 word\nv 0 1 0\nf 1 2 3 word\n";
    refused(lines, &[":2:", "word"]);
}

#[test]
fn a_face_of_two_corners_is_refused() {
    refused(with("f 1 2\n"), &[":4:", "2 corners"]);
    refused(with("f 3\n"), &[":4:", "1 corner"]);
}

#[test]
fn the_first_line_at_fault_is_reported() {
    refused(with("f 1 2 7\nv 1 2 x\n"), &[":4:", "7"]);
    refused(with("v 1 2 x\nf 1 2 7\n"), &[":4:", "x"]);
    let later = with("f 1 2 4\n") + "v 1 2 3\nf 1 2 9\n";
    refused(later, &[":7:", "9", "4 vertices"]);
}

#[test]
fn standard_input_is_named_with_the_line_at_fault() {
    let place = Scratch::new();
    let run = place.feed(b"v 0 0 0\nf 1 1 2\n", &["-o", "image.pgm"]);
    run.failed(1, &["standard input:2:", "2"]);
    place.holds_only(&[]);
}

#[test]
fn lines_may_end_as_they_do_on_windows() {
    let plain = with("# a comment\n");
    same(plain.replace('\n', "\r\n"), &plain);
    same(plain.trim_end(), &plain);
}

#[test]
fn lines_may_end_in_any_way_in_one_file() {
    let plain = with("# a comment\n");
    for ends in [["\r", "\n"], ["\r\n", "\r"], ["\r\r\n", "\n\r"]] {
        let lines = plain.lines().zip(ends.iter().cycle());
        let odd: String =
            lines.map(|(line, end)| line.to_owned() + end).collect();
        same(odd, &plain);
    }
    refused("#\r#\r\n#\n\r#\n\r\nv 1 2\n", &[":7:", "without z"]);
    refused("v 1 2 3\r#\nv 1 2\rf 1 1 1", &[":3:", "without z"]);
}

#[test]
fn a_mark_of_byte_order_is_no_part_of_a_line() {
    same(format!("\u{feff}{}", with("")), &with(""));
    let marked = with("").replace('\n', "\n\u{feff}");
    same(format!("\u{feff}\u{feff}{marked}"), &with(""));
}

#[test]
fn what_fills_up_a_text_is_no_part_of_it() {
    let end = with("").trim_end().to_owned();
    for fill in ["\x1a", "\r\n\x1a\r\n", "\n\0", "\0\0\0", "\x1a\x1a\0\0"] {
        same(end.clone() + fill, &with(""));
    }
    same(TRIANGLE.to_owned() + "\x1af 1 2 3\n\x1a", &with(""));
    refused(with("\0\n"), &[":4:", "binary"]);
    refused([0; 99], &[":1:", "binary"]);
}

#[test]
fn no_message_has_a_character_that_steers_a_terminal() {
    refused(with("f 1 2 3\x1b[7m\n"), &[":4: corner 3\\u{1b}[7m is"]);
    refused(with("v 1 2 \u{feff}3\n"), &[":4: z = \\u{feff}3 is"]);
    warned(with("\x07\u{202e} 1\n"), "odd.obj:4: \\u{7}\\u{202e}, the");
}

#[test]
fn a_backslash_continues_a_line() {
    let odd = "v -9 \\\n-9 0\nv 9 -8 \\\n \\\n0\nv -1 7 0\nf 1 \\\n2 3\n";
    same(odd, &with(""));
    same(odd.replace('\n', "\r\n"), &with(""));
    same(odd.replace('\n', "\r"), &with(""));
    same(odd.replace('\n', "\r\r\n"), &with(""));
    same(odd.replace(" \\\n", "\\\n"), &with(""));
    same(odd.trim_end().to_owned() + " \\ ", &with(""));
    same("v -9 -9\\\n0\nv 9 -8 0\nv -1 7 0\nf 1 2\\\\\n3", &with(""));
    let wrong = odd.replace("2 3", "2 \\\n 9");
    refused(wrong, &["9", "3 vertices"]);
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
fn blanks_may_be_tabs_and_stand_before_a_statement() {
    same("\tv -9\t-9  0\n  v 9 -8 0\t\nv -1 7 0\nf\t1 2\t3 \n", &with(""));
}

#[test]
fn names_are_ignored() {
    let odd = "end\no\ng\ng a b\ns off\nvp 1\nparm u 0 \\\n 1\n# f 7 8 9\n";
    same(with(odd), &with(""));
}

#[test]
fn statements_that_are_not_rendered_are_counted() {
    let shapes = "g a\nl 1 2 \\\n3\np 1\ncurv 0 1 1 2\nsurf 0 1 1 2 3\n";
    warned(
        with(shapes),
        "odd.obj:6: l, the first of 4 statements that are",
    );
    for line in ["vertex 1 2 3", "F 1 2 3", "3", "call a.obj", "\u{e9}"] {
        let word = line.split(' ').next().unwrap();
        let words = format!("odd.obj:4: {word}, the first of 2 statements");
        warned(with(&format!("{line}\n{line}\n")), &words);
    }
    let noise = [with("").as_bytes(), b"\xff\x80\x07 1\n"].concat();
    warned(noise, "odd.obj:5: ");
}

#[test]
fn normals_and_texture_coordinates_are_ignored() {
    same(with("vt 0.5\nvt\nvt x\nvn 0 0\nvn nan 0 0\n"), &with(""));
    for corners in
        ["1/9/9 2//7 3", "1/0/0 2/-9 3//-9", "1/1 2/2 3/3", "1/ 2// 3"]
    {
        same(format!("{TRIANGLE}f {corners}\n"), &with(""));
    }
}

#[test]
fn materials_are_ignored_even_if_their_files_are_missing() {
    let odd = "mtllib none.mtl\nusemtl none\nmtllib\nusemtl\n";
    same(format!("{odd}{}", with(odd)), &with(""));
}

#[test]
fn colours_and_weights_of_vertices_are_ignored() {
    same("v -9 -9 0 1\nv 9 -8 0 1\nv -1 7 0 1\nf 1 2 3\n", &with(""));
    let odd = "v -9 -9 0 .1 .2 .3\nv 9 -8 0 1 1 1\nv -1 7 0 0 0 0\n";
    same(format!("{odd}f 1 2 3\n"), &with(""));
    let some = "v -9 -9 0\nv 9 -8 0 1 0 .5\nv -1 7 0 2\nf 1 2 3\n";
    same(some, &with(""));
    refused(with("v 1 2 3 .1 .2 red\n"), &[":4:", "red"]);
}

#[test]
fn a_negative_corner_counts_back_from_the_latest_vertex() {
    same(format!("{TRIANGLE}f -3 -2 -1\nv 5 5 5\n"), &with(""));
}

#[test]
fn a_face_may_come_before_its_vertices() {
    same(format!("f 1 2 3\n{TRIANGLE}"), &with(""));
}

#[test]
fn a_polygon_becomes_a_fan_around_its_first_corner() {
    let vertices = "v -9 -9 0\nv 9 -8 0\nv 8 1 0\nv 3 7 0\nv -2 4 0\n";
    let fan = format!("{vertices}f 1 2 3\nf 1 3 4\nf 1 4 5\n");
    same(format!("{vertices}f 1 2 3 4 5\n"), &fan);
}

#[test]
fn a_triangle_without_area_is_harmless() {
    same(with("f 1 1 2\n"), &with("f 2 2 2\n"));
    same(format!("{SQUARE}f 1 1 2\n"), &format!("{SQUARE}f 3 3 3\n"));
}

#[test]
fn what_has_no_end_and_is_no_obj_is_refused() {
    let place = Scratch::new();
    place
        .run(&["-i", "/dev/zero"])
        .failed(1, &["/dev/zero:1: a zero byte"]);
    for (text, fault) in [
        ("y", "standard input: no vertex in the first 64 MiB"),
        ("v 1 2", "standard input:1: a vertex without z"),
    ] {
        let mut command = place.command("sh");
        command.args(["-c", &format!("yes '{text}' | \"$0\"")]);
        command.arg(env!("CARGO_BIN_EXE_pt"));
        finish(command.spawn().unwrap()).failed(1, &[fault]);
    }
}

#[test]
fn too_little_memory_is_told_in_one_line() {
    let place = Scratch::new();
    let mut command = place.command("sh");
    command.args(["-c", "ulimit -v 4000000; exec \"$0\" \"$@\""]);
    command.args([env!("CARGO_BIN_EXE_pt"), "room.obj", "-j1"]);
    command.args(["-q", "-d16384x16384"]);
    let run = finish(command.spawn().unwrap());
    run.failed(1, &["too little memory: 17.18 GB more are needed"]);
}

#[test]
fn what_comes_late_through_a_pipe_is_read() {
    let place = Scratch::new();
    let text =
        ["# a word\n".repeat(1 << 21).as_str(), common::ROOM].concat();
    let fed = place.feed(text.as_bytes(), &["-d9x7"]);
    fed.succeeded();
    assert!(fed.stdout == place.render(&["-d9x7"]));
}
