// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Pixels whose radiance follows without a path.

// Name what the bare pixels import
use glam::DVec3;
use rayon::prelude::*;

use super::boxes::{Bounds, Boxes, Search};
use crate::camera::Camera;
use crate::film::{SIDE, Tile};
use crate::numerics::cross;
use crate::scene::Triangle;
use crate::sky::Sky;

// Hold what is known of pixels
/// Pixels whose radiance is known before the render.
#[derive(Default)]
pub enum KnownPixels {
    /// None.
    #[default]
    Nothing,
    /// All are black.
    Dark,
    /// In some tiles there is nothing but the sky.
    Bare(BackgroundTiles),
}

/// The tiles of an image that see no triangle.
pub struct BackgroundTiles {
    camera: Camera,
    sky: Sky,
    resolution: (u32, u32),
    /// By row and column of the tiles.
    bare: Vec<bool>,
}

impl KnownPixels {
    /// Whether the pixels of a tile are known.
    pub fn holds(&self, tile: &Tile) -> bool {
        match self {
            Self::Nothing => false,
            Self::Dark => true,
            Self::Bare(tiles) => tiles.bare[tiles.place(tile.corner)],
        }
    }

    // Tell whether all pixels are known
    /// Whether all pixels are known.
    pub fn is_all(&self) -> bool {
        match self {
            Self::Nothing => false,
            Self::Dark => true,
            Self::Bare(tiles) => tiles.bare.iter().all(|&bare| bare),
        }
    }

    // Give the radiance of a known pixel
    /// The radiance of a pixel of a tile that `holds`.
    pub fn radiance(&self, x: u32, y: u32) -> f64 {
        match self {
            Self::Nothing | Self::Dark => 0.,
            Self::Bare(tiles) => tiles.coverage(x, y),
        }
    }
}

// Find the tiles that see nothing
/// What lies on the far side of no plane.
struct Pyramid<'a> {
    triangles: &'a [Triangle],
    tip: DVec3,
    /// Unit vectors into the pyramid, of the planes around it; zero for a
    /// plane that says nothing.
    inwards: [DVec3; 5],
    /// How far outside counts as outside.
    margin: f64,
    /// Whether a triangle may be inside.
    found: bool,
}

impl Pyramid<'_> {
    /// Whether a plane separates the pyramid from all of some points,
    /// given how far they reach along a vector.
    fn misses(&self, reach: impl Fn(DVec3) -> f64) -> bool {
        let tip = self.tip;
        let beyond = |&n: &DVec3| reach(n) - n.dot(tip) < -self.margin;
        self.inwards.iter().any(beyond)
    }
}

impl Search for Pyramid<'_> {
    fn promise(&self, bounds: &Bounds) -> Option<f64> {
        let (low, high) = bounds.doubles();
        let reach = |n: DVec3| (n * low).max(n * high).element_sum();
        (!self.misses(reach)).then_some(0.)
    }

    // Look for a triangle inside the pyramid
    fn look(&mut self, numbers: &[u32]) -> bool {
        self.found = numbers.iter().any(|&i| {
            let corners = self.triangles[i as usize];
            let reach = |n: DVec3| {
                let along = corners.map(|corner| n.dot(corner.as_dvec3()));
                along.into_iter().fold(f64::NEG_INFINITY, f64::max)
            };
            !self.misses(reach)
        });
        !self.found
    }
}

impl BackgroundTiles {
    /// The tiles that see none of `triangles`, from the point `tip` among
    /// them; `boxes` are those of the triangles.
    pub fn new(
        camera: Camera,
        sky: Sky,
        resolution: (u32, u32),
        tip: DVec3,
        (triangles, boxes): (&[Triangle], &Boxes),
    ) -> Self {
        let (columns, rows) =
            (resolution.0.div_ceil(SIDE), resolution.1.div_ceil(SIDE));
        // Choose how far outside is outside
        let size = tip.abs().max_element() + 16384.;
        let margin = size / (1u64 << 46) as f64;
        let is_bare = |place: u32| {
            let (x, y) = (place % columns * SIDE, place / columns * SIDE);
            // Ask whether the tile sees a triangle
            // Send rays through the corners of the tile
            let (width, height) = resolution;
            let (right, bottom) =
                ((x + SIDE).min(width), (y + SIDE).min(height));
            let corners =
                [(x, y), (right, y), (right, bottom), (x, bottom)];
            let ray = |(x, y): (u32, u32)| {
                let (x, y) = (f64::from(x), f64::from(y));
                camera
                    .direction(x / f64::from(width), y / f64::from(height))
            };
            let [a, b, c, d] = corners.map(ray);
            let middle = camera.direction(0.5, 0.5);
            let inside = a + b + c + d;
            // Raise planes over the sides of the tile
            let side = |(a, b)| {
                let normal = cross(a, b).normalize_or_zero();
                let aside = normal.dot(inside);
                if aside.abs() < FLAT {
                    DVec3::ZERO
                } else {
                    normal * aside.signum()
                }
            };
            let [p, q, r, s] = [(a, b), (b, c), (c, d), (d, a)].map(side);
            let inwards = [p, q, r, s, middle];
            let mut pyramid =
                Pyramid { triangles, tip, inwards, margin, found: false };
            boxes.search(&mut pyramid);
            !pyramid.found
        };
        let places = (0..columns * rows).into_par_iter();
        let bare = places.map(is_bare).collect();
        Self { camera, sky, resolution, bare }
    }

    // Number and count the tiles
    /// The number of a tile, from its first pixel.
    fn place(&self, (x, y): (u32, u32)) -> usize {
        (y / SIDE * self.resolution.0.div_ceil(SIDE) + x / SIDE) as usize
    }

    /// How many tiles there are, and how many are bare.
    pub fn count(&self) -> (usize, usize) {
        let bare = self.bare.iter().filter(|&&bare| bare).count();
        (self.bare.len(), bare)
    }

    // Give the share of sky in a pixel
    /// The share of the pixel in which the sky is seen.
    fn coverage(&self, x: u32, y: u32) -> f64 {
        let (width, height) = self.resolution;
        let zenith = self.sky.zenith();
        let at = |(i, j): (f64, f64)| {
            let x = (f64::from(x) + i) / f64::from(width);
            let y = (f64::from(y) + j) / f64::from(height);
            zenith.dot(self.camera.towards(x, y))
        };
        positive_share(PIXEL.map(at))
    }
}

/// The least distance of unit vectors from a plane that tells on which
/// side of it they are: 2^-40.
const FLAT: f64 = 1. / (1u64 << 40) as f64;

// Measure the sky in a pixel
/// The corners of a pixel, around it.
const PIXEL: [(f64, f64); 4] = [(0., 0.), (1., 0.), (1., 1.), (0., 1.)];

/// The share of a pixel in which a linear function is positive, given
/// its values at the corners.
fn positive_share(values: [f64; 4]) -> f64 {
    if values.iter().all(|&f| f > 0.) {
        return 1.;
    }
    let mut polygon = Vec::with_capacity(6);
    // Walk around the pixel and its horizon
    for i in 0..4 {
        let j = (i + 1) % 4;
        let ((p, f), (q, g)) =
            ((PIXEL[i], values[i]), (PIXEL[j], values[j]));
        if f > 0. {
            polygon.push(p);
        }
        if (f > 0.) != (g > 0.) {
            let t = f / (f - g);
            polygon.push((p.0 + t * (q.0 - p.0), p.1 + t * (q.1 - p.1)));
        }
    }
    // Sum up the area of the polygon
    let next = polygon.iter().cycle().skip(1);
    let parts =
        polygon.iter().zip(next).map(|(p, q)| p.0 * q.1 - q.0 * p.1);
    (0.5 * parts.sum::<f64>()).clamp(0., 1.)
}
