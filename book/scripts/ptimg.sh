#!/bin/sh
# ptimg.sh BUILD_DIR DIR -- what the companion says about some renders
#
# Renders the courtyard twice with different seeds, and once with walls that
# reflect one percent more, and writes what the companion says about them to
# DIR/info.txt, DIR/same.txt and DIR/other.txt, for the chapter on it. The
# other answers are for numbers in the text.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
set -eu
case $1 in /*) build=$1 ;; *) build=$PWD/$1 ;; esac
mkdir -p "$2/ptimg"
cd "$2/ptimg"
cp "$build/courtyard.obj" .

# render NAME SEED ALBEDO [SAMPLES]
render() {
  "$build/pt" -p 12.2,2.4,1.3 -t -12.6,6,-1.2 -u 0,1,0 -d 128x96 -n "${4:-64}" \
    --integrator reference \
    -i courtyard.obj -s "$2" -r "$3" -o "$1" -f -q
}
render one.exr 1 0.8
render two.exr 2 0.8
render other.exr 3 0.808

# ask FILE ARGUMENT...: the answer, after the command line.
ask() {
  answer=$1
  shift
  { echo "\$ ptimg $*" && { "$build/ptimg" "$@" || test $? = 1; }; } |
    fold -s -w 76 > "../$answer"
}
ask info.txt info one.exr
ask same.txt diff one.exr two.exr
ask other.txt diff one.exr other.exr

# The same seed, and walls that reflect more.
render again.exr 1 0.808
ask seeds.txt diff one.exr again.exr 2> ../seeds.log
# Fewer samples, one, and two.
render few.exr 1 0.8 16
render fewer.exr 2 0.8 16
ask few.txt diff few.exr fewer.exr
render single.exr 1 0.8 1
ask single.txt info single.exr
grep -E '^(mean|unknown_errors):' ../single.txt > ../unknown.txt
render pair.exr 1 0.8 2
ask pair.txt info pair.exr
# A picture of the errors, and the sizes of files.
ask white.txt stderr -f -o errors.png one.exr
"$build/ptimg" tonemap -f -o one.pgm one.exr > ../tonemap.log
"$build/ptimg" tonemap -f -o one.png one.exr > ../tonemap.log
for file in one.pgm one.png one.exr; do
  echo "$file: $(wc -c < $file)"
done > ../files.txt
