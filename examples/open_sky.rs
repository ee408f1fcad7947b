// Says which share of the sky a point sees, by rays that ask for any hit:
// cargo run --release --example open_sky -- FILE.obj X Y Z
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;

use glam::DVec3;
use litpt::bvh::{Bvh, Intersector};
use litpt::numerics::sincos_turns;
use litpt::scene::{Scene, read_obj};

const RAYS: u32 = 10_000;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<_> = std::env::args().skip(1).collect();
    let [path, x, y, z] = &words[..] else {
        return Err("usage: open_sky FILE.obj X Y Z".into());
    };
    let point = DVec3::new(x.parse()?, y.parse()?, z.parse()?);
    let scene = Scene::new(&read_obj(&std::fs::read(path)?)?);
    let intersector = Bvh::new(&scene)?;
    let entrance = scene.frame.entrance(point);
    // A spiral of directions, evenly over the hemisphere around z.
    let is_open = |i: &u32| {
        let up = (f64::from(*i) + 0.5) / f64::from(RAYS);
        let (a, b) = sincos_turns((f64::from(*i) * 0.618_034).fract());
        let across = (1. - up * up).sqrt();
        let direction = DVec3::new(across * a, across * b, up);
        let ray = entrance.enter(direction);
        !ray.is_some_and(|ray| intersector.is_occluded(&ray, None))
    };
    let open = (0..RAYS).filter(is_open).count();
    println!("{:.1} % of the sky", 100. * open as f64 / f64::from(RAYS));
    Ok(())
}
