#!/bin/sh
# messages.sh NOWEB DIR -- what the tool says about the examples
#
# Tangles every example of doc/examples in DIR/work and writes what is to be
# seen on a terminal to DIR/NAME.txt, and a tangled file to DIR/greet.rs, so
# that the book shows what the tool does and not what somebody remembers.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
set -eu
case $1 in /*) noweb=$1 ;; *) noweb=$PWD/$1 ;; esac
here=$(cd "$(dirname "$0")/../../doc/examples" && pwd)
mkdir -p "$2"
out=$(cd "$2" && pwd)
rm -rf "$out/work"

# tangle NAME: tangles NAME.nw where only that file is, and tells about it.
tangle() {
  mkdir -p "$out/work/$1"
  cd "$out/work/$1"
  test -e "$1.nw" || cp "$here/$1.nw" .
  {
    echo "\$ noweb tangle $1.nw"
    "$noweb" tangle "$1.nw" 2>&1 || true
  } > "$out/$1.txt"
}

for name in misspelt shift cycle prose unused greet; do tangle $name; done

# The same file once more, edited by hand in between.
cp src/greet.rs "$out/greet.rs"
sed 's/Good morning/Good night/' src/greet.rs > edited && mv edited src/greet.rs
tangle greet
mv "$out/greet.txt" "$out/edited.txt"
rm -rf "$out/work"
