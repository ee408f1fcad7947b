#!/usr/bin/env python3
"""Compares pt with Radiance in a room under sun and sky, and prints a CSV.

usage: sun_room.py PT

A room of 4 x 5 x 3 m has a window of 2 x 1.5 m to the south, open or with a
pane of the transmittance 0.88. The sky is type 12 of the CIE, with a sun of
azimuth 170 and altitude 40 degrees that adds 3 on a surface that faces it; the
places are on the floor, on the walls and between. rtrace runs twelve times, with
random numbers of its own, and so long paths that it leaves nothing out. For each
room the CSV has the share of places within three standard errors in percent,
the largest deviation and the root mean square in errors, and by how many percent
Radiance is brighter in the shade, with its error: behind the pane it has what
glass reflects, which pt leaves out.

rtrace is that of the package pyradiance of PyPI, installed beside this
interpreter, with numpy.

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
import time
from importlib.util import find_spec
from math import cos, pi, radians, sin, sqrt

import numpy as np

import cie171

PYRADIANCE = find_spec('pyradiance').submodule_search_locations[0]
ENV = os.environ | dict(PATH=f'{PYRADIANCE}/bin:' + os.environ['PATH'],
                        RAYPATH=f'.:{PYRADIANCE}/lib')
AZIMUTH, ALTITUDE, BEAM, PANE = 170, 40, 3, .88
REPEATS = 12
LEVEL = cos(radians(ALTITUDE))
SUN = (sin(radians(AZIMUTH)) * LEVEL, cos(radians(AZIMUTH)) * LEVEL,
       sin(radians(ALTITUDE)))
QUADS = {
    'floor': [(2, 0, 0, 4, 0, 5)], 'ceiling': [(2, 3, 0, 4, 0, 5)],
    'wall': [(0, 0, 0, 5, 0, 3), (0, 4, 0, 5, 0, 3), (1, 5, 0, 4, 0, 3),
             (1, 0, 0, 4, 0, 1), (1, 0, 0, 4, 2.5, 3), (1, 0, 0, 1, 1, 2.5),
             (1, 0, 3, 4, 1, 2.5)],
    'pane': [(1, 0, 1, 3, 1, 2.5)]}
ALBEDOS = {'floor': .2, 'ceiling': .7, 'wall': .5}
TURNS = [(0, 0, 1), (0, -1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, -1)]
PLACES = [(.2 + .4 * i, .25 + .5 * j, .01, 0, 0, 1)
          for i in range(10) for j in range(10)]
for i in range(5):
    for j in range(4):
        PLACES += [(.01, .5 + i, .4 + .7 * j, 1, 0, 0),
                   (3.99, .5 + i, .4 + .7 * j, -1, 0, 0),
                   (.4 + .8 * i, 4.99, .4 + .7 * j, 0, -1, 0)]
PLACES += [(.4 + .8 * (i % 5), .6 + .55 * (i // 5), 1.3,
            *TURNS[(i + i // 5) % 5]) for i in range(40)]


def sky():
    """The formula of the sky, whose horizontal irradiance is 1, for Radiance."""
    cie171.SUN = 0, -LEVEL, SUN[2]
    whole = cie171.open_irradiance()[11]
    (a, b), (c, d, e) = cie171.GRADATION[4], cie171.INDICATRIX[3]
    x, y, z = SUN
    return (f'raw = Dx*{x!r} + Dy*{y!r} + Dz*{z!r};\n'
            'cosg = if(1 - raw, if(raw + 1, raw, -1), 1);\n'
            'g = acos(cosg); zz = if(Dz - 1e-4, Dz, 1e-4);\n'
            f'skybright = (1 + {a}*exp({b}/zz)) * (1 + {c}*(exp({d}*g) - '
            f'exp({d * pi / 2!r})) + {e}*cosg*cosg) / {whole!r};\n')


def write(folder, names):
    """The room for pt and for Radiance, and the places."""
    obj, rad = [], []
    for name in names:
        if name == 'pane':
            t = (sqrt(.8402528435 + .0072522239 * PANE * PANE)
                 - .9166530661) / .0036261119 / PANE
            rad.append(f'void glass pane 0 0 3 {t} {t} {t}')
        else:
            grey = ' '.join([str(ALBEDOS[name])] * 3)
            rad.append(f'void plastic {name} 0 0 5 {grey} 0 0')
        obj.append(f'usemtl {name}')
        for k, quad in enumerate(QUADS[name]):
            corners = ['%g %g %g' % c for c in cie171.quad(*quad)]
            obj += [f'v {c}' for c in corners] + ['f -4 -3 -2 -1']
            rad.append(f'{name} polygon {name}{k} 0 0 12 ' + ' '.join(corners))
    radiance = BEAM / (pi * sin(radians(.2665)) ** 2)
    rad += ['void brightfunc skyfunc 2 skybright sky.cal 0 0',
            'skyfunc glow skyglow 0 0 4 1 1 1 0',
            'skyglow source sky 0 0 4 0 0 1 180',
            f'void light solar 0 0 3 {radiance} {radiance} {radiance}',
            'solar source sun 0 0 4 {} {} {} .533'.format(*SUN)]
    texts = {'room.obj': obj, 'room.rad': rad, 'sky.cal': [sky()],
             'points.txt': ['%g %g %g %g %g %g' % p for p in PLACES]}
    for file, lines in texts.items():
        with open(f'{folder}/{file}', 'w') as out:
            out.write('\n'.join(lines) + '\n')
    with open(f'{folder}/room.oct', 'wb') as out:
        subprocess.run(['oconv', 'room.rad'], stdout=out, env=ENV, cwd=folder,
                       check=True)


def by_pt(pt, folder, more):
    """Values and errors."""
    subprocess.run([pt, 'room.obj', '--points=points.txt', '-rfloor=.2',
                    '-rceiling=.7', '-rwall=.5', '--sky=cie:12',
                    f'--sun={AZIMUTH},{ALTITUDE}', f'--direct={BEAM}',
                    '-n65536', '-qf', '-opt.csv', *more], cwd=folder, check=True)
    with open(f'{folder}/pt.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    return np.array([[float(r['value']), float(r['stderr'])] for r in rows]).T


def by_rtrace(folder):
    """Values of one run; its random numbers are those of the second."""
    second = int(time.time())
    with open(f'{folder}/points.txt') as given:
        run = subprocess.run(
            'rtrace -h- -w- -I+ -u+ -aa 0 -as 0 -ab 40 -ad 4096 -lw 1.2e-5 '
            '-lr -40 -dj 1 -dt 0 -ds 0 room.oct'.split(), stdin=given, env=ENV,
            cwd=folder, stdout=subprocess.PIPE, check=True)
    while int(time.time()) == second:
        time.sleep(.1)
    return [float(line.split()[0]) for line in run.stdout.decode().splitlines()]


def main(pt):
    pt = os.path.abspath(pt)
    print('room,within,largest z,rms z,brighter,error')
    for room, names in ('open', list(ALBEDOS)), ('glazed', list(QUADS)):
        with tempfile.TemporaryDirectory() as folder:
            write(folder, names)
            more = [f'--glass=pane={PANE}'] if 'pane' in names else []
            ours, stderr = by_pt(pt, folder, more)
            theirs = np.array([by_rtrace(folder) for _ in range(REPEATS)])
        mean = theirs.mean(axis=0)
        apart = np.hypot(theirs.std(axis=0, ddof=1) / sqrt(REPEATS), stderr)
        z = abs(mean - ours) / apart
        shade = ours < .6
        more = 100 * (mean / ours - 1)[shade].mean()
        error = 100 * sqrt(((apart / ours)[shade] ** 2).sum()) / shade.sum()
        print(f'{room},{100 * (z <= 3).mean():.1f},{z.max():.2f},'
              f'{sqrt((z * z).mean()):.2f},{more:.2f},{error:.2f}', flush=True)


if __name__ == '__main__':
    if len(sys.argv) != 2:
        sys.exit('usage: sun_room.py PT')
    main(sys.argv[1])
