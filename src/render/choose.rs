// Tangled from chapters/choice.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Chooses how samples are made: the method, how many are placed together,
//! and how many there will be.

mod cost;
mod pilot;
mod policy;
mod sampling;

pub use pilot::Pilot;
pub use policy::default_samples;
pub use policy::{Budget, Choice, MIN_PATHS, Request};
pub(crate) use policy::{
    expected_rays, samples_if_known, samples_to_error,
};
pub use sampling::{Method, Pixels, Sampling, Setup};
