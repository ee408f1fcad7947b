#!/bin/sh
# session.sh DIR BUILD_DIR -- from the programs to an image and a report
#
# Runs what a newcomer types, and writes it with what is to be seen on a
# terminal to DIR/session.txt.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
set -eu
mkdir -p "$1/session"
out=$(cd "$1" && pwd)
build=$(cd "$2" && pwd)
cd "$out/session"
ln -sfn "$build" build
rm -f scene.*
exec > "$out/session.txt"

# typed COMMAND: shows a command, runs it, and shows what it says.
typed() {
  printf '%s\n' "\$ $1"
  (eval "$1") > said 2>&1 || { cat said >&2; exit 1; }
  fold -s -w 76 said
}

typed "cat > scene.obj <<END
v -9 -9 0
v  9 -9 0
v  9  9 0
v -9  9 0
v  0 -2 0
v  2  1 0
v -2  1 0
v  0  0 3
f 1 2 3 4
f 5 6 8
f 6 7 8
f 7 5 8
END"
typed 'build/pt scene.obj -r 0.7 -n 64 -o scene.png --report scene.html'
test -s scene.png && test -s scene.html
