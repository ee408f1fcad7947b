// Tangled from chapters/film.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The sums of an image in the making, or of a part of it: a rectangle of
//! accumulators, cut into tiles along Hilbert's curve.
//!
//! Pixels are counted from the top left of the whole image. Those of one
//! tile lie together in memory, so that threads write to separate pieces.
//! The pixels of a tile hold the same samples, from the first on.
//!
//! ```
//! use litpt::film::{Film, Window};
//!
//! let window = Window { corner: (8, 0), size: (4, 3) };
//! assert_eq!(String::from(window), "8,0,4x3");
//! let film = Film::new(320, 240);
//! assert_eq!((film.area(), film.samples()), (320 * 240, 0));
//! ```

mod errors;
mod fragments;
mod rows;
mod sums;
mod tile;

pub use errors::{ErrorNorm, NEIGHBOUR_WEIGHT, Summary};
pub(crate) use fragments::best_of;
pub use fragments::{Fragment, Fragments, TileFragments};
pub use rows::{Contribution, Entry};
pub use sums::{Film, FilmTile, Gathered, HalfBuffers};
pub use sums::{Samples, Watch, add_samples};
pub(crate) use sums::{UNIT, add_halves};
pub use tile::{MAX_SIDE, SIDE, Tile, Window};
pub use tile::{digits, parse_size, tile_height};
