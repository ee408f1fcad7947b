// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Numbers and names as people like to read them.

// Write a number with three figures
/// Three significant figures; `unknown` if the number is not finite.
pub fn figures(x: f64) -> String {
    let rounded = format!("{x:.2e}");
    let Some((mantissa, exponent)) = rounded.split_once('e') else {
        return "unknown".to_owned();
    };
    match exponent.parse().unwrap_or(0) {
        _ if x == 0. => "0".to_owned(),
        n @ -3..=5 => format!("{x:.*}", (2 - n).max(0) as usize),
        n => format!("{mantissa}\u{b7}{}", power(n)),
    }
}

/// A power of ten, as in 10 with a raised -3.
pub fn power(exponent: i32) -> String {
    let raised = |c: char| match c {
        '-' => '\u{207b}',
        '1' => '\u{b9}',
        '2' => '\u{b2}',
        '3' => '\u{b3}',
        digit => char::from_u32(digit as u32 + 0x2040).unwrap_or(digit),
    };
    let digits = exponent.to_string();
    "10".chars().chain(digits.chars().map(raised)).collect()
}

// Write a mean with its error
/// A mean and its standard error, both to two figures of the latter.
pub fn with_error(mean: f64, error: Option<f64>) -> String {
    if !mean.is_finite() {
        return "unknown".to_owned();
    }
    let (short, known) = (figures(mean), error.filter(|e| e.is_finite()));
    match known {
        None => format!("{short} (error unknown)"),
        Some(0.) => format!("{short} \u{b1} 0"),
        Some(error) => cut(mean, error),
    }
}

fn cut(mean: f64, error: f64) -> String {
    let rounded = format!("{error:.1e}");
    let exponent = rounded.split_once('e').map(|(_, n)| n.parse::<i32>());
    let places = 1 - exponent.and_then(Result::ok).unwrap_or(0);
    let places = places.clamp(0, 15) as usize;
    format!("{mean:.places$} \u{b1} {error:.places$}")
}

// Write counts and durations
/// A count with its digits in groups of three.
pub fn count(n: u64) -> String {
    match n {
        0..1000 => n.to_string(),
        _ => format!("{}\u{202f}{:03}", count(n / 1000), n % 1000),
    }
}

/// Seconds as seconds, minutes or hours, whichever suits.
pub fn duration(seconds: f64) -> String {
    let whole = seconds as u64;
    match whole {
        0..120 => format!("{} s", figures(seconds)),
        120..7200 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole / 60 % 60),
    }
}

// Keep a name printable and short
/// A name with control characters replaced, and cut after `most`
/// characters.
pub fn short(name: &str, most: usize) -> String {
    let never = ['\u{fffe}', '\u{ffff}'];
    let allowed = |c: char| !c.is_control() && !never.contains(&c);
    let shown = |c: char| if allowed(c) { c } else { '\u{fffd}' };
    let mut short: String = name.chars().take(most).map(shown).collect();
    if name.chars().nth(most).is_some() {
        short.push('\u{2026}');
    }
    short
}
