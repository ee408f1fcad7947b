// A path tracer:
// cargo run --release --example tiny -- SCENE.obj [FROM TO [PATHS]] > IMAGE.pgm
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::f64::consts::TAU;
use std::io::{Write, stdout};
use std::{array, env, fs};

/// A point or a direction.
pub type Vector = [f64; 3];

fn add(a: Vector, b: Vector) -> Vector {
    array::from_fn(|i| a[i] + b[i])
}

fn scale(s: f64, a: Vector) -> Vector {
    a.map(|x| s * x)
}

fn subtract(a: Vector, b: Vector) -> Vector {
    add(a, scale(-1., b))
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j] * b[k] - a[k] * b[j]
    })
}

fn unit(a: Vector) -> Vector {
    scale(1. / dot(a, a).sqrt(), a)
}

/// A stream of random numbers: PCG-XSH-RR (O'Neill 2014).
struct Random(u64);

impl Random {
    /// The next number of [0, 1).
    fn next(&mut self) -> f64 {
        let state = self.0;
        self.0 = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        let folded = ((state >> 18 ^ state) >> 27) as u32;
        let turned = folded.rotate_right((state >> 59) as u32);
        f64::from(turned) / 2f64.powi(32)
    }
}

/// Three corners.
pub type Triangle = [Vector; 3];

/// The triangles of an OBJ.
pub fn read(text: &str) -> Result<Vec<Triangle>, Box<dyn Error>> {
    let (mut points, mut triangles) = (vec![], vec![]);
    for line in text.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["v", x, y, z, ..] => {
                points.push([x.parse()?, y.parse()?, z.parse()?]);
            }
            ["f", ref corners @ ..] => {
                // Cut a face into triangles
                let mut face = vec![];
                for corner in corners {
                    let number = corner.split('/').next().unwrap_or("");
                    let mut number: i64 = number.parse()?;
                    if number < 0 {
                        number += points.len() as i64 + 1;
                    }
                    let point = points.get((number - 1) as usize);
                    face.push(*point.ok_or("a face has no such point")?);
                }
                for i in 2..face.len() {
                    triangles.push([face[0], face[i - 1], face[i]]);
                }
            }
            _ => {}
        }
    }
    Ok(triangles)
}

/// Where a ray starts, and its direction, of length 1.
#[derive(Clone, Copy)]
pub struct Ray {
    origin: Vector,
    direction: Vector,
}

/// Nearer hits are those of the surface that a ray comes from.
const NEAR: f64 = 1e-6;

/// How far a ray goes to a triangle, if it meets it.
fn distance(ray: Ray, &[a, b, c]: &Triangle) -> Option<f64> {
    let (ab, ac) = (subtract(b, a), subtract(c, a));
    let p = cross(ray.direction, ac);
    let q = cross(subtract(ray.origin, a), ab);
    let determinant = dot(ab, p);
    let u = dot(subtract(ray.origin, a), p) / determinant;
    let v = dot(ray.direction, q) / determinant;
    let t = dot(ac, q) / determinant;
    let is_met = u >= 0. && v >= 0. && u + v <= 1. && t > NEAR;
    is_met.then_some(t)
}

/// The nearest triangle that a ray meets, and its distance.
fn hit(scene: &[Triangle], ray: Ray) -> Option<(f64, &Triangle)> {
    let distances = scene.iter().map(|it| (distance(ray, it), it));
    let hits = distances.filter_map(|(t, it)| Some((t?, it)));
    hits.min_by(|a, b| a.0.total_cmp(&b.0))
}

/// A direction of reflection, with density cosine / pi.
fn reflect(normal: Vector, random: &mut Random) -> Vector {
    let z = 2. * random.next() - 1.;
    let (sin, cos) = (TAU * random.next()).sin_cos();
    let r = (1. - z * z).sqrt();
    unit(add(normal, [r * cos, r * sin, z]))
}

/// The share of the light that surfaces reflect.
const ALBEDO: f64 = 0.5;

/// The radiance that one random path brings.
fn sample(scene: &[Triangle], mut ray: Ray, random: &mut Random) -> f64 {
    let mut throughput = 1.;
    while let Some((t, &[a, b, c])) = hit(scene, ray) {
        throughput *= ALBEDO;
        // End a path of little throughput by lot
        if throughput < 0.1 {
            if random.next() < 0.5 {
                return 0.;
            }
            throughput *= 2.;
        }
        // Reflect the ray on its own side of the triangle
        let mut normal = unit(cross(subtract(b, a), subtract(c, a)));
        if dot(normal, ray.direction) > 0. {
            normal = scale(-1., normal);
        }
        ray.origin = add(ray.origin, scale(t, ray.direction));
        ray.direction = reflect(normal, random);
    }
    if ray.direction[2] > 0. { throughput } else { 0. }
}

/// Where a camera stands, and three perpendicular vectors of length 1.
pub struct Camera {
    position: Vector,
    front: Vector,
    right: Vector,
    up: Vector,
}

impl Camera {
    /// A camera that looks at a target.
    pub fn new(position: Vector, target: Vector) -> Self {
        let front = unit(subtract(target, position));
        let right = unit(cross(front, [0., 0., 1.]));
        Self { position, front, right, up: cross(right, front) }
    }

    /// The ray through a point of the image, from the upper left pixel on.
    fn ray(&self, x: f64, y: f64) -> Ray {
        let pixel = 2. * 35f64.to_radians().tan() / HEIGHT as f64;
        let across = scale(pixel * (x - WIDTH as f64 / 2.), self.right);
        let upwards = scale(pixel * (HEIGHT as f64 / 2. - y), self.up);
        let direction = unit(add(self.front, add(across, upwards)));
        Ray { origin: self.position, direction }
    }
}

/// The mean of samples, and its standard error.
pub fn mean(samples: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut n, mut sum, mut squares) = (0., 0., 0.);
    for sample in samples {
        n += 1.;
        sum += sample;
        squares += sample * sample;
    }
    let mean = sum / n;
    let variance = (squares / n - mean * mean).max(0.);
    (mean, (variance / (n - 1.)).sqrt())
}

pub const WIDTH: usize = 160;
pub const HEIGHT: usize = 120;

/// Mean and error of each pixel, row by row from the upper left.
pub fn render(
    scene: &[Triangle],
    camera: &Camera,
    paths: usize,
) -> Vec<(f64, f64)> {
    let mut random = Random(0);
    let pixels = (0..WIDTH * HEIGHT).map(|pixel| {
        mean((0..paths).map(|_| {
            let x = (pixel % WIDTH) as f64 + random.next();
            let y = (pixel / WIDTH) as f64 + random.next();
            sample(scene, camera.ray(x, y), &mut random)
        }))
    });
    pixels.collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = env::args().skip(1).collect();
    let usage = "usage: tiny SCENE.obj [FROM TO [PATHS]]";
    let file = words.first().ok_or(usage)?;
    let scene = read(&fs::read_to_string(file)?)?;
    let camera = match &words[1..] {
        [from, to, ..] => Camera::new(point(from)?, point(to)?),
        _ => outside(&scene),
    };
    let paths = words.get(3).map_or(Ok(16), |number| number.parse())?;
    let pixels = render(&scene, &camera, paths);
    // Print the mean of the image and its error
    let n = pixels.len() as f64;
    let sum: f64 = pixels.iter().map(|pixel| pixel.0).sum();
    let squares: f64 = pixels.iter().map(|pixel| pixel.1 * pixel.1).sum();
    eprintln!("mean radiance {:.5} ± {:.5}", sum / n, squares.sqrt() / n);
    // Write the image in shades of grey
    let level = |mean: f64| (255. * mean.powf(1. / 2.2)).round() as u8;
    let levels: Vec<u8> = pixels.iter().map(|it| level(it.0)).collect();
    let mut file = stdout().lock();
    writeln!(file, "P5 {WIDTH} {HEIGHT} 255")?;
    file.write_all(&levels)?;
    Ok(())
}

/// A point such as 1,2.5,0.
fn point(text: &str) -> Result<Vector, Box<dyn Error>> {
    let numbers: Result<Vec<f64>, _> =
        text.split(',').map(str::parse).collect();
    numbers?.try_into().map_err(|_| "a point has three numbers".into())
}

/// A camera that sees the whole scene from outside.
pub fn outside(scene: &[Triangle]) -> Camera {
    let extreme = |of: fn(f64, f64) -> f64, start: f64| -> Vector {
        array::from_fn(|i| {
            scene.iter().flatten().map(|it| it[i]).fold(start, of)
        })
    };
    let least = extreme(f64::min, f64::INFINITY);
    let most = extreme(f64::max, f64::NEG_INFINITY);
    let centre = scale(0.5, add(least, most));
    let diagonal = subtract(most, least);
    let away = scale(dot(diagonal, diagonal).sqrt(), unit([1., -2., 1.]));
    Camera::new(add(centre, away), centre)
}
