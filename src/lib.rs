// Tangled from chapters/program.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A Monte-Carlo path tracer for diffuse surfaces under a sky.
//!
//! Each module has a chapter of the book.
//! Lengths are in the scene's own unit; radiance is relative to that of the
//! uniform sky.
//!
//! ```
//! use glam::DVec3;
//! use litpt::analysis::background::KnownPixels;
//! use litpt::{bvh::*, camera::*, film::*, integrator::*, materials::*};
//! use litpt::{render::*, sampler::*, scene::*, sensor::*, sky::*};
//!
//! let obj = "v -1e6 -1e6 0\nv 1e6 -1e6 0\nv 1e6 1e6 0\nv -1e6 1e6 0\n\
//!            f 1 2 3 4\n";
//! let scene = Scene::new(&read_obj(obj.as_bytes())?);
//! let view = View { position: DVec3::new(0., 0., 2.), target: DVec3::ZERO,
//!                   up: DVec3::Y, fov: 70. };
//! let camera = Camera::new(&view, 4. / 3.)?;
//! let sky = Sky::new(DVec3::Z);
//! let integrator = PathTracer::new(Surfaces::of(0.5), sky);
//! let entrance = scene.frame.entrance(view.position);
//! let sensor = Sensor::Camera(camera, entrance);
//! let intersector = Bvh::new(&scene)?;
//!
//! let mut job = Job {
//!     sensor: &sensor, intersector: &intersector,
//!     integrator, known_pixels: KnownPixels::NOTHING,
//!     sampler: IndependentSampler::new(0),
//! };
//! let mut film = Film::new(4, 3);
//! job.pass(&mut film, 2, &|_| true);
//! assert_eq!(film.pixel(0, 0).mean(), 0.5);
//! assert_eq!(film.pixel(0, 0).variance(), 0.);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// No bit of an image shall depend on the C library of a machine.
#![warn(clippy::disallowed_methods)]
#![warn(missing_docs)]

pub mod analysis;
pub mod bvh;
pub mod camera;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
pub mod compare;
pub mod error;
pub mod film;
pub mod filter;
pub mod host;
pub mod image;
pub mod inputs;
pub mod integrator;
pub mod key;
pub mod materials;
pub mod matrix;

pub mod memory;
pub mod numerics;
pub mod output;
pub mod plan;
pub mod render;
pub mod render_loop;
pub mod report;
pub mod run;
pub mod run_output;
pub mod sampler;
pub mod scene;
pub mod sensor;
pub mod sky;
pub mod state;
pub mod statistics;
pub mod tally;

pub mod world;
