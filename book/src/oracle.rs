// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Paths through mixtures of scales, compared with a loop over all triangles
//! in twice the precision of a double.
//!
//! What is asked of each ray, and from where the tolerances come, is said at
//! `Mixture::check`, `judge` and `Mixture::keeps_clear`.

mod twofold;

use std::ops::Range;

use glam::DVec3;
use litpt::bvh::{Bvh, Hit, Intersector, Isa, Quality};
use litpt::sampler::cosine_direction;
use litpt::scene::{Mesh, Ray, Scene, Triangle, Triangles};
use rand::RngExt;
use rand::seq::{IndexedRandom, SliceRandom};
use rand_pcg::Pcg64Mcg;

use crate::escapes::{point, uniform};
use twofold::{Cut, U, cut, gap};

/// An object of a scene, with points inside if it is closed.
#[derive(Clone, Debug)]
pub struct Shape {
    pub triangles: Vec<Triangle>,
    pub inside: Vec<DVec3>,
}

/// What has been seen by some paths.
#[derive(Clone, Copy, Debug, Default)]
pub struct Seen {
    pub rays: usize,
    /// Rays whose first hit was the only one that is allowed.
    pub certain: usize,
    /// Points of paths inside a closed solid.
    pub inside: usize,
    /// Paths that were given up because of a wall along the ray.
    pub excused: usize,
}

impl Seen {
    pub fn add(&mut self, other: Self) {
        self.rays += other.rays;
        self.certain += other.certain;
        self.inside += other.inside;
        self.excused += other.excused;
    }
}

/// A power of ten.
pub fn power(from: f64, to: f64, random: &mut Pcg64Mcg) -> f64 {
    10f64.powf(from + (to - from) * random.random::<f64>())
}

/// How far the origin of a ray may be moved before it is traced: coordinates
/// below 2^-100 count as zero (section "Exact signs").
const MOVED: f64 = f64::from_bits((1023 - 99) << 52);

/// Some objects of very different sizes that meet each other.
pub struct Mixture<'a> {
    scene: Scene,
    /// The triangles in the coordinates of the scene, by their faces.
    triangles: Vec<Placed>,
    /// The largest coordinate.
    reach: f64,
    objects: Vec<Object>,
    bvhs: Vec<(String, Bvh)>,
    random: &'a mut Pcg64Mcg,
}

struct Placed {
    corners: Triangle,
    middle: DVec3,
    radius: f64,
    /// Whether the scene has it; copies and what has no area are left out.
    is_there: bool,
}

struct Object {
    triangles: Range<usize>,
    size: f64,
    is_closed: bool,
    /// Points inside, if it is closed.
    inside: Vec<DVec3>,
}

impl<'a> Mixture<'a> {
    /// The mesh of all shapes.
    ///
    /// # Errors
    /// A finding.
    pub fn new(
        mesh: &Mesh,
        shapes: &[Shape],
        random: &'a mut Pcg64Mcg,
    ) -> Result<Self, String> {
        let scene = Scene::new(mesh);
        let corner = |i: u32| scene.triangles.vertices[i as usize];
        let place = |t: &[u32; 3]| Placed::new(t.map(corner));
        let mut triangles: Vec<_> =
            mesh.triangles.iter().map(place).collect();
        for &face in &scene.triangles.faces {
            triangles[face as usize].is_there = true;
        }
        let mut end = 0;
        let object = |shape: &Shape| {
            let own = end..end + shape.triangles.len();
            end = own.end;
            let flat = |face: &u32| own.contains(&(*face as usize));
            let has_flat = scene.left_out[0].iter().any(flat);
            let corners =
                || triangles[own.clone()].iter().flat_map(|t| t.corners);
            let sides = corners().fold(DVec3::MIN, DVec3::max)
                - corners().fold(DVec3::MAX, DVec3::min);
            let far = corners().map(DVec3::length).fold(0., f64::max);
            let size = sides.max_element();
            let place = |p: &DVec3| scene.frame.entrance(*p).place();
            Object {
                size: if size > 0. { size } else { far },
                is_closed: !shape.inside.is_empty() && !has_flat,
                inside: shape.inside.iter().filter_map(place).collect(),
                triangles: own,
            }
        };
        let objects = shapes.iter().map(object).collect();
        let corners = triangles.iter().flat_map(|t| t.corners);
        let reach =
            corners.map(|p| p.abs().max_element()).fold(0., f64::max);
        let bvhs = bvhs(&scene, random)?;
        Ok(Self { scene, triangles, reach, objects, bvhs, random })
    }

    /// Whether a camera is inside a closed solid, and clear of all triangles.
    pub fn is_dark(&mut self, position: DVec3) -> bool {
        self.scene.frame.entrance(position).place().is_some_and(|place| {
            self.touched(place, MOVED).is_none()
                && self.rooms(place).contains(&Some(true))
        })
    }

    /// Follows so many paths.
    ///
    /// # Errors
    /// A finding.
    pub fn follow(&mut self, paths: usize) -> Result<Seen, String> {
        let mut seen = Seen::default();
        if !self.scene.triangles.corners.is_empty() {
            (0..paths).try_for_each(|_| self.follow_one(&mut seen))?;
        }
        Ok(seen)
    }

    /// Follows a path in all hierarchies at once.
    fn follow_one(&mut self, seen: &mut Seen) -> Result<(), String> {
        let origin = self.camera();
        let Some(direction) = self.towards(origin) else { return Ok(()) };
        let mut ray = Ray { origin, direction };
        let mut from: Vec<Option<u32>> = vec![None; self.bvhs.len()];
        let mut is_clear = self.touched(origin, MOVED).is_none();
        let mut rooms = self.rooms(origin);
        for _ in 0..6 {
            let Some(hit) = self.check(&ray, &mut from, seen)? else {
                return match is_clear && rooms.contains(&Some(true)) {
                    true => Err(format!("{ray:?} leaves a solid")),
                    false => Ok(()),
                };
            };
            if is_clear {
                rooms = match self.keeps_clear(&ray, &hit, &rooms) {
                    Ok(rooms) => rooms,
                    Err(_) if self.is_along_a_wall(&ray, &hit, from[0]) => {
                        seen.excused += 1;
                        return Ok(());
                    }
                    Err(finding) => return Err(finding),
                };
                let is_inside = rooms.contains(&Some(true));
                seen.inside += usize::from(is_inside);
            }
            is_clear &= self.touched(hit.point, MOVED).is_none();
            let Some(direction) = self.onwards(&hit) else { break };
            ray = Ray { origin: hit.point, direction };
        }
        Ok(())
    }

    /// The first hit of a ray, if it is right: the same in all hierarchies,
    /// whatever the instructions, the order of the triangles and the care
    /// of the builder; on a triangle that `judge` allows and, within the
    /// error of its distance, not beyond one that it demands. `from` is the
    /// triangle that the ray leaves in each hierarchy, and becomes the one
    /// that it meets.
    fn check(
        &self,
        ray: &Ray,
        from: &mut [Option<u32>],
        seen: &mut Seen,
    ) -> Result<Option<Hit>, String> {
        let face = |i: usize, slot| self.bvhs[i].1.face(slot);
        let left = from[0].map(|slot| face(0, slot) as usize);
        let mut first = None;
        for (i, (name, bvh)) in self.bvhs.iter().enumerate() {
            let hit = bvh.first_hit(ray, from[i]);
            if bvh.is_occluded(ray, from[i]) != hit.is_some() {
                return Err(format!("{ray:?} {left:?}: {name}: occluded?"));
            }
            if i == 0 {
                seen.rays += 1;
                first = hit;
            }
            let place = |i: usize, hit: Hit| {
                (hit.point, hit.normal, face(i, hit.primitive))
            };
            let [a, b] =
                [first.map(|h| place(0, h)), hit.map(|h| place(i, h))];
            if a != b {
                return Err(format!(
                    "{ray:?} {left:?}: {a:?}, with {name} {b:?}"
                ));
            }
            from[i] = hit.map(|hit| hit.primitive);
        }
        let found = first.map(|hit| face(0, hit.primitive) as usize);
        let number = self.allows(ray, left, found)?;
        seen.certain += usize::from(number == usize::from(found.is_some()));
        Ok(first)
    }

    /// How many triangles may be the first hit; an error if `found` is not
    /// one of them.
    fn allows(
        &self,
        ray: &Ray,
        left: Option<usize>,
        found: Option<usize>,
    ) -> Result<usize, String> {
        let largest = self.reach.max(ray.origin.abs().max_element());
        let all = self.triangles.iter().enumerate();
        let met: Vec<_> = all
            .filter(|&(i, t)| t.is_there && Some(i) != left && t.near(ray))
            .filter_map(|(i, t)| {
                Some((i, judge(ray, &t.corners, largest)?))
            })
            .collect();
        let sure = met.iter().filter(|(_, v)| v.must);
        let end = sure.map(|(_, v)| v.high).fold(f64::INFINITY, f64::min);
        let candidates = met.iter().filter(|(_, v)| v.low <= end);
        let allowed = match found {
            None => end == f64::INFINITY,
            Some(i) => candidates.clone().any(|(k, _)| *k == i),
        };
        if !allowed {
            let candidates: Vec<_> = candidates.collect();
            let own = found.map(|i| {
                let corners = &self.triangles[i].corners;
                (corners, judge(ray, corners, largest))
            });
            return Err(format!(
                "{ray:?} left {left:?}: {found:?} {own:?}, of {candidates:?}"
            ));
        }
        Ok(candidates.count())
    }

    /// In which solids a path goes on; an error if it is not in the same as
    /// before, or not clear of all triangles (chapter "Where the next ray
    /// starts").
    fn keeps_clear(
        &mut self,
        ray: &Ray,
        hit: &Hit,
        before: &[Option<bool>],
    ) -> Result<Vec<Option<bool>>, String> {
        let place = format!("{ray:?} {hit:?}");
        if let Some(i) = self.touched(hit.point, 0.) {
            let corners = &self.triangles[i].corners;
            let gap = gap(hit.point, corners);
            return Err(format!("{place}: {gap:e} from {i}: {corners:?}"));
        }
        let after = self.rooms(hit.point);
        let moved = |(a, b): (&Option<bool>, &Option<bool>)| match (a, b) {
            (Some(a), Some(b)) => a != b,
            _ => false,
        };
        match before.iter().zip(&after).position(moved) {
            Some(i) => Err(format!("{place}: through the wall of {i}")),
            None => Ok(after),
        }
    }

    /// Whether a triangle is within 2^-45 of the size of a hit which lies on
    /// a ray that is almost parallel to it: the one case that the chapter
    /// leaves to chance (section "When to doubt"), and that is not so rare
    /// here, where rays are aimed along walls.
    fn is_along_a_wall(
        &self,
        ray: &Ray,
        hit: &Hit,
        slot: Option<u32>,
    ) -> bool {
        let size = |corners: &Triangle| {
            let span = largest(corners, ray.origin);
            let span = span.max(largest(corners, hit.point));
            let place = hit.point.abs().max(ray.origin.abs());
            (9. * span + place.max_element()) / 8.
        };
        let face = slot.map(|slot| self.bvhs[0].1.face(slot) as usize);
        let own = face.map_or(0., |i| size(&self.triangles[i].corners));
        let is_along = |t: &Placed| {
            let close = 2f64.powi(-45) * size(&t.corners).max(own);
            // The spawn point is as far as that from the hit.
            gap(hit.point, &t.corners) < 2. * close
                && cut(ray, &t.corners, close)
                    .is_some_and(|cut| cut.sine < 2f64.powi(-10))
        };
        self.triangles.iter().any(|t| t.is_there && is_along(t))
    }

    /// A triangle of which a point is not clear as the origin of the next
    /// ray: not farther from it than 6 u R (section "How far is far
    /// enough"), with R seen from the point; or than `least`.
    fn touched(&self, point: DVec3, least: f64) -> Option<usize> {
        let touches = |t: &Placed| {
            let [a, b, c] = t.corners;
            let span = largest(&t.corners, point);
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let beyond = (low - point).max(point - high).max_element();
            let close = 6. * U * span + least;
            t.is_there
                && beyond <= 2. * close
                && gap(point, &t.corners) <= close
        };
        self.triangles.iter().position(touches)
    }

    /// Whether a point is inside of each object, if that can be told.
    fn rooms(&mut self, point: DVec3) -> Vec<Option<bool>> {
        let (objects, random) = (&self.objects, &mut self.random);
        let parity = |object: &Object| {
            let triangles = &self.triangles[object.triangles.clone()];
            let tries = if object.is_closed { 0..20 } else { 0..0 };
            tries.map(|_| uniform(random)).find_map(|direction| {
                parity(triangles, &Ray { origin: point, direction })
            })
        };
        objects.iter().map(parity).collect()
    }

    // --------------------------------------------------- Where rays go

    /// A point of an object, and the object's size.
    fn aim(&mut self) -> (DVec3, f64) {
        let object = self.objects.choose(self.random).expect("an object");
        let own = &self.triangles[object.triangles.clone()];
        let t = own.choose(self.random).expect("a triangle");
        (point(&[t.corners], self.random), object.size)
    }

    /// Where a path begins.
    fn camera(&mut self) -> DVec3 {
        let inside = self.objects.iter().flat_map(|o| &o.inside);
        let inside = inside.collect::<Vec<_>>();
        let inside = inside.choose(self.random).map(|p| **p);
        let place = match (inside, self.random.random_range(0..8)) {
            (Some(inside), 0..4) => inside,
            (_, 7) => uniform(self.random) * self.reach,
            _ => {
                let (aim, size) = self.aim();
                let away = size * power(-3., 2., self.random);
                aim + uniform(self.random) * away
            }
        };
        place.clamp(DVec3::splat(-2e4), DVec3::splat(2e4))
    }

    /// A direction from a point towards an object, or just past it.
    fn towards(&mut self, origin: DVec3) -> Option<DVec3> {
        let (aim, size) = self.aim();
        let aside = match self.random.random_range(0..3) {
            0 => size * power(-18., 0., self.random),
            _ => 0.,
        };
        let any = uniform(self.random);
        match self.random.random_range(0..8) {
            0 => Some(any),
            _ => (aim + any * aside - origin).try_normalize(),
        }
    }

    /// A direction in which a path goes on, not flatter than those of the
    /// sampler.
    fn onwards(&mut self, hit: &Hit) -> Option<DVec3> {
        let aimed = self.towards(hit.point)?;
        let [r, turn] = [self.random.random(), self.random.random()];
        let (cosine, flattest) = (aimed.dot(hit.normal), 1e-7);
        Some(match self.random.random() {
            true if cosine.abs() > flattest => {
                aimed - hit.normal * (cosine - cosine.abs())
            }
            _ => cosine_direction(hit.normal, r, turn),
        })
    }
}

/// One hierarchy for each set of instructions, and two with the triangles in
/// another order, built with less and with more care.
fn bvhs(
    scene: &Scene,
    random: &mut Pcg64Mcg,
) -> Result<Vec<(String, Bvh)>, String> {
    let isas = Isa::ALL.into_iter().filter(|isa| isa.is_available());
    let mut ways: Vec<_> =
        isas.map(|isa| (isa, Quality::FAST, false)).collect();
    ways.push((Isa::best(), Quality::THOROUGH, true));
    ways.push((Isa::Portable, Quality::FAST, true));
    let build = |(isa, quality, mixed): (Isa, Quality, bool)| {
        let all = &scene.triangles;
        let mut order: Vec<_> = (0..all.corners.len()).collect();
        if mixed {
            order.shuffle(random);
        }
        let triangles = Triangles {
            vertices: all.vertices.clone(),
            corners: order.iter().map(|&i| all.corners[i]).collect(),
            faces: order.iter().map(|&i| all.faces[i]).collect(),
        };
        let bvh = Bvh::of(triangles, quality, isa, &|_| ());
        let bvh = bvh.map_err(|error| error.to_string())?;
        Ok((format!("{isa} {quality}, mixed: {mixed}"), bvh))
    };
    ways.into_iter().map(build).collect()
}

impl Placed {
    fn new(corners: Triangle) -> Self {
        let [a, b, c] = corners;
        let middle = a / 3. + b / 3. + c / 3.;
        let radius = corners.map(|p| (p - middle).length());
        let radius = radius.into_iter().fold(0., f64::max);
        Self { corners, middle, radius, is_there: false }
    }

    /// Whether the line of a ray may be near: not if its distance from a
    /// ball around the triangle is clearly more than all errors.
    fn near(&self, ray: &Ray) -> bool {
        let away = self.middle - ray.origin;
        let rounding = 1e-12 * (away.length() + self.radius) + 1e-29;
        away.cross(ray.direction).length()
            <= 1.0001 * self.radius + rounding
    }
}

/// R of the chapters: the largest coordinate of the way from a point to a
/// corner.
fn largest(corners: &Triangle, point: DVec3) -> f64 {
    let sides = corners.map(|p| (p - point).abs().max_element());
    sides.into_iter().fold(0., f64::max) * (1. + 1e-15)
}

/// How the exact first hit may be related to a triangle.
#[derive(Debug)]
struct Verdict {
    /// Whether the triangle must be met.
    must: bool,
    /// The distances at which it may be met.
    low: f64,
    high: f64,
}

/// What the program may say of a ray and a triangle; nothing if the triangle
/// must not be met. The largest coordinate of scene and ray is `most`.
///
/// The program decides exactly for a triangle whose corners are displaced, in
/// sheared coordinates, by up to 4uR, 4uR and uR (section "Why nothing
/// leaks"), and for a line that departs from the ray's by 2 sqrt(2) uR
/// (section "How far is far enough"), together by less than 8.5uR across the
/// ray and uR along it, and by what replaces the coordinates of the origin
/// below 2^-100. So it agrees with us unless the ray is as close as that to
/// the triangle's outline. Its distance is that of a point of the triangle
/// which is as close to the ray, but for 2^-40 R (section "Exact signs").
///
/// Distances below 2^-35 s are accepted by the side on which the origin lies;
/// its height is known to 32uR (section "How far is far enough").
fn judge(ray: &Ray, corners: &Triangle, most: f64) -> Option<Verdict> {
    let span = largest(corners, ray.origin);
    let tiny = 2f64.powi(-100);
    let lost = ray.origin.to_array().map(f64::abs);
    let lost: f64 = lost.into_iter().filter(|&x| x < tiny).sum();
    let aside = 8.5 * U * span + 2. * lost;
    let Cut { is_clear, low, high, plane, sine } =
        cut(ray, corners, aside)?;
    let error = 2f64.powi(-40) * span + 2. * U * span + 2. * lost;
    let (low, high) = (low - error, high + error);
    let near = |size: f64| 2f64.powi(-35) * size;
    // No region has a size of more than this.
    let greatest = near(8. * most);
    let height = plane.abs() * sine;
    let is_told = height > 33. * U * span + 2. * lost;
    if high < -greatest || is_told && plane < 0. && high < near(span) {
        return None;
    }
    let ahead =
        low > greatest || is_told && plane > 0. && low > -near(span);
    Some(Verdict {
        must: is_clear && ahead,
        low: low.max(0.),
        high: high.max(f64::MIN_POSITIVE),
    })
}

/// Whether a ray crosses a surface an odd number of times; unknown if it
/// comes too close to an edge, or starts too close to a triangle.
fn parity(triangles: &[Placed], ray: &Ray) -> Option<bool> {
    let mut is_odd = false;
    for t in triangles.iter().filter(|t| t.near(ray)) {
        let rest = largest(&t.corners, ray.origin) * 2f64.powi(-90);
        let Some(cut) = cut(ray, &t.corners, rest) else { continue };
        if !cut.is_clear || (cut.low <= rest && cut.high >= -rest) {
            return None;
        }
        is_odd ^= cut.low > 0.;
    }
    Some(is_odd)
}
