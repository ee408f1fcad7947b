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

# Each habit once too often, in each of its forms: the numbers below are the
# numbers of the forms. A chapter of few words may have most of them once.
lines() { # lines FORMAT WORDS...: the format with each of the words
  format=$1
  shift
  for word; do printf "$format\n" "$word"; done
}
near_far() { # near_far NUMBER: so many words
  seq "$1" | sed 's/.*[02468]$/far/; s/.*[0-9]$/near/' | tr '\n' ' '
}
{
  printf 'So it ends. So it is.\n\nSo it begins.\n\n'
  printf 'What is here is bright! What is there is dark.\n'
  echo 'The light is that of a lamp or those of two.'
  lines '%s is best, section 2 decides.' What How Where Whether Why When
  lines 'Which is best, %s 3 shows.' chapter section table figure
  lines 'How fast it is, table 3 %s.' finds measures find show
  lines 'How far, chapter 3 %s.' says tells asks
  lines 'Of %s rays, one is lost.' the a an its our these those all two three \
    four five six seven eight nine ten 11
  lines 'It falls %s it.' 'in proportion to' 'but for' 'held against' \
    'with the probability of' 'dearer than' 'as dear as' 'to no end with' \
    foresee foresees foreseen \
    'and has the variance of' 'and have the probability of'
  lines '%s reads it is right.' Who Whoever 'One who' 'He who'
  lines 'They %s it.' know knows ask tell say want wants hear
  lines 'It is there, %s which it goes.' of in to from with by for at on after \
    through under over
  echo 'A wall whose end is near.'
  near_far 45
  echo 'away. Then the next.'
  near_far 45
  echo 'away.'
} > habits.nw
cat > expected <<'FAULTS'
habits.nw:1: 2 times "that of" for a noun, at most 1 in 1000 words
habits.nw:1: 3 times "What" as a subject, at most 0.8 in 1000 words
habits.nw:1: 3 times "So" first, at most 0.8 in 1000 words
habits.nw:1: 17 times a question as a subject, at most 0 in 1000 words
habits.nw:1: 18 times "Of ten ..., the", at most 0 in 1000 words
habits.nw:1: 12 times a phrase that was translated, at most 0.2 in 1000 words
habits.nw:1: 4 times "Who" for a reader who, at most 0 in 1000 words
habits.nw:1: 11 times a program that knows, asks, says, tells or wants, at most 4 in 1000 words
habits.nw:1: 14 times "of which", "whose", at most 3 in 1000 words
habits.nw:1: 2 times a long sentence, at most 0.8 in 1000 words
FAULTS
if "$prose" habits.nw > /dev/null 2> found; then
  echo 'error: a chapter full of habits passes' >&2
  exit 1
fi
sed 's/\( in 1000 words\): .*/\1/' found | diff expected - || {
  echo 'error: other habits are counted (>) than were planted (<)' >&2
  exit 1
}
grep -q 'words: that of a lamp or those of two. .* | those of two\.' found || {
  echo 'error: the places of a habit are not quoted' >&2
  exit 1
}
"$prose" --sizes habits.nw || {
  echo 'error: habits are counted where only sizes are asked for' >&2
  exit 1
}

# Once is allowed, and a question is no habit. One sentence is long, and any other
# would be one too many: all others end after 45 words, at a sign in quotation
# marks, at a formula of its own, an item, a cell of a table or an empty line.
cat > once.nw <<'WEB'
What is light? Who sees it? It is late, and so it is. They know a wall whose end is
near. Of course, the light is that of a lamp, dearer than oil. So it is. What ends is good.
WEB
{
  near_far 45
  echo 'away. Then'
  near_far 42
  printf "\`\`last.'' Then (now.) Then "
  near_far 42
  printf '\n\n'
  near_far 45
  printf '\n\\[\n  x\n\\]\n'
  near_far 44
  printf '\n\\begin{itemize}\n\\item '
  near_far 30
  printf 'on;\n\\item '
  near_far 30
  printf 'on.\n\\end{itemize}\n\\begin{tabular}{ll}\n'
  near_far 30
  printf '& '
  near_far 30
  printf '\\\\\n'
  near_far 30
  printf '\\\\\n\\end{tabular}\n'
} > long-sentences.nw
# In two thousand words a habit may stand twice, if it may in one thousand once.
{
  seq 300 | sed 's/.*/The ray goes on to a wall./'
  echo 'It is that of a lamp. It is that of a fire.'
} > twice.nw
for chapter in once long-sentences twice; do
  "$prose" "$chapter.nw" || {
    echo "error: habits are counted that are none, or are allowed: $chapter" >&2
    exit 1
  }
done
{
  echo 'Which is best, chapter 3 says. Of ten rays, one is lost.'
  echo 'Who reads it is right.'
} > never.nw
if "$prose" never.nw > /dev/null 2> found ||
  [ "$(grep -c '^never.nw:1: 1 times .* at most 0 ' found)" -ne 3 ]; then
  echo 'error: a habit passes that no chapter may have' >&2
  exit 1
fi
echo 'It is that of the sun.' >> twice.nw
if "$prose" twice.nw > /dev/null 2> found ||
  ! grep -q '^twice.nw:1: 3 times "that of"' found; then
  echo 'error: a habit too much in a long chapter passes' >&2
  exit 1
fi

# The first portion of a chapter follows no code; the others do, unless there is
# a word between. Labels and comments are none.
most=$(sed -n 's/^BARE = //p' "$prose")
portions() { # portions NUMBER TEXT: so many portions with the text after each
  seq "$1" | while read -r _; do printf '<<Show it>>=\nit();\n@ %s\n' "$2"; done
}
bare='%def it
\label{it} % Words.
\index{it}%'
portions $((most + 1)) "$bare" > bare.nw
{
  portions 2 'Words after the code.'
  printf 'Words.\n<<Show it>>=\nit();\n@\n\nWords.\n\n<<Show it>>=\nit();\n'
} > led.nw
"$prose" bare.nw led.nw || {
  echo 'error: bare portions are counted that are none, or are allowed' >&2
  exit 1
}
printf '<<Show it>>=\nit();\n' >> led.nw
if "$prose" bare.nw led.nw > /dev/null 2> found ||
  ! grep -q "^led.nw:16: $((most + 1)) portions .* at most $most: $most in bare.nw, 1 in led.nw$" found; then
  echo 'error: a bare portion too much passes' >&2
  exit 1
fi

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
