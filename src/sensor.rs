// Tangled from chapters/sensor.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The start of a sample: the ray of a camera, or a receiver, which is a
//! point with a normal or a face.
//!
//! ```
//! use litpt::sensor::read_points;
//!
//! let points = read_points(b"# a desk\n1 2 0.85 0 0 1\n", &mut vec![])?;
//! let (position, normal, line) = points[0];
//! assert_eq!((position.z, normal.z, line), (0.85, 1., 2));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

pub mod table;

use std::array;
use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bvh::{BEAM, Batch, Bvh, Hit, Intersector, NONE};
use crate::bvh::{is_within, lifted};
use crate::camera::Camera;
use crate::error::{Diagnostic, Result};
use crate::materials::Surfaces;
use crate::numerics::{cross, normalise, power_of_two, sincos_turns};
use crate::sampler::{to_unit, within};
use crate::scene::encoding::{self, quoted};
use crate::scene::{Entrance, Frame, Ray, Triangle, Triangles};

/// The start of a sample.
pub enum Sensor {
    /// A camera, and where its rays enter the scene.
    Camera(Camera, Entrance),
    /// Receivers, one for each row of a film of one column.
    Receivers(Receivers),
}

/// The starts of samples.
pub struct Starts {
    /// The directions of their rays; receivers have none.
    pub directions: [DVec3; BEAM],
    /// The surfaces that they have met behind all panes, or receivers.
    pub hits: Batch<Hit>,
    /// The part of the light from there that the panes transmit.
    pub transmittances: [f64; BEAM],
    /// The number of rays traced.
    pub rays: u64,
}

/// The start of a sample.
pub struct Start {
    /// The direction of its ray; a receiver has none.
    pub direction: DVec3,
    /// The surface that it has met behind all panes, or a receiver.
    pub hit: Option<Hit>,
    /// The part of the light from there that the panes transmit.
    pub transmittance: f64,
    /// The number of rays traced.
    pub rays: u64,
}

/// The pixel of a sample, by column and row, and a point in it.
pub type Place = ((u32, u32), [u32; 2]);

impl Sensor {
    /// Starts samples in an image of this resolution. Some may be missing;
    /// with `sees_sky` their rays meet nothing.
    #[inline(always)]
    pub fn starts(
        &self,
        intersector: &impl Intersector,
        surfaces: &Surfaces,
        places: &Batch<Place>,
        (width, height): (u32, u32),
        sees_sky: bool,
    ) -> Starts {
        let mut transmittances = [1.; BEAM];
        let (camera, entrance) = match self {
            Self::Camera(camera, entrance) => (camera, entrance),
            Self::Receivers(receivers) => {
                let hit = |((_, y), u): Place| receivers.hit(y as usize, u);
                let hits = array::from_fn(|i| places[i].map(hit));
                let directions = [DVec3::ZERO; BEAM];
                let rays = 0;
                return Starts { directions, hits, transmittances, rays };
            }
        };
        let directions = array::from_fn(|i| {
            let ((x, y), [u, v]) = places[i].unwrap_or_default();
            camera.direction(within(x, width, u), within(y, height, v))
        });
        let look = |i: usize| {
            places[i].filter(|_| !sees_sky).map(|_| directions[i])
        };
        let rays = array::from_fn(|i| entrance.enter(look(i)?));
        let mut hits = intersector.first_hits(&rays);
        // Intersect the ground with rays that miss the scene
        for i in 0..BEAM {
            if let (Some(direction), None) = (look(i), &rays[i]) {
                hits[i] = ground_below(intersector, entrance, direction);
            }
        }
        let mut rays = rays.iter().flatten().count() as u64;
        // Look through panes from the camera
        if surfaces.transmits {
            for i in 0..BEAM {
                let (hit, part, more) = surfaces.behind_panes(
                    intersector,
                    directions[i],
                    hits[i],
                );
                (hits[i], transmittances[i]) = (hit, part);
                rays += more;
            }
        }
        Starts { directions, hits, transmittances, rays }
    }

    /// Starts a sample at the point (`x`, `y`) of the image.
    pub fn start(
        &self,
        intersector: &impl Intersector,
        surfaces: &Surfaces,
        (x, y): (f64, f64),
    ) -> Start {
        match self {
            Self::Camera(camera, entrance) => {
                let direction = camera.direction(x, y);
                let ray = entrance.enter(direction);
                let hit = match &ray {
                    Some(ray) => intersector.first_hit(ray, None),
                    None => ground_below(intersector, entrance, direction),
                };
                let (hit, transmittance, more) =
                    surfaces.behind_panes(intersector, direction, hit);
                let rays = u64::from(ray.is_some()) + more;
                Start { direction, hit, transmittance, rays }
            }
            Self::Receivers(receivers) => {
                let row = y * receivers.numbers.len() as f64;
                let last = receivers.numbers.len() - 1;
                let to_u32 = |u| (u * power_of_two(32)) as u32;
                let u = [x, row.fract()].map(to_u32);
                let hit = receivers.hit((row as usize).min(last), u);
                let (direction, hit) = (DVec3::ZERO, Some(hit));
                Start { direction, hit, transmittance: 1., rays: 0 }
            }
        }
    }
}

/// The ground that the ray of a camera meets if it misses the scene.
fn ground_below(
    intersector: &impl Intersector,
    entrance: &Entrance,
    direction: DVec3,
) -> Option<Hit> {
    let origin = entrance.place()?;
    intersector.below(&Ray { origin, direction })
}

/// The receivers of a run.
pub struct Receivers {
    /// The number of each that may have a value, in the order of the film.
    pub numbers: Vec<u32>,
    receivers: Vec<Receiver>,
    /// The triangles of faces, without those that have no area; each with
    /// twice the cumulative area of its face.
    parts: Vec<(Triangle, f64)>,
    /// Odd receivers: the kind of oddity, and their numbers.
    pub odd: Vec<(Oddity, u32)>,
    /// The number of receivers in the file.
    pub asked: usize,
}

/// Whether an odd receiver has a value nevertheless, and what is odd about
/// it.
pub type Oddity = (bool, &'static str);

/// A point that cannot see the sky.
pub const INSIDE: Oddity = (true, "inside a closed body");

/// The surroundings of receivers: surfaces, their frame, the unit vector to
/// the zenith, and whether the normals of points and faces are compared.
pub type Around<'a> = (&'a Bvh, &'a Frame, DVec3, bool);

/// A receiver.
#[derive(Clone)]
enum Receiver {
    /// A point, and the normal there.
    Point(Hit),
    /// A face: its range of triangles, and whether it is its back.
    Face(Range<usize>, bool),
}

impl Receivers {
    /// The point of receiver `i` that two numbers choose, uniform over the
    /// integers below 2^32, as a hit on no triangle.
    #[inline]
    pub fn hit(&self, i: usize, u: [u32; 2]) -> Hit {
        let (parts, is_back) = match &self.receivers[i] {
            Receiver::Point(hit) => return *hit,
            Receiver::Face(range, is_back) => {
                (&self.parts[range.clone()], is_back)
            }
        };
        let [u, v] = u.map(to_unit);
        // Choose a point of a face
        let at = u * parts[parts.len() - 1].1;
        let part = parts.partition_point(|&(_, area)| area <= at);
        let before = if part == 0 { 0. } else { parts[part - 1].1 };
        let (corners, cumulative_area) = parts[part];
        let [a, b, c] = corners;
        let root = ((at - before) / (cumulative_area - before)).sqrt();
        let point = a + ((b - a) * (1. - v) + (c - a) * v) * root;
        let normal = cross(b - a, c - a);
        let across = if *is_back { -normal } else { normal };
        let normal = across / normal.length();
        let point = lifted(&corners, point, normal);
        Hit { point, normal, primitive: NONE }
    }

    /// Points of a file.
    pub fn points(points: &[Point], frame: &Frame) -> Self {
        let receivers = points.par_iter().map(|&(place, normal, _)| {
            let place =
                frame.entrance(place).place().ok_or("too far away")?;
            point(place, normalise(normal).normalize_or_zero())
        });
        Self::partition_valid(receivers.collect(), vec![])
    }

    /// Separates receivers that may have a value from the others.
    fn partition_valid(
        receivers: Vec<Result<Receiver, &'static str>>,
        parts: Vec<(Triangle, f64)>,
    ) -> Self {
        let (mut sound, mut odd, asked) = (vec![], vec![], receivers.len());
        for (number, one) in (0..).zip(receivers) {
            match one {
                Ok(one) => sound.push((number, one)),
                Err(why) => odd.push(((false, why), number)),
            }
        }
        let (numbers, receivers) = sound.into_iter().unzip();
        Self { numbers, receivers, parts, odd, asked }
    }

    /// A point of each receiver.
    pub fn middles(&self) -> Vec<DVec3> {
        let middle = |i| self.hit(i, [1 << 31; 2]).point;
        (0..self.numbers.len()).map(middle).collect()
    }

    /// Sorts the receivers by their keys, without those that cannot have a
    /// value.
    pub fn order(
        &mut self,
        around: Around,
        key: impl Fn(&Hit) -> u64 + Sync,
    ) {
        let list = (0..self.numbers.len()).into_par_iter().map(|i| {
            let hit = self.hit(i, [1 << 31; 2]);
            let is_point = matches!(self.receivers[i], Receiver::Point(_));
            let odd = is_point.then(|| oddity(around, &hit)).flatten();
            (key(&hit), i, odd)
        });
        let mut list: Vec<_> = list.collect();
        list.par_sort_unstable();
        // Set odd receivers aside
        let odd =
            |&(_, i, odd): &(_, usize, _)| Some((odd?, self.numbers[i]));
        self.odd.extend(list.iter().filter_map(odd));
        self.odd.sort_unstable();
        list.retain(|(.., odd)| odd.is_none_or(|(has_value, _)| has_value));
        let order = list.iter().map(|&(_, i, _)| i);
        self.numbers = order.clone().map(|i| self.numbers[i]).collect();
        self.receivers = order.map(|i| self.receivers[i].clone()).collect();
    }
}

/// The distance by which points are lifted along their normals: 2^-22 of
/// the longest side that a scene may have, which is 2^13.
const LIFT: f64 = power_of_two(-9);

/// A lifted point of the scene.
fn point(place: DVec3, normal: DVec3) -> Result<Receiver, &'static str> {
    let hit = Hit { point: place + normal * LIFT, normal, primitive: NONE };
    let has_normal = normal != DVec3::ZERO && normal.is_finite();
    has_normal.then_some(Receiver::Point(hit)).ok_or("without a normal")
}

/// Whether a triangle with a property is this close to a point.
fn has_near(
    bvh: &Bvh,
    point: DVec3,
    reach: f64,
    is_meant: impl Fn(&Triangle) -> bool,
) -> bool {
    let (low, high) = (point - reach, point + reach);
    bvh.any_triangle(
        |a, b| a.cmple(high).all() && low.cmple(b).all(),
        |_, corners| is_within(corners, point, reach) && is_meant(corners),
    )
}

/// A point, its normal, and the line that they stand in, from 1.
pub type Point = (DVec3, DVec3, usize);

/// Reads points with normals, in the coordinates of the file. A warning
/// says what was left out of a compressed file.
///
/// # Errors
/// The line at fault, from 1, and what is wrong with it; or there is no
/// point, or the file cannot be unpacked.
pub fn read_points(
    source: &[u8],
    warnings: &mut Vec<Diagnostic>,
) -> Result<Vec<Point>> {
    let text = encoding::text(source, warnings)?;
    let text = String::from_utf8_lossy(&text).replace("\r\n", "\n");
    let lines: Vec<&str> = text.split(['\n', '\r']).collect();
    let points = lines.par_iter().enumerate().filter_map(read_point);
    let points: Vec<_> = points.collect();
    match points.into_iter().collect::<Result<Vec<_>, _>>()? {
        none if none.is_empty() => Err("no point".into()),
        points => Ok(points),
    }
}

/// The point of a line, unless it is a comment, empty, or the head.
fn read_point((i, line): (usize, &&str)) -> Option<Result<Point>> {
    let is_gap =
        |c: char| c.is_whitespace() || ";\"\u{feff}\u{1a}".contains(c);
    let words = line.split(|c| is_gap(c) || c == ',');
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    let numeral = |c| "0123456789+-.".contains(c);
    let is_text = |word: &&str| {
        !word.starts_with(numeral) && word.parse::<f64>().is_err()
    };
    let is_comment = words.first().is_none_or(|w| w.starts_with('#'));
    if is_comment || i == 0 && words.iter().all(is_text) {
        return None;
    }
    // Make a point of six numbers
    let number =
        |word: &&str| word.parse().ok().filter(|x| f64::is_finite(*x));
    let numbers: Option<Vec<f64>> = words.iter().map(number).collect();
    let is_decimal =
        |field: &str| field.trim_matches(',').matches(',').count() == 1;
    let hint = "; a decimal sign is a point, as in 0.5";
    let hint = if line.split(is_gap).any(is_decimal) { hint } else { "" };
    let n = i + 1;
    Some(match numbers.as_deref() {
        Some(&[x, y, z, nx, ny, nz]) if hint.is_empty() => {
            Ok((DVec3::new(x, y, z), DVec3::new(nx, ny, nz), n))
        }
        _ => {
            let line = quoted(line);
            let text = format!(
                "expected x y z nx ny nz, six numbers, and not '{line}'{hint}"
            );
            Err(Diagnostic { line: Some(n), ..text.into() }.into())
        }
    })
}

/// The oddity of a point, if it has one.
fn oddity(
    (bvh, frame, zenith, is_oriented): Around,
    hit: &Hit,
) -> Option<Oddity> {
    Some(if bvh.ground_below(hit.point) < -0.75 * LIFT {
        (false, "below the ground")
    } else if has_near(bvh, hit.point, 0.125 * LIFT, |_| true) {
        (false, "on an edge, or too close to a surface")
    } else if frame.is_far(hit.point) {
        (true, "outside by ten times the size of the scene")
    } else if is_oriented && looks_into(bvh, hit) {
        (true, "on a surface into which the normal points")
    } else if is_inside(bvh, hit.point, zenith) {
        INSIDE
    } else {
        return None;
    })
}

/// Whether the normal of a lifted point goes into the surface under it.
fn looks_into(bvh: &Bvh, &Hit { point, normal, .. }: &Hit) -> bool {
    let is_on = |side: f64| {
        has_near(bvh, point - normal * LIFT, LIFT, |&[a, b, c]| {
            let front = side * cross(b - a, c - a);
            front.dot(normal) > 0.125 * front.length()
        })
    };
    is_on(-1.) && !is_on(1.)
}

/// Whether a point sees surfaces alone, and only their backs on the side of
/// the sky, as inside a closed body.
fn is_inside(bvh: &Bvh, origin: DVec3, zenith: DVec3) -> bool {
    (0..RAYS).all(|i| {
        let direction = on_sphere(i);
        let hit =
            |origin, left| bvh.first_hit(&Ray { origin, direction }, left);
        let Some(first) = hit(origin, None) else { return false };
        let is_back = |next: Hit| {
            let gap = next.point.distance(first.point);
            gap < LIFT && bvh.is_on_back(&next)
        };
        let next = || hit(first.point, Some(first.primitive));
        let is_up = zenith.dot(direction) > 0.;
        !is_up || is_back(first) || next().is_some_and(is_back)
    })
}

/// The number of rays that look for the faces around a point.
const RAYS: u32 = 512;

/// The direction of a ray, a point of a spiral.
fn on_sphere(i: u32) -> DVec3 {
    let z = 1. - (2. * f64::from(i) + 1.) / f64::from(RAYS);
    let turns = f64::from(i) * 0.618_033_988_749_894_9;
    let (x, y) = sincos_turns(turns.fract());
    (DVec3::new(x, y, 0.) * (1. - z * z).sqrt()).with_z(z)
}

impl Receivers {
    /// The vertices of triangles.
    pub fn vertices(triangles: &Triangles) -> Self {
        let places = &triangles.vertices;
        let mut normals = vec![DVec3::ZERO; places.len()];
        for corners in &triangles.corners {
            let [a, b, c] = corners.map(|corner| places[corner as usize]);
            let normal = cross(b - a, c - a).normalize();
            let turns = [(b - a, c - a), (c - b, a - b), (a - c, b - c)];
            for (&corner, (to, from)) in corners.iter().zip(turns) {
                let cosine = to.normalize().dot(from.normalize());
                let angle = libm::acos(cosine.clamp(-1., 1.));
                normals[corner as usize] += normal * angle;
            }
        }
        let normals = normals.into_iter().map(DVec3::normalize_or_zero);
        let receivers = places.iter().zip(normals);
        let receivers =
            receivers.map(|(&place, normal)| point(place, normal));
        Self::partition_valid(receivers.collect(), vec![])
    }

    /// Receivers on these sides of faces, given the triangles and the face of
    /// each. With both sides the number is that of the face doubled, plus one
    /// for its back.
    pub fn faces(
        mut triangles: impl Iterator<Item = Triangle>,
        faces: &[u32],
        backs: &[bool],
    ) -> Self {
        let (mut receivers, mut parts) = (vec![], vec![]);
        for face in faces.chunk_by(|a, b| a == b) {
            // Sum the triangles of a face
            let (start, mut cumulative_area) = (parts.len(), 0.);
            for [a, b, c] in triangles.by_ref().take(face.len()) {
                let area = cross(b - a, c - a).length();
                cumulative_area += area;
                if area > 0. {
                    parts.push(([a, b, c], cumulative_area));
                }
            }
            let range = start..parts.len();
            let range = Some(range).filter(|range| !range.is_empty());
            let range = range.ok_or("without area");
            let side =
                |&is_back| Ok(Receiver::Face(range.clone()?, is_back));
            receivers.extend(backs.iter().map(side));
        }
        Self::partition_valid(receivers, parts)
    }
}

/// The sides of a face that receive.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The side from which its corners appear counterclockwise.
    Front,
    /// The other side.
    Back,
    /// Both sides.
    Both,
}

impl Side {
    /// Whether it is the back, for each side.
    pub fn backs(self) -> &'static [bool] {
        match self {
            Self::Front => &[false],
            Self::Back => &[true],
            Self::Both => &[false, true],
        }
    }
}
