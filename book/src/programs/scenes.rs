// Generates the large scenes of "make bench": "statue", a bust in the manner
// of a scan, and "field", boulders on hills. Both are functions that are
// sampled more or less finely, so that a scene keeps its shape at any number
// of triangles. y points up, lengths are in metres. Only arithmetic, square
// roots and libm are used: the text is the same on every machine. And prints
// the interiors and the room of "make efficiency", and the mixtures of scales
// of "make mixtures", these with all digits.
//
// usage: scenes NAME [NUMBER] > NAME.obj   NUMBER: how many triangles, or
//                                          what it is in book/src/mixtures.rs
//        scenes --view NAME [NUMBER]       the options of pt for its view
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::io::{self, BufWriter, Write};

use glam::DVec3;
use litpt::sampler::split_mix;
use litpt::scene::Mesh;
use litpt_book::interiors::Interior;
use litpt_book::mixtures::Mixture;

use super::Done;

const USAGE: &str = "usage: scenes [--view] NAME [NUMBER], where NAME is \
    statue, field, corridor, backroom, room or a mixture of scales";

pub fn run(arguments: &[String]) -> Done {
    let words: Vec<_> = arguments.iter().map(String::as_str).collect();
    if let ["--view", words @ ..] = &words[..] {
        return print_view(words);
    }
    let mesh = match words[..] {
        ["statue"] => statue(300_000),
        ["statue", count] => statue(count.parse()?),
        ["field"] => field(5_000_000),
        ["field", count] => field(count.parse()?),
        [name] => Interior::named(name).ok_or(USAGE)?.mesh(),
        _ => return print(&mixture(&words)?.mesh, |x| x.to_string()),
    };
    print(&mesh, |x| format!("{x:.6}"))
}

/// Writes a mesh with coordinates of so many digits.
fn print(mesh: &Mesh, digits: impl Fn(f64) -> String) -> Done {
    let mut out = BufWriter::with_capacity(1 << 20, io::stdout().lock());
    for v in &mesh.vertices {
        let [x, y, z] = v.to_array().map(&digits);
        writeln!(out, "v {x} {y} {z}")?;
    }
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| i + 1);
        writeln!(out, "f {a} {b} {c}")?;
    }
    Ok(out.flush()?)
}

fn print_view(words: &[&str]) -> Done {
    match words {
        ["statue", ..] => println!("{STATUE_VIEW}"),
        ["field", ..] => println!("{}", field_view()),
        [name] => {
            println!("{}", Interior::named(name).ok_or(USAGE)?.options());
        }
        _ => println!("{}", mixture(words)?.options()),
    }
    Ok(())
}

fn mixture(words: &[&str]) -> Result<Mixture, Box<dyn Error>> {
    let &[name, number] = words else { return Err(USAGE.into()) };
    Ok(Mixture::named(name, number.parse()?).ok_or(USAGE)?)
}

// ---- noise

/// Three numbers in [-1, 1) that belong to a point of the integer grid.
fn random(at: DVec3, seed: u64) -> DVec3 {
    let [x, y, z] = at.to_array().map(|c| c as i64 as u64);
    let bits = split_mix(x ^ split_mix(y ^ split_mix(z ^ split_mix(seed))));
    let part = |shift: u32| ((bits >> shift) & 0x1f_ffff) as f64;
    DVec3::new(part(0), part(21), part(42)) / f64::from(1 << 20) - 1.
}

/// Gradient noise: smooth, zero on the integer grid, within about 1.
fn noise(p: DVec3, seed: u64) -> f64 {
    let cell = p.floor();
    let inside = p - cell;
    let blend =
        inside * inside * inside * (inside * (inside * 6. - 15.) + 10.);
    let mut sum = 0.;
    for i in 0..8 {
        let bit = |k: u32| f64::from(i >> k & 1);
        let corner = DVec3::new(bit(0), bit(1), bit(2));
        let near = DVec3::ONE - corner + (corner * 2. - 1.) * blend;
        let slope = random(cell + corner, seed);
        sum += slope.dot(inside - corner) * near.element_product();
    }
    sum
}

/// Noise of wavelength 1 and `count - 1` octaves above, halved each time.
fn octaves(p: DVec3, count: i32, seed: u64) -> f64 {
    let scales = (0..count).map(|i| f64::from(1 << i));
    scales.map(|s| noise(p * s, seed + s as u64) / s).sum()
}

// ---- closed surfaces

/// Adds the closed surface onto which `place` maps the unit sphere:
/// `8 * n * n` triangles from an octahedron with irregular vertices.
fn sphere(
    mesh: &mut Mesh,
    n: i64,
    seed: u64,
    place: impl Fn(DVec3) -> DVec3,
) {
    // Number of the vertex that projects to (x, z), for each half.
    let side = 2 * n + 1;
    let slot = |x: i64, z: i64| ((x + n) * side + z + n) as usize;
    let mut number = [0, 1].map(|_| vec![0; (side * side) as usize]);
    for x in -n..=n {
        let reach = n - x.abs();
        for z in -reach..=reach {
            let height = reach - z.abs();
            for (half, y) in [height, -height].into_iter().enumerate() {
                if half == 1 && y == 0 {
                    number[1][slot(x, z)] = number[0][slot(x, z)];
                    continue;
                }
                let at = DVec3::new(x as f64, y as f64, z as f64);
                let towards = at + 0.25 * random(at, seed);
                number[half][slot(x, z)] = mesh.vertices.len() as u32;
                mesh.vertices.push(place(towards.normalize()));
            }
        }
    }
    for octant in 0..8 {
        let sign = |bit: u32| if octant >> bit & 1 == 0 { 1 } else { -1 };
        let half = usize::from(sign(1) < 0);
        let corner = |(a, b)| number[half][slot(sign(0) * a, sign(2) * b)];
        let mirrored = sign(0) * sign(1) * sign(2) < 0;
        let mut add = |corners: [(i64, i64); 3]| {
            let [a, b, c] = corners.map(corner);
            let anticlockwise =
                if mirrored { [a, c, b] } else { [a, b, c] };
            mesh.triangles.push(anticlockwise);
        };
        for a in 0..n {
            for b in 0..n - a {
                add([(a + 1, b), (a, b), (a, b + 1)]);
                if a + b + 2 <= n {
                    add([(a + 1, b), (a, b + 1), (a + 1, b + 1)]);
                }
            }
        }
    }
}

/// Subdivisions that make about `count` triangles.
fn subdivisions(count: f64) -> i64 {
    ((count / 8.).sqrt().round() as i64).max(1)
}

// ---- the statue

const STATUE_VIEW: &str = "-p 0.9,1.9,2.3 -t -0.03,1.72,0 -u 0,1,0 -F 35";

/// From the foot to the crown: height, half width, half depth.
const PROFILE: [[f64; 3]; 15] = [
    [0., 0., 0.],
    [0., 0.4, 0.4],
    [0.18, 0.4, 0.4],
    [0.36, 0.26, 0.26],
    [0.55, 0.42, 0.32],
    [0.8, 0.74, 0.42],
    [1.05, 0.9, 0.46],
    [1.28, 0.95, 0.42],
    [1.46, 0.82, 0.34],
    [1.59, 0.34, 0.27],
    [1.72, 0.2, 0.21],
    [1.9, 0.24, 0.3],
    [2.2, 0.3, 0.37],
    [2.42, 0.22, 0.28],
    [2.48, 0., 0.],
];

/// What stands out of the face, or lies in it: place, width and depth.
const FACE: [[f64; 4]; 6] = [
    [0., 2.06, 0.04, 0.1],
    [0.1, 2.13, 0.05, -0.06],
    [-0.1, 2.13, 0.05, -0.06],
    [0., 1.96, 0.06, -0.04],
    [0., 1.9, 0.06, 0.05],
    [0., 1.94, 0.03, 0.03],
];

pub fn statue(count: u64) -> Mesh {
    let mut mesh = Mesh::default();
    sphere(&mut mesh, subdivisions(count as f64), 1, carve);
    mesh
}

/// The point of the bust that belongs to a point of the unit sphere.
fn carve(d: DVec3) -> DVec3 {
    let along = libm::acos(-d.y.clamp(-1., 1.)) / std::f64::consts::PI;
    let [height, width, depth] = profile(along);
    let round = (d.x * d.x + d.z * d.z).sqrt().max(1e-9);
    let p = DVec3::new(width * d.x / round, height, depth * d.z / round);
    // Folds hang from the shoulders, and hair covers the skull.
    let cloth = ((1.62 - height) / 0.2).clamp(0., 1.);
    let fold = noise(p * DVec3::new(6., 1.5, 6.), 2).abs();
    let fold = cloth * (0.06 - 0.3 * fold);
    let hair = ((height - 1.9 - 0.5 * d.z) / 0.1).clamp(0., 1.);
    let rough = 0.03 + 0.03 * cloth + 0.07 * hair;
    let rough = rough * octaves(p * (3. + 4. * hair), 6, 3);
    let mut face = 0.;
    for [x, y, size, relief] in FACE {
        let (x, y) = ((p.x - x) / size, (p.y - y) / size);
        face += relief * libm::exp(-x * x - y * y);
    }
    let front = d.z.max(0.).sqrt();
    p + d * (fold + rough) + DVec3::Z * front * face
}

/// The profile at a parameter in [0, 1], by cubic interpolation.
fn profile(along: f64) -> [f64; 3] {
    let last = PROFILE.len() - 1;
    let i = ((along * last as f64) as usize).min(last - 1);
    let t = along * last as f64 - i as f64;
    let before = PROFILE[i.saturating_sub(1)];
    let after = PROFILE[(i + 2).min(last)];
    std::array::from_fn(|k| {
        let (a, b) = (PROFILE[i][k], PROFILE[i + 1][k]);
        let (rise, fall) = ((b - before[k]) / 2., (after[k] - a) / 2.);
        let cubic = (2. * (a - b) + rise + fall) * t;
        let square = 3. * (b - a) - 2. * rise - fall;
        (((cubic + square) * t + rise) * t + a).max(0.)
    })
}

// ---- the field

/// Half the side of the field.
const HALF: f64 = 50.;

const BOULDERS: u64 = 12_000;

/// Smallest and largest radius of a boulder.
const RADII: [f64; 2] = [0.12, 2.2];

/// How much denser than the ground a boulder is tessellated.
const DETAIL: f64 = 3.;

/// Where the camera is in the field, in the middle, and what it looks at.
pub fn field_eye() -> [[f64; 3]; 2] {
    [(0., 1.2), (6., 0.2)].map(|(x, above)| [x, ground(x, 0.) + above, 0.])
}

fn field_view() -> String {
    let [eye, target] =
        field_eye().map(|[x, y, z]| format!("{x},{y:.6},{z}"));
    format!("-p {eye} -t {target} -u 0,1,0 -F 60")
}

/// Height of the ground, a wide bowl with hills.
fn ground(x: f64, z: f64) -> f64 {
    let p = DVec3::new(x, 0.5, z);
    let rim = (x * x + z * z) / (HALF * HALF);
    14. * rim + 5. * octaves(p / 28., 3, 4) + 0.12 * octaves(p / 1.5, 5, 5)
}

struct Boulder {
    middle: DVec3,
    radius: f64,
    seed: u64,
}

impl Boulder {
    /// The boulder of a number, if it leaves the camera free.
    fn new(seed: u64) -> Option<Self> {
        let at = random(DVec3::ZERO, 1000 + seed) * HALF;
        let share = 0.5 + 0.5 * random(DVec3::ONE, 1000 + seed).x;
        let [small, large] = RADII;
        // As many in an octave as make the same area in each.
        let rarest = (small / large) * (small / large);
        let radius = small / (1. - share * (1. - rarest)).sqrt();
        let away = (at.x * at.x + at.z * at.z).sqrt() - radius;
        let height = ground(at.x, at.z) + 0.3 * radius;
        let middle = DVec3::new(at.x, height, at.z);
        (away > 0.9).then_some(Self { middle, radius, seed })
    }

    fn area(&self) -> f64 {
        4. * std::f64::consts::PI * self.radius * self.radius
    }

    /// The point of the boulder that belongs to a point of the sphere.
    fn place(&self, d: DVec3) -> DVec3 {
        let axes = random(DVec3::splat(2.), 1000 + self.seed) * 0.25;
        let shape = (d * 1.3).max(DVec3::splat(-1.)).min(DVec3::ONE);
        let flat = DVec3::new(1., 0.75, 1.) + axes;
        let shift = DVec3::splat(self.seed as f64 * 3.);
        let rough = 1. + 0.45 * octaves(d * 1.2 + shift, 5, 6);
        self.middle + (0.6 * d + 0.4 * shape) * flat * rough * self.radius
    }
}

pub fn field(count: u64) -> Mesh {
    let mut boulders: Vec<_> =
        (0..BOULDERS).filter_map(Boulder::new).collect();
    boulders.sort_by(|a, b| b.radius.total_cmp(&a.radius));
    let plain = 4. * HALF * HALF;
    let area = DETAIL * boulders.iter().map(Boulder::area).sum::<f64>();
    let density = count as f64 / (plain + area);
    let mut mesh = Mesh::default();
    sheet(&mut mesh, (density * plain / 2.).sqrt().round().max(1.) as u32);
    // With few triangles only the largest boulders can be had.
    for boulder in &boulders {
        let n = subdivisions(density * DETAIL * boulder.area());
        if mesh.triangles.len() as i64 + 8 * n * n > count as i64 {
            break;
        }
        sphere(&mut mesh, n, boulder.seed, |d| boulder.place(d));
    }
    mesh
}

/// Adds the ground, of `2 * n * n` triangles.
fn sheet(mesh: &mut Mesh, n: u32) {
    for i in 0..=n {
        for j in 0..=n {
            let grid = DVec3::new(f64::from(i), 0., f64::from(j));
            let at = grid + 0.3 * random(grid, 7);
            let [x, z] =
                [at.x, at.z].map(|c| HALF * (2. * c / f64::from(n) - 1.));
            mesh.vertices.push(DVec3::new(x, ground(x, z), z));
        }
    }
    for i in 0..n {
        for j in 0..n {
            let corner = |a, b| (i + a) * (n + 1) + j + b;
            let [a, b] = [corner(0, 0), corner(0, 1)];
            let [c, d] = [corner(1, 1), corner(1, 0)];
            let cell = DVec3::new(f64::from(i), 1., f64::from(j));
            mesh.triangles.extend(if random(cell, 8).x < 0. {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, b, d], [b, c, d]]
            });
        }
    }
}
