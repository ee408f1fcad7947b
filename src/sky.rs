// Tangled from chapters/sky.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The light: a sky above the horizon, of which CIE and Perez describe
//! several, or in all directions, and perhaps a sun.
//!
//! ```
//! use glam::DVec3;
//! use litpt::sky::{Cover, Sky};
//!
//! let sky = Sky::with(DVec3::Z, Cover::Overcast);
//! assert!((sky.radiance(DVec3::Z) - 9. / 7.).abs() < 1e-12);
//! assert_eq!(sky.radiance(-DVec3::Z), 0.);
//! assert_eq!(Sky::new(DVec3::Z).irradiance_ratio(DVec3::X), 0.5);
//! let clear = Sky::with(DVec3::Z, Cover::Cie(12)).toward(DVec3::ONE);
//! let [near, far] = [0.6, -0.6].map(|x| DVec3::new(x, 0., 0.8));
//! assert!(clear.radiance(near) > clear.radiance(far));
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

pub mod sun;

use std::array;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::numerics::normalise;
use crate::tally::patches::{Patches, compass};
use sun::Beam;

/// How the radiance of the sky is distributed; a horizontal surface in the
/// open gets the same from each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Cover {
    /// The same in all directions above the horizon.
    Uniform,
    /// Proportional to 1 + 2 sin γ at the altitude γ (Moon and Spencer
    /// 1942; ISO 15469, type 16).
    Overcast,
    /// The same in all directions, also below the horizon.
    Sphere,
    /// One of the fifteen types of ISO 15469.
    Cie(u8),
    /// The sky of a clearness and a brightness (Perez, Seals and Michalsky
    /// 1993).
    Perez(f64, f64),
    /// A column, from 1, of the sky matrix in this file; in a [`Sky`] the
    /// name of the file is its SHA-256.
    Matrix(PathBuf, Option<u32>),
}
impl Cover {
    /// Whether it changes towards the sun.
    pub fn needs_sun(&self) -> bool {
        matches!(self, Self::Cie(2 | 4..) | Self::Perez(..))
    }
}
impl Display for Cover {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Uniform => write!(f, "uniform"),
            Self::Overcast => write!(f, "overcast"),
            Self::Sphere => write!(f, "sphere"),
            Self::Cie(kind) => write!(f, "cie:{kind}"),
            Self::Perez(clearness, brightness) => {
                write!(f, "perez:{clearness},{brightness}")
            }
            Self::Matrix(file, None) => write!(f, "{}", file.display()),
            Self::Matrix(file, Some(column)) => {
                write!(f, "{}:{column}", file.display())
            }
        }
    }
}

impl From<Cover> for String {
    fn from(cover: Cover) -> Self {
        cover.to_string()
    }
}

impl TryFrom<String> for Cover {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        name.parse()
    }
}
impl FromStr for Cover {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        // Parse the name of a sky matrix
        if let Some(at) = name.rfind(".smx") {
            let (file, column) = name.split_at(at + 4);
            let number = column.strip_prefix(':');
            let number = number.and_then(|text| text.parse().ok());
            let is_sound = column.is_empty() || number > Some(0);
            let wanted = match column.starts_with('.') {
                true => PACKED,
                false => "expected a column from 1 on, as in sky.smx:12",
            };
            let sky = Self::Matrix(file.into(), number);
            return is_sound.then_some(sky).ok_or(wanted.to_owned());
        }
        let (kind, numbers) = name.split_once(':').unwrap_or((name, ""));
        let wanted = match kind {
            "uniform" if numbers.is_empty() => return Ok(Self::Uniform),
            "overcast" if numbers.is_empty() => return Ok(Self::Overcast),
            "sphere" if numbers.is_empty() => return Ok(Self::Sphere),
            "cie" => match numbers.parse() {
                Ok(5) => return Ok(Self::Uniform),
                Ok(16) => return Ok(Self::Overcast),
                Ok(kind @ 1..16) => return Ok(Self::Cie(kind)),
                _ => "expected a type from 1 to 16",
            },
            "perez" => match parse_pair(numbers) {
                Some([e, d]) if e >= 1. && d > 0. => {
                    return Ok(Self::Perez(e, d));
                }
                _ => {
                    "expected a clearness from 1 on and a brightness above 0"
                }
            },
            _ => {
                "expected uniform, overcast, sphere, cie:TYPE, \
                  perez:CLEARNESS,BRIGHTNESS or FILE.smx:COLUMN"
            }
        };
        Err(wanted.to_owned())
    }
}

/// Why a compressed file is refused.
pub(crate) const PACKED: &str =
    "a compressed sky matrix is not read: unpack it";

/// Two finite numbers around a comma.
pub(crate) fn parse_pair(text: &str) -> Option<[f64; 2]> {
    let (a, b) = text.split_once(',')?;
    let pair = [a.trim().parse().ok()?, b.trim().parse().ok()?];
    pair.iter().all(|x: &f64| x.is_finite()).then_some(pair)
}

/// The sky: light from all directions above the horizon, or from all.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sky {
    /// Unit vector that points to the zenith.
    pub zenith: DVec3,
    /// How its radiance is distributed.
    pub cover: Cover,
    /// The radiance that a camera sees where it looks past all surfaces,
    /// in all directions; if there is none, it sees the sky.
    #[serde(
        rename = "behind",
        default,
        skip_serializing_if = "Option::is_none"
    )]
    pub background: Option<f64>,
    /// The radiance below the horizon.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub below: f64,
    /// How it changes towards the horizon and towards the sun, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gradation: Option<Gradation>,
    /// The sun, if it shines.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beam: Option<Beam>,
    /// The irradiance of a surface that would face all that shadow rays look
    /// for in its patches; 0 if they look for nothing there.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub excess: f64,
    /// Its patches, if it is of a matrix.
    #[serde(skip)]
    pub patchwork: Option<Arc<Patchwork>>,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.
}

/// The direction to the sun.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Sun {
    /// A vector, which is not zero.
    Toward(DVec3),
    /// The azimuth, clockwise from the north, and the altitude, in degrees.
    At(f64, f64),
}

impl Sun {
    /// The unit vector to the sun under a zenith.
    pub fn direction(self, zenith: DVec3) -> DVec3 {
        match self {
            Self::Toward(vector) => normalise(vector).normalize(),
            Self::At(azimuth, altitude) => {
                let [azimuth, altitude] =
                    [azimuth, altitude].map(f64::to_radians);
                let [east, north] = compass(zenith);
                let across =
                    libm::sin(azimuth) * east + libm::cos(azimuth) * north;
                libm::cos(altitude) * across + libm::sin(altitude) * zenith
            }
        }
    }
}

/// A sky that changes towards the horizon, and towards the sun.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gradation {
    /// The unit vector to the sun.
    pub sun: DVec3,
    /// The parameters a to e of the formula.
    parameters: [f64; 5],
    /// The part of the indicatrix that does not change.
    constant: f64,
    /// The radiance where the formula gives 1.
    unit: f64,
    /// The radiance at the horizon, and its rise to the zenith, of the nearest
    /// sky that changes linearly with the sine of the altitude.
    even: [f64; 2],
}
/// The parameters a to e of the fifteen types of ISO 15469 (table 1).
const CIE: [[f64; 5]; 15] = [
    [4., -0.7, 0., -1., 0.],
    [4., -0.7, 2., -1.5, 0.15],
    [1.1, -0.8, 0., -1., 0.],
    [1.1, -0.8, 2., -1.5, 0.15],
    [0., -1., 0., -1., 0.],
    [0., -1., 2., -1.5, 0.15],
    [0., -1., 5., -2.5, 0.3],
    [0., -1., 10., -3., 0.45],
    [-1., -0.55, 2., -1.5, 0.15],
    [-1., -0.55, 5., -2.5, 0.3],
    [-1., -0.55, 10., -3., 0.45],
    [-1., -0.32, 10., -3., 0.45],
    [-1., -0.32, 16., -3., 0.3],
    [-1., -0.15, 16., -3., 0.3],
    [-1., -0.15, 24., -2.8, 0.15],
];
/// The clearness at which each row of Perez's table begins.
const CLEARNESS: [f64; 8] = [1., 1.065, 1.23, 1.5, 1.95, 2.8, 4.5, 6.2];

/// Four coefficients of each of five parameters, row by row (Perez and others
/// 1993, table 1).
const PEREZ: [f64; 160] = [
    1.3525, -0.2576, -0.269, -1.4366, -0.767, 0.0007, 1.2734, -0.1233, 2.8,
    0.6004, 1.2375, 1., 1.8734, 0.6297, 0.9738, 0.2809, 0.0356, -0.1246,
    -0.5718, 0.9938, -1.2219, -0.773, 1.4148, 1.1016, -0.2054, 0.0367,
    -3.9128, 0.9156, 6.975, 0.1774, 6.4477, -0.1239, -1.5798, -0.5081,
    -1.7812, 0.108, 0.2624, 0.0672, -0.219, -0.4285, -1.1, -0.2515, 0.8952,
    0.0156, 0.2782, -0.1812, -4.5, 1.1766, 24.7219, -13.0812, -37.7,
    34.8438, -5., 1.5218, 3.9229, -2.6204, -0.0156, 0.1597, 0.4199,
    -0.5562, -0.5484, -0.6654, -0.2672, 0.7117, 0.7234, -0.6219, -5.6812,
    2.6297, 33.3389, -18.3, -62.25, 52.0781, -3.5, 0.0016, 1.1477, 0.1062,
    0.4659, -0.3296, -0.0876, -0.0329, -0.6, -0.3566, -2.5, 2.325, 0.2937,
    0.0496, -5.6812, 1.8415, 21., -4.7656, -21.5906, 7.2492, -3.5, -0.1554,
    1.4062, 0.3988, 0.0032, 0.0766, -0.0656, -0.1294, -1.0156, -0.367,
    1.0078, 1.4051, 0.2875, -0.5328, -3.85, 3.375, 14., -0.9999, -7.1406,
    7.5469, -3.4, -0.1078, -1.075, 1.5702, -0.0672, 0.4016, 0.3017,
    -0.4844, -1., 0.0211, 0.5025, -0.5119, -0.3, 0.1922, 0.7023, -1.6317,
    19., -5., 1.2438, -1.9094, -4., 0.025, 0.3844, 0.2656, 1.0468, -0.3788,
    -2.4517, 1.4656, -1.05, 0.0289, 0.426, 0.359, -0.325, 0.1156, 0.7781,
    0.0025, 31.0625, -14.5, -46.1148, 55.375, -7.2312, 0.405, 13.35,
    0.6234, 1.5, -0.6426, 1.8564, 0.5636,
];
/// The parameters of Perez's sky of a clearness and a brightness, when the sun
/// stands at this angle from the zenith.
fn perez(clearness: f64, brightness: f64, angle: f64) -> [f64; 5] {
    let row = CLEARNESS.partition_point(|from| *from <= clearness);
    let row = row.saturating_sub(1);
    let (table, _) = PEREZ[20 * row..].as_chunks();
    let mut parameters = array::from_fn(|k| {
        let [x, y, z, w] = table[k];
        x + y * angle + brightness * (z + w * angle)
    });
    if row == 0 {
        let ([c1, c2, c3, c4], [d1, d2, d3, d4]) = (table[2], table[3]);
        let power = libm::pow(brightness * (c1 + c2 * angle), c3);
        parameters[2] = libm::exp(power) - c4;
        let fall = libm::exp(brightness * (d1 + d2 * angle));
        parameters[3] = d3 + brightness * d4 - fall;
    }
    parameters
}
/// The radiance at the horizon, and its rise to the zenith, of the sky nearest
/// to one of this m.
fn nearest([first, second]: [f64; 2]) -> [f64; 2] {
    let rise = 18. * (second - 2. / 3. * first);
    [first - 2. / 3. * rise, rise]
}

impl Gradation {
    /// The gradation of a sky, if it has one.
    fn new(cover: &Cover, zenith: DVec3, sun: DVec3) -> Option<Self> {
        let angle = libm::acos(zenith.dot(sun).clamp(-1., 1.));
        let (parameters, constant) = match *cover {
            Cover::Cie(kind) => {
                let [.., c, d, _] = CIE[usize::from(kind) - 1];
                let constant = 1. - c * libm::exp(d * FRAC_PI_2);
                (CIE[usize::from(kind) - 1], constant)
            }
            Cover::Perez(clearness, brightness) => {
                (perez(clearness, brightness, angle), 1.)
            }
            _ => return None,
        };
        let (unit, even) = (1., [0.; 2]);
        let new = Self { sun, parameters, constant, unit, even };
        let [first, second, negative] = new.moments(zenith);
        let is_lit = first > 0. && negative < 0.01 * first;
        let unit = if is_lit { 1. / first } else { f64::NAN };
        let even = nearest([1., second / first]);
        Some(Self { unit, even, ..new })
    }
    /// The integrals of the radiance over the sky, weighted by the height above
    /// the horizon and by its square, over pi; and what is cut off of the first,
    /// where the formula is negative.
    fn moments(&self, zenith: DVec3) -> [f64; 3] {
        let [east, north] = compass(zenith);
        let [mut first, mut second, mut negative] = [0.; 3];
        let midpoints = |n: u32| {
            (0..n).map(move |i| (f64::from(i) + 0.5) / f64::from(n))
        };
        for t in midpoints(ROWS) {
            let altitude = FRAC_PI_2 * t * t * (3. - 2. * t);
            let (height, level) =
                (libm::sin(altitude), libm::cos(altitude));
            let width = FRAC_PI_2 * 6. * t * (1. - t) / f64::from(ROWS);
            let weight = height * level * width / f64::from(ROWS);
            for turn in midpoints(2 * ROWS) {
                let turn = TAU * turn;
                let across =
                    libm::sin(turn) * east + libm::cos(turn) * north;
                let direction = height * zenith + level * across;
                let part = weight * self.formula(height, direction);
                first += part.max(0.);
                second += part.max(0.) * height;
                negative -= part.min(0.);
            }
        }
        [first, second, negative]
    }
    /// Whether it is finite at the horizon, and hardly anywhere negative.
    pub fn is_sound(self) -> bool {
        self.parameters[1] <= 0. && self.unit.is_finite()
    }

    /// The radiance of a direction of this height above the horizon.
    fn radiance(&self, height: f64, direction: DVec3) -> f64 {
        self.unit * self.formula(height, direction).max(0.)
    }

    /// The value of the formula there.
    fn formula(&self, height: f64, direction: DVec3) -> f64 {
        let [a, b, c, d, e] = self.parameters;
        let cosine = self.sun.dot(direction).clamp(-1., 1.);
        let angle = libm::acos(cosine);
        let gradation = 1. + a * libm::exp(b / height);
        let indicatrix =
            self.constant + c * libm::exp(d * angle) + e * cosine * cosine;
        gradation * indicatrix
    }
}

/// The rows of the quadrature of a sky.
const ROWS: u32 = 256;

/// A sky whose radiance is constant in each patch.
#[derive(Clone, Debug, PartialEq)]
pub struct Patchwork {
    /// The file and the column, as they were typed.
    pub typed: Cover,
    /// The SHA-256 of the file, and the column.
    cover: Cover,
    /// The patches.
    patches: Patches,
    /// The radiance of each.
    radiances: Arc<[f64]>,
    /// The radiance above which shadow rays look for the light of a patch.
    limit: f64,
    /// The numbers of the brighter patches, each with the irradiance of a
    /// surface that faces what is above in it and in those before.
    bright: Arc<[(u32, f64)]>,
    /// The radiance at the horizon of the sky nearest to what is below, and
    /// its rise.
    even: [f64; 2],
}

/// The limit, in units of the median of the patches.
const LIMIT: f64 = 20.;
impl Patchwork {
    /// A sky of these patches with these relative radiances, or none if it
    /// has no light above the horizon; it was typed so, and keys call it
    /// `cover`.
    ///
    /// # Panics
    /// There are fewer than two values.
    pub fn new(
        [typed, cover]: [Cover; 2],
        patches: Patches,
        values: &[f64],
    ) -> Option<Self> {
        // Find the radiances of the patches
        let moments = patches.moments();
        let moment = |k: usize, limit: f64| {
            let values = values.iter().map(|x| x.min(limit));
            values.zip(&moments).map(|(x, m)| x * m[k]).sum::<f64>()
        };
        let first = moment(0, f64::INFINITY);
        if !(first > 0. && first.is_finite()) {
            return None;
        }
        let radiances = values.iter().map(|x| x / first).collect();
        let mut sorted = values[1..].to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let limit = LIMIT * sorted[sorted.len() / 2];
        let even = nearest([0, 1].map(|k| moment(k, limit) / first));
        let (mut bright, mut sum) = (vec![], 0.);
        for (number, (value, moments)) in
            (0..).zip(values.iter().zip(&moments))
        {
            let above = (value - limit) / first * moments[2];
            if above > 0. {
                sum += above;
                bright.push((number, sum));
            }
        }
        let (limit, bright) = (limit / first, bright.into());
        Some(Self { typed, cover, patches, radiances, limit, bright, even })
    }

    /// The radiance of a direction above the horizon.
    #[cold]
    #[inline(never)]
    fn radiance(&self, direction: DVec3) -> f64 {
        self.radiances[self.patches.number(direction) as usize]
    }

    /// A direction that two numbers uniform over [0, 1) choose, with a density
    /// proportional to the radiance above the limit.
    ///
    /// # Panics
    /// No patch is bright.
    pub fn sample(&self, [u, v]: [f64; 2]) -> DVec3 {
        let last = self.bright.len() - 1;
        let reach = u * self.bright[last].1;
        let place = self.bright.partition_point(|(_, sum)| *sum <= reach);
        let place = place.min(last);
        let before = place.checked_sub(1).map_or(0., |i| self.bright[i].1);
        let (number, sum) = self.bright[place];
        let u = (reach - before) / (sum - before);
        self.patches.point(number, [u, v])
    }
}

impl Sky {
    /// The uniform sky whose zenith is the coordinate axis nearest to `up`.
    pub fn new(up: DVec3) -> Self {
        let size = |axis: &DVec3| axis.dot(up).abs();
        let axes = DVec3::AXES.into_iter();
        let last = axes.max_by(|a, b| size(a).total_cmp(&size(b)));
        let axis = last.unwrap_or(DVec3::Z);
        Self::with(axis * axis.dot(up).signum(), Cover::Uniform)
    }

    /// The sky around a zenith, whose vector is not zero. A sun stands at the
    /// zenith.
    ///
    /// # Panics
    /// It is [`Cover::Cie`] of no type.
    pub fn with(zenith: DVec3, cover: Cover) -> Self {
        let zenith = normalise(zenith).normalize();
        let (background, below, excess) = (None, 0., 0.);
        let (gradation, beam, patchwork) = (None, None, None);
        let sky = Self {
            zenith,
            cover,
            background,
            below,
            gradation,
            beam,
            excess,
            patchwork,
        };
        sky.toward(zenith)
    }

    /// The same sky with the sun in this direction, a vector that is not zero; it
    /// stays at the zenith where it does not matter.
    pub fn toward(self, sun: DVec3) -> Self {
        let sun = match self.cover.needs_sun() {
            true => normalise(sun).normalize(),
            false => self.zenith,
        };
        let gradation = Gradation::new(&self.cover, self.zenith, sun);
        Self { gradation, ..self }
    }

    /// The sky of these patches around a zenith, whose vector is not zero.
    pub fn of(zenith: DVec3, patchwork: &Patchwork) -> Self {
        let mut sky = Self::with(zenith, patchwork.cover.clone());
        let patches = patchwork.patches.around(sky.zenith);
        let patchwork = Patchwork { patches, ..patchwork.clone() };
        sky.excess = patchwork.bright.last().map_or(0., |(_, sum)| *sum);
        sky.patchwork = Some(patchwork.into());
        sky
    }

    /// The radiance that arrives from `direction`, if nothing is in the way.
    #[inline(always)]
    pub fn radiance(&self, direction: DVec3) -> f64 {
        let height = self.zenith.dot(direction);
        match self.cover {
            Cover::Sphere => 1.,
            _ if height <= 0. => self.below,
            Cover::Uniform => 1.,
            Cover::Overcast => 3. / 7. * (1. + 2. * height),
            Cover::Matrix(..) => self
                .patchwork
                .as_ref()
                .map_or(1., |it| it.radiance(direction)),
            _ => self
                .gradation
                .map_or(1., |it| it.radiance(height, direction)),
        }
    }

    /// The same without the light for which shadow rays look.
    #[inline(always)]
    pub fn dim_radiance(&self, direction: DVec3) -> f64 {
        match &self.patchwork {
            Some(it) if self.excess > 0. => {
                let is_above = self.zenith.dot(direction) > 0.;
                let limit = if is_above { it.limit } else { f64::INFINITY };
                self.radiance(direction).min(limit)
            }
            _ => self.radiance(direction),
        }
    }

    /// The radiance of a sky from `direction` that changes with its altitude
    /// alone, and whose irradiance ratio is known.
    #[inline(always)]
    pub fn even_radiance(&self, direction: DVec3) -> f64 {
        let height = self.zenith.dot(direction);
        match self.even() {
            Some([base, rise]) if height > 0. => base + rise * height,
            _ => self.radiance(direction),
        }
    }

    /// The radiance that a camera sees in `direction` if no surface is there.
    #[inline(always)]
    pub fn seen(&self, direction: DVec3) -> f64 {
        self.background.unwrap_or_else(|| self.radiance(direction))
    }

    /// The nearest sky of one that is not even itself.
    #[inline(always)]
    fn even(&self) -> Option<[f64; 2]> {
        match self.cover {
            Cover::Uniform | Cover::Overcast | Cover::Sphere => None,
            Cover::Matrix(..) => self.patchwork.as_ref().map(|it| it.even),
            _ => self.gradation.map(|it| it.even),
        }
    }

    /// Whether shadow rays look for a part of its light.
    #[inline(always)]
    pub fn has_sun(&self) -> bool {
        self.beam.is_some() || self.excess > 0.
    }

    /// A direction to a point of the sun or of a bright patch, and the
    /// irradiance, as from [`Beam::sample`], that stands for both.
    #[inline]
    pub fn sample_sun(
        &self,
        normal: DVec3,
        [u, v]: [f64; 2],
    ) -> (DVec3, f64) {
        let patches = self.patchwork.as_ref();
        let Some(patches) = patches.filter(|_| self.excess > 0.) else {
            let none = (self.zenith, 0.);
            return self.beam.map_or(none, |it| it.sample(normal, [u, v]));
        };
        let disc = self.beam.map_or(0., |beam| beam.irradiance);
        let both = disc + self.excess;
        let reach = u * both;
        if let Some(beam) = self.beam.filter(|_| reach < disc) {
            let u = [reach / disc, v];
            let (direction, irradiance) = beam.sample(normal, u);
            return (direction, irradiance * both / disc);
        }
        let direction = patches.sample([(reach - disc) / self.excess, v]);
        (direction, both * normal.dot(direction).max(0.))
    }

    /// The irradiance of a surface with this unit normal from the radiance
    /// [`Sky::even_radiance`] if nothing is in the way, relative to that of a
    /// horizontal one.
    pub fn irradiance_ratio(&self, normal: DVec3) -> f64 {
        let cosine = self.zenith.dot(normal).clamp(-1., 1.);
        let uniform = 0.5 + 0.5 * cosine;
        let [base, rise] = match self.cover {
            Cover::Sphere => return 1.,
            Cover::Overcast => [3. / 7., 6. / 7.],
            _ => self.even().unwrap_or([1., 0.]),
        };
        let mut ratio = base * uniform + self.below * (1. - uniform);
        if rise != 0. {
            let (sine, angle) =
                ((1. - cosine * cosine).sqrt(), libm::acos(cosine));
            let bright = sine + (PI - angle) * cosine;
            ratio += rise * 2. / (3. * PI) * bright;
        }
        ratio
    }
}
