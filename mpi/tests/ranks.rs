// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Several ranks render what one process does, and what is left when one
//! of them dies.

#[path = "../../tests/common/mod.rs"]
mod common;

use std::fs;
use std::process::{Child, Command};
use std::thread;
use std::time::{Duration, Instant};

use common::{Run, Scratch, finish, wait_until};
use litpt::image::Image;
use litpt::state::checkpoint::Checkpoint;
use litpt::state::shards::merge;

const SCENE: [&str; 6] =
    ["-q", "-f", "-iroom.obj", "-d70x50", "-r0.7", "-j1"];

/// The command `pt` on so many ranks.
fn ranks(place: &Scratch, n: usize, arguments: &[&str]) -> Command {
    let mut command = place.command("mpirun");
    // What is named in the environment is left to the tests.
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1");
    command.env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    command.args(["--oversubscribe", "--bind-to", "none", "-n"]);
    command.arg(n.to_string()).arg(env!("CARGO_BIN_EXE_pt-mpi"));
    command.arg("-p0,0,0").args(SCENE).args(arguments);
    command
}

/// Its run to the end, with the scene on standard input.
fn run(place: &Scratch, n: usize, arguments: &[&str]) -> Run {
    let mut command = ranks(place, n, arguments);
    let input = fs::File::open(place.path("room.obj")).unwrap();
    finish(command.stdin(input).spawn().unwrap())
}

fn alone(place: &Scratch, arguments: &[&str]) {
    place.run(&[&SCENE[..], arguments].concat()).succeeded();
}

fn same(place: &Scratch, what: &str) {
    assert!(place.get("a.pfm") == place.get("b.pfm"), "{what}");
}

/// The image of one process is that of several ranks, whose numbers of
/// paths the report has.
#[test]
fn ranks_render_the_image_of_one_process() {
    let (n, e) = ("-n64", "--error=0.02");
    for (arguments, numbers) in [
        (&["-n23", "--integrator=reference"][..], &[1, 2, 5][..]),
        (&[n, "--integrator=sobol"], &[3]),
        (&[n, "--integrator=gather"], &[2, 5]),
        (&["-n400"], &[2]),
        (&[e, "--integrator=reference"], &[5]),
        (&["--error=0.01"], &[3]),
        (&["-n40", "--crop=3,5,33x40"], &[3]),
        (&["-n1", "-d9x7"], &[5]),
    ] {
        let place = Scratch::new();
        alone(&place, &[arguments, &["-oa.pfm"]].concat());
        for &n in numbers {
            let out = ["-i-", "-ob.pfm", "--report=r.json"];
            let all = [arguments, &out].concat();
            let run = run(&place, n, &all);
            run.succeeded();
            assert_eq!(run.stderr, "");
            same(&place, &format!("{arguments:?}: {n} ranks"));
            let report = place.json("r.json");
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
}

#[test]
fn ranks_render_a_part_of_a_run() {
    let place = Scratch::new();
    alone(&place, &["-n64", "-oa.pfm"]);
    alone(&place, &["-n64", "--samples=0..32", "-oa.litpt"]);
    for (band, name) in [("1/2", "b.litpt"), ("2/2", "c.litpt")] {
        let tiles = format!("--tiles={band}");
        let part = ["-n64", "--samples=32..64", &tiles, "-o", name];
        run(&place, 3, &part).succeeded();
    }
    let parts = ["a.litpt", "b.litpt", "c.litpt"].map(|n| place.path(n));
    let film = merge(&parts).unwrap().film;
    let whole = Image::read(&place.path("a.pfm")).unwrap().means;
    let means = film.means().map(|x| f64::from(x as f32));
    assert!(means.eq(whole));
}

#[test]
fn a_time_limit_ends_all_ranks() {
    let place = Scratch::new();
    let limit = ["--time=2", "-oa.pfm", "--report=r.json"];
    let start = Instant::now();
    run(&place, 3, &limit).succeeded();
    assert!(start.elapsed() < Duration::from_secs(30));
    let report = place.json("r.json");
    assert_eq!(report["stopped"], "time");
    assert!(report["spp"].as_u64() > Some(1));
    let curve = report["curve"].as_array().unwrap();
    let spent = &curve[curve.len() - 1]["processor_seconds"];
    assert!(spent.as_f64() > Some(0.));
}

#[test]
fn what_is_wrong_is_said_once() {
    let place = Scratch::new();
    place.put("bad.obj", "v 1 2\n");
    for (arguments, message) in [
        (["-ibad.obj", "-oa.pfm"], "bad.obj:1:"),
        (["-inone.obj", "-oa.pfm"], "No such file"),
        (["-n4", "-o/dev/full"], "No space left"),
    ] {
        let run = run(&place, 3, &arguments);
        assert_eq!(run.status, Some(1), "{}", run.stderr);
        assert_eq!(run.stderr.matches("error:").count(), 1);
        assert!(run.stderr.contains(message), "{}", run.stderr);
    }
}

/// The processes of the ranks, in their order.
fn processes(run: &Child) -> Vec<u32> {
    let id = run.id();
    let children = format!("/proc/{id}/task/{id}/children");
    let children = fs::read_to_string(children).unwrap();
    children.split_whitespace().map(|id| id.parse().unwrap()).collect()
}

fn is_running(process: &u32) -> bool {
    fs::read_link(format!("/proc/{process}/exe")).is_ok()
}

/// A run of three ranks that has saved its state at least once.
fn under_way(place: &Scratch) -> Child {
    let saved = ["--checkpoint=c.ck", "--every=0.2", "-n1000000000"];
    let arguments = [&saved[..], &["-oa.pfm", "--integrator=reference"]];
    let mut command = ranks(place, 3, &arguments.concat());
    let mut child = command.spawn().unwrap();
    let state = place.path("c.ck");
    wait_until(&mut child, "checkpoint", || state.exists());
    thread::sleep(Duration::from_millis(300));
    child
}

/// The state that is left is whole, and goes on to the image of one run,
/// on another number of ranks and on one.
fn goes_on(place: &Scratch) {
    fs::copy(place.path("c.ck"), place.path("d.ck")).unwrap();
    let saved = Checkpoint::of_file(&place.path("c.ck")).unwrap();
    // A pass takes no tile further than the next step.
    let n = format!("-n{}", 2 * saved.known.report.convergence.spp + 10);
    let method = "--integrator=reference";
    alone(place, &[&n, "-ob.pfm", method]);
    let more = [&n, "--resume=c.ck", "-oa.pfm", method];
    run(place, 2, &more).succeeded();
    same(place, "resumed");
    alone(place, &[&n, "--resume=d.ck", "-oa.pfm", method]);
    same(place, "resumed");
}

/// A rank that is killed, and an interrupt, of rank 0 or of all.
#[test]
fn a_run_that_is_ended_by_force_goes_on() {
    for (name, rank) in [
        ("-KILL", Some(1)),
        ("-KILL", Some(0)),
        ("-KILL", None),
        ("-INT", Some(0)),
        ("-INT", None),
    ] {
        let place = Scratch::new();
        let child = under_way(&place);
        let ranks = processes(&child);
        assert_eq!(ranks.len(), 3);
        let id = rank.map_or(child.id(), |rank: usize| ranks[rank]);
        let mut kill = Command::new("kill");
        let kill = kill.arg(name).arg(id.to_string()).status();
        assert!(kill.unwrap().success());
        let run = finish(child);
        match (name, rank) {
            ("-KILL", Some(rank)) => {
                assert_ne!(run.status, Some(0));
                let line = format!("process rank {rank} with PID");
                assert!(run.stderr.contains(&line), "{}", run.stderr);
            }
            ("-INT", Some(_)) => assert_eq!(run.status, Some(130)),
            _ => (),
        }
        // All ranks are gone soon.
        let start = Instant::now();
        while ranks.iter().any(is_running) {
            assert!(start.elapsed() < Duration::from_secs(30), "remain");
            thread::sleep(Duration::from_millis(20));
        }
        assert!(name == "-KILL" || place.path("a.pfm").exists());
        goes_on(&place);
    }
}
