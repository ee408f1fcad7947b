#!/bin/sh
# Renders one run as the tasks of a Slurm array job, each a range of samples:
#
#     run="doc/cluster/slurm.sh 65536 scene.obj -d 3840x2160"
#     first=$(sbatch --parsable $run)
#     sbatch --dependency=afterok:$first --array=0-63 $run
#     ptimg merge part-*.litpt -o whole.litpt
#     pt --resume whole.litpt -o image.exr -o image.png --report image.html
#
# The first job, which is no array, learns what all tasks take; without it each
# learns by itself. The first argument is the number of samples of each pixel,
# the others are those of pt. A task that is ended, by its limit of time or for
# another job, has saved its state, and goes on from there when it is queued
# again: by "scontrol requeue JOB_TASK", or by the same sbatch, which ends at
# once where nothing is left to do.
#
# Copyright (C) 2026 litpt contributors
# Copying and distribution of this file, with or without modification, are
# permitted in any medium without royalty provided the copyright notice and
# this notice are preserved. This file is offered as-is, without any warranty.
#SBATCH --job-name=pt
#SBATCH --cpus-per-task=8
#SBATCH --time=4:00:00
#SBATCH --signal=B:USR1@60
#SBATCH --requeue
#SBATCH --open-mode=append
set -eu
n=$1
shift
state=part-${SLURM_ARRAY_TASK_ID-learnt}.litpt
if test -e "$state"; then
    exec pt --resume "$state" -q
fi
set -- "$@" -n "$n" -j "$SLURM_CPUS_PER_TASK" -o "$state" -q
if test -z "${SLURM_ARRAY_TASK_ID-}"; then
    exec pt "$@" --samples 0..0
fi
if test -e part-learnt.litpt; then
    set -- "$@" --cache part-learnt.litpt
fi
parts=$SLURM_ARRAY_TASK_COUNT
k=$((SLURM_ARRAY_TASK_ID - SLURM_ARRAY_TASK_MIN))
exec pt "$@" --samples $((n * k / parts))..$((n * (k + 1) / parts))
