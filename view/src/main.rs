// Tangled from chapters/view.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command `ptview`: turns a scene in the browser.
//!
//! The main thread answers requests and sends images to pages; another one
//! renders them.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, RwLock};
use std::time::{Duration, Instant};
use std::{env, mem, thread};

use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path, rejection::JsonRejection};
use axum::http::header::{CONTENT_TYPE, HOST};
use axum::http::{StatusCode, uri::Authority};
use axum::response::IntoResponse;
use axum::routing::{get, post};
use axum::{Json, Router};
use http_body_util::channel::{Channel, Sender};
use hyper::{Request, body::Incoming};
use hyper::{server::conn::http1, service::service_fn};
use hyper_util::rt::TokioIo;
use litpt::analysis::LitView;
use litpt::analysis::background::KnownPixels;
use litpt::bvh::GROUND;
use litpt::camera::{View, typed};
use litpt::cli::options::{self, Options, ViewOptions, parse_words};
use litpt::cli::ranks::start_threads;
use litpt::cli::run::fail;
use litpt::cli::{progress, watchdog};
use litpt::compare::display::auto_stops;
use litpt::error::{Error, Result};
use litpt::film::{ErrorNorm, Film, NEIGHBOUR_WEIGHT, Watch};
use litpt::filter::{Filtered, fragments, surface_means};
use litpt::host::{Event, Host, Interrupt};
use litpt::inputs::Inputs;
use litpt::integrator::gather::cache::RadianceCache;
use litpt::integrator::gather::{Allocation, Gather, Learnt};
use litpt::integrator::{Renderer, SingleProcess};
use litpt::key::Subject;
use litpt::plan::{Budget, Plan, is_dash};
use litpt::render_loop::{Convergence, CurvePoint, Limits};
use litpt::run::Run;
use litpt::scene::Mesh;
use litpt::sky::Sky;
use litpt::world::World;
use serde_json::{Map, Value, json};
use tempfile::TempDir;
use tokio::time::{sleep, timeout};
use tokio::{net::TcpListener, runtime::Builder, sync::watch};
use tokio_io_timeout::TimeoutWriter;
use tower_service::Service;

/// The view that the pages request.
#[derive(Default)]
struct Wanted {
    settings: Settings,
    /// How often it has changed.
    number: u64,
    /// Whether the scene is to be read again.
    reads: bool,
}

/// A scene, its view, and the pages that show it.
#[derive(Default)]
struct Viewer {
    options: ViewOptions,
    /// The beginning of the address: the host, and a secret.
    host: String,
    token: String,
    scene: RwLock<Option<(Arc<Mesh>, World)>>,
    wanted: Mutex<Wanted>,
    changed: Condvar,
    /// Stops the current run.
    interrupt: Interrupt,
    /// The newest image as a message, and the state of the view by name.
    image: watch::Sender<Bytes>,
    state: watch::Sender<Map<String, Value>>,
    render: Mutex<Option<Render>>,
}

/// Locks a value for one thread.
fn lock<T>(value: &Mutex<T>) -> MutexGuard<'_, T> {
    value.lock().expect("no panic with the lock")
}

/// A message of a stream: the lengths of its two parts, a text and numbers.
fn message(text: &Value, numbers: &[u8]) -> Bytes {
    let text = text.to_string();
    let lengths = [text.len(), numbers.len()].map(|n| n as u32);
    let lengths = lengths.map(u32::to_le_bytes).concat();
    [&lengths, text.as_bytes(), numbers].concat().into()
}

/// A run of pt that renders the view to files.
struct Render {
    pt: Child,
    folder: TempDir,
    /// Whether it still runs.
    runs: bool,
}

/// The files of a render, and its log.
const FILES: [&str; 4] =
    ["image.png", "image.exr", "report.html", "report.json"];
const LOG: &str = "log";

fn main() -> ExitCode {
    run().map_or_else(|e| fail(e).into(), |()| ExitCode::SUCCESS)
}

fn run() -> Result<(), options::Error> {
    let mut options: ViewOptions = parse_words(env::args_os())?;
    let interrupt = watchdog::listen()?;
    let settings = begin(&mut options.words);
    // Make a viewer of the scene
    let token = secret().map_err(Error::cannot("read", RANDOM))?;
    let wanted = Mutex::new(Wanted { settings, ..Wanted::default() });
    let mut viewer = Viewer { options, token, wanted, ..Viewer::default() };
    let words = viewer.words(&lock(&viewer.wanted).settings);
    let typed = Options::parse(words)?;
    let first = typed.plan(None, false)?;
    let is_whole = first.camera().is_some_and(|it| it.crop.is_none());
    let prints =
        typed.execution.dry_run || typed.execution.sample.is_some();
    if !is_whole || prints || is_dash(&first.scene) {
        let fault = "ptview shows whole images of a file: no receivers, and no \
                     --crop, --sample or --dry-run";
        return Err(Error::from(fault).into());
    }
    start_threads(&first)?;
    viewer.scene = RwLock::new(Some(open(first)?));
    progress::set_quiet(true);
    // Serve a page on a free port of this machine
    let fault = |e| Error::from(format!("cannot serve a page: {e}"));
    let runtime = Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(fault)?;
    let listener = runtime.block_on(TcpListener::bind("127.0.0.1:0"));
    let listener = listener.map_err(fault)?;
    viewer.host = listener.local_addr().map_err(fault)?.to_string();
    let address = format!("http://{}/{}/", viewer.host, viewer.token);
    let _ = writeln!(io::stdout(), "{address}");
    open_browser(&address);
    let viewer: &Viewer = Box::leak(Box::new(viewer));
    thread::spawn(|| viewer.work());
    runtime.block_on(async {
        tokio::spawn(viewer.serve(listener));
        while interrupt.signal().is_none() {
            sleep(Duration::from_millis(50)).await;
            viewer.watch_render();
        }
    });
    viewer.stop_render();
    *lock(&viewer.render) = None;
    Ok(())
}

const RANDOM: &str = "/dev/urandom";

/// Enough random digits that nobody guesses them.
fn secret() -> io::Result<String> {
    let mut bytes = [0; 16];
    File::open(RANDOM)?.read_exact(&mut bytes)?;
    Ok(format!("{:032x}", u128::from_ne_bytes(bytes)))
}

/// Opens a page if there is a display.
fn open_browser(address: &str) {
    let has = |name| env::var_os(name).is_some_and(|text| !text.is_empty());
    let is_mac = cfg!(target_os = "macos");
    if is_mac || has("DISPLAY") || has("WAYLAND_DISPLAY") {
        let opener = if is_mac { "open" } else { "xdg-open" };
        let mut command = Command::new(opener);
        let command = command.arg(address).stdout(Stdio::null());
        let _ = command.stderr(Stdio::null()).spawn();
    }
}

/// Names of options of pt, and their values.
type Settings = BTreeMap<String, String>;

/// The options that a page sets, and their long names.
const SETTINGS: [(&str, &str); 13] = [
    ("-p", "--position"),
    ("-t", "--target"),
    ("-u", "--up"),
    ("-F", "--fov"),
    ("-d", "--resolution"),
    ("-r", "--albedo"),
    ("--view", "--view"),
    ("--sky", "--sky"),
    ("--sun", "--sun"),
    ("--direct", "--direct"),
    ("--zenith", "--zenith"),
    ("--ground", "--ground"),
    ("--error", "--error"),
];

/// The first settings of a view, which are removed from the words.
fn begin(words: &mut Vec<String>) -> Settings {
    let mut settings = Settings::new();
    let mut typed = mem::take(words).into_iter().peekable();
    while let Some(word) = typed.next() {
        let is_long = word.starts_with("--");
        let end = word.find('=').filter(|_| is_long);
        let end = end.unwrap_or(if is_long { word.len() } else { 2 });
        let (name, rest) =
            word.split_at_checked(end).unwrap_or((&*word, ""));
        let setting =
            SETTINGS.iter().find(|it| it.0 == name || it.1 == name);
        let is_plain = |value: &String| !value.contains('=');
        let value = match rest {
            "" => typed.next_if(|next| setting.is_some() && is_plain(next)),
            _ => Some(rest.strip_prefix('=').unwrap_or(rest).to_owned()),
        };
        match (setting, value.filter(is_plain)) {
            (Some((name, _)), Some(value)) => {
                settings.insert((*name).to_owned(), value);
            }
            _ => words.push(word),
        }
    }
    settings
}

impl Viewer {
    /// The words of pt for a view with these settings.
    fn words(&self, settings: &Settings) -> Vec<OsString> {
        let ViewOptions { scene, words } = &self.options;
        let begin = ["pt".into(), scene.clone().into(), "-d640x480".into()];
        let typed = words.iter().map(OsString::from);
        let set = settings.iter().map(|(name, value)| {
            let between = if name.starts_with("--") { "=" } else { "" };
            OsString::from(format!("{name}{between}{value}"))
        });
        begin.into_iter().chain(typed).chain(set).collect()
    }

    /// The plan of a view with these settings.
    fn plan(&self, settings: &Settings) -> Result<Plan> {
        let options = Options::parse(self.words(settings));
        let plan = options.and_then(|it| it.plan(None, false));
        plan.map_err(|error| error.to_string().into())
    }
}

/// Reads a scene, to be shown in several ways.
fn open(plan: Plan) -> Result<(Arc<Mesh>, World)> {
    let budget = Budget::samples(64);
    let mut plan = Plan { budget, ..plan };
    let listen = |event: Event| match event {
        Event::Warning(text) => progress::warn(&text),
        Event::Note(text) => progress::inform(&text),
        _ => (),
    };
    let host = Host { listen: &listen, ..Host::default() };
    let inputs = Inputs::read(&plan, host)?;
    let mesh = inputs.mesh.clone();
    plan.look_up(&mesh);
    Ok((mesh, World::new(&plan, inputs, host)?))
}

/// The page, its style and its program.
const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("view.css");
const PROGRAM: &str = include_str!("view.js");

/// No other site may read what we send, show it, or add to it.
const HEADERS: [(&str, &str); 4] = [
    ("Content-Security-Policy", POLICY),
    ("Cache-Control", "no-store"),
    ("Referrer-Policy", "no-referrer"),
    ("X-Content-Type-Options", "nosniff"),
];
const POLICY: &str =
    "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'";

/// Estimates that exist before a view is rendered.
#[derive(Default)]
struct Guess {
    /// Seconds for a sample of a pixel of a small image.
    pace: f64,
    /// The mean radiance of an image.
    mean: f64,
    /// The cache that a gather has learnt last.
    cache: Option<Arc<RadianceCache>>,
}

impl Guess {
    /// Learns the radiance of a scene, roughly.
    fn learn(&mut self, world: &World) {
        let (mut gather, mut film) = small_gather(world, 8, None);
        gather.learn(&mut film, &|_| true);
        self.take(&gather.learnt);
    }

    /// Keeps the new cache, if there is one.
    fn take(&mut self, learnt: &OnceLock<Learnt>) {
        let learnt = learnt.get().map(|learnt| learnt.cache.clone());
        self.cache = learnt.or(self.cache.take());
    }
}

/// The view of an image that is so many times smaller.
fn small(world: &World, scale: u32) -> LitView<'_> {
    let mut view = world.view();
    let (width, height) = view.resolution;
    view.resolution = ((width / scale).max(1), (height / scale).max(1));
    view
}

/// A gather without corrections, with a cache or to learn one, and the film
/// of its image, which is so many times smaller.
fn small_gather(
    world: &World,
    scale: u32,
    cache: Option<Arc<RadianceCache>>,
) -> (Gather<'_>, Film) {
    let view = small(world, scale);
    let (width, height) = view.resolution;
    let film = Film::new(width, height).with_shared_tiles();
    let (learnt, window) = (OnceLock::new(), film.window);
    if let Some(cache) = cache {
        let allocation = Allocation::even(window, 1);
        let (twin, pilot) = (None, vec![]);
        let _ = learnt.set(Learnt { cache, allocation, twin, pilot });
    }
    let gather = Gather {
        view,
        intersector: &world.geometry.bvh,
        known_pixels: KnownPixels::NOTHING,
        seed: 0,
        norm: ErrorNorm::default(),
        patches: None,
        training: 1 << 16,
        correction: None,
        learnt: learnt.into(),
        communicator: &SingleProcess,
    };
    let shown = fragments(&world.geometry.bvh, &view, (window, window));
    (gather, film.with_halves(Some(shown.into())))
}

impl Viewer {
    /// Changes the requested view, and stops the run that shows another;
    /// returns the number of the change.
    fn want(&self, change: impl FnOnce(&mut Wanted)) -> u64 {
        let mut wanted = lock(&self.wanted);
        change(&mut wanted);
        wanted.number += 1;
        self.interrupt.cancel();
        self.changed.notify_all();
        wanted.number
    }

    /// Shows the requested view, as long as the program lasts.
    fn work(&self) {
        let (mut guess, mut done) = (Guess::default(), 0);
        let mut good = lock(&self.wanted).settings.clone();
        loop {
            let idle = |wanted: &mut Wanted| {
                wanted.number == done || self.image.receiver_count() == 0
            };
            let wanted = self.changed.wait_while(lock(&self.wanted), idle);
            let mut wanted = wanted.expect("no panic with the lock");
            done = wanted.number;
            let reads = mem::take(&mut wanted.reads);
            let settings = wanted.settings.clone();
            self.interrupt.reset();
            drop(wanted);
            let shown = self.show(done, settings, reads, &mut guess);
            // Restore settings that can be shown
            let mut wanted = lock(&self.wanted);
            if wanted.number == done {
                match shown {
                    Ok(()) => good.clone_from(&wanted.settings),
                    Err(_) => wanted.settings.clone_from(&good),
                }
            }
            if let Err(fault) = shown {
                self.tell(json!({ "fault": fault.to_string() }));
            }
        }
    }

    /// Shows a view until another is requested, or its error is reached.
    fn show(
        &self,
        number: u64,
        mut settings: Settings,
        reads: bool,
        guess: &mut Guess,
    ) -> Result<()> {
        let mut plan = self.plan(&settings)?;
        // Update the scene for this view
        let read = reads.then(|| open(plan.clone())).transpose()?;
        let mut scene = self.scene.write().expect("no panic with the lock");
        *scene = read.or(scene.take());
        let (mesh, world) = scene.as_mut().ok_or("there is no scene")?;
        let old = world.subject.clone();
        plan.look_up(mesh);
        world.show(&plan, mesh)?;
        let new = &world.subject;
        let old = Subject { sensed: new.sensed.clone(), ..old };
        if reads || old != *new {
            guess.cache = None;
        }
        drop(scene);
        let scene = self.scene.read().expect("no panic with the lock");
        let (_, world) = scene.as_ref().ok_or("there is no scene")?;
        self.publish(number, world, &plan);
        if world.subject.sensed.window().area() > 1 << 23 {
            let fault = "more than 8 megapixels: copy the command instead";
            self.tell(json!({ "fault": fault }));
            return Ok(());
        }
        if guess.cache.is_none() {
            guess.learn(world);
        }
        // Glance at the view while it changes
        let (width, height) = world.subject.sensed.resolution();
        let seconds = guess.pace * (2 * width * height) as f64;
        let scale = (15. * seconds).sqrt().ceil().clamp(4., 8.);
        self.glance(world, guess, (scale as u32, 2), &|_| true);
        let still = Duration::from_millis(200);
        let same = |wanted: &mut Wanted| wanted.number == number;
        let wanted = lock(&self.wanted);
        drop(self.changed.wait_timeout_while(wanted, still, same));
        let goes_on = |_| self.interrupt.signal().is_none();
        if goes_on(0) {
            guess.learn(world);
            self.glance(world, guess, (2, 4), &goes_on);
        }
        if lock(&self.render).as_ref().is_some_and(|render| render.runs)
            || self.interrupt.signal().is_some()
        {
            return Ok(());
        }
        // Render to one per cent of the mean, unless an error is given
        if plan.budget.error.is_none() {
            let mean = if guess.mean > 0. { guess.mean } else { 1. };
            let error = format!("{:.1e}", 0.01 * mean);
            self.tell(json!({ "error": error }));
            settings.insert("--error".into(), error);
        }
        self.look(world, &self.plan(&settings)?, guess)
    }

    /// Puts the camera and its zenith into the settings, and sends them to the
    /// pages, unless another view is requested by now.
    fn publish(&self, number: u64, world: &World, plan: &Plan) {
        let mut wanted = lock(&self.wanted);
        if wanted.number != number {
            return;
        }
        let subject = &world.subject;
        let Some(framing) = subject.sensed.camera() else { return };
        let View { position, target, up, fov } = framing.view;
        let Sky { zenith, .. } = subject.sky;
        let ((width, height), settings) =
            (framing.resolution, &mut wanted.settings);
        settings.remove("--view");
        let own = settings.remove("--zenith").unwrap_or(typed(zenith));
        if Sky::new(up).zenith != zenith {
            settings.insert("--zenith".into(), own);
        }
        for (name, value) in [
            ("-p", typed(position)),
            ("-t", typed(target)),
            ("-u", typed(up)),
            ("-F", fov.to_string()),
            ("-d", format!("{width}x{height}")),
        ] {
            settings.insert(name.into(), value);
        }
        let fields = json!({
            "-r": subject.albedo, "--ground": subject.ground,
            "--sky": plan.sky.cover,
        });
        let state = json!({
            "words": self.options.words, "settings": settings,
            "scene": self.options.scene.display().to_string(),
            "zenith": zenith.to_array(), "fields": fields, "fault": null,
            "exposure": plan.outputs.exposure, "number": number,
        });
        self.tell(state);
    }

    /// Shows an image of few samples that is so many times smaller.
    fn glance(
        &self,
        world: &World,
        guess: &mut Guess,
        (scale, spp): (u32, u64),
        watch: &Watch,
    ) {
        let began = Instant::now();
        let cache = guess.cache.clone();
        let (mut gather, mut film) = small_gather(world, scale, cache);
        gather.pass(&mut film, spp, watch);
        if film.unsampled() == 0 {
            guess.mean = film.summary().mean;
            let stops = auto_stops(surface_means(
                &world.geometry.bvh,
                &gather.view,
                &film,
            ));
            let about =
                json!({ "spp": spp, "moves": true, "stops": stops });
            self.send_image(&film, about);
            let samples = (film.area() * spp) as f64;
            guess.pace = began.elapsed().as_secs_f64() / samples;
        }
    }

    /// Shows the image of a run as it gets better.
    fn look(
        &self,
        world: &World,
        plan: &Plan,
        guess: &mut Guess,
    ) -> Result<()> {
        let host = Host::default();
        let mut run = Run::for_display(world, plan, host);
        let (mut film, mut convergence) = run.film(None)?;
        let sampling = run.key.sampling;
        let interrupt = Some(&self.interrupt);
        let limits = Limits { interrupt, ..run.limits() };
        let (bvh, view) = (&world.geometry.bvh, &world.view());
        // Send an image after each step
        let mut due = Instant::now();
        let mut send = |run: &Convergence, film: &Film, is_last: bool| {
            let began = Instant::now();
            let is_step = run.last().spp == run.spp && began >= due;
            let shows = run.spp >= 2 * sampling.net_size && is_step;
            if film.unsampled() == 0 && (shows || is_last) {
                let point =
                    |p: &CurvePoint| Some((p.seconds, p.rmse? / p.mean));
                let curve: Vec<_> =
                    run.curve.iter().filter_map(point).collect();
                let method = sampling.method.to_string();
                let about = json!({
                    "spp": run.spp, "curve": curve, "method": method,
                    "done": is_last,
                    "stops": auto_stops(surface_means(bvh, view, film)),
                });
                self.send_image(film, about);
                due = Instant::now() + 4 * began.elapsed();
            }
        };
        let mut after =
            |run: &Convergence, film: &Film| send(run, film, false);
        let renderer = &mut *run.renderer;
        convergence.run(renderer, &mut film, &limits, &|_| (), &mut after);
        if self.interrupt.signal().is_none() {
            send(&convergence, &film, true);
        }
        guess.take(&run.learnt);
        Ok(())
    }

    /// Sends an image, and a description of it.
    fn send_image(&self, film: &Film, mut about: Value) {
        let filtered = Filtered::of(film);
        let means: Vec<f64> = film.means().collect();
        let mut numbers =
            filtered.map_or_else(|| means.clone(), |it| it.image.means);
        let (width, height) = film.window.size;
        about["size"] = json!([width, height]);
        if about["moves"].is_null() {
            numbers.extend(means);
            numbers.extend(film.errors(NEIGHBOUR_WEIGHT, film.window));
        }
        let numbers = numbers.iter().map(|x| (*x as f32).to_le_bytes());
        let bytes = numbers.collect::<Vec<_>>().concat();
        self.image.send_replace(message(&about, &bytes));
    }

    /// Sends changes of the state of the view to all pages.
    fn tell(&self, news: Value) {
        let Value::Object(news) = news else { return };
        self.state.send_modify(|state| state.extend(news));
    }

    /// Opens the stream of a page.
    fn open_stream(&'static self) -> impl IntoResponse {
        let (page, stream) = Channel::<_, Infallible>::new(1);
        tokio::spawn(self.stream(page));
        let kind = "application/octet-stream";
        ([(CONTENT_TYPE, kind)], Body::new(stream))
    }

    /// Sends the states and the images to a page, until it is closed.
    async fn stream(&self, mut page: Sender<Bytes>) {
        let beat = Duration::from_millis(250);
        let mut image = self.image.subscribe();
        let mut state = self.state.subscribe();
        image.mark_changed();
        state.mark_changed();
        if self.image.receiver_count() == 1 {
            self.want(|_| ());
        }
        let mut is_open = true;
        while is_open {
            let next = tokio::select! {
                biased;
                _ = state.changed() => {
                    let state = &*state.borrow_and_update();
                    message(&json!({ "state": state }), &[])
                }
                _ = image.changed() => image.borrow_and_update().clone(),
                () = sleep(beat) => message(&json!({}), &[]),
            };
            is_open = page.send_data(next).await.is_ok();
        }
        sleep(beat).await;
        drop(image);
        if self.image.receiver_count() == 0 {
            self.interrupt.cancel();
            self.stop_render();
        }
    }

    /// The functions that answer the requests of a page.
    fn routes(&'static self) -> Router {
        let at = |name| format!("/{}/{name}", self.token);
        let text = |kind, text: &'static str| {
            let kind = format!("text/{kind}; charset=utf-8");
            get(([(CONTENT_TYPE, kind)], text))
        };
        let act = |act: fn(&Self, &Value) -> Value| {
            post(async move |body: Bytes| {
                let Json(body) = Json::from_bytes(&body)?;
                Ok::<_, JsonRejection>(Json(act(self, &body)))
            })
        };
        let file = async move |Path(name): Path<String>| self.file(&name);
        Router::new()
            .route(&at(""), text("html", PAGE))
            .route(&at("view.css"), text("css", STYLE))
            .route(&at("view.js"), text("javascript", PROGRAM))
            .route(&at("stream"), get(async move || self.open_stream()))
            .route(&at("set"), act(|it, body| it.set(body).into()))
            .route(&at("pick"), act(|it, body| it.pick(body).into()))
            .route(&at("render"), act(|it, body| json!(it.render(body))))
            .route(&at("stop"), act(|it, _| json!(it.stop_render())))
            .route(&at("{file}"), get(file))
            .layer(DefaultBodyLimit::max(1024))
    }

    /// Refuses a request that was made for another host.
    fn admit(&self, request: &Request<Incoming>) -> Result<(), StatusCode> {
        let mut hosts = request.headers().get_all(HOST).iter();
        let (Some(host), None) = (hosts.next(), hosts.next()) else {
            return Err(StatusCode::BAD_REQUEST);
        };
        let host = host.to_str().unwrap_or_default();
        let authority = request.uri().authority();
        let host = authority.map_or(host, Authority::as_str);
        let host = host.to_lowercase().replace("localhost", "127.0.0.1");
        (host == self.host).then_some(()).ok_or(StatusCode::NOT_FOUND)
    }

    /// Serves connections, as long as the program lasts.
    async fn serve(&'static self, listener: TcpListener) {
        let (newest, routes) = (watch::Sender::new(0), self.routes());
        loop {
            let Ok((stream, _)) = listener.accept().await else {
                // Too many files are open: no connection stays that waits.
                newest.send_modify(|number| *number += 33);
                sleep(Duration::from_millis(10)).await;
                continue;
            };
            let (mut last, routes) = (newest.subscribe(), routes.clone());
            newest.send_modify(|number| *number += 1);
            let number = *newest.borrow();
            tokio::spawn(async move {
                // Answer the request of a connection
                let is_answered = &AtomicBool::new(false);
                let answer = service_fn(async |request| {
                    let reply = match self.admit(&request) {
                        Ok(()) => routes.clone().call(request).await,
                        Err(refusal) => Ok(refusal.into_response()),
                    };
                    is_answered.store(true, Relaxed);
                    Ok::<_, Infallible>((HEADERS, reply).into_response())
                });
                let mut stream = TimeoutWriter::new(stream);
                stream.set_timeout(Some(Duration::from_secs(30)));
                let stream = TokioIo::new(Box::pin(stream));
                let mut server = http1::Builder::new();
                server.keep_alive(false).half_close(true);
                let served = server.serve_connection(stream, answer);
                tokio::pin!(served);
                let late = async {
                    let is_old = |last: &u64| {
                        last - number > 32 && !is_answered.load(Relaxed)
                    };
                    let old = last.wait_for(is_old);
                    let _ = timeout(Duration::from_secs(5), old).await;
                };
                tokio::select! {
                    _ = &mut served => (),
                    () = late => if is_answered.load(Relaxed) { _ = served.await },
                }
            });
            // Some connections end before the next one comes.
            tokio::task::yield_now().await;
        }
    }

    /// Changes settings, and removes those that are null; returns the
    /// number of the change.
    fn set(&self, body: &Value) -> u64 {
        self.want(|Wanted { settings, reads, .. }| {
            *reads |= body["read"] == true;
            let given = body["set"].as_object().into_iter().flatten();
            for (name, value) in given {
                if SETTINGS.iter().any(|(short, _)| short == name) {
                    settings.remove(name);
                    let value = value.as_str().map(str::to_owned);
                    settings.extend(value.map(|it| (name.clone(), it)));
                }
            }
            // A view from a side has its own up, which follows the zenith.
            if settings.contains_key("--view")
                && let Some(zenith) = settings.get("--zenith").cloned()
            {
                settings.insert("-u".into(), zenith);
            }
        })
    }

    /// The place of a point of the image in the scene, and its face; nothing
    /// if it is the sky, or the scene is being changed.
    fn pick(&self, body: &Value) -> Option<Value> {
        let scene = self.scene.try_read().ok()?;
        let (_, world) = scene.as_ref()?;
        let [x, y] =
            ["x", "y"].map(|name| body[name].as_f64().unwrap_or(0.));
        let (bvh, view) = (&world.geometry.bvh, world.view());
        let hit = world.sensor.start(bvh, &view.surfaces, (x, y)).hit?;
        let is_face = hit.primitive < GROUND;
        let face =
            is_face.then(|| world.geometry.bvh.face(hit.primitive) + 1);
        let point = world.geometry.frame.back(hit.point).to_array();
        Some(json!({ "point": point, "face": face }))
    }

    /// Begins to render the view to files, by the command that the page shows.
    fn render(&self, body: &Value) {
        self.stop_render();
        let names = SETTINGS.into_iter().map(|(name, _)| name);
        let names = names.chain(["--exposure"]);
        let given = names.filter_map(|name| {
            Some((name.to_owned(), body[name].as_str()?.to_owned()))
        });
        match self.start_render(&given.collect()) {
            Ok(render) => {
                *lock(&self.render) = Some(render);
                self.interrupt.cancel();
            }
            Err(fault) => {
                let fault = format!("cannot render: {fault}");
                self.tell(json!({ "render": { "fault": fault } }));
            }
        }
    }

    fn start_render(&self, settings: &Settings) -> io::Result<Render> {
        let folder =
            tempfile::Builder::new().prefix("ptview-").tempdir()?;
        let mut command =
            Command::new(env::current_exe()?.with_file_name("pt"));
        command.args(&self.words(settings)[1..]).arg("-q");
        for name in FILES {
            let is_report = name.contains("report");
            command.arg(if is_report { "--report" } else { "-o" });
            command.arg(folder.path().join(name));
        }
        let log = File::create(folder.path().join(LOG))?;
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        Ok(Render { pt: command.spawn()?, folder, runs: true })
    }

    /// Sends the progress of a render to pages, and returns to the view at its
    /// end.
    fn watch_render(&self) {
        let mut render = lock(&self.render);
        let Some(own) = render.as_mut().filter(|own| own.runs) else {
            return;
        };
        let ended = own.pt.try_wait().ok().flatten();
        let read = |name| fs::read_to_string(own.folder.path().join(name));
        let report = read("report.json").unwrap_or_default();
        let report: Value =
            serde_json::from_str(&report).unwrap_or_default();
        let last = report["curve"].as_array().and_then(|all| all.last());
        let fault = ended.filter(|ended| !ended.success());
        let told = || read(LOG).ok().filter(|text| !text.is_empty());
        let fault = fault.map(|end| told().unwrap_or(format!("pt: {end}")));
        let state = json!({
            "runs": ended.is_none(), "fault": fault, "last": last,
            "files": FILES,
        });
        own.runs = ended.is_none();
        drop(render);
        self.tell(json!({ "render": state }));
        if ended.is_some() {
            self.want(|_| ());
        }
    }

    /// Ends the current render; its files are lost.
    fn stop_render(&self) {
        let mut render = lock(&self.render);
        let Some(mut own) = render.take_if(|own| own.runs) else { return };
        drop(render);
        let _ = own.pt.kill();
        let _ = own.pt.wait();
        self.tell(json!({ "render": null }));
        self.want(|_| ());
    }

    /// A file that was rendered.
    fn file(&self, name: &str) -> Result<Vec<u8>, StatusCode> {
        let render = lock(&self.render);
        let is_ours = FILES.contains(&name);
        let render = render.as_ref().filter(|_| is_ours);
        let path = render.map(|render| render.folder.path().join(name));
        let file = path.and_then(|path| fs::read(path).ok());
        file.ok_or(StatusCode::NOT_FOUND)
    }
}

#[cfg(test)]
mod tests {
    use super::begin;

    #[test]
    fn what_the_page_sets_is_taken_out_of_the_words() {
        let line = "--materials -r floor=0.2 -p 1,2,3 --view=top --sky \
            overcast -s 7 -r0.5 -rwall=1 --fov 30 -d9x7 --ground";
        let mut words = line.split(' ').map(str::to_owned).collect();
        let settings = begin(&mut words);
        let typed =
            settings.iter().map(|(name, value)| name.clone() + value);
        let typed: Vec<_> = typed.collect();
        let taken = "--skyovercast --viewtop -F30 -d9x7 -p1,2,3 -r0.5";
        assert_eq!(typed.join(" "), taken);
        let left = "--materials -r floor=0.2 -s 7 -rwall=1 --ground";
        assert_eq!(words.join(" "), left);
    }
}
