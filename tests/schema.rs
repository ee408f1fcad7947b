// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Reports of `pt` in JSON, held against their schema and it against them.

use crate::common;

use std::collections::BTreeSet;
use std::process::Command;
use std::time::{Duration, SystemTime};

use common::{Scratch, finish};
use litpt::image::Image;
use litpt::render::Share;
use litpt::render_loop::{CurvePoint, Stop};
use litpt::report::{Kind, Report};
use serde_json::{Value, json};

fn schema() -> Value {
    serde_json::from_str(include_str!("../doc/report.schema.json")).unwrap()
}

/// Whether a value is of a type of JSON Schema.
fn is_a(value: &Value, name: &Value) -> bool {
    match name.as_str().expect("the name of a type") {
        "null" => value.is_null(),
        "string" => value.is_string(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "array" => value.is_array(),
        "object" => value.is_object(),
        other => panic!("type {other}"),
    }
}

/// What a value lacks of its schema, in so much of the language as ours is
/// written in; the fields that it has are added to those seen.
fn faults(
    schema: &Value,
    value: &Value,
    path: &str,
    seen: &mut BTreeSet<String>,
) -> Vec<String> {
    let mut all = vec![];
    let fields = value.as_object();
    let has = |key: &str| fields.is_some_and(|f| f.contains_key(key));
    for (keyword, rule) in schema.as_object().unwrap() {
        match keyword.as_str() {
            "$schema" | "$comment" | "title" | "description" => {
                assert!(rule.is_string(), "{path}: {keyword}");
            }
            "type" => {
                let one = [rule.clone()];
                let types = rule.as_array().map_or(&one[..], |t| &t[..]);
                if !types.iter().any(|name| is_a(value, name)) {
                    all.push(format!("{path}: no {rule}: {value}"));
                }
            }
            "enum" => {
                if !rule.as_array().unwrap().contains(value) {
                    all.push(format!("{path}: none of {rule}: {value}"));
                }
            }
            "required" => {
                for key in rule.as_array().unwrap() {
                    if !has(key.as_str().unwrap()) {
                        all.push(format!("{path}: no {key}"));
                    }
                }
            }
            "additionalProperties" => {
                assert_eq!(rule, false);
                for key in fields.into_iter().flat_map(|f| f.keys()) {
                    if schema["properties"].get(key).is_none() {
                        all.push(format!("{path}: {key} is unknown"));
                    }
                }
            }
            "properties" => {
                for (key, rule) in rule.as_object().unwrap() {
                    let Some(value) = value.get(key) else { continue };
                    let path = format!("{path}/{key}");
                    seen.insert(path.clone());
                    all.extend(faults(rule, value, &path, seen));
                }
            }
            "items" => {
                for value in value.as_array().into_iter().flatten() {
                    all.extend(faults(rule, value, path, seen));
                }
            }
            other => panic!("{path}: {other} is not checked"),
        }
    }
    all
}

/// The paths of all fields of which a schema tells.
fn fields(schema: &Value, path: &str, all: &mut BTreeSet<String>) {
    for (key, rule) in
        schema["properties"].as_object().into_iter().flatten()
    {
        let path = format!("{path}/{key}");
        let nested = rule["type"] == "object" || rule["type"] == "array";
        let described = rule["description"].is_string();
        assert!(nested || described, "{path} is not described");
        all.insert(path.clone());
        fields(rule, &path, all);
        fields(&rule["items"], &path, all);
    }
}

/// The report of a run on several ranks, of which nothing else is known.
fn of_ranks() -> Report {
    let seconds = 0.;
    let point = CurvePoint {
        spp: 1,
        seconds,
        rays: 0,
        rmse: None,
        mean: 0.,
        mean_stderr: None,
        rmse_reference: None,
        processor_seconds: Some(seconds),
    };
    let ranks = vec![Share::default(); 2];
    Report { ranks, curve: vec![point], ..Report::begin("pt") }
}

/// Reports of runs that end in different ways, one of them of a part of an
/// image with a reference, and that of a run before its first sample.
fn reports() -> Vec<Value> {
    let place = Scratch::new();
    let run = |more: &[&str]| {
        let render = ["-iroom.obj", "-d64x48", "-q", "-f", "-oa.exr"];
        let report = ["--report=r.json"];
        place.run(&[&render[..], &report, more].concat()).succeeded();
        serde_json::from_slice(&place.get("r.json")).unwrap()
    };
    let crop = "--crop=3,5,40x30";
    let first: Value = run(&["-n2", crop]);
    std::fs::rename(place.path("a.exr"), place.path("truth.exr")).unwrap();
    let compare = "--reference=truth.exr";
    let rest = [
        run(&["-n20", "-s1", crop, compare]),
        run(&["--error=0.2", "-p0,0,90", "-t0,0,0", "-u0,1,0"]),
        run(&["--time=0.2", "-p0,0,90", "-t0,0,99", "-u0,1,0"]),
    ];
    let parts = ["a.litpt", "b.litpt"].map(|name| {
        let range =
            if name < "b" { "--samples=0..4" } else { "--samples=4..8" };
        let state = ["-n8", "--tiles=1/2", "-f", range, "--report=r.json"];
        let threads = if name < "b" { "-j1" } else { "-j2" };
        let state =
            [&state[..], &["-iroom.obj", "-q", threads, "-o", name]];
        place.run(&state.concat()).succeeded();
        serde_json::from_slice(&place.get("r.json")).unwrap()
    });
    let mut merge = place.command(env!("CARGO_BIN_EXE_ptimg"));
    merge.args(["merge", "a.litpt", "b.litpt", "-om.exr", "--partial"]);
    let merge = merge.args(["-f", "--report=r.json"]).spawn().unwrap();
    finish(merge).succeeded();
    let merged = serde_json::from_slice(&place.get("r.json")).unwrap();
    let image = || -> Image { unreachable!("JSON has no image") };
    let begun = Kind::Json.render(&of_ranks(), &image);
    let mut begun: Value = serde_json::from_str(&begun).unwrap();
    begun["settings"] = first["settings"].clone();
    let parts = parts.into_iter().chain([merged]);
    [first, begun].into_iter().chain(rest).chain(parts).collect()
}

#[test]
fn reports_and_their_schema_have_the_same_fields_and_types() {
    let (schema, mut seen) = (schema(), BTreeSet::new());
    for report in reports() {
        let faults = faults(&schema, &report, "", &mut seen);
        assert!(faults.is_empty(), "{faults:#?}");
    }
    let mut all = BTreeSet::new();
    fields(&schema, "", &mut all);
    let never: Vec<_> = all.difference(&seen).collect();
    assert!(never.is_empty(), "in no report: {never:?}");
    let words = [Stop::Samples, Stop::Time, Stop::Error, Stop::Signal(2)];
    let words = words.map(|stop| json!(stop.name()));
    let words: Vec<_> = [Value::Null].into_iter().chain(words).collect();
    assert_eq!(schema["properties"]["stopped"]["enum"], json!(words));
}

/// Changes a value in each way that one change of a field can make, and
/// hands the whole to a function each time.
fn changes(
    whole: &mut Value,
    pointer: &str,
    found: &mut impl FnMut(&Value, &str),
) {
    let value = whole.pointer(pointer).unwrap().clone();
    if let Some(fields) = value.as_object() {
        for key in fields.keys() {
            let mut without = whole.clone();
            let place = without.pointer_mut(pointer).unwrap();
            place.as_object_mut().unwrap().remove(key);
            found(&without, &format!("without {pointer}/{key}"));
            changes(whole, &format!("{pointer}/{key}"), found);
        }
        let mut with = whole.clone();
        with.pointer_mut(pointer).unwrap()["another"] = json!(1);
        found(&with, &format!("with {pointer}/another"));
    }
    for i in 0..value.as_array().map_or(0, Vec::len) {
        changes(whole, &format!("{pointer}/{i}"), found);
    }
    let mut other = whole.clone();
    *other.pointer_mut(pointer).unwrap() = json!(true);
    found(&other, &format!("true at {pointer}"));
}

#[test]
fn no_change_of_a_field_passes_the_schema() {
    let schema = schema();
    let mut report = reports().remove(2);
    let mut tried = 0;
    changes(&mut report, "", &mut |changed, how| {
        let faults = faults(&schema, changed, "", &mut BTreeSet::new());
        let optional = how.starts_with("without /settings/crop")
            || how.starts_with("without /settings/choice")
            || how.ends_with("/rmse_reference") && how.starts_with("w");
        assert_eq!(faults.is_empty(), optional, "{how}");
        tried += 1;
    });
    assert!(tried > 100, "{tried}");
}

/// The command line of a report, given to a shell, renders the same image.
#[test]
fn the_command_of_a_report_can_be_typed_again() {
    let place = Scratch::new();
    let name = "the fool's $HOME.obj";
    std::fs::copy(place.path("room.obj"), place.path(name)).unwrap();
    let run = ["-d8x6", "-qf", "-n3", "-oa.pgm", "--report=r.json", "-i"];
    let before = SystemTime::now() - Duration::from_secs(1);
    place.run(&[&run[..], &[name]].concat()).succeeded();
    let image = place.get("a.pgm");
    let report: Value =
        serde_json::from_slice(&place.get("r.json")).unwrap();
    let date = report["date"].as_str().unwrap();
    let date = humantime::parse_rfc3339(date).unwrap();
    assert!(before < date && date <= SystemTime::now());
    assert!(!report["processor"].as_str().unwrap().is_empty());
    std::fs::remove_file(place.path("a.pgm")).unwrap();
    let mut shell: Command = place.command("sh");
    shell.args(["-c", report["command"].as_str().unwrap()]);
    assert!(shell.status().unwrap().success());
    assert_eq!(place.get("a.pgm"), image);
}
