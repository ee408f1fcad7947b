// Draws points of nets, and tabulates how the errors of means over them fall,
// for the chapter "Quasi-Monte Carlo": the argument is the directory for
// "nets.tex" and "nets.csv".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::f64::consts::{E, FRAC_PI_4};
use std::fmt::{Error, Write};
use std::fs;
use std::path::Path;

use litpt::sampler::sobol::{ScrambledNet, scramble_key};
use litpt::sampler::{generator, to_unit};
use rand::RngExt;

use super::Done;

/// The width of a square, in centimetres.
const SIDE: f64 = 4.2;

/// Scrambles of which the errors are the root mean square.
const SCRAMBLES: u64 = 400;

pub fn run(arguments: &[String]) -> Done {
    let directory = arguments.first().ok_or("usage: nets DIRECTORY")?;
    let directory = Path::new(directory);
    fs::write(directory.join("nets.tex"), figure()?)?;
    Ok(fs::write(directory.join("nets.csv"), errors()?)?)
}

/// 64 and 256 points: independent, of a net, and of a scrambled net.
fn figure() -> Result<String, Error> {
    let mut out = String::from("\\begin{tikzpicture}\n");
    for (row, column) in (0..2).flat_map(|r| (0..3).map(move |c| (r, c))) {
        let points = 64 << (2 * row);
        let net = ScrambledNet::new(points);
        let mut random = generator(0, 0, 1);
        let [x, y] = [column, -row].map(|k| 1.1 * SIDE * f64::from(k));
        writeln!(out, "\\begin{{scope}}[shift={{({x:.3},{y:.3})}}]")?;
        write!(out, "\\draw[black!25, step={}] ", SIDE / 8.)?;
        writeln!(out, "(0,0) grid ({SIDE},{SIDE});")?;
        for i in 0..points as u32 {
            let point = match column {
                0 => random.random(),
                1 => net.unscrambled(i, 0),
                _ => net.pair(scramble_key(0, 0, 0), i, 0),
            };
            let [x, y] = point.map(|x| SIDE * to_unit(x));
            writeln!(out, "\\fill ({x:.4},{y:.4}) circle (0.8pt);")?;
        }
        writeln!(out, "\\end{{scope}}")?;
    }
    Ok(out + "\\end{tikzpicture}\n")
}

/// The root mean square errors of means over scrambled nets, of a disc and of
/// a smooth function, in units of the standard deviation of one value.
fn errors() -> Result<String, Error> {
    let mut out = String::from("points,disc,pair\n");
    let (mean, square) = (E - 1., (E * E - 1.) / 2.);
    let deviation = (square.powi(2) - mean.powi(4)).sqrt();
    for n in (0..=12).map(|log| 1 << log) {
        let disc = error(n, FRAC_PI_4, |[x, y]| {
            f64::from(u8::from(x * x + y * y < 1.))
        });
        let smooth = error(n, mean * mean, |[x, y]| libm::exp(x + y));
        let disc = disc / (FRAC_PI_4 * (1. - FRAC_PI_4)).sqrt();
        writeln!(out, "{n},{disc:.4e},{:.4e}", smooth / deviation)?;
    }
    Ok(out)
}

/// The error of means over `n` points.
fn error(n: u32, expected: f64, value: impl Fn([f64; 2]) -> f64) -> f64 {
    let net = ScrambledNet::new(n.into());
    let off = |scramble| {
        let key = scramble_key(1, 0, scramble);
        let points = (0..n).map(|i| net.pair(key, i, 0).map(to_unit));
        points.map(&value).sum::<f64>() / f64::from(n) - expected
    };
    let squares = (0..SCRAMBLES).map(|scramble| off(scramble).powi(2));
    (squares.sum::<f64>() / SCRAMBLES as f64).sqrt()
}
