// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! All tests of the book's programs in one program, which is linked once.

mod calibration;
mod courtyard;
mod escapes;
mod interiors;
mod programs;
