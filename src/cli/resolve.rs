// Tangled from chapters/options.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From what was typed to a plan: each default is resolved here, and
//! options that contradict each other are refused.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::options::{Error, LimitOptions, Options, by_option, usage};
use crate::camera::View;
use crate::compare::display::Exposure;
use crate::error;
use crate::film::ErrorNorm;
use crate::image::Format;
use crate::key::Part;
use crate::materials::glass::Bsdf;
use crate::matrix::MatrixFormat;
use crate::output::{descriptor, format_of, refuse_aliases};
use crate::plan::{Budget, Outputs, Plan, Product, SensorPlan};
use crate::plan::{Stand, is_dash};
use crate::render::choose::default_samples;
use crate::report::Kind;
use crate::sensor::table::TableFormat;
use crate::sky::{Cover, Sky};
use crate::state::shards::{is_state_name, or_state};
use crate::tally::Tally;

/// The first option that has changed a value, if one has.
struct Change(Option<&'static str>);

impl Change {
    /// Sets a value if another one was typed.
    fn set<T: PartialEq>(
        &mut self,
        option: &'static str,
        value: &mut T,
        typed: Option<T>,
    ) {
        if let Some(typed) = typed.filter(|typed| typed != value) {
            self.0 = self.0.or(Some(option));
            *value = typed;
        }
    }
}

impl Options {
    /// The plan of a run, whose plan may have been saved; without a named
    /// output, a picture is a PNG next to the scene if standard output is a
    /// terminal.
    ///
    /// # Errors
    /// Options contradict each other, or may not change what was saved.
    pub fn plan(
        &self,
        saved: Option<&Plan>,
        is_terminal: bool,
    ) -> Result<Plan, Error> {
        let mut plan = saved.cloned().unwrap_or_default();
        let changed = self.decide_samples(&mut plan);
        if saved.is_none() {
            let samples = default_samples(plan.camera().is_none());
            plan.budget = Budget::samples(samples);
        } else if let Some(name) = changed {
            let fault = format!(
                "--{name}: the run that is resumed has another, which stays; \
                 limits, what is written, and how it is executed may change"
            );
            return Err(usage(fault, "pt"));
        }
        self.execute(&mut plan);
        let files = self.files(&plan)?;
        match saved {
            None => {
                self.begin(&mut plan, files, is_terminal);
                if plan.shows_only_pictures() {
                    self.show(&mut plan);
                }
            }
            Some(_) => self.go_on(&mut plan.outputs, files),
        }
        // Reject an invalid plan
        if let Some(misfit) = self.misfit(&plan) {
            return Err(usage(misfit, "pt"));
        }
        plan.check().map_err(|error| usage(by_option(&error), "pt"))?;
        Ok(plan)
    }

    /// Merges what decides samples, and returns the first option that has
    /// changed a value.
    fn decide_samples(&self, plan: &mut Plan) -> Option<&'static str> {
        let Self { scene, sensor, limits, parts, .. } = self;
        let (mut change, surfaces) = (Change(None), &mut plan.surfaces);
        if !scene.albedos.is_empty() {
            let albedos = scene.albedos.iter().cloned();
            let is_unnamed = |(name, _): &(String, f64)| name.is_empty();
            let (unnamed, named): (Vec<_>, _) =
                albedos.partition(is_unnamed);
            let albedo = unnamed.last().map_or(1., |&(_, albedo)| albedo);
            change.set("albedo", &mut surfaces.albedo, Some(albedo));
            change.set("albedo", &mut surfaces.named, Some(named));
        }
        change.set("band", &mut surfaces.band, scene.band.map(Some));
        // Set what lets light through
        if !scene.glass.is_empty() || !scene.transmit.is_empty() {
            let panes = scene.glass.iter();
            let panes = panes.filter_map(|(name, part)| {
                Some((name.clone(), Bsdf::Glass((*part)?)))
            });
            let new = panes.chain(scene.transmit.iter().cloned()).collect();
            let name =
                if scene.glass.is_empty() { "transmit" } else { "glass" };
            change.set(name, &mut surfaces.transmitting, Some(new));
        }
        let by_materials = scene.glass.iter().any(|(_, it)| it.is_none());
        let glass = by_materials.then_some(true);
        change.set("glass", &mut surfaces.glass, glass);
        let reads = scene.materials || by_materials;
        let materials = reads.then_some(Some(true));
        change.set("materials", &mut surfaces.materials, materials);
        // Set the sky and the up axis
        let sky = &mut plan.sky;
        match (&mut sky.cover, &scene.sky) {
            (Cover::Matrix(old, a), Some(Cover::Matrix(new, b)))
                if a == b =>
            {
                old.clone_from(new);
            }
            (cover, typed) => change.set("sky", cover, typed.clone()),
        }
        change.set("sun", &mut sky.sun, scene.sun.map(Some));
        change.set("direct", &mut sky.direct, scene.direct.map(Some));
        change.set("ground", &mut sky.ground, scene.ground.map(Some));
        let glow = scene.ground_glow.map(Some);
        change.set("ground-glow", &mut sky.ground_glow, glow);
        let mut up = plan.up.unwrap_or(DVec3::Z);
        change.set("up", &mut up, sensor.up);
        plan.up = sensor.up.or(plan.up);
        let mut zenith = sky.zenith.unwrap_or(Sky::new(up).zenith);
        change.set("zenith", &mut zenith, scene.zenith);
        sky.zenith = scene.zenith.or(sky.zenith);
        change.set("seed", &mut plan.seed, limits.seed);
        let tally = sensor.view_factors.map(Tally::ViewFactors);
        let tally = tally.or(sensor.sky_patches.map(Tally::SkyPatches));
        let tally =
            tally.or(sensor.derivative.clone().map(Tally::Derivative));
        let name = tally.as_ref().map_or("", |tally| tally.named().0);
        change.set(name, &mut plan.tally, tally.map(Some));
        change.set("cache", &mut plan.cache, parts.cache.clone().map(Some));
        self.sense(plan, &mut change);
        change.0
    }

    /// Merges what senses the light.
    fn sense(&self, plan: &mut Plan, change: &mut Change) {
        let typed = &self.sensor;
        let radiosity = typed.radiosity;
        let faces = |side| SensorPlan::Faces { side, radiosity };
        let vertices = typed.vertices.then_some(SensorPlan::Vertices);
        let points = typed.points.clone().map(SensorPlan::Points);
        change.set("faces", &mut plan.sensor, typed.faces.map(faces));
        change.set("vertices", &mut plan.sensor, vertices);
        match (&mut plan.sensor, points) {
            (SensorPlan::Points(old), Some(SensorPlan::Points(new))) => {
                *old = new;
            }
            (sensor, points) => change.set("points", sensor, points),
        }
        let SensorPlan::Camera(camera) = &mut plan.sensor else { return };
        // Set the camera
        let View { mut position, mut target, .. } = camera.view(DVec3::Z);
        change.set("position", &mut position, typed.position);
        change.set("target", &mut target, typed.target);
        let moved = typed.position.map_or("target", |_| "position");
        let placed = typed.position.or(typed.target);
        let at = placed.map(|_| Stand::At(position, target));
        change.set(moved, &mut camera.stand, at);
        let outside =
            typed.viewpoint.map(|(side, by)| Stand::Outside(side, by));
        change.set("view", &mut camera.stand, outside);
        change.set("fov", &mut camera.fov, typed.fov);
        change.set("resolution", &mut camera.resolution, typed.resolution);
        change.set("crop", &mut camera.crop, typed.crop.map(Some));
        let background = typed.background.map(Some);
        change.set("background", &mut camera.background, background);
    }

    /// Merges what decides no sample.
    fn execute(&self, plan: &mut Plan) {
        let Self { scene, limits, outputs, parts, execution, .. } = self;
        if let Some(path) = scene.scene.as_ref().or(scene.input.as_ref()) {
            plan.scene.clone_from(path);
        }
        plan.method = limits.integrator.or(plan.method);
        let reference =
            outputs.reference.as_ref().or(plan.reference.as_ref());
        plan.reference = reference.cloned();
        plan.shortcuts &= !execution.no_shortcuts;
        plan.threads = execution.threads.or(plan.threads);
        plan.isa = execution.isa.or(plan.isa);
        self.limit(plan);
        let new = &mut plan.outputs;
        new.force = outputs.force;
        new.preview |= outputs.preview;
        new.exposure = outputs.exposure.or(new.exposure);
        new.filter &= !outputs.no_filter;
        new.closed |= self.sensor.closed;
        let interval = parts.checkpoint_interval;
        new.checkpoint_interval =
            interval.unwrap_or(new.checkpoint_interval);
    }

    /// Merges when the run ends, and which part of it is rendered.
    fn limit(&self, plan: &mut Plan) {
        let &LimitOptions { samples, time, error, largest, .. } =
            &self.limits;
        let norm =
            |(error, relative)| (error, ErrorNorm { relative, largest });
        if samples.is_some() || time.is_some() || error.is_some() {
            plan.budget = Budget { samples, time, error: error.map(norm) };
        }
        plan.part = self.part(plan).or(plan.part);
    }

    /// The part of a run, which may have been saved; none without -n.
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

    /// Sets what a new run writes.
    fn begin(
        &self,
        plan: &mut Plan,
        mut files: Vec<(Product, PathBuf)>,
        is_terminal: bool,
    ) {
        let Self { outputs, execution, .. } = self;
        let is_named =
            !outputs.output.is_empty() || outputs.format.is_some();
        let prints = execution.dry_run || execution.sample.is_some();
        let shows = plan.camera().is_some() && !prints;
        if !is_named && shows && is_terminal && !is_dash(&plan.scene) {
            files[0] = (Product::Image(Format::Png), beside(&plan.scene));
            plan.outputs.exposure.get_or_insert(Exposure::Auto);
        }
        plan.outputs.files = files;
    }

    /// Sets the defaults of a run that writes only pictures, and lists them
    /// in words.
    fn show(&self, plan: &mut Plan) {
        let Self { scene, sensor, limits, .. } = self;
        let SensorPlan::Camera(camera) = &mut plan.sensor else { return };
        let mut said = vec![];
        if sensor.fov.is_none() && !camera.is_placed() {
            camera.fov = 35.;
            said.push("field of view 35 (-F)");
        }
        if scene.albedos.is_empty() && !scene.materials {
            (plan.surfaces.albedo, plan.surfaces.materials) = (0.7, None);
            said.push("albedo of the file's materials or 0.7 (-r)");
        }
        let has_below = plan.sky.ground.is_some()
            || plan.sky.ground_glow.is_some()
            || plan.sky.cover == Cover::Sphere
            || camera.background.is_some();
        if !has_below {
            plan.sky.ground = Some(0.3);
            said.push("ground 0.3 (--ground)");
        }
        if !plan.says_up() {
            said.push("the axis up that faces suggest, or z (-u)");
        }
        if plan.sky.direct.is_some() && plan.outputs.exposure.is_none() {
            plan.outputs.exposure = Some(Exposure::Auto);
            said.push("exposure auto (--exposure)");
        }
        if (limits.samples, limits.time, limits.error) == (None, None, None)
        {
            (plan.budget.samples, plan.budget.time) = (None, Some(10.));
            plan.outputs.picture_error = Some(0.01);
            said.push(
                "until 1 % of the mean or 10 s (-n, --time, --error)",
            );
        }
        plan.outputs.defaults = said.join(", ");
    }

    /// The files that are typed, with their contents: first images or values,
    /// standard output if none is named; then the state; then reports.
    fn files(&self, plan: &Plan) -> Result<Vec<(Product, PathBuf)>, Error> {
        let (named, reports) = (&self.outputs.output, &self.outputs.report);
        let written =
            named.iter().chain(&self.parts.checkpoint).chain(reports);
        refuse_aliases([].into_iter(), written.map(PathBuf::as_path))?;
        let usual = self.outputs.format.unwrap_or(Format::Pgm);
        let has_vertices = plan.sensor == SensorPlan::Vertices;
        let is_list = plan.camera().is_none();
        let is_matrix = |it: &&Tally| !matches!(it, Tally::Derivative(_));
        let matrix = plan.tally.as_ref().filter(is_matrix);
        let (states, mut images): (Vec<_>, Vec<_>) =
            named.iter().cloned().partition(|path| is_state_name(path));
        if named.is_empty() {
            images.push("-".into());
        }
        let kind = (plan.points().is_none(), self.sensor.binary);
        let image = |path: PathBuf| {
            let is_open = descriptor(&path).is_some();
            let name = if is_open { Path::new("-") } else { &path };
            let product =
                match matrix {
                    Some(tally) => MatrixFormat::of(name, tally, kind)
                        .map(Product::Matrix),
                    None if is_list => TableFormat::of(name, has_vertices)
                        .map(Product::Table),
                    None => format_of(name, usual).map(Product::Image),
                };
            Ok((product.map_err(or_state)?, path))
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
        let reports = reports.iter().map(report);
        let files = images.chain(states.into_iter().map(Ok)).chain(reports);
        let files = files.collect::<error::Result<_>>();
        files.map_err(|fault| usage(fault, "pt"))
    }

    /// Merges the files that are typed, and keeps the others.
    fn go_on(&self, plan: &mut Outputs, typed: Vec<(Product, PathBuf)>) {
        let Self { outputs, parts, .. } = self;
        let is_new = |(product, _): &(Product, PathBuf)| match product {
            Product::State => true,
            Product::Report(_) => !outputs.report.is_empty(),
            _ => !outputs.output.is_empty() || outputs.format.is_some(),
        };
        let resumed = parts.resume.clone().unwrap_or_default();
        let old = plan.files.iter().map(|(_, path)| path.clone());
        plan.replaced.extend(old.chain([resumed.clone()]));
        plan.replaced.sort();
        plan.replaced.dedup();
        plan.files.retain(|file| !is_new(file));
        plan.files.splice(0..0, typed.into_iter().filter(is_new));
        if plan.of(|product| product == Product::State).next().is_none() {
            plan.files.push((Product::State, resumed));
        }
    }

    /// A contradiction between options, if there is one.
    fn misfit(&self, plan: &Plan) -> Option<&'static str> {
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
        Some(fault)
    }

    /// A contradiction in the options of a part, if the run is one.
    fn misfit_of_parts(&self, plan: &Plan) -> Option<&'static str> {
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
            return None;
        };
        Some(fault)
    }
}

/// The PNG beside a scene.
fn beside(scene: &Path) -> PathBuf {
    let mut path = scene.to_owned();
    if path.extension().is_some_and(|e| e == "gz" || e == "zst") {
        path.set_extension("");
    }
    path.set_extension("png");
    path
}
