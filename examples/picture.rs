// Makes a picture of a scene, with the error of each pixel:
// cargo run --release --example picture -- doc/examples/room.obj room.exr
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::{env, fs::File};

use litpt::error::{Error, Result};
use litpt::host::{Host, Interrupt};
use litpt::image::{Format, Image};
use litpt::plan::{Budget, Plan};
use litpt::{inputs::Inputs, run::Run, world::World};

pub fn picture(scene: &str) -> Result<Image> {
    let budget = Budget::samples(64);
    let mut plan = Plan { budget, ..Plan::default() };
    plan.surfaces.albedo = 0.5;
    let world = World::new(&plan, Inputs::open(scene)?, Host::default())?;
    let run = Run::new(&world, &plan, Host::default())?;
    Ok(run.render(&Interrupt::default())?.image())
}

fn main() -> Result<()> {
    let words: Vec<_> = env::args().skip(1).collect();
    let [scene, file] = &words[..] else {
        return Err("usage: picture SCENE.obj PICTURE.exr".into());
    };
    let image = picture(scene)?;
    let written = File::create(file)
        .and_then(|mut out| Format::Exr.write(&image, &mut out));
    written.map_err(Error::cannot("write", file))
}
