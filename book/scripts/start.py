#!/usr/bin/env python3
"""Measures what pt weighs before it does anything, and prints a CSV.

usage: start.py PT BOOK [PEER]

PT is the program, BOOK that of the book, which makes scenes, and
PEER a program with the arguments of embree_pt. Times are medians of 101 runs,
in turns. Instructions are counted by valgrind, and the memory of small runs by
GNU time; without them, or without a peer, there is a dash. The memory for a
triangle is the slope of the peak from 2*10^5 to 10^6 triangles of one kind of
scene, that for a pixel the slope from 10^5 to 10^6 pixels of one triangle.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from statistics import median

RUNS = 101
TRIANGLE = 'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n'
ABOVE = ['0.3,0.3,1', '0.3,0.3,0', '0,1,0', '60']


def run(command, **options):
    return subprocess.run(command, check=True, capture_output=True, **options)


def milliseconds(commands):
    """The median wall time of each command."""
    times = [[] for _ in commands]
    for _ in range(RUNS):
        for command, own in zip(commands, times):
            began = time.perf_counter()
            run(command)
            own.append(1e3 * (time.perf_counter() - began))
    return [f'{median(own):.2f}' for own in times]


def instructions(command, folder):
    """Millions of instructions of a command, if valgrind can run it."""
    if not shutil.which('valgrind'):
        return ''
    out = os.path.join(folder, 'callgrind.out')
    done = subprocess.run(
        ['valgrind', '--tool=callgrind', f'--callgrind-out-file={out}',
         *command], capture_output=True)
    count = re.search(r'Collected : (\d+)', done.stderr.decode())
    return f'{int(count[1]) * 1e-6:.1f}' if done.returncode == 0 else ''


def peak(command):
    """The peak memory of a command in kilobytes of 1024 bytes; or none."""
    time_program = shutil.which('time')
    if not time_program:
        return None
    said = run([time_program, '-f', '%M', *command]).stderr.decode()
    return int(said.split()[-1])


def slope(command, points, digits):
    """Bytes of the peak for each of what `command` is given."""
    (few, less), (many, more) = [(n, peak(command(at))) for n, at in points]
    if less is None:
        return ''
    return f'{1024 * (more - less) / (many - few):.{digits}f}'


class Program:
    """A program, and how it renders one sample of a scene."""

    def __init__(self, path, is_peer, folder):
        self.path, self.is_peer, self.folder = path, is_peer, folder

    def render(self, scene, view, size, spp='1'):
        p, t, u, fov = view
        if self.is_peer:
            out = os.path.join(self.folder, 'image.raw')
            return [self.path, scene, p, t, u, fov, size, spp, '0.8', out]
        out = os.path.join(self.folder, 'image.pgm')
        return [self.path, '-i', scene, '-p', p, '-t', t, '-u', u, '-F', fov,
                '-d', size, '-n', spp, '-r', '0.8', '-o', out, '-f', '-q']


def scene(maker, folder, triangles):
    path = os.path.join(folder, f'field-{triangles}.obj')
    with open(path, 'wb') as file:
        file.write(run([maker, 'scenes', 'field', str(triangles)]).stdout)
    options = run([maker, 'scenes', '--view', 'field']).stdout.decode().split()
    view = [options[options.index(o) + 1] for o in '-p -t -u -F'.split()]
    return path, view


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    pt, maker, *peer = sys.argv[1:]
    # Not the disk, whose time to write an image would be the larger part.
    memory = '/dev/shm' if os.path.isdir('/dev/shm') else None
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        programs = [Program(path, path in peer, folder)
                    for path in [pt, *peer]]
        triangle = os.path.join(folder, 'triangle.obj')
        with open(triangle, 'w') as file:
            file.write(TRIANGLE)
        small = os.path.join(folder, 'pt')
        run(['strip', '-o', small, pt])
        help_ms, *pixel_ms = milliseconds([
            [pt, '-h'],
            *(p.render(triangle, ABOVE, '1x1') for p in programs)])
        fields = {n: scene(maker, folder, n) for n in (200_000, 1_000_000)}
        rows = [
            ('size of the program [MB]', f'{os.path.getsize(small) * 1e-6:.1f}'),
            (r'\opt{-h}: instructions [M]', instructions([pt, '-h'], folder)),
            (r'\opt{-h}: time [ms]', help_ms),
            ('one pixel: instructions [M]', *(
                instructions(p.render(triangle, ABOVE, '1x1'), folder)
                for p in programs)),
            ('one pixel: time [ms]', *pixel_ms),
            ('one pixel: memory [MB]', *(
                f'{peak(p.render(triangle, ABOVE, "1x1")) * 1024e-6:.1f}'
                if shutil.which('time') else '' for p in programs)),
            ('memory for a triangle [B]', *(slope(
                lambda n: p.render(*fields[n], '1x1'),
                [(n, n) for n in fields], 0) for p in programs)),
            ('memory for a pixel [B]', *(slope(
                lambda size: p.render(triangle, ABOVE, size),
                [(100_000, '400x250'), (1_000_000, '1000x1000')], 0)
                for p in programs)),
        ]
    print('what,pt,peer')
    for what, *values in rows:
        print(what, *((value or '--') for value in [*values, ''][:2]), sep=',')


if __name__ == '__main__':
    main()
