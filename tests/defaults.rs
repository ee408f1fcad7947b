// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What is chosen for a run that leaves nothing but pictures, and for no
//! other (chapter "The options").

use crate::outputs::png;
use crate::prelude::*;

use litpt::cli::options::Options;
use litpt::compare::display::Exposure;
use litpt::sky::Cover;

fn plan(line: &str) -> Plan {
    let words = ["pt"].into_iter().chain(line.split_whitespace());
    let options = Options::parse(words).unwrap();
    options.plan(None, false).unwrap()
}

/// The same without the files, and without what a picture ends with.
fn bare(line: &str) -> Plan {
    let mut plan = plan(line);
    plan.outputs = Outputs::default();
    plan
}

const UNTIL: (Option<f64>, Option<f64>) = (Some(10.), Some(0.01));

fn until(plan: &Plan) -> (Option<f64>, Option<f64>) {
    (plan.budget.time, plan.outputs.picture_error)
}

#[test]
fn a_run_that_leaves_pictures_alone_has_defaults_of_its_own() {
    for files in ["-oa.png", "-oa.png -ob.png", "-oa.png --report=a.html"] {
        let plan = plan(&format!("a.obj {files}"));
        assert_eq!(plan.surfaces.albedo, 0.7);
        assert_eq!(plan.surfaces.materials, None);
        assert_eq!(plan.sky.ground, Some(0.3));
        assert_eq!(plan.camera().unwrap().fov, 35.);
        assert_eq!((until(&plan), plan.budget.samples), (UNTIL, None));
    }
    // All others have what they had.
    let usual = Plan { scene: "a.obj".into(), ..Plan::default() };
    for files in [
        "",
        "-o-",
        "-o/dev/stdout",
        "--format=png",
        "-oa.pfm",
        "-oa.pgm",
        "-oa.exr",
        "-oa.litpt",
        "-oa.png -oa.exr",
        "-oa.png -o-",
        "-oa.png --report=a.json",
        "-oa.png --report=a.csv",
        "-oa.png --checkpoint=c",
        "-oa.png --reference=b.exr",
        "--report=a.html",
    ] {
        let line = format!("a.obj {files}");
        let reference = plan(&line).reference;
        let usual = Plan { reference, ..usual.clone() };
        assert!(bare(&line) == usual, "{files}");
        assert_eq!(plan(&line).outputs.picture_error, None, "{files}");
    }
    let part = bare("a.obj -oa.png -n4 --tiles=1/2");
    assert_eq!(part.surfaces, usual.surfaces);
    let points = bare("a.obj --vertices -oa.ply");
    assert_eq!(points.surfaces, usual.surfaces);
}

/// Each of them is off when its own option is typed, and the others stay.
#[test]
fn a_default_of_pictures_is_off_when_its_option_is_typed() {
    let picture = bare("a.obj -oa.png");
    for words in ["-r1", "-r=0.7", "-rfloor=0.2", "--materials", "--band=r"]
    {
        let typed = bare(&format!("a.obj -oa.png {words}"));
        let albedo = if words == "-r=0.7" { 0.7 } else { 1. };
        assert_eq!(typed.surfaces.albedo, albedo, "{words}");
        let asked = words.starts_with("--");
        assert_eq!(typed.surfaces.materials, Some(asked), "{words}");
        let surfaces = picture.surfaces.clone();
        assert!(Plan { surfaces, ..typed } == picture, "{words}");
    }
    for words in ["-n1", "--time=9", "--error=0.1", "-n1 --time=9"] {
        let line = format!("a.obj -oa.png {words}");
        let usual = plan(&format!("a.obj -oa.pfm {words}"));
        assert_eq!(plan(&line).budget, usual.budget, "{words}");
        assert_eq!(plan(&line).outputs.picture_error, None, "{words}");
        let budget = picture.budget;
        assert!(Plan { budget, ..bare(&line) } == picture, "{words}");
    }
    let sky = |words: &str| bare(&format!("a.obj -oa.png {words}")).sky;
    assert_eq!(sky("--ground=0.9").ground, Some(0.9));
    assert_eq!(sky("--ground=0").ground, Some(0.));
    // Nor is there one where something else is said of what is below.
    assert_eq!(sky("--sky=sphere").ground, None);
    assert_eq!(sky("--background=1").ground, None);
    let all = SkyPlan { cover: Cover::Overcast, ..picture.sky };
    assert_eq!(sky("--sky=overcast"), all);
    // A sun outshines the sky, which is white.
    let exposure = |words: &str| {
        let line = format!("a.obj -oa.png --sun=0,40 {words}");
        plan(&line).outputs.exposure
    };
    assert_eq!(exposure("--direct=4"), Some(Exposure::Auto));
    let stops = exposure("--direct=4 --exposure=1");
    assert_eq!(stops, Some(Exposure::Stops(1.)));
    let others = ["", "--direct=4 -oa.exr", "--direct=4 --report=a.csv"];
    assert!(others.map(exposure).iter().all(Option::is_none));
    let fov = |words: &str| {
        let plan = bare(&format!("a.obj -oa.png {words}"));
        plan.camera().unwrap().fov
    };
    let fovs = ["--view=top", "-F70", "-p1,1,1", "-t1,1,1"].map(fov);
    assert_eq!(fovs, [35., 70., 70., 70.]);
}

/// A square in the sun shows shades of grey, and none of them is white.
#[test]
fn a_picture_in_the_sun_is_not_burnt_out() {
    let place = Scratch::new();
    let line =
        format!("square.obj {} --sun=0,40 --direct=4", ABOVE.join(" "));
    place
        .free(&format!("{line} -d16x12 -n16 -oa.png"))
        .told(&["exposure auto (--exposure)", "exposure  -"]);
    let levels = png(&place.get("a.png")).2;
    assert!(levels.iter().all(|&it| 0 < it && it < 65535));
}

/// The level of a PNG for a radiance.
fn level(radiance: f64) -> u16 {
    let curve = 1.055 * radiance.powf(1. / 2.4) - 0.055;
    (65535. * curve + 1e-9).floor() as u16
}

/// A square in the open shows its albedo, and the ground beside it its own.
#[test]
fn a_picture_of_nothing_said_has_the_radiances_of_its_defaults() {
    let place = Scratch::new();
    let above = ABOVE.join(" ");
    let line = format!("square.obj {above} -d32x24 -oa.png -f");
    let levels = || png(&place.get("a.png")).2;
    let run = place.done(&line);
    run.told(&[
        "defaults  albedo of the file's materials or 0.7 (-r), ground 0.3 \
         (--ground), until 1 % of the mean or 10 s (-n, --time, --error)\n",
        "stopped by error",
    ]);
    assert!(levels().iter().all(|&it| it.abs_diff(level(0.7)) <= 1));
    // Materials are read if they can be.
    let named = format!("mtllib a.mtl\nusemtl grey\n{SQUARE}");
    place.put("square.obj", named);
    let run = place.done(&line);
    run.told(&[
        "a.mtl: No such file or directory",
        "square.obj: its materials are ignored, 1 of them",
    ]);
    assert!(levels().iter().all(|&it| it.abs_diff(level(0.7)) <= 1));
    place.put("a.mtl", "newmtl grey\nKd 0.5 0.5 0.5\n");
    let run = place.done(&line);
    assert!(!run.stderr.contains("warning"), "{}", run.stderr);
    assert!(levels().iter().all(|&it| it.abs_diff(level(0.5)) <= 1));
    // A line without a default has none to tell.
    let run = place.done(&format!("{line} -r1 --ground=0 -n2"));
    assert!(!run.stderr.contains("defaults"), "{}", run.stderr);
    // Beside a small square there is the ground.
    place.put("square.obj", "v 0 0 0\nv 1e-3 0 0\nv 0 1e-3 0\nf 1 2 3\n");
    place.done(&format!("square.obj {above} -d32x24 -oa.png -f"));
    assert!(levels()[0].abs_diff(level(0.3)) <= 1);
}

/// The axis that looks up is up, and the note says how to have it again.
#[test]
fn a_picture_has_the_axis_up_that_looks_so() {
    let place = Scratch::with(
        "a.obj",
        "v 0 0 0\nv 0 0 1\nv 1 0 1\nv 1 0 0\nf 1 2 3 4\n",
    );
    let run = place.free("a.obj -d8x6 -oa.png");
    run.told(&[
        "-u 0,1,0 -F 35\n",
        "zenith y, above a ground",
        "defaults  field of view 35 (-F), albedo",
        ", the axis up that faces suggest, or z (-u), until",
    ]);
    let run = place.free("a.obj -d8x6 -oa.pfm");
    run.told(&["zenith z; but y looks up: -u y"]);
    place.free("a.obj -d8x6 -oa.png -f -uz").told(&["zenith z, above"]);
}

/// What is written otherwise is what it was, whatever else is chosen.
#[test]
fn numbers_have_the_bits_of_one_sample_without_a_ground() {
    let place = Scratch::new();
    place.done("room.obj -d32x24 -oa.pfm");
    place.done("room.obj -d32x24 -n1 -r1 -F70 -uz -ob.pfm");
    assert!(place.get("a.pfm") == place.get("b.pfm"));
    place.done("room.obj -d32x24 -oc.pfm -oc.png");
    assert!(place.get("a.pfm") == place.get("c.pfm"));
}

#[test]
fn an_image_that_goes_to_standard_output_unasked_says_so() {
    let place = Scratch::new();
    let told = "the image goes to standard output, as numbers; for a PNG \
                say -o NAME.png";
    let is_told = |line: &str| {
        let run = place.done(&format!("room.obj -d8x6 {line}"));
        run.stderr.matches(told).count() == 1
    };
    assert!(is_told(""));
    assert!(is_told("--report=a.csv"));
    for line in ["-q", "-o-", "--format=png", "-oa.pfm", "--dry-run"] {
        assert!(!is_told(line), "{line}");
    }
    assert!(!is_told("--sample=1,2,0") && !is_told("-oa.litpt"));
    assert!(!is_told("--resume=a.litpt -n2"));
    let run = place.free("room.obj --vertices");
    assert!(!run.stderr.contains(told), "{}", run.stderr);
}

/// A picture whose error is a tenth of its samples' reciprocal is judged after
/// half a second for the first time, and ends the run when it is good enough.
#[test]
fn a_run_ends_when_its_picture_is_good_enough() {
    let error = |film: &Film| Some(0.1 / film.samples() as f64);
    for (goal, seconds) in [(1e-2, 0.5..0.75), (1e-3, 1.0..1.55)] {
        let (start, ticks) = (Instant::now(), AtomicU64::new(0));
        let clock = || start + Duration::from_millis(ticks.load(Relaxed));
        let limits = Limits {
            samples: Some(1 << 20),
            clock: Some(&clock),
            picture: Some((goal, error)),
            ..Limits::default()
        };
        let mut film = Film::new(8, 8);
        let mut run = Convergence::default();
        let mut steady = Steady(&ticks);
        let end = run.run(
            &mut steady,
            &mut film,
            &limits,
            &|_| (),
            &mut |_, _| (),
        );
        assert_eq!(end, Stop::Error, "{goal}");
        assert!(seconds.contains(&run.seconds), "{goal}: {}", run.seconds);
        assert!(0.1 / run.spp as f64 <= goal, "{goal}");
    }
}

/// A renderer that takes ten milliseconds for a sample of each pixel.
struct Steady<'a>(&'a AtomicU64);

impl Renderer for Steady<'_> {
    fn pass(&mut self, film: &mut Film, end: u64, _: &Watch) -> u64 {
        let more = end - film.samples();
        self.0.fetch_add(10 * more, Relaxed);
        film.pixels.iter_mut().for_each(|p| p.add_times(0.5, more));
        0
    }
}
