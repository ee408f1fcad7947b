// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Prints the table of closed forms of the book, as LaTeX rows.

use litpt_book::closed_forms::{Outcome, RHOS, closed_forms};

use super::Done;

const SAMPLES: u64 = 20_000;

pub fn run(_: &[String]) -> Done {
    for (form, seed) in closed_forms().iter().zip((0..).step_by(10)) {
        let outcomes = form.outcomes(SAMPLES, seed)?;
        let at = |rho| outcomes.iter().find(|o| o.rho == rho);
        // Print one row of the table
        print!("{}", form.name);
        match at(0.9) {
            Some(Outcome { exact, pixel, .. }) => {
                let (mean, error) = (pixel.mean(), pixel.standard_error());
                print!(" & {exact:.4} & {mean:.4}({:.0})", 1e4 * error);
            }
            None => print!(" & & "),
        }
        for rho in &RHOS[1..] {
            print!(" & {}", at(*rho).map_or_else(String::new, entry));
        }
        println!(r" \\");
    }
    Ok(())
}

// Write one entry of the table
/// The error in standard errors, or whether there was none.
fn entry(outcome: &Outcome) -> String {
    let Outcome { exact, pixel, .. } = outcome;
    let equal = pixel.mean() == *exact && pixel.variance() == 0.;
    match (outcome.is_certain(), equal) {
        (true, true) => "$=$".to_owned(),
        (true, false) => r"$\neq$".to_owned(),
        (false, _) => match (10. * outcome.z()).round() / 10. {
            0. => "$0.0$".to_owned(),
            z => format!("${z:+.1}$"),
        },
    }
}
