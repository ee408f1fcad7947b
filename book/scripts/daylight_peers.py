#!/usr/bin/env python3
"""Compares the daylight coefficients of pt with those of Radiance.

usage: daylight_peers.py [options] numbering
       daylight_peers.py dctimestep D.mtx S.smx
       daylight_peers.py [options] room [PT]
       daylight_peers.py [options] rfluxmtx PT
       daylight_peers.py [options] sky
       daylight_peers.py [options] all PT

numbering   the patches of 100 000 directions, by rcalc and by patch(); writes
            directions-1.txt, -2 and -4, lines "x y z patch"
dctimestep  a product of matrices, by dctimestep and by numpy
room        the rows' sums, beside irradiances under a uniform sky by rtrace
rfluxmtx    variances of coefficients at the same time on as many cores
sky         a year's sky as text, floats and doubles: S.smx, Sf.smx, Sd.smx
all         all of these, as a table

Without PT, room runs Radiance alone. Its programs are those of the package
pyradiance of PyPI, installed beside this interpreter, with numpy. They seed
their random numbers with the second of the clock: two runs in one second are
the same, and with -n 2 so are the random numbers of a run's two processes.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import argparse
import os
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path

import numpy as np

PYRADIANCE = find_spec('pyradiance').submodule_search_locations[0]
ROOM = Path(__file__).resolve().parents[2] / 'doc/examples/room.obj'
# Each comment makes the source after it a receiver of rfluxmtx.
BELOW = ('#@rfluxmtx h=u u=+Y\nvoid glow dark 0 0 4 1 1 1 0\n'
         'dark source below 0 0 4 0 0 -1 180\n')
ABOVE = ('#@rfluxmtx h=r1 u=+Y\nvoid glow blue 0 0 4 1 1 1 0\n'
         'blue source above 0 0 4 0 0 1 180\n')
GROUND = ('void plastic soil 0 0 5 {0} {0} {0} 0 0\n'
          'soil ring earth 0 0 8 0 0 -0.001 0 0 1 0 1000000\n')
# Some of the 200 sensors look up, some at the window, some up and aside.
NORMALS = '0 0 1', '-1 0 0', '0 -0.6 0.8'
SENSORS = [f'{.15 + .3 * (k % 20):.2f} {.2 + .4 * (k // 20):.1f} 0.85 '
           + NORMALS[k % 3] for k in range(200)]


def radiance(*command, given='', to=None):
    """What a program of Radiance prints, as bytes, or writes to a file.

    It aligns the numbers of a matrix only if it writes it to a file itself.
    """
    paths = dict(PATH=f'{PYRADIANCE}/bin:' + os.environ['PATH'],
                 RAYPATH=f'.:{PYRADIANCE}/lib')
    with open(to, 'wb') if to else nullcontext(subprocess.PIPE) as out:
        return subprocess.run(command, input=given.encode(), stdout=out,
                              env=os.environ | paths, check=True).stdout


def text(lines):
    return '\n'.join(lines) + '\n'


def place(directions, mf):
    """The heights of directions in rows, the rows' patches, the azimuths.

    An azimuth is in patches, from the first edge of the patch in the north.
    """
    x, y, z = np.asarray(directions, float).T
    height = np.arctan2(z, np.hypot(x, y)) / (np.pi / 2) * (7 * mf + .5)
    counts = np.append(np.repeat(
        np.array([30, 30, 24, 24, 18, 12, 6]) * mf, mf), 1)
    row = np.clip(np.floor(height).astype(int), 0, 7 * mf)
    turn = np.arctan2(x, y) / (2 * np.pi) % 1
    return height, row, counts, turn * counts[row] + .5


def patch(directions, mf):
    """The patch of each direction; 0 is the ground, and 1 is in the north."""
    height, row, counts, across = place(directions, mf)
    before = np.append(0, np.cumsum(counts))
    column = np.floor(across).astype(int) % counts[row]
    return np.where(height > 0, 1 + before[row] + column, 0)


def numbering(options):
    """Radiance begins the first patch of each row 0.0001 degrees too early."""
    random = np.random.default_rng(1)
    directions = random.standard_normal((100_000, 3))
    directions[:, 2] = abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    lines = ['%.17g %.17g %.17g' % tuple(d) for d in directions]
    for mf in 1, 2, 4:
        numbers = np.array(radiance(
            'rcalc', '-f', 'reinhartb.cal', '-e',
            f'MF={mf};Dx=$1;Dy=$2;Dz=$3;$1=rbin+1', given=text(lines)
        ).split(), int)
        Path(f'directions-{mf}.txt').write_text(
            text(f'{d} {n}' for d, n in zip(lines, numbers)))
        height, _, _, across = place(directions, mf)
        edge = [abs(a - np.round(a)) < 1e-9 for a in (height, across)]
        differ = (numbers != patch(directions, mf)) & ~np.any(edge, axis=0)
        say(f'other numbers; MF {mf}', differ.sum())


def parse(matrix):
    """An array of rows, columns and components, from Radiance's format."""
    head, _, body = matrix.partition(b'\n\n')
    known = dict(line.split('=', 1) for line in head.decode().split('\n')
                 if '=' in line)
    shape = [int(known.get(name, 3)) for name in ('NROWS', 'NCOLS', 'NCOMP')]
    kind = known['FORMAT'].strip()
    if kind == 'ascii':
        return np.array(body.split(), float).reshape(shape)
    order = '>' if known.get('BigEndian') == '1' else '<'
    size = {'float': 'f4', 'double': 'f8'}[kind]
    return np.frombuffer(body, order + size).reshape(shape)


def dctimestep(options):
    matrices = [parse(Path(name).read_bytes()) for name in options.files]
    ours = np.einsum('ijc,jkc->ikc', *matrices, dtype=float, optimize=True)
    theirs = parse(radiance('dctimestep', '-od', *options.files))
    some = ours != 0
    error = abs(theirs - ours)[some] / abs(ours[some])
    say('dctimestep; largest relative difference', error.max())
    sizes = np.einsum('ijc,jkc->ikc', *map(abs, matrices), optimize=True)
    error = abs(theirs - ours)[some] / sizes[some]
    say('dctimestep; largest over the sum of sizes', error.max())
    say('dctimestep; largest where numpy has 0',
        abs(theirs[~some]).max(initial=0))


def prepare(options):
    """Writes grid.txt, and room.oct, which has no sky."""
    Path('grid.txt').write_text(text(SENSORS))
    scene = radiance('obj2rad', ROOM).decode()
    for line in ROOM.with_suffix('.mtl').read_text().splitlines():
        word, *values = line.split()
        if word == 'newmtl':
            name, = values
        elif word == 'Kd':
            grey = np.dot([.2126, .7152, .0722], np.array(values, float))
            scene = (f'void plastic {name} 0 0 5' + 3 * f' {grey:.9g}'
                     + f' 0 0\n{scene}')
    if options.ground:
        scene += GROUND.format(options.ground)
    radiance('oconv', '-', given=scene, to='room.oct')


def pt(options):
    """Of a run of pt for each seed: coefficients, their errors, seconds."""
    for seed in range(int(options.seeds)):
        command = [options.files[0], ROOM, '--points', 'grid.txt',
                   '--materials', '--sky-patches', '1', '-n', options.n,
                   '-s', str(seed), '-f', '-q', '-o', 'D.csv']
        if options.ground:
            command += ['--ground', options.ground]
        start = time.monotonic()
        subprocess.run(command, check=True)
        seconds = time.monotonic() - start
        row, column, *values = np.loadtxt('D.csv', delimiter=',', skiprows=1).T
        row, column = row.astype(int), column.astype(int)
        table = np.zeros((2, 200, 146))
        table[:, row - row.min(), column] = values
        yield *table, seconds


def limits(rays):
    """Switches that lose nothing: Russian roulette ends paths, of 1/rays each.

    Of the light, 1e-15 has more than 64 bounces, and 0.001 more than 8.
    """
    return f'-ab 64 -lr -64 -ad {rays} -lw {1 / rays}'.split()


def say(what, value):
    print(f'{what},{value:.6g}', flush=True)


def mean_and_error(runs):
    return (np.mean(runs, axis=0),
            np.std(runs, axis=0, ddof=1) / len(runs) ** .5)


def room(options):
    """Many estimates of 4096 rays, since rtrace adds rays in floats.

    With 65 536 rays it finds 3.1407 for the sensor in the open. Its default,
    -as 512, would make the values too small, by up to a tenth.
    """
    prepare(options)
    glow = ABOVE if options.ground else ABOVE + BELOW
    radiance('oconv', '-i', 'room.oct', '-', given=glow, to='lit.oct')
    jobs = int(options.jobs)

    def run(job):
        time.sleep(1.1 * job)
        return np.array(radiance(
            'rtrace', '-h', '-I', '-u+', '-aa', '0', '-as', '0',
            *limits(4096), 'lit.oct',
            given=text(SENSORS * (int(options.runs) // jobs))
        ).split(), float).reshape(-1, 200, 3)[..., 0]

    with ThreadPoolExecutor() as pool:
        runs = np.concatenate(list(pool.map(run, range(jobs))))
    theirs, their_error = mean_and_error(runs)
    mean, error = mean_and_error(runs.mean(1))
    say('rtrace; mean', mean)
    say('rtrace; error of the mean', error)
    say('rtrace; error of a sensor in per cent',
        100 * np.mean(their_error / theirs))
    if options.files:
        runs = np.array([values.sum(1) for values, _, _ in pt(options)])
        ours, our_error = mean_and_error(runs)
        our_mean, our_mean_error = mean_and_error(runs.mean(1))
        z = (ours - theirs) / np.hypot(our_error, their_error)
        all_z = (our_mean - mean) / np.hypot(our_mean_error, error)
        say('pt; mean', our_mean)
        say('pt; error of the mean', our_mean_error)
        say('pt; error of a sensor in per cent',
            100 * np.mean(our_error / ours))
        say('sensors within 3 errors in per cent', 100 * np.mean(abs(z) <= 3))
        say('largest z', abs(z).max())
        say('root mean square of z', np.mean(z ** 2) ** .5)
        say('z of the mean', all_z)


def rfluxmtx(options):
    prepare(options)
    Path('receivers.rad').write_text(BELOW + ABOVE)

    def run(rays):
        start = time.monotonic()
        printed = radiance(
            'rfluxmtx', '-I+', '-n', options.jobs, *limits(rays),
            '-y', '200', '-', 'receivers.rad', '-i', 'room.oct',
            given=text(SENSORS))
        seconds = time.monotonic() - start
        time.sleep(max(0, 1.1 - seconds))
        return parse(printed)[..., 0], seconds

    runs, errors, seconds = map(np.array, zip(*pt(options)))
    target, ours, rays = seconds.mean(), runs.var(0, ddof=1).mean(), 256
    say('pt; seconds', target)
    say('pt; mean variance', ours)
    say('pt; mean square of its errors', np.mean(errors ** 2))
    for _ in range(3):
        rays = max(1, round(rays * target / run(rays)[1]))
    runs, seconds = map(np.array, zip(*(
        run(rays) for _ in range(int(options.seeds)))))
    seconds, theirs = seconds.mean(), runs.var(0, ddof=1).mean()
    say('rfluxmtx; rays', rays)
    say('rfluxmtx; seconds', seconds)
    say('rfluxmtx; mean variance', theirs)
    say('pt of rfluxmtx; variance', ours / theirs)
    say('pt of rfluxmtx; variance times seconds',
        ours * target / theirs / seconds)


def weather():
    """The lines of a year at 52 degrees north, with clear and dull hours."""
    hours = np.arange(8760) + .5
    turn = np.radians(15 * (hours % 24 - 12 + (13 - 15) / 15))
    fall = np.radians(23.45 * np.sin(2 * np.pi * (hours // 24 + 285) / 365))
    north = np.radians(52)
    sine = (np.sin(north) * np.sin(fall)
            + np.cos(north) * np.cos(fall) * np.cos(turn)).clip(0)
    noise = np.random.default_rng(1).normal(size=8760)
    clear = np.clip(.5 + np.convolve(noise, np.full(6, .2), 'same'), 0, 1)
    direct = clear * 1361 * .7 ** (sine.clip(.02) ** -.678) * (sine > .1)
    diffuse = (400 - 250 * clear) * sine
    yield ('place synthetic\nlatitude 52\nlongitude -13\ntime_zone -15\n'
           'site_elevation 50\nweather_data_file_units 1')
    dates = np.datetime64('2026-01-01T00') + np.arange(8760)
    for date, beam, rest in zip(dates.tolist(), direct, diffuse):
        yield (f'{date.month} {date.day} {date.hour + .5} '
               f'{beam:.0f} {rest:.0f}')


def sky(options):
    Path('weather.wea').write_text(text(weather()))
    for name, *kind in ['S'], ['Sf', '-of'], ['Sd', '-od']:
        radiance('gendaymtx', '-m', '1', '-O0', *kind, 'weather.wea',
                 to=name + '.smx')


def all(options):
    print('what,value')
    numbering(options)
    sky(options)
    Path('grid.txt').write_text(text(SENSORS))
    subprocess.run([options.files[0], ROOM, '--points', 'grid.txt',
                    '--materials', '--sky-patches', '1', '-n', options.n, '-f',
                    '-q', '-o', 'D.mtx'], check=True)
    program = options.files
    options.files = ['D.mtx', 'S.smx']
    dctimestep(options)
    options.files = program
    room(options)
    rfluxmtx(options)


def main():
    about, _, _ = __doc__.partition('\n\nCopyright')
    parser = argparse.ArgumentParser(
        usage=argparse.SUPPRESS, description=about,
        formatter_class=argparse.RawTextHelpFormatter)
    commands = {run.__name__: run
                for run in (numbering, dctimestep, room, rfluxmtx, sky, all)}
    parser.add_argument('command', choices=commands)
    parser.add_argument('files', nargs='*')
    for name, default, meaning in (
            ('--folder', '.', 'where files are written'),
            ('--ground', '', 'its albedo; then column 0 is empty'),
            ('-n', '1024', 'paths of pt for a sensor'),
            ('--seeds', '64', 'runs of pt, and of rfluxmtx'),
            ('--runs', '64', 'runs of rtrace, each of 4096 rays a sensor'),
            ('--jobs', '2', 'cores for Radiance')):
        parser.add_argument(name, default=default,
                            help=f'{meaning} [{default or "none"}]')
    options = parser.parse_args()
    options.files = [os.path.abspath(name) for name in options.files]
    os.chdir(options.folder)
    commands[options.command](options)


if __name__ == '__main__':
    main()
