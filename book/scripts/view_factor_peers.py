#!/usr/bin/env python3
"""Compares the view factors of pt with those of peers, and prints a CSV.

usage: view_factor_peers.py [OPTION]... PT TASK...

TASK polygons: random scenes of two polygons with a third one between them. The
reference is pyviewfactor's contour integral of what the first polygon sees of
the second, from which those of the shadow are taken that the third one casts
from the middle of each of small cells of the first. What a plane cuts off, and
shadows, are cut off here: pyviewfactor's own test of obstruction is one ray
for two cells. Two sizes of cells give a better value and its error; that of
the contour integral is 1e-12. Deviations have Student's distribution and are
mapped to the normal one; the sum of their squares is chi squared. If its
p-value is below 0.001, the status is 1.

TASK raystrack: variance in equal time, in a town of 1000 faces. Raystrack is
asked for one row after the other, which is its fastest way; its hierarchy,
tables and compiled functions are ready before its time begins. pt gets as many
samples, a power of two, as take it, from its start to its end, at most the
"whole" time of raystrack's calls, or that in which it has "traced" rays.
Raystrack makes one replicate, which has the least variance, but tells no
error. A variance is the mean over all pairs of faces of that over runs with
different seeds. A disagreement is the square of the difference of two means
over its expectation, summed over entries; if it is above 1.5, the status is 1.

TASK town: seconds and peak memory of pt in a town of 22176 faces. It comes
first, because the memory of a process is at least what this one had before.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import argparse
import csv
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from itertools import combinations, product

import numpy as np

CELLS = 64  # along an edge
DEFAULTS = {'scenes': 500, 'samples': 1 << 18,  # of polygons
            'rounds': 2,  # of raystrack
            'threads': 2}
RAYS = 1 << 12, 1 << 15  # of raystrack, from a face
PACKAGES = 'numpy numba pyviewfactor raystrack'.split()


def settings():
    parser = argparse.ArgumentParser(
        description=__doc__.partition('\n\nCopyright')[0],
        formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('pt')
    parser.add_argument('tasks', nargs='+', metavar='TASK', choices=TASKS)
    for name, default in DEFAULTS.items():
        parser.add_argument('--' + name, type=int, default=default,
                            metavar='N', help='default: %(default)s')
    return parser.parse_args()


def say(task, **values):
    """Prints rows; a name has underscores for blanks."""
    for name, value in values.items():
        print(f'{task}: {name.replace("_", " ")},{float(value):.6g}',
              flush=True)


def town(nx, ny, seed=1):
    """The faces of a town of nx times ny blocks, one apart: quads that face
    outwards, of areas 1/4 to 1. There is no ground beneath a block."""
    rng, faces = np.random.default_rng(seed), []

    def quad(origin, u, v):
        faces.append(origin + np.array([0 * u, u, u + v, v]))

    for x, y in product(range(2 * nx + 1), range(2 * ny + 1)):
        origin, along, across = np.array([x, y, 0.]), *np.eye(3)[:2]
        if not (x % 2 and y % 2):
            for i, j in product((0, 0.5), (0, 0.5)):
                quad(origin + (i, j, 0), along / 2, across / 2)
            continue
        storey = np.array([0, 0, rng.integers(2, 9) / 8])
        for _ in range(4):
            for level in range(3):
                quad(origin + level * storey, along, storey)
            origin, along, across = origin + along, across, -along
        quad(origin + 3 * storey, along, across)
    return faces


class Ours:
    """Runs of pt."""

    def __init__(self, options, folder):
        self.pt, self.threads = options.pt, options.threads
        self.scene = os.path.join(folder, 'scene.obj')
        self.out = os.path.join(folder, 'factors.csv')
        self.write([np.eye(3)])
        self.run(64)  # ends this program if there is no such option

    def write(self, faces):
        """Writes a scene of faces, which are arrays of corners."""
        self.count = len(faces)
        with open(self.scene, 'w') as out:
            for corners in faces:
                for corner in corners:
                    print('v', *(f'{x:.9g}' for x in corner), file=out)
                print('f', *range(-len(corners), 0), file=out)

    def run(self, n, seed=1, more=()):
        """Computes factors: seconds and peak megabytes."""
        words = (self.pt, self.scene, '--faces', '--view-factors', 'faces',
                 '-n', n, '-s', seed, '-j', self.threads, '-f', '-o', self.out,
                 *more)
        began = time.monotonic()
        done = subprocess.run([str(it) for it in words], text=True,
                              capture_output=True)
        seconds = time.monotonic() - began
        if done.returncode:
            sys.exit('view_factor_peers: pt --view-factors faces: '
                     + done.stderr.partition('\n')[0])
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return seconds, usage.ru_maxrss * 1024e-6

    def factors(self):
        """Those of the last run, and their standard errors: rows of faces,
        the sky and the ground."""
        column = {str(i + 1): i for i in range(self.count)}
        column |= {'sky': self.count, 'ground': self.count + 1}
        found = np.zeros((2, self.count, self.count + 2))
        with open(self.out) as file:
            for row in csv.DictReader(it for it in file if it[0] != '#'):
                found[:, column[row['row']], column[row['column']]] = float(
                    row['factor']), float(row['stderr'])
        return found


def normal_of(corners):
    return np.cross(corners[1] - corners[0], corners[2] - corners[0])


def polygon(rng, centre, radius):
    """A convex polygon of three or four corners on an ellipse."""
    gaps = np.zeros(1)
    while gaps.min() < 0.4:
        angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 5)))
        gaps = np.diff(angles, append=angles[0] + 2 * np.pi)
    u, v = np.linalg.qr(rng.normal(size=(3, 2)))[0].T * radius
    corners = centre + np.outer(np.cos(angles), u) + np.outer(
        np.sin(angles), rng.uniform(0.6, 1) * v)
    return np.float64(np.float32(corners))


def meet(p, q):
    """Whether convex polygons do."""
    from scipy.optimize import linprog
    sums = [[*it, 1, 0] for it in p] + [[*-it, 0, 1] for it in q]
    return linprog(np.zeros(len(sums)), A_eq=np.transpose(sums),
                   b_eq=[0, 0, 0, 1, 1]).status == 0


def polygons(rng):
    """Three polygons that do not meet, the third one between."""
    while True:
        radii = rng.uniform((0.7, 0.7, 0.3), (1.2, 1.2, 0.8))
        second = rng.normal(size=3)
        second *= rng.uniform(0.5, 1.8) / np.linalg.norm(second)
        third = rng.uniform(0.3, 0.7) * second + rng.uniform(-0.3, 0.3, 3)
        scene = [polygon(rng, *it)
                 for it in zip((np.zeros(3), second, third), radii)]
        if not any(meet(*pair) for pair in combinations(scene, 2)):
            return scene


def cells(corners, n):
    """Triangles that fill a convex polygon, n along an edge."""
    found = []
    for b, c in zip(corners[1:], corners[2:]):
        u, v = (b - corners[0]) / n, (c - corners[0]) / n
        for i, j in product(range(n), range(n)):
            p = corners[0] + i * u + j * v
            found += [[p, p + u, p + v]] * (i + j < n)
            found += [[p + u, p + u + v, p + v]] * (i + j < n - 1)
    return np.array(found)


def contours():
    """A function of a scene and cells along an edge: the factor from its first
    polygon to the second, the hidden share, and the error of the factor."""
    from numba import njit
    from pyviewfactor import compute_viewfactor_sa30 as integral

    @njit
    def clip(corners, point, normal):
        """The part of a convex polygon on the side of the normal."""
        kept, count = np.empty((2 * len(corners), 3)), 0
        for i in range(len(corners)):
            a, b = corners[i], corners[(i + 1) % len(corners)]
            height, next_height = (a - point) @ normal, (b - point) @ normal
            if height >= 0:
                kept[count] = a
                count += 1
            if height * next_height < 0:
                kept[count] = a + (b - a) * (height / (height - next_height))
                count += 1
        return kept[:count]

    @njit
    def shaded(pieces, between, target):
        """From all pieces to what is hidden of the target; area times
        factor."""
        total, centre = 0., between.sum(0) / len(between)
        for piece in pieces:
            eye, shadow = piece.sum(0) / 3, target.copy()
            for i in range(len(between)):
                a, b = between[i], between[(i + 1) % len(between)]
                normal = np.cross(a - eye, b - eye)
                shadow = clip(shadow, eye,
                              normal * np.sign(normal @ (centre - eye)))
            if len(shadow) > 2:
                total += integral(shadow, piece, 4 * np.pi)
        return total

    def factor(scene, n):
        first, second, third = scene
        sums = np.zeros(3)
        target, between = (clip(it, first[0], normal_of(first))
                           for it in (second, third))
        for side in (1, -1):  # parts that see the front or back of the target
            part, middle = (clip(it, second[0], side * normal_of(second))
                            for it in (first, between))
            if min(len(part), len(target)) < 3:
                continue
            seen = np.ascontiguousarray(target[::side])
            whole = integral(seen, part, 4 * np.pi)
            rough, fine = [shaded(cells(part, k), middle, seen)
                           for k in (n // 2, n)] if len(middle) > 2 else (0, 0)
            sums += whole, fine + (fine - rough) / 3, abs(fine - rough)
        area = np.linalg.norm(sum(map(normal_of, cells(first, 1)))) / 2
        whole, hidden, error = sums / area
        return whole - hidden, hidden / (whole or 1), error

    return factor


def compare_polygons(options, ours):
    """Whether chi squared is as it should be."""
    from scipy import stats
    factor, rows, seed = contours(), [], 0
    while len(rows) < options.scenes:
        seed += 1
        scene = polygons(np.random.default_rng(seed))
        value, share, _ = factor(scene, 8)
        if value > 0.01 and 0.05 < share < 0.95:  # a part is hidden
            ours.write(scene)
            ours.run(options.samples, seed)
            rows.append([*factor(scene, CELLS), *ours.factors()[:, 0, 1]])
    value, share, own, mean, error = np.transpose(rows)
    # pt's nets have up to 4096 samples, and there are at least 32
    nets = options.samples >> (options.samples // 32).bit_length() - 1
    nets = max(nets, options.samples >> 12)
    t = (mean - value) / np.hypot(error, own)
    z = np.sign(t) * stats.norm.isf(stats.t.sf(abs(t), nets - 1))
    p = stats.chi2.sf(z @ z, len(z))
    say('polygons', scenes=len(z), samples=options.samples, replicates=nets,
        chi_squared=z @ z, p=p, largest_deviation=max(abs(z)),
        sum_of_deviations_over_its_expectation=z.sum() / len(z) ** 0.5,
        mean_factor=np.mean(value), mean_hidden_share=np.mean(share),
        mean_standard_error=np.mean(error),
        mean_error_of_reference=np.mean(own),
        largest_error_of_reference=max(own))
    return p >= 1e-3


def raystrack_runs(options, faces, rays):
    """A function of a seed: whole seconds, seconds of tracing, and factors."""
    import numba
    import raystrack as it
    from raystrack.backends.workspaces import _CpuWorkspace as Workspace
    numba.set_num_threads(options.threads)
    plain, traced = Workspace.trace_many, []

    def trace_many(*words, **named):
        began = time.monotonic()
        done = plain(*words, **named)
        traced.append(time.monotonic() - began)
        return done

    def run(seed, last=None):
        # A face of area 1 or less has 16 cells, the fewest; the numbers of
        # rows are added to seeds
        chosen = it.SolveOptions(
            it.Sampling(density=16, rays_per_cell=rays // 16,
                        seed=seed * 1000003),
            it.Accuracy(max_replicates=1, min_replicates=1),
            batch_size=rays)
        traced.clear()
        began = time.monotonic()
        rows = [solver.solve(
            it.Query.row(name, sky='merged', receiver_sides=('front',)),
            chosen).dense()[0] for name in solver.scene.surface_ids[:last]]
        seconds = time.monotonic() - began
        # The last column is that of backs, and of nothing else
        return seconds, sum(traced), np.array(rows)[:, :-1]

    Workspace.trace_many = trace_many
    solver = it.Solver(it.Scene.from_meshes({
        str(i): it.Mesh(corners, [[0, 1, 2], [0, 2, 3]])
        for i, corners in enumerate(faces)}), device='cpu', auto_tune=False)
    run(0, last=1)  # compiles, and makes hierarchy and tables
    return run


def compare_raystrack(options, ours):
    """Whether the means are the same."""
    faces = town(6, 6)
    count, agree, seeds = len(faces), True, range(1, options.rounds + 1)
    ours.write(faces)
    for rays in RAYS:
        *seconds, theirs = zip(*map(raystrack_runs(options, faces, rays),
                                    seeds))
        theirs_each = np.var(theirs, axis=0, ddof=1)
        theirs_variance = theirs_each[:, :count].mean()
        say(f'raystrack with {rays} rays', variance=theirs_variance)
        whole, traced = map(np.median, seconds)
        for name, limit, more in (('whole', whole, ()),
                                  ('whole closed', whole, ['--closed']),
                                  ('traced', traced, ())):
            task = f'{rays} rays in {name} time'
            agree &= compare_at(options, ours, task, limit, more, seeds,
                                (theirs, theirs_each))
    return agree


def compare_at(options, ours, task, limit, more, seeds, others):
    """Whether the means are the same if ours take so many seconds."""
    (theirs, theirs_each), count = others, ours.count
    trial = 2048
    n = int(0.95 * trial * limit / ours.run(trial, 0, more)[0])
    taken, found = [], []
    for seed in seeds:
        taken.append(ours.run(n, seed, more)[0])
        found.append(ours.factors()[0])
    each = np.var(found, axis=0, ddof=1)
    variance, agree = each[:, :count].mean(), True
    say(task, seconds=limit, samples=n,
        ours_seconds=np.median(taken), ours_variance=variance,
        ratio_of_variances=theirs_each[:, :count].mean() / variance)
    if not more:
        gap = (np.mean(theirs, axis=0) - np.mean(found, axis=0)) ** 2
        for name, part in (('faces', np.s_[:, :count]),
                           ('sky and ground', np.s_[:, count:])):
            ratio = options.rounds * gap[part].sum() / (
                each + theirs_each)[part].sum()
            say(task, **{f'disagreement of {name}': ratio})
            agree &= ratio < 1.5
    return agree


def time_town(options, ours):
    ours.write(town(28, 31))
    seconds, megabytes = ours.run(4096)
    with open(ours.out) as file:
        entries = sum(1 for _ in file) - 1
    say('town', faces=ours.count, samples=4096, seconds=seconds,
        peak_megabytes=megabytes, entries=entries,
        megabytes_of_CSV=os.path.getsize(ours.out) / 1e6)
    return True


TASKS = {'polygons': compare_polygons, 'raystrack': compare_raystrack,
         'town': time_town}


def main():
    options = settings()
    if not shutil.which(options.pt):
        sys.exit(f'view_factor_peers: there is no {options.pt}')
    with tempfile.TemporaryDirectory() as folder:
        ours = Ours(options, folder)
        print('#, by view_factor_peers.py', *sys.argv[1:], end=', ')
        print(*(f'{it} {version(it)}' for it in PACKAGES), sep=', ')
        print('what,value')
        good = [TASKS[it](options, ours)
                for it in sorted(options.tasks, reverse=True)]
    sys.exit(not all(good))


if __name__ == '__main__':
    main()
