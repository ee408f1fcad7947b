// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! An image in memory.

// Name what the data import
use std::collections::BTreeMap;

use crate::film::{Film, WORTH};

// Hold what the files can carry
/// A finished image in memory: what its file formats can carry. Row by
/// row from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Mean radiance of each pixel.
    pub means: Vec<f64>,
    // Keep what other programs do not know
    /// Standard error of each mean, infinite where unknown; none if the
    /// file does not say.
    pub errors: Option<Vec<f64>>,
    /// Samples spent on each pixel; none if the file does not say.
    pub samples: Option<Vec<f64>>,
    /// What is known about the run: names and values, such as `seed`
    /// and `7`.
    pub attributes: BTreeMap<String, String>,
}

// Make an image from a film
impl Image {
    /// What a film has gathered, with what is known about its run.
    pub fn new(film: &Film, attributes: BTreeMap<String, String>) -> Self {
        let list = |values: &mut dyn Iterator<Item = f64>| {
            let mut list = Vec::with_capacity(film.area() as usize);
            list.extend(values);
            list
        };
        let mut counts = film.counts().map(|n| n as f64);
        Self {
            width: film.width(),
            height: film.height(),
            means: list(&mut film.means()),
            errors: Some(film.errors(WORTH)),
            samples: Some(list(&mut counts)),
            attributes,
        }
    }
}

impl Image {
    /// An image of these means, of which nothing else is known.
    pub fn plain(width: u32, height: u32, means: Vec<f64>) -> Self {
        let (errors, samples) = (None, None);
        let attributes = BTreeMap::new();
        Self { width, height, means, errors, samples, attributes }
    }
}

// Judge what a header promises
/// Whether a file of `bytes` bytes can hold `size` bytes of pixels,
/// compressed, and the memory has room for them.
pub fn room(size: u128, bytes: usize) -> bool {
    size <= 8192 * bytes as u128
        && usize::try_from(size)
            .is_ok_and(|n| Vec::<u8>::new().try_reserve_exact(n).is_ok())
}
