// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The rows of a tally: what a receiver gets, sorted into columns.
//!
//! Sums are integers, so that neither the order of the samples nor their
//! division among threads and parts of a run changes a bit.
//!
//! ```
//! use litpt::film::{Contribution, Entry};
//!
//! // Two replicates of two samples: column 7 gets three of the four.
//! let mut rows = vec![vec![]];
//! for columns in [[7, 7], [7, 9]] {
//!     let samples = columns.map(|c| Contribution::new(0, c, 1.));
//!     Entry::append(&mut rows, samples.into(), 0);
//! }
//! let row = Entry::combined(rows.remove(0));
//! let columns: Vec<_> = row.iter().map(|entry| entry.column).collect();
//! assert_eq!(columns, [7, 9]);
//! assert_eq!(row[0].mean(4), 0.75);
//! assert_eq!(row[0].standard_error(2, 2), 0.25);
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::io::{self, Read, Write};

use crate::numerics::power_of_two;

/// What a sample adds to an entry of a tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Contribution {
    /// The pixel in its tile.
    pixel: u32,
    /// The column.
    column: u32,
    /// The weight in units of 2^-32.
    weight: i64,
}

/// The units of a weight of 1.
const UNITS: f64 = power_of_two(32);

impl Contribution {
    /// The contribution of a sample of a pixel; its weight is cut to a multiple
    /// of 2^-32.
    #[inline]
    pub fn new(pixel: u32, column: u32, weight: f64) -> Self {
        Self { pixel, column, weight: (weight * UNITS) as i64 }
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
    sum: i64,
    /// The sum of the squares of the replicates' sums; unknown, if it is the
    /// largest number.
    squares: u128,
}

impl Entry {
    /// Appends the sums of the samples of a replicate to the rows of their
    /// pixels, whose columns begin with this one.
    pub fn append(
        rows: &mut [Vec<Self>],
        mut samples: Vec<Contribution>,
        first: u32,
    ) {
        let place = |sample: &Contribution| (sample.pixel, sample.column);
        samples.sort_unstable();
        for same in samples.chunk_by(|a, b| place(a) == place(b)) {
            let (pixel, column) = place(&same[0]);
            let weights = same.iter().map(|sample| sample.weight);
            let sum = weights.fold(0, i64::saturating_add);
            let row = &mut rows[pixel as usize];
            row.push(Self::of_part(first + column, same.len() as u32, sum));
        }
    }

    /// The sum of so many samples of a replicate in a column.
    fn of_part(column: u32, count: u32, sum: i64) -> Self {
        let squares = u128::from(sum.unsigned_abs()).pow(2);
        Self { column, count, sum, squares }
    }

    /// The sums in the columns from `first` on of a replicate of so many
    /// samples, of which each has a part in all columns, given their means;
    /// without those that are 0.
    pub fn dense(first: u32, samples: u64, means: &[f64]) -> Vec<Self> {
        let part = |(column, mean): (u32, &f64)| {
            let sum = (mean * samples as f64 * UNITS) as i64;
            (sum != 0).then(|| Self::of_part(column, samples as u32, sum))
        };
        (first..).zip(means).filter_map(part).collect()
    }

    /// The entries in the order of their columns, one for each.
    pub fn combined(mut entries: Vec<Self>) -> Vec<Self> {
        entries.sort_by_key(|entry| entry.column);
        entries.dedup_by(|next, sum| {
            let is_same = next.column == sum.column;
            if is_same {
                sum.add(next);
            }
            is_same
        });
        entries.shrink_to_fit();
        entries
    }

    /// Adds the sums of other replicates.
    fn add(&mut self, more: &Self) {
        self.count = self.count.saturating_add(more.count);
        self.sum = self.sum.saturating_add(more.sum);
        self.squares = self.squares.saturating_add(more.squares);
    }

    /// Adds the entries of a row to another one.
    pub fn add_all(row: &mut Vec<Self>, more: &[Self]) {
        *row = Self::combined([row, more].concat());
    }

    /// The entries of a row whose parts have so many columns each, as those
    /// of one part.
    pub fn joined(row: &[Self], columns: u32) -> Vec<Self> {
        let of_part = |entry: &Self| Self {
            column: entry.column % columns,
            ..*entry
        };
        let entries = row.iter().map(of_part);
        if row.len() < columns as usize {
            return Self::combined(entries.collect());
        }
        // Add many entries without sorting them
        let mut sums = vec![None::<Self>; columns as usize];
        for entry in entries {
            match &mut sums[entry.column as usize] {
                Some(sum) => sum.add(&entry),
                none => *none = Some(entry),
            }
        }
        sums.into_iter().flatten().collect()
    }

    /// The mean weight over so many samples of the row.
    pub fn mean(&self, samples: u64) -> f64 {
        match self.sum {
            i64::MAX => f64::NAN,
            sum => sum as f64 / UNITS / samples as f64,
        }
    }

    /// The standard error of the mean over so many replicates of so many
    /// samples, at least that of one sample; infinite where it is unknown.
    pub fn standard_error(&self, replicates: u64, size: u64) -> f64 {
        let n = replicates as f64;
        let squares = self.squares.saturating_mul(replicates.into());
        if replicates < 2 || squares == u128::MAX {
            return f64::INFINITY;
        }
        let square = u128::from(self.sum.unsigned_abs()).pow(2);
        let difference = squares.saturating_sub(square);
        let variance = difference as f64 / (n * (n - 1.));
        let least = self.sum as f64 / f64::from(self.count.max(1)) / n;
        (variance / n).sqrt().max(least) / UNITS / size as f64
    }

    /// Writes the entries of a row.
    pub fn write(row: &[Self], out: &mut dyn Write) -> io::Result<()> {
        out.write_all(&(row.len() as u32).to_le_bytes())?;
        row.iter().try_for_each(|&Self { column, count, sum, squares }| {
            out.write_all(&[column, count].map(u32::to_le_bytes).concat())?;
            out.write_all(&sum.to_le_bytes())?;
            out.write_all(&squares.to_le_bytes())
        })
    }

    /// Reads a row that was written.
    pub fn read(from: &mut dyn Read) -> io::Result<Vec<Self>> {
        let mut count = [0; 4];
        from.read_exact(&mut count)?;
        let mut word = || {
            let mut bytes = [0; 16];
            let read = from.read_exact(&mut bytes);
            read.map(|()| u128::from_le_bytes(bytes))
        };
        let entry = |_| {
            let (head, squares) = (word()?, word()?);
            let [column, count] = [head as u32, (head >> 32) as u32];
            Ok(Self { column, count, sum: (head >> 64) as i64, squares })
        };
        (0..u32::from_le_bytes(count)).map(entry).collect()
    }
}
