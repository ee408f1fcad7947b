// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The sun itself, panes, and sheets that transmit (chapter "Sun and glass").

use crate::prelude::*;

use litpt::materials::glass::{Bsdf, CLEAREST, Pane};

/// The values of points of a scene, black where it is not said otherwise.
fn found(
    scene: &str,
    points: &[(DVec3, DVec3)],
    method: Method,
    change: impl Fn(&mut Plan),
) -> Vec<[f64; 2]> {
    let mut plan = Plan {
        sensor: SensorPlan::Points("points".into()),
        budget: Budget::samples(1 << 14),
        method: Some(method),
        ..Plan::default()
    };
    plan.surfaces.albedo = 0.;
    change(&mut plan);
    let mesh = read_obj(scene.as_bytes()).unwrap();
    let inputs = Inputs::from(mesh).with_points(points.iter().copied());
    let world = World::new(&plan, inputs, Host::default()).unwrap();
    values_of(&world, &plan)
}

/// A quad of a group, around a point and between two half sides.
fn quad(group: &str, middle: DVec3, a: DVec3, b: DVec3) -> String {
    let corners = [-a - b, a - b, a + b, b - a].map(|side| {
        let DVec3 { x, y, z } = middle + side;
        format!("v {x} {y} {z}\n")
    });
    format!("{}g {group}\nf -4 -3 -2 -1\n", corners.concat())
}

/// A horizontal quad of a group at the height 1, of this half side.
fn lid(group: &str, height: f64, half: f64) -> String {
    quad(group, height * DVec3::Z, half * DVec3::X, half * DVec3::Y)
}

const SPECK: &str = "v 0 0 -9\nv 1e-3 0 -9\nv 0 1e-3 -9\nf 1 2 3\n";

/// The point that looks up, from the origin.
const UP: (DVec3, DVec3) = (DVec3::ZERO, DVec3::Z);

#[test]
fn a_pane_transmits_what_the_tables_of_the_standard_say() {
    // CIE 171:2006, section 5.5: a clear pane of 6 mm
    let table = [
        0.88, 0.8797, 0.8786, 0.8755, 0.8676, 0.8479, 0.7999, 0.6839,
        0.4236,
    ];
    let pane = Pane::new(0.88);
    for (i, printed) in (0..).zip(table) {
        let cosine = (f64::from(i) * 10.).to_radians().cos();
        let off = (pane.transmittance(cosine) - printed).abs();
        assert!(off < 6e-5, "{i}0 degrees: {off:e}");
    }
    for i in 0..=1000 {
        let cosine = f64::from(i) / 1000.;
        let [on, back] = Pane::new(CLEAREST).shares(cosine);
        assert!((on + back - 1.).abs() < 1e-12, "{cosine}: {on} {back}");
        let [on, back] = pane.shares(cosine);
        assert!(0. <= on && on + back <= 1., "{cosine}: {on} {back}");
    }
    assert_eq!(Pane::new(0.).shares(0.5)[0], 0.);
}

#[test]
fn the_sun_shines_on_what_faces_it() {
    let chance = &mut Chance::default();
    let sun = DVec3::new(1., 2., 3.).normalize();
    let normals = [DVec3::Z, DVec3::X, DVec3::NEG_Y, sun];
    let points = normals.map(|normal| (DVec3::ZERO, normal));
    for method in Method::ALL {
        let values = found(SPECK, &points, method, |plan| {
            plan.sky.sun = Some(Sun::Toward(sun));
            plan.sky.direct = Some(5.);
            plan.sky.ground_glow = Some(0.3);
        });
        for (value, normal) in values.into_iter().zip(normals) {
            let up = 0.5 + 0.5 * normal.z;
            let glow = 0.3 * (1. + 5. * sun.z) * (1. - up);
            let exact = up + glow + 5. * normal.dot(sun).max(0.);
            chance.judge(value, exact, 16.);
        }
    }
}

/// Behind an edge that halves the disc, and behind a slit that is narrower.
#[test]
fn a_part_of_the_sun_gives_its_part() {
    let chance = &mut Chance::default();
    let sun = DVec3::new(1., 2., 3.).normalize();
    let [x, y] = [sun.any_orthonormal_vector(); 2];
    let y = y.cross(sun);
    let far = 1e4;
    let radius = 0.2665f64.to_radians().sin();
    let wall = |from: f64, side: f64| {
        let middle = sun + side * (from + far) * x;
        quad("wall", middle, far * x, far * y)
    };
    let t = 0.4 * radius;
    let strip = (0.4f64.asin() + 0.4 * (1. - 0.16f64).sqrt()) * 2. / PI;
    for (scene, exact) in [
        (wall(0., 1.), 0.5 + 0.5 * 5.),
        (wall(t, 1.) + &wall(t, -1.), t / t.hypot(1.) + 5. * strip),
    ] {
        for method in Method::ALL {
            let values =
                found(&scene, &[(DVec3::ZERO, sun)], method, |p| {
                    p.sky.cover = Cover::Sphere;
                    p.sky.sun = Some(Sun::Toward(sun));
                    p.sky.direct = Some(5.);
                });
            chance.judge(values[0], exact, 16.);
        }
    }
}

/// The part of cosine-weighted directions below a square overhead.
fn covered(half: f64, height: f64) -> f64 {
    let a = half / height;
    let root = (1. + a * a).sqrt();
    4. / PI * (a / root) * (a / root).atan()
}

/// A pane or two above a point: the mean of their transmittance over the
/// cosine lobe, by a rule of its own, and the sun's at its angle.
#[test]
fn panes_weaken_sky_and_sun() {
    let chance = &mut Chance::default();
    let height = 0.6;
    let sun = DVec3::new(0., -0.8, height);
    let mean = |of: &dyn Fn(f64) -> f64| {
        let midpoints = (0..100_000).map(|i| (f64::from(i) + 0.5) / 1e5);
        midpoints.map(|square| of(square.sqrt())).sum::<f64>() / 1e5
    };
    let through = |part: f64, c: f64| {
        let (n, root) = (1.52f64, 0.52f64 / 2.52);
        let (inner, enter) = ((1. - (1. - c * c) / (n * n)).sqrt(), {
            let r = root * root;
            let b = (1. - r) * (1. - r);
            (-b + (b * b + 4. * part * part * r * r).sqrt())
                / (2. * part * r * r)
        });
        let crossing = enter.powf(1. / inner);
        let of = |r: f64| {
            (1. - r).powi(2) * crossing / (1. - (r * crossing).powi(2))
        };
        let across = ((c - n * inner) / (c + n * inner)).powi(2);
        let along = ((n * c - inner) / (n * c + inner)).powi(2);
        0.5 * (of(across) + of(along))
    };
    let two = |c: f64| through(0.88, c) * through(0.5, c);
    let one = |c: f64| through(0.88, c);
    // Only directions within half a degree of the horizon miss the lids
    for (lids, of) in [
        (lid("a", 1., 1e4), &one as &dyn Fn(f64) -> f64),
        (lid("a", 1., 1e4) + &lid("b", 1.5, 1e4), &two),
    ] {
        for method in Method::ALL {
            let values = found(&lids, &[UP], method, |plan| {
                plan.sky.sun = Some(Sun::Toward(sun));
                plan.sky.direct = Some(2.);
                let glass =
                    |name: &str, part| (name.to_owned(), Bsdf::Glass(part));
                plan.surfaces.transmitting = vec![glass("a", 0.88)];
                if lids.contains("g b") {
                    plan.surfaces.transmitting.push(glass("b", 0.5));
                }
            });
            let exact = mean(of) + 2. * height * of(height);
            chance.judge(values[0], exact, 16.);
        }
    }
}

/// Panes in one plane, whose triangles differ, were once passed for ever.
#[test]
fn panes_in_one_plane_let_a_ray_go_on() {
    let chance = &mut Chance::default();
    let close = |gap: f64, turn: f64| {
        let (a, b) = (1.1 * DVec3::X + turn * DVec3::Z, DVec3::Y);
        lid("a", 1., 1.) + &quad("a", (1. + gap) * DVec3::Z, a, b)
    };
    let others = [0., 1e-12, 1e-10, 1e-6].map(|gap| close(gap, 0.));
    let crossed = [1e-9, 1e-6].map(|turn| close(0., turn));
    let part = covered(1., 1.);
    for scene in others.into_iter().chain(crossed) {
        for method in Method::ALL {
            let values = found(&scene, &[UP], method, |plan| {
                plan.sky.sun = Some(Sun::Toward(DVec3::Z));
                plan.sky.direct = Some(1e4);
                let pane = ("a".to_owned(), Bsdf::Glass(0.5));
                plan.surfaces.transmitting = vec![pane];
            });
            // The sky adds from a quarter of the lids' part to all of it
            let exact = 2500. + 1. - 0.5 * part;
            assert!((values[0][0] - exact).abs() < 1., "{values:?}");
        }
    }
    // A whole pane in front of an opaque wall
    let wall = lid("a", 1., 1.) + &lid("b", 1.001, 50.);
    let values = found(&wall, &[UP], Method::Sobol, |plan| {
        let pane = ("a".to_owned(), Bsdf::Glass(0.5));
        plan.surfaces.transmitting = vec![pane];
    });
    chance.judge(values[0], 1. - covered(50., 1.001), 16.);
}

#[test]
fn a_sheet_scatters_light_to_both_sides() {
    let chance = &mut Chance::default();
    let sun = DVec3::new(0., -0.8, 0.6);
    let scene = lid("sheet", 1., 3.) + &lid("ground", -1e3, 1e-3);
    let points = [UP, (2. * DVec3::Z, DVec3::NEG_Z)];
    for method in Method::ALL {
        let values = found(&scene, &points, method, |plan| {
            plan.sky.sun = Some(Sun::Toward(sun));
            plan.sky.direct = Some(2.);
            let sheet = Bsdf::Transmitter([0.2, 0.3]);
            plan.surfaces.transmitting = vec![("sheet".into(), sheet)];
        });
        // The sky and the sun light its upper side, and nothing the lower
        let share = covered(3., 1.);
        let lit = 1. + 2. * 0.6;
        let below = 0.3 * lit * share + (1. - share);
        // The sun reaches the lower point under the edge of the sheet
        chance.judge(values[0], below, 16.);
        chance.judge(values[1], 0.2 * lit * share, 16.);
    }
}

/// A room with a window of glass, a blind and a leaf.
fn room() -> String {
    let v = DVec3::new;
    let wall = |middle, a, b| quad("wall", middle, a, b);
    let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
    [
        quad("floor", v(2., 2.5, 0.), 2. * x, 2.5 * y),
        wall(v(2., 2.5, 3.), 2. * x, 2.5 * y),
        wall(v(0., 2.5, 1.5), 2.5 * y, 1.5 * z),
        wall(v(4., 2.5, 1.5), 2.5 * y, 1.5 * z),
        wall(v(2., 5., 1.5), 2. * x, 1.5 * z),
        wall(v(2., 0., 0.5), 2. * x, 0.5 * z),
        wall(v(0.5, 0., 2.), 0.5 * x, z),
        wall(v(3.5, 0., 2.), 0.5 * x, z),
        quad("pane", v(1.5, 0., 2.), 0.5 * x, z),
        quad("blind", v(2.5, 0., 2.), 0.5 * x, z),
        quad("leaf", v(2., 2., 1.), v(0.3, 0.2, 0.1), 0.4 * z),
    ]
    .concat()
}

/// The options of `pt` for that room.
const ROOM_WORDS: &str = "room2.obj --points p.txt --glass pane=0.88 \
    --transmit blind=0.3,0.4 --transmit leaf=0.2,0.4 -r 0.6 -r floor=0.3 \
    --sky cie:12 --sun 170,35 --direct 3";

#[test]
fn all_methods_agree_in_a_room_of_sun_and_glass() {
    let chance = &mut Chance::default();
    let mut random = Pcg64::seed_from_u64(5);
    let mut point = || {
        let [x, y, z] = [4., 5., 3.]
            .map(|side| side * (0.05 + 0.9 * random.random::<f64>()));
        (DVec3::new(x, y, z), in_cube(&mut random))
    };
    let points: Vec<_> = (0..24).map(|_| point()).collect();
    let [paths, nets, gather] = Method::ALL.map(|method| {
        found(&room(), &points, method, |plan| {
            plan.seed = 1 + method as u64;
            plan.surfaces.albedo = 0.6;
            plan.sky.cover = Cover::Cie(12);
            plan.sky.sun = Some(Sun::At(170., 35.));
            plan.sky.direct = Some(3.);
            let sheet = |parts| Bsdf::Transmitter(parts);
            plan.surfaces.transmitting = vec![
                ("pane".into(), Bsdf::Glass(0.88)),
                ("blind".into(), sheet([0.3, 0.4])),
                ("leaf".into(), sheet([0.2, 0.4])),
            ];
        })
    });
    for (((a, b), c), _) in paths.iter().zip(nets).zip(gather).zip(&points)
    {
        for other in [b, c] {
            let apart = [a[0] - other[0], a[1].hypot(other[1])];
            chance.judge(apart, 0., 16.);
        }
    }
}

/// A cell that stood for one side of a sheet alone made errors too small.
#[test]
fn gathers_behind_a_sheet_state_their_errors() {
    let sheet = Bsdf::Transmitter([0.2, 0.6]);
    let points = [0.3, 1.7, 3.2].map(|x| (DVec3::new(x, 3., 1.), DVec3::Z));
    let run = |method, samples, seed| {
        found(&room(), &points, method, |plan| {
            plan.seed = seed;
            plan.budget = Budget::samples(samples);
            plan.surfaces.albedo = 0.5;
            plan.surfaces.transmitting =
                vec![("pane".into(), sheet), ("blind".into(), sheet)];
        })
    };
    let truth = run(Method::Sobol, 1 << 18, 0);
    let chance = &mut Chance::default();
    for seed in 1..=8 {
        let values = run(Method::Gather, 1 << 12, seed);
        for (value, exact) in values.iter().zip(&truth) {
            let apart = [value[0] - exact[0], value[1].hypot(exact[1])];
            chance.judge(apart, 0., 16.);
        }
    }
}

/// Rows of the cache that lacked late reflections left the rest to a few
/// corrections, and most runs were then too sure of too little light.
#[test]
fn rows_behind_a_sheet_state_their_errors() {
    let sheet = Bsdf::Transmitter([0.3, 0.4]);
    let point = |k: u32| {
        let [i, j] = [k / 8, k % 8].map(f64::from);
        (DVec3::new(0.5 + 0.6 * i, 0.4 + 0.6 * j, 0.8), DVec3::Z)
    };
    let points: Vec<_> = (0..48).map(point).collect();
    let run = |samples, seed| {
        found(&room(), &points, Method::Gather, |plan| {
            plan.seed = seed;
            plan.tally = Some(litpt::tally::Tally::SkyPatches(1));
            plan.budget = Budget::samples(samples);
            plan.surfaces.albedo = 0.8;
            plan.surfaces.transmitting =
                vec![("pane".into(), sheet), ("blind".into(), sheet)];
        })
    };
    let truth = run(1 << 17, 999);
    let missing = truth.iter().filter(|it| it[0].is_nan());
    assert_eq!(missing.count(), 1);
    let chance = &mut Chance::default();
    for seed in 1..=32 {
        let lit = |it: &(&[f64; 2], [f64; 2])| it.0[0].is_finite();
        // The corner of the leaf takes the value of one point
        for (exact, value) in truth.iter().zip(run(512, seed)).filter(lit) {
            let apart = [value[0] - exact[0], value[1].hypot(exact[1])];
            chance.judge(apart, 0., 16.);
        }
    }
}

/// The altitude of the middle of a row of 96 patches, and half the sides of
/// such a patch: Reinhart's of factor 4, in degrees.
const BRIGHT: [f64; 3] = [30., 1.875, 90. / 57.];

/// A sky of patches of radiance 1; those of this row at some azimuths have
/// so much more.
fn bright_sky(place: &Scratch, more: &[(f64, f64)]) -> Cover {
    let mut rows = vec![1.; 2306];
    let patches = litpt::tally::patches::Patches::new(4, DVec3::Z);
    for (azimuth, radiance) in more {
        let middle = Sun::At(*azimuth, BRIGHT[0]).direction(DVec3::Z);
        rows[patches.number(middle) as usize] += radiance;
    }
    place.put("a.smx", crate::sky::matrix(2306, 1, |row, _| rows[row]));
    Cover::Matrix(place.path("a.smx"), None)
}

/// The integral of a function over such a patch, over pi, by midpoints.
fn over_patch(azimuth: f64, of: impl Fn(DVec3) -> f64) -> f64 {
    let [altitude, across, up] = BRIGHT;
    let steps = 400;
    let mut sum = 0.;
    for i in 0..steps * steps {
        let [u, v] = [i % steps, i / steps]
            .map(|k| (2 * k + 1) as f64 / f64::from(steps) - 1.);
        let altitude = altitude + up * v;
        let sun = Sun::At(azimuth + across * u, altitude);
        sum += altitude.to_radians().cos() * of(sun.direction(DVec3::Z));
    }
    let sides = 4. * across.to_radians() * up.to_radians();
    sum * sides / (PI * f64::from(steps * steps))
}

/// No path may meet a bright patch at grazing incidence, and the errors of
/// such walls once left it out.
#[test]
fn walls_that_a_bright_patch_grazes_state_their_errors() {
    let chance = &mut Chance::default();
    let place = Scratch::new();
    let cover = bright_sky(&place, &[(180., 3000.), (183.75, 1000.)]);
    let wall = |azimuth, tilt| Sun::At(azimuth, tilt).direction(DVec3::Z);
    let normals =
        [wall(90., 0.), wall(271., -20.), wall(180., -59.), DVec3::Z];
    let points = normals.map(|normal| (DVec3::ZERO, normal));
    let of = |normal: DVec3| {
        let part = |w: DVec3| normal.dot(w).max(0.);
        3000. * over_patch(180., part) + 1000. * over_patch(183.75, part)
    };
    let (unit, sun) = (1. + of(DVec3::Z), Sun::At(120., 50.));
    for (method, direct) in
        Method::ALL.into_iter().flat_map(|m| [(m, None), (m, Some(0.5))])
    {
        for seed in 1..=16 {
            let values = found(SPECK, &points, method, |plan| {
                plan.seed = seed;
                plan.sky.cover = cover.clone();
                plan.sky.sun = Some(sun);
                plan.sky.direct = direct;
            });
            for (value, normal) in values.into_iter().zip(normals) {
                let disc = normal.dot(sun.direction(DVec3::Z)).max(0.);
                let sky = (0.5 + 0.5 * normal.z + of(normal)) / unit;
                let exact = sky + direct.unwrap_or(0.) * disc;
                chance.judge(value, exact, 16.);
            }
        }
    }
}

/// A pane that covers the sky, and a sheet below which no direct light comes.
#[test]
fn bright_patches_shine_through_panes_and_on_sheets() {
    let chance = &mut Chance::default();
    let place = Scratch::new();
    let cover = bright_sky(&place, &[(0., 1000.), (90., 5000.)]);
    let part = |of: &dyn Fn(f64) -> f64| {
        let of = |w: DVec3| w.z * of(w.z);
        1000. * over_patch(0., of) + 5000. * over_patch(90., of)
    };
    let unit = 1. + part(&|_| 1.);
    let run = |scene: &str, points: &[_], method, bsdf| {
        found(scene, points, method, |plan| {
            plan.sky.cover = cover.clone();
            plan.surfaces.transmitting = vec![("a".to_owned(), bsdf)];
        })
    };
    let sheet = lid("a", 1., 3.) + &lid("ground", -1e3, 1e-3);
    let sides = [UP, (2. * DVec3::Z, DVec3::NEG_Z)];
    let pane = Pane::new(0.88);
    for method in Method::ALL {
        let through = Bsdf::Glass(0.88);
        let values = run(&lid("a", 1., 1e4), &[UP], method, through);
        let sky =
            pane.diffuse_shares()[0] + part(&|c| pane.transmittance(c));
        chance.judge(values[0], sky / unit, 16.);
        let through = Bsdf::Transmitter([0.2, 0.3]);
        let values = run(&sheet, &sides, method, through);
        let share = covered(3., 1.);
        let below = 0.3 * share + (1. - share) / unit;
        chance.judge(values[0], below, 16.);
        chance.judge(values[1], 0.2 * share, 16.);
    }
}

/// Rooms of glass, a blind and a leaf, with and without a disc of the sun.
#[test]
fn all_methods_agree_in_a_room_of_bright_patches() {
    let chance = &mut Chance::default();
    let place = Scratch::new();
    let cover =
        bright_sky(&place, &[(150., 500.), (180., 2000.), (0., 500.)]);
    let mut random = Pcg64::seed_from_u64(6);
    let mut point = || {
        let [x, y, z] = [4., 5., 3.]
            .map(|side| side * (0.05 + 0.9 * random.random::<f64>()));
        (DVec3::new(x, y, z), in_cube(&mut random))
    };
    let points: Vec<_> = (0..24).map(|_| point()).collect();
    for direct in [None, Some(3.)] {
        let [paths, nets, gather] = Method::ALL.map(|method| {
            found(&room(), &points, method, |plan| {
                plan.seed = 1 + method as u64;
                plan.surfaces.albedo = 0.6;
                plan.sky.cover = cover.clone();
                plan.sky.sun = Some(Sun::At(170., 35.));
                plan.sky.direct = direct;
                let sheet = |parts| Bsdf::Transmitter(parts);
                plan.surfaces.transmitting = vec![
                    ("pane".into(), Bsdf::Glass(0.88)),
                    ("blind".into(), sheet([0.3, 0.4])),
                    ("leaf".into(), sheet([0.2, 0.4])),
                ];
            })
        });
        for ((a, b), c) in paths.iter().zip(nets).zip(gather) {
            for other in [b, c] {
                let apart = [a[0] - other[0], a[1].hypot(other[1])];
                chance.judge(apart, 0., 16.);
            }
        }
    }
}

#[test]
fn sun_and_glass_have_the_same_bits_on_any_number_of_threads() {
    let place = Scratch::with("room2.obj", room());
    place.put("p.txt", "1 1 1 0 0 1\n3 4 2 0 -1 0\n2 3 0.5 0 0 1\n");
    for method in Method::ALL {
        let [one, three] = [1, 3].map(|threads| {
            let words = format!(
                "{ROOM_WORDS} -n 256 --integrator {method} --threads {threads}"
            );
            place.free(&words).succeeded().stdout.clone()
        });
        assert_eq!(one, three, "{method}");
    }
}

#[test]
fn what_decides_light_through_glass_is_in_the_key() {
    let place = Scratch::with("room2.obj", room());
    place.put("p.txt", "1 1 1 0 0 1\n");
    place.free(&format!("{ROOM_WORDS} -n 64 -o a.litpt")).succeeded();
    for (other, name) in [
        ("--glass pane=0.8", "glass"),
        ("--transmit leaf=0.2,0.3", "transmit"),
        ("--direct 2", "direct"),
        ("--sun 160,35", "sun"),
    ] {
        let words = format!("--resume a.litpt {other} -n 128");
        place.free(&words).failed(2, &[name]);
    }
    place.free("--resume a.litpt -n 128 -o a.csv").succeeded();
    // Nor do images with and without it show the same.
    let words = "room2.obj -d8x6 -n2 -q";
    place.free(&format!("{words} -o a.exr")).succeeded();
    let glazed = format!("{words} --glass pane=0.8 -s1 -o b.exr");
    place.free(&glazed).succeeded();
    let said = place.ptimg("diff a.exr b.exr").text();
    says(&said, &["they show different things: transmitting none against"]);
}

#[test]
fn glass_and_suns_that_are_none_are_refused() {
    let place = Scratch::with("room2.obj", room());
    place.put("p.txt", "1 1 1 0 0 1\n");
    for (words, fault) in [
        ("--direct 3", "needs the direction to the sun"),
        ("--direct 3 --sun 0,0,-1", "a sun above the horizon"),
        ("--direct 3 --sun 1,0,0", "--sun 1,0,0: expected a sun above"),
        ("--direct 3 --sun 9,9,-9", "--sun 9,9,-9: expected a sun above"),
        ("--direct -1 --sun 0,40", "from 0 to 1e6"),
        ("--direct 1e308 --sun 0,40", "--direct 1e308: expected"),
        ("--direct nan --sun 0,40", "nan is not a finite number"),
        ("--glass pane", "expected NAME=TAU, or materials"),
        ("--glass pane=0.95", "0.9183: clear glass reflects the rest"),
        ("--glass pane=-0.1", "from 0 to 0.9183"),
        ("--glass window=0.8", "is called window (--glass window=0.8)"),
        ("--transmit blind=0.3", "expected NAME=RHO,TAU"),
        ("--transmit blind=0.7,0.4", "not more than 1 together"),
        ("--transmit leaves=0.3,0.4", "(--transmit leaves=0.3,0.4)"),
        ("--glass pane=0.8 --view-factors groups", "looks through none"),
        ("--glass pane=0.8 --derivative wall", "not what they transmit"),
        ("--sun 0,40 --direct 1 --sky-patches 1", "not --direct"),
    ] {
        let run =
            place.free(&format!("room2.obj -n1 --points=p.txt {words}"));
        let late = fault.contains("is called") || fault.starts_with('(');
        run.failed(if late { 1 } else { 2 }, &[fault]);
    }
    let words = "room2.obj -n1 --faces --radiosity --glass pane=0.8";
    place.free(words).failed(2, &["where surfaces let light through"]);
}

/// What passes a pane is counted for the patch of the sky behind it.
#[test]
fn patches_of_the_sky_are_seen_through_panes() {
    let place = Scratch::with("lid.obj", lid("a", 1., 1e4));
    place.put("p.txt", "0 0 0 0 0 1\n");
    let words = "lid.obj --points p.txt -r 0 --glass a=0.88 -n 4096";
    place.free(&format!("{words} --sky-patches 1 -o d.csv")).succeeded();
    let text = fs::read_to_string(place.path("d.csv")).unwrap();
    let values = text.lines().skip(1).map(|line| {
        line.split(',').nth(2).unwrap().parse::<f64>().unwrap()
    });
    // The matrix has the irradiance for a radiance of 1
    let exact = PI * Pane::new(0.88).diffuse_shares()[0];
    let sum = values.sum::<f64>();
    assert!((sum - exact).abs() < 1e-3, "{sum} and not {exact}");
}

#[test]
fn transparent_materials_are_glass_if_it_is_asked_for() {
    let place = Scratch::new();
    let scene =
        "mtllib m.mtl\nusemtl pane\n".to_owned() + &lid("a", 1., 1e4);
    place.put("lid.obj", scene);
    place.put("p.txt", "0 0 0 0 0 1\n");
    let words = "lid.obj --points p.txt -n 4096 --glass materials";
    let free = |library: &str| {
        place.put(
            "m.mtl",
            format!("newmtl pane\nKd 0.5 0.5 0.5\n{library}"),
        );
        let run = place.free(words).succeeded();
        let line = run.text().lines().last().unwrap().to_owned();
        line.split(',').nth(6).unwrap().parse::<f64>().unwrap()
    };
    let diffuse = |part| Pane::new(part).diffuse_shares()[0];
    for (library, exact) in [
        ("d 0.2\n", diffuse(0.8)),
        ("Tr 0.8\nTf 0.5 0.5 0.5\n", diffuse(0.4)),
        ("Tr 0.8\nTf 0.5\n", diffuse(0.4)),
        ("d 0.0\n", diffuse(CLEAREST)),
        ("Tf 1 1 1\nd 1\n", 0.),
        ("Tf 1 1 1\n", 0.),
        ("Tr 1\nd 1\n", 0.),
        ("d 0.2\nTr 0.2\n", diffuse(0.8)),
        ("d 0.5\nd 0.2\n", diffuse(0.5)),
    ] {
        let value = free(library);
        assert!((value - exact).abs() < 2e-3, "{library}: {value} {exact}");
    }
}

/// A pane or a sheet with the corners of an opaque face leaves it opaque,
/// whichever comes first.
#[test]
fn an_opaque_face_hides_a_pane_with_its_corners() {
    let place = Scratch::with("p.txt", "0 0 0 0 0 1\n");
    let (pane, wall) = (lid("pane", 1., 1e4), lid("wall", 1., 1e4));
    let turned = |lid: &str| lid.replace("f -4 -3 -2 -1", "f -1 -2 -3 -4");
    assert_ne!(turned(&wall), wall);
    let (hidden, told) = ("is the first pane", "lets light through and");
    for (scene, face, why) in [
        (pane.clone() + &wall, 1, hidden),
        (wall.clone() + &pane, 2, hidden),
        (pane.clone() + &turned(&wall), 1, told),
        (turned(&wall) + &pane, 2, told),
    ] {
        place.put("lid.obj", scene);
        for option in ["--glass pane=0.8", "--transmit pane=0,0.8"] {
            let words = "lid.obj --points p.txt -n 16 -r 0 -f -o a.csv";
            let run = place.free(&format!("{words} {option}")).succeeded();
            let text = place.text("a.csv");
            let line = text.lines().nth(1).unwrap();
            assert_eq!(line.split(',').nth(6), Some("0.0"), "{text}");
            let told = format!("warning: lid.obj: face {face} {why}");
            says(&run.stderr, &[told]);
        }
    }
    // A pane or a sheet that is there twice is one.
    for scene in [pane.repeat(2), pane.clone() + &turned(&pane)] {
        place.put("lid.obj", scene);
        for (option, exact) in [
            ("--glass pane=0.8", Pane::new(0.8).diffuse_shares()[0]),
            ("--transmit pane=0,0.8", 0.8),
        ] {
            let words = "lid.obj --points p.txt -n 4096";
            let run = place.free(&format!("{words} {option}")).succeeded();
            let text = run.text();
            let line = text.lines().nth(1).unwrap();
            let value: f64 =
                line.split(',').nth(6).unwrap().parse().unwrap();
            assert!((value - exact).abs() < 2e-3, "{value} {exact}");
        }
    }
    // So is one whose corners are rounded, so that it is not quite flat.
    let corners = ["3 4.001 2.501", "4.069 4.39 2.501"];
    let more = ["3.747 5.274 3.21", "2.679 4.885 3.21"];
    let corners = [corners, more].concat().join("\nv ");
    let slope = format!("v {corners}\ng pane\nf 1 2 3 4\n");
    place.put("roof.txt", "3.4 4.6 2.6 0 0 1\n");
    let values = [slope.clone(), slope.clone() + "f 2 3 4 1\n"].map(|it| {
        place.put("roof.obj", it);
        let words = "roof.obj --points roof.txt -n 4096 --glass pane=0.8";
        place.free(words).succeeded().text()
    });
    assert_eq!(values[0], values[1]);
    // A pane that looks down on the ground coincides with nothing.
    place.put("lid.obj", SPECK.to_owned() + &turned(&pane));
    let words = "lid.obj --points p.txt -n 1 --glass pane=0.8 --ground=0.2";
    let said = place.free(words).succeeded().stderr;
    assert!(!said.contains("coincides"), "{said}");
    // What coincides in a part is told.
    for other in [2e4, 5e3]
        .into_iter()
        .flat_map(|half| ["pane", "wall"].map(|group| lid(group, 1., half)))
    {
        place.put("lid.obj", pane.clone() + &other);
        let words = "lid.obj --points p.txt -n 1 --glass pane=0.8 -o b.csv";
        let run = place.free(&format!("{words} -f")).succeeded();
        says(&run.stderr, &["face 1 lets light through and coincides"]);
    }
}

/// A name has an albedo, or is glass, or a sheet; the last of several values
/// of one option counts.
#[test]
fn contradictory_surfaces_of_one_name_are_refused() {
    let place = Scratch::with("room2.obj", room());
    place.put("p.txt", "1 1 1 0 0 1\n");
    let words = |more: &str| format!("room2.obj -n1 --points=p.txt {more}");
    let run = |more: &str| place.free(&words(more));
    for (more, faults) in [
        (
            "--glass pane=0.8 -r pane=0.3",
            ["--glass pane=0.8", "--albedo pane=0.3"],
        ),
        (
            "--transmit pane=0.2,0.3 -r pane=0.3",
            ["--transmit pane=0.2,0.3", "--albedo pane=0.3"],
        ),
        (
            "--glass pane=0.8 --transmit pane=0.2,0.3",
            ["--glass pane=0.8", "--transmit pane=0.2,0.3"],
        ),
    ] {
        run(more).failed(2, &faults);
    }
    let twice = run("--glass pane=0.5 --glass pane=0.8").succeeded().stderr;
    assert!(twice.contains("glass pane transmits 0.8 of"), "{twice}");
    assert!(!twice.contains("and 1 more"), "{twice}");
}

/// Statements about transparency that are no numbers from 0 to 1 are warned
/// of, and so are libraries without any.
#[test]
fn glass_of_materials_that_is_none_is_warned_of() {
    let place = Scratch::with("p.txt", "0 0 0 0 0 1\n");
    let scene = "mtllib m.mtl\nusemtl pane\n".to_owned();
    place.put("lid.obj", scene + &lid("a", 1., 1e4));
    let words = "lid.obj --points p.txt -n 1 --glass materials";
    let none = "no material lets light through (d, Tr; times Tf)";
    let odd =
        ": material pane is transparent (d counts, then Tr, the first";
    for (library, wanted) in [
        ("d abc", &[odd, none][..]),
        ("d 1.5", &[odd, none]),
        ("Tr -1", &[odd, none]),
        ("Tf 2 2 2\nd 0.5", &[odd]),
        ("d -halo 0.5", &[odd, none]),
        ("d 1", &[none]),
        ("d 0.5\nTf 0.5 0.5 0.5", &[]),
        ("d 0.2\nTr 0.5", &[odd]),
        ("d 0.9\nTr 0.1", &[]),
        ("Tr 0.666667\nd 0.33", &[]),
        ("d 0.2\nTf 0 0 0", &[none]),
    ] {
        place.put(
            "m.mtl",
            format!("newmtl pane\nKd 0.5 0.5 0.5\n{library}\n"),
        );
        let text = place.free(words).succeeded().stderr;
        says(&text, wanted);
        let of = |file| text.matches(file).count();
        let count = of("warning: m.mtl:") + of("warning: lid.obj:");
        assert_eq!(count, wanted.len(), "{library}: {text}");
    }
}
