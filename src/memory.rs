// Tangled from chapters/wide.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Large arrays in large pages of memory.
//!
//! ```
//! use litpt::memory::{reserved, zeroed};
//!
//! assert_eq!(zeroed::<u64>(3)?, [0; 3]);
//! assert!(reserved::<u64>(usize::MAX / 8).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::io;

use bytemuck::{Zeroable, try_zeroed_vec};

/// An array of zeros; the system provides each part when it is used.
///
/// # Errors
/// The system refuses the memory.
pub fn zeroed<T: Zeroable>(length: usize) -> io::Result<Vec<T>> {
    let array = try_zeroed_vec(length);
    let array = array.map_err(|()| io::ErrorKind::OutOfMemory)?;
    #[cfg(target_os = "linux")]
    ask_for_large_pages(&array);
    Ok(array)
}

/// An empty array with room for so many elements.
///
/// # Errors
/// The system refuses the memory.
pub fn reserved<T>(length: usize) -> io::Result<Vec<T>> {
    let mut array = Vec::new();
    array.try_reserve_exact(length)?;
    #[cfg(target_os = "linux")]
    ask_for_large_pages(array.spare_capacity_mut());
    Ok(array)
}

/// Asks the system for pages of two megabytes, which it may refuse.
#[cfg(target_os = "linux")]
fn ask_for_large_pages<T>(array: &[T]) {
    const LARGE: usize = 1 << 21;
    let range = array.as_ptr_range();
    let start = (range.start as usize).next_multiple_of(LARGE);
    let length = (range.end as usize).saturating_sub(start);
    if length >= 4 * LARGE {
        let start = range.start.cast_mut().with_addr(start).cast();
        // SAFETY: an advice on pages that lie within the array, which
        // changes none of its bytes.
        unsafe { libc::madvise(start, length, libc::MADV_HUGEPAGE) };
    }
}

#[cfg(test)]
#[path = "../tests/units/memory.rs"]
mod tests;
