// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The nearest view factors that are reciprocal and closed.
//!
//! Least squares under linear constraints, each exchange weighted by one over
//! its variance (after Daun, Morton and Howell 2005).

use crate::error::Result;

/// An entry of a row: its column, its value and its standard error.
pub type Cell = (u32, f64, f64);

/// View factors that are reciprocal and closed.
pub struct Closed {
    /// The entries of each row that are not zero; none if it has no values.
    rows: Vec<Option<Vec<Cell>>>,
    /// By how many standard errors entries have moved: at most, and in the
    /// mean.
    pub moves: [f64; 2],
}

/// The rows as they were sampled.
type Rows<'a> = &'a dyn Fn(usize) -> Option<Vec<Cell>>;

/// What a face exchanges with another, or with what is beyond: an area times
/// a view factor.
struct Pair {
    /// The face and the other, which is later, or else none: the number after
    /// the last face.
    faces: [u32; 2],
    /// The column of the other.
    column: u32,
    /// The mean of what both sides have found, and its variance.
    found: f64,
    variance: f64,
    /// The nearest value.
    value: f64,
}

impl Pair {
    /// The sum of a value of both faces.
    fn sum(&self, values: &[f64]) -> f64 {
        let [i, j] = self.faces;
        values[i as usize] + values[j as usize]
    }
}

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
        let mut pairs = pairs(areas, row, samples);
        // No sum is closed of a face without samples, or of no face
        let own = |(i, &area)| if samples(i) > 0 { area } else { 0. };
        let areas = areas.iter().enumerate().map(own).chain([0.]);
        let areas: Vec<f64> = areas.collect();
        solve(&mut pairs, &areas)?;
        // List the entries of each row that are not zero
        let row_of = |area: &f64| (*area > 0.).then(Vec::new);
        let mut rows: Vec<_> = areas.iter().map(row_of).collect();
        for pair in pairs.iter().filter(|pair| pair.value > 0.) {
            let [i, j] = pair.faces.map(|face| face as usize);
            for (i, column) in [(i, pair.column), (j, i as u32)] {
                if let Some(row) = &mut rows[i] {
                    let factor = pair.value / areas[i];
                    let rest = (1. - factor).max(0.);
                    let error = (pair.variance * rest).sqrt() / areas[i];
                    row.push((column, factor, error));
                }
            }
        }
        // Compare them with those that were sampled
        let (mut most, mut sum, mut count) = (0f64, 0., 0.);
        for (i, closed) in rows.iter().enumerate() {
            let Some(closed) = closed else { continue };
            for (column, mean, error) in row(i).into_iter().flatten() {
                let at = closed.binary_search_by_key(&column, |c| c.0);
                let own = at.map_or(0., |at| closed[at].1);
                let moved = (own - mean).abs() / error;
                (most, sum, count) =
                    (most.max(moved), sum + moved, count + 1.);
            }
        }
        let moves = [most, sum / f64::max(count, 1.)];
        Ok(Self { rows, moves })
    }

    /// The entries of a row that are not zero; none if it has no values.
    pub fn row(&self, i: usize) -> Option<Vec<Cell>> {
        self.rows[i].clone()
    }
}

/// The pairs of each face with itself, with later ones and with what is
/// beyond.
fn pairs(
    areas: &[f64],
    row: Rows,
    samples: &dyn Fn(usize) -> u64,
) -> Vec<Pair> {
    // Collect what both sides have found, and the variances of all
    let n = areas.len();
    let weight = |face: usize| match areas.get(face) {
        Some(area) if *area > 0. => samples(face) as f64 / area,
        _ => 0.,
    };
    let (mut found, mut squares, mut usual) = (vec![vec![]; n], 0., 0.);
    for (i, area) in areas.iter().enumerate() {
        for (column, mean, error) in row(i).into_iter().flatten() {
            let (j, exchange) = (column as usize, area * mean);
            found[i.min(j)].push((i.max(j), weight(i) * exchange));
            squares += (area * error).powi(2);
            usual += exchange * (1. - mean) / weight(i);
        }
    }
    // Average it
    let gain = Some(squares / usual).filter(|gain| gain.is_normal());
    let mut pairs = vec![];
    for (i, mut cells) in found.into_iter().enumerate() {
        cells.sort_by_key(|cell| cell.0);
        for both in cells.chunk_by(|a, b| a.0 == b.0) {
            let column = both[0].0;
            let j = if i < column && column < n { column } else { n };
            let sum: f64 = both.iter().map(|(_, value)| value).sum();
            let weight = weight(i) + weight(j);
            let found = sum / weight;
            let variance = gain.unwrap_or(1.) * found / weight;
            let (faces, column) = ([i as u32, j as u32], column as u32);
            pairs.push(Pair { faces, column, found, variance, value: 0. });
        }
    }
    pairs
}

/// The part of an area by which a sum may be wrong.
const CLOSED: f64 = 1e-13;

/// The most steps of the iteration.
const STEPS: u32 = 10_000;

/// Finds the values by conjugate gradients for the multipliers of the sums.
fn solve(pairs: &mut [Pair], areas: &[f64]) -> Result<()> {
    let mut multipliers = vec![0.; areas.len()];
    let (mut search, mut before) = (multipliers.clone(), areas.to_vec());
    let mut square = f64::INFINITY;
    let scale = sums(pairs, areas, |pair| pair.variance);
    for _ in 0..STEPS {
        for pair in &mut *pairs {
            let push = pair.variance * pair.sum(&multipliers);
            pair.value = (pair.found + push).max(0.);
        }
        let mut missing = areas.to_vec();
        add(&mut missing, -1., &sums(pairs, areas, |pair| pair.value));
        let mut errors = missing.iter().zip(areas);
        if errors.all(|(m, area)| m.abs() <= CLOSED * area) {
            return Ok(());
        }
        // Move along the search direction
        let parts = missing.iter().zip(&scale);
        let part = |(m, s): (&f64, &f64)| if *s > 0. { m / s } else { 0. };
        let mut near: Vec<f64> = parts.map(part).collect();
        let next = dot(&missing, &near);
        let keep = (next - dot(&before, &near)) / square;
        add(&mut near, keep.max(0.), &search);
        (search, before, square) = (near, missing, next);
        let change = |pair: &Pair| match pair.value > 0. {
            true => pair.variance * pair.sum(&search),
            false => 0.,
        };
        let curvature = dot(&search, &sums(pairs, areas, change));
        let length = dot(&before, &search) / curvature;
        add(&mut multipliers, length, &search);
    }
    Err("the view factors cannot be closed: there are too few samples, or \
         those of some faces contradict each other"
        .into())
}

/// The sums over the pairs of each face that has an area.
fn sums(
    pairs: &[Pair],
    areas: &[f64],
    of: impl Fn(&Pair) -> f64,
) -> Vec<f64> {
    let mut sums = vec![0.; areas.len()];
    for pair in pairs {
        let term = of(pair);
        pair.faces.iter().for_each(|&i| sums[i as usize] += term);
    }
    let has_area = sums.into_iter().zip(areas);
    has_area.map(|(s, &area)| if area > 0. { s } else { 0. }).collect()
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
