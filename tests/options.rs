// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The options of `pt`: defaults, forms, wrong values, help, reproducibility.

use crate::prelude::*;

use litpt::cli::options::{Error, Options};

// ------------------------------------------------------- Words and options

fn parse(words: &[&str]) -> Result<Plan, Error> {
    Options::parse([&["pt"], words].concat())?.plan(None, false)
}

#[track_caller]
fn parsed(words: &[&str]) -> Plan {
    parse(words).unwrap_or_else(|error| panic!("{words:?}: {error:?}"))
}

/// The plan of a run that goes on from another.
fn resumed(words: &[&str], saved: &Plan) -> Result<Plan, Error> {
    let words = [&["pt", "--resume=d"], words].concat();
    Options::parse(words)?.plan(Some(saved), false)
}

/// What is told of wrong usage.
#[track_caller]
pub fn usage<T>(result: Result<T, Error>) -> String {
    match result {
        Err(Error::Usage(line)) => line,
        _ => panic!("no wrong usage"),
    }
}

/// Wrong usage, which is told in one line with each of the texts.
#[track_caller]
fn refused(words: &[&str], texts: &[&str]) {
    let line = usage(parse(words));
    assert_eq!(line.lines().count(), 1, "{line}");
    assert!(line.ends_with(" (see pt --help)"), "{line}");
    says(&line, texts);
}

/// What is as the other would be in a checkpoint.
fn saved(words: &[&str]) -> String {
    json!(parsed(words).saved("/".as_ref())).to_string()
}

/// Each option that has a value and a default: its short form, its long
/// form, the default, and another value.
const DEFAULTS: [[&str; 4]; 8] = [
    ["-d", "--resolution", "320x240", "321x240"],
    ["-n", "--spp", "1", "2"],
    ["-p", "--position", "0,0,0", "0,0.5,0"],
    ["-t", "--target", "0,1,0", "0,1,-0.1"],
    ["-u", "--up", "0,0,1", "0.1,0,1"],
    ["-F", "--fov", "70", "71"],
    ["-r", "--albedo", "1", "0.5"],
    ["-s", "--seed", "0", "1"],
];

#[test]
fn a_default_given_explicitly_changes_nothing() {
    let meant = |words: &[&str]| {
        let mut plan = parsed(&[&["-p0,0,0"], words].concat());
        plan.up = plan.up.or(Some(DVec3::Z));
        plan
    };
    let typed = meant(&[]);
    for [short, long, default, other] in DEFAULTS {
        let option = format!("{long}={default}");
        assert!(meant(&[short, default]) == typed, "{short}");
        assert!(meant(&[long, default]) == typed, "{long}");
        assert!(meant(&[&option]) == typed, "{option}");
        assert!(meant(&[short, other]) != typed, "{other}");
    }
    for (alias, name, value) in [
        ("--definition", "--resolution", "9x7"),
        ("--realisations", "--spp", "3"),
        ("--reflectivity", "--albedo", "0.5"),
    ] {
        assert_eq!(saved(&[alias, value]), saved(&[name, value]));
    }
}

/// Values of an option that are refused, for the reason that is told.
#[test]
fn a_value_that_is_almost_right_is_refused() {
    let table = [
        ("-d --resolution", "800x600x3|0x5|5x0|16385x1|800|x|8x|x6", ""),
        ("-d --resolution", "8X6|8x6 |8 x 6|8.0x6|8e2x6|+8x6|8x+6", ""),
        ("-d --resolution", "0x10x4||-1x2|1x-2", ""),
        ("--crop", "1,2|1,2,3|1,2,3x4x5|-1,2,3x4|1,2,0x4", ""),
        ("--crop", "a,2,3x4|+1,2,3x4", ""),
        ("-n --spp", "0|-3", ""),
        ("-n -s -j", "1.5|1e3|abc|+3||-1", "in digits"),
        ("-n -s -j", "18446744073709551616", "is larger than"),
        ("--samples", "4..3|4|0..x|..4|+0..2|0..+2", "as in 16..32"),
        ("--tiles", "0/4|5/4|5|1/2/3|+1/2|1/+2", "as in 2/8"),
        ("-p -t -u", "1,2|1,2,3,4|-1,-2", "three reals"),
        ("-p -t -u", "1,2,|1 2 3|a,b,c|1,,3|-|", "a real number"),
        ("-p -t -u", "nan,0,0|0,inf,0|0,0,-inf|1e999,0,0", "finite"),
        ("-F -r --time --error", "nan|inf|1e999", "finite"),
        ("-F -r --time --error", "a||0,5|50%%", "a real number"),
        ("-F --time", "50%", "a real number"),
        ("-F --fov", "0|180|-10|1e3", "strictly between 0 and 180"),
        ("-r --albedo", "-0.1|1.1", "between 0 and 1"),
        ("--time --error --every", "0|-1", "greater than zero"),
        ("--background", "-1|2e9|1e300", "from 0 to 1e9"),
        ("-j --threads", "0|4097", "between 1 and 4096"),
        ("--isa", "sse|AVX2", ""),
        ("--integrator", "path|AUTO", "reference, sobol or gather"),
    ];
    for (options, values, reason) in table {
        for option in options.split(' ') {
            for value in values.split('|') {
                let quoted = format!("'{value}'");
                refused(&[option, value], &[&quoted, reason]);
                let joined = format!("{option}={value}");
                if option.starts_with("--") && !value.is_empty() {
                    refused(&[&joined], &[&quoted, reason]);
                }
            }
        }
    }
    refused(&["-d", "16385x1"], &["at most 16384 pixels a side"]);
    refused(&["-n", "abc"], &["'abc' is not a whole number in digits"]);
    refused(&["-n0"], &["a pixel needs at least one sample"]);
}

#[test]
fn a_value_at_the_end_of_its_range_is_accepted() {
    for words in [
        ["-d16384x1", "-d1x16384"],
        ["-F1e-9", "-F179.999"],
        ["-r0", "-r1"],
        ["-s0", "-s18446744073709551615"],
        ["-n1", "-n18446744073709551615"],
        ["-j1", "-j4096"],
        ["--time=1e-300", "--error=1e300"],
    ] {
        parsed(&words);
    }
}

#[test]
fn a_vector_may_begin_with_a_minus_sign() {
    let joined =
        ["--position=-1,-2,-.5", "--target=-2,1,-1", "--up=-1,0,9"];
    let separate = ["-p", "-1,-2,-.5", "-t", "-2,1,-1", "-u", "-1,0,9"];
    assert_eq!(saved(&joined), saved(&separate));
    let position = DVec3::new(-1., -2., -0.5);
    let plan = parsed(&joined);
    assert_eq!(plan.camera().unwrap().view(DVec3::Z).position, position);
    // Numbers are taken as people write them.
    let wide = ["-t", "1, 2, 3", "-r70%", "--ground=20%"];
    let plain = ["-t1,2,3", "-r0.7", "--ground=0.2"];
    assert_eq!(saved(&wide), saved(&plain));
    assert_eq!(parsed(&["--band=r"]).surfaces.materials, Some(true));
    let part = parsed(&["-d45x37", "--crop=17,5,20x30"]);
    let part = part.camera().unwrap().window();
    assert_eq!(part, Window { corner: (17, 5), size: (20, 30) });
}

#[test]
fn options_that_do_not_fit_together_are_refused() {
    let need = "--samples and --tiles need -n";
    for (words, text) in [
        (&["--samples=0..4"][..], need),
        (&["--tiles=1/2"], need),
        (&["--samples=0..4", "-n8", "--time=1"], need),
        (&["--tiles=1/2", "-n8", "--error=1"], need),
        (&["--samples=0..9", "-n8"], "--samples ends after"),
        (&["--tiles=1/2", "-n8", "--reference=a.exr"], "--reference"),
        (&["-d40x50", "-n8", "--tiles=5/5"], "4 rows of tiles"),
        (&["-n8", "--samples=0..0", "-oa.png"], "only learns"),
        (&["-oa.litpt", "-ob.litpt"], "a run has one state"),
        (&["-oa.litpt", "--checkpoint=b"], "a run has one state"),
        (&["--every", "5"], "--checkpoint-interval needs --checkpoint"),
        (&["--format=exr", "-oa.pgm"], "--format is for standard output"),
        (&["--checkpoint", "-"], "--checkpoint needs a file"),
        (&["--preview", "-o", "a.pfm"], "--preview needs a PNG file"),
        (&["-d9x7", "--crop=9,0,1x1"], "--crop 9,0,1x1: does not lie"),
        (&["-d9x7", "--crop=0,7,1x1"], "the image of 9x7 pixels"),
        (&["-d9x7", "--crop=8,0,2x1"], "--crop"),
        (&["-d9x7", "--crop=4294967295,0,9x1"], "--crop"),
    ] {
        refused(words, &[text]);
    }
}

#[test]
fn what_is_no_option_or_has_no_value_is_named() {
    for wrong in ["-z", "--nonsense"] {
        refused(&["-i", "room.obj", wrong], &[wrong]);
    }
    let valued = DEFAULTS.map(|[short, long, ..]| [short, long]);
    let others =
        [["-i", "--input"], ["-o", "--output"], ["-j", "--threads"]];
    for [short, long] in valued.into_iter().chain(others) {
        refused(&["-q", short], &[long]);
        refused(&["-q", long], &[long]);
    }
    refused(&["-o", "-q"], &["--output"]);
    refused(&["--albdo", "1"], &["--albdo", "a similar", "'--albedo'"]);
    refused(&["--format", "pgn"], &["'pgn'", "a similar", "'pgm'"]);
    refused(&["-p", "1,2,3", "4", "5"], &["'5'", "one word: 1,2,3"]);
    refused(&["-p", "0,1,2", "-4", "5"], &["'-4'", "one word: 1,2,3"]);
    // What is likely meant is told.
    for (words, meant) in [
        ("--error max", "--error-norm max is what it limits"),
        ("--error rms", "--error-norm rms is what it limits"),
        ("--samples 64", "-n is the number of samples"),
        ("--faces both", "--faces=both is one word"),
        ("--faces front -r0", "--faces=front is one word"),
        ("a.obj --faces back", "--faces=back is one word"),
        ("--faces both a.obj", "--faces=both is one word"),
    ] {
        let words: Vec<&str> = words.split(' ').collect();
        refused(&words, &[meant]);
    }
    // A word that is like no option suggests none.
    let line = usage(parse(&["--camera", "1"]));
    assert!(line.contains("--camera") && !line.contains("similar"));
}

#[test]
fn of_an_option_given_twice_the_last_value_counts() {
    let twice = ["-d9x7", "-n2", "-n", "3", "-q", "-q", "-f", "-f"];
    assert_eq!(saved(&twice), saved(&["-d9x7", "-n3", "-qf"]));
    for (words, name) in [
        (&["a.obj"][..], "a.obj"),
        (&["b.obj", "-i", "a.obj"], "a.obj"),
        (&["--input=b.obj", "a.obj"], "a.obj"),
        (&["-"], "-"),
        (&["-i-"], "-"),
        (&[], "-"),
    ] {
        assert_eq!(parsed(words).scene, Path::new(name));
    }
}

/// Limits and outputs may be given anew, together each; all else stays.
#[test]
fn a_resumed_run_has_its_plan_with_other_limits_and_outputs() {
    let typed = ["-n9", "--error=1", "-oa.pfm", "-oa.png", "-f", "b.obj"];
    let typed = [&typed[..], &["--checkpoint=c", "--report=r.csv"]];
    let before = parsed(&typed.concat()).saved("/there".as_ref());
    let before = before.restored();
    let files = |plan: &Plan| {
        let files = plan.outputs.files.iter();
        files.map(|(_, path)| path.clone()).collect::<Vec<_>>()
    };
    let alone = resumed(&[], &before).unwrap();
    assert_eq!(alone.budget, before.budget);
    assert_eq!(alone.scene, Path::new("/there/b.obj"));
    let new = ["/there/a.pfm", "/there/a.png", "/there/r.csv", "d"];
    assert_eq!(files(&alone), new.map(PathBuf::from));
    let old = ["/there/a.pfm", "/there/a.png", "/there/c", "/there/r.csv"];
    let old = [&old[..], &["d"]].concat();
    let replaced: Vec<_> = old.iter().map(AsRef::as_ref).collect();
    assert_eq!(alone.outputs.replaced, replaced as Vec<&Path>);
    assert!(!alone.outputs.force);
    let words = ["--time=2", "-of.pgm", "--checkpoint=e", "-qj3"];
    let more = resumed(&words, &before).unwrap();
    let timed = Budget { samples: None, time: Some(2.), error: None };
    assert_eq!(more.budget, timed);
    let names = ["f.pgm", "e", "/there/r.csv"];
    assert_eq!(files(&more), names.map(PathBuf::from));
    for (words, name) in [
        (&["-r0.5"][..], "--albedo: the run that is resumed has another"),
        (&["-s1"], "--seed"),
        (&["--points=p"], "--points"),
        (&["--preview", "-ob.pfm"], "--preview needs a PNG"),
    ] {
        says(&usage(resumed(words, &before)), &[name]);
    }
    // What is repeated as it was, or where the scene is now, is no change;
    // the part of a run stays.
    resumed(&["-u0,0,1", "--zenith=z", "-n9"], &before).unwrap();
    let part = parsed(&["-n8", "--tiles=1/2"]);
    for words in [&["-n8"][..], &["--samples=0..8"], &["--tiles=1/2"]] {
        assert_eq!(resumed(words, &part).unwrap().part, part.part);
    }
    usage(resumed(&["--time=1"], &part));
    let again = resumed(&["a.obj", "-r1", "-s0"], &before).unwrap();
    assert_eq!(again.scene, Path::new("a.obj"));
    // The state is that of the run unless another is named.
    let none = parsed(&["-oa.pfm"]);
    let plan = resumed(&[], &none).unwrap();
    assert_eq!(files(&plan), ["a.pfm", "d"].map(PathBuf::from));
}

#[test]
fn a_name_of_a_file_need_not_be_a_text() {
    let name = OsStr::from_bytes(b"\xff.obj");
    let others = ["3", "-n", "--", " [a]\n*"].map(OsStr::new);
    for name in others.into_iter().chain([name]) {
        let words = ["pt", "--"].map(OsStr::new).into_iter();
        let typed = Options::parse(words.chain([name])).unwrap();
        let plan = typed.plan(None, false).unwrap().saved("/".as_ref());
        let again: Plan = serde_json::from_value(json!(plan)).unwrap();
        assert_eq!(again.restored().scene, Path::new("/").join(name));
    }
    // It is told from the value of an option by its place.
    let values = "-n 3 -d 3x3 -p 3,2,1 --integrator sobol";
    for name in values.split(' ').skip(1).step_by(2) {
        for line in [format!("{name} {values}"), format!("{values} {name}")]
        {
            let words: Vec<&str> = line.split(' ').collect();
            assert_eq!(parsed(&words).scene, Path::new(name), "{line}");
        }
    }
}

// --------------------------------------------------------------- The help

#[test]
fn the_help_lists_every_option_with_its_default_and_the_licence() {
    let told = |word: &str| match parse(&[word]) {
        Err(Error::Help(text)) => text.to_string(),
        other => panic!("{word}: {other:?}"),
    };
    let version = concat!("pt ", env!("CARGO_PKG_VERSION"), "\n");
    assert_eq!([told("-V"), told("--version")], [version; 2]);
    let (help, long) = (told("-h"), told("--help"));
    for (long, short) in long.lines().zip(help.lines()) {
        assert_eq!(long, short);
    }
    assert_eq!(long.lines().count(), help.lines().count());
    let mut listed = vec![
        ["-o, --output", "[default: -, standard output"].map(str::to_owned),
        ["-j, --threads", "[default: all cores]"].map(str::to_owned),
    ];
    for [short, long, default, _] in DEFAULTS {
        let default = match long {
            "--position" | "--target" => "[default: ".to_owned(),
            _ => format!("[default: {default}]"),
        };
        listed.push([format!("{short}, {long}"), default]);
    }
    for [option, default] in listed {
        let found = |line: &&str| line.trim_start().starts_with(&option);
        let line = help.lines().find(found).expect(&option);
        assert!(line.contains(&default), "{line}");
    }
    let texts = "-f, --force|-q, --quiet|-h, --help|-V, --version|\
                 [default: standard input, or -]|definition|\
                 realisations|reflectivity|Usage: pt|Exit status: 0|\
                 before --error was reached|\
                 Copyright (C) 2026 litpt contributors|\
                 GNU GPL version 3 or later|NO WARRANTY";
    for text in texts.split('|') {
        assert!(help.contains(text), "{text}");
    }
}

// -------------------------------------------------------------- The images

#[test]
fn the_options_reach_the_image() {
    let place = Scratch::new();
    let film = place.render("");
    assert_eq!(pgm(&film).0, 320);
    for [short, _, _, other] in DEFAULTS {
        let image = place.render(&format!("{short}{other}"));
        assert!(image != film, "{other}");
    }
}

#[test]
fn a_dash_is_standard_input_or_output() {
    let place = Scratch::new();
    let image = place.render("-d9x7 --format=pfm");
    for name in ["-i-", "-"] {
        let words = format!("-d9x7 -o - --format=pfm {name}");
        let run = place.feed(ROOM.as_bytes(), &words).succeeded();
        assert!(run.stdout == image);
    }
    let report = place.line("-d9x7 -oa.pgm --report - room.obj").stdout;
    let report: serde_json::Value =
        serde_json::from_slice(&report).unwrap();
    assert_eq!(report["settings"]["resolution"][0], 9);
    for twice in [
        "-o - --report -",
        "-o /dev/stdout --report -",
        "-o /dev/fd/1 -o -",
        "--report /proc/self/fd/1 -f -q",
        "-o /dev/stdout --checkpoint /dev/fd/1",
    ] {
        let run = place.line(&format!("{twice} room.obj"));
        run.failed(1, &["standard output is named twice"]);
    }
    place.holds_only(&["a.pgm"]);
    // The image and the reference have one name, and are not the same.
    place.done("-d9x7 -s1 -otruth.pfm room.obj");
    let reference = "-d9x7 --reference=- -o- --format=pfm";
    let known = format!("{reference} room.obj");
    let known = place.feed(&place.get("truth.pfm"), &known).succeeded();
    assert!(known.stdout == image);
    let both = place.feed(ROOM.as_bytes(), reference);
    both.failed(1, &["standard input can be read once only"]);
}

// -------------------------------------------------------------- The camera

#[test]
fn a_camera_that_is_not_given_is_told_and_can_be_typed() {
    let place = Scratch::new();
    let run = |words: &str| {
        place.free(&format!("room.obj -d9x7 -n4 -u 0,0.1,1 {words}"))
    };
    for view in ["", "--view top"] {
        let sky = "--sky overcast --ground 0.5";
        let chosen = run(&format!("{sky} {view}")).succeeded();
        let said = chosen.stderr.lines().next().unwrap();
        let (_, options) =
            said.split_once("the camera stands outside: ").unwrap();
        let typed = run(&format!("{sky} {options}"));
        assert!(typed.stdout == chosen.stdout, "{options}");
        assert!(!typed.stderr.contains("outside"));
    }
    assert!(run("-q").stderr.is_empty());
    // A reference of the view that is chosen shows the same.
    run("-oa.exr -s1").succeeded();
    run("--reference a.exr").succeeded();
    run("--reference a.exr -p0,0,0").failed(1, &["a.exr", "position"]);
}

const SIDES: [Viewpoint; 6] = {
    use Viewpoint::{Back, Front, Iso, Left, Right, Top};
    [Front, Back, Left, Right, Top, Iso]
};

/// A camera that is turned and raised is where spherical coordinates say.
#[test]
fn a_view_is_turned_and_raised_by_angles() {
    let view = |words: &str, up: DVec3| {
        let plan = parsed(&["--view", words]);
        let camera = plan.camera().unwrap();
        let Stand::Outside(side, by) = camera.stand else { panic!() };
        let corners = [DVec3::ZERO, DVec3::ONE];
        let from = View { up, ..camera.view(up) };
        from.outside((side, by), up, corners.iter(), 1.).unwrap()
    };
    let away = |words: &str, up: DVec3| {
        let view = view(words, up);
        (view.position - view.target).normalize()
    };
    let sin = |degrees: f64| degrees.to_radians().sin();
    let cos = |degrees: f64| degrees.to_radians().cos();
    for (turn, rise) in [(20., 10.), (-130., -60.), (360., 89.), (0., 0.)] {
        let (east, north) = (sin(turn) * cos(rise), -cos(turn) * cos(rise));
        let z_up = DVec3::new(east, north, sin(rise));
        let y_up = DVec3::new(east, sin(rise), -north);
        let words = format!("front,{turn},{rise}");
        assert!(away(&words, DVec3::Z).distance(z_up) < 1e-3, "{words}");
        assert!(away(&words, DVec3::Y).distance(y_up) < 1e-3, "{words}");
    }
    let iso = DVec3::new(1., -1.5, 1.).normalize();
    assert!(away("iso,0,0", DVec3::Z).distance(iso) < 1e-3);
    assert_eq!(view("iso", DVec3::Z), view("iso,0,0", DVec3::Z));
    let right = away("right", DVec3::Z);
    assert!(away("front,90", DVec3::Z).distance(right) < 1e-3);
    assert!(away("left,180,0", DVec3::Z).distance(right) < 1e-3);
    // The top is lowered towards the front, which is below in its image.
    let lowered = away("top,0,-30", DVec3::Z);
    assert!(lowered.distance(away("front,0,60", DVec3::Z)) < 1e-3);
    assert_eq!(view("top,90", DVec3::Z).up.round(), -DVec3::X);
    for (words, text) in [
        ("side", "'side' is none of front, back, left, right, top and iso"),
        ("front,a", "'a' is not a real number"),
        ("front,1,2,3", "'2,3' is not a real number"),
        ("back,0,90", "raised or lowered by 89 degrees at most"),
        ("iso,0,61", "and from iso raised by 60"),
    ] {
        refused(&["--view", words], &[text]);
    }
}

/// The four planes between the eye and the edges of the image have all
/// corners on the side of its middle.
#[test]
fn a_view_from_outside_shows_the_whole_box() {
    let mut rng = Pcg64::seed_from_u64(20);
    for case in 0..1000 {
        let scale = 10f64.powi(case % 41 - 20);
        let mut point =
            || scale * DVec3::from([0; 3].map(|_| rng.random()));
        let (a, b, shift) = (point(), point(), 100. * point());
        let [low, high] = [a.min(b) - shift, a.max(b) - shift];
        let up = [DVec3::X, DVec3::Y, DVec3::Z][case as usize % 3];
        let up = up * [1., -1.][case as usize % 2];
        let (fov, aspect) =
            (1. + 170. * a.x / scale, 0.1 + 3. * b.x / scale);
        let corner = |k| {
            let is_high = [1, 2, 4].map(|bit| k & bit != 0);
            DVec3::select(is_high.into(), high, low)
        };
        let corners: Vec<DVec3> = (0..8).map(corner).collect();
        let zero = DVec3::ZERO;
        let view = View { position: zero, target: zero, up, fov };
        let side = SIDES[case as usize % 6];
        // The top can be lowered only, and a corner raised by 61 degrees.
        let rise = if side == Viewpoint::Top { -45. } else { 45. };
        let turn = 400. * a.z / scale - 200.;
        let by = [turn, rise * rng.random::<f64>()];
        let view =
            view.outside((side, by), up, corners.iter(), aspect).unwrap();
        let camera = Camera::new(&view, aspect).unwrap();
        let edges = [(0., 0.), (1., 0.), (1., 1.), (0., 1.), (0., 0.)];
        let edges = edges.map(|(x, y)| camera.direction(x, y));
        let middle = camera.direction(0.5, 0.5);
        for edge in edges.windows(2) {
            let plane = edge[0].cross(edge[1]);
            let inside = plane.dot(middle).signum();
            for corner in &corners {
                let seen = plane.dot(corner - view.position) * inside;
                assert!(seen > 0., "{case}: {view:?}");
            }
        }
    }
}
