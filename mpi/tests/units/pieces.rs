// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Pieces cover a pass, and their sums come together in any order.

use super::*;
use litpt::render::choose::{Method, Sampling};

const RESOLUTION: (u32, u32) = (150, 70);

fn frame(method: Method, replicate: u64, whole: Window) -> Frame {
    let sampling = Sampling::new(method, 0, None, 0);
    let sampling = Sampling { replicate, ..sampling };
    Frame { resolution: RESOLUTION, whole, sampling }
}

const WINDOWS: [Window; 4] = [
    Window { corner: (0, 0), size: RESOLUTION },
    Window { corner: (5, 9), size: (100, 33) },
    Window { corner: (15, 15), size: (2, 2) },
    Window { corner: (3, 64), size: (1, 1) },
];

fn methods() -> [(Method, u64); 3] {
    [(Method::Reference, 1), (Method::Sobol, 8), (Method::Gather, 4)]
}

/// The value of a replicate of a pixel, the same wherever it is rendered.
fn value((x, y): (u32, u32), k: u64) -> f64 {
    f64::from(x) / 7. + f64::from(y) / 11. + k as f64 / 3.
}

/// Takes the tiles of a film to so many samples, up to `most` values in all.
fn fill(film: &mut Film, end: u64, mut most: usize) {
    let replicate = film.replicate();
    let first = film.first() / replicate;
    let end = end.div_ceil(replicate);
    let tiles = match film.tile_means().is_empty() {
        true => {
            film.tiles().into_iter().map(|(t, p)| (t, p, None)).collect()
        }
        false => {
            let tiles = film.shared_tiles().into_iter();
            tiles.map(|(t, p, mean)| (t, p, Some(mean))).collect::<Vec<_>>()
        }
    };
    for (tile, pixels, mut mean) in tiles {
        for k in pixels[0].count()..end {
            if most == 0 {
                break;
            }
            most -= 1;
            for (i, pixel) in (0..).zip(&mut *pixels) {
                let x = tile.corner.0 + i % tile.size.0;
                let y = tile.corner.1 + i / tile.size.0;
                pixel.add(value((x, y), first + k));
            }
            if let Some(mean) = &mut mean {
                mean.add(k as f64);
            }
        }
    }
}

/// A number below `n`, and the next state.
fn random(state: &mut u64, n: usize) -> usize {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(99991);
    (*state >> 33) as usize % n
}

#[test]
fn pieces_in_any_order_make_the_film_of_one_pass() {
    let mut state = 1;
    for (case, window) in (0..160).zip(WINDOWS.into_iter().cycle()) {
        let (method, replicate) = methods()[case % 3];
        let frame = frame(method, replicate, window);
        let whole = Piece { window, first: 0, samples: 0 };
        // Some tiles have samples already, as after an interrupt.
        let mut film = whole.film(&frame);
        fill(&mut film, 20, case % 7 * 10);
        let mut expected = film.clone();
        let end = 1 + random(&mut state, 90) as u64;
        fill(&mut expected, end, usize::MAX);
        let ranks = 1 + random(&mut state, 9) as u64;
        let mut schedule = Schedule::new(&film, end, ranks);
        let (most, mut pieces) = (schedule.left / (4 * ranks), vec![]);
        while let Some(piece) = schedule.take() {
            let is_least = piece.halves(replicate).is_none();
            let most = most.max(schedule.least);
            assert!(is_least || piece.paths() <= most, "{piece:?}");
            assert_eq!(Piece::from_words(piece.to_words()), piece);
            pieces.push(piece);
        }
        assert_eq!(schedule.left, 0);
        let mut collector = Collector {
            film: &mut film,
            waiting: vec![],
            spent: vec![Default::default(); 1],
        };
        let mut paths = 0;
        while !pieces.is_empty() {
            let k = random(&mut state, pieces.len());
            let piece = pieces.swap_remove(k);
            let mut part = piece.film(&frame);
            fill(&mut part, piece.samples, usize::MAX);
            let spent = Spent::default();
            let part = Part { piece, film: part, spent };
            let part = Part::from_bytes(&part.to_bytes(), &frame);
            assert_eq!(collector.add(0, part), piece.paths());
            paths += piece.paths();
        }
        assert!(collector.waiting.is_empty());
        assert_eq!(collector.spent[0].0, paths);
        assert_eq!(film.stored(), expected.stored(), "case {case}");
        let counts = film.tile_means().iter().map(Accumulator::count);
        let others = expected.tile_means().iter().map(Accumulator::count);
        assert!(counts.eq(others));
    }
}

/// What a stopped pass leaves has no gap: each tile has the first of its
/// samples, as a run that goes on expects.
#[test]
fn a_stopped_pass_leaves_the_first_samples_of_each_tile() {
    let mut state = 2;
    for (case, window) in (0..160).zip(WINDOWS.into_iter().cycle()) {
        let (method, replicate) = methods()[case % 3];
        let frame = frame(method, replicate, window);
        let mut film = Piece { window, first: 0, samples: 0 }.film(&frame);
        let mut schedule = Schedule::new(&film, 100, 3);
        let mut pieces: Vec<_> =
            iter::from_fn(|| schedule.take()).collect();
        let mut collector = Collector {
            film: &mut film,
            waiting: vec![],
            spent: vec![Default::default(); 1],
        };
        // Each piece is finished, or begun, or not begun.
        while !pieces.is_empty() {
            let k = random(&mut state, pieces.len());
            let piece = pieces.swap_remove(k);
            let mut part = piece.film(&frame);
            let most = [usize::MAX, 3, 0][random(&mut state, 3)];
            fill(&mut part, piece.samples, most);
            let spent = Spent::default();
            collector.add(0, Part { piece, film: part, spent });
        }
        for (tile, pixels) in film.tiles() {
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
