// Arrays in large pages (chapter "A wide hierarchy").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use super::*;

#[test]
fn an_array_begins_at_a_large_page_and_is_zero() {
    for length in [0, 1, LARGE / 8, LARGE / 8 + 1] {
        let mut pages = Pages::<u64>::zeroed(length).expect("memory");
        assert_eq!(pages.len(), length);
        assert!(pages.iter().all(|&x| x == 0));
        assert!(pages.as_ptr().addr().is_multiple_of(LARGE));
        pages.fill(1);
        assert_eq!(pages.iter().sum::<u64>(), length as u64);
    }
}

#[test]
fn too_much_memory_is_an_error() {
    for length in [1 << 56, usize::MAX / 8, usize::MAX] {
        assert!(Pages::<u64>::zeroed(length).is_err());
    }
}
