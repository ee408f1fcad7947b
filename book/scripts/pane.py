#!/usr/bin/env python3
"""Compares what panes transmit in pt and in Radiance, and prints a CSV.

usage: pane.py PT

At each angle of incidence a pane of the transmittance 0.88, and that one below
one of 0.5, are above a point that faces the sun. In pt, whose sun has a width,
the value is the irradiance by a sun beside which the sky hardly counts, over
that without a pane. In Radiance it is what rtrace sees along the ray to the
middle of the sun, where all the sky has the radiance 1. The light that two
panes reflect to and fro, which pt leaves out, is cut off by -lr 1; the last
column has it. The status is 1 if a transmittance differs by more than 0.2 %.

rtrace is that of the package pyradiance of PyPI, installed beside this
interpreter.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import csv
import os
import subprocess
import sys
import tempfile
from importlib.metadata import version
from importlib.util import find_spec
from math import cos, radians, sin, sqrt
from pathlib import Path

PYRADIANCE = find_spec('pyradiance').submodule_search_locations[0]
ANGLES = [*range(0, 90, 10), 85]
PANES = {'lower': .88, 'upper': .5}
HEIGHTS = {'lower': .1, 'upper': .2}
SIDE = 100
BEAM = 1e6      # beside a sky that gives 1


def corners(height):
    return [(x * SIDE, y * SIDE, height)
            for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]


def by_pt(pt, panes, angle):
    """The irradiance of the point, over the beam."""
    toward = 0, -sin(radians(angle)), cos(radians(angle))
    # pt wants a surface
    shapes = {'ground': -1, **{name: HEIGHTS[name] for name in panes}}
    lines = []
    for name, height in shapes.items():
        lines.append(f'usemtl {name}')
        lines += ['v {:g} {:g} {:g}'.format(*c) for c in corners(height)]
        lines.append('f -4 -3 -2 -1')
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, 'scene.obj').write_text('\n'.join(lines) + '\n')
        Path(folder, 'points.txt').write_text(
            '0 0 0 {} {} {}\n'.format(*toward))
        subprocess.run(
            [pt, 'scene.obj', '--points=points.txt', '-r0', f'--direct={BEAM}',
             f'--sun=180,{90 - angle}',
             *(f'--glass={name}={PANES[name]}' for name in panes),
             '--integrator=sobol', '-n65536', '-q', '-o', 'values.csv'],
            cwd=folder, check=True)
        with open(Path(folder, 'values.csv')) as file:
            return float(next(csv.DictReader(file))['value']) / BEAM


def transmissivity(straight):
    """What Radiance's glass is called with, by its manual."""
    root = sqrt(.8402528435 + .0072522239 * straight * straight)
    return (root - .9166530661) / .0036261119 / straight


def by_rtrace(panes, angle, reflections):
    """The radiance along a ray."""
    lines = ['void glow bright 0 0 4 1 1 1 0',
             'bright source sky 0 0 4 0 0 1 180']
    for name in panes:
        part = transmissivity(PANES[name])
        lines.append(f'void glass of_{name} 0 0 3 {part} {part} {part}')
        lines.append(f'of_{name} polygon {name} 0 0 12')
        lines += ['{} {} {}'.format(*c) for c in corners(HEIGHTS[name])]
    ray = '0 0 0 0 {} {}\n'.format(-sin(radians(angle)), cos(radians(angle)))
    paths = dict(PATH=f'{PYRADIANCE}/bin:' + os.environ['PATH'],
                 RAYPATH=f'.:{PYRADIANCE}/lib')
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, 'scene.rad').write_text('\n'.join(lines) + '\n')
        with open(Path(folder, 'scene.oct'), 'wb') as octree:
            subprocess.run(['oconv', 'scene.rad'], cwd=folder, stdout=octree,
                           env=os.environ | paths, check=True)
        said = subprocess.run(
            ['rtrace', '-h-', '-w-', '-ab', '0', '-lr', str(reflections),
             '-lw', '1e-12', '-st', '0', 'scene.oct'],
            input=ray.encode(), stdout=subprocess.PIPE, cwd=folder,
            env=os.environ | paths, check=True).stdout
    return float(said.split()[0])


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__.split('\n\n')[1])
    pt = str(Path(sys.argv[1]).resolve())
    print(f'#, by pane.py {sys.argv[1]}, pyradiance {version("pyradiance")}')
    print('angle,pt,rtrace,two panes pt,two panes rtrace,'
          'two panes rtrace reflecting')
    farthest = 0
    for angle in ANGLES:
        row = []
        bare = by_pt(pt, [], angle)
        for panes in ['lower'], ['lower', 'upper']:
            row += [by_pt(pt, panes, angle) / bare,
                    by_rtrace(panes, angle, 1)]
            farthest = max(farthest, abs(row[-2] / row[-1] - 1))
        row.append(by_rtrace(panes, angle, 64))
        print(angle, *(f'{value:.5f}' for value in row), sep=',', flush=True)
    if farthest > .002:
        sys.exit(f'pane.py: a difference is {100 * farthest:.2f} %')


if __name__ == '__main__':
    main()
