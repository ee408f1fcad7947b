// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Single samples, traced step by step (chapter "The render").

use crate::prelude::*;

use litpt::render::trace::{Ending, SampleTrace};

const SIZE: (u32, u32) = (9, 7);

/// Samples of each pixel.
const SAMPLES: u64 = 64;

/// Calls `test` with the samples of each pixel of a cavity, traced one by one,
/// and with the values that a film holds of it.
fn compare(
    albedo: f64,
    method: Method,
    mut test: impl FnMut(&[SampleTrace], &Accumulator, u64),
) {
    let view = look(DVec3::ZERO, DVec3::new(0.3, 0.2, 1.), 100.);
    let mesh = cavity(0.1, 40);
    let aspect = f64::from(SIZE.0) / f64::from(SIZE.1);
    let setting =
        Setting::new(&mesh, (albedo, DVec3::Z), &view, aspect).unwrap();
    let intersector = setting.job(0).intersector;
    let view = setting.view(SIZE);
    let none = &Default::default();
    let analysis = &SceneAnalysis::find(none, intersector, &view, &[]);
    let setup = Setup { intersector, view, analysis, columns: None };
    let pixels = Pixels::of_image(SIZE);
    let mut sampling = Sampling::new(method, 5, Some(SAMPLES), pixels);
    sampling.control = 30;
    // Render with what is learnt
    let learnt: Arc<OnceLock<Learnt>> = Arc::default();
    let mut renderer =
        setup.renderer(&sampling, learnt.clone(), &SingleProcess);
    let mut film = sampling.film(Film::new(SIZE.0, SIZE.1));
    renderer.pass(&mut film, SAMPLES, &|_| true);
    for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)))
    {
        let trace = |n| setup.trace_sample(&sampling, &learnt, (x, y), n);
        let first = trace(0).unwrap();
        // A pixel of a gather has samples of its own number in a scramble.
        let each = first
            .scramble
            .map_or(sampling.net_size, |whole| u64::from(whole.count));
        let all = each * film.pixel(x, y).count();
        let traces: Vec<_> = (0..all).map(|n| trace(n).unwrap()).collect();
        test(&traces, film.pixel(x, y), each);
    }
}

/// Of the reference and in nets, the values of the traced samples are those
/// of the film, bit by bit.
#[test]
fn a_film_holds_the_samples_that_are_traced_one_by_one() {
    for (albedo, expected) in [
        (0., &[Ending::Black][..]),
        (0.5, &[Ending::Sky, Ending::Roulette]),
        (1., &[Ending::Sky]),
    ] {
        for method in [Method::Reference, Method::Sobol] {
            let (mut endings, mut controls) = (vec![], 0);
            compare(albedo, method, |traces, pixel, net_size| {
                let mut sum = Accumulator::default();
                for net in traces.chunks(net_size as usize) {
                    let mut mean = Accumulator::default();
                    net.iter().for_each(|trace| mean.add(trace.value));
                    sum.add(mean.mean());
                }
                assert_eq!(sum, *pixel, "{method} {albedo}");
                endings.extend(traces.iter().map(|trace| trace.ending));
                // Without the control variate no light is negative.
                let path =
                    |trace: &SampleTrace| trace.value - trace.control;
                assert!(traces.iter().all(|it| path(it) > -1e-12));
                controls +=
                    traces.iter().filter(|it| it.control != 0.).count();
            });
            let has_control = method == Method::Sobol && albedo > 0.;
            assert_eq!(controls > 0, has_control, "{method} {albedo}");
            for ending in expected {
                assert!(endings.contains(ending), "{method} {ending:?}");
            }
        }
    }
}

/// The steps of a path lead from surface to surface, and weaken it.
#[test]
fn the_steps_of_a_path_are_those_of_the_light() {
    compare(0.5, Method::Reference, |traces, _, _| {
        for trace in traces {
            let mut before = 1.;
            for vertex in &trace.vertices {
                assert_eq!(vertex.albedo, 0.5);
                let both = [0.5 * before, before];
                assert!(both.contains(&vertex.throughput));
                before = vertex.throughput;
            }
            for pair in trace.vertices.windows(2) {
                let [from, to] = [pair[0].hit, pair[1].hit];
                let way = to.point - from.point;
                assert!(way.dot(from.normal) > 0.);
                assert!(way.dot(to.normal) < 0.);
            }
            let is_light = trace.ending == Ending::Sky && trace.value != 0.;
            assert!(!is_light || trace.value == before);
        }
    });
}

/// The film of a gather holds the means of scrambles, with their corrections;
/// the samples of a scramble have the rest of it.
#[test]
fn the_samples_of_a_gather_are_traced_in_their_scrambles() {
    let mut cells = 0;
    compare(0.8, Method::Gather, |traces, pixel, count| {
        let mut sum = Accumulator::default();
        for (number, of) in (0..).zip(traces.chunks(count as usize)) {
            let whole = of[0].scramble.unwrap();
            assert_eq!((whole.number, whole.count), (number, count as u32));
            sum.add(whole.value);
            let values: f64 = of.iter().map(|trace| trace.value).sum();
            let rest = whole.value - whole.correction;
            assert!((values / count as f64 - rest).abs() < 1e-12);
            let is_cell = |trace: &&SampleTrace| {
                matches!(trace.ending, Ending::Cell { .. })
            };
            cells += of.iter().filter(is_cell).count();
        }
        assert_eq!(sum, *pixel);
    });
    assert!(cells > 1000, "{cells}");
}

/// The text of a traced sample names the face and the point of the file.
#[test]
fn the_text_of_a_sample_is_in_the_coordinates_of_the_file() {
    let text = "v 9 9 -3\nv 12 9 -3\nv 9 12 -3\nf 1 2 3\n";
    let from = DVec3::new(10., 10., 7.);
    let stand = Stand::At(from, from - DVec3::Z);
    let (resolution, fov) = ((1, 1), 1.);
    let camera =
        CameraPlan { resolution, stand, fov, ..CameraPlan::default() };
    let sensor = SensorPlan::Camera(camera);
    let mut plan = Plan { sensor, ..Plan::default() };
    (plan.up, plan.sky.zenith) = (Some(DVec3::Y), Some(DVec3::Z));
    plan.surfaces.albedo = 0.8;
    plan.budget = Budget::samples(4);
    let mesh = read_obj(text.as_bytes()).unwrap();
    let world = World::new(&plan, mesh.into(), Host::default()).unwrap();
    let run = litpt::run::Run::new(&world, &plan, Host::default());
    let text = run.unwrap().trace_sample((0, 0), 3).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert!(lines[0].starts_with("ray        "), "{text}");
    let point = lines[1].strip_prefix("surface    face 1 at ").unwrap();
    let point = point.split(',').map_while(|x| x.parse().ok());
    let point = DVec3::from_slice(&point.collect::<Vec<_>>());
    assert!(point.distance(DVec3::new(10., 10., -3.)) < 0.2, "{text}");
    let end = ", normal 0,0,1, albedo 0.8, throughput 0.8";
    assert!(lines[1].ends_with(end), "{text}");
    let end = "end        the sky, or what is below it";
    assert_eq!(lines[2..], [end, "value      0.8"]);
}

/// A sample is one that the run has: of its pixels, and of its samples in
/// whole nets.
#[test]
fn a_sample_that_the_run_does_not_have_is_refused() {
    let mesh = cavity(0.1, 8);
    let camera = CameraPlan { resolution: SIZE, ..CameraPlan::default() };
    for method in [Method::Reference, Method::Sobol] {
        let plan = Plan {
            sensor: SensorPlan::Camera(camera),
            budget: Budget::samples(33),
            method: Some(method),
            ..Plan::default()
        };
        let host = Host::default();
        let inputs = Inputs::from(mesh.clone());
        let world = World::new(&plan, inputs, host).unwrap();
        let mut run = litpt::run::Run::new(&world, &plan, host).unwrap();
        let net = run.key.sampling.net_size;
        let mut trace = |pixel, n| {
            let text = run.trace_sample(pixel, n);
            text.map_err(|error| error.to_string())
        };
        let none = "the run has no such sample";
        assert!(trace((8, 6), 32).unwrap().contains("end  "));
        let beyond = 33u64.next_multiple_of(net);
        for n in [beyond, u64::MAX] {
            let fault = trace((0, 0), n).unwrap_err();
            assert_eq!(fault, format!("sample 0,0,{n}: {none}"));
        }
        for (x, y) in [(9, 0), (0, 7), (u32::MAX, u32::MAX)] {
            let fault = trace((x, y), 0).unwrap_err();
            let nothing = "nothing is rendered there";
            assert_eq!(fault, format!("sample {x},{y},0: {nothing}"));
        }
    }
    // The command names the option, and touches no file.
    let place = Scratch::new();
    place.put("a.png", "old");
    let line = "room.obj -d9x7 -n2 -oa.png --sample";
    let text = place.done(&format!("{line} 1,2,1")).stdout;
    assert!(String::from_utf8(text).unwrap().contains("end  "));
    assert!(place.get("a.png") == b"old");
    let run = place.line(&format!("{line} 1,2,2"));
    run.failed(2, &["--sample 1,2,2: the run has no such sample"]);
    // A part has its own rows.
    let part = "room.obj -d9x40 -n2 --integrator=reference --tiles=2/2";
    let run = place.line(&format!("{part} --sample 3,2,1"));
    run.failed(2, &["--sample 3,2,1: nothing is rendered there"]);
    place.done(&format!("{part} --sample 3,39,1"));
}
