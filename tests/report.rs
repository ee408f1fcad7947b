// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Reports: what each kind holds, at every moment of a run, and that nobody
//! can smuggle anything into them.

use std::io::Cursor;
use std::path::Path;

use base64::prelude::{BASE64_STANDARD, Engine};
use litpt::image::Image;
use litpt::report::histogram::Histogram;
use litpt::report::{Fit, Kind, Report, SceneFacts, Step};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use roxmltree::{Document, Node};
use serde_json::{Map, Value, json};

const KINDS: [Kind; 4] = [Kind::Json, Kind::Csv, Kind::Svg, Kind::Html];

/// A step of a run whose error falls as theory wants.
fn step(spp: u64) -> Step {
    let n = spp as f64;
    let error = (spp > 1).then_some(0.4 / n.sqrt());
    Step {
        spp,
        seconds: 0.03 * n,
        rays: 1000 * spp,
        rmse: error,
        mean: 0.25,
        mean_stderr: error.map(|e| e / 10.),
        rmse_reference: None,
    }
}

fn report(steps: Vec<Step>) -> Report {
    let last = steps.last().copied();
    let mut settings = Map::new();
    settings.insert("albedo".to_owned(), json!(0.8));
    settings.insert("definition".to_owned(), json!("12x8"));
    Report {
        program: "pt 0.1.0".to_owned(),
        scene: SceneFacts {
            file: "room.obj".to_owned(),
            sha256: "00ff".to_owned(),
            triangles: 6,
        },
        settings,
        left_out: vec![],
        load_seconds: 0.125,
        build_seconds: 0.25,
        render_seconds: last.map_or(0., |step| step.seconds),
        rays: last.map_or(0, |step| step.rays),
        mean: last.map_or(f64::NAN, |step| step.mean),
        mean_stderr: last.and_then(|step| step.mean_stderr),
        rmse: last.and_then(|step| step.rmse),
        constant_pixels: 0,
        stopped: None,
        steps,
    }
}

/// The report of an ordinary run.
fn ordinary() -> Report {
    report([1, 2, 4, 8, 16, 32, 64].map(step).to_vec())
}

/// An image with errors of all sorts: known, zero and unknown.
fn image(width: u32, height: u32) -> Image {
    let pixels = 0..width * height;
    let error = |i: u32| match i % 7 {
        0 => 0.,
        1 => f64::INFINITY,
        _ => 1e-4 * f64::from(1 + i % 50),
    };
    Image {
        width,
        height,
        means: pixels.clone().map(|i| f64::from(i % 2)).collect(),
        errors: Some(pixels.map(error).collect()),
        samples: None,
        attributes: Default::default(),
    }
}

fn json_of(report: &Report) -> Value {
    let text = Kind::Json.render(report, &image(12, 8));
    serde_json::from_str(&text).unwrap()
}

fn svg_of(report: &Report) -> String {
    Kind::Svg.render(report, &image(12, 8))
}

fn html_of(report: &Report) -> String {
    Kind::Html.render(report, &image(12, 8))
}

/// The page as XML: without its first line, and with its void elements
/// closed.
fn as_xml(page: &str) -> String {
    let mut text = page.replacen("<!DOCTYPE html>", "", 1);
    for name in ["<meta ", "<img "] {
        let mut from = 0;
        while let Some(start) = text[from..].find(name) {
            let end =
                from + start + text[from + start..].find('>').unwrap();
            text.insert(end, '/');
            from = end;
        }
    }
    text
}

fn named<'a>(
    document: &'a Document,
    name: &'a str,
) -> impl Iterator<Item = Node<'a, 'a>> {
    document.descendants().filter(move |n| n.has_tag_name(name))
}

/// All the text of a document, without its tags.
fn words(document: &Document) -> String {
    let texts = document.descendants().filter(|n| n.is_text());
    texts.filter_map(|n| n.text()).collect()
}

fn number(node: Node, attribute: &str) -> f64 {
    node.attribute(attribute).unwrap().parse().unwrap()
}

#[test]
fn the_extension_chooses_the_kind() {
    let of = |name| Kind::of(Path::new(name));
    assert_eq!(of("a/b.json"), Ok(Kind::Json));
    assert_eq!(of("b.CSV"), Ok(Kind::Csv));
    assert_eq!(of("b.svg"), Ok(Kind::Svg));
    assert_eq!(of("b.html"), Ok(Kind::Html));
    for name in ["b.txt", "b", "json"] {
        let message = of(name).unwrap_err();
        assert!(message.starts_with(name), "{message}");
        assert!(
            message.contains(".json, .csv, .svg or .html"),
            "{message}"
        );
    }
}

#[test]
fn json_holds_every_key_and_number() {
    let report = ordinary();
    let json = json_of(&report);
    for key in [
        "program",
        "scene",
        "settings",
        "load_seconds",
        "build_seconds",
        "render_seconds",
        "rays",
        "mean",
        "mean_stderr",
        "rmse",
        "constant_pixels",
        "stopped",
        "steps",
        "slope_seconds",
        "slope_spp",
    ] {
        assert!(json.get(key).is_some(), "{key} is missing");
    }
    assert_eq!(json["scene"]["file"], "room.obj");
    assert_eq!(json["scene"]["sha256"], "00ff");
    assert_eq!(json["scene"]["triangles"], 6);
    assert_eq!(json["settings"]["albedo"], 0.8);
    assert_eq!(json["load_seconds"], 0.125);
    assert_eq!(json["build_seconds"], 0.25);
    assert_eq!(json["stopped"], Value::Null);
    let steps: Vec<Step> =
        serde_json::from_value(json["steps"].clone()).unwrap();
    assert_eq!(steps, report.steps);
}

#[test]
fn a_step_has_a_reference_error_only_if_there_is_a_reference() {
    let mut report = ordinary();
    let json = json_of(&report);
    assert!(json["steps"][3].get("rmse_reference").is_none());
    assert!(!html_of(&report).contains("from reference"));
    report.steps[3].rmse_reference = Some(0.125);
    let json = json_of(&report);
    assert_eq!(json["steps"][3]["rmse_reference"], 0.125);
    assert!(html_of(&report).contains("from reference"));
}

#[test]
fn what_is_not_finite_is_null_in_json_and_empty_in_csv() {
    let mut report = report(vec![step(2)]);
    report.steps[0].rmse = Some(f64::INFINITY);
    report.steps[0].mean_stderr = Some(f64::NAN);
    report.rmse = Some(f64::INFINITY);
    let json = json_of(&report);
    assert_eq!(json["rmse"], Value::Null);
    assert_eq!(json["steps"][0]["rmse"], Value::Null);
    assert_eq!(json["steps"][0]["mean_stderr"], Value::Null);
    let csv = Kind::Csv.render(&report, &image(12, 8));
    assert_eq!(csv.lines().nth(1), Some("2,0.06,2000,,0.25,,"));
    let page = html_of(&report);
    assert!(!page.contains("inf<") && !page.contains("NaN"));
}

#[test]
fn every_kind_is_valid_at_every_moment_of_a_run() {
    let all = ordinary().steps;
    for n in 0..=all.len() {
        let report = report(all[..n].to_vec());
        let texts = KINDS.map(|kind| kind.render(&report, &image(12, 8)));
        let [json, csv, svg, html] = texts;
        let json: Value = serde_json::from_str(&json).unwrap();
        assert_eq!(json["steps"].as_array().unwrap().len(), n);
        assert_eq!(csv.lines().count(), n + 1);
        let svg = Document::parse(&svg).unwrap();
        assert_eq!(svg.root_element().tag_name().name(), "svg");
        let html = as_xml(&html);
        let html = Document::parse(&html).unwrap();
        let rows = named(&html, "table").last().unwrap();
        let rows = rows.descendants().filter(|n| n.has_tag_name("tr"));
        assert_eq!(rows.count(), n + 1);
        let unknown = words(&svg).contains("No error is known yet.");
        assert_eq!(unknown, n < 2, "{n} steps");
        assert!(words(&html).contains("The run goes on"));
    }
}

#[test]
fn every_row_of_csv_has_all_columns_and_all_digits() {
    let mut report = ordinary();
    report.steps[2].seconds = 1. / 3.;
    report.steps[2].rmse = Some(1.25e-12);
    report.steps[4].rmse_reference = Some(0.1 + 0.2);
    let csv = Kind::Csv.render(&report, &image(12, 8));
    let mut lines = csv.lines();
    let header: Vec<_> = lines.next().unwrap().split(',').collect();
    assert_eq!(
        header,
        [
            "spp",
            "seconds",
            "rays",
            "rmse",
            "mean",
            "mean_stderr",
            "rmse_reference"
        ]
    );
    for (line, step) in lines.zip(&report.steps) {
        let cells: Vec<_> = line.split(',').collect();
        assert_eq!(cells.len(), header.len(), "{line}");
        let known = |cell: &str| cell.parse::<f64>().ok();
        assert_eq!(cells[0].parse(), Ok(step.spp));
        assert_eq!(known(cells[1]), Some(step.seconds));
        assert_eq!(cells[2].parse(), Ok(step.rays));
        assert_eq!(known(cells[3]), step.rmse);
        assert_eq!(known(cells[4]), Some(step.mean));
        assert_eq!(known(cells[5]), step.mean_stderr);
        assert_eq!(known(cells[6]), step.rmse_reference);
    }
}

#[test]
fn the_slope_of_a_power_law_is_found() {
    for slope in [-0.5, -0.4, -1.] {
        let point = |i| {
            let x = 1e-3 * 1.7f64.powi(i);
            (x, 0.3 * x.powf(slope))
        };
        let points: Vec<_> = (0..30).map(point).collect();
        let fit = Fit::of(&points).unwrap();
        assert!((fit.slope - slope).abs() < 1e-12, "{}", fit.slope);
        assert!(fit.stderr < 1e-12, "{}", fit.stderr);
    }
    let json = json_of(&ordinary());
    for key in ["slope_seconds", "slope_spp"] {
        let slope = json[key].as_f64().unwrap();
        assert!((slope + 0.5).abs() < 1e-12, "{key}: {slope}");
    }
}

/// With 14 points, Student's t of 12 degrees of freedom lies within one
/// standard error with probability 0.663, and within three with 0.989.
#[test]
fn a_fit_lies_within_its_standard_error_as_often_as_it_should() {
    let mut random = Pcg64::seed_from_u64(1);
    let (mut one, mut three) = (0, 0);
    let trials = 4000;
    for _ in 0..trials {
        let points: Vec<_> = (0..14)
            .map(|i| {
                let noise: f64 =
                    (0..12).map(|_| random.random::<f64>() - 0.5).sum();
                let x = 2f64.powi(i);
                (x, x.powf(-0.5) * (0.02 * noise).exp())
            })
            .collect();
        let fit = Fit::of(&points).unwrap();
        let z = (fit.slope + 0.5).abs() / fit.stderr;
        one += u32::from(z < 1.);
        three += u32::from(z < 3.);
    }
    let share = |n: u32| f64::from(n) / f64::from(trials);
    assert!((share(one) - 0.663).abs() < 0.03, "{}", share(one));
    assert!((share(three) - 0.989).abs() < 0.007, "{}", share(three));
}

#[test]
fn a_fit_needs_three_points_at_different_times() {
    let none = |points: &[(f64, f64)]| assert_eq!(Fit::of(points), None);
    none(&[]);
    none(&[(1., 1.), (2., 0.7)]);
    none(&[(0.1, 1.), (0.1, 0.7), (0.1, 0.5)]);
    assert!(Fit::of(&[(1., 1.), (2., 0.7), (4., 0.5)]).is_some());
    let json = json_of(&report([1, 2, 4, 8, 16].map(step).to_vec()));
    assert_eq!(json["slope_seconds"], Value::Null);
}

#[test]
fn steps_that_cannot_be_trusted_are_left_out_of_the_fit() {
    let mut report = ordinary();
    report.steps[1].rmse = Some(1e-6);
    report.steps[2].rmse = Some(0.);
    let mut zero = step(20);
    zero.rmse = Some(0.);
    let mut early = step(22);
    early.seconds = 0.;
    let mut unknown = step(24);
    unknown.rmse = Some(f64::INFINITY);
    report.steps.splice(5..5, [zero, early, unknown]);
    let slope = report.slope_seconds().unwrap().slope;
    assert!((slope + 0.5).abs() < 1e-12, "{slope}");
}

#[test]
fn the_drawing_shows_each_step_within_its_frame() {
    let mut report = ordinary();
    report.steps[5].rmse_reference = Some(0.3);
    report.steps[6].rmse_reference = Some(0.2);
    let svg = svg_of(&report);
    let svg = Document::parse(&svg).unwrap();
    let points = |line: Node| -> Vec<(f64, f64)> {
        let pairs = line.attribute("points").unwrap().split(' ');
        let pair = |pair: &str| {
            let (x, y) = pair.split_once(',').unwrap();
            (x.parse().unwrap(), y.parse().unwrap())
        };
        pairs.map(pair).collect()
    };
    // Two lines of the legend, then the two curves, the truth first.
    let lines: Vec<_> = named(&svg, "polyline").map(points).collect();
    let lengths: Vec<_> = lines.iter().map(Vec::len).collect();
    assert_eq!(lengths, [2, 2, 2, 6]);
    let frame = named(&svg, "rect").nth(3).unwrap();
    let (left, top) = (number(frame, "x"), number(frame, "y"));
    let right = left + number(frame, "width");
    let bottom = top + number(frame, "height");
    for (x, y) in lines[2].iter().chain(&lines[3]) {
        assert!((left..right).contains(x) && (top..bottom).contains(y));
    }
    // Time runs to the right, and small errors are below.
    let steps = lines[3].windows(2);
    steps.for_each(|w| assert!(w[0].0 < w[1].0 && w[0].1 < w[1].1));
    // Errors of 0.3 and 0.2 are above those that are estimated.
    assert!(lines[2][0].1 < lines[3][4].1);
    // In equal units of both logarithms the slope is -1/2.
    let text = words(&svg);
    assert!(text.contains("slope \u{2212}0.500 \u{b1} 0.001"), "{text}");
    assert!(text.contains("guide of slope \u{2212}1/2"));
    assert!(text.contains("fewer than 8 samples"));
    assert!(text.contains("0.125 s") && text.contains("0.250 s"), "{text}");
}

/// The ends of the dotted line.
fn guide(svg: &Document) -> ((f64, f64), (f64, f64)) {
    let dotted =
        |n: &Node| n.attribute("stroke-dasharray") == Some("1.5 4");
    let line = named(svg, "line").filter(dotted).last().unwrap();
    let end = |x, y| (number(line, x), number(line, y));
    (end("x1", "y1"), end("x2", "y2"))
}

#[test]
fn the_guide_passes_through_points_that_keep_to_the_theory() {
    let svg = svg_of(&ordinary());
    let svg = Document::parse(&svg).unwrap();
    let (from, to) = guide(&svg);
    let slope = (to.1 - from.1) / (to.0 - from.0);
    // The samples of the legend lie further to the left.
    let discs = named(&svg, "circle").filter(|c| number(*c, "cx") > 70.);
    let mut points = 0;
    for disc in discs {
        let (x, y) = (number(disc, "cx"), number(disc, "cy"));
        assert!((from.1 + slope * (x - from.0) - y).abs() < 0.3);
        points += 1;
    }
    assert_eq!(points, 6);
}

#[test]
fn the_guide_ends_at_the_frame() {
    for power in [0., -0.1, -0.5, -2., -4.] {
        let steps = (0..30).map(|i| {
            let seconds = 1.5f64.powi(i);
            let rmse = Some(0.1 * seconds.powf(power));
            Step { seconds, rmse, ..step(8) }
        });
        let svg = svg_of(&report(steps.collect()));
        let svg = Document::parse(&svg).unwrap();
        let frame = named(&svg, "rect").nth(1).unwrap();
        let (left, top) = (number(frame, "x"), number(frame, "y"));
        let right = left + number(frame, "width");
        let bottom = top + number(frame, "height");
        let (from, to) = guide(&svg);
        assert!(from.0 < to.0, "{power}");
        for (x, y) in [from, to] {
            let gaps = [x - left, right - x, y - top, bottom - y];
            assert!(gaps.iter().all(|gap| *gap >= 0.), "{power}: {gaps:?}");
            assert!(gaps.iter().any(|gap| *gap < 0.2), "{power}: {gaps:?}");
        }
    }
}

#[test]
fn the_guide_has_half_the_slope_of_a_diagonal() {
    let svg = svg_of(&ordinary());
    let svg = Document::parse(&svg).unwrap();
    let ticks = |x: &str, anchor: &str| -> (f64, f64) {
        let group = named(&svg, "g").find(|g| {
            g.attribute("text-anchor") == Some(anchor)
                && g.attribute("font-size") == Some("12")
        });
        let group = group.unwrap();
        let at = |label| {
            let text = group.children().find(|t| t.text() == Some(label));
            number(text.unwrap(), x)
        };
        (at("0.1"), at("0.2"))
    };
    // The length of a factor of two along both axes.
    let (across, up) = (ticks("x", "middle"), ticks("y", "end"));
    let (across, up) = (across.1 - across.0, up.0 - up.1);
    let (from, to) = guide(&svg);
    let (dx, dy) = ((to.0 - from.0) / across, (to.1 - from.1) / up);
    assert!((dy / dx - 0.5).abs() < 0.01, "{}", dy / dx);
}

#[test]
fn labels_are_neither_missing_nor_crowded_at_any_scale() {
    for exponent in -40..=60 {
        for decades in 0..=10 {
            let first = 10f64.powf(f64::from(exponent) / 10.);
            let steps = (0..=decades).map(|i| {
                let seconds = first * 10f64.powi(i);
                let rmse = Some(0.2 / (seconds / first).sqrt());
                Step { seconds, rmse, ..step(8) }
            });
            let svg = svg_of(&report(steps.collect()));
            let svg = Document::parse(&svg).unwrap();
            let mut axes = named(&svg, "g").filter(|g| {
                g.attribute("font-size") == Some("12")
                    && g.attribute("text-anchor").is_some()
            });
            for (axis, room) in [("x", 38.), ("y", 14.)] {
                let labels = axes.next().unwrap().children();
                let places: Vec<_> =
                    labels.map(|t| number(t, axis)).collect();
                let what = format!("{axis} from {first}, {decades}");
                assert!((2..=11).contains(&places.len()), "{what}");
                let near = |w: &[f64]| (w[1] - w[0]).abs() < room;
                assert!(!places.windows(2).any(near), "{what}: {places:?}");
            }
        }
    }
}

#[test]
fn an_error_of_exactly_zero_is_said_in_words() {
    let mut report = ordinary();
    report.steps.iter_mut().for_each(|step| step.rmse = Some(0.));
    let said = "The estimated error is exactly 0 in every pixel.";
    let svg = svg_of(&report);
    assert!(svg.contains(said));
    assert!(!svg.contains("polyline"));
    report.steps[4].rmse_reference = Some(0.1);
    report.steps[5].rmse_reference = Some(0.1);
    let svg = svg_of(&report);
    assert!(svg.contains(said) && svg.contains("polyline"));
}

#[test]
fn hostile_names_stay_names() {
    let mut report = ordinary();
    let name = "<script>alert('&\"')</script>\u{1}]]>.obj";
    report.scene.file = name.to_owned();
    report.program = "<b>&".to_owned();
    report.stopped = Some("<i>".to_owned());
    report.scene.sha256 = "\"><script>".to_owned();
    report.settings.insert("<u>".to_owned(), json!("</td><script>"));
    let shown = name.replace('\u{1}', "\u{fffd}");
    let (svg, html) = (svg_of(&report), html_of(&report));
    assert!(!svg.contains("<script") && !html.contains("<script"));
    let svg = Document::parse(&svg).unwrap();
    assert!(words(&svg).contains(&shown[..20]));
    let html = as_xml(&html);
    let html = Document::parse(&html).unwrap();
    for tag in ["script", "b", "i", "u"] {
        let inside = named(&html, tag).filter(|n| n.text() != Some("0.25"));
        let inside = inside.filter(|n| tag != "b" || n.text() == Some("&"));
        assert_eq!(inside.count(), 0, "{tag}");
    }
    let heading = named(&html, "h1").next().unwrap();
    assert_eq!(heading.text(), Some(&shown[..]));
    assert!(words(&html).contains("</td><script>"));
    assert_eq!(json_of(&report)["scene"]["file"], name);
}

#[test]
fn the_page_needs_nothing_from_outside() {
    let page = html_of(&ordinary());
    for address in
        ["http:", "https:", "url(", "@import", "<link", "<script"]
    {
        assert!(!page.contains(address), "{address}");
    }
    let page = as_xml(&page);
    let page = Document::parse(&page).unwrap();
    let elements = page.descendants().filter(|n| n.is_element());
    let mut sources = 0;
    for attribute in elements.flat_map(|n| n.attributes()) {
        let external = ["src", "href", "srcset", "data", "action"];
        if external.contains(&attribute.name()) {
            assert!(
                attribute.value().starts_with("data:image/png;base64,")
            );
            sources += 1;
        }
    }
    assert_eq!(sources, 2);
    let root = page.root_element();
    assert_eq!(root.attribute("lang"), Some("en-GB"));
    assert!(named(&page, "img").all(|n| n.attribute("alt").is_some()));
    assert!(named(&page, "svg").all(|n| n.has_attribute("aria-label")));
}

#[test]
fn every_pixel_is_counted_once() {
    let image = image(40, 30);
    let errors = image.errors.as_ref().unwrap();
    let histogram = Histogram::of(errors);
    let known: u64 = histogram.counts.iter().sum();
    assert_eq!(histogram.zero, 172);
    assert_eq!(histogram.unknown, 172);
    assert_eq!(known + histogram.zero + histogram.unknown, 1200);
    let page = Kind::Html.render(&ordinary(), &image);
    let page = as_xml(&page);
    let page = Document::parse(&page).unwrap();
    let bars = named(&page, "title").filter_map(|t| t.text());
    let bars = bars.filter_map(|t| t.strip_suffix(" pixels"));
    let counts = bars.map(|t| t.rsplit(' ').next().unwrap());
    let drawn: u64 = counts.map(|n| n.parse::<u64>().unwrap()).sum();
    assert_eq!(drawn, known);
    let said = "Of 1\u{202f}200 pixels, 856 have a known error above 0, \
                172 an error of 0, and 172 an unknown one.";
    assert!(words(&page).contains(said));
}

#[test]
fn the_extremes_lie_in_the_first_and_last_bins() {
    let histogram = Histogram::of(&[1e-3, 1e-3, 1e-2, 0.1]);
    let full = histogram.counts.iter().enumerate();
    let full: Vec<_> = full.filter(|(_, n)| **n > 0).collect();
    let counts: Vec<_> = full.iter().map(|(_, n)| **n).collect();
    assert_eq!(counts, [2, 1, 1]);
    let bins: Vec<_> = full.iter().map(|(bin, _)| *bin).collect();
    assert_eq!(bins, [1, 20, 38]);
    assert_eq!(Histogram::of(&[f64::NAN, 0.]).zero, 1);
    assert_eq!(Histogram::of(&[f64::NAN, 0.]).unknown, 1);
}

/// The images of a page: width, height and levels.
fn images(page: &str) -> Vec<(u32, u32, Vec<u8>)> {
    let page = as_xml(page);
    let page = Document::parse(&page).unwrap();
    let image = |film: Node| {
        let address = film.attribute("src").unwrap();
        let text = address.strip_prefix("data:image/png;base64,").unwrap();
        let bytes = BASE64_STANDARD.decode(text).unwrap();
        let decoder = png::Decoder::new(Cursor::new(bytes));
        let mut reader = decoder.read_info().unwrap();
        let mut levels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut levels).unwrap();
        assert_eq!(info.color_type, png::ColorType::Grayscale);
        assert_eq!(info.bit_depth, png::BitDepth::Eight);
        (info.width, info.height, levels)
    };
    named(&page, "img").map(image).collect()
}

#[test]
fn the_page_shows_the_picture_and_its_errors() {
    let image = Image {
        width: 3,
        height: 1,
        means: vec![0., 1., 0.5],
        errors: Some(vec![0., 0.02, 0.01]),
        samples: None,
        attributes: Default::default(),
    };
    let page = Kind::Html.render(&ordinary(), &image);
    let shown = images(&page);
    assert_eq!(shown[0], (3, 1, vec![0, 255, 187]));
    assert_eq!(shown[1], (3, 1, vec![0, 255, 187]));
    assert!(page.contains("<span>0.0200</span>"));
}

#[test]
fn a_large_picture_is_averaged_as_radiance() {
    let image = Image {
        width: 2600,
        height: 7,
        means: (0..2600 * 7).map(|i| f64::from(i % 2600 % 3 / 2)).collect(),
        errors: Some(vec![0.5; 2600 * 7]),
        samples: None,
        attributes: Default::default(),
    };
    let page = Kind::Html.render(&ordinary(), &image);
    let shown = images(&page);
    // Squares of 3 by 3; the last column and row hold less.
    assert_eq!((shown[0].0, shown[0].1), (867, 3));
    // A third of the pixels are 1: the level of 1/3 is 156.
    let whole = shown[0].2.chunks(867).flat_map(|row| &row[..866]);
    assert!(whole.clone().all(|level| *level == 156));
    assert!(shown[1].2.iter().all(|level| *level == 255));
}

#[test]
fn without_errors_the_page_says_so() {
    let mut image = image(12, 8);
    image.errors = None;
    let page = Kind::Html.render(&ordinary(), &image);
    assert_eq!(images(&page).len(), 1);
    assert!(page.contains("and 96 an unknown one."));
    image.errors = Some(vec![0.; 96]);
    let page = Kind::Html.render(&ordinary(), &image);
    assert_eq!(images(&page).len(), 1);
    assert!(page.contains("96 an error of 0,"));
}

#[test]
fn the_page_says_in_words_how_the_run_went() {
    let mut report = ordinary();
    report.mean = 0.43124;
    report.mean_stderr = Some(0.0018);
    report.rmse = Some(0.01234);
    report.render_seconds = 754.;
    report.constant_pixels = 1234567;
    report.stopped = Some("time".to_owned());
    let page = as_xml(&html_of(&report));
    let page = Document::parse(&page).unwrap();
    let text = words(&page);
    for phrase in [
        "6 triangles",
        "12\u{202f}\u{d7}\u{202f}8 pixels",
        "64 samples",
        "in 12 min 34 s",
        "taken 0.125 s and building its hierarchy 0.250 s",
        "is 0.4312 \u{b1} 0.0018, where",
        "square error of 0.0123.",
        "In 1\u{202f}234\u{202f}567 pixels all samples were alike",
        "ended because the time allowed was over.",
        "of \u{2212}0.500 \u{b1} 0.001 against seconds",
    ] {
        assert!(text.contains(phrase), "{phrase}");
    }
}
