#!/bin/sh
# Record what noweb 2.12 does with the cases given, or with all of them.
#
# Copyright (C) 2026 litpt contributors
#
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any
# warranty.
# SPDX-License-Identifier: FSFAP
#
# usage: noweb/tests/record.sh [CASE...]
# A case is a directory under noweb/tests/cases that holds `command' (one
# line for the shell) and its inputs. The script writes stdout, stderr and
# status beside them. Where our tool differs on purpose, the case also
# holds ours.stdout, ours.status or ours.stderr, and `why'; those are
# written by hand.

set -eu
cd "$(dirname "$0")/cases"
library=${NOWEB_LIBRARY:-/usr/lib/noweb}
test -x "$library/markup" || {
  echo "record.sh: no noweb in $library" >&2
  exit 1
}
test $# -gt 0 || set -- *
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
for name; do
  rm -rf "$work/case"
  cp -r "$name" "$work/case"
  (cd "$work/case" && rm -f stdout stderr status why ours.*)
  status=0
  (cd "$work/case" && PATH="$library:/usr/bin:/bin" LC_ALL=C \
    sh -c "$(cat command)" >"$work/out" 2>"$work/err") || status=$?
  cp "$work/out" "$name/stdout"
  cp "$work/err" "$name/stderr"
  echo "$status" >"$name/status"
done
