// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Parts of a run add up to the bytes of one run, and what is no part of it
//! is refused (chapter "Shards").

use crate::common;

use std::fs;

use common::{Run, Scratch, finish, signal, wait_until};
use litpt::film::Window;
use litpt::image::Image;
use litpt::state::key::Part;
use litpt::state::shards;
use serde_json::Value;

/// A view of four rows of tiles, the last of them cut off.
const VIEW: [&str; 5] = ["-q", "-f", "-iroom.obj", "-d40x50", "-r0.7"];

fn merge(place: &Scratch, arguments: &[&str]) -> Run {
    place.ptimg(&[&["merge"], arguments].concat())
}

fn part(place: &Scratch, name: &str, options: &[&str]) {
    let run = place.run(&[&VIEW[..], &["-o", name], options].concat());
    run.succeeded();
    assert!(run.stdout.is_empty(), "an image that was not asked for");
}

/// The channels of an image, to the last bit.
fn channels(place: &Scratch, name: &str) -> Vec<Option<Vec<u64>>> {
    let image = Image::read(&place.path(name)).unwrap();
    let Image { means, errors, samples, tile_errors, .. } = image;
    let bits = |v: Vec<f64>| v.into_iter().map(f64::to_bits).collect();
    [Some(means), errors, samples, tile_errors].map(|c| c.map(bits)).into()
}

/// Demands that the images a.* and b.* are the same.
#[track_caller]
fn same(place: &Scratch, what: &str) {
    for kind in ["pgm", "png", "pfm"] {
        let [a, b] = ["a", "b"].map(|name| format!("{name}.{kind}"));
        assert!(place.get(&a) == place.get(&b), "{what}: {kind}");
    }
    assert!(channels(place, "a.exr") == channels(place, "b.exr"), "{what}");
}

const A: [&str; 4] = ["-oa.pgm", "-oa.png", "-oa.pfm", "-oa.exr"];
const B: [&str; 4] = ["-ob.pgm", "-ob.png", "-ob.pfm", "-ob.exr"];

/// Parts of odd sizes and of both kinds, with other threads and instructions,
/// in another order.
#[test]
fn parts_add_up_to_the_bytes_of_one_run() {
    let ranges = ["--samples=0..7", "--samples=7..25", "--samples=25..40"];
    let bands = ["--tiles=1/3", "--tiles=2/3", "--tiles=3/3"];
    for method in ["reference", "sobol", "gather", "auto"] {
        for crop in [&[][..], &["--crop=5,9,30x37"]] {
            let place = Scratch::new();
            let run = ["--integrator", method, "-n40", "-s3"];
            let run = [&run[..], crop].concat();
            place.run(&[&VIEW[..], &run, &A].concat()).succeeded();
            // The second range is divided into bands, the others are not.
            let mut parts = vec![vec![ranges[0], "-j1"]];
            parts.extend(bands.map(|band| vec![ranges[1], band, "-j2"]));
            parts.push(vec![ranges[2], "-j3", "--isa=portable"]);
            let mut names: Vec<_> =
                (0..5).map(|i| format!("{i}.litpt")).collect();
            for (options, name) in parts.iter().zip(&names) {
                part(&place, name, &[&run[..], options].concat());
            }
            names.rotate_left(2);
            let names: Vec<_> = names.iter().map(String::as_str).collect();
            merge(&place, &[&names[..], &B].concat()).succeeded();
            same(&place, &format!("{method} {crop:?}"));
        }
    }
}

/// What a pilot chooses, and what a gather learns, are those of the whole
/// run; a shard that chose by its own samples would choose another method.
#[test]
fn a_part_has_the_method_of_the_whole() {
    let place = Scratch::new();
    let method = |options: &[&str]| {
        let options = [&["-oa.exr", "--report=r.json"], options].concat();
        place.run(&[&VIEW[..], &options].concat()).succeeded();
        place.json("r.json")["settings"].take()
    };
    let whole = method(&["-n512"]);
    let shard = method(&["-n512", "--samples=0..16", "--tiles=1/4"]);
    assert_eq!(shard["integrator"], whole["integrator"]);
    assert_eq!(shard["choice"], whole["choice"]);
    assert_ne!(method(&["-n16"])["choice"], whole["choice"]);
    assert_eq!(shard["part"]["of"], 512);
    assert_eq!(shard["part"]["band"], serde_json::json!([1, 4]));
}

/// Whatever the replicates, the ends of ranges meet, and all samples are in
/// one of them.
#[test]
fn any_division_of_the_samples_remains_one() {
    for replicate in [1, 2, 16, 256] {
        for of in [1, 15, 16, 17, 1000, 65536] {
            let cuts = [0, of / 7, of / 3, of / 2, of - 1, of];
            let mut end = 0;
            for pair in cuts.windows(2) {
                let samples = (pair[0], pair[1]);
                let part = Part { samples, of, band: (1, 1) };
                let part = part.rounded(replicate);
                assert_eq!(part.samples.0, end);
                assert!(part.samples.1.is_multiple_of(replicate));
                end = part.samples.1;
                assert!(end >= pair[1] && end < pair[1] + replicate);
            }
            assert_eq!(end, of.div_ceil(replicate) * replicate);
        }
    }
}

#[test]
fn bands_divide_any_window_at_rows_of_tiles() {
    let windows =
        [((0, 0), (5, 1)), ((3, 5), (9, 70)), ((0, 16), (8, 500))];
    for (corner, size) in windows {
        let window = Window { corner, size };
        for n in 1..=window.tile_rows() {
            let mut row = corner.1;
            for k in 1..=n {
                let band = window.band((k, n));
                assert_eq!(band.corner, (corner.0, row));
                assert_eq!(band.size.0, size.0);
                row = band.end().1;
                assert!(band.size.1 > 0 && (k == n || row % 16 == 0));
            }
            assert_eq!(row, window.end().1);
        }
    }
}

/// A range within one replicate is empty, and the part that follows has the
/// samples.
#[test]
fn a_part_may_be_empty() {
    let place = Scratch::new();
    let run = ["--integrator=sobol", "-n64"];
    place.run(&[&VIEW[..], &run, &A].concat()).succeeded();
    let loud = ["-iroom.obj", "-d40x50", "-r0.7", "-oc.litpt"];
    let run_empty = [&loud[..], &run, &["--samples=1..2"]].concat();
    let empty = place.run(&run_empty);
    empty.succeeded();
    let warning = "the part has no sample: 16 are placed together";
    assert!(empty.stderr.contains(warning), "{}", empty.stderr);
    for (name, range) in [("d", "0..1"), ("e", "2..64")] {
        let name = format!("{name}.litpt");
        let range = format!("--samples={range}");
        part(&place, &name, &[&run[..], &[&range]].concat());
    }
    let files = ["d.litpt", "c.litpt", "e.litpt"];
    merge(&place, &[&files[..], &B].concat()).succeeded();
    same(&place, "with an empty part");
}

#[test]
fn states_that_are_not_parts_of_one_run_are_refused() {
    let place = Scratch::new();
    place.put("other.obj", format!("{}\n", common::ROOM));
    let half = ["-n8", "--samples=0..4", "--integrator=reference"];
    part(&place, "a.litpt", &half);
    for (option, what) in [
        ("-s1", "seed is 0 and 1"),
        ("-iother.obj", "scene_sha256 is"),
        ("-d40x51", "resolution is [40,50] and [40,51]"),
        ("--crop=0,0,40x32", "crop is nothing and \"0,0,40x32\""),
        ("--integrator=sobol", "integrator is"),
        ("-n9", "spp is 8 and 9"),
    ] {
        let rest = ["-n8", "--samples=4..8", "--integrator=reference"];
        part(&place, "b.litpt", &[&rest[..], &[option]].concat());
        let files = ["a.litpt", "b.litpt", "-oc.png"];
        let words = ["a.litpt and b.litpt are not of one run", what];
        merge(&place, &files).failed(1, &words);
        assert!(!place.path("c.png").exists());
    }
}

#[test]
fn samples_that_two_states_hold_are_refused() {
    let place = Scratch::new();
    let of = |name: &str, options: &[&str]| {
        let run = ["-n8", "--integrator=reference"];
        part(&place, name, &[&run[..], options].concat());
    };
    of("a.litpt", &["--samples=0..5"]);
    of("b.litpt", &["--samples=4..8"]);
    of("c.litpt", &["--tiles=2/4"]);
    let both = |files: &[&str], words: &str| {
        let run =
            merge(&place, &[files, &["-oc.png", "--partial"]].concat());
        let words =
            format!("{} and {} both hold {words}", files[0], files[1]);
        run.failed(1, &[&words]);
    };
    both(&["a.litpt", "b.litpt"], "samples 4..5 of rows 0..50");
    both(&["a.litpt", "a.litpt"], "samples 0..5 of rows 0..50");
    both(&["c.litpt", "b.litpt"], "samples 4..8 of rows 16..32");
    place.put("d.litpt", place.get("a.litpt"));
    both(&["a.litpt", "d.litpt"], "samples 0..5 of rows 0..50");
    // An undivided run has all samples, and does not know of how many.
    of("e.litpt", &[]);
    place.put("f.litpt", place.get("e.litpt"));
    both(&["e.litpt", "f.litpt"], "samples 0..8 of rows 0..50");
}

#[test]
fn missing_parts_are_listed_and_need_a_permission() {
    let place = Scratch::new();
    for (name, options) in [
        ("a.litpt", ["--samples=0..4", "--tiles=1/4"]),
        ("b.litpt", ["--samples=2..8", "--tiles=2/4"]),
        ("c.litpt", ["--samples=0..8", "--tiles=4/4"]),
    ] {
        part(&place, name, &[&["-n8"], &options[..]].concat());
    }
    let files = ["a.litpt", "b.litpt", "c.litpt", "-oc.exr"];
    let missing = "parts are missing: samples 4..8 of rows 0..16; \
                   samples 0..2 of rows 16..32; samples 0..8 of rows 32..48";
    merge(&place, &files).failed(1, &[missing, "--partial"]);
    assert!(!place.path("c.exr").exists());
    let partial = ["--partial", "--report=r.json"];
    let run = merge(&place, &[&files[..], &partial].concat());
    run.succeeded();
    assert_eq!(run.stderr, format!("warning: {missing}\n"));
    let image = Image::read(&place.path("c.exr")).unwrap();
    let missing = missing.strip_prefix("parts are missing: ").unwrap();
    assert_eq!(image.attributes["missing"], missing);
    assert_eq!(image.attributes["stopped"], "not yet");
    assert_eq!(place.json("r.json")["settings"]["missing"], missing);
    let samples = image.samples.unwrap();
    for (row, expected) in [(0, 4.), (15, 4.), (16, 6.), (40, 0.), (49, 8.)]
    {
        assert_eq!(samples[40 * row], expected, "row {row}");
    }
    // What is left is found in one piece, however it is divided.
    let files = ["b.litpt", "c.litpt", "-oc.png"];
    let missing = "missing: samples 0..8 of rows 0..16; \
                   samples 0..2 of rows 16..32; samples 0..8 of rows 32..48 ";
    merge(&place, &files).failed(1, &[missing]);
    let halves = ["a.litpt", "d.litpt", "-oc.png"];
    let options = ["-n8", "--samples=0..4", "--tiles=2/4"];
    part(&place, "d.litpt", &options);
    let missing = "missing: samples 4..8 of rows 0..32; \
                   samples 0..8 of rows 32..50 ";
    merge(&place, &halves).failed(1, &[missing]);
}

/// A part that was stopped is taken for what it has; resumed by its name
/// alone, it ends as if it had not been stopped.
#[test]
fn a_part_that_is_stopped_is_missing_its_rest_and_can_be_resumed() {
    for method in ["reference", "sobol", "gather"] {
        let place = Scratch::new();
        let run = ["--integrator", method, "-n1024", "-j2"];
        place.run(&[&VIEW[..], &run, &A].concat()).succeeded();
        let rest = [&run[..], &["--samples=0..512"]].concat();
        part(&place, "1.litpt", &rest);
        let shard = ["--samples=512..1024", "-o2.litpt", "--every=0.001"];
        let shard = [&VIEW[..], &run, &shard].concat();
        let mut child = place.pt(&shard).spawn().unwrap();
        let state = place.path("2.litpt");
        wait_until(&mut child, "state", || state.exists());
        signal("INT", &child);
        assert_eq!(finish(child).status, Some(130));
        let files = ["1.litpt", "2.litpt"];
        let merged = merge(&place, &[&files[..], &B].concat());
        merged.failed(
            1,
            &["parts are missing: samples", "..1024 of rows 0..50"],
        );
        place.run(&["-q", "--resume=2.litpt", "-j1"]).succeeded();
        merge(&place, &[&files[..], &B].concat()).succeeded();
        same(&place, method);
        let range =
            ["-q", "--resume=2.litpt", "-n1024", "--samples=0..512"];
        place.run(&range).failed(1, &["another run: its part is"]);
    }
}

#[test]
fn a_state_that_is_damaged_never_becomes_an_image() {
    let place = Scratch::new();
    part(&place, "a.litpt", &["-n8", "--samples=0..4"]);
    part(&place, "b.litpt", &["-n8", "--samples=4..8"]);
    let whole = place.get("b.litpt");
    // Of another version, whatever else it holds.
    let mut older = whole.clone();
    older[17] = b'2';
    place.put("b.litpt", older);
    let command = ["a.litpt", "b.litpt", "-oc.png", "-f"];
    let words = ["b.litpt: is not a checkpoint of this version of pt"];
    merge(&place, &command).failed(1, &words);
    place.put("b.litpt", &whole[..whole.len() - 1]);
    merge(&place, &command).failed(1, &["b.litpt: is damaged"]);
    fs::remove_file(place.path("b.litpt")).unwrap();
    merge(&place, &command).failed(1, &["b.litpt: cannot read"]);
    assert!(!place.path("c.png").exists());
}

#[test]
fn states_and_images_are_not_mixed_and_not_overwritten() {
    let place = Scratch::new();
    part(&place, "a.litpt", &["-n8", "--samples=0..4"]);
    part(&place, "b.ck.litpt", &["-n8", "--samples=4..8"]);
    fs::rename(place.path("b.ck.litpt"), place.path("b.ck")).unwrap();
    place.run(&[&VIEW[..], &["-oc.exr"]].concat()).succeeded();
    let mixed = merge(&place, &["a.litpt", "c.exr", "-od.exr"]);
    mixed.failed(1, &["c.exr: merge adds the states of a run"]);
    let states = ["a.litpt", "b.ck"];
    merge(&place, &[&states[..], &["-od.exr"]].concat()).succeeded();
    let again = merge(&place, &[&states[..], &["-od.exr"]].concat());
    again.failed(1, &["d.exr: the file exists"]);
    for written in ["-oa.litpt", "--report=b.ck"] {
        let over = [&states[..], &["-f", "-oe.exr", written]].concat();
        merge(&place, &over).failed(1, &["is named twice"]);
    }
}

/// Two runs to one file: one has it, the other says so.
#[test]
fn two_runs_in_one_directory_do_not_take_each_other_s_state() {
    let place = Scratch::new();
    let run = |range| {
        let run = ["-q", "-iroom.obj", "-d40x50", "-n2000", "-oa.litpt"];
        let integrator = ["--integrator=reference", "--samples", range];
        place.pt(&[&run[..], &integrator].concat()).spawn().unwrap()
    };
    let children = [run("0..1000"), run("1000..2000")];
    let runs = children.map(finish);
    let succeeded = runs.iter().filter(|run| run.status == Some(0));
    assert_eq!(succeeded.count(), 1, "{runs:?}");
    let refused = runs.iter().find(|run| run.status == Some(1)).unwrap();
    refused.failed(1, &["a.litpt: the file exists"]);
    let files = [place.path("a.litpt")];
    assert!(shards::merge(&files).unwrap().missing.is_some());
}

/// The report and the page of a merged run are those of a run.
#[test]
fn a_merged_run_has_a_report() {
    let place = Scratch::new();
    let run = ["-n8", "-oa.exr", "--report=a.json"];
    place.run(&[&VIEW[..], &run].concat()).succeeded();
    part(&place, "a.litpt", &["-n8", "--samples=0..4", "-j1"]);
    part(&place, "b.litpt", &["-n8", "--samples=4..8", "-j2"]);
    let files = ["a.litpt", "b.litpt", "-ob.exr"];
    let reports = ["--report=b.json", "--report=b.html", "--report=b.csv"];
    merge(&place, &[&files[..], &reports].concat()).succeeded();
    let [one, both] = ["a.json", "b.json"].map(|name| place.json(name));
    for field in ["scene", "spp", "mean", "mean_stderr", "rmse", "stopped"]
    {
        assert_eq!(one[field], both[field], "{field}");
    }
    assert_eq!(one["rays"], both["rays"]);
    assert_eq!(both["settings"]["spp"], 8);
    assert_eq!(both["settings"]["threads"], Value::Null);
    assert_eq!(both["settings"]["albedo"], 0.7);
    assert_eq!(both["curve"].as_array().unwrap().len(), 1);
    let page = String::from_utf8(place.get("b.html")).unwrap();
    assert!(page.contains("ptimg merge"), "the command");
}
