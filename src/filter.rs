// Tangled from chapters/filter.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Pictures for looking: images that are filtered, with their own error.

use std::array;

use glam::{DVec2, Vec2};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::analysis::LitView;
use crate::bvh::{BEAM, Bvh, GROUND, Hit};
use crate::film::{Film, Window};
use crate::image::Image;
use crate::sampler::within;

/// What the rays through the centres of the pixels of a window meet, row by
/// row.
pub struct FirstHits {
    width: usize,
    hits: Vec<Option<Hit>>,
    /// Whether a neighbour shows another surface; none if one shows the sky.
    edges: Vec<Option<bool>>,
    /// Which part of each pixel surfaces cover, if no sky is seen behind.
    pub opacity: Option<Vec<f64>>,
}

/// Whether a second hit seems to continue the surface of the first.
fn is_like(one: &Hit, other: &Hit) -> bool {
    let to = other.point - one.point;
    one.normal.dot(other.normal) > 0.95
        && one.normal.dot(to).powi(2) <= 0.09 * to.length_squared()
}

/// What the ray through the centre of a pixel meets.
fn centre_hit(bvh: &Bvh, view: &LitView, x: u32, y: u32) -> Option<Hit> {
    let (columns, rows) = view.resolution;
    let centre = |i, n| within(i, n, 1 << 31);
    view.sensor.start(bvh, centre(x, columns), centre(y, rows)).2
}

impl FirstHits {
    /// Traces the rays of a window.
    pub fn trace(bvh: &Bvh, view: &LitView, window: Window) -> Self {
        let look = |x, y| centre_hit(bvh, view, x, y);
        let (right, bottom) = window.end();
        let rows = (window.corner.1..bottom).into_par_iter();
        let row = |y| (window.corner.0..right).map(move |x| look(x, y));
        let hits: Vec<Option<Hit>> = rows.flat_map_iter(row).collect();
        let width = window.size.0 as usize;
        // Find the edges
        let edge = |p: usize| {
            let hit = hits[p].as_ref()?;
            let mut around = around(p, (1, 1), width, hits.len());
            around.try_fold(false, |edge, (q, _)| {
                Some(edge || !is_like(hit, hits[q].as_ref()?))
            })
        };
        let edges = (0..hits.len()).into_par_iter().map(edge).collect();
        // Find how much of each pixel is covered
        let places = |p: usize| -> [_; BEAM] {
            let x = window.corner.0 + (p % width) as u32;
            let y = window.corner.1 + (p / width) as u32;
            let point =
                |i: u32| [i << 28, i.reverse_bits()].map(|u| u + (1 << 27));
            array::from_fn(|i| Some(((x, y), point(i as u32))))
        };
        let cover = |p| {
            let starts =
                view.sensor.starts(bvh, &places(p), view.resolution, false);
            starts.hits.iter().flatten().count() as f64 / BEAM as f64
        };
        let cover_all =
            |_| (0..hits.len()).into_par_iter().map(cover).collect();
        let opacity = view.sky.background.map(cover_all);
        Self { width, edges, hits, opacity }
    }
}

/// The means of at most about 2^14 pixels of a film, evenly spread, whose
/// centres show a surface of the scene, and not the ground below it.
pub fn surface_means(bvh: &Bvh, view: &LitView, film: &Film) -> Vec<f64> {
    let ((left, top), (right, bottom)) =
        (film.window.corner, film.window.end());
    let step = (film.area() as f64 / 16384.).sqrt().ceil() as usize;
    let rows = (top..bottom).into_par_iter().step_by(step);
    let pixels = rows.flat_map_iter(|y| {
        let shown = (left..right).step_by(step).filter(move |&x| {
            let hit = centre_hit(bvh, view, x, y);
            hit.is_some_and(|hit| hit.primitive < GROUND)
        });
        shown.map(move |x| film.pixel(x, y).mean())
    });
    pixels.collect()
}

/// The pixels around one that lie `step` apart, up to `reach` steps away, in
/// an image of this width and so many pixels: their places, and weights.
fn around(
    p: usize,
    (reach, step): (isize, isize),
    width: usize,
    pixels: usize,
) -> impl Iterator<Item = (usize, f32)> {
    let weight = |i: isize| [6., 4., 1.][i.unsigned_abs()];
    let steps = move || -reach..=reach;
    let offsets = steps().flat_map(move |j| steps().map(move |i| (i, j)));
    offsets.filter_map(move |(i, j)| {
        let x = (p % width).checked_add_signed(i * step)?;
        let y = (p / width).checked_add_signed(j * step)?;
        let q = y * width + x;
        (x < width && q < pixels).then_some((q, weight(i) * weight(j)))
    })
}

/// The mean around each pixel, over those that belong to it; a pixel that does
/// not belong to itself stays as it is.
fn smooth(
    values: &[Vec2],
    width: usize,
    step: isize,
    belongs: &(impl Fn(usize, usize) -> bool + Sync),
) -> Vec<Vec2> {
    let mean = |p| {
        if !belongs(p, p) {
            return values[p];
        }
        let neighbours = around(p, (2, step), width, values.len());
        let members = neighbours.filter(|&(q, _)| belongs(p, q));
        let (mut sum, mut total) = (Vec2::ZERO, 0.);
        for (q, weight) in members {
            sum += weight * values[q];
            total += weight;
        }
        sum / total
    };
    (0..values.len()).into_par_iter().map(mean).collect()
}

/// A filtered image.
pub struct Filtered {
    /// Its pixels, with their root mean square errors.
    pub image: Image,
    /// How wrong all of it is.
    pub error: PictureError,
}

/// Root mean squares over the pixels of a filtered image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PictureError {
    /// The error.
    pub rmse: f64,
    /// What of it comes from filtering, and stays with more samples.
    pub bias: f64,
}

/// The halves of an image while it is filtered.
struct Filter {
    width: usize,
    /// The weight of each half in the picture.
    weights: Vec<Vec2>,
    /// The halves as they are.
    whole: Vec<Vec2>,
}

impl Filter {
    /// Estimates without bias of the variance of a pixel, and of the square
    /// of its bias, if its halves are `shown`.
    fn error(&self, p: usize, shown: Vec2) -> DVec2 {
        let bias = (shown - self.whole[p]).as_dvec2();
        let difference = f64::from(shown.x - shown.y);
        let weights = f64::from(self.weights[p].x * self.weights[p].y);
        DVec2::new(weights * difference * difference, bias.x * bias.y)
    }

    /// Filters a part of an image, to which the rest is added, as widely as
    /// makes the error least; with the mean of this error.
    fn best(
        &self,
        part: Vec<Vec2>,
        rest: &[Vec2],
        belongs: impl Fn(usize, usize) -> bool + Sync,
    ) -> (Vec<Vec2>, DVec2) {
        // Judge a mixture of two rounds
        let judge = |now: &[Vec2], next: &[Vec2], blend| -> DVec2 {
            let row = |first: usize| -> DVec2 {
                let pixels = first..first + self.width;
                let shown =
                    |p| rest[p] + Vec2::lerp(now[p], next[p], blend);
                pixels.map(|p| self.error(p, shown(p))).sum()
            };
            let rows = (0..rest.len()).into_par_iter().step_by(self.width);
            let rows: Vec<DVec2> = rows.map(row).collect();
            rows.iter().sum::<DVec2>() / rest.len() as f64
        };
        let mut best = (part.clone(), judge(&part, &part, 1.));
        let mut now = part;
        let is_zero = now.iter().all(|halves| *halves == Vec2::ZERO);
        for level in 0..if is_zero { 0 } else { 5 } {
            let next = smooth(&now, self.width, 1 << level, &belongs);
            for blend in [0.25, 0.5, 0.75, 1.] {
                let error = judge(&now, &next, blend);
                if error.element_sum() < best.1.element_sum() {
                    let pairs = now.iter().zip(&next);
                    let mixed = pairs.map(|(a, b)| a.lerp(*b, blend));
                    best = (mixed.collect(), error);
                }
            }
            now = next;
        }
        best
    }
}

impl Filtered {
    /// Filters the image on a film; none if it has no halves, or a half of a
    /// pixel has no value.
    pub fn of(film: &Film, guide: &FirstHits) -> Option<Self> {
        let &FirstHits { width, ref hits, ref edges, .. } = guide;
        // Collect the halves row by row
        let counts: Vec<Vec2> = film.halves_of(2).collect();
        if counts.is_empty() || counts.iter().any(|n| n.min_element() < 1.)
        {
            return None;
        }
        let mean = |part| {
            let sums = film.halves_of(part).zip(&counts);
            sums.map(|(sum, count)| sum / count).collect::<Vec<Vec2>>()
        };
        let (gathered, corrected) = (mean(0), mean(1));
        let whole = gathered.iter().zip(&corrected).map(|(g, c)| g + c);
        let weights = counts.iter().map(|n| n / n.element_sum());
        let (weights, whole) = (weights.collect(), whole.collect());
        let filter = Filter { width, weights, whole };
        let same =
            |p: usize, q: usize| hits[p].is_some() == hits[q].is_some();
        let (corrected, _) = filter.best(corrected, &gathered, same);
        let in_place = |gathered, edge| {
            filter.best(gathered, &corrected, |p, q| {
                let like =
                    |other| hits[p].is_some_and(|p| is_like(&p, other));
                [edges[p], edges[q]] == [Some(edge); 2]
                    && hits[q].as_ref().is_some_and(like)
            })
        };
        let (gathered, _) = in_place(gathered, false);
        let (gathered, error) = in_place(gathered, true);
        // State the error of each pixel
        let shown = gathered.iter().zip(&corrected).map(|(g, c)| g + c);
        let shown: Vec<Vec2> = shown.collect();
        let variance = |(p, &shown)| filter.error(p, shown).x as f32;
        let estimates = shown.iter().enumerate().map(variance);
        let mut variances: Vec<_> = estimates.map(Vec2::splat).collect();
        for level in 0..3 {
            variances = smooth(&variances, width, 1 << level, &same);
        }
        let square = error.y.max(0.);
        let (rmse, bias) = ((error.x + square).sqrt(), square.sqrt());
        let errors =
            variances.iter().map(|v| (f64::from(v.x) + square).sqrt());
        let means = shown.iter().zip(&filter.weights);
        let means =
            means.map(|(halves, weight)| halves.dot(*weight).into());
        let (columns, rows) = film.window.size;
        let (errors, means) = (Some(errors.collect()), means.collect());
        let image = Image { errors, ..Image::plain(columns, rows, means) };
        Some(Self { image, error: PictureError { rmse, bias } })
    }
}
