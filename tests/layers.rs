// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! No module imports one of a higher layer, and no circle of imports.
//!
//! Every `use` of both programs is read. The layers are those of the
//! chapters: `tests/layers.txt` and `noweb/tests/layers.txt`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// From each module to those that it imports.
type Imports = BTreeMap<String, BTreeSet<String>>;

/// The texts of the modules below a directory, by their paths.
fn read(dir: &Path, prefix: &str, texts: &mut BTreeMap<String, String>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap();
        let module = match name {
            "mod" => prefix.trim_end_matches("::").to_owned(),
            "bin" => String::new(),
            _ => format!("{prefix}{name}"),
        };
        if path.is_dir() {
            let inner = format!("{module}::");
            read(&path, inner.trim_start_matches("::"), texts);
        } else if path.extension().is_some_and(|e| e == "rs") {
            texts.insert(module, fs::read_to_string(&path).unwrap());
        }
    }
}

/// The paths of a `use` up to its end, the groups opened.
fn paths(prefix: &str, rest: &mut std::str::Chars) -> Vec<String> {
    let (mut found, mut path) = (vec![], prefix.to_owned());
    while let Some(c) = rest.next() {
        match c {
            '{' => found.extend(paths(&path, rest)),
            ',' | '}' | ';' => {
                found.push(std::mem::replace(&mut path, prefix.to_owned()));
                if c != ',' {
                    break;
                }
            }
            c if c.is_whitespace() => (),
            c => path.push(c),
        }
    }
    found
}

/// What the modules of a crate import of each other.
fn imports(krate: &str, texts: &BTreeMap<String, String>) -> Imports {
    let mut imports = Imports::new();
    for (module, text) in texts {
        let lines = text.split("\nuse ").skip(1);
        let lines = lines.chain(text.split("\npub use ").skip(1));
        let used = lines.flat_map(|l| paths("", &mut l.chars()));
        let others = used.filter_map(|path| {
            let (up, _) = module.rsplit_once("::").unwrap_or(("", module));
            let whole = match path.split_once("::")? {
                ("crate", rest) => rest.to_owned(),
                (first, rest) if first == krate => rest.to_owned(),
                ("self", rest) => format!("{module}::{rest}"),
                ("super", rest) => format!("{up}::{rest}"),
                _ => format!("{module}::{path}"),
            };
            // The longest beginning that is a module
            let whole = whole.trim_start_matches("::");
            let ends = (1..=whole.len()).rev();
            let mut ends = ends.filter(|&n| {
                n == whole.len() || whole[n..].starts_with("::")
            });
            ends.find_map(|n| texts.get_key_value(&whole[..n]))
        });
        let others = others.map(|(other, _)| other.clone());
        let others = others.filter(|other| other != module).collect();
        imports.insert(module.clone(), others);
    }
    imports
}

/// The imports that lead upwards, and the modules in or above a circle.
fn offences(mut imports: Imports, list: &str) -> Vec<String> {
    let layer = |module: &str| {
        let top = module.split("::").next();
        let mut lines = list.lines();
        lines.position(|l| {
            l.split([' ', ':']).skip(1).any(|m| Some(m) == top)
        })
    };
    imports.remove("lib");
    let mut offences = vec![];
    for (module, others) in &imports {
        let here = layer(module);
        if here.is_none() {
            offences.push(format!("{module} is in no layer"));
        }
        let higher = others.iter().filter(|other| layer(other) > here);
        offences.extend(higher.map(|other| format!("{module}: {other}")));
    }
    // Take away what imports nothing that is left
    loop {
        let left: BTreeSet<_> = imports.keys().cloned().collect();
        imports.retain(|_, others| !others.is_disjoint(&left));
        if imports.len() == left.len() {
            offences.extend(left.iter().map(|m| format!("circle: {m}")));
            return offences;
        }
    }
}

#[test]
fn no_module_imports_upwards_or_in_a_circle() {
    for (krate, directory) in [("litpt", "."), ("noweb", "noweb")] {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(directory);
        let (mut texts, src) = (BTreeMap::new(), root.join("src"));
        read(&src, "", &mut texts);
        let list = fs::read_to_string(root.join("tests/layers.txt"));
        let imports = imports(krate, &texts);
        assert!(imports.len() > 10, "{imports:?}");
        assert_eq!(offences(imports, &list.unwrap()), [""; 0], "{krate}");
    }
}

/// What a render reaches although it decides no bit of a sample.
const WITHOUT_BITS: [&str; 15] = [
    "analysis",
    "analysis::background",
    "analysis::interior",
    "bvh",
    "bvh::binary",
    "bvh::intersector",
    "bvh::wide",
    "error",
    "film",
    "film::errors",
    "film::fragments",
    "film::sums",
    "memory",
    "scene::encoding",
    "scene::text",
];

#[test]
fn modules_that_decide_samples_say_so() {
    let mut texts = BTreeMap::new();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    read(&root.join("src"), "", &mut texts);
    let imports = imports("litpt", &texts);
    // Follow the imports of what renders
    let renders =
        |m: &&String| m.starts_with("integrator") || *m == "render";
    let mut todo: Vec<_> = imports.keys().filter(renders).collect();
    let mut reached = BTreeSet::new();
    while let Some(module) = todo.pop() {
        if reached.insert(&**module) {
            todo.extend(&imports[module]);
        }
    }
    for module in WITHOUT_BITS {
        assert!(reached.remove(module), "{module} is not reached");
    }
    let line = "\n//! Its bits belong to `";
    let says = texts.iter().filter(|(_, text)| text.contains(line));
    let says: BTreeSet<_> = says.map(|(module, _)| &**module).collect();
    let wrong = Vec::from_iter(reached.symmetric_difference(&says));
    assert!(wrong.is_empty(), "a line more, or to be listed: {wrong:?}");
}

#[test]
fn an_import_upwards_and_a_circle_are_found() {
    let texts = [
        ("scene", "\nuse crate::{film::{self, Film}, camera::*};\n"),
        ("scene::mesh", "\nuse super::{Scene,\n sky};\nuse std::fs;"),
        ("film", "\npub use mesh;\nuse crate::scene::mesh::Mesh;"),
        ("camera", "\nuse example::film::Film;\n"),
        ("sky", ""),
    ];
    let own = |(name, text): (&str, &str)| (name.into(), text.into());
    let imports = imports("example", &texts.map(own).into());
    let of = |module| Vec::from_iter(imports[module].clone()).join(" ");
    assert_eq!(of("scene"), "camera film");
    assert_eq!(of("scene::mesh"), "scene");
    assert_eq!(of("film"), "scene::mesh");
    let found = offences(imports, "low: film camera\nhigh: scene");
    let circle = ["camera", "film", "scene", "scene::mesh"];
    let circle = circle.map(|module| format!("circle: {module}"));
    assert_eq!(found[..2], ["film: scene::mesh", "sky is in no layer"]);
    assert_eq!(found[2..], circle);
}
