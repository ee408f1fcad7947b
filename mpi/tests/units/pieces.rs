// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Pieces cover a pass, and their sums come together in any order.

use super::*;
use glam::DVec3;
use litpt::camera::View;
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
    let (method, replicate) =
        [(Method::Reference, 1), (Method::Sobol, 8), (Method::Gather, 4)]
            [case % 3];
    let sampling = Sampling::new(method, 0, None, 0);
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
        sampling: Sampling { replicate, ..sampling },
        part: None,
    }
}

/// The value of a replicate of a pixel, the same wherever it is rendered.
fn value((x, y): (u32, u32), k: u64) -> f64 {
    f64::from(x) / 7. + f64::from(y) / 11. + k as f64 / 3.
}

/// Takes the tiles of a film to so many samples, up to `most` values in all.
fn fill(film: &mut Film, end: u64, mut most: usize) {
    let (first, replicate) = (film.first, film.replicate);
    for (tile, pixels, _) in film.tiles() {
        for k in pixels[0].count()..end.div_ceil(replicate) {
            if most == 0 {
                break;
            }
            most -= 1;
            for (i, pixel) in (0..).zip(&mut *pixels) {
                let x = tile.corner.0 + i % tile.size.0;
                let y = tile.corner.1 + i / tile.size.0;
                pixel.add(value((x, y), first / replicate + k));
            }
        }
    }
}

/// A number below `n`, and the next state.
fn random(state: &mut u64, n: usize) -> usize {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(99991);
    (*state >> 33) as usize % n
}

/// Some tiles have samples already, as after an interrupt; the pieces are
/// finished, begun or not begun, and come back in any order. What they leave
/// has no gap: each tile has the first of its samples, all of them if no
/// piece was stopped.
#[test]
fn pieces_in_any_order_make_the_film_of_one_pass() {
    let state = &mut 1;
    for case in 0..320 {
        let (run_key, stopped) = (run_key(case), case >= 160);
        let mut film = run_key.film();
        let replicate = film.replicate;
        fill(&mut film, 20, case % 7 * 10);
        let mut expected = film.clone();
        let end = 1 + random(state, 90) as u64;
        fill(&mut expected, end, usize::MAX);
        let ranks = 1 + random(state, 9) as u64;
        let mut schedule = Schedule::new(&film, end, ranks);
        let most = (schedule.left / (4 * ranks)).max(schedule.least);
        let mut pieces: Vec<_> =
            iter::from_fn(|| schedule.take()).collect();
        let is_least = |piece: &Piece| piece.halves(replicate).is_none();
        assert!(pieces.iter().all(|p| is_least(p) || p.paths() <= most));
        assert_eq!(schedule.left, 0);
        let paths: u64 = pieces.iter().map(Piece::paths).sum();
        let mut shares = [Share::default()];
        let mut collector = Collector::new(&mut film, &mut shares);
        while !pieces.is_empty() {
            let k = random(state, pieces.len());
            let piece = pieces.swap_remove(k);
            let mut film = piece.film(&run_key);
            let most = [usize::MAX, 3, 0][random(state, 3)];
            let most = if stopped { most } else { usize::MAX };
            fill(&mut film, piece.samples, most);
            let share = Share { paths: piece.paths(), ..Share::default() };
            let part = Part { piece, film, rays: 7, share };
            let part = Part::from_bytes(&part.to_bytes(), &run_key);
            collector.add(0, part.unwrap());
        }
        assert!(stopped || collector.waiting.is_empty());
        assert_eq!(shares[0].paths, paths);
        assert!(stopped || film.pixels == expected.pixels);
        for (tile, pixels, _) in film.tiles() {
            let mut expected = Accumulator::default();
            for k in 0..pixels[0].count() {
                expected.add(value(tile.corner, k));
            }
            assert_eq!(pixels[0], expected, "case {case}");
        }
    }
}

/// The answer to the exercise on pieces.
#[test]
fn the_first_piece_of_four_ranks_has_forty_tiles() {
    let film = Film::new(640, 480);
    let mut schedule = Schedule::new(&film, 1, 4);
    let first = schedule.take().unwrap();
    assert_eq!(first.window.size, (80, 128));
    assert_eq!((first.paths(), schedule.least), (10240, 1200));
}
