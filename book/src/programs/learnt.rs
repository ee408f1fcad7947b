// What a gather learns, and what it makes of it: pictures of a cache of the
// courtyard, of a guide and of the light that it was made for; of the back
// room by paths and by a gather with as many rays, and of the samples of its
// pixels. "learnt.tex" has the numbers of the text.
//
// usage: learnt FIGURES TABLES
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::path::Path;

use litpt::analysis::background::KnownPixels;
use litpt::bvh::{Bvh, Hit};
use litpt::camera::{Camera, View};
use litpt::film::Film;
use litpt::gather::cache::{Grid, RadianceCache};
use litpt::gather::guide::{BINS, Guide, SIDE};
use litpt::gather::training::train;
use litpt::gather::{Correction, End, Tracer};
use litpt::image::{Format, Image};
use litpt::integrator::PathTracer;
use litpt::render::gather::Gather;
use litpt::render::{Job, Renderer};
use litpt::sampler::sobol::{ScrambledNet, scramble_key};
use litpt::sampler::{IndependentSampler, generator};
use litpt::scene::{Mesh, Scene};
use litpt::sky::Sky;
use litpt_book::courtyard;
use litpt_book::interiors::Interior;
use rand::RngExt;
use rayon::prelude::*;

use super::Done;

/// Pixels of the room, and the samples of each.
const RESOLUTION: (u32, u32) = (128, 96);
const SAMPLES: u64 = 64;

/// Samples that are placed together.
const TOGETHER: u64 = 4;

/// Rays that train the cache.
const TRAINING: u64 = 1 << 20;

/// Albedo of all surfaces.
const RHO: f64 = 0.8;

/// By which the radiance of the room is multiplied to be seen.
const EXPOSURE: f64 = 12.;

/// The place whose light is shown: a part of the image.
const PLACE: [f64; 2] = [0.42, 0.86];

/// Pixels along the side of the square, and rays that gather for each.
const FINE: u32 = 64;
const GATHERED: u32 = 256;

pub fn run(arguments: &[String]) -> Done {
    let [figures, tables] = arguments else {
        return Err("usage: learnt FIGURES TABLES".into());
    };
    let figures = Path::new(figures);
    learn(figures)?;
    let numbers = render(figures)?;
    Ok(fs::write(Path::new(tables).join("learnt.tex"), numbers)?)
}

/// Draws what is learnt of the courtyard.
fn learn(figures: &Path) -> Done {
    let yard = Stage::new(&courtyard::mesh(), &courtyard::view())?;
    let nothing = RadianceCache::empty(Grid::around(&[]));
    let (cache, _) = train(&yard.tracer(&nothing), TRAINING, 0);
    let place = yard.place(&cache).ok_or("no surface there")?;
    let name = cache.grid().name(place.point, place.normal);
    let guide = cache.guide(cache.at(name)).ok_or("no guide there")?;
    let mut cached = yard.cached(&cache);
    cross_out(&mut cached);
    draw(figures, "cache", RESOLUTION.0, cached)?;
    draw(figures, "light", FINE, yard.light(&cache, &place))?;
    draw(figures, "guide", SIDE as u32, density(guide))
}

/// Draws the back room by paths and by a gather, and where its samples are;
/// returns the numbers of the text.
fn render(figures: &Path) -> Result<String, Box<dyn Error>> {
    let interior = Interior::named("backroom").ok_or("no such room")?;
    let room = Stage::new(&interior.mesh(), &interior.view)?;
    let mut gather = room.gather();
    let film = Film::new(RESOLUTION.0, RESOLUTION.1);
    let film = film.with_replicates(TOGETHER);
    let mut film = film.with_shared_tiles();
    let rays = gather.pass(&mut film, SAMPLES, &|_| true);
    let learnt = gather.learnt.as_ref().ok_or("nothing was learnt")?;
    let mut paths = Film::new(RESOLUTION.0, RESOLUTION.1);
    let (samples, traced) = room.trace(rays, &mut paths);
    let counts = &learnt.allocation.counts;
    let most = f64::from(counts.iter().max().copied().unwrap_or(1));
    let counts = counts.iter().map(|&n| f64::from(n) / most).collect();
    draw(figures, "counts", RESOLUTION.0, counts)?;
    let mut out = String::new();
    for (way, film, samples, rays) in [
        ("gather", &film, SAMPLES, rays),
        ("paths", &paths, samples, traced),
    ] {
        let exposed = film.means().map(|mean| EXPOSURE * mean);
        draw(figures, way, RESOLUTION.0, exposed.collect())?;
        let entry = format!("\\nwmeasured{{learnt}}{{{way}}}");
        let (rays, error) = (rays as f64 / 1e6, film.summary().rmse);
        writeln!(out, "{entry}{{samples}}{{{samples}}}%")?;
        writeln!(out, "{entry}{{rays}}{{{rays:.1}}}%")?;
        writeln!(out, "{entry}{{error}}{{{error:.4}}}%")?;
    }
    Ok(out)
}

/// A scene with a camera in it.
struct Stage {
    scene: Scene,
    bvh: Bvh,
    camera: Camera,
    sky: Sky,
}

impl Stage {
    fn new(mesh: &Mesh, view: &View) -> Result<Self, Box<dyn Error>> {
        let scene = Scene::new(mesh);
        let bvh = Bvh::new(&scene)?;
        let aspect = f64::from(RESOLUTION.0) / f64::from(RESOLUTION.1);
        let camera = Camera::new(view, aspect)?;
        Ok(Self { scene, bvh, camera, sky: Sky::new(view.up) })
    }

    fn gather(&self) -> Gather<'_> {
        Gather {
            scene: &self.scene,
            intersector: &self.bvh,
            camera: &self.camera,
            sky: self.sky,
            albedo: RHO,
            known: &KnownPixels::Nothing,
            seed: 0,
            training: TRAINING,
            correction: Some(Correction::default()),
            learnt: None,
        }
    }

    fn tracer<'a>(&'a self, cache: &'a RadianceCache) -> Tracer<'a, Bvh> {
        Tracer {
            scene: &self.scene,
            intersector: &self.bvh,
            camera: &self.camera,
            sky: self.sky,
            albedo: RHO,
            cache,
            rays: 0,
        }
    }

    /// Renders by paths of at least so many rays; samples and rays.
    fn trace(&self, rays: u64, film: &mut Film) -> (u64, u64) {
        let mut job = Job {
            scene: &self.scene,
            intersector: &self.bvh,
            camera: &self.camera,
            integrator: PathTracer { albedo: RHO, sky: self.sky },
            known: &KnownPixels::Nothing,
            sampler: IndependentSampler::new(1),
        };
        let (mut samples, mut traced) = (0, 0);
        while traced < rays {
            samples += 1;
            traced += job.pass(film, samples, &|_| true);
        }
        (samples, traced)
    }

    /// What the camera sees at the place.
    fn place(&self, cache: &RadianceCache) -> Option<Hit> {
        let [x, y] = PLACE;
        match self.tracer(cache).look(x, y) {
            End::Hit(hit) => Some(hit),
            End::Sky(_) => None,
        }
    }

    /// The values of the cells in the middles of the pixels.
    fn cached(&self, cache: &RadianceCache) -> Vec<f64> {
        let (width, height) = RESOLUTION;
        let mut tracer = self.tracer(cache);
        let value = |i: u32| {
            let x = (f64::from(i % width) + 0.5) / f64::from(width);
            let y = (f64::from(i / width) + 0.5) / f64::from(height);
            match tracer.look(x, y) {
                End::Sky(radiance) => radiance,
                End::Hit(hit) => {
                    let name = cache.grid().name(hit.point, hit.normal);
                    f64::from(cache.at(name).value)
                }
            }
        };
        (0..width * height).map(value).collect()
    }

    /// The light that arrives at the place, over the square: what a ray
    /// meets there has the radiance that many more rays gather.
    fn light(&self, cache: &RadianceCache, place: &Hit) -> Vec<f64> {
        let middle = |i: u32| (2 * i + 1) << (31 - FINE.ilog2());
        let radiance = |i: u32| {
            let mut tracer = self.tracer(cache);
            let at = [i / FINE, i % FINE].map(middle);
            match tracer.shoot(place, None, at).end {
                End::Sky(radiance) => radiance,
                End::Hit(hit) => gathered(&mut tracer, &hit, u64::from(i)),
            }
        };
        let square = (0..FINE * FINE).into_par_iter();
        square.map(radiance).collect()
    }
}

/// The radiance that leaves a hit, from many rays into the cache; by the
/// number of a stream.
fn gathered(tracer: &mut Tracer<Bvh>, hit: &Hit, stream: u64) -> f64 {
    let cache = tracer.cache;
    let name = cache.grid().name(hit.point, hit.normal);
    let guide = cache.guide(cache.at(name));
    let net = ScrambledNet::new(u64::from(GATHERED));
    let mut random = generator(2, stream, 0);
    let key = scramble_key(2, stream, 0);
    let mut sum = 0.;
    for n in 0..GATHERED {
        let shot = tracer.shoot(hit, guide, net.pair(key, n, 0));
        let arriving = match shot.end {
            End::Sky(radiance) => radiance,
            End::Hit(hit) => {
                let near = [random.random(), random.random()];
                f64::from(tracer.near(&hit, near).value)
            }
        };
        sum += shot.weight * arriving;
    }
    RHO * sum / f64::from(GATHERED)
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

/// The density of each bin, in units of the largest.
fn density(guide: &Guide) -> Vec<f64> {
    let all: Vec<f64> = (0..BINS).map(|b| guide.density(b)).collect();
    let most = all.iter().copied().fold(0., f64::max);
    all.iter().map(|d| d / most).collect()
}

/// Writes a picture of values in [0, 1].
fn draw(figures: &Path, name: &str, width: u32, means: Vec<f64>) -> Done {
    let path = figures.join(format!("learnt-{name}.png"));
    let height = means.len() as u32 / width;
    let (errors, samples, attributes) = (None, None, BTreeMap::new());
    let image = Image { width, height, means, errors, samples, attributes };
    Ok(Format::Png.write(&image, &mut File::create(path)?)?)
}
