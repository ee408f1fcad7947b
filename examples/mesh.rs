// Says how much light arrives at the faces of a mesh that no file holds, a
// floor below a roof of half its width:
// cargo run --release --example mesh
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::host::{Host, Interrupt};
use litpt::plan::{Budget, Plan, SensorPlan};
use litpt::sensor::Side;
use litpt::{error::Result, run::Run, scene::Mesh, world::World};

pub fn irradiances() -> Result<Vec<[f64; 2]>> {
    let corners = [[0., 0.], [2., 0.], [2., 2.], [0., 2.]];
    let floor = corners.map(|[x, y]| DVec3::new(x, y, 0.));
    let roof = corners.map(|[x, y]| DVec3::new(x / 2., y, 1.));
    let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    let vertices = [floor, roof].concat();
    let mesh = Mesh { vertices, triangles, ..Mesh::default() };
    let sensor = SensorPlan::Faces { side: Side::Front, radiosity: false };
    let budget = Budget::each_within(0.01);
    let plan = Plan { sensor, budget, ..Plan::default() };
    let world = World::new(&plan, mesh.into(), Host::default())?;
    let run = Run::new(&world, &plan, Host::default())?;
    Ok(run.render(&Interrupt::default())?.values())
}

fn main() -> Result<()> {
    println!("irradiances and their errors: {:.4?}", irradiances()?);
    Ok(())
}
