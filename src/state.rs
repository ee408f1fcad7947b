// Tangled from chapters/state.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! What a run is, and how far it has come: its state, which a file holds as
//! a checkpoint.

pub mod checkpoint;
pub mod learnt;
pub mod shards;
