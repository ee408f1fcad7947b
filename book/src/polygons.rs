// Fills random polygons by several libraries and by ours, and prints a CSV:
// how many of each kind were not filled, and the microseconds that one took.
// "make measure" records it for the chapter "Polygons". The libraries are
// behind the feature "polygons", so that nothing else has to compile them.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::collections::HashMap;
use std::f64::consts::TAU;
use std::panic::{catch_unwind, set_hook};

use glam::DVec3;
use litpt::scene::polygons::fill;

type Point = [f64; 2];

/// Points, and triangles between them; none if the polygon is refused.
type Cut = Option<(Vec<Point>, Vec<[usize; 3]>)>;

struct Random(u64);
impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 >> 20
    }
    fn below(&mut self, n: usize) -> usize {
        self.next() as usize % n
    }
    fn unit(&mut self) -> f64 {
        self.next() as f64 / (1u64 << 44) as f64
    }
}
fn orient(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}
fn on(a: Point, b: Point, p: Point) -> bool {
    orient(a, b, p) == 0.
        && p[0] >= a[0].min(b[0])
        && p[0] <= a[0].max(b[0])
        && p[1] >= a[1].min(b[1])
        && p[1] <= a[1].max(b[1])
}
fn meet(a: Point, b: Point, c: Point, d: Point) -> bool {
    let (p, q, r, s) = (
        orient(a, b, c),
        orient(a, b, d),
        orient(c, d, a),
        orient(c, d, b),
    );
    if p * q < 0. && r * s < 0. {
        return true;
    }
    on(a, b, c) || on(a, b, d) || on(c, d, a) || on(c, d, b)
}
/// Grows a simple polygon on a grid.
fn grow(r: &mut Random, n: usize, size: usize) -> Vec<Point> {
    let point =
        |r: &mut Random| [r.below(size) as f64, r.below(size) as f64];
    let mut v = loop {
        let t = [point(r), point(r), point(r)];
        if orient(t[0], t[1], t[2]) != 0. {
            break t.to_vec();
        }
    };
    for _ in 0..6 * n {
        if v.len() >= n {
            break;
        }
        let i = r.below(v.len());
        let (a, b) = (v[i], v[(i + 1) % v.len()]);
        let p = point(r);
        if on(a, b, p) {
            continue;
        }
        let m = v.len();
        let ok = (0..m).filter(|&k| k != i).all(|k| {
            let (c, d) = (v[k], v[(k + 1) % m]);
            let near_a = (k + 1) % m == i;
            let near_b = k == (i + 1) % m;
            // a-p against c-d
            let x = if near_a {
                on(c, d, p) || (orient(a, p, c) == 0. && on(a, p, c))
            } else {
                meet(a, p, c, d)
            };
            let y = if near_b {
                on(c, d, p) || (orient(p, b, d) == 0. && on(p, b, d))
            } else {
                meet(p, b, c, d)
            };
            !x && !y
        });
        if ok {
            v.insert(i + 1, p)
        }
    }
    v
}
fn ring(r: &mut Random) -> Vec<Point> {
    let n = 6 + r.below(20);
    let at = |k: usize, rad: f64| {
        let t = k as f64 * std::f64::consts::TAU / n as f64;
        [
            (rad * t.cos() * 262144.).round(),
            (rad * t.sin() * 262144.).round(),
        ]
    };
    let o: Vec<Point> = (0..n).map(|k| at(k, 2. + r.unit())).collect();
    let h: Vec<Point> =
        (0..n).map(|k| at(k, 0.5 + r.unit() * 0.5)).collect();
    let s = r.below(n);
    let mut v: Vec<Point> = (0..=n).map(|k| o[(s + k) % n]).collect();
    v.extend((0..=n).rev().map(|k| h[(s + k) % n]));
    v
}
fn degenerate(r: &mut Random) -> Vec<Point> {
    let v = grow(r, 20, 1 << 18);
    let mut w = vec![];
    let m = v.len();
    for i in 0..m {
        let (a, b) = (v[i].map(|x| x * 4.), v[(i + 1) % m].map(|x| x * 4.));
        let mid = [(a[0] + b[0]) / 2., (a[1] + b[1]) / 2.];
        w.push(a);
        match r.below(6) {
            0 => w.push(a),
            1 => w.push(mid),
            2 => w.extend([mid, a, mid]),
            3 => w.extend([mid, mid]),
            _ => {}
        }
    }
    w
}
fn set(kind: &str, r: &mut Random) -> Vec<Point> {
    match kind {
        "simple" => {
            let n = 4 + r.below(37);
            grow(r, n, 1 << 20)
        }
        "collinear" => {
            let n = 4 + r.below(37);
            grow(r, n, 12)
        }
        "bridge" => ring(r),
        "degenerate" => degenerate(r),
        "flat" => {
            let n = 4 + r.below(37);
            grow(r, n, 1 << 20)
                .into_iter()
                .map(|[x, y]| [x, y * 2f64.powi(-40)])
                .collect()
        }
        "slanted" => {
            // nearly collinear by rounding
            let (c, s) = (r.unit().cos(), r.unit());
            degenerate(r)
                .into_iter()
                .map(|[x, y]| [x * c - y * s * 0.1, x * s * 0.1 + y * c])
                .collect()
        }
        _ => {
            let n = 5 + r.below(20);
            (0..n)
                .map(|_| {
                    let t = r.below(100) as f64;
                    [t, 3. * t]
                })
                .collect()
        }
    }
}
fn area(v: &[Point]) -> f64 {
    (0..v.len())
        .map(|i| {
            let (a, b) = (v[i], v[(i + 1) % v.len()]);
            let o = v[0];
            orient(o, a, b)
        })
        .sum::<f64>()
        / 2.
}

fn chunks(v: Vec<usize>) -> Vec<[usize; 3]> {
    v.chunks(3).map(|c| [c[0], c[1], c[2]]).collect()
}
fn earcut_(v: &[Point]) -> Cut {
    let mut out: Vec<usize> = vec![];
    earcut::Earcut::new().earcut_slice(v, &[], &mut out);
    Some((v.to_vec(), chunks(out)))
}
fn earcutr_(v: &[Point]) -> Cut {
    let flat: Vec<f64> = v.concat();
    earcutr::earcut(&flat, &[], 2).ok().map(|t| (v.to_vec(), chunks(t)))
}
fn i_tri(v: &[Point]) -> Cut {
    use i_triangle::float::triangulatable::Triangulatable;
    let t = [v.to_vec()].triangulate_as::<i64>().to_triangulation::<u32>();
    Some((
        t.points,
        chunks(t.indices.into_iter().map(|i| i as usize).collect()),
    ))
}
fn lyon_(v: &[Point]) -> Cut {
    use lyon_tessellation::math::point;
    use lyon_tessellation::path::Path;
    use lyon_tessellation::*;
    let mut b = Path::builder();
    for (i, p) in v.iter().enumerate() {
        let q = point(p[0] as f32, p[1] as f32);
        if i == 0 {
            b.begin(q);
        } else {
            b.line_to(q);
        }
    }
    b.end(true);
    let path = b.build();
    let mut out: VertexBuffers<Point, u32> = VertexBuffers::new();
    FillTessellator::new()
        .tessellate_path(
            &path,
            &FillOptions::non_zero().with_tolerance(1e-9),
            &mut BuffersBuilder::new(&mut out, |v: FillVertex| {
                [v.position().x as f64, v.position().y as f64]
            }),
        )
        .ok()?;
    Some((
        out.vertices,
        chunks(out.indices.into_iter().map(|i| i as usize).collect()),
    ))
}
fn cdt_(v: &[Point]) -> Cut {
    let pts: Vec<(f64, f64)> = v.iter().map(|p| (p[0], p[1])).collect();
    let mut c: Vec<usize> = (0..v.len()).collect();
    c.push(0);
    cdt::triangulate_contours(&pts, &[c]).ok().map(|t| {
        (v.to_vec(), t.into_iter().map(|(a, b, c)| [a, b, c]).collect())
    })
}

/// Our own, on the crate spade; the fan stays where it is right.
fn ours(v: &[Point]) -> Cut {
    let vertices: Vec<_> =
        v.iter().map(|p| DVec3::new(p[0], p[1], 0.)).collect();
    let n = v.len() as u32;
    let mut triangles = (2..n).map(|i| [0, i - 1, i]).collect();
    let mut joined = (1..n - 2).collect();
    if !fill(&vertices, &mut triangles, &mut joined).is_empty() {
        return None;
    }
    let cut = triangles.iter().map(|t| t.map(|i| i as usize));
    Some((v.to_vec(), cut.collect()))
}

/// A library: its name, and the function that cuts.
type Library = (&'static str, fn(&[Point]) -> Cut);

const LIBRARIES: [Library; 6] = [
    ("earcut", earcut_),
    ("earcutr", earcutr_),
    ("iTriangle", i_tri),
    ("lyon", lyon_),
    ("cdt", cdt_),
    ("ours (spade)", ours),
];

const KINDS: [&str; 8] = [
    "simple",
    "collinear",
    "bridge",
    "degenerate",
    "slanted",
    "flat",
    "on a line",
    "many corners",
];

/// Whether the area is wrong, corners are new, and the boundary is another.
fn judge(
    v: &[Point],
    (pts, tris): &(Vec<Point>, Vec<[usize; 3]>),
) -> (bool, bool, bool) {
    let extent = |k: usize| {
        let (l, h) = v.iter().fold((f64::MAX, f64::MIN), |(l, h), p| {
            (l.min(p[k]), h.max(p[k]))
        });
        h - l
    };
    let (ex, ey) = (extent(0).max(1e-300), extent(1).max(1e-300));
    let mut fresh = false;
    let known: std::collections::HashSet<[u64; 2]> =
        v.iter().map(|p| p.map(|x| (x + 0.).to_bits())).collect();
    let at: Vec<Point> = pts
        .iter()
        .map(|p| {
            if known.contains(&p.map(|x| (x + 0.).to_bits())) {
                return *p;
            }
            let q = v
                .iter()
                .min_by(|a, b| {
                    ((a[0] - p[0]).abs() / ex + (a[1] - p[1]).abs() / ey)
                        .total_cmp(
                            &((b[0] - p[0]).abs() / ex
                                + (b[1] - p[1]).abs() / ey),
                        )
                })
                .unwrap();
            if (q[0] - p[0]).abs() > 1e-5 * ex
                || (q[1] - p[1]).abs() > 1e-5 * ey
            {
                fresh = true;
                *p
            } else {
                *q
            }
        })
        .collect();
    let (mut sum, mut signed) = (0., 0.);
    for t in tris {
        let o = orient(at[t[0]], at[t[1]], at[t[2]]) / 2.;
        sum += o.abs();
        signed += o;
    }
    let a = area(v);
    let wrong = (sum - a.abs()).abs() > 1e-9 * (a.abs() + 1e-9 * ex * ey);
    let key = |p: Point| p.map(|x| (x + 0.).to_bits());
    let mut chain: HashMap<([u64; 2], [u64; 2]), i32> = HashMap::new();
    let mut add = |p: Point, q: Point, s: i32| {
        let (p, q) = (key(p), key(q));
        if p < q {
            *chain.entry((p, q)).or_default() += s
        } else if q < p {
            *chain.entry((q, p)).or_default() -= s
        }
    };
    let sign = if signed * a < 0. { -1 } else { 1 };
    for t in tris {
        for k in 0..3 {
            add(at[t[k]], at[t[(k + 1) % 3]], sign)
        }
    }
    for i in 0..v.len() {
        add(v[i], v[(i + 1) % v.len()], -1)
    }
    let open = chain.values().any(|&n| n != 0);
    (wrong, fresh, open)
}

/// The polygons of a kind.
fn polygons(kind: &str, count: usize) -> Vec<Vec<Point>> {
    let mut random = Random(88172645463325252);
    match kind {
        "many corners" => large(&mut random, 100_000).into(),
        _ => (0..count).map(|_| set(kind, &mut random)).collect(),
    }
}

/// A star, a comb, an L with corners on its sides, and a spiral.
fn large(random: &mut Random, n: usize) -> [Vec<Point>; 4] {
    let at = |turn: f64, r: f64| {
        [r * (turn * TAU).cos(), r * (turn * TAU).sin()]
    };
    let part = |i: usize| i as f64 / n as f64;
    let star = (0..n).map(|i| at(part(i), 1. + random.unit())).collect();
    let tooth = |i: usize| {
        [
            (n - i) as f64,
            if i.is_multiple_of(2) { 0. } else { 1e3 + (i % 97) as f64 },
        ]
    };
    let comb = [[-1., -1.], [n as f64, -1.]].into_iter();
    let comb = comb.chain((2..n).map(tooth)).collect();
    let ends = [[2., 0.], [2., 1.], [1., 1.], [1., 2.], [0., 2.], [0., 0.]];
    let on_side = |i: usize| {
        let (a, b) = (ends[i * 6 / n], ends[(i * 6 / n + 1) % 6]);
        let t = (i * 6 % n) as f64 / n as f64;
        [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
    };
    let l = (0..n).map(on_side).collect();
    let turn = |i: usize, more: f64| {
        at(i as f64 * 0.0016, 1. + i as f64 * 0.001 + more)
    };
    let spiral = (0..n / 2).map(|i| turn(i, 0.3));
    let spiral =
        spiral.chain((0..n / 2).rev().map(|i| turn(i, 0.))).collect();
    [star, comb, l, spiral]
}

/// The time that the processor has spent on this thread.
fn seconds() -> f64 {
    let path = "/proc/thread-self/schedstat";
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let first = text.split(' ').next().and_then(|n| n.parse::<f64>().ok());
    first.unwrap_or(f64::NAN) / 1e9
}

fn main() {
    set_hook(Box::new(|_| {}));
    let count = std::env::args().nth(1);
    let count = count.map_or(100_000, |count| count.parse().unwrap());
    println!(
        "polygons,library,panics,refused,wrong area,new corners,open,time"
    );
    for kind in KINDS {
        let all = polygons(kind, count);
        for (i, (name, cut)) in LIBRARIES.iter().enumerate() {
            let mut counts = [0; 5];
            let begin = seconds();
            let cut = |polygon: &Vec<Point>| catch_unwind(|| cut(polygon));
            let found: Vec<_> = all.iter().map(cut).collect();
            let time = (seconds() - begin) / all.len() as f64;
            for (polygon, found) in all.iter().zip(found) {
                let Ok(found) = found else {
                    counts[0] += 1;
                    continue;
                };
                let Some(found) = found else {
                    counts[1] += 1;
                    continue;
                };
                // Nearest corners are not looked for among many.
                if kind == "many corners" && found.0 != *polygon {
                    continue;
                }
                let (wrong, new, open) = judge(polygon, &found);
                counts[2] += usize::from(wrong);
                counts[3] += usize::from(new);
                counts[4] += usize::from(open);
            }
            let time = match kind {
                "many corners" => format!("{time:.2} s"),
                _ => format!("{:.1}", time * 1e6),
            };
            let kind = if i == 0 { kind } else { "" };
            let counts = counts.map(|n| n.to_string()).join(",");
            println!("{kind},{name},{counts},{time}");
        }
    }
}
