// Compares where the numbers of later reflections come from, by the variance
// and the time of plain paths: "make measure" records it for the chapter
// "Quasi-Monte Carlo".
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;

use glam::DVec3;
use litpt::film::Film;
use litpt::render::{Job, Renderer};
use litpt::sampler::sobol::{
    ScrambledNet, SobolSampler, scramble_key, to_unit,
};
use litpt::sampler::{IndependentSampler, Sampler, dimension};
use litpt_book::closed_forms::{Setting, cavity, look};
use litpt_book::courtyard;

use super::Done;

const RESOLUTION: (u32, u32) = (48, 36);

/// Samples of a pixel, whatever the size of a net.
const SAMPLES: u64 = 512;

/// Renders of each kind, in turn; the shortest time counts.
const ROUNDS: u64 = 3;

/// A way to place samples.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// As the sampler does it: independent numbers after the first direction.
    Ours,
    /// A net for each later direction, in an order of its own.
    Pairs,
    /// A net for each two later directions, in an order of its own.
    Fours,
    /// The first dimensions of Sobol, and independent numbers.
    JoeKuo,
}

#[derive(Clone)]
struct Placed {
    way: Way,
    ours: SobolSampler,
    net: ScrambledNet,
    columns: [[u32; 32]; 4],
    seed: u64,
    replicate: u64,
    key: u64,
    i: u32,
}

impl Placed {
    fn new(way: Way, seed: u64, replicate: u64) -> Self {
        let ours = SobolSampler::new(seed, replicate);
        let net = ScrambledNet::new(replicate);
        let columns = joe_kuo();
        Self { way, ours, net, columns, seed, replicate, key: 0, i: 0 }
    }

    /// The pair of a later direction, of a net with its own scramble and its
    /// own order of points (Burley 2020, section 3).
    #[inline(always)]
    fn padded(&self, net: u64, pair: usize) -> [f64; 2] {
        let log = self.replicate.ilog2();
        let order = scramble_key(self.key, net, 0);
        // The first coordinate of a point is its number, reversed.
        let [x, _] = self.net.pair(order, self.i, 0);
        let i = x.reverse_bits() & ((1 << log) - 1);
        let key = scramble_key(self.key, net, 1);
        self.net.pair(key, i, pair).map(to_unit)
    }

    /// A pair of Sobol's points with a random bit for each node.
    fn sobol(&self, pair: usize) -> [u32; 2] {
        [2 * pair, 2 * pair + 1].map(|d| {
            let bit = |x, b: u32| match self.i >> b & 1 {
                0 => x,
                _ => x ^ self.columns[d][b as usize],
            };
            let x = (0..32).fold(0, bit);
            let flip = |level: u32| {
                let node = 1 << level | u64::from(x) >> (32 - level);
                (scramble_key(self.key, d as u64, node) >> 63) as u32
            };
            (0..32).fold(x, |y, level| y ^ flip(level) << (31 - level))
        })
    }
}

impl Sampler for Placed {
    fn replicate(&self) -> u64 {
        self.replicate
    }

    #[inline(always)]
    fn start(&self, pixel: u64, index: u64) -> Self {
        let ours = self.ours.start(pixel, index);
        let (scramble, i) =
            (index / self.replicate, index % self.replicate);
        let key = scramble_key(self.seed, pixel, scramble);
        Self { ours, key, i: i as u32, ..*self }
    }

    #[inline(always)]
    fn get_pixel_2d(&mut self) -> [u32; 2] {
        match self.way {
            Way::JoeKuo => self.sobol(0),
            _ => self.ours.get_pixel_2d(),
        }
    }

    #[inline(always)]
    fn get_1d(&mut self, dimension: u64) -> f64 {
        self.ours.get_1d(dimension)
    }

    #[inline(always)]
    fn get_2d(&mut self, dimension: u64) -> [f64; 2] {
        let bounce = (dimension - dimension::direction(0)) / 3;
        match (self.way, bounce) {
            (Way::JoeKuo, 0) => self.sobol(1).map(to_unit),
            (Way::Ours | Way::JoeKuo, _) | (_, 0) => {
                self.ours.get_2d(dimension)
            }
            (Way::Pairs, n) => self.padded(n, 0),
            (Way::Fours, n) => {
                self.padded(n.div_ceil(2), (n + 1) as usize % 2)
            }
        }
    }
}

/// Four dimensions of Sobol's sequence, with the direction numbers of Joe and
/// Kuo 2008: the degree of each polynomial, its inner coefficients, and the
/// first direction numbers.
fn joe_kuo() -> [[u32; 32]; 4] {
    let table: [(usize, u32, &[u32]); 3] =
        [(1, 0, &[1]), (2, 1, &[1, 3]), (3, 1, &[1, 3, 1])];
    let mut columns = [[0; 32]; 4];
    columns[0] = std::array::from_fn(|i| 1 << (31 - i));
    for (own, (s, a, m)) in columns[1..].iter_mut().zip(table) {
        for i in 0..32 {
            own[i] = if i < s {
                m[i] << (31 - i)
            } else {
                let inner = |j| (a >> (s - 1 - j) & 1) * own[i - j];
                let term = |x, j| x ^ inner(j);
                (1..s).fold(own[i - s] ^ own[i - s] >> s, term)
            };
        }
    }
    columns
}

/// What a way gives in a scene.
#[derive(Clone, Copy)]
struct Measured {
    mean: f64,
    /// Of the mean of a replicate, times its samples: the mean over the
    /// pixels.
    variance: f64,
    seconds: f64,
}

fn measure<S: Sampler>(setting: &Setting, sampler: S) -> Measured {
    let (width, height) = RESOLUTION;
    let Job { scene, intersector, camera, integrator, known, .. } =
        setting.job(0);
    let replicate = sampler.replicate();
    let mut film = Film::new(width, height).with_replicates(replicate);
    let mut job =
        Job { scene, intersector, camera, integrator, known, sampler };
    let start = processor_time();
    job.pass(&mut film, SAMPLES, &|_| true);
    let seconds = processor_time() - start;
    let pixels = f64::from(width * height);
    let mean = film.means().sum::<f64>() / pixels;
    let variance = film.rows().map(|p| p.variance()).sum::<f64>() / pixels;
    Measured { mean, variance: variance * replicate as f64, seconds }
}

/// The time that processors have spent on this process, in ticks of the
/// system (fields 14 and 15 of proc(5)): it depends less than the time of the
/// day on what else the machine does.
fn processor_time() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat");
    let stat = stat.unwrap_or_default();
    let fields = stat.rsplit(") ").next().unwrap_or_default();
    let ticks = fields.split(' ').skip(11).take(2);
    ticks.map(|t| t.parse().unwrap_or(f64::NAN)).sum()
}

/// Joins what several renders gave: of another seed each.
fn best(render: &dyn Fn(u64) -> Measured) -> Measured {
    let all: Vec<_> = (0..ROUNDS).map(render).collect();
    let average = |of: fn(&Measured) -> f64| {
        all.iter().map(of).sum::<f64>() / ROUNDS as f64
    };
    Measured {
        mean: average(|m| m.mean),
        variance: average(|m| m.variance),
        seconds: all.iter().fold(f64::MAX, |best, m| best.min(m.seconds)),
    }
}

pub fn run(_: &[String]) -> Done {
    println!("scene,way,points,mean,variance,time,efficiency");
    for (name, setting) in settings()? {
        let plain =
            best(&|seed| measure(&setting, IndependentSampler::new(seed)));
        println!("{name},independent,1,{:.4},1.00,1.00,1.00", plain.mean);
        for replicate in [16, 64] {
            for (what, way) in [
                ("net; then independent", Way::Ours),
                ("net; then pairs", Way::Pairs),
                ("net; then nets", Way::Fours),
                ("Sobol; then independent", Way::JoeKuo),
            ] {
                let found = best(&|seed| match way {
                    Way::Ours => {
                        let sampler = SobolSampler::new(seed, replicate);
                        measure(&setting, sampler)
                    }
                    way => {
                        let sampler = Placed::new(way, seed, replicate);
                        measure(&setting, sampler)
                    }
                });
                let variance = plain.variance / found.variance;
                let time = found.seconds / plain.seconds;
                print!(
                    ",{what},{replicate},{:.4},{variance:.2}",
                    found.mean
                );
                match way {
                    // Not made to be fast.
                    Way::JoeKuo => println!(",--,--"),
                    _ => println!(",{time:.2},{:.2}", variance / time),
                }
            }
        }
    }
    Ok(())
}

/// Scenes with little and with much light of later reflections.
fn settings() -> Result<Vec<(String, Setting)>, Box<dyn Error>> {
    let mut settings = vec![];
    let aspect = 4. / 3.;
    for rho in [0.5, 0.8] {
        let setting = Setting::new(
            &courtyard::mesh(),
            (rho, DVec3::Y),
            &courtyard::view(),
            aspect,
        )?;
        settings.push((format!("courtyard; $\\rho={rho}$"), setting));
    }
    let down = look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 20.);
    for (f, rho) in [(0.5, 0.5), (0.2, 0.9)] {
        let setting =
            Setting::new(&cavity(f, 64), (rho, DVec3::Z), &down, aspect)?;
        settings.push((format!("cavity; $f={f}$; $\\rho={rho}$"), setting));
    }
    Ok(settings)
}
