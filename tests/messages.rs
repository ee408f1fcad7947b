// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What the user of `pt` reads on standard error.

use crate::prelude::*;

use litpt::cli::progress;

/// Runs a line of the shell, in which `$PT` is `pt`, on a terminal; its output
/// and its messages come as one text. None where there is no program `script`
/// to make a terminal.
fn on_a_terminal(place: &Scratch, line: &str) -> Option<String> {
    let mut command = place.command("script");
    command.args(["-qec", line, "/dev/null"]);
    let Ok(child) = command.spawn() else {
        skip("there is no program script");
        return None;
    };
    Some(String::from_utf8(finish(Running(child)).stdout).unwrap())
}

/// Whether the text holds a sequence that sets colours or weights.
fn coloured(text: &str) -> bool {
    let digits = |c: char| c.is_ascii_digit() || c == ';';
    let mut parts = text.split("\x1b[").skip(1);
    parts.any(|part| part.trim_start_matches(digits).starts_with('m'))
}

/// The number before `unit` in a text.
fn number_before(text: &str, unit: &str) -> f64 {
    let end = text.find(unit).expect(unit);
    let word = text[..end].split_whitespace().last();
    word.unwrap_or("").parse().expect(text)
}

#[test]
fn a_summary_is_a_plain_table_of_the_end_the_image_and_the_cost() {
    let place = Scratch::new();
    let scene = format!("{} -isquare.obj -d4x3 -f", ABOVE.join(" "));
    let run = |words: &str| place.done(&format!("{scene} {words}")).stderr;
    let table = run("-n5 -r0.5 -o-");
    let lines: Vec<&str> = table.lines().collect();
    let names = ["run", "image", "render", "scene", "sky"];
    assert_eq!(lines.len(), names.len(), "{table}");
    let texts = lines.iter().zip(names).map(|(line, name)| {
        let start = format!("> {name:10}");
        line.strip_prefix(&start).unwrap_or_else(|| panic!("{line}"))
    });
    let texts: Vec<&str> = texts.collect();
    assert_eq!(texts[0], "stopped by samples; 5 of 5 spp");
    let mean = "5 spp, mean radiance 0.500000 ± 0.000000, rmse 0.000000";
    assert_eq!(texts[1], mean);
    // Each path meets the square and then the sky: two rays.
    let rays = 2. * 5. * 12.;
    assert_eq!(number_before(texts[2], " rays,"), rays);
    assert!(number_before(texts[2], " s,") >= 0.);
    assert!(texts[2].ends_with("rays/s (reference)"), "{}", texts[2]);
    assert_eq!(number_before(texts[3], " triangles"), 2.);
    for room in ["load ", "build "] {
        let (_, rest) = texts[3].split_once(room).expect(room);
        let (seconds, _) = rest.split_once(" s").expect(room);
        assert!(seconds.parse::<f64>().unwrap() >= 0.);
    }
    let quality = Quality::expecting(2, rays);
    let built = format!(" s ({quality}, {})", Isa::best());
    assert!(texts[3].ends_with(&built), "{}", texts[3]);
    assert_eq!(texts[4], "uniform, zenith z");
    // A pipe gets neither colours nor a bar, and nothing from the quiet.
    let long = run("-n2000");
    assert!(!long.contains(['\x1b', '\r', '%']), "{long}");
    assert!(!place.line("-n0").stderr.contains('\x1b'));
    assert_eq!(run("-q") + &run("--quiet -o image.png"), "");
    // An error that too few samples do not reach is told, and no failure.
    let run = place.done("-iroom.obj -d8x6 -n2 --error=1e-9 -o-");
    let line = run.stderr.lines().next().unwrap();
    assert!(line.contains("stopped by samples; 2 of 2 spp; error 0."));
    assert!(line.ends_with(", target 0.000000001 not reached"), "{line}");
}

/// A render that lasts as long as its limits say.
const LONG: &str = "$PT -i room.obj -o image.pgm -f -d 128x96 -j 1";

/// The percentages of the bars in a text, in their order.
fn percentages(text: &str) -> Vec<u32> {
    let ends = text.match_indices("% ").map(|(end, _)| &text[..end]);
    let number = |text: &str| text.rsplit(' ').next()?.parse().ok();
    ends.filter_map(number).collect()
}

#[test]
fn a_bar_begins_at_zero_and_never_goes_back_and_is_then_removed() {
    let place = Scratch::new();
    for (limit, time) in [
        ("-n 200", "to go"),
        ("--time 2", " s of 2 s, "),
        ("--error 0.02 --time 20", " s of 20 s, "),
        ("--error 0.02", "to go"),
    ] {
        let run = on_a_terminal(&place, &format!("{LONG} {limit}"));
        let Some(text) = run else { return };
        let (bars, after) = text.rsplit_once("paths/s").unwrap();
        assert!(bars.contains(time), "{limit}: {text:?}");
        assert!(bars.contains('['), "{limit}: {text:?}");
        let shown = percentages(bars);
        assert!(shown.len() > 3, "{limit}: {text:?}");
        assert!(shown.is_sorted(), "{limit}: {shown:?}");
        let first = if limit == "--time 2" { 50 } else { 1 };
        assert!(shown[0] < first, "{limit}: {shown:?}");
        let (erased, summary) = after.split_once('>').unwrap();
        assert!(erased.contains("\x1b[2K"), "{text:?}");
        assert!(summary.contains("stopped by "), "{text:?}");
    }
    // So it is if a signal ends the run.
    let run = format!(
        "{LONG} --time 60 & sleep 1; kill -TERM $!; wait $!; echo status $?"
    );
    let text = on_a_terminal(&place, &run).unwrap();
    let (bars, rest) = text.split_once("stopped by a signal").unwrap();
    assert!(!percentages(bars).is_empty(), "{text:?}");
    assert!(percentages(rest).is_empty(), "{text:?}");
    assert!(rest.trim_end().ends_with("status 143"), "{text:?}");
}

/// Numbers that are computed have six decimals at most.
#[test]
fn messages_have_few_digits() {
    let place = Scratch::with("a.mtl", "newmtl a\nKd 0.5 0.5 0.5\nd 0\n");
    let text = format!("mtllib a.mtl\nusemtl a\n{SQUARE}");
    place.put("a.obj", text);
    let run = "a.obj -n1 -fob.exr --glass=materials --direct=1 --sun=1,0,1";
    place.free(&format!("{run} --zenith=0,1,3")).told(&[
        "glass a transmits 0.918318 of",
        "zenith 0,0.316228,0.948683, sun 0.707107,0,0.707107",
    ]);
}

/// What is shown after a number of paths and seconds.
#[test]
fn progress_is_the_larger_share_of_paths_and_time() {
    let (none, all, some) = (None, Some(1000), Some(30.));
    let many = Some(u64::MAX);
    for (paths, seconds, line) in [
        ((500, none), (3., None), "[>       ] 0% 3s passed"),
        ((0, all), (0., None), "[>       ] 0% 0s passed, 7s to go"),
        ((500, all), (3., None), "[====>   ] 50% 3s passed, 7s to go"),
        ((599, all), (9., None), "[====>   ] 59% 9s passed, 7s to go"),
        ((999, all), (9., None), "[=======>] 99% 9s passed, 7s to go"),
        ((1000, all), (9., None), "[========] 100% 9s passed, 7s to go"),
        ((6000, all), (9., None), "[========] 100% 9s passed, 7s to go"),
        ((5, Some(0)), (9., None), "[========] 100% 9s passed, 7s to go"),
        ((1 << 62, many), (1., None), "[==>     ] 25% 1s passed, 7s to go"),
        ((0, none), (0., some), "[>       ] 0% 0 s of 30 s"),
        ((9, none), (12.9, some), "[===>    ] 43% 12 s of 30 s"),
        ((9, all), (12.9, some), "[===>    ] 43% 12 s of 30 s"),
        ((750, all), (13., some), "[======> ] 75% 13 s of 30 s"),
        ((760, all), (31., some), "[========] 100% 30 s of 30 s"),
        ((0, none), (0.1, Some(0.5)), "[=>      ] 20% 0 s of 0.5 s"),
    ] {
        let bar = progress::bar(progress::percent(paths, seconds), 8);
        let remains = paths.1.map(|_| Duration::from_secs(7));
        let time = progress::time(seconds, remains);
        assert_eq!(format!("{bar} {time}"), line);
    }
}

#[test]
fn a_terminal_shows_a_green_mark_and_a_red_error_unless_it_has_no_colour() {
    let place = Scratch::new();
    for (words, message, colour) in [
        ("room.obj -o a.pgm -f -n 200 -d 128x96", " run ", "\x1b[32m"),
        ("-n 0", "error:", "\x1b[31m"),
        ("-h", "Usage:", "\x1b[1m"),
    ] {
        let line = format!("$PT {words}");
        let run = on_a_terminal(&place, &line);
        let Some(text) = run else { return };
        let (mark, _) = text.split_once(message).unwrap();
        assert!(mark.contains(colour), "{text:?}");
        let run = on_a_terminal(&place, &format!("NO_COLOR=1 {line}"));
        let text = run.unwrap();
        assert!(text.contains(message) && !coloured(&text), "{text:?}");
    }
    let quiet = on_a_terminal(&place, &format!("{LONG} -q -n 200"));
    assert_eq!(quiet.unwrap(), "");
}

#[test]
fn on_a_terminal_the_image_goes_to_a_file_beside_the_scene() {
    let place = Scratch::new();
    let run = |words| on_a_terminal(&place, &format!("$PT {words}"));
    let Some(text) = run("-p0,0,0 -d9x7 -n1 room.obj") else { return };
    assert!(text.contains("file      room.png"), "{text}");
    place.holds_only(&["room.png"]);
    let image = place.get("room.png");
    place.done("room.obj -d9x7 -n1 -oa.png --exposure=auto");
    assert!(image == place.get("a.png"));
    fs::remove_file(place.path("a.png")).unwrap();
    let again = run("-p0,0,0 -d9x7 room.obj").unwrap();
    assert!(again.contains("room.png: the file exists"), "{again}");
    // Nothing is written where nothing is rendered.
    let why = run("-p0,0,0 room.obj --dry-run").unwrap();
    assert!(why.contains("background"), "{why}");
    let saved = "-p0,0,0 -d9x7 room.obj -f --checkpoint c -n2";
    assert!(run(saved).unwrap().contains("file      room.png"));
    let on = run("--resume c -n3").unwrap();
    assert!(on.contains("3 of 3 spp"), "{on}");
    let more = "-d9x7 --format=png -n3 --exposure=auto";
    let more = place.render(more);
    assert!(place.get("room.png") == more);
    // Who asks for a format wants it on the terminal.
    let pgm = run("-p0,0,0 -d9x7 room.obj -q --format=pgm").unwrap();
    assert!(pgm.starts_with("P2"), "{pgm}");
    // SingleProcess there it prints the help.
    let help = run("; echo status $?").unwrap();
    assert!(help.contains("Usage:") && help.contains("status 2"), "{help}");
}

/// An image of nothing; and an axis that is not up, which is plain where faces
/// look up that nothing closes from below.
#[test]
fn what_is_likely_a_mistake_is_warned_of() {
    let place = Scratch::new();
    let why =
        "warning: no triangle can be seen: all of the image is the sky";
    for (to, is_told) in [("0,0,99", true), ("0,0,0", false)] {
        let view = format!("-p0,0,9 -u0,1,0 -t{to} -n2 -foa.exr");
        let run = place.done(&format!("-isquare.obj {view}"));
        assert_eq!(run.stderr.contains(why), is_told, "{}", run.stderr);
    }
    // What is not rendered is told once, unless the program is quiet.
    place.put("odd.obj", format!("{SQUARE}l 1 2\nF 1 2\n"));
    let said = place.done("odd.obj -n1 -d4x3 -fox.pfm -p0,0,2").stderr;
    assert_eq!(said.matches("warning: odd.obj").count(), 1, "{said}");
    assert!(said.contains("odd.obj:6: l, the first of 2"), "{said}");
    let quiet = place.done("odd.obj -n1 -d4x3 -fqox.pfm -p0,0,2").stderr;
    assert_eq!(quiet, "");
    // A triangle that is too small beside a square.
    let speck =
        format!("{SQUARE}v 0 0 1\nv 1e-7 0 1\nv 0 1e-7 1\nf 5 6 7\n");
    place.put("speck.obj", speck);
    let run = place.done("-ispeck.obj -p0,0,2 -n1 -d4x3 -fox.pfm");
    let told =
        "warning: 1 of 3 triangles: smaller than 2^-40 of the largest";
    run.told(&[told]);
    // A floor with a table on it, without undersides; and five walls of a
    // box, which may lie on its side.
    let turned = |text: &str, by: usize| {
        let mut mesh = read_obj(text.as_bytes()).unwrap();
        for p in &mut mesh.vertices {
            p.as_mut().rotate_left(by);
        }
        obj(&mesh)
    };
    let floor = "v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nf 1 2 3 4\n\
        v 3 3 1\nv 6 3 1\nv 6 6 1\nv 3 6 1\nf 5 6 7 8\n";
    let walls = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\n\
        v 1 1 1\nv 0 1 1\nf 1 2 3 4\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\n\
        f 4 8 5 1\n";
    for (text, by, options, up) in [
        (floor, 0, "", None),
        (floor, 1, "", Some("y")),
        (floor, 2, "", Some("x")),
        (floor, 1, "-u 0,0,1", None),
        (floor, 1, "--zenith z", None),
        (floor, 1, "-u y", None),
        (walls, 1, "", None),
        (BOX, 1, "", None),
    ] {
        place.put("a.obj", turned(text, by));
        let line = format!("a.obj -n1 -d8x6 -foa.pgm {options}");
        let run = place.free(&line).succeeded();
        let said = up.map(|up| format!("; but {up} looks up: -u {up}\n"));
        assert_eq!(run.stderr.contains("looks up"), said.is_some());
        assert!(run.stderr.contains(&said.unwrap_or_default()));
    }
}

/// A line of progress that is drawn over itself fits the terminal, whatever
/// signs the name of the scene has.
#[test]
fn a_wide_name_does_not_break_the_line_of_progress() {
    let place = Scratch::new();
    let name = "長い名前の建物の模型ファイル一号🏠🏠";
    let line = format!(
        "stty cols 40 rows 24; mkfifo {name}; (sleep 0.5; cat room.obj > {name}) & \
         exec \"$PT\" {name} -d8x6 -n1 -o a.png"
    );
    let Some(text) = on_a_terminal(&place, &line) else { return };
    // Chinese, Japanese and Korean signs and pictures take two columns.
    let wide = |c: char| {
        c >= '\u{1100}' && !('\u{2000}'..='\u{2e7f}').contains(&c)
    };
    let columns = |line: &str| {
        line.chars().map(|c| 1 + usize::from(wide(c))).sum::<usize>()
    };
    let bare = |line: &str| {
        let mut parts = line.split('\x1b');
        let first = parts.next().unwrap_or_default().to_owned();
        let after = |part: &str| {
            part.split_once(char::is_alphabetic)
                .map(|(_, rest)| rest.to_owned())
        };
        parts.filter_map(after).fold(first, |line, part| line + &part)
    };
    let drawn = text.split(['\r', '\n']).map(bare);
    let drawn: Vec<_> =
        drawn.filter(|line| line.contains("reading")).collect();
    assert!(!drawn.is_empty(), "{text:?}");
    // It fills whole lines of the screen, from which it is wiped.
    assert!(drawn.iter().all(|line| columns(line) % 40 == 0), "{drawn:?}");
}
