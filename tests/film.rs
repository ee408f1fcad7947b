// The order of pixels, and passes over them (chapters "The image" and "The
// render").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::HashSet;

use glam::DVec3;
use litpt::analysis::background::KnownPixels;
use litpt::bvh::{Bvh, Hit, Intersector, Isa, Quality};
use litpt::camera::{Camera, View};
use litpt::closed_forms::cavity;
use litpt::film::{Film, SIDE, Summary};
use litpt::integrator::PathTracer;
use litpt::render::{Job, Renderer};
use litpt::scene::Scene;
use litpt::sky::Sky;

#[test]
fn each_pixel_belongs_to_one_tile_and_is_found_there() {
    for (width, height) in [(1, 1), (16, 16), (17, 1), (100, 75), (5, 200)]
    {
        let mut film = Film::new(width, height);
        let mut seen = HashSet::new();
        for (tile, pixels) in film.tiles() {
            assert!(tile.size.0 <= SIDE && tile.size.1 <= SIDE);
            for (i, pixel) in (0..).zip(pixels) {
                let x = tile.corner.0 + i % tile.size.0;
                let y = tile.corner.1 + i / tile.size.0;
                assert!(x < width && y < height && seen.insert((x, y)));
                pixel.add(f64::from(y * width + x));
            }
        }
        assert_eq!(seen.len() as u32, width * height);
        for y in 0..height {
            for x in 0..width {
                let found = film.pixel(x, y).mean();
                assert_eq!(found, f64::from(y * width + x));
            }
        }
        let rows: Vec<f64> = film.means().collect();
        assert!(rows.iter().enumerate().all(|(i, &m)| m == i as f64));
    }
}

#[test]
fn the_curve_steps_to_adjacent_tiles() {
    for tiles in [1, 2, 4, 8, 32] {
        let mut film = Film::new(tiles * SIDE, tiles * SIDE);
        let corners: Vec<(u32, u32)> =
            film.tiles().iter().map(|(tile, _)| tile.corner).collect();
        assert_eq!(corners[0], (0, 0));
        let last = corners[corners.len() - 1];
        assert_eq!(last, ((tiles - 1) * SIDE, 0));
        for pair in corners.windows(2) {
            let step = pair[0].0.abs_diff(pair[1].0)
                + pair[0].1.abs_diff(pair[1].1);
            assert_eq!(step, SIDE, "{pair:?}");
        }
    }
}

/// Renders the inside of an open sphere in the given passes.
fn render(
    threads: usize,
    passes: &[u64],
    (quality, isa): (Quality, Isa),
) -> Vec<u64> {
    let scene = Scene::new(&cavity(0.3, 24));
    let intersector = Bvh::with(&scene, quality, isa).unwrap();
    let view = View {
        position: DVec3::ZERO,
        target: DVec3::new(0.5, 0.3, -1.),
        up: DVec3::Z,
        fov: 100.,
    };
    let camera = Camera::new(&view, 1.5).unwrap();
    let integrator = PathTracer { albedo: 0.8, sky: Sky::new(DVec3::Z) };
    let job = Job {
        scene: &scene,
        intersector: &intersector,
        camera: &camera,
        integrator: &integrator,
        known: &KnownPixels::Nothing,
        seed: 9,
    };
    let mut film = Film::new(60, 40);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap().install(|| {
        let mut done = 0;
        for n in passes {
            job.pass(&mut film, done..done + n, &|_| ());
            done += n;
        }
    });
    let Summary { mean, mean_stderr: error, .. } = film.summary();
    let bits = film.means().map(f64::to_bits);
    bits.chain([mean.to_bits(), error.to_bits()]).collect()
}

#[test]
fn the_image_does_not_depend_on_threads_or_passes() {
    let usual = (Quality::Medium, Isa::best());
    let film = render(1, &[8], usual);
    assert_eq!(render(2, &[8], usual), film);
    assert_eq!(render(7, &[8], usual), film);
    assert_eq!(render(3, &[1, 5, 2], usual), film);
    assert_ne!(render(1, &[7], usual), film);
}

#[test]
fn the_image_does_not_depend_on_the_hierarchy() {
    let film = render(2, &[8], (Quality::Medium, Isa::Portable));
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        for quality in [Quality::Fast, Quality::Thorough] {
            assert_eq!(render(2, &[8], (quality, isa)), film, "{isa:?}");
        }
    }
}

#[test]
fn progress_counts_every_path_once() {
    let scene = Scene::new(&cavity(0.3, 24));
    let intersector = Bvh::new(&scene).unwrap();
    let view = View {
        position: DVec3::ZERO,
        target: -DVec3::Z,
        up: DVec3::Y,
        fov: 60.,
    };
    let job = Job {
        scene: &scene,
        intersector: &intersector,
        camera: &Camera::new(&view, 1.).unwrap(),
        integrator: &PathTracer { albedo: 0.5, sky: Sky::new(DVec3::Z) },
        known: &KnownPixels::Nothing,
        seed: 0,
    };
    let paths = std::sync::atomic::AtomicU64::new(0);
    let count = |n| {
        paths.fetch_add(n, std::sync::atomic::Ordering::Relaxed);
    };
    job.pass(&mut Film::new(35, 18), 0..3, &count);
    assert_eq!(paths.into_inner(), 35 * 18 * 3);
}

#[test]
fn a_kernel_can_be_written_by_somebody_else() {
    struct Nothing;
    impl Intersector for Nothing {
        fn first_hit(
            &self,
            _: &litpt::scene::Ray,
            _: Option<u32>,
        ) -> Option<Hit> {
            None
        }
    }
    let scene = Scene::new(&cavity(0.3, 8));
    let view = View {
        position: DVec3::ZERO,
        target: DVec3::Z,
        up: DVec3::Y,
        fov: 60.,
    };
    let job = Job {
        scene: &scene,
        intersector: &Nothing,
        camera: &Camera::new(&view, 1.).unwrap(),
        integrator: &PathTracer { albedo: 0.5, sky: Sky::new(DVec3::Z) },
        known: &KnownPixels::Nothing,
        seed: 0,
    };
    let mut film = Film::new(3, 3);
    let rays = job.pass(&mut film, 0..2, &|_| ());
    let Summary { mean, mean_stderr, .. } = film.summary();
    assert_eq!((rays, mean, mean_stderr), (18, 1., 0.));
    // A path that never touches the scene's box asks for no ray.
    let away =
        View { position: 9. * DVec3::Z, target: 10. * DVec3::Z, ..view };
    let camera = Camera::new(&away, 1.).unwrap();
    let mut film = Film::new(3, 3);
    let rays =
        Job { camera: &camera, ..job }.pass(&mut film, 0..2, &|_| ());
    assert_eq!((rays, film.summary().mean), (0, 1.));
}
