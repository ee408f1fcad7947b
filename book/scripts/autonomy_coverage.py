#!/usr/bin/env python3
"""Counts how often intervals of daylight autonomy cover the truth.

usage: autonomy_coverage.py PT PTIMG FOLDER [SEEDS [SAMPLES]]

A room with 96 sensors is rendered with many seeds; the truth is that of one
run with 256 times the samples. Printed are the shares of intervals that cover
it, over all sensors whose autonomies differ between seeds, and for the
spatial autonomy.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import csv
import re
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[2] / 'doc/examples'


def year(pt, ptimg, folder, seed, samples):
    """The autonomies with their ends, and the spatial one with its ends."""
    state = f'{folder}/coverage.litpt'
    subprocess.run([pt, EXAMPLES / 'room.obj', '--points', f'{folder}/grid',
                    '--materials', '--sky-patches=1', '--ground=0.2',
                    f'-n{samples}', f'-s{seed}', '-qf', '-o', state],
                   check=True)
    run = subprocess.run([ptimg, 'daylight', state, f'{folder}/year.smx'],
                         check=True, capture_output=True, text=True)
    rows = list(csv.DictReader(run.stdout.splitlines()))
    found = [[float(row[name]) for name in ('da', 'da_low', 'da_high')]
             for row in rows]
    words = re.findall(r'[\d.]+', run.stderr.split('sDA')[1])
    return found, [float(word) for word in words[:3]]


def main(pt, ptimg, folder, seeds=100, samples=1024):
    seeds, samples = int(seeds), int(samples)
    for name, *words in (('grid', 'grid.sh', '0', '0', '6', '4', '12', '8',
                          '0.85'), ('year.smx', 'year.sh')):
        with open(f'{folder}/{name}', 'wb') as out:
            subprocess.run(['sh', EXAMPLES / words[0], *words[1:]], stdout=out,
                           check=True)
    truth, whole = year(pt, ptimg, folder, 1000, 256 * samples)
    runs = [year(pt, ptimg, folder, seed, samples) for seed in range(seeds)]
    print('what,value')
    covered, count = 0, 0
    for k, (exact, _, _) in enumerate(truth):
        values = [found[k] for found, _ in runs]
        if len({value for value, _, _ in values}) > 1:
            count += seeds
            covered += sum(low <= exact <= high for _, low, high in values)
    print(f'sensors,{count // seeds}')
    print(f'autonomy covered,{100 * covered / count:.1f}')
    covered = sum(low <= whole[0] <= high for _, (_, low, high) in runs)
    print(f'spatial covered,{100 * covered / seeds:.1f}')
    widths = [high - low for found, _ in runs for _, low, high in found]
    print(f'mean width in per cent,{100 * sum(widths) / len(widths):.2f}')


if __name__ == '__main__':
    main(*sys.argv[1:])
