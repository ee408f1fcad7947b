// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Parts of a run add up to the bytes of one run, and what is no part of it
//! is refused (chapter "Shards").

use crate::prelude::*;

use crate::checkpoint::run_key_with;
use litpt::key::Part;
use litpt::state::{checkpoint::Checkpoint, shards};

/// A view of four rows of tiles, the last of them cut off.
const VIEW: &str = "-q -f -iroom.obj -d40x50 -r0.7";

fn merge(place: &Scratch, arguments: &str) -> Run {
    place.ptimg(&format!("merge {arguments}"))
}

fn part(place: &Scratch, name: &str, options: &str) {
    let run = place.done(&format!("{VIEW} -o {name} {options}"));
    assert!(run.stdout.is_empty(), "an image that was not asked for");
}

/// The channels of an image, to the last bit.
fn channels(place: &Scratch, name: &str) -> Vec<Option<Vec<u64>>> {
    let Image { means, errors, samples, tile_errors, .. } =
        place.image(name);
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

const A: &str = "-oa.pgm -oa.png -oa.pfm -oa.exr";
/// Of a merge, the picture is made from the state, with the scene.
const B: &str = "-ob.pgm -ob.litpt -ob.pfm";
const PICTURE: &str = "-qf --resume=b.litpt -ob.png -ob.exr";

/// Parts of odd sizes and of both kinds, with other threads and instructions,
/// in another order.
#[test]
fn parts_add_up_to_the_bytes_of_one_run() {
    // The second range is divided into bands, the others are not.
    let parts = [
        "--samples=0..7 -j1",
        "--samples=7..25 --tiles=1/3 -j2",
        "--samples=7..25 --tiles=2/3 -j2",
        "--samples=7..25 --tiles=3/3 -j2",
        "--samples=25..40 -j3 --isa=portable",
    ];
    for method in ["reference", "sobol", "gather", "auto"] {
        for crop in ["", "--crop=5,9,30x37"] {
            let place = Scratch::new();
            let run = format!("--integrator {method} -n40 -s3 {crop}");
            place.done(&format!("{VIEW} {run} {A}"));
            for (options, i) in parts.iter().zip(0..) {
                let name = format!("{i}.litpt");
                part(&place, &name, &format!("{run} {options}"));
            }
            let names = "2.litpt 3.litpt 4.litpt 0.litpt 1.litpt";
            merge(&place, &format!("{names} {B}")).succeeded();
            place.done(PICTURE);
            same(&place, &format!("{method} {crop}"));
        }
    }
    // A range within one replicate is empty, and the part that follows has
    // the samples.
    let place = Scratch::new();
    let run = "--integrator=sobol -n64";
    place.done(&format!("{VIEW} {run} {A}"));
    let loud = VIEW.replacen("-q", "", 1);
    let empty =
        place.done(&format!("{loud} -oc.litpt --samples=1..2 {run}"));
    let warning = "the part has no sample: 16 are placed together";
    empty.told(&[warning]);
    part(&place, "d.litpt", &format!("{run} --samples=0..1"));
    part(&place, "e.litpt", &format!("{run} --samples=2..64"));
    merge(&place, &format!("d.litpt c.litpt e.litpt {B}")).succeeded();
    place.done(PICTURE);
    same(&place, "with an empty part");
}

/// What one part has learnt, or a run that does nothing else, all others
/// take: together they trace the rays of one run, and its image.
#[test]
fn what_was_learnt_once_is_not_learnt_again() {
    let place = Scratch::new();
    let run = "--integrator=gather -n64";
    place.done(&format!("{VIEW} {run} {A} --report=a.json"));
    part(&place, "0.litpt", &format!("{run} --samples=0..0"));
    let rays = |name: &str| place.json(name)["rays"].as_u64().unwrap();
    for (i, samples) in
        [(1, "0..9"), (2, "9..64 --tiles=1/2"), (3, "9..64 --tiles=2/2")]
    {
        let samples = format!("--samples={samples}");
        let learnt = format!("--learnt={}.litpt", i - 1);
        let options = format!("{run} {samples} {learnt}");
        part(&place, &format!("{i}.litpt"), &options);
    }
    let all = "1.litpt 2.litpt 0.litpt 3.litpt";
    merge(&place, &format!("{all} {B} --report=b.json")).succeeded();
    assert_eq!(rays("b.json"), rays("a.json"));
    place.done(&format!("{PICTURE} --report=c.json"));
    assert_eq!(rays("c.json"), rays("a.json"));
    same(&place, "learnt once");
    // What is not of this run is refused, and nothing is overwritten.
    for (option, words) in [
        ("-s1", "0.litpt: belongs to another run: its seed is 0, not 1"),
        ("-d40x51", "its resolution is"),
        ("-n2000", "its training is"),
        ("--integrator=sobol", "its integrator is"),
        ("--learnt=b.pfm", "is not a checkpoint"),
        ("-o0.litpt", "is named twice"),
    ] {
        let run = format!("{VIEW} {run} -od.pfm --learnt=0.litpt {option}");
        place.line(&run).failed(1, &[words]);
        assert!(!place.path("d.pfm").exists());
    }
    let resume = "--resume=1.litpt --learnt=0.litpt";
    place.line(resume).failed(2, &["cannot be used with"]);
    // A lie may be whole.
    let mut lie = Checkpoint::of_file(&place.path("3.litpt")).unwrap();
    let mut film = lie.record.run_key.film();
    lie.fill(&mut film).unwrap();
    let learnt = Arc::get_mut(&mut lie.record.learnt).unwrap();
    learnt.get_mut().unwrap().allocation.scale[7] *= 2.;
    let file = fs::File::create(place.path("3.litpt")).unwrap();
    save(&lie.record, &film, &mut &file).unwrap();
    let fault = "1.litpt and 3.litpt have not learnt the same";
    merge(&place, &format!("{all} -oe.pfm")).failed(1, &[fault]);
}

/// Paths learn nothing, and need nothing; a gather does.
#[test]
fn there_is_nothing_to_take_from_paths() {
    let place = Scratch::new();
    let run = "-iroom.obj -d9x7 -n16 --integrator";
    place.done(&format!("{run}=sobol --samples=0..0 -oa.litpt"));
    let taken = "=sobol --samples=0..16 -ob.litpt --learnt=a.litpt";
    let took = place.done(&format!("{run}{taken}"));
    assert!(!took.stderr.contains("learnt"), "{}", took.stderr);
    let learns = format!("{run}=gather --samples=0..0 -oc.litpt");
    let told = place.done(&learns).stderr;
    assert!(told.contains("learnt    "), "{told}");
    let size = place.get("c.litpt").len();
    let sums = 9 * 7 * 64;
    let whole = format!("{run}=gather --samples=0..16 -od.litpt");
    place.done(&format!("{whole} --learnt=c.litpt"));
    assert!(place.get("d.litpt").len() > size + sums);
    // It was interrupted before it had learnt.
    let mut state = Checkpoint::of_file(&place.path("c.litpt")).unwrap();
    state.record.learnt = Arc::default();
    let file = fs::File::create(place.path("c.litpt")).unwrap();
    save(&state.record, &state.record.run_key.film(), &mut &file).unwrap();
    let again = place.line(&format!("{whole} -f --learnt=c.litpt"));
    again.failed(1, &["c.litpt: holds nothing learnt"]);
    merge(&place, "c.litpt d.litpt -oe.litpt").succeeded();
    let merged = Checkpoint::of_file(&place.path("e.litpt")).unwrap();
    assert!(merged.record.learnt.get().is_some());
    // Errors may be smaller than a number in single precision.
    let dim = format!("-q {run}=gather -r1e-44 --samples");
    place.done(&format!("{dim}=0..0 -of.litpt"));
    place.done(&format!("{dim}=0..16 -og.litpt --learnt=f.litpt"));
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
        for n in 1..=window.tile_rows(SIDE) {
            let mut row = corner.1;
            for k in 1..=n {
                let band = window.band((k, n), SIDE);
                assert_eq!(band.corner, (corner.0, row));
                assert_eq!(band.size.0, size.0);
                row = band.end().1;
                assert!(band.size.1 > 0 && (k == n || row % 16 == 0));
            }
            assert_eq!(row, window.end().1);
        }
    }
}

/// Writes the state of a run of eight samples, of which these facts are other
/// ones than usual, with none of its samples.
fn put(place: &Scratch, name: &str, facts: Value) {
    let whole = json!({ "samples": [0, 8], "of": 8, "band": [1, 1] });
    let mut all = json!({ "resolution": [40, 50], "part": whole });
    let known = all.as_object_mut().unwrap();
    for (name, value) in facts.as_object().unwrap() {
        known.insert(name.clone(), value.clone());
    }
    known.retain(|_, value| !value.is_null());
    let run_key = run_key_with(all);
    let mut report = Report::default();
    report.convergence.spp = 8;
    let (film, plan) = (run_key.film(), Plan::default());
    let known = RunRecord {
        plan,
        run_key,
        report,
        rows: vec![],
        learnt: Arc::default(),
    };
    let mut file = fs::File::create(place.path(name)).unwrap();
    save(&known, &film, &mut file).unwrap();
}

/// Why states are not merged.
#[track_caller]
fn fault(place: &Scratch, names: [&str; 2]) -> String {
    let states = names.map(|name| Checkpoint::of_file(&place.path(name)));
    let merged = shards::merge(states);
    let fault = merged.map(|merged| merged.missing).unwrap_err();
    fault.to_string().replace(&*place.path("").to_string_lossy(), "")
}

#[test]
fn states_that_are_not_parts_of_one_run_are_refused() {
    let place = Scratch::new();
    put(&place, "a.litpt", json!({}));
    let part = json!({ "samples": [8, 9], "of": 9, "band": [1, 1] });
    for (facts, what) in [
        (json!({ "seed": 8 }), "seed is 7 and 8"),
        (json!({ "scene_sha256": "cd" }), "scene_sha256 is"),
        (json!({ "resolution": [40, 51] }), "[40,50] and [40,51]"),
        (json!({ "crop": "0,0,40x32" }), "crop is nothing and \"0,0,40x"),
        (json!({ "method": "reference" }), "method is"),
        (json!({ "part": part }), "part is"),
    ] {
        put(&place, "b.litpt", facts);
        let fault = fault(&place, ["a.litpt", "b.litpt"]);
        let words = "a.litpt and b.litpt are not of one run: ";
        assert!(fault.starts_with(words), "{fault}");
        assert!(fault.contains(what), "{fault}");
    }
}

#[test]
fn samples_that_two_states_hold_are_refused() {
    let place = Scratch::new();
    let part = |samples: [u64; 2], band: [u64; 2]| {
        let part = json!({ "samples": samples, "of": 8, "band": band });
        json!({ "part": part })
    };
    put(&place, "a.litpt", part([0, 5], [1, 1]));
    put(&place, "b.litpt", part([4, 8], [1, 1]));
    put(&place, "c.litpt", part([0, 8], [2, 4]));
    put(&place, "d.litpt", part([0, 5], [1, 1]));
    // An undivided run has all samples, and does not know of how many.
    for name in ["e.litpt", "f.litpt"] {
        put(&place, name, json!({ "part": null }));
    }
    for (one, other, words) in [
        ("a.litpt", "b.litpt", "samples 4..5 of rows 0..50"),
        ("a.litpt", "a.litpt", "samples 0..5 of rows 0..50"),
        ("c.litpt", "b.litpt", "samples 4..8 of rows 16..32"),
        ("a.litpt", "d.litpt", "samples 0..5 of rows 0..50"),
        ("e.litpt", "f.litpt", "samples 0..8 of rows 0..50"),
    ] {
        let words = format!("{one} and {other} both hold {words}");
        assert_eq!(fault(&place, [one, other]), words);
    }
}

#[test]
fn missing_parts_are_listed_and_need_a_permission() {
    let place = Scratch::new();
    for (name, options) in [
        ("a.litpt", "--samples=0..4 --tiles=1/4"),
        ("b.litpt", "--samples=2..8 --tiles=2/4"),
        ("c.litpt", "--samples=0..8 --tiles=4/4"),
        ("d.litpt", "--samples=0..4 --tiles=2/4"),
    ] {
        part(&place, name, &format!("-n8 --no-filter {options}"));
    }
    let files = "a.litpt b.litpt c.litpt -oc.exr";
    let missing = "samples 4..8 of rows 0..16; samples 0..2 of rows 16..32; \
                   samples 0..8 of rows 32..48";
    let told = format!("parts are missing: {missing}");
    merge(&place, files).failed(1, &[&told, "--partial"]);
    assert!(!place.path("c.exr").exists());
    let partial = format!("{files} --partial --report=r.json");
    let run = merge(&place, &partial).succeeded();
    assert_eq!(run.stderr, format!("warning: {told}\n"));
    let image = place.image("c.exr");
    assert_eq!(image.attributes["missing"], missing);
    assert_eq!(image.attributes["stopped"], "not yet");
    assert_eq!(place.json("r.json")["settings"]["missing"], missing);
    let samples = image.samples.unwrap();
    for (row, expected) in [(0, 4.), (15, 4.), (16, 6.), (40, 0.), (49, 8.)]
    {
        assert_eq!(samples[40 * row], expected, "row {row}");
    }
    // What is left is found in one piece, however it is divided.
    let missing = "missing: samples 0..8 of rows 0..16; \
                   samples 0..2 of rows 16..32; samples 0..8 of rows 32..48 ";
    merge(&place, "b.litpt c.litpt -oc.png").failed(1, &[missing]);
    let missing = "missing: samples 4..8 of rows 0..32; \
                   samples 0..8 of rows 32..50 ";
    merge(&place, "a.litpt d.litpt -oc.png").failed(1, &[missing]);
}

/// A part that was stopped is taken for what it has; resumed by its name
/// alone, it ends as if it had not been stopped.
#[test]
fn a_part_that_is_stopped_is_missing_its_rest_and_can_be_resumed() {
    for method in ["reference", "sobol", "gather"] {
        let place = Scratch::new();
        let run = format!("--integrator {method} -n1024 -j2");
        place.done(&format!("{VIEW} {run} {A}"));
        part(&place, "1.litpt", &format!("{run} --samples=0..512"));
        let shard = "--samples=512..1024 -o2.litpt --every=0.001";
        let shard = format!("{VIEW} {run} {shard}");
        let mut child = spawn(&mut place.pt(&shard));
        let state = place.path("2.litpt");
        wait_until(&mut child, "state", || state.exists());
        signal("INT", child.id());
        assert_eq!(finish(child).status, Some(130));
        let all = format!("1.litpt 2.litpt {B}");
        let missing =
            ["parts are missing: samples", "..1024 of rows 0..50"];
        merge(&place, &all).failed(1, &missing);
        place.done("-q --resume=2.litpt -j1");
        merge(&place, &all).succeeded();
        place.done(PICTURE);
        same(&place, method);
        let range = "-q --resume=2.litpt -n1024 --samples=0..512";
        place.line(range).failed(1, &["another run: its part is"]);
    }
}

#[test]
fn states_and_images_are_not_mixed_and_not_overwritten() {
    let place = Scratch::new();
    part(&place, "a.litpt", "-n8 --samples=0..4");
    part(&place, "b.ck.litpt", "-n8 --samples=4..8");
    fs::rename(place.path("b.ck.litpt"), place.path("b.ck")).unwrap();
    place.done(&format!("{VIEW} -oc.exr"));
    let mixed = merge(&place, "a.litpt c.exr -od.exr");
    mixed.failed(1, &["c.exr: is not a checkpoint"]);
    merge(&place, "- a.litpt -od.exr").failed(1, &["-: cannot read"]);
    let whole = place.get("a.litpt");
    place.put("cut.litpt", &whole[..whole.len() - 1]);
    let cut = merge(&place, "a.litpt cut.litpt -od.exr");
    cut.failed(1, &["cut.litpt: is damaged"]);
    merge(&place, "a.litpt -od.exr").failed(2, &["only 1"]);
    merge(&place, "a.litpt b.ck -od.exr").succeeded();
    let again = merge(&place, "a.litpt b.ck -od.exr");
    again.failed(1, &["d.exr: the file exists"]);
    for written in ["-oa.litpt", "--report=b.ck"] {
        let over = format!("a.litpt b.ck -f -oe.exr {written}");
        merge(&place, &over).failed(1, &["is named twice"]);
    }
}

/// The report and the page of a merged run are those of a run.
#[test]
fn a_merged_run_has_a_report() {
    let place = Scratch::new();
    place.done(&format!("{VIEW} -n8 -oa.exr --report=a.json"));
    part(&place, "a.litpt", "-n8 --samples=0..4 -j1");
    part(&place, "b.litpt", "-n8 --samples=4..8 -j2");
    let reports = "--report=b.json --report=b.html --report=b.csv";
    merge(&place, &format!("a.litpt b.litpt -ob.exr {reports}"))
        .succeeded();
    let [one, both] = ["a.json", "b.json"].map(|name| place.json(name));
    for field in
        ["scene", "spp", "mean", "mean_stderr", "rmse", "stopped", "rays"]
    {
        assert_eq!(one[field], both[field], "{field}");
    }
    assert_eq!(both["settings"]["spp"], 8);
    assert_eq!(both["settings"]["threads"], Value::Null);
    assert_eq!(both["settings"]["albedo"], 0.7);
    assert_eq!(both["curve"].as_array().unwrap().len(), 1);
    assert!(place.text("b.html").contains("ptimg merge"), "the command");
}
