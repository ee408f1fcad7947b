// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! All tests of the renderer in one program, which is linked once:
//! `cargo test --test all film::` runs those of `tests/film.rs`.

mod analysis;
mod answers_light;
mod answers_scene;
mod answers_teacher;
mod bad_input;
mod bvh;
mod chance;
mod checkpoint;
mod choice;
mod common;
mod compare;
mod defaults;
mod encodings;
mod exact;
mod examples;
mod extremes;
mod film;
mod formats;
mod gather;
mod glass;
mod identity;
mod layers;
mod leaks;
mod materials;
mod messages;
mod mixtures;
mod numerics;
mod options;
mod outputs;
mod picture;
mod polygons;
mod prelude;
mod ptimg;
mod random;
mod render_loop;
mod report;
mod runs;
mod sampler;
mod scene;
mod schema;
mod sensor;
mod shards;
mod sky;
mod sobol;
mod statistics;
mod stiff;
mod tally;
mod tiny;
mod trace;
mod traversal;
mod view;

/// A file that is no module of its program would not be run.
#[test]
fn each_file_of_tests_is_run() {
    for package in ["", "noweb/", "book/"] {
        let root = env!("CARGO_MANIFEST_DIR");
        let root = format!("{root}/{package}tests");
        let all =
            std::fs::read_to_string(format!("{root}/all.rs")).unwrap();
        for entry in std::fs::read_dir(root).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            let Some(name) = name.strip_suffix(".rs") else { continue };
            let is_known = all.contains(&format!("\nmod {name};\n"));
            let is_root = ["all", "allocation"].contains(&name);
            assert!(is_known || is_root, "{name}");
        }
    }
}
