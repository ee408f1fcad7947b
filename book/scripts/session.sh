#!/bin/sh
# session.sh get DIR -- from the repository to the programs
# session.sh use DIR BUILD_DIR -- from the programs to an image and a report
#
# Runs what a newcomer types, the first part in a clone of this repository, and
# writes it with what is to be seen on a terminal to DIR/session-get.txt and
# DIR/session-use.txt. The lines of cargo on single packages are left out. What
# is no repository, an unpacked archive, is not cloned.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
set -eu
mkdir -p "$2/session"
out=$(cd "$2" && pwd)
from=$PWD
if test "$1" = use; then build=$(cd "$3" && pwd); fi
cd "$out/session"

# typed COMMAND [RUN]: shows a command, runs it or what stands for it, and
# shows what it says.
typed() {
  printf '%s\n' "\$ $1"
  (eval "${2:-$1}") > said 2>&1 || { cat said >&2; exit 1; }
  grep -v -E '^ +(Compiling|Download|Updating|Locking)' said |
    sed 's/ in [0-9ms. ]*$//' | fold -s -w 76 || true
}

get() {
  rm -rf litpt
  typed 'git clone -q ADDRESS litpt' "git clone -q '$from' litpt"
  echo '$ cd litpt'
  cd litpt
  unset BUILD_DIR MAKEFLAGS MFLAGS MAKELEVEL
  export CARGO_TARGET_DIR="$out/session/target"
  typed 'make -s bin'
  test -x build/pt
}

use() {
  rm -rf own
  mkdir own
  cd own
  ln -sfn "$build" build
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
}

if test "$1" = get && ! git -C "$from" rev-parse 2> /dev/null; then
  echo '(not recorded, since this is no repository)'
else
  "$1"
fi > "$out/session-$1.txt"
