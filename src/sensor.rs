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
use crate::numerics::{cross, normalise, power_of_two, sincos_turns};
use crate::sampler::{to_unit, within};
use crate::scene::encoding::{self, quoted};
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
    /// Why others have none, and their numbers.
    pub refused: Vec<(Oddity, u32)>,
    /// Why some have a value that may not be meant, and their numbers.
    pub doubted: Vec<(Oddity, u32)>,
}

/// What odd receivers are, or have, in words.
pub type Oddity = &'static str;

/// What is around receivers: surfaces, their frame, and the unit vector to the
/// zenith.
pub type Around<'a> = (&'a Bvh, &'a Frame, DVec3);

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
            point(place.ok_or("are too far away")?, normal)
        });
        Self::sifted(all.collect(), Surface::Points)
    }

    /// Those that may have a value, and the others.
    fn sifted<T>(
        all: Vec<Result<T, Oddity>>,
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
                Err(why) => refused.push((why, number)),
            }
        }
        let (surfaces, doubted) = (surfaces(sound), vec![]);
        Self { numbers, surfaces, refused, doubted }
    }

    /// A point of each.
    pub fn middles(&self) -> Vec<DVec3> {
        let middle = |i| self.hit(i, [1 << 31; 2]).point;
        (0..self.count()).map(middle).collect()
    }

    /// Puts them in the order of their keys, without those that cannot have a
    /// value there.
    pub fn settle(
        &mut self,
        around: Around,
        key: impl Fn(&Hit) -> u64 + Sync,
    ) {
        let is_point = matches!(self.surfaces, Surface::Points(_));
        let all = (0..self.count()).into_par_iter().map(|i| {
            let hit = self.hit(i, [1 << 31; 2]);
            let odd = is_point.then(|| oddity(around, &hit));
            let (is_refused, why) = odd.unwrap_or_default();
            (is_refused, key(&hit), i, why)
        });
        let mut all: Vec<_> = all.collect();
        all.par_sort_unstable();
        // Set odd receivers aside
        let odd = all.iter().filter(|(.., why)| !why.is_empty());
        for &(is_refused, _, i, why) in odd {
            let [sound, none] = [&mut self.doubted, &mut self.refused];
            let odd = if is_refused { none } else { sound };
            odd.push((why, self.numbers[i]));
        }
        self.refused.sort_unstable();
        self.doubted.sort_unstable();
        all.retain(|(is_refused, ..)| !is_refused);
        // Put receivers in order
        let order = all.iter().map(|&(_, _, i, _)| i);
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
fn point(place: DVec3, normal: DVec3) -> Result<Hit, Oddity> {
    let hit = Hit { point: place + normal * LIFT, normal, primitive: NONE };
    let has_normal = normal != DVec3::ZERO && normal.is_finite();
    has_normal.then_some(hit).ok_or("have no normal")
}

/// Whether a triangle of a kind is this close to a point.
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

/// A point, its normal, and the line that they stand in.
type Point = (DVec3, DVec3, u32);

/// Reads points with normals, in the coordinates of the file; a warning tells
/// what was left out of a compressed one. Messages begin with a colon.
///
/// # Errors
/// The line at fault, from 1, and what is wrong with it; or there is no
/// point, or the file cannot be unpacked.
pub fn read_points(
    source: &[u8],
    warnings: &mut Vec<String>,
) -> Result<Vec<Point>, String> {
    let text = encoding::text(source, warnings)?;
    let text = String::from_utf8_lossy(&text).replace("\r\n", "\n");
    let lines: Vec<&str> = text.split(['\n', '\r']).collect();
    let numbered = lines.par_iter().enumerate();
    let points =
        numbered.filter_map(|(i, line)| read_point(i, line).transpose());
    let points: Vec<_> = points.collect::<Result<_, String>>()?;
    let has_some = !points.is_empty();
    has_some.then_some(points).ok_or(": no point".to_owned())
}

/// The point of a line, unless it is a comment, empty, or the head.
fn read_point(i: usize, line: &str) -> Result<Option<Point>, String> {
    let is_gap =
        |c: char| c.is_whitespace() || ";\"\u{feff}\u{1a}".contains(c);
    let words = line.split(|c| is_gap(c) || c == ',');
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    let numeral = |c| "0123456789+-.".contains(c);
    let is_text = |word: &&str| !word.starts_with(numeral);
    let is_comment = words.first().is_none_or(|w| w.starts_with('#'));
    if is_comment || i == 0 && words.iter().all(is_text) {
        return Ok(None);
    }
    // Make a point of six numbers
    let numbers = words.iter().filter_map(|word| word.parse().ok());
    let numbers = numbers.filter(|x: &f64| x.is_finite());
    let numbers: Vec<f64> = numbers.collect();
    let is_decimal =
        |field: &str| field.trim_matches(',').matches(',').count() == 1;
    let hint = match line.split(is_gap).any(is_decimal) {
        true => "; a decimal sign is a point, as in 0.5",
        false => "",
    };
    match numbers[..] {
        [x, y, z, nx, ny, nz] if words.len() == 6 && hint.is_empty() => {
            let normal = DVec3::new(nx, ny, nz);
            Ok(Some((DVec3::new(x, y, z), normal, i as u32 + 1)))
        }
        _ => Err(format!(
            ":{}: expected x y z nx ny nz, six numbers, and not '{}'{hint}",
            i + 1,
            quoted(line)
        )),
    }
}

/// Whether a point has no value, and why; or why it may not be meant. Nothing
/// is said of others.
fn oddity((bvh, frame, zenith): Around, hit: &Hit) -> (bool, Oddity) {
    if bvh.ground_below(hit.point) < -0.75 * LIFT {
        (true, "are below the ground")
    } else if has_near(bvh, hit.point, 0.125 * LIFT, |_| true) {
        (true, "are in an edge, or too close to a surface")
    } else if frame.is_far(hit.point) {
        (false, "are outside by ten times the size of the scene")
    } else if looks_into(bvh, hit) {
        (false, "have a normal into the surface that they lie on")
    } else if is_inside(bvh, hit.point, zenith) {
        (false, "are inside a closed body")
    } else {
        (false, "")
    }
}

/// Whether the normal of a lifted point is into a surface on which it lay.
fn looks_into(bvh: &Bvh, &Hit { point, normal, .. }: &Hit) -> bool {
    has_near(bvh, point - normal * LIFT, LIFT, |&[a, b, c]| {
        let front = cross(b - a, c - a);
        front.dot(normal) < -0.125 * front.length()
    })
}

/// Whether a point sees surfaces alone, and on the side of the sky their
/// backs, as inside a closed body.
fn is_inside(bvh: &Bvh, origin: DVec3, zenith: DVec3) -> bool {
    (0..RAYS).all(|i| {
        let direction = on_sphere(i);
        let ray = |origin| Ray { origin, direction };
        bvh.first_hit(&ray(origin), None).is_some_and(|hit| {
            let left = Some(hit.primitive);
            let next = || bvh.first_hit(&ray(hit.point), left);
            let is_back = |next: Hit| {
                next.point.distance(hit.point) < LIFT
                    && bvh.is_on_back(&next)
            };
            zenith.dot(direction) <= 0.
                || is_back(hit)
                || next().is_some_and(is_back)
        })
    })
}

/// How many rays look for the faces around a point.
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
            let has_area = !own.is_empty();
            let own = has_area.then_some(own).ok_or("have no area");
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
