// Draws points of nets, and tabulates how the errors of means over them fall,
// for the chapter "Quasi-Monte Carlo": the argument is the directory for
// "nets.tex" and "nets.csv".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::fmt::Write;
use std::fs;
use std::path::Path;

use litpt::sampler::generator;
use litpt::sampler::sobol::{ScrambledNet, scramble_key, to_unit};
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
    fs::write(directory.join("nets.csv"), errors()?)?;
    Ok(())
}

/// 64 and 256 points: independent, of a net, and of a scrambled net.
fn figure() -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    writeln!(out, "\\begin{{tikzpicture}}")?;
    for (row, log) in [6, 8].into_iter().enumerate() {
        let net = ScrambledNet::new(1 << log);
        let mut random = generator(0, 0, 1);
        let point = |column: i32, i: u32| match column {
            0 => random.random(),
            1 => net.unscrambled(i, 0),
            _ => net.pair(scramble_key(0, 0, 0), i, 0),
        };
        draw(&mut out, row as f64, 1 << log, point)?;
    }
    writeln!(out, "\\end{{tikzpicture}}")?;
    Ok(out)
}

/// A row of three squares.
fn draw(
    out: &mut String,
    row: f64,
    points: u32,
    mut point: impl FnMut(i32, u32) -> [u32; 2],
) -> std::fmt::Result {
    for column in 0..3 {
        let x = 1.1 * SIDE * f64::from(column);
        let y = -1.1 * SIDE * row;
        write!(out, "\\begin{{scope}}[shift={{({x:.3},{y:.3})}}]")?;
        write!(out, "\\draw[black!25, step={}] ", SIDE / 8.)?;
        writeln!(out, "(0,0) grid ({SIDE},{SIDE});")?;
        for i in 0..points {
            let [x, y] = point(column, i).map(|x| SIDE * to_unit(x));
            writeln!(out, "\\fill ({x:.4},{y:.4}) circle (0.8pt);")?;
        }
        writeln!(out, "\\end{{scope}}")?;
    }
    Ok(())
}

/// A function of four coordinates, with its mean and standard deviation.
pub struct Integrand {
    pub name: &'static str,
    pub value: fn([f64; 4]) -> f64,
    pub mean: f64,
    pub deviation: f64,
}

/// A disc, a half-plane, a smooth function of a pair, and one of all four.
pub fn integrands() -> [Integrand; 4] {
    let of_indicator = |name, value, mean: f64| Integrand {
        name,
        value,
        mean,
        deviation: (mean * (1. - mean)).sqrt(),
    };
    // The means of exp(x) and exp(x/2), and of their squares.
    let [one, half] = [1., 0.5].map(|a| libm::expm1(a) / a);
    let square = libm::expm1(2.) / 2.;
    [
        of_indicator(
            "disc",
            |[x, y, ..]| f64::from(u8::from(x * x + y * y < 1.)),
            std::f64::consts::FRAC_PI_4,
        ),
        // y < x/3 + 1/5.
        of_indicator(
            "half-plane",
            |[x, y, ..]| f64::from(u8::from(y < x / 3. + 0.2)),
            1. / 6. + 0.2,
        ),
        Integrand {
            name: "pair",
            value: |[x, y, ..]| libm::exp(x + y),
            mean: one.powi(2),
            deviation: (square.powi(2) - one.powi(4)).sqrt(),
        },
        Integrand {
            name: "four",
            value: |x| libm::exp(0.5 * x.iter().sum::<f64>()),
            mean: half.powi(4),
            deviation: (one.powi(4) - half.powi(8)).sqrt(),
        },
    ]
}

/// The root mean square errors of means over scrambled nets and over random
/// points, in units of the standard deviation of one value.
fn errors() -> Result<String, std::fmt::Error> {
    let all = integrands();
    let mut out = String::from("points,plain");
    for integrand in &all {
        write!(out, ",{}", integrand.name)?;
    }
    writeln!(out, ",random disc,random pair")?;
    for log in 0..=12 {
        let n = 1u32 << log;
        let net = ScrambledNet::new(u64::from(n));
        write!(out, "{n},{:.4e}", f64::from(n).sqrt().recip())?;
        let scrambled = mean_squares(&all, n, |scramble, i| {
            let key = scramble_key(1, 0, scramble);
            four(net.pair(key, i, 0), net.pair(key, i, 1))
        });
        let random = mean_squares(&all, n, |scramble, i| {
            let mut random = generator(1, scramble, u64::from(i));
            random.random()
        });
        let columns = scrambled.iter().zip(&all);
        let shown = [(&random[0], &all[0]), (&random[2], &all[2])];
        for (square, integrand) in columns.chain(shown) {
            write!(out, ",{:.4e}", square.sqrt() / integrand.deviation)?;
        }
        writeln!(out)?;
    }
    Ok(out)
}

/// The mean square errors of means over `n` points, by the number of a set
/// of points and of a point.
fn mean_squares(
    integrands: &[Integrand; 4],
    n: u32,
    point: impl Fn(u64, u32) -> [f64; 4],
) -> [f64; 4] {
    let mut squares = [0.; 4];
    for set in 0..SCRAMBLES {
        let errors = errors_of(integrands, n, |i| point(set, i));
        for (sum, error) in squares.iter_mut().zip(errors) {
            *sum += error * error / SCRAMBLES as f64;
        }
    }
    squares
}

/// The four coordinates of two pairs.
pub fn four([x, y]: [u32; 2], [z, w]: [u32; 2]) -> [f64; 4] {
    [x, y, z, w].map(to_unit)
}

/// How far the means over `n` points are from what they should be.
pub fn errors_of(
    integrands: &[Integrand; 4],
    n: u32,
    point: impl Fn(u32) -> [f64; 4],
) -> [f64; 4] {
    let mut sums = [0.; 4];
    for x in (0..n).map(point) {
        for (sum, integrand) in sums.iter_mut().zip(integrands) {
            *sum += (integrand.value)(x);
        }
    }
    let error = |k: usize| sums[k] / f64::from(n) - integrands[k].mean;
    [0, 1, 2, 3].map(error)
}
