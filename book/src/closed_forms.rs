// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Scenes whose radiance is known exactly, to test against.
//!
//! The sky is 1 above and 0 below, up is +z, and every surface is
//! diffuse on both sides. Meshes have coordinates that are exact in
//! single precision, except those of circles and spheres.

use std::error::Error;
use std::f64::consts::PI;
use std::iter;
use std::sync::Arc;

use glam::DVec3;

use litpt::analysis::LitView;
use litpt::analysis::background::KnownPixels;
use litpt::bvh::Bvh;
use litpt::camera::{Camera, View};
use litpt::film::{ErrorNorm, Film};
use litpt::integrator::gather::cache::RadianceCache;
use litpt::integrator::gather::{Allocation, Correction, Gather, Tracer};
use litpt::integrator::{PathTracer, SingleProcess};
use litpt::materials::{AlbedoTable, FaceAlbedos, Surfaces};
use litpt::numerics::{power_of_two, sincos_turns};
use litpt::render::{Job, Renderer};
use litpt::sampler::IndependentSampler;
use litpt::scene::{Mesh, Scene};
use litpt::sensor::Sensor;
use litpt::sky::Sky;
use litpt::statistics::Accumulator;

/// A view of a scene, and the radiance that it shows.
pub struct ClosedForm {
    /// What the book calls it, in LaTeX.
    pub name: String,
    /// What is seen.
    pub mesh: Mesh,
    /// From where; the sky has its zenith at +z all the same.
    pub view: View,
    /// The albedos for which `radiance` is known.
    rhos: &'static [f64],
    radiance: Box<dyn Fn(f64) -> f64>,
}

/// The albedos of the tests. The second stands for the limit of
/// a single reflection.
pub const RHOS: [f64; 7] = [0., TINY, 0.2, 0.5, 0.9, 0.99, 1.];

/// So small that paths of two reflections carry nothing.
const TINY: f64 = 1. / 1048576.;

/// All views of scenes whose radiance is known.
pub fn closed_forms() -> Vec<ClosedForm> {
    let mut forms = Vec::new();
    let mut add = |name, mesh, view, rhos, radiance| {
        forms.push(ClosedForm { name, mesh, view, rhos, radiance });
    };
    // Add the views of each section
    let above = look(DVec3::new(0.3, 0.1, 2.), DVec3::ZERO, 20.);
    add("plane".to_owned(), plane(), above, &RHOS, Box::new(|rho| rho));
    let facets = [
        (DVec3::Z, DVec3::new(0.3, 0.2, 3.)),
        (DVec3::new(0.8, 0., 0.6), DVec3::new(2.25, 0.2, 2.)),
        (DVec3::X, DVec3::new(3., 0.2, 0.)),
        (DVec3::new(0.8, 0., -0.6), DVec3::new(2.25, 0.2, -2.)),
        (-DVec3::Z, DVec3::new(0.3, 0.2, -3.)),
    ];
    for (normal, middle) in facets {
        let outside = look(middle + 5. * normal, middle, 5.);
        let name = format!(r"facet, $\cos\theta={}$", normal.z);
        let radiance = Box::new(move |rho: f64| rho * (1. + normal.z) / 2.);
        add(name, gem(), outside, &RHOS, radiance);
    }
    let inside = look(DVec3::ZERO, DVec3::new(1., 0.5, 0.7), 20.);
    let name = "closed cavity".to_owned();
    add(name, gem(), inside, &RHOS[..6], Box::new(|_| 0.));
    let down = look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 20.);
    for f in [0.05, 0.2, 0.5] {
        let name = format!("cavity, $f={f}$");
        let radiance = Box::new(move |rho: f64| cavity_radiance(rho, f));
        add(name, cavity(f, 128), down, &RHOS, radiance);
    }
    let (x, z) = (5. * DVec3::X, 5. * DVec3::Z);
    let v = |x, z| [DVec3::new(x, 0., z), DVec3::new(-x, 0., z)];
    let valleys = [
        ("floor by a wall", [x, z], &RHOS[..]),
        ("wall by a floor", [z, x], &RHOS[..]),
        (r"V, $\alpha=74^\circ$", v(3., 4.), &RHOS[..5]),
        (r"V, $\alpha=90^\circ$", v(4., 4.), &RHOS[..]),
        (r"V, $\alpha=106^\circ$", v(4., 3.), &RHOS[..]),
    ];
    for (name, [s, t], rhos) in valleys {
        let escape = (1. - s.dot(t) / (s.length() * t.length())) / 2.;
        let radiance =
            Box::new(move |rho: f64| cavity_radiance(rho, escape));
        let between = look((s + t) / 2., s, 20.);
        add(name.to_owned(), crossing(s, t), between, rhos, radiance);
    }
    for (degrees, facet) in [(90., 64), (90., 96), (135., 64), (135., 128)]
    {
        let a = f64::to_radians(degrees);
        let side = f64::from(2 * facet + 1) / f64::from(FACETS) - 1.;
        let theta = side * a;
        let (x, z) = libm::sincos(theta);
        let outwards = look(DVec3::ZERO, DVec3::new(x, 0., -z), 0.01);
        let name = format!(
            r"trough, ${degrees}^\circ$ at ${:.1}^\circ$",
            side * degrees
        );
        let radiance =
            Box::new(move |rho: f64| trough_radiance(rho, a, theta));
        add(name, trough(a), outwards, &RHOS, radiance);
    }
    let dented = bowl(0.05, 16, |ring, p| match ring {
        0 => 1.,
        _ => 1. - 0.5 * (100. * p.x * p.y).fract().abs(),
    });
    let certain = &[0., 1.];
    let name = "dented sphere".to_owned();
    add(name, dented, down, certain, Box::new(|rho| rho));
    let eye = DVec3::new(1., -2., 1.5);
    let places = [
        ("floor", DVec3::Z, DVec3::new(2., -1., 0.)),
        ("wall", DVec3::X, DVec3::new(-4., -1., 1.)),
    ];
    for (place, normal, point) in places {
        let share = polygon_share(point, normal, &window()[..4]);
        let towards = look(eye, point, 0.01);
        let name = format!("{place} under a skylight");
        let limit = Box::new(move |rho: f64| rho * share);
        add(name, room(), towards, &RHOS[..2], limit);
    }
    let there = look(eye, DVec3::X, 20.);
    add("room".to_owned(), room(), there, certain, Box::new(|rho| rho));
    forms
}

/// What was computed beside what is known.
pub struct Outcome {
    /// The albedo.
    pub rho: f64,
    /// The radiance that is known.
    pub exact: f64,
    /// The samples.
    pub pixel: Accumulator,
}

impl Outcome {
    /// Whether every sample must be the exact radiance.
    pub fn is_certain(&self) -> bool {
        self.exact == 0. || self.exact == self.rho
    }

    /// The error in standard errors.
    pub fn z(&self) -> f64 {
        (self.pixel.mean() - self.exact) / self.pixel.standard_error()
    }
}

/// The view from `from` towards `to`, `fov` degrees wide.
pub fn look(from: DVec3, to: DVec3, fov: f64) -> View {
    View { position: from, target: to, up: DVec3::Y, fov }
}

/// The surface between the neighbouring points of neighbouring rows.
fn sheet(rows: &[Vec<DVec3>]) -> Mesh {
    let columns = rows.first().map_or(0, Vec::len) as u32;
    let square = |i, j| {
        // Cut one quadrilateral in two
        let d = i * columns + j;
        let b = d - columns;
        let (a, c) = (b - 1, d - 1);
        [[a, b, c], [b, d, c]]
    };
    let triangles = (1..rows.len() as u32)
        .flat_map(|i| (1..columns).flat_map(move |j| square(i, j)));
    let triangles = triangles.collect();
    Mesh { vertices: rows.concat(), triangles, ..Mesh::default() }
}

/// A horizontal square of two triangles, at height 0.
pub fn plane() -> Mesh {
    let row = |y| vec![DVec3::new(-1000., y, 0.), DVec3::new(1000., y, 0.)];
    sheet(&[row(-1000.), row(1000.)])
}

/// The corners of a horizontal square around the z axis, from half its
/// width and its height.
fn square(&(half, z): &(f64, f64)) -> Vec<DVec3> {
    let corners = [(1., 1.), (-1., 1.), (-1., -1.), (1., -1.), (1., 1.)];
    corners.map(|(x, y)| DVec3::new(half * x, half * y, z)).to_vec()
}

/// A closed convex body whose facets have normals of z components
/// 1, 0.6, 0, -0.6 and -1.
fn gem() -> Mesh {
    let half_and_height =
        [(0., -3.), (1.5, -3.), (3., -1.), (3., 1.), (1.5, 3.), (0., 3.)];
    sheet(&half_and_height.each_ref().map(square))
}

/// The radiance of a cavity of albedo `rho`, from every point of
/// whose wall a reflection escapes to the sky with probability `f`: of
/// a sphere that is open over the fraction `f` of its area.
pub fn cavity_radiance(rho: f64, f: f64) -> f64 {
    rho * f / (1. - rho + rho * f)
}

/// A surface around the origin, open at the top like a sphere over the
/// fraction `f` of its area, made of `rings` rings of quadrilaterals.
/// Its `radius` may depend on the ring and the point of the sphere.
fn bowl(f: f64, rings: u32, radius: impl Fn(u32, DVec3) -> f64) -> Mesh {
    let meridians = 2 * rings;
    let rim = libm::acos(1. - 2. * f);
    let vertex = |ring: u32, meridian: u32| {
        // Place one vertex of the bowl
        let polar = rim + (PI - rim) * f64::from(ring) / f64::from(rings);
        let turn = f64::from(meridian) / f64::from(meridians);
        let (x, y) = sincos_turns(turn);
        let distance = libm::sin(polar);
        let p = DVec3::new(distance * x, distance * y, libm::cos(polar));
        p * radius(ring, p)
    };
    let row = |ring| (0..=meridians).map(|j| vertex(ring, j)).collect();
    sheet(&(0..=rings).map(row).collect::<Vec<_>>())
}

/// A sphere of radius 1 around the origin, open at the top over the
/// fraction `f` of its area, made of `rings` rings of quadrilaterals.
pub fn cavity(f: f64, rings: u32) -> Mesh {
    bowl(f, rings, |_, _| 1.)
}

/// Two planes through the y axis, one through `s` and the other through
/// `t`, that reach 2^40 times as far.
fn crossing(s: DVec3, t: DVec3) -> Mesh {
    let y = 8. * DVec3::Y;
    let arm = |u: DVec3| [-y, u - y, u + y, y, y, y - u, -u - y, -y];
    let round = [arm(s), arm(t)].concat();
    let row = |size| round.iter().map(|&p| p * size).collect();
    let sizes = (0..=10).map(|k| power_of_two(4 * k));
    sheet(&iter::once(0.).chain(sizes).map(row).collect::<Vec<_>>())
}

/// The radiance at the angle `theta` from the bottom of an endless
/// circular trough that reaches to the angle `a` on both sides.
pub fn trough_radiance(rho: f64, a: f64, theta: f64) -> f64 {
    let root = libm::sqrt(1. - rho);
    let k = root / 2.;
    let (sine, cosine) = libm::sincos(a / 2.);
    let (sine_k, cosine_k) = libm::sincos(k * a);
    rho * cosine * libm::cos(k * theta)
        / (cosine * cosine_k + root * sine * sine_k)
}

const FACETS: u32 = 129;

/// A circular trough along the y axis, 8192 times as long as its
/// radius of 1, that reaches to the angle `a` on both sides.
fn trough(a: f64) -> Mesh {
    let row = |i| {
        let side = 2. * f64::from(i) / f64::from(FACETS) - 1.;
        let (x, z) = libm::sincos(side * a);
        let end = |y| DVec3::new(x, y, -z);
        vec![end(-4096.), end(4096.)]
    };
    sheet(&(0..=FACETS).map(row).collect::<Vec<_>>())
}

/// The share of the directions from `point`, distributed as the cosine
/// with `normal`, that go through a polygon in front of the surface
/// (Lambert 1760).
pub fn polygon_share(
    point: DVec3,
    normal: DVec3,
    polygon: &[DVec3],
) -> f64 {
    let next = polygon.iter().cycle().skip(1);
    let side = |(&a, &b): (&DVec3, &DVec3)| {
        let (v, w) = (a - point, b - point);
        let across = v.cross(w);
        let sine = across.length();
        libm::atan2(sine, v.dot(w)) * normal.dot(across) / sine
    };
    polygon.iter().zip(next).map(side).sum::<f64>().abs() / (2. * PI)
}

/// The corners of the window, the first repeated.
fn window() -> Vec<DVec3> {
    let corners =
        [(1.5, 1.), (-0.5, 1.5), (-1., -1.), (2., -0.5), (1.5, 1.)];
    corners.map(|(x, y)| DVec3::new(x, y, 3.)).to_vec()
}

/// A closed box with a window in its lid.
fn room() -> Mesh {
    let [middle, floor, lid] =
        [(0., 0.), (4., 0.), (4., 3.)].each_ref().map(square);
    sheet(&[middle, floor, lid, window()])
}

/// A scene with a camera in it, ready to be rendered.
pub struct Setting {
    sensor: Sensor,
    intersector: Bvh,
    integrator: PathTracer<'static>,
}

impl Setting {
    /// A mesh of albedo `rho` under the sky of `up`, seen by a
    /// camera whose image has this `aspect`.
    pub fn new(
        mesh: &Mesh,
        (rho, up): (f64, DVec3),
        view: &View,
        aspect: f64,
    ) -> Result<Self, Box<dyn Error>> {
        let camera = Camera::new(view, aspect)?;
        let scene = Scene::new(mesh);
        let intersector = Bvh::new(&scene)?;
        let sky = Sky::new(up);
        let integrator = PathTracer::new(Surfaces::of(rho), sky);
        let entrance = scene.frame.entrance(view.position);
        let sensor = Sensor::Camera(camera, entrance);
        Ok(Self { sensor, intersector, integrator })
    }

    /// The same with these albedos, for the rest of the program.
    pub fn painted(
        self,
        faces: &FaceAlbedos,
    ) -> litpt::error::Result<Self> {
        let table = AlbedoTable::new(faces, &self.intersector)?;
        let surfaces = Surfaces::new(Box::leak(table.into()), None);
        let sky = self.integrator.sky.clone();
        Ok(Self { integrator: PathTracer::new(surfaces, sky), ..self })
    }

    /// What is shown of it in an image of this width and height.
    pub fn view(&self, resolution: (u32, u32)) -> LitView<'_> {
        let Self { sensor, integrator, .. } = self;
        let PathTracer { surfaces, ref sky, .. } = *integrator;
        LitView { sensor, sky, surfaces, resolution }
    }

    /// A gather that renders it, of the seed 0.
    pub fn gather(&self, resolution: (u32, u32)) -> Gather<'_> {
        Gather {
            patches: None,
            view: self.view(resolution),
            intersector: &self.intersector,
            known_pixels: KnownPixels::NOTHING,
            seed: 0,
            norm: ErrorNorm::default(),
            training: 1 << 16,
            correction: Some(Correction::default()),
            learnt: Arc::default(),
            communicator: &SingleProcess,
        }
    }

    /// The job that renders it.
    pub fn job(&self, seed: u64) -> Job<'_, Bvh, PathTracer<'_>> {
        let Self { sensor, intersector, integrator } = self;
        let integrator = integrator.clone();
        let known_pixels = KnownPixels::NOTHING;
        let sampler = IndependentSampler::new(seed);
        Job { sensor, intersector, integrator, known_pixels, sampler }
    }
}

impl Setting {
    /// Its only pixel, after `n` samples.
    fn pixel(&self, n: u64, seed: u64) -> Accumulator {
        let mut film = Film::new(1, 1);
        self.job(seed).pass(&mut film, n, &|_| true);
        *film.pixel(0, 0)
    }
}

/// The pixel that a view of a mesh shows under the sky of +z, after
/// `n` samples.
pub fn pixel(
    mesh: &Mesh,
    rho: f64,
    view: &View,
    n: u64,
) -> Result<Accumulator, Box<dyn Error>> {
    Ok(Setting::new(mesh, (rho, DVec3::Z), view, 1.)?.pixel(n, 2026))
}

impl ClosedForm {
    /// What `n` samples give at each albedo, the first of
    /// which has the `seed`, the others the next ones.
    pub fn outcomes(
        &self,
        n: u64,
        seed: u64,
    ) -> Result<Vec<Outcome>, Box<dyn Error>> {
        let sky = (0., DVec3::Z);
        let mut setting = Setting::new(&self.mesh, sky, &self.view, 1.)?;
        let outcome = |(seed, &rho): (u64, &f64)| {
            setting.integrator.surfaces = Surfaces::of(rho);
            let pixel = setting.pixel(n, seed);
            Outcome { rho, exact: (self.radiance)(rho), pixel }
        };
        Ok((seed..).zip(self.rhos).map(outcome).collect())
    }
}

/// A tracer in the middle of a gather, on any processor.
pub fn tracer<'a>(
    gather: &'a Gather<'a>,
    cache: &'a RadianceCache,
    allocation: &'a Allocation,
) -> Tracer<'a, Bvh> {
    let intersector = gather.intersector;
    Tracer::new(gather, intersector, cache, allocation)
}
