#!/bin/sh
# grid.sh -- points in the middles of the cells of a grid, which look up
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#
# usage: grid.sh X0 Y0 X1 Y1 NX NY HEIGHT
awk -v x0="$1" -v y0="$2" -v x1="$3" -v y1="$4" \
  -v nx="$5" -v ny="$6" -v z="$7" '
  BEGIN {
    for (j = 0; j < ny; j++)
      for (i = 0; i < nx; i++)
        print x0 + (i + 0.5) * (x1 - x0) / nx,
          y0 + (j + 0.5) * (y1 - y0) / ny, z, 0, 0, 1
  }'
