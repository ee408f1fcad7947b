// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The identity of a sample changes whenever a sample does.

use crate::prelude::*;

use sha2::{Digest, Sha256};

/// The identities, and the hash of the images below that belongs to each.
const KNOWN: [(&str, &str); 3] = [
    (
        "samples 5, path tracer with roulette below 0.1 and from 1000 bounces",
        "78a4e05c50384933a5bbc42490aee90cac9f4f6bb7d6e992a221849f61801586",
    ),
    (
        "samples 5, path tracer with roulette below 0.1 and from 1000 bounces",
        "caa054c3c6496ac6a92e826ef9a82c7387603e149a9f6309f4d385430da961ad",
    ),
    (
        "gather 7",
        "336ca4ee744e1da94201d47e592a6f1cb1df709b0839152031ac32d74d675bc0",
    ),
];

#[test]
fn the_bits_of_samples_change_with_their_version_only() {
    let place = Scratch::with("box.obj", BOX);
    for (method, known) in Method::ALL.into_iter().zip(KNOWN) {
        let mut hash = Sha256::new();
        // With all and with nothing left out, faint paths, the sky alone,
        // and paths that are ended after many bounces.
        for options in [
            "-iroom.obj -r0.7 -n9",
            "-iroom.obj -r0.7 -n9 --keep-all",
            "-iroom.obj -r0.2 -n9 -s7 --keep-all",
            "-iroom.obj -r0 -n9",
            "-isquare.obj -p0,0,2 -n9",
            "-ibox.obj -n2 --keep-all",
        ] {
            let all = "-q -d7x5 --format=pfm --integrator";
            let run = place.done(&format!("{all}={method} {options}"));
            hash.update(&run.stdout);
        }
        let hash = hash.finalize();
        let hash: String =
            hash.iter().map(|b| format!("{b:02x}")).collect();
        let pixels = Pixels::of_image((7, 5));
        let identity = Sampling::new(method, 0, Some(9), pixels).identity();
        // If a sample is another now, raise its version, and record both.
        assert_eq!((&*identity, &*hash), known);
    }
}
