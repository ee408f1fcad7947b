// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The rows of a tally: what a receiver gets, sorted into columns.
//!
//! Sums are integers, so that neither the order of the samples nor their
//! division among threads and parts of a run changes a bit.
//!
//! ```
//! use litpt::film::{Entry, Contribution};
//!
//! // Two replicates of two samples: column 7 gets three of the four.
//! let mut row = vec![];
//! for contributions in [[7, 7], [7, 9]] {
//!     let new = |c| Contribution::new(0, c, 1.);
//!     let mut sums = Contribution::sums(contributions.map(new));
//!     Entry::add_all(&mut row, &Entry::rows(&mut sums, 1)[0]);
//! }
//! let columns: Vec<_> = row.iter().map(|entry| entry.column).collect();
//! assert_eq!(columns, [7, 9]);
//! assert_eq!(row[0].mean(4), 0.75);
//! assert_eq!(row[0].standard_error(2, 2), 0.25);
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::io::{self, Read, Write};

use crate::numerics::power_of_two;

/// What one sample, or one replicate, adds to an entry of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Contribution {
    /// The pixel in its tile.
    pixel: u32,
    /// The column.
    column: u32,
    /// The weight in units of 2^-32.
    weight: u64,
    /// The number of samples.
    count: u32,
}

/// The units of a weight of 1.
const UNITS: f64 = power_of_two(32);

impl Contribution {
    /// The contribution of a sample of a pixel; its weight is cut to a multiple of
    /// 2^-32.
    #[inline]
    pub fn new(pixel: u32, column: u32, weight: f64) -> Self {
        let weight = (weight * UNITS) as u64;
        Self { pixel, column, weight, count: 1 }
    }

    /// The same contribution to the row's part `k`, if each has so many
    /// columns.
    pub fn in_part(self, k: u64, columns: u32) -> Self {
        Self { column: self.column + k as u32 * columns, ..self }
    }

    /// The contributions of a replicate: sorted, and one for each entry.
    pub fn sums(samples: impl Into<Vec<Self>>) -> Vec<Self> {
        let mut contributions = samples.into();
        contributions.sort_unstable();
        contributions.dedup_by(|next, sum| {
            let is_same = next.place() == sum.place();
            if is_same {
                sum.weight = sum.weight.saturating_add(next.weight);
                sum.count = sum.count.saturating_add(next.count);
            }
            is_same
        });
        contributions
    }

    fn place(&self) -> (u32, u32) {
        (self.pixel, self.column)
    }
}

/// The sums of the replicates' weights in one column of a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Entry {
    /// The number of the column.
    pub column: u32,
    /// The number of its samples.
    count: u32,
    /// The sum in units of 2^-32; no sum, if it is the largest number.
    sum: u64,
    /// The sum of the squares of the replicates' sums; unknown, if it is the
    /// largest number.
    squares: u128,
}

impl Entry {
    /// The rows of so many pixels, from the sums of replicates.
    pub fn rows(
        sums: &mut [Contribution],
        pixels: usize,
    ) -> Vec<Vec<Self>> {
        let mut rows = vec![vec![]; pixels];
        sums.sort_unstable();
        for contributions in sums.chunk_by(|a, b| a.place() == b.place()) {
            let (pixel, column) = contributions[0].place();
            let mut entry = Self { column, ..Self::default() };
            for &Contribution { weight: sum, count, .. } in contributions {
                let squares = u128::from(sum).pow(2);
                entry.merge(&Self { column, count, sum, squares });
            }
            rows[pixel as usize].push(entry);
        }
        rows
    }

    fn merge(&mut self, more: &Self) {
        self.count = self.count.saturating_add(more.count);
        self.sum = self.sum.saturating_add(more.sum);
        self.squares = self.squares.saturating_add(more.squares);
    }

    /// Adds the entries of a row to another one; both are sorted by columns.
    pub fn add_all(row: &mut Vec<Self>, more: &[Self]) {
        let mut place = 0;
        let is_new = |entry: &&Self| {
            let rest = &row[place..];
            place += rest.partition_point(|e| e.column < entry.column);
            row.get(place).is_none_or(|e| e.column != entry.column)
        };
        let new = more.iter().filter(is_new).count();
        // Merge from the last entry on
        let mut kept = row.len();
        row.resize(kept + new, Self::default());
        let mut end = row.len();
        for entry in more.iter().rev() {
            while kept > 0 && row[kept - 1].column > entry.column {
                (end, kept) = (end - 1, kept - 1);
                row[end] = row[kept];
            }
            end -= 1;
            if kept > 0 && row[kept - 1].column == entry.column {
                kept -= 1;
                row[end] = row[kept];
                row[end].merge(entry);
            } else {
                row[end] = *entry;
            }
        }
    }

    /// The entries of a row whose parts have so many columns each, as those
    /// of one part.
    pub fn joined(row: &[Self], columns: u32) -> Vec<Self> {
        let of_part = |entry: &Self| Self {
            column: entry.column % columns,
            ..*entry
        };
        let mut joined: Vec<Self> = row.iter().map(of_part).collect();
        joined.sort_by_key(|entry| entry.column);
        joined.dedup_by(|next, sum| {
            let is_same = next.column == sum.column;
            if is_same {
                sum.merge(next);
            }
            is_same
        });
        joined
    }

    /// The mean weight over so many samples of the row.
    pub fn mean(&self, samples: u64) -> f64 {
        match self.sum {
            u64::MAX => f64::NAN,
            sum => sum as f64 / UNITS / samples as f64,
        }
    }

    /// The standard error of the mean over so many replicates of so many
    /// samples, at least that of one sample; infinite where it is unknown.
    pub fn standard_error(&self, replicates: u64, size: u64) -> f64 {
        let n = u128::from(replicates);
        let squares = self.squares.checked_mul(n).filter(|_| n > 1);
        let square = u128::from(self.sum).pow(2);
        let Some(difference) = squares.map(|s| s.saturating_sub(square))
        else {
            return f64::INFINITY;
        };
        let n = replicates as f64;
        let variance = difference as f64 / (n * (n - 1.));
        let least = self.sum as f64 / f64::from(self.count.max(1)) / n;
        (variance / n).sqrt().max(least) / UNITS / size as f64
    }

    /// Writes the entries of a row.
    pub fn write(row: &[Self], out: &mut dyn Write) -> io::Result<()> {
        out.write_all(&(row.len() as u32).to_le_bytes())?;
        row.iter().try_for_each(|entry| {
            out.write_all(&entry.column.to_le_bytes())?;
            out.write_all(&entry.count.to_le_bytes())?;

            out.write_all(&entry.sum.to_le_bytes())?;
            out.write_all(&entry.squares.to_le_bytes())
        })
    }

    /// Reads a row that was written.
    pub fn read(from: &mut dyn Read) -> io::Result<Vec<Self>> {
        let (mut four, mut eight, mut sixteen) = ([0; 4], [0; 8], [0; 16]);
        from.read_exact(&mut four)?;
        let count = u32::from_le_bytes(four);
        let mut row = vec![];
        for _ in 0..count {
            from.read_exact(&mut four)?;
            let column = u32::from_le_bytes(four);
            from.read_exact(&mut four)?;
            let count = u32::from_le_bytes(four);
            from.read_exact(&mut eight)?;
            from.read_exact(&mut sixteen)?;
            let sum = u64::from_le_bytes(eight);
            let squares = u128::from_le_bytes(sixteen);
            row.push(Self { column, count, sum, squares });
        }
        Ok(row)
    }
}
