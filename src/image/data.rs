// Tangled from chapters/image.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! An image in memory.

use std::collections::BTreeMap;
use std::io::{self, Write};

use rayon::prelude::*;

use crate::film::{Film, NEIGHBOUR_WEIGHT, Window};

/// A finished image in memory, with all that its file formats can carry.
/// Row by row from the top left.
#[derive(Clone, Debug, Default, PartialEq)]
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
    /// Other channels, by name; from a file only the picture's.
    pub more: Vec<(&'static str, Vec<f64>)>,
    /// What is known about the run: names and values, such as `seed`
    /// and `7`.
    pub attributes: BTreeMap<String, String>,
}

impl Image {
    /// An image of these means, without anything else.
    pub fn plain(width: u32, height: u32, means: Vec<f64>) -> Self {
        Self { width, height, means, ..Self::default() }
    }

    /// One of its other channels, if present.
    pub fn channel(&self, name: &str) -> Option<&Vec<f64>> {
        let mut channels = self.more.iter();
        channels.find(|(other, _)| *other == name).map(|(_, values)| values)
    }

    /// The independent values of pixel `i`; none if the file does not say.
    pub fn values(&self, i: usize) -> Option<f64> {
        let number = self.attributes.get("replicate");
        let number = number.and_then(|text| text.parse::<u64>().ok());
        let each = number.map_or(1., |samples| samples.max(1) as f64);
        Some(self.samples.as_ref()?[i] / each)
    }

    /// Column and row of its first pixel in the image of which it is a part.
    pub fn corner(&self) -> (u32, u32) {
        let crop = self.attributes.get("crop");
        let window = crop.and_then(|c| Window::try_from(c.clone()).ok());
        window.map_or((0, 0), |window| window.corner)
    }
}

/// The channels of an image of three bands, which has no means.
pub const BANDS: [&str; 3] = ["R", "G", "B"];

/// The channel of the fraction of each pixel that surfaces cover.
pub const OPACITY: &str = "A";

/// The channels of a filtered picture and its error.
pub const FILTERED: [&str; 2] = ["filtered.Y", "filtered_stderr.Y"];

/// A source of parts of an image: of windows that lie within its own.
pub trait Source: Sync {
    /// Its pixels.
    fn window(&self) -> Window;

    /// The contents of a window without attributes: its means, which are not
    /// numbers where there is none, or all.
    fn part(&self, window: Window, all: bool) -> Image;

    /// The attributes of the run.
    fn attributes(&self) -> &BTreeMap<String, String>;
}

/// The image on a film, with the attributes of its run.
pub struct Picture<'a> {
    /// The sums.
    pub film: &'a Film,
    /// The samples in a replicate of each pixel, if they differ.
    pub allocation: Option<&'a [u32]>,
    /// Other channels, by name.
    pub more: Vec<(&'static str, &'a [f64])>,
    /// The attributes of the run; see [`Image::attributes`].
    pub attributes: BTreeMap<String, String>,
}

impl Picture<'_> {
    /// All of it, in memory.
    pub fn image(self) -> Image {
        let image = self.part(self.window(), true);
        Image { attributes: self.attributes, ..image }
    }
}

impl Source for Picture<'_> {
    fn window(&self) -> Window {
        self.film.window
    }

    fn part(&self, window: Window, all: bool) -> Image {
        let (width, height) = window.size;
        let film = all.then_some(self.film);
        let part = |list: &[f64]| window.crop(list, self.window());
        let more = self.more.iter().filter(|_| all);
        Image {
            errors: film.map(|film| film.errors(NEIGHBOUR_WEIGHT, window)),
            samples: film
                .map(|film| film.counts_of(window, self.allocation)),
            tile_errors: film.and_then(|film| film.tile_errors(window)),
            more: more.map(|(name, list)| (*name, part(list))).collect(),
            ..Image::plain(width, height, self.film.means_of(window))
        }
    }

    fn attributes(&self) -> &BTreeMap<String, String> {
        &self.attributes
    }
}

impl Source for Image {
    fn window(&self) -> Window {
        Window { corner: (0, 0), size: (self.width, self.height) }
    }

    fn part(&self, window: Window, all: bool) -> Image {
        let (width, height) = window.size;
        let part = |list: &Vec<f64>| window.crop(list, self.window());
        let more = self.more.iter().filter(|_| all);
        Image {
            errors: self.errors.as_ref().map(part),
            samples: self.samples.as_ref().map(part),
            tile_errors: self.tile_errors.as_ref().map(part),
            more: more.map(|(name, list)| (*name, part(list))).collect(),
            ..Image::plain(width, height, part(&self.means))
        }
    }

    fn attributes(&self) -> &BTreeMap<String, String> {
        &self.attributes
    }
}

/// Writes rows of an image in this order; `encode` makes their bytes from
/// the means, or from `all` their channels.
pub fn write_rows<B: AsRef<[u8]> + Send>(
    image: &dyn Source,
    rows: &[u32],
    all: bool,
    encode: impl Fn(u32, Image) -> B + Sync,
    out: &mut dyn Write,
) -> io::Result<()> {
    rows.chunks(64).try_for_each(|rows| {
        let part = |y| image.part(image.window().rows(y, 1), all);
        let rows = rows.par_iter().map(|&y| encode(y, part(y)));
        let rows: Vec<_> = rows.collect();
        rows.iter().try_for_each(|row| out.write_all(row.as_ref()))
    })
}

/// Whether a file of `bytes` bytes can hold `size` bytes of pixels,
/// compressed, and the memory has room for them.
pub fn room(size: u128, bytes: usize) -> bool {
    size <= 8192 * bytes as u128
        && usize::try_from(size)
            .is_ok_and(|n| Vec::<u8>::new().try_reserve_exact(n).is_ok())
}

/// Receives a line about what a reader has converted or ignored.
pub type Note<'a> = &'a mut dyn FnMut(&str);
