// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The nearest view factors that are reciprocal and closed.
//!
//! Least squares under linear constraints, each entry weighted by one over
//! its variance (after Daun, Morton and Howell 2005).
//!
//! ```
//! use litpt::matrix::closed::Closed;
//!
//! // Two faces see each other and the sky.
//! let rows = [
//!     vec![(1, 0.30, 0.01), (2, 0.69, 0.01)],
//!     vec![(0, 0.14, 0.01), (2, 0.86, 0.01)],
//! ];
//! let row = |i: usize| Some(rows[i].clone());
//! let closed = Closed::new(&[1., 2.], &row, &|_| 1000)?;
//! let [a, b] = [0, 1].map(|i| closed.row(i).unwrap());
//! assert!((a[0].1 + a[1].1 - 1.).abs() < 1e-12);
//! assert!((a[0].1 - 2. * b[0].1).abs() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::error::Result;

/// An entry of a row: its column, its value and its standard error.
pub type Cell = (u32, f64, f64);

/// View factors that are reciprocal and closed.
pub struct Closed {
    /// The area of each face; 0 of one without values of its own.
    areas: Vec<f64>,
    /// For each face its pairs with itself, with later ones, and with what
    /// is beyond, by their columns.
    pairs: Vec<Vec<Pair>>,
    /// For each face its pairs with earlier ones: their row and place there.
    before: Vec<Vec<(u32, u32)>>,
    /// By how many standard errors entries have moved: at most, and in the
    /// mean.
    pub moves: [f64; 2],
}

/// What a face exchanges with another, or with what is beyond: an area times
/// a view factor.
#[derive(Clone, Copy)]
struct Pair {
    /// The column.
    column: u32,
    /// The mean of what both sides have found, and its variance.
    found: f64,
    variance: f64,
    /// The nearest value.
    value: f64,
}

/// The rows as they were sampled.
type Rows<'a> = &'a dyn Fn(usize) -> Option<Vec<Cell>>;

impl Closed {
    /// Closes the view factors of faces of these areas, given their rows as
    /// they were sampled, and the number of samples of each.
    ///
    /// # Errors
    /// The factors of some faces contradict those of others.
    pub fn new(
        areas: &[f64],
        row: Rows,
        samples: &dyn Fn(usize) -> u64,
    ) -> Result<Self> {
        let n = areas.len();
        let least: Vec<f64> =
            (0..n).map(|i| areas[i] / samples(i) as f64).collect();
        let found = exchanges(areas, row);
        let pairs = found.into_iter().enumerate().map(|(i, mut cells)| {
            cells.sort_by_key(|cell| cell.0);
            let both = cells.chunk_by(|a, b| a.0 == b.0);
            both.map(|cells| pair(i, cells, &least)).collect()
        });
        let pairs: Vec<Vec<Pair>> = pairs.collect();
        // List the pairs with earlier faces
        let mut before = vec![vec![]; n];
        for (i, row) in pairs.iter().enumerate() {
            for (k, pair) in row.iter().enumerate() {
                let j = pair.column as usize;
                if i < j && j < n {
                    before[j].push((i as u32, k as u32));
                }
            }
        }
        // Solve for the nearest values
        let own = |i: usize| if samples(i) > 0 { areas[i] } else { 0. };
        let areas = (0..n).map(own).collect();
        let mut closed = Self { areas, pairs, before, moves: [0.; 2] };
        closed.solve()?;
        closed.moves = closed.compare(row);
        Ok(closed)
    }

    /// The other face of a pair of face `i`, if it is a later one.
    fn later(&self, i: usize, pair: &Pair) -> Option<usize> {
        let j = pair.column as usize;
        (i < j && j < self.areas.len()).then_some(j)
    }

    /// Sums over each face's pairs a function of a pair and of two faces' sum
    /// of some values; only of faces that have values of their own.
    fn sums(&self, at: &[f64], of: impl Fn(&Pair, f64) -> f64) -> Vec<f64> {
        let mut sums = vec![0.; at.len()];
        for (i, row) in self.pairs.iter().enumerate() {
            for pair in row {
                let later = self.later(i, pair);
                let term = of(pair, at[i] + later.map_or(0., |j| at[j]));
                sums[i] += term;
                if let Some(j) = later {
                    sums[j] += term;
                }
            }
        }
        let parts = sums.iter().zip(&self.areas);
        parts.map(|(s, &area)| if area > 0. { *s } else { 0. }).collect()
    }

    /// Finds the values by Newton's method for the multipliers of the sums.
    fn solve(&mut self) -> Result<()> {
        let value =
            |p: &Pair, push: f64| (p.found + p.variance * push).max(0.);
        let mut multipliers = vec![0.; self.areas.len()];
        for _ in 0..NEWTON_STEPS {
            let sums = self.sums(&multipliers, value);
            let missing: Vec<f64> =
                self.areas.iter().zip(&sums).map(|(a, s)| a - s).collect();
            // Set the values of all pairs
            for i in 0..self.pairs.len() {
                for k in 0..self.pairs[i].len() {
                    let later = self.later(i, &self.pairs[i][k]);
                    let other = later.map_or(0., |j| multipliers[j]);
                    let pair = &mut self.pairs[i][k];
                    pair.value = value(pair, multipliers[i] + other);
                }
            }
            // Return if the sums are right
            let mut errors = missing.iter().zip(&self.areas);
            if errors.all(|(m, area)| m.abs() <= CLOSED * area) {
                return Ok(());
            }
            // Move the multipliers
            for (m, step) in multipliers.iter_mut().zip(self.step(&missing))
            {
                *m += step;
            }
        }
        Err("the view factors cannot be closed: those of some faces \
             contradict each other"
            .into())
    }

    /// The change of the multipliers that adds what is missing in the sums,
    /// by conjugate gradients.
    fn step(&self, missing: &[f64]) -> Vec<f64> {
        let slope = |p: &Pair| if p.value > 0. { p.variance } else { 0. };
        let ones = vec![1.; missing.len()];
        let scale = self.sums(&ones, |p, _| slope(p));
        let divided = |rest: &[f64]| -> Vec<f64> {
            let part =
                |(r, s): (&f64, &f64)| if *s > 0. { r / s } else { 0. };
            rest.iter().zip(&scale).map(part).collect()
        };
        let mut step = vec![0.; missing.len()];
        let mut rest = missing.to_vec();
        let mut search = divided(&rest);
        let mut square = dot(&rest, &search);
        let end = 1e-30 * square;
        for _ in 0..GRADIENT_STEPS {
            // Move along the search direction
            let image = self.sums(&search, |p, change| slope(p) * change);
            let length = square / dot(&search, &image);
            if square <= end || !length.is_finite() {
                break;
            }
            add(&mut step, length, &search);
            add(&mut rest, -length, &image);
            let near = divided(&rest);
            let next = dot(&rest, &near);
            let old = search.iter().map(|s| next / square * s);
            search = near.iter().zip(old).map(|(z, s)| z + s).collect();
            square = next;
        }
        step
    }

    /// The entries of a row that are not zero; none if it has no values.
    pub fn row(&self, i: usize) -> Option<Vec<Cell>> {
        let area = self.areas[i];
        let cell = |column, pair: &Pair| {
            (column, pair.value / area, pair.variance.sqrt() / area)
        };
        let before = self.before[i].iter();
        let before = before
            .map(|&(j, k)| cell(j, &self.pairs[j as usize][k as usize]));
        let after = self.pairs[i].iter().map(|p| cell(p.column, p));
        let cells = before.chain(after).filter(|cell| cell.1 > 0.);
        (area > 0.).then(|| cells.collect())
    }

    /// By how many errors the entries differ from those that were sampled: at
    /// most, and in the mean.
    fn compare(&self, row: Rows) -> [f64; 2] {
        let (mut most, mut sum, mut count) = (0f64, 0., 0.);
        for i in 0..self.areas.len() {
            let closed = self.row(i).unwrap_or_default();
            for (column, mean, error) in row(i).into_iter().flatten() {
                let at =
                    closed.binary_search_by_key(&column, |cell| cell.0);
                let own = at.map_or(0., |at| closed[at].1);
                let moved = (own - mean).abs() / error;
                (most, sum, count) =
                    (most.max(moved), sum + moved, count + 1.);
            }
        }
        [most, sum / f64::max(count, 1.)]
    }
}

/// The part of an area by which a sum may be wrong.
const CLOSED: f64 = 1e-13;

/// The most steps of both iterations.
const NEWTON_STEPS: u32 = 100;
const GRADIENT_STEPS: u32 = 1000;

/// For each face what it exchanges with itself, later ones and what is beyond:
/// a column, a value, and a weight, one over its variance.
fn exchanges(areas: &[f64], row: Rows) -> Vec<Vec<(u32, f64, f64)>> {
    let mut found = vec![vec![]; areas.len()];
    for (i, area) in areas.iter().enumerate() {
        for (column, mean, error) in row(i).into_iter().flatten() {
            let weight = (area * error).powi(-2);
            let (first, other) = match column as usize {
                j if j < i => (j, i as u32),
                _ => (i, column),
            };
            found[first].push((other, area * mean, weight));
        }
    }
    found
}

/// The pair of a face with the column that one side has found, or both. A
/// side that has found nothing counts as 0 with the error of one sample.
fn pair(i: usize, cells: &[(u32, f64, f64)], least: &[f64]) -> Pair {
    let column = cells[0].0;
    let sum: f64 = cells.iter().map(|(_, value, w)| w * value).sum();
    let mut weight: f64 = cells.iter().map(|(.., w)| w).sum();
    let other = least.get(column as usize).filter(|x| x.is_finite());
    if let Some(other) = other.filter(|_| column as usize != i)
        && cells.len() == 1
        && least[i].is_finite()
    {
        weight += least[i].max(*other).powi(-2);
    }
    let (found, variance) = (sum / weight, 1. / weight);
    Pair { column, found, variance, value: found }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Adds a multiple of a vector to another.
fn add(sum: &mut [f64], factor: f64, vector: &[f64]) {
    for (sum, term) in sum.iter_mut().zip(vector) {
        *sum += factor * term;
    }
}
