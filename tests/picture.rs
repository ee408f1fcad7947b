// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A filtered picture is as wrong as it says, and is the same however it was
//! made (chapter "A picture for looking").

use crate::prelude::*;

use crate::outputs::png;
use litpt::film::{Fragment, Fragments};
use litpt::filter::{Filtered, fragments};
use litpt::plan::{CameraPlan, Plan, SensorPlan, Stand};
use litpt::scene::read_obj;
use std::slice::from_mut;
use std::sync::Arc;

const SIDE: u32 = 96;

/// The radiance of a pixel: stripes, of what is gathered and of corrections.
fn truth(x: u32) -> [f64; 2] {
    [0.05, 0.04].map(|height| height * f64::from(x / 4 % 2))
}

/// A film of stripes on a wall, with noise that is uniform; and what the
/// middles of its pixels show.
fn striped(shown: &Arc<Fragments>, seed: u64, odd: bool) -> Film {
    let mut random = Pcg64::seed_from_u64(seed);
    let film = Film::new(SIDE, SIDE);
    let mut film = film.with_halves(Some(shown.clone()));
    let values = if odd { 7 } else { 8 };
    for FilmTile { tile, pixels, halves, .. } in film.tiles() {
        for (i, (pixel, halves)) in (0..).zip(pixels.iter_mut().zip(halves))
        {
            let [gathered, correction] = truth(tile.corner.0 + i % 16);
            for number in 0..values {
                let mut noise = || random.random::<f64>() - 0.5;
                let (a, b) = (0.2 * noise(), 0.5 * noise());
                let parts = [gathered + a, correction + b];
                let samples = [(parts, 1)];
                add_samples(from_mut(halves), number, &samples);
                pixel.add(parts[0] + parts[1]);
            }
        }
    }
    film
}

fn wall() -> Arc<Fragments> {
    let view = look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 20.);
    let mesh = cavity(0.1, 64);
    let setting = Setting::new(&mesh, (0.8, DVec3::Z), &view, 1.).unwrap();
    let size = (SIDE, SIDE);
    let gather = setting.gather(size);
    let window = Window { corner: (0, 0), size };
    let windows = (window, window);
    fragments(gather.intersector, &gather.view, windows).into()
}

fn mean_square(image: &[f64]) -> f64 {
    let exact = |i: usize| truth(i as u32 % SIDE).iter().sum::<f64>();
    let errors = image.iter().enumerate().map(|(i, x)| x - exact(i));
    errors.map(|error| error * error).sum::<f64>() / image.len() as f64
}

/// Of 64 images the stated mean squares are on average those of the true
/// errors, as far as their own scatter tells (4.5 standard errors, one false
/// alarm in 10^5), and the filter pays; with odd numbers too.
#[test]
fn a_picture_is_as_wrong_as_it_says() {
    let shown = wall();
    for odd in [false, true] {
        let [mut gap, mut plain, mut filtered, mut bias] =
            [Accumulator::default(); 4];
        for seed in 0..64 {
            let film = striped(&shown, seed, odd);
            let picture = Filtered::of(&film).unwrap();
            let means: Vec<f64> = film.means().collect();
            let [rmse, wrong] = [picture.error.rmse, picture.error.bias];
            let square = mean_square(&picture.image.means);
            gap.add(rmse * rmse - square);
            plain.add(mean_square(&means));
            filtered.add(square);
            bias.add(wrong * wrong);
            // The errors of pixels add up to that of the image.
            let errors = picture.image.errors.unwrap();
            let squares = errors.iter().map(|error| error * error);
            let mean = squares.sum::<f64>() / errors.len() as f64;
            assert!((mean / (rmse * rmse) - 1.).abs() < 0.05);
        }
        assert!(gap.mean().abs() < 4.5 * gap.standard_error(), "{gap:?}");
        assert!(3. * filtered.mean() < plain.mean());
        let share = bias.mean() / filtered.mean();
        assert!((0.2..0.8).contains(&share), "{share}");
    }
}

/// There is nothing to filter without four values, and an image without noise
/// stays as it is.
#[test]
fn what_needs_no_filter_is_not_changed() {
    let shown = wall();
    assert!(Filtered::of(&Film::new(SIDE, SIDE)).is_none());
    let film = |values, last| {
        let film = Film::new(SIDE, SIDE);
        let mut film = film.with_halves(Some(shown.clone()));
        let mut parts = film.tiles();
        for part in &mut parts {
            let is_last = part.tile.corner == (80, 80);
            let values = if is_last { last } else { values };
            let corner = part.tile.corner.0;
            let pixels = part.pixels.iter_mut();
            for (i, (halves, pixel)) in
                (0..).zip(part.halves.iter_mut().zip(pixels))
            {
                let parts = truth(corner + i % 16);
                for n in 0..values {
                    let samples = [(parts, 1)];
                    add_samples(from_mut(halves), n, &samples);
                    pixel.add(parts[0] + parts[1]);
                }
            }
        }
        Filtered::of(&film)
    };
    assert!(film(1, 1).is_none());
    // A tile without a half has nothing around it to be filled from.
    assert!(film(4, 0).is_none());
    assert!(film(4, 1).is_none());
    assert!(film(3, 3).is_none());
    let exact = film(4, 4).unwrap();
    assert!(mean_square(&exact.image.means) < 1e-15);
    assert!(exact.error.rmse < 1e-7, "{:?}", exact.error);
}

const VIEW: &str = "-qf -iroom.obj -d20x25 -r0.7 --integrator=gather -n12";

/// The picture does not depend on threads, instructions or on where a run was
/// interrupted; only files that show it have it.
#[test]
fn a_picture_is_the_same_however_it_is_made() {
    pictures("gather");
    pictures("sobol");
}

fn pictures(method: &str) {
    let place = Scratch::new();
    let view = VIEW.replace("gather", method);
    let files = "-oa.png -oa.pfm -oa.exr --report=a.json";
    place.done(&format!("{view} -j1 {files}"));
    place.done(&format!("{view} -j3 --isa=portable -ob.png -ob.litpt"));
    assert!(place.get("a.png") == place.get("b.png"));
    if method == "gather" {
        place.done(&format!("{view} -n5 -oc.png -oc.litpt"));
        place.done("-qf --resume=c.litpt -n12");
        assert!(place.get("a.png") == place.get("c.png"));
    }
    // Numbers stay as they are, and the picture may be left out.
    place.done(&format!("{view} --no-filter -od.png -od.pfm -od.litpt"));
    assert!(place.get("a.png") != place.get("d.png"));
    assert!(place.get("a.pfm") == place.get("d.pfm"));
    let [read, shown] =
        ["d.pfm", "d.png"].map(|name| place.image(name).means);
    let close = |(a, b): (&f64, &f64)| (a.clamp(0., 1.) - b).abs() < 1e-4;
    assert!(read.iter().zip(&shown).all(close));
    let report = place.json("a.json");
    let [rmse, bias] = ["rmse", "bias"]
        .map(|name| report["picture"][name].as_f64().unwrap());
    let all = report["rmse"].as_f64().unwrap();
    assert!(0. < bias && bias < rmse && rmse < all);
    // Its channels stand beside the others.
    let names = |bytes: &[u8], name: &[u8]| {
        bytes.windows(name.len()).any(|window| window == name)
    };
    let bytes = place.get("a.exr");
    assert!(names(&bytes, b"\0filtered.Y\0"));
    assert!(names(&bytes, b"\0filtered_stderr.Y\0"));
    place.done(&format!("{view} --no-filter -oe.exr"));
    assert!(!names(&place.get("e.exr"), b"\0filtered.Y\0"));
}

/// A state without what a picture needs, or a part of one, gives the image as
/// it is, and a warning.
#[test]
fn what_cannot_be_filtered_is_said() {
    let place = Scratch::new();
    let loud = VIEW.replace("-qf", "-f");
    place.done(&format!("{loud} -oa.pfm -oa.litpt"));
    place.put("c.litpt", place.get("a.litpt"));
    let run = place.done("-f --resume=a.litpt -n24 -ob.png");
    run.told(&["none can be filtered"]);
    assert!(!run.stderr.contains("picture   rmse"));
    place.done("-qf --resume=c.litpt -n24 -oc.png --no-filter");
    assert!(place.get("b.png") == place.get("c.png"));
    // What a part says of its own picture is not said of the whole.
    for (part, range) in [("a", "0..6"), ("b", "6..12")] {
        let files = format!("-f -o{part}.litpt -o{part}.png");
        place.done(&format!("{VIEW} --samples={range} {files}"));
    }
    let merge = |to: &str| {
        let files = "merge a.litpt b.litpt --report r.json -f";
        place.ptimg(&format!("{files} {to}")).stderr
    };
    assert!(merge("-oc.png").contains("the picture is not filtered"));
    assert!(place.json("r.json").get("picture").is_none());
    assert_eq!(merge("-oc.pfm -oc.litpt"), "");
    let paths = "--integrator=reference --background=1";
    for (part, range) in [("a", "0..6"), ("b", "6..12")] {
        let line =
            format!("{VIEW} {paths} --samples={range} -o{part}.litpt");
        place.done(&line);
    }
    assert!(merge("-oc.png").contains("the picture has no opacity"));
}

/// A triangle before a grey, whose edges are lines.
#[test]
fn a_background_is_seen_behind_what_the_opacity_tells() {
    let place =
        Scratch::with("a.obj", "v -2 9 -2\nv 3 9 -1\nv 0 9 3\nf 1 2 3\n");
    for method in ["reference", "sobol", "gather"] {
        let how = format!("--integrator={method} --no-filter");
        let view = format!("a.obj -r0.5 -d32x24 -n256 -f {how}");
        place.done(&format!("{view} -oa.pfm"));
        place.done(&format!("{view} --background=0.25 -ob.pfm -ob.png"));
        let [sky, grey] = ["a.pfm", "b.pfm"].map(|n| place.image(n).means);
        let (kind, _, levels) = png(&place.get("b.png"));
        assert_eq!(kind, png::ColorType::GrayscaleAlpha);
        let mut parts = [0; 3];
        for (i, &[level, opacity]) in
            levels.as_chunks().0.iter().enumerate()
        {
            // A line crosses at most 7 of 16 squares with a point each, and
            // 31 of 256.
            let around = if i / 32 < 12 { 1. } else { 0. };
            let seen = 1. - (sky[i] - grey[i]) / (around - 0.25);
            let opacity = f64::from(opacity) / 65535.;
            assert!((opacity - seen).abs() < 7. / 16. + 31. / 256., "{i}");
            // The grey 0.25 by the curve of sRGB.
            assert!(opacity > 0. || level == 35198, "{i}");
            let is_whole = [opacity == 0., opacity == 1.];
            let kind = is_whole.iter().position(|&it| it).unwrap_or(2);
            parts[kind] += 1;
        }
        assert!(parts.iter().all(|&count| count > 9), "{parts:?}");
    }
    // What ptimg shows of the numbers of a filtered picture is the same.
    place.done(
        "a.obj -r0.5 -d32x24 -n64 --integrator=gather --background=0.25 \
         -oc.exr -oc.png",
    );
    place.ptimg("tonemap c.exr -od.png").succeeded();
    let [(a, _, shown), (b, _, again)] =
        ["c.png", "d.png"].map(|name| png(&place.get(name)));
    assert_eq!((a, shown.len()), (b, again.len()));
    // A mean of 24 bits is off by 2^-24 of itself.
    assert!(shown.iter().zip(again).all(|(a, b)| a.abs_diff(b) <= 1));
    let run = place.free("a.obj --vertices --background=1");
    run.failed(2, &["cannot be used"]);
}

/// A ground goes on to a background of its own grey: the picture has neither
/// an opacity nor a horizon, by any exposure.
#[test]
fn a_ground_that_is_its_background_has_no_horizon() {
    let place = Scratch::with(
        "a.obj",
        "v 0 9 0\nv 1e-3 9 0\nv 0 9 1e-3\nf 1 2 3\n",
    );
    let view = "a.obj -p0,0,1 -t0,9,1 -d16x12 -n16 -f";
    for cover in ["uniform", "sphere"] {
        for exposure in ["0", "1"] {
            let how = format!("--sky={cover} --exposure={exposure}");
            let seamless = "--ground=0.3 --background=0.3 -oa.png -oa.exr";
            place.done(&format!("{view} {how} {seamless}"));
            let (kind, _, levels) = png(&place.get("a.png"));
            assert_eq!(kind, png::ColorType::Grayscale);
            let grey = levels[0];
            assert!(levels.iter().all(|it| it.abs_diff(grey) <= 1));
            let line = format!("tonemap a.exr -ob.png -f -e{exposure}");
            place.ptimg(&line).succeeded();
            let (kind, _, again) = png(&place.get("b.png"));
            assert_eq!(kind, png::ColorType::Grayscale);
            assert!(again.iter().all(|it| it.abs_diff(grey) <= 1));
        }
    }
    place.done(&format!("{view} --ground=0.3 --background=0.4 -oa.png"));
    let (kind, _, levels) = png(&place.get("a.png"));
    assert_eq!(kind, png::ColorType::GrayscaleAlpha);
    assert_eq!((levels[1], levels[2 * 16 * 12 - 1]), (0, 65535));
}

/// A picture of a run, and one of its EXR, are equally bright.
#[test]
fn automatic_exposure_has_one_definition() {
    let place = Scratch::new();
    let stops = |run: Run| {
        let text = run.succeeded().stderr;
        let line = text.lines().find(|line| line.contains("exposure"));
        let words = line.expect(&text).split_whitespace();
        let number = words.map(str::parse::<f64>).find_map(Result::ok);
        number.expect(&text)
    };
    for options in [
        "-n2",
        "-n2 --ground 0.9",
        "-n16 --sky overcast --ground 0.5 --integrator=sobol",
        "-n16 --sky overcast -r0.2 --integrator=gather",
        "-n1 --crop 3,2,20x9",
    ] {
        let scene = "-iroom.obj -d40x30 -F120 -r1 --ground=0";
        let scene = format!("{scene} {options} -f");
        place.done(&format!("{scene} -o a.exr"));
        let ours = place.done(&format!("{scene} -o a.png --exposure auto"));
        let theirs = place.ptimg("tonemap a.exr -o b.png -f -e auto");
        assert_eq!(stops(ours), stops(theirs), "{options}");
    }
}

/// What a camera at the origin sees of a mesh before a grey of 1.
fn shown(obj: &str, size: (u32, u32)) -> Fragments {
    let stand = Stand::At(DVec3::ZERO, DVec3::Y);
    let (resolution, background) = (size, Some(1.));
    let camera = CameraPlan {
        resolution,
        stand,
        background,
        ..CameraPlan::default()
    };
    let sensor = SensorPlan::Camera(camera);
    let plan = Plan { sensor, ..Plan::default() };
    let mesh = read_obj(obj.as_bytes()).unwrap();
    let world = World::new(&plan, mesh.into(), Host::default()).unwrap();
    let window = Window { corner: (0, 0), size };
    fragments(&world.geometry.bvh, &world.view(), (window, window))
}

/// The parts of a pixel add up to it, whatever it shows; and a rod that no ray
/// through the middle of a pixel meets is seen, as wide as it is.
#[test]
fn the_fragments_of_a_pixel_cover_it() {
    // Two walls that meet, a shelf before them, and a rod within a column
    // of 64: less than a third of a pixel wide, and high enough for all rows.
    let pixel = 2. * 35f64.to_radians().tan() / 48.;
    let [a, b] = [-7.8, -7.5].map(|column: f64| column * pixel);
    let obj = format!(
        "v -3 4 -1\nv 0.05 5 -1\nv 0.05 5 1\nv -3 4 1\nf 1 2 3 4\n\
         v 3 4 -1\nv 3 4 1\nf 2 5 6 3\n\
         v -0.5 3 0.1\nv 0.7 3 0.1\nv 0.7 3 0.2\nv -0.5 3 0.2\nf 7 8 9 10\n\
         v {a} 1 -2\nv {b} 1 -2\nv {b} 1 2\nv {a} 1 2\nf 11 12 13 14\n"
    );
    let shown = shown(&obj, (64, 48));
    let mut kinds = [0; 4];
    for p in 0..64 * 48 {
        let own = shown.of(p);
        let covered: f32 = own.iter().map(|it| it.coverage).sum();
        assert_eq!(covered + shown.sky[p], 1., "{p}");
        kinds[own.len()] += 1;
    }
    assert!(kinds.iter().all(|&count| count > 0), "{kinds:?}");
    let is_rod = |it: &&Fragment| it.point.y < 1.5;
    let rod = shown.all.iter().filter(is_rod);
    let area: f32 = rod.map(|it| it.coverage).sum();
    // Each of 48 pixels of a column tells that to a sixteenth, or less.
    assert!((area / 48. - 0.3).abs() < 1. / 16., "{area}");
}

/// Each sample of a film counts for a fragment, or shows the sky.
#[test]
fn each_sample_counts_for_what_it_meets_first() {
    let place = Scratch::new();
    place.put("a.obj", "v -2 9 -2\nv 3 9 -1\nv 0 9 3\nf 1 2 3\n");
    for method in ["sobol", "gather"] {
        let view =
            format!("a.obj -r0.5 -d16x12 -n64 -f --integrator={method}");
        place.done(&format!("{view} -oa.png -oa.litpt -p0,0,0 -t0,9,0"));
        let path = place.path("a.litpt");
        let mut state = Checkpoint::of_file(&path).unwrap();
        let mut film = state.record.run_key.film();
        state.fill(&mut film).unwrap();
        let halves = film.halves.iter().flatten().flatten();
        let count = |k: usize| halves.clone().map(|half| half[k]).sum();
        let [gathered, corrected]: [i64; 2] = [2, 3].map(count);
        // The triangle covers a part of the image.
        let is_part = |n: i64, all: i64| (all / 20..all / 2).contains(&n);
        assert!(is_part(corrected, 16 * 12 * 64), "{corrected}");
        // A gather has a pilot, whose samples are eight of each pixel.
        let pilot = gathered - corrected;
        match method {
            "gather" => assert!(is_part(pilot, 16 * 12 * 8), "{pilot}"),
            _ => assert_eq!(pilot, 0),
        }
    }
}

/// A glance is there whatever the time and the samples, and far better than
/// what it stands for; numbers remain those that were asked for.
#[test]
fn a_glance_is_there_whatever_the_time() {
    let place = Scratch::new();
    let view = "room.obj -d64x48 -r0.7 -f";
    place.done(&format!("{view} -q -n1024 -s9 -oa.pfm"));
    let truth = place.image("a.pfm").means;
    for limit in ["--time=1e-3", "-n1", "-n3"] {
        let run = place.done(&format!("{view} {limit} -ob.png"));
        assert!(run.stderr.contains(", a glance"), "{}", run.stderr);
        assert!(run.stderr.contains("> picture "), "{}", run.stderr);
        // Nothing but the picture differs where numbers are asked for, too.
        place.done(&format!("{view} -q {limit} -oc.exr"));
        let image = place.image("c.exr");
        let shown =
            image.more.iter().find(|(name, _)| *name == "filtered.Y");
        let (_, shown) = shown.expect("a picture");
        let square = |values: &[f64]| -> f64 {
            let pairs = values.iter().zip(&truth);
            pairs.map(|(a, b)| (a - b).powi(2)).sum()
        };
        if limit == "-n1" {
            place.done(&format!("{view} -q -n1 -od.pfm"));
            let plain = place.image("d.pfm").means;
            assert_eq!(image.means, plain);
            assert!(4. * square(shown) < square(&plain));
        }
        assert!(shown.iter().all(|it| it.is_finite()));
    }
}
