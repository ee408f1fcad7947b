// Tangled from chapters/filter.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Planes that fit the values of an image.

use std::array;

use glam::{Vec2, Vec4};

/// The sums of a fit, over terms that stand for place and turn of the normal.
#[derive(Default)]
pub struct Fit {
    /// The sum of the weights.
    pub weight: f32,
    terms: Vec4,
    /// The upper half of the products of the terms.
    products: [Vec4; 4],
    value: Vec2,
    /// The products of the terms and each half.
    values: [Vec4; 2],
}

impl Fit {
    /// Adds a value.
    #[inline(always)]
    pub fn add(&mut self, weight: f32, terms: Vec4, value: Vec2) {
        let scaled = weight * terms;
        self.weight += weight;
        self.terms += scaled;
        for (row, scale) in self.products.iter_mut().zip(scaled.to_array())
        {
            *row += scale * terms;
        }
        self.value += weight * value;
        for (sum, half) in self.values.iter_mut().zip(value.to_array()) {
            *sum += half * scaled;
        }
    }

    /// The plane of least squares, by Cholesky's decomposition of the
    /// products about the means; 0 without a weight.
    pub fn plane(&self) -> Plane {
        if self.weight == 0. {
            return Plane::default();
        }
        let (middle, value) =
            (self.terms / self.weight, self.value / self.weight);
        // Decompose the products
        let mut rows = [[0.; 4]; 4];
        for (a, row) in rows.iter_mut().enumerate() {
            let about = self.products[a] - self.terms[a] * middle;
            *row = about.to_array();
            row[a] += RIDGE * self.weight;
        }
        for a in 0..4 {
            for b in 0..=a {
                let terms = (0..b).map(|c| rows[a][c] * rows[b][c]);
                let rest = rows[b][a] - terms.sum::<f32>();
                let least = 1e-6 * self.weight;
                rows[a][b] = match a == b {
                    true => rest.max(least).sqrt(),
                    false => rest / rows[b][b],
                };
            }
        }
        // Solve for the slopes
        let mut constant = value.to_array();
        let slopes = array::from_fn(|half| {
            let right = self.values[half] - self.value[half] * middle;
            let mut slopes = right.to_array();
            for a in 0..4 {
                let known = (0..a).map(|c| rows[a][c] * slopes[c]);
                slopes[a] = (slopes[a] - known.sum::<f32>()) / rows[a][a];
            }
            for a in (0..4).rev() {
                let known = (a + 1..4).map(|c| rows[c][a] * slopes[c]);
                slopes[a] = (slopes[a] - known.sum::<f32>()) / rows[a][a];
                constant[half] -= slopes[a] * middle[a];
            }
            slopes.into()
        });
        Plane { value: constant.into(), slopes }
    }
}

/// A plane that fits: both halves of its value where all terms are 0, and the
/// slopes of each.
#[derive(Clone, Copy, Default)]
pub struct Plane {
    pub value: Vec2,
    pub slopes: [Vec4; 2],
}

impl Plane {
    /// The value at some terms.
    #[inline]
    pub fn at(&self, terms: Vec4) -> Vec2 {
        self.value + Vec2::from(self.slopes.map(|it| it.dot(terms)))
    }
}

/// The term that is added to the mean squares of a fit.
const RIDGE: f32 = 2e-3;
