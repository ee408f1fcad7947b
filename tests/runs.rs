// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The limits of a run, its reports, its reference and its formats, and
//! what signals and full disks do to it.

use crate::prelude::*;

use std::env;

const SCENE: &str = "-iroom.obj -d23x17 -r0.7 --integrator=reference";

fn pt(place: &Scratch, arguments: &str) -> Run {
    place.line(&format!("-q {SCENE} {arguments}"))
}

fn begin(place: &Scratch, arguments: &str) -> Running {
    spawn(&mut place.pt(&format!("-q {SCENE} {arguments}")))
}

fn steps(report: &Value) -> &[Value] {
    report["curve"].as_array().unwrap()
}

/// The samples of the last step of a report.
fn spp(report: &Value) -> u64 {
    steps(report).last().unwrap()["spp"].as_u64().unwrap()
}

/// The report `r.json` of a run that has been stopped by `stop`: it is
/// complete, and the image `a.exr` is that of so many samples.
#[track_caller]
fn complete(place: &Scratch, stop: &str) -> Value {
    let report = place.json("r.json");
    assert_eq!(report["stopped"], stop);
    assert_eq!(report["scene"]["file"], "room.obj");
    assert_eq!(report["scene"]["triangles"], 6);
    assert_eq!(report["settings"]["resolution"], json!([23, 17]));
    assert_eq!(report["settings"]["albedo"], 0.7);
    for key in ["load_seconds", "build_seconds", "render_seconds"] {
        assert!(report[key].as_f64() >= Some(0.), "{key}");
    }
    let last = steps(&report).last().unwrap();
    for key in ["rays", "mean", "mean_stderr", "rmse"] {
        assert_eq!(report[key], last[key], "{key}");
    }
    let image = place.image("a.pfm");
    let counts = place.image("a.exr").samples;
    assert_first_samples(place, &image.means, &counts.unwrap());
    let mean = report["mean"].as_f64().unwrap();
    let sum: f64 = image.means.iter().sum();
    assert!((sum / (23. * 17.) - mean).abs() < 1e-6);
    report
}

/// Each pixel is that of a run with as many samples as it has.
#[track_caller]
fn assert_first_samples(place: &Scratch, means: &[f64], counts: &[f64]) {
    let mut different = counts.to_vec();
    different.sort_by(f64::total_cmp);
    different.dedup();
    for n in different.into_iter().filter(|&n| n > 0.) {
        let whole = pt(place, &format!("-n{n} --format=pfm")).stdout;
        let whole = Image::decode(&whole, &mut |_| ()).unwrap().means;
        for (i, &count) in counts.iter().enumerate() {
            assert!(count != n || means[i] == whole[i], "another image");
        }
    }
}

const FILES: &str = "-oa.pfm -oa.exr --report=r.json";

// ---------------------------------------------------------------- The limits

/// Other programs can only make the run use less of the processor, and
/// last longer: they cannot break either bound.
#[test]
fn a_time_limit_ends_the_run_in_time_with_image_and_report() {
    let place = Scratch::new();
    let start = Instant::now();
    let run = format!("-q {SCENE} {FILES} --time=1.7 -j1");
    place.within("-t 2", &run).succeeded();
    let wall = start.elapsed().as_secs_f64();
    assert!(wall > 1.2, "{wall} seconds by the clock");
    let report = place.json("r.json");
    assert_eq!(report["stopped"], "time");
    assert!(spp(&report) > 1 && report["rmse"].as_f64() > Some(0.));
    assert_eq!(report["settings"]["time"], 1.7);
    assert_eq!(report["settings"]["spp"], Value::Null);
    let own = ["load_seconds", "build_seconds", "render_seconds"]
        .map(|part| report[part].as_f64().unwrap());
    assert!(own.iter().sum::<f64>() <= wall);
    assert!(place.path("a.exr").exists());
    // There is always time for one sample.
    let most = "-n18446744073709551615 --time=1e-9";
    let short = format!("-f {SCENE} {FILES} {most}");
    assert_eq!(place.line(&format!("-q {short}")).stderr, "");
    let report = complete(&place, "time");
    assert_eq!((spp(&report), steps(&report).len()), (1, 1));
    assert_eq!(report["rmse"], Value::Null);
    assert_eq!(report["mean_stderr"], Value::Null);
    let run = place.done(&short);
    let warning = "warning: loading, building and the first sample";
    run.told(&[warning]);
}

/// And each of several reports is written.
#[test]
fn a_run_ends_at_the_first_of_its_limits_and_says_which() {
    let place = Scratch::new();
    for (limits, stop, n) in [
        ("-n13 --time=1e300", "samples", json!(13)),
        ("-n13 --error=1e-9 --time=1000", "samples", json!(13)),
        ("", "samples", json!(1)),
        ("-n1000000 --time=1000 --error=0.023", "error", json!(1000000)),
    ] {
        let reports = "--report=s.json --report=t.csv";
        pt(&place, &format!("{FILES} {reports} {limits} -f")).succeeded();
        let report = complete(&place, stop);
        assert_eq!(report["settings"]["spp"], n);
        match stop {
            "error" => assert!(report["rmse"].as_f64() <= Some(0.023)),
            _ => assert_eq!(json!(spp(&report)), n),
        }
        assert_eq!(place.get("r.json"), place.get("s.json"));
        assert!(!place.get("t.csv").is_empty());
        let files = ["a.exr", "a.pfm", "r.json", "s.json", "t.csv"];
        place.holds_only(&files);
    }
    let report = place.json("r.json");
    assert_eq!(report["settings"]["error"], 0.023);
}

// --------------------------------------------------------------- The signals

/// Starts a run without an end, and returns when its report has a step
/// of at least so many samples.
fn start(place: &Scratch, least: u64, arguments: &str) -> Running {
    let run = format!("{FILES} -n1000000000 {arguments}");
    let mut child = begin(place, &run);
    let path = place.path("r.json");
    wait_until(&mut child, "report", || {
        path.exists() && spp(&place.json("r.json")) >= least
    });
    child
}

#[test]
fn a_signal_ends_the_run_with_its_image_and_report() {
    let ends = [("INT", 130), ("TERM", 143), ("HUP", 129)];
    let warnings = [("XCPU", 152), ("USR1", 138), ("USR2", 140)];
    for (name, status) in [ends, warnings].concat() {
        let place = Scratch::new();
        let child = start(&place, 6, "--checkpoint=c");
        signal(name, child.id());
        let run = finish(child);
        assert_eq!(run.status, Some(status), "{}", run.stderr);
        assert_eq!((run.stdout.len(), run.stderr.as_str()), (0, ""));
        let report = complete(&place, "signal");
        place.holds_only(&["a.exr", "a.pfm", "c", "r.json"]);
        let counts = place.image("a.exr").samples;
        let most = counts.unwrap().into_iter().fold(0., f64::max) as u64;
        assert!((spp(&report)..1_000_000_000).contains(&most));
        let n = format!("-n{} --format=pfm", most + 3);
        let on = pt(&place, &format!("--resume=c {n}")).succeeded();
        assert!(on.stdout == pt(&place, &n).stdout);
    }
}

/// Does something again and again until a run ends, within so many seconds.
fn until_the_end(
    mut child: Running,
    seconds: u64,
    again: impl Fn(&Running),
) -> Run {
    let start = Instant::now();
    while child.0.try_wait().unwrap().is_none() {
        again(&child);
        assert!(start.elapsed() < Duration::from_secs(seconds));
    }
    finish(child)
}

/// Whether a program on Linux catches all signals that end a run.
fn listens(id: u32) -> bool {
    let status = format!("/proc/{id}/status");
    let status = fs::read_to_string(status).unwrap_or_default();
    let caught = status.lines().find_map(|l| l.strip_prefix("SigCgt:"));
    let caught = u64::from_str_radix(caught.unwrap_or("0").trim(), 16);
    let all = [1, 2, 10, 12, 15, 24].map(|signal| 1 << (signal - 1));
    caught.is_ok_and(|mask| all.iter().all(|bit| mask & bit != 0))
}

/// A run of the box, when it listens to signals. Tracing stops at once, but
/// so large an image is summarised and written for a while.
/// None where the system does not tell which signals are caught.
fn slow_to_write(place: &Scratch) -> Option<Running> {
    if fs::metadata("/proc/self/status").is_err() {
        skip("the system does not tell which signals are caught");
        return None;
    }
    place.put("box.obj", BOX);
    let run = format!(
        "-q -ibox.obj -d2048x2048 -n2 --keep-all {FILES} --checkpoint=c \
         --every=0.001 --integrator=reference"
    );
    let mut child = spawn(&mut place.pt(&run));
    let id = child.id();
    wait_until(&mut child, "handler", || listens(id));
    // A box is read and built in some milliseconds, if nobody else works.
    thread::sleep(Duration::from_millis(3000));
    Some(child)
}

#[test]
fn a_warning_may_come_again_and_is_not_the_first_of_two_signals() {
    let place = Scratch::new();
    let Some(child) = slow_to_write(&place) else { return };
    for name in ["USR1", "TERM"] {
        signal(name, child.id());
        thread::sleep(Duration::from_millis(200));
    }
    let run = until_the_end(child, 60, |child| signal("XCPU", child.id()));
    let status = run.status.unwrap();
    assert!([138, 143, 152].contains(&status), "{status}");
    place.image("a.exr");
    assert_eq!(place.json("r.json")["stopped"], "signal");
    place.holds_only(&["a.exr", "a.pfm", "box.obj", "c", "r.json"]);
}

#[test]
fn a_second_signal_ends_the_program_at_once() {
    let place = Scratch::new();
    // Of two different signals that arrive together, either may be first.
    for (first, second, ends) in [
        ("INT", "INT", [130, 130]),
        ("TERM", "TERM", [143, 143]),
        ("INT", "TERM", [130, 143]),
    ] {
        let Some(child) = slow_to_write(&place) else { return };
        signal(first, child.id());
        let run =
            until_the_end(child, 30, |child| signal(second, child.id()));
        let status = run.status.unwrap();
        assert!(ends.contains(&status), "{status}");
        // Where the second signal arrives while files are written, each of
        // them is whole, or has a name that only we use.
        for name in place.names() {
            match name.as_str() {
                "a.exr" | "a.pfm" => drop(place.image(&name)),
                "r.json" => drop(place.json(&name)),
                "c" => assert!(place.get(&name).starts_with(b"litpt")),
                "box.obj" | "room.obj" | "square.obj" => continue,
                _ => assert!(name.starts_with(".pt-"), "{name}"),
            }
            fs::remove_file(place.path(&name)).unwrap();
        }
    }
}

#[test]
fn a_signal_that_is_ignored_from_the_start_stays_ignored() {
    let place = Scratch::new();
    let plain = place.pt(&format!("-q {SCENE} {FILES} -n1000000000"));
    // As nohup does.
    let mut command = place.command("sh");
    command.args(["-c", "trap '' HUP; exec \"$@\"", "sh"]);
    command.arg(plain.get_program()).args(plain.get_args());
    let mut child = spawn(&mut command);
    let report = place.path("r.json");
    let steps = || report.exists().then(|| spp(&place.json("r.json")));
    wait_until(&mut child, "report", || steps().is_some());
    signal("HUP", child.id());
    let now = steps();
    wait_until(&mut child, "another report", || steps() > now);
    signal("TERM", child.id());
    assert_eq!(finish(child).status, Some(143));
}

// The first sample of the image would take far longer than the run.
#[test]
fn a_signal_and_the_time_stop_within_the_first_sample() {
    let place = Scratch::with("box.obj", BOX);
    let all = format!(
        "-ibox.obj -n2 --keep-all {FILES} -r.99 --integrator=reference"
    );
    for (more, status, why) in [
        ("-d2048x1536", 130, "signal"),
        ("--time=1 -d1024x768 -f", 0, "time"),
    ] {
        let mut child = spawn(&mut place.pt(&format!("{all} {more}")));
        let id = child.id();
        if why == "signal" {
            wait_until(&mut child, "handler", || listens(id));
            thread::sleep(Duration::from_millis(1000));
            signal("INT", child.id());
        }
        let run = finish(child);
        assert_eq!(run.status, Some(status));
        // To summarise so many pixels takes longer than to answer.
        let answer = "> finishing; a second signal aborts";
        assert_eq!(run.stderr.contains(answer), why == "signal");
        let report = place.json("r.json");
        assert_eq!(report["stopped"], why);
        assert!(report["rays"].as_u64() > Some(0));
        assert_eq!((spp(&report), &report["rmse"]), (0, &Value::Null));
        let image = place.image("a.exr");
        let pixels = image.samples.unwrap().into_iter();
        let pixels = pixels.zip(image.errors.unwrap());
        let (some, none): (Vec<_>, Vec<_>) = pixels.partition(|p| p.0 > 0.);
        assert!(some.len() % 256 == 0 && some.iter().all(|p| p.0 == 1.));
        assert!(!none.is_empty() && none.iter().all(|p| p.1.is_infinite()));
    }
}

#[test]
fn a_signal_while_the_scene_is_read_ends_the_program_and_leaves_nothing() {
    let place = Scratch::new();
    let command = place.pt(&format!("{FILES} --checkpoint=c"));
    let child = keep_reading(command);
    signal("TERM", child.id());
    // The pipe stays open: nothing but the signal ends the program.
    let wait = |_: &_| thread::sleep(Duration::from_millis(1));
    let run = until_the_end(child, 30, wait);
    let line =
        "error: no image: signal 15 came while reading standard input\n";
    assert_eq!((run.status, run.stderr.as_str()), (Some(143), line));
    place.holds_only(&[]);
}

/// A test in a process that ignores what a terminal sends, as one that nohup
/// or a script has begun.
#[test]
fn runs_heed_the_signals_that_their_test_ignores() {
    let place = Scratch::new();
    let test = "runs::a_signal_ends_the_run_with_its_image_and_report";
    let mut command = place.command("sh");
    command.args(["-c", "trap '' HUP INT QUIT; exec \"$@\"", "sh"]);
    command.arg(env::current_exe().unwrap()).args(["--exact", test]);
    assert!(outcome(&mut command).succeeded().text().contains("1 passed"));
}

/// Whether its guard ends it, or the system, which does so whatever happens
/// to the process of the test.
#[test]
#[cfg(target_os = "linux")]
fn no_run_outlives_its_test() {
    for is_guarded in [true, false] {
        let (place, mut id) = (Scratch::new(), 0);
        let test = || {
            let child = start(&place, 10, "");
            id = child.id();
            assert!(!is_guarded, "as it should");
            std::mem::forget(child);
        };
        let test = thread::scope(|scope| scope.spawn(test).join());
        assert_eq!((test.is_err(), id > 0), (is_guarded, true));
        let start = Instant::now();
        while is_running(id) {
            assert!(start.elapsed().as_secs() < 30, "it runs on");
            thread::sleep(Duration::from_millis(1));
        }
        // It leaves a readable report, and no image.
        let report = place.json("r.json");
        assert_eq!(report["stopped"], Value::Null);
        assert!(steps(&report).len() >= 6);
        assert!(report["rmse"].as_f64() > Some(0.));
        assert!(report["rays"].as_u64() > Some(10 * 23 * 17));
        assert!(!place.path("a.exr").exists());
    }
}

// ------------------------------------------------------------ What does not fit

/// Warnings before the end, one error at the end, and each of the names
/// of the files that could not be written in a warning.
#[track_caller]
fn warned(run: &Run, names: &[&str]) {
    let lines: Vec<&str> = run.stderr.lines().collect();
    let (error, warnings) = lines.split_last().unwrap();
    assert_eq!(run.status, Some(1), "{}", run.stderr);
    assert!(error.starts_with("error: "), "{error}");
    assert!(warnings.iter().all(|line| line.starts_with("warning: ")));
    let fault = |name| format!("{name}: cannot write: File too large");
    assert!(names.iter().any(|name| error.contains(&fault(name))));
    for name in names {
        let fault = fault(name);
        assert!(warnings.iter().any(|w| w.contains(&fault)), "{fault}");
    }
}

#[test]
fn what_does_not_fit_costs_neither_the_image_nor_the_rest() {
    let place = Scratch::new();
    let scene = "-iroom.obj -d41x30";
    let files = "-oa.pgm --report=r.json --checkpoint=c";
    let run = format!("{scene} {files} -n6 --every=1e-9");
    warned(&place.within("-f 64", &run), &["c"]);
    let report = place.json("r.json");
    assert_eq!(spp(&report), 6);
    assert_eq!(report["stopped"], "samples");
    let whole = place.render("-d41x30 -n6");
    assert_eq!(place.get("a.pgm"), whole);
    place.holds_only(&["a.pgm", "r.json"]);
    // A checkpoint that was there before stays as it is.
    place.done(&format!("{scene} -n2 -ob.pgm --checkpoint=c"));
    let old = place.get("c");
    warned(&place.within("-f 64", &format!("{run} -f --resume=c")), &["c"]);
    assert_eq!(place.get("c"), old);
    assert_eq!(place.get("a.pgm"), whole);
    place.holds_only(&["a.pgm", "b.pgm", "c", "r.json"]);
    // Neither fits here.
    let place = Scratch::new();
    let run = format!("-iroom.obj -d9x7 -n40 {files} --every=1e-9");
    warned(&place.within("-f 1", &run), &["r.json", "c"]);
    assert_eq!(place.get("a.pgm"), place.render("-d9x7 -n40"));
    place.holds_only(&["a.pgm"]);
}

// ------------------------------------------------------------- The reference

#[test]
fn every_point_says_its_true_error_against_the_reference() {
    let place = Scratch::new();
    pt(&place, "-n300 -s77 -otruth.exr -otruth.pfm").succeeded();
    for name in ["truth.exr", "truth.pfm"] {
        let run = format!("{FILES} -f -n50 --reference={name}");
        assert_eq!(pt(&place, &run).stderr, "");
        let report = complete(&place, "samples");
        assert_eq!(report["settings"]["reference"], name);
        let error = |step: &Value| step["rmse_reference"].as_f64().unwrap();
        assert!(steps(&report).iter().all(|step| error(step) > 0.));
        let [one, other] =
            ["a.exr", "truth.pfm"].map(|name| place.image(name).means);
        let squares = one.iter().zip(&other).map(|(a, b)| (a - b).powi(2));
        let expected = (squares.sum::<f64>() / (23. * 17.)).sqrt();
        let last = steps(&report).last().unwrap();
        assert!((error(last) / expected - 1.).abs() < 1e-5);
    }
    pt(&place, &format!("{FILES} -f -n3")).succeeded();
    let report = place.json("r.json");
    assert!(steps(&report)[2].get("rmse_reference").is_none());
    // One of the same seed is worth a warning.
    let warnings = |seed| {
        let files = "-oa.pgm -f --reference=truth.exr";
        let run = place.done(&format!("{SCENE} {files} -n3 -s{seed}"));
        run.stderr.matches("warning: the reference has the seed").count()
    };
    assert_eq!([77, 7, 8].map(warnings), [1, 0, 0]);
}

// --------------------------------------------------------------- The formats

#[test]
fn standard_output_has_the_bytes_of_the_file_in_each_format() {
    let place = Scratch::new();
    pt(&place, "-n5 -oa.pgm -oa.png -oa.pfm -oa.exr").succeeded();
    let shown =
        |format: &str| pt(&place, &format!("-n5 --format {format}")).stdout;
    for format in ["pgm", "png", "pfm"] {
        let file = place.get(&format!("a.{format}"));
        assert!(shown(format) == file, "{format}");
    }
    let pfm = place.image("a.pfm");
    // An EXR has the times of its run.
    let [one, other] = [place.get("a.exr"), shown("exr")].map(|bytes| {
        let mut image = Image::decode(&bytes, &mut |_| ()).unwrap();
        let timed = ["load_seconds", "build_seconds", "render_seconds"];
        for name in timed {
            let seconds = image.attributes.remove(name).unwrap();
            assert!(seconds.parse::<f64>().unwrap() >= 0.);
        }
        image
    });
    assert_eq!(one, other);
    assert_eq!((one.means.clone(), None), (pfm.means, pfm.errors));
    assert_eq!(one.samples, Some(vec![5.; 23 * 17]));
    for (name, value) in [
        ("scene", "room.obj"),
        ("resolution", "23x17"),
        ("threads", &rayon::current_num_threads().to_string()),
        ("seed", "0"),
        ("albedo", "0.7"),
        ("spp", "5"),
        ("stopped", "samples"),
    ] {
        assert_eq!(one.attributes[name], value, "{name}");
    }
}

#[test]
fn a_report_between_two_points_says_where_the_run_stands() {
    let mut film = Film::new(2, 1);
    for pixel in &mut film.pixels {
        [0., 1., 0.5].into_iter().for_each(|weight| pixel.add(weight));
    }
    let mut convergence = Convergence::default();
    (convergence.spp, convergence.rays) = (3, 17);
    convergence.seconds = 0.5;
    let before = Report { convergence, ..Report::default() };
    let report = before.complete(&film);
    assert!(report.summary(2).iter().all(|(name, _)| *name != "pixels"));
    let Report { convergence, .. } = report;
    assert!(before.convergence.curve.is_empty());
    let last = convergence.last();
    assert_eq!((convergence.curve.len(), last.spp), (1, 3));
    assert_eq!((last.mean, convergence.rays), (0.5, 17));
    assert_eq!(last.rmse, Some(f64::sqrt(0.25 / 3.)));
    // A pixel below zero is told.
    film.pixels[0].add(-9.);
    film.pixels[1].add(0.);
    let (name, line) = before.complete(&film).summary(2).pop().unwrap();
    assert_eq!(name, "pixels");
    assert!(line.starts_with("1 of 2 are below zero"), "{line}");
}

#[test]
fn a_preview_grows_while_the_image_is_rendered() {
    let place = Scratch::new();
    let mut child = begin(&place, "--preview -oa.png -oa.pfm -n1000000000");
    let path = place.path("a.png");
    wait_until(&mut child, "preview", || path.exists());
    let whole = |png: &[u8]| png.ends_with(b"IEND\xae\x42\x60\x82");
    let first = place.get("a.png");
    wait_until(&mut child, "change", || place.get("a.png") != first);
    assert!(whole(&first) && whole(&place.get("a.png")));
    assert!(!place.path("a.pfm").exists());
    signal("INT", child.id());
    assert_eq!(finish(child).status, Some(130));
    place.holds_only(&["a.pfm", "a.png"]);
}
