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
//! A name that anything in the same function declares, be it a variable,
//! a parameter or an inner item, is left alone in all of that function.
//! So the walk need not know where scopes begin and end.

use std::collections::HashSet;
use std::ops::Range;

use proc_macro2::{Ident, TokenStream, TokenTree};
use syn::parse::{ParseStream, Parser};
use syn::visit::{self, Visit};
use syn::{Expr, Pat, Token};

use crate::rust_names::{
    Id, Import, Kind, Names, declaration, imports, member, segments,
};

// Find what something near has taken
/// Names that are declared near a place, within the same function.
#[derive(Clone, Default)]
struct Taken {
    /// Variables, which a path of several names does not mean.
    variables: HashSet<String>,
    /// Inner items, imports and parameters of types.
    names: HashSet<String>,
}

impl Taken {
    fn add(&mut self, name: &Ident) {
        self.names.insert(name.to_string());
    }

    /// Adds all words, of which a macro may make anything.
    fn add_words(&mut self, tokens: TokenStream) {
        for token in tokens {
            match token {
                TokenTree::Ident(ident) => self.add(&ident),
                TokenTree::Group(group) => self.add_words(group.stream()),
                _ => {}
            }
        }
    }
}

impl<'a> Visit<'a> for Taken {
    fn visit_pat_ident(&mut self, pat: &'a syn::PatIdent) {
        self.variables.insert(pat.ident.to_string());
        visit::visit_pat_ident(self, pat);
    }

    fn visit_generic_param(&mut self, param: &'a syn::GenericParam) {
        match param {
            syn::GenericParam::Type(t) => self.add(&t.ident),
            syn::GenericParam::Const(c) => self.add(&c.ident),
            syn::GenericParam::Lifetime(_) => {}
        }
    }

    fn visit_item(&mut self, item: &'a syn::Item) {
        if let Some((ident, _)) = declaration(item) {
            self.add(ident);
        }
        visit::visit_item(self, item);
    }

    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        for import in imports(item) {
            // What a star brings in may be anything
            let name = import.name.map(Ident::to_string);
            self.names.insert(name.unwrap_or("*".into()));
        }
    }

    fn visit_macro(&mut self, call: &'a syn::Macro) {
        for expr in arguments(call).unwrap_or_default() {
            self.visit_expr(&expr);
        }
    }

    fn visit_stmt_macro(&mut self, call: &'a syn::StmtMacro) {
        match arguments(&call.mac) {
            Some(_) => self.visit_macro(&call.mac),
            None => self.add_words(call.mac.tokens.clone()),
        }
    }

    fn visit_pat(&mut self, pat: &'a Pat) {
        if let Pat::Macro(call) = pat {
            self.add_words(call.mac.tokens.clone());
        }
        visit::visit_pat(self, pat);
    }
}
// Walk through a file
/// A use: the bytes of the name, and the item.
pub type Use = (Range<usize>, Id);

struct Walk<'n> {
    names: &'n Names<'n>,
    module: Id,
    /// What `Self` stands for.
    this: Option<Id>,
    taken: Taken,
    uses: Vec<Use>,
}

/// All uses in a file that is this module.
pub fn uses(names: &Names, module: Id, syntax: &syn::File) -> Vec<Use> {
    let taken = Taken::default();
    let mut walk =
        Walk { names, module, this: None, taken, uses: Vec::new() };
    walk.visit_file(syntax);
    walk.uses
}

/// Whether a word is reserved.
pub fn is_keyword(word: &Ident) -> bool {
    syn::parse2::<Ident>(TokenTree::from(word.clone()).into()).is_err()
}
// Record what a path means
/// What may stand before a double colon, as a type, and as a value.
const BEGINNING: &[Kind] = &[Kind::Module, Kind::Type];
const TYPE: &[Kind] = &[Kind::Type, Kind::Variant];
const VALUE: &[Kind] = &[Kind::Type, Kind::Variant, Kind::Value];

impl Walk<'_> {
    /// Records a name if the path that ends with it means such an item,
    /// and nothing near has taken the first name.
    fn record(&mut self, ident: &Ident, path: &[String], kinds: &[Kind]) {
        let Taken { names, variables } = &self.taken;
        let alone = path.len() == 1 && kinds != BEGINNING;
        let taken = names.contains(&path[0])
            || names.contains("*")
            || alone && variables.contains(&path[0]);
        if taken || is_keyword(ident) {
            return;
        }
        let found = self.names.path((self.module, self.this), path);
        let fits = |id: &Id| kinds.contains(&self.names.items[*id].kind);
        if let Some(id) = found.filter(fits) {
            self.uses.push((ident.span().byte_range(), id));
        }
    }

    fn record_path(&mut self, path: &syn::Path, kinds: &[Kind]) {
        let names = segments(path);
        let first = names.len() - path.segments.len() + 1;
        for (segment, end) in path.segments.iter().zip(first..) {
            let last = end == names.len();
            let kinds = if last { kinds } else { BEGINNING };
            self.record(&segment.ident, &names[..end], kinds);
        }
    }

    /// `<Type as Trait>::name` is the trait's; `<Type>::name` we leave.
    fn visit_qualified(
        &mut self,
        qself: &Option<syn::QSelf>,
        path: &syn::Path,
        kinds: &[Kind],
    ) {
        if let Some(qself) = qself {
            self.visit_qself(qself);
        }
        if qself.as_ref().is_none_or(|qself| qself.position > 0) {
            self.record_path(path, kinds);
        }
        visit::visit_path(self, path);
    }

    /// Visits something in which more names are taken.
    fn within(&mut self, taken: Taken, visit: impl FnOnce(&mut Self)) {
        let outer = self.taken.clone();
        self.taken.variables.extend(taken.variables);
        self.taken.names.extend(taken.names);
        visit(self);
        self.taken = outer;
    }
}

impl<'a> Visit<'a> for Walk<'_> {
    fn visit_attribute(&mut self, _: &'a syn::Attribute) {}

    fn visit_visibility(&mut self, _: &'a syn::Visibility) {}

    // Visit items
    fn visit_item(&mut self, item: &'a syn::Item) {
        let mut taken = Taken::default();
        match item {
            syn::Item::Impl(item) => taken.visit_generics(&item.generics),
            syn::Item::Trait(item) => taken.visit_generics(&item.generics),
            syn::Item::Mod(_) | syn::Item::Use(_) => {}
            item => visit::visit_item(&mut taken, item),
        }
        self.within(taken, |walk| visit::visit_item(walk, item));
    }

    fn visit_impl_item(&mut self, item: &'a syn::ImplItem) {
        let mut taken = Taken::default();
        visit::visit_impl_item(&mut taken, item);
        self.within(taken, |walk| visit::visit_impl_item(walk, item));
    }

    fn visit_trait_item(&mut self, item: &'a syn::TraitItem) {
        let mut taken = Taken::default();
        visit::visit_trait_item(&mut taken, item);
        self.within(taken, |walk| visit::visit_trait_item(walk, item));
    }

    fn visit_item_mod(&mut self, item: &'a syn::ItemMod) {
        let name = item.ident.to_string();
        let near = self.taken.names.contains(&name);
        let found = self.names.path((self.module, None), &[name]);
        if let Some(id) = found.filter(|_| !near) {
            let outer = std::mem::replace(&mut self.module, id);
            visit::visit_item_mod(self, item);
            self.module = outer;
        }
    }

    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        let all = [BEGINNING, VALUE, &[Kind::Macro]].concat();
        for Import { path, .. } in imports(item) {
            let names = path.iter().map(|ident| ident.to_string());
            let names: Vec<String> = names.collect();
            for (ident, end) in path.iter().zip(1..) {
                self.record(ident, &names[..end], &all);
            }
        }
    }

    fn visit_item_impl(&mut self, item: &'a syn::ItemImpl) {
        let this = self.names.self_type(self.module, item);
        let name = |id: &Id| &self.names.items[*id].name;
        let this = this.filter(|id| !self.taken.names.contains(name(id)));
        let outer = std::mem::replace(&mut self.this, this);
        if let Some((_, path, _)) = &item.trait_ {
            // Lead the members to those of the trait
            for ident in item.items.iter().filter_map(member) {
                let mut names = segments(path);
                names.push(ident.to_string());
                self.record(ident, &names, VALUE);
            }
        }
        visit::visit_item_impl(self, item);
        self.this = outer;
    }

    // Visit paths
    fn visit_path(&mut self, path: &'a syn::Path) {
        self.visit_qualified(&None, path, TYPE);
    }

    fn visit_type_path(&mut self, ty: &'a syn::TypePath) {
        self.visit_qualified(&ty.qself, &ty.path, TYPE);
    }

    fn visit_expr_path(&mut self, expr: &'a syn::ExprPath) {
        self.visit_qualified(&expr.qself, &expr.path, VALUE);
    }

    fn visit_pat_tuple_struct(&mut self, pat: &'a syn::PatTupleStruct) {
        self.visit_qualified(&pat.qself, &pat.path, VALUE);
        pat.elems.iter().for_each(|pat| self.visit_pat(pat));
    }

    fn visit_macro(&mut self, call: &'a syn::Macro) {
        self.record_path(&call.path, &[Kind::Macro]);
        for expr in arguments(call).unwrap_or_default() {
            self.visit_expr(&expr);
        }
    }
}
// Read the arguments of known macros
/// The macros of the standard library whose arguments are expressions.
const CALLS: &str = "assert assert_eq assert_ne dbg debug_assert \
    debug_assert_eq debug_assert_ne eprint eprintln format format_args \
    panic print println todo unimplemented unreachable vec write writeln";

/// The arguments of a known macro.
fn arguments(call: &syn::Macro) -> Option<Vec<Expr>> {
    let name = call.path.get_ident()?.to_string();
    let known = CALLS.split(' ').any(|known| known == name);
    known.then(|| list.parse2(call.tokens.clone()).ok())?
}

/// Expressions between commas or semicolons; of `name = value`, the value.
fn list(input: ParseStream) -> syn::Result<Vec<Expr>> {
    let mut list = Vec::new();
    while !input.is_empty() {
        list.push(match input.parse()? {
            Expr::Assign(named) => *named.right,
            expr => expr,
        });
        if input.parse::<Option<Token![;]>>()?.is_none()
            && !input.is_empty()
        {
            input.parse::<Token![,]>()?;
        }
    }
    Ok(list)
}
