#!/bin/sh
# street.sh -- an OBJ of fifty houses in five rows, from 6 m to 24 m high
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
awk 'BEGIN {
  for (k = 0; k < 50; k++) {
    x = 20 * (k % 10); y = 28 * int(k / 10); z = 6 + (k * 7 % 19)
    printf "o house%d\n", k + 1
    for (i = 0; i < 8; i++)
      print "v", x + 14 * (i % 2), y + 12 * (int(i / 2) % 2), z * int(i / 4)
    print "f -8 -7 -3 -4\nf -7 -5 -1 -3\nf -5 -6 -2 -1"
    print "f -6 -8 -4 -2\nf -4 -3 -1 -2"
  }
}'
