// Stability in one table: what is exact, and what pt gives; prints a CSV for
// "make stability". The arguments are the number of rays in each closed
// surface, "leaks" for nothing but those, and how many rows to skip, for a run
// that goes on with another. Fails if a case fails.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;

use glam::DVec3;
use litpt::bvh::{Bvh, Intersector, Isa, Quality};
use litpt::film::Film;
use litpt::render::{Job, Renderer};
use litpt::scene::{Mesh, Scene};
use litpt::statistics::Accumulator;
use litpt_book::closed_forms::{
    Outcome, Setting, cavity, cavity_radiance, closed_forms, look, pixel,
    plane,
};
use litpt_book::escapes::{Inside, Outside};
use litpt_book::mixtures::Mixture;
use litpt_book::solids;
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

use super::Done;

/// Paths are counted in pieces, whose number is that of generators.
const PIECES: u64 = 256;

/// Rays of a path inside a closed surface.
const BOUNCES: u64 = 4;

/// Samples of each mean.
const SAMPLES: u64 = 100_000;

/// Of 40 means, one is farther off than this with a probability of 0.001.
const SIDAK: f64 = 4.22;

/// Likewise of six images of 48 pixels.
const SIDAK_OF_PIXELS: f64 = 4.65;

pub fn run(arguments: &[String]) -> Done {
    let mut arguments = arguments.iter();
    let rays: f64 = arguments.next().map_or(Ok(1e7), |s| s.parse())?;
    let only = arguments.next().map(String::as_str);
    let skipped: usize = arguments.next().map_or(Ok(0), |s| s.parse())?;
    if skipped == 0 {
        println!("case,exact,pt,verdict");
    }
    let failed = match only {
        None => {
            closed(rays, 0)?
                + over_planes(rays)?
                + moved()?
                + alike()?
                + means()?
                + known()?
                + mixed()?
        }
        Some("leaks") => closed(rays, skipped)?,
        Some(other) => return Err(format!("no cases {other}").into()),
    };
    match failed {
        0 => Ok(()),
        _ => Err(format!("{failed} cases fail").into()),
    }
}

/// Prints a row; 1 if it is one of a failure.
fn row(case: &str, exact: &str, ours: &str, passed: bool) -> u32 {
    let verdict = if passed { "pass" } else { "fail" };
    println!("{case},{exact},{ours},{verdict}");
    u32::from(!passed)
}

// ---- closed surfaces

/// How many paths make so many rays in each piece.
fn number_of_paths(rays: f64) -> u64 {
    (rays / (PIECES * BOUNCES) as f64).ceil() as u64
}

/// A row for each solid, but for those skipped.
fn closed(rays: f64, skipped: usize) -> Result<u32, Box<dyn Error>> {
    let paths = number_of_paths(rays);
    let number = PIECES * BOUNCES * paths;
    let mut failed = 0;
    for solid in solids::all().into_iter().skip(skipped) {
        let leaks = through(&solid, INSIDE, paths)?;
        let case = format!("{} ({})", solid.name, solid.own().len());
        let exact = format!("0 of {:.0e}", number as f64);
        failed += row(&case, &exact, &leaks.to_string(), leaks == 0);
    }
    Ok(failed)
}

/// How many paths go through the surface of a solid, of so many from inside,
/// or of those from outside that have as many rays.
fn through(
    solid: &solids::Solid,
    side: &str,
    paths: u64,
) -> Result<u64, Box<dyn Error>> {
    let bvh = &Bvh::new(&solid.scene)?;
    let (rays, bounces) = (paths * BOUNCES, BOUNCES);
    let piece = |seed| match side {
        INSIDE => bvh.dispatch(Inside { solid, bvh, seed, paths, bounces }),
        _ => bvh.dispatch(Outside { solid, seed, rays }),
    };
    Ok((0..PIECES).into_par_iter().map(piece).sum())
}

// ---- closed surfaces over large planes

/// On which side of the surface paths begin, and how high above the plane it
/// is: from a narrow gap below it paths would hardly find out.
const SIDES: [(&str, f64); 2] = [(INSIDE, 4.), ("outside", 4096.)];
const INSIDE: &str = "inside";

/// Rows of so many rays for all solids together.
fn over_planes(rays: f64) -> Result<u32, Box<dyn Error>> {
    let solids = solids::all();
    let n = solids.len() as u64;
    let paths = number_of_paths(rays / n as f64);
    let exact =
        format!("0 of {:.0e}", (PIECES * BOUNCES * paths * n) as f64);
    let mut failed = 0;
    for exponent in [3, 6, 9] {
        for (side, gap) in SIDES {
            let mut leaks = 0;
            for solid in &solids {
                let above = solid.over(10f64.powi(exponent), gap);
                leaks += through(&above, side, paths)?;
            }
            let case =
                format!("all {n} solids; {side}; over $10^{exponent}$");
            failed += row(&case, &exact, &leaks.to_string(), leaks == 0);
        }
    }
    Ok(failed)
}

// ---- places and scales

/// A closed sphere that is moved or scaled: it is dark, and the image of a
/// cavity stays the same in each bit.
fn moved() -> Result<u32, Box<dyn Error>> {
    let (o, p) = (DVec3::ZERO, DVec3::new(0.3, 0.2, -1.));
    let exactly = |x: f64| (x * 1024.).round() / 1024.;
    let mut sphere = cavity(0.1, 16);
    for v in &mut sphere.vertices {
        *v = DVec3::new(exactly(v.x), exactly(v.y), exactly(v.z));
    }
    let target = p.map(exactly);
    let cases = [
        ("moved by $2^{20}$", 2f64.powi(20), 1.),
        ("moved by $2^{40}$", 2f64.powi(40), 1.),
        ("scaled by $2^{-200}$", 0., 2f64.powi(-200)),
        ("scaled by $2^{200}$", 0., 2f64.powi(200)),
        ("scaled by $2^{-1000}$", 0., 2f64.powi(-1000)),
        ("scaled by $2^{1000}$", 0., 2f64.powi(1000)),
    ];
    let n = 20_000;
    let still = pixel(&sphere, 0.9, &look(o, target, 20.), n)?;
    let mut failed = 0;
    for (what, shift, scale) in cases {
        let place = |v: DVec3| v * scale + DVec3::splat(shift);
        let mut mesh = sphere.clone();
        mesh.vertices.iter_mut().for_each(|v| *v = place(*v));
        let view = (place(o), place(target));
        let ours = pixel(&mesh, 0.9, &look(view.0, view.1, 20.), n)?;
        failed += row(
            &format!(r"cavity $f=0.1$; $\rho=0.9$; {what}"),
            &format!("{:.6}", still.mean()),
            &format!("{:.6}", ours.mean()),
            ours == still,
        );
    }
    for shift in [0., 1e5, 1e7] {
        let place = |v: DVec3| v + DVec3::splat(shift);
        let mut mesh = solids::icosphere(5);
        mesh.vertices.iter_mut().for_each(|v| *v = place(*v));
        let view = (place(o), place(p));
        let ours = pixel(&mesh, 0.9, &look(view.0, view.1, 20.), n)?;
        failed += row(
            &format!("closed icosphere 5; moved by {shift:e}"),
            "0",
            &ours.mean().to_string(),
            ours.mean() == 0. && ours.variance() == 0.,
        );
    }
    Ok(failed)
}

/// The image of a cavity has the same bytes from each set of instructions
/// of this processor, and from any number of threads.
fn alike() -> Result<u32, Box<dyn Error>> {
    let mesh = cavity(0.1, 16);
    let scene = Scene::new(&mesh);
    let view = look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 70.);
    let setting = Setting::new(&mesh, (0.9, DVec3::Z), &view, 1.)?;
    let render = |isa, threads| -> Result<Film, Box<dyn Error>> {
        let intersector = &Bvh::with(&scene, Quality::FAST, isa)?;
        let pool = ThreadPoolBuilder::new().num_threads(threads).build()?;
        let mut job = Job { intersector, ..setting.job(1) };
        let mut film = Film::new(64, 48);
        pool.install(|| job.pass(&mut film, 16, &|_| true));
        Ok(film)
    };
    let first = render(Isa::Portable, 1)?;
    let (mut images, mut equal) = (1, 1);
    for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
        for threads in [1, 2, 7] {
            images += 1;
            let film = render(isa, threads)?;
            equal += usize::from(film.pixels == first.pixels);
        }
    }
    Ok(row(
        "instructions and threads: equal images",
        &images.to_string(),
        &equal.to_string(),
        images == equal,
    ))
}

// ---- means that are known

fn means() -> Result<u32, Box<dyn Error>> {
    let mut failed = 0;
    let above = (DVec3::new(0.3, 0.1, 2.), DVec3::new(0.25, -0.125, 0.));
    for scale in [1e-300, 1e-30, 1., 1e30, 1e300] {
        let mut mesh = plane();
        mesh.vertices.iter_mut().for_each(|v| *v *= scale);
        let view = (above.0 * scale, above.1 * scale);
        let case = format!("plane; scaled by {scale:e}");
        failed += mean(&case, &mesh, 0.5, view, 0.5)?;
    }
    let inside = (DVec3::ZERO, DVec3::new(0.3, 0.2, -1.));
    for (rho, f) in [
        (0.5, 0.5),
        (0.9, 0.05),
        (0.99, 0.01),
        (0.999, 1e-3),
        (1. - 1e-6, 1e-3),
        (1., 1e-3),
    ] {
        let mesh = cavity(f, 128);
        let case = format!(r"cavity $f={f}$; $\rho={rho}$");
        let exact = cavity_radiance(rho, f);
        failed += mean(&case, &mesh, rho, inside, exact)?;
    }
    Ok(failed)
}

/// All closed forms of the book.
fn known() -> Result<u32, Box<dyn Error>> {
    let (mut count, mut worst) = (0, 0f64);
    let (mut certain, mut exact) = (0, 0);
    for (form, seed) in closed_forms().iter().zip((1000..).step_by(10)) {
        for outcome in form.outcomes(SAMPLES / 4, seed)? {
            if outcome.is_certain() {
                let Outcome { exact: expected, pixel, .. } = &outcome;
                let equal = pixel.mean() == *expected;
                exact += u32::from(equal && pixel.variance() == 0.);
                certain += 1;
            } else {
                worst = worst.max(outcome.z().abs());
                count += 1;
            }
        }
    }
    let certainly = row(
        "closed forms: those without variance",
        &certain.to_string(),
        &exact.to_string(),
        certain == exact,
    );
    // Of 100 values, one exceeds 4.42 with a probability of 0.001.
    Ok(certainly
        + row(
            &format!("closed forms: largest $|z|$ of {count}"),
            "",
            &format!("{worst:.2}"),
            count <= 100 && worst <= 4.42,
        ))
}

/// A mean that is known.
fn mean(
    case: &str,
    mesh: &Mesh,
    rho: f64,
    view: (DVec3, DVec3),
    exact: f64,
) -> Result<u32, Box<dyn Error>> {
    let ours = pixel(mesh, rho, &look(view.0, view.1, 20.), SAMPLES)?;
    let said = |pixel: &Accumulator| match pixel.standard_error() {
        0. => format!("{:.6}", pixel.mean()),
        error => {
            let z = (pixel.mean() - exact) / error;
            format!("{:.6} ({z:+.1} SE)", pixel.mean())
        }
    };
    let off = (ours.mean() - exact).abs();
    let passed = off <= SIDAK * ours.standard_error();
    Ok(row(case, &format!("{exact:.6}"), &said(&ours), passed))
}

// ---- mixtures of scales

/// Objects in large surroundings look as they do in smaller ones, which are
/// so chosen that the answers differ by less than a tenth of a standard error.
///
/// Of a horizon 10^6 away, seen from a height of two, 2e-6 are missing, or
/// 2e-5 of a pixel, whose standard error is 3e-4, as it shows sky of 1 and
/// ground of 0.8. Other pixels have about 1e-3. The hair is 10^5 times as
/// narrow as its room, and the camera four times its width away from it: it
/// ends, and the room moves, by less than 1e-4. The hills of the grass begin
/// at 300 metres, and are as high at all sizes; among blades a metre apart
/// their angle differs by 3e-5.
fn mixed() -> Result<u32, Box<dyn Error>> {
    let pairs = [
        ["ball 1e9", "ball 1e6"],
        ["aside 1e9", "aside 1e6"],
        ["hair 1e7", "hair 1e5"],
        ["grass 5e4", "grass 1e3"],
        ["two 1e9", "one 0"],
        ["other 1e9", "one 0"],
    ];
    let mut failed = 0;
    for [name, smaller] in pairs {
        let [ours, expected] = [image(name, 1)?, image(smaller, 2)?];
        let z = |i: usize| {
            let [a, b] = [ours.pixels[i], expected.pixels[i]];
            let error = a.standard_error().hypot(b.standard_error());
            let off = (a.mean() - b.mean()).abs();
            if off == 0. { 0. } else { off / error }
        };
        let pixels = 0..ours.pixels.len();
        let worst = pixels.clone().map(z).fold(0., f64::max);
        failed += row(
            &format!("{name} against {smaller}"),
            &format!("{:.6}", expected.summary().mean),
            &format!("{:.6} ({worst:.1} SE)", ours.summary().mean),
            pixels.map(z).all(|z| z <= SIDAK_OF_PIXELS),
        );
    }
    let [ours, expected] = [image("utm 5.6e6", 1)?, image("utm 0", 1)?];
    Ok(failed
        + row(
            "utm 5.6e6 against utm 0",
            &format!("{:.6}", expected.summary().mean),
            &format!("{:.6}", ours.summary().mean),
            ours.pixels == expected.pixels,
        ))
}

/// A small image of a mixture with its number.
fn image(mixture: &str, seed: u64) -> Result<Film, Box<dyn Error>> {
    let (name, number) = mixture.split_once(' ').ok_or("no number")?;
    let Mixture { mesh, view } =
        Mixture::named(name, number.parse()?).ok_or("no such mixture")?;
    let mut film = Film::new(8, 6);
    let setting = Setting::new(&mesh, (0.8, DVec3::Z), &view, 8. / 6.)?;
    setting.job(seed).pass(&mut film, SAMPLES, &|_| true);
    Ok(film)
}
