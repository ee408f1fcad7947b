// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command `pt`.

use std::alloc::{GlobalAlloc, Layout, System};
use std::process::{self, ExitCode};

use litpt::progress;
use litpt::session::{Alone, lead};

fn main() -> ExitCode {
    lead(&Alone)
}

/// The system's allocator, which ends the program where there is no memory.
struct Allocator;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

// SAFETY: each call is handed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        granted(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        granted(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(
        &self,
        old: *mut u8,
        layout: Layout,
        size: usize,
    ) -> *mut u8 {
        granted(unsafe { System.realloc(old, layout, size) }, size)
    }

    unsafe fn dealloc(&self, old: *mut u8, layout: Layout) {
        unsafe { System.dealloc(old, layout) }
    }
}

fn granted(memory: *mut u8, size: usize) -> *mut u8 {
    if memory.is_null() && size >= 1 << 20 {
        let size = progress::metric(size as f64);
        progress::error(&format!(
            "too little memory: {size}B more are needed"
        ));
        process::exit(1);
    }
    memory
}
