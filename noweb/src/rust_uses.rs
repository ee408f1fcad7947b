// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The uses of a program's items in one of its files.
//!
//! The file is walked with the scopes of its blocks on a stack. A name
//! that a local variable or a generic parameter has taken is no use of an
//! item, and neither is one that [`crate::rust_names`] calls foreign.

use std::collections::HashMap;
use std::ops::Range;

use proc_macro2::Ident;
use syn::parse::{ParseStream, Parser};
use syn::visit::{self, Visit};
use syn::visit_mut::{self, VisitMut};
use syn::{Expr, Pat, Token};

use crate::rust_names::{
    Found, Id, Kind, Names, Space, Ty, member_name, segments,
};

// Keep the scopes of a walk
/// A use: the bytes of the name, and the item.
pub type Use = (Range<usize>, Id);

/// What a block, a function or a closure adds to what names mean.
#[derive(Default)]
struct Rib {
    locals: HashMap<String, Option<Ty>>,
    generics: HashMap<String, Option<Ty>>,
    /// The items that are declared in the block.
    block: Option<Id>,
}

struct Walk<'n, 'a> {
    names: &'n mut Names<'a>,
    module: Id,
    /// What `Self` stands for.
    this: Option<Id>,
    ribs: Vec<Rib>,
    uses: Vec<Use>,
}

/// All uses in a file that is known to `names` by its number.
pub fn uses<'a>(
    names: &mut Names<'a>,
    number: usize,
    syntax: &'a syn::File,
) -> Vec<Use> {
    let module = names.modules[number];
    let ribs = Vec::new();
    let mut walk =
        Walk { names, module, this: None, ribs, uses: Vec::new() };
    walk.visit_file(syntax);
    walk.uses
}
// Look a name up from a place
impl Walk<'_, '_> {
    /// The innermost block that declares items, or the module.
    fn scope(&self) -> Id {
        let blocks = self.ribs.iter().rev().filter_map(|rib| rib.block);
        blocks.into_iter().next().unwrap_or(self.module)
    }

    /// What the first name of a path means.
    fn first(&self, name: &str, space: Space) -> Found {
        if name == "Self" {
            return self.this.map_or(Found::Foreign, Found::Item);
        }
        for rib in self.ribs.iter().rev() {
            let local =
                space == Space::Values && rib.locals.contains_key(name);
            if local || rib.generics.contains_key(name) {
                return Found::Foreign;
            }
            // Stop at a block that declares the name
            if let Some(block) = rib.block
                && let Some(found) = self.names.member(block, space, name)
            {
                return found;
            }
        }
        self.names.path(self.module, &[name.to_string()], space)
    }
    /// What the names of a path mean, from the first one on.
    fn follow(&self, names: &[String], space: Space) -> Vec<Found> {
        let special = ["", "crate", "self", "super"];
        let plain = !special.contains(&&names[0][..]);
        (1..=names.len())
            .map(|count| {
                let last = count == names.len();
                let space = if last { space } else { Space::Types };
                match (plain, count) {
                    (true, 1) => self.first(&names[0], space),
                    (true, _) => self.beyond(&names[..count], space),
                    _ => {
                        let scope = self.scope();
                        self.names.path(scope, &names[..count], space)
                    }
                }
            })
            .collect()
    }

    fn beyond(&self, names: &[String], space: Space) -> Found {
        let mut found = self.first(&names[0], Space::Types);
        for (number, name) in names.iter().enumerate().skip(1) {
            let last = number + 1 == names.len();
            let space = if last { space } else { Space::Types };
            let Found::Item(id) = found else { return found };
            let trail = &mut Vec::new();
            let inside = self.names.inside(id, space, name, trail);
            found = inside.unwrap_or(Found::Foreign);
        }
        found
    }
}
// Record what a path uses
impl<'a> Walk<'_, 'a> {
    fn record(&mut self, ident: &Ident, found: Found) {
        let written = ["self", "Self", "super", "crate"];
        if let Found::Item(id) = found
            && written.iter().all(|keyword| ident != keyword)
            && self.names.items[id].site.is_some()
        {
            self.uses.push((ident.span().byte_range(), id));
        }
    }

    fn use_path(&mut self, path: &'a syn::Path, space: Space) -> Found {
        let names = segments(path);
        let found = self.follow(&names, space);
        let skipped = names.len() - path.segments.len();
        for (segment, found) in path.segments.iter().zip(&found[skipped..])
        {
            self.record(&segment.ident, *found);
        }
        for segment in &path.segments {
            self.visit_path_arguments(&segment.arguments);
        }
        found.last().copied().unwrap_or(Found::Foreign)
    }
    /// `<Type as Trait>::name`: the trait's member, after the type.
    fn use_qualified(
        &mut self,
        qself: &'a Option<syn::QSelf>,
        path: &'a syn::Path,
        space: Space,
    ) -> Found {
        match qself {
            None => self.use_path(path, space),
            Some(qself) => {
                self.visit_type(&qself.ty);
                match qself.position {
                    0 => Found::Foreign,
                    _ => self.use_path(path, space),
                }
            }
        }
    }
}
impl<'a> Walk<'_, 'a> {
    fn use_tree(&mut self, mut names: Vec<String>, tree: &syn::UseTree) {
        // Take the name at this branch of the tree
        let ident = match tree {
            syn::UseTree::Path(step) => &step.ident,
            syn::UseTree::Name(leaf) => &leaf.ident,
            syn::UseTree::Rename(leaf) => &leaf.ident,
            syn::UseTree::Glob(_) => return,
            syn::UseTree::Group(group) => {
                for tree in &group.items {
                    self.use_tree(names.clone(), tree);
                }
                return;
            }
        };
        names.push(ident.to_string());
        let found = match tree {
            syn::UseTree::Path(_) => self.imported(&names, Space::Types),
            _ => self.imported_anyhow(&names),
        };
        self.record(ident, found);
        if let syn::UseTree::Path(step) = tree {
            self.use_tree(names, &step.tree);
        }
    }
    fn imported(&self, names: &[String], space: Space) -> Found {
        self.names.path(self.scope(), names, space)
    }

    /// What an import brings in, if that is one item only.
    fn imported_anyhow(&self, names: &[String]) -> Found {
        let spaces = [Space::Types, Space::Values, Space::Macros];
        let found = spaces.map(|space| self.imported(names, space));
        let mut items: Vec<Found> = found.into();
        items.retain(|found| *found != Found::Foreign);
        items.dedup();
        match items[..] {
            [one] => one,
            _ => Found::Foreign,
        }
    }
}
// Visit the items of a file
impl<'a> Walk<'_, 'a> {
    fn with_rib(&mut self, rib: Rib, visit: impl FnOnce(&mut Self)) {
        self.ribs.push(rib);
        visit(self);
        self.ribs.pop();
    }

    /// Visits an item in a rib of its generic parameters.
    fn with_generics(
        &mut self,
        generics: &'a syn::Generics,
        visit: impl FnOnce(&mut Self),
    ) {
        let mut rib = Rib::default();
        for param in &generics.params {
            match param {
                // Enter a generic parameter into the rib
                syn::GenericParam::Type(t) => {
                    let bound = self.names.bound(self.scope(), &t.bounds);
                    rib.generics.insert(t.ident.to_string(), bound);
                }
                syn::GenericParam::Const(c) => {
                    rib.generics.insert(c.ident.to_string(), None);
                }
                syn::GenericParam::Lifetime(_) => {}
            }
        }
        self.with_rib(rib, |walk| {
            walk.visit_generics(generics);
            visit(walk);
        });
    }
    /// Visits an item out of reach of the variables around it.
    fn apart(&mut self, visit: impl FnOnce(&mut Self)) {
        let bare = |rib: &Rib| Rib { block: rib.block, ..Rib::default() };
        let inner = self.ribs.iter().map(bare).collect();
        let outer = std::mem::replace(&mut self.ribs, inner);
        let this = self.this;
        visit(self);
        (self.ribs, self.this) = (outer, this);
    }

    fn function(
        &mut self,
        signature: &'a syn::Signature,
        body: Option<&'a syn::Block>,
    ) {
        self.with_generics(&signature.generics, |walk| {
            for input in &signature.inputs {
                // Visit a parameter and bind it
                match input {
                    syn::FnArg::Receiver(receiver) => {
                        walk.visit_type(&receiver.ty)
                    }
                    syn::FnArg::Typed(typed) => {
                        walk.visit_type(&typed.ty);
                        let ty = walk.ty(&typed.ty);
                        walk.bind(&typed.pat, ty);
                    }
                }
            }
            walk.visit_return_type(&signature.output);
            if let Some(body) = body {
                walk.visit_block(body);
            }
        });
    }
}
impl<'a> Visit<'a> for Walk<'_, 'a> {
    fn visit_attribute(&mut self, _: &'a syn::Attribute) {}

    fn visit_visibility(&mut self, _: &'a syn::Visibility) {}

    fn visit_item_mod(&mut self, item: &'a syn::ItemMod) {
        let name = item.ident.to_string();
        let found = self.names.member(self.module, Space::Types, &name);
        if let (Some(Found::Item(id)), Some(_)) = (found, &item.content) {
            let outer = std::mem::replace(&mut self.module, id);
            self.apart(|walk| visit::visit_item_mod(walk, item));
            self.module = outer;
        }
    }

    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        let root = item.leading_colon.map(|_| String::new());
        self.use_tree(root.into_iter().collect(), &item.tree);
    }

    // Visit functions and what has generic parameters
    fn visit_item_fn(&mut self, item: &'a syn::ItemFn) {
        self.apart(|walk| walk.function(&item.sig, Some(&item.block)));
    }

    fn visit_item_struct(&mut self, item: &'a syn::ItemStruct) {
        self.apart(|walk| {
            walk.with_generics(&item.generics, |walk| {
                visit::visit_fields(walk, &item.fields);
            });
        });
    }

    fn visit_item_enum(&mut self, item: &'a syn::ItemEnum) {
        self.apart(|walk| {
            walk.with_generics(&item.generics, |walk| {
                for variant in &item.variants {
                    visit::visit_variant(walk, variant);
                }
            });
        });
    }

    fn visit_item_type(&mut self, item: &'a syn::ItemType) {
        self.apart(|walk| {
            walk.with_generics(&item.generics, |walk| {
                walk.visit_type(&item.ty);
            });
        });
    }

    // Visit an implementation or a trait
    fn visit_item_impl(&mut self, item: &'a syn::ItemImpl) {
        let scope = self.scope();
        self.apart(|walk| {
            walk.this = walk.names.implementing_type(scope, item);
            walk.with_generics(&item.generics, |walk| {
                walk.visit_type(&item.self_ty);
                if let Some((_, path, _)) = &item.trait_ {
                    let found = walk.use_path(path, Space::Types);
                    walk.use_members(found, item);
                }
                for member in &item.items {
                    walk.visit_impl_item(member);
                }
            });
        });
    }

    fn visit_impl_item_fn(&mut self, item: &'a syn::ImplItemFn) {
        self.function(&item.sig, Some(&item.block));
    }

    fn visit_item_trait(&mut self, item: &'a syn::ItemTrait) {
        let name = item.ident.to_string();
        let found = self.first(&name, Space::Types);
        self.apart(|walk| {
            walk.this = match found {
                Found::Item(id) => Some(id),
                Found::Foreign => None,
            };
            walk.with_generics(&item.generics, |walk| {
                for bound in &item.supertraits {
                    walk.visit_type_param_bound(bound);
                }
                for member in &item.items {
                    walk.visit_trait_item(member);
                }
            });
        });
    }

    fn visit_trait_item_fn(&mut self, item: &'a syn::TraitItemFn) {
        self.function(&item.sig, item.default.as_ref());
    }

    // Forward what is visited to its function
    fn visit_block(&mut self, block: &'a syn::Block) {
        self.block(block);
    }

    fn visit_local(&mut self, local: &'a syn::Local) {
        self.local(local);
    }

    fn visit_pat(&mut self, pat: &'a Pat) {
        self.bind(pat, None);
    }

    fn visit_arm(&mut self, arm: &'a syn::Arm) {
        self.arm(arm, None);
    }

    fn visit_expr(&mut self, expr: &'a Expr) {
        self.expression(expr);
    }

    fn visit_type_path(&mut self, ty: &'a syn::TypePath) {
        let types = self.follow(&segments(&ty.path), Space::Types);
        let unknown = types == [Found::Foreign];
        let values = ty.path.get_ident().filter(|_| unknown).is_some();
        let space = if values { Space::Values } else { Space::Types };
        self.use_qualified(&ty.qself, &ty.path, space);
    }

    fn visit_trait_bound(&mut self, bound: &'a syn::TraitBound) {
        self.use_path(&bound.path, Space::Types);
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        for segment in &path.segments {
            self.visit_path_arguments(&segment.arguments);
        }
    }

    fn visit_macro(&mut self, item: &'a syn::Macro) {
        let names = segments(&item.path);
        let found = self.follow(&names, Space::Macros);
        let skipped = names.len() - found.len();
        for (segment, found) in
            item.path.segments.iter().zip(&found[skipped..])
        {
            self.record(&segment.ident, *found);
        }
    }
}
impl Walk<'_, '_> {
    /// What an `impl` of our trait declares is a use of the trait's.
    fn use_members(&mut self, found: Found, item: &syn::ItemImpl) {
        let Found::Item(id) = found else { return };
        for ident in item.items.iter().filter_map(member_name) {
            for space in [Space::Values, Space::Types] {
                let name = ident.to_string();
                let trail = &mut Vec::new();
                let found = self.names.inside(id, space, &name, trail);
                self.record(ident, found.unwrap_or(Found::Foreign));
            }
        }
    }
}
// Visit blocks and bind patterns
impl<'a> Walk<'_, 'a> {
    fn block(&mut self, block: &'a syn::Block) {
        let is_item = |s: &syn::Stmt| matches!(s, syn::Stmt::Item(_));
        let scope = self.scope();
        let items = block.stmts.iter().any(is_item);
        let items = items.then(|| self.names.open_block(scope, block));
        self.with_rib(Rib { block: items, ..Rib::default() }, |walk| {
            for statement in &block.stmts {
                walk.visit_stmt(statement);
            }
        });
    }

    fn local(&mut self, local: &'a syn::Local) {
        let mut ty = None;
        if let Some(init) = &local.init {
            self.visit_expr(&init.expr);
            ty = self.type_of(&init.expr);
            if let Some((_, diverge)) = &init.diverge {
                self.visit_expr(diverge);
            }
        }
        self.bind(&local.pat, ty);
    }
    /// Visits a pattern, which matches a value of this type.
    fn bind(&mut self, pat: &'a Pat, ty: Option<Ty>) {
        match pat {
            Pat::Ident(ident) => self.bind_name(ident, ty),
            Pat::Type(typed) => {
                self.visit_type(&typed.ty);
                let ty = self.ty(&typed.ty);
                self.bind(&typed.pat, ty);
            }
            Pat::Reference(inner) => self.bind(&inner.pat, ty),
            Pat::Paren(inner) => self.bind(&inner.pat, ty),
            Pat::Or(or) => {
                for case in &or.cases {
                    self.bind(case, ty.clone());
                }
            }
            // Bind the parts of a structure
            Pat::TupleStruct(tuple) => {
                self.use_qualified(
                    &tuple.qself,
                    &tuple.path,
                    Space::Values,
                );
                let name =
                    tuple.path.segments.last().map(|s| s.ident.to_string());
                let wraps = matches!(name.as_deref(), Some("Some" | "Ok"));
                for pat in &tuple.elems {
                    let inner = match &ty {
                        Some(Ty::Wrapped(ty)) if wraps => {
                            Some((**ty).clone())
                        }
                        _ => None,
                    };
                    self.bind(pat, inner);
                }
            }
            Pat::Struct(pattern) => {
                let path = &pattern.path;
                let found =
                    self.use_qualified(&pattern.qself, path, Space::Types);
                for field in &pattern.fields {
                    let ty = self.field_of(found, &field.member);
                    self.bind(&field.pat, ty);
                }
            }
            Pat::Path(path) => {
                self.use_qualified(&path.qself, &path.path, Space::Values);
            }
            _ => visit::visit_pat(self, pat),
        }
    }
    /// Binds a name, unless a constant or a variant has it.
    fn bind_name(&mut self, pat: &'a syn::PatIdent, ty: Option<Ty>) {
        let name = pat.ident.to_string();
        let plain = pat.by_ref.is_none() && pat.subpat.is_none();
        let found = self.fixed(&name).filter(|_| plain);
        if let Some(found) = found.filter(|_| pat.mutability.is_none()) {
            return self.record(&pat.ident, found);
        }
        if let Some((_, inner)) = &pat.subpat {
            self.bind(inner, ty.clone());
        }
        if let Some(rib) = self.ribs.last_mut() {
            rib.locals.insert(name, ty);
        }
    }

    /// The constant, variant or empty structure of a name, if any.
    fn fixed(&self, name: &str) -> Option<Found> {
        let found = self.first(name, Space::Values);
        let Found::Item(id) = found else { return None };
        let kind = self.names.items[id].kind;
        let fixed = [Kind::Constant, Kind::Variant, Kind::Type];
        fixed.contains(&kind).then_some(found)
    }
    fn field_of(&self, found: Found, member: &syn::Member) -> Option<Ty> {
        let Found::Item(id) = found else { return None };
        self.names.field(id, &field_name(member))
    }

    fn arm(&mut self, arm: &'a syn::Arm, ty: Option<Ty>) {
        self.with_rib(Rib::default(), |walk| {
            walk.bind(&arm.pat, ty);
            if let Some((_, guard)) = &arm.guard {
                walk.visit_expr(guard);
            }
            walk.visit_expr(&arm.body);
        });
    }
}

fn field_name(member: &syn::Member) -> String {
    match member {
        syn::Member::Named(name) => name.to_string(),
        syn::Member::Unnamed(index) => index.index.to_string(),
    }
}
// Visit expressions and types
impl<'a> Walk<'_, 'a> {
    fn expression(&mut self, expr: &'a Expr) {
        match expr {
            Expr::Path(path) => {
                self.use_qualified(&path.qself, &path.path, Space::Values);
            }
            Expr::Struct(value) => {
                let (qself, path) = (&value.qself, &value.path);
                self.use_qualified(qself, path, Space::Types);
                for field in &value.fields {
                    self.visit_expr(&field.expr);
                }
                if let Some(rest) = &value.rest {
                    self.visit_expr(rest);
                }
            }
            Expr::MethodCall(call) => self.method_call(call),
            // Visit what opens a scope
            Expr::Let(condition) => {
                self.visit_expr(&condition.expr);
                let ty = self.type_of(&condition.expr);
                self.bind(&condition.pat, ty);
            }
            Expr::If(branch) => {
                self.with_rib(Rib::default(), |walk| {
                    walk.visit_expr(&branch.cond);
                    walk.visit_block(&branch.then_branch);
                });
                if let Some((_, other)) = &branch.else_branch {
                    self.visit_expr(other);
                }
            }
            Expr::While(body) => self.with_rib(Rib::default(), |walk| {
                walk.visit_expr(&body.cond);
                walk.visit_block(&body.body);
            }),
            Expr::ForLoop(body) => {
                self.visit_expr(&body.expr);
                let ty = match self.type_of(&body.expr) {
                    Some(Ty::Many(ty)) => Some(*ty),
                    _ => None,
                };
                self.with_rib(Rib::default(), |walk| {
                    walk.bind(&body.pat, ty);
                    walk.visit_block(&body.body);
                });
            }
            Expr::Match(choice) => {
                self.visit_expr(&choice.expr);
                let ty = self.type_of(&choice.expr);
                for arm in &choice.arms {
                    self.arm(arm, ty.clone());
                }
            }
            Expr::Closure(closure) => {
                self.with_rib(Rib::default(), |walk| {
                    for input in &closure.inputs {
                        walk.bind(input, None);
                    }
                    walk.visit_return_type(&closure.output);
                    walk.visit_expr(&closure.body);
                })
            }
            _ => visit::visit_expr(self, expr),
        }
    }
    fn method_call(&mut self, call: &'a syn::ExprMethodCall) {
        self.visit_expr(&call.receiver);
        if let Some(found) = self.method_of(call) {
            self.record(&call.method, Found::Item(found));
        }
        if let Some(generics) = &call.turbofish {
            self.visit_angle_bracketed_generic_arguments(generics);
        }
        for argument in &call.args {
            self.visit_expr(argument);
        }
    }

    fn method_of(&self, call: &syn::ExprMethodCall) -> Option<Id> {
        match self.type_of(&call.receiver)? {
            Ty::Item(id) => self.names.method(id, &call.method.to_string()),
            _ => None,
        }
    }
}
// Infer the type of an expression
impl Walk<'_, '_> {
    /// A type as it is written here.
    fn ty(&self, ty: &syn::Type) -> Option<Ty> {
        let ty_of_param = |name: &str| {
            let mut ribs = self.ribs.iter().rev();
            ribs.find_map(|rib| rib.generics.get(name).cloned())
        };
        let generic = |name: &str| ty_of_param(name).is_some();
        if let Some(name) = parameter(ty)
            && let Some(bound) = ty_of_param(&name)
        {
            return bound;
        }
        self.names.ty((self.scope(), self.this), &generic, ty)
    }
    /// The type of a value, as far as the text itself tells it.
    fn type_of(&self, expr: &Expr) -> Option<Ty> {
        match expr {
            Expr::Path(path) => self.type_of_path(path),
            Expr::Reference(inner) => self.type_of(&inner.expr),
            Expr::Paren(inner) => self.type_of(&inner.expr),
            Expr::Struct(value) => self.type_named(&value.path),
            Expr::Field(field) => match self.type_of(&field.base)? {
                Ty::Item(id) => {
                    self.names.field(id, &field_name(&field.member))
                }
                _ => None,
            },
            Expr::Try(inner) => match self.type_of(&inner.expr)? {
                Ty::Wrapped(ty) => Some(*ty),
                _ => None,
            },
            Expr::Call(call) => match &*call.func {
                Expr::Path(path) => self.type_of_call(path),
                _ => None,
            },
            Expr::MethodCall(call) => self.type_of_method(call),
            _ => None,
        }
    }
    fn type_of_path(&self, path: &syn::ExprPath) -> Option<Ty> {
        let name = path.path.get_ident()?.to_string();
        if name == "self" {
            return self.this.map(Ty::Item);
        }
        let mut ribs = self.ribs.iter().rev();
        ribs.find_map(|rib| rib.locals.get(&name).cloned()).flatten()
    }

    fn type_named(&self, path: &syn::Path) -> Option<Ty> {
        let path = syn::TypePath { qself: None, path: path.clone() };
        match self.ty(&syn::Type::Path(path)) {
            Some(Ty::Item(id)) => self.names.result(id),
            _ => None,
        }
    }

    fn type_of_call(&self, path: &syn::ExprPath) -> Option<Ty> {
        let names = segments(&path.path);
        if path.qself.is_some() {
            return None;
        }
        match self.follow(&names, Space::Values).last()? {
            Found::Item(id) => self.names.result(*id),
            Found::Foreign => None,
        }
    }
    fn type_of_method(&self, call: &syn::ExprMethodCall) -> Option<Ty> {
        let name = call.method.to_string();
        match (self.type_of(&call.receiver)?, &name[..]) {
            (Ty::Item(id), name) => {
                self.names.result(self.names.method(id, name)?)
            }
            (Ty::Wrapped(ty), "unwrap" | "expect") => Some(*ty),
            (Ty::Wrapped(ty), "as_ref" | "as_mut" | "ok" | "map_err") => {
                Some(Ty::Wrapped(ty))
            }
            (Ty::Many(ty), "iter" | "iter_mut" | "into_iter") => {
                Some(Ty::Many(ty))
            }
            (Ty::Many(ty), "first" | "last") => Some(Ty::Wrapped(ty)),
            _ => None,
        }
    }
}

/// The single name that a type may be, behind references.
fn parameter(ty: &syn::Type) -> Option<String> {
    match ty {
        syn::Type::Reference(r) => parameter(&r.elem),
        syn::Type::Path(path) if path.qself.is_none() => {
            path.path.get_ident().map(Ident::to_string)
        }
        _ => None,
    }
}
// Unfold the macros whose arguments are known
/// The macros of the standard library whose arguments are expressions.
const CALLS: &str = "assert assert_eq assert_ne dbg debug_assert \
    debug_assert_eq debug_assert_ne eprint eprintln format format_args \
    panic print println todo unimplemented unreachable vec write writeln";

/// Replaces calls of known macros by expressions with their arguments.
pub fn unfold(syntax: &mut syn::File) {
    Unfolder.visit_file_mut(syntax);
}

struct Unfolder;

impl VisitMut for Unfolder {
    fn visit_expr_mut(&mut self, expr: &mut Expr) {
        if let Expr::Macro(call) = expr
            && let Some(unfolded) = arguments(&call.mac)
        {
            *expr = unfolded;
        }
        visit_mut::visit_expr_mut(self, expr);
    }

    fn visit_stmt_mut(&mut self, statement: &mut syn::Stmt) {
        if let syn::Stmt::Macro(call) = statement
            && let Some(unfolded) = arguments(&call.mac)
        {
            *statement = syn::Stmt::Expr(unfolded, None);
        }
        visit_mut::visit_stmt_mut(self, statement);
    }
}
/// The arguments of a known macro, as one expression.
fn arguments(call: &syn::Macro) -> Option<Expr> {
    let name = call.path.get_ident()?.to_string();
    let tokens = call.tokens.clone();
    match &name[..] {
        "matches" => question.parse2(tokens).ok(),
        _ if CALLS.split(' ').any(|known| known == name) => {
            list.parse2(tokens).ok()
        }
        _ => None,
    }
}

/// Expressions between commas or semicolons; of `name = value`, the value.
fn list(input: ParseStream) -> syn::Result<Expr> {
    let mut array = syn::ExprArray {
        attrs: Vec::new(),
        bracket_token: Default::default(),
        elems: Default::default(),
    };
    while !input.is_empty() {
        array.elems.push(match input.parse()? {
            Expr::Assign(named) => *named.right,
            expr => expr,
        });
        if input.peek(Token![;]) {
            input.parse::<Token![;]>()?;
        } else if !input.is_empty() {
            input.parse::<Token![,]>()?;
        }
    }
    Ok(Expr::Array(array))
}
/// The expression, the pattern and the guard of `matches!`.
fn question(input: ParseStream) -> syn::Result<Expr> {
    let expr: Expr = input.parse()?;
    input.parse::<Token![,]>()?;
    let pat = Pat::parse_multi_with_leading_vert(input)?;
    let guard = match input.parse::<Option<Token![if]>>()? {
        Some(keyword) => Some((keyword, input.parse()?)),
        None => None,
    };
    input.parse::<Option<Token![,]>>()?;
    // Pose the question as a match
    let arm = syn::Arm {
        attrs: Vec::new(),
        pat,
        guard,
        fat_arrow_token: Default::default(),
        body: Box::new(Expr::Verbatim(Default::default())),
        comma: None,
    };
    Ok(Expr::Match(syn::ExprMatch {
        attrs: Vec::new(),
        match_token: Default::default(),
        expr: Box::new(expr),
        brace_token: Default::default(),
        arms: vec![arm],
    }))
}
