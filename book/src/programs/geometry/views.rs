// Tiles that see nothing, a section through closed solids, and scenes of
// known radiance.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::fmt::Write as _;

use glam::DVec3;
use litpt::analysis::background::{
    BackgroundTiles, KnownPixels, TileContent,
};
use litpt::analysis::interior::{Parts, above};
use litpt::camera::View;
use litpt::film::Film;
use litpt::render::Renderer;
use litpt::scene::Scene;
use litpt::sky::Sky;
use litpt_book::closed_forms::{Setting, closed_forms};
use litpt_book::courtyard;
use rayon::prelude::*;

use super::super::{Done, closed_forms, scenes};
use super::{Out, Stage, grey, shade};

pub fn draw(out: &mut Out) -> Done {
    tiles(out)?;
    section(out)?;
    gallery(out)
}

/// The statue from farther away than its own view, and the field.
fn tiles(out: &mut Out) -> Done {
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
        let tip = stage.scene.place(view.position);
        let tip = tip.ok_or("the camera is far away")?;
        let (camera, size) = (&stage.camera, stage.size);
        let tiles =
            BackgroundTiles::new(camera, sky, size, tip, &stage.bvh);
        let (all, empty, _) = tiles.count(size);
        out.number(&format!("tiles {name}"), "all", all as f64)?;
        out.number(&format!("tiles {name}"), "empty", empty as f64)?;
        let known = KnownPixels::Background(tiles);
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

/// Pixels of the section along x.
const WIDTH: u32 = 480;

/// The courtyard cut upright: how many triangles are on one side of each
/// point, and whether it is inside of a closed solid.
fn section(out: &mut Out) -> Done {
    let scene = Scene::new(&courtyard::mesh());
    let triangles = scene.triangles();
    let parts = Parts::new(&triangles);
    let [low, high] =
        [DVec3::new(-13.2, -0.4, SECTION), DVec3::new(13.2, 7.4, SECTION)]
            .map(|p| scene.place(p).unwrap_or_default());
    let side = (high.x - low.x) / f64::from(WIDTH);
    let height = ((high.y - low.y) / side) as u32;
    let column = |i: u32| {
        let x = low.x + (f64::from(i) + 0.5) * side;
        let near = |i: &u32| {
            let [a, b, c] = triangles[*i as usize].map(|p| p.x);
            a.min(b).min(c) < x + 1. && a.max(b).max(c) > x - 1.
        };
        let near: Vec<u32> =
            (0..triangles.len() as u32).filter(near).collect();
        let own: Vec<_> =
            near.iter().map(|&i| triangles[i as usize]).collect();
        let point = |j: u32| {
            let y = high.y - (f64::from(j) + 0.5) * side;
            let found = above(&own, DVec3::new(x, y, low.z));
            found.map_or((f64::NAN, true), |found| {
                let found: Vec<_> =
                    found.iter().map(|&i| near[i as usize]).collect();
                (found.len() as f64, parts.enclose(&found))
            })
        };
        (0..height).map(point).collect::<Vec<_>>()
    };
    let columns: Vec<_> = (0..WIDTH).into_par_iter().map(column).collect();
    let at = |i: u32| columns[(i % WIDTH) as usize][(i / WIDTH) as usize];
    let all = || (0..WIDTH * height).map(at);
    let most = all().map(|p| p.0).fold(0., f64::max);
    out.number("section", "most", most)?;
    let counts = all().map(|p| grey(1. - 0.9 * (p.0 / 24.).min(1.)));
    out.picture("section-counts", WIDTH, counts.collect())?;
    let inside = all().map(|p| if p.1 { grey(0.25) } else { grey(0.97) });
    out.picture("section-inside", WIDTH, inside.collect())
}

/// Where the courtyard is cut, along z.
const SECTION: f64 = 5.413;

/// Pictures of six closed forms, with the known radiance of the view of the
/// table and that which pt finds.
fn gallery(out: &mut Out) -> Done {
    let (rho, size) = (0.9, (128, 96));
    let view = |position: [f64; 3], target: [f64; 3], fov| View {
        position: position.into(),
        target: target.into(),
        up: DVec3::Z,
        fov,
    };
    let chosen = [
        ("facet, $\\cos\\theta=0.6$", [8., -9., 5.], [0.; 3], 34.),
        ("cavity, $f=0.2$", [1.5, -2.1, 2.6], [0.; 3], 38.),
        ("floor by a wall", [4., -9., 3.], [2., 9., 3.], 70.),
        ("V, $\\alpha=90^\\circ$", [0., -9., 5.], [0., 9., 5.], 70.),
        (
            "trough, $135^\\circ$ at $0.0^\\circ$",
            [0., -3., 0.2],
            [0., 3., -0.4],
            80.,
        ),
        ("room", [3.4, -3.6, 1.5], [-1.5, 2., 1.4], 75.),
    ];
    let forms = closed_forms();
    let mut rows = String::new();
    for (number, (name, eye, target, fov)) in chosen.into_iter().enumerate()
    {
        let all = forms.iter().zip((0..).step_by(10));
        let found = all.clone().find(|(form, _)| form.name == name);
        let (form, seed) = found.ok_or("no such closed form")?;
        let aspect = f64::from(size.0) / f64::from(size.1);
        let view = view(eye, target, fov);
        let setting =
            Setting::new(&form.mesh, (rho, DVec3::Z), &view, aspect)?;
        // Paths are long between planes without an end, and all alike.
        let samples = if name.contains("wall") || name.starts_with('V') {
            16
        } else {
            256
        };
        let mut film = Film::new(size.0, size.1);
        setting.job(seed).pass(&mut film, samples, &|_| true);
        let means = film.means().collect();
        out.picture(&format!("form-{number}"), size.0, means)?;
        let outcomes = form.outcomes(closed_forms::SAMPLES, seed)?;
        let shown = outcomes.iter().find(|o| o.rho == rho);
        let Some(shown) = shown.or(outcomes.last()) else { continue };
        let (mean, error) =
            (shown.pixel.mean(), shown.pixel.standard_error());
        writeln!(
            rows,
            "\\form{{{number}}}{{{name}}}{{{}}}{{{:.4}}}{{{mean:.4}}}{{{:.0}}}%",
            shown.rho,
            shown.exact,
            1e4 * error
        )?;
    }
    out.table("geometry-forms.tex", &rows)
}
