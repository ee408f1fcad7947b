// The order of pixels, and passes over them (chapters "The image" and "The
// render").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use crate::render_loop::{WORLD, watch_of, with_threads};

use std::collections::HashSet;

#[test]
fn each_pixel_belongs_to_one_tile_and_is_found_there() {
    for (width, height) in [(1, 1), (16, 16), (17, 1), (100, 75), (5, 200)]
    {
        let mut film = Film::new(width, height);
        let mut seen = HashSet::new();
        for FilmTile { tile, pixels, .. } in film.tiles() {
            assert!(tile.size.0 <= SIDE && tile.size.1 <= SIDE);
            for (i, pixel) in (0..).zip(pixels) {
                let x = tile.corner.0 + i % tile.size.0;
                let y = tile.corner.1 + i / tile.size.0;
                assert!(x < width && y < height && seen.insert((x, y)));
                pixel.add(f64::from(y * width + x));
            }
        }
        assert_eq!(seen.len() as u32, width * height);
        for (i, mean) in (0..).zip(film.means()) {
            let found = film.pixel(i % width, i / width).mean();
            assert_eq!((found, mean), (i.into(), i.into()));
        }
    }
}

#[test]
fn the_curve_steps_to_adjacent_tiles() {
    for tiles in [1, 2, 4, 8, 32] {
        let mut film = Film::new(tiles * SIDE, tiles * SIDE);
        film.pixels[0].add(1.);
        let corners: Vec<(u32, u32)> =
            film.tiles().iter().map(|part| part.tile.corner).collect();
        assert_eq!(corners[0], (0, 0));
        assert_eq!(corners[corners.len() - 1], ((tiles - 1) * SIDE, 0));
        for pair in corners.windows(2) {
            let step = pair[0].0.abs_diff(pair[1].0)
                + pair[0].1.abs_diff(pair[1].1);
            assert_eq!(step, SIDE, "{pair:?}");
        }
    }
}

// Of 64 by 64 tiles, the first 64 have one in each block of 8 by 8.
#[test]
fn the_first_pass_is_scattered_over_the_image() {
    let mut film = Film::new(64 * SIDE, 64 * SIDE);
    let tiles = film.tiles();
    let block = |tile: &Tile| {
        (tile.corner.0 / (8 * SIDE), tile.corner.1 / (8 * SIDE))
    };
    let blocks = tiles[..64].iter().map(|part| block(&part.tile));
    assert_eq!(blocks.collect::<HashSet<_>>().len(), 64);
}

#[test]
fn a_pixel_without_a_sample_has_no_mean() {
    let window = Window { corner: (17, 3), size: (40, 30) };
    let mut film = Film::cropped((60, 40), window, false);
    let FilmTile { tile, pixels, .. } = film.tiles().swap_remove(2);
    pixels.iter_mut().for_each(|pixel| pixel.add(0.25));
    let (left, top) = tile.corner;
    let own = (left..left + tile.size.0, top..top + tile.size.1);
    for (i, mean) in film.means_of(window).into_iter().enumerate() {
        let (x, y) = (17 + i as u32 % 40, 3 + i as u32 / 40);
        match own.0.contains(&x) && own.1.contains(&y) {
            true => assert_eq!(mean, 0.25),
            false => assert!(mean.is_nan(), "{x},{y}"),
        }
    }
    assert_eq!(film.unsampled(), 1200 - tile.area() as u64);
    assert_eq!(film.summary().mean, 0.25);
    assert!(film.summary().rmse.is_infinite());
}

#[test]
fn progress_counts_every_path_once() {
    let paths = AtomicU64::new(0);
    let count = |n| {
        paths.fetch_add(n, Relaxed);
        true
    };
    WORLD.job(0).pass(&mut Film::new(35, 18), 3, &count);
    assert_eq!(paths.into_inner(), 35 * 18 * 3);
}

#[test]
fn a_path_that_never_touches_the_box_of_the_scene_asks_for_no_ray() {
    let (from, to) = (9. * DVec3::Z, 10. * DVec3::Z);
    let view = View { up: DVec3::Y, ..look(from, to, 60.) };
    let sky = (0.5, DVec3::Z);
    let setting = Setting::new(&cavity(0.3, 8), sky, &view, 1.).unwrap();
    let mut film = Film::new(3, 3);
    let rays = setting.job(0).pass(&mut film, 2, &|_| true);
    let Summary { mean, mean_stderr, .. } = film.summary();
    assert_eq!((rays, mean, mean_stderr), (0, 1., 0.));
}

// ----------------------------------------------------- A part of an image

/// All of 60 by 40 pixels, a part, and the last one.
const WINDOWS: [Window; 3] = [
    Window { corner: (0, 0), size: (60, 40) },
    Window { corner: (17, 3), size: (30, 30) },
    Window { corner: (59, 39), size: (1, 1) },
];

/// Column and row of the last pixel of a tile.
fn last(tile: Tile) -> (u32, u32) {
    let ((x, y), (width, height)) = (tile.corner, tile.size);
    (x + width - 1, y + height - 1)
}

#[test]
fn a_window_has_the_samples_of_the_whole_image() {
    let resolution = (60, 40);
    let mut whole = Film::new(resolution.0, resolution.1);
    WORLD.job(9).pass(&mut whole, 3, &|_| true);
    for window @ Window { corner, size } in WINDOWS {
        let mut part = Film::cropped(resolution, window, false);
        WORLD.job(9).pass(&mut part, 3, &|_| true);
        assert_eq!(part.window.size, size);
        assert_eq!(part.resolution, resolution);
        assert_eq!(part.rows().count(), window.area());
        for (i, pixel) in (0..).zip(part.rows()) {
            let (x, y) = (corner.0 + i % size.0, corner.1 + i / size.0);
            assert_eq!(pixel, whole.pixel(x, y));
            assert_eq!(pixel, part.pixel(x, y));
        }
        // Tiles lie in the cells of the whole image.
        let tiles = part.tiles();
        let area: usize = tiles.iter().map(|part| part.tile.area()).sum();
        assert_eq!(area, window.area());
        for FilmTile { tile, .. } in tiles {
            let cell = |(x, y): (u32, u32)| (x / SIDE, y / SIDE);
            assert_eq!(cell(tile.corner), cell(last(tile)));
        }
    }
}

/// The squares of the errors of tiles add up to the variance of the sum over
/// the image, and each pixel has that of its tile.
#[test]
fn the_errors_of_tiles_are_those_of_the_mean_of_the_image() {
    for window @ Window { corner, size } in WINDOWS {
        let film = Film::cropped((60, 40), window, false);
        assert_eq!(film.tile_errors(window), None);
        let mut film = film.with_shared_tiles();
        let unknown = film.tile_errors(window).unwrap();
        assert!(unknown.iter().all(|error| error.is_infinite()));
        for pixel in &mut film.pixels {
            (0..2).for_each(|_| pixel.add(1.));
        }
        for (k, FilmTile { mean, .. }) in
            film.tiles().into_iter().enumerate()
        {
            // The standard error is k + 1.
            let mean = mean.unwrap();
            mean.add(0.);
            mean.add(2. * (k as f64 + 1.));
        }
        let errors = film.tile_errors(window).unwrap();
        let squares: f64 = errors.iter().map(|e| e * e).sum();
        let sum = film.summary().mean_stderr * film.area() as f64;
        assert!((squares / (sum * sum) - 1.).abs() < 1e-12);
        let tiles: Vec<Tile> =
            film.tiles().iter().map(|t| t.tile).collect();
        for (k, tile) in tiles.into_iter().enumerate() {
            for (x, y) in [tile.corner, last(tile)] {
                let (x, y) = (x - corner.0, y - corner.1);
                let error = errors[(y * size.0 + x) as usize];
                let expected =
                    (tile.area() as f64).sqrt() * (k as f64 + 1.);
                assert!((error / expected - 1.).abs() < 1e-12);
            }
        }
    }
}

// --------------------------------------------------------- Stopped passes

#[test]
fn a_stopped_pass_leaves_tiles_with_their_first_samples() {
    let size = (100, 70);
    let plain = |n| {
        let mut film = Film::new(size.0, size.1);
        WORLD.job(4).pass(&mut film, n, &|_| true);
        film
    };
    let counts = |film: &Film| -> HashSet<u64> {
        film.rows().map(Accumulator::count).collect()
    };
    let mut whole = Film::new(size.0, size.1);
    let all_rays = WORLD.job(4).pass(&mut whole, 7, &|_| true);
    for threads in [1, 2, 7] {
        with_threads(threads, || {
            let (mut film, mut rays) = (Film::new(size.0, size.1), 0);
            for (end, calls) in [(4, 21), (7, 30), (7, 17), (7, 0)] {
                let watch = &watch_of(calls);
                rays += WORLD.job(4).pass(&mut film, end, watch);
                assert!(film.samples() < end);
                // Each pixel is that of a whole film of so many samples.
                for n in counts(&film) {
                    let plain = plain(n);
                    let mut pairs = film.rows().zip(plain.rows());
                    assert!(pairs.all(|(p, q)| p.count() != n || p == q));
                }
                for FilmTile { pixels, .. } in film.tiles() {
                    let n = pixels[0].count();
                    assert!(pixels.iter().all(|p| p.count() == n));
                }
            }
            assert!(counts(&film).len() > 1, "{:?}", counts(&film));
            rays += WORLD.job(4).pass(&mut film, 7, &|_| true);
            assert_eq!(film.pixels, whole.pixels);
            assert_eq!(rays, all_rays);
        });
    }
}

// What decides how soon a pass ends is the number of rays after it is told
// to, whatever the size of the image: less than 1025 turns of four paths for
// each thread, a millisecond or two, even in the midst of a tile whose
// paths do not end.
#[test]
fn few_rays_are_traced_after_a_pass_is_told_to_stop() {
    /// Never lets a path leave; counts all rays, and those before it was told
    /// to stop.
    struct Closed(AtomicU64, AtomicU64);
    impl Intersector for Closed {
        fn first_hit(&self, ray: &Ray, _: Option<u32>) -> Option<Hit> {
            self.0.fetch_add(1, Relaxed);
            let (point, normal) = (ray.origin, DVec3::Z);
            Some(Hit { point, normal, primitive: 0 })
        }
    }
    let closed = &Closed(AtomicU64::new(0), AtomicU64::new(0));
    let Job { sensor, known_pixels, sampler, .. } = WORLD.job(1);
    let integrator = PathTracer::new(Surfaces::of(1.), Sky::new(DVec3::Z));
    let intersector = closed;
    let mut job =
        Job { sensor, intersector, integrator, known_pixels, sampler };
    for (size, end) in [((16, 16), 1000), ((300, 200), 5), ((1, 1), 90_000)]
    {
        for threads in [1, 4] {
            closed.0.store(0, Relaxed);
            closed.1.store(u64::MAX, Relaxed);
            let watch = |_| {
                let rays = closed.0.load(Relaxed);
                let goes_on = rays < 300_000;
                let told = if goes_on { u64::MAX } else { rays };
                closed.1.fetch_min(told, Relaxed);
                goes_on
            };
            let mut film = Film::new(size.0, size.1);
            with_threads(threads, || job.pass(&mut film, end, &watch));
            let [all, then] =
                [&closed.0, &closed.1].map(|count| count.load(Relaxed));
            assert!(then <= all && film.samples() < end);
            assert!(all - then <= 1100 * threads as u64, "{all} {then}");
        }
    }
}

// -------------------------------------------------------------- Replicates

/// The square of the distance of a point from the origin, whose mean over
/// the unit square is 2/3.
struct Distance;

impl Integrator for Distance {
    type Path = ();

    fn begin(&self, _: DVec3, _: f64) {}

    fn advance(
        &self,
        _: &mut (),
        _: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        let [x, y] = sampler.get_2d(dimension::direction(0));
        PathEvent::Terminate(x * x + y * y)
    }
}

/// A film of 64 by 64 pixels after so many samples in nets of 16 points.
fn nets(samples: u64) -> Film {
    let Job { sensor, intersector, known_pixels, .. } = WORLD.job(0);
    let (sampler, integrator) = (SobolSampler::new(11, 16), Distance);
    let mut job =
        Job { sensor, intersector, integrator, known_pixels, sampler };
    let mut film = Film::new(64, 64).with_net_size(16);
    job.pass(&mut film, samples / 3, &|_| true);
    job.pass(&mut film, samples, &|_| true);
    film
}

// Of 4096 pixels with 16 replicates each, the ratio has a standard deviation
// of sqrt(2/4096) = 0.022 from the true errors and less from the stated ones:
// five of them are 0.13 with some room.
#[test]
fn errors_are_honest_if_the_film_knows_what_depends_on_what() {
    let film = nets(256);
    let mean = |of: &dyn Fn(&Accumulator) -> f64| {
        film.rows().map(of).sum::<f64>() / film.area() as f64
    };
    let truth = mean(&|pixel| (pixel.mean() - 2. / 3.).powi(2));
    let stated = mean(&|pixel| pixel.standard_error().powi(2));
    let ratio = truth / stated;
    assert!((ratio - 1.).abs() < 0.13, "{ratio}");
    // That of independent samples, of variance 8/45 each.
    let hidden = stated / (8. / 45. / 256.);
    assert!(hidden < 0.1, "{hidden}");
}
