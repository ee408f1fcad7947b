// Tangled from chapters/picture.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Pictures for looking: images that are filtered, with their own error.

use glam::{DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::analysis::LitView;
use crate::bvh::{Bvh, Dispatch, Intersector};
use crate::film::{Film, Halves, Window};
use crate::image::Image;
use crate::sampler::within;

/// What the rays through the middles of the pixels of a window meet, row by
/// row.
pub struct FirstHits {
    size: (usize, usize),
    hits: Vec<Surface>,
    /// What their neighbours show.
    places: Vec<Place>,
}

/// What is around a pixel.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    /// It and its neighbours show one surface.
    Inside,
    /// A neighbour shows another surface.
    Edge,
    /// It or a neighbour shows the sky.
    Sky,
}

/// What one pixel shows.
#[derive(Clone, Copy, Default)]
struct Surface {
    point: DVec3,
    /// Of length one; zero for the sky.
    normal: Vec3,
    /// The distance to the nearest point that a neighbour shows.
    spacing: f32,
}

impl Surface {
    fn is_sky(&self) -> bool {
        self.normal == Vec3::ZERO
    }

    /// Whether another, so many pixels away, continues this one.
    fn is_like(&self, other: &Self, pixels: usize) -> bool {
        let to = (other.point - self.point).as_vec3();
        let limit = self.spacing * pixels as f32;
        self.normal.dot(other.normal) > 0.95
            && self.normal.dot(to).abs() <= limit
    }
}

impl FirstHits {
    /// Traces the rays of a window.
    pub fn trace(
        intersector: &Bvh,
        view: &LitView,
        window: Window,
    ) -> Self {
        let (width, height) = window.size;
        let mut all = Self {
            size: (width as usize, height as usize),
            hits: intersector.dispatch(Look { view, window }),
            places: vec![],
        };
        let pixels = 0..all.hits.len();
        // Find the nearest neighbours and the edges
        let spacing = |p| {
            let own: &Surface = &all.hits[p];
            let others = all.square(p, 1, 1).filter(|&(q, ..)| q != p);
            let others = others.map(|(q, ..)| &all.hits[q]);
            let seen = others.filter(|other| !other.is_sky());
            let distances =
                seen.map(|o| (o.point - own.point).length() as f32);
            distances.fold(f32::INFINITY, f32::min)
        };
        let spacings: Vec<f32> =
            pixels.clone().into_par_iter().map(spacing).collect();
        for (hit, spacing) in all.hits.iter_mut().zip(spacings) {
            hit.spacing = spacing;
        }
        let place = |p| {
            let own: &Surface = &all.hits[p];
            let mut around =
                all.square(p, 1, 1).map(|(q, ..)| &all.hits[q]);
            match around.clone().any(Surface::is_sky) {
                true => Place::Sky,
                false if around.all(|other| own.is_like(other, 1)) => {
                    Place::Inside
                }
                false => Place::Edge,
            }
        };
        all.places = pixels.into_par_iter().map(place).collect();
        all
    }
}

/// Rays that wait for their intersector.
struct Look<'a> {
    view: &'a LitView,
    window: Window,
}

impl Dispatch for Look<'_> {
    type Output = Vec<Surface>;

    fn with<K: Intersector>(self, intersector: &K) -> Vec<Surface> {
        let Self { view, window } = self;
        let (width, height) = view.resolution;
        let look = |x, y| {
            let middle = |i, n| within(i, n, 1 << 31);
            let (x, y) = (middle(x, width), middle(y, height));
            let ray = view.entrance.enter(view.camera.direction(x, y))?;
            let hit = intersector.first_hit(&ray, None)?;
            let normal = hit.normal.as_vec3();
            Some(Surface { point: hit.point, normal, spacing: 0. })
        };
        let (right, bottom) = window.end();
        let rows = (window.corner.1..bottom).into_par_iter();
        rows.flat_map_iter(|y| {
            let row = window.corner.0..right;
            row.map(move |x| look(x, y).unwrap_or_default())
        })
        .collect()
    }
}

impl FirstHits {
    /// The pixels of a square around `p`: all that are up to `reach` steps of
    /// `step` pixels away, and how many steps that are.
    fn square(
        &self,
        p: usize,
        reach: isize,
        step: isize,
    ) -> impl Iterator<Item = (usize, isize, isize)> + Clone {
        let (width, height) = self.size;
        let (x, y) = ((p % width) as isize, (p / width) as isize);
        let inside = move |i: isize, n: usize| (0..n as isize).contains(&i);
        let all = -reach..=reach;
        let rows =
            all.clone().filter(move |j| inside(y + j * step, height));
        rows.flat_map(move |j| {
            let row =
                all.clone().filter(move |i| inside(x + i * step, width));
            row.map(move |i| {
                let (x, y) = (x + i * step, y + j * step);
                ((y as usize) * width + x as usize, i, j)
            })
        })
    }

    /// The means of the values around each pixel, of those that belong to it.
    fn smooth(
        &self,
        values: &[Vec2],
        step: isize,
        belongs: &(impl Fn(usize, usize) -> bool + Sync),
    ) -> Vec<Vec2> {
        let weight = |i: isize| [6., 4., 1.][i.unsigned_abs()];
        let pixels = (0..values.len()).into_par_iter();
        let mean = |p| {
            let (mut sum, mut total) = (Vec2::ZERO, 0.);
            for (q, i, j) in self.square(p, 2, step) {
                if q == p || belongs(p, q) {
                    let weight = weight(i) * weight(j);
                    sum += weight * values[q];
                    total += weight;
                }
            }
            sum / total
        };
        pixels.map(mean).collect()
    }
}

/// A filtered image.
pub struct Filtered {
    /// Its pixels, with their root mean square errors.
    pub image: Image,
    /// The root mean square error of all pixels, and what of it is bias.
    pub error: PictureError,
}

/// How wrong a filtered image is: root mean squares over its pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PictureError {
    /// The error.
    pub rmse: f64,
    /// What of it comes from filtering, and would stay with more samples.
    pub bias: f64,
}

/// The halves of an image while it is filtered.
struct Filter<'a> {
    hits: &'a FirstHits,
    /// The share of each half in the picture.
    shares: Vec<Vec2>,
    /// The halves, unfiltered.
    whole: Vec<Vec2>,
}

impl Filter<'_> {
    /// Estimates without bias of the variance and of the square of the bias
    /// of a pixel of halves that add up to `shown`.
    fn error(&self, p: usize, shown: Vec2) -> DVec2 {
        let Vec2 { x: a, y: b } = self.shares[p];
        let bias = shown - self.whole[p];
        let difference = shown.x - shown.y;
        let variance = a * b * difference * difference;
        DVec2::new(variance.into(), (bias.x * bias.y).into())
    }

    /// The mean of the errors of all pixels.
    fn mean_error(&self, part: &[Vec2], rest: &[Vec2]) -> DVec2 {
        let pixels: Vec<usize> = (0..part.len()).collect();
        let sum = |pixels: &[usize]| -> DVec2 {
            let error = |&p: &usize| self.error(p, part[p] + rest[p]);
            pixels.iter().map(error).sum()
        };
        let sums: Vec<DVec2> = pixels.par_chunks(4096).map(sum).collect();
        sums.iter().sum::<DVec2>() / part.len() as f64
    }

    /// Filters a part of an image as widely as makes the error least, given
    /// the rest; with this error.
    fn best(
        &self,
        part: Vec<Vec2>,
        rest: &[Vec2],
        belongs: impl Fn(usize, usize, isize) -> bool + Sync,
    ) -> (Vec<Vec2>, DVec2) {
        let mut best = (part.clone(), self.mean_error(&part, rest));
        let mut now = part;
        for level in 0..LEVELS {
            let step = 1 << level;
            let belongs = |p, q| belongs(p, q, step);
            let next = self.hits.smooth(&now, step, &belongs);
            for quarters in [1., 2., 3., 4.] {
                let pairs = now.iter().zip(&next);
                let mixed = pairs.map(|(a, b)| a.lerp(*b, 0.25 * quarters));
                let mixed: Vec<Vec2> = mixed.collect();
                let error = self.mean_error(&mixed, rest);
                if error.element_sum() < best.1.element_sum() {
                    best = (mixed, error);
                }
            }
            now = next;
        }
        best
    }
}

/// Rounds of a filter at most.
const LEVELS: u32 = 5;

impl Filtered {
    /// Filters the image on a film; none if it has no halves, or a half of a
    /// pixel has no value.
    pub fn of(film: &Film, hits: &FirstHits) -> Option<Self> {
        // Collect the halves row by row
        if film.halves.is_empty() {
            return None;
        }
        let window = film.window;
        let (right, bottom) = window.end();
        let rows = window.corner.1..bottom;
        let row = |y| (window.corner.0..right).map(move |x| (x, y));
        let pixels = rows.flat_map(row);
        let halves = pixels.map(|(x, y)| &film.halves[film.index(x, y)]);
        let counts: Vec<Vec2> =
            halves.clone().map(Halves::counts).collect();
        if counts.iter().any(|count| count.min_element() < 1.) {
            return None;
        }
        let parts = halves.map(Halves::means).map(|[g, c]| (g, c));
        let (gathered, corrected): (Vec<_>, Vec<_>) = parts.unzip();
        let whole = gathered.iter().zip(&corrected).map(|(g, c)| g + c);
        let filter = Filter {
            hits,
            shares: counts.iter().map(|n| n / n.element_sum()).collect(),
            whole: whole.collect(),
        };
        let same = |p: usize, q: usize| {
            hits.hits[p].is_sky() == hits.hits[q].is_sky()
        };
        let (corrected, _) =
            filter.best(corrected, &gathered, |p, q, _| same(p, q));
        let in_place = |gathered, place| {
            filter.best(gathered, &corrected, |p, q, step| {
                hits.places[p] == place
                    && hits.places[q] == place
                    && hits.hits[p].is_like(&hits.hits[q], step as usize)
            })
        };
        let (gathered, _) = in_place(gathered, Place::Inside);
        let (gathered, error) = in_place(gathered, Place::Edge);
        // State the error of each pixel
        let shown = gathered.iter().zip(&corrected).map(|(g, c)| g + c);
        let shown: Vec<Vec2> = shown.collect();
        let variance = |(p, &shown)| filter.error(p, shown).x;
        let variances = shown.iter().enumerate().map(variance);
        let mut variances: Vec<Vec2> = variances
            .map(|variance| Vec2::splat(variance as f32))
            .collect();
        for level in 0..3 {
            variances = hits.smooth(&variances, 1 << level, &same);
        }
        let bias = error.y.max(0.);
        let errors =
            variances.iter().map(|v| (f64::from(v.x) + bias).sqrt());
        let means = shown.iter().zip(&filter.shares);
        let means = means.map(|(halves, share)| halves.dot(*share).into());
        let (width, height) = window.size;
        let image = Image {
            errors: Some(errors.collect()),
            ..Image::plain(width, height, means.collect())
        };
        let rmse = (error.x + bias).sqrt();
        let error = PictureError { rmse, bias: bias.sqrt() };
        Some(Self { image, error })
    }
}
