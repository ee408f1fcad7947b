#!/bin/sh
# Renders one run on several machines by GNU parallel over ssh, and merges the
# parts here:
#
#     doc/cluster/parallel.sh hosts 32 4096 scene.obj image.exr -d 1920x1080
#
# The file "hosts" has a machine on each line, as parallel's --sshloginfile
# has it; a line ":" is this machine. The run has 4096 samples of each pixel
# in 32 parts; several parts for each machine let the quick ones do more. The
# scene is copied to each machine, and needs a name without a directory. What a
# gather learns is learnt here, before all parts, and copied, too. pt has to be
# installed there. What follows the image are options of pt.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
set -eu
hosts=$1 parts=$2 n=$3 scene=$4 image=$5
shift 5
learnt=part-learnt.litpt
pt "$scene" "$@" -n "$n" --samples 0..0 -o "$learnt" -f -q
for k in $(seq "$parts"); do
    echo "$k $((n * (k - 1) / parts)) $((n * k / parts))"
done |
    parallel --quote --sshloginfile "$hosts" --jobs 1 --retries 3 \
        --colsep ' ' --basefile "$scene" --basefile "$learnt" \
        --return 'part-{1}.litpt' --cleanup --halt soon,fail=1 \
        pt "$scene" "$@" -n "$n" --samples '{2}..{3}' --cache "$learnt" \
        -o 'part-{1}.litpt' -f -q
seq "$parts" | sed 's/.*/part-&.litpt/' |
    xargs ptimg merge -f -o whole.litpt "$learnt"
pt --resume whole.litpt "$scene" -o "$image" -q
