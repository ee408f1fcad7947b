#!/usr/bin/env python3
"""Checks pt against the analytic daylight cases of CIE 171:2006.

usage: cie171.py scene CASE VARIANT FOLDER
       cie171.py check PT [CASE...]

A black room of 4 x 4 x 3 m without thickness of walls, with an opening in its
roof or its southern facade, under the sixteen skies of CIE S 011; the sun, due
south and 60 degrees high, is left out. "scene" writes what pt needs; "check"
runs pt for each scene, with a multiple of 64 replicates of 4096 samples, and
compares its values with quadratures written for this. It prints, for each
case, the root mean square of the stated relative errors, by how many standard
errors values differ, and by how much the numbers that the standard prints
differ from the quadrature, in percent of the irradiance of a horizontal
surface in the open. It fails if a value is farther off than the largest of so
many would be by chance in 1 of 100 runs.

The samples of a case are as many as make the stated errors 0.1 % of the
values. Values below 1 % of the irradiance in the open are left out of that
mean, since their errors alone would take most of the time; they are checked
like all others.

The masks of 5.13 and 5.14 are taken as diffuse, lit by the sky and a glowing
ground. The 6 mm of clear glass in 5.10 and 5.12 are a plane pane of the index
1.52 that transmits 0.88 of light that meets it straight.

Printed values are those transcribed in github.com/jjathompson4/CyclesCIEtest
(engine/cie171, commit e006a473); of 5.7 those of its correction in the
validation of Iray (NVIDIA 2016).

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import csv
import math
import subprocess
import sys
import tempfile
from collections import Counter
from functools import cache
from math import acos, atan, exp, pi, sqrt
from multiprocessing import Pool
from pathlib import Path

PRINTED = Path(__file__).resolve().parents[1] / 'cie171.txt'
SUN = (0, -.5, sqrt(.75))
GROUND = .3             # its albedo
MASK = {'5.13': .3, '5.14': .5}     # what comes nearest to the tables
INDEX, STRAIGHT = 1.52, .88     # of the pane, and what it transmits straight
TYPES = range(1, 17)
# Skies 1 to 15: a, b of the gradation, c, d, e of the indicatrix.
GRADATION = [(4, -.7), (1.1, -.8), (0, -1), (-1, -.55), (-1, -.32), (-1, -.15)]
INDICATRIX = [(0, -1, 0), (2, -1.5, .15), (5, -2.5, .3), (10, -3, .45),
              (16, -3, .3), (24, -2.8, .15)]
GROUPS = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2), (2, 3),
          (3, 1), (3, 2), (3, 3), (4, 3), (4, 4), (5, 4), (5, 5)]
# Of each case its variants, and their samples in units of 64 times 4096.
VARIANTS = {'5.6': {'4x4': 1}, '5.7': {'box': 2},
            '5.9': {'1x1': 11, '4x4': 1}, '5.10': {'1x1': 8, '4x4': 1},
            '5.11': {'2x1': 5, '4x3': 1}, '5.12': {'2x1': 5, '4x3': 1},
            '5.13': {'0.5': 6, '1': 6, '2': 11},
            '5.14': {'3': 7, '6': 10, '9': 11}}
REPLICATES, TOGETHER = 64, 4096
ROOF, GLAZED = ('5.9', '5.10'), ('5.10', '5.12')
NAMES = [*'ABCDEFGHIJKLMN', *(name + "'" for name in 'GHIJKLMN')]
HEIGHTS = [2.75 - .5 * i for i in range(6)]
DEPTHS = [3.75 - .5 * i for i in range(8)]      # from the facade, or south
GAUSS = [(-.9602898564975363, .1012285362903763),
         (-.7966664774136267, .2223810344533745),
         (-.5255324099163290, .3137066458778873),
         (-.1834346424956498, .3626837833783620)]
GAUSS += [(-x, w) for x, w in reversed(GAUSS)]


def relative(x, y, z):
    """Luminances of the sixteen skies in a direction above the horizon."""
    z = max(z, 1e-99)
    cosine = min(1, max(-1, x * SUN[0] + y * SUN[1] + z * SUN[2]))
    angle = acos(cosine)
    up = [1 + a * exp(b / z) for a, b in GRADATION]
    around = [1 + c * (exp(d * angle) - exp(d * pi / 2)) + e * cosine * cosine
              for c, d, e in INDICATRIX]
    return [up[i] * around[j] for i, j in GROUPS] + [(1 + 2 * z) / 3]


def rule(f, x0, x1, y0, y1):
    """The integral of a vector over a rectangle, by 8 x 8 points."""
    a, b, c, d = (x1 - x0) / 2, (x1 + x0) / 2, (y1 - y0) / 2, (y1 + y0) / 2
    total = None
    for s, v in GAUSS:
        for t, w in GAUSS:
            w *= v * a * c
            value = [w * u for u in f(b + s * a, d + t * c)]
            total = value if total is None else [
                p + q for p, q in zip(total, value)]
    return total


def integral(f, x0, x1, y0, y1, tolerance=1e-7):
    """The same, refined until quarters agree with the whole."""
    if x1 <= x0 or y1 <= y0:
        return [0] * 16
    whole = rule(f, x0, x1, y0, y1)
    scale = [tolerance * abs(u) for u in whole]
    total, todo = [0] * len(whole), [(x0, x1, y0, y1, whole)]
    while todo:
        x0, x1, y0, y1, whole = todo.pop()
        x, y = (x0 + x1) / 2, (y0 + y1) / 2
        quarters = [(*q, rule(f, *q)) for q in (
            (x0, x, y0, y), (x, x1, y0, y), (x0, x, y, y1), (x, x1, y, y1))]
        finer = [sum(u) for u in zip(*(q[4] for q in quarters))]
        if all(abs(u - v) <= s for u, v, s in zip(finer, whole, scale)):
            total = [u + v for u, v in zip(total, finer)]
        else:
            todo += quarters
    return total


def hemisphere(f, *azimuths):
    """The integral of f(x, y, z) over azimuths above the horizon."""
    def polar(azimuth, altitude):
        z, r = math.sin(altitude), math.cos(altitude)
        x, y = r * math.sin(azimuth), r * math.cos(azimuth)
        return [r * u for u in f(x, y, z)]
    parts = [integral(polar, azimuths[i], azimuths[i + 1], low, low + pi / 6,
                      1e-9)
             for i in range(len(azimuths) - 1) for low in (0, pi / 6, pi / 3)]
    return [sum(u) for u in zip(*parts)]


@cache
def open_irradiance():
    """Irradiances of a horizontal surface in the open; by symmetry, halves."""
    half = hemisphere(lambda x, y, z: [z * u for u in relative(x, y, z)],
                      0, pi / 2, pi)
    return [2 * u for u in half]


@cache
def north_irradiance():
    """Irradiances of a wall that faces north, by a sky that gives 1."""
    half = hemisphere(lambda x, y, z: [y * u for u in sky(x, y, z)], 0, pi / 2)
    return [2 * u for u in half]


def sky(x, y, z):
    """Radiances, in units of the irradiance in the open."""
    return [u / e for u, e in zip(relative(x, y, z), open_irradiance())]


def opening(case, variant):
    """Its axis and place, and its ends in the other two axes."""
    if case == '5.6':
        return 2, 0, 0, 4, 0, 4
    if case == '5.7':
        return 1, 0, 0, 4, 0, 3
    if case in ROOF:
        low, high = (1.5, 2.5) if variant == '1x1' else (0, 4)
        return 2, 3, low, high, low, high
    return (1, 0, 0, 4, 0, 3) if variant == '4x3' else (1, 0, 1, 3, 1, 2)


def points(case):
    """Names, places and normals."""
    wall = [((2, 4, z), (0, -1, 0)) for z in HEIGHTS]
    floor = [((2, y, 0), (0, 0, 1)) for y in DEPTHS]
    top = [((2, y, 3), (0, 0, -1)) for y in DEPTHS]
    if case == '5.6':
        return list(zip('BCDEFGHIJKLMN', wall[4::-1] + top))
    if case == '5.7':
        return list(zip('ABCDEFGHIJK', wall + floor[:5]))
    if case in ('5.13', '5.14'):
        return list(zip('ABCDEFGH', floor))
    has_top = case in ('5.11', '5.12')
    return list(zip(NAMES, wall + floor + (top if has_top else [])))


def corner(distance, length, height=3):
    """Configuration factor of half of a wall that touches the receiver."""
    slant = sqrt(distance * distance + height * height)
    return (atan(length / distance) - distance / slant
            * atan(length / slant)) / (2 * pi)


def overhang(x, y):
    """Radiances below 5.13's mask: it sees the ground beside the facade."""
    wall = corner(-y, 100 + x) + corner(-y, 104 - x)
    return [MASK['5.13'] * GROUND * (1 - wall) / pi] * 16


def wall_radiance(x, z):
    """Radiances of 5.14's mask: the sky and the ground less the building."""
    def seen(axis, place, normal):
        def f(u, v):
            at = [(place, u, v), (u, place, v), (u, v, place)][axis]
            d = at[0] - x, at[1] + 6, at[2] - z
            r = sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
            w = d[1] * abs(d[axis]) / r ** 4 * normal
            back = (sky(*(c / r for c in d)) if d[2] > 0
                    else [GROUND / pi] * 16)
            return [w * b for b in back]
        return f
    level = min(3, max(0, z))
    faces = [(1, 0, 0, 4)]
    faces += [(0, 0, 0, 4)] if x < 0 else [(0, 4, 0, 4)] if x > 4 else []
    parts = [rule(seen(axis, place, 1), low, high, *ends)
             for axis, place, low, high in faces
             for ends in ((0, level), (level, 3)) if ends[0] < ends[1]]
    if z > 3:
        parts.append(rule(seen(2, 3, 1), 0, 4, 0, 4))
    hidden = [sum(u) for u in zip(*parts)]
    return [MASK['5.14'] / pi * (e + GROUND / 2 - h)
            for e, h in zip(north_irradiance(), hidden)]


def cuts(case, variant, at):
    """Where the view through the opening changes: in u, and in v."""
    if case in ('5.6', *ROOF):
        return [], [at[1] + (3 - at[2]) * SUN[1] / SUN[2]]      # the sun
    p, us, vs = at[1], [], [at[2], at[2] - at[1] * SUN[2] / SUN[1]]
    if case == '5.7':
        vs += [at[2] + (1 - at[2]) * p / (p - y) for y in (1.3, 1.5)]
    if case == '5.13':
        vs += [3 * p / (p + float(variant))]
    if case == '5.14':
        us = [2 - 2 * p / (p + 6), 2 + 2 * p / (p + 6)]
        vs += [3 * p / (p + 6), float(variant) * p / (p + 6)]
    return us, vs


def through(angle, crossing):
    """What a pane transmits at an angle that is not 0, by Fresnel's laws."""
    inner = math.asin(math.sin(angle) / INDEX)
    kept = crossing ** (1 / math.cos(inner))
    sides = [(f(angle - inner) / f(angle + inner)) ** 2
             for f in (math.sin, math.tan)]
    return sum((1 - r) ** 2 * kept / (1 - (r * kept) ** 2) for r in sides) / 2


@cache
def kept_straight():
    """What glass does not absorb of light that crosses it straight."""
    low, high = 0, 1
    while high - low > 1e-15:
        middle = (low + high) / 2
        is_dark = through(1e-4, middle) < STRAIGHT
        low, high = (middle, high) if is_dark else (low, middle)
    return high


def radiances(case, variant, at, d):
    """What is seen in the direction d through the opening."""
    if case in ('5.6', '5.7'):
        shut = case == '5.7' and any(
            at[2] + d[2] * (y - at[1]) / d[1] < 1 for y in (1.3, 1.5))
        return [0 if shut else 1 / pi] * 16
    if d[2] <= 0:
        return [GROUND / pi] * 16
    if case == '5.13':
        t = 3 / d[2]
        y = at[1] + t * d[1]
        if y > -float(variant):
            return overhang(at[0] + t * d[0], y)
    if case == '5.14':
        t = -(at[1] + 6) / d[1]
        z = at[2] + t * d[2]
        if z < float(variant):
            return wall_radiance(at[0] + t * d[0], z)
    return sky(*d)


def exact(case, variant, at, normal):
    """The irradiances at a point by the sixteen skies, in percent."""
    axis, place, *ends = opening(case, variant)

    def f(u, v):
        spot = (u, place, v) if axis == 1 else (u, v, place)
        d = [b - a for a, b in zip(at, spot)]
        r = sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
        d = [c / r for c in d]
        w = sum(a * b for a, b in zip(d, normal)) * abs(d[axis]) / (r * r)
        if w <= 0:
            return [0] * 16
        if case in GLAZED:
            w *= through(max(1e-4, acos(min(1, abs(d[axis])))),
                         kept_straight())
        return [100 * w * b for b in radiances(case, variant, at, d)]

    us, vs = cuts(case, variant, at)
    grid = [sorted({low, high, *(c for c in cut if low < c < high)})
            for low, high, cut in ((*ends[:2], us), (*ends[2:], vs))]
    parts = [integral(f, *grid[0][i:i + 2], *grid[1][j:j + 2])
             for i in range(len(grid[0]) - 1) for j in range(len(grid[1]) - 1)]
    return [sum(u) for u in zip(*parts)]


def printed(path=PRINTED):
    """The values of the standard: case, variant, sky, point."""
    values = {}
    lines = path.read_text().splitlines() if path.exists() else []
    for case, variant, kind, *row in (
            line.split() for line in lines if not line.startswith('#')):
        values.update({(case, variant, int(kind), name): float(value)
                       for name, value in zip(NAMES, row)
                       if value != '-'})
    return values


def quad(axis, place, u0, u1, v0, v1):
    """The corners of a rectangle across an axis."""
    flat = (u0, v0), (u1, v0), (u1, v1), (u0, v1)
    return [[(place, *c), (c[0], place, c[1]), (*c, place)][axis]
            for c in flat]


def scene(case, variant):
    """The text of an OBJ: the room, and what stands before it."""
    axis, place, u0, u1, v0, v1 = opening(case, variant)
    sides = [(0, 0, 0, 4, 0, 3), (0, 4, 0, 4, 0, 3), (1, 0, 0, 4, 0, 3),
             (1, 4, 0, 4, 0, 3), (2, 0, 0, 4, 0, 4), (2, 3, 0, 4, 0, 4)]
    end = next(s for s in sides if s[:2] == (axis, place))[2:]
    room = [s for s in sides if s[:2] != (axis, place)]
    room += [(axis, place, *s) for s in (
        (0, end[1], 0, v0), (0, end[1], v1, end[3]), (0, u0, v0, v1),
        (u1, end[1], v0, v1)) if s[0] < s[1] and s[2] < s[3]]
    if case == '5.7':
        room += [(1, 1.3, 0, 4, 0, 1), (1, 1.5, 0, 4, 0, 1),
                 (2, 1, 0, 4, 1.3, 1.5)]
    parts = {'room': room}
    if case == '5.13':
        room += [(1, 0, -100, 0, 0, 3), (1, 0, 4, 104, 0, 3)]
        parts['mask'] = [(2, 3, -100, 104, -float(variant), 0)]
    if case == '5.14':
        parts['mask'] = [(1, -6, -100, 104, 0, float(variant))]
    if case in GLAZED:
        parts['pane'] = [opening(case, variant)]
    lines = []
    for name, quads in parts.items():
        lines.append(f'usemtl {name}')
        for corners in (quad(*q) for q in quads):
            lines += ['v {:g} {:g} {:g}'.format(*c) for c in corners]
            lines.append('f -4 -3 -2 -1')
    return '\n'.join(lines) + '\n'


def options(case, kind):
    """Options of pt."""
    if case in ('5.6', '5.7'):
        return ['-r0', '--sky=sphere']
    words = ['-r0', f'--sky=cie:{kind}', '--sun=180,60']
    if case not in ROOF:
        words.append(f'--ground-glow={GROUND}')
    if case in MASK:
        words.append(f'-rmask={MASK[case]}')
    if case in GLAZED:
        words.append(f'--glass=pane={STRAIGHT}')
    return words


def write(case, variant, folder):
    """Writes scene.obj and points.txt."""
    Path(folder, 'scene.obj').write_text(scene(case, variant))
    Path(folder, 'points.txt').write_text(''.join(
        '{:g} {:g} {:g} {:g} {:g} {:g}\n'.format(*at, *normal)
        for _, (at, normal) in points(case)))


def run(pt, case, variant, kind):
    """Values and standard errors of pt, in percent."""
    with tempfile.TemporaryDirectory() as folder:
        write(case, variant, folder)
        subprocess.run(
            [pt, 'scene.obj', '--points=points.txt', *options(case, kind),
             '--integrator=sobol',
             f'-n{VARIANTS[case][variant] * REPLICATES * TOGETHER}', '-q',
             '-o', 'values.csv'],
            cwd=folder, check=True)
        with open(Path(folder, 'values.csv')) as file:
            return [(100 * float(row['value']), 100 * float(row['stderr']))
                    for row in csv.DictReader(file)]


def beyond(x, freedom):
    """The probability that a t of so many degrees is beyond x."""
    size = math.exp(math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2))
    size /= sqrt(freedom * pi)

    def density(u):
        # Of x / u, over u from 0 to 1
        return size * (1 + (x / u) ** 2 / freedom) ** (
            -(freedom + 1) / 2) * x / (u * u)
    steps = 2000
    return 2 * sum(density((i + .5) / steps) for i in range(steps)) / steps


def threshold(counts):
    """What the largest t of so many replicates exceeds in 1 of 100 runs."""
    low, high = 1, 100
    while high - low > 1e-6:
        middle = (low + high) / 2
        inside = math.prod((1 - beyond(middle, replicates - 1)) ** count
                           for replicates, count in counts.items())
        is_rare = inside > .99
        low, high = (low, middle) if is_rare else (middle, high)
    return high


def check(pt, cases):
    """Prints how far pt is off; returns whether all is within errors."""
    said, all_z, counts = printed(), [], Counter()
    open_irradiance(), north_irradiance()   # once for all processes
    print('case,values,error,rms z,largest z,printed,off,farthest')
    for case, variant in ((c, v) for c in cases for v in VARIANTS[c]):
        places = points(case)
        with Pool() as pool:
            truth = pool.starmap(
                exact, [(case, variant, *p) for _, p in places], 1)
        offs, errors, zs = [], [], []
        for kind in [0] if case in ('5.6', '5.7') else TYPES:
            for (name, _), true, (value, error) in zip(
                    places, truth, run(pt, case, variant, kind)):
                for key in (kind, 0):
                    number = said.pop((case, variant, key, name), None)
                    if number is not None:
                        offs.append(abs(number - true[kind - 1]))
                if error:
                    zs.append((value - true[kind - 1]) / error)
                    errors += [error / value] if value >= 1 else []
        rms, stated = (sqrt(sum(x * x for x in xs) / len(xs))
                       for xs in (zs, errors))
        farthest = f'{max(offs):.3f}' if offs else ''
        print(f'{case} {variant},{len(zs)},{stated:.5f},{rms:.2f},'
              f'{max(map(abs, zs)):.2f},{len(offs) or ""},'
              f'{sum(off > .02 for off in offs) if offs else ""},{farthest}',
              flush=True)
        all_z += zs
        counts[REPLICATES * VARIANTS[case][variant]] += len(zs)
    most, limit = max(map(abs, all_z)), threshold(counts)
    print(f'all,{len(all_z)},,,{most:.2f},,,')
    print(f'threshold,,,,{limit:.2f},,,')
    return most <= limit


def main():
    match sys.argv[1:]:
        case ['scene', case, variant, folder]:
            write(case, variant, folder)
            print(*options(case, 'N'))
        case ['check', pt, *cases]:
            if not check(str(Path(pt).resolve()), cases or VARIANTS):
                sys.exit('cie171.py: a value is farther off than by chance')
        case _:
            sys.exit(__doc__.partition('\n\nA black')[0])


if __name__ == '__main__':
    main()
