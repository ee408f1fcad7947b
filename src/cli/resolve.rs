// Tangled from chapters/options.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From what was typed to a plan: each default is resolved here, and what
//! does not fit together is refused.

use std::path::{Path, PathBuf};

use clap::{Arg, CommandFactory};
use glam::DVec3;
use serde_json::json;

use super::options::{Error, Options, usage};
use super::values::Norm;
use crate::error;
use crate::film::{ErrorNorm, SIDE, Window};
use crate::image::Format;
use crate::key::Part;
use crate::output::{descriptor, format_of};
use crate::plan::{Budget, CameraPlan, Outputs, Plan, Product, SensorPlan};
use crate::plan::{SkyPlan, Stand, SurfacePlan, is_dash};
use crate::render::choose::default_samples;
use crate::report::Kind;
use crate::sensor::table::TableFormat;
use crate::sky::Sky;
use crate::state::shards::is_state_name;

impl Options {
    /// The plan of a run, of which a part may have been saved; a picture that
    /// is not named is a PNG beside the scene if standard output is a
    /// terminal.
    ///
    /// # Errors
    /// Options do not fit together, or may not change what was saved.
    pub fn plan(
        &self,
        saved: Option<&Plan>,
        is_terminal: bool,
    ) -> Result<Plan, Error> {
        let fault = |fault: String| usage(fault, "pt");
        let plan = match saved {
            None => {
                let mut plan = self.new_plan();
                plan.outputs = self.new_outputs(&plan, is_terminal)?;
                plan
            }
            Some(saved) => self.resumed(saved)?,
        };
        match self.misfit(&plan) {
            Some(misfit) => Err(fault(misfit)),
            None => Ok(plan),
        }
    }

    /// The plan of a new run, without its outputs.
    fn new_plan(&self) -> Plan {
        let Self { scene, limits, parts, execution, .. } = self;
        let named = scene.scene.as_ref().or(scene.input.as_ref());
        let unnamed = |(name, _): &&(String, f64)| name.is_empty();
        let all = &scene.albedos;
        let surfaces = SurfacePlan {
            albedo: all.iter().rev().find(unnamed).map_or(1., |&(_, a)| a),
            named: all.iter().filter(|a| !unnamed(a)).cloned().collect(),
            materials: scene.materials,
            band: scene.band,
        };
        let mut plan = Plan {
            scene: named.cloned().unwrap_or("-".into()),
            sensor: self.sensor(),
            up: self.camera.up,
            surfaces,
            sky: SkyPlan {
                cover: scene.sky,
                zenith: scene.zenith,
                ground: scene.ground,
            },
            method: limits.integrator,
            seed: limits.seed,
            cache: parts.cache.clone(),
            shortcuts: !execution.no_shortcuts,
            threads: execution.threads,
            isa: execution.isa,
            reference: self.outputs.reference.clone(),
            ..Plan::default()
        };
        self.limit(&mut plan);
        plan.part = self.part(&plan);
        plan
    }

    /// What senses the light.
    fn sensor(&self) -> SensorPlan {
        let Self { camera, receivers, .. } = self;
        if let Some(path) = &receivers.points {
            return SensorPlan::Points(path.clone());
        }
        if let Some(side) = receivers.faces {
            let radiosity = receivers.radiosity;
            return SensorPlan::Faces { side, radiosity };
        }
        if receivers.vertices {
            return SensorPlan::Vertices;
        }
        let stand = match (camera.position, camera.target) {
            (None, None) => Stand::Outside(
                camera.viewpoint.unwrap_or(crate::camera::Viewpoint::Iso),
            ),
            (position, target) => Stand::At(
                position.unwrap_or(DVec3::ZERO),
                target.unwrap_or(DVec3::Y),
            ),
        };
        SensorPlan::Camera(CameraPlan {
            resolution: camera.resolution,
            crop: camera.crop,
            stand,
            fov: camera.fov,
            background: camera.background,
        })
    }

    /// Sets when a run ends, and which part of it there is.
    fn limit(&self, plan: &mut Plan) {
        let limits = &self.limits;
        let error = limits.error.map(|(error, relative)| {
            let largest = matches!(limits.error_norm, Norm::Max);
            (error, ErrorNorm { relative, largest })
        });
        let is_open = limits.time.is_none() && error.is_none();
        let usual = default_samples(plan.camera().is_none());
        let samples = limits.samples.or(is_open.then_some(usual));
        plan.budget = Budget { samples, time: limits.time, error };
    }

    /// The part of a run, which may be one already; none without -n.
    fn part(&self, plan: &Plan) -> Option<Part> {
        let (saved, parts) = (plan.part, &self.parts);
        let is_part = parts.range.is_some() || parts.tiles.is_some();
        let of = match saved {
            None => self.limits.samples.filter(|_| is_part)?,
            Some(_) => plan.budget.samples?,
        };
        let samples = parts.range.or(saved.map(|part| part.samples));
        let band = parts.tiles.or(saved.map(|part| part.band));
        let samples = samples.unwrap_or((0, of));
        Some(Part { samples, of, band: band.unwrap_or((1, 1)) })
    }

    /// What a new run writes.
    fn new_outputs(
        &self,
        plan: &Plan,
        is_terminal: bool,
    ) -> Result<Outputs, Error> {
        let Self { outputs, parts, execution, .. } = self;
        let is_named =
            !outputs.output.is_empty() || outputs.format.is_some();
        let shows = plan.camera().is_some() && !execution.dry_run;
        let mut all = Outputs {
            force: outputs.force,
            checkpoint_interval: parts.checkpoint_interval.unwrap_or(60.),
            preview: outputs.preview,
            exposure: outputs.exposure,
            filter: !outputs.no_filter,
            ..Outputs::default()
        };
        all.files = self.files(plan, &outputs.output)?;
        if !is_named && shows && is_terminal && !is_dash(&plan.scene) {
            let image = (Product::Image(Format::Png), beside(&plan.scene));
            all.files[0] = image;
            all.exposure = all
                .exposure
                .or(Some(crate::compare::display::Exposure::Auto));
        }
        Ok(all)
    }

    /// The files that are typed, and what they hold: first images or values,
    /// standard output if none is named; then the state; then reports.
    fn files(
        &self,
        plan: &Plan,
        named: &[PathBuf],
    ) -> Result<Vec<(Product, PathBuf)>, Error> {
        let usual = self.outputs.format.unwrap_or(Format::Pgm);
        let has_vertices = plan.sensor == SensorPlan::Vertices;
        let is_list = plan.camera().is_none();
        let (states, mut images): (Vec<_>, Vec<_>) =
            named.iter().cloned().partition(|path| is_state_name(path));
        if named.is_empty() {
            images.push("-".into());
        }
        let image = |path: PathBuf| {
            let product = match is_list {
                true => {
                    Product::Table(TableFormat::of(&path, has_vertices)?)
                }
                false => Product::Image(format_of(&path, usual)?),
            };
            Ok((product, path))
        };
        // Find the one state of the run
        let states =
            self.parts.checkpoint.clone().into_iter().chain(states);
        let states: Vec<_> =
            states.map(|path| (Product::State, path)).collect();
        if states.len() > 1 {
            let fault =
                "a run has one state, which --checkpoint or one -o names";
            return Err(usage(fault, "pt"));
        }
        let report = |path: &PathBuf| match Kind::of(path)? {
            Kind::Html if is_list => {
                let fault =
                    "a page shows an image, and receivers have none";
                Err(error::Error::from(fault).of_file(path))
            }
            kind => Ok((Product::Report(kind), path.clone())),
        };
        let images = images.into_iter().map(image);
        let reports = self.outputs.report.iter().map(report);
        let all = images.chain(states.into_iter().map(Ok)).chain(reports);
        Ok(all.collect::<error::Result<_>>()?)
    }

    /// The plan of a run that goes on: of what is typed, limits, outputs, the
    /// threads and the instructions are taken; all else has to be as it was.
    fn resumed(&self, saved: &Plan) -> Result<Plan, Error> {
        let has = |names: &[&str]| {
            self.given.iter().any(|given| names.contains(&&given[..]))
        };
        self.refuse_other_samples(saved)?;
        let mut plan = saved.clone();
        if has(&["samples", "time", "error", "error_norm"]) {
            self.limit(&mut plan);
        }
        plan.part = self.part(&plan).or(plan.part);
        let Self { scene, outputs, parts, execution, .. } = self;
        if let (SensorPlan::Points(old), Some(new)) =
            (&mut plan.sensor, &self.receivers.points)
        {
            old.clone_from(new);
        }
        plan.method = self.limits.integrator.or(plan.method);
        let reference = outputs.reference.clone();
        plan.reference = reference.or(plan.reference);
        if let Some(path) = scene.scene.as_ref().or(scene.input.as_ref()) {
            plan.scene.clone_from(path);
        }
        plan.shortcuts &= !execution.no_shortcuts;
        plan.threads = execution.threads.or(plan.threads);
        plan.isa = execution.isa.or(plan.isa);
        // Take the files that are named anew, and keep the others
        let typed = self.files(&plan, &outputs.output)?;
        let is_state = |file: &(Product, _)| file.0 == Product::State;
        let is_new = |(product, _): &(Product, PathBuf)| match product {
            Product::State => true,
            Product::Report(_) => has(&["report"]),
            _ => has(&["output", "format"]),
        };
        let old = saved.outputs.files.iter();
        let kept = old.clone().filter(|file| !is_new(file));
        let new = typed.iter().filter(|file| is_new(file));
        let mut files: Vec<_> = new.chain(kept).cloned().collect();
        let resumed = parts.resume.clone().unwrap_or_default();
        if !files.iter().any(is_state) {
            files.push((Product::State, resumed.clone()));
        }
        let old = old.map(|(_, path)| path.clone()).chain([resumed]);
        let all = &mut plan.outputs;
        all.replaced.extend(old);
        all.replaced.sort();
        all.replaced.dedup();
        all.files = files;
        all.force = outputs.force;
        all.preview |= outputs.preview;
        all.exposure = outputs.exposure.or(all.exposure);
        all.filter &= !outputs.no_filter;
        let interval = parts.checkpoint_interval;
        all.checkpoint_interval =
            interval.unwrap_or(all.checkpoint_interval);
        Ok(plan)
    }

    /// Refuses what would change a sample: what is given again has to be as it
    /// was.
    fn refuse_other_samples(&self, saved: &Plan) -> Result<(), Error> {
        let text = |plan: &Plan| {
            let mut plan = plan.saved(Path::new("/"));
            let up = plan.up.unwrap_or(DVec3::Z);
            (plan.up, plan.sky.zenith) =
                (Some(up), plan.sky.zenith.or(Some(Sky::new(up).zenith)));
            json!(plan)
        };
        let [typed, saved] = [text(&self.new_plan()), text(saved)];
        for id in &self.given {
            let at = FIXED.iter().filter(|(fixed, _)| fixed == id);
            let mut at = at.map(|(_, at)| at);
            let changes = at.any(|at| {
                let old = saved.pointer(at);
                old.is_some() && typed.pointer(at) != old
            });
            let is_new = id == "cache"
                || id == "points"
                    && saved["sensor"].get("Points").is_none();
            if changes || is_new {
                let command = Self::command();
                let mut all = command.get_arguments();
                let option = all.find(|option| option.get_id() == id);
                let name = option.and_then(Arg::get_long).unwrap_or(id);
                let fault = format!(
                    "--{name}: the run that is resumed has another, which stays; \
                     limits, what is written, and how it is executed may change"
                );
                return Err(usage(fault, "pt"));
            }
        }
        Ok(())
    }

    /// What does not fit together, if anything.
    fn misfit(&self, plan: &Plan) -> Option<String> {
        let Self { outputs, parts, .. } = self;
        let state = plan.outputs.of(|p| p == Product::State).next();
        let is_open = |path: &Path| descriptor(path).is_some();
        let shows = |product| product != Product::State;
        let is_png = |product| product == Product::Image(Format::Png);
        let mut shown = plan.outputs.of(is_png);
        let fault =
            if parts.checkpoint_interval.is_some() && state.is_none() {
                "--checkpoint-interval needs --checkpoint"
            } else if state.is_some_and(is_dash) {
                "--checkpoint needs a file"
            } else if outputs.format.is_some()
                && !plan.outputs.of(shows).any(is_open)
            {
                "--format is for standard output"
            } else if outputs.preview && shown.all(is_dash) {
                "--preview needs a PNG file, as in -o a.png"
            } else {
                return self.misfit_of_parts(plan);
            };
        Some(fault.to_owned())
    }

    /// What does not fit together of a part of a run, if it is one.
    fn misfit_of_parts(&self, plan: &Plan) -> Option<String> {
        let shows = |product| product != Product::State;
        let typed =
            self.parts.range.is_some() || self.parts.tiles.is_some();
        let Budget { time, error, .. } = plan.budget;
        let is_limited = time.is_some() || error.is_some();
        let (from, end) = plan.part.map_or((0, 1), |part| part.samples);
        let fault = if typed && plan.part.is_none()
            || plan.part.is_some() && is_limited
        {
            "--samples and --tiles need -n, the samples of the whole run, and \
             neither --time nor --error"
        } else if plan.part.is_some_and(|part| end > part.of) {
            "--samples ends after the samples of the whole run, which are -n"
        } else if from == end && plan.outputs.of(shows).next().is_some() {
            "--samples A..A only learns, and writes a state: -o a.litpt"
        } else if self.parts.tiles.is_some() && plan.reference.is_some() {
            "--tiles renders a part of the image, and --reference needs all of it"
        } else {
            return misplaced(plan.camera()?, plan.part);
        };
        Some(fault.to_owned())
    }
}

/// Options that stay as they were, and where a plan has them.
const FIXED: &[(&str, &str)] = &[
    ("albedos", "/surfaces/albedo"),
    ("albedos", "/surfaces/named"),
    ("materials", "/surfaces/materials"),
    ("band", "/surfaces/band"),
    ("sky", "/sky/cover"),
    ("zenith", "/sky/zenith"),
    ("ground", "/sky/ground"),
    ("position", "/sensor/Camera/stand/At/0"),
    ("target", "/sensor/Camera/stand/At/1"),
    ("position", "/sensor/Camera/stand/Outside"),
    ("target", "/sensor/Camera/stand/Outside"),
    ("viewpoint", "/sensor/Camera/stand"),
    ("up", "/up"),
    ("fov", "/sensor/Camera/fov"),
    ("resolution", "/sensor/Camera/resolution"),
    ("crop", "/sensor/Camera/crop"),
    ("background", "/sensor/Camera/background"),
    ("faces", "/sensor"),
    ("radiosity", "/sensor"),
    ("vertices", "/sensor"),
    ("seed", "/seed"),
];

/// The PNG beside a scene.
fn beside(scene: &Path) -> PathBuf {
    let mut path = scene.to_owned();
    if path.extension().is_some_and(|e| e == "gz" || e == "zst") {
        path.set_extension("");
    }
    path.set_extension("png");
    path
}

/// Why a window or a part of it is not within the image, if it is not.
fn misplaced(camera: &CameraPlan, part: Option<Part>) -> Option<String> {
    let (width, height) = camera.resolution;
    let window = camera.window();
    let Window { corner: (x, y), size: (w, h) } = window;
    let fits = |at, n, side| at < side && n <= side - at;
    if !(fits(x, w, width) && fits(y, h, height)) {
        return Some(format!(
            "--crop {}: does not lie within the image of \
             {width}x{height} pixels",
            String::from(window)
        ));
    }
    let ((k, n), rows) = (part?.band, window.tile_rows(SIDE));
    (n > rows).then(|| {
        format!(
            "--tiles {k}/{n}: the image has {rows} rows of tiles, and not \
             more bands"
        )
    })
}
