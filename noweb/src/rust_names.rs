// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The items of a Rust program, and what its paths mean.
//!
//! The program is made of crates, a crate of modules, and a module of
//! items. What cannot be known from the program's own text, and what has
//! more than one meaning, is [`Found::Foreign`]: it is never taken for an
//! item.

use std::collections::HashMap;
use std::ops::Range;

use proc_macro2::Ident;
use syn::{ImplItem, TraitItem, UseTree};

// Define the items of a program
/// The number of an item in the table of items.
pub type Id = usize;

/// What sort of thing an item is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A module, or the root of a crate.
    Module,
    /// A type or a trait.
    Type,
    /// A case of an enumeration.
    Variant,
    /// A macro by example.
    Macro,
    /// A function, a constant, or one that belongs to a type or a trait.
    Value,
}

/// What a name or a path leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// An item of the program.
    Item(Id),
    /// Something else, or one of several things.
    Foreign,
}

/// An item, and what is declared inside it.
pub struct Item {
    /// Its name, or what its crate is called.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// What it is declared in; none for the root of a crate.
    pub parent: Option<Id>,
    /// The file and the bytes at which its name is declared.
    pub site: Option<(usize, Range<usize>)>,
    members: HashMap<String, Found>,
    /// Imported names and the paths that they stand for.
    imports: Vec<(String, Vec<String>)>,
}
// Build the tree of items
/// A parsed file: its path from the root of the project, and its syntax.
pub struct File {
    /// The path.
    pub path: String,
    /// What was parsed.
    pub syntax: syn::File,
}

/// All items of a program.
pub struct Names<'a> {
    /// The table of items.
    pub items: Vec<Item>,
    /// The module that each file is.
    pub modules: HashMap<usize, Id>,
    files: &'a [File],
    libraries: HashMap<String, Found>,
    /// The module and the file of each implementation.
    implementations: Vec<(Id, usize, &'a syn::ItemImpl)>,
}

impl<'a> Names<'a> {
    /// The items of some files; `library` tells for the path of the root
    /// of a library what others call the crate.
    pub fn new(
        files: &'a [File],
        library: impl Fn(&str) -> Option<String>,
    ) -> Self {
        let mut names = Self {
            items: Vec::new(),
            modules: HashMap::new(),
            files,
            libraries: HashMap::new(),
            implementations: Vec::new(),
        };
        // Take roots of crates first, then stray files
        let numbers = 0..files.len();
        let (roots, strays): (Vec<_>, Vec<_>) =
            numbers.partition(|number| is_root(&files[*number].path));
        for number in roots.into_iter().chain(strays) {
            if !names.modules.contains_key(&number) {
                names.read_crate(number, library(&files[number].path));
            }
        }
        names.implement();
        names
    }

    /// Reads the root of a crate and what is below it.
    fn read_crate(&mut self, number: usize, library: Option<String>) {
        let path = &self.files[number].path;
        let name = path.trim_end_matches(".rs").to_string();
        let name = library.clone().unwrap_or(name);
        let root = self.add(name, Kind::Module, None);
        let found = library.map(|name| (name, Found::Item(root)));
        self.libraries.extend(found);
        let (dir, _) = path.rsplit_once('/').unwrap_or_default();
        self.read_file(number, root, dir);
    }

    fn add(&mut self, name: String, kind: Kind, parent: Option<Id>) -> Id {
        let (members, imports) = Default::default();
        let site = None;
        let item = Item { name, kind, parent, site, members, imports };
        self.items.push(item);
        self.items.len() - 1
    }

    /// `dir` is where the files of the module's own modules lie.
    fn read_file(&mut self, number: usize, module: Id, dir: &str) {
        self.modules.insert(number, module);
        let files = self.files;
        self.collect(module, &files[number].syntax.items, number, dir);
    }
}

/// Whether cargo compiles a file as the root of a crate.
fn is_root(path: &str) -> bool {
    let mut names = path.rsplit('/');
    matches!(names.next(), Some("lib.rs" | "main.rs"))
        || matches!(
            names.next(),
            Some("bin" | "tests" | "examples" | "benches")
        )
}
// Collect what is declared
/// The name that an item declares, and its kind.
pub fn declaration(item: &syn::Item) -> Option<(&Ident, Kind)> {
    Some(match item {
        syn::Item::Fn(f) => (&f.sig.ident, Kind::Value),
        syn::Item::Const(c) if c.ident != "_" => (&c.ident, Kind::Value),
        syn::Item::Static(s) => (&s.ident, Kind::Value),
        syn::Item::Macro(m) => (m.ident.as_ref()?, Kind::Macro),
        syn::Item::Mod(m) => (&m.ident, Kind::Module),
        // Declare a type or a trait
        syn::Item::Struct(s) => (&s.ident, Kind::Type),
        syn::Item::Enum(e) => (&e.ident, Kind::Type),
        syn::Item::Union(u) => (&u.ident, Kind::Type),
        syn::Item::Type(t) => (&t.ident, Kind::Type),
        syn::Item::Trait(t) => (&t.ident, Kind::Type),
        _ => return None,
    })
}

impl<'a> Names<'a> {
    fn collect(
        &mut self,
        scope: Id,
        items: &'a [syn::Item],
        file: usize,
        dir: &str,
    ) {
        for item in items {
            if let syn::Item::Use(item) = item {
                for Import { path, name } in imports(item) {
                    let path = path.iter().map(|ident| ident.to_string());
                    let path = path.collect();
                    let import = name.map(|name| (name.to_string(), path));
                    self.items[scope].imports.extend(import);
                }
            } else if let syn::Item::Impl(item) = item {
                self.implementations.push((scope, file, item));
            } else if let Some((ident, kind)) = declaration(item) {
                let id = self.declare((scope, file), ident, kind);
                self.collect_inside((id, file), item, dir);
            }
        }
    }

    /// Declares a name in a scope; a second meaning makes it foreign.
    fn declare(
        &mut self,
        (scope, file): (Id, usize),
        ident: &Ident,
        kind: Kind,
    ) -> Id {
        let name = ident.to_string();
        let id = self.add(name.clone(), kind, Some(scope));
        self.items[id].site = Some((file, ident.span().byte_range()));
        let member = self.items[scope].members.entry(name);
        let member = member.and_modify(|old| *old = Found::Foreign);
        member.or_insert(Found::Item(id));
        id
    }

    fn collect_inside(
        &mut self,
        place: (Id, usize),
        item: &'a syn::Item,
        dir: &str,
    ) {
        match item {
            syn::Item::Mod(item) => {
                let dir = format!("{dir}/{}", item.ident);
                match &item.content {
                    Some((_, items)) => {
                        self.collect(place.0, items, place.1, &dir);
                    }
                    None => self.read_module(place.0, item, &dir),
                }
            }
            syn::Item::Enum(item) => {
                for variant in &item.variants {
                    self.declare(place, &variant.ident, Kind::Variant);
                }
            }
            syn::Item::Trait(item) => {
                for member in &item.items {
                    if let TraitItem::Fn(f) = member {
                        self.declare(place, &f.sig.ident, Kind::Value);
                    }
                }
            }
            _ => {}
        }
    }

    /// Reads the file of a module; without one the module is foreign.
    fn read_module(&mut self, id: Id, item: &syn::ItemMod, dir: &str) {
        let dir = dir.trim_start_matches('/');
        let paths = [format!("{dir}.rs"), format!("{dir}/mod.rs")];
        let number =
            self.files.iter().position(|f| paths.contains(&f.path));
        let moved = item.attrs.iter().any(|a| a.path().is_ident("path"));
        let fresh = |n: &usize| !moved && !self.modules.contains_key(n);
        if let Some(number) = number.filter(fresh) {
            self.read_file(number, id, dir);
        } else if let Some(parent) = self.items[id].parent {
            let members = &mut self.items[parent].members;
            members.insert(item.ident.to_string(), Found::Foreign);
        }
    }
}
// Take an import apart
/// What an import brings in.
pub struct Import<'a> {
    /// Its path; empty for one that certainly begins in another crate.
    pub path: Vec<&'a Ident>,
    /// The name that it gets; none for a star.
    pub name: Option<&'a Ident>,
}

/// All that a `use` brings in.
pub fn imports(item: &syn::ItemUse) -> Vec<Import<'_>> {
    let mut imports = Vec::new();
    flatten(&item.tree, &[], &mut imports);
    if item.leading_colon.is_some() {
        imports.iter_mut().for_each(|import| import.path.clear());
    }
    imports
}

fn flatten<'a>(
    tree: &'a UseTree,
    path: &[&'a Ident],
    out: &mut Vec<Import<'a>>,
) {
    let (ident, name) = match tree {
        UseTree::Path(step) => {
            let path = [path, &[&step.ident]].concat();
            return flatten(&step.tree, &path, out);
        }
        UseTree::Group(group) => {
            let trees = group.items.iter();
            return trees.for_each(|tree| flatten(tree, path, out));
        }
        UseTree::Name(leaf) => (&leaf.ident, &leaf.ident),
        UseTree::Rename(leaf) => (&leaf.ident, &leaf.rename),
        UseTree::Glob(_) => {
            return out.push(Import { path: path.to_vec(), name: None });
        }
    };
    // The name `self` means what is before it
    let mut path = path.to_vec();
    if ident != "self" {
        path.push(ident);
    }
    let name =
        if name == "self" { path.last().copied() } else { Some(name) };
    out.push(Import { path, name });
}
// Attach members to their types
impl Names<'_> {
    fn implement(&mut self) {
        let implementations = std::mem::take(&mut self.implementations);
        for (scope, file, item) in implementations {
            if item.trait_.is_none()
                && let Some(id) = self.self_type(scope, item)
            {
                for ident in item.items.iter().filter_map(member) {
                    self.declare((id, file), ident, Kind::Value);
                }
            }
        }
    }

    /// The type, if it is one of ours, that an `impl` is for.
    pub fn self_type(&self, scope: Id, item: &syn::ItemImpl) -> Option<Id> {
        let syn::Type::Path(path) = &*item.self_ty else { return None };
        let names = segments(&path.path);
        let mut generics = item.generics.type_params();
        let generic = generics.any(|param| param.ident == names[0]);
        if path.qself.is_some() || generic {
            return None;
        }
        self.path((scope, None), &names)
    }
}

/// The name of a function or a constant in an `impl`.
pub fn member(member: &ImplItem) -> Option<&Ident> {
    match member {
        ImplItem::Fn(f) => Some(&f.sig.ident),
        ImplItem::Const(c) => Some(&c.ident),
        _ => None,
    }
}

/// The names in a path; an empty one for `::` at its beginning.
pub fn segments(path: &syn::Path) -> Vec<String> {
    let root = path.leading_colon.map(|_| String::new());
    let names = path.segments.iter().map(|s| s.ident.to_string());
    root.into_iter().chain(names).collect()
}
// Find what a path means
/// The imports that are being followed, lest we go in a circle.
type Trail = Vec<(Id, String)>;

impl Names<'_> {
    /// The item that a path means in a module, where `Self` is `this`.
    pub fn path(
        &self,
        (module, this): (Id, Option<Id>),
        path: &[String],
    ) -> Option<Id> {
        let found = match &path[0][..] {
            "Self" => self.beyond(this?, &path[1..], &mut Trail::new()),
            _ => self.follow(module, path, &mut Trail::new()),
        };
        match found? {
            Found::Item(id) => Some(id),
            Found::Foreign => None,
        }
    }

    /// What a path means in a module, from its first name on.
    fn follow(
        &self,
        module: Id,
        path: &[String],
        trail: &mut Trail,
    ) -> Option<Found> {
        let (first, rest) = path.split_first()?;
        let start = match &first[..] {
            "crate" => Found::Item(self.root_of(module)),
            "self" => Found::Item(module),
            "super" => Found::Item(self.items[module].parent?),
            name => {
                let found = self.inside(module, name, trail);
                found.or_else(|| self.libraries.get(name).copied())?
            }
        };
        match start {
            Found::Item(id) => self.beyond(id, rest, trail),
            Found::Foreign => Some(start),
        }
    }

    fn root_of(&self, id: Id) -> Id {
        self.items[id].parent.map_or(id, |parent| self.root_of(parent))
    }

    /// What the rest of a path means, its beginning being an item.
    fn beyond(
        &self,
        id: Id,
        rest: &[String],
        trail: &mut Trail,
    ) -> Option<Found> {
        let Some((name, rest)) = rest.split_first() else {
            return Some(Found::Item(id));
        };
        let next = match &name[..] {
            "super" => Found::Item(self.items[id].parent?),
            name => self.inside(id, name, trail)?,
        };
        match next {
            Found::Item(id) => self.beyond(id, rest, trail),
            Found::Foreign => Some(next),
        }
    }

    /// What a name means inside an item: what is declared there, or where
    /// its imports lead.
    fn inside(
        &self,
        id: Id,
        name: &str,
        trail: &mut Trail,
    ) -> Option<Found> {
        let step = (id, name.to_string());
        let declared = self.items[id].members.get(name);
        if declared.is_some() || trail.contains(&step) {
            return declared.copied();
        }
        trail.push(step);
        let imports = self.items[id].imports.iter();
        let imports = imports.filter(|(import, _)| import == name);
        let mut found = imports.map(|(_, path)| {
            self.follow(id, path, trail).unwrap_or(Found::Foreign)
        });
        let first = found.next();
        let same = found.all(|other| Some(other) == first);
        trail.pop();
        if same { first } else { Some(Found::Foreign) }
    }
}
