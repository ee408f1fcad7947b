// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Reports: what each kind holds, at every moment of a run, and that nobody
//! can smuggle anything into them.

use crate::prelude::*;

use crate::outputs::png;

use base64::prelude::{BASE64_STANDARD, Engine};
use roxmltree::{Document, Node};

/// A point of the curve of a run whose error falls as theory wants.
pub fn point(spp: u64) -> CurvePoint {
    let n = spp as f64;
    let error = (spp > 1).then_some(0.4 / n.sqrt());
    CurvePoint {
        spp,
        seconds: 0.03 * n,
        rays: 1000 * spp,
        rmse: error,
        target_error: None,
        mean: 0.25,
        mean_stderr: error.map(|e| e / 10.),
        rmse_reference: None,
        processor_seconds: None,
    }
}

fn report(curve: Vec<CurvePoint>) -> Report {
    let mut convergence = Convergence::default();
    convergence.curve = curve;
    let CurvePoint { spp, seconds, rays, .. } = convergence.last();
    (convergence.spp, convergence.seconds) = (spp, seconds);
    convergence.rays = rays;
    let settings = json!({
        "seed": 0, "integrator": "reference",
        "resolution": [320, 240], "fov": 70.5, "up": [0., 0., 1.],
        "position": [0., 0., 0.], "target": [1., 2.5, 3.],
        "albedo": 0.8, "named_albedos": [], "materials": {},
        "sky": Sky::new(DVec3::Z),
    });
    Report {
        program: "pt 0.1.0".to_owned(),
        command: "pt -i room.obj".to_owned(),
        date: "2026-01-31T23:59:59Z".to_owned(),
        processor: "abacus".to_owned(),
        scene: SceneFile {
            file: "room.obj".to_owned(),
            sha256: "00ff".to_owned(),
            triangles: 6,
        },
        settings: serde_json::from_value(settings).unwrap(),
        load_seconds: 0.125,
        build_seconds: 0.25,
        convergence,
        ..Report::default()
    }
}

/// The report of an ordinary run.
fn ordinary() -> Report {
    report([1, 2, 4, 8, 16, 32, 64].map(point).to_vec())
}

/// An image with errors of all sorts: known, zero and unknown.
fn image(width: u32, height: u32) -> Image {
    let pixels = 0..width * height;
    let error = |i: u32| match i % 7 {
        0 => 0.,
        1 => f64::INFINITY,
        _ => 1e-4 * f64::from(1 + i % 50),
    };
    let means = pixels.clone().map(|i| f64::from(i % 2)).collect();
    let errors = Some(pixels.map(error).collect());
    Image { errors, ..Image::plain(width, height, means) }
}

fn json_of(report: &Report) -> Value {
    let text = Kind::Json.render(report, &|| image(12, 8));
    serde_json::from_str(&text).unwrap()
}

fn html_of(report: &Report) -> String {
    Kind::Html.render(report, &|| image(12, 8))
}

/// Hands the page of a report to a function, as XML.
fn with_page<T>(report: &Report, work: impl Fn(&Document) -> T) -> T {
    work(&Document::parse(&as_xml(&html_of(report))).unwrap())
}

/// The page as XML: without its first line, and with its void elements
/// closed.
fn as_xml(page: &str) -> String {
    let page = page.replacen("<!DOCTYPE html>", "", 1);
    let close = |part: &str| match part.split(' ').next() {
        Some("meta" | "img") => part.replacen('>', "/>", 1),
        _ => part.to_owned(),
    };
    page.split('<').map(close).collect::<Vec<_>>().join("<")
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

/// Whether a drawing is no part of another.
fn outermost(svg: &Node) -> bool {
    !svg.ancestors().skip(1).any(|n| n.has_tag_name("svg"))
}

fn number(node: Node, attribute: &str) -> f64 {
    node.attribute(attribute).unwrap().parse().unwrap()
}

#[test]
fn the_extension_chooses_the_kind() {
    let of = |name| Kind::of(Path::new(name));
    assert_eq!(of("a/b.json").unwrap(), Kind::Json);
    assert_eq!(of("b.CSV").unwrap(), Kind::Csv);
    assert_eq!(of("b.html").unwrap(), Kind::Html);
    for name in ["b.txt", "b", "json", "b.svg"] {
        let message = of(name).unwrap_err().to_string();
        assert!(message.starts_with(name), "{message}");
        assert!(message.contains(".json, .csv or .html"), "{message}");
    }
}

#[test]
fn the_page_has_a_column_for_true_errors_if_there_are_any() {
    let (column, mut report) =
        ("<th>rmse against reference</th>", ordinary());
    assert!(!html_of(&report).contains(column));
    report.convergence.curve[3].rmse_reference = Some(0.125);
    says(&html_of(&report), &[column, "<td>0.125000</td>"]);
}

#[test]
fn what_is_not_finite_is_null_in_json_and_empty_in_csv() {
    let mut report = report(vec![point(2)]);
    report.convergence.curve[0].rmse = Some(f64::INFINITY);
    report.convergence.curve[0].mean_stderr = Some(f64::NAN);
    let json = json_of(&report);
    let point = &json["curve"][0];
    for value in [&json["rmse"], &point["rmse"], &point["mean_stderr"]] {
        assert_eq!(*value, Value::Null);
    }
    let csv = Kind::Csv.render(&report, &|| image(12, 8));
    assert_eq!(csv.lines().nth(1), Some("2,0.06,2000,,0.25,,"));
    let page = html_of(&report);
    assert!(!page.contains("inf<") && !page.contains("NaN"));
}

#[test]
fn every_kind_is_valid_at_every_moment_of_a_run() {
    let all = ordinary().convergence.curve;
    for n in 0..=all.len() {
        let report = report(all[..n].to_vec());
        assert_eq!(json_of(&report)["curve"].as_array().unwrap().len(), n);
        let csv = Kind::Csv.render(&report, &|| image(12, 8));
        assert_eq!(csv.lines().count(), n + 1);
        let html = as_xml(&html_of(&report));
        let html = Document::parse(&html).unwrap();
        let rows = named(&html, "table").last().unwrap();
        let rows = rows.descendants().filter(|n| n.has_tag_name("tr"));
        assert_eq!(rows.count(), n + 1);
        let drawings = named(&html, "svg").filter(outermost).count();
        assert_eq!(drawings, usize::from(n >= 2), "{n} points");
        assert!(words(&html).contains("Run still running"));
    }
}

#[test]
fn every_row_of_csv_has_all_columns_and_all_digits() {
    let mut report = ordinary();
    report.convergence.curve[2].seconds = 1. / 3.;
    report.convergence.curve[2].rmse = Some(1.25e-12);
    report.convergence.curve[4].rmse_reference = Some(0.1 + 0.2);
    let csv = Kind::Csv.render(&report, &|| image(12, 8));
    let mut lines = csv.lines();
    let header = "spp,seconds,rays,rmse,mean,mean_stderr,rmse_reference";
    assert_eq!(lines.next(), Some(header));
    for (line, point) in lines.zip(&report.convergence.curve) {
        let CurvePoint { spp, seconds, rays, rmse, mean, .. } = *point;
        let cells = line.split(',').map(|cell| cell.parse().ok());
        let first = [spp as f64, seconds, rays as f64].map(Some);
        let errors = [point.mean_stderr, point.rmse_reference];
        let all = [&first[..], &[rmse, Some(mean)], &errors].concat();
        assert_eq!(cells.collect::<Vec<Option<f64>>>(), all);
    }
}

#[test]
fn the_slope_of_a_power_law_is_found_from_three_points_on() {
    for expected in [-0.5, -0.4, -1.] {
        let point = |i| {
            let x = 1e-3 * 1.7f64.powi(i);
            (x, 0.3 * x.powf(expected))
        };
        let points: Vec<_> = (0..30).map(point).collect();
        let slope = slope(&points).unwrap();
        assert!((slope - expected).abs() < 1e-12, "{slope}");
    }
    // By hand: the middle one has no lever.
    let three = [(1., 0.1), (4., 0.06), (16., 0.025)];
    assert!((slope(&three).unwrap() + 0.5).abs() < 1e-12);
    assert_eq!(slope(&three[..2]), None);
    assert_eq!(slope(&[(0.1, 1.), (0.1, 0.7), (0.1, 0.5)]), None);
    let (json, mut few) = (json_of(&ordinary()), ordinary());
    few.convergence.curve.truncate(5);
    for key in ["slope_seconds", "slope_spp"] {
        let slope = json[key].as_f64().unwrap();
        assert!((slope + 0.5).abs() < 1e-12, "{key}: {slope}");
        assert_eq!(json_of(&few)[key], Value::Null);
    }
}

#[test]
fn points_that_cannot_be_trusted_are_left_out_of_the_fit() {
    let mut report = ordinary();
    report.convergence.curve[1].rmse = Some(1e-6);
    report.convergence.curve[2].rmse = Some(0.);
    let mut zero = point(20);
    zero.rmse = Some(0.);
    let mut early = point(22);
    early.seconds = 0.;
    let mut unknown = point(24);
    unknown.rmse = Some(f64::INFINITY);
    report.convergence.curve.splice(5..5, [zero, early, unknown]);
    let slope = json_of(&report)["slope_seconds"].as_f64().unwrap();
    assert!((slope + 0.5).abs() < 1e-12, "{slope}");
}

/// The points of a line of the drawing.
fn places(line: Node) -> Vec<(f64, f64)> {
    let pairs = line.attribute("points").unwrap().split(' ');
    let pairs = pairs.filter(|pair| !pair.is_empty());
    let pair = |pair: &str| {
        let (x, y) = pair.split_once(',').unwrap();
        (x.parse().unwrap(), y.parse().unwrap())
    };
    pairs.map(pair).collect()
}

#[test]
fn the_drawing_shows_each_point_within_its_frame() {
    let mut report = ordinary();
    report.convergence.curve[5].rmse_reference = Some(0.3);
    report.convergence.curve[6].rmse_reference = Some(0.2);
    // The guide, the truth, and what is estimated.
    let (lines, discs, frame) = with_page(&report, |page| {
        let lines = named(page, "polyline").map(places);
        let place = |disc| (number(disc, "cx"), number(disc, "cy"));
        let discs = named(page, "circle").map(place);
        let frame = named(page, "svg").nth(1).unwrap();
        let size = ["width", "height"].map(|side| number(frame, side));
        (lines.collect::<Vec<_>>(), discs.collect::<Vec<_>>(), size)
    });
    assert_eq!(discs.len(), 6);
    // The guide passes through points that keep to the theory.
    let (from, to) = (lines[0][0], lines[0][1]);
    let slope = (to.1 - from.1) / (to.0 - from.0);
    for (x, y) in &discs {
        assert!((from.1 + slope * (x - from.0) - y).abs() < 0.3);
    }
    let lengths: Vec<_> = lines.iter().map(Vec::len).collect();
    assert_eq!(lengths, [2, 2, 6]);
    let [width, height] = frame;
    for (x, y) in lines[1].iter().chain(&lines[2]) {
        assert!((0. ..=width).contains(x) && (0. ..=height).contains(y));
    }
    // Time runs to the right, and small errors are below.
    let steps = lines[2].windows(2);
    steps.for_each(|w| assert!(w[0].0 < w[1].0 && w[0].1 < w[1].1));
    // Errors of 0.3 and 0.2 are above those that are estimated.
    assert!(lines[1][0].1 < lines[2][4].1);
}

#[test]
fn every_decade_of_either_axis_has_its_label() {
    for decades in 0..=10 {
        for first in [1e-4, 0.03, 1., 25.] {
            let curve = (0..=decades).map(|i| {
                let seconds = first * 10f64.powi(i);
                let rmse = Some(0.2 / (seconds / first).sqrt());
                CurvePoint { seconds, rmse, ..point(8) }
            });
            let curve = report(curve.collect());
            let exponents: Vec<i32> = with_page(&curve, |page| {
                let texts = named(page, "tspan").map(|n| n.text().unwrap());
                texts.map(|text| text.parse().unwrap()).collect()
            });
            let ends = exponents.iter().position(|&n| n == -1);
            assert!(ends.is_some(), "0.1 to 1 for an error of 0.2");
            assert_eq!(exponents[0], first.log10().floor() as i32);
            let rising = |w: &&[i32]| w[1] == w[0] + 1;
            let breaks = exponents.windows(2).filter(|w| !rising(w));
            assert!(breaks.count() <= 1, "{exponents:?}");
        }
    }
}

#[test]
fn an_exact_image_has_no_curve() {
    let mut report = ordinary();
    for point in &mut report.convergence.curve {
        point.rmse = Some(0.);
    }
    assert!(!html_of(&report).contains("polyline"));
    report.convergence.curve[4].rmse_reference = Some(0.1);
    assert!(html_of(&report).contains("polyline"));
}

#[test]
fn hostile_names_stay_names() {
    let mut report = ordinary();
    let name = "<script>alert('&\"')</script>\u{1}]]>.obj";
    report.scene.file = name.to_owned();
    report.program = "<b>&".to_owned();
    report.command = "pt -i '<script>'".to_owned();
    report.processor = "</td><script>".to_owned();
    report.scene.sha256 = "\"><script>".to_owned();
    report.settings.choice = Some("</td><script>".to_owned());
    let shown = name.replace('\u{1}', "\u{fffd}");
    let html = html_of(&report);
    assert!(!html.contains("<script"));
    let html = as_xml(&html);
    let html = Document::parse(&html).unwrap();
    for tag in ["script", "b", "i"] {
        assert_eq!(named(&html, tag).count(), 0, "{tag}");
    }
    assert_eq!(named(&html, "h1").next().unwrap().text(), Some(&shown[..]));
    assert!(words(&html).contains("</td><script>"));
    assert_eq!(json_of(&report)["scene"]["file"], name);
}

#[test]
fn the_page_needs_nothing_from_outside() {
    let page = html_of(&ordinary());
    let addresses =
        ["http:", "https:", "url(", "@import", "<link", "<script"];
    assert!(addresses.iter().all(|address| !page.contains(address)));
    let page = as_xml(&page);
    let page = Document::parse(&page).unwrap();
    let external = ["src", "href", "srcset", "data", "action"];
    let sources = page.descendants().flat_map(|n| n.attributes());
    let sources = sources.filter(|a| external.contains(&a.name()));
    let sources: Vec<_> = sources.map(|source| source.value()).collect();
    let inline = |at: &&str| at.starts_with("data:image/png;base64,");
    assert_eq!(sources.iter().filter(|at| inline(at)).count(), 2);
    assert_eq!(sources.len(), 2);
    assert_eq!(page.root_element().attribute("lang"), Some("en-GB"));
    assert!(named(&page, "img").all(|n| n.attribute("alt").is_some()));
    let mut drawings = named(&page, "svg").filter(outermost);
    assert!(drawings.all(|n| n.has_attribute("aria-label")));
}

/// The images of a page: width, height and levels.
fn images(page: &str) -> Vec<((u32, u32), Vec<u16>)> {
    let images = page.split("data:image/png;base64,").skip(1);
    let text = images.map(|text| text.split('"').next().unwrap());
    let shown = text.map(|text| {
        let (kind, size, levels) =
            png(&BASE64_STANDARD.decode(text).unwrap());
        assert_eq!(kind, png::ColorType::Grayscale);
        (size, levels)
    });
    shown.collect()
}

#[test]
fn the_page_shows_the_image_and_its_errors() {
    let image = || Image {
        errors: Some(vec![0., 0.02, 0.01]),
        ..Image::plain(3, 1, vec![0., 1., 0.5])
    };
    let page = Kind::Html.render(&ordinary(), &image);
    let shown = images(&page);
    assert_eq!(shown, vec![((3, 1), vec![0, 65535, 48191]); 2]);
    assert!(page.contains("White is 0.020000 or more"));
    let plain = || Image { errors: None, ..image() };
    let page = Kind::Html.render(&ordinary(), &plain);
    assert_eq!(images(&page).len(), 1);
    // A white image is told from a mistake by its frame and its numbers.
    let errors = Some(vec![0.; 96]);
    let white = || Image {
        errors: errors.clone(),
        ..Image::plain(12, 8, vec![1.; 96])
    };
    let page = Kind::Html.render(&ordinary(), &white);
    let words = [
        "img { box-sizing: border-box; border: 1px solid",
        "The image, 12x8 pixels, radiance from 1.0000 to 1.0000.",
        "error of each pixel. It is zero in all",
    ];
    says(&page, &words);
}

#[test]
fn the_page_begins_with_the_verdict_the_curve_the_image_and_its_error() {
    let page = html_of(&ordinary());
    let places = [
        "<h1>",
        "Run still running",
        "<svg",
        "alt=\"The rendered image\"",
        "alt=\"A map of the standard error\"",
        "<table",
    ];
    let places = places.map(|part| page.find(part).expect(part));
    assert!(places.is_sorted(), "{places:?}");
    assert!(page.contains("color-scheme: light dark"));
}

#[test]
fn settings_on_the_page_have_the_form_that_is_typed_and_a_unit() {
    let mut report = ordinary();
    report.settings.time = Some(30.);
    let page = html_of(&report);
    for (name, text) in [
        ("command", "pt -i room.obj"),
        ("date", "2026-01-31T23:59:59Z"),
        ("program", "pt 0.1.0"),
        ("processor", "abacus"),
        ("fov", "70.5\u{b0}"),
        ("time", "30.0 s"),
        ("resolution", "320x240"),
        ("target", "1.0,2.5,3.0"),
        ("error", "none"),
    ] {
        let row = format!("<tr><th>{name}</th><td>{text}</td></tr>");
        assert!(page.contains(&row), "{row}");
    }
}

#[test]
fn a_large_image_is_averaged_as_radiance() {
    let means = (0..2000 * 7).map(|i| f64::from(i % 2000 % 3 / 2));
    let image = || Image {
        errors: Some(vec![0.5; 2000 * 7]),
        ..Image::plain(2000, 7, means.clone().collect())
    };
    let shown = images(&Kind::Html.render(&ordinary(), &image));
    // Squares of 3 by 3; the last column and row hold less.
    assert_eq!(shown[0].0, (667, 3));
    // A third of the pixels are 1: the level of 1/3 is 40140.
    let whole = shown[0].1.chunks(667).flat_map(|row| &row[..666]);
    assert!(whole.clone().all(|level| level.abs_diff(40140) <= 1));
    assert!(shown[1].1.iter().all(|level| *level == 65535));
}

#[test]
fn the_page_says_in_words_how_the_run_went() {
    let mut report = ordinary();
    let last = report.convergence.curve.last_mut().unwrap();
    (last.mean, last.mean_stderr) = (0.43124, Some(0.0018));
    report.convergence.constant_pixels = 17;
    report.convergence.stopped = Some(Stop::Time);
    (report.settings.spp, report.settings.error) = (Some(200), Some(0.01));
    let text = with_page(&report, words);
    let phrases = [
        "6 triangles, load 0.125 s, build 0.250 s",
        "1.920 s, 64000 rays, 33.33 krays/s (reference)",
        "64 spp, mean radiance 0.431240 \u{b1} 0.001800, rmse 0.050000",
        "17 of 96 saw one value only",
        "Run stopped by time; 64 of 200 spp; error 0.050000, target 0.01 \
         not reached.",
        "-0.500 against seconds",
    ];
    says(&text, &phrases);
    for (_, line) in report.summary(96) {
        assert!(text.contains(&line), "{line}");
    }
}

#[test]
fn the_verdict_says_why_the_run_stopped_and_whether_it_met_its_targets() {
    let (target, reached) = (Some(0.001), "target 0.001 reached");
    for (stopped, rmse, spp, error, said) in [
        ("time", Some(0.1), None, None, ""),
        ("samples", Some(0.1), Some(64), None, "64 of 64 spp"),
        ("signal", Some(0.1), Some(100), None, "64 of 100 spp"),
        ("time", Some(0.0031), None, target, "error 0.003100, "),
        ("time", None, None, target, "error unknown, "),
        ("error", Some(0.00099), None, target, "error 0.000990, "),
        // Of an image that is known.
        ("samples", Some(0.), None, target, "error 0.000000, "),
    ] {
        let mut report = ordinary();
        (report.settings.spp, report.settings.error) = (spp, error);
        report.convergence.curve.last_mut().unwrap().rmse = rmse;
        let stop = serde_json::from_value(json!(stopped)).unwrap();
        report.convergence.stopped = Some(stop);
        let small = rmse.is_some_and(|rmse| rmse < 0.001);
        let met = if small { reached } else { "target 0.001 not reached" };
        let stopped = stopped.replace("signal", "a signal");
        let said = match error {
            None if said.is_empty() => String::new(),
            None => format!("; {said}"),
            _ => format!("; {said}{met}"),
        };
        assert_eq!(report.verdict(), format!("stopped by {stopped}{said}"));
    }
    assert!(ordinary().verdict().starts_with("still running"));
}
