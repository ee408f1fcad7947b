#!/usr/bin/env python3
"""Measures what each method of pt gains, beside what a pilot foresees.

usage: choice.py [--rounds N] PT SCENE...

A SCENE is a path without ".obj", beside which lies a ".view" with the options
of the camera; it may end with @ and an albedo other than 0.8. A gain is
(MSE x seconds of the reference) / (MSE x seconds of the method), where seconds
are those of rendering, with all that is tried and learnt, and the MSE is what
pt claims. Each is the median of the rounds, whose seeds differ. The reference
is measured with 64 samples, since neither factor's product depends on them.
Prints a CSV.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import argparse
import json
import os
import re
import subprocess
import tempfile
from statistics import median

BUDGETS = 4, 16, 64


def pt(program, scene, *options):
    path, _, albedo = scene.partition('@')
    with open(path + '.view') as view:
        camera = view.read().split()
    done = subprocess.run(
        [program, '-i', path + '.obj', *camera, '-r', albedo or '0.8',
         '-d', '320x240', *options], capture_output=True, text=True,
        errors='replace', check=True)
    return done.stdout


def cost(options, scene, method, n):
    """Median of the MSE times the seconds."""
    products = []
    for seed in range(options.rounds):
        with tempfile.TemporaryDirectory() as folder:
            report = os.path.join(folder, 'report.json')
            pt(options.pt, scene, '-n', str(n), '-s', str(seed), '-q',
               '--integrator', method, '--report', report,
               '-o', os.path.join(folder, 'image.pfm'))
            with open(report) as file:
                known = json.load(file)
        products.append(known['rmse'] ** 2 * known['render_seconds'])
    return median(products)


def main():
    about, _, _ = __doc__.partition('\n\nCopyright')
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('pt')
    parser.add_argument('scenes', nargs='+', metavar='SCENE')
    parser.add_argument('--rounds', type=int, default=3, metavar='N')
    options = parser.parse_args()
    print('scene,albedo,samples,rays,later,chosen,sobol_foreseen,sobol,'
          'gather_foreseen,gather', flush=True)
    for scene in options.scenes:
        path, _, albedo = scene.partition('@')
        reference = cost(options, scene, 'reference', 64)
        for n in BUDGETS:
            text = pt(options.pt, scene, '-n', str(n), '--dry-run')
            line = re.search('^method +(.*)$', text, re.M)[1]
            chosen, rays, later, sobol, gather = re.match(
                r'(\w+): a path has ([\d.]+) rays, and (\d+) %.*'
                r'sobol ([\d.]+), gather ([\d.]+)', line).groups()
            gains = [reference / cost(options, scene, method, n)
                     for method in ('sobol', 'gather')]
            print(os.path.basename(path), albedo or '0.8', n, rays, later,
                  chosen, sobol, f'{gains[0]:.2f}', gather,
                  f'{gains[1]:.2f}', sep=',', flush=True)


main()
