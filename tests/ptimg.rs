// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command `ptimg`: what it answers, and how it ends (chapter "The
//! companion ptimg").

use crate::common;

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;

use common::{Run, Scratch, finish, pgm};
use exr::math::Vec2;
use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, WritableImage};
use litpt::image::{Format, Image};
use litpt::output::ImageTarget;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

fn run(place: &Scratch, arguments: &[&str]) -> Run {
    let mut command = place.command(env!("CARGO_BIN_EXE_ptimg"));
    finish(command.args(arguments).spawn().unwrap())
}

/// Writes an image of 40x30 pixels whose weights are 0 or 1, white with
/// the probability `p`.
fn put(place: &Scratch, name: &str, seed: u64, p: f64) -> Image {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let n = 64.;
    let mut mean = |_| {
        (0..64).map(|_| f64::from(random.random_bool(p))).sum::<f64>() / n
    };
    let means: Vec<f64> = (0..1200).map(&mut mean).collect();
    let error = |m: &f64| f64::sqrt(m * (1. - m) / (n - 1.));
    let attributes = [("seed", seed.to_string()), ("fov", "70".into())];
    let own = |(name, value): (&str, String)| (name.to_owned(), value);
    let image = Image {
        width: 40,
        height: 30,
        errors: Some(means.iter().map(error).collect()),
        samples: Some(vec![n; means.len()]),
        means,
        tile_errors: None,
        attributes: attributes.into_iter().map(own).collect(),
    };
    write(place, name, &image);
    image
}

fn write(place: &Scratch, name: &str, image: &Image) {
    let place =
        ImageTarget::file(&place.path(name), Format::Exr, true).unwrap();
    place.write(image).unwrap();
}

fn text(run: &Run) -> &str {
    std::str::from_utf8(&run.stdout).unwrap()
}

#[test]
fn info_says_what_the_file_holds() {
    let place = Scratch::new();
    let image = put(&place, "a.exr", 1, 0.5);
    let run = run(&place, &["info", "a.exr"]);
    run.succeeded();
    let said = text(&run);
    let n = image.means.len() as f64;
    let mean = image.means.iter().sum::<f64>() / n;
    let squares: f64 = image.errors.unwrap().iter().map(|e| e * e).sum();
    let (error, rmse) = (squares.sqrt() / n, (squares / n).sqrt());
    for words in [
        "a.exr: 40x30 pixels\n".to_owned(),
        "stderr.Y".to_owned(),
        format!("mean radiance: {mean:.6} ± {error:.6}\n"),
        format!("rmse: {rmse:.6}\n"),
        "samples per pixel: 64\n".to_owned(),
        "seed: 1\n".to_owned(),
    ] {
        assert!(said.contains(&words), "no {words} in {said}");
    }
}

#[test]
fn report_summary_and_info_print_the_same_errors() {
    let place = Scratch::new();
    let render = ["-iroom.obj", "-d23x17", "-r0.7", "-n9"];
    let files = ["-o", "a.exr", "--report", "r.json"];
    let summary = place.run(&[&render[..], &files].concat());
    summary.succeeded();
    let report: serde_json::Value =
        serde_json::from_slice(&place.get("r.json")).unwrap();
    let number = |key: &str| report[key].as_f64().unwrap();
    let mean = format!("{:.6}", number("mean"));
    let error = format!("{:.6}", number("mean_stderr"));
    let rmse = format!("{:.6}", number("rmse"));
    let said = format!("mean radiance {mean} ± {error}, rmse {rmse}\n");
    assert!(summary.stderr.contains(&said), "{}", summary.stderr);
    let info = run(&place, &["info", "a.exr"]);
    let mean = format!("mean radiance: {mean} ± {error}\n");
    assert!(text(&info).contains(&mean), "{}", text(&info));
    let rmse = format!("rmse: {rmse}\n");
    assert!(text(&info).contains(&rmse), "{}", text(&info));
}

#[test]
fn gathers_are_told_and_compared_by_their_tiles() {
    let place = Scratch::new();
    let gather = |name: &str, options: &[&str]| {
        let method = ["--integrator", "gather", "-n16", "-q"];
        let view = ["-iroom.obj", "-d40x23", "-r0.7"];
        let files = ["-o", name, "--report", "r.json", "-f"];
        let all = [&view[..], &method, &files, options].concat();
        place.run(&all).succeeded();
        serde_json::from_slice(&place.get("r.json")).unwrap()
    };
    let crop = "--crop=7,3,30x20";
    let names = ["a.exr", "b.exr", "c.exr"];
    for (name, options) in
        names.iter().zip([&[][..], &["-s2"], &["-s3", crop]])
    {
        let report: serde_json::Value = gather(name, options);
        let info = run(&place, &["info", "--json", name]);
        let info: serde_json::Value =
            serde_json::from_str(text(&info)).unwrap();
        assert_eq!(info["channels"][3], "tile_stderr.Y");
        for key in ["mean_stderr", "rmse"] {
            let of = |v: &serde_json::Value| v[key].as_f64().unwrap();
            let ratio = of(&info) / of(&report);
            assert!((ratio - 1.).abs() < 1e-6, "{name} {key}: {ratio}");
        }
    }
    run(&place, &["diff", "a.exr", "b.exr"]).succeeded();
}

#[test]
fn info_says_that_an_error_is_unknown() {
    let place = Scratch::new();
    let mut image = put(&place, "a.exr", 1, 0.5);
    image.errors.as_mut().unwrap()[7] = f64::INFINITY;
    write(&place, "a.exr", &image);
    write(&place, "a.pfm", &image);
    let run = run(&place, &["info", "a.exr", "a.pfm"]);
    run.succeeded();
    assert!(text(&run).contains("error unknown"));
    assert!(text(&run).contains("pixels of unknown error: 1\n"));
    assert!(text(&run).contains("a.pfm: 40x30 pixels\n"));
}

#[test]
fn independent_runs_are_consistent_with_status_0() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    put(&place, "b.exr", 2, 0.5);
    let run = run(&place, &["diff", "a.exr", "b.exr"]);
    run.succeeded();
    assert!(run.stderr.is_empty(), "{}", run.stderr);
    let said = text(&run);
    assert!(said.contains("pixels: 1200 tested"), "{said}");
    assert!(said.contains("blocks of 16x16: 6 tested"), "{said}");
    assert!(said.lines().last().unwrap().starts_with("consistent"));
}

#[test]
fn different_images_are_inconsistent_with_status_1() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    put(&place, "b.exr", 2, 0.52);
    let run = run(&place, &["diff", "a.exr", "b.exr"]);
    assert_eq!(run.status, Some(1));
    let said = text(&run).lines().last().unwrap();
    assert!(said.starts_with("inconsistent"), "{said}");
    assert!(said.ends_with("(failed: blocks of 16x16, image)"), "{said}");
}

#[test]
fn errors_that_are_too_small_are_inconsistent_by_name() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    let mut image = put(&place, "b.exr", 2, 0.5);
    image.errors.iter_mut().flatten().for_each(|error| *error *= 0.7);
    write(&place, "b.exr", &image);
    let run = run(&place, &["diff", "a.exr", "b.exr"]);
    assert_eq!(run.status, Some(1));
    let said = text(&run);
    assert!(said.contains("errors: differences 1."), "{said}");
    assert!(said.trim_end().ends_with("(failed: errors)"), "{said}");
}

#[test]
fn a_quiet_diff_says_nothing() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    put(&place, "b.exr", 2, 0.6);
    for (other, status) in [("a.exr", 0), ("b.exr", 1)] {
        let run = run(&place, &["diff", "-q", "a.exr", other]);
        assert_eq!(run.status, Some(status));
        assert!(run.stdout.is_empty() && run.stderr.is_empty());
    }
}

#[test]
fn a_comparison_that_cannot_be_made_has_status_2() {
    let place = Scratch::new();
    let image = put(&place, "a.exr", 1, 0.5);
    write(&place, "a.pfm", &image);
    let diff = |a, b| run(&place, &["diff", a, b]);
    diff("a.exr", "none.exr").failed(2, &["none.exr: cannot read"]);
    diff("a.exr", "room.obj").failed(2, &["room.obj: it is neither"]);
    diff("-", "-").failed(2, &["standard input", "once"]);
    write(&place, "b.pfm", &put(&place, "b.exr", 2, 0.5));
    diff("a.pfm", "b.pfm").failed(2, &["a.pfm", "errors"]);
    let small = Image { width: 30, height: 40, ..image };
    write(&place, "b.exr", &small);
    diff("a.exr", "b.exr").failed(2, &["40x30", "30x40"]);
    run(&place, &["diff", "a.exr"]).failed(2, &["<B>", "ptimg --help"]);
    let existing = ["diff", "a.exr", "b.exr", "-o", "a.pfm"];
    run(&place, &existing).failed(2, &["a.pfm", "-f"]);
}

#[test]
fn a_reference_without_errors_is_taken_as_exact() {
    let place = Scratch::new();
    let image = put(&place, "a.exr", 1, 0.5);
    let means = vec![0.5; image.means.len()];
    write(&place, "b.pfm", &Image { means, ..image });
    let run = run(&place, &["diff", "a.exr", "b.pfm"]);
    run.succeeded();
    assert!(
        text(&run).starts_with("b.pfm: no errors; it is taken as exact")
    );
}

#[test]
fn images_of_one_seed_are_compared_with_a_warning() {
    let place = Scratch::new();
    put(&place, "a.exr", 0, 0.5);
    put(&place, "b.exr", 0, 0.6);
    for (other, status) in [("a.exr", 0), ("b.exr", 1)] {
        let run = run(&place, &["diff", "a.exr", other]);
        assert_eq!(run.status, Some(status));
        let warning = "warning: both images come from seed 0: ";
        assert!(run.stderr.starts_with(warning), "{}", run.stderr);
        assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
    }
}

#[test]
fn one_seed_for_two_scenes_is_compared_without_a_warning() {
    let place = Scratch::new();
    let image = put(&place, "a.exr", 1, 0.5);
    for (name, hash) in [("a.exr", "aa"), ("b.exr", "bb"), ("c.exr", "aa")]
    {
        let mut image = image.clone();
        let hash = ("scene_sha256".to_owned(), hash.to_owned());
        image.attributes.extend([hash]);
        write(&place, name, &image);
    }
    let warns = |a, b| !run(&place, &["diff", a, b]).stderr.is_empty();
    assert!(!warns("a.exr", "b.exr"));
    assert!(warns("a.exr", "c.exr"));
}

/// The options that decide what an image shows, each with another value
/// than the one before it.
const OTHERS: [&[&str]; 7] = [
    &["-p0,0,0.5"],
    &["-t0,1,0.1"],
    &["-u0,0.1,1"],
    &["-F70.5"],
    &["-r0.8"],
    &["-iroom2.obj"],
    &["-d48x36", "--crop", "4,3,40x30"],
];

/// Renders of one view and of `OTHERS`: the names of their files.
fn renders(place: &Scratch) -> Vec<String> {
    place.put("room2.obj", common::ROOM.replace("v 5 5", "v 4 4"));
    let render = |i: usize, other: &[&str]| {
        let (seed, file) = (format!("-s{i}"), format!("{i}.exr"));
        let mut options = vec!["-iroom.obj", "-d40x30", "-r0.7", "-n16"];
        let replaced =
            |own: &&str| !other.iter().any(|o| own[..2] == o[..2]);
        options.retain(replaced);
        options.extend(other);
        options.extend([&seed[..], "-q", "-o", &file]);
        place.run(&options).succeeded();
        file
    };
    let others = OTHERS.iter().copied().enumerate();
    let others = others.map(|(i, other)| render(i + 1, other));
    let others: Vec<_> = others.collect();
    let one = render(0, &[]);
    std::iter::once(one).chain(others).collect()
}

/// What each of `OTHERS` is called in a file.
const NAMES: [&str; 7] =
    ["position", "target", "up", "fov", "albedo", "scene_sha256", "crop"];

#[test]
fn images_of_different_things_are_named_as_such() {
    let place = Scratch::new();
    let files = renders(&place);
    for (file, name) in files[1..].iter().zip(NAMES) {
        let diff = run(&place, &["diff", &files[0], file]);
        let line = text(&diff).lines().next().unwrap();
        let said = line.strip_prefix("they show different things: ");
        assert!(said.is_some_and(|s| s.contains(name)), "{name}: {line}");
        let size: &[&str] = match name {
            "crop" => &["-d40x30"],
            _ => &["-d40x30", "-n1", "-q"],
        };
        let reference = ["-iroom.obj", "-r0.7", "-s9", "--reference", file];
        let refused = place.run(&[&reference[..], size].concat());
        refused.failed(1, &[file, name, "something else than this run"]);
    }
    let same = ["-iroom.obj", "-r0.7", "-s9", "-d40x30", "--reference"];
    place.run(&[&same[..], &[&files[0]]].concat()).succeeded();
}

#[test]
fn the_map_of_a_diff_holds_z_or_grey_levels() {
    let place = Scratch::new();
    let a = put(&place, "a.exr", 1, 0.5);
    let b = put(&place, "b.exr", 2, 0.5);
    for map in ["z.exr", "z.pgm"] {
        run(&place, &["diff", "a.exr", "b.exr", "-o", map]).succeeded();
    }
    let z = Image::read(&place.path("z.exr")).unwrap().means;
    let error = |p: &Image| p.errors.as_ref().unwrap()[0];
    let variance = error(&a).powi(2) + error(&b).powi(2);
    let expected = (a.means[0] - b.means[0]) / variance.sqrt();
    assert!((z[0] - expected).abs() < 1e-5);
    let (width, height, levels) = pgm(&place.get("z.pgm"));
    assert_eq!((width, height), (40, 30));
    for (&z, level) in z.iter().zip(levels) {
        let expected = 255. * (0.5 + z / 10.).clamp(0., 1.);
        assert!((f64::from(level) - expected).abs() < 1.01, "{z} {level}");
    }
}

/// Alone, beside a state, and from standard input.
#[test]
fn images_are_not_merged() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    write(&place, "b.png", &put(&place, "b.exr", 2, 0.5));
    let part = ["-q", "room.obj", "-d8x8", "-n2", "--samples", "0..1"];
    place.run(&[&part[..], &["-o", "a.litpt"]].concat()).succeeded();
    for (files, named) in [
        (["a.exr", "b.exr"], "a.exr"),
        (["a.litpt", "b.png"], "b.png"),
        (["-", "a.litpt"], "-"),
    ] {
        let merge = [&["merge"], &files[..], &["-o", "c.exr"]].concat();
        let words = format!("{named}: merge adds the states of a run");
        let words = [&words, "pt -o a.litpt", "--checkpoint", "not images"];
        run(&place, &merge).failed(1, &words);
    }
    let merge = |files: &[&str]| {
        run(&place, &[&["merge", "-oc.exr"], files].concat())
    };
    merge(&["a.litpt", "none.exr"]).failed(1, &["none.exr: cannot read"]);
    merge(&["a.litpt"]).failed(2, &["only 1"]);
    assert!(!place.path("c.exr").exists());
}

/// Runs `ptimg` with `input` on its standard input.
fn feed(place: &Scratch, input: &[u8], arguments: &[&str]) -> Run {
    let mut command = place.command(env!("CARGO_BIN_EXE_ptimg"));
    command.args(arguments).stdin(std::process::Stdio::piped());
    let mut child = command.spawn().unwrap();
    child.stdin.take().unwrap().write_all(input).unwrap();
    finish(child)
}

#[test]
fn a_dash_is_standard_input_whatever_its_format() {
    let place = Scratch::new();
    let image = put(&place, "a.exr", 1, 0.5);
    for name in ["a.exr", "a.pfm", "a.png", "a.pgm"] {
        write(&place, name, &image);
        let info = feed(&place, &place.get(name), &["info", "-"]);
        info.succeeded();
        assert!(text(&info).starts_with("-: 40x30 pixels\n"), "{info:?}");
        let diff = ["diff", "-q", "a.exr", "-"];
        let status = feed(&place, &place.get(name), &diff).status;
        assert!(status.is_some_and(|status| status < 2), "{name}");
    }
    let nothing = feed(&place, b"", &["info", "-"]);
    nothing.failed(1, &["standard input: it is neither"]);
}

#[test]
fn a_dash_is_standard_output_in_the_format_asked_for() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    put(&place, "b.exr", 2, 0.5);
    for (samples, state) in [("0..1", "a.litpt"), ("1..2", "b.litpt")] {
        let part = ["-q", "room.obj", "-d8x8", "-n2", "--samples", samples];
        place.run(&[&part[..], &["-o", state]].concat()).succeeded();
    }
    let verbs: [&[&str]; 4] = [
        &["tonemap", "a.exr"],
        &["stderr", "a.exr"],
        &["merge", "a.litpt", "b.litpt"],
        &["diff", "-q", "a.exr", "b.exr"],
    ];
    for verb in verbs {
        let usual = if verb[0] == "merge" { "exr" } else { "pgm" };
        for (format, usual) in [(usual, true), ("png", false)] {
            let file = format!("file.{format}");
            let named = [verb, &["-f", "-o", &file]].concat();
            run(&place, &named).succeeded();
            let option = ["-o", "-", "--format", format];
            let option = if usual { &option[..2] } else { &option };
            let piped = run(&place, &[verb, option].concat());
            piped.succeeded();
            assert_eq!(piped.stdout, place.get(&file), "{verb:?}");
        }
    }
    assert!(!place.path("-").exists());
    let shown = run(&place, &["stderr", "a.exr", "-o", "-"]);
    assert!(shown.stderr.contains("white is a standard error"));
    let map = ["diff", "a.exr", "b.exr", "-o", "-"];
    run(&place, &map).failed(2, &["map", "-q"]);
    let file = ["tonemap", "a.exr", "-o", "t.png", "--format", "pgm"];
    run(&place, &file).failed(1, &["t.png", "--format"]);
}

#[test]
fn what_was_made_of_a_file_is_said_on_standard_error() {
    let place = Scratch::new();
    let image = put(&place, "a.exr", 1, 0.5);
    write(&place, "a.png", &image);
    let info = run(&place, &["info", "a.png"]);
    info.succeeded();
    let warning = "warning: a.png: it holds grey levels";
    assert!(info.stderr.starts_with(warning), "{}", info.stderr);
    let mut broken = image.clone();
    broken.means[41] = f64::NAN;
    broken.means[50] = f64::NAN;
    write(&place, "b.exr", &broken);
    let info = run(&place, &["info", "b.exr"]);
    let warning = "b.exr: pixels that are not finite numbers: 2, the \
                   first at 1,1\n";
    assert!(info.stderr.ends_with(warning), "{}", info.stderr);
    assert!(
        text(&info).contains("  pixels that are not finite numbers: 2")
    );
    assert!(!text(&info).contains("NaN"), "{}", text(&info));
    put(&place, "c.exr", 3, 0.5);
    let diff = run(&place, &["diff", "b.exr", "c.exr"]);
    assert_eq!(diff.status, Some(0), "{}", text(&diff));
    assert!(text(&diff).contains("pixels: 1198 tested"));
    assert!(text(&diff).contains("not tested: 2 pixels"));
    assert!(!text(&diff).contains("NaN"), "{}", text(&diff));
    let quiet = run(&place, &["diff", "-q", "b.exr", "c.exr"]);
    assert!(quiet.stderr.is_empty(), "{}", quiet.stderr);
    let reference = ["-iroom.obj", "-d40x30", "--reference", "b.exr"];
    let refused = place.run(&[&reference[..], &["-q"]].concat());
    refused.failed(1, &["b.exr", "first at 1,1; a reference needs"]);
}

#[test]
fn info_as_json_has_what_info_prints() {
    let place = Scratch::new();
    let mut image = put(&place, "a.exr", 1, 0.5);
    image.errors.as_mut().unwrap()[7] = f64::INFINITY;
    write(&place, "b.exr", &image);
    let both = run(&place, &["info", "--json", "a.exr", "b.exr"]);
    both.succeeded();
    let lines: Vec<serde_json::Value> = text(&both)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let [one, two] = &lines[..] else { panic!("{lines:?}") };
    let info = run(&place, &["info", "a.exr"]);
    let (mean, error) = (&one["mean"], &one["mean_stderr"]);
    let (mean, error) = (mean.as_f64().unwrap(), error.as_f64().unwrap());
    for line in [
        format!("mean radiance: {mean:.6} ± {error:.6}\n"),
        format!("rmse: {:.6}\n", one["rmse"].as_f64().unwrap()),
        format!(
            "least and greatest: {:.6}, {:.6}\n",
            one["least"].as_f64().unwrap(),
            one["greatest"].as_f64().unwrap()
        ),
    ] {
        assert!(text(&info).contains(&line), "{line} not in {info:?}");
    }
    assert_eq!(one["file"], "a.exr");
    assert_eq!((&one["width"], &one["height"]), (&40.into(), &30.into()));
    assert_eq!(one["channels"][2], "samples.Y");
    assert_eq!(one["samples"], serde_json::json!([64., 64.]));
    assert_eq!(one["attributes"]["fov"], "70");
    assert_eq!(
        (&one["unknown_errors"], &one["not_finite"]),
        (&0.into(), &0.into())
    );
    assert!(two["rmse"].is_null() && two["mean_stderr"].is_null());
    assert_eq!(two["unknown_errors"], 1);
}

#[test]
fn an_image_for_the_screen_has_the_levels_of_pt() {
    let place = Scratch::new();
    let image = put(&place, "a.exr", 1, 0.5);
    write(&place, "direct.png", &image);
    let tonemap = |more: &[&str]| {
        let arguments = ["tonemap", "a.exr", "-f", "-o"];
        run(&place, &[&arguments[..], more].concat())
    };
    tonemap(&["t.png"]).succeeded();
    assert_eq!(place.get("t.png"), place.get("direct.png"));
    tonemap(&["t.pgm", "--exposure", "-100"]).succeeded();
    let (.., levels) = pgm(&place.get("t.pgm"));
    assert!(levels.iter().all(|&level| level == 0));
    tonemap(&["t.pgm", "-e9", "--tonemap", "reinhard"]).succeeded();
    let (.., levels) = pgm(&place.get("t.pgm"));
    assert_eq!(levels.iter().max(), Some(&255));
    assert!(levels.iter().any(|&level| level < 255));
    tonemap(&["t.exr"]).failed(1, &["t.exr", ".pgm or .png"]);
    tonemap(&["t.png", "-ebright"]).failed(2, &["bright", "--exposure"]);
    tonemap(&["t.png", "-tblue"]).failed(2, &["blue", "reinhard"]);
}

#[test]
fn the_image_of_the_errors_says_what_white_is() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    let shown = run(&place, &["stderr", "a.exr", "-o", "e.pgm"]);
    shown.succeeded();
    let said = text(&shown);
    let white = said.strip_prefix("white is a standard error of ").unwrap();
    let white: f64 = white.trim().parse().unwrap();
    assert!((white - 0.063).abs() < 0.001, "{white}");
    let (.., levels) = pgm(&place.get("e.pgm"));
    assert!(levels.contains(&255));
    let relative = ["stderr", "a.exr", "-r", "-o", "r.pgm"];
    let shown = run(&place, &relative);
    assert!(text(&shown).starts_with("white is a relative"), "{shown:?}");
    let bare = Image {
        errors: None,
        samples: None,
        attributes: BTreeMap::new(),
        ..Image::read(&place.path("a.exr")).unwrap()
    };
    write(&place, "b.exr", &bare);
    let nothing = ["stderr", "b.exr", "-o", "n.pgm"];
    run(&place, &nothing).failed(1, &["b.exr", "stderr.Y"]);
    assert!(!place.path("n.pgm").exists());
}

#[test]
fn images_without_errors_may_be_identical() {
    let place = Scratch::new();
    let image = put(&place, "a.exr", 1, 0.5);
    write(&place, "a.pfm", &image);
    fs::copy(place.path("a.pfm"), place.path("c.pfm")).unwrap();
    let same = run(&place, &["diff", "a.pfm", "c.pfm", "-o", "z.exr"]);
    same.succeeded();
    assert!(
        text(&same)
            .ends_with("\nidentical: all pixels have the same values\n")
    );
    let z = Image::read(&place.path("z.exr")).unwrap().means;
    assert_eq!(z, [0.; 1200]);
}

/// An image of the pixel 1,0 of 40x30, as a renderer writes it that was
/// asked for no more.
fn put_crop(place: &Scratch, name: &str) {
    let channel = AnyChannel::new("Y", FlatSamples::F32(vec![0.5]));
    let channels = AnyChannels::sort([channel].into_iter().collect());
    let mut image = exr::prelude::Image::from_channels((1, 1), channels);
    image.attributes.display_window.size = Vec2(40, 30);
    image.layer_data.attributes.layer_position = Vec2(1, 0);
    image.write().to_file(place.path(name)).unwrap();
}

#[test]
fn the_windows_of_an_image_are_told_by_every_verb() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    put_crop(&place, "c.exr");
    let windows = "c.exr: its data window 1,0,1x1 is not its display \
                   window 0,0,40x30";
    for arguments in [
        &["info", "c.exr"][..],
        &["diff", "a.exr", "c.exr"],
        &["diff", "c.exr", "c.exr"],
        &["tonemap", "c.exr", "-o", "c.pgm"],
    ] {
        let run = run(&place, arguments);
        run.succeeded();
        assert!(run.stderr.contains(windows), "{}", run.stderr);
    }
    let info = run(&place, &["info", "c.exr"]);
    assert!(text(&info).starts_with("c.exr: 40x30 pixels"), "{info:?}");
    assert!(text(&info).contains("mean radiance: 0.500000"), "{info:?}");
    let diff = run(&place, &["diff", "a.exr", "c.exr"]);
    assert!(text(&diff).contains("not tested: 1199 pixels"), "{diff:?}");
    let (.., levels) = pgm(&place.get("c.pgm"));
    assert!(levels[..3] == [0, 187, 0], "{:?}", &levels[..3]);
    let bare = run(&place, &["stderr", "c.exr", "-o", "e.pgm"]);
    assert_eq!(bare.status, Some(1));
    assert!(bare.stderr.contains(windows), "{}", bare.stderr);
    let reference = ["-iroom.obj", "-d40x30", "--reference", "c.exr"];
    let refused = place.run(&reference);
    refused.failed(1, &[windows, "a reference needs"]);
}

#[test]
fn a_report_names_the_program_that_wrote_it() {
    let place = Scratch::new();
    let program = |file: &str| {
        let report: serde_json::Value =
            serde_json::from_slice(&place.get(file)).unwrap();
        report["program"].as_str().unwrap().to_owned()
    };
    let part = ["-q", "room.obj", "-d8x8", "-n2"];
    for (samples, file) in [("0..1", "a"), ("1..2", "b")] {
        let (state, report) =
            (format!("{file}.litpt"), format!("{file}.json"));
        let shard =
            ["--samples", samples, "-o", &state, "--report", &report];
        place.run(&[&part[..], &shard].concat()).succeeded();
    }
    let version = env!("CARGO_PKG_VERSION");
    assert_eq!(program("a.json"), format!("pt {version}"));
    let merge = ["merge", "a.litpt", "b.litpt", "-o", "m.exr"];
    let report = ["--report", "m.json"];
    run(&place, &[&merge[..], &report].concat()).succeeded();
    assert_eq!(program("m.json"), format!("ptimg {version}"));
}

#[test]
fn help_lists_every_verb_and_its_options() {
    let place = Scratch::new();
    let help = run(&place, &["--help"]);
    help.succeeded();
    for verb in ["info", "tonemap", "diff", "merge", "stderr", "GPL"] {
        assert!(text(&help).contains(verb), "{verb}");
    }
    let help = run(&place, &["help", "tonemap"]);
    for word in ["--exposure", "default: 0", "reinhard", "--force"] {
        assert!(text(&help).contains(word), "{word}");
    }
    run(&place, &["paint"]).failed(2, &["paint", "ptimg --help"]);
    assert_eq!(run(&place, &[]).status, Some(2));
}

#[test]
fn a_reader_who_has_seen_enough_is_no_error() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    let mut command = place.command(env!("CARGO_BIN_EXE_ptimg"));
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    command.args(["info", "a.exr"]).stdout(writer);
    assert_eq!(finish(command.spawn().unwrap()).status, Some(0));
    assert!(fs::metadata(place.path("a.exr")).is_ok());
}

#[test]
fn a_file_beyond_the_limit_of_size_is_an_error() {
    let place = Scratch::new();
    place.run(&["room.obj", "-d256x192", "-q", "-o", "a.exr"]).succeeded();
    let mut command = place.command("sh");
    command.args(["-c", "ulimit -f 1; exec \"$0\" \"$@\""]);
    command.arg(env!("CARGO_BIN_EXE_ptimg"));
    command.args(["tonemap", "a.exr", "-o", "a.png"]);
    let run = common::finish(command.spawn().unwrap());
    run.failed(1, &["a.png: cannot write: File too large"]);
    place.holds_only(&["a.exr"]);
}
