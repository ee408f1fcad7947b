// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Measures what is wrong with the path tracer of the first chapter, a CSV for
//! "make tiny".

use std::error::Error;
use std::time::Instant;

use glam::DVec3;
use litpt::host::{Host, Interrupt};
use litpt::image::Image;
use litpt::plan::{Budget, CameraPlan, Plan, SensorPlan, Stand};
use litpt::render::choose::Method;
use litpt::{run::Run, scene::Mesh, world::World};
use litpt_book::solids::{cube, icosphere};
use rayon::ThreadPoolBuilder;

use super::Done;

#[allow(dead_code)]
#[path = "../../../examples/tiny.rs"]
mod example;

use example::{Camera, HEIGHT, Triangle, WIDTH};

pub fn run(words: &[String]) -> Done {
    let [file] = words else {
        return Err("usage: tiny TERRACE.obj".into());
    };
    let terrace = Case {
        triangles: example::read(&std::fs::read_to_string(file)?)?,
        position: [5., 0.2, 2.6],
        target: [2.2, 2.5, 0.55],
    };
    println!("what,tiny,pt");
    slow()?;
    let truth = terrace.image(TRUTH, None, 0)?.means;
    let image = terrace.image(PATHS, None, 0)?;
    let errors = image.errors.ok_or("an image without errors")?;
    let ours: Pixels = image.means.into_iter().zip(errors).collect();
    let both = [terrace.pixels(PATHS), ours];
    let [tiny, ours] = both.each_ref().map(|it| rmse(it, &truth));
    println!(
        "root mean square error with {PATHS} paths,{tiny:.4},{ours:.4}"
    );
    leaks()?;
    let seconds = [1, 2].map(|n| timed(|| terrace.image(1024, PATH, n)));
    let [one, two] = seconds;
    println!("gain of a second thread,1.0,{:.1}", one? / two?);
    let [tiny, ours] = both.map(|it| beyond(&it, &truth));
    println!(
        "pixels more than three errors off (of 100),{tiny:.2},{ours:.2}"
    );
    Ok(())
}

const PATHS: u64 = 16;
const TRUTH: u64 = 16384;
const PATH: Option<Method> = Some(Method::Reference);

/// Mean and error of each pixel.
type Pixels = Vec<(f64, f64)>;

/// The time of a path that meets many triangles, on one thread.
fn slow() -> Done {
    let ball = Case::of(&icosphere(6), 1., [3., 0., 0.]);
    let per_path = |seconds: f64, paths: u64| {
        seconds * 1e6 / (paths as usize * WIDTH * HEIGHT) as f64
    };
    let tiny = per_path(timed(|| Ok(ball.pixels(1)))?, 1);
    let ours = per_path(timed(|| ball.image(256, PATH, 1))?, 256);
    let number = ball.triangles.len();
    println!(
        "microseconds of a path in a scene of {number} triangles,{tiny:.0},{ours:.2}"
    );
    Ok(())
}

/// What a camera in a closed box sees of the sky.
fn leaks() -> Done {
    let closed = Case::of(&cube(1), 5e-5, [0.; 3]);
    let tiny: f64 = closed.pixels(PATHS).iter().map(|it| it.0).sum();
    let ours: f64 = closed.image(PATHS, PATH, 0)?.means.iter().sum();
    let [tiny, ours] = [tiny, ours].map(|it| it / (WIDTH * HEIGHT) as f64);
    println!("light in a closed box of 0.1 millimetres,{tiny:.4},{ours}");
    Ok(())
}

/// How many seconds something takes.
fn timed<T>(
    job: impl FnOnce() -> Result<T, Box<dyn Error>>,
) -> Result<f64, Box<dyn Error>> {
    let began = Instant::now();
    job()?;
    Ok(began.elapsed().as_secs_f64())
}

fn rmse(pixels: &Pixels, truth: &[f64]) -> f64 {
    let squares = pixels.iter().zip(truth);
    let sum: f64 = squares.map(|(it, t)| (it.0 - t).powi(2)).sum();
    (sum / truth.len() as f64).sqrt()
}

/// How many of a hundred pixels are too far from the truth.
fn beyond(pixels: &Pixels, truth: &[f64]) -> f64 {
    let is_off = |(it, t): &(&(f64, f64), &f64)| {
        (it.0 - **t).abs() > 3. * it.1 + 1e-9
    };
    let off = pixels.iter().zip(truth).filter(is_off).count();
    100. * off as f64 / truth.len() as f64
}

/// A scene and a camera.
struct Case {
    triangles: Vec<Triangle>,
    position: [f64; 3],
    target: [f64; 3],
}

impl Case {
    /// A mesh around the origin, scaled, seen by a camera that looks along
    /// the x axis.
    fn of(mesh: &Mesh, scale: f64, position: [f64; 3]) -> Self {
        let corner =
            |i: u32| (scale * mesh.vertices[i as usize]).to_array();
        let triangles = mesh.triangles.iter().map(|t| t.map(corner));
        let [x, y, z] = position;
        let target = [x - 1., y, z];
        Self { triangles: triangles.collect(), position, target }
    }

    fn pixels(&self, paths: u64) -> Pixels {
        let camera = Camera::new(self.position, self.target);
        example::render(&self.triangles, &camera, paths as usize)
    }

    /// What `pt` makes of it; all threads are zero.
    fn image(
        &self,
        samples: u64,
        method: Option<Method>,
        threads: usize,
    ) -> Result<Image, Box<dyn Error>> {
        let [position, target] = [self.position, self.target];
        let camera = CameraPlan {
            resolution: (WIDTH as u32, HEIGHT as u32),
            stand: Stand::At(position.into(), target.into()),
            ..CameraPlan::default()
        };
        let (sensor, budget) =
            (SensorPlan::Camera(camera), Budget::samples(samples));
        let mut plan = Plan { sensor, budget, method, ..Plan::default() };
        plan.surfaces.albedo = 0.5;
        let pool = ThreadPoolBuilder::new().num_threads(threads).build()?;
        let image = pool.install(|| {
            let mesh = self.mesh().into();
            let world = World::new(&plan, mesh, Host::default())?;
            let run = Run::new(&world, &plan, Host::default())?;
            run.render(&Interrupt::default()).map(|run| run.image())
        });
        Ok(image?)
    }

    fn mesh(&self) -> Mesh {
        let corners = self.triangles.iter().flatten();
        let vertices = corners.map(|&it| DVec3::from(it)).collect();
        let number = |t: u32| [3 * t, 3 * t + 1, 3 * t + 2];
        let triangles = (0..self.triangles.len() as u32).map(number);
        Mesh { vertices, triangles: triangles.collect(), ..Mesh::default() }
    }
}
