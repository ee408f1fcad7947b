// No path asks for memory (chapter "Where the next ray starts"). All is in
// one test, because tests run side by side and would count each other's.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::alloc::{GlobalAlloc, Layout, System};
use std::hint::black_box;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use litpt::bvh::{Bvh, Isa, Quality};
use litpt::film::Film;
use litpt::render::{Job, Renderer};
use litpt::scene::Scene;
use litpt_book::closed_forms::{Setting, cavity, look, plane};
use litpt_book::courtyard;
use rayon::ThreadPoolBuilder;

/// The system's allocator, and how often it was called.
struct Counting;

static CALLS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: all the work is done by the system's allocator. What is not here
// is made of these two.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// How often memory is asked for during a piece of work.
fn calls(work: impl FnOnce()) -> usize {
    let before = CALLS.load(Ordering::Relaxed);
    work();
    CALLS.load(Ordering::Relaxed) - before
}

#[test]
fn the_number_of_paths_does_not_change_how_often_memory_is_asked_for() {
    assert_eq!(calls(|| drop(black_box(Box::new(0)))), 1);
    let bowl = look(DVec3::new(0., 0., 0.5), DVec3::ZERO, 120.);
    let above = look(DVec3::new(0., 0., 9.), DVec3::ZERO, 60.);
    let scenes = [
        (plane(), above),
        (cavity(0.3, 24), bowl),
        (courtyard::mesh(), courtyard::view()),
    ];
    // One thread, so that no queue of tasks grows by chance; and it has
    // started before anything is counted.
    let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.broadcast(|_| ());
    for (mesh, view) in &scenes {
        let setting = Setting::new(mesh, (0.8, view.up), view, 1.).unwrap();
        let scene = Scene::new(mesh);
        for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
            let intersector =
                Bvh::with(&scene, Quality::FAST, isa).unwrap();
            let mut job =
                Job { intersector: &intersector, ..setting.job(1) };
            // Tiles one by one, and a tile whose samples are divided.
            for (side, few, many) in [(80, 2, 20), (3, 32, 320)] {
                let mut pass = |n| {
                    let mut film = Film::new(side, side);
                    let render = || job.pass(&mut film, n, &|_| true);
                    calls(|| assert!(pool.install(render) > 0))
                };
                let (few, many) = (pass(few), pass(many));
                // The queue through which a pass enters the pool takes a
                // new block once in a while.
                let what = (mesh.triangles.len(), isa, side);
                assert!(many.abs_diff(few) <= 1, "{few} {many} {what:?}");
            }
        }
    }
}
