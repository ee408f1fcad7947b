// Tangled from chapters/program.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The part for programs: words, files, signals and messages.

pub mod files;
pub mod options;
pub mod progress;
pub mod ranks;
pub mod resolve;
pub mod run;
pub mod values;
pub mod watchdog;
