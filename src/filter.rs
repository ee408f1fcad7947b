// Tangled from chapters/filter.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Pictures for looking: images that are filtered, with their own error.

mod blocks;
mod fit;
mod look;

use std::array;

use glam::{DVec2, Vec2, Vec3A, Vec4, Vec4Swizzles};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::film::{Film, Fragment, Fragments, HalfBuffers, UNIT};
use crate::image::Image;
use blocks::{Best, CLASSES, Grid};
use fit::{Fit, Plane};
pub use look::{fragments, surface_means};

/// The sums of both halves of a fragment, and the samples that they have.
#[derive(Clone, Copy)]
struct Halves(Vec4);

impl Halves {
    fn new(mean: Vec2, count: Vec2) -> Self {
        let sum = mean * count;
        Self(Vec4::new(sum.x, sum.y, count.x, count.y))
    }

    #[inline]
    fn count(&self) -> Vec2 {
        self.0.zw()
    }

    /// The means of the halves; 0 without a sample.
    #[inline]
    fn mean(&self) -> Vec2 {
        self.0.xy() / self.count().max(Vec2::splat(f32::MIN_POSITIVE))
    }

    /// Whether both halves have samples.
    #[inline]
    fn is_whole(&self) -> bool {
        self.count().min_element() > 0.
    }
}

/// The halves of an image while it is filtered.
struct Filter<'a> {
    shown: &'a Fragments,
    grid: Grid,
    /// The pixel of each fragment.
    pixels: Vec<u32>,
    /// What each pixel shows, if any surface.
    classes: Vec<Option<usize>>,
    /// The halves of each pixel as they are, if both have samples.
    whole: Vec<Option<Vec2>>,
}

impl<'a> Filter<'a> {
    /// A filter for a film, with what was gathered for each fragment, and
    /// what was corrected for each pixel.
    fn new(
        film: &Film,
        shown: &'a Fragments,
    ) -> (Self, Vec<Halves>, Vec<Halves>) {
        let (width, height) = film.window.size;
        // Sort the halves of tiles by rows
        let mut sums = vec![HalfBuffers::default(); shown.all.len()];
        for (tile, halves) in film.tiles_of_halves() {
            let places = shown.pixels(tile).flat_map(|p| shown.range(p));
            places.zip(halves).for_each(|(f, halves)| sums[f] = *halves);
        }
        // Weigh each fragment by its coverage, if a half has samples
        let spp = film.samples() as f32 / 2.;
        let part = |f: usize, term: usize| {
            let count =
                Vec2::from(sums[f].map(|half| half[2 + term] as f32));
            let sum = sums[f].map(|half| (half[term] as f64 / UNIT) as f32);
            let has = count.min(Vec2::ONE);
            let mean = Vec2::from(sum) / count.max(Vec2::ONE);
            Halves::new(mean, has * (spp * shown.all[f].coverage))
        };
        let all = (0..sums.len()).into_par_iter();
        let gathered: Vec<_> = all.map(|f| part(f, 0)).collect();
        let area = (0..film.window.area()).into_par_iter();
        let corrected = area
            .clone()
            .map(|p| Halves(shown.range(p).map(|f| part(f, 1).0).sum()));
        let corrected: Vec<_> = corrected.collect();
        // Describe the pixels
        let number = |p| shown.range(p).map(move |_| p as u32);
        let mut filter = Self {
            shown,
            grid: Grid::new(width as usize, height as usize),
            pixels: area.clone().flat_map_iter(number).collect(),
            classes: area.map(|p| class(shown.of(p))).collect(),
            whole: vec![],
        };
        let halves = filter.compose(&gathered).into_iter();
        let halves = halves.zip(filter.means(&corrected));
        let is_whole =
            |p: usize| shown.range(p).all(|f| gathered[f].is_whole());
        let whole = halves.enumerate().map(|(p, (mean, more))| {
            let is_known = filter.classes[p].is_some() && is_whole(p);
            is_known.then_some(mean + more)
        });
        filter.whole = whole.collect();
        (filter, gathered, corrected)
    }
}

impl Filter<'_> {
    /// The halves of each pixel, composed of its fragments, the sky and the sun.
    fn compose(&self, values: &[Halves]) -> Vec<Vec2> {
        let Fragments { all, sky, sun, .. } = self.shown;
        let pixel = |p: usize| {
            let known = Vec2::splat(sky[p] + sun[p]);
            self.shown.range(p).fold(known, |sum, f| {
                sum + all[f].coverage * values[f].mean()
            })
        };
        (0..sky.len()).into_par_iter().map(pixel).collect()
    }

    /// What values of a pixel add, if they stand for all its surfaces.
    fn means(&self, values: &[Halves]) -> Vec<Vec2> {
        let pixel = |(p, value): (usize, &Halves)| {
            let own = self.shown.of(p).iter();
            own.map(|it| it.coverage).sum::<f32>() * value.mean()
        };
        values.par_iter().enumerate().map(pixel).collect()
    }

    /// Unbiased estimates of the variance of a pixel and of the square of
    /// its bias, if its halves are `shown`; zero if it is not known.
    fn error(&self, p: usize, shown: Vec2) -> DVec2 {
        let Some(whole) = self.whole[p] else { return DVec2::ZERO };
        error(whole, shown)
    }
}

impl Filter<'_> {
    /// The sums of the errors of the pixels of each block.
    fn errors(&self, shown: &[Vec2]) -> Vec<[DVec2; CLASSES]> {
        let Grid { width, blocks: [columns, _], .. } = self.grid;
        let rows = shown.par_chunks(width).enumerate();
        let rows = rows.map(|(row, halves)| {
            let mut sums = vec![[DVec2::ZERO; CLASSES]; columns];
            for (p, &halves) in (row * width..).zip(halves) {
                if let Some(class) = self.classes[p] {
                    let column = self.grid.block(p) % columns;
                    sums[column][class] += self.error(p, halves);
                }
            }
            (self.grid.block(row * width), sums)
        });
        let rows: Vec<_> = rows.collect();
        let mut sums = vec![[DVec2::ZERO; CLASSES]; self.grid.count()];
        for (first, row) in rows {
            for (sums, row) in sums[first..].iter_mut().zip(row) {
                *sums = array::from_fn(|class| sums[class] + row[class]);
            }
        }
        sums
    }
}

/// Unbiased estimates of the variance of filtered halves and of the square
/// of their bias, given the halves as they were.
fn error(whole: Vec2, shown: Vec2) -> DVec2 {
    let bias = (shown - whole).as_dvec2();
    let difference = f64::from(shown.x - shown.y);
    DVec2::new(0.25 * difference * difference, bias.x * bias.y)
}

/// The kind of a pixel with these fragments, if it shows any surface.
fn class(own: &[Fragment]) -> Option<usize> {
    let covered: f32 = own.iter().map(|it| it.coverage).sum();
    match own.len() {
        0 => None,
        _ if covered < 0.999 => Some(2),
        n => Some(usize::from(n > 1)),
    }
}

impl Filter<'_> {
    /// Visits the fragments around one, `step` pixels apart and up to
    /// `reach` steps away, with the steps to each.
    #[inline(always)]
    fn around(
        &self,
        f: usize,
        (reach, step): (isize, isize),
        mut visit: impl FnMut(usize, isize, isize),
    ) {
        let (p, width) =
            (self.pixels[f] as isize, self.grid.width as isize);
        let height = self.classes.len() as isize / width;
        let (x, y) = (p % width, p / width);
        let is_row = |j: &isize| (0..height).contains(&(y + j * step));
        let is_column = |i: &isize| (0..width).contains(&(x + i * step));
        for j in (-reach..=reach).filter(is_row) {
            for i in (-reach..=reach).filter(is_column) {
                let q = (p + (j * width + i) * step) as usize;
                self.shown.range(q).for_each(|g| visit(g, i, j));
            }
        }
    }
}

/// The weights of a mean by the distance in steps.
const WEIGHTS: [f32; 2] = [2., 1.];

impl Filter<'_> {
    /// The means around each fragment, over those that continue its surface.
    fn smooth(&self, values: &[Halves], step: isize) -> Vec<Halves> {
        let all = &self.shown.all;
        let mean = |f: usize| {
            let (mut sum, mut covered) = (Vec4::ZERO, 0.);
            self.around(f, (1, step), |g, i, j| {
                if f == g || all[f].is_like(&all[g]) {
                    let weight = |i: isize| WEIGHTS[i.unsigned_abs()];
                    let weight = weight(i) * weight(j);
                    sum += weight * values[g].0;
                    covered += weight * all[g].coverage;
                }
            });
            Halves(sum / covered)
        };
        (0..values.len()).into_par_iter().map(mean).collect()
    }
}

impl Filter<'_> {
    /// The sums around each pixel, over all surfaces.
    fn blur(&self, values: &[Halves], step: usize) -> Vec<Halves> {
        let (width, area) = (self.grid.width, values.len());
        let along = |values: &[Halves], step: usize, side: usize| {
            let sum = |p: usize| {
                let at = p % side;
                let near = |k: usize| {
                    let offset = k * step;
                    let before =
                        (at >= offset).then(|| values[p - offset].0);
                    let after = at + offset < side;
                    let after = after.then(|| values[p + offset].0);
                    WEIGHTS[k]
                        * (before.unwrap_or_default()
                            + after.unwrap_or_default())
                };
                Halves(WEIGHTS[0] * values[p].0 + near(1))
            };
            (0..area).into_par_iter().map(sum).collect::<Vec<_>>()
        };
        let rows = along(values, step, width);
        along(&rows, step * width, area)
    }
}

impl Filter<'_> {
    /// The mean near each pixel of what is known in the pixels.
    fn near(
        &self,
        known: impl Fn(usize) -> Option<f32> + Sync,
    ) -> impl Iterator<Item = f64> {
        let halves = |p: usize| {
            let count = f32::from(known(p).is_some());
            let value = known(p).unwrap_or_default();
            Halves::new(Vec2::splat(value), Vec2::splat(count))
        };
        let pixels = (0..self.whole.len()).into_par_iter();
        let mut values: Vec<Halves> = pixels.map(halves).collect();
        for level in 0..3 {
            values = self.blur(&values, 1 << level);
        }
        values.into_iter().map(|it| f64::from(it.mean().x))
    }
}

impl Filter<'_> {
    /// The plane in place and normal that fits the fragments around one.
    /// Where there are few samples it is drawn to `prior`.
    fn plane(
        &self,
        f: usize,
        (values, prior): (&[Halves], &[Halves]),
        step: isize,
    ) -> Plane {
        let (all, here) = (&self.shown.all, &self.shown.all[f]);
        let axes = Axes::around(here.normal);
        let mut sums = Fit::default();
        self.around(f, (3, step), |g, i, j| {
            let square = (i * i + j * j) as usize;
            let is_near = square < WINDOW.len() && values[g].is_whole();
            if is_near && (f == g || here.continues(&all[g])) {
                let count = values[g].count().element_sum();
                let terms = axes.terms([i as f32, j as f32], all[g].normal);
                sums.add(WINDOW[square] * count, terms, values[g].mean());
            }
        });
        let seen = sums.weight * (step * step) as f32;
        let part = seen / (seen + PRIOR);
        let prior = prior[self.pixels[f] as usize].mean();
        let mut plane = sums.plane();
        plane.value = prior.lerp(plane.value, part);
        plane.slopes = plane.slopes.map(|slopes| part * slopes);
        plane
    }
}

impl Filter<'_> {
    /// The values of planes that fit the fragments around each: the planes
    /// of every second pixel of every second row, or one of its own if none
    /// of them is near.
    fn fit(
        &self,
        values: &[Halves],
        step: isize,
        prior: &[Halves],
    ) -> Vec<Halves> {
        let (all, width) = (&self.shown.all, self.grid.width);
        let count = (0..values.len()).into_par_iter();
        let is_chosen = |p: usize| ((p % width) | (p / width)) & 1 == 0;
        let planes = count.clone().map(|f| {
            is_chosen(self.pixels[f] as usize)
                .then(|| self.plane(f, (values, prior), step))
        });
        let planes: Vec<Option<Plane>> = planes.collect();
        let value = |f: usize| {
            if let Some(plane) = planes[f] {
                return Halves::new(plane.value, Vec2::ONE);
            }
            // Evaluate the planes around a fragment
            let mut sum = Halves(Vec4::ZERO);
            self.around(f, (1, 1), |g, i, j| {
                if let Some(plane) = &planes[g]
                    && all[g].continues(&all[f])
                {
                    let axes = Axes::around(all[g].normal);
                    let terms = axes.terms(
                        [i, j].map(|i| -i as f32 / step as f32),
                        all[f].normal,
                    );
                    sum.0 += Halves::new(plane.at(terms), Vec2::ONE).0;
                }
            });
            if sum.is_whole() {
                return sum;
            }
            let plane = self.plane(f, (values, prior), step);
            Halves::new(plane.value, Vec2::ONE)
        };
        count.map(value).collect()
    }
}

/// The axes along which the turn of a normal is measured.
struct Axes {
    across: Vec3A,
    along: Vec3A,
}

impl Axes {
    fn around(normal: Vec3A) -> Self {
        let (across, along) = normal.any_orthonormal_pair();
        Self { across, along }
    }

    /// The terms of a fit: so many steps across and down, and a turn.
    #[inline(always)]
    fn terms(&self, steps: [f32; 2], normal: Vec3A) -> Vec4 {
        let [x, y] = steps.map(|i| i / 3.);
        let turn = |axis: Vec3A| 3. * axis.dot(normal);
        Vec4::new(x, y, turn(self.across), turn(self.along))
    }
}

/// The weight of the surroundings where a half has no sample.
const FEW: f32 = 1e-3;

/// The number of samples with the weight of the surroundings.
const PRIOR: f32 = 5.;

/// The weights of a window by the square of the distance in steps.
const WINDOW: [f32; 10] = [
    1., 0.8007374, 0.6411804, 0., 0.4111123, 0.329193, 0., 0., 0.1690133,
    0.1353353,
];

impl Filter<'_> {
    /// What corrections add to each pixel, filtered over all surfaces with
    /// the width that makes the error least.
    fn correct(&self, corrected: Vec<Halves>) -> Vec<Vec2> {
        let raw = self.means(&corrected);
        if raw.iter().all(|&it| it == Vec2::ZERO) {
            return raw;
        }
        // Judge corrections by their error for the eye
        let light =
            |p: usize| self.whole[p].map(|it| 0.5 * it.element_sum());
        let light: Vec<f64> =
            self.near(light).map(|it| it.max(0.)).collect();
        let mean = light.iter().sum::<f64>() / light.len() as f64;
        let judge = |way: &[Vec2]| -> f64 {
            let error = |p: usize| {
                let is_known = self.whole[p].is_some();
                let errors = is_known.then(|| error(raw[p], way[p]));
                let error =
                    errors.map_or(0., |errors| errors.element_sum());
                error / (light[p] + mean).powi(2)
            };
            let width = self.grid.width;
            let rows = (0..way.len() / width).into_par_iter();
            let row = |y: usize| (y * width..(y + 1) * width).map(error);
            let sums = rows.map(|y| row(y).sum()).collect::<Vec<f64>>();
            sums.iter().sum()
        };
        let mut best = raw.clone();
        let (mut least, mut before) = (judge(&best), best.clone());
        let mut now = corrected;
        for level in 0..LEVELS {
            now = self.blur(&now, 1 << level);
            let after = self.means(&now);
            for way in [mix(&before, &after, 0.5), after.clone()] {
                let error = judge(&way);
                if error < least {
                    (least, best) = (error, way);
                }
            }
            before = after;
        }
        best
    }
}

/// A part of the way from some values to others.
fn mix(from: &[Vec2], to: &[Vec2], part: f32) -> Vec<Vec2> {
    let pairs = from.par_iter().zip(to);
    pairs.map(|(from, to)| from.lerp(*to, part)).collect()
}

/// Rounds of means, each over twice the distance.
const LEVELS: usize = 6;

/// Rounds before which planes are fitted.
const FITS: usize = 3;

impl Filter<'_> {
    /// The halves of the pixels, filtered in the best ways.
    fn filter(
        &self,
        gathered: Vec<Halves>,
        corrected: &[Vec2],
    ) -> Vec<Vec2> {
        // Fill the fragments without samples
        let sum = |p| self.shown.range(p).map(|f| gathered[f].0).sum();
        let area = (0..corrected.len()).into_par_iter();
        let around: Vec<_> = area.map(|p| Halves(sum(p))).collect();
        let around = self.blur(&self.blur(&around, 1), 2);
        let mut now = gathered;
        for (halves, &p) in now.iter_mut().zip(&self.pixels) {
            if !halves.is_whole() {
                let mean = around[p as usize].mean();
                *halves = Halves::new(mean, Vec2::splat(FEW));
            }
        }
        let show = |values: &[Halves]| {
            let mut shown = self.compose(values);
            let more = corrected.par_iter();
            shown.par_iter_mut().zip(more).for_each(|(a, b)| *a += b);
            shown
        };
        let mut best = Best::new(&self.grid, &self.classes);
        let mut offer = |way: &[Vec2]| best.offer(way, &self.errors(way));
        let mut before = show(&now);
        offer(&before);
        for level in 0..LEVELS {
            if level < FITS {
                offer(&show(&self.fit(&now, 1 << level, &around)));
            }
            now = self.smooth(&now, 1 << level);
            let after = show(&now);
            offer(&mix(&before, &after, 0.5));
            offer(&after);
            before = after;
        }
        best.blend()
    }
}

/// A filtered image.
#[derive(Clone)]
pub struct Filtered {
    /// Its pixels, with their root mean square errors.
    pub image: Image,
    /// The error of the whole picture.
    pub error: PictureError,
}

/// The samples of each pixel without which no image is filtered.
pub const FEWEST: u64 = 4;

/// Root mean squares over the pixels of a filtered image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PictureError {
    /// The error.
    pub rmse: f64,
    /// The part that comes from filtering, and stays with more samples.
    pub bias: f64,
}

impl Filtered {
    /// Filters the image on a film. There is no picture if the film has no
    /// fragments, a half of a tile has no samples, there are fewer than
    /// four samples a pixel, or no pixel has samples of all that it shows.
    pub fn of(film: &Film) -> Option<Self> {
        let shown = film.fragments.as_deref()?;
        if film.samples() < FEWEST.max(2 * film.net_size) {
            return None;
        }
        let (filter, gathered, corrected) = Filter::new(film, shown);
        if filter.whole.iter().all(Option::is_none) {
            return None;
        }
        let corrected = filter.correct(corrected);
        let shown = filter.filter(gathered, &corrected);
        // Find the error of the image
        let mut known = [[0; 2]; CLASSES];
        for (class, whole) in filter.classes.iter().zip(&filter.whole) {
            if let &Some(class) = class {
                known[class][usize::from(whole.is_some())] += 1;
            }
        }
        let errors = filter.errors(&shown);
        let sum = |(class, [without, with]): (usize, [u32; 2])| {
            let sum: DVec2 = errors.iter().map(|it| it[class]).sum();
            sum * f64::from(without + with) / f64::from(with.max(1))
        };
        let sum: DVec2 = known.into_iter().enumerate().map(sum).sum();
        let error = sum / shown.len() as f64;
        let square = error.y.max(0.);
        let (rmse, bias) = ((error.x + square).sqrt(), square.sqrt());
        // State the error of each pixel
        let variance = |p: usize| filter.error(p, shown[p]).x as f32;
        let errors = filter.near(|p| filter.whole[p].map(|_| variance(p)));
        let errors = errors.map(|variance| (variance + square).sqrt());
        let means = shown.iter().map(|it| f64::from(0.5 * (it.x + it.y)));
        let (columns, rows) = film.window.size;
        let (errors, means) = (Some(errors.collect()), means.collect());
        let image = Image { errors, ..Image::plain(columns, rows, means) };
        Some(Self { image, error: PictureError { rmse, bias } })
    }
}
