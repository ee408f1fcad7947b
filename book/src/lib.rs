// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Scenes and measurements for the book and the tests of `litpt`.

pub mod closed_forms;
pub mod courtyard;
pub mod escapes;
pub mod interiors;
pub mod mixtures;
pub mod oracle;
pub mod paths;
pub mod room;
pub mod settings;
pub mod solids;
pub mod sweep;
