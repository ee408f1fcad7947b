#!/bin/sh
# places.sh -- how long values of places take, and whether they are right
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: places.sh PT OCCLUSION STATUE.obj  (OCCLUSION is the example of that
# name, and makes bare rays)
#
# Prints CSV. Seconds are medians of three runs, of the whole process; beyond
# is how many of 20 points are more than three standard errors from 10^7 paths
# of the reference.
set -eu
pt=$1 occlusion=$2 statue=$3
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
cp doc/examples/room.* "$place"
sh doc/examples/grid.sh 0 0 6 4 40 25 0.85 > "$place/grid.txt"
sh doc/examples/street.sh > "$place/street.obj"
median() { # of the seconds of three runs
  for _ in 1 2 3; do
    began=$(date +%s.%N)
    "$@" > "$place/out" 2> "$place/said"
    echo "$began $(date +%s.%N)"
  done | awk '{ print $2 - $1 }' | sort -n | sed -n 2p
}
room() {
  "$pt" "$place/room.obj" --materials --sky overcast -qf "$@"
}
value() { # COMMAND FILE: of the seventh column
  awk -F, -v which="$1" 'NR > 1 { x = 100 * $7
      if (NR == 2 || (which == "most" ? x > best : x < best)) best = x }
    END { printf "%.2f", best }' "$2"
}
seconds=$(median room --points "$place/grid.txt" --ground 0.2 --error 1% \
  --error-norm max -o "$place/room.csv")
room --points "$place/grid.txt" --ground 0 --error 1% -o "$place/bare.csv"
awk 'NR % 50 == 1' "$place/grid.txt" > "$place/few.txt"
room --points "$place/few.txt" --ground 0.2 -n 10000000 -s 9 \
  --integrator reference -o "$place/truth.csv"
beyond=$(awk -F, 'NR == FNR { if (FNR > 1) { v[FNR] = $7; e[FNR] = $8 } next }
  FNR > 1 && FNR % 50 == 2 { k = (FNR - 2) / 50 + 2
    d = $7 - v[k]; if (d * d > 9 * ($8 * $8 + e[k] * e[k])) n++ }
  END { print n + 0 }' "$place/truth.csv" "$place/room.csv")
echo task,seconds,ratio,largest,least,other,beyond
echo "room,$seconds,,$(value most "$place/room.csv"),$(value least \
  "$place/room.csv"),$(value least "$place/bare.csv"),$beyond"
seconds=$(median "$pt" "$place/street.obj" --faces -r 0 --error 0.002 \
  --error-norm max -qf -o "$place/street.csv")
awk -F, -v seconds="$seconds" 'NR > 1 { face = ($1 - 1) % 5
    if (face == 4) { if (!roofs++ || $3 < roof) roof = $3 }
    else { if (!walls++) { least = most = $3 }
      if ($3 < least) least = $3
      if ($3 > most) most = $3 } }
  END { printf "street,%s,,%.2f,%.2f,%.2f,\n", seconds, most, least, roof }' \
  "$place/street.csv"
seconds=$(median "$pt" "$statue" --vertices -r 0 --sky sphere -n 256 -qf \
  -o "$place/statue.obj")
rays=$(for _ in 1 2 3; do "$occlusion" "$statue" 2>&1 > /dev/null; done |
  sed 's/ s .*//' | sort -n | sed -n 2p)
echo "vertices,$seconds,$(awk "BEGIN { printf \"%.2f\", $seconds / $rays }"),,,,"
