// Tangled from chapters/state.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The identity of a run and its progress: its state, which a file holds as
//! a checkpoint.

pub mod checkpoint;
pub mod learnt;
pub mod shards;
