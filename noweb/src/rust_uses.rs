// Tangled from noweb/chapters/rust_index.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The uses of a program's items.
//!
//! A name that anything in the same item may declare, be it a variable, a
//! parameter or a function inside the function, is left alone in all of
//! the item. We need not find the bounds of scopes.

use std::collections::HashSet;
use std::ops::Range;

use crate::rust_names::{
    Item, Kind, Names, Place, Spot, Token, colons, declaration, imports,
    is_keyword, parameters, path_at,
};

#[derive(Default)]
struct Taken<'s> {
    /// Names of items, and of parameters of types.
    items: HashSet<&'s str>,
    /// Words that stand alone, as a variable does where it is declared.
    plain: HashSet<&'s str>,
}

/// The names that an item declares; none if they are hard to find.
fn taken<'s>(
    tokens: &[Token<'s>],
    place: &Place<'s>,
    range: Range<usize>,
) -> Option<Taken<'s>> {
    let mut taken = Taken::default();
    taken.items.extend(&place.parameters);
    taken.items.extend(parameters(tokens, range.start).0);
    for at in range {
        let (before, after) = (tokens[at - 1].text, tokens[at + 1].text);
        // Give up where scopes would matter
        match tokens[at].text {
            "use" | "macro_rules" => return None,
            "impl" | "enum" if matches!(before, ";" | "{" | "}" | "]") => {
                return None;
            }
            _ => {}
        }
        let declared = declaration(tokens, at).map(|(_, name)| name);
        taken.items.extend(declared.map(|name| tokens[name].text));
        let called = matches!(after, "(" | "!") || colons(tokens, at + 1);
        if is_first(tokens, at) && !called {
            taken.plain.insert(tokens[at].text);
        }
    }
    Some(taken)
}

/// Whether a token is the first word of a path: no field, no method, no
/// lifetime, and not behind two colons.
fn is_first(tokens: &[Token], at: usize) -> bool {
    let (before, earlier) = (tokens[at - 1].text, tokens[at - 2].text);
    let field = before == "." && earlier != ".";
    tokens[at].word && !field && before != "'" && !colons(tokens, at - 2)
}
pub type Use<'n> = (Spot, Item<'n>);

pub fn uses<'n>(names: &'n Names) -> Vec<Use<'n>> {
    let mut uses = Vec::new();
    for (place, range) in &names.bodies {
        let tokens = &names.files[place.file].tokens[..];
        let mut reader = Reader { names, tokens, place, uses: &mut uses };
        // The members of an implementation lead to the trait
        let name = range.start - 1;
        let member = names.member(place, tokens[name].text);
        reader.uses.extend(member.map(|item| ((place.file, name), item)));
        if tokens[range.start].text == "use" {
            for (path, _) in imports(tokens, range.start) {
                reader.record(&path, |_, _| true);
            }
        } else if let Some(taken) = taken(tokens, place, range.clone()) {
            reader.read(range.clone(), &taken);
        }
    }
    uses
}

struct Reader<'n, 'u> {
    names: &'n Names<'n>,
    tokens: &'n [Token<'n>],
    place: &'n Place<'n>,
    uses: &'u mut Vec<Use<'n>>,
}

impl Reader<'_, '_> {
    /// Records what each beginning of a path means, if its kind fits; the
    /// whole path is the last of them.
    fn record(&mut self, path: &[usize], fit: impl Fn(Kind, bool) -> bool) {
        let names = path.iter().map(|at| self.tokens[*at].text);
        let names: Vec<_> = names.collect();
        for (at, end) in path.iter().zip(1..) {
            let item = self.names.find(self.place, &names[..end]);
            let item = item.filter(|(_, k)| fit(*k, end == path.len()));
            let spot = (self.place.file, *at);
            self.uses.extend(item.map(|item| (spot, item)));
        }
    }

    fn read(&mut self, range: Range<usize>, taken: &Taken) {
        let mut at = range.start;
        while at < range.end {
            let attribute = self.tokens[at - 1].text == "#";
            at = match is_first(self.tokens, at) {
                true => self.read_path(at, taken),
                false if attribute => self.tokens[at].close + 1,
                false => at + 1,
            };
        }
    }

    /// Reads the path that begins at a token; returns where to go on.
    fn read_path(&mut self, start: usize, taken: &Taken) -> usize {
        let tokens = self.tokens;
        let (path, name) = (path_at(tokens, start), tokens[start].text);
        let alone = path.len() == 1;
        let next = start + 3 * path.len() - 2;
        let (after, then) = (tokens[next].text, tokens[next + 1].text);
        let call = after == "!" && then != "=" && !is_keyword(name);
        // Skip a word that is declared here
        let declares = match after {
            ":" => alone && then != ":",
            "=" if matches!(then, "=" | ">") => false,
            "=" => alone && tokens[start - 1].text != ":",
            _ => declaration(tokens, start - 1).is_some(),
        };
        if !declares && !taken.items.contains(name) {
            // Record the items that fit
            self.record(&path, |kind, last| match kind {
                Kind::Macro => call,
                Kind::Module => !last,
                Kind::Function if alone => {
                    let called = after == "(" || after == ":";
                    called && !taken.plain.contains(name)
                }
                Kind::Type => !call,
                _ => last && !call,
            });
        }
        match call && !CALLS.split(' ').any(|known| known == name) {
            true => tokens[next + 1].close + 1,
            false => next,
        }
    }
}

/// The macros of the standard library whose arguments are expressions.
const CALLS: &str = "assert assert_eq assert_ne dbg debug_assert \
    debug_assert_eq debug_assert_ne eprint eprintln format format_args \
    matches panic print println todo unimplemented unreachable vec write \
    writeln";
