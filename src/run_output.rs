// Tangled from chapters/run_output.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The files of a run, kept up to date while it goes on.

use std::cell::{LazyCell, OnceCell};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::{self, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::Serialize;
use serde_json::json;

use crate::compare::display::{AUTO_EXPOSURE, Curve, Exposure};
use crate::compare::display::{auto_stops, cut_out};
use crate::compare::display::{seeming_surfaces, tonemap};
use crate::error::Result;
use crate::film::{Film, Fragments};
use crate::filter::{Filtered, fragments, surface_means};
use crate::image::{FILTERED, Format, Image, OPACITY, Picture};
use crate::key::{Subject, entries};
use crate::matrix::{Matrix, MatrixFormat};
use crate::output::OutputTarget;
use crate::plan::{Outputs, Product};
use crate::render_loop::Convergence;
use crate::report::{Kind, Report, as_typed};
use crate::state::checkpoint::{RunRecord, save};
use crate::world::World;

/// A file of a run.
struct RunFile {
    product: Product,
    target: OutputTarget,
    /// When it is written before the end; never, if beyond the clock.
    due: Option<Instant>,
    /// The seconds of the run when it was written last.
    seconds: f64,
}

/// The files of a run, and the record that goes into them.
pub struct RunOutput<'a> {
    files: Vec<RunFile>,
    /// Time between two checkpoints.
    every: Duration,
    /// The record of the run, which goes into the files.
    pub record: RunRecord,
    /// By how much PNG files are brighter, if it is given.
    exposure: Option<Exposure>,
    /// Whether view factors are made reciprocal and closed.
    closes: bool,
    /// The world that is shown; none for a sum of parts.
    world: Option<&'a World>,
    /// What the pixels show, once that is needed.
    shown: OnceCell<Arc<Fragments>>,
    /// The film and the picture of a glance, if there is one.
    pub first: Option<(Film, Filtered)>,
}

impl RunFile {
    fn is_due(&self, now: Instant, convergence: &Convergence) -> bool {
        let is_new = convergence.last().spp == convergence.spp
            || convergence.seconds > 1.1 * self.seconds;
        let is_report = matches!(self.product, Product::Report(_));
        (is_new || !is_report) && self.due.is_some_and(|due| now >= due)
    }
}

/// The names and values of a type that is written as an object, as the
/// attributes of an image.
pub fn attributes(value: &impl Serialize) -> BTreeMap<String, String> {
    let named = entries(value).into_iter();
    named.map(|(name, value)| (name, as_typed(&value))).collect()
}

impl<'a> RunOutput<'a> {
    /// The files of a run that is about to begin, and its world if there is one.
    pub fn new(
        files: Vec<(Product, OutputTarget)>,
        outputs: &Outputs,
        record: RunRecord,
        world: Option<&'a World>,
    ) -> Self {
        let now = Instant::now();
        let &Outputs {
            checkpoint_interval, preview, exposure, closed, ..
        } = outputs;
        let closes = closed;
        let every = Duration::try_from_secs_f64(checkpoint_interval);
        let every = every.unwrap_or(Duration::MAX);
        let file = |(product, target)| {
            let due = match product {
                Product::State => now.checked_add(every),
                Product::Report(_) => Some(now),
                Product::Image(Format::Png) => preview.then_some(now),
                Product::Image(_) | Product::Table(_) => None,
                Product::Matrix(_) => None,
            };
            RunFile { product, target, due, seconds: 0. }
        };
        let files = files.into_iter().map(file).collect();
        let shown = OnceCell::new();
        let first = None;
        Self { files, every, record, exposure, closes, world, shown, first }
    }

    /// Writes the files that are due `now`, or all of them a last time.
    ///
    /// # Errors
    /// Files cannot be written; the others are. Before the end this deserves
    /// only a warning, since they will be tried again.
    pub fn write(
        &mut self,
        convergence: &Convergence,
        film: &Film,
        now: Option<Instant>,
    ) -> Result<()> {
        let &mut Self { world, exposure, .. } = self;
        let Self { files, every, record, shown, first, closes, .. } = self;
        let camera = world.filter(|world| world.table().is_none());
        record.report.convergence.clone_from(convergence);
        let is_due = |file: &RunFile| {
            now.is_none_or(|now| file.is_due(now, convergence))
        };
        let due = files.iter().filter(|file| is_due(file));
        let due: Vec<_> = due.map(|file| file.product).collect();
        // Filter the image if a file shows it
        let began = Instant::now();
        let shows = due.iter().any(|product| product.is_picture());
        let own = if shows { Filtered::of(film) } else { None };
        let filtering = began.elapsed();
        let first = first.as_ref().filter(|(_, glance)| {
            let is_less =
                |own: &Filtered| glance.error.rmse < own.error.rmse;
            shows && own.as_ref().is_none_or(is_less)
        });
        let filtered = first.map(|(_, glance)| glance).or(own.as_ref());
        let seen = first.map_or(film, |(glance, _)| glance);
        record.report.picture = filtered.map(|filtered| filtered.error);
        let filtered = filtered.map(|filtered| &filtered.image);
        let [stops, auto] =
            expose(&mut record.report, exposure, (seen, camera), &due);
        // Cut the scene out of its background
        let has = |format| due.contains(&Product::Image(format));
        let background = record.run_key.subject.sky.background;
        let cut =
            background.filter(|_| has(Format::Png) || has(Format::Exr));
        let cut = cut.filter(|_| seen.unsampled() == 0).and(camera);
        let trace = |world: &World| {
            let (own, view) = (seen.fragments.clone(), world.view());
            let windows = (film.window, film.run_window);
            let trace = || fragments(&world.geometry.bvh, &view, windows);
            own.unwrap_or_else(|| trace().into())
        };
        let opacity =
            cut.map(|world| shown.get_or_init(|| trace(world)).opacity());
        let opacity = opacity.as_deref();
        // Make the matrix of a tally
        let is_list = |it: &Product| {
            matches!(it, Product::Matrix(_) | Product::Table(_))
        };
        let shows = due.iter().any(is_list);
        let of_world = world.filter(|_| shows);
        let mut matrix = of_world.and_then(|world| world.matrix(film));
        let closed = matrix.as_mut().filter(|_| *closes).map(Matrix::close);
        let closing = closed.unwrap_or(Ok(()));
        let sorted = matrix.as_ref().filter(|it| it.columns.count > 1);
        record.report.matrix = sorted.map(Matrix::size);
        let record = &*record;
        // Collect what the files show
        let shown = Shown {
            record,
            film,
            world,
            matrix,
            closing,
            filtered,
            opacity,
            stops,
            auto,
        };
        let report = LazyCell::new(|| record.report.complete(film));
        let mut failures = vec![];
        for file in files.iter_mut().filter(|file| is_due(file)) {
            // Write or rewrite one file
            let began = Instant::now();
            let content = &mut |out: &mut dyn Write| {
                shown.write(file.product, &report, out)
            };
            let written = match now {
                Some(_) => file.target.rewrite(content),
                None => file.target.write(content),
            };
            failures.extend(written.err().map(|error| error.to_string()));
            // Set the time of the next writing
            let mut took = began.elapsed();
            if file.product.is_picture() {
                took += filtering;
            }
            let pause = match file.product {
                Product::Report(_) => 100 * took,
                Product::State => *every,
                _ => Duration::from_secs(1).max(10 * took),
            };
            file.due = file.due.and(Instant::now().checked_add(pause));
            file.seconds = convergence.seconds;
        }
        if failures.is_empty() {
            Ok(())
        } else {
            Err(failures.join("; ").into())
        }
    }

    /// An estimate of the seconds that all files take for so many pixels, if
    /// none of them has a sample and if all have.
    pub fn seconds_to_write(&self, pixels: u64) -> [f64; 2] {
        // Nanoseconds for a pixel, measured with a half more.
        let [state, summary] = [70., 130.];
        let each = self.files.iter().map(|file| match file.product {
            Product::Image(Format::Pgm) => 120.,
            Product::Image(Format::Png) => 200.,
            Product::Image(Format::Pfm) => 50.,
            Product::Image(Format::Exr) => 420.,
            Product::Report(Kind::Html) => 350.,
            Product::Report(_) => 0.,
            Product::Table(_) => 1000.,
            Product::Matrix(_) => 40_000.,
            Product::State => state,
        });
        let files: f64 = each.sum();
        let is_state = |file: &RunFile| file.product == Product::State;
        let is_saved = self.files.iter().any(is_state);
        let none = if is_saved { state } else { 0. } + 0.15 * files;
        let threads = rayon::current_num_threads() as f64;
        let is_filtered = self.record.run_key.filtered;
        let filter = if is_filtered { 4500. / threads } else { 0. };
        let is_cut = self.record.run_key.subject.sky.background.is_some();
        let cut = if is_cut { 5000. / threads } else { 0. };
        let most = summary + files + filter + cut;
        [none, most].map(|nanoseconds| 1e-9 * nanoseconds * pixels as f64)
    }
}

/// Chooses by how many stops pictures are brighter: PNG files, if they are,
/// and the number that an EXR records; and notes it in the report.
fn expose(
    report: &mut Report,
    exposure: Option<Exposure>,
    (film, camera): (&Film, Option<&World>),
    due: &[Product],
) -> [Option<f64>; 2] {
    let has = |wanted| due.contains(&wanted);
    let auto = LazyCell::new(|| match camera {
        Some(world) => auto_stops(surface_means(
            &world.geometry.bvh,
            &world.view(),
            film,
        )),
        None => {
            let pixels = film.rows().map(|p| (p.mean(), p.variance()));
            auto_stops(seeming_surfaces(pixels))
        }
    });
    let stops_of = |exposure: Exposure| exposure.stops(|| *auto);
    let is_png = has(Product::Image(Format::Png));
    if is_png && film.unsampled() < film.area() {
        report.exposure = exposure.map(stops_of);
        let sampled = film.area() - film.unsampled();
        let is_dark = film.darker(0.1) >= sampled - sampled / 10;
        report.is_dark = is_dark && exposure.is_none();
    }
    if has(Product::Report(Kind::Html)) {
        report.page_exposure = stops_of(exposure.unwrap_or(Exposure::Auto));
    }
    let stops = report.exposure.filter(|&stops| stops != 0.);
    let is_exr = has(Product::Image(Format::Exr));
    [stops, is_exr.then(|| *auto)]
}

/// The name of a scene without its folder and its extension.
fn zone(file: &str) -> &str {
    let name = Path::new(file).file_name().and_then(OsStr::to_str);
    let name = name.unwrap_or(file);
    name.split_once('.').map_or(name, |(name, _)| name)
}

/// What the files of one moment show.
struct Shown<'f> {
    record: &'f RunRecord,
    film: &'f Film,
    world: Option<&'f World>,
    filtered: Option<&'f Image>,
    opacity: Option<&'f [f64]>,
    /// The matrix of a tally, if a file shows it.
    matrix: Option<Matrix<'f>>,
    /// Whether it could be closed.
    closing: Result<()>,
    /// The stops by which a PNG is brighter, and those that an EXR records.
    stops: Option<f64>,
    auto: Option<f64>,
}

impl Shown<'_> {
    /// Writes the content of a file.
    fn write(
        &self,
        product: Product,
        report: &Report,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        let &Self { record, film, filtered, opacity, stops, .. } = self;
        let shown = || match filtered {
            Some(image) => image.clone(),
            None => self.picture().image(),
        };
        match product {
            Product::Image(Format::Png) => {
                // Write a PNG
                if opacity.is_none() && stops.is_none() {
                    return match filtered {
                        Some(image) => Format::Png.write(image, out),
                        None => Format::Png.write(&self.picture(), out),
                    };
                }
                let Subject { ground, sky, .. } = &record.run_key.subject;
                let opacity = opacity.filter(|_| *ground != sky.background);
                let more =
                    opacity.map(|opacity| (OPACITY, opacity.to_vec()));
                let shown = Image { more: Vec::from_iter(more), ..shown() };
                let cut = cut_out(shown, sky.background.unwrap_or(0.));
                let grey = tonemap(&cut, stops.unwrap_or(0.), Curve::Clamp);
                Format::Png.write(&grey, out)
            }
            Product::Image(format) => format.write(&self.picture(), out),
            Product::Report(kind) => {
                write!(out, "{}", kind.render(report, &shown))
            }
            Product::Table(format) => {
                let Some((table, receivers)) =
                    self.world.and_then(World::table)
                else {
                    return Ok(());
                };
                let counts = record.allocation();
                let values = table.values(receivers, film, counts);
                let slopes = self.matrix.as_ref().map(Matrix::first_cells);
                table.write(format, &values, slopes.as_deref(), out)
            }
            Product::Matrix(format) => self.write_matrix(format, out),
            Product::State => save(record, film, out),
        }
    }

    /// Writes the matrix of a tally.
    fn write_matrix(
        &self,
        format: MatrixFormat,
        out: &mut dyn Write,
    ) -> io::Result<()> {
        if let Err(fault) = &self.closing {
            return Err(io::Error::other(fault.to_string()));
        }
        let zone = zone(&self.record.report.scene.file);
        let matrix = self.matrix.as_ref();
        matrix.map_or(Ok(()), |matrix| matrix.write(format, zone, out))
    }

    /// The image on the film, with its attributes.
    fn picture(&self) -> Picture<'_> {
        let &Self { film, filtered, opacity, .. } = self;
        let RunRecord { run_key, report, .. } = self.record;
        let allocation = self.record.allocation();
        let Convergence { spp, rays, seconds, stopped, .. } =
            report.convergence;
        let progress = json!({
            "scene": report.scene.file,
            "spp": spp,
            "rays": rays,
            "load_seconds": report.load_seconds,
            "build_seconds": report.build_seconds,
            "render_seconds": seconds,
            "stopped": stopped.map_or(json!("not yet"), |stop| json!(stop)),
        });
        let mut facts = entries(&report.settings);
        facts.retain(|_, value| !value.is_null());
        facts.extend(entries(run_key));
        facts.extend(entries(&progress));
        let auto = self.auto.map(|stops| json!(stops));
        facts.extend(auto.map(|stops| (AUTO_EXPOSURE.to_owned(), stops)));
        let errors = filtered.and_then(|image| image.errors.as_deref());
        let more = [
            (OPACITY, opacity),
            (FILTERED[0], filtered.map(|image| &image.means[..])),
            (FILTERED[1], errors),
        ];
        let more = more
            .into_iter()
            .filter_map(|(name, channel)| Some((name, channel?)));
        Picture {
            film,
            allocation,
            more: more.collect(),
            attributes: attributes(&facts),
        }
    }
}
