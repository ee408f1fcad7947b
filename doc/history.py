#!/usr/bin/env python3
"""What the chapters cost in lines, from the history of the repository.

usage: history.py > doc/measured/history.csv

For prose and for code (the lines of chunks in chapters, without blank ones and
without the lines that begin and end a chunk): how many lines were ever added,
how many stand there at the end, and in how many commits either was changed
without the other. A line that is changed counts as one that is added. Merges
are left out, for the commits that they join are counted.

Copyright (C) 2026 litpt contributors
Copying and distribution of this file, with or without modification, are
permitted in any medium without royalty provided the copyright notice and this
notice are preserved. This file is offered as-is, without any warranty.
"""
import collections
import re
import subprocess


def git(*args):
    done = subprocess.run(['git', *args], capture_output=True, check=False)
    return done.stdout.decode(errors='replace')


def sides(text):
    """The lines of prose and those of code, each with its number of copies."""
    prose, code, inside = collections.Counter(), collections.Counter(), False
    for line in text.splitlines():
        if re.match(r'<<.+>>=\s*$', line):
            inside = True
        elif re.match(r'@(\s|$)', line):
            inside = False
        elif line.strip():
            (code if inside else prose)[line.strip()] += 1
    return prose, code


def chapters(commit):
    """The chapters of a commit, by their paths; none before the first."""
    names = git('ls-tree', '-r', '--name-only', commit, 'chapters').split()
    return {name: git('show', f'{commit}:{name}') for name in names}


def main():
    commits = git('rev-list', '--reverse', '--no-merges', 'HEAD').split()
    added, changed = [0, 0], collections.Counter()
    for commit in commits:
        paths = git('diff-tree', '--root', '-r', '--no-commit-id',
                    '--name-only', commit, 'chapters').split()
        more = [0, 0]
        for path in paths:
            old = sides(git('show', f'{commit}^:{path}'))
            new = sides(git('show', f'{commit}:{path}'))
            for side in (0, 1):
                more[side] += sum((new[side] - old[side]).values())
                # A line that is only taken away is a change as well.
                changed[commit, side] += sum((old[side] - new[side]).values())
        for side in (0, 1):
            added[side] += more[side]
            changed[commit, side] += more[side]
    now = [sides(text) for text in chapters('HEAD').values()]
    standing = [sum(sum(pair[side].values()) for pair in now)
                for side in (0, 1)]
    touched = [[bool(changed[commit, side]) for side in (0, 1)]
               for commit in commits]
    print('what,prose,code')
    print('lines that stand,{},{}'.format(*standing))
    print('lines that were written,{},{}'.format(*added))
    print('written for one that stands,{:.2f},{:.2f}'.format(
        *(a / s for a, s in zip(added, standing))))
    print('commits that change it,{},{}'.format(
        *(sum(t[side] for t in touched) for side in (0, 1))))
    print('commits that change it alone,{},{}'.format(
        touched.count([True, False]), touched.count([False, True])))


main()
