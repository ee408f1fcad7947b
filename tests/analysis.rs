// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What is left out changes no bit of an image; and a shortcut that does not
//! hold is found out.

use crate::prelude::*;

use litpt_book::settings::{Setting, all, named};

const SMALL: (u32, u32) = (48, 36);

/// Whether leaving something out changes the image.
fn is_same(setting: &Setting, resolution: (u32, u32), n: u64) -> bool {
    let whole = setting.render(&SHORTCUTS, resolution, n, 1);
    let less = setting.render(&[], resolution, n, 1);
    assert!(less.rays <= whole.rays, "{}", setting.name);
    less.film.pixels == whole.film.pixels
}

#[test]
fn work_is_left_out_without_a_trace_by_each_shortcut() {
    let mut seen: Vec<String> = vec![];
    for setting in all() {
        let name = setting.name;
        let whole = setting.render(&SHORTCUTS, SMALL, 16, 1);
        for kept in [&SHORTCUTS[..1], &SHORTCUTS[1..], &[]] {
            let less = setting.render(kept, SMALL, 16, 1);
            let is_same = less.film.pixels == whole.film.pixels;
            assert!(is_same, "{name} {kept:?}: {:?}", less.left_out);
            assert!(less.rays <= whole.rays, "{name}");
            seen.extend(less.left_out);
        }
    }
    for shortcut in SHORTCUTS {
        assert!(seen.iter().any(|s| s == shortcut), "{shortcut} nowhere");
    }
}

/// The samples of the reference.
fn plain() -> Sampling {
    Sampling::new(Method::Reference, 1, None, Pixels::of_image((1, 1)))
}

#[test]
fn what_does_not_hold_is_found_out() {
    let room = named("room with a window");
    let lie =
        |f: &mut SceneAnalysis| f.known_pixels = KnownPixels::dark(SMALL);
    let lied = room.render_with(&[], SMALL, 16, &plain(), lie).film;
    let truth = room.render(&SHORTCUTS, SMALL, 16, 1).film;
    assert!(lied.pixels != truth.pixels);
    let check = |found: &mut SceneAnalysis| {
        assert!(found.known_pixels.content((0, 0)) != TileContent::Scene);
    };
    let empty = named("nothing in view");
    assert_eq!(empty.render_with(&[], SMALL, 1, &plain(), check).rays, 0);
}

/// The names of the shortcuts that hold.
fn found(name: &str) -> Vec<String> {
    let mut held = named(name).render(&[], (160, 120), 1, 1).left_out;
    held.retain(|held| SHORTCUTS.contains(&held.as_str()));
    held
}

#[test]
fn each_scene_has_the_shortcuts_that_it_was_made_for() {
    assert_eq!(found("closed room"), ["dark"]);
    assert_eq!(found("nothing in view"), ["background"]);
    for name in ["polytope", "object on a plane", "chest"] {
        assert_eq!(found(name), ["background"], "{name}");
    }
    assert_eq!(found("room with a window"), [""; 0]);
}

/// A camera on each side of each wall of a room in which another stands,
/// below and beside corners and edges too.
#[test]
fn only_inside_of_closed_surfaces_it_is_dark() {
    let points = [
        ([0., 0., 0.], true),
        ([1., 3., 0.], true),
        ([2., 4., 4.999], true),
        ([2., 2., -1.], true),
        ([-4.999, 0., 0.], true),
        ([1., 3., -3.5], true),
        ([0., 0., 5.001], false),
        ([0., 0., -5.001], false),
        ([5., 5., -6.], false),
        ([5., 0., -7.], false),
        ([-6., 5., 5.], false),
    ];
    let left_out = |position, target| {
        let mut setting = named("closed room");
        setting.view = View { position, target, ..setting.view };
        setting.render(&[], (2, 2), 1, 1).left_out
    };
    for (point, inside) in points {
        let position = DVec3::from_array(point);
        let target = position + DVec3::new(0.3, 0.5, 0.1);
        let dark = left_out(position, target).contains(&"dark".to_owned());
        assert_eq!(dark, inside, "at {position}");
    }
    // On a wall nobody is inside.
    assert_eq!(left_out(DVec3::new(5., 0.3, 0.1), DVec3::ZERO), [""; 0]);
}

/// The view of an empty image with another target, up axis and field of
/// view.
fn empty(ahead: DVec3, up: DVec3, fov: f64) -> Setting {
    let mut setting = named("nothing in view");
    let View { position, .. } = setting.view;
    setting.view = View { position, target: position + ahead, up, fov };
    setting
}

/// No ray is traced whatever the horizon does, and the pixels that it cuts
/// have the samples of any other.
#[test]
fn the_horizon_keeps_its_samples() {
    let level = [-0.75, -0.25, 0., 0.25, 0.5, 0.9];
    let level = level.map(|t| (-DVec3::Y - t * DVec3::Z, DVec3::Z, 90.));
    let ahead = DVec3::new(0.3, -1., -0.2);
    let up = DVec3::new(0.6, 0.1, 0.8);
    let rolled = [0.1, 1., 80., 150., 179.9, 179.9999999999];
    let rolled = rolled.map(|fov| (ahead, up, fov));
    for (ahead, up, fov) in level.into_iter().chain(rolled) {
        let setting = empty(ahead, up, fov);
        for resolution in [(1, 1), (5, 3), (50, 70)] {
            assert!(is_same(&setting, resolution, 16), "{fov}");
            let rays = setting.render(&[], resolution, 4, 1).rays;
            assert!(rays == 0 || up != DVec3::Z);
        }
    }
}

/// Above and below the horizon nothing is drawn; at the horizon it is.
#[test]
fn tiles_beside_the_horizon_are_constant() {
    let view = empty(DVec3::new(0.2, -1., 0.1), DVec3::Z, 90.);
    let all = |found: &mut SceneAnalysis| {
        let content =
            |i: u32| found.known_pixels.content((i % 10 * 16, i / 10 * 16));
        let content: Vec<_> = (0..100).map(content).collect();
        let count = |c| content.iter().filter(|&&d| d == c).count();
        let counts = [TileContent::Constant(1.), TileContent::Constant(0.)];
        let [above, below] = counts.map(count);
        assert!(above >= 40 && below >= 30, "{above} {below}");
        assert_eq!(above + below + count(TileContent::Sky), 100);
        assert!(count(TileContent::Sky) >= 10);
    };
    view.render_with(&[], (160, 160), 1, &plain(), all);
}

/// These views go straight down, where all is below the horizon, so that a
/// tile that sees nothing is black; a triangle that is overlooked is not.
#[test]
fn tiles_see_what_is_in_view_in_extreme_fields_of_view() {
    let few = [5e-324, 1e-14, 3e-14, 1e-13, 1e-12, 1e-9, 1e-3, 1., 70.];
    let wide = [170., 179.9999, 180. - 1e-10, 180f64.next_down()];
    let fovs = few.into_iter().chain(wide);
    let mut empty = 0;
    for fov in fovs {
        for resolution in [(1, 1), (48, 32)] {
            let target = DVec3::new(0.2, 0.1, 0.3);
            let position = target + DVec3::Z * 6.;
            let up = DVec3::new(0.3, 0., 1.);
            let view = View { position, target, up, fov };
            let setting = Setting { view, ..named("polytope") };
            assert!(is_same(&setting, resolution, 4), "{fov}");
            let left_out = setting.render(&[], resolution, 1, 1).left_out;
            empty +=
                usize::from(left_out.contains(&"background".to_owned()));
        }
    }
    assert!(empty > 0);
}

// ---- the program

/// The summary, the report and the page tell what was left out; triangles that
/// are not in the scene count, as they are in the file. A run without a bound
/// of its samples would otherwise go on until its time is over.
#[test]
fn a_closed_box_is_dark_without_a_ray_and_without_a_word_too_few() {
    let place =
        Scratch::with("box.obj", format!("{BOX}f 1 2 3\nf 1 1 2\n"));
    let box_by = |words: &str| {
        let all = "-ibox.obj -r0.9 -d8x6 -n4 -oa.pfm -f";
        let said = place.done(&format!("{all} {words}")).stderr;
        (said, place.get("a.pfm"))
    };
    let (said, film) = box_by("--report=a.json --report=a.html");
    let why = "left out  dark: closed around the camera";
    says(&said, &["left out  flat: ", why, " s, 0 rays,"]);
    let json = place.json("a.json");
    let facts = [0, 1, 2].map(|i| json["left_out"][i]["fact"].as_str());
    assert_eq!(facts, ["flat", "copies", "dark"].map(Some));
    assert_eq!(json["scene"]["triangles"], 14);
    assert!(place.text("a.html").contains("<th>left out</th>"));
    let (said, kept) = box_by("--keep-all");
    assert!(!said.contains("dark:"), "{said}");
    assert!(!said.contains(" s, 0 rays,"), "{said}");
    assert_eq!(kept, film);
    let said = place.done("-ibox.obj --time 60 -oa.pgm").stderr;
    assert!(said.contains("2 spp"), "{said}");
}

/// The line that explains one shortcut: whether it is taken and why.
fn explained(place: &Scratch, name: &str, more: &str) -> String {
    let said = place.done(&format!("--explain {more}")).text();
    let mut lines = said.lines().map(str::to_owned);
    lines.find(|line| line.starts_with(name)).expect(name)
}

#[test]
fn an_explanation_says_what_is_left_out_and_why() {
    let place =
        Scratch::with("box.obj", format!("{BOX}f 1 2 3\nf 1 1 2\n"));
    let unseen = "no triangle can be seen";
    for (name, more, sign, why) in [
        ("flat", "", "left out", "1 triangle without area"),
        ("copies", "", "left out", "1 triangle with the corners"),
        ("dark", "", "left out", "closed around the camera"),
        ("dark", "-p0,-6,1", "-", "no closed surface"),
        ("background", "-p0,-6,1 -t0,-9,9", "left out", unseen),
        ("background", "-p0,-1.5,0", "-", "triangles may be seen"),
        ("dark", "--keep-all", "-", "kept, and not looked for"),
    ] {
        let line = explained(&place, name, &format!("-ibox.obj {more}"));
        let words = line.strip_prefix(name).unwrap().trim_start();
        let words = words.strip_prefix(sign).expect(&line).trim_start();
        assert!(words.starts_with(why), "{line}");
    }
    let none = explained(&place, "intersector", "-ibox.obj -oimage.png");
    assert_eq!(none, "intersector  none: no ray");
    place.holds_only(&["box.obj"]);
    // The rays of the tiles that it counts are not traced, but for those of a
    // camera in the midst of the scene, which all are.
    let two = "v 3 9 3\nv 4 9 3\nv 3 9 4\nv -9 -9 -9\nf 1 2 3\n\
               v -8 -9 -9\nv -9 -8 -9\nf 4 5 6\n";
    place.put("two.obj", two);
    let rays = |view: &str| {
        let files = "-n3 -qf -oa.pgm --report=a.json";
        place.done(&format!("{view} {files}"));
        place.json("a.json")["rays"].as_u64().unwrap()
    };
    let view = "-itwo.obj -p0,0,0 -t1,1,0.5 -d96x64 -r0.5";
    let saved = rays(&format!("{view} --keep-all")) - rays(view);
    let line = explained(&place, "background", view);
    let tiles = line.split_whitespace().nth(3).unwrap();
    assert!(line.contains(" of 24 tiles of the image"), "{line}");
    assert_eq!(saved, 3 * 256 * tiles.parse::<u64>().unwrap());
}

/// What is looked for is no part of what a sample is: the first samples of a
/// long run are those of a short one, and runs can be resumed and merged
/// whatever they left out.
#[test]
fn what_is_left_out_decides_nothing_about_a_sample() {
    let place = Scratch::with("box.obj", BOX);
    for words in [
        "-n2 --keep-all --checkpoint=c -oa.pfm",
        "-n9 --resume=c -ob.pfm",
        "-n9 --keep-all -oc.pfm",
        "-n9 --samples=0..4 --keep-all -od.litpt",
        "-n9 --samples=4..9 -oe.litpt",
    ] {
        let view = "-ibox.obj -p0,-6,1 -d40x30 -r0.5 -q";
        place.done(&format!("{view} {words}"));
    }
    place.ptimg("merge -of.pfm d.litpt e.litpt").succeeded();
    assert_eq!(place.get("b.pfm"), place.get("c.pfm"));
    assert_eq!(place.get("f.pfm"), place.get("c.pfm"));
}

// A path in a black scene ends at its first surface.
#[test]
fn black_surfaces_take_one_ray_for_each_path() {
    let setting = Setting { rho: 0., ..named("room with a window") };
    for method in [Method::Reference, Method::Sobol] {
        let pixels = Pixels::of_image(SMALL);
        let sampling = Sampling::new(method, 1, Some(64), pixels);
        let paths = 64 * u64::from(SMALL.0 * SMALL.1);
        let black = setting.render_with(&[], SMALL, 64, &sampling, |_| ());
        assert!(black.rays <= paths, "{method}");
    }
}

// What a hierarchy is worth depends on the rays of this process alone.
#[test]
fn a_part_of_an_image_expects_the_rays_of_that_part() {
    let place = Scratch::with("room.obj", obj(&cavity(0.1, 32)));
    let quality = |options: &str| {
        let scene = "-iroom.obj -r.1 --integrator=reference";
        place.done(&format!("{scene} -f -oa.exr {options}"));
        place.image("a.exr").attributes["hierarchy"].clone()
    };
    let few = quality("-d16x16 -n1");
    assert_ne!(few, quality("-d512x512 -n8"));
    for part in [
        "-d4096x4096 -n1 --crop=64,64,16x16",
        "-d16x16 -n1000000 --samples=5..6",
        "-d16x16384 -n1 --tiles=7/1024",
        "-d4096x4096 -n1000 --samples=9..10 --crop=0,0,16x16",
    ] {
        assert_eq!(quality(part), few, "{part}");
    }
}
