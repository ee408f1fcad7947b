// Tangled from chapters/program.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! A command, from its words to its files.

use std::collections::BTreeSet;
use std::env;
use std::ffi::OsString;
use std::io::{self, IsTerminal};
use std::path::Path;
use std::time::Instant;

use anstream::{AutoStream, ColorChoice};
use clap::CommandFactory;
use clap::builder::StyledStr;

use super::files;
use super::options::{Error, Options, by_option, usage};
use super::progress::{self, render_bar, update};
use super::ranks::{Ranks, start_threads};
use super::watchdog::without_image;
use super::watchdog::{Watchdog, hard_deadline, listen, status};
use crate::analysis::Finding;
use crate::camera::Camera;
use crate::error::{self, Result};
use crate::film::{Film, Summary};
use crate::filter::Filtered;
use crate::host::Host;
use crate::image::Image;
use crate::inputs::{Inputs, in_first_rank};
use crate::output::OutputTarget;
use crate::plan::{Plan, Product, is_dash};
use crate::render_loop::{Convergence, Stop};
use crate::run::{History, Run};
use crate::run_output::RunOutput;
use crate::sensor::INSIDE;
use crate::state::checkpoint::{Checkpoint, RunRecord};
use crate::world::World;

/// Runs `pt` with these words, the first of which is its name, in a process
/// that leads `ranks`; returns its exit status.
pub fn main_with(words: Vec<OsString>, ranks: &dyn Ranks) -> u8 {
    #[cfg(target_env = "gnu")]
    give_arrays_back();
    let start = Instant::now();
    if words.len() <= 1 && io::stdin().is_terminal() {
        let _ = print(&Options::command().render_help());
        return 2;
    }
    let options = Options::parse(words);
    let done = options.and_then(|options| run(&options, start, ranks));
    done.map_or_else(fail, |stop| status(stop, 0))
}

/// Prints why a program ends; returns its exit status.
pub fn fail(error: Error) -> u8 {
    let error = match error {
        Error::Help(text) => match print(&text) {
            Ok(()) => return 0,
            Err(error) => error.into(),
        },
        Error::Failure(fault @ error::Error::Value { .. }) => {
            usage(by_option(&fault), "pt")
        }
        other => other,
    };
    progress::error(&error.to_string());
    if matches!(error, Error::Usage(_)) { 2 } else { 1 }
}

/// Prints a text on standard output, on a terminal in colour.
fn print(text: &StyledStr) -> Result<()> {
    let plain = AutoStream::choice(&io::stdout()) == ColorChoice::Never;
    OutputTarget::standard_output()?.write(&mut |out| match plain {
        true => write!(out, "{text}"),
        false => write!(out, "{}", text.ansi()),
    })
}

/// Makes the allocator return each dropped array to the system if it is
/// larger than a quarter of a megabyte.
#[cfg(target_env = "gnu")]
fn give_arrays_back() {
    // SAFETY: a parameter of the allocator, which it may refuse.
    unsafe { libc::mallopt(libc::M_MMAP_THRESHOLD, 1 << 18) };
}

fn run(
    options: &Options,
    start: Instant,
    ranks: &dyn Ranks,
) -> Result<Stop, Error> {
    // Resolve the options
    let resume = options.parts.resume.as_deref();
    let state = resume.map(Checkpoint::of_file).transpose()?;
    let saved = state.as_ref().map(|s| s.record.plan.clone().restored());
    let is_terminal = io::stdout().is_terminal();
    let mut plan = options.plan(saved.as_ref(), is_terminal)?;
    let execution = &options.execution;
    progress::set_quiet(execution.quiet);
    // Watch for signals from the start
    let end = hard_deadline(&plan.budget, start);
    let picture_error = plan.outputs.picture_error;
    let end = end.filter(|_| !execution.dry_run && !plan.filters());
    let watchdog = Watchdog::spawn(listen()?, end);
    let host = Host { listen: &|event| watchdog.hear(event), ranks, start };
    // Check what needs no scene, and prepare the scene
    check(&plan)?;
    start_threads(&plan)?;
    let targets = match execution.sample {
        Some(_) => vec![],
        None => files::open(&plan)?,
    };
    let reference = files::reference(&plan)?;
    let cache = plan.cache.as_deref();
    let cache = cache.map(Checkpoint::of_file).transpose()?;
    let directory = env::current_dir().unwrap_or_default();
    in_first_rank(host, || Ok(plan.saved(&directory)))?;
    let inputs = Inputs::read(&plan, host)?;
    if plan.shows_only_pictures() {
        plan.look_up(&inputs.mesh);
    }
    let world = World::new(&plan, inputs, host)?;
    files::check_reference(&plan, reference.as_ref(), &world)?;
    // Prepare the run and render it
    let history = History { state, cache };
    let start = picture_error.map_or(start, |_| Instant::now());
    let host = Host { start, ..host };
    let mut run = Run::after(&history, &world, &plan, host)?;
    if let Some((x, y, n)) = execution.sample {
        return Ok(answer(&run.trace_sample((x, y), n)?)?);
    }
    if execution.dry_run {
        return Ok(answer(&describe(&plan, &world, &run))?);
    }
    let unnamed = unnamed(options, &plan);
    if unnamed.is_some_and(is_dash) {
        progress::inform(TO_STANDARD_OUTPUT);
    }
    let shown = unnamed.filter(|path| !is_dash(path));
    let files = Files { targets, reference, shown };
    Ok(render(run, history.state, files, ranks, &watchdog)?)
}

/// The file of an image that was not named.
fn unnamed<'a>(options: &Options, plan: &'a Plan) -> Option<&'a Path> {
    let Options { outputs, parts, .. } = options;
    let is_named = !outputs.output.is_empty()
        || outputs.format.is_some()
        || parts.resume.is_some();
    let is_image = |product| matches!(product, Product::Image(_));
    plan.outputs.of(is_image).next().filter(|_| !is_named)
}

/// Reports that an image goes to standard output.
const TO_STANDARD_OUTPUT: &str = "the image goes to standard output, as \
                                  numbers; for a PNG say -o NAME.png";

/// Checks the camera, if the plan has placed it.
fn check(plan: &Plan) -> Result<()> {
    let up = plan.up.unwrap_or(glam::DVec3::Z);
    let placed = plan.camera().filter(|camera| camera.is_placed());
    placed.map_or(Ok(()), |camera| {
        Camera::new(&camera.view(up), camera.aspect()).map(drop)
    })
}

/// Prints what was asked for instead of an image.
fn answer(text: &str) -> Result<Stop> {
    let out = OutputTarget::standard_output()?;
    out.write(&mut |out| out.write_all(text.as_bytes()))?;
    Ok(Stop::Samples)
}

/// Describes what can be left out, and what renders the rest.
fn describe(plan: &Plan, world: &World, run: &Run) -> String {
    let analysis = &world.analysis;
    let mut lines = String::new();
    for Finding { name, applies, reason } in &analysis.findings {
        let sign = if *applies { "left out" } else { "-" };
        lines += &format!("{name:13}{sign:10}{reason}\n");
    }
    // Name the parts that do the rest
    let method = run.key.sampling.method.to_string();
    let why = run.choice.as_ref().map_or(method.clone(), |c| c.to_string());
    let parts = match analysis.known_pixels.is_all() {
        true => "none: no ray".to_owned(),
        false => format!("{}; {method}", plan.isa()),
    };
    for (name, text) in [("method", why), ("intersector", parts)] {
        lines += &format!("{name:13}{text}\n");
    }
    lines
}

/// The files of a run.
struct Files<'a> {
    targets: Vec<(Product, OutputTarget)>,
    reference: Option<Image>,
    /// The file of an image without a name.
    shown: Option<&'a Path>,
}

/// Renders until a limit is reached, and writes the files of the run.
fn render(
    run: Run,
    state: Option<Checkpoint>,
    files: Files,
    ranks: &dyn Ranks,
    watchdog: &Watchdog,
) -> Result<Stop> {
    let (mut film, mut convergence) = run.film(state)?;
    // Render a first picture
    let bar = render_bar(run.host.start, run.plan.budget.time);
    watchdog.renders(bar.clone());
    let first = match convergence.spp {
        0 => run.first_picture(&watchdog.interrupt)?,
        _ => None,
    };
    let directory = env::current_dir().unwrap_or_default();
    let (mut limits, report) = (run.limits(), run.report());
    let Run { plan, world, host, key, learnt, renderer, .. } = run;
    let renderer = &mut *ranks.lead(renderer, &key, film.fragments.clone());
    // Prepare the files of the run
    let (run_key, saved) = (key.clone(), plan.saved(&directory));
    let (plan_saved, rows) = (saved, world.rows());
    let record =
        RunRecord { run_key, plan: plan_saved, report, rows, learnt };
    let mut output =
        RunOutput::new(files.targets, &plan.outputs, record, Some(world));
    output.first = first;
    // Collect the limits
    let began = Instant::now();
    let left = limits.deadline.map(|end| {
        end.saturating_duration_since(began).as_secs_f64() * 2. / 3.
    });
    let seconds = output.seconds_to_write(film.area());
    limits.reserve = seconds.map(|s| s.min(left.unwrap_or(0.)));
    let reference = files.reference.as_ref();
    limits.reference = reference.map(|image| &image.means[..]);
    limits.interrupt = Some(&watchdog.interrupt);
    let goal = plan.outputs.picture_error;
    limits.picture = goal.map(|goal| (goal, picture_error as _));
    // Render with a progress bar
    let area = film.area();
    // Show the progress of the run
    let show = |convergence: &Convergence| {
        let spp = convergence.expected(&limits, area);
        let expected = spp.map(|spp| spp.saturating_mul(area));
        let paths = convergence.spp.saturating_mul(area);
        let mut text = format!("{} spp, ", convergence.spp);
        if let Some(error) = convergence.picture {
            text += &format!("error {:.1} %, ", 100. * error);
        } else if let Some(rmse) = convergence.last().rmse {
            text += &format!("rmse {rmse:.2e}, ");
        }
        update(&bar, (paths, expected), "paths", text);
    };
    match renderer.training_rays(area) {
        0 => show(&convergence),
        rays => update(&bar, (0, Some(rays)), "rays", "learning, ".into()),
    }
    let mut after = |convergence: &Convergence, film: &Film| {
        show(convergence);
        let written = output.write(convergence, film, Some(Instant::now()));
        if let Err(error) = written {
            bar.suspend(|| progress::warn(&error.to_string()));
        }
    };
    let advance = |n| bar.inc(n);
    let stop =
        convergence.run(renderer, &mut film, &limits, &advance, &mut after);
    bar.finish_and_clear();
    let late = limits.deadline.is_some_and(|end| began > end);
    let late = late || (convergence.spp == 0 && stop == Stop::Time);
    if late && goal.is_none() {
        progress::warn(
            "loading, building and the first sample of each pixel took \
             longer than --time allows",
        );
    }
    // End without an image if there is no sample
    let is_over = matches!(stop, Stop::Time | Stop::Signal(_));
    if is_over && film.unsampled() == area && output.first.is_none() {
        let learns = renderer.training_rays(area) > 0;
        let doing = if learns { "learning" } else { "rendering" };
        let message = without_image(stop, doing);
        if stop == Stop::Time {
            return Err(message.into());
        }
        progress::error(&message);
        return Ok(stop);
    }
    if !key.only_learns() {
        warn_of_receivers(world, &film, host);
    }
    finish(output, &film, &convergence, files.shown, host)?;
    Ok(stop)
}

/// The error of the picture on a film, relative to the mean of all but the
/// sky, if it is known.
fn picture_error(film: &Film) -> Option<f64> {
    let Some(shown) = film.fragments.as_deref() else {
        let Summary { mean, rmse, .. } = film.summary();
        return Some(rmse / mean).filter(|error| error.is_finite());
    };
    let Filtered { image, error } = Filtered::of(film)?;
    let sky: f64 = shown.sky.iter().copied().map(f64::from).sum();
    let light = image.means.iter().sum::<f64>() - sky;
    Some(error.rmse * shown.opacity().iter().sum::<f64>() / light)
}

/// The mean number of errors by which closing moves view factors that
/// contradict each other; of others it is about 0.6.
const CONTRADICTION: f64 = 2.;

/// Writes the files a last time, and prints the summary.
fn finish(
    mut output: RunOutput,
    film: &Film,
    convergence: &Convergence,
    shown: Option<&Path>,
    host: Host,
) -> Result<()> {
    output.write(convergence, film, None)?;
    let moves = output.record.report.matrix.and_then(|it| it.moves);
    if moves.is_some_and(|[_, mean]| mean > CONTRADICTION) {
        host.warn(
            "closing has moved view factors by many errors: do faces cut each \
             other, or does one see the back of another (--faces=both)?",
        );
    }
    if output.record.run_key.only_learns() {
        let Convergence { rays, seconds, .. } = convergence;
        progress::inform(&format!("learnt    {rays} rays, {seconds:.3} s"));
        return Ok(());
    }
    // Print the summary
    if !progress::is_quiet() {
        let report = output.record.report.complete(film);
        let file = shown.map(|path| ("file", path.display().to_string()));
        let chosen = output.record.plan.outputs.defaults;
        let chosen = (!chosen.is_empty()).then_some(("defaults", chosen));
        let lines = report.summary(film.area()).into_iter();
        for (name, text) in lines.chain(chosen).chain(file) {
            progress::inform(&format!("{name:10}{text}"));
        }
    }
    Ok(())
}

/// Warns of receivers without light, and of those that seem to be inside a
/// body.
pub fn warn_of_receivers(world: &World, film: &Film, host: Host) {
    let Some((table, receivers)) = world.table() else { return };
    let first = film.window.corner.1 as usize;
    let means = receivers.numbers[first..].iter().zip(film.means());
    let dark = means.filter(|(_, mean)| *mean == 0.);
    let dark: BTreeSet<_> = dark.map(|(number, _)| number).collect();
    if dark.len() as u64 == film.area() && !film.judges_rows {
        host.warn("no light arrives: does a face close each opening?");
    }
    let is_meant = |why, number| why == INSIDE && dark.contains(&number);
    host.warn_all(&table.file, table.odd(receivers, is_meant));
}
