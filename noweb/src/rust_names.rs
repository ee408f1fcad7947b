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

use std::collections::{HashMap, HashSet};
use std::ops::Range;

use proc_macro2::Ident;
use syn::UseTree;

// Define the items of a program
/// The number of an item in the table of items.
pub type Id = usize;

/// What sort of thing an item is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A module, or the root of a crate.
    Module,
    /// The items that a block of statements declares.
    Block,
    /// A function outside all types.
    Function,
    /// A structure, an enumeration, a union or a type alias.
    Type,
    /// A trait.
    Trait,
    // Distinguish the smaller kinds of items
    /// A constant or a static variable.
    Constant,
    /// A macro by example.
    Macro,
    /// What belongs to a type or a trait: a function, a constant, a type.
    Member,
    /// A case of an enumeration.
    Variant,
}
/// The three spaces of names: the same name may mean something in each.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Space {
    /// Modules, types, traits.
    Types,
    /// Functions, constants, variants, variables.
    Values,
    /// Macros.
    Macros,
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
pub struct Item<'a> {
    /// Its name, or what its crate is called.
    pub name: String,
    /// What it is.
    pub kind: Kind,
    /// What it is declared in; none for the root of a crate.
    pub parent: Option<Id>,
    /// The file and the bytes at which its name is declared.
    pub site: Option<(usize, Range<usize>)>,
    // Keep what is declared inside an item
    members: HashMap<(Space, String), Found>,
    imports: Vec<Import>,
    globs: Vec<Vec<String>>,
    /// The traits that a type implements, and the names in their `impl`s.
    traits: Vec<Found>,
    overridden: HashSet<String>,
    /// What tells the types of values.
    shape: Shape<'a>,
}
struct Import {
    name: String,
    path: Vec<String>,
}

/// What the declaration of an item says about types.
#[derive(Default)]
struct Shape<'a> {
    /// Where the names of the types are to be looked up.
    scope: Id,
    fields: HashMap<String, &'a syn::Type>,
    /// What a function returns, or what an alias stands for.
    result: Option<&'a syn::Type>,
    /// Whether a function has a receiver.
    method: bool,
    /// The names of its generic parameters.
    generics: Vec<String>,
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
    pub items: Vec<Item<'a>>,
    /// The module that each file is.
    pub modules: Vec<Id>,
    files: &'a [File],
    libraries: HashMap<String, Id>,
    implementations: Vec<(Id, &'a syn::ItemImpl)>,
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
            modules: vec![usize::MAX; files.len()],
            files,
            libraries: HashMap::new(),
            implementations: Vec::new(),
        };
        // Take roots of crates first, then stray files
        let is_root = |file: &File| {
            let path = file.path.rsplit_once('/');
            let (dir, name) = path.unwrap_or_default();
            let dir = dir.rsplit('/').next().unwrap_or_default();
            matches!(name, "lib.rs" | "main.rs")
                || matches!(dir, "bin" | "tests" | "examples" | "benches")
        };
        for roots in [true, false] {
            for (number, file) in files.iter().enumerate() {
                let fresh = names.modules[number] == usize::MAX;
                if fresh && is_root(file) == roots {
                    // Read a root and what is below it
                    let label =
                        file.path.trim_end_matches(".rs").to_string();
                    let library = library(&file.path);
                    let name = library.clone().unwrap_or(label);
                    let root = names.add(name, Kind::Module, None);
                    names
                        .libraries
                        .extend(library.map(|name| (name, root)));
                    names.read_file(number, root);
                }
            }
        }
        names.implement();
        names
    }
    fn add(&mut self, name: String, kind: Kind, parent: Option<Id>) -> Id {
        self.items.push(Item {
            name,
            kind,
            parent,
            site: None,
            members: HashMap::new(),
            imports: Vec::new(),
            globs: Vec::new(),
            traits: Vec::new(),
            overridden: HashSet::new(),
            shape: Shape::default(),
        });
        self.items.len() - 1
    }
    fn read_file(&mut self, number: usize, module: Id) {
        self.modules[number] = module;
        let files = self.files;
        let file = &files[number];
        let (dir, name) = file.path.rsplit_once('/').unwrap_or_default();
        let owner = name.trim_end_matches(".rs");
        let flat = self.items[module].parent.is_none() || owner == "mod";
        let dir = if flat { dir.into() } else { format!("{dir}/{owner}") };
        let home = Home { file: Some(number), dir };
        self.collect(module, &file.syntax.items, &home);
    }
}

/// Where items are written: their file, unless they are inside a block,
/// and the directory of the files of inner modules.
struct Home {
    file: Option<usize>,
    dir: String,
}
// Collect the members of an item
impl<'a> Names<'a> {
    fn collect(&mut self, scope: Id, items: &'a [syn::Item], home: &Home) {
        for item in items {
            self.collect_item(scope, item, home);
        }
    }

    /// Declares a name in a scope; a second meaning makes it uncertain.
    fn declare(
        &mut self,
        (scope, home): (Id, &Home),
        ident: &Ident,
        kind: Kind,
        spaces: &[Space],
    ) -> Id {
        let name = ident.to_string();
        let id = self.add(name.clone(), kind, Some(scope));
        let site = home.file.map(|file| (file, ident.span().byte_range()));
        self.items[id].site = site;
        // Enter the name into each of its spaces
        for space in spaces {
            let members = &mut self.items[scope].members;
            let found = match home.file {
                Some(_) => Found::Item(id),
                None => Found::Foreign,
            };
            members
                .entry((*space, name.clone()))
                .and_modify(|old| *old = Found::Foreign)
                .or_insert(found);
        }
        id
    }
    fn collect_item(
        &mut self,
        scope: Id,
        item: &'a syn::Item,
        home: &Home,
    ) {
        use Space::{Macros, Types, Values};
        let place = (scope, home);
        match item {
            // Collect functions, constants and macros
            syn::Item::Fn(item) => {
                let ident = &item.sig.ident;
                let id =
                    self.declare(place, ident, Kind::Function, &[Values]);
                self.items[id].shape = signature(&item.sig, scope);
            }
            syn::Item::Const(item) if item.ident != "_" => {
                let ident = &item.ident;
                self.declare(place, ident, Kind::Constant, &[Values]);
            }
            syn::Item::Static(item) => {
                self.declare(place, &item.ident, Kind::Constant, &[Values]);
            }
            syn::Item::Macro(item) => {
                if let Some(ident) = &item.ident {
                    self.declare(place, ident, Kind::Macro, &[Macros]);
                }
            }
            // Collect types and traits
            syn::Item::Struct(item) => {
                let named = matches!(item.fields, syn::Fields::Named(_));
                let spaces = [Types, Values];
                let spaces = if named { &spaces[..1] } else { &spaces[..] };
                let id =
                    self.declare(place, &item.ident, Kind::Type, spaces);
                let fields = fields(&item.fields);
                let generics = generics(&item.generics);
                self.items[id].shape =
                    Shape { scope, fields, generics, ..Shape::default() };
            }
            syn::Item::Enum(item) => {
                let ident = &item.ident;
                let id = self.declare(place, ident, Kind::Type, &[Types]);
                for variant in &item.variants {
                    let spaces = &[Types, Values];
                    let ident = &variant.ident;
                    self.declare((id, home), ident, Kind::Variant, spaces);
                }
            }
            syn::Item::Union(item) => {
                self.declare(place, &item.ident, Kind::Type, &[Types]);
            }
            syn::Item::Type(item) => {
                let ident = &item.ident;
                let id = self.declare(place, ident, Kind::Type, &[Types]);
                self.items[id].shape.scope = scope;
                self.items[id].shape.result = Some(&item.ty);
                self.items[id].shape.generics = generics(&item.generics);
            }
            syn::Item::Trait(item) => {
                let id =
                    self.declare(place, &item.ident, Kind::Trait, &[Types]);
                for member in &item.items {
                    // Collect a member of a trait
                    let place = (id, home);
                    match member {
                        syn::TraitItem::Fn(f) => {
                            let ident = &f.sig.ident;
                            let id = self.declare(
                                place,
                                ident,
                                Kind::Member,
                                &[Values],
                            );
                            self.items[id].shape = signature(&f.sig, scope);
                        }
                        syn::TraitItem::Const(c) => {
                            self.declare(
                                place,
                                &c.ident,
                                Kind::Member,
                                &[Values],
                            );
                        }
                        syn::TraitItem::Type(t) => {
                            self.declare(
                                place,
                                &t.ident,
                                Kind::Member,
                                &[Types],
                            );
                        }
                        _ => {}
                    }
                }
            }
            // Collect modules, imports and implementations
            syn::Item::Mod(item) => {
                let id = self.declare(
                    place,
                    &item.ident,
                    Kind::Module,
                    &[Types],
                );
                let dir = format!("{}/{}", home.dir, item.ident);
                match &item.content {
                    Some((_, items)) => {
                        self.collect(id, items, &Home { dir, ..*home });
                    }
                    None => self.read_module(id, &dir, item),
                }
            }
            syn::Item::Use(item) => {
                let root = item.leading_colon.map(|_| String::new());
                self.import(scope, root.into_iter().collect(), &item.tree);
            }
            syn::Item::Impl(item) => {
                self.implementations.push((scope, item));
            }
            _ => {}
        }
    }
    /// Reads the file of a module; without one the module is foreign.
    fn read_module(&mut self, id: Id, path: &str, item: &syn::ItemMod) {
        let files = [format!("{path}.rs"), format!("{path}/mod.rs")];
        let moved = item.attrs.iter().any(|a| a.path().is_ident("path"));
        let number = self.files.iter().position(|f| {
            files.iter().any(|path| path.trim_start_matches('/') == f.path)
        });
        match number.filter(|_| !moved) {
            Some(number) if self.modules[number] == usize::MAX => {
                self.read_file(number, id);
            }
            _ => {
                let name = (Space::Types, item.ident.to_string());
                let parent = self.items[id].parent;
                let members = parent.map(|p| &mut self.items[p].members);
                members.and_then(|m| m.insert(name, Found::Foreign));
            }
        }
    }
    /// Makes a scope of what a block of statements declares.
    pub fn open_block(&mut self, scope: Id, block: &'a syn::Block) -> Id {
        let id = self.add(String::new(), Kind::Block, Some(scope));
        let home = Home { file: None, dir: String::new() };
        let before = self.implementations.len();
        for statement in &block.stmts {
            if let syn::Stmt::Item(item) = statement {
                self.collect_item(id, item, &home);
            }
        }
        self.implementations.truncate(before);
        id
    }
}
fn signature(signature: &syn::Signature, scope: Id) -> Shape<'_> {
    let result = match &signature.output {
        syn::ReturnType::Type(_, result) => Some(&**result),
        syn::ReturnType::Default => None,
    };
    let method = signature.receiver().is_some();
    let generics = generics(&signature.generics);
    Shape { scope, result, method, generics, ..Shape::default() }
}

fn generics(generics: &syn::Generics) -> Vec<String> {
    let names = generics.params.iter().filter_map(|param| match param {
        syn::GenericParam::Type(t) => Some(t.ident.to_string()),
        syn::GenericParam::Const(c) => Some(c.ident.to_string()),
        syn::GenericParam::Lifetime(_) => None,
    });
    names.collect()
}

fn fields(fields: &syn::Fields) -> HashMap<String, &syn::Type> {
    let named = fields.iter().enumerate().map(|(number, field)| {
        let name = field.ident.as_ref().map(Ident::to_string);
        (name.unwrap_or(number.to_string()), &field.ty)
    });
    named.collect()
}
// Collect the imports of a module
impl Names<'_> {
    fn import(&mut self, scope: Id, mut path: Vec<String>, tree: &UseTree) {
        match tree {
            UseTree::Path(step) => {
                path.push(step.ident.to_string());
                self.import(scope, path, &step.tree);
            }
            UseTree::Group(group) => {
                for tree in &group.items {
                    self.import(scope, path.clone(), tree);
                }
            }
            UseTree::Glob(_) => self.items[scope].globs.push(path),
            UseTree::Name(leaf) => {
                self.import_name(scope, path, &leaf.ident, &leaf.ident);
            }
            UseTree::Rename(leaf) => {
                self.import_name(scope, path, &leaf.ident, &leaf.rename);
            }
        }
    }
    fn import_name(
        &mut self,
        scope: Id,
        mut path: Vec<String>,
        ident: &Ident,
        rename: &Ident,
    ) {
        let mut name = rename.to_string();
        if ident != "self" {
            path.push(ident.to_string());
        } else if rename == "self" {
            name = path.last().cloned().unwrap_or_default();
        }
        self.items[scope].imports.push(Import { name, path });
    }
}
// Attach implementations to their types
impl<'a> Names<'a> {
    fn implement(&mut self) {
        for (scope, item) in std::mem::take(&mut self.implementations) {
            let Some(id) = self.implementing_type(scope, item) else {
                continue;
            };
            match &item.trait_ {
                None => self.add_members(id, scope, item),
                Some((_, path, _)) => {
                    // Remember the trait and its names
                    let path = segments(path);
                    let found = self.path(scope, &path, Space::Types);
                    self.items[id].traits.push(found);
                    let names = item.items.iter().filter_map(member_name);
                    let names = names.map(Ident::to_string);
                    self.items[id].overridden.extend(names);
                }
            }
        }
    }
    /// The type, if it is one of ours, that an `impl` is for.
    pub fn implementing_type(
        &self,
        scope: Id,
        item: &syn::ItemImpl,
    ) -> Option<Id> {
        let syn::Type::Path(path) = &*item.self_ty else { return None };
        let names = segments(&path.path);
        let generic = generics(&item.generics).contains(&names[0]);
        if path.qself.is_some() || generic {
            return None;
        }
        match self.path(scope, &names, Space::Types) {
            Found::Item(id) => self.unalias(id),
            Found::Foreign => None,
        }
    }
    fn add_members(&mut self, id: Id, scope: Id, item: &'a syn::ItemImpl) {
        let home = Home { file: self.file_of(scope), dir: String::new() };
        for member in &item.items {
            let Some(ident) = member_name(member) else { continue };
            let spaces = &[Space::Values];
            let new =
                self.declare((id, &home), ident, Kind::Member, spaces);
            if let syn::ImplItem::Fn(f) = member {
                self.items[new].shape = signature(&f.sig, scope);
                let outer = generics(&item.generics);
                self.items[new].shape.generics.extend(outer);
            }
        }
    }

    fn file_of(&self, scope: Id) -> Option<usize> {
        let file = self.modules.iter().position(|m| *m == scope);
        let parent = self.items[scope].parent;
        file.or_else(|| self.file_of(parent?))
    }
}

/// The name of a function, a constant or a type in an `impl`.
pub fn member_name(member: &syn::ImplItem) -> Option<&Ident> {
    match member {
        syn::ImplItem::Fn(f) => Some(&f.sig.ident),
        syn::ImplItem::Const(c) => Some(&c.ident),
        syn::ImplItem::Type(t) => Some(&t.ident),
        _ => None,
    }
}

/// The names in a path; an empty one for `::` at its beginning.
pub fn segments(path: &syn::Path) -> Vec<String> {
    let root = path.leading_colon.map(|_| String::new());
    let names = path.segments.iter().map(|s| s.ident.to_string());
    root.into_iter().chain(names).collect()
}
// Look a name up in a scope
/// What is being looked up, lest an import be followed in a circle.
type Trail = Vec<(Id, Space, String)>;

impl Names<'_> {
    /// What a name means inside a module or a block, if anything.
    pub fn member(
        &self,
        scope: Id,
        space: Space,
        name: &str,
    ) -> Option<Found> {
        self.search(scope, space, name, &mut Trail::new())
    }

    fn search(
        &self,
        scope: Id,
        space: Space,
        name: &str,
        trail: &mut Trail,
    ) -> Option<Found> {
        let step = (space, name.to_string());
        if let Some(found) = self.items[scope].members.get(&step) {
            return Some(*found);
        }
        // Look into imports unless we came from there
        let step = (scope, step.0, step.1);
        if trail.contains(&step) {
            return None;
        }
        trail.push(step);
        let found = self.imported(scope, space, name, trail);
        let found =
            found.or_else(|| self.globbed(scope, space, name, trail));
        trail.pop();
        found
    }
    fn imported(
        &self,
        scope: Id,
        space: Space,
        name: &str,
        trail: &mut Trail,
    ) -> Option<Found> {
        let imports = self.items[scope].imports.iter();
        let mut imports = imports.filter(|import| import.name == name);
        imports.find_map(|import| {
            let steps = self.steps(scope, &import.path, space, trail);
            steps.last().copied().flatten()
        })
    }
    fn globbed(
        &self,
        scope: Id,
        space: Space,
        name: &str,
        trail: &mut Trail,
    ) -> Option<Found> {
        let mut found = None;
        for glob in &self.items[scope].globs {
            let steps = self.steps(scope, glob, Space::Types, trail);
            let Some(Some(Found::Item(id))) = steps.last() else {
                continue;
            };
            let here = self.search(*id, space, name, trail);
            let here = here.filter(|f| self.globs_take(*id, *f));
            found = match (found, here) {
                (Some(old), Some(new)) if old != new => {
                    Some(Found::Foreign)
                }
                _ => found.or(here),
            };
        }
        found
    }

    /// Of a type, only the variants are imported.
    fn globs_take(&self, from: Id, found: Found) -> bool {
        let Found::Item(id) = found else { return true };
        self.items[from].kind != Kind::Type
            || self.items[id].kind == Kind::Variant
    }
    /// What a name means where it stands: in its blocks, its module, and
    /// among the crates. A macro reaches the modules inside its own.
    fn lexical(
        &self,
        scope: Id,
        space: Space,
        name: &str,
        trail: &mut Trail,
    ) -> Option<Found> {
        if let Some(found) = self.search(scope, space, name, trail) {
            return Some(found);
        }
        let outward =
            self.items[scope].kind == Kind::Block || space == Space::Macros;
        match self.items[scope].parent {
            Some(parent) if outward => {
                self.lexical(parent, space, name, trail)
            }
            _ if space == Space::Types => self.library(name),
            _ => None,
        }
    }

    fn library(&self, name: &str) -> Option<Found> {
        self.libraries.get(name).map(|id| Found::Item(*id))
    }
}
// Follow a path from its beginning
impl Names<'_> {
    /// What a whole path means.
    pub fn path(&self, scope: Id, path: &[String], space: Space) -> Found {
        let steps = self.steps(scope, path, space, &mut Trail::new());
        steps.last().copied().flatten().unwrap_or(Found::Foreign)
    }

    /// What each name of a path means.
    fn steps(
        &self,
        scope: Id,
        path: &[String],
        space: Space,
        trail: &mut Trail,
    ) -> Vec<Option<Found>> {
        let mut steps: Vec<Option<Found>> = Vec::new();
        for (number, name) in path.iter().enumerate() {
            let last = number + 1 == path.len();
            let space = if last { space } else { Space::Types };
            let before = steps.last().copied();
            let step = match (before, &name[..]) {
                // Begin a path or take its next step
                (None, "") => None,
                (None, "crate") => Some(Found::Item(self.root_of(scope))),
                (None, "self") => Some(Found::Item(self.module_of(scope))),
                (None, "super") => self.above(self.module_of(scope)),
                (None, name) => self.lexical(scope, space, name, trail),
                (Some(Some(Found::Item(id))), "super") => self.above(id),
                (Some(Some(Found::Item(id))), name) => {
                    self.inside(id, space, name, trail)
                }
                (Some(None), name) if number == 1 && path[0].is_empty() => {
                    self.library(name).or(Some(Found::Foreign))
                }
                (Some(_), _) => Some(Found::Foreign),
            };
            steps.push(step);
        }
        steps
    }
    /// What a name means after an item and a double colon.
    pub fn inside(
        &self,
        id: Id,
        space: Space,
        name: &str,
        trail: &mut Trail,
    ) -> Option<Found> {
        let Item { kind, members, .. } = &self.items[id];
        if *kind == Kind::Module {
            return self.search(id, space, name, trail);
        }
        let step = (space, name.to_string());
        let found = members.get(&step).copied();
        if found.is_some() || *kind != Kind::Type {
            return found;
        }
        // Look behind an alias and into traits
        match self.unalias(id) {
            Some(real) if real != id => {
                self.inside(real, space, name, trail)
            }
            None => Some(Found::Foreign),
            _ => {
                let found = self.trait_members(id, &step);
                (found.len() == 1).then(|| Found::Item(found[0]))
            }
        }
    }
    /// The members of this name in the traits that a type implements.
    fn trait_members(&self, id: Id, step: &(Space, String)) -> Vec<Id> {
        let members = self.items[id].traits.iter().filter_map(|found| {
            let Found::Item(id) = found else { return None };
            match self.items[*id].members.get(step) {
                Some(Found::Item(member)) => Some(*member),
                _ => None,
            }
        });
        let distinct: HashSet<Id> = members.collect();
        distinct.into_iter().collect()
    }

    /// The type that an alias stands for, if it is one of ours.
    fn unalias(&self, mut id: Id) -> Option<Id> {
        for _ in 0..8 {
            let Item { kind, shape, .. } = &self.items[id];
            let target = shape.result.filter(|_| *kind == Kind::Type);
            let Some(target) = target else { return Some(id) };
            let syn::Type::Path(path) = target else { return None };
            let path = segments(&path.path);
            match self.path(shape.scope, &path, Space::Types) {
                Found::Item(next) => id = next,
                Found::Foreign => return None,
            }
        }
        None
    }
    /// The module that a block or a module is in.
    pub fn module_of(&self, scope: Id) -> Id {
        let Item { kind, parent, .. } = &self.items[scope];
        match parent {
            Some(parent) if *kind != Kind::Module => {
                self.module_of(*parent)
            }
            _ => scope,
        }
    }

    /// The root of the crate that a scope is in.
    pub fn root_of(&self, scope: Id) -> Id {
        self.items[scope].parent.map_or(scope, |id| self.root_of(id))
    }

    fn above(&self, id: Id) -> Option<Found> {
        self.items[id].parent.map(|id| Found::Item(self.module_of(id)))
    }
}
// Know the types of values
/// As much as we know of the type of a value. References are left out:
/// a method call goes through them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ty {
    /// A type of ours, or some type that has this trait of ours.
    Item(Id),
    /// `Option` or `Result` of it.
    Wrapped(Box<Ty>),
    /// A vector, a slice or an array of it.
    Many(Box<Ty>),
}

impl Names<'_> {
    /// The type that is written, as seen from a scope in which some names
    /// are generic parameters.
    pub fn ty(
        &self,
        (scope, this): (Id, Option<Id>),
        generics: &dyn Fn(&str) -> bool,
        ty: &syn::Type,
    ) -> Option<Ty> {
        let again = |ty| self.ty((scope, this), generics, ty);
        let many = |ty| again(ty).map(|ty| Ty::Many(Box::new(ty)));
        match ty {
            syn::Type::Reference(r) => again(&r.elem),
            syn::Type::Paren(p) => again(&p.elem),
            syn::Type::Slice(s) => many(&s.elem),
            syn::Type::Array(a) => many(&a.elem),
            syn::Type::ImplTrait(t) => self.bound(scope, &t.bounds),
            syn::Type::TraitObject(t) => self.bound(scope, &t.bounds),
            syn::Type::Path(path) if path.qself.is_none() => {
                // Recognise a type by its path
                let names = segments(&path.path);
                if names == ["Self"] {
                    return this.map(Ty::Item);
                }
                if generics(&names[0]) {
                    return None;
                }
                if let Found::Item(id) =
                    self.path(scope, &names, Space::Types)
                {
                    return self.unalias(id).map(Ty::Item);
                }
                let last = path.path.segments.last()?;
                let inner = || first_argument(last).and_then(again);
                match &last.ident.to_string()[..] {
                    "Option" | "Result" => {
                        Some(Ty::Wrapped(Box::new(inner()?)))
                    }
                    "Vec" => Some(Ty::Many(Box::new(inner()?))),
                    "Box" | "Rc" | "Arc" => inner(),
                    _ => None,
                }
            }
            _ => None,
        }
    }
    /// The trait of ours among the bounds of a type.
    pub fn bound<'b>(
        &self,
        scope: Id,
        bounds: impl IntoIterator<Item = &'b syn::TypeParamBound>,
    ) -> Option<Ty> {
        bounds.into_iter().find_map(|bound| {
            let syn::TypeParamBound::Trait(bound) = bound else {
                return None;
            };
            let path = segments(&bound.path);
            match self.path(scope, &path, Space::Types) {
                Found::Item(id) => Some(Ty::Item(id)),
                Found::Foreign => None,
            }
        })
    }
    /// The type of a field, by its name or number.
    pub fn field(&self, id: Id, name: &str) -> Option<Ty> {
        let shape = &self.items[id].shape;
        let ty = shape.fields.get(name)?;
        let generic = |name: &str| shape.generics.iter().any(|g| g == name);
        self.ty((shape.scope, Some(id)), &generic, ty)
    }

    /// The type of what a function, a constructor or a variant gives.
    pub fn result(&self, id: Id) -> Option<Ty> {
        let Item { kind, parent, shape, .. } = &self.items[id];
        match kind {
            Kind::Type => return Some(Ty::Item(id)),
            Kind::Variant => return parent.map(Ty::Item),
            _ => {}
        }
        let this = parent.filter(|id| self.items[*id].kind == Kind::Type);
        let generic = |name: &str| shape.generics.iter().any(|g| g == name);
        self.ty((shape.scope, this), &generic, shape.result?)
    }
}

fn first_argument(segment: &syn::PathSegment) -> Option<&syn::Type> {
    let syn::PathArguments::AngleBracketed(list) = &segment.arguments
    else {
        return None;
    };
    list.args.iter().find_map(|argument| match argument {
        syn::GenericArgument::Type(ty) => Some(ty),
        _ => None,
    })
}
// Find what a method call means
impl Names<'_> {
    /// The method of a type or a trait that a call by name means.
    ///
    /// A type's own method comes first, but a trait's method of the same
    /// name may come before it, by its receiver: then we do not know.
    pub fn method(&self, id: Id, name: &str) -> Option<Id> {
        let step = (Space::Values, name.to_string());
        let item = &self.items[id];
        // Prefer the type's own method
        let found = match item.members.get(&step) {
            Some(_) if item.overridden.contains(name) => None,
            Some(Found::Item(id)) => Some(*id),
            Some(Found::Foreign) => None,
            None => match &self.trait_members(id, &step)[..] {
                [one] => Some(*one),
                _ => None,
            },
        };
        found.filter(|id| self.items[*id].shape.method)
    }
}
