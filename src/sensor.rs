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

use crate::bvh::{BEAM, Batch, Bvh, Hit, Intersector, NONE};
use crate::bvh::{is_within, lifted};
use crate::camera::Camera;
use crate::numerics::{cross, normalise, power_of_two};
use crate::sampler::{to_unit, within};
use crate::scene::{Entrance, Frame, Ray, Triangle, Triangles};

/// What starts a sample.
pub enum Sensor {
    /// A camera, and where its rays enter the scene.
    Camera(Camera, Entrance),
    /// Receivers, one for each row of a film of one column.
    Receivers(Receivers),
}

/// Where samples have started.
pub struct Starts {
    /// Where their rays went; those of receivers have none.
    pub directions: [DVec3; BEAM],
    /// The surfaces that they have met, or receivers.
    pub hits: Batch<Hit>,
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
        places: &Batch<Place>,
        (width, height): (u32, u32),
        sees_sky: bool,
    ) -> Starts {
        let (camera, entrance) = match self {
            Self::Camera(camera, entrance) => (camera, entrance),
            Self::Receivers(receivers) => {
                let hit = |((_, y), u): Place| receivers.hit(y as usize, u);
                let hits = array::from_fn(|i| places[i].map(hit));
                let directions = [DVec3::ZERO; BEAM];
                return Starts { directions, hits, rays: 0 };
            }
        };
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
                    *hit =
                        ground_below(intersector, entrance, directions[i]);
                }
            }
        }
        let rays = rays.iter().flatten().count() as u64;
        Starts { directions, hits, rays }
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
                let row = y * receivers.count() as f64;
                let last = receivers.count() - 1;
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

/// The receivers that are asked for.
pub struct Receivers {
    /// The number of each that may have a value, in the order of the film.
    pub numbers: Vec<u32>,
    surfaces: Surface,
    /// The numbers of others, and why they have none.
    pub refused: Vec<(u32, Refusal)>,
}

/// What receives.
enum Surface {
    /// A point, and the normal there.
    Points(Vec<Hit>),
    /// Faces: the triangles of each, and whether it is the back that
    /// receives; and all triangles.
    Faces(Vec<(Range<u32>, bool)>, Vec<Part>),
}

/// A triangle of a face.
struct Part {
    corners: Triangle,
    /// Twice its area, with the triangles of the face before it.
    until: f64,
    /// Its unit normal, at the front.
    normal: DVec3,
}

impl Receivers {
    /// How many.
    pub fn count(&self) -> usize {
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

    /// All points, in the coordinates of the file, and their normals.
    pub fn points(all: &[DVec3], normals: &[DVec3], frame: &Frame) -> Self {
        let all = all.par_iter().zip(normals).map(|(&p, &normal)| {
            let normal = normalise(normal).normalize_or_zero();
            let place = frame.entrance(p).place();
            point(place.ok_or(Refusal::Far)?, normal)
        });
        Self::sifted(all.collect(), Surface::Points)
    }

    /// Those that may have a value, and the others.
    fn sifted<T>(
        all: Vec<Result<T, Refusal>>,
        surfaces: impl FnOnce(Vec<T>) -> Surface,
    ) -> Self {
        let (mut numbers, mut sound, mut refused) =
            (vec![], vec![], vec![]);
        for (number, one) in (0..).zip(all) {
            match one {
                Ok(one) => {
                    numbers.push(number);
                    sound.push(one);
                }
                Err(why) => refused.push((number, why)),
            }
        }
        Self { numbers, surfaces: surfaces(sound), refused }
    }

    /// A point of each.
    pub fn middles(&self) -> Vec<DVec3> {
        let middle = |i| self.hit(i, [1 << 31; 2]).point;
        (0..self.count()).map(middle).collect()
    }

    /// Puts them in the order of their keys; points that are too close to a
    /// surface of the hierarchy are refused.
    pub fn settle(&mut self, bvh: &Bvh, key: impl Fn(&Hit) -> u64 + Sync) {
        let is_point = matches!(self.surfaces, Surface::Points(_));
        let all = (0..self.count()).into_par_iter().map(|i| {
            let hit = self.hit(i, [1 << 31; 2]);
            (is_point && is_close(bvh, hit.point), key(&hit), i)
        });
        let mut all: Vec<_> = all.collect();
        all.par_sort_unstable();
        let close = all.partition_point(|&(is_close, ..)| !is_close);
        let close = all.split_off(close).into_iter();
        let close = close.map(|(.., i)| (self.numbers[i], Refusal::Close));
        self.refused.extend(close);
        self.refused.sort_unstable_by_key(|&(number, _)| number);
        // Put receivers in order
        let order = all.iter().map(|&(.., i)| i);
        self.numbers = order.clone().map(|i| self.numbers[i]).collect();
        match &mut self.surfaces {
            Surface::Points(hits) => {
                *hits = order.map(|i| hits[i]).collect()
            }
            Surface::Faces(faces, _) => {
                *faces = order.map(|i| faces[i].clone()).collect();
            }
        }
    }
}

/// How far points are lifted along their normals: 2^-22 of the longest side
/// that a scene may have, which is 2^13.
const LIFT: f64 = power_of_two(-9);

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

/// A point and its normal.
type Point = (DVec3, DVec3);

/// Reads points with normals, in the coordinates of the file.
///
/// # Errors
/// The line at fault, from 1, and what is wrong with it, to be put behind the
/// name of the file; or there is no point.
pub fn read_points(text: &[u8]) -> Result<Vec<Point>, String> {
    let text = str::from_utf8(text).map_err(|_| ": not UTF-8 text")?;
    let lines: Vec<&str> = text.lines().collect();
    let numbered = lines.par_iter().enumerate();
    let points =
        numbered.filter_map(|(i, line)| read_point(i, line).transpose());
    let points: Vec<_> = points.collect::<Result<_, String>>()?;
    let has_some = !points.is_empty();
    has_some.then_some(points).ok_or(": no point".to_owned())
}

/// The point of a line, unless it is a comment, empty, or the head.
fn read_point(i: usize, line: &str) -> Result<Option<Point>, String> {
    let is_blank = |c: char| c.is_whitespace() || ",;".contains(c);
    let line = line.trim_start_matches('\u{feff}');
    let words: Vec<&str> =
        line.split(is_blank).filter(|word| !word.is_empty()).collect();
    let numbers = words.iter().filter_map(|word| word.parse().ok());
    let numbers: Vec<f64> = numbers.collect();
    let is_head = i == 0 || words.is_empty();
    if line.trim_start().starts_with('#') || numbers.is_empty() && is_head {
        return Ok(None);
    }
    let is_finite = numbers.iter().all(|n| n.is_finite());
    match numbers[..] {
        [x, y, z, nx, ny, nz] if is_finite && words.len() == 6 => {
            Ok(Some((DVec3::new(x, y, z), DVec3::new(nx, ny, nz))))
        }
        _ => Err(format!(
            ":{}: expected x y z nx ny nz, six numbers, and not '{}'",
            i + 1,
            line.trim().escape_debug()
        )),
    }
}

/// Why a receiver has no value.
#[derive(Clone, Copy, PartialEq)]
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
        let normals = normals.iter().map(|n| n.normalize_or_zero());
        let all = places.iter().zip(normals).map(|(&p, n)| point(p, n));
        Self::sifted(all.collect(), Surface::Points)
    }

    /// The faces with these triangles, given the face of each, on one side or
    /// on both; the number of a face on both is doubled, plus one for its back.
    pub fn faces(
        vertices: &[DVec3],
        triangles: &[[u32; 3]],
        faces: &[u32],
        side: Side,
    ) -> Self {
        let backs: &[bool] = match side {
            Side::Front => &[false],
            Side::Back => &[true],
            Side::Both => &[false, true],
        };
        let (mut all, mut parts) = (vec![], vec![]);
        let mut triangles = triangles.iter();
        for face in faces.chunk_by(|a, b| a == b) {
            // Take the triangles of a face
            let start = parts.len() as u32;
            let mut until = 0.;
            for corners in triangles.by_ref().take(face.len()) {
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
            let own = start..parts.len() as u32;
            let own = (!own.is_empty()).then_some(own).ok_or(Refusal::Area);
            let side = |&is_back| Ok((own.clone()?, is_back));
            all.extend(backs.iter().map(side));
        }
        Self::sifted(all, |all| Surface::Faces(all, parts))
    }
}

/// The sides of a face that receive.
#[derive(
    ValueEnum, Clone, Copy, Debug, PartialEq, Serialize, Deserialize,
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
