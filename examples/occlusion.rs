// Writes the vertices of an OBJ with their ambient occlusion, by 256 rays
// each, as grey behind their coordinates; pt --vertices -r 0 --sky sphere
// gives the same with errors:
// cargo run --release --example occlusion -- FILE.obj > grey.obj
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::io::{BufWriter, Write, stdout};
use std::time::Instant;

use litpt::bvh::{Bvh, Intersector};
use litpt::sampler::sobol::SobolSampler;
use litpt::sampler::{Sampler, cosine_direction};
use litpt::scene::{Mesh, Ray, Scene, read_obj};
use litpt::sensor::Receivers;
use rayon::prelude::*;

const RAYS: u64 = 256;

fn main() -> Result<(), Box<dyn Error>> {
    let path =
        std::env::args().nth(1).ok_or("usage: occlusion FILE.obj")?;
    let mesh = read_obj(&std::fs::read(path)?)?;
    let grey = openness(&mesh)?;
    let mut out = BufWriter::new(stdout().lock());
    for (p, g) in mesh.vertices.iter().zip(grey) {
        writeln!(out, "v {} {} {} {g} {g} {g}", p.x, p.y, p.z)?;
    }
    for [a, b, c] in mesh.triangles.iter().map(|c| c.map(|i| i + 1)) {
        writeln!(out, "f {a} {b} {c}")?;
    }
    Ok(())
}

/// The part of the hemisphere around the normal of each vertex that is open,
/// weighted by the cosine; 0 of a vertex without a normal.
///
/// # Errors
/// The mesh has too many triangles for a hierarchy.
pub fn openness(mesh: &Mesh) -> Result<Vec<f64>, Box<dyn Error>> {
    let scene = Scene::new(mesh);
    let bvh = Bvh::new(&scene)?;
    let vertices = Receivers::vertices(&scene.triangles);
    let began = Instant::now();
    let open = |i: usize| {
        let from = vertices.hit(i, [0, 0]);
        let sampler = SobolSampler::new(1, RAYS);
        let is_open = |n: &u64| {
            let [r, turn] = sampler.start(i as u64, *n).get_2d(2);
            let direction = cosine_direction(from.normal, r, turn);
            let ray = Ray { origin: from.point, direction };
            !bvh.is_occluded(&ray, Some(from.primitive))
        };
        (0..RAYS).filter(is_open).count() as f64 / RAYS as f64
    };
    let open: Vec<f64> =
        (0..vertices.numbers.len()).into_par_iter().map(open).collect();
    eprintln!("{:.3} s for the rays", began.elapsed().as_secs_f64());
    let mut grey = vec![0.; mesh.vertices.len()];
    for (&number, open) in vertices.numbers.iter().zip(open) {
        grey[number as usize] = open;
    }
    Ok(grey)
}
