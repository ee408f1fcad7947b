// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Merging independent runs as if they had been one.

use std::collections::BTreeMap;

use super::{SUBJECT, differing, same_size};
use crate::image::Image;

// Merge the images pixel by pixel
/// An image with the name of its file.
pub type Run = (String, Image);

/// Merges images as if one run had made them. Errors that borrow from
/// the neighbours, as those of `pt` do, keep what each run borrowed.
///
/// # Errors
/// They differ in size or in something that changes the image, they do
/// not say their samples, or they share random numbers.
pub fn merge(runs: &[Run]) -> Result<Image, String> {
    // Refuse what cannot be merged
    let Some((first_name, first)) = runs.first() else {
        return Err("there is nothing to merge".to_owned());
    };
    for (name, run) in runs {
        same_size(first, run)
            .map_err(|e| format!("{first_name} and {name}: {e}"))?;
        if run.errors.is_none() || run.samples.is_none() {
            return Err(format!(
                "{name}: it lacks the channels stderr.Y and samples.Y"
            ));
        }
    }
    // Refuse runs of different images
    for (name, run) in runs {
        let names = SUBJECT.iter().chain(&PROGRAM);
        let differing =
            differing(names, &first.attributes, &run.attributes);
        if !differing.is_empty() {
            return Err(format!(
                "{first_name} and {name} are not runs of one image: {}",
                differing.join(", ")
            ));
        }
    }
    let attributes = attributes(runs)?;
    let pixels = 0..first.means.len();
    let joint: Vec<_> = pixels.map(|i| pixel(runs, i)).collect();
    Ok(Image {
        width: first.width,
        height: first.height,
        means: joint.iter().map(|pixel| pixel.0).collect(),
        errors: Some(joint.iter().map(|pixel| pixel.1).collect()),
        samples: Some(joint.iter().map(|pixel| pixel.2).collect()),
        attributes,
    })
}

/// Mean, error and count of a pixel over all runs.
fn pixel(runs: &[Run], i: usize) -> (f64, f64, f64) {
    // Take what one run knows of the pixel
    let part = |(_, run): &Run| {
        let (errors, samples) = (run.errors.as_ref(), run.samples.as_ref());
        let error = errors.map_or(f64::INFINITY, |errors| errors[i]);
        let count = samples.map_or(0., |samples| samples[i]);
        (run.means[i], error, count)
    };
    let parts = || runs.iter().map(part).filter(|part| part.2 > 0.);
    let count: f64 = parts().map(|(.., n)| n).sum();
    let sum: f64 = parts().map(|(mean, _, n)| n * mean).sum();
    let mean = sum / f64::max(count, 1.);
    // Find the variance of the joint mean
    let deviations = parts().map(|(own, error, n)| {
        let within = if n > 1. { n * (n - 1.) * error * error } else { 0. };
        within + n * (own - mean) * (own - mean)
    });
    let variance = match count > 1. {
        true => deviations.sum::<f64>() / (count * (count - 1.)),
        false => f64::INFINITY,
    };
    (mean, variance.sqrt(), count)
}

// Merge what is known about the runs
/// Attributes that add up.
const SUMS: [&str; 5] =
    ["spp", "rays", "load_seconds", "build_seconds", "render_seconds"];

/// Attributes of the programs that computed an image.
const PROGRAM: [&str; 2] = ["version", "integrator"];

fn attributes(runs: &[Run]) -> Result<BTreeMap<String, String>, String> {
    let mut joint = BTreeMap::new();
    joint.insert("seed".to_owned(), seeds(runs)?);
    let names = runs.iter().flat_map(|(_, run)| run.attributes.keys());
    for name in names.filter(|name| *name != "seed") {
        let value = if SUMS.contains(&name.as_str()) {
            sum(runs, name)
        } else {
            common(runs, name)
        };
        joint.extend(value.map(|value| (name.clone(), value)));
    }
    Ok(joint)
}

/// The seeds of all runs, if they differ.
fn seeds(runs: &[Run]) -> Result<String, String> {
    let mut seen: Vec<(&str, &str)> = Vec::new();
    for (name, run) in runs {
        let own = run.attributes.get("seed").ok_or_else(|| {
            format!(
                "{name}: its seed is unknown, so that it may share \
                     its random numbers with another"
            )
        })?;
        // Refuse a seed that was seen before
        for seed in own.split(',') {
            if let Some((_, other)) = seen.iter().find(|s| s.0 == seed) {
                return Err(format!(
                    "{name}: its seed {seed} is that of {other} too; \
                     render one of them with another seed"
                ));
            }
            seen.push((seed, name));
        }
    }
    Ok(seen.iter().map(|s| s.0).collect::<Vec<_>>().join(","))
}

/// The value of an attribute, if all runs agree.
fn common(runs: &[Run], name: &str) -> Option<String> {
    let value = |run: &Run| run.1.attributes.get(name).cloned();
    let common = value(&runs[0])?;
    let agrees = |run| value(run).as_ref() == Some(&common);
    runs.iter().all(agrees).then_some(common)
}

/// The sum of an attribute over all runs, if all know it.
fn sum(runs: &[Run], name: &str) -> Option<String> {
    let value =
        |(_, run): &Run| run.attributes.get(name)?.parse::<f64>().ok();
    let sum: f64 = runs.iter().map(value).sum::<Option<f64>>()?;
    Some(match sum.fract() {
        0. => format!("{sum}"),
        _ => format!("{sum:.3}"),
    })
}
