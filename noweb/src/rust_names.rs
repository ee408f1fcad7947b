// Tangled from noweb/chapters/rust_index.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The items of a Rust program, and the meanings of its paths.
//!
//! An item is identified by its path from the root of its crate. A name
//! is never resolved to an item if it has more than one meaning, or if the
//! program's own text does not determine its meaning.

use std::collections::HashMap;
use std::ops::Range;

use proc_macro2::{LexError, TokenStream, TokenTree};

pub struct Token<'s> {
    pub text: &'s str,
    /// Its bytes in the source.
    pub range: Range<usize>,
    /// Whether it is a word, be it reserved or not.
    pub word: bool,
    /// The number of the token that closes its group, else its own.
    pub close: usize,
}

/// The tokens of a source in their order, between four empty ones, so that
/// each has two neighbours on both sides.
pub fn tokens(source: &str) -> Result<Vec<Token<'_>>, LexError> {
    let mut row = Row { source, tokens: Vec::new() };
    (0..2).for_each(|_| row.push(0..0, false));
    row.append(source.parse()?);
    let end = source.len();
    (0..2).for_each(|_| row.push(end..end, false));
    Ok(row.tokens)
}

struct Row<'s> {
    source: &'s str,
    tokens: Vec<Token<'s>>,
}

impl Row<'_> {
    fn push(&mut self, range: Range<usize>, word: bool) {
        let (text, close) =
            (&self.source[range.clone()], self.tokens.len());
        self.tokens.push(Token { text, range, word, close });
    }

    fn append(&mut self, stream: TokenStream) {
        for token in stream {
            let range = token.span().byte_range();
            // The tokens of a comment for documentation lie upon each other
            let last = self.tokens.last().map_or(0, |last| last.range.end);
            if range.start < last {
                continue;
            }
            if let TokenTree::Group(group) = token {
                let open = self.tokens.len();
                self.push(group.span_open().byte_range(), false);
                self.append(group.stream());
                self.tokens[open].close = self.tokens.len();
                self.push(group.span_close().byte_range(), false);
            } else {
                self.push(range, matches!(token, TokenTree::Ident(_)));
            }
        }
    }
}

/// The words that Rust keeps for itself.
const KEYWORDS: &str = "_ abstract as async await become box break const \
    continue crate do dyn else enum extern false final fn for if impl in \
    let loop macro match mod move mut override priv pub ref return Self \
    self static struct super trait true try type typeof unsafe unsized \
    use virtual where while yield";

pub fn is_keyword(word: &str) -> bool {
    KEYWORDS.split(' ').any(|keyword| keyword == word)
}
/// The kind of an item.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Module,
    Type,
    Variant,
    Macro,
    Constant,
    Function,
}

/// The meaning of a path.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Meaning {
    Item(Kind),
    /// Another path, in a module.
    Import(String, String),
    Many,
}

/// An item: its path from the root of its crate, and its kind.
pub type Item<'n> = (&'n str, Kind);

/// A token of a program: the numbers of its file and in its file.
pub type Spot = (usize, usize);

pub struct File<'s> {
    pub path: String,
    pub tokens: Vec<Token<'s>>,
}

#[derive(Clone, Default)]
pub struct Place<'a> {
    /// The number of the file.
    pub file: usize,
    /// The path of the module.
    pub module: String,
    pub this: Option<String>,
    /// The path of the trait that is implemented.
    pub of_trait: Option<String>,
    /// The parameters of an implementation around the item.
    pub parameters: Vec<&'a str>,
    /// The directory with the files of the module's own modules.
    dir: String,
    /// The path of the item's owner; none for a trait's member.
    owner: Option<String>,
}

#[derive(Default)]
pub struct Names<'a> {
    pub files: &'a [File<'a>],
    /// The path of the module that each file is.
    pub modules: HashMap<usize, String>,
    /// Where items are declared.
    pub sites: Vec<(Spot, String, Kind)>,
    pub bodies: Vec<(Place<'a>, Range<usize>)>,
    meanings: HashMap<String, Meaning>,
    implementations: Vec<(Place<'a>, usize)>,
}
impl<'a> Names<'a> {
    /// The items of some files; `library` maps the path of a library's
    /// root to the name by which others refer to the crate.
    pub fn new(
        files: &'a [File<'a>],
        library: impl Fn(&str) -> Option<String>,
    ) -> Self {
        let mut names = Self { files, ..Self::default() };
        // Sort the roots of crates before stray files
        let mut numbers: Vec<usize> = (0..files.len()).collect();
        let roots = ["lib.rs", "main.rs"];
        let is_root = |path: &str| roots.iter().any(|r| path.ends_with(r));
        numbers.sort_by_key(|number| !is_root(&files[*number].path));
        for number in numbers {
            if !names.modules.contains_key(&number) {
                // Read the crate of this root
                let path = &files[number].path;
                let library = library(path);
                let module = Meaning::Item(Kind::Module);
                names
                    .meanings
                    .extend(library.clone().map(|name| (name, module)));
                let stem = path.trim_end_matches(".rs").to_string();
                let (dir, _) = path.rsplit_once('/').unwrap_or_default();
                names.read_file(number, library.unwrap_or(stem), dir);
            }
        }
        for (place, at) in std::mem::take(&mut names.implementations) {
            names.implement(place, at);
        }
        names
    }

    fn read_file(&mut self, file: usize, module: String, dir: &str) {
        self.modules.insert(file, module.clone());
        let (owner, dir) = (Some(module.clone()), dir.to_string());
        let place = Place { file, module, owner, dir, ..Place::default() };
        self.read_items(&place, 2..self.files[file].tokens.len() - 2);
    }
}
/// The kind and the name of the item that the token `at` begins.
pub fn declaration(tokens: &[Token], at: usize) -> Option<(Kind, usize)> {
    let (kind, name) = match tokens[at].text {
        "mod" => (Kind::Module, at + 1),
        "struct" | "enum" | "union" | "trait" | "type" => {
            (Kind::Type, at + 1)
        }
        "const" | "static" => (Kind::Constant, at + 1),
        "fn" => (Kind::Function, at + 1),
        "macro_rules" => (Kind::Macro, at + 2),
        _ => return None,
    };
    let named = tokens[name].word && !is_keyword(tokens[name].text);
    // A word behind an apostrophe is a lifetime
    (named && tokens[at - 1].text != "'").then_some((kind, name))
}

/// The token that ends an item: a brace behind its body, or a semicolon.
fn end_of(tokens: &[Token], start: usize) -> usize {
    let braces =
        !matches!(tokens[start].text, "use" | "const" | "static" | "type");
    let mut at = start;
    loop {
        let close = tokens[at].close;
        match tokens[at].text {
            "{" if braces => return close,
            ";" | "" => return at,
            _ => at = close + 1,
        }
    }
}

/// The tokens between the braces that end with the token `end`.
fn inside(tokens: &[Token], start: usize, end: usize) -> Range<usize> {
    let is_open = |at: &usize| tokens[*at].close == end;
    let open = (start..end).find(is_open).unwrap_or(end - 1);
    open + 1..end
}

impl<'a> Names<'a> {
    fn read_items(&mut self, place: &Place<'a>, range: Range<usize>) {
        let tokens = &self.files[place.file].tokens;
        let mut at = range.start;
        while at < range.end {
            let end = match tokens[at].text {
                "use" => self.import(place, at),
                "impl" => {
                    self.implementations.push((place.clone(), at));
                    end_of(tokens, at)
                }
                _ => match declaration(tokens, at) {
                    Some(found) => self.read_item(place, at, found),
                    None => tokens[at].close,
                },
            };
            at = end + 1;
        }
    }

    fn read_item(
        &mut self,
        place: &Place<'a>,
        at: usize,
        (kind, name): (Kind, usize),
    ) -> usize {
        let tokens = &self.files[place.file].tokens;
        let end = end_of(tokens, at);
        let body = inside(tokens, at, end);
        let path = self.declare(place, kind, name);
        let inner = Place { owner: path.clone(), ..place.clone() };
        match (tokens[at].text, path) {
            // Read what a module holds
            ("mod", Some(path)) => {
                let dir = format!("{}/{}", place.dir, tokens[name].text);
                if tokens[end].text == ";" {
                    self.read_module(path, dir);
                    return end;
                }
                self.read_items(
                    &Place { module: path, dir, ..inner },
                    body,
                );
            }
            // Read what a trait or an enumeration holds
            ("trait", _) => {
                self.bodies.push((place.clone(), name + 1..body.start));
                let (parameters, _) = parameters(tokens, name + 1);
                self.read_items(&Place { parameters, ..inner }, body);
            }
            ("enum", Some(_)) => {
                self.bodies.push((place.clone(), name + 1..end));
                self.read_variants(&inner, body);
            }
            ("macro_rules", _) => {}
            _ => self.bodies.push((place.clone(), name + 1..end)),
        }
        end
    }

    /// Declares a name; with a second meaning it means several things.
    fn declare(
        &mut self,
        place: &Place,
        kind: Kind,
        name: usize,
    ) -> Option<String> {
        let owner = place.owner.as_ref()?;
        let token = &self.files[place.file].tokens[name];
        let path = format!("{owner}::{}", token.text);
        self.mean(path.clone(), Meaning::Item(kind));
        self.sites.push(((place.file, name), path.clone(), kind));
        Some(path)
    }

    fn mean(&mut self, path: String, meaning: Meaning) {
        let entry = self.meanings.entry(path);
        entry.and_modify(|old| *old = Meaning::Many).or_insert(meaning);
    }

    fn read_module(&mut self, path: String, dir: String) {
        let dir = dir.trim_start_matches('/');
        let paths = [format!("{dir}.rs"), format!("{dir}/mod.rs")];
        let number =
            self.files.iter().position(|f| paths.contains(&f.path));
        match number.filter(|n| !self.modules.contains_key(n)) {
            Some(number) => self.read_file(number, path, dir),
            None => self.mean(path, Meaning::Many),
        }
    }

    fn read_variants(&mut self, place: &Place<'a>, range: Range<usize>) {
        let tokens = &self.files[place.file].tokens;
        let mut at = range.start;
        while at < range.end {
            let before = tokens[at - 1].text;
            let first = matches!(before, "{" | "," | "]")
                || before.starts_with("//");
            if first && tokens[at].word {
                self.declare(place, Kind::Variant, at);
            }
            at = tokens[at].close + 1;
        }
    }
}
/// The tokens of an imported path, and of the name that it gets.
pub type Import = (Vec<usize>, usize);

pub fn imports(tokens: &[Token], start: usize) -> Vec<Import> {
    let (mut imports, mut open) = (Vec::new(), Vec::new());
    let (mut path, mut name) = (Vec::new(), None);
    // A path that begins with `::` is in another crate
    let end = end_of(tokens, start);
    let foreign = tokens[start + 1].text == ":";
    for at in (start + 1..=end).filter(|_| !foreign) {
        match tokens[at].text {
            "{" => open.push(path.clone()),
            "," | "}" | ";" => {
                let name = name.take();
                imports.extend(name.map(|name| (path, name)));
                path = open.last().cloned().unwrap_or_default();
                if tokens[at].text == "}" {
                    open.pop();
                }
            }
            "as" => {}
            // Add a word to the import
            // The name `self` means the path before it
            "self" if !path.is_empty() => name = path.last().copied(),
            "*" => name = Some(at),
            _ if tokens[at - 1].text == "as" => name = Some(at),
            _ if tokens[at].word => {
                path.push(at);
                name = Some(at);
            }
            _ => {}
        }
    }
    imports
}

impl<'a> Names<'a> {
    fn import(&mut self, place: &Place<'a>, at: usize) -> usize {
        let tokens = &self.files[place.file].tokens;
        for (path, name) in imports(tokens, at) {
            let path = path.iter().map(|at| tokens[*at].text);
            let path = path.collect::<Vec<_>>().join("::");
            let module = place.module.clone();
            let name = format!("{module}::{}", tokens[name].text);
            self.mean(name, Meaning::Import(module, path));
        }
        let end = end_of(tokens, at);
        self.bodies.push((place.clone(), at..end + 1));
        end
    }
}
impl<'a> Names<'a> {
    /// Reads an implementation, all items of modules being known.
    fn implement(&mut self, mut place: Place<'a>, start: usize) {
        let tokens = &self.files[place.file].tokens;
        let end = end_of(tokens, start);
        let body = inside(tokens, start, end);
        let (parameters, header) = parameters(tokens, start + 1);
        let is_for = |at: &usize| {
            tokens[*at].text == "for" && tokens[at + 1].text != "<"
        };
        let behind = (header..body.start).find(is_for);
        // Find the type that `Self` stands for, and the trait
        let item = |at| {
            let path = path_at(tokens, at).into_iter();
            let path: Vec<_> = path.map(|at| tokens[at].text).collect();
            let item = self.find(&place, &path);
            let known = !parameters.contains(&path[0]);
            let (item, _) = item.filter(|_| known)?;
            Some(item.to_string())
        };
        let this = item(behind.map_or(header, |at| at + 1));
        let of_trait = behind.and_then(|_| item(header));
        place.owner = this.clone().filter(|_| behind.is_none());
        (place.this, place.of_trait) = (this, of_trait);
        place.parameters = parameters;
        self.bodies.push((place.clone(), start + 1..body.start));
        self.read_items(&place, body);
    }
}

/// The parameters in angles, of types and of numbers, that may begin at a
/// token, and the token after them.
pub fn parameters<'s>(
    tokens: &[Token<'s>],
    start: usize,
) -> (Vec<&'s str>, usize) {
    let (mut depth, mut names) = (0, Vec::new());
    let angle = tokens[start].text == "<";
    for at in (start..tokens.len()).filter(|_| angle) {
        let before = tokens[at - 1].text;
        match tokens[at].text {
            "<" => depth += 1,
            // The arrow of a function is no angle
            ">" if before != "-" => depth -= 1,
            name if depth == 1 && matches!(before, "<" | "," | "const") => {
                names.push(name);
            }
            _ => {}
        }
        if depth == 0 {
            return (names, at + 1);
        }
    }
    (names, start)
}

/// The words of the path that begins at a token.
pub fn path_at(tokens: &[Token], mut at: usize) -> Vec<usize> {
    let mut words = vec![at];
    while colons(tokens, at + 1) && tokens[at + 3].word {
        at += 3;
        words.push(at);
    }
    words
}

pub fn colons(tokens: &[Token], at: usize) -> bool {
    tokens[at].text == ":" && tokens[at + 1].text == ":"
}
/// How many imports may lead on to imports.
const PATIENCE: usize = 8;

impl Names<'_> {
    /// The item that a path means in a place.
    pub fn find(&self, place: &Place, path: &[&str]) -> Option<Item<'_>> {
        self.follow(match path {
            ["Self", rest @ ..] => join(place.this.as_deref()?, rest),
            _ => self.absolute(&place.module, path)?,
        })
    }

    /// The member of a trait that an implementation defines.
    pub fn member(&self, place: &Place, name: &str) -> Option<Item<'_>> {
        self.follow(join(place.of_trait.as_deref()?, &[name]))
    }

    /// A path of a module, from the root of a crate on.
    fn absolute(&self, module: &str, path: &[&str]) -> Option<String> {
        let (mut scope, mut rest) = (module, path);
        while let [first @ ("crate" | "self" | "super"), more @ ..] = rest {
            rest = more;
            scope = match *first {
                "crate" => scope.split("::").next()?,
                "super" => scope.rsplit_once("::")?.0,
                _ => scope,
            };
        }
        let inner = join(module, path.get(..1)?);
        let ours =
            rest.len() < path.len() || self.meanings.contains_key(&inner);
        let library = self.meanings.contains_key(path[0]);
        match ours {
            true => Some(join(scope, rest)),
            false => library.then(|| path.join("::")),
        }
    }

    /// The item that a path from the root of a crate leads to.
    fn follow(&self, mut path: String) -> Option<Item<'_>> {
        for _ in 0..PATIENCE {
            let ends = path.match_indices("::").map(|(end, _)| end);
            let mut ends = ends.chain([path.len()]).skip(1);
            // Find the first name that is no item of ours
            let is_item = |end: &usize| {
                let meaning = self.meanings.get(&path[..*end]);
                matches!(meaning, Some(Meaning::Item(_)))
            };
            let end = ends.find(|end| !is_item(end)).unwrap_or(path.len());
            path = match self.meanings.get_key_value(&path[..end])? {
                (path, Meaning::Item(kind)) => return Some((path, *kind)),
                (_, Meaning::Import(module, to)) => {
                    let to: Vec<_> = to.split("::").collect();
                    self.absolute(module, &to)? + &path[end..]
                }
                (_, Meaning::Many) => return None,
            };
        }
        None
    }
}

fn join(scope: &str, path: &[&str]) -> String {
    [&[scope], path].concat().join("::")
}
