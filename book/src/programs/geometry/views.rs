// Tiles that see nothing.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::analysis::background::{KnownPixels, TileContent};
use litpt::camera::View;
use litpt::sky::Sky;

use super::super::{Done, scenes};
use super::{Out, Stage, grey, shade};

/// The statue from farther away than its own view, and the field.
pub fn draw(out: &mut Out) -> Done {
    let view = |position: [f64; 3], target: [f64; 3], fov| View {
        position: position.into(),
        target: target.into(),
        up: DVec3::Y,
        fov,
    };
    let statue = view([0.9, 1.9, 2.3], [-0.03, 1.72, 0.], 35.);
    let field = scenes::field_eye();
    let field = view(field[0], field[1], 60.);
    let pictures = [
        ("statue", scenes::statue(100_000), statue),
        ("field", scenes::field(200_000), field),
    ];
    for (name, mesh, view) in pictures {
        let stage = Stage::new(&mesh, &view, (320, 240))?;
        let sky = Sky::new(view.up);
        let tip = stage.scene.frame.entrance(view.position).place();
        let tip = tip.ok_or("the camera is far away")?;
        let (camera, size) = (&stage.camera, stage.size);
        let known =
            KnownPixels::background(camera, &sky, size, tip, &stage.bvh);
        let (empty, all) = known.count();
        out.number(&format!("tiles {name}"), "all", all as f64)?;
        out.number(&format!("tiles {name}"), "empty", empty as f64)?;
        let lit = stage.pixels(|_, hit| {
            hit.map_or(0.6, |hit| grey(0.1 + 0.55 * shade(hit.normal)))
        });
        let pixels = lit.into_iter().zip(0u32..).map(|(lit, i)| {
            let (x, y) = (i % size.0, i / size.0);
            let border = x % 16 == 0 || y % 16 == 0;
            match known.content((x, y)) {
                TileContent::Scene => lit,
                _ if border => grey(0.6),
                TileContent::Constant(_) => 1.,
                TileContent::Sky => grey(0.9),
            }
        });
        out.picture(&format!("tiles-{name}"), size.0, pixels.collect())?;
    }
    Ok(())
}
