#!/bin/sh
# test.sh -- does vim treat a web as it should?
#
# Opens small webs without a window. Compares the syntax groups of some places
# with what they ought to be, then runs test.vim in a web of three chapters.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
set -eu
vim=$(cd "$(dirname "$0")" && pwd)
export LITPT_VIM="$vim"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cat > "$work/test.nw" <<'WEB'
\section{One}
Prose with [[let x: u8 = 1;]] and \emph{more [[fn g()]] here} $a$.
% a comment
<<Compute it>>=
fn main() {
    let s = "a <<Fill in>> b"; // <<x>>
    <<Use a chunk>>
    1 @<< 2 >> 3
}
@ %def main
More $x_1$ prose.
<<Second>>=
struct A;
<<Third>>=
impl A { fn unclosed(&self) { "
@
\section{Two}
WEB

# Line, text at the place, and the innermost group there.
cat > "$work/expected" <<'PLACES'
1 section texSection
2 let rustKeyword
2 [[ nowebBracket
2 fn rustKeyword
2 $a texDelimiter
3 % texComment
4 << nowebDefinition
5 fn rustKeyword
6 "a rustString
6 <<Fill nowebUse
6 <<x nowebUse
7 << nowebUse
8 @<< nowebEscape
8 >> rustOperator
10 @ nowebDefinition
10 %def texComment
11 x_1 texMathZoneX
12 << nowebDefinition
13 struct rustStructure
14 << nowebDefinition
15 impl rustKeyword
17 section texSection
PLACES

cat > "$work/ask.vim" <<'ASK'
filetype on
syntax on
edit test.nw
let found = [&filetype]
for place in readfile('expected')
  let [line, text; _] = split(place)
  let column = stridx(getline(line), text) + 1
  let group = synIDattr(synID(line, column, 1), 'name')
  call add(found, line . ' ' . text . ' ' . group)
endfor
call writefile(found, 'found')
quitall!
ASK

cd "$work"
run() {
  vim -Nu NONE -i NONE -n -es --cmd "set runtimepath^=$vim" -S "$1" \
    < /dev/null > log 2>&1 || true
}
run ask.vim
sed -i '1i noweb' expected
if ! diff expected found; then
  echo 'error: vim paints webs otherwise than expected (<)' >&2
  exit 1
fi

# ---- a web of three chapters, with code in three languages

mkdir -p web/chapters web/src
cd web
cat > litpt.nw <<'WEB'
\documentclass{memoir}
\begin{document}
\include{one}
\include{two} % and a remark
\include{three}
\end{document}
WEB
cat > chapters/one.nw <<'WEB'
\chapter{One}
The first chapter.
<<src/one.rs>>=
<<Licence of all>>
fn one() -> u8 {
    <<Compute [[v[0]]] in two>>
}
@ %def one
Prose between.
<<Ask the shell>>=
if test "$x" = 1; then <<Say so>>; fi
@
<<Makefile>>=
all: one.o
	@touch $@
@
WEB
cat > chapters/two.nw <<'WEB'
\chapter{Two}
<<Compute [[v[0]]] in two>>=
let mut y = one(); <<Fill it>> <<Fill it>>
@ %def y
<<Fill it>>=
y += 1;
@
<<run.sh>>=
<<Licence of all>>
<<Ask the shell>>
@
WEB
cat > chapters/three.nw <<'WEB'
\chapter{Three}
<<Compute [[v[0]]] in two>>=
y + 1
@
<<Licence of all>>=
Licensed as one likes.
@
<<Say so>>=
echo "yes" | sed 's/y/n/'
@
<<Fill it>>=
y += 2;
@
WEB
mkdir book
printf '%s\n' '- [One](one.md)' '- [Two](two.md)' > book/SUMMARY.md
printf '%s\n' '# One' '<<Say it>>=' 'x;' '@' > book/one.md
printf '%s\n' '# Two' 'See [[a]](b).' '<<two.rs>>=' 'let x = 1;' \
  '<<Say it>>' '@' > book/two.md
echo '// tangled' > src/one.rs
mkdir -p noweb/chapters
echo '\include{tool}' > noweb/noweb.nw
printf '<<tool.rs>>=\nfn tool() {}\n@\n' > noweb/chapters/tool.nw

# What make prints, as recorded from rustc, cargo, the tool and LaTeX.
cat > Makefile <<'MAKE'
all:
	@cat $(LOG)
MAKE
cat > type.log <<'LOG'
   Compiling litpt v0.1.0 (/somewhere/litpt)
error[E0308]: mismatched types
    --> chapters/two.nw:3:13
     |
   3 | let mut y = one(); y += 1; // a:1: b
     |             ^^^^^ expected `u32`, found `u8`
     |
note: function defined here
    --> chapters/one.nw:5:4
     |
   5 | fn one() -> u8 {
     |    ^^^
help: you can convert a `u8` to a `u32`
     |
   3 | let mut y = one().into();
     |                  +++++++

For more information about this error, try `rustc --explain E0308`.
error: could not compile `litpt` (lib) due to 1 previous error
warning: build failed, waiting for other jobs to finish...
make: *** [Makefile:2: bin] Error 101
LOG
cat > link.log <<'LOG'
error: linking with `cc` failed: exit status: 1
  |
  = note: some arguments are omitted
LOG
cat > lint.log <<'LOG'
    Checking litpt v0.1.0 (/somewhere/litpt)
warning: this `if` has identical blocks
   --> chapters/three.nw:3:5
    |
    = help: for further information visit https://rust-lang.github.io/x
    = note: `#[warn(clippy::if_same_then_else)]` on by default

warning: `litpt` (lib) generated 1 warning
    Finished `dev` profile [unoptimized + debuginfo] target(s) in 0.10s
LOG
cat > test.log <<'LOG'
running 2 tests
test courts_agree ... ok
test walls_agree ... FAILED

failures:

---- walls_agree stdout ----

thread 'walls_agree' (31780) panicked at chapters/two.nw:6:1:
assertion `left == right` failed: told you
  left: 1
 right: 2
stack backtrace:
   0: __rustc::rust_begin_unwind
             at /rustc/59807616/library/std/src/panicking.rs:689:5
   4: litpt::one::one
             at chapters/one.nw:5:1
   9: tool::run
             at noweb/chapters/tool.nw:2:1
   7: core::ops::function::FnOnce::call_once
             at /rustc/59807616/library/core/src/ops/function.rs:250:5
note: Some details are omitted, run with `RUST_BACKTRACE=full` for a verbose one.

failures:
    walls_agree

test result: FAILED. 1 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out
error: test failed, to rerun pass `-p litpt --test walls`
LOG
cat > old-panic.log <<'LOG'
thread 'main' panicked at chapters/three.nw:9:3:
index out of bounds: the len is 0 but the index is 3
note: run with `RUST_BACKTRACE=1` environment variable to display a backtrace
LOG
cat > tool.log <<'LOG'
chapters/two.nw:3:20: error: undefined chunk name: <<Fill itt>>
  let mut y = one(); <<Fill itt>>
                     ^
  help: there is a chunk <<Fill it>>
chapters/one.nw:10:3: warning: chunk <<Ask the shell>> is never used
LOG
cat > tex.log <<'LOG'
latexmk build/tex/litpt.tex
chapters/two.nw:1: Undefined control sequence.
l.1 \chapterr
             {Two}
chapters/one.nw:2: warning: Overfull \hbox (1.5pt too wide) in paragraph
LOG
cat > format.log <<'LOG'
Diff in chapters/one.nw:6:
-    y
+    z
LOG

run "$vim/test.vim"
if ! test -e result || ! grep -q '^ok$' result; then
  cat result >&2 || { cat log; echo 'error: vim has not run test.vim'; } >&2
  exit 1
fi
echo "vim paints $(($(wc -l < ../expected) - 1)) places and does the" \
  "$(grep -c '^function! Test' "$vim/test.vim") things it should"
