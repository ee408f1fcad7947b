// Scenes of which some part is superfluous, for tests and tables of shortcuts.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::f64::consts::PI;
use std::sync::Arc;
use std::time::Instant;

use crate::courtyard;
use crate::solids::{add, cube};
use glam::DVec3;
use litpt::analysis::{LitView, SceneAnalysis};
use litpt::bvh::{Bvh, Isa, Quality};
use litpt::camera::{Camera, View};
use litpt::film::{Film, Window};
use litpt::integrator::SingleProcess;
use litpt::materials::Surfaces;
use litpt::render::choose::{Method, Pixels, Sampling, Setup};
use litpt::scene::{Mesh, Scene};
use litpt::sensor::Sensor;
use litpt::sky::Sky;

/// A scene, a view of it, and the albedo of its surfaces.
pub struct Setting {
    pub name: &'static str,
    pub mesh: Mesh,
    pub view: View,
    pub rho: f64,
    /// How its hierarchy is built.
    pub build: (Isa, Quality),
}

/// What a render gave.
pub struct Outcome {
    pub film: Film,
    pub rays: u64,
    /// Seconds of the build with the analysis, and of the render.
    pub seconds: [f64; 2],
    /// The names of the shortcuts that hold.
    pub left_out: Vec<String>,
}

impl Setting {
    /// Renders by the reference, with all shortcuts but those that are
    /// `kept`.
    pub fn render(
        &self,
        kept: &[&str],
        resolution: (u32, u32),
        n: u64,
        seed: u64,
    ) -> Outcome {
        let pixels = Pixels::of_image((1, 1));
        let sampling = Sampling::new(Method::Reference, seed, None, pixels);
        self.render_with(kept, resolution, n, &sampling, |_| ())
    }

    /// The same by any method, with a chance to change what was found.
    pub fn render_with(
        &self,
        kept: &[&str],
        resolution: (u32, u32),
        n: u64,
        sampling: &Sampling,
        lie: impl Fn(&mut SceneAnalysis),
    ) -> Outcome {
        let (width, height) = resolution;
        let aspect = f64::from(width) / f64::from(height);
        let camera = Camera::new(&self.view, aspect).expect("a view");
        let scene = Scene::new(&self.mesh);
        let start = Instant::now();
        let entrance = scene.frame.entrance(camera.position);
        let sensor = &Sensor::Camera(camera, entrance);
        let view = LitView {
            sensor,
            sky: &Sky::new(self.view.up),
            surfaces: Surfaces::of(self.rho),
            resolution,
        };
        let (isa, quality) = self.build;
        let intersector = Bvh::with(&scene, quality, isa);
        let intersector = intersector.expect("a hierarchy");
        let mut analysis =
            SceneAnalysis::find(&scene.left_out, &intersector, &view, kept);
        lie(&mut analysis);
        let found = start.elapsed().as_secs_f64();
        let window = Window { corner: (0, 0), size: resolution };
        let film = Film::cropped(resolution, window, false);
        let mut film = sampling.film(film);
        let start = Instant::now();
        let setup = Setup {
            intersector: &intersector,
            view,
            analysis: &analysis,
            columns: None,
        };
        let mut renderer =
            setup.renderer(sampling, Arc::default(), &SingleProcess);
        let rays = renderer.pass(&mut film, n, &|_| true);
        let seconds = [found, start.elapsed().as_secs_f64()];
        drop(renderer);
        let left_out =
            analysis.left_out().map(|f| f.name.clone()).collect();
        Outcome { film, rays, seconds, left_out }
    }
}

/// All of them.
pub fn all() -> Vec<Setting> {
    let v = DVec3::new;
    let o = DVec3::ZERO;
    let set = |name, mesh, from, to| Setting {
        name,
        mesh,
        view: View { position: from, target: to, up: DVec3::Z, fov: 60. },
        rho: 0.8,
        build: (Isa::best(), Quality::THOROUGH),
    };
    let on_plane = || {
        let mut mesh = square(20.);
        add(&mut mesh, &ball(24), |p| p + v(0., 0., 1.2));
        mesh
    };
    vec![
        Setting {
            view: View { fov: 70., ..courtyard::view() },
            ..set("courtyard", courtyard::mesh(), o, o)
        },
        set("convex solid", ball(40), v(0., -1.8, 0.2), o),
        set("polytope", cut_cube(), v(2., -3., 1.), o),
        set("terrain", terrain(150), v(0., -12., 6.), o),
        set("closed room", room(false), v(0.3, -4., 0.2), o),
        set("room with a window", room(true), v(0.3, -4., 0.2), o),
        set("object on a plane", on_plane(), v(0., -6., 2.), v(0., 0., 1.)),
        set(
            "nothing in view",
            on_plane(),
            v(0., -25., 2.),
            v(0., -30., 2.),
        ),
        set("one triangle", one(), v(0., -4., 0.5), o),
        set("chest", chest(), v(0., -7., 2.), v(0., 0., 1.)),
    ]
}

/// The scene of that name.
pub fn named(name: &str) -> Setting {
    let mut all = all().into_iter();
    all.find(|setting| setting.name == name).expect("its name")
}

/// A horizontal square.
fn square(half: f64) -> Mesh {
    grid(1, half, |_, _| 0.)
}

/// `2 * n * n` triangles over a square.
fn grid(n: u32, half: f64, height: impl Fn(f64, f64) -> f64) -> Mesh {
    let mut mesh = Mesh::default();
    let at = |i: u32| half * (2. * f64::from(i) / f64::from(n) - 1.);
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (at(i), at(j));
            mesh.vertices.push(DVec3::new(x, y, height(x, y)));
        }
    }
    for i in 0..n {
        for j in 0..n {
            let a = i * (n + 1) + j;
            let (b, c, d) = (a + 1, a + n + 1, a + n + 2);
            mesh.triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    mesh
}

/// Gentle hills.
fn terrain(n: u32) -> Mesh {
    grid(n, 10., |x, y| {
        let waves = (1..=8).map(|k| {
            let k = f64::from(k);
            let turn = k * 2.4;
            let along = x * turn.cos() + y * turn.sin();
            (0.25 * k * along + k * k).sin() * 0.5 / k
        });
        waves.sum()
    })
}

/// A sphere of `n` rings around the origin.
fn ball(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..2 * n {
            let polar = PI * f64::from(i) / f64::from(n);
            let turn = PI * f64::from(j) / f64::from(n);
            let (x, y) =
                (polar.sin() * turn.cos(), polar.sin() * turn.sin());
            mesh.vertices.push(DVec3::new(x, y, polar.cos()));
        }
    }
    for i in 0..n {
        for j in 0..2 * n {
            let next = (j + 1) % (2 * n);
            let [a, b] = [j, next].map(|j| i * 2 * n + j);
            let (c, d) = (a + 2 * n, b + 2 * n);
            mesh.triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    mesh
}

/// An octahedron: eight triangles, none of them upright.
fn cut_cube() -> Mesh {
    let vertices = DVec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    let faces = (0..8).map(|i| [i >> 2, 2 + (i >> 1 & 1), 4 + (i & 1)]);
    Mesh {
        vertices: vertices.collect(),
        triangles: faces.collect(),
        ..Mesh::default()
    }
}

/// A room with a block in it, closed or without two triangles of a wall.
fn room(window: bool) -> Mesh {
    let mut mesh = Mesh::default();
    add(&mut mesh, &cube(1), |p| p * 5.);
    if window {
        mesh.triangles.truncate(10);
    }
    add(&mut mesh, &cube(1), |p| p + DVec3::new(1., 3., -3.5));
    mesh
}

fn one() -> Mesh {
    let vertices = vec![
        DVec3::new(-1., 0., -1.),
        DVec3::new(1., 0., -1.),
        DVec3::new(0., 0.3, 1.),
    ];
    Mesh { vertices, triangles: vec![[0, 1, 2]], ..Mesh::default() }
}

/// A closed chest on a plane, with 100 000 triangles in it.
fn chest() -> Mesh {
    let mut mesh = square(20.);
    add(&mut mesh, &cube(1), |p| p * 1.4 + DVec3::new(0., 0., 1.5));
    add(&mut mesh, &ball(160), |p| p + DVec3::new(0., 0., 1.5));
    mesh
}
