// Compares rules to end a path, in the model of a cavity and in the courtyard,
// and prints a CSV: "make measure" records it for the chapter "The estimator".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;

use glam::DVec3;
use litpt::analysis::background::KnownPixels;
use litpt::bvh::{Bvh, Hit};
use litpt::camera::Camera;
use litpt::film::Film;
use litpt::integrator::{Integrator, PathEvent, PathTracer};
use litpt::render::{Job, Renderer};
use litpt::sampler::{
    IndependentSampler, Sampler, cosine_direction, dimension, generator,
    happens,
};
use litpt::scene::{Ray, Scene, read_obj};
use litpt::sky::Sky;
use litpt::statistics::Accumulator;
use litpt_book::closed_forms::cavity_radiance;
use rand::RngExt;

use super::Done;

/// What becomes of paths of more than 1000 bounces.
#[derive(Clone, Copy, PartialEq)]
enum Tail {
    /// They go on.
    Free,
    /// They stop with probability 1/2, or double their weight.
    Halving,
    /// They go from n bounces to n + 1 with probability (n/(n+1))^a.
    Power(f64),
}

/// Survival by chance below the throughput `faint`, and a `tail`.
struct Rule {
    faint: f64,
    tail: Tail,
    albedo: f64,
    sky: Sky,
}

struct Path {
    throughput: f64,
    count: u64,
    direction: DVec3,
}

impl Integrator for Rule {
    type Path = Path;
    type RayQuery = Hit;

    fn begin(&self, direction: DVec3) -> Path {
        Path { throughput: 1., count: 0, direction }
    }

    fn go_on(
        &self,
        path: &mut Path,
        hit: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        let Some(hit) = hit else {
            let light = self.sky.radiance(path.direction);
            return PathEvent::Terminate(path.throughput * light);
        };
        let on = if path.throughput < self.faint {
            self.albedo
        } else {
            path.throughput *= self.albedo;
            let on = match self.tail {
                _ if path.count < 1000 => 1.,
                Tail::Free => 1.,
                Tail::Halving => 0.5,
                Tail::Power(a) => {
                    let n = path.count as f64;
                    libm::pow(n / (n + 1.), a)
                }
            };
            path.throughput /= on;
            on
        };
        let bounce = path.count;
        let mut u = || sampler.get_1d(dimension::roulette(bounce));
        if on < 1. && !happens(on, u()) {
            return PathEvent::Terminate(0.);
        }
        path.count += 1;
        let [r, turn] = sampler.get_2d(dimension::direction(bounce));
        path.direction = cosine_direction(hit.normal, r, turn);
        let ray = Ray { origin: hit.point, direction: path.direction };
        PathEvent::Scatter(ray, hit.primitive)
    }
}

pub fn run(arguments: &[String]) -> Done {
    let path = arguments.first().ok_or("usage: roulettes FILE.obj")?;
    let scene = Scene::new(&read_obj(&std::fs::read(path)?)?);
    let intersector = Bvh::new(&scene)?;
    println!("scene,rule,mean,error,z,variance,rays,efficiency");
    // Rules that do nothing else than ours in a scene are left out there.
    let thresholds =
        ["below 0.01", "below 0.5", "analogue", "none"].as_slice();
    let tails = ["$a=1.25$", "$a=2$", "halving", "none"].as_slice();
    let both = [thresholds, &tails[..3]].concat();
    let cavities = [
        ("0.9", "0.1", thresholds),
        ("0.999", "0.001", &both),
        ("0.999999", "0.0001", tails),
        ("1", "0.001", tails),
        ("1", "0", &tails[..3]),
    ];
    for (rho, f, rules) in cavities {
        let name = format!("$\\rho={rho}$; $f={f}$");
        let (rho, f) = (rho.parse::<f64>()?, f.parse::<f64>()?);
        let sky = Sky::new(DVec3::Z);
        let ours = PathTracer { albedo: rho, sky };
        compare(&name, model(&ours, rho, f), rules, |faint, tail| {
            let rule = Rule { faint, tail, albedo: rho, sky };
            model(&rule, rho, f)
        });
    }
    for rho in [0.8, 0.95] {
        let name = format!("courtyard; $\\rho={rho}$");
        let sky = Sky::new(litpt_book::courtyard::view().up);
        let ours = PathTracer { albedo: rho, sky };
        let ours = courtyard(&scene, &intersector, &ours)?;
        compare(&name, ours, thresholds, |faint, tail| {
            let rule = Rule { faint, tail, albedo: rho, sky };
            courtyard(&scene, &intersector, &rule)
                .expect("the camera exists")
        });
    }
    Ok(())
}

/// Prints the rows of a scene: ours, and those of some rules.
fn compare(
    scene: &str,
    ours: Measured,
    rules: &[&str],
    measure: impl Fn(f64, Tail) -> Measured,
) {
    let power = Tail::Power(1.5);
    ours.print(scene, "ours", &ours);
    for rule in rules {
        let (faint, tail) = match *rule {
            "below 0.01" => (0.01, power),
            "below 0.5" => (0.5, power),
            "analogue" => (f64::INFINITY, power),
            "none" => (0., Tail::Free),
            "halving" => (0.1, Tail::Halving),
            "$a=1.25$" => (0.1, Tail::Power(1.25)),
            _ => (0.1, Tail::Power(2.)),
        };
        measure(faint, tail).print("", rule, &ours);
    }
}

/// What a rule gives in a scene.
struct Measured {
    /// The mean as it is known, or else as it is found.
    exact: f64,
    mean: f64,
    error: f64,
    /// Of one path, relative to the square of the mean.
    variance: f64,
    /// Of one path.
    rays: f64,
}

impl Measured {
    fn print(&self, scene: &str, rule: &str, ours: &Self) {
        let &Self { exact, mean, error, variance, rays } = self;
        // What misses the mean has not seen its variance either.
        let wrong = (mean - exact).abs() > 5. * error + 1e-9;
        let variance = if wrong { f64::NAN } else { variance };
        let efficiency = ours.variance * ours.rays / (variance * rays);
        let number = |x: f64, digits| match x {
            0. => "0".to_owned(),
            x if x.is_nan() => "--".to_owned(),
            x if x.is_infinite() => r"$\infty$".to_owned(),
            x => format!("{x:.digits$}"),
        };
        let z = match (mean - exact) / error {
            z if z.is_nan() || mean == exact => String::new(),
            z => format!("${z:+.1}$"),
        };
        let digits = match variance {
            x if x < 0.01 => 5,
            x if x < 100. => 3,
            _ => 0,
        };
        println!(
            "{scene},{rule},{},{},{z},{},{},{}",
            number(mean, 5),
            number(error, 5),
            number(variance, digits),
            number(rays, if rays < 100. { 2 } else { 0 }),
            number(efficiency, if efficiency < 100. { 2 } else { 0 }),
        );
    }
}

/// A cavity that a path leaves, for the sky, with probability `f` at each
/// ray from its wall.
fn model(
    integrator: &impl Integrator<RayQuery = Hit>,
    rho: f64,
    f: f64,
) -> Measured {
    let mut sums = Accumulator::default();
    let mut rays = 0;
    // As many paths as 2 * 10^8 rays make, but not more than a million.
    let mut n = 0;
    while n < 1_000_000 && (rays < 200_000_000 || n < 10_000) {
        let mut sampler = IndependentSampler::new(0).start(0, n);
        let mut doors = generator(1, 0, n);
        let mut path = integrator.begin(DVec3::Z);
        let mut first = true;
        let weight = loop {
            rays += 1;
            let leaves = !first && happens(f, doors.random());
            first = false;
            let hit =
                Hit { point: DVec3::ZERO, normal: DVec3::Z, primitive: 0 };
            let hit = (!leaves).then_some(hit);
            match integrator.go_on(&mut path, hit, &mut sampler) {
                PathEvent::Scatter(..) => (),
                PathEvent::Terminate(weight) => break weight,
            }
        };
        sums.add(weight);
        n += 1;
    }
    // A closed cavity is dark, and nothing there is relative.
    let exact = if f > 0. { cavity_radiance(rho, f) } else { 0. };
    Measured {
        exact,
        mean: sums.mean(),
        error: sums.standard_error(),
        variance: sums.variance() / (exact * exact),
        rays: rays as f64 / n as f64,
    }
}

/// The courtyard; the variance of one path is the mean over the pixels.
fn courtyard<E: Integrator>(
    scene: &Scene,
    intersector: &Bvh,
    integrator: &E,
) -> Result<Measured, Box<dyn Error>> {
    const SAMPLES: u64 = 64;
    let view = litpt_book::courtyard::view();
    let camera = Camera::new(&view, 4. / 3.)?;
    let mut job = Job {
        scene,
        intersector,
        camera: &camera,
        integrator,
        known: &KnownPixels::Nothing,
        sampler: IndependentSampler::new(0),
    };
    let (width, height) = (160, 120);
    let mut film = Film::new(width, height);
    let rays = job.pass(&mut film, SAMPLES, &|_| true);
    let pixels = f64::from(width * height);
    let mean = film.means().sum::<f64>() / pixels;
    let variances = (0..height)
        .flat_map(|y| (0..width).map(move |x| (x, y)))
        .map(|(x, y)| film.pixel(x, y).variance());
    let variance = variances.sum::<f64>() / pixels;
    let paths = pixels * SAMPLES as f64;
    Ok(Measured {
        exact: mean,
        mean,
        error: (variance / paths).sqrt(),
        variance: variance / (mean * mean),
        rays: rays as f64 / paths,
    })
}
