// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! How long the translation of positions takes, as CSV.
//!
//! usage: cargo run --release -p noweb --example positions MASTER

use std::path::{Path, PathBuf};
use std::time::Instant;

use noweb::map::Filter;
use noweb::project::{self, included};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let master = std::env::args().nth(1).ok_or("which master?")?;
    let dir = PathBuf::from(".");
    let chapters = included(&dir, Path::new(&master))?;
    let project = project::of(chapters, String::new());
    let files = project.expand().map_err(|_| "errors in chapters")?.files;
    let (path, tangled) =
        files.iter().max_by_key(|(_, t)| t.text.len()).ok_or("no file")?;
    let last = tangled.map.last().ok_or("an empty file")?.line / 2;
    let position = format!("at {}:{last}:1\n", path.display());
    let plain = "running 12 tests: 0.25 s at 12:30, all of them ok\n";
    let new = || Filter::new(vec![project.clone()]);
    let text = |filter: &mut Filter, line: &str| {
        filter.translate(line.as_bytes(), 0);
    };
    println!("what,ms");
    println!(
        "the chapters read and tangled,{:.1}",
        best(new, |filter| {
            text(filter, &position);
        })
    );
    let warm = || {
        let mut filter = new();
        text(&mut filter, &position);
        filter
    };
    println!(
        "a thousand positions in text,{:.2}",
        best(warm, |filter| {
            (0..1000).for_each(|_| text(filter, &position));
        })
    );
    println!(
        "a thousand lines without one,{:.2}",
        best(warm, |filter| {
            (0..1000).for_each(|_| text(filter, plain));
        })
    );
    Ok(())
}

/// The least time, in ms, that something takes in twenty attempts.
fn best<T>(prepare: impl Fn() -> T, run: impl Fn(&mut T)) -> f64 {
    let times = (0..20).map(|_| {
        let mut prepared = prepare();
        let start = Instant::now();
        run(&mut prepared);
        start.elapsed().as_secs_f64() * 1e3
    });
    times.fold(f64::INFINITY, f64::min)
}
