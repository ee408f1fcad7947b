// Tangled from chapters/program.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command `pt`.

use std::env;
use std::process::ExitCode;

use litpt::cli::files::keep_the_place;
use litpt::cli::run::main_with;
use litpt::integrator::SingleProcess;

/// Called when the program is loaded.
#[used]
#[cfg_attr(target_os = "linux", unsafe(link_section = ".init_array"))]
static BEFORE_MAIN: extern "C" fn() = keep_the_place;

fn main() -> ExitCode {
    main_with(env::args_os().collect(), &SingleProcess).into()
}
