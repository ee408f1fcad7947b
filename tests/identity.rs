// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The identity of a sample changes whenever a sample does.

mod common;

use common::{BOX, Scratch};
use litpt::integrator::identity;
use sha2::{Digest, Sha256};

/// The identity, and the hash of the images below that belongs to it.
const KNOWN: (&str, &str) = (
    "samples 4, path tracer with roulette below 0.1 and from 1000 bounces",
    "78a4e05c50384933a5bbc42490aee90cac9f4f6bb7d6e992a221849f61801586",
);

#[test]
fn the_bits_of_samples_change_with_their_version_only() {
    let place = Scratch::new();
    place.put("box.obj", BOX);
    let mut hash = Sha256::new();
    // The path tracer, with all and with nothing left out, faint paths,
    // the sky alone, and paths that are ended after many bounces.
    for options in [
        &["-iroom.obj", "-r0.7", "-n9"][..],
        &["-iroom.obj", "-r0.7", "-n9", "--keep-all"],
        &["-iroom.obj", "-r0.2", "-n9", "-s7", "--keep-all"],
        &["-iroom.obj", "-r0", "-n9"],
        &["-isquare.obj", "-p0,0,2", "-n9"],
        &["-ibox.obj", "-n2", "--keep-all"],
    ] {
        let run = place
            .run(&[&["-q", "-d7x5", "--format=pfm"], options].concat());
        run.succeeded();
        hash.update(&run.stdout);
    }
    let hash: String =
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(
        (identity().as_str(), hash.as_str()),
        KNOWN,
        "if a sample is another now, raise SAMPLE_VERSION, and record both"
    );
}
