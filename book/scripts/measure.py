#!/usr/bin/env python3
"""Measures pt from end to end, beside a peer, and prints a CSV.

usage: measure.py peer PT [PEER] SCENE...   rates, load, memory of both
       measure.py sizes PT [PEER] SCENE...  the same scene in several sizes
       measure.py mixtures PT [PEER] SCENE...  rates and means of mixtures
       measure.py show FILE.csv...          a table for the eye

A SCENE is a path without its ending: SCENE.obj, and SCENE.view with the
options of pt for the view. PEER is a program with the arguments of embree_pt;
it is recognised by its name. Both programs get the same processors and the
same work, one after the other, for some rounds. pt leaves nothing out: what it
does not trace are the cheapest rays, without which its rate could not be
compared. A rate, a time or a memory is the median over the rounds, a ratio the
median of the rounds' ratios. Memory is the peak that the system tells, which
includes the ten megabytes or so of this interpreter's own process before it
became the program.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import itertools
import math
import os
import re
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from statistics import median

WIDTH, HEIGHT, ALBEDO = 400, 300, 0.8
ROUNDS, FEWEST = 7, 3
SMALL, SAMPLES = (200, 150), 64  # images of mixtures of scales
STOPPED = 60  # seconds after which a render of a mixture is stopped
PATIENCE = 60  # seconds for the rounds of one row, if they are enough
RENDERING = 1.5  # seconds that our part of a round should render

PT = re.compile(
    r'mean radiance (?P<mean>[\d.]+)(?: ± (?P<stderr>[\d.]+))?.*\n'
    r'> render +(?P<render>\S+) s, (?P<rays>\d+) rays, .*\n'
    r'> scene +(?P<triangles>\d+) triangles, load (?P<load>\S+) s, '
    r'build (?P<build>\S+) s')
PEER = re.compile(
    r'tris (?P<triangles>\d+) parse (?P<load>\S+) build (?P<build>\S+) '
    r'render (?P<render>\S+) Mrays (?P<megarays>\S+) .*'
    r'mean (?P<mean>\S+) rmse (?P<rmse>\S+)')


def say(text):
    print(f'bench: {text}', file=sys.stderr, flush=True)


def run(command, processors, pattern, pixels, limit):
    """Runs a program on some processors; what it said, and its memory. None
    if there is a limit, in seconds, and it has not ended by then."""
    child = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        preexec_fn=lambda: os.sched_setaffinity(0, processors))
    timer = threading.Timer(limit or threading.TIMEOUT_MAX, child.kill)
    timer.start()
    text = child.stdout.read().decode()
    timer.cancel()
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    if limit and child.returncode == -signal.SIGKILL:
        return None
    found = pattern.search(text)
    if child.returncode != 0 or not found:
        sys.exit(f'bench: {" ".join(command)} failed:\n{text}')
    said = {name: float(value or 'nan')
            for name, value in found.groupdict().items()}
    rays = said.get('rays', said.get('megarays', 0) * 1e6)
    error = said.get('stderr', said.get('rmse', 0) / math.sqrt(pixels))
    return {
        'triangles': int(said['triangles']),
        'mrays': rays / max(said['render'], 1e-3) * 1e-6,
        'render': said['render'],
        'load': said['load'],
        'build': said['build'],
        'load_build': said['load'] + said['build'],
        'megabytes': usage.ru_maxrss * 1024e-6,
        'mean': said['mean'],
        'stderr': error,
    }


class Programs:
    """pt and, perhaps, its peer."""

    def __init__(self, pt, peer, folder):
        self.pt, self.peer, self.folder = pt, peer, folder

    def ours(self, scene, processors, n, seed, definition=(WIDTH, HEIGHT),
             limit=None, out=None):
        view = open(scene + '.view').read().split()
        out = out or os.path.join(self.folder, 'image.pgm')
        return run(
            [self.pt, '--no-shortcuts', '-i', scene + '.obj', *view,
             '-r', str(ALBEDO), '-d', '{}x{}'.format(*definition),
             '--integrator', 'reference',
             '-n', str(n), '-s', str(seed), '-j', str(len(processors)),
             '-o', out, '-f'], processors, PT, math.prod(definition), limit)

    def theirs(self, scene, processors, n, seed, definition=(WIDTH, HEIGHT),
               limit=None, out=None):
        view = open(scene + '.view').read().split()
        p, t, u, fov = (view[view.index(o) + 1] for o in '-p -t -u -F'.split())
        out = out or os.path.join(self.folder, 'image.raw')
        return run(
            [self.peer, scene + '.obj', p, t, u, fov,
             '{}x{}'.format(*definition), str(n), str(ALBEDO), out,
             str(seed)], processors, PEER, math.prod(definition), limit)

    def samples(self, scene, processors):
        """How many make our rendering last long enough to be timed."""
        render = self.ours(scene, processors, 4, 0)['render']
        return max(4, math.ceil(4 * RENDERING / max(render, 1e-3)))

    def rounds(self, scene, threads):
        """Rounds of (ours, theirs), in turns; theirs may be none."""
        processors = sorted(os.sched_getaffinity(0))[:threads]
        n = self.samples(scene, processors)
        began, done = time.monotonic(), []
        programs = [self.ours] + [self.theirs] * bool(self.peer)
        for seed in range(1, ROUNDS + 1):
            pair = [None, None]
            order = list(enumerate(programs))
            for i, program in order if seed % 2 else order[::-1]:
                pair[i] = program(scene, processors, n, seed)
            done.append(pair)
            rates = [f'{run["mrays"]:.2f}' for run in pair if run]
            say(f'{os.path.basename(scene)}, threads: {threads}, {n} spp, '
                f'round {seed}: {" against ".join(rates)} Mrays/s')
            if seed >= FEWEST and time.monotonic() - began > PATIENCE:
                break
        return done


def middle(rounds, who, what):
    return median(pair[who][what] for pair in rounds)


def ratio(rounds, what):
    return median(ours[what] / theirs[what] for ours, theirs in rounds)


def z_score(rounds):
    """Difference of the mean images over all rounds, in standard errors."""
    difference = sum(ours['mean'] - theirs['mean'] for ours, theirs in rounds)
    variance = sum(run['stderr'] ** 2 for pair in rounds for run in pair)
    return difference / math.sqrt(max(variance, 1e-18))


COMPARED = ('mrays', 'load_build', 'megabytes')


def peer_row(programs, scene, threads):
    name, rounds = os.path.basename(scene), programs.rounds(scene, threads)
    ours = [middle(rounds, 0, what) for what in (*COMPARED, 'mean')]
    theirs, ratios, z = [math.nan] * 4, [math.nan] * 3, math.nan
    if programs.peer:
        theirs = [middle(rounds, 1, what) for what in (*COMPARED, 'mean')]
        ratios = [ratio(rounds, what) for what in COMPARED]
        z = z_score(rounds)
        if abs(z) > 4:
            say(f'{name}: the mean images differ by {z:.1f} standard errors')
    rates, times, memories, means = zip(ours, theirs)
    return [name, rounds[0][0]['triangles'], threads,
            *(cell(x, 2) for x in rates), *(cell(x, 3) for x in ratios),
            *(cell(x, 3) for x in times), *(cell(x, 0) for x in memories),
            *(cell(x, 6) for x in means), cell(z, 1), len(rounds)]


def cell(x, digits):
    return '' if math.isnan(x) else f'{x:.{digits}f}'


def peer(programs, scenes):
    print('scene,triangles,threads,ours_mrays,peer_mrays,ratio,'
          'load_build_ratio,memory_ratio,ours_load_build,peer_load_build,'
          'ours_megabytes,peer_megabytes,ours_mean,peer_mean,z,rounds')
    for scene in scenes:
        available = len(os.sched_getaffinity(0))
        for threads in sorted({min(2, available), 1}, reverse=True):
            row = peer_row(programs, scene, threads)
            print(*row, sep=',', flush=True)


def sizes(programs, scenes):
    print('triangles,load_seconds,build_seconds,million_rays_per_second,'
          'peak_megabytes,bytes_per_triangle,peer_million_rays_per_second,'
          'peer_load_build_seconds,peer_megabytes')
    for scene in scenes:
        rounds = programs.rounds(scene, 2)
        triangles = rounds[0][0]['triangles']
        load, build, mrays, peak = (
            middle(rounds, 0, w)
            for w in ('load', 'build', 'mrays', 'megabytes'))
        theirs = [''] * 3
        if programs.peer:
            theirs = [f'{middle(rounds, 1, "mrays"):.2f}',
                      f'{middle(rounds, 1, "load_build"):.3f}',
                      f'{middle(rounds, 1, "megabytes"):.0f}']
        print(triangles, f'{load:.3f}', f'{build:.3f}', f'{mrays:.2f}',
              f'{peak:.0f}', f'{peak * 1e6 / triangles:.0f}', *theirs,
              sep=',', flush=True)


def mixture_runs(programs, scenes):
    """Rounds over all scenes, and in each of them ours and the peer's run in
    turns, so that what the machine does beside meets all alike. A run that
    was stopped is None, and the last one."""
    processors = sorted(os.sched_getaffinity(0))[:2]
    runs = {(scene, program): [] for scene in scenes
            for program in [programs.ours] + [programs.theirs] * bool(
                programs.peer)}
    for seed in range(1, ROUNDS + 1):
        say(f'{os.path.basename(scenes[-1])} and smaller ones, round {seed}')
        for (scene, program), done in list(runs.items())[::seed % 2 * 2 - 1]:
            if None not in done:
                done.append(program(
                    scene, processors, SAMPLES, seed, SMALL, STOPPED))
    return runs


def mixture_cells(runs):
    """Median rate, mean and standard error of the mean."""
    if None in runs or not runs:
        return [f'> {STOPPED} s' if runs else '', '', '']
    rate = median(run['mrays'] for run in runs)
    mean = sum(run['mean'] for run in runs) / len(runs)
    error = math.hypot(*(run['stderr'] for run in runs)) / len(runs)
    return [f'{rate:.2f}', f'{mean:.6f}', f'{error:.6f}']


def mixtures(programs, scenes):
    """The rate of a scene is relative to that of the first of its name."""
    print('mixture,number,ours_mrays,relative,peer_mrays,ours_mean,'
          'ours_stderr,peer_mean,peer_stderr')

    def name(scene):
        return os.path.basename(scene).split('-')[0]

    for _, group in itertools.groupby(scenes, name):
        group = list(group)
        runs = mixture_runs(programs, group)
        for scene in group:
            ours = runs[scene, programs.ours]
            rate, mean, error = mixture_cells(ours)
            theirs = mixture_cells(runs.get((scene, programs.theirs), []))
            relative = cell(math.nan if None in ours else median(
                run['mrays'] / first['mrays']
                for run, first in zip(ours, runs[group[0], programs.ours])), 2)
            print(*os.path.basename(scene).split('-'), rate, relative,
                  theirs[0], mean, error, *theirs[1:], sep=',', flush=True)


def radiances(path, definition):
    """The pixels of our PFM, which begins below, or of the peer's file of
    means and standard errors."""
    data = open(path, 'rb').read()
    if path.endswith('.raw'):
        return struct.unpack(f'{len(data) // 8}d', data)[::2]
    (width, height), n = definition, math.prod(definition)
    pixels = struct.unpack(f'<{n}f', data[-4 * n:])
    return [pixels[(height - 1 - y) * width + x]
            for y in range(height) for x in range(width)]


def mean_square(pixels, reference):
    return sum((a - b) ** 2 for a, b in zip(pixels, reference)) / len(pixels)


def show(path):
    rows = [line.rstrip('\n').split(',')
            for line in open(path) if not line.startswith('#')]
    widths = [max(map(len, column)) for column in zip(*rows)]
    print(f'\n{path}')
    for row in rows:
        print('  '.join(cell.rjust(w) for cell, w in zip(row, widths)))


def main():
    verb, arguments = sys.argv[1:2], sys.argv[2:]
    if verb == ['show']:
        return [show(path) for path in arguments]
    verbs = {'peer': peer, 'sizes': sizes, 'mixtures': mixtures}
    measure = verbs.get(''.join(verb))
    if not measure or not arguments:
        sys.exit(__doc__)
    pt, *scenes = arguments
    rival = None
    if scenes and os.path.basename(scenes[0]).startswith('embree_pt'):
        rival, *scenes = scenes
    with tempfile.TemporaryDirectory() as folder:
        measure(Programs(pt, rival, folder), scenes)


if __name__ == '__main__':
    main()
