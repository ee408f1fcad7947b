// Tangled from chapters/filter.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Pictures for looking: images that are filtered, with their own error.

mod fit;
mod look;

use std::array;

use glam::{DVec2, Vec2, Vec3A, Vec4, Vec4Swizzles};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::analysis::LitView;
use crate::bvh::{Bvh, GROUND};
use crate::film::{Film, Fragment, Fragments, HalfBuffers, UNIT};
use crate::image::Image;
use crate::sampler::within;
use fit::Fit;
pub use look::fragments;

/// The means of at most about 2^14 pixels of a film, evenly spread, whose
/// centres show a surface of the scene, and not the ground below it.
pub fn surface_means(bvh: &Bvh, view: &LitView, film: &Film) -> Vec<f64> {
    let ((left, top), (right, bottom)) =
        (film.window.corner, film.window.end());
    let step = (film.area() as f64 / 16384.).sqrt().ceil() as usize;
    let rows = (top..bottom).into_par_iter().step_by(step);
    let (columns, lines) = view.resolution;
    let centre = |i, n| within(i, n, 1 << 31);
    let pixels = rows.flat_map_iter(|y| {
        let shown = (left..right).step_by(step).filter(move |&x| {
            let (x, y) = (centre(x, columns), centre(y, lines));
            let (_, _, hit) = view.sensor.start(bvh, x, y);
            hit.is_some_and(|hit| hit.primitive < GROUND)
        });
        shown.map(move |x| film.pixel(x, y).mean())
    });
    pixels.collect()
}

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

/// What a pixel shows: one surface, several, or some and the sky.
const CLASSES: usize = 3;

/// The halves of an image while it is filtered.
struct Filter<'a> {
    shown: &'a Fragments,
    width: usize,
    /// The pixel of each fragment.
    pixels: Vec<u32>,
    /// What each pixel shows, if any surface.
    classes: Vec<Option<usize>>,
    /// The halves of each pixel as they are, if both have samples.
    whole: Vec<Option<Vec2>>,
}

impl<'a> Filter<'a> {
    /// Collects the halves of a film: a filter, and what was gathered and
    /// corrected for each fragment.
    fn new(
        film: &Film,
        shown: &'a Fragments,
    ) -> (Self, Vec<Halves>, Vec<Halves>) {
        let width = film.window.size.0 as usize;
        // Sort the halves of tiles by rows
        let mut sums = vec![HalfBuffers::default(); shown.all.len()];
        for (tile, halves) in film.tiles_of_halves() {
            let places = shown.pixels(tile).flat_map(|p| shown.range(p));
            places.zip(halves).for_each(|(f, halves)| sums[f] = *halves);
        }
        // Weigh each fragment by its coverage, if a half has samples
        let spp = film.samples() as f32 / 2.;
        let part = |(fragment, sums): (&Fragment, &HalfBuffers),
                    term: usize| {
            let count = Vec2::from(sums.map(|half| half[2] as f32));
            let sum = sums.map(|half| (half[term] as f64 / UNIT) as f32);
            let has = count.min(Vec2::ONE);
            let mean = Vec2::from(sum) / count.max(Vec2::ONE);
            Halves::new(mean, has * (spp * fragment.coverage))
        };
        let [gathered, corrected] = [0, 1].map(|term| {
            let all = shown.all.iter().zip(&sums);
            all.map(|it| part(it, term)).collect::<Vec<_>>()
        });
        // Describe the pixels
        let area = film.window.area();
        let all = || 0..area;
        let pixels =
            all().flat_map(|p| shown.range(p).map(move |_| p as u32));
        let mut filter = Self {
            shown,
            width,
            pixels: pixels.collect(),
            classes: all().map(|p| class(shown.of(p))).collect(),
            whole: vec![],
        };
        let halves = filter.compose(&gathered, &corrected).into_iter();
        let is_whole = |p: usize| {
            let mut own = shown.range(p);
            own.all(|f| gathered[f].is_whole())
        };
        let whole = halves.enumerate().map(|(p, halves)| {
            (filter.classes[p].is_some() && is_whole(p)).then_some(halves)
        });
        filter.whole = whole.collect();
        (filter, gathered, corrected)
    }
}

impl Filter<'_> {
    /// The halves of each pixel of which the fragments have these.
    fn compose(
        &self,
        gathered: &[Halves],
        corrected: &[Halves],
    ) -> Vec<Vec2> {
        let Fragments { all, sky, .. } = self.shown;
        let pixel = |p: usize| {
            self.shown.range(p).fold(Vec2::splat(sky[p]), |sum, f| {
                let mean = gathered[f].mean() + corrected[f].mean();
                sum + all[f].coverage * mean
            })
        };
        (0..sky.len()).into_par_iter().map(pixel).collect()
    }

    /// Estimates without bias of the variance of a pixel, and of the square
    /// of its bias, if its halves are `shown`; nothing if it is not known.
    fn error(&self, p: usize, shown: Vec2) -> DVec2 {
        let Some(whole) = self.whole[p] else { return DVec2::ZERO };
        let bias = (shown - whole).as_dvec2();
        let difference = f64::from(shown.x - shown.y);
        DVec2::new(0.25 * difference * difference, bias.x * bias.y)
    }
}

impl Filter<'_> {
    /// The sums of the errors of all pixels.
    fn errors(&self, shown: &[Vec2]) -> [DVec2; CLASSES] {
        let rows = shown.par_chunks(self.width).enumerate();
        let rows = rows.map(|(row, halves)| {
            let mut sums = [DVec2::ZERO; CLASSES];
            for (p, &halves) in (row * self.width..).zip(halves) {
                if let Some(class) = self.classes[p] {
                    sums[class] += self.error(p, halves);
                }
            }
            sums
        });
        let rows: Vec<[DVec2; CLASSES]> = rows.collect();
        array::from_fn(|class| rows.iter().map(|sums| sums[class]).sum())
    }
}

/// What a pixel of these fragments shows, if any surface.
fn class(own: &[Fragment]) -> Option<usize> {
    let covered: f32 = own.iter().map(|it| it.coverage).sum();
    match own.len() {
        0 => None,
        _ if covered < 0.999 => Some(2),
        n => Some(usize::from(n > 1)),
    }
}

impl Filter<'_> {
    /// Visits the fragments around one, `step` pixels apart and up to `reach`
    /// steps away, with the steps to each.
    #[inline(always)]
    fn around(
        &self,
        f: usize,
        (reach, step): (isize, isize),
        mut visit: impl FnMut(usize, isize, isize),
    ) {
        let (p, width) = (self.pixels[f] as isize, self.width as isize);
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

impl Filter<'_> {
    /// The means around each fragment, over those that continue its surface,
    /// or over all of them.
    fn smooth(
        &self,
        values: &[Halves],
        step: isize,
        over_all: bool,
    ) -> Vec<Halves> {
        let all = &self.shown.all;
        let mean = |f: usize| {
            let (mut sum, mut covered) = (Vec4::ZERO, 0.);
            self.around(f, (2, step), |g, i, j| {
                if over_all || f == g || all[f].is_like(&all[g]) {
                    let weight = |i: isize| [6., 4., 1.][i.unsigned_abs()];
                    let weight: f32 = weight(i) * weight(j);
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
    /// What a plane in place and normal gives that fits the fragments around
    /// each, drawn to those of all its surroundings where there are few samples.
    fn fit(
        &self,
        values: &[Halves],
        step: isize,
        prior: &[Halves],
    ) -> Vec<Halves> {
        let all = &self.shown.all;
        let fit = |f: usize| {
            let here = &all[f];
            let (across, along) = here.normal.any_orthonormal_pair();
            let mut sums = Fit::default();
            self.around(f, (3, step), |g, i, j| {
                let square = (i * i + j * j) as usize;
                let is_near = square < WINDOW.len() && values[g].is_whole();
                if is_near && (f == g || here.continues(&all[g])) {
                    let count = values[g].count().element_sum();
                    let turn = |axis: Vec3A| 3. * axis.dot(all[g].normal);
                    let [x, y] = [i, j].map(|i| i as f32 / 3.);
                    let terms = Vec4::new(x, y, turn(across), turn(along));
                    sums.add(
                        WINDOW[square] * count,
                        terms,
                        values[g].mean(),
                    );
                }
            });
            let seen = sums.weight * (step * step) as f32;
            let part = seen / (seen + PRIOR);
            let is_seen = sums.weight > 0.;
            let mean = if is_seen { sums.constant() } else { Vec2::ZERO };
            let mean = prior[f].mean().lerp(mean, part);
            Halves::new(mean, Vec2::ONE)
        };
        (0..values.len()).into_par_iter().map(fit).collect()
    }
}

/// What the surroundings count where a half has no sample.
const FEW: f32 = 1e-3;

/// The samples for which the surroundings of a fragment count.
const PRIOR: f32 = 5.;

/// The weights of a window by the square of the distance in steps.
const WINDOW: [f32; 10] = [
    1., 0.8007374, 0.6411804, 0., 0.4111123, 0.329193, 0., 0., 0.1690133,
    0.1353353,
];

impl Filter<'_> {
    /// Filters the corrections, over all surfaces, as widely as makes the
    /// error least.
    fn correct(
        &self,
        gathered: &[Halves],
        corrected: Vec<Halves>,
    ) -> Vec<Halves> {
        let judge = |corrected: &[Halves]| -> f64 {
            let errors = self.errors(&self.compose(gathered, corrected));
            errors.iter().map(|error| error.element_sum()).sum()
        };
        if corrected.iter().all(|it| it.0.xy() == Vec2::ZERO) {
            return corrected;
        }
        let (mut least, mut now) = (judge(&corrected), corrected.clone());
        let mut best = corrected;
        for level in 0..LEVELS {
            let next = self.smooth(&now, 1 << level, true);
            for part in [0.25, 0.5, 0.75, 1.] {
                let mixed = now.par_iter().zip(&next).map(|(a, b)| {
                    let part = if a.is_whole() { part } else { 1. };
                    Halves::new(a.mean().lerp(b.mean(), part), b.count())
                });
                let mixed: Vec<Halves> = mixed.collect();
                let error = judge(&mixed);
                if error < least {
                    (least, best) = (error, mixed);
                }
            }
            now = next;
        }
        best
    }
}

/// Rounds of means, each over twice the distance.
const LEVELS: usize = 5;

/// Rounds of which planes are fitted to what goes in.
const FITS: usize = 3;

impl Filter<'_> {
    /// The halves of the pixels, filtered in several ways.
    fn ways(
        &self,
        gathered: Vec<Halves>,
        corrected: &[Halves],
    ) -> Vec<Vec<Vec2>> {
        let mut now = gathered;
        let around = self.smooth(&now, 1, true);
        let around = self.smooth(&around, 2, true);
        for (halves, around) in now.iter_mut().zip(&around) {
            if !halves.is_whole() {
                *halves = Halves::new(around.mean(), Vec2::splat(FEW));
            }
        }
        let mut ways = vec![self.compose(&now, corrected)];
        for level in 0..LEVELS {
            if level < FITS {
                let fitted = self.fit(&now, 1 << level, &around);
                ways.push(self.compose(&fitted, corrected));
            }
            let next = self.smooth(&now, 1 << level, false);
            let before = self.compose(&now, corrected);
            let after = self.compose(&next, corrected);
            for part in [0.25, 0.5] {
                let mixed = before.iter().zip(&after);
                ways.push(mixed.map(|(a, b)| a.lerp(*b, part)).collect());
            }
            ways.push(after);
            now = next;
        }
        ways
    }
}

impl Filter<'_> {
    /// Chooses for each class of pixels in each block the way with the least
    /// error, and goes over from one block to the next.
    fn choose(&self, ways: &[Vec<Vec2>]) -> Vec<Vec2> {
        let area = self.classes.len();
        let grid = Grid::new(self.width, area / self.width);
        // Add up the errors of each way
        let errors = ways.par_iter().map(|shown| {
            let mut sums = vec![[0.; CLASSES]; grid.count()];
            for (p, &halves) in shown.iter().enumerate() {
                if let Some(class) = self.classes[p] {
                    let error = self.error(p, halves).element_sum();
                    sums[grid.block(p)][class] += error;
                }
            }
            sums
        });
        let errors: Vec<Vec<[f64; CLASSES]>> = errors.collect();
        // Choose a way for all blocks, and for each
        let least = |first: usize, error: &dyn Fn(usize) -> f64| {
            (0..ways.len()).fold(first, |best, way| {
                if error(way) < error(best) { way } else { best }
            })
        };
        let common: [usize; CLASSES] = array::from_fn(|class| {
            let sum = |way: usize| errors[way].iter().map(|it| it[class]);
            least(0, &|way| sum(way).sum::<f64>())
        });
        let picks = (0..grid.count()).map(|block| {
            array::from_fn(|class| {
                least(common[class], &|way| errors[way][block][class])
            })
        });
        let picks: Vec<[usize; CLASSES]> = picks.collect();
        let pixel = |p: usize| match self.classes[p] {
            None => ways[0][p],
            Some(class) => {
                let near = grid.near(p).into_iter();
                near.map(|(block, part)| {
                    part * ways[picks[block][class]][p]
                })
                .sum()
            }
        };
        (0..area).into_par_iter().map(pixel).collect()
    }
}

/// Blocks of about 80 by 80 pixels that choose their filter.
struct Grid {
    width: usize,
    blocks: [usize; 2],
    /// Blocks in a pixel, by column and row.
    scale: [f32; 2],
}

impl Grid {
    fn new(width: usize, height: usize) -> Self {
        let blocks = [width, height].map(|n| (n / 80).max(1));
        let scale = [
            blocks[0] as f32 / width as f32,
            blocks[1] as f32 / height as f32,
        ];
        Self { width, blocks, scale }
    }

    fn count(&self) -> usize {
        self.blocks[0] * self.blocks[1]
    }

    /// Where a pixel lies, in blocks.
    fn place(&self, p: usize) -> [f32; 2] {
        let place = [p % self.width, p / self.width];
        array::from_fn(|k| (place[k] as f32 + 0.5) * self.scale[k])
    }

    /// The block of a pixel.
    fn block(&self, p: usize) -> usize {
        let [x, y] = self.place(p).map(|at| at as usize);
        y * self.blocks[0] + x
    }

    /// The four blocks whose middles are around a pixel, and how much of each
    /// counts there.
    fn near(&self, p: usize) -> [(usize, f32); 4] {
        let [x, y] = self.place(p).map(|at| at - 0.5);
        array::from_fn(|k| {
            let side = |at: f32, far: bool, n: usize| {
                let (low, part) = (at.floor(), at - at.floor());
                let block = low + f32::from(far);
                let block = block.clamp(0., (n - 1) as f32) as usize;
                (block, if far { part } else { 1. - part })
            };
            let (column, across) = side(x, k % 2 == 1, self.blocks[0]);
            let (row, down) = side(y, k / 2 == 1, self.blocks[1]);
            (row * self.blocks[0] + column, across * down)
        })
    }
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

impl Filtered {
    /// Filters the image on a film; none if it has no fragments, a half of a
    /// tile has no samples, or no pixel has samples of all that it shows.
    pub fn of(film: &Film) -> Option<Self> {
        let shown = film.fragments.as_deref()?;
        if film.samples() < 2 * film.net_size {
            return None;
        }
        let (filter, gathered, corrected) = Filter::new(film, shown);
        if filter.whole.iter().all(Option::is_none) {
            return None;
        }
        let corrected = filter.correct(&gathered, corrected);
        let ways = filter.ways(gathered, &corrected);
        let shown = filter.choose(&ways);
        drop(ways);
        // Find the error of the image
        let mut known = [[0; 2]; CLASSES];
        for (class, whole) in filter.classes.iter().zip(&filter.whole) {
            if let &Some(class) = class {
                known[class][usize::from(whole.is_some())] += 1;
            }
        }
        let sums = filter.errors(&shown).into_iter().zip(known);
        let sums = sums.map(|(sum, [without, with])| {
            sum * f64::from(without + with) / f64::from(with.max(1))
        });
        let error = sums.sum::<DVec2>() / shown.len() as f64;
        let square = error.y.max(0.);
        let (rmse, bias) = ((error.x + square).sqrt(), square.sqrt());
        // State the error of each pixel
        let variances = filter.pixels.iter().map(|&p| {
            let p = p as usize;
            let variance = filter.error(p, shown[p]).x as f32;
            let count = f32::from(filter.whole[p].is_some());
            Halves::new(Vec2::splat(variance), Vec2::splat(count))
        });
        let mut variances: Vec<Halves> = variances.collect();
        for level in 0..3 {
            variances = filter.smooth(&variances, 1 << level, true);
        }
        let variance = |p| {
            let own = &variances[filter.shown.range(p)];
            let sum: f32 = own.iter().map(|it| it.mean().x).sum();
            f64::from(sum) / own.len().max(1) as f64
        };
        let errors =
            (0..shown.len()).map(|p| (variance(p) + square).sqrt());
        let means = shown.iter().map(|it| f64::from(0.5 * (it.x + it.y)));
        let (columns, rows) = film.window.size;
        let (errors, means) = (Some(errors.collect()), means.collect());
        let image = Image { errors, ..Image::plain(columns, rows, means) };
        Some(Self { image, error: PictureError { rmse, bias } })
    }
}
