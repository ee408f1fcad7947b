// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! An arcaded courtyard of two storeys, generated.
//!
//! Lengths are in metres, y points up, the paving is at y = 0 and the origin
//! in the middle of the court, whose long sides run along x. Every solid is
//! closed, and shares neither a vertex nor a plane of contact with another:
//! where solids meet, they interpenetrate by a centimetre or more. The
//! chapter "A courtyard to render" tells what is built.

use glam::DVec3;
use litpt::camera::View;
use litpt::scene::{Mesh, read_obj};

use crate::sweep::{
    Flat, Point, Solid, block, fan, lathe, moulding, rectangle, semicircle,
    sweep, turned, write_obj,
};

/// Round arches in a wall; lengths in metres, springing line at y = 0.
#[derive(Clone, Copy)]
struct Arches {
    count: usize,
    bay: f64,
    radius: f64,
    margin: f64,
    height: f64,
    steps: usize,
}

impl Arches {
    // Find the centre of an arch
    fn centre(&self, k: usize) -> f64 {
        (k as f64 - (self.count as f64 - 1.0) / 2.0) * self.bay
    }

    // Draw the outline of the arches
    fn outline(&self) -> (Vec<Flat>, Vec<[usize; 3]>) {
        let end = self.centre(self.count - 1) + self.radius + self.margin;
        let mut outline = vec![[-end, 0.0]];
        for k in 0..self.count {
            let place = |[x, y]: Flat| {
                [self.centre(k) + self.radius * x, self.radius * y]
            };
            outline.extend(semicircle(self.steps).into_iter().map(place));
        }
        outline.push([end, 0.0]);
        outline.dedup();
        let feet = outline.len();
        // Return along the top of the wall
        outline.push([end, self.height]);
        for k in (1..self.count).rev() {
            let x = self.centre(k) - self.bay / 2.0;
            outline.push([x, self.height]);
        }
        outline.push([-end, self.height]);
        // Cut the outline into fans and triangles
        let mut triangles = vec![];
        let mut apex = outline.len() - 1;
        for (i, p) in outline[..feet].iter().enumerate().skip(1) {
            triangles.push([apex, i - 1, i]);
            if p[1] == self.radius {
                triangles.push([apex, i, apex - 1]);
                apex -= 1;
            }
        }
        (outline, triangles)
    }

    // Raise a wall with arches
    fn wall(&self, half: f64) -> Solid {
        let (outline, triangles) = self.outline();
        let ring =
            |z| outline.iter().map(|&[x, y]| [x, y, z]).collect::<Vec<_>>();
        sweep(&[ring(-half), ring(half)], &triangles)
    }

    // Build a groin vault instead
    fn vault(&self) -> Solid {
        let (r, h) = (self.radius, self.height);
        let (arc, triangles) = self.outline();
        let mut vault = Solid::default();
        for side in 0..4 {
            // Close the side of the vault
            for t in &triangles {
                let corner = t.map(|i| [arc[i][0], arc[i][1], r]);
                vault.face(&corner.map(|p| turned(p, side)));
            }
            // Rule the web towards that side
            for pair in arc[..=self.steps].windows(2) {
                let ([a, y], [b, v]) = (pair[0], pair[1]);
                let groin = [[a, y, a.abs()], [b, v, b.abs()]];
                let strip = [groin[0], groin[1], [b, v, r], [a, y, r]];
                vault.face(&strip.map(|p| turned(p, side)));
            }
        }
        vault.face(&[[-r, h, r], [r, h, r], [r, h, -r], [-r, h, -r]]);
        vault
    }
}

// Bend a band around an arch
fn band(r: [f64; 2], z: [f64; 2], steps: usize) -> Solid {
    let ring = |[x, y]: Flat| {
        let at = |i: usize, j: usize| [r[i] * x, r[i] * y, z[j]];
        vec![at(0, 0), at(1, 0), at(1, 1), at(0, 1)]
    };
    let rings: Vec<_> = semicircle(steps).into_iter().map(ring).collect();
    sweep(&rings, &fan(4))
}

/// Side of a square bay of the grid, metres.
const BAY: f64 = 3.6;

/// Bays along the sides of the court that run along x, and along z.
const BAYS: [usize; 2] = [7, 3];

/// Half the size of the court between arcade axes, along x and z.
const HALF: [f64; 2] =
    [BAY * BAYS[0] as f64 / 2.0, BAY * BAYS[1] as f64 / 2.0];

/// What differs between storeys; lengths and heights in metres.
struct Storey {
    split: usize,
    floor: f64,
    foot: f64,
    spring: f64,
    radius: f64,
    depth: f64,
    pier: f64,
    abacus: f64,
    shaft: f64,
    steps: usize,
}

// Set down the two storeys
const STOREYS: [Storey; 2] = [
    Storey {
        split: 1,
        floor: 0.3,
        foot: 0.3,
        spring: 3.4,
        radius: 1.5,
        depth: 0.24,
        pier: 0.33,
        abacus: 0.38,
        shaft: 0.27,
        steps: 32,
    },
    Storey {
        split: 2,
        floor: 5.5,
        foot: 6.45,
        spring: 8.1,
        radius: 0.68,
        depth: 0.18,
        pier: 0.25,
        abacus: 0.31,
        shaft: 0.16,
        steps: 16,
    },
];

// Run a rectangular course around
fn course(o: [f64; 2], y: [f64; 2]) -> Solid {
    moulding(HALF, &rectangle(o, y))
}

const STRING_COURSE: [[Flat; 4]; 2] = [
    [[-0.27, 0.0], [3.6, 0.0], [3.6, 0.3], [-0.46, 0.3]],
    [[-0.46, 0.22], [-0.38, 0.17], [-0.38, 0.12], [-0.3, 0.06]],
];

const CORNICE: [[Flat; 4]; 2] = [
    [[-0.21, 0.0], [4.3, 0.0], [4.3, 0.45], [-0.75, 0.45]],
    [[-0.75, 0.33], [-0.66, 0.28], [-0.6, 0.19], [-0.32, 0.17]],
];

// Shape the columns and their ornaments
fn column(r: f64, height: f64, sides: usize) -> Solid {
    let n = sides / 8;
    let (foot, neck) = (0.6 * r, height - 0.9 * r);
    let mut profile = torus(1.12 * r, 0.25 * r, 0.25 * r, n);
    for i in 0..=n {
        let t = i as f64 / n as f64;
        let y = foot + (neck - foot) * t;
        profile.push([r * (1.0 - t * t / 6.0), y]);
    }
    profile.extend(torus(0.85 * r, 0.09 * r, neck + 0.12 * r, n / 2));
    // Spread the capital above the neck
    let [base, spread] = [height - 0.45 * r, 0.42 * r];
    profile.push([0.83 * r, base]);
    for &[x, y] in &semicircle(2 * n)[1..=n] {
        let out = 0.83 * r + spread * y;
        profile.push([out, base + 0.45 * r * (1.0 + x)]);
    }
    lathe(&profile, sides)
}

// Draw the profile of a torus
fn torus(radius: f64, bulge: f64, y: f64, steps: usize) -> Vec<Flat> {
    let out = |[x, z]: Flat| [radius + bulge * z, y + bulge * x];
    semicircle(steps).into_iter().map(out).collect()
}

// Turn the smaller ornaments
fn baluster() -> Solid {
    let foot = [[0.06, 0.0], [0.05, 0.1], [0.08, 0.24]];
    let neck = [[0.035, 0.5], [0.06, 0.58], [0.06, 0.72]];
    lathe(&[foot, neck].concat(), 8)
}

fn roundel() -> Solid {
    let disc = [[0.34, -0.1], [0.34, 0.06], [0.3, 0.09], [0.24, 0.04]];
    let boss = [[0.14, 0.05], [0.1, 0.11], [0.04, 0.13]];
    let flat = lathe(&[&disc[..], &boss].concat(), 16);
    flat.moved(|[x, y, z]| [x, z, -y])
}

// Collect the solids of the court
#[derive(Default)]
struct Court {
    solids: Vec<Solid>,
    /// Quarter turns that take the side at +z to the one being built.
    turn: usize,
}

impl Court {
    // Put a solid in its place
    fn add(&mut self, name: &str, at: Point, solid: Solid) {
        let turn = self.turn;
        let shift = |p: Point| [p[0] + at[0], p[1] + at[1], p[2] + at[2]];
        let mut solid = solid.moved(|p| turned(shift(p), turn));
        solid.name = format!("{name}.{}", self.solids.len() + 1);
        self.solids.push(solid);
    }

    // Lay the ground and the paving
    fn ground(&mut self) {
        let [x, z] = HALF.map(|h| [-h - 5.0, h + 5.0]);
        self.add("ground", [0.0; 3], block(x, [-0.5, -0.03], z));
        let slab = [-0.442, 0.442];
        for i in 0..26 {
            for k in 0..10 {
                let x = (i as f64 - 12.5) * 0.9;
                let z = (k as f64 - 4.5) * 0.9;
                let paver = block(slab, [-0.1, 0.0], slab);
                self.add("paver", [x, 0.0, z], paver);
            }
        }
    }

    // Run all courses around the court
    fn courses(&mut self) {
        let [lower, upper] = [0, 1].map(|i| STOREYS[i].spring + 1.8);
        let raised = |profile: &[[Flat; 4]], by: f64| {
            moulding(HALF, &profile.concat())
                .moved(|[x, y, z]| [x, y + by, z])
        };
        let roof = upper + 0.45;
        let courses = [
            ("step", course([-0.87, 0.0], [-0.2, 0.15])),
            ("gallery", course([-0.52, 3.5], [-0.3, 0.3])),
            ("wall", course([3.325, 4.0], [-0.25, upper + 0.15])),
            ("string", raised(&STRING_COURSE, lower)),
            ("rail", course([-0.16, 0.16], [5.45, 5.62])),
            ("rail", course([-0.17, 0.17], [6.3, 6.42])),
            ("cornice", raised(&CORNICE, upper)),
            ("parapet", course([-0.2, 0.2], [roof - 0.05, roof + 0.5])),
            ("coping", course([-0.27, 0.27], [roof + 0.47, roof + 0.6])),
        ];
        for (name, solid) in courses {
            self.add(name, [0.0; 3], solid);
        }
    }

    // Build one side of the court
    fn side(&mut self) {
        let (bays, z) = (BAYS[self.turn % 2], HALF[(self.turn + 1) % 2]);
        for storey in &STOREYS {
            self.arcade(storey, bays, z);
            self.gallery(storey, bays, z);
        }
        self.balustrade(2 * bays, z);
        self.ornaments(bays, z);
    }

    // Raise the arcade of a storey
    fn arcade(&mut self, s: &Storey, bays: usize, z: f64) {
        let arches = Arches {
            count: bays * s.split,
            bay: BAY / s.split as f64,
            radius: s.radius,
            margin: 0.03,
            height: 1.95,
            steps: s.steps,
        };
        self.add("arcade", [0.0, s.spring, z], arches.wall(s.depth));
        let sunk = [0.01, 0.015][self.turn % 2];
        for k in 0..arches.count {
            let x = arches.centre(k);
            let radii = [s.radius - 0.03, s.radius + 0.13];
            let front = [-s.depth - 0.06, -s.depth + 0.1];
            let archivolt = band(radii, front, s.steps);
            self.add("archivolt", [x, s.spring - sunk, z], archivolt);
            let corner = k + 1 == arches.count;
            self.support(s, [x + arches.bay / 2.0, 0.0, z], corner);
        }
    }

    // Support the end of an arch
    fn support(&mut self, s: &Storey, at: Point, corner: bool) {
        let square = |half: f64, bottom: f64, top: f64| {
            block([-half, half], [bottom, top], [-half, half])
        };
        let top = s.spring - 0.2;
        self.add("abacus", at, square(s.abacus, top, s.spring + 0.02));
        if corner {
            let pier = square(s.pier, s.floor - 0.1, s.spring + 1.93);
            return self.add("pier", at, pier);
        }
        let (base, width) = (s.foot + 0.16, 1.45 * s.shaft);
        self.add("plinth", at, square(width, s.foot - 0.05, base));
        let column = column(s.shaft, top + 0.04 - base, s.steps);
        self.add("column", [at[0], base - 0.02, at[2]], column);
    }

    // Vault the gallery of a storey
    fn gallery(&mut self, s: &Storey, bays: usize, z: f64) {
        let one = Arches {
            count: 1,
            bay: BAY,
            radius: 1.5,
            margin: 0.15,
            height: 1.9,
            steps: s.steps,
        };
        let web = Arches { radius: 1.69, margin: 0.0, height: 1.88, ..one };
        for k in 0..=bays {
            let x = (k as f64 - bays as f64 / 2.0) * BAY;
            let rib = one.wall(0.14).moved(|p| turned(p, 1));
            self.add("rib", [x, s.spring - 0.015, z + BAY / 2.0], rib);
            let height = [s.floor - 0.15, s.spring];
            let pilaster = block([-0.22, 0.22], height, [-0.42, -0.2]);
            self.add("pilaster", [x, 0.0, z + BAY], pilaster);
            let middle = [x + BAY / 2.0, s.spring, z + BAY / 2.0];
            self.add("vault", middle, web.vault());
        }
    }

    // Set the balustrade between pedestals
    fn balustrade(&mut self, gaps: usize, z: f64) {
        let (gap, half) = (BAY / 2.0, [-0.26, 0.26]);
        for k in 1..=gaps {
            let x = (k as f64 - gaps as f64 / 2.0) * gap;
            let pedestal = block(half, [5.43, 6.48], half);
            self.add("pedestal", [x, 0.0, z], pedestal);
            for i in [-1.0, 0.0, 1.0] {
                let x = x - gap / 2.0 + 0.33 * i;
                self.add("baluster", [x, 5.6, z], baluster());
            }
        }
    }

    // Decorate one side of the court
    fn ornaments(&mut self, bays: usize, z: f64) {
        let [lower, upper] = [0, 1].map(|i| &STOREYS[i]);
        for k in 1..bays {
            let x = (k as f64 - bays as f64 / 2.0) * BAY;
            let at = [x, lower.spring + 1.25, z - lower.depth];
            self.add("roundel", at, roundel());
        }
        let base = upper.spring + 1.8;
        for k in 2..12 * bays - 1 {
            let x = (k as f64 / 12.0 - bays as f64 / 2.0) * BAY;
            let (wide, high) = ([-0.07, 0.07], [0.07, 0.195]);
            let dentil = block(wide, high, [-0.49, -0.24]);
            self.add("dentil", [x, base, z], dentil);
        }
    }

    // Set the fountain in the middle
    fn fountain(&mut self) {
        let outside = [[1.7, -0.02], [1.7, 0.15], [1.5, 0.16], [1.45, 0.5]];
        let inside = [[1.6, 0.55], [1.6, 0.65], [1.35, 0.65], [1.35, 0.2]];
        let basin = lathe(&[outside, inside].concat(), 8);
        self.add("basin", [0.0; 3], basin);
        let stem = [[0.4, 0.12], [0.4, 0.3], [0.25, 0.4], [0.16, 0.9]];
        let under = [[0.2, 1.3], [0.55, 1.42], [0.85, 1.62], [0.85, 1.68]];
        let bowl = [[0.75, 1.68], [0.5, 1.54], [0.15, 1.48], [0.12, 1.9]];
        let knob = [[0.12, 1.9], [0.16, 1.98], [0.14, 2.03], [0.06, 2.06]];
        let stem = lathe(&[stem, under, bowl, knob].concat(), 32);
        self.add("fountain", [0.0; 3], stem);
    }
}

/// Builds the scene; the same solids in the same order every time.
pub fn solids() -> Vec<Solid> {
    let mut court = Court::default();
    court.ground();
    court.courses();
    for turn in 0..4 {
        court.turn = turn;
        court.side();
    }
    court.turn = 0;
    court.fountain();
    court.solids
}

/// The view of the court in the book, with y upwards.
pub fn view() -> View {
    View {
        position: DVec3::new(12.2, 2.4, 1.3),
        target: DVec3::new(-12.6, 6., -1.2),
        up: DVec3::Y,
        fov: 70.,
    }
}

/// The court as a reader of its OBJ has it, with rounded coordinates.
pub fn mesh() -> Mesh {
    let mut obj = vec![];
    write_obj(&solids(), &mut obj).expect("memory can be written");
    read_obj(&obj).expect("the court is an OBJ")
}
