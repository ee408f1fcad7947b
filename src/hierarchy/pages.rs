// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Large arrays in large pages.

use std::ops::Deref;

use bytemuck::Pod;
use memmap2::{Advice, MmapMut, MmapOptions};

pub struct Pages<T> {
    _map: MmapMut,
    first: *const T,
    length: usize,
}
unsafe impl<T: Sync> Sync for Pages<T> {}
unsafe impl<T: Send> Send for Pages<T> {}

const HUGE: usize = 1 << 21;

impl<T: Pod> Pages<T> {
    /// An array of `length` zeros.
    pub fn zeroed(length: usize) -> std::io::Result<Self> {
        let bytes = length * size_of::<T>();
        let map = MmapOptions::new().len(bytes + HUGE).map_anon()?;
        let start = map.as_ptr().align_offset(HUGE);
        #[cfg(target_os = "linux")]
        if bytes >= 4 * HUGE {
            let _ = map.advise_range(Advice::HugePage, start, bytes);
        }
        let first = map[start..].as_ptr().cast();
        Ok(Self { _map: map, first, length })
    }

    pub fn as_mut_slice(&mut self) -> &mut [T] {
        unsafe {
            std::slice::from_raw_parts_mut(
                self.first.cast_mut(),
                self.length,
            )
        }
    }
}

impl<T: Pod> Deref for Pages<T> {
    type Target = [T];
    #[inline(always)]
    fn deref(&self) -> &[T] {
        unsafe { std::slice::from_raw_parts(self.first, self.length) }
    }
}
