// Tangled from chapters/filter.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Looks at the pixels of an image, for the fragments that they show.

use std::array;

use glam::DVec3;
use rayon::prelude::*;

use crate::analysis::LitView;
use crate::bvh::{BEAM, Bvh, GROUND};
use crate::film::{Film, Fragment, Fragments, Window, best_of};
use crate::sampler::{to_unit, within};
use crate::sensor::{Place, Sensor};

/// What a ray through a pixel sees: a surface, and the light of the sun that
/// it reflects, or the sky, and its radiance.
type Seen = (Option<Fragment>, f32);

/// Whether two rays see the same.
fn is_same((one, light): &Seen, (other, beyond): &Seen) -> bool {
    let is_like = match (one, other) {
        (Some(one), Some(other)) => one.is_like(other),
        (None, None) => true,
        _ => false,
    };
    is_like && (beyond - light).abs() <= 0.1
}

/// The most surfaces of a pixel that are distinguished.
const SURFACES: usize = 3;

/// What a pixel shows: surfaces, and what the sky and the sun add.
type Shown = (Vec<Fragment>, [f32; 2]);

/// Counts a ray for a part of a pixel.
fn add((fragments, lights): &mut Shown, (surface, light): Seen, part: f32) {
    lights[usize::from(surface.is_some())] += part * light;
    let Some(seen) = surface else { return };
    let like = best_of(fragments, &seen).filter(|&k| {
        fragments.len() == SURFACES || fragments[k].is_like(&seen)
    });
    let place = like.unwrap_or_else(|| {
        fragments.push(seen);
        fragments.len() - 1
    });
    fragments[place].coverage += part;
}

/// Point `i` of a net of `count` in a pixel, a power of two.
fn point(i: usize, count: usize) -> [u32; 2] {
    let (i, bits) = (i as u32, count.trailing_zeros());
    [i << (32 - bits), i.reverse_bits()].map(|u| u + (1 << (31 - bits)))
}

/// Rays of the first look at a pixel.
const FIRST: usize = 4;

/// Looks at the pixels of a window, each at 4 points. Where these or the
/// neighbours in the window of the run differ, looks at 16 points, or at 64
/// if the sky is seen there.
pub fn fragments(
    bvh: &Bvh,
    view: &LitView,
    (window, run_window): (Window, Window),
) -> Fragments {
    let origin = match view.sensor {
        Sensor::Camera(_, entrance) => entrance.nearest(),
        Sensor::Receivers(_) => DVec3::ZERO,
    };
    let look = |places| look(bvh, view, origin, &places);
    let frame = window.grown(1, run_window);
    let (width, area) = (frame.size.0 as usize, frame.area());
    let pixel = |p: usize| {
        let (x, y) = ((p % width) as u32, (p / width) as u32);
        (frame.corner.0 + x, frame.corner.1 + y)
    };
    // Look at each pixel once
    let beams = (0..area.div_ceil(BEAM / FIRST)).into_par_iter();
    let firsts = beams.flat_map_iter(|beam| {
        let places = array::from_fn(|i| {
            let p = beam * (BEAM / FIRST) + i / FIRST;
            let there = (p < area).then(|| pixel(p));
            there.map(|pixel| (pixel, point(i % FIRST, FIRST)))
        });
        let rays = look(places);
        let pixels: [_; BEAM / FIRST] = array::from_fn(|k| {
            let own = &rays[k * FIRST..][..FIRST];
            (own[0], own.iter().all(|it| is_same(&own[0], it)))
        });
        pixels
    });
    let mut firsts: Vec<(Seen, bool)> = firsts.collect();
    firsts.truncate(area);
    // Look closer where there is an edge
    let closer = |p: usize| {
        let mut shown = Shown::default();
        let near = || around(p, width, area).map(|q| &firsts[q].0);
        let (first, is_plain) = &firsts[p];
        if *is_plain && near().all(|it| is_same(first, it)) {
            add(&mut shown, *first, 1.);
            return shown;
        }
        let has_sky = near().any(|(surface, _)| surface.is_none());
        let beams = if has_sky { 4 } else { 1 };
        for beam in 0..beams {
            let number = |i| point(i * beams + beam, BEAM * beams);
            let places = array::from_fn(|i| Some((pixel(p), number(i))));
            for ray in look(places) {
                add(&mut shown, ray, 1. / (BEAM * beams) as f32);
            }
        }
        shown
    };
    let (left, top) = window.corner;
    let rows = (top..window.end().1).into_par_iter();
    let shown = rows.flat_map_iter(|y| {
        let first = (y - frame.corner.1) as usize * width;
        let first = first + (left - frame.corner.0) as usize;
        (first..first + window.size.0 as usize).map(closer)
    });
    Fragments::new(window, origin, shown.collect::<Vec<Shown>>())
}

/// The pixels around a pixel and itself, for this width and area.
fn around(
    p: usize,
    width: usize,
    area: usize,
) -> impl Iterator<Item = usize> {
    let near = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
    let (columns, rows) =
        (near(p % width, width), near(p / width, area / width));
    rows.flat_map(move |y| columns.clone().map(move |x| y * width + x))
}

/// What rays at these places of pixels see.
fn look(
    bvh: &Bvh,
    view: &LitView,
    origin: DVec3,
    places: &[Option<Place>; BEAM],
) -> [Seen; BEAM] {
    let (surfaces, size) = (&view.surfaces, view.resolution);
    let starts = view.sensor.starts(bvh, surfaces, places, size, false);
    array::from_fn(|i| {
        let light = match starts.hits[i].as_ref() {
            None => view.sky.seen(starts.directions[i]),
            Some(_) if view.sky.beam.is_none() => 0.,
            Some(hit) => {
                let [u, v] = places[i].unwrap_or_default().1.map(to_unit);
                let mut u = [v, u];
                let side = surfaces.lit_side(hit, &mut u[0]);
                let albedo = surfaces.albedo(hit.primitive);
                albedo * view.sunlight(bvh, &side, u).0
            }
        };
        let light = (starts.transmittances[i] * light) as f32;
        let hit = starts.hits[i].as_ref();
        (hit.map(|hit| Fragment::new(origin, hit)), light)
    })
}

/// The means of at most about 2^14 pixels of a film, evenly spread, whose
/// centres show a surface of the scene, and not the ground below it.
pub fn surface_means(bvh: &Bvh, view: &LitView, film: &Film) -> Vec<f64> {
    let ((left, top), (right, bottom)) =
        (film.window.corner, film.window.end());
    let step = (film.area() as f64 / 16384.).sqrt().ceil() as usize;
    let rows = (top..bottom).into_par_iter().step_by(step);
    let (columns, lines) = view.resolution;
    let centre = |i, n| within(i, n, 1 << 31);
    let pixels = rows.flat_map_iter(|y| {
        let shown = (left..right).step_by(step).filter(move |&x| {
            let (x, y) = (centre(x, columns), centre(y, lines));
            let start = view.sensor.start(bvh, &view.surfaces, (x, y));
            start.hit.is_some_and(|hit| hit.primitive < GROUND)
        });
        shown.map(move |x| film.pixel(x, y).mean())
    });
    pixels.collect()
}
