// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! What public reports of other tools have found wrong, and was wrong here.

use crate::common::{Scratch, run};

// A comment with the name of a chunk would cut a command in two, or become a
// part of a string or of a text for its reader.
#[test]
fn a_chunk_adds_its_lines_and_the_blanks_before_its_use_and_nothing_else() {
    let scratch = Scratch::new();
    for (name, before, after) in [
        ("a.sh", "cat a \\\n  ", " |\n  sort"),
        ("bin/a", "#!/bin/sh\ncat <<'END'\n", "\nEND"),
        ("a.py", "def f():\n\tx = \"\"\"\n\t", "\n\"\"\""),
        ("a/GNUmakefile", "all:\n\t", "\nb:\n\t<<A few lines>>"),
        ("a.rs", "const A: &str = \"\\\n", "\\\n\";"),
        ("b.rs", "fn f() {\n\tg(r#\"\n\t", "\n\"#);\n}"),
    ] {
        let body = format!("{before}<<A few lines>>{after}\n");
        let chunk = "<<A few lines>>=\none \\\n\n\ttwo\nthree\n";
        scratch.write("a.nw", format!("<<{name}>>=\n{body}@\n{chunk}"));
        let outcome = run(scratch.path(), &["tangle", "a.nw"]);
        assert_eq!(outcome.status, 0, "{name}: {}", outcome.stderr());
        let blanks = before.rsplit('\n').next().unwrap();
        let lines = format!("one \\\n\n{blanks}\ttwo\n{blanks}three");
        let done = body.replace("<<A few lines>>", &lines);
        assert_eq!(scratch.read(name), done, "{name}");
    }
}
