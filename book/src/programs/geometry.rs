// Figures for the chapters on geometry and tests: triangles at one vertex, as
// single precision sees them; and tiles that see nothing.
// "geometry.tex" has the numbers of the text.
//
// usage: geometry FIGURES TABLES
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

mod closeups;
mod views;

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use glam::DVec3;
use litpt::bvh::{Bvh, Hit, Intersector};
use litpt::camera::{Camera, View};
use litpt::scene::{Mesh, Ray, Scene};
use rayon::prelude::*;

use super::{Done, draw};

pub fn run(arguments: &[String]) -> Done {
    let [figures, tables] = arguments else {
        return Err("usage: geometry FIGURES TABLES".into());
    };
    let mut out =
        Out { figures: Path::new(figures), numbers: String::new() };
    closeups::draw(&mut out)?;
    views::draw(&mut out)?;
    Ok(fs::write(Path::new(tables).join("geometry.tex"), &out.numbers)?)
}

/// Where figures go, and the numbers of the text.
struct Out<'a> {
    figures: &'a Path,
    numbers: String,
}

impl Out<'_> {
    /// Writes a picture of values in [0, 1].
    fn picture(&self, name: &str, width: u32, means: Vec<f64>) -> Done {
        let path = self.figures.join(format!("geometry-{name}.png"));
        draw(&path, width, means)
    }

    /// Keeps a number for the text, with two decimal places at most.
    fn number(&mut self, row: &str, column: &str, value: f64) -> Done {
        let entry =
            format!("\\nwmeasured{{geometry}}{{{row}}}{{{column}}}");
        let value = (100. * value).round() / 100.;
        Ok(writeln!(self.numbers, "{entry}{{{value}}}%")?)
    }
}

/// The radiance that has this level of grey on paper.
fn grey(level: f64) -> f64 {
    level.powf(2.2)
}

/// A scene seen by a camera.
struct Stage {
    scene: Scene,
    bvh: Bvh,
    camera: Camera,
    size: (u32, u32),
}

impl Stage {
    fn new(
        mesh: &Mesh,
        view: &View,
        size: (u32, u32),
    ) -> Result<Self, Box<dyn Error>> {
        let scene = Scene::new(mesh);
        let bvh = Bvh::new(&scene)?;
        let aspect = f64::from(size.0) / f64::from(size.1);
        Ok(Self { scene, bvh, camera: Camera::new(view, aspect)?, size })
    }

    /// What is made of the ray and the hit in the middle of each pixel.
    fn pixels<T: Send>(
        &self,
        make: impl Fn(Option<Ray>, Option<Hit>) -> T + Sync,
    ) -> Vec<T> {
        let (width, height) = self.size;
        let entrance = self.scene.frame.entrance(self.camera.position);
        let pixel = |i: u32| {
            let x = (f64::from(i % width) + 0.5) / f64::from(width);
            let y = (f64::from(i / width) + 0.5) / f64::from(height);
            let direction = self.camera.direction(x, y);
            let ray = entrance.enter(direction);
            let hit = ray.and_then(|ray| self.bvh.first_hit(&ray, None));
            make(ray, hit)
        };
        (0..width * height).into_par_iter().map(pixel).collect()
    }
}

/// How bright a surface is that is lit from the upper left.
fn shade(normal: DVec3) -> f64 {
    let light = DVec3::new(0.5, 0.75, 0.43);
    0.5 + 0.5 * normal.dot(light)
}
