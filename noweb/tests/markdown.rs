// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Chapters in Markdown: read, tangled and woven; and programs that begin with
//! the command `new`.

use std::env;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use noweb::diagnostic::Source;
use noweb::markdown::{Form, weave};
use noweb::project::{expand_sources, included};
use noweb::reading::read;

const NOWEB: &str = env!("CARGO_BIN_EXE_noweb");

fn chapter(name: &str, text: &str) -> Source {
    Source::new(name.into(), text.into())
}

/// The pages of some chapters, each in a file of its own.
fn woven(chapters: &[Source]) -> Vec<String> {
    let pages = weave(chapters, Form::Files, false).unwrap();
    let text = |page| String::from_utf8(page).unwrap();
    pages.into_iter().map(text).collect()
}

/// The files that a chapter in Markdown defines.
fn tangled(text: &str) -> Vec<(PathBuf, String)> {
    let read = read("a.md".into(), text.into(), b"").unwrap();
    let files = expand_sources(vec![read]).unwrap().files.into_iter();
    let text = |text| String::from_utf8(text).unwrap();
    files.map(|(path, file)| (path, text(file.text))).collect()
}

#[test]
fn a_definition_in_a_fence_or_indented_is_prose() {
    let text = "````\n<<1.rs>>=\n```\n<<2.rs>>=\n````\n  <<3.rs>>=\n\
                ~~~ rust\n<<4.rs>>=\n```\n~~~~\n`<<5.rs>>=`\n    ```\n\
                <<a.rs>>=\n```\nx @<< 1;\n@@rest\n@\n```\n<<6.rs>>=\n\
                ```\n<<b.rs>>=\ny\n";
    let files = tangled(text);
    let names: Vec<_> =
        files.iter().map(|(path, _)| path.to_str()).collect();
    assert_eq!(names, [Some("a.rs"), Some("b.rs")]);
    assert_eq!(files[0].1, "```\nx << 1;\n@rest\n");
}

/// The files of a text in which CHUNK is one, and of one behind it.
fn names_with(text: &str) -> Vec<String> {
    let text = text.replace("CHUNK", "<<a.c>>=\na\n@");
    let files = tangled(&(text + "\n\n<<z.c>>=\nz\n@\n")).into_iter();
    files.map(|(path, _)| path.display().to_string()).collect()
}

#[test]
fn what_commonmark_shows_as_it_is_holds_no_chunk_and_hides_none() {
    for text in [
        "* ~~~\n  a\n  ~~~\n\nCHUNK\n\n* ~~~\n  b",
        "1) - ```rs\n     a\n\nCHUNK\n",
        "> - ````\n>   a\n\nCHUNK",
        "- a\n\n\t```\n\ta\n\nCHUNK",
        "    ```\nCHUNK",
        "<!-- a\n\n~~~\n--> b\nCHUNK",
        "<PRE class=a>\n```\n</pre>\nCHUNK",
        "<style>\n```\n\n</style>\nCHUNK",
        "<div>\n```\n\nCHUNK",
        "<prelude>\nCHUNK\n</prelude>",
        "a <!-- b\n```c`\nCHUNK",
    ] {
        assert_eq!(names_with(text), ["a.c", "z.c"], "{text}");
    }
    for text in [
        "<!--\nCHUNK\n\nCHUNK\n-->",
        "<Pre>\n\nCHUNK\n</PRE>",
        "<![CDATA[\nCHUNK\n]]>",
        "~~~\né\nCHUNK\n\nCHUNK\nCHUNK\n~~~\n\n~~~\nCHUNK\n~~~",
        "- a\n\n<script>\nCHUNK\n</script>",
        "<?a\nCHUNK\n?>",
        "> a\n```\nCHUNK\n- ```\n ```",
    ] {
        assert_eq!(names_with(text), ["z.c"], "{text}");
    }
    for text in ["a\n\n<!-- b\n<<c.c>>=\n", "\r\n\n ~~~\n> ~~~\n"] {
        let faults = read("a.md".into(), text.into(), b"").unwrap_err();
        let told = faults[0].to_string();
        assert!(
            told.starts_with("a.md:3:1: warning: open block"),
            "{told}"
        );
    }
}

#[test]
fn many_definitions_in_a_fence_take_no_quadratic_time() {
    let text = "<<a>>=\nb\n".repeat(20_000);
    let start = Instant::now();
    assert_eq!(names_with(&format!("~~~\n{text}~~~")), ["z.c"]);
    assert!(start.elapsed() < Duration::from_secs(5));
}

#[test]
fn quoted_code_is_what_commonmark_takes_for_it() {
    let web =
        "é`a\nf` b `f` c \\`f` <i x=\"`f`\">\n\n<<a.c>>=\nf\n@ %def f\n";
    let page = &woven(&[chapter("a.md", web)])[0];
    let prose = "é`a\nf` b [`f`](#chunk-1-1) c \\`f` <i x=\"`f`\">\n";
    assert!(page.starts_with(prose), "{page}");
    let latin = [b"\xe9 `f`\n".as_slice(), &web.as_bytes()[2..]].concat();
    let latin = Source::new("a.md".into(), latin);
    let page = &weave(&[latin], Form::Document, false).unwrap()[0];
    assert!(page.starts_with(b"\xe9 [`f`](#chunk-1-1)\n`a\n"));
}

#[test]
fn mdbook_hides_no_line_of_a_chunk() {
    let code = "a\n# b\n#\n\u{a0}##c\n#[d]\n  #![e]\n#f\n";
    let shown = "a\n## b\n##\n\u{a0}###c\n#[d]\n  #![e]\n##f\n";
    let text = format!("# T\n\n```rust\n# x\n```\n\n<<NAME>>=\n{code}@\n");
    for (name, form, code) in [
        ("a.rs", Form::Book, shown),
        ("a.rs", Form::Files, code),
        ("a.py", Form::Book, code),
    ] {
        let web = chapter("a.md", &text.replace("NAME", name));
        let page = weave(&[web], form, false).unwrap().concat();
        let page = String::from_utf8(page).unwrap();
        assert!(page.contains(&format!("\n{code}```\n")), "{page}");
        assert!(page.contains("```rust\n# x\n"), "{page}");
    }
}

#[test]
fn signs_of_noweb_mean_nothing_in_prose() {
    let prose = "1 << 2, [[a]](b), @ c\n@ %def d\n@@ -1 +1 @@\n@<<e>>\n\t\\`k`\n\
                 ``g ` k`` `i\n";
    let web = format!("{prose}<<j.c>>=\nk\n@ %def k\n");
    let page = &woven(&[chapter("a.md", &web)])[0];
    assert!(page.starts_with(prose), "{page}");
    assert!(page.contains("\n```c\nk\n```\n"));
}

#[test]
fn what_is_defined_and_used_is_linked_both_ways() {
    let pages = woven(&[
        chapter(
            "a.md",
            "# `f`\n`f` [`f`](x) `f()`\n<<src/a.py>>=\nf\n<<b c>>\n@ %def f\nz\n",
        ),
        chapter(
            "sub/b.md",
            "<<b c>>=\nf ````\n@\n<!-- noweb chunks -->\n<!-- noweb index -->\n",
        ),
    ]);
    assert_eq!(
        pages[0],
        "# `f`\n[`f`](#chunk-1-1) [`f`](x) [`f()`](#chunk-1-1)\n\n\
         <a id=\"chunk-1-1\"></a>\n**⟨src/a.py⟩** ≡ 1.1\n\n```python\nf\n\
         ⟨b c 2.1⟩\n```\n\nincludes [⟨b c⟩ 2.1](sub/b.md#chunk-2-1) · defines \
         `f` (used in [2.1](sub/b.md#chunk-2-1))\n\nz\n"
    );
    assert_eq!(
        pages[1],
        "\n<a id=\"chunk-2-1\"></a>\n**⟨b c⟩** ≡ 2.1\n\n`````python\nf ````\n\
         `````\n\nused in [1.1](../a.md#chunk-1-1) · uses [`f` 1.1]\
         (../a.md#chunk-1-1)\n\n\
         - ⟨b c⟩ [2.1](#chunk-2-1); used in [1.1](../a.md#chunk-1-1)\n\
         - ⟨src/a.py⟩ [1.1](../a.md#chunk-1-1)\n\n\
         - `f` [1.1](../a.md#chunk-1-1); used in [2.1](#chunk-2-1)\n\n"
    );
    let faults =
        weave(&[chapter("a.nw", "")], Form::Document, false).unwrap_err();
    assert!(faults[0].to_string().contains("no Markdown"));
}

#[test]
fn an_include_inside_of_a_chunk_is_none() {
    let place = tempfile::tempdir().unwrap();
    let web = "<<a.tex>>=\n\\include{b}\n@\n";
    fs::write(place.path().join("a.nw"), web).unwrap();
    let mut tangle = Command::new(NOWEB);
    run(tangle.args(["tangle", "a.nw"]).current_dir(&place));
    let text = fs::read_to_string(place.path().join("a.tex")).unwrap();
    assert_eq!(text, "\\include{b}\n");
}

#[test]
fn pages_go_to_files_and_never_over_a_chapter() {
    let place = tempfile::tempdir().unwrap();
    let dir = place.path().join("chapters");
    fs::create_dir(&dir).unwrap();
    let a = "<<a.c>>=\n<<b>>\n@ %def g\n";
    let b = "`f(g)`\n<<b>>=\nf\n@ %def f\n";
    fs::write(dir.join("a.md"), a).unwrap();
    fs::write(dir.join("b.md"), b).unwrap();
    let weave = |more: &str, files: &str| {
        let mut weave = Command::new(NOWEB);
        weave.args(["noweave", "-md"]).current_dir(&place);
        weave
            .args(more.split_terminator('|'))
            .args(files.split_whitespace());
        weave.output().unwrap()
    };
    let both = "chapters/a.md chapters/b.md";
    let done = weave("-backend|split_scope -o book", both);
    assert!(done.status.success(), "{done:?}");
    let page = fs::read_to_string(place.path().join("book/a.md")).unwrap();
    assert!(page.contains("includes [⟨b⟩ 2.1](b.md#chunk-2-1)"), "{page}");
    let page = fs::read_to_string(place.path().join("book/b.md")).unwrap();
    assert!(page.starts_with("[`f(g)`](#chunk-2-1)\n"), "{page}");
    for (more, files, fault) in [
        ("-backend|split_scope -o chapters", both, "would replace"),
        (
            "-backend|split_scope -o out",
            "chapters/a.md chapters/a.md",
            "would replace",
        ),
        ("-backend|totex", both, "split_scope -o DIR"),
        ("-filter|cat", both, "no filter (cat)"),
        ("", "", "needs files"),
    ] {
        let done = weave(more, files);
        let told = String::from_utf8(done.stderr).unwrap();
        assert_eq!(done.status.code(), Some(1), "{more}");
        assert!(told.contains(fault), "{more}: {told}");
    }
    assert_eq!(fs::read_to_string(dir.join("a.md")).unwrap(), a);
}

#[test]
fn a_summary_is_read_as_mdbook_reads_it() {
    let place = tempfile::tempdir().unwrap();
    let chapters = |text: &str| {
        fs::write(place.path().join("SUMMARY.md"), text).unwrap();
        let found = included(place.path(), "SUMMARY.md".as_ref());
        found.map(|all| {
            all.iter().map(|p| p.display().to_string()).collect()
        })
    };
    let text = "# [Title](no.md)\n\n[a](a.md)\n\n# Part\n\n\
                - [b](<b c.md> \"no.md\")\n    * [d](./d/e%20f.md) [](no.md)\n\
                - [draft](<>)\n- [`](no.md)`](g.md)\n<!-- [](no.md)\n-->\n\
                - [h][i] ![](no.md)\n\n      [](no.md)\n\n---\n\
                [j \\] j](j&amp;.md)<!-- [](no.md) --> \\[](no.md)\n\n\
                [i]: h.md (no.md)\n";
    let found: Vec<String> = chapters(text).unwrap();
    let right = ["a", "b c", "d/e f", "g", "h", "j&"];
    let right = right.map(|name| format!("{name}.md"));
    assert_eq!((&*found[0], &found[1..]), ("SUMMARY.md", &right[..]));
    let once = chapters("- [](a.md)\n- [](./b/../a.md)\n- [](SUMMARY.md)");
    assert_eq!(once.unwrap(), ["SUMMARY.md", "a.md"]);
    fs::write(place.path().join("lost.md"), "").unwrap();
    let lost = chapters("<!-- [](lost.md) -->\n[](http://a.b)\n");
    let lost = lost.unwrap_err().to_string();
    assert!(lost.contains("SUMMARY.md does not include lost.md"), "{lost}");
    chapters("[](lost.md)").unwrap();
    assert!(included(place.path(), "./SUMMARY.md".as_ref()).is_ok());
    fs::write(place.path().join("SUMMARY.md"), b"a\n\xe9\n").unwrap();
    let other = included(place.path(), "SUMMARY.md".as_ref()).unwrap_err();
    assert_eq!(other.to_string(), "line 2: mdBook wants UTF-8");
}

#[test]
fn mdbook_gets_its_book_back_woven() {
    let chapter = |path: &str, content: &str| {
        serde_json::json!({ "Chapter": {
            "name": path, "content": content, "path": path, "sub_items": [],
        }})
    };
    let mut first = chapter("s/a.md", "<<a.rs>>=\n<<b>>\n@\n");
    first["Chapter"]["sub_items"] =
        serde_json::json!([chapter("s/b.md", "<<b>>=\nfn f() {}\n@\n")]);
    let config = serde_json::json!({ "config": {
        "preprocessor": { "noweb": { "rust": true } },
    }});
    let book = serde_json::json!({ "items": [first, "Separator"] });
    let mut mdbook = Command::new(NOWEB);
    mdbook.arg("mdbook").stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut child = mdbook.spawn().unwrap();
    let input = serde_json::json!([config, book]).to_string();
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    let book: serde_json::Value =
        serde_json::from_slice(&output.stdout).unwrap();
    let own = &book["items"][0]["Chapter"];
    assert!(own["content"].as_str().unwrap().contains("](b.md#chunk-2-1)"));
    let below = &own["sub_items"][0]["Chapter"]["content"];
    let below = below.as_str().unwrap();
    assert!(below.contains("used in [1.1](a.md#chunk-1-1)"), "{below}");
    assert!(below.contains("defines `f`"), "{below}");
    assert_eq!(book["items"][1], "Separator");
    assert!(
        run(Command::new(NOWEB).args(["mdbook", "supports", "x"]))
            .is_empty()
    );
}

/// Files in Markdown of the packages that cargo has fetched for this one.
fn public_files() -> Vec<PathBuf> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| Some(env::home_dir()?.join(".cargo")));
    let mut dirs = vec![home.unwrap_or_default().join("registry/src")];
    let mut files = vec![];
    while let Some(dir) = dirs.pop() {
        for entry in fs::read_dir(dir).into_iter().flatten().flatten() {
            let path = entry.path();
            match path.extension() {
                _ if path.is_dir() => dirs.push(path),
                Some(extension) if extension == "md" => files.push(path),
                _ => {}
            }
        }
    }
    files.sort();
    files
}

#[test]
fn public_files_are_woven_unchanged() {
    let files = public_files();
    if files.len() < 20 {
        return crate::common::skip("cargo's registry is elsewhere");
    }
    for path in files {
        let text = fs::read(&path).unwrap();
        let plain = Source::new(b"a.md".into(), text.clone());
        let page = weave(&[plain], Form::Document, false);
        assert!(page.unwrap()[0] == text, "{}", path.display());
        // Before a chunk the same prose goes through all stages.
        let text = text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&text);
        let mut text = text.to_vec();
        text.retain(|byte| *byte != b'\r');
        let chunk = b"\n```\n~~~\n```\n~~~\n<<zzqq>>=\n1\n@\n";
        let whole = [&text[..], chunk].concat();
        let whole = Source::new(b"a.md".into(), whole);
        let page = weave(&[whole], Form::Document, false).unwrap();
        assert!(page[0].starts_with(&text), "{}", path.display());
    }
}

fn run(command: &mut Command) -> String {
    let output = command.stderr(Stdio::inherit()).output().unwrap();
    assert!(output.status.success(), "{command:?}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn the_common_words_are_those_of_six_commands() {
    let place = tempfile::tempdir().unwrap();
    let web = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/wc.md");
    let source =
        run(Command::new(NOWEB).args(["notangle", "-Rwc.rs", web]));
    fs::write(place.path().join("wc.rs"), source).unwrap();
    run(Command::new("rustc").arg("wc.rs").current_dir(&place));
    let pipe = "tr -cs A-Za-z '\\n' | tr A-Z a-z | sort | uniq -c | \
                LC_ALL=C sort -k1,1nr -k2 | sed 20q";
    let input = || fs::File::open(web).unwrap();
    let words = run(Command::new("sh").args(["-c", pipe]).stdin(input()));
    let program = place.path().join("wc");
    assert_eq!(run(Command::new(program).arg("20").stdin(input())), words);
}

/// A place with a new program, whose build finds our tool.
fn new_program(form: &str) -> (tempfile::TempDir, PathBuf) {
    let place = tempfile::tempdir().unwrap();
    let mut new = Command::new(NOWEB);
    run(new.args(["new", "greet", form]).current_dir(&place));
    let again = new.output().unwrap();
    assert_eq!(again.status.code(), Some(1), "nothing is overwritten");
    let dir = place.path().join("greet");
    (place, dir)
}

fn cargo(dir: &Path, verb: &str) -> std::process::Output {
    let path = Path::new(NOWEB).parent().unwrap().as_os_str().to_owned();
    let rest = env::var_os("PATH").unwrap_or_default();
    let path = [path, rest].join(":".as_ref());
    let mut cargo = Command::new("cargo");
    cargo.args([verb, "-q", "--offline"]).current_dir(dir);
    cargo.env("PATH", path).env("CARGO_TARGET_DIR", dir.join("target"));
    cargo.output().unwrap()
}

#[test]
fn a_new_program_runs_at_once_and_errors_lie_in_its_chapters() {
    let (_place, dir) = new_program("--markdown");
    let said = cargo(&dir, "run");
    assert!(said.stdout.ends_with(b", world!\n"), "{said:?}");
    let (_other, latex) = new_program("--latex");
    for file in ["src/main.rs", "src/greeting.rs"] {
        let [a, b] = [&dir, &latex].map(|dir| fs::read(dir.join(file)));
        assert_eq!(a.unwrap(), b.unwrap(), "{file}");
    }
    assert!(cargo(&latex, "test").status.success());
    let makefile = fs::read_to_string(dir.join("Makefile")).unwrap();
    assert!(makefile.contains("\nbin:\n\t$(MAP) cargo build\n"));
    // What is wrong in a chunk is shown in the chapter.
    let chapter = dir.join("chapters/command.md");
    let text = fs::read_to_string(&chapter).unwrap();
    fs::write(&chapter, text.replace("3600", "\"an hour\"")).unwrap();
    assert!(!cargo(&dir, "run").status.success());
    let mut map = Command::new(NOWEB);
    map.args(["map", "chapters/SUMMARY.md", "--", "cargo", "build", "-q"]);
    let told = map.current_dir(&dir).output().unwrap();
    let told = String::from_utf8_lossy(&told.stderr).into_owned();
    assert!(told.contains("chapters/command.md:22:"), "{told}");
}

#[test]
fn a_name_that_cargo_refuses_makes_nothing() {
    let place = tempfile::tempdir().unwrap();
    let new = |name: &str| {
        let mut new = Command::new(NOWEB);
        new.args(["new", name, "--latex"]).current_dir(&place);
        let told = String::from_utf8(new.output().unwrap().stderr).unwrap();
        (place.path().join(name).exists(), told)
    };
    for name in
        "build deps examples incremental test fn Self async try std \
                 core proc-macro CON lpt9 1a é -a a.b"
            .split(' ')
    {
        let (is_made, told) = new(name);
        assert!(!is_made && told.starts_with("error: "), "{name}: {told}");
    }
    for name in ["MASTER", "tests", "com0", "a_NAME-1", "Fn"] {
        assert_eq!(new(name), (true, String::new()));
        let read =
            |file| fs::read_to_string(place.path().join(name).join(file));
        let line = format!("\nname = \"{name}\"\n");
        assert!(read("Cargo.toml").unwrap().contains(&line));
        let title = format!("\\detokenize{{{name}}}");
        assert!(read("book.nw").unwrap().contains(&title));
        assert!(read("build.rs").unwrap().contains("\"book.nw\"]"));
    }
}

#[test]
fn a_new_program_has_the_way_back_and_says_what_it_lacks() {
    let (_place, dir) = new_program("--markdown");
    let (_place, latex) = new_program("--latex");
    let sh = |dir: &Path, line: &str| {
        let line = line.replace("NOWEB", NOWEB);
        let mut sh = Command::new("sh");
        let done =
            sh.args(["-c", &line]).current_dir(dir).output().unwrap();
        let told = [done.stdout, done.stderr].concat();
        (done.status.success(), String::from_utf8(told).unwrap())
    };
    for (dir, master) in
        [(&dir, "chapters/SUMMARY.md"), (&latex, "book.nw")]
    {
        let edit = |from, to| {
            let line = format!("sed -i s/{from}/{to}/ src/greeting.rs");
            assert!(sh(dir, &line).0);
        };
        edit("Good.day", "Hello");
        // The whole command that the refusal of the tangler gives.
        let (done, told) = sh(dir, &format!("NOWEB tangle {master}"));
        let (_, help) =
            told.split_once("help: to carry it there: noweb").unwrap();
        assert!(
            !done && help.starts_with(&format!(" untangle {master}\n"))
        );
        let (done, told) = sh(dir, &format!("NOWEB untangle {master}"));
        assert!(done && told.contains("greeting"), "{told}");
        edit("Hello", "Hallo");
        let (done, told) =
            sh(dir, "PATH=$(dirname NOWEB):$PATH make -s untangle");
        assert!(done && told.contains("greeting"), "{told}");
        assert!(sh(dir, "grep -r Hallo chapters").0);
        assert!(!dir.join(".tangled").exists());
    }
    let make = sh(&dir, "command -v make").1;
    for (dir, verb, lacks) in [
        (&dir, "html", "cargo install mdbook"),
        (&dir, "watch", "cargo install mdbook"),
        (&latex, "pdf", "apt-get install latexmk"),
    ] {
        let line = format!("PATH=/nowhere {} {verb}", make.trim());
        let (done, told) = sh(dir, &line);
        assert!(!done && told.contains(lacks), "{told}");
    }
}
