// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! All tests of the tool in one program, which is linked once.

mod common;
mod differential;
#[path = "common/exercise.rs"]
mod exercise;
mod golden;
mod map;
mod markdown;
mod project;
mod properties;
mod regressions;
mod rust_index;
mod untangle;
mod weave_differential;
mod weave_split;
mod weave_streams;
