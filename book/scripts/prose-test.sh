#!/bin/sh
# prose-test.sh -- does book/scripts/prose find what is planted, and nothing else?
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
set -eu
prose=$(cd "$(dirname "$0")" && pwd)/prose
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

# Everything that is no prose is misspelt; the prose is not.
cat > clean.nw <<'WEB'
\chapter{A clean chapter}
\label{chap:misspelld}
% A comment is for those who edit: misspelld.
The neighbour's colour $misspelld + \text{misspelld}$ is the $n$-th of x86-64,
see \cite{misspelld}, \file{misspelld/x.rs}, \verb|misspelld|, [[misspelld[0]]]
and \texttt{misspelld {misspelld}}, \v{M}i\v{s}sp\'eld, 50\,\% of 3--4 at all.
\begin{equation}
  misspelld = 1-2
\end{equation}
<<Show the colour of [[misspelld]]>>=
let misspelld = "the the"; // i.e misspelld
@ %def misspelld
Prose goes on after the chunk.
\begin{tabular}{lr}
  one & two \\ \cmidrule(lr){1-2}
\end{tabular}
<<src/misspelld.rs>>=
struct Misspelld;
WEB
"$prose" clean.nw > found || { echo 'error: clean prose has faults' >&2; exit 1; }

# One fault per line, but for the first and the line of a chunk's end.
cat > faulty.nw <<'WEB'
Nothing is wrong in the first line,
here a mispelling, in a line of its own,
the color and the neighbor,
and $x$ the the answer,
which is doubled over the
the end of a line, i.e here;
we optimize 3-4 lines
<<Show the colur of it>>=
fine();
@ And after the chunk anothr.
WEB
cat > expected <<'FAULTS'
faulty.nw:2: unknown word 'mispelling'
faulty.nw:3: unknown word 'color'
faulty.nw:3: unknown word 'neighbor'
faulty.nw:4: 'the the': a word twice
faulty.nw:5: 'the the': a word twice
faulty.nw:6: 'i.e': lacks its full stops
faulty.nw:7: '3-4': a range of numbers takes two hyphens
faulty.nw:7: 'optimize': written with s in British English
faulty.nw:8: unknown word 'colur'
faulty.nw:10: unknown word 'anothr'
FAULTS
if "$prose" faulty.nw > /dev/null 2> found; then
  echo 'error: faulty prose passes' >&2
  exit 1
fi
sort -t : -k 2n -k 3 found | diff expected - || {
  echo 'error: book/scripts/prose finds other faults (>) than were planted (<)' >&2
  exit 1
}

# 41 lines of code are one too many, with or without hunspell.
{ echo '<<src/long.rs>>='; seq 41; } > long.nw
if "$prose" --sizes long.nw > /dev/null 2> found ||
  ! grep -q '^long.nw:1: 41 lines of code: src/long.rs$' found; then
  echo 'error: a chunk of 41 lines passes' >&2
  exit 1
fi
python=$(python3 -c 'import sys; print(sys.executable)')
if PATH=/nonexistent "$python" "$prose" clean.nw > /dev/null 2> found ||
  ! grep -q '^error: no hunspell.*apt-get install' found; then
  echo 'error: the lack of hunspell is not reported' >&2
  exit 1
fi
echo 'book/scripts/prose finds the faults that are planted, and no others'
