// Reading and placing a scene (chapter "The scene"), and cameras.
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;
use litpt::camera::{Camera, View, ViewError};
use litpt::scene::{Scene, read_obj};

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

fn triangles(text: &str) -> Vec<[DVec3; 3]> {
    let mesh = read_obj(text.as_bytes()).unwrap();
    let place = |t: &[u32; 3]| t.map(|i| mesh.vertices[i as usize]);
    mesh.triangles.iter().map(place).collect()
}

fn complaint(text: &[u8]) -> String {
    read_obj(text).unwrap_err().within("x.obj")
}

#[test]
fn a_polygon_becomes_a_fan_around_its_first_corner() {
    let (a, b) = (DVec3::ZERO, DVec3::X);
    let (c, d) = (DVec3::new(1., 1., 0.), DVec3::Y);
    let fan = vec![[a, b, c], [a, c, d]];
    assert_eq!(triangles(&format!("{SQUARE}f 1 2 3 4\n")), fan);
    assert_eq!(triangles(&format!("{SQUARE}f -4 -3 -2 -1")), fan);
    assert_eq!(triangles(&format!("{SQUARE}f 1/7/9 2//3 3/1 4\n")), fan);
    assert_eq!(triangles(&format!("{SQUARE}f 1 2 \\\n3 4\n")), fan);
    let windows = format!("{SQUARE}f 1 2 3 4\n").replace('\n', "\r\n");
    assert_eq!(triangles(&windows), fan);
}

#[test]
fn statements_without_a_use_are_ignored() {
    let noise = "mtllib no such file.mtl\no thing\ng a b\nusemtl m\ns 1\n\
                 vt 0.5\nvn 0 0 nan\nvp 1\nl 1 2 3\np 1\ncurv 0 1 1 2\n\
                 # f 1 2\n\n";
    let text = format!("{noise}{SQUARE}{noise}f 1 2 3\n{noise}f 1 3 4\n");
    assert_eq!(triangles(&text).len(), 2);
    let latin = [b"# caf\xe9\no \xff\n", SQUARE.as_bytes(), b"f 1 2 3\n"];
    assert_eq!(read_obj(&latin.concat()).unwrap().triangles.len(), 1);
}

#[test]
fn a_fault_is_reported_with_its_line_and_its_value() {
    for (text, expected) in [
        ("v 0 0\n", "x.obj:1: a vertex without z"),
        ("v 0 zero 0\n", "x.obj:1: y = zero is no number"),
        (
            "#\nv 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
            "x.obj:2: z = nan is not finite",
        ),
        (
            "v 0 1e999 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
            "x.obj:1: y = 1e999 is not finite",
        ),
        (
            "v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 1 2 4\n",
            "x.obj:5: corner 4, but only 3 vertices",
        ),
        (
            "v 0 0 0\nv 1 0 0\nf -1 -2 -3\nv 0 1 0\n",
            "x.obj:3: corner -3, but only 2 vertices so far",
        ),
        (
            "v 0 0 0\nf 0 1 1\n",
            "x.obj:2: vertices are counted from 1, not from 0",
        ),
        ("v 0 0 0\nf 1 1 one\n", "x.obj:2: corner one is no vertex number"),
        (
            "v 0 0 0\nf 1 1 99999999999999999999\n",
            "x.obj:2: corner 99999999999999999999 is no vertex number",
        ),
        (
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2\n",
            "x.obj:5: a face of 2 corners; it needs three",
        ),
        (
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf\n",
            "x.obj:5: a face of 0 corners; it needs three",
        ),
        ("", "x.obj: the file is empty; an OBJ was expected"),
        ("# nothing\nv 0 0 0\n", "x.obj: no face, hence nothing to render"),
    ] {
        assert_eq!(complaint(text.as_bytes()), expected, "{text}");
    }
    let binary = b"v 0 0 0\n\x7fELF\0\0";
    let expected =
        "x.obj:2: a zero byte: this is a binary file, not an OBJ";
    assert_eq!(complaint(binary), expected);
    let latin = b"v 0 0 0\nv 1 0 \xe9\nf 1 1 2\n";
    assert_eq!(complaint(latin), "x.obj:2: not UTF-8 text");
}

#[test]
fn a_scene_does_not_change_when_it_is_moved_or_scaled_exactly() {
    let text = "v 0 0 0\nv 1 0 0.25\nv 0.5 3 0\nv -1 2 7\nf 1 2 3 4\n";
    let mesh = read_obj(text.as_bytes()).unwrap();
    let here = Scene::new(&mesh);
    let offset = DVec3::new(2f64.powi(40), -2f64.powi(38), 12345.);
    for scale in [1., 2f64.powi(-200), 2f64.powi(200)] {
        for shift in [DVec3::ZERO, offset] {
            let mut moved = mesh.clone();
            for v in &mut moved.vertices {
                *v = (*v + shift) * scale;
            }
            let there = Scene::new(&moved);
            assert_eq!(
                there.triangles(),
                here.triangles(),
                "{scale} {shift}"
            );
            let (from, at) =
                (DVec3::new(9., 9., 9.), -DVec3::ONE.normalize());
            let ray = here.enter(from, at).unwrap();
            let same = there.enter((from + shift) * scale, at).unwrap();
            assert_eq!(ray.origin, same.origin);
        }
    }
}

#[test]
fn a_distant_ray_enters_the_scene_or_passes_it_by() {
    let text = "v -1 -1 -1\nv 1 1 1\nv 1 -1 0\nf 1 2 3\n";
    let scene = Scene::new(&read_obj(text.as_bytes()).unwrap());
    let far = DVec3::new(1e9, 0.5, 0.5);
    let ray = scene.enter(far, -DVec3::X).unwrap();
    // The scene has half extents of 2^12; its box is one unit larger.
    assert_eq!(ray.origin, DVec3::new(4097., 2048., 2048.));
    assert!(scene.enter(far, DVec3::X).is_none());
    assert!(
        scene.enter(far, DVec3::new(-1., 1., 0.).normalize()).is_none()
    );
    let inside = scene.enter(DVec3::ZERO, DVec3::Y).unwrap();
    assert_eq!(inside.origin, DVec3::ZERO);
    // A ray in the plane of a face of the box, from a corner.
    let beside = DVec3::new(-9., 1. + 1. / 4096., 0.);
    assert!(scene.enter(beside, DVec3::X).is_some());
    assert!(scene.enter(beside + DVec3::Y, DVec3::X).is_none());
}

fn view() -> View {
    View {
        position: DVec3::new(1., 2., 3.),
        target: DVec3::new(1., 12., 3.),
        up: DVec3::Z,
        fov: 90.,
    }
}

#[test]
fn the_corners_of_the_image_are_where_the_field_of_view_puts_them() {
    let camera = Camera::new(&view(), 2.).unwrap();
    let near = |a: DVec3, b: DVec3| (a - b.normalize()).length() < 1e-15;
    assert!(near(camera.direction(0.5, 0.5), DVec3::Y));
    assert!(near(camera.direction(0., 0.), DVec3::new(-2., 1., 1.)));
    assert!(near(camera.direction(1., 1.), DVec3::new(2., 1., -1.)));
}

#[test]
fn impossible_views_are_refused_without_a_tolerance() {
    let bad = View { target: view().position, ..view() };
    assert_eq!(
        Camera::new(&bad, 1.).unwrap_err(),
        ViewError::Target(view().position)
    );
    for up in [DVec3::Y, DVec3::Y * -1e-300, DVec3::Y * 1e300, DVec3::ZERO]
    {
        let bad = View { up, ..view() };
        assert!(matches!(Camera::new(&bad, 1.), Err(ViewError::Up { .. })));
    }
    for fov in [0., 180., -1., f64::NAN] {
        let bad = View { fov, ..view() };
        let error = Camera::new(&bad, 1.).unwrap_err();
        assert!(matches!(error, ViewError::FieldOfView(_)));
    }
    let close = View { up: DVec3::new(1e-12, 1., 0.), ..view() };
    let camera = Camera::new(&close, 1.).unwrap();
    // Up leans towards x, so x is up and the right of the image is -z.
    let right = camera.direction(1., 0.5) - camera.direction(0., 0.5);
    assert!((right.normalize() + DVec3::Z).length() < 1e-9, "{right}");
}
