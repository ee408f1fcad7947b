// Tangled from chapters/background.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Tiles of an image in which no triangle can be seen.

use glam::DVec3;
use rayon::prelude::*;

use crate::bvh::Bvh;
use crate::camera::Camera;
use crate::film::SIDE;
use crate::numerics::cross;
use crate::scene::Triangle;
use crate::sky::{Cover, Sky};

/// The content of a tile, as far as it is known before the render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TileContent {
    /// Unknown: its rays have to be traced.
    Scene,
    /// No ray from the camera through it meets a triangle.
    Sky,
    /// Each sample of each of its pixels is this number.
    Constant(f64),
}

/// The contents of the tiles of an image before the render; by default
/// unknown.
#[derive(Default)]
pub struct KnownPixels {
    columns: u32,
    /// By row and column; empty if nothing is known.
    tiles: Vec<TileContent>,
}

impl KnownPixels {
    /// For a render in advance of which nothing is known.
    pub const NOTHING: &Self = &Self { columns: 0, tiles: vec![] };

    /// The content of the tile of a pixel.
    pub fn content(&self, (x, y): (u32, u32)) -> TileContent {
        let tile = (y / SIDE * self.columns + x / SIDE) as usize;
        self.tiles.get(tile).copied().unwrap_or(TileContent::Scene)
    }

    /// Whether each sample of the image is known.
    pub fn is_all(&self) -> bool {
        let is_constant =
            |tile: &TileContent| matches!(tile, TileContent::Constant(_));
        !self.tiles.is_empty() && self.tiles.iter().all(is_constant)
    }

    /// The tiles of an image of this width and height, from their corners.
    fn new(
        (width, height): (u32, u32),
        content: impl Fn(u32, u32) -> TileContent + Sync,
    ) -> Self {
        let (columns, rows) = (width.div_ceil(SIDE), height.div_ceil(SIDE));
        let tiles = (0..columns * rows).into_par_iter();
        let tile = |i| content(i % columns * SIDE, i / columns * SIDE);
        Self { columns, tiles: tiles.map(tile).collect() }
    }

    /// All of an image of this width and height is black.
    pub fn dark(resolution: (u32, u32)) -> Self {
        Self::new(resolution, |_, _| TileContent::Constant(0.))
    }

    /// The tiles of an image of this width and height in which no triangle of
    /// an intersector is seen from `tip`, the place of the camera among the
    /// triangles.
    pub fn background(
        camera: &Camera,
        sky: &Sky,
        (width, height): (u32, u32),
        tip: DVec3,
        intersector: &Bvh,
    ) -> Self {
        let size = tip.abs().max_element() + 16384.;
        let margin = size / (1u64 << 46) as f64;
        Self::new((width, height), |x, y| {
            // Find the content of one tile
            // Send rays through the corners of the tile
            let (right, bottom) =
                ((x + SIDE).min(width), (y + SIDE).min(height));
            let corners =
                [(x, y), (right, y), (right, bottom), (x, bottom)];
            let corners = corners.map(|(x, y)| {
                let across = f64::from(x) / f64::from(width);
                camera.direction(across, f64::from(y) / f64::from(height))
            });
            let [a, b, c, d] = corners;
            let middle = camera.direction(0.5, 0.5);
            let inside = a + b + c + d;
            // Raise planes over the sides of the tile
            let side = |(a, b)| {
                let normal = cross(a, b).normalize_or_zero();
                let aside = normal.dot(inside);
                let is_flat = aside.abs() < FLAT;
                if is_flat { DVec3::ZERO } else { normal * aside.signum() }
            };
            let [p, q, r, s] = [(a, b), (b, c), (c, d), (d, a)].map(side);
            let inwards = [p, q, r, s, middle];
            // Search the hierarchy for a triangle inside
            let is_beside = |extent: [f64; 5]| {
                let beyond =
                    |k: usize| extent[k] - inwards[k].dot(tip) < -margin;
                (0..5).any(beyond)
            };
            let box_extent = |low: DVec3, high: DVec3| {
                inwards.map(|n| (n * low).max(n * high).element_sum())
            };
            let extent = |corners: &Triangle| {
                let along = |n: DVec3| corners.map(|corner| n.dot(corner));
                inwards.map(|n| {
                    along(n).into_iter().fold(f64::NEG_INFINITY, f64::max)
                })
            };
            let is_seen = intersector.any_triangle(
                |low, high| !is_beside(box_extent(low, high)),
                |_, corners| !is_beside(extent(corners)),
            );
            if is_seen {
                return TileContent::Scene;
            }
            // Test whether the sky is constant
            let is_above = corners.iter().all(|&c| sky.zenith.dot(c) > 0.);
            if intersector.ground_below(tip).is_finite() && !is_above {
                return TileContent::Scene;
            }
            if let Some(grey) = sky.background {
                return TileContent::Constant(grey);
            }
            let light = corners.map(|corner| sky.radiance(corner));
            let is_even =
                matches!(sky.cover, Cover::Uniform | Cover::Sphere);
            let is_patchy = matches!(sky.cover, Cover::Matrix(..));
            let has_steps = is_even || light[0] == 0. && !is_patchy;
            let is_along_axis = sky.zenith.abs().max_element() == 1.;
            match has_steps && is_along_axis && light == [light[0]; 4] {
                true => TileContent::Constant(light[0]),
                false => TileContent::Sky,
            }
        })
    }

    /// How many tiles see no triangle, and how many there are.
    pub fn count(&self) -> (usize, usize) {
        let empty = self.tiles.iter().filter(|&t| *t != TileContent::Scene);
        (empty.count(), self.tiles.len())
    }
}

/// The least distance of unit vectors from a plane at which their side is
/// certain: 2^-40.
const FLAT: f64 = 1. / (1u64 << 40) as f64;
