// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Pieces cover a pass, and their sums come together in any order.

use std::iter;

use super::*;
use litpt::film::{FilmTile, HalfBuffers, add_samples};
use serde_json::{from_value, json};
use std::slice::from_mut;

const WINDOWS: [&str; 4] =
    ["0,0,150x70", "5,9,100x33", "15,15,2x2", "3,64,1x1"];

fn run_key(case: usize) -> RunKey {
    let (method, replicate) =
        [("reference", 1), ("sobol", 4), ("gather", 4)][case % 3];
    let key = json!({
        "version": "", "integrator": "", "scene_sha256": "",
        "resolution": [150, 70], "crop": WINDOWS[case % 4],
        "position": [0., 0., 0.], "target": [0., 1., 0.],
        "up": [0., 0., 1.], "fov": 70., "albedo": 1., "seed": 0,
        "sky": {"zenith": [0., 0., 1.], "cover": "uniform"},
        "method": method, "replicate": replicate, "training": 0,
        "sky_control": 0, "filtered": case % 3 == 2,
    });
    from_value(key).unwrap()
}

/// The same empty film, each of whose pixels shows one surface.
fn with_surfaces(mut film: Film) -> Film {
    let area = |part: FilmTile| part.pixels.len();
    let areas: Vec<_> = film.tiles().into_iter().map(area).collect();
    for (halves, area) in film.halves.iter_mut().zip(areas) {
        halves.resize(area, HalfBuffers::default());
    }
    film
}

/// Takes some tiles of a film to so many samples: replicates that are the
/// same wherever they are rendered.
fn fill(film: &mut Film, end: u64, tiles: usize) {
    let (first, replicate) = (film.sample_offset, film.net_size);
    for part in film.tiles().into_iter().take(tiles) {
        let FilmTile { tile, pixels, halves, .. } = part;
        for k in pixels[0].count()..end.div_ceil(replicate) {
            let k = (first / replicate + k) as f64;
            for (i, pixel) in (0..).zip(&mut *pixels) {
                let x = tile.corner.0 + i % tile.size.0;
                let y = tile.corner.1 + i / tile.size.0;
                let value = f64::from(x) / 7. + f64::from(y) / 11. + k / 3.;
                pixel.add(value);
                if let Some(halves) = halves.get_mut(i as usize) {
                    let samples = [([value, 1.], 1)];
                    add_samples(from_mut(halves), k as u64, &samples);
                }
            }
        }
    }
}

/// A number below `n`, and the next state.
fn random(state: &mut u64, n: usize) -> usize {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(99991);
    (*state >> 33) as usize % n
}

/// Some tiles have samples already, as after an interrupt; the pieces come
/// back in any order.
#[test]
fn pieces_in_any_order_make_the_film_of_one_pass() {
    let state = &mut 1;
    for case in 0..320 {
        let run_key = run_key(case);
        let mut film = with_surfaces(run_key.film());
        fill(&mut film, 20, case % 7);
        let mut expected = film.clone();
        let end = 1 + random(state, 90) as u64;
        fill(&mut expected, end, usize::MAX);
        let mut shares = vec![RankStats::default(); 1 + random(state, 9)];
        let mut pass = Pass::new(&mut film, end, &mut shares);
        let most = pass.most();
        let mut pieces: Vec<_> = iter::from_fn(|| pass.take()).collect();
        for Piece { window, .. } in &pieces {
            assert!(
                window.area() <= most || halves(*window, SIDE).is_none()
            );
        }
        assert_eq!(pass.left, 0);
        while !pieces.is_empty() {
            let k = random(state, pieces.len());
            let Piece { window, first, samples } = pieces.swap_remove(k);
            let film = run_key.film_of(window, first);
            let mut film = with_surfaces(film);
            fill(&mut film, samples, usize::MAX);
            let part = Part { film, rays: 7, share: RankStats::default() };
            let part = Part::from_bytes(&part.to_bytes(), &run_key);
            pass.add(0, part.unwrap());
        }
        assert!(film.pixels == expected.pixels, "case {case}");
        assert!(film.halves == expected.halves, "case {case}");
    }
}
