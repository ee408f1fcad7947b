// Tangled from chapters/image.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! An image in memory.

use std::collections::BTreeMap;

use crate::film::{Film, Pixels, WORTH, Window};
use crate::statistics::Accumulator;

/// A finished image in memory: what its file formats can carry. Row by
/// row from the top left.
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
    /// What is known about the run: names and values, such as `seed`
    /// and `7`.
    pub attributes: BTreeMap<String, String>,
}

impl Image {
    /// What a film has gathered, with what is known about its run.
    pub fn new(film: &Film, attributes: BTreeMap<String, String>) -> Self {
        Picture::new(film, attributes).image()
    }

    /// An image of these means, of which nothing else is known.
    pub fn plain(width: u32, height: u32, means: Vec<f64>) -> Self {
        Self { width, height, means, ..Self::default() }
    }

    /// The independent values of pixel `i`; none if the file does not say.
    pub fn values(&self, i: usize) -> Option<f64> {
        let number = self.attributes.get(REPLICATE);
        let number = number.and_then(|text| text.parse::<u64>().ok());
        let each = number.map_or(1., |samples| samples.max(1) as f64);
        Some(self.samples.as_ref()?[i] / each)
    }

    /// Column and row of its first pixel in the image of which it is a part.
    pub fn corner(&self) -> (u32, u32) {
        let crop = self.attributes.get("crop");
        let window = crop.and_then(|crop| crop.parse::<Window>().ok());
        window.map_or((0, 0), |window| window.corner)
    }
}

/// Gives an image by parts. Pixels are counted from its top left.
pub trait Source: Sync {
    /// Width and height in pixels.
    fn size(&self) -> (u32, u32);

    /// Writes the means of row `y`; not a number where there is none.
    fn row(&self, y: u32, means: &mut [f64]);

    /// What a window holds, without attributes.
    fn part(&self, window: Window) -> Image;

    /// Whether all pixels of a window surely have a sample, and whether
    /// none has.
    fn sampled(&self, _: Window) -> [bool; 2] {
        [false; 2]
    }

    /// What is known about the run.
    fn attributes(&self) -> &BTreeMap<String, String>;

    /// All of it.
    fn window(&self) -> Window {
        Window { corner: (0, 0), size: self.size() }
    }
}

/// The image on a film, with what is known about its run.
pub struct Picture<'a> {
    pixels: Pixels<'a>,
    attributes: BTreeMap<String, String>,
}

impl<'a> Picture<'a> {
    /// That of a film and these attributes.
    pub fn new(
        film: &'a Film,
        mut attributes: BTreeMap<String, String>,
    ) -> Self {
        if film.replicate() != 1 {
            let value = film.replicate().to_string();
            attributes.insert(REPLICATE.to_owned(), value);
        }
        Self { pixels: Pixels::of(film), attributes }
    }

    /// All of it, in memory.
    pub fn image(self) -> Image {
        let image = self.part(self.window());
        Image { attributes: self.attributes, ..image }
    }

    /// A window of the picture as one of the film.
    fn on_film(&self, Window { corner, size }: Window) -> Window {
        let (x, y) = self.pixels.film.window().corner;
        Window { corner: (x + corner.0, y + corner.1), size }
    }
}

/// The attribute that says how many samples are one value.
const REPLICATE: &str = "replicate";

impl Source for Picture<'_> {
    fn size(&self) -> (u32, u32) {
        self.pixels.film.window().size
    }

    fn row(&self, y: u32, means: &mut [f64]) {
        let row = Window { corner: (0, y), size: (self.size().0, 1) };
        let mean = |_, pixel: &Accumulator| pixel.mean();
        self.pixels.fill(self.on_film(row), f64::NAN, mean, means);
    }

    fn part(&self, window: Window) -> Image {
        let (pixels, on_film) = (&self.pixels, self.on_film(window));
        let each = pixels.film.replicate();
        let mean = |_, pixel: &Accumulator| pixel.mean();
        let count = |_, p: &Accumulator| (p.count() * each) as f64;
        let means = pixels.values(on_film, f64::NAN, mean);
        Image {
            errors: Some(pixels.errors(WORTH, on_film)),
            samples: Some(pixels.values(on_film, 0., count)),
            tile_errors: pixels.tile_errors(on_film),
            ..Image::plain(window.size.0, window.size.1, means)
        }
    }

    fn sampled(&self, window: Window) -> [bool; 2] {
        self.pixels.sampled(self.on_film(window))
    }

    fn attributes(&self) -> &BTreeMap<String, String> {
        &self.attributes
    }
}

impl Source for Image {
    fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn row(&self, y: u32, means: &mut [f64]) {
        let start = y as usize * means.len();
        means.copy_from_slice(&self.means[start..start + means.len()]);
    }

    fn part(&self, window: Window) -> Image {
        let Window { corner: (x, y), size: (width, height) } = window;
        let part = |list: &Vec<f64>| {
            let rows = list.chunks(self.width as usize);
            let rows = rows.skip(y as usize).take(height as usize);
            let columns = x as usize..(x + width) as usize;
            rows.flat_map(|row| &row[columns.clone()]).copied().collect()
        };
        Image {
            errors: self.errors.as_ref().map(part),
            samples: self.samples.as_ref().map(part),
            tile_errors: self.tile_errors.as_ref().map(part),
            ..Image::plain(width, height, part(&self.means))
        }
    }

    fn attributes(&self) -> &BTreeMap<String, String> {
        &self.attributes
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
