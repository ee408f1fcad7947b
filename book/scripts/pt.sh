#!/bin/sh
# pt.sh PT DIR -- what the program says to wrong input, and after a render
#
# Runs the program on faulty files and command lines, and writes what is to be
# seen on a terminal to DIR/faults.txt, DIR/wrong.txt and DIR/summary.txt, so
# that the book shows what the program does and not what somebody remembers.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
set -eu
case $1 in /*) pt=$1 ;; *) pt=$PWD/$1 ;; esac
mkdir -p "$2/pt"
cd "$2/pt"

# fault LAST: the message about a triangle's file that ends in the line LAST.
fault() {
  printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\n%b\n' "$1" > bad.obj
  printf '%b\n' "$1" | cat -v
  "$pt" -i bad.obj 2>&1 > image.pgm | sed 's/^/    /'
}

{
  fault 'v 1 2'
  fault 'v 1 nan 2\nf 1 2 4'
  fault 'v 1 2 1e999\nf 1 2 4'
  fault 'v one 2 3'
  fault 'f 1 2'
  fault 'f 1 2 4'
  fault 'f -1 -2 -4'
  fault 'f 1 2 3/x'
  fault '# no face at all'
} > ../faults.txt

# wrong ARGUMENT...: the message about a command line.
wrong() {
  echo "\$ pt $*"
  "$pt" "$@" 2>&1 > image.pgm | fold -s -w 76 || true
}

printf 'v -9 -9 0\nv 9 -9 0\nv 9 9 0\nv -9 9 0\nf 1 2 3 4\n' > floor.obj
printf 'v -1 -1 3\nv 1 -1 3\nv 0 1 2\nf 5 6 7\n' >> floor.obj
{
  wrong -d 800x600x3
  wrong --albdo 0.5
  wrong -n 0
  wrong -p 1,2
  wrong -r 1.5
  wrong -p 0,1,0
  wrong -t 0,0,1
  : > image.png
  wrong -o image.png
  wrong -o image.tiff
  wrong --time 0
  wrong --report image.pdf
  wrong -i floor.obj --resume image.png
} > ../wrong.txt

options='-p 0,-12,6 -t 0,0,1 -n 64 -r 0.5'
{
  echo "\$ pt $options -i floor.obj -o floor.pgm -f"
  "$pt" $options -i floor.obj -o floor.pgm -f 2>&1 | fold -s -w 76
} > ../summary.txt
