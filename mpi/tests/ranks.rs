// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Several ranks render what one process does, and what is left when one
//! of them dies.

#[path = "../../tests/common/mod.rs"]
mod common;

use std::process::Command;
use std::time::{Duration, Instant};
use std::{fs, thread};

use common::*;
use litpt::image::Image;
use litpt::state::checkpoint::Checkpoint;
use litpt::state::shards::merge;

const SCENE: &str = "-p0,0,0 -q -f -iroom.obj -d70x50 -r0.7 -j1";

/// The command `pt` on so many ranks.
fn ranks(place: &Scratch, n: usize, arguments: &str) -> Command {
    let mut command = place.command("mpirun");
    let root = "--allow-run-as-root --oversubscribe --bind-to none";
    let program = env!("CARGO_BIN_EXE_pt-mpi");
    let line = format!("{root} -n {n} {program} {SCENE} {arguments}");
    command.args(line.split_whitespace());
    command
}

/// Its run to the end, with the scene on standard input.
fn run(place: &Scratch, n: usize, arguments: &str) -> Run {
    let mut command = ranks(place, n, arguments);
    let input = fs::File::open(place.path("room.obj")).unwrap();
    common::outcome(command.stdin(input))
}

fn same(place: &Scratch, what: &str) {
    assert!(place.get("a.pfm") == place.get("b.pfm"), "{what}");
}

/// The image of one process is that of several ranks, which trace as many
/// rays; the report has the numbers of their paths.
#[test]
fn ranks_render_the_image_of_one_process() {
    for (arguments, numbers) in [
        ("-n23 --integrator=reference", &[1, 2, 5][..]),
        ("-n64 --integrator=sobol", &[3]),
        ("-n64 --integrator=gather -j4", &[2, 5]),
        ("-n400", &[2]),
        ("--error=0.02 --integrator=reference", &[5]),
        ("--error=0.01", &[3]),
        ("-n40 --crop=3,5,33x40", &[3]),
        ("-n1 -d9x7", &[5]),
    ] {
        let place = Scratch::new();
        place.done(&format!("{SCENE} {arguments} -oa.pfm --report=s.json"));
        for &n in numbers {
            let out = "-i- -ob.pfm --report=r.json";
            let run = run(&place, n, &format!("{arguments} {out}"));
            assert_eq!(run.succeeded().stderr, "");
            same(&place, &format!("{arguments}: {n} ranks"));
            let report = place.json("r.json");
            assert_eq!(report["rays"], place.json("s.json")["rays"]);
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
fn ranks_fill_the_rows_of_one_process() {
    let place = Scratch::new();
    let root = "--allow-run-as-root --oversubscribe --bind-to none -n 3";
    let program = env!("CARGO_BIN_EXE_pt-mpi");
    for tally in ["--view-factors=faces", "--sky-patches=1"] {
        let line = format!("room.obj --faces {tally} -n2048 -r0.7 -qf -j1");
        place.free(&format!("{line} -oa.csv")).succeeded();
        let line = format!("{root} {program} {line} -ob.csv");
        let mut command = place.command("mpirun");
        let run = common::outcome(command.args(line.split_whitespace()));
        run.succeeded();
        assert!(place.get("a.csv") == place.get("b.csv"), "{tally}");
    }
}

/// Some learn, others take what one process has learnt.
#[test]
fn ranks_render_a_part_of_a_run() {
    let place = Scratch::new();
    let whole = "-n64 --integrator=gather";
    place.done(&format!("{SCENE} {whole} -oa.pfm"));
    place.done(&format!("{SCENE} {whole} --samples=0..32 -oa.litpt"));
    for part in ["1/2 -ob.litpt", "2/2 -oc.litpt --learnt=a.litpt"] {
        let part = format!("{whole} --samples=32..64 --tiles={part}");
        run(&place, 3, &part).succeeded();
    }
    let parts = ["a.litpt", "b.litpt", "c.litpt"].map(|n| place.path(n));
    let states = parts.map(|path| Checkpoint::of_file(&path));
    let film = merge(states).unwrap().film;
    let whole = Image::read(&place.path("a.pfm")).unwrap().means;
    let means = film.means().map(|x| f64::from(x as f32));
    assert!(means.eq(whole));
}

#[test]
fn a_time_limit_ends_all_ranks() {
    let place = Scratch::new();
    let start = Instant::now();
    run(&place, 3, "--time=2 -oa.pfm --report=r.json").succeeded();
    assert!(start.elapsed() < Duration::from_secs(30));
    let report = place.json("r.json");
    assert_eq!(report["stopped"], "time");
    assert!(report["spp"].as_u64() > Some(1));
    let last = report["curve"].as_array().unwrap().last().unwrap();
    assert!(last["processor_seconds"].as_f64() > Some(0.));
}

/// The signal reaches the slower rank while the other waits for it.
#[test]
fn ranks_stop_while_they_learn() {
    let place = Scratch::new();
    let long = "-d2000x2000 -n64 --integrator=gather -oa.pfm";
    let child = spawn(&mut ranks(&place, 2, long));
    thread::sleep(Duration::from_secs(2));
    let ranks = processes(&child);
    signal("STOP", ranks[1]);
    // Rank 0 does its part meanwhile, which takes some seven seconds.
    thread::sleep(Duration::from_secs(12));
    signal("CONT", ranks[1]);
    signal("INT", ranks[0]);
    let start = Instant::now();
    let run = finish(child);
    assert!(start.elapsed() < Duration::from_secs(3), "too slow");
    assert_eq!(run.status, Some(130));
    let fault = "error: no image: signal 2 came while learning";
    assert!(run.stderr.starts_with(fault), "{}", run.stderr);
}

#[test]
fn what_is_wrong_is_said_once() {
    let place = Scratch::new();
    place.put("bad.obj", "v 1 2\n");
    place.put("lib.obj", format!("mtllib none.mtl\n{}", common::ROOM));
    for (arguments, message) in [
        ("-ibad.obj -oa.pfm", "bad.obj:1:"),
        ("-inone.obj -oa.pfm", "No such file"),
        ("-ilib.obj -oa.pfm --materials", "none.mtl: No such file"),
        ("-n4 -o/dev/full", "No space left"),
    ] {
        let run = run(&place, 3, arguments);
        assert_eq!(run.status, Some(1), "{}", run.stderr);
        assert_eq!(run.stderr.matches("error:").count(), 1);
        run.told(&[message]);
    }
}

/// The processes of the ranks, in their order.
fn processes(run: &Running) -> Vec<u32> {
    let id = run.id();
    let children = format!("/proc/{id}/task/{id}/children");
    let children = fs::read_to_string(children).unwrap();
    children.split_whitespace().map(|id| id.parse().unwrap()).collect()
}

/// A run of three ranks that has saved its state at least once.
fn under_way(place: &Scratch) -> Running {
    let saved = "--checkpoint=c.ck --every=0.2 -n1000000000 -oa.pfm";
    let saved = format!("{saved} --integrator=reference");
    let mut child = spawn(&mut ranks(place, 3, &saved));
    wait_until(&mut child, "checkpoint", || place.path("c.ck").exists());
    thread::sleep(Duration::from_millis(300));
    child
}

/// The state that is left is whole, and goes on to the image of one run,
/// on another number of ranks and on one.
fn goes_on(place: &Scratch) {
    fs::copy(place.path("c.ck"), place.path("d.ck")).unwrap();
    let saved = Checkpoint::of_file(&place.path("c.ck")).unwrap();
    // A pass takes no tile further than the next step.
    let n = 2 * saved.record.report.convergence.spp + 10;
    let n = format!("-n{n} --integrator=reference");
    place.done(&format!("{SCENE} {n} -ob.pfm"));
    run(place, 2, &format!("{n} --resume=c.ck -oa.pfm")).succeeded();
    same(place, "resumed");
    place.done(&format!("{SCENE} {n} --resume=d.ck -oa.pfm"));
    same(place, "resumed");
}

/// A rank that is killed, and an interrupt, of rank 0 or of all.
#[test]
fn a_run_that_is_ended_by_force_goes_on() {
    let killed = [Some(1), Some(0), None].map(|rank| ("KILL", rank));
    let asked = [Some(0), None].map(|rank| ("INT", rank));
    for (name, rank) in killed.into_iter().chain(asked) {
        let place = Scratch::new();
        let child = under_way(&place);
        let ranks = processes(&child);
        assert_eq!(ranks.len(), 3);
        let id = rank.map_or(child.id(), |rank: usize| ranks[rank]);
        signal(name, id);
        let run = finish(child);
        match (name, rank) {
            ("KILL", Some(rank)) => {
                assert_ne!(run.status, Some(0));
                let line = format!("process rank {rank} with PID");
                run.told(&[&line]);
            }
            ("INT", Some(_)) => assert_eq!(run.status, Some(130)),
            _ => (),
        }
        // All ranks are gone soon.
        let start = Instant::now();
        while ranks.iter().any(|&id| is_running(id)) {
            assert!(start.elapsed() < Duration::from_secs(30), "remain");
            thread::sleep(Duration::from_millis(20));
        }
        assert!(name == "KILL" || place.path("a.pfm").exists());
        goes_on(&place);
    }
}
