// Draws a ring as a fan and as what fills it, for the chapter "Polygons".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::f64::consts::TAU;
use std::fmt::Write;

use litpt::scene::read_obj;

use super::Done;

/// The corners of either outline of the ring.
const CORNERS: usize = 10;

pub fn run(_: &[String]) -> Done {
    let outside = (0..=CORNERS).map(|i| corner(i, 2.2));
    let inside = (0..=CORNERS).rev().map(|i| corner(i, 1.4));
    let ring: Vec<_> = outside.chain(inside).collect();
    let mut text = String::new();
    for [x, y] in &ring {
        writeln!(text, "v {x} {y} 0")?;
    }
    let numbers: Vec<_> = (1..=ring.len()).map(|i| i.to_string()).collect();
    writeln!(text, "f {}", numbers.join(" "))?;
    let filled = read_obj(text.as_bytes())?.triangles;
    let fan = (2..ring.len() as u32).map(|i| [0, i - 1, i]).collect();
    println!("\\begin{{tikzpicture}}[line join=round]");
    draw(&ring, fan, 0., Some(13));
    draw(&ring, filled, 5.5, None);
    println!("\\end{{tikzpicture}}");
    Ok(())
}

fn corner(i: usize, r: f64) -> [f64; 2] {
    let (sin, cos) = (i as f64 * TAU / CORNERS as f64).sin_cos();
    [r * cos, r * sin]
}

/// Draws the triangles, one of them shaded, and the outline over them.
fn draw(
    ring: &[[f64; 2]],
    triangles: Vec<[u32; 3]>,
    shift: f64,
    shaded: Option<usize>,
) {
    let place = |i: usize| {
        let [x, y] = ring[i];
        format!("({:.3},{y:.3})", x + shift)
    };
    for (number, t) in triangles.iter().enumerate() {
        let [a, b, c] = t.map(|i| place(i as usize));
        let fill = match shaded {
            Some(one) if one == number => "fill=black!30,",
            Some(_) => "",
            None => "fill=black!8,",
        };
        println!("\\draw[{fill}very thin] {a}--{b}--{c}--cycle;");
    }
    let all: Vec<_> = (0..ring.len()).map(place).collect();
    println!("\\draw {}--cycle;", all.join("--"));
    println!("\\draw[very thick] {}--{};", all[CORNERS], all[CORNERS + 1]);
    println!("\\fill {} circle (2pt);", all[0]);
}
