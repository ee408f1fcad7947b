// The course of a run, the errors of its image, and the rule that stops it
// (chapters "The image", "The render" and "The course of a run").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use litpt::cli::watchdog::without_image;
/// An intersector that finds nothing, for estimators that need nothing.
struct Nothing;

impl Intersector for Nothing {
    fn first_hit(&self, _: &Ray, _: Option<u32>) -> Option<Hit> {
        None
    }
}

/// The weight that a function makes of a number uniform over [0, 1), after
/// three rays.
#[derive(Clone, Copy)]
struct Draw<F>(F);

impl<F: Fn(f64) -> f64 + Sync> Integrator for Draw<F> {
    /// The rays so far.
    type Path = u32;

    fn begin(&self, _: DVec3, _: f64) -> u32 {
        0
    }

    fn advance(
        &self,
        rays: &mut u32,
        _: Option<Hit>,
        sampler: &mut impl Sampler,
    ) -> PathEvent {
        *rays += 1;
        match *rays {
            3 => PathEvent::Terminate(self.0(sampler.get_1d(2))),
            _ => {
                let (origin, direction) = (DVec3::ZERO, DVec3::X);
                PathEvent::Scatter(Ray { origin, direction }, 0)
            }
        }
    }
}

/// An open sphere, seen from inside.
pub static WORLD: LazyLock<Setting> = LazyLock::new(|| {
    let view = look(DVec3::ZERO, DVec3::new(0.5, 0.3, -1.), 100.);
    Setting::new(&cavity(0.3, 24), (0.8, DVec3::Z), &view, 1.).unwrap()
});

/// What the integrator makes of the inside of that sphere, which it does not
/// see.
fn job<E>(integrator: E, seed: u64) -> Job<'static, Nothing, E> {
    let Job { sensor, known_pixels, sampler, .. } = WORLD.job(seed);
    let intersector = &Nothing;
    Job { sensor, intersector, integrator, known_pixels, sampler }
}

/// No limit but a number that no correct run of these tests reaches.
fn limits() -> Limits<'static> {
    Limits { samples: Some(50_000), ..Limits::default() }
}

/// Goes on with a run until a limit is reached.
pub fn go_on(
    renderer: &mut dyn Renderer,
    convergence: &mut Convergence,
    film: &mut Film,
    limits: &Limits,
) -> Stop {
    convergence.run(renderer, film, limits, &|_| (), &mut |_, _| ())
}

/// Runs a job from the beginning until a limit is reached.
fn run<K: Intersector, E: Integrator>(
    job: &mut Job<K, E>,
    (width, height): (u32, u32),
    limits: &Limits,
) -> (Convergence, Film, Stop) {
    let mut film = Film::new(width, height);
    let mut convergence = Convergence::default();
    let stop = go_on(job, &mut convergence, &mut film, limits);
    (convergence, film, stop)
}

/// A watch that lets work go on so many times.
pub fn watch_of(calls: u64) -> impl Fn(u64) -> bool + Sync {
    let left = AtomicU64::new(calls);
    let less = |n: u64| n.checked_sub(1);
    move |_| left.fetch_update(Relaxed, Relaxed, less).is_ok()
}

/// Does some work on so many threads.
pub fn with_threads<T: Send>(
    n: usize,
    work: impl FnOnce() -> T + Send,
) -> T {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n);
    pool.build().unwrap().install(work)
}

/// An image with the given weights in the pixel of column x and row y.
pub fn image_of(
    (width, height): (u32, u32),
    mut weights: impl FnMut(u32, u32) -> Vec<f64>,
) -> Film {
    let mut film = Film::new(width, height);
    for FilmTile { tile, pixels, .. } in film.tiles() {
        for (i, pixel) in (0..).zip(pixels) {
            let x = tile.corner.0 + i % tile.size.0;
            let y = tile.corner.1 + i / tile.size.0;
            weights(x, y).into_iter().for_each(|w| pixel.add(w));
        }
    }
    film
}

fn close(a: f64, b: f64) -> bool {
    a == b || (a / b - 1.).abs() < 1e-12
}

// ---------------------------------------------------------------- The image

/// Constant neighbours count as zero, and unknown ones not at all. The image
/// has two rims in which squares of 5x5 are cut off, and four tiles, whose
/// first pixels have a sample, as in each film.
#[test]
fn a_pixel_borrows_from_the_variance_of_its_neighbours() {
    let (width, height) = (20, 18);
    let film =
        image_of((width, height), |x, y| match (7 * x + 3 * y + 1) % 11 {
            0 => vec![],
            1 => vec![0.9],
            2..6 => vec![0.5; 7],
            k => vec![0., f64::from(x + 20 * y), f64::from(k)],
        });
    let known = |&(x, y): &(u32, u32)| film.pixel(x, y).count() > 1;
    for (i, error) in (0..).zip(film.errors(NEIGHBOUR_WEIGHT, film.window))
    {
        let (x, y) = (i % width, i / width);
        let columns = x.saturating_sub(2)..(x + 3).min(width);
        let rows = y.saturating_sub(2)..(y + 3).min(height);
        let near = rows.flat_map(|y| columns.clone().map(move |x| (x, y)));
        let near = near.filter(|&place| place != (x, y)).filter(known);
        let near = near.map(|(x, y)| film.pixel(x, y).variance());
        let near: Vec<f64> = near.collect();
        let borrowed = near.iter().sum::<f64>() / near.len() as f64;
        let own = film.pixel(x, y);
        let n = own.count() as f64;
        let sum = (n - 1.) * own.variance() + NEIGHBOUR_WEIGHT * borrowed;
        let expected = match known(&(x, y)) {
            true => f64::sqrt(sum / (n - 1. + NEIGHBOUR_WEIGHT) / n),
            false => f64::INFINITY,
        };
        assert!(close(error, expected), "{x},{y}: {error} {expected}");
    }
    for (error, pixel) in
        film.errors(0., film.window).iter().zip(film.rows())
    {
        assert!(close(*error, pixel.standard_error()));
    }
}

#[test]
fn the_error_of_one_value_is_zero_and_that_of_one_realisation_unknown() {
    for (count, error, constant) in [(3, 0., 63), (1, f64::INFINITY, 0)] {
        let film = image_of((9, 7), |_, _| vec![0.25; count]);
        assert_eq!(film.errors(NEIGHBOUR_WEIGHT, film.window), [error; 63]);
        let (mean, mean_stderr, rmse) = (0.25, error, error);
        let summary = Summary { mean, mean_stderr, rmse, constant };
        assert_eq!(film.summary(), summary);
    }
}

#[test]
fn the_summary_averages_the_squares_of_the_errors_that_pixels_state() {
    let weights = |x: u32, y: u32| match (x * 7 + y * 3) % 5 {
        0 => vec![0.25; 6],
        k => vec![f64::from(x % 9), 0.1 * f64::from(k), f64::from(y)],
    };
    let film = image_of((50, 37), weights);
    let (mut squares, mut mean, mut constant) = (0., 0., 0);
    for (pixel, error) in
        film.rows().zip(film.errors(NEIGHBOUR_WEIGHT, film.window))
    {
        squares += error.powi(2);
        mean += pixel.mean();
        constant += u64::from(pixel.variance() == 0.);
    }
    let n = film.area() as f64;
    let summary = film.summary();
    assert!(close(summary.rmse, f64::sqrt(squares / n)));
    assert!(close(summary.mean_stderr, f64::sqrt(squares) / n));
    assert!(close(summary.mean, mean / n));
    assert!(constant >= 370 && summary.constant == constant);
    for threads in [1, 2, 7] {
        let again = with_threads(threads, || film.summary());
        assert_eq!(again.rmse.to_bits(), summary.rmse.to_bits());
        assert_eq!(again.mean.to_bits(), summary.mean.to_bits());
        assert_eq!(again, summary);
    }
}

// --------------------------------------------------------------- The render

#[test]
fn pixels_are_the_same_for_any_number_of_threads_and_passes() {
    let mut job = WORLD.job(5);
    for (size, n, parts) in [
        ((1, 1), 500, &[1, 3, 96, 399, 1][..]),
        ((3, 2), 500, &[1, 3, 96, 399, 1]),
        ((17, 1), 500, &[1, 3, 96, 399, 1]),
        ((60, 40), 8, &[1, 5, 2]),
    ] {
        let mut render = |threads, passes: &[u64]| {
            let mut film = Film::new(size.0, size.1);
            let (mut done, mut rays) = (0, 0);
            with_threads(threads, || {
                for n in passes {
                    done += n;
                    rays += job.pass(&mut film, done, &|_| true);
                }
            });
            (film.pixels.to_vec(), rays)
        };
        let alone = render(1, &vec![1; n as usize]);
        assert!(alone.0.iter().all(|pixel| pixel.count() == n));
        assert!(alone.0[0].variance() > 0. && alone.1 > 500);
        for threads in [1, 2, 7] {
            assert_eq!(render(threads, &[n]), alone);
            assert_eq!(render(threads, parts), alone);
        }
    }
}

// --------------------------------------------------------------- The course

/// The numbers of samples at which the chapter records a step.
const STEPS: [u64; 18] = [
    1, 2, 3, 4, 6, 10, 16, 25, 40, 63, 100, 160, 250, 400, 630, 1000, 1600,
    2500,
];

#[test]
fn steps_are_spread_over_the_decades_and_the_last_is_the_end() {
    let mut job = job(Draw(|u| u), 1);
    let truth: Vec<f64> = (0..15).map(|i| f64::from(i) / 15.).collect();
    for n in [1, 2, 5, 63, 64, 2024] {
        let samples = Some(n);
        let limit = Limits { samples, reference: Some(&truth), ..limits() };
        let (mut convergence, film, stop) = run(&mut job, (5, 3), &limit);
        assert_eq!((stop, convergence.spp), (Stop::Samples, n));
        assert!(film.rows().all(|pixel| pixel.count() == n));
        assert_eq!(convergence.rays, 15 * 3 * n);
        let steps = &convergence.curve;
        let expected = STEPS.into_iter().filter(|&step| step < n);
        let found = steps.iter().map(|step| step.spp);
        assert!(found.eq(expected.chain([n])), "{n}: {steps:?}");
        assert!(steps.is_sorted_by_key(|step| step.seconds));
        let last = steps[steps.len() - 1];
        assert_eq!(last.rays, convergence.rays);
        assert!(last.seconds > 0. && last.seconds <= convergence.seconds);
        let summary = film.summary();
        assert_eq!(last.mean, summary.mean);
        let finite = summary.rmse.is_finite().then_some(summary.rmse);
        assert_eq!((last.rmse, finite.is_some()), (finite, n > 1));
        assert_eq!(last.mean_stderr.is_some(), n > 1);
        // Each step is compared with the reference.
        assert!(steps.iter().all(|step| step.rmse_reference.is_some()));
        let pairs = film.means().zip(&truth);
        let squares = pairs.map(|(mean, truth)| (mean - truth).powi(2));
        let expected = (squares.sum::<f64>() / 15.).sqrt();
        assert!(close(last.rmse_reference.unwrap(), expected));
        // What is recorded already is not recorded again.
        let count = steps.len();
        convergence.record(&film, &limit);
        assert_eq!(convergence.curve.len(), count);
    }
}

// ---------------------------------------------------------- Stop by an error

/// Whether the rule of the chapter lets a run stop.
fn may_stop(rmse: f64, n: u64, pixels: u64, error: f64) -> bool {
    let (n, pixels) = (n as f64, pixels as f64);
    rmse * rmse + 3. / (n * n * pixels) <= error * error
}

#[test]
fn a_run_stops_when_its_error_is_small_enough_and_soon_after() {
    // The variance is 0.3 * 0.7.
    let integrator = Draw(|u| if u < 0.3 { 1. } else { 0. });
    let pixels = 16 * 12;
    for (seed, error) in [0.1, 0.05, 0.03, 0.011, 0.009].iter().enumerate()
    {
        let mut job = job(integrator, seed as u64);
        let limit = Limits { error: Some(*error), ..limits() };
        let (convergence, film, stop) = run(&mut job, (16, 12), &limit);
        let rmse = film.summary().rmse;
        assert_eq!(stop, Stop::Error);
        assert!(may_stop(rmse, convergence.spp, pixels, *error), "{error}");
        let last = convergence.curve[convergence.curve.len() - 1];
        assert_eq!((last.spp, last.rmse), (convergence.spp, Some(rmse)));
        let (v, e) = (0.21, error * error);
        let root = f64::sqrt(v * v + 12. * e / pixels as f64);
        let needed = (v + root) / (2. * e);
        let ratio = convergence.spp as f64 / needed;
        assert!((0.85..1.15).contains(&ratio), "{error}: {ratio}");
        for step in convergence.curve.iter().rev().skip(1) {
            let rmse = step.rmse.unwrap_or(f64::INFINITY);
            let decisive = step.spp * pixels >= 1000;
            let early = may_stop(rmse, step.spp, pixels, *error);
            assert!(!(decisive && early), "{error}: {step:?}");
        }
    }
}

/// No error is believed before a thousand paths, nor without the variance that
/// an event unseen may have: 3 / (N^2 P) is at most the square of the error.
#[test]
fn a_run_stops_when_its_error_can_be_believed() {
    let even = |_| 0.;
    let uneven = |u: f64| 0.5 + 0.01 * u;
    for (weight, error, size, n) in [
        (uneven as fn(f64) -> f64, 10., (1, 1), 1000),
        (uneven, 10., (3, 3), 112),
        (uneven, 10., (10, 10), 10),
        (uneven, 10., (20, 25), 2),
        (uneven, 10., (100, 50), 2),
        (even, 1e-3, (1, 1), 1733),
        (even, 1e-3, (10, 10), 174),
        (even, 1e-4, (10, 10), 1733),
        (even, 1e-3, (30, 30), 58),
        (even, 1e-2, (8, 8), 22),
    ] {
        let limit = Limits { error: Some(error), ..limits() };
        let mut job = job(Draw(weight), 2);
        let (convergence, film, stop) = run(&mut job, size, &limit);
        let end = (stop, convergence.spp);
        assert_eq!(end, (Stop::Error, n), "{error} {size:?}");
        let pixels = u64::from(size.0 * size.1);
        let rmse = film.summary().rmse;
        let is_first = !may_stop(0., n - 1, pixels, error);
        assert!(error == 10. || (rmse == 0. && is_first), "{error}");
    }
}

/// A weight is `high` with the probability `p`, otherwise 0. Without the guard
/// against events unseen the second case would be wrong, and the first even
/// without the minimum of a thousand paths.
#[test]
fn a_pixel_that_is_stopped_by_its_error_is_biased_and_an_image_is_not() {
    for (side, p, high, error, runs, most) in [
        (1, 0.1, 10., 0.1, 2000, 0.15),
        (1, 1e-3, 1., 2e-4, 200, 0.15),
        (8, 0.1, 10., 0.5, 300, 0.06),
        (8, 5e-3, 1., 5e-3, 100, 0.06),
    ] {
        let integrator = Draw(|u| if u < p { high } else { 0. });
        let limit = Limits { error: Some(error), ..limits() };
        let mut means = Accumulator::default();
        with_threads(1, || {
            for seed in 0..runs {
                let mut job = job(integrator, seed);
                let film = run(&mut job, (side, side), &limit).1;
                means.add(film.summary().mean);
            }
        });
        let truth = p * high;
        let deviation = high * f64::sqrt(p * (1. - p));
        let skewness = (1. - 2. * p) / f64::sqrt(p * (1. - p));
        let n = (deviation / error).powi(2).max(1000.);
        // The book says how large it is.
        let bias = if side == 1 { skewness * deviation / n } else { 0. };
        let off = means.mean() - truth;
        let bound = 1.5 * bias + 4. * means.standard_error();
        assert!(off.abs() <= bound, "{p}: {off} > {bound} ({bias})");
        // The bound itself must be able to notice a run that stops at 0.
        assert!(bound < most * truth, "{p}: {bound}");
    }
}

// ------------------------------------------------------------------- Resumed

#[test]
fn a_course_that_is_resumed_ends_as_one_that_never_stopped() {
    let mut job = job(Draw(|u| if u < 0.2 { u } else { 0. }), 3);
    let by_number = Limits { samples: Some(213), ..limits() };
    let by_error = Limits { error: Some(4e-3), ..limits() };
    let course = |run: &Convergence| {
        let mut steps = run.curve.clone();
        steps.iter_mut().for_each(|step| step.seconds = 0.);
        (run.spp, run.rays, steps)
    };
    for limit in [by_number, by_error] {
        let mut states = vec![];
        let mut whole = (Convergence::default(), Film::new(19, 5));
        let mut save = |convergence: &Convergence, film: &Film| {
            states.push((convergence.clone(), film.clone()));
        };
        let (run, film) = (&mut whole.0, &mut whole.1);
        let stop = run.run(&mut job, film, &limit, &|_| (), &mut save);
        assert!(states.len() > 8);
        for (saved, mut film) in states {
            // What a checkpoint keeps of a course.
            let text = serde_json::to_string(&saved).unwrap();
            let mut run: Convergence = serde_json::from_str(&text).unwrap();
            let again = go_on(&mut job, &mut run, &mut film, &limit);
            assert_eq!((again, course(&run)), (stop, course(&whole.0)));
            assert!(run.seconds >= saved.seconds);
            assert_eq!(film.pixels, whole.1.pixels);
        }
    }
}

#[test]
fn an_error_that_no_run_reaches_adds_no_steps() {
    let limit = |error| Limits {
        samples: Some(3000),
        error: Some(error),
        ..limits()
    };
    let mut even = job(Draw(|_| 0.5), 1);
    for error in [1e-200, f64::MIN_POSITIVE, 1e-9] {
        let steps = run(&mut even, (4, 4), &limit(error)).0.curve;
        assert_eq!(steps.len(), STEPS.len() + 1, "{error:e}");
    }
    // A weight that is no number leaves the error unknown for ever.
    let mut job = job(Draw(|u| if u < 0.5 { f64::NAN } else { u }), 1);
    let steps = run(&mut job, (4, 4), &limit(0.1)).0.curve;
    assert!(steps.len() <= STEPS.len() + 2, "{}", steps.len());
}

// ------------------------------------------------- The samples of a run

/// A renderer that makes sixteen samples of each pixel, whatever it is asked
/// for, and takes a tenth of a second of a clock for them.
struct Sixteen<'a>(&'a AtomicU64, Vec<u64>);

impl Renderer for Sixteen<'_> {
    fn pass(&mut self, film: &mut Film, end: u64, _: &Watch) -> u64 {
        self.1.push(end);
        self.0.fetch_add(100, Relaxed);
        film.pixels.iter_mut().for_each(|p| p.add_times(0.5, 16));
        0
    }
}

// Sixteen samples in 0.1 s are 40 in the quarter of a second of a pass: the
// passes are asked for the next steps, at 25 and 40 samples.
#[test]
fn the_pace_is_that_of_the_samples_that_were_made() {
    let (start, ticks) = (Instant::now(), AtomicU64::new(0));
    let clock = || start + Duration::from_millis(ticks.load(Relaxed));
    let limits = Limits {
        samples: Some(1000),
        clock: Some(&clock),
        ..Limits::default()
    };
    let mut renderer = Sixteen(&ticks, vec![]);
    let (mut film, mut run) = (Film::new(8, 8), Convergence::default());
    go_on(&mut renderer, &mut run, &mut film, &limits);
    assert_eq!(renderer.1[..3], [1, 25, 40]);
    assert_eq!(run.spp, 1008);
}

// The deadline is that of the program: what is written afterwards is taken
// off, more of it as more pixels have a sample.
#[test]
fn time_for_writing_is_kept_in_reserve() {
    let draw = Draw(|u| u);
    for (none, all) in [(0., 0.), (2., 2.), (1., 3.), (0.5, 9.)] {
        let (start, ticks) = (Instant::now(), AtomicU64::new(0));
        let clock = || {
            let now = ticks.fetch_add(1, Relaxed);
            start + Duration::from_millis(10 * now)
        };
        let limits = Limits {
            deadline: Some(start + Duration::from_secs(10)),
            reserve: [none, all],
            clock: Some(&clock),
            ..Limits::default()
        };
        // Each tile looks at the clock some times.
        let mut job = job(draw, 1);
        let size = (1024, 1024);
        let (_, film, stop) =
            with_threads(1, || run(&mut job, size, &limits));
        let share = 1. - film.unsampled() as f64 / film.area() as f64;
        let end = 10. - none - share * (all - none);
        // Each of the other tiles looks once more, and gives up.
        let others = film.unsampled() / 256;
        let now = (ticks.load(Relaxed) - others) as f64 / 100.;
        assert_eq!(stop, Stop::Time);
        assert!(0. < share && share < 1., "{share}");
        assert!((now - end).abs() < 0.2, "{now} instead of {end}");
    }
}

// A run whose time is over before it begins makes what it has to make in any
// case, and nothing more; a signal ends even that.
#[test]
fn the_least_samples_are_made_whatever_the_time() {
    let (cancelled, going) = (Interrupt::default(), Interrupt::default());
    cancelled.cancel();
    for (least, interrupt) in [(0, &going), (3, &going), (3, &cancelled)] {
        let (start, ticks) = (Instant::now(), AtomicU64::new(0));
        // A tenth of a second, which the first sample has, is over soon.
        let clock = || {
            let now = ticks.fetch_add(1, Relaxed);
            start + Duration::from_millis(10 * now)
        };
        let limits = Limits {
            least,
            deadline: Some(start),
            clock: Some(&clock),
            interrupt: Some(interrupt),
            ..Limits::default()
        };
        let (_, film, stop) =
            run(&mut job(Draw(|u| u), 1), (256, 256), &limits);
        let is_stopped = matches!(stop, Stop::Signal(_));
        assert_eq!(is_stopped, interrupt.signal().is_some());
        let is_whole = least > 0 && !is_stopped;
        assert_eq!(film.samples(), if is_whole { least } else { 0 });
    }
}

// Before the first pass there can be no image.
#[test]
fn what_ends_the_program_before_there_is_a_sample_is_said() {
    for (stop, why) in [
        (Stop::Time, "no image: --time ran out while reading"),
        (Stop::Signal(2), "no image: signal 2 came while reading"),
    ] {
        assert_eq!(without_image(stop, "reading"), why);
    }
}
