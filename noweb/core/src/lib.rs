// Tangled from noweb/chapters/core.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A tangler: from the chapters of a literate program to its files.
//!
//! Text is bytes throughout, for the prose may be in any encoding.

pub mod comment;
pub mod conflict;
pub mod cpif;
pub mod diagnostic;
pub mod markup;
pub mod project;
pub mod tangle;
pub mod web;
