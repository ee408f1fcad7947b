// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! Merging independent runs as if they had been one.

use std::collections::BTreeMap;

use super::{Blocks, SUBJECT, differing, same_size};
use crate::film::SIDE;
use crate::image::{Image, REPLICATE};

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
        // Refuse a run that lacks the errors of its tiles
        let has = |(_, run): &&Run| run.tile_errors.is_some();
        if let Some((other, _)) = runs.iter().find(has)
            && run.tile_errors.is_none()
        {
            return Err(format!(
                "{name}: it lacks the channel tile_stderr.Y, which {other} has"
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
    let joint = pixels.map(|i| pixel(runs.iter().map(|run| part(run, i))));
    let joint: Vec<_> = joint.collect();
    let samples = |pixel: &Part| pixel.2 * first.replicate();
    Ok(Image {
        width: first.width,
        height: first.height,
        means: joint.iter().map(|pixel| pixel.0).collect(),
        errors: Some(joint.iter().map(|pixel| pixel.1).collect()),
        samples: Some(joint.iter().map(samples).collect()),
        tile_errors: tile_errors(runs),
        attributes,
    })
}

/// Mean, error and independent values.
type Part = (f64, f64, f64);

/// What one run knows of pixel `i`.
fn part((_, run): &Run, i: usize) -> Part {
    let errors = run.errors.as_ref();
    let error = errors.map_or(f64::INFINITY, |errors| errors[i]);
    (run.means[i], error, run.values(i).unwrap_or(0.))
}

/// What all runs together know of a pixel.
fn pixel(runs: impl Iterator<Item = Part> + Clone) -> Part {
    let parts = || runs.clone().filter(|part| part.2 > 0.);
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

/// The errors of the tiles over all runs, if the runs have them.
fn tile_errors(runs: &[Run]) -> Option<Vec<f64>> {
    let pixels = runs.first()?.1.tile_errors.as_ref()?.len();
    let means: Vec<_> = runs.iter().map(scaled_means).collect();
    let part = |((_, run), means): (&Run, &Vec<f64>), i: usize| {
        let errors = run.tile_errors.as_ref();
        let error = errors.map_or(f64::INFINITY, |errors| errors[i]);
        (means[i], error, run.values(i).unwrap_or(0.))
    };
    let runs = runs.iter().zip(&means);
    let joint = |i| pixel(runs.clone().map(|run| part(run, i))).1;
    Some((0..pixels).map(joint).collect())
}

/// The mean of each pixel's tile times the root of its area.
fn scaled_means((_, image): &Run) -> Vec<f64> {
    let tiles = Blocks::new(image, image, SIDE);
    let mut sums: Vec<(f64, f64)> = Vec::new();
    for (i, mean) in image.means.iter().enumerate() {
        let tile = tiles.of(i);
        sums.resize(sums.len().max(tile + 1), (0., 0.));
        if mean.is_finite() {
            sums[tile] = (sums[tile].0 + mean, sums[tile].1 + 1.);
        }
    }
    let scaled = |i| {
        let (sum, pixels) = sums[tiles.of(i)];
        sum / pixels.sqrt().max(1.)
    };
    (0..image.means.len()).map(scaled).collect()
}

/// Attributes that add up.
const SUMS: [&str; 5] =
    ["spp", "rays", "load_seconds", "build_seconds", "render_seconds"];

/// Attributes of the programs that computed an image.
const PROGRAM: [&str; 3] = ["version", "integrator", REPLICATE];

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
