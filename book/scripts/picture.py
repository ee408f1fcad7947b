#!/usr/bin/env python3
"""Measures pictures of pt and of a peer with a denoiser in equal time, and
prints a CSV.

usage: picture.py [OPTION]... PT PEER SCENE...

SCENE.obj is a scene, and SCENE.view has the options of pt for its view. The
peer renders a number of samples, with the normals and the albedo of the first
hits, and OIDN denoises its image; then pt gets the time that both took, as
--time. Seconds are those of the whole process, and for OIDN those of its call.

The truth is the mean of two long runs of pt without a filter, which are made
once and kept beside the scene. The mean of the products of the differences
from both is the mean square error, without what they have themselves. It is
taken of radiances and of sRGB levels (0 to 255) at the automatic exposure of
the truth. FLIP (67 pixels a degree) compares the exposed pictures, and keeps
the noise of the truth, whose error in levels is truth_levels. Errors are root
mean squares over the rounds, seconds and FLIP means; rmse, levels and flip are
OIDN's divided by ours.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import os
import tempfile
import time
from importlib.metadata import version

import flip_evaluator
import numpy as np
import OpenEXR
from mitsuba_oidn import denoise

from efficiency import SIZE, contestants, timed
from measure import radiances, say

WIDTH, HEIGHT = SIZE
ALBEDO = 0.8


def settings():
    parser = contestants(__doc__, '4,16,64')
    parser.add_argument('--reference', type=float, default=60, metavar='S',
                        help='seconds of each of the two long runs '
                             '(default: %(default)s)')
    parser.add_argument('--clean-aux', action='store_true',
                        help='tell OIDN that normals and albedo have no noise')
    return parser.parse_args()


def load(path):
    return np.reshape(radiances(path, SIZE), (HEIGHT, WIDTH))


class Contest:
    """pt and its peer before one scene."""

    def __init__(self, options, path, folder):
        self.options, self.path = options, path
        self.image, self.features, self.picture = [
            os.path.join(folder, name)
            for name in ('image.raw', 'features.raw', 'picture.exr')]
        with open(path + '.view') as view:
            self.view = view.read().split()
        self.halves = [self.half(seed) for seed in (91, 92)]
        self.truth = sum(self.halves) / 2
        high = np.quantile(self.truth[self.truth < 1], 0.99)
        self.scale = 0.8 / high  # as pt --exposure auto
        own = np.subtract(*map(self.exposed, self.halves)) / 2
        self.error = 255 * np.sqrt(np.mean(own ** 2))

    def pt(self, seconds, seed, image, *more):
        return timed(
            [self.options.pt, '-i', self.path + '.obj', *self.view,
             '-r', str(ALBEDO), '-d', f'{WIDTH}x{HEIGHT}',
             '--time', f'{seconds:.3f}', '-s', str(seed), '-o', image, '-f',
             *more])

    def half(self, seed):
        """The image of a long run."""
        seconds = self.options.reference
        kept = f'{self.path}-picture-{seconds:g}-{seed}.pfm'
        scene = os.path.getmtime(self.path + '.obj')
        if not (os.path.exists(kept) and os.path.getmtime(kept) > scene):
            say(f'{os.path.basename(self.path)}: a reference')
            self.pt(seconds, seed, kept + '.new.pfm', '--no-filter')
            os.replace(kept + '.new.pfm', kept)
        return load(kept)

    def theirs(self, n, seed):
        """The seconds and the denoised picture of the peer."""
        camera = [self.view[self.view.index(option) + 1]
                  for option in '-p -t -u -F'.split()]
        os.environ['AOV'] = self.features
        seconds = timed(
            [self.options.peer, self.path + '.obj', *camera,
             f'{WIDTH}x{HEIGHT}', str(n), str(ALBEDO), self.image, str(seed)])
        image = load(self.image).astype('f4')
        features = np.fromfile(self.features, 'f4').reshape(HEIGHT, WIDTH, 4)
        normals = np.ascontiguousarray(features[:, :, :3])
        hits = features[:, :, 3]
        albedo = np.repeat((1 - hits + ALBEDO * hits)[:, :, None], 3, 2)
        began = time.monotonic()
        shown = denoise(image, albedo, normals, hdr=True,
                        clean_aux=self.options.clean_aux)
        return seconds + time.monotonic() - began, np.float64(shown)

    def ours(self, seconds, seed):
        """The seconds and the filtered picture of pt."""
        seconds = self.pt(seconds, seed, self.picture)
        file = OpenEXR.File(self.picture, separate_channels=True)
        return seconds, np.float64(file.channels()['filtered.Y'].pixels)

    def exposed(self, picture):
        """What a screen shows, from 0 to 1."""
        x = np.clip(picture * self.scale, 0, 1)
        return np.where(x < 0.0031308, 12.92 * x,
                        1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)

    def errors(self, picture):
        """Mean squares of radiances and of levels, and FLIP."""
        def square(show):
            first, second = [show(picture) - show(it) for it in self.halves]
            return np.mean(first * second)

        def grey(picture):
            shown = self.exposed(picture)[:, :, None]
            return np.repeat(shown, 3, 2).astype('f4')

        flip = flip_evaluator.evaluate(grey(self.truth), grey(picture), 'LDR')
        return [square(lambda it: it), square(self.exposed), flip[1]]

    def row(self, budget):
        rounds = []
        for seed in range(1, self.options.rounds + 1):
            theirs, denoised = self.theirs(budget, seed)
            ours, filtered = self.ours(theirs, seed)
            rounds.append([[theirs, *self.errors(denoised)],
                           [ours, *self.errors(filtered)]])
        means = np.mean(rounds, axis=0)
        means[:, 1:3] = np.sqrt(np.maximum(means[:, 1:3], 1e-12))
        means[:, 2] *= 255
        (theirs, *oidn), (ours, *mine) = means
        ratios = [f'{their / our:.2f}' for their, our in zip(oidn, mine)]
        name = f'{os.path.basename(self.path)}/{budget}'
        return [name, f'{theirs:.2f}', f'{ours:.2f}', *ratios,
                f'{oidn[1]:.2f}', f'{mine[1]:.2f}',
                f'{oidn[2]:.4f}', f'{mine[2]:.4f}', f'{self.error:.2f}']


def main():
    options = settings()
    print(f'#, by make picture-peer, rounds: {options.rounds}, references '
          f'of twice {options.reference:g} s, '
          f'mitsuba-oidn {version("mitsuba-oidn")}')
    print('case,seconds,ours_seconds,rmse,levels,flip,'
          'oidn_levels,ours_levels,oidn_flip,ours_flip,truth_levels')
    denoise(np.zeros((HEIGHT, WIDTH), 'f4'))  # loads its libraries
    with tempfile.TemporaryDirectory() as folder:
        for scene in options.scenes:
            contest = Contest(options, scene, folder)
            for budget in map(int, options.budgets.split(',')):
                print(*contest.row(budget), sep=',', flush=True)


if __name__ == '__main__':
    main()
