// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Daylight through a year: coefficients times the radiances of a sky, and
//! what follows from them, with errors.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::num::NonZero;
use std::str;

use rand::RngExt;
use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::film::Film;
use crate::sampler::generator;
use crate::scene::encoding;
use crate::sky::PACKED;
use crate::tally::REPLICATES;

/// The radiances of a sky, as gendaymtx writes them.
pub struct SkyMatrix {
    /// The number of patches, with the ground.
    pub patches: usize,
    /// The number of time steps.
    pub steps: usize,
    /// For each patch and step the radiance, as its luminous part in units
    /// of 179 lm/W.
    values: Vec<f32>,
}

/// Lumens of a watt, by Radiance's convention.
const EFFICACY: f64 = 179.;

/// The luminous parts of a red, a green and a blue radiance.
const LUMINOUS: [f64; 3] = [0.265, 0.670, 0.065];

impl SkyMatrix {
    /// Reads a matrix of Radiance, of text or of little-endian numbers.
    ///
    /// # Errors
    /// It is none, it holds solar radiances (`-O1`), or it ends too soon.
    pub fn read(bytes: &[u8]) -> Result<Self> {
        if encoding::format(bytes).is_some() {
            return Err(PACKED.into());
        }
        let mut end = 0;
        for line in bytes.split_inclusive(|byte| *byte == b'\n') {
            end += line.len();
            if line.trim_ascii().is_empty() {
                break;
            }
        }
        let (header, body) = bytes.split_at(end);
        let header = String::from_utf8_lossy(header);
        // Reject solar radiances
        let is_solar = |line: &str| {
            let mut words = line.split_whitespace();
            line.contains("gendaymtx") && words.any(|word| word == "-O1")
        };
        if header.lines().any(is_solar) {
            return Err("its radiances are solar, of gendaymtx -O1; \
                        illuminance needs those of -O0"
                .into());
        }
        // Find the size and the format
        let entries =
            header.lines().filter_map(|line| line.split_once('='));
        let entries: BTreeMap<_, _> =
            entries.map(|(name, value)| (name, value.trim())).collect();
        let entry = |name| entries.get(name).copied().unwrap_or("none");
        let size = |name| -> Result<usize> {
            let size = entry(name).parse().map(NonZero::get);
            let fault =
                format!("no matrix of Radiance: {name} is {}", entry(name));
            size.map_err(|_| fault.into())
        };
        let (patches, steps) = (size("NROWS")?, size("NCOLS")?);
        for (name, usual) in [("NCOMP", "3"), ("BigEndian", "0")] {
            if ![usual, "none"].contains(&entry(name)) {
                let fault =
                    format!("its {name} is {}, not {usual}", entry(name));
                return Err(fault.into());
            }
        }
        // Read the numbers
        let numbers = match entry("FORMAT") {
            "ascii" => text(body)?,
            "float" => binary(body, f32::from_le_bytes)?,
            "double" => binary(body, f64::from_le_bytes)?,
            other => {
                let fault = format!(
                    "its FORMAT is {other}, not ascii, float or double"
                );
                return Err(fault.into());
            }
        };
        let count = patches.saturating_mul(steps).saturating_mul(3);
        if numbers.len() != count {
            let fault = format!(
                "it has {} numbers, not {patches} x {steps} x 3",
                numbers.len()
            );
            return Err(fault.into());
        }
        let is_odd = |x: &f64| !((*x as f32).is_finite() && *x >= 0.);
        if let Some(at) = numbers.iter().position(is_odd) {
            let (patch, column) = (at / 3 / steps, at / 3 % steps + 1);
            let fault = format!(
                "its radiance of patch {patch} in column {column} is {}",
                numbers[at]
            );
            return Err(fault.into());
        }
        // Keep the luminous part of each radiance
        let luminous = |rgb: &[f64; 3]| {
            let parts = rgb.iter().zip(LUMINOUS).map(|(a, b)| a * b);
            parts.sum::<f64>() as f32
        };
        let values = numbers.as_chunks().0.iter().map(luminous).collect();
        Ok(Self { patches, steps, values })
    }

    /// The radiances of a column, from 1, if there is one.
    pub fn column(&self, column: u32) -> Option<Vec<f64>> {
        let at = (column as usize).checked_sub(1)?;
        let rows = self.values.chunks(self.steps);
        rows.map(|row| row.get(at).copied().map(f64::from)).collect()
    }
}

/// Numbers around blanks.
fn text(body: &[u8]) -> Result<Vec<f64>> {
    let text = str::from_utf8(body).map_err(|_| "it is no text")?;
    let number = |word: &str| {
        let fault = || Error::from(format!("'{word}' is no number"));
        word.parse().map_err(|_| fault())
    };
    text.split_ascii_whitespace().map(number).collect()
}

/// Numbers of N bytes each.
fn binary<const N: usize, T: Into<f64>>(
    body: &[u8],
    number: fn([u8; N]) -> T,
) -> Result<Vec<f64>> {
    match body.as_chunks() {
        (numbers, []) => {
            let numbers = numbers.iter();
            Ok(numbers.map(|bytes| number(*bytes).into()).collect())
        }
        _ => Err("it ends within a number".into()),
    }
}

/// The daylight coefficients of sensors, with their replicates.
pub struct Daylight<'a> {
    /// The sums.
    pub film: &'a Film,
    /// The row of each sensor on the film, if it has one.
    pub rows: &'a [Option<u32>],
    /// The number of columns.
    pub columns: u32,
}

/// A replicate of the coefficients of a sensor: its part of all samples, and
/// the irradiance for a radiance of 1 of each patch.
type Replicate = (f64, Vec<f64>);

impl Daylight<'_> {
    /// Where the film has the sums of a sensor, if it has a value.
    fn place(&self, sensor: usize) -> Option<usize> {
        let Self { film, rows, .. } = self;
        let (top, end) = (film.window.corner.1, film.window.end().1);
        let y = rows[sensor].filter(|y| (top..end).contains(y))?;
        Some(film.at(0, y))
    }

    /// The replicates of a sensor, in order; none if it has no value.
    pub fn replicates(&self, sensor: usize) -> Option<Vec<Replicate>> {
        let &Self { film, columns, .. } = self;
        let at = self.place(sensor)?;
        let (size, n) = (film.net_size, film.pixels[at].count());
        let first = film.sample_offset / size;
        let part = |k| {
            let samples =
                (first..first + n).filter(|i| i % REPLICATES == k);
            samples.count() as f64 / n as f64
        };
        let replicate = |k| (part(k), vec![0.; columns as usize]);
        let mut replicates: Vec<_> =
            (0..REPLICATES).map(replicate).collect();
        for entry in &film.rows[at] {
            let (k, p) = (entry.column / columns, entry.column % columns);
            let (part, values) = &mut replicates[k as usize];
            values[p as usize] = PI * entry.mean(n * size) / *part;
        }
        replicates.retain(|(part, _)| *part > 0.);
        (n > 0).then_some(replicates)
    }

    /// The illuminance of a sensor under a sky, at these steps; none if it has
    /// no value.
    pub fn illuminance(
        &self,
        sensor: usize,
        sky: &SkyMatrix,
        steps: &[usize],
    ) -> Option<Illuminance> {
        let lux = |coefficients: &[f64]| {
            let mut sums = vec![0.; steps.len()];
            let rows = sky.values.chunks(sky.steps);
            for (&coefficient, row) in coefficients.iter().zip(rows) {
                if coefficient != 0. {
                    for (sum, &step) in sums.iter_mut().zip(steps) {
                        *sum +=
                            EFFICACY * coefficient * f64::from(row[step]);
                    }
                }
            }
            sums
        };
        let rows = self.replicates(sensor)?;
        // Multiply each replicate with the sky
        let pixel = &self.film.pixels[self.place(sensor)?];
        let samples = pixel.count() * self.film.net_size;
        let moved = moved(&rows, PI / samples as f64);
        let changes = moved.iter().map(|row| lux(row)).collect();
        let turns = [0, 1, rows[0].1.len() - 2];
        let mut replicates = turns.map(|turn| {
            let turned = |(part, row): &Replicate| {
                let mut row = row.clone();
                row[1..].rotate_left(turn);
                (*part, lux(&row))
            };
            rows.iter().map(turned).collect::<Vec<_>>()
        });
        let times = vec![1; rows.len()];
        let lux = mean(&replicates[0], &times);
        for others in &mut replicates {
            // Give replicates this mean
            let mean = mean(others, &times);
            for (_, values) in others {
                for ((value, lux), mean) in
                    values.iter_mut().zip(&lux).zip(&mean)
                {
                    *value += lux - mean;
                }
            }
        }
        Some(Illuminance { replicates, changes, lux })
    }
}

/// What would change if coefficients that few replicates have met were of
/// other patches that few have met, as many times as there are replicates;
/// where none is met, if one of them had that of one path.
fn moved(replicates: &[Replicate], path: f64) -> Vec<Vec<f64>> {
    let columns = replicates[0].1.len();
    let (mut rare, mut values) = (vec![], vec![]);
    for p in 1..columns {
        let met = replicates.iter().filter(|(_, row)| row[p] != 0.);
        let met = met.map(|(part, row)| (p, part * row[p]));
        let met: Vec<_> = met.collect();
        if met.len() <= FEW {
            rare.push(p);
            values.extend(met);
        }
    }
    let change = |k| {
        let mut random = generator(0, k as u64, 1);
        let mut any = || rare[random.random_range(0..rare.len())];
        let mut row = vec![0.; columns];
        if rare.len() + 1 == columns && values.is_empty() {
            row[any()] = path;
        }
        for &(p, value) in &values {
            row[p] -= value;
            row[any()] += value;
        }
        row
    };
    (0..replicates.len()).map(change).collect()
}

/// So many replicates are few.
const FEW: usize = 4;

/// The illuminance of a sensor in lux, at each of some steps of a year, with
/// its standard error.
pub struct Illuminance {
    /// Its replicates, each with its part of all samples; and others with the
    /// deviations of the patches before and behind.
    replicates: [Vec<(f64, Vec<f64>)>; 3],
    /// What changes if rare coefficients move, as many times.
    changes: Vec<Vec<f64>>,
    /// The mean of the replicates at each step.
    pub lux: Vec<f64>,
}

impl Illuminance {
    /// The standard error at each step, from the spread of the replicates
    /// and from what changes if rare coefficients move.
    pub fn standard_errors(&self) -> Vec<f64> {
        let Self { replicates, changes, lux } = self;
        let count = replicates[0].len() as f64;
        let error = |i: usize| {
            let away = |(part, replicate): &(f64, Vec<f64>)| {
                (part * (replicate[i] - lux[i])).powi(2)
            };
            let of_all = |some: &Vec<_>| some.iter().map(away).sum();
            let spread = replicates.iter().map(of_all).fold(0., f64::max);
            let squares = changes.iter().map(|lux| lux[i].powi(2));
            let moved = squares.sum::<f64>() / count;
            (spread * count / (count - 1.) + moved).sqrt()
        };
        (0..self.lux.len()).map(error).collect()
    }
}

/// The mean of replicates, each counted so many times.
fn mean(replicates: &[(f64, Vec<f64>)], times: &[u32]) -> Vec<f64> {
    let mut sums = vec![0.; replicates[0].1.len()];
    let mut total = 0.;
    for ((part, values), &times) in replicates.iter().zip(times) {
        let weight = part * f64::from(times);
        total += weight;
        if times > 0 {
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += weight * value;
            }
        }
    }
    sums.iter_mut().for_each(|sum| *sum /= total);
    sums
}

/// A number, and an interval that covers the truth in about 95 of 100 runs, or
/// in more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The number.
    pub value: f64,
    /// The ends of the interval.
    pub ends: [f64; 2],
}

impl Interval {
    /// The interval of a part of a whole from its values in resampled runs.
    fn new(value: f64, resampled: &[f64]) -> Self {
        let away = resampled.iter().map(|other| (other - value).abs());
        let mut away: Vec<f64> = away.collect();
        away.sort_by(f64::total_cmp);
        let most = (0.95 * (away.len() - 1) as f64).ceil() as usize;
        let ends = [value - away[most], value + away[most]];
        Self { value, ends: ends.map(|end| end.clamp(0., 1.)) }
    }
}

/// What is asked of a year of daylight.
#[derive(Clone, Copy, Debug)]
pub struct Demand {
    /// The illuminance in lux that suffices.
    pub enough: f64,
    /// The illuminances in lux between which daylight is useful.
    pub useful: [f64; 2],
    /// The part of the hours in which it must suffice at a sensor.
    pub hours: f64,
}

/// A year of daylight at sensors.
pub struct Year {
    /// For each sensor the part of the steps with enough light (daylight
    /// autonomy), and the part with useful light (useful daylight
    /// illuminance); none if it has no value.
    pub sensors: Vec<Option<[Interval; 2]>>,
    /// The part of the sensors with enough light in enough hours (spatial
    /// daylight autonomy, IES LM-83-12).
    pub spatial: Interval,
}

/// Resampled runs.
const RUNS: u64 = 1000;

impl Year {
    /// A year at all sensors, at these steps of a sky.
    ///
    /// # Errors
    /// The sky has other patches, or there are too few replicates.
    pub fn new(
        daylight: &Daylight,
        sky: &SkyMatrix,
        steps: &[usize],
        demand: Demand,
    ) -> Result<Self> {
        // Compare the subdivisions
        let (patches, columns) = (sky.patches, daylight.columns);
        if patches != columns as usize {
            return Err(Error::from(format!(
                "the sky has {patches} patches, and the coefficients have \
                 {columns}"
            )));
        }
        let at = (0..daylight.rows.len()).into_par_iter();
        let sensors = at.map(|sensor| {
            let light = daylight.illuminance(sensor, sky, steps);
            let Some(light) = light else {
                return Ok(None);
            };
            let count = light.replicates[0].len();
            if count < 16 {
                return Err(Error::from(format!(
                    "{count} replicates of the coefficients are too few for \
                     an interval: 16 are needed (more samples)"
                )));
            }
            Ok(Some(resample(&light, demand)))
        });
        let sensors: Vec<_> = sensors.collect::<Result<_>>()?;
        // Find the intervals
        let some = sensors.iter().flatten().map(|[enough, _]| enough);
        let some: Vec<_> = some.collect();
        if some.is_empty() {
            return Err("no sensor has a value".into());
        }
        let share = |end: fn(&Interval) -> f64| {
            let passes = |of: &&&Interval| end(of) > demand.hours - 1e-9;
            let those = some.iter().filter(passes).count();
            those as f64 / some.len() as f64
        };
        let (low, high) = (share(|of| of.ends[0]), share(|of| of.ends[1]));
        let step = f64::from(low < high) / some.len() as f64;
        let ends = [(low - step).max(0.), (high + step).min(1.)];
        let spatial = Interval { value: share(|of| of.value), ends };
        Ok(Self { sensors, spatial })
    }
}

/// The parts of the steps with enough and with useful light, with intervals
/// from resampled runs.
fn resample(light: &Illuminance, demand: Demand) -> [Interval; 2] {
    let count = light.replicates[0].len();
    let part = |lux: &[f64], is_meant: &dyn Fn(f64) -> bool| {
        let those = lux.iter().filter(|lux| is_meant(**lux)).count();
        those as f64 / lux.len() as f64
    };
    let enough = |lux: f64| lux >= demand.enough;
    let [least, most] = demand.useful;
    let useful = |lux: f64| least <= lux && lux <= most;
    let mut parts =
        [vec![part(&light.lux, &enough)], vec![part(&light.lux, &useful)]];
    // The spread of resampled means is too small by a known factor
    let wide = (count as f64 / (count as f64 - 1.)).sqrt();
    for run in 0..RUNS {
        let mut random = generator(0, run, 0);
        let mut times = vec![0; count];
        for _ in 0..count {
            times[random.random_range(0..count)] += 1;
        }
        let mut lux = mean(&light.replicates[run as usize % 3], &times);
        let change = &light.changes[run as usize % count];
        let others = light.lux.iter().zip(change);
        for (lux, (mean, change)) in lux.iter_mut().zip(others) {
            *lux = mean + wide * (*lux - mean) + change;
        }
        parts[0].push(part(&lux, &enough));
        parts[1].push(part(&lux, &useful));
    }
    parts.map(|parts| Interval::new(parts[0], &parts[1..]))
}
