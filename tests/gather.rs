// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Gathering (chapters "Guiding" to "Training"): guides, the cache and its
//! names, caches that lie, the errors that a gather states, and the command.

use crate::prelude::*;

use crate::answers_light::scrambles;
use crate::sampler::{assert_cosine, normals};

use litpt::integrator::gather::guide::{
    BINS, Guide, SIDE, bin, direction, main_axis,
};
use litpt_book::settings;
use statrs::distribution::{ChiSquared, ContinuousCDF};

// ------------------------------------------------------------------- Guides

/// Part of the probability that is spread over all bins.
const DEFENCE: f64 = 0.12;

/// Intervals begin at multiples of 2^-16, so that each is off by less than one
/// of them; a tenth is for sums in single precision.
fn rounded(interval: f64) -> f64 {
    1.1 / 65536. / interval
}

/// Histograms of one bin, of a row, of a column, and at random.
fn histograms() -> Vec<[f32; BINS]> {
    let mut random = generator(1, 2, 3);
    let at = |f: &mut dyn FnMut(usize, usize) -> f32| {
        std::array::from_fn(|b| f(b / SIDE, b % SIDE))
    };
    let last = SIDE - 1;
    vec![
        [1.; BINS],
        at(&mut |i, j| f32::from(i == 0 && j == 0)),
        at(&mut |i, j| f32::from(i == last && j == last)),
        at(&mut |i, _| f32::from(i == 5)),
        at(&mut |_, j| f32::from(j == 9)),
        at(&mut |_, _| random.random()),
        at(&mut |_, _| random.random::<f32>().powi(20) * 1e30),
        at(&mut |i, j| 1e-30 * (i * j) as f32),
    ]
}

fn guides() -> impl Iterator<Item = Guide> {
    histograms().into_iter().map(|bins| Guide::new(&bins).unwrap())
}

#[test]
fn the_density_of_a_guide_is_one_on_average_and_bounded_below() {
    for (guide, bins) in guides().zip(histograms()) {
        let all = (0..BINS).map(|b| guide.density(b));
        let mean = all.sum::<f64>() / BINS as f64;
        assert!((mean - 1.).abs() < 1e-12, "{mean}");
        let sum: f64 = bins.iter().map(|&b| f64::from(b)).sum();
        let part = |b: usize| {
            let share = f64::from(bins[b]) / sum;
            DEFENCE / BINS as f64 + (1. - DEFENCE) * share
        };
        for b in 0..BINS {
            let first = b / SIDE * SIDE;
            let row: f64 = (first..first + SIDE).map(part).sum();
            let error = rounded(row) + rounded(part(b) / row);
            let off = guide.density(b) / part(b) / BINS as f64 - 1.;
            assert!(off.abs() < error, "{b}: {off} {error}");
            // A column has at least 0.12/256 of a row, which has at most 1.
            let error = rounded(DEFENCE / 16.) + rounded(DEFENCE / 256.);
            assert!(1. / guide.density(b) < (1. + error) / DEFENCE);
        }
    }
}

#[test]
fn a_histogram_without_light_is_no_guide() {
    let with = |b: f32| {
        let mut bins = [0f32; BINS];
        bins[77] = b;
        bins
    };
    for b in [0., f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert!(Guide::new(&with(b)).is_none(), "{b}");
    }
    assert!(Guide::new(&[f32::MAX; BINS]).is_none());
    assert!(Guide::new(&with(f32::MIN_POSITIVE)).is_some());
}

// Four cells of each bin: the points are uniform within it.
#[test]
fn a_guide_sends_points_into_its_bins_in_proportion_to_their_density() {
    let chance = &mut Chance::default();
    const N: u32 = 1 << 17;
    for (g, guide) in (0..).zip(guides()) {
        let mut random = generator(4, g, 0);
        let mut cells = vec![0; 4 * BINS];
        for _ in 0..N {
            let u = [random.random(), random.random()];
            let (point, b) = guide.warp(u);
            assert_eq!(b, bin(point));
            let [u, v] = point.map(|u| {
                assert!((0. ..1.).contains(&u));
                (2. * SIDE as f64 * u) as usize % 2
            });
            cells[4 * b + 2 * u + v] += 1;
        }
        let part = |c: usize| guide.density(c / 4) / (4 * BINS) as f64;
        chance.distributed(&cells, part, &format!("guide {g}"));
    }
}

// 256 points of a net have one in each interval of 2^-8. An interval of
// another length contains whole ones and two that it cuts.
#[test]
fn the_points_of_a_net_remain_stratified_in_the_rows_of_a_guide() {
    let net = ScrambledNet::new(BINS as u64);
    for (g, guide) in (0..).zip(guides()) {
        let row = |i: usize| -> f64 {
            let bins = i * SIDE..(i + 1) * SIDE;
            bins.map(|b| guide.density(b)).sum()
        };
        for (scramble, pair) in (0..20).flat_map(|s| [(s, 0), (s, 1)]) {
            let key = scramble_key(1, g, scramble);
            let mut rows = [0f64; SIDE];
            for i in 0..BINS as u32 {
                let (_, bin) = guide.warp(net.pair(key, i, pair));
                rows[bin / SIDE] += 1.;
            }
            for (i, count) in rows.iter().enumerate() {
                let excess = count - row(i);
                assert!(excess.abs() < 2., "row {i} of {g}: {excess}");
            }
        }
    }
}

#[test]
fn directions_of_the_square_are_those_of_the_hemisphere() {
    let mut random = generator(6, 0, 0);
    for normal in normals() {
        // The middle of each bin, corners as near as rounding allows, and
        // points at random.
        for b in 0..BINS {
            for at in [0.5, 1e-9, 1. - 1e-9, random.random()] {
                let other = random.random::<f64>().clamp(1e-9, 1. - 1e-9);
                let [u, v] = [(b / SIDE, at), (b % SIDE, other)]
                    .map(|(i, u)| (i as f64 + u) / SIDE as f64);
                let d = direction(normal, [u, v]);
                assert!((d.length() - 1.).abs() < 1e-14, "{normal}");
                assert!(d.dot(normal) > -1e-15, "{normal} {u} {v}");
                assert_eq!(bin([u, v]), b);
            }
        }
        // The middle of the square is the normal, and its edge the horizon.
        assert!(direction(normal, [0.5, 0.5]).distance(normal) < 1e-15);
        let edge = direction(normal, [random.random(), 0.]);
        assert!(edge.dot(normal).abs() < 1e-15);
    }
}

#[test]
fn uniform_points_become_directions_of_cosine_density() {
    let chance = &mut Chance::default();
    let all = normals();
    for normal in all.iter().step_by(all.len() / 16) {
        let mut random = generator(7, 0, 0);
        assert_cosine(chance, *normal, 1 << 16, || {
            direction(*normal, random.random())
        });
    }
}

// The derivative of a normalised tangent: that of the vector, at most 2, over
// its length, at least 1/sqrt(2); twice, for the bitangent turns with both.
#[test]
fn directions_turn_smoothly_while_the_main_axis_remains() {
    let mut random = generator(8, 0, 0);
    for normal in normals() {
        let near = normal + 5e-5 * in_cube(&mut random);
        let near = near.normalize();
        if main_axis(normal) != main_axis(near) {
            continue;
        }
        for _ in 0..20 {
            let s = random.random();
            let step = direction(normal, s).distance(direction(near, s));
            assert!(step < 8. * near.distance(normal), "{normal}: {step}");
        }
    }
}

// ---------------------------------------------------------------- The cache

/// The side of the cubes around a centre, which is a corner of cubes: the
/// smallest that leads from one to the next.
fn side_around(grid: &Grid, centre: f64) -> f64 {
    let name = |x: f64| grid.name(DVec3::splat(centre + x), DVec3::Z);
    let mut sides = (-60..60).map(|k: i32| 2f64.powi(k));
    sides.find(|&side| name(side) != name(0.)).unwrap()
}

/// Points spread evenly over a length along one axis.
fn along(axis: usize, length: f64) -> Vec<DVec3> {
    let at = |i: i32| length * (f64::from(i) / 1000. - 0.5);
    (0..=1000).map(|i| at(i) * DVec3::AXES[axis]).collect()
}

#[test]
fn the_side_of_the_cubes_follows_from_the_spread_of_the_points() {
    let of = |points: &[DVec3]| side_around(&Grid::around(points), 0.);
    assert_eq!(of(&[]), 1.);
    for (x, count) in [(77., 1), (-1e3, 5000)] {
        let grid = Grid::around(&vec![DVec3::splat(x); count]);
        assert_eq!(side_around(&grid, x), 1.);
    }
    for axis in 0..3 {
        // 98 % of 640 are 627.2, a 64th of which is 9.8.
        assert_eq!(of(&along(axis, 640.)), 8.);
        assert_eq!(of(&along(axis, 2. * 64. / 0.98 + 1e-6)), 2.);
        // 2^23 and 2^-36 are the powers below 0.98 of 1e9 / 64, 1e-9 / 64.
        assert_eq!(of(&along(axis, 1e9)), 2f64.powi(23));
        assert_eq!(of(&along(axis, 1e-9)), 2f64.powi(-36));
    }
    // One percent far away on either side changes nothing.
    let mut far = along(1, 640.);
    far.extend([DVec3::splat(1e300), DVec3::splat(-1e300)]);
    assert_eq!(of(&far), 8.);
}

/// Normals whose main axis is clear or tied.
fn six_and_ties() -> Vec<DVec3> {
    let axes = DVec3::AXES.into_iter().flat_map(|a| [a, -a]);
    let ties = [(1., 1., 0.), (1., 0., -1.), (0., -1., 1.), (-1., 1., 1.)];
    let ties = ties.map(|(x, y, z)| DVec3::new(x, y, z));
    let near = ties.map(|n| n + DVec3::new(1e-16, -2e-16, 3e-16));
    axes.chain(ties).chain(near).map(DVec3::normalize).collect()
}

#[test]
fn the_names_of_coarser_cells_nest() {
    let grid = Grid::around(&along(0, 640.));
    let (side, mut random) = (side_around(&grid, 0.), generator(9, 0, 0));
    let cube = |p: DVec3, level: usize| {
        let side = side * f64::from(1 << level);
        (p / side).floor().to_array()
    };
    let class = |n: DVec3| (main_axis(n), n[main_axis(n)] > 0.);
    let normals = six_and_ties();
    for i in 0..20_000 {
        let p = 100. * in_cube(&mut random);
        let reach = 2. * side * f64::from(1 << (i % LEVELS));
        let q = p + reach * in_cube(&mut random);
        let mut any = || normals[random.random_range(0..normals.len())];
        let (n, m) = (any(), any());
        for level in 0..LEVELS {
            // Three bits fewer for each level; the class is above them.
            let name = |p, n| grid.name(p, n) >> (3 * level);
            let same = cube(p, level) == cube(q, level);
            assert_eq!(name(p, n) == name(q, n), same);
            let alike = same && class(n) == class(m);
            assert_eq!(name(p, n) == name(q, m), alike);
        }
    }
}

/// The finest cell there is at a place.
fn at(cache: &RadianceCache, p: DVec3, normal: DVec3) -> Cell {
    *cache.at(cache.grid.name(p, normal))
}

/// A record of a value that one cell has from another.
pub fn record(from: u64, to: u64, weight: f32) -> Record {
    Record { from, to, weight, bin: 0, relative_albedo: WHOLE }
}

#[test]
fn a_place_without_records_has_the_cell_of_the_next_level() {
    let grid = Grid::around(&along(0, 640.));
    let (side, mut random) = (side_around(&grid, 0.), generator(10, 0, 0));
    let p = DVec3::new(3., 4., 5.);
    let mut records = vec![record(grid.name(p, DVec3::Z), SKY, 0.5); 20];
    let cache =
        RadianceCache::empty(grid).learn(&mut records, 0.8, &|_| true);
    for _ in 0..1000 {
        let q = p + 20. * side * in_cube(&mut random);
        let level = (0..LEVELS).find(|level| {
            let side = side * f64::from(1 << level);
            (p / side).floor() == (q / side).floor()
        });
        let found = f64::from(at(&cache, q, DVec3::Z).value);
        let expected = if level.is_some() { 0.4 } else { 0. };
        assert!((found - expected).abs() < 1e-6, "{level:?}: {found}");
        assert_eq!(at(&cache, q, -DVec3::Z).value, 0.);
    }
}

/// The names of the four cells around a place, in the plane across the main
/// axis of the normal, with their bilinear weights from the distances to
/// their centres.
fn around(grid: &Grid, p: DVec3, normal: DVec3) -> BTreeMap<u64, f64> {
    let side = side_around(grid, 0.);
    let centres = p / side - 0.5;
    let (low, part) = (centres.floor(), centres - centres.floor());
    let a = (main_axis(normal) + 1) % 3;
    let b = (main_axis(normal) + 2) % 3;
    let mut weights = BTreeMap::new();
    for (i, j) in [(0., 0.), (0., 1.), (1., 0.), (1., 1.)] {
        let mut q = p;
        q[a] = (low[a] + i + 0.5) * side;
        q[b] = (low[b] + j + 0.5) * side;
        let weight =
            (1. - (i - part[a]).abs()) * (1. - (j - part[b]).abs());
        *weights.entry(grid.name(q, normal)).or_default() += weight;
    }
    weights.retain(|_, weight| *weight > 0.);
    weights
}

// The middles of 64 by 64 squares give each of the four cells exactly its
// weight, where the point divides the cube in 64ths.
#[test]
fn a_cell_nearby_is_drawn_with_its_bilinear_weight() {
    const PARTS: i32 = 64;
    let grid = Grid::around(&along(0, 640.));
    let (side, mut random) = (side_around(&grid, 0.), generator(14, 0, 0));
    for normal in six_and_ties() {
        for i in 0..100 {
            let mut place = || match i {
                // A corner of cubes, and the centre of one.
                0 => 0.,
                1 => f64::from(PARTS / 2),
                _ => f64::from(random.random_range(-PARTS..PARTS)),
            };
            let cubes = DVec3::new(place(), place(), place());
            let p = cubes / f64::from(PARTS) * side;
            let middle = |k: i32| (f64::from(k) + 0.5) / f64::from(PARTS);
            let mut weights = BTreeMap::new();
            for cell in 0..PARTS * PARTS {
                let u = [cell / PARTS, cell % PARTS].map(middle);
                let name = grid.name_around(p, normal, u);
                *weights.entry(name).or_default() +=
                    1. / f64::from(PARTS * PARTS);
            }
            assert_eq!(weights, around(&grid, p, normal), "{normal} {p}");
        }
    }
}

// ------------------------------------------------------------ Lying caches

/// A scene with a camera, to be rendered by any method.
struct Stage {
    setting: Setting,
    resolution: (u32, u32),
}

impl Stage {
    fn new(mesh: &Mesh, view: &View, resolution: (u32, u32)) -> Self {
        let aspect = f64::from(resolution.0) / f64::from(resolution.1);
        let setting = Setting::new(mesh, (0.8, DVec3::Z), view, aspect);
        Self { setting: setting.unwrap(), resolution }
    }

    /// Inside a sphere that is open at the top, where all that is seen has
    /// the same radiance; and that radiance.
    fn cavity(resolution: (u32, u32)) -> (Self, f64) {
        let view = look(DVec3::ZERO, DVec3::new(0.3, 0.2, -1.), 60.);
        let stage = Self::new(&cavity(0.2, 128), &view, resolution);
        (stage, cavity_radiance(0.8, 0.2))
    }

    /// The same sphere, of which one half is darker.
    fn halves(resolution: (u32, u32)) -> Self {
        let mesh = cavity(0.2, 128);
        let mark = |(face, corners): (u32, &[u32; 3])| {
            let x = corners.map(|i| mesh.vertices[i as usize].x);
            let is_dark = x.iter().sum::<f64>() > 0.3;
            let name = if is_dark { "dark" } else { "light" }.to_owned();
            Mark { face, kind: MarkKind::Material, name }
        };
        let marks: Vec<_> = (0..).zip(&mesh.triangles).map(mark).collect();
        let named_albedos = vec![("dark".to_owned(), 0.2)];
        let named = Named { named_albedos, ..Named::default() };
        let albedos = FaceAlbedos::new(&marks, &named, 0.8).unwrap();
        let (Self { setting, .. }, _) = Self::cavity(resolution);
        let setting = setting.painted(&albedos).unwrap();
        Self { setting, resolution }
    }

    /// A room with a block in it, and a window.
    fn room(resolution: (u32, u32)) -> Self {
        let setting = settings::named("room with a window");
        assert_eq!(setting.rho, 0.8);
        Self::new(&setting.mesh, &setting.view, resolution)
    }

    /// Furrows between upright plates, from above: what one furrow sees, its
    /// neighbours do not.
    fn furrows(resolution: (u32, u32)) -> Self {
        let v = DVec3::new;
        let plate = |a: DVec3, b: DVec3| {
            let [c, d] = [b, a].map(|p| p + 16. * DVec3::Y);
            [[a, b, c], [a, c, d]]
        };
        let upright = |x| plate(v(x, -8., 0.), v(x, -8., 1.5));
        let plates = (-8..=8).map(|x| upright(f64::from(x)));
        let floor = [plate(v(-8., -8., 0.), v(8., -8., 0.))];
        let mesh = apart(floor.into_iter().chain(plates).flatten());
        let view = look(v(0.4, -1., 9.), DVec3::ZERO, 50.);
        Self::new(&mesh, &view, resolution)
    }

    /// A renderer that has learnt nothing yet.
    fn gather(&self, seed: u64) -> Gather<'_> {
        Gather { seed, ..self.setting.gather(self.resolution) }
    }

    /// Points of its surfaces, with their normals, as paths meet them.
    fn surface(&self, count: usize) -> Vec<(DVec3, DVec3)> {
        let cache = &RadianceCache::empty(Grid::around(&[]));
        let (gather, allocation) = (&self.gather(0), &even(&self.film(1)));
        let mut tracer = tracer(gather, cache, allocation);
        let mut random = generator(20, 0, 0);
        let mut points = vec![];
        while points.len() < count {
            let [x, y]: [f64; 2] = random.random();
            let first = tracer.trace_primary(x, y);
            let mut end = first.map_or(End::Sky(1.), End::Hit);
            while let End::Hit(hit) = end {
                points.push((hit.point, hit.normal));
                let u = [random.random(), random.random()];
                end = tracer.trace_gather_ray(&hit, None, u).end;
            }
        }
        points
    }
}

fn even(film: &Film) -> Allocation {
    Allocation::even(film.window, 1)
}

/// A cache of what somebody says. The cells of a part of its surfaces have
/// so many records of the value that `tell` gives; a tenth of them goes to the
/// sky, in some directions of all, so that its guides point there.
fn lie(
    stage: &Stage,
    part: f64,
    mut tell: impl FnMut(&mut Pcg64) -> f32,
) -> RadianceCache {
    const RECORDS: u16 = 20;
    let surface = stage.surface(20_000);
    let points: Vec<_> = surface.iter().map(|(p, _)| *p).collect();
    let grid = Grid::around(&points);
    let mut names: Vec<_> =
        surface.iter().map(|&(p, n)| grid.name(p, n)).collect();
    names.sort_unstable();
    names.dedup();
    let (mut random, mut records) = (generator(22, 0, 0), vec![]);
    for from in names {
        if random.random::<f64>() >= part {
            continue;
        }
        let weight = 10. * tell(&mut random);
        for i in 0..RECORDS {
            let [row, column] = [0; 2].map(|_| random.random_range(0..4));
            let bin = 66 + 16 * row + column;
            let sky = Record { bin, ..record(from, SKY, weight) };
            let bin = random.random_range(0..BINS as u16);
            let dark = Record { bin, ..record(from, DARKNESS, 1.) };
            records.push(if i % 10 == 0 { sky } else { dark });
        }
    }
    RadianceCache::empty(grid).learn(&mut records, 1., &|_| true)
}

/// The lies, by name: about the radiance, and where there is none.
fn lies(stage: &Stage) -> Vec<(&'static str, RadianceCache)> {
    vec![
        ("empty", RadianceCache::empty(Grid::around(&[]))),
        ("zero", lie(stage, 1., |_| 0.)),
        ("ten times", lie(stage, 1., |_| 4.)),
        ("negative", lie(stage, 1., |_| -2.)),
        ("random", lie(stage, 0.7, |r| 6. * r.random::<f32>() - 2.)),
    ]
}

/// Pixels of one tile, as many as the comparisons allow for.
const FEW: (u32, u32) = (6, 4);

/// Few rays for each correction, and many corrections.
const FRUGAL: Correction =
    Correction { group: 3, step: 1., gathers: 4, paths: 2, branches: 2 };

/// The mean of each pixel over 300 scrambles, and that of the image.
fn gathered(
    stage: &Stage,
    cache: &RadianceCache,
    correction: Option<Correction>,
) -> (Vec<Accumulator>, Accumulator) {
    let window = stage.film(1).window;
    let area = window.area();
    // Pixels have 1, 2, 3, 5 samples.
    let counts = (0..area).map(|i| [1, 2, 3, 5][i % 4]).collect();
    let scale = (0..area).map(|i| [0.1, 1., 3.][i % 3]).collect();
    let allocation = &Allocation::new(window, counts, scale);
    let gather = &Gather { correction, ..stage.gather(23) };
    let tracer = tracer(gather, cache, allocation);
    let (pixels, whole, _) = scrambles(tracer, 300);
    (pixels, whole)
}

fn z(found: &Accumulator, (truth, error): (f64, f64)) -> f64 {
    (found.mean() - truth) / found.standard_error().hypot(error)
}

/// Demands that all lies leave the pixels of a scene and their mean as they
/// are, given with their errors; and that they do not without a correction.
#[track_caller]
fn assert_unmoved(stage: &Stage, truth: &Truth) {
    let &Truth { ref pixels, mean } = truth;
    let chance = &mut Chance::default();
    for (name, cache) in lies(stage) {
        let (found, whole) = gathered(stage, &cache, Some(FRUGAL));
        chance.normal(z(&whole, mean), &format!("{name}, the mean"));
        for (i, (found, &truth)) in found.iter().zip(pixels).enumerate() {
            chance.normal(z(found, truth), &format!("{name}, pixel {i}"));
        }
        let (_, believed) = gathered(stage, &cache, None);
        let z = z(&believed, mean);
        assert!(z.abs() > 30., "{name} is believed: z = {z}");
    }
}

#[test]
fn a_lying_cache_does_not_change_the_mean() {
    let (cavity, exact) = Stage::cavity(FEW);
    let pixels = vec![(exact, 0.); (FEW.0 * FEW.1) as usize];
    assert_unmoved(&cavity, &Truth { pixels, mean: (exact, 0.) });
    for stage in [Stage::halves(FEW), Stage::furrows(FEW)] {
        assert_unmoved(&stage, &Truth::of(&stage));
    }
}

// ------------------------------------------------------------ Honest errors

impl Stage {
    /// A film without a sample.
    fn film(&self, replicate: u64) -> Film {
        let (width, height) = self.resolution;
        let film = Film::new(width, height).with_net_size(replicate);
        film.with_shared_tiles()
    }

    /// An image of so many samples, in scrambles of `replicate`.
    fn image(&self, seed: u64, replicate: u64, samples: u64) -> Film {
        let mut film = self.film(replicate);
        self.gather(seed).pass(&mut film, samples, &|_| true);
        film
    }
}

/// Without corrections the halves of a picture have caches of their own, which
/// know different things of the same scene; with corrections they share one.
#[test]
fn the_halves_of_a_glance_have_caches_of_their_own() {
    let stage = Stage::room((32, 24));
    for correction in [None, Some(Correction::default())] {
        let mut gather = Gather { correction, ..stage.gather(5) };
        gather.learn(&mut stage.film(3), &|_| true);
        let learnt = gather.learnt.get().unwrap();
        let Some(twin) = &learnt.twin else {
            assert!(correction.is_some());
            continue;
        };
        assert!(correction.is_none() && *twin != learnt.cache);
        // Even scrambles take one, and odd ones the other.
        let mean = |own: &Arc<RadianceCache>, twin: Option<_>| {
            let allocation = learnt.allocation.clone();
            let (cache, pilot) = (own.clone(), vec![]);
            let known = Learnt { cache, allocation, twin, pilot };
            let learnt = Arc::new(known.into());
            let mut gather =
                Gather { correction, learnt, ..stage.gather(5) };
            let mut film = stage.film(3);
            gather.pass(&mut film, 6, &|_| true);
            film.means().sum::<f64>()
        };
        let both = mean(&learnt.cache, Some(twin.clone()));
        let each = [&learnt.cache, twin].map(|cache| mean(cache, None));
        assert!(each.iter().all(|one| *one != both));
    }
}

// ------------------------------------------------------ Stops while it learns

// The scout, the rounds of training, the solution, the pilot and the
// allocation ask whether to go on. A thread traces no more than a batch of
// 64 paths, with eight rays each, or a scramble of a tile, afterwards.
#[test]
fn few_rays_are_traced_after_learning_is_told_to_stop() {
    let stage = Stage::room((32, 24));
    let mut film = stage.film(4);
    let looks = AtomicU64::new(0);
    let count = |_| looks.fetch_add(1, Relaxed) < u64::MAX;
    stage.gather(3).learn(&mut film, &count);
    // The allocation looks once for each row, and before it the pilot.
    let last = [45, 35, 10].map(|more| looks.load(Relaxed) - more);
    let mut stops = 0;
    let calls = [0, 1, 2, 5, 40, 200, 1000, u64::MAX];
    for calls in calls.into_iter().chain(last) {
        let mut gather = stage.gather(3);
        let (left, late) = (AtomicU64::new(calls), AtomicU64::new(0));
        let watch = |rays| {
            let less = |n: u64| n.checked_sub(1);
            let goes_on = left.fetch_update(Relaxed, Relaxed, less).is_ok();
            late.fetch_add(if goes_on { 0 } else { rays }, Relaxed);
            goes_on
        };
        let rays = gather.learn(&mut film, &watch);
        let late = late.load(Relaxed);
        let threads = rayon::current_num_threads() as u64;
        let most = threads * (64 * 8 + 256 * 2);
        assert!(late <= most, "{late} after {calls}");
        let stopped = left.load(Relaxed) == 0;
        assert_eq!(gather.learnt.get().is_none(), stopped, "{calls}");
        assert_eq!(rays == 0, stopped);
        stops += u64::from(stopped);
    }
    assert!(stops > 7, "only {stops} stops come in time");
}

// A clock that a test moves: each look at it takes a millisecond.
#[test]
fn a_gather_ends_in_each_stage_by_the_clock_and_by_a_signal() {
    let stage = Stage::room((32, 24));
    let start = Instant::now();
    let mut reached = [0; 2];
    let looks = [3, 150, 1000, 3000];
    let ends = looks.map(|looks| [(looks, None), (looks, Some(15))]);
    for (looks, signal) in ends.into_iter().flatten() {
        let (ticks, interrupt) = (AtomicU64::new(0), Interrupt::default());
        let clock = || {
            let now = ticks.fetch_add(1, Relaxed);
            if let Some(signal) = signal.filter(|_| now == looks) {
                interrupt.cell().store(signal as usize, Relaxed);
            }
            start + Duration::from_millis(now)
        };
        let end = start + Duration::from_millis(looks + FIRST);
        let limits = Limits {
            deadline: Some(signal.map_or(end, |_| end + HOUR)),
            clock: Some(&clock),
            interrupt: Some(&interrupt),
            // One that only learns has not learnt either.
            samples: signal.filter(|_| looks < 200).map(|_| 0),
            ..Limits::default()
        };
        let (mut film, mut run) = (stage.film(4), Convergence::default());
        let gather = &mut stage.gather(3);
        let stop =
            run.run(gather, &mut film, &limits, &|_| (), &mut |_, _| ());
        assert_eq!(stop, signal.map_or(Stop::Time, Stop::Signal));
        // Each thread looks a few times more, and the loop itself.
        let more = ticks.load(Relaxed) - looks;
        assert!(more < FIRST + 200, "{more} looks after {looks}");
        let none = film.unsampled() == film.area();
        assert!(gather.learnt.get().is_some() || none);
        reached[usize::from(none)] += 1;
    }
    assert!(reached[0] >= 2 && reached[1] >= 4, "{reached:?}");
}

/// Milliseconds that a first sample has in any case, and an hour.
const FIRST: u64 = 100;
const HOUR: Duration = Duration::from_secs(3600);

// Where all rays of a tile miss the scene, none is traced.
#[test]
fn a_gather_traces_no_ray_in_a_tile_of_the_sky() {
    let stage = Stage::furrows((16, 16));
    let cache = RadianceCache::empty(Grid::around(&[]));
    let mut film = Film::new(16, 16);
    let (allocation, tile) = (even(&film), film.tiles()[0].tile);
    // A camera that looks along the horizon, away from all triangles.
    let from = 1e4 * DVec3::Z;
    let view = View { up: DVec3::Z, ..look(from, from + DVec3::X, 30.) };
    let camera = Camera::new(&view, 1.).unwrap();
    let Sensor::Camera(_, entrance) = stage.setting.job(0).sensor else {
        panic!("no camera")
    };
    let sensor = &Sensor::Camera(camera, *entrance);
    let gathered = |known: &KnownPixels| {
        let gather = stage.gather(5);
        let view = LitView { sensor, ..gather.view };
        let gather = Gather { known_pixels: known, view, ..gather };
        let mut tracer = tracer(&gather, &cache, &allocation);
        (tracer.tile(tile, 0).means, tracer.rays)
    };
    let (sky, job) = (Sky::new(DVec3::Z), stage.setting.job(0));
    let (place, bvh) = (entrance.place().unwrap(), job.intersector);
    let known =
        KnownPixels::background(&camera, &sky, (16, 16), place, bvh);
    assert_eq!(known.content((0, 0)), TileContent::Sky);
    let (values, rays) = gathered(&known);
    assert_eq!((values, rays), (gathered(KnownPixels::NOTHING).0, 0));
}

/// The radiance of pixels, and its standard error.
struct Truth {
    pixels: Vec<(f64, f64)>,
    mean: (f64, f64),
}

impl Truth {
    /// From 16384 paths of each pixel.
    fn of(stage: &Stage) -> Self {
        let mut film = Film::new(stage.resolution.0, stage.resolution.1);
        stage.setting.job(21).pass(&mut film, 1 << 14, &|_| true);
        let pixels = film.rows().map(|p| (p.mean(), p.standard_error()));
        let (pixels, summary) = (pixels.collect(), film.summary());
        Self { pixels, mean: (summary.mean, summary.mean_stderr) }
    }
}

/// A room of four tiles.
fn room() -> &'static (Stage, Truth) {
    static ROOM: OnceLock<(Stage, Truth)> = OnceLock::new();
    ROOM.get_or_init(|| {
        let stage = Stage::room((32, 24));
        let truth = Truth::of(&stage);
        (stage, truth)
    })
}

/// The mean square of the errors of pixels, over what it should be.
fn honesty(film: &Film, truth: &Truth) -> f64 {
    let all = film
        .means()
        .zip(film.errors(NEIGHBOUR_WEIGHT, film.window))
        .zip(&truth.pixels);
    let squares =
        all.map(|((mean, error), (truth, unsure)): (_, &(f64, f64))| {
            (mean - truth).powi(2) / (error * error + unsure * unsure)
        });
    squares.sum::<f64>() / film.area() as f64
}

// 16 scrambles of 16 samples. If each pixel had its own variance alone, with 15
// degrees of freedom, the mean square would be 15/13; with its neighbours', as
// the film has them, it is about 1.04. Between images it has a standard
// deviation of 0.09, which includes that pixels share corrections; the root of
// the mean of ten has 0.014. A right program, at 1.02, leaves the interval with
// one of a hundred seeds.
#[test]
fn the_errors_of_pixels_are_as_large_as_stated() {
    let (stage, truth) = room();
    let images = (0..10)
        .map(|seed| honesty(&stage.image(100 + seed, 16, 256), truth));
    let deviation = (images.sum::<f64>() / 10.).sqrt();
    assert!((0.95..1.05).contains(&deviation), "{deviation}");
}

// Pixels share corrections, so that the error of the mean of an image is not
// that of as many independent pixels, but follows from the means of the tiles.
// Those of the four tiles have 15 degrees of freedom or more together; that
// makes their squares larger by at most 15/13.
#[test]
fn the_error_of_the_mean_of_an_image_is_as_large_as_stated() {
    let chance = &mut Chance::default();
    const SEEDS: u32 = 24;
    let (stage, truth) = room();
    let (mut shared, mut independent) = (0., 0.);
    for seed in 0..SEEDS {
        let film = stage.image(200 + u64::from(seed), 4, 64);
        let summary = film.summary();
        let square = (summary.mean - truth.mean.0).powi(2);
        let unsure = truth.mean.1.powi(2);
        shared += square / (summary.mean_stderr.powi(2) + unsure);
        let pixels = summary.rmse.powi(2) / film.area() as f64;
        independent += square / (pixels + unsure);
    }
    let chi2 = ChiSquared::new(SEEDS.into()).unwrap();
    for p in [chi2.sf(shared * 13. / 15.), chi2.cdf(shared)] {
        chance.add(p, "squares of the errors of means");
    }
    assert!(chi2.sf(independent * 13. / 15.) < 1e-9, "{independent}");
}

// -------------------------------------------------------------- The command

const METHODS: [&str; 2] = ["sobol", "gather"];

/// Runs `pt` on the room, with options between blanks.
fn pt(place: &Scratch, method: &str, options: &str) -> Run {
    let room = "-qf -iroom.obj -d23x17 -r0.7";
    place.done(&format!("{room} --integrator {method} {options}"))
}

/// The numbers of a PFM, which has no attributes.
fn image(place: &Scratch, method: &str, options: &str) -> Vec<u8> {
    let run = pt(place, method, &format!("--format=pfm {options}"));
    assert!(!run.stdout.is_empty());
    run.stdout
}

#[test]
fn threads_and_instructions_do_not_change_a_bit_of_any_method() {
    let place = Scratch::new();
    for isa in Isa::ALL {
        let run =
            place.line(&format!("-iroom.obj -d9x7 -oa.pgm -f --isa={isa}"));
        match isa.is_available() {
            true => assert!(run.stderr.contains(&format!(", {isa})"))),
            false => run.failed(2, &[&isa.to_string(), "instructions"]),
        }
    }
    let available = Isa::ALL.into_iter().filter(|isa| isa.is_available());
    let isas = available.map(|isa| format!("-n64 --isa={isa}"));
    let others: Vec<_> =
        isas.chain(["-n64 -j2".into(), "-n64 -j7".into()]).collect();
    let images = ["sobol", "gather", "reference"].map(|method| {
        let one = image(&place, method, "-n64 -j1");
        for other in &others {
            let same = image(&place, method, other) == one;
            assert!(same, "{method} {other}");
        }
        assert!(image(&place, method, "-n64 -s1") != one);
        one
    });
    let [a, b, c] = images;
    assert!(a != b && a != c);
}

/// Whatever a pilot would choose for more samples.
#[test]
fn a_checkpoint_decides_the_method_and_how_many_samples_are_placed_together()
 {
    let place = Scratch::with("box.obj", crate::choice::BOX);
    let method = |options: &str| {
        let view = "box.obj -p-.9,-.8,0 -t1,1,-.3 -r0.8 -d64x48 -q -f";
        place.done(&format!("{view} -oa.exr --report=r.json {options}"));
        place.json("r.json")["settings"]["integrator"].take()
    };
    assert_eq!(method("-n4 --checkpoint=c"), "reference");
    assert_eq!(method("-n64"), "gather");
    assert_eq!(method("-n64 --resume=c"), "reference");
    assert_eq!(place.json("r.json")["spp"], 64);
    // And the other way round.
    assert_eq!(method("-n64 --checkpoint=d"), "gather");
    assert_eq!(method("-n65 --resume=d"), "gather");
    for method in METHODS {
        let place = Scratch::new();
        // Scrambles of 4 samples; those of 160 samples would have 8.
        pt(&place, method, "-n64 -oa.pfm --checkpoint=c");
        place.put("d", place.get("c"));
        let on = |name: &str, n: &str| {
            place.done(&format!("-q --resume {name} {n}"));
            place.get("a.pfm")
        };
        let at_once = on("c", "-n160");
        on("d", "-n98");
        assert!(on("d", "-n160") == at_once, "{method}");
        assert!(image(&place, method, "-n160") != at_once);
        // Another method is another run.
        let others = ["--integrator=reference", "--integrator=sobol"];
        let other = others.into_iter().find(|it| !it.ends_with(method));
        let other = place.line(&format!("--resume=c {}", other.unwrap()));
        other.failed(1, &["belongs to another run"]);
    }
}

#[test]
fn samples_are_rounded_up_to_whole_scrambles() {
    let place = Scratch::new();
    for method in METHODS {
        // A scramble has 8 samples of 33 of paths in nets, 2 of a gather.
        let last = if method == "sobol" { 40 } else { 34 };
        for (n, there) in [("-n1", 1), ("-n3", 3), ("-n33", last)] {
            let files = "-oa.exr -oa.pfm --report=r.json";
            pt(&place, method, &format!("{files} {n}"));
            let report = place.json("r.json");
            assert_eq!(report["spp"], there, "{method} {n}");
            assert_eq!(report["mean_stderr"].is_null(), n == "-n1");
            let image = place.image("a.exr");
            // A gather samples some pixels more often than others, but each of
            // them in each scramble.
            let replicate = &image.attributes["replicate"];
            let scrambles =
                there as f64 / replicate.parse::<f64>().unwrap();
            let is_right = |&n: &f64| match method {
                "gather" => n >= scrambles && n % scrambles == 0.,
                _ => n == there as f64,
            };
            assert!(image.samples.unwrap().iter().all(is_right));
            assert_eq!(image.attributes["spp"], there.to_string());
            assert_eq!(place.image("a.pfm").means, image.means);
        }
    }
}

#[test]
fn scenes_without_light_or_surface_and_single_pixels_are_gathered() {
    let eye = View { up: DVec3::Z, ..look(DVec3::ZERO, DVec3::Y, 70.) };
    let means = |text: &str, rho, size, n, keeps: bool| {
        let mesh = read_obj(text.as_bytes()).unwrap();
        let fov = if size == (1, 1) && n > 99 { 1. } else { 70. };
        let view = View { fov, ..eye };
        let usual = settings::named("one triangle");
        let setting = settings::Setting { mesh, view, rho, ..usual };
        let pixels = Pixels::of_image(size);
        let sampling = Sampling::new(Method::Gather, 0, Some(n), pixels);
        let kept = if keeps { &SHORTCUTS[..] } else { &[] };
        let outcome = setting.render_with(kept, size, n, &sampling, |_| ());
        let means: Vec<_> = outcome.film.means().collect();
        assert!(means.iter().all(|mean| mean.is_finite()));
        means
    };
    // Closed and dark, whether that is known or not.
    for (rho, keeps) in [(1., false), (0.5, true), (1., true)] {
        assert_eq!(means(BOX, rho, (4, 3), 2, keeps), [0.; 12]);
    }
    // Half of an image without a triangle is sky.
    let behind = "v -1 -4 -1\nv 1 -4 -1\nv 0 -4.3 1\nf 1 2 3\n";
    for keeps in [false, true] {
        let sky = means(behind, 1., (4, 6), 2, keeps);
        assert_eq!(sky, [[1.; 12], [0.; 12]].concat());
    }
    // A triangle alone sees the sky above its horizon: (1 + cos) / 2 of its
    // hemisphere. Each sample is at most 1, so that the standard error of
    // independent ones is 1/128 at most, and that of a net is less.
    let ahead = "v -1 4 -1\nv 1 4 -1\nv 0 4.3 1\nf 1 2 3\n";
    let one = means(ahead, 1., (1, 1), 4096, false);
    let exact = 0.5 + 0.5 * 0.3 / 4.09f64.sqrt();
    assert!((one[0] - exact).abs() < 4. / 128., "{one:?} {exact}");
    // Black surfaces and single pixels.
    for (rho, size, n, keeps) in [
        (0., (40, 30), 1, true),
        (0., (40, 30), 1, false),
        (1., (1, 1), 16, false),
        (1., (1, 1), 1, false),
    ] {
        let room = means(ROOM, rho, size, n, keeps);
        assert!(room.iter().all(|mean| *mean > -0.5), "{rho} {size:?}");
    }
}
