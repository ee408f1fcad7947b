// Tangled from chapters/sensor.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! What starts a sample: the ray of a camera, or a receiver, which is a point
//! with a normal or a face.

pub mod table;

use std::array;
use std::ops::Range;

use clap::ValueEnum;
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bvh::{BEAM, Bvh, Hit, Intersector, NONE, is_within, lifted};
use crate::camera::Camera;
use crate::numerics::{cross, normalise, power_of_two};
use crate::sampler::{to_unit, within};
use crate::scene::{Entrance, Frame, Ray, Triangle, Triangles};

/// What starts a sample.
pub enum Sensor {
    /// A camera, and where its rays enter the scene.
    Camera(Camera, Entrance),
    /// Receivers, one for each row of an image of one column.
    Receivers(Receivers),
}

/// Where samples have started.
pub struct Starts {
    /// Where their rays went; those of receivers have none.
    pub directions: [DVec3; BEAM],
    /// The surfaces that they have met, or receivers.
    pub hits: [Option<Hit>; BEAM],
    /// The number of rays traced.
    pub rays: u64,
}

/// The pixel of a sample, by column and row, and a point in it.
pub type Place = ((u32, u32), [u32; 2]);

impl Sensor {
    /// Starts samples in an image of this resolution, of which some may be
    /// missing; `sees_sky` if their rays meet nothing.
    #[inline(always)]
    pub fn starts(
        &self,
        intersector: &impl Intersector,
        places: &[Option<Place>; BEAM],
        (width, height): (u32, u32),
        sees_sky: bool,
    ) -> Starts {
        match self {
            Self::Camera(camera, entrance) => {
                let (mut across, mut down) = ([0.; BEAM], [0.; BEAM]);
                for (i, place) in places.iter().enumerate() {
                    if let &Some(((x, y), [u, v])) = place {
                        across[i] = within(x, width, u);
                        down[i] = within(y, height, v);
                    }
                }
                let directions = camera.directions(&across, &down);
                let rays = array::from_fn(|i| match places[i] {
                    Some(_) if !sees_sky => entrance.enter(directions[i]),
                    _ => None,
                });
                let mut hits = intersector.first_hits(&rays);
                if !sees_sky {
                    // Have rays that miss the scene meet the ground
                    for (i, hit) in hits.iter_mut().enumerate() {
                        if places[i].is_some() && rays[i].is_none() {
                            *hit = ground_below(
                                intersector,
                                entrance,
                                directions[i],
                            );
                        }
                    }
                }
                let rays = rays.iter().flatten().count() as u64;
                Starts { directions, hits, rays }
            }
            Self::Receivers(receivers) => {
                let hit = |((_, y), u): Place| receivers.hit(y as usize, u);
                let hits = array::from_fn(|i| places[i].map(hit));
                Starts { directions: [DVec3::ZERO; BEAM], hits, rays: 0 }
            }
        }
    }

    /// Starts a sample at the point (`x`, `y`) of the image: where its ray
    /// goes, if it has one, and what it meets.
    pub fn start(
        &self,
        intersector: &impl Intersector,
        x: f64,
        y: f64,
    ) -> (DVec3, Option<Ray>, Option<Hit>) {
        match self {
            Self::Camera(camera, entrance) => {
                let direction = camera.direction(x, y);
                let ray = entrance.enter(direction);
                let hit = match &ray {
                    Some(ray) => intersector.first_hit(ray, None),
                    None => ground_below(intersector, entrance, direction),
                };
                (direction, ray, hit)
            }
            Self::Receivers(receivers) => {
                let row = y * receivers.len() as f64;
                let last = receivers.len() - 1;
                let u = [x, row.fract()].map(|u| (u * UNITS) as u32);
                let hit = receivers.hit((row as usize).min(last), u);
                (DVec3::ZERO, None, Some(hit))
            }
        }
    }
}

/// Where the ray of a camera that passes the scene by meets the ground.
fn ground_below(
    intersector: &impl Intersector,
    entrance: &Entrance,
    direction: DVec3,
) -> Option<Hit> {
    let origin = entrance.place()?;
    intersector.below(&Ray { origin, direction })
}

/// The integers that a point in a pixel is made of: 2^32.
const UNITS: f64 = power_of_two(32);

/// The receivers of a film, in its order.
#[derive(Clone, Debug, PartialEq)]
pub struct Receivers {
    /// The number of each among all that were asked for.
    pub numbers: Vec<u32>,
    surfaces: Surface,
}

/// What receives.
#[derive(Clone, Debug, PartialEq)]
enum Surface {
    /// A point, and the normal there.
    Points(Vec<Hit>),
    /// Faces: the triangles of each, and whether it is the back that
    /// receives; and all triangles.
    Faces(Vec<(Range<u32>, bool)>, Vec<Part>),
}

/// A triangle of a face.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Part {
    corners: Triangle,
    /// Twice its area, with the triangles of the face before it.
    until: f64,
    /// Its unit normal, at the front.
    normal: DVec3,
}

impl Receivers {
    /// How many.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// The point of receiver `i` that two numbers, uniform over the integers
    /// below 2^32, choose, as a hit on no triangle.
    #[inline]
    pub fn hit(&self, i: usize, u: [u32; 2]) -> Hit {
        let (faces, triangles) = match &self.surfaces {
            Surface::Points(hits) => return hits[i],
            Surface::Faces(faces, triangles) => (faces, triangles),
        };
        let (Range { start, end }, is_back) = &faces[i];
        let parts = &triangles[*start as usize..*end as usize];
        let [u, v] = u.map(to_unit);
        // Choose a point of a face
        let at = u * parts[parts.len() - 1].until;
        let part = parts.partition_point(|part| part.until <= at);
        let before = if part == 0 { 0. } else { parts[part - 1].until };
        let Part { corners, until, normal } = parts[part];
        let [a, b, c] = corners;
        let root = ((at - before) / (until - before)).sqrt();
        let point = a + ((b - a) * (1. - v) + (c - a) * v) * root;
        let normal = if *is_back { -normal } else { normal };
        let point = lifted(&corners, point, normal);
        Hit { point, normal, primitive: NONE }
    }

    /// Those of these numbers, in this order.
    fn in_order(&self, order: impl Iterator<Item = usize> + Clone) -> Self {
        let numbers = order.clone().map(|i| self.numbers[i]).collect();
        let surfaces = match &self.surfaces {
            Surface::Points(hits) => {
                Surface::Points(order.map(|i| hits[i]).collect())
            }
            Surface::Faces(faces, triangles) => {
                let faces = order.map(|i| faces[i].clone()).collect();
                Surface::Faces(faces, triangles.clone())
            }
        };
        Self { numbers, surfaces }
    }
}

/// How far points are lifted along their normals: 2^-22 of the longest side
/// that a scene may have, which is 2^13.
const LIFT: f64 = power_of_two(-9);

/// Receivers that were asked for, not yet in order.
pub struct Candidates {
    /// Those that may have a value.
    pub receivers: Receivers,
    /// The numbers of others, and why they have none.
    pub refused: Vec<(u32, Refusal)>,
    /// The number of all.
    pub count: usize,
}

impl Candidates {
    /// Points in the coordinates of the file.
    pub fn points(points: &[[DVec3; 2]], frame: &Frame) -> Self {
        let all = points.par_iter().map(|&[p, normal]| {
            let normal = normalise(normal).normalize_or_zero();
            let place = frame.entrance(p).place();
            point(place.ok_or(Refusal::Far)?, normal)
        });
        Self::of_points(all.collect())
    }

    fn of_points(all: Vec<Result<Hit, Refusal>>) -> Self {
        let (mut numbers, mut hits, mut refused) = (vec![], vec![], vec![]);
        let count = all.len();
        for (number, hit) in (0..).zip(all) {
            match hit {
                Ok(hit) => {
                    numbers.push(number);
                    hits.push(hit);
                }
                Err(why) => refused.push((number, why)),
            }
        }
        let surfaces = Surface::Points(hits);
        Self { receivers: Receivers { numbers, surfaces }, refused, count }
    }

    /// A point of each.
    pub fn middles(&self) -> Vec<DVec3> {
        let all = 0..self.receivers.len();
        let middle = |i| self.receivers.hit(i, [1 << 31; 2]).point;
        all.map(middle).collect()
    }

    /// The receivers in the order of their keys; points that are too close to
    /// a surface of the hierarchy are refused.
    pub fn settle(
        mut self,
        bvh: &Bvh,
        key: impl Fn(&Hit) -> u64 + Sync,
    ) -> (Receivers, Vec<(u32, Refusal)>) {
        let Receivers { numbers, surfaces } = &self.receivers;
        let is_point = matches!(surfaces, Surface::Points(_));
        let all = (0..numbers.len()).into_par_iter().map(|i| {
            let hit = self.receivers.hit(i, [1 << 31; 2]);
            (is_point && is_close(bvh, hit.point), key(&hit), i)
        });
        let mut all: Vec<_> = all.collect();
        all.par_sort_unstable();
        let close = all.partition_point(|&(is_close, ..)| !is_close);
        let refused = all.split_off(close).into_iter();
        let refused = refused.map(|(.., i)| (numbers[i], Refusal::Close));
        self.refused.extend(refused);
        self.refused.sort_unstable_by_key(|&(number, _)| number);
        let order = all.iter().map(|&(.., i)| i);
        (self.receivers.in_order(order), self.refused)
    }
}

/// A lifted point of the scene.
fn point(place: DVec3, normal: DVec3) -> Result<Hit, Refusal> {
    let hit = Hit { point: place + normal * LIFT, normal, primitive: NONE };
    let has_normal = normal != DVec3::ZERO && normal.is_finite();
    has_normal.then_some(hit).ok_or(Refusal::Normal)
}

/// Whether a surface is closer to a point than an eighth of the lift.
fn is_close(bvh: &Bvh, point: DVec3) -> bool {
    let reach = 0.125 * LIFT;
    let (low, high) = (point - reach, point + reach);
    bvh.any_triangle(
        |a, b| a.cmple(high).all() && low.cmple(b).all(),
        |_, corners| is_within(corners, point, reach),
    )
}

/// Reads points with normals, in the coordinates of the file.
///
/// # Errors
/// The line at fault, from 1, and what is wrong with it, to be put behind the
/// name of the file; or there is no point.
pub fn read_points(text: &[u8]) -> Result<Vec<[DVec3; 2]>, String> {
    let text = str::from_utf8(text).map_err(|_| ": not UTF-8 text")?;
    let lines: Vec<&str> = text.lines().collect();
    let read = |(i, line): (usize, &&str)| read_point(i, line).transpose();
    let numbered = lines.par_iter().enumerate();
    let points: Result<Vec<_>, String> =
        numbered.filter_map(read).collect();
    match points {
        Ok(points) if points.is_empty() => Err(": no point".to_owned()),
        points => points,
    }
}

/// The point of a line, unless it is a comment, empty, or the head.
fn read_point(i: usize, line: &str) -> Result<Option<[DVec3; 2]>, String> {
    let is_blank = |c: char| c.is_whitespace() || ",;".contains(c);
    let line = line.trim_start_matches('\u{feff}');
    let words: Vec<&str> =
        line.split(is_blank).filter(|word| !word.is_empty()).collect();
    let numbers = words.iter().map(|word| word.parse::<f64>());
    let numbers: Vec<_> = numbers.collect();
    if line.trim_start().starts_with('#')
        || (numbers.iter().all(Result::is_err)
            && (i == 0 || words.is_empty()))
    {
        return Ok(None);
    }
    let numbers: Vec<f64> = numbers.into_iter().flatten().collect();
    match numbers[..] {
        [x, y, z, nx, ny, nz]
            if words.len() == 6
                && numbers.iter().all(|n| n.is_finite()) =>
        {
            Ok(Some([DVec3::new(x, y, z), DVec3::new(nx, ny, nz)]))
        }
        _ => Err(format!(
            ":{}: expected x y z nx ny nz, six numbers, and not '{}'",
            i + 1,
            line.trim().escape_debug()
        )),
    }
}

impl Candidates {
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
        let all = places.iter().zip(&normals);
        let all = all.map(|(&place, normal)| {
            point(place, normal.normalize_or_zero())
        });
        Self::of_points(all.collect())
    }

    /// The faces with these triangles, given the face of each, on one side or
    /// on both; the number of a face on both is doubled, plus one for its back.
    pub fn faces(
        vertices: &[DVec3],
        triangles: &[[u32; 3]],
        faces: &[u32],
        side: Side,
    ) -> Self {
        let (mut numbers, mut all, mut refused) = (vec![], vec![], vec![]);
        let mut parts: Vec<Part> = vec![];
        let backs: &[bool] = match side {
            Side::Front => &[false],
            Side::Back => &[true],
            Side::Both => &[false, true],
        };
        let mut first = 0;
        let mut number = 0;
        for face in faces.chunk_by(|a, b| a == b) {
            // Take the triangles of a face
            let start = parts.len() as u32;
            let mut until = 0.;
            for corners in &triangles[first..first + face.len()] {
                let corners =
                    corners.map(|corner| vertices[corner as usize]);
                let [a, b, c] = corners;
                let normal = cross(b - a, c - a);
                let area = normal.length();
                until += area;
                if area > 0. {
                    let normal = normal / area;
                    parts.push(Part { corners, until, normal });
                }
            }
            first += face.len();
            for &is_back in backs {
                match parts.len() as u32 {
                    end if end > start => {
                        numbers.push(number);
                        all.push((start..end, is_back));
                    }
                    _ => refused.push((number, Refusal::Area)),
                }
                number += 1;
            }
        }
        let count = number as usize;
        let surfaces = Surface::Faces(all, parts);
        Self { receivers: Receivers { numbers, surfaces }, refused, count }
    }
}

/// The sides of a face that receive.
#[derive(
    ValueEnum, Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize,
)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// From where its corners go round against the clock.
    Front,
    /// The other.
    Back,
    /// Each of them.
    Both,
}

/// Why a receiver has no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Refusal {
    /// Its normal has the length zero.
    Normal,
    /// It is too close to a surface on which it does not lie.
    Close,
    /// It is far away from the scene.
    Far,
    /// It has no area.
    Area,
}

/// One line that tells of receivers without a value; `name` says what they
/// are, and `number` turns the number of one into words.
pub fn refusals(
    refused: &[(u32, Refusal)],
    count: usize,
    name: &str,
    number: impl Fn(u32) -> String,
) -> Option<String> {
    let kinds = [
        (Refusal::Normal, "have no normal"),
        (Refusal::Close, "are in an edge, or too close to a surface"),
        (Refusal::Far, "are too far away"),
        (Refusal::Area, "have no area"),
    ];
    let told = kinds.into_iter().filter_map(|(kind, words)| {
        let mut of_kind = refused.iter().filter(|&&(_, why)| why == kind);
        let first = number(of_kind.next()?.0);
        Some(format!("{} {words}, the first {first}", 1 + of_kind.count()))
    });
    let told: Vec<String> = told.collect();
    (!told.is_empty()).then(|| {
        let all = refused.len();
        format!(
            "{all} of {count} {name} have no value: {}",
            told.join("; ")
        )
    })
}
