// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What is left out changes no image, or only its variance, and that for
//! the better; and a fact that is false is found out.

mod common;

use std::collections::BTreeMap;

use common::Scratch;
use glam::DVec3;
use litpt::analysis::background::KnownPixels;
use litpt::analysis::{SceneAnalysis, Shortcut};
use litpt::bvh::{Bvh, Hit};
use litpt::camera::{Camera, View};
use litpt::compare::compare;
use litpt::film::Film;
use litpt::image::Image;
use litpt::integrator::{Foresight, PathTracer};
use litpt::render::{Job, Renderer};
use litpt::sampler::IndependentSampler;
use litpt::scene::{Mesh, Scene};
use litpt::sky::Sky;
use litpt_book::settings::{Setting, all, named};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const SMALL: (u32, u32) = (24, 18);

/// The facts that leave each weight as it is.
const EXACT: [Shortcut; 4] =
    [Shortcut::Dark, Shortcut::Hidden, Shortcut::Black, Shortcut::Free];

/// Those that replace weights by their mean.
const CLOSED: [Shortcut; 2] = [Shortcut::Bare, Shortcut::Open];

fn image(film: &Film) -> Image {
    Image::new(film, BTreeMap::new())
}

/// The sum of the variances of all pixels.
fn variance(film: &Film) -> f64 {
    film.stored().iter().map(|pixel| pixel.variance()).sum()
}

#[test]
fn work_that_is_deterministic_is_left_out_without_a_trace() {
    let mut seen: Vec<String> = vec![];
    for setting in all() {
        let whole = setting.render(&Shortcut::ALL, SMALL, 64, 1);
        let less = setting.render(&CLOSED, SMALL, 64, 1);
        assert!(
            less.film.stored() == whole.film.stored(),
            "{}: {:?}",
            setting.name,
            less.analysis
        );
        assert!(less.rays <= whole.rays, "{}", setting.name);
        seen.extend(less.analysis);
    }
    for fact in EXACT {
        assert!(seen.contains(&fact.name()), "{} in no scene", fact.name());
    }
}

#[test]
fn closed_forms_are_the_means_of_what_they_replace() {
    let mut seen: Vec<String> = vec![];
    for setting in all() {
        for fact in CLOSED {
            let others: Vec<_> =
                Shortcut::ALL.into_iter().filter(|f| *f != fact).collect();
            let few = setting.render(&others, SMALL, 1, 1);
            if !few.analysis.contains(&fact.name()) {
                continue;
            }
            let (whole, less) = (truth(&setting), many(&setting, &others));
            if let Err(difference) = agree(&whole, &less) {
                panic!("{}, {}: {difference}", setting.name, fact.name());
            }
            seen.push(fact.name());
        }
    }
    for fact in CLOSED {
        assert!(seen.contains(&fact.name()), "{} in no scene", fact.name());
    }
}

const TINY: (u32, u32) = (4, 3);

const MANY: u64 = 1_000_000;

/// The image with nothing left out.
fn truth(setting: &Setting) -> Film {
    setting.render(&Shortcut::ALL, TINY, MANY, 1).film
}

/// The image with all facts but those that are `kept`.
fn many(setting: &Setting, kept: &[Shortcut]) -> Film {
    setting.render(kept, TINY, MANY, 2).film
}

/// Whether nothing but chance distinguishes two images of 10^6 samples
/// a pixel, and the second has no more variance. Its sum over 12 pixels is
/// known to a part in 1000 as long as weights are not rare; 2 % is far beyond
/// that.
fn agree(whole: &Film, less: &Film) -> Result<(), String> {
    let difference = compare(&image(whole), &image(less))?;
    if !difference.consistent() {
        let z = difference.sum.z();
        return Err(format!("the images differ, z = {z:.1} in all"));
    }
    let (before, after) = (variance(whole), variance(less));
    if after > 1.02 * before {
        return Err(format!("the variance rises: {before} to {after}"));
    }
    Ok(())
}

#[test]
fn a_room_with_a_window_that_is_called_dark_is_found_out() {
    let setting = named("room with a window");
    let lie =
        |analysis: &mut SceneAnalysis| analysis.known = KnownPixels::Dark;
    let much = (MANY, f64::INFINITY);
    let lied = setting.render_with(&[], TINY, much, 2, lie).film;
    assert!(agree(&truth(&setting), &lied).is_err());
}

#[test]
fn triangles_that_are_called_hidden_and_can_be_seen_are_found_out() {
    let setting = named("object on a plane");
    let mut lacks = named("object on a plane");
    lacks.mesh.triangles.truncate(2);
    assert!(agree(&truth(&setting), &many(&lacks, &[])).is_err());
    let whole = setting.render(&Shortcut::ALL, SMALL, 64, 1);
    let less = lacks.render(&CLOSED, SMALL, 64, 1);
    assert!(whole.film.stored() != less.film.stored());
}

/// Believes that all surfaces are open, or that all rays are free.
struct Liar {
    open: bool,
}

impl Foresight for Liar {
    fn is_open(&self, _: &Hit) -> bool {
        self.open
    }

    fn is_free(&self, _: &Hit, direction: DVec3) -> bool {
        !self.open && direction.z > 0.5
    }
}

#[test]
fn surfaces_that_are_called_open_or_their_rays_free_are_found_out() {
    let setting = named("room with a window");
    let truth = truth(&setting);
    for open in [true, false] {
        let scene = Scene::new(&setting.mesh);
        let sky = Sky::new(DVec3::Z);
        let foresight = Liar { open };
        let mut job = Job {
            scene: &scene,
            intersector: &Bvh::new(&scene).unwrap(),
            camera: &Camera::new(&setting.view, 4. / 3.).unwrap(),
            integrator: PathTracer { albedo: 0.8, sky, foresight },
            known: &KnownPixels::Nothing,
            sampler: IndependentSampler::new(2),
        };
        let mut film = Film::new(TINY.0, TINY.1);
        job.pass(&mut film, MANY, &|_| true);
        assert!(agree(&truth, &film).is_err());
    }
}

/// The names of the facts that hold.
fn found(name: &str) -> Vec<String> {
    let mut analysis = named(name).render(&[], SMALL, 1, 1).analysis;
    analysis.retain(|fact| Shortcut::ALL.iter().any(|f| f.name() == *fact));
    analysis
}

#[test]
fn each_scene_has_the_facts_that_it_was_made_for() {
    assert_eq!(found("closed room"), ["dark"]);
    assert_eq!(found("nothing in view"), ["bare"]);
    assert!(found("black courtyard").contains(&"black".to_owned()));
    assert!(found("chest").contains(&"hidden".to_owned()));
    assert!(found("polytope").contains(&"open".to_owned()));
    assert!(found("convex solid").contains(&"free".to_owned()));
    let window = found("room with a window");
    assert!(!window.contains(&"dark".to_owned()));
}

#[test]
fn every_path_outside_a_polytope_ends_at_its_first_surface() {
    let outcome = named("polytope").render(&[], SMALL, 100, 1);
    let paths = u64::from(SMALL.0 * SMALL.1) * 100;
    assert!(outcome.rays <= paths);
    let whole = named("polytope").render(&Shortcut::ALL, SMALL, 100, 1);
    assert!(outcome.rays < whole.rays);
}

/// A camera on each side of each wall of a room in which another stands,
/// below and beside corners and edges too.
#[test]
fn only_inside_of_closed_surfaces_it_is_dark() {
    let setting = named("closed room");
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
    for (point, inside) in points {
        let position = DVec3::from_array(point);
        let target = position + DVec3::new(0.3, 0.5, 0.1);
        let view = View { position, target, ..setting.view };
        let setting = Setting { view, ..named("closed room") };
        let analysis = setting.render(&[], (2, 2), 1, 1).analysis;
        let dark = analysis.contains(&"dark".to_owned());
        assert_eq!(dark, inside, "at {position}");
    }
}

#[test]
fn on_a_wall_nobody_is_inside() {
    let position = DVec3::new(5., 0.3, 0.1);
    let target = DVec3::ZERO;
    let view = View { position, target, ..named("closed room").view };
    let setting = Setting { view, ..named("closed room") };
    assert_eq!(setting.render(&[], (2, 2), 1, 1).analysis, [""; 0]);
}

#[test]
fn a_pixel_across_the_horizon_has_the_share_of_its_area() {
    let setting = named("nothing in view");
    let film = setting.render(&[], (1, 1), 2, 1).film;
    let pixel = film.pixel(0, 0);
    assert!((pixel.mean() - 0.5).abs() < 1e-12);
    assert_eq!(pixel.variance(), 0.);
}

/// A camera of 90 degrees sees from -1 to 1 beside and above its axis. Bowed
/// by an angle of tangent t, it has the horizon at t above the middle, and so
/// (1 - t) / 2 of the image above that.
#[test]
fn the_share_of_a_bowed_view_is_what_geometry_says() {
    for t in [-0.75, -0.25, 0., 0.25, 0.5, 0.9] {
        let mut setting = named("nothing in view");
        let View { position, up, .. } = setting.view;
        let target = position - DVec3::Y - t * up;
        setting.view = View { position, target, up, fov: 90. };
        let film = setting.render(&[], (1, 1), 2, 1).film;
        let exact = 0.5 - 0.5 * t;
        assert!((film.pixel(0, 0).mean() - exact).abs() < 1e-12, "{t}");
    }
}

/// Five standard errors: once in two million times by chance.
#[test]
fn the_share_of_a_rolled_view_is_the_mean_of_its_paths() {
    let mut setting = named("nothing in view");
    let View { position, .. } = setting.view;
    let target = position + DVec3::new(0.3, -1., -0.2);
    let up = DVec3::new(0.6, 0.1, 0.8);
    setting.view = View { position, target, up, fov: 80. };
    let known = setting.render(&[], (3, 2), 2, 1).film;
    let sampled = setting.render(&Shortcut::ALL, (3, 2), 40_000, 1).film;
    let mut cut = 0;
    for (share, paths) in known.stored().iter().zip(sampled.stored()) {
        let off = (share.mean() - paths.mean()).abs();
        assert!(off <= 5. * paths.standard_error() + 1e-12, "{off}");
        cut += usize::from(0.05 < share.mean() && share.mean() < 0.95);
    }
    assert!(cut >= 3, "the horizon cuts {cut} pixels");
}

/// These views go straight down, where all is below the horizon, so that a
/// tile that sees nothing is black; a triangle that is overlooked is not.
#[test]
fn tiles_see_what_is_in_view_in_extreme_fields_of_view() {
    let fovs = [
        5e-324,
        1e-14,
        3e-14,
        1e-13,
        1e-12,
        1e-9,
        1e-3,
        1.,
        70.,
        170.,
        179.9999,
        179.9999999999,
        179.99999999999997,
    ];
    let mut bare = 0;
    for fov in fovs {
        for resolution in [(1, 1), (48, 32)] {
            let target = DVec3::new(0.2, 0.1, 0.3);
            let position = target + DVec3::Z * 6.;
            let up = DVec3::new(0.3, 0., 1.);
            let view = View { position, target, up, fov };
            let setting = Setting { view, ..named("polytope") };
            let kept = [Shortcut::Open, Shortcut::Free];
            let less = setting.render(&kept, resolution, 4, 1);
            let whole = setting.render(&Shortcut::ALL, resolution, 4, 1);
            assert!(less.film.stored() == whole.film.stored(), "{fov}");
            bare += usize::from(less.analysis.contains(&"bare".to_owned()));
        }
    }
    assert!(bare > 0);
}

/// Clusters of a few triangles much smaller than the scene, which two others
/// far away make as large as they are: slivers, tents, triangles that stand on
/// each other. Where the free rays of one were taken for more than they are,
/// the images had other means.
#[test]
fn tiny_triangles_in_a_large_scene_lose_no_light() {
    let mut free = 0;
    for seed in 0..300 {
        let (mesh, view) = cluster(seed);
        let setting = Setting { name: "cluster", mesh, view, rho: 0.9 };
        let whole = setting.render(&Shortcut::ALL, (4, 3), 200, 1);
        let less = setting.render(&CLOSED, (4, 3), 200, 1);
        assert!(less.film.stored() == whole.film.stored(), "{seed}");
        free += usize::from(less.analysis.contains(&"free".to_owned()));
    }
    assert!(free > 0);
}

fn cluster(seed: u64) -> (Mesh, View) {
    let mut random = Pcg64::seed_from_u64(seed);
    let scale = 10f64.powf(-9. + 6. * random.random::<f64>());
    let stretch = [1., 1., 10., 0.1, 1e3, 1e-2];
    let mut any = |n: usize| (random.random::<f64>() * n as f64) as usize;
    let axes = DVec3::from_array([0; 3].map(|_| stretch[any(6)]));
    let (count, faces) = (4 + any(6), 2 + any(7));
    let picks: Vec<_> = (0..faces)
        .map(|_| {
            let first = any(count);
            let second = (first + 1 + any(count - 1)) % count;
            let mut third = any(count);
            while third == first || third == second {
                third = (third + 1) % count;
            }
            [first, second, third].map(|i| i as u32 + 6)
        })
        .collect();
    let mut coordinate = || match any(2) {
        0 => any(1 << 20) as f64 / 524_288. - 1.,
        _ => any(5) as f64 / 2. - 1.,
    };
    let mut point = || DVec3::new(coordinate(), coordinate(), coordinate());
    let far = |s: f64, x: f64, y: f64, z: f64| {
        s * DVec3::new(4096. - x, 4096. - y, z)
    };
    let mut vertices = vec![
        far(-1., 0., 0., 2.),
        far(-1., 0., 1., 2.),
        far(-1., 1., 0., -2.),
        far(1., 0., 0., -2.),
        far(1., 0., 1., -2.),
        far(1., 1., 0., 2.),
    ];
    vertices.extend((0..count).map(|_| point() * axes * scale));
    let target = vertices[6];
    let away = point() + DVec3::new(0.1, 0.2, 0.7);
    let position = target + away * scale * axes.max_element().min(10.);
    let mut triangles = vec![[0, 1, 2], [3, 4, 5]];
    triangles.extend(picks);
    let up = DVec3::new(0., 0.01, 1.);
    let view = View { position, target, up, fov: 40. };
    (Mesh { vertices, triangles }, view)
}

/// Ten chests in each other hide all but the outermost.
#[test]
fn chests_in_chests_are_hidden_by_the_outermost() {
    let mut setting = named("closed room");
    let cube = setting.mesh.vertices.split_off(8);
    drop(cube);
    setting.mesh.triangles.truncate(12);
    let (vertices, triangles) =
        (setting.mesh.vertices.clone(), setting.mesh.triangles.clone());
    for k in 1..10 {
        let shrink = 1. - 0.1 * f64::from(k);
        let first = setting.mesh.vertices.len() as u32;
        setting.mesh.vertices.extend(vertices.iter().map(|v| v * shrink));
        let moved = triangles.iter().map(|t| t.map(|i| i + first));
        setting.mesh.triangles.extend(moved);
    }
    setting.view.position = DVec3::new(3., -14., 2.);
    let outcome = setting.render(&CLOSED, SMALL, 16, 1);
    assert!(outcome.analysis.contains(&"hidden".to_owned()));
    let whole = setting.render(&Shortcut::ALL, SMALL, 16, 1);
    assert!(outcome.film.stored() == whole.film.stored());
}

/// A closed square ring, which has the points with |z| < 1 of which the
/// greater of |x| and |y| is between 3 and 5.
fn ring() -> Mesh {
    let around = [(1., 1.), (-1., 1.), (-1., -1.), (1., -1.)];
    let section = [(3., -1.), (5., -1.), (5., 1.), (3., 1.)];
    let vertices = around.iter().flat_map(|(x, y)| {
        section.map(|(r, z)| DVec3::new(r * x, r * y, z))
    });
    let wall = |k: u32| {
        let (i, j) = (k / 4, k % 4);
        let at = |i: u32, j: u32| 4 * (i % 4) + j % 4;
        let (a, b) = (at(i, j), at(i, j + 1));
        let (c, d) = (at(i + 1, j), at(i + 1, j + 1));
        [[a, b, c], [b, d, c]]
    };
    let triangles = (0..16).flat_map(wall).collect();
    Mesh { vertices: vertices.collect(), triangles }
}

/// Whether an octahedron around this point is hidden by the ring. Its
/// corners are so far from its middle; the first is that towards +x.
fn is_hidden_by_the_ring(middle: DVec3, size: f64) -> bool {
    let (mut mesh, part) = (ring(), named("polytope").mesh);
    let moved = part.vertices.iter().map(|v| *v * size + middle);
    mesh.vertices.extend(moved);
    let added = part.triangles.iter().map(|t| t.map(|i| i + 16));
    mesh.triangles.extend(added);
    let setting = Setting { mesh, ..named("chest") };
    let outcome = setting.render(&CLOSED, SMALL, 16, 1);
    let whole = setting.render(&Shortcut::ALL, SMALL, 16, 1);
    assert!(outcome.film.stored() == whole.film.stored());
    outcome.analysis.contains(&"hidden".to_owned())
}

#[test]
fn a_part_within_a_ring_is_hidden_and_one_in_its_hole_is_not() {
    assert!(is_hidden_by_the_ring(DVec3::new(4., 0., 0.), 0.5));
    assert!(!is_hidden_by_the_ring(DVec3::ZERO, 0.5));
}

/// The first corner is inside, and the box of the part in that of the ring.
#[test]
fn a_part_that_pierces_a_closed_wall_is_not_hidden() {
    let middle = DVec3::new(3.2, 0., 0.);
    assert!(is_hidden_by_the_ring(middle + 0.8 * DVec3::X, 0.9));
    assert!(!is_hidden_by_the_ring(middle, 0.9));
}

// ---- the program

/// A closed box around the default camera.
const BOX: &str = "\
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\n\
v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n\
f 1 2 3 4\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// The summary and the image of a run in the box.
fn in_the_box(arguments: &[&str]) -> (String, Vec<u8>) {
    let place = Scratch::new();
    place.put("box.obj", BOX);
    let all = ["-ibox.obj", "-r0.9", "-d8x6", "-n4", "--format=pfm"];
    let run = place.run(&[&all[..], arguments].concat());
    run.succeeded();
    (run.stderr, run.stdout)
}

#[test]
fn a_closed_box_is_dark_without_a_ray_and_the_summary_says_why() {
    let (said, film) = in_the_box(&[]);
    assert!(said.contains("left out: closed around the camera"), "{said}");
    assert!(said.contains("\n> 0 rays,"), "{said}");
    for keep in [&["--keep-all"][..], &["--keep", "dark"]] {
        let (said, kept) = in_the_box(keep);
        assert!(!said.contains("(dark)"), "{said}");
        assert!(!said.contains("\n> 0 rays,"), "{said}");
        assert_eq!(kept, film);
    }
}

#[test]
fn an_explanation_names_what_was_too_expensive_to_look_for() {
    let place = Scratch::new();
    place.put("box.obj", BOX);
    for (albedo, analysis) in [
        ("-r0.5", &["dark", "hidden", "bare", "open", "free"][..]),
        ("-r0", &["dark", "hidden", "bare"]),
    ] {
        let tiny = ["-ibox.obj", "--explain", "-d1x1", albedo];
        let run = place.run(&tiny);
        run.succeeded();
        let said = String::from_utf8(run.stdout).unwrap();
        let left = said.lines().filter(|l| l.contains("take too long"));
        let left = left.map(|l| l.split(' ').next().unwrap());
        assert_eq!(left.collect::<Vec<_>>(), analysis, "{said}");
    }
}

#[test]
fn an_explanation_renders_nothing() {
    let place = Scratch::new();
    place.put("box.obj", BOX);
    let run = place.run(&["-ibox.obj", "--explain", "-o", "image.png"]);
    run.succeeded();
    let said = String::from_utf8(run.stdout).unwrap();
    assert!(said.contains("dark"), "{said}");
    assert!(said.contains("intersector none: no ray"), "{said}");
    place.holds_only(&["box.obj"]);
}

#[test]
fn a_report_tells_what_was_left_out() {
    let place = Scratch::new();
    place.put("box.obj", BOX);
    let files = ["--report=a.json", "--report=a.html", "-oa.pgm", "-q"];
    place.run(&[&["-ibox.obj"], &files[..]].concat()).succeeded();
    let json: serde_json::Value =
        serde_json::from_slice(&place.get("a.json")).unwrap();
    assert_eq!(json["left_out"][0]["fact"], "dark");
    let html = String::from_utf8(place.get("a.html")).unwrap();
    assert!(html.contains("Left out"));
}

/// Two names are not a size, such as 320x240.
#[test]
fn a_picture_names_the_facts_that_matter_to_its_weights() {
    let place = Scratch::new();
    let ground =
        "v -99 -99 0\nv 99 -99 0\nv 99 99 0\nv -99 99 0\nf 1 2 3 4\n";
    let below = BOX.lines().map(|line| {
        let mut words = line.split(' ');
        let sign = words.next().unwrap();
        let words: Vec<f64> = words.map(|w| w.parse().unwrap()).collect();
        match (sign, &words[..]) {
            ("v", [x, y, z]) => format!("v {x} {y} {}\n", z - 8.),
            (_, corners) => {
                let named = corners.iter().map(|c| format!(" {}", c + 4.));
                format!("f{}\n", named.collect::<String>())
            }
        }
    });
    let inside = "v -.3 0 -8\nv .3 0 -8\nv 0 .3 -8\nf -3 -2 -1\n";
    let text = format!("{ground}{}{inside}", below.collect::<String>());
    place.put("chest.obj", &text);
    let view = ["-ichest.obj", "-p0,0,2", "-t0,0,0", "-u0,1,0"];
    let more =
        ["-d8x6", "-r0.5", "-n5000", "-q", "-oa.exr", "--report=a.json"];
    place.run(&[&view[..], &more].concat()).succeeded();
    let image = Image::read(&place.path("a.exr")).unwrap();
    assert_eq!(image.attributes["left_out"], "hidden,open");
    // The report counts what the file has, hidden or not.
    let json: serde_json::Value =
        serde_json::from_slice(&place.get("a.json")).unwrap();
    assert_eq!(json["scene"]["triangles"], 2 + 12 + 1);
}

/// A run without a bound of its samples would otherwise go on until
/// its time is over.
#[test]
fn an_image_that_is_known_takes_no_time() {
    let (said, _) = {
        let place = Scratch::new();
        place.put("box.obj", BOX);
        let run = place.run(&["-ibox.obj", "--time", "60", "-oa.pgm"]);
        run.succeeded();
        (run.stderr, ())
    };
    assert!(said.contains("2 spp"), "{said}");
}

/// Whether closed forms are used is decided by the limits of the first run;
/// the second, which could afford more, goes on as the first did.
#[test]
fn a_run_that_is_resumed_leaves_out_what_it_left_out_before() {
    let place = Scratch::new();
    let view = ["-isquare.obj", "-p0,0,2", "-t0,0,0", "-u0,0.1,1"];
    let all = [&view[..], &["-d4x3", "-r0.5", "-F40"]].concat();
    let few = ["-n2", "--checkpoint=c", "-oa.pfm"];
    let first = place.run(&[&all[..], &few].concat());
    first.succeeded();
    assert!(!first.stderr.contains("(open)"), "{}", first.stderr);
    let more = ["-n5000", "--resume=c", "-ob.pfm"];
    let second = place.run(&[&all[..], &more].concat());
    second.succeeded();
    assert!(!second.stderr.contains("(open)"), "{}", second.stderr);
    let alone = place.run(&[&all[..], &["-n5000", "-oc.pfm"]].concat());
    assert!(alone.stderr.contains("(open)"), "{}", alone.stderr);
    let enough = ["-n4000", "--checkpoint=d", "-od.pfm"];
    place.run(&[&all[..], &enough].concat()).succeeded();
    let on = ["-n4002", "--resume=d", "-oe.pfm"];
    let on = place.run(&[&all[..], &on].concat());
    assert!(on.stderr.contains("(open)"), "{}", on.stderr);
}
