// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! What a scene, its camera and the options make superfluous.
//!
//! Each fact is proved in the book, and found by a module of its own.

pub mod background;
pub mod boxes;
pub mod interior;
pub mod outlook;

// Name what the facts import
use clap::ValueEnum;
use glam::DVec3;
use serde::Serialize;

use crate::bvh::{Bvh, Isa};
use crate::camera::Camera;
use crate::integrator::{DirectSky, Integrator, PathTracer};
use crate::render::{Job, Renderer};
use crate::sampler::IndependentSampler;
use crate::scene::{Scene, Triangle};
use crate::sky::Sky;
use background::{BackgroundTiles, KnownPixels};
use boxes::Boxes;
use interior::{Parts, above, hidden};
use outlook::{NARROW, Outlook, shares};

// List the facts that are looked for
/// What may be true of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Shortcut {
    /// The camera is inside a closed surface: the image is black
    Dark,
    /// Parts of the image see no triangle: the sky is known
    Bare,
    /// Closed surfaces hide triangles that no path can reach
    Hidden,
    /// Nothing is reflected: it only counts whether a ray is blocked
    Black,
    /// Some surfaces see the sky alone: their radiance is known
    Open,
    /// Some reflected rays leave where the view is free
    Free,
}

impl Shortcut {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Dark,
        Self::Bare,
        Self::Hidden,
        Self::Black,
        Self::Open,
        Self::Free,
    ];

    /// The name that options and reports have for it.
    pub fn name(self) -> String {
        let value = self.to_possible_value();
        value.map_or(String::new(), |value| value.get_name().to_owned())
    }
}

/// The facts by which weights are replaced by their means, and the one
/// that decides which triangles are there when these are looked for.
const WEIGHTY: [Shortcut; 3] =
    [Shortcut::Bare, Shortcut::Open, Shortcut::Hidden];

// Hold what has been found
/// What has been found about one fact.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// Its name.
    pub fact: String,
    /// Whether it holds, so that something is left out.
    pub holds: bool,
    /// What was found, for people.
    pub why: String,
}

/// All that has been found about a scene, and what the renderer takes
/// from it.
pub struct SceneAnalysis {
    /// One for each fact that was looked for, or was not because it would
    /// take too long, and for what the scene has left out already.
    pub findings: Vec<Finding>,
    /// Pixels whose radiance is known.
    pub known: KnownPixels,
    /// What can be seen from each triangle, in the intersector's order.
    outlook: Option<Outlook>,
    /// The boxes for an outlook, if one is wanted.
    boxes: Option<Boxes>,
    /// Whether nothing is reflected.
    is_black: bool,
    /// What the searches have cost, in rays.
    spent: f64,
}

// Weigh the price of a search
/// Prices of the searches for each triangle, in rays.
mod price {
    /// To look whether it is above the camera.
    pub const ABOVE: f64 = 0.1;
    /// To sort its edges, find its part, and ask what is in that.
    pub const PART: f64 = 3.;
    /// To put it into a box.
    pub const BOX: f64 = 1.;
    /// To see whether one of its sides is open.
    pub const OPEN: f64 = 20.;
    /// To find the free cones of both.
    pub const FREE: f64 = 200.;
    /// As a rule so many triangles have their cones found to try them out.
    pub const TRIES: f64 = 200.;
}

/// The share of a render that searches may take.
const SHARE: f64 = 0.02;

/// Why a search is not made.
const LONG: &str = "not looked for, it would take too long";

/// Rays of one second.
const SECOND: f64 = 1e7;

/// What a search may cost in rays that is expected to save a `share` of
/// the render's.
fn worth(rays: f64, share: f64) -> f64 {
    SHARE * rays.min(SECOND) + 0.25 * share * (rays - SECOND).max(0.)
}

/// A share of saved rays that is not worth the question at each hit.
const LITTLE: f64 = 0.03;

// Look for each fact in turn
/// What is asked about a scene.
pub struct Inquiry<'a> {
    /// The camera of the image.
    pub camera: &'a Camera,
    /// Its place among the triangles, if it is not too far away.
    pub place: Option<DVec3>,
    /// The only light.
    pub sky: Sky,
    /// Albedo of every surface.
    pub albedo: f64,
    /// Width and height of the image.
    pub resolution: (u32, u32),
    /// Rays that the render is expected to trace, with one thread.
    pub rays: f64,
    /// Facts that are not to be looked for.
    pub kept: Vec<Shortcut>,
}

impl SceneAnalysis {
    // Look for what needs no hierarchy
    /// Looks for all facts that need no intersector. Triangles that no path
    /// can reach are taken out of the scene.
    pub fn find(scene: &mut Scene, inquiry: &Inquiry) -> Self {
        let mut analysis = Self {
            findings: vec![],
            spent: 0.,
            known: KnownPixels::Nothing,
            outlook: None,
            boxes: None,
            is_black: false,
        };
        analysis.tell_of_the_scene(scene);
        analysis.look_for_walls(scene, inquiry);
        if !analysis.known.is_all() {
            analysis.is_black = analysis.look_for_black(inquiry);
            analysis.look_around(scene, inquiry);
        }
        analysis
    }

    // Tell what has been found
    /// What was left out of the image or its work, in words.
    pub fn left_out(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|finding| finding.holds)
    }

    /// Whether a search that costs so many rays may be made; if so, they are
    /// spent.
    fn affords(&mut self, cost: f64, inquiry: &Inquiry) -> bool {
        let spent = self.spent + cost;
        let affordable = spent <= SHARE * inquiry.rays;
        if affordable {
            self.spent = spent;
        }
        affordable
    }

    /// Tells of all facts that were wanted why they were not looked for.
    fn give_up(
        &mut self,
        analysis: &[Shortcut],
        inquiry: &Inquiry,
        why: &str,
    ) {
        for fact in analysis.iter().filter(|fact| !inquiry.keeps(**fact)) {
            self.tell(fact.name(), false, why.to_owned());
        }
    }

    fn tell(&mut self, fact: impl Into<String>, holds: bool, why: String) {
        self.findings.push(Finding { fact: fact.into(), holds, why });
    }

    // Tell what the scene has left out
    fn tell_of_the_scene(&mut self, scene: &Scene) {
        let (flat, copies) = scene.left_out();
        let words = [
            ("flat", flat, "without area"),
            ("copies", copies, "that have the corners of another"),
        ];
        for (name, count, which) in words {
            let why = format!("{count} triangles {which}");
            self.tell(name, count > 0, why);
        }
    }

    // Look for walls around the camera and others
    fn look_for_walls(&mut self, scene: &mut Scene, inquiry: &Inquiry) {
        let count = scene.triangles().len();
        let wanted = [Shortcut::Dark, Shortcut::Hidden];
        let wanted = wanted.map(|fact| !inquiry.keeps(fact));
        if wanted == [false; 2] {
            return;
        }
        let Some(place) = inquiry.place else { return };
        // Leave walls alone that cost too much
        let cost = count as f64 * (price::PART + price::ABOVE);
        if !self.affords(cost, inquiry) {
            return self.give_up(
                &[Shortcut::Dark, Shortcut::Hidden],
                inquiry,
                LONG,
            );
        }
        let Some(above) = above(scene.triangles(), place) else {
            let why = "the camera is on a surface";
            return self.give_up(
                &[Shortcut::Dark, Shortcut::Hidden],
                inquiry,
                why,
            );
        };
        let parts = Parts::new(scene.triangles());
        let dark = wanted[0] && self.look_for_dark(&parts, &above);
        if !dark && wanted[1] && parts.around(&above).is_empty() {
            self.look_for_hidden(scene, &parts);
        }
    }

    // Look for a closed surface around the camera
    fn look_for_dark(&mut self, parts: &Parts, above: &[u32]) -> bool {
        let around = parts.around(above).len();
        let dark = around > 0;
        // Say whether walls are around it
        let why = match dark {
            true => {
                "closed around the camera: no ray can reach the sky, and \
                     the film is exactly 0"
            }
            false => "no closed surface around the camera",
        };
        self.tell(Shortcut::Dark.name(), dark, why.to_owned());
        if dark {
            self.known = KnownPixels::Dark;
        }
        dark
    }

    // Look for what closed surfaces hide
    fn look_for_hidden(&mut self, scene: &mut Scene, parts: &Parts) {
        let hidden = hidden(scene.triangles(), parts);
        let count = hidden.iter().filter(|&&hidden| hidden).count();
        // Say how many triangles are hidden
        let why = match count {
            0 => "closed surfaces hide nothing".to_owned(),
            _ => format!(
                "{count} triangles inside of closed surfaces, where no path \
                 can go"
            ),
        };
        self.tell(Shortcut::Hidden.name(), count > 0, why);
        if count > 0 {
            scene.forget(&hidden);
        }
    }

    // See whether anything is reflected
    fn look_for_black(&mut self, inquiry: &Inquiry) -> bool {
        if inquiry.keeps(Shortcut::Black) {
            return false;
        }
        let black = inquiry.albedo == 0.;
        // Say whether surfaces are black
        let why = match black {
            true => {
                "nothing is reflected: all bounces; a ray only asks \
                     whether it is blocked"
            }
            false => "surfaces reflect",
        };
        self.tell(Shortcut::Black.name(), black, why.to_owned());
        black
    }

    // Look for pixels and surfaces that see the sky alone
    fn look_around(&mut self, scene: &Scene, inquiry: &Inquiry) {
        let triangles = scene.triangles();
        let cost = triangles.len() as f64 * price::BOX;
        if !self.affords(cost, inquiry) {
            let lost = [Shortcut::Bare, Shortcut::Open, Shortcut::Free];
            let lost = if self.is_black { &lost[..1] } else { &lost };
            return self.give_up(lost, inquiry, LONG);
        }
        let boxes = Boxes::new(triangles);
        if !inquiry.keeps(Shortcut::Bare) {
            self.look_for_bare(triangles, &boxes, inquiry);
        }
        let wanted =
            [Shortcut::Open, Shortcut::Free].map(|f| !inquiry.keeps(f));
        if !self.is_black && !self.known.is_all() && wanted != [false; 2] {
            self.boxes = Some(boxes);
        }
    }

    // Look for tiles that see no triangle
    fn look_for_bare(
        &mut self,
        triangles: &[Triangle],
        boxes: &Boxes,
        inquiry: &Inquiry,
    ) {
        let &Inquiry { camera, sky, resolution, .. } = inquiry;
        let Some(place) = inquiry.place else { return };
        let all = (triangles, boxes);
        let tiles =
            BackgroundTiles::new(*camera, sky, resolution, place, all);
        let (count, bare) = tiles.count();
        // Say how many tiles are bare
        let why = match bare {
            0 => {
                "triangles may be seen in each tile of the image".to_owned()
            }
            _ if bare == count => {
                "no triangle can be seen: all of the film \
                                   is the sky in closed form"
                    .to_owned()
            }
            _ => format!(
                "{bare} of {count} tiles of the film see no triangle: the \
                 sky in closed form"
            ),
        };
        self.tell(Shortcut::Bare.name(), bare > 0, why);
        if bare > 0 {
            self.known = KnownPixels::Bare(tiles);
        }
    }

    // Look for surfaces that see the sky
    /// Looks for what can be found out with the intersector.
    pub fn find_more(
        &mut self,
        scene: &Scene,
        intersector: &Bvh,
        inquiry: &Inquiry,
    ) {
        let Some(boxes) = self.boxes.take() else { return };
        let (numbers, triangles) =
            (intersector.numbers(), intersector.triangles());
        let tries = price::TRIES.min(triangles.len() as f64);
        if !self.affords(tries * price::FREE, inquiry) {
            return self.give_up(
                &[Shortcut::Open, Shortcut::Free],
                inquiry,
                LONG,
            );
        }
        let intersector = (intersector, &numbers[..]);
        let all = (&boxes, &triangles[..]);
        let shares = shares(all, scene, intersector, inquiry.camera);
        let [open, free] = self.weigh(shares, triangles.len(), inquiry);
        if !open && !free {
            return;
        }
        // Make the outlook that is wanted
        let narrow = if free { NARROW } else { 0. };
        let mut outlook =
            Outlook::new(&boxes, &triangles, &numbers, narrow);
        if !open {
            outlook.keep_open();
        }
        self.outlook = Some(outlook);
    }

    // Weigh what open sides and free cones would save
    /// Whether open sides and free cones are wanted, and worth their price
    /// for so many triangles, given the shares of rays that they save.
    fn weigh(
        &mut self,
        [open, free]: [f64; 2],
        count: usize,
        inquiry: &Inquiry,
    ) -> [bool; 2] {
        let worth = |share: f64, price: f64| {
            let affordable = worth(inquiry.rays, share) - self.spent;
            share >= LITTLE && price * count as f64 <= affordable
        };
        let found = [worth(open, price::OPEN), worth(free, price::FREE)];
        let why = [
            "leave surfaces that see nothing but the sky: their radiance in \
             closed form",
            "leave their surface where its view is free",
        ];
        // Tell of both and choose
        let both =
            [Shortcut::Open, Shortcut::Free].into_iter().zip([open, free]);
        let wanted =
            both.zip(found).zip(why).map(|(((fact, share), is), why)| {
                let wanted = !inquiry.keeps(fact);
                if wanted {
                    let why = format!(
                        "some {:.0} of 100 rays {why}",
                        100. * share
                    );
                    self.tell(fact.name(), is, why);
                }
                wanted && is
            });
        let wanted: Vec<_> = wanted.collect();
        [wanted[0], wanted[1]]
    }

    // Make a renderer from the parts that are needed
    /// Forgets the triangles for which no intersector is needed.
    pub fn simplify(&self, scene: &mut Scene) {
        if self.known.is_all() {
            scene.take_triangles();
        }
    }

    /// The renderer for what is needed, with the intersector that was asked for
    /// facts.
    pub fn renderer<'a>(
        &'a self,
        scene: &'a Scene,
        intersector: &'a Bvh,
        inquiry: &Inquiry<'a>,
        seed: u64,
    ) -> Box<dyn Renderer + 'a> {
        let &Inquiry { camera, sky, albedo, .. } = inquiry;
        let known = &self.known;
        let sampler = IndependentSampler::new(seed);
        let job = Job {
            scene,
            intersector,
            camera,
            integrator: (),
            known,
            sampler,
        };
        // Ask only whether the sky is seen
        if self.is_black {
            return estimate(job, DirectSky { sky });
        }
        match &self.outlook {
            Some(foresight) => {
                // Look up what each triangle can see
                estimate(job, PathTracer { albedo, sky, foresight })
            }
            None => {
                // Trace all rays of a path
                let foresight = ();
                estimate(job, PathTracer { albedo, sky, foresight })
            }
        }
    }

    // Tell the journal which weights are closed forms
    /// The limit of samples, given the one that was asked for.
    pub fn samples(&self, asked: Option<u64>) -> Option<u64> {
        asked.or(self.known.is_all().then_some(2))
    }

    /// The facts that hold and matter to the weights.
    pub fn weighty(&self) -> Vec<String> {
        let names = WEIGHTY.map(Shortcut::name);
        let closed = self.left_out().filter(|f| names.contains(&f.fact));
        closed.map(|finding| finding.fact.clone()).collect()
    }

    /// The intersector and the estimator that are needed, in words.
    pub fn parts(&self, isa: Isa) -> String {
        let integrator = match (self.is_black, &self.outlook) {
            _ if self.known.is_all() => return "none: no ray".to_owned(),
            (true, _) => {
                "silhouette: one ray a path, which asks for any hit"
            }
            (_, Some(_)) => {
                "reference, with the free view of each triangle"
            }
            _ => "reference",
        };
        format!("{isa}; estimator {integrator}")
    }
}

impl Inquiry<'_> {
    fn keeps(&self, fact: Shortcut) -> bool {
        self.kept.contains(&fact)
    }

    // Follow a run that is resumed
    /// Finds of the facts that matter to weights those that were found
    /// `before`, whatever it takes, and no others.
    pub fn follow(&mut self, before: &[String]) {
        let known = |fact: &Shortcut| before.contains(&fact.name());
        if WEIGHTY.iter().any(known) {
            self.rays = f64::INFINITY;
        }
        self.kept.extend(WEIGHTY.into_iter().filter(|fact| !known(fact)));
    }
}

/// A job with this estimator.
fn estimate<'a, E: Integrator + 'a>(
    job: Job<'a, Bvh, ()>,
    integrator: E,
) -> Box<dyn Renderer + 'a> {
    let Job { scene, intersector, camera, known, sampler, .. } = job;
    Box::new(Job { scene, intersector, camera, integrator, known, sampler })
}
