#!/usr/bin/env python3
"""curve.py -- draws error against time, ours and the peer's, as SVG

usage: curve.py < doc/measured/error.csv > doc/figures/error.svg

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import csv
import math
import sys

WIDTH, HEIGHT = 480, 300
LEFT, RIGHT, TOP, BOTTOM = 60, 110, 15, 45
NAMES = {'ours': ('litpt', '#1f5a96'), 'peer': ('Embree', '#c0561a')}


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


def main():
    rows = list(csv.DictReader(
        line for line in sys.stdin if not line.startswith('#')))
    points = {who: [(float(row[who + '_seconds']), float(row[who + '_error']))
                    for row in rows if row[who + '_seconds']]
              for who in NAMES}
    seconds, errors = zip(*(p for line in points.values() for p in line))
    x_of, x_ticks = scale(seconds, LEFT, WIDTH - RIGHT)
    y_of, y_ticks = scale(errors, HEIGHT - BOTTOM, TOP)
    print(f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" '
          f'height="{HEIGHT}" font-family="sans-serif" font-size="12">')
    print('<rect width="100%" height="100%" fill="white"/>')
    for t in x_ticks:
        print(f'<path d="M{x_of(t):.1f} {TOP}V{HEIGHT - BOTTOM}" '
              'stroke="#ddd"/>', text(x_of(t), HEIGHT - BOTTOM + 16, f'{t:g}'))
    for t in y_ticks:
        print(f'<path d="M{LEFT} {y_of(t):.1f}H{WIDTH - RIGHT}" '
              'stroke="#ddd"/>', text(LEFT - 6, y_of(t) + 4, f'{t:g}', 'end'))
    for who, (name, colour) in NAMES.items():
        if not points[who]:
            continue
        line = ' '.join(f'{x_of(s):.1f},{y_of(e):.1f}' for s, e in points[who])
        print(f'<polyline points="{line}" fill="none" stroke="{colour}" '
              'stroke-width="2"/>')
        shift = 20 * list(NAMES).index(who) - 10
        x, y = line.split()[-1].split(',')
        print(text(float(x) + 14, float(y) + shift, name, 'start',
                   f' fill="{colour}"'))
    middle = (LEFT + WIDTH - RIGHT) / 2
    print(text(middle, HEIGHT - 8, 'seconds, two threads'))
    print(text(0, 0, 'error of a pixel', 'middle',
               f' transform="translate(14 {(TOP + HEIGHT - BOTTOM) / 2:.1f})'
               ' rotate(-90)"'))
    print('</svg>')


if __name__ == '__main__':
    main()
