// Says how much light arrives at three points of a room, to one per cent:
// cargo run --release --example places -- doc/examples/room.obj
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::env;

use glam::DVec3;
use litpt::host::{Host, Interrupt};
use litpt::inputs::Inputs;
use litpt::plan::{Budget, Plan, SensorPlan};
use litpt::{error::Result, run::Run, world::World};

pub fn irradiances(scene: &str) -> Result<Vec<[f64; 2]>> {
    let points = [1., 3., 5.].map(|x| (DVec3::new(x, 2., 0.85), DVec3::Z));
    let inputs = Inputs::open(scene)?.with_points(points);
    let sensor = SensorPlan::Points("three points".into());
    let budget = Budget::each_within(0.01);
    let mut plan = Plan { sensor, budget, ..Plan::default() };
    plan.surfaces.albedo = 0.5;
    let world = World::new(&plan, inputs, Host::default())?;
    let run = Run::new(&world, &plan, Host::default())?;
    Ok(run.render(&Interrupt::default())?.values())
}

fn main() -> Result<()> {
    let scene = env::args().nth(1).ok_or("usage: places SCENE.obj")?;
    for [value, error] in irradiances(&scene)? {
        println!("{value:.5} ± {error:.5}");
    }
    Ok(())
}
