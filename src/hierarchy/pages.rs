// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Large arrays in large pages of memory.

use std::io;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut, Range};

use bytemuck::Pod;
#[cfg(target_os = "linux")]
use memmap2::Advice;
use memmap2::{MmapMut, MmapOptions};

// Map an array of zeros
/// An array that begins at a large page.
pub struct Pages<T> {
    map: MmapMut,
    /// Where in the map the elements are.
    bytes: Range<usize>,
    elements: PhantomData<[T]>,
}

/// The size of a large page.
const LARGE: usize = 1 << 21;

impl<T: Pod> Pages<T> {
    /// An array of `length` elements, all of whose bits are zero.
    ///
    /// # Errors
    /// The system refuses the memory.
    pub fn zeroed(length: usize) -> io::Result<Self> {
        // Count the bytes without overflow
        let bytes = length
            .checked_mul(size_of::<T>())
            .filter(|&bytes| bytes < isize::MAX as usize - 2 * LARGE)
            .ok_or(io::ErrorKind::OutOfMemory)?;
        let room = bytes.next_multiple_of(LARGE) + LARGE;
        let map = MmapOptions::new().len(room).map_anon()?;
        let first = map.as_ptr().align_offset(LARGE);
        #[cfg(target_os = "linux")]
        if bytes >= 4 * LARGE {
            let _ = map.advise_range(Advice::HugePage, first, room - LARGE);
        }
        let bytes = first..first + bytes;
        Ok(Self { map, bytes, elements: PhantomData })
    }
}

// See the bytes as elements
impl<T: Pod> Deref for Pages<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        bytemuck::cast_slice(&self.map[self.bytes.clone()])
    }
}

impl<T: Pod> DerefMut for Pages<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        bytemuck::cast_slice_mut(&mut self.map[self.bytes.clone()])
    }
}

// Test the large pages
#[cfg(test)]
#[path = "../../tests/units/pages.rs"]
mod tests;
