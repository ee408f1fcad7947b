// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Skies: the formulas of the standard and of Perez, and what they give to
//! surfaces in the open.

use crate::prelude::*;

/// Unit vectors, uniform over the half sphere above the horizon.
fn directions(count: u32) -> Vec<DVec3> {
    let golden = 0.5 * (5f64.sqrt() - 1.);
    let direction = |i: u32| {
        let height = (f64::from(i) + 0.5) / f64::from(count);
        let turn = TAU * (golden * f64::from(i)).fract();
        let level = (1. - height * height).sqrt();
        DVec3::new(level * turn.cos(), level * turn.sin(), height)
    };
    (0..count).map(direction).collect()
}

/// A sun due south at an altitude in degrees.
fn sun(altitude: f64) -> DVec3 {
    Sun::At(180., altitude).direction(DVec3::Z)
}

/// The relative radiance of a sky of these parameters: ISO 15469, equation 1,
/// and, without the last term, Perez.
fn formula(
    [a, b, c, d, e]: [f64; 5],
    is_cie: bool,
    w: DVec3,
    s: DVec3,
) -> f64 {
    let away = w.cross(s).length().atan2(w.dot(s));
    let last = if is_cie { (d * PI / 2.).exp() } else { 0. };
    let around =
        1. + c * ((d * away).exp() - last) + e * away.cos().powi(2);
    (1. + a * (b / w.z).exp()) * around
}

#[test]
fn cie_skies_are_those_of_the_standard() {
    let table = "4 -.7 0 -1 0, 4 -.7 2 -1.5 .15, 1.1 -.8 0 -1 0, \
                 1.1 -.8 2 -1.5 .15, 0 -1 0 -1 0, 0 -1 2 -1.5 .15, \
                 0 -1 5 -2.5 .3, 0 -1 10 -3 .45, -1 -.55 2 -1.5 .15, \
                 -1 -.55 5 -2.5 .3, -1 -.55 10 -3 .45, -1 -.32 10 -3 .45, \
                 -1 -.32 16 -3 .3, -1 -.15 16 -3 .3, -1 -.15 24 -2.8 .15";
    for (kind, row) in (1..).zip(table.split(',')) {
        let row = row.split_whitespace().map(|x| x.parse().unwrap());
        let row: Vec<f64> = row.collect();
        let row: [f64; 5] = row.try_into().unwrap();
        let cover: Cover = format!("cie:{kind}").parse().unwrap();
        for altitude in [5., 25., 45., 65., 90.] {
            let sun = sun(altitude);
            let sky = Sky::with(DVec3::Z, cover.clone()).toward(sun);
            let zenith = formula(row, true, DVec3::Z, sun);
            for w in directions(1000) {
                let exact = formula(row, true, w, sun) / zenith;
                let found = sky.radiance(w) / sky.radiance(DVec3::Z);
                let off = (found / exact - 1.).abs();
                assert!(
                    off < 1e-12,
                    "type {kind}, sun {altitude}: {off:e}"
                );
            }
        }
    }
    let overcast: Cover = "cie:16".parse().unwrap();
    assert_eq!(overcast, Cover::Overcast);
    let even = Sky::with(DVec3::Z, Cover::Cie(3));
    assert_eq!(even.clone().toward(sun(20.)), even);
}

#[test]
fn perez_skies_are_those_of_radiance() {
    // What gendaylit 6.0a prints for -ang ALTITUDE 0 -P CLEARNESS BRIGHTNESS
    for (altitude, clearness, brightness, parameters) in [
        (
            40.,
            1.03,
            0.3,
            [0.670901, -0.416649, 1.708830, -1.010536, 0.015502],
        ),
        (
            30.,
            1.3,
            0.25,
            [-1.135486, -0.728519, 10.720386, -3.111669, 0.111],
        ),
        (
            60.,
            2.2,
            0.2,
            [-1.043242, -0.623728, 14.945752, -3.258365, 0.016637],
        ),
        (
            25.,
            4.,
            0.12,
            [-1.119728, -0.319485, 13.03618, -3.437535, 0.358661],
        ),
        (
            50.,
            5.5,
            0.1,
            [-0.970757, -0.209503, 15.50042, -3.925564, 0.639496],
        ),
        (
            35.,
            8.,
            0.08,
            [-0.960609, -0.151592, 17.70681, -5.726554, 1.074942],
        ),
    ] {
        let cover = Cover::Perez(clearness, brightness);
        let sun = sun(altitude);
        let sky = Sky::with(DVec3::Z, cover.clone()).toward(sun);
        let zenith = formula(parameters, false, DVec3::Z, sun);
        for w in directions(100) {
            let exact = formula(parameters, false, w, sun).max(0.) / zenith;
            let found = sky.radiance(w) / sky.radiance(DVec3::Z);
            assert!(
                (found - exact).abs() < 1e-4 * exact.max(1.),
                "{cover}"
            );
        }
    }
}

/// The irradiance of a surface in the open by a rule of its own: rings around
/// the normal, weighted by the cosine.
fn irradiance(radiance: impl Fn(DVec3) -> f64, normal: DVec3) -> f64 {
    let x = normal.any_orthonormal_vector();
    let y = normal.cross(x);
    let (rings, steps) = (1200, 1200);
    let (mut sum, mut count) = (0., 0.);
    for i in 0..rings {
        let r = ((f64::from(i) + 0.5) / f64::from(rings)).sqrt();
        for k in 0..steps {
            let turn = TAU * (f64::from(k) + 0.5) / f64::from(steps);
            let height = (1. - r * r).sqrt();
            let w = r * (turn.cos() * x + turn.sin() * y) + height * normal;
            (sum, count) = (sum + radiance(w), count + 1.);
        }
    }
    sum / count
}

// The unit of a sky gives 1 to a horizontal surface, and the control variate is
// what it is said to be, whichever way a surface faces.
#[test]
fn skies_give_one_to_a_horizontal_surface() {
    let up = UP;
    // An overhang of whose nearest sky the ratio is negative
    let turn = 152.5f64.to_radians();
    let overhang = turn.cos() * up + turn.sin() * DVec3::Y;
    for (cover, altitude, below) in [
        (Cover::Cie(1), 40., 0.25),
        (Cover::Cie(12), 40., 0.),
        (Cover::Cie(15), 40., 0.25),
        (Cover::Cie(8), 90., 0.),
        (Cover::Perez(6., 0.1), 40., 0.25),
    ] {
        let sun = Sun::At(250., altitude).direction(up);
        let mut sky = Sky::with(up, cover.clone()).toward(sun);
        let found = irradiance(|w| sky.radiance(w), up);
        assert!((found - 1.).abs() < 2e-5, "{cover}: {found}");
        // The rest of the nearest sky has no mean and no slope
        let rest = |w| sky.radiance(w) - sky.even_radiance(w);
        assert!(irradiance(rest, up).abs() < 2e-5, "{cover}");
        let slope = irradiance(|w| rest(w) * w.dot(up), up);
        assert!(slope.abs() < 2e-5, "{cover}: {slope}");
        sky.below = below;
        for normal in [up, -up, DVec3::X, overhang] {
            let exact = irradiance(|w| sky.even_radiance(w), normal);
            let found = sky.irradiance_ratio(normal);
            assert!(
                (found - exact).abs() < 3e-4,
                "{cover}: {found} {exact}"
            );
        }
    }
}

/// A zenith along no axis.
const UP: DVec3 = DVec3::new(0.6, 0., 0.8);

/// A sky matrix of so many rows and columns.
pub fn matrix(
    rows: usize,
    columns: usize,
    of: impl Fn(usize, usize) -> f64,
) -> Vec<u8> {
    let head = "#?RADIANCE\ngendaymtx -m 1 -O0 a.wea\nNCOMP=3";
    let size = format!("NROWS={rows}\nNCOLS={columns}\nFORMAT=ascii");
    let mut text = format!("{head}\n{size}\n\n");
    for row in 0..rows {
        for column in 1..=columns {
            let value = of(row, column);
            text += &format!("{value} {value} {value}\n");
        }
    }
    text.into_bytes()
}

/// A radiance that tells row and column apart, and is 0 in some rows.
fn mixed(row: usize, column: usize) -> f64 {
    if row == 0 { 9. } else { (row * row * (column + 6) % 11) as f64 }
}

/// The patches of the second of some columns.
fn patchwork(rows: usize, columns: usize) -> Patchwork {
    let bytes = matrix(rows, columns, mixed);
    litpt::inputs::patchwork(&bytes, Path::new("a.smx"), Some(2)).unwrap()
}

#[test]
fn a_matrix_of_ones_is_the_uniform_sky() {
    let bytes = matrix(146, 1, |row, _| if row == 0 { 7. } else { 3. });
    let read =
        litpt::inputs::patchwork(&bytes, Path::new("a.smx"), None).unwrap();
    let [sky, uniform] =
        [Sky::of(UP, &read), Sky::with(UP, Cover::Uniform)];
    for w in directions(1000) {
        for (found, exact) in [
            (sky.radiance(w), uniform.radiance(w)),
            (sky.even_radiance(w), uniform.even_radiance(w)),
            (sky.irradiance_ratio(w), uniform.irradiance_ratio(w)),
            (sky.irradiance_ratio(-w), uniform.irradiance_ratio(-w)),
        ] {
            assert!((found - exact).abs() < 1e-9, "{w}: {found} {exact}");
        }
    }
}

// Each patch has the radiance of its row; the unit gives 1 to a horizontal
// surface; and the control variate is what it is said to be.
#[test]
fn a_sky_of_patches_is_that_of_its_column() {
    for (factor, rows) in [(1, 146), (2, 578), (4, 2306)] {
        let sky = Sky::of(UP, &patchwork(rows, 3));
        let patches = litpt::tally::patches::Patches::new(factor, UP);
        let value = |w| mixed(patches.number(w) as usize, 2);
        let unit =
            irradiance(|w| (w.dot(UP) > 0.) as u8 as f64 * value(w), UP);
        for w in directions(1000).into_iter().filter(|w| w.dot(UP) > 0.) {
            let (found, exact) = (sky.radiance(w), value(w) / unit);
            assert!(
                (found - exact).abs() <= 1e-3 * exact,
                "{found} {exact}"
            );
            assert_eq!(sky.radiance(-w), 0.);
        }
        let rest = |w| sky.radiance(w) - sky.even_radiance(w);
        let mean = irradiance(rest, UP);
        let slope = irradiance(|w| rest(w) * w.dot(UP), UP);
        assert!(mean.abs() < 1e-3 && slope.abs() < 1e-3, "{mean} {slope}");
    }
}

#[test]
fn a_sky_that_a_matrix_has_not_is_refused() {
    let place = Scratch::new();
    place.put("cube.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    place.put("p.txt", "0 0 1 0 0 1\n");
    let is_lit = |row, column| f64::from(row == 0 || column != 2);
    place.put("ok.smx", matrix(146, 3, is_lit));
    place.put("odd.smx", matrix(147, 3, is_lit));
    place.put("less.smx", matrix(146, 1, |row, _| 1. - row as f64));
    place.put("no.smx", "NROWS=146\n\n");
    place.put("gz.smx", b"\x1f\x8b\x08\0\0\0\0\0\0\x03");
    for (sky, status, faults) in [
        ("ok.smx", 1, ["ok.smx: ", "3 columns: name one, as in ok.smx:1"]),
        ("ok.smx:2", 1, ["ok.smx: ", "column 2 has no light"]),
        ("ok.smx:4", 1, ["ok.smx: ", "3 columns, and none 4"]),
        ("ok.smx:0", 2, ["ok.smx:0", "expected a column from 1 on"]),
        ("ok.smx:1.5", 2, ["ok.smx:1.5", "expected a column from 1 on"]),
        (
            "ok.smx.gz:1",
            2,
            ["ok.smx.gz:1", "a compressed sky matrix is not read"],
        ),
        (
            "ok.smx.zst",
            2,
            ["ok.smx.zst", "a compressed sky matrix is not read"],
        ),
        ("gz.smx", 1, ["gz.smx: ", "a compressed sky matrix is not read"]),
        ("odd.smx:1", 1, ["odd.smx: ", "147 rows"]),
        ("less.smx", 1, ["less.smx: ", "patch 2 in column 1 is -1"]),
        ("no.smx", 1, ["no.smx: ", "NCOLS is none"]),
        ("none.smx", 1, ["none.smx", "No such file"]),
        ("-:2", 2, ["-:2", "or FILE.smx:COLUMN"]),
    ] {
        let line = format!("cube.obj -n1 --points=p.txt --sky {sky}");
        place.free(&line).failed(status, &faults);
    }
    let over = "cube.obj -n1 -f -ook.smx --sky ok.smx:1 --format=pgm";
    assert_ne!(place.free(over).status, Some(0));
}

// The paths are the same, but for a control variate.
#[test]
fn a_sky_of_patches_gives_what_coefficients_times_its_column_give() {
    let place = Scratch::new();
    let wall = "v -9 1 0\nv 9 1 0\nv 9 1 3\nv -9 1 3\nf 1 2 3 4\n";
    place
        .put("wall.obj", format!("{wall}v -9 -9 0\nv 9 -9 0\nf 5 6 2 1\n"));
    place.put("p.txt", "0 0 1 0 0 1\n0 0 2 1 0 0\n0 -1 1 0 1 -0.5\n");
    place.put("a.smx", matrix(146, 3, mixed));
    let line = "wall.obj -n65536 -r0.5 --points=p.txt --integrator=sobol";
    for words in ["--sky-patches=1 -od.mtx", "--sky=a.smx:2 -ov.csv"] {
        place.free(&format!("{line} {words}")).succeeded();
    }
    let [matrix, table] = ["d.mtx", "v.csv"].map(|name| place.text(name));
    let (_, body) = matrix.split_once("\n\n").unwrap();
    let numbers = body.split_whitespace().map(|x| x.parse().unwrap());
    let numbers: Vec<f64> = numbers.collect();
    let moments = litpt::tally::patches::Patches::new(1, UP).moments();
    let light = |of: &dyn Fn(usize) -> f64| -> f64 {
        (1..146).map(|p| of(p) * mixed(p, 2)).sum()
    };
    let unit = PI * light(&|p| moments[p][0]);
    assert_eq!((numbers.len(), table.lines().count()), (3 * 3 * 146, 4));
    for (row, line) in numbers.chunks(3 * 146).zip(table.lines().skip(1)) {
        let value: f64 = line.split(',').nth(6).unwrap().parse().unwrap();
        let exact = light(&|p| row[3 * p]) / unit;
        assert!((value - exact).abs() < 0.01 * exact, "{value} {exact}");
    }
}

// A run goes on with the file where it is now, and not if it has changed. The
// report names the file and its hash.
#[test]
fn a_run_goes_on_under_the_same_sky() {
    let place = Scratch::new();
    place.put("cube.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    place.put("p.txt", "0 0 1 0 0 1\n0 0 1 1 0 0\n");
    let bytes = matrix(146, 3, mixed);
    place.put("a.smx", &bytes);
    let run = |line: &str| place.free(line);
    run("cube.obj -n64 --points=p.txt --sky a.smx:2 -oc.litpt \
         -oa.csv --report=a.json")
    .succeeded();
    let report = place.text("a.json");
    let hash = litpt::inputs::sha256(&bytes);
    says(&report, &["--sky a.smx:2", &format!("{hash}.smx:2")]);
    fs::rename(place.path("a.smx"), place.path("b.smx")).unwrap();
    run("--resume=c.litpt -n128 -ob.csv").failed(1, &["a.smx"]);
    run("--resume=c.litpt -n128 -ob.csv --sky b.smx:2").succeeded();
    run("--resume=c.litpt -n256 -fob.csv --sky b.smx:3")
        .failed(2, &["--sky", "the run that is resumed has another"]);
    place.put("b.smx", matrix(146, 3, |row, _| row as f64));
    run("--resume=c.litpt -n256 -fob.csv").failed(1, &["sky", &hash]);
}

// What a run finds for places in the open is what the sky gives them, by each
// method and with a control variate.
#[test]
fn each_method_finds_the_light_of_a_sky() {
    let chance = &mut Chance::default();
    let speck = "v 0 0 0\nv 1e-3 0 0\nv 0 1e-3 0\nf 1 2 3\n";
    let (at, up) = (DVec3::new(2., 3., 5.), DVec3::Z);
    let normals = [up, DVec3::X, DVec3::NEG_Y, DVec3::new(0., 0.6, -0.8)];
    let patches = Arc::new(patchwork(578, 2));
    for cover in [
        Cover::Cie(3),
        Cover::Cie(12),
        Cover::Perez(6., 0.1),
        patches.typed.clone(),
    ] {
        for method in Method::ALL {
            let mut plan = Plan {
                sensor: SensorPlan::Points("points".into()),
                budget: Budget::samples(1 << 14),
                method: Some(method),
                ..Plan::default()
            };
            plan.sky.cover = cover.clone();
            plan.sky.sun = Some(Sun::At(180., 30.));
            plan.sky.ground_glow = Some(0.2);
            let mesh = read_obj(speck.as_bytes()).unwrap();
            let mut inputs =
                Inputs::from(mesh).with_points(normals.map(|n| (at, n)));
            inputs.sky = Some(patches.clone());
            let world = World::new(&plan, inputs, Host::default()).unwrap();
            let sky = &world.subject.sky;
            for (value, normal) in
                values_of(&world, &plan).into_iter().zip(normals)
            {
                let exact = irradiance(|w| sky.radiance(w), normal);
                chance.judge(value, exact, 16.);
            }
        }
    }
}

#[test]
fn the_sun_stands_where_its_angles_say() {
    for (sun, direction) in [
        (Sun::At(0., 0.), DVec3::Y),
        (Sun::At(90., 0.), DVec3::X),
        (Sun::At(180., 90.), DVec3::Z),
        (Sun::Toward(DVec3::new(0., 0., 3.)), DVec3::Z),
    ] {
        assert!((sun.direction(DVec3::Z) - direction).length() < 1e-15);
    }
    // Where y is up, north is -z and east is x
    let north = Sun::At(0., 0.).direction(DVec3::Y);
    assert!((north - DVec3::NEG_Z).length() < 1e-15);
}

#[test]
fn skies_that_are_none_are_refused() {
    let place = Scratch::new();
    place.put("cube.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    place.put("p.txt", "0 0 1 0 0 1\n");
    for (words, fault) in [
        ("--sky cie:0", "a type from 1 to 16"),
        ("--sky cie:17", "a type from 1 to 16"),
        ("--sky perez:0.5,0.1", "a clearness from 1 on"),
        ("--sky clear", "expected uniform, overcast"),
        ("--sky cie:12", "needs the direction to the sun, --sun"),
        ("--sky cie:12 --sun 10", "X,Y,Z or AZIMUTH,ALTITUDE"),
        ("--sky cie:12 --sun 10,95", "an altitude above 0"),
        ("--sky cie:12 --sun 0,0,-1", "a sun above the horizon"),
        ("--sky perez:8,0.3 --sun 0,30", "without bound at the horizon"),
        ("--sky perez:1.3,1.5 --sun 0,90", "negative in a part of the sky"),
        (
            "--sky perez:1.1,0.05 --sun 0,10",
            "negative in a part of the sky",
        ),
        ("--sky sphere --ground-glow 0.2", "its own light below"),
        ("--sky uniform --sun 0,0", "an altitude above 0"),
        ("--ground-glow 0.2 --ground 0.2", "cannot be used with"),
        ("--ground-glow 2", "an albedo between 0 and 1"),
    ] {
        let run =
            place.free(&format!("cube.obj -n1 --points=p.txt {words}"));
        run.failed(2, &[fault]);
    }
}
