// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! View factors, daylight coefficients and derivatives: closed forms, errors,
//! the same bits in all ways, and the files that hold them.

use crate::prelude::*;

use litpt::film::Entry;
use litpt::key::Part;
use litpt::matrix::closed::Closed;
use litpt::matrix::daylight::{Daylight, Demand, SkyMatrix, Year};
use litpt::matrix::{Cell, Matrix};
use litpt::run::Run;
use litpt::state::shards;
use litpt::tally::patches::Patches;
use litpt::tally::{Surface, Tally};

const FACES: SensorPlan =
    SensorPlan::Faces { side: Side::Front, radiosity: false };

/// A plan for a tally of so many samples.
fn plan(sensor: SensorPlan, tally: Tally, samples: u64) -> Plan {
    let (tally, budget) = (Some(tally), Budget::samples(samples));
    let mut plan = Plan { sensor, tally, budget, ..Plan::default() };
    plan.surfaces.albedo = 0.5;
    plan
}

/// The world of a text in OBJ, with a point that looks up.
fn world(text: &str, plan: &Plan, point: DVec3) -> World {
    let mesh = read_obj(text.as_bytes()).unwrap();
    let inputs = Inputs::from(mesh).with_points([(point, DVec3::Z)]);
    World::new(plan, inputs, Host::default()).unwrap()
}

/// What a plan finds in a world.
fn film(world: &World, plan: &Plan) -> Film {
    let run = Run::new(world, plan, Host::default()).unwrap();
    run.render(&Interrupt::default()).unwrap().film
}

/// The rows of a matrix.
fn rows(matrix: &Matrix) -> Vec<Vec<Cell>> {
    (0..matrix.height()).map(|row| matrix.row(row).unwrap()).collect()
}

/// A rectangle with a corner and two sides, as text of an OBJ.
fn rectangle(corner: DVec3, across: DVec3, up: DVec3) -> String {
    let places =
        [corner, corner + across, corner + across + up, corner + up];
    let lines = places.map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
    lines.concat() + "f -4 -3 -2 -1\n"
}

/// A disc of radius 1 at a height, seen from above or from below.
fn disc(height: f64, looks_up: bool) -> String {
    let n = 720;
    let vertex = |k: i32| {
        let turn = f64::from(k) / f64::from(n) * TAU;
        let turn = if looks_up { turn } else { -turn };
        format!("v {} {} {height}\n", turn.cos(), turn.sin())
    };
    let corners = (1..=n).map(|k| format!(" {}", k - n - 1));
    let face = format!("f{}\n", corners.collect::<String>());
    (0..n).map(vertex).collect::<String>() + &face
}

#[test]
fn view_factors_are_those_of_closed_forms() {
    let chance = &mut Chance::default();
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let squares =
        |d: f64| rectangle(DVec3::ZERO, x, y) + &rectangle(z * d, y, x);
    let corner = rectangle(DVec3::ZERO, 3. * x, y)
        + &rectangle(DVec3::ZERO, 2. * z, 3. * x);
    // A street of width 2 with walls of height 3, crossed strings
    let long = 4e4 * y;
    let street = rectangle(-0.5 * long, long, -2. * x)
        + &rectangle(-0.5 * long, 3. * z, long);
    let wall_share = 0.5 * (1. + 1.5 - 3.25f64.sqrt());
    // A square half as wide in the middle: the integral over both squares is
    // one over their points' difference, by quadrature
    let middle = 0.25 * (x + y) + 0.5 * z;
    let obstructed = squares(1.) + &rectangle(middle, 0.5 * x, 0.5 * y);
    for (text, exact) in [
        (squares(0.1), 0.826_994_522),
        (squares(10.), 0.003_162_057),
        (corner, 0.318_996_701),
        (disc(0., true) + &disc(1., false), 0.381_966_011),
        (street, wall_share),
        (obstructed, 0.099_506_295),
    ] {
        let plan = plan(FACES, Tally::ViewFactors(Surface::Faces), 1 << 20);
        let world = world(&text, &plan, z);
        let film = film(&world, &plan);
        let rows = rows(&world.matrix(&film).unwrap());
        for row in &rows {
            let sum: f64 = row.iter().map(|cell| cell.1).sum();
            assert!((sum - 1.).abs() <= 1e-12, "{sum}");
        }
        let (_, value, error) = rows[0].iter().find(|c| c.0 == 1).unwrap();
        assert!(*error <= 3e-4, "{error}");
        chance.judge([*value, *error], exact, 64.);
    }
}

/// A cube whose sides face inwards.
const CUBE: &str = "\
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
g floor\nf 1 2 3 4\ng sky\nf 8 7 6 5\ng walls\nf 1 5 6 2\nf 2 6 7 3\n\
f 3 7 8 4\nf 4 8 5 1\n";

#[test]
fn a_cube_sees_each_side_as_its_closed_form_says() {
    let chance = &mut Chance::default();
    let (opposite, beside) = (0.199_824_896, 0.200_043_776);
    let whole = plan(FACES, Tally::ViewFactors(Surface::Faces), 1 << 14);
    let world = world(CUBE, &whole, DVec3::Z);
    let film = film(&world, &whole);
    let mut matrix = world.matrix(&film).unwrap();
    let pairs = [1, 0, 4, 5, 2, 3];
    for (i, row) in rows(&matrix).into_iter().enumerate() {
        assert_eq!(row.len(), 5);
        for (column, value, error) in row {
            let faces = column == pairs[i];
            let exact = if faces { opposite } else { beside };
            chance.judge([value, error], exact, 32.);
        }
    }
    matrix.close().unwrap();
    let closed = rows(&matrix);
    for (i, row) in closed.iter().enumerate() {
        let sum: f64 = row.iter().map(|cell| cell.1).sum();
        assert!((sum - 1.).abs() <= 1e-12, "{sum}");
        for &(j, value, _) in row {
            let back = closed[j as usize].iter().find(|c| c.0 == i as u32);
            assert_eq!(value, back.unwrap().1);
        }
    }
    let [most, mean] = matrix.closed.unwrap().moves;
    assert!(0.1 < mean && mean < 1.5 && most < 6., "{most} {mean}");
}

#[test]
fn columns_are_named_and_gathered_as_the_file_names_its_faces() {
    let tally = Tally::ViewFactors(Surface::Groups);
    let points = SensorPlan::Points("points".into());
    let plan = plan(points, tally, 1 << 12);
    let world = world(CUBE, &plan, DVec3::splat(0.5));
    let film = film(&world, &plan);
    let matrix = world.matrix(&film).unwrap();
    let names = (0..matrix.columns.count).map(|k| matrix.columns.name(k));
    let names: Vec<_> = names.collect();
    assert_eq!(
        names,
        ["floor", "named sky", "walls", "unnamed", "sky", "ground"]
    );
    let row = matrix.row(0).unwrap();
    let columns: Vec<_> = row.iter().map(|cell| cell.0).collect();
    assert_eq!(columns, [1, 2]);
    // A square at half its side: 4 times a corner of half the side
    let chance = &mut Chance::default();
    let a = 0.5f64.sqrt();
    let exact = 4. / PI * a * 0.5f64.sqrt().atan();
    assert!((exact - 0.554).abs() < 1e-3, "{exact}");
    chance.judge([row[0].1, row[0].2], exact, 32.);
}

#[test]
fn both_sides_of_a_face_are_two_rows_and_two_columns() {
    let sensor = SensorPlan::Faces { side: Side::Both, radiosity: false };
    let plan = plan(sensor, Tally::ViewFactors(Surface::Faces), 1 << 10);
    let world = world(CUBE, &plan, DVec3::Z);
    let film = film(&world, &plan);
    let matrix = world.matrix(&film).unwrap();
    assert_eq!((matrix.height(), matrix.columns.count), (12, 14));
    assert_eq!(matrix.name(3), "2 back");
    assert_eq!(matrix.columns.name(3), "2 back");
    for (i, row) in rows(&matrix).into_iter().enumerate() {
        // Fronts see fronts; backs see the sky and the ground
        let is_front = i % 2 == 0;
        for (column, ..) in row {
            assert_eq!(column < 12, is_front);
            assert!(column >= 12 || column % 2 == 0);
        }
    }
}

#[test]
fn the_rows_of_few_samples_are_complete() {
    for samples in [1, 16, 63] {
        let tally = Tally::ViewFactors(Surface::Faces);
        let plan = plan(FACES, tally, samples);
        let world = world(CUBE, &plan, DVec3::Z);
        let film = film(&world, &plan);
        for row in rows(&world.matrix(&film).unwrap()) {
            let sum: f64 = row.iter().map(|cell| cell.1).sum();
            assert!((sum - 1.).abs() <= 1e-12, "{sum}");
        }
    }
}

#[test]
fn a_face_above_shows_its_back() {
    let square = |z: f64| rectangle(z * DVec3::Z, DVec3::X, DVec3::Y);
    let text = square(0.) + &square(0.1);
    let columns = |row: &Vec<Cell>| -> Vec<u32> {
        row.iter().map(|cell| cell.0).collect()
    };
    for (surface, expected) in [
        (Surface::Faces, [vec![3, 4], vec![5], vec![4], vec![0, 5]]),
        (Surface::Groups, [vec![0, 1], vec![2], vec![1], vec![0, 2]]),
    ] {
        let side = Side::Both;
        let sensor = SensorPlan::Faces { side, radiosity: false };
        let plan = plan(sensor, Tally::ViewFactors(surface), 1 << 10);
        let world = world(&text, &plan, DVec3::Z);
        let film = film(&world, &plan);
        let rows = rows(&world.matrix(&film).unwrap());
        let seen: Vec<_> = rows.iter().map(columns).collect();
        assert_eq!(seen, expected);
    }
}

/// The sums of a plan as a state holds them.
fn state(world: &World, plan: &Plan, threads: usize) -> Vec<u8> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    let film = pool.build().unwrap().install(|| film(world, plan));
    let mut bytes = vec![];
    film.write(&mut bytes).unwrap();
    bytes
}

#[test]
fn threads_and_parts_change_no_bit_of_a_row() {
    for (tally, method) in [
        (Tally::ViewFactors(Surface::Faces), Method::Sobol),
        (Tally::SkyPatches(2), Method::Sobol),
        (Tally::SkyPatches(1), Method::Gather),
    ] {
        let mut text = CUBE.to_owned();
        text.truncate(text.len() - "f 4 8 5 1\n".len());
        let mut whole = plan(FACES, tally, 1 << 11);
        whole.method = Some(method);
        let world = world(&text, &whole, DVec3::Z);
        let bytes = state(&world, &whole, 1);
        assert_eq!(bytes, state(&world, &whole, 3));
        // Add up two parts
        let of = 1 << 11;
        let parts = [(0, 640), (640, of)].map(|samples| {
            let part = Some(Part { samples, of, band: (1, 1) });
            let plan = Plan { part, ..whole.clone() };
            let run = Run::new(&world, &plan, Host::default()).unwrap();
            let (run_key, report) = (run.key.clone(), run.report());
            let rendered = run.render(&Interrupt::default()).unwrap();
            let (learnt, rows) = (Arc::default(), world.rows());
            let mut report = report;
            report.convergence = rendered.convergence;
            let plan = plan.clone();
            let record = RunRecord { run_key, plan, report, rows, learnt };
            let mut bytes = vec![];
            save(&record, &rendered.film, &mut bytes).unwrap();
            Checkpoint::open(Cursor::new(bytes))
        });
        let merged = shards::merge(parts).unwrap();
        assert_eq!(merged.record.rows, world.rows());
        let mut sum = vec![];
        merged.film.write(&mut sum).unwrap();
        assert!(sum == bytes);
    }
}

/// Rows of view factors as so many samples of each face find them, given the
/// exchanges of faces, and last with the sky.
fn counted(
    exchange: &[Vec<f64>],
    areas: &[f64],
    samples: u32,
    random: &mut Pcg64,
) -> Vec<Vec<Cell>> {
    let row = |(exchange, area): (&Vec<f64>, &f64)| {
        let mut counts = vec![0; exchange.len()];
        for _ in 0..samples {
            let mut rest = area * random.random::<f64>();
            let seen = exchange.iter().position(|x| {
                rest -= x;
                rest < 0.
            });
            counts[seen.unwrap_or(exchange.len() - 1)] += 1;
        }
        let cell = |(j, count): (u32, u32)| {
            let factor = f64::from(count) / f64::from(samples);
            let square = factor * (1. - factor) / f64::from(samples);
            (count > 0).then(|| (j, factor, square.sqrt()))
        };
        (0..).zip(counts).filter_map(cell).collect()
    };
    exchange.iter().zip(areas).map(row).collect()
}

// Entries of few samples are as often too large as too small.
#[test]
fn closing_moves_no_mean() {
    let mut random = Pcg64::seed_from_u64(8);
    let n = 30;
    let mut exchange = vec![vec![0.; n + 1]; n];
    let pairs = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
    for (i, j) in pairs {
        let value = 0.02 * random.random::<f64>();
        (exchange[i][j], exchange[j][i]) = (value, value);
    }
    exchange.iter_mut().for_each(|row| row[n] = 0.7);
    let areas: Vec<f64> =
        exchange.iter().map(|row| row.iter().sum()).collect();
    let sky_sum: f64 = (0..n).map(|i| exchange[i][n] / areas[i]).sum();
    let exact = [n as f64 - sky_sum, sky_sum];
    let mut off = [Accumulator::default(); 2];
    for _ in 0..60 {
        let rows = counted(&exchange, &areas, 400, &mut random);
        let row = |i: usize| Some(rows[i].clone());
        let closed = Closed::new(&areas, &row, &|_| 400).unwrap();
        let mut sums = [0.; 2];
        for (j, value, _) in (0..n).flat_map(|i| closed.row(i).unwrap()) {
            sums[usize::from(j as usize == n)] += value;
        }
        for k in 0..2 {
            off[k].add(sums[k] / exact[k] - 1.);
        }
    }
    let chance = &mut Chance::default();
    for off in off {
        chance.judge([off.mean(), off.standard_error()], 0., 60.);
    }
}

#[test]
fn closing_finds_the_nearest_matrix_of_random_ones() {
    let mut random = Pcg64::seed_from_u64(7);
    for n in [2, 5, 40] {
        // A true symmetric exchange, and rows that scatter around it
        let mut exchange = vec![vec![0.; n + 1]; n];
        let pairs = (0..n).flat_map(|i| (i + 1..=n).map(move |j| (i, j)));
        for (i, j) in pairs {
            let value = random.random();
            exchange[i][j] = value;
            if j < n {
                exchange[j][i] = value;
            }
        }
        let areas: Vec<f64> =
            exchange.iter().map(|row| row.iter().sum()).collect();
        let rows = counted(&exchange, &areas, 4096, &mut random);
        let row = |i: usize| Some(rows[i].clone());
        let closed = Closed::new(&areas, &row, &|_| 4096).unwrap();
        for i in 0..n {
            let cells = closed.row(i).unwrap();
            let sum: f64 = cells.iter().map(|cell| cell.1).sum();
            assert!((sum - 1.).abs() <= 1e-12);
            for (j, value, _) in cells {
                assert!(value > 0.);
                if (j as usize) < n {
                    let back = closed.row(j as usize).unwrap();
                    let back =
                        back.iter().find(|c| c.0 as usize == i).unwrap();
                    let ratio =
                        areas[j as usize] * back.1 / (areas[i] * value);
                    assert!((ratio - 1.).abs() < 1e-12);
                }
            }
        }
        assert!(closed.moves[0] < 8. && closed.moves[1] < 1.);
    }
    // The nearest matrix by hand
    let error = |factor: f64| (factor * (1. - factor) / 2000.).sqrt();
    let cell = |(j, factor)| (j, factor, error(factor));
    let rows = [[(1, 0.30), (2, 0.70)], [(0, 0.14), (2, 0.86)]];
    let row = |i: usize| Some(rows[i].map(cell).to_vec());
    let closed = Closed::new(&[1., 2.], &row, &|_| 2000).unwrap();
    let [v, a, b] = [0.88 / 9000., 0.7 / 2000., 1.72 / 1000.];
    let [lacks, excess] = [1. / 150., -2. / 150.];
    let determinant = (v + a) * (v + b) - v * v;
    let first = ((v + b) * lacks - v * excess) / determinant;
    let second = ((v + a) * excess - v * lacks) / determinant;
    let pair = 0.88 / 3. + v * (first + second);
    let [sky, other] = [0.7 + a * first, 1.72 + b * second];
    let exact = [[pair, sky], [pair / 2., other / 2.]];
    for (i, exact) in exact.into_iter().enumerate() {
        for ((_, value, _), exact) in
            closed.row(i).unwrap().into_iter().zip(exact)
        {
            assert!((value - exact).abs() < 1e-12, "{value}, not {exact}");
        }
    }
    let moved = |(old, new): (f64, f64)| (new - old).abs() / error(old);
    let old = [0.30, 0.70, 0.14, 0.86].into_iter();
    let moves: Vec<f64> = old.zip(exact.concat()).map(moved).collect();
    let most = moves.iter().copied().fold(0., f64::max);
    let mean = moves.iter().sum::<f64>() / 4.;
    assert!((closed.moves[0] - most).abs() < 1e-9);
    assert!((closed.moves[1] - mean).abs() < 1e-9);
    // Two faces that see nothing but each other have one area
    let rows = [vec![(1, 1., 0.)], vec![(0, 1., 0.)]];
    let row = |i: usize| Some(rows[i].clone());
    assert!(Closed::new(&[1., 2.], &row, &|_| 100).is_err());
}

/// The integral of the cosine over each patch of the sky, for a horizontal
/// surface; 0 below the horizon.
fn cosines(factor: u32) -> Vec<f64> {
    let rings = [30, 30, 24, 24, 18, 12, 6].into_iter();
    let rings = rings.flat_map(|n| vec![factor * n; factor as usize]);
    let height = PI / 2. / (7. * f64::from(factor) + 0.5);
    let mut cosines = vec![0.];
    let mut low = 0.;
    for (n, row) in rings.chain([1]).zip(1..) {
        let top = f64::min(f64::from(row) * height, PI / 2.).sin().powi(2);
        let each = PI / f64::from(n) * (top - low);
        cosines.extend(vec![each; n as usize]);
        low = top;
    }
    cosines
}

#[test]
fn an_open_sensor_gets_each_patch_as_its_closed_form_says() {
    let chance = &mut Chance::default();
    let speck = "v 0 0 0\nv 1e-3 0 0\nv 0 1e-3 0\nf 1 2 3\n";
    for (factor, count) in [(1, 146), (2, 578), (4, 2306)] {
        let points = SensorPlan::Points("points".into());
        let plan = plan(points, Tally::SkyPatches(factor), 1 << 16);
        let world = world(speck, &plan, 9. * DVec3::Z);
        let film = film(&world, &plan);
        let matrix = world.matrix(&film).unwrap();
        let patches = Patches::new(factor, DVec3::Z);
        assert_eq!((patches.count(), matrix.columns.count), (count, count));
        let row = matrix.row(0).unwrap();
        let sum: f64 = row.iter().map(|cell| cell.1).sum();
        assert!((sum - PI).abs() < 1e-9 * PI, "{sum}");
        let exact = cosines(factor);
        assert_eq!(exact.len(), count as usize);
        assert!((exact.iter().sum::<f64>() - PI).abs() < 1e-12);
        for (column, value, error) in row {
            chance.judge([value, error], exact[column as usize], 32.);
        }
    }
}

/// Directions, and their patches for factors 1, 2 and 4 as Radiance's
/// `rcalc -f reinhartb.cal` numbers them.
const NUMBERED: &[([f64; 3], [u32; 3])] = &[
    ([-0.881553, 0.360811, 0.304434], [55, 170, 698]),
    ([-0.782906, -0.466937, 0.411130], [77, 221, 921]),
    ([0.950720, -0.302555, 0.067761], [10, 19, 157]),
    ([0.953334, 0.281277, 0.109713], [7, 73, 146]),
    ([-0.278094, 0.625094, 0.729329], [107, 430, 1627]),
    ([0.108160, -0.980465, 0.164288], [15, 90, 299]),
    ([-0.959852, 0.210661, 0.185217], [25, 108, 455]),
    ([-0.798436, -0.600340, 0.045744], [20, 40, 79]),
    ([-0.506278, -0.763433, 0.401064], [49, 217, 912]),
    ([-0.376659, -0.421449, 0.824929], [120, 455, 1845]),
    ([-0.780584, 0.034253, 0.624111], [103, 373, 1418]),
    ([-0.750967, -0.151205, 0.642795], [102, 371, 1414]),
    ([-0.227868, -0.513696, 0.827159], [119, 453, 1842]),
    ([-0.223557, -0.968027, 0.113784], [17, 93, 305]),
    ([0.554181, -0.801036, 0.226328], [43, 145, 529]),
    ([-0.057862, 0.867688, 0.493731], [61, 288, 1152]),
    ([0.768566, 0.489678, 0.411730], [65, 191, 860]),
    ([0.578963, -0.694619, 0.426974], [70, 260, 998]),
    ([0.076437, 0.890239, 0.449035], [61, 242, 962]),
    ([0.383462, -0.911736, 0.147291], [14, 87, 293]),
    ([0.006199, -0.919601, 0.392804], [46, 211, 901]),
    ([0.093679, -0.233557, 0.967820], [142, 558, 2182]),
    ([0.010518, 0.025878, 0.999610], [145, 577, 2282]),
    ([-0.879151, 0.284492, 0.382305], [55, 229, 937]),
    ([-0.281987, -0.834905, 0.472669], [74, 267, 1014]),
    ([-0.567734, 0.789933, 0.231698], [58, 175, 589]),
    ([0.705147, -0.525788, 0.475726], [69, 258, 995]),
    ([0.137585, 0.243141, 0.960184], [139, 531, 2165]),
    ([0.051536, -0.640243, 0.766441], [118, 451, 1680]),
    ([-0.679188, -0.328258, 0.656467], [101, 370, 1410]),
    ([-0.483352, -0.277520, 0.830273], [121, 493, 1849]),
    ([-0.798777, 0.404492, 0.445355], [81, 281, 1040]),
    ([-0.639514, -0.305493, 0.705476], [101, 418, 1602]),
    ([0.892287, -0.382559, 0.239737], [40, 140, 519]),
    ([0.765474, -0.009316, 0.643400], [91, 349, 1369]),
    ([0.611562, -0.741158, 0.276906], [43, 144, 648]),
];

#[test]
fn patches_are_numbered_as_radiance_does() {
    assert!(NUMBERED.len() > 20);
    for (k, factor) in [1, 2, 4].into_iter().enumerate() {
        let patches = Patches::new(factor, DVec3::Z);
        for (direction, numbers) in NUMBERED {
            let number = patches.number(DVec3::from(*direction));
            assert_eq!(number, numbers[k], "{direction:?}");
        }
    }
    // With y up, north is -z, and east stays +x
    let upright = Patches::new(1, DVec3::Z);
    let turned = Patches::new(1, DVec3::Y);
    for (direction, _) in NUMBERED {
        let [x, y, z] = *direction;
        let same = turned.number(DVec3::new(x, z, -y));
        assert_eq!(same, upright.number(DVec3::from(*direction)));
    }
}

/// A matrix of Radiance with 146 rows.
fn sky(
    steps: usize,
    format: &str,
    of: impl Fn(usize, usize) -> f64,
) -> Vec<u8> {
    let head = format!(
        "#?RADIANCE\ngendaymtx -m 1 -O0 a.wea\nNROWS=146\nNCOLS={steps}\n\
         NCOMP=3\nFORMAT={format}\n\n"
    );
    let mut bytes = head.into_bytes();
    for patch in 0..146 {
        for step in 0..steps {
            let value = of(patch, step);
            match format {
                "ascii" => {
                    writeln!(bytes, "{value} {value} {value}").unwrap()
                }
                "float" => {
                    bytes.extend([(value as f32).to_le_bytes(); 3].concat())
                }
                _ => bytes.extend([value.to_le_bytes(); 3].concat()),
            }
        }
        if format == "ascii" {
            bytes.push(b'\n');
        }
    }
    bytes
}

#[test]
fn a_year_follows_from_coefficients_and_a_sky() {
    let points = SensorPlan::Points("points".into());
    let plan = plan(points, Tally::SkyPatches(1), 1 << 12);
    let speck = "v 0 0 0\nv 1e-3 0 0\nv 0 1e-3 0\nf 1 2 3\n";
    let open = world(speck, &plan, 9. * DVec3::Z);
    let film = film(&open, &plan);
    let rows = open.rows();
    let daylight = Daylight { film: &film, rows: &rows, columns: 146 };
    let replicates = daylight.replicates(0).unwrap();
    assert_eq!(replicates.len(), 32);
    let parts: f64 = replicates.iter().map(|(part, _)| part).sum();
    assert!((parts - 1.).abs() < 1e-12);
    // The mean of the replicates is the row of the matrix
    let matrix = open.matrix(&film).unwrap();
    for (column, value, _) in matrix.row(0).unwrap() {
        let term =
            |(part, row): &(f64, Vec<f64>)| part * row[column as usize];
        let mean: f64 = replicates.iter().map(term).sum();
        assert!((mean - value).abs() < 1e-12);
    }
    // A uniform sky that gives k lux in step k
    for format in ["ascii", "float", "double"] {
        let lux = |patch: usize, step: usize| match patch {
            0 => 1e6,
            _ => step as f64 / (179. * PI),
        };
        let sky = SkyMatrix::read(&sky(1000, format, lux)).unwrap();
        let demand =
            Demand { enough: 300.5, useful: [100.5, 900.5], hours: 0.5 };
        let steps: Vec<_> = (0..1000).collect();
        let year = Year::new(&daylight, &sky, &steps, demand).unwrap();
        let [da, udi] = year.sensors[0].unwrap();
        assert_eq!((da.value, udi.value), (0.699, 0.8));
        assert_eq!(da.ends, [0.699; 2]);
        assert_eq!((year.spatial.value, year.spatial.ends), (1., [1.; 2]));
    }
}

#[test]
fn a_sky_that_is_none_is_refused() {
    let good = sky(2, "ascii", |_, _| 1.);
    let text = String::from_utf8(good.clone()).unwrap();
    for (bad, why) in [
        (text.replace("-O0", "-O1"), "solar"),
        (text.replace("FORMAT=ascii", "FORMAT=cieXYZ"), "FORMAT"),
        (text.replace("NCOLS=2", "NCOLS=3"), "numbers"),
        (text.replace("NCOLS=2", "NCOLS=-2"), "NCOLS"),
        (text.replace("NCOMP=3", "NCOMP=1"), "NCOMP"),
        (text.replace("NROWS=146", "NROWS=99999999999999"), "numbers"),
        (text.replace("NCOLS=2", "NCOLS=0"), "NCOLS is 0"),
        (text.replace("NCOMP=3", "BigEndian=1"), "BigEndian"),
        (text.replace("1 1 1", "1 x 1"), "no number"),
        ("#?RADIANCE".to_owned(), "NROWS is none"),
        (
            text.replacen("1 1 1", "1 nan 1", 1),
            "patch 0 in column 1 is NaN",
        ),
        (text.replacen("1 1 1", "1 -1 1", 1), "patch 0 in column 1 is -1"),
        (
            text.replacen("1 1 1", "1 1 inf", 1),
            "patch 0 in column 1 is inf",
        ),
    ] {
        let error = SkyMatrix::read(bad.as_bytes()).err().unwrap();
        assert!(error.to_string().contains(why), "{error}");
    }
    let mut float = sky(2, "float", |_, _| 1.);
    float.push(0);
    let error = SkyMatrix::read(&float).err().unwrap().to_string();
    assert!(error.contains("within a number"), "{error}");
    let windows = text.replace('\n', "\r\n");
    assert!(SkyMatrix::read(windows.as_bytes()).is_ok());
}

/// A room of 4 m x 3 m with a window in the west, before which slats stand.
fn slatted_room() -> String {
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let wall = |at: DVec3, across, up| rectangle(at, across, up);
    let mut text = wall(DVec3::ZERO, 4. * x, 3. * y)
        + &wall(2.5 * z, 3. * y, 4. * x)
        + &wall(DVec3::ZERO, 2.5 * z, 4. * x)
        + &wall(3. * y, 4. * x, 2.5 * z)
        + &wall(4. * x, 2.5 * z, 3. * y);
    // Leave a window of 1 m x 1 m
    text += &wall(DVec3::ZERO, 3. * y, z);
    text += &wall(2. * z, 3. * y, 0.5 * z);
    text += &wall(z, y, z);
    text += &wall(2. * y + z, y, z);
    for k in 0..8 {
        let at = DVec3::new(0.3, 1. + 0.13 * f64::from(k), 0.8);
        text += &wall(at, 0.15 * x, 1.4 * z);
    }
    text
}

/// Sensors in that room: beside the slats, behind them, and far away.
fn slatted_sensors() -> Vec<(DVec3, DVec3)> {
    let at = |x, y, z| DVec3::new(x, y, z);
    let west = -DVec3::X;
    vec![
        (at(0.6, 1.5, 0.9), DVec3::Z),
        (at(0.5, 0.9, 1.5), DVec3::Y),
        (at(1., 1.5, 1.5), west),
        (at(2., 1., 0.9), DVec3::Z),
        (at(3., 2., 0.9), DVec3::Z),
        (at(3.5, 0.5, 1.5), at(-0.6, 0.8, 0.)),
    ]
}

/// Runs of a plan with other seeds: the entries and the mean squares of their
/// errors. The training takes so many rays, if that is given.
fn runs(
    plan: &Plan,
    training: Option<u64>,
    seeds: u64,
) -> (Vec<Vec<f64>>, f64) {
    let mesh = read_obj(slatted_room().as_bytes()).unwrap();
    let inputs = Inputs::from(mesh).with_points(slatted_sensors());
    let world = World::new(plan, inputs, Host::default()).unwrap();
    let (mut tables, mut square) = (vec![], 0.);
    for seed in 0..seeds {
        let plan = Plan { seed, ..plan.clone() };
        let mut run = Run::new(&world, &plan, Host::default()).unwrap();
        if let Some(training) = training {
            let sampling = Sampling { training, ..run.key.sampling };
            let (setup, learnt) = (world.setup(), run.learnt.clone());
            run.renderer =
                setup.renderer(&sampling, learnt, &SingleProcess);
        }
        let film = run.render(&Interrupt::default()).unwrap().film;
        let matrix = world.matrix(&film).unwrap();
        let height = matrix.height();
        tables.push((0..height).flat_map(|k| matrix.dense(k)).collect());
        let mut squares = [0.; 2];
        for (pixel, row) in film.pixels.iter().zip(&film.rows) {
            for entry in Entry::joined(row, 146) {
                let error =
                    entry.standard_error(pixel.count(), film.net_size);
                squares[0] += (PI * error).powi(2);
            }
        }
        for (_, _, error) in rows(&matrix).concat() {
            squares[1] += error.powi(2);
        }
        // What is stated is the largest of three errors
        assert!(squares[0] < squares[1] && squares[1] <= 3. * squares[0]);
        square += squares[0];
    }
    (tables, square / seeds as f64)
}

/// Mean and variance of the mean of a part of each of some tables.
fn spread(tables: &[Vec<f64>], part: impl Fn(&[f64]) -> f64) -> [f64; 2] {
    let mut sum = Accumulator::default();
    tables.iter().for_each(|table| sum.add(part(table)));
    [sum.mean(), sum.standard_error().powi(2)]
}

/// A patch as bright as a sun that no path had met once had no error. By
/// Chebyshev's inequality at most 4 % may be farther than 5 errors away.
#[test]
fn light_of_a_patch_that_few_paths_meet_has_an_error() {
    let points = SensorPlan::Points("points".into());
    let mut plan = plan(points, Tally::SkyPatches(1), 1 << 18);
    plan.method = Some(Method::Sobol);
    let mesh = read_obj(slatted_room().as_bytes()).unwrap();
    let inputs = Inputs::from(mesh).with_points(slatted_sensors());
    let world = World::new(&plan, inputs, Host::default()).unwrap();
    let rows = world.rows();
    let is_sun = |patch, step| if patch == step + 1 { 1e4 } else { 1. };
    let sky = SkyMatrix::read(&sky(145, "double", is_sun)).unwrap();
    let steps: Vec<_> = (0..145).collect();
    let lux = |samples, seed| {
        let budget = Budget::samples(samples);
        let plan = Plan { seed, budget, ..plan.clone() };
        let film = &film(&world, &plan);
        let daylight = Daylight { film, rows: &rows, columns: 146 };
        let of_sensor = |sensor| -> Vec<_> {
            let light = daylight.illuminance(sensor, &sky, &steps).unwrap();
            light.lux.iter().copied().zip(light.standard_errors()).collect()
        };
        (0..rows.len()).flat_map(of_sensor).collect::<Vec<(f64, f64)>>()
    };
    let truth = lux(1 << 18, 99);
    let (mut far, mut all) = (0, 0);
    for seed in 0..8 {
        for (exact, value) in truth.iter().zip(lux(1 << 10, seed)) {
            let error = value.1.hypot(exact.1);
            far += usize::from((value.0 - exact.0).abs() > 5. * error);
            all += 1;
        }
    }
    assert!(25 * far <= all, "{far} of {all}");
}

/// Where one patch shines alone, the error is at least that of its
/// neighbours.
#[test]
fn the_light_of_a_patch_errs_as_its_neighbours_do() {
    let points = SensorPlan::Points("points".into());
    let plan = plan(points, Tally::SkyPatches(1), 1 << 10);
    let room = world(&slatted_room(), &plan, DVec3::new(1., 1.5, 0.9));
    let film = &film(&room, &plan);
    let daylight = Daylight { film, rows: &room.rows(), columns: 146 };
    let lone = |patch, step| f64::from(u8::from(patch == step + 1));
    let sky = SkyMatrix::read(&sky(145, "double", lone)).unwrap();
    let steps: Vec<_> = (0..145).collect();
    let light = daylight.illuminance(0, &sky, &steps).unwrap();
    let replicates = daylight.replicates(0).unwrap();
    let own = |step: usize| {
        let part = |(part, row): &(f64, Vec<f64>)| part * row[step + 1];
        let mean: f64 = replicates.iter().map(part).sum();
        let away = |it: &(f64, Vec<f64>)| (part(it) - it.0 * mean).powi(2);
        let n = replicates.len() as f64;
        let square: f64 = replicates.iter().map(away).sum();
        179. * (square * n / (n - 1.)).sqrt()
    };
    let errors = light.standard_errors();
    for (step, error) in errors.iter().enumerate().skip(1).take(143) {
        let least = own(step - 1).max(own(step)).max(own(step + 1));
        assert!(*error >= 0.999999 * least, "{step}: {error} {least}");
    }
}

/// A sensor to which no path has brought light is not certain to be dark.
#[test]
fn a_sensor_that_no_light_has_reached_has_an_error() {
    let points = SensorPlan::Points("points".into());
    let plan = plan(points, Tally::SkyPatches(1), 1 << 10);
    let closed = world(CUBE, &plan, DVec3::splat(0.5));
    let film = &film(&closed, &plan);
    let daylight = Daylight { film, rows: &closed.rows(), columns: 146 };
    let sky = SkyMatrix::read(&sky(1, "double", |_, _| 1.)).unwrap();
    let light = daylight.illuminance(0, &sky, &[0]).unwrap();
    // One path of 1024, to one patch, of which each has the radiance 1
    let exact = 179. * PI / 1024.;
    assert_eq!(light.lux, [0.]);
    assert!((light.standard_errors()[0] / exact - 1.).abs() < 1e-6);
}

// One has trained as usual, and another has learnt nothing, so that its
// corrections do all the work.
#[test]
fn gathered_coefficients_have_the_mean_of_those_in_nets() {
    let chance = &mut Chance::default();
    let points = SensorPlan::Points("points".into());
    let mut plan = plan(points, Tally::SkyPatches(1), 1 << 12);
    plan.method = Some(Method::Sobol);
    const SEEDS: u64 = 24;
    let (nets, _) = runs(&plan, None, SEEDS);
    plan.method = Some(Method::Gather);
    for (training, samples) in [(None, 1 << 10), (Some(0), 1 << 12)] {
        plan.budget = Budget::samples(samples);
        let (gathered, square) = runs(&plan, training, SEEDS);
        let mut judge = |part: &dyn Fn(&[f64]) -> f64| {
            let [a, b] = [&nets, &gathered].map(|t| spread(t, part));
            if a[0] > 0. {
                let error = (a[1] + b[1]).sqrt();
                chance.judge([b[0] - a[0], error], 0., SEEDS as f64);
            }
        };
        judge(&|table| table.iter().sum());
        for row in 0..6 {
            judge(&|table| table[146 * row..][..146].iter().sum());
        }
        for column in 0..146 {
            judge(&|table| table[column..].iter().step_by(146).sum());
        }
        // The errors that it states are those of its entries
        let variance = |k| SEEDS as f64 * spread(&gathered, |t| t[k])[1];
        let variance: f64 = (0..6 * 146).map(variance).sum();
        let ratio = square / variance;
        assert!((0.6..1.6).contains(&ratio), "{training:?}: {ratio}");
    }
}

#[test]
fn rows_are_gathered_where_that_gains() {
    let at = |height: f64| vec![(height * DVec3::Z, DVec3::Z)];
    let method = |text: &str, points, factor, samples| {
        let sensor = SensorPlan::Points("points".into());
        let plan = plan(sensor, Tally::SkyPatches(factor), samples);
        let inputs = Inputs::from(read_obj(text.as_bytes()).unwrap());
        let inputs = inputs.with_points(points);
        let world = World::new(&plan, inputs, Host::default()).unwrap();
        let run = Run::new(&world, &plan, Host::default()).unwrap();
        run.key.sampling.method
    };
    let (room, speck) =
        (slatted_room(), "v 0 0 0\nv 1e-3 0 0\nv 0 1e-3 0\nf 1 2 3\n");
    let inside = slatted_sensors;
    let long = 1 << 15;
    assert_eq!(method(&room, inside(), 1, long), Method::Gather);
    assert_eq!(method(&room, inside(), 2, long), Method::Gather);
    assert_eq!(method(&room, inside(), 4, long), Method::Sobol);
    assert_eq!(method(&room, inside(), 1, 1 << 9), Method::Sobol);
    assert_eq!(method(speck, at(9.), 1, 1 << 18), Method::Sobol);
}

#[test]
fn a_state_of_gathered_rows_goes_on_by_its_method() {
    let place = Scratch::new();
    place.put("room.obj", slatted_room());
    place.put("points.txt", "2 1 0.9 0 0 1\n3 2 0.9 0 0 1\n");
    let line = "room.obj --points=points.txt --sky-patches=1 -r0.5 -q";
    let gather = format!("{line} --integrator=gather");
    let half = format!("{gather} -n2048 --checkpoint=c.litpt");
    place.free(&format!("{half} -o a.csv")).succeeded();
    // Go on with the same cache, but not by another method
    let on = "--resume=c.litpt -n4096 -qfo b.csv";
    place.free(on).succeeded();
    assert!(place.get("a.csv") != place.get("b.csv"));
    let other = "--resume=c.litpt -n9999 --integrator=sobol -qfo d.csv";
    place.free(other).failed(1, &["another run", "gather"]);
    let sample = format!("{gather} -n64 --sample=0,0,0");
    place.free(&sample).failed(2, &["not along one path"]);
}

// A part has a share of the sensors; hours and skies that are none are told.
#[test]
fn a_year_of_a_part_is_that_of_its_sensors() {
    let place = Scratch::new();
    place.put("cube.obj", CUBE);
    let point = |k: i32| format!("0.5 0.5 0.{k} 0 0 1\n");
    place.put("points.txt", (100..400).map(point).collect::<String>());
    place.put("sky.smx", sky(24, "ascii", |_, _| 1.));
    let line = "cube.obj --points=points.txt --sky-patches=1 -n512";
    place.free(&format!("{line} --tiles=2/2 -qo part.litpt")).succeeded();
    let year = |words: &str| {
        place.ptimg(&format!("daylight part.litpt sky.smx {words}"))
    };
    let said = year("").succeeded().text();
    let pipe = "$PTIMG daylight part.litpt - < sky.smx";
    assert_eq!(place.shell(pipe).succeeded().text(), said);
    year("--part 7%").told(&["lux in 7 % of 10 hours"]);
    let rows = said.lines().skip(1).map(|line| line.split(',').next());
    let rows: Vec<_> = rows.flatten().collect();
    assert!(!rows.is_empty() && rows.len() < 300, "{rows:?}");
    year("--hours 22..6").failed(1, &["--hours 22..6: neither hours"]);
    place.put("sky.smx", sky(8808, "ascii", |_, _| 1.));
    year("").failed(1, &["not the hours of whole days"]);
}

// A wall that sees the back of an awning, which does not see the wall.
#[test]
fn closing_warns_of_faces_that_contradict_each_other() {
    let place = Scratch::new();
    let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
    let text = rectangle(DVec3::ZERO, x, y) + &rectangle(z, x, y);
    place.put("awning.obj", text);
    let line = "awning.obj --faces --view-factors=faces --closed -n4096";
    let said = place.free(&format!("{line} -o a.csv"));
    said.told(&["does one see the back of another (--faces=both)?"]);
    let both = line.replace("--faces ", "--faces=both ");
    let said = place.free(&format!("{both} -o b.csv"));
    assert!(!said.stderr.contains("back of another"), "{}", said.stderr);
}

#[test]
fn the_derivative_is_that_of_a_closed_form() {
    let chance = &mut Chance::default();
    let mesh = cavity(0.2, 128);
    let point = DVec3::new(0., 0., -0.9);
    let up = polygon_share(point, DVec3::Z, &mesh.vertices[..256]);
    let text = obj(&mesh).replacen("f ", "g wall\nf ", 1);
    for albedo in [0.05, 0.5, 0.9] {
        let points = SensorPlan::Points("points".into());
        let mut plan =
            plan(points, Tally::Derivative("wall".into()), 1 << 12);
        plan.surfaces.albedo = albedo;
        let world = world(&text, &plan, point);
        let film = film(&world, &plan);
        let slope = world.matrix(&film).unwrap().first_cells()[0];
        let rest = 1. - 0.8 * albedo;
        chance.judge(slope, (1. - up) * 0.2 / rest.powi(2), 32.);
    }
}

#[test]
fn wrong_tallies_are_refused_in_words() {
    let place = Scratch::new();
    place.put("cube.obj", CUBE);
    place.put("points.txt", "0.5 0.5 0.5 0 0 1\n");
    for (line, words) in [
        ("--view-factors=faces", "required"),
        ("--vertices --view-factors=faces", "not vertices"),
        ("--faces --radiosity --view-factors=faces", "radiosity"),
        (
            "--faces --view-factors=faces --sky=overcast",
            "needs the uniform sky",
        ),
        ("--faces --view-factors=faces --integrator=gather", "sobol"),
        ("--faces --view-factors=rooms", "--view-factors"),
        ("--faces --view-factors=faces --error=1%", "absolute"),
        ("--faces --view-factors=groups --closed", "--closed"),
        ("--points=points.txt --view-factors=faces --closed", "--closed"),
        ("--faces --closed", "--closed"),
        ("--faces --view-factors=faces -o a.ply", "a.ply"),
        ("--faces --view-factors=groups -o a.vf", "a.vf"),
        ("--points=points.txt --sky-patches=3", "1, 2 or 4"),
        (
            "--points=points.txt --sky-patches=4 --integrator=gather",
            "sobol alone",
        ),
        (
            "--faces --sky-patches=1 --integrator=reference",
            "by the methods sobol and gather alone",
        ),
        ("--points=points.txt --sky-patches=1 -o a.vf", ".mtx"),
        (
            "--points=points.txt --sky-patches=1 --derivative=floor",
            "used with",
        ),
        ("--faces --derivative=roof", "no material, group or object"),
        ("--faces -r0 --derivative=floor", "albedo is 0"),
    ] {
        let run = place.free(&format!("cube.obj -n64 {line}"));
        let status = if line.contains("--derivative=roof") { 1 } else { 2 };
        run.failed(status, &[words]);
    }
    place.holds_only(&["cube.obj", "points.txt"]);
}
