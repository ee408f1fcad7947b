#!/usr/bin/env python3
"""Predicts how a run scales with the number of its ranks, and prints a CSV.

usage: scaling.py PT_MPI SCENE VIEW...

PT_MPI is the program for MPI, SCENE an OBJ, and VIEW the options of its
camera. On this machine, 1 to 4 ranks of one thread each render it. The cost of
a path comes from the run of one rank; what all cores are worth, from one rank
with as many threads; what rank 0 does for a byte of sums, from two ranks. From
these the time of each number of ranks is predicted, and that
of 1 to 4096 nodes of a cluster of which nothing is measured here: nodes of 64
such threads, on a network of 10 microseconds and 1 GB/s.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import json
import os
import subprocess
import sys
import tempfile

BYTES = 64                 # of the sums of a pixel
TILE = 256                 # pixels
LATENCY, BANDWIDTH = 10e-6, 1e9
NODE = 64                  # threads
STEPS = [1, 2, 3, 4, 6] + [n * 10**k for k in range(3)
                          for n in (10, 16, 25, 40, 63)]
SAMPLES, PIXELS = 1024, [0.3e6, 8e6, 128e6]
RANKS = [1, 2, 3, 4, 16, 64, 256, 1024, 4096]
HERE = (640, 480, 3)       # size and samples of the measured runs
ROUNDS = 3                 # of which the quickest run counts


def pieces(ranks):
    """Into how many a pass is divided, as chapters/mpi.nw has it."""
    left, number = 1., 0
    while left > 1e-12:
        left -= min(left, max(left / (4 * ranks), 1 / (64 * ranks)))
        number += 1
    return number


class Machine:
    """What a pass costs."""

    def __init__(self, path, byte, ranks, threads=1, latency=0., cores=None):
        self.path, self.byte = path, byte
        self.ranks, self.threads, self.latency = ranks, threads, latency
        # Ranks of one machine share its cores; else each has its own.
        self.speed = min(ranks, cores or ranks) * threads
        self.shared = cores is not None
        self.pieces = pieces(ranks)

    def render(self, paths):
        """Seconds, with half of a smallest piece at the end for waiting."""
        seconds = max(paths * self.path / self.speed, TILE * self.path)
        return seconds * (1 + (self.ranks > 1) / 64)

    def collect(self, pixels, samples):
        """Seconds of rank 0 for the sums of a pass."""
        if self.ranks == 1:
            return 0.
        number = min(self.pieces, pixels / TILE * samples)
        others = (self.ranks - 1) / self.ranks
        copies = max(1., number * TILE / pixels)
        return others * (number * self.latency
                         + BYTES * pixels * copies * self.byte)

    def run(self, pixels, samples):
        """Seconds of a run: rank 0 collects while the others render."""
        done, total, busy = 0, 0., 0.
        pace = None
        while done < samples:
            due = min([s for s in STEPS if s > done] + [samples])
            slice_ = max(0.25, 8 * busy)
            more = max(1, int(slice_ / pace)) if pace else 1
            more = min(more, due - done, samples - done)
            render = self.render(pixels * more)
            busy = self.collect(pixels, more)
            if self.shared:
                seconds = render + busy / self.speed
            else:
                seconds = max(render, busy) + 2 * self.latency
            total, done, pace = total + seconds, done + more, seconds / more
        return total

    def owned(self, pixels, samples):
        """The same if ranks keep the sums of their own tiles until the end,
        and tell only errors, along a tree."""
        levels = max(1, (self.ranks - 1).bit_length())
        steps = sum(s < samples for s in STEPS) + 1
        tiles = -(-pixels / TILE // self.ranks)
        total = tiles * TILE * samples * self.path / self.threads
        total += steps * 2 * levels * self.latency
        return total + (self.ranks > 1) * BYTES * pixels * self.byte


def measure(program, scene, view, ranks, threads=1):
    """The report of a run here."""
    width, height, samples = HERE
    with tempfile.TemporaryDirectory() as folder:
        report = os.path.join(folder, 'report.json')
        environment = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT='1',
                           OMPI_ALLOW_RUN_AS_ROOT_CONFIRM='1')
        subprocess.run(
            ['mpirun', '--oversubscribe', '--bind-to', 'none', '-n', str(ranks),
             program, '-q', '-i', scene, *view, '-r', '0.8', '-j', str(threads),
             '-d', f'{width}x{height}', '-n', str(samples),
             '--integrator', 'reference', '-o', os.path.join(folder, 'a.pfm'),
             '--report', report], check=True, env=environment)
        with open(report, encoding='utf-8') as file:
            return json.load(file)


def here(reports, ranks, path, byte, cores):
    """How many times as fast as one rank, measured and predicted, and the
    time in which a rank waits, in per cent."""
    if ranks not in reports:
        return ['--'] * 3
    width, height, samples = HERE
    machine = Machine(path, byte, ranks, cores=cores)
    predicted = machine.run(width * height, samples)
    alone, report = (reports[n]['render_seconds'] for n in (1, ranks))
    shares = reports[ranks].get('ranks', [])
    wait = sum(share['wait_seconds'] for share in shares)
    all_ = wait + sum(share['render_seconds'] for share in shares)
    return [f'{alone / report:.3f}', f'{alone / predicted:.3f}',
            f'{100 * wait / all_:.1f}' if all_ else '--']


def main():
    program, scene, *view = sys.argv[1:]
    width, height, samples = HERE
    pixels = width * height
    kinds = [(1, 1), (2, 1), (3, 1), (4, 1), (1, os.cpu_count())]
    runs = [[measure(program, scene, view, *kind) for kind in kinds]
            for _ in range(ROUNDS)]
    *reports, whole = [min(same, key=lambda report: report['render_seconds'])
                       for same in zip(*runs)]
    reports = dict(enumerate(reports, 1))
    path = reports[1]['render_seconds'] / pixels / samples
    cores = reports[1]['render_seconds'] / whole['render_seconds']
    two = reports[2]['ranks']
    byte = two[0]['collect_seconds'] / two[1]['sent_bytes']
    print(f'#, {1e6 * path:.2f} microseconds for a path on a thread, '
          f'{1e9 * byte:.2f} ns of rank 0 for a byte; '
          f'all cores are worth {cores:.2f}')
    sizes = [f'{size / 1e6:g}{owned}' for size in PIXELS
             for owned in ('', ' owned')]
    print('ranks,measured,predicted,waiting,' + ','.join(sizes))
    for ranks in RANKS:
        row = [ranks, *here(reports, ranks, path, byte, cores)]
        machine = Machine(path, byte + 1 / BANDWIDTH, ranks, NODE, LATENCY)
        for size in PIXELS:
            ideal = size * SAMPLES * path / NODE / ranks
            row += [f'{100 * ideal / machine.run(size, SAMPLES):.1f}',
                    f'{100 * ideal / machine.owned(size, SAMPLES):.1f}']
        print(*row, sep=',')


if __name__ == '__main__':
    main()
