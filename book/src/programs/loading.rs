// Reads two large texts by the crate tobj and by our reader, and prints a
// CSV: the speed of the best of some runs, the most memory that a process held,
// its text included, and the time in which the scene is made. Each reader has
// a process of its own, as memory that was held once is not forgotten.
// "make measure" records it for the chapter "The scene".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::env;
use std::error::Error;
use std::fs;
use std::hint::black_box;
use std::io::Write;
use std::process::{Command, Stdio};
use std::time::Instant;

use litpt::scene::{Scene, read_obj};
use rayon::ThreadPoolBuilder;

use super::Done;

const RUNS: usize = 5;
/// Enough for either text; pages that nobody touches are not there.
const CAPACITY: usize = 1 << 30;
/// The kind of the text, its reader, and the threads.
const ROWS: [(&str, &str, &str); 6] = [
    ("triangles", "tobj", "1"),
    ("triangles", "ours", "1"),
    ("triangles", "ours", "2"),
    ("quadrilaterals", "tobj", "1"),
    ("quadrilaterals", "ours", "1"),
    ("quadrilaterals", "ours", "2"),
];

pub fn run(arguments: &[String]) -> Done {
    if let [kind, reader, threads] = arguments {
        return measure(kind, reader, threads.parse()?);
    }
    println!(
        "text,reader,threads,megabytes,million_triangles,\
         megabytes_per_second,peak_megabytes,scene_seconds"
    );
    for (kind, reader, threads) in ROWS {
        let mut child = Command::new(env::current_exe()?);
        child
            .args(["loading", kind, reader, threads])
            .stdout(Stdio::inherit());
        if !child.status()?.success() {
            return Err(format!("{kind}, {reader}: no measurement").into());
        }
    }
    Ok(())
}

/// Prints the row of one reader.
fn measure(
    kind: &str,
    reader: &str,
    threads: usize,
) -> Result<(), Box<dyn Error>> {
    let text = match kind {
        "triangles" => triangles(2357)?,
        _ => quadrilaterals(1832)?,
    };
    let pool = ThreadPoolBuilder::new().num_threads(threads).build()?;
    let mut best = f64::INFINITY;
    let (mut count, mut scene_seconds) = (0, String::new());
    let mut peak = 0;
    for _ in 0..RUNS {
        let start = Instant::now();
        if reader == "tobj" {
            count = by_tobj(&text)?;
            best = best.min(start.elapsed().as_secs_f64());
            peak = most_memory()?;
            continue;
        }
        let mesh = pool.install(|| read_obj(&text))?;
        best = best.min(start.elapsed().as_secs_f64());
        count = mesh.triangles.len();
        // The scene is not a part of the reading.
        if peak == 0 {
            peak = most_memory()?;
        }
        let start = Instant::now();
        black_box(pool.install(|| Scene::new(&mesh)));
        scene_seconds = format!("{:.2}", start.elapsed().as_secs_f64());
    }
    let megabytes = text.len() as f64 / 1e6;
    println!(
        "{kind},{reader},{threads},{megabytes:.0},{:.1},{:.0},{:.0},{}",
        count as f64 / 1e6,
        megabytes / best,
        peak as f64 / 1e6,
        scene_seconds
    );
    Ok(())
}

/// Reads a text with the crate, and counts its triangles.
fn by_tobj(text: &[u8]) -> Result<usize, tobj::LoadError> {
    let options =
        tobj::LoadOptions { triangulate: true, ..Default::default() };
    let none = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut &text[..], &options, none)?;
    let indices = models.iter().map(|model| model.mesh.indices.len());
    Ok(indices.sum::<usize>() / 3)
}

/// A grid of triangles, plainly written.
fn triangles(size: usize) -> std::io::Result<Vec<u8>> {
    let mut text = Vec::with_capacity(CAPACITY);
    vertices(&mut text, size, "v")?;
    for corner in corners(size) {
        let [a, b, c, d] = corner;
        writeln!(text, "f {a} {b} {c}\nf {b} {d} {c}")?;
    }
    Ok(text)
}

/// A grid of quadrilaterals with normals and coordinates of textures.
fn quadrilaterals(size: usize) -> std::io::Result<Vec<u8>> {
    let mut text = Vec::with_capacity(CAPACITY);
    for kind in ["v", "vn", "vt"] {
        vertices(&mut text, size, kind)?;
    }
    for [a, b, c, d] in corners(size) {
        writeln!(
            text,
            "f {a}/{a}/{a} {b}/{b}/{b} {d}/{d}/{d} {c}/{c}/{c}"
        )?;
    }
    Ok(text)
}

fn vertices(
    text: &mut Vec<u8>,
    size: usize,
    kind: &str,
) -> std::io::Result<()> {
    let scale = 1.0 / size as f64;
    for k in 0..size * size {
        let (x, y) = ((k % size) as f64 * scale, (k / size) as f64 * scale);
        let z = (12.0 * x).sin() * (7.0 * y).cos();
        writeln!(text, "{kind} {x:.6} {y:.6} {z:.6}")?;
    }
    Ok(())
}

/// The numbers of the corners of all squares of a grid, from 1.
fn corners(size: usize) -> impl Iterator<Item = [usize; 4]> {
    let rows = (0..size - 1).flat_map(move |row| {
        (0..size - 1).map(move |column| row * size + column + 1)
    });
    rows.map(move |a| [a, a + 1, a + size, a + size + 1])
}

/// The most memory that this process has held, in bytes.
fn most_memory() -> Result<usize, Box<dyn Error>> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let number = line.and_then(|l| l.trim().strip_suffix(" kB"));
    Ok(number.ok_or("no VmHWM")?.parse::<usize>()? << 10)
}
