// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Values at points, vertices and on faces, under both skies and above a
//! ground, with materials; and their tables.

use crate::prelude::*;

use std::fmt::Write;

#[allow(dead_code)]
#[path = "../examples/occlusion.rs"]
mod occlusion;

/// The columns value and error of a CSV.
fn values(csv: &[u8]) -> Vec<[f64; 2]> {
    let mut lines = str::from_utf8(csv).unwrap().lines();
    let head = lines.next().unwrap();
    assert!(head.contains(",value,stderr,samples,"));
    let at = head.split(',').position(|name| name == "value").unwrap();
    let value = |line: &str| {
        let words: Vec<&str> = line.split(',').collect();
        [words[at], words[at + 1]].map(|word| word.parse().unwrap())
    };
    lines.map(value).collect()
}

/// What the receivers of a plan get, in their order, with the errors.
fn lit(
    mesh: &Mesh,
    points: &[(DVec3, DVec3)],
    plan: &Plan,
) -> Vec<[f64; 2]> {
    let points = points.iter().copied();
    let inputs = Inputs::from(mesh.clone()).with_points(points);
    let world = World::new(plan, inputs, Host::default()).unwrap();
    values_of(&world, plan)
}

/// So many samples by a method, of surfaces of this albedo.
fn plan(
    sensor: SensorPlan,
    albedo: f64,
    (method, n): (Method, u64),
) -> Plan {
    let (method, budget) = (Some(method), Budget::samples(n));
    let mut plan = Plan { sensor, method, budget, ..Plan::default() };
    plan.surfaces.albedo = albedo;
    plan
}

fn points() -> SensorPlan {
    SensorPlan::Points("points".into())
}

fn faces(side: Side) -> SensorPlan {
    SensorPlan::Faces { side, radiosity: false }
}

fn mesh_of(text: &str) -> Mesh {
    read_obj(text.as_bytes()).unwrap()
}

/// A triangle that hardly anything sees.
const SPECK: &str = "v 0 0 0\nv 1e-3 0 0\nv 0 1e-3 0\nf 1 2 3\n";

/// Normals around all directions.
fn normals() -> Vec<DVec3> {
    let turn = |k: i32| f64::from(k) * PI / 6.;
    let tilted = |k| DVec3::new(turn(k).sin(), 0.3, turn(k).cos());
    (0..12).map(|k| tilted(k).normalize()).collect()
}

#[test]
fn points_in_the_open_get_what_sky_and_ground_give() {
    let chance = &mut Chance::default();
    let speck = &mesh_of(SPECK);
    let (at, zenith) =
        (DVec3::new(2., 3., 5.), DVec3::new(1., 2., 2.) / 3.);
    let all: Vec<_> = normals().into_iter().map(|n| (at, n)).collect();
    for (cover, ground, glow) in [
        (Cover::Uniform, None, None),
        (Cover::Overcast, None, None),
        (Cover::Sphere, None, None),
        (Cover::Uniform, Some(0.6), None),
        (Cover::Overcast, Some(1.), None),
        (Cover::Overcast, None, Some(0.3)),
    ] {
        let sky = Sky::with(zenith, cover.clone());
        assert!((sky.irradiance_ratio(zenith) - 1.).abs() < 1e-12);
        for method in Method::ALL {
            let mut plan = plan(points(), 0.5, (method, 1024));
            let up = Some(zenith);
            plan.sky = SkyPlan { zenith: up, ground, ..plan.sky };
            plan.sky.cover = cover.clone();
            plan.sky.ground_glow = glow;
            let found = lit(speck, &all, &plan);
            for (value, normal) in found.into_iter().zip(normals()) {
                let below = 0.5 - 0.5 * normal.dot(zenith);
                let below = ground.or(glow).unwrap_or(0.) * below;
                let above = sky.irradiance_ratio(normal);
                chance.judge(value, above + below, 16.);
            }
        }
    }
}

// In a sphere each patch gives the same to all others: it gets H = f / (1 -
// sum of albedo times share of area).
/// A sphere in `sphere.obj`, open over a fifth, of two paints, of which one is
/// where x is positive; and the shares of the sphere that they cover.
fn painted_sphere(place: &Scratch) -> [f64; 2] {
    let mesh = cavity(0.2, 128);
    let side = |c: &[u32; 3]| {
        c.map(|i| mesh.vertices[i as usize].x).iter().sum::<f64>() > 0.
    };
    let mut text = String::from("mtllib paint.mtl\n");
    let mut area = [0., 0.];
    text += &obj(&Mesh { triangles: vec![], ..mesh.clone() });
    for is_right in [false, true] {
        text += if is_right { "usemtl dark\n" } else { "usemtl light\n" };
        for c in mesh.triangles.iter().filter(|c| side(c) == is_right) {
            let [p, q, r] = c.map(|i| mesh.vertices[i as usize]);
            area[usize::from(is_right)] +=
                (q - p).cross(r - p).length() / 2.;
            let [a, b, c] = c.map(|i| i + 1);
            writeln!(text, "f {a} {b} {c}").unwrap();
        }
    }
    place.put("sphere.obj", text);
    let light = "newmtl light\nKd 0.9 0.9 0.9\n";
    place.put("paint.mtl", format!("{light}newmtl dark\nKd 0.2 0.3 0.4\n"));
    area.map(|area| area / (4. * PI))
}

#[test]
fn a_sphere_of_two_albedos_is_lit_as_its_equation_says() {
    let chance = &mut Chance::default();
    let place = Scratch::new();
    let parts = painted_sphere(&place);
    let rim = &cavity(0.2, 128).vertices[..256];
    place.put("point.csv", "x,y,z,nx,ny,nz\n0,0,-0.9,0,0,1\n");
    for (options, dark) in [
        ("--materials", 0.2126 * 0.2 + 0.7152 * 0.3 + 0.0722 * 0.4),
        ("--materials --band=r", 0.2),
        ("--albedo light=0.9 -r0.5", 0.5),
        ("--materials --albedo=dark=0", 0.),
    ] {
        let reflected = 0.9 * parts[0] + dark * parts[1];
        let exact = 0.2 / (1. - reflected);
        for method in ["reference", "sobol", "gather"] {
            let line = "sphere.obj --points=point.csv -n4096 --sky=uniform";
            let line = format!("{line} {options} --integrator={method}");
            let run = place.free(&line).succeeded();
            assert_eq!(run.stderr.matches("warning").count(), 0);
            let found = values(&run.stdout);
            // Half of the walls that the point sees are dark.
            let up = polygon_share(POINT, DVec3::Z, rim);
            let seen = (1. - up) * exact * (0.9 + dark) / 2. + up;
            chance.judge(found[0], seen, 16.);
        }
    }
}

/// A point that looks up in a sphere.
const POINT: DVec3 = DVec3::new(0., 0., -0.9);

/// A pyramid whose sides are equilateral triangles.
const PYRAMID: &str = "\
v 1 1 0\nv -1 1 0\nv -1 -1 0\nv 1 -1 0\nv 0 0 1.4142135623730951\n\
f 4 3 2 1\nf 5 1 2\nf 5 2 3\nf 5 3 4\nf 5 4 1\n";

/// A floor and two walls that meet in the origin.
const CORNER: &str = "\
v 0 0 0\nv 2 0 0\nv 2 2 0\nv 0 2 0\nv 0 2 2\nv 0 0 2\nv 2 0 2\n\
f 1 2 3 4\nf 1 4 5 6\nf 1 6 7 2\n";

/// Two slopes of 2 that meet along the y axis.
const VALLEY: &str = "\
v 0 0 0\nv 0 -3 0\nv 0 3 0\nv 1 -3 2\nv 1 3 2\nv -1 -3 2\nv -1 3 2\n\
f 1 2 4\nf 1 4 5\nf 1 5 3\nf 1 6 2\nf 1 7 6\nf 1 3 7\n";

// Nothing hides the half space around a normal of a convex solid. In a corner
// an octant is seen, and in a valley what is steeper than its slopes.
#[test]
fn a_vertex_gets_the_light_around_the_normal_between_its_faces() {
    let chance = &mut Chance::default();
    let open = |n: DVec3| 0.5 + 0.5 * n.normalize().z;
    let [top, bottom] = [1., -1.].map(|z| open(DVec3::new(1., 1., z)));
    // At its foot the base has an angle of 90 degrees, and two sides of 60.
    let sides = DVec3::new(2f64.sqrt(), 2f64.sqrt(), 2.) / 3f64.sqrt();
    let foot = open(60. * sides - 90. * DVec3::Z);
    let cube = BOX.replace("f 1 2 3 4\n", "f 4 3 2 1\n");
    let corners = [[bottom; 4], [top; 4]].concat();
    for (text, exact) in [
        (&*cube, &corners[..]),
        (PYRAMID, &[foot, foot, foot, foot, 1.]),
        (CORNER, &[0.1875f64.sqrt()]),
        (VALLEY, &[0.2f64.sqrt()]),
    ] {
        for method in Method::ALL {
            let plan = plan(SensorPlan::Vertices, 0., (method, 4096));
            let found = lit(&mesh_of(text), &[], &plan);
            for (found, &exact) in found.into_iter().zip(exact) {
                chance.judge(found, exact, 16.);
            }
        }
    }
}

#[test]
fn what_has_no_value_is_counted_and_named() {
    let points = "# a grid\n0 0 -1 0 0 1\n0 0 0 0 0 0\n1 4 0 0 0 1\n\
                  1e300 0 0 0 0 1\n1,1,-1;\t0 0 1\n";
    let place = Scratch::with("points.txt", points);
    let line = "room.obj --points points.txt -n64 -r0.5";
    let run = place.free(line).succeeded();
    let found = values(&run.stdout);
    let is_known: Vec<bool> =
        found.iter().map(|[value, _]| value.is_finite()).collect();
    assert_eq!(is_known, [true, false, false, false, true]);
    for told in [
        "on an edge, or too close to a surface, the first in line 4",
        "too far away, the first in line 5",
        "without a normal, the first in line 3",
    ] {
        let told =
            format!("points.txt: no value for 1 of 5 points: {told}\n");
        run.told(&[&told]);
    }
    for (text, fault) in [
        ("0 0 0 0 1\n", ":1: expected x y z nx ny nz, six numbers"),
        ("a b c d e f\n0 0 0 0 0 1\nx y\n", ":3: expected"),
        ("0 0 0 0 0 inf\n", ":1: expected"),
        (&*("0 0 0 0 0 1\n".repeat(9999) + &"x\n".repeat(9999)), ":10000:"),
        ("# nothing\n", ": no point"),
        ("0 0 0 0 0 0\n", "none of the points has a value"),
    ] {
        place.put("wrong.txt", text);
        let run = place.free("room.obj --points wrong.txt");
        assert_eq!(run.status, Some(1), "{text}");
        run.told(&[fault]);
    }
}

#[test]
fn receivers_have_tables_and_no_images() {
    let place = Scratch::with("p.txt", "0 0 0 0 0 1\n0 0 0.5 0 1 0\n");
    for (line, fault) in [
        ("--points p.txt -o a.png", "receivers have no image"),
        ("--points p.txt --report a.html -o a.csv", "receivers have none"),
        ("--points p.txt -o a.obj", "shows values of --vertices"),
        ("--points p.txt --crop 0,0,1x1", "cannot be used with"),
        ("--points p.txt --faces", "cannot be used with"),
        ("--points p.txt -p 1,2,3", "cannot be used with"),
        ("--radiosity", "required"),
        (
            "--points p.txt --tiles 1/2 -n 4",
            "not more bands than there are tiles of points: 1",
        ),
    ] {
        let run = place.free(&format!("room.obj -n16 {line}"));
        assert!(run.status.is_some_and(|status| status > 0), "{line}");
        assert!(run.stderr.contains(fault), "{line}: {}", run.stderr);
    }
    let line = "room.obj --points p.txt -n64 -o a.PLY -o a.csv";
    place.free(line).succeeded();
    let ply = place.get("a.PLY");
    let end = b"end_header\n";
    let body = ply.windows(end.len()).position(|w| w == end).unwrap();
    let body = &ply[body + end.len()..];
    // Two points of three doubles, a normal, three numbers and a colour.
    assert_eq!(body.len(), 2 * (24 + 12 + 12 + 3));
    let found = values(&place.get("a.csv"));
    let value = f32::from_le_bytes(body[36..40].try_into().unwrap());
    assert_eq!(f64::from(value) as f32, found[0][0] as f32);
    place.free("room.obj --faces=both -n64 -o b.ply").succeeded();
    let ply = place.get("b.ply");
    let ply = String::from_utf8_lossy(&ply);
    assert!(ply.contains("element vertex 36\n"));
    assert!(ply.contains("element face 12\n"));
    // An OBJ with values has the faces of its scene.
    let vertices = "room.obj --vertices -n64 -o c.csv -o c.obj";
    place.free(vertices).succeeded();
    assert!(place.text("c.csv").starts_with("vertex,x,y,z,value,"));
    let [shown, plain] = ["c.obj", "room.obj"].map(|name| place.text(name));
    let [shown, plain] =
        [shown, plain].map(|text| mesh_of(&text).triangles);
    assert_eq!(shown, plain);
}

// A sky on all sides: what is open of the hemisphere of a receiver, and 1
// among white surfaces, whichever way it looks.
#[test]
fn under_a_whole_sphere_a_vertex_has_what_its_occlusion_leaves() {
    let chance = &mut Chance::default();
    let lit = |mesh: &Mesh, all: &[_], mut plan: Plan| {
        plan.sky.cover = Cover::Sphere;
        lit(mesh, all, &plan)
    };
    let black = |mesh: &Mesh, n| {
        let plan = plan(SensorPlan::Vertices, 0., (Method::Sobol, n));
        lit(mesh, &[], plan)
    };
    // The corners of a box see all of their hemispheres, also those below.
    let outwards = BOX.replacen("f 1 2 3 4", "f 4 3 2 1", 1);
    assert_eq!(black(&mesh_of(&outwards), 16), [[1., 0.]; 8]);
    // Of two planes at a right angle, the edge sees 45 degrees on each side
    // of its normal: the sine of that, but for the ends at a thousandth.
    let valley = "v 0 -1e3 0\nv 0 0 0\nv 0 1e3 0\nv 1e3 -1e3 0\n\
        v 1e3 1e3 0\nv 0 -1e3 1e3\nv 0 1e3 1e3\n\
        f 2 1 4\nf 2 4 5\nf 2 5 3\nf 2 6 1\nf 2 7 6\nf 2 3 7\n";
    let edge = black(&mesh_of(valley), 4096)[1];
    chance.judge([edge[0], edge[1].hypot(1e-3)], 0.5f64.sqrt(), 16.);
    // White surfaces: light of radiance 1 goes everywhere, with every method.
    let room = &mesh_of(ROOM);
    let slant = DVec3::new(1., 2., -3.);
    let below = (DVec3::new(0., 3., -0.5), -DVec3::Z);
    let all = [(DVec3::Y, DVec3::Z), (DVec3::Y, slant), below];
    for method in Method::ALL {
        for value in lit(room, &all, plan(points(), 1., (method, 64))) {
            chance.judge(value, 1., 16.);
        }
    }
    // The example traces the same rays by itself.
    let mesh = cavity(0.3, 4);
    let theirs = occlusion::openness(&mesh).unwrap();
    for ([value, error], theirs) in
        black(&mesh, 256).into_iter().zip(theirs)
    {
        // Its 256 directions are a net, which errs less than chance would.
        let theirs_error = (theirs * (1. - theirs) / 256.).sqrt();
        chance.judge([value, error.hypot(theirs_error)], theirs, 16.);
    }
}

/// Whatever the width of a part of an image, its pixels are what they are in
/// the whole, by the method that the whole has, and know their neighbours.
#[test]
fn an_image_of_one_column_is_no_list_of_receivers() {
    let place = Scratch::new();
    let render = |options: &str| {
        let options =
            format!("-d40x48 -o a.exr --report a.json -f {options}");
        place.done(&format!("-iroom.obj -r0.7 -F90 {options}"));
        let settings = &place.json("a.json")["settings"];
        (settings["integrator"].clone(), place.image("a.exr"))
    };
    let (method, whole) = render("-n2");
    let (same, part) = render("-n2 --crop 9,0,1x48");
    assert_eq!(method, same);
    assert!(whole.means.iter().skip(9).step_by(40).eq(&part.means));
    // A pixel borrows variance from the pixels above and below it.
    let film = |is_list| {
        let size = (1, 3);
        let window = Window { corner: (0, 0), size };
        let mut film = Film::cropped(size, window, is_list);
        for (y, pixel) in (0..).zip(&mut film.pixels) {
            (0..4).for_each(|n| pixel.add(f64::from(n % 2 * y)));
        }
        film.errors(NEIGHBOUR_WEIGHT, window)
    };
    assert_eq!(film(true)[0], 0.);
    assert!(film(false)[0] > 0.);
}

#[test]
fn a_camera_is_no_part_of_a_run_of_receivers() {
    let place = Scratch::with("p.txt", "0 0 0 0 0 1\n1 1 0 0 0 1\n");
    let run = |options: &str| place.free(options).succeeded();
    let points = "room.obj --points p.txt -n 64 --integrator=sobol -f";
    run(&format!("{points} -o a.litpt --report a.json"));
    let settings = &place.json("a.json")["settings"];
    for name in ["resolution", "position", "target", "up", "fov"] {
        assert_eq!(settings[name], Value::Null, "{name}");
    }
    assert_eq!(settings["count"], 2);
    // A run that only learns has no sample, and says nothing of light.
    let learns = points.replace("sobol", "gather") + " --samples 0..0";
    let run_of = place.free(&format!("{learns} -o l.litpt"));
    assert!(!run_of.succeeded().stderr.contains("no light"));
}

/// A gather samples some pixels more often than others, and says which.
#[test]
fn the_samples_of_a_gather_are_those_that_it_has_allocated() {
    let place = Scratch::new();
    let gather = "-iroom.obj -r0.7 -F90 -d40x48 --integrator=gather";
    place.done(&format!("{gather} -n64 -o a.exr"));
    let counts = place.image("a.exr").samples.unwrap();
    let mean = counts.iter().sum::<f64>() / counts.len() as f64;
    assert!((mean - 64.).abs() < 0.5, "{mean}");
    let [least, most] = [f64::min, f64::max]
        .map(|f| counts.iter().copied().reduce(f).unwrap());
    assert!((16. ..64.).contains(&least) && 64. < most, "{least} {most}");
    // A part and what is merged have the same.
    place.done(&format!("{gather} -n64 --tiles 2/3 -o b.exr"));
    let part = place.image("b.exr");
    assert_eq!(part.samples.unwrap(), counts[16 * 40..32 * 40]);
    for (k, part) in ["0..32", "32..64"].iter().enumerate() {
        place.done(&format!("{gather} -n64 --samples {part} -o {k}.litpt"));
    }
    place.ptimg("merge 0.litpt 1.litpt -o c.exr").succeeded();
    assert_eq!(place.image("c.exr").samples.unwrap(), counts);
}

#[test]
fn points_are_read_from_what_spreadsheets_write_and_commas_are_no_points() {
    let read = |text: &[u8]| read_points(text, &mut vec![]);
    let point = (DVec3::new(0.5, 1., 1.5), DVec3::Z, 2);
    for meant in [
        "x,y,z,nx,ny,nz\n0.5,1,1.5,0,0,1\n",
        "\u{feff}x;y;z\r0.5; 1; 1.5; 0; 0; 1\r",
        "# 0,5;1,0\r\n.5,1,1.5 0,0,1\u{1a}",
        "\n\"0.5\",\"1\",\"1.5\",\"0\",\"0\",\"1\"\r\n\r",
        "\r\n0.5 ,1 ,1.5 ,0 ,0 ,1",
        "\r\n 0.5\t1  15E-1 0 0 1\r\n\r\n",
    ] {
        let wide = format!("\u{feff}{meant}");
        let wide = wide.encode_utf16().flat_map(u16::to_be_bytes);
        let latin = [&b"# \xdf"[..], meant.as_bytes()].concat();
        for text in [meant.as_bytes(), &wide.collect::<Vec<_>>(), &latin] {
            assert_eq!(read(text).unwrap(), [point], "{meant:?}");
        }
    }
    let faults = "0,5;1,0;1,5\n|\"0,5\",\"1,0\",\"1,5\"|0,5\t1\t1,5\t0\t1|\
                  0;0;-1,5;0;1|0,5, 1,0, 1,5|0 0 1 0 1e-3,5|\
                  0.5m 1m 2m 0m 0m 1m\r0 0 0 0 0 1";
    for fault in faults.split('|') {
        let told = read(fault.as_bytes()).unwrap_err().to_string();
        assert!(told.starts_with("line 1: "), "{told}");
        assert_eq!(told.contains("decimal"), fault.contains(','));
    }
}

/// A mesh with all of its faces the other way round.
fn inside_out(obj: &str) -> String {
    let turned = |line: &str| {
        let mut words: Vec<&str> = line.split(' ').collect();
        if words[0] == "f" {
            words[1..].reverse();
        }
        words.join(" ") + "\n"
    };
    obj.lines().map(turned).collect()
}

#[test]
fn points_that_are_not_where_they_should_be_are_told_with_their_line() {
    let points = "# of a grid\r\r0 .1 .2 1 0 0\r0 .1 1.2 0 0 1\r";
    let place = Scratch::with("p.txt", points);
    let slab =
        "v -9 -9 -1\nv 9 -9 -1\nv 9 9 -1\nv -9 9 -1\nf -4 -3 -2 -1\n";
    let body = BOX.replace("f 1 2 3 4", "f 4 3 2 1");
    let low = body.replace("f 4 3 2 1\n", "");
    // A ceiling that touches the body, as the slab does.
    let above = inside_out(&slab.replace(" -1\nv", " 1\nv"));
    let above = above.replace("9 -1\n", "9 1\n");
    for (obj, options, count) in [
        (format!("{body}{slab}"), "", 1),
        (format!("{body}{above}"), "", 1),
        (low.clone(), "--ground=0.5", 1),
        (low, "", 0),
        (body.replace("f 2 3 7 6\n", ""), "--ground=0.5", 0),
        (inside_out(&body), "", 0),
        (inside_out(slab), "", 0),
    ] {
        place.put("a.obj", &obj);
        let line = format!("a.obj --points p.txt -n16 {options}");
        let told = "p.txt: a doubtful value for 1 of 2 points: inside a \
                    closed body, the first in line 3\n";
        let run = place.free(&line);
        assert_eq!(run.stderr.matches(told).count(), count, "{obj}");
        assert_eq!(run.stderr.matches("inside").count(), count);
    }
    let list = "1 1 -1 0 0 1\n1 1 -1 0 1 -1\n1 1 2 0 0 -1\n200 1 1 0 0 1\n\
                150 1 1 0 0 1\n30 1 -1.001 0 0 1\n30 1 -1 1 0 0\n";
    place.put("a.obj", slab);
    place.put("p.txt", list);
    let bare = place.free("a.obj --points p.txt -n16").stderr;
    for told in [
        "outside by ten times the size of the scene, the first in line 4",
        "on a surface into which the normal points, the first in line 2",
    ] {
        let told = format!("a doubtful value for 1 of 7 points: {told}\n");
        assert!(bare.contains(&told), "{bare}");
    }
    // Faces that are there for both sides look no way, and vertices have
    // normals that are nobody's mistake.
    let other = "f -1 -2 -3 -4\n";
    for text in [
        format!("{slab}{other}"),
        slab.replace("f ", &format!("{other}f ")),
    ] {
        place.put("a.obj", text);
        let said = place.free("a.obj --points p.txt -n16").stderr;
        assert!(!said.contains("normal points"), "{said}");
    }
    // Light comes in through a gap that is too narrow for the rays.
    let lid = "v -1 -1 1.001\nv 1 -1 1.001\nv 1 1 1.001\nv -1 1 1.001\n";
    let open = body.replace("f 5 6 7 8\n", "");
    place.put("b.obj", format!("{open}{lid}f -4 -3 -2 -1\n"));
    place.put("q.txt", "0 .1 .2 1 0 0\n");
    let run = place.free("b.obj --points q.txt -r.9 -n4096");
    let light = values(&run.stdout)[0][0];
    assert!(light > 0. && !run.stderr.contains("inside"), "{run:?}");
    let run = place.free("a.obj --points p.txt -n16 --ground=1");
    let none = "1 of 7 points: below the ground, the first in line 6\n";
    run.told(&[none]);
    assert!(values(&run.stdout)[5][0].is_nan());
}

// A wall, part of which is there again in a group, and a face without area.
#[test]
fn faces_are_told_with_their_names_their_area_and_their_normal() {
    let place = Scratch::new();
    let wall = "v 0 0 0\nv 4 0 0\nv 4 0 2\nv 0 0 2\nf 1 2 3 4\n";
    let group = "g \"south\"\nusemtl red\nf 4 1 2\nf 1 1 2\n";
    place.put("a.obj", format!("o barn, old\n{wall}{group}"));
    let run = place.free("a.obj --faces=both -n16 -r0 -oa.csv -oa.ply");
    let none = "no value for 2 of 6 faces: without area, the first 3\n";
    assert!(run.succeeded().stderr.contains(none));
    let csv = place.text("a.csv");
    assert!(csv.starts_with("face,side,value,"));
    let lines: Vec<&str> = csv.lines().collect();
    for (line, said) in [
        (0, ",samples,object,group,area,x,y,z,nx,ny,nz,unit"),
        (1, ",16,\"barn, old\",,8,2,0,1,0,-1,0,"),
        (2, ",16,\"barn, old\",,8,2,0,1,0,1,0,"),
        (3, ",16,\"barn, old\",\"\"\"south\"\"\",4,"),
        (5, "NaN,NaN,0,\"barn, old\",\"\"\"south\"\"\",0,NaN,"),
    ] {
        assert!(lines[line].contains(said), "{}", lines[line]);
    }
    // Each triangle has corners of its own, grey or, without a value, magenta.
    let ply = place.get("a.ply");
    let corners = &ply[ply.len() - 8 * 13 - 24 * 51..];
    for (k, corner) in corners.chunks(51).take(24).enumerate() {
        let value = f32::from_le_bytes(corner[36..40].try_into().unwrap());
        let face = [0, 0, 1, 2][k / 3 % 4];
        let found = lines[1 + 2 * face + k / 12].split(',').nth(2).unwrap();
        assert_eq!(format!("{value:?}"), found);
        assert_eq!(corner[36..40], corner[44..48]);
        let grey = 255. * (1.055 * value.powf(1. / 2.4) - 0.055);
        let magenta = if value.is_nan() { 255 } else { grey as u8 };
        assert_eq!(corner[48..], [magenta, grey as u8, magenta]);
    }
}

// Threads, shards, a resumed run and sets of instructions; and the words of a
// camera change no sample.
#[test]
fn receivers_are_rendered_like_pixels() {
    let place = Scratch::new();
    let mut points = String::new();
    for i in 0..700 {
        let (x, y) = (i % 35, i / 35);
        let at = |k: i32, n: f64| 4. * f64::from(k) / n - 2.;
        writeln!(points, "{} {} 0 0 0 1", at(x, 35.), at(y, 20.)).unwrap();
    }
    place.put("p.txt", points);
    for method in ["reference", "sobol", "gather"] {
        let common = "-f room.obj --points p.txt -r0.7 -n64";
        let run = |options: &str| {
            let line = format!("{common} --integrator={method} {options}");
            place.free(&line).succeeded();
        };
        run("-j1 -oa.csv");
        for options in ["-j4", "-j2 --isa=portable"] {
            run(&format!("{options} -ob.csv"));
            assert_eq!(place.get("a.csv"), place.get("b.csv"), "{method}");
        }
        run("-F 50 --samples 0..32 -o 0.litpt");
        run("-d 7x5 --samples 32..64 --tiles 1/2 -o 1.litpt");
        run("--samples 32..64 --tiles 2/2 -o 2.litpt");
        let merge = "merge 0.litpt 1.litpt 2.litpt -f -o all";
        place.ptimg(&format!("{merge}.litpt")).succeeded();
        place.free("--resume all.litpt -F 40 -oc.csv -f").succeeded();
        assert_eq!(place.get("a.csv"), place.get("c.csv"), "{method}");
        place.ptimg(&format!("{merge}.exr")).told(&["receivers"]);
    }
}

#[test]
fn names_give_albedos_to_faces() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no table\n\
                g legs wood\nusemtl oak\nf 1 2 3\nf 1 2 3\nusemtl steel\n\
                f 1 2 3\ng top\nf 1 2 3\n";
    let mesh = read_obj(text.as_bytes()).unwrap();
    let kinds: Vec<_> = mesh.marks.iter().map(|mark| mark.kind).collect();
    use MarkKind::{Group, Material, Object};
    assert_eq!(kinds, [Object, Group, Material, Material, Group]);
    let albedos = |named: &[(&str, f64)]| {
        let all = named.iter().map(|(name, a)| (name.to_string(), *a));
        let named_albedos = all.collect();
        let named = Named { named_albedos, ..Named::default() };
        let faces = FaceAlbedos::new(&mesh.marks, &named, 0.5);
        faces.map(|faces| [0, 1, 2, 3, 4].map(|face| faces.of(face)))
    };
    let found = albedos(&[("table", 0.3), ("steel", 0.6)]).unwrap();
    assert_eq!(found, [0.5, 0.3, 0.3, 0.6, 0.6]);
    let found = albedos(&[("steel", 0.6), ("table", 0.3)]).unwrap();
    assert_eq!(found, [0.5, 0.3, 0.3, 0.3, 0.3]);
    let found = albedos(&[("wood", 0.1), ("top", 0.2)]).unwrap();
    assert_eq!(found, [0.5, 0.1, 0.1, 0.1, 0.2]);
    let fault = albedos(&[("chair", 0.1)]).unwrap_err().to_string();
    assert!(fault.contains("called chair"), "{fault}");
    let names = "oak, steel, legs wood, top, table";
    assert!(fault.ends_with(names), "{fault}");
}

// Tiles as a converter of IFC writes them: each with a name of blanks and brackets, and with normals, textures and panes.
#[test]
fn a_model_of_four_hundred_materials_is_read_as_it_is() {
    let place = Scratch::new();
    let (mut text, mut library) =
        (String::from("mtllib an ifc.mtl\r\n"), String::new());
    for k in 0..400 {
        let (x, y) = (2 * (k % 20), 2 * (k / 20));
        let name = format!("Beton {k} (C25/30) \u{fc}$");
        let clear = if k == 7 { "d 0.3\r\n" } else { "d 1\r\n" };
        let grey = f64::from(k) / 400.;
        library += &format!(
            "newmtl {name}\r\nKa 0 0 0\r\nKd {grey} {grey} {grey}\r\n\
             Ks 1 1 1\r\nNs 64\r\nillum 2\r\n{clear}\r\n"
        );
        let (a, b) = (x + 1, y + 1);
        text += &format!(
            "g 2O2Fr$t4X7Zf8NOew{k}\r\ns 1\r\nusemtl {name}\r\n\
             v {x} {y} 0\r\nv {a} {y} 0\r\nv {a} {b} 0\r\nv {x} {b} 0\r\n\
             vn 0 0 1\r\nf -4//-1 -3//-1 -2//-1 -1//-1\r\n"
        );
    }
    place.put("ifc.obj", text);
    place.put("an ifc.mtl", library);
    let named = "--albedo=2O2Fr$t4X7Zf8NOew12=0.9";
    let line = "ifc.obj --faces --radiosity --materials -n16";
    let run = place.free(&format!("{line} {named}")).succeeded();
    let found = values(&run.stdout);
    assert_eq!(found.len(), 400);
    for (k, [value, error]) in (0..).zip(found) {
        let albedo = if k == 12 { 0.9 } else { f64::from(k) / 400. };
        assert!((value - albedo).abs() < 1e-6, "{k}: {value}");
        assert!(error < 1e-6);
    }
    let told = "an ifc.mtl:63: material Beton 7 (C25/30) \u{fc}$ is transparent \
                (d, Tr), not rendered: the first of 1 statements";
    run.told(&[told]);
}

// Blocks of a model of a city: in metres of a zone of a grid of a country,
// and inside out.
#[test]
fn blocks_that_are_inside_out_have_values_on_their_backs() {
    let chance = &mut Chance::default();
    let corner = DVec3::new(690_000.25, 5_336_000.5, 512.);
    let meshes = [DVec3::ZERO, corner].map(|shift| {
        let mut text = String::new();
        for x in [0., 9.] {
            for i in 0..8 {
                let at = |bit, size| if i & bit == 0 { 0. } else { size };
                let p = DVec3::new(x + at(1, 4.), at(2, 6.), at(4, 10.));
                let p = p + shift;
                writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap();
            }
            text += "f -8 -6 -2 -4\nf -7 -3 -1 -5\nf -8 -4 -3 -7\n";
            text += "f -6 -5 -1 -2\nf -4 -2 -1 -3\n";
        }
        mesh_of(&text)
    });
    let run = |mesh: &Mesh, side| {
        let mut plan = plan(faces(side), 0.4, (Method::Sobol, 4096));
        plan.sky.ground = Some(0.2);
        lit(mesh, &[], &plan)
    };
    let [near, far] = [&meshes[0], &meshes[1]].map(|m| run(m, Side::Back));
    for (near, far) in near.iter().zip(&far) {
        // Their rays are the same to the last bits of the coordinates.
        chance.judge([near[0] - far[0], near[1].hypot(far[1])], 0., 16.);
        assert!(near[0] > 0.3 && far[0] > 0.3);
    }
    // Roofs see the sky alone, and the inside of a block sees none.
    chance.judge(near[4], 1., 16.);
    let inside = run(&meshes[0], Side::Front);
    assert!(inside.iter().all(|[value, _]| *value < 0.3), "{inside:?}");
}

// The floor is darker than the walls. Of the equations of n by n patches a
// face, narrow at its edges, with the form factors of their centres, the limit
// of 24 and 32 is 0.29676 for the floor and 0.30081 for the walls.
#[test]
fn a_room_without_a_ceiling_is_lit_as_radiosity_says() {
    let chance = &mut Chance::default();
    let text = BOX.replace("f 5 6 7 8\n", "");
    let text = text.replace("f 1 2 3 4\n", "g floor\nf 1 2 3 4\ng wall\n");
    for method in Method::ALL {
        let mut plan = plan(faces(Side::Both), 0.5, (method, 65536));
        plan.surfaces.named = vec![("floor".into(), 0.2)];
        let found = lit(&mesh_of(&text), &[], &plan);
        for (face, both) in found.chunks(2).enumerate() {
            let is_wall = face.min(1);
            let exact = [0.29676, 0.30081][is_wall];
            chance.judge(both[is_wall], exact, 16.);
        }
    }
}

// One albedo for all, whatever it is called, is the same bits; and a zenith
// turns the sky and not the image.
#[test]
fn what_means_the_same_is_the_same_image() {
    let place = Scratch::new();
    let text = place.text("room.obj");
    place.put("named.obj", format!("o all\n{text}"));
    let view = "room.obj -r0.5 -p0,-4,4 -t0,0,-1";
    let zenith =
        [" -u0,0,1", " -u0,1,0 --zenith z"].map(|u| view.to_owned() + u);
    let albedo = ["room.obj -r0.5", "named.obj --albedo all=0.5"];
    let albedo = albedo.map(String::from);
    for (pair, method) in [
        (&albedo, "reference"),
        (&albedo, "sobol"),
        (&albedo, "gather"),
        (&zenith, "auto"),
    ] {
        let [a, b] = pair.each_ref().map(|words| {
            let common = format!("-n16 -d32x24 --integrator={method}");
            place.done(&format!("{words} {common} -f -oa.pfm"));
            place.get("a.pfm")
        });
        assert!(a == b, "{method} {pair:?}");
    }
    let run = place.line("room.obj -p0,0,9 -t0,0,0 -u0,0,1 -oc.pfm");
    run.told(&["--zenith z -u 0,1,0"]);
    // Materials are not ignored without a word.
    place.put("two.obj", format!("usemtl a\n{SPECK}usemtl b\nf 1 2 3\n"));
    let run = place.done("two.obj -r0.5 -n1 -oa.pfm -f");
    let told = "two.obj: its materials are ignored, 2 of them: every surface \
                has the albedo 0.5 (--materials)";
    run.told(&[told]);
    let run = place.line("two.obj --albedo c=0.1 -ob.pfm");
    run.failed(1, &["no material, group or object is called c", "a, b"]);
}

/// The share of the sky in the hemisphere around a wall or a roof among
/// boxes, over its face: by rays that know boxes alone.
fn seen_among(
    boxes: &[[DVec3; 2]],
    own: usize,
    side: usize,
    n: u32,
) -> f64 {
    let [low, high] = boxes[own];
    let normal = [-DVec3::Y, DVec3::X, DVec3::Y, -DVec3::X, DVec3::Z][side];
    let mut open = 0;
    // An additive recurrence in four dimensions (Roberts 2018).
    let g = 1.1673039782614187f64;
    let at = |i: u32, k: i32| (0.5 + f64::from(i) * g.powi(-k)).fract();
    let axis = normal.abs().max_position();
    for i in 0..n {
        let u = [1, 2, 3, 4].map(|k| at(i, k));
        let mut share = DVec3::new(u[0], u[usize::from(axis == 2)], u[1]);
        share[axis] = 0.5 + 0.5 * normal[axis];
        let p = low + (high - low) * share;
        let d = cosine_direction(normal, u[2], u[3]);
        let hits = |&[low, high]: &[DVec3; 2]| {
            let (a, b) = ((low - p) / d, (high - p) / d);
            a.max(b).min_element() > a.min(b).max_element().max(1e-9)
        };
        let others = boxes.iter().enumerate().filter(|&(k, _)| k != own);
        let is_free = || !others.clone().any(|(_, other)| hits(other));
        open += u32::from(d.z > 0. && is_free());
    }
    f64::from(open) / f64::from(n)
}

#[test]
fn the_faces_of_a_street_see_what_rays_among_boxes_see() {
    let chance = &mut Chance::default();
    let place = Scratch::new();
    let script =
        concat!(env!("CARGO_MANIFEST_DIR"), "/doc/examples/street.sh");
    let street = std::process::Command::new("sh").arg(script).output();
    place.put("street.obj", street.unwrap().stdout);
    let run = place.free("street.obj --faces -r0 -n4096").succeeded();
    let found = values(&run.stdout);
    assert_eq!(found.len(), 250);
    let corner = |k: i32, z| {
        DVec3::new(f64::from(20 * (k % 10)), f64::from(28 * (k / 10)), z)
    };
    let size = |k: i32| DVec3::new(14., 12., f64::from(6 + k * 7 % 19));
    let boxes = (0..50).map(|k| [corner(k, 0.), corner(k, 0.) + size(k)]);
    let boxes: Vec<_> = boxes.collect();
    // The recurrence has an error too, below that of random rays.
    let rays = 4000;
    for (face, [value, error]) in found.into_iter().enumerate() {
        let exact = seen_among(&boxes, face / 5, face % 5, rays);
        let spread = (exact * (1. - exact) / f64::from(rays)).sqrt();
        let error = (error * error + spread * spread).sqrt();
        chance.judge([value, error], exact, 16.);
    }
}

// Rays from within a scene, from far outside and from the ground below it.
#[test]
fn what_is_visible_above_a_ground_is_what_is_hit_first() {
    let mut bvh = Bvh::new(&Scene::new(&cavity(0.5, 16))).unwrap();
    bvh.set_ground(Some(DVec3::Z));
    let (mut random, mut met) = (generator(3, 0, 0), [0; 3]);
    for i in 0..3000 {
        let mut point = || 0.5 * in_cube(&mut random);
        let origin = point() * [4e3, 4e4, 1e6][i % 3];
        let direction = (point() + point()).normalize();
        let ray = Ray { origin, direction };
        for from in [NONE, GROUND] {
            let hit = bvh.first_hit(&ray, Some(from));
            let first = hit.map_or(NONE, |hit| hit.primitive);
            for target in [first, NONE, GROUND, 0] {
                let is_first = bvh.is_visible(&ray, Some(from), target);
                assert_eq!(is_first, first == target, "{i} {target}");
            }
            met[first.saturating_sub(GROUND - 1).min(2) as usize] += 1;
        }
    }
    assert!(met.iter().all(|&count| count > 100), "{met:?}");
}
