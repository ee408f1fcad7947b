// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The rows of the cells of a cache: what they reflect of each patch of the
//! sky.
//!
//! Its bits belong to `GATHER_VERSION`.

use rayon::prelude::*;

use super::{Cells, DARKNESS, NO_GUIDE, PRIOR, RadianceCache, Record};

impl RadianceCache {
    /// Learns the rows of all cells from the records that it has sorted, of
    /// surfaces of this largest albedo.
    pub fn learn_rows(&mut self, records: &[Record], albedo: f32) {
        let cells = Cells::of(records);
        let entries = cells.names.iter().map(|&name| self.slot(name).0);
        let entries: Vec<usize> = entries.collect();
        let mut numbers = vec![NO_GUIDE; self.cells.len()];
        for (number, &entry) in (0..).zip(&entries) {
            numbers[entry] = number;
        }
        // Add up the records with the same end
        let end = |record: &Record| match record.to {
            DARKNESS.. => PATCH | (record.to >> 32) as u32,
            name => self.place(name).map_or(NO_GUIDE, |it| numbers[it]),
        };
        let terms = |c: usize| {
            let mut terms: Vec<(u32, f32)> = vec![];
            for record in &records[cells.records[c].clone()] {
                let end = end(record);
                let weight = albedo * record.weight * record.part();
                match terms.last_mut() {
                    Some(last) if last.0 == end => last.1 += weight,
                    _ => terms.push((end, weight)),
                }
            }
            terms.retain(|(end, _)| *end != NO_GUIDE);
            terms
        };
        let finest = cells.level(0).into_par_iter();
        let terms: Vec<_> = finest.map(terms).collect();
        // Solve the equations of some columns at a time
        let columns = self.columns;
        let firsts = (0..columns).into_par_iter().step_by(LANES);
        let parts = firsts.map(|first| cells.rows(&terms, first));
        let parts: Vec<_> = parts.collect();
        self.rows = vec![0.; columns * self.cells.len()];
        for (number, entry) in entries.into_iter().enumerate() {
            let row = &mut self.rows[columns * entry..][..columns];
            for (row, part) in row.chunks_mut(LANES).zip(&parts) {
                row.copy_from_slice(&part[number][..row.len()]);
            }
        }
    }

    /// The row of an entry of the table.
    #[inline]
    pub fn row(&self, entry: usize) -> &[f32] {
        &self.rows[self.columns * entry..][..self.columns]
    }

    /// Scales the row of each cell so that it adds up to the cell's radiance.
    pub fn scale_rows(&mut self) {
        let rows = self.rows.chunks_mut(self.columns.max(1));
        for (cell, row) in self.cells.iter().zip(rows) {
            let sum = row.iter().sum::<f32>();
            let scale = if sum > 0. { cell.value / sum } else { 1. };
            row.iter_mut().for_each(|value| *value *= scale);
        }
    }
}

/// Columns whose equations are solved together.
const LANES: usize = 32;

/// How often each equation is applied.
const ROUNDS: usize = 4;

/// The end of a record: a cell, or, with this bit, a patch of the sky.
const PATCH: u32 = 1 << 31;

impl Cells {
    /// Some columns, from `first` on, of the rows of all cells, given the
    /// terms of the equations of the finest.
    fn rows(
        &self,
        terms: &[Vec<(u32, f32)>],
        first: usize,
    ) -> Vec<[f32; LANES]> {
        let mut rows = vec![[0.; LANES]; self.names.len()];
        // Reflect what arrives from the sky
        let mut direct = rows.clone();
        for (sum, terms) in direct.iter_mut().zip(terms) {
            for (end, weight) in terms {
                let patch = (end ^ PATCH) as usize;
                if let Some(sum) = sum.get_mut(patch.wrapping_sub(first)) {
                    *sum += weight;
                }
            }
        }
        for _ in 0..ROUNDS {
            let mut sums = direct.clone();
            // Add what arrives from other cells
            for (c, terms) in terms.iter().enumerate() {
                let met = terms.iter().take_while(|(end, _)| *end < PATCH);
                let mut sum = sums[c];
                for &(end, weight) in met {
                    add(&mut sum, weight, &rows[end as usize]);
                }
                (sums[c], rows[c]) = (sum, self.mean(&rows, c, &sum));
            }
            for (c, &parent) in self.parents.iter().enumerate() {
                let sum = sums[c];
                add(&mut sums[parent as usize], 1., &sum);
            }
            for c in (0..rows.len()).rev() {
                rows[c] = self.mean(&rows, c, &sums[c]);
            }
        }
        rows
    }

    /// The row of a cell, given the sum over its records and the row of the
    /// coarser cell, which is a prior.
    fn mean(
        &self,
        rows: &[[f32; LANES]],
        c: usize,
        sum: &[f32; LANES],
    ) -> [f32; LANES] {
        let (mut row, mut count) = (*sum, self.count(c));
        if let Some(&parent) = self.parents.get(c) {
            add(&mut row, PRIOR, &rows[parent as usize]);
            count += PRIOR;
        }
        row.map(|sum| sum / count)
    }
}

/// Adds a multiple of a row to another.
fn add(sum: &mut [f32; LANES], weight: f32, row: &[f32; LANES]) {
    sum.iter_mut().zip(row).for_each(|(a, b)| *a += weight * b);
}
