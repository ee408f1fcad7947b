// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Large arrays in large pages of memory.

use std::io;
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;
use std::slice::{from_raw_parts, from_raw_parts_mut};

use bytemuck::Pod;
#[cfg(target_os = "linux")]
use memmap2::Advice;
use memmap2::{MmapMut, MmapOptions};

/// An array that begins at a large page.
pub struct Pages<T> {
    /// Where in the map the elements are.
    first: NonNull<T>,
    length: usize,
    /// Owns the memory.
    _map: MmapMut,
}

// SAFETY: a `Pages` owns its elements, like a `Vec`.
unsafe impl<T: Send> Send for Pages<T> {}
unsafe impl<T: Sync> Sync for Pages<T> {}

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
        let mut map = MmapOptions::new().len(room).map_anon()?;
        let first = map.as_ptr().align_offset(LARGE);
        // Ask for large pages
        #[cfg(target_os = "linux")]
        if bytes >= 4 * LARGE {
            let _ = map.advise_range(Advice::HugePage, first, room - LARGE);
        }
        let first = NonNull::from(&mut map[first..]).cast();
        Ok(Self { first, length, _map: map })
    }
}

impl<T: Pod> Deref for Pages<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        // SAFETY: the map has room for `length` elements from `first`, a
        // multiple of 2 MB, and any bytes are valid ones.
        unsafe { from_raw_parts(self.first.as_ptr(), self.length) }
    }
}

impl<T: Pod> DerefMut for Pages<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as above; and there is no other reference.
        unsafe { from_raw_parts_mut(self.first.as_ptr(), self.length) }
    }
}

#[cfg(test)]
#[path = "../../tests/units/huge_pages.rs"]
mod tests;
