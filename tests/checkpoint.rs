// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A run that is killed goes on as if nothing had happened, and what is no
//! checkpoint of it is refused and left alone (chapter "The checkpoint").

use crate::prelude::*;

use litpt::key::RunKey;
use litpt::state::learnt::{read, write};

// --------------------------------------------------------------- The library

pub fn run_key_with(changes: Value) -> RunKey {
    let mut key = json!({
        "version": "0", "integrator": "i", "scene_sha256": "ab",
        "resolution": [5, 3], "position": [0.5, -1e9, 3.],
        "target": [0., 0., 0.], "up": [0., 0., 1.], "fov": 0.1,
        "albedo": 0.5, "sky": {"zenith": [0., 0., 1.], "cover": "uniform"},
        "method": "sobol", "seed": 7, "replicate": 4,
        "training": 0, "sky_control": 90, "filtered": false,
    });
    for (name, value) in changes.as_object().unwrap() {
        key[name] = value.clone();
    }
    let read: RunKey = serde_json::from_value(key.clone()).unwrap();
    assert_eq!(serde_json::to_value(&read).unwrap(), key);
    read
}

fn run_key() -> RunKey {
    run_key_with(json!({}))
}

/// A course and an image whose numbers are all different.
fn state() -> (Convergence, Film) {
    let step = |spp: u64, rmse: Value| {
        json!({ "spp": spp, "seconds": 0.1 + spp as f64, "rays": 1 << spp,
                "rmse": rmse, "mean": 1. / 3., "mean_stderr": rmse })
    };
    let convergence = json!({
        "spp": 9, "render_seconds": 1e-3 / 7., "rays": u64::MAX - 1,
        "constant_pixels": 4, "stopped": "error",
        "curve": [step(1, Value::Null), step(2, json!(0.1 + 0.2))],
    });
    let mut film = Film::new(5, 3);
    for (pixel, i) in film.pixels.iter_mut().zip(0..) {
        (0..i).for_each(|n| pixel.add(0.7f64.powi(i) + f64::from(n)));
    }
    (serde_json::from_value(convergence).unwrap(), film)
}

fn known() -> RunRecord {
    let report = Report { convergence: state().0, ..Report::default() };
    let (plan, learnt) = (Plan::default(), Arc::default());
    RunRecord { plan, run_key: run_key(), report, rows: vec![], learnt }
}

fn saved() -> Vec<u8> {
    let mut bytes = vec![];
    save(&known(), &state().1, &mut bytes).unwrap();
    bytes
}

fn resume(
    run_key: &RunKey,
    film: &mut Film,
    file: Cursor<impl AsRef<[u8]>>,
) -> Result<Convergence, String> {
    let resumed = Checkpoint::open(file);
    let resumed = resumed.and_then(|state| state.resume(run_key, film));
    resumed.map_err(|error| error.to_string())
}

#[track_caller]
fn refused(bytes: &[u8]) -> String {
    let mut film = Film::new(5, 3);
    resume(&run_key(), &mut film, Cursor::new(bytes)).unwrap_err()
}

#[test]
fn what_is_saved_comes_back_to_the_last_bit() {
    let (convergence, film) = state();
    let mut again = Film::new(5, 3);
    let found = resume(&run_key(), &mut again, Cursor::new(saved()));
    assert_eq!(found, Ok(convergence));
    assert_eq!(again.pixels, film.pixels);
}

#[test]
fn every_bit_that_flips_and_every_other_length_is_noticed() {
    let whole = saved();
    for at in 0..whole.len() {
        let refuse = |bytes: &[u8]| {
            let fault = refused(bytes);
            let kind = if at < 20 { "not a checkpoint" } else { "damaged" };
            assert!(fault.contains(kind), "{at}: {fault}");
        };
        refuse(&whole[..at]);
        for bit in 0..8 {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << bit;
            refuse(&bytes);
        }
    }
    assert!(refused(&[&whole[..], b"\n"].concat()).contains("is damaged"));
}

#[test]
fn a_fact_that_differs_is_named_with_both_values() {
    let part = json!({ "samples": [4, 8], "of": 16, "band": [2, 3] });
    for (name, value, words) in [
        ("seed", json!(8), ["7", "8"]),
        ("fov", json!(0.1f64.next_up()), ["0.1,", "0.10000000000000002"]),
        ("position", json!([0.5, 1e9, 3.]), ["-1000000000.0", ",1000"]),
        ("crop", json!("1,1,2x2"), ["nothing", "1,1,2x2"]),
        ("part", part, ["nothing, ", "not {"]),
    ] {
        let other = run_key_with(json!({ name: value }));
        let (mut film, file) = (Film::new(5, 3), Cursor::new(saved()));
        let fault = resume(&other, &mut film, file).unwrap_err();
        assert!(fault.contains(&format!("its {name} is")), "{fault}");
        assert!(words.iter().all(|w| fault.contains(w)), "{fault}");
    }
}

/// Of a sky, of materials or of a long list the part that differs is shown.
#[test]
fn the_part_of_a_fact_that_differs_is_named() {
    let long = |name: &str| name.repeat(40);
    let sky = |y, z| {
        let sky = json!({ "cover": "uniform", "zenith": [0., y, z] });
        let sun = json!({
            "toward": [0.1234567890123, 0.2345678901234, 0.9],
            "irradiance": 2.5,
        });
        let mut sky = sky;
        sky["beam"] = sun;
        sky
    };
    let materials = |b| json!({ long("a"): 0.2, long("b"): b });
    let named =
        |c: f64| json!([[long("a"), 0.5], [long("b"), 0.25], ["c", c]]);
    for (name, a, b, part, values) in [
        (
            "sky",
            sky(0., 1.),
            sky(1., 0.),
            "sky.zenith",
            ["[0.0,0.0,1.0]", "[0.0,1.0,0.0]"],
        ),
        (
            "materials",
            materials(0.3),
            materials(0.4),
            &format!("materials.{}", long("b")),
            ["0.3", "0.4"],
        ),
        (
            "named_albedos",
            named(0.5),
            named(0.75),
            "named_albedos.2",
            ["[\"c\",0.5]", "[\"c\",0.75]"],
        ),
    ] {
        let keys = [a, b].map(|value| run_key_with(json!({ name: value })));
        let found = keys[0].disagreement(&keys[1]);
        assert_eq!(found, Some((part.to_owned(), values.map(Into::into))));
        assert_eq!(keys[0].disagreement(&keys[0]), None);
    }
}

/// What a gather has learnt comes back, and what none can learn is refused.
#[test]
fn what_cannot_be_learnt_is_refused() {
    let view = View { up: DVec3::Z, ..look(DVec3::ZERO, DVec3::Y, 70.) };
    let (room, sky) = (read_obj(ROOM.as_bytes()), (1., DVec3::Z));
    let setting =
        Setting::new(&room.unwrap(), sky, &view, 9. / 7.).unwrap();
    let run_key = run_key_with(json!({
        "resolution": [9, 7], "method": "gather", "replicate": 4
    }));
    let mut gather = setting.gather((9, 7));
    gather.learn(&mut run_key.film(), &|_| true);
    let mut saved = vec![];
    write(&gather.learnt, &mut saved).unwrap();
    let learnt = read(&mut &*saved, &run_key).unwrap();
    let cache = &learnt.get().unwrap().cache;
    let (cells, guides) = (cache.cells.len(), cache.guides.len());
    let mut whole = vec![];
    write(&learnt, &mut whole).unwrap();
    let read = |bytes: &[u8]| read(&mut &*bytes, &run_key);
    assert!(read(&whole).unwrap() == learnt && whole == saved);
    assert!(guides > 0, "{cells} cells without a guide");
    let first = whole.iter().position(|&b| b == b'\n').unwrap() + 1;
    let of_guides = first + 16 * cells;
    let of_counts = of_guides + 544 * guides;
    let of_scale = of_counts + 4 * 63;
    let refuse = |at: usize, words: &[u32]| {
        let mut bytes = whole.clone();
        let words: Vec<u8> =
            words.iter().flat_map(|w| w.to_le_bytes()).collect();
        bytes[at..at + words.len()].copy_from_slice(&words);
        let fault = read(&bytes).unwrap_err().to_string();
        assert!(fault.contains("cannot be learnt"), "{at}: {fault}");
    };
    for bits in [f32::NAN, f32::INFINITY].map(f32::to_bits) {
        refuse(first + 4, &[bits]);
        refuse(first + 8, &[bits]);
    }
    for error in [0f32, -1.] {
        refuse(first + 8, &[error.to_bits()]);
    }
    refuse(first + 12, &[guides as u32]);
    // No free entry, and intervals of guides that do not begin at zero, or
    // are empty.
    refuse(first, &[1, 0, 1f32.to_bits(), u32::MAX].repeat(cells));
    for (begin, empty) in [(0, 2), (0, 28), (32, 34), (512, 540)] {
        refuse(of_guides + begin, &[1 | 2 << 16]);
        refuse(of_guides + empty, &[1 | 1 << 16]);
    }
    for count in [0, 33, u32::MAX] {
        refuse(of_counts, &[count]);
        refuse(of_scale - 4, &[count]);
    }
    for scale in [0., -1., f64::NAN, f64::INFINITY].map(f64::to_bits) {
        refuse(of_scale + 8 * 62, &[scale as u32, (scale >> 32) as u32]);
    }
    // Other numbers of cells and guides than there are, and another machine.
    let ends = [0, 9, first - 1, first, of_guides, whole.len() - 1];
    assert!(ends.iter().all(|&end| read(&whole[..end]).is_err()));
    let head = String::from_utf8(whole[..first].to_vec()).unwrap();
    let ours = format!("{cells},{guides},false,[],0]");
    assert!(head.contains(&ours));
    let others =
        [0, 1, 3, cells - 1, 2 * cells, usize::MAX / 16, usize::MAX];
    let of_cells = others.map(|n| format!("{n},{guides},false,[],0]"));
    let of_guides = others.map(|n| format!("{cells},{n},false,[],0]"));
    let other = [
        format!("{cells},{guides},true,[],0]"),
        format!("{cells},{guides},false,[],1]"),
        format!("{cells},{guides},false,[],{}]", usize::MAX),
        format!("{cells},{guides},false,[1],0]"),
        format!("{cells},{guides},false,[{}],0]", usize::MAX),
    ];
    for theirs in of_cells.into_iter().chain(of_guides).chain(other) {
        let head = head.replace(&ours, &theirs);
        let bytes = [head.as_bytes(), &whole[first..]].concat();
        assert!(read(&bytes).is_err(), "{theirs}");
    }
}

#[test]
fn a_disk_that_is_full_is_an_error_and_no_panic() {
    let (_, film) = state();
    let size = saved().len();
    for room in [0, 10, 25, 500, size - 33, size - 32, size - 1, size] {
        let mut disk = vec![0; room];
        let written = save(&known(), &film, &mut &mut disk[..]);
        assert_eq!(written.is_ok(), room == size, "{room}");
    }
}

// --------------------------------------------------------------- The command

const SCENE: &str = "-q -iroom.obj -d23x17 -r0.7 --integrator=reference";
const ALL: &str = "-oa.pgm -oa.png -oa.pfm -oa.exr";

/// Runs `pt` with the options of `SCENE`, before others.
fn pt(place: &Scratch, arguments: &str) -> Run {
    place.line(&format!("{SCENE} {arguments}"))
}

/// The samples in a checkpoint; none if there is no such file.
fn saved_spp(path: &Path) -> Option<u64> {
    let state = Checkpoint::of_file(path).ok()?;
    Some(state.record.report.convergence.spp)
}

/// Starts a run without an end, and kills it as soon as it has saved more
/// than `spp` samples.
fn killed_after(place: &Scratch, spp: u64, arguments: &str) {
    let endless = "-n1000000000 --every=0.001 --checkpoint=c";
    let line = format!("{SCENE} {endless} {arguments}");
    let mut child = spawn(&mut place.pt(&line));
    let path = place.path("c");
    wait_until(&mut child, "checkpoint", || saved_spp(&path) > Some(spp));
    child.0.kill().unwrap();
    assert_eq!(finish(child).status, None);
}

/// Renders the four images again at one go, and compares them.
fn same_as_uninterrupted(place: &Scratch, arguments: &str) {
    let names = ["a.pgm", "a.png", "a.pfm"];
    let images = || {
        let image = Image::read(&place.path("a.exr")).unwrap();
        let Image { means, errors, samples, attributes, .. } = image;
        let said = ["rays", "spp"].map(|name| attributes[name].clone());
        (names.map(|name| place.get(name)), means, errors, samples, said)
    };
    let resumed = images();
    pt(place, &format!("-f {ALL} {arguments}")).succeeded();
    assert!(images() == resumed, "another image");
}

#[test]
fn a_run_that_was_killed_twice_ends_with_the_bytes_of_an_uninterrupted_one()
{
    let place = Scratch::new();
    killed_after(&place, 0, &format!("{ALL} --report=r.json"));
    let first = saved_spp(&place.path("c")).unwrap();
    killed_after(&place, first, "--resume=c -j3");
    let n = saved_spp(&place.path("c")).unwrap() + 7;
    // The checkpoint alone says how to go on; the report is replaced.
    place.done(&format!("--resume=c -n{n} -j1"));
    assert_eq!(place.json("r.json")["settings"]["spp"], n);
    assert_eq!(saved_spp(&place.path("c")), Some(n));
    let steps = |name| {
        let mut curve = place.json(name)["curve"].take();
        for step in curve.as_array_mut().unwrap() {
            step["seconds"] = Value::Null;
        }
        curve
    };
    same_as_uninterrupted(&place, &format!("-n{n} --report=w.json"));
    assert_eq!(steps("r.json"), steps("w.json"));
}

#[test]
fn a_run_that_has_ended_may_go_on_to_another_limit() {
    let place = Scratch::new();
    let loud = SCENE.replacen("-q", "-f", 1);
    place.done(&format!("{loud} -n7 -ob.pgm --checkpoint=c"));
    assert_eq!(saved_spp(&place.path("c")), Some(7));
    place.put("e", place.get("c"));
    // One that holds enough is worth a warning.
    for (n, enough) in [("", true), ("-n4", true), ("-n8", false)] {
        let on = format!("{loud} --resume=c -ob.pgm {n}");
        let said = place.done(&on).stderr;
        assert_eq!(said.contains("c: holds 7"), enough, "{said}");
    }
    place.put("c", place.get("e"));
    pt(&place, "-n30 --resume=c -ob.png").succeeded();
    place.put("c", place.get("e"));
    let on = "--error=0.05 --resume=c --checkpoint=d";
    pt(&place, &format!("{ALL} {on}")).succeeded();
    assert!(saved_spp(&place.path("d")) > Some(7));
    same_as_uninterrupted(&place, "--error=0.05");
    // There is nothing left to do, and the image is the same.
    pt(&place, "-f -ob.pfm -n7 --resume=e --checkpoint=e").succeeded();
    assert_eq!(place.get("b.pfm"), pt(&place, "-n7 --format=pfm").stdout);
    assert_eq!(saved_spp(&place.path("e")), Some(7));
}

/// The message names the file and the fault; nothing is changed or written,
/// and the scene is not read.
#[test]
fn what_cannot_be_resumed_is_refused_and_left_alone() {
    let place = Scratch::new();
    pt(&place, "-n2 -o/dev/null -f --checkpoint=c").succeeded();
    let whole = place.get("c");
    place.put("other.obj", [ROOM, "# a word\n"].concat());
    let left_alone = |bytes: &[u8], option: &str, words: &str| {
        place.put("c", bytes);
        let names = place.names();
        let files = "-f -n9 -oa.pgm --report=r.json --checkpoint=c";
        let run = pt(&place, &format!("{files} --resume=c {option}"));
        run.failed(1, &["c: ", words]);
        assert!(place.get("c") == bytes && place.names() == names);
    };
    let missing = "-imissing.obj";
    let mut damaged = whole.clone();
    damaged[700] ^= 4;
    left_alone(&damaged, missing, "is damaged: its checksum is wrong");
    left_alone(&whole[..5000], missing, "is damaged");
    for other in ["", ROOM, "litpt checkpoint 1\n", "P2 1 1\n255\n0\n"] {
        left_alone(other.as_bytes(), missing, "is not a checkpoint");
    }
    for other in ["-isquare.obj", "-iother.obj"] {
        left_alone(&whole, other, "scene_sha256");
    }
    for (option, name) in [("-s1", "--seed"), ("-d17x23", "--resolution")] {
        let run = pt(&place, &format!("-f -n9 --resume=c {option}"));
        run.failed(2, &[name, "the run that is resumed has another"]);
    }
    // Neither is a file without an end read to its end.
    pt(&place, "--resume=/dev/zero").failed(1, &["is not a checkpoint"]);
    let none = pt(&place, &format!("{missing} --resume=d"));
    none.failed(1, &["d: cannot read", "No such file"]);
}

#[test]
fn a_resumed_run_keeps_away_from_the_files_of_others() {
    let place = Scratch::new();
    place.done("room.obj -d9x7 -q -f --checkpoint=c -oa.pfm");
    // To overwrite is a permission of one command.
    place.put("b.pfm", "old");
    let on = place.line("--resume=c -n2 -ob.pfm");
    on.failed(1, &["b.pfm: the file exists"]);
    // A copy saves itself, and not the file that it was copied from.
    let saved = place.get("c");
    place.put("copy", &saved);
    place.done("--resume=copy -n2");
    assert!(place.get("c") == saved);
    assert_eq!(saved_spp(&place.path("copy")), Some(2));
    // Elsewhere the names of files mean what they meant.
    let other = place.path("other");
    std::fs::create_dir(&other).unwrap();
    let elsewhere = |words: &str| {
        let mut command = place.pt(&format!("--resume=../c {words}"));
        outcome(command.current_dir(&other)).succeeded();
    };
    elsewhere("-n3");
    elsewhere("../room.obj -d9x7 -n3 -q -o-");
    elsewhere("-n3 -o../a.pfm");
    assert_eq!(std::fs::read_dir(&other).unwrap().count(), 0);
    let image = |n| place.render(&format!("-d9x7 {n} --format=pfm"));
    assert!(place.get("a.pfm") == image("-n3"));
    elsewhere("-n3 -ob.pfm");
    place.done("--resume=c -n4");
    assert!(place.get("other/b.pfm") == image("-n4"));
    assert_eq!(place.get("b.pfm"), b"old");
}

#[test]
fn a_scene_on_standard_input_is_there_again_when_the_run_goes_on() {
    let place = Scratch::new();
    let whole = place.render("-d9x7 -n3");
    for scene in ["-", "-i-", ""] {
        let first = format!("-d9x7 -qf -o- --checkpoint=c {scene}");
        place.feed(ROOM.as_bytes(), &first).succeeded();
        let on = place.feed(ROOM.as_bytes(), "-n3 --resume=c").succeeded();
        assert!(on.stdout == whole, "{scene}");
    }
}
