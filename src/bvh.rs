// Tangled from chapters/bvh.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Finding the first triangle along a ray.
//!
//! An intersector answers for a whole scene. It works in the scene's
//! coordinates: boxes are single precision, while corners, rays, hits
//! and the test of a triangle are double precision.
//!
//! ```
//! use glam::DVec3;
//! use litpt::{bvh::{Bvh, Intersector}, scene::{Scene, read_obj}};
//!
//! let mesh = read_obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")?;
//! let scene = Scene::new(&mesh);
//! let bvh = Bvh::new(&scene)?;
//! let entrance = scene.frame.entrance(DVec3::new(0.2, 0.2, 5.));
//! let ray = entrance.enter(-DVec3::Z).ok_or("it passes the scene")?;
//! assert!(bvh.first_hit(&ray, None).is_some());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod beam;
mod binary;
mod build;
mod ground;
mod intersector;
#[cfg(target_arch = "x86_64")]
mod kernels;
mod search;
mod spawn;
mod traversal;
mod traverser;
mod triangle;
mod wide;

pub use binary::Quality;
pub use ground::GROUND;
use ground::Ground;
pub use intersector::{BEAM, Batch, Dispatch, Hit, Intersector};
pub use spawn::{is_within, lifted, too_small};
pub use triangle::NONE;

use std::fmt;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::numerics::cross;
use crate::scene::{Ray, Scene, Triangle, Triangles};
#[cfg(target_arch = "x86_64")]
use kernels::Vectors;
use traversal::Portable;
use traverser::Traverser;
use triangle::Leaf;

/// Sets of instructions with which a hierarchy can be traversed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Isa {
    /// Sixteen boxes at a time.
    Avx512,
    /// Eight boxes at a time.
    Avx2,
    /// The instructions of every processor.
    Portable,
}

impl Isa {
    /// All, from the fastest to the slowest.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// Whether this processor has the instructions.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => Traverser::<Vectors, 16>::is_available(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => Traverser::<Vectors, 8>::is_available(),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
            Self::Portable => Traverser::<Portable, 8>::is_available(),
        }
    }

    /// The fastest set that this processor has.
    pub fn best() -> Self {
        let mut sets = Self::ALL.into_iter();
        sets.find(|isa| isa.is_available()).unwrap_or(Self::Portable)
    }
}

impl fmt::Display for Isa {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&format!("{self:?}").to_lowercase())
    }
}

/// A hierarchy over the triangles of a scene, with a traversal through it.
pub struct Bvh(Form);

enum Form {
    #[cfg(target_arch = "x86_64")]
    Avx512(Traverser<Vectors, 16>),
    #[cfg(target_arch = "x86_64")]
    Avx2(Traverser<Vectors, 8>),
    Portable(Traverser<Portable, 8>),
}

macro_rules! with_traverser {
    ($form:expr, $traverser:ident => $answer:expr) => {
        match $form {
            #[cfg(target_arch = "x86_64")]
            Form::Avx512($traverser) => $answer,
            #[cfg(target_arch = "x86_64")]
            Form::Avx2($traverser) => $answer,
            Form::Portable($traverser) => $answer,
        }
    };
}

impl Bvh {
    /// The hierarchy of a scene for a long render on this processor.
    ///
    /// # Errors
    /// Too little memory, or too many triangles; 2^26 always fit.
    pub fn new(scene: &Scene) -> Result<Self> {
        Self::with(scene, Quality::THOROUGH, Isa::best())
    }

    /// The hierarchy of a scene, built to the quality given, on all
    /// threads, for the instructions `isa`.
    ///
    /// # Errors
    /// Instructions that this processor lacks, too little memory, or too
    /// many triangles; 2^26 always fit.
    pub fn with(scene: &Scene, quality: Quality, isa: Isa) -> Result<Self> {
        Self::of(scene.triangles.clone(), quality, isa, &|_| ())
    }

    /// The hierarchy of `triangles` in the coordinates of a scene. Their
    /// memory is given back part by part. The number of triangles in the
    /// hierarchy so far is reported to `placed`.
    ///
    /// # Errors
    /// Those of [`Self::with`].
    pub fn of(
        triangles: Triangles,
        quality: Quality,
        isa: Isa,
        placed: &dyn Fn(usize),
    ) -> Result<Self> {
        if !isa.is_available() {
            let lacks = "this processor lacks the instructions";
            let fault = format!("{lacks} {isa}");
            return Err(Error::value("isa", isa, fault));
        }
        let input = (triangles, quality, placed);
        // SAFETY: the processor has the instructions.
        let form = unsafe {
            match isa {
                #[cfg(target_arch = "x86_64")]
                Isa::Avx512 => Form::Avx512(Traverser::new(input)?),
                #[cfg(target_arch = "x86_64")]
                Isa::Avx2 => Form::Avx2(Traverser::new(input)?),
                _ => Form::Portable(Traverser::new(input)?),
            }
        };
        Ok(Self(form))
    }
}

impl Bvh {
    /// Puts a ground below the scene, given the unit vector to the zenith, or
    /// removes it.
    pub fn set_ground(&mut self, zenith: Option<DVec3>) {
        let ground = zenith.map(|zenith| {
            let mut lowest = f64::INFINITY;
            self.for_each(|_, corners| {
                let heights = corners.map(|corner| zenith.dot(corner));
                lowest = heights.into_iter().fold(lowest, f64::min);
            });
            Ground::under(lowest, zenith)
        });
        with_traverser!(&mut self.0, traverser => traverser.ground = ground);
    }

    /// How far below a point the ground is; infinite without a ground.
    pub fn ground_below(&self, point: DVec3) -> f64 {
        let ground = with_traverser!(&self.0,
            traverser => traverser.ground.as_ref());
        ground.map_or(f64::INFINITY, |ground| ground.below(point))
    }

    /// Whether a hit on a triangle is on its back, from where its corners
    /// appear in clockwise order.
    pub fn is_on_back(&self, hit: &Hit) -> bool {
        let [a, b, c] = with_traverser!(&self.0,
            traverser => traverser.wide.leaves.triangle(hit.primitive));
        cross(b - a, c - a).dot(hit.normal) < 0.
    }

    /// The face of the file, from 0, that a `Hit::primitive` is part of.
    pub fn face(&self, primitive: u32) -> u32 {
        with_traverser!(&self.0,
            traverser => traverser.wide.leaves.face(primitive))
    }

    /// Whether `asked` is true of a triangle and its corners. Only boxes
    /// of which `enters` is true, given their two extreme corners, are
    /// looked into; they are slightly larger than their contents.
    pub fn any_triangle(
        &self,
        enters: impl Fn(DVec3, DVec3) -> bool,
        mut asked: impl FnMut(u32, &Triangle) -> bool,
    ) -> bool {
        let mut asked =
            |_: &Leaf, (_, slot), corners: &_| asked(slot, corners);
        with_traverser!(&self.0, traverser => {
            let wide = &traverser.wide;
            let root = (0, wide.region);
            wide.any(root, [DVec3::MIN, DVec3::MAX], &enters, &mut asked)
        })
    }

    /// Visits all triangles, each with its slot, in the order of the hierarchy.
    pub fn for_each(&self, mut tell: impl FnMut(u32, &Triangle)) {
        let asked = |slot, corners: &Triangle| {
            tell(slot, corners);
            false
        };
        self.any_triangle(|_, _| true, asked);
    }

    /// All triangles, each with its face, in the order of the hierarchy.
    pub fn triangles(&self) -> Vec<(u32, Triangle)> {
        let mut triangles = vec![];
        self.for_each(|slot, corners| {
            triangles.push((self.face(slot), *corners))
        });
        triangles
    }
}
impl Intersector for Bvh {
    fn below(&self, ray: &Ray) -> Option<Hit> {
        with_traverser!(&self.0, traverser => traverser.below(ray))
    }

    fn first_hit(&self, ray: &Ray, from: Option<u32>) -> Option<Hit> {
        with_traverser!(&self.0, traverser => traverser.first_hit(ray, from))
    }

    fn is_visible(
        &self,
        ray: &Ray,
        from: Option<u32>,
        target: u32,
    ) -> bool {
        with_traverser!(&self.0,
            traverser => traverser.is_visible(ray, from, target))
    }

    fn first_hits(&self, rays: &Batch<Ray>) -> Batch<Hit> {
        with_traverser!(&self.0, traverser => traverser.first_hits(rays))
    }

    fn dispatch<W: Dispatch>(&self, work: W) -> W::Output {
        with_traverser!(&self.0, traverser => work.with(traverser))
    }
}
