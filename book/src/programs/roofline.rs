// Counts what the traversals of real paths look at, times them, and prints a
// row of a CSV. Takes the options of pt for a scene and its view.
//   nodes,leaves,bytes  that a ray reads, with sixteen children a node
//   nanoseconds         of a traversal, with one thread
//   foreseen            the same if each ray is traced many times in a row,
//                       so that caches and branches hold no surprises
// "make roofline" records it for the chapter "The traversal".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::fs;
use std::sync::atomic::{AtomicUsize, Ordering};

use clap::Parser;
use litpt::arguments::Arguments;
use litpt::bvh::anatomy::Anatomy;
use litpt::bvh::{Bvh, Hit, Intersector, Isa, Quality};
use litpt::camera::Camera;
use litpt::integrator::PathTracer;
use litpt::scene::{Ray, Scene, read_obj};
use litpt::sky::Sky;
use litpt_book::paths;

use super::Done;
use super::repeats::{Rays, seconds};

const RAYS: usize = 100_000;
/// Traces of a ray in a row, and those among them that are not counted.
const REPEATS: (usize, usize) = (48, 16);

/// A hierarchy, with the nodes, leaves and bytes that its rays have read.
struct Counter {
    anatomy: Anatomy,
    counts: [AtomicUsize; 3],
}

impl Intersector for Counter {
    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        let (steps, hit) = self.anatomy.walk(ray, from);
        let leaves = steps.iter().filter(|step| step.leaf().0).count();
        let bytes = steps.iter().map(|step| step.bytes()).sum();
        let read = [steps.len() - leaves, leaves, bytes];
        for (count, read) in self.counts.iter().zip(read) {
            count.fetch_add(read, Ordering::Relaxed);
        }
        hit
    }
}

pub fn run(arguments: &[String]) -> Done {
    let name = std::iter::once("roofline");
    let words = name.chain(arguments.iter().map(String::as_str));
    let arguments = Arguments::parse_from(words);
    let input = arguments.input.as_ref().ok_or("name a scene: -i FILE")?;
    let scene = Scene::new(&read_obj(&fs::read(input)?)?);
    let view = arguments.view();
    let camera = Camera::new(&view, 4. / 3.)?;
    let integrator =
        PathTracer { albedo: arguments.albedo, sky: Sky::new(view.up) };
    let counter = Counter {
        anatomy: Anatomy::new(&scene, Quality::Thorough)?,
        counts: Default::default(),
    };
    let counted =
        paths::record(&scene, &counter, &camera, &integrator, 0, RAYS)?;
    let each = counter
        .counts
        .map(|count| count.into_inner() as f64 / counted.len() as f64);
    let [nodes, leaves, bytes] = each;
    let intersector = Bvh::with(&scene, Quality::Thorough, Isa::best())?;
    let rays: Rays =
        paths::record(&scene, &intersector, &camera, &integrator, 0, RAYS)?;
    let time = |repeats| {
        1e9 * seconds(&intersector, &rays, repeats) / rays.len() as f64
    };
    let (many, few) = REPEATS;
    let foreseen = (time(many) - time(few)) / (many - few) as f64;
    let name = input.file_stem().unwrap_or_default().to_string_lossy();
    println!("scene,nodes,leaves,bytes,nanoseconds,foreseen");
    println!(
        "{name},{nodes:.2},{leaves:.2},{bytes:.0},{:.0},{foreseen:.0}",
        time(1)
    );
    Ok(())
}
