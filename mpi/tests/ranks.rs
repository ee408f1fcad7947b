// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Several ranks render what one process does, and what is left when one
//! of them dies. These tests are skipped where there is no `mpirun`.

#[path = "../../tests/common/mod.rs"]
mod common;

use std::fs;
use std::path::Path;
use std::process::{Child, Command};
use std::thread;
use std::time::{Duration, Instant};

use common::{Run, Scratch, finish, skip};
use litpt::image::Image;
use litpt::shards::merge;
use serde_json::Value;

const SCENE: [&str; 6] =
    ["-q", "-f", "-iroom.obj", "-d70x50", "-r0.7", "-j1"];

/// The command `pt` on so many ranks; none if there is no `mpirun`.
fn ranks(place: &Scratch, n: usize, arguments: &[&str]) -> Option<Command> {
    if Command::new("mpirun").arg("--version").output().is_err() {
        skip("there is no mpirun");
        return None;
    }
    let mut command = place.command("mpirun");
    // What is named in the environment is left to the tests.
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1");
    command.env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    command.args(["--oversubscribe", "--bind-to", "none", "-n"]);
    command.arg(n.to_string()).arg(env!("CARGO_BIN_EXE_pt-mpi"));
    command.arg("-p0,0,0").args(SCENE).args(arguments);
    Some(command)
}

fn run(place: &Scratch, n: usize, arguments: &[&str]) -> Option<Run> {
    Some(finish(ranks(place, n, arguments)?.spawn().unwrap()))
}

fn alone(place: &Scratch, arguments: &[&str]) {
    place.run(&[&SCENE[..], arguments].concat()).succeeded();
}

fn json(place: &Scratch) -> Value {
    serde_json::from_slice(&place.get("r.json")).unwrap()
}

// --------------------------------------------------------------- The bits

/// The image of one process and those of several ranks, whose numbers of
/// paths the report has.
#[track_caller]
fn same_image(arguments: &[&str], numbers: &[usize]) {
    let place = Scratch::new();
    alone(&place, &[arguments, &["-oa.pfm"]].concat());
    for &n in numbers {
        let out = ["-ob.pfm", "--report=r.json"];
        let all = [arguments, &out].concat();
        let Some(run) = run(&place, n, &all) else { return };
        run.succeeded();
        assert_eq!(run.stderr, "");
        assert!(place.get("b.pfm") == place.get("a.pfm"), "{n} ranks");
        let report = json(&place);
        let Some(shares) = report["ranks"].as_array() else {
            assert_eq!(n, 1, "no shares of ranks");
            continue;
        };
        let paths = shares.iter().map(|s| s["paths"].as_u64().unwrap());
        let spp = report["spp"].as_u64().unwrap();
        let image = Image::read(&place.path("b.pfm")).unwrap();
        let area = u64::from(image.width * image.height);
        assert_eq!(paths.sum::<u64>(), spp * area);
        assert_eq!(shares.len(), n);
    }
}

#[test]
fn ranks_render_the_image_of_the_reference() {
    same_image(&["-n23", "--integrator=reference"], &[1, 2, 3, 5]);
}

#[test]
fn ranks_render_the_image_in_nets() {
    same_image(&["-n64", "--integrator=sobol"], &[2, 3]);
}

#[test]
fn ranks_render_the_image_of_a_gather() {
    same_image(&["-n64", "--integrator=gather"], &[2, 3, 5]);
}

#[test]
fn ranks_render_what_a_pilot_has_chosen() {
    same_image(&["-n400"], &[2, 3]);
}

#[test]
fn ranks_stop_at_the_same_error() {
    same_image(&["--error=0.02", "--integrator=reference"], &[2, 5]);
    same_image(&["--error=0.01"], &[3]);
}

#[test]
fn ranks_render_a_part_of_a_run() {
    same_image(&["-n40", "--crop=3,5,33x40"], &[3]);
    let place = Scratch::new();
    alone(&place, &["-n64", "-oa.pfm"]);
    alone(&place, &["-n64", "--samples=0..32", "-oa.litpt"]);
    for (band, name) in [("1/2", "b.litpt"), ("2/2", "c.litpt")] {
        let tiles = format!("--tiles={band}");
        let part = ["-n64", "--samples=32..64", &tiles, "-o", name];
        let Some(run) = run(&place, 3, &part) else { return };
        run.succeeded();
    }
    let parts = ["a.litpt", "b.litpt", "c.litpt"].map(|n| place.path(n));
    let (image, _) = merge(&parts).unwrap().image_and_report();
    assert!(
        Image::read(&place.path("a.pfm")).unwrap().means
            == image
                .means
                .iter()
                .map(|&x| f64::from(x as f32))
                .collect::<Vec<_>>()
    );
}

#[test]
fn a_scene_comes_from_the_standard_input_of_rank_0() {
    let place = Scratch::new();
    alone(&place, &["-n4", "-oa.pfm"]);
    let input = fs::File::open(place.path("room.obj")).unwrap();
    let arguments = ["-i-", "-n4", "-ob.pfm"];
    let Some(mut command) = ranks(&place, 3, &arguments) else { return };
    finish(command.stdin(input).spawn().unwrap()).succeeded();
    assert!(place.get("a.pfm") == place.get("b.pfm"));
}

#[test]
fn more_ranks_than_pieces_end_as_well() {
    let place = Scratch::new();
    alone(&place, &["-n1", "-d9x7", "-oa.pfm"]);
    let tiny = ["-n1", "-d9x7", "-ob.pfm"];
    let Some(run) = run(&place, 5, &tiny) else { return };
    run.succeeded();
    assert!(place.get("a.pfm") == place.get("b.pfm"));
}

// ------------------------------------------------------------- The limits

#[test]
fn a_time_limit_ends_all_ranks() {
    let place = Scratch::new();
    let limit = ["--time=2", "-oa.pfm", "--report=r.json"];
    let start = Instant::now();
    let Some(run) = run(&place, 3, &limit) else { return };
    run.succeeded();
    assert!(start.elapsed() < Duration::from_secs(30));
    let report = json(&place);
    assert_eq!(report["stopped"], "time");
    let spp = report["spp"].as_u64().unwrap();
    assert!(spp > 1);
    let curve = report["curve"].as_array().unwrap();
    let spent = &curve[curve.len() - 1]["processor_seconds"];
    assert!(spent.as_f64() > Some(0.));
}

#[test]
fn what_is_wrong_is_said_once() {
    let place = Scratch::new();
    place.put("bad.obj", "v 1 2\n");
    for arguments in [&["-ibad.obj", "-oa.pfm"][..], &["-inone.obj"]] {
        let Some(run) = run(&place, 3, arguments) else { return };
        assert_eq!(run.status, Some(1), "{}", run.stderr);
        assert_eq!(run.stderr.matches("error:").count(), 1);
    }
}

#[test]
fn a_full_disk_of_rank_0_is_an_error() {
    let place = Scratch::new();
    let full = place.path("full.pfm").display().to_string();
    let mut command = place.command("mknod");
    finish(command.args([&full, "c", "1", "7"]).spawn().unwrap());
    if fs::OpenOptions::new().write(true).open(&full).is_err() {
        return skip("there is no device that is full");
    }
    let arguments = ["-n4", "-o", &full, "-oa.pfm"];
    let Some(run) = run(&place, 3, &arguments) else { return };
    assert_eq!(run.status, Some(1), "{}", run.stderr);
    assert!(run.stderr.contains("No space left"), "{}", run.stderr);
    alone(&place, &["-n4", "-ob.pfm"]);
    assert!(place.get("a.pfm") == place.get("b.pfm"));
}

// ------------------------------------------------------------- The deaths

/// The processes of the ranks, in their order.
fn processes(place: &Scratch) -> Vec<i32> {
    let here = fs::canonicalize(place.path("")).unwrap();
    let mut found = vec![];
    for entry in fs::read_dir("/proc").unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let Ok(id) = name.parse::<i32>() else { continue };
        let Ok(program) = fs::read_link(path.join("exe")) else { continue };
        let at = fs::read_link(path.join("cwd")).ok();
        let pt = Path::new(env!("CARGO_BIN_EXE_pt-mpi"));
        if at.as_deref() == Some(&here) && program == pt {
            let words = fs::read(path.join("environ")).unwrap_or_default();
            let words = String::from_utf8_lossy(&words).into_owned();
            let rank = words.split('\0').find_map(|word| {
                word.strip_prefix("OMPI_COMM_WORLD_RANK=")?.parse().ok()
            });
            found.push((rank.unwrap_or(0), id));
        }
    }
    found.sort();
    found.into_iter().map(|(_, id): (usize, i32)| id).collect()
}

/// A run of three ranks that has saved its state at least once.
fn under_way(place: &Scratch) -> Option<Child> {
    let saved = ["--checkpoint=c.ck", "--every=0.2", "-n1000000000"];
    let arguments = [&saved[..], &["-oa.pfm", "--integrator=reference"]];
    let mut command = ranks(place, 3, &arguments.concat())?;
    let child = command.spawn().unwrap();
    let start = Instant::now();
    while !place.path("c.ck").exists() {
        assert!(start.elapsed() < Duration::from_secs(60), "no checkpoint");
        thread::sleep(Duration::from_millis(20));
    }
    thread::sleep(Duration::from_millis(300));
    Some(child)
}

fn signal(name: &str, process: i32) {
    let mut kill = Command::new("kill");
    let status = kill.arg(name).arg(process.to_string()).status();
    assert!(status.unwrap().success());
}

/// The state that is left is whole, and goes on to the image of one run,
/// on another number of ranks and on one.
fn goes_on(place: &Scratch) {
    fs::copy(place.path("c.ck"), place.path("d.ck")).unwrap();
    let header = place.get("c.ck");
    let header = header.split(|&byte| byte == b'\n').nth(1).unwrap();
    let header: Value = serde_json::from_slice(header).unwrap();
    let spp = header["convergence"]["spp"].as_u64().unwrap();
    // A pass takes no tile further than the next step.
    let n = format!("-n{}", 2 * spp + 10);
    let method = "--integrator=reference";
    alone(place, &[&n, "-ob.pfm", method]);
    let more = [&n, "--resume=c.ck", "-oa.pfm", method];
    run(place, 2, &more).unwrap().succeeded();
    assert!(place.get("a.pfm") == place.get("b.pfm"), "other bytes");
    alone(place, &[&n, "--resume=d.ck", "-oa.pfm", method]);
    assert!(place.get("a.pfm") == place.get("b.pfm"), "other bytes");
}

/// All ranks are gone soon.
fn assert_gone(place: &Scratch) {
    let start = Instant::now();
    while !processes(place).is_empty() {
        assert!(start.elapsed() < Duration::from_secs(30), "ranks remain");
        thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn the_death_of_a_rank_leaves_a_checkpoint() {
    for rank in [1, 0] {
        let place = Scratch::new();
        let Some(child) = under_way(&place) else { return };
        let processes = processes(&place);
        assert_eq!(processes.len(), 3);
        signal("-KILL", processes[rank]);
        let run = finish(child);
        assert_ne!(run.status, Some(0));
        let line = format!("process rank {rank} with PID");
        assert!(run.stderr.contains(&line), "{}", run.stderr);
        assert_gone(&place);
        goes_on(&place);
    }
}

#[test]
fn the_death_of_mpirun_leaves_a_checkpoint() {
    let place = Scratch::new();
    let Some(child) = under_way(&place) else { return };
    signal("-KILL", child.id() as i32);
    finish(child);
    assert_gone(&place);
    goes_on(&place);
}

#[test]
fn an_interrupt_of_rank_0_ends_the_run_with_an_image() {
    let place = Scratch::new();
    let Some(child) = under_way(&place) else { return };
    signal("-INT", processes(&place)[0]);
    let run = finish(child);
    assert_eq!(run.status, Some(130), "{}", run.stderr);
    assert!(place.path("a.pfm").exists());
    assert_gone(&place);
    goes_on(&place);
}

#[test]
fn an_interrupt_of_mpirun_ends_the_run_with_an_image() {
    let place = Scratch::new();
    let Some(child) = under_way(&place) else { return };
    signal("-INT", child.id() as i32);
    finish(child);
    assert!(place.path("a.pfm").exists());
    assert_gone(&place);
    goes_on(&place);
}
