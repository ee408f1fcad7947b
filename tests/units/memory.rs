// Large arrays (chapter "A wide hierarchy").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use super::*;

const LENGTHS: [usize; 5] = [0, 1, 1 << 18, (1 << 18) + 1, 1 << 21];

#[test]
fn an_array_is_zero() {
    for length in LENGTHS {
        let mut array = zeroed::<u64>(length).expect("memory");
        assert_eq!(array.len(), length);
        assert!(array.iter().all(|&x| x == 0));
        array.fill(1);
        assert_eq!(array.iter().sum::<u64>(), length as u64);
    }
}

#[test]
fn an_array_has_the_room_that_was_asked_for() {
    for length in LENGTHS {
        let mut array = reserved::<u64>(length).expect("memory");
        assert!(array.is_empty() && array.capacity() >= length);
        let first = array.as_ptr();
        array.resize(length, 1);
        assert_eq!(array.as_ptr(), first);
        assert_eq!(array.iter().sum::<u64>(), length as u64);
    }
}

#[test]
fn too_much_memory_is_an_error() {
    for length in [1 << 56, usize::MAX / 8, usize::MAX] {
        assert!(zeroed::<u64>(length).is_err());
        assert!(reserved::<u64>(length).is_err());
    }
}
