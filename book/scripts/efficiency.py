#!/usr/bin/env python3
"""Measures in which time pt reaches the error of a peer, and prints a CSV.

usage: efficiency.py [OPTION]... PT PEER SCENE...

A SCENE is as for measure.py, and may end with @ and an albedo other than 0.8.
For each number of samples of the peer there are rounds. In each, one after the
other and on the same processors, come a run of the peer, one of pt with as
many samples as take it a tenth of the peer's time ("tenth"), one with as many
as give it the peer's error ("equal", which a short search finds), and one with
half of those. The order is turned over every other round, and all seeds
differ.

Seconds are those of the whole process, from its start to its end: with all
that is read, built, tried out, learnt and written. The true error of a run is
the root of its mean square difference over all pixels from a reference, less
the variance that the reference itself has. The reference is made once, by the
reference integrator of pt, and kept beside the scene. The claimed error is what
pt says in its report.

Speed-up of "tenth": (MSE x seconds of the peer) / (MSE x seconds of pt).
Speed-up of "equal": seconds of the peer / seconds in which pt reaches the MSE
of the peer's run in that round, from the run with about this MSE by the slope
to the one with half of the samples; if even one sample of a pixel is better
than the peer, the seconds of that. Each is the median over the rounds, and so
are seconds and errors; "lowest" is the lowest "equal" speed-up of a round.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import namedtuple
from statistics import median

from measure import mean_square, radiances, say

SIZE = (320, 240)
SIMILAR = 1.2  # ratio of what is to be about equal
STEPS = 6  # of a search

Run = namedtuple('Run', 'seconds mse claimed')


def contestants(about, budgets):
    """A parser of what is compared in equal time."""
    about, _, _ = about.partition('\n\nCopyright')
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('pt')
    parser.add_argument('peer')
    parser.add_argument('scenes', nargs='+', metavar='SCENE')
    parser.add_argument('--rounds', type=int, default=5, metavar='N')
    parser.add_argument('--budgets', default=budgets, metavar='N,...',
                        help='samples of the peer (default: %(default)s)')
    return parser


def settings():
    parser = contestants(__doc__, '4,16,64,256')
    parser.add_argument('--reference', type=int, default=16384, metavar='N',
                        help='samples of the reference (default: %(default)s)')
    parser.add_argument('--integrator', metavar='NAME',
                        help='of pt (default: the one that it chooses)')
    return parser.parse_args()


def timed(command):
    """The seconds of a process, from its start to its end."""
    began = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True)
    seconds = time.monotonic() - began
    if done.returncode:
        sys.exit(f'bench: {" ".join(command)} failed:\n{done.stderr}')
    return seconds


class Contest:
    """pt and its peer before one scene."""

    def __init__(self, options, scene, folder):
        self.options, self.folder, self.seed = options, folder, 0
        self.path, _, albedo = scene.partition('@')
        self.albedo = albedo or '0.8'
        self.name = os.path.basename(self.path)
        with open(self.path + '.view') as view:
            self.view = view.read().split()
        self.means, self.variance = self.reference()

    def pt(self, n, seed, integrator, image, report):
        chosen = ['--integrator', integrator] if integrator else []
        return timed(
            [self.options.pt, '-i', self.path + '.obj', *self.view,
             '-r', self.albedo, '-d', '{}x{}'.format(*SIZE), '-n', str(n),
             '-s', str(seed), *chosen, '-o', image, '--report', report, '-f'])

    def reference(self):
        """The means of the reference, and its variance."""
        n = self.options.reference
        stem = f'{self.path}@{self.albedo}-reference-{n}'
        image, report = stem + '.pfm', stem + '.json'
        scene = os.path.getmtime(self.path + '.obj')
        if not (os.path.exists(report) and os.path.getmtime(report) > scene):
            say(f'{self.name}, albedo {self.albedo}: the reference')
            partial = [os.path.join(self.folder, os.path.basename(stem) + e)
                       for e in ('.pfm', '.json')]
            known = subprocess.run([self.options.pt, '--help'],
                                   capture_output=True, text=True).stdout
            integrator = 'reference' if '--integrator' in known else None
            self.pt(n, 0, integrator, *partial)
            for made, kept in zip(partial, (image, report)):
                shutil.move(made, kept)
        error = self.claimed(report)
        say(f'{self.name}, albedo {self.albedo}: the error of the reference '
            f'of {n} samples is {error:.3g}')
        return radiances(image, SIZE), error * error

    @staticmethod
    def claimed(report):
        with open(report) as file:
            return json.load(file)['rmse'] or math.nan

    def mse(self, image):
        square = mean_square(radiances(image, SIZE), self.means)
        return max(square - self.variance, 1e-3 * square)

    def ours(self, n):
        self.seed += 1
        image, report = [os.path.join(self.folder, name)
                         for name in ('image.pfm', 'report.json')]
        seconds = self.pt(n, self.seed, self.options.integrator, image, report)
        return Run(seconds, self.mse(image), self.claimed(report))

    def theirs(self, n):
        self.seed += 1
        image = os.path.join(self.folder, 'image.raw')
        camera = [self.view[self.view.index(option) + 1]
                  for option in '-p -t -u -F'.split()]
        seconds = timed(
            [self.options.peer, self.path + '.obj', *camera,
             '{}x{}'.format(*SIZE), str(n), self.albedo, image,
             str(self.seed)])
        return Run(seconds, self.mse(image), math.nan)

    def samples_for_seconds(self, goal):
        """How many samples take pt about so long; at least one."""
        n, before = 1, None
        run = self.ours(n)
        for _ in range(STEPS):
            if run.seconds * SIMILAR > goal:
                break
            slope = run.seconds / n
            if before and run.seconds > before[1].seconds:
                slope = (run.seconds - before[1].seconds) / (n - before[0])
            more = (goal - run.seconds) / slope
            before = n, run
            n = min(math.ceil(n + more), 8 * n)
            run = self.ours(n)
        return n, run

    def samples_for_error(self, goal, n, run, most):
        """How many samples give pt about this MSE; at least one. A run of n
        samples was `run`."""
        for _ in range(STEPS):
            other = min(max(round(n * run.mse / goal), 1), most)
            if goal / SIMILAR < run.mse < goal * SIMILAR or other == n:
                break
            n, run = other, self.ours(other)
        return n

    def rounds(self, budget):
        """The samples of "tenth" and "equal", and rounds of runs."""
        first = self.theirs(budget)
        tenth, run = self.samples_for_seconds(first.seconds / 10)
        equal = self.samples_for_error(first.mse, tenth, run, 8 * budget)
        done = []
        for i in range(self.options.rounds):
            runs = [(self.theirs, budget), (self.ours, tenth),
                    (self.ours, equal), (self.ours, (equal + 1) // 2)]
            turn = 1 - 2 * (i % 2)
            done.append([program(n) for program, n in runs[::turn]][::turn])
            peer, _, same, _ = done[-1]
            say(f'{self.name}, {budget} spp, round {i + 1}: '
                f'{peer.seconds:.2f} s, error {math.sqrt(peer.mse):.3g}; '
                f'{equal} spp: {same.seconds:.2f} s, '
                f'error {math.sqrt(same.mse):.3g}')
        return tenth, equal, done


def seconds_to(goal, run, half):
    """The seconds to an MSE, from a run about there and a shorter one. None of
    the time depends on the MSE, or all of it, at the most."""
    slope = 0.
    if half.mse > run.mse and run.seconds > half.seconds:
        slope = min(math.log(run.seconds / half.seconds)
                    / math.log(half.mse / run.mse), 1.)
    return run.seconds * (run.mse / goal) ** slope


def middle(runs, what, form):
    value = median(getattr(run, what) for run in runs)
    return '' if math.isnan(value) else format(value, form)


def error(runs):
    return format(math.sqrt(median(run.mse for run in runs)), '.3g')


def row(contest, budget):
    tenth, equal, rounds = contest.rounds(budget)
    peers, tenths, equals, _ = zip(*rounds)
    ratios = [p.mse * p.seconds / (t.mse * t.seconds)
              for p, t, *_ in rounds]
    gains = [p.seconds / seconds_to(p.mse, e, half)
             for p, _, e, half in rounds]
    distance = median(e.mse for e in equals) / median(p.mse for p in peers)
    if not 1 / SIMILAR < distance < SIMILAR:
        say(f'{contest.name}, {budget} spp: the MSE of {equal} spp of pt is '
            f'{distance:.2f} times the peer\'s')
    return [contest.name, contest.albedo, budget,
            middle(peers, 'seconds', '.3f'), error(peers),
            equal, middle(equals, 'seconds', '.3f'),
            middle(equals, 'claimed', '.3g'), error(equals),
            f'{median(gains):.2f}', f'{median(ratios):.2f}',
            f'{min(gains):.2f}',
            tenth, middle(tenths, 'seconds', '.3f'),
            middle(tenths, 'claimed', '.3g'), error(tenths),
            f'{math.sqrt(contest.variance):.3g}', len(rounds)]


def main():
    options = settings()
    rounds = options.rounds
    print(f'#, {len(os.sched_getaffinity(0))} threads, '
          f'{"medians" if rounds > 2 else "means"} of {rounds} rounds, '
          f'references of {options.reference} '
          f'samples')
    print('scene,albedo,peer_samples,peer_seconds,peer_error,'
          'equal_samples,equal_seconds,equal_claimed,equal_error,'
          'equal_speedup,tenth_speedup,lowest,'
          'tenth_samples,tenth_seconds,tenth_claimed,tenth_error,'
          'reference_error,rounds')
    with tempfile.TemporaryDirectory() as folder:
        for scene in options.scenes:
            contest = Contest(options, scene, folder)
            for budget in map(int, options.budgets.split(',')):
                print(*row(contest, budget), sep=',', flush=True)


if __name__ == '__main__':
    main()
