#!/bin/sh
# year.sh -- a sky matrix in Radiance's format: overcast days of a year
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: year.sh [LATITUDE]    every fifth day, 24 hours each, Tregenza's patches
awk -v latitude="${1:-52}" 'BEGIN {
  rad = atan2(0, -1) / 180; steps = 73 * 24
  for (step = 0; step < steps; step++) {
    tilt = -23.45 * rad * cos(rad * 360 * (5 * int(step / 24) + 10) / 365)
    turn = 15 * rad * (step % 24 + 0.5 - 12)
    sine = sin(latitude * rad) * sin(tilt) + cos(latitude * rad) * cos(tilt) * cos(turn)
    # The light of an overcast sky in lux (Krochmann and Seidl 1974)
    lux[step] = sine > 0 ? 300 + 21000 * sine : 0
  }
  printf "#?RADIANCE\nNROWS=146\nNCOLS=%d\nNCOMP=3\nFORMAT=ascii\n\n", steps
  split("1 30 30 24 24 18 12 6 1", count)
  for (row = 0; row <= 8; row++) {
    sine = row == 8 ? 1 : sin(rad * (12 * row - 6))
    part = row ? 3 / 7 * (1 + 2 * sine) / rad / 180 / 179 : 0
    for (patch = 0; patch < count[row + 1]; patch++) {
      for (step = 0; step < steps; step++) {
        value = sprintf("%.4g", part * lux[step])
        print value, value, value
      }
      print ""
    }
  }
}'
