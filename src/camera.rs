// Tangled from chapters/camera.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A pinhole camera: from a point of the image to a direction.
//!
//! Image coordinates run over [0, 1) x [0, 1), from the top left.
//!
//! ```
//! use glam::DVec3;
//! use litpt::camera::{Camera, View};
//!
//! let (position, target) = (DVec3::ZERO, DVec3::Y);
//! let view = View { position, target, up: DVec3::Z, fov: 60. };
//! let camera = Camera::new(&view, 4. / 3.)?;
//! let middle = camera.direction(0.5, 0.5);
//! assert!((middle - DVec3::Y).length() < 1e-12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Its bits belong to `SAMPLE_VERSION`.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::numerics::{bounds, cross, normalise, power_of_two};
use crate::sky::Sky;

/// The place and direction of a camera, in the file's coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct View {
    /// Position of the pinhole.
    pub position: DVec3,
    /// The point in the middle of the image.
    pub target: DVec3,
    /// The direction that is up; not parallel to the view.
    pub up: DVec3,
    /// Vertical field of view in degrees, strictly between 0 and 180.
    pub fov: f64,
}

/// The axes of a view, scaled to the image plane.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// Position of the pinhole in the file's coordinates.
    pub position: DVec3,
    right: DVec3,
    down: DVec3,
    ahead: DVec3,
}

impl Camera {
    /// The camera of a view, for images of the ratio width/height.
    ///
    /// # Errors
    /// A vector that is not finite, a target at the position, an up axis
    /// along the view, a field of view out of range.
    pub fn new(view: &View, aspect: f64) -> Result<Self> {
        let &View { position, target, up, fov } = view;
        if !(fov > 0. && fov < 180.) {
            let fault = format!(
                "the field of view {fov} is not strictly between 0 and \
                 180 degrees"
            );
            return Err(Error::value("fov", fov, fault));
        }
        // Reject vectors that are not finite
        let vectors =
            [("position", position), ("target", target), ("up", up)];
        let is_odd = |(_, vector): &(_, DVec3)| !vector.is_finite();
        if let Some((name, vector)) = vectors.into_iter().find(is_odd) {
            let vector = typed(vector);
            let fault =
                format!("the camera's vector {vector} is not finite");
            return Err(Error::value(name, vector, fault));
        }
        // Find the directions ahead and right
        let view = match target - position {
            whole if whole.is_finite() => whole,
            _ => 0.5 * target - 0.5 * position,
        };
        if view == DVec3::ZERO {
            let target = typed(target);
            let fault = format!(
                "the camera's target is its own position {target}; move \
                 one of them"
            );
            return Err(Error::value("target", target, fault));
        }
        let ahead = normalise(view);
        let right = normalise(cross(ahead, normalise(up)));
        if right == DVec3::ZERO {
            let across = |axis: &DVec3| axis.dot(ahead).abs();
            let mut axes = [DVec3::Y, DVec3::Z, DVec3::X];
            axes.sort_by(|a, b| across(a).total_cmp(&across(b)));
            let fault = format!(
                "the camera's up axis {} is zero or parallel to the \
                 view {}; choose another one, and say where the sky is: \
                 --zenith {} -u {}",
                typed(up),
                typed(view),
                direction(Sky::new(up).zenith),
                typed(axes[0])
            );
            return Err(Error::value("up", typed(up), fault));
        }
        // Scale the axes to the image
        let tangent = libm::tan(0.5 * fov.to_radians());
        let distance = (1. / tangent).min(FARTHEST);
        Ok(Camera {
            position,
            right: right.normalize() * aspect,
            down: normalise(cross(ahead, right)).normalize(),
            ahead: ahead.normalize() * distance,
        })
    }

    /// The direction of the point (`x`, `y`) of the image, of length one.
    #[inline(always)]
    pub fn direction(&self, x: f64, y: f64) -> DVec3 {
        let along_row = self.right * (2. * x - 1.);
        let along_column = self.down * (2. * y - 1.);
        (along_row + along_column + self.ahead).normalize()
    }
}

/// A vector in the form of the command line.
pub fn typed(v: DVec3) -> String {
    format!("{},{},{}", v.x, v.y, v.z)
}

/// A direction in the form of the command line: an axis has a name.
pub fn direction(v: DVec3) -> String {
    let axes = DVec3::AXES.into_iter().zip(["x", "y", "z"]);
    let named = axes.into_iter().find(|&(axis, _)| axis == v);
    named.map_or_else(|| typed(v), |(_, name)| name.to_owned())
}

/// The image plane is no farther than 2^200.
const FARTHEST: f64 = power_of_two(200);

/// A side from which a scene can be seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Viewpoint {
    /// Where y is negative, if z points up; where z is positive, if y does.
    Front,
    /// Opposite to the front.
    Back,
    /// To the left, seen from the front.
    Left,
    /// To the right, seen from the front.
    Right,
    /// The zenith, with the front at the bottom of the image.
    Top,
    /// From the front and right, and above.
    Iso,
}

/// The vector `from`, turned by so many degrees towards another.
fn turned(from: DVec3, to: DVec3, degrees: f64) -> DVec3 {
    let aside = to.reject_from(from).normalize() * from.length();
    let angle = degrees.to_radians();
    from * libm::cos(angle) + aside * libm::sin(angle)
}

impl Viewpoint {
    /// The direction from the scene, turned counter-clockwise about the
    /// zenith and raised by so many degrees; and the up axis of its camera,
    /// which is `up` where possible.
    fn axes(
        self,
        [turn, rise]: [f64; 2],
        zenith: DVec3,
        up: DVec3,
    ) -> [DVec3; 2] {
        let is_y_up = zenith.y.abs() > zenith.z.abs().max(zenith.x.abs());
        let front = if is_y_up { DVec3::Z } else { -DVec3::Y };
        let front = front.reject_from(zenith).normalize();
        let front = turned(front, zenith.cross(front), turn);
        let right = zenith.cross(front);
        let [away, over, up] = match self {
            Self::Front => [front, zenith, up],
            Self::Back => [-front, zenith, up],
            Self::Left => [-right, zenith, up],
            Self::Right => [right, zenith, up],
            Self::Top => [zenith, -front, turned(-front, -zenith, rise)],
            Self::Iso => [1.5 * front + right + zenith, zenith, up],
        };
        [turned(away, over, rise), up]
    }
}

impl View {
    /// The view with this field of view that shows all points from a side,
    /// turned and raised by so many degrees, in images of the ratio
    /// width/height; none if there is none.
    pub fn outside<'a>(
        &self,
        (from, angles): (Viewpoint, [f64; 2]),
        zenith: DVec3,
        points: impl Iterator<Item = &'a DVec3> + Clone,
        aspect: f64,
    ) -> Option<Self> {
        let (low, high) = bounds(points.clone().copied());
        let target = 0.5 * low + 0.5 * high;
        let [away, up] = from.axes(angles, zenith, self.up);
        let size = (high - low).max_element();
        let position = target + size * away;
        let view = Self { position, target, up, ..*self };
        let Camera { right, down, ahead, .. } =
            Camera::new(&view, aspect).ok()?;
        // Move back until all is in the image
        let (right, ahead) = (right / aspect, ahead.normalize());
        let slope = 0.9 * libm::tan(0.5 * self.fov.to_radians());
        let reach = |axis: DVec3, slope: f64| {
            let place = |p: &DVec3, sign: f64| {
                let p = *p - target;
                sign * axis.dot(p) - slope * ahead.dot(p)
            };
            let most = |sign| {
                let places = points.clone().map(|p| place(p, sign));
                places.fold(f64::NEG_INFINITY, f64::max)
            };
            let [more, less] = [most(1.), most(-1.)];
            (0.5 * (more - less) * axis, 0.5 * (more + less) / slope)
        };
        let (across, wide) = reach(right, slope * aspect);
        let (along, high) = reach(down, slope);
        let target = target + across + along;
        let distance = wide.max(high) + 2e-3 * size;
        // Round the view to be typed
        let digits = (4. - libm::log10(size).floor()).clamp(0., 300.);
        let round = |x: f64| {
            let text = format!("{x:.*}", digits as usize);
            text.parse().unwrap_or(x)
        };
        let position = (target - distance * ahead).map(round);
        let target = target.map(round);
        let view = Self { position, target, ..view };
        Camera::new(&view, aspect).is_ok().then_some(view)
    }
}
