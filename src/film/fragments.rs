// Tangled from chapters/filter.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! What the pixels of an image show: fragments of surfaces, and of the sky.

use std::ops::Range;

use glam::{DVec3, Vec3A};

use super::tile::{Tile, Window};
use crate::bvh::Hit;

/// A surface that a pixel shows.
#[derive(Clone, Copy, Debug)]
pub struct Fragment {
    /// A point of the surface, relative to a point near the camera.
    pub point: Vec3A,
    /// Its unit normal there.
    pub normal: Vec3A,
    /// The part of the pixel that it covers.
    pub coverage: f32,
}

impl Fragment {
    /// The surface at a hit.
    pub fn new(origin: DVec3, hit: &Hit) -> Self {
        let point = (hit.point - origin).as_vec3a();
        Self { point, normal: hit.normal.as_vec3a(), coverage: 0. }
    }

    /// Whether the cosine between the normals is larger than `cosine`, and
    /// the square of the sine between the surface and the way to the other
    /// point at most `square`.
    #[inline]
    fn is_near(&self, other: &Self, cosine: f32, square: f32) -> bool {
        let to = other.point - self.point;
        let height = self.normal.dot(to);
        self.normal.dot(other.normal) > cosine
            && height * height <= square * to.length_squared()
    }

    /// Whether another fragment seems to continue this surface.
    #[inline]
    pub fn is_like(&self, other: &Self) -> bool {
        self.is_near(other, 0.95, 0.09)
    }

    /// Whether another fragment may continue this surface around a bend.
    #[inline]
    pub fn continues(&self, other: &Self) -> bool {
        self.is_near(other, 0.8, 0.25)
    }
}

/// The number of the fragment that `seen` continues best, if there is any:
/// the one nearest in angle among those that are like it, or else among
/// all.
pub(crate) fn best_of(all: &[Fragment], seen: &Fragment) -> Option<usize> {
    let score = |it: &Fragment| {
        let to = seen.point - it.point;
        let length = to.length().max(f32::MIN_POSITIVE);
        let sine = it.normal.dot(to).abs() / length;
        let angles = it.normal.dot(seen.normal) - 3. * sine;
        angles + if it.is_like(seen) { 10. } else { 0. }
    };
    let scores = all.iter().map(score).enumerate();
    scores.max_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(k, _)| k)
}

/// What the pixels of a window show, row by row.
#[derive(Debug)]
pub struct Fragments {
    window: Window,
    origin: DVec3,
    /// The number of fragments before each pixel, and last of all pixels.
    starts: Vec<u32>,
    /// The fragments.
    pub all: Vec<Fragment>,
    /// What the sky adds to the radiance of each pixel.
    pub sky: Vec<f32>,
    /// What its surfaces add that reflect the light of the sun; the sums of
    /// halves are without it.
    pub sun: Vec<f32>,
}

impl Fragments {
    /// Lists the fragments of pixels, given row by row, with what sky and sun
    /// add to each. Points are counted from `origin`.
    pub fn new(
        window: Window,
        origin: DVec3,
        pixels: impl IntoIterator<Item = (Vec<Fragment>, [f32; 2])>,
    ) -> Self {
        let (mut starts, mut all) = (vec![0], vec![]);
        let (mut sky, mut sun) = (vec![], vec![]);
        for (fragments, [above, direct]) in pixels {
            all.extend(fragments);
            starts.push(all.len() as u32);
            sky.push(above);
            sun.push(direct);
        }
        Self { window, origin, starts, all, sky, sun }
    }
}

impl Fragments {
    /// The numbers of the fragments of a pixel, given its own in the window.
    #[inline]
    pub fn range(&self, p: usize) -> Range<usize> {
        self.starts[p] as usize..self.starts[p + 1] as usize
    }

    /// The fragments of a pixel.
    #[inline]
    pub fn of(&self, p: usize) -> &[Fragment] {
        &self.all[self.range(p)]
    }

    /// The part of each pixel that surfaces cover.
    pub fn opacity(&self) -> Vec<f64> {
        let covered = |p| {
            let all = self.of(p).iter();
            all.map(|it| f64::from(it.coverage)).sum()
        };
        (0..self.sky.len()).map(covered).collect()
    }
}

impl Fragments {
    /// The numbers in the window of the pixels of a tile, row by row.
    pub fn pixels(&self, tile: &Tile) -> impl Iterator<Item = usize> {
        let ((x, y), (left, top)) = (tile.corner, self.window.corner);
        let (width, height) = tile.size;
        let rows = (y - top..y - top + height).map(|y| y as usize);
        let columns = move || x - left..x - left + width;
        let all = self.window.size.0 as usize;
        rows.flat_map(move |y| columns().map(move |x| y * all + x as usize))
    }

    /// The number of fragments of a tile.
    pub fn count(&self, tile: &Tile) -> usize {
        self.pixels(tile).map(|p| self.range(p).len()).sum()
    }

    /// The fragments of a tile, to which samples are assigned.
    pub fn in_tile(&self, tile: &Tile) -> TileFragments<'_> {
        let mut count = 0;
        let pixels = self.pixels(tile).map(|p| {
            let before = count;
            count += self.range(p).len() as u32;
            (before, self.of(p))
        });
        let pixels = pixels.collect();
        TileFragments { origin: self.origin, pixels, count: count as usize }
    }
}

/// The fragments of a tile.
pub struct TileFragments<'a> {
    origin: DVec3,
    /// The fragments of each pixel, and how many there are before them.
    pixels: Vec<(u32, &'a [Fragment])>,
    /// The number of fragments.
    pub count: usize,
}

impl TileFragments<'_> {
    /// The number of the fragment for which a sample of a pixel with this
    /// first hit counts, if there is one.
    #[inline]
    pub fn place(&self, pixel: u32, hit: &Hit) -> Option<u32> {
        let (before, own) = self.pixels[pixel as usize];
        match own {
            [] => None,
            [_] => Some(before),
            all => {
                let seen = &Fragment::new(self.origin, hit);
                Some(before + best_of(all, seen)? as u32)
            }
        }
    }
}
