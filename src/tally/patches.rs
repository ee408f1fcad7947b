// Tangled from chapters/tally.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Tregenza's subdivision of the sky (1987), refined by Reinhart (2001).
//!
//! ```
//! use glam::DVec3;
//! use litpt::tally::patches::Patches;
//!
//! let sky = Patches::new(1, DVec3::Z);
//! assert_eq!(sky.count(), 146);
//! assert_eq!(sky.number(DVec3::new(0., 1., 0.01)), 1);
//! assert_eq!(sky.number(DVec3::Z), 145);
//! assert_eq!(sky.number(-DVec3::Z), 0);
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

use std::f64::consts::PI;

use glam::DVec3;

use crate::numerics::sincos_turns;

/// The unit vectors to the east and to the north, which is the horizontal
/// direction nearest to +y; if the zenith is +y or -y, it is -z or +z.
pub fn compass(zenith: DVec3) -> [DVec3; 2] {
    let across = DVec3::Y.reject_from_normalized(zenith);
    let is_vertical = across.length_squared() < 1e-12;
    let other = DVec3::NEG_Z * zenith.y.signum();
    let north = if is_vertical { other } else { across.normalize() };
    [north.cross(zenith), north]
}

/// The patches of a row of Tregenza's, from the horizon to the zenith.
const AROUND: [u32; 7] = [30, 30, 24, 24, 18, 12, 6];

/// The patches of the sky.
#[derive(Clone, Debug, PartialEq)]
pub struct Patches {
    /// The directions to the east, the north and the zenith.
    axes: [DVec3; 3],
    /// The number of the first patch of each row, and how many it has; the
    /// last row is the zenith.
    rows: Vec<(u32, u32)>,
}

impl Patches {
    /// The patches of a multiplication factor around a unit vector to the
    /// zenith. North is the horizontal direction nearest to +y; if the zenith
    /// is +y or -y, it is -z or +z.
    pub fn new(factor: u32, zenith: DVec3) -> Self {
        let mut rows = vec![];
        let mut first = 1;
        for count in AROUND.map(|count| factor * count) {
            for _ in 0..factor {
                rows.push((first, count));
                first += count;
            }
        }
        rows.push((first, 1));
        Self { axes: [DVec3::ZERO; 3], rows }.around(zenith)
    }

    /// The same patches around another unit vector to the zenith.
    pub fn around(&self, zenith: DVec3) -> Self {
        let [east, north] = compass(zenith);
        Self { axes: [east, north, zenith], rows: self.rows.clone() }
    }

    /// The number of columns: all patches, and what is below the horizon.
    pub fn count(&self) -> u32 {
        self.rows.last().map_or(1, |(last, _)| last + 1)
    }

    /// The number of the patch of a direction, as Radiance counts it; 0 below
    /// the horizon.
    pub fn number(&self, direction: DVec3) -> u32 {
        let [x, y, z] = self.axes.map(|axis| axis.dot(direction));
        if z <= 0. {
            return 0;
        }
        let rows = self.rows.len();
        let altitude = libm::atan2(z, libm::hypot(x, y)) / (PI / 2.);
        let row = (altitude * (rows as f64 - 0.5)) as usize;
        let (first, count) = self.rows[row.min(rows - 1)];
        // Count clockwise from the north, around which a patch is centred
        let turn = libm::atan2(x, y) / (2. * PI);
        let place = (f64::from(count) * turn + 0.5).floor() as i64;
        first + place.rem_euclid(count.into()) as u32
    }

    /// For the ground and each patch the integrals of the height above the
    /// horizon, of its square and of 1, over pi; 0 for the ground.
    pub fn moments(&self) -> Vec<[f64; 3]> {
        let mut moments = vec![[0.; 3]];
        for (row, &(_, count)) in (0..).zip(&self.rows) {
            let (a, b) = (self.sine(row), self.sine(row + 1));
            let n = f64::from(count);
            let first = (b * b - a * a) / n;
            let second = 2. / 3. * (b * b * b - a * a * a) / n;
            let all = [first, second, 2. * (b - a) / n];
            moments.resize(moments.len() + count as usize, all);
        }
        moments
    }

    /// The sine of the altitude at which a row begins.
    fn sine(&self, row: u32) -> f64 {
        let rows = self.rows.len() as f64 - 0.5;
        libm::sin(PI / 2. * (f64::from(row) / rows).min(1.))
    }

    /// The direction to a point of a patch above the horizon that two numbers
    /// uniform over [0, 1) choose uniformly.
    pub fn point(&self, number: u32, [u, v]: [f64; 2]) -> DVec3 {
        let rows = self.rows.partition_point(|(first, _)| *first <= number);
        let row = rows as u32 - 1;
        let (first, count) = self.rows[rows - 1];
        let (low, high) = (self.sine(row), self.sine(row + 1));
        let height = low + u * (high - low);
        let turn = (f64::from(number - first) + v - 0.5) / f64::from(count);
        let (y, x) = sincos_turns(turn.rem_euclid(1.));
        let level = (1. - height * height).max(0.).sqrt();
        let [east, north, zenith] = self.axes;
        level * (x * east + y * north) + height * zenith
    }
}
