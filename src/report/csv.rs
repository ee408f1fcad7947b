// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The steps of a run as comma-separated values.

use super::Step;

const HEADER: &str =
    "spp,seconds,rays,rmse,mean,mean_stderr,rmse_reference\n";

/// A header, and a row for each step; what is not known is empty.
pub fn table(steps: &[Step]) -> String {
    HEADER.to_owned() + &steps.iter().map(row).collect::<String>()
}

fn row(step: &Step) -> String {
    let Step { spp, rays, .. } = step;
    let seconds = cell(Some(step.seconds));
    let mean = Some(step.mean);
    let last = [step.rmse, mean, step.mean_stderr, step.rmse_reference];
    format!("{spp},{seconds},{rays},{}\n", last.map(cell).join(","))
}

fn cell(x: Option<f64>) -> String {
    let finite = x.filter(|x| x.is_finite());
    finite.map_or(String::new(), |x| format!("{x:?}"))
}
