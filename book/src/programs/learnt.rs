// What a gather learns, and what it makes of it. Of the courtyard: the cache
// beside what it approximates, and its errors; the light that arrives at a
// place, over the hemisphere, the guide there, and directions drawn with it
// and without. Of the back room: images by paths and by a gather with as many
// rays. "learnt.tex" has the numbers of the text.
//
// usage: learnt FIGURES TABLES
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use litpt::analysis::LitView;
use litpt::bvh::{Bvh, Hit};
use litpt::film::{Film, Window};
use litpt::integrator::gather::Gather;
use litpt::integrator::gather::cache::{Grid, RadianceCache};
use litpt::integrator::gather::guide::{BINS, Guide, bin};
use litpt::integrator::gather::training::train;
use litpt::integrator::gather::{Allocation, End, Tracer};
use litpt::render::Renderer;
use litpt::render::choose::{Method, Pixels, Sampling};
use litpt::sampler::sobol::{ScrambledNet, scramble_key};
use litpt::sampler::{generator, to_unit};
use litpt_book::closed_forms::Setting;
use rand::RngExt;
use rayon::prelude::*;

use super::bounces::{RESOLUTION, RHO, stage};
use super::{Done, draw};

/// Samples of each pixel of the room.
const SAMPLES: u64 = 64;

/// Samples that are placed together.
const TOGETHER: u64 = 4;

/// Rays that train the cache.
const TRAINING: u64 = 1 << 20;

/// By which the radiance of the room is multiplied to be seen.
const EXPOSURE: f64 = 12.;

/// The place whose light is shown: a part of the image.
const PLACE: [f64; 2] = [0.42, 0.86];

/// Pixels along the side of a disc.
const DISC: u32 = 200;

/// Rays that gather for the radiance of a place, and for what one ray meets.
const GATHERED: u32 = 256;
const ROUGHLY: u32 = 64;

/// Directions that are drawn onto a disc.
const DRAWN: u32 = 256;

/// The difference of radiance that is white.
const WHITE: f64 = 0.15;

pub fn run(arguments: &[String]) -> Done {
    let [figures, tables] = arguments else {
        return Err("usage: learnt FIGURES TABLES".into());
    };
    let (figures, tables) = (Path::new(figures), Path::new(tables));
    let mut numbers = learn(figures)?;
    render(figures, &mut numbers)?;
    for (n, size) in [(4, (160, 120)), (64, (320, 240))] {
        let gather = Sampling::new(
            Method::Gather,
            0,
            Some(n),
            Pixels::of_image(size),
        );
        let row = format!("{n} of {}", size.0);
        number(
            &mut numbers,
            &row,
            "training",
            &gather.training.to_string(),
        )?;
    }
    Ok(fs::write(tables.join("learnt.tex"), numbers)?)
}

/// A number of the text.
fn number(out: &mut String, row: &str, column: &str, value: &str) -> Done {
    let entry = format!("\\nwmeasured{{learnt}}{{{row}}}{{{column}}}");
    Ok(writeln!(out, "{entry}{{{value}}}%")?)
}

/// Draws what is learnt of the courtyard; returns numbers of the text.
fn learn(figures: &Path) -> Result<String, Box<dyn Error>> {
    let yard = stage("courtyard", RHO)?;
    // Learn by many rays
    let gather = &Gather { training: TRAINING, ..yard.gather(RESOLUTION) };
    let intersector = gather.intersector;
    let window = Window { corner: (0, 0), size: RESOLUTION };
    let allocation = &Allocation::even(window, 1);
    let cache = &RadianceCache::empty(Grid::around(&[]));
    let prototype = Tracer::new(gather, intersector, cache, allocation);
    let (cache, _) = &train(&prototype, &|_| true).ok_or("stopped")?;
    let prototype = &Tracer { cache, ..prototype };
    // Draw what is learnt
    let mut out = String::new();
    compare(figures, prototype, &mut out)?;
    let end = Tracer { ..*prototype }.trace_primary(PLACE[0], PLACE[1]);
    let Some(place) = end else {
        return Err("no surface there".into());
    };
    let name = cache.grid.name(place.point, place.normal);
    let guide = cache.guide(cache.at(name)).ok_or("no guide there")?;
    let light = light(prototype, &place);
    picture(figures, "light", DISC, light.clone())?;
    let most = (0..BINS).map(|b| guide.density(b)).fold(0., f64::max);
    let density = |p| guide.density(bin(p)) / most;
    picture(figures, "guide", DISC, disc(density))?;
    number(&mut out, "guide", "most", &format!("{most:.1}"))?;
    for (name, guide) in [("cosine", None), ("guided", Some(guide))] {
        let mut drawn = light.clone();
        let bright = dots(&mut drawn, &light, guide);
        picture(figures, name, DISC, drawn)?;
        number(&mut out, name, "bright", &bright.to_string())?;
    }
    Ok(out)
}

/// Draws the back room by paths and by a gather.
fn render(figures: &Path, out: &mut String) -> Done {
    let room = stage("backroom", RHO)?;
    let gather = room.gather(RESOLUTION);
    let mut gather = Gather { training: TRAINING, ..gather };
    let film = Film::new(RESOLUTION.0, RESOLUTION.1);
    let mut film = film.with_net_size(TOGETHER).with_shared_tiles();
    let rays = gather.pass(&mut film, SAMPLES, &|_| true);
    let mut paths = Film::new(RESOLUTION.0, RESOLUTION.1);
    let (samples, traced) = trace(&room, rays, &mut paths);
    for (way, film, samples, rays) in [
        ("gather", &film, SAMPLES, rays),
        ("paths", &paths, samples, traced),
    ] {
        let exposed = film.means().map(|mean| EXPOSURE * mean);
        picture(figures, way, RESOLUTION.0, exposed.collect())?;
        let (rays, error) = (rays as f64 / 1e6, film.summary().rmse);
        number(out, way, "samples", &samples.to_string())?;
        number(out, way, "rays", &format!("{rays:.1}"))?;
        number(out, way, "error", &format!("{error:.4}"))?;
    }
    Ok(())
}

/// Renders by paths of at least so many rays; samples and rays.
fn trace(setting: &Setting, rays: u64, film: &mut Film) -> (u64, u64) {
    let mut job = setting.job(1);
    let (mut samples, mut traced) = (0, 0);
    while traced < rays {
        samples += 1;
        traced += job.pass(film, samples, &|_| true);
    }
    (samples, traced)
}

/// Draws the values of the cells in the middles of the pixels, the
/// radiance there, how much both differ, and what the cells say of it.
fn compare(
    figures: &Path,
    prototype: &Tracer<Bvh>,
    out: &mut String,
) -> Done {
    let (width, height) = RESOLUTION;
    let pixels = (0..width * height).into_par_iter().map(|i| {
        let x = (f64::from(i % width) + 0.5) / f64::from(width);
        let y = (f64::from(i / width) + 0.5) / f64::from(height);
        let mut tracer = Tracer { ..*prototype };
        let LitView { sensor, sky, surfaces, .. } = prototype.gather.view;
        let start = sensor.start(prototype.intersector, &surfaces, (x, y));
        match start.hit {
            None => {
                let radiance = sky.radiance(start.direction);
                [radiance, radiance, 0., 0.]
            }
            Some(hit) => {
                let name = prototype.cache.grid.name(hit.point, hit.normal);
                let cell = prototype.cache.at(name);
                let stream = u64::from(i);
                let truth = gathered(&mut tracer, &hit, GATHERED, stream);
                let value = f64::from(cell.value);
                let wrong = (value - truth).abs();
                [value, truth, wrong, f64::from(cell.error)]
            }
        }
    });
    let pixels: Vec<[f64; 4]> = pixels.collect();
    let all = |k: usize| pixels.iter().map(move |p| p[k]);
    let hits = || pixels.iter().filter(|p| p[3] > 0.);
    let n = hits().count() as f64;
    let truth = hits().map(|p| p[1]).sum::<f64>() / n;
    for (k, name) in [(2, "wrong"), (3, "claimed")] {
        let greys = all(k).map(|d| grey(d / WHITE));
        picture(figures, name, width, greys.collect())?;
        let square = hits().map(|p| p[k] * p[k]).sum::<f64>() / n;
        let share = 100. * square.sqrt() / truth;
        number(out, name, "share", &format!("{share:.0}"))?;
    }
    let off = hits().map(|p| p[0] - p[1]).sum::<f64>() / n / truth;
    number(out, "cache", "off", &format!("{:.1}", 100. * off.abs()))?;
    picture(figures, "truth", width, all(1).collect())?;
    let mut cached: Vec<f64> = all(0).collect();
    cross_out(&mut cached);
    picture(figures, "cache", width, cached)
}

/// The light that arrives at the place, over the disc: what a ray
/// meets there has the radiance that many more rays gather.
fn light(prototype: &Tracer<Bvh>, place: &Hit) -> Vec<f64> {
    disc(|point| {
        let at = point.map(|u| (u * 4294967296.) as u32);
        let mut tracer = Tracer { ..*prototype };
        match tracer.trace_gather_ray(place, None, at).end {
            End::Sky(radiance) => radiance,
            End::Hit(hit) => {
                let stream = u64::from(at[0]) << 32 | u64::from(at[1]);
                gathered(&mut tracer, &hit, ROUGHLY, stream)
            }
        }
    })
}

/// The radiance that leaves a hit, from so many rays into the cache; by the
/// number of a stream.
fn gathered(
    tracer: &mut Tracer<Bvh>,
    hit: &Hit,
    rays: u32,
    stream: u64,
) -> f64 {
    let cache = tracer.cache;
    let name = cache.grid.name(hit.point, hit.normal);
    let guide = cache.guide(cache.at(name));
    let net = ScrambledNet::new(u64::from(rays));
    let mut random = generator(2, stream, 0);
    let key = scramble_key(2, stream, 0);
    let mut sum = 0.;
    for n in 0..rays {
        let ray = tracer.trace_gather_ray(hit, guide, net.pair(key, n, 0));
        let arriving = match ray.end {
            End::Sky(radiance) => radiance,
            End::Hit(hit) => {
                let near = [random.random(), random.random()];
                f64::from(tracer.cell_around(&hit, near).value)
            }
        };
        sum += ray.weight * arriving;
    }
    RHO * sum / f64::from(rays)
}

/// A function over the square as a picture of the disc to which Shirley and
/// Chiu map it, on white.
fn disc(value: impl Fn([f64; 2]) -> f64 + Sync) -> Vec<f64> {
    let pixel = |i: u32| {
        let [x, y] = [i % DISC, i / DISC]
            .map(|k| (2. * f64::from(k) + 1.) / f64::from(DISC) - 1.);
        let radius = x.hypot(y);
        if radius >= 1. {
            return 1.;
        }
        value(unmapped(radius, y.atan2(x)))
    };
    (0..DISC * DISC).into_par_iter().map(pixel).collect()
}

/// The point of the square that the concentric map takes to this radius and
/// angle.
fn unmapped(radius: f64, angle: f64) -> [f64; 2] {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
    let quarter = (angle / FRAC_PI_2).round();
    let aside = radius * (angle - quarter * FRAC_PI_2) / FRAC_PI_4;
    let (a, b) = match (quarter as i32).rem_euclid(4) {
        0 => (radius, aside),
        1 => (-aside, radius),
        2 => (-radius, -aside),
        _ => (aside, -radius),
    };
    debug_assert!(angle.abs() <= PI);
    [a, b].map(|c| ((c + 1.) / 2.).clamp(0., 1. - 1e-9))
}

/// Where on the disc the concentric map takes a point of the square.
fn mapped([u, v]: [f64; 2]) -> [f64; 2] {
    let (a, b) = (2. * u - 1., 2. * v - 1.);
    let (radius, turn) = match a.abs() > b.abs() {
        true => (a, 0.125 * b / a),
        false if b != 0. => (b, 0.25 - 0.125 * a / b),
        false => (0., 0.),
    };
    let (sine, cosine) = (std::f64::consts::TAU * turn).sin_cos();
    [radius * cosine, radius * sine]
}

/// Puts the directions that a guide draws onto a picture of the light, as
/// white dots with a black rim; how many of them find at least half of the
/// radiance of the sky.
fn dots(pixels: &mut [f64], light: &[f64], guide: Option<&Guide>) -> u32 {
    let net = ScrambledNet::new(u64::from(DRAWN));
    let key = scramble_key(6, 0, 0);
    let mut bright = 0;
    for n in 0..DRAWN {
        let u = net.pair(key, n, 0);
        let point = guide.map_or(u.map(to_unit), |guide| guide.warp(u).0);
        let [x, y] =
            mapped(point).map(|c| ((c + 1.) / 2. * f64::from(DISC)) as i32);
        let at = |x: i32, y: i32| {
            let inside = |k| (0..DISC as i32).contains(&k);
            (inside(x) && inside(y)).then(|| (y * DISC as i32 + x) as usize)
        };
        bright += u32::from(at(x, y).is_some_and(|i| light[i] >= 0.5));
        for (dx, dy) in (-2..=2).flat_map(|y| (-2..=2).map(move |x| (x, y)))
        {
            let far: i32 = dx * dx + dy * dy;
            if let Some(i) = at(x + dx, y + dy).filter(|_| far < 8) {
                pixels[i] = if far < 3 { 1. } else { 0. };
            }
        }
    }
    bright
}

/// Puts a black cross over the place.
fn cross_out(pixels: &mut [f64]) {
    let (width, height) = RESOLUTION;
    let [x, y] = PLACE;
    let (x, y) = (x * f64::from(width), y * f64::from(height));
    let middle = y as usize * width as usize + x as usize;
    for step in [1, width as usize] {
        for i in 0..9 {
            pixels[middle + i * step - 4 * step] = 0.;
        }
    }
}

/// The radiance that is drawn as this share of white.
fn grey(share: f64) -> f64 {
    share.min(1.).powf(2.2)
}

/// Writes a picture of what is learnt, of values in [0, 1].
fn picture(
    figures: &Path,
    name: &str,
    width: u32,
    means: Vec<f64>,
) -> Done {
    draw(&figures.join(format!("learnt-{name}.png")), width, means)
}
