#!/usr/bin/env python3
"""curve.py -- draws error against time, ours and the peer's, as SVG

usage: curve.py SCENE... < doc/measured/efficiency.csv > doc/figures/error.svg

A panel for each scene. The times are those of whole runs.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import csv
import math
import sys

WIDTH, HEIGHT = 340, 260
LEFT, RIGHT, TOP, BOTTOM = 58, 12, 26, 42
NAMES = {'equal': ('litpt', '#1f5a96'), 'peer': ('Embree', '#c0561a')}
SCENES = {'backroom': 'a back room'}


def scale(values, low, high):
    """A function from a value to its place, and the ticks 1, 2, 5 of the
    decades that the values span."""
    first, last = (math.log10(f(values)) for f in (min, max))
    margin = 0.05 * (last - first)
    first, last = first - margin, last + margin

    def place(x):
        return low + (math.log10(x) - first) / (last - first) * (high - low)

    ticks = [float(f'{digit}e{power}') for power in range(-9, 9)
             for digit in (1, 2, 5)]
    return place, [t for t in ticks if first <= math.log10(t) <= last]


def text(x, y, words, anchor='middle', more=''):
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{more}>' \
        f'{words}</text>'


def panel(scene, rows):
    points = {who: [(float(row[who + '_seconds']), float(row[who + '_error']))
                    for row in rows] for who in NAMES}
    seconds, errors = zip(*(p for line in points.values() for p in line))
    x_of, x_ticks = scale(seconds, LEFT, WIDTH - RIGHT)
    y_of, y_ticks = scale(errors, HEIGHT - BOTTOM, TOP)
    for t in x_ticks:
        print(f'<path d="M{x_of(t):.1f} {TOP}V{HEIGHT - BOTTOM}" '
              'stroke="#ddd"/>', text(x_of(t), HEIGHT - BOTTOM + 16, f'{t:g}'))
    for t in y_ticks:
        print(f'<path d="M{LEFT} {y_of(t):.1f}H{WIDTH - RIGHT}" '
              'stroke="#ddd"/>', text(LEFT - 6, y_of(t) + 4, f'{t:g}', 'end'))
    for who, (name, colour) in NAMES.items():
        line = ' '.join(f'{x_of(s):.1f},{y_of(e):.1f}' for s, e in points[who])
        print(f'<polyline points="{line}" fill="none" stroke="{colour}" '
              'stroke-width="2"/>')
        x, y = map(float, line.split()[-1].split(','))
        print(text(x - 6, y + (4 if who == 'equal' else -10), name, 'end',
                   f' fill="{colour}"'))
    middle = (LEFT + WIDTH - RIGHT) / 2
    print(text(middle, 16, SCENES.get(scene, f'the {scene}')))
    print(text(middle, HEIGHT - 8, 'seconds, two threads'))


def main():
    rows = list(csv.DictReader(
        line for line in sys.stdin if not line.startswith('#')))
    print(f'<svg xmlns="http://www.w3.org/2000/svg" '
          f'width="{WIDTH * len(sys.argv[1:])}" height="{HEIGHT}" '
          'font-family="sans-serif" font-size="12">')
    print('<rect width="100%" height="100%" fill="white"/>')
    for i, scene in enumerate(sys.argv[1:]):
        print(f'<g transform="translate({i * WIDTH} 0)">')
        panel(scene, [row for row in rows if row['scene'] == scene
                      and row['albedo'] == '0.8'])
        if i == 0:
            print(text(0, 0, 'error of a pixel', 'middle',
                       f' transform="translate(14 {HEIGHT / 2}) rotate(-90)"'))
        print('</g>')
    print('</svg>')


if __name__ == '__main__':
    main()
