// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! What the index of Rust links, and above all what it does not.

use crate::common::{Scratch, run};
use noweb::diagnostic::Source;
use noweb::markup::{mark_up, write_stream};
use noweb::rust_index::index;

/// The stream of a chapter before and after, and the warnings.
fn indexed(chapter: &str) -> (String, String, String) {
    let source = Source::new(b"a.nw".to_vec(), chapter.into());
    let (lexemes, faults) = mark_up(&source, 0, 8);
    assert_eq!(faults, []);
    let stream = write_stream(&lexemes);
    let (out, faults) = index(&stream);
    let warnings = faults.iter().map(ToString::to_string).collect();
    let text = |bytes| String::from_utf8(bytes).expect("a text");
    (text(stream), text(out), warnings)
}

/// Each use as `name -> key`, in the order of the text.
fn links(chapter: &str) -> Vec<String> {
    let (_, out, warnings) = indexed(chapter);
    assert_eq!(warnings, "");
    marked(&out, &["@index use ", "@index link "])
}

/// The texts that marks announce, each with the argument of its mark.
fn marked(out: &str, marks: &[&str]) -> Vec<String> {
    let lines: Vec<&str> = out.lines().collect();
    let pairs = lines.windows(2).filter_map(|pair| {
        let key = marks.iter().find_map(|m| pair[0].strip_prefix(m))?;
        let text = pair[1].strip_prefix("@text ").unwrap_or("");
        Some(format!("{text} -> {key}"))
    });
    pairs.collect()
}

/// The links of the root of a library called `demo`.
fn links_in(code: &str) -> Vec<String> {
    links(&format!("<<demo/src/lib.rs>>=\n{code}\n@\n"))
}

#[test]
fn a_function_that_is_called_is_linked() {
    let found = links_in("fn count() {}\nfn f() { count(); }");
    assert_eq!(found, ["count -> demo::count"]);
}

#[test]
fn a_name_that_a_variable_has_taken_is_not_linked() {
    for body in [
        "fn f() { let count = 1; g(count); }",
        "fn f(count: u8) { g(count); }",
        "fn f() { let _ = |count: u8| g(count); }",
        "fn f() { for count in 0..3 { g(count); } }",
        "fn f() { if let Some(count) = None { g(count); } }",
        "fn f() { match 1 { count => g(count) } }",
        "fn f() { let P { count } = p; g(count); }",
        "fn f() { while let Some(count) = None { g(count); } }",
        "fn f() { let Some(count) = None else { return }; g(count); }",
        "fn f() { let (count, _) = (1, 2); g(count); }",
        "fn f<const count: usize>() { g(count); }",
    ] {
        let found = links_in(&format!("fn count() {{}}\n{body}"));
        assert_eq!(found, [""; 0], "{body}");
    }
}

#[test]
fn a_name_that_is_taken_in_a_function_is_left_alone_in_all_of_it() {
    for code in [
        "fn f() { { let count = 1; } count(); let count = count(); }",
        "fn f() { if let Some(count) = None {} else { count(); } }",
        "fn f(count: u8) { fn g() { count(); } }",
        "fn f() { count(); read!(count); }",
        "fn f() { if let read!(count) = 1 { count(); } }",
        "fn f() { assert!(list.iter().all(|count| count > 1)); count(); }",
        "fn f() { count(); use std::mem::*; }",
        "fn f() { count(); format!(\"{count}\", count = 1); }",
        "fn f() { count(); list.map(count); }",
        "fn f() { count(); let P { count: c } = p; }",
        "fn f() { count(); macro_rules! m { () => { count() } } }",
    ] {
        let found = links_in(&format!("fn count() {{}}\n{code}"));
        assert_eq!(found, [""; 0], "{code}");
    }
    let found = links_in(
        "mod count { pub fn one() {} }\n\
         fn f() { let count = count::one(); let m = read!(count); }",
    );
    assert_eq!(found, ["count -> demo::count", "one -> demo::count::one"]);
}

#[test]
fn a_generic_parameter_hides_a_type() {
    for code in [
        "fn f<T>(t: T) -> T { t }",
        "fn f<F: Fn(u8) -> u8, T>(t: T) -> T { t }",
        "trait A<T> { fn f(t: T); }",
        "impl<'a, T> Iterator for Vec<T> { fn f(t: T) {} }",
        "impl<T> T { fn new() { Self::new(); } }",
        "struct A<const T: usize>([u8; T]);",
    ] {
        let found = links_in(&format!("struct T;\n{code}"));
        assert_eq!(found, [""; 0], "{code}");
    }
}

#[test]
fn a_name_that_is_given_to_a_part_is_not_linked() {
    for code in [
        "fn f(i: impl Iterator<Item = u8>) {}",
        "fn f(i: impl Iterator<Item: Copy>) {}",
        "impl Iterator for Vec<u8> { type Item = u8; }",
        "enum E { Item(u8), #[a] Item2 { x: u8 } }",
        "fn f() { enum E { Item(u8) } Item(1); }",
        "fn f() { a.Item; Vec::<u8>::Item; 'Item: loop {} }",
    ] {
        let found = links_in(&format!("struct Item;\n{code}"));
        assert_eq!(found, [""; 0], "{code}");
    }
    let found = links_in(
        "const LIMIT: u8 = 1;\nfn f(x: u8) { x == LIMIT; 0..LIMIT; \
         match x { LIMIT => {} } }",
    );
    assert_eq!(found, ["LIMIT -> demo::LIMIT"; 3]);
    let found = links_in(
        "struct Item;\nfn f(i: &'static Item) { let i: Item = g(); \
         if !(i == Item) {} }",
    );
    assert_eq!(found, ["Item -> demo::Item"; 3]);
}

#[test]
fn a_program_that_is_cut_off_is_read_to_its_end() {
    let code = "impl<T: A<B>> a::X for S<T> where T: 'b {} use a::{b::*, self}; \
        mod m; enum E { A, B(u8) } trait T { fn f(); } macro_rules! m { } \
        fn f() -> u8 { assert!(x != S::new(), b.c); #[x] <S as D>::d() }";
    let words: Vec<&str> = code.split(' ').collect();
    let text = |words: &[&str]| {
        let text = words.join(" ");
        indexed(&format!("<<demo/src/lib.rs>>=\n{text}\n@\n"));
    };
    for end in 0..=words.len() {
        text(&words[..end]);
        text(&words[end..]);
        for start in 0..end {
            text(&[&words[..start], &words[end..]].concat());
        }
    }
}

#[test]
fn what_a_block_declares_hides_what_its_module_does() {
    for inner in
        ["fn count() {}", "use std::count;", "const count: u8 = 1;"]
    {
        let code =
            format!("fn count() {{}}\nfn f() {{ {inner} count(); }}");
        assert_eq!(links_in(&code), [""; 0], "{inner}");
    }
}

#[test]
fn a_type_in_a_function_is_not_the_one_outside() {
    let found = links_in(
        "struct S;\nimpl S { fn new() {} }\n\
         fn f() { struct S; impl S { fn go() { Self::new(); } } S::new(); }",
    );
    assert_eq!(found, ["S -> demo::S"]);
}

const MODULES: &str = "mod one { pub fn run() {} pub struct S; }\n\
    mod two { pub fn run() {} }\n";

#[test]
fn two_functions_of_one_name_are_two_identifiers() {
    let code = format!("{MODULES}fn f() {{ one::run(); two::run(); }}");
    let found = links_in(&code);
    assert!(found.contains(&"run -> demo::one::run".into()), "{found:?}");
    assert!(found.contains(&"run -> demo::two::run".into()), "{found:?}");
    let (_, out, _) =
        indexed(&format!("<<demo/src/lib.rs>>=\n{code}\n@\n"));
    let names: Vec<&str> =
        out.lines().filter(|l| l.starts_with("@index name")).collect();
    let all = "@index name demo::f f\n@index name demo::one::S S\n\
               @index name demo::one::run run (one)\n\
               @index name demo::two::run run (two)";
    assert_eq!(names.join("\n"), all);
}

#[test]
fn an_import_is_followed_under_its_new_name() {
    let code =
        format!("{MODULES}use one::run as go;\nfn f() {{ go(); run(); }}");
    let found = links_in(&code);
    let all = "one -> demo::one, run -> demo::one::run, \
               go -> demo::one::run";
    assert_eq!(found.join(", "), all);
}

#[test]
fn what_a_star_brings_in_is_not_linked() {
    let code = format!("{MODULES}use one::*;\nfn f() {{ run(); }}");
    assert_eq!(links_in(&code), ["one -> demo::one"]);
}

#[test]
fn paths_begin_at_the_crate_the_module_and_the_module_above() {
    let found = links_in(
        "fn top() {}\nmod a { fn own() {} fn f() { crate::top(); \
         super::top(); self::own(); top(); } }",
    );
    let top = "top -> demo::top";
    assert_eq!(found, [top, top, "own -> demo::a::own"]);
}

#[test]
fn modules_are_files_and_another_crate_sees_the_library() {
    let found = links(
        "<<demo/src/lib.rs>>=\npub mod deep;\n@\n\
         <<demo/src/deep.rs>>=\npub mod under;\npub fn top() {}\n@\n\
         <<demo/src/deep/under.rs>>=\nuse super::top;\nfn f() { top(); }\n@\n\
         <<demo/src/main.rs>>=\nuse demo::deep::top;\n\
         fn main() { top(); std::top(); }\n@\n",
    );
    let [deep, top] = ["deep -> demo::deep", "top -> demo::deep::top"];
    let (under, demo) = ("under -> demo::deep::under", "demo -> demo");
    assert_eq!(found, [deep, under, top, top, demo, deep, top, top]);
}

#[test]
fn names_of_other_crates_are_not_linked() {
    let found = links_in(
        "mod path { pub struct Path; }\n\
         use std::path::Path;\nfn f(p: &Path, q: &std::path::Path) {}",
    );
    assert_eq!(found, [""; 0]);
}

#[test]
fn arguments_of_macros_are_read_if_they_are_expressions() {
    let found = links_in(
        "fn count() {}\nfn f() {\n\
         println!(\"{}\", count());\nassert!(count() == count(), \"{x}\");\n\
         let v = vec![count(); 3];\nlet m = matches!(v, x if x == count());\n\
         let h = html! { count() };\n}",
    );
    assert_eq!(found, ["count -> demo::count"; 5]);
}

#[test]
fn a_macro_of_ours_is_linked_and_its_arguments_are_not() {
    let found = links_in(
        "macro_rules! twice { ($e:expr) => { $e } }\n\
         fn count() {}\nfn f() { twice!(count()); }",
    );
    assert_eq!(found, ["twice -> demo::twice"]);
}

const TYPE: &str = "struct S { inner: Inner, list: Vec<Inner> }\n\
    struct Inner;\n\
    impl Inner { fn size(&self) -> usize { 0 } }\n\
    impl S { fn size(&self) -> usize { 0 } fn new() -> Self { todo!() } ";

#[test]
fn the_call_of_a_method_is_not_linked() {
    for body in [
        "fn f(&self) { self.size(); }",
        "fn f(&self) { self.inner.size(); }",
        "fn f(i: &Inner) { i.size(); }",
        "fn f() { S::new().size(); }",
    ] {
        let found = links_in(&format!("{TYPE}{body} }}"));
        let wrong = found.iter().any(|l| l.starts_with("size"));
        assert!(!wrong, "{body}: {found:?}");
    }
}

#[test]
fn a_path_leads_to_a_function_of_a_type_by_name_or_as_self() {
    let body =
        "fn f(i: &Inner) { Inner::size(i); Self::new(); S::size(i); }";
    let found = links_in(&format!("{TYPE}{body} }}"));
    let all = "Inner -> demo::Inner, Inner -> demo::Inner, \
               size -> demo::Inner::size, new -> demo::S::new, \
               S -> demo::S, size -> demo::S::size";
    assert_eq!(found[4..].join(", "), all);
}

#[test]
fn a_method_of_a_receiver_of_unknown_type_is_not_linked() {
    for body in [
        "fn f(&self) { g().size(); }",
        "fn f(x: Other) { x.size(); }",
        "fn f(&self) { self.list.size(); }",
        "fn f(&self) { self.list[0..1].size(); }",
        "fn f(i: Option<Inner>) { i.size(); }",
        "fn f() { let i = Inner; let i = g(i); i.size(); }",
        "fn f() { let s = S::new; let _ = |s| s.size(); }",
    ] {
        let found = links_in(&format!("{TYPE}{body} }}"));
        let wrong = found.iter().any(|l| l.starts_with("size"));
        assert!(!wrong, "{body}: {found:?}");
    }
}

#[test]
fn a_method_that_a_trait_has_as_well_is_not_linked() {
    let found = links_in(
        "struct S;\nimpl S { fn next(&mut self) {} }\n\
         impl Iterator for S { fn next(&mut self) {} }\n\
         fn f(s: &mut S) { s.next(); }",
    );
    assert!(!found.iter().any(|l| l.starts_with("next")), "{found:?}");
}

#[test]
fn a_function_that_two_impls_have_is_not_linked() {
    let found = links_in(
        "struct S<T>(T);\nimpl S<u8> { fn make() {} }\n\
         impl S<u16> { fn make() {} }\nfn f() { S::<u8>::make(); }",
    );
    assert!(!found.iter().any(|l| l.starts_with("make")), "{found:?}");
}

#[test]
fn what_an_impl_of_our_trait_declares_leads_to_the_trait() {
    let found = links_in(
        "trait Draw { fn draw(&self); }\nstruct S;\n\
         impl Draw for S { fn draw(&self) {} }\n\
         fn f(s: &S) { Draw::draw(s); <S as Draw>::draw(s); S::draw(s); \
         <S>::draw(s); s.draw(); }",
    );
    let draws = found.iter().filter(|l| *l == "draw -> demo::Draw::draw");
    assert_eq!(draws.count(), 2, "{found:?}");
    let any = found.iter().filter(|l| l.starts_with("draw"));
    assert_eq!(any.count(), 2, "{found:?}");
}

#[test]
fn a_pattern_uses_a_variant_by_its_path_and_binds_the_rest() {
    let found = links_in(
        "enum E { A, B(u8) }\nconst LIMIT: u8 = 3;\n\
         fn f(e: E) { match e { E::A => {} E::B(LIMIT) => {} E::B(x) => x } }",
    );
    let [a, b] = ["A -> demo::E::A", "B -> demo::E::B"];
    let e = "E -> demo::E";
    let limit = "LIMIT -> demo::LIMIT";
    assert_eq!(found, [e, e, a, e, b, limit, e, b]);
}

#[test]
fn an_alias_has_no_functions_of_its_own() {
    let found = links_in(
        "struct S;\nimpl S { fn new() {} }\ntype A = S;\nfn f() { A::new(); }",
    );
    assert_eq!(found[2..], ["A -> demo::A"]);
}

#[test]
fn an_item_declared_twice_is_not_linked() {
    let found = links_in(
        "#[cfg(unix)] fn page() {}\n#[cfg(windows)] fn page() {}\n\
         fn f() { page(); }",
    );
    assert_eq!(found, [""; 0]);
}

#[test]
fn chunks_are_read_where_they_are_used() {
    let found = links(
        "<<demo/src/lib.rs>>=\nfn count() {}\nfn f(total: u8) {\n    \
         <<Add>>\n}\n@ Prose.\n\
         <<Add>>=\nlet sum = count() + total;\n@\n\
         <<Add>>=\ncount(sum);\n@\n",
    );
    assert_eq!(found, ["count -> demo::count"; 2]);
}

#[test]
fn a_chunk_that_means_two_things_in_two_files_is_not_linked() {
    let chapter = |other| {
        format!(
            "<<demo/src/lib.rs>>=\nmod a;\nfn count() {{}}\n<<Call>>\n@\n\
             <<demo/src/a.rs>>=\n{other}\n<<Call>>\n@\n\
             <<Call>>=\nfn f() {{ count(); }}\n@\n"
        )
    };
    let found = links(&chapter("fn count() {}"));
    assert_eq!(found, ["a -> demo::a"]);
    let found = links(&chapter("use super::count;"));
    assert_eq!(found[2..], ["count -> demo::count"]);
    let found = links(
        "<<demo/src/lib.rs>>=\nmod a;\nfn count() {}\n\
         fn f() { <<Call>> }\n@\n\
         <<demo/src/a.rs>>=\nfn f(count: u8) { <<Call>> }\n@\n\
         <<Call>>=\ncount();\n@\n",
    );
    assert_eq!(found, ["a -> demo::a"]);
}

#[test]
fn words_in_strings_and_comments_are_no_uses() {
    let found = links_in(
        "fn count() {}\n// count\n/* count /* count */ count */\n\
         /// count\nfn f<'count>() { \"count\"; r#\"count\"#; 'c'; }",
    );
    assert_eq!(found, [""; 0]);
}

#[test]
fn comments_are_marked_across_chunks_and_keywords_in_code_only() {
    let (_, out, _) = indexed(
        "<<demo/src/lib.rs>>=\n/* for\n<<Go on>>\nif */ fn r#match() {}\n\
         /// let it\nstruct S<'a>(&'a str); // \"open\n@\n\
         <<Go on>>=\nin the comment /* while */\n@\n",
    );
    let comments = marked(&out, &["@style comment"]);
    let all = "/* for -> |if */ -> |/// let it -> |// \"open -> |\
               in the comment /* while */ -> ";
    assert_eq!(comments.join("|"), all);
    assert_eq!(marked(&out, &["@style keyword"]), ["fn -> ", "struct -> "]);
}

#[test]
fn quoted_code_is_linked_if_nothing_else_has_its_name() {
    let chapter = |prose: &str, body: &str| {
        let chapter = format!(
            "{prose}\n<<demo/src/lib.rs>>=\nstruct S;\n\
             impl S {{ fn draw(&self) {{}} }}\nfn count() {{}}\n{body}\n@\n"
        );
        let (_, out, _) = indexed(&chapter);
        let prose = out.split("@begin code").next().unwrap_or("");
        marked(prose, &["@index use "])
    };
    let link = |prose| chapter(prose, "fn f() { count(); }");
    assert_eq!(link("[[count]]"), ["count -> demo::count"]);
    assert_eq!(link("[[count()]]"), ["count() -> demo::count"]);
    assert_eq!(link("[[S::draw]]"), ["S::draw -> demo::S::draw"]);
    assert_eq!(link("[[draw]]"), ["draw -> demo::S::draw"]);
    assert_eq!(link("[[S]] [[other]] [[let]] [[a b]]"), ["S -> demo::S"]);
    assert_eq!(chapter("[[count]]", "fn f(count: u8) {}"), [""; 0]);
    assert_eq!(chapter("[[count]]", "struct C { count: u8 }"), [""; 0]);
    assert_eq!(chapter("[[draw]]", "impl C { fn draw() {} }"), [""; 0]);
}

#[test]
fn lists_by_hand_add_words_and_the_rest_is_found() {
    let (_, out, _) = indexed(
        "<<demo/src/lib.rs>>=\nfn count() {}\nstruct S { width: u8 }\n\
         @ %def count width\n<<run.sh>>=\nwidth=3; count $width\n@ %def go\n",
    );
    let defined: Vec<&str> = out
        .lines()
        .filter_map(|line| line.strip_prefix("@index defn "))
        .collect();
    assert_eq!(defined, ["demo::count", "demo::S", "width", "go"]);
    let used = marked(&out, &["@index use "]);
    assert_eq!(used, ["width -> width"; 2], "{out}");
}

#[test]
fn a_file_that_does_not_parse_keeps_its_lists_and_is_reported() {
    let (_, out, warnings) = indexed(
        "Prose.\n<<demo/src/lib.rs>>=\nfn count() {}\n<<Broken>>\n@ %def count\n\
         <<Broken>>=\n  fn f( { count(); }\n@\n\
         <<demo/src/main.rs>>=\nfn main() { go(); }\nfn go() {}\n@\n",
    );
    let warning = "a.nw:7:1: warning: demo/src/lib.rs is no Rust";
    assert!(warnings.starts_with(warning), "{warnings}");
    let used = marked(&out, &["@index use "]);
    let word = "count -> count";
    assert_eq!(used, [word, word, "go -> demo/src/main::go"]);
}

#[test]
fn the_text_of_the_stream_is_not_changed() {
    let chapters = concat!(env!("CARGO_MANIFEST_DIR"), "/chapters");
    for name in ["markup", "totex", "rust_index"] {
        let text = std::fs::read_to_string(format!("{chapters}/{name}.nw"));
        // The tool may be tested without the book.
        let Ok(text) = text else { return };
        let (before, after, _) = indexed(&text);
        assert_eq!(plain(&after), plain(&before), "{name}");
        assert!(after.lines().count() > before.lines().count());
    }
}

/// The lines of a stream with the texts of each line joined.
fn plain(stream: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for line in stream.lines() {
        if line.starts_with("@index") || line.starts_with("@style") {
            continue;
        }
        match line.strip_prefix("@text ") {
            Some(text) => lines.last_mut().expect("one").push_str(text),
            None => lines.extend([line.to_string(), String::new()]),
        }
    }
    lines
}

const BOOK: [(&str, &str); 3] = [
    ("book.nw", "\\begin{document}\n\\nowebindex\n\\end{document}\n"),
    (
        "one.nw",
        "See [[hello]].\n<<demo/src/lib.rs>>=\npub mod two;\n\
         pub fn hello() {}\n@\n",
    ),
    (
        "two.nw",
        "<<demo/src/two.rs>>=\nuse crate::hello; // why\n\
         pub fn run() { hello(); }\n@\nThe end.\n",
    ),
];

fn woven(options: &str) -> (Scratch, crate::common::Outcome) {
    let book = Scratch::new();
    for (name, text) in BOOK {
        book.write(name, text);
    }
    let args = options.split(' ');
    let files = BOOK.iter().map(|(name, _)| *name);
    let backend = ["-backend", "noweb split_scope -o tex"];
    let args = ["noweave"].into_iter().chain(args).chain(backend);
    let args: Vec<&str> = args.chain(files).collect();
    let outcome = run(book.path(), &args);
    (book, outcome)
}

#[test]
fn weaving_links_lists_and_sets_apart() {
    let (book, outcome) = woven("-index -autodefs rust -delay");
    assert_eq!((outcome.status, outcome.stderr()), (0, String::new()));
    let two = book.read("tex/two.tex");
    for expected in [
        r"\nwkeyword{use} \nwkeyword{crate}::\nwlinkedidentc{hello}{NW",
        r"\nwcomment{// why}",
        r"\nwidentuses{\\{{\nwixident{hello}}{demo:col:colhello}}}",
        r"\nwminiindex{\nwmini{\nwixident{hello}}{NW",
    ] {
        assert!(two.contains(expected), "no {expected} in\n{two}");
    }
    let one = book.read("tex/one.tex");
    assert!(one.contains(r"{\Tt{}\nwlinkedidentq{hello}{NW"), "{one}");
    assert!(!one.contains(r"\nwminiindex"), "{one}");
    let index = book.read("tex/book.tex");
    let entry = r"\nwixlogsorted{i}{{\nwixident{run}}{demo:col:coltwo";
    assert!(index.contains(entry), "{index}");
    assert_eq!(two.lines().count(), BOOK[2].1.lines().count() + 1);
}

#[test]
fn other_languages_and_a_missing_index_are_refused() {
    let (_, outcome) = woven("-index -autodefs c");
    assert_eq!(outcome.status, 1);
    assert!(outcome.stderr().contains("-autodefs c"));
    let (_, outcome) = woven("-autodefs rust");
    assert_eq!(outcome.status, 1);
    assert!(outcome.stderr().contains("add -index"));
}
