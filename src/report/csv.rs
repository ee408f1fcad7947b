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
    let known = |x: Option<f64>| {
        let finite = x.filter(|x| x.is_finite());
        finite.map_or(String::new(), |x| format!("{x:?}"))
    };
    let row = |step: &Step| {
        let (seconds, mean) = (known(Some(step.seconds)), step.mean);
        let (rmse, mean) = (known(step.rmse), known(Some(mean)));
        let stderr = known(step.mean_stderr);
        let reference = known(step.rmse_reference);
        let (spp, rays) = (step.spp, step.rays);
        format!(
            "{spp},{seconds},{rays},{rmse},{mean},{stderr},{reference}\n"
        )
    };
    HEADER.to_owned() + &steps.iter().map(row).collect::<String>()
}
