#!/bin/sh
# Tangle the tool with itself, and install what proves itself.
#
# Copyright (C) 2026 litpt contributors
#
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any
# warranty.
# SPDX-License-Identifier: FSFAP
#
# usage: noweb/boot.sh CHAPTER...

set -eu
cd "$(dirname "$0")/.."
cargo=${CARGO:-cargo}
boot=${BUILD_DIR:-build}/boot
export CARGO_TARGET_DIR="$PWD/$boot/target"

fail() {
  echo "boot: $1; noweb/ is as it was" >&2
  exit 1
}

test $# -gt 0 || fail "which chapters?"
for chapter; do
  test -r "$chapter" || fail "cannot read $chapter"
done

# tangle BINARY STAGE: its crates, in a workspace of their own
tangle() {
  stage=$boot/$2
  rm -rf "$stage"
  mkdir -p "$stage/noweb/core"
  cp noweb/Cargo.toml "$stage/noweb/"
  cp noweb/core/Cargo.toml "$stage/noweb/core/"
  cp -r noweb/tests noweb/.tangled "$stage/noweb/"
  for chapter in $chapters; do
    mkdir -p "$stage/$(dirname "$chapter")"
    cp "$chapter" "$stage/$chapter"
  done
  printf '[workspace]\nmembers = ["noweb", "noweb/core"]\nresolver = "3"\n' \
    >"$stage/Cargo.toml"
  test ! -f Cargo.lock || cp Cargo.lock "$stage/"
  "$1" tangle -C "$stage" --record noweb/.tangled \
    ${chapters%% *} 2>"$stage/messages" ||
    { cat "$stage/messages" >&2 && fail "$2 does not tangle"; }
}

# build STAGE: its binary is $boot/STAGE/noweb.bin
build() {
  (cd "$boot/$1" && "$CARGO_TARGET_DIR/../stage0.bin" map ${chapters%% *} -- \
    $cargo build -q -p noweb) ||
    fail "$1 does not compile"
  cp "$CARGO_TARGET_DIR/debug/noweb" "$boot/$1/noweb.bin"
}

# agree STAGE STAGE
agree() {
  diff -r -q "$boot/$1/noweb" "$boot/$2/noweb" >/dev/null
}

chapters=$*
$cargo build -q --profile tool --manifest-path noweb/Cargo.toml ||
  fail "the installed tool does not compile"
mkdir -p "$boot"
cp "$CARGO_TARGET_DIR/tool/noweb" "$boot/stage0.bin"
tangle "$boot/stage0.bin" stage1
build stage1
tangle "$boot/stage1/noweb.bin" stage2
last=stage1
if ! agree stage1 stage2; then
  build stage2
  tangle "$boot/stage2/noweb.bin" stage3
  agree stage2 stage3 || fail "stages 2 and 3 disagree"
  last=stage2
fi

(cd "$boot/$last" && $cargo test -q -p noweb --test all golden::) ||
  fail "$last fails its tests"
"$boot/$last/noweb.bin" tangle --record noweb/.tangled \
  ${chapters%% *} 2>"$boot/messages" ||
  { cat "$boot/messages" >&2 && fail "it cannot be installed"; }
echo "boot: installed; the stages agree and the tests pass"
