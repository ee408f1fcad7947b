// Tangled from chapters/program.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The command `pt`.

use std::process::ExitCode;

use litpt::cli::run::main_with;
use litpt::integrator::SingleProcess;

fn main() -> ExitCode {
    main_with(&SingleProcess)
}
