#!/bin/sh
# picture.sh -- how wrong filtered pictures are, and how wrong they say they are
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: picture.sh PROGRAMS SCENE[@METHOD]...  (SCENE.obj and SCENE.view; the
# method is a gather if it is not named)
#
# Prints CSV. The errors are against 1024 samples, whose own error is taken
# off, and are means of squares over six seeds.
set -eu
programs=$1
shift
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT
rms() { "$programs/ptimg" diff "$1" "$place/truth.exr" 2> /dev/null \
  | sed -n 's/^root mean square difference: //p'; }
number() { python3 -c 'import json, sys
value = json.load(open(sys.argv[1]))
for name in sys.argv[2:]:
    value = value[name]
print(value)' "$@"; }
echo case,gain,stated,bias
for name; do
  scene=${name%@*}
  method=gather
  if [ "$scene" != "$name" ]; then method=${name#*@}; fi
  render() { # shellcheck disable=SC2046
    "$programs/pt" "$scene.obj" -r 0.8 $(cat "$scene.view") -d 120x90 \
      --integrator $method -qf "$@"; }
  render -n 1024 -s 99 -o "$place/truth.exr" --report "$place/truth.json"
  truth=$(number "$place/truth.json" rmse)
  for n in 4 16 64; do
    for seed in 1 2 3 4 5 6; do
      render -n $n -s $seed -o "$place/a.png" -o "$place/a.pfm" \
        --report "$place/a.json"
      echo "$(rms "$place/a.pfm")" "$(rms "$place/a.png")" \
        "$(number "$place/a.json" picture rmse)" \
        "$(number "$place/a.json" picture bias)"
    done | awk -v scene="$(basename "$name")" -v n=$n -v truth="$truth" '
      { plain += $1 ^ 2 - truth ^ 2; shown += $2 ^ 2 - truth ^ 2
        stated += $3 ^ 2; bias += $4 ^ 2 }
      END { printf "%s/%d,%.2f,%.3f,%.2f\n", scene, n, plain / shown,
        sqrt(stated / shown), bias / stated }'
  done
done
