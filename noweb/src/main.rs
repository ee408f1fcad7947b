// Tangled from noweb/chapters/command.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The `noweb` command; all of it is in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    noweb::command::main()
}
