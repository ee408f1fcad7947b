// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Reports of `pt` in JSON, held against their schema and it against them.

use crate::prelude::*;

use crate::report::point;
use litpt::render::RankStats;

/// The type of a value, as JSON Schema has it.
fn kind(value: &Value) -> &str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
        Value::Number(number) if number.is_f64() => "number",
        Value::Number(_) => "integer",
    }
}

/// Holds values against a schema, and the schema against them: all that one
/// has the other describes, and nothing else is allowed.
fn check(schema: &Value, values: &[&Value], path: &str) {
    let words: Vec<_> =
        schema.as_object().unwrap().keys().map(|w| &w[..]).collect();
    let known = "$schema $comment title description type enum items \
                 properties required additionalProperties oneOf";
    let is_known = |word: &&str| known.split(' ').any(|one| one == *word);
    assert!(words.iter().all(is_known), "{path}: {words:?}");
    assert!(!values.is_empty(), "{path} is in no report");
    let types = schema["type"].to_string();
    for value in values {
        let kind = kind(value);
        let fits = types.contains(&format!("{kind:?}"))
            || kind == "integer" && types.contains("\"number\"")
            || schema["enum"].as_array().is_some_and(|e| e.contains(value));
        assert!(fits, "{path}: {value} is no {schema}");
    }
    if let Some(items) = schema.get("items") {
        let all = values.iter().flat_map(|v| v.as_array().unwrap());
        let all: Vec<_> = all.collect();
        check(items, &all, &format!("{path}/items"));
    } else if let Some(fields) = schema["properties"].as_object() {
        assert_eq!(schema["additionalProperties"], false, "{path}");
        let required = schema["required"].as_array().unwrap();
        for value in values {
            let names = value.as_object().unwrap().keys();
            let strange: Vec<_> =
                names.filter(|name| !fields.contains_key(*name)).collect();
            assert!(strange.is_empty(), "{path}: {strange:?}");
        }
        // Each value is of one of several kinds, and each kind occurs.
        let kinds = schema["oneOf"].as_array().into_iter().flatten();
        let mut kinds_of = vec![0; values.len()];
        for kind in kinds {
            let names = kind["required"].as_array().unwrap();
            let has = |n: &Value, value: &Value| {
                value.get(n.as_str().unwrap()).is_some()
            };
            for (count, value) in kinds_of.iter_mut().zip(values) {
                *count += i32::from(names.iter().all(|n| has(n, value)));
            }
            assert!(kinds_of.contains(&1), "{path}: no {names:?}");
        }
        let one = i32::from(schema.get("oneOf").is_some());
        assert!(kinds_of.iter().all(|&count| count == one), "{path}");
        for (name, schema) in fields {
            let all: Vec<_> =
                values.iter().filter_map(|value| value.get(name)).collect();
            let always = all.len() == values.len();
            assert_eq!(required.contains(&json!(name)), always, "{name}");
            check(schema, &all, &format!("{path}/{name}"));
        }
    } else {
        let described = schema["description"].is_string();
        assert!(described || path.ends_with("/items"), "{path} is silent");
    }
}

/// The report of a run on several ranks, of which nothing else is known.
fn of_ranks() -> Report {
    let processor_seconds = Some(0.);
    let point = CurvePoint { processor_seconds, ..point(1) };
    let mut report = Report::default();
    report.sign("pt");
    report.convergence.ranks = vec![RankStats::default(); 2];
    report.convergence.processor_seconds = processor_seconds;
    report.convergence.curve = vec![point];
    report
}

/// Reports of runs that end in different ways, one of them of a part of an
/// image with a reference, and that of a run before its first sample.
fn reports() -> Vec<Value> {
    let place = Scratch::new();
    let run = |more: &str| {
        let files = "-q -f -iroom.obj --report=r.json";
        place.done(&format!("{files} -d64x48 -oa.exr {more}"));
        place.json("r.json")
    };
    let crop = "--crop=3,5,40x30";
    let first = run(&format!("-n2 {crop}"));
    std::fs::rename(place.path("a.exr"), place.path("truth.exr")).unwrap();
    let rest = [
        run(&format!("-n20 -s1 {crop} --reference=truth.exr")),
        run("--error=0.2 -p0,0,90 -t0,0,0 -u0,1,0"),
        run("--time=0.2 -p0,0,90 -t0,0,99 -u0,1,0"),
        run("-n4 --integrator=gather"),
        run("--error=50% --error-of=max -u1,0,0 --zenith=z --exposure=1 \
             -ob.png"),
    ];
    place.put("m.mtl", "newmtl a\nKd 0.5 0.5 0.5\n");
    place.put("p.txt", "0 0 0 0 0 1\n");
    place.put("named.obj", format!("mtllib m.mtl\nusemtl a\n{ROOM}"));
    let points = "named.obj --points p.txt --materials --albedo a=0.4";
    let files = "-n64 -q -f -o p.csv --report=r.json";
    let sky = "--ground 0.2 --sky overcast";
    place.free(&format!("{points} {sky} {files}")).succeeded();
    let of_points = place.json("r.json");
    let of_faces = ["--closed", ""].map(|closed| {
        let line = "room.obj --faces --view-factors=faces -n64 -r0 -q -f";
        let line = format!("{line} {closed} -o f.csv --report=r.json");
        place.free(&line).succeeded();
        place.json("r.json")
    });
    let parts =
        ["--samples=0..4 -j1 -oa.litpt", "--samples=4..8 -j2 -ob.litpt"];
    let parts = parts.map(|part| {
        let state = "-iroom.obj -q -f -n8 --tiles=1/2 --report=r.json";
        place.done(&format!("{state} {part}"));
        place.json("r.json")
    });
    let merge = "merge a.litpt b.litpt -om.exr --partial";
    place.ptimg(&format!("{merge} -f --report=r.json")).succeeded();
    let merged = place.json("r.json");
    let image = || -> Image { unreachable!("JSON has no image") };
    let begun = Kind::Json.render(&of_ranks(), &image);
    let mut begun: Value = serde_json::from_str(&begun).unwrap();
    begun["settings"] = first["settings"].clone();
    let parts = parts.into_iter().chain([merged]);
    let all = [first, begun, of_points].into_iter().chain(of_faces);
    all.chain(rest).chain(parts).collect()
}

#[test]
fn reports_and_their_schema_have_the_same_fields_and_types() {
    let schema = include_str!("../doc/report.schema.json");
    let schema: Value = serde_json::from_str(schema).unwrap();
    check(&schema, &reports().iter().collect::<Vec<_>>(), "");
    let words = [Stop::Samples, Stop::Time, Stop::Error, Stop::Signal(2)];
    let words = words.map(|stop| json!(stop));
    let words: Vec<_> = [Value::Null].into_iter().chain(words).collect();
    assert_eq!(schema["properties"]["stopped"]["enum"], json!(words));
}

/// The command line of a report, given to a shell, renders the same image.
#[test]
fn the_command_of_a_report_can_be_typed_again() {
    let place = Scratch::new();
    let name = "the fool's $HOME.obj";
    std::fs::copy(place.path("room.obj"), place.path(name)).unwrap();
    let mut run = place.pt("-d8x6 -qf -n3 -oa.pgm --report=r.json -i");
    let before = SystemTime::now() - Duration::from_secs(1);
    outcome(run.arg(name)).succeeded();
    let image = place.get("a.pgm");
    let report = place.json("r.json");
    let date = report["date"].as_str().unwrap();
    let date = humantime::parse_rfc3339(date).unwrap();
    assert!(before < date && date <= SystemTime::now());
    assert!(!report["processor"].as_str().unwrap().is_empty());
    std::fs::remove_file(place.path("a.pgm")).unwrap();
    place.shell(report["command"].as_str().unwrap()).succeeded();
    assert_eq!(place.get("a.pgm"), image);
}
