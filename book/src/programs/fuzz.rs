// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Random scenes, cameras and settings, for a number of seconds: `fuzz
//! [SECONDS [SEED [mixtures]]]`, built with all checks (the profile `dev`).
//!
//! Each seed is a case, and is printed before it is tried; so the last one
//! is to blame if the process dies. With 0 SECONDS the one case SEED is
//! described as well. Each seed is also a mixture of scales; with the last
//! word it is nothing else.

mod mixtures;

use std::panic::{AssertUnwindSafe, UnwindSafe, catch_unwind};
use std::process::exit;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use glam::DVec3;
use litpt::analysis::background::KnownPixels;
use litpt::analysis::{LitView, SceneAnalysis};
use litpt::bvh::{Bvh, Isa, Quality};
use litpt::camera::{Camera, View};
use litpt::film::Film;
use litpt::integrator::{PathTracer, SingleProcess};
use litpt::materials::Surfaces;
use litpt::render::choose::{Method, Pixels, Sampling, Setup};
use litpt::render::{Job, Renderer};
use litpt::sampler::IndependentSampler;
use litpt::scene::{Mesh, Scene};
use litpt::sensor::Sensor;
use litpt::sky::Sky;
use litpt_book::solids;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::Done;
use mixtures::Seen;

/// No case may take longer, in seconds.
const PATIENCE: u64 = 300;

/// The case that is being tried.
static CURRENT: AtomicU64 = AtomicU64::new(0);

pub fn run(arguments: &[String]) -> Done {
    let number = |i: usize, default: u64| {
        arguments.get(i).map_or(Ok(default), |word| word.parse())
    };
    let (seconds, first) = (number(0, 60)?, number(1, 1)?);
    std::thread::spawn(watch);
    let end = Instant::now() + Duration::from_secs(seconds);
    let only_mixtures = arguments.get(2).is_some_and(|w| w == "mixtures");
    let (mut seed, mut findings) = (first, 0);
    let mut seen = Seen::default();
    loop {
        println!("{seed}");
        CURRENT.store(seed, Ordering::Relaxed);
        let mixture = || {
            seen.add(mixtures::Case::new(seed)?.try_all()?);
            Ok(())
        };
        let mut found = vec![attempt(AssertUnwindSafe(mixture))];
        if !only_mixtures {
            let case = Case::new(seed);
            if seconds == 0 {
                println!("{}", case.describe());
            }
            found.push(attempt(|| case.try_all()));
        }
        for what in found.into_iter().flatten() {
            findings += 1;
            eprintln!("FINDING {seed}: {what}; fuzz 0 {seed} repeats it");
        }
        seed += 1;
        if Instant::now() >= end {
            break;
        }
    }
    let cases = seed - first;
    let Seen { rays, certain, inside, excused } = seen;
    eprintln!(
        "{rays} rays in mixtures of scales: {certain} certain, {inside} \
         inside, {excused} excused"
    );
    eprintln!("{cases} cases from seed {first} on, {findings} findings");
    if findings > 0 { Err("there are findings".into()) } else { Ok(()) }
}

/// The finding, if there is one.
fn attempt(
    case: impl FnOnce() -> Result<(), String> + UnwindSafe,
) -> Option<String> {
    match catch_unwind(case) {
        Ok(Ok(())) => None,
        Ok(Err(finding)) => Some(finding),
        Err(_) => Some("a panic".to_owned()),
    }
}

/// Ends the process if a case takes too long.
fn watch() {
    let (mut last, mut since) = (0, Instant::now());
    loop {
        std::thread::sleep(Duration::from_secs(1));
        let current = CURRENT.load(Ordering::Relaxed);
        if current != last {
            (last, since) = (current, Instant::now());
        } else if since.elapsed().as_secs() > PATIENCE {
            eprintln!("FINDING {current}: hangs");
            exit(1);
        }
    }
}

// -------------------------------------------------------------------- A case

/// What is tried.
struct Case {
    mesh: Mesh,
    view: View,
    albedo: f64,
    resolution: (u32, u32),
    samples: u64,
    quality: Quality,
    /// Whether the camera is inside a closed surface.
    is_dark: bool,
    /// The exponent by which scene and camera are scaled to try again.
    scale: i32,
}

impl Case {
    fn new(seed: u64) -> Self {
        let mut random = Random(Pcg64Mcg::seed_from_u64(seed));
        let (mesh, inside) = random.mesh();
        let (mut view, at_home) = random.view(&mesh, inside);
        let is_dark = inside.is_some() && at_home;
        if is_dark && !random.chance(0.5) {
            view.fov = 70.;
        }
        let count = mesh.triangles.len();
        let resolution = match random.below(40) {
            0 => (16384, 1),
            1 => (1, 16384),
            2..6 => (1, 1),
            _ => (1 + random.below(24) as u32, 1 + random.below(24) as u32),
        };
        let albedo = random.albedo();
        // A closed cavity takes 1000 rays for each path.
        let most = if count > 3000 { 2 } else { 8 };
        let resolution = match albedo > 0.99 {
            true => (resolution.0.min(most), resolution.1.min(most)),
            false => resolution,
        };
        let small = resolution.0 * resolution.1 < 1000 && count < 3000;
        Self {
            view,
            albedo,
            resolution,
            samples: if small { 1 + random.below(4) } else { 1 },
            quality: random.choose(&QUALITIES),
            is_dark,
            scale: random.choose(&[-200, -37, -1, 1, 37, 200]),
            mesh,
        }
    }

    fn describe(&self) -> String {
        format!(
            "{} triangles, {:?}, rho {:e}, {:?} x {}, {}, closed: {}",
            self.mesh.triangles.len(),
            self.view,
            self.albedo,
            self.resolution,
            self.samples,
            self.quality,
            self.is_dark
        )
    }

    /// Renders in all ways; the finding if something is wrong.
    fn try_all(&self) -> Result<(), String> {
        let aspect =
            f64::from(self.resolution.0) / f64::from(self.resolution.1);
        let camera = match Camera::new(&self.view, aspect) {
            Ok(camera) => camera,
            Err(error) => return refused(&error),
        };
        if !is_finite(&self.view) {
            return Err("a view that is not finite has a camera".into());
        }
        let scene = Scene::new(&self.mesh);
        let mut first: Option<(Film, u64)> = None;
        for (isa, quality) in self.ways() {
            let (film, rays) =
                self.render(&scene, &camera, quality, isa)?;
            if let Some((other, others)) = &first {
                compare(&film, other, &format!("{isa} {quality}"))?;
                if rays != *others {
                    return Err(format!("{isa} {quality}: other rays"));
                }
            } else {
                self.judge(&film, rays)?;
                first = Some((film, rays));
            }
        }
        let (film, _) = first.ok_or("no way to render")?;
        self.scaled(&camera, aspect, &film)?;
        self.doubled(&camera, &film)?;
        self.simplified(&camera, &film)?;
        Ok(())
    }

    fn ways(&self) -> Vec<(Isa, Quality)> {
        let available = Isa::ALL.into_iter().filter(|i| i.is_available());
        let mut ways: Vec<_> =
            available.map(|isa| (isa, self.quality)).collect();
        let others = QUALITIES.into_iter().filter(|q| *q != self.quality);
        ways.extend(others.map(|quality| (Isa::best(), quality)));
        ways
    }

    fn render(
        &self,
        scene: &Scene,
        camera: &Camera,
        quality: Quality,
        isa: Isa,
    ) -> Result<(Film, u64), String> {
        let intersector = Bvh::with(scene, quality, isa)
            .map_err(|error| error.to_string())?;
        let surfaces = Surfaces::of(self.albedo);
        let integrator = PathTracer::new(surfaces, Sky::new(self.view.up));
        let entrance = scene.frame.entrance(camera.position);
        let mut job = Job {
            sensor: &Sensor::Camera(*camera, entrance),
            intersector: &intersector,
            integrator,
            known_pixels: KnownPixels::NOTHING,
            sampler: IndependentSampler::new(0),
        };
        let mut film = Film::new(self.resolution.0, self.resolution.1);
        let rays = job.pass(&mut film, self.samples, &|_| true);
        Ok((film, rays))
    }

    /// What must be true of any image.
    ///
    /// A weight is above 1 only if its path was in danger of being ended
    /// by chance after 1000 bounces, with a throughput that is not yet
    /// below 0.1.
    fn judge(&self, film: &Film, rays: u64) -> Result<(), String> {
        let faint = self.albedo.powi(1000) < 0.09;
        let most = match faint || rays <= 1000 {
            true => 1.,
            false => f64::INFINITY,
        };
        for pixel in film.rows() {
            let (mean, error) = (pixel.mean(), pixel.standard_error());
            if !(mean.is_finite() && (0. ..=most).contains(&mean)) {
                return Err(format!("a mean of {mean:e}"));
            }
            let is_known = pixel.count() > 1;
            if !(error >= 0. && (error.is_finite() || !is_known)) {
                return Err(format!("a standard error of {error:e}"));
            }
            if pixel.count() != self.samples {
                return Err(format!("{} samples", pixel.count()));
            }
            if self.is_dark && mean > 0. {
                return Err(format!("a leak: {mean:e} in the dark"));
            }
        }
        Ok(())
    }

    /// Leaving out what the scene does not need changes nothing.
    fn simplified(
        &self,
        camera: &Camera,
        film: &Film,
    ) -> Result<(), String> {
        let Scene { frame, triangles, left_out } = Scene::new(&self.mesh);
        let entrance = frame.entrance(camera.position);
        let view = LitView {
            sensor: &Sensor::Camera(*camera, entrance),
            sky: Sky::new(self.view.up),
            surfaces: Surfaces::of(self.albedo),
            resolution: self.resolution,
        };
        let intersector =
            Bvh::of(triangles, self.quality, Isa::best(), &|_| ())
                .map_err(|error| error.to_string())?;
        let analysis =
            SceneAnalysis::find(&left_out, &intersector, &view, &[]);
        let setup =
            Setup { intersector: &intersector, view, analysis: &analysis };
        let sampling = Sampling::new(
            Method::Reference,
            0,
            None,
            Pixels::of_image((1, 1)),
        );
        let mut renderer =
            setup.renderer(&sampling, Arc::default(), &SingleProcess);
        let mut simple = Film::new(self.resolution.0, self.resolution.1);
        let rays = renderer.pass(&mut simple, self.samples, &|_| true);
        self.judge(&simple, rays.max(1001))?;
        compare(&simple, film, "with shortcuts")
    }

    /// Scaling scene and camera by a power of two changes nothing, as long
    /// as no number overflows or loses digits.
    fn scaled(
        &self,
        camera: &Camera,
        aspect: f64,
        film: &Film,
    ) -> Result<(), String> {
        let factor = 2f64.powi(self.scale);
        let View { position, target, up, fov } = self.view;
        let numbers = self.mesh.vertices.iter().chain([&position, &target]);
        let is_plain =
            |x: f64| x == 0. || (1e-150..1e150).contains(&x.abs());
        let mut numbers = numbers.flat_map(|v| v.to_array());
        if !numbers.all(is_plain) || self.mesh.triangles.len() > 50_000 {
            return Ok(());
        }
        let mut mesh = self.mesh.clone();
        for vertex in &mut mesh.vertices {
            *vertex *= factor;
        }
        let view = View {
            position: position * factor,
            target: target * factor,
            up,
            fov,
        };
        let other =
            Camera::new(&view, aspect).map_err(|e| e.to_string())?;
        let same = other.direction(0.3, 0.1) == camera.direction(0.3, 0.1);
        if !same {
            return Err(format!("scaled by {factor:e}: other directions"));
        }
        let scene = Scene::new(&mesh);
        let (scaled, _) =
            self.render(&scene, &other, self.quality, Isa::best())?;
        compare(&scaled, film, &format!("scaled by {factor:e}"))
    }

    /// Repeating all triangles, with their corners in another order,
    /// changes nothing.
    fn doubled(&self, camera: &Camera, film: &Film) -> Result<(), String> {
        if self.mesh.triangles.len() > 50_000 {
            return Ok(());
        }
        let mut mesh = self.mesh.clone();
        let turned = |&[a, b, c]: &[u32; 3]| match (a ^ b) % 3 {
            0 => [b, a, c],
            1 => [a, b, c],
            _ => [b, c, a],
        };
        mesh.triangles.extend(self.mesh.triangles.iter().map(turned));
        let scene = Scene::new(&mesh);
        let (doubled, _) =
            self.render(&scene, camera, self.quality, Isa::best())?;
        compare(&doubled, film, "each triangle twice")
    }
}

const QUALITIES: [Quality; 2] = [Quality::FAST, Quality::THOROUGH];

/// An error must say something, in one line, to whoever reads it.
fn refused(error: &impl std::fmt::Display) -> Result<(), String> {
    let text = error.to_string();
    match text.len() > 10 && !text.contains('\n') {
        true => Ok(()),
        false => Err(format!("a strange message: {text:?}")),
    }
}

fn compare(a: &Film, b: &Film, how: &str) -> Result<(), String> {
    let differ = a.pixels.iter().zip(&b.pixels);
    match differ.filter(|(a, b)| a != b).count() {
        0 => Ok(()),
        n => Err(format!("{how}: {n} of {} pixels differ", a.area())),
    }
}

fn is_finite(view: &View) -> bool {
    let View { position, target, up, fov } = view;
    position.is_finite()
        && target.is_finite()
        && up.is_finite()
        && fov.is_finite()
}

// ---------------------------------------------------- What chance may choose

struct Random(Pcg64Mcg);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0.random()
    }

    fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }

    fn below(&mut self, n: u64) -> u64 {
        (self.unit() * n as f64) as u64
    }

    fn choose<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len() as u64) as usize]
    }

    /// In [-1, 1).
    fn both(&mut self) -> f64 {
        2. * self.unit() - 1.
    }

    fn point(&mut self) -> DVec3 {
        DVec3::new(self.both(), self.both(), self.both())
    }

    fn direction(&mut self) -> DVec3 {
        loop {
            let v = self.point();
            if (0.01..1.).contains(&v.length()) {
                return v.normalize();
            }
        }
    }

    /// Of any size.
    fn size(&mut self) -> f64 {
        match self.below(4) {
            0 => 1.,
            1 => 10f64.powf(6. * self.both()),
            2 => 10f64.powf(307. * self.both()),
            _ => 2f64.powi(self.below(2046) as i32 - 1022),
        }
    }

    /// A finite number of any kind.
    fn wild(&mut self) -> f64 {
        let sign = if self.chance(0.5) { 1. } else { -1. };
        sign * match self.below(5) {
            0 => 0.,
            1 => self.choose(&SPECIAL),
            2 => self.unit(),
            3 => self.below(5) as f64,
            _ => self.size(),
        }
    }

    fn wild_point(&mut self) -> DVec3 {
        DVec3::new(self.wild(), self.wild(), self.wild())
    }

    /// Any number at all.
    fn wilder(&mut self) -> f64 {
        match self.below(8) {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 => f64::NEG_INFINITY,
            _ => self.wild(),
        }
    }

    fn albedo(&mut self) -> f64 {
        match self.below(3) {
            0 => self.unit(),
            _ => self.choose(&[
                0.,
                5e-324,
                1e-300,
                1e-16,
                0.1,
                0.5,
                0.9,
                0.999,
                1. - 1e-6,
                1. - 1.2e-16,
                1.,
            ]),
        }
    }
}

const SPECIAL: [f64; 16] = [
    5e-324,
    1e-310,
    f64::MIN_POSITIVE,
    1e-300,
    1e-154,
    1e-45,
    1e-38,
    1e-3,
    1e7,
    1e9,
    3.4e38,
    1e39,
    1e154,
    1e300,
    1e308,
    f64::MAX,
];

// -------------------------------------------------------------------- Scenes

/// A ball that lies inside a closed surface: its centre and radius.
type Ball = (DVec3, f64);

impl Random {
    /// Few, mostly.
    fn count(&mut self) -> u64 {
        match self.below(200) {
            0 => 20_000 + self.below(200_000),
            1..10 => self.below(10_000),
            10..60 => self.below(500),
            _ => self.below(24),
        }
    }

    /// A mesh, and a ball inside if it is closed.
    fn mesh(&mut self) -> (Mesh, Option<Ball>) {
        if self.chance(0.01) {
            return (Mesh::default(), None);
        }
        let (mut mesh, mut ball) = self.part();
        if self.chance(0.2) {
            // Another part, of another size, near the first or far away.
            let (mut other, _) = self.part();
            let factor = self.choose(&[1e-12, 1e-3, 1., 1e3, 1e12]);
            let place = match self.chance(0.5) {
                true => self.point(),
                false => self.point() * self.size(),
            };
            for vertex in &mut other.vertices {
                *vertex = *vertex * factor + place;
            }
            // What closed the ball in still does, and so does what
            // rounding has made of it, if it is not much smaller.
            ball = ball.filter(|_| {
                let all = other.vertices.iter();
                all.into_iter().all(|v| v.abs().max_element() < 1e6)
            });
            append(&mut mesh, &other);
        }
        self.place(&mut mesh, &mut ball);
        (mesh, ball)
    }

    /// Something of about unit size at the origin.
    fn part(&mut self) -> (Mesh, Option<Ball>) {
        let n = self.count();
        match self.below(11) {
            0 => {
                let mesh = solids::cube(1 + self.below(12) as u32);
                (mesh, Some((DVec3::ZERO, 0.99)))
            }
            1 => {
                let mesh = solids::icosphere(self.below(4) as u32);
                (mesh, Some((DVec3::ZERO, 0.5)))
            }
            2 => {
                let mesh = solids::star(self.below(4) as u32, n);
                (mesh, Some((DVec3::ZERO, 0.01)))
            }
            3 => (self.soup(n, 1.), None),
            4 => (self.soup(n, 1e-3), None),
            5 => (self.integers(n), None),
            6 => (self.coincident(n), None),
            7 => (self.needles(n), None),
            8 => (self.nested(n), None),
            9 => (self.chaos(n.min(60)), None),
            _ => (self.heap(n), None),
        }
    }

    fn soup(&mut self, n: u64, size: f64) -> Mesh {
        collect((0..n).map(|_| {
            let at = self.point();
            [0; 3].map(|_| at + size * self.point())
        }))
    }

    /// Few distinct coordinates: shared, coplanar and coincident pieces.
    fn integers(&mut self, n: u64) -> Mesh {
        let most = 1 + self.below(6);
        let mut one = || self.below(most + 1) as f64;
        collect(
            (0..n).map(|_| [0; 3].map(|_| DVec3::new(one(), one(), one()))),
        )
    }

    /// One triangle over and over, exactly or almost.
    fn coincident(&mut self, n: u64) -> Mesh {
        let corners = [0; 3].map(|_| self.point());
        let jitter = self.choose(&[0., 0., 1e-16, 1e-9, 1e-7, 1e-5]);
        collect((0..n).map(|_| {
            let [a, b, c] = corners.map(|p| p + jitter * self.point());
            self.choose(&[[a, b, c], [b, c, a], [c, b, a]])
        }))
    }

    fn needles(&mut self, n: u64) -> Mesh {
        let width = 10f64.powf(-20. * self.unit());
        collect((0..n).map(|_| {
            let [a, b] = [self.point(), self.point()];
            [a, b, a + width * self.point()]
        }))
    }

    /// Each around the one before, about a corner or the middle.
    fn nested(&mut self, n: u64) -> Mesh {
        let corners = [0; 3].map(|_| self.point());
        let about = match self.chance(0.5) {
            true => corners[0],
            false => (corners[0] + corners[1] + corners[2]) / 3.,
        };
        let tilt = self.point() * self.choose(&[0., 1e-6, 0.1]);
        let n = n.min(3000);
        collect((1..=n).map(|i| {
            let share = i as f64 / n as f64;
            corners.map(|p| about + (p - about) * share + tilt * share)
        }))
    }

    /// Coordinates of all kinds.
    fn chaos(&mut self, n: u64) -> Mesh {
        collect((0..n).map(|_| [0; 3].map(|_| self.wild_point())))
    }

    /// Triangles of all sizes.
    fn heap(&mut self, n: u64) -> Mesh {
        collect((0..n).map(|_| {
            let size = 10f64.powf(-12. * self.unit());
            let at = self.point();
            [0; 3].map(|_| at + size * self.point())
        }))
    }
}

impl Random {
    /// Moves and scales a mesh, by the same map for all corners.
    fn place(&mut self, mesh: &mut Mesh, ball: &mut Option<Ball>) {
        let wide =
            mesh.vertices.iter().any(|v| v.abs().max_element() > 1e9);
        if wide || self.chance(0.3) {
            return;
        }
        let mut size = self.size();
        if size > 1e298 {
            size = 1e298;
        }
        let offset = match self.below(3) {
            0 => DVec3::ZERO,
            1 => self.point() * self.choose(&[1., 1e3, 1e7, 2f64.powi(40)]),
            _ => self.point() * 1e14,
        };
        let shape = match self.below(5) {
            0 => DVec3::new(1., 1., 1e-6),
            1 => DVec3::new(1e-9, 1., 1.),
            _ => DVec3::ONE,
        };
        let map = |v: DVec3| (v * shape + offset) * size;
        for vertex in &mut mesh.vertices {
            *vertex = map(*vertex).clamp(LEAST, -LEAST);
        }
        // Far away and for small sizes, rounding has changed the shape.
        let is_exact = offset.abs().max_element() < 1e4
            && shape == DVec3::ONE
            && size > 1e-290;
        *ball = ball
            .filter(|_| is_exact)
            .map(|(centre, radius)| (map(centre), radius * size * 0.9));
    }
}

fn collect(triangles: impl IntoIterator<Item = [DVec3; 3]>) -> Mesh {
    let mut mesh = Mesh::default();
    for corners in triangles {
        let first = mesh.vertices.len() as u32;
        // A sum with zero would hide -0 from the test of the reader.
        mesh.vertices.extend(corners);
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    mesh.vertices.iter_mut().for_each(|v| *v = v.clamp(LEAST, -LEAST));
    mesh
}

const LEAST: DVec3 = DVec3::splat(f64::MIN);

fn append(mesh: &mut Mesh, other: &Mesh) {
    let first = mesh.vertices.len() as u32;
    let clamped = other.vertices.iter().map(|v| v.clamp(LEAST, -LEAST));
    mesh.vertices.extend(clamped);
    let moved = other.triangles.iter().map(|t| t.map(|i| i + first));
    mesh.triangles.extend(moved);
}

// ------------------------------------------------------------------- Cameras

impl Random {
    /// A view, and whether it is from inside the ball, if there is one.
    fn view(&mut self, mesh: &Mesh, ball: Option<Ball>) -> (View, bool) {
        let some = |random: &mut Self| match mesh.vertices.len() {
            0 => random.point(),
            n => mesh.vertices[random.below(n as u64) as usize],
        };
        let (mut position, at_home) = match (ball, self.below(8)) {
            (Some((centre, radius)), 0..6) => {
                let away = match self.below(3) {
                    0 => DVec3::ZERO,
                    _ => self.direction() * radius * self.unit(),
                };
                (centre + away, true)
            }
            (_, 0) => (self.wild_point(), false),
            (_, 1) => (some(self), false),
            (_, 2) => {
                let corners = [some(self), some(self), some(self)];
                (corners.map(|p| p / 3.).into_iter().sum(), false)
            }
            (_, 3) => (some(self) * self.choose(&[2., 1e3, 1e9]), false),
            (_, 4) => (some(self) + self.point() * self.size(), false),
            _ => (some(self) + self.point(), false),
        };
        position = position.clamp(LEAST, -LEAST);
        let mut target = match self.below(8) {
            0 => self.wild_point(),
            1 => DVec3::ZERO,
            2 => position + self.direction() * position.length() * 1e-15,
            3 => position + self.direction(),
            4 => DVec3::Z * self.choose(&[1e300, -1e300, 1e308]),
            _ => some(self),
        };
        target = target.clamp(LEAST, -LEAST);
        if position == target {
            target = position + position.abs().max(DVec3::X);
        }
        let ahead = (0.5 * target - 0.5 * position).normalize_or_zero();
        let mut up = match self.below(6) {
            0 => self.wild_point(),
            1 => ahead + self.point() * self.choose(&[1e-12, 1e-15, 0.]),
            2 => self.point() * 1e-300,
            3 => self.direction(),
            _ => self.choose(&[DVec3::Z, DVec3::Y, DVec3::X, -DVec3::Z]),
        };
        let mut fov = match self.below(12) {
            0 => self.wild(),
            1 => 180. * self.unit(),
            2..5 => self.choose(&[
                1e-9,
                5e-324,
                1e-300,
                179.999999,
                f64::from_bits(180f64.to_bits() - 1),
            ]),
            _ => 70.,
        };
        if self.chance(0.03) {
            match self.below(4) {
                0 => position[self.below(3) as usize] = self.wilder(),
                1 => target[self.below(3) as usize] = self.wilder(),
                2 => up[self.below(3) as usize] = self.wilder(),
                _ => fov = self.wilder(),
            }
            return (View { position, target, up, fov }, false);
        }
        (View { position, target, up, fov }, at_home)
    }
}
