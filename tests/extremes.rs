// Numbers of all sizes: scenes, cameras and settings at the ends of their
// ranges, each with an answer that is known.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

/// Two triangles: the square |x|, |y| <= half in the plane z = 0.
pub fn square(half: f64) -> Mesh {
    let corners = [(-1., -1.), (1., -1.), (1., 1.), (-1., 1.)];
    let corner = |(x, y)| DVec3::new(x, y, 0.) * half;
    let vertices = corners.map(corner).to_vec();
    let triangles = vec![[0, 1, 2], [0, 2, 3]];
    Mesh { vertices, triangles, ..Mesh::default() }
}

/// From above, so far away, and down to the origin.
fn above(height: f64) -> View {
    let up = DVec3::new(0., 0.1, 1.);
    View { up, ..look(DVec3::Z * height, DVec3::ZERO, 40.) }
}

const SIZE: (u32, u32) = (6, 5);

fn render(mesh: &Mesh, view: &View, rho: f64) -> Film {
    sized(mesh, view, rho, SIZE, 2, 0)
}

/// A film of so many samples; the zenith is up.
pub fn sized(
    mesh: &Mesh,
    view: &View,
    rho: f64,
    (width, height): (u32, u32),
    samples: u64,
    seed: u64,
) -> Film {
    let aspect = f64::from(width) / f64::from(height);
    let setting = Setting::new(mesh, (rho, view.up), view, aspect);
    let mut film = Film::new(width, height);
    setting.unwrap().job(seed).pass(&mut film, samples, &|_| true);
    film
}

/// Each pixel is `expected`, and certain of it.
#[track_caller]
fn assert_all(film: &Film, expected: f64, what: &str) {
    for pixel in film.rows() {
        assert_eq!(pixel.mean(), expected, "{what}");
        assert_eq!(pixel.standard_error(), 0., "{what}");
    }
}

// ------------------------------------------------------------- Coordinates

#[test]
fn a_square_of_any_size_reflects_its_share() {
    let sizes = [-300, -200, -100, -30, 0, 30, 100, 200, 300];
    let sizes = sizes.map(|e| 10f64.powi(e));
    // 1.5e308 is the largest half extent: its double is no number.
    for size in sizes.into_iter().chain([5e-324, 1e-320, 1e-310, 1.5e305]) {
        let film = render(&square(1e3 * size), &above(size), 0.7);
        assert_all(&film, 0.7, &format!("{size:e}"));
    }
}

#[test]
fn minus_zero_is_zero() {
    let mut negative = ROOM.replace(" 0 ", " -0 ");
    negative.push_str("v -0 -0 -0\n");
    assert!(negative.contains("-0 1"));
    let read = |text: &str| read_obj(text.as_bytes()).unwrap();
    let (plain, other) = (read(ROOM), read(&negative));
    let scenes = [Scene::new(&plain), Scene::new(&other)];
    // Printed, 0 and -0 differ.
    let said = scenes.map(|s| format!("{:?}", s.triangles.to_vec()));
    assert_eq!(said[0], said[1]);
    // In a flat scene the zeros stay zeros, and copies copies.
    let mut flat = square(1.);
    let below = |v: &DVec3| DVec3::new(v.x, v.y, -0.);
    let more: Vec<_> = flat.vertices.iter().map(below).collect();
    flat.vertices.extend(more);
    flat.triangles.extend([[4, 5, 6], [7, 6, 4]]);
    assert_eq!(Scene::new(&flat).triangles.to_vec().len(), 2);
    for position in [DVec3::ZERO, DVec3::splat(-0.)] {
        let film = render(&other, &View { position, ..room() }, 0.5);
        assert!(film.pixels == render(&plain, &room(), 0.5).pixels);
    }
}

// The object's underside sees the ground alone, which sees the sky but for
// the object; without the object there would be the sky.
#[test]
fn a_small_object_on_a_huge_ground_is_seen() {
    let mut mesh = square(1e9);
    let corner = DVec3::new(1., 1., 1e-3);
    let object = [DVec3::ZERO, DVec3::X, DVec3::Y];
    mesh.vertices.extend(object.map(|p| corner + p * 1e-3));
    mesh.triangles.push([4, 5, 6]);
    let target = DVec3::new(1.0003, 1.0003, 1e-3);
    let view = look(DVec3::new(1.0003, 1., 5e-4), target, 5.);
    let view = View { up: DVec3::Z, ..view };
    // The ground beside it reflects its share.
    assert_all(&render(&mesh, &above(2e-3), 0.7), 0.7, "ground");
    let film = render(&mesh, &view, 0.7);
    let bright = 0.7 * 0.7;
    assert!(film.means().all(|mean| mean > 0. && mean <= bright));
}

// ------------------------------------------------ Many in one place, quickly

/// What is done within ten seconds would take minutes, were its time
/// quadratic.
#[track_caller]
fn quickly<T>(work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    let taken = start.elapsed();
    assert!(taken < Duration::from_secs(10), "{taken:?}");
    result
}

#[test]
fn of_a_million_copies_the_first_stays_where_it_is() {
    let single = read_obj(ROOM.as_bytes()).unwrap();
    let mut many = single.clone();
    let turned = |&[a, b, c]: &[u32; 3]| [[a, b, c], [c, a, b]];
    many.triangles = single.triangles.iter().flat_map(turned).collect();
    many.triangles.extend(single.triangles.iter().rev());
    let &[a, b, c] = single.triangles.last().unwrap();
    let ways = [[a, b, c], [b, c, a], [c, a, b], [c, b, a], [a, c, b]];
    many.triangles.extend(ways.iter().cycle().take(1_000_000));
    let scene = quickly(|| Scene::new(&many));
    let expected = Scene::new(&single).triangles.to_vec();
    assert_eq!(scene.triangles.to_vec(), expected);
    let film = quickly(|| render(&many, &room(), 0.5));
    assert!(film.pixels == render(&single, &room(), 0.5).pixels);
}

#[test]
fn triangles_around_each_other_and_in_a_row_are_sorted_quickly() {
    let around =
        |k: f64| [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| p * (k + 1.));
    let in_a_row =
        |k: f64| [0., 1., 2.].map(|y| DVec3::new(k + y % 2., y, 0.));
    let numbers = |n: u32| (0..n).map(f64::from);
    let around = apart(numbers(100_000).map(around));
    for mesh in [around, apart(numbers(120_000).map(in_a_row))] {
        for quality in [Quality::FAST, Quality::THOROUGH] {
            let scene = Scene::new(&mesh);
            assert!(scene.triangles.corners.len() >= 100_000);
            quickly(|| Bvh::with(&scene, quality, Isa::best())).unwrap();
        }
    }
}

// ----------------------------------------------------------------- Cameras

#[test]
fn views_at_the_ends_of_their_ranges_see_the_square() {
    let widest = f64::from_bits(180f64.to_bits() - 1);
    for fov in [5e-324, 1e-300, 1e-9, 179.999999, widest] {
        let film = render(&square(1e12), &View { fov, ..above(1e-6) }, 0.7);
        assert_all(&film, 0.7, &format!("fov {fov:e}"));
    }
    // Along up, but for a trillionth; and at a distant target.
    let leans = [1e-12, 1e-15, 1e-300, 5e-324]
        .map(|lean| View { up: DVec3::new(lean, 0., 1.), ..above(2.) });
    let far = [1e300, 1e308, f64::MAX]
        .map(|far| View { target: -DVec3::Z * far, ..above(2.) });
    for view in leans.into_iter().chain(far) {
        let film = render(&square(1e6), &view, 0.7);
        assert_all(&film, 0.7, &format!("{view:?}"));
    }
    for near in [1e-300, 1e-310, 5e-324] {
        let view = look(DVec3::ZERO, DVec3::Z * near, 40.);
        let view = View { up: above(2.).up, ..view };
        assert_all(&render(&Mesh::default(), &view, 0.7), 1., "sky");
    }
    // The difference of position and target overflows.
    let view = View { target: -DVec3::Z * f64::MAX, ..above(f64::MAX) };
    assert_all(&render(&square(f64::MAX), &view, 0.7), 0.7, "all");
    // The square is too small to be seen; below the horizon it is dark.
    assert_all(&render(&square(1.), &view, 0.7), 0., "a point");
}

#[test]
fn images_of_one_pixel_and_of_one_long_row_see_the_square() {
    for size in [(1, 1), (16384, 1), (1, 16384)] {
        let film = sized(&square(1e6), &above(2.), 0.7, size, 2, 0);
        assert_eq!(film.area(), u64::from(size.0 * size.1));
        assert_all(&film, 0.7, &format!("{size:?}"));
    }
}

#[test]
fn along_an_axis_a_square_is_seen_from_any_distance() {
    for far in [1e6_f64, 1e20, 1e50, 1e57] {
        // Of eight pixels the middle four see the square.
        let fov = 2. * (2. / far).atan().to_degrees();
        let view = View { fov, up: DVec3::Y, ..above(far) };
        let film = sized(&square(1.), &view, 1., (8, 8), 4, 0);
        // With the sky along y, half of what leaves the square is bright.
        let mut sum = 0.;
        for (i, pixel) in (0..).zip(film.rows()) {
            let inner = |k: u32| (2..6).contains(&k);
            if inner(i % 8) && inner(i / 8) {
                assert!((0. ..=1.).contains(&pixel.mean()));
                sum += pixel.mean();
            } else {
                let sky = if i / 8 < 4 { 1. } else { 0. };
                assert_eq!(pixel.mean(), sky, "{far:e}");
            }
        }
        // Sixteen pixels, 64 coin tosses: 32 and five times 4 / 4.
        assert!((sum - 8.).abs() < 5., "{far:e}: {sum}");
    }
}

// ---------------------------------------------------- Settings of the program

#[test]
fn each_reflectivity_is_the_radiance_of_a_lone_square() {
    for rho in [0., 5e-324, 1e-16, 0.1, 0.5, 1. - 1e-16, 1.] {
        let film = render(&square(1e6), &above(2.), rho);
        for pixel in film.rows() {
            // A weight is stored in units of 2^-88.
            assert!((pixel.mean() - rho).abs() < 2f64.powi(-88), "{rho:e}");
            assert_eq!(pixel.standard_error(), 0.);
        }
    }
}

// -------------------------------------------------------------- Invariance

/// A view of the room.
fn room() -> View {
    let view = look(DVec3::ZERO, DVec3::new(0.25, 1., 0.125), 70.);
    View { up: DVec3::Z, ..view }
}

fn moved(mesh: &Mesh, view: &View, by: impl Fn(DVec3) -> DVec3) -> Film {
    let mut mesh = mesh.clone();
    mesh.vertices.iter_mut().for_each(|v| *v = by(*v));
    let (position, target) = (by(view.position), by(view.target));
    let view = View { position, target, ..*view };
    sized(&mesh, &view, 0.7, (16, 12), 4, 0)
}

/// When all is moved by an offset and scaled by a power of two, if no
/// coordinate is rounded by that.
#[test]
fn an_image_does_not_change_when_all_is_moved_and_scaled_exactly() {
    let mut mesh = read_obj(ROOM.as_bytes()).unwrap();
    // A half extent that needs one bit more than the coordinates.
    let tiny = 2f64.powi(-12);
    mesh.vertices[2].x += tiny;
    mesh.vertices[7].z += 3. * tiny;
    let large = 2f64.powi(40);
    let offsets = [
        DVec3::ZERO,
        DVec3::new(12345., -0.125, 1e6),
        DVec3::new(large, -large, 2f64.powi(39) + tiny),
        DVec3::new(-large, 3. * tiny, large),
    ];
    let here = moved(&mesh, &room(), |v| v);
    assert!(here.summary().rmse > 0., "there is something to see");
    for offset in offsets {
        for k in [-900, -200, -37, 0, 37, 200, 900] {
            let scale = 2f64.powi(k);
            let mut other = mesh.clone();
            for vertex in &mut other.vertices {
                let back = (*vertex + offset) - offset;
                assert_eq!(back, *vertex, "a sum is rounded");
                *vertex = (*vertex + offset) * scale;
            }
            let [one, other] = [&mesh, &other].map(Scene::new);
            assert_eq!(one.triangles.to_vec(), other.triangles.to_vec());
            let there = moved(&mesh, &room(), |v| (v + offset) * scale);
            assert!(here.pixels == there.pixels, "{offset}, 2^{k}");
        }
    }
}
