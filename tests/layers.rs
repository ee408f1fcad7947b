// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! No module imports one of a higher layer, and no circle of imports.
//!
//! All sources of both programs are read, with every `use` and every path
//! that begins at the crate, at a parent or at a child. The layers are those
//! of the chapters: `tests/layers.txt` and `noweb/tests/layers.txt`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// From a module to those that it names, each with the first line.
type Imports = BTreeMap<String, BTreeMap<String, usize>>;

/// The code of a source, line by line, without comments and texts.
fn code(text: &str) -> impl Iterator<Item = String> {
    text.lines().map(|line| {
        let line = line.replace("\\\"", "").replace("'\"'", "");
        let outside =
            line.split('"').step_by(2).collect::<Vec<_>>().join("\"");
        outside.split("//").next().unwrap().to_owned()
    })
}

/// The paths of a `use`, whose groups are opened.
fn expanded(text: &str) -> Vec<String> {
    let Some((before, rest)) = text.split_once('{') else {
        let paths = text.split(',').map(|path| path.trim().to_owned());
        return paths.filter(|path| !path.is_empty()).collect();
    };
    let (mut depth, mut end) = (1, 0);
    for (i, c) in rest.char_indices().filter(|(_, c)| "{}".contains(*c)) {
        depth = if c == '{' { depth + 1 } else { depth - 1 };
        if depth == 0 {
            end = i;
            break;
        }
    }
    let (others, prefix) = before.rsplit_once(',').unwrap_or(("", before));
    let mut paths = expanded(others);
    let inner = expanded(&rest[..end]).into_iter();
    paths.extend(inner.map(|path| format!("{}{path}", prefix.trim())));
    paths.extend(expanded(rest[end + 1..].trim_start_matches(',')));
    paths
}

/// All paths of a source, each with its line.
fn paths(text: &str) -> Vec<(Vec<String>, usize)> {
    let (mut found, mut import) = (Vec::new(), String::new());
    for (line, code) in (1..).zip(code(text)) {
        let words = code.split("pub ").last().unwrap().trim_start();
        if words.starts_with("use ") || !import.is_empty() {
            import += words;
            if !code.trim_end().ends_with(';') {
                continue;
            }
            let import = std::mem::take(&mut import);
            let import = import.trim_start_matches("use ");
            let all = expanded(import.trim_end_matches(';'));
            found.extend(all.into_iter().map(|path| (path, line)));
        } else {
            let of_path = |c: char| c.is_alphanumeric() || "_:".contains(c);
            let words = code.split(|c| !of_path(c));
            let paths = words.filter(|word| word.contains("::"));
            found.extend(paths.map(|path| (path.to_owned(), line)));
        }
    }
    let names = |(path, line): (String, usize)| {
        let path = path.split(" as ").next().unwrap().split("::");
        let path = path.filter(|name| !name.is_empty()).map(str::to_owned);
        (path.collect::<Vec<_>>(), line)
    };
    found.into_iter().map(names).filter(|(p, _)| !p.is_empty()).collect()
}

/// The sources of a crate: names of modules, and their texts.
struct Crate {
    name: &'static str,
    texts: BTreeMap<String, String>,
}

impl Crate {
    fn read(name: &'static str, directory: &str) -> Crate {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(directory);
        let mut krate = Crate { name, texts: BTreeMap::new() };
        krate.read_directory(&root, "");
        krate
    }

    fn read_directory(&mut self, directory: &Path, prefix: &str) {
        for entry in fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            let stem = path.file_stem().unwrap().to_str().unwrap();
            if stem.starts_with('.') {
                continue;
            } else if path.is_dir() {
                let inner = format!("{prefix}{stem}::");
                self.read_directory(
                    &path,
                    inner.trim_start_matches("bin::"),
                );
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                self.texts.insert(format!("{prefix}{stem}"), text);
            }
        }
    }

    /// The longest beginning of a path from the crate's root that is a module.
    fn module(&self, path: &[String]) -> String {
        let known =
            |n: &usize| self.texts.contains_key(&path[..*n].join("::"));
        match (1..=path.len()).rev().find(known) {
            Some(n) => path[..n].join("::"),
            None => "lib".to_owned(),
        }
    }

    /// The module that a path means where `here` is the module around it.
    fn resolve(&self, here: &[String], path: &[String]) -> Option<String> {
        let mut from = match path[0].as_str() {
            "crate" => Vec::new(),
            name if name == self.name => Vec::new(),
            "self" | "super" => here.to_vec(),
            name => {
                let child = [here, &[name.to_owned()]].concat().join("::");
                self.texts.contains_key(&child).then_some(())?;
                [here, &path[..1]].concat()
            }
        };
        for name in &path[1.min(path.len())..] {
            from.push(name.clone());
        }
        let ups = path.iter().filter(|name| *name == "super").count();
        if ups > 0 {
            let stay = here.len().checked_sub(ups)?;
            from = [&here[..stay], &path[ups..]].concat();
        }
        Some(self.module(&from))
    }

    fn imports(&self) -> Imports {
        let of = |(name, text): (&String, &String)| {
            (name.clone(), self.imports_of(name, text))
        };
        self.texts.iter().map(of).collect()
    }

    /// All that one module names, but for itself.
    fn imports_of(
        &self,
        name: &str,
        text: &str,
    ) -> BTreeMap<String, usize> {
        let root = name == "lib" || name == "main";
        let names = name.split("::").map(str::to_owned);
        let here: Vec<String> = names.filter(|_| !root).collect();
        let mut found = BTreeMap::new();
        for (path, line) in paths(text) {
            if let Some(other) = self.resolve(&here, &path)
                && other != name
            {
                found.entry(other).or_insert(line);
            }
        }
        found
    }
}

/// The number of the layer of each module, and its name, from a list.
fn layers(list: &str) -> BTreeMap<String, (usize, String)> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(list);
    let text = fs::read_to_string(path).unwrap();
    let mut layers = BTreeMap::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.split('#').next().unwrap();
        let Some((layer, modules)) = line.split_once(':') else { continue };
        for module in modules.split_whitespace() {
            let place = (number, layer.trim().to_owned());
            let before = layers.insert(module.to_owned(), place);
            assert!(before.is_none(), "{list}: {module} is in two layers");
        }
    }
    layers
}

/// What a list forbids, and the modules that it lacks or has in vain.
fn offences(imports: &Imports, list: &str) -> Vec<String> {
    let layers = layers(list);
    let top = |module: &str| module.split("::").next().unwrap().to_owned();
    let mut offences = Vec::new();
    let modules: BTreeSet<_> = imports.keys().map(|m| top(m)).collect();
    let listed: BTreeSet<_> = layers.keys().cloned().collect();
    for module in modules.symmetric_difference(&listed) {
        if module != "lib" {
            offences.push(format!(
                "{module}: in the list or in the sources only"
            ));
        }
    }
    for (module, others) in imports {
        for (other, line) in others {
            let (from, to) =
                (layers.get(&top(module)), layers.get(&top(other)));
            if let (Some(from), Some(to)) = (from, to)
                && to.0 > from.0
            {
                offences.push(format!(
                    "{module}:{line}: {} imports {other} of {}",
                    from.1, to.1
                ));
            }
        }
    }
    offences
}

/// The imports that lead back to the module from which they start.
fn circles(imports: &Imports) -> Vec<String> {
    let reaches = |from: &str, to: &str| {
        let (mut seen, mut waiting) =
            (BTreeSet::new(), vec![from.to_owned()]);
        while let Some(module) = waiting.pop() {
            if seen.insert(module.clone()) {
                waiting.extend(
                    imports
                        .get(&module)
                        .into_iter()
                        .flat_map(|o| o.keys().cloned()),
                );
            }
        }
        seen.contains(to)
    };
    let mut found = Vec::new();
    for (module, others) in imports {
        for (other, line) in
            others.iter().filter(|(o, _)| reaches(o, module))
        {
            found.push(format!("circle: {module}:{line} imports {other}"));
        }
    }
    found
}

fn assert_layered(name: &'static str, directory: &str, list: &str) {
    let imports = Crate::read(name, directory).imports();
    assert!(
        imports.len() > 10,
        "only {} modules in {directory}",
        imports.len()
    );
    let mut all = offences(&imports, list);
    all.extend(circles(&imports));
    assert!(all.is_empty(), "\n{}", all.join("\n"));
}

#[test]
fn no_module_of_the_renderer_imports_upwards_or_in_a_circle() {
    assert_layered("litpt", "src", "tests/layers.txt");
}

#[test]
fn no_module_of_the_tool_imports_upwards_or_in_a_circle() {
    assert_layered("noweb", "noweb/src", "noweb/tests/layers.txt");
}

/// A crate of four modules, in which every way to name another one occurs.
fn example() -> Crate {
    let texts = [
        ("lib", "pub mod scene; mod film;"),
        ("scene", "use crate::{film::{self, Film}, camera::*};\nmod mesh;"),
        (
            "scene::mesh",
            "fn f<'a>(x: &'a str) -> char { '\"' }\n\
            // crate::film\n const S: &str = \"crate::film \\\" \";\n\
            use super::Scene;\n fn g() { crate::camera::look(); }",
        ),
        ("film", "use std::fs;"),
        ("camera", "fn h() { super::film::develop() }"),
    ];
    let own =
        |(name, text): (&str, &str)| (name.to_owned(), text.to_owned());
    Crate { name: "example", texts: texts.map(own).into() }
}

#[test]
fn every_way_to_name_a_module_is_seen() {
    let imports = example().imports();
    let of = |module: &str| {
        imports[module].keys().cloned().collect::<Vec<_>>().join(" ")
    };
    assert_eq!(of("lib"), "");
    assert_eq!(of("scene"), "camera film");
    assert_eq!(of("scene::mesh"), "camera scene");
    assert_eq!(imports["scene::mesh"]["camera"], 5);
    assert_eq!(of("film"), "");
    assert_eq!(of("camera"), "film");
}

#[test]
fn a_circle_is_found_without_what_only_leads_to_it() {
    let mut krate = example();
    krate
        .texts
        .insert("film".into(), "use crate::scene::mesh::Mesh;".into());
    let found = circles(&krate.imports());
    let expected = [
        "circle: camera:1 imports film",
        "circle: film:1 imports scene::mesh",
        "circle: scene:1 imports camera",
        "circle: scene:1 imports film",
        "circle: scene::mesh:5 imports camera",
        "circle: scene::mesh:4 imports scene",
    ];
    assert_eq!(found, expected);
    assert!(circles(&example().imports()).is_empty());
}

#[test]
fn each_module_of_the_renderer_is_made_by_a_chapter() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let master = fs::read_to_string(root.join("litpt.nw")).unwrap();
    let chapters = master.lines().filter_map(|line| {
        line.strip_prefix("\\include{")?.strip_suffix("}")
    });
    let chapter = |name| {
        let path = root.join(format!("chapters/{name}.nw"));
        fs::read_to_string(path).unwrap()
    };
    let chapters: Vec<String> = chapters.map(chapter).collect();
    for module in
        layers("tests/layers.txt").keys().filter(|m| *m != "ptimg")
    {
        let root = format!("\n<<src/{module}.rs>>=\n");
        let made = chapters.iter().filter(|text| text.contains(&root));
        assert_eq!(made.count(), 1, "chapters that make {module}");
    }
}
