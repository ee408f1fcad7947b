#!/bin/sh
# test.sh -- does vim paint a web as it should?
#
# Opens a small web without a window and compares the syntax groups of some
# places with what they ought to be.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
set -eu
vim=$(cd "$(dirname "$0")" && pwd)
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
vim -Nu NONE -i NONE -es --cmd "set runtimepath^=$vim" -S ask.vim < /dev/null
sed -i '1i noweb' expected
if diff expected found; then
  echo "vim paints $(($(wc -l < expected) - 1)) places as it should"
else
  echo 'error: vim paints webs otherwise than expected (<)' >&2
  exit 1
fi
