// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What holds of all scenes and cameras, tried by chance (chapter "Stiff and
//! extreme cases"). `make fuzz` goes on for a minute.

use crate::prelude::*;

use std::array::from_fn;
use std::env;
use std::sync::Mutex;
use std::sync::atomic::AtomicUsize;

use glam::DQuat;
use litpt_book::escapes::{point, uniform};
use litpt_book::oracle::{Mixture, Seen, Shape, power};
use litpt_book::settings::{Outcome, Setting};
use proptest::collection::vec;
use proptest::prelude::{
    BoxedStrategy, Just, Strategy, any, prop_compose, prop_oneof,
};
use proptest::sample::select;
use proptest::test_runner::{Config, RngSeed, TestRunner};
use rand::seq::IndexedRandom;

pub type Random = Pcg64Mcg;

/// What is tried.
#[derive(Clone, Debug)]
struct Case {
    /// Shapes with their sizes and turns.
    objects: Vec<(Shape, f64, DQuat)>,
    /// Triangles with corners of all kinds, mostly none.
    wild: Vec<Triangle>,
    /// By what all is scaled and then moved.
    factor: DVec3,
    offset: DVec3,
    albedo: f64,
    resolution: (u32, u32),
    samples: u64,
    /// The exponent by which scene and camera are scaled to try again.
    again: i32,
    /// Of what is chosen where the scene is known.
    seed: u64,
}

/// How many cases have been tried, and of what kind.
#[derive(Debug, Default)]
struct Tally {
    cases: AtomicUsize,
    /// Cameras that were refused.
    refused: AtomicUsize,
    /// Images from inside a closed solid.
    dark: AtomicUsize,
    /// Images that were made again at another scale.
    scaled: AtomicUsize,
    paths: Mutex<Seen>,
}

// -------------------------------------------------------------------- Shapes

/// Those of the book that are small and have no cracks.
static CLOSED: LazyLock<Vec<Shape>> = LazyLock::new(|| {
    let all = solids::all().into_iter().filter(|solid| {
        solid.scene.triangles.corners.len() < 1300 && !solid.has_cracks()
    });
    let shrink = |p: DVec3| p / 4096.;
    let shape = |solid: solids::Solid| Shape {
        triangles: solid.own().iter().map(|t| t.map(shrink)).collect(),
        inside: solid.cameras.into_iter().map(shrink).collect(),
    };
    all.map(shape).collect()
});

/// A point of a cube around the origin.
fn corner() -> impl Strategy<Value = DVec3> + Clone {
    [-1f64..1., -1f64..1., -1f64..1.].prop_map(DVec3::from)
}

fn corners() -> impl Strategy<Value = Triangle> + Clone {
    [corner(), corner(), corner()]
}

/// A power of ten.
fn ten_to(from: f64, to: f64) -> impl Strategy<Value = f64> + Clone {
    (from..to).prop_map(|exponent| 10f64.powf(exponent))
}

fn open(
    triangles: impl Strategy<Value = Vec<Triangle>> + 'static,
) -> BoxedStrategy<Shape> {
    let shape = |triangles| Shape { triangles, inside: vec![] };
    triangles.prop_map(shape).boxed()
}

fn shapes() -> impl Strategy<Value = Shape> {
    let small = (corner(), corners(), ten_to(-12., 0.))
        .prop_map(|(at, corners, size)| corners.map(|p| at + size * p));
    let needle = (corner(), corner(), corner(), ten_to(-20., 0.))
        .prop_map(|(a, b, p, width)| [a, b, a + width * p]);
    // Few different coordinates: shared, coplanar and coincident triangles.
    let whole = || (-1..3).prop_map(f64::from);
    let place = move || [whole(), whole(), whole()].prop_map(DVec3::from);
    let whole = [place(), place(), place()];
    // One triangle again and again, exactly or almost.
    let by = select(vec![0., 1e-16, 1e-9, 1e-7, 1e-5]);
    let copies = (corners(), by, vec(corners(), 1..100)).prop_map(
        |(one, by, all)| {
            let near = |t: Triangle| from_fn(|i| one[i] + by * t[i]);
            all.into_iter().map(near).collect()
        },
    );
    // Each around the one before, about a corner or the middle.
    let tilt = select(vec![0., 1e-6, 0.1]);
    let nested = (corners(), any::<bool>(), corner(), tilt, 1..300)
        .prop_map(|([a, b, c], in_corner, tilt, by, n)| {
            let about = if in_corner { a } else { (a + b + c) / 3. };
            let one = |i| {
                let share = f64::from(i) / f64::from(n);
                let moved = |p| (p - about + tilt * by) * share;
                [a, b, c].map(|p| about + moved(p))
            };
            (1..=n).map(one).collect()
        });
    let strip =
        (ten_to(-9., 0.), vec(0f64..1., 1..30)).prop_map(|(width, all)| {
            let all = (0..).map(f64::from).zip(all);
            let two = |(i, y): (f64, f64)| {
                let at = |x, z| DVec3::new(x / 16. - 1., y * width, z);
                let (a, b) = (at(i, 0.), at(i + 1., width));
                [[a, at(i + 1., 0.), b], [a, b, at(i, width)]]
            };
            all.flat_map(two).collect()
        });
    let at = |x, y| DVec3::new(x, y, 0.);
    let (a, b, c) = (at(-1., -1.), at(1., -1.), at(1., 1.));
    let plane = vec![[a, b, c], [a, c, at(-1., 1.)]];
    prop_oneof![
        8 => select(&CLOSED[..]),
        2 => open(Just(plane)),
        2 => open(vec(corners(), 1..30)),
        2 => open(vec(small, 20..200)),
        2 => open(vec(needle, 1..20)),
        2 => open(strip),
        1 => open(vec(whole, 1..100)),
        1 => open(copies),
        1 => open(nested),
    ]
}

// --------------------------------------------------------------------- Cases

/// A finite number of any kind.
fn number() -> impl Strategy<Value = f64> + Clone {
    let odd = vec![0., 5e-324, 1e-310, 1e-154, 1e-45, 3.4e38, 1e39];
    let all = prop_oneof![
        select([odd, vec![1e154, 1e300, 1e308, f64::MAX]].concat()),
        0f64..1.,
        (0..5).prop_map(f64::from),
        proptest::num::f64::NORMAL,
    ];
    (all, select(vec![-1., 1.])).prop_map(|(x, sign)| sign * x)
}

/// A positive factor of any size.
fn size() -> impl Strategy<Value = f64> {
    prop_oneof![
        3 => Just(1.),
        1 => ten_to(-6., 6.),
        1 => ten_to(-307., 298.),
        1 => (-1022..990).prop_map(|exponent| 2f64.powi(exponent)),
    ]
}

fn turn() -> impl Strategy<Value = DQuat> {
    let turn = (corner(), 0f64..7.).prop_map(|(axis, angle)| {
        DQuat::from_axis_angle(axis.normalize_or(DVec3::X), angle)
    });
    prop_oneof![Just(DQuat::IDENTITY), turn]
}

const ALBEDOS: [f64; 10] =
    [0., 5e-324, 1e-300, 1e-16, 0.1, 0.5, 0.9, 0.999, 1. - 1e-6, 1.];
const STRETCHES: [DVec3; 4] = [
    DVec3::ONE,
    DVec3::ONE,
    DVec3::new(1., 1., 1e-6),
    DVec3::new(1e-9, 1., 1.),
];

prop_compose! {
    fn cases()(
        objects in vec((shapes(), ten_to(-12., 12.), turn()), 1..7),
        wild in prop_oneof![
            9 => Just(vec![]),
            1 => vec(vec(number(), 9), 1..60),
        ],
        stretch in select(&STRETCHES),
        place in corner(),
        far in select(&[0., 0., 0., 1., 1e3, 1e7, 1e12, 1e14]),
        size in size(),
        albedo in prop_oneof![2 => select(&ALBEDOS), 1 => 0f64..1.],
        size_of_image in prop_oneof![
            1 => select(&[(16384, 1), (1, 16384)]),
            2 => Just((1, 1)),
            17 => (1..25u32, 1..25u32),
        ],
        samples in 1..5u64,
        again in select(&[-200, -37, -1, 1, 37, 200]),
        seed in any::<u64>(),
    ) -> Case {
        // A closed cavity takes a thousand rays for each path.
        let (width, height) = size_of_image;
        let most = if albedo > 0.99 { 2 } else { u32::MAX };
        let is_long = albedo > 0.99 || width * height > 1000;
        let corner = |i: usize, x: &[f64]| DVec3::from_slice(&x[3 * i..]);
        let triangle = |x: Vec<f64>| [0, 1, 2].map(|i| corner(i, &x));
        Case {
            objects,
            wild: wild.into_iter().map(triangle).collect(),
            factor: stretch * size,
            offset: place * far * size,
            albedo,
            resolution: (width.min(most), height.min(most)),
            samples: if is_long { 1 } else { samples },
            again,
            seed,
        }
    }
}

/// One of some.
pub fn any_of<T: Copy>(some: &[T], random: &mut Random) -> T {
    some[random.random_range(0..some.len())]
}

impl Case {
    /// The shapes in their places: in most cases one touches another or the
    /// origin, where numbers are finest.
    fn shapes(&self, random: &mut Random) -> Vec<Shape> {
        let mut all: Vec<(Shape, f64)> = vec![];
        for (shape, scale, turn) in &self.objects {
            let own = match random.random_range(0..4) {
                0 => DVec3::ZERO,
                _ => point(&shape.triangles, random),
            };
            let mut anchor = DVec3::ZERO;
            let other = all.choose(random);
            if let Some((other, size)) = other
                && random.random_bool(0.6)
            {
                let size = any_of(&[0., *size, *scale], random);
                let away = uniform(random) * size * power(-3., 1., random);
                anchor = point(&other.triangles, random) + away;
            }
            let is_lost = anchor.length() * 1e-14 > *scale;
            if is_lost && !random.random_bool(0.1) {
                anchor = DVec3::ZERO;
            }
            let place = |p: DVec3| *turn * (p - own) * *scale + anchor;
            all.push((moved(shape, place), *scale));
        }
        let place =
            |p: DVec3| (p * self.factor + self.offset).clamp(LEAST, -LEAST);
        all.iter().map(|(shape, _)| moved(shape, place)).collect()
    }

    /// A camera of any kind; often in a solid.
    fn view(&self, shapes: &[Shape], random: &mut Random) -> View {
        let all = shapes.iter().flat_map(|s| &s.triangles);
        let all: Vec<_> = all.copied().collect();
        let inside = shapes.iter().flat_map(|s| &s.inside);
        let inside = inside.copied().chain([point(&all, random)]);
        let inside: Vec<_> = inside.collect();
        let corners = all.as_flattened().iter();
        let reach = corners.map(|p| p.abs().max_element());
        let reach = reach.fold(0., f64::max).min(1e300);
        let near = uniform(random) * reach * power(-20., 3., random);
        let some = point(&all, random);
        let far = DVec3::Z * any_of(&[1e300, -1e300, 1e308], random);
        let position = [some, some * 1e9, some + near];
        let position = match random.random_range(0..8) {
            0..5 => any_of(&inside, random),
            _ => any_of(&position, random).clamp(LEAST, -LEAST),
        };
        let step = uniform(random) * position.length() * 1e-15;
        let targets = [far, DVec3::ZERO, position + step, position + near];
        let mut target = match random.random() {
            true => point(&all, random),
            false => any_of(&targets, random).clamp(LEAST, -LEAST),
        };
        if position == target {
            target = position + position.abs().max(DVec3::X);
        }
        let ahead = (0.5 * target - 0.5 * position).normalize_or_zero();
        let any = uniform(random);
        let along = ahead + any * any_of(&[1e-12, 1e-15, 0.], random);
        let ups = [DVec3::Z, DVec3::Y, -DVec3::X, any, any * 1e-300, along];
        let fov = [1e-9, 5e-324, 1e-300, 179.999999, 180f64.next_down()];
        let fov = match random.random_range(0..12) {
            0 => 400. * random.random::<f64>() - 100.,
            1..5 => any_of(&fov, random),
            _ => 70.,
        };
        let up = any_of(&ups, random);
        let mut view = View { position, target, up, fov };
        let none = any_of(&[f64::NAN, f64::INFINITY], random);
        match random.random_range(0..120) {
            0 => view.position.y = none,
            1 => view.target.z = none,
            2 => view.up.x = -none,
            3 => view.fov = none,
            _ => (),
        }
        view
    }

    /// Fails if something is not as it should be.
    fn check(&self, tally: &Tally) {
        let count = |of: &AtomicUsize, is_one: bool| {
            of.fetch_add(is_one.into(), Relaxed);
        };
        count(&tally.cases, true);
        let random = &mut Random::seed_from_u64(self.seed);
        let shapes = self.shapes(random);
        let view = self.view(&shapes, random);
        let View { position, target, up, fov } = view;
        let all = [position, target, up, DVec3::splat(fov)];
        let is_finite = all.iter().all(|v| v.is_finite());
        if let Err(error) = Camera::new(&view, 1.) {
            count(&tally.refused, true);
            let error = error.to_string();
            assert!(error.len() >= 10 && !error.contains('\n'), "{error}");
            return;
        }
        assert!(is_finite, "a view that is not finite is seen");
        let triangles = shapes.iter().flat_map(|s| &s.triangles);
        let mesh = apart(triangles.chain(&self.wild).copied());
        let mut is_dark = false;
        // Twice the precision of a double does not hold all numbers.
        if self.wild.is_empty() {
            let mixture = Mixture::new(&mesh, &shapes, random);
            let mut mixture = mixture.unwrap();
            is_dark = mixture.is_dark(position);
            let seen = mixture.follow(100).unwrap();
            tally.paths.lock().unwrap().add(seen);
        }
        count(&tally.dark, is_dark);
        self.check_images(&mesh, &view, is_dark);
        // Scaled, no number may overflow or lose digits.
        let numbers = mesh.vertices.iter().chain([&position, &target]);
        let is_plain =
            |x: f64| x == 0. || (1e-150..1e150).contains(&x.abs());
        let is_plain = numbers.flat_map(|v| v.to_array()).all(is_plain);
        count(&tally.scaled, is_plain);
        if is_plain {
            self.check_scaled(&mesh, &view);
        }
    }
}

/// A shape whose points are moved.
fn moved(shape: &Shape, place: impl Fn(DVec3) -> DVec3) -> Shape {
    let triangles = shape.triangles.iter().map(|t| t.map(&place));
    let inside = shape.inside.iter().map(|&p| place(p));
    Shape { triangles: triangles.collect(), inside: inside.collect() }
}

const LEAST: DVec3 = DVec3::splat(f64::MIN);

// -------------------------------------------------------------------- Images

const USUAL: (Isa, Quality) = (Isa::Portable, Quality::FAST);

fn same(a: &Film, b: &Film, how: &str) {
    let pairs = a.pixels.iter().zip(&b.pixels);
    let differ = pairs.filter(|(a, b)| a != b).count();
    assert_eq!(differ, 0, "pixels differ: {how}");
}

impl Case {
    /// The image of a mesh, and the number of rays that it takes.
    fn image(
        &self,
        mesh: &Mesh,
        view: &View,
        build: (Isa, Quality),
        kept: &[&str],
    ) -> (Film, u64) {
        let (mesh, view, rho) = (mesh.clone(), *view, self.albedo);
        let setting = Setting { name: "", mesh, view, rho, build };
        let Outcome { film, rays, .. } =
            setting.render(kept, self.resolution, self.samples, 0);
        (film, rays)
    }

    /// The image is the same whatever the instructions, the care of the
    /// builder and what is left out, and if all triangles are there twice.
    fn check_images(&self, mesh: &Mesh, view: &View, is_dark: bool) {
        let (film, rays) = self.image(mesh, view, USUAL, &SHORTCUTS);
        self.judge(&film, rays, is_dark);
        let isas = Isa::ALL.into_iter().filter(|isa| isa.is_available());
        let ways = isas.map(|isa| (isa, Quality::FAST));
        for way in ways.chain([(Isa::Portable, Quality::THOROUGH)]) {
            let (other, more) = self.image(mesh, view, way, &SHORTCUTS);
            same(&film, &other, &format!("{} {}", way.0, way.1));
            assert_eq!(more, rays, "rays");
        }
        let simple = self.image(mesh, view, USUAL, &[]).0;
        same(&film, &simple, "with shortcuts");
        let mut twice = mesh.clone();
        let turned = mesh.triangles.iter().map(|&[a, b, c]| match a % 9 {
            0 => [b, a, c],
            3 => [a, b, c],
            _ => [b, c, a],
        });
        twice.triangles.extend(turned);
        let twice = self.image(&twice, view, USUAL, &SHORTCUTS).0;
        same(&film, &twice, "each triangle twice");
    }

    /// The image is the same if all is scaled by a power of two.
    fn check_scaled(&self, mesh: &Mesh, view: &View) {
        let film = self.image(mesh, view, USUAL, &SHORTCUTS).0;
        let factor = 2f64.powi(self.again);
        let mut mesh = mesh.clone();
        mesh.vertices.iter_mut().for_each(|v| *v *= factor);
        let [position, target] =
            [view.position, view.target].map(|p| p * factor);
        let view = &View { position, target, ..*view };
        let scaled = self.image(&mesh, view, USUAL, &SHORTCUTS).0;
        same(&film, &scaled, &format!("scaled by {factor:e}"));
    }

    /// What must be true of any image. A weight is above 1 only if its path
    /// was in danger of being ended by chance after 1000 bounces, with a
    /// throughput that is not yet below 0.1.
    fn judge(&self, film: &Film, rays: u64, is_dark: bool) {
        let faint = self.albedo.powi(1000) < 0.09 || rays <= 1000;
        let most = if faint { 1. } else { f64::INFINITY };
        for pixel in film.rows() {
            let (mean, error) = (pixel.mean(), pixel.standard_error());
            assert!(mean.is_finite(), "{mean}");
            assert!((0. ..=most).contains(&mean), "a mean of {mean:e}");
            assert_eq!(pixel.count(), self.samples, "samples");
            let is_known = pixel.count() > 1;
            assert!(error >= 0. && (error.is_finite() || !is_known));
            assert!(!is_dark || mean <= 0., "a leak: {mean:e} in the dark");
        }
    }
}

// ------------------------------------------------------------------ The test

/// Tries the cases of a seed, and fails with the smallest that is wrong.
fn try_cases(seed: u64, tally: &Tally) {
    let config = Config {
        cases: 16,
        failure_persistence: None,
        max_shrink_time: 60_000,
        rng_seed: RngSeed::Fixed(seed),
        ..Config::default()
    };
    let result = TestRunner::new(config).run(&cases(), |case| {
        let start = Instant::now();
        case.check(tally);
        let taken = start.elapsed();
        assert!(taken <= Duration::from_secs(300), "{taken:?}");
        Ok(())
    });
    result.unwrap_or_else(|finding| panic!("seed {seed}: {finding}"));
}

/// Eight seeds, and more until FUZZ_SECONDS are over, from FUZZ_SEED on.
#[test]
fn scenes_and_cameras_by_chance_are_rendered_as_all_should_be() {
    let given = |name| Some(env::var(name).ok()?.parse().expect(name));
    let (seconds, first) = (given("FUZZ_SECONDS"), given("FUZZ_SEED"));
    let end = Instant::now() + Duration::from_secs(seconds.unwrap_or(0));
    let (tally, mut seed) = (Tally::default(), first.unwrap_or(1));
    loop {
        // If the process dies, these are to blame.
        seconds.inspect(|_| eprintln!("seeds from {seed} on"));
        let seeds = (seed..seed + 8).into_par_iter();
        seeds.for_each(|seed| try_cases(seed, &tally));
        seed += 8;
        if Instant::now() >= end {
            break;
        }
    }
    println!("{tally:#?}");
    let of = |count: &AtomicUsize| count.load(Relaxed);
    let (cases, refused) = (of(&tally.cases), of(&tally.refused));
    assert!(of(&tally.dark) > 9 && of(&tally.scaled) > 30, "{tally:?}");
    assert!(refused > 0 && 3 * refused < cases, "{tally:?}");
    // Where several answers are allowed, a wrong one may be among them.
    let Seen { rays, certain, inside, excused } =
        *tally.paths.lock().unwrap();
    assert!(2 * certain > rays, "{certain} of {rays}");
    // A leak at one point of a thousand would go unnoticed with a probability
    // of 0.05, and so few paths are given up.
    assert!(inside >= 3000 && 1000 * excused <= inside, "{tally:?}");
}
