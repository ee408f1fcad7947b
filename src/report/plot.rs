// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! The frame that the plots share. Lengths are those of the drawing,
//! which is `WIDTH` wide; y points down.

use maud::{Markup, html};

use super::axis::Ruler;

/// The width of a drawing.
const WIDTH: f64 = 480.;

/// The left, right end of every frame, and its height.
const LEFT: f64 = 70.;
const RIGHT: f64 = 464.;
const HEIGHT: f64 = 260.;

// Begin and end a drawing
/// A drawing of the given height; `alone` if it is not part of a page.
pub fn drawing(
    (height, name): (f64, &str),
    alone: bool,
    content: &Markup,
) -> Markup {
    html! {
        svg viewBox=(format!("0 0 {WIDTH} {height}")) role="img"
            aria-label=(name) font-size="13"
            font-family="Helvetica, Arial, sans-serif"
            // Give a separate drawing size and ink
            xmlns=[alone.then_some("http://www.w3.org/2000/svg")]
            width=[alone.then_some(2. * WIDTH)]
            height=[alone.then_some(2. * height)]
            color=[alone.then_some("black")]
        {
            @if alone {
                rect width=(WIDTH) height=(height) fill="white" {}
            }
            g fill="currentColor" { (content) }
        }
    }
}

// Find places within a frame
/// The rectangle of a plot, by the height of its upper edge.
#[derive(Clone, Copy)]
pub struct Frame {
    /// The y of its upper edge.
    pub top: f64,
}

impl Frame {
    /// The y of its lower edge.
    pub fn bottom(self) -> f64 {
        self.top + HEIGHT
    }

    /// The x of a place on the horizontal axis.
    pub fn x(self, place: f64) -> f64 {
        tenths(LEFT + place * (RIGHT - LEFT))
    }

    /// The y of a place on the vertical axis.
    pub fn y(self, place: f64) -> f64 {
        tenths(self.bottom() - place * HEIGHT)
    }
}

/// Digits that nobody sees are not worth their bytes.
fn tenths(x: f64) -> f64 {
    (x * 10.).round() / 10.
}

// Draw the two axes of a frame
impl Frame {
    /// The border, and the lines and labels of both axes.
    pub fn draw(
        self,
        (across, horizontal): (&Ruler, &str),
        (up, vertical): (&Ruler, &str),
    ) -> Markup {
        let (top, bottom) = (self.top, self.bottom());
        html! {
            (lines(across, |at| [self.x(at), top, self.x(at), bottom]))
            (lines(up, |at| [LEFT, self.y(at), RIGHT, self.y(at)]))
            // Write the labels of both axes
            g font-size="12" text-anchor="middle" {
                @for (at, label) in &across.ticks {
                    text x=(self.x(*at)) y=(bottom + 17.) { (label) }
                }
            }
            g font-size="12" text-anchor="end" {
                @for (at, label) in &up.ticks {
                    text x=(LEFT - 6.) y=(self.y(*at) + 4.) { (label) }
                }
            }
            // Draw the border and the titles
            @let (x, y) = (self.x(0.5), self.y(0.5));
            rect x=(LEFT) y=(top) width=(RIGHT - LEFT) height=(HEIGHT)
                fill="none" stroke="currentColor" {}
            text x=(x) y=(bottom + 36.) text-anchor="middle" { (horizontal) }
            text x="16" y=(y) text-anchor="middle"
                transform=(format!("rotate(-90 16 {y})")) { (vertical) }
        }
    }
}

fn lines(ruler: &Ruler, ends: impl Fn(f64) -> [f64; 4]) -> Markup {
    let thin = ruler.lines.iter().map(|at| (*at, 0.12));
    let thick = ruler.ticks.iter().map(|(at, _)| (*at, 0.4));
    html! {
        g stroke="currentColor" {
            @for (at, opacity) in thin.chain(thick) {
                @let [x1, y1, x2, y2] = ends(at);
                line x1=(x1) y1=(y1) x2=(x2) y2=(y2)
                    stroke-opacity=(opacity) {}
            }
        }
    }
}
