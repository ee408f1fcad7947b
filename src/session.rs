// Tangled from chapters/program.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A run of the program, from its words to its files.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, IsTerminal, Read};
use std::path::{Path, PathBuf};
use std::process::{self, ExitCode};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};
use std::{env, thread};

use anstream::{AutoStream, ColorChoice};
use clap::CommandFactory;
use clap::builder::StyledStr;
use glam::DVec3;
use rayon::ThreadPoolBuilder;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

use crate::analysis::{Finding, LitView, SHORTCUTS, SceneAnalysis};
use crate::bvh::{Bvh, Quality, too_small};
use crate::camera::{Camera, View, Viewpoint, direction, typed};
use crate::compare::disagreements;
use crate::compare::display::Exposure;
use crate::error::{self, Diagnostic};
use crate::film::{Film, SIDE, tile_height};
use crate::image::levels::level;
use crate::image::{Format, Image};
use crate::integrator::gather::cache::Grid;
use crate::integrator::{Alone, Together};
use crate::materials::{AlbedoTable, FaceAlbedos, Named, Surfaces};
use crate::materials::{libraries, names};
use crate::memory::zeroed;
use crate::options::{Error, Options, Target, input_name, is_dash};
use crate::output::{OutputTarget, format_of, refuse_aliases};
use crate::progress::{self, ProgressBar, expect, render_bar, step};
use crate::render::Renderer;
use crate::render::choose::{Choice, Method, Request, Sampling};
use crate::render::choose::{Setup, expected_rays};
use crate::render_loop::{Convergence, Interrupt, Limits, Stop};
use crate::report::{Kind, Report, SceneFile};
use crate::run_output::{Product, RunOutput, attributes};
use crate::scene::{Frame, MarkKind, Mesh, Scene};
use crate::scene::{begins_obj, read_file};
use crate::sensor::table::{Shape, Table, TableFormat};
use crate::sensor::{INSIDE, Sensor, Side, read_points};
use crate::sky::{Cover, Sky};
use crate::state::checkpoint::{Checkpoint, Known};
use crate::state::key::{Asked, Framing, RunKey, Sensed, Subject, entries};
use crate::state::learnt;
use crate::statistics::Accumulator;

/// The processes that render one image, as each of them sees them.
pub trait Ranks: Together {
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
        _: &'a RunKey,
    ) -> Box<dyn Renderer + 'a> {
        own
    }

    /// Renders for the leader until there is nothing more to do.
    fn serve(&self, _: Box<dyn Renderer + '_>, _: &RunKey) {}
}

impl Ranks for Alone {}

/// Runs the program with the words of the process, which leads `ranks`;
/// returns its exit status.
pub fn lead(ranks: &dyn Ranks) -> ExitCode {
    #[cfg(target_env = "gnu")]
    give_arrays_back();
    let start = Instant::now();
    if env::args_os().len() <= 1 && io::stdin().is_terminal() {
        let _ = print(&Options::command().render_help());
        return ExitCode::from(2);
    }
    let typed = Options::parse(env::args_os());
    let done = typed.and_then(|typed| run(typed, start, ranks));
    done.map_or_else(fail, |stop| status(stop, 0).into())
}

/// Says why a program ends, and with which status.
pub fn fail(error: Error) -> ExitCode {
    let (message, status) = match error {
        Error::Help(text) => match print(&text) {
            Ok(()) => return ExitCode::SUCCESS,
            Err(error) => (error.to_string(), 1),
        },
        Error::Usage(message) => (message, 2),
        Error::Failure(message) => (message, 1),
    };
    progress::error(&message);
    ExitCode::from(status)
}

/// Prints a text on standard output, on a terminal in colour.
fn print(text: &StyledStr) -> error::Result<()> {
    let plain = AutoStream::choice(&io::stdout()) == ColorChoice::Never;
    OutputTarget::standard_output()?.write(&mut |out| match plain {
        true => write!(out, "{text}"),
        false => write!(out, "{}", text.ansi()),
    })
}

/// The exit status of a stop, which is `other` if it is no signal.
fn status(stop: Stop, other: u8) -> u8 {
    if let Stop::Signal(signal) = stop { 128 + signal as u8 } else { other }
}

/// Has the allocator give each dropped array back to the system if it is
/// larger than a quarter of a megabyte.
#[cfg(target_env = "gnu")]
fn give_arrays_back() {
    // SAFETY: a parameter of the allocator, which it may refuse.
    unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, 1 << 18) };
}

fn run(
    typed: Options,
    start: Instant,
    ranks: &dyn Ranks,
) -> Result<Stop, Error> {
    let (mut options, resumed) = take_up(typed)?;
    if options.quiet {
        progress::hush();
    }
    let image = default_image(&mut options);
    let options = &options;
    // Watch for signals from the start
    let interrupt = Interrupt::listen()
        .map_err(|e| format!("cannot listen for signals: {e}"))?;
    let deadline = options.deadline(start);
    let stage = watch(interrupt.clone(), latest(options, deadline));
    let enter = |doing, bar| {
        *stage.lock().expect("no panic with the lock") = (doing, bar);
    };
    // Check what needs no scene
    if options.has_camera() {
        Camera::new(&options.view(), aspect(options.resolution))?;
    }
    start_threads(options)?;
    let files = open_files(options)?;
    let reference = read_reference(options)?;
    let learnt = options.learnt.as_deref();
    let taught = learnt.map(Checkpoint::of_file).transpose()?;
    let saved = options.save(&env::current_dir().unwrap_or_default());
    tell(ranks, &saved);
    // Load the scene and prepare it
    let began = Instant::now();
    let scene = options.scene_file().unwrap_or(Path::new("-"));
    let mut bytes = read(scene, true)?;
    if bytes.is_empty() && options.scene_file().is_none() {
        let fault =
            "standard input: empty; name a scene, as in pt scene.obj";
        return Err(fault.to_owned().into());
    }
    ranks.tell(&mut bytes);
    let points = options.points.as_deref();
    let mut points = points.map_or(Ok(vec![]), |path| read(path, false))?;
    ranks.tell(&mut points);
    let is_named = taught.is_some() || files.iter().any(names_the_scene);
    let (sources, like) = ([bytes, points], reference.as_ref());
    let mut loaded = load(options, sources, is_named, like, ranks)?;
    loaded.report.load_seconds = began.elapsed().as_secs_f64();
    enter("building the hierarchy", None);
    let world = build(loaded, options, ranks)?;
    let World { subject, analysis, bvh, .. } = &world;
    let (view, mut report) = (world.view(), world.report.clone());
    enter("choosing a method", None);
    // Choose how samples are made
    let before = resumed.as_ref().map(|saved| saved.known.run_key.sampling);
    let setup = Setup { intersector: bvh, view: &view, analysis };
    let (sampling, choice) =
        sampling(options, subject, &setup, deadline, before);
    if options.explain {
        return explain(analysis, options, sampling.method, choice);
    }
    // Collect all that decides the samples
    let run_key = RunKey {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        integrator: sampling.identity(),
        scene_sha256: report.scene.sha256.clone(),
        subject: subject.clone(),
        sampling,
        part: options.part(sampling.replicate),
        filtered: keeps_halves(options, &files, sampling, resumed.as_ref()),
    };
    report.settings.extend(settings(options, &run_key, choice));
    report.measure = options.target().unwrap_or_default().1;
    tell(ranks, &run_key);
    // Take what was learnt before
    let of_run = resumed.as_ref().map(|saved| saved.known.learnt.clone());
    let mut learnt = of_run.unwrap_or_default();
    if let (Some(path), Some(taught)) = (&options.learnt, taught) {
        let (name, Checkpoint { mut known, .. }) = (path.display(), taught);
        known.run_key.part = run_key.part;
        let belongs = known.belongs_to(&run_key);
        belongs.map_err(|fault| format!("{name}: {fault}"))?;
        learnt = known.learnt;
        if learnt.get().is_none() && sampling.method == Method::Gather {
            return Err(format!("{name}: holds nothing learnt").into());
        }
    }
    if ranks.place().1 > 1 {
        let mut bytes = vec![];
        learnt::write(&learnt, &mut bytes).map_err(|e| e.to_string())?;
        ranks.tell(&mut bytes);
    }
    let renderer = setup.renderer(&sampling, learnt.clone(), ranks);
    let renderer = &mut *ranks.lead(renderer, &run_key);
    let goal = options.goal(sampling.replicate);
    let learns =
        sampling.method == Method::Gather && learnt.get().is_none();
    let run = film_so_far(options, &run_key, goal, learns, resumed)?;
    // Prepare the files of the run
    let often = (options.every.unwrap_or(60.), options.preview);
    let known =
        Known { run_key: run_key.clone(), options: saved, report, learnt };
    let shown = run_key.subject.sensed.camera().map(|_| (bvh, &view));
    let mut output = RunOutput::new(files, often, known, shown);
    if let (Some(table), Sensor::Receivers(all)) =
        (&world.table, &world.sensor)
    {
        output.table = Some((table, all));
    }
    let auto = image.is_some().then_some(Exposure::Auto);
    output.exposure = options.exposure.or(auto);
    // Collect the limits
    let most = deadline.map_or(0., |end| seconds_to(end) * 2. / 3.);
    let seconds = output.seconds_to_write(run.0.area());
    let measure = output.known.report.measure;
    let limits = Limits {
        samples: goal.or(analysis.known.is_all().then_some(2)),
        deadline,
        reserve: seconds.map(|seconds| seconds.min(most)),
        error: options.target().map(|(error, _)| error),
        measure,
        reference: reference.as_ref().map(|image| &image.means[..]),
        interrupt: Some(&interrupt),
        clock: None,
    };
    // Render what was prepared
    let bar = render_bar(start, options.time);
    enter("rendering", Some(bar.clone()));
    Ok(render(renderer, run, &limits, output, &bar, image.as_deref())?)
}

/// Whether a film is to keep halves, so that a picture can be filtered.
fn keeps_halves(
    options: &Options,
    files: &[(Product, OutputTarget)],
    sampling: Sampling,
    resumed: Option<&Checkpoint>,
) -> bool {
    let shows = files.iter().any(|(product, _)| product.is_picture())
        || options.part(1).is_some() && !options.has_receivers();
    let is_wanted =
        sampling.method != Method::Reference && shows && !options.no_filter;
    let has = resumed.is_none_or(|saved| saved.known.run_key.filtered);
    if is_wanted && !has {
        progress::warn(
            "the run was begun without a picture: none can be filtered",
        );
    }
    is_wanted && has
}

/// The options of a run, and where it has been saved if it goes on.
fn take_up(typed: Options) -> Result<(Options, Option<Checkpoint>), Error> {
    let Some(path) = &typed.resume else { return Ok((typed, None)) };
    let saved = Checkpoint::of_file(path)?;
    Ok((typed.after(&saved.known.options)?, Some(saved)))
}

/// The PNG beside the scene, which is the image if none is named and
/// standard output is a terminal.
fn default_image(options: &mut Options) -> Option<PathBuf> {
    let is_named = !options.output.is_empty() || options.format.is_some();
    if is_named
        || options.has_receivers()
        || options.explain
        || !io::stdout().is_terminal()
    {
        return None;
    }
    let mut path = options.scene_file()?.to_owned();
    if path.extension().is_some_and(|e| e == "gz" || e == "zst") {
        path.set_extension("");
    }
    path.set_extension("png");
    options.output.push(path.clone());
    Some(path)
}

/// The time at which the program ends even if it has no sample.
fn latest(options: &Options, deadline: Option<Instant>) -> Option<Instant> {
    let time = options.time.filter(|_| !options.explain)?;
    let more = Duration::try_from_secs_f64((0.025 * time).max(0.5));
    deadline?.checked_add(more.ok()?)
}

/// What the program does, and its bar when it renders.
type Doing = Mutex<(&'static str, Option<ProgressBar>)>;

/// Starts a thread that ends the program if a signal comes before the first
/// pass, or the time `end`, and answers a signal that comes later; returns
/// where it looks up what is done.
fn watch(interrupt: Interrupt, end: Option<Instant>) -> Arc<Doing> {
    let told = Arc::new(Mutex::new(("reading", None)));
    let doing = told.clone();
    thread::spawn(move || {
        loop {
            thread::sleep(Duration::from_millis(50));
            let doing = doing.lock().expect("no panic with the lock");
            // Answer a signal, or the end of the time
            let signal = interrupt.signal().map(Stop::Signal);
            let over = end.is_some_and(|end| Instant::now() >= end);
            match (&*doing, signal.or(over.then_some(Stop::Time))) {
                ((what, None), Some(stop)) => {
                    progress::error(&stop.without_image(what));
                    process::exit(status(stop, 1).into());
                }
                ((_, Some(bar)), Some(Stop::Signal(_))) => {
                    return progress::answer(bar);
                }
                _ => (),
            }
        }
    });
    told
}

fn aspect((width, height): (u32, u32)) -> f64 {
    f64::from(width) / f64::from(height)
}

/// The files that a run will write, none of them touched yet.
fn open_files(
    options: &Options,
) -> Result<Vec<(Product, OutputTarget)>, String> {
    // Refuse files that are named twice
    let reference = options.reference.as_deref();
    let (scene, dash) = (options.scene_file(), Path::new("-"));
    let others = [reference, options.points.as_deref()];
    if scene.is_none() && others.contains(&Some(dash)) {
        return Err("standard input can be read once only".to_owned());
    }
    let reports = options.report.iter().map(PathBuf::as_path);
    let state = options.checkpoint.as_deref().into_iter();
    let written =
        options.images().chain(reports.clone()).chain(state.clone());
    let read = [scene, reference, options.learnt.as_deref(), others[1]];
    refuse_aliases(read.into_iter().flatten(), written)?;
    // Decide which files may be replaced
    let force = |path: &Path| {
        let old = options.replaced.iter().map(|old| old.canonicalize());
        let is_own = |new| old.flatten().any(|old| old == new);
        options.force || path.canonicalize().is_ok_and(is_own)
    };
    let usual = options.format.unwrap_or(Format::Pgm);
    let open = |product: Result<_, String>, path: &Path| {
        Ok((product?, OutputTarget::file(path, force(path))?))
    };
    let image = |path| match options.has_receivers() {
        true => {
            Ok(Product::Table(TableFormat::of(path, options.vertices)?))
        }
        false => Ok(Product::Image(format_of(path, usual)?)),
    };
    let images = options.images().map(|path| open(image(path), path));
    let report = |path: &Path| match Kind::of(path)? {
        Kind::Html if options.has_receivers() => Err(format!(
            "{}: a page shows an image, and receivers have none",
            path.display()
        )),
        kind => Ok(Product::Report(kind)),
    };
    let reports = reports.map(|path| open(report(path), path));
    let state = state.map(|path| open(Ok(Product::State), path));
    images.chain(state).chain(reports).collect()
}

fn read_reference(options: &Options) -> Result<Option<Image>, String> {
    let Some(path) = &options.reference else { return Ok(None) };
    // Read an image that needs no note
    let mut faults = Vec::new();
    let note = &mut |fault: &str| faults.push(fault.to_owned());
    let image = Image::read_noting(path, note)?;
    if let Some(fault) = faults.first() {
        return Err(format!(
            "{fault}; a reference needs the radiance of each pixel"
        ));
    }
    let (name, (w, h)) = (path.display(), options.window().size);
    let Image { width, height, .. } = image;
    if (width, height) != (w, h) {
        return Err(format!(
            "{name}: is {width}x{height} pixels large, and the image {w}x{h}"
        ));
    }
    // Warn of a reference with our seed
    let ours = options.seed.to_string();
    if image.attributes.get("seed") == Some(&ours) {
        progress::warn(
            "the reference has the seed of this run: its true errors are \
             larger than they will seem (choose another seed with -s)",
        );
    }
    Ok(Some(image))
}

/// Starts as many threads as the options say.
///
/// # Errors
/// The system refuses them.
pub fn start_threads(options: &Options) -> Result<(), String> {
    let threads = options.threads.unwrap_or(0) as usize;
    let pool = ThreadPoolBuilder::new().num_threads(threads);
    pool.build_global().map_err(|e| format!("cannot start threads: {e}"))
}

/// A scene as it was read.
struct Loaded {
    scene: Scene,
    subject: Subject,
    /// The report, which begins.
    report: Report,
    albedos: FaceAlbedos,
    sensor: Sensor,
    /// What is shown beside the values of receivers.
    table: Option<Table>,
}

/// Reads a scene, and points if receivers are asked for there; with a hash of
/// the bytes if a file will name them.
fn load(
    options: &Options,
    [bytes, points]: [Vec<u8>; 2],
    is_named: bool,
    reference: Option<&Image>,
    ranks: &dyn Ranks,
) -> Result<Loaded, String> {
    let mesh = parse(options, &bytes)?;
    // Hash the bytes if a file will name them
    let is_named = is_named || reference.is_some();
    let hash = is_named.then(|| sha256(&bytes));
    let sha256 = hash.unwrap_or_default();
    drop(bytes);
    prepare(options, (mesh, sha256), &points, reference, ranks)
}

/// Prepares a mesh whose bytes have this hash.
fn prepare(
    options: &Options,
    (mesh, sha256): (Mesh, String),
    points: &[u8],
    reference: Option<&Image>,
    ranks: &dyn Ranks,
) -> Result<Loaded, String> {
    let file = options.input_name();
    let named = albedos_by_name(options, &mesh, ranks)?;
    let albedos = FaceAlbedos::new(&mesh.marks, &named, options.albedo())
        .map_err(|error| error.of_file(&file))?;
    let (receivers, table) =
        asked(options, points, &mesh, &albedos)?.unzip();
    let subject = subject(options, &mesh, named, receivers);
    // Say where the camera stands
    let framing = subject.sensed.camera();
    if let (Some(framing), false) = (framing, options.has_camera()) {
        let View { position, target, up, .. } = framing.view;
        let [p, t, u] = [position, target, up].map(typed);
        let mut options = format!("-p {p} -t {t}");
        if up != DVec3::Z {
            options += &format!(" -u {u}");
        }
        let zenith = subject.sky.zenith;
        if zenith != Sky::new(up).zenith {
            options += &format!(" --zenith {}", direction(zenith));
        }
        progress::inform(&format!("the camera stands outside: {options}"));
    }
    // Begin a report of the scene
    let triangles = mesh.triangles.len() as u64;
    let mut report = Report::default();
    report.sign("pt");
    report.scene = SceneFile { file, sha256, triangles };
    let Sky { zenith, cover, .. } = subject.sky;
    report.light =
        format!("{cover:?}, zenith {}", direction(zenith)).to_lowercase();
    report.light += &subject.ground.map_or(String::new(), |albedo| {
        format!(", above a ground of albedo {albedo}")
    });
    if let Some(up) = unsaid_up(options, &mesh).filter(|&up| up != zenith) {
        let up = direction(up);
        report.light += &format!("; but {up} looks up: -u {up}");
    }
    // Refuse a reference of something else
    if let (Some(image), Some(path)) = (reference, &options.reference) {
        let mut ours = attributes(&entries(&subject));
        ours.insert("scene_sha256".into(), report.scene.sha256.clone());
        let differing = disagreements(&image.attributes, &ours).join(", ");
        if !differing.is_empty() {
            let differing =
                format!("something else than this run: {differing}");
            return Err(format!("{}: shows {differing}", path.display()));
        }
    }
    let scene = Scene::of(mesh);
    let sensor = match &table {
        Some(table) => Sensor::Receivers(table.receivers(&scene)),
        None => camera(&subject.sensed, &scene.frame)?,
    };
    Ok(Loaded { scene, subject, report, albedos, sensor, table })
}

/// Parses the mesh of a scene, and warns of what is odd.
fn parse(options: &Options, bytes: &[u8]) -> Result<Mesh, String> {
    let file = options.input_name();
    let step = step(format!("parsing {file}"), None);
    let read = read_file(bytes).map_err(|error| error.of_file(&file));
    drop(step);
    let (mesh, warnings) = read?;
    warn_all(&file, warnings);
    Ok(mesh)
}

/// Prints warnings of a file.
fn warn_all(file: &str, warnings: Vec<Diagnostic>) {
    for warning in warnings {
        progress::warn(&warning.of_file(file).to_string());
    }
}

/// The receivers that are asked for, if any, and their table.
fn asked(
    options: &Options,
    points: &[u8],
    mesh: &Mesh,
    albedos: &FaceAlbedos,
) -> Result<Option<(Asked, Table)>, String> {
    let (asked, shape) = match options {
        Options { points: Some(path), .. } => {
            let (file, mut odd) = (input_name(path), vec![]);
            let read = read_points(points, &mut odd);
            let read = read.map_err(|error| error.of_file(&file))?;
            warn_all(&file, odd);
            (Asked::Points(sha256(points)), Shape::Points(read))
        }
        &Options { faces: Some(side), .. } => {
            (Asked::Faces(side), Shape::Faces(mesh.faces()))
        }
        Options { vertices: true, .. } => {
            (Asked::Vertices, Shape::Vertices)
        }
        _ => return Ok(None),
    };
    let albedos = options.radiosity.then(|| albedos.clone());
    let mesh = options.points.is_none().then(|| mesh.clone());
    let mesh = mesh.unwrap_or_default();
    let backs = options.faces.unwrap_or(Side::Front).backs();
    let grey = |value| level(value, 255) as u8;
    let file = options.points.as_deref().map(input_name);
    let file = file.unwrap_or(options.input_name());
    let table = Table { shape, backs, mesh, file, albedos, grey };
    Ok(Some((asked, table)))
}

/// The camera of what is shown.
fn camera(sensed: &Sensed, frame: &Frame) -> Result<Sensor, String> {
    let framing = sensed.camera().ok_or("there is no camera")?;
    let camera = Camera::new(&framing.view, aspect(framing.resolution))?;
    let entrance = frame.entrance(camera.position);
    Ok(Sensor::Camera(camera, entrance))
}

/// The albedos that have names.
fn albedos_by_name(
    options: &Options,
    mesh: &Mesh,
    ranks: &dyn Ranks,
) -> Result<Named, String> {
    let (file, band) = (options.input_name(), options.band);
    let named_albedos = options.named_albedos();
    let mut named = Named { named_albedos, band, ..Named::default() };
    let ignored = names(&mesh.marks, MarkKind::Material).count();
    if options.materials {
        // Find the albedos of materials, or hear of them
        let folder = options.scene_file().and_then(Path::parent);
        let folder = folder.unwrap_or(Path::new(""));
        let read = if ranks.place().0 > 0 {
            hear(ranks)?.unwrap_or_else(|| Ok(Default::default()))
        } else {
            let read = libraries(&mesh.marks, (&file, folder), band);
            let read = read.map_err(String::from);
            tell(ranks, &read);
            read
        };
        let (materials, warnings) = read?;
        named.materials = materials;
        warn_all(&file, warnings);
    } else if ignored > 0 && named.named_albedos.is_empty() {
        let albedo = options.albedo();
        progress::warn(&format!(
            "{file}: its materials are ignored, {ignored} of them: every surface \
             has the albedo {albedo} (--materials)"
        ));
    }
    Ok(named)
}

/// The axis that looks up in a mesh, if no option says which.
fn unsaid_up(options: &Options, mesh: &Mesh) -> Option<DVec3> {
    if options.says_up() { None } else { mesh.up() }
}

/// What is sensed of a mesh, by receivers or by a camera.
fn subject(
    options: &Options,
    mesh: &Mesh,
    named: Named,
    receivers: Option<Asked>,
) -> Subject {
    let &Options { resolution, crop, ground, .. } = options;
    let mut view = options.view();
    let zenith = match options.zenith {
        None => Sky::new(view.up).zenith,
        Some(zenith) => Sky::with(zenith, Cover::Uniform).zenith,
    };
    if options.zenith.is_some() && view.up == DVec3::Z {
        view.up = zenith;
    }
    let sky = Sky {
        behind: options.background,
        ..Sky::with(zenith, options.sky)
    };
    if !options.has_camera() {
        let from = options.viewpoint.unwrap_or(Viewpoint::Iso);
        let corners = mesh.triangles.iter().flatten();
        let points = corners.map(|&i| &mesh.vertices[i as usize]);
        let outside =
            view.outside(from, zenith, points, aspect(resolution));
        view = outside.unwrap_or(view);
    }
    let framing = Framing { resolution, crop, view };
    let sensed = receivers.map_or(Sensed::Camera(framing), |receivers| {
        Sensed::Receivers { receivers, count: 0 }
    });
    Subject { sensed, albedo: options.albedo(), named, sky, ground }
}

/// The bytes of a file or of standard input.
fn read(path: &Path, is_scene: bool) -> Result<Vec<u8>, String> {
    let file = input_name(path);
    let _step = step(format!("reading {file}"), None);
    let fault = |e| format!("{file}: cannot read: {e}");
    let mut pipe: Box<dyn Read> = match path {
        path if is_dash(path) => Box::new(io::stdin()),
        path if path.is_file() => return fs::read(path).map_err(fault),
        path => Box::new(File::open(path).map_err(fault)?),
    };
    let mut bytes = Vec::new();
    pipe.by_ref().take(START).read_to_end(&mut bytes).map_err(fault)?;
    let is_long = is_scene && bytes.len() as u64 == START;
    if is_long && !begins_obj(&bytes) {
        return Err(fault(io::Error::other(
            "no vertex in the first 64 MiB",
        )));
    }
    pipe.read_to_end(&mut bytes).map_err(fault)?;
    Ok(bytes)
}

/// So many bytes of an OBJ have a vertex.
const START: u64 = 1 << 26;

/// A hash of some bytes, in hexadecimal digits.
fn sha256(bytes: &[u8]) -> String {
    let hash = Sha256::digest(bytes);
    hash.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Whether a file names the scene by its hash.
fn names_the_scene((product, _): &(Product, OutputTarget)) -> bool {
    !matches!(product, Product::Image(format) if *format != Format::Exr)
}

/// Seconds in which a thread looks for the background of a tile, about.
const TILE_SEARCH: f64 = 3e-6;

/// What is shown of a scene, what is found about it, and its hierarchy.
pub struct World {
    /// What is shown.
    pub subject: Subject,
    report: Report,
    /// What starts the samples.
    pub sensor: Sensor,
    albedos: AlbedoTable,
    /// The map from the coordinates of the file.
    pub frame: Frame,
    /// The hierarchy.
    pub bvh: Bvh,
    /// The faces that the scene has left out.
    pub left_out: [Vec<u32>; 2],
    analysis: SceneAnalysis,
    /// What the values of receivers are written with.
    table: Option<Table>,
}

impl World {
    /// What the renderers see.
    pub fn view(&self) -> LitView<'_> {
        let Self { subject, sensor, albedos, .. } = self;
        let surfaces = Surfaces::new(albedos, subject.ground);
        let (sky, resolution) = (subject.sky, subject.sensed.resolution());
        LitView { sensor, sky, surfaces, resolution }
    }
}

impl World {
    /// Reads a scene, to be shown in several ways.
    ///
    /// # Errors
    /// The scene cannot be read, or the options do not suit it.
    pub fn open(options: &Options) -> Result<(Mesh, Self), String> {
        let scene = options.scene_file().unwrap_or(Path::new("-"));
        let mut options = options.clone();
        (options.error, options.samples) = (None, Some(64));
        let mesh = parse(&options, &read(scene, true)?)?;
        options.up = unsaid_up(&options, &mesh).unwrap_or(options.up);
        let named = (mesh.clone(), String::new());
        let loaded = prepare(&options, named, &[], None, &Alone)?;
        Ok((mesh, build(loaded, &options, &Alone)?))
    }

    /// Shows the scene, of which this is the mesh, as other options say; its
    /// materials stay as they were read.
    ///
    /// # Errors
    /// The options do not suit the scene; it is shown as before.
    pub fn show(
        &mut self,
        options: &Options,
        mesh: &Mesh,
    ) -> Result<(), String> {
        let named_albedos = options.named_albedos();
        let named = Named { named_albedos, ..self.subject.named.clone() };
        let mut options = options.clone();
        options.up = unsaid_up(&options, mesh).unwrap_or(options.up);
        let new = subject(&options, mesh, named, None);
        let sensor = camera(&new.sensed, &self.frame)?;
        let old = &self.subject;
        if (old.albedo, &old.named) != (new.albedo, &new.named) {
            let marks = &mesh.marks;
            let faces = FaceAlbedos::new(marks, &new.named, new.albedo)?;
            self.albedos = AlbedoTable::new(&faces, &self.bvh)?;
        }
        let zenith = |s: &Subject| s.ground.map(|_| s.sky.zenith);
        if zenith(old) != zenith(&new) {
            self.bvh.set_ground(zenith(&new));
        }
        (self.subject, self.sensor) = (new, sensor);
        Ok(())
    }
}

/// Prepares a scene that was read.
fn build(
    loaded: Loaded,
    options: &Options,
    ranks: &dyn Ranks,
) -> Result<World, String> {
    let began = Instant::now();
    let Loaded { scene, mut subject, report, albedos, mut sensor, table } =
        loaded;
    // Leave out what would take too long to look for
    let (width, height) = subject.sensed.resolution();
    let tiles = f64::from(width) * f64::from(height) / 256.;
    let seconds = tiles * TILE_SEARCH / rayon::current_num_threads() as f64;
    let time = options.time.filter(|_| !options.explain);
    let kept = match time.is_some_and(|time| seconds > 0.05 * time) {
        _ if options.keep_all => &SHORTCUTS[..],
        true => &["background"],
        false => &[],
    };
    let Scene { frame, triangles, left_out } = scene;
    // Guess the rays of this process
    let (area, is_outside) = match &sensor {
        Sensor::Camera(_, entrance) => {
            let band = options.tiles.unwrap_or((1, 1));
            let window = subject.sensed.window().band(band, SIDE);
            (window.area(), !entrance.is_inside)
        }
        Sensor::Receivers(receivers) => (receivers.count(), false),
    };
    let enough = |target: Target| {
        let deviation = match &sensor {
            _ if target.is_relative => 1.,
            Sensor::Camera(_, entrance) if entrance.is_inside => 0.006,
            _ => 0.25,
        };
        (deviation / target.error).powi(2).max(1.)
    };
    let limits =
        [options.goal(1).map(|n| n as f64), options.error.map(enough)];
    let samples = limits.into_iter().flatten().reduce(f64::min);
    let paths = samples.map(|n| n * area as f64);
    let rays =
        expected_rays((is_outside, subject.albedo), paths, options.time);
    let rays = rays / ranks.place().1 as f64;
    let quality = Quality::expecting(triangles.len(), rays);
    // Warn of triangles that are too small
    let (count, all) = (too_small(&triangles), triangles.len());
    if count > 0 {
        progress::warn(&format!(
            "{count} of {all} triangles: smaller than 2^-40 of the largest, or \
             2^-43 of the scene; close to larger ones the light may be wrong"
        ));
    }
    // Build the hierarchy and show how far it is
    let step = step("building the hierarchy".into(), Some(all as u64));
    let placed = |count: usize| step.set_position(count as u64);
    let bvh = Bvh::of(triangles, quality, options.isa(), &placed);
    let mut bvh = bvh.map_err(|e| e.to_string())?;
    drop(step);
    bvh.set_ground(subject.ground.map(|_| subject.sky.zenith));
    let albedos = AlbedoTable::new(&albedos, &bvh)?;
    // Settle the receivers
    if let (Some(table), Sensor::Receivers(all)) = (&table, &mut sensor) {
        let grid = Grid::around(&all.middles());
        let is_oriented =
            options.points.is_some() && left_out[1].is_empty();
        let around = (&bvh, &frame, subject.sky.zenith, is_oriented);
        all.order(around, |hit| grid.order(hit));
        warn_all(&table.file, table.odd(all, |why, _| why != INSIDE));
        let (count, name) = (all.count(), table.shape.name());
        if count == 0 {
            return Err(format!("none of the {name} has a value"));
        }
        if let Sensed::Receivers { count: of, .. } = &mut subject.sensed {
            *of = count as u32;
        }
        let height = tile_height(true);
        let rows = subject.sensed.window().tile_rows(height);
        if options.tiles.is_some_and(|(_, n)| n > rows) {
            return Err(format!(
                "--tiles: not more bands than there are tiles of {name}: {rows}"
            ));
        }
    }
    let mut world = World {
        subject,
        report,
        sensor,
        albedos,
        frame,
        bvh,
        left_out,
        analysis: SceneAnalysis::default(),
        table,
    };
    // Analyse the scene
    let World { bvh, left_out, .. } = &world;
    let analysis = SceneAnalysis::find(left_out, bvh, &world.view(), kept);
    let report = &mut world.report;
    report.settings = entries(&world.subject);
    report.left_out = analysis.left_out().cloned().collect();
    let (known, all) = analysis.known.count();
    let why = report.left_out.last().filter(|_| 0 < all && known == all);
    why.iter().for_each(|found| progress::warn(&found.why));
    let quality = quality.to_string();
    report.settings.insert("hierarchy".into(), quality.into());
    report.build_seconds = began.elapsed().as_secs_f64();
    world.analysis = analysis;
    Ok(world)
}

/// Tells what can be left out, and what the rest is made of.
fn explain(
    analysis: &SceneAnalysis,
    options: &Options,
    method: Method,
    choice: Option<Choice>,
) -> Result<Stop, Error> {
    let mut lines = String::new();
    for Finding { fact, holds, why } in &analysis.findings {
        let sign = if *holds { "left out" } else { "-" };
        lines += &format!("{fact:13}{sign:10}{why}\n");
    }
    // Name the parts that do the rest
    let why = choice.map_or(method.to_string(), |why| why.to_string());
    let parts = match analysis.known.is_all() {
        true => "none: no ray".to_owned(),
        false => format!("{}; {method}", options.isa()),
    };
    for (name, text) in [("method", why), ("intersector", parts)] {
        lines += &format!("{name:13}{text}\n");
    }
    let out = OutputTarget::standard_output()?;
    out.write(&mut |out| out.write_all(lines.as_bytes()))?;
    Ok(Stop::Samples)
}

/// How the samples are made: as in the checkpoint, if there is one. And what
/// a pilot has found, if it has chosen.
fn sampling(
    options: &Options,
    subject: &Subject,
    setup: &Setup,
    deadline: Option<Instant>,
    saved: Option<Sampling>,
) -> (Sampling, Option<Choice>) {
    let request = Request {
        method: options.integrator,
        seed: options.seed,
        window: subject.sensed.window(),
        samples: options.samples(),
        error: options.target(),
        time: options.time,
        left: deadline.map(seconds_to),
    };
    let (sampling, choice) = setup.decide(&request, saved);
    // Warn if it is not the method that is asked for
    let (wanted, chosen) = (request.method, sampling.method);
    let wanted = wanted.or(saved.map(|saved| saved.method));
    if let Some(wanted) = wanted.filter(|&wanted| wanted != chosen) {
        progress::warn(&format!(
            "--time leaves too little for a first sample of each pixel \
             by {wanted}: the method is {chosen}"
        ));
    }
    (sampling, choice)
}

/// The seconds from now to a time, which may be over.
fn seconds_to(end: Instant) -> f64 {
    end.saturating_duration_since(Instant::now()).as_secs_f64()
}

/// What describes the run, by name, for the report.
fn settings(
    options: &Options,
    run_key: &RunKey,
    choice: Option<Choice>,
) -> Map<String, Value> {
    let reference = options.reference.as_ref();
    let RunKey { sampling, part, .. } = run_key;
    let mut settings = entries(&json!({
        "seed": sampling.seed,
        "spp": part.map_or(options.samples(), |part| Some(part.count())),
        "time": options.time,
        "error": options.target().map(|(error, _)| error),
        "reference": reference.map(|path| path.display().to_string()),
        "isa": options.isa().to_string(),
        "threads": rayon::current_num_threads(),
        "integrator": sampling.method.to_string(),
    }));
    settings
        .extend(choice.map(|c| ("choice".into(), json!(c.to_string()))));
    settings.extend(part.map(|part| ("part".into(), json!(part))));
    settings
}

/// The film of a run and what it has done: nothing yet, or what is saved.
fn film_so_far(
    options: &Options,
    run_key: &RunKey,
    goal: Option<u64>,
    learns: bool,
    resumed: Option<Checkpoint>,
) -> Result<(Film, Convergence), String> {
    // Ask for the memory of the film
    let [whole, area] = run_key.windows().map(|window| window.area());
    let parts = [(true, area), (run_key.filtered, area), (learns, whole)];
    let parts = parts.into_iter().filter(|&(is_needed, _)| is_needed);
    let sums: usize = parts.map(|(_, area)| area).sum();
    zeroed::<Accumulator>(sums).map_err(|_| {
        let bytes = progress::metric(64. * sums as f64);
        format!("too little memory: {bytes}B more are needed")
    })?;
    let mut film = run_key.film();
    let mut convergence = Convergence::default();
    // Warn of a part without a sample
    if options.range.is_some_and(|(a, b)| a < b) && goal == Some(0) {
        let together = film.replicate;
        progress::warn(&format!(
            "the part has no sample: {together} are placed together"
        ));
    }
    // Go on from a checkpoint
    if let (Some(saved), Some(path)) = (resumed, &options.resume) {
        let name = path.display();
        let resumed = saved.resume(run_key, &mut film);
        convergence = resumed.map_err(|e| format!("{name}: {e}"))?;
        let spp = convergence.spp;
        if goal.is_some_and(|n| 0 < n && n <= spp) {
            progress::warn(&format!(
                "{name}: holds {spp} samples already (ask for more with -n)"
            ));
        }
    }
    Ok((film, convergence))
}

/// Renders until a limit is reached, keeps files and bar up to date, and
/// prints a summary at the end, which names the `image`.
fn render(
    renderer: &mut dyn Renderer,
    (mut film, mut convergence): (Film, Convergence),
    limits: &Limits,
    mut output: RunOutput,
    bar: &ProgressBar,
    image: Option<&Path>,
) -> Result<Stop, String> {
    let (began, area) = (Instant::now(), film.area());
    // Keep the bar up to date
    let show = |convergence: &Convergence| {
        let spp = convergence.expected(limits, area);
        let all = spp.map(|spp| spp.saturating_mul(area));
        let paths = convergence.spp.saturating_mul(area);
        let mut known = format!("{} spp, ", convergence.spp);
        if let Some(rmse) = convergence.last().rmse {
            known += &format!("rmse {rmse:.2e}, ");
        }
        expect(bar, (paths, all), "paths", known);
    };
    let training = renderer.training_rays(area);
    match training {
        0 => show(&convergence),
        rays => expect(bar, (0, Some(rays)), "rays", "learning, ".into()),
    }
    // Write files between two passes
    let mut after = |convergence: &Convergence, film: &Film| {
        show(convergence);
        let written = output.write(convergence, film, Some(Instant::now()));
        if let Err(message) = written {
            bar.suspend(|| progress::warn(&message));
        }
    };
    let advance = |n| bar.inc(n);
    let stop =
        convergence.run(renderer, &mut film, limits, &advance, &mut after);
    bar.finish_and_clear();
    // Warn if there was no time
    let late = limits.deadline.is_some_and(|end| began > end);
    if late || (convergence.spp == 0 && stop == Stop::Time) {
        progress::warn(
            "to load, to build and to make one sample of each pixel took \
             longer than --time allows",
        );
    }
    // End without an image if there is no sample
    let is_over = matches!(stop, Stop::Time | Stop::Signal(_));
    if is_over && film.unsampled() == film.area() {
        let learns = renderer.training_rays(area) > 0;
        let doing = if learns { "learning" } else { "rendering" };
        let message = stop.without_image(doing);
        if stop == Stop::Time {
            return Err(message);
        }
        progress::error(&message);
        return Ok(stop);
    }
    let learns = output.known.run_key.only_learns();
    if let Some((table, all)) = output.table.filter(|_| !learns) {
        // Warn of receivers without light
        let first = film.window.corner.1 as usize;
        let means = all.numbers[first..].iter().zip(film.means());
        let dark =
            means.filter(|(_, mean)| *mean == 0.).map(|(number, _)| number);
        let dark: BTreeSet<_> = dark.collect();
        if dark.len() as u64 == film.area() {
            progress::warn(
                "no light arrives: does a face close each opening?",
            );
        }
        let is_told = |why, number| why == INSIDE && dark.contains(&number);
        warn_all(&table.file, table.odd(all, is_told));
    }
    output.write(&convergence, &film, None)?;
    if learns {
        let Convergence { rays, seconds, .. } = convergence;
        progress::inform(&format!("learnt    {rays} rays, {seconds:.3} s"));
        return Ok(stop);
    }
    // Print the summary
    if !progress::is_quiet() {
        let report = output.known.report.complete(&film);
        let file = image.map(|path| ("file", path.display().to_string()));
        for (name, text) in report.summary(area).into_iter().chain(file) {
            progress::inform(&format!("{name:10}{text}"));
        }
    }
    Ok(stop)
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
    let options = Options::restore(&options)?;
    progress::hush();
    start_threads(&options)?;
    let Some(bytes) = ranks.hear() else { return Ok(()) };
    let Some(points) = ranks.hear() else { return Ok(()) };
    let loaded = load(&options, [bytes, points], false, None, ranks)?;
    let world = build(loaded, &options, ranks)?;
    let World { bvh, analysis, .. } = &world;
    let view = world.view();
    let Some(run_key) = hear::<RunKey>(ranks)? else { return Ok(()) };
    let Some(bytes) = ranks.hear() else { return Ok(()) };
    let learnt = learnt::read(&mut &bytes[..], &run_key)
        .map_err(|e| e.to_string())?;
    let setup = Setup { intersector: bvh, view: &view, analysis };
    let renderer = setup.renderer(&run_key.sampling, learnt, ranks);
    ranks.serve(renderer, &run_key);
    Ok(())
}
