// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The pilot and the choice (chapter "Choosing a method").

use crate::prelude::*;

const SIZE: (u32, u32) = (48, 32);

/// A box with a hole in its roof, seen from within.
pub const BOX: &str = "\
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\n\
v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n\
v -.2 -1 1\nv .2 -1 1\nv .2 1 1\nv -.2 1 1\n\
f 1 2 3 4\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n\
f 5 9 12 8\nf 10 6 7 11\n";

/// The view of the box.
const VIEW: &str = "box.obj -p-.9,-.8,0 -t1,1,-.3 -r0.8 -d64x48";

/// A run of any method without a limit.
const ANY: Request = Request {
    method: None,
    seed: 7,
    window: Window { corner: (0, 0), size: SIZE },
    budget: OPEN,
    left: None,
    shows: false,
};

/// No limit.
const OPEN: Budget = Budget { samples: None, time: None, error: None };

/// What is chosen for a scene of this albedo, seen from one point towards
/// another.
fn chosen(
    mesh: &Mesh,
    albedo: f64,
    view: (DVec3, DVec3),
    request: Request,
) -> Option<Choice> {
    let setting = seen(mesh, albedo, view);
    let (intersector, view) =
        (setting.job(0).intersector, setting.view(SIZE));
    let none = &Default::default();
    let analysis = &SceneAnalysis::find(none, intersector, &view, &[]);
    let columns = None;
    Setup { intersector, view, analysis, columns }.choose(&request)
}

fn seen(mesh: &Mesh, albedo: f64, view: (DVec3, DVec3)) -> Setting {
    let view = look(view.0, view.1, 70.);
    Setting::new(mesh, (albedo, DVec3::Z), &view, 1.5).unwrap()
}

const INSIDE: (DVec3, DVec3) = (DVec3::ZERO, DVec3::new(0.3, 0.2, -1.));

/// The pilot sees the variance and the rays that a render has. In a spherical
/// cavity a direction leads to the sky with the probability `f`, and all that
/// comes after another has the distribution of the whole, times the albedo.
#[test]
fn a_pilot_agrees_with_a_render() {
    let (f, albedo, n) = (0.3, 0.8, 2000);
    let mesh = cavity(f, 64);
    let request = Request { budget: Budget::samples(n), ..ANY };
    let pilot = chosen(&mesh, albedo, INSIDE, request).unwrap().pilot;
    let setting = seen(&mesh, albedo, INSIDE);
    let mut film = Film::new(SIZE.0, SIZE.1);
    let rays = setting.job(3).pass(&mut film, n, &|_| true);
    let area = film.area() as f64;
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / area;
    let variance = mean(film.rows().map(|p| p.variance()).collect());
    let square = mean(film.means().map(|m| m * m).collect());
    let rays = rays as f64 / area / n as f64;
    // Half of a squared difference is at most 0.32, and its mean 0.051: of
    // 4096 pixels, the mean is off by 0.01 with a probability below 2e-5,
    // and that of products by 0.04 with one below 1e-6 (Bernstein).
    let whole = pilot.first + pilot.later;
    assert!((whole - variance).abs() < 0.01, "{whole} of {variance}");
    let later = (1. - f) * albedo * albedo * variance;
    let found = pilot.later;
    assert!((found - later).abs() < 0.01, "{found} of {later}");
    assert!((pilot.square - square).abs() < 0.04, "{}", pilot.square);
    assert!((variance - 0.0506).abs() < 0.002, "{variance}");
    // The number of rays is geometric, with a deviation of 2.8.
    assert!((pilot.rays - rays).abs() < 5. * 2.8 / 64., "{}", pilot.rays);
}

/// A gather has to learn before its first sample, and is not chosen if there
/// is no time for that, even if it is wanted.
#[test]
fn what_there_is_no_time_for_is_not_chosen() {
    let mesh = cavity(0.1, 64);
    let best = |left, method| {
        let request =
            Request { method, budget: Budget::samples(4096), left, ..ANY };
        let choice = chosen(&mesh, 0.9, INSIDE, request);
        choice.unwrap().sampling.method
    };
    assert_eq!(best(None, None), Method::Gather);
    for wanted in [None, Some(Method::Gather), Some(Method::Sobol)] {
        let (much, little) = (Some(1e6), Some(1e-6));
        assert_eq!(best(much, wanted), best(None, wanted));
        assert_eq!(best(little, wanted), Method::Reference);
    }
}

/// Before an open sky no decision comes after the first direction.
#[test]
fn the_parts_of_the_variance_are_told_apart() {
    let mut mesh = Mesh::default();
    let far = 1e3;
    // A slope that sees a part of the sky, and what is below the horizon.
    mesh.vertices = [[-1., -1.], [1., -1.], [1., 1.], [-1., 1.]]
        .map(|[x, y]| DVec3::new(x, y, x) * far)
        .to_vec();
    mesh.triangles = vec![[0, 1, 2], [0, 2, 3]];
    let view = (DVec3::new(-1., 0., 1.), DVec3::ZERO);
    let asked = |request| chosen(&mesh, 0.5, view, request).unwrap();
    let of = |n| asked(Request { budget: Budget::samples(n), ..ANY });
    let choice = of(64);
    let pilot = choice.pilot;
    assert_eq!(pilot.later, 0.);
    let rays = (pilot.rays, pilot.first_rays, pilot.indirect);
    assert_eq!(rays, (2., 2., 0.));
    assert!(pilot.first > 0.02);
    assert_eq!(choice.sampling.method, Method::Sobol);
    assert_eq!(choice.sampling.net_size, 16);
    assert_eq!(choice.sampling.control, 100);
    assert_eq!(of(9).sampling.net_size, 2);
    // An error that 256 samples of the reference have takes fewer by nets;
    // those of 256 would have scrambles of 64.
    let error = Some(((pilot.first / 256.).sqrt(), ErrorNorm::default()));
    let bounded =
        asked(Request { budget: Budget { error, ..OPEN }, ..ANY }).sampling;
    assert_eq!(bounded.method, Method::Sobol);
    assert!(bounded.net_size < 32, "{}", bounded.net_size);
}

#[test]
fn few_paths_have_no_pilot_and_a_bound_of_the_error_is_a_number() {
    let mesh = cavity(0.05, 32);
    let choice = |samples, error| {
        let budget = Budget { samples, error, ..OPEN };
        chosen(&mesh, 0.9, INSIDE, Request { budget, ..ANY })
    };
    assert!(choice(Some(8), None).is_none());
    assert!(choice(Some(9), None).is_some());
    let many = choice(Some(256), None).unwrap();
    assert_eq!(many.sampling.method, Method::Gather);
    assert_eq!(many.sampling.net_size, 4);
    let bounded = |samples, error| {
        choice(samples, Some((error, ErrorNorm::default()))).unwrap()
    };
    assert_eq!(bounded(None, 1e-4).sampling.net_size, 4);
    assert_eq!(bounded(None, 0.2).sampling.net_size, 1);
    assert_eq!(bounded(Some(16), 1e-4).sampling.net_size, 1);
}

fn report(place: &Scratch, options: &str) -> Value {
    place.put("box.obj", BOX);
    let files = "-q -f -oa.exr --report=r.json";
    place.done(&format!("{VIEW} {files} {options}"));
    place.json("r.json")
}

/// The choice is the same for each seed, number of threads and set of
/// instructions, and a run with it has the bytes of one that names it.
#[test]
fn a_choice_depends_on_the_scene_and_the_samples_alone() {
    let place = Scratch::new();
    let options = ["-s1 -j1", "-s2 -j2", "-s3 --isa=portable"];
    let chosen = options.map(|options| {
        let report = report(&place, &format!("{options} -n64"));
        assert_eq!(report["settings"]["integrator"], "gather");
        report["settings"]["choice"].clone()
    });
    assert!(chosen[0] == chosen[1] && chosen[0] == chosen[2]);
    let image = |options: &str| {
        let format = "--format=pfm -o- -qf -n64";
        place.line(&format!("{VIEW} {format} {options}")).stdout
    };
    let own = image("");
    assert!(own.len() > 64 * 48 * 4);
    assert!(own == image("--integrator=auto"));
    assert!(own == image("--integrator=gather"));
    assert!(own != image("--integrator=reference"));
}

#[test]
fn an_explanation_says_which_method_and_why() {
    let place = Scratch::with("box.obj", BOX);
    let seen = |view: &str, n: &str| {
        let text = place.done(&format!("{view} --explain {n}")).text();
        let line = text.lines().find(|line| line.starts_with("method"));
        line.unwrap().to_owned()
    };
    let explained = |n: &str| seen(VIEW, n);
    let many = explained("-n64");
    assert!(many.starts_with("method       gather: a path has"), "{many}");
    assert!(many.contains("% of its variance comes after"), "{many}");
    assert!(many.contains("reference 1.0, sobol"), "{many}");
    assert_eq!(explained("-n1"), "method       reference");
    // A single pixel shares its corrections with none.
    let one = seen(&VIEW.replace("64x48", "1x1"), "-n65536");
    assert!(one.starts_with("method       sobol: a path has"), "{one}");
    // A gather by name has a pilot only if an error is to be planned for.
    let named = explained("--integrator=gather -n64");
    assert_eq!(named, "method       gather");
    let planned = explained("--integrator=gather --error=0.01");
    let method = "method       gather: a path";
    assert!(planned.starts_with(method), "{planned}");
    let summary = place.line(&format!("{VIEW} -n64")).stderr;
    assert!(summary.contains("method    gather: a path has"));
    // No error is known of one sample: a better method makes two of them too.
    let coarse = seen(&VIEW.replace("64x48", "320x240"), "--error=0.5");
    assert!(coarse.starts_with("method       reference: a"), "{coarse}");
}

/// A room is dark, so that few samples have a small error and the hierarchy
/// is built for them; seen from outside, a sample says less.
#[test]
fn a_hierarchy_is_built_for_the_samples_of_an_error() {
    let place = Scratch::new();
    let quality = |options: &str| {
        let report = report(&place, &format!("-d32x24 {options}"));
        let quality = report["settings"]["hierarchy"].as_str().unwrap();
        let (_, number) = quality.rsplit_once(' ').expect(quality);
        number.parse::<f64>().expect(quality)
    };
    let one = quality("-n1");
    assert!((quality("-n2") - 2. * one).abs() < 0.02);
    assert_eq!(quality("-n64 --error=0.01"), one);
    let more = quality("-n64 --error=0.005");
    assert!((one..2. * one).contains(&more) && more > one, "{more}");
    let outside =
        |options: &str| quality(&format!("-p0,-5,0 -t0,0,0 {options}"));
    let one_outside = outside("-n1");
    assert!(one_outside < one);
    assert_eq!(outside("-n64 --error=0.5"), one_outside);
    assert!(outside("-n64 --error=0.1") > outside("-n4"));
}
