// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Pieces cover a pass, and their sums come together in any order.

use std::iter;

use super::*;
use glam::DVec3;
use litpt::camera::View;
use litpt::film::{FilmTile, add_value};
use litpt::render::choose::{Method, Sampling};
use litpt::state::key::Subject;

const RESOLUTION: (u32, u32) = (150, 70);

const WINDOWS: [Window; 4] = [
    Window { corner: (0, 0), size: RESOLUTION },
    Window { corner: (5, 9), size: (100, 33) },
    Window { corner: (15, 15), size: (2, 2) },
    Window { corner: (3, 64), size: (1, 1) },
];

fn run_key(case: usize) -> RunKey {
    let methods = [Method::Reference, Method::Sobol, Method::Gather];
    let (position, target, up) = (DVec3::ZERO, DVec3::Y, DVec3::Z);
    RunKey {
        version: String::new(),
        integrator: String::new(),
        scene_sha256: String::new(),
        subject: Subject {
            resolution: RESOLUTION,
            crop: Some(WINDOWS[case % 4]),
            view: View { position, target, up, fov: 70. },
            albedo: 1.,
        },
        sampling: Sampling::new(methods[case % 3], 0, None, 0),
        part: None,
        filtered: case % 3 == 2,
    }
}

/// Takes some tiles of a film to so many samples: replicates that are the
/// same wherever they are rendered.
fn fill(film: &mut Film, end: u64, tiles: usize) {
    let (first, replicate) = (film.first, film.replicate);
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
                    add_value(halves, k as u64, [value, 1.]);
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
        let mut film = run_key.film();
        fill(&mut film, 20, case % 7);
        let mut expected = film.clone();
        let end = 1 + random(state, 90) as u64;
        fill(&mut expected, end, usize::MAX);
        let mut shares = vec![Share::default(); 1 + random(state, 9)];
        let mut pass = Pass::new(&mut film, end, &mut shares);
        let most = pass.most();
        let mut pieces: Vec<_> = iter::from_fn(|| pass.take()).collect();
        for Piece { window, .. } in &pieces {
            assert!(window.area() <= most || halves(*window).is_none());
        }
        assert_eq!(pass.left, 0);
        while !pieces.is_empty() {
            let k = random(state, pieces.len());
            let Piece { window, first, samples } = pieces.swap_remove(k);
            let mut film = run_key.film_of(window, first);
            fill(&mut film, samples, usize::MAX);
            let part = Part { film, rays: 7, share: Share::default() };
            let part = Part::from_bytes(&part.to_bytes(), &run_key);
            pass.add(0, part.unwrap());
        }
        assert!(film.pixels == expected.pixels, "case {case}");
        assert!(film.halves == expected.halves, "case {case}");
    }
}
