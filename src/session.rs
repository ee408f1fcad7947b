// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! A run of the program, from its arguments to its files.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::hint::black_box;
use std::io::{self, Read};
use std::mem;
use std::path::Path;
use std::process::{self, ExitCode};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use rayon::ThreadPoolBuilder;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};

use crate::analysis::{Finding, Inquiry, SceneAnalysis, Shortcut};
use crate::arguments::{Arguments, fail};
use crate::bvh::{Bvh, Quality, too_small};
use crate::camera::Camera;
use crate::checkpoint::{Checkpoint, Known};
use crate::compare::disagreements;
use crate::film::{Film, Window};
use crate::image::{Format, Image, Picture};
use crate::output::{ImageTarget, OutputTarget};
use crate::progress::{self, Bar, Step};
use crate::render::Renderer;
use crate::render::choose::{
    Choice, Method, Request, Sampling, Setup, expected_rays,
};
use crate::render_loop::{Convergence, Interrupt, Limits, Stop, Work};
use crate::report::{Kind, Report, SceneFile};
use crate::run_key::{RunKey, entries};
use crate::run_output::{RunOutput, attributes};
use crate::scene::{Scene, begins_obj, read_file};
use crate::sky::Sky;

/// The processes that render one image, as each of them sees them.
pub trait Ranks {
    /// How many there are.
    fn count(&self) -> u32 {
        1
    }

    /// Tells the others something, which they [`hear`](Self::hear).
    fn tell(&self, _: &mut [u8]) {}

    /// What the leader tells; none if there is nothing more to do.
    fn hear(&self) -> Option<Vec<u8>> {
        None
    }

    /// A renderer of all of them, given that of the leader.
    fn lead<'a>(
        &self,
        own: Box<dyn Renderer + 'a>,
        _: Frame,
    ) -> Box<dyn Renderer + 'a> {
        own
    }

    /// Renders for the leader until there is nothing more to do.
    fn serve(&self, _: &mut dyn Renderer, _: &Frame) {}
}

/// One process.
pub struct Alone;

impl Ranks for Alone {}

/// What the films of all parts of a run have in common.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Width and height of the whole image.
    pub resolution: (u32, u32),
    /// The window of the run.
    pub whole: Window,
    /// How samples are made.
    pub sampling: Sampling,
}

/// Runs the program with the arguments of the process, which leads `ranks`;
/// returns its exit status.
pub fn lead(ranks: &dyn Ranks) -> ExitCode {
    #[cfg(target_env = "gnu")]
    give_arrays_back();
    let typed = Arguments::from_command_line();
    match typed.and_then(|(mut arguments, resumed)| {
        run(&mut arguments, resumed, ranks).map_err(fail)
    }) {
        // Turn the outcome into a status
        Ok(stop) => ExitCode::from(status(stop, 0)),
        Err(status) => status,
    }
}

/// Has the allocator give each dropped array back to the system if it is
/// larger than a quarter of a megabyte.
#[cfg(target_env = "gnu")]
fn give_arrays_back() {
    // SAFETY: a parameter of the allocator, which it may refuse.
    unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, 1 << 18) };
}

fn run(
    arguments: &mut Arguments,
    resumed: Option<Checkpoint>,
    ranks: &dyn Ranks,
) -> Result<Stop, String> {
    // Watch the time from the start
    let start = Instant::now();
    let interrupt = Interrupt::listen()
        .map_err(|e| format!("cannot listen for signals: {e}"))?;
    let stage = Stage::watched(&interrupt, latest(arguments, start));
    // Check the camera if it is given
    if arguments.has_camera() {
        camera(arguments)?;
    }
    let (window, band) = (arguments.window()?, arguments.band()?);
    start_threads(arguments)?;
    let mut files = Files::check(arguments, resumed)?;
    tell(ranks, &arguments.save());
    let (scene, mut known) = load(arguments, &files, ranks)?;
    let camera = camera(arguments)?;
    let kept = kept(arguments);
    let inquiry = inquire(arguments, &camera, &scene, &kept);
    stage.set(Some("building the hierarchy"));
    let (analysis, bvh) =
        build(scene, &inquiry, arguments, ranks, &mut known)?;
    let setup = Setup {
        intersector: &bvh,
        inquiry: &inquiry,
        analysis: &analysis,
    };
    stage.set(Some("choosing a method"));
    let (sampling, choice) =
        sampling(arguments, &setup, window, start, &files);
    if arguments.explain {
        return explain(&analysis, arguments, sampling.method, choice);
    }
    // Report the method
    let method = sampling.method.to_string();
    known.settings.insert("integrator".into(), method.into());
    if let Some(choice) = choice {
        let choice = choice.to_string();
        known.settings.insert("choice".into(), choice.into());
    }
    // Say which part of the run is rendered
    let part = arguments.part(sampling.replicate);
    let first = part.map_or(0, |part| part.samples.0);
    let film = sampling.film(arguments.resolution, band);
    let film = film.as_part(window, first);
    if let Some(part) = part {
        known.settings.insert("spp".into(), part.count().into());
        known.settings.extend(entries(&part));
        if part.count() == 0 && !arguments.quiet {
            progress::warn(&format!(
                "the part has no sample: {} are placed together",
                sampling.replicate
            ));
        }
    }
    // Collect all that decides the samples
    let run_key = RunKey {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        integrator: sampling.identity(),
        scene_sha256: known.scene.sha256.clone(),
        subject: arguments.subject(),
        sampling,
        part,
    };
    let job = setup.renderer(&sampling);
    // Share the job with other processes
    tell(ranks, &sampling);
    let resolution = arguments.resolution;
    let frame = Frame { resolution, whole: window, sampling };
    let mut job = ranks.lead(job, frame);
    let mut run = Run::begin(
        &mut *job, film, run_key, start, arguments, &mut files, known,
    )?;
    stage.set(None);
    let stop = run.render(start, &interrupt, &analysis, &files);
    // End without an image if there is no sample
    let is_over = matches!(stop, Stop::Time | Stop::Signal(_));
    if is_over && run.film.unsampled() == run.film.area() {
        let message = stop.without_image(match sampling.method {
            Method::Gather => "learning",
            _ => "rendering",
        });
        return match stop {
            Stop::Signal(_) => {
                progress::error(&message);
                Ok(stop)
            }
            _ => Err(message),
        };
    }
    run.write(stop)?;
    Ok(stop)
}

/// The time at which the program ends even if it has no sample.
fn latest(arguments: &Arguments, start: Instant) -> Option<Instant> {
    let time = arguments.time.filter(|_| !arguments.explain)?;
    let more = Duration::try_from_secs_f64((0.025 * time).max(0.5));
    arguments.deadline(start)?.checked_add(more.ok()?)
}

/// The exit status of a stop, which is `other` if it is no signal.
fn status(stop: Stop, other: u8) -> u8 {
    match stop {
        Stop::Signal(signal) => 128 + signal as u8,
        _ => other,
    }
}

/// What is done before the first pass; none afterwards.
struct Stage(Arc<Mutex<Option<&'static str>>>);

impl Stage {
    /// The first stage. A thread ends the program if a signal comes before
    /// the first pass, or the time `end`.
    fn watched(interrupt: &Interrupt, end: Option<Instant>) -> Self {
        let stage = Self(Arc::new(Mutex::new(Some("reading"))));
        let (own, interrupt) = (Self(stage.0.clone()), interrupt.clone());
        thread::spawn(move || {
            loop {
                thread::sleep(Duration::from_millis(50));
                let stage = own.get();
                let Some(doing) = *stage else { return };
                let (signal, now) = (interrupt.signal(), Instant::now());
                if let Some(stop) = Stop::before_rendering(signal, now, end)
                {
                    progress::error(&stop.without_image(doing));
                    process::exit(status(stop, 1).into());
                }
            }
        });
        stage
    }

    fn get(&self) -> MutexGuard<'_, Option<&'static str>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, stage: Option<&'static str>) {
        *self.get() = stage;
    }
}

fn camera(arguments: &Arguments) -> Result<Camera, String> {
    let (width, height) = arguments.resolution;
    let aspect = f64::from(width) / f64::from(height);
    Camera::new(&arguments.view(), aspect).map_err(|e| e.to_string())
}

/// The files of a run beside the scene: checked, and not yet written.
struct Files {
    images: Vec<ImageTarget>,
    reports: Vec<(Kind, OutputTarget)>,
    checkpoint: Option<OutputTarget>,
    resumed: Option<Checkpoint>,
    reference: Option<Image>,
}

impl Files {
    fn check(
        arguments: &Arguments,
        resumed: Option<Checkpoint>,
    ) -> Result<Self, String> {
        let reference = arguments.reference.as_deref();
        Ok(Self {
            images: arguments.images()?,
            reports: arguments.reports()?,
            checkpoint: arguments.checkpoint()?,
            resumed,
            reference: reference
                .map(|path| read_reference(path, arguments))
                .transpose()?,
        })
    }

    /// Whether a file will name the scene by its hash.
    fn name_the_scene(&self) -> bool {
        let exr = |image: &ImageTarget| image.format() == Format::Exr;
        self.images.iter().any(exr)
            || !self.reports.is_empty()
            || self.checkpoint.is_some()
            || self.resumed.is_some()
            || self.reference.is_some()
    }
}

fn read_reference(
    path: &Path,
    arguments: &Arguments,
) -> Result<Image, String> {
    // Read an image that needs no note
    let mut faults = Vec::new();
    let note = &mut |fault: &str| faults.push(fault.to_owned());
    let image = Image::read_noting(path, note)?;
    if let Some(fault) = faults.first() {
        return Err(format!(
            "{fault}; a reference needs the radiance of each pixel"
        ));
    }
    let (width, height) = arguments.window()?.size;
    if (image.width, image.height) != (width, height) {
        return Err(format!(
            "{}: is {}x{} pixels large, and the image {width}x{height}",
            path.display(),
            image.width,
            image.height
        ));
    }
    if arguments.has_camera() {
        refuse_others(path, &image, arguments, None)?;
    }
    // Warn of a reference with our seed
    let ours = arguments.seed.to_string();
    if !arguments.quiet && image.attributes.get("seed") == Some(&ours) {
        progress::warn(
            "the reference has the seed of this run: its true errors are \
             larger than they will seem (choose another seed with -s)",
        );
    }
    Ok(image)
}

/// # Errors
/// The reference says that it shows another view or another scene.
fn refuse_others(
    path: &Path,
    image: &Image,
    arguments: &Arguments,
    scene: Option<&String>,
) -> Result<(), String> {
    let theirs = &image.attributes;
    let mut ours = attributes(&entries(&arguments.subject()));
    let scene = scene.or_else(|| theirs.get("scene_sha256"));
    ours.extend(scene.map(|hash| ("scene_sha256".into(), hash.clone())));
    match disagreements(theirs, &ours).join(", ") {
        same if same.is_empty() => Ok(()),
        differing => Err(format!(
            "{}: shows something else than this run: {differing}",
            path.display()
        )),
    }
}

fn start_threads(arguments: &Arguments) -> Result<(), String> {
    let threads = arguments.threads.unwrap_or(0);
    let pool = ThreadPoolBuilder::new().num_threads(threads);
    pool.build_global().map_err(|e| format!("cannot start threads: {e}"))
}

fn load(
    arguments: &mut Arguments,
    files: &Files,
    ranks: &dyn Ranks,
) -> Result<(Scene, Report), String> {
    let began = Instant::now();
    let file = arguments.input_name();
    let step = Step::new(!arguments.quiet, format!("reading {file}"), None);
    // Read the bytes of the mesh
    let mut bytes = Vec::new();
    let read = match arguments.scene_file() {
        Some(path) if path.is_file() => {
            fs::read(path).map(|content| bytes = content)
        }
        Some(path) => File::open(path)
            .and_then(|mut pipe| read_pipe(&mut pipe, &mut bytes)),
        None => read_pipe(&mut io::stdin(), &mut bytes),
    };
    read.map_err(|e| format!("{file}: cannot read: {e}"))?;
    ranks.tell(&mut bytes);
    if bytes.len() as u64 == START {
        begins_obj(&bytes).map_err(|error| error.within(&file))?;
    }
    let read = read_file(&bytes).map_err(|error| error.within(&file));
    drop(step);
    let (mesh, warnings) = read?;
    // Warn of what is odd
    for warning in warnings.iter().filter(|_| !arguments.quiet) {
        progress::warn(&warning.within(&file));
    }
    // Choose a camera if none is given
    let chosen = arguments.stand_outside(mesh.corners());
    if let (Some(options), false) = (chosen, arguments.quiet) {
        progress::inform(&format!("the camera stands outside: {options}"));
    }
    // Hash the bytes if a file will name them
    let hash = files.name_the_scene().then(|| Sha256::digest(&bytes));
    let hex = |byte: u8| format!("{byte:02x}");
    let sha256: String = hash.into_iter().flatten().map(hex).collect();
    if let (Some(path), Some(image)) =
        (&arguments.reference, &files.reference)
    {
        refuse_others(path, image, arguments, Some(&sha256))?;
    }
    drop(bytes);
    let triangles = mesh.triangles.len() as u64;
    let scene = Scene::of(mesh);
    let known = Report {
        scene: SceneFile { file, sha256, triangles },
        settings: arguments.settings(),
        load_seconds: began.elapsed().as_secs_f64(),
        ..Report::begin("pt")
    };
    Ok((scene, known))
}

/// Reads to the end, but no more than `START` bytes if they begin no OBJ.
fn read_pipe(pipe: &mut dyn Read, bytes: &mut Vec<u8>) -> io::Result<()> {
    pipe.take(START).read_to_end(bytes)?;
    if bytes.len() as u64 == START && begins_obj(bytes).is_ok() {
        pipe.read_to_end(bytes)?;
    }
    Ok(())
}

/// So many bytes of an OBJ have a vertex.
const START: u64 = 1 << 26;

fn inquire<'a>(
    arguments: &Arguments,
    camera: &'a Camera,
    scene: &Scene,
    kept: &'a [Shortcut],
) -> Inquiry<'a> {
    Inquiry {
        camera,
        entrance: scene.frame.entrance(camera.position),
        sky: Sky::new(arguments.up),
        albedo: arguments.albedo,
        resolution: arguments.resolution,
        kept,
    }
}

/// The shortcuts that are not looked for.
fn kept(arguments: &Arguments) -> Vec<Shortcut> {
    let (width, height) = arguments.resolution;
    let tiles = f64::from(width) * f64::from(height) / 256.;
    let seconds = tiles * TILE / rayon::current_num_threads() as f64;
    let time = arguments.time.filter(|_| !arguments.explain);
    let slow = time.is_some_and(|time| seconds > 0.05 * time);
    let slow = slow.then_some(Shortcut::Background);
    arguments.kept().iter().copied().chain(slow).collect()
}

/// Seconds in which a thread looks for the background of a tile, about.
const TILE: f64 = 3e-6;

fn build(
    scene: Scene,
    inquiry: &Inquiry,
    arguments: &Arguments,
    ranks: &dyn Ranks,
    known: &mut Report,
) -> Result<(SceneAnalysis, Bvh), String> {
    let began = Instant::now();
    let is_inside = inquiry.entrance.is_inside;
    let (width, height) = arguments.band()?.size;
    let area = f64::from(width) * f64::from(height);
    let paths = arguments.goal(1).map(|n| n as f64 * area);
    let (albedo, time) = (arguments.albedo, arguments.time);
    let rays = expected_rays(albedo, is_inside, paths, time);
    let rays = rays / f64::from(ranks.count());
    let Scene { triangles, left_out, .. } = scene;
    let quality = Quality::expecting(triangles.len(), rays);
    // Warn of triangles that are too small
    let count = too_small(&triangles);
    if count > 0 && !arguments.quiet {
        progress::warn(&format!(
            "{count} of {} triangles are smaller than 2^-40 of the largest, \
             or 2^-43 of the scene: close to larger ones the light may be wrong",
            triangles.len()
        ));
    }
    // Build the hierarchy and show how far it is
    let what = "building the hierarchy".to_owned();
    let all = Some(triangles.len() as u64);
    let step = Step::new(!arguments.quiet, what, all);
    let placed = |count: usize| step.reach(count as u64);
    let bvh = Bvh::of(triangles, quality, arguments.isa(), &placed);
    let bvh = bvh.map_err(|e| e.to_string())?;
    drop(step);
    let analysis = SceneAnalysis::find(&left_out, &bvh, inquiry);
    // Report what was found and built
    known.left_out = analysis.left_out().cloned().collect();
    let threads = rayon::current_num_threads();
    known.settings.insert("threads".into(), threads.into());
    known.settings.insert("hierarchy".into(), quality.to_string().into());
    known.build_seconds = began.elapsed().as_secs_f64();
    Ok((analysis, bvh))
}

/// Tells what can be left out, and what the rest is made of.
fn explain(
    analysis: &SceneAnalysis,
    arguments: &Arguments,
    method: Method,
    choice: Option<Choice>,
) -> Result<Stop, String> {
    let mut lines = String::new();
    for Finding { fact, holds, why } in &analysis.findings {
        let sign = if *holds { "left out" } else { "-" };
        lines += &format!("{fact:13}{sign:10}{why}\n");
    }
    let why = choice.map_or(method.to_string(), |why| why.to_string());
    lines += &format!("{:13}{why}\n", "method");
    let one = analysis.is_black && method != Method::Gather;
    let rays = if one { ", one ray a path, for any hit" } else { "" };
    let parts = format!("{method}{rays}");
    let parts = analysis.parts(arguments.isa(), parts);
    lines += &format!("{:13}{parts}\n", "intersector");
    let out = OutputTarget::standard_output()?;
    out.write(&mut |out| out.write_all(lines.as_bytes()))?;
    Ok(Stop::Samples)
}

/// A run of the program: what has been rendered, and who is told.
struct Run<'a> {
    arguments: &'a Arguments,
    job: &'a mut (dyn Renderer + 'a),
    film: Film,
    convergence: Convergence,
    images: Vec<ImageTarget>,
    output: RunOutput,
    bar: Bar,
}

impl<'a> Run<'a> {
    fn begin(
        job: &'a mut (dyn Renderer + 'a),
        mut film: Film,
        run_key: RunKey,
        start: Instant,
        arguments: &'a Arguments,
        files: &mut Files,
        report: Report,
    ) -> Result<Self, String> {
        // Take the film of a checkpoint or a new one
        let mut convergence = Convergence::default();
        if let (Some(saved), Some(path)) =
            (files.resumed.take(), &arguments.resume)
        {
            let name = path.display();
            convergence = saved
                .resume(&run_key, &mut film)
                .map_err(|fault| format!("{name}: {fault}"))?;
            // Warn if there is nothing left to do
            let spp = convergence.spp;
            if arguments.goal(film.replicate()).is_some_and(|n| spp >= n)
                && !arguments.quiet
            {
                progress::warn(&format!(
                    "{name}: holds {spp} samples already (ask for more with -n)"
                ));
            }
        }
        let every =
            Duration::try_from_secs_f64(arguments.every.unwrap_or(60.))
                .unwrap_or(Duration::MAX);
        let (reports, checkpoint) =
            (mem::take(&mut files.reports), files.checkpoint.take());
        let known = Known { options: arguments.save(), run_key, report };
        let output = RunOutput::new(reports, checkpoint, every, known);
        let images = mem::take(&mut files.images);
        let bar = Bar::new(!arguments.quiet, start, arguments.time);
        Ok(Self { arguments, job, film, convergence, images, output, bar })
    }
}

/// How the samples are made, and what a pilot has found, if it has chosen.
fn sampling(
    arguments: &Arguments,
    setup: &Setup,
    window: Window,
    start: Instant,
    files: &Files,
) -> (Sampling, Option<Choice>) {
    let saved =
        files.resumed.as_ref().map(|saved| saved.known().run_key.sampling);
    let left = |end: Instant| end.saturating_duration_since(Instant::now());
    let left = arguments.deadline(start).map(|end| left(end).as_secs_f64());
    let request = Request {
        method: arguments.integrator.0,
        seed: arguments.seed,
        window,
        samples: arguments.samples(),
        error: arguments.error,
        time: arguments.time,
        left,
    };
    let (sampling, choice) = setup.decide(&request, saved);
    // Warn if it is not the method that is asked for
    let (wanted, chosen) = (request.method, sampling.method);
    let wanted = wanted.or(saved.map(|saved| saved.method));
    if let Some(wanted) = wanted.filter(|&wanted| wanted != chosen)
        && !arguments.quiet
    {
        progress::warn(&format!(
            "--time leaves too little for a first sample of each pixel \
             by {wanted}: the method is {chosen}"
        ));
    }
    (sampling, choice)
}

impl Run<'_> {
    fn render(
        &mut self,
        start: Instant,
        interrupt: &Interrupt,
        analysis: &SceneAnalysis,
        files: &Files,
    ) -> Stop {
        let reference = files.reference.as_ref();
        let goal = self.arguments.goal(self.film.replicate());
        let deadline = self.arguments.deadline(start);
        let limits = Limits {
            samples: analysis.samples(goal),
            deadline,
            reserve: deadline.map_or([0.; 2], |end| self.reserve(end)),
            clock: &Instant::now,
            error: self.arguments.error,
            interrupt,
            reference: reference.map(|image| &image.means[..]),
        };
        let late = deadline.is_some_and(|end| Instant::now() > end);
        self.answer(interrupt.clone());
        let stop = self.go_on(&limits);
        self.bar.finish();
        // Warn if there was no time
        let none = self.convergence.spp == 0;
        let slow = match late {
            true => "to load and to build",
            false => "one sample of each pixel",
        };
        if (late || none && stop == Stop::Time) && !self.arguments.quiet {
            progress::warn(&format!(
                "{slow} took longer than --time allows"
            ));
        }
        stop
    }

    fn go_on(&mut self, limits: &Limits) -> Stop {
        let Self { arguments, job, film, convergence, .. } = self;
        let Self { images, output, bar, .. } = self;
        let area = film.area();
        let expect = |convergence: &Convergence| {
            let spp = convergence.expected(limits, area);
            let all = spp.map(|spp| spp.saturating_mul(area));
            let paths = convergence.spp.saturating_mul(area);
            bar.expect(paths, all, "paths", convergence.to_string());
        };
        match job.training_rays(area) {
            0 => expect(convergence),
            rays => bar.expect(0, Some(rays), "rays", "learning, ".into()),
        }
        let advance = |work| match (limits.interrupt.signal(), work) {
            (None, Work::Learning(n) | Work::Paths(n)) => bar.advance(n),
            (Some(_), _) => bar.stop(),
        };
        let mut next = Instant::now();
        let mut after = |convergence: &Convergence, film: &Film| {
            expect(convergence);
            let mut written = output.after(convergence, film);
            // Show the image so far
            let now = Instant::now();
            if arguments.preview && now >= next {
                let files = images.iter_mut();
                let image = Picture::new(film, BTreeMap::new());
                for target in files.filter(|t| t.format() == Format::Png) {
                    written = written.and(target.rewrite(&image));
                }
                next = Instant::now() + (10 * now.elapsed()).max(SECOND);
            }
            if let (Err(message), false) = (written, arguments.quiet) {
                bar.suspend(|| progress::warn(&message));
            }
        };
        convergence.run(&mut **job, film, limits, &advance, &mut after)
    }

    fn reserve(&self, deadline: Instant) -> [f64; 2] {
        let Self { film, convergence, images, output, .. } = self;
        let (width, height) = film.window().size;
        let (width, height) = (width.min(256), height.min(256));
        let (noise, empty) =
            (Film::noise(width, height), Film::new(width, height));
        let rehearse = |trial: &Film| {
            let began = Instant::now();
            black_box(trial.summary());
            let image = output.rehearse(convergence, trial);
            images.iter().for_each(|target| target.rehearse(&image));
            began.elapsed().as_secs_f64()
        };
        rehearse(&noise);
        let ratio = film.area() as f64 / noise.area() as f64;
        let left = deadline.saturating_duration_since(Instant::now());
        let most = 0.5 * left.as_secs_f64();
        let [none, all] =
            [&empty, &noise].map(|film| ratio * rehearse(film));
        [none.min(most), all.max(none).min(most)]
    }

    fn answer(&self, interrupt: Interrupt) {
        let (bar, quiet) = (self.bar.clone(), self.arguments.quiet);
        thread::spawn(move || {
            while interrupt.signal().is_none() {
                thread::sleep(Duration::from_millis(50));
            }
            bar.stop();
            if !quiet {
                let line = "finishing; a second signal aborts";
                bar.suspend(|| progress::inform(line));
            }
        });
    }
}

const SECOND: Duration = Duration::from_secs(1);

impl Run<'_> {
    fn write(&mut self, stop: Stop) -> Result<(), String> {
        let Self { film, convergence, images, output, .. } = self;
        // Write the images
        let image = output.picture(convergence, film, Some(stop));
        let targets = images.iter();
        let mut written: Vec<_> =
            targets.map(|target| target.write(&image)).collect();
        written.push(output.close(convergence, film, stop));
        let failures = written.into_iter().filter_map(Result::err);
        let failures: Vec<_> = failures.collect();
        if !failures.is_empty() {
            return Err(failures.join("; "));
        }
        if !self.arguments.quiet {
            let report = output.report(convergence, film, Some(stop));
            for (name, text) in report.summary(film.area()) {
                progress::inform(&format!("{name:10}{text}"));
            }
            if let Some(path) = &self.arguments.picture {
                let name = path.display();
                progress::inform(&format!("{:10}{name}", "file"));
            }
        }
        Ok(())
    }
}

/// Tells other ranks a value.
fn tell(ranks: &dyn Ranks, value: &impl Serialize) {
    let text = serde_json::to_vec(value);
    ranks.tell(&mut text.unwrap_or_default());
}

/// Hears a value.
fn hear<T: DeserializeOwned>(
    ranks: &dyn Ranks,
) -> Result<Option<T>, String> {
    let value = ranks.hear().map(|text| serde_json::from_slice(&text));
    value.transpose().map_err(|_| "another version of pt leads".into())
}

/// Renders for the process that leads, until it has nothing more to do.
///
/// # Errors
/// The scene cannot be rendered here.
pub fn follow(ranks: &dyn Ranks) -> Result<(), String> {
    let _ = Interrupt::listen();
    let Some(options) = hear(ranks)? else { return Ok(()) };
    let mut arguments = Arguments::restore(&options)?;
    arguments.quiet = true;
    let window = arguments.window()?;
    start_threads(&arguments)?;
    // Hear the scene
    let Some(bytes) = ranks.hear() else { return Ok(()) };
    let file = arguments.input_name();
    let read = read_file(&bytes).map_err(|error| error.within(&file));
    let (mesh, _) = read?;
    drop(bytes);
    arguments.stand_outside(mesh.corners());
    let scene = Scene::of(mesh);
    let camera = camera(&arguments)?;
    let kept = kept(&arguments);
    let inquiry = inquire(&arguments, &camera, &scene, &kept);
    let known = &mut Report::default();
    let (analysis, bvh) = build(scene, &inquiry, &arguments, ranks, known)?;
    let Some(sampling) = hear(ranks)? else { return Ok(()) };
    let setup = Setup {
        intersector: &bvh,
        inquiry: &inquiry,
        analysis: &analysis,
    };
    let mut job = setup.renderer(&sampling);
    let resolution = arguments.resolution;
    let frame = Frame { resolution, whole: window, sampling };
    ranks.serve(&mut *job, &frame);
    Ok(())
}
