// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! An image in memory.

use std::borrow::Cow;
use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::film::{self, Film, WORTH};

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
    /// Standard error of each mean, infinite where unknown; none if the
    /// file does not say.
    pub errors: Option<Vec<f64>>,
    /// Samples spent on each pixel; none if the file does not say.
    pub samples: Option<Vec<f64>>,
    /// Standard error with which each pixel counts in a sum over whole tiles
    /// ([`Film::tile_errors`]), infinite where unknown; none if the pixels
    /// are independent.
    pub tile_errors: Option<Vec<f64>>,
    /// What is known about the run: names and values, such as `seed`
    /// and `7`.
    pub attributes: BTreeMap<String, String>,
}

impl Image {
    /// The means on a film, and nothing else.
    pub fn of_means(film: &Film) -> Self {
        Self::plain(film.width(), film.height(), film.image())
    }

    /// What a film has gathered, with what is known about its run.
    pub fn new(
        film: &Film,
        mut attributes: BTreeMap<String, String>,
    ) -> Self {
        // State how many samples are one value
        if film.replicate() != 1 {
            let value = film.replicate().to_string();
            attributes.insert(REPLICATE.to_owned(), value);
        }
        Self {
            errors: Some(film.errors(WORTH)),
            samples: Some(list(film, film.counts().map(|n| n as f64))),
            tile_errors: film.tile_errors(),
            attributes,
            ..Self::of_means(film)
        }
    }
}

/// A value for each pixel of a film.
fn list(film: &Film, values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut list = Vec::with_capacity(film.area() as usize);
    list.extend(values);
    list
}

/// The attribute that says how many samples are one value.
const REPLICATE: &str = "replicate";

impl Image {
    /// The number of samples whose mean is one independent value; 1 if the
    /// file does not say.
    fn replicate(&self) -> f64 {
        let number = self.attributes.get(REPLICATE);
        let number = number.and_then(|text| text.parse::<u64>().ok());
        number.map_or(1., |samples| samples.max(1) as f64)
    }

    /// The independent values of pixel `i`; none if the file does not say.
    pub fn values(&self, i: usize) -> Option<f64> {
        let samples = self.samples.as_ref()?;
        Some(samples[i] / self.replicate())
    }

    /// Column and row of its first pixel in the image of which it is a part.
    pub fn corner(&self) -> (u32, u32) {
        let crop = self.attributes.get("crop");
        let numbers = crop.into_iter().flat_map(|crop| crop.split(','));
        let mut numbers = numbers.map_while(|text| text.parse().ok());
        let mut next = || numbers.next().unwrap_or(0);
        (next(), next())
    }
}

/// Has the means of the pixels of an image.
pub trait Means: Sync {
    /// Width and height in pixels.
    fn size(&self) -> (u32, u32);

    /// Writes the means of row `y`, counted from the top; not a number
    /// where there is none.
    fn row(&self, y: u32, means: &mut [f64]);

    /// Whether there is a pixel without a mean.
    fn has_gaps(&self) -> bool;

    /// The whole image.
    fn as_image(&self) -> Cow<'_, Image>;
}

impl Means for film::Means<'_> {
    fn size(&self) -> (u32, u32) {
        (self.film().width(), self.film().height())
    }

    fn row(&self, y: u32, means: &mut [f64]) {
        self.row(y, means);
    }

    fn has_gaps(&self) -> bool {
        self.has_gaps()
    }

    fn as_image(&self) -> Cow<'_, Image> {
        Cow::Owned(Image::of_means(self.film()))
    }
}

impl Means for Image {
    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn row(&self, y: u32, means: &mut [f64]) {
        let start = y as usize * means.len();
        means.copy_from_slice(&self.means[start..start + means.len()]);
    }

    fn has_gaps(&self) -> bool {
        self.means.par_iter().any(|mean| mean.is_nan())
    }

    fn as_image(&self) -> Cow<'_, Image> {
        Cow::Borrowed(self)
    }
}

impl Image {
    /// An image of these means, of which nothing else is known.
    pub fn plain(width: u32, height: u32, means: Vec<f64>) -> Self {
        Self {
            width,
            height,
            means,
            errors: None,
            samples: None,
            tile_errors: None,
            attributes: BTreeMap::new(),
        }
    }
}

/// Whether a file of `bytes` bytes can hold `size` bytes of pixels,
/// compressed, and the memory has room for them.
pub fn room(size: u128, bytes: usize) -> bool {
    size <= 8192 * bytes as u128
        && usize::try_from(size)
            .is_ok_and(|n| Vec::<u8>::new().try_reserve_exact(n).is_ok())
}

/// Who is told, in a line, of what was made of a file.
pub type Note<'a> = &'a mut dyn FnMut(&str);
