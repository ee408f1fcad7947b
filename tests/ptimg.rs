// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command `ptimg`: what it answers, and how it ends (chapter "The
//! companion ptimg").

use crate::prelude::*;

use crate::compare::{coin, render};
use crate::formats::{bytes, windowed};
use crate::outputs::png;
use crate::random::Random;

/// What is said on standard output by a run that ends with `status` and
/// without a warning.
#[track_caller]
fn said(place: &Scratch, arguments: &str, status: i32) -> String {
    let run = place.ptimg(arguments);
    assert_eq!(run.status, Some(status), "{}", run.stderr);
    assert!(run.stderr.is_empty(), "{}", run.stderr);
    run.text()
}

/// The only line of JSON that is said.
fn json_of(place: &Scratch, file: &str) -> Value {
    let info = said(place, &format!("info --json {file}"), 0);
    serde_json::from_str(&info).unwrap()
}

/// Writes an image of 40x30 pixels whose weights are 0 or 1, white with
/// the probability `p`.
fn put(place: &Scratch, name: &str, seed: u64, p: f64) -> Image {
    let mut random = Random::seed_from_u64(seed);
    let mut image = render((40, 30), 64, |_, _| coin(p)(&mut random));
    image.attributes.insert("seed".into(), seed.to_string());
    image.attributes.insert("fov".into(), "70".into());
    write(place, name, &image);
    image
}

fn write(place: &Scratch, name: &str, image: &Image) {
    let format = format_of(name.as_ref(), Format::Exr).unwrap();
    place.put(name, bytes(format, image));
}

#[test]
fn info_says_what_the_file_holds() {
    let place = Scratch::new();
    let mut image = put(&place, "a.exr", 1, 0.5);
    let json = json_of(&place, "a.exr");
    let n = image.means.len() as f64;
    let mean = image.means.iter().sum::<f64>() / n;
    let least = image.means.iter().copied().reduce(f64::min).unwrap();
    let most = image.means.iter().copied().reduce(f64::max).unwrap();
    let errors = image.errors.as_mut().unwrap();
    let squares: f64 = errors.iter().map(|e| e * e).sum();
    for (key, expected) in [
        ("mean", mean),
        ("mean_stderr", squares.sqrt() / n),
        ("rmse", (squares / n).sqrt()),
        ("least", least),
        ("greatest", most),
    ] {
        let found = json[key].as_f64().unwrap();
        assert!((found / expected - 1.).abs() < 1e-6, "{key}: {found}");
    }
    let known = json!({
        "file": "a.exr", "width": 40, "height": 30,
        "channels": ["Y", "samples.Y", "stderr.Y"],
        "samples": [64., 64.],
        "attributes": { "fov": "70", "seed": "1" },
        "unknown_errors": 0, "not_finite": 0,
    });
    for (key, expected) in known.as_object().unwrap() {
        assert_eq!(json[key], *expected, "{key}");
    }
    let mean = format!("mean: {}\n", (1e6 * mean).round() / 1e6);
    errors[7] = f64::INFINITY;
    write(&place, "a.exr", &image);
    write(&place, "a.pfm", &image);
    let info = said(&place, "info a.exr a.pfm", 0);
    let head = "file: a.exr\nwidth: 40\nheight: 30\n\
                channels: Y, samples.Y, stderr.Y\n";
    let next = "seed: 1\nfile: a.pfm\nwidth: 40\n";
    let samples = "samples: 64, 64\n";
    says(&info, &[head, &mean, "unknown_errors: 1\n", samples, next]);
    assert!(!info.contains("rmse") && !info.contains("mean_stderr"));
    let json = said(&place, "info --json a.exr a.pfm", 0);
    let (json, other) = json.trim_end().split_once('\n').unwrap();
    assert!(!other.contains('\n'), "{other}");
    let json: Value = serde_json::from_str(json).unwrap();
    assert!(json["rmse"].is_null() && json["mean_stderr"].is_null());
}

#[test]
fn a_report_and_info_say_the_same_errors_of_gathers_too() {
    let place = Scratch::new();
    for (name, seed, method, crop) in [
        ("a.exr", "-s1", "gather", "0,0,40x23"),
        ("b.exr", "-s2", "gather", "0,0,40x23"),
        ("c.exr", "-s3", "gather", "7,3,30x20"),
        ("d.exr", "-s4", "reference", "7,3,30x20"),
    ] {
        let view = format!("-iroom.obj -r0.7 -d40x23 --crop {crop} -n16");
        let files = format!("-qf {seed} -o {name} --report r.json");
        place.done(&format!("{view} --integrator {method} {files}"));
        let report = place.json("r.json");
        let info = json_of(&place, name);
        let channels = info["channels"].as_array().unwrap();
        let shared = channels.contains(&json!("tile_stderr.Y"));
        assert_eq!(shared, method == "gather");
        assert!(info["attributes"]["replicate"].is_string());
        for key in ["mean_stderr", "rmse"] {
            let of = |v: &Value| v[key].as_f64().unwrap();
            let ratio = of(&info) / of(&report);
            assert!((ratio - 1.).abs() < 1e-6, "{name} {key}: {ratio}");
        }
    }
    said(&place, "diff a.exr b.exr", 0);
}

/// The last words are those of the last line, the verdict.
#[test]
fn a_diff_answers_by_its_status_and_in_words() {
    let place = Scratch::new();
    let mut image = put(&place, "a.exr", 1, 0.5);
    put(&place, "same.exr", 2, 0.5);
    put(&place, "other.exr", 2, 0.52);
    put(&place, "twin.exr", 1, 0.6);
    let mut bold = put(&place, "bold.exr", 2, 0.5);
    bold.errors.iter_mut().flatten().for_each(|error| *error *= 0.7);
    write(&place, "bold.exr", &bold);
    let exact = Image { means: vec![0.5; 1200], ..image.clone() };
    write(&place, "b.pfm", &exact);
    write(&place, "c.pfm", &exact);
    for (name, hash) in [("c.exr", "aa"), ("d.exr", "bb"), ("e.exr", "aa")]
    {
        image.attributes.insert("scene_sha256".into(), hash.into());
        write(&place, name, &image);
    }
    let exact = "b.pfm: no error estimates; treated as";
    let seed = "warning: both images come from seed 1: ";
    let image = "inconsistent: chance alone does not explain the difference \
                 (failed: blocks of 16x16, image)";
    for (a, b, status, warning, words) in [
        ("a.exr", "same.exr", 0, "", &["6 tested", "consistent: "][..]),
        ("a.exr", "other.exr", 1, "", &["pixels: 1200 tested", image]),
        ("a.exr", "bold.exr", 1, "", &["times as", "(failed: errors)"]),
        ("a.exr", "b.pfm", 0, "", &[exact, ""]),
        ("b.pfm", "c.pfm", 0, "", &["identical: all pixels have the same"]),
        ("a.exr", "a.exr", 0, seed, &["consistent: "]),
        ("a.exr", "twin.exr", 1, seed, &["inconsistent: "]),
        ("c.exr", "d.exr", 0, "", &["scene_sha256 aa against bb", ""]),
        ("c.exr", "e.exr", 0, seed, &["consistent: "]),
    ] {
        let diff = place.ptimg(&format!("diff {a} {b}"));
        assert_eq!(diff.status, Some(status), "{a} {b}");
        let lines = diff.stderr.lines().count();
        assert_eq!(lines, usize::from(!warning.is_empty()));
        assert!(diff.stderr.starts_with(warning), "{}", diff.stderr);
        let text = diff.text();
        assert!(words.iter().all(|words| text.contains(words)), "{text}");
        let last = text.lines().last().unwrap();
        assert!(last.contains(words[words.len() - 1]), "{last}");
        assert_eq!(said(&place, &format!("diff -q {a} {b}"), status), "");
    }
    // A comparison that cannot be made has the status 2.
    let (width, height) = (30, 40);
    let turned = Image { width, height, ..place.image("a.exr") };
    write(&place, "turned.exr", &turned);
    write(&place, "d.pfm", &place.image("same.exr"));
    for (files, words) in [
        ("a.exr none.exr", &["none.exr: cannot read"][..]),
        ("a.exr room.obj", &["room.obj: it is neither"]),
        ("- -", &["standard input: it is neither"]),
        ("b.pfm d.pfm", &["b.pfm", "error estimates"]),
        ("a.exr turned.exr", &["40x30", "30x40"]),
        ("a.exr", &["<B>", "ptimg --help"]),
        ("a.exr same.exr -o b.pfm", &["b.pfm", "-f"]),
    ] {
        place.ptimg(&format!("diff {files}")).failed(2, words);
    }
    // A map holds z or grey levels.
    said(&place, "diff a.exr same.exr -oz.exr -oz.pgm", 0);
    let [a, b, z] =
        ["a.exr", "same.exr", "z.exr"].map(|name| place.image(name));
    let [one, other] = [&a, &b].map(|p| p.errors.as_ref().unwrap()[0]);
    let expected = (a.means[0] - b.means[0]) / one.hypot(other);
    assert!((z.means[0] - expected).abs() < 1e-5);
    let (.., levels) = pgm(&place.get("z.pgm"));
    for (z, level) in z.means.iter().zip(levels) {
        let expected = 255. * (0.5 + z / 10.).clamp(0., 1.);
        assert!((f64::from(level) - expected).abs() < 1.01, "{z} {level}");
    }
}

#[test]
fn images_of_different_things_are_named_as_such() {
    let place = Scratch::with("room2.obj", ROOM.replace("v 5 5", "v 4 4"));
    let render = |options: &str| place.line(&format!("-n16 -qf {options}"));
    render("-iroom.obj -d40x30 -r0.7 -s1 -oone.exr").succeeded();
    let two = "-iroom2.obj -d48x36 --crop=4,3,40x30 -p0,0,0.5 -t0,1,0.1 \
               -u0,0.1,1 -F70.5 -r0.8 -s2 -otwo.exr";
    render(two).succeeded();
    let text = place.ptimg("diff one.exr two.exr").text();
    let line = text.lines().next().unwrap();
    let said = line.strip_prefix("they show different things: ").unwrap();
    let named = said.split(", ").map(|one| one.split(' ').next().unwrap());
    let names =
        "scene_sha256 resolution crop position target up fov albedo";
    assert_eq!(named.collect::<Vec<_>>().join(" "), names);
    says(said, &["crop none against 4,3,40x30", "fov 70.0 against 70.5"]);
    // Of a hash the first twelve digits are said.
    let (hashes, _) = said.split_once(", ").unwrap();
    assert_eq!(hashes.len(), "scene_sha256  against ".len() + 24);
    let third = "-iroom.obj -d40x30 -r0.7 -s9 -othree.exr --reference";
    let words = ["two.exr: shows something else", "crop 4,3,40x30 against"];
    render(&format!("{third} two.exr")).failed(1, &words);
    render(&format!("{third} one.exr")).succeeded();
}

#[test]
fn a_dash_is_standard_input_whatever_its_format() {
    let place = Scratch::new();
    let image = put(&place, "a.exr", 1, 0.5);
    let run = |input: &[u8], line: &str| feed(place.companion(line), input);
    for name in ["a.exr", "a.pfm", "a.png", "a.pgm"] {
        write(&place, name, &image);
        let info = run(&place.get(name), "info -").succeeded();
        let told = info.stdout.starts_with(b"file: -\nwidth: 40\n");
        assert!(told, "{info:?}");
        let status = run(&place.get(name), "diff -q a.exr -").status;
        assert!(status.is_some_and(|status| status < 2), "{name}");
    }
    run(b"", "info -").failed(1, &["standard input: it is neither"]);
}

#[test]
fn a_dash_is_standard_output_in_the_format_asked_for() {
    let place = Scratch::new();
    put(&place, "a.exr", 1, 0.5);
    put(&place, "b.exr", 2, 0.5);
    for part in ["0..1 -oa.litpt", "1..2 -ob.litpt"] {
        place.done(&format!("room.obj -q -n2 --samples {part}"));
    }
    for (verb, usual) in [
        ("tonemap a.exr", "pgm"),
        ("stderr a.exr", "pgm"),
        ("merge a.litpt b.litpt", "exr"),
        ("diff -q a.exr b.exr", "pgm"),
    ] {
        for (format, option) in [(usual, ""), ("png", "--format png")] {
            let file = format!("file.{format}");
            place.ptimg(&format!("{verb} -f -o {file}")).succeeded();
            let piped = place.ptimg(&format!("{verb} -o- {option}"));
            let piped = piped.succeeded().stdout;
            assert_eq!(piped, place.get(&file), "{verb}");
        }
    }
    assert!(!place.path("-").exists());
    let merge = place.ptimg("merge a.litpt b.litpt -om.csv");
    merge.failed(1, &["m.csv: ", ".pgm, .png, .pfm or .exr", ".litpt"]);
    place.line("room.obj -om.tif").failed(2, &["m.tif: ", ".litpt"]);
    for line in ["merge - b.litpt -of.exr", "daylight - sky.smx"] {
        place
            .ptimg(line)
            .failed(1, &["-: cannot read a state from a pipe"]);
    }
    // The report of a merge names the program that wrote it.
    said(&place, "merge a.litpt b.litpt -om.exr --report m.json", 0);
    let program = format!("ptimg {}", env!("CARGO_PKG_VERSION"));
    assert_eq!(place.json("m.json")["program"], program);
    let shown = place.ptimg("stderr a.exr -o -");
    assert!(shown.stderr.contains("white is a standard error"));
    place.ptimg("diff a.exr b.exr -o -").failed(2, &["map", "-q"]);
    let file = place.ptimg("tonemap a.exr -o t.png --format pgm");
    file.failed(1, &["t.png", "--format"]);
}

#[test]
fn what_was_made_of_a_file_is_said_on_standard_error() {
    let place = Scratch::new();
    let mut image = put(&place, "a.exr", 1, 0.5);
    write(&place, "a.png", &image);
    (image.means[41], image.means[50]) = (f64::NAN, f64::NAN);
    write(&place, "b.exr", &image);
    put(&place, "c.exr", 3, 0.5);
    // As a renderer writes it that was asked for no more than a pixel.
    let crop = windowed(((0, 0), (40, 30)), &[((1, 0), (1, 1))]);
    place.put("d.exr", crop);
    let lost =
        "b.exr: pixels that are not finite numbers: 2, the first at 1,1";
    let window = "d.exr: its data window 1,0,1x1 is not its display \
                  window 0,0,40x30";
    let size = "file: d.exr\nwidth: 40\nheight: 30\n";
    for (arguments, warning, words) in [
        ("info a.png", "a.png: it holds grey levels", "mean: "),
        ("info b.exr", lost, "\nnot_finite: 2\n"),
        ("diff b.exr c.exr", lost, "pixels: 1198 tested"),
        ("diff b.exr c.exr", lost, "\nnot tested: 2 pixels"),
        ("info d.exr", window, size),
        ("info d.exr", window, "mean: 0.5\n"),
        ("diff c.exr d.exr", window, "not tested: 1199 pixels"),
        ("diff d.exr d.exr", window, "identical"),
        ("tonemap d.exr -od.pgm", window, ""),
    ] {
        let run = place.ptimg(arguments).succeeded();
        let warning = format!("warning: {warning}");
        assert!(run.stderr.starts_with(&warning), "{}", run.stderr);
        let text = run.text();
        assert!(text.contains(words), "no {words} in {text}");
        assert!(!text.contains("NaN"), "{text}");
    }
    let (.., levels) = pgm(&place.get("d.pgm"));
    assert!(levels[..3] == [0, 187, 0], "{:?}", &levels[..3]);
    said(&place, "diff -q b.exr c.exr", 0);
    for (file, words) in [
        ("b.exr", &["b.exr", "first at 1,1; a reference needs"][..]),
        ("d.exr", &[window, "a reference needs"]),
    ] {
        let reference = format!("-iroom.obj -d40x30 --reference {file}");
        place.line(&reference).failed(1, words);
    }
}

#[test]
fn an_image_for_the_screen_shows_levels_or_errors() {
    let place = Scratch::new();
    write(&place, "direct.png", &put(&place, "a.exr", 1, 0.5));
    let tonemap =
        |more: &str| place.ptimg(&format!("tonemap a.exr -f -o {more}"));
    tonemap("t.png").succeeded();
    assert_eq!(place.get("t.png"), place.get("direct.png"));
    let levels = |more: &str| {
        tonemap(&format!("t.pgm {more}")).succeeded();
        pgm(&place.get("t.pgm")).2
    };
    assert!(levels("--exposure -100").iter().all(|&l| l == 0));
    let bent = levels("-e9 --tonemap reinhard");
    assert_eq!(bent.iter().max(), Some(&255));
    assert!(bent.iter().any(|&level| level < 255));
    tonemap("t.exr").failed(1, &["t.exr", ".pgm or .png"]);
    tonemap("t.png -ebright").failed(2, &["bright", "--exposure"]);
    tonemap("t.png -tblue").failed(2, &["blue", "reinhard"]);
    // The image of the errors says what white is.
    let shown = said(&place, "stderr a.exr -o e.pgm", 0);
    let white = shown.strip_prefix("white is a standard error of ");
    let white: f64 = white.unwrap().trim().parse().unwrap();
    assert!((white - 0.063).abs() < 0.001, "{white}");
    let (.., levels) = pgm(&place.get("e.pgm"));
    assert!(levels.contains(&255));
    let shown = said(&place, "stderr a.exr -r -o r.pgm", 0);
    assert!(shown.starts_with("white is a relative"), "{shown:?}");
    let bare = Image { errors: None, ..place.image("a.exr") };
    write(&place, "b.exr", &bare);
    place.ptimg("stderr b.exr -o n.pgm").failed(1, &["b.exr", "stderr.Y"]);
    assert!(!place.path("n.pgm").exists());
}

#[test]
fn three_bands_make_a_colour_image() {
    let place = Scratch::new();
    let bands = [1, 2, 3].map(|k| put(&place, &format!("{k}.exr"), k, 0.5));
    let rgb =
        |to: &str| place.ptimg(&format!("rgb 1.exr 2.exr 3.exr {to}"));
    rgb("-oc.png -oc.exr").succeeded();
    let (kind, _, levels) = png(&place.get("c.png"));
    assert_eq!(kind, png::ColorType::Rgb);
    for (k, image) in bands.iter().enumerate() {
        write(&place, "grey.png", image);
        let band = levels.chunks(3).map(|pixel| pixel[k]);
        assert!(band.eq(png(&place.get("grey.png")).2), "{k}");
    }
    let read = place.image("c.exr").means;
    for (i, found) in read.into_iter().enumerate() {
        let pixel = bands.each_ref().map(|b| f64::from(b.means[i] as f32));
        assert_eq!(found, luminance(&pixel));
    }
    let bytes = place.get("c.exr");
    for name in ["stderr.R", "stderr.G", "stderr.B"] {
        assert!(bytes.windows(8).any(|window| window == name.as_bytes()));
    }
    // Three images with a background have an opacity in common.
    let sky = r#"{"zenith":[0,0,1],"cover":"uniform","behind":0.5}"#;
    for (k, image) in (1..).zip(&bands) {
        let mut cut = image.clone();
        cut.more = vec![(OPACITY, vec![1.; image.means.len()])];
        cut.attributes.insert("sky".into(), sky.into());
        write(&place, &format!("{k}.exr"), &cut);
    }
    rgb("-oa.png").succeeded();
    let (kind, _, clear) = png(&place.get("a.png"));
    assert_eq!(kind, png::ColorType::Rgba);
    assert!(clear.chunks(4).flat_map(|pixel| &pixel[..3]).eq(&levels));
    // A brighter picture, and what is refused.
    assert!(rgb("-e auto -od.png").stderr.contains("stops"));
    rgb("-oc.pgm").failed(1, &[".png or .exr"]);
    place.ptimg("rgb 1.exr 2.exr -oe.png").failed(2, &["3 values"]);
    write(&place, "2.exr", &Image::plain(1, 1, vec![0.]));
    rgb("-oe.png").failed(1, &["2.exr", "another size"]);
    let mut other = bands[1].clone();
    other.attributes.insert("fov".into(), "40".into());
    write(&place, "2.exr", &other);
    rgb("-oe.png").told(&["2.exr: fov 70 against 40"]);
    rgb("-f -oe.png").told(&["2.exr: it has another seed"]);
    other.attributes.insert("band".into(), "b".into());
    write(&place, "2.exr", &other);
    rgb("-of.png").failed(1, &["2.exr: it is of --band b, not g"]);
}

#[test]
fn help_lists_every_verb_and_its_options() {
    let place = Scratch::new();
    for (arguments, words) in [
        ("--help", "info tonemap rgb diff merge stderr GPL"),
        ("help tonemap", "--exposure [default: reinhard --force"),
        ("help diff", "-5 standard --quiet"),
    ] {
        let help = said(&place, arguments, 0);
        for word in words.split(' ') {
            assert!(help.contains(word), "{word}");
        }
    }
    place.ptimg("paint").failed(2, &["paint", "ptimg --help"]);
    for verb in ["tonemap a", "rgb a b c", "stderr a", "merge a b"] {
        place.ptimg(verb).failed(2, &["--output"]);
    }
    assert_eq!(place.ptimg("").status, Some(2));
}
