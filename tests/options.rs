// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The options of `pt`: defaults, forms, wrong values, help, reproducibility.

use crate::common;

use std::ffi::OsStr;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::process::Stdio;
use std::time::Duration;

use glam::DVec3;
use litpt::bvh::Isa;
use litpt::camera::{Camera, View};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use common::{ABOVE, ROOM, Scratch, finish, pgm};

/// Each option that has a value and a default: its short form, its long
/// form, the default, and a value that gives another image.
const DEFAULTS: [[&str; 4]; 8] = [
    ["-d", "--resolution", "320x240", "321x240"],
    ["-n", "--spp", "1", "2"],
    ["-p", "--position", "0,0,0", "0,0.5,0"],
    ["-t", "--target", "0,1,0", "0,1,-0.1"],
    ["-u", "--up", "0,0,1", "0.1,0,1"],
    ["-F", "--fov", "70", "71"],
    ["-r", "--albedo", "1", "0.5"],
    ["-s", "--seed", "0", "1"],
];

#[test]
fn the_names_of_the_reference_are_understood() {
    let place = Scratch::new();
    for (name, alias, value) in [
        ("--resolution", "--definition", "9x7"),
        ("--spp", "--realisations", "3"),
        ("--albedo", "--reflectivity", "0.5"),
    ] {
        let film = place.render(&[alias, value]);
        assert!(film == place.render(&[name, value]), "{alias}");
        let help = place.run(&["-h"]).stdout;
        assert!(String::from_utf8(help).unwrap().contains(alias));
    }
}

/// Wrong usage of one option: refused before anything is read or written.
#[track_caller]
fn refused(option: &str, long: &str, values: &[&str]) {
    let place = Scratch::new();
    for value in values {
        let named = [long, &format!("'{value}'")];
        let output = ["-i", "room.obj", "-o", "image.pgm"];
        let separate = [&output[..], &[option, value]].concat();
        place.run(&separate).failed(2, &named);
        let joined = format!("{long}={value}");
        let joined = [&output[..], &[joined.as_str()]].concat();
        if !value.is_empty() {
            place.run(&joined).failed(2, &named);
        }
    }
    place.holds_only(&[]);
}

#[test]
fn a_default_given_explicitly_changes_nothing() {
    let place = Scratch::new();
    let film = place.render(&[]);
    assert_eq!(pgm(&film).0, 320);
    for [short, long, default, other] in DEFAULTS {
        let option = format!("{long}={default}");
        assert!(place.render(&[short, default]) == film, "{short}");
        assert!(place.render(&[long, default]) == film, "{long}");
        assert!(place.render(&[&option]) == film, "{option}");
        assert!(place.render(&[short, other]) != film, "{other}");
    }
}

#[test]
fn the_instructions_change_nothing_but_the_summary() {
    let place = Scratch::new();
    let film = place.render(&["-n3"]);
    for isa in Isa::ALL.map(|isa| isa.to_string()) {
        let run = place.run(&["-i", "room.obj", "-n3", "--isa", &isa]);
        if isa.parse::<Isa>().unwrap().is_available() {
            run.succeeded();
            assert!(run.stdout == film, "{isa}");
            assert!(run.stderr.contains(&format!(", {isa})")), "{isa}");
        } else {
            run.failed(1, &[&isa, "instructions"]);
        }
    }
    refused("--isa", "--isa", &["sse", "AVX2"]);
}

#[test]
fn the_input_is_a_file_or_standard_input() {
    let place = Scratch::new();
    let film = place.render(&["-d9x7"]);
    let fed = place.feed(ROOM.as_bytes(), &["-d9x7"]);
    fed.succeeded();
    assert_eq!(fed.stdout, film);
    let long = place.run(&["--input", "room.obj", "-d9x7"]);
    assert_eq!(long.stdout, film);
}

#[test]
fn the_output_is_a_file_or_standard_output() {
    let place = Scratch::new();
    let film = place.render(&["-d9x7"]);
    assert!(place.render_to(&["-o", "short.pgm"]).stdout.is_empty());
    place.render_to(&["--output", "long.pgm"]);
    place.render_to(&["--output", "long.pgm", "--force", "--quiet"]);
    place.render_to(&["-o", "long.pgm", "-fq"]);
    assert_eq!(place.get("short.pgm"), film);
    assert_eq!(place.get("long.pgm"), film);
}

impl Scratch {
    fn render_to(&self, output: &[&str]) -> common::Run {
        let scene = ["-i", "room.obj", "-d9x7"];
        let run = self.run(&[&scene[..], output].concat());
        run.succeeded();
        run
    }
}

#[test]
fn a_resolution_is_two_integers_around_one_x() {
    let wrong = [
        "800x600x3",
        "0x5",
        "5x0",
        "16385x1",
        "1x16385",
        "99999999999999999999x1",
        "800",
        "x",
        "8x",
        "x6",
        "8X6",
        "8x6 ",
        " 8x6",
        "8 x 6",
        "8.0x6",
        "8e2x6",
        "+8x6",
        "8x+6",
        "0x10x4",
        "",
    ];
    refused("-d", "--resolution", &wrong);
    refused("-d", "--resolution", &["-1x2", "1x-2"]);
    for large in ["16385x1", "1x99999999999999999999"] {
        let said = ["at most 16384 pixels a side"];
        Scratch::new().run(&["-d", large]).failed(2, &said);
    }
}

#[test]
fn a_resolution_may_be_as_large_as_16384_on_either_side() {
    let place = Scratch::new();
    for side in ["16384x1", "1x16384"] {
        let (width, height, levels) = pgm(&place.render(&["-d", side]));
        assert_eq!(format!("{width}x{height}"), side);
        assert_eq!(levels.len(), 16384);
    }
}

#[test]
fn the_number_of_samples_is_a_positive_integer() {
    let wrong =
        ["0", "1.5", "1e3", "abc", "99999999999999999999", "+3", ""];
    refused("-n", "--spp", &wrong);
    refused("-n", "--spp", &["-3"]);
}

#[test]
fn the_largest_number_of_samples_starts_to_render() {
    let place = Scratch::new();
    let n = u64::MAX.to_string();
    let long = ["-q", "-d4x4", "-i", "room.obj", "-n", &n];
    let mut child = place.pt(&long).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(400));
    let ended = child.try_wait().unwrap();
    child.kill().unwrap();
    let run = finish(child);
    assert!(ended.is_none() && run.stderr.is_empty(), "{}", run.stderr);
}

#[test]
fn a_vector_is_three_finite_reals_around_two_commas() {
    let wrong = [
        "1,2",
        "1,2,3,4",
        "1,2,",
        "1 2 3",
        "1, 2,3",
        "a,b,c",
        "nan,0,0",
        "0,inf,0",
        "0,0,-inf",
        "1e999,0,0",
        "1,,3",
        "-",
        "-1,-2",
        "",
    ];
    refused("-p", "--position", &wrong);
    refused("-t", "--target", &wrong);
    refused("-u", "--up", &wrong);
}

#[test]
fn a_vector_may_begin_with_a_minus_sign() {
    let place = Scratch::new();
    let joined =
        ["--position=-1,-2,-.5", "--target=-2,1,-1", "--up=-1,0,9"];
    let separate = ["-p", "-1,-2,-.5", "-t", "-2,1,-1", "-u", "-1,0,9"];
    let size = ["-d9x7"];
    let film = place.render(&[&size[..], &joined].concat());
    assert_eq!(place.render(&[&size[..], &separate].concat()), film);
    assert_ne!(place.render(&size), film);
}

#[test]
fn a_field_of_view_lies_strictly_between_0_and_180() {
    let wrong = ["0", "180", "-10", "1e3", "nan", "inf", "70,", "wide", ""];
    refused("-F", "--fov", &wrong);
    let place = Scratch::new();
    place.render(&["-d2x2", "-F", "1e-9"]);
    place.render(&["-d2x2", "-F", "179.999"]);
}

#[test]
fn an_albedo_lies_between_0_and_1() {
    let wrong = ["-0.1", "1.1", "nan", "inf", "50%", "0,5", ""];
    refused("-r", "--albedo", &wrong);
    let place = Scratch::new();
    place.render(&["-d2x2", "-r", "0"]);
    place.render(&["-d2x2", "-r", "1"]);
}

#[test]
fn a_number_of_threads_is_a_positive_integer() {
    refused("-j", "--threads", &["0", "1.5", "all", "4097", "+2", ""]);
    refused("-j", "--threads", &["-1"]);
}

#[test]
fn a_seed_is_an_integer_of_64_bits() {
    let wrong = ["18446744073709551616", "1.5", "x", "+1", ""];
    refused("-s", "--seed", &wrong);
    refused("-s", "--seed", &["-1"]);
    let place = Scratch::new();
    place.render(&["-d2x2", "-s", "18446744073709551615"]);
}

#[test]
fn an_option_that_does_not_exist_is_named() {
    let place = Scratch::new();
    for wrong in ["-z", "--nonsense"] {
        place.run(&["-i", "room.obj", wrong]).failed(2, &[wrong]);
    }
}

#[test]
fn a_missing_value_is_reported_with_its_option() {
    let place = Scratch::new();
    let valued = DEFAULTS.map(|[short, long, ..]| [short, long]);
    let others =
        [["-i", "--input"], ["-o", "--output"], ["-j", "--threads"]];
    for [short, long] in valued.into_iter().chain(others) {
        place.run(&["-q", short]).failed(2, &[long]);
        place.run(&["-q", long]).failed(2, &[long]);
    }
}

#[test]
fn of_an_option_given_twice_the_last_value_counts() {
    let place = Scratch::new();
    let twice = ["-d9x7", "-n2", "-n", "3", "-q", "-q", "-f", "-f"];
    assert!(place.render(&twice) == place.render(&["-d9x7", "-n3"]));
}

#[test]
fn what_was_probably_meant_is_named() {
    let place = Scratch::new();
    place.run(&["--albdo", "1"]).failed(2, &["--albdo", "mean --albedo?"]);
    let format = ["-i", "room.obj", "--format", "pgn"];
    place.run(&format).failed(2, &["'pgn'", "mean pgm?"]);
}

#[test]
fn a_number_that_is_none_is_said_to_be_none() {
    let place = Scratch::new();
    for option in ["-n", "-s", "-j"] {
        let words = ["'abc' is not a whole number in digits"];
        place.run(&[option, "abc"]).failed(2, &words);
        let large = "18446744073709551616";
        place.run(&[option, large]).failed(2, &[large, "is larger than"]);
    }
}

#[test]
fn a_scene_may_be_named_without_an_option() {
    let place = Scratch::new();
    let image = place.render(&["-d9x7"]);
    for names in [
        &["room.obj"][..],
        &["nothing.obj", "-i", "room.obj"],
        &["-i", "nothing.obj", "room.obj"],
    ] {
        let run = place.run(&[&["-d9x7"], names].concat());
        run.succeeded();
        assert!(run.stdout == image, "{names:?}");
    }
    place.run(&["nothing.obj"]).failed(1, &["nothing.obj: cannot read"]);
    // A name need not be a text.
    let name = OsStr::from_bytes(b"\xff.obj");
    std::fs::write(place.path("").join(name), ROOM).unwrap();
    let run = place.run(&[OsStr::new("-d9x7"), name]);
    run.succeeded();
    assert!(run.stdout == image);
}

#[test]
fn a_dash_is_standard_input_or_output() {
    let place = Scratch::new();
    let image = place.render(&["-d9x7", "--format=pfm"]);
    for name in ["-i-", "-"] {
        let words = ["-d9x7", "-o", "-", "--format=pfm", name];
        let run = place.feed(ROOM.as_bytes(), &words);
        run.succeeded();
        assert!(run.stdout == image);
    }
    let report = ["-d9x7", "-oa.pgm", "--report", "-", "room.obj"];
    let report = place.run(&report).stdout;
    let report: serde_json::Value =
        serde_json::from_slice(&report).unwrap();
    assert_eq!(report["settings"]["resolution"][0], 9);
    for twice in [
        ["-o", "-", "--report", "-"],
        ["-o", "/dev/stdout", "--report", "-"],
        ["-o", "/dev/fd/1", "-o", "-"],
        ["--report", "/proc/self/fd/1", "-f", "-q"],
        ["-o", "/dev/stdout", "--checkpoint", "/dev/fd/1"],
    ] {
        let run = place.run(&[&twice[..], &["room.obj"]].concat());
        run.failed(1, &["standard output is named twice"]);
    }
    place.holds_only(&["a.pgm"]);
    // The image and the reference have one name, and are not the same.
    place.run(&["-d9x7", "-s1", "-otruth.pfm", "room.obj"]).succeeded();
    let reference = ["-d9x7", "--reference=-", "-o-", "--format=pfm"];
    let known = [&reference[..], &["room.obj"]].concat();
    let known = place.feed(&place.get("truth.pfm"), &known);
    known.succeeded();
    assert!(known.stdout == image);
    let both = place.feed(ROOM.as_bytes(), &reference);
    both.failed(1, &["standard input can be read once only"]);
}

// ------------------------------------------- A camera that is not given

#[test]
fn a_camera_that_is_not_given_is_told_and_can_be_typed() {
    let place = Scratch::new();
    let run = |words: &[&str]| {
        let mut command = place.command(env!("CARGO_BIN_EXE_pt"));
        let scene = ["room.obj", "-d9x7", "-n4", "-u", "0,0.1,1"];
        command.args(scene).args(words);
        finish(command.spawn().unwrap())
    };
    let chosen = run(&[]);
    chosen.succeeded();
    let said = chosen.stderr.lines().next().unwrap();
    let options = said.split_once("the camera stands outside: ").unwrap().1;
    let options: Vec<_> = options.split_whitespace().collect();
    let typed = run(&options);
    assert!(typed.stdout == chosen.stdout);
    assert!(!typed.stderr.contains("outside"));
    assert!(run(&["-q"]).stderr.is_empty());
    // A reference of the view that is chosen shows the same.
    run(&["-oa.exr", "-s1"]).succeeded();
    run(&["--reference", "a.exr"]).succeeded();
    let other = run(&["--reference", "a.exr", "-p0,0,0"]);
    other.failed(1, &["a.exr", "position"]);
}

/// The four planes between the eye and the edges of the image have all
/// corners on the side of its middle.
#[test]
fn a_view_from_outside_shows_the_whole_box() {
    let mut rng = Pcg64::seed_from_u64(20);
    for case in 0..1000 {
        let scale = 10f64.powi(case % 41 - 20);
        let mut point =
            || scale * DVec3::from([0; 3].map(|_| rng.random()));
        let (a, b, shift) = (point(), point(), 100. * point());
        let [low, high] = [a.min(b) - shift, a.max(b) - shift];
        let up = [DVec3::X, DVec3::Y, DVec3::Z][case as usize % 3];
        let up = up * [1., -1.][case as usize % 2];
        let (fov, aspect) =
            (1. + 170. * a.x / scale, 0.1 + 3. * b.x / scale);
        let zero = DVec3::ZERO;
        let view = View { position: zero, target: zero, up, fov };
        let view = view.outside([low, high], aspect).unwrap();
        let camera = Camera::new(&view, aspect).unwrap();
        let edges = [(0., 0.), (1., 0.), (1., 1.), (0., 1.), (0., 0.)];
        let edges = edges.map(|(x, y)| camera.direction(x, y));
        let middle = camera.direction(0.5, 0.5);
        for edge in edges.windows(2) {
            let plane = edge[0].cross(edge[1]);
            let inside = plane.dot(middle).signum();
            for k in 0..8 {
                let is_high = [1, 2, 4].map(|bit| k & bit != 0);
                let corner = DVec3::select(is_high.into(), high, low);
                let seen = plane.dot(corner - view.position) * inside;
                assert!(seen > 0., "{case}: {view:?}");
            }
        }
    }
}

#[test]
fn the_help_lists_every_option_with_its_default_and_the_licence() {
    let place = Scratch::new();
    let help = place.run(&["-h"]);
    help.succeeded();
    assert!(help.stderr.is_empty());
    assert_eq!(place.run(&["--help"]).stdout, help.stdout);
    let help = String::from_utf8(help.stdout).unwrap();
    assert!(!help.contains('\x1b'));
    let lists = |short: &str, long: &str, default: &str| {
        let option = format!("{short}, {long}");
        let found = |line: &&str| line.trim_start().starts_with(&option);
        let line = help.lines().find(found).expect(&option);
        assert!(line.contains(default), "{line}");
    };
    for [short, long, default, _] in DEFAULTS {
        match long {
            "--position" | "--target" => lists(short, long, "[default: "),
            _ => lists(short, long, &format!("[default: {default}]")),
        }
    }
    assert!(help.contains("[default: standard input, as is -]"));
    lists("-o", "--output", "[default: -, standard output");
    lists("-j", "--threads", "[default: all cores]");
    for [short, long] in [
        ["-f", "--force"],
        ["-q", "--quiet"],
        ["-h", "--help"],
        ["-V", "--version"],
    ] {
        lists(short, long, "");
    }
    assert!(help.contains("Usage: pt"));
    assert!(help.contains("Copyright (C) 2026 litpt contributors"));
    assert!(help.contains("GNU GPL version 3 or later"));
    assert!(help.contains("NO WARRANTY"));
}

#[test]
fn the_version_is_that_of_the_package() {
    let place = Scratch::new();
    let version = concat!("pt ", env!("CARGO_PKG_VERSION"), "\n");
    for option in ["-V", "--version"] {
        let run = place.run(&[option]);
        run.succeeded();
        assert_eq!(String::from_utf8(run.stdout).unwrap(), version);
        assert!(run.stderr.is_empty());
    }
}

#[test]
fn help_that_nobody_reads_is_no_error() {
    let place = Scratch::new();
    let (reader, writer) = io::pipe().unwrap();
    drop(reader);
    let mut command = place.pt(&["-h"]);
    command.stdout(Stdio::from(writer));
    let run = finish(command.spawn().unwrap());
    assert_eq!((run.status, run.stderr.as_str()), (Some(0), ""));
}

#[test]
fn a_camera_at_its_own_target_is_reported_with_the_point() {
    let place = Scratch::new();
    let view = ["-p", "1,2.5,-3", "-t", "1,2.5,-3", "-o", "image.pgm"];
    let run = place.run(&[&view[..], &["-i", "room.obj"]].concat());
    run.failed(1, &["1,2.5,-3", "-p", "-t"]);
    place.holds_only(&[]);
}

#[test]
fn an_up_axis_along_the_view_is_reported_with_both_vectors() {
    let place = Scratch::new();
    for up in ["-2,-4,6", "1,2,-3", "0,0,0"] {
        let view = ["-p", "1,1,1", "-t", "2,3,-2", "-u", up];
        let files = ["-i", "room.obj", "-o", "image.pgm"];
        let run = place.run(&[&view[..], &files].concat());
        run.failed(1, &[up, "1,2,-3", "-u"]);
    }
    place.holds_only(&[]);
}

#[test]
fn an_impossible_camera_is_reported_before_the_scene_is_read() {
    let place = Scratch::new();
    let run = place.run(&["-t", "0,0,0", "-i", "missing.obj"]);
    run.failed(1, &["target"]);
}

#[test]
fn the_number_of_threads_does_not_change_the_image() {
    let place = Scratch::new();
    let small = ["-d70x50", "-n5", "-r0.8"];
    let film = place.render(&small);
    for threads in ["-j1", "-j2", "-j7"] {
        let again = place.render(&[&small[..], &[threads]].concat());
        assert!(again == film, "{threads}");
    }
}

#[test]
fn a_seed_gives_its_own_image_and_always_the_same() {
    let place = Scratch::new();
    let seeds = ["-s0", "-s1", "-s2", "-s18446744073709551615"];
    let images = seeds.map(|seed| place.render(&["-d32x24", seed]));
    for (i, seed) in seeds.iter().enumerate() {
        assert!(place.render(&["-d32x24", seed]) == images[i]);
        assert!(images[..i].iter().all(|film| *film != images[i]));
    }
}

#[test]
fn the_options_of_the_model_reach_the_image() {
    let place = Scratch::new();
    let scene = [&ABOVE[..], &["-i", "square.obj", "-d2x2"]].concat();
    for (rho, level) in [("0", 0), ("0.002", 6), ("0.5", 187)] {
        let run = place.run(&[&scene[..], &["-r", rho]].concat());
        assert_eq!(pgm(&run.stdout), (2, 2, vec![level; 4]), "{rho}");
    }
}

// ------------------------------------------------------- A part of an image

#[test]
fn a_crop_has_the_pixels_of_the_whole_image() {
    let place = Scratch::new();
    let scene = ["-i", "room.obj", "-d45x37", "-n3", "-o"];
    let read = |name: &str| {
        let image = litpt::image::Image::read(&place.path(name)).unwrap();
        (image.width as usize, image.height as usize, image.means)
    };
    place.run(&[&scene[..], &["a.pfm"]].concat()).succeeded();
    let (width, _, whole) = read("a.pfm");
    for (crop, (x, y, w, h)) in [
        ("0,0,45x37", (0, 0, 45, 37)),
        ("17,5,20x30", (17, 5, 20, 30)),
        ("44,36,1x1", (44, 36, 1, 1)),
    ] {
        let crop = ["b.pfm", "-f", "--crop", crop];
        place.run(&[&scene[..], &crop].concat()).succeeded();
        let (own_width, own_height, part) = read("b.pfm");
        assert_eq!((own_width, own_height), (w, h));
        for (i, mean) in part.iter().enumerate() {
            let (column, row) = (x + i % w, y + i / w);
            assert_eq!(*mean, whole[row * width + column], "{crop:?} {i}");
        }
    }
}

#[test]
fn a_crop_lies_within_the_image_and_belongs_to_a_checkpoint() {
    let place = Scratch::new();
    for wrong in [
        "1,2",
        "1,2,3",
        "1,2,3x4x5",
        "-1,2,3x4",
        "1,2,0x4",
        "a,2,3x4",
        "+1,2,3x4",
    ] {
        let wrong = ["-i", "room.obj", "--crop", wrong];
        place.run(&wrong).failed(2, &["--crop"]);
    }
    for wrong in ["9,0,1x1", "0,7,1x1", "8,0,2x1", "4294967295,0,9x1"] {
        let wrong = ["-i", "missing.obj", "-d9x7", "--crop", wrong];
        place.run(&wrong).failed(1, &["--crop", "9x7"]);
    }
    let scene = ["-i", "room.obj", "-d9x7", "-f", "-o", "a.pfm"];
    let saved = ["--crop=1,2,3x3", "--checkpoint=c"];
    place.run(&[&scene[..], &saved].concat()).succeeded();
    let on = ["--resume=c", "-n2", "--crop=1,2,3x3"];
    place.run(&[&scene[..], &on].concat()).succeeded();
    let other = ["--resume=c", "--crop=2,2,3x3"];
    place.run(&[&scene[..], &other].concat()).failed(1, &["crop"]);
}
