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
pub const WIDTH: f64 = 480.;

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
    let space = alone.then_some("http://www.w3.org/2000/svg");
    html! {
        svg xmlns=[space] viewBox=(format!("0 0 {WIDTH} {height}"))
            width=[alone.then_some(2. * WIDTH)]
            height=[alone.then_some(2. * height)]
            color=[alone.then_some("black")] role="img"
            aria-label=(name) font-size="13"
            font-family="Helvetica, Arial, sans-serif"
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

impl Frame {
    /// The middle of the frame.
    pub fn middle(self) -> (f64, f64) {
        (self.x(0.5), self.y(0.5))
    }
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
        let (x, y) = self.middle();
        html! {
            // Draw the lines of the horizontal axis
            g stroke="currentColor" {
                @for place in &across.lines {
                    (line((self.x(*place), top), (self.x(*place), bottom), 0.12))
                }
                @for (place, _) in &across.ticks {
                    (line((self.x(*place), top), (self.x(*place), bottom), 0.4))
                }
            }
            g font-size="12" text-anchor="middle" {
                @for (place, label) in &across.ticks {
                    text x=(self.x(*place)) y=(bottom + 17.) { (label) }
                }
            }
            // Draw the lines of the vertical axis
            g stroke="currentColor" {
                @for place in &up.lines {
                    (line((LEFT, self.y(*place)), (RIGHT, self.y(*place)), 0.12))
                }
                @for (place, _) in &up.ticks {
                    (line((LEFT, self.y(*place)), (RIGHT, self.y(*place)), 0.4))
                }
            }
            g font-size="12" text-anchor="end" {
                @for (place, label) in &up.ticks {
                    text x=(LEFT - 6.) y=(self.y(*place) + 4.) { (label) }
                }
            }
            rect x=(LEFT) y=(top) width=(RIGHT - LEFT) height=(HEIGHT)
                fill="none" stroke="currentColor" {}
            text x=(x) y=(bottom + 36.) text-anchor="middle" {
                (horizontal)
            }
            text x="16" y=(y) text-anchor="middle"
                transform=(format!("rotate(-90 16 {y})")) { (vertical) }
        }
    }
}

fn line(from: (f64, f64), to: (f64, f64), opacity: f64) -> Markup {
    html! {
        line x1=(from.0) y1=(from.1) x2=(to.0) y2=(to.1)
            stroke-opacity=(opacity) {}
    }
}
